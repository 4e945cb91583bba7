"""Convex hulls for coal, and the volume that a closed mesh encloses.

Qhull terminates the interpreter on flat points, which are refused here. Coal's meshes are hollow, so a body inside a
mesh is not in contact for coal; :class:`Solid` detects it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import coal
import numpy as np
import numpy.typing as npt

from pinproof.collision.geometry.triangles import connected_parts
from pinproof.errors import InputError
from pinproof.spatial import Array

Triangles = npt.NDArray[np.int64]
"""Indices of vertices (F, 3)."""

FLAT = 1e-6
"""Metres. Points with a smaller extent in some direction are flat: Qhull terminates the interpreter on them."""

FLAT_SHARE = 1e-7
"""The same as a share of the longest side: Qhull crashed at 1e-8 of it (1 um of 100 m) and worked at 1e-7."""

THICKENING = 10.0
"""Thickness of flat points after thickening, as a multiple of the smallest that has a hull: 1e-5 m below 10 m."""


def convex_hull(points: Array, what: str) -> Any:
    """Return the coal shape of the hull of ``points`` (V, 3); ``what`` names them in errors.

    InputError if they are flat, or Qhull or coal fails.
    """
    refuse_flat(points, what)
    # buildConvexRepresentation would only label a mesh as convex and miss collisions; this computes the hull (Qhull).
    surface = bvh(points, np.array([[0, 1, 2]]))
    try:
        surface.buildConvexHull(True, "Qt")
    except RuntimeError as error:
        raise InputError(f"{what} has no hull that coal can use ({error})") from error
    return surface.convex


def hull_triangles(points: Array) -> npt.NDArray[np.int64]:
    """Return (F, 3) the triangles of the hull of ``points`` (V, 3), not flat, counterclockwise seen from outside."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    corners = points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0
    return np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices).astype(np.int64)


def hull_of_any(points: Array) -> Any:
    """Return the coal shape of a convex body that contains all ``points`` (V, 3), flat or not.

    It is their hull. If they are flat or Qhull fails, it is the box around them along their principal axes, thickened
    to :data:`THICKENING` times the smallest thickness that has a hull.
    """
    try:
        return convex_hull(points, "a cluster")
    except InputError:
        centre, axes, low, high = _principal_box(points)
    least = THICKENING * max(FLAT, FLAT_SHARE * float((high - low).max()))
    grow = np.maximum(least - (high - low), 0.0) / 2
    corners = np.array(np.meshgrid(*zip(low - grow, high + grow, strict=True))).reshape(3, 8).T
    return convex_hull(centre + corners @ axes, "a cluster")


def refuse_flat(points: Array, what: str) -> None:
    """Raise InputError if points (V, 3) have no hull: they lie in a plane, nearly so, or are too few."""
    if len(points) == 0:
        raise InputError(f"{what} is empty, so it has no hull")
    _, _, low, high = _principal_box(points)
    sides = high - low
    if len(points) < 4 or sides.min() < max(FLAT, FLAT_SHARE * float(sides.max())):
        raise InputError(f"{what} is flat ({sides.min():.1g} m thick), so it has no hull")


def bvh(vertices: Array, triangles: npt.NDArray[np.int64]) -> Any:
    """Return a coal mesh of triangles."""
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addVertices(np.ascontiguousarray(vertices))
    model.addTriangles(np.ascontiguousarray(triangles, dtype=np.int64))
    model.endModel()
    return model


def _principal_box(points: Array) -> tuple[Array, Array, Array, Array]:
    """Return centre (3,), principal axes as rows (3, 3), and the extreme coordinates (3,) of points along them."""
    centre = points.mean(axis=0)
    # The right singular vectors of the centred points are the eigenvectors of their 3 x 3 scatter; QR keeps accuracy.
    triangle = np.linalg.qr(np.concatenate([points - centre, np.zeros((3, 3))]), mode="r")
    axes = np.linalg.svd(triangle)[2]
    along = (points - centre) @ axes.T
    return centre, axes, along.min(axis=0), along.max(axis=0)


class Inside(Protocol):
    """The volume that a surface encloses, as a protocol of all kinds of surfaces."""

    @property
    def watertight(self) -> bool:
        """Whether it encloses a volume; otherwise it is only a surface."""

    @property
    def witnesses(self) -> Array:
        """(K, 3) a point of each connected part: if no surfaces cross, a part is inside a body if this point is."""

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3), in the surface's frame, lies inside."""

    def content(self) -> bytes:
        """Return its defining numbers, for a hash."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A triangle mesh as a solid.

    A part is what is connected over edges between two triangles. A closed part is solid, independently of the
    orientation of its triangles. A part with the opposite orientation of the whole mesh is a cavity if it is inside a
    solid part and does not touch any other part. Otherwise it is a solid part with inverted triangles; without this
    rule, the overlap of two such parts would count as outside.

    Parameters
    ----------
    vertices, triangles
        (V, 3) metres and (F, 3) indices.
    hollow
        Treat it as a surface without an inside, watertight or not.
    watertight
        Whether every edge of a part joins exactly two of its triangles, once in each direction; if not, there is no
        inside.
    witnesses
        (K, 3) one vertex of each part.
    corners
        (F, 3, 3) the triangles with three different corners; solid parts of a watertight mesh are oriented outwards.
    box
        (2, 3) the least and the greatest coordinates of a watertight mesh.
    solids
        The triangles of bodies whose union is the volume: of each part; of all if the mesh has cavities or no inside.
    """

    vertices: Array
    triangles: Triangles
    hollow: bool = False
    watertight: bool = field(init=False)
    witnesses: Array = field(init=False)
    corners: Array = field(init=False, repr=False)
    box: Array = field(init=False, repr=False)
    solids: tuple[Array, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # Files such as STL repeat each corner for every triangle; equal corners are one vertex.
        points, index = np.unique(self.vertices, axis=0, return_inverse=True)
        faces = index.reshape(-1)[self.triangles]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
        edges = _HullEdges.of(faces, len(points))
        parts = edges.parts(len(faces))
        closed = not self.hollow and edges.closed(parts)
        object.__setattr__(self, "watertight", closed)
        object.__setattr__(self, "witnesses", points[[faces[part[0], 0] for part in parts]])
        corners, separate = _oriented(points, faces, parts) if closed else (points[faces], False)
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "box", box_of(corners) if closed else np.full((2, 3), np.nan))
        for array in (self.witnesses, self.corners, self.box):
            array.setflags(write=False)
        solids = [self.corners[part] for part in parts] if separate and len(parts) > 1 else [self.corners]
        object.__setattr__(self, "solids", tuple(solids))

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3), in the mesh's frame, lies inside; never if the mesh is not watertight."""
        return self.watertight and inside(points, self.corners, self.box)

    def content(self) -> bytes:
        """Return its defining numbers, for a hash."""
        return self.vertices.tobytes() + self.triangles.tobytes() + bytes([self.hollow])


