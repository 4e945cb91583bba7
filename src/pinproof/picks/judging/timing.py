"""The timing stage: every part of the motion is timed within the limits and certified exactly as executed.

With stops, the transit ends at rest where the approach begins, and the approach starts from rest. Where possible, the
transit ends on the line instead, with the velocity of the line there, and only the part of the line next to the part is
followed. The same holds for the end of the retreat, and for the start of the approach to a place. The result is never
slower than the motion with stops, and is certified; if that fails, the arm stops.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, ExecutedPart, Upright, certify, curve_hash
from pinproof.common.steps import step
from pinproof.errors import InputError, SlipError, TimingError
from pinproof.model import Arm
from pinproof.motion import (
    BlendedPath,
    Bounds,
    CubicPath,
    JointPath,
    RateConstraint,
    Trajectory,
    least_times,
    rest,
    time_parametrise,
)
from pinproof.picks.input.pick import PARTS, RETURN, Member
from pinproof.picks.judging.hand import OpenHand
from pinproof.picks.judging.hold import held_in_motion
from pinproof.picks.judging.lines import Attempt, Pairs
from pinproof.picks.judging.place import Release
from pinproof.picks.judging.task import CARRYING, PickTask, peaks_of, rate_limits
from pinproof.picks.judging.verdict import PickMotion, PickStatus, PickVerdict, Stage, StageResult
from pinproof.planning import MovingEnds, optimise
from pinproof.spatial import Array

SPEEDS = (1.2, 0.95, 0.7)
"""Speeds at the outer end of a line that are tried, as shares of its largest speed between two stops. The largest
possible share is 1.41, for a line on which the acceleration is constant."""

MOST_SHORTENED = 0.75
"""Largest straight share for which the rest of a line is left out. With a larger one, the motion between two stops has
little speed there, and the complete line with a moving end is faster."""

SAMPLES = 64
"""Number of points of a line among which the end of its straight part is chosen."""

GAIN = 1e-3
"""Seconds that a motion without a stop must save."""


@dataclass(eq=False)
class LineEnd:
    """A straight line between a grasp or a release and its outer end, at which the arm need not stop.

    ``path`` is the line in the direction of motion, which ``arrives`` at the grasp or the release or leaves it, and
    ``stopping`` its motion from rest to rest. The share ``straight``, next to the grasp or the release, must be
    followed. ``rates`` are further limits on the line.
    """

    arm: Arm
    path: CubicPath
    stopping: Trajectory
    arrives: bool
    straight: float
    rates: Sequence[RateConstraint]
    _known: dict[int, Trajectory | None] = field(default_factory=dict)

    def option(self, number: int) -> Trajectory | None:
        """A motion on the line with a moving outer end: 0 leaves out a part of it, the others have decreasing speeds.

        None if it does not exist.
        """
        if number not in self._known:
            self._known[number] = self._shortened() if number == 0 else self._complete(SPEEDS[number - 1])
        return self._known[number]

    def _shortened(self) -> Trajectory | None:
        """The motion from rest to rest without its part beyond the straight share; None if that is most of the line."""
        into = self.stopping if self.arrives else backwards(self.stopping)
        if self.straight > MOST_SHORTENED or len(into.q) == 1:
            return None
        times = np.linspace(0.0, into.duration, SAMPLES)
        positions = self.arm.forward_kinematics_batch(into(times))[:, :3, 3]
        left = np.linalg.norm(positions - positions[-1], axis=1)
        kept = into.after(float(times[np.flatnonzero(left >= self.straight * left[0])[-1]]))
        return kept if self.arrives else backwards(kept)

    def _complete(self, share: float) -> Trajectory | None:
        """The complete line with a share of its largest speed at the outer end; None if that is too fast."""
        points = self.path.bezier()[1]
        tangent = points[0, 1] - points[0, 0] if self.arrives else points[-1, -1] - points[-1, -2]
        if not tangent.any():
            return None
        peak = np.linalg.norm(self.stopping.velocities, axis=1).max() / np.linalg.norm(tangent)
        moving = {"start_velocity" if self.arrives else "end_velocity": share * peak * tangent}
        try:
            return time_parametrise(self.path, self.arm.limits, rate_limits=self.rates, **moving)
        except (InputError, TimingError):  # too fast for the line or for a limit
            return None


Chosen = tuple[Trajectory | None, Trajectory | None]
"""The line before a motion and the line after it, with a moving end; None for a stop, or if there is no line."""


def join_lines(
    ends: MovingEnds,
    bounds: Bounds,
    lines: tuple[LineEnd | None, LineEnd | None],
    stops: Array,
    stopping: Callable[[], Trajectory],
    prove: Callable[[Trajectory, Chosen], Certificate],
) -> tuple[Trajectory, Chosen, Certificate] | None:
    """A transit or a transfer that joins the lines before and after it without stops; None if the arm has to stop.

    A line is None where the arm rests. ``stops`` (2, n) are the configurations at which it rests otherwise,
    ``stopping`` computes the motion between them, and ``prove`` gives the certificate of a motion between two chosen
    lines, which are returned with it.
    """

    def proven(motion: Trajectory | None, chosen: Chosen) -> tuple[Trajectory, Chosen, Certificate] | None:
        certificate = None if motion is None else prove(motion, chosen)
        return None if motion is None or not certificate or not certificate.free else (motion, chosen, certificate)

    between: Trajectory | None = None
    # The options of both lines, of which not all exist; -1 is a stop
    for first, last in [pair for n in range(len(SPEEDS) + 1) for pair in ((n, n), (-1, n), (n, -1))]:
        before = None if lines[0] is None or first < 0 else lines[0].option(first)
        after = None if lines[1] is None or last < 0 else lines[1].option(last)
        if (before is not None, after is not None) != (first >= 0, last >= 0):
            continue
        # The states at both ends, and the time that the lines save by them
        start, end = (
            rest(stop) if line is None else (line.q[k].tolist(), line.velocities[k].tolist(), [0.0] * line.q.shape[1])
            for line, stop, k in ((before, stops[0], -1), (after, stops[1], 0))
        )
        saved = sum(
            line.stopping.duration - moving.duration
            for line, moving in zip(lines, (before, after), strict=True)
            if line is not None and moving is not None
        )
        if between is None:  # the fastest move is certainly an improvement if it is faster than any with stops
            least = float(least_times(stops[1] - stops[0], bounds))
            found = proven(ends.direct(start, end, least + saved - GAIN), (before, after))
            if found is not None:
                return found
            between = stopping()
        found = proven(ends.changed(between, start, end, between.duration + saved - GAIN), (before, after))
        if found is not None:
            return found
    return None


def backwards(trajectory: Trajectory) -> Trajectory:
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


BACKWARDS = "proven for the reversed motion, in which the object leaves its support"


Curves = tuple[JointPath | BlendedPath | CubicPath, ...]


@dataclass(frozen=True, eq=False)
class MotionPart:
    """A part of a pick's motion before it is timed: its curves, and the conditions under which it is certified."""

    name: str
    curves: Curves
    checker: CollisionChecker
    parting: Pairs = ()
    backwards: bool = False
    passing: OpenHand | None = None
    constraints: tuple[Upright, ...] = ()
    lines: tuple[str, ...] = ()
    """The name of the stage of each curve, whose limits of speed apply; by default that of the part."""


