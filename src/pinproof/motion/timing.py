"""From s over time to a trajectory that keeps its limits and its path, proven on the trajectory itself.

The fastest s over time of :mod:`pinproof.motion.speeds` knows the limits at the nodes of a grid only, and a Hermite
curve through points of the path is not the path. So every result is measured, between its points too: where it exceeds
a limit, the steps there are made slower by that much; where it misses the path, they are cut.

From a path to a trajectory, with the limits verified on the result.
"""

from __future__ import annotations

import math
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
from pinproof.motion.speeds import Drive, Grid, PreparedPath, drive
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import LONGEST, NANO, seconds
from pinproof.spatial import finite

__all__ = ["IMAGE_TOLERANCE", "MotionLimits", "time_parametrise", "time_track"]

IMAGE_TOLERANCE = 1e-5
"""How far (rad or m, in any joint) the timed curve may be from the path: a hundredth of a millimetre at a reach of a
metre, below what arms repeat to and a hundredth of the millimetres that clearances are kept in. What is certified is
the timed curve itself."""

_LARGEST_GRID = 4000
"""Steps at which cutting ends: far more than a motion needs (tens)."""

_FINEST = 1e-7
"""Of the whole path: steps that are not cut any further."""

_ROUGH = 1.01
"""Factor over a limit from which on steps are cut in two there, rather than slowed down."""

_ROUGH_ROUNDS = 3
_LOCAL_ROUNDS = 8
"""Rounds in which single steps are slowed down; from then on all are, which must end."""

_SLIGHT = (1.0, 1.005, 1.01)
"""Factor over the limits, in the first round, the second and later ones, up to which the whole motion is slowed down,
which is sure to help, and not steps."""

_ROUNDS = 40
_MOST_PARTS = 4

_WINDOWS = 6
"""How many windows are tried where jerk counts, from a quarter of the shortest time in which any joint's acceleration
may rise to the limit to twice the longest; and with how much of the jerk that a window allows:"""

_SHARES = (1.0, 0.5)
"""All of it where the acceleration rises from 0, half where it turns over from one limit to the other."""

_TRIALS = 2
"""Rounds for each of them."""

_SHORTEST_WINDOW = 8e-3
"""Seconds: what a shorter one gains is below its own length."""

_SHORTEST_SMOOTH = 2e-3
"""Seconds, or a hundredth of a short motion, below which two points are one where jerk counts: it magnifies their
rounding by 60 / h^3."""


def time_track(track: PreparedPath, bounds: Bounds, ends: tuple[Array, Array]) -> Trajectory:
    """Time a track (which moves) between velocities ``ends`` (n,), along its tangents; the caller checks the result."""
    timing = _Timing(track, bounds, ends)
    steps, piece = track.in_steps(IMAGE_TOLERANCE)
    grid = Grid.of(track, steps, piece, np.ones(len(piece)))
    if bounds.jerk is not None and not track.coasts.all():
        for _ in range(_ROUGH_ROUNDS):
            grid = grid.refined(track, np.where(timing.run(grid).coarse, 3, 1))
        grid = timing.choose_windows(grid, bounds.acceleration, bounds.jerk)
    timed = timing.run(grid)
    for attempt in range(_ROUNDS):
        parts = timed.parts(track, grid, attempt, bounds.jerk is None)
        slower = Bounds.too_fast(timed.excess)
        if not slower.any() and parts.max() == 1:
            break
        grid = grid.tightened(timed.slower(track, grid, attempt, parts, bounds.jerk is None))
        if parts.max() > 1 and parts.sum() <= _LARGEST_GRID:
            grid = grid.refined(track, parts)
        timed = timing.run(grid)
    if timed.off.max() > IMAGE_TOLERANCE:
        raise TimingError(
            f"the timed curve is {timed.off.max():.3g} off the path on {len(grid.s)} points: it bends too sharply, or "
            "its curvature jumps, which a limit of jerk does not allow; resample it, or round it off more"
        )
    return timed.trajectory


