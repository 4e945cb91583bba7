"""A robot's own fingers: open up to the grasp, on the object from there until it is let go."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError, UnknownNameError
from pinproof.picks import Stage

DOWN = (np.pi, 0, 0)
OPEN, GRIP = 0.04, 0.0195
"""Of each finger; the cube is 40 mm wide, so they stand 0.5 mm in it, as rubber would."""

FINGERS = ("panda_leftfinger", "panda_rightfinger")
QUICK = pp.picks.PickBudget(remedies=0)
PICK = pp.Pick(
    "cube",
    pp.pose((0.5, 0.1, 0.02), DOWN),
    carried="cube",
    place=pp.picks.PlaceTarget(pp.pose((0.45, -0.25, 0.02), DOWN)),
)


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return pp.load_robot("panda").arm(held={"panda_finger_joint1": OPEN})


def judge(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, grip: float = GRIP) -> pp.picks.PickVerdict:
    table = pp.Obstacle("table", pp.Box(1.5, 1.3, 0.04), pp.pose((0.4, 0, -0.025)))
    cube = pp.Obstacle("cube", pp.Box(0.04, 0.04, 0.04), pp.pose((0.5, 0.1, 0.0155)))
    scene = pp.Scene([table, cube, *obstacles], allowed=[("panda_link0", "table")])
    shared = pp.Picks((pick,), held={"panda_finger_joint1": OPEN}, grip={"panda_finger_joint1": grip}, margin=0.002)
    (verdict,) = pp.validate_picks(arm, scene, shared, budget=QUICK).verdicts
    return verdict


@pytest.fixture(scope="module")
def good(arm) -> pp.picks.PickVerdict:
    verdict = judge(arm, PICK)
    assert verdict.ok, verdict.reason
    return verdict


def test_each_motion_states_its_finger_positions(arm, good) -> None:
    def gap(motion: pp.picks.PickMotion) -> float:
        there = arm.with_held(motion.held)
        left, right = (there.frame_placement(good.q_grasp, link).translation for link in FINGERS)
        return float(np.linalg.norm(left - right))

    found = {motion.name: gap(motion) for motion in good.motions}
    open_hand, closed = 2 * OPEN, 2 * GRIP
    assert found == pytest.approx(
        {
            "transit": open_hand,
            "approach": open_hand,
            "retreat": closed,
            "transfer": closed,
            "place": closed,
            "leave": open_hand,
        }
    )


def test_each_motion_is_proven_with_its_finger_positions(arm, good) -> None:
    for motion in good.motions:
        there = arm.with_held(motion.held)
        certificate = motion.certificate
        assert certificate.free
        assert certificate.matches(motion.trajectory, there, motion.scene, motion.attached)
        allowed = [*(parting.bodies for parting in certificate.partings), *((each, "cube") for each in FINGERS)]
        checker = pp.CollisionChecker(there, motion.scene, attached=motion.attached, allowed=allowed)
        assert all(checker.is_free_batch(motion.trajectory(np.linspace(0.0, motion.trajectory.duration, 120))))
    transit, retreat = good.motions[0], good.motions[2]
    assert not transit.certificate.matches(transit.trajectory, arm.with_held(retreat.held), transit.scene)


def test_open_fingers_meet_a_wall_that_gripping_ones_do_not(arm) -> None:
    # Between the 30 mm of the closed finger's outer face and the 50 mm of the open one's.
    beside = pp.Obstacle("wall", pp.Box(0.3, 0.005, 0.05), pp.pose((0.5, 0.1 + 0.052, 0.025)))
    verdict = judge(arm, replace(PICK, place=None), beside)
    assert verdict.failed is Stage.GRASP
    assert "wall" in verdict.reason
    assert "finger" in verdict.reason
    closed = arm.with_held({"panda_finger_joint1": GRIP})
    checker = pp.CollisionChecker(closed, pp.Scene([beside]))
    target = closed.root_from_base.actInv(PICK.pose)
    assert any(checker.is_free(pp.Clik().solve(closed, target, rng=seed).q) for seed in range(8))


def test_without_an_allowed_pair_the_closed_fingers_collide_with_the_part(good, arm) -> None:
    retreat = good.motions[2]
    checker = pp.CollisionChecker(arm.with_held(retreat.held), retreat.scene, attached=retreat.attached)
    touching = {name for contact in checker.check(retreat.trajectory.end).contacts for name in contact.bodies}
    assert touching == {*FINGERS, "cube"}


@pytest.mark.parametrize(
    ("grip", "expected"),
    [
        ({"panda_finger_joint1": 0.05}, "0.05 (grip) is outside its limits [0, 0.04]"),
        ({"panda_finger_joint2": 0.02}, "unknown joint 'panda_finger_joint2'"),
        ({"panda_joint3": 0.02}, "unknown joint 'panda_joint3'"),
    ],
)
def test_fingers_that_cannot_grip_are_refused(arm, grip, expected: str) -> None:
    with pytest.raises((InputError, UnknownNameError)) as refused:
        pp.validate_picks(arm, pp.Scene(), pp.Picks((PICK,), grip=grip))
    assert expected in str(refused.value)
    assert "panda_finger_joint1" in str(refused.value)  # the only valid choice


def test_a_joint_that_would_move_the_tcp_cannot_grip() -> None:
    arm = pp.load_robot("panda").arm(base="panda_link2")
    with pytest.raises(InputError, match="the tcp 'panda_hand_tcp' is moved by panda_joint1"):
        pp.validate_picks(arm, pp.Scene(), pp.Picks((PICK,), grip={"panda_joint1": 0.5}))


def test_a_checker_derived_with_other_held_joints_equals_a_new_one(arm) -> None:
    closed = {"panda_finger_joint1": GRIP}
    derived = pp.CollisionChecker(arm, pp.Scene()).with_held(closed)
    made = pp.CollisionChecker(pp.load_robot("panda").arm(held=closed), pp.Scene())
    assert derived.fingerprint() == made.fingerprint()
    assert derived.arm.held == {"panda_finger_joint1": GRIP, "panda_finger_joint2": GRIP}
    assert derived.clearance(arm.home) == made.clearance(arm.home)
    assert derived.with_held(closed) is derived


def test_a_set_up_carries_the_grip_to_other_processes(arm) -> None:
    scene = pp.Scene([pp.Obstacle("cube", pp.Box(0.04, 0.04, 0.04), pp.pose((0.5, 0.1, 0.0155)))])
    shared = pp.Picks((), held={"panda_finger_joint1": OPEN}, grip={"panda_finger_joint1": GRIP})
    setup = pp.picks.PickSetup.make(arm, scene, shared, home=None, rng=0, budget=QUICK)
    pick = replace(PICK, place=None)
    one, other = (each.judge(0, pick) for each in (setup, pickle.loads(pickle.dumps(setup))))
    assert [motion.held for motion in one.motions] == [motion.held for motion in other.motions]
    assert one.motions[2].held["panda_finger_joint2"] == GRIP
    assert one.motions[2].certificate.setup == other.motions[2].certificate.setup
    assert setup.identity()["hand"] != replace(setup, shared=replace(shared, grip={})).identity()["hand"]
