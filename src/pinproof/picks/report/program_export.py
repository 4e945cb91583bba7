"""The motions of picks as one program of a robot controller, certified as the text of the program is executed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from pinproof.collision import Certificate
from pinproof.collision.certificates.program_proof import feasible
from pinproof.errors import InputError
from pinproof.motion import JointMap, JointPath, MotionProgram, RobotProgram, time_parametrise
from pinproof.motion.curve import MEET_TOLERANCE
from pinproof.motion.motion_program import ProgramEvent, ProgramSegment
from pinproof.motion.program_steps import JointMove, SetOutput, Step, Wait
from pinproof.motion.robot_program import make_program, moves_along
from pinproof.picks.input.pick import Pick
from pinproof.picks.judging.setup import PickSetup


@dataclass(frozen=True, eq=False)
class PicksProgram:
    """A program that executes picks, and its certificates.

    Parameters
    ----------
    program
        The program, as read from its text.
    certificates
        The certificates of the motions of each pick, in order.
    notes
        What the certificates do not cover, in sentences.
    """

    program: RobotProgram
    certificates: tuple[tuple[Certificate, ...], ...]
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
    tolerance: float = 0.0005,
    deviation: float = 0.0,
    joint_map: JointMap | None = None,
) -> PicksProgram:
    """Write good picks as one program with gripper outputs and waiting times, and certify what it executes.

    The arm stops at every point of the program, because the contact of the part with its support permits no
    deviation in a blend. The motions are certified as straight lines between the points, as the text rounds them,
    under the conditions of each part of a pick. Motions on which a part is lifted off a support, or put onto it, are
    certified without the deviation of the controller, which would press the part into the support.

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
    tolerance
        rad: largest deviation of the lines from the motions, at samples of them.
    deviation
        rad: by how much each joint may deviate from the lines, which the text of the program states.
    joint_map
        The joint values of the controller from those of the model, if they differ.

    Raises
    ------
    InputError
        If there is no pick, programs do not meet, or the language cannot express a step.
    """
    if not picks:
        raise InputError("there is no pick with a motion to export")
    for (_, before), (pick, after) in pairwise(picks):
        gap = np.abs(before.segments[-1].trajectory.end - after.segments[0].trajectory.start).max()
        if gap > MEET_TOLERANCE:
            raise InputError(
                f"the program of pick {pick.name!r} does not start where the one before it ends (pick "
                f"{before.name!r}); export them one by one, or plan the motions between them"
            )
    counts, steps = list[list[int]](), list[Step]()
    for _, program in picks:
        counts.append([])
        for segment in program.segments:
            moves = moves_along(segment.trajectory, tolerance=tolerance)
            steps += moves[1:] if steps else moves
            counts[-1].append(len(moves))
            steps += _events(program, segment, output)
    names = picks[0][1].joint_names
    steps = feasible(steps, setup.checker.arm)
    write = partial(
        make_program, joint_names=names, dialect=dialect, name=name, deviation=deviation, joint_map=joint_map
    )
    written = write(steps)
    points = iter(move for move in written.steps if isinstance(move, JointMove))
    start, certificates, notes = next(points), [], list[str]()
    for (pick, program), lengths in zip(picks, counts, strict=True):
        executed, start = _executed(setup, program, lengths, start, points)
        certificates.append(setup.recertify(executed, pick, deviation=deviation))
        exact = [motion for motion, proof in zip(_names(executed), certificates[-1], strict=True) if proof.partings]
        if deviation > 0 and exact:
            notes.append(f"{pick.name}: no deviation is covered on {', '.join(exact)}, where the part is on a support")
    if all(each.free for motions in certificates for each in motions):
        records = [each.motion_record() for motions in certificates for each in motions]
        text = json.dumps([record.to_dict() for record in records], sort_keys=True)
        written = write(steps, certificate=hashlib.sha256(text.encode("utf-8")).hexdigest(), uncovered="; ".join(notes))
    return PicksProgram(written, tuple(certificates), tuple(notes))


def _names(program: MotionProgram) -> list[str]:
    """The names of the certified motions, in order."""
    return [program.certificates[key].name for key in program.motions]


def _events(program: MotionProgram, segment: ProgramSegment, output: str) -> Iterator[Step]:
    """The output and the waiting time of the event at the end of a segment."""
    for event in program.events:
        if math.isclose(event.time, segment.end, abs_tol=1e-9):
            yield SetOutput(output, event.kind == "grip")
            if event.dwell > 0:
                yield Wait(event.dwell)


def _executed(
    setup: PickSetup, program: MotionProgram, lengths: Sequence[int], start: JointMove, points: Iterator[JointMove]
) -> tuple[MotionProgram, JointMove]:
    """The program with the straight lines of the text as its motions, and the last point."""
    limits, names = setup.checker.arm.limits, program.joint_names
    segments, events, clock = list[ProgramSegment](), list[ProgramEvent](), 0.0
    for segment, length in zip(program.segments, lengths, strict=True):
        rows = [start, *(next(points) for _ in range(length - 1))]
        start = rows[-1]
        motion = time_parametrise(JointPath([row.q for row in rows], names), limits)
        segments.append(ProgramSegment(segment.name, clock, motion, segment.certificate))
        clock = segments[-1].end
        for event in program.events:
            if math.isclose(event.time, segment.end, abs_tol=1e-9):
                events.append(replace(event, time=clock))
                clock = events[-1].end
    return replace(program, segments=tuple(segments), events=tuple(events)), start
