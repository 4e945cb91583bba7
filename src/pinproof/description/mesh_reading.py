"""What the readers of mesh files share: their result, their limits, numbers in text, and polygons."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.errors import MeshError

MOST_TRIANGLES = 5_000_000
"""About a hundred times as many as a link needs, and as many as a binary STL of the largest accepted size holds."""

MOST_NODES = 10_000
"""Nodes of a COLLADA or glTF scene, each counted as often as it is instantiated. Nested instances multiply."""

DEEPEST_NODE = 100
"""Ancestors of a node. Other programs read scenes recursively."""

MOST_CORNERS = 2_000
"""Corners of a polygon that is not convex; the time to triangulate it grows with their square."""

REFLEX = 1e-6
"""Sine of the angle by which a polygon may turn back and still counts as convex, because coordinates are rounded."""

REMEDY = "export the mesh again as binary STL"


@dataclass(frozen=True, eq=False)
class Reading:
    """Vertices (V, 3) in units of the file and triangles (F, 3) of a mesh file; the unit in metres."""

    vertices: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int64]
    unit: float = 1.0


def refused(path: Path, reason: str, place: str = "") -> MeshError:
    """An error for a mesh file that cannot be read completely, with the remedy."""
    return MeshError(path, f"cannot be read as a mesh: {reason}; {REMEDY}", place)


def refuse_many(path: Path, triangles: int, vertices: int = 0) -> None:
    """Raise MeshError above :data:`MOST_TRIANGLES`, or three times as many vertices, instances included."""
    for number, limit, what in (triangles, MOST_TRIANGLES, "triangles"), (vertices, 3 * MOST_TRIANGLES, "vertices"):
        if number > limit:
            remedy = "simplify the mesh, or split it into several"
            raise MeshError(
                path, f"has at least {number:,} {what} with all instances; the limit is {limit:,}: {remedy}"
            )


def placed(
    parts: Iterable[tuple[npt.NDArray[np.float64], npt.NDArray[np.floating[Any]], npt.NDArray[np.int64]]],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Vertices and triangles of parts, each with its transform (4, 4); mirrored triangles keep their outside out."""
    vertices, triangles, count = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
    for matrix, points, corners in parts:
        vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
        triangles.append(count + (corners[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else corners))
        count += len(points)
    return np.concatenate(vertices), np.concatenate(triangles)


def strip(corners: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Triangles (F, 3) of a triangle strip; every second is reversed, so that all have the same side out."""
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    triangles[1::2] = triangles[1::2, [1, 0, 2]]
    return triangles


def fan(corners: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Triangles (F, 3) of a triangle fan around its first corner."""
    return np.stack([np.broadcast_to(corners[:1], corners[2:].shape), corners[1:-1], corners[2:]], axis=1)


def numbers(text: bytes, kind: type[np.float64] | type[np.int64]) -> npt.NDArray[Any]:
    """The numbers of a text, separated by white space; ValueError unless every word is one."""
    blank = np.frombuffer(text, dtype=np.uint8) <= ord(" ")
    words = int(np.count_nonzero(~blank[1:] & blank[:-1])) + int(len(blank) > 0 and not blank[0])
    if words == 0:
        return np.empty(0, dtype=kind)
    try:
        values: npt.NDArray[Any] = np.fromstring(text, dtype=kind, sep=" ")
    except (DeprecationWarning, ValueError):  # NumPy warns, or raises, where it stops
        values = np.empty(0, dtype=kind)
    if len(values) != words:
        raise ValueError(f"it has words that are not {'integers' if kind is np.int64 else 'numbers'}")
    return values


def triangulate(
    points: npt.NDArray[np.float64], corners: npt.NDArray[np.int64], counts: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    """Triangles (F, 3) of polygons: n - 2 for a polygon with n corners, in its plane and none outside it.

    Parameters
    ----------
    points
        Vertices (V, 3).
    corners
        Indices of vertices, polygon after polygon.
    counts
        The number of corners of each polygon, at least 3.

    ValueError for a polygon that crosses itself, or that is not convex and has more than :data:`MOST_CORNERS` corners.
    """
    starts = np.cumsum(counts) - counts
    pieces = [np.empty((0, 3), dtype=np.int64)]
    for n in np.unique(counts).tolist():
        rows = corners[starts[counts == n][:, None] + np.arange(n)]
        if n > 3:
            # A polygon is convex if it turns everywhere to the side of its area vector; a fan is then right.
            polygons = points[rows]
            edges = np.roll(polygons, -1, axis=1) - polygons
            turns = np.cross(np.roll(edges, 1, axis=1), edges)
            area = np.cross(polygons[:, 1:-1] - polygons[:, :1], polygons[:, 2:] - polygons[:, :1]).sum(axis=1)
            lengths = np.linalg.norm(edges, axis=2)
            allowed = REFLEX * np.roll(lengths, 1, axis=1) * lengths * np.linalg.norm(area, axis=1)[:, None]
            concave = (np.einsum("pci,pi->pc", turns, area) < -allowed).any(axis=1)
            pieces += [_ears(points, row, normal) for row, normal in zip(rows[concave], area[concave], strict=True)]
            rows = rows[~concave]
        fans = np.stack([np.broadcast_to(rows[:, :1], rows[:, 2:].shape), rows[:, 1:-1], rows[:, 2:]], axis=-1)
        pieces.append(fans.reshape(-1, 3))
    return np.concatenate(pieces)


def _ears(
    points: npt.NDArray[np.float64], corners: npt.NDArray[np.int64], normal: npt.NDArray[np.float64]
) -> npt.NDArray[np.int64]:
    """Triangles of a polygon that is not convex, cut off one by one (Meisters 1975, "Polygons have ears")."""
    if len(corners) > MOST_CORNERS:
        raise ValueError(f"a polygon that is not convex has {len(corners):,} corners; the limit is {MOST_CORNERS:,}")
    # Project along the largest component of the area vector, so that the polygon turns counter-clockwise.
    drop = int(np.argmax(np.abs(normal)))
    axes = [(1, 2), (2, 0), (0, 1)][drop]
    flat = points[corners][:, list(axes) if normal[drop] > 0 else list(axes[::-1])]
    flat = flat - flat.mean(axis=0)
    rest, triangles = list(range(len(corners))), []
    while len(rest) > 3:
        ring = flat[rest]
        before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
        turns = _cross(ring - before, after - ring)
        reflex = ring[turns <= 0]
        # An ear turns left and holds no reflex corner. The triangles then add up to the winding number of the polygon.
        for index in np.argsort(-turns, kind="stable").tolist():
            ear = before[index], ring[index], after[index]
            apart = np.all([(reflex != corner).any(axis=1) for corner in ear], axis=0)
            inside = [_cross(q - p, reflex - p) >= 0 for p, q in zip(ear, (*ear[1:], ear[0]), strict=True)]
            if turns[index] >= 0 and not (apart & np.all(inside, axis=0)).any():
                break
        else:
            raise ValueError("a polygon crosses itself")
        triangles.append((rest[index - 1], rest[index], rest[(index + 1) % len(rest)]))
        del rest[index]
    return corners[np.array([*triangles, rest])]


def _cross(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
