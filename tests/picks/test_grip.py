"""A good pick holds its part: the closed fingers touch it on opposite sides, and nothing else while they close."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.picks import Stage

DOWN = (np.pi, 0, 0)
QUICK = pp.picks.PickBudget(compared=1, remedies=0)
SIDE = 0.03
"""Metres: the cube."""

AT = (0.45, 0.15)
TOP = -0.005 + SIDE


def fingers(opening: float = 0.05, grip: float = SIDE) -> pp.picks.GripperFingers:
    """Two pads of 20 x 60 mm that end at the tip, 160 mm from the flange."""
    jaw = pp.Box(0.02, 0.01, 0.06)
    pair = (
        pp.Obstacle("finger_1", jaw, pp.pose((0, 0.005, 0.13))),
        pp.Obstacle("finger_2", jaw, pp.pose((0, -0.005, 0.13))),
    )
    return pp.picks.GripperFingers(pair, opening=opening, grip=grip)


def grasp(xyz=(0.0, 0.0, -0.015), turn: float = 0.0, **settings) -> pp.Pick:
    """A grasp from above, its tip moved from the middle of the cube's top by xyz (m) and turned about z."""
    at = np.array([*AT, TOP]) + xyz
    return pp.Pick("cube", pp.pose(at, (np.pi, 0, turn)), carried="cube", **settings)


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["ur5"]


def judge(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, budget=QUICK, **shared) -> pp.picks.PickVerdict:
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
    assert [stage.ok for stage in verdict.stages] == [True] * (len(verdict.stages) - 1) + [False]


@pytest.mark.parametrize("height", [0.05, 0.08, 0.12])
def test_a_part_below_the_robots_own_fingers_is_not_held(height: float) -> None:
    picks = pp.read_picks(robots_folder() / "panda/bin_picks.yaml")
    arm = pp.load_robot(picks.robot).arm(tcp=picks.tcp, held=picks.held)
    pick = next(each for each in picks if each.name == "standing")
    raised = replace(pick, place=None, pose=pp.pose(pick.pose.translation + np.array([0, 0, height]), DOWN))
    report = pp.validate_picks(arm, pp.Scene.load(picks.scene), replace(picks, picks=(raised,)), budget=QUICK)
    verdict = report.verdicts[0]
    assert verdict.failed is Stage.GRIP


def test_a_good_pick_reports_how_it_holds_its_part(arm) -> None:
    grip = judge(arm, grasp()).grip
    assert grip.held
    assert [each.finger for each in grip.contacts] == ["finger_1", "finger_2"]
    for each, direction in zip(grip.contacts, ((0, -1, 0), (0, 1, 0)), strict=True):
        np.testing.assert_allclose(each.closing_direction, direction)
        assert each.contact_area == pytest.approx(0.02 * 0.015, rel=1e-3)  # the pad's width, 15 mm below the top
        assert each.overlap == pytest.approx(0.015, rel=1e-3)
        assert each.gap == pytest.approx(0.0, abs=1e-5)
        assert each.open_distance == pytest.approx(0.010, abs=1e-5)


def test_the_stage_and_the_row_carry_the_figures(arm) -> None:
    verdict = judge(arm, grasp())
    figures = next(stage for stage in verdict.stages if stage.stage is Stage.GRIP).figures
    assert figures["contact_area"] == pytest.approx(3e-4, rel=1e-3)
    assert figures["closing_clearance"] > 0.002
    row = verdict.to_dict()
    assert [each["finger"] for each in row["grip"]["contacts"]] == ["finger_1", "finger_2"]
    assert row["grip"]["tip_distance"] is None
    failed = judge(arm, grasp(turn=np.pi / 4)).to_dict()
    assert failed["grip"] is None
    assert failed["stages"][-1]["figures"]["pressed_in"] == pytest.approx((np.sqrt(2) - 1) * SIDE / 2, abs=1e-5)
    assert failed["refuted"]


def test_fingers_that_stop_before_the_part_do_not_hold_it(arm) -> None:
    verdict = judge(arm, grasp(), fingers=fingers(grip=SIDE + 0.004))
    assert verdict.failed is Stage.GRIP
    assert verdict.stages[-1].figures["gap"] == pytest.approx(0.002, abs=1e-5)
    assert judge(arm, grasp(), fingers=fingers(grip=SIDE + 0.001)).ok