@dataclass(frozen=True, eq=False)
class _Timed:
    """A motion; per step of the grid (N,) how much too fast, how far off the path, and whether it should be finer."""

    trajectory: Trajectory
    excess: Array
    off: Array
    coarse: npt.NDArray[np.bool_]

    def parts(self, track: PreparedPath, grid: Grid, attempt: int, cubic: bool) -> npt.NDArray[np.int_]:
        """(N,) into how many parts each step is to be cut."""
        parts = np.where(self.off > IMAGE_TOLERANCE, np.ceil(1.1 * (self.off / IMAGE_TOLERANCE) ** 0.25), 1.0)
        if attempt < _ROUGH_ROUNDS:
            parts = np.maximum(parts, np.where(self.coarse, 3.0, 1.0))
            if cubic:  # excess of jerk does not fall with the step
                parts = np.maximum(parts, np.where(self.excess > _ROUGH, 2.0, 1.0))
        whole = track.straight[grid.piece] | (np.diff(grid.s) < _FINEST * grid.s[-1])
        return np.where(whole, 1.0, parts).clip(1, _MOST_PARTS).astype(int)

    def slower(self, track: PreparedPath, grid: Grid, attempt: int, parts: npt.NDArray[np.int_], cubic: bool) -> Array:
        """(N,) by what factor each step is to be slower: itself only at first, then all between two stops."""
        run = track.run[grid.piece]
        worst = np.zeros(int(run[-1]) + 1)
        np.maximum.at(worst, run, self.excess)
        # rounding alone would not be outrun by what is measured of it: the steps grow, so this ends
        grown = 1.0 + RATE_TOLERANCE * 2.0**attempt
        together = worst[run] <= _SLIGHT[min(attempt, 2)]
        if attempt >= _LOCAL_ROUNDS:
            together[:] = True
        elif not cubic:  # what is averaged knows no single steps
            together |= ~track.coasts[grid.piece]
        alone = 1.0 + (self.excess * grown - 1.0) / parts**2  # cutting helps, too: errors fall with the square
        factor = np.where(together, worst[run] * grown, alone)
        return np.where(Bounds.too_fast(np.where(together, worst[run], self.excess)), factor, 1.0)


@dataclass(frozen=True, eq=False)
class _Written:
    """A motion, and s with as many of its derivatives as the points state (m, 1)."""

    driven: Drive
    trajectory: Trajectory
    of_s: list[Array]

    @property
    def middles(self) -> Array:
        """(k,) s in the middle of each piece."""
        s = self.of_s[0][:, 0]
        result: Array = 0.5 * (s[:-1] + s[1:])
        return result


