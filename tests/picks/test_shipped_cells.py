"""The cells of the package: good picks pass an independent check, the others fail at the expected stage."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import pinproof as pp
from pinproof.picks import Stage

from .conftest import recheck

EXPECTED = {
    "ur5": {"bolt_3": Stage.GRASP, "bolt_4": Stage.GRASP, "bolt_6": Stage.REACH},
    "generic_6dof": {"pin_3": Stage.GRASP, "pin_4": Stage.REACH},
    "panda": {"cube_5": Stage.REACH},
}


@pytest.mark.parametrize("name", EXPECTED)
def test_each_pick_fails_at_the_expected_stage(reports, name: str) -> None:
    report = reports[name]
    assert {v.pick.name: v.failed for v in report.verdicts if not v.ok} == EXPECTED[name]
    assert len(report.good) == len(report.verdicts) - len(EXPECTED[name]) >= 2
    assert not report.ok


@pytest.mark.parametrize("name", EXPECTED)
def test_good_verdicts_pass_an_independent_check(reports, arms, cells, name: str) -> None:
    for verdict in reports[name].good:
        recheck(verdict, arms[name], *cells[name])


def test_a_failure_names_the_bodies_in_collision(reports) -> None:
    reasons = {verdict.pick.name: verdict.reason for verdict in reports["ur5"].verdicts}
    assert "picker penetrates bin_far" in reasons["bolt_3"]
    assert "picker penetrates bin_right" in reasons["bolt_4"]
    assert "picker penetrates bin_near" in reasons["bolt_4"]
    assert re.match(r"out of reach: .* [1-9][\d.]* mm", reasons["bolt_6"])


def test_the_same_seed_gives_the_same_bytes(arms, cells, reports) -> None:
    scene, picks = cells["ur5"]
    again = pp.validate_picks(arms["ur5"], scene, picks, rng=0)
    assert again.to_dict() == reports["ur5"].to_dict()
    for one, other in zip(again.good, reports["ur5"].good, strict=True):
        assert one.trajectory.q.tobytes() == other.trajectory.q.tobytes()
        assert one.trajectory.times.tobytes() == other.trajectory.times.tobytes()
        assert one.certificate.curve == other.certificate.curve


def test_a_generator_gives_the_same_report_as_its_seed(arms, cells, reports) -> None:
    scene, picks = cells["generic_6dof"]
    report = pp.validate_picks(arms["generic_6dof"], scene, picks, rng=np.random.default_rng(0))
    assert report.to_dict() == reports["generic_6dof"].to_dict()


@pytest.mark.parametrize("rng", [-1, 0.5, "seed"])
def test_an_invalid_seed_is_refused(arms, cells, rng) -> None:
    with pytest.raises(pp.InputError, match="rng must be"):
        pp.validate_picks(arms["generic_6dof"], *cells["generic_6dof"], rng=rng)


def test_a_verdict_does_not_depend_on_other_picks(arms, cells, reports) -> None:
    scene, picks = cells["generic_6dof"]
    alone = pp.Picks(picks.picks[:1], tip=picks.tip, margin=picks.margin)
    (verdict,) = pp.validate_picks(arms["generic_6dof"], scene, alone).verdicts
    assert verdict.certificate.curve == reports["generic_6dof"].verdicts[0].certificate.curve


def test_the_report_as_values(reports) -> None:
    report = reports["ur5"]
    data = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert data["summary"] == "4 of 7 picks good; failed: 2 at grasp, 1 at reach"
    assert data["ok"] is False
    assert data["notes"] == list(report.notes)
    assert any("empty gripper" in note for note in data["notes"])
    good, bad = data["picks"][0], data["picks"][2]
    assert [stage["stage"] for stage in good["stages"]] == [stage.value for stage in Stage]
    assert good["clearance_proven"] == report.verdicts[0].certificate.clearance
    assert good["pairs_proven"] == report.verdicts[0].certificate.pairs > 100
    assert ["base_link", "table", "allowed by the scene"] in good["excluded_pairs"]
    assert 0 < good["grasp_time"] < good["duration"]
    assert (bad["verdict"], bad["failed_at"], bad["q_grasp"], bad["clearance_proven"]) == (
        "impossible",
        "grasp",
        None,
        None,
    )
    assert [stage["ok"] for stage in bad["stages"]] == [True, True, True, True, False]


def test_the_report_as_markdown(reports) -> None:
    report = reports["ur5"]
    text = report.to_markdown()
    rows = [line for line in text.splitlines() if line.startswith("| bolt_")]
    assert len(rows) == 7
    assert all(row.count("|") == 8 for row in rows)
    assert "no acceleration limit is known" in text
    for note in report.notes:
        assert f"- {note}" in text


def test_a_report_is_saved_in_the_format_of_its_suffix(reports, tmp_path) -> None:
    report = reports["ur5"]
    report.save(tmp_path / "a.json")
    report.save(tmp_path / "a.MD")
    assert json.loads((tmp_path / "a.json").read_text()) == report.to_dict()
    assert (tmp_path / "a.MD").read_text() == report.to_markdown()
    with pytest.raises(pp.InputError, match=r"\.json, \.md, \.csv"):
        report.save(tmp_path / "a.txt")
    with pytest.raises(pp.errors.FileError, match="cannot be written"):
        report.save(tmp_path / "no" / "a.json")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.MD", "a.json"]


def test_a_grasp_cannot_be_written_to_afterwards(reports) -> None:
    with pytest.raises(ValueError, match="read-only"):
        reports["ur5"].good[0].q_grasp[0] = 0.0
