"""Shapes as values, and distances of every kind of shape against other means, from outside, inside and in contact."""

from __future__ import annotations

import itertools
import pickle
from typing import get_args

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision import Cone, ConvexShape, Ellipsoid, HeightMap
from pinproof.collision.checking.placed_bodies import GJK_SLACK
from pinproof.collision.geometry.bodies import GEOMETRIES, shape_bodies, shape_body
from pinproof.collision.geometry.hulls import Solid
from pinproof.collision.geometry.shapes import Shape, cell_numbers
from pinproof.collision.geometry.surfaces import Ground, cell_faces, ground_surface
from pinproof.errors import MeshError

from ..examples import examples

TETRAHEDRON = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
OUTWARD = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]

ARRAYS = {
    "hull": lambda x=0.0: ConvexShape([*TETRAHEDRON, [x, 0, 2]]),
    "rounded": lambda x=0.0: ConvexShape(TETRAHEDRON[:2], 0.1 + x),
    "mesh": lambda x=0.0: pp.Mesh.from_arrays([*TETRAHEDRON[:3], [x, 0, 1]], OUTWARD),
    "cloud": lambda x=0.0: pp.PointCloud([[x, 0, 0], [1, 1, 1]], 0.1),
    "ground": lambda x=0.0: HeightMap([[0, x], [0, 0.1], [0, 0]], 1, 2, -1),
}


@pytest.mark.parametrize("kind", ARRAYS)
def test_equal_numbers_are_equal_shapes(kind):
    shape, same, other = ARRAYS[kind](), ARRAYS[kind](), ARRAYS[kind](1e-9)
    assert shape == same
    assert hash(shape) == hash(same)
    assert repr(shape) == repr(same)
    assert shape != other
    assert repr(shape) != repr(other)  # what a certificate is bound to
    assert len(repr(shape)) < 400
    assert pickle.loads(pickle.dumps(shape)) == shape
    assert pp.HalfSpace() == pp.HalfSpace()


@pytest.mark.parametrize("kind", ARRAYS)
def test_numbers_are_copied_and_cannot_be_changed(kind):
    shape = ARRAYS[kind]()
    for value in (*vars(shape).values(), *vars(pickle.loads(pickle.dumps(shape))).values()):
        if isinstance(value, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                value[0] = 0
    points = np.array(TETRAHEDRON)
    hull = ConvexShape(points)
    points[0] = 9
    assert hull == ConvexShape(TETRAHEDRON)


@pytest.mark.parametrize("value", [0.0, -1.0, 1e-9, float("nan"), float("inf"), 1e5, "wide", None])
def test_an_invalid_size_is_refused(value):
    for make in (
        pp.Sphere,
        lambda v: pp.Box(1, v, 1),
        lambda v: pp.Cylinder(0.1, v),
        lambda v: pp.Cylinder(v, 0.1),
        lambda v: Cone(v, 1),
        lambda v: Cone(1, v),
        lambda v: Ellipsoid(1, v, 1),
        lambda v: pp.PointCloud([[0, 0, 0]], v),
        lambda v: HeightMap([[0, 0], [0, 0]], v, 1),
    ):
        with pytest.raises(pp.InputError):
            make(value)


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: ConvexShape([]), "ConvexShape.points"),
        (lambda: ConvexShape([], 0.1), "ConvexShape.points"),
        (lambda: ConvexShape([[0, 0, 0]], -0.1), "ConvexShape.radius"),
        (lambda: ConvexShape([[0, 0, 0]], np.nan), "ConvexShape.radius"),
        (lambda: ConvexShape([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), "flat"),
        (lambda: ConvexShape([[0, 0, 0], [1, 0, 1], [1, 1, 1], [0, 1, 0]]), "flat"),
        (lambda: ConvexShape([*TETRAHEDRON, [0, 0, np.nan]]), "nan"),
        (lambda: ConvexShape([*TETRAHEDRON, [0, 0, 1e6]]), "10000 m"),
        (lambda: pp.PointCloud(np.empty((0, 3)), 0.1), "empty"),
        (lambda: pp.PointCloud([[0, 0]], 0.1), "shape"),
        (lambda: pp.PointCloud([[4.0, 0, 0]], 1e-6), "4 m from the origin need cells of 3.8e-06 m or more"),
        (lambda: pp.PointCloud([[-4.0, 0, 0]], 1e-6), "4 m from the origin need cells of 3.8e-06 m or more"),
        (lambda: ConvexShape([*TETRAHEDRON, [0, 0, -1e6]]), "10000 m"),
        (lambda: HeightMap([[0, 0]], 1, 1), "2 rows"),
        (lambda: HeightMap([[0, 0], [0, 1]], 1, 1, 0.0), "below the lowest point"),
        (lambda: HeightMap([[0, 0], [0, np.inf]], 1, 1), "inf"),
        (lambda: pp.Mesh.from_arrays(TETRAHEDRON, []), "triangles"),
        (lambda: pp.Mesh.from_arrays(TETRAHEDRON, [[0, 1, 4]]), "0 to 3"),
        (lambda: pp.Mesh.from_arrays(TETRAHEDRON, [[0, 1, -1]]), "0 to 3"),
        (lambda: pp.Mesh.from_arrays(TETRAHEDRON, [[0.5, 1, 2]]), "integers"),
        (lambda: pp.Mesh.from_arrays([[0, 0, np.nan]], [[0, 0, 0]]), "nan"),
        (lambda: pp.Mesh("part.stl", hull=True, hollow=True), "not both"),
        (lambda: pp.Mesh("part.stl", vertices=TETRAHEDRON, triangles=OUTWARD), "not both"),
        (lambda: pp.Mesh(None), "needs a path, or vertices"),
        (lambda: pp.Mesh(None, vertices=TETRAHEDRON), "needs a path, or vertices"),
        (lambda: pp.Mesh(None, triangles=OUTWARD), "needs a path, or vertices"),
        (lambda: pp.Obstacle("thing", "box"), "HalfSpace"),
        (lambda: pp.Mesh(None, 2.0, vertices=np.eye(4, 3), triangles=[[0, 1, 2]]), "scale"),
        *(
            (lambda s=scale: pp.Mesh("part.stl", s), "scale")
            for scale in (0.0, (1.0, 0.0, 1.0), np.inf, (1, 1, np.nan))
        ),
        # Wrong arguments are answered with the right call.
        (lambda: pp.Box([1, 1, 1]), r"Box\(x, y, z\)"),
        (lambda: pp.Box(1, 1, 1, 1), r"Box\(x, y, z\)"),
        (lambda: pp.Box(1, 1, [1]), "Box.z"),
        (lambda: pp.Sphere(r=0.1), r"Sphere\(radius\)"),
        (lambda: pp.Cylinder(0.1), r"Cylinder\(radius, length\)"),
        (lambda: pp.HalfSpace(0.1), r"HalfSpace\(\)"),
        (lambda: pp.Mesh("part.stl", size=2), r"Mesh\(path, scale"),
    ],
)
def test_invalid_shapes_are_refused(make, expected):
    with pytest.raises(pp.InputError, match=expected):
        make()