class _Timing:
    """One track, its limits, and the velocities at its ends."""

    def __init__(self, track: PreparedPath, bounds: Bounds, ends: tuple[Array, Array]) -> None:
        self._track, self._bounds, self._ends = track, bounds, ends
        self._speeds = _along(track, 0, ends[0]), _along(track, -1, ends[1])
        # seconds, and the share of the jerk they allow, of each piece; all alike between two stops
        self._windows = np.ones((len(track.straight), 2))

    def choose_windows(self, grid: Grid, acceleration: Array, jerk: Array) -> Grid:
        """Take, between any two stops, the window with which the motion is shortest; the grid, as slow as then."""
        track, run = self._track, self._track.run
        best, chosen = np.full(int(run[-1]) + 1, np.inf), np.ones((int(run[-1]) + 1, 2))
        tight = grid.tight.copy()
        rise = acceleration / jerk
        windows = np.geomspace(0.25 * rise.min(), 2.0 * rise.max(), _WINDOWS)
        for window, share in product(np.unique(np.maximum(windows, _SHORTEST_WINDOW)), _SHARES):
            self._windows[:] = window, share
            trial = grid
            try:
                for _ in range(_TRIALS + 1):
                    written = self._write(trial)
                    excess = self._bounds.excess(written.trajectory)
                    slower = np.ones(len(best))
                    np.maximum.at(slower, run[track.piece_of(written.middles)], excess)
                    duration = np.diff(written.driven.rests) * slower
                    better = duration < best
                    best[better], chosen[better] = duration[better], (window, share)
                    tight = np.where(better[run[grid.piece]], trial.tight, tight)
                    local = np.ones(len(grid.piece))
                    np.maximum.at(local, grid.step_of(written.middles), excess)
                    trial = trial.tightened(local)
            except TimingError:  # with speeds at the ends, there may be no way for this window
                continue
        if not np.isfinite(best).all():
            raise TimingError(
                "no timing within the limits of jerk was found for the velocities at the ends; lower them"
            )
        self._windows = chosen[run]
        return replace(grid, tight=tight)

    def run(self, grid: Grid) -> _Timed:
        """Time it and measure the result."""
        written = self._write(grid)
        step = grid.step_of(written.middles)
        excess, off = np.zeros((2, len(grid.piece)))
        np.maximum.at(excess, step, self._bounds.excess(written.trajectory))
        np.maximum.at(off, step, _deviation(self._track, written))
        return _Timed(written.trajectory, excess, off, written.driven.coarse)

    def _write(self, grid: Grid) -> _Written:
        """The motion, as points of the path in whole nanoseconds."""
        track, smooth = self._track, self._bounds.jerk is not None
        driven = drive(track, grid, self._bounds, self._speeds, self._windows[grid.piece] if smooth else None)
        marks = driven.marks
        if not marks[-1] <= LONGEST:
            raise TimingError(
                f"the path takes longer than the {LONGEST:.0f} s that can be counted; are its units radians and metres?"
            )
        rests = np.searchsorted(marks, driven.rests)
        gap = max(SHORTEST_EDGE, min(_SHORTEST_SMOOTH, 0.01 * marks[-1])) if smooth else SHORTEST_PHASE
        keep = _apart(marks, rests, gap)
        times = _ticks(marks[keep])
        s, speed, acceleration = driven.profile.at(np.minimum(times, driven.profile.times[-1]))
        rests = np.searchsorted(keep, rests)
        s[rests] = np.concatenate([track.knots[:1], track.knots[track.stops], track.knots[-1:]])
        speed[rests] = acceleration[rests] = 0.0
        speed[[0, -1]] = self._speeds
        q, slope = track.at(s), track.at(s, 1)
        velocities = slope * speed[:, None]
        velocities[0], velocities[-1] = self._ends
        accelerations = None
        if smooth:
            accelerations = slope * acceleration[:, None] + track.curvature(s) * speed[:, None] ** 2
        trajectory = Trajectory(times, q, velocities, track.joint_names, self._bounds.note, accelerations=accelerations)
        of_s = [rate[:, None] for rate in ((s, speed, acceleration) if smooth else (s, speed))]
        return _Written(driven, trajectory, of_s)


def _along(track: PreparedPath, end: int, velocity: Array) -> float:
    """The speed s' of a velocity along the tangent at an end of the track."""
    slope = track.control[1][end, end]
    return float(velocity @ slope / (slope @ slope)) if velocity.any() else 0.0


def _ticks(times: Array) -> Array:
    """Times (N,), in order, in whole nanoseconds at least one apart, the last one rounded up."""
    index = np.arange(len(times))
    count = np.rint(times * NANO).astype(np.int64)
    count[-1] = max(count[-1], math.ceil(times[-1] * NANO))
    return seconds(np.maximum.accumulate(count - index) + index)


def _apart(times: Array, keep: npt.NDArray[np.intp], gap: float) -> npt.NDArray[np.intp]:
    """Indices of times that are a gap apart; those in ``keep`` stay, whatever is next to them."""
    needed = set(keep.tolist())
    result: list[int] = []
    for i, time in enumerate(times.tolist()):
        while result and time - times[result[-1]] < gap and result[-1] not in needed and i in needed:
            result.pop()
        if i in needed or not result or time - times[result[-1]] >= gap:
            result.append(i)
    return np.array(result)


