"""What a size and a place may be: coal takes NaN, -1 and 1e300 without a word."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.spatial import finite

__all__ = ["LARGEST_SIZE", "SMALLEST_SIZE", "checked_size", "coordinates"]

Array = npt.NDArray[np.float64]

SMALLEST_SIZE = 1e-6
"""Metres. A side below this is refused: coal's hulls break down near 1e-8, and no real thing is thinner."""

LARGEST_SIZE = 1e4
"""Metres. Beyond it a number is a mistake (a unit, a slip), and distances lose the digits that proofs are made of."""


def checked_size(name: str, value: object) -> float:
    """A length as a number.

    Raises
    ------
    InputError
        If it is no number from :data:`SMALLEST_SIZE` to :data:`LARGEST_SIZE`.
    """
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number, not {value!r}") from None
    if not SMALLEST_SIZE <= number <= LARGEST_SIZE:
        raise InputError(f"{name} = {number:g}; sizes are finite, from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} m")
    return number


def coordinates(name: str, value: npt.ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """A read-only copy of coordinates (m) of the given shape, as in :func:`pinproof.spatial.finite`.

    Raises
    ------
    InputError
        If the shape is another, or a number is not finite or beyond :data:`LARGEST_SIZE`.
    """
    array = finite(name, value, shape)
    if array.size and float(np.abs(array).max()) > LARGEST_SIZE:
        raise InputError(f"{name} holds {np.abs(array).max():g}; places are within {LARGEST_SIZE:g} m")
    array.setflags(write=False)
    return array
