"""``pinproof info``: print the properties of a robot and what its files do not state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pinproof as pp
from pinproof.cli.console import print_json, print_line
from pinproof.cli.options import ChainOptions, Json, Robot
from pinproof.errors import MeshError

if TYPE_CHECKING:
    from pinproof.model import JointInfo

__all__ = ["info"]


def info(
    robot: Robot,
    *,
    chain: ChainOptions,
    as_json: Json = False,
) -> None:
    """Print the joints, limits, frames, collision pairs, kinematic class and home of a robot, and missing data.

    Example: pinproof info ur5
    """
    arm = chain.arm(robot)
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


def _print_joints(robot_info: pp.model.RobotInfo) -> None:
    header = ("joint", "type", "limits", "speed", "accel.", "effort", "role")
    rows = [header, *(_row(joint) for joint in robot_info.joints if joint.role != "fixed")]
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
