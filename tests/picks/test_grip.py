"""A good pick holds its part: fingers touch it on opposite sides, and the rim of a cup lies on its surface."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog, nnls

import pinproof as pp
from pinproof.collision.checking.line_surface import LineSurface
from pinproof.common.least_squares import non_negative_shares
from pinproof.picks import GripLimits, GripperFingers, PickBudget, PickSetup, PlaceTarget, Stage, SuctionCup
from pinproof.picks.judging import grip
from pinproof.picks.judging.grip import PlacedSurface, balanced, grip_by_cup
from pinproof.picks.judging.suggest import suggest
from pinproof.picks.judging.task import PickTask
from pinproof.picks.judging.verdict import StageResult
from pinproof.spatial import SE3

from . import grip_oracle as oracle
from .conftest import DOWN, QUICK, cell_of, figures, judge_in

SIDE = 0.03
"""Metres: the cube."""

AT = (0.45, 0.15)
TOP = -0.005 + SIDE
TABLE = pp.Obstacle("table", pp.Box(1.6, 1.2, 0.04), pp.pose((0.35, 0, -0.025)))
CUBE = pp.Obstacle("cube", pp.Box(SIDE, SIDE, SIDE), pp.pose((*AT, TOP - SIDE / 2)))
HAND = pp.Obstacle("hand", pp.Cylinder(radius=0.03, length=0.1), pp.pose((0, 0, 0.05)))
ROD = pp.Obstacle("rod", pp.Cylinder(radius=0.008, length=0.155), pp.pose((0, 0, 0.0775)))
POST = pp.Box(0.004, 0.002, 0.02)
CUP = SuctionCup(radius=0.008)


def fingers(opening: float = 0.05, grip: float = SIDE) -> GripperFingers:
    """Two pads of 20 x 60 mm that end at the tip, 160 mm from the flange."""
    at = {"finger_1": 0.005, "finger_2": -0.005}
    pads = (pp.Obstacle(name, pp.Box(0.02, 0.01, 0.06), pp.pose((0, y, 0.13))) for name, y in at.items())
    return GripperFingers(tuple(pads), opening=opening, grip=grip)


def grasp(xyz=(0.0, 0.0, -0.015), turn: float = 0.0, tilt: float = 0.0, **settings) -> pp.Pick:
    """A grasp from above, its tip moved from the middle of the cube's top by xyz (m), turned about z and tilted."""
    at = np.array([*AT, TOP]) + xyz
    return pp.Pick("cube", pp.pose(at, (np.pi + tilt, 0, turn)), carried="cube", **settings)


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["ur5"]


def judge(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, budget=QUICK, **shared) -> pp.picks.PickVerdict:
    scene = pp.Scene([TABLE, CUBE, *obstacles], allowed=[("base_link", "table")])
    settings = {"tip": pp.pose((0, 0, 0.16)), "tool": (HAND,), "fingers": fingers(), "margin": 0.002, **shared}
    return judge_in(arm, scene, pick, budget=budget, **settings)


# -- fingers ----------------------------------------------------------------------------------------------------------


def test_a_good_pick_reports_how_it_holds_its_part(arm) -> None:
    verdict = judge(arm, grasp())
    assert verdict.ok, verdict.reason
    assert verdict.grip.held
    assert [each.finger for each in verdict.grip.contacts] == ["finger_1", "finger_2"]
    for each, direction in zip(verdict.grip.contacts, ((0, -1, 0), (0, 1, 0)), strict=True):
        np.testing.assert_allclose(each.closing_direction, direction)
        assert each.contact_area == pytest.approx(0.02 * 0.015, rel=1e-3)  # the pad's width, 15 mm below the top
        assert each.overlap == pytest.approx(0.015, rel=1e-3)
        assert each.gap == pytest.approx(0.0, abs=1e-5)
        assert each.open_distance == pytest.approx(0.010, abs=1e-5)
    # The stage and the row carry the figures
    found = figures(verdict, Stage.GRIP)
    assert found["contact_area"] == pytest.approx(3e-4, rel=1e-3)
    assert found["closing_clearance"] > 0.002
    row = verdict.to_dict()
    assert [each["finger"] for each in row["grip"]["contacts"]] == ["finger_1", "finger_2"]
    assert row["grip"]["tip_distance"] is None
    failed = judge(arm, grasp(turn=np.pi / 4)).to_dict()
    assert failed["grip"] is None
    assert failed["stages"][-1]["figures"]["pressed_in"] == pytest.approx((np.sqrt(2) - 1) * SIDE / 2, abs=1e-5)
    assert failed["refuted"]


