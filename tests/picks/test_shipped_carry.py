"""The cell in which bolts are carried: each pick has the expected status, failed stage and reason."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.picks import PickStatus, Stage

pytestmark = pytest.mark.slow

EXPECTED = {
    "over_the_wall": (PickStatus.GOOD, None, ""),
    "any_turn": (PickStatus.GOOD, None, ""),
    "dragged": (PickStatus.IMPOSSIBLE, Stage.RETREAT, "bolt_1 is not proven to leave table"),
    "too_high": (PickStatus.IMPOSSIBLE, Stage.APPROACH, "900 mm path, planned outwards from the grasp, stops at "),
    "in_the_corner": (PickStatus.NOT_FOUND, Stage.GRASP, "picker penetrates bin_"),
    "too_far": (PickStatus.IMPOSSIBLE, Stage.PLACE, "release is out of reach"),
    "missing": (PickStatus.UNREADABLE, Stage.INPUT, "unknown object 'bolt_9'"),
}


PICKS = robots_folder() / "ur5" / "carry.yaml"


@pytest.fixture(scope="module")
def report(arms, cells) -> pp.picks.PickReport:
    budget = pp.picks.PickBudget(remedies=1)
    return pp.validate_picks(arms["ur5"], cells["ur5"][0], pp.read_picks(PICKS), budget=budget)


@pytest.fixture
def judge(arms, cells) -> Callable[..., pp.picks.PickVerdict]:
    """Judge a changed pick."""

    def verdict_of(pick: pp.Pick, remedies: int = 0) -> pp.picks.PickVerdict:
        picks = replace(pp.read_picks(PICKS), picks=(pick,))
        budget = pp.picks.PickBudget(remedies=remedies)
        return pp.validate_picks(arms["ur5"], cells["ur5"][0], picks, budget=budget).verdicts[0]

    return verdict_of


def verdict_of(report: pp.picks.PickReport, name: str) -> pp.picks.PickVerdict:
    return next(verdict for verdict in report.verdicts if verdict.pick.name == name)


def test_each_pick_has_the_expected_verdict(report) -> None:
    found = {v.pick.name: (v.status, v.failed) for v in report.verdicts}
    assert found == {name: expected[:2] for name, expected in EXPECTED.items()}
    for verdict in report.verdicts:
        assert verdict.ok or EXPECTED[verdict.pick.name][2] in verdict.reason


def test_every_motion_of_a_good_pick_is_proven_with_its_part(report, arms) -> None:
    for verdict in report.good:
        assert verdict.certificate is None
        for motion in verdict.motions:
            assert motion.certificate.free
            assert motion.certificate.matches(motion.trajectory, arms["ur5"], motion.scene, motion.attached)


def test_a_carried_pick_has_its_motions_in_order(report) -> None:
    verdict, row = report.verdicts[0], report.to_dict()["picks"][0]
    names = [motion.name for motion in verdict.motions]
    assert names == ["transit", "approach", "retreat", "transfer", "place", "leave"]
    touching = {motion["name"]: motion["backwards"] for motion in row["motions"] if motion["partings"]}
    assert touching == {"retreat": False, "place": True}  # leaves what it stands on; comes to stand
    assert 0 < row["grasp_time"] < verdict.release_time < row["duration"]
    assert row["clearance_proven"] == verdict.clearance


def test_an_approach_too_long_reports_the_longest_that_works(report, judge) -> None:
    verdict = verdict_of(report, "too_high")
    high = verdict.pick
    assert re.search(r"stops at \d+ % of the line: [\d.]+ mm and [\d.]+ rad short", verdict.reason)
    assert verdict.refuted == ("no IK solution within the limits reaches the end of the approach",)
    assert verdict.remedy.startswith("shorten the approach from 900 mm to ")
    assert report.to_dict()["picks"][3]["remedy"] == verdict.remedy
    length = verdict.suggestions[0].apply(high).approach
    assert judge(replace(high, approach=length)).failed is None
    assert judge(replace(high, approach=length + 0.02)).failed is Stage.APPROACH


def test_a_retreat_that_drags_the_part_names_the_support_and_a_free_direction(report, judge) -> None:
    verdict = verdict_of(report, "dragged")
    assert len(verdict.refuted) == 8
    assert all(text.startswith("at the end of the retreat: ") for text in verdict.refuted)
    assert all(re.search(r"bolt_1 (penetrates|is [\d.]+ mm from) table", text) for text in verdict.refuted)
    assert verdict.remedy.startswith("retreat straight up, along +z (base frame)")
    assert judge(verdict.suggestions[0].apply(verdict.pick)).ok


def test_a_place_out_of_reach_reports_the_residual_and_a_reachable_shift(report, judge) -> None:
    far = verdict_of(report, "too_far").pick
    verdict = judge(far, remedies=12)
    short = float(re.search(r"found is ([\d.]+) mm", verdict.reason)[1])
    there = next(each for each in verdict.suggestions if each.text.startswith("move the place")).apply(far)
    assert 200 < short < 1e3 * np.linalg.norm(there.place.pose.translation - far.place.pose.translation) < 2 * short
    assert judge(there).ok
