"""Where two arms wait on their fixed paths, so that they finish as early as possible without meeting.

A state of the coordination diagram of two arms is a pair of times, one of each arm without its waits. From a state,
both arms advance by a tick, or one waits while the other advances; an arm waits only where its path rests. The path
through the free states that takes the shortest time is found by dynamic programming over the whole diagram, so that a
deadlock cannot occur.

Sources: P. O'Donnell, T. Lozano-Perez (1989), "Deadlock-free and collision-free coordination of two robot
manipulators", ICRA; K. Kant, S. W. Zucker (1986), "Toward efficient trajectory planning: the path-velocity
decomposition", IJRR 5(3).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.spatial import Array

Mask = npt.NDArray[np.bool_]

TICK = 0.05
"""Seconds between two states: the resolution of the waiting times, a small part of a usual motion."""

NEVER = 1e9
"""Ticks: more than any program takes."""

APART = 1e11
"""Offset between the running minima of different runs of free states; above :data:`NEVER`."""


@dataclass(frozen=True)
class Wait:
    """An arm waits for ``duration`` seconds where it rests at ``time`` (s), the time without waiting."""

    time: float
    duration: float


@dataclass(frozen=True, eq=False)
class Progress:
    """The times of one arm, without waiting, at the ticks of its axis.

    Parameters
    ----------
    times
        (N + 1,) seconds; a tick at which the arm may wait has exactly the time of its rest.
    rests
        (N + 1,) whether the arm may wait there. Before its start and after its end it always may.
    """

    times: Array
    rests: Mask

    @classmethod
    def of(cls, duration: float, rests: Iterable[float], *, waits: bool = True) -> Progress:
        """The axis of an arm that may wait at these times (s); if ``waits`` is False, only after its end."""
        count = int(np.ceil(duration / TICK - 1e-9))
        times, marks = np.minimum(np.arange(count + 1) * TICK, duration), np.zeros(count + 1, dtype=bool)
        marks[-1] = True
        if not waits:
            return cls(times, marks)
        marks[0] = True
        for time in rests:
            tick = round(time / TICK)
            if tick <= count and not marks[tick]:
                times[tick], marks[tick] = time, True
        return cls(times, marks)

    def tick(self, time: float) -> int:
        """The tick that is nearest to a time (s)."""
        return min(round(time / TICK), len(self.times) - 1)


def shortest_waits(first: Progress, second: Progress, blocked: Mask) -> tuple[list[Wait], list[Wait]] | None:
    """Where each arm waits in the fastest path from the start of both to the end of both; None if no such path exists.

    Parameters
    ----------
    first, second
        The axes, with M + 1 and N + 1 ticks.
    blocked
        (M + 1, N + 1) the states that must be avoided.
    """
    seconds = _arrival(first.rests, second.rests, blocked)
    if seconds[-1, -1] >= NEVER:
        return None
    i, j = ends = seconds.shape[0] - 1, seconds.shape[1] - 1
    waits: tuple[dict[int, int], dict[int, int]] = ({}, {})
    while i or j:
        before = seconds[i, j] - 1
        both = bool(i and j and seconds[i - 1, j - 1] == before)
        second_waits = bool(i and second.rests[j] and seconds[i - 1, j] == before)
        first_waits = bool(j and first.rests[i] and seconds[i, j - 1] == before)
        # An arm that has finished does not wait: it finishes as early as possible.
        if (second_waits and j == ends[1]) or not (both or first_waits):
            waits[1][j] = waits[1].get(j, 0) + 1
            i -= 1
        elif (first_waits and i == ends[0]) or not both:
            waits[0][i] = waits[0].get(i, 0) + 1
            j -= 1
        else:
            i, j = i - 1, j - 1
    found = []
    for axis, ticks in zip((first, second), waits, strict=True):
        last = len(axis.times) - 1
        found.append([Wait(float(axis.times[k]), ticks[k] * TICK) for k in sorted(ticks) if k < last])
    return found[0], found[1]


def _arrival(first: Mask, second: Mask, blocked: Mask) -> Array:
    """(M + 1, N + 1) the earliest arrival at each state in ticks; :data:`NEVER` where it cannot be reached."""
    rows, columns = blocked.shape
    ticks, steps = np.full((rows, columns), NEVER), np.arange(columns)
    ticks[0, 0] = 0.0
    for i in range(rows):
        row = ticks[i]
        if i:
            row[1:] = ticks[i - 1, :-1] + 1
            np.minimum(row, np.where(second, ticks[i - 1] + 1, NEVER), out=row)
        row[blocked[i]] = NEVER
        if first[i]:  # the first arm waits while the second advances: a running minimum in each run of free states
            run = np.cumsum(blocked[i]) * APART
            waited = np.minimum.accumulate(row - steps - run) + run + steps
            row[:] = np.where(blocked[i], NEVER, waited)
        np.minimum(row, NEVER, out=row)
    return ticks
