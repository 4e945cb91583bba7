"""The verdict on a pick whose object moves on a conveyor, and the motion of a tool that follows it.

Times at which the tool may meet the part are tried in order, the earliest first. For each of them the stages of an
ordinary pick are judged in the cell as it is at that time: reach, limits, contacts, grip, straight lines and the place.
The motion is then made on the clock of the conveyor, and certified among the moving parts.

The tool takes up the speed of the belt, approaches the part, tracks it while the gripper closes, lifts it, and comes to
rest. In the frame of the belt the approach and the retreat are the straight lines of the pick. The tool takes up the
speed before the approach, and gives it up after the retreat. Poses are solved at short time steps and joined by a cubic
Hermite curve with the joint velocities of the exact motion of the tool.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pinproof.collision import Certificate, CollisionChecker, Mover, Upright, certify, curve_hash
from pinproof.errors import InputError, TimingError
from pinproof.ik import track
from pinproof.motion import RATE_TOLERANCE, CubicPath, Trajectory
from pinproof.picks.input.pick import Member, Pick
from pinproof.picks.input.settings import Conveyor
from pinproof.picks.judging.configurations import configurations, least_seconds
from pinproof.picks.judging.grasp import GraspCandidate, reach, screen
from pinproof.picks.judging.hand import OpenHand
from pinproof.picks.judging.lines import Attempt, Pairs, along
from pinproof.picks.judging.place import Placer, Scores
from pinproof.picks.judging.task import PickCell, PickTask, limits_torque
from pinproof.picks.judging.timing import MotionPart, part_of, timed_curve
from pinproof.picks.judging.verdict import Intercept, PickMotion, PickStatus, PickVerdict, Stage, StageResult
from pinproof.planning import Route, RouteFollower, plan_among_movers, with_turns
from pinproof.spatial import SE3, Array, translated

POSE_STEP = 0.01
"""Seconds between solved poses."""

LINE_SPEED = 1.0
"""Mean speed (m/s) of the tool along the lines, relative to the belt, in the first attempt."""

SHORTEST = 0.1
"""Seconds: the shortest duration of a phase in the first attempt."""

RESERVE = 1.03
"""Factor by which a phase is made longer than its excess over the limits requires."""

LONGEST = 10.0
"""Seconds: a phase that would take longer is not possible."""

ATTEMPTS = 12
"""Number of attempts to find durations of the phases within the limits."""

ANY_SPEED = 1e3
"""rad/s or m/s: the limits of the joints are verified on the complete curve."""


@dataclass(frozen=True, eq=False)
class Following:
    """The motion from rest to the part, on the belt while the gripper closes, and until the tool rests with the part.

    The tracking begins ``before`` seconds after the start. The deviations (m, rad) are upper bounds, at every instant,
    of the distance of the tcp from its pose on the belt while tracking.
    """

    approach: Trajectory
    tracking: Trajectory | None
    retreat: Trajectory
    before: float
    position_deviation: float
    rotation_deviation: float


def follow_belt(task: PickTask, member: Member, q: Array, belt: Conveyor) -> Following | str:
    """The motion of a tool that is at the grasp with q (n,) when the tracking begins, or why it is not possible.

    ``task`` has all poses at the time at which the tracking begins.
    """
    grasp = task.grasp(member)
    lines = tuple(end.translation - grasp.translation for end in (task.pick.before(grasp), task.pick.after(grasp)))
    into, out = (max(float(np.linalg.norm(line)) / LINE_SPEED, SHORTEST) for line in lines)
    durations = np.array([SHORTEST, into, out, SHORTEST])
    reason = ""
    for _ in range(ATTEMPTS):
        phases = _Phases(task, grasp, belt, *lines, *np.round(durations, 6).tolist())
        found = _followed(phases, q)
        if not isinstance(found, _BeltExcess):
            return found
        reason = found.reason
        durations = durations * found.longer
        if not (durations <= LONGEST).all():
            break
    return reason


class _BeltExcess(NamedTuple):
    """Limits that are exceeded, and the factors (4,) by which the phases must take longer; infinite for no remedy."""

    reason: str
    longer: Array


@dataclass(frozen=True, eq=False)
class _Phases:
    """The pose of the tip as a function of time; time 0 is the start of the tracking.

    ``take_up`` and ``give_up`` are the durations in which the speed of the belt is taken up and given up, ``into`` and
    ``out`` those of the lines, whose displacements are ``approach`` and ``retreat``.
    """

    task: PickTask
    grasp: SE3
    belt: Conveyor
    approach: Array
    retreat: Array
    take_up: float
    into: float
    out: float
    give_up: float

    @property
    def times(self) -> tuple[float, ...]:
        """The ends of the phases: the start, at the speed of the belt, at the part, it is held, lifted, and the end."""
        dwell = round(self.belt.dwell, 6)
        return -self.take_up - self.into, -self.into, 0.0, dwell, dwell + self.out, dwell + self.out + self.give_up

    def offset(self, t: float) -> tuple[Array, Array]:
        """The displacement (3,) of the tip from the grasp at time 0, and its velocity."""
        start, begin, _, end, leave, last = self.times
        along, speed = np.array(self.belt.direction), self.belt.speed
        if t < begin:
            u = (t - start) / self.take_up
            moved, rate = begin - self.take_up * (0.5 - u**3 + 0.5 * u**4), u * u * (3.0 - 2.0 * u)
        elif t > leave:
            u = (last - t) / self.give_up
            moved, rate = leave + self.give_up * (0.5 - u**3 + 0.5 * u**4), u * u * (3.0 - 2.0 * u)
        else:
            moved, rate = t, 1.0
        down, falling = _smooth(-t / self.into)
        up, rising = _smooth((t - end) / self.out)
        place = speed * moved * along + down * self.approach + up * self.retreat
        velocity = speed * rate * along - falling / self.into * self.approach + rising / self.out * self.retreat
        return place, velocity

    def target(self, offset: Array) -> SE3:
        """``base_from_tcp`` for a displacement (3,) of the tip."""
        return self.task.target(translated(self.grasp, offset))


def _smooth(u: float) -> tuple[float, float]:
    """A smooth step from 0 at u = 0 to 1 at u = 1, and its derivative."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2