@step(Stage.TIMING.value)
def time_motion(
    task: PickTask, attempt: Attempt, path: JointPath, placing: Release | None
) -> PickVerdict | StageResult:
    """Time and certify all parts of a motion: the good verdict with its last stages, or the stage that fails."""
    # All parts, without stops where the arm may pass the end of a line
    motions: list[PickMotion] = []
    try:
        timing = _PartsTiming(task, motion_parts(task, attempt, path, placing), attempt.candidate.member)
        if task.cell.budget.motion > 0:
            timing.join()
        for number, part in enumerate(timing.parts):
            motion, why = timing.motion(number)
            if motion is None:
                return StageResult(Stage.TIMING, False, f"{part.name}: {why}")
            motions.append(motion)
        # The arm is at the grasp after these motions, and at the release after those
        if task.name is None:
            until_grasp = timing.trajectories(0)[: 1 + (attempt.approach is not None)]
        else:
            until_grasp = [each.trajectory for each in motions if each.name in ("transit", "approach")]
        until_release = [each.trajectory for each in motions if each.name != "leave"]
        joined = Trajectory.join(*(each.trajectory for each in motions))
    except TimingError as error:
        stage = Stage.HOLD if isinstance(error, SlipError) else Stage.TIMING
        return StageResult(stage, False, str(error))
    # The figures of the complete motion
    clearance = min(motion.certificate.clearance for motion in motions)
    parts = f" of its {len(motions)} motions" if len(motions) > 1 else ""
    message = f"collision-free at every instant{parts} (proven)"
    figures = {"duration": joined.duration, "clearance": clearance}
    if torques := [(peak.share, peak, motion.name) for motion in motions for peak in motion.torques]:
        share, peak, name = max(torques, key=lambda each: each[0])
        torque = f"{peak.torque:.3g} {peak.unit} of {peak.joint}, {100 * share:.0f} % of its limit"
        message += f"; largest torque {torque}, in {name}"
        figures["torque_share"] = share
    # Whether the grip holds the part, of which the timing takes account
    hold, limits, starts = None, task.hold(attempt.candidate.member), np.cumsum([0.0, *(m.duration for m in motions)])
    if limits is not None:
        carried = {
            m.name: (float(t), m.trajectory) for t, m in zip(starts, motions, strict=False) if m.name in CARRYING
        }
        hold = held_in_motion(limits, carried)
        if not hold.ok:
            return hold
        message += f"; {hold.message}"
    release_time = None if placing is None else Trajectory.join(*until_release).duration
    member, last = attempt.candidate.member, StageResult(Stage.TIMING, True, message, figures)
    return PickVerdict(
        task.pick,
        PickStatus.GOOD,
        (last,) if hold is None else (hold, last),
        q_grasp=attempt.q,
        trajectory=joined,
        grasp_time=Trajectory.join(*until_grasp).duration,
        certificate=motions[0].certificate if task.name is None else None,
        motions=tuple(motions),
        release_time=release_time,
        member=member.words,
        grip=None if task.name is None else replace(task.grip(member), patches=()),
    )


