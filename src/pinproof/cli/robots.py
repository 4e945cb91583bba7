"""``pinproof info``, ``fk``, ``ik``, ``bench``, ``dh2urdf``, ``urdf2dh``, ``schema``: robots and formats."""

from __future__ import annotations

import json
import math
from dataclasses import MISSING, asdict, replace
from pathlib import Path
from textwrap import wrap
from typing import Annotated, Any, Literal

import typer

import pinproof as pp
from pinproof.cli.console import check_output_files, print_json, print_result, progress_status, written
from pinproof.cli.options import (
    ChainOptions,
    Configuration,
    Json,
    Robot,
    Seed,
    SetupOptions,
    argument,
    format_names,
    link_names,
    method_names,
    note_limits,
    option,
    parse_configuration,
    robot_names,
)
from pinproof.common.files import write_text_whole
from pinproof.common.results import Rows
from pinproof.errors import InputError, MeshError
from pinproof.formats import FORMATS


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
        lines = [report.to_text(), *written(write_srdf, write_urdf)]
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
    checked = f"{pairs['checked']} checked, {len(pairs['excluded'])} excluded"
    lines = [
        robot_info.to_text(),
        f"self-collision pairs: {f'none can be checked: {why}' if (why := pairs['why']) else checked}",
        *(f"  {first} and {second}: {reason}" for first, second, reason in pairs["excluded"]),
        *written(write_urdf),
    ]
    print_result({**robot_info.to_dict(), "pairs": pairs}, lines, as_json=as_json)


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
    data = {"urdf": str(output), "robot": rows.name, "joints": list(rows.joint_names), "notes": rows.notes}
    line = f"wrote {output}: {rows.name}, {len(rows.joint_names)} joints; all frames agree with the table"
    print_result(data, [line, *rows.notes], as_json=as_json)


