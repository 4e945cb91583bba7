"""A robot description whose base can be placed in a cell: four joints and a fixed mounting before its root link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.description.urdf import JointType, LinkGeometry, Urdf, UrdfJoint
from pinproof.errors import InputError

__all__ = ["CELL", "PLACEMENT_JOINTS", "with_movable_base"]

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
        Bodies that move with the base, each on a link of its own that is fixed to the former root; their origins are
        ``root_from_geometry``.

    Raises
    ------
    InputError
        If the robot already has links or joints of these names.
    """
    from lxml import etree

    ends = [CELL, *(f"{name}_link" for name in PLACEMENT_JOINTS)]
    mounts = list(dict.fromkeys(each.link for each in mount))
    taken = {*urdf.links, *urdf.joints} & {*ends, *PLACEMENT_JOINTS, MOUNTING, *mounts}
    if taken:
        raise InputError(f"robot {urdf.name!r} already has links or joints named {', '.join(sorted(taken))}")
    texts = []
    joints: list[UrdfJoint] = []
    for text in (urdf.kinematics, urdf.text):
        robot = etree.fromstring(text)
        joints = []
        for link in (*ends, *mounts):
            etree.SubElement(robot, "link", name=link)

        def add(name: str, kind: JointType, parent: str, child: str, placed: Array, axis: str = "") -> None:
            joints.append(UrdfJoint(name, kind, parent, child, None, None, None, None))
            element = etree.SubElement(robot, "joint", name=name, type=kind)  # noqa: B023  # used within the loop
            etree.SubElement(element, "parent", link=parent)
            etree.SubElement(element, "child", link=child)
            xyz = " ".join(repr(float(v)) for v in placed[:3, 3])
            etree.SubElement(element, "origin", xyz=xyz, rpy=_rpy(placed[:3, :3]))
            if axis:
                etree.SubElement(element, "axis", xyz=axis)
                etree.SubElement(element, "limit", lower="-1e9", upper="1e9", velocity="1e9", effort="1e9")

        for number, (name, axis) in enumerate(zip(PLACEMENT_JOINTS, AXES, strict=True)):
            kind: JointType = "revolute" if number == 3 else "prismatic"
            add(name, kind, ends[number], ends[number + 1], np.eye(4), axis)
        add(MOUNTING, "fixed", ends[-1], urdf.root, mounting)
        for link in mounts:
            add(f"{link} (mount)", "fixed", urdf.root, link, np.eye(4))
        texts.append(str(etree.tostring(robot, encoding="unicode")))
    kinematics, text = texts
    return replace(
        urdf,
        root=CELL,
        links=(*urdf.links, *ends, *mounts),
        joints={**urdf.joints, **{joint.name: joint for joint in joints}},
        collisions=(*urdf.collisions, *mount),
        visuals=(*urdf.visuals, *mount),
        kinematics=kinematics,
        text=text,
    )


def _rpy(rotation: Array) -> str:
    """The angles of a rotation as text; Pinocchio reads them as Rz Ry Rx."""
    pitch = float(np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0])))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:  # at pitch +-pi/2 only the sum of the other two is determined
        roll, yaw = float(np.arctan2(-rotation[1, 2], rotation[1, 1])) * np.sign(1.0), 0.0
    else:
        roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
        yaw = float(np.arctan2(rotation[1, 0], rotation[0, 0]))
    return f"{roll!r} {pitch!r} {yaw!r}"
