"""What is inside a closed mesh: coal's meshes are hollow, so a body wholly inside one does not touch it there."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import coal
import numpy as np
import numpy.typing as npt

from pinproof.collision.hulls import bvh

__all__ = ["Inside", "Solid", "winding_number"]

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]


class Inside(Protocol):
    """What a surface encloses."""

    @property
    def watertight(self) -> bool:
        """Whether it encloses anything; if not, the surface is hollow."""

    @property
    def witnesses(self) -> Array:
        """(K, 3) a point of each connected part: if no surfaces cross, a part is inside a body if this point is."""

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3), in the surface's frame, lies inside."""

    def content(self) -> bytes:
        """The numbers it is made of."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A triangle mesh seen as a solid.

    A closed part is solid, whichever way its triangles turn. A part that turns the other way than the mesh as a whole
    is a cavity if it lies in a solid part without touching any other part; if not, it is a body whose triangles turn
    the wrong way, and just as solid: else what two such parts share would cancel out and count as outside.

    Parameters
    ----------
    vertices, triangles
        (V, 3) metres and (F, 3) indices.
    hollow
        Take it as a bare surface, watertight or not.
    watertight
        Whether every edge joins exactly two triangles, once in each direction; if not, there is no inside.
    witnesses
        (K, 3) one vertex of each connected part.
    corners
        (F, 3, 3) the triangles that have three different corners; of a watertight mesh, solid parts turned outwards.
    """

    vertices: Array
    triangles: Triangles
    hollow: bool = False
    watertight: bool = field(init=False)
    witnesses: Array = field(init=False)
    corners: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # Files such as STL repeat each corner for every triangle; equal corners are one vertex.
        points, index = np.unique(self.vertices, axis=0, return_inverse=True)
        faces = index.reshape(-1)[self.triangles]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
        parts = _parts(faces, len(points))
        closed = not self.hollow and _closed(faces, len(points))
        object.__setattr__(self, "watertight", closed)
        object.__setattr__(self, "witnesses", points[[faces[part[0], 0] for part in parts]])
        object.__setattr__(self, "corners", _oriented(points, faces, parts) if closed else points[faces])

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3), in the mesh's frame, lies inside; never if the mesh is not watertight."""
        if not self.watertight:
            return False
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        near = points[np.all((points >= low) & (points <= high), axis=1)]
        return any(abs(winding_number(point, self.corners)) > 0.5 for point in near)

    def content(self) -> bytes:
        """The numbers it is made of."""
        return self.vertices.tobytes() + self.triangles.tobytes() + bytes([self.hollow])


def winding_number(point: Array, corners: Array) -> float:
    """How often the surface of triangles (F, 3, 3) winds about a point (3,): +-1 inside a closed surface, 0 outside.

    Sum of the signed solid angles of the triangles over 4 pi (van Oosterom and Strackee, 1983, "The solid angle of a
    plane triangle", equation 8; Jacobson and others, 2013, for its use as an inside test).
    """
    a, b, c = np.moveaxis(corners - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", u, v) for u, v in ((b, c), (c, a), (a, b))]
    solid_angles = 2.0 * np.arctan2(triple, la * lb * lc + dots[0] * la + dots[1] * lb + dots[2] * lc)
    return float(solid_angles.sum() / (4.0 * np.pi))


def _closed(faces: Triangles, count: int) -> bool:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there = edges[:, 0] * count + edges[:, 1]
    back = edges[:, 1] * count + edges[:, 0]
    return len(there) > 0 and len(np.unique(there)) == len(there) and bool(np.isin(there, back).all())


def _parts(faces: Triangles, count: int) -> list[npt.NDArray[np.int64]]:
    """The faces of each connected part, as indices."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows, columns = np.concatenate([faces[:, 0], faces[:, 1]]), np.concatenate([faces[:, 1], faces[:, 2]])
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1][faces[:, 0]]
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1) if len(order) else []


def _oriented(points: Array, faces: Triangles, parts: list[npt.NDArray[np.int64]]) -> Array:
    """The triangles (F, 3, 3), solid parts turned outwards and cavities inwards."""
    corners = points[faces]
    corners = corners - corners.mean(axis=(0, 1))  # volumes far from the origin drown in rounding
    volume = np.array([np.linalg.det(corners[part]).sum() / 6 for part in parts])
    corners = points[faces]
    if volume.sum() < 0:
        corners, volume = corners[:, ::-1], -volume
    for k in sorted(
        np.flatnonzero(volume < 0), key=lambda k: float(volume[k])
    ):  # large ones first: they hold small ones
        others = np.concatenate([part for i, part in enumerate(parts) if i != k])
        within = winding_number(corners[parts[k][0], 0], corners[others]) > 0.5
        if not within or _touch(corners[parts[k]], corners[others]):
            corners[parts[k]] = corners[parts[k], ::-1]
    return corners


def _touch(a: Array, b: Array) -> bool:
    """Whether two sets of triangles (F, 3, 3) share a point."""
    here = coal.Transform3s.Identity()
    models = [bvh(t.reshape(-1, 3), np.arange(3 * len(t)).reshape(-1, 3)) for t in (a, b)]
    return bool(coal.collide(models[0], here, models[1], here, coal.CollisionRequest(), coal.CollisionResult()))
