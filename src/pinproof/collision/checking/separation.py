"""Bodies that separate from obstacles in contact: the directions of separation, and the facets of meshes.

``src/core/certificate/departure.h`` proves that a body never approaches an obstacle along one direction. For an exact
mesh, the facets close to the body at the start are grouped by the directions along which the body separates from them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import coal
import numpy as np
import numpy.typing as npt

from pinproof._core import Departure, DepartureProof, Workspace
from pinproof._core import Shape as CoreShape
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.collision.checking.placed_bodies import MeasureByCoal
from pinproof.collision.geometry.bodies import Body, Support
from pinproof.collision.geometry.hulls import Solid, Surface, bvh
from pinproof.spatial import Array, matrix

Indices = npt.NDArray[np.int64]
Follow = Callable[[Departure], DepartureProof]

FACETS_KEPT = 256
"""Number of groups of facets whose geometry is kept."""

MOST_KEPT = 5000
"""Facets in a group; the geometry of a larger one is not kept, because it takes 1 kB a facet."""

FAILURES = 24
"""Number of failed directions after which no more are tried for one pair."""

MEASURED = 1000
"""Maximum number of facets whose penetration direction is measured, the deepest first: 10 us each."""

NORMALS = 200
"""Maximum number of different facet normals that are tried."""

SAME_DIRECTION = 1e-9
"""Directions that differ by less are equal."""

UNIT = 1e-6
"""Tolerance of the length of a measured normal."""

ONE_TRIANGLE = np.array([[0, 1, 2]])


class MovingBody:
    """A body that moves with a link: its placement at a configuration, and the support function of its hull."""

    def __init__(self, checker: CollisionChecker, body: int) -> None:
        self._world, self._index = checker.world, body
        self._space = Workspace(checker.world)
        self.rounding = checker.rounding
        self._support, moved = hull_support(checker.bodies[body]), checker.bodies[body]
        self._hull = moved.core_shape
        if moved.support is None and self._support is not None:  # an exact mesh
            points = np.ascontiguousarray(self._support.points)
            self._hull = CoreShape.convex(points, np.zeros(len(points)), 0.0, np.zeros(3), moved.box)
        self.move(np.zeros(checker.group.dof))

    def move(self, q: Array) -> None:
        """Place it at q (n,)."""
        self._space.place(np.ascontiguousarray(q))
        self.at = self._space.root_from_body(self._index)

    def departure(self, normal: Array, level: float) -> Departure:
        """Return its motion along ``normal`` (3,), away from a body with the extent ``level`` (m) along it."""
        return Departure(self._world, self._index, self._hull, normal, level)

    def reach(self, directions: Array) -> Array:
        """Return (d,) the largest ``direction . y`` over its points y, for directions (d, 3) in the root frame."""
        return reach(self._support, self.at, directions)


def hull_support(body: Body) -> Support | None:
    """Return the support function of the convex hull of a body of any kind; None for a half-space."""
    if body.support is not None or isinstance(body.geometry, coal.Halfspace):
        return body.support
    return Support(np.array(body.geometry.vertices()))


def reach(support: Support | None, at: Array, directions: Array) -> Array:
    """Return (d,) the largest ``direction . x`` over a body at ``at`` (4, 4); of a half-space along its own normal."""
    origin = directions @ at[:3, 3]
    return np.asarray(origin if support is None else origin + support.reach(directions @ at[:3, :3]))


class FacetGroup(NamedTuple):
    """Facets from which a body separates along one direction."""

    facets: Indices  # in the mesh
    departure: Departure
    proof: DepartureProof
    gap: float  # m, at the start along the direction; negative if they overlap


def facets_of(body: Body) -> tuple[Array, Indices]:
    """Return the vertices (V, 3), in its own frame, and the triangles (F, 3) of an exact mesh."""
    geometry = body.geometry
    if isinstance(body.solid, Solid):
        return body.solid.vertices, body.solid.triangles
    triangles = (geometry.tri_indices(i) for i in range(geometry.num_tris))
    return np.array(geometry.vertices()), np.array([(t[0], t[1], t[2]) for t in triangles], dtype=np.int64)


def facet_body(body: Body, name: str, facets: Indices) -> Body:
    """Return an obstacle of some facets of an exact mesh, by their indices: a surface of the same owner."""
    make = _facet_geometry if len(facets) <= MOST_KEPT else _facet_geometry.__wrapped__
    geometry, box, surface = make(body, facets.tobytes())
    return Body(name, body.owner, body.link, geometry, body.link_from_body, box, None, surface)


@lru_cache(maxsize=FACETS_KEPT)
def _facet_geometry(body: Body, facets: bytes) -> tuple[Any, Array, Surface]:
    """Return geometry, box and surface of some facets: the pieces of a part leave the same ones in many motions."""
    vertices, triangles = facets_of(body)
    used, index = np.unique(triangles[np.frombuffer(facets, dtype=np.int64)], return_inverse=True)
    points, faces = vertices[used], index.reshape(-1, 3)
    return bvh(points, faces), np.array([points.min(axis=0), points.max(axis=0)]), Surface(points[faces])


def leave_facets(
    moving: MovingBody, body: Body, corners: Array, directions: Array, *, reach: float, deepest: float, follow: Follow
) -> tuple[list[FacetGroup], float]:
    """Return groups of facets from which a body at its start separates, or which it does not approach at first.

    Facets in no group need the ordinary proof: those farther from the body than ``reach`` (m), and those that the body
    penetrates by more than ``deepest`` (m) in every direction. A group whose proof has ``until`` at infinity has no
    direction of separation. Also returns the gap (m) at the facet that is penetrated most, along its best direction.
    ``corners`` (F, 3, 3) are in the root frame, ``directions`` (d, 3) are tried besides the normals of the facets, and
    ``follow`` follows the curve along a direction.
    """
    # The gaps of the facets near the body along all directions that are tried.
    near = np.flatnonzero(_near(moving, corners, directions, reach))
    if not len(near):
        return [], np.inf
    facets = corners[near]
    normals = _commonest(_normals(facets))
    tried = distinct(np.concatenate([directions, normals, -normals]))
    tops, gaps = _gaps(moving, facets, tried)
    if body.support is not None:  # where facet and body overlap, coal measures the direction
        unclear = np.flatnonzero(gaps.max(axis=0) < -moving.rounding)
        deep_first = unclear[np.argsort(gaps.max(axis=0)[unclear], kind="stable")][:MEASURED]
        more = _measured(moving, body, facets[deep_first])
        if len(more):
            tried = distinct(np.concatenate([tried, more]))
            tops, gaps = _gaps(moving, facets, tried)
    best = gaps.max(axis=0)
    due = best >= -deepest
    if not due.any():
        return [], float(best.min())
    # The direction that serves the most facets comes first. One along which the body does not separate is kept for the
    # facets that no other direction serves.
    depth = max(-float(best[due].min()), 0.0)  # the penetration never exceeds that at the start
    serves = (gaps >= -depth - moving.rounding) & due
    found: list[FacetGroup] = []
    failed: dict[int, tuple[Departure, DepartureProof]] = {}
    while due.any() and len(failed) < FAILURES:
        counts = (serves & due).sum(axis=1)
        counts[list(failed)] = 0
        chosen = int(counts.argmax())
        if counts[chosen] == 0:
            break
        group = serves[chosen] & due
        departure = moving.departure(tried[chosen], float(tops[chosen, group].max()))
        proof = follow(departure)
        if proof.until == np.inf:
            failed[chosen] = departure, proof
            continue
        found.append(FacetGroup(near[group], departure, proof, float(gaps[chosen, group].min())))
        due &= ~group
    for chosen, (_, proof) in sorted(failed.items(), key=lambda each: -each[1][1].end):
        group = serves[chosen] & due
        if group.any():
            departure = moving.departure(tried[chosen], float(tops[chosen, group].max()))
            found.append(FacetGroup(near[group], departure, proof, float(gaps[chosen, group].min())))
            due &= ~group
    # Each group is extended by all facets of the mesh with no larger extent along its direction: the same proof holds
    # for them, and a verdict does not depend on how finely a plane is cut into facets.
    grouped = np.zeros(len(corners), dtype=bool)
    for part in found:
        grouped[part.facets] = True
    for k, part in enumerate(found):
        others = np.flatnonzero(((corners @ part.departure.normal).max(axis=1) <= part.departure.level) & ~grouped)
        grouped[others] = True
        found[k] = part._replace(facets=np.sort(np.concatenate([part.facets, others])))
    return found, float(best.min())


def directions_to_facets(checker: CollisionChecker, pair: int, q: Array, reach: float) -> Array:
    """Return (k, 3) unit vectors from a body of the robot at q (n,) to the facets of a mesh within ``reach`` (m).

    Each is opposite to the direction along which body and facet are farthest apart, or overlap least. Empty for a mesh
    that is farther away, and for an obstacle without facets.
    """
    a, b = checker.indices_of(pair)
    body, at = checker.bodies[b], matrix(checker.bodies[b].link_from_body)
    if body.support is not None or body.link is not None or isinstance(body.geometry, coal.Halfspace):
        return np.empty((0, 3))
    moving = MovingBody(checker, a)
    moving.move(q)
    vertices, triangles = facets_of(body)
    corners = (vertices @ at[:3, :3].T + at[:3, 3])[triangles]
    # The facets within reach, and for each the direction of the largest gap.
    own = at[:3, :3].T
    directions = np.array([[0.0, 0.0, 1.0], *own, *-own])
    near = corners[_near(moving, corners, directions, reach)]
    normals = _commonest(_normals(near)) if len(near) else np.empty((0, 3))
    tried = distinct(np.concatenate([directions, normals, -normals]))
    _, gaps = _gaps(moving, near, tried)
    return np.asarray(-tried[gaps.argmax(axis=0)])


def _near(moving: MovingBody, corners: Array, directions: Array, reach: float) -> npt.NDArray[np.bool_]:
    """Return (F,) whether triangles may be within ``reach`` of the body; some directions are tried to exclude it."""
    own = moving.at[:3, :3].T
    _, gaps = _gaps(moving, corners, np.concatenate([directions, own, -own]))
    near = gaps.max(axis=0) <= reach
    left = np.flatnonzero(near)
    normals = _normals(corners[left])
    levels = np.einsum("fj,fj->f", normals, corners[left, 0])
    above = -moving.reach(-normals) - levels
    below = -moving.reach(normals) + levels
    near[left] = np.maximum(above, below) <= reach
    return np.asarray(near)


def _gaps(moving: MovingBody, corners: Array, directions: Array) -> tuple[Array, Array]:
    """Return (d, F) the extents of triangles along directions, and the gaps to the body."""
    tops = np.max(np.stack([directions @ corners[:, corner].T for corner in range(3)]), axis=0)
    return tops, -moving.reach(-directions)[:, None] - tops


def _normals(corners: Array) -> Array:
    """Return (F, 3) the unit normals of triangles; z for a triangle without an area."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1)
    flat = length == 0.0
    return np.where(flat[:, None], np.array([0.0, 0.0, 1.0]), across / np.where(flat, 1.0, length)[:, None])


