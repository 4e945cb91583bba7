"""What no certificate of a part of a program covers: overlapping blends, the limits of joints, tool and calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin

from pinproof.collision.certificates.linear_traces import LineTrace
from pinproof.collision.certificates.program_parts import move_paths, zone_shares
from pinproof.model import Arm, JointLimits
from pinproof.motion import (
    LIMIT_TOLERANCE,
    JointMove,
    JointPath,
    LinearMove,
    Remark,
    RobotProgram,
    StreamedPoint,
    StreamedTrajectory,
    Trajectory,
    calibration_marks,
)
from pinproof.spatial import Array

SAME_TCP = 1e-4
"""m and rad: largest difference of the tcp of a declared tool from that of the arm; FANUC states 1e-6 m, 1.7e-5 rad."""

UNLIMITED = 1e12
"""rad/s and rad/s^2: in place of limits that are not known."""

ROUNDING = 2e-5
"""rad: by how much the travel of a joint on a move may differ from what was timed; FANUC rounds to 1e-3 deg."""


def overlaps(program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]) -> Iterator[int]:
    """Yield the lines of blends that may use the same part of a move as the previous blend, by their upper bounds.

    A radius that is not limited to half of the moves must end before the point at the other end of each move, which
    the controller skips otherwise, also where the arm stops there. A blend at the first point uses a part of the move
    to this point, which is not known. If no move follows, the arm may stop before the point, or go on from there when
    the program begins again.
    """
    first = program.moves[0]
    if isinstance(first, JointMove) and first.blend is not None:
        yield first.line
    paths = {step.line: path for step, path, _ in move_paths(program, traces)}
    for before, at in pairwise((*(step for step in program.steps if not isinstance(step, Remark)), None)):
        zone = before.blend if isinstance(before, JointMove | LinearMove) else None
        if before is None or not isinstance(at, JointMove | LinearMove):
            if before is not None and zone is not None:
                yield before.line
        elif at.line in paths:
            path = paths[at.line]
            ends = ((zone, path), (at.blend, path.reversed()))
            used = [0.0 if blend is None else zone_shares(blend, arm, side.q)[0] for blend, side in ends]
            if max(used) == 1.0 or sum(used) > 1.0:
                yield before.line if at.blend is None else at.line


def outside_limits(program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]) -> Iterator[str]:
    """Yield the violations of the position limits; a line in joint space between two points within them is within them.

    On a linear move, all joint values that its trace allows must be within the limits; external axes are exact.
    """
    for step in program.moves:
        where = f"line {step.line}"
        if isinstance(step, StreamedTrajectory):
            ends: Sequence[Array] = Trajectory.of_record(step.record).range()
        elif isinstance(step, LinearMove):
            trace = traces[step.line]
            beside = np.where(np.arange(arm.dof) < arm.dof - 6, 0.0, trace.tolerance)
            ends = (trace.path.q.min(axis=0) - beside, trace.path.q.max(axis=0) + beside)
            where += f", up to {trace.tolerance:.2g} rad from the traced values"
        else:
            ends = () if step.q is None else (step.q,)
        for q in ends:
            for sentence in arm.limits.violations(arm.limits.snap(q), arm.joint_names):
                yield f"{where}: {sentence}"


def speed_violations(program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]) -> Iterator[str]:
    """Yield what the joints cannot follow: stated durations that are too short, and jumps between set points.

    A duration is compared with the shortest one in which each joint can move that far, from rest or to rest where the
    arm stops; without a known acceleration limit that is the distance by the velocity. Between set points the speed is
    their difference by the period, and the arm rests before the first and after the last one; without a known
    acceleration limit the default is used there, because a controller that cannot follow leaves the assumed deviation.
    """
    limits, names = arm.limits, program.joint_names
    here: Array | None = None
    moving = False
    before = np.zeros(0)
    stream: list[StreamedPoint] = []
    for step in (*program.steps, None):
        if isinstance(step, StreamedTrajectory):
            for end, rates in (("begins", step.record.velocities[0]), ("ends", step.record.velocities[-1])):
                for joint in np.flatnonzero(rates):
                    speed = f"{rates[joint]:.4g} rad/s of {names[joint]}"
                    yield f"line {step.line}: the trajectory {end} at {speed}, and the arm is at rest there"
        # A stream of set points is judged as a whole, when it ends.
        if stream and not isinstance(step, StreamedPoint):
            yield from _stream_faults(stream, before, limits, names)
            stream = []
        if isinstance(step, StreamedPoint):
            if not stream:
                before = step.q if here is None else here
            stream.append(step)
        elif isinstance(step, JointMove | LinearMove) and here is not None:
            duration, stops = step.duration, 0
            if isinstance(step, LinearMove):  # the tcp passes the samples at equal times at constant speed
                path = traces[step.line].path
                travel = np.abs(np.diff(path.q, axis=0)).max(axis=0, initial=0.0) * max(len(path.q) - 1, 1)
                ends = [arm.forward_kinematics(q).translation for q in (path.start, path.end)]
                distance = float(np.linalg.norm(ends[1] - ends[0]))
            else:
                path, travel = JointPath([here, step.q], arm.joint_names), np.abs(step.q - here)
                distance = float(travel.max())
            if duration is not None:
                stops = (not moving) + (step.blend is None)
            if duration is None and step.speed is not None:
                duration = distance / step.speed
            # All joints accelerate in proportion
            most = np.where(limits.guessed | np.isnan(limits.acceleration), np.inf, limits.acceleration)
            rates = travel * (step.acceleration or 0.0) / max(distance, 1e-9)
            for joint in np.flatnonzero(rates > most * (1.0 + LIMIT_TOLERANCE)):
                yield (
                    f"line {step.line}: {names[joint]} would need the acceleration {rates[joint]:.4g} as stated; its "
                    f"limit is {most[joint]:.4g} rad/s^2"
                )
            # A move whose stated duration is too short cannot be followed.
            needed = np.maximum(
                shortest_durations(np.maximum(travel - ROUNDING, 0.0), limits, 0),
                shortest_durations(np.maximum(np.abs(path.end - path.start) - ROUNDING, 0.0), limits, stops),
            )
            for joint in () if duration is None else np.flatnonzero(needed > duration * (1.0 + LIMIT_TOLERANCE)):
                yield (
                    f"line {step.line}: {names[joint]} moves by {travel[joint]:.4g} rad in {duration:g} s, but needs "
                    f"at least {needed[joint]:.4g} s within its limits"
                )
        if isinstance(step, JointMove | LinearMove | StreamedPoint):
            here, moving = step.q, isinstance(step, JointMove | LinearMove) and step.blend is not None


def shortest_durations(travel: Array, limits: JointLimits, stops: int) -> Array:
    """Return the shortest durations (n,) in which joints can move by ``travel`` within their limits, as far as known.

    ``stops`` is the number of ends, of two, at which they rest; at another they may have any velocity. The profile with
    the largest velocity p takes the time travel / p + stops p / (2 a), which is least for p^2 = 2 a travel / stops.
    """
    velocity = np.where(np.isnan(limits.velocity), UNLIMITED, limits.velocity)
    unknown = limits.guessed | np.isnan(limits.acceleration)
    if not stops or unknown.all():
        return travel / velocity
    acceleration = np.where(unknown, UNLIMITED, limits.acceleration)
    peak = np.minimum(np.sqrt(2.0 * acceleration * np.maximum(travel, np.finfo(float).tiny) / stops), velocity)
    return np.asarray(travel / peak + stops * peak / (2.0 * acceleration))


def unknown_speeds(program: RobotProgram, arm: Arm) -> Iterator[str]:
    """Yield moves and set points whose speed is not known: a stated time from an unknown start, or unknown limits."""
    first = program.moves[0]
    if isinstance(first, StreamedPoint) or (isinstance(first, JointMove) and first.duration is not None):
        yield f"line {first.line} states the time of the move to the first point, whose start is not known"
    unknown = np.flatnonzero(np.isnan(arm.limits.velocity))
    stream = next((step for step in program.moves if isinstance(step, StreamedPoint)), None)
    if stream is not None and len(unknown):
        names = ", ".join(program.joint_names[joint] for joint in unknown)
        yield f"line {stream.line} is a set point, but the velocity limits of {names} are not known"


def _stream_faults(
    stream: Sequence[StreamedPoint], before: Array, limits: JointLimits, names: Sequence[str]
) -> Iterator[str]:
    """Yield the first set point at which a joint exceeds its velocity, and that of its acceleration."""
    q = np.stack([before, *(point.q for point in stream), stream[-1].q])
    period = np.array([*(point.period for point in stream), stream[-1].period])[:, None]
    speed = np.diff(q, axis=0) / period
    change = np.diff(np.concatenate([np.zeros((1, len(names))), speed]), axis=0) / period
    rows = (("velocity", speed, limits.velocity, "rad/s"), ("acceleration", change, limits.acceleration, "rad/s^2"))
    for quantity, values, bound, unit in rows:
        # Rounding of the text to 1e-6 rad changes a difference of set points by that at most, one of
        # speeds by twice it.
        rounding = 1e-6 / period if quantity == "velocity" else 2e-6 / period**2
        above = np.abs(values) > np.where(np.isnan(bound), np.inf, bound) * (1.0 + LIMIT_TOLERANCE) + rounding
        if above.any():
            row, joint = np.argwhere(above)[0]
            line = stream[min(int(row), len(stream) - 1)].line
            yield (
                f"line {line}: {names[joint]} would need the {quantity} {abs(values[row, joint]):.4g} between the set "
                f"points; its limit is {bound[joint]:.4g} {unit}"
            )


def arm_faults(program: RobotProgram, arm: Arm) -> Iterator[str]:
    """Why a program is not for an arm, in sentences: another calibration, or another tool.

    The tcp of a tool with linear moves or radii must be that of the arm, from any frame that the model has at the last
    joint: which is the flange of the controller is not stated.
    """
    own = calibration_marks(arm.robot.calibrations)
    for name in sorted({*own, *program.calibrations}):
        was, now = (marks.get(name, "none") for marks in (program.calibrations, own))
        if was.rpartition(":")[2] != now.rpartition(":")[2]:  # the file may have another name
            yield (
                f"the calibration of {name} in the program is {was}, but that of the arm is {now}; state the "
                "calibration of the program, or write the program again"
            )
    uses = any(
        isinstance(step, LinearMove) or (isinstance(step, JointMove) and step.blend and step.blend.radius is not None)
        for step in program.moves
    )
    if program.tool is None or not uses:
        return
    tcp = arm.model.frames[arm.tcp_id]
    for frame in arm.model.frames:
        if frame.parentJoint == tcp.parentJoint:
            apart = pin.log6((frame.placement * program.tool.tcp).actInv(tcp.placement)).vector
            if np.linalg.norm(apart[:3]) <= SAME_TCP and np.linalg.norm(apart[3:]) <= SAME_TCP:
                return
    yield (
        f"the tcp of tool {program.tool.name!r} in the program is not the tcp {tcp.name!r} of the arm, from any of its "
        "frames at the last joint; state that tcp, or correct the tool"
    )
