"""Height maps, point clouds and occupancy grids as closed surfaces, as boxes, and as volumes.

Coal's height fields have no distance queries and no queries against meshes. Coal's octrees are not usable either: two
of them are always in contact, queries against an ellipsoid are not supported, they cannot be pickled, and points
beyond their sixteen levels are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import permutations
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from pinproof.collision.geometry.hulls import Indices, connected_parts
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shapes import GRID_CELLS, HeightMap, PointCloud, cell_numbers
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


def cells_of(shape: CellShape) -> tuple[Indices, float]:
    """Return the occupied cells (K, 3) of a point cloud or grid, and their side (m)."""
    if isinstance(shape, PointCloud):
        return shape.cells, shape.resolution
    return np.argwhere(shape.occupied) + np.array(shape.low), shape.voxel


def cell_faces(shape: CellShape) -> tuple[Array, Indices]:
    """Return the faces between full and empty cells: vertices (V, 3), triangles (F, 3) counter-clockwise from outside.

    Faces in a row are joined, so that a wall consists of a few long strips.
    """
    side_length = shape.resolution if isinstance(shape, PointCloud) else shape.voxel
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
    return corners.reshape(-1, 3) * side_length, triangles


def merged_cells(cells: Indices) -> tuple[Indices, Indices]:
    """Join cells to boxes that cover the same volume: lower corners (N, 3) and upper corners (N, 3), in cells."""
    # Cells are joined to rows, rows to plates and plates to blocks, in the order of axes that gives the fewest boxes.
    orders = (_joined(cells, cells + 1, order) for order in permutations(range(3)))
    return min(orders, key=lambda boxes: len(boxes[0]))


def merged_boxes(shape: CellShape) -> tuple[Array, Array]:
    """Return lower and upper corners (N, 3), in metres, of the boxes that together are the occupied cells."""
    if isinstance(shape, PointCloud):
        low, high = merged_cells(shape.cells)
        return np.asarray(low * shape.resolution), np.asarray(high * shape.resolution)
    # The rows of a grid are found without a list of its cells: they begin and end where the occupancy changes.
    orders = []
    for axis in range(3):
        along, others = np.moveaxis(shape.occupied, axis, 2), [other for other in range(3) if other != axis]
        padded = np.zeros((*along.shape[:2], along.shape[2] + 2), dtype=np.int8)
        padded[:, :, 1:-1] = along
        change = np.diff(padded, axis=2)
        first, end = np.argwhere(change == 1), np.argwhere(change == -1)
        low = np.empty_like(first)
        low[:, [*others, axis]] = first
        high = low + 1
        high[:, axis] = end[:, 2]
        orders += [_joined(low, high, order) for order in permutations(others)]
    low, high = min(orders, key=lambda boxes: len(boxes[0]))
    return np.asarray((low + shape.low) * shape.voxel), np.asarray((high + shape.low) * shape.voxel)


def _joined(low: Indices, high: Indices, order: tuple[int, ...]) -> tuple[Indices, Indices]:
    for axis in order if len(low) else ():
        others = [other for other in range(3) if other != axis]
        sides = [column for other in others for column in (high[:, other], low[:, other])]
        rank = np.lexsort([low[:, axis], *sides])
        low, high = low[rank], high[rank]
        same = (low[1:, others] == low[:-1, others]).all(axis=1) & (high[1:, others] == high[:-1, others]).all(axis=1)
        same &= low[1:, axis] == high[:-1, axis]
        low, high = low[np.append(True, ~same)], high[np.append(~same, True)]
    return low, high


@dataclass(frozen=True, eq=False)
class Cells:
    """The volume of occupied cells (K, 3) of a side (m); ``witnesses`` (W, 3) are in one cell of each part."""

    watertight: ClassVar[bool] = True
    shape: CellShape
    cells: Indices = field(init=False)
    resolution: float = field(init=False)
    witnesses: Array = field(init=False)
    _keys: Indices = field(init=False, repr=False)

    def __post_init__(self) -> None:
        cells, resolution = cells_of(self.shape)
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "resolution", resolution)
        keys = cell_numbers(self.cells)
        object.__setattr__(self, "_keys", np.sort(keys))
        # Cells that share a face are connected; the first cell of each connected part is its witness.
        order, joined = np.argsort(keys), []
        for axis in range(3):
            beside = cell_numbers(self.cells + np.eye(3, dtype=np.int64)[axis])
            place = np.minimum(np.searchsorted(keys[order], beside), len(keys) - 1)
            there = keys[order][place] == beside
            joined.append(np.stack([np.flatnonzero(there), order[place[there]]]))
        labels = connected_parts(len(keys), *np.concatenate(joined, axis=1))
        first = np.unique(labels, return_index=True)[1]
        object.__setattr__(self, "witnesses", (self.cells[first] + 0.5) * self.resolution)

    @property
    def surface(self) -> Array:
        """(F, 3, 3) the triangles between full and empty cells, counter-clockwise seen from outside."""
        vertices, triangles = cell_faces(self.shape)
        return np.asarray(vertices[triangles])

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3) lies in an occupied cell."""
        cells = np.floor(points / self.resolution)
        cells = cells[(np.abs(cells) < GRID_CELLS).all(axis=1)].astype(np.int64)
        return bool(np.isin(cell_numbers(cells), self._keys).any())

    def content(self) -> bytes:
        """Return its defining numbers, for a hash."""
        return self.cells.tobytes() + np.float64(self.resolution).tobytes()
