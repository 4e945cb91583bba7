"""All there is to say about a robot and one of its arms, as a value: for people, and for ``--json``."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from pinproof.model.arm import Arm
from pinproof.model.kinematic_class import kinematic_class
from pinproof.model.robot import Robot

__all__ = ["JointInfo", "RobotInfo", "describe"]

Role = Literal["arm", "follower", "held", "fixed"]


@dataclass(frozen=True)
class JointInfo:
    """A joint of the robot.

    Parameters
    ----------
    name, type, parent, child
        As in the URDF; parent and child are links.
    role
        ``arm``: one of q. ``follower``: a mimic joint that moves with one of q. ``held``: stands at ``held_at`` (rad or
        m; None for a floating or planar joint). ``fixed``.
    lower, upper, velocity, acceleration
        The limits in use, in rad or m, per s, per s^2; None where there is none.
    mimic
        ``"multiplier * leader + offset"``; empty if it follows none.
    """

    name: str
    type: str
    parent: str
    child: str
    role: Role
    lower: float | None
    upper: float | None
    velocity: float | None
    acceleration: float | None
    held_at: float | None = None
    mimic: str = ""


@dataclass(frozen=True)
class RobotInfo:
    """A robot and one of its arms in plain values.

    Parameters
    ----------
    name, source
        The robot's name, and its file (empty for a robot from text).
    base, tcp, dof
        Of the arm.
    kinematic_class
        What kind of chain the arm is (:func:`pinproof.model.kinematic_class.kinematic_class`).
    joints
        Every joint of the robot, in the file's order.
    frames
        Every link, in the file's order; any of them can be a base or a tcp.
    collisions, visuals
        How many geometries there are of each kind.
    groups, states, end_effectors
        Names in the SRDF.
    disabled_pairs
        Pairs of links that the SRDF takes out of collision checks: (link, link, reason).
    home
        The arm's home, joint name to rad or m.
    acceleration_source
        Where the acceleration limits come from.
    missing
        What is not known or odd, in sentences: no SRDF, no limits, meshes not found, names that do not exist.
    """

    name: str
    source: str
    base: str
    tcp: str
    dof: int
    kinematic_class: str
    joints: tuple[JointInfo, ...]
    frames: tuple[str, ...]
    collisions: Mapping[str, int]
    visuals: Mapping[str, int]
    groups: tuple[str, ...]
    states: tuple[str, ...]
    end_effectors: tuple[str, ...]
    disabled_pairs: tuple[tuple[str, str, str], ...]
    home: Mapping[str, float]
    acceleration_source: str
    missing: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The same as nested dicts and lists of what JSON knows; no NaN and no infinity in it."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def describe(robot: Robot, arm: Arm) -> RobotInfo:
    """All there is to say about a robot and one of its arms."""
    urdf, srdf = robot.urdf, robot.srdf
    return RobotInfo(
        name=robot.name,
        source="" if urdf.path is None else str(urdf.path),
        base=arm.base,
        tcp=arm.tcp,
        dof=arm.dof,
        kinematic_class=kinematic_class(arm),
        joints=tuple(_joint(arm, name) for name in urdf.joints),
        frames=urdf.links,
        collisions=dict(Counter(geometry.kind for geometry in urdf.collisions)),
        visuals=dict(Counter(geometry.kind for geometry in urdf.visuals)),
        groups=tuple(srdf.groups),
        states=tuple(dict.fromkeys(state.name for state in srdf.states)),
        end_effectors=tuple(effector.name for effector in srdf.end_effectors),
        disabled_pairs=tuple((*pair.links, pair.reason) for pair in srdf.disabled),
        home=dict(zip(arm.joint_names, map(float, arm.home), strict=True)),
        acceleration_source=arm.limits.acceleration_source,
        missing=_missing(robot, arm),
    )


def _joint(arm: Arm, name: str) -> JointInfo:
    joint = arm.robot.urdf.joints[name]
    ends = (joint.name, joint.type, joint.parent, joint.child)
    mimic = "" if joint.mimic is None else f"{joint.mimic.multiplier:g} * {joint.mimic.leader} + {joint.mimic.offset:g}"
    if name in arm.joint_names:
        i = arm.joint_names.index(name)
        limits = arm.limits
        return JointInfo(
            *ends,
            role="arm",
            lower=_known(limits.lower[i]),
            upper=_known(limits.upper[i]),
            velocity=_known(limits.velocity[i]),
            acceleration=_known(limits.acceleration[i]),
            mimic=mimic,
        )
    role: Role = "follower" if name in arm.followers else "fixed" if joint.type == "fixed" else "held"
    held_at = arm.held.get(name) if role == "held" else None
    return JointInfo(*ends, role, joint.lower, joint.upper, joint.velocity, None, held_at, mimic)


def _missing(robot: Robot, arm: Arm) -> tuple[str, ...]:
    said = []
    if robot.srdf.path is None and not robot.srdf.disabled:
        said.append("no SRDF: no groups, no named states, and only neighbouring links may touch")
    if not robot.urdf.collisions:
        said.append("no collision geometry: nothing of the robot can collide")
    slow = [name for name, v in zip(arm.joint_names, arm.limits.velocity, strict=True) if np.isnan(v)]
    if slow:
        said.append(f"no velocity limit: {', '.join(slow)}")
    if arm.limits.acceleration_source.startswith("default"):
        said.append(f"no acceleration limits; {arm.limits.acceleration_source}")
    endless = [n for n, low in zip(arm.joint_names, arm.limits.lower, strict=True) if np.isinf(low)]
    if endless:
        said.append(f"no position limits (continuous): {', '.join(endless)}")
    if not robot.home:
        said.append("no home: the middle of the limits stands for it")
    return (*said, *robot.notes)


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(inner) for inner in value]
    return value