def test_the_default_bottom_of_a_height_map_is_below_it():
    assert HeightMap([[0.5, 1], [2, 3]], 1, 1).bottom == pytest.approx(0.49)
    assert HeightMap([[0.5, 1], [2, 3]], 1, 1, -2).bottom == -2.0


def test_a_point_cloud_contains_each_cell_once():
    cloud = pp.PointCloud([[0.01, 0.02, 0.03], [0.09, 0.09, 0.09], [-0.01, 0, 0], [0.1, 0, 0]], 0.1)
    assert cloud.cells.tolist() == [[-1, 0, 0], [0, 0, 0], [1, 0, 0]]


def test_any_of_many_numbers_distinguishes_shapes():
    """NumPy leaves the middle of large arrays out of its texts."""
    points = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
    moved = points.copy()
    moved[1000, 1] += 1e-6
    one, same, other = (ConvexShape(each) for each in (points, points.copy(), moved))
    assert (one, hash(one), repr(one)) == (same, hash(same), repr(same))
    assert one != other
    assert repr(one) != repr(other)


BALL = 0.01
"""The radius of the ball that the slider carries."""

HERE = pin.SE3.Identity()


# -- signed distances of a point by other means ------------------------------------------------------------------------


def to_triangles(point, corners) -> float:
    """The distance of a point to triangles (F, 3, 3): to their planes where it lies over them, else to their edges."""
    a, b, c = np.moveaxis(corners, 1, 0)
    best = np.inf
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        t = np.clip(np.einsum("ij,ij->i", point - start, along) / np.einsum("ij,ij->i", along, along), 0, 1)
        best = min(best, float(np.linalg.norm(start + t[:, None] * along - point, axis=1).min()))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    height = np.einsum("ij,ij->i", point - a, normal)
    foot = point - height[:, None] * normal
    over = np.all(
        [
            np.einsum("ij,ij->i", np.cross(end - start, foot - start), normal) >= 0
            for start, end in ((a, b), (b, c), (c, a))
        ],
        axis=0,
    )
    return min(best, float(np.abs(height[over]).min(initial=np.inf)))


def to_cells(point, low, high) -> float:
    """The distance of a point to boxes, 0 inside."""
    return float(np.linalg.norm(np.maximum(np.maximum(low - point, point - high), 0), axis=1).min())


