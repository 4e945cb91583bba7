"""PLY files: text, or binary of either byte order."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.description.mesh_formats.reading import Reading, numbers, refuse_many, refused, triangulate

CODES = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "float64": "d",
}
"""The types of properties, as codes of ``struct`` and NumPy."""

FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}

CORNERS = ("vertex_indices", "vertex_index")
"""The names of the list of vertices of a face."""

NO_SURFACE = ("edge", "camera")
"""Elements that are read over; others are refused, for example ``tristrips``."""


@dataclass
class Element:
    """An element of the header, with the name, the code and, for a list, the code of the length of each property."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)


Columns = Mapping[str, tuple[npt.NDArray[np.generic], npt.NDArray[np.int64]]]
"""The values of each property, row after row, and how many each row has."""


def read_ply(data: bytes, path: Path) -> Reading:
    """Read a PLY file; polygons become triangles."""
    try:
        elements = read_elements(data)
        vertex, face = elements.get("vertex", {}), elements.get("face", {})
        for name, columns in elements.items():
            if name not in ("vertex", "face", *NO_SURFACE) and any(len(counts) for _, counts in columns.values()):
                known = ", ".join(("vertex", "face", *NO_SURFACE))
                raise ValueError(f"the elements {name!r} are not supported; supported: {known}")
        lists = [name for name in CORNERS if name in face]
        if len(lists) != 1:
            raise ValueError(f"it needs faces with one list {' or '.join(CORNERS)}")
        points, (corners, counts) = positions(vertex), face[lists[0]]
        if len(counts) and counts.min() < 3:
            raise ValueError(f"face {counts.argmin() + 1} has {counts.min()} corners; a face has at least three")
        refuse_many(path, int((counts - 2).sum()))
        indices = corners.astype(np.int64)
        if (indices != corners).any() or (len(indices) and not 0 <= indices.min() <= indices.max() < len(points)):
            raise ValueError(f"its faces have vertex indices outside the {len(points)} vertices")
        return Reading(points, triangulate(points, indices, counts))
    except ValueError as error:
        raise refused(path, str(error)) from error


def positions(vertex: Columns) -> npt.NDArray[np.float64]:
    """The points (N, 3) of the element ``vertex``."""
    if not {"x", "y", "z"} <= set(vertex):
        raise ValueError("it needs vertices with x, y and z")
    return np.stack([vertex[axis][0] for axis in "xyz"], axis=1).astype(float)


def read_elements(data: bytes) -> dict[str, Columns]:
    """The elements of a PLY file, exactly as many as its header states; ValueError if that is not possible."""
    elements, order, content = _read_header(data)
    body: bytes | memoryview = content
    if order == "=":  # text: as if every number were a double
        body = numbers(content, np.float64).view(np.uint8).data
        for element in elements:
            element.properties = [(name, "d", length and "d") for name, _, length in element.properties]
    read: dict[str, Columns] = {}
    position = 0
    for element in elements:
        try:
            read[element.name], position = _read_columns(element, body, position, order)
        except (struct.error, ValueError) as error:
            what = f"its header states {element.count:,} elements {element.name!r}, but the file ends within them"
            raise ValueError(what) from error
    if position != len(body):
        raise ValueError("the file holds more than its header states, or lists of other lengths")
    return read


def _read_header(data: bytes) -> tuple[list[Element], str, bytes]:
    """The elements, the byte order, and the content after the header."""
    elements: list[Element] = []
    order, position, number = "", 0, 0
    while True:
        end = data.find(b"\n", position)
        line = data[position : end if end >= 0 else len(data)].removesuffix(b"\r").decode("latin-1")
        position, number = end + 1, number + 1
        match line.split():
            case ["ply"] if number == 1:
                pass
            case ["format", name, "1.0"] if number > 1 and name in FORMATS and not order:
                order = FORMATS[name]
            case ["comment" | "obj_info", *_] if number > 1:
                pass
            case ["element", name, count] if order and count.isdecimal() and len(count) < 12:
                if name in {element.name for element in elements}:
                    raise ValueError(f"line {number}: a second element {name!r}")
                elements.append(Element(name, int(count)))
            case ["property", code, name] if elements and code in CODES:
                elements[-1].properties.append((name, CODES[code], ""))
            case ["property", "list", length, code, name] if elements and code in CODES and length in CODES:
                elements[-1].properties.append((name, CODES[code], CODES[length]))
            case ["end_header"] if order and end >= 0:
                break
            case _:
                what = (
                    f"{line[:80]!r} is not a valid line of a PLY header here" if end >= 0 else "the header has no end"
                )
                raise ValueError(f"line {number}: {what}")
        if end < 0:
            raise ValueError("the file is truncated: its header has no end_header")
    # properties are columns, which need distinct names
    for element in elements:
        names = [name for name, _, _ in element.properties]
        if len(names) != len(set(names)) or (element.count and not names):
            raise ValueError(f"the properties of the element {element.name!r} are missing or repeated")
    return elements, order, data[position:]


def _read_columns(element: Element, body: bytes | memoryview, start: int, order: str) -> tuple[Columns, int]:
    """The columns of an element and the position after it; ``struct.error`` or ValueError if the content is too short.

    Usually all rows have lists of the same lengths as the first row. Then the element is a table.
    """
    # the layout of the first row
    position, columns = start, []
    for name, code, length in element.properties if element.count else ():
        size = 1
        if length:
            size, position = _list_size(body, position, order + length)
            columns.append((f"{name}()", order + length, (1,)))
        columns.append((name, order + code, (size,)))
        position += size * struct.calcsize(order + code)
        if position > len(body):
            raise ValueError(name)
    # all rows at once, if their lists have these lengths
    row = np.dtype(columns)
    end = start + element.count * row.itemsize
    if columns and end <= len(body):
        table = np.frombuffer(body, dtype=row, count=element.count, offset=start)
        sizes = {name: row[name].shape[0] for name, _, _ in element.properties}
        if all((table[f"{name}()"] == sizes[name]).all() for name, _, length in element.properties if length):
            return {n: (table[n].reshape(-1), np.full(element.count, size)) for n, size in sizes.items()}, end
    # otherwise row by row
    values = {name: array("d") for name, _, _ in element.properties}  # doubles hold all types of PLY exactly
    counts = {name: array("q") for name in values}
    position = start
    for _ in range(element.count):
        for name, code, length in element.properties:
            size = 1
            if length:
                size, position = _list_size(body, position, order + length)
            values[name].extend(struct.unpack_from(f"{order}{size}{code}", body, position))
            counts[name].append(size)
            position += size * struct.calcsize(order + code)
    return {n: (np.array(values[n], dtype=float), np.array(counts[n], dtype=np.int64)) for n in values}, position


def _list_size(body: bytes | memoryview, position: int, code: str) -> tuple[int, int]:
    """The length of the list that begins at a position, and the position of its first value."""
    (size,) = struct.unpack_from(code, body, position)
    if size != int(size) or not 0 <= size <= len(body):
        raise ValueError(size)
    return int(size), position + struct.calcsize(code)
