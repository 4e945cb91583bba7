"""Robots by catalogue name, from a description file or from a DH table, and cells of several robots."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.common.validation import require_type
from pinproof.description import (
    OVERLAP_REASON,
    WORLD,
    CatalogueEntry,
    DhTable,
    DisabledPair,
    Srdf,
    cell_srdf,
    cell_urdf,
    find_robot,
    read_description,
    read_srdf,
    read_urdf_text,
    urdf_of_table,
)
from pinproof.description import SUFFIXES as TABLE_SUFFIXES
from pinproof.errors import FileError, InputError, UrdfError
from pinproof.model.chain import find_chain, held_values
from pinproof.model.dh_proof import prove_urdf_equals_table
from pinproof.model.limits import JointLimits
from pinproof.model.robot import PART, JointGroup, Robot
from pinproof.spatial import rigid

ROBOT_SUFFIXES = (".urdf", ".xacro", ".xml", ".mjcf", *TABLE_SUFFIXES)
"""Suffixes of the files that describe a robot."""


def load_robot(
    source: str | Path | DhTable,
    *,
    srdf: str | Path | None = None,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, str] | None = None,
) -> Robot:
    """Load a robot by catalogue name, from a URDF, xacro or MJCF file, from URDF text, or from a DH table.

    Parameters
    ----------
    source
        A name such as ``"ur5"``, the text of a URDF, a DH table, or a path that ends in ``.urdf``, ``.xacro``, ``.xml``
        or ``.mjcf``, or in ``.yaml``, ``.yml`` or ``.csv`` for a DH table. The bodies of a DH table are generated
        (:func:`pinproof.dh_to_urdf`), and its forward kinematics are verified.
    srdf
        An SRDF file. Default: that of the catalogue, none for a path or a table.
    package_dirs
        Folders that contain ROS packages, searched first for ``package://`` meshes and ``$(find ...)`` in xacro.
    xacro_args
        Values for the ``<xacro:arg>`` elements of a xacro file.

    Raises
    ------
    UnknownNameError
        If the name is not in the catalogue, or the xacro file does not declare an argument of that name.
    UrdfError, DhTableError
        If the file is invalid; the message states the line.
    FileError
        If one of ``package_dirs`` is not a folder.
    InputError
        If the file is a xacro file and the extra ``xacro`` is not installed, or xacro arguments are given for another
        file.
    """
    require_type("source", source, str, PathLike, DhTable)
    # a catalogue name is an alias of files
    entry: CatalogueEntry | None = None
    # XML begins with <, which no name of a robot or file does.
    is_text = isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")
    if isinstance(source, str) and not is_text and not source.lower().endswith(ROBOT_SUFFIXES) and "/" not in source:
        entry = find_robot(source)
        source, srdf = entry.urdf, srdf or entry.srdf
    # the packages in which meshes are searched
    if isinstance(package_dirs, (str, PathLike)):
        raise InputError(f"package_dirs must be a list of folders, such as [{str(package_dirs)!r}]")
    for folder in package_dirs:
        if not Path(folder).is_dir():
            raise FileError(folder, "is not a folder; package_dirs must contain folders with ROS packages")
    folders = [Path(folder).absolute() for folder in package_dirs]
    # the text of a URDF, then a DH table, then a file
    if isinstance(source, str) and is_text:
        if xacro_args:
            raise InputError("xacro_args are valid for .xacro files only, not for the text of a URDF")
        urdf = read_urdf_text(source.lstrip("\ufeff"), name="URDF text", package_dirs=folders)
        return Robot(urdf, Srdf() if srdf is None else read_srdf(srdf))
    if isinstance(source, DhTable) or Path(source).suffix.lower() in TABLE_SUFFIXES:
        table = source if isinstance(source, DhTable) else DhTable.load(source)
        if xacro_args:
            raise InputError(f"xacro_args are valid for .xacro files only, not for the DH table {table.name!r}")
        text = urdf_of_table(table)
        prove_urdf_equals_table(table, text)
        path = None if isinstance(source, DhTable) else Path(source)
        urdf = replace(read_urdf_text(text, name=f"URDF of {table.name}"), path=path)
        return Robot(urdf, Srdf() if srdf is None else read_srdf(srdf))
    path = Path(source)
    if path.suffix not in ROBOT_SUFFIXES:
        what = "is a folder" if path.is_dir() else "is not a robot description"
        raise UrdfError(path, f"{what}; the name of a robot file ends in one of {', '.join(ROBOT_SUFFIXES)}")
    urdf, semantic = read_description(path, package_dirs=folders, xacro_args=xacro_args)
    if srdf is not None:
        semantic = read_srdf(srdf)
    if entry is None:
        return Robot(urdf, semantic)
    overlaps = tuple(DisabledPair(pair, OVERLAP_REASON) for pair in entry.overlaps)
    semantic = replace(semantic, disabled=(*semantic.disabled, *overlaps))
    return Robot(urdf, semantic, entry.tcp, entry.home, entry.base, entry.arms)


# -- cells ------------------------------------------------------------------------------------------------------------


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
    # the pose of the root link of each robot
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
    # one robot whose names have prefixes
    prefixes = {robot_name: robot_name + PART for robot_name in placed}
    robots = {prefixes[robot_name]: group.robot for robot_name, (group, _) in placed.items()}
    cell = Robot(
        cell_urdf(name, {prefixes[e]: (group.robot.urdf, pose.homogeneous) for e, (group, pose) in placed.items()}),
        cell_srdf({prefix: robot.srdf for prefix, robot in robots.items()}),
        home={prefix + joint: value for prefix, robot in robots.items() for joint, value in robot.home.items()},
        parts={robot_name: group.robot for robot_name, (group, _) in placed.items()},
    )
    # the arms, the limits and the held joints are those of the robots
    ends = {
        robot_name if len(group.ends) == 1 else prefixes[robot_name] + arm: (
            prefixes[robot_name] + base,
            prefixes[robot_name] + tcp,
        )
        for robot_name, (group, _) in placed.items()
        for arm, (base, tcp) in group.ends.items()
    }
    chain = find_chain(cell.urdf, *ends.values())
    free = {
        prefixes[robot_name] + joint: value
        for robot_name, (group, _) in placed.items()
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
