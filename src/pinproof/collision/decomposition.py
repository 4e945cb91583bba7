"""Meshes as several convex hulls that together hold all of them, by construction.

Space is cut by planes across x, y or z into cells C. The body S is covered, cell by cell, by the hull of

- the triangles of its surface, cut to C, and
- the corners of C that lie in S.

Proof. S and C are closed and bounded, so S n C lies in the hull of its extreme points (Minkowski; Rockafellar, 1970,
"Convex analysis", corollary 18.5.1). An extreme point x on the surface of S lies in a triangle cut to C. If x is not on
the surface, a ball around x lies in S, so x is extreme in C too: a corner of C that lies in S. The whole triangles of
the surface are covered all the more, since the cells cover space; this holds for meshes that are not closed, too.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["clusters"]

Array = npt.NDArray[np.float64]

PIECES = 12
"""Hulls at most: with more, pairs grow faster than what they gain."""

WORTH = 0.02
"""A cut must save this share of the volume of the mesh's hull."""

SHARES = (0.15, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85)
"""Where cuts are tried along a cell; and at as many coordinates of vertices, where walls and steps stand."""


def clusters(corners: Array, contains: Callable[[Array], bool], pieces: int = PIECES) -> list[Array]:
    """The points of each hull of a cover, from 1 to ``pieces`` arrays (V_i, 3).

    Parameters
    ----------
    corners
        (F, 3, 3) the corners of the triangles.
    contains
        Whether any of the points (N, 3) lies in the body; never for a surface without an inside.
    """
    flat = corners.reshape(-1, 3)
    whole = _Cell(corners, np.array([flat.min(axis=0), flat.max(axis=0)]), contains)
    least = WORTH * whole.volume
    order = 0
    queue = [(-whole.best_cut[0], order, whole)]
    while len(queue) < pieces:
        saved, _, cell = queue[0]
        if -saved <= least:
            break
        heapq.heappop(queue)
        for half in cell.cut(*cell.best_cut[1:]):
            if len(half.corners) or len(half.inner):
                order += 1
                heapq.heappush(queue, (-half.best_cut[0], order, half))
    return [cell.points for _, _, cell in sorted(queue, key=lambda entry: entry[1])]


@dataclass
class _Cell:
    """A box (2, 3) of space and the triangles (F, 3, 3) cut to it."""

    corners: Array
    box: Array
    contains: Callable[[Array], bool] = field(repr=False)

    @cached_property
    def inner(self) -> Array:
        """The corners of the cell that lie in the body."""
        here = np.array(list(product(*self.box.T)))
        return here[[self.contains(corner[None]) for corner in here]]

    @cached_property
    def points(self) -> Array:
        """What the hull is taken of."""
        return np.unique(np.concatenate([self.corners.reshape(-1, 3), self.inner]), axis=0)

    @cached_property
    def volume(self) -> float:
        return _hull_volume(self.points)

    @cached_property
    def best_cut(self) -> tuple[float, int, float]:
        """The volume (m^3) that the best cut saves, and its axis and place."""
        best = (0.0, 0, 0.0)
        for axis in range(3):
            low, high = float(self.points[:, axis].min()), float(self.points[:, axis].max())
            if high - low < 1e-6:
                continue
            steps = np.quantile(np.unique(self.points[:, axis]), SHARES, method="nearest")
            places = {float(p) for p in (*(low + share * (high - low) for share in SHARES), *steps) if low < p < high}
            for place in sorted(places):
                halves = [half.points for half in self.cut(axis, place, quick=True)]
                saved = self.volume - sum(_hull_volume(points) for points in halves)
                if saved > best[0] * (1 + 1e-9):
                    best = (saved, axis, place)
        return best

    def cut(self, axis: int, place: float, *, quick: bool = False) -> tuple[_Cell, _Cell]:
        """The two cells on both sides of a plane; ``quick`` ones do not look for corners that lie in the body."""
        contains = (lambda _: False) if quick else self.contains
        below, above = self.box.copy(), self.box.copy()
        below[1, axis] = above[0, axis] = place
        lower, upper = _split(self.corners, axis, place)
        return _Cell(lower, below, contains), _Cell(upper, above, contains)


def _hull_volume(points: Array) -> float:
    """The volume (m^3) of the hull, 0 where Qhull finds it flat."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 4:
        return 0.0
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0


def _split(corners: Array, axis: int, place: float) -> tuple[Array, Array]:
    """The triangles below and above a plane; what crosses it is cut, what lies in it belongs to both."""
    side = np.sign(corners[:, :, axis] - place)
    below, above = (side <= 0).all(axis=1), (side >= 0).all(axis=1)
    crossing = ~(below | above)
    lower, upper = [corners[below]], [corners[above]]
    # Turn each so that its first corner is alone on its side; a corner in the plane counts to the other two.
    torn, signs = corners[crossing], side[crossing]
    alone = np.argmax([(signs[:, i] * signs[:, j] <= 0) & (signs[:, i] * signs[:, k] <= 0) & (signs[:, i] != 0)
                       for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))], axis=0)  # fmt: skip
    rows = np.arange(len(torn))[:, None]
    turned = torn[rows, (alone[:, None] + np.arange(3)) % 3]
    a, b, c = np.moveaxis(turned, 1, 0)
    with_a = signs[rows[:, 0], alone] < 0
    p, q = (_between(a, end, axis, place) for end in (b, c))
    tip, rest = np.stack([a, p, q], axis=1), [np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)]
    lower += [tip[with_a], *(part[~with_a] for part in rest)]
    upper += [tip[~with_a], *(part[with_a] for part in rest)]
    return np.concatenate(lower), np.concatenate(upper)


def _between(a: Array, b: Array, axis: int, place: float) -> Array:
    """Where the lines from a to b (N, 3) cross the plane."""
    share = (place - a[:, axis]) / (b[:, axis] - a[:, axis])
    crossing = np.asarray(a + share[:, None] * (b - a))
    crossing[:, axis] = place
    return crossing
