"""Shapes as values: what is refused, and that equal numbers are equal shapes."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from pinproof import Box, Cylinder, HalfSpace, InputError, Mesh, Obstacle, PointCloud, Sphere
from pinproof.collision import Cone, ConvexHull, Ellipsoid, HeightMap

TETRAHEDRON = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
OUTWARD = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]

ARRAYS = {
    "hull": lambda x=0.0: ConvexHull([*TETRAHEDRON, [x, 0, 2]]),
    "mesh": lambda x=0.0: Mesh.from_arrays([*TETRAHEDRON[:3], [x, 0, 1]], OUTWARD),
    "cloud": lambda x=0.0: PointCloud([[x, 0, 0], [1, 1, 1]], 0.1),
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


@pytest.mark.parametrize("kind", ARRAYS)
def test_numbers_are_copied_and_cannot_be_changed(kind):
    shape = ARRAYS[kind]()
    for value in (*vars(shape).values(), *vars(pickle.loads(pickle.dumps(shape))).values()):
        if isinstance(value, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                value[0] = 0
    points = np.array(TETRAHEDRON)
    hull = ConvexHull(points)
    points[0] = 9
    assert hull == ConvexHull(TETRAHEDRON)


@pytest.mark.parametrize("value", [0.0, -1.0, 1e-9, float("nan"), float("inf"), 1e5, "wide", None])
def test_an_invalid_size_is_refused(value):
    for make in (
        Sphere,
        lambda v: Box(1, v, 1),
        lambda v: Cylinder(0.1, v),
        lambda v: Cylinder(v, 0.1),
        lambda v: Cone(v, 1),
        lambda v: Cone(1, v),
        lambda v: Ellipsoid(1, v, 1),
        lambda v: PointCloud([[0, 0, 0]], v),
        lambda v: HeightMap([[0, 0], [0, 0]], v, 1),
    ):
        with pytest.raises(InputError):
            make(value)


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: ConvexHull([]), "ConvexHull.points"),
        (lambda: ConvexHull([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), "flat"),
        (lambda: ConvexHull([[0, 0, 0], [1, 0, 1], [1, 1, 1], [0, 1, 0]]), "flat"),
        (lambda: ConvexHull([*TETRAHEDRON, [0, 0, np.nan]]), "nan"),
        (lambda: ConvexHull([*TETRAHEDRON, [0, 0, 1e6]]), "10000 m"),
        (lambda: PointCloud(np.empty((0, 3)), 0.1), "empty"),
        (lambda: PointCloud([[0, 0]], 0.1), "shape"),
        (lambda: PointCloud([[4.0, 0, 0]], 1e-6), "4 m from the origin need cells of 3.8e-06 m or more"),
        (lambda: PointCloud([[-4.0, 0, 0]], 1e-6), "4 m from the origin need cells of 3.8e-06 m or more"),
        (lambda: ConvexHull([*TETRAHEDRON, [0, 0, -1e6]]), "10000 m"),
        (lambda: HeightMap([[0, 0]], 1, 1), "2 rows"),
        (lambda: HeightMap([[0, 0], [0, 1]], 1, 1, 0.0), "below the lowest point"),
        (lambda: HeightMap([[0, 0], [0, np.inf]], 1, 1), "inf"),
        (lambda: Mesh.from_arrays(TETRAHEDRON, []), "triangles"),
        (lambda: Mesh.from_arrays(TETRAHEDRON, [[0, 1, 4]]), "0 to 3"),
        (lambda: Mesh.from_arrays(TETRAHEDRON, [[0, 1, -1]]), "0 to 3"),
        (lambda: Mesh.from_arrays(TETRAHEDRON, [[0.5, 1, 2]]), "integers"),
        (lambda: Mesh.from_arrays([[0, 0, np.nan]], [[0, 0, 0]]), "nan"),
        (lambda: Mesh("part.stl", hull=True, hollow=True), "not both"),
        (lambda: Mesh("part.stl", vertices=TETRAHEDRON, triangles=OUTWARD), "not both"),
        (lambda: Mesh(None), "needs a path, or vertices"),
        (lambda: Mesh(None, vertices=TETRAHEDRON), "needs a path, or vertices"),
        (lambda: Mesh(None, triangles=OUTWARD), "needs a path, or vertices"),
        (lambda: Obstacle("thing", "box"), "HalfSpace"),
    ],
)
def test_invalid_shapes_are_refused(make, expected):
    with pytest.raises(InputError, match=expected):
        make()


def test_the_default_bottom_of_a_height_map_is_below_it():
    assert HeightMap([[0.5, 1], [2, 3]], 1, 1).bottom == pytest.approx(0.49)
    assert HeightMap([[0.5, 1], [2, 3]], 1, 1, -2).bottom == -2.0


def test_a_point_cloud_contains_each_cell_once():
    cloud = PointCloud([[0.01, 0.02, 0.03], [0.09, 0.09, 0.09], [-0.01, 0, 0], [0.1, 0, 0]], 0.1)
    assert cloud.cells.tolist() == [[-1, 0, 0], [0, 0, 0], [1, 0, 0]]


def test_half_spaces_are_equal():
    assert HalfSpace() == HalfSpace()


@pytest.mark.parametrize(
    ("create", "named"),
    [
        (lambda: Box([1, 1, 1]), r"Box\(x, y, z\)"),
        (lambda: Box(1, 1, 1, 1), r"Box\(x, y, z\)"),
        (lambda: Box(1, 1, [1]), "Box.z"),
        (lambda: Sphere(r=0.1), r"Sphere\(radius\)"),
        (lambda: Cylinder(0.1), r"Cylinder\(radius, length\)"),
        (lambda: HalfSpace(0.1), r"HalfSpace\(\)"),
        (lambda: Mesh("part.stl", size=2), r"Mesh\(path, scale"),
    ],
)
def test_wrong_arguments_are_answered_with_the_right_call(create, named: str):
    with pytest.raises(InputError, match=named):
        create()


@pytest.mark.parametrize("scale", [0.0, (1.0, 0.0, 1.0), np.inf, (1.0, 1.0, np.nan)])
def test_a_factor_of_a_mesh_is_finite_and_not_zero(scale):
    with pytest.raises(InputError, match="scale"):
        Mesh("part.stl", scale)


def test_a_mesh_of_arrays_has_no_scale():
    with pytest.raises(InputError, match="scale"):
        Mesh(None, 2.0, vertices=np.eye(4, 3), triangles=[[0, 1, 2]])


def test_any_of_many_numbers_distinguishes_shapes():
    """NumPy leaves the middle of large arrays out of its texts."""
    points = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
    moved = points.copy()
    moved[1000, 1] += 1e-6
    one, same, other = (ConvexHull(each) for each in (points, points.copy(), moved))
    assert (one, hash(one), repr(one)) == (same, hash(same), repr(same))
    assert one != other
    assert repr(one) != repr(other)
