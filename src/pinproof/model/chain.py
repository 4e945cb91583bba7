"""The chain of an arm: joints from base to tcp, mimic joints, reduced Pinocchio model, compiled chain, SRDF groups.

The configuration of the reduced Pinocchio model is an affine function of the configuration q of the arm::

    q_model = scale @ q + offset

The row of a joint of the arm is e_j, the row of a mimic follower is multiplier * e_leader. The same matrix maps q to
the model and Jacobians of the model to the arm.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from numbers import Real
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Chain as CompiledChain
from pinproof._core import Joint
from pinproof.common.validation import require_type
from pinproof.description import Srdf, Urdf, UrdfJoint
from pinproof.errors import InputError, UnknownNameError
from pinproof.model.limits import DEFAULT_RAMP, JointLimits, LimitsFile
from pinproof.spatial import Array

MAX_JOINTS = 250
"""Largest number of joints of an arm; creating ``pinocchio.Data`` takes 1 s for 250 joints and 100 s for 900."""

LimitsLike: TypeAlias = JointLimits | LimitsFile | Mapping[str, tuple[float, float]] | None

DH_FRAME = re.compile(r"dh_\d+")

MOVING = ("revolute", "continuous", "prismatic")

AXES_KEPT = 256
"""Number of directions of axes of which the rotation is kept: those of one robot are few, and the same in every arm."""


@dataclass(frozen=True, eq=False)
class Chain:
    """The n joints of an arm or of a joint group."""

    joint_names: tuple[str, ...]  # from base to tcp; those of a group arm by arm
    angular: npt.NDArray[np.bool_]  # (n,) False for a prismatic joint
    followers: tuple[str, ...]  # all mimic joints of the robot that follow these joints, on the chain or not
    limits: JointLimits  # tightened by the limits of their followers


def link_path(urdf: Urdf, base: str, tip: str) -> list[UrdfJoint]:
    """Return the joints from link ``base`` to link ``tip``, in this order.

    Raises
    ------
    InputError
        If ``base`` is not on the path from the root to ``tip``.
    """
    by_child = {joint.child: joint for joint in urdf.joints.values()}
    path, link = [], tip
    while link != base:
        if link not in by_child:
            raise InputError(f"base {base!r} is not on the path from the root link {urdf.root!r} to {tip!r}")
        path.append(by_child[link])
        link = path[-1].parent
    return path[::-1]


def find_chain(urdf: Urdf, *ends: tuple[str, str]) -> Chain:
    """Find the joints of one or several arms, each of which is given by its base link and its tip link.

    A joint of several arms is listed with the first one.

    InputError if no joint moves between the ends of an arm, more than :data:`MAX_JOINTS` do, or one is floating or
    planar.
    """
    names = list(dict.fromkeys(name for base, tip in ends for name in moving_joints(urdf, base, tip)))
    if len(names) > MAX_JOINTS:
        between = " and ".join(f"between {base!r} and {tip!r}" for base, tip in ends)
        raise InputError(f"{len(names)} joints are {between}; the limit is {MAX_JOINTS}")
    return chain_of(urdf, names)


def chain_of(urdf: Urdf, names: Sequence[str]) -> Chain:
    """Return any independent single-axis joints of a robot as those of a joint group."""
    followers = tuple(j.name for j in urdf.joints.values() if j.mimic is not None and j.mimic.leader in names)
    angular = np.array([urdf.joints[name].type != "prismatic" for name in names])
    angular.setflags(write=False)
    return Chain(tuple(names), angular, followers, _limits(urdf, names, followers))


def moving_joints(urdf: Urdf, base: str, tip: str) -> tuple[str, ...]:
    """Return the independent joints that move link ``tip`` relative to link ``base``; a mimic joint is its leader.

    InputError if no joint moves it, or one is floating or planar.
    """
    names: dict[str, None] = {}
    for joint in link_path(urdf, base, tip):
        if joint.type in ("floating", "planar"):
            raise InputError(
                f"joint {joint.name!r} between {base!r} and {tip!r} is {joint.type}; an arm has single-axis joints only"
            )
        if joint.type != "fixed":
            names[joint.name if joint.mimic is None else joint.mimic.leader] = None
    if not names:
        raise InputError(f"no joint moves {tip!r} relative to {base!r}; select a tcp that the joints of the arm move")
    return tuple(names)


def affine(urdf: Urdf, chain: Chain, model_joints: tuple[str, ...]) -> tuple[Array, Array]:
    """Return ``scale`` (m, n) and ``offset`` (m,) for the m joints of a reduced model."""
    scale, offset = np.zeros((len(model_joints), len(chain.joint_names))), np.zeros(len(model_joints))
    own_name = {urdf.model_joint(name): name for name in urdf.joints}
    for row, name in enumerate(own_name[joint] for joint in model_joints):
        mimic = urdf.joints[name].mimic
        if mimic is None:
            scale[row, chain.joint_names.index(name)] = 1.0
        else:
            scale[row, chain.joint_names.index(mimic.leader)] = mimic.multiplier
            offset[row] = mimic.offset
    return scale, offset


def periodic(urdf: Urdf, chain: Chain) -> npt.NDArray[np.bool_]:
    """Return (n,) True for joints where q and q + 2 pi give the same pose of every link of the robot.

    This holds for angular joints all of whose followers are angular with an integer multiplier.
    """
    unchanged = chain.angular.copy()
    for follower in (urdf.joints[name] for name in chain.followers):
        mimic = follower.mimic
        if mimic is not None and (follower.type == "prismatic" or mimic.multiplier != round(mimic.multiplier)):
            unchanged[chain.joint_names.index(mimic.leader)] = False
    unchanged.setflags(write=False)
    return unchanged


def held_values(urdf: Urdf, chain: Chain, held: Mapping[str, float], home: Mapping[str, float]) -> dict[str, float]:
    """Return the value of every single-axis joint outside the arm; mimic joints follow their leaders.

    The value is taken from ``held``, else from ``home``, else it is 0 or the limit closest to 0.

    Raises
    ------
    UnknownNameError, InputError
        If a joint in ``held`` does not exist, belongs to the arm or is a mimic joint, or its value is not a number.
    """
    require_type("held", held, Mapping)
    outside = [
        j for j in urdf.joints.values() if j.type in MOVING and j.name not in (*chain.joint_names, *chain.followers)
    ]
    free = [j.name for j in outside if j.mimic is None]
    # only independent joints outside the arm can be held
    for name, value in held.items():
        if name in chain.joint_names:
            raise InputError(f"joint {name!r} belongs to the arm; its value is set by q, not by held")
        if name in urdf.joints and urdf.joints[name].type in ("floating", "planar"):
            raise InputError(f"joint {name!r} is {urdf.joints[name].type}; it is fixed at its neutral configuration")
        if name not in free:
            raise UnknownNameError("joint", name, free, "the joints outside the arm that can be held")
        if not isinstance(value, Real) or not np.isfinite(float(value)):
            raise InputError(f"the value of held joint {name!r} must be a finite number, not {value!r}")
    # their values first, then those of the joints that follow them
    values: dict[str, float] = {}
    for joint in outside:
        if joint.mimic is None:
            low, high = joint.bounds
            values[joint.name] = float(held.get(joint.name, home.get(joint.name, min(max(0.0, low), high))))
    for joint in outside:
        if joint.mimic is not None:
            values[joint.name] = joint.mimic.multiplier * values[joint.mimic.leader] + joint.mimic.offset
    return values


def _limits(urdf: Urdf, names: Sequence[str], followers: tuple[str, ...]) -> JointLimits:
    """Return the limits of the joints; infinite positions and NaN velocities where the file states none."""
    joints = [urdf.joints[name] for name in names]
    lower, upper = np.array([joint.bounds for joint in joints]).T
    velocity, torque = (
        np.array([np.nan if value is None else value for value in values])
        for values in ([joint.velocity for joint in joints], [joint.effort for joint in joints])
    )
    own = JointLimits(lower, upper, velocity, torque=None if np.isnan(torque).all() else torque)
    return _with_followers(urdf, names, followers, own, LimitsFile(Path()))


def chosen_limits(urdf: Urdf, chain: Chain, limits: LimitsLike) -> JointLimits:
    """Return the limits of the joints of a chain, with those that the caller gives instead.

    InputError if the number of joints differs, or a joint has no limits.
    """
    require_type("limits", limits, JointLimits, LimitsFile, Mapping, type(None))
    if isinstance(limits, JointLimits):
        check_count(limits, chain.joint_names)
        return limits
    if isinstance(limits, LimitsFile):
        file, position = limits, limits.position
        chosen = file.over(chain.limits, chain.joint_names, list(urdf.joints))
    else:
        file, position = LimitsFile(Path()), limits or {}
        chosen = chain.limits.replace(chain.joint_names, position)
    # a joint that turns without end is continuous; any other must have limits
    for name in chain.joint_names:
        joint = urdf.joints[name]
        if joint.type != "continuous" and (joint.lower is None or joint.upper is None) and name not in position:
            raise InputError(
                f"{joint.type} joint {name!r} states no lower and upper limit; state both in the URDF, or in a file of "
                f"joint limits (--limits); in Python also limits={{{name!r}: (lower, upper)}}"
            )
    return chosen if limits is None else _with_followers(urdf, chain.joint_names, chain.followers, chosen, file)


def _with_followers(
    urdf: Urdf, names: Sequence[str], followers: Sequence[str], limits: JointLimits, file: LimitsFile
) -> JointLimits:
    """Tighten the limits of joints by those of their followers, which a file may state too."""
    lower, upper, velocity = limits.lower.copy(), limits.upper.copy(), limits.velocity.copy()
    acceleration, guessed = limits.acceleration.copy(), limits.guessed.copy()
    for joint in (urdf.joints[name] for name in followers):
        if joint.mimic is None or joint.mimic.multiplier == 0.0:
            continue
        leader, scale = names.index(joint.mimic.leader), joint.mimic.multiplier
        ends = sorted((end - joint.mimic.offset) / scale for end in file.position.get(joint.name, joint.bounds))
        lower[leader], upper[leader] = max(lower[leader], ends[0]), min(upper[leader], ends[1])
        if lower[leader] > upper[leader]:
            raise InputError(
                f"the limits of {joint.mimic.leader!r} and of its mimic joint {joint.name!r} do not overlap"
            )
        rate = file.velocity.get(joint.name, joint.velocity)
        velocity[leader] = np.fmin(velocity[leader], np.inf if rate is None else rate / abs(scale))
        # an acceleration that the file states replaces one that is guessed from the velocity
        if joint.name in file.acceleration:
            known = file.acceleration[joint.name] / abs(scale)
            acceleration[leader] = known if guessed[leader] else np.fmin(acceleration[leader], known)
            guessed[leader] = False
    velocity[np.isinf(velocity)] = np.nan
    acceleration[guessed] = velocity[guessed] / DEFAULT_RAMP
    return replace(limits, lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, guessed=guessed)


def check_count(limits: JointLimits, joint_names: Sequence[str]) -> None:
    """InputError unless there is a limit for each joint."""
    if len(limits) != len(joint_names):
        names = ", ".join(joint_names)
        raise InputError(f"the limits are of {len(limits)} joints; the arm has {len(joint_names)}: {names}")


def reduced_model(urdf: Urdf, model: pin.Model, moving: set[str], held: Mapping[str, float]) -> pin.Model:
    """Lock every joint outside ``moving`` at its held value (floating and planar joints at the neutral one)."""
    q = pin.neutral(model)
    lock = []
    for name in urdf.joints:
        index = model.getJointId(urdf.model_joint(name))
        if index == model.njoints or name in moving:  # the model has no fixed joints
            continue
        lock.append(index)
        if name in held:
            q[model.joints[index].idx_q] = held[name]
    return pin.buildReducedModel(model, lock, q)


def compiled_chain(model: pin.Model, reference: int, tcp: int, scale: Array, offset: Array) -> CompiledChain:
    """The chain from a reference frame to the tcp for the compiled core, mimic followers included.

    Every joint frame is rotated so that the joint moves about, or along, its own z axis. With the rotation A_k that
    takes z to the axis of joint k, the chain is reference_from_tcp = C_1 X_1(q) C_2 X_2(q) ... C_m X_m(q) C_tool, where
    X_k is Rz or Tz and the constant C_k contain the A_k.

    The reference is usually the base of the arm. If it moves, such as the tcp of another arm, the joints between it and
    the link where the two branches of the tree meet come first, in reverse: the inverse of X_k(q) is X_k(-q).
    """
    above, rows = (
        [joint - 1 for joint in model.supports[model.frames[frame].parentJoint] if joint != 0]
        for frame in (reference, tcp)
    )
    joints, behind = [], model.frames[reference].placement.inverse()  # the constant transform before the next joint

    def append(row: int, before: pin.SE3, prismatic: bool, sign: float) -> None:
        leader = int(np.abs(scale[row]).argmax())
        joints.append(Joint(before.homogeneous, prismatic, leader, sign * scale[row, leader], sign * offset[row]))

    for row in reversed(above):
        if row not in rows:
            aligned, prismatic = aligned_axes(model, row + 1)
            append(row, behind * aligned, prismatic, -1.0)
            behind = (model.jointPlacements[row + 1] * aligned).inverse()
    for row in rows:
        if row not in above:
            aligned, prismatic = aligned_axes(model, row + 1)
            append(row, behind * model.jointPlacements[row + 1] * aligned, prismatic, 1.0)
            behind = aligned.inverse()
    return CompiledChain(joints, (behind * model.frames[tcp].placement).homogeneous, scale.shape[1])


def aligned_axes(model: pin.Model, joint: int) -> tuple[pin.SE3, bool]:
    """Return the rotation that takes z to the axis of a joint, and whether the joint is prismatic."""
    axis, prismatic = joint_axis(model, joint)
    return pin.SE3(_aligned(*axis.tolist())), prismatic


@lru_cache(maxsize=AXES_KEPT)
def _aligned(*direction: float) -> pin.SE3:
    """Return the rotation that takes z to a unit vector."""
    axis, helper = np.array(direction), np.zeros(3)
    helper[int(np.abs(axis).argmin())] = 1.0  # so that the rotation is exact for a coordinate axis
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return pin.SE3(np.column_stack([x, np.cross(axis, x), axis]), np.zeros(3))


def joint_axis(model: pin.Model, joint: int) -> tuple[Array, bool]:
    """Return the unit axis (3,) of a joint in its own frame, and whether the joint is prismatic."""
    kind = model.joints[joint]
    data = kind.createData()
    kind.calc(data, np.zeros(model.nq))  # it reads the entries of this joint in the configuration of the model
    subspace = np.asarray(data.S, dtype=float).ravel()
    if kind.nv != 1 or subspace.shape != (6,):
        raise InputError(f"joint {model.names[joint]!r} is a {kind.shortname()}; a chain has single-axis joints only")
    prismatic = not subspace[3:].any()
    return (subspace[:3] if prismatic else subspace[3:]), prismatic


def group_ends(urdf: Urdf, srdf: Srdf, name: str) -> tuple[str, str]:
    """Return the base and tip link of an SRDF group; the end effector of the group overrides the tip of the chain.

    A group of joints or links must form a chain; as in MoveIt, a link adds its parent joint.

    UnknownNameError if the group, or one of its links or joints, does not exist. InputError if the group is empty, or
    its joints are not on one path from the root.
    """
    group = srdf.groups.get(name)
    if group is None:
        raise UnknownNameError("group", name, srdf.groups, f"the SRDF of robot {urdf.name!r}")
    if group.missing:
        raise UnknownNameError("subgroup", group.missing[0], srdf.groups, f"group {name!r} of the SRDF")
    # every name must exist
    for kind, named, known in (
        ("joint", group.joints, urdf.joints),
        ("link", (*group.links, *(end for chain in group.chains for end in chain)), urdf.links),
    ):
        for word in named:
            if word not in known:
                raise UnknownNameError(kind, word, known, f"group {name!r} of the SRDF")
    # a chain, or joints and links that form one
    declared = [e.parent_link for e in srdf.end_effectors if e.group == name]
    if len(group.chains) == 1:
        base, tip = group.chains[0]
    elif group.chains:
        raise InputError(
            f"group {name!r} has the chains {list(group.chains)}; select one with base and tcp (--base, --tcp)"
        )
    else:
        carriers = [joint.name for joint in map(urdf.parent_joint, group.links) if joint is not None]
        joints = list(dict.fromkeys([*group.joints, *carriers]))
        if not joints:
            raise InputError(
                f"group {name!r} has no chain, no joints and no moving links; name the tcp instead (--tcp)"
            )
        # the joints must be on one path, from the parent link of the first to the child link of the last
        above = {
            joint: [before.name for before in link_path(urdf, urdf.root, urdf.joints[joint].child)] for joint in joints
        }
        outermost = max(joints, key=lambda joint: len(above[joint]))
        aside = [joint for joint in joints if joint not in above[outermost]]
        if aside:
            raise InputError(
                f"group {name!r} is not a chain: joint {aside[0]!r} is not on the path to {outermost!r}; "
                "name base and tcp instead (--base, --tcp)"
            )
        innermost = min(joints, key=lambda joint: len(above[joint]))
        base, tip = urdf.joints[innermost].parent, urdf.joints[outermost].child
    return base, declared[0] if declared else tip


def leaves(urdf: Urdf) -> list[str]:
    """Return the links without child joints."""
    parents = {joint.parent for joint in urdf.joints.values()}
    return [link for link in urdf.links if link not in parents]


def known_frame(urdf: Urdf, name: str) -> str:
    """Return the name of a link; UnknownNameError if the robot has none of that name."""
    if name not in urdf.links:
        raise UnknownNameError("frame", name, urdf.links, f"robot {urdf.name!r}")
    return name


def base_of(urdf: Urdf, default: str | None, tcp: str) -> str:
    """Return the default base of a robot if the tcp is behind it, else the root."""
    if default is not None and default != tcp:
        with suppress(InputError):
            link_path(urdf, default, tcp)
            return default
    return urdf.root


def declared_tcp(urdf: Urdf, srdf: Srdf) -> str:
    """Return the only end effector of the SRDF, or the only leaf if it hangs on a fixed joint; else InputError."""
    declared = sorted({effector.parent_link for effector in srdf.end_effectors})
    if len(declared) == 1:
        return declared[0]
    # The frames dh_0 ... dh_n of URDFs made from a DH table are not candidates.
    ends = [link for link in leaves(urdf) if not DH_FRAME.fullmatch(link)] or leaves(urdf)
    if not declared and len(ends) == 1:
        joint = urdf.parent_joint(ends[0])
        if joint is not None and joint.type == "fixed":
            return ends[0]
    raise InputError(
        f"robot {urdf.name!r} declares no single tcp; name one (--tcp, in Python tcp=). "
        f"Candidates: {', '.join(declared or ends)}"
    )
