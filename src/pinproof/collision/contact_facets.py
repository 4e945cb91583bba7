"""The facets of an exact mesh near which a body starts, in groups that it leaves along one direction each.

A mesh that is not convex, such as a bin, has no direction along which a body inside its hull leaves all of it. But the
body may leave every facet that it starts near to, and keep away from all others. Let A be the body, eroded by the depth
d to which it may penetrate at the start. If every facet of a closed surface is either left along a direction n with a
gap of at least -d that never falls, or kept away from, then A never crosses the surface. So if A is outside at the end,
which the ordinary proof shows, it was outside at every time before. Each facet is convex, so the proof of
:mod:`.rising` holds for it, and for any group of facets too, with the largest level of the group.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import coal
import numpy as np
import numpy.typing as npt

from pinproof.collision.bodies import Body
from pinproof.collision.by_coal import MeasureConvex
from pinproof.collision.hulls import bvh
from pinproof.collision.rising import Mover, Rise, Rising
from pinproof.collision.solid import Solid

if TYPE_CHECKING:
    from pinproof.collision.checker import CollisionChecker

__all__ = ["FacetGroup", "directions_to_facets", "facet_body", "facets_of", "leave_facets", "unit_vectors"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Follow = Callable[[Rising], Rise]

FAILURES = 24
"""Directions along which a body was not proven to leave, after which no more are tried for one pair."""

MEASURED = 1000
"""Facets at most of which the direction of penetration is measured, the deepest first: 10 us each."""

NORMALS = 200
"""Different normals of facets that are tried at most: a finely curved surface has as many as facets."""

SAME_DIRECTION = 1e-9
"""Directions that differ by less are tried once."""


UNIT = 1e-6
"""How far the length of a measured normal may be from 1."""

ONE_TRIANGLE = np.array([[0, 1, 2]])


class FacetGroup(NamedTuple):
    """Facets that a body leaves along one direction."""

    facets: Indices
    """Their indices in the mesh."""
    rising: Rising
    rise: Rise
    gap: float
    """Metres at the start, along the direction; below 0 where they overlap."""


def facets_of(body: Body) -> tuple[Array, Indices]:
    """The vertices (V, 3), in its own frame, and the triangles (F, 3) of an exact mesh."""
    geometry = body.geometry
    triangles = (geometry.tri_indices(i) for i in range(geometry.num_tris))
    return np.array(geometry.vertices()), np.array([(t[0], t[1], t[2]) for t in triangles], dtype=np.int64)


def facet_body(body: Body, name: str, vertices: Array, triangles: Indices) -> Body:
    """An obstacle made of some of the triangles of an exact mesh: a bare surface of the same owner."""
    used, index = np.unique(triangles, return_inverse=True)
    points, faces = vertices[used], index.reshape(-1, 3)
    return Body(
        name,
        body.owner,
        body.link,
        bvh(points, faces),
        body.link_from_body,
        np.array([points.min(axis=0), points.max(axis=0)]),
        None,
        Solid(points, faces, hollow=True),
    )


def leave_facets(
    mover: Mover,
    body: Body,
    corners: Array,
    directions: Array,
    *,
    reach: float,
    deepest: float,
    follow: Follow,
) -> tuple[list[FacetGroup], float]:
    """The groups of facets that a body, placed where it starts, leaves or at least does not approach at first.

    Facets of no group are to be kept away from. Directions that lead away for good come first; a group whose rise has
    ``until`` at infinity is one for which none was found. With them comes the gap (m) at the facet that is penetrated
    deepest, along the best direction for that facet: coal's depth of a mesh is that of any facet.

    Parameters
    ----------
    mover, body
        What leaves.
    corners
        (F, 3, 3) the triangles in the root frame.
    directions
        (d, 3) directions to try besides the normals of the facets; of equally good ones, the first is taken.
    reach
        Metres. Facets proven farther from the body than this are in no group.
    deepest
        Metres. Facets that the body penetrates by more than this in every direction are in no group.
    follow
        Goes along the curve.
    """
    near = np.flatnonzero(_near(mover, corners, directions, reach))
    if not len(near):
        return [], np.inf
    facets = corners[near]
    normals = _commonest(_normals(facets))
    tried = _distinct(np.concatenate([directions, normals, -normals]))
    tops, gaps = _gaps(mover, facets, tried)
    if body.support is not None:
        unclear = np.flatnonzero(gaps.max(axis=0) < -mover.rounding)
        deep_first = unclear[np.argsort(gaps.max(axis=0)[unclear], kind="stable")][:MEASURED]
        more = _measured(mover, body, facets[deep_first])
        if len(more):
            tried = _distinct(np.concatenate([tried, more]))
            tops, gaps = _gaps(mover, facets, tried)
    best = gaps.max(axis=0)
    due = best >= -deepest
    if not due.any():
        return [], float(best.min())
    depth = max(-float(best[due].min()), 0.0)  # it never becomes deeper than it is at the start
    serves = (gaps >= -depth - mover.rounding) & due
    found: list[FacetGroup] = []
    failed: dict[int, tuple[Rising, Rise]] = {}
    while due.any() and len(failed) < FAILURES:
        counts = (serves & due).sum(axis=1)
        counts[list(failed)] = 0
        chosen = int(counts.argmax())
        if counts[chosen] == 0:
            break
        group = serves[chosen] & due
        rising = Rising(mover, tried[chosen], float(tops[chosen, group].max()))
        rise = follow(rising)
        if rise.until == np.inf:
            failed[chosen] = rising, rise
            continue
        found.append(FacetGroup(near[group], rising, rise, float(gaps[chosen, group].min())))
        due &= ~group
    for chosen, (_, rise) in sorted(failed.items(), key=lambda each: -each[1][1].end):
        group = serves[chosen] & due
        if group.any():
            rising = Rising(mover, tried[chosen], float(tops[chosen, group].max()))
            found.append(FacetGroup(near[group], rising, rise, float(gaps[chosen, group].min())))
            due &= ~group
    return _extended(found, corners), float(best.min())


def _extended(groups: list[FacetGroup], corners: Array) -> list[FacetGroup]:
    """The groups, each with all facets of the mesh that reach no farther along its direction.

    The same proof holds for them, and a verdict does not depend on how finely a plane is cut into facets.
    """
    grouped = np.zeros(len(corners), dtype=bool)
    for group in groups:
        grouped[group.facets] = True
    out = []
    for group in groups:
        tops = (corners @ group.rising.normal).max(axis=1)
        more = np.flatnonzero((tops <= group.rising.level) & ~grouped)
        grouped[more] = True
        out.append(group._replace(facets=np.sort(np.concatenate([group.facets, more]))))
    return out


def directions_to_facets(checker: CollisionChecker, pair: int, q: Array, reach: float) -> Array:
    """(k, 3) unit vectors from a body of the robot at q (n,) to the facets of an exact mesh within ``reach`` (m) of it.

    For each facet, against the direction along which the two are farthest apart, or overlap least. None for a mesh that
    is farther away, and for an obstacle that has no facets.
    """
    a, b = checker.pairs[pair]
    body, at = checker.bodies[b], checker.at[b]
    if body.support is not None or body.link is not None or isinstance(body.geometry, coal.Halfspace):
        return np.empty((0, 3))
    mover = Mover(checker, a)
    mover.move(q)
    vertices, triangles = facets_of(body)
    corners = (vertices @ at[:9].reshape(3, 3).T + at[9:12])[triangles]
    own = at[:9].reshape(3, 3).T
    directions = np.array([[0.0, 0.0, 1.0], *own, *-own])
    near = corners[_near(mover, corners, directions, reach)]
    normals = _commonest(_normals(near)) if len(near) else np.empty((0, 3))
    tried = _distinct(np.concatenate([directions, normals, -normals]))
    _, gaps = _gaps(mover, near, tried)
    return np.asarray(-tried[gaps.argmax(axis=0)])


def _near(mover: Mover, corners: Array, directions: Array, reach: float) -> npt.NDArray[np.bool_]:
    """(F,) the triangles that no direction tried shows farther than ``reach`` from the body."""
    own = mover.at[:9].reshape(3, 3).T
    _, gaps = _gaps(mover, corners, np.concatenate([directions, own, -own]))
    near = gaps.max(axis=0) <= reach
    left = np.flatnonzero(near)
    normals = _normals(corners[left])
    levels = np.einsum("fj,fj->f", normals, corners[left, 0])
    above = -mover.reach(-normals) - levels
    below = -mover.reach(normals) + levels
    near[left] = np.maximum(above, below) <= reach
    return np.asarray(near)


def _gaps(mover: Mover, corners: Array, directions: Array) -> tuple[Array, Array]:
    """(d, F) how far triangles reach along directions, and the gaps from there to the body."""
    tops = np.max([directions @ corners[:, corner].T for corner in range(3)], axis=0)
    return tops, -mover.reach(-directions)[:, None] - tops


def _normals(corners: Array) -> Array:
    """(F, 3) the unit normals of triangles; z for one without an area."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1)
    flat = length == 0.0
    return np.where(flat[:, None], np.array([0.0, 0.0, 1.0]), across / np.where(flat, 1.0, length)[:, None])


