"""Triangles as arrays of their corners (F, 3, 3), convex hulls for coal, and the volume that a closed mesh encloses.

Qhull terminates the interpreter on flat points, which are refused here. Coal's meshes are hollow, so a body inside a
mesh is not in contact for coal; :class:`Solid` detects it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, ClassVar, Protocol

import coal
import numpy as np
import numpy.typing as npt

from pinproof._core import Shape as CoreShape
from pinproof._core import first_equal_points, hull_space, surface_parts
from pinproof.errors import InputError
from pinproof.spatial import Array

Indices = npt.NDArray[np.int64]
"""Indices of nodes, or of vertices (F, 3)."""


def with_area(corners: Array) -> tuple[Array, Array, Array]:
    """Return the triangles that have an area, their unit normals (F, 3), and their areas (F,)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(across, axis=1)
    some = twice > 0
    return corners[some], across[some] / twice[some, None], twice[some] / 2


def cut_crossing(corners: Array, heights: Array) -> tuple[Array, Array]:
    """Return the parts below and above a plane of the triangles that cross it, for the heights (F, 3) of corners."""
    crossing = ~((heights <= 0).all(axis=1) | (heights >= 0).all(axis=1))
    cut, h = corners[crossing], heights[crossing]
    # Each triangle is rotated so that its first corner is alone on its side; a corner in the plane counts to the
    # others.
    s = np.sign(h)
    alone = np.argmax(
        [
            (s[:, i] * s[:, j] <= 0) & (s[:, i] * s[:, k] <= 0) & (s[:, i] != 0)
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        ],
        axis=0,
    )
    rows, order = np.arange(len(cut))[:, None], (alone[:, None] + np.arange(3)) % 3
    (a, b, c), (ha, hb, hc) = np.moveaxis(cut[rows, order], 1, 0), h[rows, order].T
    p, q = a + (ha / (ha - hb))[:, None] * (b - a), a + (ha / (ha - hc))[:, None] * (c - a)
    tip = np.stack([a, p, q], axis=1)
    rest = np.concatenate([np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)])
    below = ha < 0
    twice = np.tile(below, 2)
    return np.concatenate([tip[below], rest[~twice]]), np.concatenate([tip[~below], rest[twice]])


def connected_parts(count: int, one: Indices, other: Indices) -> Indices:
    """Return the connected part of each node, numbered by their first nodes; edge k joins one[k] and other[k]."""
    # Of each two labels that an edge joins, the larger is replaced by the smaller, until no edge joins different ones;
    # the label of a part is then its first node. Source: Shiloach and Vishkin (1982), "An O(log n) parallel
    # connectivity algorithm".
    first = np.arange(count)
    while len(one):
        low, high = np.minimum(first[one], first[other]), np.maximum(first[one], first[other])
        apart = low != high
        one, other = one[apart], other[apart]
        np.minimum.at(first, high[apart], low[apart])
        while not np.array_equal(shorter := first[first], first):
            first = shorter
    return np.unique(first, return_inverse=True)[1].reshape(-1)


