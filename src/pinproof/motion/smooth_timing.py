"""Rest-to-rest motion along a smooth path, timed by toppra.

toppra (H. Pham, Q.-C. Pham, "A new approach to time-optimal path parameterization based on reachability analysis",
IEEE T-RO 34(3), 2018) finds speeds s'(s) on a grid, with constant s'' in between. Its own trajectories are not used:
they may break limits or leave the path. Points of the path at the grid's times, with their velocities, are written as
cubic Hermite pieces; the grid is refined where a piece leaves the path, and the whole is slowed down where a limit is
exceeded.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.errors import TimingError
from pinproof.motion import bezier
from pinproof.motion.clock import NANO, seconds
from pinproof.motion.cubic_path import CubicPath
from pinproof.motion.curve import Array
from pinproof.motion.limits import RATE_TOLERANCE, Bounds
from pinproof.motion.trajectory import Trajectory

__all__ = ["IMAGE_TOLERANCE", "time_smooth"]

IMAGE_TOLERANCE = 1e-6
"""How far (rad or m, in any joint) the timed curve may be from the path: a micrometre at a reach of a metre, a
thousandth of the millimetres that clearances are kept in."""

_LARGEST_GRID = 4000
"""Grid points at which refining ends: far more than a pick's approach needs (tens)."""

_FEWEST_STEPS = 8
"""Grid steps at least, on paths of few pieces: on a single step, at rest at both ends, nothing would move."""

_ROUGH = 1.01
"""Factor over a limit from which on the grid is halved there, rather than the whole motion slowed down."""

_ROUGH_ROUNDS = 4
_MOST_PARTS = 4
_SLOW_DOWNS = 32


def time_smooth(path: CubicPath, bounds: Bounds, grid: int) -> Trajectory:
    """Time ``path`` (which moves) from rest to rest with ``grid`` steps a piece at first."""
    scaled = _ScaledPath(path, bounds)
    steps = max(grid, math.ceil(_FEWEST_STEPS / (len(scaled.knots) - 1)))
    s = np.unique(np.linspace(scaled.knots[:-1], scaled.knots[1:], steps + 1))
    for attempt in itertools.count():
        timed = _within_limits(scaled, _Clock(s, _toppra_speeds(scaled, s, bounds)), bounds)
        off = _deviation(scaled, timed)
        # the Hermite error falls with the fourth power of the step (a little more than needed is cheaper than a round)
        parts = np.where(off > IMAGE_TOLERANCE, np.ceil(1.2 * (off / IMAGE_TOLERANCE) ** 0.25), 1.0).clip(
            1, _MOST_PARTS
        )
        if attempt < _ROUGH_ROUNDS:
            parts = np.maximum(parts, np.where(timed.rough > _ROUGH, 2.0, 1.0))
        if parts.max() == 1.0:
            break
        if parts.sum() > _LARGEST_GRID:
            if off.max() <= IMAGE_TOLERANCE:  # not as fast as might be, but on the path and within the limits
                break
            raise TimingError(f"the timed curve is {off.max():.3g} off the path on {len(s)} grid points; resample it")
        s = _refined(s, parts.astype(int))
    return timed.trajectory


def _refined(s: Array, parts: npt.NDArray[np.int_]) -> Array:
    """The grid with each step cut into equal parts."""
    inner = [np.linspace(a, b, count, endpoint=False) for a, b, count in zip(s[:-1], s[1:], parts, strict=True)]
    return np.concatenate([*inner, s[-1:]])


class _ScaledPath:
    """A CubicPath whose parameter is about the seconds it will take, so that toppra's absolute tolerances fit.

    It is what toppra calls a geometric path (``path(s, order)``, ``dof``, ``path_interval``), without its base class,
    which would load toppra with this module.
    """

    def __init__(self, path: CubicPath, bounds: Bounds) -> None:
        knots, control = path.bezier()
        width, slope = np.diff(knots), np.abs(bezier.derivative(knots, control))
        at_full_speed = float(width @ (slope / bounds.velocity).max(axis=(1, 2)))
        at_full_acceleration = float(width @ (slope / bounds.acceleration).max(axis=(1, 2)))
        scale = (at_full_speed + 2.0 * math.sqrt(at_full_acceleration)) / (knots[-1] - knots[0])
        self.joint_names = path.joint_names
        self.knots = (knots - knots[0]) * scale
        first = bezier.derivative(self.knots, control)
        self._derivatives = control, first, bezier.derivative(self.knots, first)
        self.dof = len(path.joint_names)
        self.path_interval = np.array([self.knots[0], self.knots[-1]])

    def __call__(self, s: npt.ArrayLike, order: int = 0) -> Array:
        return bezier.evaluate(self.knots, self._derivatives[order], s)


class _Clock:
    """s over time where s'' is constant between the grid points ``s`` (N+1,), with s' there ``speed``."""

    def __init__(self, s: Array, speed: Array) -> None:
        self.s, self.speed = s, speed
        self.times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(s) / (speed[:-1] + speed[1:]))])

    def at(self, time: Array) -> tuple[Array, Array]:
        """Find s and s' at times (N,) within the motion."""
        i = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.s) - 2)
        acceleration = (self.speed[i + 1] - self.speed[i]) / (self.times[i + 1] - self.times[i])
        since = time - self.times[i]
        s = self.s[i] + (self.speed[i] + 0.5 * acceleration * since) * since
        return np.clip(s, self.s[0], self.s[-1]), np.maximum(self.speed[i] + acceleration * since, 0.0)


