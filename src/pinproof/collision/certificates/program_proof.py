"""The certificate of a robot program: what the controller will execute, according to the text of the program.

A joint move is a straight line in joint space. At a point with a blend the controller leaves the two moves; where its
curve is not published, every configuration is covered that differs in each joint by at most the extent of the blend
from the two moves within the blend. All moves are covered with the stated deviation of the controller.

A linear move is a straight line of the tcp, whose poses are solved at samples. In between, the joint values are bounded
as follows. Let J be the Jacobian with lengths divided by ``UNIT``, beta the norm of its inverse, and L a bound of the
change of J for a unit change of the joint values. Along a line of unit speed, q' = J^-1 t with a constant twist t, so
|q'| <= beta, and beta grows by at most beta' <= L beta^2 |q'| <= L beta^3. Therefore 1 / beta^2 decreases by at most
2 L for each unit of the line, and after a distance e the joint values differ by at most
(1 / beta - sqrt(1 / beta^2 - 2 L e)) / L, if the root exists. The second derivative is -J^-1 J' q', so that
|q''| <= L beta^3, and the chord between two samples at the distance e deviates by at most L beta^3 e^2 / 8. Within a
distance of 1 / (beta L) there is no second solution of a pose.
"""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinproof.collision.certificates.certificate import Certificate, CertificateStatus
from pinproof.collision.certificates.certify import certify, is_proven_free
from pinproof.collision.checking.checker import CollisionChecker
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import described, key
from pinproof.errors import InputError, NotProvenFree
from pinproof.model import Arm, JointLimits
from pinproof.motion import (
    LIMIT_TOLERANCE,
    Blend,
    ControllerMotion,
    ControllerMove,
    Curve,
    JointMap,
    JointMove,
    JointPath,
    LinearMove,
    Profile,
    Remark,
    RobotProgram,
    SetOutput,
    Step,
    StreamedPoint,
    StreamedTrajectory,
    TimedCurve,
    Trajectory,
    Wait,
    controller_motion,
    external_joints,
    fastest,
    fewest_moves,
    find_dialect,
    make_program,
    stop_times,
    with_corners,
)
from pinproof.spatial import Array

UNIT = 0.2
"""Metres that count as much as one radian, about the size of a wrist."""

CHORD = 2e-4
"""rad: largest deviation of the joint values from the chords between samples."""

FEWEST, MOST = 8, 8192
"""Numbers of samples of a line."""

SOLVED = 1e-11
"""rad, and metres over ``UNIT``: error of a pose at which it is solved."""

SINGULAR = 1e-6
"""Ratio of the smallest to the largest singular value of the Jacobian below which the arm is singular."""

ATTEMPTS = 10
"""Newton steps for a pose."""

ROUNDED = 1e-9
"""rad: allowance for the errors of the poses at the samples."""

TURN_STEP = 1e-3
"""rad: sum of the rotations between two steps at which the documented interpolations of orientations are compared."""

TURN_ALLOWANCE = 1.25
"""Factor of the largest difference between the documented interpolations that is covered."""


class LineTrace(NamedTuple):
    """The joint values along a line, and how far (rad) each joint may be off them; the reason if that is not known."""

    path: JointPath
    tolerance: float
    reason: str = ""


def trace_line(arm: Arm, start: Array, target: pin.SE3) -> LineTrace:
    """Return the joint values of an arm whose tcp moves on a straight line from ``start`` to a pose.

    The last six joints, which must be revolute, follow the line; joints before them, such as a rail, rest.
    """
    first = arm.forward_kinematics(start)
    shift, turn = target.translation - first.translation, pin.log3(first.rotation.T @ target.rotation)
    length, angle = float(np.linalg.norm(shift)) / UNIT, float(np.linalg.norm(turn))
    nothing = JointPath(start[None], arm.joint_names)
    if arm.dof < 6 or not arm.angular[-6:].all():
        return LineTrace(nothing, 0.0, "only arms whose last six joints are revolute are supported")
    whole, between = float(np.hypot(length, angle)), interpolation_difference(turn)
    change = np.sqrt(6.0 * (1.0 + (levers(arm)[-6:] / UNIT) ** 2).sum())
    count, reason = max(FEWEST, int(whole / 0.01) + 1), ""
    while count <= MOST:
        poses = [
            pin.SE3(first.rotation @ pin.exp3(s * turn), first.translation + s * shift)
            for s in np.linspace(0.0, 1.0, count + 1)
        ]
        q, inverse, reason = _solved(arm, start, poses)
        if reason:
            return LineTrace(nothing, 0.0, reason)
        chord, tube = _bounds(q, inverse, whole / count, change, between)
        if chord <= CHORD and np.isfinite(tube):
            return LineTrace(JointPath(q, arm.joint_names), chord + tube + ROUNDED)
        if chord <= CHORD:
            how = (
                f"it rotates the tool by {angle:.2g} rad, and interpolations of the orientation differ by {between:.2g}"
            )
            return LineTrace(nothing, 0.0, how)
        # The steps that the bounds need, if the norm does not exceed that at the samples by much.
        needed = max(np.sqrt(change * inverse.max() ** 3 / (8.0 * CHORD)), 4.0 * change * inverse.max() ** 2)
        count = max(2 * count, int(1.3 * whole * needed))
    return LineTrace(nothing, 0.0, "the arm is near a singularity on it")


