"""Surfaces as a renderer wants them: welded triangles with normals that are smooth over curves and sharp at edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

__all__ = ["Rgba", "Surface", "merge_by_colour", "shade"]

Array = npt.NDArray[np.float64]
Rgba = tuple[float, float, float, float]

CREASE = np.deg2rad(38.0)
"""Neighbouring faces that meet at a larger angle (rad) keep a sharp edge: a 16-sided cylinder's sides bend by 22
degrees, the smallest chamfers of machined parts by 45."""

WELD_GRID = 1e-5
"""Metres. Vertices that fall on the same point of this grid are one; a hundredth of a millimetre is never seen."""


UV_GRID = 1 / 8192
"""Of a picture's side: less than a pixel of any that is shown."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one colour.

    Parameters
    ----------
    vertices
        (V, 3) in metres.
    normals
        (V, 3) of unit length, outwards where the triangles turn counter-clockwise seen from outside.
    triangles
        (F, 3) indices of vertices.
    rgba
        0 to 1; of a surface with a picture on it, what the picture's colours are multiplied by.
    uv
        (V, 2) where on the picture each vertex lies, from 0 to 1, from its lower left corner.
    image
        The picture, as a ``data:`` address.
    """

    vertices: Array
    normals: Array
    triangles: npt.NDArray[np.int64]
    rgba: Rgba
    uv: Array | None = None
    image: str | None = None

    def moved(self, a_from_b: Array) -> Surface:
        """The same surface after a rigid transform (4, 4)."""
        rotation, shift = a_from_b[:3, :3], a_from_b[:3, 3]
        return replace(self, vertices=self.vertices @ rotation.T + shift, normals=self.normals @ rotation.T)


def shade(
    vertices: Array, triangles: npt.NDArray[np.int64], rgba: Rgba, uv: Array | None = None, image: str | None = None
) -> Surface:
    """Weld vertices and give each a normal, split where the surface has a crease.

    The corners of the triangles are the nodes of a graph. Two faces that share an edge and meet at less than
    :data:`CREASE` have their corners joined at both ends of it. Each connected set of corners becomes one vertex; its
    normal is the mean of its faces' normals, weighted by area. With a picture (``uv`` (V, 2) and ``image``) it is
    split further, where the picture has a seam.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    grid = np.rint(vertices / WELD_GRID).astype(np.int64)
    _, first, welded = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    points, faces = vertices[first], welded.reshape(-1)[triangles]
    # cross products have twice the area as length, so sums of them are weighted by area
    cross = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    area = np.linalg.norm(cross, axis=1)
    solid = area > 1e-14  # slivers have no direction
    faces, cross, area = faces[solid], cross[solid], area[solid]
    unit = cross / area[:, None]

    # every face has three edges; corner k is the edge's start, corner (k + 1) % 3 its end
    count = len(faces)
    corner = np.arange(3 * count).reshape(count, 3)
    starts, ends = faces, np.roll(faces, -1, axis=1)
    flipped = (starts > ends).ravel()
    low_corner = np.where(flipped, np.roll(corner, -1, axis=1).ravel(), corner.ravel())
    high_corner = np.where(flipped, corner.ravel(), np.roll(corner, -1, axis=1).ravel())
    edge = np.minimum(starts, ends).ravel() * np.int64(len(points)) + np.maximum(starts, ends).ravel()
    order = np.argsort(edge, kind="stable")
    here, there = order[:-1], order[1:]
    shared = edge[here] == edge[there]
    here, there = here[shared], there[shared]
    soft = np.einsum("ij,ij->i", unit[here // 3], unit[there // 3]) > np.cos(CREASE)
    here, there = here[soft], there[soft]
    rows = np.concatenate([low_corner[here], high_corner[here]])
    columns = np.concatenate([low_corner[there], high_corner[there]])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(3 * count, 3 * count))
    total, label = connected_components(graph, directed=False)

    normals = np.zeros((total, 3))
    np.add.at(normals, label, np.repeat(cross, 3, axis=0))
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, size, out=np.zeros_like(normals), where=size > 0)
    positions = np.zeros((total, 3))
    positions[label] = points[faces.ravel()]
    if uv is None or image is None:
        return Surface(positions, normals, label.reshape(count, 3).astype(np.int64), rgba)
    spots = np.column_stack([label, np.rint(uv[triangles[solid]].reshape(-1, 2) / UV_GRID).astype(np.int64)])
    spots, vertex = np.unique(spots, axis=0, return_inverse=True)
    kind = spots[:, 0]
    corners = vertex.reshape(count, 3).astype(np.int64)
    return Surface(positions[kind], normals[kind], corners, rgba, spots[:, 1:] * UV_GRID, image)


def merge_by_colour(surfaces: Sequence[Surface]) -> list[Surface]:
    """One surface for each colour or picture, in the order of their first appearance: fewer objects draw faster."""
    groups: dict[tuple[Rgba, str | None], list[Surface]] = {}
    for surface in surfaces:
        groups.setdefault((surface.rgba, surface.image), []).append(surface)
    merged = []
    for (rgba, image), group in groups.items():
        offsets = np.cumsum([0, *(len(s.vertices) for s in group[:-1])])
        triangles = np.concatenate([s.triangles + o for s, o in zip(group, offsets, strict=True)])
        vertices, normals = np.concatenate([s.vertices for s in group]), np.concatenate([s.normals for s in group])
        uv = None if image is None else np.concatenate([s.uv for s in group if s.uv is not None])
        merged.append(Surface(vertices, normals, triangles, rgba, uv, image))
    return merged
