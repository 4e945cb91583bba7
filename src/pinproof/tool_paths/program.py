"""Motions along tool paths as one program of a robot controller, certified as the text of the program is executed.

On the paths, the program has linear moves at the speed of the tool between as few poses as the allowed deviation
permits, with zones between them, and the output of the process is on. The other motions become joint moves, and linear
moves where they are straight. In a zone, the tool is assumed to stay in the triangle between the two lines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from pinproof.collision import (
    COVERED,
    CollisionChecker,
    ProgramCertificate,
    certify_program,
    interpolation_difference,
    is_proven_free,
    moves_between_rests,
    shortest_durations,
    timed_step,
    trace_line,
    zone_proven,
)
from pinproof.common.results import Answer
from pinproof.common.structs import described, key
from pinproof.errors import InputError
from pinproof.model import Arm, JointGroup
from pinproof.motion import (
    ControllerMove,
    JointMove,
    JointPath,
    LinearMove,
    Remark,
    RobotProgram,
    SetOutput,
    Step,
    ToolData,
    Trajectory,
    Wait,
    controller_motion,
    external_joints,
    find_dialect,
    make_program,
)
from pinproof.spatial import SE3, Array, interpolate, log6, twist_size
from pinproof.tool_paths.path import ToolPath
from pinproof.tool_paths.result import PathPiece

# M: moves that are shorter rotate the tool, so that no speed is stated for them.
ROTATING = 1e-4
# Share by which a speed that a joint does not permit is reduced further, because texts round numbers.
ROUNDED = 2e-3
# Shares of the allowed deviation that the lines may use up, tried in turn until no zone is too large for the rest.
LINES = (0.6, 0.3, 0.05)
# The output of the process by default, for languages whose outputs have names.
PROCESS = "do_process"
# Number of parts of the path between two rungs at whose ends it is compared with a line.
FINE = 10


@described(eq=False)
class ToolPathProgram(Answer):
    """A program that follows tool paths, as read from its text, with its certificate."""

    program: RobotProgram = key("the program")
    certificate: ProgramCertificate = key("the certificate of what the controller executes", hidden=True)
    allowed: tuple[float, float] = key("the allowed deviation (m) and angle (rad) from the paths")
    deviation: float = key("bound of the distance of the tool from the paths by the text", "m")
    rotation_deviation: float = key("bound of the angle of the tool to the paths by the text", "rad")
    speed_share: float = key("the least share of the stated speed that the text states on the paths")
    least_share: float = key("the least share that is allowed; 0 if none is stated")
    stops: int = key("number of poses on the paths at which the tool stops, because no zone is small enough")

    @property
    def ok(self) -> bool:
        """Whether the program is proven free of contact, and keeps to the allowed deviation and speed."""
        return self.certificate.free and self.within

    @property
    def within(self) -> bool:
        """Whether the program keeps to the allowed deviation and speed; it may stop at corners."""
        figures = (self.deviation, self.rotation_deviation, self.least_share)
        return all(own <= limit for own, limit in zip(figures, (*self.allowed, self.speed_share), strict=True))

    def to_dict(self) -> dict[str, Any]:
        """The figures as plain values for JSON."""
        names = ("ok", "message", "deviation", "rotation_deviation", "speed_share", "stops")
        own = {"dialect": self.program.dialect, "moves": len(self.program.moves), "hash": self.certificate.hash}
        return {name: getattr(self, name) for name in names} | own

    @property
    def message(self) -> str:
        """The certificate, the deviation and the speed in one sentence."""
        figures = (
            f"within {self.deviation * 1e3:.3f} mm and {math.degrees(self.rotation_deviation):.2f} deg of the paths"
        )
        if self.deviation > self.allowed[0] or self.rotation_deviation > self.allowed[1]:
            figures += f", but {self.allowed[0] * 1e3:g} mm and {math.degrees(self.allowed[1]):.2f} deg are allowed"
        slow = f", at {100.0 * self.speed_share:.0f} % of the speed at least" if self.speed_share < 0.999 else ""
        if self.speed_share < self.least_share:
            slow += f", but {100.0 * self.least_share:.0f} % are required"
        stops = f", with {self.stops} stop{'s' if self.stops > 1 else ''} on the paths" if self.stops else ""
        return f"{self.certificate.message}; {len(self.program.moves)} moves, {figures}{slow}{stops}"


@dataclass(frozen=True, eq=False)
class ProgramMotion:
    """A motion of a program: on a ``piece`` of a path with its process, or between paths."""

    name: str
    trajectory: Trajectory
    path: ToolPath | None = None
    piece: PathPiece | None = None
    process: bool = True


@dataclass(frozen=True, eq=False)
class _Lines:
    """The linear moves on a piece, with bounds of their deviation, their zones included."""

    steps: list[LinearMove]
    deviation: float
    rotation_deviation: float
    share: float
    stops: int


def export_motions(
    checker: CollisionChecker,
    motions: Sequence[ProgramMotion],
    dialect: str,
    *,
    output: str | None = None,
    name: str = "paths",
    deviation: float | None = None,
    allowed: tuple[float, float] = (1e-3, math.radians(1.0)),
    least_share: float = 0.0,
    free: bool = True,
    tool: ToolData | None = None,
    dwell: float = 0.0,
) -> ToolPathProgram:
    """Write motions along tool paths as one program with the output of the process, and certify what it executes.

    Parameters
    ----------
    checker
        The arm with its tool in its scene.
    motions
        The motions in order; each starts where the one before ends.
    dialect
        ``"urscript"``, ``"rapid"``, ``"krl"`` or ``"fanuc"``.
    output
        The digital output that switches the process; by default that of the language.
    name
        The name of the program.
    deviation
        rad: the deviation of each joint from the moves; by default that of the language.
    allowed
        The allowed deviation (m) and angle (rad) from the paths.
    least_share
        The least allowed share of the speed of the paths, apart from stops.
    free
        Whether the rotation of the tool about its axis is free, so that the angle is that of the axis.
    tool
        The tool that the text declares.
    dwell
        Seconds that the arm rests after the process is switched on.

    Raises
    ------
    InputError
        If there is no motion, or the language cannot express the joints or the outputs.
    """
    arm, language = checker.arm, find_dialect(dialect)
    require_language(arm, dialect)
    if not motions:
        raise InputError("there is no motion to export")
    output = (language.outputs if language.outputs.isdigit() else PROCESS) if output is None else output
    deviation = language.deviation if deviation is None else deviation
    # The steps of each motion; the process is on while a path is followed
    steps, lines = list[Step]([JointMove(motions[0].trajectory.start)]), list[_Lines]()
    for motion in motions:
        steps.append(Remark(motion.name))
        if motion.path is None or motion.piece is None:
            steps += _between(checker, motion, deviation, dialect)
            continue
        least: _Lines | None = None
        for share in LINES:
            tried = _along(checker, motion.path, motion.piece, deviation, dialect, allowed, share, free=free)
            least = tried if least is None or tried.stops < least.stops else least
            if least.stops == 0:
                break
        lines += [least] if least else []
        along: list[Step] = [*lines[-1].steps]
        if motion.process:
            rest = [Wait(dwell)] if dwell else []
            along = [SetOutput(output, True), *rest, *along, SetOutput(output, False)]
        steps += along
    write = partial(
        make_program, steps, arm.joint_names, dialect=dialect, name=name, deviation=deviation, tool=tool,
        calibrations=arm.robot.calibrations,
    )  # fmt: skip
    # What the text states is certified; a proven program states the hash of its certificate
    program = write()
    certificate = certify_program(program, checker, process=(output,))
    if certificate.free:
        program = write(certificate=certificate.hash, uncovered="; ".join(certificate.notes))
        certificate = certify_program(program, checker, process=(output,))
    # What the text rounds: the speeds on the paths, and the ends of the lines, by which their points are off
    moves = [step for step in steps if isinstance(step, JointMove | LinearMove)]
    written, rounded = [1.0], [(0.0, 0.0)]
    for own, was in zip(program.moves, moves, strict=True):
        if isinstance(own, LinearMove) and isinstance(was, LinearMove) and was.pose is not None:
            end = own.pose if own.q is None else arm.forward_kinematics(own.q)
            rounded.append(twist_size(was.pose, end or was.pose))
            if was.duration is None and own.speed and was.speed:
                written.append(own.speed / was.speed)
    apart, turned = np.max(rounded, axis=0).tolist()
    return ToolPathProgram(
        program, certificate, allowed, apart + max((each.deviation for each in lines), default=0.0),
        2.0 * turned + max((each.rotation_deviation for each in lines), default=0.0),
        min((each.share for each in lines), default=1.0) * min(written), least_share,
        sum(each.stops for each in lines),
    )  # fmt: skip


def require_language(arm: JointGroup, dialect: str) -> Arm:
    """Return the arm, or refuse a language in which its programs of tool paths cannot be written.

    No language is possible for a joint group that moves the part too.

    Raises
    ------
    InputError
        If the language cannot express the joints, or has no outputs.
    UnknownNameError
        If the language does not exist.
    """
    language = find_dialect(dialect)
    if not isinstance(arm, Arm):
        raise InputError(
            f"programs of tool paths state linear moves in frames that are at rest, but the joints "
            f"{', '.join(arm.joint_names)} move the tool and the part together; save the motion, which has the values "
            "of all joints over time, or hold the joints of the part with the key held"
        )
    external = external_joints(arm)
    if not language.outputs:
        raise InputError(f"{dialect}: the process needs a digital output; use urscript, rapid, krl or fanuc")
    if external:
        raise InputError(
            f"programs of tool paths move the six joints of the robot, but the arm also has {', '.join(external)}; "
            "hold them with the key held"
        )
    if reason := language.refuses(arm, external):
        raise InputError(reason)
    return arm


def _between(checker: CollisionChecker, motion: ProgramMotion, deviation: float, dialect: str) -> list[Step]:
    """The moves of a motion that is not on a path: a linear move if its ends permit one, else joint moves."""
    arm, own = checker.arm, motion.trajectory
    if motion.name != "transit":
        trace = trace_line(arm, own.start, arm.forward_kinematics(own.end))
        if not trace.reason and np.abs(trace.path.end - own.end).max() <= 1e-6:
            made = controller_motion([ControllerMove(trace.path, alike=find_dialect(dialect).alike)], arm.limits)
            profile = made.profiles[0].lasting(max(made.duration, own.duration))
            return [timed_step(arm, made.moves[0], profile, None, linear=True)]
    return moves_between_rests(own, checker, deviation, find_dialect(dialect), linear=False)[1:]


def _along(
    checker: CollisionChecker,
    path: ToolPath,
    piece: PathPiece,
    joint_deviation: float,
    dialect: str,
    allowed: tuple[float, float],
    share: float,
    *,
    free: bool,
) -> _Lines:
    """The linear moves along a piece of a path, between rungs of it, which use a share of the allowed deviation."""
    arm = checker.arm
    on = np.flatnonzero((piece.poses >= piece.first) & (piece.poses <= piece.last))
    q, at = piece.q[on], piece.poses[on]
    tool = arm.forward_kinematics_batch(q)
    # The path between the rungs, for comparison
    fine = path.at(np.interp(np.arange((len(at) - 1) * FINE + 1) / FINE, np.arange(len(at)), at))
    off = (
        np.linalg.norm(tool[:, :3, 3] - fine[::FINE, :3, 3], axis=1).max(),
        _angles(tool, fine[::FINE], free=free).max(),
    )
    lines = [max(share * limit, 1.001 * own) for limit, own in zip(allowed, off, strict=True)]
    if path.speed is not None and len(path.speed):
        speed = path.speed[np.clip(np.floor(0.5 * (at[1:] + at[:-1])).astype(int), 0, len(path.speed) - 1)]
    else:  # the mean speed of the motion
        duration = piece.trajectory.duration if piece.trajectory is not None else 1.0
        length = np.linalg.norm(np.diff(tool[:, :3, 3], axis=0), axis=1).sum()
        speed = np.full(len(at) - 1, length / max(duration, 1e-9))

    def bound(first: int, last: int) -> tuple[float, float]:
        return _off_line(fine[first * FINE : last * FINE + 1], tool[first], tool[last], free=free)

    def fits(first: int, last: int) -> bool:
        own = bound(first, last)
        return bool(np.ptp(speed[first:last]) == 0.0 and own[0] <= lines[0] and own[1] <= lines[1])

    # As few rungs as the deviation permits: the farthest one is searched by doubling and halving the number
    chosen = [0]
    while chosen[-1] < len(at) - 1:
        first, most = chosen[-1], len(at) - 1 - chosen[-1]
        count = 1
        while count < most and fits(first, first + min(2 * count, most)):
            count = min(2 * count, most)
        width = count
        while width > 1:
            width //= 2
            while count + width <= most and fits(first, first + count + width):
                count += width
        chosen.append(first + count)
    widest = np.array([bound(a, b) for a, b in pairwise(chosen)]).reshape(-1, 2).max(axis=0, initial=0.0)
    spare = np.array(allowed) - widest
    # The joint values on each move, and the speed that the joints permit
    made, shares = list[LinearMove](), list[float]()
    paths, extra = list[JointPath](), list[float]()
    for a, b in pairwise(chosen):
        end = SE3(tool[b])
        trace = trace_line(arm, q[a], end)
        line = JointPath(q[[a, b]], arm.joint_names) if trace.reason else trace.path
        paths.append(line)
        extra.append(trace.tolerance)
        travel = np.abs(np.diff(line.q, axis=0)).max(axis=0) * (len(line.q) - 1)
        needed = float(shortest_durations(travel, arm.limits, 0).max())
        length = float(np.linalg.norm(tool[b, :3, 3] - tool[a, :3, 3]))
        if length < ROTATING:
            made.append(LinearMove(q[b], end, max(1.1 * needed, 0.05)))
            continue
        own = min(speed[a], (1.0 - ROUNDED) * length / max(needed, 1e-12))
        shares.append(own / speed[a])
        made.append(LinearMove(q[b], end, speed=float(own)))
    # The largest zones that are proven, and whose triangles keep to the rest of the deviation
    steps, stops, corners = list[LinearMove](), 0, [np.zeros(2)]
    for k, step in enumerate(made):
        blend, corner = None, np.zeros(2)
        if k + 1 < len(made) and None not in (step.speed, made[k + 1].speed):
            ends = tool[chosen[k : k + 3]]
            for zone in find_dialect(dialect).zones:
                corner = _off_corner(ends, zone.radius, free=free)
                if (corner > spare).any():
                    continue
                proven = partial(_proven, checker, joint_deviation + COVERED + max(extra[k : k + 2]))
                if zone_proven(zone, arm, paths[k], paths[k + 1], proven):
                    blend = zone
                    break
            stops += blend is None
        if blend is not None:
            corners.append(corner)
        steps.append(LinearMove(step.q, step.pose, step.duration, speed=step.speed, blend=blend))
    position, angle = (widest + np.max(corners, axis=0)).tolist()
    return _Lines(steps, position, angle, min(shares, default=1.0), stops)


def _proven(checker: CollisionChecker, more: float, path: JointPath, extent: Array) -> bool:
    return is_proven_free(path, checker, joint_tolerance=extent + more)


def _angles(one: Array, other: Array, *, free: bool) -> Array:
    """(k,) the angles (rad) between frames (k, 4, 4), or between their z axes if the rotation about it is free."""
    columns = slice(2, 3) if free else slice(0, 3)
    chord = np.linalg.norm(one[:, :3, columns] - other[:, :3, columns], axis=(1, 2)) / (1.0 if free else np.sqrt(2.0))
    return np.asarray(2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0)))


def _off_line(path: Array, first: Array, last: Array, *, free: bool) -> tuple[float, float]:
    """Bounds of the distance (m) and angle (rad) between a path and the line from one frame to another one.

    The path is that through frames (k, 4, 4), whose projections onto the line must advance, so that every point of the
    line is between those of two frames; the distance is then the largest at a frame or at an end. Between frames, the
    angle grows by at most half of the two rotations.
    """
    ends = SE3(first), SE3(last)
    step, turn = last[:3, 3] - first[:3, 3], log6(SE3(first[:3, :3].T @ last[:3, :3], np.zeros(3)))[3:]
    length = float(np.linalg.norm(step))
    if length > ROTATING:
        share = (path[:, :3, 3] - first[:3, 3]) @ step / length**2
    else:  # the tool rotates
        rotated = np.concatenate([[0.0], np.cumsum(_angles(path[1:], path[:-1], free=False))])
        share = rotated / max(float(rotated[-1]), 1e-12)
    if len(path) < 2 or (np.diff(share) < -1e-9).any():
        return (0.0, 0.0) if len(path) < 2 else (math.inf, math.inf)
    share = np.clip(share, 0.0, 1.0)
    line = np.array([interpolate(*ends, each).homogeneous for each in share.tolist()])
    rate = float(np.linalg.norm(turn[:2] if free else turn))
    between = 0.5 * float((_angles(path[1:], path[:-1], free=free) + rate * np.diff(share)).max())
    # The ends of the line, and those of the path, belong to each other
    line, path = np.concatenate([line, [first, last]]), np.concatenate([path, path[[0, -1]]])
    apart = path[:, :3, 3] - line[:, :3, 3]
    other = 0.0 if np.linalg.norm(turn[:2]) < 1e-9 else interpolation_difference(turn)
    return (
        float(np.linalg.norm(apart, axis=1).max()),
        float(_angles(path, line, free=free).max()) + between + other,
    )


def _off_corner(frames: Array, radius: float | None, *, free: bool) -> Array:
    """(2,) bounds of the distance (m) and angle (rad) of a zone at the middle one of three frames from the two lines.

    A point of the triangle between the point and the two ends of the zone, at distances a and b from it, is at most
    a b sin(angle) / (a + b) away from the closer one of its sides.
    """
    steps = np.diff(frames[:, :3, 3], axis=0)
    lengths = np.maximum(np.linalg.norm(steps, axis=1), 1e-12)
    reach = np.minimum(0.5 * lengths, np.inf if radius is None else radius)
    sine = float(np.linalg.norm(np.cross(*(steps / lengths[:, None]))))
    turned = _angles(frames[1:], frames[:-1], free=free) * reach / lengths
    return np.array([reach.prod() * sine / reach.sum(), turned.min()])
