r"""A body that leaves an obstacle it may touch: proof that along one direction it never comes nearer.

Let n be a unit vector, fixed as the obstacle is, and

.. math:: g(t) = \min_{y \in \text{body}} n \cdot y(t) - \max_{x \in \text{obstacle}} n \cdot x .

Wherever g is above 0 the two are g apart or more; below 0 it is how deep they overlap along n. If no point of the body
moves against n, g never falls. The speed of a point y along n is :math:`\sum_i s_i f_i`, with the rates s_i of the
joints that carry it and :math:`f_i = n \cdot (w_i \times (y - p_i))`, or :math:`n \cdot w_i` for a joint that slides.

On an interval every joint j stays within delta_j of its value in the middle. Go there joint by joint, the one nearest
to the root first. Joints up to i turn :math:`w_i \times (y - p_i)` as a whole, and joints beyond i move y by their
chords, at radii that are those of the middle (:mod:`pinproof.kernels.approach`). So f_i stays within

.. math:: \varepsilon_i = \rho_i \sum_{j \le i} 2 \sin(\delta_j / 2) + \sum_{j > i} 2 \rho_j \sin(\delta_j / 2)

of what it is in the middle (joints that slide turn nothing and shift by delta_j). On a polynomial piece the rates are
:math:`s_i(u) = \sum_r B_r(u) s_{ri}`, with coefficients that are differences of control points, and the B_r are not
negative. So g does not fall if for every r

.. math:: L_r = \min_y \sum_i s_{ri} f_i(y) - \sum_i |s_{ri}| \varepsilon_i \ge 0 ,

the f_i taken in the middle, where the sum is linear in y and its least value that of a support function. Where an L_r
is below 0, g falls by at most the sum of them. Coefficients, not values, are compared: at rest both sides are 0.

Source: R. T. Farouki (2012), "The Bernstein polynomial basis: a centennial retrospective", Computer Aided Geometric
Design 29, section 3 (differences, hull); the rest is derived here.
"""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np
import numpy.typing as npt

from pinproof.collision.bodies import Body
from pinproof.collision.checker import CollisionChecker
from pinproof.motion import bezier

__all__ = ["Hull", "Mover", "Rise", "Rising"]

Array = npt.NDArray[np.float64]


HALVINGS = 12
"""Of the interval in which a body leaves, to tell when it has: to the 4000th part of it."""


class Rise(NamedTuple):
    """How far along a curve a body is proven not to approach."""

    end: float
    """The parameter up to which it is."""
    until: float
    """The one from which on it is also farther away than it must be; infinity if that is not reached."""
    stopped: float
    """The end of the first interval in which it could not be proven; ``end`` if there is none."""
    intervals: int
    """How many were looked at."""


class Mover:
    """A body of the robot on its way: where it is at a configuration, and how far it reaches in a direction.

    Parameters
    ----------
    checker
        The checker.
    body
        The index of a body that moves with a link.
    """

    def __init__(self, checker: CollisionChecker, body: int) -> None:
        from pinproof.kernels.approach import way
        from pinproof.kernels.placing import place
        from pinproof.kernels.world import BALL, JOINT, world_of

        self._place = place
        self.world = world_of(checker.numbers, checker.indices)
        self.rounding = checker.rounding
        self._every, self.axes = checker.at.copy(), np.empty((len(self.world.joints), 12))
        self.at = self._every[body]
        self.shape = Hull.of(checker.bodies[body])
        path = np.empty(len(self.world.joints), dtype=np.int64)
        joint = int(self.world.bodies[body, JOINT])
        self.chain = path[: way(self.world.joints, joint, -1, path)[0]][::-1]  # from the root outwards
        self.ball = float(self.world.bodies[body, BALL])

    def move(self, q: Array) -> None:
        """Place it at q (n,)."""
        self._place(self.world, np.ascontiguousarray(q), self.axes, self._every)

    def reach(self, directions: Array) -> Array:
        """(d,) the largest ``direction . y`` over its points y, for any directions (d, 3) in the root frame."""
        return self.shape.reach(self.at, directions)


