"""``pinproof info``, ``dh2urdf`` and ``urdf2dh``: the properties of a robot, and conversion between DH and URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING
from enum import Enum
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Any

import typer

import pinproof as pp
from pinproof.cli.complete import robot_names
from pinproof.cli.console import check_output_files, print_result, progress_status, written
from pinproof.cli.options import ChainOptions, Json, Robot, argument, option
from pinproof.errors import InputError, MeshError

if TYPE_CHECKING:
    from pinproof.model import JointInfo


class Convention(str, Enum):
    """The two conventions of Denavit-Hartenberg parameters."""

    STANDARD = "standard"
    MODIFIED = "modified"


def info(
    robot: Annotated[
        str | None,
        typer.Argument(
            help="A catalogue name such as ur5, a robot file, or a DH table. Without it, the catalogue is listed.",
            metavar="ROBOT",
            autocompletion=robot_names,
        ),
    ] = None,
    overlaps: bool = option(
        "Sample configurations, and list which pairs of links touch always, sometimes or never.", False
    ),
    samples: int = option("Number of configurations that --overlaps samples.", 1000, min=1),
    write_srdf: Path | None = option(
        "Write an SRDF that excludes adjacent links and links that touch in every sample; implies --overlaps.", None
    ),
    write_urdf: Path | None = option(
        "Write the URDF of the robot: expanded from a xacro file, or generated from a DH table.", None
    ),
    *,
    chain: ChainOptions,
    as_json: Json = False,
) -> None:
    """Print the joints, limits, frames, pairs of links, kinematic class and home of a robot, and what is not known.

    Example: pinproof info ur5
    """
    # Without a robot the catalogue is listed.
    if robot is None:
        from pinproof.description import catalogue_names

        if overlaps or write_srdf or write_urdf or chain != ChainOptions():
            raise InputError("missing argument 'ROBOT'; see 'pinproof info --help'")
        names = catalogue_names()
        print_result({"robots": names}, wrap(", ".join(names), 100), as_json=as_json)
        return
    check_output_files([write_srdf, write_urdf], [robot, *chain.files])
    arm = chain.arm(robot)
    if write_urdf is not None:
        arm.robot.save_urdf(write_urdf)
    if overlaps or write_srdf is not None:
        with progress_status("sampling configurations"):
            report = pp.collision.sample_overlaps(arm.robot, samples=samples)
        if write_srdf is not None:
            report.save_srdf(write_srdf)
        # The pairs by frequency, each with the proposal; those that never touch as one line.
        touching = [pair for pair in report.pairs if pair.touching or pair.reason]
        never = [" and ".join(pair.links) for pair in report.pairs if pair not in touching]
        table: list[tuple[str, ...]] = [("links", "in contact", "geometry", "SRDF", "proposal")]
        for pair in touching:
            share = f"{pair.touching} of {pair.samples}: {pair.frequency}"
            proposal = f"exclude: {pair.reason}" if pair.reason else "keep checking"
            table.append((" and ".join(pair.links), share, pair.geometry, pair.disabled or "-", proposal))
        sampled = f"{len(report.pairs)} pairs of links in {report.samples:,} sampled configurations of all joints"
        lines = [
            f"{report.robot.name}: {sampled}",
            *_in_columns(table),
            f"never in contact in these samples: {len(never)} pairs{': ' if never else ''}{', '.join(never)}",
            "proposed: exclude adjacent links and links that touch in every sample, and check all others",
            "samples do not prove that links never touch",
            *written(write_srdf, write_urdf),
        ]
        print_result(report.to_dict(), lines, as_json=as_json)
        return
    # A robot whose meshes are missing still has joints and frames to print.
    robot_info = arm.robot.info(arm)
    try:
        checker = pp.CollisionChecker(arm)
    except MeshError as error:
        pairs: dict[str, Any] = {"checked": None, "excluded": [], "why": str(error)}
    else:
        excluded = [[*pair.owners, pair.reason] for pair in checker.excluded]
        pairs = {"checked": len(checker.pairs), "excluded": excluded, "why": ""}
    geometry = ", ".join(f"{count} {kind}" for kind, count in robot_info.collisions.items()) or "none"
    checked = f"{pairs['checked']} checked, {len(pairs['excluded'])} excluded"
    lists = {"groups": robot_info.groups, "states": robot_info.states, "end effectors": robot_info.end_effectors}
    joints = f"{robot_info.dof} joints from {robot_info.base} to {robot_info.tcp}; {robot_info.kinematic_class}"
    lines = [
        f"{robot_info.name}: {joints}",
        f"file: {robot_info.source}" if robot_info.source else "loaded from text",
        *_in_columns([JOINT_COLUMNS, *(_row(joint) for joint in robot_info.joints if joint.role != "fixed")]),
        f"frames: {', '.join(robot_info.frames)}",
        f"collision geometry: {geometry}",
        f"self-collision pairs: {f'none can be checked: {why}' if (why := pairs['why']) else checked}",
        *(f"  {first} and {second}: {reason}" for first, second, reason in pairs["excluded"]),
        *(f"{name}: {', '.join(values)}" for name, values in lists.items() if values),
        "home: " + ", ".join(f"{name} {value:.4g}" for name, value in robot_info.home.items()),
        *(f"missing: {sentence}" for sentence in robot_info.missing),
        *written(write_urdf),
    ]
    print_result({**robot_info.to_dict(), "pairs": pairs}, lines, as_json=as_json)


JOINT_COLUMNS = ("joint", "type", "limits", "speed", "accel.", "effort", "role")


def _in_columns(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _row(joint: JointInfo) -> tuple[str, ...]:
    low, high, speed, acceleration, effort = (
        "-" if v is None else f"{v:.4g}"
        for v in (joint.lower, joint.upper, joint.velocity, joint.acceleration, joint.effort)
    )
    role = {"arm": "arm", "follower": f"= {joint.mimic}", "held": "held at neutral", "fixed": "fixed"}[joint.role]
    if joint.held_at is not None:
        role = f"held at {joint.held_at:.4g}"
    return joint.name, joint.type, f"{low} .. {high}", speed, acceleration, effort, role


def dh2urdf(
    table: Path = argument("A DH table (.yaml, .csv).", MISSING, metavar="TABLE"),
    output: Path = option("The URDF file to write.", MISSING, "-o", "--output"),
    as_json: Json = False,
) -> None:
    """Convert a DH table to a URDF file.

    The file is written only if all frames of the URDF agree with the table.

    Example: pinproof dh2urdf robots/generic_6dof/dh.yaml -o generic_6dof.urdf
    """
    check_output_files([output], [table])
    rows = pp.DhTable.load(table)
    pp.write_urdf(rows, output)
    data = {"urdf": str(output), "robot": rows.name, "joints": list(rows.joint_names)}
    line = f"wrote {output}: {rows.name}, {len(rows.joint_names)} joints; all frames agree with the table"
    print_result(data, [line], as_json=as_json)


def urdf2dh(
    robot: Robot,
    output: Path = option("The DH table to write (.yaml, .csv).", MISSING, "-o", "--output"),
    convention: Convention = option("Convention of the table.", Convention.STANDARD),
    *,
    chain: ChainOptions,
    as_json: Json = False,
) -> None:
    """Compute the DH table of an arm.

    The command fails if no table describes the arm exactly.

    Example: pinproof urdf2dh ur5 -o ur5.yaml
    """
    check_output_files([output], [robot, *chain.files])
    arm = chain.arm(robot)
    rows = pp.urdf_to_dh(arm, convention=convention.value)
    rows.save(output)
    data = {"table": str(output), "robot": rows.name, "joints": list(rows.joint_names)}
    line = f"wrote {output}: {rows.name}, {len(rows.joint_names)} rows ({convention.value} convention)"
    print_result(data, [line], as_json=as_json)
