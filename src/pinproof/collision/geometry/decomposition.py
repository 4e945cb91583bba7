"""Covers of meshes by several convex hulls that together contain the mesh by construction.

Space is divided by planes across x, y or z into cells C. The body S is covered, cell by cell, by the hull of

- the triangles of its surface, clipped to C, and
- the corners of C that are inside S.

Proof. S and C are closed and bounded, so the intersection of S and C is contained in the hull of its extreme points
(Minkowski; Rockafellar, 1970, "Convex analysis", corollary 18.5.1). An extreme point x on the surface of S is on a
triangle clipped to C. If x is not on the surface, a ball around x is inside S, so x is also extreme in C: a corner of C
inside S. All triangles of the surface are covered because the cells cover space, also for meshes that are not closed.

The choice of the planes only determines how closely the hulls fit. The measure of a cell is the volume between its
surface and its hull: the integral over the surface of the distance to the hull along the outward normal. Unlike the
volume of the hull, it decreases with every wall that is separated from a hollow body.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import combinations, product
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pinproof.collision.geometry.triangles import PointHull, cut_crossing, with_area
from pinproof.spatial import Array

if TYPE_CHECKING:
    from collections.abc import Callable


PIECES = 12
"""Maximum number of hulls: more hulls increase the number of pairs more than they improve the fit."""

CELLS = 20
"""Maximum number of cells; some of their hulls are merged again."""

WORTH = 0.02
"""A cell is divided while its volume between surface and hull exceeds this share of the box around the mesh."""

IDLE = 0.01
"""Hulls are merged if that adds less than this share of the volume of the whole hull."""

SNUG = 1.1
"""A hull of at most this multiple of the body's volume is not divided."""

CLOSE = 1.15
"""A cover by halving of at most this multiple of the body's volume is accepted; otherwise better cuts are searched."""

SHARES = (0.15, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85)
"""Relative positions of tried cuts along a cell; as many of the largest faces across the axis are tried too."""

AROUND = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if d > (0.0, 0.0, 0.0)])
"""(13, 3) directions along which, in both senses, the extent of a surface is computed."""

ACROSS = 0.999
"""A face is across an axis if that component of its unit normal is at least this."""

FEW = 400
"""Number of triangles, spread evenly by area, that are used to choose a cut; the cover contains all triangles."""

SAMPLES = 400
"""Number of points on the surface, spread evenly by area, at which the distance to the hull is measured."""


def clusters(corners: Array, contains: Callable[[Array], bool], pieces: int = PIECES) -> list[Array]:
    """Return the points of each hull of a cover, from 1 to ``pieces`` arrays (V_i, 3).

    ``corners`` (F, 3, 3) are the triangles. ``contains`` states whether any of the points (N, 3) is inside the body; it
    is always false for a surface without an inside.
    """
    flat = corners.reshape(-1, 3)
    # Cells share corners, and the test whether a corner is inside the body is slow.
    known = cache(lambda *corner: contains(np.array([corner])))
    mesh_cell = _MeshCell(corners, np.array([flat.min(axis=0), flat.max(axis=0)]), known)
    enclosed = abs(float(np.linalg.det(corners - mesh_cell.box.mean(axis=0)).sum())) / 6
    if 0 < mesh_cell.hull.volume <= SNUG * enclosed:
        return [mesh_cell.hull.points]
    halves = _joined(_cut_up(mesh_cell, False, pieces), pieces)
    if sum(hull.volume for hull in halves) > CLOSE * enclosed:
        covers = [halves, _joined(_cut_up(mesh_cell, True, pieces), pieces)]
        halves = min(covers, key=lambda hulls: sum(hull.volume for hull in hulls))
    return [hull.points for hull in halves]


def _cut_up(mesh_cell: _MeshCell, closely: bool, pieces: int) -> list[PointHull]:
    """Return the hulls of the cells: cut at the best plane, or in halves, which suits round and hollow bodies."""
    least = WORTH * float(np.prod(np.ptp(mesh_cell.box, axis=0)))
    number = 0
    queue = [(-mesh_cell.space, number, mesh_cell)]
    done: list[PointHull] = []
    while queue:
        cell = heapq.heappop(queue)[2]
        if len(queue) + len(done) + 1 >= max(CELLS, pieces) or cell.space <= least:
            done.append(cell.hull)
            continue
        for half in cell.cut(*(cell.best_cut if closely else cell.middle)):
            if len(half.corners) or len(half.inner):
                number += 1
                heapq.heappush(queue, (-half.space, number, half))
    return done


def _joined(hulls: list[PointHull], pieces: int) -> list[PointHull]:
    """Merge hulls whose common hull is hardly larger; it contains both."""
    idle = IDLE * PointHull(np.concatenate([hull.points for hull in hulls])).volume
    both: dict[tuple[int, int], tuple[float, PointHull]] = {}
    alive = dict(enumerate(hulls))
    while len(alive) > 1:
        pairs = list(combinations(alive, 2))
        near = [(i, j) for i, j in pairs if _meet(alive[i], alive[j])]
        if not near and len(alive) <= pieces:
            break
        for i, j in near or pairs:
            if (i, j) not in both:
                hull = PointHull(np.concatenate([alive[i].points, alive[j].points]))
                both[i, j] = hull.volume - alive[i].volume - alive[j].volume, hull
        i, j = min(near or pairs, key=lambda pair: both[pair][0])
        more, hull = both[i, j]
        if more > idle and len(alive) <= pieces:
            break
        del alive[i], alive[j]
        alive[max(i, j, *alive, *map(max, both)) + 1] = hull
    return list(alive.values())


