"""Every stage fails for its own reason, in cells built around three arms so that only that stage can fail."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.model.limits import AT_LIMIT
from pinproof.picks import PickStatus, Stage
from pinproof.picks.input.pick import Member
from pinproof.picks.judging.configurations import turned_inside
from pinproof.picks.judging.grasp import GraspCandidate
from pinproof.picks.judging.lines import Attempt, full_rotations
from pinproof.planning import with_turns
from pinproof.spatial import SE3

from .conftest import DOWN, ROBOTS, judge_in, recheck

BUDGET = pp.picks.PickBudget(remedies=0)
"""Remedies have tests of their own."""

AHEAD = 0.8
"""Radians about the base's axis from home to the pick."""


def turned(pose, angle: float):
    return pp.pose(rpy=(0, 0, angle)) * pose


def grasp(arm: pp.Arm):
    """Where home holds the tcp, turned about the base's axis."""
    return turned(arm.root_from_base * arm.forward_kinematics(arm.home), AHEAD)


STAGES = [stage for stage in Stage if stage not in (Stage.CHECK, Stage.HOLD)]
"""All but those of the checks of a user and of the forces of a grip, which are not judged without any."""


def judge_one(
    arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, margin: float = 0.002, budget: pp.picks.PickBudget = BUDGET
) -> pp.picks.PickVerdict:
    verdict = judge_in(arm, pp.Scene(obstacles), pick, margin=margin, budget=budget)
    if not verdict.ok:
        assert verdict.status in (PickStatus.NOT_FOUND, PickStatus.IMPOSSIBLE)
        assert bool(verdict.refuted) == (verdict.status is PickStatus.IMPOSSIBLE)
        assert verdict.motions == ()
        assert [stage.ok for stage in verdict.stages] == [True] * (len(verdict.stages) - 1) + [False]
        assert (verdict.q_grasp, verdict.trajectory, verdict.certificate, verdict.grasp_time) == (None,) * 4
    assert [stage.stage for stage in verdict.stages] == STAGES[: len(verdict.stages)]
    return verdict


def ball(name: str, xyz, radius: float = 0.02) -> pp.Obstacle:
    return pp.Obstacle(name, pp.Sphere(radius), pp.pose(xyz))


@pytest.fixture(params=ROBOTS)
def arm(request, arms) -> pp.Arm:
    return arms[request.param]


@pytest.fixture
def pick(arm) -> pp.Pick:
    return pp.Pick("part", grasp(arm), approach=0.05, retreat=0.05)


def test_good(arm, pick) -> None:
    verdict = judge_one(arm, pick)
    assert verdict.ok
    assert verdict.reason.startswith("collision-free")
    recheck(verdict, arm, pp.Scene(), pp.Picks((pick,), margin=0.002))
    # A grasp at home needs no transit
    here = pp.Pick("here", arm.root_from_base * arm.forward_kinematics(arm.home), approach=0.0, retreat=0.05)
    verdict = judge_one(arm, here)
    assert verdict.ok
    assert 0 <= verdict.grasp_time < verdict.trajectory.duration


def test_reach_and_limits(arm, pick) -> None:
    verdict = judge_one(arm, pp.Pick("far", pp.pose((3, 0, 0.5))))
    assert verdict.failed is Stage.REACH
    assert verdict.configurations == 0
    # No arm of these is longer than 1.3 m: the miss is measured, and it is honest.
    assert 1700 < float(verdict.reason.split(" mm")[0].split()[-1]) < 3000
    names, home = arm.joint_names, arm.home
    near = {name: (float(q) - 0.1, float(q) + 0.1) for name, q in zip(names, home, strict=True)}
    verdict = judge_one(arm.with_limits(arm.limits.replace(names, near)), pick)
    assert verdict.failed is Stage.LIMITS
    assert verdict.reason.startswith("reachable only outside the joint limits: ")
    assert " is outside [" in verdict.reason
    assert any(name in verdict.reason for name in names)


def test_grasp(arm, pick) -> None:
    verdict = judge_one(arm, pick, ball("stone", pick.pose.translation, 0.05))
    assert verdict.failed is Stage.GRASP
    assert "stone" in verdict.reason
    assert any(link in verdict.reason for link in arm.robot.urdf.links)
    assert verdict.configurations > 0


@pytest.mark.slow
def test_approach_out_of_reach_or_retreat_blocked(arm, pick) -> None:
    verdict = judge_one(arm, replace(pick, approach=4.0))
    assert verdict.failed is Stage.APPROACH
    assert verdict.reason.startswith("4000 mm path, planned outwards from the grasp, stops at ")
    aside = pick.pose.rotation[:, 0]
    post = ball("post", pick.pose.translation + 0.16 * aside, 0.05)
    assert judge_one(arm, replace(pick, retreat_direction=tuple(-aside)), post).ok
    verdict = judge_one(arm, replace(pick, retreat=0.16, retreat_direction=tuple(aside)), post)
    assert verdict.failed is Stage.RETREAT
    assert "post" in verdict.reason


