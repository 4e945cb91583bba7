"""The core measures triangle meshes: its bounds are those of coal, for bodies of every kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import pinproof as pp
from pinproof import _core
from pinproof.collision.checking.placed_bodies import GJK_SLACK, MeasureByCoal
from pinproof.collision.geometry.bodies import Body, one_inside_other, shape_bodies, shape_body
from pinproof.collision.geometry.hulls import Solid, winding_number
from pinproof.spatial import SE3

from .test_line_surface import mesh_of

HERE = np.eye(4)


def joined(*parts: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(parts)


def moved(part: trimesh.Trimesh, xyz: tuple[float, ...], *, inverted: bool = False) -> trimesh.Trimesh:
    part = part.copy()
    part.apply_translation(xyz)
    if inverted:
        part.invert()
    return part


CUBE, SMALL = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((0.2, 0.3, 0.4))
L_PROFILE = trimesh.creation.extrude_polygon(
    trimesh.path.polygons.Polygon([(0, 0), (1, 0), (1, 0.1), (0.1, 0.1), (0.1, 1), (0, 1)]), 0.5
)
MESHES = {
    "cube": mesh_of(CUBE),
    "torus": mesh_of(trimesh.creation.torus(0.4, 0.1, 24, 12)),
    "ball": mesh_of(trimesh.creation.icosphere(2, 0.4)),
    "profile": mesh_of(L_PROFILE),
    "two parts": mesh_of(joined(moved(SMALL, (0.4, 0, 0)), moved(SMALL, (-0.4, 0.1, 0)))),
    "overlapping parts": mesh_of(joined(CUBE, moved(CUBE, (0.3, 0.2, 0.1)))),
    "cavity": mesh_of(joined(CUBE, moved(SMALL, (0.05, 0, 0), inverted=True))),
    "inverted": mesh_of(moved(CUBE, (0, 0, 0), inverted=True)),
    "thin plate": mesh_of(trimesh.creation.box((1.0, 0.8, 1e-4))),
    "open": mesh_of(trimesh.Trimesh(CUBE.vertices, CUBE.faces[:-2]), hollow=True),
}
ROUND = {
    "box": pp.Box(0.2, 0.1, 0.3),
    "sphere": pp.Sphere(0.08),
    "point": pp.Sphere(1e-6),
    "capsule": pp.Capsule(0.04, 0.3),
    "cylinder": pp.Cylinder(0.1, 0.2),
    "cone": pp.collision.Cone(0.1, 0.2),
    "ellipsoid": pp.collision.Ellipsoid(0.1, 0.05, 0.2),
    "hull": mesh_of(trimesh.creation.icosphere(1, 0.1), hull=True),
    "half-space": pp.HalfSpace(),
}


def body_of(shape: pp.Shape) -> Body:
    return shape_body("b", "b", None, shape, pp.pose())


def space_of(one: Any, other: Any, at: np.ndarray, margin: float = 0.0) -> _core.Workspace:
    """Two shapes of the core; ``at`` is the placement of the second in the frame of the first."""
    joint = _core.Joint(before=HERE, prismatic=True, index=0, multiplier=1.0, offset=0.0)
    robot, obstacles = [_core.Body(one, 0, HERE)], _core.Obstacles([_core.Body(other, -1, at)])
    geometry = _core.Geometry(_core.JointTree([joint], 1), robot, obstacles, 1e-12)
    space = _core.Workspace(_core.World(geometry, _core.PairTable(geometry, np.array([[0, 1]])), np.array([margin])))
    space.place(np.zeros(1))
    return space


def core_bounds(one: Body, other: Body, at: np.ndarray) -> tuple[float, float]:
    """Lower and upper bound of the distance."""
    lower, upper, *_ = space_of(one.core_shape, other.core_shape, at).measure(0)
    return lower, upper


def is_farther(one: Body, other: Body, at: np.ndarray, margin: float) -> bool:
    """Whether the core proves a distance larger than the margin (m)."""
    result = space_of(one.core_shape, other.core_shape, at, margin).judge(np.zeros(1))
    assert result in (_core.FREE, _core.CONTACT)
    return bool(result == _core.FREE)


def coal_distance(one: Body, other: Body, at: np.ndarray) -> float:
    """The distance of the surfaces, 0 if they overlap or one is inside the other."""
    found = MeasureByCoal()(one, HERE, other, at).attained
    return 0.0 if found <= 0 or one_inside_other(one, pp.pose(), other, pin.SE3(at)) else found


def placements(rng: np.random.Generator, count: int, reach: float) -> list[np.ndarray]:
    return [SE3(pp.pose(rng.uniform(-reach, reach, 3), rng.uniform(-3, 3, 3))).homogeneous for _ in range(count)]


@pytest.mark.parametrize("mesh", MESHES)
def test_the_bounds_of_a_mesh_enclose_the_distance_of_coal_for_bodies_of_every_kind(mesh: str) -> None:
    rng, one, overlaps = np.random.default_rng(len(mesh)), body_of(MESHES[mesh]), 0
    for name, shape in {**ROUND, **MESHES}.items():
        other = body_of(shape)
        for at in placements(rng, 25, 1.2):
            lower, upper = core_bounds(one, other, at)
            expected = coal_distance(one, other, at)
            overlaps += expected == 0
            assert lower <= expected + GJK_SLACK, (mesh, name)
            assert upper >= expected - GJK_SLACK, (mesh, name)
            assert upper - lower <= 1e-8 or upper == 0, (mesh, name)
            if shape is not ROUND["half-space"]:
                back = np.asarray(np.linalg.inv(at))
                assert core_bounds(other, one, back)[1] == pytest.approx(upper, abs=1e-8)
            for margin in (0.5 * upper, 1.5 * upper + 1e-3):
                assert is_farther(one, other, at, margin) is (lower > margin), (mesh, name)
    assert overlaps > 20


def test_triangles_without_an_area_are_the_segments_that_they_are() -> None:
    """Coal's distances of such triangles are wrong."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0.5, 0, 0), (0, 0, 1), (1, 1e-9, 0)])
    mesh = pp.Mesh.from_arrays(corners, np.array([(0, 1, 2), (0, 3, 3), (0, 1, 4)]), hull=False, hollow=True)
    one, box = body_of(mesh), np.array([[0.0, 0, 0], [1, 1, 1]])
    ends = [corners[[0, 1]], corners[[0, 3]]]
    segments = [_core.Shape.convex(both, np.zeros(2), 0.0, np.zeros(3), box) for both in ends]
    rng = np.random.default_rng(0)
    for name, shape in ROUND.items():
        other = body_of(shape)
        for at in placements(rng, 25, 1.2):
            lower, upper = core_bounds(one, other, at)
            parts = [space_of(segment, other.core_shape, at).measure(0) for segment in segments]
            assert lower <= min(part[1] for part in parts) + 1e-8, name
            assert upper >= min(part[0] for part in parts) - 1e-8, name
            assert upper - lower <= 1e-8 or upper == 0, name


