"""Triangles as arrays of their corners (F, 3, 3): areas, cuts by a plane, connected parts, and the hull of points."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.spatial import Array

Indices = npt.NDArray[np.int64]

PRODUCTS = 2**20
"""Products of a point and a plane that are computed at once: 8 MB."""


def with_area(corners: Array) -> tuple[Array, Array, Array]:
    """Return the triangles that have an area, their unit normals (F, 3), and their areas (F,)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(across, axis=1)
    some = twice > 0
    return corners[some], across[some] / twice[some, None], twice[some] / 2


def cut_crossing(corners: Array, heights: Array) -> tuple[Array, Array]:
    """Return the parts below and above a plane of the triangles that cross it.

    ``heights`` (F, 3) are the signed distances of the corners from the plane, in any unit; a height of 0 is in it.
    """
    crossing = ~((heights <= 0).all(axis=1) | (heights >= 0).all(axis=1))
    cut, h = corners[crossing], heights[crossing]
    # Each triangle is rotated so that its first corner is alone on its side; a corner in the plane counts to the
    # others.
    s = np.sign(h)
    alone = np.argmax(
        [
            (s[:, i] * s[:, j] <= 0) & (s[:, i] * s[:, k] <= 0) & (s[:, i] != 0)
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        ],
        axis=0,
    )
    rows, order = np.arange(len(cut))[:, None], (alone[:, None] + np.arange(3)) % 3
    (a, b, c), (ha, hb, hc) = np.moveaxis(cut[rows, order], 1, 0), h[rows, order].T
    p, q = a + (ha / (ha - hb))[:, None] * (b - a), a + (ha / (ha - hc))[:, None] * (c - a)
    tip = np.stack([a, p, q], axis=1)
    rest = np.concatenate([np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)])
    below = ha < 0
    twice = np.tile(below, 2)
    return np.concatenate([tip[below], rest[~twice]]), np.concatenate([tip[~below], rest[twice]])


def connected_parts(count: int, one: Indices, other: Indices) -> Indices:
    """Return the number of the connected part of each of ``count`` nodes; edge k joins the nodes one[k] and other[k].

    Parts are numbered in the order of their first nodes.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(one)), (one, other)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


class PointHull:
    """The convex hull of points: the points on it (V, 3), its faces as planes (E, 4) and triangles, and its volume.

    Flat points have no faces and the volume 0.
    """

    def __init__(self, points: Array) -> None:
        from scipy.spatial import ConvexHull, QhullError

        self.points, self.planes, self.volume = points, np.empty((0, 4)), 0.0
        self.triangles = np.empty((0, 3, 3))
        if len(points) > 3:
            with suppress(QhullError):
                hull = ConvexHull(points)
                self.points, self.planes, self.volume = points[hull.vertices], hull.equations, float(hull.volume)
                self.triangles = points[hull.simplices]

    @cached_property
    def box(self) -> Array:
        """(2, 3) the lower and upper corner of the box around it."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])

    def space(self, points: Array, normals: Array) -> Array:
        """Return how far (m) it is from points (N, 3) in the hull along unit normals (N, 3) to its surface."""
        space = np.zeros(len(points))
        for rows in self._blocks(points):
            space[rows] = self._block_space(points[rows], normals[rows])
        return space

    def has_space(self, points: Array, normals: Array, tolerance: float) -> bool:
        """Whether it is farther than ``tolerance`` (m) from any of the points to its surface; stops at the first."""
        return any((self._block_space(points[r], normals[r]) > tolerance).any() for r in self._blocks(points))

    def _blocks(self, points: Array) -> list[slice]:
        """Rows of points by blocks: a CAD mesh has 500,000 samples and 3,000 planes, and their product is 12 GB."""
        if len(self.planes) == 0:
            return []
        rows = max(1, PRODUCTS // len(self.planes))
        return [slice(i, i + rows) for i in range(0, len(points), rows)]

    def _block_space(self, points: Array, normals: Array) -> Array:
        height = np.maximum(-(points @ self.planes[:, :3].T + self.planes[:, 3]), 0.0)
        slope = normals @ self.planes[:, :3].T
        return np.asarray(np.where(slope > 1e-9, height / np.maximum(slope, 1e-9), np.inf).min(axis=1))
