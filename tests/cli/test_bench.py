"""``pinproof bench``: the table on stdout, its files in a folder, and error messages."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

SMALL = ("bench", "ik", "ur5", "--points", "3", "--no-peers", "--methods", "clik, fabrik")


def test_the_table_is_markdown_with_the_selected_methods(run) -> None:
    code, out, _ = run(*SMALL)
    assert code == 0
    assert "| Clik |" in out
    assert "| Fabrik (within 0.0001) |" in out
    assert "PseudoInverse" not in out


@pytest.mark.slow
def test_json_and_files_contain_the_same_run(run, tmp_path: Path) -> None:
    code, out, _ = run(*SMALL, "--json", "--output", str(tmp_path / "new"))
    assert code == 0
    assert json.loads(out) == json.loads((tmp_path / "new" / "ik.json").read_text(encoding="utf-8"))
    assert {path.name for path in (tmp_path / "new").iterdir()} == {
        "ik.json",
        "ik.md",
        "ik_latency.png",
    }


@pytest.mark.parametrize(("option", "upper"), [("--limits-pi", 3.14159265), ("--own-limits", 6.28318530)])
def test_the_limits_follow_the_option(run, option: str, upper: float) -> None:
    code, out, _ = run(*SMALL, "--json", option)
    assert code == 0
    assert json.loads(out)["settings"]["chains"]["ur5"]["upper"][0] == pytest.approx(upper, abs=1e-6)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("bench", "ik", "--methods", "magic", "--points", "1"), "magic"),
        (("bench", "ik", "nobody", "--points", "1"), "'nobody'"),
    ],
)
def test_unknown_names_are_reported(run, words: tuple[str, ...], named: str) -> None:
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert named in err


PLAN = ("bench", "plan", "generic_6dof", "--set", "shelf", "--problems", "1", "--no-peers")


@pytest.mark.slow
def test_planning_is_measured_and_written(run, tmp_path: Path) -> None:
    code, out, _ = run(*PLAN, "--output", str(tmp_path / "new"))
    assert code == 0
    assert "| pinproof | 1 of 1 | 1 | 0 |" in out
    assert {path.name for path in (tmp_path / "new").iterdir()} == {"planning.json", "planning.md", "planning.png"}


def test_planning_as_json(run) -> None:
    code, out, _ = run(*PLAN, "--json", "--seed", "3")
    assert code == 0
    table = json.loads(out)
    assert table["provenance"]["seed"] == 3
    assert [row["solved"] for row in table["rows"]] == [True]


def test_an_unsafe_motion_is_exit_code_1(run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pinproof.benchmarks.plan_run.motion_faults", lambda *_: ("link_6 touches board_1",))
    code, out, _ = run(*PLAN)
    assert code == 1
    assert "link_6 touches board_1" in out


def test_missing_planning_problems_are_reported(run, tmp_path: Path) -> None:
    code, out, err = run("bench", "plan", "--mbm", str(tmp_path))
    assert (code, out) == (2, "")
    assert "sceneNNNN.yaml" in err


def test_motions_need_problems(run) -> None:
    code, out, err = run("bench", "plan", "--motion")
    assert (code, out) == (2, "")
    assert "--mbm" in err


@pytest.mark.parametrize(
    "words", [("bench", "poetry"), ("bench", "ik", "--points", "0"), ("bench", "plan", "--problems", "0")]
)
def test_wrong_usage_is_exit_code_2(run, words: tuple[str, ...]) -> None:
    assert run(*words)[0] == 2
