"""Bodies that can touch: links, attached objects and obstacles as coal shapes, each with what bounds it.

A convex body carries its support function, from which the certificate proves distances whether or not GJK converged; an
exact mesh carries the points that tell whether it lies inside another (coal's meshes are hollow).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.convex_pieces import SAMPLES, convex_pieces
from pinproof.collision.height_map import Ground, ground_surface
from pinproof.collision.hulls import bvh, convex_hull, hull_of_any
from pinproof.collision.point_cloud import Cells, cell_faces
from pinproof.collision.shapes import (
    Box,
    Capsule,
    Cone,
    ConvexHull,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    HeightMap,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from pinproof.collision.solid import Inside, Solid
from pinproof.description.meshes import TriangleMesh, read_mesh
from pinproof.errors import InputError, MeshError
from pinproof.spatial import frozen, matrix

__all__ = [
    "MESHES_KEPT", "Body", "FileStamp", "Support", "boxes", "hull_body", "shape_bodies", "shape_body", "triangles_of",
]  # fmt: skip

Array = npt.NDArray[np.float64]

MESHES_KEPT = 128
"""Mesh files of which the hull, or the solid, is kept for the next checker with the same link or obstacle."""

MOST_PIECES = 64
"""Convex pieces of a mesh at most. Beside a bin of 29 pieces, checks of a UR5 take 1.1 times and certificates 1.4 times
as long as beside the bin's hull; beside its triangles 6 and 10 times, and such proofs cannot be saved."""

MOST_EXCESS = 1e-3
"""Metres that convex pieces may reach beyond a mesh: less than the margin a robot cell needs anyway. Where they would
reach farther, the triangles are used."""

DEEP = 0.5 * MOST_EXCESS
"""Metres beneath the hull at which a surface counts as part of it; a mesh with nothing deeper counts as convex."""

CORNERS = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
"""Those of a box of half sides 1."""


class FileStamp(NamedTuple):
    """A file as it was when it was read."""

    path: Path
    changed: int
    size: int

    @classmethod
    def of(cls, path: str | Path) -> FileStamp | None:
        """Of a file as it is now; None where there is none."""
        path = Path(path).absolute()
        try:
            status = path.stat()
        except OSError:
            return None
        return cls(path, status.st_mtime_ns, status.st_size)


@dataclass(frozen=True, eq=False)
class Support:
    """The support function of a convex body: how far it reaches in a direction.

    The body is the hull of ``points`` (V, 3), each with a flat disc of ``disc_radii`` (V,) about z, grown by a ball of
    ``radius`` and by an ellipsoid of ``semi_axes`` (3,) along x, y, z (Minkowski sums; metres). So it covers spheres
    (one point), capsules (two), ellipsoids (one), cylinders (two discs), cones (a disc and a point), boxes and hulls
    exactly.
    """

    points: Array
    radius: float = 0.0
    disc_radii: Array = None  # type: ignore[assignment]  # zeros
    semi_axes: Array = None  # type: ignore[assignment]  # zeros

    def __post_init__(self) -> None:
        if self.disc_radii is None:
            object.__setattr__(self, "disc_radii", np.zeros(len(self.points)))
        if self.semi_axes is None:
            object.__setattr__(self, "semi_axes", np.zeros(3))
        for array in (self.points, self.disc_radii, self.semi_axes):
            array.setflags(write=False)

    def reach(self, directions: Array) -> Array:
        """(...) the largest ``direction . x`` over the body, for directions (..., 3) of any length in its own frame.

        max_v (p_v . d + disc_v hypot(d_x, d_y)) + radius |d| + |semi_axes * d|: supports of Minkowski sums add up (R.
        T. Rockafellar, 1970, "Convex analysis", corollary 16.4.1), that of a hull of unions is their maximum.
        """
        flat = np.sqrt((directions[..., :2] ** 2).sum(axis=-1))
        reach = (directions @ self.points.T + flat[..., None] * self.disc_radii).max(axis=-1)
        length = np.sqrt((directions**2).sum(axis=-1))
        return np.asarray(reach + self.radius * length + np.sqrt(((self.semi_axes * directions) ** 2).sum(axis=-1)))


