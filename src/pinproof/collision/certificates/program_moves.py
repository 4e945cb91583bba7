"""The moves of a program: few proven joint moves, with zones with which the controller needs little time."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinproof.collision.certificates.certify import is_proven_free
from pinproof.collision.certificates.linear_traces import trace_line
from pinproof.collision.certificates.program_parts import SAME_END, blend_cover, zone_side
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.model import Arm
from pinproof.motion import (
    Blend,
    ControllerMotion,
    ControllerMove,
    Curve,
    Dialect,
    JointMove,
    JointPath,
    LinearMove,
    Profile,
    Step,
    TimedCurve,
    controller_motion,
    fastest,
    fewest_moves,
    stop_times,
    with_corners,
)
from pinproof.spatial import Array

SAMPLES = (25, 97)
"""Numbers of points of a motion among which the ends of joint moves are chosen."""

COVERED = 4e-4
"""rad: what moves are proven with beside the deviation, because joint values are rounded and linear moves traced."""

TRIED, SAVED = 48, 1e-3
"""Number of changes of moves whose zones are proven, and seconds that one must save."""

NEAR = 8
"""Number of points that are compared for each corner."""

MOVED, WIDEST, LEAST_WIDTH = 16, 0.1, 0.006
"""Number of random changes of corners, and the largest and smallest of their standard deviations (rad)."""

EACH_TIME = 6
"""Number of changes, of those that would save most time with the largest zones, whose zones are proven."""

FOR_MOVE = 0.01
"""Seconds that another move must save."""

TANGENTS = (0.25, 0.5, 1.0, 2.0)
"""Points on the tangent of the end of a linear move, in lengths of this move."""

DIVIDED = 1.04
"""Duration of moves, in that which is enough, above which joint moves are divided."""

FEW_MOVES = 12
"""Number of points of joint moves without linear ones up to which they are divided."""

NEAR_ENDS = (0.4, 0.2, 0.1, 0.05)
"""Shares of a joint move at its ends at which it is divided, so that zones that are shares of moves are smaller."""

ON_LINE = 0.004
"""rad: by how much a motion may be off the joint values of a linear move that replaces it."""


def zone_proven(
    blend: Blend, arm: Arm, into: JointPath, out: JointPath, proven: Callable[[JointPath, Array], bool]
) -> bool:
    """Return whether a blend between two moves uses at most half of each, and is proven."""
    sides = (zone_side(arm, into, at_end=True), zone_side(arm, out, at_end=False))
    if max(side.shares(blend)[0] for side in sides) > 0.5:
        return False
    return all(proven(*part) for part in blend_cover(blend, arm, into, out))


def timed_step(
    arm: Arm, move: ControllerMove, profile: Profile, blend: Blend | None, *, linear: bool
) -> JointMove | LinearMove:
    """Return the step of a move with its duration and its speed, of which a language states what it can."""
    q = move.path.end
    if not linear:
        percent = round(100 * profile.peak / fastest(move.path, arm.limits).peak)
        # Slower for a reason: no joint is faster at this share of the velocities
        if move.duration is not None or move.top is not None:
            velocity = np.where(np.isnan(arm.limits.velocity), np.inf, arm.limits.velocity)
            top = (velocity / np.maximum(np.abs(q - move.path.start), 1e-12)).min()
            percent = int(100 * profile.peak / top + 1e-6)
        percent, usual = min(max(percent, 1), 100), fastest(move.path, arm.limits).gains
        gain = None if move.gain is None else max(int(100 * move.gain / usual.max() + 1e-6), 1)
        if move.top is None or move.duration is not None:
            return JointMove(q, profile.duration, blend, percent=percent, gain=gain)
        travel = float(np.abs(q - move.path.start).max())
        speed, ramp = profile.peak * travel, float(usual.min()) * travel
        return JointMove(q, None, blend, speed=speed, percent=percent, acceleration=ramp, gain=gain)
    first, last = (arm.forward_kinematics(end) for end in (move.path.start, q))
    length = float(np.linalg.norm(last.translation - first.translation))
    duration = profile.duration if move.top is None or move.duration is not None else None
    # The least acceleration between zones, or the usual one, at which no joint exceeds its own on any part of the line
    as_usual = duration is None and move.gain is None
    gains = fastest(move.path, arm.limits, alike=move.alike).gains if as_usual else profile.gains
    slope = np.abs(np.diff(move.path.q, axis=0)).max(axis=0) * (len(move.path.q) - 1)
    most = np.where(np.isnan(arm.limits.acceleration), np.inf, arm.limits.acceleration)
    least = min(gains.min(initial=np.inf), (most / np.maximum(slope, 1e-12)).min())
    acceleration = length * least if np.isfinite(least) else None
    return LinearMove(q, last, duration, speed=profile.peak * length, blend=blend, acceleration=acceleration)


class BlendedMoves(NamedTuple):
    """Moves from a stop to the next one by the rules of the controller, with the blend at the end of each."""

    motion: ControllerMotion
    blends: tuple[Blend | None, ...]


class EndLine(NamedTuple):
    """A linear move next to joint moves, and the share of it that a zone may use."""

    path: JointPath
    passed: float


class _Choice(NamedTuple):
    """The numbers of the linear moves before and after joint moves, and the points of these moves."""

    leaving: int
    entering: int
    points: tuple[tuple[float, ...], ...]


class _MovesSearch:
    """Moves from a stop to the next one, of which lines, zones and durations are computed once."""

    def __init__(
        self,
        arm: Arm,
        language: Dialect,
        proven: Callable[[JointPath, Array], bool],
        lines: tuple[Sequence[EndLine], Sequence[EndLine]],
        spare: int,
    ) -> None:
        self._arm, self._language, self._proven = arm, language, proven
        self._zones, self._common = language.zones, language.common_zone
        self._leaving, self._entering = lines
        # Points with which a pick has at most 12 moves, from home to the grasp, to the release, and back
        self.most = (2 + bool(lines[0]) + bool(lines[1]) if any(lines) else FEW_MOVES) + spare
        self._paths = dict[tuple[bytes, bytes], JointPath]()
        self._known = dict[JointPath, bool]()
        self._sides = dict[tuple[JointPath, bool], list[tuple[float, float]]]()
        self._corners = dict[tuple[JointPath, JointPath, bool], int]()

    def _path(self, one: Array, other: Array) -> JointPath:
        """The path of a joint move, which is the same one each time."""
        key = (one.tobytes(), other.tobytes())
        if key not in self._paths:
            self._paths[key] = JointPath(np.stack([one, other]), self._arm.joint_names)
        return self._paths[key]

    def line_proven(self, one: Array, other: Array) -> bool:
        """Whether a joint move is proven."""
        path = self._path(one, other)
        if path not in self._known:
            self._known[path] = self._proven(path, np.zeros(self._arm.dof))
        return self._known[path]

    def lines_proven(self, choice: _Choice) -> bool:
        """Whether all joint moves of a choice are proven."""
        return all(self.line_proven(*pair) for pair in pairwise(np.array(choice.points)))

    def _shares(self, path: JointPath, *, at_end: bool) -> list[tuple[float, float]]:
        """The shares of a move from one of its ends that each zone there may use, and does."""
        if (path, at_end) not in self._sides:
            move = zone_side(self._arm, path, at_end=at_end)
            self._sides[path, at_end] = [move.shares(blend) for blend in self._zones]
        return self._sides[path, at_end]

    def _zone(self, into: JointPath, out: JointPath, allowed: tuple[float, float], *, proven: bool) -> int:
        """The number of the largest zone that uses at most the allowed shares, and is proven if asked.

        A smaller zone is covered where a larger one is, so that few of them are proven.
        """
        key = (into, out, proven)
        if key not in self._corners:
            pairs = list(zip(self._shares(into, at_end=True), self._shares(out, at_end=False), strict=True))
            numbers = [
                k for k, shares in enumerate(pairs) if all(s[0] <= a for s, a in zip(shares, allowed, strict=True))
            ]
            first = bisect_left(
                numbers,
                True,
                key=lambda k: (
                    not proven
                    or all(
                        self._proven(*part)  # those with the largest tolerances fail first
                        for part in sorted(
                            blend_cover(self._zones[k], self._arm, into, out), key=lambda part: -float(part[1].max())
                        )
                    )
                ),
            )
            self._corners[key] = numbers[first] if first < len(numbers) else len(self._zones)
        return self._corners[key]

    def made(self, choice: _Choice, *, proven: bool = True) -> BlendedMoves | None:
        """The moves of a choice with their largest zones; None if a move is not proven."""
        points = np.array(choice.points)
        if proven and not self.lines_proven(choice):
            return None
        paths = [self._path(*pair) for pair in pairwise(points)]
        shares = [0.5] * len(paths)
        for number, side, at in ((choice.leaving, self._leaving, 0), (choice.entering, self._entering, len(paths) + 1)):
            if side:
                paths.insert(at, side[number].path)
                shares.insert(at, side[number].passed)
        corners = list(pairwise(paths))
        found = [self._zone(*pair, most, proven=proven) for pair, most in zip(corners, pairwise(shares), strict=True)]
        # All zones are as large as the smallest one where the language has one size, or some points are stops
        sizes = sorted({number for number in found if number < len(self._zones)}) if self._common else [0]
        best: BlendedMoves | None = None
        for size in sizes or [0]:
            used = [
                max(number, size) if not self._common else size if number <= size else len(self._zones)
                for number in found
            ]
            blends = [None if number == len(self._zones) else self._zones[number] for number in used]
            ends = [
                None
                if number == len(self._zones)
                else (self._shares(into, at_end=True)[number][1], self._shares(out, at_end=False)[number][1])
                for (into, out), number in zip(corners, used, strict=True)
            ]
            alike, zones = self._language.alike, [*ends, None]
            moves = [ControllerMove(path, None, zone, alike=alike) for path, zone in zip(paths, zones, strict=True)]
            motion = controller_motion(moves, self._arm.limits, optional=True, roughly=not proven)
            kept = (blend if move.zone else None for move, blend in zip(motion.moves, [*blends, None], strict=True))
            if best is None or motion.duration < best.motion.duration:
                best = BlendedMoves(motion, tuple(kept))
        return best

    def changed(self, choice: _Choice, points: Array) -> Iterator[_Choice]:
        """Choices that differ in a linear move, or in one point."""
        limits, inner = self._arm.limits, choice.points
        for k in range(max(len(self._leaving), 1)):
            for m in range(max(len(self._entering), 1)):
                yield self.with_lines(choice, k, m)
        tangent = np.concatenate(self.tangents(choice))
        points, tangents = np.concatenate([points, tangent]), len(tangent)
        most = 1 + bool(self._leaving) + bool(self._entering)
        for k in range(1, len(inner)):
            ends = [np.array(inner[k - 1]), np.array(inner[k])]
            if k < len(inner) - 1:  # another corner, or none
                yield choice._replace(points=(*inner[:k], *inner[k + 1 :]))
                ends[1] = np.array(inner[k + 1])
            elif len(inner) > most + 1:
                continue
            replaced = inner[k + 1 :] if k < len(inner) - 1 else inner[k:]
            (into, ramp), (out, other) = (stop_times(end, points, limits) for end in ends)
            nearest = np.argsort(into + out - np.minimum(ramp, other))[:NEAR].tolist()
            nearest += range(len(points) - tangents, len(points))
            for number in dict.fromkeys(nearest):
                yield choice._replace(points=(*inner[:k], tuple(points[number].tolist()), *replaced))
            if k < len(inner) - 1 and len(inner) <= most + 1:  # one more corner before this one
                for number in range(len(points) - tangents, len(points)):
                    yield choice._replace(points=(*inner[:k], tuple(points[number].tolist()), *inner[k:]))

    def divided(self, choice: _Choice, blends: Sequence[Blend | None]) -> Iterator[_Choice]:
        """Choices in which a joint move is divided before or behind a stop, because the zones are shares of moves.

        Only half of the longest line is in such a zone.
        """
        for base in dict.fromkeys((choice, self.with_lines(choice, 0, 0))):
            points = [np.array(point) for point in base.points]
            for corner in (k for k, blend in enumerate(blends[:-1]) if blend is None):
                end = corner + 1 - bool(self._leaving)  # the number of the point at which the arm stops
                for share in NEAR_ENDS:
                    for before, behind in ((True, False), (False, True), (True, True)):
                        rows = list(points)
                        if behind and end + 1 < len(points):
                            rows.insert(end + 1, points[end] + share * (points[end + 1] - points[end]))
                        if before and end > 0:
                            rows.insert(end, points[end] + share * (points[end - 1] - points[end]))
                        yield base._replace(points=tuple(tuple(row.tolist()) for row in rows))

    def moved(self, choice: _Choice, width: float, rng: np.random.Generator) -> Iterator[_Choice]:
        """Choices with other corners, by random changes (rad) of some joints."""
        inner, limits = np.array(choice.points[1:-1]), self._arm.limits
        for _ in range(MOVED if len(inner) else 0):
            changed = inner + width * rng.normal(size=inner.shape) * (rng.random(inner.shape) < 0.5)
            rows = np.clip(changed, limits.lower, limits.upper).tolist()
            yield choice._replace(points=(choice.points[0], *map(tuple, rows), choice.points[-1]))

    def with_lines(self, choice: _Choice, leaving: int, entering: int) -> _Choice:
        """The choice with other linear moves, at whose ends the joint moves begin and end."""
        points = list(choice.points)
        if self._leaving:
            points[0] = tuple(self._leaving[leaving].path.end.tolist())
        if self._entering:
            points[-1] = tuple(self._entering[entering].path.start.tolist())
        return _Choice(leaving, entering, tuple(points))

    def tangents(self, choice: _Choice) -> tuple[Array, Array]:
        """Points on the tangents of the linear moves at the ends of the joint moves, if there are any."""
        rows, limits = [np.zeros((0, self._arm.dof))] * 2, self._arm.limits
        for k, (lines, number) in enumerate(((self._leaving, choice.leaving), (self._entering, choice.entering))):
            if lines:
                q = lines[number].path.reversed().q if k else lines[number].path.q
                far = q[-1] + np.array(TANGENTS)[:, None] * (len(q) - 1) * (q[-1] - q[-2])
                rows[k] = np.clip(far, limits.lower, limits.upper)
        return rows[0], rows[1]

    def first(self, points: Array) -> _Choice | None:
        """The fastest proven joint moves with stops between the first pair of linear moves for which there are any."""
        for m in range(max(len(self._entering), 1)):
            for k in range(max(len(self._leaving), 1)):
                choice = self.with_lines(_Choice(k, m, tuple(map(tuple, points.tolist()))), k, m)
                rows = np.array(choice.points)
                order = fewest_moves(rows, self._arm.limits, self.line_proven)
                if order is not None:
                    return choice._replace(points=tuple(choice.points[number] for number in order))
        return None


def blended_moves(
    points: Array,
    arm: Arm,
    language: Dialect,
    proven: Callable[[JointPath, Array], bool],
    *,
    lines: tuple[Sequence[EndLine], Sequence[EndLine]] = ((), ()),
    enough: float = 0.0,
    spare: int = 0,
) -> BlendedMoves | None:
    """Return few joint moves through some of the points (k, n), with the largest zones between them, all proven.

    The moves may begin with one of ``lines[0]`` and end with one of ``lines[1]``, in place of the first and of the last
    point. None if no moves are proven. The fastest moves with stops are changed until they take at most ``enough``
    seconds, or no change that is compared saves time: other lines, other corners, more or fewer of them. ``spare`` is
    the number of moves that may be added beside the usual ones, which the moves before have not used.
    """
    if len(points) <= SAMPLES[0]:
        points = with_corners(points, arm.limits)
    search = _MovesSearch(arm, language, proven, lines, spare)
    choice = search.first(points)
    best = None if choice is None else search.made(choice)
    if choice is None or best is None:
        return None

    def cost(moves: BlendedMoves) -> float:
        return moves.motion.duration + FOR_MOVE * len(moves.blends)

    rng, left, width, seen = np.random.default_rng(0), TRIED, WIDEST, {choice}
    least = dict[_Choice, float]()  # with the largest zones; infinite if a line is not proven
    # Other lines, corners and tangents of lines; then small changes of the corners
    while left > 0 and best.motion.duration > enough:
        fresh = [each for each in dict.fromkeys(search.changed(choice, points)) if each not in seen]
        fresh += search.moved(choice, width, rng)
        for each in fresh:
            if each not in least:
                moves = search.made(each, proven=False) if search.lines_proven(each) else None
                least[each] = math.inf if moves is None else cost(moves)
        width /= 2.0
        faster = [each for each in sorted(fresh, key=least.__getitem__) if least[each] < cost(best) - SAVED]
        for each in faster[:EACH_TIME]:
            seen.add(each)
            moves = search.made(each)
            left -= 1
            if moves is not None and cost(moves) < cost(best) - SAVED:
                best, choice, width = moves, each, min(4.0 * width, WIDEST)
                break
        if width < LEAST_WIDTH:
            break
    better: tuple[BlendedMoves, _Choice] | None = (best, choice)
    while language.zones[0].radius is None and better and best.motion.duration > DIVIDED * enough:
        few = (each for each in dict.fromkeys(search.divided(choice, best.blends)) if len(each.points) <= search.most)
        made = [(search.made(each), each) for each in few]
        options = [(moves, each) for moves, each in made if moves is not None and cost(moves) < cost(best) - SAVED]
        better = min(options, key=lambda option: cost(option[0]), default=None)
        best, choice = better or (best, choice)
    return best


def moves_between_rests(
    curve: Curve, checker: CollisionChecker, deviation: float, language: Dialect, *, linear: bool
) -> list[Step]:
    """Return the moves from each rest of a curve to the next one, after a move to its start.

    Without a proof they lead through samples of the curve.
    """
    arm = checker.arm
    # Samples of the curve, and the parts of it from rest to rest
    if isinstance(curve, JointPath):
        points, rests, times = curve.q, [0, len(curve.q) - 1], np.zeros(len(curve.q))
    else:
        knots = curve.bezier()[0]
        times = np.unique(np.concatenate([knots, np.linspace(knots[0], knots[-1], 4 * SAMPLES[-1])]))
        points = np.asarray(curve(times))
        still = np.zeros(len(times), dtype=bool)
        if isinstance(curve, TimedCurve):
            still = ~np.abs(curve.velocity(times)).max(axis=1).astype(bool)
        rests = sorted({0, *np.flatnonzero(still).tolist(), len(times) - 1})
    steps = list[Step]([JointMove(points[0])])
    times = times if isinstance(curve, TimedCurve) else np.zeros(len(times))

    def proven(path: JointPath, tolerance: Array) -> bool:
        return is_proven_free(path, checker, joint_tolerance=tolerance + deviation + COVERED)

    for first, last in pairwise(rests):
        part = points[first : last + 1]
        if not np.ptp(part, axis=0).any():
            continue
        # A linear move, if the tcp moves on a straight line
        trace = trace_line(arm, part[0], arm.forward_kinematics(part[-1])) if linear else None
        on_line = trace is not None and not trace.reason and np.abs(trace.path.end - part[-1]).max() <= SAME_END
        if on_line and trace and all(np.abs(trace.path.q - q).max(axis=1).min() <= ON_LINE for q in part):
            motion = controller_motion([ControllerMove(trace.path, alike=language.alike)], arm.limits)
            slower = max(motion.duration, float(times[last] - times[first]))
            profile = motion.profiles[0].lasting(slower)
            steps.append(timed_step(arm, motion.moves[0], profile, None, linear=True))
            continue
        # Or the fastest joint moves; where none are proven, those through samples of the curve
        best: BlendedMoves | None = None
        for count in SAMPLES:
            inner = part[np.unique(np.linspace(0, len(part) - 1, min(count, len(part))).round().astype(int))]
            best = best or blended_moves(inner, arm, language, proven, enough=float(times[last] - times[first]))
        if best is None:
            few = [JointPath(pair, arm.joint_names) for pair in pairwise(inner[:: len(inner) // SAMPLES[0] + 1])]
            few.append(JointPath([few[-1].end, inner[-1]], arm.joint_names))
            stopping = [ControllerMove(path) for path in few if np.ptp(path.q, axis=0).any()]
            best = BlendedMoves(controller_motion(stopping, arm.limits), (None,) * len(stopping))
        # No faster than the curve, which may be slow for a reason
        slower = max(1.0, float(times[last] - times[first]) / best.motion.duration)
        for move, profile, blend in zip(best.motion.moves, best.motion.profiles, best.blends, strict=True):
            duration = slower * profile.duration
            stated = replace(move, duration=duration) if slower > 1.0 else move
            steps.append(timed_step(arm, stated, profile.lasting(duration), blend, linear=False))
    return steps
