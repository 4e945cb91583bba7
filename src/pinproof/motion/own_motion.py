"""Motions of other programs: splines of SciPy, and any function of the time with a bound of its joint speeds.

A spline is a sequence of polynomials, so it becomes a curve by a change of its basis. Of a function f, only samples are
known. If joint j moves at v_j at most, it is at a time t of an interval [a, b] of width h within v_j (t - a) of f_j(a)
and within v_j (b - t) of f_j(b). It therefore differs from the straight line between both by at most

    h (v_j^2 - s_j^2) / (2 v_j) <= h v_j / 2,    s_j = (f_j(b) - f_j(a)) / h,

which is the difference where the bound from one end meets that from the other. What is proven of the polyline of the
samples and of all configurations within that distance of it is proven of f.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.model import JointLimits
from pinproof.motion.curve import MEET_TOLERANCE, CurvePart
from pinproof.motion.limits import LIMIT_TOLERANCE
from pinproof.spatial import Array, finite

Motion: TypeAlias = Callable[[float], npt.ArrayLike]
"""A motion: the configuration (n,) at a time in seconds."""

SpeedBound: TypeAlias = "npt.ArrayLike | Callable[[float, float], npt.ArrayLike]"
"""The largest speed of each joint (n,), or of all, in rad/s or m/s; or a function that returns it for an interval."""

ROUNDING = 1e-12
"""rad or m, for positions of 1: more than the rounding of a sample, and of a point of the polyline."""


class TimedCurvePart(CurvePart):
    """Polynomial pieces over the time in seconds."""

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return float(self.knots[-1] - self.knots[0])

    def velocity(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) velocities in rad/s or m/s."""
        return self.derivative(1).at(t)

    @classmethod
    def of_spline(cls, spline: Any, joint_names: tuple[str, ...]) -> TimedCurvePart | None:
        """The curve of a ``BSpline``, ``PPoly`` (``CubicSpline``, ...) or ``BPoly`` of SciPy, else None.

        InputError if it has another number of joints, is complex or not finite, or jumps at a knot.
        """
        if not hasattr(spline, "c"):  # then SciPy is not imported, which takes longer than most proofs
            return None
        from scipy.interpolate import BPoly, BSpline, PPoly

        what, pieces = f"the {type(spline).__name__}", spline
        if isinstance(pieces, BSpline):  # it is defined between its inner knots only; its derivatives give the pieces
            x, k = np.unique(pieces.t[pieces.k : len(pieces.t) - pieces.k]), pieces.k
            pieces = PPoly([pieces(x[:-1], nu=m) / math.factorial(m) for m in range(k, -1, -1)], x)
        if isinstance(pieces, PPoly):
            pieces = BPoly.from_power_basis(pieces)
        if not isinstance(pieces, BPoly):
            return None
        if spline.axis != 0 or np.iscomplexobj(pieces.c):
            raise InputError(f"{what} must have real values and axis=0, so that it returns (n,) at each time")
        control = finite(f"the coefficients of {what}", pieces.c, (None, None, len(joint_names))).swapaxes(0, 1)
        knots = finite(f"the knots of {what}", pieces.x, (None,))
        if not (np.diff(knots) > 0.0).all():
            raise InputError(f"the breakpoints of {what} must increase")
        # The ends of pieces, computed from each of both, differ by rounding; a larger difference is a jump.
        gap = np.abs(control[1:, 0] - control[:-1, -1])
        if gap.max(initial=0.0) > MEET_TOLERANCE * max(1.0, np.abs(control).max()):
            k, joint = np.unravel_index(int(gap.argmax()), gap.shape)
            raise InputError(f"{what} jumps at {knots[k + 1]:g} s: {joint_names[joint]} by {gap[k, joint]:.4g}")
        control[1:, 0] = control[:-1, -1]
        return cls(knots, control, joint_names)


