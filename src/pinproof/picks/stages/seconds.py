"""Times that motions take at least: no joint is faster than its limit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm

__all__ = ["TURN", "at_full_speed", "least_seconds"]

Array = npt.NDArray[np.float64]

TURN = 2 * np.pi


def at_full_speed(arm: Arm, points: Array) -> float:
    """Seconds from each of some points (k, n) to the next at full speed, corners without a stop.

    Of the control points of a curve it is a bound of what the curve takes at full speed, and never less than
    :func:`least_seconds` from end to end.
    """
    return float((np.abs(np.diff(points, axis=0)) / arm.limits.velocity).max(axis=1, initial=0.0).sum())


def least_seconds(arm: Arm, here: Array, there: Array) -> Array:
    """(k, m) seconds from each of (k, n) to each of (m, n), or to any whole turn of it, that no motion undercuts."""
    way = np.abs(here[:, None, :] - there[None, :, :])
    nearest = np.abs(way - TURN * np.round(way / TURN))
    return np.asarray((np.where(arm.periodic, nearest, way) / arm.limits.velocity).max(axis=2))
