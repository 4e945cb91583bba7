"""Shapes of obstacles and attached objects, and obstacles: immutable values in metres.

Every shape is about its own origin. Sizes are checked, because coal accepts NaN, -1 and 1e300 without an error. Shapes
that hold arrays compare equal if their numbers are equal.

A new shape is registered in three places, each of which refuses an unknown shape: the union :data:`Shape` here, from
which its key in files follows, ``GEOMETRIES`` in :mod:`pinproof.collision.geometry.bodies` (geometry and support
function), and the surfaces of :mod:`pinproof.viewer`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import get_args

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.geometry.hulls import refuse_flat
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shape_values import (
    LARGEST_SIZE,
    SMALLEST_SIZE,
    ByContent,
    checked_size,
    coordinates,
    point_array,
)
from pinproof.common.validation import named_arguments
from pinproof.errors import InputError
from pinproof.spatial import Array, finite, frozen, rigid

GRID_CELLS = 2**20
"""Number of cells of a point cloud on either side of the origin along each axis: three indices fit into 63 bits."""

BELOW_LOWEST = 0.01
"""Metres: default distance of the underside of a height map from its lowest point."""


@named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class ConvexHull(ByContent):
    """The convex hull of ``points`` (V, 3)."""

    points: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", coordinates("ConvexHull.points", self.points, (None, 3)))
        refuse_flat(self.points, "ConvexHull.points")


@named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Mesh(ByContent):
    """A triangle mesh, from a file or from arrays (:meth:`from_arrays`).

    Parameters
    ----------
    path
        The file: STL, OBJ, DAE, PLY, GLB or glTF. None for a mesh from arrays.
    scale
        One factor, or one each for x, y, z.
    hull
        None (default): a watertight mesh is a solid of its own shape. It is covered by a few convex pieces if these
        extend at most 1 mm beyond it, as for most bins, shelves and brackets with flat faces; otherwise its triangles
        are used. A mesh that is not watertight is replaced by its convex hull, and certificates note this. True: the
        convex hull, which fills a bin. False: the triangles, which must be watertight; being inside is a contact.
    hollow
        Use only the surface, watertight or not. A body that is entirely inside is then not in contact, and certificates
        note this.
    vertices, triangles
        (V, 3) metres and (F, 3) indices of a mesh from arrays.
    """

    path: str | Path | None
    scale: float | tuple[float, float, float] = 1.0
    hull: bool | None = None
    hollow: bool = False
    vertices: Array | None = None
    triangles: npt.NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        values = self.scale if isinstance(self.scale, (tuple, list)) else (self.scale,) * 3
        try:
            x, y, z = (float(value) for value in values)
        except (TypeError, ValueError):
            raise InputError(f"Mesh.scale must be one number or three, not {self.scale!r}") from None
        if not all(math.isfinite(v) and v != 0.0 for v in (x, y, z)):
            raise InputError(f"Mesh.scale = {(x, y, z)}; factors must be finite and not 0")
        if self.hull not in (None, True, False):
            raise InputError(f"Mesh.hull must be True, False or None, not {self.hull!r}")
        if self.hull and self.hollow:
            raise InputError("a Mesh has hull=True or hollow=True, not both: hull=False, hollow=True is the surface")
        if self.hollow:
            object.__setattr__(self, "hull", False)
        object.__setattr__(self, "scale", (x, y, z))
        if self.path is not None:
            if self.vertices is not None or self.triangles is not None:
                raise InputError("a Mesh has a path, or vertices and triangles, not both")
            object.__setattr__(self, "path", Path(self.path))
            return
        vertices = coordinates("Mesh.vertices", self.vertices if self.vertices is not None else [], (None, 3))
        try:
            triangles = np.array(self.triangles if self.triangles is not None else [])
        except ValueError as error:  # rows of different lengths
            raise InputError(f"Mesh.triangles must be integers of the shape (F, 3): {error}") from error
        if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0 or triangles.dtype.kind not in "iu":
            raise InputError(f"Mesh.triangles must be integers of the shape (F, 3); the shape is {triangles.shape}")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise InputError(
                f"Mesh.triangles name vertices {triangles.min()} to {triangles.max()} of 0 to {len(vertices) - 1}"
            )
        triangles = triangles.astype(np.int64)
        triangles.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)

    @classmethod
    def from_arrays(
        cls, vertices: npt.ArrayLike, triangles: npt.ArrayLike, *, hull: bool | None = None, hollow: bool = False
    ) -> Mesh:
        """Return a mesh of ``vertices`` (V, 3) in metres and ``triangles`` (F, 3), indices of vertices."""
        return cls(None, 1.0, hull, hollow, vertices, triangles)  # type: ignore[arg-type]  # made arrays there


@named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class PointCloud(ByContent):
    """Points of a sensor: every cell of a grid that contains a point is solid, like the leaves of an octree.

    Parameters
    ----------
    points
        (N, 3) in metres. Points with a coordinate that is not finite, which depth cameras return for pixels without a
        measurement, are dropped and counted (:attr:`dropped`).
    resolution
        The side (m) of a cell; cells start at integer multiples of it. The solid extends up to one ``resolution``
        beyond a point. Space between points that are farther apart than a cell is free, so the resolution should be no
        finer than the spacing of the points.
    """

    points: Array
    resolution: float

    def __post_init__(self) -> None:
        stated = point_array("PointCloud.points", self.points)
        measured = np.isfinite(stated).all(axis=1)
        points = coordinates("PointCloud.points", stated[measured], (None, 3))
        if len(points) == 0:
            what = f"holds {len(stated)} points, of which none is finite" if len(stated) else "is empty"
            raise InputError(f"PointCloud.points {what}; at least one point is needed")
        object.__setattr__(self, "_dropped", len(stated) - len(points))
        resolution = checked_size("PointCloud.resolution", self.resolution)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "resolution", resolution)
        if not (np.abs(self.cells) < GRID_CELLS - 1).all():
            far = float(np.abs(points).max())
            least = f"points {far:g} m from the origin need cells of {far / (GRID_CELLS - 2):.2g} m or more"
            raise InputError(f"PointCloud.resolution = {resolution:g}; {least}")

    @property
    def dropped(self) -> int:
        """The number of points that were not finite."""
        return int(self.__dict__["_dropped"])

    @property
    def cells(self) -> npt.NDArray[np.int64]:
        """(K, 3) the occupied cells without repetition: cell c is the cube from c to c + 1, times the resolution."""
        cells = np.floor(self.points / self.resolution).astype(np.int64)
        return cells[np.unique(cell_numbers(cells), return_index=True)[1]]  # 50 times as fast as sorting rows of three


def cell_numbers(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return one number for each of the cells (K, 3), unique for less than :data:`GRID_CELLS` cells off the origin."""
    shifted = cells + GRID_CELLS
    return np.asarray((shifted[:, 0] * 2 * GRID_CELLS + shifted[:, 1]) * 2 * GRID_CELLS + shifted[:, 2])