def _commonest(normals: Array) -> Array:
    """The :data:`NORMALS` directions that occur most often, of more."""
    different, counts = np.unique(np.round(normals / SAME_DIRECTION), axis=0, return_counts=True)
    if len(different) <= NORMALS:
        return normals
    kept = different[np.argsort(-counts, kind="stable")[:NORMALS]]
    return np.asarray(kept / np.linalg.norm(kept, axis=1)[:, None])


def _distinct(directions: Array) -> Array:
    """The directions without repetitions, each where it first occurs."""
    keys = np.round(directions / SAME_DIRECTION)
    return directions[np.sort(np.unique(keys, axis=0, return_index=True)[1])]


def _measured(mover: Mover, body: Body, facets: Array) -> Array:
    """(m, 3) the directions from facets to a convex body that is near to or penetrates them, as coal knows them."""
    measure, still = MeasureConvex(), np.concatenate([np.eye(3).ravel(), np.zeros(3)])
    found = []
    for facet in facets:
        found.append(-measure.of(body.geometry, mover.at, bvh(facet, ONE_TRIANGLE), still).normal)
    return unit_vectors(np.array(found).reshape(-1, 3))


def unit_vectors(directions: Array) -> Array:
    """The rows (d, 3) that are unit vectors: where bodies overlap, coal's normals may be zero, denormal or not finite.

    Along a vector without a length, every gap is 0 and nothing ever approaches: a proof of nothing.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        lengths = np.sqrt((directions * directions).sum(axis=1))
    kept = np.abs(lengths - 1.0) < UNIT
    return np.asarray(directions[kept] / lengths[kept, None])
