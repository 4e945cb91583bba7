"""A good pick holds its part: the closed fingers touch it on opposite sides, and nothing else while they close."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.picks import Stage

DOWN = (np.pi, 0, 0)
QUICK = pp.PickBudget(compared=1, remedies=0)
SIDE = 0.03
"""Metres: the cube."""

AT = (0.45, 0.15)
TOP = -0.005 + SIDE


def fingers(opening: float = 0.05, grip: float = SIDE) -> pp.Fingers:
    """Two pads of 20 x 60 mm that end at the tip, 160 mm from the flange."""
    jaw = pp.Box(0.02, 0.01, 0.06)
    pair = (
        pp.Obstacle("finger_1", jaw, pp.pose((0, 0.005, 0.13))),
        pp.Obstacle("finger_2", jaw, pp.pose((0, -0.005, 0.13))),
    )
    return pp.Fingers(pair, opening=opening, grip=grip)


def grasp(xyz=(0.0, 0.0, -0.015), turn: float = 0.0, **settings) -> pp.Pick:
    """A grasp from above, its tip moved from the middle of the cube's top by xyz (m) and turned about z."""
    at = np.array([*AT, TOP]) + xyz
    return pp.Pick("cube", pp.pose(at, (np.pi, 0, turn)), carried="cube", **settings)


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["ur5"]


def judge(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, budget=QUICK, **shared) -> pp.PickVerdict:
    table = pp.Obstacle("table", pp.Box(1.6, 1.2, 0.04), pp.pose((0.35, 0, -0.025)))
    cube = pp.Obstacle("cube", pp.Box(SIDE, SIDE, SIDE), pp.pose((*AT, TOP - SIDE / 2)))
    scene = pp.Scene([table, cube, *obstacles], allowed=[("base_link", "table")])
    hand = pp.Obstacle("hand", pp.Cylinder(radius=0.03, length=0.1), pp.pose((0, 0, 0.05)))
    settings = {"tip": pp.pose((0, 0, 0.16)), "tool": (hand,), "fingers": fingers(), "margin": 0.002, **shared}
    (verdict,) = pp.validate_picks(arm, scene, pp.Picks((pick,), **settings), budget=budget).verdicts
    return verdict


def test_a_grasp_that_holds_the_cube_is_good(arm) -> None:
    verdict = judge(arm, grasp())
    assert verdict.ok, verdict.reason


@pytest.mark.parametrize(
    "pick",
    [
        grasp((0.0, 0.012, -0.015)),
        grasp((0.0, 0.020, -0.015)),
        grasp(turn=np.pi / 4),
        grasp((0.0, 0.0, 0.06)),
        grasp((0.0, 0.10, 0.0)),
        grasp((0.10, 0.0, 0.0)),
    ],
    ids=["12 mm beside", "20 mm beside", "turned by 45 deg", "60 mm above", "100 mm across", "100 mm along"],
)
def test_a_grasp_that_holds_nothing_fails_at_the_grip(arm, pick: pp.Pick) -> None:
    verdict = judge(arm, pick)
    assert verdict.failed is Stage.GRIP


@pytest.mark.parametrize("height", [0.05, 0.08, 0.12])
def test_a_part_below_the_robots_own_fingers_is_not_held(height: float) -> None:
    picks = pp.read_picks(robots_folder() / "panda/bin_picks.yaml")
    arm = pp.load_robot(picks.robot).arm(tcp=picks.tcp, held=picks.held)
    pick = next(each for each in picks if each.name == "standing")
    raised = replace(pick, place=None, pose=pp.pose(pick.pose.translation + np.array([0, 0, height]), DOWN))
    report = pp.validate_picks(arm, pp.Scene.load(picks.scene), replace(picks, picks=(raised,)), budget=QUICK)
    verdict = report.verdicts[0]
    assert verdict.failed is Stage.GRIP