def test_fingertips_that_barely_reach_the_part_do_not_hold_it(arm) -> None:
    verdict = judge(arm, grasp((0, 0, -0.001)))
    assert verdict.failed is Stage.GRIP
    assert verdict.stages[-1].figures["overlap"] == pytest.approx(0.001, abs=1e-5)
    assert judge(arm, grasp((0, 0, -0.001)), grip_limits=pp.picks.GripLimits(overlap=5e-4)).ok


def test_contacts_that_are_not_opposite_each_other_do_not_hold(arm) -> None:
    """A long pad on one side of the cube, and on the other one that meets it only at its far edge."""
    short = pp.Obstacle("finger_2", pp.Box(0.003, 0.01, 0.06), pp.pose((0.0135, -0.005, 0.13)))
    long = pp.Obstacle("finger_1", pp.Box(0.003, 0.01, 0.06), pp.pose((-0.0135, 0.005, 0.13)))
    verdict = judge(arm, grasp(), fingers=pp.picks.GripperFingers((long, short), opening=0.05, grip=SIDE))
    assert verdict.failed is Stage.GRIP
    assert "opposite" in verdict.reason


POST = pp.Box(0.004, 0.002, 0.02)


def test_a_collision_of_closing_fingers_is_found(arm) -> None:
    """A post between the outer face of the closed finger, 25 mm from the middle, and the inner face of the open one."""
    wide = fingers(opening=0.08)
    post = pp.Obstacle("post", POST, pp.pose((AT[0], AT[1] + 0.032, 0.018)))
    assert judge(arm, grasp(), fingers=wide).ok
    verdict = judge(arm, grasp(), post, fingers=wide)
    assert verdict.failed is Stage.GRIP
    assert "post" in verdict.reason
    assert "finger" in verdict.reason
    for gap in (0.08, SIDE):  # neither the open nor the closed fingers touch it
        pair = fingers(gap, gap).gripping()
        scene = pp.Scene([post])
        checker = pp.CollisionChecker(arm, scene, attached=pair, margin=0.002)
        target = arm.root_from_base.actInv(grasp().pose * pp.pose((0, 0, 0.16)).inverse())
        assert any(checker.is_free(q) for q in pp.AnalyticIk().solve_all(arm, target).q)


def test_a_collision_of_opening_fingers_is_found_at_the_release(arm) -> None:
    wide, there = fingers(opening=0.08), np.array([0.45, -0.20, TOP])
    put = grasp(place=pp.picks.PlaceTarget(pp.pose(there - np.array([0, 0, 0.015]), DOWN)))
    assert judge(arm, put, fingers=wide).ok
    post = pp.Obstacle("post", POST, pp.pose((there[0], there[1] + 0.032, 0.018)))
    verdict = judge(arm, put, post, fingers=wide)
    assert verdict.failed is Stage.PLACE
    assert "post" in verdict.reason


def test_an_open_finger_that_would_plough_through_the_part_on_the_approach_is_found(arm) -> None:
    sideways = grasp(approach_direction=(0, 1, 0), approach_frame="root", approach=0.06)
    verdict = judge(arm, sideways)
    assert verdict.failed is Stage.APPROACH
    assert "cube" in verdict.reason
    along = grasp(approach_direction=(1, 0, 0), approach_frame="root", approach=0.06)
    assert judge(arm, along).ok


def test_the_tip_of_a_tool_without_fingers_is_at_the_part(arm) -> None:
    rod = pp.Obstacle("rod", pp.Cylinder(radius=0.01, length=0.155), pp.pose((0, 0, 0.0775)))
    for height, ok in ((0.0, True), (0.0049, True), (0.0051, False), (0.02, False)):
        verdict = judge(arm, grasp((0, 0, height)), tool=(rod,), fingers=None)
        assert verdict.ok is ok, verdict.reason
        figures = next(stage for stage in verdict.stages if stage.stage is Stage.GRIP).figures
        assert figures["tip_distance"] == pytest.approx(height, abs=1e-6)
    beside = judge(arm, grasp((0, SIDE / 2 + 0.02, 0.0)), tool=(rod,), fingers=None)
    assert beside.failed is Stage.GRIP
    near = pp.picks.GripLimits(tip=0.03)
    assert judge(arm, grasp((0, 0, 0.02)), tool=(rod,), fingers=None, grip_limits=near).ok


