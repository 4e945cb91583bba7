r"""Proofs that a body moving away from an obstacle never approaches it along one direction.

Let n be a unit vector that is fixed with the obstacle, and

.. math:: g(t) = \min_{y \in \text{body}} n \cdot y(t) - \max_{x \in \text{obstacle}} n \cdot x .

If g is positive, the two are at least g apart; if it is negative, they overlap by -g along n. If no point of the body
moves against n, g never decreases. The speed of a point y along n is :math:`\sum_i s_i f_i`, with the rates s_i of the
joints that carry it and :math:`f_i = n \cdot (w_i \times (y - p_i))`, or :math:`n \cdot w_i` for a prismatic joint.

On an interval every joint j stays within delta_j of its value in the middle. Move there joint by joint, starting with
the one closest to the root. Joints up to i rotate :math:`w_i \times (y - p_i)` as a whole, and joints beyond i move y
by their chords, at radii that are those of the middle (``src/core/certificate/motion_bounds.h``). So f_i stays within

.. math:: \varepsilon_i = \rho_i \sum_{j \le i} 2 \sin(\delta_j / 2) + \sum_{j > i} 2 \rho_j \sin(\delta_j / 2)

of its value in the middle (prismatic joints do not rotate, and translate by delta_j). On a polynomial piece the rates
are :math:`s_i(u) = \sum_r B_r(u) s_{ri}`, with coefficients that are differences of control points, and nonnegative
B_r. So g does not decrease if for every r

.. math:: L_r = \min_y \sum_i s_{ri} f_i(y) - \sum_i |s_{ri}| \varepsilon_i \ge 0 ,

with f_i at the middle, where the sum is linear in y and its minimum is a value of the support function. If some L_r are
negative, g decreases by at most the sum of their magnitudes. Coefficients are compared instead of values because at
rest both sides are 0.

For an exact mesh, the facets close to the body at the start are grouped by the directions along which the body leaves
them.

Source: R. T. Farouki (2012), "The Bernstein polynomial basis: a centennial retrospective", Computer Aided Geometric
Design 29, section 3 (differences, hull); the rest is derived here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import coal
import numpy as np
import numpy.typing as npt

from pinproof._core import Workspace
from pinproof.collision.bodies import Body
from pinproof.collision.checker import CollisionChecker
from pinproof.collision.coal_checks import MeasureConvex
from pinproof.collision.hulls import Solid, bvh
from pinproof.motion import bezier
from pinproof.spatial import matrix

if TYPE_CHECKING:
    from pinproof.collision.checker import CollisionChecker

__all__ = [
    "BodySupport",
    "DepartureDirection",
    "DepartureProof",
    "FacetGroup",
    "MovingBody",
    "directions_to_facets",
    "distinct",
    "facet_body",
    "facets_of",
    "leave_facets",
    "unit_vectors",
]

Array = npt.NDArray[np.float64]


HALVINGS = 12
"""Number of bisections of the interval in which a body separates: its end is found to 1/4000 of the interval."""


class DepartureProof(NamedTuple):
    """The span of a curve on which a body is proven not to approach."""

    end: float
    """The parameter up to which it is proven."""
    until: float
    """The parameter after which its distance is also larger than required; infinity if this is not reached."""
    stopped: float
    """The end of the first interval in which the proof failed; ``end`` if it did not fail."""
    intervals: int
    """Number of intervals."""


class MovingBody:
    """A moving body of the robot: its placement at a configuration, and its support function.

    Parameters
    ----------
    checker
        The checker.
    body
        The index of a body that moves with a link.
    """

    def __init__(self, checker: CollisionChecker, body: int) -> None:
        self._space, self._index = Workspace(checker.world), body
        self.rounding = checker.rounding
        self.shape = BodySupport.of(checker.bodies[body])
        self._chain = self._space.joints_of_body(body)
        joints = [self._space.joint(k) for k in self._chain]
        self.leader = np.array([joint.index for joint in joints], dtype=np.int64)
        self.multiplier = np.array([joint.multiplier for joint in joints])
        self.prismatic = np.array([joint.prismatic for joint in joints], dtype=bool)
        core_shape = checker.bodies[body].core_shape
        self.ball, self._centre = core_shape.ball, core_shape.centre
        self.move(np.zeros(checker.group.dof))

    def move(self, q: Array) -> None:
        """Place it at q (n,)."""
        self._space.place(np.ascontiguousarray(q))
        self.at = self._space.root_from_body(self._index)
        self.axes = self._space.root_from_joints[self._chain]
        self.middle = self.at[:3, :3] @ self._centre + self.at[:3, 3]

    def reach(self, directions: Array) -> Array:
        """Return (d,) the largest ``direction . y`` over its points y, for directions (d, 3) in the root frame."""
        return self.shape.reach(self.at, directions)


class DepartureDirection:
    """The motion of a body of the robot along one direction, away from something that does not move.

    Parameters
    ----------
    moving
        The body.
    normal
        (3,) the direction, of length 1, in the root frame.
    level
        Extent (m) of the obstacle along the direction.
    """

    def __init__(self, moving: MovingBody, normal: Array, level: float) -> None:
        self._mover, self.normal, self.level = moving, normal, level

    def gap(self, q: Array) -> float:
        """Return the gap (m) along :attr:`normal` at q (n,): a lower bound of the distance, negative in overlap."""
        self._mover.move(q)
        return -float(self._mover.reach(-self.normal[None])[0]) - self.level

    def follow(self, knots: Array, control: Array, enough: float, tolerance: float, most: int) -> DepartureProof:
        """Follow a curve as long as the body is proven not to approach.

        Parameters
        ----------
        knots, control
            The curve, see :mod:`pinproof.motion.bezier`.
        enough
            The gap (m) beyond which the body has separated.
        tolerance
            Metres: an interval in which it moves by less is not bisected further.
        most
            Maximum number of intervals.
        """
        end, until, lost, count = float(knots[0]), np.inf, 0.0, 0
        if self.gap(control[0, 0]) > enough:
            until = end
        for i, piece in enumerate(control):
            stack = [(float(knots[i]), float(knots[i + 1]), piece)]
            while stack:
                start, stop, part = stack.pop()
                count += 1
                falls, motion = self._falls(part)
                if lost + falls <= self._mover.rounding:
                    lost, end = lost + falls, stop
                    if until == np.inf and self.gap(part[-1]) > enough:
                        until = self._crossing(start, stop, part, enough)
                    continue
                if motion < tolerance or count >= most:
                    return DepartureProof(end, until, stop, count)
                middle, (left, right) = 0.5 * (start + stop), bezier.split(part)
                stack += [(middle, stop, right), (start, middle, left)]
        return DepartureProof(end, until, end, count)

    def _crossing(self, start: float, stop: float, part: Array, enough: float) -> float:
        """Return an upper bound of the parameter at which a gap that does not decrease exceeds ``enough``."""
        for _ in range(HALVINGS):
            middle, (left, right) = 0.5 * (start + stop), bezier.split(part)
            if self.gap(left[-1]) > enough:
                stop, part = middle, left
            else:
                start, part = middle, right
        return stop

    def _falls(self, part: Array) -> tuple[float, float]:
        """Return upper bounds of the decrease (m) of the gap over a piece (degree + 1, n), and of the motion (m)."""
        moving, middle = self._mover, bezier.split(part)[0][-1]
        moving.move(middle)
        leader, share, slides = moving.leader, moving.multiplier, moving.prismatic
        rates = share * np.diff(part, axis=0)[:, leader]  # (degree, k)
        delta = np.abs(share * np.abs(part - middle).max(axis=0)[leader])
        directions, points = moving.axes[:, :3, 2], moving.axes[:, :3, 3]
        arms = _cross(directions, moving.middle - points)
        rho = np.where(slides, 1.0, np.sqrt((arms * arms).sum(axis=1)) + moving.ball)
        turns = np.where(slides, 0.0, 2.0 * np.sin(0.5 * np.minimum(delta, np.pi)))
        shifts = np.where(slides, delta, rho * turns)
        inner, outer = np.cumsum(turns), shifts.sum() - np.cumsum(shifts)
        spread = rho * inner + np.where(slides, 0.0, outer)
        turned = np.where(slides[:, None], 0.0, _cross(self.normal[None], directions))  # f_i = turned_i . (y - p_i)
        along = np.where(slides, directions @ self.normal, -(turned * points).sum(axis=1))
        slowest = rates @ along - moving.reach(-(rates @ turned))
        falls = np.maximum(np.abs(rates) @ spread - slowest, 0.0).sum()
        return float(falls), float(shifts.sum())


class BodySupport(NamedTuple):
    """The support function of the convex hull of a body; of a half-space only along its own normal."""

    points: Array | None
    """(V, 3) the corners of an exact mesh; None for a body with a support function."""
    body: Body

    @classmethod
    def of(cls, body: Body) -> BodySupport:
        """Return the support of a body of any kind."""
        exact = body.support is None and not isinstance(body.geometry, coal.Halfspace)
        return cls(np.array(body.geometry.vertices()) if exact else None, body)

    def reach(self, at: Array, directions: Array) -> Array:
        """Return (d,) the largest ``direction . x`` over the body at ``at`` (4, 4), for directions (d, 3)."""
        origin = directions @ at[:3, 3]
        if isinstance(self.body.geometry, coal.Halfspace):
            return np.asarray(origin)
        local = directions @ at[:3, :3]
        if self.points is None and self.body.support is not None:
            return np.asarray(origin + self.body.support.reach(local))
        return np.asarray(origin + (local @ np.asarray(self.points).T).max(axis=1))


def _cross(a: Array, b: Array) -> Array:
    """Return (k, 3) the cross products of rows; ten times as fast as numpy.cross for few rows."""
    x, y, z = b.T
    return np.stack([a[:, 1] * z - a[:, 2] * y, a[:, 2] * x - a[:, 0] * z, a[:, 0] * y - a[:, 1] * x], axis=1)


Indices = npt.NDArray[np.int64]
Follow = Callable[[DepartureDirection], DepartureProof]

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


class FacetGroup(NamedTuple):
    """Facets from which a body separates along one direction."""

    facets: Indices
    """Their indices in the mesh."""
    departure: DepartureDirection
    proof: DepartureProof
    gap: float
    """Gap (m) at the start along the direction; negative if they overlap."""


def facets_of(body: Body) -> tuple[Array, Indices]:
    """Return the vertices (V, 3), in its own frame, and the triangles (F, 3) of an exact mesh."""
    geometry = body.geometry
    triangles = (geometry.tri_indices(i) for i in range(geometry.num_tris))
    return np.array(geometry.vertices()), np.array([(t[0], t[1], t[2]) for t in triangles], dtype=np.int64)


def facet_body(body: Body, name: str, vertices: Array, triangles: Indices) -> Body:
    """Return an obstacle of some triangles of an exact mesh: a surface of the same owner."""
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
    moving: MovingBody,
    body: Body,
    corners: Array,
    directions: Array,
    *,
    reach: float,
    deepest: float,
    follow: Follow,
) -> tuple[list[FacetGroup], float]:
    """Return groups of facets from which a body at its start separates, or which it does not approach at first.

    Facets in no group need the ordinary proof. Directions along which the body separates come first; a group whose
    proof has ``until`` at infinity has no such direction. Also returns the gap (m) at the facet with the deepest
    penetration, along the best direction for that facet.

    Parameters
    ----------
    moving, body
        The body that separates.
    corners
        (F, 3, 3) the triangles in the root frame.
    directions
        (d, 3) directions to try besides the normals of the facets; of equally good ones, the first is taken.
    reach
        Metres. Facets proven farther from the body than this are in no group.
    deepest
        Metres. Facets that the body penetrates by more than this in every direction are in no group.
    follow
        Follows the curve along a direction.
    """
    near = np.flatnonzero(_near(moving, corners, directions, reach))
    if not len(near):
        return [], np.inf
    facets = corners[near]
    normals = _commonest(_normals(facets))
    tried = distinct(np.concatenate([directions, normals, -normals]))
    tops, gaps = _gaps(moving, facets, tried)
    if body.support is not None:
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
    depth = max(-float(best[due].min()), 0.0)  # the penetration never exceeds that at the start
    serves = (gaps >= -depth - moving.rounding) & due
    found: list[FacetGroup] = []
    failed: dict[int, tuple[DepartureDirection, DepartureProof]] = {}
    while due.any() and len(failed) < FAILURES:
        counts = (serves & due).sum(axis=1)
        counts[list(failed)] = 0
        chosen = int(counts.argmax())
        if counts[chosen] == 0:
            break
        group = serves[chosen] & due
        departure = DepartureDirection(moving, tried[chosen], float(tops[chosen, group].max()))
        proof = follow(departure)
        if proof.until == np.inf:
            failed[chosen] = departure, proof
            continue
        found.append(FacetGroup(near[group], departure, proof, float(gaps[chosen, group].min())))
        due &= ~group
    for chosen, (_, proof) in sorted(failed.items(), key=lambda each: -each[1][1].end):
        group = serves[chosen] & due
        if group.any():
            departure = DepartureDirection(moving, tried[chosen], float(tops[chosen, group].max()))
            found.append(FacetGroup(near[group], departure, proof, float(gaps[chosen, group].min())))
            due &= ~group
    return _extended(found, corners), float(best.min())


def _extended(groups: list[FacetGroup], corners: Array) -> list[FacetGroup]:
    """Extend each group by all facets of the mesh with no larger extent along its direction.

    The same proof holds for them, and a verdict does not depend on how finely a plane is cut into facets.
    """
    grouped = np.zeros(len(corners), dtype=bool)
    for group in groups:
        grouped[group.facets] = True
    out = []
    for group in groups:
        tops = (corners @ group.departure.normal).max(axis=1)
        more = np.flatnonzero((tops <= group.departure.level) & ~grouped)
        grouped[more] = True
        out.append(group._replace(facets=np.sort(np.concatenate([group.facets, more]))))
    return out


def directions_to_facets(checker: CollisionChecker, pair: int, q: Array, reach: float) -> Array:
    """(k, 3) unit vectors from a body of the robot at q (n,) to the facets of an exact mesh within ``reach`` (m) of it.

    For each facet, against the direction along which the two are farthest apart, or overlap least. None for a mesh that
    is farther away, and for an obstacle that has no facets.
    """
    a, b = checker.pairs[pair]
    body, at = checker.bodies[b], matrix(checker.bodies[b].link_from_body)
    if body.support is not None or body.link is not None or isinstance(body.geometry, coal.Halfspace):
        return np.empty((0, 3))
    moving = MovingBody(checker, a)
    moving.move(q)
    vertices, triangles = facets_of(body)
    corners = (vertices @ at[:3, :3].T + at[:3, 3])[triangles]
    own = at[:3, :3].T
    directions = np.array([[0.0, 0.0, 1.0], *own, *-own])
    near = corners[_near(moving, corners, directions, reach)]
    normals = _commonest(_normals(near)) if len(near) else np.empty((0, 3))
    tried = distinct(np.concatenate([directions, normals, -normals]))
    _, gaps = _gaps(moving, near, tried)
    return np.asarray(-tried[gaps.argmax(axis=0)])


def _near(moving: MovingBody, corners: Array, directions: Array, reach: float) -> npt.NDArray[np.bool_]:
    """(F,) the triangles that no direction tried shows farther than ``reach`` from the body."""
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
    tops = np.max([directions @ corners[:, corner].T for corner in range(3)], axis=0)
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
    keys = np.round(directions / SAME_DIRECTION)
    return directions[np.sort(np.unique(keys, axis=0, return_index=True)[1])]


def _measured(moving: MovingBody, body: Body, facets: Array) -> Array:
    """Return (m, 3) the directions from facets to a close or penetrating convex body, computed by coal."""
    measure, still = MeasureConvex(), np.eye(4)
    found = []
    for facet in facets:
        found.append(-measure.of(body.geometry, moving.at, bvh(facet, ONE_TRIANGLE), still).normal)
    return unit_vectors(np.array(found).reshape(-1, 3))


def unit_vectors(directions: Array) -> Array:
    """The rows (d, 3) that are unit vectors: where bodies overlap, coal's normals may be zero, denormal or not finite.

    Along a vector without a length, every gap is 0 and nothing ever approaches: a proof of nothing.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        lengths = np.sqrt((directions * directions).sum(axis=1))
    kept = np.abs(lengths - 1.0) < UNIT
    return np.asarray(directions[kept] / lengths[kept, None])
