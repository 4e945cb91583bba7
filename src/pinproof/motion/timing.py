"""Time parametrisation: convert a path to a trajectory, with the limits verified on the result.

The fastest profile of :mod:`pinproof.motion.speeds` satisfies the limits at the nodes of a grid only, and a Hermite
curve through points of the path deviates from the path. Therefore every result is verified between its points too.
Steps that exceed a limit are slowed down, and steps that deviate from the path are subdivided, until both conditions
hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Literal

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError, TimingError
from pinproof.motion import bezier
from pinproof.motion.curve import Array, Curve
from pinproof.motion.limits import POSITION_TOLERANCE, RATE_TOLERANCE, Bounds, MotionLimits
from pinproof.motion.profile import SHORTEST_EDGE, SHORTEST_PHASE
from pinproof.motion.rate_constraints import RateConstraint, checked_constraints, constraint_rows
from pinproof.motion.speeds import Grid, PreparedPath, TimedProfile, fastest_profile
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import LONGEST, NANO, seconds
from pinproof.spatial import finite

__all__ = ["IMAGE_TOLERANCE", "MotionLimits", "time_parametrise"]

IMAGE_TOLERANCE = 1e-5
"""Maximum deviation (rad or m, in any joint) of the timed curve from the path: 0.01 mm at a reach of 1 m, which is less
than the repeatability of arms and 1 % of usual clearances. The certificate is for the timed curve."""

_MAX_GRID = 4000
"""Number of steps at which the subdivision ends. A motion usually has some tens of steps."""

_MIN_STEP = 1e-7
"""Step, as a fraction of the path, below which a step is not subdivided."""

_SUBDIVIDE_ABOVE = 1.01
"""Factor over a limit above which a step is subdivided in the first rounds, rather than only slowed down."""

_COARSE_ROUNDS = 3
"""Number of rounds in which steps are subdivided where the acceleration changes."""

_LOCAL_ROUNDS = 8
"""Number of rounds in which single steps are slowed down. Later, the whole run is slowed down, which converges."""

_SLIGHT_EXCESS = (1.0, 1.005, 1.01)
"""Factor over the limits, in the first, the second and the later rounds, up to which the whole run is slowed down
instead of single steps. This always succeeds."""

_MAX_ROUNDS = 40
_MAX_PARTS = 4

_WINDOWS = 6
"""Number of averaging windows that are tried with a jerk limit: from a quarter of the shortest to twice the longest
time in which a joint can reach its acceleration limit."""

_SHARES = (1.0, 0.5)
"""Fractions of the change of acceleration that a window permits: 1 if the acceleration increases from 0, one half if it
changes from one limit to the opposite one."""

_WINDOW_ROUNDS = 2
"""Number of rounds for each window and share, in addition to the first one."""

_SHORTEST_WINDOW = 8e-3
"""Shortest window (s); a shorter one would save less than its own duration."""

_SHORTEST_SMOOTH = 2e-3
"""Shortest time (s) between two points with a jerk limit, or 1 % of a short motion, because rounding is amplified by
60 / h^3."""

TANGENT_TOLERANCE = 1e-9
"""Maximum deviation of an end velocity from the tangent of the path, relative to its size: rounding errors."""


def time_parametrise(
    curve: Curve,
    limits: MotionLimits,
    *,
    jerk: npt.ArrayLike | Literal["limits"] | None = None,
    start_velocity: npt.ArrayLike | None = None,
    end_velocity: npt.ArrayLike | None = None,
    constraints: Sequence[RateConstraint] = (),
) -> Trajectory:
    """Time a path as fast as the limits permit, without changing its geometry.

    The motion stops at the corners of a :class:`~pinproof.JointPath`; each straight segment gets the time-optimal
    profile in closed form. It passes a :class:`~pinproof.motion.CubicPath` without stopping, and a
    :class:`~pinproof.motion.BlendedPath` except for its remaining corners. Straight lines are followed to rounding,
    bends to :data:`~pinproof.motion.timing.IMAGE_TOLERANCE`. All limits are verified on the exact extremes of the
    result (to a relative :data:`~pinproof.motion.limits.RATE_TOLERANCE`), not on samples.

    Parameters
    ----------
    curve
        The path. If its start equals its end, the result is a single point of duration 0.
    limits
        ``velocity`` (n,) in rad/s or m/s and ``acceleration`` (n,) in rad/s^2 or m/s^2, such as ``arm.limits``. If
        there are ``lower`` and ``upper`` (n,), the result is checked against them. The text ``acceleration_source`` is
        included in the ``limits_note`` of the result.
    jerk
        Jerk limits, (n,) in rad/s^3 or m/s^3 or one number for all joints; ``"limits"`` uses ``limits.jerk``. The
        result is then a quintic with continuous acceleration, which is zero at rest. By default, there is no jerk limit
        and the result is a cubic.
    start_velocity, end_velocity
        (n,) in rad/s or m/s, along the tangent of the path and forward; zero by default. By default, the
        joint_trajectory_controller of ros2_control refuses motions that do not end at rest.
    constraints
        Further limits, such as torques or tool speeds, see :class:`~pinproof.motion.RateConstraint`.

    Raises
    ------
    InputError
        If the limits have a wrong shape, are unknown (NaN) or are not positive and finite (the message names the
        joint), or if a velocity is not along the path.
    TimingError
        If the path leaves the joint limits, a constraint is violated at standstill (the message names it and the
        configuration), or no timing within the limits was found.

    Notes
    -----
    With a jerk limit, straight segments between two stops are time-optimal. Motions through bends are the fastest
    motions with reduced accelerations, averaged over a time window; they are not proven to be optimal.
    """
    if not callable(getattr(curve, "bezier", None)) or isinstance(curve, Trajectory):
        raise InputError(f"time_parametrise requires a path, such as a JointPath, not a {type(curve).__name__}")
    bounds = replace(Bounds.of(limits, curve.joint_names, jerk), constraints=checked_constraints(constraints))
    ends = [
        np.zeros(len(curve.joint_names)) if velocity is None else finite(name, velocity, (len(curve.joint_names),))
        for name, velocity in (("start_velocity", start_velocity), ("end_velocity", end_velocity))
    ]
    if not np.ptp(curve.bezier()[1], axis=(0, 1)).any():
        still = np.zeros((1, len(curve.start)))
        constraint_rows(bounds.constraints, curve.start[None], still, still)
        if ends[0].any() or ends[1].any():
            raise InputError("the path has length 0; start_velocity and end_velocity must be zero")
        rest = np.zeros((1, len(curve.start)))
        point = Trajectory(
            [0.0], [curve.start], rest, curve.joint_names, bounds.note, accelerations=None if jerk is None else rest
        )
        return _verified(point, bounds)
    path = PreparedPath(curve, bounds)
    for end, place, velocity in ((0, "start", ends[0]), (-1, "end", ends[1])):
        _check_velocity(place, velocity, path.control[1][end, end], bounds, curve.joint_names)
    return _verified(_time_path(path, bounds, (ends[0], ends[1])), bounds)


def _check_velocity(place: str, velocity: Array, tangent: Array, bounds: Bounds, names: tuple[str, ...]) -> None:
    if not velocity.any():
        return
    along = float(velocity @ tangent) * tangent / max(float(tangent @ tangent), np.finfo(float).tiny)
    # A velocity below the smallest normal number has no accurate direction.
    if np.abs(velocity - along).max() > TANGENT_TOLERANCE * np.abs(velocity).max() + np.finfo(float).tiny:
        raise InputError(
            f"{place}_velocity {velocity} is not parallel to the path, whose tangent there is {tangent}; a motion with "
            "this velocity leaves the path"
        )
    if velocity @ tangent < 0.0:
        raise InputError(f"{place}_velocity {velocity} is directed backward; the tangent of the path is {tangent}")
    over = np.abs(velocity) / bounds.velocity
    if over.max() > 1.0 + RATE_TOLERANCE:
        name, limit = names[int(over.argmax())], bounds.velocity[int(over.argmax())]
        raise InputError(f"{place}_velocity exceeds the velocity limit {limit:g} of joint {name!r}")


def _verified(trajectory: Trajectory, bounds: Bounds) -> Trajectory:
    """Check every limit on the trajectory, and return it."""
    control = trajectory.bezier()[1]
    outside = (control.min(axis=(0, 1)) < bounds.lower) | (control.max(axis=(0, 1)) > bounds.upper)
    low, high = trajectory.range() if outside.any() else (bounds.lower, bounds.upper)  # inside if the hull is inside
    for name, a, b, lower, upper in zip(trajectory.joint_names, low, high, bounds.lower, bounds.upper, strict=True):
        if a < lower - POSITION_TOLERANCE or b > upper + POSITION_TOLERANCE:
            raise TimingError(
                f"the path exceeds the limits of joint {name!r}: its range is [{a:.9g}, {b:.9g}], the limits are "
                f"[{lower:.9g}, {upper:.9g}]; plan it inside the limits"
            )
    excess = bounds.excess(trajectory)
    if bounds.too_fast(excess).any():
        raise TimingError(
            "no timing within the limits was found: after slowing down, they are exceeded by a factor of "
            f"{excess.max():.6g}. Check whether waypoints are almost equal or velocities at the ends are too high"
        )
    return trajectory


def _time_path(path: PreparedPath, bounds: Bounds, ends: tuple[Array, Array]) -> Trajectory:
    """Time a path of positive length with the velocities ``ends`` (n,); the caller verifies the limits."""
    timing = _Timing(path, bounds, ends)
    steps, piece = path.initial_steps(IMAGE_TOLERANCE)
    grid = Grid.of(path, steps, piece, np.ones(len(piece)))
    if bounds.jerk is not None and not path.straight_ends.all():
        for _ in range(_COARSE_ROUNDS):
            grid = grid.refined(path, np.where(timing.run(grid).coarse, 3, 1))
        grid = timing.choose_windows(grid, bounds.acceleration, bounds.jerk)
    timed = timing.run(grid)
    for attempt in range(_MAX_ROUNDS):
        parts = timed.parts(path, grid, attempt, bounds.jerk is None)
        slower = Bounds.too_fast(timed.excess)
        if not slower.any() and parts.max() == 1:
            break
        grid = grid.slowed(timed.slower(path, grid, attempt, parts, bounds.jerk is None))
        if parts.max() > 1 and parts.sum() <= _MAX_GRID:
            grid = grid.refined(path, parts)
        timed = timing.run(grid)
    if timed.deviation.max() > IMAGE_TOLERANCE:
        raise TimingError(
            f"the timed curve deviates from the path by {timed.deviation.max():.3g} (rad or m) with {len(grid.s)} "
            "points: the path bends too sharply, or its curvature jumps, which a jerk limit does not permit. Use a "
            "larger rounding or resample the path"
        )
    return timed.trajectory


@dataclass(frozen=True, eq=False)
class _Timed:
    """A trajectory, and for each step of the grid (N,) its excess, its deviation, and whether it is too coarse."""

    trajectory: Trajectory
    excess: Array
    deviation: Array
    coarse: npt.NDArray[np.bool_]

    def parts(self, path: PreparedPath, grid: Grid, attempt: int, cubic: bool) -> npt.NDArray[np.int_]:
        """(N,) the number of parts into which each step is to be divided."""
        needed = np.ceil(1.1 * (self.deviation / IMAGE_TOLERANCE) ** 0.25)
        parts = np.where(self.deviation > IMAGE_TOLERANCE, needed, 1.0)
        if attempt < _COARSE_ROUNDS:
            parts = np.maximum(parts, np.where(self.coarse, 3.0, 1.0))
            if cubic:  # the excess of the jerk does not decrease with the step
                parts = np.maximum(parts, np.where(self.excess > _SUBDIVIDE_ABOVE, 2.0, 1.0))
        keep = path.straight[grid.piece] | (np.diff(grid.s) < _MIN_STEP * grid.s[-1])
        return np.where(keep, 1.0, parts).clip(1, _MAX_PARTS).astype(int)

    def slower(self, path: PreparedPath, grid: Grid, attempt: int, parts: npt.NDArray[np.int_], cubic: bool) -> Array:
        """(N,) the factor by which to slow down each step: single steps in the first rounds, then the whole run."""
        run = path.run[grid.piece]
        worst = np.zeros(int(run[-1]) + 1)
        np.maximum.at(worst, run, self.excess)
        # The factor grows with the attempts: a factor of the size of rounding errors might not converge.
        grown = 1.0 + RATE_TOLERANCE * 2.0**attempt
        together = worst[run] <= _SLIGHT_EXCESS[min(attempt, 2)]
        if attempt >= _LOCAL_ROUNDS:
            together[:] = True
        elif not cubic:  # an averaged profile cannot be slowed down in single steps
            together |= ~path.straight_ends[grid.piece]
        alone = 1.0 + (self.excess * grown - 1.0) / parts**2  # the error decreases with the square of the step
        factor = np.where(together, worst[run] * grown, alone)
        return np.where(Bounds.too_fast(np.where(together, worst[run], self.excess)), factor, 1.0)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A profile, its trajectory, and s with its derivatives at the points of the trajectory (m, 1)."""

    timed: TimedProfile
    trajectory: Trajectory
    of_s: list[Array]

    @property
    def middles(self) -> Array:
        """(k,) the value of s in the middle of each piece."""
        s = self.of_s[0][:, 0]
        result: Array = 0.5 * (s[:-1] + s[1:])
        return result


