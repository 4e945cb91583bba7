"""What kind of chain an arm is, read off the lines its joints turn about and slide along.

Which axes are parallel or meet in a point does not depend on q, if they are neighbours: it decides whether the inverse
kinematics has a closed form (Pieper 1968: three axes that meet, or three that are parallel).

All there is to say about a robot and one of its arms, as a value: for people, and for ``--json``.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.model.arm import Arm
from pinproof.model.chain import link_path
from pinproof.model.robot import Robot

__all__ = ["JointInfo", "RobotInfo", "kinematic_class", "robot_info"]

Array = npt.NDArray[np.float64]

PARALLEL_TOLERANCE = 1e-4
"""Rad. Axes this close to parallel count as such: URDFs write 1.5708 for pi/2 (4e-6 off), and some less."""

MEETING_TOLERANCE = 1e-5
"""Metres. Axes whose distances from one point are below this meet: what 4e-6 rad make of an arm of two metres."""

SAMPLES = 3
"""Configurations looked at: in a single one, axes that are not neighbours may meet by chance."""


def kinematic_class(arm: Arm) -> str:
    """A sentence on the arm's axes, such as ``"6 revolute joints (RRRRRR): spherical wrist (joints 4, 5, 6)"``.

    Says how many joints turn (R) and slide (P) in which order, where three neighbouring axes meet in a point (a
    spherical shoulder or wrist), and where three or more are parallel. It describes; whether a closed form holds to
    the last digit is for the solver to check.
    """
    pattern = "".join("R" if turns else "P" for turns in arm.angular)
    kinds = [
        f"{pattern.count(letter)} {word}"
        for letter, word in (("R", "revolute"), ("P", "prismatic"))
        if letter in pattern
    ]
    head = f"{' and '.join(kinds)} joint{'s' if arm.dof > 1 else ''} ({pattern})"
    if any(joint.mimic is not None for joint in link_path(arm.robot.urdf, arm.base, arm.tcp)):
        return f"{head}: coupled by mimic joints on the chain"
    features = [*_meeting(arm), *_parallel(arm)]
    if arm.dof > 6:
        features.append(f"redundant by {arm.dof - 6}")
    if arm.dof < 6:
        features.append("fewer than six joints: most poses cannot be reached exactly")
    return f"{head}: {'; '.join(features or ['no three neighbouring axes meet or are parallel'])}"


def _configurations(arm: Arm) -> Array:
    rng = np.random.default_rng(0)
    return rng.uniform(*arm.limits.sampling_range(), size=(SAMPLES, arm.dof))


def _meeting(arm: Arm) -> list[str]:
    """Triples of neighbouring turning axes that meet in one point."""
    screws = [arm.jacobian(q, reference="WORLD") for q in _configurations(arm)]
    found = []
    for first in range(arm.dof - 2):
        if not arm.angular[first : first + 3].all():
            continue
        if all(_miss(screw[:, first : first + 3]) < MEETING_TOLERANCE for screw in screws):
            place = "wrist" if first == arm.dof - 3 else "shoulder" if first == 0 else "joint"
            found.append(f"spherical {place} (joints {_numbers(first, first + 3)})")
    return found


def _miss(screws: Array) -> float:
    """The largest distance (m) of three lines, given as twists (6, 3), from the point nearest to them; inf if parallel.

    The line of a turning joint has the direction w and passes through w x v; the nearest point x solves
    sum (I - w w^T) (x - w x v) = 0, which has no single solution where all w are parallel.
    """
    axes, points = screws[3:].T, np.cross(screws[3:].T, screws[:3].T)
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    total = across.sum(axis=0)
    if np.linalg.eigvalsh(total)[0] < PARALLEL_TOLERANCE**2:
        return np.inf
    nearest = np.linalg.solve(total, np.einsum("kij,kj->i", across, points))
    return float(np.linalg.norm(np.einsum("kij,kj->ki", across, nearest - points), axis=1).max())


def _parallel(arm: Arm) -> list[str]:
    """Runs of three or more neighbouring axes with one direction."""
    screw = arm.jacobian(_configurations(arm)[0], reference="WORLD")
    axes = np.where(arm.angular, screw[3:], screw[:3]).T
    same = [bool(np.linalg.norm(np.cross(a, b)) < PARALLEL_TOLERANCE) for a, b in pairwise(axes)]
    found, first = [], 0
    for end in range(1, arm.dof + 1):
        if end < arm.dof and same[end - 1]:
            continue
        if end - first >= 3:
            count = {3: "three", 4: "four"}.get(end - first, str(end - first))
            some = f"{count} parallel axes (joints {_numbers(first, end)})"
            found.append("all axes parallel" if end - first == arm.dof else some)
        first = end
    return found


def _numbers(first: int, end: int) -> str:
    return ", ".join(str(i + 1) for i in range(first, end))


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
        What kind of chain the arm is (:func:`pinproof.model.info.kinematic_class`).
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


def robot_info(robot: Robot, arm: Arm) -> RobotInfo:
    """The properties of a robot and one of its arms; see :meth:`pinproof.Robot.info`."""
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