def test_approach_blocked(arms) -> None:
    # The UR5's second wrist link lies on the tool's axis, so a ball behind it meets every configuration that backs off.
    arm = arms["ur5"]
    target = pp.pose((0.45, 0.1, 0.2), DOWN)
    above = ball("lamp", (0.45, 0.1, 0.2 + 0.0823 + 0.11), 0.015)
    free = judge_one(arm, pp.Pick("part", target, approach=0.02, retreat=0.02), above)
    assert free.ok
    verdict = judge_one(arm, pp.Pick("part", target, approach=0.1, retreat=0.02), above)
    assert verdict.failed is Stage.APPROACH
    assert "lamp" in verdict.reason
    share = int(re.search(r"stops at (\d+) % of the line: ", verdict.reason)[1])
    figures = verdict.stages[-1].figures
    assert figures["distance"] == 0.1
    assert 0.02 < figures["possible"] < 0.1
    assert int(100 * figures["possible"] / 0.1) == share


def test_transit_walled_in(arm) -> None:
    # A wall halfway between home and pick, from beside the base's axis outwards; only the base may turn far, so no way
    # leads behind it or over it.
    home = arm.root_from_base * arm.forward_kinematics(arm.home)
    between = float(np.arctan2(home.translation[1], home.translation[0])) + 0.9
    wall = pp.Obstacle("wall", pp.Box(2.0, 0.01, 4.0), turned(pp.pose((1.2, 0, 0)), between))
    far = np.where(np.arange(arm.dof) == 0, 2.2, 0.4)
    ranges = np.transpose([arm.limits.clip(arm.home - far), arm.limits.clip(arm.home + far)])
    tight = arm.with_limits(arm.limits.replace(arm.joint_names, dict(zip(arm.joint_names, ranges, strict=True))))
    small = pp.Pick("part", turned(home, 1.8), approach=0.02, retreat=0.02)
    assert judge_one(tight, small).ok
    verdict = judge_one(tight, small, wall, budget=pp.picks.PickBudget(nodes=60, quick_nodes=20))
    assert verdict.status is PickStatus.NOT_FOUND
    assert verdict.failed is Stage.TRANSIT
    assert verdict.reason.startswith("from home: no path within ")


def test_without_approach_and_retreat_the_motion_ends_at_the_grasp(arm, pick) -> None:
    still = replace(pick, approach=0.0, retreat=0.0)
    verdict = judge_one(arm, still)
    assert verdict.grasp_time == verdict.trajectory.duration
    assert [s.message for s in verdict.stages if s.stage in (Stage.APPROACH, Stage.RETREAT)] == ["none requested"] * 2
    recheck(verdict, arm, pp.Scene(), pp.Picks((still,), margin=0.002))


def test_the_tool_is_checked_and_its_tip_is_what_reaches(arms) -> None:
    arm = arms["generic_6dof"]
    rod = pp.Obstacle("rod", pp.Cylinder(radius=0.01, length=0.1), pp.pose((0, 0, 0.05)))
    pick = pp.Pick("part", grasp(arm) * pp.pose((0, 0, 0.105)), approach=0.05, retreat=0.05)
    picks = pp.Picks((pick,), tip=pp.pose((0, 0, 0.105)), tool=(rod,), margin=0.002)
    (verdict,) = pp.validate_picks(arm, pp.Scene(), picks).verdicts
    recheck(verdict, arm, pp.Scene(), picks)
    under = ball("peg", pick.pose.translation, 0.02)
    (verdict,) = pp.validate_picks(arm, pp.Scene([under]), picks).verdicts
    assert verdict.failed is Stage.GRASP
    assert verdict.reason.startswith("rod penetrates peg")


def test_poses_are_in_the_root_frame_whatever_the_base() -> None:
    assert pp.load_robot("generic_6dof").arm(base="base_link").root_from_base.isIdentity()
    raised = pp.load_robot("panda").arm(base="panda_link0")
    pick = pp.Pick("part", grasp(raised), approach=0.02, retreat=0.02)
    recheck(judge_one(raised, pick), raised, pp.Scene(), pp.Picks((pick,), margin=0.002))


def test_the_margin_decides(arms) -> None:
    arm = arms["generic_6dof"]
    pick = pp.Pick("part", grasp(arm), approach=0.02, retreat=0.02)
    # The last link's body ends 30 mm before the tool frame: the ball is 20 mm from it.
    near = ball("near", pick.pose.translation + 0.01 * pick.pose.rotation[:, 2])
    assert judge_one(arm, pick, near, margin=0.0195).ok
    verdict = judge_one(arm, pick, near, margin=0.0205)
    assert verdict.failed is Stage.GRASP
    assert re.search(r"^link_6 is 20\.\d mm from near, less than the margin", verdict.reason)