@pytest.mark.parametrize(
    ("pick", "shared", "found"),
    [
        (grasp((0.0, 0.012, -0.015)), {}, {}),
        (grasp((0.0, 0.020, -0.015)), {}, {}),
        (grasp(turn=np.pi / 4), {}, {}),
        (grasp((0.0, 0.0, 0.06)), {}, {}),
        (grasp((0.0, 0.10, 0.0)), {}, {}),
        (grasp((0.10, 0.0, 0.0)), {}, {}),
        (grasp(), {"fingers": fingers(grip=SIDE + 0.004)}, {"gap": 0.002}),
        (grasp((0, 0, -0.001)), {}, {"overlap": 0.001}),
    ],
    ids=["12 mm beside", "20 mm", "turned", "60 mm above", "100 mm across", "along", "fingers apart", "barely reached"],
)
def test_a_grasp_that_holds_nothing_fails_at_the_grip(arm, pick: pp.Pick, shared, found) -> None:
    verdict = judge(arm, pick, **shared)
    assert verdict.failed is Stage.GRIP
    assert [stage.ok for stage in verdict.stages] == [True] * (len(verdict.stages) - 1) + [False]
    assert {key: verdict.stages[-1].figures[key] for key in found} == pytest.approx(found, abs=1e-5)


def test_the_limits_of_the_grip_decide(arm) -> None:
    assert judge(arm, grasp(), fingers=fingers(grip=SIDE + 0.001)).ok
    assert judge(arm, grasp((0, 0, -0.001)), grip_limits=GripLimits(overlap=5e-4)).ok


@pytest.mark.parametrize("height", [0.05, 0.08, 0.12])
def test_a_part_below_the_robots_own_fingers_is_not_held(height: float) -> None:
    arm, scene, picks = cell_of("panda", "bin_picks.yaml", "standing")
    there = picks.picks[0].pose.translation + np.array([0, 0, height])
    raised = replace(picks, picks=(replace(picks.picks[0], place=None, pose=pp.pose(there, DOWN)),))
    assert pp.validate_picks(arm, scene, raised, budget=QUICK).verdicts[0].failed is Stage.GRIP


def test_contacts_that_are_not_opposite_each_other_do_not_hold(arm) -> None:
    """A long pad on one side of the cube, and on the other one that meets it only at its far edge."""
    short = pp.Obstacle("finger_2", pp.Box(0.003, 0.01, 0.06), pp.pose((0.0135, -0.005, 0.13)))
    long = pp.Obstacle("finger_1", pp.Box(0.003, 0.01, 0.06), pp.pose((-0.0135, 0.005, 0.13)))
    verdict = judge(arm, grasp(), fingers=GripperFingers((long, short), opening=0.05, grip=SIDE))
    assert verdict.failed is Stage.GRIP
    assert "opposite" in verdict.reason


def test_a_collision_of_closing_or_opening_fingers_is_found(arm) -> None:
    """A post between the outer face of the closed finger, 25 mm from the middle, and the inner face of the open one."""
    wide, there = fingers(opening=0.08), np.array([0.45, -0.20, TOP])
    post = pp.Obstacle("post", POST, pp.pose((AT[0], AT[1] + 0.032, 0.018)))
    assert judge(arm, grasp(), fingers=wide).ok
    verdict = judge(arm, grasp(), post, fingers=wide)
    assert verdict.failed is Stage.GRIP
    assert "post" in verdict.reason
    assert "finger" in verdict.reason
    for gap in (0.08, SIDE):  # neither the open nor the closed fingers touch it
        checker = pp.CollisionChecker(arm, pp.Scene([post]), attached=fingers(gap, gap).gripping(), margin=0.002)
        target = arm.root_from_base.actInv(grasp().pose * pp.pose((0, 0, 0.16)).inverse())
        assert any(checker.is_free(q) for q in pp.AnalyticIk().solve_all(arm, target).q)
    put = grasp(place=PlaceTarget(pp.pose(there - np.array([0, 0, 0.015]), DOWN)))
    assert judge(arm, put, fingers=wide).ok
    verdict = judge(arm, put, pp.Obstacle("post", POST, pp.pose((there[0], there[1] + 0.032, 0.018))), fingers=wide)
    assert verdict.failed is Stage.PLACE
    assert "post" in verdict.reason