def interpolation_difference(turn: Array) -> float:
    """Return a bound (rad) of the difference between the documented interpolations of an orientation, and more.

    The rotation ``turn`` (3,) is executed about one axis at a constant rate, or with two angles: an axis of the tool
    moves on a great circle while the tool rotates about it, both at a constant rate. Any axis of the tool may be that
    one. Between two samples the difference changes by at most the rates of all these rotations.
    """
    largest, whole = 0.0, pin.exp3(turn)
    for axis in np.eye(3) if turn.any() else ():
        swing, cosine = np.cross(axis, whole @ axis), float(axis @ whole @ axis)
        sine = float(np.linalg.norm(swing))
        if sine < SOLVED and cosine < 0.0:  # any great circle leads there
            return float(np.pi)
        swing *= np.arctan2(sine, cosine) / max(sine, SOLVED)
        spin = axis * float(axis @ pin.log3(pin.exp3(swing).T @ whole))
        rates = float(sum(np.linalg.norm(rotation) for rotation in (turn, swing, spin)))
        count = int(rates / TURN_STEP) + 1
        for share in np.linspace(0.0, 1.0, count + 1):
            apart = pin.log3(pin.exp3(share * turn).T @ pin.exp3(share * swing) @ pin.exp3(share * spin))
            largest = max(largest, float(np.linalg.norm(apart)) + rates / (2 * count))
    return min(TURN_ALLOWANCE * largest, float(np.pi))


def levers(arm: Arm) -> Array:
    """(n,) motion of the tcp for a unit of each joint: at most this, in m/rad, or 1 for a prismatic joint."""
    model, tcp = arm.model, arm.model.frames[arm.tcp_id]
    joints = [joint for joint in model.supports[tcp.parentJoint] if joint != 0]
    most = np.maximum(np.abs(arm.limits.lower), np.abs(arm.limits.upper))
    most = (np.abs(arm.scale) * np.where(arm.scale == 0.0, 0.0, most)).sum(axis=1) + np.abs(arm.offset)
    travels = {  # of prismatic joints, which move the tcp away from the axes before them
        joint: most[joint - 1] for joint in joints if model.joints[joint].shortname().startswith("JointModelP")
    }
    between = [np.linalg.norm(model.jointPlacements[joint].translation) for joint in joints]
    offsets = [gap + travels.get(joint, 0.0) for joint, gap in zip(joints[1:], between[1:], strict=True)]
    offsets.append(np.linalg.norm(tcp.placement.translation))
    each = {joint: 1.0 if joint in travels else sum(offsets[k:]) for k, joint in enumerate(joints)}
    return np.abs(arm.scale).T @ [each.get(row + 1, 0.0) for row in range(len(arm.scale))]


def _solved(arm: Arm, start: Array, poses: list[pin.SE3]) -> tuple[Array, Array, str]:
    """The joint values (k, n) at poses, each solved from the previous one, and (k,) the norms of the inverse of J."""
    scale = np.array([1.0 / UNIT] * 3 + [1.0] * 3)
    rows, norms, q, reason = list[Array](), list[float](), start.copy(), ""
    for pose in poses:
        for _ in range(ATTEMPTS):  # Newton's method
            here = arm.forward_kinematics(q)
            turn = here.rotation @ pin.log3(here.rotation.T @ pose.rotation)
            error = scale * np.concatenate([pose.translation - here.translation, turn])
            jacobian = scale[:, None] * arm.jacobian(q)[:, -6:]
            if np.abs(error).max() <= SOLVED:
                break
            try:
                q = np.concatenate([q[:-6], q[-6:] + np.linalg.solve(jacobian, error)])
            except np.linalg.LinAlgError:
                reason = "the arm is singular on it"
                break
        else:
            reason = "the arm cannot follow it"
        if reason:
            break
        # The smallest singular value bounds the inverse of the Jacobian.
        values = np.linalg.svd(jacobian, compute_uv=False)
        if values[-1] < SINGULAR * values[0]:
            reason = "the arm is singular on it"
            break
        rows.append(q)
        norms.append(1.0 / values[-1])
    return np.array(rows), np.array(norms), reason


