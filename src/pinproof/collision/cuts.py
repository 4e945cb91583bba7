"""Triangles, edges and convex cells cut in two by a plane.

A plane is ``[normal, offset]`` (4,): the points x with ``normal . x + offset = 0``. Points within ``snap`` metres of it
lie in it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["split_cell", "split_edges", "split_triangles"]

Array = npt.NDArray[np.float64]


def _heights(points: Array, plane: Array, snap: float) -> Array:
    heights = points @ plane[:3] + plane[3]
    return np.where(np.abs(heights) <= snap, 0.0, heights)


def split_triangles(corners: Array, plane: Array, snap: float) -> tuple[Array, Array]:
    """The triangles below and above a plane, cut where they cross it; those in it go to the side of their material."""
    h = _heights(corners, plane, snap)
    below, above = (h <= 0).all(axis=1), (h >= 0).all(axis=1)
    inside_plane = below & above
    if inside_plane.any():
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        up = normals @ plane[:3] > 0  # outward normal up: the material is below
        below, above = below & ~(inside_plane & ~up), above & ~(inside_plane & up)
    lower, upper = [corners[below & (~above | inside_plane)]], [corners[above & (~below | inside_plane)]]
    crossing = ~((h <= 0).all(axis=1) | (h >= 0).all(axis=1))
    torn, h = corners[crossing], h[crossing]
    if len(torn):
        # Turn each so that its first corner is alone on its side; a corner in the plane counts to the other two.
        s = np.sign(h)
        alone = np.argmax(
            [
                (s[:, i] * s[:, j] <= 0) & (s[:, i] * s[:, k] <= 0) & (s[:, i] != 0)
                for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
            ],
            axis=0,
        )
        rows, order = np.arange(len(torn))[:, None], (alone[:, None] + np.arange(3)) % 3
        (a, b, c), (ha, hb, hc) = np.moveaxis(torn[rows, order], 1, 0), h[rows, order].T
        p, q = a + (ha / (ha - hb))[:, None] * (b - a), a + (ha / (ha - hc))[:, None] * (c - a)
        tip = np.stack([a, p, q], axis=1)
        rest = np.concatenate([np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)])
        twice = np.tile(ha < 0, 2)
        lower += [tip[ha < 0], rest[~twice]]
        upper += [tip[ha > 0], rest[twice]]
    return _with_area(np.concatenate(lower)), _with_area(np.concatenate(upper))


def _with_area(corners: Array) -> Array:
    """Those with three different corners: a corner in the plane of a cut gives triangles without."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return corners[(a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1)]


def split_edges(edges: Array, planes: Array, plane: Array, snap: float) -> list[tuple[Array, Array]]:
    """The edges below and above a plane, cut where they cross it; those in it are resolved."""
    h = _heights(edges, plane, snap)
    halves = []
    for sign in (-1.0, 1.0):
        g = h * sign
        some = (g > 0).any(axis=1)
        kept, g = edges[some].copy(), g[some]
        for end, other in ((0, 1), (1, 0)):
            out = g[:, end] < 0
            share = (g[out, other] / (g[out, other] - g[out, end]))[:, None]
            kept[out, end] = kept[out, other] + share * (kept[out, end] - kept[out, other])
        halves.append((kept, planes[some]))
    return halves


def split_cell(faces: list[Array], plane: Array, snap: float) -> tuple[list[Array], list[Array]]:
    """The faces of a convex cell below and above a plane; the cut itself is a face of both."""
    halves: tuple[list[Array], list[Array]] = ([], [])
    cap: list[Array] = []
    for polygon in faces:
        h = _heights(polygon, plane, snap)
        cap += list(polygon[h == 0])
        parts: tuple[list[Array], list[Array]] = ([], [])
        for i in range(len(polygon)):
            a, b, ha, hb = polygon[i - 1], polygon[i], h[i - 1], h[i]
            if ha * hb < 0:
                crossing = a + ha / (ha - hb) * (b - a)
                cap.append(crossing)
                parts[0].append(crossing)
                parts[1].append(crossing)
            if hb <= 0:
                parts[0].append(b)
            if hb >= 0:
                parts[1].append(b)
        for half, part, there in zip(halves, parts, ((h < 0).any(), (h > 0).any()), strict=True):
            if there and len(part) > 2:
                half.append(np.array(part))
    if len(cap) > 2 and all(halves):
        for half in halves:
            half.append(_around(np.unique(cap, axis=0), plane[:3]))
    return halves


def _around(points: Array, normal: Array) -> Array:
    """The corners (N, 3) of a convex polygon in their order around it."""
    off = points - points.mean(axis=0)
    one = off[np.linalg.norm(off, axis=1).argmax()]
    other = np.cross(normal, one)
    return points[np.argsort(np.arctan2(off @ other, off @ one))]