def to_ellipsoid(point, axes) -> float:
    """By Lagrange's condition x_i = a_i^2 p_i / (a_i^2 + t) on the surface, solved for t by bisection; 0 inside."""
    if np.sum((point / axes) ** 2) <= 1:
        return 0.0
    low, high = 0.0, float(np.linalg.norm(point) * axes.max())
    for _ in range(200):
        t = (low + high) / 2
        low, high = (t, high) if np.sum((axes * point / (axes**2 + t)) ** 2) > 1 else (low, t)
    return float(np.linalg.norm(point - axes**2 * point / (axes**2 + high)))


def to_cone(point, radius, length) -> float:
    """In the half-plane through the axis the cone is a triangle; 0 inside."""
    rho = np.hypot(point[0], point[1])
    flat = np.array([rho, point[2], 0.0])
    tip, rim, middle = (np.array([x, z, 0.0]) for x, z in ((0, length / 2), (radius, -length / 2), (0, -length / 2)))
    return to_triangles(flat, np.array([[tip, middle, rim]]))


def l_shape() -> trimesh.Trimesh:
    """Two walls of a corner, as one closed surface."""
    outline = np.array([[0, 0], [0.3, 0], [0.3, 0.1], [0.1, 0.1], [0.1, 0.3], [0, 0.3]])
    top, under = (np.column_stack([outline, np.full(6, z)]) for z in (0.1, -0.1))
    caps = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    ring, on = np.arange(6), np.roll(np.arange(6), -1)
    sides = np.concatenate([np.column_stack([ring + 6, on + 6, on]), np.column_stack([ring + 6, on, ring])])
    return trimesh.Trimesh(
        np.concatenate([top, under]), np.concatenate([caps, caps[:, ::-1] + 6, sides]), process=False
    )


RNG = np.random.default_rng(5)
HULL_POINTS = RNG.normal(size=(30, 3)) * [0.2, 0.1, 0.05]
CLOUD = pp.PointCloud(RNG.uniform(-0.3, 0.3, (80, 3)), 0.05)
GROUND = HeightMap(RNG.uniform(0, 0.2, (5, 7)), 0.9, 0.6, -0.1)
CORNER = l_shape()


def corner_distance(point):
    low = np.array([[0, 0, -0.1], [0, 0, -0.1]])
    return to_cells(point, low, np.array([[0.3, 0.1, 0.1], [0.1, 0.3, 0.1]]))


def ground_prisms() -> list[trimesh.Trimesh]:
    """The ground as the union of prisms under its triangles, each cell cut by the higher of the two diagonals."""
    ny, nx = GROUND.heights.shape
    x, y = np.linspace(-0.45, 0.45, nx), np.linspace(-0.3, 0.3, ny)
    prisms = []
    for j, i in itertools.product(range(ny - 1), range(nx - 1)):
        a, b, c, d = (
            np.array([x[i + p], y[j + q], GROUND.heights[j + q, i + p]]) for p, q in ((0, 0), (1, 0), (1, 1), (0, 1))
        )
        for triangle in ([a, b, c], [a, c, d]) if a[2] + c[2] > b[2] + d[2] else ([a, b, d], [b, c, d]):
            under = np.array(triangle) * [1, 1, 0] + [0, 0, GROUND.bottom]
            prisms.append(trimesh.Trimesh(np.concatenate([triangle, under])).convex_hull)
    return prisms


PRISMS = [(np.array(prism.face_normals), np.array(prism.triangles)) for prism in ground_prisms()]
PLATE = np.array([[-0.2, -0.1, 0.1], [0.2, -0.05, -0.1], [0.0, 0.15, 0.0]])
ROD = np.array([[-0.2, -0.05, 0.1], [0.2, 0.05, -0.1]])
HULL = trimesh.Trimesh(HULL_POINTS).convex_hull
HULL_FACES = np.array(HULL.face_normals), np.array(HULL.triangles)


def to_convex(point, faces) -> float:
    """The distance of a point to a convex body by its faces, 0 inside."""
    normals, corners = faces
    inside = (np.einsum("ij,ij->i", normals, point - corners[:, 0]) <= 0).all()
    return 0.0 if inside else to_triangles(point, corners)


def to_segment(point, start, end) -> float:
    along = end - start
    return float(np.linalg.norm(start + np.clip((point - start) @ along / (along @ along), 0, 1) * along - point))


def to_union(point, bodies) -> float:
    """The distance of a point to convex bodies, 0 inside one of them."""
    inside = any((np.einsum("ij,ij->i", n, point - corners[:, 0]) <= 0).all() for n, corners in bodies)
    return 0.0 if inside else to_triangles(point, np.concatenate([corners for _, corners in bodies]))