def time_part(task: PickTask, part: MotionPart, attempt: Attempt) -> tuple[PickMotion | None, str]:
    """Time and certify a part of a motion, from rest to rest: the certified motion, or None and the reason.

    Raises
    ------
    TimingError
        If a curve cannot be timed within the limits.
    """
    return _PartsTiming(task, [part], attempt.candidate.member).motion(0)


PASSED = (("transit", "approach"), ("retreat", "transfer"), ("transfer", "place"))
"""The stages between which the arm need not stop; the gripper moves between the others."""


@dataclass(eq=False)
class _StageCurve:
    """A curve of a part: the number of the part, the stage, its limits, and its timing once it is known."""

    part: int
    stage: str
    curve: JointPath | BlendedPath | CubicPath
    rates: list[RateConstraint]
    timed: Trajectory | None = None
    certificate: Certificate | None = None


class _PartsTiming:
    """Times the curves of the parts of a motion: from rest to rest, unless :meth:`join` is called before."""

    def __init__(self, task: PickTask, parts: list[MotionPart], member: Member) -> None:
        self._task, self.parts = task, parts
        self._curves = [
            _StageCurve(number, stage, curve, rate_limits(task, member, stage, part.checker))
            for number, part in enumerate(parts)
            for stage, curve in zip(part.lines or (part.name,) * len(part.curves), part.curves, strict=True)
        ]
        self._proven: dict[int, Certificate] = {}

    def trajectories(self, number: int) -> list[Trajectory]:
        """The timed curves of a part."""
        return [self._timed(each) for each in self._curves if each.part == number]

    def motion(self, number: int) -> tuple[PickMotion | None, str]:
        """The certified motion of a part, or None and the reason."""
        part, own = self.parts[number], [each for each in self._curves if each.part == number]
        trajectory = Trajectory.join(*self.trajectories(number))
        certificate = self._proven.get(number)
        if certificate is None and len(own) == 1 and part.passing is None:
            certificate = own[0].certificate
        certificate = certificate or prove_part(part, trajectory)
        if not certificate.free:
            return None, certificate.message
        around, peaks = part.checker, peaks_of(own[0].rates, trajectory)
        return PickMotion(part.name, trajectory, certificate, around.attached, around.scene, around.arm.held, peaks), ""

    def join(self) -> None:
        """Replace the stops at the outer ends of the lines, where a certified motion without a stop is shorter."""
        arm = self._task.arm
        for k, curve in enumerate(self._curves):
            if isinstance(curve.curve, CubicPath):
                continue
            lines = self._line(k - 1, k), self._line(k, k + 1)
            if lines == (None, None):
                continue
            part, bounds = self.parts[curve.part], Bounds.of(arm.limits, arm.joint_names)
            stops = np.array([curve.curve.start, curve.curve.end])
            ends = MovingEnds(part.checker, bounds, stops, curve.rates, part.constraints)
            prove = partial(self._prove, curve, lines)
            found = join_lines(ends, bounds, lines, stops, partial(self._timed, curve), prove)
            if found is None:
                continue
            curve.timed, chosen, self._proven[curve.part] = found
            for near, moving in zip((k - 1, k + 1), chosen, strict=True):
                if moving is not None:
                    self._curves[near].timed = moving

    def _prove(
        self, joined: _StageCurve, lines: tuple[LineEnd | None, LineEnd | None], trajectory: Trajectory, chosen: Chosen
    ) -> Certificate:
        """The certificate of the part of a curve with another trajectory, and the chosen motions on its lines."""
        moving = {id(line.path): motion for line, motion in zip(lines, chosen, strict=True) if line and motion}
        timed = [
            trajectory if curve is joined else moving.get(id(curve.curve)) or self._timed(curve)
            for curve in self._curves
            if curve.part == joined.part
        ]
        return prove_part(self.parts[joined.part], Trajectory.join(*timed))

    def _line(self, first: int, second: int) -> LineEnd | None:
        """The line of two successive curves, if the arm need not stop between them."""
        if first < 0 or second >= len(self._curves):
            return None
        one, other = self._curves[first], self._curves[second]
        line, arrives = (other, True) if isinstance(other.curve, CubicPath) else (one, False)
        if (one.stage, other.stage) not in PASSED or not isinstance(line.curve, CubicPath):
            return None
        # A stated speed of the stage holds on the complete line
        straight = 1.0 if line.stage in self._task.pick.speed else self._task.cell.shared.straight
        return LineEnd(self._task.arm, line.curve, self._timed(line), arrives, straight, line.rates)

    def _timed(self, curve: _StageCurve) -> Trajectory:
        if curve.timed is None:
            part = self.parts[curve.part]
            try:
                curve.timed, curve.certificate = timed_curve(self._task, part, curve.curve, curve.rates)
            except TimingError as error:
                raise type(error)(f"{part.name}: {error}") from error
        return curve.timed


