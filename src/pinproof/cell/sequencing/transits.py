"""The certified motions of a sequence, each in the scene of its moment.

The transit to a pick starts where the pick before ended, not at home. A trajectory that was found before is certified
again in the present scene, and planned anew only if it is not proven free.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pinproof.cell.sequencing.options import Job, PickOption
from pinproof.collision import CollisionChecker, Scene
from pinproof.common.structs import described, key
from pinproof.errors import TimingError
from pinproof.motion import Bounds, JointPath, MotionLimits, RateConstraint, Trajectory, least_times, time_parametrise
from pinproof.picks import (
    Member,
    MotionPart,
    Pick,
    PickMotion,
    PickSetup,
    PickStatus,
    PickTask,
    PickVerdict,
    Placer,
    Release,
    Stage,
    StageResult,
    closing_words,
    motion_parts,
    part_of,
    peaks_of,
    prove_part,
    rate_limits,
    time_part,
    torque_limits_of_tool,
    transit,
)
from pinproof.planning import optimise, plan, planner_of
from pinproof.spatial import Array

RETRIED = 1.02
"""A motion that takes this multiple of its lower bound is searched again with other random numbers."""

SAMPLES = 15
"""Number of points of such a motion through which the path leads from which these searches start."""

SEARCHES, SEARCH_FACTOR = 4, 3
"""Number of these searches, and their budget as a multiple of that of the first one."""


@described(eq=False)
class MotionFailure:
    """Why a pick cannot be executed at its position in the sequence."""

    part: str = key("the part of the motion that failed")
    reason: str = key("the message of the planner or of the certificate")
    bodies: tuple[str, ...] = key("the names of the bodies of the first contact, if one was found", default=())


@dataclass(frozen=True, eq=False)
class SequencedPick:
    """A pick at its position in a sequence."""

    # The scene of the moment.
    scene: Scene
    # (n,) the end of the motion before.
    q: Array
    # The choice for the pick.
    option: PickOption
    # The index of the pick, for its random stream.
    index: int
    # The pick before, if the tool is changed after it.
    other_tool: Pick | None
    # Trajectories that were found before for parts of the motion, by name.
    known: Mapping[str, Trajectory]


@dataclass(frozen=True, eq=False)
class StepMotions:
    """Plans, times and certifies the motions of steps."""

    # The cell before the sequence.
    setup: PickSetup

    def __call__(self, _start: int, steps: Sequence[SequencedPick]) -> list[PickVerdict | MotionFailure]:
        """The certified motions of each step, or the reason of the failure."""
        return [self.certified(step) for step in steps]

    def certified(self, step: SequencedPick) -> PickVerdict | MotionFailure:
        """The certified motions of a step, or the reason of the failure."""
        setup, option, known = self.setup, step.option, step.known
        q, motions = step.q, list[PickMotion]()
        if step.other_tool is not None:
            # The arm brings the tool of the pick before to its home, where the tools are changed
            back = closing_motion(setup, step.scene, q, setup.home, known, step.other_tool, "return")
            if isinstance(back, MotionFailure):
                return back
            q, motions = setup.home, [back]
        task = PickTask(option.pick, replace(setup.cell, checker=setup.checker.with_scene(step.scene), home=q))
        member, place, joints = option.attempt.candidate.member, task.place, task.arm.joint_names
        seeds = setup.rng(step.index).integers(2**31, size=4).tolist()
        carrying, release = task.carrying(member), option.release
        # The fingers move beside the parts of this moment; the options know only the parts that stay
        if task.name is not None and task.cell.fingers:
            moving = [("grip", task.closing(member), option.attempt.q)]
            moving += [] if release is None else [("release", task.opening(member), release.q)]
            for name, checker, at in moving:
                if not (found := checker.check(at)).free:
                    return MotionFailure(name, closing_words(task, member, found), found.contacts[0].bodies)
        attempt = replace(option.attempt, parting=task.supports(carrying, option.attempt.q, option.pick.support))
        # Transit and transfer: the known motions if they are proven free in this scene, else new paths
        limits = partial(rate_limits, task, member)
        again = {name: _again(part_of(task, member, name), known, limits) for name in ("transit", "transfer")}
        path = JointPath(np.array([attempt.entrance]), joints)
        placing: Release | None = None
        if again["transit"] is None:
            crossing = transit(task, [attempt], task.cell.budget.nodes, seeds[:2])
            if crossing.path is None:
                return MotionFailure("transit", crossing.result.message)
            path = crossing.path
        if release is not None and place is not None:
            release = replace(release, parting=task.supports(carrying, release.q, place.support))
            placing = replace(release, transfer=JointPath(np.array([release.entrance]), joints))
            if again["transfer"] is None:
                result, made = Placer(task, seeds[0]).transfer(place, attempt, release, seeds[2:])
                if made is None:
                    return MotionFailure("transfer", result.message)
                placing = replace(release, transfer=made.transfer)
        # Every part is timed and certified; what is in contact first is named where that fails
        try:
            for part in motion_parts(task, attempt, path, placing, separate=True):
                motion = again.get(part.name) or _again(part, known, limits)
                if motion is None:
                    motion, why = time_part(task, part, attempt)
                    if motion is None:
                        own = part.checker.arm.limits
                        timed = Trajectory.join(*(time_parametrise(curve, own) for curve in part.curves))
                        contact = prove_part(part, timed).first_contact
                        return MotionFailure(part.name, why, () if contact is None else contact.bodies)
                motions.append(motion)
        except TimingError as error:
            return MotionFailure("timing", str(error))
        grip = None if task.name is None else task.grip(member)
        good = PickVerdict(task.pick, PickStatus.GOOD, (), 1, attempt.q, member=member.words, grip=grip)
        return _with_motions(good, motions)


RateLimits = Callable[[str, CollisionChecker], list[RateConstraint]]
"""The limits beside those of the joints of a motion of this name with a checker."""


def _again(part: MotionPart, known: Mapping[str, Trajectory], limits: RateLimits) -> PickMotion | None:
    """A known trajectory of a part, certified again; None if it does not exist or is not proven free."""
    trajectory = known.get(part.name)
    if trajectory is None:
        return None
    certificate = prove_part(part, trajectory)
    if not certificate.free:
        return None
    around, peaks = part.checker, peaks_of(limits(part.name, part.checker), trajectory)
    return PickMotion(part.name, trajectory, certificate, around.attached, around.scene, around.arm.held, peaks)


def closing_motion(
    setup: PickSetup,
    scene: Scene,
    q: Array,
    end: Array,
    known: Mapping[str, Trajectory],
    pick: Pick,
    name: str = "transit",
) -> PickMotion | MotionFailure:
    """The certified motion with the empty hand of a pick from q (n,) to ``end`` (n,)."""
    cell = setup.cell.for_pick(pick)
    checker = cell.checker.with_scene(scene)
    torques = torque_limits_of_tool(checker.arm, cell.shared)
    rates: list[RateConstraint] = [] if torques is None else [torques]
    if (again := _again(MotionPart(name, (), checker), known, lambda *_: rates)) is not None:
        return again
    planner = planner_of(setup.budget.planner).limited_to(setup.budget.nodes)
    motion = plan(checker, q, end, planner=planner, rate_limits=rates, blend=False, budget=setup.budget.motion)
    if not motion.ok:
        return MotionFailure(name, f"to the end: {motion.message}")
    around, peaks = (checker.attached, checker.scene, checker.arm.held), peaks_of(rates, motion.trajectory)
    return PickMotion(name, motion.trajectory, motion.certificate, *around, peaks)


def scene_after(scene: Scene, job: Job, option: PickOption) -> Scene:
    """The scene after a pick: its part is at its place."""
    if job.before is not None:
        scene = scene.remove(job.before.name)
    return scene if option.after is None else scene.add(option.after)


@dataclass(frozen=True, eq=False)
class LongMotions:
    """Searches longer for the motions of a step that take much longer than their bounds."""

    # The cell before the sequence.
    setup: PickSetup

    def __call__(self, _start: int, steps: Sequence[tuple[Scene, PickVerdict, Sequence[str]]]) -> list[PickVerdict]:
        """The verdict of each step with the named motions, transit or transfer, as short as was found."""
        return [self.shorter(*step) for step in steps]

    @staticmethod
    def of(setup: PickSetup, motion: PickMotion) -> bool:
        """Whether a motion is searched again."""
        wanted = motion.name in ("transit", "transfer")
        return wanted and motion.trajectory.duration > RETRIED * _least(motion.trajectory, setup.checker.arm.limits)

    def shorter(self, scene: Scene, verdict: PickVerdict, names: Sequence[str]) -> PickVerdict:
        """The verdict with the shortest motions of these names that were found."""
        checker = self.setup.checker.with_scene(scene)
        task = PickTask(verdict.pick, replace(self.setup.cell, checker=checker))
        member = next(m for group in task.groups() for m in group if m.words == verdict.member)
        motions = [_searched(task, member, motion) if motion.name in names else motion for motion in verdict.motions]
        return _with_motions(verdict, motions)


def _searched(task: PickTask, member: Member, motion: PickMotion) -> PickMotion:
    """The shortest motion of several searches, which start from the path of the given one."""
    best, moved, limits, part = motion, motion.trajectory, task.arm.limits, part_of(task, member, motion.name)
    least = _least(moved, limits)
    rates = rate_limits(task, member, part.name, part.checker)
    # points of the motion, through which the searches start
    inner = np.asarray(moved(np.linspace(0.0, moved.duration, SAMPLES)))[1:-1]
    path = JointPath(np.vstack([moved.start, inner, moved.end]), moved.joint_names)
    for seed in range(1, SEARCHES + 1):
        shorter = optimise(
            path,
            part.checker,
            limits=limits,
            rate_limits=rates,
            constraints=part.constraints,
            rng=seed,
            budget=SEARCH_FACTOR * task.cell.budget.motion,
        )
        if shorter.certificate.free and shorter.duration < best.trajectory.duration:
            peaks = peaks_of(rates, shorter.trajectory)
            best = replace(best, trajectory=shorter.trajectory, certificate=shorter.certificate, torques=peaks)
        if best.trajectory.duration <= RETRIED * least:
            break
    return best


def _least(trajectory: Trajectory, limits: MotionLimits) -> float:
    """Lower bound (s) of the time of a motion between the ends of a trajectory, without obstacles."""
    bounds = Bounds.of(limits, trajectory.joint_names)
    return float(least_times(trajectory.end - trajectory.start, bounds))


def _with_motions(verdict: PickVerdict, motions: list[PickMotion]) -> PickVerdict:
    """The verdict with these motions, and its times and its stage for them."""
    grasp = [motion.trajectory for motion in motions if motion.name in ("return", "transit", "approach")]
    upto = [motion.trajectory for motion in motions if motion.name != "leave"]
    joined = Trajectory.join(*(motion.trajectory for motion in motions))
    clearance = min(motion.certificate.clearance for motion in motions)
    result = StageResult(
        Stage.TIMING,
        True,
        f"collision-free in {len(motions)} motions",
        {"duration": joined.duration, "clearance": clearance},
    )
    return replace(
        verdict,
        stages=(result,),
        trajectory=joined,
        grasp_time=Trajectory.join(*grasp).duration,
        motions=tuple(motions),
        release_time=None if verdict.pick.place is None else Trajectory.join(*upto).duration,
    )
