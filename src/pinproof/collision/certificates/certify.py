"""Certification of a whole curve: proven collision-free between samples too, not sampled.

The curve is bisected into intervals in path order. In each interval, the distance of every pair at the middle is
compared with an upper bound of the approach of the pair within the interval (``src/core/certificate/motion_bounds.h``).
Pairs that are proven apart are dropped; the others are passed to both halves. A contact at a middle ends the search to
its right; the search to its left continues until everything before the contact is proven collision-free or the
tolerance is reached. The loop is compiled (``src/core/certificate/curve_proof.h``); for bodies without a support
function it calls coal. Constraints of the tcp are proven in the same way: the error at the middle is compared with an
upper bound of its growth (``src/core/certificate/path_constraint.h``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from pinproof._core import ConstraintSettings, ProofSettings, ProofState, prove, prove_constraint
from pinproof.collision.certificates.certificate import (
    Certificate,
    CertificateStatus,
    FirstContact,
    MotionTube,
    ProofLimits,
    Setup,
    UndecidedSpan,
    changes_since,
    curve_hash,
    free_sentence,
    setup_of,
)
from pinproof.collision.certificates.parting import prove_parting
from pinproof.collision.certificates.path_constraints import (
    ConstraintProof,
    ConstraintViolation,
    PathConstraint,
    UndecidedConstraint,
    amount,
    check_constraints,
)
from pinproof.collision.checking.checker import CollisionChecker, Contact, require_curve
from pinproof.collision.checking.movers import Mover, with_movers
from pinproof.collision.checking.placed_bodies import Distance
from pinproof.common.validation import require_type
from pinproof.errors import InputError
from pinproof.model import JointGroup, JointLimits
from pinproof.motion import (
    Curve,
    LimitCheck,
    LimitViolation,
    Motion,
    SampledMotion,
    SpeedBound,
    TimedCurvePart,
    Trajectory,
    check_limits,
    parameter_text,
    read_only,
)
from pinproof.spatial import Array, finite

RESOLUTION = 1e-6
"""rad or m: an interval in which the tcp moves less is not bisected further; the smallest tolerance of a constraint."""

SAMPLES = 50
"""Number of configurations of a curve that violates a constraint at which its error is computed for the message."""


def with_constraints(
    certificate: Certificate,
    curve: Curve,
    group: JointGroup,
    constraints: Sequence[PathConstraint],
    limits: ProofLimits,
) -> Certificate:
    """Return a certificate of collisions with the proofs of constraints on the same curve of a joint group."""
    settings = ConstraintSettings(
        resolution=limits.tolerance,
        max_intervals=limits.max_intervals,
        goal_share=GOAL_SHARE,
        look_ahead=LOOK_AHEAD,
        record=limits.record,
    )
    knots, control = (np.ascontiguousarray(part) for part in curve.bezier())
    proofs: list[ConstraintProof] = []
    violations: list[ConstraintViolation] = []
    undecided: list[UndecidedConstraint] = []
    # Each constraint is proven, violated, or undecided on a span.
    for each in constraints:
        state = prove_constraint(each.chain(group), each.compiled(), knots, control, settings, limits.joints)
        observed = float(state.observed)
        if state.violation is not None:  # samples show by how much the constraint is violated
            samples = curve(np.linspace(*curve.domain, SAMPLES))
            observed = max(observed, *(each.error(group, q) for q in samples))
        largest = float(state.proven) if state.satisfied else np.nan
        evidence = read_only(state.evidence) if limits.record else None
        proofs.append(ConstraintProof(each, largest, observed, int(state.intervals), evidence))
        if state.violation is not None:
            found, until = state.violation, state.violation.time if state.open is None else state.open.start
            violations.append(ConstraintViolation(each, found.time, np.array(found.q), found.error, until))
        elif state.open is not None:
            undecided.append(UndecidedConstraint(state.open.start, state.open.end, each, state.open.error))
    # The violation and the undecided span that come first are reported.
    violation = min(violations, key=lambda each: each.time, default=None)
    span = min(undecided, key=lambda each: each.start, default=None)
    # The status of both proofs together, and its sentence. A contact is reported before a violation.
    status, own = certificate.status, certificate.message
    if violation is not None:
        constraint = violation.constraint
        worst = max(proof.observed for proof in proofs if proof.constraint is constraint)
        words = (
            f"{constraint} is violated from {parameter_text(curve, violation.time)}: an error of "
            f"{amount(constraint, worst)} is reached, {amount(constraint, worst - constraint.tolerance)} too much"
        )
        if status is CertificateStatus.COLLIDING:
            message = f"{own}; also, {words}"
        else:
            message = f"{words}; {'' if status is CertificateStatus.FREE else 'collisions: '}{own}"
            status = CertificateStatus.VIOLATED
    elif span is not None:
        limit = "max_intervals" if any(each.intervals >= limits.max_intervals for each in proofs) else "the tolerance"
        words = (
            f"{span.constraint} is neither proven nor violated on [{span.start:.6g}, {span.end:.6g}]: the error is "
            f"{amount(span.constraint, span.error)} there, and {limit} of the proof was reached; keep the motion "
            "farther from the limit of the constraint"
        )
        message = f"{words}; {own}" if status is CertificateStatus.FREE else f"{own}; also, {words}"
        status = CertificateStatus.UNDECIDED if status is CertificateStatus.FREE else status
    else:
        message = "; ".join([own, *map(str, proofs)])
    combined = replace(
        certificate,
        status=status,
        message=message,
        constraints=tuple(proofs),
        violation=violation,
        undecided_constraint=span,
    )
    return combined if status is CertificateStatus.FREE else _without_proof(combined)


def with_limits(certificate: Certificate, check: LimitCheck | None) -> Certificate:
    """Return a certificate with the comparison of its curve with joint limits; without one, a note states that.

    A contact is reported before a violation, and a violation before what is undecided.
    """
    if check is None:
        return replace(certificate, notes=(*certificate.notes, "joint limits were not compared (limits=None)"))
    if not check.violations:
        message = f"{certificate.message}; {check}" if certificate.free else certificate.message
        return replace(certificate, limits=check, message=message)
    first = min((*check.violations, *([certificate.violation] if certificate.violation else [])), key=lambda v: v.time)
    certificate = replace(certificate, limits=check, violation=first)
    if certificate.status is CertificateStatus.COLLIDING:
        return replace(certificate, message=f"{certificate.message}; also, {check}")
    before = "collisions: " if certificate.status is CertificateStatus.UNDECIDED else ""
    message = f"{check}; {before}{certificate.message}"
    return _without_proof(replace(certificate, status=CertificateStatus.VIOLATED, message=message))


def _without_proof(certificate: Certificate) -> Certificate:
    """Return a certificate that is not FREE without the figures that only a proof has."""
    tube = certificate.tube
    if tube is not None:
        tube = replace(tube, largest_joints=np.nan, largest_obstacles=np.nan)
    return replace(certificate, clearance=np.nan, tube=tube)


GOAL_SHARE = 0.5
"""A pair is dropped once this share of the smallest distance found so far is proven, so that the bound is useful; for a
constraint, the share of the difference of the tolerance and the largest error found so far."""

LOOK_AHEAD = 200
"""Number of intervals that are searched for a contact or a violation behind an undecided span, which is preferred."""

TOLERANCE = 1e-4
"""Metres: a hundredth of a usual clearance; an interval in which bodies move less is not bisected further."""

TOLERANCES = (TOLERANCE, 1e-5, 1e-6)
"""Metres: a curve that is UNDECIDED at one tolerance is certified again with the next. A path that was proven with a
small clearance may need it after timing, because its pieces are then bisected at other parameters. The cost is a few
bisections of each open span; below 1e-6 m the tolerance of coal's distances, 2e-6 m, dominates."""