def _bounds(q: Array, inverse: Array, step: float, change: float, turn: float) -> tuple[float, float]:
    """Bounds (rad) of the deviation from the chords of samples (k, n), and of that by ``turn`` of the orientation.

    Infinite if the samples are too far apart, or may be on different branches; see the top of this module.
    """
    # After a whole step from either end of it; each sample begins or ends one.
    least = 1.0 / inverse**2 - 2.0 * change * step
    near = np.linalg.norm(np.diff(q, axis=0), axis=1) * np.maximum(inverse[1:], inverse[:-1]) * change < 0.5
    if (least <= 0).any() or not near.all():
        return np.inf, np.inf
    largest = 1.0 / np.sqrt(least)
    chord = float((change * largest**3).max() * step**2 / 8.0)
    left = least - 2.0 * change * turn
    if (left <= 0).any():
        return chord, np.inf
    return chord, float(((np.sqrt(least) - np.sqrt(left)) / change).max())


SPACING = 1.0 / 1024.0
"""Share of a move between two samples of the distance to a blend's point; the bound between them is added."""

ROWS = 4
"""Number of strips in which the surface of a blend is covered."""

OTHER_CURVES, CARTESIAN = 0.1, 1.5
"""Shares of the extent of a blend, and of the difference between superpositions, by which its surface is widened."""

SUPERPOSED = ((0.25, 0.75), (0.5, 0.5), (0.75, 0.25), (0.25, 0.25))
"""Shares of the two sides of a blend at which superpositions of joint values and of poses are compared."""

TRACKING = 0.01
"""rad: the assumed deviation from set points that are sent at a fixed period, whose interpolation is not published."""

SAME_END = 1e-6
"""rad: largest difference of the end of a linear move from the configuration that the text states."""

SAME_TCP = 1e-4
"""m and rad: largest difference of the tcp of a declared tool from that of the arm; FANUC states 1e-6 m, 1.7e-5 rad."""

SEVERITY = [
    CertificateStatus.FREE,
    CertificateStatus.UNDECIDED,
    CertificateStatus.VIOLATED,
    CertificateStatus.COLLIDING,
]
"""The statuses of parts in increasing order; the status of a program is the last one that occurs."""

UNLIMITED = 1e12
"""rad/s and rad/s^2: in place of limits that are not known."""

ROUNDING = 2e-5
"""rad: by how much the travel of a joint on a move may differ from what was timed; FANUC rounds to 1e-3 deg."""


@described(eq=False)
class ProgramPart:
    """A part of a program and its certificate."""

    name: str = key('what it is, such as ``"blend at line 14"``')
    line: int = key("the line of the program at which it ends")
    blend: bool = key("whether it is the blend at a point")
    certificate: Certificate = key("the certificate of the configurations that the controller may pass")


@described(eq=False)
class ProgramCertificate(Shown):
    """The certificates of all parts of a program; collision-free only if every part is."""

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
        "known, and a declared tool with another tcp than the arm. The program is then UNDECIDED",
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
            blends = sum(part.blend for part in self.parts)
            parts = [(len(self.parts) - blends, "motion"), (blends, "blend")]
            words = " and ".join(f"{count} {what}{'' if count == 1 else 's'}" for count, what in parts if count)
            return f"FREE: {words} of the program proven, clearance {self.clearance * 1e3:.1f} mm"
        if self.status is CertificateStatus.UNDECIDED and self.untraced:
            return f"UNDECIDED: {self.untraced[0]}"
        # The first part that explains the status, or else what was found beside the parts.
        part = next((each for each in self.parts if each.certificate.status is self.status), None)
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

    def or_raise(self) -> ProgramCertificate:
        """Return the certificate if it is FREE, otherwise raise NotProvenFree."""
        if not self.free:
            raise NotProvenFree(self.message)
        return self

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
    outside = (*_outside(program, checker.arm, traces), *speed_violations(program, checker.arm, traces))
    outputs = tuple(step.line for step in program.steps if isinstance(step, SetOutput) and step.output not in process)
    untraced += tuple(unknown_speeds(program, checker.arm))
    untraced += (fault,) if (fault := tool_fault(program, checker.arm)) else ()
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
        steps = moves_between_rests(curve, checker, deviation, language.zones, linear=linear)
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
    )
    program = write(steps)
    certificate = certify_program(program, checker)
    if not certificate.free:
        return program, certificate
    named = write(steps, certificate=certificate.hash)
    return named, certify_program(named, checker)


SAMPLES = (25, 97)
"""Numbers of points of a motion among which the ends of joint moves are chosen."""

COVERED = 4e-4
"""rad: what moves are proven with beside the deviation, because joint values are rounded and linear moves traced."""

TRIED, SAVED = 8, 1e-3
"""Number of other points that are compared for a corner, and seconds that one must save."""

