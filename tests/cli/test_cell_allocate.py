"""``pinproof cell allocate``: its output, its files and its errors."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from ..pages import ROOT, Run

pytestmark = pytest.mark.slow


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "robots" / "two_ur5", "two_ur5")
    return "two_ur5/picks.yaml"


def test_programs_of_both_arms_are_printed_and_written(cell: str, run: Run) -> None:
    only = ("--only", "part_1_1,part_6_3")
    outputs = ("-o", "cell.json", "-o", "cell.md", "-o", "cell.html")
    code, out, _ = run("cell", "allocate", cell, *only, "--no-compare", *outputs)
    assert code == 0
    assert "2 picks of 2 arms" in out
    content = json.loads(Path("cell.json").read_text(encoding="utf-8"))
    assert content["ok"]
    assert [each["picks"] for each in content["arms"]] == [["part_1_1"], ["part_6_3"]]
    assert sum(each["duration"] for each in content["intervals"]) == pytest.approx(content["makespan"])
    assert "| part_6_3 | approach |" in Path("cell.md").read_text(encoding="utf-8")
    assert "part_6_3 (right)" in Path("cell.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--only", "part_9_9"), "part_9_9"),
        (("--before", "part_1_1"), "names 1 picks"),
        (("-o", "cell.csv"), "cell.csv"),
    ],
)
def test_bad_input_is_named(options: tuple[str, ...], message: str, cell: str, run: Run) -> None:
    code, out, err = run("cell", "allocate", cell, *options)
    assert code == 2
    assert message in out + err


def test_file_with_one_robot_is_refused(cell: str, run: Run) -> None:
    shutil.copytree(ROOT / "robots" / "ur5", "ur5")
    code, out, err = run("cell", "allocate", "ur5/picks.yaml")
    assert code == 2
    assert "robots" in out + err
    code, out, err = run("pick", cell)
    assert code == 2
    assert "pinproof cell allocate" in (out + err).replace("\n", " ")