RAY = np.array([0.0712, 0.1239, 0.9897])
"""The first direction in which the core sends a ray."""


@pytest.mark.parametrize("mesh", MESHES)
def test_a_point_is_inside_a_mesh_where_its_winding_number_is_not_zero(mesh: str) -> None:
    rng, body = np.random.default_rng(1), body_of(MESHES[mesh])
    solid = body.solid
    assert isinstance(solid, Solid)
    corners = solid.corners.reshape(-1, 3)
    edges = (corners + np.roll(corners, 1, axis=0)) / 2
    behind = np.concatenate([corners, edges])[:300] - rng.uniform(0.01, 0.5, (min(300, 2 * len(corners)), 1)) * RAY
    centre, half = body.box.mean(axis=0), (body.box[1] - body.box[0]) / 2
    points = np.concatenate([centre + rng.uniform(-1.05, 1.05, (500, 3)) * half, behind])
    expected = [solid.watertight and abs(winding_number(point, solid.corners)) > 0.5 for point in points]
    assert body.core_shape.contains(points).tolist() == expected
    assert solid.contains(points) is any(expected)
    assert solid.watertight is any(expected)


def test_a_body_is_in_contact_with_each_part_of_a_solid_that_it_is_inside() -> None:
    ball = body_of(pp.Sphere(0.01))
    for mesh, inside, outside in (
        ("cube", [(0, 0, 0)], [(0.6, 0, 0)]),
        ("inverted", [(0, 0, 0)], [(0.6, 0, 0)]),
        ("two parts", [(0.4, 0, 0), (-0.4, 0.1, 0)], [(0, 0, 0)]),
        ("overlapping parts", [(0.2, 0.1, 0.05), (-0.4, -0.4, -0.4), (0.7, 0.6, 0.5)], [(0.7, 0.6, -0.45)]),
        ("cavity", [(0.3, 0, 0)], [(0.05, 0, 0), (0.6, 0, 0)]),
        ("open", [], [(0, 0, 0), (0.6, 0, 0)]),
    ):
        for places, overlap in ((inside, True), (outside, False)):
            for xyz in places:
                bounds = core_bounds(body_of(MESHES[mesh]), ball, pp.pose(xyz).homogeneous)
                assert (bounds == (0.0, 0.0)) is overlap, (mesh, xyz)
                # A small mesh is inside like a ball, and a margin changes nothing.
                dust, back = body_of(mesh_of(trimesh.creation.icosphere(1, 0.01))), pp.pose(-np.array(xyz)).homogeneous
                for margin in (0.0, 1e-3, 0.02):
                    assert is_farther(dust, body_of(MESHES[mesh]), back, margin) is not overlap, (mesh, xyz)


