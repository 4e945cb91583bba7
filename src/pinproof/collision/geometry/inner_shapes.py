"""Balls and boxes inside bodies: if two of them share a point, so do the bodies.

They prove that bodies are in contact over a set of configurations, as bounding volumes prove that bodies are apart. The
radii are lower bounds: the distance from the planes of a convex body, or from the triangles of a watertight mesh.
"""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np

from pinproof.collision.geometry.bodies import MOST_EXCESS, Body, Support
from pinproof.collision.geometry.hulls import Solid, spiral_directions, winding_number, with_area
from pinproof.collision.geometry.surfaces import Cells
from pinproof.spatial import Array

MOST_BALLS = 24
"""Largest number of balls in a body."""

MOST_CORNERS = 96
"""Largest number of corners of a body."""

GRID = 9
"""Number of candidates for centres along each side of the box around a body."""

SHARE = 0.25
"""Balls with a smaller share of the radius of the largest one are omitted."""

APART = 0.6
"""Distance between centres of balls, at least, as a share of the radius of the larger one."""

DIRECTIONS = 200
"""Number of directions whose extreme points are the corners of a polytope inside a round body."""

ROUNDING = 1e-9
"""Metres by which radii are reduced."""

HUGE = 1e3
"""Metres: half sides of the box that represents a half-space."""

KEPT = 256
"""Number of bodies whose shapes are kept."""

CONVEX = 5
"""A mesh is treated as convex if more than this fraction (1 / 5) of the box around it is behind all of its
triangles."""


class InnerShapes(NamedTuple):
    """Shapes inside a body, in its frame: balls (centre, radius), points of its surface, and a rounded box."""

    balls: Array
    corners: Array
    box_centre: Array
    box_half: Array | None
    box_radius: float


_KEPT: dict[bytes, InnerShapes] = {}


def inner_shapes(body: Body) -> InnerShapes:
    """Return shapes inside a body; none if its volume is only known approximately, as for the hull of a link's mesh."""
    none = InnerShapes(np.empty((0, 4)), np.empty((0, 3)), np.zeros(3), None, 0.0)
    if body.is_half_space:
        return none._replace(box_centre=np.array([0.0, 0.0, -HUGE]), box_half=np.full(3, HUGE))
    if body.support is not None and body.link is not None and body.file is not None:
        return none
    key = body.content()
    if key in _KEPT:
        return _KEPT[key]
    shapes = none
    if body.support is not None:
        # The pieces of a mesh may extend beyond it.
        less = ROUNDING + (MOST_EXCESS if body.file is not None else 0.0)
        shapes = none._replace(balls=_spread(*_in_polytope(body.support, body.box), less))
        if body.file is None:
            shapes = shapes._replace(corners=_far_apart(extremes(body.support)))
        if isinstance(body.geometry, coal.Box):
            shapes = shapes._replace(box_half=body.box[1] - less)
    elif isinstance(body.solid, Cells):
        # Of many boxes, those with the largest balls, and the largest one.
        low, high = np.moveaxis(body.solid.boxes, 1, 0)
        centres, halves = (low + high) / 2, (high - low) / 2
        box = int(halves.prod(axis=1).argmax())
        shapes = InnerShapes(
            _spread(centres, halves.min(axis=1), ROUNDING), centres[[box]], centres[box], halves[box] - ROUNDING, 0.0
        )
    elif isinstance(body.solid, Solid) and body.solid.watertight:
        corners = body.solid.corners
        # A point behind the planes of all triangles is inside, since every triangle adds to its winding number; its
        # smallest distance from the planes is the radius. For others, the triangles give the distances.
        faces, normals, _ = with_area(corners)
        centres = _candidates(body.box)
        radii = (np.einsum("ij,ij->i", normals, faces[:, 0]) - centres @ normals.T).min(axis=1)
        if (radii > 0).sum() > len(centres) // CONVEX:
            centres, radii = centres[radii > 0], radii[radii > 0]
        else:
            centres = centres[[winding_number(centre, corners) > 0.5 for centre in centres]]
            radii = np.array([_distance(centre, corners) for centre in centres])
        balls = _spread(centres, radii, ROUNDING)
        shapes = none._replace(balls=balls, corners=_far_apart(np.unique(corners.reshape(-1, 3), axis=0)))
    if len(_KEPT) >= KEPT:
        _KEPT.clear()
    _KEPT[key] = shapes
    return shapes


