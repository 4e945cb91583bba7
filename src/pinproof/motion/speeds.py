"""A path made ready to be timed: pieces, where it must stop, which pieces are straight, and its derivatives.

How fast a path can be run through: from limits of the joints to s over time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof.errors import TimingError
from pinproof.motion import bezier
from pinproof.motion.curve import Array, Curve
from pinproof.motion.joint_path import JointPath
from pinproof.motion.limits import Bounds
from pinproof.motion.profile import Profile, double_s, even_speeds, stretch, trapezoid

__all__ = ["ON_LINE_TOLERANCE", "Drive", "Grid", "PreparedPath", "drive"]

ON_LINE_TOLERANCE = 1e-13
"""How far (relative to a joint's largest coordinate, at least 1 rad or m) a point may lie off a straight line to count
as on it: a few roundings, so that the image does not change."""

SAME_TANGENT = 1e-6
"""Relative to the faster of two pieces: derivatives that differ by less where they meet are equal; else the motion
stops between them, where the path does not name its corners itself."""

MOST_STEPS_A_PIECE = 64
"""Steps at first; where they do not do, they are cut."""

FEWEST_STEPS = 8
"""Steps at least on the bent pieces together: on a single one, at rest at both ends, nothing would move."""


UNEVEN = 8.0
"""Times what an even speed would make of it: how far curves are off paths that are run through at changing speeds."""


class PreparedPath:
    """The pieces of a path over s, a parameter that runs about as the seconds will.

    Attributes
    ----------
    knots
        (k+1,) s at the ends of the pieces.
    straight
        (k,) whether a piece is a straight line run through evenly: s'' moves it as a straight line moves.
    stops
        (k+1,) whether the motion must stop at a knot; its ends are not among them.
    run
        (k,) how many stops lie before a piece.
    coasts
        (k,) whether between the stops around it, or the ends, the path begins and ends with a straight piece.
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
        even = control[:, :1] * (1.0 - share) + control[:, -1:] * share
        near = ON_LINE_TOLERANCE * np.maximum(1.0, np.abs(control).max(axis=(0, 1)))
        self.straight: npt.NDArray[np.bool_] = (np.abs(control - even) <= near).all(axis=(1, 2))
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
        self.coasts: npt.NDArray[np.bool_] = np.repeat(self.straight[starts] & self.straight[ends - 1], ends - starts)

    def piece_of(self, s: Array) -> npt.NDArray[np.intp]:
        """(N,) the piece on which s lies; of two that meet there, the one behind."""
        return np.clip(np.searchsorted(self.knots, s, side="right") - 1, 0, len(self.straight) - 1)

    def at(self, s: Array, order: int = 0, piece: npt.NDArray[np.intp] | None = None) -> Array:
        """(N, n) the path or its derivative by s; on the pieces told, which are taken at their ends beyond them."""
        piece = self.piece_of(s) if piece is None else piece
        u = ((s - self.knots[piece]) / (self.knots[piece + 1] - self.knots[piece])).clip(0.0, 1.0)
        return bezier.on_pieces(self.control[order], piece, u)

    def curvature(self, s: Array) -> Array:
        """(N, n) the second derivative by s; at a knot the mean of both sides, which are equal on a C2 path."""
        before = np.clip(np.searchsorted(self.knots, s, side="left") - 1, 0, len(self.straight) - 1)
        return 0.5 * (self.at(s, 2) + self.at(s, 2, before))

    def in_steps(self, tolerance: float) -> tuple[Array, npt.NDArray[np.intp]]:
        """A first grid (N+1,) over s, and the piece (N,) each step lies on.

        A straight piece is one step. A bent one gets as many as let cubic Hermite pieces follow it at an even speed:
        they miss a function by h^4 / 384 times its fourth derivative (P. J. Davis, "Interpolation and Approximation",
        1975, section 3.5).
        """
        fourth = np.abs(bezier.derivative(self.knots, self.control[3])).max(axis=(1, 2))
        missed = UNEVEN * fourth * np.diff(self.knots) ** 4 / 384.0
        count = np.ceil((missed / tolerance) ** 0.25).clip(2, MOST_STEPS_A_PIECE).astype(int)
        bent = int(np.count_nonzero(~self.straight))
        count = np.where(self.straight, 1, np.maximum(count, math.ceil(FEWEST_STEPS / max(bent, 1))))
        return cut(self.knots, count), np.repeat(np.arange(len(count)), count)


def cut(grid: Array, parts: npt.NDArray[np.int_]) -> Array:
    """The grid with each step cut into equal parts."""
    begin = np.cumsum(parts) - parts
    share = (np.arange(int(parts.sum())) - np.repeat(begin, parts)) / np.repeat(parts, parts)
    left, right = np.repeat(grid[:-1], parts), np.repeat(grid[1:], parts)
    return np.concatenate([left * (1.0 - share) + right * share, grid[-1:]])


def _corners(q: Array) -> Array:
    """The waypoints where the motion must stop: repeated ones and those on a straight run are left out."""
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


_LARGEST = 1e150
"""What limits of s are cut off at: hairlines, and joints that rest, do not bound it."""

_BEND_SHARE = 0.4
"""Of the limit of jerk: what bends may take of it where speed changes within them, which takes the rest."""

_LOSS = 4e-3
"""Of the whole time: what a step may lose, by an estimate that is eight times too high, before it is to be cut."""

_HARD = 0.2
"""Relative to the largest jerk: where it jumps by more, a point is written."""

_EDGES = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
"""The sign of the jerk in the phases of a double S."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Steps over s between which s'' is constant, at first; a straight piece is a single one.

    Attributes
    ----------
    s
        (N+1,) the nodes.
    piece
        (N,) on which piece of the track a step lies.
    tight
        (N,) by what factor each step is to be slower than its limits allow.
    slope, curvature
        (N, 2, n) the path's derivatives by s at both ends of each step.
    """

    s: Array
    piece: npt.NDArray[np.intp]
    tight: Array
    slope: Array
    curvature: Array

    @classmethod
    def of(cls, track: PreparedPath, s: Array, piece: npt.NDArray[np.intp], tight: Array) -> Grid:
        """A grid of these steps on a track."""
        slope, curvature = (
            np.stack([track.at(s[:-1], order, piece), track.at(s[1:], order, piece)], axis=1) for order in (1, 2)
        )
        curvature[track.straight[piece]] = 0.0
        return cls(s, piece, tight, slope, curvature)

    def refined(self, track: PreparedPath, parts: npt.NDArray[np.int_]) -> Grid:
        """Each step cut into equal parts."""
        return Grid.of(track, cut(self.s, parts), np.repeat(self.piece, parts), np.repeat(self.tight, parts))

    def tightened(self, factor: Array | float) -> Grid:
        """Each step slower by a factor."""
        return replace(self, tight=self.tight * factor)

    def between(self, track: PreparedPath, begin: float, end: float) -> Grid:
        """The part between two values of s."""
        first, behind = np.searchsorted(self.s, begin, side="right"), np.searchsorted(self.s, end, side="left")
        s = np.concatenate([[begin], self.s[first:behind], [end]])
        return Grid.of(track, s, self.piece[first - 1 : behind], self.tight[first - 1 : behind])

    def step_of(self, s: Array) -> npt.NDArray[np.intp]:
        """(N,) the step on which s lies."""
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.piece) - 1)


