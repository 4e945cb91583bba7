"""How deep one body is inside another: the length of the shortest displacement that separates the two.

This depth is never smaller than that of a point of one body below the surface of the other. It also counts what passes
through a thin wall, of which no point is deep inside the material. For convex bodies it is the distance of the origin
from the boundary of their Minkowski difference, here bracketed as in the expanding polytope algorithm (G. van den
Bergen, 2001, "Proximity queries and penetration depth computation on 3D game objects"). For other bodies it is an upper
bound: the shortest of several displacements, each of which is verified to separate the bodies.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import coal
import numpy as np

from pinproof.collision.checking.line_surface import TOUCH, LineSurface, travel_to_touch
from pinproof.collision.checking.placed_bodies import GJK_SLACK, Distance, MeasureByCoal
from pinproof.collision.geometry.bodies import Body, Support
from pinproof.collision.geometry.hulls import winding_number
from pinproof.common.least_squares import non_negative_shares
from pinproof.spatial import SE3, Array, translated

BRACKET = 1e-6
"""Metres: the bracket of the depth of convex bodies is narrowed to this, at most by :data:`EXPANSIONS` steps."""

EXPANSIONS, EXPANDED = 40, 16
"""Largest number of expansions of the polytope, and number of facets that are expanded in each."""

CONTACTS = 512
"""Largest number of contacts of triangles from which directions are derived."""

PLANES = 8
"""Number of planes of triangles along whose normals a separation is tried, the shallowest first."""

ENOUGH = 0.5
"""Share of the allowed displacement: no better one is searched if bodies are that far apart after it."""

EXITS = 8
"""Number of directions along which a body that is too deep inside a mesh is moved out to measure its depth."""

UNIT = 1e-6
"""By how much the length of a normal may differ from 1."""

BEYOND = 1e-3
"""Metres between bodies before one is moved towards the other until they touch."""

AXES = np.concatenate([np.eye(3), -np.eye(3)])

AROUND = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
"""(26, 3) the first directions of a polytope."""


class Penetration(NamedTuple):
    """How deep a body is inside another, and a displacement after which it is outside."""

    depth: float  # an upper bound (m), 0 if the bodies do not overlap; for convex bodies within BRACKET
    least: float  # a lower bound (m)
    by: Array  # (3,) the displacement, of the length that was allowed or zero
    clearance: float  # metres between the bodies after it; 0 or less if none of this length separates them


def penetration(
    one: LineSurface, at: SE3, other: LineSurface, other_at: SE3, directions: Array, most: float, *, only: bool = False
) -> Penetration:
    """Return how deep a body is inside another, and how it gets outside by a displacement of the length ``most`` (m).

    ``directions`` (K, 3) are tried first. If ``only``, no other directions are, and the depth is that along them. The
    poses are ``world_from_body``. A mesh counts as a solid of its own shape, also if its hull is checked elsewhere.
    """
    # How far the bodies are apart, or which way they touch.
    measure = _Measure(one, other, other_at)
    here = measure(at)
    outside = here.attained > 0.0
    tried = [*directions]
    if not only:
        tried += _away(here)
    depth = least = 0.0
    a, b = one.body.support, other.body.support
    convex = a is not None and b is not None and one.triangles is None and other.triangles is None and not only
    # The depth of convex bodies is bracketed; a mesh has directions in which it may leave the other.
    if outside:
        if here.attained >= most:
            return Penetration(0.0, 0.0, np.zeros(3), here.attained)
    elif convex and a is not None and b is not None:
        several = np.concatenate([np.reshape(tried, (-1, 3)), AXES @ at.rotation.T, AXES @ other_at.rotation.T])
        needed = _difference(a, at, b, other_at, several)[0]
        depth = float(needed.min())
        tried.append(several[needed.argmin()])
        if depth > most:
            least, depth, normal = _bracket(a, at, b, other_at, several)
            if depth > most:
                return Penetration(depth, max(least, 0.0), most * normal, most - depth)
            tried.append(normal)
    elif not only:
        tried += _ways_out(one, at, other, other_at, most)
    # The displacement with the largest clearance, of those that were tried.
    best, by = here.attained if outside else -np.inf, np.zeros(3)
    for direction in tried:
        clear = measure(translated(at, most * direction)).attained
        if clear > best:
            best, by = clear, most * direction
        if best >= ENOUGH * most and not convex:  # distances of meshes are expensive
            break
    # The depth of a mesh is the length of the way back until it touches.
    if not convex and not outside:
        if best <= GJK_SLACK:
            depth, direction = _shortest_exit(measure, one, at, other, other_at, tried[:EXITS], only)
            clear = measure(translated(at, most * direction)).attained
            if clear > best:
                best, by = clear, most * direction
            least = depth if only else 0.0
        if best > GJK_SLACK:
            depth = most * (1.0 - _share(one, translated(at, by), other, other_at, -by))
    return Penetration(max(depth, 0.0), max(least, 0.0), by, best)


class _Measure:
    """Measures the signed distance of two surfaces; a part of one inside the other is in contact."""

    def __init__(self, one: LineSurface, other: LineSurface, other_at: SE3) -> None:
        self._one, self._other, self._at = one.surface or one.body, other.surface or other.body, other_at
        self._coal, self._placed = MeasureByCoal(), other_at.homogeneous

    def __call__(self, at: SE3) -> Distance:
        found = self._coal(self._one, at.homogeneous, self._other, self._placed)
        if found.attained <= 0.0:
            return found
        own = self._at.actInv(at)
        if _holds(self._other, self._one, own) or _holds(self._one, self._other, own.inverse()):
            return found._replace(attained=-found.attained, distance=-found.attained)
        return found


def _holds(outer: Body, inner: Body, outer_from_inner: SE3) -> bool:
    """Whether a part of a body is inside a mesh that it does not touch."""
    if outer.solid is None:
        return False
    if outer.solid.watertight:
        return outer.contains_part_of(inner, outer_from_inner)
    # A surface that is not watertight has no inside, but mostly encloses a point with a winding number above a half
    # (Jacobson and others, 2013, "Robust inside-outside segmentation using generalized winding numbers").
    points = inner.witnesses @ outer_from_inner.rotation.T + outer_from_inner.translation
    within = points[((points >= outer.box[0]) & (points <= outer.box[1])).all(axis=1)]
    corners = getattr(outer.solid, "corners", np.empty((0, 3, 3)))
    return any(abs(winding_number(point, corners)) > 0.5 for point in within)


def crossing_depth(one: Body, at: Array, other: Body, other_at: Array) -> float:
    """Return a length (m) by which every point of an exact mesh may move with the meshes still in contact; 0: unknown.

    An edge pq of one mesh crosses a triangle of the other at x; its ends have the heights h_p and h_q of opposite signs
    above the plane of the triangle, and s = abs(h_p - h_q) / abs(p - q) is its slope. If its points move by less than
    d < min(abs(h_p), abs(h_q)), it still crosses the plane: a point y of it at the height h, which is h sqrt(1 / s^2 -
    1) beside x, has moved into the plane, by at most sqrt(d^2 - h^2) sideways. In sum this is at most d / s, and the
    crossing remains inside the triangle if x is that far from its sides.
    """
    request, found = coal.CollisionRequest(), coal.CollisionResult()
    request.num_max_contacts = CONTACTS
    placed = [coal.Transform3s(pose[:3, :3], pose[:3, 3]) for pose in (at, other_at)]
    coal.collide(one.geometry, placed[0], other.geometry, placed[1], request, found)
    pairs = [(contact.b1, contact.b2) for contact in found.getContacts()]
    if not pairs:
        return 0.0
    meshes = zip((one, other), (at, other_at), zip(*pairs, strict=True), strict=True)
    first, second = (_corners(body, numbers) @ pose[:3, :3].T + pose[:3, 3] for body, pose, numbers in meshes)
    largest = 0.0
    for edges, triangle in ((first, second), (second, first)):
        p, q = edges, np.roll(edges, -1, axis=1)
        side = np.roll(triangle, -1, axis=1) - triangle
        normal = np.cross(side[:, 0], side[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            h_p, h_q = (np.einsum("kex,kx->ke", ends - triangle[:, :1], normal) for ends in (p, q))
            x = p + (h_p / (h_p - h_q))[..., None] * (q - p)
            inward = np.cross(normal[:, None], side / np.linalg.norm(side, axis=2, keepdims=True))
            inside = np.einsum("kesx,ksx->kes", x[:, :, None] - triangle[:, None], inward).min(axis=2)
            around = inside * np.abs(h_p - h_q) / np.linalg.norm(q - p, axis=2)
            depth = np.minimum(np.minimum(np.abs(h_p), np.abs(h_q)), around)
        largest = max(largest, float(depth[(h_p * h_q < 0.0) & (depth > 0.0)].max(initial=0.0)))
    return largest


def _corners(body: Body, numbers: Iterable[int]) -> Array:
    """Return (K, 3, 3) the triangles of an exact mesh with these numbers."""
    rows = [body.geometry.tri_indices(i) for i in numbers]
    return np.asarray(body.geometry.vertices()[[[row[0], row[1], row[2]] for row in rows]])


def _share(one: LineSurface, at: SE3, other: LineSurface, other_at: SE3, motion: Array) -> float:
    """The share of a motion from a separated pose that is proven to be free of contact."""
    share = travel_to_touch(one, at, other, other_at, motion)
    return 0.0 if np.isnan(share) else share


def _shortest_exit(
    measure: _Measure, one: LineSurface, at: SE3, other: LineSurface, other_at: SE3, directions: list[Array], only: bool
) -> tuple[float, Array]:
    """The shortest displacement (m) outside of the other body along several directions, and its direction (3,)."""

    # The body comes from beyond all of the other until they touch. Unless ``only``, the normal at this contact is the
    # next direction, as long as the displacement becomes shorter.
    def way(direction: Array) -> tuple[float, Array]:
        far = other.reach(other_at.rotation.T @ direction) + one.reach(-at.rotation.T @ direction) + BEYOND
        far += float(direction @ (other_at.translation - at.translation))
        length = far * (1.0 - _share(one, translated(at, far * direction), other, other_at, -far * direction))
        if length == 0.0:  # without contact, it came through the opening of a surface that is not watertight
            length = far
        return float(length), direction

    length, best = min(map(way, directions), key=lambda found: found[0])
    # Descent along the normals of contacts.
    for _ in range(0 if only else EXITS):
        normals = _away(measure(translated(at, (length + 2 * TOUCH) * best)))
        shorter, direction = min(map(way, normals), key=lambda found: found[0], default=(length, best))
        if shorter > length - BRACKET:
            break
        length, best = shorter, direction
    return length, best


def _away(found: Distance) -> list[Array]:
    """The unit vector from the second body to the first; none for overlapping meshes, for which coal has no normal."""
    across = found.points[0] - found.points[1] if found.attained > TOUCH else -found.normal
    length = float(np.linalg.norm(across))
    return [across / length] if found.attained > TOUCH or abs(length - 1.0) < UNIT else []


def _ways_out(one: LineSurface, at: SE3, other: LineSurface, other_at: SE3, most: float) -> list[Array]:
    """Directions in which a body with a mesh may leave the other: normals of the touching triangles, and both's axes.

    A body is outside of a triangle if it is beyond its plane. The first direction is that of the shortest displacement
    beyond all planes that are at most ``most`` away, for contacts in corners (C. L. Lawson, R. J. Hanson, 1974,
    "Solving least squares problems", chapter 23).
    """
    # The triangles of each mesh that touch the other body.
    request, found = coal.CollisionRequest(), coal.CollisionResult()
    request.num_max_contacts = CONTACTS
    bodies, poses = (one.surface or one.body, other.surface or other.body), (at, other_at)
    placed = [coal.Transform3s(pose.rotation, pose.translation) for pose in poses]
    coal.collide(bodies[0].geometry, placed[0], bodies[1].geometry, placed[1], request, found)
    planes = []
    for number, (surface, pose) in enumerate(((one, at), (other, other_at))):
        contacts = found.getContacts() if surface.triangles is not None else ()
        touched = sorted({contact.b2 if number else contact.b1 for contact in contacts})
        if surface.triangles is None or not touched:
            continue
        corners = surface.triangles[touched] @ pose.rotation.T + pose.translation
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        # The first body is outside of a triangle when it is moved beyond its plane.
        normals, corners = normals[lengths > 0] / lengths[lengths > 0, None], corners[lengths > 0, 0]
        opposite, placement = ((other, other_at), (one, at))[number]
        for sign in (1.0, -1.0):
            away = sign * normals if number else -sign * normals  # the direction in which the first body moves
            back = -away if number else away
            reach = opposite.reaches(back @ placement.rotation) + back @ placement.translation
            planes.append(np.column_stack([away, np.einsum("ij,ij->i", -back, corners) + reach]))
    axes = [*(AXES @ at.rotation.T), *(AXES @ other_at.rotation.T)]
    shallow = np.unique(np.round(np.concatenate([np.empty((0, 4)), *planes]), 9), axis=0)
    shallow = shallow[shallow[:, 3] <= most]
    if not len(shallow):
        return axes
    # The shortest displacement beyond all planes is a problem of least squares with weights of 0 or more.
    system = shallow.T  # the last row holds the distances
    residual = system @ non_negative_shares(system, np.array([0.0, 0.0, 0.0, 1.0])) - [0.0, 0.0, 0.0, 1.0]
    length = float(np.linalg.norm(residual[:3]))
    corner = [-residual[:3] / np.copysign(length, residual[3])] if length > 0.0 and residual[3] else []
    return [*corner, *shallow[np.argsort(shallow[:, 3])[:PLANES], :3], *axes]


# -- convex bodies ----------------------------------------------------------------------------------------------------


def _difference(one: Support, at: SE3, other: Support, other_at: SE3, directions: Array) -> tuple[Array, Array]:
    """Reach (K,) and farthest points (K, 3) of the displacements with which the first body overlaps the other."""

    def scaled(vectors: Array) -> Array:
        lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
        return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)

    points = []
    for s, pose, sign in ((other, other_at, 1.0), (one, at, -1.0)):
        # The farthest points of a convex body in directions of its own frame.
        own = sign * directions @ pose.rotation
        flat = own * [1.0, 1.0, 0.0]
        first = (own @ s.points.T + np.linalg.norm(flat, axis=1)[:, None] * s.disc_radii).argmax(axis=1)
        far = s.points[first] + s.disc_radii[first, None] * scaled(flat)
        far = far + s.radius * scaled(own) + s.semi_axes * scaled(s.semi_axes * own)
        points.append(far @ pose.rotation.T + pose.translation)
    extreme = points[0] - points[1]
    return np.einsum("ij,ij->i", extreme, directions), extreme


def _bracket(one: Support, at: SE3, other: Support, other_at: SE3, directions: Array) -> tuple[float, float, Array]:
    """Bounds (m) of the depth of convex bodies from below and above, and the direction (3,) of the upper one.

    The hull of points of the Minkowski difference is inside it, and its supporting planes are outside.
    """
    from scipy.spatial import ConvexHull

    start = np.concatenate([directions, AROUND / np.linalg.norm(AROUND, axis=1, keepdims=True)])
    reach, points = _difference(one, at, other, other_at, start)
    upper, normal = float(reach.min()), start[reach.argmin()]
    lower = -np.inf
    # The hull is expanded at its nearest facets until the bracket is narrow.
    for _ in range(EXPANSIONS):
        facets = np.unique(np.round(ConvexHull(points).equations, 12), axis=0)
        facets = facets[np.argsort(-facets[:, 3], kind="stable")[:EXPANDED]]
        lower = max(lower, -float(facets[0, 3]))
        if upper - lower <= BRACKET:
            break
        reach, more = _difference(one, at, other, other_at, facets[:, :3])
        points = np.concatenate([points, more])
        if reach.min() < upper:
            upper, normal = float(reach.min()), facets[reach.argmin(), :3]
    return lower, upper, normal