def _followed(phases: _Phases, q: Array) -> Following | _BeltExcess | str:
    arm, stops = phases.task.arm, phases.times
    before, after = _solved(phases, stops[2::-1], q), _solved(phases, stops[2:], q)
    if isinstance(before, str):
        return f"before the tool is at the part on the belt: {before}"
    if isinstance(after, str):
        return f"while the tool follows the belt: {after}"
    # One curve through both, with the joint velocities of the exact motion of the tool
    times = np.concatenate([before[0][::-1], after[0][1:]])
    points = np.concatenate([before[1][::-1], after[1][1:]])
    rotation = arm.root_from_base.rotation.T
    velocities = np.array(
        [
            np.linalg.pinv(arm.jacobian(each)) @ np.concatenate([rotation @ phases.offset(t)[1], np.zeros(3)])
            for t, each in zip(times.tolist(), points, strict=True)
        ]
    )
    velocities[[0, -1]] = 0.0
    note = f"acceleration limits: {arm.limits.acceleration_source}"

    def part(first: int, last: int) -> Trajectory:
        rows = slice(*(int(np.argmin(np.abs(times - stops[k]))) + extra for k, extra in ((first, 0), (last, 1))))
        return Trajectory(times[rows] - times[rows][0], points[rows], velocities[rows], arm.joint_names, note)

    tracking = part(2, 3) if stops[3] > stops[2] else None
    pieces = [part(0, 1), part(1, 2), part(3, 4), part(4, 5)]
    if (excess := _excess(phases.task, pieces, tracking)) is not None:
        return excess
    # Upper bounds of the deviation from the line at constant speed, at every instant
    deviations = 0.0, 0.0
    if tracking is not None:
        ends = [phases.target(phases.offset(t)[0]) for t in (0.0, tracking.duration)]
        share = tracking.times / tracking.duration
        path = CubicPath(tracking.q, tracking.velocities * tracking.duration, share, tracking.joint_names)
        bounds = RouteFollower(arm=arm).bound(path, Route.straight(*ends)).max(axis=0)
        deviations = float(bounds[0]), float(bounds[1])
    return Following(part(0, 2), tracking, part(3, 5), stops[2] - stops[0], *deviations)


