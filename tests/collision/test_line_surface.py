"""Lines that enter bodies, against dense points on the lines and the sign of a function that is negative inside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof._core import enter_triangles
from pinproof.collision import Cone, ConvexShape, Ellipsoid, OccupancyGrid
from pinproof.collision.checking.line_surface import (
    TOUCH,
    LineSurface,
    body_distance,
    depth_along,
    outer_points,
    point_distance,
    travel_to_touch,
)
from pinproof.collision.geometry.inner_shapes import spiral_directions
from pinproof.errors import InputError
from pinproof.spatial import SE3, Array, translated

from ..examples import examples

Implicit = Callable[[Array], Array]

HULL = trimesh.convex.convex_hull(np.random.default_rng(1).normal(size=(12, 3)) * [0.05, 0.1, 0.2])
CROSS = trimesh.boolean.union(
    [trimesh.creation.box((0.3, 0.2, 0.1)), trimesh.creation.box((0.1, 0.2, 0.3))], engine="manifold"
)
STEP = 4e-4


def box(x: float, y: float, z: float, middle: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Implicit:
    return lambda p: (np.abs(p - middle) - np.array([x, y, z]) / 2).max(axis=-1)


def cylinder(p: Array) -> Array:
    return np.maximum(np.hypot(p[..., 0], p[..., 1]) - 0.1, np.abs(p[..., 2]) - 0.15)


def capsule(p: Array) -> Array:
    return np.linalg.norm(p - np.clip(p * [0, 0, 1], -0.15, 0.15), axis=-1) - 0.1


def cone(p: Array) -> Array:
    across = np.hypot(p[..., 0], p[..., 1])
    return np.maximum(-p[..., 2] - 0.15, (0.3 * across + 0.1 * (p[..., 2] - 0.15)) / np.hypot(0.3, 0.1))


def hull(p: Array) -> Array:
    return (p @ HULL.face_normals.T - (HULL.face_normals * HULL.triangles[:, 0]).sum(axis=1)).max(axis=-1)


def union(*parts: Implicit) -> Implicit:
    return lambda p: np.min([part(p) for part in parts], axis=0)


CELLS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [-2, 0, 1], [1, 0, 1]])
CASES: dict[str, tuple[pp.Shape, Implicit]] = {
    "box": (pp.Box(0.2, 0.3, 0.1), box(0.2, 0.3, 0.1)),
    "sphere": (pp.Sphere(0.1), lambda p: np.linalg.norm(p, axis=-1) - 0.1),
    "cylinder": (pp.Cylinder(0.1, 0.3), cylinder),
    "capsule": (pp.Capsule(0.1, 0.3), capsule),
    "cone": (Cone(0.1, 0.3), cone),
    "ellipsoid": (Ellipsoid(0.1, 0.2, 0.05), lambda p: np.linalg.norm(p / [0.1, 0.2, 0.05], axis=-1) - 1.0),
    "convex hull": (ConvexShape(HULL.vertices), hull),
    "mesh": (
        pp.Mesh.from_arrays(CROSS.vertices, CROSS.faces, hull=False),
        union(box(0.3, 0.2, 0.1), box(0.1, 0.2, 0.3)),
    ),
    "cells": (
        pp.PointCloud((CELLS + 0.5) * 0.08, 0.08),
        union(*(box(0.08, 0.08, 0.08, tuple((cell + 0.5) * 0.08)) for cell in CELLS)),
    ),
    "grid": (
        OccupancyGrid(np.array([[[1, 0], [1, 1]]]), 0.08, (0, -1, 0)),
        union(*(box(0.08, 0.08, 0.08, tuple((np.array(c) + 0.5) * 0.08)) for c in ((0, -1, 0), (0, 0, 0), (0, 0, 1)))),
    ),
}
TRIANGLES = ("mesh", "cells", "grid")


def mesh_of(mesh: trimesh.Trimesh, **settings: bool) -> pp.Mesh:
    return pp.Mesh.from_arrays(np.array(mesh.vertices), np.array(mesh.faces), **{"hull": False, **settings})


def surface_of(shape: pp.Shape) -> LineSurface:
    return LineSurface.of_obstacle(pp.Obstacle("body", shape))


def lines(seed: int, count: int) -> tuple[Array, Array]:
    """Origins around bodies of 0.2 m, and one direction, which is an axis for the first seeds."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3) if seed > 3 else np.roll([(-1.0) ** seed, 0, 0], seed)
    return rng.uniform(-0.2, 0.2, (count, 3)), direction / np.linalg.norm(direction)


