"""Shapes of obstacles and attached objects, and obstacles: immutable values in metres.

Every shape is about its own origin. Sizes are checked, because coal accepts NaN, -1 and 1e300 without an error. Shapes
that hold arrays compare equal if their numbers are equal.

A new shape is registered in three places, each of which refuses an unknown shape: the union :data:`Shape` here, from
which its key in files follows, ``GEOMETRIES`` in :mod:`pinproof.collision.geometry.bodies` (geometry and support
function), and the surfaces of :mod:`pinproof.viewer`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from pinproof._core import is_rigid
from pinproof.collision.geometry.hulls import FLAT, refuse_flat
from pinproof.collision.geometry.occupancy import GRID, OccupancyGrid, stated_grid
from pinproof.collision.geometry.shape_values import (
    COORDINATE,
    LARGEST_SIZE,
    SIZE,
    SMALLEST_SIZE,
    ByContent,
    Size,
    coordinates,
    point_array,
)
from pinproof.common import structs as st
from pinproof.common.results import ByValue
from pinproof.common.validation import named_arguments, require_number
from pinproof.errors import InputError
from pinproof.model import coal_shape
from pinproof.spatial import SE3, Array, finite, frozen, rigid

GRID_CELLS = 2**20
"""Number of cells of a point cloud on either side of the origin along each axis: three indices fit into 63 bits."""

BELOW_LOWEST = 0.01
"""Metres: default distance of the underside of a height map from its lowest point."""


MOST_DIRECTIONS = 10_000
"""Number of directions in which :meth:`ConvexShape.from_support` asks for farthest points."""

LEAST_SHARE = 1e-3
"""Smallest part of the side of a triangle of directions, relative to the other one, into which it is divided."""

SUPPORT_TOLERANCE = 1e-9
"""Metres by which a farthest point may be nearer than another one: rounding of the function that computes it."""


@named_arguments
@st.struct("rounded_hull", eq=False, repr=False)
class ConvexShape(ByContent):
    """The convex hull of points, grown by a ball (their Minkowski sum)."""

    points: st.Accepting[Array, npt.ArrayLike] = st.key(
        "(V, 3) the points; without a radius they are not all in one plane",
        "m",
        kind=st.array_of(st.list_of(st.vector(3, COORDINATE), 1), (None, 3), coordinates),
    )
    radius: float = st.key("radius of the ball", "m", default=0.0, kind=st.number(minimum=0, maximum=LARGEST_SIZE))

    def __post_init__(self) -> None:
        if self.radius < FLAT or not len(self.points):
            refuse_flat(self.points, "ConvexShape.points")

    @classmethod
    def from_support(cls, farthest: Callable[[Array], npt.ArrayLike], *, error: float) -> ConvexShape:
        """Return a shape that contains any convex body, and is contained in the body grown by a ball of ``error``.

        Parameters
        ----------
        farthest
            The support mapping of the body, as in GJK: a farthest point (3,) of it (m) in a unit direction (3,).
        error
            Metres; 1e-6 or more.

        Raises
        ------
        InputError
            If a point is not the farthest in its direction, as another one shows, or if the error needs more than
            :data:`MOST_DIRECTIONS` directions.

        Notes
        -----
        The sphere is divided into triangles with corners d_i; x_i are the farthest points, and v is the point at which
        the three planes d_i . x = d_i . x_i meet. A direction u in the triangle is sum_i a_i d_i with a_i >= 0, so that
        the farthest point of the body in it is not beyond v: max u . x <= sum_i a_i d_i . x_i = u . v. The body is
        therefore inside the hull of all v (R. T. Rockafellar, 1970, "Convex analysis", theorem 13.1). If every v is
        within r of the hull of all x_i, the body is inside this hull grown by r, which is returned; and all x_i are in
        the body. A triangle with a v farther away than ``error`` is divided at a direction on one side in which both
        x_i are equally far, so that the vertices of a polytope are found exactly.
        """
        require_number("error (m)", error, minimum=FLAT)
        known: dict[bytes, Array] = {}

        def touched(direction: Array) -> Array:
            name = direction.tobytes()
            if name not in known:
                if len(known) == MOST_DIRECTIONS:
                    raise InputError(f"error = {error:g} m needs more than {MOST_DIRECTIONS} directions; enlarge it")
                known[name] = coordinates(f"farthest({direction.tolist()})", farthest(direction.copy()), (3,))
            return known[name]

        x, y, z = np.eye(3)
        open_triangles = [(i, j, k) for i in (x, 0.0 - x) for j in (y, 0.0 - y) for k in (z, 0.0 - z)]
        radius = rounding = 0.0
        while open_triangles:
            triangles, open_triangles = np.array(open_triangles), []
            touching = np.array([[touched(direction) for direction in corners] for corners in triangles])
            found = np.array(list(known.values()))
            for d, at in zip(triangles, touching, strict=True):
                offsets = np.einsum("ij,ij->i", d, at)
                try:
                    meeting = at[0] + np.linalg.solve(d, offsets - d @ at[0])
                except np.linalg.LinAlgError:
                    raise InputError(f"error = {error:g} m needs directions in one plane; enlarge it") from None
                # Its distance from a point of the triangle of the x_i, or from any x, is at least that from their hull.
                shares = np.linalg.lstsq((at[1:] - at[0]).T, meeting - at[0], rcond=None)[0]
                weights = np.maximum([1.0 - shares.sum(), *shares], 0.0)
                away = float(np.linalg.norm(meeting - weights @ at / weights.sum()))
                if away > error:
                    away = float(np.linalg.norm(found - meeting, axis=1).min())
                if away <= error:
                    radius, rounding = max(radius, away), max(rounding, float(np.abs(d @ meeting - offsets).max()))
                    continue
                # The side along which the farthest point changes most, or else the longest one.
                sides = []
                for i, j in ((0, 1), (1, 2), (2, 0)):
                    here, there = d[i] @ (at[i] - at[j]), d[j] @ (at[j] - at[i])
                    change = min(here, there)
                    change = change if change > max(SUPPORT_TOLERANCE, LEAST_SHARE * max(here, there)) else 0.0
                    sides.append((change, -d[i] @ d[j], i, j, there * d[i] + here * d[j] if change else d[i] + d[j]))
                *_, i, j, middle = max(sides, key=lambda side: side[:2])
                middle = middle / np.linalg.norm(middle) + 0.0
                open_triangles += [(d[i], middle, d[3 - i - j]), (middle, d[j], d[3 - i - j])]
        directions, touching = np.array([np.frombuffer(name) for name in known]), np.array(list(known.values()))
        points, reached = np.unique(touching, axis=0), np.einsum("ij,ij->i", directions, touching)
        for direction, reach in zip(directions, reached, strict=True):
            if (beyond := float((points @ direction).max() - reach)) > SUPPORT_TOLERANCE:
                raise InputError(
                    f"farthest({direction.tolist()}) is not the farthest point: another one is {beyond:.3g} m farther"
                )
        return cls(points, max(radius + 2.0 * (rounding + SUPPORT_TOLERANCE), FLAT))


def _factors(name: str, value: Any) -> tuple[float, float, float]:
    values = value if isinstance(value, (tuple, list)) else (value,) * 3
    try:
        x, y, z = (float(factor) for factor in values)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be one number or three, not {value!r}") from None
    if not all(math.isfinite(factor) and factor != 0.0 for factor in (x, y, z)):
        raise InputError(f"{name} = {(x, y, z)}; factors must be finite and not 0")
    return x, y, z


def _indices(name: str, value: Any) -> npt.NDArray[np.int64]:
    try:
        indices = np.array(value)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"{name} must be integers of the shape (F, 3): {error}") from error
    if indices.ndim != 2 or indices.shape[1] != 3 or len(indices) == 0 or indices.dtype.kind not in "iu":
        raise InputError(f"{name} must be integers of the shape (F, 3); they are {indices.dtype} of {indices.shape}")
    indices = indices.astype(np.int64)
    indices.setflags(write=False)
    return indices


@named_arguments
@st.struct(
    "mesh",
    first=("path", "scale", "vertices", "triangles"),
    rules=[
        {
            "oneOf": [
                {"required": ["path"], "not": {"anyOf": [{"required": ["vertices"]}, {"required": ["triangles"]}]}},
                {"required": ["vertices", "triangles"], "not": {"required": ["scale"]}},
            ],
            "not": {"properties": {"hull": {"const": True}, "hollow": {"const": True}}, "required": ["hull", "hollow"]},
        }
    ],
    eq=False,
    repr=False,
)
class Mesh(ByContent):
    """A triangle mesh, from a file or from vertices and triangles."""

    path: str | Path | None = st.key(
        "the mesh (STL, OBJ, DAE, PLY, GLB or glTF), relative to the folder of this file",
        default=None,
        kind=st.file_of(),
    )
    scale: float | tuple[float, float, float] = st.key(
        "a factor, or one each for x, y, z; only with `path`",
        default=1.0,
        kind=st.any_of(st.NUMBER, st.vector(), check=_factors),
    )
    hull: bool | None = st.key(
        "`true`: the convex hull, which fills a bin; `false`: the triangles, which must be watertight. By default a "
        "watertight mesh is a solid of its own shape, covered by a few convex pieces if these extend at most 1 mm "
        "beyond it, and any other is replaced by its convex hull, which certificates note",
        default=None,
    )
    hollow: bool = st.key(
        "`true`: only the surface, watertight or not. A body that is entirely inside is then not in contact, which "
        "certificates note",
        default=False,
    )
    vertices: st.Accepting[Array | None, npt.ArrayLike | None] = st.key(
        "(V, 3) the vertices of a mesh without a file",
        "m",
        default=None,
        kind=st.array_of(st.list_of(st.vector(3, COORDINATE), 3), (None, 3), coordinates),
    )
    triangles: npt.NDArray[np.int64] | None = st.key(
        "(F, 3) three indices of vertices for each triangle",
        default=None,
        kind=st.simple(st.list_of(st.list_of(st.COUNT, 3, 3), 1).schema, _indices),
    )

    def __post_init__(self) -> None:
        if self.hull and self.hollow:
            raise InputError("a Mesh has hull=True or hollow=True, not both: hull=False, hollow=True is the surface")
        if self.hollow:
            object.__setattr__(self, "hull", False)
        if self.path is not None:
            if self.vertices is not None or self.triangles is not None:
                raise InputError("a Mesh has a path, or vertices and triangles, not both")
            return
        if self.vertices is None or self.triangles is None:
            raise InputError("a Mesh needs a path, or vertices and triangles")
        if self.scale != (1.0, 1.0, 1.0):
            raise InputError("Mesh.scale is for a mesh with a path only")
        low, high = int(self.triangles.min()), int(self.triangles.max())
        if low < 0 or high >= len(self.vertices):
            raise InputError(f"Mesh.triangles name vertices {low} to {high} of 0 to {len(self.vertices) - 1}")

    @classmethod
    def from_arrays(
        cls, vertices: npt.ArrayLike, triangles: npt.ArrayLike, *, hull: bool | None = None, hollow: bool = False
    ) -> Mesh:
        """Return a mesh of ``vertices`` (V, 3) in metres and ``triangles`` (F, 3), indices of vertices."""
        return cls(None, 1.0, hull, hollow, vertices, triangles)  # type: ignore[arg-type]  # made arrays there


def _measured(name: str, value: Any) -> Array:
    """Points, or those of a cloud of Open3D, of which at least one is finite."""
    points = point_array(name, getattr(value, "points", value))
    if not np.isfinite(points).all(axis=1).any():
        what = f"holds {len(points)} points, of which none is finite" if len(points) else "is empty"
        raise InputError(f"{name} {what}; at least one point is needed")
    return points


@named_arguments
@st.struct("point_cloud", eq=False, repr=False)
class PointCloud(ByContent):
    """The points of a sensor: every cell of a grid that contains one is solid, like the leaves of an octree."""

    points: st.Accepting[Array, npt.ArrayLike] = st.key(
        "(N, 3) the points. Those with a coordinate that is not finite, which depth cameras return for pixels without "
        "a measurement, are dropped and counted",
        "m",
        kind=st.simple(st.list_of(st.vector(3, COORDINATE), 1).schema, _measured, st.parsed),
    )
    resolution: Size = st.key(
        "side of the cells of the grid, which start at integer multiples of it. The solid extends up to one side "
        "beyond a point, and space between points that are farther apart is free; a cell should be no finer than the "
        "spacing of the points",
        "m",
    )

    def __post_init__(self) -> None:
        measured = self.points[np.isfinite(self.points).all(axis=1)]
        object.__setattr__(self, "_dropped", len(self.points) - len(measured))
        object.__setattr__(self, "points", coordinates("PointCloud.points", measured, (None, 3)))
        ends = np.array([self.points.min(axis=0), self.points.max(axis=0)])
        if not (np.abs(np.floor(ends / self.resolution)) < GRID_CELLS - 1).all():
            far = float(np.abs(self.points).max())
            least = f"points {far:g} m from the origin need cells of {far / (GRID_CELLS - 2):.2g} m or more"
            raise InputError(f"PointCloud.resolution = {self.resolution:g}; {least}")

    @property
    def dropped(self) -> int:
        """The number of points that were not finite."""
        return int(self.__dict__["_dropped"])

    @property
    def cells(self) -> npt.NDArray[np.int64]:
        """(K, 3) the occupied cells without repetition: cell c is the cube from c to c + 1, times the resolution."""
        numbers = np.unique(cell_numbers(np.floor(self.points / self.resolution).astype(np.int64)))
        return cells_numbered(numbers)  # 50 times as fast as sorting rows of three


def cell_numbers(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return one number for each of the cells (K, 3), unique for less than :data:`GRID_CELLS` cells off the origin."""
    return np.asarray((cells[:, 0] * 2 * GRID_CELLS + cells[:, 1]) * 2 * GRID_CELLS + cells[:, 2])


