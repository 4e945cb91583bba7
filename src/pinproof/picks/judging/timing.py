"""The timing stage: every part of the motion is timed within the limits and certified exactly as executed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinproof.collision import Certificate, CollisionChecker, Upright, certify
from pinproof.collision.certificate import curve_hash
from pinproof.errors import InputError, TimingError
from pinproof.motion import (
    BlendedPath,
    CubicPath,
    JointPath,
    MotionProgram,
    RateConstraint,
    Trajectory,
    time_parametrise,
)
from pinproof.motion.trajectory_files import seconds, whole_nanoseconds
from pinproof.picks.input.pick import PARTS, Member
from pinproof.picks.judging.lines import Attempt, Pairs, passing_at
from pinproof.picks.judging.motion_limits import peaks_of, rate_limits
from pinproof.picks.judging.place import Placing
from pinproof.picks.judging.task import Task
from pinproof.picks.judging.verdict import PickMotion, Stage, StageResult
from pinproof.planning import optimise
from pinproof.planning.optimisation import with_moving_ends

__all__ = [
    "MotionPart",
    "Timed",
    "certify_displaced",
    "motion_parts",
    "prove_part",
    "recertify",
    "time_motion",
    "time_part",
    "timed_curve",
]

BACKWARDS = "proven for the reversed motion, in which the object leaves its support"


ENTRANCE_SPEEDS = (1.2, 0.7)
"""Speeds at the beginning of the approach that are tried, as shares of its largest speed between two stops."""


@dataclass(frozen=True, eq=False)
class Timed:
    """The motions of a complete pick, and the times (s) of the grasp and the release."""

    motions: tuple[PickMotion, ...]
    trajectory: Trajectory
    grasp_time: float
    release_time: float | None


@dataclass(frozen=True, eq=False)
class MotionPart:
    """A part of a pick's motion before it is timed: its curves, and the conditions under which it is certified."""

    name: str
    curves: tuple[JointPath | BlendedPath | CubicPath, ...]
    checker: CollisionChecker
    parting: Pairs = ()
    backwards: bool = False
    passing: CollisionChecker | None = None
    constraints: tuple[Upright, ...] = ()
    lines: tuple[str, ...] = ()

    @property
    def stages(self) -> tuple[str, ...]:
        """The name of the stage of each curve, whose limits of speed apply."""
        return self.lines or (self.name,) * len(self.curves)


def time_motion(
    task: Task, attempt: Attempt, path: JointPath, placing: Placing | None
) -> tuple[StageResult, Timed | None]:
    """Time and certify all parts of a motion."""
    motions: list[PickMotion] = []
    trajectories: list[Trajectory] = []
    until_grasp: list[Trajectory] = []
    until_release: list[Trajectory] = []
    now = ""
    try:
        for part in motion_parts(task, attempt, path, placing):
            now = part.name
            timed, motion, why = time_part(task, part, attempt)
            if motion is None:
                return StageResult(Stage.TIMING, False, f"{now}: {why}"), None
            motions.append(motion)
            trajectory = motion.trajectory
            trajectories.append(trajectory)
            if part.name == "pick":
                until_grasp = timed[: 1 + (attempt.approach is not None)]
            elif part.name in ("transit", "approach"):
                until_grasp = [*trajectories]
            elif part.name in ("transfer", "place"):
                until_release = [*trajectories]
        grasp_time = _joined_duration(until_grasp)
        release_time = _joined_duration(until_release) if until_release else None
        joined = Trajectory.join(*trajectories)
    except TimingError as error:
        return StageResult(Stage.TIMING, False, f"{now}: {error}"), None
    pairs = max(motion.certificate.pairs for motion in motions)
    clearance = min(motion.certificate.clearance for motion in motions)
    parts = f" in {len(motions)} motions" if len(motions) > 1 else ""
    message = f"collision-free{parts} ({pairs} body pair{'' if pairs == 1 else 's'} proven)"
    figures = {"duration": joined.duration, "clearance": clearance}
    if torques := [(peak.share, peak, motion.name) for motion in motions for peak in motion.torques]:
        share, peak, name = max(torques, key=lambda each: each[0])
        torque = f"{peak.torque:.3g} {peak.unit} of {peak.joint}, {100 * share:.0f} % of its limit"
        message += f"; largest torque {torque}, in {name}"
        figures["torque_share"] = share
    return StageResult(Stage.TIMING, True, message, figures), Timed(tuple(motions), joined, grasp_time, release_time)


def _joined_duration(parts: list[Trajectory]) -> float:
    """The duration (s) of trajectories that are joined, whose times are whole nanoseconds."""
    return float(seconds(np.sum([whole_nanoseconds(np.array(part.duration)) for part in parts])))