def test_an_open_finger_that_would_plough_through_the_part_on_the_approach_is_found(arm) -> None:
    sideways, along = (
        judge(arm, grasp(approach_direction=axis, approach_frame="root", approach=0.06))
        for axis in ((0, 1, 0), (1, 0, 0))
    )
    assert sideways.failed is Stage.APPROACH
    assert "cube" in sideways.reason
    assert along.ok


GRIPPER = """<robot name="gripper"><link name="base"/><link name="hand"/>
<link name="pad"><collision><origin xyz="0 -.03 0"/><geometry><box size=".02 .02 .06"/></geometry></collision></link>
<link name="jaw"><collision><origin xyz="0 .03 0"/><geometry><box size=".02 .02 .06"/></geometry></collision></link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" velocity="1" effort="1"/></joint>
<joint name="rest" type="prismatic"><parent link="hand"/><child link="pad"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
<joint name="close" type="prismatic"><parent link="hand"/><child link="jaw"/><axis xyz="0 -1 0"/>
<limit lower="0" upper="0.1" velocity="1" effort="1"/></joint></robot>"""
"""A lift with a vice: its jaw is 40 mm from the pad while both joints are at 0."""


@pytest.mark.parametrize(("closed", "apart"), [(0.03, True), (0.0395, True), (0.041, False)])
def test_no_configuration_holds_a_part_if_the_closed_hand_collides_with_itself(closed: float, apart: bool) -> None:
    picks = pp.Picks((), held={"close": 0.0, "rest": 0.0}, grip={"close": closed}, margin=0.001, gripper=("pad",))
    arm = pp.load_robot(GRIPPER).arm(tcp="hand", held=picks.held)
    cell = PickSetup.make(arm, pp.Scene([CUBE]), picks, home=None, rng=0).cell
    assert (cell.closed_contact is None) is apart
    task = PickTask(pp.Pick("cube", pp.pose((0.0, 0.0, 0.2)), carried="cube"), cell)
    held = task.grip(task.nearest_group[0])
    if apart:
        assert "cannot be closed" not in held.message
        return
    assert (held.held, held.proven) == (False, True)
    assert {"jaw", "pad"} <= set(held.message.split())
    # Another position of the pick changes nothing about the hand
    failed = StageResult(Stage.GRIP, False, held.message)
    assert suggest(task, task.pick, failed, None, lambda pick: pytest.fail(f"{pick} was judged")) == ()


def test_forces_balance_where_a_linear_program_has_a_solution() -> None:
    rng, compared, balancing = np.random.default_rng(0), 0, 0
    for _ in range(200):
        main, patches = rng.normal(size=3), []
        for k in range(rng.integers(2, 4)):
            normal = (main if k % 2 else -main) / np.linalg.norm(main)
            normal = normal + rng.normal(0, rng.choice([0.0, 0.05, 0.3, 0.6]), 3)
            normal /= np.linalg.norm(normal)
            across = np.linalg.svd(normal[None])[2][1:]
            centre = -0.015 * rng.uniform(0.5, 1.5) * normal + rng.normal(0, rng.choice([0.0, 0.002, 0.01]), 3)
            points = rng.uniform(-1, 1, (rng.integers(1, 40), 2)) @ across * rng.choice([0.001, 0.01])
            patches.append((centre + points, normal))
        angle = rng.choice([0.1, 0.46, 0.8])
        expected = []

        def program(system: np.ndarray, wanted: np.ndarray, expected: list[bool] = expected) -> np.ndarray:
            answer = linprog(np.zeros(system.shape[1]), A_eq=system, b_eq=wanted, bounds=(0, None), method="highs")
            expected.append(answer.status == 0)
            shares = non_negative_shares(system, wanted)
            reference, distance = nnls(system, wanted)
            assert (shares >= 0.0).all()
            assert np.linalg.norm(system @ shares - wanted) == pytest.approx(distance, abs=1e-9)
            return reference

        with pytest.MonkeyPatch.context() as patch:
            found = balanced(patches, angle)
            patch.setattr(grip, "non_negative_shares", program)
            assert balanced(patches, angle) is found
        assert expected == [found]
        compared, balancing = compared + 1, balancing + found
    assert 20 < balancing < compared - 20


