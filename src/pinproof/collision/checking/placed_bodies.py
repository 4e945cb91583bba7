"""The bodies of a checker placed at a configuration, and the distances between them.

The compiled core bounds distances; its bounds hold independently of the convergence of the iteration. Coal computes
penetration depths.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import coal
import numpy as np

from pinproof._core import Workspace, World
from pinproof.collision.checking.assembly import CheckedBodies
from pinproof.collision.geometry.bodies import MOST_TRIANGLES, Body, CellsBody
from pinproof.collision.geometry.hulls import bvh
from pinproof.spatial import Array

GJK_TOLERANCE = 1e-8
"""GJK stops when its distance d is within GJK_TOLERANCE (1 + d) metres of the true one, and not below it by more than
rounding (verified for boxes and cylinders against triangles). Coal's default of 1e-6 leaves 4e-6 m at d = 3 m."""

GJK_ITERATIONS = 1000
"""Coal's default of 128 is not enough for long thin cylinders."""

GJK_SLACK = 2e-6
"""Metres: a conservative bound of the error of coal's distances at the size of a robot cell."""


# In the first call of a process, coal's support function of boxes decides permanently whether boxes are enlarged by
# 1e-10: they are if that first direction contains a zero. Without a query along another direction, distances differ
# between processes.
_request = coal.DistanceRequest()
_request.gjk_initial_guess, _request.cached_gjk_guess = coal.GJKInitialGuess.CachedGuess, np.array([1.0, 2.0, 3.0])
_box, _apart = coal.Box(1.0, 1.0, 1.0), coal.Transform3s(np.eye(3), np.array([3.0, 4.0, 5.0]))
coal.distance(_box, coal.Transform3s.Identity(), _box, _apart, _request, coal.DistanceResult())


class Distance(NamedTuple):
    """Bounds (m) of the distance of a pair of bodies, with the nearest (or deepest) points (2, 3) in the root frame."""

    distance: float  # signed: the proven lower bound if they are apart, otherwise minus coal's penetration depth
    proven: float  # a lower bound, up to rounding
    attained: float  # an upper bound, 0 or less if they overlap
    points: Array
    normal: Array  # (3,) the unit vector from the first body to the second


class MeasureByCoal:
    """Measures the distance of two bodies by coal; each thread needs its own instance."""

    def __init__(self) -> None:
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        # The result must not depend on earlier queries, as those of Pinocchio do.
        self._request.gjk_initial_guess = coal.GJKInitialGuess.DefaultGuess
        self._request.gjk_tolerance, self._request.gjk_max_iterations = GJK_TOLERANCE, GJK_ITERATIONS

    def __call__(self, one: Body, at: Array, other: Body, other_at: Array) -> Distance:
        """Return their distance at the placements ``at`` and ``other_at`` (4, 4)."""
        return self.of(one.geometry, at, other.geometry, other_at)

    def of(self, one: Any, at: Array, other: Any, other_at: Array) -> Distance:
        """Return the distance of two coal shapes."""
        first, second = (coal.Transform3s(place[:3, :3], place[:3, 3]) for place in (at, other_at))
        result = self._result
        result.clear()
        distance = float(coal.distance(one, first, other, second, self._request, result))
        points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
        return Distance(distance, distance - GJK_SLACK, distance, points, np.array(result.normal))


class NearestBodies(NamedTuple):
    """The smallest distance (m) at a configuration."""

    contacts: list[int]  # the pairs that overlap
    lower: float  # a lower bound over all other pairs; inf without one
    upper: float  # an upper bound, or one of a pair that overlaps
    nearest: int  # the pair of the upper bound, or -1


class PlacedBodies:
    """The bodies of a checker at one configuration, in its ``world`` or a part of it; each thread needs its own."""

    def __init__(self, checker: CheckedBodies, world: World) -> None:
        self._checker, self._core = checker, Workspace(world)
        self._coal: MeasureByCoal | None = None
        self.judge = self._core.judge
        """Place every body at q (n,), contiguous doubles: ``FREE``, ``CONTACT`` or ``NOT_FINITE`` of the core."""
        self.judge_many = self._core.judge_many
        """(N,) the result of :meth:`judge` for each row of Q (N, n)."""
        self.root_from_body = self._core.root_from_body
        """The placement (4, 4) of the body with an index."""

    def clearances(self, Q: Array) -> Array:
        """Return (N,) the smallest distance at each row of Q (N, n); NaN where bodies overlap."""
        lower, overlap = self._core.find_nearest_many(Q)
        lower[overlap] = np.nan
        return np.asarray(lower)

    def nearest(self, q: Array) -> NearestBodies:
        """Place every body at q (n,), finite, and find the pair with the smallest distance."""
        return NearestBodies(*self._core.find_nearest(q))

    def contacts(self, q: Array) -> list[int]:
        """Return the pairs in contact at q (n,), finite, that a joint moves relative to each other."""
        return list(self._core.find_contacts(q))

    def touching(self, q: Array) -> list[tuple[int, Distance]]:
        """Return the pairs of :meth:`contacts` with their distances."""
        return [(k, self.measure(k)) for k in self.contacts(q)]

    def move(self, q: Array) -> None:
        """Place every body at q (n,), finite."""
        self._core.place(q)

    def measure(self, k: int) -> Distance:
        """Return the distance of pair k; a body inside an exact watertight mesh penetrates it."""
        lower, upper, points, normal, *closest = self._core.measure(k)
        if lower > 0:
            return Distance(lower, lower, upper, points, normal)
        # Bodies that the core does not prove apart are measured by coal, which knows depths.
        i, j = self._checker.indices_of(k)
        bodies, place = self._checker.bodies, self.root_from_body
        if self._coal is None:
            self._coal = MeasureByCoal()
        one, other, root_from_other = bodies[i], bodies[j], place(j)
        if isinstance(other, CellsBody):  # each of its boxes is measured as a body of its own
            convex, found = one.support is not None, []
            for centre, half in self._core.overlapping_boxes(k):
                at = root_from_other.copy()
                at[:3, 3] += at[:3, :3] @ centre
                found.append(self._coal.of(one.geometry, place(i), coal.Box(*(2 * half)), at))
        else:
            convex = bool(self._checker.convex[k])
            # Of a large mesh, the triangle that the core found closest suffices: a tree for coal would take seconds.
            first, second = (
                bvh(triangle, np.array([[0, 1, 2]]))
                if triangle is not None and body.solid is not None and len(body.solid.surface) > MOST_TRIANGLES
                else body.geometry
                for body, triangle in zip((one, other), closest, strict=True)
            )
            found = [self._coal.of(first, place(i), second, root_from_other)]
        # Without convexity, one may be inside the other without touching its surface.
        inside = upper <= 0 and not convex
        depths = [-abs(deep.distance) if inside else min(deep.distance, upper) for deep in found]
        deepest = int(np.argmin(depths))
        return found[deepest]._replace(distance=depths[deepest], proven=lower, attained=upper)


class FixedPairs(NamedTuple):
    """The result for the pairs that no joint moves relative to each other: the same at every configuration."""

    touching: tuple[tuple[int, Distance], ...]  # the pairs in contact
    lower: float  # the smallest signed distance (m), as in CollisionChecker.clearance
    upper: float  # an upper bound (m) of it
