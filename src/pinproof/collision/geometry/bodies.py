"""Bodies: links, attached objects and obstacles as coal shapes, with bounding boxes and support functions.

A convex body has a support function, from which certificates prove distances independently of the convergence of GJK.
An exact mesh has points that show whether it lies inside another body.
"""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Body as CoreBody
from pinproof._core import Shape as CoreShape
from pinproof._core import bodies_on_joint, box_bodies
from pinproof.collision.geometry.convex_pieces import SAMPLES, kept_convex_pieces
from pinproof.collision.geometry.hulls import (
    Inside,
    PointHull,
    Solid,
    Surface,
    bvh,
    convex_hull,
    core_mesh,
    hull_of_any,
    rounded_corners,
)
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shapes import (
    BODY,
    Box,
    Capsule,
    Cone,
    ConvexShape,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    HeightMap,
    Mesh,
    Obstacle,
    PointCloud,
    Shape,
    Sphere,
)
from pinproof.collision.geometry.surfaces import Cells, Ground, cell_faces, ground_surface
from pinproof.common.steps import step
from pinproof.common.structs import described, key
from pinproof.description import TriangleMesh, read_mesh
from pinproof.errors import InputError, MeshError
from pinproof.spatial import Array, frozen, matrix

MESHES_KEPT = 128
"""Number of mesh files whose hull or solid is cached."""

MOST_PIECES = 64
"""Maximum number of convex pieces of a mesh. For a bin of 29 pieces, checks of a UR5 take 1.1 times and certificates
1.4 times as long as for the hull of the bin; for its triangles 6 and 10 times."""

MOST_EXCESS = 1e-3
"""Maximum distance (m) that convex pieces may extend beyond a mesh, less than the usual margin of a robot cell; if they
would extend farther, the triangles are used."""

MOST_TRIANGLES = 20_000
"""Meshes with more triangles are not covered by convex pieces, which takes more than five seconds."""

DEEP = 0.5 * MOST_EXCESS
"""Depth (m) below its hull up to which a surface counts as part of the hull; a mesh without deeper points is convex."""

CORNERS = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
"""Corners of a box with half sides of 1."""

ENDS = np.array([[-1.0] * 3, [1.0] * 3])
"""Its lowest and its highest corner."""

FEW_POINTS = 32
"""Up to this number of points a hull keeps those inside it."""

ORIGIN = 0.0, 0.0, 0.0

NO_DISCS, NO_AXES = np.zeros(8), np.zeros(3)
"""The discs at the corners of a box, and the ellipsoid added to it; boxes share these arrays, which are read-only."""


class FileStamp(NamedTuple):
    """Absolute path, modification time and size of a file."""

    path: str
    changed: int
    size: int

    @classmethod
    def of(cls, path: str | Path) -> FileStamp | None:
        """Return the stamp of a file at present; None if there is no file."""
        path = os.fspath(path)  # a certificate reads some thirty stamps: pathlib would take a quarter of its time
        if not os.path.isabs(path):  # noqa: PTH117
            path = os.path.join(os.getcwd(), path)  # noqa: PTH109, PTH118
        try:
            status = os.stat(path)  # noqa: PTH116
        except OSError:
            return None
        return cls(path, status.st_mtime_ns, status.st_size)


@dataclass(frozen=True, eq=False)
class Support:
    """The support function of a convex body: the largest extent in a direction.

    The body is the hull of ``points`` (V, 3), each with a flat disc of ``disc_radii`` (V,) about z, grown by a ball of
    ``radius`` and by an ellipsoid of ``semi_axes`` (3,) along x, y, z (Minkowski sums; metres). It represents spheres
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


class MeshModel:
    """Coal's model of triangles, made on first access: the core has its own, and coal takes 2.5 us for a triangle."""

    kind = "BVHModelOBBRSS"

    def __init__(self, vertices: Array, triangles: npt.NDArray[np.int64]) -> None:
        self.vertices, self.triangles = vertices, triangles

    @cached_property
    def made(self) -> Any:
        """The shape of coal."""
        return bvh(self.vertices, self.triangles)

    @property
    def unchanged(self) -> bool:
        """Whether the model, which cannot be made read-only, still has the vertices with which it was made."""
        return "made" not in self.__dict__ or np.array_equal(self.made.vertices(), self.vertices)

    def __getstate__(self) -> dict[str, Any]:
        return {"vertices": self.vertices, "triangles": self.triangles}


