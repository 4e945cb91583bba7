"""What a controller executes according to the text of a program: its moves and blends, and their durations.

A joint move is a straight line in joint space, and a linear move one of the tcp, whose joint values are traced. At a
point with a blend the controller leaves the two moves; where its curve is not published, every configuration is covered
that differs in each joint by at most the extent of the blend from the two moves within the blend. All moves are covered
with the stated deviation of the controller.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinproof.collision.certificates.linear_traces import (
    ROUNDED,
    LineTrace,
    levers,
    solve_near,
    superposed_regular,
    trace_line,
)
from pinproof.model import Arm
from pinproof.motion import (
    Blend,
    ControllerMotion,
    ControllerMove,
    JointMove,
    JointPath,
    LinearMove,
    RobotProgram,
    Step,
    StreamedPoint,
    StreamedTrajectory,
    Trajectory,
    controller_motion,
    fastest,
)
from pinproof.spatial import Array

SPACING = 1.0 / 1024.0
"""Share of a move between two samples of the distance to a blend's point; the bound between them is added."""

ROWS = 8
"""Number of strips in which the surface of a blend is covered."""

OTHER_CURVES, CARTESIAN = 0.1, 1.5
"""Shares of the sides of a blend, as long as the shorter one, and of the difference between superpositions, by which it
is widened."""

ONE_LINE = 5e-5
"""rad: by how much the point of a blend may be beside the line between its ends if both moves are on one line."""

SUPERPOSED = ((0.25, 0.75), (0.5, 0.5), (0.75, 0.25), (0.25, 0.25))
"""Shares of the two sides of a blend at which superpositions of joint values and of poses are compared."""

SAME_END = 1e-6
"""rad: largest difference of the end of a linear move from the configuration that the text states."""


class ExecutedPart(NamedTuple):
    """What a controller passes up to a ``line``: every configuration within ``tolerance`` (n,) of a curve."""

    name: str
    line: int
    blend: bool
    curve: JointPath | Trajectory
    tolerance: Array


def executed_parts(program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]) -> Iterator[ExecutedPart]:
    """Yield the parts of a program whose linear moves are traced."""
    even = np.full(arm.dof, program.deviation)
    for step in program.moves:
        if isinstance(step, StreamedTrajectory):
            curve = Trajectory.of_record(step.record)
            yield ExecutedPart(f"trajectory at line {step.line}", step.line, False, curve, even)
    # Moves are lines between their points, and blends corners of two such lines.
    moves = move_paths(program, traces)
    for at, path, tolerance in moves[0 if len(moves) == 1 else 1 :]:
        what = "point" if len(moves) == 1 else "linear move" if isinstance(at, LinearMove) else "move"
        yield ExecutedPart(f"{what} at line {at.line}", at.line, False, path, even + tolerance)
    for (at, into, wide), (_, out, wider) in pairwise(moves[1:]):
        if isinstance(at, JointMove | LinearMove) and at.blend is not None:
            for cover, extent in blend_cover(at.blend, arm, into, out):
                yield ExecutedPart(f"blend at line {at.line}", at.line, True, cover, extent + even + wide + wider)


def move_paths(program: RobotProgram, traces: Mapping[int, LineTrace]) -> list[tuple[Step, JointPath, float]]:
    """The path of each move, and how far joints may be off it; of the first move, its end."""
    paths = list[tuple[Step, JointPath, float]]()
    for step in program.moves:
        if isinstance(step, StreamedTrajectory) or step.q is None:
            continue
        if isinstance(step, LinearMove) and paths:
            paths.append((step, traces[step.line].path, traces[step.line].tolerance))
        else:
            points = [*(path.end for _, path, _ in paths[-1:]), step.q]
            paths.append((step, JointPath(np.stack(points), program.joint_names), 0.0))
    return paths


def traced(program: RobotProgram, arm: Arm) -> tuple[RobotProgram, dict[int, LineTrace], tuple[str, ...]]:
    """Return the program with the configurations at the ends of its linear moves, the traces by line, and failures."""
    steps, traces, untraced = list[Step](), dict[int, LineTrace](), list[str]()
    here: Array | None = None
    for step in program.steps:
        made = step
        if isinstance(step, LinearMove):
            # The text states the end as a pose or as a configuration.
            stated = arm.home if step.q is None else step.q
            if here is None:
                alone = JointPath(stated[None], arm.joint_names)
                trace = LineTrace(alone, 0.0, "it is the first move, so its start is not known")
            else:
                external = step.external if step.q is None else step.q[:-6]
                pose = arm.forward_kinematics(stated) if step.pose is None else step.pose
                trace = trace_line(arm, here, pose, external)
                if list(program.external_joints) != list(arm.joint_names[:-6]):
                    trace = trace._replace(reason="external axes that are not before the joints of the robot")
                if not trace.reason and step.q is not None and np.abs(trace.path.end - step.q).max() > SAME_END:
                    trace = trace._replace(reason="it ends at another configuration than the text states")
            if trace.reason:
                untraced.append(f"the linear move at line {step.line}: {trace.reason}")
                if step.q is None:  # where the next move begins is not known
                    break
            traces[step.line] = trace
            made = replace(step, q=trace.path.end if step.q is None else step.q)
        if isinstance(made, JointMove | LinearMove | StreamedPoint):
            here = made.q
        steps.append(made)
    return replace(program, steps=tuple(steps)), traces, tuple(untraced)