def extremes(support: Support, *, with_ball: bool = False) -> Array:
    """Return (m, 3) extreme points of a convex body, with or without its ball: all, or in some directions if curved."""
    if not (support.disc_radii.any() or support.semi_axes.any() or (with_ball and support.radius)):
        return support.points
    directions = spiral_directions(DIRECTIONS)
    flat = np.hypot(directions[:, 0], directions[:, 1])[:, None]
    reach = directions @ support.points.T + flat * support.disc_radii
    best = reach.argmax(axis=1)
    points = support.points[best].copy()
    points[:, :2] += support.disc_radii[best, None] * directions[:, :2] / flat
    stretched = support.semi_axes**2 * directions
    length = np.sqrt((stretched * directions).sum(axis=1, keepdims=True))
    points += np.divide(stretched, length, out=np.zeros_like(stretched), where=length > 0)
    return np.asarray(points + support.radius * directions if with_ball else points)


def _candidates(box: Array) -> Array:
    """Return (m, 3) points of a grid in a box (2, 3)."""
    shares = (np.arange(GRID) + 0.5) / GRID
    grid = np.stack(np.meshgrid(shares, shares, shares, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(np.concatenate([[box.mean(axis=0)], box[0] + grid * (box[1] - box[0])]))


def _in_polytope(support: Support, box: Array) -> tuple[Array, Array]:
    """Return centres (m, 3) and radii (m,) of balls in a convex body: a polytope to which a ball is added."""
    from scipy.spatial import ConvexHull, QhullError

    points, flat = extremes(support), False
    if len(points) > 2:
        try:
            hull = ConvexHull(points)
        except QhullError:
            points, flat = points[:1], True
    if len(points) <= 2 or flat:  # a point or a segment
        share = np.linspace(0.0, 1.0, 2 * GRID)[:, None]
        centres = points[:1] + share * (points[-1:] - points[:1])
        return centres, np.full(len(centres), support.radius)
    centres = _candidates(box)
    depth = (-hull.equations[:, 3] - centres @ hull.equations[:, :3].T).min(axis=1)
    return centres[depth > 0], depth[depth > 0] + support.radius


def _distance(point: Array, corners: Array) -> float:
    """Return the distance of a point (3,) from triangles (F, 3, 3)."""
    edges = np.roll(corners, -1, axis=1) - corners
    away = point - corners
    squares = np.maximum(np.einsum("ijk,ijk->ij", edges, edges), np.finfo(float).tiny)
    along = np.clip(np.einsum("ijk,ijk->ij", away, edges) / squares, 0.0, 1.0)
    to_edges = np.linalg.norm(away - along[..., None] * edges, axis=2).min()
    normals = np.cross(edges[:, 0], edges[:, 1])
    sides = np.einsum("ijk,ijk->ij", np.cross(normals[:, None], edges), away)
    above = (sides >= 0).all(axis=1) & (np.linalg.norm(normals, axis=1) > 0)
    heights = np.abs(np.einsum("ij,ij->i", normals, away[:, 0])[above]) / np.linalg.norm(normals[above], axis=1)
    return float(min(to_edges, heights.min(initial=np.inf)))


def _far_apart(points: Array) -> Array:
    """Return (m, 3) a subset of points (k, 3), each as far as possible from the previous ones."""
    if len(points) <= MOST_CORNERS:
        return points
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    away = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < MOST_CORNERS:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]


def _spread(centres: Array, radii: Array, less: float) -> Array:
    """Return (k, 4) the largest of the balls, with their centres apart."""
    radii = radii - less
    chosen: list[Array] = []
    for i in np.argsort(-radii, kind="stable"):
        if radii[i] <= 0 or len(chosen) == MOST_BALLS or (chosen and radii[i] < SHARE * chosen[0][3]):
            break
        if all(np.linalg.norm(centres[i] - other[:3]) > APART * other[3] for other in chosen):
            chosen.append(np.array([*centres[i], radii[i]]))
    return np.array(chosen).reshape(-1, 4)
