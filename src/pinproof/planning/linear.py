"""Straight lines of the tcp in space, as smooth curves in joint space, certified."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.ik import Clik, IkResult
from pinproof.model import Arm
from pinproof.motion import CubicPath
from pinproof.planning.linear_move import LinearMove, LinearStatus
from pinproof.spatial import SE3, interpolate, rigid, twist_size

__all__ = ["plan_linear"]

Array = npt.NDArray[np.float64]

MAX_REFINEMENTS = 6
"""How often the poses are put twice as close together before the line is given up."""

LIMIT_REACHED = 1e-4
"""Rad or m. A joint this near its limit is said to be at it."""

ROUNDING = 1e-9
"""Rad or m. What floating-point error may put a point beside a solved pose at a limit beyond it, with room."""


def plan_linear(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    target: SE3 | npt.ArrayLike,
    *,
    deviation: float = 1e-3,
    rotation_deviation: float = 1e-2,
    translation_step: float = 0.02,
    rotation_step: float = 0.1,
    max_joint_step: float = 0.3,
) -> LinearMove:
    """Move the tcp from where it is at ``start`` straight to ``target``.

    The position goes along a line while the orientation turns about one fixed axis. Poses along the line are solved one
    from the other, so the arm stays on its branch, and joined by a twice differentiable curve that keeps the limits at
    every point.

    Parameters
    ----------
    checker
        What the move must be free of.
    start
        (n,) the first configuration.
    target
        ``base_from_tcp`` at the end. If it is half a turn away, one of the two ways round is taken.
    deviation, rotation_deviation
        Metres and radians the tcp may stray from the line between the solved poses; they are put closer together until
        it holds.
    translation_step, rotation_step
        Largest distance (m) and angle (rad) between solved poses.
    max_joint_step
        Largest joint step (rad or m) between solved poses. They are put closer together until it holds, at most
        2^MAX_REFINEMENTS times; a larger step is then a jump.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite or a setting is not above 0.
    """
    for name, value in {
        "deviation": deviation,
        "rotation_deviation": rotation_deviation,
        "translation_step": translation_step,
        "rotation_step": rotation_step,
        "max_joint_step": max_joint_step,
    }.items():
        if not value > 0:
            raise InputError(f"{name} = {value}; it must be above 0")
    arm = checker.arm
    first = arm.configuration(start, "start")
    if outside := arm.limits.violations(first, arm.joint_names):
        return LinearMove(LinearStatus.UNREACHABLE, None, None, 0.0, f"the start is no place to start: {outside[0]}")
    line = _Line(arm.forward_kinematics(first), rigid("target", target))
    pieces = max(line.pieces(translation_step, rotation_step), 2)
    for _ in range(MAX_REFINEMENTS + 1):
        walk = _Walk(arm, line, first, pieces, max_joint_step)
        if walk.stopped is LinearStatus.UNREACHABLE:
            break
        if walk.stopped is None:
            path = walk.path()
            strayed = line.strayed(arm, path, pieces)
            outside_limits = _outside_limits(arm, path)
            if strayed[0] <= deviation and strayed[1] <= rotation_deviation and not outside_limits:
                return _certified(path, checker, strayed)
            walk.refuse(outside_limits, strayed)
        pieces *= 2
    return _stopped(walk, checker)


class _Line:
    """The poses along the line, by a parameter from 0 to 1."""

    def __init__(self, first: SE3, last: SE3) -> None:
        self._first, self._last = first, last

    def __call__(self, s: float) -> SE3:
        return interpolate(self._first, self._last, s)

    def pieces(self, translation_step: float, rotation_step: float) -> int:
        distance, angle = twist_size(self._first, self._last)
        return int(np.ceil(max(distance / translation_step, angle / rotation_step)))

    def strayed(self, arm: Arm, path: CubicPath, pieces: int) -> tuple[float, float]:
        """How far (m, rad) the tcp is off where it should be, at eight points of each piece."""
        samples = np.linspace(0.0, 1.0, 8 * pieces + 1)
        sizes = [twist_size(self(s), arm.forward_kinematics(q)) for q, s in zip(path(samples), samples, strict=True)]
        return max(size[0] for size in sizes), max(size[1] for size in sizes)


class _Walk:
    """Configurations along the line, solved one from the other as far as it goes.

    ``stopped`` is None when the line's end was reached; else ``why`` says what stands in the way.
    """

    def __init__(self, arm: Arm, line: _Line, first: Array, pieces: int, max_joint_step: float) -> None:
        self._arm, self._pieces, self._q = arm, pieces, [first]
        self.stopped: LinearStatus | None = None
        self.why = ""
        solver = Clik(restarts=0, max_step=max_joint_step)
        while self.stopped is None and len(self._q) <= pieces:
            here = self._q[-1]
            guess = here if len(self._q) == 1 else arm.limits.clip(2 * here - self._q[-2])
            found = solver.solve(arm, line(len(self._q) / pieces), guess)
            step = np.abs(found.q - here)
            joint = int(step.argmax())
            if not found.ok:
                self.stopped, self.why = LinearStatus.UNREACHABLE, _miss(arm, found)
            elif step[joint] <= max_joint_step:
                self._q.append(found.q)
            elif arm.periodic[joint] and step[joint] > np.pi:  # the solver went round: a turn away, same pose
                self.stopped = LinearStatus.UNREACHABLE
                self.why = f"{arm.joint_names[joint]} is at its limit; the same pose is {step[joint]:.2f} away in it"
            else:
                self.stopped = LinearStatus.JUMP
                self.why = f"{arm.joint_names[joint]} would jump by {step[joint]:.2f}, {_singular(arm, here)}"

    @property
    def fraction(self) -> float:
        """The share of the line that was walked."""
        return (len(self._q) - 1) / self._pieces

    def path(self) -> CubicPath:
        """The curve through what was walked, by the share of the line."""
        knots = np.arange(len(self._q)) / self._pieces
        return CubicPath.through(np.array(self._q), self._arm.joint_names, knots=knots)

    def refuse(self, outside_limits: str, strayed: tuple[float, float]) -> None:
        """The poses were all solved but the curve between them is no good."""
        self._q = self._q[:1]
        self.stopped = LinearStatus.UNREACHABLE if outside_limits else LinearStatus.JUMP
        self.why = (
            f"{outside_limits} between the solved poses"
            if outside_limits
            else f"between the solved poses the tcp strays {strayed[0] * 1e3:.2g} mm and {strayed[1]:.2g} rad"
        )


def _miss(arm: Arm, found: IkResult) -> str:
    """Which joint is at its limit, or how singular the arm is, where the line ends."""
    limits = arm.limits
    at_limit = [
        name
        for name, value, low, high in zip(arm.joint_names, found.q, limits.lower, limits.upper, strict=True)
        if value - low < LIMIT_REACHED or high - value < LIMIT_REACHED
    ]
    short = f"{found.position_error * 1e3:.1f} mm and {found.orientation_error:.2g} rad short"
    return f"{', '.join(at_limit)} at the limit, {short}" if at_limit else f"{short}, {_singular(arm, found.q)}"


def _singular(arm: Arm, q: Array) -> str:
    return f"smallest singular value {arm.singularity(q).smallest:.2g}"


def _outside_limits(arm: Arm, path: CubicPath) -> str:
    """Which joint may leave its limits on the curve: control points inside prove that it does not."""
    _, control = path.bezier()
    low, high = control.min(axis=(0, 1)), control.max(axis=(0, 1))
    beyond = np.maximum(arm.limits.lower - low, high - arm.limits.upper)
    joint = int(beyond.argmax())
    return f"{arm.joint_names[joint]} may leave its limits by {beyond[joint]:.2g}" if beyond[joint] > ROUNDING else ""


def _certified(path: CubicPath, checker: CollisionChecker, strayed: tuple[float, float]) -> LinearMove:
    certificate = certify(path, checker)
    if certificate.free:
        message = f"straight to the target, {certificate.message}"
        return LinearMove(LinearStatus.COMPLETE, path, certificate, 1.0, message, *strayed)
    return _touching(certificate, strayed)


def _touching(certificate: Certificate, strayed: tuple[float, float] = (np.nan, np.nan)) -> LinearMove:
    """The move that a contact, or a proof that met its tolerance, ends."""
    if certificate.status is CertificateStatus.COLLIDING and certificate.first_contact is not None:
        fraction, status = certificate.first_contact.proven_free_until, LinearStatus.CONTACT
    else:
        fraction = 0.0 if certificate.undecided is None else certificate.undecided.start
        status = LinearStatus.UNDECIDED
    message = f"stops at {_percent(fraction)} of the line: {certificate.message}"
    return LinearMove(status, None, certificate, fraction, message, *strayed)


def _stopped(walk: _Walk, checker: CollisionChecker) -> LinearMove:
    """The move that ends where the walk did, unless a contact ends it before."""
    certificate = certify(walk.path(), checker)
    if not certificate.free:
        return _touching(certificate)
    message = f"stops at {_percent(walk.fraction)} of the line: {walk.why}"
    return LinearMove(walk.stopped or LinearStatus.JUMP, None, None, walk.fraction, message)


def _percent(fraction: float) -> str:
    """Rounded down: "100 %" is all of the line."""
    return f"{int(fraction * 100)} %"