def cells_numbered(numbers: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the cells (K, 3) with these numbers."""
    number = numbers + (GRID_CELLS * 2 * GRID_CELLS + GRID_CELLS)
    first, z = np.divmod(number, 2 * GRID_CELLS)
    x, y = np.divmod(first, 2 * GRID_CELLS)
    return np.stack([x, y - GRID_CELLS, z - GRID_CELLS], axis=1)


@named_arguments
@st.struct("height_map", eq=False, repr=False)
class HeightMap(ByContent):
    """Ground over a rectangle about the origin, solid from its surface down to its underside.

    Between the points the surface is the higher of the two triangulations of a cell, so that it covers both and the
    bilinear patch.
    """

    heights: st.Accepting[Array, npt.ArrayLike] = st.key(
        "(ny, nx) rows of z at the points of a regular grid; row 0 is at y = -y / 2, column 0 at x = -x / 2",
        "m",
        kind=st.array_of(st.list_of(st.list_of(COORDINATE, 2), 2), (None, None), coordinates),
    )
    x: Size = st.key("full side of the rectangle along x", "m")
    y: Size = st.key("full side of the rectangle along y", "m")
    bottom: float = st.key(
        f"z of the underside; by default {BELOW_LOWEST} m below the lowest point",
        "m",
        default=None,
        kind=st.Kind(st.NUMBER.schema, st.optional(st.NUMBER).check, st.NUMBER.parse),
    )

    def __post_init__(self) -> None:
        if min(self.heights.shape) < 2:
            shape = self.heights.shape
            raise InputError(f"HeightMap.heights has the shape {shape}; it needs 2 rows and 2 columns or more")
        lowest = float(self.heights.min())
        bottom = lowest - BELOW_LOWEST if self.bottom is None else self.bottom
        if not -2 * LARGEST_SIZE <= bottom <= lowest - SMALLEST_SIZE:
            raise InputError(f"HeightMap.bottom = {bottom:g} must lie below the lowest point, {lowest:g}")
        object.__setattr__(self, "bottom", bottom)


@named_arguments
@st.struct("box")
class Box:
    """A box."""

    x: Size = st.key("full side along x", "m")
    y: Size = st.key("full side along y", "m")
    z: Size = st.key("full side along z", "m")


@named_arguments
@st.struct("sphere")
class Sphere:
    """A sphere."""

    radius: Size = st.key("radius", "m")


@named_arguments
@st.struct("cylinder")
class Cylinder:
    """A cylinder about z."""

    radius: Size = st.key("radius", "m")
    length: Size = st.key("length from end to end", "m")


@named_arguments
@st.struct("capsule")
class Capsule:
    """A cylinder about z with two hemispherical caps."""

    radius: Size = st.key("radius", "m")
    length: Size = st.key("length of the cylinder, without the caps", "m")


@named_arguments
@st.struct("cone")
class Cone:
    """A cone about z; its tip is at z = length / 2."""

    radius: Size = st.key("radius of the base", "m")
    length: Size = st.key("height", "m")


@named_arguments
@st.struct("ellipsoid")
class Ellipsoid:
    """An ellipsoid."""

    rx: Size = st.key("semi-axis along x", "m")
    ry: Size = st.key("semi-axis along y", "m")
    rz: Size = st.key("semi-axis along z", "m")


@named_arguments
@st.struct("half_space")
class HalfSpace:
    """A half-space, such as a floor, wall or ceiling: all points below z = 0 of its frame are solid."""


Shape = (
    Box
    | Sphere
    | Cylinder
    | Capsule
    | Cone
    | Ellipsoid
    | HalfSpace
    | ConvexShape
    | PointCloud
    | HeightMap
    | OccupancyGrid
    | Mesh
)

SHAPES: tuple[type[Shape], ...] = get_args(Shape)
SHAPES_BY_KEY = {re.sub(r"(?<=[a-z])(?=[A-Z])", "_", k.__name__).lower(): k for k in SHAPES}
"""Every shape by its key in files: ``half_space`` for :class:`HalfSpace`."""

ANYTHING = "*"
"""The name of any robot link or attached object in an allowed contact."""


def _box(stated: Any) -> Box:
    if not isinstance(stated, list):
        raise InputError(f"{stated!r} is not a list of full sides; write box: [x, y, z]")
    return Box(*finite("box", st.parsed(stated), (3,)))


def _only_shape(**shapes: Shape) -> Shape:
    if len(shapes) != 1:
        raise InputError(f"has {' and '.join(shapes) or 'no shape'}; it needs one of {', '.join(SHAPES_BY_KEY)}")
    return next(iter(shapes.values()))


SHAPE = st.Table(
    "shape",
    "Exactly one shape.",
    st.Key("box", st.simple(st.vector(3, SIZE).schema, parse=_box), "the full sides x, y, z of a box", "m"),
    *(
        st.Key(name, table, f"{table.text[0].lower()}{table.text[1:].rstrip('.')}")
        for name, made in SHAPES_BY_KEY.items()
        if made is not Box
        for table in (GRID if made is OccupancyGrid else st.table_of(made),)
    ),
    rules={"oneOf": [{"required": [name]} for name in SHAPES_BY_KEY]},
    make=_only_shape,
)
"""The keys of shapes, of which an obstacle has exactly one."""


CELL = 0.02
"""Metres: the side of the cells of a point cloud that states none."""

CLOSEST = 1000
"""Number of points of a cloud whose distance to the closest other point is measured."""

ROUND = ("Sphere", "Cylinder", "Capsule")
"""The primitives of trimesh whose triangles are inside of what they approximate."""


class _PlacedShape(NamedTuple):
    """A shape that is not about the origin of its obstacle."""

    shape: Shape
    obstacle_from_shape: SE3


def _shape(name: str, value: Any) -> Shape | _PlacedShape:
    """Return a shape, that of an object of another library, or one that contains it; InputError for others.

    Types are recognised by their attributes, so none of the libraries is imported.
    """
    kind = type(value)
    if kind in SHAPES or isinstance(value, SHAPES):
        return value
    if kind.__module__.partition(".")[0] in ("coal", "hppfcl"):
        return _of_coal(name, value)
    # triangles of trimesh are faces; Open3D has vectors of its own
    named = next((each for each in ("faces", "triangles") if hasattr(value, "vertices") and hasattr(value, each)), "")
    if named:
        if hasattr(value, "primitive") and kind.__name__ in ROUND:
            what = f"{name} is a trimesh primitive whose triangles are inside of the {kind.__name__.lower()}"
            raise InputError(f"{what}; pass a pp.{kind.__name__}")
        return Mesh.from_arrays(np.asarray(value.vertices), np.asarray(getattr(value, named)))
    # The points of other objects, such as hulls, tetrahedra, lines and voxels, are not all of what is solid.
    if any(each.__name__ == "PointCloud" for each in kind.__mro__):
        return _cloud(name, value.points if hasattr(value, "points") else value.vertices)
    if isinstance(value, np.ndarray):
        return _cloud(name, value)
    valid = ", ".join(shape.__name__ for shape in SHAPES)
    others = "a geometry of coal, a mesh or point cloud of trimesh or Open3D, points (N, 3)"
    raise InputError(f"{name} is {value!r:.80}; valid: {valid}; {others}")


def _of_coal(name: str, value: Any) -> Shape | _PlacedShape:
    kind, size, vertices, triangles = coal_shape(name, value)
    if kind == "mesh":
        return Mesh.from_arrays(vertices, triangles)
    if kind == "convex":
        return ConvexShape(vertices)
    if kind != "half_space":
        shape: Shape = SHAPES_BY_KEY[kind](*size)  # type: ignore[arg-type]  # as many numbers as the shape has
        return shape
    # all points x with n x <= d: the z axis of ours is the normal
    normal, distance = np.array(size[:3]), size[3]
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    rotation = np.column_stack([first, np.cross(normal, first), normal])
    return _PlacedShape(HalfSpace(), SE3(rotation, distance * normal))


def _cloud(name: str, points: Any) -> PointCloud:
    """The cloud with cells of :data:`CELL`, unless most of its points are farther apart than that."""
    cloud = PointCloud(np.asarray(points), CELL)
    from scipy.spatial import cKDTree

    some: Array = cloud.points[:: max(1, len(cloud.points) // CLOSEST)]
    apart = np.median(cKDTree(cloud.points).query(some, k=2)[0][:, 1])
    if apart > CELL:
        what = f"the points of {name} are {apart:.3g} m apart" if len(cloud.points) > 1 else f"{name} is one point"
        raise InputError(f"{what}; state the side of their cells: pp.PointCloud(points, resolution)")
    return cloud


def _nearby(name: str, value: Any) -> SE3:
    placed = SE3.Identity() if value is None else value
    if not isinstance(placed, SE3) or not is_rigid(placed.homogeneous):
        placed = rigid(name, placed)
    where = placed.homogeneous[:3, 3].tolist()
    if max(map(abs, where)) > LARGEST_SIZE:
        raise InputError(f"{name} is at {where}; coordinates are limited to {LARGEST_SIZE:g} m")
    return frozen(placed)


BODY = "_body"
"""The attribute of an obstacle that keeps its body, if it is a box."""


def _one_arm(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(
            f"{name} = {value!r} must be the name of one arm; a part that several arms hold together is attached to "
            "one of them: see pinproof.planning.plan_carry"
        )
    return value


@st.struct("obstacle", eq=False)
class Obstacle(ByValue):
    """A body: a name, exactly one shape, a pose and a colour."""

    name: str = st.key("its name, unique in its list")
    shape: st.Accepting[Shape, Any] = st.key(
        "its shape; also a geometry of coal, a mesh of trimesh or Open3D, and points (N, 3) or a cloud of these "
        "libraries, whose cells are 2 cm",
        kind=st.simple({}, _shape),
        inline=SHAPE,
    )
    pose: SE3 = st.key(
        "``root_from_obstacle``: its pose in the frame of the robot's root link, SE3 or (4, 4). Copied, and read-only "
        "afterwards; :meth:`Scene.move` returns a scene in which the obstacle has another pose",
        default=None,
        kind=st.simple({}, _nearby),
        inline=st.POSE,
    )
    rgba: tuple[float, float, float, float] | None = st.key(
        "colour and opacity in the viewer, each from 0 to 1",
        default=None,
        kind=st.list_of(st.number(minimum=0, maximum=1), 4, 4),
    )
    arm: str | None = st.key(
        "for an object attached to a joint group with several arms: the name of the arm that carries it",
        default=None,
        kind=st.simple({}, _one_arm),
        hidden=True,
    )

    def __post_init__(self) -> None:
        if isinstance(self.shape, _PlacedShape):
            shape, obstacle_from_shape = self.shape
            object.__setattr__(self, "shape", shape)
            object.__setattr__(self, "pose", frozen(self.pose * obstacle_from_shape))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != BODY}


def stated_shape(shape: Shape, folder: Path) -> tuple[str, Any]:
    """Return the key and value of a shape for a file in ``folder``; an unknown shape is refused."""
    kind = next((name for name, made in SHAPES_BY_KEY.items() if type(shape) is made), None)
    if kind is None:
        raise InputError(f"a {type(shape).__name__} has no key in files; valid: {', '.join(SHAPES_BY_KEY)}")
    # A box is a list, a grid has keys of its own, and paths are relative to the file.
    if isinstance(shape, Box):
        return kind, [shape.x, shape.y, shape.z]
    if isinstance(shape, OccupancyGrid):
        return kind, stated_grid(shape)
    stated = st.table_of(type(shape)).write(shape)
    if not isinstance(shape, Mesh):
        return kind, stated
    if shape.path is not None:
        file = Path(shape.path).resolve()
        stated["path"] = (file.relative_to(folder) if file.is_relative_to(folder) else file).as_posix()
    left_out = ("scale", "path") if shape.path is None else ("vertices", "triangles")
    return kind, {name: value for name, value in stated.items() if name not in left_out and value is not None}
