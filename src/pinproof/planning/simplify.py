"""Shorten a path and round its corners, with what was gained and the proof of exactly the curve that is handed over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.motion import BlendedPath, JointPath
from pinproof.planning.blend import blend as round_corners
from pinproof.planning.shortcut import shortcut

__all__ = ["Simplified", "simplify"]


@dataclass(frozen=True, eq=False)
class Simplified:
    """A path made shorter and smoother.

    Parameters
    ----------
    path
        The curve: a :class:`~pinproof.BlendedPath` where corners were rounded, else a :class:`~pinproof.JointPath`.
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

    def or_raise(self) -> Simplified:
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
) -> Simplified:
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
) -> Simplified:
    stops = _stops(curve)
    message = (
        f"length {path.length:.3g} to {curve.length:.3g}, {max(len(path) - 2, 0)} corners to {stops} stops; "
        f"{proof.message}{given_up}"
    )
    return Simplified(curve, proof, before, path.length, curve.length, message)


def _stops(curve: JointPath | BlendedPath) -> int:
    return len(curve.corners) if isinstance(curve, BlendedPath) else max(len(curve) - 2, 0)
