"""The proof of constraints of the tcp and the check of joint limits over a whole curve, as parts of a certificate.

The curve is bisected as for collisions; in each interval the error at the middle is compared with an upper bound of its
growth (``src/core/certificate/path_constraint.h``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinproof._core import ConstraintSettings, prove_constraint
from pinproof.collision.certificates.certificate import Certificate, CertificateStatus, ProofLimits
from pinproof.collision.certificates.path_constraints import (
    ConstraintProof,
    ConstraintViolation,
    PathConstraint,
    UndecidedConstraint,
    amount,
)
from pinproof.model import Arm
from pinproof.motion import Curve, LimitCheck, parameter_text, read_only

RESOLUTION = 1e-6
"""rad or m: an interval in which the tcp moves less is not bisected further; the smallest tolerance of a constraint."""

GOAL_SHARE = 0.5
"""An interval is proven up to this share of the difference of the tolerance and the largest error found so far, so that
the bound is useful."""

LOOK_AHEAD = 200
"""Number of intervals that are searched for a violation behind an undecided span."""

SAMPLES = 50
"""Number of configurations of a curve that violates a constraint at which its error is computed for the message."""


def with_constraints(
    certificate: Certificate,
    curve: Curve,
    arm: Arm,
    constraints: Sequence[PathConstraint],
    limits: ProofLimits,
) -> Certificate:
    """Return a certificate of collisions with the proofs of constraints on the same curve of an arm."""
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
    for each in constraints:
        state = prove_constraint(arm.chain, each.compiled(), knots, control, settings, limits.joints)
        observed = float(state.observed)
        if state.violation is not None:  # samples show by how much the constraint is violated
            samples = curve(np.linspace(*curve.domain, SAMPLES))
            observed = max(observed, *(each.error(arm, q) for q in samples))
        largest = float(state.proven) if state.satisfied else np.nan
        evidence = read_only(state.evidence) if limits.record else None
        proofs.append(ConstraintProof(each, largest, observed, int(state.intervals), evidence))
        if state.violation is not None:
            found, until = state.violation, state.violation.time if state.open is None else state.open.start
            violations.append(ConstraintViolation(each, found.time, np.array(found.q), found.error, until))
        elif state.open is not None:
            undecided.append(UndecidedConstraint(state.open.start, state.open.end, each, state.open.error))
    violation = min(violations, key=lambda each: each.time, default=None)
    span = min(undecided, key=lambda each: each.start, default=None)
    status, message = _verdict(certificate, curve, tuple(proofs), violation, span, limits.max_intervals)
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


def _verdict(
    certificate: Certificate,
    curve: Curve,
    proofs: tuple[ConstraintProof, ...],
    violation: ConstraintViolation | None,
    span: UndecidedConstraint | None,
    max_intervals: int,
) -> tuple[CertificateStatus, str]:
    """The status of both proofs together, and its sentence. A contact is reported before a violation."""
    status = certificate.status
    if violation is not None:
        worst = max(proof.observed for proof in proofs if proof.constraint is violation.constraint)
        words = _violation_text(violation, worst, curve)
        if status is CertificateStatus.COLLIDING:
            return status, f"{certificate.message}; also, {words}"
        collision = certificate.message if status is CertificateStatus.FREE else f"collisions: {certificate.message}"
        return CertificateStatus.VIOLATED, f"{words}; {collision}"
    if span is not None:
        limit = "max_intervals" if any(each.intervals >= max_intervals for each in proofs) else "the tolerance"
        words = (
            f"{span.constraint} is neither proven nor violated on [{span.start:.6g}, {span.end:.6g}]: the error is "
            f"{amount(span.constraint, span.error)} there, and {limit} of the proof was reached; keep the motion "
            "farther from the limit of the constraint"
        )
        if status is CertificateStatus.FREE:
            return CertificateStatus.UNDECIDED, f"{words}; {certificate.message}"
        return status, f"{certificate.message}; also, {words}"
    return status, "; ".join([certificate.message, *map(str, proofs)])


def _violation_text(violation: ConstraintViolation, worst: float, curve: Curve) -> str:
    constraint = violation.constraint
    excess = amount(constraint, worst - constraint.tolerance)
    return (
        f"{constraint} is violated from {parameter_text(curve, violation.time)}: an error of "
        f"{amount(constraint, worst)} is reached, {excess} too much"
    )