@pytest.mark.parametrize("kind", ["box", "channel"])
def test_the_wall_of_a_channel_is_held_from_inside_and_outside(arm, kind: str) -> None:
    """As a mesh the channel is gripped by a wall of 4 mm; as a block of its size the inner finger would be in it."""
    x, y, z, wall = 0.05, 0.03, 0.03, 0.004
    shape: pp.Shape = pp.Box(y, x, z)
    if kind == "channel":
        walls = [((y, wall, z), (0, side * (x - wall) / 2, 0)) for side in (1, -1)]
        boxes = [*walls, ((y, x - 2 * wall, wall), (0, 0, (wall - z) / 2))]
        mesh = trimesh.util.concatenate([trimesh.creation.box(size).apply_translation(at) for size, at in boxes])
        shape = pp.Mesh.from_arrays(mesh.vertices, mesh.faces, hull=False)
    part = pp.Obstacle("channel", shape, pp.pose((AT[0], AT[1] - (x - wall) / 2, TOP - z / 2 + 1e-4)))
    pick = pp.Pick("channel", pp.pose((*AT, TOP - 0.015), DOWN), carried="channel")
    settings = {"tip": pp.pose((0, 0, 0.16)), "tool": (HAND,), "fingers": fingers(0.02, wall), "margin": 1e-3}
    verdict = judge_in(arm, pp.Scene([part]), pick, **settings)
    assert verdict.failed is (None if kind == "channel" else Stage.GRIP), verdict.reason


@pytest.mark.slow
def test_suggestions_stay_within_grasps_that_hold_the_part(arm) -> None:
    wall = pp.Obstacle("wall", pp.Box(0.3, 0.02, 0.2), pp.pose((AT[0], AT[1] + 0.05, 0.1)))
    for pick, obstacles, failed in ((grasp((0.0, 0.012, -0.015)), (), Stage.GRIP), (grasp(), (wall,), Stage.GRASP)):
        verdict = judge(arm, pick, *obstacles, budget=PickBudget(compared=1, remedies=6))
        assert verdict.failed is failed
        complete = [suggestion for suggestion in verdict.suggestions if not suggestion.effect]
        assert complete or failed is Stage.GRASP
        for suggestion in complete:
            again = judge(arm, suggestion.apply(pick), *obstacles)
            assert again.ok
            assert again.grip is not None


# -- tools without fingers, and grasps without an object --------------------------------------------------------------


def test_the_tip_of_a_tool_without_fingers_is_at_the_part(arm) -> None:
    tool = {"tool": (replace(ROD, shape=pp.Cylinder(radius=0.01, length=0.155)),), "fingers": None}
    for height, ok in ((0.0, True), (0.0049, True), (0.0051, False), (0.02, False)):
        verdict = judge(arm, grasp((0, 0, height)), **tool)
        assert verdict.ok is ok, verdict.reason
        assert figures(verdict, Stage.GRIP)["tip_distance"] == pytest.approx(height, abs=1e-6)
    assert judge(arm, grasp((0, SIDE / 2 + 0.02, 0.0)), **tool).failed is Stage.GRIP
    assert judge(arm, grasp((0, 0, 0.02)), **tool, grip_limits=GripLimits(tip=0.03)).ok


def test_without_an_object_the_grip_is_not_judged_with_a_note(arm) -> None:
    verdict = judge(arm, replace(grasp((0, 0, 0.10)), carried=None))
    assert verdict.ok
    assert verdict.grip is None
    assert next(stage for stage in verdict.stages if stage.stage is Stage.GRIP).message.startswith("not checked")


@pytest.mark.parametrize(
    ("xyz", "frame", "hint"),
    [
        ((0.0, 0.0, 0.0), "", r"stated in the root frame, but in frame 'cube' it would be \d+ mm from it"),
        ((*AT, TOP), "cube", "stated in frame 'cube', but in the root frame"),
        ((0.3, -0.4, 0.2), "", "stated in the root frame; check its frame"),
        ((*AT, TOP + 0.06), "", ""),  # it narrowly misses its object
    ],
)
def test_a_grasp_far_from_its_object_gets_a_hint_on_its_frame(arm, xyz, frame: str, hint: str) -> None:
    reason = judge(arm, pp.Pick("cube", pp.pose(xyz, DOWN), carried="cube", frame=frame)).reason
    assert re.search(hint, reason), reason
    assert (" m from cube" in reason, "frame" in reason) == (bool(hint), bool(hint))


