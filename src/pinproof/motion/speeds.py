"""The fastest profile s(t) along a path, from the joint limits: preparation of the path, its grid, and the phases."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof._core import fastest_speeds
from pinproof.errors import TimingError
from pinproof.motion import bezier
from pinproof.motion.curve import Array, Curve
from pinproof.motion.joint_path import JointPath
from pinproof.motion.limits import Bounds
from pinproof.motion.profile import Profile, connectable_speeds, double_s, ramps, trapezoid
from pinproof.motion.rate_constraints import constraint_rows

__all__ = ["ON_LINE_TOLERANCE", "Grid", "PreparedPath", "TimedProfile", "fastest_profile"]

ON_LINE_TOLERANCE = 1e-13
"""Distance from a straight line (relative to the largest coordinate of a joint, at least 1 rad or m) at which a point
counts as on it. It covers a few rounding errors, so that the image of the path does not change."""

SAME_TANGENT = 1e-6
"""Relative difference of the derivatives of two adjacent pieces below which they are equal. Otherwise the motion stops
between them, unless the path defines its corners."""

MAX_INITIAL_STEPS = 64
"""Maximum number of steps of a piece in the first grid."""

MIN_STEPS = 8
"""Minimum number of steps on all bent pieces together. A single step that begins and ends at rest would not move."""

CONSTRAINED_STEPS = 16
"""Minimum number of steps of a piece if there are constraints, which may vary along the piece."""

SPEED_CHANGE_FACTOR = 8.0
"""Factor between the deviation of the timed curve at a varying speed and that at a constant speed."""

_LARGEST = 1e150
"""Upper bound of the limits of s, which are otherwise infinite where joints do not move."""

_BEND_SHARE = 0.4
"""Fraction of the jerk limit for the curvature of bends in which the speed changes; the rest is for that change."""

_MAX_LOSS = 4e-3
"""Fraction of the total time that a step may lose before it is subdivided. The estimate is eight times too large."""

_JERK_JUMP = 0.2
"""Jump of the jerk, relative to its largest value, at which a point of the trajectory is placed."""

_EDGES = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
"""The sign of the jerk in the phases of a double-S profile."""


class PreparedPath:
    """The pieces of a path over a parameter s that is scaled to be similar to the time in seconds.

    Attributes
    ----------
    knots
        (k+1,) the values of s at the ends of the pieces.
    control
        The control points of the path and of its first three derivatives.
    straight
        (k,) whether a piece is a straight line with constant derivative.
    stops
        (k+1,) whether the motion must stop at a knot; False at both ends of the path.
    run
        (k,) the number of stops before a piece. The pieces between two stops form a run.
    straight_ends
        (k,) whether the run of a piece begins and ends with a straight piece.
    """

    def __init__(self, curve: Curve, bounds: Bounds) -> None:
        self.joint_names = curve.joint_names
        if isinstance(curve, JointPath):
            corners = _corners(curve.q)
            knots, control = np.arange(len(corners), dtype=float), np.stack([corners[:-1], corners[1:]], axis=1)
        else:
            knots, control = curve.bezier()
        width, slope = np.diff(knots), np.abs(bezier.derivative(knots, control))
        at_full_speed = float(width @ (slope / bounds.velocity).max(axis=(1, 2)))
        at_full_acceleration = float(width @ (slope / bounds.acceleration).max(axis=(1, 2)))
        scale = (at_full_speed + 2.0 * math.sqrt(at_full_acceleration)) / (knots[-1] - knots[0])
        self.knots = (knots - knots[0]) * scale
        self.control = [control]
        for _ in range(3):
            self.control.append(bezier.derivative(self.knots, self.control[-1]))
        share = np.linspace(0.0, 1.0, bezier.degree(control) + 1)[:, None]
        line = control[:, :1] * (1.0 - share) + control[:, -1:] * share
        near = ON_LINE_TOLERANCE * np.maximum(1.0, np.abs(control).max(axis=(0, 1)))
        self.straight: npt.NDArray[np.bool_] = (np.abs(control - line) <= near).all(axis=(1, 2))
        self.constrained = bool(bounds.constraints)
        if self.constrained:  # which may vary along a line
            self.straight[:] = False
        self.stops = np.zeros(len(knots), dtype=bool)
        if isinstance(curve, JointPath):
            self.stops[1:-1] = True
        elif hasattr(curve, "corners"):
            self.stops[1:-1] = np.isin(knots[1:-1], np.asarray(curve.corners, dtype=float))
        else:
            first = self.control[1]
            gap = np.abs(first[1:, 0] - first[:-1, -1]).max(axis=1)
            fastest = np.abs(first).max(axis=(1, 2))
            self.stops[1:-1] = gap > SAME_TANGENT * np.maximum(fastest[1:], fastest[:-1])

        self.run: npt.NDArray[np.intp] = np.concatenate([[0], np.cumsum(self.stops[1:-1])])
        starts = np.flatnonzero(np.concatenate([[True], self.stops[1:-1]]))
        ends = np.concatenate([starts[1:], [len(control)]])
        both = self.straight[starts] & self.straight[ends - 1]
        self.straight_ends: npt.NDArray[np.bool_] = np.repeat(both, ends - starts)

    def piece_of(self, s: Array) -> npt.NDArray[np.intp]:
        """(N,) the piece that contains s; at a knot the later one."""
        return np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.straight) - 1)

    def at(self, s: Array, order: int = 0, piece: npt.NDArray[np.intp] | None = None) -> Array:
        """(N, n) the path or its derivative with respect to s. ``piece`` selects the pieces; s is clipped to them."""
        piece = self.piece_of(s) if piece is None else piece
        u = ((s - self.knots[piece]) / (self.knots[piece + 1] - self.knots[piece])).clip(0.0, 1.0)
        return bezier.on_pieces(self.control[order], piece, u)

    def curvature(self, s: Array) -> Array:
        """(N, n) the second derivative with respect to s; at a knot the mean of both sides."""
        before = np.clip(np.searchsorted(self.knots, s, side="left") - 1, 0, len(self.straight) - 1)
        return 0.5 * (self.at(s, 2) + self.at(s, 2, before))

    def initial_steps(self, tolerance: float) -> tuple[Array, npt.NDArray[np.intp]]:
        """A first grid (N+1,) over s, and the piece (N,) of each step.

        A straight piece is one step. A bent piece has the number of steps with which cubic Hermite pieces follow it at
        a constant speed: they deviate from a function by h^4 / 384 times its fourth derivative (P. J. Davis,
        "Interpolation and Approximation", 1975, section 3.5).
        """
        fourth = np.abs(bezier.derivative(self.knots, self.control[3])).max(axis=(1, 2))
        deviation = SPEED_CHANGE_FACTOR * fourth * np.diff(self.knots) ** 4 / 384.0
        count = np.ceil((deviation / tolerance) ** 0.25).clip(2, MAX_INITIAL_STEPS).astype(int)
        bent = int(np.count_nonzero(~self.straight))
        least = CONSTRAINED_STEPS if self.constrained else math.ceil(MIN_STEPS / max(bent, 1))
        count = np.where(self.straight, 1, np.maximum(count, least))
        return _subdivide(self.knots, count), np.repeat(np.arange(len(count)), count)


def _subdivide(grid: Array, parts: npt.NDArray[np.int_]) -> Array:
    """The grid with each step divided into equal parts."""
    begin = np.cumsum(parts) - parts
    share = (np.arange(int(parts.sum())) - np.repeat(begin, parts)) / np.repeat(parts, parts)
    left, right = np.repeat(grid[:-1], parts), np.repeat(grid[1:], parts)
    return np.concatenate([left * (1.0 - share) + right * share, grid[-1:]])


def _corners(q: Array) -> Array:
    """The waypoints at which the motion must stop, without repeated ones and those on a straight line."""
    moves = np.concatenate([[True], (np.diff(q, axis=0) != 0.0).any(axis=1)])
    q = q[moves]
    corners, first = [0], 0
    while first < len(q) - 1:
        last = first + 1
        while last + 1 < len(q) and _straight(q[first : last + 2]):
            last += 1
        corners.append(last)
        first = last
    return q[corners]


def _straight(q: Array) -> bool:
    """Whether the inner points lie on the segment from the first to the last point, in order."""
    chord = q[-1] - q[0]
    s = (q - q[0]) @ chord / max(float(chord @ chord), np.finfo(float).tiny)
    off = np.abs(q[0] + s[:, None] * chord - q)
    return bool((np.diff(s) > 0.0).all() and (off <= ON_LINE_TOLERANCE * np.maximum(1.0, np.abs(q).max(axis=0))).all())


@dataclass(frozen=True, eq=False)
class Grid:
    """Steps over s. On each step of a bend, s'' is constant; a straight piece is a single step in the first grid.

    Attributes
    ----------
    s
        (N+1,) the nodes.
    piece
        (N,) the piece of the path that contains each step.
    slowdown
        (N,) the factor by which each step is slower than the limits permit at the nodes.
    slope, curvature
        (N, 2, n) the derivatives of the path with respect to s at both ends of each step.
    """

    s: Array
    piece: npt.NDArray[np.intp]
    slowdown: Array
    slope: Array
    curvature: Array

    @classmethod
    def of(cls, path: PreparedPath, s: Array, piece: npt.NDArray[np.intp], slowdown: Array) -> Grid:
        """A grid of these steps on a path."""
        slope, curvature = (
            np.stack([path.at(s[:-1], order, piece), path.at(s[1:], order, piece)], axis=1) for order in (1, 2)
        )
        curvature[path.straight[piece]] = 0.0
        return cls(s, piece, slowdown, slope, curvature)

    def refined(self, path: PreparedPath, parts: npt.NDArray[np.int_]) -> Grid:
        """Divide each step into equal parts."""
        return Grid.of(path, _subdivide(self.s, parts), np.repeat(self.piece, parts), np.repeat(self.slowdown, parts))

    def slowed(self, factor: Array | float) -> Grid:
        """Slow down each step by a factor."""
        return replace(self, slowdown=self.slowdown * factor)

    def between(self, path: PreparedPath, begin: float, end: float) -> Grid:
        """The part between two values of s."""
        first, last = np.searchsorted(self.s, begin, side="right"), np.searchsorted(self.s, end, side="left")
        s = np.concatenate([[begin], self.s[first:last], [end]])
        return Grid.of(path, s, self.piece[first - 1 : last], self.slowdown[first - 1 : last])

    def step_of(self, s: Array) -> npt.NDArray[np.intp]:
        """(N,) the step that contains s."""
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.piece) - 1)


@dataclass(frozen=True, eq=False)
class TimedProfile:
    """The profile s(t) and the times of the trajectory points.

    Attributes
    ----------
    profile
        s over time.
    rests
        (R,) the times of the ends and stops, each at the end of a phase of ``profile``.
    marks
        (M,) the times of the trajectory points, including ``rests``.
    coarse
        (N,) the steps that should be subdivided, because s'' changes within them.
    """

    profile: Profile
    rests: Array
    marks: Array
    coarse: npt.NDArray[np.bool_]


def fastest_profile(
    path: PreparedPath, grid: Grid, bounds: Bounds, ends: tuple[float, float], window: Array | None
) -> TimedProfile:
    """The fastest profile along the path with the limits at the nodes of the grid.

    Parameters
    ----------
    path, grid, bounds
        The path, its grid, and the limits.
    ends
        The speed s' at the beginning and at the end.
    window
        None without a jerk limit. Else (N, 2), equal on all steps of a run: the duration (s) of the moving average, and
        a share. The fastest profile with accelerations of at most jerk * window * share is averaged over the window.

    Raises
    ------
    TimingError
        If the speeds at the ends are not possible within the limits.
    """
    full_grid = grid
    if window is not None:
        grid, window = _without_averaged_ends(path, grid, ends, window)
    phases = _Phases(path, grid, bounds, ends, window)
    coarse = np.zeros(len(full_grid.piece), dtype=bool)
    coarse[full_grid.step_of(0.5 * (grid.s[:-1] + grid.s[1:]))] = phases.coarse
    if window is None:
        profile = phases.profile(slice(0, len(grid.piece)))
        return TimedProfile(profile, profile.times[phases.rests], profile.times, coarse)
    parts, marks, rests = [], [], [0.0]
    for first, last in pairwise(phases.stops.tolist()):
        steps = slice(first, last)
        straight_ends = bool(path.straight_ends[grid.piece[first]])
        if straight_ends and not phases.exact[first]:
            phases.set_constant_speed_in_bends(steps)
        part = phases.profile(steps)
        marked = part.times
        if not straight_ends:
            part = part.smoothed(float(window[first, 0]))
            jumps = np.abs(np.diff(part.jerk)) > _JERK_JUMP * np.abs(part.jerk).max()
            nodes = grid.s[first + 1 : last]
            at_nodes = part.times_at(nodes[nodes < part.s[-1]])
            marked = np.concatenate([part.times[[0, -1]], part.times[1:-1][jumps], at_nodes])
        marks.append(rests[-1] + marked)
        parts.append(part)
        rests.append(rests[-1] + part.times[-1])
    profile = Profile.join(*parts)
    return TimedProfile(profile, np.array(rests), np.unique(np.concatenate(marks)), coarse)


def _without_averaged_ends(
    path: PreparedPath, grid: Grid, ends: tuple[float, float], window: Array
) -> tuple[Grid, Array]:
    """The grid without the distance that averaging adds at the ends: half a window at the speed there."""
    begin, end = (
        knot + 0.5 * window[i, 0] * speed * (not path.straight_ends[i]) * (1 + 2 * i)
        for i, knot, speed in ((0, path.knots[0], ends[0]), (-1, path.knots[-1], ends[1]))
    )
    if not begin < end:
        raise TimingError("the path is too short for the velocities at its ends; reduce them or use a longer path")
    if begin == path.knots[0] and end == path.knots[-1]:
        return grid, window
    first, last = np.searchsorted(grid.s, begin, side="right") - 1, np.searchsorted(grid.s, end, side="left")
    return grid.between(path, float(begin), float(end)), window[first:last]


def _squared_ceiling(fastest: Array, stop: npt.NDArray[np.bool_], ends: tuple[float, float]) -> Array:
    """The largest squared speed at each grid point, from those (m, 2) at both ends of each step."""
    ceiling = np.full(len(stop), np.inf)
    np.minimum(ceiling[:-1], fastest[:, 0] ** 2, out=ceiling[:-1])
    np.minimum(ceiling[1:], fastest[:, 1] ** 2, out=ceiling[1:])
    ceiling[stop] = 0.0
    ceiling[[0, -1]] = np.square(ends)
    return ceiling


class _Phases:
    """The phases of each step, at most seven: one on the steps of bends, the closed forms on straight steps."""

    def __init__(
        self, path: PreparedPath, grid: Grid, bounds: Bounds, ends: tuple[float, float], window: Array | None
    ) -> None:
        s, piece, step, slope = grid.s, grid.piece, np.diff(grid.s), grid.slope
        bent = ~path.straight[piece]
        velocity = bounds.velocity / grid.slowdown[:, None]
        acceleration = bounds.acceleration / grid.slowdown[:, None] ** 2
        jerk = None if bounds.jerk is None else bounds.jerk / grid.slowdown[:, None] ** 3
        if jerk is not None and window is not None:
            soft = np.minimum(acceleration, jerk * window.prod(axis=1, keepdims=True))
            soft = np.where(path.straight_ends[piece, None], acceleration, soft)
        else:
            soft = acceleration
        fastest = _least(velocity[:, None], slope)
        self._bent = bent
        if jerk is not None:
            fastest = self._limited_by_jerk(path, grid, fastest, velocity, acceleration, jerk)
        stop = np.isin(s, path.knots[path.stops])
        ceiling = _squared_ceiling(fastest, stop, ends)
        limits = _rows(path, grid, bounds, soft)
        x, stuck = fastest_speeds(*limits, step, ceiling, ceiling[0], ceiling[-1])
        if stuck is not None:
            raise _timing_error(stuck, len(step), ends)
        speed = np.sqrt(x)
        stop[[0, -1]] = True
        self.stops = np.flatnonzero(stop)
        self.coarse = bent & _coarse(step, speed)
        self._s, self._speed = s, speed
        begin, end = speed[:-1], speed[1:]
        self._durations, self._acceleration, self._jerk = np.zeros((3, len(step), 7))
        with np.errstate(divide="ignore", invalid="ignore"):
            self._durations[:, 0] = 2.0 * step / (begin + end)
            self._acceleration[:, 0] = (end - begin) / self._durations[:, 0]
        flat = np.flatnonzero(~bent)
        if not np.isfinite(self._durations[bent, 0]).all():
            raise TimingError("the path does not move within a bend; resample it more evenly")
        if len(flat):
            limit_s = fastest[flat].min(axis=1)
            self._trapezoids(flat, step[flat], begin[flat], end[flat], limit_s, _least(soft, slope[:, 0])[flat])
        self.exact = np.zeros(len(step), dtype=bool)
        if jerk is not None:
            self.exact = ~bent & (begin == 0.0) & (end == 0.0)
            rows = np.flatnonzero(self.exact)
            along = [_least(limit, slope[:, 0])[rows] for limit in (velocity, acceleration, jerk)]
            if len(rows):
                self._double_s(rows, step[rows], *along)

    def _limited_by_jerk(
        self, path: PreparedPath, grid: Grid, fastest: Array, velocity: Array, acceleration: Array, jerk: Array
    ) -> Array:
        """The largest speeds (m, 2) at the ends of the steps; stores the limits used by constant speed in bends."""
        third = np.stack([path.at(grid.s[:-1], 3, grid.piece), path.at(grid.s[1:], 3, grid.piece)], axis=1)
        third[~self._bent] = 0.0
        self._straight_limits = [_least(limit, grid.slope[:, 0]) for limit in (velocity, acceleration, jerk)]
        sharpest = np.sqrt(_least(acceleration[:, None], grid.curvature)), np.cbrt(_least(jerk[:, None], third))
        self._bend_speed = np.minimum(fastest, np.minimum(*sharpest)).min(axis=1)
        return np.asarray(np.minimum(fastest, np.cbrt(_BEND_SHARE * _least(jerk[:, None], third))))

    def set_constant_speed_in_bends(self, steps: slice) -> None:
        """Replace the phases of a run with straight ends: constant speed in bends, ramps on straight segments."""
        bent = self._bent[steps]
        straight = steps.start + np.flatnonzero(~bent)
        bends = np.flatnonzero(np.diff(straight) > 1)  # there is a bend after each of these
        blocks = np.split(straight, bends + 1)
        wanted = [float(self._speed[steps.start])]
        for before, after in pairwise(blocks):
            wanted.append(float(self._bend_speed[before[-1] + 1 : after[0]].min()))
        wanted.append(float(self._speed[steps.stop]))
        widths = np.diff(self._s)
        limits = self._straight_limits
        segments = [(float(widths[b].sum()), *(float(limit[b].min()) for limit in limits)) for b in blocks]
        lengths, _, accelerations, jerks = (np.array(column) for column in zip(*segments, strict=True))
        speeds = connectable_speeds(np.array(wanted), lengths, accelerations, jerks)
        if speeds[0] < wanted[0] or speeds[-1] < wanted[-1]:
            raise _timing_error(0, 1, (wanted[0], wanted[-1]))
        for i, block in enumerate(blocks):
            length, speed, acceleration, jerk = segments[i]
            durations, edges = ramps(float(speeds[i]), float(speeds[i + 1]), speed, length, acceleration, jerk)
            self._durations[block] = 0.0  # all phases are assigned to the first step of a segment
            self._durations[block[0]], self._jerk[block[0]] = durations, edges
            gained = np.cumsum(self._jerk[block[0]] * self._durations[block[0]])
            self._acceleration[block[0], 0], self._acceleration[block[0], 1:] = 0.0, gained[:-1]
            self._speed[block[0] + 1 : block[-1] + 1] = speeds[i + 1]
            if i + 1 < len(blocks):
                bend = slice(int(block[-1]) + 1, int(blocks[i + 1][0]))
                self._speed[bend.start : bend.stop + 1] = speeds[i + 1]
                self._durations[bend], self._acceleration[bend] = 0.0, 0.0
                self._durations[bend, 0] = widths[bend] / speeds[i + 1]

    def _trapezoids(
        self, rows: npt.NDArray[np.intp], length: Array, begin: Array, end: Array, speed: Array, acceleration: Array
    ) -> None:
        durations, speeds = trapezoid(length, begin, end, speed, acceleration)
        self._durations[rows, :3] = durations
        self._acceleration[rows, :3] = np.divide(
            np.diff(speeds, axis=1), durations, out=np.zeros_like(durations), where=durations > 0.0
        )

    def _double_s(
        self, rows: npt.NDArray[np.intp], length: Array, speed: Array, acceleration: Array, jerk: Array
    ) -> None:
        durations, edge = double_s(length, speed, acceleration, jerk)
        jerks = edge[:, None] * _EDGES
        gained = np.cumsum(jerks * durations, axis=1)
        self._durations[rows], self._jerk[rows] = durations, jerks
        self._acceleration[rows, 0], self._acceleration[rows, 1:] = 0.0, gained[:, :-1]

    @property
    def rests(self) -> npt.NDArray[np.intp]:
        """The indices of those ends of phases, in the complete profile, that are its ends and stops."""
        count = np.count_nonzero(self._durations > 0.0, axis=1)
        result: npt.NDArray[np.intp] = np.concatenate([[0], np.cumsum(count)])[self.stops]
        return result

    def profile(self, steps: slice) -> Profile:
        """The profile on consecutive steps. Each step begins exactly at its node, so that rounding does not add up."""
        t, a, j = self._durations[steps], self._acceleration[steps], self._jerk[steps]
        gain, distance = (a + 0.5 * j * t) * t, (0.5 * a + j * t / 6.0) * t * t
        nodes, speeds = self._s[steps.start : steps.stop + 1], self._speed[steps.start : steps.stop + 1]
        speed = speeds[:-1, None] + np.cumsum(gain, axis=1) - gain
        distance += speed * t
        s = nodes[:-1, None] + np.cumsum(distance, axis=1) - distance
        keep = t > 0.0
        return Profile(
            np.concatenate([[0.0], np.cumsum(t[keep])]),
            np.concatenate([s[keep], nodes[-1:]]),
            np.concatenate([speed[keep], speeds[-1:]]),
            a[keep],
            j[keep],
        )


def _rows(path: PreparedPath, grid: Grid, bounds: Bounds, acceleration: Array) -> tuple[Array, ...]:
    """alpha, beta, gamma and bound (N, 2, m) of the limits |alpha s'' + beta s'^2 + gamma| <= bound on the steps."""
    slope, curvature = grid.slope, grid.curvature
    limit = np.broadcast_to(acceleration[:, None], slope.shape)
    parts = [[slope], [curvature], [np.zeros_like(slope)], [limit]]
    if bounds.constraints:
        q = np.stack([path.at(grid.s[:-1], 0, grid.piece), path.at(grid.s[1:], 0, grid.piece)], axis=1)
        flat = [values.reshape(-1, values.shape[-1]) for values in (q, slope, curvature)]
        square = grid.slowdown[:, None, None] ** 2
        one = np.ones_like(square)
        scales = (square, square, one, one)
        for part, row, scale in zip(parts, constraint_rows(bounds.constraints, *flat), scales, strict=True):
            part.append(row.reshape(len(q), 2, -1) * scale)
    return tuple(np.concatenate(part, axis=2) for part in parts)


