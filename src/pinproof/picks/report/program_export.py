"""The motions of picks as one program of a robot controller, certified as the text of the program is executed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision import Certificate, CertificateStatus, feasible, speed_violations, unknown_speeds
from pinproof.common.results import Shown, View
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import (
    MEET_TOLERANCE,
    JointMap,
    JointMove,
    JointPath,
    MotionProgram,
    MotionRecord,
    ProgramEvent,
    ProgramPick,
    ProgramSegment,
    RobotProgram,
    SetOutput,
    Step,
    Wait,
    certificate_id,
    find_dialect,
    is_program_file,
    make_program,
    moves_along,
    time_parametrise,
)
from pinproof.picks.input.pick import Pick
from pinproof.picks.input.picks import MOUNTED
from pinproof.picks.judging.setup import PickSetup


@dataclass(frozen=True, eq=False)
class PicksProgram:
    """A ``program`` that executes picks, as read from its text, with the ``certificates`` of the motions of each pick.

    The ``notes`` state what the certificates do not cover, in sentences.
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
    deviation: float | None = None,
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
        rad: by how much each joint may deviate from the lines, which the text of the program states; by default that of
        the language, as for :func:`pinproof.collision.export_program`.
    joint_map
        The joint values of the controller from those of the model, if they differ.

    Raises
    ------
    InputError
        If there is no pick, programs do not meet, or the language cannot express a step.
    """
    # The programs follow each other
    if not picks:
        raise InputError("there is no pick with a motion to export")
    for (_, before), (pick, after) in pairwise(picks):
        gap = np.abs(before.segments[-1].trajectory.end - after.segments[0].trajectory.start).max()
        if gap > MEET_TOLERANCE:
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
    deviation = find_dialect(dialect).deviation if deviation is None else deviation
    # Moves along the motions of each pick, with the outputs and waiting times between them
    counts, steps = list[list[int]](), list[Step]()
    for _, program in picks:
        counts.append([])
        for segment in program.segments:
            moves = moves_along(segment.trajectory, tolerance=tolerance)
            steps += moves[1:] if steps else moves
            counts[-1].append(len(moves))
            for event in program.events:
                if math.isclose(event.time, segment.end, abs_tol=1e-9):
                    steps.append(SetOutput(output, event.kind == "grip"))
                    steps += [Wait(event.dwell)] if event.dwell > 0 else []
    # The program, of which every point can be reached in the stated time
    names = picks[0][1].joint_names
    steps = feasible(steps, setup.checker.arm)
    executed = [
        ProgramPick(
            pick.name,
            program.member,
            tuple((segment.name, count - 1) for segment, count in zip(program.segments, lengths, strict=True)),
        )
        for (pick, program), lengths in zip(picks, counts, strict=True)
    ]
    write = partial(
        make_program,
        joint_names=names,
        dialect=dialect,
        name=name,
        deviation=deviation,
        joint_map=joint_map,
        picks=executed,
    )
    # What the text states is certified; a proven program states the hash of its proofs
    written = write(steps)
    certificates, notes = certify_picks_program(setup, [pick for pick, _ in picks], written)
    if all(each.free for motions in certificates for each in motions):
        records = [each.motion_record() for motions in certificates for each in motions]
        text = json.dumps([record.to_dict() for record in records], sort_keys=True)
        written = write(steps, certificate=hashlib.sha256(text.encode("utf-8")).hexdigest(), uncovered="; ".join(notes))
    return PicksProgram(written, certificates, notes)


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
        return ProgramCheck(text.name, tuple(motions), not text.certificate, notes)
    stored = MotionProgram.load(path, allow_changes=True)
    by_name = {pick.name: pick for pick in picks}
    if stored.name not in by_name:
        raise UnknownNameError("pick", stored.name, by_name, "the picks of the cell")
    proofs = setup.recertify(stored, by_name[stored.name])
    records = zip(stored.certificates.values(), proofs, strict=True)
    own = tuple((stored.name, record.name, proof, record.name in stored.changed) for record, proof in records)
    return ProgramCheck(stored.name, own, False, duration=stored.duration)


def certify_picks_program(
    setup: PickSetup, picks: Iterable[Pick], program: RobotProgram
) -> tuple[tuple[tuple[Certificate, ...], ...], tuple[str, ...]]:
    """Certify what a controller executes according to the text of a program of picks, in the cell of the picks.

    The motions are the straight lines between the points of the text, under the conditions of each part of a pick, with
    the deviation that the text states. They must reach the grasp and the release of the pick, where the hand must hold
    the part.

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
        If the program states no picks, has a blend or a linear move, switches several outputs, or has other moves than
        it states.
    UnknownNameError
        If a pick of the program does not exist.
    """
    if not program.picks:
        raise InputError(f"program {program.name!r} states no picks; it was not written by export_picks")
    # A program of picks has joint moves with stops, and switches only the gripper
    by_name = {pick.name: pick for pick in picks}
    arm, steps = setup.checker.arm, list(program.steps)
    bad = [step for step in program.moves if not isinstance(step, JointMove) or step.blend is not None]
    if bad:
        raise InputError(f"line {bad[0].line}: a program of picks has joint moves that end with a stop only")
    outputs = [step for step in steps if isinstance(step, SetOutput)]
    if others := [step for step in outputs if step.output != outputs[0].output]:
        raise InputError(
            f"line {others[0].line} switches the output {others[0].output}, but line {outputs[0].line} the output "
            f"{outputs[0].output}: only that of the gripper may be switched"
        )
    if reason := next(unknown_speeds(program, arm), ""):
        raise InputError(reason)
    too_fast = "; ".join(speed_violations(program, arm, {}))
    start, certificates, notes = steps.pop(0), [], list[str]()
    for planned in program.picks:
        if planned.name not in by_name:
            raise UnknownNameError("pick", planned.name, by_name)
        # Each motion takes its moves from the text; outputs and waiting times follow the last move of a motion.
        clock, segments, events, records = 0.0, list[ProgramSegment](), list[ProgramEvent](), {}
        for name, count in planned.motions:
            moves = [start, *steps[:count]]
            del steps[:count]
            points = [move.q for move in moves if isinstance(move, JointMove)]
            if len(points) < count + 1:
                raise InputError(f"the {name} of pick {planned.name!r} has {count} moves, which the text does not have")
            start = moves[-1]
            motion = time_parametrise(JointPath(points, program.joint_names), arm.limits)
            # a pick without an object has one certificate for all of its motions
            certified = "pick" if by_name[planned.name].object_name is None else name
            record = MotionRecord(certified, 0, 0, "UNDECIDED", None, 0, 0, "", "")
            records[certificate_id(record)] = record
            segments.append(ProgramSegment(name, clock, motion, certificate_id(record)))
            clock = segments[-1].end
            while steps and isinstance(steps[0], SetOutput | Wait):
                step = steps.pop(0)
                if isinstance(step, SetOutput):
                    events.append(ProgramEvent("grip" if step.on else "release", clock))
                elif isinstance(step, Wait) and events and events[-1].end == clock:
                    events[-1] = replace(events[-1], dwell=events[-1].dwell + step.seconds)
                    clock = events[-1].end
        executed = MotionProgram(planned.name, tuple(segments), tuple(events), records, member=planned.member)
        proofs = setup.recertify(executed, by_name[planned.name], deviation=program.deviation)
        if too_fast:
            slow = [replace(p, status=CertificateStatus.VIOLATED, clearance=math.nan, message=too_fast) for p in proofs]
            proofs = (*slow,)
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
