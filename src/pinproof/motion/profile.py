"""Velocity profiles: the path parameter s over time, in phases of constant jerk, in closed form.

On a straight segment, the joint limits become limits V, A and J of the derivatives of s. Without a jerk limit, the
fastest profile of s' is a trapezoid or a triangle. With a jerk limit, each ramp has three phases (double-S profile):
the acceleration increases linearly, is constant, and decreases linearly (L. Biagiotti, C. Melchiorri, "Trajectory
Planning for Automatic Machines and Robots", 2008, sections 3.2 and 3.4).

If a path is straight between its bends and at both ends, all changes of speed can take place on the straight segments.
In a bend then s'' = 0, so that q'' = q''(s) s'^2 and q''' = q'''(s) s'^3: limits of acceleration and jerk become limits
of s'. A ramp between two speeds takes the least time that A and J permit (section 3.4). If a segment is too short for
the ramp, the larger of the two speeds is reduced.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pinproof.motion.curve import Array
from pinproof.motion.trajectory_files import NANO, seconds

__all__ = ["SHORTEST_EDGE", "SHORTEST_PHASE", "Profile", "connectable_speeds", "double_s", "ramps", "trapezoid"]

_BISECTIONS = 60
"""Number of bisections, after which no double lies between the two ends."""

SHORTEST_PHASE = 1e-5
"""Shortest phase (s); a shorter one is merged with its neighbour. Otherwise rounding could leave phases of nanoseconds,
which amplify the rounding of positions by 6 / h^2 to accelerations above any limit."""

SHORTEST_EDGE = 1e-4
"""Shortest phase (s) with a jerk limit, where the rounding of positions is amplified by 60 / h^3."""


@dataclass(frozen=True, eq=False)
class Profile:
    """A sequence of phases of constant jerk. s, its speed and, with a jerk limit, its acceleration are continuous.

    Attributes
    ----------
    times
        (P+1,) times in seconds at the ends of the phases, beginning with 0.
    s, speed
        (P+1,) values of s and its first derivative at these times.
    acceleration, jerk
        (P,) the second derivative at the beginning of each phase, and the third derivative during the phase.
    """

    times: Array
    s: Array
    speed: Array
    acceleration: Array
    jerk: Array

    @classmethod
    def of_phases(cls, durations: Array, jerk: Array, start: float, speed: float) -> Profile:
        """Phases (P,) of given durations and jerks, from ``start`` with the given speed and no acceleration."""
        acceleration = np.concatenate([[0.0], np.cumsum(jerk * durations)])
        gain = (acceleration[:-1] + 0.5 * jerk * durations) * durations
        speeds = speed + np.concatenate([[0.0], np.cumsum(gain)])
        distance = (speeds[:-1] + (0.5 * acceleration[:-1] + jerk * durations / 6.0) * durations) * durations
        s = start + np.concatenate([[0.0], np.cumsum(distance)])
        return cls(np.concatenate([[0.0], np.cumsum(durations)]), s, speeds, acceleration[:-1], jerk)

    @classmethod
    def join(cls, *parts: Profile) -> Profile:
        """Concatenate profiles."""
        begin = np.cumsum([0.0, *(part.times[-1] for part in parts)])
        return cls(
            np.concatenate([[0.0], *(t + part.times[1:] for t, part in zip(begin[:-1], parts, strict=True))]),
            np.concatenate([parts[0].s[:1], *(part.s[1:] for part in parts)]),
            np.concatenate([parts[0].speed[:1], *(part.speed[1:] for part in parts)]),
            np.concatenate([part.acceleration for part in parts]),
            np.concatenate([part.jerk for part in parts]),
        )

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """The values of s, its speed and its acceleration at times (N,) within the profile."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.jerk) - 1)
        t = times - self.times[i]
        a, j = self.acceleration[i], self.jerk[i]
        s = self.s[i] + (self.speed[i] + (0.5 * a + j * t / 6.0) * t) * t
        speed = self.speed[i] + (a + 0.5 * j * t) * t
        return s.clip(self.s[0], self.s[-1]), np.maximum(speed, 0.0), a + j * t

    def times_at(self, s: Array) -> Array:
        """(N,) the times at which the values s (N,) are reached."""
        i = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.jerk) - 1)
        low, high = np.zeros(len(s)), np.diff(self.times)[i]
        v, a, j, distance = self.speed[i], 0.5 * self.acceleration[i], self.jerk[i] / 6.0, s - self.s[i]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            below = (v + (a + j * middle) * middle) * middle < distance
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return self.times[i] + high

    def smoothed(self, window: float) -> Profile:
        """The moving average of s over ``window`` seconds, which takes ``window`` seconds longer.

        Before and after the profile, the speed is taken to be constant. The acceleration must be constant in each
        phase. It is replaced by its moving average, so that the jerk is at most the jumps of the acceleration divided
        by the window, and neither acceleration nor speed increases. A profile that begins at s_0 with speed v_0 then
        begins at s_0 - v_0 window / 2; its end moves accordingly.
        """
        ends = np.concatenate([self.times, self.times + window])
        ends = np.unique(ends[(ends >= 0.0) & (ends <= self.times[-1] + window)])
        middle = 0.5 * (ends[:-1] + ends[1:])
        jerk = (self._acceleration_at(middle) - self._acceleration_at(middle - window)) / window
        return Profile.of_phases(np.diff(ends), jerk, self.s[0] - 0.5 * window * self.speed[0], float(self.speed[0]))

    def _acceleration_at(self, times: Array) -> Array:
        """(N,) the acceleration at times (N,) in phases without jerk; 0 outside the profile."""
        i = np.searchsorted(self.times, times, side="right") - 1
        inside = (i >= 0) & (i < len(self.acceleration))
        return np.where(inside, self.acceleration[i.clip(0, len(self.acceleration) - 1)], 0.0)


