"""Detecting numbers in the wrong unit: degrees instead of radians, millimetres instead of metres.

Such numbers are errors where the number itself leaves no doubt, and in input files: 30 rad may be a joint limit, but an
orientation of 90 rad is always a mistake. Elsewhere they are reported as a :class:`pinproof.errors.UnitWarning`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence

from pinproof.errors import InputError, UnitWarning

__all__ = [
    "ANGLE_UNITS",
    "FAR",
    "LENGTH_UNITS",
    "MOST_MARGIN",
    "MOST_REACH",
    "MOST_TURN",
    "far_hint",
    "hint_at_unit",
    "parse_angle",
    "refuse_degree_limit",
    "refuse_degrees",
    "refuse_millimetres",
    "warn_of_degrees",
    "warn_of_millimetres",
]

MOST_TURN = 4 * math.pi
"""Rad. Angles of an orientation are within two full rotations; 13 degrees and more exceed this."""

DEGREE_LIMITS = (50.0, 720.0)
"""An integer joint limit between these values is assumed to be in degrees: in radians it is 8 rotations or more."""

MOST_REACH = 100.0
"""Metres. Longer distances on an arm or in its workspace are assumed to be in millimetres."""


FAR = 10.0
"""Sizes of a robot. A target or a mesh that is farther away or larger is assumed to be in millimetres."""


ANGLE_UNITS = {"deg": math.radians(1.0), "rad": 1.0}
"""Units of angles in texts, in radians."""


LENGTH_UNITS = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Units of lengths in files of other programs, in metres."""


def parse_angle(text: str) -> float:
    """Parse ``5 deg`` or ``0.1 rad``, or a number in radians, and return radians; ValueError for other texts."""
    words = text.split()
    if len(words) == 1:  # the unit may follow the number without a space
        number = text.strip()
        unit = next((each for each in ANGLE_UNITS if number.endswith(each)), "")
        words = [number.removesuffix(unit), *([unit] if unit else [])]
    try:
        value = float(words[0])
        factor = ANGLE_UNITS[words[1]] if len(words) == 2 else 1.0
    except (ValueError, KeyError, IndexError):
        value = math.nan
    if len(words) > 2 or not math.isfinite(value):
        raise ValueError(f"{text!r} is not an angle; write it as '5 deg' or '0.0873 rad', or in radians")
    return value * factor


def refuse_degrees(name: str, angles: Iterable[float]) -> None:
    """Raise InputError for angles of an orientation beyond two full rotations; the message converts from degrees."""
    if text := _degrees_text(name, angles):
        raise InputError(text)


def warn_of_degrees(name: str, angles: Iterable[float], *, stacklevel: int = 2) -> None:
    """Warn of angles beyond two full rotations; ``stacklevel`` is counted from the caller of this function."""
    if text := _degrees_text(name, angles):
        warnings.warn(text, UnitWarning, stacklevel=stacklevel + 1)


def _degrees_text(name: str, angles: Iterable[float]) -> str:
    for angle in angles:
        if MOST_TURN < abs(angle) < math.inf:
            return f"{name}: {angle:g} rad is more than two full rotations; {hint_at_unit(angle, 'rad')}"
    return ""


def refuse_degree_limit(name: str, limit: float | None) -> None:
    """Raise InputError for a limit of a revolute joint that is probably in degrees (:data:`DEGREE_LIMITS`)."""
    if limit is not None and DEGREE_LIMITS[0] < abs(limit) <= DEGREE_LIMITS[1] and limit == round(limit):
        raise InputError(
            f"{name}: {limit:g} rad is {abs(limit) / math.tau:.0f} full rotations; {hint_at_unit(limit, 'rad')}"
        )


def refuse_millimetres(name: str, lengths: Sequence[float], *, most: float = MOST_REACH) -> None:
    """Raise InputError for lengths probably in millimetres: one exceeds ``most`` (m) and all others are 0 or >= 1 m."""
    if text := _millimetres_text(name, lengths, most):
        raise InputError(text)


MOST_MARGIN = 0.99
"""Metres. A larger margin that a person states is in millimetres."""


def warn_of_millimetres(name: str, lengths: Sequence[float], *, most: float = MOST_REACH, stacklevel: int = 2) -> None:
    """Warn of lengths that are probably in millimetres: one exceeds ``most`` (m) and all others are 0 or >= 1 m."""
    if text := _millimetres_text(name, lengths, most):
        warnings.warn(text, UnitWarning, stacklevel=stacklevel + 1)


def _millimetres_text(name: str, lengths: Sequence[float], most: float = MOST_REACH) -> str:
    stated = [abs(length) for length in lengths if length]
    if not stated or not most < max(stated) < math.inf or min(stated) < 1.0:
        return ""
    return f"{name}: {max(stated):g} m is too long; {hint_at_unit(max(stated), 'm')}"


def far_hint(missed: float, size: float) -> str:
    """Return a hint if a target is ``missed`` (m) by more than :data:`FAR` sizes (m) of the robot, else ''."""
    if missed <= FAR * size:
        return ""
    return (
        f". The target is {missed:.3g} m out of reach of a robot of {size:.2g} m: lengths are in metres, and this "
        "distance looks like millimetres"
    )


def hint_at_unit(value: float, unit: str) -> str:
    """Return a hint at the unit of a number that is too large: an angle in rad or a length in m; else ''."""
    if unit == "rad":
        return f"angles are in radians, {value:g} degrees = {math.radians(value):.6g} rad"
    return f"lengths are in metres, {value:g} mm = {value / 1000:g} m" if unit == "m" else ""