class _Timing:
    """The time parametrisation of one path with given limits and velocities at the ends."""

    def __init__(self, path: PreparedPath, bounds: Bounds, ends: tuple[Array, Array]) -> None:
        self._path, self._bounds, self._ends = path, bounds, ends
        self._speeds = _along(path, 0, ends[0]), _along(path, -1, ends[1])
        # The window (s) and the share of the jerk for each piece, equal on all pieces of a run.
        self._windows = np.ones((len(path.straight), 2))

    def choose_windows(self, grid: Grid, acceleration: Array, jerk: Array) -> Grid:
        """Choose the window with the shortest motion for each run; the grid with the slowdown of that motion."""
        path, run = self._path, self._path.run
        best, chosen = np.full(int(run[-1]) + 1, np.inf), np.ones((int(run[-1]) + 1, 2))
        slowdown = grid.slowdown.copy()
        rise = acceleration / jerk
        windows = np.geomspace(0.25 * rise.min(), 2.0 * rise.max(), _WINDOWS)
        for window, share in product(np.unique(np.maximum(windows, _SHORTEST_WINDOW)), _SHARES):
            self._windows[:] = window, share
            trial = grid
            try:
                for _ in range(_WINDOW_ROUNDS + 1):
                    candidate = self._candidate(trial)
                    excess = self._bounds.excess(candidate.trajectory)
                    slower = np.ones(len(best))
                    np.maximum.at(slower, run[path.piece_of(candidate.middles)], excess)
                    duration = np.diff(candidate.timed.rests) * slower
                    better = duration < best
                    best[better], chosen[better] = duration[better], (window, share)
                    slowdown = np.where(better[run[grid.piece]], trial.slowdown, slowdown)
                    local = np.ones(len(grid.piece))
                    np.maximum.at(local, grid.step_of(candidate.middles), excess)
                    trial = trial.slowed(local)
            except TimingError:  # with speeds at the ends, this window may not be possible
                continue
        if not np.isfinite(best).all():
            raise TimingError(
                "no timing within the jerk limits was found for start_velocity and end_velocity; reduce them"
            )
        self._windows = chosen[run]
        return replace(grid, slowdown=slowdown)

    def run(self, grid: Grid) -> _Timed:
        """Time the path on a grid and measure the result."""
        candidate = self._candidate(grid)
        step = grid.step_of(candidate.middles)
        excess, deviation = np.zeros((2, len(grid.piece)))
        np.maximum.at(excess, step, self._bounds.excess(candidate.trajectory))
        np.maximum.at(deviation, step, _deviation(self._path, candidate))
        return _Timed(candidate.trajectory, excess, deviation, candidate.timed.coarse)

    def _candidate(self, grid: Grid) -> _Candidate:
        """The trajectory of the fastest profile on a grid, with points at integer nanoseconds."""
        path, smooth = self._path, self._bounds.jerk is not None
        windows = self._windows[grid.piece] if smooth else None
        timed = fastest_profile(path, grid, self._bounds, self._speeds, windows)
        marks = timed.marks
        if not marks[-1] <= LONGEST:
            raise TimingError(
                f"the path takes longer than {LONGEST:.0f} s, which is the maximum; check that its units are radians "
                "and metres"
            )
        rests = np.searchsorted(marks, timed.rests)
        gap = max(SHORTEST_EDGE, min(_SHORTEST_SMOOTH, 0.01 * marks[-1])) if smooth else SHORTEST_PHASE
        keep = _spaced(marks, rests, gap)
        times = _distinct_nanoseconds(marks[keep])
        s, speed, acceleration = timed.profile.at(np.minimum(times, timed.profile.times[-1]))
        rests = np.searchsorted(keep, rests)
        s[rests] = np.concatenate([path.knots[:1], path.knots[path.stops], path.knots[-1:]])
        speed[rests] = acceleration[rests] = 0.0
        speed[[0, -1]] = self._speeds
        q, slope = path.at(s), path.at(s, 1)
        velocities = slope * speed[:, None]
        velocities[0], velocities[-1] = self._ends
        accelerations = None
        if smooth:
            accelerations = slope * acceleration[:, None] + path.curvature(s) * speed[:, None] ** 2
        trajectory = Trajectory(times, q, velocities, path.joint_names, self._bounds.note, accelerations=accelerations)
        of_s = [rate[:, None] for rate in ((s, speed, acceleration) if smooth else (s, speed))]
        return _Candidate(timed, trajectory, of_s)


