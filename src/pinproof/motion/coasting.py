"""Through bends at an even speed, and from one bend to the next by S-shaped ramps: what a limit of jerk leaves.

Where a path is straight between its bends, and begins and ends straight, all change of speed can be kept to the
straight stretches. In a bend s'' is 0 then, so q'' = q''(s) s'^2 and q''' = q'''(s) s'^3: limits of acceleration and
jerk become limits of s' alone. A ramp between two speeds takes the least time that limits A and J allow (Biagiotti,
Melchiorri 2008, section 3.4), and as a stretch may be too short for it, the faster of two bends gives way.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

__all__ = ["even_speeds", "stretch"]

Array = npt.NDArray[np.float64]

_BISECTIONS = 60


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
