"""Shorten a path by straight edges between points of it; an edge is taken only if it is proven free.

Random shortcuts find the long ways round and leave corners behind; taking waypoints out, and pulling those that stay
towards the straight line between their neighbours, leaves few. Where the one gains nothing more the other often does.

Sources: R. Geraerts, M. Overmars, "Creating high-quality paths for motion planning", IJRR 26(8), 2007 (random
shortcuts); S. Sekhavat, P. Svestka, J.-P. Laumond, M. Overmars, "Multilevel path planning for nonholonomic robots using
semiholonomic subsystems", IJRR 17(8), 1998 (waypoints taken out).

Shorten a path and round its corners, with what was gained and the proof of exactly the curve that is handed over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify, is_proven_free
from pinproof.errors import InputError
from pinproof.motion import BlendedPath, JointPath
from pinproof.planning.blend import blend as round_corners
from pinproof.planning.edges import Edges

__all__ = ["SimplifyResult", "shortcut", "simplify"]

Array = npt.NDArray[np.float64]

WORTH_IT = 1e-3
"""Share of the path's length (Euclidean). A change that saves less is not worth its proof."""

PATIENCE = 12
"""Random shortcuts in a row that gain nothing, after which no more are tried."""

PULLS = 5
"""Times that each waypoint is pulled at most."""

NOT_AT_THE_END = 0.1
"""Share of the way between its neighbours that a waypoint keeps from either: no edge becomes a hairline."""

FAINTEST = 0.2
"""A waypoint that cannot be pulled by this share of the way to the straight line is left where it is."""


def shortcut(
    path: JointPath,
    checker: CollisionChecker,
    *,
    rng: int | np.random.Generator = 0,
    attempts: int = 60,
    resolution: float = 0.05,
) -> JointPath:
    """A path with the same ends, at most as long and mostly of few waypoints, whose new edges are each proven free.

    The edges that are kept are as good as they were: a certified path stays certifiable. The work ends with its
    budget, or where it gains nothing more, and never by a clock: the same input gives the same path.

    Parameters
    ----------
    path
        The path to shorten.
    checker
        What new edges must be free of.
    rng
        Where the ends of the random shortcuts come from; the same gives the same path.
    attempts
        How many random shortcuts are tried at most. With 0, waypoints are taken out and nothing else.
    resolution
        Metres that bodies move between two samples looked at before a proof is begun.

    Raises
    ------
    InputError
        If the path's joints are not the arm's, or a setting makes no sense.
    """
    if path.joint_names != checker.arm.joint_names:
        raise InputError(f"the path has the joints {path.joint_names}, the arm {checker.arm.joint_names}")
    if attempts < 0:
        raise InputError(f"attempts = {attempts}; it is 0 or more")
    work = _Work(checker, Edges(checker, resolution, path.q[[0, -1]]), np.random.default_rng(rng))
    q = work.skip(_without_repeats(np.array(path.q)))
    if attempts:
        q = work.pull(work.drop(work.cut(q, attempts)))
        q = work.drop(q)
    return JointPath(_without_repeats(q), path.joint_names)


class _Work:
    """The ways to change a path q (m, n); each gives a path with the same ends that is not longer."""

    def __init__(self, checker: CollisionChecker, edges: Edges, rng: np.random.Generator) -> None:
        self._checker, self._edges, self._rng = checker, edges, rng

    def skip(self, q: Array) -> Array:
        """From each kept waypoint go straight to the farthest one that can be reached."""
        kept, here, last = [q[0]], 0, len(q) - 1
        while here < last:
            there = next((k for k in range(last, here + 1, -1) if self._free(q[here], q[k])), here + 1)
            kept.append(q[there])
            here = there
        return np.array(kept)

    def drop(self, q: Array) -> Array:
        """Take out one waypoint after another, where the straight edge between its neighbours is free."""
        i = 1
        while i < len(q) - 1:
            if self._free(q[i - 1], q[i + 1]):
                q = np.delete(q, i, axis=0)
                i = max(i - 1, 1)  # its neighbour now has another one
            else:
                i += 1
        return q

    def cut(self, q: Array, attempts: int) -> Array:
        """Random shortcuts between points of different edges, until they no longer gain."""
        fruitless = 0
        for _ in range(attempts):
            if len(q) < 3 or fruitless == PATIENCE:
                break
            shorter = self._random_shortcut(q)
            fruitless = fruitless + 1 if shorter is q else 0
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
        if gain <= WORTH_IT * at[-1] or not self._free(a, b):
            return q
        return np.vstack([q[: i + 1], a, b, q[k + 1 :]])

    def pull(self, q: Array) -> Array:
        """Move each waypoint towards the straight line between its neighbours: all the way, half of it, ..."""
        q = q.copy()
        share = np.ones(len(q))
        least = WORTH_IT * float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
        for _ in range(PULLS):
            gained = False
            for i in range(1, len(q) - 1):
                before, here, behind = q[i - 1 : i + 2]
                chord = behind - before
                along = float((here - before) @ chord / max(chord @ chord, np.finfo(float).tiny))
                foot = before + chord * min(max(along, NOT_AT_THE_END), 1.0 - NOT_AT_THE_END)
                there = here + (foot - here) * share[i]
                legs = [
                    float(np.linalg.norm(step))
                    for step in (here - before, behind - here, there - before, behind - there)
                ]
                if share[i] < FAINTEST or legs[0] + legs[1] - legs[2] - legs[3] <= least:
                    continue
                if self._free(before, there) and self._free(there, behind):
                    q[i], gained = there, True
                else:
                    share[i] /= 2
                    gained = gained or share[i] >= FAINTEST
            if not gained:
                break
        return q

    def _free(self, a: Array, b: Array) -> bool:
        names = self._checker.arm.joint_names
        return self._edges.looks_free(a, b) and is_proven_free(JointPath([a, b], names), self._checker)