@named_arguments
@dataclass(frozen=True, eq=False, repr=False)
class HeightMap(ByContent):
    """Ground over a rectangle about the origin, solid from its surface down to ``bottom``.

    Between the points the surface is the higher of the two triangulations of a cell, so that it covers both and the
    bilinear patch.

    Parameters
    ----------
    heights
        (ny, nx) z in metres at the points of a regular grid; row 0 lies at y = -``y`` / 2, column 0 at x = -``x`` / 2.
    x, y
        The full sides (m) of the rectangle.
    bottom
        z (m) of the underside; default :data:`BELOW_LOWEST` below the lowest point.
    """

    heights: Array
    x: float
    y: float
    bottom: float = None  # type: ignore[assignment]  # made a number below

    def __post_init__(self) -> None:
        heights = coordinates("HeightMap.heights", self.heights, (None, None))
        if min(heights.shape) < 2:
            raise InputError(f"HeightMap.heights has the shape {heights.shape}; it needs 2 rows and 2 columns or more")
        lowest = float(heights.min())
        bottom = lowest - BELOW_LOWEST if self.bottom is None else float(finite("HeightMap.bottom", self.bottom, ()))
        if not -2 * LARGEST_SIZE <= bottom <= lowest - SMALLEST_SIZE:
            raise InputError(f"HeightMap.bottom = {bottom:g} must lie below the lowest point, {lowest:g}")
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "x", checked_size("HeightMap.x", self.x))
        object.__setattr__(self, "y", checked_size("HeightMap.y", self.y))
        object.__setattr__(self, "bottom", bottom)


