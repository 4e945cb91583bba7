"""Paths that satisfy constraints of the tcp: shortcuts along the constraints, and a smooth curve through their points.

Every waypoint is projected onto the constraints, and every edge is proven (``src/core/planning/manifold.h``).

Source: D. Berenson, S. Srinivasa, J. Kuffner (2011), "Task space regions: a framework for pose-constrained manipulation
planning", International Journal of Robotics Research 30(12), section 4 (CBiRRT2: constrained extension and shortcuts).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from pinproof._core import Manifold
from pinproof.collision import CollisionChecker, PathConstraint, amount
from pinproof.model import Arm
from pinproof.motion import BlendedPath, CubicPath
from pinproof.planning.edges import Edges
from pinproof.spatial import Array

STEP = 0.3
"""rad or m: maximum length of a step along the constraints, before it is halved until its edge is proven."""

MIN_GAIN = 1e-3
"""Fraction of the path length that a shortcut must save."""

PATIENCE = 15
"""Number of consecutive random shortcuts without gain after which no more are tried."""

INSIDE = 0.5
"""Share of the tolerance to which points are projected, so that the curve through them has the rest."""

SPACINGS = (0.3, 0.15, 0.075)
"""rad or m: distances between the points of the smooth curve, tried in this order."""

FEWEST, MOST = 6, 300
"""Limits of the number of points of the smooth curve."""

PASSES = 40
"""Maximum number of passes in which each point is moved towards the middle of its neighbours."""

CONVERGED = 0.01
"""The passes end when no point moves by this fraction of the spacing."""


def manifold_of(arm: Arm, constraints: Sequence[PathConstraint]) -> Manifold:
    """The configurations of an arm, within its limits, that satisfy the constraints."""
    limits = arm.limits
    lower, upper = np.ascontiguousarray(limits.lower), np.ascontiguousarray(limits.upper)
    return Manifold(arm.chain, [each.compiled() for each in constraints], lower, upper)


def violations_at(checker: CollisionChecker, q: Array, constraints: Sequence[PathConstraint]) -> list[str]:
    """The constraints that q (n,) violates, each as a sentence that states by how much."""
    found = []
    for each in constraints:
        error = each.error(checker.arm, q)
        if not error <= each.tolerance:
            excess = amount(each, error - each.tolerance)
            found.append(f"{each} is violated: the error is {amount(each, error)}, {excess} too much")
    return found


def shortened(q: Array, edges: Edges, manifold: Manifold, rng: np.random.Generator, attempts: int) -> Array:
    """A shorter path (k, n) along the constraints with the same ends; its new edges are proven.

    Parameters
    ----------
    q
        (m, n) waypoints that satisfy the constraints.
    edges
        Checks for collisions.
    manifold
        The constraints.
    rng, attempts
        Source and maximum number of the random shortcuts.
    """
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


def smooth_curves(q: Array, edges: Edges, manifold: Manifold, joint_names: Sequence[str]) -> Iterator[BlendedPath]:
    """Twice differentiable curves through points along a path (m, n), in the order of their numbers of points.

    The curves are not proven: a spline may leave the constraints between its points.
    """
    length = float(_lengths(q)[-1])
    if length == 0.0:
        return
    for spacing in SPACINGS:
        count = int(np.clip(np.ceil(length / spacing), FEWEST, MOST))
        along = _lengths(q)
        sampled = np.array([_point(q, along, length) for length in np.linspace(0.0, along[-1], count + 1)])
        points = _relaxed(sampled, edges, manifold)
        yield BlendedPath.join(CubicPath.through(points, joint_names))


def _relaxed(q: Array, edges: Edges, manifold: Manifold) -> Array:
    """The points (m, n), moved towards the middle of their neighbours as far as constraints and obstacles allow."""
    q = q.copy()
    for i in range(1, len(q) - 1):
        inside = manifold.project(q[i], INSIDE)
        q[i] = q[i] if inside is None else inside
    converged = CONVERGED * float(np.linalg.norm(np.diff(q, axis=0), axis=1).mean())

    def is_free(a: Array, b: Array) -> bool:
        return bool(manifold.edge_proven(a, b)) and edges.samples_free(a, b)

    for _ in range(PASSES):
        largest = 0.0
        for i in range(1, len(q) - 1):
            moved = manifold.project((q[i - 1] + 2 * q[i] + q[i + 1]) / 4, INSIDE)
            if moved is None:
                continue
            change = float(np.abs(moved - q[i]).max())
            if change > converged and is_free(q[i - 1], moved) and is_free(moved, q[i + 1]):
                q[i], largest = moved, max(largest, change)
        if largest <= converged:
            break
    return q


def _lengths(q: Array) -> Array:
    """(m,) the length of a path up to each waypoint."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])


def _point(q: Array, at: Array, length: float) -> Array:
    """(n,) the point of a path (m, n) at a length; exactly the ends at 0 and at the total length."""
    if length <= 0.0 or length >= at[-1]:
        return np.array(q[0] if length <= 0.0 else q[-1])
    i = int(np.searchsorted(at, length, side="right")) - 1
    return np.asarray(q[i] + (q[i + 1] - q[i]) * (length - at[i]) / (at[i + 1] - at[i]))
