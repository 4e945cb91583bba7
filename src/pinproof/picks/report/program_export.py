"""The motions of picks as one program of a robot controller, certified as the text of the program is executed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision import (
    COVERED,
    SAMPLES,
    Certificate,
    CertificateStatus,
    EndLine,
    ExecutedPart,
    arm_faults,
    blended_moves,
    executed_parts,
    is_proven_free,
    outside_limits,
    overlaps,
    program_motions,
    speed_violations,
    timed_step,
    trace_line,
    traced,
    unknown_speeds,
)
from pinproof.common.results import Shown, View
from pinproof.common.structs import key, struct
from pinproof.errors import InputError, TimingError, UnknownNameError
from pinproof.model import Arm
from pinproof.motion import (
    Blend,
    CheckInput,
    ControllerMotion,
    ControllerMove,
    Dialect,
    JointMap,
    JointMove,
    JointPath,
    LinearMove,
    MotionProgram,
    MotionRecord,
    Profile,
    ProgramEvent,
    ProgramPick,
    ProgramSegment,
    RateConstraint,
    Remark,
    RobotProgram,
    SetLoad,
    SetOutput,
    Step,
    ToolData,
    ToolLimits,
    TorqueLimits,
    Wait,
    certificate_id,
    controller_motion,
    dialect_of_file,
    find_dialect,
    is_program_file,
    make_program,
    time_parametrise,
)
from pinproof.picks.input.pick import RETURN, Pick
from pinproof.picks.input.picks import MOUNTED
from pinproof.picks.judging.setup import PickSetup
from pinproof.picks.judging.task import rate_limits
from pinproof.picks.judging.timing import ExecutedMotion, MotionPart, part_again, prove_part
from pinproof.picks.report.program_details import (
    after_gripper,
    check_export,
    controller_tool,
    load_faults,
    user_frame,
)
from pinproof.spatial import SE3, Array


@struct("exported", written=True)
class ExportedProgram:
    """A program of a controller that was written for a good pick."""

    pick: str = key("the name of the pick")
    language: str = key("the language of the program")
    moves: int = key("number of moves, with that to the first point")
    duration: float = key("seconds by the rules of the controller, without the move to the first point")
    motion_duration: float = key(
        "seconds of the same motions as certified, with waiting times and the return to their start"
    )

    def __str__(self) -> str:
        longer = 100.0 * (self.duration / self.motion_duration - 1.0)
        return f"{self.moves} moves, {self.duration:.2f} s ({longer:+.1f} %)"


@dataclass(frozen=True, eq=False)
class PicksProgram:
    """A ``program`` that executes picks, as read from its text, with the ``certificates`` of the motions of each pick.

    ``duration`` is that of the program in seconds by the rules of its controller, ``motion_duration`` that of the
    motions of the picks, both with the waiting times. The ``notes`` state what the certificates do not cover, in
    sentences.
    """

    program: RobotProgram
    certificates: tuple[tuple[Certificate, ...], ...]
    duration: float
    motion_duration: float
    notes: tuple[str, ...] = ()

    @property
    def free(self) -> bool:
        """Whether every motion is proven."""
        return all(each.free for motions in self.certificates for each in motions)


def export_picks(
    setup: PickSetup,
    picks: Sequence[tuple[Pick, MotionProgram]],
    dialect: str,
    *,
    output: str,
    name: str = "picks",
    deviation: float | None = None,
    joint_map: JointMap | None = None,
) -> PicksProgram:
    """Write good picks as one program with gripper outputs and waiting times, and certify what it executes.

    Approach, retreat, place and leave are linear moves. Between them there are as few joint moves as are proven, from
    which the arm passes into the linear moves without a stop, in zones as large as are proven. The linear moves next to
    the part are certified under the conditions of each part of a pick; those on which a part is lifted off a support,
    or put onto it, without the deviation of the controller, which would press the part into the support.

    Parameters
    ----------
    setup
        What the picks were judged with.
    picks
        The picks and their programs in order; each program starts where the previous one ends.
    dialect
        ``"urscript"``, ``"rapid"``, ``"krl"`` or ``"fanuc"``.
    output
        The digital output that closes the gripper: a number, or for RAPID a name.
    name
        The name of the program.
    deviation
        rad: by how much each joint may deviate from the moves, which the text of the program states; by default that of
        the language, as for :func:`pinproof.collision.export_program`, or the largest of its half, quarter and eighth
        with which the program is proven.
    joint_map
        The joint values of the controller from those of the model, if they differ.

    Raises
    ------
    InputError
        If there is no pick, programs do not meet, or the language cannot express a step, or a joint such as a rail.
    """
    if not picks:
        raise InputError("there is no pick with a motion to export")
    external = check_export(setup.checker.arm, setup.shared, dialect)
    # The programs follow each other
    for (_, before), (pick, after) in pairwise(picks):
        if not before.leads_to(after):
            raise InputError(
                f"the program of pick {pick.name!r} does not start where the one before it ends (pick "
                f"{before.name!r}); export them one by one, or plan the motions between them"
            )
    tools = {grasp.tool for pick, _ in picks for grasp in setup.shared.grasps_of(pick)}
    if len(picks) > 1 and len(tools) > 1 and setup.shared.tool_change != MOUNTED:
        raise InputError(
            f"the picks use the tools {', '.join(sorted(map(str, tools)))}, but a program does not change the tool; "
            "export the picks of each tool"
        )
    tool = controller_tool(setup.checker.arm, setup.shared.for_pick(setup.shared.grasps_of(picks[0][0])[0]))
    write = partial(
        make_program,
        joint_names=picks[0][1].joint_names,
        dialect=dialect,
        name=name,
        joint_map=joint_map,
        tool=tool,
        frame=user_frame(setup),
        external_joints=external,
        calibrations=setup.checker.arm.robot.calibrations,
    )
    # The largest deviation that is proven, if none is stated
    usual = find_dialect(dialect).deviation
    for allowed in [usual / 2**k for k in range(HALVED)] if deviation is None else [deviation]:
        final = deviation is not None or allowed == usual / 2 ** (HALVED - 1)
        try:
            steps, executed = _steps_of_picks(setup, picks, tool, output, allowed, find_dialect(dialect))
        except NoMoves:
            if final:
                raise
            continue
        # What the text states is certified; a proven program states the hash of its proofs
        written = write(steps, picks=executed, deviation=allowed)
        certificates, notes = certify_picks_program(setup, [pick for pick, _ in picks], written)
        free = all(each.free for motions in certificates for each in motions)
        if free or final:
            break
    if free:
        hashed = _hash_of(certificates)
        uncovered = "; ".join(notes)
        written = write(steps, picks=executed, deviation=allowed, certificate=hashed, uncovered=uncovered)
    if deviation is None and allowed < usual:
        notes = (*notes, f"{name}: a deviation of {allowed:g} rad of each joint is covered, not {usual:g} rad as usual")
    duration = program_duration(written, setup.checker.arm)
    return PicksProgram(written, certificates, duration, sum(program.duration for _, program in picks), notes)


def _steps_of_picks(
    setup: PickSetup,
    picks: Sequence[tuple[Pick, MotionProgram]],
    tool: ToolData,
    output: str,
    deviation: float,
    language: Dialect,
) -> tuple[list[Step], list[ProgramPick]]:
    """The steps of picks, and the picks with the numbers of their moves; NoMoves if moves are not proven."""
    steps = list[Step]([JointMove(picks[0][1].segments[0].trajectory.start)])
    executed = list[ProgramPick]()
    for pick, program in picks:
        made = PickMoves(setup, pick, program, deviation, language)
        counts = list[tuple[str, int]]()
        for segment in program.segments:
            moves = made.moves[segment.name]
            home = " home" if segment.name == RETURN else ""
            steps += [Remark(f"pick {pick.name}: {segment.name}{home}"), *moves]
            counts.append((segment.name, len(moves)))
            for event in program.events:
                if math.isclose(event.time, segment.end, abs_tol=1e-9):
                    grips = event.kind == "grip"
                    steps.append(SetOutput(output, grips))
                    # The hand moves during the waiting time; then it holds the part, or does not
                    steps += [Wait(event.dwell)] if event.dwell > 0 else []
                    steps += after_gripper(setup, tool, pick, program.member, grips=grips)
        executed.append(ProgramPick(pick.name, program.member, tuple(counts)))
    return steps, executed


def _hash_of(certificates: Iterable[Iterable[Certificate]]) -> str:
    """The hash of the proofs of a program, which its text names."""
    records = [each.motion_record().to_dict() for motions in certificates for each in motions]
    return hashlib.sha256(json.dumps(records, sort_keys=True).encode("utf-8")).hexdigest()


HALVED = 4
"""Number of deviations that are compared, each half of the one before."""

ENOUGH = 1.05
"""Duration of moves, in that of the certified motion, below which no faster ones are searched."""

ROUNDS = 12
"""How often moves are made slower until all limits are kept."""

SLOWER, RATES_KEPT = 1.0005, 1.001
"""By how much more moves are made slower, and up to which excess limits are kept: texts round joint values."""


LONGER = (2.0, 1.25)
"""Lengths of lines that are tried beside the length that a pick states, by this length."""

SPARE = 3
"""Number of moves that a pick may have more which ends with the part in the hand, and so has none that lead back."""

PARTS, DIVIDED, STOP = 16, 3, 0.25
"""Parts of a joint move whose speeds are compared, the most stops that divide it, and the seconds that each counts."""


class NoMoves(InputError):
    """No joint moves between two points of a pick are proven."""


@dataclass(frozen=True, eq=False)
class _Line:
    """The line of a stage, from the part outwards, the least share of it, and a longer one, by its length."""

    stage: str
    path: JointPath
    straight: float
    longer: JointPath
    length: float = 1.0

    def ends(self, *, entering: bool) -> Iterator[EndLine]:
        """The linear moves next to the part, first the stated one, and the share of each that a zone may use."""
        shares = (1.0, self.length, (self.length + 1.0) / 2.0, (1.0 + self.straight) / 2.0, self.straight)
        for share in dict.fromkeys(shares):
            whole, length = (self.path, 1.0) if share <= 1.0 else (self.longer, self.length)
            count = max(math.ceil(share / length * (len(whole.q) - 1) - 1e-9), 2)
            path = JointPath(whole.q[: count + 1], whole.joint_names)
            yield EndLine(path.reversed() if entering else path, min(0.5, max(0.0, 1.0 - self.straight / share)))


@dataclass(frozen=True, eq=False)
class _Moves:
    """Moves from stop to stop: the stage and the path of each, the blend at its end, and the motion of all."""

    stages: tuple[str, ...]
    blends: tuple[Blend | None, ...]
    motion: ControllerMotion


class PickMoves:
    """The moves of a pick by the names of the motions of its program.

    A free motion becomes joint moves, and the motions next to the part linear moves. A linear move may begin or end
    nearer to the part than the motion does, as long as the share that must be straight remains, also beside the zone,
    or farther from it, where its zone has more space.
    """

    def __init__(
        self, setup: PickSetup, pick: Pick, program: MotionProgram, deviation: float, language: Dialect
    ) -> None:
        self._task, self._member = setup.made_by(pick, program.member)
        self._arm, self._deviation, self._language = setup.checker.arm, deviation, language
        self.moves: dict[str, list[JointMove | LinearMove]] = {segment.name: [] for segment in program.segments}
        # The motions from stop to stop, with the linear moves at both ends
        stops = [
            k for k, own in enumerate(program.segments) if any(abs(e.time - own.end) < 1e-9 for e in program.events)
        ]
        # Of the at most 12 moves from home to home, those that the moves so far have not used, or that are not needed
        self._spare = 0 if len(stops) > 1 else SPARE
        bounds = [0, *(k + 1 for k in stops if k + 1 < len(program.segments)), len(program.segments)]
        stretches = [program.segments[first:last] for first, last in pairwise(bounds)]
        parts = [
            {
                own.name: part_again(
                    self._task, self._member, program.certificates[own.certificate].name, own.trajectory
                )
                for own in stretch
            }
            for stretch in stretches
        ]
        lines = [
            self._lines(stretch, own, first=k == 0)
            for k, (stretch, own) in enumerate(zip(stretches, parts, strict=True))
        ]
        for stretch, self._parts, both in zip(stretches, parts, lines, strict=True):
            self._add(stretch, both)

    def _lines(
        self, stretch: Sequence[ProgramSegment], parts: Mapping[str, MotionPart], *, first: bool
    ) -> tuple[_Line | None, _Line | None]:
        """The lines with which the motion from a stop to the next one begins and ends."""
        pick, place, member = self._task.pick, self._task.place, self._member
        here, end = stretch[0].trajectory.start, stretch[-1].trajectory.end
        last = stretch[-2 if stretch[-1].name == RETURN else -1].name
        # The configurations at the outer ends of the lines in the motion
        outer = {own.name: own.trajectory.start if own.name in LINES_IN else own.trajectory.end for own in stretch}
        if first:  # towards the part
            return None, self._line(parts, "approach", outer, end, pick.before(self._task.grasp(member)), pick.approach)
        after = pick.after(self._task.grasp(member))
        if last == "leave" and place:
            return self._line(parts, "leave", outer, here, place.after(self._task.release(member)), 1.0), None
        if last in ("leave", "retreat") or place is None:
            return self._line(parts, last if last == "leave" else "retreat", outer, here, after, 1.0), None
        before = place.before(self._task.release(member))
        return (
            self._line(parts, "retreat", outer, here, after, pick.retreat),
            self._line(parts, "place", outer, end, before, place.approach),
        )

    def _add(self, stretch: Sequence[ProgramSegment], lines: tuple[_Line | None, _Line | None]) -> None:
        """Add the fastest moves from stop to stop."""
        out, into = lines
        if out is not None and into is None and stretch[-1].name != RETURN:
            best = self._within_limits((out.stage,), (None,), [ControllerMove(out.path, alike=self._language.alike)])
        else:
            best = self._between(stretch, (stretch[0].trajectory.start, stretch[-1].trajectory.end), lines)
        names = [segment.name for segment in stretch]
        for stage, blend, move, profile in zip(
            best.stages, best.blends, best.motion.moves, best.motion.profiles, strict=True
        ):
            self.moves[stage if stage in names else names[0]].append(
                timed_step(self._arm, move, profile, blend, linear=stage not in FREE_MOTIONS)
            )

    def _line(
        self,
        parts: Mapping[str, MotionPart],
        stage: str,
        outer: Mapping[str, Array],
        q: Array,
        pose: SE3,
        length: float,
    ) -> _Line | None:
        """The line of a stage from q (n,) at the part outwards, longer than stated if possible; None if it has none."""
        if not length:
            return None
        # External axes move at the rate of the motion, in which the line may be shorter, or all of them rest
        target, far, rest = self._task.target(pose), outer.get(stage, q), q[:-6]
        here, there = (self._arm.forward_kinematics(each).translation for each in (q, far))
        longer = float(np.linalg.norm(target.translation - here)) / max(float(np.linalg.norm(there - here)), 1e-9)
        travel = np.where(self._arm.angular[:-6], 0.0, max(longer, 1.0) * (far[:-6] - rest))
        trace = trace_line(self._arm, q, target, rest + travel)
        if trace.reason and travel.any():
            trace, travel = trace_line(self._arm, q, target), np.zeros_like(travel)
        straight = 1.0 if stage in self._task.pick.speed else self._task.cell.shared.straight
        if trace.reason and straight < 1.0 < longer:  # the motion leaves the line before its end, which is out of reach
            straight = min(1.0, straight * longer)
            trace = trace_line(self._arm, q, self._arm.forward_kinematics(far), far[:-6])
        if trace.reason:
            raise NoMoves(f"pick {self._task.pick.name!r}: the {stage} cannot be a linear move: {trace.reason}")
        part = parts.get(stage, next(iter(parts.values())))
        deviation = 0.0 if part.parting else self._deviation
        towards = stage in LINES_IN
        line = _Line(stage, trace.path, straight, trace.path)
        *_, least = line.ends(entering=towards)
        if not (proof := prove_part(part, least.path, deviation)).free:
            what = f"the {stage} is not proven collision-free with a deviation of {deviation:g} rad: {proof.message}"
            raise NoMoves(f"pick {self._task.pick.name!r}: {what}")
        # The stated line ends where the arm has left the part; a zone may need more space
        for share in LONGER:
            beyond = SE3(target.rotation, here + share * (target.translation - here))
            further = trace_line(self._arm, q, beyond, rest + share * travel)
            path = further.path.reversed() if towards else further.path
            inside = bool((path.q >= self._arm.limits.lower).all() and (path.q <= self._arm.limits.upper).all())
            if further.reason or not inside:
                continue
            if prove_part(part, path, deviation + further.tolerance if deviation else 0.0).free:
                return replace(line, longer=further.path, length=share)
        return line

    def _between(
        self, stretch: Sequence[ProgramSegment], ends: tuple[Array, Array], lines: tuple[_Line | None, _Line | None]
    ) -> _Moves:
        """The fastest proven moves from one stop to the next, with the lines next to it."""
        part = next(own for own in self._parts.values() if own.name in FREE_MOTIONS)
        stage = "transit" if part.name == "pick" else part.name
        leaving, entering = ([] if line is None else list(line.ends(entering=bool(k))) for k, line in enumerate(lines))
        # The part of the motion between the shortest lines
        first = leaving[-1].path.end if leaving else ends[0]
        last = entering[-1].path.start if entering else ends[1]
        motion = np.concatenate(
            [segment.trajectory(np.linspace(0.0, segment.trajectory.duration, 257)) for segment in stretch]
        )
        begin, finish = (int(np.abs(motion - q).max(axis=1).argmin()) for q in (first, last))
        for count in SAMPLES:
            inner = np.unique(np.linspace(begin, max(finish, begin), count).round().astype(int))[1:-1]
            points = np.vstack([first, motion[inner], last])
            found = blended_moves(
                points,
                self._arm,
                self._language,
                partial(self._proven, part),
                lines=(leaving, entering),
                enough=ENOUGH * sum(segment.trajectory.duration for segment in stretch),
                spare=self._spare,
            )
            if found is not None:
                self._spare += 1 + 2 * bool(leaving) + 2 * bool(entering) - len(found.blends)
                joint = [stage] * (len(found.blends) - bool(leaving) - bool(entering))
                stages = [line.stage for line in lines[:1] if line] + joint + [line.stage for line in lines[1:] if line]
                return self._within_limits(stages, found.blends, found.motion.moves)
        what = " and ".join(segment.name for segment in stretch)
        raise NoMoves(f"pick {self._task.pick.name!r}: no joint moves for {what} are proven collision-free")

    def _proven(self, part: MotionPart, path: JointPath, extent: Array) -> bool:
        """Whether a free path is proven with an extent (n,) of each joint, the deviation and ``COVERED``."""
        tolerance = extent + self._deviation + COVERED
        if not is_proven_free(path, part.checker, joint_tolerance=tolerance):
            return False
        return not (part.constraints or part.passing) or prove_part(part, path, tolerance).free

    def _within_limits(
        self, stages: Sequence[str], blends: Sequence[Blend | None], moves: Sequence[ControllerMove]
    ) -> _Moves:
        """The moves, as slow as the limits of torques, of the grip and of the tool require."""
        checker = next(iter(self._parts.values())).checker
        rates = {stage: rate_limits(self._task, self._member, stage, checker) for stage in stages}
        limits, language = self._arm.limits, self._language
        # Speeds of the tool, which a lower speed keeps at the same accelerations, and the other limits
        speeds = {
            stage: [each for each in own if isinstance(each, ToolLimits) and np.isinf(each.limits[2:]).all()]
            for stage, own in rates.items()
        }
        others = {stage: [each for each in own if each not in speeds[stage]] for stage, own in rates.items()}
        # Joint moves are divided where the tool may move faster
        zones = [None, *(move.zone for move in moves)]
        cuts = [
            self._cuts(move, speeds[stage], (zones[k], zones[k + 1]))
            if language.cruises and speeds[stage] and stage in FREE_MOTIONS
            else (0.0, 1.0)
            for k, (stage, move) in enumerate(zip(stages, moves, strict=True))
        ]
        names, ends, own = list[str](), list[Blend | None](), list[ControllerMove]()
        for k, (stage, blend, move) in enumerate(zip(stages, blends, moves, strict=True)):
            for first, last in pairwise(cuts[k]):
                divided = len(cuts[k]) > 2
                path = JointPath(_line_at(move.path, [first, last]), move.path.joint_names) if divided else move.path
                zone = move.zone if last == 1.0 else None
                if zone is not None:
                    zone = zone[0] / (last - first), zone[1] / cuts[k + 1][1]
                own.append(replace(move, path=path, zone=zone))
                names.append(stage)
                ends.append(blend if last == 1.0 else None)

        def slower(number: int, profile: Profile, excess: float, *, speed: bool) -> None:
            """Move at a lower speed, or take a longer time if only that can be stated, or is needed."""
            states, longer = language.cruises or names[number] not in FREE_MOTIONS, SLOWER * excess
            if excess > 1.0 and ((speed and states) or not language.times):
                own[number] = replace(own[number], top=profile.peak / longer)
                if not speed and (gain := float(profile.gains.max(initial=0.0))):
                    own[number] = replace(own[number], gain=gain / longer**2)
            elif excess > 1.0:
                own[number] = replace(own[number], duration=longer * profile.duration)

        for k, stage in enumerate(names) if any(rates.values()) else ():
            for each in (others, speeds):
                single = controller_motion([replace(own[k], zone=None)], limits)
                excess = max((float(np.max(limit.excess(single.trajectory))) for limit in each[stage]), default=0.0)
                slower(k, single.profiles[0], excess, speed=each is speeds)
        for _ in range(ROUNDS):
            motion = controller_motion(own, limits)
            both = [rate_excess(motion, names, each) for each in (others, speeds)]
            if max(excesses.max() for excesses in both) <= 1.0:
                break
            for excesses, speed in zip(both, (False, True), strict=True):
                for k, excess in enumerate(excesses.tolist()):
                    slower(k, motion.profiles[k], excess, speed=speed)
        return _Moves(tuple(names), tuple(ends), motion)

    def _cuts(
        self, move: ControllerMove, speeds: Sequence[ToolLimits], zones: Sequence[tuple[float, float] | None]
    ) -> tuple[float, ...]:
        """The shares at which a joint move is divided by stops, because parts of it may be faster than others.

        A zone keeps at most half of its part.
        """
        least = [0.0 if zone is None else 2.0 * zone[side] for zone, side in zip(zones, (1, 0), strict=True)]
        grid, tops = np.linspace(0.0, 1.0, PARTS + 1), list[float]()
        for pair in pairwise(_line_at(move.path, grid)):
            part = controller_motion([ControllerMove(JointPath(pair, move.path.joint_names))], self._arm.limits)
            excess = max(float(np.max(limit.excess(part.trajectory))) for limit in speeds)
            tops.append(part.profiles[0].peak / max(excess, 1.0) / PARTS)
        inner = [k for k in range(1, PARTS) if least[0] <= grid[k] <= 1.0 - least[1]]
        options = [(0, *chosen, PARTS) for count in range(DIVIDED + 1) for chosen in combinations(inner, count)]

        def seconds(option: tuple[int, ...]) -> float:
            return sum((b - a) / PARTS / min(tops[a:b]) + STOP for a, b in pairwise(option))

        return tuple(float(grid[k]) for k in min(options, key=seconds))


def _line_at(path: JointPath, shares: Sequence[float] | Array) -> Array:
    """The points (k, n) of a joint move at shares of it."""
    return np.asarray(path.start + np.asarray(shares)[:, None] * (path.end - path.start))


def rate_excess(
    motion: ControllerMotion, stages: Sequence[str], rates: Mapping[str, Sequence[RateConstraint]]
) -> Array:
    """Factors (k,) by which the moves of a motion must be longer to keep the limits of their stages.

    Limits of torques and of the grip apply to the motion, those of the tool to the moves of their stage; where two
    moves are superposed, those of one of them must be kept.
    """
    knots = motion.trajectory.bezier()[0]
    middle = (knots[1:] + knots[:-1]) / 2.0
    pieces = {stage: np.zeros(len(middle)) for stage in stages}
    common = 0.0
    for stage, own in pieces.items():
        for limit in rates[stage]:
            excess = np.asarray(limit.excess(motion.trajectory))
            if isinstance(limit, ToolLimits):
                np.maximum(own, excess, out=own)
            else:
                common = max(common, float(excess.max()))
    ends = zip(motion.starts, motion.profiles, strict=True)
    passed = np.array([(start <= middle) & (middle <= start + profile.duration) for start, profile in ends])
    least = np.where(passed, np.array([pieces[stage] for stage in stages]), np.inf).min(axis=0)
    return np.maximum(np.where(passed, least, 0.0).max(axis=1), common)


@dataclass(frozen=True, eq=False)
class ProgramCheck(Shown):
    """The result of certifying a program of picks again in a cell.

    ``motions`` has for each motion the names of its pick and of the motion, its certificate, and whether it differs
    from the motion that was certified. ``edited`` states whether the text of a controller's program was edited after it
    was written, or was never certified, and ``notes`` what the certificates do not cover, in sentences. The
    ``duration`` is in seconds; None for the program of a controller.
    """

    name: str
    motions: tuple[tuple[str, str, Certificate, bool], ...]
    edited: bool
    notes: tuple[str, ...] = ()
    duration: float | None = None

    @property
    def ok(self) -> bool:
        """Whether every motion is FREE, and none was changed."""
        return not self.edited and all(proof.free and not changed for _, _, proof, changed in self.motions)

    def to_dict(self) -> dict[str, Any]:
        """The certificates of all motions as plain values for JSON."""
        if self.duration is not None:
            rows = [{"motion": name, "changed": new, **proof.to_dict()} for _, name, proof, new in self.motions]
            return {"ok": self.ok, "program": self.name, "duration": self.duration, "motions": rows}
        rows = [{"pick": pick, "motion": name, **proof.to_dict()} for pick, name, proof, _ in self.motions]
        values = {"ok": self.ok, "program": self.name, "edited": self.edited}
        return {**values, "motions": rows, "notes": list(self.notes)}

    def _view(self) -> View:
        return View(self.name, [self.to_text().splitlines()], self.to_text().splitlines())

    def to_text(self) -> str:
        """One line for each motion, and the notes."""
        lines = []
        for pick, name, proof, changed in self.motions:
            where = name if self.duration is not None else f"{pick}, {name}"
            note = "; differs from the motion that was certified" if changed else ""
            lines.append(f"{where}: {proof.status.name}: {proof.message}{note}")
        lines += ["the program was edited after it was written, or was never certified"] if self.edited else []
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def recertify_program(setup: PickSetup, picks: Sequence[Pick], path: str | Path) -> ProgramCheck:
    """Certify the program in a file again in a cell: one of :meth:`PickReport.programs`, or of a robot controller.

    Raises
    ------
    FileError
        If the file cannot be read.
    InputError
        As :func:`certify_picks_program` and :meth:`PickSetup.recertify` do.
    UnknownNameError
        If a pick of the program does not exist.
    """
    path = Path(path)
    if is_program_file(path):
        text = RobotProgram.load(path, allow_changes=True)
        certificates, notes = certify_picks_program(setup, picks, text)
        motions = [
            (pick.name, name, proof, False)
            for pick, row in zip(text.picks, certificates, strict=True)
            for name, proof in zip([name for name, _ in pick.motions] if len(row) > 1 else ["pick"], row, strict=True)
        ]
        if text.certificate not in ("", _hash_of(certificates)):
            notes = (
                *notes,
                "the program names another certificate: the robot, the scene, the picks or the tool differ",
            )
        return ProgramCheck(text.name, tuple(motions), not text.certificate, notes)
    if path.suffix.lower() != ".json":
        try:
            dialect_of_file(path)
        except InputError as error:
            raise InputError(f"{error}, or .json for a motion program of pinproof") from error
    stored = MotionProgram.load(path, allow_changes=True)
    by_name = {pick.name: pick for pick in picks}
    if stored.name not in by_name:
        raise UnknownNameError("pick", stored.name, by_name, "the picks of the cell")
    proofs = setup.recertify(stored, by_name[stored.name])
    records = zip(stored.certificates.values(), proofs, strict=True)
    own = tuple((stored.name, record.name, proof, record.name in stored.changed) for record, proof in records)
    return ProgramCheck(stored.name, own, False, duration=stored.duration)


LINES_IN = ("approach", "place")
"""The names of linear motions towards the part or its place."""

FREE_MOTIONS = ("transit", "transfer", "pick", RETURN)
"""The names of certified motions on which nothing is touched."""


def program_duration(program: RobotProgram, arm: Arm) -> float:
    """Seconds of a program by the rules of its controller, with its waiting times, from its first point."""
    program, traces, _ = traced(program, arm)
    motions = program_motions(program, arm, traces)
    waits = sum(step.seconds for step in program.steps if isinstance(step, Wait))
    return waits + sum(motion.duration for _, motion in motions)


def certify_picks_program(
    setup: PickSetup, picks: Iterable[Pick], program: RobotProgram
) -> tuple[tuple[tuple[Certificate, ...], ...], tuple[str, ...]]:
    """Certify what a controller executes according to the text of a program of picks, in the cell of the picks.

    The moves and blends of the text are certified under the conditions of each part of a pick, with the deviation that
    the text states; a blend between two motions under those of the free one. They must reach the grasp and the release
    of the pick, where the hand must hold the part.

    Parameters
    ----------
    setup
        The cell of the picks.
    picks
        The picks, at least those that the program names.
    program
        A program of :func:`export_picks`, as read from its text.

    Returns
    -------
    tuple
        The certificates of the motions of each pick, and what they do not cover, in sentences.

    Raises
    ------
    InputError
        If the program states no picks, streams set points, switches several outputs, or has other moves than it states.
    UnknownNameError
        If a pick of the program does not exist.
    """
    if not program.picks:
        raise InputError(f"program {program.name!r} states no picks; it was not written by export_picks")
    # A program of picks has moves, and switches only the gripper
    by_name = {pick.name: pick for pick in picks}
    arm = setup.checker.arm
    if bad := [step for step in program.moves if not isinstance(step, JointMove | LinearMove)]:
        raise InputError(f"line {bad[0].line}: a program of picks has joint moves and linear moves only")
    outputs = [step for step in program.steps if isinstance(step, SetOutput)]
    if others := [step for step in outputs if step.output != outputs[0].output]:
        raise InputError(
            f"line {others[0].line} switches the output {others[0].output}, but line {outputs[0].line} the output "
            f"{outputs[0].output}: only that of the gripper may be switched"
        )
    if reason := next(unknown_speeds(program, arm), ""):
        raise InputError(reason)
    # What the controller executes, and what no certificate of a part covers
    program, traces, untraced = traced(program, arm)
    parts = dict[int, list[ExecutedPart]]()
    for part in executed_parts(program, arm, traces):
        parts.setdefault(part.line, []).append(part)
    motions = program_motions(program, arm, traces)
    overlapping = [
        f"the blend at line {line} may overlap with the one before it" for line in overlaps(program, arm, traces)
    ]
    beyond = [*outside_limits(program, arm, traces), *speed_violations(program, arm, traces)]
    too_fast = "; ".join(beyond)
    if unknown := next((planned.name for planned in program.picks if planned.name not in by_name), None):
        raise UnknownNameError("pick", unknown, by_name)
    foreign = list(arm_faults(program, arm))
    fault = too_fast or "; ".join([*foreign, *untraced, *overlapping, *load_faults(setup, by_name, program)])
    status = CertificateStatus.VIOLATED if too_fast else CertificateStatus.UNDECIDED
    # Remarks, loads and checks of a sensor, after which the program continues or ends, move nothing
    steps = [step for step in program.steps if not isinstance(step, Remark | SetLoad | CheckInput)]
    certificates, notes = [], list[str]()
    start = steps.pop(0)
    for planned in program.picks:
        # Each motion takes its moves from the text; outputs and waiting times follow the last move of a motion.
        clock, segments, events, records = 0.0, list[ProgramSegment](), list[ProgramEvent](), {}
        moved, stage_of = dict[str, list[int]](), dict[int, str]()
        for name, count in planned.motions:
            moves = [start]
            while len(moves) <= count and steps and isinstance(steps[0], JointMove | LinearMove):
                moves.append(steps.pop(0))
            if len(moves) < count + 1:
                raise InputError(f"the {name} of pick {planned.name!r} has {count} moves, which the text does not have")
            points = [move.q for move in (moves[0], moves[-1]) if isinstance(move, JointMove | LinearMove)]
            start = moves[-1]
            stage_of |= {move.line: name for move in moves[1:]}
            try:
                motion = time_parametrise(JointPath(np.array(points), program.joint_names), arm.limits)
            except TimingError as error:  # a point is outside the limits
                raise InputError(next(iter(beyond), str(error))) from error
            # a pick without an object has one certificate for all of its motions
            certified = "pick" if by_name[planned.name].object_name is None else name
            record = MotionRecord(certified, 0, 0, "UNDECIDED", None, 0, 0, "", "")
            records[certificate_id(record)] = record
            moved.setdefault(certificate_id(record), []).extend(move.line for move in moves[1:])
            segments.append(ProgramSegment(name, clock, motion, certificate_id(record)))
            clock = segments[-1].end
            while steps and not isinstance(steps[0], JointMove | LinearMove):
                step = steps.pop(0)
                if isinstance(step, SetOutput):
                    events.append(ProgramEvent("grip" if step.on else "release", clock))
                elif isinstance(step, Wait) and events and events[-1].end == clock:
                    events[-1] = replace(events[-1], dwell=events[-1].dwell + step.seconds)
                    clock = events[-1].end
        executed = MotionProgram(planned.name, tuple(segments), tuple(events), records, member=planned.member)
        # The blend between two motions belongs to the free one, whose conditions permit no contact
        owned: dict[str, list[ExecutedPart]] = {name: [] for name in moved}
        for (hashed, lines), following in zip(moved.items(), [*list(moved)[1:], None], strict=True):
            for part in (part for line in lines for part in parts.get(line, ())):
                ends = part.blend and part.line == lines[-1] and records[hashed].name not in FREE_MOTIONS
                owned[following if ends and following is not None else hashed].append(part)
        shown = {
            hashed: ExecutedMotion(
                JointPath(
                    np.concatenate([p.curve.q for p in own if isinstance(p.curve, JointPath) and not p.blend]),
                    program.joint_names,
                ),
                np.max([part.tolerance for part in own if not part.blend], axis=0),
                tuple(part for part in own if part.blend),
                tuple(motion.trajectory for timed, motion in motions if set(timed) & set(moved[hashed])),
            )
            for hashed, own in owned.items()
            if moved[hashed] and not untraced
        }
        proofs = setup.recertify(
            executed, by_name[planned.name], deviation=program.deviation, executed=None if untraced else shown
        )
        # The limits of torques and of the tool, which depend on the times of the moves
        task, member = setup.made_by(by_name[planned.name], planned.member)
        for passed, executes in motions if not untraced else ():
            names = [stage_of[line] for line in passed if line in stage_of]
            if len(names) < len(passed):  # of another pick, or of two
                if names:
                    fault = fault or f"line {passed[len(names) - 1]}: the arm must stop at the end of a pick"
                continue
            try:
                limits = {name: rate_limits(task, member, name, setup.checker) for name in names}
                rates = {
                    name: [each for each in own if isinstance(each, ToolLimits | TorqueLimits)]
                    for name, own in limits.items()
                }
                slower = dict(zip(passed, rate_excess(executes, names, rates), strict=True))
                what = " and ".join(dict.fromkeys(limit.name for own in rates.values() for limit in own))
                reasons = {
                    line: f"line {line}: it must take {excess:.4g} times as long to keep the limits of {what}"
                    for line, excess in slower.items()
                    if excess > RATES_KEPT
                }
            except TimingError as error:
                reasons = dict.fromkeys(passed, str(error))
            proofs = tuple(
                replace(proof, status=CertificateStatus.VIOLATED, clearance=math.nan, message=reasons[found[0]])
                if (found := [line for line in moved[key] if line in reasons])
                and proof.status is not CertificateStatus.COLLIDING
                else proof
                for key, proof in zip(executed.motions, proofs, strict=True)
            )
        if fault:
            wrong = partial(replace, status=status, clearance=math.nan, message=fault)
            proofs = tuple(wrong(proof) if too_fast or untraced or foreign or proof.free else proof for proof in proofs)
        certificates.append(proofs)
        exact = [records[key].name for key, proof in zip(executed.motions, proofs, strict=True) if proof.partings]
        if program.deviation > 0 and exact:
            where = f"{', '.join(exact)}, where the part is on a support"
            notes.append(f"{planned.name}: no deviation is covered on {where}")
        if planned is not program.picks[0]:
            notes.append(f"{planned.name}: the parts of the picks before it are assumed where they were picked")
    if steps:
        raise InputError(f"line {steps[0].line}: the program continues after the picks that it states")
    return tuple(certificates), tuple(notes)
