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
from pinproof.viewer.stage import Drawing
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
class FilmPhase:
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
    start
        Seconds at which the phase starts, if the arm rests before it; by default the end of the previous phase.
    """

    trajectory: Trajectory
    attached: tuple[Obstacle, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)
    movers: tuple[Mover, ...] = ()
    start: float | None = None


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
    stage: Drawing,
    phases: Sequence[FilmPhase],
    *,
    rate: float = FRAME_RATE,
    most: int = MAX_FRAMES,
    frames: Sequence[str] = (),
) -> Film:
    """Key frames of a motion: ``rate`` per second, but at most about ``most``. ``frames`` names further links."""
    total = sum(phase.trajectory.duration for phase in phases)
    rate = min(rate, (most - 1) / max(total, 1e-9))
    scene = {thing.name: thing.pose for thing in stage.obstacles}
    times, poses, tcps, axes, holding = [], [], [], [], []
    moving: list[dict[str, Array]] = []
    end = -np.inf
    for phase in phases:
        motion, placed = phase.trajectory, replace(stage, arm=stage.arm.with_held(phase.held))
        start = max(end, 0.0) if phase.start is None else phase.start
        instants = np.linspace(0.0, motion.duration, int(np.ceil(motion.duration * rate)) + 1)
        if start <= end:  # the first instant is the last one of the previous phase
            instants = instants[1:]
        for q in np.asarray(motion(instants), dtype=float):
            poses.append(placed.link_poses(q))
            tcps.append(placed.tcp_poses(q))
            axes.append(placed.frame_poses(q, frames))
        times.append(start + instants)
        # The obstacles that movers move, and the objects in the hand
        moved_now: list[dict[str, Array]] = [{} for _ in instants]
        for mover in phase.movers:
            for placement, places in zip(mover.placements(instants), moved_now, strict=True):
                places.update({name: placement @ scene[name] for name in mover.obstacles if name in scene})
        moving += moved_now
        holding += [{thing.name: matrix(thing.pose) for thing in phase.attached}] * len(instants)
        end = start + motion.duration
    root_from_tcp = np.stack(tcps)
    # An obstacle that moves by itself is in the hand, where its mover puts it, or rests where it was last
    moved: dict[str, Array] = {}
    for name in dict.fromkeys(name for places in moving for name in places):
        track = [next(places[name] for places in moving if name in places)]
        for tcp, places, held in zip(root_from_tcp[:, 0], moving, holding, strict=True):
            track.append(tcp @ held[name] if name in held else places.get(name, track[-1]))
        moved[name] = np.array(track[1:])
    # Any other carried object rests at its pick pose before it is picked, and where it was last after it is placed
    riders: dict[str, Array] = {}
    for name in dict.fromkeys(name for held in holding for name in held if name not in moved):
        first = next(k for k, held in enumerate(holding) if name in held)
        track = [root_from_tcp[max(first - 1, 0), 0] @ holding[first][name]]  # picked at the end of the phase before
        for tcp, held in zip(root_from_tcp[:, 0], holding, strict=True):
            track.append(tcp @ held[name] if name in held else track[-1])
        riders[name] = np.array(track[1:])
    # The frames of further links, for the layer of frames
    named = dict(zip(frames, np.stack(axes).swapaxes(0, 1), strict=True))
    return Film(np.concatenate(times), np.stack(poses), root_from_tcp[:, :, :3, 3], riders, named, moved)


ELBOW_STEP = 0.03
"""Largest motion (rad or m) of a joint between key frames of a self-motion; the viewer interpolates in between."""


def film_of_elbow(stage: Drawing, curve: SelfMotionCurve, frames: Sequence[str] = ()) -> Film:
    """Key frames along a curve of IK solutions; the times are the values of its parameter minus the smallest one."""
    # Between the solutions of the curve, as many key frames as the fastest joint needs
    values = [curve.values[:1]]
    for low, high, before, after in zip(curve.values, curve.values[1:], curve.q, curve.q[1:], strict=False):
        parts = int(np.ceil(np.abs(after - before).max() / ELBOW_STEP))
        values.append(np.linspace(low, high, max(parts, 1) + 1)[1:])
    parameters = np.concatenate(values)
    many = [curve.at(value) for value in parameters.tolist()]
    named = dict(zip(frames, np.stack([stage.frame_poses(q, frames) for q in many]).swapaxes(0, 1), strict=True))
    poses = np.stack([stage.link_poses(q) for q in many])
    tcps = np.stack([stage.tcp_poses(q)[:, :3, 3] for q in many])
    return Film(parameters - curve.lower, poses, tcps, frames=named)


def still(stage: Drawing, q: Array, *, frames: Sequence[str] = ()) -> Film:
    """A single key frame at the configuration q (n,)."""
    named = dict(zip(frames, stage.frame_poses(q, frames)[:, None], strict=True))
    return Film(np.zeros(1), stage.link_poses(q)[None], stage.tcp_poses(q)[None, :, :3, 3], frames=named)


def tracks(
    commands: Commands, stage: Drawing, shown: Film, places: dict[str, str] | None = None, *, rest: float = REST
) -> list[dict[str, Any]]:
    """The tracks of all links and carried objects that move, in the form that meshcat's ``set_animation`` expects.

    ``places`` is the node of each carried object by name; objects without a node are left out. ``rest`` is the time (s)
    for which the last pose is shown. A clip is repeated after its last key frame, so all clips end at the same time.
    """
    times = np.append(shown.times, shown.times[-1] + rest).astype(np.float32)
    moving = [(node_path("robot", link.name), shown.poses[:, k]) for k, link in enumerate(stage.links)]
    moving += [(node_path("frames", name), poses) for name, poses in shown.frames.items()]
    moving += [(node_path("scene", name), poses) for name, poses in shown.moved.items()]
    moving += [(path, shown.riders[name]) for name, path in (places or {}).items() if name in shown.riders]
    animations = []
    for path, poses in moving:
        # The viewer interpolates between key frames, so those inside a rest are not needed
        changed = (np.abs(np.diff(poses, axis=0)) > MOVING_TOLERANCE).any(axis=(1, 2))
        keep = np.append([True], changed) | np.append(changed, True)
        poses, keep = np.concatenate([poses[keep], poses[-1:]]), np.append(keep, True)
        values = {}
        if np.ptp(poses[:, :3, 3], axis=0).max() > MOVING_TOLERANCE:
            values[".position", "vector3"] = poses[:, :3, 3]
        if np.ptp(poses[:, :3, :3], axis=0).max() > MOVING_TOLERANCE:
            values[".quaternion", "quaternion"] = quaternions(poses[:, :3, :3])
        stamps = commands.array(times[keep]) if values else {}
        made = [
            {"name": name, "type": kind, "times": stamps, "values": commands.array(rows.astype(np.float32).ravel())}
            for (name, kind), rows in values.items()
        ]
        # The time unit of a clip is one frame; with one frame per second, times are in seconds
        if made:
            animations.append({"path": path, "clip": {"fps": 1, "name": "motion", "tracks": made}})
    return animations


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