class HullModel:
    """Coal's hull of points grown by a ball, made on first access: only coal's depths need it, and Qhull is slow."""

    kind = "Convex"

    def __init__(self, points: Array, radius: float = 0.0) -> None:
        self.points, self.radius = points, radius

    @cached_property
    def made(self) -> Any:
        """The shape of coal; a polytope around the ball."""
        return hull_of_any(rounded_corners(self.points, self.radius))

    def __getstate__(self) -> dict[str, Any]:
        return {"points": self.points, "radius": self.radius}


@described(eq=False)
class Body:
    """A body that is checked for collision."""

    name: str = key(
        "unique among the bodies: the geometry of a link (``forearm_link_0``), an attached object or an obstacle"
    )
    owner: str = key("the link, attached object or obstacle to which it belongs; messages use this name")
    link: str | None = key("the robot link it moves with; None for an obstacle")
    model: Any = key("the coal shape, in the body's own frame, or how it is made")
    link_from_body: pin.SE3 = key("pose on its link; root_from_body for an obstacle")
    box: Array = key("(2, 3) lower and upper corner of the box around it, in its own frame")
    support: Support | None = key("its support function; None for an exact mesh")
    solid: Inside | None = key(
        "the enclosed volume of an exact mesh, for which coal does not detect a body entirely inside. None if convex",
        default=None,
    )
    remark: str = key("a simplification that the user may not expect, for the notes of certificates", default="")
    source: str = key(
        "the collision geometry, obstacle or attached object that several bodies represent, of which this is one",
        default="",
    )
    level: int = key(
        "level of detail: 0 is the requested one; a finer body replaces those of its source in some pairs", default=0
    )
    file: FileStamp | None = key(
        "the mesh file from which it was read, with its modification time and size", default=None
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "link_from_body", frozen(self.link_from_body))
        self.box.setflags(write=False)

    @property
    def geometry(self) -> Any:
        """The coal shape, in the body's own frame."""
        return self.model.made if isinstance(self.model, MeshModel | HullModel) else self.model

    @cached_property
    def core_shape(self) -> CoreShape:
        """The shape as the compiled core uses it."""
        if self.support is not None:
            s = self.support
            return CoreShape.convex(s.points, s.disc_radii, s.radius, s.semi_axes, self.box)
        if self.solid is None:
            return CoreShape.half_space(self.box)
        return self.solid.core_shape if isinstance(self.solid, Solid | Surface) else core_mesh(self.solid)

    @cached_property
    def core_obstacle(self) -> CoreBody:
        """The body of an obstacle as the compiled core uses it."""
        return CoreBody(self.core_shape, -1, matrix(self.link_from_body))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("core_shape", "core_obstacle")}

    @property
    def witnesses(self) -> Array:
        """(K, 3) one point of each connected part, to test if it is inside another body; empty for a half-space."""
        if self.solid is not None:
            return self.solid.witnesses
        return np.empty((0, 3)) if self.support is None else self.support.points[:1]

    def contains_part_of(self, other: Body, own_from_other: pin.SE3) -> bool:
        """Whether a part of another body is inside this exact watertight mesh; never if it is no such mesh."""
        if self.solid is None or not self.solid.watertight:
            return False
        return self.solid.contains(other.witnesses @ own_from_other.rotation.T + own_from_other.translation)

    @property
    def is_half_space(self) -> bool:
        """Whether it is a half-space, which has neither a support function nor an enclosed volume."""
        return self.support is None and self.solid is None

    @property
    def _kind(self) -> str:
        model = self.model
        return model.kind if isinstance(model, MeshModel | HullModel) else type(model).__name__

    @property
    def is_exact(self) -> bool:
        """Whether coal reads the triangles of a mesh."""
        return isinstance(self.model, MeshModel | coal.BVHModelBase)

    @property
    def is_hollow(self) -> bool:
        """Whether it is an exact mesh that is not watertight: a body that is entirely inside is not in contact."""
        return self.solid is not None and not self.solid.watertight

    @property
    def unchanged(self) -> bool:
        """Whether the coal geometry, which cannot be made read-only, is still that with which the body was created."""
        return not isinstance(self.model, MeshModel) or self.model.unchanged

    def content(self) -> bytes:
        """Return all data on which verdicts depend, for a hash; name and colour are not included."""
        parts = [repr((self._kind, self.owner, self.link, self.level)).encode(), self.box.tobytes()]
        parts.append(matrix(self.link_from_body).tobytes())
        if self.support is not None:
            s = self.support
            parts += [s.points.tobytes(), repr(s.radius).encode(), s.disc_radii.tobytes(), s.semi_axes.tobytes()]
        if self.solid is not None:
            parts.append(self.solid.content())
        return b"|".join(parts)

    @cached_property
    def ball(self) -> tuple[Array, float]:
        """The centre (3,) and the radius (m) of a ball around it, in its own frame."""
        return 0.5 * (self.box[0] + self.box[1]), 0.5 * math.dist(*self.box)

    @cached_property
    def reach(self) -> float:
        """Largest coordinate (m) of its box, if finite."""
        sides = [abs(x) for x in self.box.ravel().tolist() if x - x == 0.0]  # the finite ones
        return max(sides, default=0.0)

    @cached_property
    def extent(self) -> float:
        """Its reach plus the distance (m) of its origin from its link or the root."""
        return self.reach + math.dist(ORIGIN, self.link_from_body.translation.tolist())


