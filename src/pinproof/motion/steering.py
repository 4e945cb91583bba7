"""Time-optimal moves between states (position, velocity, acceleration), and motions that consist of them.

Each joint moves from state to state in the shortest common time of all joints, within the limits of velocity,
acceleration and jerk. The moves are computed by ruckig (L. Berscheid, T. Kroeger, "Jerk-limited real-time trajectory
generation with arbitrary target states", RSS 2021): its profiles are cubic in phases of constant jerk, or parabolic
without a jerk limit.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from itertools import accumulate
from typing import Any, Protocol

import numpy as np

from pinproof._core import EdgeChecker, RateLimits, StaggeredMove, StaggeredSearch
from pinproof.common.validation import optional_module
from pinproof.motion.limits import POSITION_TOLERANCE, Bounds
from pinproof.motion.trajectory import Trajectory
from pinproof.motion.trajectory_files import NANO, seconds
from pinproof.spatial import Array

State = tuple[list[float], list[float], list[float]]
"""Positions, velocities and accelerations of all joints. Lists, because ruckig converts them faster than arrays."""

# Share of the rates of a state that is used: the rates at the limits differ from them by rounding.
STATE_SHARE = 1.0 - 1e-11
# Share of the jerk limits that is left for the rounding of times to nanoseconds and of positions, which a quintic
# between two points amplifies by 60 / h^3.
JERK_SLACK = 1e-4
# Share of the velocity and acceleration limits that is left for rounding. A state that exceeds the rest is clipped.
RATE_SLACK = 1e-6
# Share of the velocity limits that is left if the motion begins in motion, so that it cannot be slowed down.
MOVING_SLACK = 1e-4
# Shortest time (s) between two points of a trajectory. Phases that end closer to each other share a point.
SHORTEST_STEP = 5e-5


def rest(q: Iterable[float]) -> State:
    """The state at a configuration, at rest."""
    positions = [float(value) for value in q]
    zeros = [0.0] * len(positions)
    return positions, zeros, zeros


class _Source(Protocol):
    """A motion that can be evaluated: a trajectory of ruckig or :class:`_TimedMove`."""

    duration: float

    def at_time(self, time: float) -> State:
        """The state at a time (s) from 0 to the duration."""


class _TimedMove:
    """A trajectory of this package as the source of a move."""

    def __init__(self, trajectory: Trajectory, bounds: Bounds) -> None:
        self.duration, self.times = trajectory.duration, trajectory.times
        rates = np.stack([np.full_like(bounds.velocity, np.inf), bounds.velocity, bounds.acceleration])
        self._most = rates * (1.0 - 2.0 * RATE_SLACK)
        self._begins = self.times[:-1].tolist()
        points = trajectory.bezier()[1]
        degree = points.shape[1] - 1
        # Coefficients of powers of u in [0, 1]: the r-th differences of the control points, times C(degree, r).
        powers = [math.comb(degree, r) * np.diff(points, r, axis=1)[:, 0] for r in range(degree + 1)]
        self._powers = np.stack(powers, axis=1)
        self._widths = np.diff(trajectory.bezier()[0])
        self._exponents = np.arange(degree + 1)

    def at_time(self, time: float) -> State:
        k = min(max(bisect_right(self._begins, time) - 1, 0), len(self._widths) - 1)
        width = float(self._widths[k])
        u = min(max((time - self._begins[k]) / width, 0.0), 1.0)
        r = self._exponents
        power = u ** np.maximum(r, 0)
        speed = r * u ** np.maximum(r - 1, 0) / width
        acceleration = r * (r - 1) * u ** np.maximum(r - 2, 0) / width**2
        state = np.stack([power, speed, acceleration]) @ self._powers[k]
        q, v, a = state.clip(-self._most, self._most).tolist()
        return q, v, a


class Move:
    """The part from ``start`` to ``end`` (s) of a source."""

    __slots__ = ("end", "source", "start")

    def __init__(self, source: Any, start: float = 0.0, end: float | None = None) -> None:
        self.source: _Source = source
        self.start = start
        self.end: float = source.duration if end is None else end

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return self.end - self.start

    def state(self, time: float) -> State:
        """The state after ``time`` (s)."""
        return self.source.at_time(min(self.start + max(time, 0.0), self.end))

    def states(self, step: float) -> list[State]:
        """The states at equal times, at most ``step`` (s) apart, after the start up to and including the end."""
        count = max(math.ceil(self.duration / step), 1)
        share, start, end, at_time = self.duration / count, self.start, self.end, self.source.at_time
        return [at_time(min(start + share * i, end)) for i in range(1, count + 1)]

    def phase_ends(self) -> Array:
        """The times (s) after the start, within the move, at which a phase of a joint ends."""
        if isinstance(self.source, _TimedMove):
            ends = self.source.times
        elif isinstance(self.source, StaggeredMove):
            ends = self.source.phase_ends()
        else:
            # Each joint may begin with phases that bring it into its limits.
            profiles = self.source.profiles[0]  # type: ignore[attr-defined]
            ends = np.array([end for p in profiles for end in accumulate((*p.brake.t, *p.t, *p.accel.t))])
        ends = ends[(ends > self.start) & (ends < self.end)]
        return np.asarray(ends - self.start)


class Steering:
    """Moves between states within limits.

    Parameters
    ----------
    bounds
        The limits; without a jerk limit, the acceleration of the moves jumps.
    share
        The share of the acceleration and jerk limits that moves use, one number or (n,).
    moving
        A state from which moves may begin although its rates exceed this share: their first phase brings it inside.
    """

    def __init__(self, bounds: Bounds, share: float | Array = 1.0, *, moving: State | None = None) -> None:
        ruckig = optional_module("ruckig", "the optimisation of a motion")
        n = len(bounds.velocity)
        self._ruckig, self._input, self._new, self._n = ruckig.Ruckig(n), ruckig.InputParameter(n), ruckig.Trajectory, n
        self._good, self._error = (ruckig.Result.Working, ruckig.Result.Finished), ruckig.RuckigError
        self._smooth, self._moving = bounds.jerk is not None, moving
        self._modes = (
            (ruckig.ControlInterface.Velocity, ruckig.Synchronization.No),
            (ruckig.ControlInterface.Position, ruckig.Synchronization.Time),
        )
        jerk = np.full(n, np.inf) if bounds.jerk is None else bounds.jerk * share * (1.0 - JERK_SLACK)
        self._limits = {
            "max_velocity": bounds.velocity * (1.0 - (RATE_SLACK if moving is None else MOVING_SLACK)),
            "max_acceleration": bounds.acceleration * share * (1.0 - RATE_SLACK),
            "max_jerk": jerk,
        }
        self._set_limits()
        self._lower, self._upper = bounds.lower.tolist(), bounds.upper.tolist()

    def _set_limits(self) -> None:
        for key, limit in self._limits.items():
            setattr(self._input, key, limit.tolist())

    def straight(self, first: Sequence[float], last: Sequence[float], share: float = 1.0) -> Move | None:
        """The fastest move from rest to rest on the straight line between two different configurations.

        ``share`` is the share of the acceleration limits that it uses.
        """
        distance = np.abs(np.subtract(last, first))
        moving = distance > 0.0
        for key, limit in self._limits.items():  # in proportion to the distances, every joint has the same profile
            along = limit * (share if key == "max_acceleration" else 1.0)
            along[moving] = distance[moving] * (along[moving] / distance[moving]).min()
            setattr(self._input, key, along.tolist())
        move = self.move(rest(first), rest(last))
        self._set_limits()
        return move

    def staggered(self, edges: EdgeChecker, start: Array, goals: Array, sample_time: float) -> StaggeredSearch:
        """A search for moves from rest to rest at one of the goals (g, n) whose joints choose when they move."""
        ends, box = (np.ascontiguousarray(start), np.ascontiguousarray(goals)), np.array([self._lower, self._upper])
        velocity, acceleration, jerk = self._limits.values()
        limits = RateLimits(velocity, acceleration, jerk if self._smooth else np.empty(0))
        return StaggeredSearch(edges, *ends, box, limits, sample_time)

    def gentler(self, first: State, last: State, velocity: Array, above: Array, below: Array) -> Move | None:
        """The fastest move with at most these velocities, and these accelerations (n,) in either direction.

        The rates of the states themselves are permitted.
        """
        given, most = self._input, self._limits
        needed = np.array([first[1:], last[1:]])
        speed = np.abs(needed[:, 0]).max(axis=0)
        given.max_velocity = np.minimum(np.maximum(velocity, speed), most["max_velocity"]).tolist()
        hardest = most["max_acceleration"]
        given.max_acceleration = np.minimum(np.maximum(above, needed[:, 1].max(axis=0)), hardest).tolist()
        given.min_acceleration = (-np.minimum(np.maximum(below, -needed[:, 1].min(axis=0)), hardest)).tolist()
        move = self.move(first, last)
        given.min_acceleration = None
        self._set_limits()
        return move

    def move(self, first: State, last: State) -> Move | None:
        """The fastest move from one state to another; None if the limits of the rates permit no move."""
        given = self._input
        given.current_position, given.current_velocity, given.current_acceleration = _inside_rates(first)
        given.target_position, given.target_velocity, given.target_acceleration = _inside_rates(last)
        if not self._smooth:  # the acceleration may jump, and states of the input have any
            given.current_acceleration = given.target_acceleration = [0.0] * self._n
        profiles = self._new(self._n)
        try:
            # Otherwise a move may begin with a phase that exceeds the limits, in order to slow down.
            self._ruckig.validate_input(given, check_current_state_within_limits=first is not self._moving)
            result = self._ruckig.calculate(given, profiles)
        except self._error:  # a state that is beyond the limits, or cannot be left within them
            return None
        return Move(profiles) if result in self._good else None

    def stop(self, first: State) -> Move | None:
        """The move from a state to rest in which each joint stops as soon as possible, wherever that is."""
        given, (to_rest, to_state) = self._input, self._modes
        given.control_interface, given.synchronization = to_rest
        move = self.move(first, rest(first[0]))
        given.control_interface, given.synchronization = to_state
        return move

    def inside(self, move: Move) -> bool:
        """Whether a complete move stays within the position limits."""
        extremes = move.source.position_extrema  # type: ignore[attr-defined]
        return all(
            extreme.min >= low - POSITION_TOLERANCE and extreme.max <= high + POSITION_TOLERANCE
            for extreme, low, high in zip(extremes, self._lower, self._upper, strict=True)
        )


def _inside_rates(state: State) -> State:
    """A state whose rates are inside the limits if they exceed them by rounding, which ruckig refuses."""
    q, velocity, acceleration = state
    return q, [STATE_SHARE * rate for rate in velocity], [STATE_SHARE * rate for rate in acceleration]


class MoveSequence:
    """Moves, each of which begins at the state in which the previous one ends."""

    def __init__(self, moves: Iterable[Move]) -> None:
        self.moves = tuple(moves)
        self.times = [0.0]
        for move in self.moves:
            self.times.append(self.times[-1] + move.duration)
        self.duration = self.times[-1]
        self._begins = self.times[:-1]

    @classmethod
    def of(cls, trajectory: Trajectory, bounds: Bounds) -> MoveSequence:
        """The sequence that consists of a trajectory."""
        return cls([Move(_TimedMove(trajectory, bounds))])

    def state(self, time: float) -> State:
        """The state at a time (s) from 0 to the duration."""
        k = bisect_right(self._begins, time) - 1 if time > 0.0 else 0
        move = self.moves[k]
        return move.source.at_time(min(move.start + max(time - self._begins[k], 0.0), move.end))

    def replaced(self, start: float, end: float, moves: Iterable[Move]) -> MoveSequence:
        """The sequence with other moves from ``start`` to ``end`` (s), which connect the states there."""
        before, after = [], []
        for move, first, last in zip(self.moves, self.times[:-1], self.times[1:], strict=True):
            if first < start:
                before.append(Move(move.source, move.start, min(move.end, move.start + start - first)))
            if last > end:
                after.append(Move(move.source, max(move.start, move.start + end - first), move.end))
        return MoveSequence([*before, *moves, *after])

    def trajectory(
        self, joint_names: tuple[str, ...], note: str, start: State, end: State, *, smooth: bool
    ) -> Trajectory:
        """The motion from one state to another, as a trajectory with points at the ends of all phases.

        It is quintic if ``smooth``, else cubic. Between two ends of phases, the motion is a polynomial of this degree,
        up to the rounding of times to nanoseconds, and phases shorter than :data:`SHORTEST_STEP`, which share a point.
        There the jerk (the acceleration of a cubic) between two points is its mean, and the deviation that this causes
        is removed by a polynomial over the whole motion.
        """
        ends = [start + move.phase_ends() for move, start in zip(self.moves, self.times[:-1], strict=True)]
        inner = np.sort(np.concatenate([*ends, np.array(self.times[1:-1])]))
        last = math.ceil(self.duration * NANO)
        shortest = round(SHORTEST_STEP * NANO)
        clock = [0]
        for time in np.rint(inner * NANO).astype(np.int64).tolist():
            if time - clock[-1] >= shortest and last - time >= shortest:
                clock.append(time)
        clock.append(max(last, 1))
        times = seconds(np.array(clock))
        states = np.array([self.state(min(time, self.duration)) for time in times.tolist()])
        states[0], states[-1] = start, end  # without the rounding of the moves
        middles = 0.5 * (times[1:] + times[:-1])
        sources = [self.moves[bisect_right(self._begins, time) - 1].source for time in middles.tolist()]
        exact = np.array([isinstance(source, _TimedMove) for source in sources])
        q, velocity, acceleration = states.swapaxes(0, 1)
        if smooth:
            _smooth_steps(times, q, velocity, acceleration, exact)
        else:
            _parabolic_steps(times, q, velocity, exact)
        return Trajectory(times, q, velocity, joint_names, note, accelerations=acceleration if smooth else None)


def _smooth_steps(times: Array, q: Array, velocity: Array, acceleration: Array, exact: Any) -> None:
    """Change positions and velocities (m, n) such that the jerk is constant in each step that is not ``exact`` (m-1,).

    The accelerations are kept. The changes at the end are removed by the quintic with these values at the end, and with
    zero acceleration there and zero position, velocity and acceleration at the start.
    """
    h = np.diff(times)[:, None]
    before, after = acceleration[:-1], acceleration[1:]
    missing_velocity = 0.5 * h * (before + after) - np.diff(velocity, axis=0)
    missing_distance = h * velocity[:-1] + h * h * (2.0 * before + after) / 6.0 - np.diff(q, axis=0)
    missing_velocity[exact], missing_distance[exact] = 0.0, 0.0
    velocity_change = _sums(missing_velocity)
    position_change = _sums(missing_distance + h * velocity_change[:-1])
    total = times[-1]
    u = (times / total)[:, None]
    for quintic, at_end in (
        ((10.0, -15.0, 6.0), position_change[-1].copy()),
        ((-4.0, 7.0, -3.0), total * velocity_change[-1]),
    ):
        c3, c4, c5 = quintic
        position_change -= at_end * (u**3 * (c3 + u * (c4 + u * c5)))
        velocity_change -= at_end / total * (u**2 * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))
        acceleration -= at_end / total**2 * (u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5)))
    position_change[-1], velocity_change[-1] = 0.0, 0.0  # without rounding
    q += position_change
    velocity += velocity_change


def _parabolic_steps(times: Array, q: Array, velocity: Array, exact: Any) -> None:
    """Change positions (m, n) such that the acceleration is constant in each step that is not ``exact`` (m-1,).

    The velocities are kept. The change at the end is removed by the cubic with this value there, and at rest otherwise.
    """
    h = np.diff(times)[:, None]
    missing_distance = 0.5 * h * (velocity[:-1] + velocity[1:]) - np.diff(q, axis=0)
    missing_distance[exact] = 0.0
    position_change = _sums(missing_distance)
    total, at_end = times[-1], position_change[-1].copy()
    u = (times / total)[:, None]
    position_change -= at_end * (u * u * (3.0 - 2.0 * u))
    position_change[-1] = 0.0
    q += position_change
    velocity -= at_end / total * (6.0 * u * (1.0 - u))


def _sums(steps: Array) -> Array:
    """(m, n) the sums of the steps (m-1, n) before each point."""
    return np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
