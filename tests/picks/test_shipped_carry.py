"""The cell in which bolts are carried: each pick has the expected status, failed stage and reason."""

from __future__ import annotations

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
    "too_far": (PickStatus.NOT_FOUND, Stage.PLACE, "release is out of reach"),
    "missing": (PickStatus.UNREADABLE, Stage.INPUT, "unknown object 'bolt_9'"),
}


@pytest.fixture(scope="module")
def report(arms, cells) -> pp.PickReport:
    picks = pp.read_picks(robots_folder() / "ur5" / "carry.yaml")
    return pp.validate_picks(arms["ur5"], cells["ur5"][0], picks, budget=pp.picks.PickBudget(remedies=2))


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
    assert report.to_dict()["picks"][3]["remedy"].startswith("shorten the approach from 900 mm to ")
