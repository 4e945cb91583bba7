"""STL files: binary, or text with any number of solids."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pinproof.description.mesh_formats.reading import Reading, numbers, refuse_many, refused

HEADER, TRIANGLE = 84, 50
"""Bytes of a binary file before the first triangle, and of a triangle."""

FACET = [
    "facet",
    "normal",
    "#",
    "#",
    "#",
    "outer",
    "loop",
    "vertex",
    "#",
    "#",
    "#",
    "vertex",
    "#",
    "#",
    "#",
    "vertex",
    "#",
    "#",
    "#",
    "endloop",
    "endfacet",
]
"""The words of a triangle in a text file; # is a number."""

LONGEST_WORD = 40
"""Characters; a number with 17 digits has at most 24."""

SOLID = re.compile(rb"^[ \t]*(end[ \t]*)?solid\b[^\n]*", re.MULTILINE | re.IGNORECASE)


def read_stl(data: bytes, path: Path) -> Reading:
    """Read an STL file; three vertices for each triangle."""
    announced = HEADER + TRIANGLE * int.from_bytes(data[80:HEADER], "little")
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:  # binary headers may begin with "solid" too
        return _read_text(data, path)
    if len(data) < HEADER:
        raise refused(path, f"it has {len(data)} bytes and does not begin with 'solid', so it is no STL file")
    if len(data) != announced:
        what = "the file is truncated" if len(data) < announced else "the file holds more than its header states"
        raise refused(path, f"{what}: its header announces {announced:,} bytes, but it has {len(data):,}")
    refuse_many(path, (announced - HEADER) // TRIANGLE)
    row = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(data, dtype=row, offset=HEADER)["corners"]
    return Reading(corners.reshape(-1, 3).astype(float), np.arange(3 * len(corners)).reshape(-1, 3))


def _read_text(data: bytes, path: Path) -> Reading:
    # The file is: solid, facets, endsolid, solid, ..., each name in the line of its solid or endsolid.
    outside, *parts = SOLID.split(data.replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
    ends, contents = parts[0::2], parts[1::2]
    if len(ends) % 2 or any((end is None) == (number % 2 == 1) for number, end in enumerate(ends)):
        raise refused(path, "the lines solid and endsolid do not alternate; the file may be truncated")
    if outside.strip() or any(text.strip() for text in contents[1::2]):
        raise refused(path, "it has text outside of solid and endsolid")
    words = b" ".join(contents[0::2]).split()
    if max(map(len, words), default=0) > LONGEST_WORD:
        raise refused(path, f"it has words of more than {LONGEST_WORD} characters inside a solid")
    count, rest = divmod(len(words), len(FACET))
    refuse_many(path, count)
    table = np.array(words[: count * len(FACET)], dtype=bytes).reshape(-1, len(FACET))
    fixed = [column for column, word in enumerate(FACET) if word != "#"]
    wrong = (np.char.lower(table[:, fixed]) != np.array([FACET[column].encode() for column in fixed])).any(axis=1)
    if rest or wrong.any():
        number = 1 + int(np.argmax(wrong)) if wrong.any() else count + 1
        raise refused(path, f"it is not '{' '.join(FACET)}' with a number for each #", f"facet {number}")
    coordinates = [column for column, word in enumerate(FACET) if word == "#"][3:]
    try:
        values = numbers(b" ".join(table[:, coordinates].ravel()), np.float64)
    except ValueError as error:
        raise refused(path, f"the coordinates: {error}") from error
    return Reading(values.reshape(-1, 3), np.arange(len(values) // 3).reshape(-1, 3))
