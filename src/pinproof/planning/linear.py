"""Straight lines of the tcp in space, as smooth curves in joint space, certified."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, certify
from pinproof.errors import InputError, PlanFailed
from pinproof.ik import Clik, IkResult
from pinproof.model import Arm
from pinproof.motion import CubicPath
from pinproof.spatial import SE3, interpolate, rigid, twist_size

__all__ = ["LinearMove", "LinearStatus", "plan_linear"]

Array = npt.NDArray[np.float64]


class LinearStatus(Enum):
    """How a straight move ended."""

    COMPLETE = "complete"
    UNREACHABLE = "a pose on the line is out of reach without leaving the branch"
    JUMP = "the joints would have to jump"
    CONTACT = "a body touches"
    UNDECIDED = "the proof met its tolerance"


@dataclass(frozen=True, eq=False)
class LinearMove:
    """A straight move of the tcp.

    Parameters
    ----------
    status
        COMPLETE, or why it stops.
    path
        The joint curve; None unless COMPLETE.
    certificate
        FREE when COMPLETE; the verdict that stopped it for CONTACT and UNDECIDED; else None.
    fraction
        The share of the line, 0 to 1, up to which the move is possible and free.
    deviation
        Largest distance (m) of the tcp from the line, seen at eight points of each piece; NaN without a curve.
    message
        The outcome in a sentence.
    """

    status: LinearStatus
    path: CubicPath | None
    certificate: Certificate | None
    fraction: float
    deviation: float
    message: str

    @property
    def ok(self) -> bool:
        """Whether the whole line is possible and proven free."""
        return self.status is LinearStatus.COMPLETE

    def or_raise(self) -> LinearMove:
        """Return the move if it is complete.

        Raises
        ------
        PlanFailed
            With the message otherwise.
        """
        if not self.ok:
            raise PlanFailed(self.message, self)
        return self


def plan_linear(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    target: SE3 | npt.ArrayLike,
    *,
    deviation: float = 1e-3,
    translation_step: float = 0.02,
    rotation_step: float = 0.1,
    max_joint_step: float = 0.3,
) -> LinearMove:
    """Move the tcp from where it is at ``start`` straight to ``target``.

    The position goes along a line while the orientation turns about one fixed axis. Poses along the line are solved one
    from the other, so the arm stays on its branch, and joined by a twice differentiable curve.

    Parameters
    ----------
    checker
        What the move must be free of.
    start
        (n,) the first configuration.
    target
        ``base_from_tcp`` at the end.
    deviation
        Metres the tcp may stray from the line between the solved poses; they are put closer together until it holds.
    translation_step, rotation_step
        Largest distance (m) and angle (rad) between solved poses.
    max_joint_step
        Largest joint step (rad or m) between solved poses; a larger one is a jump.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite or a setting is not above 0.
    """
    for name, value in {
        "deviation": deviation,
        "translation_step": translation_step,
        "rotation_step": rotation_step,
        "max_joint_step": max_joint_step,
    }.items():
        if not value > 0:
            raise InputError(f"{name} = {value}; it must be above 0")
    arm = checker.arm
    first = arm.configuration(start, "start")
    line = _Line(arm.forward_kinematics(first), rigid("target", target))
    pieces = max(line.pieces(translation_step, rotation_step), 2)
    for _ in range(MAX_REFINEMENTS):
        solved = _follow(arm, first, line, pieces, max_joint_step)
        if isinstance(solved, LinearMove):
            return solved
        path = CubicPath.through(solved, arm.joint_names, knots=np.linspace(0.0, 1.0, pieces + 1))
        strayed = _deviation(arm, path, line, pieces)
        if strayed <= deviation:
            return _certified(path, checker, strayed)
        pieces *= 2
    return LinearMove(
        LinearStatus.JUMP,
        None,
        None,
        0.0,
        strayed,
        f"the tcp strays {strayed * 1e3:.2g} mm at every step",
    )


MAX_REFINEMENTS = 6
"""How often the poses are put twice as close together before the line is given up."""


class _Line:
    """The poses along the line, by a parameter from 0 to 1."""

    def __init__(self, first: SE3, last: SE3) -> None:
        self._first, self._last = first, last

    def __call__(self, s: float) -> SE3:
        return interpolate(self._first, self._last, s)

    def pieces(self, translation_step: float, rotation_step: float) -> int:
        distance, angle = twist_size(self._first, self._last)
        return int(np.ceil(max(distance / translation_step, angle / rotation_step)))

    def strayed(self, placement: SE3, s: float) -> float:
        return float(np.linalg.norm(placement.translation - self(s).translation))


def _follow(arm: Arm, first: Array, line: _Line, pieces: int, max_joint_step: float) -> Array | LinearMove:
    """Configurations (pieces + 1, n) along the line, or the move that says where it stops."""
    solver = Clik(restarts=0, max_step=max_joint_step)
    q = [first]
    for index in range(1, pieces + 1):
        guess = arm.limits.clip(2 * q[-1] - q[-2]) if index > 1 else q[-1]
        found: IkResult = solver.solve(arm, line(index / pieces), guess)
        fraction = (index - 1) / pieces
        if not found.ok:
            message = f"stops at {fraction:.0%} of the line: {_why(arm, found)}"
            return LinearMove(LinearStatus.UNREACHABLE, None, None, fraction, np.nan, message)
        step = np.abs(found.q - q[-1])
        if step.max() > max_joint_step:
            joint = arm.joint_names[int(step.argmax())]
            message = f"stops at {fraction:.0%} of the line: {joint} would jump by {step.max():.2f}"
            return LinearMove(LinearStatus.JUMP, None, None, fraction, np.nan, message)
        q.append(found.q)
    return np.array(q)


def _why(arm: Arm, found: IkResult) -> str:
    """Which joint is at its limit, or how singular the arm is, where the line ends."""
    limits = arm.limits
    at_limit = [
        name
        for name, value, low, high in zip(arm.joint_names, found.q, limits.lower, limits.upper, strict=True)
        if value - low < LIMIT_REACHED or high - value < LIMIT_REACHED
    ]
    if at_limit:
        return f"{', '.join(at_limit)} at the limit, {found.position_error * 1e3:.1f} mm short"
    smallest = arm.singularity(found.q).smallest
    return f"{found.position_error * 1e3:.1f} mm short (smallest singular value {smallest:.2g})"


LIMIT_REACHED = 1e-4
"""Rad or m. A joint this near its limit is said to be at it."""


def _deviation(arm: Arm, path: CubicPath, line: _Line, pieces: int) -> float:
    samples = np.linspace(0.0, 1.0, 8 * pieces + 1)
    return max(line.strayed(arm.forward_kinematics(q), s) for q, s in zip(path(samples), samples, strict=True))


def _certified(path: CubicPath, checker: CollisionChecker, strayed: float) -> LinearMove:
    certificate = certify(path, checker)
    if certificate.free:
        message = f"straight to the target, {certificate.message}"
        return LinearMove(LinearStatus.COMPLETE, path, certificate, 1.0, strayed, message)
    if certificate.status is CertificateStatus.COLLIDING and certificate.first_contact is not None:
        fraction, status = certificate.first_contact.proven_free_until, LinearStatus.CONTACT
    else:
        fraction = 0.0 if certificate.undecided is None else certificate.undecided.start
        status = LinearStatus.UNDECIDED
    message = f"stops at {fraction:.0%} of the line: {certificate.message}"
    return LinearMove(status, None, certificate, fraction, strayed, message)