def time_part(task: Task, part: MotionPart, attempt: Attempt) -> tuple[list[Trajectory], PickMotion | None, str]:
    """Time and certify a part of a motion: its timed curves, the certified motion, or None and the reason.

    Raises
    ------
    TimingError
        If a curve cannot be timed within the limits.
    """
    rates = [rate_limits(task, attempt.candidate.member, name, part.checker) for name in part.stages]
    shortest = [timed_curve(task, part, *each) for each in zip(part.curves, rates, strict=True)]
    timed = [trajectory for trajectory, _ in shortest]
    if part.name == "pick" and attempt.approach is not None:
        timed[:2] = _without_stop(task, part, timed, rates) or timed[:2]
    trajectory = Trajectory.join(*timed)
    certificate = (shortest[0][1] if len(shortest) == 1 else None) or prove_part(part, trajectory)
    if not certificate.free:
        return timed, None, certificate.message
    around, peaks = part.checker, peaks_of(rates[0], trajectory)
    motion = PickMotion(part.name, trajectory, certificate, around.attached, around.scene, around.arm.held, peaks)
    return timed, motion, ""


def timed_curve(
    task: Task, part: MotionPart, curve: JointPath | BlendedPath | CubicPath, rates: list[RateConstraint]
) -> tuple[Trajectory, Certificate | None]:
    """The timed curve. A path of the planner, but not a line, may become a shorter motion with a certificate."""
    limits, budget = task.arm.limits, task.cell.budget.motion
    if budget == 0 or isinstance(curve, CubicPath):
        return time_parametrise(curve, limits, rate_limits=rates), None
    kept = part.constraints
    result = optimise(curve, part.checker, limits=limits, rate_limits=rates, constraints=kept, budget=budget)
    return result.trajectory, result.certificate


def _without_stop(
    task: Task, part: MotionPart, timed: list[Trajectory], rates: list[list[RateConstraint]]
) -> list[Trajectory] | None:
    """The transit and the approach without the stop between them; None if this is not shorter.

    The speed at the entrance is near the largest one of the line between two stops, or less.
    """
    limits, line = task.arm.limits, part.curves[1]
    if task.cell.budget.motion == 0 or part.constraints or len(timed[1].q) == 1:
        return None
    points = line.bezier()[1]
    tangent = points[0, 1] - points[0, 0]
    if not tangent.any():
        return None
    peak = np.linalg.norm(timed[1].velocities, axis=1).max() / np.linalg.norm(tangent)
    for share in ENTRANCE_SPEEDS:
        try:
            entering = time_parametrise(line, limits, start_velocity=share * peak * tangent, rate_limits=rates[1])
        except (InputError, TimingError):  # too fast for the line or for a limit
            continue
        longest = timed[0].duration + timed[1].duration - entering.duration
        velocity, rest = np.asarray(entering.velocities[0]), np.zeros(task.arm.dof)
        arriving = with_moving_ends(
            timed[0],
            part.checker,
            limits=limits,
            start_velocity=rest,
            end_velocity=velocity,
            longest=longest,
            rate_limits=rates[0],
        )
        if arriving is not None:
            return [arriving, entering]
    return None


def recertify(task: Task, program: MotionProgram) -> tuple[Certificate, ...]:
    """Certify the motions of a program again in the present cell, each as :func:`time_motion` certifies it.

    Raises
    ------
    InputError
        If the pick has no grasp of the program's family, no motion of a name of the program, or another object.
    """
    members = [member for group in task.groups() for member in group]
    member = next((each for each in members if each.words == program.member), None)
    if member is None:
        raise InputError(f"pick {task.pick.name!r} has no grasp {program.member!r}, with which the program was made")
    found = []
    for key, trajectory in program.motions.items():
        name = program.certificates[key].name
        part = _part_again(task, member, name, trajectory)
        found.append(prove_part(part, trajectory))
    return tuple(found)


def certify_displaced(task: Task, member: Member, motion: PickMotion, by: float) -> Certificate:
    """Certify a motion of a pick again, for a part that is displaced by up to ``by`` metres from its stated pose.

    No point of the part is farther than ``by`` from where it is stated: in the scene before the grasp, and in the hand
    after it. It is assumed to still rest on its support, whose margin is not changed where the two separate. A pick
    without an object does not state which obstacle is its part; then every obstacle may be displaced.
    """
    part = _part_again(task, member, motion.name, motion.trajectory)
    if task.name is None:
        return certify(motion.trajectory, part.checker, obstacle_tolerance=by, constraints=part.constraints)
    wider = _with_wider_margins(part.checker, task.name, by, part.parting)
    passing = None if part.passing is None else part.passing.padded(by)
    return prove_part(replace(part, checker=wider, passing=passing), motion.trajectory)


