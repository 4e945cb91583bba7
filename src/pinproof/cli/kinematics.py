"""``pinproof fk`` and ``pinproof ik``: forward and inverse kinematics."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING

import pinproof as pp
from pinproof.cli.complete import link_names, method_names
from pinproof.cli.console import print_result
from pinproof.cli.options import (
    ChainOptions,
    Configuration,
    Json,
    Robot,
    SceneOptions,
    Seed,
    ToolOptions,
    note_limits,
    numbers,
    option,
    parse_configuration,
)
from pinproof.errors import InputError
from pinproof.units import refuse_degrees

if TYPE_CHECKING:
    from pinproof.spatial import SE3


class TaskOption(str, Enum):
    """The part of the target pose that the solution must meet."""

    POSE = "pose"
    POSITION = "position"
    ORIENTATION = "orientation"
    SPIN_X = "spin_x"
    SPIN_Y = "spin_y"
    SPIN_Z = "spin_z"


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
    task: TaskOption = option(
        "What must match the target; spin_z leaves the rotation about tool z free.", TaskOption.POSE
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
    scene_options: SceneOptions,
    chain: ChainOptions,
    tool: ToolOptions,
    as_json: Json = False,
) -> None:
    """Compute joint values for a pose of the tcp, or of the tip of a tool.

    With --scene, --margin, --tool-of or --attached, the solution is also collision-free. Exit code 1 if no joint
    values are found.

    Example: pinproof ik ur5 --xyz "0.4 0.1 0.3" --rpy "pi 0 0"
    """
    solver = pp.ik.make_ik(method)
    if not xyz and task is not TaskOption.ORIENTATION:
        raise InputError('--xyz is missing; state the target position, for example --xyz "0.4 0.1 0.3"')
    if all_branches and (method not in ("clik", "analytic") or task is not TaskOption.POSE):
        raise InputError("--all uses the method analytic and full poses; remove --method and --task")
    angles = numbers(rpy, "--rpy", "roll pitch yaw")
    refuse_degrees("--rpy", angles)
    arm, tip = chain.arm(robot, tool=tool), tool.tip
    target = pp.pose(numbers(xyz, "--xyz", "x y z") if xyz else (0.0, 0.0, 0.0), angles)
    if tip is not None:
        if task is not TaskOption.POSE:
            raise InputError(
                "--task must be pose for a tool with a tip; remove --task, or the tip from the tool's file"
            )
        target = target * tip.inverse()
    # A margin without a scene applies between the links of the robot.
    checked = scene_options.scene is not None or scene_options.margin > 0.0 or any(tool.files)
    accept = scene_options.checker(arm, tool=tool).is_free if checked else None
    start = parse_configuration(q0, arm, "--q0")
    if all_branches:
        branches = pp.AnalyticIk().solve_all(arm, target, start)
        _print_all(branches if accept is None else branches.free(accept), as_json)
        return
    found = solver.solve(arm, target, start, rng=seed, task=task.value, accept=accept)
    if found.status is pp.ik.IkStatus.NOT_FOUND and task is TaskOption.POSE and pp.ik.is_provable(arm):
        found = _proven(found, arm, target, solver)
    named = dict(zip(arm.joint_names, found.q.tolist(), strict=True))
    errors = {"position_error": found.position_error, "orientation_error": found.orientation_error}
    data = {"ok": found.ok, "status": found.status.name, "q": named, **errors, "message": found.message}
    lines = [*(f"{name:30s} {_decimals(value)}" for name, value in named.items()), found.message]
    print_result(data, lines, as_json=as_json, ok=found.ok)


def _proven(found: pp.IkResult, arm: pp.Arm, target: SE3, solver: pp.ik.IterativeIk | pp.AnalyticIk) -> pp.IkResult:
    """The result, with the status IMPOSSIBLE if the target is proven to be out of reach."""
    tolerances = solver.position_tolerance, solver.orientation_tolerance
    proof = pp.prove_unreachable(
        arm, target, position_tolerance=tolerances[0], orientation_tolerance=tolerances[1], search=False
    )
    if not proof.proven:
        return found
    nearest = f"the nearest configuration found is {found.position_error * 1e3:.4g} mm and "
    nearest += f"{math.degrees(found.orientation_error):.3g} deg from it"
    return replace(found, status=pp.ik.IkStatus.IMPOSSIBLE, words=f"{proof.message}; {nearest}")


COLUMN = 10
"""Characters of a joint value in a table."""


def _print_all(found: pp.ik.IkBranches, as_json: bool) -> None:
    """Print the distinct IK solutions, nearest to ``q0`` first, and count those that differ by full rotations."""
    names = found.arm.joint_names
    rows = [dict(zip(names, q.tolist(), strict=True)) for q in found.branches]
    windings = f" ({len(found)} with full rotations)" if len(found) > len(found.branches) else ""
    lines = [
        ", ".join(f"q{k} = {name}" for k, name in enumerate(names, start=1)),
        " ".join(f"{f'q{k}':>{COLUMN}s}" for k in range(1, len(names) + 1)),  # 7 joints fit into 80 columns
        *(" ".join(f"{_decimals(value):>{COLUMN}s}" for value in q) for q in found.branches),
        f"{found.message}{windings}",
    ]
    data = {"ok": found.ok, "branches": rows, "with_full_rotations": len(found), "message": found.message}
    print_result(data, lines, as_json=as_json, ok=found.ok)


def _decimals(value: float) -> str:
    """A number with six decimals, and without a minus sign if it rounds to zero."""
    return f"{round(float(value), 6) + 0.0: .6f}"
