"""Robots by catalogue name, from a description file or from a DH table, and cells of several robots.

The URDF of a DH table is verified: the forward kinematics of both are compared.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.common.results import shortened
from pinproof.description import (
    OVERLAP_REASON,
    WORLD,
    Calibration,
    CatalogueEntry,
    DhTable,
    DisabledPair,
    Srdf,
    Urdf,
    calibration_format,
    cell_srdf,
    cell_urdf,
    find_robot,
    read_calibration,
    read_description,
    read_srdf,
    read_urdf_text,
)
from pinproof.description import SUFFIXES as TABLE_SUFFIXES
from pinproof.errors import CalibrationError, FileError, InputError, UrdfError
from pinproof.model.calibration import calibrated
from pinproof.model.chain import find_chain, held_values
from pinproof.model.dh_tables import dh_to_urdf
from pinproof.model.foreign import description_files, named_description, urdf_of_model, urdf_of_yourdfpy
from pinproof.model.limits import JointLimits
from pinproof.model.robot import PART, JointGroup, Robot
from pinproof.spatial import rigid

ROBOT_SUFFIXES = (".urdf", ".xacro", ".xml", ".mjcf", *TABLE_SUFFIXES)
"""Suffixes of the files that describe a robot."""

SOURCES = (
    "a name of the catalogue or of robot_descriptions, a path, the text of a URDF, a DhTable, a pinocchio.Model, a "
    "yourdfpy.URDF or a module of robot_descriptions"
)

DESCRIPTION = "_description"
"""The end of the names of robot_descriptions."""


def load_robot(
    source: Any,
    *,
    srdf: str | Path | None = None,
    package_dirs: Sequence[str | Path] = (),
    xacro_args: Mapping[str, str] | None = None,
    geometry_model: Any = None,
    calibration: str | Path | Calibration | None = None,
    visual_bodies: bool = False,
) -> Robot:
    """Load a robot by name, from a file, a text or a table, or from an object of another library.

    Parameters
    ----------
    source
        A name such as ``"ur5"``; a path that ends in ``.urdf``, ``.xacro``, ``.xml`` or ``.mjcf``, or in ``.yaml``,
        ``.yml`` or ``.csv`` for a DH table; the text of a URDF; a :class:`pinproof.DhTable`, whose bodies are generated
        (:func:`pinproof.dh_to_urdf`) and whose forward kinematics are verified; a ``pinocchio.Model``; a
        ``yourdfpy.URDF``; or a description of the package robot_descriptions, as a module or by its name, such as
        ``"ur10e_description"``.

        A model may be built or changed by a program. Its joints must be revolute, continuous, prismatic or mimic joints
        about any axis; the frames of its bodies, operational frames and sensors become links.
    srdf
        An SRDF file. Default: that of the catalogue or of robot_descriptions, else none.
    package_dirs
        Folders that contain ROS packages, searched first for ``package://`` meshes and ``$(find ...)`` in xacro.
    xacro_args
        Values for the ``<xacro:arg>`` elements of a xacro file.
    geometry_model
        The collision geometry of a ``pinocchio.Model``, a ``pinocchio.GeometryModel``. All its objects are checked,
        also those that it disables. Meshes that differ from their files, or have none, are written to the cache.
    calibration
        A file with the measured kinematics of this one arm: the ``calibration.conf`` of a Universal Robots controller,
        the ``kinematics`` of their ROS driver (YAML), or differences of a DH table (CSV);
        :mod:`pinproof.description.calibration` describes them. Only the origins of joints change. Or a calibration that
        was read before, such as that of a motion file (:attr:`pinproof.motion.MotionRecord.calibrations`).
    visual_bodies
        Whether links that have visual but no collision geometry are checked for collisions with their visual geometry.
        By default they are not checked, which :meth:`pinproof.Robot.info` and the reports of picks state.

    Raises
    ------
    UnknownNameError
        If the name is not in the catalogue, or the xacro file does not declare an argument of that name.
    UrdfError, DhTableError, CalibrationError
        If the file is invalid; the message states the line. The calibration must fit the robot.
    FileError
        If one of ``package_dirs`` is not a folder.
    InputError
        If the source is of another type, an extra or a package that it needs is not installed, a joint or a geometry of
        a model is not supported, or ``xacro_args`` or ``geometry_model`` is given for another source.
    """
    if calibration is not None or visual_bodies:
        measured = read_calibration(calibration) if isinstance(calibration, (str, PathLike)) else calibration
        own = load_robot(
            source, srdf=srdf, package_dirs=package_dirs, xacro_args=xacro_args, geometry_model=geometry_model
        )
        if visual_bodies:
            own = replace(own, urdf=own.urdf.with_visual_bodies())
        return own if measured is None else calibrated(own, measured)
    if isinstance(source, (str, PathLike)) and not _is_text(source) and (found := calibration_format(Path(source))):
        raise CalibrationError(
            Path(source),
            f"is {found}, which needs the robot too: load_robot('ur5e', calibration={str(source)!r}), or on the "
            f"command line: ur5e --calibration {source}",
        )
    if geometry_model is not None and not (
        isinstance(source, pin.Model) and hasattr(geometry_model, "geometryObjects")
    ):
        raise InputError("geometry_model must be a pinocchio.GeometryModel, and the source a pinocchio.Model")
    # the packages in which meshes are searched
    if isinstance(package_dirs, (str, PathLike)):
        raise InputError(f"package_dirs must be a list of folders, such as [{str(package_dirs)!r}]")
    for folder in package_dirs:
        if not Path(folder).is_dir():
            raise FileError(folder, "is not a folder; package_dirs must contain folders with ROS packages")
    folders = [Path(folder).absolute() for folder in package_dirs]
    # a name of the catalogue or of robot_descriptions, and a module of the latter, are aliases of files
    entry: CatalogueEntry | None = None
    if _is_name(source):
        if source.endswith(DESCRIPTION):
            source = named_description(source)
        else:
            entry = find_robot(source)
            source, srdf = entry.urdf, srdf or entry.srdf
    if (described := description_files(source)) is not None:
        source, own_srdf, own_folders, own_arguments = described
        srdf, folders = srdf or own_srdf, [*folders, *own_folders]
        xacro_args = {**own_arguments, **(xacro_args or {})}
    # what is not a file
    if not isinstance(source, (str, PathLike)) or _is_text(source) or Path(source).suffix.lower() in TABLE_SUFFIXES:
        if xacro_args:
            raise InputError(f"xacro_args are valid for .xacro files only, not for {shortened(repr(source), 80)}")
        urdf, remarks = _urdf_of(source, folders, geometry_model)
        return Robot(urdf, Srdf() if srdf is None else read_srdf(srdf), remarks=remarks)
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


def _is_name(source: Any) -> bool:
    """Whether it is a name: files have a suffix or a folder."""
    if not isinstance(source, str) or _is_text(source):
        return False
    return not source.lower().endswith(ROBOT_SUFFIXES) and "/" not in source


def _is_text(source: Any) -> bool:
    """Whether it is XML, which begins with <, as no name of a robot or file does."""
    return isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")


def _urdf_of(source: Any, folders: list[Path], geometry_model: Any) -> tuple[Urdf, tuple[str, ...]]:
    """The description in a text, an object of another library, or a DH table, and remarks on it."""
    if _is_text(source):
        return read_urdf_text(source.lstrip("\ufeff"), name="URDF text", package_dirs=folders), ()
    if isinstance(source, pin.Model):
        return urdf_of_model(source, geometry_model), ()
    if hasattr(source, "write_xml") and hasattr(source, "robot"):
        return urdf_of_yourdfpy(source, folders), ()
    if not isinstance(source, (str, PathLike, DhTable)):
        wrapped = hasattr(source, "collision_model")  # a pinocchio.RobotWrapper
        hint = "; write load_robot(x.model, geometry_model=x.collision_model)" if wrapped else ""
        raise InputError(f"source must be {SOURCES}, not {type(source).__name__}{hint}")
    table = source if isinstance(source, DhTable) else DhTable.load(Path(source))
    path = None if isinstance(source, DhTable) else Path(source)
    return replace(read_urdf_text(dh_to_urdf(table), name=f"URDF of {table.name}"), path=path), table.notes


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
        # the link by which a robot is placed: the base of its only arm, else the root
        root_from_base = pin.SE3.Identity()
        if len(group.ends) == 1:
            root_from_base = group.root_from_frame(np.zeros(group.dof), next(iter(group.ends.values()))[0])
        placed[robot_name] = group, world_from_base * root_from_base.inverse()
    # one robot whose names have prefixes
    prefixes = {robot_name: robot_name + PART for robot_name in placed}
    robots = {prefixes[robot_name]: group.robot for robot_name, (group, _) in placed.items()}
    cell = Robot(
        cell_urdf(name, {prefixes[e]: (group.robot.urdf, pose.homogeneous) for e, (group, pose) in placed.items()}),
        cell_srdf({prefix: robot.srdf for prefix, robot in robots.items()}),
        home={prefix + joint: value for prefix, robot in robots.items() for joint, value in robot.home.items()},
        parts={robot_name: group.robot for robot_name, (group, _) in placed.items()},
        remarks=tuple(f"robot {name[:-1]}: {remark}" for name, robot in robots.items() for remark in robot.remarks),
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