def crossings(implicit: Implicit, origin: Array, direction: Array) -> tuple[Array, Array]:
    """The depths at which a line crosses a surface, and whether it is inside at the beginning of each step."""
    depths = np.arange(-0.7, 0.7, STEP)
    inside = implicit(origin + depths[:, None] * direction) < 0
    crossed = np.flatnonzero(inside[1:] != inside[:-1])
    return depths[crossed] + STEP / 2, inside[crossed + 1]


def gradient(implicit: Implicit, points: Array) -> Array:
    slopes = [implicit(points + 1e-7 * axis) - implicit(points - 1e-7 * axis) for axis in np.eye(3)]
    return np.stack(slopes, axis=-1) / np.linalg.norm(slopes, axis=0)[:, None]


@pytest.mark.parametrize("name", CASES)
def test_lines_enter_a_body_where_dense_points_do(name):
    shape, implicit = CASES[name]
    surface, exact = surface_of(shape), name != "cone"
    hits = 0
    for seed in range(9):
        origins, direction = lines(seed, 12)
        depth, normals = surface.enter(origins, direction)
        assert depth.shape == (12,)
        for k, origin in enumerate(origins):
            crossed, entering = crossings(implicit, origin, direction)
            if len(crossed) and crossed[-1] - crossed[0] < 0.01:
                continue  # grazes an edge
            expected = crossed[0] if len(crossed) else np.inf
            assert depth[k] == pytest.approx(expected, abs=STEP if exact else 5e-4)
            if not len(crossed):
                continue
            hits += 1
            # A line that begins inside a mesh meets it where it leaves; one that begins within a convex body enters it
            # before, and does not meet it after it has left.
            leaving = crossed[~entering]
            for start in (crossed[0] + 0.004, crossed[-1] + 2e-3):
                later = surface.enter(origins[k : k + 1], direction, np.array([start])).depth[0]
                if name in TRIANGLES:
                    wanted = crossed[crossed > start].min(initial=np.inf)
                    assert later == pytest.approx(wanted, abs=STEP) or abs(crossed - start).min() < 2 * STEP
                else:
                    assert later == pytest.approx(depth[k] if start < leaving[0] else np.inf)
        met = np.isfinite(depth)
        found = gradient(implicit, (origins + np.where(met, depth, 0)[:, None] * direction)[met] - 1e-6 * direction)
        assert np.linalg.norm(normals[met], axis=1) == pytest.approx(1.0)
        aligned = (found * normals[met]).sum(axis=1)
        assert (aligned > (1 - 1e-6 if exact else 0.999)).mean() > 0.95  # at an edge there are two normals
        assert (normals[met] @ direction < 0).all()
    assert hits > 15


@pytest.mark.parametrize("name", CASES)
def test_the_reach_is_that_of_dense_points_and_outer_points_contain_the_body(name):
    shape, implicit = CASES[name]
    surface = surface_of(shape)
    axis = np.linspace(-0.25, 0.25, 51)
    grid = np.array(np.meshgrid(axis, axis, axis)).reshape(3, -1).T
    inside = grid[implicit(grid) <= 0]
    directions = spiral_directions(60)
    reaches = surface.reaches(directions)
    dense = (inside @ directions.T).max(axis=0)
    assert (reaches >= dense - 1e-9).all()
    assert (reaches <= dense + 0.018).all()
    assert [surface.reach(direction) for direction in directions[:3]] == pytest.approx(reaches[:3], abs=1e-15)
    outer = (outer_points(surface) @ directions.T).max(axis=0)
    rounding = {"sphere": 0.1 * 0.74, "capsule": 0.1 * 0.74, "ellipsoid": 0.12, "cylinder": 0.002, "cone": 0.002}
    assert (outer >= reaches - 1e-12).all()
    assert (outer <= reaches + rounding.get(name, 1e-12)).all()


