"""Cartesian moves of the tcp on straight lines, as certified smooth curves in joint space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, certify
from pinproof.common.validation import require_type
from pinproof.ik import IkTask, TaskName
from pinproof.model import Arm
from pinproof.planning.plan_results import LinearPlanResult, LinearStatus
from pinproof.planning.routes import Route, RouteFollower, line_task, nearest_target
from pinproof.spatial import SE3, Array, rigid


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
    least: float = 0.0,
) -> LinearPlanResult:
    """Move the tcp on a straight line from its pose at ``start`` to ``target``.

    The position moves along a line while the orientation rotates about one fixed axis. Poses along the line are solved
    one after another, so that the arm stays on its IK branch. They are joined by a twice differentiable curve that
    keeps the joint limits, and whose deviation from the line is bounded, at every point
    (:mod:`pinproof.planning.routes`).

    Parameters
    ----------
    checker
        Defines the bodies and margins.
    start
        (n,) the first configuration.
    target
        ``base_from_tcp`` at the end. If its orientation differs by pi, one of the two directions of rotation is chosen.
    task
        The constrained coordinates of the tcp, as for :meth:`pinproof.Clik.solve`. ``"pose"``: all. ``"position"``: the
        orientation is free. ``"orientation"``: the position is free. ``"spin_z"`` (``"spin_x"``, ``"spin_y"``): the
        rotation about that axis of the tcp is free, and the axis rotates by the smallest angle to its target direction.
    deviation, rotation_deviation
        Allowed deviation (m, rad) of the tcp from the line at every point. The spacing of the solved poses is reduced
        until the bounds of the deviation are below it.
    translation_step, rotation_step
        Maximum distance (m) and angle (rad) between solved poses.
    max_joint_step
        Maximum joint step (rad or m) between solved poses. The spacing is reduced until the step is below it, at most
        to 1/64. A larger step at that spacing is a jump.
    parting
        Pairs that may be in contact at the start, as for :func:`pinproof.certify`.
    least
        Share of the line, 0 to 1. A line that cannot be followed that far fails without an exact fraction and a
        certificate, which is faster; with 1, only complete lines are of interest.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, a setting is not above 0, or the task constrains only part of the
        position or exactly one rotation.
    """
    require_type("checker", checker, CollisionChecker)
    arm = checker.arm
    follower = RouteFollower(
        arm=arm, task=line_task(task), deviation=deviation, rotation_deviation=rotation_deviation,
        translation_step=translation_step, rotation_step=rotation_step, max_joint_step=max_joint_step, least=least,
    )  # fmt: skip
    first, last = arm.limits.snap(arm.configuration(start, "start")), rigid("target", target)
    if message := _outside_limits(arm, first):
        names = tuple(np.array(arm.joint_names)[first != arm.limits.clip(first)].tolist())
        return LinearPlanResult(LinearStatus.LIMIT, None, None, 0.0, message, joints=names)
    here = arm.forward_kinematics(first)
    route = Route.straight(here, nearest_target(here, last, follower.task))
    followed = follower.follow(route, first)
    if followed.status is not LinearStatus.COMPLETE and followed.fraction < least:
        message = f"cannot be followed beyond {_percent(least)} of the line"
        return LinearPlanResult(followed.status, None, None, followed.fraction, message)
    # A contact on the curve comes before the point at which the route cannot be followed farther.
    certificate = certify(followed.path, checker, parting=parting)
    if not certificate.free:
        status, fraction = _stop(certificate)
        message = f"stops at {_percent(fraction)} of the line: {certificate.message}"
        return LinearPlanResult(status, None, certificate, fraction, message)
    if followed.status is not LinearStatus.COMPLETE:
        message = f"stops at {_percent(followed.fraction)} of the line: {followed.reason}"
        return LinearPlanResult(followed.status, None, None, followed.fraction, message, joints=followed.joints)
    message = f"reached the target on a straight line; {certificate.message}"
    deviations = followed.deviation, followed.rotation_deviation
    return LinearPlanResult(LinearStatus.COMPLETE, followed.path, certificate, 1.0, message, *deviations)


def _outside_limits(arm: Arm, start: Array) -> str:
    """The message if the start (n,) is outside the joint limits; else empty."""
    outside = arm.limits.violations(start, arm.joint_names)
    return f"the start is invalid: {outside[0]}" if outside else ""


def _stop(certificate: Certificate) -> tuple[LinearStatus, float]:
    """The status of a curve whose certificate is not FREE, and the parameter up to which it is proven free."""
    if certificate.status is CertificateStatus.COLLIDING and certificate.first_contact is not None:
        return LinearStatus.CONTACT, certificate.first_contact.proven_free_until
    return LinearStatus.UNDECIDED, 0.0 if certificate.undecided is None else certificate.undecided.start


def _percent(fraction: float) -> str:
    """The fraction in percent, rounded down, so that 100 % is the complete line."""
    return f"{int(fraction * 100)} %"
