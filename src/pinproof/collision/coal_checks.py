"""Coal's view of the bodies of a checker: it judges what has no support function, and how deep bodies overlap.

Pinocchio's and coal's own answers on the bodies and pairs of a checker, as they come out of the box.

Nothing here is used by a check or a proof: it is what these are compared with, in verdicts and in time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.assembly import CheckedBodies
from pinproof.collision.bodies import Body

__all__ = [
    "GJK_SLACK",
    "GJK_TOLERANCE",
    "ByCoal",
    "Distance",
    "MeasureConvex",
    "PlainCoal",
]

Array = npt.NDArray[np.float64]

GJK_TOLERANCE = 1e-8
"""GJK stops when its distance d is within GJK_TOLERANCE (1 + d) metres of the true one, never below it by more than
rounding; seen to hold on boxes and cylinders against triangles. Coal's default of 1e-6 leaves 4e-6 m at d = 3 m."""

GJK_ITERATIONS = 1000
"""Coal's default of 128 ends before that on long thin cylinders."""

GJK_SLACK = 2e-6
"""Metres. Where coal judges, "free" is only said beyond it: what its distances may be off, at any size a robot cell
has, with room."""


def _settle_boxes() -> None:
    """Ask coal once for a support point of a box, along a direction without zeros.

    Its support function of boxes decides in the first call of a process, and for good, whether boxes are 1e-10 larger
    than they are: they are if that first direction has a zero in it. Distances would differ between processes.
    """
    request = coal.DistanceRequest()
    request.gjk_initial_guess = coal.GJKInitialGuess.CachedGuess
    request.cached_gjk_guess = np.array([1.0, 2.0, 3.0])
    box, apart = coal.Box(1.0, 1.0, 1.0), coal.Transform3s(np.eye(3), np.array([3.0, 4.0, 5.0]))
    coal.distance(box, coal.Transform3s.Identity(), box, apart, request, coal.DistanceResult())


_settle_boxes()


class Distance(NamedTuple):
    """What is known of the distance of a pair of bodies."""

    distance: float
    """Signed metres: the proven lower bound where they are apart, else the penetration depth as coal knows it."""
    proven: float
    """A lower bound of the distance, up to rounding."""
    attained: float
    """An upper bound of it, 0 or less where they overlap."""
    points: Array
    """(2, 3) the nearest (or deepest) points in the root frame."""
    normal: Array
    """(3,) the unit vector from the first body to the second, in the root frame."""


class MeasureConvex:
    """Measures the distance of two convex bodies; one a thread."""

    def __init__(self) -> None:
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        _settle(self._request)

    def __call__(self, one: Body, at: Array, other: Body, other_at: Array) -> Distance:
        """Their distance where they stand at ``at`` and ``other_at``: rotation row by row, translation."""
        return self.of(one.geometry, at, other.geometry, other_at)

    def of(self, one: Any, at: Array, other: Any, other_at: Array) -> Distance:
        """The same of two convex shapes of coal's."""
        first, second = (coal.Transform3s(place[:9].reshape(3, 3), place[9:12]) for place in (at, other_at))
        result = self._result
        result.clear()
        distance = float(coal.distance(one, first, other, second, self._request, result))
        points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
        return Distance(distance, distance - GJK_SLACK, distance, points, np.array(result.normal))


def _settle(request: Any) -> None:
    """Tell coal how to answer: the same whatever was asked before.

    Pinocchio's own requests start GJK where the pair's last query ended, so that answers move in their last digits with
    the order of the questions, and with the number of threads.
    """
    request.gjk_initial_guess = coal.GJKInitialGuess.DefaultGuess
    request.gjk_tolerance, request.gjk_max_iterations = GJK_TOLERANCE, GJK_ITERATIONS


