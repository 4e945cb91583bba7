"""Numbers of a file that can only be meant in another unit: degrees for radians, millimetres for metres.

Only where the number itself proves it: 30 rad may be somebody's limit, but nobody turns a table by 90 rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pinproof.errors import InputError

__all__ = ["MOST_REACH", "refuse_degree_limit", "refuse_degrees", "refuse_millimetres"]

MOST_TURN = 4 * math.pi
"""Rad. An orientation is written within one turn, or two; 15 degrees and more lie beyond."""

DEGREE_LIMITS = (50.0, 720.0)
"""A whole number of radians between these, as the limit of a joint: eight turns and more, or two turns in degrees."""

MOST_REACH = 100.0
"""Metres. What an arm shall reach, or bears, is no farther off."""


def refuse_degrees(name: str, angles: Sequence[float]) -> None:
    """Refuse angles of an orientation beyond two turns.

    Raises
    ------
    InputError
        That says what they would be in radians.
    """
    for angle in angles:
        if abs(angle) > MOST_TURN:
            raise InputError(f"{name}: {angle:g} rad is more than two turns; {_degrees(angle)}")


def refuse_degree_limit(name: str, limit: float | None) -> None:
    """The same for a limit of a turning joint, which may have many turns."""
    if limit is not None and DEGREE_LIMITS[0] < abs(limit) <= DEGREE_LIMITS[1] and limit == round(limit):
        raise InputError(f"{name}: {limit:g} rad is {abs(limit) / math.tau:.0f} turns; {_degrees(limit)}")


def refuse_millimetres(name: str, lengths: Sequence[float]) -> None:
    """Refuse lengths (m) of which one is beyond 100 m, and each 1 m or more, or 0: no arm has such a set of them.

    Raises
    ------
    InputError
        That says what they would be in metres.
    """
    stated = [abs(length) for length in lengths if length]
    if stated and max(stated) > MOST_REACH and min(stated) >= 1.0:
        far = max(stated)
        raise InputError(f"{name}: {far:g} m; lengths are metres, {far:g} millimetres are {far / 1000:g}")


def _degrees(angle: float) -> str:
    return f"angles are radians, {angle:g} degrees are {math.radians(angle):.6g}"