def timed_curve(
    task: PickTask, part: MotionPart, curve: JointPath | BlendedPath | CubicPath, rates: list[RateConstraint]
) -> tuple[Trajectory, Certificate | None]:
    """The timed curve. A path of the planner, but not a line, may become a shorter motion with a certificate."""
    limits, budget = task.arm.limits, task.cell.budget.motion
    if budget == 0 or isinstance(curve, CubicPath):
        return time_parametrise(curve, limits, rate_limits=rates), None
    kept = part.constraints
    result = optimise(curve, part.checker, limits=limits, rate_limits=rates, constraints=kept, budget=budget)
    return result.trajectory, result.certificate


def certify_displaced(task: PickTask, member: Member, motion: PickMotion, by: float) -> Certificate:
    """Certify a motion of a pick again, as :meth:`PickSetup.certify_displaced` describes.

    The margin to a support is not changed where the part leaves it. The depth of the palm is limited in the part as it
    is stated. A pick without an object does not state which obstacle is its part; then every obstacle may be displaced.
    """
    part = part_again(task, member, motion.name, motion.trajectory)
    if task.name is None:
        return certify(motion.trajectory, part.checker, obstacle_tolerance=by, constraints=part.constraints)
    # Wider margins for all pairs of the part, except those that are in contact
    margins, checker = {}, part.checker
    for pair, (i, j) in enumerate(checker.pairs):
        owners = checker.bodies[i].owner, checker.bodies[j].owner
        wider = task.name in owners and not any(set(owners) == set(touching) for touching in part.parting)
        margins[owners] = float(checker.margins[pair]) + (by if wider else 0.0)
    passing = None if part.passing is None else part.passing.padded(by)
    widened = replace(part, checker=checker.with_margin(checker.margin, margins), passing=passing)
    return prove_part(widened, motion.trajectory)


def part_of(task: PickTask, member: Member, name: str, curves: Curves = (), parting: Pairs = ()) -> MotionPart:
    """A part of a motion with the conditions under which it is certified; pairs of ``parting`` may touch at one end."""
    if task.name is None or name == "transit":
        hand = None if task.from_scene or task.pick.approach else task.passing(member)
        return MotionPart(name, curves, task.before(member), passing=hand)
    if name == "approach":
        return MotionPart(name, curves, task.before(member, touching=True), passing=task.passing(member))
    if name == "leave":
        return MotionPart(name, curves, task.letting_go(member), passing=task.passing(member, placed=True))
    if name == RETURN:
        return MotionPart(name, curves, task.returning(member))
    carrying, kept = task.carrying(member), task.constraints(member)
    return MotionPart(name, curves, carrying, parting, backwards=name == "place", constraints=kept)