@dataclass(frozen=True, eq=False)
class Body:
    """Something that can touch.

    Parameters
    ----------
    name
        Unique among the bodies: the geometry of a link (``forearm_link_0``), an attached object or an obstacle.
    owner
        The link, attached object or obstacle it belongs to: what messages name.
    link
        The robot link it moves with; None for an obstacle.
    geometry
        The coal shape, in the body's own frame.
    link_from_body
        Where it is fixed on its link; root_from_body for an obstacle.
    box
        (2, 3) lower and upper corner of the box around it, in its own frame.
    support
        Its support function; None for an exact mesh.
    solid
        What it encloses, where coal alone would not see what lies wholly inside. None for what is convex.
    remark
        What was done with it that its maker may not expect, for people to read.
    source
        The collision geometry of a link, or the obstacle or attached object, that it is one of several bodies of.
    level
        How finely: 0 as told; else it stands for the bodies as told of its source, in the pairs that call for it.
    file
        The mesh file it was read from, with its time and size then.
    """

    name: str
    owner: str
    link: str | None
    geometry: Any
    link_from_body: pin.SE3
    box: Array
    support: Support | None
    solid: Inside | None = None
    remark: str = ""
    source: str = ""
    level: int = 0
    file: FileStamp | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "link_from_body", frozen(self.link_from_body))
        self.box.setflags(write=False)

    @property
    def witnesses(self) -> Array:
        """(K, 3) points of it that all lie in a surface it lies in; none of a half-space, which fits into nothing."""
        if self.solid is not None:
            return self.solid.witnesses
        return np.empty((0, 3)) if self.support is None else self.support.points[:1]

    def content(self) -> bytes:
        """All that its verdicts depend on, for a fingerprint; its name and its colour are no part of it."""
        parts = [repr((type(self.geometry).__name__, self.owner, self.link, self.level)).encode(), self.box.tobytes()]
        parts.append(matrix(self.link_from_body).tobytes())
        if self.support is not None:
            s = self.support
            parts += [s.points.tobytes(), repr(s.radius).encode(), s.disc_radii.tobytes(), s.semi_axes.tobytes()]
        if self.solid is not None:
            parts.append(self.solid.content())
        return b"|".join(parts)

    @property
    def extent(self) -> float:
        """How far (m) its numbers reach: of its box where that ends, and from its link, or the root, to its origin."""
        sides = [abs(x) for corner in self.box.tolist() for x in corner if math.isfinite(x)]
        return max(sides, default=0.0) + math.dist((0, 0, 0), self.link_from_body.translation)


def shape_bodies(name: str, link: str | None, shape: Shape, link_from_body: pin.SE3) -> list[Body]:
    """The bodies of an obstacle or attached object: several for a mesh that is covered by convex pieces, else one.

    Raises
    ------
    MeshError, InputError
        As :func:`shape_body` does.
    """
    if not isinstance(shape, Mesh) or shape.hull is not None:
        return [shape_body(name, name, link, shape, link_from_body)]
    made, remark = _own_shape(shape)
    if len(made) == 1:
        return [Body(name, name, link, made[0][0], link_from_body.copy(), *made[0][1:], remark)]
    return [
        Body(f"{name}_part_{i}", name, link, part[0], link_from_body.copy(), *part[1:], remark, source=name)
        for i, part in enumerate(made)
    ]


def shape_body(name: str, owner: str, link: str | None, shape: Shape, link_from_body: pin.SE3) -> Body:
    """A body of any shape.

    Raises
    ------
    MeshError
        If a mesh is unreadable, or cannot be what it is asked to be.
    InputError
        If points have no hull, or a half-space is to move with a link.
    """
    file = FileStamp.of(shape.path) if isinstance(shape, Mesh) and shape.path is not None else None
    geometry, box, support, solid = _made(shape, owner, link)
    return Body(name, owner, link, geometry, link_from_body, box, support, solid, _remark(shape, solid), file=file)