def _deviation(track: PreparedPath, written: _Written) -> Array:
    """(k,) how far each piece may be from the path, in any joint: a bound, not a sample.

    On a piece the motion q(u) is compared with path(s(u)), where s(u) is the polynomial with the piece's own s and its
    derivatives at both ends. Their difference is a polynomial of a degree D that is known. Over m + 1 Chebyshev nodes,
    m > D, its largest value is that at the nodes divided by cos(pi D / 2 m) at most (H. Ehlich, K. Zeller,
    "Schwankung von Polynomen zwischen Gitterpunkten", Mathematische Zeitschrift 86, 1964).
    """
    trajectory, s = written.trajectory, written.of_s[0][:, 0]
    result = np.zeros(len(s) - 1)
    rows = np.flatnonzero(~track.straight[track.piece_of(0.5 * (s[:-1] + s[1:]))])
    if not len(rows):
        return result
    control, piece = trajectory.bezier()[1][rows], track.piece_of(written.middles[rows])
    order, own = bezier.degree(control), bezier.degree(track.control[0])
    u, factor = _nodes(own * order)
    basis = _bernstein(u, order)
    at = bezier.hermite(trajectory.times, *written.of_s)[rows, :, 0] @ basis.T
    first, width = track.knots[piece, None], np.diff(track.knots)[piece, None]
    path = _bernstein(((at - first) / width).clip(0.0, 1.0), own) @ track.control[0][piece]
    s = written.of_s[0][:, 0]
    first_inside = track.knots[np.searchsorted(track.knots, s[:-1], side="right").clip(max=len(track.knots) - 1)]
    astride = (first_inside < s[1:])[rows]  # of a knot, by no more than a thousandth of a second: no polynomial
    if astride.any():
        path[astride] = track.at(at[astride].ravel()).reshape(path[astride].shape)
    result[rows] = factor * np.abs(basis @ control - path).max(axis=(1, 2))
    return result


@cache
def _nodes(degree: int) -> tuple[Array, float]:
    """Chebyshev nodes in (0, 1), without the ends, and the factor that bounds a polynomial of a degree by them."""
    count = math.ceil(1.5 * degree)
    u = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count) / count)
    return u, 1.0 / math.cos(np.pi * degree / (2 * count))


def _bernstein(u: Array, degree: int) -> Array:
    """The basis (..., degree+1) at local parameters (...)."""
    up, down = np.ones((2, *u.shape, degree + 1))
    for r in range(1, degree + 1):
        up[..., r] = up[..., r - 1] * u
        down[..., degree - r] = down[..., degree - r + 1] * (1.0 - u)
    binomial = np.array([math.comb(degree, r) for r in range(degree + 1)], dtype=float)
    return binomial * up * down


TANGENT_TOLERANCE = 1e-9
"""Relative to its size: how far a velocity may lie off the path's tangent, for rounding."""


