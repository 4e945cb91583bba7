"""What is inside a closed mesh: coal's meshes are hollow, so a body wholly inside one does not touch it there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

__all__ = ["Solid", "winding_number"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solid:
    """A triangle mesh seen as a solid.

    Parameters
    ----------
    vertices, triangles
        (V, 3) metres and (F, 3) indices.
    watertight
        Whether every edge joins exactly two triangles, once in each direction; if not, there is no inside.
    witnesses
        (K, 3) one vertex of each connected part: if no surfaces cross, a part is inside another body if its vertex is.
    """

    vertices: Array
    triangles: npt.NDArray[np.int64]
    watertight: bool = field(init=False)
    witnesses: Array = field(init=False)

    def __post_init__(self) -> None:
        # Files such as STL repeat each corner for every triangle; equal corners are one vertex.
        points, index = np.unique(self.vertices, axis=0, return_inverse=True)
        faces = index.reshape(-1)[self.triangles]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
        object.__setattr__(self, "watertight", _closed(faces, len(points)))
        object.__setattr__(self, "witnesses", points[_first_of_each_part(faces, len(points))])

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3), in the mesh's frame, lies inside; never if the mesh is not watertight."""
        if not self.watertight:
            return False
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        near = points[np.all((points >= low) & (points <= high), axis=1)]
        corners = self.vertices[self.triangles]
        return any(abs(winding_number(point, corners)) > 0.5 for point in near)


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


def _closed(faces: npt.NDArray[np.int64], count: int) -> bool:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there = edges[:, 0] * count + edges[:, 1]
    back = edges[:, 1] * count + edges[:, 0]
    return len(there) > 0 and len(np.unique(there)) == len(there) and bool(np.isin(there, back).all())


def _first_of_each_part(faces: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows, columns = np.concatenate([faces[:, 0], faces[:, 1]]), np.concatenate([faces[:, 1], faces[:, 2]])
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    used = np.unique(faces)
    return used[np.unique(labels[used], return_index=True)[1]]