def program_motions(
    program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]
) -> list[tuple[tuple[int, ...], ControllerMotion]]:
    """Return the motions between the stops of a program by the rules of its controller, with the lines of their moves.

    The move to the first point is not one of them.
    """
    motions = list[tuple[tuple[int, ...], ControllerMotion]]()
    lines, moves = list[int](), list[ControllerMove]()
    paths = move_paths(program, traces)
    for (step, path, _), following in zip(paths[1:], [*paths[2:], None], strict=True):
        lines.append(step.line)
        blend = step.blend if isinstance(step, JointMove | LinearMove) else None
        zone = None
        if blend is not None and following is not None:
            zone = zone_shares(blend, arm, path.reversed().q)[1], zone_shares(blend, arm, following[1].q)[1]
        moves.append(_controller_move(step, path, arm, zone))
        if zone is None:
            motions.append((tuple(lines), controller_motion(moves, arm.limits)))
            lines, moves = [], []
    return motions


def _controller_move(step: Step, path: JointPath, arm: Arm, zone: tuple[float, float] | None) -> ControllerMove:
    """The move of a step with its zone, at the speed that the text states."""
    if not isinstance(step, JointMove | LinearMove):
        return ControllerMove(path, step.period if isinstance(step, StreamedPoint) else None, zone)
    ends = [arm.forward_kinematics(q).translation for q in (path.start, path.end)]
    straight = isinstance(step, LinearMove)
    length = max(float(np.linalg.norm(ends[1] - ends[0]) if straight else np.abs(path.end - path.start).max()), 1e-9)
    top, gain = (None if stated is None else stated / length for stated in (step.speed, step.acceleration))
    percent = 100 if isinstance(step, LinearMove) else step.percent or 100
    if isinstance(step, JointMove) and step.gain is not None:
        gain = step.gain / 100.0 * float(fastest(path, arm.limits).gains.max())
    alike = straight and step.acceleration is not None
    return ControllerMove(path, step.duration, zone, percent / 100.0, top, gain, alike)


class ZoneSide:
    """A move from the point of a zone, with points q (k, n) that begin there."""

    def __init__(self, arm: Arm, q: Array) -> None:
        # Points at equal shares of the move; the tcp on a linear one is at equal distances
        q = q if len(q) > 1 else np.repeat(q, 2, axis=0)
        parts = math.ceil(1.0 / (SPACING * (len(q) - 1)))
        own, shares = np.arange(len(q)) * parts, np.arange((len(q) - 1) * parts + 1)
        self.points = np.stack([np.interp(shares, own, column) for column in q.T], axis=1)
        tcp = arm.forward_kinematics_batch(self.points if len(q) == 2 else q)[:, :3, 3]
        if len(q) > 2:
            tcp = np.stack([np.interp(shares, own, column) for column in tcp.T], axis=1)
        # The tcp moves by at most ``lever . |dq|`` between two samples
        self._slack = float((np.abs(np.diff(self.points, axis=0)) @ levers(arm)).max())
        self._distances = np.linalg.norm(tcp - tcp[0], axis=1)

    def shares(self, blend: Blend) -> tuple[float, float]:
        """As :func:`zone_shares`."""
        if blend.radius is None:
            return blend.share, blend.share * blend.stated
        spacing = 1.0 / (len(self.points) - 1)
        last = int(np.flatnonzero(self._distances <= blend.radius + self._slack).max())
        first = int(np.argmax(np.append(self._distances, np.inf) > blend.radius * blend.stated))
        return min((last + 1) * spacing, blend.share), min((first - 1) * spacing, blend.share)


@lru_cache(maxsize=512)
def zone_side(arm: Arm, path: JointPath, *, at_end: bool) -> ZoneSide:
    """The move from the point of a zone, which is the start or the end of a path."""
    return ZoneSide(arm, path.q[::-1] if at_end else path.q)


def zone_shares(blend: Blend, arm: Arm, q: Array) -> tuple[float, float]:
    """Return the share of a move from a point that a blend there may use: an upper bound, and the stated one.

    The points q (k, n) of the move begin at that of the blend. For a blend with a radius it is the part of the move on
    which the tcp may be within the radius of its position at the point.
    """
    return ZoneSide(arm, q).shares(blend)