KINDS = {
    "cone": (Cone(0.15, 0.3), lambda p: to_cone(p, 0.15, 0.3)),
    "flat cone": (Cone(0.3, 0.002), lambda p: to_cone(p, 0.3, 0.002)),
    "ellipsoid": (Ellipsoid(0.1, 0.2, 0.3), lambda p: to_ellipsoid(p, np.array([0.1, 0.2, 0.3]))),
    "needle": (Ellipsoid(0.002, 0.003, 0.3), lambda p: to_ellipsoid(p, np.array([0.002, 0.003, 0.3]))),
    "half-space": (pp.HalfSpace(), lambda p: max(p[2], 0.0)),
    "hull": (ConvexShape(HULL_POINTS), lambda p: to_convex(p, HULL_FACES)),
    "rounded hull": (pp.ConvexShape(HULL_POINTS, 0.04), lambda p: max(to_convex(p, HULL_FACES) - 0.04, 0.0)),
    "rounded plate": (pp.ConvexShape(PLATE, 0.05), lambda p: max(to_triangles(p, PLATE[[[0, 1, 2]]]) - 0.05, 0.0)),
    "tilted rod": (pp.ConvexShape(ROD, 0.06), lambda p: max(to_segment(p, *ROD) - 0.06, 0.0)),
    "mesh": (pp.Mesh.from_arrays(CORNER.vertices, CORNER.faces, hull=False), corner_distance),
    "cloud": (CLOUD, lambda p: to_cells(p, CLOUD.cells * 0.05, (CLOUD.cells + 1) * 0.05)),
    "ground": (GROUND, lambda p: to_union(p, PRISMS)),
}
SIZED = {
    "box": pp.Box(0.2, 0.3, 0.1),
    "sphere": pp.Sphere(0.1),
    "cylinder": pp.Cylinder(0.1, 0.2),
    "capsule": pp.Capsule(0.05, 0.2),
}
ALL = {**SIZED, **{name: shape for name, (shape, _) in KINDS.items()}}


@pytest.mark.parametrize("count", [20, 40, 200])
def test_many_points_on_a_line_or_in_a_plane_with_a_radius_are_not_replaced_by_a_box(slider, count):
    """A disc touches only within its own edge, not at the corners of the square around it."""
    angle, share = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False), np.linspace(0.0, 1.0, count)[:, None]
    ring = 0.2 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])
    fan = ring[[[0, i, i + 1] for i in range(1, count - 1)]]
    shapes = {
        "disc": (pp.ConvexShape(ring, 0.03), lambda p: to_triangles(p, fan)),
        "rod": (pp.ConvexShape(ROD[0] + share * (ROD[1] - ROD[0]), 0.03), lambda p: to_segment(p, *ROD)),
    }
    rng = np.random.default_rng(3)
    for shape, distance in shapes.values():
        for x in rng.uniform(-0.6, 0.6, 20):
            at = pp.pose(rng.uniform(-0.2, 0.2, 3), rng.uniform(-3, 3, 3))
            checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("thing", shape, at)]))
            expected = distance(at.actInv(np.array([x, 0, 0]))) - 0.03 - BALL
            assert checker.is_free([x]) == (expected > 0.0)
            if expected > 0.0:
                assert checker.clearance([x]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_distance_to_a_ball_equals_an_independent_formula(slider, kind):
    shape, distance = KINDS[kind]
    rng = np.random.default_rng(7)
    inside = outside = 0
    for _ in range(12):
        at = pp.pose(rng.uniform(-0.2, 0.2, 3), rng.uniform(-3, 3, 3))
        checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("thing", shape, at)]))
        for x in rng.uniform(-0.6, 0.6, 12):
            point = at.actInv(np.array([x, 0, 0]))
            expected, text = distance(point) - BALL, checker.clearance([x])
            if expected > GJK_SLACK:
                assert text == pytest.approx(expected, abs=GJK_SLACK)
                assert checker.is_free([x])
                outside += 1
            elif expected < -GJK_SLACK:
                assert text <= 0
                assert not checker.is_free([x])
                inside += 1
            margin = max(expected, 0) + 1e-3
            near = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("thing", shape, at)]), margin=margin)
            assert not near.is_free([x])
    assert outside > 30
    assert inside > 0 or "needle" in kind or "flat" in kind


