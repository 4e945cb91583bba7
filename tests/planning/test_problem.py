"""Plans to goals that a joint cannot reach, because bodies that it alone moves cannot pass an obstacle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.model import load_robot
from pinproof.planning import find_barriers

BUDGET = pp.RrtConnect(max_nodes=300, max_samples=600, time_limit=600.0)
START, GOAL = np.array([0.0, 0.0, 0.0]), np.array([0.5, 0.4, -0.4])


def lift(rack: str) -> pp.Arm:
    """A lift (z) with a rack, which no other joint moves, and an arm of two revolute joints with a ball at its end."""
    geometry = {
        "base": "",
        "carriage": f'<collision><origin xyz="0 0.6 0"/><geometry>{rack}</geometry></collision>',
        "upper": "",
        "hand": '<collision><origin xyz="0.3 0 0"/><geometry><sphere radius="0.03"/></geometry></collision>',
        "tip": "",
    }
    joints = [
        ("z", "prismatic", "base", "carriage", "0 0 0", "0 0 1"),
        ("one", "revolute", "carriage", "upper", "0 0 0", "0 0 1"),
        ("two", "revolute", "upper", "hand", "0.3 0 0", "0 0 1"),
        ("end", "fixed", "hand", "tip", "0.3 0 0", "0 0 1"),
    ]
    text = "".join(f'<link name="{name}">{inner}</link>' for name, inner in geometry.items())
    text += "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
        for name, kind, parent, child, at, axis in joints
    )
    return load_robot(f'<robot name="lift">{text}</robot>').arm(tcp="tip")


RACK = lift('<box size="0.2 0.2 0.05"/>')
BOARD = pp.Obstacle("board", pp.Box(0.4, 0.4, 0.02), pp.pose((0, 0.6, 0.25)))


@pytest.mark.parametrize("direction", [1, -1])
def test_a_rack_that_cannot_pass_a_board_makes_the_plan_impossible(direction: int) -> None:
    checker = pp.CollisionChecker(RACK, pp.Scene([BOARD]), margin=0.001)
    ends = [START, GOAL][::direction]
    plan = BUDGET.plan(checker, *ends)
    assert plan.status is pp.planning.PlanStatus.IMPOSSIBLE
    assert not plan.ok
    for name in ("z cannot pass 0.2", "carriage penetrates board"):
        assert name in plan.message
    assert plan.gap > 0
    assert BUDGET.plan(checker, *ends, portfolio=3).status is pp.planning.PlanStatus.IMPOSSIBLE
    far = BUDGET.plan(checker, ends[0], [ends[1], ends[1] + [0.1 * direction, 0, 0]])
    assert far.status is pp.planning.PlanStatus.IMPOSSIBLE


def test_a_goal_before_the_board_is_reached() -> None:
    checker = pp.CollisionChecker(RACK, pp.Scene([BOARD]), margin=0.001)
    plan = BUDGET.plan(checker, START, [GOAL, [0.2, 0.4, -0.4]])
    assert plan.ok
    assert plan.goal == 1


def test_a_long_search_ends_with_the_proof_and_not_with_its_budget() -> None:
    checker = pp.CollisionChecker(RACK, pp.Scene([BOARD]), margin=0.001)
    plan = pp.RrtConnect(time_limit=600.0).plan(checker, START, GOAL)
    assert plan.status is pp.planning.PlanStatus.IMPOSSIBLE
    assert plan.samples < pp.RrtConnect().max_samples / 4


def test_a_contact_that_other_joints_avoid_is_no_barrier() -> None:
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 0.1), pp.pose((0.6, 0, 0.25)))
    checker = pp.CollisionChecker(RACK, pp.Scene([post]), margin=0.001)
    assert not checker.is_free([0.25, 0, 0])
    assert find_barriers(checker, START, np.array([[0.5, 0, 0]])) == ()
    assert BUDGET.plan(checker, START, [0.5, 0, 0]).ok


def rack_of_two_bars(folder: Path) -> pp.Arm:
    """A rod passes between the bars, which the hull of the rack joins."""
    one = trimesh.creation.box(bounds=[(-0.1, -0.1, -0.02), (-0.06, 0.1, 0.02)])
    other = trimesh.creation.box(bounds=[(0.06, -0.1, -0.02), (0.1, 0.1, 0.02)])
    trimesh.util.concatenate([one, other]).export(folder / "rack.stl")
    return lift(f'<mesh filename="{folder / "rack.stl"}"/>')


ROD = pp.Obstacle("board", pp.Box(0.05, 0.05, 0.02), pp.pose((0, 0.6, 0.25)))


def test_a_contact_of_the_hull_alone_proves_nothing(tmp_path: Path) -> None:
    """A rod passes between the two bars of the rack, which its hull joins; a wide board does not."""
    rack = rack_of_two_bars(tmp_path)
    checker = pp.CollisionChecker(rack, pp.Scene([ROD]), margin=0.001)
    assert not checker.is_free([0.25, 0, 0])
    assert BUDGET.plan(checker, START, GOAL).status is pp.planning.PlanStatus.OUT_OF_BUDGET
    wide = pp.Obstacle("board", pp.Box(0.4, 0.05, 0.02), pp.pose((0, 0.6, 0.25)))
    checker = pp.CollisionChecker(rack, pp.Scene([wide]), margin=0.001)
    assert BUDGET.plan(checker, START, GOAL).status is pp.planning.PlanStatus.IMPOSSIBLE


def test_a_contact_of_the_hand_beside_one_of_the_hull_is_no_barrier(tmp_path: Path) -> None:
    """Where the hull of the rack is in contact, the hand at its start is in a post, which it can pass elsewhere."""
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 0.1), pp.pose((0.6, 0, 0.25)))
    checker = pp.CollisionChecker(rack_of_two_bars(tmp_path), pp.Scene([ROD, post]), margin=0.001)
    at = np.array([0.25, 0, 0])
    assert {contact.bodies for contact in checker.check(at).contacts} == {("carriage", "board"), ("hand", "post")}
    assert {contact.bodies for contact in checker.exact_at(at).check(at).contacts} == {("hand", "post")}
    assert find_barriers(checker, START, np.array([[0.5, 0, 0], GOAL])) == ()