def _with_wider_margins(checker: CollisionChecker, name: str, by: float, kept: Pairs) -> CollisionChecker:
    """The checker with margins that are larger by ``by`` metres for all pairs of the named body, except those kept."""
    margins = {}
    for pair, (i, j) in enumerate(checker.pairs):
        owners = checker.bodies[i].owner, checker.bodies[j].owner
        wider = name in owners and not any(set(owners) == set(each) for each in kept)
        margins[owners] = float(checker.margins[pair]) + (by if wider else 0.0)
    return checker.with_margin(checker.margin, margins)


def _part_again(task: Task, member: Member, name: str, trajectory: Trajectory) -> MotionPart:
    """The part of a motion, with the checker and the conditions under which it is certified."""
    one = task.name is None
    parts = ("pick", "transit", "approach", "retreat") if one else PARTS
    if name not in parts:
        what = "without an object" if one else f"with object {task.name!r}"
        raise InputError(f"the program has a motion {name!r}, which does not exist in a pick {what}")
    if one or name == "transit":
        return MotionPart(name, (), task.outside)
    if name == "approach":
        return MotionPart(name, (), task.at_grasp, passing=task.passing)
    if name == "leave":
        return MotionPart(name, (), task.letting_go(member), passing=task.passing_off(member))
    carrying, kept = task.carrying(member), task.constraints(member)
    if name == "retreat":
        parting = task.supports(carrying, trajectory.start, task.pick.support)
        return MotionPart(name, (), carrying, parting, constraints=kept)
    if name == "place":
        stated = None if task.place is None else task.place.support
        parting = task.supports(carrying, trajectory.end, stated)
        return MotionPart(name, (), carrying, parting, backwards=True, constraints=kept)
    return MotionPart(name, (), carrying, constraints=kept)


def motion_parts(
    task: Task, attempt: Attempt, path: JointPath, placing: Placing | None, *, separate: bool = False
) -> list[MotionPart]:
    """The parts of a complete motion.

    If ``separate``, the transit, the approach and the retreat of a pick without an object are three parts, with rests
    between them, instead of one.
    """
    line_in, line_out = attempt.line_in(), attempt.line_out()
    into = () if line_in is None else (line_in.reversed(),)
    out = () if line_out is None else (line_out,)
    if task.name is None and separate:
        own = [("transit", (path,)), ("approach", into), ("retreat", out)]
        return [MotionPart(name, curves, task.outside) for name, curves in own if curves]
    if task.name is None:  # without an object one proof covers the complete motion
        lines = ("transit", *("approach" for _ in into), *("retreat" for _ in out))
        return [MotionPart("pick", (path, *into, *out), task.outside, lines=lines)]
    member = attempt.candidate.member
    carrying, kept = task.carrying(member), task.constraints(member)
    parts = [MotionPart("transit", (path,), task.outside)]
    parts += [MotionPart("approach", into, task.at_grasp, passing=task.passing)] if into else []
    parts += [MotionPart("retreat", out, carrying, attempt.parting, constraints=kept)] if out else []
    if placing is None:
        return parts
    parts.append(MotionPart("transfer", (placing.transfer,), carrying, constraints=kept))
    if placing.lift is not None:
        lowering = (placing.lift.reversed(),)
        parts.append(MotionPart("place", lowering, carrying, placing.parting, backwards=True, constraints=kept))
    if placing.leave is not None:
        parts.append(MotionPart("leave", (placing.leave,), task.letting_go(member), passing=task.passing_off(member)))
    return parts


def prove_part(part: MotionPart, trajectory: Trajectory) -> Certificate:
    """The certificate of a timed part; of several conditions, that of the first that is not proven."""
    if not part.backwards or not part.parting:
        proof = certify(trajectory, part.checker, parting=part.parting, constraints=part.constraints)
    else:
        proof = certify(_backwards(trajectory), part.checker, parting=part.parting, constraints=part.constraints)
        # both directions have the same configurations, so the proof applies to both
        proof = replace(proof, curve=curve_hash(trajectory), backwards=True, notes=(*proof.notes, BACKWARDS))
    if proof.free and part.passing is not None:
        q = trajectory.end if part.name == "approach" else trajectory.start
        passed = certify(trajectory, passing_at(part.passing, q))
        if not passed.free:
            return replace(passed, message=f"the open fingers collide with the object: {passed.message}")
    return proof


def _backwards(trajectory: Trajectory) -> Trajectory:
    """The reversed trajectory."""
    times = trajectory.times[-1] - trajectory.times[::-1]
    curvature = None if trajectory.accelerations is None else trajectory.accelerations[::-1]
    return Trajectory(
        times - times[0],
        trajectory.q[::-1],
        -np.asarray(trajectory.velocities[::-1]),
        trajectory.joint_names,
        trajectory.limits_note,
        accelerations=curvature,
    )
