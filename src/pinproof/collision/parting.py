"""Certificates of motions that begin in contact: an object leaves what it stands on, and never approaches it again.

Up to some point of the curve the object is proven never to come nearer to its support (:mod:`.rising`), whatever their
distance; from there on the ordinary proof holds, with the margin. All other pairs are proven as ever, on the whole
curve. So it is not enough to slide along the support: the object must have left it by more than the margin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import coal
import numpy as np
import numpy.typing as npt

from pinproof.collision.bodies import Body
from pinproof.collision.by_coal import Distance
from pinproof.collision.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    MotionTube,
    Parting,
    UndecidedSpan,
    curve_hash,
    free_sentence,
)
from pinproof.collision.checker import CollisionChecker
from pinproof.collision.contact_facets import FacetGroup, facet_body, facets_of, leave_facets, unit_vectors
from pinproof.collision.rising import Hull, Mover, Rise, Rising
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import Curve, bezier
from pinproof.motion.curve import read_only

__all__ = ["prove_parting"]

Array = npt.NDArray[np.float64]

DEEPEST = 1e-3
"""Metres: how deep an object may stand in its support at the start. What is measured or taught is off by that much."""

NEAR = 2e-3
"""Metres beyond the margin up to which a body is near a facet at the start: so much is left for the ordinary proof of
the facets farther away, which it proves within a few intervals."""

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
    motion = _Motion(curve, knots, control, tolerance, max_intervals, obstacle_tolerance)
    ways, full, refused = _departures(checker, _indices(checker, names), motion)
    if refused is not None:
        return _refused(curve, checker, refused, prove)
    open_until = {pair: max(way.rise.end for way in own) for pair, own in full.pieces.items()}
    ends = np.unique([float(knots[0]), *(way.rise.end for way in ways)]).tolist()
    proven: list[Certificate] = []
    for first, last in zip(ends, [*ends[1:], float(knots[-1])], strict=True):
        at = bezier.evaluate(knots, control, first)
        for way in ways:
            if way.rise.end == first:
                measured = full.checker.placed(at).measure(way.pair)
                if measured.attained - obstacle_tolerance <= full.checker.margins[way.pair]:
                    return _whole(curve, checker, proven, _stuck(full.checker, way, motion, prove))
        # Pairs of bodies are left out, not owners: other bodies of the same owners are proven all the while.
        apart = {way.pair for way in ways if way.rise.end > first}
        for pair, until in open_until.items():
            apart |= {pair} if until > first else full.parts_of[pair]
        proven.append(prove(_Part.of(curve, first, last), full.checker.without_pairs(apart) if apart else checker))
        if not proven[-1].free:
            return _whole(curve, checker, proven[:-1], proven[-1])
    return _free(curve, checker, proven, ways, obstacle_tolerance)


def _free(
    curve: Curve,
    checker: CollisionChecker,
    proven: Sequence[Certificate],
    ways: Sequence[_Way],
    obstacle_tolerance: float,
) -> Certificate:
    """The certificate of a curve of which every part was proven."""
    touching = [way for way in ways if way.until > float(curve.bezier()[0][0]) or not way.of_facets]
    partings = tuple(
        Parting(way.bodies, read_only(way.rising.normal.copy()), way.gap, way.until, way.rise.end) for way in touching
    )
    clearance, observed = min(c.clearance for c in proven), min(c.observed for c in proven)
    said = "; ".join(
        [free_sentence(clearance, observed, len(checker.pairs), len(checker.excluded)), *map(str, partings)]
    )
    room = [c.tube.largest_obstacles for c in proven if c.tube is not None]
    room += [DEEPEST + way.gap - obstacle_tolerance for way in ways] + [way.room for way in ways]
    tube = MotionTube(read_only(np.zeros(checker.arm.dof)), obstacle_tolerance, 0.0, max(min(room), 0.0))
    whole = _whole(curve, checker, proven[:-1], proven[-1])
    intervals = whole.intervals + sum(way.rise.intervals for way in ways)
    return replace(
        whole, message=said, clearance=clearance, observed=observed, intervals=intervals, tube=tube, partings=partings
    )


class _Motion(NamedTuple):
    """The curve, and how it is to be proven."""

    curve: Curve
    knots: Array
    control: Array
    tolerance: float
    max_intervals: int
    obstacle_tolerance: float

    @property
    def start(self) -> Array:
        point: Array = self.control[0, 0]
        return point

    def follow(self, rising: Rising, enough: float) -> Rise:
        """Go along it for as long as a body rises."""
        return rising.follow(self.knots, self.control, enough, self.tolerance, self.max_intervals)

    def gap(self, rising: Rising, t: float) -> float:
        """The gap (m) at a parameter."""
        return rising.gap(bezier.evaluate(self.knots, self.control, t))


@dataclass(frozen=True, eq=False)
class _Way:
    """One pair of bodies that part: how far it is proven, the gap (m) at the start, and what is to spare at the end."""

    pair: int
    bodies: tuple[str, str]
    rising: Rising
    rise: Rise
    gap: float
    room: float
    of_facets: bool = False

    @property
    def until(self) -> float:
        """From where on the pair is farther apart than its margin; by the ordinary proof, if the gap does not tell."""
        return min(self.rise.until, self.rise.end)


class _Full(NamedTuple):
    """A checker whose pairs hold those asked about, and for exact meshes also their facets near the start."""

    checker: CollisionChecker
    pieces: dict[int, list[_Way]]
    """The ways of the facets of an exact mesh, by the pair of the whole mesh."""
    parts_of: dict[int, set[int]]
    """The pairs of its facets and of the rest of it."""


class _Refused(NamedTuple):
    """A pair that is in contact at the start and may not be: how deep (m), or how near where it does not penetrate."""

    pair: int
    distance: float
    margin: float


@dataclass(frozen=True, eq=False)
class _Split:
    """An exact mesh seen from one body: its facets near the start in groups, and all others."""

    pair: int
    groups: list[FacetGroup]
    bodies: list[Body]
    deepest: float
    """Metres: the gap at the facet that is penetrated deepest."""


def _departures(
    checker: CollisionChecker, pairs: Sequence[int], motion: _Motion
) -> tuple[list[_Way], _Full, _Refused | None]:
    """How each pair parts, and a checker that also knows the facets that are left one by one."""
    convex: list[tuple[int, Rising, Rise, float]] = []
    splits: list[_Split] = []
    for pair in pairs:
        a, b = checker.pairs[pair]
        mover, body = Mover(checker, a), checker.bodies[b]
        mover.move(motion.start)
        enough = float(checker.margins[pair]) + motion.obstacle_tolerance + 2 * checker.rounding
        measured = checker.placed(motion.start).measure(pair)
        tried = _directions(body, checker.at[b], -measured.normal)
        if body.support is None and not isinstance(body.geometry, coal.Halfspace):
            split = _split(checker, pair, mover, tried, enough, motion)
            if split.groups:
                splits.append(split)
            elif (refused := _refuse(checker, pair, measured, motion, split.deepest)) is not None:
                return [], _Full(checker, {}, {}), refused
            continue
        gaps = -mover.reach(-tried) - (levels := Hull.of(body).reach(checker.at[b], tried))
        if gaps.max() - motion.obstacle_tolerance < -DEEPEST:
            if (refused := _refuse(checker, pair, measured, motion, float(gaps.max()))) is not None:
                return [], _Full(checker, {}, {}), refused
            continue  # apart, but around each other: proven as any pair
        rising, rise, gap = _best(mover, tried, levels, gaps, enough, motion)
        convex.append((pair, rising, rise, gap))
    full, places = _with_facets(checker, splits)
    ways = [
        _way(full, full.pairs.index(checker.pairs[pair]), rising, rise, gap, motion)
        for pair, rising, rise, gap in convex
    ]
    pieces, parts = {}, {}
    for split, own in zip(splits, places, strict=True):
        pair = full.pairs.index(checker.pairs[split.pair])
        pieces[pair] = [
            _way(full, k, group.rising, group.rise, group.gap, motion, of_facets=True)
            for k, group in zip(own, split.groups, strict=False)
        ]
        parts[pair] = set(own)
        ways += pieces[pair]
        for k in own[len(split.groups) :]:  # the rest of the mesh
            measured = full.placed(motion.start).measure(k)
            if (refused := _refuse(full, k, measured, motion, split.deepest)) is not None:
                return [], _Full(checker, {}, {}), refused._replace(pair=split.pair)
    return ways, _Full(full, pieces, parts), None


def _way(
    checker: CollisionChecker,
    pair: int,
    rising: Rising,
    rise: Rise,
    gap: float,
    motion: _Motion,
    *,
    of_facets: bool = False,
) -> _Way:
    enough = float(checker.margins[pair]) + motion.obstacle_tolerance + 2 * checker.rounding
    room = motion.gap(rising, rise.end) - enough
    return _Way(pair, _owners(checker, pair), rising, rise, gap, room, of_facets)


def _best(
    mover: Mover, tried: Array, levels: Array, gaps: Array, enough: float, motion: _Motion
) -> tuple[Rising, Rise, float]:
    """The direction along which a body leaves what is convex: of those with the largest gap, then of the others.

    None is tried along which the two overlap by more than they do at the start. Where no direction leads away, the one
    along which the body is proven longest not to approach.
    """
    first = int(np.flatnonzero(gaps >= gaps.max() - mover.rounding)[0])
    least = min(float(gaps.max()), 0.0) - mover.rounding
    others = [k for k in np.argsort(-gaps, kind="stable").tolist() if k != first and gaps[k] >= least]
    best: tuple[Rising, Rise, float] | None = None
    for k in (first, *others):
        rising = Rising(mover, tried[k], float(levels[k]))
        rise = motion.follow(rising, enough)
        if rise.until < np.inf:
            return rising, rise, float(gaps[k])
        if best is None or rise.end > best[1].end:
            best = rising, rise, float(gaps[k])
    return best  # type: ignore[return-value]  # the first was tried


def _directions(body: Body, at: Array, measured: Array) -> Array:
    """(d, 3) ways something may leave, of length 1: the root's z, the obstacle's axes, that of the nearest points."""
    if isinstance(body.geometry, coal.Halfspace):
        return np.array([at[[2, 5, 8]]])
    own = at[:9].reshape(3, 3).T
    return np.array([[0.0, 0.0, 1.0], *own, *-own, *unit_vectors(measured[None])])


def _split(checker: CollisionChecker, pair: int, mover: Mover, tried: Array, enough: float, motion: _Motion) -> _Split:
    """The facets of an exact mesh near which a body starts, and the rest."""
    a, b = checker.pairs[pair]
    body = checker.bodies[b]
    vertices, triangles = facets_of(body)
    at = checker.at[b]
    corners = (vertices @ at[:9].reshape(3, 3).T + at[9:12])[triangles]
    groups, deepest = leave_facets(
        mover,
        checker.bodies[a],
        corners,
        tried,
        reach=enough + NEAR,
        deepest=DEEPEST - motion.obstacle_tolerance,
        follow=lambda rising: motion.follow(rising, enough),
    )
    if not groups:
        return _Split(pair, [], [], deepest)
    name = f"{body.name} near {checker.bodies[a].name}"
    bodies = [facet_body(body, f"{name}, {k}", vertices, triangles[group.facets]) for k, group in enumerate(groups)]
    others = np.setdiff1d(np.arange(len(triangles)), np.concatenate([group.facets for group in groups]))
    if len(others):
        bodies.append(facet_body(body, f"{body.name} away from {checker.bodies[a].name}", vertices, triangles[others]))
    return _Split(pair, groups, bodies, deepest)


def _with_facets(checker: CollisionChecker, splits: Sequence[_Split]) -> tuple[CollisionChecker, list[list[int]]]:
    """A checker that knows the parts of meshes too, and the pairs of each split: those of its groups, then the rest."""
    if not splits:
        return checker, []
    bodies = [body for split in splits for body in split.bodies]
    first, places = len(checker.bodies), []
    for split in splits:
        a = checker.pairs[split.pair][0]
        places.append([(a, first + k) for k in range(len(split.bodies))])
        first += len(split.bodies)
    full = checker.with_obstacle_bodies(bodies, [pair for own in places for pair in own])
    index = {pair: k for k, pair in enumerate(full.pairs)}
    return full, [[index[pair] for pair in own] for own in places]


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


def _refuse(checker: CollisionChecker, pair: int, measured: Distance, motion: _Motion, gap: float) -> _Refused | None:
    """What is wrong with a pair that has no direction to leave along; None if it is farther apart than its margin.

    How deep they overlap is the lesser of coal's depth and the gap (m) along the best direction tried, which of a mesh
    that leaves is that of its hull. Of a mesh that is left, coal knows the depth of any facet, the gap is the deepest.
    """
    margin = float(checker.margins[pair])
    if measured.attained - motion.obstacle_tolerance > margin:
        return None
    leaving, left = (checker.bodies[i] for i in checker.pairs[pair])
    distance = measured.distance
    if distance <= 0 and np.isfinite(gap):
        facets = leaving.support is not None and left.support is None
        distance = min(gap, 0.0) if facets else max(distance, gap)
    return _Refused(pair, distance - motion.obstacle_tolerance, margin)


def _refused(curve: Curve, checker: CollisionChecker, refused: _Refused, prove: Prove) -> Certificate:
    """The verdict on a curve that starts with a contact beyond what ``parting`` allows."""
    first, _ = curve.domain
    found = prove(_Part.of(curve, first, first), checker)
    one, other = _owners(checker, refused.pair)
    if refused.distance < -DEEPEST:
        message = (
            f"{one} starts {-refused.distance * 1e3:.2f} mm deep in {other}; parting allows {DEEPEST * 1e3:g} mm. "
            "Correct one of the poses or shapes"
        )
        return _whole(curve, checker, [], replace(found, message=message))
    message = (
        f"{one} and {other} start {_apart(refused.distance)}, within the margin of {refused.margin * 1e3:g} mm, and no "
        f"direction was found that separates {other} from the convex hull of {one}; give {one} as several convex shapes"
    )
    span = UndecidedSpan(first, first, (one, other), refused.distance)
    undecided = replace(
        found, status=CertificateStatus.UNDECIDED, message=message, first_contact=None, undecided=span,
        clearance=np.nan,
    )  # fmt: skip
    return _whole(curve, checker, [], undecided)


def _apart(distance: float) -> str:
    if distance > 0:
        return f"{distance * 1e3:.2f} mm apart"
    return f"{-distance * 1e3:.2f} mm deep in each other" if distance < -5e-6 else "in contact"


def _stuck(checker: CollisionChecker, way: _Way, motion: _Motion, prove: Prove) -> Certificate:
    """A pair that has not parted where the proof that it does not approach came to its end."""
    curve, knots, control = motion.curve, motion.knots, motion.control
    rise, pair, bodies = way.rise, way.pair, way.bodies
    here = bezier.evaluate(knots, control, rise.end)
    shown = min(rise.stopped, float(knots[-1]))
    there = bezier.evaluate(knots, control, shown)
    measured = checker.placed(there).measure(pair)
    nearer = way.rising.gap(there) < way.rising.gap(here) - checker.rounding
    base = prove(_Part.of(curve, rise.end, rise.end), checker)  # carries what every certificate carries
    touching = measured.attained - motion.obstacle_tolerance <= checker.margins[pair]
    if touching and (nearer or rise.end >= float(knots[-1])):
        contact = checker.contact(pair, measured)
        distance = contact.distance - motion.obstacle_tolerance
        first = FirstContact(shown, there, bodies, distance, contact.points, distance < 0, rise.end)
        how = "comes nearer again" if nearer else "has not left by the end"
        message = f"at {shown:.4g} {bodies[0]} {how}: {contact}; proven not to approach until {rise.end:.4g}"
        return replace(
            base, status=CertificateStatus.COLLIDING, message=message, first_contact=first, undecided=None,
            clearance=np.nan,
        )  # fmt: skip
    along = ", ".join(f"{x:.3g}" for x in way.rising.normal + 0.0)
    message = (
        f"{bodies[0]} is not proven to leave {bodies[1]}, which it touches, at [{rise.end:.6g}, {rise.stopped:.6g}]; "
        f"lift it off along one direction, such as ({along}), before it moves aside"
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