# -- suction cups -----------------------------------------------------------------------------------------------------


def part_of(shape: pp.Shape, at: SE3 | None = None) -> PlacedSurface:
    return PlacedSurface(LineSurface.of_obstacle(pp.Obstacle("part", shape)), SE3.Identity() if at is None else at)


def above(z: float, x: float = 0.0, tilt: float = 0.0) -> SE3:
    """A cup that faces down at the height z (m), moved by x (m) and tilted by an angle (rad) about y."""
    return pp.pose((x, 0, z), DOWN) * pp.pose(rpy=(0, tilt, 0))


BLOCK = part_of(pp.Box(SIDE, SIDE, 0.02), pp.pose((0, 0, -0.01)))


@pytest.mark.parametrize(
    ("tip", "held", "gap"),
    [
        (above(0.0), True, 0.0),
        (above(0.0009), True, 0.0009),
        (above(0.0011), False, 0.0011),
        (above(-0.0009), True, -0.0009),
        (above(-0.0011), False, -0.0011),
        (above(0.0, x=0.0069), True, 0.0),
        (above(0.0, x=0.0071), False, np.inf),
        (above(0.0, x=0.03), False, np.inf),
        (above(0.0, tilt=0.09), True, 0.0),
        (above(0.0, tilt=0.11), False, 0.0),
    ],
)
def test_the_rim_lies_on_the_top_of_a_box(tip, held, gap):
    found = grip_by_cup(CUP, tip, BLOCK)
    assert found.held is held, found.message
    assert found.cup.gap == pytest.approx(gap, abs=1e-9 if gap else 1e-3)
    if held:
        assert found.cup.contact_area == pytest.approx(np.pi * CUP.radius**2, rel=1e-9)


def test_a_tilt_is_reported_in_radians_and_widens_the_gap_but_does_not_depend_on_it():
    for tilt in (0.02, 0.05):
        found = grip_by_cup(CUP, above(0.0, tilt=tilt), BLOCK)
        assert found.cup.tilt == pytest.approx(tilt, abs=1e-6)
        assert abs(found.cup.gap) == pytest.approx(CUP.radius * np.tan(tilt), rel=1e-3)
    for gap in (-0.0009, 0.0005, 0.0009):
        assert grip_by_cup(CUP, above(gap), BLOCK).cup.tilt == pytest.approx(0.0, abs=1e-9)
        assert grip_by_cup(CUP, above(gap, tilt=0.01), BLOCK).cup.tilt == pytest.approx(0.01, abs=1e-8)


def test_round_parts_are_held_if_their_curvature_is_small():
    """A rim of radius r is r^2 / 2R below the top of a sphere of radius R."""
    for radius, held in ((0.05, True), (0.03, False)):
        found = grip_by_cup(CUP, above(0.0), part_of(pp.Sphere(radius), pp.pose((0, 0, -radius))))
        assert found.held is held
        assert found.cup.gap == pytest.approx(radius - np.sqrt(radius**2 - CUP.radius**2), abs=1e-9)


def test_a_hole_under_the_cup_leaks():
    ring = trimesh.creation.annulus(0.004, 0.02, 0.01).apply_translation((0, 0, -0.005))
    washer = part_of(pp.Mesh.from_arrays(ring.vertices, ring.faces, hull=False))
    found = grip_by_cup(CUP, above(0.0), washer)
    assert not found.held
    assert "hole" in found.message
    assert found.cup.contact_area == pytest.approx(np.pi * (CUP.radius**2 - 0.004**2), rel=0.02)
    assert grip_by_cup(SuctionCup(radius=0.004), above(0.0, x=0.012), washer).held
    across = grip_by_cup(CUP, above(0.0, x=0.008), washer)
    assert (across.held, across.cup.gap) == (False, np.inf)


@pytest.mark.parametrize("watertight", [True, False])
def test_a_part_as_a_mesh_of_its_own_shape_is_held_by_its_top(watertight):
    """A bracket: its upright is 30 mm high and its foot 10 mm; the hull of an open mesh fills the corner."""
    foot = trimesh.creation.box(bounds=[[-0.015, -0.01, 0], [0.015, 0.01, 0.01]])
    upright = trimesh.creation.box(bounds=[[-0.015, -0.01, 0], [-0.005, 0.01, 0.03]])
    mesh = trimesh.boolean.union([foot, upright], engine="manifold")
    if not watertight:
        mesh.update_faces(mesh.face_normals[:, 2] > -0.5)
    assert mesh.is_watertight == watertight
    part, cup = part_of(pp.Mesh.from_arrays(mesh.vertices, mesh.faces)), SuctionCup(radius=0.003)
    for z, x, held in ((0.01, 0.005, True), (0.03, -0.01, True), (0.03, 0.005, False)):
        assert grip_by_cup(cup, above(z, x=x), part).held is held