INSIDE = {
    "box": lambda p: np.abs(p) <= [0.1, 0.15, 0.05],
    "sphere": lambda p: np.linalg.norm(p) <= 0.1,
    "cylinder": lambda p: np.array([np.hypot(*p[:2]) <= 0.1, abs(p[2]) <= 0.1]),
    "capsule": lambda p: np.linalg.norm(p - [0, 0, np.clip(p[2], -0.1, 0.1)]) <= 0.05,
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*KINDS, *SIZED])
def test_the_bounds_of_a_body_contain_it(kind):
    """No point nearer than the box, nor farther out than the support function, is at distance 0."""
    body = shape_body("thing", "thing", None, ALL[kind], HERE)
    inside = (lambda p: KINDS[kind][1](p) <= 0) if kind in KINDS else (lambda p: np.all(INSIDE[kind](p)))
    points = np.random.default_rng(2).uniform(-0.4, 0.4, (500, 3))
    if kind in SIZED:
        points = np.concatenate([points, np.random.default_rng(4).uniform(*body.box, (1500, 3))])
    held = np.array([p for p in points if inside(p)]).reshape(-1, 3)
    assert ((held >= body.box[0]) & (held <= body.box[1])).all()
    if body.support is not None and len(held):
        for u in np.random.default_rng(3).normal(size=(30, 3)):
            u /= np.linalg.norm(u)
            farthest = (held @ u).max()
            assert farthest <= body.support.reach(u) + 1e-12
            assert kind not in SIZED or farthest >= body.support.reach(u) - 0.03  # and it is no idle bound


def test_numbers_of_a_support_function_cannot_be_changed():
    for shape, _ in KINDS.values():
        for body in shape_bodies("thing", None, shape, HERE):
            if (support := body.support) is not None:
                assert not any(each.flags.writeable for each in (support.points, support.disc_radii, support.semi_axes))


@given(
    st.tuples(*[st.floats(1e-3, 2)] * 3), st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda u: np.linalg.norm(u) > 0.1)
)
def test_supports_of_cones_and_ellipsoids_are_reached_and_never_passed(sizes, direction):
    u = np.array(direction) / np.linalg.norm(direction)
    angles = np.linspace(0, 2 * np.pi, 721)
    rim = np.column_stack([sizes[0] * np.cos(angles), sizes[0] * np.sin(angles), np.full(721, -sizes[1] / 2)])
    cone = np.vstack([rim, [0, 0, sizes[1] / 2]])
    axes = np.array(sizes)
    farthest = axes**2 * u / np.linalg.norm(axes * u)  # where the gradient of the ellipsoid points along u
    assert np.sum((farthest / axes) ** 2) == pytest.approx(1)
    for shape, reached in ((Cone(*sizes[:2]), float((cone @ u).max())), (Ellipsoid(*sizes), float(farthest @ u))):
        reach = shape_body("thing", "thing", None, shape, HERE).support.reach(u)
        assert reached <= reach + 1e-12
        assert reached >= reach * (1 - 1e-4) - 1e-4 * max(sizes)


@pytest.mark.parametrize("carried", [name for name in ALL if name != "half-space"])
def test_every_kind_is_checked_against_every_other(slider, carried):
    """Far apart it is free, in one place it is not, and a margin that closes the gap is contact."""
    for name, shape in ALL.items():
        tool = [pp.Obstacle("tool", ALL[carried], pp.pose((0, 0, 0.5)))]
        scene = pp.Scene([pp.Obstacle("thing", shape, pp.pose((0, 0, 0.5)))], allowed=[("ball", "thing")])
        checker = pp.CollisionChecker(slider, scene, attached=tool)
        assert not checker.is_free([0.0])
        assert checker.clearance([0.0]) <= 0
        assert checker.check([0.0]).contacts[0].bodies == ("tool", "thing")
        if name == "half-space":
            continue
        gap = checker.clearance([2.0])
        assert 1.0 < gap < 2.0
        assert checker.is_free([2.0])
        contact = pp.CollisionChecker(slider, scene, attached=tool, margin=gap + 1e-5).check([2.0]).contacts[0]
        assert np.linalg.norm(np.diff(contact.points, axis=0)) == pytest.approx(gap, abs=1e-5)
        assert pp.CollisionChecker(slider, scene, attached=tool, margin=gap - 1e-5).is_free([2.0])


def test_every_kind_survives_pickle(slider):
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle(name, shape) for name, shape in ALL.items()]))
    copy = pickle.loads(pickle.dumps(checker))
    assert copy.fingerprint() == checker.fingerprint()
    assert [copy.clearance([x]) for x in (-1.0, 0.0, 0.7)] == [checker.clearance([x]) for x in (-1.0, 0.0, 0.7)]


def test_the_fingerprint_depends_on_every_number():
    def content(shape):
        return shape_body("thing", "thing", None, shape, HERE).content()

    heights = GROUND.heights.copy()
    heights[0, 0] += 1e-9
    shapes = [
        *ALL.values(),
        Cone(0.15, 0.3 + 1e-9),
        Ellipsoid(0.1, 0.2, 0.3 + 1e-9),
        HeightMap(heights, 0.9, 0.6, -0.1),
        pp.Mesh.from_arrays(CORNER.vertices, CORNER.faces, hull=False, hollow=True),
    ]
    assert len({content(shape) for shape in shapes}) == len(shapes)


# -- inside ------------------------------------------------------------------------------------------------------------

