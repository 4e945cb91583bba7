"""The fastest motion along a straight stretch, in closed form: speed up, cruise, slow down.

On a straight stretch the limits of the joints become limits V, A and J on the derivatives of one number s. With A alone
the motion is a trapezoid of s', or a triangle; with J each ramp is an S of three phases: the acceleration rises for
``edge`` seconds, stays, and falls for as long (L. Biagiotti, C. Melchiorri, "Trajectory Planning for Automatic Machines
and Robots", 2008, sections 3.2 and 3.4).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.motion.clock import NANO, seconds

__all__ = ["SHORTEST_EDGE", "SHORTEST_PHASE", "double_s", "trapezoid"]

Array = npt.NDArray[np.float64]

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
