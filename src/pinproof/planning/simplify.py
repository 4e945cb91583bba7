"""Shorten a path, round its corners, and certify the resulting curve.

Random shortcuts remove detours. The removal of waypoints, and moving the remaining ones towards the straight line
between their neighbours, keeps the number of waypoints small. A new edge is accepted only if it is proven free.

Sources: R. Geraerts, M. Overmars, "Creating high-quality paths for motion planning", IJRR 26(8), 2007 (random
shortcuts); S. Sekhavat, P. Svestka, J.-P. Laumond, M. Overmars, "Multilevel path planning for nonholonomic robots using
semiholonomic subsystems", IJRR 17(8), 1998 (removal of waypoints).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.motion import BlendedPath, JointPath
from pinproof.planning.blend import blend as round_corners
from pinproof.planning.blend import without_repeats
from pinproof.planning.edges import Edges

__all__ = ["SimplifyResult", "shortcut", "simplify"]

Array = npt.NDArray[np.float64]

MIN_GAIN = 1e-3
"""Fraction of the path length (Euclidean). A change that saves less does not justify its proof."""

PATIENCE = 12
"""Number of consecutive random shortcuts without gain after which no more are tried."""

MAX_PASSES = 5
"""Maximum number of passes in which waypoints are moved."""

END_DISTANCE = 0.1
"""Minimum distance of a moved waypoint from its neighbours, as a fraction of their distance; it avoids tiny edges."""

MIN_SHARE = 0.2
"""A waypoint is left in place if it cannot be moved by this fraction of its distance to the straight line."""


@dataclass(frozen=True, eq=False)
class SimplifyResult:
    """A shortened and smoothed path.

    Parameters
    ----------
    path
        A :class:`~pinproof.motion.BlendedPath` if the corners were rounded, else a :class:`~pinproof.JointPath`.
    certificate
        The certificate of ``path``. It is FREE unless the given path itself is not free.
    before
        The certificate of the given path.
    length_before, length_after
        Euclidean lengths in joint space (radians and metres have equal weight).
    message
        The change in length and stops as text, with any curve that was rejected.
    """

    path: JointPath | BlendedPath
    certificate: Certificate
    before: Certificate
    length_before: float
    length_after: float
    message: str

    @property
    def ok(self) -> bool:
        """Whether ``path`` is proven free."""
        return self.certificate.free

    @property
    def stops(self) -> int:
        """The number of points between the ends at which the arm must stop."""
        return _stops(self.path)

    @property
    def clearance_before(self) -> float:
        """Proven clearance (m) of the given path; NaN if it is not free."""
        return self.before.clearance

    @property
    def clearance_after(self) -> float:
        """Proven clearance (m) of ``path``; NaN if it is not free."""
        return self.certificate.clearance

    @property
    def observed_before(self) -> float:
        """The smallest distance (m) that was measured along the given path."""
        return self.before.observed

    @property
    def observed_after(self) -> float:
        """The smallest distance (m) that was measured along ``path``."""
        return self.certificate.observed

    def or_raise(self) -> SimplifyResult:
        """Return the result if its path is proven free.

        Raises
        ------
        NotProvenFree
            Otherwise, with the message of the certificate.
        """
        self.certificate.or_raise()
        return self


def simplify(
    path: JointPath,
    checker: CollisionChecker,
    *,
    rng: int | np.random.Generator = 0,
    blend: bool = True,
    deviation: float = 0.1,
    attempts: int = 60,
    certificate: Certificate | None = None,
) -> SimplifyResult:
    """Shorten a path (:func:`shortcut`), round its corners (:func:`blend`), and certify the resulting curve.

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
    certificate
        The certificate of ``path``, such as :attr:`PlanResult.certificate`. If it is not given, it is computed.

    Raises
    ------
    InputError
        If the joints of the path are not those of the arm, or a setting is out of its range.
    """
    short = shortcut(path, checker, rng=rng, attempts=attempts)
    candidates: list[JointPath | BlendedPath] = [short]
    if blend:
        candidates.insert(0, round_corners(short, checker, deviation=deviation))
    before = certificate if certificate is not None and _is_for(certificate, path, checker) else certify(path, checker)
    rejected = ""
    for curve in candidates:
        proof = certify(curve, checker)
        if proof.free:
            return _result(curve, proof, path, before, rejected)
        kind = "rounded" if isinstance(curve, BlendedPath) else "shortened"
        rejected = f"; the {kind} path was rejected: {proof.message}"
    return _result(path, certify(path, checker), path, before, rejected)


def _is_for(certificate: Certificate, path: JointPath, checker: CollisionChecker) -> bool:
    """Whether a certificate is for this path, this setup, this margin and these excluded pairs."""
    same = certificate.margin == checker.margin and certificate.excluded == tuple(checker.excluded)
    return same and certificate.matches(path, checker.arm, checker.scene, checker.attached)


def _result(
    curve: JointPath | BlendedPath, proof: Certificate, path: JointPath, before: Certificate, rejected: str
) -> SimplifyResult:
    stops = _stops(curve)
    message = (
        f"length reduced from {path.length:.3g} to {curve.length:.3g}, stops from {max(len(path) - 2, 0)} to {stops}; "
        f"{proof.message}{rejected}"
    )
    return SimplifyResult(curve, proof, before, path.length, curve.length, message)


def _stops(curve: JointPath | BlendedPath) -> int:
    return len(curve.corners) if isinstance(curve, BlendedPath) else max(len(curve) - 2, 0)


def shortcut(
    path: JointPath,
    checker: CollisionChecker,
    *,
    rng: int | np.random.Generator = 0,
    attempts: int = 60,
    resolution: float = 0.05,
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
        Maximum number of random shortcuts. With 0, waypoints are removed and nothing else is changed.
    resolution
        Distance (m) by which bodies move between two samples that are checked before the proof of an edge.

    Raises
    ------
    InputError
        If the joints of the path are not those of the arm, or a setting is out of its range.
    """
    if path.joint_names != checker.arm.joint_names:
        raise InputError(f"the path has the joints {path.joint_names}, the arm {checker.arm.joint_names}")
    if attempts < 0:
        raise InputError(f"attempts = {attempts}; it must be 0 or more")
    shortener = _Shortener(Edges(checker, resolution, path.q[[0, -1]]), np.random.default_rng(rng))
    q = shortener.connect_farthest(without_repeats(np.array(path.q)))
    if attempts:
        q = shortener.straighten(shortener.remove_waypoints(shortener.random_shortcuts(q, attempts)))
        q = shortener.remove_waypoints(q)
    return JointPath(without_repeats(q), path.joint_names)


