"""A robot description whose base can be placed in a cell: four joints and a fixed mounting before its root link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.description.urdf import JointType, LinkGeometry, Urdf, UrdfJoint
from pinproof.errors import InputError

Array = npt.NDArray[np.float64]

CELL = "placement_cell"
"""The root link of a description with a movable base."""

PLACEMENT_JOINTS = ("placement_x", "placement_y", "placement_z", "placement_yaw")
"""The joints from the cell to the base, in this order: three prismatic ones (m), and a revolute one about z (rad)."""

MOUNTING = "placement_mounting"

AXES = ("1 0 0", "0 1 0", "0 0 1", "0 0 1")


def with_movable_base(urdf: Urdf, mounting: Array, mount: Sequence[LinkGeometry] = ()) -> Urdf:
    """The description with the root link :data:`CELL`, from which :data:`PLACEMENT_JOINTS` lead to the former root.

    Parameters
    ----------
    urdf
        The robot.
    mounting
        (4, 4) the pose of the former root behind the placement joints, such as that of a robot on a wall.
    mount
        Bodies that move with the base, each on a separate link that is fixed to the former root; their origins are
        ``root_from_geometry``.

    Raises
    ------
    InputError
        If the robot already has links or joints of these names.
    """
    ends = [CELL, *(f"{name}_link" for name in PLACEMENT_JOINTS)]
    mounts = list(dict.fromkeys(each.link for each in mount))
    taken = {*urdf.links, *urdf.joints} & {*ends, *PLACEMENT_JOINTS, MOUNTING, *mounts}
    if taken:
        raise InputError(f"robot {urdf.name!r} already has links or joints named {', '.join(sorted(taken))}")
    steps: list[tuple[UrdfJoint, Array, str]] = []
    for number, (name, axis) in enumerate(zip(PLACEMENT_JOINTS, AXES, strict=True)):
        kind: JointType = "revolute" if number == 3 else "prismatic"
        steps.append((_joint(name, kind, ends[number], ends[number + 1]), np.eye(4), axis))
    steps.append((_joint(MOUNTING, "fixed", ends[-1], urdf.root), mounting, ""))
    steps += [(_joint(f"{link} (mount)", "fixed", urdf.root, link), np.eye(4), "") for link in mounts]
    kinematics, text = (_extended(each, [*ends, *mounts], steps) for each in (urdf.kinematics, urdf.text))
    return replace(
        urdf,
        root=CELL,
        links=(*urdf.links, *ends, *mounts),
        joints={**urdf.joints, **{joint.name: joint for joint, _, _ in steps}},
        collisions=(*urdf.collisions, *mount),
        visuals=(*urdf.visuals, *mount),
        kinematics=kinematics,
        text=text,
    )


def _joint(name: str, kind: JointType, parent: str, child: str) -> UrdfJoint:
    return UrdfJoint(name, kind, parent, child, None, None, None, None)


def _extended(text: str, links: Sequence[str], steps: Sequence[tuple[UrdfJoint, Array, str]]) -> str:
    """URDF text with more links and joints; a joint has its origin (4, 4) and, unless it is fixed, its axis."""
    from lxml import etree

    robot = etree.fromstring(text)
    for link in links:
        etree.SubElement(robot, "link", name=link)
    for joint, placed, axis in steps:
        element = etree.SubElement(robot, "joint", name=joint.name, type=joint.type)
        etree.SubElement(element, "parent", link=joint.parent)
        etree.SubElement(element, "child", link=joint.child)
        xyz = " ".join(repr(float(v)) for v in placed[:3, 3])
        etree.SubElement(element, "origin", xyz=xyz, rpy=_rpy(placed[:3, :3]))
        if axis:
            etree.SubElement(element, "axis", xyz=axis)
            etree.SubElement(element, "limit", lower="-1e9", upper="1e9", velocity="1e9", effort="1e9")
    return str(etree.tostring(robot, encoding="unicode"))


GIMBAL = 1e-9
"""Cosine of the pitch below which roll and yaw rotate about the same axis."""


def _rpy(rotation: Array) -> str:
    """The angles of a rotation (3, 3) as text: Rz(yaw) Ry(pitch) Rx(roll)."""
    across = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], across))
    if across < GIMBAL:
        roll, yaw = float(np.arctan2(-rotation[1, 2], rotation[1, 1])), 0.0
    else:
        roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
        yaw = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
    return f"{roll!r} {pitch!r} {yaw!r}"