def _solved(phases: _Phases, stops: Sequence[float], q: Array) -> tuple[Array, Array] | str:
    """The times and configurations through the ends of phases, in either direction; q (n,) is at the first one."""
    spans = [np.linspace(a, b, max(3, int(np.ceil(abs(b - a) / POSE_STEP))) + 1) for a, b in pairwise(stops) if a != b]
    times = np.concatenate([spans[0], *(span[1:] for span in spans[1:])])
    targets = [phases.target(phases.offset(t)[0]) for t in times[1:].tolist()]
    solved = track(phases.task.arm, targets, q, dt=1.0, velocity=ANY_SPEED)
    if not solved.ok:
        return solved.message
    return times, np.vstack([q, solved.q])


def _excess(task: PickTask, pieces: Sequence[Trajectory], tracking: Trajectory | None) -> _BeltExcess | None:
    """The limits of the joints that are exceeded; None if all are kept."""
    limits, names = task.arm.limits, task.arm.joint_names
    longer, reason = np.ones(len(pieces)), ""
    for k, part in enumerate([*pieces, *([] if tracking is None else [tracking])]):
        for what, most, limit, power, unit in (
            ("speed", part.max_velocity(), limits.velocity, 1.0, "rad/s"),
            ("acceleration", part.max_acceleration(), limits.acceleration, 0.5, "rad/s^2"),
        ):
            joint = int(np.argmax(most / limit))
            share = float(most[joint] / limit[joint])
            if share <= 1.0 + RATE_TOLERANCE:
                continue
            reason = f"to follow the belt, the {what} of {names[joint]} is {most[joint]:.3g} {unit}"
            reason += f"; its limit is {limit[joint]:.3g} {unit}"
            if k == len(pieces):  # the speed of the belt is given
                return _BeltExcess(reason, np.full(len(pieces), np.inf))
            longer[k] = max(longer[k], RESERVE * share**power)
        for outside in part.range():
            if exceeded := limits.violations(outside, names):
                return _BeltExcess(f"to follow the belt: {exceeded[0]}", np.full(len(pieces), np.inf))
    return _BeltExcess(reason, longer) if reason else None


TIME_STEP = 0.1
"""Seconds between the times at which the reach of the part is determined."""

TRIED = 16
"""Largest number of times that are judged in all stages."""

SPACING = 0.3
"""Seconds between two times that are judged in all stages."""

SAMPLES = 80
"""Largest number of random configurations of a transit or a transfer among the moving parts."""

INSTANT = 1e-3
"""Seconds for which the arm rests at least while the gripper opens."""

SINK = 2e-4
"""Metres by which the curve of the joints may bring a part below the surface of its support while it is lifted or put
down. The ordinary proof is made with the support lowered by this distance; the tool deviates from its exact motion by
less."""


VALID = StageResult(Stage.INPUT, True, "valid")
"""The first stage of every pick that can be judged."""


def on_conveyor(pick: Pick, cell: PickCell) -> bool:
    """Whether the object of a pick moves on the conveyor."""
    belt = cell.shared.conveyor
    return belt is not None and isinstance(pick.carried, str) and pick.carried in belt.parts


class _InterceptRefused(Exception):
    """A stage failed at one time; ``stages`` are those after the input."""

    def __init__(self, *stages: StageResult) -> None:
        super().__init__(stages[-1].message)
        self.stages = stages


