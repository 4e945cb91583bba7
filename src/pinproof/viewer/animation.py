"""Key frames of a motion: the poses of all drawn links and carried objects at many instants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pinproof.collision import Mover, Obstacle
from pinproof.errors import InputError
from pinproof.ik import SelfMotionCurve
from pinproof.model import JointGroup
from pinproof.motion import Trajectory
from pinproof.spatial import Array, matrix
from pinproof.viewer.stage import Stage
from pinproof.viewer.wire import Commands, node_path

FRAME_RATE = 60.0
"""Key frames per second. The viewer interpolates in between (slerp); at 3 rad/s and 1 m the error is 0.3 mm."""

MAX_FRAMES = 3600
"""One minute at the full rate; longer motions have fewer key frames per second."""

REST = 1.0
"""Seconds that the last pose is shown before the motion starts again."""

MOVING_TOLERANCE = 1e-9
"""Metres or matrix entries. A link whose pose changes by less needs no track."""


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of a motion with constant attached objects.

    Parameters
    ----------
    trajectory
        Starts where the previous phase ends.
    attached
        Objects that move with the tcp of the first arm, in addition to those of the stage; poses are
        ``tcp_from_object``.
    held
        Values (rad or m, by name) of joints outside the arm, such as fingers. Default: those of the arm of the stage.
    movers
        The obstacles of the stage that move by themselves, as seen from the start of the phase.
    """

    trajectory: Trajectory
    attached: tuple[Obstacle, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    movers: tuple[Mover, ...] = ()


@dataclass(frozen=True, eq=False)
class Film:
    """Key frames.

    Parameters
    ----------
    times
        (F,) seconds; F = 1 for a single configuration.
    poses
        (F, L, 4, 4) ``root_from_link`` of the drawn links.
    tcps
        (F, A, 3) positions of the tcps of the A arms in the root frame.
    riders
        By name, (F, 4, 4) ``root_from_object`` of objects that are attached in some phases. Before and after, they rest
        where they are picked and placed.
    frames
        By name, (F, 4, 4) ``root_from_frame`` of further links.
    moved
        By name, (F, 4, 4) ``root_from_obstacle`` of the obstacles that a mover moves in some phases. They are not among
        the riders, also if they are attached in other phases.
    """

    times: Array
    poses: Array
    tcps: Array
    riders: dict[str, Array] = field(default_factory=dict)
    frames: dict[str, Array] = field(default_factory=dict)
    moved: dict[str, Array] = field(default_factory=dict)


def checked_motion(arm: JointGroup, motion: Trajectory) -> Trajectory:
    """Return the motion; InputError if it has no timing or other joints than the arm."""
    if not hasattr(motion, "duration"):
        raise InputError(f"a {type(motion).__name__} has no timing; convert it to a trajectory with time_parametrise")
    if tuple(motion.joint_names) != arm.joint_names:
        moved, own = ", ".join(motion.joint_names), ", ".join(arm.joint_names)
        raise InputError(f"the trajectory has the joints {moved}, but the arm has {own}")
    return motion


def film(
    stage: Stage,
    phases: Sequence[Phase],
    *,
    rate: float = FRAME_RATE,
    most: int = MAX_FRAMES,
    frames: Sequence[str] = (),
) -> Film:
    """Key frames of a motion: ``rate`` per second, but at most about ``most``. ``frames`` names further links."""
    total = sum(phase.trajectory.duration for phase in phases)
    rate = min(rate, (most - 1) / max(total, 1e-9))
    times, poses, tcps, axes, holding = [], [], [], [], []
    moving: list[dict[str, Array]] = []
    start_time = 0.0
    for number, phase in enumerate(phases):
        motion, placed = phase.trajectory, replace(stage, arm=stage.arm.with_held(phase.held))
        count = int(np.ceil(motion.duration * rate)) + 1
        instants = np.linspace(0.0, motion.duration, count)[min(number, 1) :]  # the first is in the last phase
        for q in np.asarray(motion(instants), dtype=float):
            poses.append(placed.link_poses(q))
            tcps.append(placed.tcp_poses(q))
            axes.append(placed.frame_poses(q, frames))
        times.append(start_time + instants)
        moving += _moved_by(stage, phase.movers, instants)
        holding += [{thing.name: matrix(thing.pose) for thing in phase.attached}] * len(instants)
        start_time += motion.duration
    root_from_tcp = np.stack(tcps)
    moved = {
        name: _poses_of_moved(root_from_tcp[:, 0], name, moving, holding)
        for name in dict.fromkeys(name for placed in moving for name in placed)
    }
    names = dict.fromkeys(name for held in holding for name in held if name not in moved)
    riders = {name: _object_poses(root_from_tcp[:, 0], [held.get(name) for held in holding]) for name in names}
    named = dict(zip(frames, np.stack(axes).swapaxes(0, 1), strict=True))
    return Film(np.concatenate(times), np.stack(poses), root_from_tcp[:, :, :3, 3], riders, named, moved)


def _moved_by(stage: Stage, movers: Sequence[Mover], times: Array) -> list[dict[str, Array]]:
    """For each time the poses of the obstacles that movers move, by name."""
    found: list[dict[str, Array]] = [{} for _ in times]
    scene = {thing.name: thing.pose for thing in stage.obstacles}
    for mover in movers:
        for placement, poses in zip(mover.placements(times), found, strict=True):
            poses.update({name: placement @ scene[name] for name in mover.obstacles if name in scene})
    return found


def _poses_of_moved(
    root_from_tcp: Array, name: str, moving: Sequence[dict[str, Array]], holding: Sequence[dict[str, Array]]
) -> Array:
    """(F, 4, 4) the poses of an obstacle that moves by itself, in the hand, or rests where it was last."""
    poses: list[Array] = []
    for tcp, moved, held in zip(root_from_tcp, moving, holding, strict=True):
        if name in held:
            poses.append(tcp @ held[name])
        elif name in moved or not poses:
            poses.append(moved[name] if name in moved else next(each[name] for each in moving if name in each))
        else:
            poses.append(poses[-1])
    return np.array(poses)


ELBOW_STEP = 0.03
"""Largest motion (rad or m) of a joint between key frames of a self-motion; the viewer interpolates in between."""


def film_of_elbow(stage: Stage, curve: SelfMotionCurve, frames: Sequence[str] = ()) -> Film:
    """Key frames along a curve of IK solutions; the times are the values of its parameter minus the smallest one."""
    values = [curve.values[:1]]
    for low, high, before, after in zip(curve.values, curve.values[1:], curve.q, curve.q[1:], strict=False):
        parts = int(np.ceil(np.abs(after - before).max() / ELBOW_STEP))
        values.append(np.linspace(low, high, max(parts, 1) + 1)[1:])
    at = np.concatenate(values)
    many = [curve.at(value) for value in at.tolist()]
    named = dict(zip(frames, np.stack([stage.frame_poses(q, frames) for q in many]).swapaxes(0, 1), strict=True))
    poses = np.stack([stage.link_poses(q) for q in many])
    return Film(at - curve.lower, poses, np.stack([stage.tcp_poses(q)[:, :3, 3] for q in many]), frames=named)


def _object_poses(root_from_tcp: Array, tcp_from_object: Sequence[Array | None]) -> Array:
    """(F, 4, 4) ``root_from_object`` of an object that is attached in some frames only."""
    held = [k for k, pose in enumerate(tcp_from_object) if pose is not None]
    frames = np.arange(len(root_from_tcp))
    # Before it is picked, the object is at the pick pose; after it is placed, at the place pose.
    source = np.array(held)[(np.searchsorted(held, frames, side="right") - 1).clip(0)]
    # The object is picked at the frame before the first one in which it is attached.
    first = max(held[0] - 1, 0)
    placed = {k: root_from_tcp[k] @ tcp_from_object[k] for k in held}
    start = root_from_tcp[first] @ tcp_from_object[held[0]]
    return np.stack([start if k < held[0] else placed[int(j)] for k, j in zip(frames, source, strict=True)])


def still(stage: Stage, q: Array, *, frames: Sequence[str] = ()) -> Film:
    """A single key frame at the configuration q (n,)."""
    named = dict(zip(frames, stage.frame_poses(q, frames)[:, None], strict=True))
    return Film(np.zeros(1), stage.link_poses(q)[None], stage.tcp_poses(q)[None, :, :3, 3], frames=named)


def animate(commands: Commands, stage: Stage, shown: Film) -> None:
    """Add the animation of all links that move."""
    animations = tracks(commands, stage, shown)
    if animations:
        commands.set_animation(animations)


def tracks(
    commands: Commands, stage: Stage, shown: Film, places: dict[str, str] | None = None, *, rest: float = REST
) -> list[dict[str, Any]]:
    """The tracks of all links and carried objects that move, in the form that meshcat's ``set_animation`` expects.

    ``places`` is the node of each carried object by name; objects without a node are left out. ``rest`` is the time (s)
    for which the last pose is shown.
    """
    if len(shown.times) < 2:
        return []
    # The time unit of a clip is one frame; with one frame per second, times are in seconds.
    stamps = commands.array(np.append(shown.times, shown.times[-1] + rest).astype(np.float32))
    moving = [(node_path("robot", link.name), shown.poses[:, k]) for k, link in enumerate(stage.links)]
    moving += [(node_path("frames", name), poses) for name, poses in shown.frames.items()]
    moving += [(node_path("scene", name), poses) for name, poses in shown.moved.items()]
    moving += [(path, shown.riders[name]) for name, path in (places or {}).items() if name in shown.riders]
    found = ((path, pose_tracks(commands, stamps, np.concatenate([poses, poses[-1:]]))) for path, poses in moving)
    return [{"path": path, "clip": {"fps": 1, "name": "motion", "tracks": each}} for path, each in found if each]


def pose_tracks(commands: Commands, stamps: dict[str, Any], poses: Array) -> list[dict[str, Any]]:
    """The tracks of position and orientation of one node with poses (F, 4, 4), each only if it changes."""
    found = []
    if np.ptp(poses[:, :3, 3], axis=0).max() > MOVING_TOLERANCE:
        found.append((".position", "vector3", poses[:, :3, 3]))
    if np.ptp(poses[:, :3, :3], axis=0).max() > MOVING_TOLERANCE:
        found.append((".quaternion", "quaternion", quaternions(poses[:, :3, :3])))
    return [
        {"name": name, "type": kind, "times": stamps, "values": commands.array(values.astype(np.float32).ravel())}
        for name, kind, values in found
    ]


def quaternions(rotations: Array) -> Array:
    """(N, 4) quaternions x, y, z, w of rotation matrices (N, 3, 3).

    The largest of the four components is computed first, which avoids cancellation (Shepperd 1978).
    """
    trace = np.trace(rotations, axis1=1, axis2=2)
    diagonal = np.diagonal(rotations, axis1=1, axis2=2)
    squares = np.column_stack([1 + 2 * diagonal - trace[:, None], 1 + trace])  # four times x^2, y^2, z^2, w^2
    products = np.empty((len(rotations), 4, 4))
    products[:, range(4), range(4)] = squares
    for i, j in ((0, 1), (0, 2), (1, 2)):
        products[:, i, j] = products[:, j, i] = rotations[:, i, j] + rotations[:, j, i]
    for i, (j, k) in enumerate(((2, 1), (0, 2), (1, 0))):
        products[:, i, 3] = products[:, 3, i] = rotations[:, j, k] - rotations[:, k, j]
    rows = products[np.arange(len(rotations)), squares.argmax(axis=1)]
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    # q and -q are the same rotation; neighbours get the same sign.
    flips = np.einsum("ij,ij->i", rows[1:], rows[:-1]) < 0
    rows[1:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
    return np.asarray(rows)