KNOWN_NOTHING = ProofState()

QUICK_INTERVALS = 2000
"""Number of intervals after which a quick proof fails: about 100 times those of a short edge in free space."""


DEVIATIONS = tuple(0.03 / 3**i for i in range(6))
"""rad or m: a function of the time is certified with all configurations within this of the lines between its samples,
and with more samples while that proves nothing; the last one moves bodies about as far as :data:`TOLERANCE`."""


def certify(
    curve: Curve | Motion,
    checker: CollisionChecker,
    *,
    domain: tuple[float, float] | None = None,
    speed_bound: SpeedBound | None = None,
    tolerance: float | None = None,
    max_intervals: int = 200_000,
    joint_tolerance: npt.ArrayLike = 0.0,
    obstacle_tolerance: float = 0.0,
    parting: Sequence[tuple[str, str]] = (),
    constraints: Sequence[PathConstraint] = (),
    movers: Sequence[Mover | Trajectory] = (),
    limits: JointLimits | Literal["arm"] | None = "arm",
    record: bool = False,
) -> Certificate:
    """Prove that a curve is collision-free and within its limits and constraints, or find where it is not.

    Parameters
    ----------
    curve
        A :class:`~pinproof.JointPath`, :class:`~pinproof.motion.CubicPath`, :class:`~pinproof.Trajectory` or another
        :class:`~pinproof.motion.Curve`; a spline of SciPy over the time in seconds (``BSpline``, ``PPoly``,
        ``CubicSpline``, ``BPoly``); or any function that returns the configuration (n,) at a time (s).
    checker
        Defines the checked bodies and pairs, and their margins.
    domain, speed_bound
        Of a function only: its first and last time (s), and a bound of the speed of its joints in rad/s or m/s, (n,) or
        one for all, or a function that returns it for an interval from one time to another. The certificate is that of
        the polyline through samples with a tube that contains the function if it keeps the bound. The bound is trusted,
        which a note states; samples that violate it are refused.
    tolerance
        Metres. An interval in which no body moves farther than this towards another is not bisected further, so a curve
        whose clearance beyond the margin is smaller may be UNDECIDED. Default: 1e-4, then 1e-5 and 1e-6 while the
        verdict is UNDECIDED; :attr:`Certificate.tolerance` is the last one used.
    max_intervals
        Maximum number of intervals for each tolerance; the verdict is UNDECIDED when it is reached.
    joint_tolerance
        rad or m, one number or (n,): the proof also covers every configuration that differs from one on the curve by no
        more than this in each joint, such as the tracking error of a controller.
    obstacle_tolerance
        Metres: the proof also covers obstacles that are displaced, rotated or enlarged, if no point of their surface
        moves farther than this.
    parting
        Pairs of names, each of a link or attached object and an obstacle, that may touch at the start, such as a part
        and its support. It is proven that the two do not approach each other until they have separated, and that they
        keep their margin afterwards; :meth:`CollisionChecker.allowing` would exclude the pair instead. Cannot be
        combined with ``joint_tolerance`` or ``record``.
    constraints
        :class:`~pinproof.Upright`, :class:`~pinproof.Within` or :class:`~pinproof.collision.LookAt`: conditions of the
        tcp that must hold over the whole curve too.
    movers
        :class:`~pinproof.Mover` for obstacles that move with time, such as parts on a conveyor, and trajectories of
        other joints of the robot, such as those of another arm of a cell. The certificate is then one of the motion of
        all of them, which :func:`pinproof.collision.with_movers` returns, over space and time.
    limits
        The limits of position, velocity and acceleration that a FREE motion keeps (a path: of position), by default
        those of the arm of the checker, and for joints of ``movers`` those of the robot's description. Accelerations of
        the arm that are default values are not compared, see :func:`pinproof.motion.check_limits`. They hold for the
        curve itself, without ``joint_tolerance``. None: limits are not compared, which the certificate states in its
        notes.
    record
        Store the evidence in :attr:`Certificate.evidence`, which :meth:`Certificate.save` needs.

    Returns
    -------
    Certificate
        FREE, COLLIDING, VIOLATED or UNDECIDED. FREE is always proven. COLLIDING is a contact at a configuration on the
        curve itself; its distance is reduced by ``obstacle_tolerance``. VIOLATED is a limit or a constraint that the
        curve does not keep.

    Raises
    ------
    InputError
        If the curve's joints are not the arm's, a setting is invalid, or an array of the checker was modified in place.
    UnknownNameError
        If ``parting`` names an unknown body.
    """
    require_type("checker", checker, CollisionChecker)
    # A motion of another kind is certified as a curve.
    if not hasattr(curve, "bezier"):
        again = partial(
            certify, checker=checker, tolerance=tolerance, max_intervals=max_intervals, parting=parting,
            obstacle_tolerance=obstacle_tolerance, constraints=constraints, movers=movers, record=record,
        )  # fmt: skip
        return _certify_motion(curve, checker, again, domain, speed_bound, max_intervals, joint_tolerance, limits)
    if domain is not None or speed_bound is not None:
        raise InputError("domain and speed_bound are for a function of the time; a curve has its own")
    whole = checked_curve = cast("Curve", curve)
    # The settings, each by itself: budgets, the tolerance of each joint, limits.
    if (tolerance is not None and not tolerance > 0) or max_intervals < 1:
        raise InputError(f"tolerance = {tolerance} must be above 0 m and max_intervals = {max_intervals} at least 1")
    require_curve(whole, checker)
    joints = np.zeros(checker.group.dof)
    if not (isinstance(joint_tolerance, float) and joint_tolerance == obstacle_tolerance == 0.0):
        each = np.full(len(joints), joint_tolerance) if np.ndim(joint_tolerance) == 0 else joint_tolerance
        joints = finite("joint_tolerance", each, joints.shape)
        if (joints < 0).any() or not 0 <= obstacle_tolerance < np.inf:
            raise InputError(
                f"joint_tolerance = {joint_tolerance!r} and obstacle_tolerance = {obstacle_tolerance}; both are 0 or "
                "more"
            )
    if limits is not None and not isinstance(limits, JointLimits) and limits != "arm":
        raise InputError(f"limits must be JointLimits, 'arm' or None, not {limits!r:.80}")
    own_limits = checker.group.limits if limits == "arm" else limits
    # What cannot be combined is refused. Movers are further joints of a larger group, whose motion is then proven.
    if parting and (joints.any() or record):
        raise InputError("parting cannot be combined with joint_tolerance or record")
    constraints, group = check_constraints(constraints), checker.group
    checker._refuse_changes()
    if movers:
        if parting or obstacle_tolerance:
            raise InputError("movers cannot be combined with parting or obstacle_tolerance; Mover has a tolerance")
        whole, checker, of_movers = with_movers(whole, checker, movers)
        joints = np.concatenate([joints, np.zeros(len(of_movers) - len(joints))]) + of_movers
        if own_limits is not None:  # those of the movers follow; a moving obstacle has none
            rest = checker.group.limits.select(range(group.dof, checker.group.dof))
            own_limits = JointLimits.join([own_limits, rest])
    # The curve is compared with the limits first, and proven at finer and finer tolerances.
    within = None if own_limits is None else check_limits(whole, own_limits)
    tolerances = TOLERANCES if tolerance is None else (tolerance,)
    settings = ProofLimits(tolerances, max_intervals, joints, float(obstacle_tolerance), record)

    def certified(each: ProofLimits) -> Certificate:
        if not parting:
            return _CurveProof(whole, checker, each, constraints).run()
        unnamed = "", Setup("", ())  # of a part: prove_parting states those of the complete curve

        def of_part(part: Curve, rest: CollisionChecker) -> Certificate:
            return _CurveProof(part, rest, each, constraints, identity=unnamed).run()

        return prove_parting(whole, checker, parting, of_part, each)

    certificate = _at_finer_tolerances(certified, settings)
    # The constraints are those of the arm, whose joints come before those of the movers.
    if constraints:
        resolution = RESOLUTION if tolerance is None else tolerance
        of_arm = settings._replace(tolerances=(resolution,), joints=joints[: group.dof])
        certificate = with_constraints(certificate, checked_curve, group, constraints, of_arm)
    return with_limits(certificate, within)


