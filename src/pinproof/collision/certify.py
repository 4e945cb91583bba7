"""Is a whole curve free of contact? Proven between samples, not sampled.

The curve is cut into intervals in path order. In each, the distance of every pair at the middle is compared with how
much nearer the pair can come anywhere in the interval (:mod:`pinproof.collision.motion_bounds`): what is settled is
dropped, what is not is taken to both halves. A contact at a middle ends the search to its right; the search to its left
goes on until everything before the contact is proven free or the tolerance is met.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    UndecidedSpan,
    curve_hash,
    proven_millimetres,
    setup_hash,
)
from pinproof.collision.checker import CollisionChecker
from pinproof.collision.contact import Contact
from pinproof.collision.motion_bounds import MotionBounds
from pinproof.collision.placed import Placed
from pinproof.errors import InputError
from pinproof.motion import Curve
from pinproof.motion.bezier import split

__all__ = ["certify"]

Array = npt.NDArray[np.float64]
Pairs = npt.NDArray[np.int64]

ROUNDING = 1e-9
"""Metres added to every motion bound, for each metre the scene is wide: floating-point error of placements and supports
(seen: 3e-9 m at 100 m), with room."""

SHARE = 0.5
"""A pair is settled once this share of the clearance seen so far is proven, so that the proven bound says something."""


LOOK_AHEAD = 200
"""Intervals: how far behind a span that stays undecided a contact is looked for, to say COLLIDING where that is so."""


@dataclass(frozen=True, eq=False)
class _Interval:
    """One piece of the curve over [start, end] and the pairs not settled on it."""

    start: float
    end: float
    control: Array
    pairs: Pairs


class _Weakest(NamedTuple):
    """Of the pairs not settled on an interval, the one of which least is proven; distances in metres."""

    pair: int
    distance: float
    proven: float


def certify(
    curve: Curve, checker: CollisionChecker, *, tolerance: float = 1e-4, max_intervals: int = 200_000
) -> Certificate:
    """Prove that a curve is free of contact, or show where it is not.

    Parameters
    ----------
    curve
        A :class:`~pinproof.JointPath`, :class:`~pinproof.CubicPath` or :class:`~pinproof.Trajectory`.
    checker
        Says which bodies are checked, and the margin that must stay between them.
    tolerance
        Metres. An interval in which no body moves farther than this towards another is not cut any further; a curve
        that grazes by less may be UNDECIDED.
    max_intervals
        The number of intervals after which the answer is UNDECIDED.

    Returns
    -------
    Certificate
        FREE, COLLIDING or UNDECIDED. FREE is never said without a proof.

    Raises
    ------
    InputError
        If the curve's joints are not the arm's, or a setting makes no sense.
    """
    if tuple(curve.joint_names) != checker.arm.joint_names:
        raise InputError(f"the curve has the joints {curve.joint_names}, the arm {checker.arm.joint_names}")
    if not tolerance > 0 or max_intervals < 1:
        raise InputError(f"tolerance = {tolerance} must be above 0 m and max_intervals = {max_intervals} at least 1")
    return _Proof(curve, checker, tolerance, max_intervals).run()


class _Proof:
    """The state of one certification."""

    def __init__(self, curve: Curve, checker: CollisionChecker, tolerance: float, max_intervals: int) -> None:
        self._curve, self._checker = curve, checker
        self._margin, self._tolerance, self._max_intervals = checker.margin, tolerance, max_intervals
        self._bounds = MotionBounds(checker)
        widest = max((float(np.abs(body.box).max()) + body.reach for body in checker.bodies), default=0.0)
        self._rounding = ROUNDING * max(1.0, widest)
        self._observed = np.inf
        self._proven = np.inf
        self._intervals = 0

    def run(self) -> Certificate:
        knots, control = self._curve.bezier()
        everything = np.arange(len(self._checker.pairs))
        still = ~self._bounds.moving.any(axis=1)
        # Both ends first: a start in contact is the commonest "no", and halving alone would only creep up on it.
        for time, q in ((knots[0], control[0, 0]), (knots[-1], control[-1, -1])):
            contact = self._touching(q, everything)
            if contact is not None and time == knots[0]:
                return self._colliding(float(time), q, contact, float(time))
        found: tuple[float, Array, Contact] | None = None
        if contact is not None:
            found = (float(knots[-1]), control[-1, -1].copy(), contact)
        if (undecided := self._judge_still(everything[still], control[0, 0], knots)) is not None:
            if found is not None:
                return self._colliding(*found, proven_free_until=float(knots[0]))
            return self._undecided(undecided)
        stack = [
            _Interval(float(knots[i]), float(knots[i + 1]), control[i], everything[~still])
            for i in reversed(range(len(control)))
        ]
        open_span: UndecidedSpan | None = None
        while stack:
            interval = stack.pop()
            self._intervals += 1
            middle = (interval.start + interval.end) / 2
            left, right = (half[0] for half in split(interval.control[None]))
            q = left[-1]
            delta = np.abs(interval.control - q).max(axis=0)
            space = self._checker.placed(q)
            pairs, weakest, contact = self._unsettled(interval, q, delta, space)
            if contact is not None:
                found, stack = (middle, q, contact), []
            if len(pairs) == 0:
                continue
            step = float(self._frame.approach(delta, pairs).max())
            if step < self._tolerance or self._intervals >= self._max_intervals:
                if weakest.proven > self._margin:  # less than the share that was hoped for, but proven
                    self._proven = min(self._proven, weakest.proven)
                    continue
                if open_span is None:
                    span = interval.start, interval.end
                    open_span = UndecidedSpan(*span, self._names(weakest.pair), weakest.distance)
                    last = self._intervals + LOOK_AHEAD
                # A contact that begins right here is met at the end of the interval, or soon behind it.
                if found is None and (contact := self._touching(interval.control[-1], pairs)) is not None:
                    found, stack = (interval.end, interval.control[-1].copy(), contact), []
                if found is not None or self._intervals >= min(last, self._max_intervals):
                    break
                continue
            if contact is None:
                stack.append(_Interval(middle, interval.end, right, pairs))
            stack.append(_Interval(interval.start, middle, left, pairs))
        if found is not None:
            return self._colliding(*found, proven_free_until=found[0] if open_span is None else open_span.start)
        return self._free() if open_span is None else self._undecided(open_span)

    def _unsettled(
        self, interval: _Interval, q: Array, delta: Array, space: Placed
    ) -> tuple[Pairs, _Weakest, Contact | None]:
        """The pairs not settled on the interval, the one of which least is proven, and a contact at the middle."""
        self._frame = self._bounds.at(q, space)
        approach = self._frame.approach(delta, interval.pairs) + self._rounding
        coarse = self._frame.coarse_distance(interval.pairs) - approach
        far = coarse > self._goal()
        if far.any():
            self._proven = min(self._proven, float(coarse[far].min()))
        open_pairs, contact, deepest = [], None, np.inf
        weakest = _Weakest(-1, np.inf, np.inf)
        for k, moved in zip(interval.pairs[~far].tolist(), approach[~far].tolist(), strict=True):
            distance = space.distance(k)
            self._observed = min(self._observed, distance)
            if distance <= self._margin and distance < deepest:
                contact, deepest = self._checker.contact(space, k, distance), distance
            proven = space.proven_distance(k, distance) - moved
            if proven > self._goal():
                self._proven = min(self._proven, proven)
                continue
            open_pairs.append(k)
            if not proven >= weakest.proven:
                weakest = _Weakest(k, distance, -np.inf if np.isnan(proven) else proven)  # NaN proves nothing
        return np.array(open_pairs, dtype=np.int64), weakest, contact

    def _goal(self) -> float:
        """What must be proven of a pair for it to be settled: more than the margin, and a share of what was seen."""
        if not np.isfinite(self._observed):
            return self._margin
        return self._margin + SHARE * max(self._observed - self._margin, 0.0)

    def _touching(self, q: Array, pairs: Pairs) -> Contact | None:
        """The deepest contact at q (n,) among the pairs."""
        space = self._checker.placed(q)
        deepest: Contact | None = None
        for k in pairs.tolist():
            distance = space.distance(k)
            self._observed = min(self._observed, distance)
            if distance <= self._margin and (deepest is None or distance < deepest.distance):
                deepest = self._checker.contact(space, k, distance)
        return deepest

    def _judge_still(self, pairs: Pairs, q: Array, knots: Array) -> UndecidedSpan | None:
        """Judge once the pairs with no moving joint between them; contacts among them were seen at the start."""
        space = self._checker.placed(q)
        for k in pairs.tolist():
            distance = space.distance(k)
            proven = space.proven_distance(k, distance) - self._rounding
            if not proven > self._margin:
                return UndecidedSpan(float(knots[0]), float(knots[-1]), self._names(k), distance)
            self._proven = min(self._proven, proven)
        return None

    def _names(self, k: int) -> tuple[str, str]:
        i, j = self._checker.pairs[k]
        return self._checker.bodies[i].owner, self._checker.bodies[j].owner

    def _free(self) -> Certificate:
        count = len(self._checker.pairs)
        nearest = f", seen {self._observed * 1e3:.1f} mm" if np.isfinite(self._observed) else ""
        message = (
            f"no contact anywhere: clearance proven {proven_millimetres(self._proven)}{nearest}, over {count} pairs"
        )
        if self._checker.hollow:
            message += f"; not watertight, so hollow: {', '.join(self._checker.hollow)}"
        return self._certificate(CertificateStatus.FREE, message, clearance=self._proven)

    def _colliding(self, time: float, q: Array, contact: Contact, proven_free_until: float) -> Certificate:
        first = FirstContact(
            time, q.copy(), contact.bodies, contact.distance, contact.points, contact.distance < 0, proven_free_until
        )
        message = f"at {time:.4g} {contact}; proven free until {proven_free_until:.4g}"
        return self._certificate(CertificateStatus.COLLIDING, message, first_contact=first)

    def _undecided(self, span: UndecidedSpan) -> Certificate:
        why = "its budget of intervals" if self._intervals >= self._max_intervals else "its tolerance"
        message = (
            f"the proof met {why} at [{span.start:.6g}, {span.end:.6g}]: {' and '.join(span.bodies)} are "
            f"{span.distance * 1e3:.3f} mm apart there; keep more distance, or lower the margin or the tolerance"
        )
        return self._certificate(CertificateStatus.UNDECIDED, message, undecided=span)

    def _certificate(
        self,
        status: CertificateStatus,
        message: str,
        *,
        clearance: float = np.nan,
        first_contact: FirstContact | None = None,
        undecided: UndecidedSpan | None = None,
    ) -> Certificate:
        checker = self._checker
        return Certificate(
            status=status,
            margin=self._margin,
            clearance=clearance,
            observed=float(self._observed),
            first_contact=first_contact,
            undecided=undecided,
            message=message,
            pairs=len(checker.pairs),
            intervals=self._intervals,
            excluded=tuple(checker.excluded),
            tolerance=self._tolerance,
            curve=curve_hash(self._curve),
            setup=setup_hash(checker.arm, checker.scene, checker.attached),
            hollow=checker.hollow,
        )
