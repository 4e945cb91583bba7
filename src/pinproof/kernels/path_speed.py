"""The fastest speeds along a path: time-optimal path parametrisation by reachability analysis.

H. Pham, Q.-C. Pham, "A new approach to time-optimal path parameterization based on reachability analysis", IEEE T-RO
34(3), 2018. With x = s'^2 and u = s'' constant between the nodes of a grid, x grows by 2 h u over a step of length h,
and q'' = q'(s) u + q''(s) x is linear in both. The backward pass computes the interval of x at each node from which the
rest of the path is feasible; the forward pass computes the largest u that stays within those intervals. Limits are
imposed at both ends of a step with the u of that step (their "interpolation scheme").

The authors solve a linear program per step. With two variables a simpler method suffices: at a given x every limit
permits an interval of u; the width of their intersection is concave in x, and Newton's method on it converges from
outside to the last feasible x in at most as many iterations as there are limits.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import compiled

__all__ = ["path_speed"]

ROUNDING = 1e-12
"""Relative to x: a Newton step that is at most this has converged."""

FAR = 1e30
"""A bound of u (1/s^2, with s approximately in seconds) beyond all practical values; it keeps quotients finite."""

ROUNDS = 200
"""Maximum number of Newton steps; it exceeds the number of limits on one step."""


@compiled
def path_speed(
    slope: Any, curvature: Any, step: Any, ceiling: Any, acceleration: Any, start: float, end: float, x: Any
) -> int:
    """Find x = s'^2 at every node of a grid, as large as can be.

    Parameters
    ----------
    slope, curvature
        (N, 2, n) dq/ds and d2q/ds2 at both ends of each step; they may differ where two steps meet.
    step
        (N,) lengths of the steps, above 0.
    ceiling
        (N+1,) largest x at the nodes, for the limits of speed; 0 where the motion must stop.
    acceleration
        (N, n) limits of acceleration on the steps.
    start, end
        x at the first node and at the last one.
    x
        (N+1,) filled in.

    Returns
    -------
    int
        -1, or the node from which the path cannot be driven: the last one if ``end`` is above its ceiling, the first
        one if ``start`` cannot be braked to what follows.
    """
    last = step.shape[0]
    if not end <= ceiling[last] * (1.0 + ROUNDING):
        return last
    lowest = x.copy()
    lowest[last] = x[last] = end
    for i in range(last - 1, -1, -1):
        x[i] = _furthest(slope, curvature, step, acceleration, i, ceiling[i], lowest[i + 1], x[i + 1], True)
        if not x[i] >= 0.0:
            return i
        lowest[i] = 0.0
        if lowest[i + 1] > 0.0:
            lowest[i] = _furthest(slope, curvature, step, acceleration, i, 0.0, lowest[i + 1], x[i + 1], False)
            if not lowest[i] <= x[i]:
                return i
    if not lowest[0] * (1.0 - ROUNDING) <= start <= x[0] * (1.0 + ROUNDING):
        return 0
    x[0] = start
    for i in range(last):
        low, high, _, _ = _interval(slope, curvature, step, acceleration, i, x[i], lowest[i + 1], x[i + 1])
        u = high if high >= low else 0.5 * (low + high)
        x[i + 1] = min(max(x[i] + 2.0 * step[i] * u, lowest[i + 1]), x[i + 1])
    return -1


@compiled
def _furthest(
    slope: Any,
    curvature: Any,
    step: Any,
    acceleration: Any,
    i: int,
    x: float,
    least: float,
    most: float,
    down: bool,
) -> float:
    """The first x from the given one ``down`` (or up) at which some u leads to [least, most]; NaN without one."""
    for _ in range(ROUNDS):
        low, high, low_slope, high_slope = _interval(slope, curvature, step, acceleration, i, x, least, most)
        width, tilt = high - low, high_slope - low_slope
        if width >= 0.0:
            return max(x, 0.0)
        if not (tilt < 0.0 if down else tilt > 0.0):  # Farther along, the interval is even smaller.
            return math.nan
        before, x = x, x - width / tilt
        if abs(x - before) <= ROUNDING * abs(before):
            return max(x, 0.0)
    return math.nan


@compiled
def _interval(
    slope: Any, curvature: Any, step: Any, acceleration: Any, i: int, x: float, least: float, most: float
) -> tuple[float, float, float, float]:
    """The interval of u that the limits on step i permit at x, (low, high), and their derivatives in x."""
    twice = 2.0 * step[i]
    low, high, low_slope, high_slope = (least - x) / twice, (most - x) / twice, -1.0 / twice, -1.0 / twice
    for side in range(2):
        for j in range(slope.shape[2]):
            # |p u + r x| <= a at this node; at the next one x has grown by 2 h u.
            r = curvature[i, side, j]
            p = slope[i, side, j] + side * twice * r
            a = acceleration[i, j]
            if abs(p) * FAR <= a:  # This joint does not restrict any practical u.
                if abs(r) * x > a:  # The interval is empty by an amount proportional to the excess of x.
                    low, high, low_slope, high_slope = abs(r) * x, a, abs(r), 0.0
                    return low, high, low_slope, high_slope
                continue
            middle, half = -r * x / p, a / abs(p)
            if middle + half < high:
                high, high_slope = middle + half, -r / p
            if middle - half > low:
                low, low_slope = middle - half, -r / p
    return low, high, low_slope, high_slope