def _shown_by_motion(
    samples: SampledMotion, proof: Certificate, again: Callable[..., Certificate]
) -> Certificate | None:
    """The contact or violation of the motion itself when the polyline has one, or at a sample after what is proven."""
    event, contact, violation = proof.first_contact or proof.violation, proof.first_contact, proof.violation
    ends = [span.start for span in (proof.undecided, proof.undecided_constraint) if span is not None]
    ends += [contact.proven_free_until] if contact is not None else []
    ends += [violation.satisfied_until] if isinstance(violation, ConstraintViolation) else []
    later = samples.times[samples.times >= min(ends)][:LOOK_AHEAD].tolist()
    for time in later if event is None else [event.time]:
        here = np.tile(samples.at(time), (1, 2, 1))
        point = again(TimedCurvePart(np.array([time, time]), here, samples.joint_names), limits=None)
        contact, violation = point.first_contact, point.violation
        if contact is None and violation is None:
            continue
        if contact is not None:
            contact = replace(contact, proven_free_until=min(ends))
        if isinstance(violation, ConstraintViolation):
            violation = replace(violation, satisfied_until=min(ends))
        point = replace(point, curve=proof.curve, intervals=proof.intervals, notes=proof.notes)
        return replace(point, first_contact=contact, violation=violation)
    return None