class _Shortener:
    """The operations on a path q (m, n). Each returns a path with the same ends that is not longer."""

    def __init__(self, edges: Edges, rng: np.random.Generator) -> None:
        self._free, self._rng = edges.proven_free, rng

    def connect_farthest(self, q: Array) -> Array:
        """Connect each kept waypoint to the farthest later waypoint that a free edge reaches."""
        kept, first, last = [q[0]], 0, len(q) - 1
        while first < last:
            first = next((k for k in range(last, first + 1, -1) if self._free(q[first], q[k])), first + 1)
            kept.append(q[first])
        return np.array(kept)

    def remove_waypoints(self, q: Array) -> Array:
        """Remove each waypoint for which the edge between its neighbours is free."""
        i = 1
        while i < len(q) - 1:
            if self._free(q[i - 1], q[i + 1]):
                q = np.delete(q, i, axis=0)
                i = max(i - 1, 1)  # the previous waypoint has a new neighbour
            else:
                i += 1
        return q

    def random_shortcuts(self, q: Array, attempts: int) -> Array:
        """Connect random points of different edges, until PATIENCE attempts in a row have no gain."""
        failures = 0
        for _ in range(attempts):
            if len(q) < 3 or failures == PATIENCE:
                break
            shorter = self._random_shortcut(q)
            failures = failures + 1 if shorter is q else 0
            q = shorter
        return q

    def _random_shortcut(self, q: Array) -> Array:
        lengths = np.linalg.norm(np.diff(q, axis=0), axis=1)
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        first, last = np.sort(self._rng.uniform(0.0, at[-1], 2))
        i, k = (min(int(np.searchsorted(at, s, side="right")) - 1, len(lengths) - 1) for s in (first, last))
        if i == k:
            return q
        a = q[i] + (q[i + 1] - q[i]) * ((first - at[i]) / lengths[i])
        b = q[k] + (q[k + 1] - q[k]) * ((last - at[k]) / lengths[k])
        gain = (last - first) - float(np.linalg.norm(b - a))
        if gain <= MIN_GAIN * at[-1] or not self._free(a, b):
            return q
        return np.vstack([q[: i + 1], a, b, q[k + 1 :]])

    def straighten(self, q: Array) -> Array:
        """Move each waypoint towards the straight line between its neighbours, by a share that is halved on failure."""
        q = q.copy()
        share = np.ones(len(q))
        min_gain = MIN_GAIN * float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
        for _ in range(MAX_PASSES):
            changed = False
            for i in range(1, len(q) - 1):
                before, here, after = q[i - 1 : i + 2]
                chord = after - before
                along = float((here - before) @ chord / max(chord @ chord, np.finfo(float).tiny))
                foot = before + chord * min(max(along, END_DISTANCE), 1.0 - END_DISTANCE)
                moved = here + (foot - here) * share[i]
                lengths = [
                    float(np.linalg.norm(step)) for step in (here - before, after - here, moved - before, after - moved)
                ]
                if share[i] < MIN_SHARE or lengths[0] + lengths[1] - lengths[2] - lengths[3] <= min_gain:
                    continue
                if self._free(before, moved) and self._free(moved, after):
                    q[i], changed = moved, True
                else:
                    share[i] /= 2
                    changed = changed or share[i] >= MIN_SHARE
            if not changed:
                break
        return q
