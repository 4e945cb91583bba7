"""``pinproof certify``: prove that a motion is collision-free, save the proof, verify a proof, audit by sampling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pinproof as pp
from pinproof.cli.complete import robot_names
from pinproof.cli.console import check_output_files, print_result, progress_status
from pinproof.cli.options import (
    ChainOptions,
    ConstraintOptions,
    Html,
    IgnoreRecord,
    Json,
    RateOptions,
    SceneOptions,
    ToolOptions,
    argument,
    load_motion,
    option,
)
from pinproof.cli.program import certify_program_file
from pinproof.errors import InputError


@dataclass(frozen=True)
class ToleranceOptions:
    """The deviations for which a proof holds."""

    joint_tolerance: float = option("The proof holds for joint errors up to this value (rad or m).", 0.0, min=0.0)
    obstacle_tolerance: float = option(
        "The proof holds for obstacles displaced by up to this distance (m).", 0.0, min=0.0
    )


@dataclass(frozen=True)
class ProofOptions:
    """The files with proofs."""

    save_proof: Path | None = option("Write the proof to a file (.json, .json.gz) that others can verify.", None)
    verify: Path | None = option(
        "Verify a saved proof with independent code, instead of making one. With ROBOT, --scene and MOTION, "
        "also check that the proof belongs to them.",
        None,
    )


@dataclass(frozen=True)
class AuditOptions:
    """The options of the independent check."""

    with_audit: bool = option(
        "Also check dense samples of the motion with coal and exact meshes, independently of the proof.",
        False,
        "--audit",
    )
    audit_step: float = option("Largest joint motion between two samples of --audit (rad or m).", 0.002, min=1e-6)

    def audit(self, trajectory: pp.Trajectory, checker: pp.CollisionChecker) -> pp.collision.AuditResult | None:
        """Check the motion with exact meshes, if requested."""
        if not self.with_audit:
            return None
        with progress_status("sampling"):
            return pp.audit(trajectory, checker, step=self.audit_step)


def certify_motion(
    robot: str | None = argument(
        "A catalogue name such as ur5, a robot file, or a DH table.", None, metavar="ROBOT", autocompletion=robot_names
    ),
    motion: Path | None = argument(
        "A motion file (.json, .csv, .yaml or .yml), or a robot program of pinproof export.", None, metavar="MOTION"
    ),
    *,
    tolerances: ToleranceOptions,
    constraint_options: ConstraintOptions,
    proof: ProofOptions,
    audit_options: AuditOptions,
    ignore_record: IgnoreRecord = False,
    allow_changes: bool = option("Accept a robot program that was edited after it was written.", False),
    html: Html = None,
    rates: RateOptions,
    chain: ChainOptions,
    scene_options: SceneOptions,
    tool: ToolOptions,
    as_json: Json = False,
) -> None:
    """Prove that a motion is collision-free at every instant.

    Exit code 1 unless it is FREE and within its limits.

    To verify a saved proof, replace --save-proof by --verify in the same command, or give --verify alone.

    Example: pinproof certify ur5 motion.json --scene robots/ur5/scene.yaml --save-proof proof.json
    """
    arm = None if robot is None else chain.arm(robot, tool=tool)
    sampled_or_written = bool(proof.save_proof or html or audit_options.with_audit or tolerances != ToleranceOptions())
    if proof.verify is not None:
        _refuse_with_verify(rates, sampled_or_written)
        _verify(proof.verify, arm, motion, scene_options, tool, constraint_options, as_json)
        return
    if arm is None or motion is None:
        raise InputError("ROBOT or MOTION is missing; state both, or a saved proof with --verify")
    check_output_files([html, proof.save_proof], [robot, motion, *scene_options.files, *chain.files, *tool.files])
    world = scene_options.load()
    checker = scene_options.checker(arm, world, tool)
    from pinproof.motion.dialects import is_program_file

    if is_program_file(motion):
        if sampled_or_written or rates != RateOptions():
            raise InputError(
                "a robot program is certified with the deviation that it states, and without --save-proof, --html, "
                "--audit, --payload, --torque, --tool-speed and tolerances; remove these options"
            )
        certify_program_file(motion, checker, allow_changes=allow_changes, as_json=as_json)
        return
    trajectory = load_motion(motion, checker, ignore_record)
    with progress_status("certifying"):
        certificate = pp.certify(
            trajectory,
            checker,
            constraints=constraint_options.constraints(arm, trajectory.start),
            record=proof.save_proof is not None,
            **vars(tolerances),
        )
    audit = audit_options.audit(trajectory, checker)
    if html is not None:
        pp.write_html(html, arm, world, trajectory, certificate=certificate, attached=checker.attached)
    if proof.save_proof is not None and certificate.free:
        certificate.save(proof.save_proof)
    _report(certificate, trajectory, checker, rates, audit, proof.save_proof, as_json)


def _refuse_with_verify(rates: RateOptions, sampled_or_written: bool) -> None:
    if rates != RateOptions():
        raise InputError("--payload, --torque and --tool-speed are not part of a proof; use them without --verify")
    if sampled_or_written:
        raise InputError(
            "--verify uses the tolerances of the proof and writes no file; remove --save-proof, --html, --audit, "
            "--joint-tolerance and --obstacle-tolerance"
        )


def _report(
    certificate: pp.Certificate,
    trajectory: pp.Trajectory,
    checker: pp.CollisionChecker,
    rates: RateOptions,
    audit: pp.collision.AuditResult | None,
    save_proof: Path | None,
    as_json: bool,
) -> None:
    """Print the result; exit code 1 unless the motion is certified, within its limits and without contacts found."""
    from pinproof.motion.limit_check import LIMIT_TOLERANCE  # loads the kinematics

    arm = checker.arm
    within = [] if certificate.limits is None else list(map(str, certificate.limits.violations))
    violations = within + rates.violations(arm, trajectory, LIMIT_TOLERANCE)
    attached = [body.name for body in checker.attached]
    torques, torque_notes = rates.peaks(arm, trajectory), rates.notes(arm)
    figures = None if audit is None else {key: getattr(audit, key) for key in ("samples", "distance", "message")}
    found = {"attached": attached, "outside_limits": violations, "audit": figures}
    lines = [str(certificate), *([f"attached: {', '.join(attached)}"] if attached else [])]
    lines += [f"outside the limits: {violation}" for violation in violations[len(within) :]]
    lines += [f"not checked: {' and '.join(pair.owners)} ({pair.reason})" for pair in certificate.excluded]
    lines += [*largest_torque(torques), *(f"note: {note}" for note in torque_notes)]
    lines += [] if audit is None else [f"audit: {audit.message}"]
    if save_proof is not None:
        lines.append(f"wrote {save_proof}" if certificate.free else f"{save_proof} is not written: there is no proof")
    data = {**verdict(certificate), **found, **torque_figures(torques, torque_notes)}
    ok = certificate.free and not violations and (audit is None or audit.clean)
    print_result(data, lines, as_json=as_json, ok=ok)


def largest_torque(torques: Sequence[pp.motion.TorquePeak]) -> list[str]:
    """The line on the joint that uses the largest share of its torque limit; empty without limits of torque."""
    return [f"largest torque: {max(torques, key=lambda peak: peak.share)}"] if torques else []


def torque_figures(torques: Sequence[pp.motion.TorquePeak], notes: Sequence[str]) -> dict[str, Any]:
    """The largest torques of a motion and the notes on them for JSON output; nothing without a limit of torque."""
    return {"torques": [peak.as_dict() for peak in torques], "torque_notes": notes} if torques else {}


def _verify(
    proof: Path,
    arm: pp.Arm | None,
    motion: Path | None,
    scene_options: SceneOptions,
    tool: ToolOptions,
    constraint_options: ConstraintOptions,
    as_json: bool,
) -> None:
    if arm is None and (scene_options.scene is not None or scene_options.margin or any(tool.files)):
        raise InputError("--scene, --margin, --tool-of and --attached need ROBOT; state it too")
    checker = None if arm is None else scene_options.checker(arm, tool=tool)
    curve = None if motion is None or arm is None else pp.Trajectory.load(motion, arm.joint_names)
    constraints: tuple[pp.Upright, ...] = ()
    if constraint_options.upright is not None:
        if arm is None or curve is None:
            raise InputError("--upright needs ROBOT and MOTION, whose start states which axis of the tcp points up")
        constraints = constraint_options.constraints(arm, curve.start)
    result: pp.verifier.ProofVerdict = pp.verify_proof(proof, checker, curve, constraints)
    keys = ("ok", "reasons", "clearance", "margin", "joint_tolerance", "obstacle_tolerance", "pairs", "excluded")
    data = {key: getattr(result, key) for key in (*keys, "constraints", "limits", "compared", "not_compared")}
    lines = [str(result), *(f"not checked: {a} and {b} ({reason})" for a, b, reason in result.excluded)]
    print_result(data, lines, as_json=as_json, ok=result.ok)


def verdict(certificate: pp.Certificate) -> dict[str, Any]:
    """The content of a certificate for JSON output."""

    def parts(found: Any, *names: str) -> dict[str, Any] | None:
        return None if found is None else {name: getattr(found, name) for name in names}

    violation = parts(certificate.violation, "time", "q")
    if isinstance(certificate.violation, pp.collision.ConstraintViolation):
        more = parts(certificate.violation, "error", "satisfied_until") or {}
        violation = {"constraint": str(certificate.violation.constraint), **(violation or {}), **more}
    elif certificate.violation is not None:
        limit = parts(certificate.violation, "joint", "quantity", "value", "limit") or {}
        violation = {**limit, **(violation or {})}
    return {
        "status": certificate.status.name,
        "message": certificate.message,
        "margin": certificate.margin,
        "clearance_proven": certificate.clearance if certificate.free else None,
        "clearance_observed": certificate.observed,
        "first_contact": parts(
            certificate.first_contact, "time", "q", "bodies", "distance", "points", "proven_free_until"
        ),
        "constraints": [
            {
                "constraint": str(proof.constraint),
                "tolerance": proof.constraint.tolerance,
                "largest_proven": proof.largest if certificate.free else None,
                "largest_observed": proof.observed,
            }
            for proof in certificate.constraints
        ],
        "violation": violation,
        "limits_compared": [] if certificate.limits is None else list(certificate.limits.checked),
        "excluded": [[*pair.owners, pair.reason] for pair in certificate.excluded],
        "notes": list(certificate.notes),
    }