@pytest.mark.parametrize("offset", [1e-3, 1e-6, 1e-8])
def test_bodies_that_nearly_touch_a_mesh_have_tight_bounds(offset: float) -> None:
    rng, ball = np.random.default_rng(3), body_of(pp.Sphere(0.05))
    for mesh in ("cube", "torus", "profile", "thin plate", "open"):
        body = body_of(MESHES[mesh])
        assert isinstance(body.solid, Solid)
        for corners in body.solid.corners[rng.permutation(len(body.solid.corners))[:40]]:
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            normal /= np.linalg.norm(normal)
            for point in (corners[0], corners.mean(axis=0), corners[:2].mean(axis=0)):
                lower, upper = core_bounds(body, ball, pp.pose(point + (0.05 + offset) * normal).homogeneous)
                assert lower <= offset + 1e-12
                assert upper - lower <= 1e-9 or upper == 0.0


@pytest.mark.parametrize("seed", range(12))
def test_the_parts_of_a_surface_are_those_that_its_edges_join(seed: int) -> None:
    """Random triangles of few vertices, among them doubled points, and edges of up to seven triangles."""
    rng = np.random.default_rng(seed)
    points = rng.integers(-1, 2, (12, 3)) * rng.choice([-0.0, 1.0], (12, 3))
    first = _core.first_equal_points(points)
    assert first.tolist() == [int(np.flatnonzero((points == p).all(axis=1))[0]) for p in points]
    faces = np.array([rng.choice(7, 3, replace=False) for _ in range(rng.integers(1, 16))])
    if seed % 3 == 0:
        faces = np.concatenate([np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]) + 4 * k for k in range(3)])
        faces[-4:] = faces[:4] if seed % 2 else faces[-4:, ::-1]
    sides: dict[tuple[int, ...], list[tuple[int, bool]]] = {}
    for f, (a, b, c) in enumerate(faces.tolist()):
        for low, high in ((a, b), (b, c), (c, a)):
            sides.setdefault((min(low, high), max(low, high)), []).append((f, low < high))
    label = list(range(len(faces)))
    for found in sides.values():
        if len(found) == 2 and found[0][1] != found[1][1]:
            low, high = sorted((label[found[0][0]], label[found[1][0]]))
            label = [low if one == high else one for one in label]
    closed = all(
        [up for f, up in found if label[f] == part] in ([True, False], [False, True])
        for found in sides.values()
        for part in {label[f] for f, _ in found}
    )
    parts, is_closed = _core.surface_parts(faces)
    assert parts.tolist() == [sorted(set(label)).index(one) for one in label]
    assert is_closed is closed


def test_a_mesh_of_many_triangles_is_exact_and_coal_reads_it_only_when_asked(monkeypatch) -> None:
    monkeypatch.setattr("pinproof.collision.geometry.bodies.MOST_TRIANGLES", 300)
    (body,) = shape_bodies("ball", None, mesh_of(trimesh.creation.icosphere(2, 0.37), hull=None), pp.pose())
    assert body.is_exact
    assert body.solid is not None
    assert body.solid.watertight
    assert "because it has 320 of them" in body.remark
    assert "made" not in vars(body.model)
    assert body.geometry.num_tris == 320
    assert body.unchanged
    body.geometry.vertices()[0] += 1e-3
    assert not body.unchanged