class BoxBody(Body):
    """A box as an obstacle, of which coal's shape, corners and support function are made on first access."""

    shape: Box
    link, is_exact, _kind = None, False, "Box"

    @cached_property
    def _made(self) -> Made:
        return _made(self.shape, self.owner, None)

    model = cached_property(lambda self: self._made[0])
    box = cached_property(lambda self: self._made[1])
    support = cached_property(lambda self: self._made[2])


def make_boxes(obstacles: Iterable[Obstacle]) -> None:
    """Make the bodies of obstacles that are boxes, which obstacles keep; all at once, because scenes may have 100,000.

    :func:`box_of` returns the body of an obstacle.
    """
    missing: list[Any] = [o for o in obstacles if type(o.shape) is Box and box_of(o) is None]
    if not missing:
        return
    halves = np.array([(o.shape.x, o.shape.y, o.shape.z) for o in missing]) / 2
    poses = np.array([o.pose.homogeneous for o in missing])
    lengths = zip(halves.max(axis=1).tolist(), poses[:, :3, 3].tolist(), strict=True)
    put = object.__setattr__  # both are frozen
    for thing, core, (half, at) in zip(missing, box_bodies(halves, poses), lengths, strict=True):
        body = object.__new__(BoxBody)
        put(body, "name", thing.name)
        put(body, "owner", thing.name)
        put(body, "link_from_body", thing.pose)
        put(body, "shape", thing.shape)
        put(body, "core_obstacle", core)
        put(body, "extent", half + math.dist(ORIGIN, at))
        put(thing, BODY, body)


def box_of(obstacle: Obstacle) -> BoxBody | None:
    """Return the body of a box that :func:`make_boxes` made; None for any other obstacle."""
    return getattr(obstacle, BODY, None)


def one_inside_other(one: Body, at: pin.SE3, other: Body, other_at: pin.SE3) -> bool:
    """Whether a part of one of two placed bodies is inside the exact watertight mesh of the other."""
    return one.contains_part_of(other, at.actInv(other_at)) or other.contains_part_of(one, other_at.actInv(at))


class CellsBody(Body):
    """Cells as an obstacle, of which coal's triangles are made on first access."""

    solid: Cells
    link, support, is_exact, _kind = None, None, False, "cells"

    @cached_property
    def model(self) -> Any:
        """The triangles of all boxes, for coal."""
        corners = self.solid.surface.reshape(-1, 3)
        return MeshModel(corners, np.arange(len(corners)).reshape(-1, 3))

    core_shape = cached_property(lambda self: self.solid.core_shape)

    def as_boxes(self) -> list[Body]:
        """Return each of its boxes as a body."""
        ends, rotation = self.solid.boxes, self.link_from_body.rotation
        places = ends.mean(axis=1) @ rotation.T + self.link_from_body.translation
        shapes = [Box(*sides) for sides in (ends[:, 1] - ends[:, 0]).tolist()]
        return [
            shape_body(self.name, self.owner, None, shape, pin.SE3(rotation, at))
            for shape, at in zip(shapes, places, strict=True)
        ]

    def as_mesh(self) -> Body:
        """Return the same with the triangles of its boxes, for proofs that need facets."""
        at, box = self.link_from_body, self.box
        return Body(self.name, self.owner, None, self.model, at, box, None, self.solid, self.remark)


