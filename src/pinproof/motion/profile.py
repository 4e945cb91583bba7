"""s over time: how far along its path a motion is, in phases of constant jerk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinproof.motion.curve import Array

__all__ = ["Profile"]

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