ON_LINE = 0.004
"""rad: by how much a motion may be off the joint values of a linear move that replaces it."""


def largest_zone(
    zones: Sequence[Blend],
    arm: Arm,
    into: JointPath,
    out: JointPath,
    proven: Callable[[JointPath, Array], bool],
    allowed: Sequence[float] = (0.5, 0.5),
) -> tuple[Blend | None, tuple[float, float] | None]:
    """Return the largest blend between two moves that is proven and uses at most the allowed shares, and its shares.

    A smaller blend is covered where a larger one is, so that few of them are proven.
    """

    def possible(blend: Blend) -> bool:
        shares = [zone_shares(blend, arm, path.q)[0] for path in (into.reversed(), out)]
        return all(np.array(shares) <= allowed) and proven(*blend_cover(blend, arm, into, out))

    number = bisect_left(zones, True, key=possible)
    if number == len(zones):
        return None, None
    used = [zone_shares(zones[number], arm, path.q)[1] for path in (into.reversed(), out)]
    return zones[number], (used[0], used[1])


def timed_step(
    arm: Arm, move: ControllerMove, profile: Profile, blend: Blend | None, *, linear: bool
) -> JointMove | LinearMove:
    """Return the step of a move with its duration and its speed, of which a language states what it can."""
    q = move.path.end
    if not linear:
        percent = round(100 * profile.peak / fastest(move.path, arm.limits).peak)
        return JointMove(q, profile.duration, blend, percent=min(max(percent, 1), 100))
    first, last = (arm.forward_kinematics(end) for end in (move.path.start, q))
    speed = profile.peak * float(np.linalg.norm(last.translation - first.translation))
    return LinearMove(q, last, profile.duration, speed=speed, blend=blend)


class BlendedMoves(NamedTuple):
    """Moves from a stop to the next one by the rules of the controller, with the blend at the end of each."""

    motion: ControllerMotion
    blends: tuple[Blend | None, ...]


def blended_moves(
    points: Array,
    arm: Arm,
    zones: Sequence[Blend],
    proven: Callable[[JointPath, Array], bool],
    *,
    lines: tuple[JointPath | None, JointPath | None] = (None, None),
    passed: tuple[float, float] = (0.5, 0.5),
    compared: int = 0,
) -> BlendedMoves | None:
    """Return few joint moves through some of the points (k, n), with the largest zones between them, all proven.

    The moves may begin with a linear move to the first point, and end with one from the last point, of which zones
    may use the shares ``passed``. Each corner is compared with ``compared`` other points. None if no moves are proven.
    """
    names, limits, known = arm.joint_names, arm.limits, dict[bytes, bool]()

    def line_proven(one: Array, other: Array) -> bool:
        ends = np.stack([one, other])
        if ends.tobytes() not in known:
            known[ends.tobytes()] = proven(JointPath(ends, names), np.zeros(len(names)))
        return known[ends.tobytes()]

    def made(order: Sequence[int]) -> BlendedMoves:
        paths = [JointPath(points[list(pair)], names) for pair in pairwise(order)]
        shares = [0.5] * len(paths)
        if lines[0] is not None:
            paths, shares = [lines[0], *paths], [passed[0], *shares]
        if lines[1] is not None:
            paths, shares = [*paths, lines[1]], [*shares, passed[1]]
        corners = zip(pairwise(paths), pairwise(shares), strict=True)
        ends = [*(largest_zone(zones, arm, *pair, proven, most) for pair, most in corners), (None, None)]
        moves = [ControllerMove(path, None, zone) for path, (_, zone) in zip(paths, ends, strict=True)]
        motion = controller_motion(moves, limits, optional=True)
        kept = (blend if move.zone else None for move, (blend, _) in zip(motion.moves, ends, strict=True))
        return BlendedMoves(motion, tuple(kept))

    order = fewest_moves(points, limits, line_proven)
    if order is None:
        return None
    best = made(order)
    # A corner that is farther away may have a zone, which saves more than the longer moves take
    for k in range(1, len(order) - 1) if compared else ():
        (into, ramp), (out, other) = (stop_times(points[order[k + side]], points, limits) for side in (-1, 1))
        least = into + out - np.minimum(ramp, other)
        nearest = [number for number in np.argsort(least) if least[number] < (into + out)[order[k]]]
        for number in nearest[:compared]:
            changed = [*order[:k], int(number), *order[k + 1 :]]
            if line_proven(*points[changed[k - 1 : k + 1]]) and line_proven(*points[changed[k : k + 2]]):
                moved = made(changed)
                if moved.motion.duration < best.motion.duration - SAVED:
                    best, order = moved, changed
    return best