KINDS = [*ROUND.values(), *(MESHES[name] for name in ("torus", "ball", "two parts", "cavity"))]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", ["ur5", "stanford"])
def test_certified_edges_among_bodies_of_every_kind_are_free(name: str, seed: int) -> None:
    """Samples by coal, and the proof that measures each pair, of which the other one leaves out most."""
    rng, arm = np.random.default_rng(seed), pp.load_robot(name).arm()
    at = rng.normal(size=(int(rng.choice([1, 8, 60, 200])), 3))
    at *= (rng.uniform(0.6, 1.5, len(at)) / np.linalg.norm(at, axis=1))[:, None]
    kinds = rng.integers(len(KINDS), size=len(at))
    kinds[1:][kinds[1:] == list(ROUND).index("half-space")] = 0
    poses = [pp.pose(x, rng.uniform(-3, 3, 3)) for x in at]
    scene = pp.Scene([pp.Obstacle(f"o{i}", KINDS[kinds[i]], pose) for i, pose in enumerate(poses)])
    checker = pp.CollisionChecker(arm, scene, margin=float(rng.choice([0.0, 0.01])))
    lower, upper = arm.limits.sampling_range()
    starts = rng.uniform(np.maximum(lower, -np.pi), np.minimum(upper, np.pi), (400, arm.dof))
    geometry = checker.geometry_model
    data, model_data = geometry.createData(), arm.model.createData()
    free = 0
    for start in starts[checker.is_free_batch(starts)][:12]:
        offsets = rng.normal(size=(2, arm.dof)) * rng.choice([0.05, 0.3, 1.0])
        curve = pp.JointPath(start + np.array([0 * start, *offsets]), arm.joint_names)
        certificate = pp.certify(curve, checker, limits=None)
        assert certificate.free or not pp.certify(curve, checker, limits=None, record=True).free
        if not certificate.free:
            continue
        free += 1
        assert certificate.observed >= certificate.clearance > checker.margin
        samples = curve(np.linspace(*curve.domain, 30))
        assert checker.clearance_batch(samples).min() >= certificate.clearance - 1e-9
        for q in samples:
            pin.updateGeometryPlacements(arm.model, model_data, geometry, data, arm.model_configuration(q))
            assert not any(pin.computeCollision(geometry, data, k) for k in range(len(geometry.collisionPairs)))
    assert free or len(at) > 8


@pytest.mark.parametrize("reach", [0.02, 0.1, 0.4])
def test_no_short_edge_that_ends_in_contact_is_free(reach: float) -> None:
    """Both as a quick proof and with figures: most obstacles are far from such an edge and left out."""
    rng, arm = np.random.default_rng(3), pp.load_robot("ur5").arm()
    at = rng.normal(size=(60, 3))
    at *= (rng.uniform(1.0, 1.5, 60) / np.linalg.norm(at, axis=1))[:, None]
    shapes = [KINDS[k] for k in rng.integers(len(KINDS), size=60) if KINDS[k] is not ROUND["half-space"]]
    places = [pp.pose(x, rng.uniform(-3, 3, 3)) for x in at[: len(shapes)]]
    named = zip(shapes, places, strict=True)
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle(f"o{i}", *each) for i, each in enumerate(named)]))
    ends, judged = rng.uniform(-3, 3, (20_000, arm.dof)), 0
    starts = ends + reach * rng.uniform(-1, 1, ends.shape)
    enters = checker.is_free_batch(starts) & ~checker.is_free_batch(ends)
    for start, hit in list(zip(starts[enters], ends[enters], strict=True))[:80]:
        judged += 1
        curve = pp.JointPath(np.array([start, hit, start]), arm.joint_names)
        state = _core.ProofState()
        settings = _core.ProofSettings(tolerance=1e-4, max_intervals=2000)
        for each in (curve, pp.JointPath(np.array([start, hit]), arm.joint_names)):
            knots, control = (np.ascontiguousarray(part) for part in each.bezier())
            assert not _core.prove(checker.world, knots, control, settings, np.zeros(arm.dof), state).free
            assert not pp.certify(each, checker, limits=None).free
    assert judged > 20
