"""The three worked examples: each pick has the expected status, failed stage and reason."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.motion import JointPath
from pinproof.picks import PickStatus, Stage

GOOD = (PickStatus.GOOD, None, "")
IMPOSSIBLE, NOT_FOUND = PickStatus.IMPOSSIBLE, PickStatus.NOT_FOUND

pytestmark = pytest.mark.slow

EXPECTED = {
    "ur5/plate_picks.yaml": {
        **{f"bolts[{i},{j}]": GOOD for i in range(4) for j in range(3)},
        "bolts[0,2]": (NOT_FOUND, Stage.GRASP, "picker penetrates clamp_jaw"),
        "unturned": (IMPOSSIBLE, Stage.GRASP, "camera penetrates stop"),
        "moved": GOOD,
    },
    "panda/bin_picks.yaml": {
        "standing": GOOD,
        "lying": GOOD,
        "round": GOOD,
        "leaning": GOOD,
        "on_the_wall": (NOT_FOUND, Stage.RETREAT, "on_the_wall is near bin_far (0.2 mm apart)"),
        "cornered": (IMPOSSIBLE, Stage.GRASP, "panda_hand penetrates bin_far"),
        "fallen": (IMPOSSIBLE, Stage.GRASP, "panda_hand penetrates guard"),
        "far_off": (IMPOSSIBLE, Stage.REACH, "out of reach"),
        "onto_the_crate": (IMPOSSIBLE, Stage.PLACE, "penetrates crate"),
    },
    "generic_6dof/machine_picks.yaml": {
        "unload": GOOD,
        **{f"blank[{i},0]": GOOD for i in range(3)},
        "sideways": (IMPOSSIBLE, Stage.RETREAT, "turned is not proven to leave chuck"),
        "from_afar": (IMPOSSIBLE, Stage.APPROACH, "1200 mm path, planned outwards from the grasp, stops at "),
        "shadowed": (IMPOSSIBLE, Stage.GRASP, "tube penetrates post_right"),
        "remote": (IMPOSSIBLE, Stage.REACH, "out of reach"),
        "near_by": (IMPOSSIBLE, Stage.LIMITS, "joint_3"),
        "gauged": (NOT_FOUND, Stage.TRANSIT, "no path within"),
        "onto_a_blank": (NOT_FOUND, Stage.PLACE, "turned penetrates blank_1"),
    },
}


@dataclass(frozen=True)
class Example:
    arm: pp.Arm
    scene: pp.Scene
    picks: pp.Picks
    report: pp.picks.PickReport

    def verdict(self, name: str) -> pp.picks.PickVerdict:
        return next(verdict for verdict in self.report.verdicts if verdict.pick.name == name)


@pytest.fixture(scope="module")
def examples() -> dict[str, Example]:
    found = {}
    for name in EXPECTED:
        picks = pp.read_picks(robots_folder() / name)
        assert picks.problems == ()
        arm = pp.load_robot(picks.robot).arm(tcp=picks.tcp, held=picks.held)
        scene = pp.Scene.load(picks.scene)
        budget = pp.picks.PickBudget(remedies=1)
        found[name] = Example(arm, scene, picks, pp.validate_picks(arm, scene, picks, budget=budget))
    return found


@pytest.mark.parametrize("name", EXPECTED)
def test_each_pick_has_the_expected_verdict(examples, name: str) -> None:
    expected, report = EXPECTED[name], examples[name].report
    assert {v.pick.name: (v.status, v.failed) for v in report.verdicts} == {k: e[:2] for k, e in expected.items()}
    reasons = {v.pick.name: v.reason for v in report.verdicts if not v.ok}
    assert {k: expected[k][2] for k, why in reasons.items() if expected[k][2] not in why} == {}


@pytest.mark.parametrize("name", EXPECTED)
def test_impossible_picks_are_refuted_for_every_branch(examples, name: str) -> None:
    for verdict in examples[name].report.verdicts:
        assert bool(verdict.refuted) == (verdict.status is IMPOSSIBLE)


@pytest.mark.parametrize("name", EXPECTED)
def test_every_motion_is_free_in_dense_samples(examples, name: str) -> None:
    """Dense samples, with a new checker for the scene and the held part of each motion."""
    example = examples[name]
    hand = {*(thing.name for thing in example.picks.open_tool), "panda_leftfinger", "panda_rightfinger"}
    for verdict in example.report.good:
        assert verdict.motions[0].scene is example.scene
        q = verdict.motions[0].trajectory.start
        for motion in verdict.motions:
            arm, proof = example.arm.with_held(motion.held), motion.certificate
            assert proof.free
            assert proof.matches(motion.trajectory, arm, motion.scene, motion.attached)
            assert proof.clearance > example.picks.margin
            np.testing.assert_allclose(motion.trajectory.start, q, atol=1e-12)
            q = motion.trajectory.end
            meant = {frozenset((verdict.pick.carried, each)) for each in hand}
            meant |= {frozenset(parting.bodies) for parting in proof.partings}
            checker = pp.CollisionChecker(arm, motion.scene, attached=motion.attached)
            for at in motion.trajectory(np.linspace(0.0, motion.trajectory.duration, 40)):
                assert {frozenset(contact.bodies) for contact in checker.check(at).contacts} <= meant


def test_the_guard_blocks_the_straight_path_from_tray_to_bin(examples) -> None:
    example = examples["panda/bin_picks.yaml"]
    checker = pp.CollisionChecker(example.arm, example.scene)
    for verdict in example.report.good:
        transit = verdict.motions[0].trajectory
        straight = pp.certify(JointPath([transit.start, transit.end], example.arm.joint_names), checker)
        assert straight.status is pp.CertificateStatus.COLLIDING
        assert "guard" in straight.first_contact.bodies
        over = [example.arm.forward_kinematics(q).translation for q in transit(np.linspace(0, transit.duration, 300))]
        crossing = next(at for at in over if at[0] > 0.35)
        assert crossing[2] > 0.30 or abs(crossing[1]) > 0.45


def test_the_robots_own_fingers_close_on_the_part_and_open_again(examples) -> None:
    verdict = examples["panda/bin_picks.yaml"].verdict("round")
    assert [(motion.name, motion.held["panda_finger_joint1"]) for motion in verdict.motions] == [
        ("transit", 0.04), ("approach", 0.04), ("retreat", 0.02), ("transfer", 0.02), ("place", 0.02), ("leave", 0.04),
    ]  # fmt: skip


def test_the_long_tool_goes_in_and_out_through_the_door_straight(examples) -> None:
    example = examples["generic_6dof/machine_picks.yaml"]
    verdict = example.verdict("unload")
    tips = {}
    for motion in verdict.motions:
        q = motion.trajectory(np.linspace(0.0, motion.trajectory.duration, 50))
        placed = [example.arm.root_from_base * example.arm.forward_kinematics(each) * example.picks.tip for each in q]
        tips[motion.name] = np.array([at.translation for at in placed])
    for name in ("approach", "retreat"):
        np.testing.assert_allclose(tips[name][:, 1:], [[-0.20, 0.50]] * 50, atol=1.01e-3)  # along the spindle
        assert example.picks.straight * 0.2 - 1e-3 <= np.ptp(tips[name][:, 0]) <= 0.2 + 1e-3
    assert tips["retreat"][0, 0] == pytest.approx(1.075, abs=1e-5)
    assert tips["place"][-1] == pytest.approx([0.14, 0.33, 0.12], abs=1e-5)
    assert max(np.linalg.norm(thing.pose.translation) for thing in example.picks.tool) < 0.5


def test_picks_of_the_plate_are_good_with_a_rotated_camera(examples) -> None:
    example = examples["ur5/plate_picks.yaml"]
    assert example.verdict("bolts[3,1]").member.startswith("spun by ")
    assert "mm along the tip's" in example.verdict("moved").member
    report = pp.validate_picks(
        example.arm, example.scene, replace(example.picks, picks=(example.verdict("unturned").pick,))
    )
    assert any(each.text.startswith("turn the pick by ") for each in report.verdicts[0].suggestions)