@pytest.mark.parametrize("name", CASES)
def test_the_depth_along_a_line_is_that_below_the_first_surface(name):
    shape, implicit = CASES[name]
    surface, tolerance = surface_of(shape), STEP if name != "cone" else 5e-4
    depths = []
    for seed in range(40):
        (point,), direction = lines(seed, 1)
        crossed, entering = crossings(implicit, point, direction)
        if len(crossed) and np.abs(np.diff([*crossed, 0.0])).min() < 0.01:
            continue
        before = crossed[entering]
        expected = max(-before.min(initial=0.0), 0.0) if name in TRIANGLES or (crossed >= 0).any() else None
        if expected is not None:
            assert depth_along(surface, point, direction, 0.7) == pytest.approx(expected, abs=tolerance)
            depths.append(expected)
        # A line that begins inside a mesh.
        if name in TRIANGLES and implicit(point - 0.02 * direction) < -0.004:
            entered = before[before < -0.02].max()
            assert depth_along(surface, point, direction, 0.02) == pytest.approx(-entered, abs=tolerance)
    assert 0 < np.count_nonzero(depths) < len(depths)


def test_a_body_travels_until_it_is_within_the_touch_distance():
    ball, block = surface_of(pp.Sphere(0.03)), surface_of(pp.Box(0.2, 0.3, 0.1))
    gaps = box_distance = lambda p: np.linalg.norm(np.maximum(np.abs(p) - [0.1, 0.15, 0.05], 0), axis=-1) - 0.03
    rng = np.random.default_rng(0)
    turned = pp.pose((0.1, 0.2, 0.3), rpy=(0.3, -0.4, 0.5))
    kinds = set()
    for _ in range(60):
        start, motion = rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.5, 0.5, 3)
        at = turned * SE3(np.eye(3), start)
        share = travel_to_touch(ball, at, block, turned, turned.rotation @ motion)
        shares = np.linspace(0.0, 1.0, 4001)
        near = gaps(start + shares[:, None] * motion) <= TOUCH
        expected = np.nan if near[0] else shares[near.argmax()] if near.any() else 1.0
        kinds.add("inside" if near[0] else "touches" if near.any() else "passes")
        assert share == pytest.approx(expected, abs=5e-4, nan_ok=True)
        apart = body_distance(ball, at, block, turned)
        assert (apart == pytest.approx(box_distance(start), abs=1e-6)) or (apart < 0 and box_distance(start) < 0)
    assert kinds == {"inside", "touches", "passes"}
    touching = SE3(np.eye(3), np.array([0.13, 0.0, 0.0]))
    assert np.isnan(travel_to_touch(ball, touching, block, SE3.Identity(), np.array([0.1, 0.0, 0.0])))
    assert travel_to_touch(ball, translated(touching, np.ones(3)), block, SE3.Identity(), np.zeros(3)) == 1.0


@pytest.mark.parametrize("name", ["box", "sphere", "cylinder", "mesh", "capsule"])
def test_the_distance_of_a_point_is_that_of_the_nearest_dense_point_of_the_surface(name):
    shape, implicit = CASES[name]
    surface = surface_of(shape)
    rng = np.random.default_rng(2)
    dense = np.concatenate([origins + depth[:, None] * d for origins, d, depth in _entered(surface)])
    for point in rng.uniform(-0.2, 0.2, (30, 3)):
        nearest = np.linalg.norm(dense - point, axis=1).min()
        distance = point_distance(surface, point)
        if implicit(point) > 1e-4:
            assert nearest - 0.012 < distance < nearest + 1e-5
        elif name in ("box", "cylinder", "sphere"):
            assert distance == pytest.approx(-implicit(point), abs=1e-9)
        else:  # the least along some directions
            assert -implicit(point) - 1e-6 < distance < 1.5 * nearest + 1e-3