def _remark(shape: Shape, solid: Inside | None) -> str:
    if isinstance(shape, Mesh) and shape.hull:
        return "taken as the convex hull of the mesh"
    if isinstance(shape, PointCloud):
        return f"points of a sensor in cells of {shape.resolution:g} m; what no point told of is free"
    return "" if solid is None or solid.watertight else "not watertight, so hollow: being wholly inside is not seen"


def hull_body(name: str, link: str, points: Array, link_from_body: pin.SE3, remark: str = "") -> Body:
    """The body of a link that is a convex hull holding ``points`` (V, 3), which may be flat."""
    geometry = hull_of_any(points)
    corners = np.array(geometry.points(), dtype=float)
    box = np.array([corners.min(axis=0), corners.max(axis=0)])
    return Body(name, link, link, geometry, link_from_body, box, Support(corners), remark=remark)


Made = tuple[Any, Array, Support | None, Inside | None]
"""Coal shape, box (2, 3), support, inside."""


def _made(shape: Shape, owner: str, link: str | None) -> Made:
    if isinstance(shape, Mesh):
        return _mesh(shape)
    if isinstance(shape, ConvexHull):
        return _hull(np.asarray(shape.points), f"the hull {owner!r}")
    if isinstance(shape, PointCloud):
        return *_surface(*cell_faces(shape)), Cells(shape.cells, shape.resolution)
    if isinstance(shape, HeightMap):
        return *_surface(*ground_surface(shape)), Ground(shape)
    if isinstance(shape, HalfSpace):
        if link is not None:
            raise InputError(f"{owner!r} is a HalfSpace, which has no end and cannot move with {link!r}; attach a Box")
        box = np.array([[-np.inf] * 3, [np.inf, np.inf, 0.0]])
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), box, None, None
    return *_primitive(shape), None


def _primitive(shape: Box | Sphere | Cylinder | Capsule | Cone | Ellipsoid) -> tuple[Any, Array, Support]:
    """Coal shape, box and support."""
    if isinstance(shape, Box):
        half = np.array([shape.x, shape.y, shape.z]) / 2
        geometry, support = coal.Box(shape.x, shape.y, shape.z), Support(CORNERS * half)
    elif isinstance(shape, Sphere):
        half = np.full(3, shape.radius)
        geometry, support = coal.Sphere(shape.radius), Support(np.zeros((1, 3)), shape.radius)
    elif isinstance(shape, Ellipsoid):
        half = np.array([shape.rx, shape.ry, shape.rz])
        geometry, support = coal.Ellipsoid(shape.rx, shape.ry, shape.rz), Support(np.zeros((1, 3)), semi_axes=half)
    else:
        radius, length = shape.radius, shape.length
        ends = np.array([[0, 0, -length / 2], [0, 0, length / 2]])
        half = np.array([radius, radius, length / 2])
        if isinstance(shape, Cylinder):
            geometry, support = coal.Cylinder(radius, length), Support(ends, disc_radii=np.full(2, radius))
        elif isinstance(shape, Cone):
            geometry, support = coal.Cone(radius, length), Support(ends, disc_radii=np.array([radius, 0.0]))
        else:
            half[2] += radius
            geometry, support = coal.Capsule(radius, length), Support(ends, radius)
    return geometry, np.array([-half, half]), support


def _mesh(shape: Mesh) -> Made:
    if shape.path is None:
        return _made_of_mesh(shape)
    path = Path(shape.path).absolute()  # the same words are another file in another folder
    try:
        status = path.stat()
    except OSError:
        return _made_of_mesh(shape)  # says what is wrong with the file
    return _made_of_file(path, shape.scale, shape.hull, shape.hollow, (status.st_mtime_ns, status.st_size))


def _own_shape(shape: Mesh) -> tuple[tuple[Made, ...], str]:
    """The bodies of a mesh that is to be solid in its own shape, and what was made of it."""
    if shape.path is None:
        return _made_of_own_shape(shape, None)
    path = Path(shape.path).absolute()
    try:
        status = path.stat()
    except OSError:
        triangles_of(shape)  # raises, naming the file
        raise
    return _made_of_own_shape(replace(shape, path=path), (status.st_mtime_ns, status.st_size))


