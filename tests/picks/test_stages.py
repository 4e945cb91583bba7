"""Every stage fails for its own reason, in cells built around three arms so that only that stage can fail."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.picks import PickStatus, Stage

from .conftest import recheck

ROBOTS = ("ur5", "generic_6dof", "panda")
QUICK = pp.picks.PickBudget(remedies=0)
"""Remedies have tests of their own."""

AHEAD = 0.8
"""Radians about the base's axis from home to the pick."""


def turned(pose, angle: float):
    return pp.pose(rpy=(0, 0, angle)) * pose


def grasp(arm: pp.Arm):
    """Where home holds the tcp, turned about the base's axis."""
    return turned(arm.root_from_base * arm.forward_kinematics(arm.home), AHEAD)


def judge_one(
    arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, margin: float = 0.002, budget: pp.picks.PickBudget = QUICK
) -> pp.picks.PickVerdict:
    (verdict,) = pp.validate_picks(arm, pp.Scene(obstacles), pp.Picks((pick,), margin=margin), budget=budget).verdicts
    if not verdict.ok:
        assert verdict.status in (PickStatus.NOT_FOUND, PickStatus.IMPOSSIBLE)
        assert bool(verdict.refuted) == (verdict.status is PickStatus.IMPOSSIBLE)
        assert verdict.motions == ()
        assert [stage.ok for stage in verdict.stages] == [True] * (len(verdict.stages) - 1) + [False]
        assert (verdict.q_grasp, verdict.trajectory, verdict.certificate, verdict.grasp_time) == (None,) * 4
    assert [stage.stage for stage in verdict.stages] == list(Stage)[: len(verdict.stages)]
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


def test_reach(arm) -> None:
    verdict = judge_one(arm, pp.Pick("far", pp.pose((3, 0, 0.5))))
    assert verdict.failed is Stage.REACH
    assert verdict.configurations == 0
    # No arm of these is longer than 1.3 m: the miss is measured, and it is honest.
    assert 1700 < float(verdict.reason.split(" mm")[0].split()[-1]) < 3000


def test_limits(arm, pick) -> None:
    names, home = arm.joint_names, arm.home
    near = {name: (float(q) - 0.1, float(q) + 0.1) for name, q in zip(names, home, strict=True)}
    verdict = judge_one(arm.with_limits(arm.limits.replace(names, near)), pick)
    assert verdict.failed is Stage.LIMITS
    assert verdict.reason.startswith("reachable only outside the joint limits: ")
    assert " is outside [" in verdict.reason
    assert any(name in verdict.reason for name in names)


def test_the_only_joint_outside_its_limits_is_named(arms) -> None:
    # Turning the base is the only path to the other side when no other joint may leave its branch.
    arm = arms["generic_6dof"]
    around = {name: (float(q) - 0.3, float(q) + 0.3) for name, q in zip(arm.joint_names, arm.home, strict=True)}
    tight = arm.with_limits(arm.limits.replace(arm.joint_names, around))
    verdict = judge_one(tight, pp.Pick("part", grasp(arm), approach=0, retreat=0))
    assert verdict.failed is Stage.LIMITS
    assert "joint_1 = 0.8 is outside [-0.3, 0.3]" in verdict.reason


def test_grasp(arm, pick) -> None:
    verdict = judge_one(arm, pick, ball("stone", pick.pose.translation, 0.05))
    assert verdict.failed is Stage.GRASP
    assert "stone" in verdict.reason
    assert any(link in verdict.reason for link in arm.robot.urdf.links)
    assert verdict.configurations > 0


@pytest.mark.slow
def test_approach_out_of_reach(arm, pick) -> None:
    verdict = judge_one(arm, replace(pick, approach=4.0))
    assert verdict.failed is Stage.APPROACH
    assert verdict.reason.startswith("4000 mm path, planned outwards from the grasp, stops at ")


def test_approach_blocked(arms) -> None:
    # The UR5's second wrist link lies on the tool's axis, so a ball behind it meets every configuration that backs off.
    arm = arms["ur5"]
    target = pp.pose((0.45, 0.1, 0.2), (np.pi, 0, 0))
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


@pytest.mark.slow
def test_retreat_blocked(arm, pick) -> None:
    aside = pick.pose.rotation[:, 0]
    post = ball("post", pick.pose.translation + 0.16 * aside, 0.05)
    assert judge_one(arm, replace(pick, retreat_direction=tuple(-aside)), post).ok
    verdict = judge_one(arm, replace(pick, retreat=0.16, retreat_direction=tuple(aside)), post)
    assert verdict.failed is Stage.RETREAT
    assert "post" in verdict.reason


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


def test_a_grasp_at_home_needs_no_transit(arm) -> None:
    here = pp.Pick("here", arm.root_from_base * arm.forward_kinematics(arm.home), approach=0.0, retreat=0.05)
    verdict = judge_one(arm, here)
    assert verdict.ok
    assert 0 <= verdict.grasp_time < verdict.trajectory.duration


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


def test_poses_are_in_the_root_frame_whatever_the_base(arms) -> None:
    arm = pp.load_robot("generic_6dof").arm(base="base_link")
    assert arm.root_from_base.isIdentity()
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
