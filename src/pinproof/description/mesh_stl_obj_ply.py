"""Mesh files without a scene: STL (binary, or text with any number of solids), OBJ and PLY (text, or binary).

Lines and points of OBJ files, and edges and cameras of PLY files, have no surface; what else is not faces is refused.
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.description.mesh_reading import Reading, numbers, refuse_many, refused, triangulate

HEADER, TRIANGLE = 84, 50
"""Bytes of a binary file before the first triangle, and of a triangle."""

_XYZ = ["#", "#", "#"]
FACET = ["facet", "normal", *_XYZ, "outer", "loop", *(3 * ["vertex", *_XYZ]), "endloop", "endfacet"]
"""The words of a triangle in a text file; # is a number."""

LONGEST_WORD = 40
"""Characters; a number with 17 digits has at most 24."""

SOLID = re.compile(rb"^[ \t]*(end[ \t]*)?solid\b[^\n]*", re.MULTILINE | re.IGNORECASE)


def read_stl(data: bytes, path: Path) -> Reading:
    """Read an STL file; three vertices for each triangle."""
    if data.lstrip()[:5].lower() != b"solid" or b"\0" in data:  # binary headers may begin with "solid" too
        return _read_binary_stl(data, path)
    # A text is: solid, facets, endsolid, solid, ..., each name in the line of its solid or endsolid.
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


def _read_binary_stl(data: bytes, path: Path) -> Reading:
    announced = HEADER + TRIANGLE * int.from_bytes(data[80:HEADER], "little")
    if len(data) < HEADER:
        raise refused(path, f"it has {len(data)} bytes and does not begin with 'solid', so it is no STL file")
    if len(data) != announced:
        what = "the file is truncated" if len(data) < announced else "the file holds more than its header states"
        raise refused(path, f"{what}: its header announces {announced:,} bytes, but it has {len(data):,}")
    refuse_many(path, (announced - HEADER) // TRIANGLE)
    row = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(data, dtype=row, offset=HEADER)["corners"]
    return Reading(corners.reshape(-1, 3).astype(float), np.arange(3 * len(corners)).reshape(-1, 3))


OBJ_WITHOUT_SURFACE = {b"vt", b"vn", b"l", b"p", b"g", b"o", b"s", b"usemtl", b"mtllib", b"usemap", b"maplib"}
"""Statements that are read over: normals, texture coordinates, lines, points, groups, names, smoothing, materials."""

CONTINUED_NAME = re.compile(rb"^[ \t]*(?:#|[^vfl\s])[^\n]*\\$", re.MULTILINE)
"""A comment or name that ends with a backslash: some programs continue it with the next line, others do not."""


def read_obj(data: bytes, path: Path) -> Reading:
    """Read an OBJ file; polygons become triangles."""
    text = data.replace(b"\r\n", b"\n")
    if b"\r" in text:
        raise refused(path, "it has carriage returns inside lines")
    if b"\\\n" in text:
        if (name := CONTINUED_NAME.search(text)) is not None:
            row = text.count(b"\n", 0, name.start()) + 1
            raise refused(path, "a comment or name ends with a backslash", f"line {row}")
        text = text.replace(b"\\\n", b" ")
    coordinates, corners, counts = array("d"), array("q"), array("q")
    vertices = 0
    for number, line in enumerate(text.split(b"\n"), 1):
        words = line.split()
        if not words or words[0] in OBJ_WITHOUT_SURFACE or words[0].startswith(b"#"):
            continue
        kind = words[0]
        try:
            if kind not in (b"v", b"f"):
                raise ValueError(f"the statement {kind.decode('latin-1')!r} is not supported")
            if b"#" in line:
                words = line.partition(b"#")[0].split()
            if b"_" in line:  # Python would read 1_0 as 10
                raise ValueError("'_' is no part of a number")
            if kind == b"v":
                # x y z, and optionally a weight, which only curved surfaces use, or a colour
                if len(words) not in (4, 5, 7) or (len(words) == 5 and float(words[4]) != 1.0):
                    raise ValueError("a vertex has x, y, z, and optionally the weight 1 or three numbers of a colour")
                coordinates.extend(map(float, words[1:4]))
                vertices += 1
                continue
            for word in words[1:]:
                index = int(word.partition(b"/")[0])
                if index < 0:
                    index += vertices + 1  # relative to the vertices above this line
                if not index > 0:
                    raise ValueError(f"{word.decode('latin-1')!r} names no vertex")
                corners.append(index - 1)
            if len(words) < 4:
                raise ValueError("a face has at least three corners")
            counts.append(len(words) - 1)
        except ValueError as error:
            raise refused(path, str(error), f"line {number}") from error
    # polygons as triangles
    points = np.array(coordinates).reshape(-1, 3)
    indices, sizes = np.array(corners, dtype=np.int64), np.array(counts, dtype=np.int64)
    refuse_many(path, int((sizes - 2).sum()))
    if len(indices) and indices.max() >= len(points):
        raise refused(path, f"a face names vertex {indices.max() + 1}, but there are {len(points)} vertices")
    try:
        return Reading(points, triangulate(points, indices, sizes))
    except ValueError as error:
        raise refused(path, str(error)) from error


_TYPES = "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64"
CODES = dict(zip(_TYPES.split(), 2 * "bBhHiIfd", strict=True))
"""The types of properties, as codes of ``struct`` and NumPy."""

FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}

CORNERS = ("vertex_indices", "vertex_index")
"""The names of the list of vertices of a face."""

PLY_WITHOUT_SURFACE = ("edge", "camera")
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
            if name not in ("vertex", "face", *PLY_WITHOUT_SURFACE) and any(
                len(counts) for _, counts in columns.values()
            ):
                known = ", ".join(("vertex", "face", *PLY_WITHOUT_SURFACE))
                raise ValueError(f"the elements {name!r} are not supported; supported: {known}")
        # the faces have one list of vertices
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