def moves_between_rests(
    curve: Curve, checker: CollisionChecker, deviation: float, zones: Sequence[Blend], *, linear: bool
) -> list[Step]:
    """Return the moves from each rest of a curve to the next one, after a move to its start.

    Without a proof they lead through samples of the curve.
    """
    arm = checker.arm
    # Samples of the curve, and the parts of it from rest to rest
    if isinstance(curve, JointPath):
        points, rests, times = curve.q, [0, len(curve.q) - 1], np.zeros(len(curve.q))
    else:
        knots = curve.bezier()[0]
        times = np.unique(np.concatenate([knots, np.linspace(knots[0], knots[-1], 4 * SAMPLES[-1])]))
        points = np.asarray(curve(times))
        still = np.zeros(len(times), dtype=bool)
        if isinstance(curve, TimedCurve):
            still = ~np.abs(curve.velocity(times)).max(axis=1).astype(bool)
        rests = sorted({0, *np.flatnonzero(still).tolist(), len(times) - 1})
    steps = list[Step]([JointMove(points[0])])
    times = times if isinstance(curve, TimedCurve) else np.zeros(len(times))

    def proven(path: JointPath, tolerance: Array) -> bool:
        return is_proven_free(path, checker, joint_tolerance=tolerance + deviation + COVERED)

    for first, last in pairwise(rests):
        part = points[first : last + 1]
        if not np.ptp(part, axis=0).any():
            continue
        # A linear move, if the tcp moves on a straight line
        trace = trace_line(arm, part[0], arm.forward_kinematics(part[-1])) if linear else None
        on_line = trace is not None and not trace.reason and np.abs(trace.path.end - part[-1]).max() <= SAME_END
        if on_line and trace and all(np.abs(trace.path.q - q).max(axis=1).min() <= ON_LINE for q in part):
            motion = controller_motion([ControllerMove(trace.path)], arm.limits)
            slower = max(motion.duration, float(times[last] - times[first]))
            profile = motion.profiles[0].lasting(slower)
            steps.append(timed_step(arm, motion.moves[0], profile, None, linear=True))
            continue
        # Or the fastest joint moves; where none are proven, those through samples of the curve
        best: BlendedMoves | None = None
        for count in SAMPLES:
            inner = part[np.unique(np.linspace(0, len(part) - 1, min(count, len(part))).round().astype(int))]
            best = best or blended_moves(with_corners(inner, arm.limits), arm, zones, proven, compared=TRIED)
        if best is None:
            few = [JointPath(pair, arm.joint_names) for pair in pairwise(inner[:: len(inner) // SAMPLES[0] + 1])]
            few.append(JointPath([few[-1].end, inner[-1]], arm.joint_names))
            stopping = [ControllerMove(path) for path in few if np.ptp(path.q, axis=0).any()]
            best = BlendedMoves(controller_motion(stopping, arm.limits), (None,) * len(stopping))
        # No faster than the curve, which may be slow for a reason
        slower = max(1.0, float(times[last] - times[first]) / best.motion.duration)
        steps += [
            timed_step(arm, move, profile.lasting(slower * profile.duration), blend, linear=False)
            for move, profile, blend in zip(best.motion.moves, best.motion.profiles, best.blends, strict=True)
        ]
    return steps


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
    moves = _paths(program, traces)
    for at, path, tolerance in moves[0 if len(moves) == 1 else 1 :]:
        what = "point" if len(moves) == 1 else "linear move" if isinstance(at, LinearMove) else "move"
        yield ExecutedPart(f"{what} at line {at.line}", at.line, False, path, even + tolerance)
    for (at, into, wide), (_, out, wider) in pairwise(moves[1:]):
        if isinstance(at, JointMove | LinearMove) and at.blend is not None:
            cover, extent = blend_cover(at.blend, arm, into, out)
            name = f"blend at line {at.line}"
            yield ExecutedPart(name, at.line, True, cover, extent + even + max(wide, wider))


def _paths(program: RobotProgram, traces: Mapping[int, LineTrace]) -> list[tuple[Step, JointPath, float]]:
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


def program_motions(
    program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]
) -> list[tuple[tuple[int, ...], ControllerMotion]]:
    """Return the motions between the stops of a program by the rules of its controller, with the lines of their moves.

    The move to the first point is not one of them.
    """
    motions = list[tuple[tuple[int, ...], ControllerMotion]]()
    lines, moves = list[int](), list[ControllerMove]()
    paths = _paths(program, traces)
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
    return ControllerMove(path, step.duration, zone, percent / 100.0, top, gain)


def blend_cover(blend: Blend, arm: Arm, into: JointPath, out: JointPath) -> tuple[JointPath, Array]:
    """Return a curve and a tolerance (n,) in each joint, which cover what a blend between two moves may execute.

    Let a and b be the changes of the joint values from the point to configurations on the two moves within the blend.
    While both moves are superposed, the arm is at the point changed by a + b for some of them, whatever their speeds
    are; parabolas and arcs lie there too. The curve leads through rows of this surface, and the tolerance contains half
    of the distance of two rows, ``OTHER_CURVES`` of the largest changes, and ``CARTESIAN`` times the largest difference
    from a superposition of the poses of the tcp. Where these poses cannot be solved, each joint may deviate from the
    surface by its largest change.
    """
    point, sides = into.end, list[Array]()
    for path in (into.reversed(), out):
        points = _dense(path.q)
        share, _ = zone_shares(blend, arm, path.q)
        sides.append(points[: int(np.ceil(share * (len(points) - 1) - 1e-9)) + 1] - point)
    extent = np.abs(np.concatenate(sides)).max(axis=0)
    one, other = sorted(sides, key=lambda side: float(np.abs(side).max()))
    # Rows along the larger side, at some changes of the smaller one
    at, along = (np.linspace(0, len(side) - 1, ROWS + 1).round().astype(int) for side in (one, other))
    nearest = at[np.abs(np.arange(len(one))[:, None] - at).argmin(axis=1)]
    fine = np.arange(len(other))
    chords = np.stack([np.interp(fine, along, column[along]) for column in other.T], axis=1)
    between = np.abs(one - one[nearest]).max(axis=0) + np.abs(other - chords).max(axis=0)
    between += 0.5 * (
        np.abs(np.diff(one, axis=0)).max(axis=0, initial=0.0) + np.abs(np.diff(other, axis=0)).max(axis=0)
    )
    rows = [point + one[row] + other[along[:: 1 - 2 * (k % 2)]] for k, row in enumerate(at)]
    # Superposed poses of the tcp, for shares of both sides that add up to at most 1
    here, apart = arm.forward_kinematics(point), np.zeros(arm.dof)
    solvable = arm.dof >= 6 and arm.angular[-6:].all()
    for shares in SUPERPOSED:
        changes = [side[round(share * (len(side) - 1))] for side, share in zip(sides, shares, strict=True)]
        joined = point + changes[0] + changes[1]
        ends = [arm.forward_kinematics(point + change) for change in changes]
        turn = pin.log3(here.rotation.T @ ends[0].rotation) + pin.log3(here.rotation.T @ ends[1].rotation)
        place = ends[0].translation + ends[1].translation - here.translation
        pose = pin.SE3(here.rotation @ pin.exp3(turn), place)
        q, _, reason = _solved(arm, joined, [pose]) if solvable else (np.zeros(0), 0, "unknown")
        apart = extent if reason else np.maximum(apart, np.minimum(CARTESIAN * np.abs(q[0] - joined), extent))
        if reason:
            break
    return JointPath(np.concatenate(rows), into.joint_names), between + OTHER_CURVES * extent + apart


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
                trace = trace_line(arm, here, arm.forward_kinematics(stated) if step.pose is None else step.pose)
                rails = [arm.joint_names.index(name) for name in program.external_joints]
                if step.external is not None and np.abs(step.external - here[rails]).max(initial=0.0) > SAME_END:
                    trace = trace._replace(reason="it moves external axes, which only joint moves may move")
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


def tool_fault(program: RobotProgram, arm: Arm) -> str:
    """Why the tool that a program declares is not that of its linear moves and its radii, in a sentence; or empty.

    Its tcp must be that of the arm, from any frame that the model has at the last joint: which is the flange of the
    controller is not stated.
    """
    uses = any(
        isinstance(step, LinearMove) or (isinstance(step, JointMove) and step.blend and step.blend.radius is not None)
        for step in program.moves
    )
    if program.tool is None or not uses:
        return ""
    tcp = arm.model.frames[arm.tcp_id]
    for frame in arm.model.frames:
        if frame.parentJoint == tcp.parentJoint:
            apart = pin.log6((frame.placement * program.tool.tcp).actInv(tcp.placement)).vector
            if np.linalg.norm(apart[:3]) <= SAME_TCP and np.linalg.norm(apart[3:]) <= SAME_TCP:
                return ""
    return (
        f"the tcp of tool {program.tool.name!r} in the program is not the tcp {tcp.name!r} of the arm, from any of its "
        "frames at the last joint; state that tcp, or correct the tool"
    )


def overlaps(program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]) -> Iterator[int]:
    """Yield the lines of blends that may use the same part of a move as the previous blend, by their upper bounds.

    A radius that is not limited to half of the moves must end before the point at the other end of each move, which
    the controller skips otherwise, also where the arm stops there. A blend at the first point uses a part of the move
    to this point, which is not known. If no move follows, the arm may stop before the point, or go on from there when
    the program begins again.
    """
    first = program.moves[0]
    if isinstance(first, JointMove) and first.blend is not None:
        yield first.line
    paths = {step.line: path for step, path, _ in _paths(program, traces)}
    for before, at in pairwise((*(step for step in program.steps if not isinstance(step, Remark)), None)):
        zone = before.blend if isinstance(before, JointMove | LinearMove) else None
        if before is None or not isinstance(at, JointMove | LinearMove):
            if before is not None and zone is not None:
                yield before.line
        elif at.line in paths:
            path = paths[at.line]
            ends = ((zone, path), (at.blend, path.reversed()))
            used = [0.0 if blend is None else zone_shares(blend, arm, side.q)[0] for blend, side in ends]
            if max(used) == 1.0 or sum(used) > 1.0:
                yield before.line if at.blend is None else at.line


def _outside(program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]) -> Iterator[str]:
    """Yield the violations of the position limits; a line in joint space between two points within them is within them.

    On a linear move, all joint values that its trace allows must be within the limits.
    """
    for step in program.moves:
        where = f"line {step.line}"
        if isinstance(step, StreamedTrajectory):
            ends: Sequence[Array] = Trajectory.of_record(step.record).range()
        elif isinstance(step, LinearMove):
            trace = traces[step.line]
            ends = (trace.path.q.min(axis=0) - trace.tolerance, trace.path.q.max(axis=0) + trace.tolerance)
            where += f", up to {trace.tolerance:.2g} rad from the traced values"
        else:
            ends = () if step.q is None else (step.q,)
        for q in ends:
            for sentence in arm.limits.violations(arm.limits.snap(q), arm.joint_names):
                yield f"{where}: {sentence}"


