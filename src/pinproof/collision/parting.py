"""Certificates of motions that begin in contact: an object leaves what it stands on, and never approaches it again.

Up to some point of the curve the object is proven never to come nearer to its support (:mod:`.rising`), whatever their
distance; from there on the ordinary proof holds, with the margin. All other pairs are proven as ever, on the whole
curve. So it is not enough to slide along the support: the object must have left it by more than the margin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof.collision.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    Parting,
    Tube,
    UndecidedSpan,
    curve_hash,
    free_sentence,
)
from pinproof.collision.checker import CollisionChecker
from pinproof.collision.rising import Rise, Rising
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import Curve, bezier
from pinproof.motion.curve import read_only

__all__ = ["prove_parting"]

Array = npt.NDArray[np.float64]

DEEPEST = 1e-3
"""Metres: how deep an object may stand in its support at the start. What is measured or taught is off by that much."""

Prove = Callable[[Curve, CollisionChecker], Certificate]


def prove_parting(
    curve: Curve,
    checker: CollisionChecker,
    names: Sequence[tuple[str, str]],
    prove: Prove,
    *,
    tolerance: float,
    max_intervals: int,
    obstacle_tolerance: float,
) -> Certificate:
    """The certificate of a curve along which pairs part that may touch at its start.

    Parameters
    ----------
    names
        Pairs of an obstacle and a link or attached object, in either order.
    prove
        The ordinary proof, of a curve and a checker.
    tolerance, max_intervals, obstacle_tolerance
        As for :func:`pinproof.certify`.

    Raises
    ------
    UnknownNameError, InputError
        If a name stands for nothing, two are no obstacle and body of the robot, or they are not checked anyway.
    """
    knots, control = curve.bezier()
    start, end = control[0, 0], float(knots[-1])
    ways: list[_Way] = []
    for pair in _indices(checker, names):
        rising = Rising(checker, pair, start)
        gap = rising.gap(start)
        enough = float(checker.margins[pair]) + obstacle_tolerance + 2 * checker.rounding
        if gap - obstacle_tolerance < -DEEPEST:
            measured = checker.placed(start).measure(pair)
            if measured.attained - obstacle_tolerance <= checker.margins[pair]:
                return _too_deep(curve, checker, pair, prove, gap - obstacle_tolerance)
            continue  # apart, but around each other: proven as any pair
        rise = rising.follow(knots, control, enough, tolerance, max_intervals)
        ways.append(_Way(pair, rising, rise, gap, rising.gap(bezier.evaluate(knots, control, rise.end)) - enough))
    spans = np.unique([float(knots[0]), *(way.rise.end for way in ways)]).tolist()
    proven: list[Certificate] = []
    for first, last in zip(spans, [*spans[1:], end], strict=True):
        due = [way for way in ways if way.rise.end == first]
        for way in due:
            at = bezier.evaluate(knots, control, first)
            measured = checker.placed(at).measure(way.pair)
            if measured.attained - obstacle_tolerance <= checker.margins[way.pair]:
                return _whole(curve, checker, proven, _stuck(curve, checker, way, prove, obstacle_tolerance))
        apart = [_owners(checker, way.pair) for way in ways if way.rise.end > first]
        proven.append(prove(_Part.of(curve, first, last), checker.allowing(*apart) if apart else checker))
        if not proven[-1].free:
            return _whole(curve, checker, proven[:-1], proven[-1])
    partings = tuple(
        Parting(_owners(checker, way.pair), read_only(way.rising.normal.copy()), way.gap, way.until, way.rise.end)
        for way in ways
    )
    clearance, observed = min(c.clearance for c in proven), min(c.observed for c in proven)
    said = "; ".join(
        [free_sentence(clearance, observed, len(checker.pairs), len(checker.excluded)), *map(str, partings)]
    )
    room = [c.tube.largest_obstacles for c in proven if c.tube is not None]
    room += [DEEPEST + way.gap - obstacle_tolerance for way in ways] + [way.room for way in ways]
    tube = Tube(read_only(np.zeros(control.shape[2])), obstacle_tolerance, 0.0, max(min(room), 0.0))
    whole = _whole(curve, checker, proven[:-1], proven[-1])
    intervals = whole.intervals + sum(way.rise.intervals for way in ways)
    return replace(
        whole, message=said, clearance=clearance, observed=observed, intervals=intervals, tube=tube, partings=partings
    )


@dataclass(frozen=True, eq=False)
class _Way:
    """One pair of bodies that part: how far it is proven, the gap (m) at the start, and what is to spare at the end."""

    pair: int
    rising: Rising
    rise: Rise
    gap: float
    room: float

    @property
    def until(self) -> float:
        """From where on the pair is farther apart than its margin; by the ordinary proof, if the gap does not tell."""
        return min(self.rise.until, self.rise.end)


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a curve, over the same parameter."""

    joint_names: tuple[str, ...]
    knots: Array
    control: Array

    @classmethod
    def of(cls, curve: Curve, first: float, last: float) -> _Part:
        """From ``first`` to ``last``; of no length where they are equal."""
        knots, control = curve.bezier()
        names = tuple(curve.joint_names)
        if first >= last:
            here = bezier.evaluate(knots, control, last)
            return cls(names, np.array([last, last]), np.stack([here] * control.shape[1])[None])
        i = int(np.clip(np.searchsorted(knots, first, side="right") - 1, 0, len(control) - 1))
        j = int(np.clip(np.searchsorted(knots, last, side="left") - 1, 0, len(control) - 1))
        pieces = control[i : j + 1].copy()
        if last < knots[j + 1]:  # the later cut first: it leaves the piece's beginning where it is
            pieces[-1] = bezier.split(pieces[-1], (last - knots[j]) / (knots[j + 1] - knots[j]))[0]
        if first > knots[i]:
            ends = last if i == j else knots[i + 1]
            pieces[0] = bezier.split(pieces[0], (first - knots[i]) / (ends - knots[i]))[1]
        return cls(names, np.array([first, *knots[i + 1 : j + 1], last]), pieces)

    @property
    def domain(self) -> tuple[float, float]:
        return float(self.knots[0]), float(self.knots[-1])

    @property
    def start(self) -> Array:
        point: Array = self.control[0, 0]
        return point

    @property
    def end(self) -> Array:
        point: Array = self.control[-1, -1]
        return point

    def bezier(self) -> tuple[Array, Array]:
        return self.knots, self.control

    def __call__(self, t: npt.ArrayLike) -> Array:
        return bezier.evaluate(self.knots, self.control, t)


