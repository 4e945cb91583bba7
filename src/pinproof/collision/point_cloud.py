"""Point clouds for coal: an octree of occupied cells, in which coal, unlike in meshes, sees what is wholly inside."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import coal
import numpy as np
import numpy.typing as npt

from pinproof.collision.array_shapes import OCTREE_CELLS, PointCloud

__all__ = ["Cells", "cell_faces", "octree"]

Array = npt.NDArray[np.float64]


def octree(cloud: PointCloud) -> Any:
    """The coal shape of a cloud, made of the middles of its cells: no point is left to rounding at a cell's wall."""
    return coal.makeOctree((cloud.cells + 0.5) * cloud.resolution, cloud.resolution)


def cell_faces(cloud: PointCloud) -> tuple[Array, npt.NDArray[np.int64]]:
    """The surface of a cloud to be drawn: vertices (V, 3) and triangles (F, 3) of the faces between full and empty."""
    cells, keys = cloud.cells, np.sort(_keys(cloud.cells))
    corners: list[Array] = []
    for axis in range(3):
        along, across = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        square = np.array([np.zeros(3), along, along + across, across])
        for side in (0, 1):
            step = np.eye(3, dtype=np.int64)[axis] * (2 * side - 1)
            bare = cells[~np.isin(_keys(cells + step), keys)]
            at = bare[:, None, :] + side * np.eye(3)[axis] + (square if side else square[::-1])
            corners.append(at)
    quads = np.concatenate(corners)
    four = np.arange(4 * len(quads)).reshape(-1, 4)
    triangles = np.concatenate([four[:, :3], four[:, [0, 2, 3]]])
    return quads.reshape(-1, 3) * cloud.resolution, triangles


@dataclass(frozen=True, eq=False)
class Cells:
    """What lies in occupied cells.

    Parameters
    ----------
    cells
        (K, 3) as :attr:`PointCloud.cells <pinproof.PointCloud.cells>` has them.
    resolution
        The side (m) of a cell.
    witnesses
        (W, 3) the middle of one cell of each part that hangs together by faces.
    """

    cells: npt.NDArray[np.int64]
    resolution: float
    witnesses: Array = field(init=False)
    _keys: npt.NDArray[np.int64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        keys = _keys(self.cells)
        object.__setattr__(self, "_keys", np.sort(keys))
        first = _first_of_each_part(self.cells, keys)
        object.__setattr__(self, "witnesses", (self.cells[first] + 0.5) * self.resolution)

    @property
    def watertight(self) -> bool:
        """Cells are solid."""
        return True

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3) lies in an occupied cell."""
        cells = np.floor(points / self.resolution)
        cells = cells[(np.abs(cells) < OCTREE_CELLS).all(axis=1)].astype(np.int64)
        return bool(np.isin(_keys(cells), self._keys).any())

    def content(self) -> bytes:
        """The numbers it is made of."""
        return self.cells.tobytes() + np.float64(self.resolution).tobytes()


def _keys(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """One number for each cell."""
    shifted = cells + 2 * OCTREE_CELLS  # neighbours of cells at the rim stay above 0
    return np.asarray((shifted[:, 0] * 4 * OCTREE_CELLS + shifted[:, 1]) * 4 * OCTREE_CELLS + shifted[:, 2])


def _first_of_each_part(cells: npt.NDArray[np.int64], keys: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    order = np.argsort(keys)
    joined = []
    for axis in range(3):
        beside = _keys(cells + np.eye(3, dtype=np.int64)[axis])
        place = np.minimum(np.searchsorted(keys[order], beside), len(keys) - 1)
        there = keys[order][place] == beside
        joined.append(np.stack([np.flatnonzero(there), order[place[there]]]))
    rows, columns = np.concatenate(joined, axis=1)
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(cells), len(cells)))
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(np.unique(labels, return_index=True)[1])