@pytest.mark.slow
def test_cups_on_random_parts_agree_with_rays_to_their_triangles():
    seen = {True: 0, False: 0}
    for index in range(60):
        rng = np.random.default_rng([11, index])
        shape, mesh = oracle.random_shape(rng)
        cup = SuctionCup(radius=float(rng.uniform(0.001, 0.004)), gap=1e-3, tilt=0.1)
        axis = -np.eye(3)[rng.integers(3)]
        turn = trimesh.geometry.align_vectors([0, 0, 1], axis)[:3, :3] @ pp.pose(rpy=rng.normal(0, 0.04, 3)).rotation
        top = oracle.cast(mesh.triangles, (-0.1 * axis)[None], axis)[0][0] - 0.1  # of the ray through the middle
        top = top if np.isfinite(top) else 0.0
        middle = axis * (top + rng.uniform(-1.2e-3, 1.2e-3)) + rng.normal(0, 1e-3, 3) * (axis == 0)
        found = grip_by_cup(cup, SE3(turn, middle), part_of(shape))
        angle = rng.uniform(0, 2 * np.pi, 500)
        rim = cup.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        origins = middle + rim @ turn[:, :2].T - 0.1 * turn[:, 2]
        depth = oracle.cast(mesh.triangles, origins, turn[:, 2])[0] - 0.1
        worst = np.abs(depth).max()
        if np.isfinite(found.cup.gap) and np.isfinite(worst):
            assert abs(found.cup.gap) == pytest.approx(worst, abs=1.2e-4)  # tessellation and other points of the rim
        assert np.isfinite(worst) or not found.held
        if found.held:
            assert worst <= cup.gap + 1.2e-4
            least = np.linalg.lstsq(np.column_stack([rim, np.ones(500)]), depth, rcond=None)[0][:2]
            assert np.arctan(np.linalg.norm(least)) <= cup.tilt + 0.02
        seen[found.held] += 1
    assert min(seen.values()) >= 8


def test_the_grip_stage_judges_the_cup_and_reports_its_figures(arm):
    tool = {"tool": (ROD,), "fingers": None, "cup": CUP}
    good = judge(arm, grasp((0.0, 0.0, 0.0005)), **tool)
    assert good.ok, good.reason
    row = good.to_dict()["grip"]
    assert row["cup"]["gap"] == pytest.approx(0.0005, abs=1e-7)
    assert row["cup"]["contact_area"] == pytest.approx(np.pi * CUP.radius**2, rel=1e-6)
    assert row["tip_distance"] is None
    beside = judge(arm, grasp((0.0, 0.009, 0.0)), **tool)
    assert beside.failed is Stage.GRIP
    assert beside.stages[-1].figures["contact_area"] < np.pi * CUP.radius**2
    assert judge(arm, grasp((0.0, 0.009, 0.0)), **{**tool, "cup": None}).ok  # the rule for tools without a face
    assert judge(arm, grasp((0.0, 0.0, 0.0), tilt=0.15), **tool).failed is Stage.GRIP


def test_a_picks_file_states_a_cup_and_a_wrong_one_is_refused_by_key(tmp_path):
    path = tmp_path / "picks.yaml"
    for stated, named in (
        ("{radius: 0.012, gap: 0.002}", None),
        ("{gap: 0.001}", "radius"),
        ("{radius: 0}", "radius"),
        ("{radius: 1, tilt: 2}", "tilt"),
        ("{radus: 1}", "radus"),
    ):
        path.write_text(f"picks: [{{name: a, xyz: [0, 0, 0], rpy: [0, 0, 0]}}]\ncup: {stated}\n")
        if named is None:
            assert pp.read_picks(path).cup == SuctionCup(radius=0.012, gap=0.002)
        else:
            with pytest.raises(pp.errors.PicksError, match=rf"cup.*{named}"):
                pp.read_picks(path)
    with pytest.raises(pp.InputError, match="cup"):
        pp.Picks((), cup=CUP, fingers=fingers())