def _indices(checker: CollisionChecker, names: Sequence[tuple[str, str]]) -> list[int]:
    """The pairs of bodies that are meant."""
    known, found = checker.obstacles_and_links, []
    for stated in names:
        if isinstance(stated, str) or len(stated) != 2:
            raise InputError(f"parting: {stated!r} is no pair of names")
        one, other = stated
        for name in (one, other):
            if name not in known:
                raise UnknownNameError("body", name, known, "parting")
        if (one in checker.scene.names) == (other in checker.scene.names):
            raise InputError(f"parting: {one!r} and {other!r}; one must be an obstacle, the other a link or attached")
        meant = [k for k in range(len(checker.pairs)) if set(_owners(checker, k)) == {one, other}]
        if not meant:
            raise InputError(
                f"parting: {one!r} and {other!r} are not checked against each other, so they need no leave"
            )
        found += meant
    return list(dict.fromkeys(found))


def _owners(checker: CollisionChecker, pair: int) -> tuple[str, str]:
    i, j = checker.pairs[pair]
    return checker.bodies[i].owner, checker.bodies[j].owner


def _too_deep(curve: Curve, checker: CollisionChecker, pair: int, prove: Prove, gap: float) -> Certificate:
    """They overlap by more than may be at the start."""
    first, _ = curve.domain
    found = prove(_Part.of(curve, first, first), checker)
    one, other = _owners(checker, pair)
    said = f"{one} starts {-gap * 1e3:.2f} mm deep in {other}, more than the {DEEPEST * 1e3:g} mm it may"
    return _whole(curve, checker, [], replace(found, message=f"{said}: {found.message}"))


def _stuck(curve: Curve, checker: CollisionChecker, way: _Way, prove: Prove, obstacle_tolerance: float) -> Certificate:
    """A pair that has not parted where the proof that it does not approach came to its end."""
    knots, control = curve.bezier()
    rise, pair = way.rise, way.pair
    bodies = _owners(checker, pair)
    here = bezier.evaluate(knots, control, rise.end)
    shown = min(rise.stopped, float(knots[-1]))
    there = bezier.evaluate(knots, control, shown)
    measured = checker.placed(there).measure(pair)
    nearer = way.rising.gap(there) < way.rising.gap(here) - checker.rounding
    base = prove(_Part.of(curve, rise.end, rise.end), checker)  # carries what every certificate carries
    touching = measured.attained - obstacle_tolerance <= checker.margins[pair]
    if touching and (nearer or rise.end >= float(knots[-1])):
        contact = checker.contact(pair, measured)
        distance = contact.distance - obstacle_tolerance
        first = FirstContact(shown, there, bodies, distance, contact.points, distance < 0, rise.end)
        how = "comes nearer again" if nearer else "has not left by the end"
        message = f"at {shown:.4g} {bodies[0]} {how}: {contact}; proven not to approach until {rise.end:.4g}"
        return replace(
            base, status=CertificateStatus.COLLIDING, message=message, first_contact=first, undecided=None,
            clearance=np.nan,
        )  # fmt: skip
    message = (
        f"{bodies[0]} is not proven to leave {bodies[1]}, which it touches, at [{rise.end:.6g}, {rise.stopped:.6g}]; "
        "lift it off along one direction before it moves aside"
    )
    span = UndecidedSpan(rise.end, rise.stopped, bodies, measured.distance)
    return replace(
        base, status=CertificateStatus.UNDECIDED, message=message, first_contact=None, undecided=span, clearance=np.nan
    )


def _whole(curve: Curve, checker: CollisionChecker, before: Sequence[Certificate], last: Certificate) -> Certificate:
    """The verdict ``last`` on a part, after parts that were proven free, as one on the whole curve."""
    return replace(
        last,
        observed=min(certificate.observed for certificate in (*before, last)),
        intervals=sum(certificate.intervals for certificate in (*before, last)),
        pairs=len(checker.pairs),
        excluded=tuple(checker.excluded),
        curve=curve_hash(curve),
    )