def _without_repeats(q: Array) -> Array:
    """The waypoints without those that equal their predecessor: a segment of no length has no point to cut at."""
    moves = (np.diff(q, axis=0) != 0).any(axis=1)
    return q[np.concatenate([[True], moves])]


@dataclass(frozen=True, eq=False)
class SimplifyResult:
    """A path made shorter and smoother.

    Parameters
    ----------
    path
        A :class:`~pinproof.motion.BlendedPath` if corners were rounded, else a :class:`~pinproof.JointPath`.
    certificate
        For exactly ``path``. FREE, unless not even the path that was given is.
    before
        The certificate of the path that was given.
    length_before, length_after
        Euclidean lengths in joint space (radians and metres count alike).
    message
        What was gained in a sentence, and what was given up.
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
        """At how many points between its ends the arm must stop."""
        return _stops(self.path)

    @property
    def clearance_before(self) -> float:
        """Metres that were proven of the path that was given; NaN if it is not free."""
        return self.before.clearance

    @property
    def clearance_after(self) -> float:
        """Metres that are proven of ``path``; NaN if it is not free."""
        return self.certificate.clearance

    @property
    def observed_before(self) -> float:
        """Metres: the smallest distance that was seen along the path that was given."""
        return self.before.observed

    @property
    def observed_after(self) -> float:
        """Metres: the smallest distance that was seen along ``path``."""
        return self.certificate.observed

    def or_raise(self) -> SimplifyResult:
        """Return the result if its path is proven free.

        Raises
        ------
        NotProvenFree
            With the certificate's message otherwise.
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
    """Shorten a path (:func:`shortcut`), round its corners (:func:`blend`), and prove the curve that comes out.

    Every piece is proven before it is taken; the certificate is for the whole curve once more. Should that one not be
    FREE, the last curve that is proven is handed over, and the message says so.

    Parameters
    ----------
    path
        The path of a planner.
    checker
        What the curve must be free of.
    rng, attempts
        As for :func:`shortcut`.
    blend, deviation
        Whether to round corners, and by how much (rad or m, Euclidean) one may be missed.
    certificate
        That of ``path`` where it is known, such as :attr:`PlanResult.certificate`; else it is made.

    Raises
    ------
    InputError
        If the path's joints are not the arm's, or a setting makes no sense.
    """
    short = shortcut(path, checker, rng=rng, attempts=attempts)
    candidates: list[JointPath | BlendedPath] = [short]
    if blend:
        candidates.insert(0, round_corners(short, checker, deviation=deviation))
    before = certificate if certificate is not None and _is_for(certificate, path, checker) else certify(path, checker)
    given_up = ""
    for curve in candidates:
        proof = certify(curve, checker)
        if proof.free:
            return _result(curve, proof, path, before, given_up)
        given_up = f"; a {'rounder' if isinstance(curve, BlendedPath) else 'shorter'} one was given up: {proof.message}"
    return _result(path, certify(path, checker), path, before, given_up)


def _is_for(certificate: Certificate, path: JointPath, checker: CollisionChecker) -> bool:
    """Whether a certificate is for this path, this setup, these margins as far as it tells, and these pairs."""
    same = certificate.margin == checker.margin and certificate.excluded == tuple(checker.excluded)
    return same and certificate.matches(path, checker.arm, checker.scene, checker.attached)


def _result(
    curve: JointPath | BlendedPath, proof: Certificate, path: JointPath, before: Certificate, given_up: str
) -> SimplifyResult:
    stops = _stops(curve)
    message = (
        f"length {path.length:.3g} to {curve.length:.3g}, {max(len(path) - 2, 0)} corners to {stops} stops; "
        f"{proof.message}{given_up}"
    )
    return SimplifyResult(curve, proof, before, path.length, curve.length, message)


def _stops(curve: JointPath | BlendedPath) -> int:
    return len(curve.corners) if isinstance(curve, BlendedPath) else max(len(curve) - 2, 0)