def _certify_motion(
    motion: Motion,
    checker: CollisionChecker,
    again: Callable[..., Certificate],
    domain: tuple[float, float] | None,
    speed_bound: SpeedBound | None,
    most: int,
    joint_tolerance: npt.ArrayLike,
    limits: JointLimits | Literal["arm"] | None,
) -> Certificate:
    """Certify a spline as a curve, and a function by its samples; ``again`` is :func:`certify` with other settings."""
    names = checker.group.joint_names
    if domain is None and speed_bound is None and (spline := TimedCurvePart.of_spline(motion, names)) is not None:
        return again(spline, joint_tolerance=joint_tolerance, limits=limits)
    if not callable(motion) or domain is None or speed_bound is None:
        raise InputError(
            "the curve must be a curve, such as a JointPath or a Trajectory, a spline of SciPy, or a function of the "
            f"time with domain=(first, last) in s and speed_bound= in rad/s or m/s, not {motion!r:.80}"
        )
    samples = SampledMotion(motion, names, domain, speed_bound)
    known = checker.group.limits if limits == "arm" else limits
    # The polyline has jumps of its speed that the motion need not have: only position and speed are compared.
    compared = None if known is None else replace(known, acceleration=np.full(len(known), np.nan))
    proof: Certificate | None = None
    for deviation in DEVIATIONS:
        if not samples.refine(deviation, most):
            break
        away = samples.deviations.max(axis=0)
        proof = again(samples.polyline(), joint_tolerance=np.asarray(joint_tolerance) + away, limits=compared)
        note = (
            f"the motion is a function that was computed at {len(samples.times)} times; between them it is at most "
            f"{away.max():.3g} rad or m from straight lines if it keeps speed_bound, which is trusted"
        )
        proof = replace(proof, notes=(*proof.notes, note))
        if proof.free:
            reason, remains = ("", False) if known is None else samples.beyond(known)
            if not reason:
                return proof
            message = f"{reason}; give a smaller bound, or limits=None; {proof.message}"
            proof = _without_proof(replace(proof, status=CertificateStatus.UNDECIDED, message=message))
            if remains:
                break
        elif proof.status is CertificateStatus.VIOLATED and isinstance(proof.violation, LimitViolation):
            return proof  # by a sample, or by the mean speed between two
        elif (shown := _shown_by_motion(samples, proof, again)) is not None:
            return shown
        elif proof.status is not CertificateStatus.UNDECIDED:
            message = f"a polyline through samples, not the motion, has a contact or a violation: {proof.message}"
            proof = replace(
                proof, status=CertificateStatus.UNDECIDED, first_contact=None, violation=None, message=message
            )
    if proof is None:
        raise InputError(
            f"more than max_intervals = {most} samples are needed for the speed_bound; use a smaller bound or domain"
        )
    return proof


