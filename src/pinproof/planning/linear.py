"""Straight lines of the tcp in space, as smooth curves in joint space, certified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, certify
from pinproof.ik import IkTask
from pinproof.ik.task import TaskName
from pinproof.planning.aim import aimed, line_task
from pinproof.planning.follow import Following, Walked
from pinproof.planning.linear_move import LinearMove, LinearStatus
from pinproof.planning.route import Route
from pinproof.spatial import SE3, rigid

__all__ = ["ended", "percent", "plan_linear"]


def plan_linear(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    target: SE3 | npt.ArrayLike,
    *,
    task: TaskName | IkTask = "pose",
    deviation: float = 1e-3,
    rotation_deviation: float = 1e-2,
    translation_step: float = 0.05,
    rotation_step: float = 0.2,
    max_joint_step: float = 0.3,
    parting: Sequence[tuple[str, str]] = (),
) -> LinearMove:
    """Move the tcp from where it is at ``start`` straight to ``target``.

    The position goes along a line while the orientation turns about one fixed axis. Poses along the line are solved one
    from the other, so the arm stays on its branch, and joined by a twice differentiable curve that keeps the limits at
    every point and whose distance from the line is bounded everywhere (:mod:`pinproof.planning.stray`).

    Parameters
    ----------
    checker
        What the move must be free of.
    start
        (n,) the first configuration.
    target
        ``base_from_tcp`` at the end. If it is half a turn away, one of the two ways round is taken.
    task
        What is asked of the tcp, as for :meth:`pinproof.Clik.solve`: ``"pose"``; ``"position"``, however it turns;
        ``"spin_z"`` (``"spin_x"``, ``"spin_y"``), where that axis of the tcp is led the short way to where the target
        has it and the spin about it is free; ``"orientation"``, wherever it goes.
    deviation, rotation_deviation
        Metres and radians the tcp may be off the line, between the solved poses too; they are put closer together
        until it is proven.
    translation_step, rotation_step
        Largest distance (m) and angle (rad) between solved poses.
    max_joint_step
        Largest joint step (rad or m) between solved poses. They are put closer together until it holds, to a 64th of
        the steps; where that is not enough, it is a jump.
    parting
        Pairs that may touch at the start, as for :func:`pinproof.certify`.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, a setting is not above 0, or the task asks for part of the position
        or for one turn alone.
    """
    asked = line_task(task)
    arm = checker.arm
    following = Following(
        arm=arm,
        task=asked,
        deviation=deviation,
        rotation_deviation=rotation_deviation,
        translation_step=translation_step,
        rotation_step=rotation_step,
        max_joint_step=max_joint_step,
    )
    first, last = arm.limits.snap(arm.configuration(start, "start")), rigid("target", target)
    if outside := arm.limits.violations(first, arm.joint_names):
        said = f"the start is no place to start: {outside[0]}"
        beyond = np.flatnonzero((first < arm.limits.lower) | (first > arm.limits.upper))
        names = tuple(arm.joint_names[joint] for joint in beyond)
        return LinearMove(LinearStatus.LIMIT, None, None, 0.0, said, joints=names)
    here = arm.forward_kinematics(first)
    return _judged(following.walk(Route.straight(here, aimed(here, last, asked)), first), checker, parting)


def _judged(walked: Walked, checker: CollisionChecker, parting: Sequence[tuple[str, str]]) -> LinearMove:
    """The move as far as it was walked, unless a contact ends it before."""
    certificate = certify(walked.path, checker, parting=parting)
    if not certificate.free:
        return _touching(certificate)
    if walked.status is not LinearStatus.COMPLETE:
        message = f"stops at {percent(walked.fraction)} of the line: {walked.why}"
        return LinearMove(walked.status, None, None, walked.fraction, message, joints=walked.joints)
    message = f"straight to the target, {certificate.message}"
    return LinearMove(
        LinearStatus.COMPLETE,
        walked.path,
        certificate,
        1.0,
        message,
        walked.deviation,
        walked.rotation_deviation,
    )


def _touching(certificate: Certificate) -> LinearMove:
    """The move that a contact, or a proof that met its tolerance, ends."""
    status, fraction = ended(certificate)
    return LinearMove(
        status, None, certificate, fraction, f"stops at {percent(fraction)} of the line: {certificate.message}"
    )


def ended(certificate: Certificate) -> tuple[LinearStatus, float]:
    """What ends a curve that is not FREE, and the parameter up to which it is proven."""
    if certificate.status is CertificateStatus.COLLIDING and certificate.first_contact is not None:
        return LinearStatus.CONTACT, certificate.first_contact.proven_free_until
    return LinearStatus.UNDECIDED, 0.0 if certificate.undecided is None else certificate.undecided.start


def percent(fraction: float) -> str:
    """Rounded down: "100 %" is all of the line."""
    return f"{int(fraction * 100)} %"