def box_of(corners: Array) -> Array:
    """(2, 3) the least and the greatest coordinates of triangles (F, 3, 3)."""
    return np.array([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])


def inside(points: Array, corners: Array, box: Array) -> bool:
    """Whether any of the points (N, 3) lies inside the closed surface of triangles (F, 3, 3) with a bounding box."""
    near = points[np.all((points >= box[0]) & (points <= box[1]), axis=1)]
    return any(abs(winding_number(point, corners)) > 0.5 for point in near)


def winding_number(point: Array, corners: Array) -> float:
    """Return the winding number of triangles (F, 3, 3) about a point (3,): +-1 inside a closed surface, 0 outside.

    Sum of the signed solid angles of the triangles over 4 pi (van Oosterom and Strackee, 1983, "The solid angle of a
    plane triangle", equation 8; Jacobson and others, 2013, for its use as an inside test).
    """
    a, b, c = np.moveaxis(corners - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", u, v) for u, v in ((b, c), (c, a), (a, b))]
    solid_angles = 2.0 * np.arctan2(triple, la * lb * lc + dots[0] * la + dots[1] * lb + dots[2] * lc)
    return float(solid_angles.sum() / (4.0 * np.pi))


@dataclass(frozen=True, eq=False)
class _HullEdges:
    """The three edges of each triangle (3 F,): the triangle, the number of the edge, and +-1 for the direction."""

    face: Triangles
    number: Triangles
    direction: Triangles

    @classmethod
    def of(cls, faces: Triangles, count: int) -> _HullEdges:
        ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        number = np.unique(ends.min(axis=1) * count + ends.max(axis=1), return_inverse=True)[1].reshape(-1)
        return cls(np.tile(np.arange(len(faces)), 3), number, np.where(ends[:, 0] < ends[:, 1], 1, -1))

    def parts(self, count: int) -> list[Triangles]:
        """Return the triangles of each part, as indices of the ``count`` triangles.

        Bodies that touch, or share vertices or edges, are separate parts: an edge of more than two triangles, or of two
        in the same direction, does not connect them.
        """
        order = np.argsort(self.number, kind="stable")
        begins = np.flatnonzero(np.diff(self.number[order], prepend=-1))
        two = begins[np.diff(begins, append=len(order)) == 2]
        one, other = order[two], order[two + 1]
        joined = self.direction[one] != self.direction[other]
        labels = connected_parts(count, self.face[one[joined]], self.face[other[joined]])
        order = np.argsort(labels, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1) if count else []

    def closed(self, parts: list[Triangles]) -> bool:
        """Whether every edge of a part joins exactly two of its triangles, once in each direction."""
        label = np.empty(len(self.face) // 3, dtype=np.int64)
        for k, part in enumerate(parts):
            label[part] = k
        key = label[self.face] * (self.number.max(initial=0) + 1) + self.number
        edge = np.unique(key, return_inverse=True)[1].reshape(-1)
        return len(parts) > 0 and bool((np.bincount(edge) == 2).all()) and not np.bincount(edge, self.direction).any()


def _oriented(points: Array, faces: Triangles, parts: list[Triangles]) -> tuple[Array, bool]:
    """Return triangles (F, 3, 3), solid parts oriented outwards and cavities inwards, and whether no cavity exists."""
    corners = points[faces]
    corners = corners - corners.mean(axis=(0, 1))  # avoids cancellation far from the origin
    volume = np.array([np.linalg.det(corners[part]).sum() / 6 for part in parts])
    corners = points[faces]
    if volume.sum() < 0:
        corners, volume = corners[:, ::-1], -volume
    cavities = False
    for k in sorted(np.flatnonzero(volume < 0), key=lambda k: float(volume[k])):  # large parts contain small ones
        others = np.concatenate([part for i, part in enumerate(parts) if i != k])
        within = winding_number(corners[parts[k][0], 0], corners[others]) > 0.5
        if not within or _touch(corners[parts[k]], corners[others]):
            corners[parts[k]] = corners[parts[k], ::-1]
        else:
            cavities = True
    return corners, not cavities


def _touch(a: Array, b: Array) -> bool:
    """Whether two sets of triangles (F, 3, 3) share a point."""
    here = coal.Transform3s.Identity()
    models = [bvh(t.reshape(-1, 3), np.arange(3 * len(t)).reshape(-1, 3)) for t in (a, b)]
    return bool(coal.collide(models[0], here, models[1], here, coal.CollisionRequest(), coal.CollisionResult()))