@dataclass(frozen=True, eq=False)
class Drive:
    """s over time, and which of its phases are taken over as they are.

    Attributes
    ----------
    profile
        s over time.
    rests
        (R,) the times of its ends and stops, each the end of a phase of ``profile``.
    marks
        (M,) the times at which the motion is to be written down, the rests among them.
    coarse
        (N,) the steps that would better be finer: s'' changes somewhere in them.
    """

    profile: Profile
    rests: Array
    marks: Array
    coarse: npt.NDArray[np.bool_]


def drive(track: PreparedPath, grid: Grid, bounds: Bounds, ends: tuple[float, float], window: Array | None) -> Drive:
    """The fastest motion along the track that the grid can tell.

    Parameters
    ----------
    track, grid, bounds
        The path, the steps to think in, and the limits.
    ends
        s' at the beginning and at the end.
    window
        None where jerk does not count. Else (N, 2), alike on all steps between two stops: the seconds over which the
        acceleration changes, and the share of what it may change by in them that it may be: the fastest motion with
        accelerations of at most jerk * window * share is averaged over the window.

    Raises
    ------
    TimingError
        If speeds at the ends cannot be reached or left.
    """
    whole = grid
    if window is not None:
        grid, window = _shortened(track, grid, ends, window)
    phases = _Phases(track, grid, bounds, ends, window)
    coarse = np.zeros(len(whole.piece), dtype=bool)
    coarse[whole.step_of(0.5 * (grid.s[:-1] + grid.s[1:]))] = phases.coarse
    if window is None:
        profile = phases.profile(slice(0, len(grid.piece)))
        return Drive(profile, profile.times[phases.rests], profile.times, coarse)
    parts, marks, rests = [], [], [0.0]
    for first, behind in pairwise(phases.stops.tolist()):
        steps = slice(first, behind)
        coasts = bool(track.coasts[grid.piece[first]])
        if coasts and not phases.exact[first]:
            phases.coast(steps)
        part = phases.profile(steps)
        marked = part.times
        if not coasts:
            part = part.smoothed(float(window[first, 0]))
            hard = np.abs(np.diff(part.jerk)) > _HARD * np.abs(part.jerk).max()
            nodes = grid.s[first + 1 : behind]
            marked = np.concatenate([part.times[[0, -1]], part.times[1:-1][hard], part.when(nodes[nodes < part.s[-1]])])
        marks.append(rests[-1] + marked)
        parts.append(part)
        rests.append(rests[-1] + part.times[-1])
    profile = Profile.join(*parts)
    return Drive(profile, np.array(rests), np.unique(np.concatenate(marks)), coarse)