def _commonest(normals: Array) -> Array:
    """Return the :data:`NORMALS` most frequent directions."""
    different, counts = np.unique(np.round(normals / SAME_DIRECTION), axis=0, return_counts=True)
    if len(different) <= NORMALS:
        return normals
    kept = different[np.argsort(-counts, kind="stable")[:NORMALS]]
    return np.asarray(kept / np.linalg.norm(kept, axis=1)[:, None])


def distinct(directions: Array) -> Array:
    """Return the directions without repetitions, in order of first occurrence."""
    first: dict[tuple[float, ...], int] = {}
    for i, key in enumerate(np.round(directions / SAME_DIRECTION).tolist()):
        first.setdefault(tuple(key), i)
    return np.asarray(directions[list(first.values())])


def _measured(moving: MovingBody, body: Body, facets: Array) -> Array:
    """Return (m, 3) the directions from facets to a close or penetrating convex body, computed by coal."""
    measure, still = MeasureByCoal(), np.eye(4)
    found = []
    for facet in facets:
        found.append(-measure.of(body.geometry, moving.at, bvh(facet, ONE_TRIANGLE), still).normal)
    return unit_vectors(np.array(found).reshape(-1, 3))


def unit_vectors(directions: Array) -> Array:
    """Return the rows (d, 3) that are unit vectors; of overlapping bodies, coal's normals may be zero or not finite."""
    # Along a vector without a length, every gap is 0 and no body ever approaches, which would be a false proof.
    with np.errstate(invalid="ignore", over="ignore"):
        lengths = np.sqrt((directions * directions).sum(axis=1))
    kept = np.abs(lengths - 1.0) < UNIT
    return np.asarray(directions[kept] / lengths[kept, None])