def speed_violations(program: RobotProgram, arm: Arm, traces: Mapping[int, LineTrace]) -> Iterator[str]:
    """Yield what the joints cannot follow: stated durations that are too short, and jumps between set points.

    A duration is compared with the shortest one in which each joint can move that far, from rest or to rest where the
    arm stops; without a known acceleration limit that is the distance by the velocity. Between set points the speed is
    their difference by the period, and the arm rests before the first and after the last one; without a known
    acceleration limit the default is used there, because a controller that cannot follow leaves the assumed deviation.
    """
    limits, names = arm.limits, program.joint_names
    here: Array | None = None
    moving = False
    before = np.zeros(0)
    stream: list[StreamedPoint] = []
    for step in (*program.steps, None):
        if isinstance(step, StreamedTrajectory):
            for end, rates in (("begins", step.record.velocities[0]), ("ends", step.record.velocities[-1])):
                for joint in np.flatnonzero(rates):
                    speed = f"{rates[joint]:.4g} rad/s of {names[joint]}"
                    yield f"line {step.line}: the trajectory {end} at {speed}, and the arm is at rest there"
        # A stream of set points is judged as a whole, when it ends.
        if stream and not isinstance(step, StreamedPoint):
            yield from _stream_faults(stream, before, limits, names)
            stream = []
        if isinstance(step, StreamedPoint):
            if not stream:
                before = step.q if here is None else here
            stream.append(step)
        elif isinstance(step, JointMove | LinearMove) and here is not None:
            duration, stops = step.duration, 0
            if isinstance(step, LinearMove):  # the tcp passes the samples at equal times at constant speed
                path = traces[step.line].path
                travel = np.abs(np.diff(path.q, axis=0)).max(axis=0, initial=0.0) * max(len(path.q) - 1, 1)
                ends = [arm.forward_kinematics(q).translation for q in (path.start, path.end)]
                distance = float(np.linalg.norm(ends[1] - ends[0]))
            else:
                path, travel = JointPath([here, step.q], arm.joint_names), np.abs(step.q - here)
                distance = float(travel.max())
            if duration is not None:
                stops = (not moving) + (step.blend is None)
            if duration is None and step.speed is not None:
                duration = distance / step.speed
            # All joints accelerate in proportion
            most = np.where(limits.guessed | np.isnan(limits.acceleration), np.inf, limits.acceleration)
            rates = travel * (step.acceleration or 0.0) / max(distance, 1e-9)
            for joint in np.flatnonzero(rates > most * (1.0 + LIMIT_TOLERANCE)):
                yield (
                    f"line {step.line}: {names[joint]} would need the acceleration {rates[joint]:.4g} as stated; its "
                    f"limit is {most[joint]:.4g} rad/s^2"
                )
            # A move whose stated duration is too short cannot be followed.
            needed = np.maximum(
                shortest_durations(np.maximum(travel - ROUNDING, 0.0), limits, 0),
                shortest_durations(np.maximum(np.abs(path.end - path.start) - ROUNDING, 0.0), limits, stops),
            )
            for joint in () if duration is None else np.flatnonzero(needed > duration * (1.0 + LIMIT_TOLERANCE)):
                yield (
                    f"line {step.line}: {names[joint]} moves by {travel[joint]:.4g} rad in {duration:g} s, but needs "
                    f"at least {needed[joint]:.4g} s within its limits"
                )
        if isinstance(step, JointMove | LinearMove | StreamedPoint):
            here, moving = step.q, isinstance(step, JointMove | LinearMove) and step.blend is not None