def judge_on_conveyor(pick: Pick, cell: PickCell, seeds: list[int], start_time: float = 0.0) -> PickVerdict:
    """The verdict on a pick from the conveyor; the motion starts at the home of the cell at ``start_time`` (s)."""
    # The pick is possible on this belt
    belt = cell.shared.conveyor
    try:
        task = PickTask(pick, cell)
        if belt is None:
            raise InputError("the picks state no conveyor")
        if task.name not in belt.parts:
            raise InputError(f"{task.name!r} is not on the conveyor: it was taken before")
        if unknown := [name for name in belt.parts if name not in task.scene]:
            raise InputError(f"the conveyor moves {', '.join(unknown)}, which the scene does not have")
        if limits_torque(task.cell.shared, task.pick) or pick.speed:
            raise InputError("limits of the tool speed and of torques are not supported for picks from a conveyor")
        if not 0.0 <= start_time < belt.duration:
            until = f"from 0 to {belt.duration:g} s, while the belt runs"
            raise InputError(f"start_time = {start_time!r}; it must be {until}")
    except InputError as error:
        return PickVerdict(pick, PickStatus.UNREADABLE, (StageResult(Stage.INPUT, False, str(error)),))
    # The first time at which every stage passes; otherwise the reason is that of the time with the most stages
    farthest: tuple[StageResult, ...] = ()
    tried = 0
    for time, member in _meeting_times(task, belt, start_time, seeds[0]):
        tried += 1
        try:
            return _Moment(task, belt, time, member, seeds, start_time).verdict()
        except _InterceptRefused as refused:
            farthest = max(farthest, refused.stages, key=len)
    if tried:
        failed = replace(farthest[-1], message=f"{farthest[-1].message}; the parts were tried at {tried} times")
    else:
        message = (
            f"no IK solution on the belt from {start_time:.3g} s to {belt.duration:.3g} s, in which the part moves "
            f"{belt.speed * (belt.duration - start_time):.3g} m; every {TIME_STEP:g} s was tried"
        )
        failed = StageResult(Stage.REACH, False, message)
    return PickVerdict(pick, PickStatus.NOT_FOUND, (VALID, *farthest[:-1], failed))


def _meeting_times(task: PickTask, belt: Conveyor, start_time: float, seed: int) -> Iterator[tuple[float, Member]]:
    """The times at which a grasp is in reach and the arm can be there, with the grasp; the earliest first."""
    arm, home = task.arm, task.cell.home
    times = np.arange(start_time + TIME_STEP, belt.duration - belt.dwell, TIME_STEP)
    # The first group of grasps that is in reach at any time while the belt runs
    found: list[tuple[float, int, Member]] = []
    for number, group in enumerate(task.groups()):
        for member in group:
            grasp = task.grasp(member)
            poses = [translated(grasp, belt.travel(t)) for t in times.tolist()]
            row, q = configurations(arm, task.targets(poses), home, seed)
            in_time = times[row] - start_time >= least_seconds(arm, home[None], q)[0]
            found += [(float(times[k]), number, member) for k in dict.fromkeys(row[in_time].tolist())]
        if found:
            break
    found.sort(key=lambda each: each[:2])
    # A few of the times, the earliest first
    last, count = -np.inf, 0
    for time, _, member in found:
        if time >= last + SPACING - 1e-9 and count < TRIED:
            last, count = time, count + 1
            yield time, member


