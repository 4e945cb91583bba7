"""``pinproof export``: write the program of a robot controller, and certify the programs of ``pinproof certify``."""

from __future__ import annotations

from dataclasses import MISSING
from pathlib import Path
from typing import Any

import pinproof as pp
from pinproof.cli.console import check_output_files, print_result, progress_status
from pinproof.cli.options import (
    ChainOptions,
    IgnoreRecord,
    Json,
    Robot,
    SceneOptions,
    ToolOptions,
    argument,
    load_motion,
    option,
)


def export(
    robot: Robot,
    motion: Path = argument("A motion file (.json, .csv, .yaml or .yml).", MISSING, metavar="MOTION"),
    output: Path = option(
        "The program to write: .script (URScript), .mod (RAPID), .src (KRL), .ls (FANUC) or .goal.yaml (ROS 2).",
        MISSING,
        "-o",
        "--output",
    ),
    tolerance: float = option("Largest deviation of the moves of the program from the motion (rad).", 0.002, min=1e-6),
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
    chain: ChainOptions,
    scene_options: SceneOptions,
    tool: ToolOptions,
    as_json: Json = False,
) -> None:
    """Write a motion as a robot program, and certify what the controller will execute.

    The program is read back from its text, and only written if it is proven collision-free; otherwise the exit code is
    1.

    Example: pinproof export ur5 motion.json --scene robots/ur5/scene.yaml -o motion.script
    """
    from pinproof.motion.dialects import dialect_of_file

    dialect = dialect_of_file(output)
    check_output_files([output], [robot, motion, *scene_options.files, *chain.files, *tool.files])
    checker = scene_options.checker(chain.arm(robot, tool=tool), tool=tool)
    trajectory = load_motion(motion, checker, ignore_record)
    with progress_status("certifying"):
        program, certificate = pp.collision.export_program(
            trajectory,
            checker,
            dialect,
            name=motion.stem,
            tolerance=tolerance,
            deviation=deviation,
            period=period,
            linear=linear,
        )
    if certificate.free:
        program.save(output)
    _show(program, certificate, as_json=as_json, written=str(output) if certificate.free else None)


def certify_program_file(path: Path, checker: pp.CollisionChecker, *, allow_changes: bool, as_json: bool) -> None:
    """Certify a program that was read from its text; exit code 1 unless it is FREE."""
    program = pp.motion.RobotProgram.load(path, allow_changes=allow_changes)
    with progress_status("certifying"):
        certificate = pp.collision.certify_program(program, checker)
    _show(program, certificate, as_json=as_json)


def _show(
    program: pp.motion.RobotProgram,
    certificate: pp.collision.ProgramCertificate,
    *,
    as_json: bool,
    written: str | None = None,
) -> None:
    same = bool(program.certificate) and certificate.hash == program.certificate
    data: dict[str, Any] = {"status": certificate.status.name, "message": certificate.message}
    data |= {"dialect": program.dialect, "moves": len(program.moves), "hash": certificate.hash}
    data |= {"same_certificate": same, "clearance_proven": certificate.clearance if certificate.free else None}
    data |= {"outside_limits": certificate.outside_limits, "notes": certificate.notes, "program": written}
    lines = [str(certificate), *(f"outside the limits: {violation}" for violation in certificate.outside_limits)]
    lines += [f"note: {note}" for note in certificate.notes]
    if program.certificate and not same and not program.picks:
        lines.append("note: the program names another certificate: the robot, the scene or the tool has changed")
    if written is not None:
        lines.append(f"wrote {written}: {len(program.moves)} moves, certificate {certificate.hash[:16]}")
    print_result(data, lines, as_json=as_json, ok=certificate.free)
