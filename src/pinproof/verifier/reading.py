"""Reads a proof file and its values; whatever is malformed is refused with its place in the file.

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
"""Up to here every integer is a double."""

LONGEST_INTEGER = 20
"""Digits of an integer in a file; longer ones are refused before they are converted."""

LARGEST_FILE = 1 << 28
"""Bytes, compressed or not: proofs have about a thousandth of it."""


class Refused(ValueError):
    """What is wrong with a proof, beginning with the place."""


def load(path: str | Path) -> Any:
    """The parsed JSON of a file, compressed with gzip or not.

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
    """A mapping; two readers could disagree about which of two equal keys counts."""
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
    """A short text for messages, whatever the value is."""
    if isinstance(value, int) and not -EXACT_INTEGER <= value <= EXACT_INTEGER:
        return f"an integer of {value.bit_length()} bits"
    return ascii(value) if isinstance(value, str) and len(value) < 80 else reprlib.repr(value)


def _place(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def member(holder: Any, where: str, key: str) -> Any:
    """The value of a key."""
    if not isinstance(holder, dict):
        raise Refused(f"{where or 'proof'}: must be a mapping")
    if key not in holder:
        raise Refused(f"{_place(where, key)}: is missing")
    return holder[key]


def check_fields(holder: Any, where: str, known: tuple[str, ...]) -> None:
    """Refuses a mapping with other keys than those known; what it means is not known either."""
    unknown = [key for key in holder if key not in known] if isinstance(holder, dict) else []
    if unknown:
        raise Refused(f"{where or 'proof'}: unknown field {shown(unknown[0])}; known are {', '.join(known)}")


def items(holder: Any, where: str, key: str) -> list[Any]:
    """The list of a key."""
    found = member(holder, where, key)
    if type(found) is not list:
        raise Refused(f"{_place(where, key)}: must be a list")
    return found


def text(holder: Any, where: str, key: str) -> str:
    """The printable text of a key: messages name it, and control characters could forge them."""
    found = member(holder, where, key)
    if not is_text(found):
        raise Refused(f"{_place(where, key)}: must be a printable text, not {shown(found)}")
    return str(found)


def is_text(value: Any) -> bool:
    """Whether a value is a text that is not empty and has no control characters."""
    return type(value) is str and value != "" and value.isprintable()


def rows_of_names(holder: Any, where: str, key: str) -> list[Any]:
    """The list of a key, of rows of two different names and a third entry of any kind."""
    rows = items(holder, where, key)
    for k, row in enumerate(rows):
        if type(row) is not list or len(row) != 3 or not all(map(is_text, row[:2])) or row[0] == row[1]:
            place = f"{_place(where, key)}[{k}]"
            raise Refused(f"{place}: must be two different names and a third entry, not {shown(row)}")
    return rows


def numbers(holder: Any, where: str, key: str, shape: tuple[int | None, ...], largest: float = LARGEST) -> Array:
    """The finite numbers of a key as an array of the given shape; None stands for any length."""
    place, sizes = _place(where, key), list(shape)
    found: list[float] = []
    _collect(member(holder, where, key), place, sizes, 0, found)
    array = np.array(found, dtype=np.float64)
    if not (np.abs(array) <= largest).all():  # written so that NaN is refused
        raise Refused(f"{place}: a number is not finite, or its magnitude is above {largest:g}")
    return array.reshape([size or 0 for size in sizes])


def _collect(value: Any, place: str, sizes: list[int | None], depth: int, found: list[float]) -> None:
    """Appends the numbers of nested lists; a size that is still open is that of the first list found."""
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


def number(holder: Any, where: str, key: str) -> float:
    """The finite number of a key."""
    return float(numbers(holder, where, key, ()))


def index(value: Any, low: int, end: int, where: str) -> int:
    """An integer from ``low`` to below ``end``."""
    if type(value) is not int or not low <= value < end:
        raise Refused(f"{where}: must be an index from {low} to below {end}, not {shown(value)}")
    return value
