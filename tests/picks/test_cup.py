"""A suction cup holds a part if the rim of its face lies on the surface; compared with rays to a tessellated part."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision.checking.line_surface import LineSurface
from pinproof.picks import Stage, SuctionCup
from pinproof.picks.judging.grip import HeldPart, grip_by_cup
from pinproof.spatial import SE3

DOWN = (np.pi, 0, 0)
SIDE = 0.03
AT = (0.45, 0.15)
TOP = -0.005 + SIDE
CUP = SuctionCup(radius=0.008)


def part_of(shape: pp.Shape, at: SE3 | None = None) -> HeldPart:
    return HeldPart(LineSurface.of_obstacle(pp.Obstacle("part", shape)), SE3.Identity() if at is None else at)


def above(z: float, x: float = 0.0, tilt: float = 0.0) -> SE3:
    """A cup that faces down at the height z (m), moved by x (m) and tilted by an angle (rad) about y."""
    return pp.pose((x, 0, z), DOWN) * pp.pose(rpy=(0, tilt, 0))


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
    found = grip_by_cup(CUP, tip, part_of(pp.Box(SIDE, SIDE, 0.02), pp.pose((0, 0, -0.01))))
    assert found.held is held, found.message
    if gap == 0.0:
        assert abs(found.cup.gap) < 1e-3
    else:
        assert found.cup.gap == pytest.approx(gap, abs=1e-9)
    if held:
        assert found.cup.contact_area == pytest.approx(np.pi * CUP.radius**2, rel=1e-9)


def test_a_tilt_is_reported_in_radians_and_widens_the_gap():
    for tilt in (0.02, 0.05):
        found = grip_by_cup(CUP, above(0.0, tilt=tilt), part_of(pp.Box(SIDE, SIDE, 0.02), pp.pose((0, 0, -0.01))))
        assert found.cup.tilt == pytest.approx(tilt, abs=1e-6)
        assert abs(found.cup.gap) == pytest.approx(CUP.radius * np.tan(tilt), rel=1e-3)


def test_round_parts_are_held_if_their_curvature_is_small():
    """A rim of radius r is r^2 / 2R below the top of a sphere of radius R."""
    for radius, held in ((0.05, True), (0.03, False)):
        found = grip_by_cup(CUP, above(0.0), part_of(pp.Sphere(radius), pp.pose((0, 0, -radius))))
        assert found.held is held
        assert found.cup.gap == pytest.approx(radius - np.sqrt(radius**2 - CUP.radius**2), abs=1e-9)


def test_a_hole_under_the_cup_leaks():
    ring = trimesh.creation.annulus(0.004, 0.02, 0.01)
    ring.apply_translation((0, 0, -0.005))
    washer = part_of(pp.Mesh.from_arrays(ring.vertices, ring.faces, hull=False))
    found = grip_by_cup(CUP, above(0.0), washer)
    assert not found.held
    assert "hole" in found.message
    assert found.cup.contact_area == pytest.approx(np.pi * (CUP.radius**2 - 0.004**2), rel=0.02)
    assert grip_by_cup(SuctionCup(radius=0.004), above(0.0, x=0.012), washer).held
    across = grip_by_cup(CUP, above(0.0, x=0.008), washer)
    assert not across.held
    assert across.cup.gap == np.inf


@pytest.mark.slow
def test_cups_on_random_parts_agree_with_rays_to_their_triangles(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    oracle = importlib.import_module("grip_oracle")
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
        d = turn[:, 2]
        angle = rng.uniform(0, 2 * np.pi, 500)
        rim = cup.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        depth = oracle.cast(mesh.triangles, middle + rim @ turn[:, :2].T - 0.1 * d, d)[0] - 0.1
        worst = np.abs(depth).max()
        if np.isfinite(found.cup.gap) and np.isfinite(worst):
            assert abs(found.cup.gap) == pytest.approx(worst, abs=1.2e-4)  # tessellation and other points of the rim
        if np.isinf(worst):
            assert not found.held
        if found.held:
            assert worst <= cup.gap + 1.2e-4
            least = np.linalg.lstsq(np.column_stack([rim, np.ones(500)]), depth, rcond=None)[0][:2]
            assert np.arctan(np.linalg.norm(least)) <= cup.tilt + 0.02
        seen[found.held] += 1
    assert min(seen.values()) >= 8


def judge(arm: pp.Arm, tip: tuple[float, float, float], turn=DOWN, **shared) -> pp.picks.PickVerdict:
    table = pp.Obstacle("table", pp.Box(1.6, 1.2, 0.04), pp.pose((0.35, 0, -0.025)))
    cube = pp.Obstacle("cube", pp.Box(SIDE, SIDE, SIDE), pp.pose((*AT, TOP - SIDE / 2)))
    scene = pp.Scene([table, cube], allowed=[("base_link", "table")])
    rod = pp.Obstacle("rod", pp.Cylinder(radius=0.008, length=0.155), pp.pose((0, 0, 0.0775)))
    settings = {"tip": pp.pose((0, 0, 0.16)), "tool": (rod,), "cup": CUP, "margin": 0.002, **shared}
    pick = pp.Pick("cube", pp.pose(np.array([*AT, TOP]) + tip, turn), carried="cube")
    budget = pp.picks.PickBudget(compared=1, remedies=0)
    return pp.validate_picks(arm, scene, pp.Picks((pick,), **settings), budget=budget).verdicts[0]


def test_the_grip_stage_judges_the_cup_and_reports_its_figures(arms):
    good = judge(arms["ur5"], (0.0, 0.0, 0.0005))
    assert good.ok, good.reason
    row = good.to_dict()["grip"]
    assert row["cup"]["gap"] == pytest.approx(0.0005, abs=1e-7)
    assert row["cup"]["contact_area"] == pytest.approx(np.pi * CUP.radius**2, rel=1e-6)
    assert row["tip_distance"] is None
    beside = judge(arms["ur5"], (0.0, 0.009, 0.0))
    assert beside.failed is Stage.GRIP
    assert beside.stages[-1].figures["contact_area"] < np.pi * CUP.radius**2
    assert judge(arms["ur5"], (0.0, 0.009, 0.0), cup=None).ok  # the rule for tools without a face
    assert judge(arms["ur5"], (0.0, 0.0, 0.0), turn=(np.pi + 0.15, 0, 0)).failed is Stage.GRIP


def test_a_cup_and_fingers_exclude_each_other():
    jaw = pp.Obstacle("left", pp.Box(0.01, 0.01, 0.01)), pp.Obstacle("right", pp.Box(0.01, 0.01, 0.01))
    with pytest.raises(pp.InputError, match="cup"):
        pp.Picks((), cup=CUP, fingers=pp.picks.GripperFingers(jaw, opening=0.02, grip=0.01))


FILE = "picks: [{{name: a, xyz: [0, 0, 0], rpy: [0, 0, 0]}}]\ncup: {cup}\n"


def test_a_picks_file_states_a_cup(tmp_path):
    path = tmp_path / "picks.yaml"
    path.write_text(FILE.format(cup="{radius: 0.012, gap: 0.002}"))
    assert pp.read_picks(path).cup == SuctionCup(radius=0.012, gap=0.002)


@pytest.mark.parametrize(
    ("stated", "named"),
    [("{gap: 0.001}", "radius"), ("{radius: 0}", "radius"), ("{radius: 1, tilt: 2}", "tilt"), ("{radus: 1}", "radus")],
)
def test_a_wrong_cup_is_refused_by_key(tmp_path, stated, named):
    path = tmp_path / "picks.yaml"
    path.write_text(FILE.format(cup=stated))
    with pytest.raises(pp.errors.PicksError, match=named) as caught:
        pp.read_picks(path)
    assert "cup" in str(caught.value)


@pytest.mark.parametrize("watertight", [True, False])
def test_a_part_as_a_mesh_of_its_own_shape_is_held_by_its_top(watertight):
    """A bracket: its upright is 30 mm high and its foot 10 mm; the hull of an open mesh fills the corner."""
    foot = trimesh.creation.box(bounds=[[-0.015, -0.01, 0], [0.015, 0.01, 0.01]])
    upright = trimesh.creation.box(bounds=[[-0.015, -0.01, 0], [-0.005, 0.01, 0.03]])
    mesh = trimesh.boolean.union([foot, upright], engine="manifold")
    if not watertight:
        keep = mesh.face_normals[:, 2] > -0.5
        mesh.update_faces(keep)
    assert mesh.is_watertight == watertight
    part = part_of(pp.Mesh.from_arrays(mesh.vertices, mesh.faces))
    cup = SuctionCup(radius=0.003)
    assert grip_by_cup(cup, above(0.01, x=0.005), part).held is True
    assert grip_by_cup(cup, above(0.03, x=-0.01), part).held is True
    assert grip_by_cup(cup, above(0.03, x=0.005), part).held is False


def test_the_tilt_does_not_depend_on_the_gap():
    box = part_of(pp.Box(SIDE, SIDE, 0.02), pp.pose((0, 0, -0.01)))
    for gap in (-0.0009, 0.0005, 0.0009):
        assert grip_by_cup(CUP, above(gap), box).cup.tilt == pytest.approx(0.0, abs=1e-9)
        assert grip_by_cup(CUP, above(gap, tilt=0.01), box).cup.tilt == pytest.approx(0.01, abs=1e-8)