def urdf2dh(
    robot: Robot,
    output: Path = option("The DH table to write (.yaml, .csv).", MISSING, "-o", "--output"),
    convention: Literal["standard", "modified"] = option("Convention of the table.", "standard"),
    like: Literal["ur", "franka"] | None = option(
        "The manufacturer (Universal Robots, Franka) whose published table is written, with its convention and signs.",
        None,
    ),
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
    rows = pp.urdf_to_dh(arm, convention=convention, like=like)
    rows.save(output)
    data = {"table": str(output), "robot": rows.name, "joints": list(rows.joint_names), "notes": rows.notes}
    line = f"wrote {output}: {rows.name}, {len(rows.joint_names)} rows ({rows.convention} convention)"
    print_result(data, [line, *rows.notes], as_json=as_json)


def schema(
    name: str = argument(f"The format: {', '.join(FORMATS)}.", MISSING, metavar="FORMAT", autocompletion=format_names),
    output: Path | None = option("Write the schema to this file.", None, "-o", "--output"),
    as_json: Json = False,
) -> None:
    """Print the JSON Schema of a file format, with which an editor completes keys and marks errors.

    Example: pinproof schema picks -o picks.schema.json
    """
    check_output_files([output])
    found = pp.formats.file_schema(name)
    if output is None:
        print_json(found)
        return
    write_text_whole(output, json.dumps(found, indent=2, ensure_ascii=False) + "\n")
    print_result({"schema": str(output)}, written(output), as_json=as_json)


COLUMN = 10
"""Characters of a joint value in a table: seven joints fit into 80 columns."""


def fk(
    robot: Robot,
    q: Configuration = None,
    frame: str | None = option(
        "The link whose pose is printed. Default: the tcp.", None, autocompletion=link_names, metavar="LINK"
    ),
    *,
    chain: ChainOptions,
    as_json: Json = False,
) -> None:
    """Print the pose of the tcp, or of another frame, for given joint values.

    Example: pinproof fk ur5 --q "0 -pi/2 pi/2 -pi/2 -pi/2 0"
    """
    arm = chain.arm(robot)
    configuration = parse_configuration(q, arm, "--q")
    note_limits(arm, configuration)
    placement = arm.frame_placement(configuration, frame or arm.tcp)
    vector = pp.xyz_rpy(placement)
    named = dict(zip(arm.joint_names, configuration.tolist(), strict=True))
    place = {"xyz": vector[:3].tolist(), "rpy": vector[3:].tolist(), "matrix": placement.homogeneous.tolist()}
    lines = [
        f"{arm.base} -> {frame or arm.tcp}",
        "xyz [m]   " + " ".join(_decimals(value) for value in vector[:3]),
        "rpy [rad] " + " ".join(_decimals(value) for value in vector[3:]),
    ]
    print_result({"base": arm.base, "frame": frame or arm.tcp, "q": named, **place}, lines, as_json=as_json)


def ik(
    robot: Robot,
    xyz: str = option(
        'Target position of the tcp, or of the tip of the tool, in metres: "0.4 0.1 0.3".', "", metavar="POSITION"
    ),
    rpy: str = option('Target roll, pitch and yaw in radians: "pi 0 0".', "0 0 0", metavar="ANGLES"),
    task: Literal["pose", "position", "orientation", "spin_x", "spin_y", "spin_z"] = option(
        "What must match the target; spin_z leaves the rotation about tool z free.", "pose"
    ),
    method: str = option(
        "The IK method: clik, analytic, damped_least_squares, pseudo_inverse or fabrik.",
        "clik",
        autocompletion=method_names,
        metavar="METHOD",
    ),
    all_branches: bool = option("Print all IK solutions; for arms with at most seven joints.", False, "--all"),
    q0: str | None = option("Joint values where the search starts. Default: home.", None, metavar="VALUES"),
    seed: Seed = 0,
    *,
    setup: SetupOptions,
    as_json: Json = False,
) -> None:
    """Compute joint values for a pose of the tcp, or of the tip of a tool.

    With --scene, --margin, --tool-of or --attached, the solution is also collision-free. Exit code 1 if no joint
    values are found.

    Example: pinproof ik ur5 --xyz "0.4 0.1 0.3" --rpy "pi 0 0"
    """
    # Contradictions are refused before the robot is loaded
    solver = pp.ik.make_ik(method)
    if not xyz and task != "orientation":
        raise InputError('--xyz is missing; state the target position, for example --xyz "0.4 0.1 0.3"')
    if all_branches and (method not in ("clik", "analytic") or task != "pose"):
        raise InputError("--all uses the method analytic and full poses; remove --method and --task")
    arm, target = setup.arm(robot), setup.target(xyz or "0 0 0", rpy)
    if task != "pose" and setup.has_tool and not setup.attachments.tip.isIdentity():
        raise InputError("--task must be pose for a tool with a tip; remove --task, or the tip from the tool's file")
    # A margin without a scene applies between the links of the robot.
    accept = setup.checker(arm).is_free if setup.surrounds or setup.margin > 0.0 else None
    start = parse_configuration(q0, arm, "--q0")
    if all_branches:
        # The distinct solutions, nearest to q0 first; those that differ by full rotations are counted only.
        found = pp.AnalyticIk().solve_all(arm, target, start)
        found = found if accept is None else found.free(accept)
        rows = [dict(zip(arm.joint_names, q.tolist(), strict=True)) for q in found.branches]
        windings = f" ({len(found)} with full rotations)" if len(found) > len(rows) else ""
        lines = [
            ", ".join(f"q{k} = {name}" for k, name in enumerate(arm.joint_names, start=1)),
            " ".join(f"{f'q{k}':>{COLUMN}s}" for k in range(1, arm.dof + 1)),
            *(" ".join(f"{_decimals(value):>{COLUMN}s}" for value in q) for q in found.branches),
            f"{found.message}{windings}",
        ]
        data = {"ok": found.ok, "branches": rows, "with_full_rotations": len(found), "message": found.message}
        print_result(data, lines, as_json=as_json, ok=found.ok)
        return
    # A pose that was not found may be proven out of reach
    result = solver.solve(arm, target, start, rng=seed, task=task, accept=accept)
    if result.status is pp.ik.IkStatus.NOT_FOUND and task == "pose" and pp.ik.is_provable(arm):
        proof = pp.prove_unreachable(
            arm,
            target,
            position_tolerance=solver.position_tolerance,
            orientation_tolerance=solver.orientation_tolerance,
            search=False,
        )
        if proof.proven:
            nearest = f"the nearest configuration found is {result.position_error * 1e3:.4g} mm and "
            nearest += f"{math.degrees(result.orientation_error):.3g} deg from it"
            result = replace(result, status=pp.ik.IkStatus.IMPOSSIBLE, words=f"{proof.message}; {nearest}")
    named = dict(zip(arm.joint_names, result.q.tolist(), strict=True))
    errors = {"position_error": result.position_error, "orientation_error": result.orientation_error}
    data = {"ok": result.ok, "status": result.status.name, "q": named, **errors, "message": result.message}
    lines = [*(f"{name:30s} {_decimals(value)}" for name, value in named.items()), result.message]
    print_result(data, lines, as_json=as_json, ok=result.ok)


def _decimals(value: float) -> str:
    """A number with six decimals, and without a minus sign if it rounds to zero."""
    return f"{round(float(value), 6) + 0.0: .6f}"


def bench(
    robot: Robot,
    points: int = option("Number of random poses.", 10_000, min=1),
    methods: str | None = option(
        'Methods to run, for example "clik pseudo_inverse". Default: all.', None, metavar="METHODS"
    ),
    *,
    chain: ChainOptions,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Compare the IK methods on random poses of an arm: time, success rate, largest error.

    Every answer is checked by forward kinematics and the limits. The textbook's figures are beside those measured.

    Example: pinproof bench ur5 --points 200
    """
    from pinproof.ik import bench

    arm = chain.arm(robot)
    selected = tuple(pp.ik.IK_METHODS) if methods is None else methods.replace(",", " ").split()
    with progress_status("running the IK benchmark") as report:
        rows, left_out = bench(arm, points=points, methods=selected, rng=seed, on_progress=report)
    # The figures of each method, beside those of the textbook
    table = []
    for row in rows:
        solved = f"{100 * row.success:.2f} % within {row.tolerance:g}"
        error = f"{row.position_error:.1e} m" + (f", {row.orientation_error:.1e} rad" if row.task == "pose" else "")
        textbook = "" if row.textbook_ms is None else f"{row.textbook_ms:g} ms, {100 * (row.textbook_success or 0):g} %"
        times = f"{row.mean_ms:.4f}", f"{row.median_ms:.4f}"
        table.append((row.method, row.task, row.restarts, *times, solved, row.false_positives, error, textbook))
    columns = ("method", "task", "restarts", "mean, ms", "median, ms", "success", "false positives", "largest error")
    lines = [Rows((*columns, "textbook"), table).markdown()]
    lines += [f"not applicable: {name}: {reason}" for name, reason in left_out.items()]
    data = {"robot": arm.robot.name, "points": points, "seed": seed, "rows": [asdict(row) for row in rows]}
    print_result({**data, "left_out": left_out}, lines, as_json=as_json)