ROOM = trimesh.creation.box((4, 4, 4))


@pytest.mark.parametrize("kind", [name for name in ALL if name != "half-space"])
def test_a_body_inside_a_mesh_is_in_contact(slider, kind):
    """Of the two, either may be carried."""
    room = pp.Mesh.from_arrays(ROOM.vertices / 2, ROOM.faces, hull=False)
    for thing, tool in ((room, ALL[kind]), (ALL[kind], room)):
        scene = pp.Scene([pp.Obstacle("thing", thing)], allowed=[("ball", "thing")])
        checker = pp.CollisionChecker(slider, scene, attached=[pp.Obstacle("tool", tool)])
        assert not checker.is_free([0.0])
        assert checker.clearance([0.0]) < 0
        assert checker.is_free([7.0])


def test_the_depth_inside_a_large_mesh_is_that_to_its_surface_and_needs_no_tree_of_coal(slider):
    vertices, faces = ROOM.vertices / 2, ROOM.faces
    for _ in range(6):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    room = pp.Mesh.from_arrays(vertices, faces, hull=False)
    checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("room", room)]))
    assert checker.clearance([0.5]) == pytest.approx(-(0.5 - 0.01), abs=2e-6)
    (contact,) = checker.check([0.995]).contacts
    assert contact.depth == pytest.approx(0.005, abs=2e-6)
    (body,) = (body for body in checker.bodies if body.owner == "room")
    assert "made" not in vars(body.model)


def test_one_of_many_islands_of_a_cloud_inside_is_enough(slider):
    islands = pp.PointCloud([[10, 0, 0], [20, 0, 0], [1, 1, 1], [30, 0, 0]], 0.1)
    room = pp.Mesh.from_arrays(ROOM.vertices, ROOM.faces, hull=False)
    checker = pp.CollisionChecker(
        slider,
        pp.Scene([pp.Obstacle("room", room)], allowed=[("ball", "room")]),
        attached=[pp.Obstacle("tool", islands)],
    )
    assert not checker.is_free([0.0])
    assert checker.is_free([5.0])


def overlapping(turned: bool) -> trimesh.Trimesh:
    """Two boxes that share a part, the second with its triangles outwards or inwards."""
    boxes = [trimesh.creation.box((0.4, 0.4, 0.4)), trimesh.creation.box((0.3, 0.3, 0.3))]
    boxes[1].apply_translation((0.2, 0, 0))
    if turned:
        boxes[1].invert()
    return trimesh.util.concatenate(boxes)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("inverted", [False, True])
def test_overlapping_parts_are_solid_in_any_orientation(slider, turned, inverted):
    mesh = overlapping(turned)
    if inverted:
        mesh.invert()
    checker = pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle("two", pp.Mesh.from_arrays(mesh.vertices, mesh.faces, hull=False))])
    )
    for x in (-0.1, 0.0, 0.12, 0.3):  # in the first, in both (where the winding numbers cancel), in the second
        assert not checker.is_free([x])
    assert checker.is_free([0.37])


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("low", [(0.1, 0.1, 0.1), (0.1, 0.1, 0.0)])
def test_bodies_that_share_a_corner_or_edges_are_solid_in_any_orientation(low, inverted):
    """A box in a corner of another; inverted, its winding numbers cancel those of the other."""
    outer = trimesh.creation.box(bounds=[(0, 0, 0), (0.4, 0.4, 0.4)])
    inner = trimesh.creation.box(bounds=[low, (0.4, 0.4, 0.4)])
    if inverted:
        inner.invert()
    both = trimesh.util.concatenate([outer, inner])
    solid = Solid(np.array(both.vertices), np.array(both.faces))
    assert solid.watertight
    assert len(solid.witnesses) == len(solid.solids) == 2
    assert solid.contains(np.array([[0.2, 0.25, 0.22]]))  # in both
    assert solid.contains(np.array([[0.05, 0.25, 0.22]]))  # in the outer one alone


def test_bodies_inside_cavities():
    """A box in the cavity of a box is solid; the cavity about it is not, in any orientation."""
    sides = (1.0, 0.8, 0.6, 0.4, 0.2)
    for flip in (False, True):
        boxes = [trimesh.creation.box((s, s, s)) for s in sides]
        for k, box in enumerate(boxes):
            if (k % 2 == 1) != flip:
                box.invert()
        nested = trimesh.util.concatenate(boxes)
        solid = Solid(np.array(nested.vertices), np.array(nested.faces))
        assert solid.watertight
        wanted = {0.45: True, 0.35: False, 0.25: True, 0.15: False, 0.05: True}
        assert {x: solid.contains(np.array([[x, 0.001, 0.002]])) for x in wanted} == wanted
        assert len(solid.solids) == 1  # the bodies cannot be separated from the cavities


