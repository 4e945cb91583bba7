"""The limits as a descent meets them: an array (5, n), one row for each name below.

The limits themselves; the limits that stop a descent, infinite for a joint that can make a whole turn (beyond one limit
it goes on a turn away, same pose); and whether the joint is such a one.
"""

from __future__ import annotations

import math

__all__ = ["HIGH", "LOW", "LOWER", "TURN", "TURNING", "UPPER"]

LOWER, UPPER, LOW, HIGH, TURNING = range(5)

TURN = 2 * math.pi
