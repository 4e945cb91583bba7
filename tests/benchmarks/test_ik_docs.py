"""The page shows the stored figures; their values depend on the machine, so no test asserts them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from benchmarks.ik import DocsIkTable, success_markdown
from benchmarks.ik_methods import PARTS
from benchmarks.ik_run import ik_markdown

from ..pages import ROOT, run_page

FOLDER = ROOT / "docs" / "benchmarks"


@pytest.fixture(scope="module")
def stored() -> DocsIkTable:
    return DocsIkTable.load(FOLDER / "ik.json")


def test_the_page_shows_the_stored_table(stored: DocsIkTable) -> None:
    text = (FOLDER / "ik.md").read_text(encoding="utf-8")
    assert text.endswith(ik_markdown(stored) + success_markdown(stored.success)), "run ./scripts/benchmark ik --render"


def test_the_stored_table_is_complete(stored: DocsIkTable) -> None:
    assert stored.settings["points"] == 10_000
    assert all(stored.part(robot, request) for robot in stored.robots for request in PARTS)
    assert {row.samples for row in stored.success} == {100_000}


def test_the_examples_of_the_page_on_inverse_kinematics_run(tmp_path: Path) -> None:
    names: dict[str, Any] = run_page(ROOT / "docs" / "ik.md", tmp_path)
    assert names["only_there"].ok
    assert names["many"].ok.all()