def shortest_durations(travel: Array, limits: JointLimits, stops: int) -> Array:
    """Return the shortest durations (n,) in which joints can move by ``travel`` within their limits, as far as known.

    ``stops`` is the number of ends, of two, at which they rest; at another they may have any velocity. The profile with
    the largest velocity p takes the time travel / p + stops p / (2 a), which is least for p^2 = 2 a travel / stops.
    """
    velocity = np.where(np.isnan(limits.velocity), UNLIMITED, limits.velocity)
    unknown = limits.guessed | np.isnan(limits.acceleration)
    if not stops or unknown.all():
        return travel / velocity
    acceleration = np.where(unknown, UNLIMITED, limits.acceleration)
    peak = np.minimum(np.sqrt(2.0 * acceleration * np.maximum(travel, np.finfo(float).tiny) / stops), velocity)
    return np.asarray(travel / peak + stops * peak / (2.0 * acceleration))


def unknown_speeds(program: RobotProgram, arm: Arm) -> Iterator[str]:
    """Yield moves and set points whose speed is not known: a stated time from an unknown start, or unknown limits."""
    first = program.moves[0]
    if isinstance(first, StreamedPoint) or (isinstance(first, JointMove) and first.duration is not None):
        yield f"line {first.line} states the time of the move to the first point, whose start is not known"
    unknown = np.flatnonzero(np.isnan(arm.limits.velocity))
    stream = next((step for step in program.moves if isinstance(step, StreamedPoint)), None)
    if stream is not None and len(unknown):
        names = ", ".join(program.joint_names[joint] for joint in unknown)
        yield f"line {stream.line} is a set point, but the velocity limits of {names} are not known"