class SampledMotion:
    """Samples of a function of the time, and how far it can be from the straight lines between them.

    ``times`` (k+1,) and ``q`` (k+1, n) are the samples, ``bounds`` (k, n) the speeds in the intervals between them.
    Numbers that are not finite, of another shape, or a bound that the samples violate raise InputError.
    """

    def __init__(
        self, motion: Motion, joint_names: tuple[str, ...], domain: tuple[float, float], speed_bound: SpeedBound
    ) -> None:
        self._motion, self.joint_names, self._bound = motion, joint_names, speed_bound
        self.times = finite("domain", domain, (2,))
        first, last = self.times.tolist()
        if not first < last:
            raise InputError(f"domain = ({first:g}, {last:g}) must be two times (s), the earlier one first")
        self.q, self.bounds = np.stack([self.at(first), self.at(last)]), self._bound_between(first, last)[None]

    def at(self, time: float) -> Array:
        """The configuration (n,) at a time."""
        return finite(f"the motion at {time:g} s", self._motion(float(time)), (len(self.joint_names),))

    def _bound_between(self, first: float, last: float) -> Array:
        stated = self._bound(float(first), float(last)) if callable(self._bound) else self._bound
        what, full = f"speed_bound from {first:g} s to {last:g} s", np.full(len(self.joint_names), 1.0)
        bound = finite(what, full * stated if np.ndim(stated) == 0 else stated, full.shape)
        if (bound < 0.0).any():
            raise InputError(f"{what} is {bound.tolist()}; it must be 0 or more")
        return bound

    @property
    def _reach(self) -> Array:
        """(k, n) the longest distance (rad or m) in each interval."""
        return np.asarray(self.bounds * np.diff(self.times)[:, None])

    @property
    def deviations(self) -> Array:
        """(k, n) the largest difference (rad or m) from the straight line in each interval."""
        reach, distance = self._reach, np.abs(np.diff(self.q, axis=0))
        share = np.divide(distance, reach, out=np.zeros_like(reach), where=reach > 0.0).clip(0.0, 1.0)
        return np.asarray(0.5 * reach * (1.0 - share**2) + ROUNDING * (1.0 + np.abs(self.q).max()))

    def refine(self, deviation: float, most: int) -> bool:
        """Halve intervals until none deviates by more than this (rad or m); False if more than ``most`` are needed."""
        while True:
            # two neighbouring samples must not violate the bound
            distance, reach = np.abs(np.diff(self.q, axis=0)), self._reach
            excess = distance - reach - ROUNDING * (1.0 + np.abs(self.q).max())
            i, j = np.unravel_index(int(excess.argmax()), excess.shape)
            if excess[i, j] > 0.0:
                raise InputError(
                    f"speed_bound of {self.joint_names[j]}, {self.bounds[i, j]:.6g} rad/s or m/s, is violated between "
                    f"{self.times[i]:.6g} s and {self.times[i + 1]:.6g} s, where it moves by {distance[i, j]:.6g}; "
                    "give a bound that the motion keeps"
                )
            wide = np.asarray((self.deviations > deviation).any(axis=1))
            if not wide.any() or len(wide) + wide.sum() > most:
                return not wide.any()
            middles, after = (self.times[:-1] + self.times[1:])[wide] / 2, np.flatnonzero(wide) + 1
            self.times = np.insert(self.times, after, middles)
            self.q = np.insert(self.q, after, [self.at(time) for time in middles], axis=0)
            self.bounds = np.repeat(self.bounds, 1 + wide, axis=0)
            if callable(self._bound):
                for k in np.flatnonzero(np.repeat(wide, 1 + wide)):
                    self.bounds[k] = self._bound_between(*self.times[k : k + 2])

    def polyline(self) -> TimedCurvePart:
        """The straight lines between the samples."""
        return TimedCurvePart(self.times, np.stack([self.q[:-1], self.q[1:]], axis=1), self.joint_names)

    def beyond(self, limits: JointLimits) -> tuple[str, bool]:
        """The first reason why the bound does not prove limits of position and velocity, else an empty text.

        The second value states whether the reason remains with more samples.
        """
        low, high = (self.q[:-1] + self.q[1:] + sign * self._reach for sign in (-1.0, 1.0))  # twice the positions
        fast = self.bounds > limits.velocity * (1.0 + LIMIT_TOLERANCE)
        outside = (low / 2 < limits.lower - LIMIT_TOLERANCE) | (high / 2 > limits.upper + LIMIT_TOLERANCE)
        for rows, how in ((fast, "exceeds its velocity limit"), (outside, "allows it to leave its position limits")):
            for i, j in np.argwhere(rows)[:1].tolist():
                span = f"from {self.times[i]:.6g} s to {self.times[i + 1]:.6g} s"
                text = f"the speed_bound of {self.joint_names[j]}, {self.bounds[i, j]:.6g} rad/s or m/s, {how} {span}"
                return text, rows is fast and not callable(self._bound)
        return "", False