class PointHull:
    """The convex hull of points: the points on it (V, 3), its faces (none if flat) as planes (E, 4), and its volume."""

    def __init__(self, points: Array) -> None:
        from scipy.spatial import ConvexHull, QhullError

        self.points, self.planes, self.volume = points, np.empty((0, 4)), 0.0
        self.triangles = np.empty((0, 3, 3))
        if len(points) > 3:
            with suppress(QhullError):
                hull = ConvexHull(points)
                self.points, self.planes, self.volume = points[hull.vertices], hull.equations, float(hull.volume)
                self.triangles = points[hull.simplices]

    @cached_property
    def box(self) -> Array:
        """(2, 3) the lower and upper corner of the box around it."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])

    def space(self, points: Array, normals: Array) -> Array:
        """Return how far (m) it is from points (N, 3) in the hull along unit normals (N, 3) to its surface."""
        if len(self.planes) == 0:
            return np.zeros(len(points))
        return hull_space(self.planes, points, normals, -1.0)

    def has_space(self, points: Array, normals: Array, tolerance: float) -> bool:
        """Whether it is farther than ``tolerance`` (m) from any of the points to its surface."""
        return len(self.planes) > 0 and bool((hull_space(self.planes, points, normals, tolerance) > tolerance).any())


FLAT = 1e-6
"""Metres. Points with a smaller extent in some direction are flat: Qhull terminates the interpreter on them."""

FLAT_SHARE = 1e-7
"""The same as a share of the longest side: Qhull crashed at 1e-8 of it (1 um of 100 m) and worked at 1e-7."""

THICKENING = 10.0
"""Thickness of flat points after thickening, as a multiple of the smallest that has a hull: 1e-5 m below 10 m."""


BALL_POINTS = 150
"""Number of corners of the polytope that replaces a ball where a body must be a polytope."""


def convex_hull(points: Array, what: str) -> Any:
    """Return the coal shape of the hull of ``points`` (V, 3); InputError, which names them, if they have none."""
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
    """Return the coal shape of a convex body that contains all ``points`` (V, 3), flat or not."""
    try:
        return convex_hull(points, "a cluster")
    except InputError:  # flat, or Qhull fails: the box along their principal axes, thickened until it has a hull
        centre, axes, low, high = _principal_box(points)
    least = THICKENING * max(FLAT, FLAT_SHARE * float((high - low).max()))
    grow = np.maximum(least - (high - low), 0.0) / 2
    corners = np.array(np.meshgrid(*zip(low - grow, high + grow, strict=True))).reshape(3, 8).T
    return convex_hull(centre + corners @ axes, "a cluster")


def spiral_directions(count: int) -> Array:
    """Return (count, 3) unit vectors that are distributed over the sphere by a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


@cache
def _around_unit_ball() -> Array:
    """Points whose hull contains the unit ball: on a sphere so large that no facet of the hull cuts the ball."""
    from scipy.spatial import ConvexHull

    points = spiral_directions(BALL_POINTS)
    return np.asarray(points / -ConvexHull(points).equations[:, 3].max())


def rounded_corners(points: Array, radius: float) -> Array:
    """Return the corners (V, 3) of a polytope around the hull of points (V, 3), grown by a ball.

    With :data:`BALL_POINTS` it extends at most 3 % of the radius beyond the body.
    """
    return PointHull((points[:, None] + radius * _around_unit_ball()).reshape(-1, 3) if radius else points).points


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

    @property
    def surface(self) -> Array:
        """(F, 3, 3) its triangles; those of a closed surface are oriented."""

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3), in the surface's frame, lies inside."""

    def content(self) -> bytes:
        """Return its defining numbers, for a hash."""


def core_mesh(solid: Inside) -> CoreShape:
    """Return the triangles as the compiled core uses them."""
    surface, witnesses = solid.surface, np.ascontiguousarray(solid.witnesses, dtype=float)
    return CoreShape.mesh(surface.reshape(-1, 9), witnesses, solid.watertight, box_of(surface))


