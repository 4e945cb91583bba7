"""The bodies of a checker placed at a configuration, and the distances between them.

Convex bodies are checked by the compiled core, whose bounds hold independently of the convergence of the iteration.
Coal checks bodies without a support function, and computes penetration depths.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from pinproof._core import Workspace, World
from pinproof.collision.checking.assembly import CheckedBodies
from pinproof.collision.geometry.bodies import Body
from pinproof.spatial import Array

GJK_TOLERANCE = 1e-8
"""GJK stops when its distance d is within GJK_TOLERANCE (1 + d) metres of the true one, and not below it by more than
rounding (verified for boxes and cylinders against triangles). Coal's default of 1e-6 leaves 4e-6 m at d = 3 m."""

GJK_ITERATIONS = 1000
"""Coal's default of 128 is not enough for long thin cylinders."""

GJK_SLACK = 2e-6
"""Metres: a conservative bound of the error of coal's distances at the size of a robot cell. Pairs that coal checks
are free only beyond it."""


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


class MeasureConvex:
    """Measures the distance of two convex bodies; each thread needs its own instance."""

    def __init__(self) -> None:
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        _configure(self._request)

    def __call__(self, one: Body, at: Array, other: Body, other_at: Array) -> Distance:
        """Return their distance at the placements ``at`` and ``other_at`` (4, 4)."""
        return self.of(one.geometry, at, other.geometry, other_at)

    def of(self, one: Any, at: Array, other: Any, other_at: Array) -> Distance:
        """Return the distance of two convex coal shapes."""
        first, second = (coal.Transform3s(place[:3, :3], place[:3, 3]) for place in (at, other_at))
        result = self._result
        result.clear()
        distance = float(coal.distance(one, first, other, second, self._request, result))
        points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
        return Distance(distance, distance - GJK_SLACK, distance, points, np.array(result.normal))


def _configure(request: Any) -> None:
    """Configure a coal request so that its result does not depend on earlier queries, as those of Pinocchio do."""
    request.gjk_initial_guess = coal.GJKInitialGuess.DefaultGuess
    request.gjk_tolerance, request.gjk_max_iterations = GJK_TOLERANCE, GJK_ITERATIONS


class NearestBodies(NamedTuple):
    """The smallest distance (m) at a configuration, as far as the compiled core determines it."""

    contacts: list[int]  # the pairs that overlap
    left_to_coal: list[int]  # the pairs that coal has to measure
    lower: float  # a lower bound over all other pairs; inf without one
    upper: float  # an upper bound, or one of a pair that overlaps
    nearest: int  # the pair of the upper bound, or -1


