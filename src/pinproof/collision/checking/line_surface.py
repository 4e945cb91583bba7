"""Where parallel lines enter a body: the visible surface of convex bodies and triangle meshes along a direction.

This is the geometry of contact patches: two bodies that approach each other along a direction touch where the distance
between their facing surfaces along that direction is smallest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from pinproof._core import enter_triangles
from pinproof.collision.checking.placed_bodies import MeasureByCoal
from pinproof.collision.geometry.bodies import Body, Support, one_inside_other, shape_body, triangles_of
from pinproof.collision.geometry.hulls import Solid, rounded_corners
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.shapes import HeightMap, Mesh, Obstacle, PointCloud, Sphere
from pinproof.collision.geometry.surfaces import cell_faces, ground_surface
from pinproof.errors import InputError
from pinproof.spatial import SE3, Array

CONE_SIDES = 128
"""Sides of the inscribed pyramid by which the surface of a cone is intersected; it is within 0.03 % of the radius."""

OUTER_SIDES = 16
"""Sides of the circumscribed prism that bounds a disc; at most 2 % of the radius beyond it."""

TOUCH = 1e-5
"""Metres: bodies at this distance or less touch."""

MOST_ADVANCES = 2000
"""Maximum number of steps of a conservative advancement: enough to pass 20 mm along a surface at that distance."""

POINT_RADIUS = 1e-6
"""Metres: the radius of the ball by which coal measures how far a point is from a body."""

PARALLEL = 1e-12
"""Sine of an angle: a line that meets a plane at less is parallel to it."""


class SurfacePoints(NamedTuple):
    """Where lines enter a body: ``depth`` (G,) along the direction (m), inf on a miss; unit outward normals (G, 3)."""

    depth: Array
    normals: Array


@dataclass(frozen=True, eq=False)
class LineSurface:
    """The surface of a body as lines meet it, in the body's own frame.

    ``triangles`` (F, 3, 3) are the surface of a mesh, None for a convex body with a support function. ``surface`` is a
    body of the surface alone, if ``body`` is larger: a hull that represents a mesh.
    """

    body: Body
    triangles: Array | None = None
    surface: Body | None = None

    @classmethod
    def of_body(cls, body: Body) -> LineSurface:
        """Return the surface of a body that is convex or an exact mesh; InputError if it is unbounded."""
        if body.support is not None:
            return cls(body)
        corners = getattr(body.solid, "corners", None)
        if corners is None:
            raise InputError(f"{body.name!r} has no bounded surface that could be gripped or could grip")
        return cls(body, np.asarray(corners))

    @classmethod
    def of_obstacle(cls, thing: Obstacle) -> LineSurface:
        """Return the surface of an obstacle; a mesh is represented by its triangles, also if its hull is checked."""
        shape = thing.shape
        if isinstance(shape, Mesh):
            mesh = triangles_of(shape)
            watertight = shape.hull is False or Solid(mesh.vertices, mesh.triangles).watertight
            if shape.hull is None:  # the rule of collision checks, but one body in place of convex pieces
                shape = replace(shape, hull=not watertight)
            body = shape_body(thing.name, thing.name, None, shape, thing.pose)
            bare = replace(shape, hull=False, hollow=not watertight)
            surface = shape_body(thing.name, thing.name, None, bare, thing.pose) if shape.hull else None
            return cls(body, np.asarray(mesh.vertices[mesh.triangles]), surface)
        body = shape_body(thing.name, thing.name, None, shape, thing.pose)
        if isinstance(shape, PointCloud | OccupancyGrid | HeightMap):
            vertices, triangles = ground_surface(shape) if isinstance(shape, HeightMap) else cell_faces(shape)
            return cls(body, np.asarray(vertices[triangles]))
        return cls.of_body(body)

    def reach(self, direction: Array) -> float:
        """Return the largest ``direction . x`` over the body."""
        return float(self.reaches(direction[None])[0])

    def reaches(self, directions: Array) -> Array:
        """Return (K,) :meth:`reach` for each of the directions (K, 3)."""
        if self.triangles is not None:
            return np.asarray((self.triangles.reshape(-1, 3) @ directions.T).max(axis=0))
        return np.asarray(_support(self.body).reach(directions))

    def enter(self, origins: Array, direction: Array, after: Array | float = -np.inf) -> SurfacePoints:
        """Return where lines from origins (G, 3) along a unit direction (3,) first meet the surface.

        Points of a mesh before the depths ``after`` (G,) are ignored. A line enters a convex body once, and misses it
        if it leaves the body before this depth.
        """
        start = np.full(len(origins), after, dtype=float)
        if self.triangles is not None:
            lines = np.ascontiguousarray(origins), np.ascontiguousarray(direction)
            return SurfacePoints(*enter_triangles(np.ascontiguousarray(self.triangles), *lines, start))
        depth, out, normals = self.span(origins, direction)
        return SurfacePoints(np.where((depth <= out) & (out > start), depth, np.inf), normals)

    @cached_property
    def span(self) -> Span:
        """Where lines enter and leave a convex body."""
        support = _support(self.body)
        points, discs = support.points, support.disc_radii
        if support.semi_axes.any():
            if len(points) == 1 and support.radius == 0 and not discs.any():
                return partial(_ellipsoid, points[0], support.semi_axes)
        elif discs.any():
            if len(points) == 2 and support.radius == 0 and discs[0] == discs[1]:
                return partial(_cylinder, points, float(discs[0]))
            if support.radius == 0:  # a cone: an inscribed pyramid
                angles = np.arange(CONE_SIDES) * 2 * np.pi / CONE_SIDES
                ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(CONE_SIDES)], axis=1)
                rim = np.unique((points[:, None] + discs[:, None, None] * ring).reshape(-1, 3), axis=0)
                return partial(_planes, *_facets(rim))
        elif support.radius > 0 and len(points) <= 2 and not np.ptp(points[:, :2], axis=0).any():
            # a sphere or a capsule: the union of two balls and a cylinder
            parts: list[Span] = [partial(_ellipsoid, point, np.full(3, support.radius)) for point in points]
            if len(points) == 2:
                parts.append(partial(_cylinder, points, support.radius))
            return partial(_union, parts)
        else:
            return partial(_planes, *_facets(rounded_corners(points, support.radius)))
        raise InputError("a body of this kind has no surface that lines could be intersected with")


def _support(body: Body) -> Support:
    if body.support is None:
        raise InputError(f"{body.name!r} is not convex")
    return body.support


def body_distance(one: LineSurface, at: SE3, other: LineSurface, other_at: SE3) -> float:
    """Return the signed distance (m) of two surfaces; if they overlap, minus the penetration depth computed by coal.

    A mesh that is represented by its hull is measured as the hull, so the distance is never too large.
    """
    measured = MeasureByCoal()(one.body, at.homogeneous, other.body, other_at.homogeneous).attained
    inside = measured > 0 and one_inside_other(one.body, at, other.body, other_at)
    return -measured if inside else measured


def travel_to_touch(one: LineSurface, at: SE3, other: LineSurface, other_at: SE3, motion: Array) -> float:
    """Return the share of a straight ``motion`` (3,) after which a body is within :data:`TOUCH` of another surface.

    1 if it does not come that near; NaN if it is that near at the start, or after too many steps. The method is
    conservative advancement (Mirtich, 1996): a body that moves by less than its distance cannot touch.
    """
    length = float(np.linalg.norm(motion))
    measure, target, share = MeasureByCoal(), other.surface or other.body, 0.0
    for step in range(MOST_ADVANCES):
        moved = SE3(at.rotation, at.translation + share * motion)
        apart = measure(one.surface or one.body, moved.homogeneous, target, other_at.homogeneous).attained
        if apart <= TOUCH:
            return share if step else np.nan
        share += apart / max(length, np.finfo(float).tiny)
        if share >= 1.0:
            return 1.0
    return np.nan


def point_distance(surface: LineSurface, point: Array) -> float:
    """Return the distance (m) of a point (3,) in the frame of a body from its surface, from outside or from inside.

    From inside it is the smallest along 26 directions, among them the axes of the body, and those from its middle and
    from its z axis: exact for boxes, spheres and cylinders, otherwise an upper bound. (Coal's depth of a point in a
    cylinder is always that to its side.)
    """
    ball = LineSurface.of_obstacle(Obstacle("point", Sphere(radius=POINT_RADIUS)))
    apart = body_distance(ball, SE3(np.eye(3), point), surface, SE3.Identity()) + POINT_RADIUS
    if apart > POINT_RADIUS:
        return apart
    many = np.array([*np.ndindex(3, 3, 3)])[14:] - 1.0  # one of each two opposite directions
    many = np.concatenate([many, [point, point * [1.0, 1.0, 0.0]]])
    directions = _unit(many[many.any(axis=1)])
    if surface.triangles is not None:
        both = np.concatenate([directions, -directions])
        return min(float(surface.enter(point[None], each, 0.0).depth[0]) for each in both)
    # A line through a convex body gives the distances in two opposite directions.
    lines = [surface.span(point[None], direction) for direction in directions]
    return min(abs(float(end[0])) for into, out, _ in lines for end in (into, out))


def depth_along(surface: LineSurface, point: Array, direction: Array, length: float) -> float:
    """Return how far (m) a point (3,) is behind the first surface on a line of a ``length`` (m) that ends at the point.

    The unit ``direction`` (3,) is that of the line, in the frame of the body. 0 if the line meets no surface. If it
    starts inside the body, the depth is that below the surface at which a longer line would enter.
    """
    entered = float(surface.enter(point[None], direction, -length).depth[0])
    solid = (surface.surface or surface.body).solid
    if surface.triangles is not None and solid is not None and solid.contains((point - length * direction)[None]):
        back = surface.enter((point - length * direction)[None], -direction, 0.0).depth[0]
        entered = -length - float(back)
    return max(-entered, 0.0)


def outer_points(surface: LineSurface) -> Array:
    """Return (V, 3) points in the frame of a body whose convex hull contains it."""
    if surface.body.support is None or surface.triangles is not None:
        return np.asarray((surface.triangles if surface.triangles is not None else np.empty((0, 3))).reshape(-1, 3))
    support = surface.body.support
    # A disc is in a circumscribed prism, and what a body is grown by in a box.
    angles = np.arange(OUTER_SIDES) * 2 * np.pi / OUTER_SIDES
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(OUTER_SIDES)], axis=1) / np.cos(np.pi / OUTER_SIDES)
    points = support.points
    if support.disc_radii.any():
        points = (points[:, None] + support.disc_radii[:, None, None] * ring).reshape(-1, 3)
    grown = support.semi_axes + support.radius
    if grown.any():
        corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
        points = (points[:, None] + corners * grown).reshape(-1, 3)
    return np.asarray(points)


# -- convex bodies ----------------------------------------------------------------------------------------------------


Span = Callable[[Array, Array], tuple[Array, Array, Array]]
"""For origins (G, 3) and a direction (3,): where lines enter and leave a convex body (G,), and the outward normals
(G, 3) where they enter."""


def _facets(points: Array) -> tuple[Array, Array]:
    """Return the planes ``normals . x <= offsets`` of the hull of points (V, 3), without repetitions."""
    from scipy.spatial import ConvexHull

    planes = np.unique(np.round(ConvexHull(points).equations, 12), axis=0)
    return planes[:, :3], -planes[:, 3]


def _planes(normals: Array, offsets: Array, origins: Array, direction: Array) -> tuple[Array, Array, Array]:
    """Clip lines by half-spaces (Cyrus and Beck, 1978)."""
    slope = normals @ direction
    depths = offsets - origins @ normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        at = depths / slope
    front, back = slope < -PARALLEL, slope > PARALLEL
    entering = np.where(front, at, -np.inf)
    first = entering.argmax(axis=1)
    depth = entering[np.arange(len(origins)), first]
    out = np.where(back, at, np.inf).min(axis=1)
    missed = (np.where(front | back, np.inf, depths) < 0).any(axis=1)
    return np.where(missed, np.inf, depth), np.where(missed, -np.inf, out), normals[first]


def _ellipsoid(centre: Array, semi_axes: Array, origins: Array, direction: Array) -> tuple[Array, Array, Array]:
    o, d = (origins - centre) / semi_axes, direction / semi_axes
    a, b, c = d @ d, o @ d, (o**2).sum(axis=1) - 1.0
    inside = b**2 - a * c
    root = np.sqrt(np.maximum(inside, 0.0))
    depth = np.where(inside >= 0, (-b - root) / a, np.inf)
    out = np.where(inside >= 0, (-b + root) / a, -np.inf)
    with np.errstate(invalid="ignore"):
        normals = (o + depth[:, None] * d) / semi_axes
    return depth, out, _unit(normals)


def _cylinder(ends: Array, radius: float, origins: Array, direction: Array) -> tuple[Array, Array, Array]:
    """Intersect lines with a cylinder about z between two ends (2, 3)."""
    o, d = origins[:, :2] - ends[0, :2], direction[:2]
    a, b, c = d @ d, o @ d, (o**2).sum(axis=1) - radius**2
    if a > PARALLEL**2:
        inside = b**2 - a * c
        root = np.sqrt(np.maximum(inside, 0.0))
        side_in = np.where(inside >= 0, (-b - root) / a, np.inf)
        side_out = np.where(inside >= 0, (-b + root) / a, -np.inf)
    else:
        side_in, side_out = np.where(c <= 0, -np.inf, np.inf), np.where(c <= 0, np.inf, -np.inf)
    # The slab between the ends; a line is inside of the cylinder where it is inside of both.
    caps = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    levels = np.array([-ends[:, 2].min(), ends[:, 2].max()])
    cap_in, cap_out, cap_normals = _planes(caps, levels, origins, direction)
    depth, out = np.maximum(side_in, cap_in), np.minimum(side_out, cap_out)
    missed = depth > out
    depth, out = np.where(missed, np.inf, depth), np.where(missed, -np.inf, out)
    with np.errstate(invalid="ignore"):
        radial = np.concatenate([o + side_in[:, None] * d, np.zeros((len(o), 1))], axis=1)
    normals = np.where((cap_in > side_in)[:, None], cap_normals, _unit(radial))
    return depth, out, normals


def _union(parts: Sequence[Span], origins: Array, direction: Array) -> tuple[Array, Array, Array]:
    """Return the first entry and the last exit of bodies whose union is convex."""
    into, out, normals = map(np.array, zip(*(part(origins, direction) for part in parts), strict=True))
    first, rows = into.argmin(axis=0), np.arange(into.shape[1])
    return into[first, rows], out.max(axis=0), normals[first, rows]


def _unit(vectors: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.nan_to_num(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
