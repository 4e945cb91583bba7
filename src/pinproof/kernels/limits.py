"""The limits of a descent: an array (5, n) with one row for each name below.

The limits themselves; the limits that stop a descent, which are infinite for a joint with a range of at least 2 pi
(beyond a limit it continues 2 pi away at the same pose); and whether the joint has such a range.
"""

from __future__ import annotations

import math

__all__ = ["HIGH", "LOW", "LOWER", "TURN", "TURNING", "UPPER"]

LOWER, UPPER, LOW, HIGH, TURNING = range(5)

TURN = 2 * math.pi