def trapezoid(length: Array, start: Array, end: Array, speed: Array, acceleration: Array) -> tuple[Array, Array]:
    """Trapezoidal profiles: the durations (k, 3) of the phases, 0 for an absent one, and the speeds (k, 4) at the ends.

    ``length`` (k,) is positive; ``start`` and ``end`` are the speeds at both ends. The limits are satisfied except for
    the effect of merging phases shorter than :data:`SHORTEST_PHASE`.
    """
    faster = np.maximum(start, end)
    acceleration = np.maximum(acceleration, np.abs(end - start) * (end + start) / (2.0 * length))  # against rounding
    peak = np.maximum(faster, np.minimum(speed, np.sqrt(acceleration * length + 0.5 * (start**2 + end**2))))
    rise, fall = (peak - start) / acceleration, (peak - end) / acceleration
    cruise = (length - 0.5 * (start + peak) * rise - 0.5 * (peak + end) * fall) / peak
    cruise = np.where(cruise < SHORTEST_PHASE, 0.0, cruise)
    # From rest to rest, a short phase has no longer neighbour to be merged with; its duration is increased.
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
    # The remaining phases are extended so that they cover the length. From rest to rest, the durations are rounded up
    # to nanoseconds and the peak is reduced.
    covered = (0.5 * (speeds[:, :-1] + speeds[:, 1:]) * durations).sum(axis=1)
    durations *= (length / covered)[:, None]
    rounded = _rounded_up(durations)
    reduced = (length / (0.5 * (rounded[:, 0] + rounded[:, 2]) + rounded[:, 1]))[:, None] * [0.0, 1.0, 1.0, 0.0]
    return np.where(at_rest[:, None], rounded, durations), np.where(at_rest[:, None], reduced, speeds)