class PlacedBodies:
    """The bodies of a checker at one configuration, in its ``world`` or a part of it; each thread needs its own."""

    def __init__(self, checker: CheckedBodies, world: World) -> None:
        self._checker, self._core = checker, Workspace(world)
        self._q = np.zeros(checker.group.dof)
        self._moves = self._moves_by_coal = 0
        self._coal: Any = None
        self._convex: MeasureConvex | None = None
        self.core_judge = self._core.judge
        """:meth:`judge` for a contiguous array of doubles, without preparation for :meth:`any_left_touches`."""
        self.judge_many = self._core.judge_many
        """(N,) the result of :meth:`judge` for each row of Q (N, n)."""
        self.root_from_body = self._core.root_from_body
        """The placement (4, 4) of the body with an index."""

    def judge(self, q: Array) -> int:
        """Place every body at q (n,), and return the number of pairs that coal has to check.

        Or a negative number: ``CONTACT`` of the core if another pair is in contact, ``NOT_FINITE`` if q is not finite.
        """
        left: int = self._core.judge(np.ascontiguousarray(q, dtype=float))
        if left > 0:
            self._moved(q)
        return left

    def any_left_touches(self) -> bool:
        """Whether one of the pairs that coal has to check after :meth:`judge` is within its margin."""
        return any(self.touches(k) for k in self._core.left)

    def clearances(self, Q: Array) -> Array:
        """Return (N,) the smallest distance at each row of Q (N, n); NaN where coal is needed to determine it."""
        lower, open_pairs = self._core.find_nearest_many(Q)
        lower[open_pairs] = np.nan
        return np.asarray(lower)

    def nearest(self, q: Array) -> NearestBodies:
        """Place every body at q (n,), finite, and find the pair with the smallest distance."""
        self._moved(q)
        return NearestBodies(*self._core.find_nearest(self._q))

    def contacts(self, q: Array) -> list[int]:
        """Return the pairs in contact at q (n,), finite, that a joint moves relative to each other."""
        self._moved(q)
        contacts, left_to_coal = self._core.find_contacts(self._q)
        return [*contacts, *(k for k in left_to_coal if self.touches(k))]

    def touching(self, q: Array) -> list[tuple[int, Distance]]:
        """Return the pairs of :meth:`contacts` with their distances."""
        return [(k, self.measure(k)) for k in self.contacts(q)]

    def move(self, q: Array) -> None:
        """Place every body at q (n,), finite."""
        self._moved(q)
        self._core.place(self._q)

    def measure(self, k: int) -> Distance:
        """Return the distance of pair k; a body inside an exact watertight mesh penetrates it."""
        if not self._checker.convex[k]:
            result = pin.computeDistance(self._checker._coal_geometry(), self._by_coal(), k)
            distance = float(result.min_distance)
            points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
            if distance > 0 and self.one_inside_other(k):
                distance = -distance
            return Distance(distance, distance - GJK_SLACK, distance, points, np.array(result.normal))
        lower, upper, points, normal = self._core.measure(k)
        if lower > 0:
            return Distance(lower, lower, upper, points, normal)
        # Bodies that the core does not prove apart are measured by coal, which knows depths.
        i, j = self._checker.pairs[k]
        bodies, place = self._checker.bodies, self.root_from_body
        if self._convex is None:
            self._convex = MeasureConvex()
        deep = self._convex(bodies[i], place(i), bodies[j], place(j))
        return deep._replace(distance=min(deep.distance, upper), proven=lower, attained=upper)

    def touches(self, k: int) -> bool:
        """Whether pair k, which coal has to check, is within its margin, or one body is inside the other."""
        checker = self._checker
        if pin.computeCollision(checker._coal_geometry(), self._by_coal(), k) or self.one_inside_other(k):
            return True
        # Coal's collide misses some triangles without an area. In a watertight mesh they lie on edges of triangles with
        # one, so only contacts of two meshes, of which one is not watertight, can be missed.
        solids = [checker.bodies[i].solid for i in checker.pairs[k]]
        meshes = all(s is not None for s in solids) and not all(s.watertight for s in solids if s is not None)
        return meshes and self.measure(k).proven <= checker.margins[k]

    def one_inside_other(self, k: int) -> bool:
        """Whether a part of one body of pair k lies inside the exact watertight mesh of the other."""
        i, j = self._checker.pairs[k]
        one, other, placed = self._checker.bodies[i], self._checker.bodies[j], self._by_coal().oMg
        return one.contains_part_of(other, placed[i].actInv(placed[j])) or other.contains_part_of(
            one, placed[j].actInv(placed[i])
        )

    def _moved(self, q: Array) -> None:
        self._q[:] = q
        self._moves += 1

    def _by_coal(self) -> Any:
        """Return coal's data of all bodies at the configuration; they are made when coal is first needed."""
        group, margins, geometry = self._checker.group, self._checker.margins, self._checker._coal_geometry()
        if self._coal is None:
            # Made after the last geometry was added: adding one later corrupts memory.
            self._coal, self._data = geometry.createData(), group.model.createData()
            for k, margin in enumerate(margins.tolist()):
                collision, distance = coal.CollisionRequest(), coal.DistanceRequest()
                collision.security_margin = margin + GJK_SLACK
                for request in (collision, distance):
                    _configure(request)
                self._coal.collisionRequests[k], self._coal.distanceRequests[k] = collision, distance
        if self._moves_by_coal != self._moves:
            q = group.model_configuration(self._q)
            pin.updateGeometryPlacements(group.model, self._data, geometry, self._coal, q)
            self._moves_by_coal = self._moves
        return self._coal


class FixedPairs(NamedTuple):
    """The result for the pairs that no joint moves relative to each other: the same at every configuration."""

    touching: tuple[tuple[int, Distance], ...]  # the pairs in contact
    lower: float  # the smallest signed distance (m), as in CollisionChecker.clearance
    upper: float  # an upper bound (m) of it