@dataclass(frozen=True, eq=False)
class Solid:
    """A triangle mesh, of vertices (V, 3) and triangles (F, 3), as a solid.

    A part is what is connected over edges between two triangles. A closed part is solid, independently of the
    orientation of its triangles. A part with the opposite orientation of the whole mesh is a cavity if it is inside a
    solid part and does not touch any other part. Otherwise it is a solid part with inverted triangles; without this
    rule, the overlap of two such parts would count as outside. A ``hollow`` mesh is a surface without an inside.
    """

    vertices: Array
    triangles: Indices
    hollow: bool = False
    watertight: bool = field(init=False)
    """Whether every edge of a part joins exactly two of its triangles, once in each direction."""
    witnesses: Array = field(init=False)
    """(K, 3) one vertex of each part."""
    corners: Array = field(init=False, repr=False)
    """(F, 3, 3) the triangles with three different corners; solid parts of a watertight mesh are oriented outwards."""
    surface: Array = field(init=False, repr=False)
    """(F, 3, 3) the triangles of ``corners``, and those with equal corners, which enclose nothing."""
    solids: tuple[Array, ...] = field(init=False, repr=False)
    """The triangles of bodies whose union is the volume: of each part; of all if the mesh has cavities or no inside."""

    def __post_init__(self) -> None:
        # Files such as STL repeat each corner for every triangle; equal corners are one vertex.
        points = np.ascontiguousarray(self.vertices, dtype=float)
        faces = first_equal_points(points)[self.triangles]
        proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        flat, faces = (faces[~proper], faces[proper]) if not proper.all() else (faces[:0], faces)
        # Parts are connected over edges between two triangles, and closed if all edges are. Bodies that touch, or share
        # vertices or edges, are separate parts.
        labels, all_closed = surface_parts(faces)
        order = np.argsort(labels, kind="stable")
        parts = np.split(order, np.flatnonzero(np.diff(labels[order])) + 1) if len(faces) else []
        closed = all_closed and not self.hollow
        object.__setattr__(self, "watertight", closed)
        object.__setattr__(self, "witnesses", points[[faces[part[0], 0] for part in parts]])
        # Solid parts are oriented outwards, and cavities, which are inside of a solid part, inwards.
        corners, cavities = points[faces], False
        if closed:
            sixfold = _sixfold_volumes(corners)
            volume = np.array([sixfold[part].sum() / 6 for part in parts])
            if volume.sum() < 0:
                corners, volume = corners[:, ::-1], -volume
            for k in sorted(
                np.flatnonzero(volume < 0), key=lambda k: float(volume[k])
            ):  # large parts contain small ones
                others = np.concatenate([part for i, part in enumerate(parts) if i != k])
                within = winding_number(corners[parts[k][0], 0], corners[others]) > 0.5
                if not within or _touch(corners[parts[k]], corners[others]):
                    corners[parts[k]] = corners[parts[k], ::-1]
                else:
                    cavities = True
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "surface", np.concatenate([corners, points[flat]]) if len(flat) else corners)
        for array in (self.witnesses, self.corners, self.surface):
            array.setflags(write=False)
        solids = (
            [self.corners[part] for part in parts] if closed and not cavities and len(parts) > 1 else [self.corners]
        )
        object.__setattr__(self, "solids", tuple(solids))

    @cached_property
    def core_shape(self) -> CoreShape:
        """The triangles as the compiled core uses them, shared by all bodies of this mesh."""
        return core_mesh(self)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "core_shape"}

    def contains(self, points: Array) -> bool:
        """Whether any of the points (N, 3), in the mesh's frame, lies inside; never if the mesh is not watertight."""
        return bool(self.core_shape.contains(np.ascontiguousarray(points, dtype=float)).any())

    def content(self) -> bytes:
        """Return its defining numbers, for a hash."""
        return self.vertices.tobytes() + self.triangles.tobytes() + bytes([self.hollow])


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles (F, 3, 3) without an inside, such as a part of a mesh; its witnesses are a corner of each."""

    surface: Array
    watertight: ClassVar[bool] = False

    @cached_property
    def core_shape(self) -> CoreShape:
        """The triangles as the compiled core uses them, shared by all bodies of this surface."""
        return core_mesh(self)

    @property
    def witnesses(self) -> Array:
        """(F, 3) a corner of each triangle."""
        return np.asarray(self.surface[:, 0])

    def contains(self, points: Array) -> bool:  # noqa: ARG002
        """Return False: nothing is inside."""
        return False

    def content(self) -> bytes:
        """Return its defining numbers, for a hash."""
        return self.surface.tobytes()


def box_of(corners: Array) -> Array:
    """(2, 3) the least and the greatest coordinates of triangles (F, 3, 3)."""
    sides = corners.reshape(-1, 3).T  # NumPy takes a third of the time for each coordinate by itself
    return np.array([[x.min() for x in sides], [x.max() for x in sides]])


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


def _sixfold_volumes(corners: Array) -> Array:
    """(F,) six times the volume between each triangle (F, 3, 3) and their middle, from which less is cancelled."""
    a, b, c = np.moveaxis(corners - corners[:, 0].mean(axis=0), 0, 2)
    return np.asarray(sum(a[k] * (b[i] * c[j] - b[j] * c[i]) for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1))))


def _touch(a: Array, b: Array) -> bool:
    """Whether two sets of triangles (F, 3, 3) share a point."""
    here = coal.Transform3s.Identity()
    models = [bvh(t.reshape(-1, 3), np.arange(3 * len(t)).reshape(-1, 3)) for t in (a, b)]
    return bool(coal.collide(models[0], here, models[1], here, coal.CollisionRequest(), coal.CollisionResult()))