def shape_bodies(name: str, link: str | None, shape: Shape, link_from_body: pin.SE3) -> list[Body]:
    """Return the bodies of an obstacle or attached object: several for a mesh of convex pieces."""
    if isinstance(shape, PointCloud | OccupancyGrid):
        if not len(boxes := Cells.of(shape).boxes):
            return []
        if link is None:
            box = np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
            body = object.__new__(CellsBody)
            body.__dict__.update(name=name, owner=name, link_from_body=frozen(link_from_body), box=box)
            body.__dict__.update(solid=Cells.of(shape), remark=_remark(shape, None))
            return [body]
    if not isinstance(shape, Mesh) or shape.hull is not None:
        return [shape_body(name, name, link, shape, link_from_body)]
    stamped, file = _stamped(shape)
    pieces = _piece_bodies(name, link, stamped, file)
    if not pieces:
        hull, _, remark = _own_shape(stamped, file)
        made = _unmodified(replace(stamped, hull=hull), file)
        return [Body(name, name, link, made[0], link_from_body.copy(), *made[1:], remark, file=file)]
    at = frozen(link_from_body.copy())
    placed, distance = list[Body](), math.dist(ORIGIN, at.translation.tolist())
    for piece in pieces:
        own = object.__new__(Body)
        own.__dict__.update(piece.__dict__, link_from_body=at, extent=piece.reach + distance)
        placed.append(own)
    if link is None:
        cores = bodies_on_joint([piece.core_shape for piece in placed], -1, matrix(at))
        for own, core in zip(placed, cores, strict=True):
            own.__dict__["core_obstacle"] = core
    return placed


def bodies_of(obstacle: Obstacle, link: str | None) -> tuple[Body, ...]:
    """Return the bodies of an obstacle, or of an object that is attached to a link."""
    if link is None and type(obstacle.shape) is Box:
        make_boxes([obstacle])
    box = box_of(obstacle) if link is None else None
    return tuple(shape_bodies(obstacle.name, link, obstacle.shape, obstacle.pose)) if box is None else (box,)


@lru_cache(maxsize=MESHES_KEPT)
def _piece_bodies(name: str, link: str | None, shape: Mesh, file: FileStamp | None) -> tuple[Body, ...]:
    """Return the bodies of a mesh of convex pieces at the origin, which all placements share; none of another mesh."""
    _, pieces, remark = _own_shape(shape, file)
    bodies = tuple(
        Body(f"{name}_part_{i}", name, link, made[0], pin.SE3.Identity(), *made[1:], remark, source=name, file=file)
        for i, made in enumerate(pieces)
    )
    for body in bodies:
        _ = body.core_shape, body.reach  # so that the copies have them
    return bodies


def with_triangles(obstacle: Obstacle) -> Obstacle:
    """Return an obstacle with the triangles of its mesh, solid if watertight, unless its shape is the hull of it."""
    shape = obstacle.shape
    if not isinstance(shape, Mesh) or shape.hull is not None:
        return obstacle
    mesh = triangles_of(shape)
    return replace(
        obstacle, shape=replace(shape, hull=False, hollow=not Solid(mesh.vertices, mesh.triangles).watertight)
    )


def shape_body(name: str, owner: str, link: str | None, shape: Shape, link_from_body: pin.SE3) -> Body:
    """Return a body of any shape; MeshError or InputError if it cannot be represented as requested, or is unknown."""
    file = _stamped(shape)[1] if isinstance(shape, Mesh) else None
    geometry, box, support, solid = _made(shape, owner, link)
    return Body(name, owner, link, geometry, link_from_body, box, support, solid, _remark(shape, solid), file=file)


def _remark(shape: Shape, solid: Inside | None) -> str:
    if isinstance(shape, Mesh) and shape.hull:
        return "the convex hull of the mesh is used"
    if isinstance(shape, PointCloud):
        lost = f"; {shape.dropped} points that are not finite are dropped" if shape.dropped else ""
        return f"point cloud in cells of {shape.resolution:g} m; unobserved space is treated as free{lost}"
    if isinstance(shape, OccupancyGrid):
        return shape.remark
    if solid is None or solid.watertight:
        return ""
    return "not watertight, so only its surface is checked: a body that is entirely inside is not detected"


def hull_body(name: str, link: str, points: Array, link_from_body: pin.SE3) -> Body:
    """Return a body of a link: a convex hull that contains ``points`` (V, 3), which may be flat."""
    geometry, box, support, _ = _piece(points)
    return Body(name, link, link, geometry, link_from_body, box, support)


