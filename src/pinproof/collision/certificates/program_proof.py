"""The certificate of a robot program: what the controller will execute, according to the text of the program."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pinproof.collision.certificates.certificate import Certificate, CertificateStatus, proven_millimetres
from pinproof.collision.certificates.certify import certify
from pinproof.collision.certificates.program_limits import (
    arm_faults,
    outside_limits,
    overlaps,
    speed_violations,
    unknown_speeds,
)
from pinproof.collision.certificates.program_moves import moves_between_rests
from pinproof.collision.certificates.program_parts import executed_parts, traced
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.common.results import Answer, Rows, View
from pinproof.common.structs import described, key
from pinproof.errors import InputError, NotProvenFree
from pinproof.model import Arm
from pinproof.motion import (
    Curve,
    JointMap,
    JointMove,
    LinearMove,
    RobotProgram,
    SetOutput,
    Step,
    StreamedPoint,
    StreamedTrajectory,
    Trajectory,
    Wait,
    external_joints,
    find_dialect,
    make_program,
)

TRACKING = 0.01
"""rad: the assumed deviation from set points that are sent at a fixed period, whose interpolation is not published."""

SEVERITY = [
    CertificateStatus.FREE,
    CertificateStatus.UNDECIDED,
    CertificateStatus.VIOLATED,
    CertificateStatus.COLLIDING,
]
"""The statuses of parts in increasing order; the status of a program is the last one that occurs."""


@described(eq=False)
class ProgramPart:
    """A part of a program and its certificate."""

    name: str = key('what it is, such as ``"blend at line 14"``')
    line: int = key("the line of the program at which it ends")
    blend: bool = key("whether it is the blend at a point")
    certificate: Certificate = key("the certificate of the configurations that the controller may pass")


@described(eq=False)
class ProgramCertificate(Answer):
    """The certificates of all parts of a program; collision-free only if every part is."""

    failure = NotProvenFree

    parts: tuple[ProgramPart, ...] = key("the parts in the order of execution")
    notes: tuple[str, ...] = key("what the certificate assumes about the controller, and what it does not cover")
    overlaps: tuple[int, ...] = key(
        "lines of blends that cannot be covered: they may overlap with the previous blend or reach the other end of a "
        "move, so that a controller may skip a point, are at the first point, to which the move is not known, or no "
        "move follows them, so that the arm may stop before the point. The program is then UNDECIDED",
        default=(),
    )
    outside_limits: tuple[str, ...] = key(
        "the points of the program that violate the position limits, the linear moves on which a joint may do so, "
        "the moves whose stated duration is too short for the velocity (and known acceleration) limits of a joint, "
        "and the set points between which, or before and after which, a joint would exceed them. The program is "
        "then VIOLATED",
        default=(),
    )
    untraced: tuple[str, ...] = key(
        "the linear moves whose joint values are not bounded, with the reason, moves and set points whose speed is not "
        "known, a tool with another tcp, or another calibration, than that of the arm. The program is then UNDECIDED",
        default=(),
    )
    outputs: tuple[int, ...] = key(
        "the lines that switch outputs: what a gripper then holds or leaves is not stated, so that the program is "
        "UNDECIDED. Programs of picks are certified with their picks, see "
        ":func:`pinproof.picks.certify_picks_program`",
        default=(),
    )

    def _view(self) -> View:
        rows = [(each.name, each.certificate.status.name, each.certificate.clearance * 1e3) for each in self.parts]
        table = Rows(("part", "status", "clearance [mm]"), rows)
        lines = (f"{each.name}: {each.certificate}" for each in self.parts)
        return View(self.message, [table, (*self.notes, *self.outside_limits)], lines)

    @property
    def free(self) -> bool:
        """Whether every part is proven collision-free."""
        return self.status is CertificateStatus.FREE

    ok = free

    @property
    def status(self) -> CertificateStatus:
        """COLLIDING if a part is, otherwise VIOLATED outside the limits, otherwise UNDECIDED if a part is, or FREE."""
        found = {part.certificate.status for part in self.parts}
        if self.overlaps or self.untraced or self.outputs:
            found.add(CertificateStatus.UNDECIDED)
        if self.outside_limits:
            found.add(CertificateStatus.VIOLATED)
        return max(found, key=SEVERITY.index)

    @property
    def clearance(self) -> float:
        """The least proven clearance (m) of all parts; NaN unless all are FREE."""
        return min(part.certificate.clearance for part in self.parts) if self.free else float("nan")

    @property
    def hash(self) -> str:
        """The hash of curves, tolerances, setups and results of all parts, which the text of the program names."""
        proofs = [(part.blend, part.certificate) for part in self.parts]
        rows = [[blend, each.curve, each.setup, each.status.name, str(each.tube)] for blend, each in proofs]
        return hashlib.sha256(json.dumps(rows).encode("utf-8")).hexdigest()

    @property
    def message(self) -> str:
        """The result in one sentence; it names the first part that is not free."""
        if self.free:
            blends = {part.line for part in self.parts if part.blend}  # a blend has several parts
            parts = [(sum(not part.blend for part in self.parts), "motion"), (len(blends), "blend")]
            words = " and ".join(f"{count} {what}{'' if count == 1 else 's'}" for count, what in parts if count)
            return f"FREE: {words} of the program proven, clearance {proven_millimetres(self.clearance)}"
        if self.status is CertificateStatus.UNDECIDED and self.untraced:
            return f"UNDECIDED: {self.untraced[0]}"
        # The first part that explains the status, or else what was found beside the parts.
        own = [each for each in self.parts if each.certificate.status is self.status]
        part = next((each for each in own if each.certificate.first_contact), next(iter(own), None))
        if part is None and self.status is CertificateStatus.UNDECIDED and self.outputs:
            return (
                f"UNDECIDED: line {self.outputs[0]} switches an output, and what the gripper then holds is not stated; "
                "certify a program of picks with its picks file (pinproof pick FILE --program PROGRAM)"
            )
        if part is None and self.outside_limits:
            return f"{self.status.name}: outside the limits: {self.outside_limits[0]}"
        if part is None:
            return (
                f"UNDECIDED: the blend at line {self.overlaps[0]} may overlap with the one before it, so that a "
                "controller may skip a point, is at the first point, or no move follows it; reduce or remove it"
            )
        return f"{self.status.name}: {part.name}: {part.certificate.message}"

    def __str__(self) -> str:
        return self.message


def certify_program(
    program: RobotProgram, checker: CollisionChecker, *, process: Collection[str] = ()
) -> ProgramCertificate:
    """Certify what a controller executes according to the text of a program.

    Parameters
    ----------
    program
        The program, as read from its text.
    checker
        The arm with its tool in its scene. Attached bodies are assumed over the whole program.
    process
        The outputs that switch a process, such as the flow of glue, and no gripper.

    Raises
    ------
    InputError
        If the program is for other joints.
    """
    if program.joint_names != checker.arm.joint_names:
        own = ", ".join(checker.arm.joint_names)
        raise InputError(f"the program has the joints {', '.join(program.joint_names)}; the arm has {own}")
    program, traces, untraced = traced(program, checker.arm)
    parts = []
    # Each part that the controller executes is certified with its own tolerance.
    for part in executed_parts(program, checker.arm, traces):
        certificate = certify(part.curve, checker, joint_tolerance=part.tolerance)
        if part.blend and certificate.status is CertificateStatus.COLLIDING:  # another blend may pass
            certificate = replace(certificate, status=CertificateStatus.UNDECIDED)
        parts.append(ProgramPart(part.name, part.line, part.blend, certificate))
    notes = dict.fromkeys([*_notes(program, checker.arm), *(note for part in parts for note in part.certificate.notes)])
    # What no certificate of a part covers: overlapping blends, limits, outputs, and unknown speeds.
    overlapping = tuple(dict.fromkeys(overlaps(program, checker.arm, traces)))
    outside = (*outside_limits(program, checker.arm, traces), *speed_violations(program, checker.arm, traces))
    outputs = tuple(step.line for step in program.steps if isinstance(step, SetOutput) and step.output not in process)
    untraced += tuple(unknown_speeds(program, checker.arm))
    untraced += tuple(arm_faults(program, checker.arm))
    return ProgramCertificate(tuple(parts), tuple(notes), overlapping, outside, untraced, outputs)


def export_program(
    curve: Curve,
    checker: CollisionChecker,
    dialect: str,
    *,
    name: str = "motion",
    deviation: float | None = None,
    period: float | None = None,
    joint_map: JointMap | None = None,
    linear: bool = False,
) -> tuple[RobotProgram, ProgramCertificate]:
    """Write a program that moves from each rest of a curve to the next one, and certify what the controller executes.

    Between two rests there are few joint moves that are proven collision-free; they lead through points of the curve,
    need not follow it, and are no faster. Inner points are blended as far as that is proven; elsewhere the arm stops.

    Parameters
    ----------
    curve
        A trajectory, or a path (not for ``"ros2"``, which needs times).
    checker
        The arm with its tool in its scene.
    dialect
        ``"urscript"``, ``"rapid"``, ``"krl"``, ``"fanuc"`` or ``"ros2"``.
    name
        The name of the program.
    deviation
        rad: the deviation of the controller from the moves; by default that of the language.
    period
        Seconds between set points, to stream the trajectory (``servoj`` of URScript) instead of moves.
    joint_map
        The joint values of the controller from those of the model, if they differ.
    linear
        Whether parts of the motion from stop to stop on which the tcp moves on a straight line become linear moves.

    Returns
    -------
    tuple[RobotProgram, ProgramCertificate]
        The program, whose comments name the hash of the certificate, and the certificate. Check ``certificate.free``.

    Raises
    ------
    InputError
        If the language cannot express the motion, or the curve is for other joints.
    """
    language = find_dialect(dialect)
    if tuple(curve.joint_names) != checker.arm.joint_names:
        raise InputError(f"the curve has the joints {curve.joint_names}, the arm has {checker.arm.joint_names}")
    external = {} if language.joints is None else external_joints(checker.arm)
    if reason := language.refuses(checker.arm, external):
        raise InputError(reason)
    if (language.exact or period is not None) and not isinstance(curve, Trajectory):
        raise InputError("this program needs a trajectory with times; use pp.time_parametrise first")
    if linear and (language.exact or period is not None):
        raise InputError("linear moves need a program of moves; remove period, or choose another language")
    if deviation is None:
        deviation = TRACKING if period is not None else language.deviation
    # The steps: the trajectory itself, moves along it, or set points at a fixed period.
    steps: Sequence[Step]
    if language.exact and isinstance(curve, Trajectory):
        steps = [StreamedTrajectory(curve.record())]
    elif period is None:
        steps = moves_between_rests(curve, checker, deviation, language, linear=linear)
    else:
        if not language.streams or not isinstance(curve, Trajectory):
            raise InputError(f"programs in {dialect} cannot stream set points; remove period")
        if not 0 < period < np.inf:
            raise InputError(f"period = {period} must be above 0 s, and finite")
        times = np.append(np.arange(period, curve.duration, period), curve.duration)
        steps = [JointMove(curve.start), *(StreamedPoint(q, period) for q in curve(times))]
    write = partial(
        make_program,
        joint_names=curve.joint_names,
        dialect=dialect,
        name=name,
        deviation=deviation,
        joint_map=joint_map,
        external_joints=external,
        calibrations=checker.arm.robot.calibrations,
    )
    program = write(steps)
    certificate = certify_program(program, checker)
    if not certificate.free:
        return program, certificate
    named = write(steps, certificate=certificate.hash)
    return named, certify_program(named, checker)


def _notes(program: RobotProgram, arm: Arm) -> Iterator[str]:
    yield "the move to the first point of the program is not covered"
    if unknown := [name for name, v in zip(program.joint_names, arm.limits.velocity, strict=True) if np.isnan(v)]:
        yield f"the speeds of {', '.join(unknown)} are not compared, because no velocity limit is known"
    if program.dialect != "ros2":
        yield (
            f"each joint is assumed to stay within {program.deviation:g} rad of the straight lines between the points "
            "of the program"
        )
    if any(isinstance(step, LinearMove) for step in program.steps):
        yield (
            "linear moves: the tool of the controller is at the tcp of the arm, its base frame is that of the arm, and "
            "the orientation is that of a rotation about one axis, or of two angles"
        )
    blends = [s.blend for s in program.moves if isinstance(s, JointMove | LinearMove) and s.blend is not None]
    if any(blend.radius is not None for blend in blends):
        yield "the radius of blends is measured at the tcp of the arm; set the same tcp at the controller"
    if any(isinstance(step, Wait) for step in program.steps):
        yield "nothing in the scene is assumed to move during waiting times"