def _along(path: PreparedPath, end: int, velocity: Array) -> float:
    """The speed s' that corresponds to a velocity along the tangent at an end of the path."""
    slope = path.control[1][end, end]
    return float(velocity @ slope / (slope @ slope)) if velocity.any() else 0.0


def _distinct_nanoseconds(times: Array) -> Array:
    """Sorted times (N,) as integer multiples of 1 ns that are strictly increasing; the last one is rounded up."""
    index = np.arange(len(times))
    count = np.rint(times * NANO).astype(np.int64)
    count[-1] = max(count[-1], math.ceil(times[-1] * NANO))
    return seconds(np.maximum.accumulate(count - index) + index)


def _spaced(times: Array, keep: npt.NDArray[np.intp], gap: float) -> npt.NDArray[np.intp]:
    """The indices of times with at least a gap between them; the indices in ``keep`` are always included."""
    needed = set(keep.tolist())
    result: list[int] = []
    for i, time in enumerate(times.tolist()):
        while result and time - times[result[-1]] < gap and result[-1] not in needed and i in needed:
            result.pop()
        if i in needed or not result or time - times[result[-1]] >= gap:
            result.append(i)
    return np.array(result)


def _deviation(path: PreparedPath, candidate: _Candidate) -> Array:
    """(k,) an upper bound of the deviation of each piece from the path, in any joint.

    On a piece, the motion q(u) is compared with path(s(u)), where s(u) is the polynomial with the values and
    derivatives of s at both ends of the piece. The difference is a polynomial of a known degree D. Its maximum is at
    most its maximum on m + 1 Chebyshev nodes, m > D, divided by cos(pi D / 2 m) (H. Ehlich, K. Zeller, "Schwankung von
    Polynomen zwischen Gitterpunkten", Mathematische Zeitschrift 86, 1964).
    """
    trajectory, s = candidate.trajectory, candidate.of_s[0][:, 0]
    result = np.zeros(len(s) - 1)
    rows = np.flatnonzero(~path.straight[path.piece_of(0.5 * (s[:-1] + s[1:]))])
    if not len(rows):
        return result
    control, piece = trajectory.bezier()[1][rows], path.piece_of(candidate.middles[rows])
    order, own = bezier.degree(control), bezier.degree(path.control[0])
    u, factor = _nodes(own * order)
    basis = _bernstein(u, order)
    at = bezier.hermite(trajectory.times, *candidate.of_s)[rows, :, 0] @ basis.T
    first, width = path.knots[piece, None], np.diff(path.knots)[piece, None]
    on_path = _bernstein(((at - first) / width).clip(0.0, 1.0), own) @ path.control[0][piece]
    first_inside = path.knots[np.searchsorted(path.knots, s[:-1], side="right").clip(max=len(path.knots) - 1)]
    # A piece may contain a knot near one end, where points are merged. There the difference is not a polynomial.
    across = (first_inside < s[1:])[rows]
    if across.any():
        on_path[across] = path.at(at[across].ravel()).reshape(on_path[across].shape)
    result[rows] = factor * np.abs(basis @ control - on_path).max(axis=(1, 2))
    return result


@cache
def _nodes(degree: int) -> tuple[Array, float]:
    """Chebyshev nodes in (0, 1), without the ends, and the factor between their maximum and that of a polynomial."""
    count = math.ceil(1.5 * degree)
    u = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count) / count)
    return u, 1.0 / math.cos(np.pi * degree / (2 * count))


def _bernstein(u: Array, degree: int) -> Array:
    """The Bernstein basis (..., degree+1) at local parameters (...)."""
    up, down = np.ones((2, *u.shape, degree + 1))
    for r in range(1, degree + 1):
        up[..., r] = up[..., r - 1] * u
        down[..., degree - r] = down[..., degree - r + 1] * (1.0 - u)
    binomial = np.array([math.comb(degree, r) for r in range(degree + 1)], dtype=float)
    return binomial * up * down