Made = tuple[Any, Array, Support | None, Inside | None]
"""Coal shape, box (2, 3), support function, enclosed volume."""


def _made(shape: Shape, owner: str, link: str | None) -> Made:
    """Return geometry, box, support and enclosed volume of a shape; an unknown kind is refused."""
    if isinstance(shape, HalfSpace) and link is not None:
        raise InputError(f"{owner!r} is a HalfSpace, which is unbounded and cannot move with {link!r}; attach a Box")
    make = GEOMETRIES.get(type(shape))
    if make is None:
        known = ", ".join(kind.__name__ for kind in GEOMETRIES)
        raise InputError(f"{owner!r} has the unknown shape {type(shape).__name__}; known are {known}")
    return make(shape)


def _box(x: float, y: float, z: float) -> Made:
    half = np.array((x, y, z)) / 2
    ends = ENDS * half
    ends.setflags(write=False)
    return coal.Box(x, y, z), ends, Support(CORNERS * half, 0.0, NO_DISCS, NO_AXES), None


def _convex(
    geometry: Any,
    half: tuple[float, float, float],
    points: Array,
    radius: float = 0.0,
    discs: Array | None = None,
    semi_axes: Array | None = None,
) -> Made:
    """Return a convex body with half the sides (3,) of the box around it, and the parts of its support function."""
    support = Support(points, radius, discs, semi_axes)  # type: ignore[arg-type]  # None is zeros
    return geometry, np.array([np.negative(half), half]), support, None


def _ends(shape: Cylinder | Cone | Capsule) -> Array:
    """Return the two ends (2, 3) of the axis."""
    return np.array([[0, 0, -shape.length / 2], [0, 0, shape.length / 2]])


def _unmodified(shape: Mesh, file: FileStamp | None) -> Made:
    """Return the cached result for a mesh; made again if its vertices, which coal cannot protect, were modified."""
    made = _made_of_mesh(shape, file)
    if isinstance(made[0], MeshModel) and not made[0].unchanged:
        _made_of_mesh.cache_clear()
        made = _made_of_mesh(shape, file)
    return made


def _stamped(shape: Mesh) -> tuple[Mesh, FileStamp | None]:
    """Return a mesh with the absolute path of its file, and its stamp; None without a file."""
    file = None if shape.path is None else FileStamp.of(shape.path)
    return (shape if file is None else replace(shape, path=file.path)), file


@lru_cache(maxsize=MESHES_KEPT)
def _solid(shape: Mesh, _file: FileStamp | None) -> Solid:
    mesh = triangles_of(shape)
    return Solid(mesh.vertices, mesh.triangles, shape.hollow)


@lru_cache(maxsize=MESHES_KEPT)
def _own_shape(shape: Mesh, _file: FileStamp | None) -> tuple[bool, tuple[Made, ...], str]:
    """Return how a mesh is represented as a solid (``hull``, or several pieces), and a remark on simplifications."""
    what = "the mesh" if shape.path is None else Path(shape.path).name
    solid = _solid(replace(shape, hull=False), _file)
    if not solid.watertight:
        remark = f"{what} is not watertight, so it is replaced by its convex hull, which fills its openings"
        return True, (), remark
    if len(solid.triangles) > MOST_TRIANGLES:
        remark = (
            f"{what} is represented by its exact triangles, because it has {len(solid.triangles):,} of them and convex "
            f"pieces are computed for up to {MOST_TRIANGLES:,}; a coarser mesh is checked faster"
        )
        return False, (), remark
    # A watertight mesh is covered by convex pieces if they fit it closely.
    with step(f"decomposing {what} ({len(solid.triangles):,} triangles)", level=logging.INFO):
        cover = kept_convex_pieces(solid, most=MOST_PIECES, tolerance=DEEP)
    if cover is None or cover.excess > MOST_EXCESS:
        remark = (
            f"{what} is represented by its exact triangles, because {MOST_PIECES} convex pieces do not fit it within "
            f"{MOST_EXCESS * 1e3:g} mm; checks take longer"
        )
        return False, (), remark
    if len(cover.points) == 1:
        return True, (), ""
    pieces = tuple(map(_piece, cover.points))
    remark = (
        f"{what} is covered by {len(pieces)} convex pieces, which extend at most {cover.excess * 1e3:.1f} mm beyond it "
        f"(at {SAMPLES} points)"
    )
    return False, pieces, remark


