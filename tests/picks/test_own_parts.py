"""Checks of configurations at the grasp, columns of the report, and planners, of programs outside the package."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace

import pytest

import pinproof as pp
from pinproof.common.content_hash import digest
from pinproof.errors import InputError
from pinproof.picks import PickBudget, PickStatus, Stage

from .conftest import cell_of, recheck


@pytest.fixture(scope="module")
def cell() -> tuple[pp.Arm, pp.Scene, pp.Picks]:
    return cell_of("ur5", "picks.yaml", "bolt_1", "bolt_2")


@pytest.fixture(scope="module")
def plain(cell) -> pp.picks.PickReport:
    return pp.validate_picks(*cell, budget=PickBudget(compared=2, remedies=2))


def test_a_motion_passes_only_through_configurations_that_pass_the_checks(cell, judges) -> None:
    arm, scene, picks = cell
    judged = pp.validate_picks(arm, scene, picks, budget=PickBudget(compared=2), checks=[judges.elbow_up])
    assert judged.good
    for verdict in judged.good:
        recheck(verdict, arm, scene, picks, verdict.trajectory.start)
        stages = [stage.stage for stage in verdict.stages]
        assert stages.index(Stage.CHECK) == stages.index(Stage.GRIP) + 1
        assert arm.frame_placement(verdict.q_grasp, "forearm_link").translation[2] > 0.3
    assert "elbow_up: " in next(each for each in judged.good[0].stages if each.stage is Stage.CHECK).message


def test_without_checks_there_is_no_such_stage(plain) -> None:
    assert all(stage.stage is not Stage.CHECK for verdict in plain.verdicts for stage in verdict.stages)


def test_a_check_that_excludes_everything_is_the_stage_and_the_reason_and_proves_nothing(cell, judges) -> None:
    judged = pp.validate_picks(*cell, budget=PickBudget(remedies=2), checks=[judges.elbow_up, judges.never])
    for verdict in judged.verdicts:
        assert verdict.failed is Stage.CHECK
        assert verdict.status is PickStatus.NOT_FOUND
        assert f"{verdict.pick.name} is not wanted" in verdict.reason
        assert not verdict.refuted
    row = json.loads(judged.to_json())["picks"][0]
    assert row["failed_at"] == "check"
    assert row["stages"][-1]["stage"] == "check"
    assert "check" in judged.summary


@pytest.mark.slow
def test_checks_and_planners_work_in_other_processes(cell, judges) -> None:
    settings = {"budget": PickBudget(compared=1, remedies=0, planner=judges.Counting()), "checks": [judges.elbow_up]}
    here = pp.validate_picks(*cell, **settings)
    there = pp.validate_picks(*cell, workers=2, **settings)
    assert there.to_json() == here.to_json()


@pytest.mark.slow
def test_a_campaign_has_the_rows_of_the_checks_and_their_names_in_its_identity(cell, judges, tmp_path) -> None:
    arm, scene, picks = cell
    campaign = pp.Campaign(arm, scene, picks, checks=[judges.never])
    result = campaign.run(tmp_path, workers=1)
    assert result.failed_at == {"check": 2}
    assert campaign.header()["setup"]["checks"][0].startswith("campaign_judges.never ")
    assert "checks" not in pp.Campaign(arm, scene, picks).header()["setup"]


@pytest.mark.parametrize(
    ("checks", "words"),
    [
        ([3], "no function"),
        (["elbow_up"], "no function"),
        ([lambda task, candidate: True], "must return a reason"),
    ],
)
def test_what_is_no_check_is_refused(cell, checks: list, words: str) -> None:
    with pytest.raises(InputError, match=words):
        pp.validate_picks(*cell, checks=checks)


def test_an_own_planner_plans_the_transits_of_picks(cell, judges) -> None:
    arm, scene, picks = cell
    planner = judges.Counting()
    judged = pp.validate_picks(arm, scene, picks, budget=PickBudget(compared=1, remedies=0, planner=planner))
    assert planner.calls >= 2
    for verdict in judged.good:
        recheck(verdict, arm, scene, picks, verdict.trajectory.start)
    named = pp.validate_picks(
        arm, scene, picks, budget=PickBudget(compared=1, remedies=0, planner="campaign_judges:Counting")
    )
    assert named.to_json() == judged.to_json()


def test_an_own_planner_plans_the_transits_of_a_sequence(cell, judges) -> None:
    arm, scene, picks = cell
    planner = judges.Counting()
    setup = pp.picks.PickSetup.make(
        arm, scene, picks, home=None, rng=0, budget=PickBudget(planner=planner), checks=[judges.elbow_up]
    )
    result = pp.sequence(setup, picks, budget=pp.cell.SequenceBudget(refinements=0, motion=0))
    assert result.ok
    assert planner.calls >= 1


def test_the_identity_of_checks_and_planners_is_their_code(judges) -> None:
    one, same, other = (PickBudget(planner=judges.Counting()) for _ in range(3))
    other.planner.calls = 1
    assert digest(one) == digest(same) != digest(other)
    assert digest(judges.never) != digest(judges.elbow_up)


def test_what_is_no_planner_is_refused_with_what_is_missing() -> None:
    with pytest.raises(InputError, match="plan"):
        PickBudget(planner=3)
    with pytest.raises(InputError, match=r"Counting\(\)"):
        PickBudget(planner=type("Counting", (), {"plan": None}))


def test_a_column_is_in_the_table_the_csv_and_the_page(cell, plain, tmp_path) -> None:
    columns = {
        "height": lambda verdict: round(float(verdict.pick.pose.translation[2]), 3),
        "none": lambda verdict: None,
    }
    report = plain.with_columns(columns)
    height = str(columns["height"](report.verdicts[0]))
    assert all(height in text for text in (str(report), report.to_markdown()))
    rows = list(csv.DictReader(io.StringIO(report.to_csv())))
    assert [(row["height"], row["none"]) for row in rows] == [(str(columns["height"](v)), "") for v in report.verdicts]
    assert len(report.rows()[0]) == len(plain.rows()[0]) + 2
    report.save(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert ">height</th>" in page
    assert height in page
    assert report.to_json() == plain.to_json()


def test_rows_that_could_not_be_read_have_empty_cells(plain) -> None:
    problem = pp.picks.PickProblem("broken", "no pose", 7)
    report = replace(plain, problems=(problem,)).with_columns({"own": lambda verdict: 1})
    assert [row[-1] for row in report.rows()] == ["1", "1", ""]
    assert report.to_csv().splitlines()[-1].endswith(",")


@pytest.mark.parametrize("columns", [{"reason": lambda verdict: 1}, {"own": 3}])
def test_a_column_without_function_or_with_a_name_in_use_is_refused(plain, columns: dict) -> None:
    with pytest.raises(InputError, match=r"'(reason|own)' of a column"):
        plain.with_columns(columns)