def test_without_an_object_the_grip_is_not_judged_with_a_note(arm) -> None:
    verdict = judge(arm, replace(grasp((0, 0, 0.10)), carried=None))
    assert verdict.ok
    assert verdict.grip is None
    assert next(stage for stage in verdict.stages if stage.stage is Stage.GRIP).message.startswith("not checked")


@pytest.mark.slow
def test_suggestions_stay_within_grasps_that_hold_the_part(arm) -> None:
    wall = pp.Obstacle("wall", pp.Box(0.3, 0.02, 0.2), pp.pose((AT[0], AT[1] + 0.05, 0.1)))
    for pick, obstacles, failed in ((grasp((0.0, 0.012, -0.015)), (), Stage.GRIP), (grasp(), (wall,), Stage.GRASP)):
        verdict = judge(arm, pick, *obstacles, budget=pp.picks.PickBudget(compared=1, remedies=6))
        assert verdict.failed is failed
        complete = [suggestion for suggestion in verdict.suggestions if not suggestion.effect]
        assert complete or failed is Stage.GRASP
        for suggestion in complete:
            changed = suggestion.apply(pick)
            again = judge(arm, changed, *obstacles, budget=pp.picks.PickBudget(compared=1, remedies=0))
            assert again.ok
            assert again.grip is not None


@pytest.mark.parametrize("kind", ["box", "channel"])
def test_the_wall_of_a_channel_is_held_from_inside_and_outside(arm, kind: str) -> None:
    """As a mesh the channel is gripped by a wall of 4 mm; as a block of its size the inner finger would be in it."""
    x, y, z, wall = 0.05, 0.03, 0.03, 0.004
    if kind == "box":
        part = pp.Obstacle("channel", pp.Box(y, x, z))
    else:
        boxes = [trimesh.creation.box((y, wall, z)) for _ in range(2)]
        floor = trimesh.creation.box((y, x - 2 * wall, wall))
        boxes[0].apply_translation((0, (x - wall) / 2, 0))
        boxes[1].apply_translation((0, -(x - wall) / 2, 0))
        floor.apply_translation((0, 0, (wall - z) / 2))
        mesh = trimesh.util.concatenate([*boxes, floor])
        part = pp.Obstacle("channel", pp.Mesh.from_arrays(mesh.vertices, mesh.faces, hull=False))
    at = pp.pose((AT[0], AT[1] - (x - wall) / 2, TOP - z / 2 + 1e-4))
    scene = pp.Scene([replace(part, pose=at)])
    pick = pp.Pick("channel", pp.pose((*AT, TOP - 0.015), DOWN), carried="channel")
    hand = pp.Obstacle("hand", pp.Cylinder(radius=0.03, length=0.1), pp.pose((0, 0, 0.05)))
    shared = pp.Picks((pick,), tip=pp.pose((0, 0, 0.16)), tool=(hand,), fingers=fingers(0.02, wall), margin=1e-3)
    verdict = pp.validate_picks(arm, scene, shared, budget=QUICK).verdicts[0]
    assert verdict.ok is (kind == "channel"), verdict.reason
    assert kind == "channel" or verdict.failed is Stage.GRIP


@pytest.mark.parametrize(
    ("xyz", "frame", "hint"),
    [
        ((0.0, 0.0, 0.0), "", r"stated in the root frame, but in frame 'cube' it would be \d+ mm from it"),
        ((*AT, TOP), "cube", "stated in frame 'cube', but in the root frame"),
        ((0.3, -0.4, 0.2), "", "stated in the root frame; check its frame"),
    ],
)
def test_a_grasp_far_from_its_object_gets_a_hint_on_its_frame(arm, xyz, frame: str, hint: str) -> None:
    pick = pp.Pick("cube", pp.pose(xyz, DOWN), carried="cube", frame=frame)
    reason = judge(arm, pick).reason
    assert re.search(hint, reason), reason
    assert " m from cube" in reason


def test_a_grasp_that_narrowly_misses_its_object_gets_no_hint_on_its_frame(arm) -> None:
    assert "frame" not in judge(arm, grasp((0.0, 0.0, 0.06))).reason
