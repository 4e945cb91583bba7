"""Checks of sizes and coordinates of shapes, and equality of shapes that hold arrays."""

from __future__ import annotations

import hashlib
from dataclasses import fields
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from pinproof.common.results import ByValue
from pinproof.common.structs import NUMBER, Definition, number, parsed, simple
from pinproof.errors import InputError
from pinproof.spatial import Array, finite

SMALLEST_SIZE = 1e-6
"""Metres. Smaller sides are refused: coal's hulls fail near 1e-8, and no real object is thinner."""

LARGEST_SIZE = 1e4
"""Metres. Larger numbers are a mistake, such as a wrong unit, and distances lose the precision that proofs need."""


def checked_size(name: str, value: object) -> float:
    """Return a length as a number; InputError if it is not from :data:`SMALLEST_SIZE` to :data:`LARGEST_SIZE`."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number, not {value!r}") from None
    if not SMALLEST_SIZE <= number <= LARGEST_SIZE:
        raise InputError(f"{name} = {number:g}; sizes are from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} m")
    return number


SIZE = Definition("size", {"$ref": NUMBER.schema, "minimum": SMALLEST_SIZE, "maximum": LARGEST_SIZE})
LENGTH = simple(SIZE, checked_size, parsed)
Size = Annotated[float, LENGTH]
"""A length of a shape."""

COORDINATE = number(minimum=-LARGEST_SIZE, maximum=LARGEST_SIZE)


def coordinates(name: str, value: npt.ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Return a read-only copy of coordinates (m); InputError if one is not finite or beyond :data:`LARGEST_SIZE`."""
    array = finite(name, value, shape)
    if array.size and float(np.abs(array).max()) > LARGEST_SIZE:
        raise InputError(f"{name} holds {np.abs(array).max():g}; coordinates are limited to {LARGEST_SIZE:g} m")
    array.setflags(write=False)
    return array


def point_array(name: str, value: npt.ArrayLike) -> Array:
    """Return points (N, 3), which may be not finite; InputError if the shape is another."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be numbers of the shape (N, 3): {error}") from error
    if array.size == 0:
        return np.zeros((0, 3))
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{name} must have the shape (N, 3); it has {array.shape}")
    return array


CELLS = "_cells"
"""The attribute of a shape of cells that keeps them as the core uses them."""


class ByContent(ByValue):
    """Equality, and a short ``repr`` with hashes of arrays, for frozen dataclasses that hold arrays."""

    def __repr__(self) -> str:
        stated = []
        for field in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            value, text = getattr(self, field.name), ""
            if isinstance(value, np.ndarray):
                text = f"<{value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}>"
            stated.append(f"{field.name}={text or repr(value)}")
        return f"{type(self).__name__}({', '.join(stated)})"

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != CELLS}
