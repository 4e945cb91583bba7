"""From yourdfpy's robot to URDF text that loses no digit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["rpy_of", "urdf_text"]

Array = npt.NDArray[np.float64]


def urdf_text(robot: Any, *, comment: str = "") -> str:
    """The XML text of a ``yourdfpy.Robot``; the same robot gives the same bytes.

    yourdfpy writes numbers with all their digits, but takes the roll, pitch and yaw of an origin from an algorithm that
    is wrong near a pitch of +-pi/2 (trimesh's ``euler_from_matrix``), so every origin's rpy is written anew here.
    """
    import yourdfpy
    from lxml import etree

    tree = yourdfpy.URDF(robot=robot, build_scene_graph=False, load_meshes=False).write_xml()
    for element, origin in zip(tree.iter("origin"), _origins(robot), strict=True):
        element.set("xyz", _text(origin[:3, 3]))
        element.set("rpy", _text(rpy_of(origin[:3, :3])))
    if comment:
        tree.getroot().insert(0, etree.Comment(f" {comment.replace('--', '- -')} "))
    return '<?xml version="1.0"?>\n' + str(etree.tostring(tree, encoding="unicode", pretty_print=True))


def rpy_of(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of Rz(yaw) Ry(pitch) Rx(roll), to rounding for every rotation (3, 3), pitch +-pi/2 included.

    Roll is taken from what is left when the yaw found first has been undone. At a pitch of +-pi/2 yaw alone is
    arbitrary, and this way roll makes up for it (Shoemake, Graphics Gems IV, 1994, refined as in Eigen's eulerAngles).
    """
    r = rotation
    yaw = math.atan2(r[1, 0], r[0, 0])
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-r[2, 0], c * r[0, 0] + s * r[1, 0])
    roll = math.atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1])
    return roll, pitch, yaw


def _origins(robot: Any) -> Iterator[Array]:
    """Every origin of the robot in the order in which yourdfpy writes them."""
    for link in robot.links:
        for part in (link.inertial, *link.visuals, *link.collisions):
            if part is not None and part.origin is not None:
                yield part.origin
    for joint in robot.joints:
        if joint.origin is not None:
            yield joint.origin


def _text(numbers: Any) -> str:
    return " ".join(repr(float(number) + 0.0) for number in numbers)  # + 0.0 turns -0.0 into 0.0
