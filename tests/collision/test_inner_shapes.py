"""Balls, corners and boxes inside bodies, against distances from formulas and from dense points of the surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision.geometry import inner_shapes as module
from pinproof.collision.geometry.bodies import MOST_EXCESS, Support, hull_body, shape_body
from pinproof.collision.geometry.inner_shapes import (
    MOST_BALLS,
    MOST_CORNERS,
    ROUNDING,
    InnerShapes,
    extremes,
    inner_shapes,
    spiral_directions,
)
from pinproof.spatial import Array

from .test_line_surface import CASES as BODIES
from .test_line_surface import CROSS, HULL, mesh_of


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch):
    monkeypatch.setattr(module, "_KEPT", {})


def inside(name: str) -> Callable[[Array], Array]:
    """How deep points are inside a body whose function is the signed distance there."""
    return lambda points: -BODIES[name][1](points)


def shapes_in(shape: pp.Shape) -> InnerShapes:
    return inner_shapes(shape_body("body", "body", None, shape, pp.pose((0, 0, 0))))


def in_ellipsoid(points: Array) -> Array:
    surface = spiral_directions(100_000) * [0.1, 0.2, 0.05]
    return np.array([np.linalg.norm(surface - point, axis=1).min() for point in points])


def in_cross(points: Array) -> Array:
    grid = [(i / 120, j / 120) for i in range(121) for j in range(121 - i)]
    shares = np.array([(1 - u - v, u, v) for u, v in grid])
    surface = np.einsum("sk,fkx->fsx", shares, CROSS.triangles).reshape(-1, 3)
    return np.array([np.linalg.norm(surface - point, axis=1).min() for point in points])


CONVEX_MESH = pp.Mesh.from_arrays(np.array(HULL.vertices), np.array(HULL.faces), hull=False)
CASES: dict[str, tuple[pp.Shape, Callable[[Array], Array], float, float]] = {
    # Shape, distance of inner points from the surface, largest ball, and how much smaller a ball may be than that.
    "box": (BODIES["box"][0], inside("box"), 0.05, 0.0),
    "sphere": (BODIES["sphere"][0], inside("sphere"), 0.1, 0.0),
    "cylinder": (BODIES["cylinder"][0], inside("cylinder"), 0.1, 0.01),
    "capsule": (BODIES["capsule"][0], inside("capsule"), 0.1, 0.0),
    "cone": (BODIES["cone"][0], inside("cone"), 0.072, 0.01),
    "ellipsoid": (BODIES["ellipsoid"][0], in_ellipsoid, 0.05, 0.008),
    "convex hull": (BODIES["convex hull"][0], inside("convex hull"), 0.05, 0.0),
    "convex mesh": (CONVEX_MESH, inside("convex hull"), 0.05, 0.0),
    "mesh": (BODIES["mesh"][0], in_cross, 0.0707, 0.0006),
}


@pytest.mark.parametrize("name", CASES)
def test_balls_are_inside_as_large_as_they_can_be_and_apart(name):
    shape, depth, largest, lost = CASES[name]
    balls = shapes_in(shape).balls
    room = depth(balls[:, :3]) - balls[:, 3]
    assert (room >= ROUNDING / 2).all()
    assert (room <= lost + 2 * ROUNDING).all()
    radii = balls[:, 3]
    assert radii[0] >= 0.87 * largest
    assert (np.diff(radii) <= 0).all()
    assert radii[-1] >= 0.25 * radii[0]
    assert 1 <= len(balls) <= MOST_BALLS
    for i, ball in enumerate(balls):
        assert (np.linalg.norm(balls[:i, :3] - ball[:3], axis=1) > 0.6 * radii[:i]).all()
    if name in ("box", "convex hull", "convex mesh"):
        # The candidates are a grid of 9 x 9 x 9 and the middle; each is covered by a chosen ball that is no smaller.
        low, high = shape_body("body", "body", None, shape, pp.pose((0, 0, 0))).box
        axes = [(np.arange(9) + 0.5) / 9 * (high[k] - low[k]) + low[k] for k in range(3)]
        grid = np.concatenate([[(low + high) / 2], np.array(np.meshgrid(*axes)).reshape(3, -1).T])
        left = depth(grid) - ROUNDING
        large = left > (max(radii[-1], 0.25 * radii[0]) if len(balls) == MOST_BALLS else 0.25 * radii[0]) + 1e-9
        covered = np.linalg.norm(grid[:, None] - balls[:, :3], axis=2) <= 0.6 * radii + 1e-9
        assert (covered & (radii >= left[:, None] - 1e-9)).any(axis=1)[large].all()


@pytest.mark.parametrize("name", CASES)
def test_corners_are_on_the_surface_in_all_directions(name):
    shape, depth, *_ = CASES[name]
    body = shape_body("body", "body", None, shape, pp.pose((0, 0, 0)))
    corners = inner_shapes(body).corners
    assert 1 <= len(corners) <= MOST_CORNERS
    if name in ("box", "convex hull"):
        assert len(np.unique(corners, axis=0)) == len(corners) == len(body.support.points)
    if name in ("sphere", "capsule"):  # their balls are larger than any corner
        assert (depth(corners) >= 0.1 - 1e-12).all()
        return
    assert np.abs(depth(corners)).max() < (2e-3 if name == "ellipsoid" else 1e-12)
    directions = spiral_directions(50)
    surface = body.solid.corners.reshape(-1, 3) if body.support is None else extremes(body.support)
    assert ((directions @ surface.T).max(axis=1) - (directions @ corners.T).max(axis=1) < 0.02).all()


def test_corners_of_a_fine_mesh_are_as_far_apart_as_possible():
    ball = trimesh.creation.icosphere(3, 0.1).apply_translation((1.0, 0.5, 0.2)).apply_scale((1, 2, 3))
    corners = shapes_in(mesh_of(ball)).corners
    assert corners.shape == (MOST_CORNERS, 3)
    middle = ball.vertices.mean(axis=0)
    assert np.linalg.norm(corners[0] - middle) == pytest.approx(np.linalg.norm(ball.vertices - middle, axis=1).max())
    away = np.linalg.norm(np.array(ball.vertices)[:, None] - corners, axis=2)
    chosen = np.linalg.norm(corners[:, None] - corners, axis=2)
    for k in range(1, MOST_CORNERS):
        assert chosen[k, :k].min() == pytest.approx(away[:, :k].min(axis=1).max(), abs=1e-12)


@pytest.mark.parametrize("name", [name for name in CASES if "mesh" not in name])
def test_extreme_points_of_a_convex_body_have_the_largest_extent_in_their_directions(name):
    support = shape_body("body", "body", None, CASES[name][0], pp.pose((0, 0, 0))).support
    directions = spiral_directions(200)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0)
    assert np.abs(directions.mean(axis=0)).max() < 1e-2
    assert np.linalg.svd(directions)[1] == pytest.approx(np.sqrt(200 / 3), rel=0.01)
    points = extremes(support, with_ball=True)
    reach = support.reach(directions)
    assert (points @ directions.T).max(axis=0) == pytest.approx(reach, abs=1e-12)
    assert ((points @ directions.T) <= reach + 1e-12).all()
    bare = extremes(support)
    assert (bare @ directions.T).max(axis=0) == pytest.approx(reach - support.radius, abs=1e-12)


def test_a_box_and_a_half_space_have_a_box():
    box = shapes_in(pp.Box(0.2, 0.3, 0.1))
    assert box.box_centre == pytest.approx([0, 0, 0])
    assert box.box_half == pytest.approx(np.array([0.1, 0.15, 0.05]) - ROUNDING, abs=1e-15)
    assert len(box.corners) == len(np.unique(box.corners, axis=0)) == 8
    assert shapes_in(pp.Capsule(0.1, 0.3)).box_half is None
    half_space = shapes_in(pp.HalfSpace())
    assert half_space.box_half == pytest.approx([1e3] * 3)
    assert half_space.box_centre == pytest.approx([0, 0, -1e3])
    assert len(half_space.balls) == len(half_space.corners) == 0


def test_balls_of_a_capsule_reach_its_ends_and_those_of_a_rounded_box_include_the_rounding():
    heights = shapes_in(pp.Capsule(0.1, 0.3)).balls[:, 2]
    assert (heights.min(), heights.max()) == pytest.approx((-0.15, 0.15), abs=0.061)
    box = hull_body("box", "box", np.array(trimesh.creation.box((0.2, 0.3, 0.1)).vertices), pp.pose((0, 0, 0)))
    rounded = replace(box, support=Support(box.support.points, 0.02))
    assert inner_shapes(rounded).balls[0, 3] == pytest.approx(0.07, abs=2 * ROUNDING)


def test_shapes_of_a_hull_of_a_file_are_smaller_by_what_it_may_extend_beyond_the_mesh(tmp_path):
    path = tmp_path / "box.stl"
    trimesh.creation.box((0.2, 0.3, 0.1)).export(path)
    hull, exact = (shapes_in(pp.Mesh(path, hull=hull)) for hull in (True, False))
    assert exact.balls[0, 3] == pytest.approx(0.05, abs=2 * ROUNDING)
    assert hull.balls[0, 3] == pytest.approx(0.05 - MOST_EXCESS, abs=2 * ROUNDING)
    assert len(hull.corners) == 0
    assert len(exact.corners) == 8


def test_bodies_of_approximate_or_no_volume_have_no_shapes(tmp_path):
    path = tmp_path / "ball.stl"
    trimesh.creation.icosphere(2, 0.1).export(path)
    link = shape_body("link_0", "link", "link", pp.Mesh(path, hull=True), pp.pose((0, 0, 0)))
    for shapes in (inner_shapes(link), shapes_in(mesh_of(trimesh.creation.box((0.2, 0.3, 0.1)), hollow=True))):
        assert shapes.balls.shape == (0, 4)
        assert shapes.corners.shape == (0, 3)
        assert shapes.box_half is None
    # A link's hull that is not from a file is exact, and a segment or a plate in it has no volume but a surface.
    cube = hull_body("link_1", "link", np.array(trimesh.creation.box((0.1, 0.1, 0.1)).vertices), pp.pose((0, 0, 0)))
    assert inner_shapes(cube).balls[0, 3] == pytest.approx(0.05, abs=2 * ROUNDING)