def double_s(length: Array, speed: Array, acceleration: Array, jerk: Array) -> tuple[Array, Array]:
    """Double-S profiles from rest to rest: the durations (k, 7) of the phases, 0 for an absent one, and the jerk (k,).

    The phases are edge, ramp, edge, cruise, edge, ramp, edge. The signs of the jerk are +, 0, -, 0, -, 0, +.
    """
    # First with a cruise phase, where the peak speed is the limit; else the ramps cover the length.
    edge = np.minimum(np.sqrt(speed / jerk), acceleration / jerk)
    ramp = np.maximum(speed / acceleration - edge, 0.0)
    cruise = length / speed - (2.0 * edge + ramp)
    full = acceleration / jerk  # the edge of a ramp that reaches the acceleration limit
    without = 0.5 * (np.sqrt(full**2 + 4.0 * length / acceleration) - full) - full
    short_edge = np.where(without > 0.0, full, np.cbrt(length / (2.0 * jerk)))
    none = cruise < SHORTEST_EDGE
    edge = np.where(none, short_edge, edge)
    ramp = np.where(none, np.maximum(without, 0.0), ramp) + np.where(none, np.maximum(cruise, 0.0), 0.0)
    cruise = np.where(none, 0.0, cruise)
    # The duration of an omitted ramp is added to the edges. Longer phases reduce peak, acceleration and jerk.
    edge = np.maximum(np.where(ramp < SHORTEST_EDGE, edge + ramp, edge), SHORTEST_EDGE)
    ramp = np.where(ramp < SHORTEST_EDGE, 0.0, ramp)
    edge, ramp, cruise = (_rounded_up(phase) for phase in (edge, ramp, cruise))
    peak = length / (2.0 * edge + ramp + cruise)
    durations = np.stack([edge, ramp, edge, cruise, edge, ramp, edge], axis=1)
    return durations, peak / ((edge + ramp) * edge)


def _rounded_up(durations: Array) -> Array:
    """The durations, rounded up to nanoseconds; a longer duration does not increase any derivative."""
    return seconds(np.ceil(durations * NANO))


def _ramp(change: float, acceleration: float, jerk: float) -> tuple[float, float]:
    """The durations (s) of an edge and of the phase between two edges, for a non-negative change of speed."""
    edge = min(math.sqrt(change / jerk), acceleration / jerk)
    return edge, max(change / acceleration - edge, 0.0)


def _ramp_length(low: float, high: float, acceleration: float, jerk: float) -> float:
    """The length of a ramp between two speeds."""
    edge, middle = _ramp(abs(high - low), acceleration, jerk)
    return 0.5 * (low + high) * (2.0 * edge + middle)


def _reachable_speed(slow: float, limit: float, length: float, acceleration: float, jerk: float) -> float:
    """The largest speed up to ``limit`` that can be reached from ``slow`` within a length."""
    if limit <= slow or _ramp_length(slow, limit, acceleration, jerk) <= length:
        return limit
    low, high = slow, limit
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _ramp_length(slow, middle, acceleration, jerk) <= length else (low, middle)
    return low


def connectable_speeds(speeds: Array, length: Array, acceleration: Array, jerk: Array) -> Array:
    """Reduce the speeds (b,) in bends such that each can be reached from its neighbours.

    Between two bends there is a straight segment with ``length``, ``acceleration`` and ``jerk`` (b-1,). The first and
    the last speed are those at the ends of the path.
    """
    result = speeds.copy()
    for first, second in ((range(len(length)), 1), (range(len(length) - 1, -1, -1), 0)):
        for i in first:
            slow, fast = i + 1 - second, i + second
            result[fast] = _reachable_speed(
                float(result[slow]), float(result[fast]), float(length[i]), float(acceleration[i]), float(jerk[i])
            )
    return result


def ramps(
    begin: float, end: float, speed: float, length: float, acceleration: float, jerk: float
) -> tuple[list[float], list[float]]:
    """The durations and jerks of the seven phases on a straight segment between two speeds without acceleration."""
    low, high = max(begin, end), max(begin, end, speed)
    if _ramp_length(begin, high, acceleration, jerk) + _ramp_length(high, end, acceleration, jerk) > length:
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            needed = _ramp_length(begin, middle, acceleration, jerk) + _ramp_length(middle, end, acceleration, jerk)
            low, high = (middle, high) if needed <= length else (low, middle)
        high = low
    durations, jerks = [], []
    for change, sign in ((high - begin, 1.0), (high - end, -1.0)):
        edge, middle = _ramp(change, acceleration, jerk)
        peak = change / (edge + middle) if change > 0.0 else 0.0
        durations.append([edge, middle, edge])
        jerks.append([sign * peak / edge, 0.0, -sign * peak / edge] if change > 0.0 else [0.0, 0.0, 0.0])
    covered = _ramp_length(begin, high, acceleration, jerk) + _ramp_length(high, end, acceleration, jerk)
    cruise = max(length - covered, 0.0) / high
    return [*durations[0], cruise, *durations[1]], [*jerks[0], 0.0, *jerks[1]]