class _Moment:
    """A pick at one time (s) of meeting the part; ``task`` has the cell as it is at time 0, ``then`` as it is then.

    ``stages`` are the stages passed so far, and ``motions`` those of the configuration that is tried, one after the
    other on the clock of the conveyor until ``now``. A stage that fails raises :class:`_InterceptRefused`.
    """

    def __init__(
        self, task: PickTask, belt: Conveyor, time: float, member: Member, seeds: list[int], start_time: float
    ) -> None:
        self.task, self.belt, self.time, self.member, self.seeds = task, belt, time, member, seeds
        self.start_time, self.now = start_time, start_time
        self.stages: tuple[StageResult, ...] = ()
        self.motions: list[PickMotion] = []
        self.taken = ""
        self.then = _at_time(task, belt, time)

    def _movers(self, obstacles: Container[str]) -> tuple[Mover, ...]:
        """The parts on the belt that are among the obstacles of a scene, as seen from now."""
        there = [name for part in self.belt.parts if part != self.taken for name in (part, _lowered(part))]
        names = tuple(name for name in there if name in obstacles)
        return (replace(self.belt, parts=names).mover(names).after(self.now),) if names else ()

    def _add(self, name: str, motion: Trajectory, around: CollisionChecker, certificate: Certificate) -> None:
        """Append a certified motion, with the scene and the attached bodies of a checker.

        The certificate is one of the joints and the movers together, possibly with a lowered support or with the
        volumes of closing fingers; it is marked as that of the motion of the arm among the movers.
        """
        held, movers = around.arm.held, self._movers(around.scene)
        setup = around.spec.setup_hash(movers)
        among = f"proven among the moving {', '.join(each.name for each in movers)}"
        certificate = replace(
            certificate, curve=curve_hash(motion), setup=setup, notes=(*certificate.notes, *([among] if movers else []))
        )
        self.motions.append(PickMotion(name, motion, certificate, around.attached, around.scene, held, movers=movers))
        self.now = self.start_time + Trajectory.join(*(each.trajectory for each in self.motions)).duration

    def _prove(
        self, motion: Trajectory, checker: CollisionChecker, constraints: tuple[Upright, ...] = ()
    ) -> Certificate:
        """The certificate of a motion that starts now; parts on the belt are known only while the belt runs."""
        movers, end = self._movers(checker.scene), self.now + motion.duration
        if end > self.belt.duration and movers:
            until = f"the belt runs until {self.belt.duration:g} s"
            raise self._refused(Stage.TIMING, f"the pick lasts until {end:.4g} s at least, and {until}")
        return certify(motion, checker, movers=movers, constraints=constraints)

    def _refused(self, stage: Stage, reason: str) -> _InterceptRefused:
        return _InterceptRefused(*self.stages, StageResult(stage, False, reason))

    def verdict(self) -> PickVerdict:
        """The good verdict."""
        reached = reach(self.then, [self.member], self.seeds[0])
        if not len(reached.q):
            raise _InterceptRefused(*reached.stages)
        screened = screen(self.then, [self.member], reached)
        at_grasp = (*reached.stages, *screened.stages)
        if not screened.candidates:
            raise _InterceptRefused(*at_grasp)
        home = self.task.cell.home
        # The configurations that home reaches first
        order = sorted(
            screened.candidates, key=lambda each: float(least_seconds(self.task.arm, home[None], each.q[None])[0, 0])
        )
        failed: tuple[StageResult, ...] = ()
        for candidate in order[: self.task.cell.budget.configurations]:
            self.stages = at_grasp
            try:
                return self._complete(candidate, len(reached.q))
            except _InterceptRefused as refused:
                failed = max(failed, refused.stages, key=len)
        raise _InterceptRefused(*failed)

    def _complete(self, candidate: GraspCandidate, tried: int) -> PickVerdict:
        # The lines of the grasp, at the full rotations nearest to home, in the frame of the belt
        home = self.task.cell.home
        many, _ = with_turns(self.task.arm, home, candidate.q[None])
        nearest = many[np.abs(many - home).max(axis=1).argmin()]
        attempt = along(self.then, replace(candidate, q=nearest))
        self.stages += attempt.stages
        if not attempt.passed:
            raise _InterceptRefused(*self.stages)
        followed = follow_belt(self.then, self.member, attempt.q, self.belt)
        if isinstance(followed, str):
            raise self._refused(Stage.TIMING, followed)
        # All motions on the clock of the belt
        self.motions, self.taken, self.now = [], "", self.start_time
        self.stages = (*self.stages, self._transit(followed))
        self._take(followed, attempt)
        grasp_time = self.now - self.start_time - followed.retreat.duration
        release_time, placed = self._place(attempt, followed)
        # The good verdict
        motion = Trajectory.join(*(each.trajectory for each in self.motions))
        clearance = min(each.certificate.clearance for each in self.motions)
        message = (
            f"collision-free among the moving parts in {len(self.motions)} motions; the tool meets the part at "
            f"{self.time:.3g} s, after {self.belt.speed * self.time:.3g} m, and follows it for {self.belt.dwell:g} s "
            f"with a deviation of at most {followed.position_deviation * 1e3:.2g} mm"
        )
        figures = {"duration": motion.duration, "clearance": clearance, "deviation": followed.position_deviation}
        deviations = followed.position_deviation, followed.rotation_deviation
        return PickVerdict(
            self.task.pick,
            PickStatus.GOOD,
            (VALID, *self.stages, placed, StageResult(Stage.TIMING, True, message, figures)),
            tried,
            attempt.q,
            motion,
            grasp_time,
            motions=tuple(self.motions),
            release_time=release_time,
            member=self.member.words,
            grip=self.task.grip(self.member),
            intercept=Intercept(self.start_time, self.time, self.belt.speed * self.time, *deviations),
        )

    def _transit(self, followed: Following) -> StageResult:
        """From home to the start of the approach, where the arm waits until it follows the belt."""
        outside = self.task.outside
        leave = round(self.time - followed.before, 9)
        if leave <= self.start_time:
            late = f"the tool would have to take up the speed of the belt at {leave:.3g} s, before the start"
            raise self._refused(Stage.TRANSIT, late)
        plan = plan_among_movers(
            outside,
            self.task.cell.home,
            followed.approach.start,
            (self.belt.mover(self.belt.parts),),
            start_time=self.start_time,
            window=(leave, leave),
            samples=SAMPLES,
            rng=self.seeds[1],
        )
        if not plan.ok:
            raise self._refused(Stage.TRANSIT, f"to the start of the approach: {plan.message}")
        self._add("transit", plan.trajectory, outside, plan.certificate)
        message = f"{plan.trajectory.duration:.3g} s, of which the arm waits {plan.waiting:.3g} s"
        return StageResult(Stage.TRANSIT, True, message, {"waiting": plan.waiting})

    def _take(self, followed: Following, attempt: Attempt) -> None:
        """The approach, the tracking while the gripper closes, and the retreat with the part."""
        task = self.task

        def prove(
            stage: Stage, motion: Trajectory, around: CollisionChecker, judge: CollisionChecker, hand: OpenHand | None
        ) -> None:
            # All bodies are proven against the checker of the stage, then the hand against the part alone
            name = "tracking" if stage is Stage.GRIP else stage.value
            proof = self._prove(motion, judge)
            why = "" if proof.free else proof.message
            if hand is not None and not why:
                there, start, pose = self._movers([hand.part.name]), self.now, hand.part.pose
                failure = hand.prove(
                    motion,
                    None,
                    movers=there,
                    part_at=lambda time: translated(pose, self.belt.travel(start + time)),
                    closing=stage is Stage.GRIP,
                )
                why = "" if failure is None else failure.reason
            if why:
                raise self._refused(stage, f"{name} on the moving belt: {why}")
            self._add(name, motion, around, proof)

        # The hand may touch the part until it holds it; then the part moves with the hand off its support
        hand = task.passing(self.member)
        prove(Stage.APPROACH, followed.approach, task.at_grasp, task.at_grasp, hand)
        if followed.tracking is not None:
            closing = task.closing(self.member) if task.cell.fingers else task.at_grasp
            prove(Stage.GRIP, followed.tracking, task.at_grasp, closing, hand)
        carrying, self.taken = task.carrying(self.member), str(task.name)
        prove(Stage.RETREAT, followed.retreat, carrying, _with_lowered(carrying, attempt.parting), None)

    def _place(self, attempt: Attempt, followed: Following) -> tuple[float | None, StageResult]:
        """The transfer, the lowering and the retreat with the empty hand; the time of the release."""
        if self.task.place is None:
            return None, StageResult(Stage.PLACE, True, "none requested")
        # The transfer begins where the tool comes to rest with the part
        there = replace(attempt, retreat=None, q=followed.retreat.end)
        result, placing = Placer(self.then, self.seeds[1]).place(there, self.seeds[1:3], Scores())
        if placing is None:
            raise _InterceptRefused(*self.stages, result)
        task, member = self.task, self.member
        self._move(part_of(task, member, "transfer", () if placing.transfer is None else (placing.transfer,)))
        if placing.lift is not None:
            self._move(part_of(task, member, "place", (placing.lift.reversed(),), placing.parting))
        # The arm rests while the gripper opens
        here, names = self.motions[-1].trajectory.end, task.arm.joint_names
        still = Trajectory(
            [0.0, max(self.belt.dwell, INSTANT)], np.array([here, here]), np.zeros((2, len(here))), names
        )
        opened = self._prove(still, task.opening(member) if task.cell.fingers else task.letting_go(member))
        if not opened.free:
            raise self._refused(Stage.PLACE, f"at the release: {opened.message}")
        self._add("release", still, task.carrying(member), opened)
        release = self.now - self.start_time
        if placing.leave is not None:
            self._move(part_of(task, member, "leave", (placing.leave,)))
        return release, result

    def _move(self, part: MotionPart) -> None:
        """Time and certify a part of the place; a transfer that meets a moving part is planned again, with waits."""
        try:
            motion = timed_curve(self.task, part, part.curves[0], [])[0]
        except TimingError as error:
            raise self._refused(Stage.PLACE, f"{part.name}: {error}") from error
        judge = _with_lowered(part.checker, part.parting)
        proof, movers = self._prove(motion, judge, part.constraints), self._movers(judge.scene)
        if not proof.free and part.name == "transfer" and movers and not part.constraints:
            plan = plan_among_movers(judge, motion.start, motion.end, movers, samples=SAMPLES, rng=self.seeds[1])
            if plan.ok:
                motion, proof = plan.trajectory, plan.certificate
        if not proof.free:
            raise self._refused(Stage.PLACE, f"{part.name}: {proof.message}")
        if part.passing is not None and (failure := part.passing.prove(motion, motion.start)) is not None:
            raise self._refused(Stage.PLACE, f"{part.name}: {failure.reason}")
        self._add(part.name, motion, part.checker, proof)