class ByCoal:
    """The bodies of a checker in a workspace of coal's; one a thread."""

    def __init__(self, checker: CheckedBodies) -> None:
        self._arm, self._bodies, self._pairs = checker.arm, checker.bodies, checker.pairs
        self._margins = checker.margins
        self._model, self._geometry_model = checker.arm.model, checker.geometry_model
        self._data = self._model.createData()
        # Made after the last geometry was added: adding one later corrupts memory.
        self._geometry_data = self._geometry_model.createData()
        self._set_requests()
        self._moves = 0

    def move(self, q: Array, moves: int) -> None:
        """Place every body at q (n,), unless it is there since the same move."""
        if moves == self._moves:
            return
        pin.updateGeometryPlacements(
            self._model, self._data, self._geometry_model, self._geometry_data, self._arm.model_configuration(q)
        )
        self._moves = moves

    def measure(self, k: int) -> Distance:
        """The distance of pair k; a body inside an exact watertight mesh counts as penetrating it."""
        result = pin.computeDistance(self._geometry_model, self._geometry_data, k)
        distance = float(result.min_distance)
        points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
        if distance > 0 and self.one_inside_other(k):
            distance = -distance
        return Distance(distance, distance - GJK_SLACK, distance, points, np.array(result.normal))

    def touches(self, k: int) -> bool:
        """Whether pair k comes within its margin, or one body lies inside the other."""
        if pin.computeCollision(self._geometry_model, self._geometry_data, k) or self.one_inside_other(k):
            return True
        return self._needles(k) and self.measure(k).proven <= self._margins[k]

    def _needles(self, k: int) -> bool:
        """Whether triangles without area may be all that touches: coal's collide misses some of them.

        In a watertight mesh they lie in edges of triangles with an area.
        """
        solids = [self._bodies[i].solid for i in self._pairs[k]]
        return all(s is not None for s in solids) and not all(s.watertight for s in solids if s is not None)

    def one_inside_other(self, k: int) -> bool:
        """Whether a part of one body of pair k lies inside the exact watertight mesh of the other."""
        i, j = self._pairs[k]
        return self._inside_of(i, j) or self._inside_of(j, i)

    def _inside_of(self, outer: int, inner: int) -> bool:
        solid, body = self._bodies[outer].solid, self._bodies[inner]
        if solid is None or not solid.watertight:
            return False
        outer_from_inner = self._geometry_data.oMg[outer].actInv(self._geometry_data.oMg[inner])
        return solid.contains(body.witnesses @ outer_from_inner.rotation.T + outer_from_inner.translation)

    def _set_requests(self) -> None:
        for k, margin in enumerate(self._margins.tolist()):
            collision, distance = coal.CollisionRequest(), coal.DistanceRequest()
            collision.security_margin = margin + GJK_SLACK
            for request in (collision, distance):
                _settle(request)
            self._geometry_data.collisionRequests[k] = collision
            self._geometry_data.distanceRequests[k] = distance


class PlainCoal:
    """Checks by Pinocchio and coal alone; margins are those of the checker.

    Parameters
    ----------
    checker
        Which arm, bodies, pairs and margins.
    broadphase
        Let coal's dynamic tree of boxes choose the pairs to look at, in place of looking at each.
    """

    def __init__(self, checker: CheckedBodies, *, broadphase: bool = False) -> None:
        self._model, self._geometry = checker.arm.model, checker.geometry_model
        self._data, self._bodies = self._model.createData(), self._geometry.createData()
        for k, margin in enumerate(checker.margins.tolist()):
            request = self._bodies.collisionRequests[k]
            request.security_margin = margin
            self._bodies.collisionRequests[k] = request
        self._configuration, self._any = checker.arm.model_configuration, bool(checker.pairs)
        self._tree = None
        if broadphase:
            self._tree = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
                self._model, self._geometry, self._bodies
            )

    def configurations(self, many: Array) -> list[Array]:
        """Configurations (N, n) of the arm as the model takes them, so that timing a check times nothing else."""
        return [self._configuration(q) for q in many]

    def is_free(self, q: Array) -> bool:
        """Whether no pair is found to come within its margin at a model's configuration."""
        if self._tree is not None:
            return not pin.computeCollisions(self._model, self._data, self._tree, q, True)
        return not pin.computeCollisions(self._model, self._data, self._geometry, self._bodies, q, True)

    def clearance(self, q: Array) -> float:
        """The smallest signed distance (m) over all pairs at a model's configuration; inf without pairs."""
        if not self._any:
            return np.inf
        nearest = pin.computeDistances(self._model, self._data, self._geometry, self._bodies, q)
        return float(self._bodies.distanceResults[nearest].min_distance)
