"""Time in whole nanoseconds, as trajectory messages count it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["LONGEST", "NANO", "seconds", "whole_nanoseconds"]

Array = npt.NDArray[np.float64]

NANO = 1_000_000_000
"""Nanoseconds in a second."""

LONGEST = 2.0**50 / NANO
"""Seconds (13 days) up to which ``whole_nanoseconds(seconds(k)) == k``: k / NANO and its product with NANO are each off
by half a unit of a 53-bit mantissa at most, together less than half a nanosecond."""


def whole_nanoseconds(times: Array) -> npt.NDArray[np.int64]:
    """The nearest count of nanoseconds to each time in seconds."""
    return np.rint(times * NANO).astype(np.int64)


def seconds(nanoseconds: npt.NDArray[np.int64] | Array) -> Array:
    """The double nearest to each count of nanoseconds, in seconds."""
    result: Array = nanoseconds / NANO
    return result