@pytest.mark.slow
@given(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4), st.floats(-0.2, 0.3))
@examples(300)
def test_the_ground_contains_the_points_inside_its_closed_surface(x, y, z):
    vertices, triangles = ground_surface(GROUND)
    surface = Solid(vertices, triangles)
    assert surface.watertight
    point = np.array([x, y, z])
    if to_triangles(point, vertices[triangles]) > 1e-9:
        assert Ground(GROUND).contains(point[None]) == surface.contains(point[None])


@pytest.mark.parametrize("rows", range(2, 6))
@pytest.mark.parametrize("columns", range(2, 6))
def test_grounds_of_any_number_of_rows_are_closed_and_contain_what_is_below_them(rows, columns):
    rng = np.random.default_rng(10 * rows + columns)
    shape = HeightMap(rng.uniform(0, 0.3, (rows, columns)), 1.0, 0.8, -0.1)
    vertices, triangles = ground_surface(shape)
    surface, ground = Solid(vertices, triangles), Ground(shape)
    assert surface.watertight
    assert np.linalg.det(surface.corners).sum() > 0
    points = rng.uniform([-0.55, -0.45, -0.12], [0.55, 0.45, 0.3], (120, 3))
    expected = [surface.contains(point[None]) for point in points]
    assert [ground.contains(point[None]) for point in points] == expected
    assert 0 < sum(expected) < len(points)


def test_numbers_of_cells_are_different_everywhere_in_the_grid():
    ends = np.array([-(2**20) + 2, -1, 0, 1, 2**20 - 2])
    cells = np.array(np.meshgrid(ends, ends, ends)).reshape(3, -1).T
    assert len(np.unique(cell_numbers(cells))) == len(cells)
    cloud = pp.PointCloud((cells + 0.5) * 0.005, 0.005)
    assert {tuple(cell) for cell in cloud.cells} == {tuple(cell) for cell in cells}


def test_the_ground_covers_both_triangulations_of_its_cells():
    heights = np.array([[0.0, 0.2], [0.2, 0.0]])
    ground = Ground(HeightMap(heights, 1, 1))
    assert ground.contains(np.array([[0.0, 0.0, 0.199]]))  # over the middle: between the two high corners
    assert ground.contains(np.array([[0.2, 0.2, 0.119]]))
    assert not ground.contains(np.array([[0.0, 0.0, 0.201]]))


def test_the_surface_of_a_cloud_is_closed_and_as_large_as_its_cells():
    vertices, triangles = cell_faces(CLOUD)
    mesh = trimesh.Trimesh(vertices, triangles, process=True)
    assert mesh.volume == pytest.approx(len(CLOUD.cells) * 0.05**3)


def test_a_mesh_of_arrays_that_is_open_is_refused():
    with pytest.raises(MeshError, match="not watertight"):
        shape_body("a", "a", None, pp.Mesh.from_arrays(CORNER.vertices, CORNER.faces[1:], hull=False), HERE)
    with pytest.raises(MeshError, match="flat"):
        shape_body("a", "a", None, pp.Mesh.from_arrays(CORNER.vertices[:6], CORNER.faces[:4], hull=True), HERE)
    with pytest.raises(MeshError, match="flat"):
        shape_bodies("a", None, pp.Mesh.from_arrays(CORNER.vertices[:6], CORNER.faces[:4]), HERE)


@pytest.mark.filterwarnings("ignore::pinproof.errors.UnitWarning")
@pytest.mark.parametrize("size", [1e-6, 1e-4, 1.0, 1e3])
def test_sizes_from_a_micrometre_to_a_kilometre(slider, size):
    """The gap to a ball is right at every size that is allowed, to the rounding of that size."""
    for shape, half in ((Cone(size, size), size), (Ellipsoid(size, size, size), size), (pp.Sphere(size), size)):
        at = pp.pose((size + 0.2, 0, size / 2 if isinstance(shape, Cone) else 0))  # the disc of the cone lies in z = 0
        checker = pp.CollisionChecker(slider, pp.Scene([pp.Obstacle("thing", shape, at)]))
        assert checker.clearance([0.0]) == pytest.approx(0.2 + size - half - BALL, abs=max(GJK_SLACK, 1e-8 * size))


def test_reach_is_homogeneous_and_takes_many_directions() -> None:
    support = shape_body("thing", "thing", None, pp.Cylinder(radius=0.1, length=0.4), HERE).support
    many = np.random.default_rng(0).normal(size=(4, 5, 3))
    found = support.reach(many)
    assert found.shape == (4, 5)
    np.testing.assert_allclose(support.reach(3.0 * many), 3.0 * found, atol=1e-12)
    np.testing.assert_allclose(found[2, 3], support.reach(many[2, 3]), atol=1e-15)
    assert float(support.reach(np.zeros(3))) == 0.0


