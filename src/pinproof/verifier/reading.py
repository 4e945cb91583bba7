"""Reads a proof file and its values, and refuses malformed values with their place in the file.

Nothing is converted silently: a number is a JSON number (no boolean, no text), an integer is an integer, a text is a
printable text, and a field that this version does not define is refused.
"""

from __future__ import annotations

import gzip
import io
import json
import math
import reprlib
import stat
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

LARGEST = 1e6
"""Largest magnitude of a number by default: double precision is too coarse for a proof beyond it."""

EXACT_INTEGER = 1 << 53
"""Up to this number every integer is a double."""

LONGEST_INTEGER = 20
"""Largest number of digits of an integer; longer integers are refused before they are converted."""

LARGEST_FILE = 1 << 28
"""Largest size (bytes) of a file, compressed or not: about a thousand times that of a proof."""


class Refused(ValueError):
    """A fault of a proof; the message begins with the place in the file."""


def load(path: str | Path) -> Any:
    """Return the parsed JSON of a file, compressed with gzip or not.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not JSON, repeats a key, or holds a number that is not a finite double.
    """
    status = Path(path).stat()
    if not stat.S_ISREG(status.st_mode):  # reading a pipe would never end
        raise ValueError("is a folder, a pipe or a device, not a file")
    if status.st_size > LARGEST_FILE:
        raise ValueError(f"holds {status.st_size} bytes; at most {LARGEST_FILE} are read")
    data = Path(path).read_bytes()
    if data[:2] == b"\x1f\x8b":
        try:
            with gzip.open(io.BytesIO(data)) as file:
                data = file.read(LARGEST_FILE + 1)
        except (EOFError, zlib.error) as error:
            raise ValueError(f"is not a complete gzip file: {error}") from error
    if len(data) > LARGEST_FILE:
        raise ValueError(f"holds more than {LARGEST_FILE} bytes after decompression")
    try:
        return json.loads(
            data,
            object_pairs_hook=_unique_keys,
            parse_constant=_finite,
            parse_float=_finite,
            parse_int=_short_integer,
        )
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a mapping, and refuse repeated keys, of which readers may use either."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the key {shown(key)} is repeated")
        found[key] = value
    return found


def _finite(literal: str) -> float:
    value = float(literal)
    if not math.isfinite(value):
        raise ValueError(f"{literal[:LONGEST_INTEGER]} is not a finite double")
    return value


def _short_integer(literal: str) -> int:
    if len(literal) > LONGEST_INTEGER:
        raise ValueError(f"an integer has {len(literal)} digits; at most {LONGEST_INTEGER} are read")
    return int(literal)


def shown(value: Any) -> str:
    """Return a short text of any value for messages."""
    if isinstance(value, int) and not -EXACT_INTEGER <= value <= EXACT_INTEGER:
        return f"an integer of {value.bit_length()} bits"
    return ascii(value) if isinstance(value, str) and len(value) < 80 else reprlib.repr(value)


def _place(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def member(holder: Any, where: str, key: str) -> Any:
    """Return the value of a key."""
    if not isinstance(holder, dict):
        raise Refused(f"{where or 'proof'}: must be a mapping")
    if key not in holder:
        raise Refused(f"{_place(where, key)}: is missing")
    return holder[key]


def check_fields(holder: Any, where: str, known: tuple[str, ...]) -> None:
    """Refuse a mapping with an unknown key, because its meaning is not known."""
    unknown = [key for key in holder if key not in known] if isinstance(holder, dict) else []
    if unknown:
        raise Refused(f"{where or 'proof'}: unknown field {shown(unknown[0])}; known are {', '.join(known)}")


def items(holder: Any, where: str, key: str) -> list[Any]:
    """Return the list of a key."""
    found = member(holder, where, key)
    if type(found) is not list:
        raise Refused(f"{_place(where, key)}: must be a list")
    return found


def text(holder: Any, where: str, key: str) -> str:
    """Return the text of a key, which must be printable: control characters could forge messages that contain it."""
    found = member(holder, where, key)
    if not is_text(found):
        raise Refused(f"{_place(where, key)}: must be a printable text, not {shown(found)}")
    return str(found)


def is_text(value: Any) -> bool:
    """Whether a value is a text that is not empty and has no control characters."""
    return type(value) is str and value != "" and value.isprintable()


def rows_of_names(holder: Any, where: str, key: str) -> list[Any]:
    """Return the list of a key, whose rows are two different names and a third entry of any kind."""
    rows = items(holder, where, key)
    for k, row in enumerate(rows):
        if type(row) is not list or len(row) != 3 or not all(map(is_text, row[:2])) or row[0] == row[1]:
            place = f"{_place(where, key)}[{k}]"
            raise Refused(f"{place}: must be two different names and a third entry, not {shown(row)}")
    return rows


def numbers(holder: Any, where: str, key: str, shape: tuple[int | None, ...], largest: float = LARGEST) -> Array:
    """Return the finite numbers of a key as an array of the given shape; None is any length."""
    place, sizes = _place(where, key), list(shape)
    found: list[float] = []
    _collect(member(holder, where, key), place, sizes, 0, found)
    array = np.array(found, dtype=np.float64)
    if not (np.abs(array) <= largest).all():  # also true for NaN
        raise Refused(f"{place}: a number is not finite, or its magnitude is above {largest:g}")
    return array.reshape([size or 0 for size in sizes])


def _collect(value: Any, place: str, sizes: list[int | None], depth: int, found: list[float]) -> None:
    """Append the numbers of nested lists; a size of None is set by the first list."""
    if depth == len(sizes):
        _append([value], place, found)
        return
    if type(value) is not list:
        raise Refused(f"{place}: must be {len(sizes) - depth} nested lists of numbers, not {shown(value)}")
    size = sizes[depth]
    if size is None:
        size = sizes[depth] = len(value)
    if len(value) != size:
        raise Refused(f"{place}: must have {size} entries, not {len(value)}")
    if depth == len(sizes) - 1:
        _append(value, place, found)
        return
    for k, part in enumerate(value):
        _collect(part, f"{place}[{k}]", sizes, depth + 1, found)


def _append(values: list[Any], place: str, found: list[float]) -> None:
    for value in values:
        if type(value) is not float and (type(value) is not int or abs(value) > EXACT_INTEGER):
            raise Refused(f"{place}: must be a number within double precision, not {shown(value)}")
        found.append(value)


def optional_numbers(holder: Any, where: str, key: str, count: int, missing: float) -> Array:
    """Return ``count`` numbers of a key, of which null stands for ``missing``."""
    values = items(holder, where, key)
    known = [0.0 if value is None else value for value in values]
    return np.where([value is None for value in values], missing, numbers({key: known}, where, key, (count,)))


def number(holder: Any, where: str, key: str) -> float:
    """Return the finite number of a key."""
    return float(numbers(holder, where, key, ()))


def index(value: Any, low: int, end: int, where: str) -> int:
    """Return an index, which must be an integer from ``low`` to below ``end``."""
    if type(value) is not int or not low <= value < end:
        raise Refused(f"{where}: must be an index from {low} to below {end}, not {shown(value)}")
    return value