def blend_cover(blend: Blend, arm: Arm, into: JointPath, out: JointPath) -> list[tuple[JointPath, Array]]:
    """Return curves, each with a tolerance (n,) in each joint, which cover what a blend between two moves may execute.

    Let a and b be the changes of the joint values from the point to configurations on the two moves within the blend.
    While both moves are superposed, the arm is at the point changed by a + b for some of them, whatever their speeds
    are; parabolas and arcs between joint moves lie there too. The curves are rows of this surface, and the tolerance of
    a row contains half of the distance of two rows, ``OTHER_CURVES`` of the largest changes if both sides were as short
    as the shorter one, by which a curve may leave the longer one, and ``CARTESIAN`` times the largest difference of the
    row from a superposition of the poses of the tcp. Where these poses cannot be solved, each joint may deviate from
    the surface by its largest change between joint moves, which controllers blend in joint space, and by any angle
    beside a linear move.
    """
    point, sides = into.end, list[Array]()
    for side in (zone_side(arm, into, at_end=True), zone_side(arm, out, at_end=False)):
        sides.append(side.points[: int(np.ceil(side.shares(blend)[0] * (len(side.points) - 1) - 1e-9)) + 1] - point)
    extent = np.abs(np.concatenate(sides)).max(axis=0)
    if len(into.q) == len(out.q) == 2:  # on one line, wherever the joint values are superposed
        ends = point + np.stack([sides[0][-1], sides[1][-1]])
        lengths = np.linalg.norm(ends - point, axis=1)
        beside = np.abs(lengths[::-1] @ ends / max(float(lengths.sum()), 1e-12) - point).max()
        if beside <= ONE_LINE:
            return [(JointPath(ends, into.joint_names), np.full(len(point), 2.0 * beside + ROUNDED))]
    one, other = sorted(sides, key=lambda side: float(np.abs(side).max()))
    # Rows along the larger side, at some changes of the smaller one
    at, along = (np.unique(np.linspace(0, len(side) - 1, ROWS + 1).round().astype(int)) for side in (one, other))
    nearest = at[np.abs(np.arange(len(one))[:, None] - at).argmin(axis=1)]
    fine = np.arange(len(other))
    chords = np.stack([np.interp(fine, along, column[along]) for column in other.T], axis=1)
    between = np.abs(one - one[nearest]).max(axis=0) + np.abs(other - chords).max(axis=0)
    between += 0.5 * (
        np.abs(np.diff(one, axis=0)).max(axis=0, initial=0.0) + np.abs(np.diff(other, axis=0)).max(axis=0)
    )
    rows = [JointPath(point + one[row] + other[along], into.joint_names) for row in at]
    # Superposed poses of the tcp, for shares of both sides that add up to at most 1; the difference of joint values is
    # nearly proportional to the product of both shares, u (1 - u) in a row
    apart, strips = np.zeros(arm.dof), len(at) - 1
    inner = np.clip(0.5, *((np.arange(strips + 1)[:, None] + [-0.5, 0.5]) / strips).T)
    most, solvable = inner * (1.0 - inner), arm.dof >= 6 and bool(arm.angular[-6:].all())
    linear = len(into.q) > 2 or len(out.q) > 2
    # Up to a singularity; of the tcp in the axes of the base, and in those of an external axis that rotates
    solvable = solvable and (not linear or superposed_regular(arm, point, *sides))
    last = np.array([len(side) - 1 for side in sides])
    used = np.maximum(np.round(np.array(SUPERPOSED) * last).astype(int), 1)
    for moved in (True, False) if arm.angular[:-6].any() else (True,):
        changes = [side[numbers] for side, numbers in zip(sides, used.T, strict=True)]
        for change in changes:
            change[:, :-6] *= moved
        here, joined, q = arm.forward_kinematics(point), point + changes[0] + changes[1], None
        if solvable:
            first, second = (arm.forward_kinematics_batch(point + change) for change in changes)
            poses = first + second - here.homogeneous
            for k, both in enumerate(zip(first, second, strict=True)):
                turn = sum(pin.log3(here.rotation.T @ pose[:3, :3]) for pose in both)
                poses[k, :3, :3] = here.rotation @ pin.exp3(turn)
            q = solve_near(arm, joined, poses)
        if q is None:
            apart, most = np.where(arm.angular, np.pi, extent) if linear else extent, np.ones(strips + 1)
            break
        differences = np.abs(q - joined) / (used / last).prod(axis=1, keepdims=True)
        apart = np.maximum(apart, CARTESIAN * differences.max(axis=0))
    short, long = (np.abs(side).max(axis=0) for side in (one, other))
    widened = OTHER_CURVES * np.maximum(short, long * (short.max() / max(float(long.max()), 1e-12)))
    return [(row, between + widened + share * apart) for row, share in zip(rows, most, strict=True)]
