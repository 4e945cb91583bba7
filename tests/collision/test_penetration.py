"""How deep one body is inside another, against formulas, dense points, and the disjointness of the displaced bodies."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

import pinproof as pp
from pinproof.collision.checking.penetration import BRACKET, Penetration, crossing_depth, penetration
from pinproof.collision.geometry.bodies import Body
from pinproof.spatial import SE3, translated

from .test_line_surface import surface_of

NONE = np.empty((0, 3))
MOST = 1e-3


def mesh_of(mesh: trimesh.Trimesh, **settings) -> pp.Mesh:
    return pp.Mesh.from_arrays(np.array(mesh.vertices), np.array(mesh.faces), **settings)


def depth(one: pp.Shape, at: SE3, other: pp.Shape, most: float = MOST, directions: np.ndarray = NONE) -> Penetration:
    return penetration(surface_of(one), at, surface_of(other), SE3.Identity(), directions, most)


SQUARE = trimesh.creation.box((0.1, 0.1, 0.1))
CLOSED = trimesh.boolean.difference([SQUARE, trimesh.creation.box((0.096, 0.096, 0.096))], engine="manifold")
"""A closed box with walls of 2 mm."""

CORNER = trimesh.boolean.union(
    [
        trimesh.creation.box(bounds=[[-0.01, -0.01, -0.01], [0.1, 0.1, 0.0]]),
        trimesh.creation.box(bounds=[[-0.01, -0.01, -0.01], [0.0, 0.1, 0.1]]),
        trimesh.creation.box(bounds=[[-0.01, -0.01, -0.01], [0.1, 0.0, 0.1]]),
    ],
    engine="manifold",
)
"""Three walls that meet in a corner at the origin."""

ROD = pp.Cylinder(radius=0.004, length=0.2)


@pytest.mark.parametrize(
    ("one", "at", "other", "expected"),
    [
        (pp.Sphere(0.02), (0, 0, 0.05), pp.Sphere(0.04), 0.01),
        (pp.Sphere(0.02), (0, 0, 0.02), pp.Box(0.2, 0.2, 0.1), 0.05),
        (pp.Sphere(0.01), (0.03, 0, 0), pp.Cylinder(0.05, 0.2), 0.03),
        (pp.Sphere(0.01), (0.0, 0, 0.09), pp.Cylinder(0.05, 0.2), 0.02),
        (pp.Box(0.02, 0.02, 0.02), (0.03, 0.025, 0), pp.Box(0.06, 0.06, 0.06), 0.01),
        (ROD, (0.02, 0, 0.08), pp.Box(0.1, 0.1, 0.1), 0.034),
        (ROD, (0.0, 0, 0.145), pp.Box(0.1, 0.1, 0.1), 0.005),
        (ROD, (0.0, 0, 0.0), pp.Box(0.1, 0.1, 0.001), 0.054),
        (pp.Capsule(0.01, 0.1), (0, 0, 0.0995), pp.Box(0.1, 0.1, 0.1), 0.0105),
        (pp.collision.Cone(0.02, 0.04), (0, 0, 0.06), pp.Box(0.1, 0.1, 0.1), 0.01),
        (pp.collision.Ellipsoid(0.02, 0.03, 0.01), (0, 0, 0.055), pp.Box(0.1, 0.1, 0.1), 0.005),
        (pp.Box(0.02, 0.02, 0.02), (0, 0, 0.0601), pp.Box(0.1, 0.1, 0.1), 0.0),
        (pp.Box(0.02, 0.02, 0.02), (0, 0, 0.06), pp.Box(0.1, 0.1, 0.1), 0.0),
    ],
)
def test_depth_of_convex_bodies_is_that_of_the_formula(one, at, other, expected) -> None:
    found = depth(one, pp.pose(at), other)
    assert found.depth == pytest.approx(expected, abs=2 * BRACKET)
    if expected > MOST:
        assert found.least == pytest.approx(expected, abs=2 * BRACKET)
        assert found.clearance < 0.0
    else:
        assert found.clearance > 0.0
        assert found.clearance >= MOST - expected - 1e-6 or expected == 0.0


def random_solid(rng: np.random.Generator) -> tuple[pp.Shape, trimesh.Trimesh]:
    a, b, c = rng.uniform(0.01, 0.05, 3).tolist()
    kind = rng.integers(4)
    if kind == 0:
        return pp.Box(a, b, c), trimesh.creation.box((a, b, c))
    if kind == 1:
        return pp.Sphere(a), trimesh.creation.icosphere(3, a)
    if kind == 2:
        return pp.Cylinder(a, b), trimesh.creation.cylinder(a, b, sections=64)
    hull = trimesh.convex.convex_hull(rng.normal(size=(12, 3)) * [a, b, c])
    return pp.collision.ConvexShape(np.array(hull.vertices)), hull


def support(shape: pp.Shape, mesh: trimesh.Trimesh, directions: np.ndarray) -> np.ndarray:
    """(K,) the extent of a shape along directions, by formulas that the package does not use."""
    if isinstance(shape, pp.Sphere):
        return np.full(len(directions), shape.radius)
    if isinstance(shape, pp.Cylinder):
        return shape.radius * np.hypot(*directions[:, :2].T) + shape.length / 2 * np.abs(directions[:, 2])
    return (directions @ np.array(mesh.vertices).T).max(axis=1)


def test_bracket_of_convex_bodies_contains_the_least_width_over_dense_directions() -> None:
    rng, seen = np.random.default_rng(3), 0
    directions = rng.normal(size=(20000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for _ in range(60):
        (one, mesh), (other, other_mesh) = random_solid(rng), random_solid(rng)
        at = pp.pose(rng.normal(0, 0.02, 3), rng.uniform(-3, 3, 3))
        found = depth(one, at, other)
        width = support(other, other_mesh, directions) + support(one, mesh, -directions @ at.rotation)
        width = float((width - directions @ at.translation).min())
        if found.depth <= MOST:
            assert width > 0.0 or found.depth == 0.0
            continue
        seen += 1
        assert found.least <= width + 1e-9
        assert width - 2e-3 <= found.depth <= width + 1e-9
        assert found.depth - found.least <= 1e-5
    assert seen > 25


@pytest.mark.slow
@pytest.mark.parametrize("kinds", ["solid mesh", "mesh solid", "mesh mesh"])
def test_meshes_of_convex_bodies_are_as_deep_as_the_bodies(kinds: str) -> None:
    """Each pair is moved until a millimetre or less remains, so that the separation matters."""
    rng, seen, excess = np.random.default_rng(5), {True: 0, False: 0}, []
    for _ in range(24):
        meshes = [random_solid(rng)[1] for _ in range(2)]
        solids = [pp.collision.ConvexShape(np.array(mesh.vertices)) for mesh in meshes]
        at = pp.pose(rng.normal(0, 0.015, 3), rng.uniform(-3, 3, 3))
        deep = depth(solids[0], at, solids[1], 1e-6)
        if deep.depth == 0.0:
            continue
        left = float(rng.choice([0.0004, 0.0008, 0.0012, 0.003]))
        at = translated(at, deep.by / np.linalg.norm(deep.by) * (deep.depth - left))
        true = depth(solids[0], at, solids[1])
        several = zip(kinds.split(), meshes, solids, strict=True)
        one, other = (mesh_of(mesh) if how == "mesh" else solid for how, mesh, solid in several)
        found = depth(one, at, other)
        assert (found.clearance > 0.0) == (true.clearance > 0.0)
        assert found.depth >= true.depth - 2e-5
        assert found.least <= true.depth
        seen[true.clearance > 0.0] += 1
        excess.append(found.depth - true.depth)
    assert min(seen.values()) > 4
    assert np.median(excess) < 1e-4


def test_a_body_inside_a_mesh_that_it_does_not_touch_is_deep() -> None:
    block = mesh_of(SQUARE)
    for one in (pp.Sphere(0.005), pp.Box(0.01, 0.01, 0.01), mesh_of(trimesh.creation.box((0.01, 0.01, 0.01)))):
        found = depth(one, pp.pose((0.0, 0.0, 0.02)), block)
        assert found.depth == pytest.approx(0.035, abs=2e-5)
        assert found.clearance <= 0.0
    around = depth(mesh_of(SQUARE), pp.pose((0, 0, 0.02)), pp.Sphere(0.005))
    assert around.depth == pytest.approx(0.035, abs=2e-5)


def test_an_open_mesh_holds_what_most_of_it_surrounds() -> None:
    open_box = SQUARE.copy()
    open_box.update_faces(open_box.face_normals[:, 2] > -0.5)
    assert not open_box.is_watertight
    found = depth(pp.Sphere(0.005), pp.pose((0.0, 0.0, 0.02)), mesh_of(open_box))
    assert found.clearance <= 0.0
    assert found.depth > 0.03
    rng, solid, hollow = np.random.default_rng(2), mesh_of(SQUARE), mesh_of(open_box)
    for at in (*rng.uniform(-0.04, 0.04, (6, 3)), *rng.uniform(0.06, 0.2, (6, 3)) * rng.choice([-1, 1], (6, 3))):
        turned = pp.pose(at, rng.uniform(-3, 3, 3))
        closed, open_one = (depth(pp.Box(0.006, 0.004, 0.008), turned, each) for each in (solid, hollow))
        assert (open_one.clearance > 0.0) is (closed.clearance > 0.0) is bool(np.abs(at).max() > 0.05)
        if closed.clearance > 0.0:
            assert open_one.clearance == pytest.approx(closed.clearance)


@pytest.mark.parametrize("inserted", [0.003, 0.02, 0.06, 0.097])
def test_a_rod_through_a_thin_lid_is_as_deep_as_it_is_inserted(inserted: float) -> None:
    for one in (ROD, mesh_of(trimesh.creation.cylinder(0.004, 0.2))):
        found = depth(one, pp.pose((0.0, 0.0, 0.15 - inserted)), mesh_of(CLOSED))
        assert found.depth == pytest.approx(min(inserted, 0.054), abs=3e-5)
        assert found.clearance <= 0.0


def test_a_box_in_a_corner_leaves_it_by_one_displacement_from_all_walls() -> None:
    """Each of three walls is 0.5 mm deep, so the displacement is sqrt(3) times as long."""
    for one in (pp.Box(0.02, 0.02, 0.02), mesh_of(trimesh.creation.box((0.02, 0.02, 0.02)))):
        at = pp.pose((0.0095, 0.0095, 0.0095))
        found = depth(one, at, mesh_of(CORNER))
        assert found.clearance > 0.0
        assert 0.0005 * np.sqrt(3) - 1e-6 <= found.depth <= MOST
        assert depth(one, at, mesh_of(CORNER), 0.0008).clearance <= 0.0


def test_a_depth_along_one_direction_ignores_shorter_ways_out() -> None:
    up = np.array([[0.0, 0.0, 1.0]])
    rod, block = surface_of(ROD), surface_of(pp.Box(0.02, 0.02, 0.1))
    at = pp.pose((0.0, 0.0, 0.11))
    along = penetration(rod, at, block, SE3.Identity(), up, MOST, only=True)
    assert along.depth == pytest.approx(0.04, abs=2e-5)
    assert along.least == along.depth
    assert penetration(rod, at, block, SE3.Identity(), up, MOST).depth == pytest.approx(0.014, abs=2e-6)


def test_the_displacement_separates_the_bodies() -> None:
    rng, seen = np.random.default_rng(8), 0
    for _ in range(40):
        one, mesh = random_solid(rng)
        other = CORNER if rng.random() < 0.5 else CLOSED
        direction = rng.normal(size=3)
        at = pp.pose(0.06 * direction / np.linalg.norm(direction), rng.uniform(-3, 3, 3))
        found = depth(one, at, mesh_of(other), 0.01)
        if found.clearance <= 0.0:
            continue
        seen += 1
        assert np.linalg.norm(found.by) == pytest.approx(0.01) or not found.by.any()
        moved = mesh.copy().apply_transform(translated(at, found.by).homogeneous)
        common = trimesh.boolean.intersection([moved, other], engine="manifold")
        assert len(common.faces) == 0 or common.volume < 1e-15
    assert seen > 8


def test_meshes_that_cross_deeper_than_a_displacement_remain_in_contact() -> None:
    rng, count = np.random.default_rng(7), 0
    shapes = [trimesh.creation.torus(0.2, 0.05, 24, 12), trimesh.creation.box((0.3, 0.2, 0.02)), SQUARE, CORNER]
    open_box = trimesh.Trimesh(SQUARE.vertices, SQUARE.faces[:-2])
    bodies = [surface_of(mesh_of(shape, hull=False)).body for shape in shapes]
    bodies.append(surface_of(mesh_of(open_box, hull=False, hollow=True)).body)
    while count < 60:
        i, j = (int(k) for k in rng.integers(0, len(bodies), 2))
        at = pp.pose(rng.uniform(-0.2, 0.2, 3), rng.uniform(-3, 3, 3))
        deep = crossing_depth(bodies[i], at.homogeneous, bodies[j], np.eye(4))
        meet = surfaces_meet(bodies[i], at, bodies[j])
        assert meet or deep == 0.0
        if deep < 1e-4:
            continue
        count += 1
        for _ in range(30):
            # Every point moves by less than the depth: a displacement, and a rotation about the middle.
            axis, share = rng.normal(size=3), rng.random()
            size = np.linalg.norm(bodies[i].geometry.vertices(), axis=1).max()
            turned = at * SE3(pin.exp3(share * deep / size * axis / np.linalg.norm(axis)), np.zeros(3))
            by = rng.normal(size=3)
            moved = translated(turned, (1 - share) * deep * 0.999 * by / np.linalg.norm(by))
            assert surfaces_meet(bodies[i], moved, bodies[j])


def surfaces_meet(one: Body, at: SE3, other: Body) -> bool:
    """Whether surfaces meet, by coal's contact query, which is not that of distances."""
    placed, fixed = coal.Transform3s(at.rotation, at.translation), coal.Transform3s.Identity()
    return bool(
        coal.collide(one.geometry, placed, other.geometry, fixed, coal.CollisionRequest(), coal.CollisionResult())
    )


def test_the_depth_of_a_rib_in_a_block_is_known_as_far_as_its_edges_reach() -> None:
    """A rib of 20 mm that reaches 6 mm into a block: moved out by 6 mm, it touches no longer."""
    rib, block = trimesh.creation.box((0.004, 0.1, 0.02)), trimesh.creation.box((0.05, 0.05, 0.05))
    bodies = [surface_of(mesh_of(shape, hull=False)).body for shape in (rib, block)]
    at = pp.pose((0.003, 0.001, -0.025 - 0.01 + 0.006))
    assert crossing_depth(bodies[0], at.homogeneous, bodies[1], np.eye(4)) == pytest.approx(0.006)
    assert crossing_depth(bodies[1], np.eye(4), bodies[0], at.homogeneous) == pytest.approx(0.006)
    apart = pp.pose((0, 0, -0.0351))
    assert crossing_depth(bodies[0], apart.homogeneous, bodies[1], np.eye(4)) == 0.0
