"""Shapes as objects of other libraries: geometries of coal, meshes of trimesh and Open3D, point clouds.

Types are recognised by their attributes, so none of the libraries is imported here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pinproof.collision.geometry.shapes import (
    SHAPES,
    SHAPES_BY_KEY,
    ConvexHull,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
)
from pinproof.errors import InputError
from pinproof.model import coal_shape
from pinproof.spatial import SE3, Array

CELL = 0.02
"""Metres: the side of the cells of a point cloud that states none."""

CLOSEST = 1000
"""Number of points of a cloud whose distance to the closest other point is measured."""

ROUND = ("Sphere", "Cylinder", "Capsule")
"""The primitives of trimesh whose triangles are inside of what they approximate."""


class PlacedShape(NamedTuple):
    """A shape that is not about the origin of its obstacle."""

    shape: Shape
    obstacle_from_shape: SE3


def shape_of(name: str, value: Any) -> Shape | PlacedShape:
    """Return the shape that an object of another library is, or one that contains it; ``name`` is for messages.

    Raises
    ------
    InputError
        If it is none that is supported; the message states its type and what is accepted.
    """
    kind = type(value)
    if kind.__module__.partition(".")[0] in ("coal", "hppfcl"):
        return _of_coal(name, value)
    # triangles of trimesh are faces; Open3D has vectors of its own
    named = next((each for each in ("faces", "triangles") if hasattr(value, "vertices") and hasattr(value, each)), "")
    if named:
        if hasattr(value, "primitive") and kind.__name__ in ROUND:
            what = f"{name} is a trimesh primitive whose triangles are inside of the {kind.__name__.lower()}"
            raise InputError(f"{what}; pass a pp.{kind.__name__}")
        return Mesh.from_arrays(
            np.asarray(value.vertices, dtype=float), np.asarray(getattr(value, named), dtype=np.int64)
        )
    points = next((getattr(value, name) for name in ("points", "vertices") if hasattr(value, name)), value)
    if isinstance(value, np.ndarray) or points is not value:
        return _cloud(name, points)
    valid = ", ".join(shape.__name__ for shape in SHAPES)
    others = "a geometry of coal, a mesh or point cloud of trimesh or Open3D, points (N, 3)"
    raise InputError(f"{name} is {value!r:.80}; valid: {valid}; {others}")


def _of_coal(name: str, value: Any) -> Shape | PlacedShape:
    kind, size, vertices, triangles = coal_shape(name, value)
    if kind == "mesh":
        return Mesh.from_arrays(vertices, triangles)
    if kind == "convex":
        return ConvexHull(vertices)
    if kind != "half_space":
        shape: Shape = SHAPES_BY_KEY[kind](*size)  # type: ignore[arg-type]  # as many numbers as the shape has
        return shape
    # all points x with n x <= d: the z axis of ours is the normal
    normal, distance = np.array(size[:3]), size[3]
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    rotation = np.column_stack([first, np.cross(normal, first), normal])
    return PlacedShape(HalfSpace(), SE3(rotation, distance * normal))


def _cloud(name: str, points: Any) -> PointCloud:
    """The cloud with cells of :data:`CELL`, unless most of its points are farther apart than that."""
    cloud = PointCloud(np.asarray(points), CELL)
    from scipy.spatial import cKDTree

    some: Array = cloud.points[:: max(1, len(cloud.points) // CLOSEST)]
    apart = np.median(cKDTree(cloud.points).query(some, k=2)[0][:, 1])
    if apart > CELL:
        what = f"the points of {name} are {apart:.3g} m apart" if len(cloud.points) > 1 else f"{name} is one point"
        raise InputError(f"{what}; state the side of their cells: pp.PointCloud(points, resolution)")
    return cloud