def _slowed(clock: _Clock, slower: float) -> tuple[Array, Array, Array]:
    """Times of the grid in whole nanoseconds, ``slower`` times as long, and s and s' there.

    s is read off at the rounded times, so times, positions and velocities agree: rounding the times alone would shake
    the accelerations of millisecond pieces by thousandths.
    """
    total = math.ceil(slower * clock.times[-1] * NANO)
    slower = total / NANO / clock.times[-1]
    index = np.arange(len(clock.s))
    ticks = np.rint(clock.times * (slower * NANO)).astype(np.int64)
    ticks = np.maximum.accumulate(ticks - index) + index  # at least a nanosecond apart
    times = seconds(ticks)
    s, speed = clock.at(times / slower)
    s[0], s[-1], speed[0], speed[-1] = clock.s[0], clock.s[-1], 0.0, 0.0
    return times, s, speed / slower


@dataclass(frozen=True, eq=False)
class _Timed:
    """A motion within the limits, s and s' (N+1,) at its points, and by how much each piece (N,) was too fast."""

    trajectory: Trajectory
    s: Array
    speed: Array
    rough: Array


def _within_limits(path: _ScaledPath, clock: _Clock, bounds: Bounds) -> _Timed:
    """Slow the whole motion down until its limits hold (the caller checks that they do)."""
    slower, rough = 1.0, np.empty(0)
    for attempt in range(_SLOW_DOWNS):
        times, s, speed = _slowed(clock, slower)
        trajectory = Trajectory(times, path(s), path(s, 1) * speed[:, None], path.joint_names, bounds.note)
        excess = bounds.excess(trajectory)
        rough = excess if attempt == 0 else rough
        if not bounds.too_fast(excess).any():
            break
        slower *= float(excess.max()) * (1.0 + RATE_TOLERANCE)
    return _Timed(trajectory, s, speed, rough)


def _deviation(path: _ScaledPath, timed: _Timed) -> Array:
    """(N,) how far each piece may be from the path, in any joint: a bound, not a sample.

    On a piece the motion q(u) is compared with path(s(u)), where s(u) is the cubic with the piece's own s and s' at
    both ends. Their difference is a polynomial of degree 9 in u and stays below its largest Bernstein coefficient.
    """
    trajectory = timed.trajectory
    width = np.diff(trajectory.times)[:, None]
    u, coefficients_from_values = _degree_nine()
    s_control = bezier.hermite(trajectory.times, timed.s[:, None], timed.speed[:, None])
    s = np.clip(_values(s_control, u)[..., 0], path.knots[0], path.knots[-1])
    at = trajectory(np.minimum(trajectory.times[:-1, None] + width * u, trajectory.times[1:, None]).ravel())
    gap = (at - path(s.ravel())).reshape(len(width), len(u), -1)
    result: Array = np.abs(np.einsum("cu,kun->kcn", coefficients_from_values, gap)).max(axis=(1, 2))
    return result


def _values(control: Array, u: Array) -> Array:
    """Every piece (k, 4, n) at every local parameter (U,): (k, U, n)."""
    basis = _bernstein(u, 3)
    return np.asarray(np.einsum("ur,krn->kun", basis, control))


def _bernstein(u: Array, degree: int) -> Array:
    r = np.arange(degree + 1)
    binomial = np.array([math.comb(degree, int(k)) for k in r], dtype=float)
    return binomial * u[:, None] ** r * (1.0 - u[:, None]) ** (degree - r)


@cache
def _degree_nine() -> tuple[Array, Array]:
    """Ten local parameters, and the matrix from a polynomial's values there to its Bernstein coefficients."""
    u = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 10))  # Chebyshev-Lobatto: well conditioned
    return u, np.asarray(np.linalg.inv(_bernstein(u, 9)), dtype=float)


def _toppra_speeds(path: _ScaledPath, s: Array, bounds: Bounds) -> Array:
    """(N+1,) speeds s' at the grid points, 0 at both ends."""
    with _quiet_toppra():
        from toppra.algorithm import TOPPRA
        from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

        constraints = [
            JointVelocityConstraint(np.stack([-bounds.velocity, bounds.velocity], axis=1)),
            JointAccelerationConstraint(np.stack([-bounds.acceleration, bounds.acceleration], axis=1)),
        ]
        problem: Any = TOPPRA(constraints, path, gridpoints=s, solver_wrapper="seidel")
        speeds = problem.compute_parameterization(0.0, 0.0)[1]
    if speeds is None or not np.isfinite(speeds).all():
        raise TimingError("toppra found no timing for the path: it is not smooth enough; resample it more evenly")
    speeds = np.array(speeds, dtype=float)
    speeds[0] = speeds[-1] = 0.0
    if not (speeds[:-1] + speeds[1:] > 0.0).all():
        raise TimingError("toppra's timing stands still on the path; resample the path more evenly")
    return speeds


@contextmanager
def _quiet_toppra() -> Iterator[None]:
    """Silence what toppra logs about its retries; what matters of it is verified on the result."""
    logger = logging.getLogger("toppra")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)