def time_parametrise(
    curve: Curve,
    limits: MotionLimits,
    *,
    jerk: npt.ArrayLike | Literal["limits"] | None = None,
    start_velocity: npt.ArrayLike | None = None,
    end_velocity: npt.ArrayLike | None = None,
) -> Trajectory:
    """Time a path as fast as the limits allow, without changing its image.

    The motion stops at the corners of a :class:`~pinproof.JointPath` (each straight stretch gets the time-optimal
    profile in closed form) and runs through all else: a :class:`~pinproof.motion.CubicPath`, and a
    :class:`~pinproof.motion.BlendedPath` but for its remaining corners. Straight lines are kept to rounding, bends to
    :data:`~pinproof.motion.timing.IMAGE_TOLERANCE`. All limits hold for the exact extremes of the result (to a
    relative :data:`~pinproof.motion.limits.RATE_TOLERANCE`), not for samples of it; what exceeds them is slowed down
    until it does not.

    Parameters
    ----------
    curve
        What to time. Start = goal gives a single point of duration 0.
    limits
        ``velocity`` (n,) in rad/s or m/s and ``acceleration`` (n,) in rad/s^2 or m/s^2, such as ``arm.limits``. Where
        there are ``lower`` and ``upper`` (n,), the result is checked against them; ``acceleration_source``, a text, is
        handed on in the result's ``limits_note``.
    jerk
        Limits of jerk, (n,) in rad/s^3 or m/s^3 or one for all joints; ``"limits"`` takes ``limits.jerk``. The result
        is then a quintic, whose accelerations do not jump, from no acceleration at rest. By default jerk does not
        count, and the result is a cubic.
    start_velocity, end_velocity
        (n,) in rad/s or m/s, along the path's tangent and forward; by default rest. Note that ros2_control's
        joint_trajectory_controller refuses motions that do not end at rest, unless told otherwise.

    Raises
    ------
    InputError
        For limits of a wrong shape, or that are not known (NaN) or not positive and finite, names the joint; for a
        velocity that does not lie along the path.
    TimingError
        If the path leaves the joint limits, or no timing within the limits was found.

    Notes
    -----
    With a jerk limit straight stretches between two stops are time-optimal. What runs through bends is the fastest
    motion with softer accelerations, averaged over a window of time: it has no proof of being the fastest.
    """
    if not callable(getattr(curve, "bezier", None)) or isinstance(curve, Trajectory):
        raise InputError(f"only a path can be timed, such as a JointPath, not a {type(curve).__name__}")
    bounds = Bounds.of(limits, curve.joint_names, jerk)
    ends = [
        np.zeros(len(curve.joint_names)) if velocity is None else finite(name, velocity, (len(curve.joint_names),))
        for name, velocity in (("start_velocity", start_velocity), ("end_velocity", end_velocity))
    ]
    if not np.ptp(curve.bezier()[1], axis=(0, 1)).any():
        if ends[0].any() or ends[1].any():
            raise InputError("the path stands still; a velocity at its ends leads away from it")
        still = np.zeros((1, len(curve.start)))
        point = Trajectory(
            [0.0], [curve.start], still, curve.joint_names, bounds.note, accelerations=None if jerk is None else still
        )
        return _verified(point, bounds)
    track = PreparedPath(curve, bounds)
    for end, place, velocity in ((0, "start", ends[0]), (-1, "end", ends[1])):
        _check_velocity(place, velocity, track.control[1][end, end], bounds, curve.joint_names)
    return _verified(time_track(track, bounds, (ends[0], ends[1])), bounds)


def _check_velocity(place: str, velocity: Array, tangent: Array, bounds: Bounds, names: tuple[str, ...]) -> None:
    if not velocity.any():
        return
    along = float(velocity @ tangent) * tangent / max(float(tangent @ tangent), np.finfo(float).tiny)
    # A velocity below the smallest normal number has lost its direction.
    if np.abs(velocity - along).max() > TANGENT_TOLERANCE * np.abs(velocity).max() + np.finfo(float).tiny:
        raise InputError(
            f"{place}_velocity {velocity} does not lie along the path, whose tangent there is {tangent}: the arm would "
            "leave it"
        )
    if velocity @ tangent < 0.0:
        raise InputError(f"{place}_velocity {velocity} leads backward; the path's tangent there is {tangent}")
    over = np.abs(velocity) / bounds.velocity
    if over.max() > 1.0 + RATE_TOLERANCE:
        name, limit = names[int(over.argmax())], bounds.velocity[int(over.argmax())]
        raise InputError(f"{place}_velocity is above the velocity limit {limit:g} of joint {name!r}")


def _verified(trajectory: Trajectory, bounds: Bounds) -> Trajectory:
    """The trajectory itself, if every limit holds on it."""
    control = trajectory.bezier()[1]
    outside = (control.min(axis=(0, 1)) < bounds.lower) | (control.max(axis=(0, 1)) > bounds.upper)
    low, high = trajectory.range() if outside.any() else (bounds.lower, bounds.upper)  # within, if its hull is
    for name, a, b, lower, upper in zip(trajectory.joint_names, low, high, bounds.lower, bounds.upper, strict=True):
        if a < lower - POSITION_TOLERANCE or b > upper + POSITION_TOLERANCE:
            raise TimingError(
                f"the path leaves the limits of joint {name!r}: it spans [{a:.9g}, {b:.9g}], allowed is "
                f"[{lower:.9g}, {upper:.9g}]; plan it inside the limits"
            )
    excess = bounds.excess(trajectory)
    if bounds.too_fast(excess).any():
        raise TimingError(
            f"no timing within the limits was found: still {excess.max() - 1.0:.3g} above them after slowing down; are "
            "two waypoints closer than rounding, or are velocities at the ends too high?"
        )
    return trajectory