def _shortened(track: PreparedPath, grid: Grid, ends: tuple[float, float], window: Array) -> tuple[Grid, Array]:
    """The grid without what averaging adds at the ends: half a window at the speed there."""
    begin, end = (
        knot + 0.5 * window[i, 0] * speed * (not track.coasts[i]) * (1 + 2 * i)
        for i, knot, speed in ((0, track.knots[0], ends[0]), (-1, track.knots[-1], ends[1]))
    )
    if not begin < end:
        raise TimingError("the path is too short for the velocities at its ends; give it a longer way, or rest")
    if begin == track.knots[0] and end == track.knots[-1]:
        return grid, window
    first, behind = np.searchsorted(grid.s, begin, side="right") - 1, np.searchsorted(grid.s, end, side="left")
    return grid.between(track, float(begin), float(end)), window[first:behind]


class _Phases:
    """Up to seven phases a step: one on bent steps, the closed forms on straight ones."""

    def __init__(
        self, track: PreparedPath, grid: Grid, bounds: Bounds, ends: tuple[float, float], window: Array | None
    ) -> None:
        from pinproof.kernels.path_speed import path_speed

        s, piece, step = grid.s, grid.piece, np.diff(grid.s)
        bent = ~track.straight[piece]
        slope, curvature = grid.slope, grid.curvature
        velocity = bounds.velocity / grid.tight[:, None]
        acceleration = bounds.acceleration / grid.tight[:, None] ** 2
        jerk = None if bounds.jerk is None else bounds.jerk / grid.tight[:, None] ** 3
        if jerk is not None and window is not None:
            soft = np.minimum(acceleration, jerk * window.prod(axis=1, keepdims=True))
            soft = np.where(track.coasts[piece, None], acceleration, soft)
        else:
            soft = acceleration
        fastest = _least(velocity[:, None], slope)
        self._bent = bent
        if jerk is not None:
            third = np.stack([track.at(s[:-1], 3, piece), track.at(s[1:], 3, piece)], axis=1)
            third[~bent] = 0.0
            self._straight_limits = [_least(limit, slope[:, 0]) for limit in (velocity, acceleration, jerk)]
            sharpest = np.sqrt(_least(acceleration[:, None], curvature)), np.cbrt(_least(jerk[:, None], third))
            self._even = np.minimum(fastest, np.minimum(*sharpest)).min(axis=1)
            fastest = np.minimum(fastest, np.cbrt(_BEND_SHARE * _least(jerk[:, None], third)))
        ceiling = np.full(len(s), np.inf)
        np.minimum(ceiling[:-1], fastest[:, 0] ** 2, out=ceiling[:-1])
        np.minimum(ceiling[1:], fastest[:, 1] ** 2, out=ceiling[1:])
        stop = np.isin(s, track.knots[track.stops])
        ceiling[stop] = 0.0
        ceiling[[0, -1]] = np.square(ends)
        x = np.empty(len(s))
        stuck = path_speed(slope, curvature, step, ceiling, soft, ceiling[0], ceiling[-1], x)
        if stuck >= 0:
            raise _stuck(stuck, len(step), ends)
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
            raise TimingError("the path stands still within a bend; resample it more evenly")
        if len(flat):
            limit_s = fastest[flat].min(axis=1)
            self._trapezoids(flat, step[flat], begin[flat], end[flat], limit_s, _least(soft, slope[:, 0])[flat])
        self.exact = np.zeros(len(step), dtype=bool)
        if jerk is not None:
            self.exact = ~bent & (begin == 0.0) & (end == 0.0)
            rows = np.flatnonzero(self.exact)
            limits = [_least(limit, slope[:, 0])[rows] for limit in (velocity, acceleration, jerk)]
            if len(rows):
                self._double_s(rows, step[rows], *limits)

    def coast(self, steps: slice) -> None:
        """Let a run that is straight at both ends go at an even speed through its bends."""
        bent = self._bent[steps]
        straight = steps.start + np.flatnonzero(~bent)
        bounds = np.flatnonzero(np.diff(straight) > 1)  # a bend lies behind each of these
        blocks = np.split(straight, bounds + 1)
        even = [float(self._speed[steps.start])]
        for before, behind in pairwise(blocks):
            even.append(float(self._even[before[-1] + 1 : behind[0]].min()))
        even.append(float(self._speed[steps.stop]))
        steps_of = np.diff(self._s)
        limits = self._straight_limits
        stretches = [(float(steps_of[b].sum()), *(float(limit[b].min()) for limit in limits)) for b in blocks]
        lengths, _, accelerations, jerks = (np.array(column) for column in zip(*stretches, strict=True))
        speeds = even_speeds(np.array(even), lengths, accelerations, jerks)
        if speeds[0] < even[0] or speeds[-1] < even[-1]:
            raise _stuck(0, 1, (even[0], even[-1]))
        for i, block in enumerate(blocks):
            length, speed, acceleration, jerk = stretches[i]
            durations, edges = stretch(float(speeds[i]), float(speeds[i + 1]), speed, length, acceleration, jerk)
            self._durations[block] = 0.0  # all phases stand with the first step of a stretch
            self._durations[block[0]], self._jerk[block[0]] = durations, edges
            gained = np.cumsum(self._jerk[block[0]] * self._durations[block[0]])
            self._acceleration[block[0], 0], self._acceleration[block[0], 1:] = 0.0, gained[:-1]
            self._speed[block[0] + 1 : block[-1] + 1] = speeds[i + 1]
            if i + 1 < len(blocks):
                bend = slice(int(block[-1]) + 1, int(blocks[i + 1][0]))
                self._speed[bend.start : bend.stop + 1] = speeds[i + 1]
                self._durations[bend], self._acceleration[bend] = 0.0, 0.0
                self._durations[bend, 0] = steps_of[bend] / speeds[i + 1]

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
        """Which ends of phases of the whole profile are its ends and stops."""
        count = np.count_nonzero(self._durations > 0.0, axis=1)
        result: npt.NDArray[np.intp] = np.concatenate([[0], np.cumsum(count)])[self.stops]
        return result

    def profile(self, steps: slice) -> Profile:
        """The motion on some steps, one after another; each begins at its node, whatever rounding did before."""
        t, a, j = self._durations[steps], self._acceleration[steps], self._jerk[steps]
        gain, way = (a + 0.5 * j * t) * t, (0.5 * a + j * t / 6.0) * t * t
        nodes, speeds = self._s[steps.start : steps.stop + 1], self._speed[steps.start : steps.stop + 1]
        speed = speeds[:-1, None] + np.cumsum(gain, axis=1) - gain
        way += speed * t
        s = nodes[:-1, None] + np.cumsum(way, axis=1) - way
        keep = t > 0.0
        return Profile(
            np.concatenate([[0.0], np.cumsum(t[keep])]),
            np.concatenate([s[keep], nodes[-1:]]),
            np.concatenate([speed[keep], speeds[-1:]]),
            a[keep],
            j[keep],
        )


