"""Shapes made of arrays: hulls of points, meshes, point clouds, height maps. Equal if their numbers are."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision.hulls import refuse_flat
from pinproof.collision.sizes import LARGEST_SIZE, SMALLEST_SIZE, checked_size, coordinates
from pinproof.errors import InputError
from pinproof.spatial import finite

__all__ = ["ConvexHull", "HeightMap", "Mesh", "PointCloud"]

Array = npt.NDArray[np.float64]

GRID_CELLS = 2**20
"""Cells of a point cloud on either side of the origin along each axis: three such numbers fit into one of 63 bits."""

BELOW_LOWEST = 0.01
"""Metres: how far below its lowest point a height map is solid unless told otherwise."""


class _ByContent:
    """Equality, hash and a short ``repr`` for frozen dataclasses that hold arrays, which Python has none for."""

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._contents() == other._contents()

    def __hash__(self) -> int:
        return hash(self._contents())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in self._contents())})"

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)  # pickle forgets it
        self.__dict__.update(state)

    def _contents(self) -> tuple[tuple[str, str], ...]:
        stated = []
        for field in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                told = f"<{value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}>"
            else:
                told = repr(value)
            stated.append((field.name, told))
        return tuple(stated)


@dataclass(frozen=True, eq=False, repr=False)
class ConvexHull(_ByContent):
    """The convex hull of ``points`` (V, 3)."""

    points: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", coordinates("ConvexHull.points", self.points, (None, 3)))
        refuse_flat(self.points, "ConvexHull.points")


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(_ByContent):
    """A triangle mesh, from a file or from arrays (:meth:`from_arrays`).

    Parameters
    ----------
    path
        The file: STL, OBJ, DAE, PLY, GLB or glTF. None for a mesh from arrays.
    scale
        One factor, or one each for x, y, z.
    hull
        None, the default: a watertight mesh is solid in its own shape. It is covered by a few convex pieces where these
        reach no more than 1 mm beyond it, as for most bins, shelves and brackets with flat faces; else its triangles
        are used. A mesh that is not watertight is replaced by its convex hull, and certificates note this. True: the
        convex hull, which fills a bin. False: the triangles, which must be watertight; being inside counts as contact.
    hollow
        Collide with the bare triangles, watertight or not. Being wholly inside is then no contact, and certificates
        note this.
    vertices, triangles
        (V, 3) metres and (F, 3) indices, of a mesh from arrays.
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
            raise InputError(f"Mesh.scale = {(x, y, z)}; factors are finite and not 0")
        if self.hull not in (None, True, False):
            raise InputError(f"Mesh.hull must be True, False or None, not {self.hull!r}")
        if self.hull and self.hollow:
            raise InputError("a Mesh is its hull or hollow, not both: hull=False, hollow=True is the bare triangles")
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
            raise InputError(f"Mesh.triangles must be whole numbers of the shape (F, 3): {error}") from error
        if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0 or triangles.dtype.kind not in "iu":
            raise InputError(
                f"Mesh.triangles must be whole numbers of the shape (F, 3); the shape is {triangles.shape}"
            )
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise InputError(f"Mesh.triangles name vertices 0 to {len(vertices) - 1}; there is a vertex beyond")
        triangles = triangles.astype(np.int64)
        triangles.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)

    @classmethod
    def from_arrays(
        cls, vertices: npt.ArrayLike, triangles: npt.ArrayLike, *, hull: bool | None = None, hollow: bool = False
    ) -> Mesh:
        """A mesh of ``vertices`` (V, 3) in metres and ``triangles`` (F, 3), indices of them."""
        return cls(None, 1.0, hull, hollow, vertices, triangles)  # type: ignore[arg-type]  # made arrays there


@dataclass(frozen=True, eq=False, repr=False)
class PointCloud(_ByContent):
    """Points of a sensor, as the leaves of an octree: every cell of a grid that holds a point is solid.

    Parameters
    ----------
    points
        (N, 3) in metres.
    resolution
        The side (m) of a cell; cells begin at whole multiples of it. So a point's solid reaches to the walls of its
        cell: between nothing and one ``resolution`` beyond it, half of it beyond the middle of the cell. Space between
        points that are farther apart than a cell is free: choose it no finer than the points are dense.
    """

    points: Array
    resolution: float

    def __post_init__(self) -> None:
        points = coordinates("PointCloud.points", self.points, (None, 3))
        if len(points) == 0:
            raise InputError("PointCloud.points is empty; a cloud without a point is no obstacle")
        resolution = checked_size("PointCloud.resolution", self.resolution)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "resolution", resolution)
        if not (np.abs(self.cells) < GRID_CELLS - 1).all():
            far = float(np.abs(points).max())
            least = f"points {far:g} m from the origin need cells of {far / (GRID_CELLS - 2):.2g} m or more"
            raise InputError(f"PointCloud.resolution = {resolution:g}; {least}")

    @property
    def cells(self) -> npt.NDArray[np.int64]:
        """(K, 3) the occupied cells, each once: cell c is the cube from c to c + 1, times the resolution."""
        return np.unique(np.floor(self.points / self.resolution).astype(np.int64), axis=0)


@dataclass(frozen=True, eq=False, repr=False)
class HeightMap(_ByContent):
    """Ground over a rectangle about the origin, solid from its surface down to ``bottom``.

    Between the points the surface is the higher of the two ways of cutting a cell into triangles, so that it covers
    both, and the bilinear patch too.

    Parameters
    ----------
    heights
        (ny, nx) z in metres at the points of a regular grid; row 0 lies at y = -``y`` / 2, column 0 at x = -``x`` / 2.
    x, y
        The full sides (m) of the rectangle.
    bottom
        z (m) of its underside; without it :data:`BELOW_LOWEST` below the lowest point.
    """

    heights: Array
    x: float
    y: float
    bottom: float = None  # type: ignore[assignment]  # made a number below

    def __post_init__(self) -> None:
        heights = coordinates("HeightMap.heights", self.heights, (None, None))
        if min(heights.shape) < 2:
            raise InputError(f"HeightMap.heights has the shape {heights.shape}; a map has 2 rows and 2 columns or more")
        lowest = float(heights.min())
        bottom = lowest - BELOW_LOWEST if self.bottom is None else float(finite("HeightMap.bottom", self.bottom, ()))
        if not -2 * LARGEST_SIZE <= bottom <= lowest - SMALLEST_SIZE:
            raise InputError(f"HeightMap.bottom = {bottom:g} must lie below the lowest point, {lowest:g}")
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "x", checked_size("HeightMap.x", self.x))
        object.__setattr__(self, "y", checked_size("HeightMap.y", self.y))
        object.__setattr__(self, "bottom", bottom)
