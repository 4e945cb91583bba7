"""``pinproof info``: what a robot is, and what is not known about it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pinproof as pp
from pinproof.cli.console import print_json, say
from pinproof.cli.options import Chain, Json, Robot
from pinproof.errors import MeshError

if TYPE_CHECKING:
    from pinproof.model import JointInfo

__all__ = ["info"]


def info(
    robot: Robot,
    *,
    chain: Chain,
    as_json: Json = False,
) -> None:
    """Print joints, limits, frames, collision pairs, kinematic class and home of a robot, and what is missing.

    Example: pinproof info ur5
    """
    arm = chain.arm(robot)
    told = arm.robot.info(arm)
    try:
        checker = pp.CollisionChecker(arm)
    except MeshError as error:
        pairs: dict[str, object] = {"checked": None, "excluded": [], "why": str(error)}
    else:
        excluded = [[*pair.owners, pair.reason] for pair in checker.excluded]
        pairs = {"checked": len(checker.pairs), "excluded": excluded, "why": ""}
    if as_json:
        print_json({**told.to_dict(), "pairs": pairs})
        return
    say(f"{told.name}: {told.dof} joints from {told.base} to {told.tcp}; {told.kinematic_class}")
    say(f"file: {told.source}" if told.source else "from text")
    _joints(told)
    say(f"frames: {', '.join(told.frames)}")
    say(f"collision geometry: {_counted(told)}")
    if pairs["checked"] is None:
        say(f"collision pairs: none can be checked: {pairs['why']}")
    else:
        say(f"collision pairs of the robot itself: {pairs['checked']} checked, {len(checker.excluded)} left out")
        for first, second, reason in excluded:
            say(f"  {first} and {second}: {reason}")
    for name, values in (("groups", told.groups), ("states", told.states), ("end effectors", told.end_effectors)):
        if values:
            say(f"{name}: {', '.join(values)}")
    say("home: " + ", ".join(f"{name} {value:.4g}" for name, value in told.home.items()))
    for sentence in told.missing:
        say(f"missing: {sentence}")


def _joints(told: pp.model.RobotInfo) -> None:
    heads = ("joint", "type", "limits", "speed", "accel.", "role")
    rows = [heads, *(_row(joint) for joint in told.joints if joint.role != "fixed")]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        say("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def _row(joint: JointInfo) -> tuple[str, ...]:
    low, high, speed, acceleration = (
        "-" if v is None else f"{v:.4g}" for v in (joint.lower, joint.upper, joint.velocity, joint.acceleration)
    )
    role = {"arm": "arm", "follower": f"= {joint.mimic}", "held": "held at neutral", "fixed": "fixed"}[joint.role]
    if joint.held_at is not None:
        role = f"held at {joint.held_at:.4g}"
    return joint.name, joint.type, f"{low} .. {high}", speed, acceleration, role


def _counted(told: pp.model.RobotInfo) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in told.collisions.items()) or "none"