class _Sized:
    """Checks every number of a shape as :func:`~pinproof.collision.geometry.shapes.checked_size` does."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            number = checked_size(f"{type(self).__name__}.{field.name}", getattr(self, field.name))
            object.__setattr__(self, field.name, number)


@named_arguments
@dataclass(frozen=True)
class Box(_Sized):
    """A box with the full sides x, y, z."""

    x: float
    y: float
    z: float


@named_arguments
@dataclass(frozen=True)
class Sphere(_Sized):
    """A sphere."""

    radius: float


@named_arguments
@dataclass(frozen=True)
class Cylinder(_Sized):
    """A cylinder about z, ``length`` from end to end."""

    radius: float
    length: float


@named_arguments
@dataclass(frozen=True)
class Capsule(_Sized):
    """A cylinder about z, ``length`` long without its two hemispherical caps."""

    radius: float
    length: float


@named_arguments
@dataclass(frozen=True)
class Cone(_Sized):
    """A cone about z with its tip at z = ``length`` / 2 and its base of ``radius`` at z = -``length`` / 2."""

    radius: float
    length: float


@named_arguments
@dataclass(frozen=True)
class Ellipsoid(_Sized):
    """An ellipsoid with the semi-axes rx, ry, rz along x, y, z."""

    rx: float
    ry: float
    rz: float


@named_arguments
@dataclass(frozen=True)
class HalfSpace:
    """A half-space, such as a floor, wall or ceiling: all points with z <= 0 in its own frame are solid."""


Shape = (
    Box
    | Sphere
    | Cylinder
    | Capsule
    | Cone
    | Ellipsoid
    | HalfSpace
    | ConvexHull
    | PointCloud
    | HeightMap
    | OccupancyGrid
    | Mesh
)

SHAPES_BY_KEY: dict[str, type[Shape]] = {
    re.sub(r"(?<=[a-z])(?=[A-Z])", "_", k.__name__).lower(): k for k in get_args(Shape)
}
"""Every shape by its key in files: ``half_space`` for :class:`HalfSpace`."""

ANYTHING = "*"
"""The name of any robot link or attached object in an allowed contact."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A named shape with a pose.

    Parameters
    ----------
    name
        Unique in its scene.
    shape
        Its shape.
    pose
        ``root_from_obstacle``: its pose in the frame of the robot's root link, SE3 or (4, 4). Copied, and read-only
        afterwards; :meth:`Scene.move` returns a scene in which the obstacle has another pose.
    rgba
        Its colour in the viewer, 0 to 1.
    arm
        For an object attached to a joint group with several arms: the name of the arm that carries it.
    """

    name: str
    shape: Shape
    pose: pin.SE3 = None
    rgba: tuple[float, float, float, float] | None = None
    arm: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InputError(f"an obstacle needs a name, not {self.name!r}")
        if not isinstance(self.shape, Shape):
            kinds = ", ".join(kind.__name__ for kind in get_args(Shape))
            raise InputError(f"obstacle {self.name!r} has the shape {self.shape!r}; valid:  {kinds}")
        if self.arm is not None and not isinstance(self.arm, str):
            raise InputError(
                f"arm = {self.arm!r} of {self.name!r} must be the name of one arm; an object that several arms hold "
                "together forms a closed chain, which is not supported"
            )
        placement = pin.SE3.Identity() if self.pose is None else rigid(f"pose of obstacle {self.name!r}", self.pose)
        if float(np.abs(placement.translation).max()) > LARGEST_SIZE:
            where = placement.translation.tolist()
            raise InputError(f"obstacle {self.name!r} is at {where}; coordinates are limited to {LARGEST_SIZE:g} m")
        object.__setattr__(self, "pose", frozen(placement))
