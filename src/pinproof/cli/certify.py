"""``pinproof certify`` and ``pinproof export``: prove motions and robot programs, save and verify proofs, audit."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any

import pinproof as pp
from pinproof.cli.console import check_output_files, print_result, progress_status
from pinproof.cli.options import (
    ConstraintOptions,
    Html,
    IgnoreRecord,
    Json,
    RateOptions,
    Robot,
    SetupOptions,
    argument,
    load_motion,
    option,
    robot_names,
)
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
    """The files with proofs, and the independent check."""

    save_proof: Path | None = option("Write the proof to a file (.json, .json.gz) that others can verify.", None)
    verify: Path | None = option(
        "Verify a saved proof with independent code, instead of making one. With ROBOT, --scene and MOTION, "
        "also check that the proof belongs to them.",
        None,
    )
    with_audit: bool = option(
        "Also check dense samples of the motion with coal and exact meshes, independently of the proof.",
        False,
        "--audit",
    )
    audit_step: float = option("Largest joint motion between two samples of --audit (rad or m).", 0.002, min=1e-6)


def certify_motion(
    robot: str | None = argument(
        "A catalogue name such as ur5, a robot file, or a DH table.", None, metavar="ROBOT", autocompletion=robot_names
    ),
    motion: Path | None = argument(
        "A motion file (.json, .csv, .yaml or .yml), or a robot program of pinproof export.", None, metavar="MOTION"
    ),
    *,
    tolerances: ToleranceOptions,
    upright: ConstraintOptions,
    proof: ProofOptions,
    ignore_record: IgnoreRecord = False,
    allow_changes: bool = option("Accept a robot program that was edited after it was written.", False),
    html: Html = None,
    rates: RateOptions,
    setup: SetupOptions,
    as_json: Json = False,
) -> None:
    """Prove that a motion is collision-free at every instant.

    Exit code 1 unless it is FREE and within its limits.

    To verify a saved proof, replace --save-proof by --verify in the same command, or give --verify alone.

    Example: pinproof certify ur5 motion.json --scene robots/ur5/scene.yaml --save-proof proof.json
    """
    # Without ROBOT and MOTION only a saved proof can be verified; other options then have no meaning.
    arm = None if robot is None else setup.arm(robot, motion)
    sampled_or_written = bool(proof.save_proof or html or proof.with_audit or tolerances != ToleranceOptions())
    if proof.verify is not None:
        if rates != RateOptions():
            raise InputError("--payload, --torque and --tool-speed are not part of a proof; use them without --verify")
        if sampled_or_written:
            raise InputError(
                "--verify uses the tolerances of the proof and writes no file; remove --save-proof, --html, --audit, "
                "--joint-tolerance and --obstacle-tolerance"
            )
        _verify(proof.verify, arm, motion, setup, upright, as_json)
        return
    if arm is None or motion is None:
        raise InputError("ROBOT or MOTION is missing; state both, or a saved proof with --verify")
    check_output_files([html, proof.save_proof], [robot, motion, *setup.files])
    world = setup.world()
    checker = setup.checker(arm, world)

    if pp.motion.is_program_file(motion):
        if sampled_or_written or rates != RateOptions():
            raise InputError(
                "a robot program is certified with the deviation that it states, and without --save-proof, --html, "
                "--audit, --payload, --torque, --tool-speed and tolerances; remove these options"
            )
        program = pp.motion.RobotProgram.load(motion, allow_changes=allow_changes)
        with progress_status("certifying"):
            verdict = pp.collision.certify_program(program, checker)
        _print_program(program, verdict, None, as_json=as_json)
        return

    trajectory = load_motion(motion, checker, ignore_record)
    with progress_status("certifying"):
        certificate = pp.certify(
            trajectory,
            checker,
            constraints=upright.constraints(arm, trajectory.start),
            record=proof.save_proof is not None,
            **vars(tolerances),
        )
    audit = None
    if proof.with_audit:
        with progress_status("sampling"):
            audit = pp.audit(trajectory, checker, step=proof.audit_step)
    if html is not None:
        pp.write_html(html, arm, world, trajectory, certificate=certificate, attached=checker.attached, checker=checker)
    if proof.save_proof is not None and certificate.free:
        certificate.save(proof.save_proof)

    # The certificate compares the limits of joints; torques and the speed of the tool are compared here.
    limits = rates.limits(arm)
    exceeded = pp.motion.rate_violations(limits, trajectory)
    within = [] if certificate.limits is None else list(map(str, certificate.limits.violations))
    attached, torques, notes = [body.name for body in checker.attached], {}, []
    for limit in limits:
        if isinstance(limit, pp.motion.TorqueLimits):
            torques = limit.report(trajectory)
            notes = [f"largest torque: {limit.largest(trajectory)}", *(f"note: {note}" for note in limit.notes)]
    lines = [str(certificate), *([f"attached: {', '.join(attached)}"] if attached else [])]
    lines += [f"outside the limits: {violation}" for violation in exceeded]
    lines += [f"not checked: {' and '.join(pair.owners)} ({pair.reason})" for pair in certificate.excluded]
    lines += [*notes, *([] if audit is None else [f"audit: {audit.message}"])]
    if proof.save_proof is not None:
        is_saved = f"wrote {proof.save_proof}", f"{proof.save_proof} is not written: there is no proof"
        lines.append(is_saved[not certificate.free])
    figures = None if audit is None else {key: getattr(audit, key) for key in ("samples", "distance", "message")}
    more = {"attached": attached, "outside_limits": within + exceeded, "audit": figures, **torques}
    ok = certificate.free and not within and not exceeded and (audit is None or audit.clean)
    print_result({**certificate.to_dict(), **more}, lines, as_json=as_json, ok=ok)


def _verify(
    proof: Path,
    arm: pp.Arm | None,
    motion: Path | None,
    setup: SetupOptions,
    upright: ConstraintOptions,
    as_json: bool,
) -> None:
    """Verify a saved proof, and compare it with the arm, its cell and the motion as far as they are stated."""
    if arm is None and (setup.surrounds or setup.margin):
        raise InputError("--scene, --margin, --tool-of and --attached need ROBOT; state it too")
    checker = None if arm is None else setup.checker(arm)
    curve = None if motion is None or arm is None else pp.Trajectory.load(motion, arm.joint_names)
    constraints: tuple[pp.Upright, ...] = ()
    if upright.upright is not None:
        if arm is None or curve is None:
            raise InputError("--upright needs ROBOT and MOTION, whose start states which axis of the tcp points up")
        constraints = upright.constraints(arm, curve.start)
    result: pp.verifier.ProofVerdict = pp.verify_proof(proof, checker, curve, constraints)
    # The verdict, and what the verifier compared
    keys = ("ok", "reasons", "clearance", "margin", "joint_tolerance", "obstacle_tolerance", "pairs", "excluded")
    data = {key: getattr(result, key) for key in (*keys, "constraints", "limits", "compared", "not_compared")}
    lines = [str(result), *(f"not checked: {a} and {b} ({reason})" for a, b, reason in result.excluded)]
    print_result(data, lines, as_json=as_json, ok=result.ok)


def export(
    robot: Robot,
    motion: Path = argument("A motion file (.json, .csv, .yaml or .yml).", MISSING, metavar="MOTION"),
    output: Path = option(
        "The program to write: .script (URScript), .mod (RAPID), .src (KRL), .ls (FANUC) or .goal.yaml (ROS 2).",
        MISSING,
        "-o",
        "--output",
    ),
    deviation: float | None = option(
        "Assumed deviation of each joint from the moves of the program (rad). Default: 0.002; 0 for ROS 2; "
        "0.01 with --period.",
        None,
        min=0.0,
    ),
    period: float | None = option(
        "Seconds between set points: the program streams the motion (servoj) instead of moves. URScript only.", None
    ),
    linear: bool = option(
        "Write linear moves (movel, LIN) where the tcp moves on a straight line between two stops.", False
    ),
    ignore_record: IgnoreRecord = False,
    *,
    setup: SetupOptions,
    as_json: Json = False,
) -> None:
    """Write a motion as a robot program, and certify what the controller will execute.

    The program is read back from its text, and only written if it is proven collision-free; otherwise the exit code is
    1.

    Example: pinproof export ur5 motion.json --scene robots/ur5/scene.yaml -o motion.script
    """
    dialect = pp.motion.dialect_of_file(output)
    check_output_files([output], [robot, motion, *setup.files])
    checker = setup.checker(setup.arm(robot, motion))
    trajectory = load_motion(motion, checker, ignore_record)
    with progress_status("certifying"):
        program, certificate = pp.collision.export_program(
            trajectory,
            checker,
            dialect,
            name=motion.stem,
            deviation=deviation,
            period=period,
            linear=linear,
        )
    if certificate.free:
        program.save(output)
    _print_program(program, certificate, output if certificate.free else None, as_json=as_json)


def _print_program(
    program: pp.motion.RobotProgram,
    certificate: pp.collision.ProgramCertificate,
    file: Path | None,
    *,
    as_json: bool,
) -> None:
    """Print the verdict on a program, and the file to which it was written; exit code 1 unless it is FREE."""
    # The text of a program names the certificate that it was written with
    same = bool(program.certificate) and certificate.hash == program.certificate
    data: dict[str, Any] = {"status": certificate.status.name, "message": certificate.message}
    data |= {"dialect": program.dialect, "moves": len(program.moves), "hash": certificate.hash}
    data |= {"same_certificate": same, "clearance_proven": certificate.clearance if certificate.free else None}
    data |= {"outside_limits": certificate.outside_limits, "notes": certificate.notes}
    lines = [str(certificate), *(f"outside the limits: {violation}" for violation in certificate.outside_limits)]
    lines += [f"note: {note}" for note in certificate.notes]
    if program.certificate and not same and not program.picks:
        lines.append("note: the program names another certificate: the robot, the scene or the tool has changed")
    if file is not None:
        lines.append(f"wrote {file}: {len(program.moves)} moves, certificate {certificate.hash[:16]}")
    data["program"] = None if file is None else str(file)
    print_result(data, lines, as_json=as_json, ok=certificate.free)
