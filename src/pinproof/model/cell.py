"""Cells: several robots, each at its pose, as one joint group."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.description.cell import WORLD, cell_srdf, cell_urdf
from pinproof.errors import InputError
from pinproof.model.chain import find_chain, held_values
from pinproof.model.limits import JointLimits
from pinproof.model.robot import PART, JointGroup, Robot
from pinproof.spatial import rigid

NAME = re.compile(r"[A-Za-z0-9_.\-]+")


def assemble(arms: Mapping[str, tuple[JointGroup, pin.SE3 | npt.ArrayLike]], *, name: str = "cell") -> JointGroup:
    """Combine several robots into one joint group, to plan and certify their motions together.

    The result is a group of a new robot whose root link is ``world``. Links and joints have the names of the robots as
    prefixes, such as ``left/wrist_1_link``, so that robots of one model have distinct names. Scenes of the cell are
    placed in ``world``. The pairs of links of different robots are all checked, the bases included;
    :class:`pinproof.CollisionChecker` refuses a cell whose bases overlap.

    Parameters
    ----------
    arms
        For each robot its name in the cell, and a tuple of one of its arms (or a joint group of it) and
        ``world_from_base``: the pose of the base link of the arm. For a joint group it is the pose of the root link.
        Limits and held joints are those of the arms.
    name
        Name of the cell.

    Returns
    -------
    JointGroup
        Its arms have the names of the robots; those of a joint group with several arms ``robot/arm``.

    Raises
    ------
    InputError
        If there is no robot, a name has other characters than letters, digits, ``_``, ``.`` and ``-``, an entry is not
        such a tuple, or a pose is not rigid.
    """
    if not isinstance(arms, Mapping) or not arms:
        raise InputError("a cell needs at least one robot: {name: (arm, world_from_base)}")
    placed: dict[str, tuple[JointGroup, pin.SE3]] = {}
    for robot_name, entry in arms.items():
        if not isinstance(robot_name, str) or not NAME.fullmatch(robot_name) or robot_name == WORLD:
            raise InputError(
                f"the robot name {robot_name!r} of a cell must consist of letters, digits, '_', '.' and '-', and "
                f"not be {WORLD!r}"
            )
        if not isinstance(entry, tuple) or len(entry) != 2 or not isinstance(entry[0], JointGroup):
            raise InputError(f"robot {robot_name!r} of a cell must be (arm, world_from_base), not {entry!r}")
        group, pose = entry
        world_from_base = rigid(f"the pose of robot {robot_name!r}", pose)
        placed[robot_name] = group, world_from_base * _root_from_base(group).inverse()
    prefixes = {each: each + PART for each in placed}
    robots = {prefixes[each]: group.robot for each, (group, _) in placed.items()}
    cell = Robot(
        cell_urdf(name, {prefixes[e]: (group.robot.urdf, pose.homogeneous) for e, (group, pose) in placed.items()}),
        cell_srdf({prefix: robot.srdf for prefix, robot in robots.items()}),
        home={prefix + joint: value for prefix, robot in robots.items() for joint, value in robot.home.items()},
        parts={each: group.robot for each, (group, _) in placed.items()},
    )
    ends = {
        each if len(group.ends) == 1 else prefixes[each] + arm: (prefixes[each] + base, prefixes[each] + tcp)
        for each, (group, _) in placed.items()
        for arm, (base, tcp) in group.ends.items()
    }
    chain = find_chain(cell.urdf, *ends.values())
    free = {
        prefixes[each] + joint: value
        for each, (group, _) in placed.items()
        for joint, value in group.held.items()
        if group.robot.urdf.joints[joint].mimic is None
    }
    limits = JointLimits.join([group.limits for group, _ in placed.values()])
    return JointGroup(cell, ends, chain, limits, held_values(cell.urdf, chain, free, cell.home))


def _root_from_base(group: JointGroup) -> pin.SE3:
    """Return the pose of the link by which a robot is placed: the base of its only arm, else the root."""
    if len(group.ends) > 1:
        return pin.SE3.Identity()
    base, _ = next(iter(group.ends.values()))
    return group.root_from_frame(np.zeros(group.dof), base)