def _at_time(task: PickTask, belt: Conveyor, time: float) -> PickTask:
    """The pick with all poses as they are at a time (s)."""
    scene, by = task.scene, belt.travel(time)
    for name in belt.parts:
        if name in scene:
            scene = scene.move(name, translated(scene[name].pose, by))
    pick = replace(task.pick, pose=translated(task.pick.pose, by), place=task.place)
    return PickTask(pick, replace(task.cell, checker=task.cell.checker.with_scene(scene)))


def _lowered(name: str) -> str:
    """The name of the lowered copy of a support."""
    return f"{name} (lowered)"


def _with_lowered(checker: CollisionChecker, pairs: Pairs) -> CollisionChecker:
    """The checker in which the object is checked against copies of its supports that are lower by :data:`SINK`.

    The object rests on a support at the start or at the end of the motion, where the margin does not apply to the pair.
    """
    if not pairs:
        return checker
    scene = checker.scene
    for name in dict.fromkeys(name for _, name in pairs):
        support, by = scene[name], np.array([0.0, 0.0, checker.margin + SINK])
        lower = replace(support, name=_lowered(name), pose=translated(support.pose, -by))
        same = [
            (a if a != name else lower.name, b if b != name else lower.name) for a, b in scene.allowed if name in (a, b)
        ]
        scene = replace(scene.add(lower), allowed=(*scene.allowed, *same))
    return checker.with_scene(scene).allowing(*pairs)