def _meet(one: PointHull, other: PointHull) -> bool:
    """Whether the boxes around two hulls meet."""
    return bool((one.box[0] <= other.box[1]).all() and (other.box[0] <= one.box[1]).all())


@dataclass
class _MeshCell:
    """A box (2, 3) of space and the triangles (F, 3, 3) clipped to it."""

    corners: Array
    box: Array
    contains: Callable[[float, float, float], bool] = field(repr=False)

    @cached_property
    def inner(self) -> Array:
        """The corners of the cell that are inside the body."""
        inside = [corner for corner in product(*self.box.T.tolist()) if self.contains(*corner)]
        return np.array(inside).reshape(-1, 3)

    @cached_property
    def points(self) -> Array:
        """The points whose hull is computed."""
        return np.unique(np.concatenate([self.corners.reshape(-1, 3), self.inner]), axis=0)

    @cached_property
    def hull(self) -> PointHull:
        """The hull that covers the body in this cell."""
        return PointHull(self.points)

    @property
    def middle(self) -> tuple[int, float]:
        """The axis of the longest side, and the position of its middle."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        axis = int((high - low).argmax())
        return axis, float(low[axis] + high[axis]) / 2

    @cached_property
    def best_cut(self) -> tuple[int, float]:
        """The axis and position of the cut with the smallest remaining volume; the middle if no cut is better."""
        few = _MeshCell(self._few(), self.box, lambda *_: False)
        best, least = self.middle, self.space * (1 - 1e-9)
        for axis in range(3):
            for place in _places(self.corners, axis):
                left = sum(half.space for half in few.cut(axis, place))
                if left < least:
                    best, least = (axis, place), left * (1 - 1e-9)
        return best

    def _few(self) -> Array:
        """Return a subset of the triangles for choosing a cut: spread by area, and those of largest extent."""
        corners, _, areas = with_area(self.corners)
        if len(corners) <= FEW:
            return corners
        flat = corners.reshape(-1, 3)
        farthest = np.concatenate([(flat @ AROUND.T).argmax(axis=0), (flat @ AROUND.T).argmin(axis=0)]) // 3
        return corners[np.union1d(_spread(areas, FEW), farthest)]

    @cached_property
    def space(self) -> float:
        """The volume (m^3) between surface and hull, as defined above; 0 if the hull is flat."""
        corners, normals, areas = with_area(self.corners)
        # A face in a wall of the cell with its normal inward belongs to the part of the body in the next cell.
        for axis in range(3):
            low, high = ((corners[:, :, axis] == wall).all(axis=1) for wall in self.box[:, axis])
            areas = np.where((low & (normals[:, axis] > 0)) | (high & (normals[:, axis] < 0)), 0.0, areas)
        total = float(areas.sum())
        if total == 0 or len(self.hull.planes) == 0:
            return 0.0
        chosen, times = np.unique(_spread(areas, SAMPLES), return_counts=True)
        distance = self.hull.space(corners[chosen].mean(axis=1), normals[chosen])
        return float(np.minimum(distance, np.linalg.norm(np.ptp(self.points, axis=0))) @ times) * total / SAMPLES

    def cut(self, axis: int, place: float) -> tuple[_MeshCell, _MeshCell]:
        """Return the two cells on both sides of a plane."""
        below, above = self.box.copy(), self.box.copy()
        below[1, axis] = above[0, axis] = place
        lower, upper = _split(self.corners, axis, place)
        return _MeshCell(lower, below, self.contains), _MeshCell(upper, above, self.contains)


def _spread(areas: Array, count: int) -> npt.NDArray[np.int64]:
    """Return the faces at ``count`` points that are spread evenly over the areas (F,)."""
    ends = np.cumsum(areas)
    here = np.searchsorted(ends, (np.arange(count) + 0.5) * ends[-1] / count)
    return np.minimum(here, len(areas) - 1)


def _places(corners: Array, axis: int) -> list[float]:
    """Return the positions of cuts to try along an axis."""
    low, high = float(corners[:, :, axis].min()), float(corners[:, :, axis].max())
    faces, normals, areas = with_area(corners)
    across = np.abs(normals[:, axis]) > ACROSS
    planes, index = np.unique(faces[across, 0, axis], return_inverse=True)
    largest = np.argsort(-np.bincount(index.ravel(), areas[across], len(planes)), kind="stable")
    tried = {*(low + share * (high - low) for share in SHARES), *planes[largest[: len(SHARES)]].tolist()}
    return sorted(place for place in tried if low < place < high)


def _split(corners: Array, axis: int, place: float) -> tuple[Array, Array]:
    """Return the triangles below and above a plane, cut where they cross it; those in it belong to both."""
    heights = corners[:, :, axis] - place
    lower, upper = cut_crossing(corners, heights)
    # Rounding must not move a corner beyond the plane.
    lower[:, :, axis], upper[:, :, axis] = np.minimum(lower[:, :, axis], place), np.maximum(upper[:, :, axis], place)
    below, above = (heights <= 0).all(axis=1), (heights >= 0).all(axis=1)
    return np.concatenate([corners[below], lower]), np.concatenate([corners[above], upper])
