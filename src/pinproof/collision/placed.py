"""The bodies of a checker placed at a configuration, and the distances between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

if TYPE_CHECKING:
    from pinproof.collision.checker import CollisionChecker

__all__ = ["GJK_SLACK", "Placed"]

Array = npt.NDArray[np.float64]

GJK_TOLERANCE = 1e-8
"""GJK stops when its distance d is within GJK_TOLERANCE (1 + d) metres of the true one, never below it by more than
rounding; seen to hold on boxes and cylinders against triangles. Coal's default of 1e-6 leaves 4e-6 m at d = 3 m."""

GJK_ITERATIONS = 1000
"""Coal's default of 128 ends before that on long thin cylinders."""

GJK_SLACK = 2e-6
"""Metres. "Free" is only said beyond it: what GJK's distances may be off, at any size a robot cell has, with room."""


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


class Placed:
    """The bodies of a checker at one configuration; one a thread, since threads may not share workspaces."""

    def __init__(self, checker: CollisionChecker) -> None:
        self._arm, self._bodies, self._pairs = checker.arm, checker.bodies, checker.pairs
        self.model, self.geometry_model = checker.arm.model, checker.geometry_model
        self.data = self.model.createData()
        # Made after the last geometry was added: adding one later corrupts memory.
        self.geometry_data = self.geometry_model.createData()
        self._set_requests(checker.margin)
        solid = [body.solid is not None for body in checker.bodies]
        self._inside = [solid[i] or solid[j] for i, j in checker.pairs]

    def move(self, q: Array) -> None:
        """Place every body at q (n,)."""
        arm = self._arm
        pin.updateGeometryPlacements(
            self.model, self.data, self.geometry_model, self.geometry_data, arm.scale @ q + arm.offset
        )

    def any_contact(self) -> bool:
        """Whether the surfaces of any pair come within the margin; stops at the first."""
        return bool(pin.computeCollisions(self.geometry_model, self.geometry_data, True))

    def distance(self, k: int) -> float:
        """Signed distance (m) of pair k; a body inside an exact watertight mesh counts as penetrating it."""
        result = pin.computeDistance(self.geometry_model, self.geometry_data, k)
        distance = float(result.min_distance)
        if distance > 0 and self._inside[k] and self.one_inside_other(k):
            return -distance
        return distance

    def points(self, k: int) -> Array:
        """(2, 3) the nearest points of pair k in the root frame, from the last :meth:`distance` of k."""
        result = self.geometry_data.distanceResults[k]
        return np.array([result.getNearestPoint1(), result.getNearestPoint2()])

    def proven_distance(self, k: int, distance: float) -> float:
        """A lower bound (m) of the distance of pair k, after :meth:`distance` said ``distance``.

        Along any unit direction u the gap between the two supports, min_b u.x - max_a u.x, is a lower bound of the
        distance of two convex bodies, whether or not GJK converged; its witness direction makes it tight. An exact mesh
        has no support function: there GJK's own distance is taken, less :data:`GJK_SLACK`.
        """
        i, j = self._pairs[k]
        a, b = self._bodies[i].support, self._bodies[j].support
        if a is None or b is None:
            return distance - GJK_SLACK
        first, second = self.points(k)
        length = float(np.linalg.norm(second - first))
        if distance <= 0 or length < 1e-12:
            return min(distance, 0.0)
        u = (second - first) / length
        at_a, at_b = self.placement(i), self.placement(j)
        reach_a = a.reach(at_a.rotation.T @ u) + float(u @ at_a.translation)
        reach_b = b.reach(at_b.rotation.T @ -u) - float(u @ at_b.translation)
        return -reach_b - reach_a

    def one_inside_other(self, k: int) -> bool:
        """Whether a part of one body of pair k lies inside the exact watertight mesh of the other."""
        i, j = self._pairs[k]
        return self._inside_of(i, j) or self._inside_of(j, i)

    def placement(self, i: int) -> pin.SE3:
        """root_from_body of body i: a live view, valid until the next :meth:`move`."""
        return self.geometry_data.oMg[i]

    def _inside_of(self, outer: int, inner: int) -> bool:
        solid, body = self._bodies[outer].solid, self._bodies[inner]
        if solid is None or not solid.watertight:
            return False
        outer_from_inner = self.placement(outer).actInv(self.placement(inner))
        return solid.contains(body.witnesses @ outer_from_inner.rotation.T + outer_from_inner.translation)

    def _set_requests(self, margin: float) -> None:
        """Tell coal how to answer: the same whatever was asked before.

        Pinocchio's own requests start GJK where the pair's last query ended, so that answers move in their last digits
        with the order of the questions, and with the number of threads.
        """
        collision, distance = coal.CollisionRequest(), coal.DistanceRequest()
        collision.security_margin = margin + GJK_SLACK
        for request in (collision, distance):
            request.gjk_initial_guess = coal.GJKInitialGuess.DefaultGuess
            request.gjk_tolerance, request.gjk_max_iterations = GJK_TOLERANCE, GJK_ITERATIONS
        for k in range(len(self._pairs)):
            self.geometry_data.collisionRequests[k] = collision
            self.geometry_data.distanceRequests[k] = distance
