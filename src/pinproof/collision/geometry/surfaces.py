"""Height maps, point clouds and occupancy grids as closed surfaces, as boxes, and as volumes.

Coal's height fields have no distance queries and no queries against meshes. Coal's octrees are not usable either: two
of them are always in contact, queries against an ellipsoid are not supported, they cannot be pickled, and points
beyond their sixteen levels are dropped.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from pinproof._core import Shape as CoreShape
from pinproof.collision.geometry.hulls import Indices
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shape_values import CELLS
from pinproof.collision.geometry.shapes import HeightMap, PointCloud, cell_numbers
from pinproof.spatial import Array

CellShape = PointCloud | OccupancyGrid


def ground_surface(ground: HeightMap) -> tuple[Array, Indices]:
    """Return the closed surface of a height map: vertices (V, 3), triangles (F, 3) counter-clockwise from outside."""
    rows, columns = ground.heights.shape
    x, y = np.meshgrid(
        np.linspace(-ground.x / 2, ground.x / 2, columns), np.linspace(-ground.y / 2, ground.y / 2, rows)
    )
    top = np.stack([x, y, ground.heights], axis=-1).reshape(-1, 3)
    under = np.stack([x, y, np.full_like(x, ground.bottom)], axis=-1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    # Each cell is divided along its higher diagonal.
    ridge = _ridge_ac(ground.heights).ravel()[:, None]
    first = np.where(ridge, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(ridge, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    upper = np.concatenate([first, second])
    rim = np.concatenate(
        [index[0], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]]
    )  # along the edge, counter-clockwise
    # Walls join the rim of the surface with that of the underside.
    onward, down = np.roll(rim, -1), len(top)
    walls = np.concatenate([np.stack([rim + down, onward + down, onward], 1), np.stack([rim + down, onward, rim], 1)])
    return np.concatenate([top, under]), np.concatenate([upper, upper[:, ::-1] + down, walls])


@dataclass(frozen=True, eq=False)
class Ground:
    """The volume of a height map, which is solid."""

    ground: HeightMap
    watertight: ClassVar[bool] = True

    @property
    def surface(self) -> Array:
        """(F, 3, 3) its triangles, counter-clockwise seen from outside."""
        vertices, triangles = ground_surface(self.ground)
        return np.asarray(vertices[triangles])

    @property
    def witnesses(self) -> Array:
        """(1, 3) one corner: the surface is connected."""
        return np.array([[-self.ground.x / 2, -self.ground.y / 2, self.ground.bottom]])

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3) lies between bottom and surface."""
        ground = self.ground
        sides = np.array([ground.x, ground.y])
        under = points[(np.abs(points[:, :2]) <= sides / 2).all(axis=1) & (points[:, 2] >= ground.bottom)]
        if len(under) == 0:
            return False
        rows, columns = ground.heights.shape
        # The cell of each point, and the height of the surface there.
        grid = (under[:, :2] / sides + 0.5) * [columns - 1, rows - 1]
        cell = np.minimum(grid.astype(np.int64), [columns - 2, rows - 2])
        (s, t), (i, j) = (grid - cell).T, cell.T
        h = ground.heights
        a, b, c, d = h[j, i], h[j, i + 1], h[j + 1, i + 1], h[j + 1, i]
        along_ac = a + np.where(s > t, (b - a) * s + (c - b) * t, (c - d) * s + (d - a) * t)
        along_bd = np.where(s + t < 1, a + (b - a) * s + (d - a) * t, c + (d - c) * (1 - s) + (b - c) * (1 - t))
        height = np.where(_ridge_ac(h)[j, i], along_ac, along_bd)
        return bool((under[:, 2] <= height).any())

    def content(self) -> bytes:
        """Return its defining numbers, for a hash."""
        ground = self.ground
        return repr((ground.heights.shape, ground.x, ground.y, ground.bottom)).encode() + ground.heights.tobytes()


def _ridge_ac(heights: Array) -> npt.NDArray[np.bool_]:
    """(ny - 1, nx - 1) whether the diagonal from the low-x, low-y corner of a cell is the higher one at its middle."""
    return np.asarray(heights[:-1, :-1] + heights[1:, 1:] >= heights[:-1, 1:] + heights[1:, :-1])


def _side(shape: CellShape) -> float:
    return shape.resolution if isinstance(shape, PointCloud) else shape.voxel


