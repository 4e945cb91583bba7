"""``pinproof export``: write the program of a robot controller, and certify the programs of ``pinproof certify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import pinproof as pp
from pinproof.cli.console import check_output_files, print_json, print_line, progress_status
from pinproof.cli.options import ChainOptions, IgnoreRecord, Json, Robot, SceneOptions, ToolOptions, load_motion


def export(
    robot: Robot,
    motion: Annotated[Path, typer.Argument(help="A motion file (.json, .csv, .yaml or .yml).", metavar="MOTION")],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="The program to write: .script (URScript), .mod (RAPID), .src (KRL), .ls (FANUC) or .goal.yaml (ROS "
            "2).",
        ),
    ],
    tolerance: Annotated[
        float, typer.Option(help="Largest deviation of the moves of the program from the motion (rad).", min=1e-6)
    ] = 0.002,
    deviation: Annotated[
        float | None,
        typer.Option(
            help="Assumed deviation of each joint from the moves of the program (rad). Default: that of the language.",
            min=0.0,
        ),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(help="Seconds between set points: stream the motion (servoj) instead of moves; only URScript."),
    ] = None,
    linear: Annotated[
        bool,
        typer.Option(
            "--linear", help="Write parts from stop to stop on a straight line of the tcp as linear moves (movel, LIN)."
        ),
    ] = False,
    ignore_record: IgnoreRecord = False,
    *,
    chain: ChainOptions,
    scene_options: SceneOptions,
    tool: ToolOptions,
    as_json: Json = False,
) -> None:
    """Write a motion as a robot program, and certify what the controller will execute. Exit code 1 unless it is FREE.

    The program is read back from its text, and only written if it is proven collision-free.

    Example: pinproof export ur5 motion.json --scene robots/ur5/scene.yaml -o motion.script
    """
    from pinproof.motion.dialects import dialect_of_file

    dialect = dialect_of_file(output)
    check_output_files([output], [robot, motion, scene_options.scene, chain.srdf, *tool.files])
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
    if as_json:
        found: dict[str, Any] = {"status": certificate.status.name, "message": certificate.message}
        found |= {"dialect": program.dialect, "moves": len(program.moves), "hash": certificate.hash}
        found |= {"same_certificate": same, "clearance_proven": certificate.clearance if certificate.free else None}
        print_json(
            {**found, "outside_limits": certificate.outside_limits, "notes": certificate.notes, "program": written}
        )
    else:
        print_line(str(certificate))
        for violation in certificate.outside_limits:
            print_line(f"outside the limits: {violation}")
        for note in certificate.notes:
            print_line(f"note: {note}")
        if program.certificate and not same:
            print_line("note: the certificate that the program names is another: robot, scene or tool differ from then")
        if written is not None:
            print_line(f"wrote {written}: {len(program.moves)} moves, certificate {certificate.hash[:16]}")
    if not certificate.free or certificate.outside_limits:
        raise typer.Exit(1)
