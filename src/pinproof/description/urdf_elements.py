"""Elements of URDF files: origins, joints and numbers with all digits."""

from __future__ import annotations

import math
from collections.abc import Iterable

from pinproof.description.xml_reader import Element
from pinproof.spatial import Array


def rpy_of(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of Rz(yaw) Ry(pitch) Rx(roll), exact up to rounding for every rotation (3, 3).

    Yaw is computed first, and roll from the rotation without that yaw. At a pitch of +-pi/2 yaw is arbitrary, and roll
    then compensates for it (Shoemake, Graphics Gems IV, 1994, refined as in Eigen's eulerAngles).
    """
    r = rotation
    yaw = math.atan2(r[1, 0], r[0, 0])
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-r[2, 0], c * r[0, 0] + s * r[1, 0])
    roll = math.atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1])
    return roll, pitch, yaw


def numbers_text(values: Iterable[float]) -> str:
    """The numbers separated by spaces, with all digits."""
    return " ".join(repr(float(value) + 0.0) for value in values)  # + 0.0 converts -0.0 to 0.0


def origin_attributes(pose: Array) -> dict[str, str]:
    """The attributes of the ``<origin>`` element of a pose (4, 4)."""
    return {"xyz": numbers_text(pose[:3, 3]), "rpy": numbers_text(rpy_of(pose[:3, :3]))}


def add_joint(robot: Element, name: str, kind: str, parent: str, child: str) -> Element:
    """Add a ``<joint>`` element between two links, without origin, axis and limits."""
    from lxml import etree

    joint = etree.SubElement(robot, "joint", name=name, type=kind)
    etree.SubElement(joint, "parent", link=parent)
    etree.SubElement(joint, "child", link=child)
    return joint
