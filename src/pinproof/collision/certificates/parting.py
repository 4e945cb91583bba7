"""Certificates of motions that begin in contact: an object leaves its support and never approaches it again.

Up to some point of the curve the object is proven not to approach its support, whatever their distance
(``src/core/certificate/departure.h``); after it the ordinary proof applies, with the margin. All other pairs are proven
as usual on the whole curve.
Sliding along the support is therefore not sufficient: the object must separate from it by more than the margin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import coal
import numpy as np

from pinproof._core import Departure, DepartureProof
from pinproof.collision.certificates.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    MotionTube,
    Parting,
    ProofLimits,
    UndecidedSpan,
    curve_hash,
    free_sentence,
    setup_of,
)
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.collision.checking.placed_bodies import Distance
from pinproof.collision.checking.separation import (
    FacetGroup,
    MovingBody,
    distinct,
    facet_body,
    facets_of,
    hull_support,
    leave_facets,
    reach,
    unit_vectors,
)
from pinproof.collision.geometry.bodies import Body
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import Bezier, Curve, CurvePart, parameter_text, read_only
from pinproof.spatial import Array, matrix

DEEPEST = 1e-3
"""Penetration (m) that is allowed at the start: the usual error of measured or taught poses."""

NEAR = 2e-3
"""Distance (m) beyond the margin up to which a facet counts as close at the start. The ordinary proof covers the other
facets, within a few intervals."""

Prove = Callable[[Curve, CollisionChecker], Certificate]


def prove_parting(
    curve: Curve, checker: CollisionChecker, names: Sequence[tuple[str, str]], prove: Prove, limits: ProofLimits
) -> Certificate:
    """Return the certificate of a curve along which pairs of these names separate that may touch at its start.

    ``prove`` is the ordinary certification of a curve with a checker, within ``limits``.
    """
    knots, control = curve.bezier()
    motion = _BodyMotion(curve, knots, control, limits)
    separating_pairs, full, start_contact = _departures(checker, _indices(checker, names), motion)
    if start_contact is not None:
        return _start_contact_verdict(curve, checker, start_contact, prove)
    # The curve is proven in parts, which begin where a pair is not proven to depart any more.
    open_until = {pair: max(separating.proof.end for separating in own) for pair, own in full.pieces.items()}
    ends = np.unique([float(knots[0]), *(separating.proof.end for separating in separating_pairs)]).tolist()
    proven: list[Certificate] = []
    for first, last in zip(ends, [*ends[1:], float(knots[-1])], strict=True):
        separated = [separating for separating in separating_pairs if separating.proof.end == first]
        space = full.checker._placed(Bezier(knots, control).at(first)) if separated else None
        for separating in separated:
            attained = np.inf if space is None else space.measure(separating.pair).attained
            if attained - limits.obstacles <= full.checker.margins[separating.pair]:
                not_separated = _not_separated(full.checker, separating, motion, prove)
                return _on_complete_curve(curve, checker, proven, not_separated)
        # Pairs of bodies are omitted, not of owners: other bodies of the same owners are checked on the whole curve.
        apart = {separating.pair for separating in separating_pairs if separating.proof.end > first}
        for pair, until in open_until.items():
            apart |= {pair} if until > first else full.parts_of[pair]
        proven.append(prove(CurvePart.of(curve, first, last), full.checker.without_pairs(apart) if apart else checker))
        if not proven[-1].free:
            return _on_complete_curve(curve, checker, proven[:-1], proven[-1])
    return _free(curve, checker, proven, separating_pairs, limits.obstacles)


def _free(
    curve: Curve,
    checker: CollisionChecker,
    proven: Sequence[Certificate],
    separating_pairs: Sequence[_SeparatingPair],
    obstacle_tolerance: float,
) -> Certificate:
    """Return the certificate of a curve whose parts are all proven."""
    # Listed are the pairs within their margin after the start; for owners without one, that of the smallest gap.
    touching = [each for each in separating_pairs if each.until > float(curve.bezier()[0][0])]
    named = {each.bodies for each in touching}
    others: dict[tuple[str, str], _SeparatingPair] = {}
    for each in separating_pairs:
        if each.bodies not in named and not each.of_facets:
            known = others.setdefault(each.bodies, each)
            if each.gap < known.gap:
                others[each.bodies] = each
    partings = tuple(
        Parting(each.bodies, read_only(each.departure.normal.copy()), each.gap, each.until, each.proof.end)
        for each in (*touching, *others.values())
    )
    clearance, observed = min(c.clearance for c in proven), min(c.observed for c in proven)
    message = "; ".join([free_sentence(clearance, len(checker.margins), len(checker.excluded)), *map(str, partings)])
    # Obstacles may be displaced as far as the part with the least slack allows.
    slack = [c.tube.largest_obstacles for c in proven if c.tube is not None]
    slack += [min(DEEPEST + each.gap - obstacle_tolerance, each.slack) for each in separating_pairs]
    tube = MotionTube(read_only(np.zeros(checker.group.dof)), obstacle_tolerance, 0.0, max(min(slack), 0.0))
    complete = _on_complete_curve(curve, checker, proven[:-1], proven[-1])
    intervals = complete.intervals + sum(each.proof.intervals for each in separating_pairs)
    return replace(
        complete,
        message=message,
        clearance=clearance,
        observed=observed,
        intervals=intervals,
        tube=tube,
        partings=partings,
    )


class _BodyMotion(NamedTuple):
    """The curve and the settings of the proof."""

    curve: Curve
    knots: Array
    control: Array
    limits: ProofLimits

    def follow(self, departure: Departure, enough: float) -> DepartureProof:
        """Follow the curve while the body is proven not to approach."""
        return departure.follow(self.knots, self.control, enough, self.limits.tolerance, self.limits.max_intervals)

    def gap(self, departure: Departure, t: float) -> float:
        """Return the gap (m) at a parameter."""
        return departure.gap(Bezier(self.knots, self.control).at(t))


@dataclass(frozen=True, eq=False)
class _SeparatingPair:
    """A separating pair of bodies: the proven span, the gap (m) at the start, the excess distance (m) at its end."""

    pair: int
    bodies: tuple[str, str]
    departure: Departure
    proof: DepartureProof
    gap: float
    slack: float
    of_facets: bool = False

    @property
    def until(self) -> float:
        """The parameter after which the distance is larger than the margin, by the gap or by the ordinary proof."""
        return min(self.proof.until, self.proof.end)


class _WithFacets(NamedTuple):
    """A checker with pairs of the facets of meshes close to the start; their separations, by the complete pair."""

    checker: CollisionChecker
    pieces: dict[int, list[_SeparatingPair]]
    parts_of: dict[int, set[int]]  # with the pair of the rest of the mesh


class _StartContact(NamedTuple):
    """A pair whose contact at the start is not allowed, with signed distance (m) and margin (m)."""

    pair: int
    distance: float
    margin: float


@dataclass(frozen=True, eq=False)
class _Split:
    """An exact mesh as seen from one body: groups of facets close to the start, and the remaining facets."""

    pair: int
    groups: list[FacetGroup]
    bodies: list[Body]
    deepest: float  # gap (m) at the facet with the deepest penetration


def _departures(
    checker: CollisionChecker, pairs: Sequence[int], motion: _BodyMotion
) -> tuple[list[_SeparatingPair], _WithFacets, _StartContact | None]:
    """Return how each pair separates, and a checker that also has the facets close to the start."""
    convex: list[tuple[int, Departure, DepartureProof, float]] = []
    splits: list[_Split] = []
    for pair in pairs:
        a, b = checker.indices_of(pair)
        moving, body = MovingBody(checker, a), checker.bodies[b]
        moving.move(motion.control[0, 0])
        enough = float(checker.margins[pair]) + motion.limits.obstacles + 2 * checker.rounding
        measured = checker._placed(motion.control[0, 0]).measure(pair)
        # The directions that are tried: z of the root, the axes of the obstacle, the line of the nearest points.
        axes = matrix(body.link_from_body)[:3, :3].T
        tried = distinct(np.array([[0.0, 0.0, 1.0], *axes, *-axes, *unit_vectors(-measured.normal[None])]))
        tried = axes[2:] if isinstance(body.geometry, coal.Halfspace) else tried
        if body.support is None and not isinstance(body.geometry, coal.Halfspace):
            # Farther away than any facet that counts as close, it is an ordinary pair.
            if measured.proven > enough + NEAR:
                continue
            split = _split(checker, pair, moving, tried, enough, motion)
            if split.groups:
                splits.append(split)
            elif (start_contact := _find_start_contact(checker, pair, measured, motion, split.deepest)) is not None:
                return [], _WithFacets(checker, {}, {}), start_contact
            continue
        gaps = -moving.reach(-tried) - (levels := reach(hull_support(body), matrix(body.link_from_body), tried))
        if gaps.max() - motion.limits.obstacles < -DEEPEST:
            if (start_contact := _find_start_contact(checker, pair, measured, motion, float(gaps.max()))) is not None:
                return [], _WithFacets(checker, {}, {}), start_contact
            continue  # apart but interlocked: proven as an ordinary pair
        departure, proof, gap = _best(moving, tried, levels, gaps, enough, motion)
        convex.append((pair, departure, proof, gap))
    # A checker with the parts of meshes, and the pairs of each split: its groups first, then the rest.
    full, ranges, first = checker, list[list[tuple[int, int]]](), len(checker.bodies)
    if splits:
        for split in splits:
            a = checker.indices_of(split.pair)[0]
            ranges.append([(a, first + k) for k in range(len(split.bodies))])
            first += len(split.bodies)
        bodies = [body for split in splits for body in split.bodies]
        full = checker._with_obstacle_bodies(bodies, [pair for own in ranges for pair in own])
    index = {pair: k for k, pair in enumerate(full.pairs)} if splits or convex else {}
    places = [[index[pair] for pair in own] for own in ranges]
    separating_pairs = [
        _separating_pair(full, index[checker.pairs[pair]], departure, proof, gap, motion)
        for pair, departure, proof, gap in convex
    ]
    pieces, parts = {}, {}
    for split, own in zip(splits, places, strict=True):
        pair = index[checker.pairs[split.pair]]
        pieces[pair] = [
            _separating_pair(full, k, group.departure, group.proof, group.gap, motion, of_facets=True)
            for k, group in zip(own, split.groups, strict=False)
        ]
        parts[pair] = set(own)
        separating_pairs += pieces[pair]
        for k in own[len(split.groups) :]:  # the rest of the mesh
            measured = full._placed(motion.control[0, 0]).measure(k)
            if (start_contact := _find_start_contact(full, k, measured, motion, split.deepest)) is not None:
                return [], _WithFacets(checker, {}, {}), start_contact._replace(pair=split.pair)
    return separating_pairs, _WithFacets(full, pieces, parts), None


def _separating_pair(
    checker: CollisionChecker,
    pair: int,
    departure: Departure,
    proof: DepartureProof,
    gap: float,
    motion: _BodyMotion,
    *,
    of_facets: bool = False,
) -> _SeparatingPair:
    enough = float(checker.margins[pair]) + motion.limits.obstacles + 2 * checker.rounding
    slack = motion.gap(departure, proof.end) - enough
    return _SeparatingPair(pair, checker.owners(pair), departure, proof, gap, slack, of_facets)


def _best(
    moving: MovingBody, tried: Array, levels: Array, gaps: Array, enough: float, motion: _BodyMotion
) -> tuple[Departure, DepartureProof, float]:
    """Return the direction along which a body separates from a convex obstacle; directions with a large gap come first.

    Directions along which the two overlap more than at the start are not tried. If no direction separates them, the one
    with the longest span in which the body is proven not to approach is returned.
    """
    first = int(np.flatnonzero(gaps >= gaps.max() - moving.rounding)[0])
    least = min(float(gaps.max()), 0.0) - moving.rounding
    others = [k for k in np.argsort(-gaps, kind="stable").tolist() if k != first and gaps[k] >= least]
    best: tuple[Departure, DepartureProof, float] | None = None
    for k in (first, *others):
        departure = moving.departure(tried[k], float(levels[k]))
        proof = motion.follow(departure, enough)
        if proof.until < np.inf:
            return departure, proof, float(gaps[k])
        if best is None or proof.end > best[1].end:
            best = departure, proof, float(gaps[k])
    return best  # type: ignore[return-value]  # the first was tried


def _split(
    checker: CollisionChecker, pair: int, moving: MovingBody, tried: Array, enough: float, motion: _BodyMotion
) -> _Split:
    """Split an exact mesh into the facets close to the start of a body and the rest."""
    a, b = checker.indices_of(pair)
    body = checker.bodies[b]
    vertices, triangles = facets_of(body)
    at = matrix(body.link_from_body)
    corners = (vertices @ at[:3, :3].T + at[:3, 3])[triangles]
    # Groups of facets from which the body separates; the others are an obstacle of their own.
    groups, deepest = leave_facets(
        moving,
        checker.bodies[a],
        corners,
        tried,
        reach=enough + NEAR,
        deepest=DEEPEST - motion.limits.obstacles,
        follow=lambda departure: motion.follow(departure, enough),
    )
    if not groups:
        return _Split(pair, [], [], deepest)
    name = f"{body.name} near {checker.bodies[a].name}"
    bodies = [facet_body(body, f"{name}, {k}", group.facets) for k, group in enumerate(groups)]
    others = np.setdiff1d(np.arange(len(triangles)), np.concatenate([group.facets for group in groups]))
    if len(others):
        bodies.append(facet_body(body, f"{body.name} away from {checker.bodies[a].name}", others))
    return _Split(pair, groups, bodies, deepest)


def _indices(checker: CollisionChecker, names: Sequence[tuple[str, str]]) -> list[int]:
    """Return the indices of the pairs of bodies with these names."""
    known, found = checker.obstacles_and_links, []
    for stated in names:
        if isinstance(stated, str) or len(stated) != 2:
            raise InputError(f"parting: {stated!r} is not a pair of names")
        one, other = stated
        for name in (one, other):
            if name not in known:
                raise UnknownNameError("body", name, known, "parting")
        # A pair is an obstacle and a body that moves, which are checked against each other.
        if (one in checker.scene) == (other in checker.scene):
            raise InputError(f"parting: {one!r} and {other!r}; one must be an obstacle, the other a link or attached")
        meant = checker.pairs_of_owners(one, other)
        if not meant:
            raise InputError(
                f"parting: {one!r} and {other!r} are not checked against each other, so parting does not apply to them"
            )
        found += meant
    return list(dict.fromkeys(found))


def _find_start_contact(
    checker: CollisionChecker, pair: int, measured: Distance, motion: _BodyMotion, gap: float
) -> _StartContact | None:
    """Return the refusal of a pair without a separating direction; None if its distance is larger than the margin."""
    margin = float(checker.margins[pair])
    if measured.attained - motion.limits.obstacles > margin:
        return None
    leaving, left = (checker.bodies[i] for i in checker.indices_of(pair))
    # The penetration is the smaller of coal's depth and the gap along the best direction, which for a moving mesh is
    # that of its hull. For an obstacle mesh, coal returns the depth at some facet; the gap is that of the deepest one.
    distance = measured.distance
    if distance <= 0 and np.isfinite(gap):
        facets = leaving.support is not None and left.support is None
        distance = min(gap, 0.0) if facets else max(distance, gap)
    return _StartContact(pair, distance - motion.limits.obstacles, margin)


def _start_contact_verdict(
    curve: Curve, checker: CollisionChecker, start_contact: _StartContact, prove: Prove
) -> Certificate:
    """Return the verdict on a curve that starts with a contact that ``parting`` does not allow."""
    first, _ = curve.domain
    found = prove(CurvePart.of(curve, first, first), checker)
    one, other = checker.owners(start_contact.pair)
    if start_contact.distance < -DEEPEST:
        message = (
            f"{one} penetrates {other} by {-start_contact.distance * 1e3:.2f} mm at the start; parting allows "
            f"{DEEPEST * 1e3:g} mm. Correct one of the poses or shapes"
        )
        return _on_complete_curve(curve, checker, [], replace(found, message=message))
    distance = start_contact.distance
    how = f"{distance * 1e3:.2f} mm apart" if distance > 0 else "in contact"
    how = f"{-distance * 1e3:.2f} mm in penetration" if distance < -5e-6 else how
    message = (
        f"{one} and {other} are {how} at the start (margin "
        f"{start_contact.margin * 1e3:g} mm), and no direction separates {other} from the convex hull of {one}; "
        f"model {one} by several convex shapes"
    )
    # The bodies overlap by no more than is allowed, but no direction separates them.
    span = UndecidedSpan(first, first, (one, other), distance)
    return _on_complete_curve(curve, checker, [], _undecided(found, message, span))


def _not_separated(
    checker: CollisionChecker, separating: _SeparatingPair, motion: _BodyMotion, prove: Prove
) -> Certificate:
    """Return the verdict on a pair that has not separated at the end of the span in which it does not approach."""
    curve, knots, control = motion.curve, motion.knots, motion.control
    proof, pair, bodies = separating.proof, separating.pair, separating.bodies
    here = Bezier(knots, control).at(proof.end)
    shown = min(proof.stopped, float(knots[-1]))
    there = Bezier(knots, control).at(shown)
    # It is in contact where it approaches again or ends; before, it is undecided whether it has left.
    measured = checker._placed(there).measure(pair)
    nearer = separating.departure.gap(there) < separating.departure.gap(here) - checker.rounding
    base = prove(CurvePart.of(curve, proof.end, proof.end), checker)  # for the common fields of certificates
    touching = measured.attained - motion.limits.obstacles <= checker.margins[pair]
    if touching and (nearer or proof.end >= float(knots[-1])):
        contact = checker._contact(pair, measured)
        distance = contact.distance - motion.limits.obstacles
        first = FirstContact(shown, there, bodies, distance, contact.points, distance < 0, proof.end)
        how = "approaches again" if nearer else "does not depart before the end"
        at, until = (parameter_text(curve, t) for t in (shown, proof.end))
        message = f"{contact} at {at}: {bodies[0]} {how}; it is proven not to approach until {until}"
        return replace(
            base, status=CertificateStatus.COLLIDING, message=message, first_contact=first, undecided=None,
            clearance=np.nan,
        )  # fmt: skip
    along = ", ".join(f"{x:.3g}" for x in separating.departure.normal + 0.0)
    message = (
        f"{bodies[0]} is not proven to leave {bodies[1]}, which it touches, at [{proof.end:.6g}, {proof.stopped:.6g}]; "
        f"move it off along one direction, such as ({along}), before moving it sideways"
    )
    return _undecided(base, message, UndecidedSpan(proof.end, proof.stopped, bodies, measured.distance))


def _undecided(certificate: Certificate, message: str, span: UndecidedSpan) -> Certificate:
    status = CertificateStatus.UNDECIDED
    return replace(certificate, status=status, message=message, first_contact=None, undecided=span, clearance=np.nan)


def _on_complete_curve(
    curve: Curve, checker: CollisionChecker, before: Sequence[Certificate], last: Certificate
) -> Certificate:
    """Return the verdict ``last`` on a part, which follows proven parts, as the verdict on the complete curve."""
    setup = setup_of(checker)
    return replace(
        last,
        observed=min(certificate.observed for certificate in (*before, last)),
        intervals=sum(certificate.intervals for certificate in (*before, last)),
        pairs=len(checker.margins),
        excluded=tuple(checker.excluded),
        curve=curve_hash(curve),
        setup=setup.hash,
        notes=setup.notes,
    )
