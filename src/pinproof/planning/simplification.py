"""Shorten a path, round its corners, and certify the resulting curve.

Waypoints are removed, and the remaining ones move towards the straight line between their neighbours, before and after
random shortcuts. A new edge is accepted only if it is proven free.

With constraints of the tcp, every waypoint is projected onto them, and every edge is proven to satisfy them
(``src/core/planning/manifold.h``); a smooth curve through points of the path replaces it.

Sources: R. Geraerts, M. Overmars, "Creating high-quality paths for motion planning", IJRR 26(8), 2007 (random
shortcuts); S. Sekhavat, P. Svestka, J.-P. Laumond, M. Overmars, "Multilevel path planning for nonholonomic robots using
semiholonomic subsystems", IJRR 17(8), 1998 (removal of waypoints); D. Berenson, S. Srinivasa, J. Kuffner, "Task space
regions: a framework for pose-constrained manipulation planning", IJRR 30(12), 2011, section 4 (CBiRRT2).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from pinproof._core import Manifold
from pinproof._core import shortcut as shorten
from pinproof.collision import (
    Certificate,
    CollisionChecker,
    PathConstraint,
    certify,
    check_constraints,
    is_proven_free,
    require_curve,
)
from pinproof.common.results import Answer, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_integer
from pinproof.errors import InputError, NotProvenFree
from pinproof.model import JointGroup
from pinproof.motion import REVERSAL, BlendedPath, CubicPath, JointPath, TorqueLimits, corner_distance, round_corner
from pinproof.planning.problem import Edges, manifold_of
from pinproof.spatial import Array

# Metres by which bodies move between two samples that are checked before the proof of an edge.
RESOLUTION = 0.1
# Metres that samples keep in addition to the margin: with 0.5 mm, three times as many paths fail the proof.
PAD = 4e-3
# Metres that the points of a smooth curve keep in addition to the margin, because the curve leaves its chords.
SMOOTH_PAD = 5e-3
# Maximum number of times that a rounding that is not free is halved. A smaller one saves less time than its proof
# takes.
MAX_HALVINGS = 5
# Smallest reach (rad or m) of a rounding.
MIN_REACH = 1e-6
# There is no corner between two unit directions that differ by less.
STRAIGHT = 1e-9
# rad or m: maximum length of a step along the constraints, before it is halved until its edge is proven.
STEP = 0.3
# Fraction of the path length that a shortcut must save.
MIN_GAIN = 1e-3
# Number of consecutive random shortcuts without gain after which no more are tried.
PATIENCE = 15
# Share of the tolerance to which points are projected, so that the curve through them has the rest.
INSIDE = 0.5
# The same if two hands hold one object: a spline through points of the closed chain deviates little between them.
CLOSED = 1e-3
# rad or m: distances between the points of the smooth curve, tried in this order.
SPACINGS = (0.3, 0.15, 0.075)
# Limits of the number of points of the smooth curve.
FEWEST, MOST = 6, 300
# Maximum number of passes in which each point is moved towards the middle of its neighbours.
PASSES = 40
# The passes end when no point moves by this fraction of the spacing.
CONVERGED = 0.01


@described(eq=False)
class SimplifyResult(Answer):
    """A shortened and smoothed path."""

    failure = NotProvenFree

    path: JointPath | BlendedPath = key(
        "a :class:`~pinproof.motion.BlendedPath` if the corners were rounded, else a :class:`~pinproof.JointPath`"
    )
    certificate: Certificate = key("the certificate of ``path``. It is FREE unless the given path itself is not free")
    message: str = key("the change in length and stops as text, with any curve that was rejected")

    def _view(self) -> View:
        return View(self.message, [self.path, self.certificate])

    @property
    def ok(self) -> bool:
        """Whether ``path`` is proven free."""
        return self.certificate.free

    @property
    def stops(self) -> int:
        """The number of points between the ends at which the arm must stop."""
        return _stops(self.path)

    def _why_not(self) -> str:
        return self.certificate.message


def simplify(
    path: JointPath,
    checker: CollisionChecker,
    *,
    rng: int | np.random.Generator = 0,
    blend: bool = True,
    deviation: float = 0.1,
    attempts: int = 60,
    constraints: Sequence[PathConstraint] = (),
    torque_limits: TorqueLimits | None = None,
) -> SimplifyResult:
    """Shorten a path (:func:`shortcut`, tightened), round its corners (:func:`blend`), and certify the result.

    Every piece is proven before it is accepted, and the complete curve is certified afterwards. If that certificate is
    not FREE, the result is the shortened path without rounding, or else the given path, and the message states it.

    Parameters
    ----------
    path
        The path of a planner.
    checker
        Defines the bodies and margins.
    rng, attempts
        As for :func:`shortcut`.
    blend, deviation
        Whether corners are rounded, and the maximum distance (rad or m, Euclidean) between a corner and its rounding.
        With constraints, a smooth curve replaces the whole path instead, if one is proven.
    constraints
        Constraints of the tcp that ``path`` satisfies, as given to :meth:`RrtConnect.plan`; the result satisfies
        them.
    torque_limits
        As for :meth:`RrtConnect.plan`.

    Raises
    ------
    InputError
        If the path does not move the joints of the arm, or a setting is out of its range.
    """
    constraints = check_constraints(constraints)
    short = shortcut(
        path, checker, rng=rng, attempts=attempts, tighten=True, constraints=constraints, torque_limits=torque_limits
    )
    rejected = ""
    for curve in _candidates(short, checker, constraints, torque_limits, blend, deviation):
        proof = certify(curve, checker, constraints=constraints)
        if proof.free:
            break
        kind = "rounded" if isinstance(curve, BlendedPath) else "shortened"
        rejected = f"; the {kind} path was rejected: {proof.message}"
    else:
        curve, proof = path, certify(path, checker, constraints=constraints)
    message = (
        f"length reduced from {path.length:.3g} to {curve.length:.3g}, stops from {_stops(path)} to {_stops(curve)}; "
        f"{proof.message}{rejected}"
    )
    return SimplifyResult(curve, proof, message)


def _candidates(
    short: JointPath,
    checker: CollisionChecker,
    constraints: tuple[PathConstraint, ...],
    torque_limits: TorqueLimits | None,
    rounded: bool,
    deviation: float,
) -> Iterator[JointPath | BlendedPath]:
    """The curves that may replace a shortened path, in the order of preference."""
    if rounded and constraints:
        edges = Edges(checker, RESOLUTION, short.q[[0, -1]], pad=SMOOTH_PAD, torque_limits=torque_limits)
        for curve in _smooth_curves(short, edges, constraints, checker.group):
            # A spline may leave the joint limits between its points.
            if checker.group.limits.inside(np.array(curve.range())).all():
                yield curve
    if rounded:
        yield blend(short, checker, deviation=deviation)
    yield short


def _stops(curve: JointPath | BlendedPath) -> int:
    return len(curve.corners) if isinstance(curve, BlendedPath) else max(len(curve) - 2, 0)


def shortcut(
    path: JointPath,
    checker: CollisionChecker,
    *,
    rng: int | np.random.Generator = 0,
    attempts: int = 60,
    tighten: bool = False,
    resolution: float = RESOLUTION,
    constraints: Sequence[PathConstraint] = (),
    torque_limits: TorqueLimits | None = None,
) -> JointPath:
    """Shorten a path; its ends are kept and every new edge is proven free.

    The other edges are not changed, so that a certified path can be certified again. The result is at most as long as
    ``path`` and usually has few waypoints. It does not depend on a clock: the same input gives the same path.

    Parameters
    ----------
    path
        The path to shorten.
    checker
        Defines the bodies and margins for the new edges.
    rng
        Seed or Generator of the random shortcuts.
    attempts
        Maximum number of random shortcuts. With 0, waypoints are removed and nothing else is changed before the path is
        tightened.
    tighten
        Whether the waypoints are moved in more and smaller steps in the end. It takes about as long as the rest; paths
        of MotionBenchMaker are 1 % shorter. Without effect with ``constraints``.
    resolution
        Distance (m) by which bodies move between two samples that are checked before the proof of an edge.
    constraints
        Constraints of the tcp that ``path`` satisfies; new edges satisfy them too.
    torque_limits
        As for :meth:`RrtConnect.plan`.

    Raises
    ------
    InputError
        If the path does not move the joints of the arm, or a setting is out of its range.
    """
    require_curve(path, checker, "path")
    require_integer("attempts", attempts, 0)
    edges = Edges(checker, resolution, path.q[[0, -1]], pad=PAD, torque_limits=torque_limits)
    generator = np.random.default_rng(rng)
    if constraints := check_constraints(constraints):
        manifold = manifold_of(checker.group, constraints)
        return JointPath(_shortened(path.q, edges, manifold, generator, attempts), path.joint_names)
    draws = generator.random((attempts, 2))
    return JointPath(shorten(edges.core, np.ascontiguousarray(path.q), draws, tighten), path.joint_names)


def blend(path: JointPath, checker: CollisionChecker, *, deviation: float = 0.1) -> BlendedPath:
    """Replace the corners of ``path`` by quintic pieces, so that the path is twice differentiable there.

    Each rounding is inside the triangle of its corner, and therefore inside the joint limits if the path is. A rounding
    that is not proven free is halved until it is. If no rounding is free, or if the path reverses its direction, the
    arm stops at the corner; these are the ``corners`` of the result. The rest of the straight segments is not changed.

    Parameters
    ----------
    path
        The path, such as the result of :func:`shortcut`.
    checker
        Defines the bodies and margins for the roundings.
    deviation
        Maximum distance (rad or m, Euclidean in joint space) between a corner and its rounding. Two roundings on the
        same segment share its length.

    Raises
    ------
    InputError
        If the path does not move the joints of the arm, or ``deviation`` is not above 0.
    """
    require_curve(path, checker, "path")
    if not deviation > 0:
        raise InputError(f"deviation = {deviation}; it must be a distance in joint space above 0")
    # A segment of length 0 has no direction.
    moves = (np.diff(path.q, axis=0) != 0.0).any(axis=1)
    distinct = JointPath(path.q[np.concatenate([[True], moves])], path.joint_names)
    q = distinct.q
    # The waypoints that can be rounded, and how far their roundings may reach along the two segments.
    steps = np.diff(q, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / lengths[:, None]
    into, out = directions[:-1], directions[1:]
    turns = np.linalg.norm(out - into, axis=1) > STRAIGHT
    turns &= np.linalg.norm(out + into, axis=1) > REVERSAL
    wanted = np.zeros(len(q))
    inner = np.flatnonzero(turns) + 1
    wanted[inner] = deviation / corner_distance(into[turns], out[turns])
    # Each end of a segment may use half of its length, and what the other end leaves of its half.
    allowed = np.minimum(
        lengths[:-1] - np.minimum(wanted[:-2], lengths[:-1] / 2), lengths[1:] - np.minimum(wanted[2:], lengths[1:] / 2)
    )
    # A rounding is halved until it is proven free.
    reach = np.zeros(len(distinct))
    for i in inner.tolist():
        tried = float(min(wanted[i], allowed[i - 1]))
        for _ in range(MAX_HALVINGS + 1):
            if tried < MIN_REACH:
                break
            width, piece = round_corner(q[i], into[i - 1], out[i - 1], tried)
            if is_proven_free(BlendedPath([0.0, width], piece[None], path.joint_names), checker):
                reach[i] = tried
                break
            tried /= 2
    return BlendedPath.rounded(distinct, reach)


# -- along constraints of the tcp --------------------------------------------------------------------------------------


def _shortened(q: Array, edges: Edges, manifold: Manifold, rng: np.random.Generator, attempts: int) -> Array:
    """A shorter path (k, n) along the constraints from waypoints q (m, n) that satisfy them; new edges are proven."""
    failures = 0
    for draws in [np.array([0.0, 1.0]), *rng.random((attempts, 2))]:
        at = _lengths(q)
        low, high = np.sort(draws) * at[-1]
        a, b = _point(q, at, low), _point(q, at, high)
        most = float(high - low - MIN_GAIN * at[-1])
        found = manifold.connect(edges.core, a, b, STEP, most) if most > 0 else None
        if found is not None and all(edges.proven_free(*pair) for pair in pairwise(found)):
            head, tail = q[at < low], q[at > high]
            q, failures = np.concatenate([head, found, tail]), 0
        else:
            failures += 1
            if failures > PATIENCE:
                break
    return q


def _smooth_curves(
    path: JointPath, edges: Edges, constraints: Sequence[PathConstraint], group: JointGroup
) -> Iterator[BlendedPath]:
    """Twice differentiable curves through points along a path, in the order of their numbers of points.

    The curves are not proven: a spline may leave the constraints between its points.
    """
    q, along = path.q, _lengths(path.q)
    if (length := float(along[-1])) == 0.0:
        return
    manifold = manifold_of(group, constraints)
    # The chords of a curve may leave a closed chain, whose tolerance is much smaller, and keep all other constraints
    others = [each for each in constraints if each.relative_to is None]
    share = INSIDE if len(others) == len(constraints) else CLOSED
    of_chords = manifold_of(group, others) if others else None

    def is_free(a: Array, b: Array) -> bool:
        return (of_chords is None or bool(of_chords.edge_proven(a, b))) and edges.samples_free(a, b)

    for spacing in SPACINGS:
        count = int(np.clip(np.ceil(length / spacing), FEWEST, MOST))
        points = np.array([_point(q, along, part) for part in np.linspace(0.0, along[-1], count + 1)])
        # Each point is moved inside the constraints, and then towards the middle of its neighbours, as far as
        # constraints and obstacles allow.
        for i in range(1, len(points) - 1):
            inside = manifold.project(points[i], share)
            points[i] = points[i] if inside is None else inside
        converged = CONVERGED * float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean())
        for _ in range(PASSES):
            largest = 0.0
            for i in range(1, len(points) - 1):
                moved = manifold.project((points[i - 1] + 2 * points[i] + points[i + 1]) / 4, share)
                if moved is None:
                    continue
                change = float(np.abs(moved - points[i]).max())
                if change > converged and is_free(points[i - 1], moved) and is_free(moved, points[i + 1]):
                    points[i], largest = moved, max(largest, change)
            if largest <= converged:
                break
        yield BlendedPath.join(CubicPath.through(points, path.joint_names))


def _lengths(q: Array) -> Array:
    """(m,) the length of a path up to each waypoint."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])


def _point(q: Array, at: Array, length: float) -> Array:
    """(n,) the point of a path (m, n) at a length; exactly the ends at 0 and at the total length."""
    if length <= 0.0 or length >= at[-1]:
        return np.array(q[0] if length <= 0.0 else q[-1])
    i = int(np.searchsorted(at, length, side="right")) - 1
    return np.asarray(q[i] + (q[i + 1] - q[i]) * (length - at[i]) / (at[i + 1] - at[i]))