# -- joint values beyond a limit by less than 1e-9 count as the limit in every stage ----------------------------------

TURN = 2 * np.pi
FIRST, FOURTH = np.eye(6)[[0, 3]]


def limited(upper: float) -> pp.Arm:
    """A UR5 whose first joint has the limits -pi and ``upper``."""
    return pp.load_robot("ur5").arm(tcp="tool0", limits={"shoulder_pan_joint": (-np.pi, upper)})


@pytest.mark.parametrize(("beyond", "rotations"), [(0.0, 2), (0.5 * AT_LIMIT, 2), (2 * AT_LIMIT, 1)])
def test_full_rotations_that_end_at_a_limit_are_found(beyond, rotations):
    q = np.array([-1.0, -1.2, 1.0, 0.7, 1.1, 0.5])
    arm = limited(q[0] + TURN - beyond)
    attempt = Attempt(GraspCandidate(q, Member(SE3.Identity()), 0.1, 1.0), q)
    shifts = full_rotations(arm, arm.home, attempt)
    assert len({round(float(shift[0]), 6) for shift in shifts}) == rotations
    goals, _ = with_turns(arm, arm.home, q[None])
    assert len({round(float(goal[0]), 6) for goal in goals}) == rotations
    assert arm.limits.inside(goals).all()
    assert (goals[:, 0] <= arm.limits.upper[0]).all()
    found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q))
    own = found.q[np.abs(np.sin((found.q - q) / 2)).max(axis=1) < 1e-8]
    assert len({round(float(each[0]), 6) for each in own}) == rotations
    assert (found.q <= arm.limits.upper).all()


def test_poses_at_a_limit_are_not_called_outside():
    arm, home = limited(2.0), np.array([2.0, -1.2, 1.0, 0.7, 1.1, 0.5])
    q = home + 0.5 * AT_LIMIT * FIRST
    assert turned_inside(arm, q)[0] == 2.0
    assert turned_inside(arm, q - TURN * FIRST)[0] == 2.0
    assert turned_inside(arm, q + AT_LIMIT * FIRST)[0] > 2.0
    # The home of a screening may be at a limit
    poses = [pp.pose((0.4, y, 0.3), DOWN) for y in (-0.2, 0.0, 0.2)]
    at_limit, beyond = (pp.screen_picks(arm, pp.Scene(), poses, home=home + by * FIRST) for by in (0.0, 0.5 * AT_LIMIT))
    assert np.array_equal(at_limit.q, beyond.q, equal_nan=True)


def test_free_joints_of_the_closed_form_keep_a_reference_at_the_limit():
    """With wrist joint 2 at 0, only the difference of joints 4 and 6 is determined by the target."""
    arm = pp.load_robot("generic_6dof").arm()
    lower, upper = arm.limits.lower.copy(), arm.limits.upper.copy()
    upper[3] = 0.7
    arm = arm.with_limits(pp.JointLimits(lower, upper, arm.limits.velocity))
    q = np.array([0.3, -0.8, 0.9, 0.7, 0.0, 0.2])
    target = arm.forward_kinematics(q)
    found = [pp.AnalyticIk().solve_all(arm, target, q + by * FOURTH) for by in (0.0, 0.5 * AT_LIMIT)]
    assert found[0].ok
    assert np.array_equal(found[0].branches, found[1].branches)
    batches = [pp.AnalyticIk().solve_all_batch(arm, [target], q + by * FOURTH) for by in (0.0, 0.5 * AT_LIMIT)]
    assert np.array_equal(batches[0].q, batches[1].q, equal_nan=True)


def test_continuous_joints_without_limits_are_not_turned():
    arm = pp.load_robot("kinova").arm()
    assert np.isinf(arm.limits.lower).any()
    q = np.where(np.isinf(arm.limits.lower), 20.0, arm.home)
    with np.errstate(all="raise"):
        np.testing.assert_array_equal(turned_inside(arm, q), q)
    # Full rotations bring a joint inside its limits if possible; otherwise the value is not changed
    arm = pp.load_robot("generic_6dof").arm()
    q = arm.home + 2 * np.pi * np.array([1, 0, 0, 0, -1, 0])
    np.testing.assert_allclose(turned_inside(arm, q), arm.home, atol=1e-12)
    outside = arm.home + np.eye(6)[0] * 3.0  # 3.0 is outside +-2.967, and so is 3.0 - 2 pi
    np.testing.assert_array_equal(turned_inside(arm, outside), outside)
