"""Wavefront OBJ files: vertices and faces. Lines and points have no surface; free-form geometry is refused."""

from __future__ import annotations

import re
from array import array
from pathlib import Path

import numpy as np

from pinproof.description.mesh_formats.reading import Reading, refuse_many, refused, triangulate

NO_SURFACE = {b"vt", b"vn", b"l", b"p", b"g", b"o", b"s", b"usemtl", b"mtllib", b"usemap", b"maplib"}
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
        if not words or words[0] in NO_SURFACE or words[0].startswith(b"#"):
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
    points = np.array(coordinates).reshape(-1, 3)
    indices, sizes = np.array(corners, dtype=np.int64), np.array(counts, dtype=np.int64)
    refuse_many(path, int((sizes - 2).sum()))
    if len(indices) and indices.max() >= len(points):
        raise refused(path, f"a face names vertex {indices.max() + 1}, but there are {len(points)} vertices")
    try:
        return Reading(points, triangulate(points, indices, sizes))
    except ValueError as error:
        raise refused(path, str(error)) from error