def test_every_shape_is_registered_and_an_unknown_one_is_refused():
    assert {*GEOMETRIES, ConvexShape} == set(get_args(Shape))
    with pytest.raises(pp.InputError, match="object"):
        shape_body("thing", "thing", None, object(), pp.pose((0, 0, 0)))


def test_a_half_space_cannot_be_attached_to_a_link(slider):
    with pytest.raises(pp.InputError, match="'floor' is a HalfSpace"):
        pp.CollisionChecker(slider, attached=[pp.Obstacle("floor", pp.HalfSpace())])


# -- bodies of a support mapping ---------------------------------------------------------------------------------------


def of_ellipsoid(axes):
    return lambda d: axes**2 * d / np.linalg.norm(axes * d)


def of_points(points):
    return lambda d: points[(points @ d).argmax()]


CUBE = np.array(list(itertools.product((-0.1, 0.1), repeat=3)))
MAPPINGS = {
    "ellipsoid": of_ellipsoid(np.array([0.1, 0.2, 0.05])),
    "needle": of_ellipsoid(np.array([0.002, 0.3, 0.002])),
    "cube": of_points(CUBE),
    "tilted hull": of_points(HULL_POINTS + np.array([0.3, -1.0, 0.2])),
    "segment": of_points(PLATE[:2]),
    "point": of_points(PLATE[:1]),
    "hull and ball": lambda d: of_points(HULL_POINTS)(d) + 0.03 * d,
    "cylinder": lambda d: np.array([*(0.1 * d[:2] / max(np.hypot(*d[:2]), 1e-300)), np.copysign(0.2, d[2])]),
}


@pytest.mark.parametrize(
    ("kind", "error"), [*((kind, 5e-3) for kind in MAPPINGS), ("needle", 1e-3), ("tilted hull", 1e-4)]
)
def test_a_shape_of_a_support_mapping_contains_the_body_and_is_within_the_error(kind: str, error: float) -> None:
    """In every direction the extent is that of the body, or larger by at most the error."""
    mapping = MAPPINGS[kind]
    shape = pp.ConvexShape.from_support(mapping, error=error)
    rng = np.random.default_rng(2)
    directions = np.concatenate(
        [rng.normal(size=(4000, 3)), rng.integers(-1, 2, (200, 3)) + 1e-9 * rng.normal(size=(200, 3))]
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    exact = np.array([d @ mapping(d) for d in directions])
    excess = (directions @ shape.points.T).max(axis=1) + shape.radius - exact
    assert excess.min() >= 0
    assert excess.max() <= error + 1e-8
    assert shape.radius <= error + 1e-8


def test_a_body_that_reaches_the_point_where_planes_meet_is_inside_too() -> None:
    """The farthest points along the axes are the centres of the faces of a cube, and nothing is asked beyond."""
    asked = []

    def farthest(d):
        asked.append(d)
        return 0.1 * np.sign(d)

    shape = pp.ConvexShape.from_support(farthest, error=0.12)
    assert len(asked) == 6
    corner = np.ones(3) / np.sqrt(3)
    assert (shape.points @ corner).max() + shape.radius >= 0.1 * np.sqrt(3)
    assert shape.radius == pytest.approx(0.2 / np.sqrt(3), abs=1e-6)


def test_a_body_of_few_points_has_no_more_points() -> None:
    shape = pp.ConvexShape.from_support(of_points(CUBE), error=1e-3)
    assert {tuple(point) for point in shape.points.tolist()} == {tuple(point) for point in CUBE.tolist()}


def test_a_mapping_to_points_that_are_not_the_farthest_is_refused(monkeypatch) -> None:
    monkeypatch.setattr("pinproof.collision.geometry.shapes.MOST_DIRECTIONS", 1000)
    with pytest.raises(pp.InputError, match=r"farthest\(\[.*\]\) is not the farthest point"):
        pp.ConvexShape.from_support(lambda d: -of_points(CUBE)(d), error=1e-2)
    with pytest.raises(pp.InputError, match="more than 1000 directions"):
        pp.ConvexShape.from_support(of_ellipsoid(np.ones(3)), error=1e-6)
    with pytest.raises(pp.InputError, match="farthest"):
        pp.ConvexShape.from_support(lambda d: np.zeros(2), error=1e-2)


def test_directions_that_fall_into_one_plane_are_refused_by_the_error():
    above = np.random.default_rng(1).normal(size=(8, 3)) * 0.2
    plate = (np.concatenate([above, above + np.array([0, 0, 1e-5])]) * [1, 1, 1e-3]).round(8)
    with pytest.raises(pp.InputError, match=r"error = 0\.0001 m"):
        pp.ConvexShape.from_support(lambda d: plate[np.argmax(plate @ d)], error=1e-4)