def _coarse(step: Array, speed: Array) -> npt.NDArray[np.bool_]:
    """(N,) the steps on both sides of a node at which s'' jumps by so much that time is lost.

    Had the jump come up to a step of h seconds earlier or later, speeds would differ by up to h times the jump there.
    """
    h = 2.0 * step / np.maximum(speed[:-1] + speed[1:], 1e-30)
    jump = np.abs(np.diff(np.diff(speed) / h))
    short = np.minimum(h[:-1], h[1:])
    with np.errstate(over="ignore", invalid="ignore"):
        loses = jump * short**2 > _LOSS * h.sum() * np.maximum(speed[1:-1], jump * short)
    return np.concatenate([loses, [False]]) | np.concatenate([[False], loses])


def _least(limit: Array, slope: Array) -> Array:
    """What limits (..., n) of the joints leave of a derivative of s, where joints move by ``slope`` (..., n) with s."""
    with np.errstate(divide="ignore", over="ignore"):  # joints that rest do not bound s
        result: Array = np.minimum((limit / np.abs(slope)).min(axis=-1), _LARGEST)
    return result


def _stuck(node: int, last: int, ends: tuple[float, float]) -> TimingError:
    if node == last and ends[1] > 0.0:
        return TimingError("the velocity at the end is above what the limits allow there; lower it")
    if ends[0] > 0.0 or ends[1] > 0.0:
        return TimingError(
            "the velocity at the start cannot be led over to what follows, or that at the end not be reached, within "
            "the acceleration limits; lower it, or give it a longer way"
        )
    return TimingError("no timing within the limits was found; the path is not smooth enough: resample it more evenly")
