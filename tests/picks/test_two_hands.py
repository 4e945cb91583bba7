"""Each hand of several that hold one part is judged by the criteria of the grip of a pick, and all carry it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from benchmarks.holding import share_by_pyramids

import pinproof as pp
from pinproof.picks import GripperFingers, SuctionCup, Tool, judge_hands
from pinproof.planning import plan_carry

BOX = pp.Obstacle("box", pp.Box(0.2, 1.2, 0.15))
CUP = Tool(cup=SuctionCup(radius=0.04))


@pytest.fixture(scope="module")
def pair() -> pp.model.JointGroup:
    ur10e = pp.load_robot("ur10e").arm()
    return pp.assemble({"left": (ur10e, pp.pose((0, -0.7, 0))), "right": (ur10e, pp.pose((0, 0.7, 0)))})


def on_top(**places: float) -> dict[str, pin.SE3]:
    """``tcp_from_part`` of hands on the upper side of the box, at these places along it."""
    return {name: pp.pose((0, y, 0.075), (np.pi, 0, 0)).inverse() for name, y in places.items()}


def test_two_cups_on_the_part_hold_it(pair):
    result = judge_hands(pair, BOX, on_top(left=-0.45, right=0.45), {"left": CUP, "right": CUP})
    assert result.ok
    assert result.or_raise() is result
    assert all(grip.cup.contact_area > 0.99 * np.pi * 0.04**2 for grip in result.grips.values())


def test_the_hand_that_is_beyond_the_edge_is_named(pair):
    result = judge_hands(pair, BOX, on_top(left=-0.45, right=0.58), {"left": CUP, "right": CUP})
    assert not result.ok
    assert [name for name, grip in result.grips.items() if not grip.held] == ["right"]
    assert result.message.startswith("right: ")
    with pytest.raises(pp.NoAnswer):
        result.or_raise()


@pytest.mark.parametrize(("thickness", "holds"), [(0.06, True), (0.1, False)])
def test_fingers_of_both_hands_close_on_the_sides_of_a_tray(pair, thickness, holds):
    """A tray that is thicker than the opening overlaps the open fingers."""
    tray = pp.Obstacle("tray", pp.Box(0.25, 0.3, thickness))
    bodies = tuple(
        pp.Obstacle(n, pp.Box(0.03, 0.01, 0.06), pp.pose((0, y, 0.03))) for n, y in (("a", 0.005), ("b", -0.005))
    )
    gripper = Tool(fingers=GripperFingers(bodies, opening=0.08))
    grasps = {"left": pp.pose((0, 0.2, 0), (np.pi / 2, 0, 0)), "right": pp.pose((0, -0.2, 0), (-np.pi / 2, 0, 0))}
    grasps = {name: pose.inverse() for name, pose in grasps.items()}
    result = judge_hands(pair, tray, grasps, dict.fromkeys(grasps, gripper))
    assert {grip.held for grip in result.grips.values()} == {holds}


def test_an_arm_without_a_tool_is_refused(pair):
    with pytest.raises(pp.InputError, match="'right' has no tool"):
        judge_hands(pair, BOX, on_top(left=-0.45, right=0.45), {"left": CUP})
    with pytest.raises(pp.UnknownNameError, match="middle"):
        judge_hands(pair, BOX, on_top(middle=0.0), {"middle": CUP})


def test_the_grip_does_not_depend_on_where_the_part_would_be_in_the_cell(pair):
    # In the frame of the root, the box would be in the bases of both arms
    box = pp.Obstacle("box", pp.Box(0.2, 1.8, 0.15))
    assert judge_hands(pair, box, on_top(left=-0.75, right=0.75), {"left": CUP, "right": CUP}).ok
    moved = pp.Obstacle("box", pp.Box(0.2, 1.8, 0.15), pp.pose((0, 0, 0.01)))  # its pose in the frame of the part
    assert not judge_hands(pair, moved, on_top(left=-0.75), {"left": CUP}).ok


def test_hands_of_no_arm_hold_nothing(pair):
    with pytest.raises(pp.InputError, match="grasps names no arm"):
        judge_hands(pair, BOX, {}, {})
    with pytest.raises(pp.InputError, match=r"tools\['left'\] must be of type Tool"):
        judge_hands(pair, BOX, on_top(left=-0.45), {"left": None})


# -- in motion ---------------------------------------------------------------------------------------------------------

VACUUM = Tool(cup=SuctionCup(radius=0.04, force=150.0, friction=0.5))
LOAD = pp.Payload(5.0, (0.01, 0.12, 0.0))


def carried(pair, *limits) -> pp.Trajectory:
    """A motion of both arms with the box."""
    checker, grasps = pp.CollisionChecker(pair, pp.Scene([])), on_top(left=-0.45, right=0.45)
    ends = [pp.pose((0.6, 0, z), (0, 0, yaw)) for z, yaw in ((0.3, 0.0), (0.55, 0.35))]
    return plan_carry(checker, BOX, grasps, *ends, rate_limits=limits, rng=0).or_raise().trajectory


def loads(pair, motion: pp.Trajectory, count: int) -> np.ndarray:
    """(count, 6) the loads of the box about the tcp of the left arm, by differences of its poses."""
    inertia = LOAD.mass / 12 * np.diag([1.2**2 + 0.15**2, 0.2**2 + 0.15**2, 0.2**2 + 1.2**2])
    tcp_from_part, step, found = on_top(left=-0.45)["left"], 1e-4, []
    for t in np.linspace(2 * step, motion.duration - 2 * step, count):
        poses = [pair.tcp_placements(motion(t + k * step))["left"] * tcp_from_part for k in (-1, 0, 1)]
        centres = [pose.act(np.array(LOAD.center_of_mass)) for pose in poses]
        force = LOAD.mass * ((centres[0] - 2 * centres[1] + centres[2]) / step**2 + [0, 0, 9.81])
        before, after = (pin.log3(a.rotation.T @ b.rotation) / step for a, b in pairwise(poses))
        spin, growth = (before + after) / 2, (after - before) / step
        moment = poses[1].rotation @ (inertia @ growth + np.cross(spin, inertia @ spin))
        tcp = poses[1] * tcp_from_part.inverse()
        moment += np.cross(centres[1] - tcp.translation, force)
        found.append(np.concatenate([tcp.rotation.T @ force, tcp.rotation.T @ moment]))
    return np.array(found)


@pytest.fixture(scope="module")
def fast(pair) -> tuple[pp.Trajectory, pp.picks.HandsResult]:
    """The motion without a limit by the grips, and how the hands carry the box in it."""
    motion, tools = carried(pair), dict.fromkeys(("left", "right"), VACUUM)
    return motion, judge_hands(pair, BOX, on_top(left=-0.45, right=0.45), tools, payload=LOAD, motion=motion)


def test_hands_share_every_load_of_the_motion_as_a_linear_programme_does(pair, fast):
    motion, result = fast
    # The rims of both cups in the tcp of the left arm, as points of one programme
    turns = 2 * np.pi * (np.arange(48) + 0.5) / 48
    rim = 0.04 * np.column_stack([np.cos(turns), np.sin(turns), 0.0 * turns])
    force = VACUUM.cup.force * 0.98
    both = [pp.motion.ContactPatch(rim + np.array([0, y, 0]), (0, 0, 1), force, 0.5, pulls=True) for y in (0.0, -0.9)]
    shares = [share_by_pyramids(both, load, inside=True) for load in loads(pair, motion, 20)]
    assert max(shares) <= 1.01 * result.hold.share
    assert result.hold.share <= 1.06 * max(shares)  # the rim is 16 points, and 20 instants are few
    assert result.ok
    # One hand alone would not carry it
    assert min(share_by_pyramids(both[:1], load, inside=False) for load in loads(pair, motion, 3)) > 1.0


def test_weak_hands_limit_how_fast_the_part_is_carried(pair, fast):
    motion, strong = fast
    force = 0.98 * strong.hold.share * VACUUM.cup.force
    weak, grasps = Tool(cup=SuctionCup(radius=0.04, force=force, friction=0.5)), on_top(left=-0.45, right=0.45)
    slips = judge_hands(pair, BOX, grasps, dict.fromkeys(grasps, weak), payload=LOAD, motion=motion)
    assert not slips.ok
    assert "slips at" in slips.message
    assert slips.hold.share == pytest.approx(1.0 / 0.98, rel=1e-3)
    slow = carried(pair, slips.limits)
    assert slow.duration > motion.duration
    assert slips.limits.peak(slow).holds


def test_what_is_needed_to_judge_the_motion_is_named(pair):
    grasps = on_top(left=-0.45, right=0.45)
    with pytest.raises(pp.InputError, match=r"tools\['right'\] does not state .*cup.force"):
        judge_hands(pair, BOX, grasps, {"left": VACUUM, "right": CUP}, payload=LOAD)
    with pytest.raises(pp.InputError, match="needs the payload"):
        judge_hands(pair, BOX, grasps, dict.fromkeys(grasps, VACUUM), motion=pp.Trajectory(
            [0.0, 1.0], np.zeros((2, 12)), np.zeros((2, 12)), pair.joint_names))  # fmt: skip
    assert judge_hands(pair, BOX, grasps, dict.fromkeys(grasps, VACUUM)).limits is None