def _stream_faults(
    stream: Sequence[StreamedPoint], before: Array, limits: JointLimits, names: Sequence[str]
) -> Iterator[str]:
    """Yield the first set point at which a joint exceeds its velocity, and that of its acceleration."""
    q = np.stack([before, *(point.q for point in stream), stream[-1].q])
    period = np.array([*(point.period for point in stream), stream[-1].period])[:, None]
    speed = np.diff(q, axis=0) / period
    change = np.diff(np.concatenate([np.zeros((1, len(names))), speed]), axis=0) / period
    rows = (("velocity", speed, limits.velocity, "rad/s"), ("acceleration", change, limits.acceleration, "rad/s^2"))
    for quantity, values, bound, unit in rows:
        # Rounding of the text to 1e-6 rad changes a difference of set points by that at most, one of
        # speeds by twice it.
        rounding = 1e-6 / period if quantity == "velocity" else 2e-6 / period**2
        above = np.abs(values) > np.where(np.isnan(bound), np.inf, bound) * (1.0 + LIMIT_TOLERANCE) + rounding
        if above.any():
            row, joint = np.argwhere(above)[0]
            line = stream[min(int(row), len(stream) - 1)].line
            yield (
                f"line {line}: {names[joint]} would need the {quantity} {abs(values[row, joint]):.4g} between the set "
                f"points; its limit is {bound[joint]:.4g} {unit}"
            )


def zone_shares(blend: Blend, arm: Arm, q: Array) -> tuple[float, float]:
    """Return the share of a move from a point that a blend there may use: an upper bound, and the stated one.

    The points q (k, n) of the move begin at that of the blend. For a blend with a radius it is the part of the move on
    which the tcp may be within the radius of its position at the point. The tcp moves by at most ``lever . |dq|``
    between two samples.
    """
    if blend.radius is None:
        return blend.share, blend.share * blend.stated
    points = _dense(q)
    spacing = 1.0 / (len(points) - 1)
    tcp = arm.forward_kinematics_batch(points)[:, :3, 3]
    slack = float((np.abs(np.diff(points, axis=0)) @ levers(arm)).max())
    distances = np.linalg.norm(tcp - tcp[0], axis=1)
    last = int(np.flatnonzero(distances <= blend.radius + slack).max())
    first = int(np.argmax(np.append(distances, np.inf) > blend.radius * blend.stated))
    return min((last + 1) * spacing, blend.share), min((first - 1) * spacing, blend.share)


def _dense(q: Array) -> Array:
    """Points of a move at equal shares of it; a line that is not traced has a single one."""
    if len(q) != 2:
        return q if len(q) > 2 else np.repeat(q, 2, axis=0)
    return np.asarray(q[0] + np.arange(0.0, 1.0 + SPACING, SPACING)[:, None] * (q[1] - q[0]))


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