def _entered(surface: LineSurface) -> list[tuple[Array, Array, Array]]:
    rng = np.random.default_rng(3)
    found = []
    for direction in spiral_directions(60):
        origins = rng.uniform(-0.25, 0.25, (200, 3))
        depth = surface.enter(origins, direction).depth
        found.append((origins[np.isfinite(depth)], direction, depth[np.isfinite(depth)]))
    return found


def test_a_body_inside_a_mesh_overlaps_it_and_one_inside_a_surface_does_not():
    shell = trimesh.creation.box((0.3, 0.3, 0.3))
    closed, hollow = (surface_of(mesh_of(shell, hollow=hollow)) for hollow in (False, True))
    ball, here = surface_of(pp.Sphere(0.02)), SE3.Identity()
    assert body_distance(ball, here, closed, here) == body_distance(closed, here, ball, here) < -0.1
    assert body_distance(ball, here, hollow, here) == pytest.approx(0.13, abs=1e-5)


def test_a_half_space_has_no_bounded_surface():
    with pytest.raises(InputError, match="bounded"):
        surface_of(pp.HalfSpace())


def first_triangles(corners: Array, origins: Array, direction: Array, start: Array) -> tuple[Array, Array]:
    """Every line against every triangle, by the equations of the planes and of the edges."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals / np.where(lengths == 0.0, np.inf, lengths)[:, None]
    slope = normals @ direction
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = ((corners[:, 0] - origins[:, None]) * normals).sum(axis=-1) / slope
        points = origins[:, None] + depths[..., None] * direction
        sides = [
            (np.cross(corners[:, (k + 1) % 3] - corners[:, k], points - corners[:, k]) * normals).sum(axis=-1)
            for k in range(3)
        ]
        on = (np.min(sides, axis=0) >= 0) & (np.abs(slope) > 1e-12) & (depths >= start[:, None])
    depths = np.where(on, depths, np.inf)
    first = depths.argmin(axis=1)
    depth = depths[np.arange(len(origins)), first]
    facing = np.where((slope > 0)[:, None], -normals, normals)[first]
    return depth, np.where(np.isfinite(depth)[:, None], facing, 0.0)


@examples(60)
@given(seed=st.integers(0, 2**32 - 1))
def test_lines_meet_the_first_of_any_triangles(seed: int) -> None:
    """Random triangles, among them flat and parallel ones, and lines through and beside them."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(rng.integers(0, 60), 3, 3)) * rng.choice([0.2, 1.0])
    direction = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    direction /= np.linalg.norm(direction)
    if len(corners) > 4:
        corners[0, 1] = corners[0, 2]  # no area
        corners[1, 2] = corners[1, 1] + direction  # parallel to the lines
    origins = rng.normal(size=(rng.integers(0, 200), 3))
    start = np.where(rng.random(len(origins)) < 0.5, -np.inf, rng.normal(size=len(origins)))
    depth, normals = enter_triangles(corners, origins, direction, start)
    if len(corners) == 0:
        assert (depth == np.inf).all()
        assert not normals.any()
        return
    expected, facing = first_triangles(corners, origins, direction, start)
    np.testing.assert_allclose(depth, expected, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(normals, facing, atol=1e-9)


@pytest.mark.parametrize("points", [[[0, -0.1, 0.05], [0, 0.1, -0.05]], [[0, 0, 0], [0.2, 0, 0], [0, 0.1, 0]]])
def test_lines_meet_a_rounded_body_within_three_percent_of_its_radius(points: list) -> None:
    radius, corners = 0.04, np.array(points)
    surface = surface_of(pp.ConvexShape(corners, radius))
    shares = np.random.default_rng(0).dirichlet(np.full(len(corners), 0.5), 40_000)
    within = np.concatenate([corners, shares @ corners])
    for direction in spiral_directions(60):
        entered = corners.mean(axis=0) + surface.enter(corners.mean(axis=0)[None], direction).depth[0] * direction
        away = np.linalg.norm(within - entered, axis=1).min()
        assert radius - 1e-9 <= away <= 1.03 * radius + 3e-4