@lru_cache(maxsize=MESHES_KEPT)
def _made_of_own_shape(shape: Mesh, _changed: tuple[int, int] | None) -> tuple[tuple[Made, ...], str]:
    mesh = triangles_of(shape)
    what = "the mesh" if shape.path is None else Path(shape.path).name
    solid = Solid(mesh.vertices, mesh.triangles)
    if not solid.watertight:
        remark = f"{what} is not watertight, so it is replaced by its convex hull, which fills its openings"
        return (_made_of_mesh(replace(shape, hull=True)),), remark
    cover = convex_pieces(solid.corners, solid.contains, most=MOST_PIECES, tolerance=DEEP)
    if cover is None or cover.excess > MOST_EXCESS:
        remark = (
            f"{what} is used as its exact triangles, since {MOST_PIECES} convex pieces do not fit it to "
            f"{MOST_EXCESS * 1e3:g} mm; checks take longer, and proofs with it cannot be saved"
        )
        return (_made_of_mesh(replace(shape, hull=False)),), remark
    if len(cover.points) == 1:
        return (_made_of_mesh(replace(shape, hull=True)),), ""
    pieces = []
    for points in cover.points:
        geometry = hull_of_any(points)
        corners = np.array(geometry.points(), dtype=float)
        pieces.append((geometry, _box_around(corners), Support(corners), None))
    return tuple(pieces), (
        f"{what} is covered by {len(pieces)} convex pieces, which reach at most {cover.excess * 1e3:.1f} mm beyond it "
        f"(at {SAMPLES} points)"
    )


@lru_cache(maxsize=MESHES_KEPT)
def _made_of_file(path: Any, scale: Any, hull: bool | None, hollow: bool, _changed: tuple[int, int]) -> Made:
    return _made_of_mesh(Mesh(path, scale, hull=hull, hollow=hollow))


def _made_of_mesh(shape: Mesh) -> Made:
    mesh = triangles_of(shape)
    what = "a mesh of arrays" if shape.path is None else shape.path
    if shape.hull:
        try:
            return _hull(mesh.vertices, "the mesh")
        except InputError as error:
            raise MeshError(what, f"{error}; collide with its triangles (hull=False), or give it thickness") from error
    if shape.hull is None:
        raise InputError("a Mesh without hull= may be several bodies; use shape_bodies")
    solid = Solid(mesh.vertices, mesh.triangles, shape.hollow)
    if not solid.watertight and not shape.hollow:
        raise MeshError(
            what,
            "is not watertight, so it has no inside: take its hull (hull=True), close it, or take its bare triangles "
            "(hull=False, hollow=True), within which nothing is seen",
        )
    return *_surface(mesh.vertices, mesh.triangles), solid


def _surface(vertices: Array, triangles: npt.NDArray[np.int64]) -> tuple[Any, Array, None]:
    """Coal shape, box and no support."""
    return bvh(vertices, triangles), _box_around(vertices), None


def triangles_of(shape: Mesh) -> TriangleMesh:
    """The triangles of a mesh, in metres.

    Raises
    ------
    MeshError
        If its file is missing or unreadable.
    """
    if shape.path is None:
        return TriangleMesh(np.array(shape.vertices), np.array(shape.triangles))
    return read_mesh(shape.path, shape.scale)  # type: ignore[arg-type]  # made three numbers by Mesh


def _hull(points: Array, what: str) -> Made:
    geometry = convex_hull(points, what)
    return geometry, _box_around(points), Support(np.array(geometry.points(), dtype=float)), None


def _box_around(points: Array) -> Array:
    return np.array([points.min(axis=0), points.max(axis=0)])


def boxes(bodies: Sequence[Body]) -> tuple[Array, Array]:
    """Centres (B, 3) and half sides (B, 3) of the bodies' boxes, each in its body's frame.

    Not finite for a body without an end.
    """
    stacked = np.array([body.box for body in bodies]).reshape(-1, 2, 3)
    with np.errstate(invalid="ignore"):
        return stacked.mean(axis=1), (stacked[:, 1] - stacked[:, 0]) / 2
