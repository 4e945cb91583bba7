"""The bodies of a checker placed at a configuration, and the distances between them.

Convex bodies are judged by compiled loops, whose bounds are true whatever the iteration did. Coal judges what has no
support function, and says how deep bodies penetrate each other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

if TYPE_CHECKING:
    from pinproof.collision.checker import CollisionChecker

__all__ = ["EVERY", "FIRST_ONLY", "GJK_SLACK", "NEAREST", "Distance", "Near", "Placed"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

FIRST_ONLY, EVERY, NEAREST = 0, 1, 2
"""What :mod:`pinproof.kernels.near` can be asked, which is only imported where it is called."""

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


class Near(NamedTuple):
    """What the compiled loop says about a configuration, see :func:`pinproof.kernels.near.near`."""

    contacts: list[int]
    left_to_coal: list[int]
    lower: float
    upper: float
    nearest: int


class Placed:
    """The bodies of a checker at one configuration; one a thread, since threads may not share workspaces.

    Parameters
    ----------
    checker
        The checker.
    numbers, indices
        Its flattened world, or a part of it.
    """

    def __init__(self, checker: CollisionChecker, numbers: Array, indices: Indices) -> None:
        from pinproof.kernels import near

        self._kernels = near
        self._checker, self._numbers, self._indices = checker, numbers, indices
        self.at = checker.at.copy()
        self._q = np.zeros(checker.arm.dof)
        self._pairs = np.empty((2, max(len(checker.pairs), 1)), dtype=np.int64)
        self._moves = 0
        self._coal: _Coal | None = None

    def judge(self, q: Array) -> tuple[int, int]:
        """Place every body at q (n,): is there a contact (1, 0, or -1 if q is not finite), and what is left to coal."""
        self._q[:] = q
        self._moves += 1
        answer = self._kernels.near(self._numbers, self._indices, self.at, self._q, FIRST_ONLY, self._pairs)
        return answer[0], answer[1]

    def left_to_coal(self, count: int) -> list[int]:
        """The pairs that the last question left to coal."""
        return self._pairs[1, :count].tolist()

    def judge_many(self, Q: Array, question: int, out: Array) -> None:
        """What :func:`pinproof.kernels.near.near` says at each row of Q (N, n), into ``out`` (N, 5)."""
        self._kernels.near_many(self._numbers, self._indices, self.at, Q, question, self._pairs, out)

    def near(self, q: Array, question: int) -> Near:
        """Place every body at q (n,), finite, and judge the pairs between which a joint moves."""
        self._q[:] = q
        self._moves += 1
        contacts, left, lower, upper, nearest = self._kernels.near(
            self._numbers, self._indices, self.at, self._q, question, self._pairs
        )
        return Near(self._pairs[0, :contacts].tolist(), self.left_to_coal(left), lower, upper, nearest)

    def touching(self, q: Array) -> list[tuple[int, Distance]]:
        """The pairs in contact at q (n,), finite, between which a joint moves."""
        near = self.near(q, EVERY)
        pairs = [*near.contacts, *(k for k in near.left_to_coal if self.touches(k))]
        return [(k, self.measure(k)) for k in pairs]

    def move(self, q: Array) -> None:
        """Place every body at q (n,), finite."""
        self._q[:] = q
        self._moves += 1
        self._kernels.place_bodies(self._numbers, self._indices, self._q, self.at)

    def measure(self, k: int) -> Distance:
        """The distance of pair k; a body inside an exact watertight mesh counts as penetrating it."""
        if not self._checker.convex[k]:
            return self._by_coal().measure(k)
        points, normal = np.empty((2, 3)), np.empty(3)
        lower, upper = self._kernels.measure(self._numbers, self._indices, self.at, k, points, normal)
        if lower > 0:
            return Distance(lower, lower, upper, points, normal)
        deep = self._by_coal().measure(k)
        return deep._replace(distance=min(deep.distance, upper), proven=lower, attained=upper)

    def touches(self, k: int) -> bool:
        """Whether pair k, left to coal, comes within its margin."""
        return self._by_coal().touches(k)

    def one_inside_other(self, k: int) -> bool:
        """Whether a part of one body of pair k lies inside the exact watertight mesh of the other."""
        return self._by_coal().one_inside_other(k)

    def _by_coal(self) -> _Coal:
        if self._coal is None:
            self._coal = _Coal(self._checker)
        self._coal.move(self._q, self._moves)
        return self._coal


class _Coal:
    """Coal's view of the same bodies."""

    def __init__(self, checker: CollisionChecker) -> None:
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
        result = pin.computeDistance(self._geometry_model, self._geometry_data, k)
        distance = float(result.min_distance)
        points = np.array([result.getNearestPoint1(), result.getNearestPoint2()])
        if distance > 0 and self.one_inside_other(k):
            distance = -distance
        return Distance(distance, distance - GJK_SLACK, distance, points, np.array(result.normal))

    def touches(self, k: int) -> bool:
        return bool(pin.computeCollision(self._geometry_model, self._geometry_data, k)) or self.one_inside_other(k)

    def one_inside_other(self, k: int) -> bool:
        """Whether a part of one body of pair k lies inside the exact watertight mesh of the other."""
        i, j = self._pairs[k]
        return self._inside_of(i, j) or self._inside_of(j, i)

    def _inside_of(self, outer: int, inner: int) -> bool:
        solid, body = self._bodies[outer].solid, self._bodies[inner]
        if solid is None or not solid.watertight:
            return False
        witnesses = body.witnesses
        outer_from_inner = self._geometry_data.oMg[outer].actInv(self._geometry_data.oMg[inner])
        return solid.contains(witnesses @ outer_from_inner.rotation.T + outer_from_inner.translation)

    def _set_requests(self) -> None:
        """Tell coal how to answer: the same whatever was asked before.

        Pinocchio's own requests start GJK where the pair's last query ended, so that answers move in their last digits
        with the order of the questions, and with the number of threads.
        """
        for k, margin in enumerate(self._margins.tolist()):
            collision, distance = coal.CollisionRequest(), coal.DistanceRequest()
            collision.security_margin = margin + GJK_SLACK
            for request in (collision, distance):
                request.gjk_initial_guess = coal.GJKInitialGuess.DefaultGuess
                request.gjk_tolerance, request.gjk_max_iterations = GJK_TOLERANCE, GJK_ITERATIONS
            self._geometry_data.collisionRequests[k] = collision
            self._geometry_data.distanceRequests[k] = distance
