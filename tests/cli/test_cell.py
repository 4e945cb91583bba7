"""``pinproof cell sequence``: its output, its files and its errors."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import pytest

from ..pages import ROOT, Run

pytestmark = pytest.mark.slow


@pytest.fixture
def bolts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "robots" / "ur5", "ur5")
    return "ur5/picks.yaml"


def test_sequence_is_printed_and_written(bolts: str, run: Run) -> None:
    only = ("--only", "bolt_1,bolt_2,bolt_5")
    code, out, _ = run("cell", "sequence", bolts, *only, "--before", "bolt_5,bolt_1", "-o", "cell.json")
    assert code == 0
    assert "3 picks in" in out
    content = json.loads(Path("cell.json").read_text(encoding="utf-8"))
    order = [step["name"] for step in content["steps"]]
    assert sorted(order) == ["bolt_1", "bolt_2", "bolt_5"]
    assert order.index("bolt_5") < order.index("bolt_1")
    code, out, _ = run("cell", "sequence", bolts, *only, "--file-order", "--grip-dwell", "0.5", "--json")
    assert code == 0
    kept = json.loads(out)
    assert [step["name"] for step in kept["steps"]] == ["bolt_1", "bolt_2", "bolt_5"]
    assert kept["by_phase"]["grip"] == pytest.approx(1.5)


def test_failing_picks_are_listed_and_give_exit_code_1(bolts: str, run: Run) -> None:
    outputs = [f"cell.{kind}" for kind in ("csv", "md", "json")]
    code, out, _ = run("cell", "sequence", bolts, "--only", "bolt_1,bolt_6", *(f"-o{path}" for path in outputs))
    assert code == 1
    first, second, summary, *_ = out.splitlines()
    assert ("bolt_1" in first, "bolt_6" in second, "left out: reach:" in second) == (True, True, True)
    assert "guessed accelerations" in summary  # beside the time of the cycle
    with Path("cell.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["position"], row["pick"], row["left_out"].partition(":")[0]) for row in rows] == [
        ("1", "bolt_1", ""),
        ("", "bolt_6", "reach"),
    ]
    assert re.search(r"^\|\s*\| bolt_6 \|.*left out: reach:", Path("cell.md").read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--only", "bolt_1,bolt_99"), "bolt_99"),
        (("--before", "bolt_1"), "names 1 picks"),
        (("--before", "bolt_1,bolt_0"), "bolt_0"),
        (("--before", "bolt_1,bolt_2", "--before", "bolt_2,bolt_1"), "bolt_1 before bolt_2"),
        (("-o", "cell.pdf"), "cell.pdf"),
        (("-o", "nowhere/cell.csv"), "nowhere"),
        (("-o", "cell.html", "--heat-map", "ur5/scene.yaml"), "column 'x'"),
        (("-o", "cell.csv", "--heat-map", "ur5/scene.yaml"), "--heat-map"),
    ],
)
def test_bad_input_is_named(options: tuple[str, ...], message: str, bolts: str, run: Run) -> None:
    code, out, err = run("cell", "sequence", bolts, *options)
    assert code == 2
    assert out == ""
    assert message in err
