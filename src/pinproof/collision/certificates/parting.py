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

import numpy as np

from pinproof._core import Departure, SeparatingGroup, SeparationSettings
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
from pinproof.collision.checking.separation import Indices, facet_body, separations
from pinproof.collision.geometry.bodies import Body
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import Bezier, Curve, CurvePart, parameter_text, read_only

DEEPEST = 1e-3
"""Penetration (m) that is allowed at the start: the usual error of measured or taught poses."""

NEAR = 2e-3
"""Distance (m) beyond the margin up to which a pair, or a facet of a mesh, counts as close at the start. The ordinary
proof covers the others, within a few intervals."""

Prove = Callable[[Curve, CollisionChecker], Certificate]


def prove_parting(
    curve: Curve, checker: CollisionChecker, names: Sequence[tuple[str, str]], prove: Prove, limits: ProofLimits
) -> Certificate:
    """Return the certificate of a curve along which pairs of these names separate that may touch at its start.

    ``prove`` is the ordinary certification of a curve with a checker, within ``limits``.
    """
    knots, control = (np.ascontiguousarray(part) for part in curve.bezier())
    motion = _BodyMotion(curve, Bezier(knots, control), limits)
    checker = checker._with_facets_of(name for pair in names for name in pair)
    separating_pairs, full, start_contact = _departures(checker, _indices(checker, names), motion)
    if start_contact is not None:
        return _start_contact_verdict(curve, checker, start_contact, prove)
    # The curve is proven in parts, which begin where a pair is not proven to depart any more.
    open_until = {pair: max(separating.end for separating in own) for pair, own in full.pieces.items()}
    ends = np.unique([float(knots[0]), *(separating.end for separating in separating_pairs)]).tolist()
    proven: list[Certificate] = []
    for first, last in zip(ends, [*ends[1:], float(knots[-1])], strict=True):
        for separating in separating_pairs:
            # Pairs whose gap is as large as required have separated; the others may have, in another direction.
            if separating.end == first and separating.group.slack <= 0:
                measured = full.checker._placed(motion.bezier.at(first)).measure(separating.pair)
                if measured.attained - limits.obstacles <= full.checker.margins[separating.pair]:
                    not_separated = _not_separated(full.checker, separating, motion, prove)
                    return _on_complete_curve(curve, checker, proven, not_separated)
        # Pairs of bodies are omitted, not of owners: other bodies of the same owners are checked on the whole curve.
        apart = {separating.pair for separating in separating_pairs if separating.end > first}
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
            if each.group.gap < known.group.gap:
                others[each.bodies] = each
    length = None if hasattr(curve, "duration") else float(curve.domain[1])
    partings = tuple(
        Parting(each.bodies, read_only(each.group.normal), each.group.gap, each.until, each.end, length)
        for each in (*touching, *others.values())
    )
    clearance, observed = min(c.clearance for c in proven), min(c.observed for c in proven)
    # A body leaves many facets of a mesh; the message describes the one that it leaves last.
    last = {each.bodies: each for each in sorted(partings, key=lambda parting: parting.until)}
    described = [str(each) for each in partings if last[each.bodies] is each]
    message = "; ".join([free_sentence(clearance, len(checker.margins), len(checker.excluded)), *described])
    # Obstacles may be displaced as far as the part with the least slack allows.
    slack = [c.tube.largest_obstacles for c in proven if c.tube is not None]
    slack += [min(DEEPEST + each.group.gap - obstacle_tolerance, each.group.slack) for each in separating_pairs]
    tube = MotionTube(read_only(np.zeros(checker.group.dof)), obstacle_tolerance, 0.0, max(min(slack), 0.0))
    complete = _on_complete_curve(curve, checker, proven[:-1], proven[-1])
    intervals = complete.intervals + sum(each.group.proof.intervals for each in separating_pairs)
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
    bezier: Bezier
    limits: ProofLimits


@dataclass(frozen=True, eq=False)
class _SeparatingPair:
    """A pair of bodies that separate along one direction, from the start of the curve until ``end``."""

    pair: int
    bodies: tuple[str, str]
    group: SeparatingGroup
    end: float
    until: float  # after it the distance is larger than the margin, by the gap or by the ordinary proof
    of_facets: bool

    @classmethod
    def of(cls, pair: int, bodies: tuple[str, str], group: SeparatingGroup, *, of_facets: bool) -> _SeparatingPair:
        proof = group.proof
        return cls(pair, bodies, group, proof.end, min(proof.until, proof.end), of_facets)


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


