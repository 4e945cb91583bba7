"""s over time: how far along its path a motion is, in phases of constant jerk.

The fastest motion along a straight stretch, in closed form: speed up, cruise, slow down.

On a straight stretch the limits of the joints become limits V, A and J on the derivatives of one number s. With A alone
the motion is a trapezoid of s', or a triangle; with J each ramp is an S of three phases: the acceleration rises for
``edge`` seconds, stays, and falls for as long (L. Biagiotti, C. Melchiorri, "Trajectory Planning for Automatic Machines
and Robots", 2008, sections 3.2 and 3.4).

Through bends at an even speed, and from one bend to the next by S-shaped ramps: what a limit of jerk leaves.

Where a path is straight between its bends, and begins and ends straight, all change of speed can be kept to the
straight stretches. In a bend s'' is 0 then, so q'' = q''(s) s'^2 and q''' = q'''(s) s'^3: limits of acceleration and
jerk become limits of s' alone. A ramp between two speeds takes the least time that limits A and J allow (Biagiotti,
Melchiorri 2008, section 3.4), and as a stretch may be too short for it, the faster of two bends gives way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pinproof.motion.curve import Array
from pinproof.motion.trajectory_files import NANO, seconds

__all__ = ["SHORTEST_EDGE", "SHORTEST_PHASE", "Profile", "double_s", "even_speeds", "stretch", "trapezoid"]

_BISECTIONS = 60
"""Halvings of a phase, after which no double lies between its ends."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Phases one after another; s, its speed and (with a jerk limit) its acceleration go on from one to the next.

    Attributes
    ----------
    times
        (P+1,) seconds at the ends of the phases, from 0.
    s, speed
        (P+1,) there.
    acceleration, jerk
        (P,) at the beginning of each phase, and throughout it.
    """

    times: Array
    s: Array
    speed: Array
    acceleration: Array
    jerk: Array

    @classmethod
    def of_phases(cls, durations: Array, jerk: Array, start: float, speed: float) -> Profile:
        """Phases (P,) of given jerk, from ``start`` with a speed and without acceleration."""
        acceleration = np.concatenate([[0.0], np.cumsum(jerk * durations)])
        gain = (acceleration[:-1] + 0.5 * jerk * durations) * durations
        speeds = speed + np.concatenate([[0.0], np.cumsum(gain)])
        way = (speeds[:-1] + (0.5 * acceleration[:-1] + jerk * durations / 6.0) * durations) * durations
        s = start + np.concatenate([[0.0], np.cumsum(way)])
        return cls(np.concatenate([[0.0], np.cumsum(durations)]), s, speeds, acceleration[:-1], jerk)

    @classmethod
    def join(cls, *parts: Profile) -> Profile:
        """The parts one after another."""
        begin = np.cumsum([0.0, *(part.times[-1] for part in parts)])
        return cls(
            np.concatenate([[0.0], *(t + part.times[1:] for t, part in zip(begin[:-1], parts, strict=True))]),
            np.concatenate([parts[0].s[:1], *(part.s[1:] for part in parts)]),
            np.concatenate([parts[0].speed[:1], *(part.speed[1:] for part in parts)]),
            np.concatenate([part.acceleration for part in parts]),
            np.concatenate([part.jerk for part in parts]),
        )

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Find s, its speed and its acceleration at times (N,) within the motion."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.jerk) - 1)
        t = times - self.times[i]
        a, j = self.acceleration[i], self.jerk[i]
        s = self.s[i] + (self.speed[i] + (0.5 * a + j * t / 6.0) * t) * t
        speed = self.speed[i] + (a + 0.5 * j * t) * t
        return s.clip(self.s[0], self.s[-1]), np.maximum(speed, 0.0), a + j * t

    def when(self, s: Array) -> Array:
        """(N,) the times at which s is reached, within the motion."""
        i = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.jerk) - 1)
        low, high = np.zeros(len(s)), np.diff(self.times)[i]
        v, a, j, to_go = self.speed[i], 0.5 * self.acceleration[i], self.jerk[i] / 6.0, s - self.s[i]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            below = (v + (a + j * middle) * middle) * middle < to_go
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return self.times[i] + high

    def smoothed(self, window: float) -> Profile:
        """The mean of s over the last ``window`` seconds, which takes ``window`` seconds longer.

        Before and after the motion s goes on with the speed it has there. The acceleration, which must be constant in
        each phase, becomes its own mean over the window: it changes by no more than its jumps over the window, and
        neither it nor the speed becomes larger. What begins at s_0 with speed v_0 is made to begin v_0 window / 2
        earlier, and to end as much later.
        """
        ends = np.concatenate([self.times, self.times + window])
        ends = np.unique(ends[(ends >= 0.0) & (ends <= self.times[-1] + window)])
        middle = 0.5 * (ends[:-1] + ends[1:])
        jerk = (self._acceleration_at(middle) - self._acceleration_at(middle - window)) / window
        result = Profile.of_phases(np.diff(ends), jerk, self.s[0] - 0.5 * window * self.speed[0], float(self.speed[0]))
        return result

    def _acceleration_at(self, times: Array) -> Array:
        """(N,) the acceleration in phases without jerk; 0 outside the motion."""
        i = np.searchsorted(self.times, times, side="right") - 1
        inside = (i >= 0) & (i < len(self.acceleration))
        return np.where(inside, self.acceleration[i.clip(0, len(self.acceleration) - 1)], 0.0)


SHORTEST_PHASE = 1e-5
"""Seconds below which a phase is joined to its neighbour: phases of nanoseconds, left over by rounding, would magnify
the rounding of positions (by 6 / h^2) into accelerations beyond any limit."""

SHORTEST_EDGE = 1e-4
"""The same where jerk counts, which magnifies the rounding of positions by 60 / h^3."""


def trapezoid(length: Array, start: Array, end: Array, speed: Array, acceleration: Array) -> tuple[Array, Array]:
    """Durations (k, 3) of the phases, 0 where there is none, and speeds (k, 4) at their ends.

    ``length`` (k,) is above 0, ``start`` and ``end`` are speeds at both ends; the limits hold, but for the little that
    phases shorter than :data:`SHORTEST_PHASE` make a difference.
    """
    faster = np.maximum(start, end)
    acceleration = np.maximum(acceleration, np.abs(end - start) * (end + start) / (2.0 * length))  # against rounding
    peak = np.maximum(faster, np.minimum(speed, np.sqrt(acceleration * length + 0.5 * (start**2 + end**2))))
    rise, fall = (peak - start) / acceleration, (peak - end) / acceleration
    cruise = (length - 0.5 * (start + peak) * rise - 0.5 * (peak + end) * fall) / peak
    cruise = np.where(cruise < SHORTEST_PHASE, 0.0, cruise)
    # from rest to rest nothing can be joined to a neighbour that is as short: such a hop takes its time
    at_rest = faster == 0.0
    peak = np.where(at_rest & (cruise == 0.0), np.minimum(peak, length / SHORTEST_PHASE), peak)
    rise, fall = (np.where(at_rest, np.maximum(ramp, SHORTEST_PHASE), ramp) for ramp in (rise, fall))
    no_rise, no_fall = rise < SHORTEST_PHASE, fall < SHORTEST_PHASE
    one_phase = no_rise & no_fall & (cruise == 0.0)
    first, second = np.where(no_rise, start, peak), np.where(no_fall, end, peak)
    one_ramp = (cruise == 0.0) & ~one_phase
    first, second = np.where(one_ramp & no_fall, end, first), np.where(one_ramp & no_rise, start, second)
    durations = np.stack(
        [np.where(no_rise, 0.0, rise), np.where(one_phase, 1.0, cruise), np.where(no_fall, 0.0, fall)], axis=1
    )
    speeds = np.stack([start, first, second, end], axis=1)
    # what was left out is made up for by the others, which all take a little longer; from rest to rest in whole
    # nanoseconds, at a lower peak
    covered = (0.5 * (speeds[:, :-1] + speeds[:, 1:]) * durations).sum(axis=1)
    durations *= (length / covered)[:, None]
    whole = _rounded_up(durations)
    even = (length / (0.5 * (whole[:, 0] + whole[:, 2]) + whole[:, 1]))[:, None] * [0.0, 1.0, 1.0, 0.0]
    return np.where(at_rest[:, None], whole, durations), np.where(at_rest[:, None], even, speeds)


def double_s(length: Array, speed: Array, acceleration: Array, jerk: Array) -> tuple[Array, Array]:
    """Durations (k, 7) of the phases from rest to rest, 0 where there is none, and the jerk (k,) of the edges.

    The phases are edge, ramp, edge, cruise, edge, ramp, edge; the jerk is up, 0, down, 0, down, 0, up.
    """
    # as if there were a cruise: the peak is the limit; else the ramps alone cover the length
    edge = np.minimum(np.sqrt(speed / jerk), acceleration / jerk)
    ramp = np.maximum(speed / acceleration - edge, 0.0)
    cruise = length / speed - (2.0 * edge + ramp)
    full = acceleration / jerk  # the edge of a ramp that reaches the limit of acceleration
    without = 0.5 * (np.sqrt(full**2 + 4.0 * length / acceleration) - full) - full
    short_edge = np.where(without > 0.0, full, np.cbrt(length / (2.0 * jerk)))
    none = cruise < SHORTEST_EDGE
    edge = np.where(none, short_edge, edge)
    ramp = np.where(none, np.maximum(without, 0.0), ramp) + np.where(none, np.maximum(cruise, 0.0), 0.0)
    cruise = np.where(none, 0.0, cruise)
    # a ramp given up goes to the edges: the longer any of them, the lower peak, accelerations and jerk
    edge = np.maximum(np.where(ramp < SHORTEST_EDGE, edge + ramp, edge), SHORTEST_EDGE)
    ramp = np.where(ramp < SHORTEST_EDGE, 0.0, ramp)
    edge, ramp, cruise = (_rounded_up(phase) for phase in (edge, ramp, cruise))
    peak = length / (2.0 * edge + ramp + cruise)
    durations = np.stack([edge, ramp, edge, cruise, edge, ramp, edge], axis=1)
    return durations, peak / ((edge + ramp) * edge)


def _rounded_up(durations: Array) -> Array:
    """In whole nanoseconds: whatever is longer is slower."""
    return seconds(np.ceil(durations * NANO))


def _ramp(change: float, acceleration: float, jerk: float) -> tuple[float, float]:
    """Seconds of an edge and of the phase between two, for a change of speed of at least 0."""
    edge = min(math.sqrt(change / jerk), acceleration / jerk)
    return edge, max(change / acceleration - edge, 0.0)


def _way(low: float, high: float, acceleration: float, jerk: float) -> float:
    """How far a ramp between two speeds goes."""
    edge, middle = _ramp(abs(high - low), acceleration, jerk)
    return 0.5 * (low + high) * (2.0 * edge + middle)


def _fastest(slow: float, most: float, length: float, acceleration: float, jerk: float) -> float:
    """The largest speed up to ``most`` that is reached from ``slow`` within a length."""
    if most <= slow or _way(slow, most, acceleration, jerk) <= length:
        return most
    low, high = slow, most
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _way(slow, middle, acceleration, jerk) <= length else (low, middle)
    return low


def even_speeds(speeds: Array, length: Array, acceleration: Array, jerk: Array) -> Array:
    """(b,) what is left of speeds (b,) in bends, so that each can be reached from its neighbours.

    Between two of them lies a straight stretch: ``length``, ``acceleration`` and ``jerk`` (b-1,). The first and the
    last are those at the ends of the path.
    """
    result = speeds.copy()
    for first, second in ((range(len(length)), 1), (range(len(length) - 1, -1, -1), 0)):
        for i in first:
            slow, fast = i + 1 - second, i + second
            result[fast] = _fastest(
                float(result[slow]), float(result[fast]), float(length[i]), float(acceleration[i]), float(jerk[i])
            )
    return result


def stretch(
    begin: float, end: float, speed: float, length: float, acceleration: float, jerk: float
) -> tuple[list[float], list[float]]:
    """Durations and jerks of the seven phases along a straight stretch, between speeds without acceleration."""
    low, high = max(begin, end), max(begin, end, speed)
    if _way(begin, high, acceleration, jerk) + _way(high, end, acceleration, jerk) > length:
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            fits = _way(begin, middle, acceleration, jerk) + _way(middle, end, acceleration, jerk) <= length
            low, high = (middle, high) if fits else (low, middle)
        high = low
    durations, jerks = [], []
    for change, sign in ((high - begin, 1.0), (high - end, -1.0)):
        edge, middle = _ramp(change, acceleration, jerk)
        peak = change / (edge + middle) if change > 0.0 else 0.0
        durations.append([edge, middle, edge])
        jerks.append([sign * peak / edge, 0.0, -sign * peak / edge] if change > 0.0 else [0.0, 0.0, 0.0])
    covered = _way(begin, high, acceleration, jerk) + _way(high, end, acceleration, jerk)
    cruise = max(length - covered, 0.0) / high
    return [*durations[0], cruise, *durations[1]], [*jerks[0], 0.0, *jerks[1]]