class Rising:
    """The motion of a body of the robot along one direction, away from something that does not move.

    Parameters
    ----------
    mover
        The body.
    normal
        (3,) the direction, of length 1, in the root frame.
    level
        How far (m) what it leaves reaches along the direction.
    """

    def __init__(self, mover: Mover, normal: Array, level: float) -> None:
        self._mover, self.normal, self.level = mover, normal, level

    def gap(self, q: Array) -> float:
        """The gap (m) along :attr:`normal` at q (n,): a lower bound of the distance, below 0 where they overlap."""
        self._mover.move(q)
        return -float(self._mover.reach(-self.normal[None])[0]) - self.level

    def follow(self, knots: Array, control: Array, enough: float, tolerance: float, most: int) -> Rise:
        """Go along a curve for as long as the body is proven not to approach.

        Parameters
        ----------
        knots, control
            The curve, see :mod:`pinproof.motion.bezier`.
        enough
            The gap (m) beyond which the body has left.
        tolerance
            Metres: an interval in which it moves by less is not cut any further.
        most
            The number of intervals after which the proof stops.
        """
        end, until, lost, count = float(knots[0]), np.inf, 0.0, 0
        if self.gap(control[0, 0]) > enough:
            until = end
        for i, piece in enumerate(control):
            stack = [(float(knots[i]), float(knots[i + 1]), piece)]
            while stack:
                start, stop, part = stack.pop()
                count += 1
                falls, motion = self._falls(part)
                if lost + falls <= self._mover.rounding:
                    lost, end = lost + falls, stop
                    if until == np.inf and self.gap(part[-1]) > enough:
                        until = self._crossing(start, stop, part, enough)
                    continue
                if motion < tolerance or count >= most:
                    return Rise(end, until, stop, count)
                middle, (left, right) = 0.5 * (start + stop), bezier.split(part)
                stack += [(middle, stop, right), (start, middle, left)]
        return Rise(end, until, end, count)

    def _crossing(self, start: float, stop: float, part: Array, enough: float) -> float:
        """Where in a piece, at the latest, a gap that does not fall passes ``enough``."""
        for _ in range(HALVINGS):
            middle, (left, right) = 0.5 * (start + stop), bezier.split(part)
            if self.gap(left[-1]) > enough:
                stop, part = middle, left
            else:
                start, part = middle, right
        return stop

    def _falls(self, part: Array) -> tuple[float, float]:
        """By how much (m) the gap may fall over a piece (degree + 1, n), at most; and how far the body may move."""
        from pinproof.kernels.world import LEADER, MIDDLE, MULTIPLIER, SLIDES

        mover, middle = self._mover, bezier.split(part)[0][-1]
        mover.move(middle)
        joints, axes = mover.world.joints[mover.chain], mover.axes[mover.chain]
        leader, share, slides = joints[:, LEADER].astype(int), joints[:, MULTIPLIER], joints[:, SLIDES] != 0.0
        rates = share * np.diff(part, axis=0)[:, leader]  # (degree, k)
        delta = np.abs(share * np.abs(part - middle).max(axis=0)[leader])
        directions, points = axes[:, [2, 5, 8]], axes[:, 9:12]
        arms = _cross(directions, mover.at[MIDDLE : MIDDLE + 3] - points)
        rho = np.where(slides, 1.0, np.sqrt((arms * arms).sum(axis=1)) + mover.ball)
        turns = np.where(slides, 0.0, 2.0 * np.sin(0.5 * np.minimum(delta, np.pi)))
        shifts = np.where(slides, delta, rho * turns)
        inner, outer = np.cumsum(turns), shifts.sum() - np.cumsum(shifts)
        spread = rho * inner + np.where(slides, 0.0, outer)
        turned = np.where(slides[:, None], 0.0, _cross(self.normal[None], directions))  # f_i = turned_i . (y - p_i)
        along = np.where(slides, directions @ self.normal, -(turned * points).sum(axis=1))
        slowest = rates @ along - mover.reach(-(rates @ turned))
        falls = np.maximum(np.abs(rates) @ spread - slowest, 0.0).sum()
        return float(falls), float(shifts.sum())


class Hull(NamedTuple):
    """The convex hull of a body, by how far it reaches; a half-space only along its own normal."""

    points: Array | None
    """(V, 3) the corners of an exact mesh; None for a body with a support function."""
    body: Body

    @classmethod
    def of(cls, body: Body) -> Hull:
        """That of a body of any kind."""
        exact = body.support is None and not isinstance(body.geometry, coal.Halfspace)
        return cls(np.array(body.geometry.vertices()) if exact else None, body)

    def reach(self, at: Array, directions: Array) -> Array:
        """(d,) the largest ``direction . x`` over the body placed at ``at`` (12 or more), for directions (d, 3)."""
        origin = directions @ at[9:12]
        if isinstance(self.body.geometry, coal.Halfspace):
            return np.asarray(origin)
        local = directions @ at[:9].reshape(3, 3)
        if self.points is None and self.body.support is not None:
            return np.asarray(origin + self.body.support.reach(local))
        return np.asarray(origin + (local @ np.asarray(self.points).T).max(axis=1))


def _cross(a: Array, b: Array) -> Array:
    """(k, 3) the products of rows, for few rows: numpy's own takes ten times as long over them."""
    x, y, z = b.T
    return np.stack([a[:, 1] * z - a[:, 2] * y, a[:, 2] * x - a[:, 0] * z, a[:, 0] * y - a[:, 1] * x], axis=1)
