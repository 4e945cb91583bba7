"""Checks by coal: bodies without a support function, penetration depths, and plain checks for comparison."""

from __future__ import annotations

from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

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


def _fix_box_supports() -> None:
    """Query coal once for a support point of a box, along a direction without zeros.

    In the first call of a process, coal's support function of boxes decides permanently whether boxes are enlarged by
    1e-10: they are if that first direction contains a zero. Without this call distances differ between processes.
    """
    request = coal.DistanceRequest()
    request.gjk_initial_guess = coal.GJKInitialGuess.CachedGuess
    request.cached_gjk_guess = np.array([1.0, 2.0, 3.0])
    box, apart = coal.Box(1.0, 1.0, 1.0), coal.Transform3s(np.eye(3), np.array([3.0, 4.0, 5.0]))
    coal.distance(box, coal.Transform3s.Identity(), box, apart, request, coal.DistanceResult())


_fix_box_supports()


class Distance(NamedTuple):
    """Bounds of the distance of a pair of bodies."""

    distance: float
    """Signed distance (m): the proven lower bound if they are apart, otherwise minus coal's penetration depth."""
    proven: float
    """A lower bound (m) of the distance, up to rounding."""
    attained: float
    """An upper bound (m) of the distance, 0 or less if they overlap."""
    points: Array
    """(2, 3) the nearest (or deepest) points in the root frame."""
    normal: Array
    """(3,) the unit vector from the first body to the second, in the root frame."""


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
    """Configure a coal request so that its result does not depend on earlier queries.

    Pinocchio's own requests start GJK at the result of the pair's last query, so that the last digits depend on the
    order of the queries and on the number of threads.
    """
    request.gjk_initial_guess = coal.GJKInitialGuess.DefaultGuess
    request.gjk_tolerance, request.gjk_max_iterations = GJK_TOLERANCE, GJK_ITERATIONS


class CoalWorkspace:
    """The bodies of a checker in a coal workspace; each thread needs its own instance."""

    def __init__(self, checker: CheckedBodies) -> None:
        self._arm, self._bodies, self._pairs = checker.group, checker.bodies, checker.pairs
        self._margins = checker.margins
        self._model, self._geometry_model = checker.group.model, checker.coal_geometry()
        self._data = self._model.createData()
        # Made after the last geometry was added: adding one later corrupts memory.
        self._geometry_data = self._geometry_model.createData()
        self._set_requests()
        self._moves = 0

    def move(self, q: Array, moves: int) -> None:
        """Place every body at q (n,), unless this was done for the same number of ``moves``."""
        if moves == self._moves:
            return
        pin.updateGeometryPlacements(
            self._model, self._data, self._geometry_model, self._geometry_data, self._arm.model_configuration(q)
        )
        self._moves = moves

    def measure(self, k: int) -> Distance:
        """Return the distance of pair k; a body inside an exact watertight mesh penetrates it."""
        result = pin.computeDistance(self._geometry_model, self._geometry_data, k)
        distance = float(result.min_distance)
        points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
        if distance > 0 and self.one_inside_other(k):
            distance = -distance
        return Distance(distance, distance - GJK_SLACK, distance, points, np.array(result.normal))

    def touches(self, k: int) -> bool:
        """Whether pair k is within its margin, or one body is inside the other."""
        if pin.computeCollision(self._geometry_model, self._geometry_data, k) or self.one_inside_other(k):
            return True
        return self._may_have_degenerate_triangles(k) and self.measure(k).proven <= self._margins[k]

    def _may_have_degenerate_triangles(self, k: int) -> bool:
        """Whether possibly only triangles without area are in contact, some of which coal's collide misses.

        In a watertight mesh they lie on edges of triangles with an area.
        """
        solids = [self._bodies[i].solid for i in self._pairs[k]]
        return all(s is not None for s in solids) and not all(s.watertight for s in solids if s is not None)

    def one_inside_other(self, k: int) -> bool:
        """Whether a part of one body of pair k lies inside the exact watertight mesh of the other."""
        i, j = self._pairs[k]
        one, other, placed = self._bodies[i], self._bodies[j], self._geometry_data.oMg
        return one.contains_part_of(other, placed[i].actInv(placed[j])) or other.contains_part_of(
            one, placed[j].actInv(placed[i])
        )

    def _set_requests(self) -> None:
        for k, margin in enumerate(self._margins.tolist()):
            collision, distance = coal.CollisionRequest(), coal.DistanceRequest()
            collision.security_margin = margin + GJK_SLACK
            for request in (collision, distance):
                _configure(request)
            self._geometry_data.collisionRequests[k] = collision
            self._geometry_data.distanceRequests[k] = distance


class PlainCoal:
    """Checks by Pinocchio and coal alone, with the margins of the checker; used in benchmarks and tests only.

    ``broadphase`` uses the dynamic bounding-box tree of coal, instead of checking each pair.
    """

    def __init__(self, checker: CheckedBodies, *, broadphase: bool = False) -> None:
        self._model, self._geometry = checker.group.model, checker.coal_geometry()
        self._data, self._bodies = self._model.createData(), self._geometry.createData()
        for k, margin in enumerate(checker.margins.tolist()):
            request = self._bodies.collisionRequests[k]
            request.security_margin = margin
            self._bodies.collisionRequests[k] = request
        self._configuration, self._any = checker.group.model_configuration, bool(checker.pairs)
        self._tree = None
        if broadphase:
            self._tree = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
                self._model, self._geometry, self._bodies
            )

    def configurations(self, many: Array) -> list[Array]:
        """Return configurations (N, n) of the arm in the form of the model, so that timings contain the check only."""
        return [self._configuration(q) for q in many]

    def is_free(self, q: Array) -> bool:
        """Whether no pair is within its margin at a configuration of the model."""
        if self._tree is not None:
            return not pin.computeCollisions(self._model, self._data, self._tree, q, True)
        return not pin.computeCollisions(self._model, self._data, self._geometry, self._bodies, q, True)

    def clearance(self, q: Array) -> float:
        """Return the smallest signed distance (m) over all pairs at a configuration of the model; inf without pairs."""
        if not self._any:
            return np.inf
        nearest = pin.computeDistances(self._model, self._data, self._geometry, self._bodies, q)
        return float(self._bodies.distanceResults[nearest].min_distance)