def is_proven_free(curve: Curve, checker: CollisionChecker, *, joint_tolerance: Array | None = None) -> bool:
    """Return whether the curve is proven collision-free, for searches that query many short edges.

    Faster than :func:`certify`: it proves the margin and no clearance beyond it, and returns no reason. With
    ``joint_tolerance`` (n,), the proof covers deviations of the joints as in :func:`certify`.
    """
    if checker._fixed.touching:
        return False
    knots, control = (np.ascontiguousarray(part) for part in curve.bezier())
    settings = ProofSettings(tolerance=TOLERANCE, max_intervals=QUICK_INTERVALS)
    joints = np.zeros(checker.group.dof) if joint_tolerance is None else joint_tolerance
    proof = prove(checker.world, knots, control, settings, joints, KNOWN_NOTHING)
    return bool(proof.free)


class KnownPairs(NamedTuple):
    """What is proven of the pairs of a checker before a proof, so that only the other pairs remain."""

    rest: CollisionChecker  # without the known pairs
    proven: float  # lower bound (m) of their distances on the curve, obstacles displaced by their tolerance
    joint_tube: float  # rad or m by which all joints could deviate with the proof of the known pairs still valid
    obstacle_tube: float  # metres by which all obstacles could be displaced
    identity: tuple[str, Setup]  # the hash of the curve, and the setup of the complete checker
    evidence_with: Callable[[Array], Array]  # the evidence (K, 7) of all pairs from that of the rest


