"""The chain of an arm: joints from base to tcp, mimic joints, reduced Pinocchio model, compiled chain, SRDF groups.

The configuration of the reduced Pinocchio model is an affine function of the configuration q of the arm::

    q_model = scale @ q + offset

The row of a joint of the arm is e_j, the row of a mimic follower is multiplier * e_leader. The same matrix maps q to
the model and Jacobians of the model to the arm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof._core import Chain as CompiledChain
from pinproof._core import Joint
from pinproof.common.validation import require_type
from pinproof.description import Srdf, Urdf, UrdfJoint
from pinproof.errors import InputError, UnknownNameError
from pinproof.model.limits import JointLimits
from pinproof.spatial import Array

MAX_JOINTS = 250
"""Largest number of joints of an arm; creating ``pinocchio.Data`` takes 1 s for 250 joints and 100 s for 900."""

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Chain:
    """The joints of an arm or of a joint group.

    Parameters
    ----------
    joint_names
        The n joints of q, from base to tcp; those of a group arm by arm.
    angular
        (n,) True for a revolute or continuous joint, False for a prismatic one.
    followers
        All mimic joints of the robot whose leader is one of these joints, on the chain or not.
    limits
        Limits of the n joints, tightened by the limits of their followers.
    """

    joint_names: tuple[str, ...]
    angular: npt.NDArray[np.bool_]
    followers: tuple[str, ...]
    limits: JointLimits


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

    Raises
    ------
    InputError
        If no joint moves between the ends of an arm, more than :data:`MAX_JOINTS` do, or one is floating or planar.
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

    Raises
    ------
    InputError
        If no joint moves it, or one is floating or planar.
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
    for name, value in held.items():
        if name in chain.joint_names:
            raise InputError(f"joint {name!r} belongs to the arm; its value is set by q, not by held")
        if name in urdf.joints and urdf.joints[name].type in ("floating", "planar"):
            raise InputError(f"joint {name!r} is {urdf.joints[name].type}; it is fixed at its neutral configuration")
        if name not in free:
            raise UnknownNameError("joint", name, free, "the joints outside the arm that can be held")
        if not isinstance(value, Real) or not np.isfinite(float(value)):
            raise InputError(f"the value of held joint {name!r} must be a finite number, not {value!r}")
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
    lower, upper, velocity, torque = [], [], [], []
    for name in names:
        joint = urdf.joints[name]
        low, high = joint.bounds
        speed = np.inf if joint.velocity is None else joint.velocity
        for follower in (urdf.joints[f] for f in followers):
            mimic = follower.mimic
            if mimic is None or mimic.leader != name or mimic.multiplier == 0.0:
                continue
            ends = [(bound - mimic.offset) / mimic.multiplier for bound in follower.bounds]
            low, high = max(low, min(ends)), min(high, max(ends))
            if follower.velocity is not None:
                speed = min(speed, follower.velocity / abs(mimic.multiplier))
        if low > high:
            raise InputError(f"the limits of joint {name!r} and of its mimic joints have no common value")
        lower.append(low)
        upper.append(high)
        velocity.append(np.nan if np.isinf(speed) else speed)
        torque.append(np.nan if joint.effort is None else joint.effort)
    torques = None if np.isnan(torque).all() else np.array(torque)
    return JointLimits(np.array(lower), np.array(upper), np.array(velocity), torque=torques)


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


def compiled_chain(
    model: pin.Model, tcp_frame: int, root_from_base: pin.SE3, scale: Array, offset: Array
) -> CompiledChain:
    """The chain from the base to the tcp for the compiled core, mimic followers included.

    Every joint frame is rotated so that the joint moves about, or along, its own z axis. With the rotation A_k that
    takes z to the axis of joint k, the chain is base_from_tcp = C_1 X_1(q) C_2 X_2(q) ... C_m X_m(q) C_tool, where X_k
    is Rz or Tz and the constant C_k contain the A_k.

    Parameters
    ----------
    model
        The reduced model of the arm.
    tcp_frame
        Index of the tcp frame in the model.
    root_from_base
        Pose of the base link in the root link.
    scale, offset
        The map from q to the configuration of the model (:func:`affine`).
    """
    tcp = model.frames[tcp_frame]
    rows = [joint - 1 for joint in model.supports[tcp.parentJoint] if joint != 0]
    joints = []
    behind = root_from_base.inverse()  # the constant transform before the next joint
    for row in rows:
        leader = int(np.abs(scale[row]).argmax())
        aligned, prismatic = aligned_axes(model, row + 1)
        before = (behind * model.jointPlacements[row + 1] * aligned).homogeneous
        joints.append(Joint(before, prismatic, leader, scale[row, leader], offset[row]))
        behind = aligned.inverse()
    return CompiledChain(joints, (behind * tcp.placement).homogeneous, scale.shape[1])


def aligned_axes(model: pin.Model, joint: int) -> tuple[pin.SE3, bool]:
    """Return the rotation that takes z to the axis of a joint, and whether the joint is prismatic."""
    axis, prismatic = joint_axis(model, joint)
    helper = np.zeros(3)
    helper[int(np.abs(axis).argmin())] = 1.0  # so that the rotation is exact for a coordinate axis
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return pin.SE3(np.column_stack([x, np.cross(axis, x), axis]), np.zeros(3)), prismatic


def joint_axis(model: pin.Model, joint: int) -> tuple[Array, bool]:
    """Return the unit axis (3,) of a joint in its own frame, and whether the joint is prismatic."""
    kind = model.joints[joint]
    data = kind.createData()
    kind.calc(data, np.zeros(model.nq))  # it reads the entries of this joint in the configuration of the model
    subspace = np.asarray(data.S, dtype=float).ravel()
    if kind.nq != 1 or subspace.shape != (6,):
        raise InputError(f"joint {model.names[joint]!r} is a {kind.shortname()}; a chain has single-axis joints only")
    prismatic = not subspace[3:].any()
    return (subspace[:3] if prismatic else subspace[3:]), prismatic


def group_ends(urdf: Urdf, srdf: Srdf, name: str) -> tuple[str, str]:
    """Return the base and tip link of an SRDF group; the end effector of the group overrides the tip of the chain.

    A group of joints or links must form a chain; as in MoveIt, a link adds its parent joint.

    Raises
    ------
    UnknownNameError
        If the group, or one of its links or joints, does not exist.
    InputError
        If the group is empty, or its joints are not on one path from the root.
    """
    group = srdf.groups.get(name)
    if group is None:
        raise UnknownNameError("group", name, srdf.groups, f"the SRDF of robot {urdf.name!r}")
    if group.missing:
        raise UnknownNameError("subgroup", group.missing[0], srdf.groups, f"group {name!r} of the SRDF")
    for kind, named, known in (
        ("joint", group.joints, urdf.joints),
        ("link", (*group.links, *(end for chain in group.chains for end in chain)), urdf.links),
    ):
        for word in named:
            if word not in known:
                raise UnknownNameError(kind, word, known, f"group {name!r} of the SRDF")
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
