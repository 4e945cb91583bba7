"""``pinproof info``: print the properties of a robot and what its files do not state."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import pinproof as pp
from pinproof.cli.console import check_output_files, print_json, print_line, progress_status
from pinproof.cli.options import ChainOptions, Json, Robot
from pinproof.errors import MeshError

if TYPE_CHECKING:
    from pinproof.model import JointInfo


def info(
    robot: Robot,
    overlaps: Annotated[
        bool,
        typer.Option("--overlaps", help="Sample configurations and list which links touch always, sometimes or never."),
    ] = False,
    samples: Annotated[int, typer.Option(help="Number of configurations that --overlaps samples.", min=1)] = 1000,
    write_srdf: Annotated[
        Path | None,
        typer.Option(
            "--write-srdf",
            help="Write an SRDF that excludes adjacent links and links that touch in every sample; implies --overlaps.",
        ),
    ] = None,
    write_urdf: Annotated[
        Path | None,
        typer.Option(
            "--write-urdf", help="Write the URDF: of a xacro file the expanded one, of a DH table the generated one."
        ),
    ] = None,
    *,
    chain: ChainOptions,
    as_json: Json = False,
) -> None:
    """Print the joints, limits, frames, collision pairs, kinematic class and home of a robot, and missing data.

    Example: pinproof info ur5
    """
    check_output_files([write_srdf, write_urdf], [robot, chain.srdf, chain.limits])
    arm = chain.arm(robot)
    if write_urdf is not None:
        arm.robot.save_urdf(write_urdf)
    if overlaps or write_srdf is not None:
        with progress_status("sampling configurations"):
            report = pp.collision.sample_overlaps(arm.robot, samples=samples)
        if write_srdf is not None:
            report.save_srdf(write_srdf)
        print_json(_overlaps_json(report)) if as_json else _print_overlaps(report)
        if not as_json:
            _print_written(write_srdf, write_urdf)
        return
    robot_info = arm.robot.info(arm)
    try:
        checker = pp.CollisionChecker(arm)
    except MeshError as error:
        pairs: dict[str, object] = {"checked": None, "excluded": [], "why": str(error)}
    else:
        excluded = [[*pair.owners, pair.reason] for pair in checker.excluded]
        pairs = {"checked": len(checker.pairs), "excluded": excluded, "why": ""}
    if as_json:
        print_json({**robot_info.to_dict(), "pairs": pairs})
        return
    print_line(
        f"{robot_info.name}: {robot_info.dof} joints from {robot_info.base} to {robot_info.tcp}; "
        f"{robot_info.kinematic_class}"
    )
    print_line(f"file: {robot_info.source}" if robot_info.source else "loaded from text")
    _print_joints(robot_info)
    print_line(f"frames: {', '.join(robot_info.frames)}")
    print_line(f"collision geometry: {_geometry_counts(robot_info)}")
    if pairs["checked"] is None:
        print_line(f"self-collision pairs: none can be checked: {pairs['why']}")
    else:
        print_line(f"self-collision pairs: {pairs['checked']} checked, {len(checker.excluded)} excluded")
        for first, second, reason in excluded:
            print_line(f"  {first} and {second}: {reason}")
    for name, values in (
        ("groups", robot_info.groups),
        ("states", robot_info.states),
        ("end effectors", robot_info.end_effectors),
    ):
        if values:
            print_line(f"{name}: {', '.join(values)}")
    print_line("home: " + ", ".join(f"{name} {value:.4g}" for name, value in robot_info.home.items()))
    for sentence in robot_info.missing:
        print_line(f"missing: {sentence}")
    _print_written(write_urdf)


def _print_written(*files: Path | None) -> None:
    if written := [str(file) for file in files if file is not None]:
        print_line(f"wrote {' and '.join(written)}")


def _print_overlaps(report: pp.collision.OverlapReport) -> None:
    """Print the pairs by frequency, each with the proposal; those that never touch as one line."""
    count = len(report.pairs)
    print_line(
        f"{report.robot.name}: {count} pairs of links in {report.samples:,} sampled configurations of all joints"
    )
    touching = [pair for pair in report.pairs if pair.touching or pair.reason]
    rows = [("links", "in contact", "geometry", "SRDF", "proposal")]
    for pair in touching:
        share = f"{pair.touching} of {pair.samples}: {pair.frequency}"
        proposal = f"exclude: {pair.reason}" if pair.reason else "keep checking"
        rows.append((" and ".join(pair.links), share, pair.geometry, pair.disabled or "-", proposal))
    _print_columns(rows)
    never = [" and ".join(pair.links) for pair in report.pairs if pair not in touching]
    print_line(f"never in contact in these samples: {len(never)} pairs{': ' if never else ''}{', '.join(never)}")
    print_line(
        "proposed: adjacent links and links that touch in every sample are excluded. All others are checked: samples "
        "do not prove that links never touch."
    )


def _overlaps_json(report: pp.collision.OverlapReport) -> dict[str, object]:
    pairs = [
        {
            "links": pair.links,
            "touching": pair.touching,
            "frequency": pair.frequency,
            "adjacent": pair.adjacent,
            "geometry": pair.geometry,
            "srdf": pair.disabled,
            "proposed": pair.reason,
        }
        for pair in report.pairs
    ]
    return {"robot": report.robot.name, "samples": report.samples, "pairs": pairs}


def _print_joints(robot_info: pp.model.RobotInfo) -> None:
    header = ("joint", "type", "limits", "speed", "accel.", "effort", "role")
    _print_columns([header, *(_row(joint) for joint in robot_info.joints if joint.role != "fixed")])


def _print_columns(rows: Sequence[Sequence[str]]) -> None:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print_line("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def _row(joint: JointInfo) -> tuple[str, ...]:
    low, high, speed, acceleration, effort = (
        "-" if v is None else f"{v:.4g}"
        for v in (joint.lower, joint.upper, joint.velocity, joint.acceleration, joint.effort)
    )
    role = {"arm": "arm", "follower": f"= {joint.mimic}", "held": "held at neutral", "fixed": "fixed"}[joint.role]
    if joint.held_at is not None:
        role = f"held at {joint.held_at:.4g}"
    return joint.name, joint.type, f"{low} .. {high}", speed, acceleration, effort, role


def _geometry_counts(robot_info: pp.model.RobotInfo) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in robot_info.collisions.items()) or "none"
