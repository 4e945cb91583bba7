"""The motion as key frames: where every drawn link, and whatever it carries for a while, is at many instants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import Trajectory
from pinproof.spatial import matrix
from pinproof.viewer.stage import Stage
from pinproof.viewer.wire import Commands, node_path

__all__ = ["Film", "Phase", "animate", "checked_motion", "film", "still", "tracks"]

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
class Phase:
    """A part of a motion along which the same objects move with the tcp.

    Parameters
    ----------
    trajectory
        From rest to rest; it begins where the phase before it ends.
    attached
        What moves with the tcp beside what the stage draws there always; poses are ``tcp_from_object``.
    held
        Where joints outside the arm stand (rad or m by name), such as the robot's own fingers; the others as the
        stage's arm holds them.
    """

    trajectory: Trajectory
    attached: tuple[Obstacle, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)


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
    riders
        By name, (F, 4, 4) ``root_from_object`` of what is attached for a while: it stands where it will be taken, then
        moves with the tcp, then stays where it was let go.
    frames
        By name, (F, 4, 4) ``root_from_frame`` of the links that were asked for.
    """

    times: Array
    poses: Array
    tcp: Array
    riders: dict[str, Array] = field(default_factory=dict)
    frames: dict[str, Array] = field(default_factory=dict)


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


def film(
    stage: Stage,
    phases: Sequence[Phase],
    *,
    rate: float = FRAME_RATE,
    most: int = MOST_FRAMES,
    frames: Sequence[str] = (),
) -> Film:
    """Key frames of a motion, ``rate`` a second, but about ``most`` at most; also of the named links' ``frames``."""
    total = sum(phase.trajectory.duration for phase in phases)
    rate = min(rate, (most - 1) / max(total, 1e-9))
    times, poses, tcps, axes, holding = [], [], [], [], []
    begun = 0.0
    for number, phase in enumerate(phases):
        motion, placed = phase.trajectory, replace(stage, arm=stage.arm.with_held(phase.held))
        count = int(np.ceil(motion.duration * rate)) + 1
        moments = np.linspace(0.0, motion.duration, count)[min(number, 1) :]  # its first is the last of the one before
        for q in np.asarray(motion(moments), dtype=float):
            poses.append(placed.link_poses(q))
            tcps.append(placed.tcp_pose(q))
            axes.append(placed.frame_poses(q, frames))
        times.append(begun + moments)
        holding += [{thing.name: matrix(thing.pose) for thing in phase.attached}] * len(moments)
        begun += motion.duration
    root_from_tcp = np.stack(tcps)
    names = dict.fromkeys(name for held in holding for name in held)
    riders = {name: _ride(root_from_tcp, [held.get(name) for held in holding]) for name in names}
    named = dict(zip(frames, np.stack(axes).swapaxes(0, 1), strict=True))
    return Film(np.concatenate(times), np.stack(poses), root_from_tcp[:, :3, 3], riders, named)


def _ride(root_from_tcp: Array, tcp_from_object: Sequence[Array | None]) -> Array:
    """(F, 4, 4) where an object is that is attached in some frames only."""
    held = [k for k, place in enumerate(tcp_from_object) if place is not None]
    frames = np.arange(len(root_from_tcp))
    # Before it is taken it is where it is taken; after it was let go, where it was let go.
    source = np.array(held)[(np.searchsorted(held, frames, side="right") - 1).clip(0)]
    # The frame before the first one held is the very instant of the taking.
    first = max(held[0] - 1, 0)
    placed = {k: root_from_tcp[k] @ tcp_from_object[k] for k in held}
    start = root_from_tcp[first] @ tcp_from_object[held[0]]
    return np.stack([start if k < held[0] else placed[int(j)] for k, j in zip(frames, source, strict=True)])


def still(stage: Stage, q: Array, *, frames: Sequence[str] = ()) -> Film:
    """A single pose."""
    named = dict(zip(frames, stage.frame_poses(q, frames)[:, None], strict=True))
    return Film(np.zeros(1), stage.link_poses(q)[None], stage.tcp_position(q)[None], frames=named)


def animate(commands: Commands, stage: Stage, shown: Film) -> None:
    """Add the tracks of everything that moves."""
    animations = tracks(commands, stage, shown)
    if animations:
        commands.set_animation(animations)


def tracks(
    commands: Commands, stage: Stage, shown: Film, places: dict[str, str] | None = None, *, rest: float = REST
) -> list[dict[str, Any]]:
    """The tracks of every link and rider that moves, as meshcat's ``set_animation`` takes them.

    Parameters
    ----------
    commands
        Takes the arrays.
    places
        The node of each rider by name; those that have none are left out.
    rest
        Seconds that the last pose stands.
    """
    if len(shown.times) < 2:
        return []
    # clips are told in seconds, one "frame" each
    stamps = commands.array(np.append(shown.times, shown.times[-1] + rest).astype(np.float32))
    moving = [(node_path("robot", link.name), shown.poses[:, k]) for k, link in enumerate(stage.links)]
    moving += [(node_path("frames", name), poses) for name, poses in shown.frames.items()]
    moving += [(path, shown.riders[name]) for name, path in (places or {}).items() if name in shown.riders]
    found = ((path, _tracks(commands, stamps, np.concatenate([poses, poses[-1:]]))) for path, poses in moving)
    return [{"path": path, "clip": {"fps": 1, "name": "motion", "tracks": each}} for path, each in found if each]


def _tracks(commands: Commands, stamps: dict[str, Any], poses: Array) -> list[dict[str, Any]]:
    """Position and orientation (F, 4, 4) of one thing, each only if it changes."""
    from scipy.spatial.transform import Rotation

    found = []
    if np.ptp(poses[:, :3, 3], axis=0).max() > STILL:
        found.append((".position", "vector3", poses[:, :3, 3]))
    if np.ptp(poses[:, :3, :3], axis=0).max() > STILL:
        found.append((".quaternion", "quaternion", Rotation.from_matrix(poses[:, :3, :3]).as_quat()))
    return [
        {"name": name, "type": kind, "times": stamps, "values": commands.array(values.astype(np.float32).ravel())}
        for name, kind, values in found
    ]