def _rows(shape: CellShape) -> tuple[Indices, Indices]:
    """Return lower and upper corners (N, 3), in cells: of the cells of a point cloud, of the rows of a grid along z."""
    if isinstance(shape, PointCloud):
        return shape.cells, shape.cells + 1
    # The rows of a grid are found without a list of its cells: they begin and end where the occupancy changes.
    nx, ny, nz = shape.cells.shape
    padded = np.zeros((nx, ny, nz + 2), dtype=np.int8)
    padded[:, :, 1:-1] = shape.occupied
    change = np.diff(padded, axis=2)
    low = np.argwhere(change == 1)
    high = low + 1
    high[:, 2] = np.argwhere(change == -1)[:, 2]
    return low + np.array(shape.low), high + np.array(shape.low)


def cell_faces(shape: CellShape) -> tuple[Array, Indices]:
    """Return the faces between full and empty cells: vertices (V, 3), triangles (F, 3) counter-clockwise from outside.

    Faces in a row are joined, so that a wall consists of a few long strips.
    """
    quads: list[Array] = []
    for axis in range(3):
        along, across = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            # The occupied cells whose neighbour on this side (0: below, 1: above) is empty.
            if isinstance(shape, PointCloud):
                cells = shape.cells
                step = np.eye(3, dtype=np.int64)[axis] * (2 * side - 1)
                bare = cells[~np.isin(cell_numbers(cells + step), cell_numbers(cells))]
            else:
                occupied = np.moveaxis(shape.occupied, axis, 0)
                beside = np.zeros_like(occupied)
                if side:
                    beside[:-1] = occupied[1:]
                else:
                    beside[1:] = occupied[:-1]
                bare = np.argwhere(np.moveaxis(occupied & ~beside, 0, axis)) + np.array(shape.low)
            if not len(bare):  # a grid without an occupied cell
                continue
            bare = bare[np.lexsort((bare[:, along], bare[:, across], bare[:, axis]))]
            gap = np.diff(bare, axis=0)
            first = np.concatenate([[True], (gap[:, along] != 1) | (gap[:, axis] != 0) | (gap[:, across] != 0)])
            start, last = bare[first], bare[np.concatenate([first[1:], [True]])]
            quad = np.repeat(start[:, None, :], 4, axis=1)
            quad[:, :, axis] += side
            quad[:, 1:3, along] = last[:, None, along] + 1
            quad[:, 2:, across] += 1
            quads.append(quad if side else quad[:, ::-1])
    corners = np.concatenate([np.empty((0, 4, 3)), *quads])
    four = np.arange(4 * len(corners)).reshape(-1, 4)
    triangles = np.concatenate([four[:, :3], four[:, [0, 2, 3]]])
    return corners.reshape(-1, 3) * _side(shape), triangles


class Cells:
    """The volume of the occupied cells of a shape: a tree of boxes in the core, which shapes keep."""

    watertight = True

    def __init__(self, shape: CellShape) -> None:
        self.shape = shape

    @classmethod
    def of(cls, shape: CellShape) -> Cells:
        """Return the cells of a shape, which are made once."""
        if CELLS not in shape.__dict__:
            object.__setattr__(shape, CELLS, cls(shape))
        made: Cells = shape.__dict__[CELLS]
        return made

    @cached_property
    def core_shape(self) -> CoreShape:
        """The cells as the compiled core uses them."""
        low, high = _rows(self.shape)
        return CoreShape.cells(low, high, _side(self.shape))

    @property
    def boxes(self) -> Array:
        """(B, 2, 3) lower and upper corner of the boxes to which cells are joined; none if no cell is occupied."""
        if isinstance(self.shape, OccupancyGrid) and not self.shape.occupied.any():
            return np.empty((0, 2, 3))
        centres, halves = np.moveaxis(self.core_shape.boxes, 1, 0)
        return np.stack([centres - halves, centres + halves], axis=1)

    @property
    def surface(self) -> Array:
        """(F, 3, 3) the triangles of all boxes, counter-clockwise seen from outside."""
        corners = np.array(list(product((0, 1), repeat=3)))
        return np.asarray(self.boxes[:, corners, np.arange(3)][:, BOX_FACES].reshape(-1, 3, 3))

    @property
    def witnesses(self) -> Array:
        """(B, 3) a point of each box."""
        return np.ascontiguousarray(self.core_shape.boxes[:, 0])

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3) lies in an occupied cell."""
        low, high = np.moveaxis(self.boxes, 1, 0)
        return any(((low <= point) & (point <= high)).all(axis=1).any() for point in points)

    def content(self) -> bytes:
        """Return its defining numbers, for a hash."""
        return hashlib.sha256(self.core_shape.boxes.tobytes()).digest()

    def __getstate__(self) -> dict[str, Any]:
        return {"shape": self.shape}


BOX_FACES = np.array(
    [0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]
)
"""The triangles of a box, whose corner 4 i + 2 j + k is the upper one along x, y, z if i, j, k is 1."""
