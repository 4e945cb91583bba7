"""The motion as key frames: where every drawn link is, sixty times a second."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.viewer.stage import Stage
from pinproof.viewer.wire import Commands, node_path

__all__ = ["Film", "animate", "checked_motion", "film", "still"]

Array = npt.NDArray[np.float64]

FRAME_RATE = 60.0
"""Key frames a second. Between them the viewer turns links by slerp: at 3 rad/s and 1 m a point is off by 0.3 mm."""

MOST_FRAMES = 3600
"""A minute at full rate; longer motions have their key frames further apart."""

REST = 1.0
"""Seconds that the last pose stands before the motion runs again."""

STILL = 1e-9
"""A link whose pose changes by less (m, or matrix entries) needs no track."""


@dataclass(frozen=True, eq=False)
class Film:
    """Key frames.

    Parameters
    ----------
    times
        (F,) seconds; F = 1 is a still picture.
    poses
        (F, L, 4, 4) ``root_from_link`` of the drawn links.
    tcp
        (F, 3) the tcp in the root frame.
    """

    times: Array
    poses: Array
    tcp: Array


def checked_motion(arm: Arm, motion: Trajectory) -> Trajectory:
    """The motion, if it moves this arm.

    Raises
    ------
    InputError
        If it has no duration (a path needs timing first) or moves other joints.
    """
    if not hasattr(motion, "duration"):
        raise InputError(f"a {type(motion).__name__} has no timing to play; make it a trajectory with time_parametrise")
    if tuple(motion.joint_names) != arm.joint_names:
        moved, own = ", ".join(motion.joint_names), ", ".join(arm.joint_names)
        raise InputError(f"the trajectory moves {moved}; the arm has {own}")
    return motion


def film(stage: Stage, motion: Trajectory) -> Film:
    """Key frames of a motion."""
    count = int(np.ceil(min(motion.duration * FRAME_RATE, MOST_FRAMES - 1))) + 1
    times = np.linspace(0.0, motion.duration, count)
    configurations = np.asarray(motion(times), dtype=float)
    poses = np.stack([stage.link_poses(q) for q in configurations])
    return Film(times, poses, np.stack([stage.tcp_position(q) for q in configurations]))


def still(stage: Stage, q: Array) -> Film:
    """A single pose."""
    return Film(np.zeros(1), stage.link_poses(q)[None], stage.tcp_position(q)[None])


def animate(commands: Commands, stage: Stage, shown: Film) -> None:
    """Add the tracks of every link that moves."""
    from scipy.spatial.transform import Rotation

    if len(shown.times) < 2:
        return
    # the last pose stands for a moment; clips are told in seconds, one "frame" each
    stamps = commands.array(np.append(shown.times, shown.times[-1] + REST).astype(np.float32))
    animations: list[dict[str, Any]] = []
    for index, link in enumerate(stage.links):
        poses = np.concatenate([shown.poses[:, index], shown.poses[-1:, index]])
        tracks = []
        if np.ptp(poses[:, :3, 3], axis=0).max() > STILL:
            tracks.append((".position", "vector3", poses[:, :3, 3]))
        if np.ptp(poses[:, :3, :3], axis=0).max() > STILL:
            tracks.append((".quaternion", "quaternion", Rotation.from_matrix(poses[:, :3, :3]).as_quat()))
        if not tracks:
            continue
        clip = {
            "fps": 1,
            "name": "motion",
            "tracks": [
                {
                    "name": name,
                    "type": kind,
                    "times": stamps,
                    "values": commands.array(values.astype(np.float32).ravel()),
                }
                for name, kind, values in tracks
            ],
        }
        animations.append({"path": node_path("robot", link.name), "clip": clip})
    if animations:
        commands.set_animation(animations)