def prove_rest(curve: Curve, checker: CollisionChecker, known: KnownPairs, limits: ProofLimits) -> Certificate:
    """Return the certificate of a curve of which some pairs are known to be apart."""
    return _at_finer_tolerances(
        lambda each: _CurveProof(curve, checker, each, (), known, identity=known.identity).run(), limits
    )


def _at_finer_tolerances(prove: Callable[[ProofLimits], Certificate], limits: ProofLimits) -> Certificate:
    """Return the certificate at the first tolerance at which it is not UNDECIDED."""
    for each in limits.tolerances:
        certificate = prove(limits._replace(tolerances=(each,)))
        if certificate.status is not CertificateStatus.UNDECIDED or certificate.intervals >= limits.max_intervals:
            break
    return certificate


class _CurveProof:
    """The certification of one curve at one tolerance.

    Indices of pairs are those of ``_judge``: the checker without the known pairs, and with displaced obstacles.
    """

    def __init__(
        self,
        curve: Curve,
        checker: CollisionChecker,
        limits: ProofLimits,
        constraints: Sequence[PathConstraint],
        known: KnownPairs | None = None,
        *,
        identity: tuple[str, Setup] | None = None,
    ) -> None:
        self._curve, self._checker, self._constraints, self._known = curve, checker, constraints, known
        self._limits, self._identity = limits, identity
        # Displaced obstacles are obstacles with larger margins.
        judge = checker if known is None else known.rest
        self._judge = judge.with_obstacle_tolerance(limits.obstacles) if limits.obstacles > 0 else judge
        self._largest_margin = float(self._judge.margins.max(initial=0.0))
        self._knots, self._control = (np.ascontiguousarray(part) for part in curve.bezier())
        self._settings = ProofSettings(
            tolerance=limits.tolerance,
            max_intervals=limits.max_intervals,
            obstacle_tolerance=limits.obstacles,
            goal_share=GOAL_SHARE,
            look_ahead=LOOK_AHEAD,
            wants_tubes=True,
            record=limits.record,
        )
        self._state = state = ProofState()
        # With known pairs, the proof of the others begins with what is known of these.
        if known is None:
            return
        state.proven, state.joint_tube, state.obstacle_tube = known.proven, known.joint_tube, known.obstacle_tube
        near = checker._workspace.nearest(self._control[0, 0])
        if near.nearest >= 0:
            state.observed = near.upper
            state.spare = near.upper - float(checker.margins[near.nearest])

    def run(self) -> Certificate:
        first, last = float(self._knots[0]), float(self._knots[-1])
        start, end = self._control[0, 0], self._control[-1, -1]
        # Both ends are checked first: a start in contact is the most common failure, and bisection finds it late.
        if (contact := self._look(start)) is not None:
            return self._colliding(first, start, contact, first)
        at_end = self._look(end)
        # Pairs that no joint moves relative to each other are checked once; their contacts were found at the start.
        judge, state = self._judge, self._state
        for pair, measured in judge._fixed.touching:
            undecided = UndecidedSpan(first, last, judge.owners(pair), measured.distance)
            return self._undecided(undecided) if at_end is None else self._colliding(last, end, at_end, first)
        if len(judge.still_pairs):
            proven = judge._fixed.lower - judge.rounding
            state.observed = min(state.observed, judge._fixed.upper)
            state.proven = min(state.proven, proven - self._limits.obstacles)
            slack = max(proven - float(judge.margins[judge.still_pairs].max()), 0.0)
            state.obstacle_tube = min(state.obstacle_tube, slack)
        self._state = prove(judge.world, self._knots, self._control, self._settings, self._limits.joints, state)
        span, found = self._state.open, self._state.contact
        if found is not None:
            at = np.array(found.q)
            contact = self._deepest(at) or self._contact(found.pair, judge._placed(at).measure(found.pair))
            return self._colliding(found.time, at, contact, found.time if span is None else span.start)
        if at_end is not None:
            return self._colliding(last, end, at_end, last if span is None else span.start)
        if span is not None:
            distance = span.distance
            if distance == np.inf:  # not measured here: a longer interval had shown that the pair is close
                distance = judge._placed(self._curve((span.start + span.end) / 2)).measure(span.pair).attained
            return self._undecided(UndecidedSpan(span.start, span.end, judge.owners(span.pair), distance))
        proven = float(self._state.proven)
        message = free_sentence(proven, len(self._checker.margins), len(self._checker.excluded))
        message += f"; {self._tolerances}" if self._tolerances else ""
        return self._certificate(CertificateStatus.FREE, message, clearance=proven)

    def _look(self, q: Array) -> Contact | None:
        """Return the deepest contact at q (n,) and update the smallest observed distance."""
        space = self._judge._workspace
        near = space.nearest(q)
        self._saw(near.nearest, near.upper)
        apart = not near.contacts and near.lower > self._largest_margin
        return None if apart and not self._judge._fixed.touching else self._deepest(q)

    def _saw(self, pair: int, attained: float) -> None:
        if pair < 0:
            return
        state = self._state
        state.observed = min(state.observed, attained)
        state.spare = min(state.spare, attained - float(self._judge.margins[pair]))

    def _deepest(self, q: Array) -> Contact | None:
        """Return the deepest contact at q (n,) whose measured distance is attained, so that it is evidence."""
        judge, deepest = self._judge, None
        for pair, measured in (*judge._workspace.touching(q), *judge._fixed.touching):
            if measured.attained <= judge.margins[pair]:
                self._saw(pair, measured.attained)
                contact = self._contact(pair, measured)
                if deepest is None or contact.distance < deepest.distance:
                    deepest = contact
        return deepest

    def _contact(self, pair: int, measured: Distance) -> Contact:
        """Return the contact of a pair, with the distance reduced by the tolerance of obstacles."""
        contact = self._judge._contact(pair, measured)
        moved = self._limits.obstacles
        if not moved or self._judge.bodies[self._judge.indices_of(pair)[1]].link is not None:
            return contact
        return replace(contact, distance=contact.distance - moved)

    @property
    def _tolerances(self) -> str:
        """The allowed deviations as text; empty without any."""
        deviations, joints, obstacles = [], self._limits.joints, self._limits.obstacles
        if joints.any():
            low, high = float(joints.min()), float(joints.max())
            by = f"{high:g} rad or m" if low == high else f"their tolerances, {low:.3g} to {high:.3g} rad or m"
            deviations.append(f"joints may deviate by up to {by}")
        if obstacles:
            deviations.append(f"obstacles may deviate by up to {obstacles * 1e3:g} mm")
        return " and ".join(deviations)

    def _colliding(self, time: float, q: Array, contact: Contact, proven_free_until: float) -> Certificate:
        first = FirstContact(
            time, q.copy(), contact.bodies, contact.distance, contact.points, contact.distance < 0, proven_free_until
        )
        message = f"{contact} at {parameter_text(self._curve, time)}"
        if proven_free_until > self._curve.domain[0]:
            message += f"; collision-free until {parameter_text(self._curve, proven_free_until)}"
        return self._certificate(CertificateStatus.COLLIDING, message, first_contact=first)

    def _undecided(self, span: UndecidedSpan) -> Certificate:
        budget = self._limits.max_intervals
        spent = self._state.intervals >= budget
        limit = f"limit of {budget} intervals" if spent else f"tolerance of {self._settings.tolerance * 1e3:g} mm"
        message = (
            f"neither proven collision-free nor in collision on [{span.start:.6g}, {span.end:.6g}]: "
            f"{' and '.join(span.bodies)} are {span.distance * 1e3:.3f} mm apart there, and the {limit} was reached; "
            f"increase the distance{' or max_intervals' if spent else ''}, or lower the margin or the tolerance"
        )
        if self._tolerances:
            message += f" ({self._tolerances})"
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
        checker, state, known = self._checker, self._state, self._known
        free = status is CertificateStatus.FREE
        curve, setup = self._identity or (curve_hash(self._curve), setup_of(checker))
        # The evidence and the differences from the certification that the file of the motion records.
        evidence = state.evidence if self._limits.record else None
        if evidence is not None and known is not None:
            evidence = known.evidence_with(evidence)
        records = getattr(self._curve, "certified", ())  # of a trajectory that was read from a file
        found = changes_since(records, checker, curve, setup.hash, self._constraints)
        changes = (f"the file of the motion states: {each}" for each in found)
        return Certificate(
            status=status,
            margin=checker.margin,
            clearance=clearance,
            observed=state.observed,
            first_contact=first_contact,
            undecided=undecided,
            message=message,
            pairs=len(checker.margins),
            intervals=state.intervals,
            excluded=tuple(checker.excluded),
            tolerance=self._settings.tolerance,
            curve=curve,
            setup=setup.hash,
            notes=(*setup.notes, *changes),
            tube=MotionTube(
                read_only(self._limits.joints),
                self._limits.obstacles,
                max(state.joint_tube, 0.0) if free else np.nan,
                max(state.obstacle_tube, 0.0) if free else np.nan,
            ),
            evidence=None if evidence is None else read_only(evidence),
            subject=None if evidence is None else (self._curve, self._checker),
            attached=checker.attached,
            held=dict(checker.group.held),
            obstacles=checker.scene.names,
            calibrations=checker.group.robot.calibrations,
        )