def _coarse(step: Array, speed: Array) -> npt.NDArray[np.bool_]:
    """(N,) the steps on both sides of a node at which the jump of s'' loses time.

    If the jump took place up to one step (h seconds) earlier or later, the speed would differ by up to h times the
    jump.
    """
    h = 2.0 * step / np.maximum(speed[:-1] + speed[1:], 1e-30)
    jump = np.abs(np.diff(np.diff(speed) / h))
    short = np.minimum(h[:-1], h[1:])
    with np.errstate(over="ignore", invalid="ignore"):
        loses = jump * short**2 > _MAX_LOSS * h.sum() * np.maximum(speed[1:-1], jump * short)
    return np.concatenate([loses, [False]]) | np.concatenate([[False], loses])


def _least(limit: Array, slope: Array) -> Array:
    """The limit of a derivative of s from joint limits (..., n), if the joints move by ``slope`` (..., n) per s."""
    with np.errstate(divide="ignore", over="ignore"):  # joints that do not move do not limit s
        result: Array = np.minimum((limit / np.abs(slope)).min(axis=-1), _LARGEST)
    return result


def _timing_error(node: int, last: int, ends: tuple[float, float]) -> TimingError:
    """The error if no speed within the limits exists at a node."""
    if node == last and ends[1] > 0.0:
        return TimingError("end_velocity exceeds the limits at the end of the path; reduce it")
    if ends[0] > 0.0 or ends[1] > 0.0:
        return TimingError(
            "start_velocity or end_velocity is not possible within the acceleration limits on this path; reduce it or "
            "use a longer path"
        )
    return TimingError("no timing within the limits was found: the path is not smooth enough; resample it more evenly")
