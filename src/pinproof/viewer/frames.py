"""Frames in the picture: axes with a name, at the links of the arm and wherever else they are told."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.viewer.stage import Stage
from pinproof.viewer.wire import Commands, node_path

__all__ = ["add_frames", "frame_names"]

Array = npt.NDArray[np.float64]

FRAME_SHARE = 0.11
"""Length of a frame's axes, as a share of the picture's radius."""

NEAR = 0.2
"""Origins nearer than this share of an axis' length would have their names on each other."""


def frame_names(stage: Stage) -> list[str]:
    """The links whose frames are shown: base, what each joint of the arm moves, tcp."""
    joints = stage.arm.robot.urdf.joints
    return list(dict.fromkeys([stage.arm.base, *(joints[name].child for name in stage.arm.joint_names), stage.arm.tcp]))


def add_frames(commands: Commands, placed: Mapping[str, Array], reach: float) -> dict[str, Any]:
    """Place frames, (4, 4) ``root_from_frame`` by name; what the page's script draws their axes and names from.

    ``reach`` (m) is the picture's radius.
    """
    for name, pose in placed.items():
        commands.set_transform(node_path("frames", name), pose)
    length = round(FRAME_SHARE * reach, 4)
    origins = [pose[:3, 3] for pose in placed.values()]
    names = []
    for number, name in enumerate(placed):
        # names at one origin stand above each other
        below = sum(bool(np.linalg.norm(each - origins[number]) < NEAR * length) for each in origins[:number])
        names.append([node_path("frames", name).removeprefix("/frames/"), name, below])
    return {"names": names, "length": length}
