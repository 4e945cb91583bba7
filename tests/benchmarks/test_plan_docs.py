"""The page shows the stored figures; times depend on the machine, so no test asserts them."""

from __future__ import annotations

from pathlib import Path

import pytest
from benchmarks.planning_problems import OWN_ROBOTS, OWN_SCENES
from benchmarks.planning_run import OWN_PROBLEMS, PlanTable, plan_markdown

FOLDER = Path(__file__).parents[2] / "docs" / "benchmarks"


@pytest.fixture(scope="module")
def stored() -> PlanTable:
    return PlanTable.load(FOLDER / "planning.json")


def test_the_page_shows_the_stored_table(stored: PlanTable) -> None:
    text = (FOLDER / "planning.md").read_text(encoding="utf-8")
    assert plan_markdown(stored) in text, "run ./scripts/benchmark planning --render"


def test_the_stored_table_is_complete(stored: PlanTable) -> None:
    assert stored.collections == ("mbm", *OWN_ROBOTS)
    assert sum(problem.collection == "mbm" for problem in stored.problems) == 140
    for robot in OWN_ROBOTS:
        assert stored.sets(robot) == tuple(OWN_SCENES)
        assert sum(problem.collection == robot for problem in stored.problems) == OWN_PROBLEMS * len(OWN_SCENES)
    assert "roboplan" in stored.methods


def test_no_motion_of_ours_is_unsafe(stored: PlanTable) -> None:
    assert stored.unsafe == ()
    assert any(row.faults for row in stored.rows), "the check must be able to find faults"