def _departures(
    checker: CollisionChecker, pairs: Sequence[Indices], motion: _BodyMotion
) -> tuple[list[_SeparatingPair], _WithFacets, _StartContact | None]:
    """Return how each pair separates, and a checker that also has the facets close to the start."""
    limits, start = motion.limits, motion.bezier.control[0, 0]
    settings = SeparationSettings(NEAR, DEEPEST, limits.obstacles, limits.tolerance, limits.max_intervals)
    every = np.array(list(dict.fromkeys(np.concatenate(pairs).tolist())))
    bodies_of = dict(zip(every.tolist(), checker._pairs[every].tolist(), strict=True))
    found = dict(zip(every.tolist(), separations(checker, every, motion.bezier, settings), strict=True))
    for of_names in pairs:
        if all(found[k].far for k in of_names.tolist()) and checker.convex[of_names].any():
            # The verdict on bodies that do not touch states the gap of the closest pair.
            convex, space = of_names[checker.convex[of_names]].tolist(), checker._placed(start)
            nearest = np.array([min(convex, key=lambda k: space.measure(k).proven)])
            at_any = SeparationSettings(np.inf, DEEPEST, limits.obstacles, limits.tolerance, limits.max_intervals)
            (found[int(nearest[0])],) = separations(checker, nearest, motion.bezier, at_any)
    # The groups of facets from which bodies separate, and the rest of their meshes, are obstacles of their own.
    bodies: dict[tuple[int, bytes], tuple[int, Body]] = {}
    groups: dict[int, list[SeparatingGroup]] = {}
    parts: dict[int, list[int]] = {}  # of the meshes that are split: the new bodies, groups first
    for pair, each in found.items():
        if each.far:
            continue
        if not (own := each.groups):
            contact = _find_start_contact(checker, pair, pair, motion, each.gap)
            if contact is not None:
                return [], _WithFacets(checker, {}, {}), contact
            continue  # apart but interlocked: proven as an ordinary pair
        groups[pair] = own
        facets = [group.facets for group in own]
        if len(facets[0]):
            b, rest = bodies_of[pair][1], each.rest
            mesh, parts[pair] = checker.bodies[b], []
            for some in (*facets, *([rest] if len(rest) else [])):
                key, number = (b, some.tobytes()), len(checker.bodies) + len(bodies)
                if key not in bodies:
                    bodies[key] = number, facet_body(mesh, f"{mesh.name}, facets {number}", some)
                parts[pair].append(bodies[key][0])
    full, old, new = checker, np.arange(len(checker.margins)), dict[tuple[int, int], int]()
    if parts:
        added = sorted((bodies_of[pair][0], body) for pair, those in parts.items() for body in those)
        full, old, places = checker._with_obstacle_bodies([body for _, body in bodies.values()], np.array(added))
        new = dict(zip(added, places.tolist(), strict=True))
    separating: list[_SeparatingPair] = []
    pieces, parts_of = {}, {}
    for pair, own in groups.items():
        place, owners = int(old[pair]), checker.owners(pair)
        if pair not in parts:
            separating.append(_SeparatingPair.of(place, owners, own[0], of_facets=False))
            continue
        split = [new[bodies_of[pair][0], body] for body in parts[pair]]
        pieces[place] = [
            _SeparatingPair.of(k, owners, group, of_facets=True) for k, group in zip(split, own, strict=False)
        ]
        parts_of[place] = set(split)
        separating += pieces[place]
        for k in split[len(own) :] if not found[pair].complete else ():  # a close facet is in the rest of the mesh
            contact = _find_start_contact(full, k, pair, motion, found[pair].gap)
            if contact is not None:
                return [], _WithFacets(checker, {}, {}), contact
    return separating, _WithFacets(full, pieces, parts_of), None


def _indices(checker: CollisionChecker, names: Sequence[tuple[str, str]]) -> list[Indices]:
    """Return the indices of the pairs of bodies with each pair of names."""
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
        found.append(np.array(meant))
    return found


def _find_start_contact(
    checker: CollisionChecker, pair: int, complete: int, motion: _BodyMotion, gap: float
) -> _StartContact | None:
    """Return the refusal of a pair without a separating direction; None if its distance is larger than the margin.

    ``complete`` is the pair of the complete bodies, if the pair is that of facets.
    """
    measured = checker._placed(motion.bezier.control[0, 0]).measure(pair)
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
    return _StartContact(complete, distance - motion.limits.obstacles, margin)


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
    curve, knots, group, bodies = motion.curve, motion.bezier.knots, separating.group, separating.bodies
    proof, pair = group.proof, separating.pair
    shown = min(proof.stopped, float(knots[-1]))
    here, there = (np.ascontiguousarray(motion.bezier.at(t)) for t in (proof.end, shown))
    # It is in contact where it approaches again or ends; before, it is undecided whether it has left.
    measured = checker._placed(there).measure(pair)
    departure = Departure(checker.world, checker.indices_of(pair)[0], group.normal, group.level)
    nearer = departure.gap(there) < departure.gap(here) - checker.rounding
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
    along = ", ".join(f"{x:.3g}" for x in group.normal + 0.0)
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
