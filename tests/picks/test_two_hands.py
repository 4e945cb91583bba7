"""Each hand of several that hold one part is judged by the criteria of the grip of a pick."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof.picks import GripperFingers, SuctionCup, Tool, judge_hands

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
