"""Robots by catalogue name, from a description file or from a DH table, and cells of several robots.

The URDF of a DH table is verified: the forward kinematics of both are compared.
"""

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
    TCP,
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
from pinproof.errors import ConversionError, FileError, InputError, PinproofError, UrdfError
from pinproof.model.chain import find_chain, held_values
from pinproof.model.limits import JointLimits
from pinproof.model.robot import PART, Arm, JointGroup, Robot
from pinproof.spatial import Array, rigid

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


# -- DH tables ---------------------------------------------------------------------------------------------------------


FK_TOLERANCE = 1e-12
"""Largest difference of a frame, in metres and radians: several thousand rounding errors at a reach of one metre, and
far less than the effect of a wrong digit, sign or order."""
RECOVERY_TOLERANCE = 1e-9
"""Largest difference at the tool, in metres and radians, of a table recovered from a URDF. It is larger than
:data:`FK_TOLERANCE`, because nearly parallel axes give large offsets d (rounded to 1e-11 m) or are treated as parallel;
for other arms differences of 1e-14 are usual."""
CONFIGURATIONS = 16
"""Number of random configurations compared, in addition to zero. Forward kinematics is a polynomial in q and its sines
and cosines, so two different tables differ at almost every q; several configurations exclude agreement by chance."""


def prove_urdf_equals_table(table: DhTable, urdf: str) -> None:
    """Compare a URDF with its table at dh_0 ... dh_n and the tool, through Pinocchio, at zero and random q.

    Joint names, their order, limits and velocities are compared as well. Configurations are drawn from a fixed seed:
    (-pi, pi) for angles, the limits for prismatic rows.

    Raises
    ------
    ConversionError
        If a frame or a joint differs (the message states which, and by how much), or if Pinocchio rejects the URDF.
    """
    try:
        arm = Robot(read_urdf_text(urdf, name=f"URDF of {table.name}"), Srdf()).arm(TCP)
        # names, order and limits of the joints
        torque = None if arm.limits.torque is None else arm.limits.torque.tolist()
        for what, expected, actual in (
            ("joint names", list(table.joint_names), list(arm.joint_names)),
            ("lower limits", table.lower.tolist(), arm.limits.lower.tolist()),
            ("upper limits", table.upper.tolist(), arm.limits.upper.tolist()),
            ("velocity limits", table.velocity.tolist(), arm.limits.velocity.tolist()),
            ("effort limits", table.effort.tolist(), torque),
        ):
            if expected != actual:
                made = f"the URDF made from DH table {table.name!r}"
                raise ConversionError(f"{made} has the {what} {actual}, not {expected}")
        # every frame of the table, and its tool
        for q in _configurations(table):
            own = {f"dh_{i}": pose for i, pose in enumerate(table.frames(q))} | {arm.tcp: table.forward_kinematics(q)}
            for frame, pose in own.items():
                position, angle = _difference(pose, arm.frame_placement(q, frame).homogeneous)
                if not (position <= FK_TOLERANCE and angle <= FK_TOLERANCE):  # also raises for NaN
                    raise ConversionError(
                        f"the URDF made from DH table {table.name!r} does not equal it: frame {frame} is off by "
                        f"{position:.3g} m and {angle:.3g} rad (allowed: {FK_TOLERANCE:g}) at q = {q.tolist()}; "
                        "nothing was written"
                    )
    except ConversionError:
        raise
    except PinproofError as error:  # the URDF is rejected or a frame is missing
        raise ConversionError(f"the URDF made from DH table {table.name!r} is not usable: {error}") from error


def prove_table_equals_arm(table: DhTable, arm: Arm) -> None:
    """Compare a table recovered from an arm with that arm at the tcp, at zero and random configurations.

    Raises
    ------
    ConversionError
        If they differ; the message states the configuration and the difference.
    """
    for q in _configurations(table):
        position, angle = _difference(table.forward_kinematics(q), arm.forward_kinematics(q).homogeneous)
        if not (position <= RECOVERY_TOLERANCE and angle <= RECOVERY_TOLERANCE):
            raise ConversionError(
                f"the DH table made from {arm} does not equal it: the tcp is off by {position:.3g} m and {angle:.3g} "
                f"rad (allowed: {RECOVERY_TOLERANCE:g}) at q = {q.tolist()}"
            )


def _configurations(table: DhTable) -> Array:
    """Zero and random q (1 + CONFIGURATIONS, n): (-pi, pi) for angles, the limits for prismatic rows."""
    prismatic = np.array([row.is_prismatic for row in table.rows])
    low = np.where(prismatic, table.lower, -np.pi)
    high = np.where(prismatic, table.upper, np.pi)
    random = np.random.default_rng(0).uniform(low, high, (CONFIGURATIONS, len(table)))
    return np.vstack([np.zeros(len(table)), random])


def _difference(expected: Array, actual: Array) -> tuple[float, float]:
    """The distance (m) and the angle (rad) between two transforms (4, 4)."""
    # |R1 - R2| / sqrt(2) equals the angle up to third order; arccos would lose half of the digits.
    angle = float(np.linalg.norm(expected[:3, :3] - actual[:3, :3])) / np.sqrt(2)
    return float(np.linalg.norm(expected[:3, 3] - actual[:3, 3])), angle


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