def part_again(task: PickTask, member: Member, name: str, trajectory: Trajectory) -> MotionPart:
    """The part of a motion that is timed already, with the supports that the object leaves or reaches."""
    place = task.pick.place
    names: tuple[str, ...] = (*PARTS, RETURN)
    what = f"with object {task.name!r}"
    if task.name is None:
        names, what = ("pick", *PARTS[:3], RETURN), "without an object"
    elif place is None:  # the object would be where it was grasped
        names, what = PARTS[:3], "without a place"
    if name not in names:
        raise InputError(f"the program has a motion {name!r}, which does not exist in a pick {what}")
    part = part_of(task, member, name)
    if name == "retreat":
        return replace(part, parting=task.supports(part.checker, trajectory.start, task.pick.support))
    if name == "place" and place is not None:
        return replace(part, parting=task.supports(part.checker, trajectory.end, place.support))
    return part


def motion_parts(
    task: PickTask, attempt: Attempt, path: JointPath, placing: Release | None, *, separate: bool = False
) -> list[MotionPart]:
    """The parts of a complete motion.

    If ``separate``, the transit, the approach and the retreat of a pick without an object are three parts, with rests
    between them, instead of one.
    """
    curves: dict[str, Curves] = {
        "transit": (path,),
        "approach": () if attempt.approach is None else (attempt.approach.reversed(),),
        "retreat": () if attempt.retreat is None else (attempt.retreat,),
    }
    if task.name is None and not separate:  # without an object one proof covers the complete motion
        lines = tuple(stage for stage, own in curves.items() for _ in own)
        return [MotionPart("pick", tuple(curve for own in curves.values() for curve in own), task.outside, lines=lines)]
    parting = {"retreat": attempt.parting}
    if placing is not None and placing.transfer is not None:
        curves["transfer"] = (placing.transfer,)
        curves["place"] = () if placing.lift is None else (placing.lift.reversed(),)
        curves["leave"] = () if placing.leave is None else (placing.leave,)
        parting["place"] = placing.parting
    # With an object, each part has its own bodies and its own proof
    member = attempt.candidate.member
    return [part_of(task, member, name, own, parting.get(name, ())) for name, own in curves.items() if own]


def prove_part(part: MotionPart, curve: JointPath | Trajectory, joint_tolerance: npt.ArrayLike = 0.0) -> Certificate:
    """The certificate of a part; of several conditions, that of the first that is not proven."""
    if not part.backwards or not part.parting:
        proof = certify(
            curve,
            part.checker,
            joint_tolerance=joint_tolerance,
            parting=part.parting,
            constraints=part.constraints,
        )
    else:
        into = curve.reversed() if isinstance(curve, JointPath) else backwards(curve)
        proof = certify(
            into,
            part.checker,
            parting=part.parting,
            constraints=part.constraints,
        )
        # both directions have the same configurations, so the proof applies to both
        proof = replace(proof, curve=curve_hash(curve), backwards=True, notes=(*proof.notes, BACKWARDS))
    if proof.free and part.passing is not None:
        q = curve.start if part.name == "leave" else curve.end
        if (failure := part.passing.prove(curve, q, deviation=float(np.max(joint_tolerance)))) is not None:
            return replace(failure.proof, message=failure.reason)
    return proof


@dataclass(frozen=True, eq=False)
class ExecutedMotion:
    """What a controller executes of a motion: its moves and its blends, and when.

    Each joint may differ from ``path`` by ``tolerance`` (n,), and from each of the ``blends`` by its own tolerance.
    ``timed`` are the motions by the rules of the controller, from stop to stop, that contain its moves.
    """

    path: JointPath
    tolerance: Array
    blends: tuple[ExecutedPart, ...]
    timed: tuple[Trajectory, ...]


def prove_executed(part: MotionPart, executed: ExecutedMotion) -> Certificate:
    """The certificate of what a controller executes; of several conditions, that of the first that is not proven.

    No deviation is covered where the part is on a support, which it would press into the part.
    """
    tolerance = np.zeros_like(executed.tolerance) if part.parting else executed.tolerance
    proof = prove_part(part, executed.path, tolerance)
    for blend in executed.blends:
        if not proof.free:
            break
        own = prove_part(replace(part, parting=()), blend.curve, blend.tolerance)
        proof = (
            replace(proof, clearance=min(proof.clearance, own.clearance))
            if own.free
            else replace(own, message=f"{blend.name}: {own.message}")
        )
    return proof