@lru_cache(maxsize=MESHES_KEPT)
def _made_of_mesh(shape: Mesh, _file: FileStamp | None) -> Made:
    what = "a mesh of arrays" if shape.path is None else shape.path
    if shape.hull:
        try:
            return _hull(triangles_of(shape).vertices, "the mesh")
        except InputError as error:
            raise MeshError(what, f"{error}; use its triangles (hull=False), or give it thickness") from error
    if shape.hull is None:
        raise InputError("a Mesh without hull= may be several bodies; use shape_bodies")
    # The triangles, which need an inside unless only the surface is checked.
    solid = _solid(shape, _file)
    if not solid.watertight and not shape.hollow:
        raise MeshError(
            what,
            "is not watertight, so it has no inside: use its hull (hull=True), close it, or use only its surface "
            "(hull=False, hollow=True), inside which no body is detected",
        )
    return *_surface(solid.vertices, solid.triangles), solid


def _surface(vertices: Array, triangles: npt.NDArray[np.int64]) -> tuple[Any, Array, None]:
    """Coal shape, box and no support."""
    return MeshModel(vertices, triangles), _box_around(vertices), None


def triangles_of(shape: Mesh) -> TriangleMesh:
    """Return the triangles of a mesh in metres; MeshError if its file is missing or unreadable."""
    if shape.path is None:
        return TriangleMesh(np.array(shape.vertices), np.array(shape.triangles))
    return read_mesh(shape.path, shape.scale)  # type: ignore[arg-type]  # made three numbers by Mesh


def _hull(points: Array, what: str) -> Made:
    geometry = convex_hull(points, what)
    return geometry, _box_around(points), Support(np.array(geometry.points(), dtype=float)), None


def _convex_shape(shape: ConvexShape) -> Made:
    """Return the hull of points grown by a ball, without which they are not flat."""
    corners, radius = shape.points, shape.radius
    if len(corners) > FEW_POINTS:  # otherwise points inside the hull cost less than finding its corners
        if radius == 0.0:
            return _hull(corners, "the convex shape")
        try:
            corners = np.array(convex_hull(corners, "the convex shape").points(), dtype=float)
        except InputError:  # flat
            corners = PointHull(corners).points
    return HullModel(corners, radius), _box_around(corners) + ENDS * radius, Support(corners, radius), None


def _piece(points: Array) -> Made:
    """Return a convex hull that contains points (V, 3), which may be flat."""
    geometry = hull_of_any(points)
    corners = np.array(geometry.points(), dtype=float)
    return geometry, _box_around(corners), Support(corners), None


def _box_around(points: Array) -> Array:
    return np.array([points.min(axis=0), points.max(axis=0)])


GEOMETRIES: dict[type[Shape], Callable[[Any], Made]] = {
    Box: lambda s: _box(s.x, s.y, s.z),
    Sphere: lambda s: _convex(coal.Sphere(s.radius), (s.radius,) * 3, np.zeros((1, 3)), s.radius),
    Cylinder: lambda s: _convex(
        coal.Cylinder(s.radius, s.length), (s.radius, s.radius, s.length / 2), _ends(s), discs=np.full(2, s.radius)
    ),
    Capsule: lambda s: _convex(
        coal.Capsule(s.radius, s.length), (s.radius, s.radius, s.length / 2 + s.radius), _ends(s), s.radius
    ),
    Cone: lambda s: _convex(
        coal.Cone(s.radius, s.length), (s.radius, s.radius, s.length / 2), _ends(s), discs=np.array([s.radius, 0.0])
    ),
    Ellipsoid: lambda s: _convex(
        coal.Ellipsoid(s.rx, s.ry, s.rz), (s.rx, s.ry, s.rz), np.zeros((1, 3)), semi_axes=np.array([s.rx, s.ry, s.rz])
    ),
    HalfSpace: lambda _: (
        coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),
        np.array([[-np.inf] * 3, [np.inf, np.inf, 0.0]]),
        None,
        None,
    ),
    ConvexShape: _convex_shape,
    Mesh: lambda s: _unmodified(*_stamped(s)),
    PointCloud: lambda s: (*_surface(*cell_faces(s)), Cells.of(s)),
    OccupancyGrid: lambda s: (*_surface(*cell_faces(s)), Cells.of(s)),
    HeightMap: lambda s: (*_surface(*ground_surface(s)), Ground(s)),
}
"""The registration of each shape: the function that returns its geometry, box, support and enclosed volume."""
