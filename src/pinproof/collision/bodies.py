"""Bodies that can touch: links, attached objects and obstacles as coal shapes, each with what bounds it.

A convex body carries its support function, from which the certificate proves distances whether or not GJK converged; an
exact mesh carries the points that tell whether it lies inside another (coal's meshes are hollow).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.collision.shapes import Box, Cylinder, Mesh, Shape, Sphere
from pinproof.collision.solid import Solid
from pinproof.description.meshes import read_mesh
from pinproof.errors import MeshError

__all__ = ["Body", "Support", "boxes", "bvh", "shape_body"]

Array = npt.NDArray[np.float64]

FLAT = 1e-6
"""Metres. Points thinner than this in some direction have no hull: Qhull ends the interpreter on them."""

FLAT_SHARE = 1e-7
"""The same as a share of the longest side: Qhull was seen to crash at 1e-8 of it (1 um of 100 m), to work at 1e-7."""


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

    def reach(self, direction: Array) -> float:
        """The largest ``direction . x`` over the body, for a unit direction (3,) in the body's own frame.

        max_v (p_v . d + disc_v hypot(d_x, d_y)) + radius + |semi_axes * d|: supports of Minkowski sums add up (R. T.
        Rockafellar, 1970, "Convex analysis", corollary 16.4.1), that of a hull of unions is their maximum.
        """
        flat = float(np.hypot(direction[0], direction[1]))
        reach = float((self.points @ direction + self.disc_radii * flat).max()) + self.radius
        return reach + float(np.linalg.norm(self.semi_axes * direction))


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
        The surface whose inside counts as contact too: that of an exact mesh. None for what is convex.
    """

    name: str
    owner: str
    link: str | None
    geometry: Any
    link_from_body: pin.SE3
    box: Array
    support: Support | None
    solid: Solid | None = None

    @property
    def reach(self) -> float:
        """How far (m) its origin lies from that of its link, or of the root for an obstacle."""
        return float(np.linalg.norm(self.link_from_body.translation))


def shape_body(name: str, owner: str, link: str | None, shape: Shape, link_from_body: pin.SE3) -> Body:
    """A body of any shape."""
    if isinstance(shape, Mesh):
        return _mesh_body(name, owner, link, shape, link_from_body)
    if isinstance(shape, Box):
        half = np.array([shape.x, shape.y, shape.z]) / 2
        corners = np.array(np.meshgrid(*zip(-half, half, strict=True))).reshape(3, 8).T
        geometry, support = coal.Box(shape.x, shape.y, shape.z), Support(corners)
    elif isinstance(shape, Sphere):
        half = np.full(3, shape.radius)
        geometry, support = coal.Sphere(shape.radius), Support(np.zeros((1, 3)), shape.radius)
    elif isinstance(shape, Cylinder):
        half = np.array([shape.radius, shape.radius, shape.length / 2])
        geometry = coal.Cylinder(shape.radius, shape.length)
        support = Support(np.array([[0, 0, -half[2]], [0, 0, half[2]]]), disc_radii=np.full(2, shape.radius))
    else:
        half = np.array([shape.radius, shape.radius, shape.length / 2 + shape.radius])
        geometry = coal.Capsule(shape.radius, shape.length)
        ends = np.array([[0, 0, -shape.length / 2], [0, 0, shape.length / 2]])
        support = Support(ends, shape.radius)
    return Body(name, owner, link, geometry, link_from_body.copy(), np.array([-half, half]), support)


def _mesh_body(name: str, owner: str, link: str | None, shape: Mesh, link_from_body: pin.SE3) -> Body:
    mesh = read_mesh(shape.path, shape.scale)  # type: ignore[arg-type]  # made three numbers by Mesh
    box = np.array([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
    surface = bvh(mesh.vertices, mesh.triangles)
    if not shape.hull:
        return Body(name, owner, link, surface, link_from_body.copy(), box, None, Solid(mesh.vertices, mesh.triangles))
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    sides = np.ptp(centred @ np.linalg.svd(centred, full_matrices=False)[2].T, axis=0)
    thinnest = float(sides.min())
    if len(mesh.vertices) < 4 or thinnest < max(FLAT, FLAT_SHARE * float(sides.max())):
        raise MeshError(
            shape.path, f"is flat ({thinnest:.1g} m thick), so it has no hull; use the exact mesh, or give it thickness"
        )
    # buildConvexRepresentation would only re-label the mesh as convex and miss collisions; this is the hull (Qhull).
    try:
        surface.buildConvexHull(True, "Qt")
    except RuntimeError as error:
        raise MeshError(shape.path, f"has no hull that coal can use ({error}); use the exact mesh") from error
    hull = surface.convex
    return Body(name, owner, link, hull, link_from_body.copy(), box, Support(np.array(hull.points(), dtype=float)))


def bvh(vertices: Array, triangles: npt.NDArray[np.int64]) -> Any:
    """A coal mesh of triangles."""
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addVertices(np.ascontiguousarray(vertices))
    model.addTriangles(np.ascontiguousarray(triangles, dtype=np.int64))
    model.endModel()
    return model


def boxes(bodies: Sequence[Body]) -> tuple[Array, Array]:
    """Centres (B, 3) and half sides (B, 3) of the bodies' boxes, each in its body's frame."""
    stacked = np.array([body.box for body in bodies]).reshape(-1, 2, 3)
    return stacked.mean(axis=1), (stacked[:, 1] - stacked[:, 0]) / 2
