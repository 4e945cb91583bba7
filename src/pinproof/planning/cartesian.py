"""Cartesian moves of the tcp on straight lines, as certified smooth curves in joint space."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CertificateStatus, CollisionChecker, certify
from pinproof.common.validation import require_type
from pinproof.errors import InputError, NoClosedForm
from pinproof.ik import AnalyticIk, Clik, IkTask, TaskName
from pinproof.model import Arm
from pinproof.motion import BlendedPath, CubicPath
from pinproof.planning.follow import FollowedRoute, Route, RouteFollower, line_task, nearest_target, routes_through
from pinproof.planning.plan_results import LinearPlanResult, LinearStatus, PosesPlanResult
from pinproof.spatial import SE3, Array, rigid, rigid_many

# Maximum number of configurations that are tried at the first pose; those nearest to the home configuration.
MAX_STARTS = 64
# Number of different configurations that are searched for at the first pose if the arm has no closed form.
SAMPLED_STARTS = 16


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
    (:mod:`pinproof.planning.follow`).

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


def plan_poses(
    checker: CollisionChecker,
    start: npt.ArrayLike | None,
    poses: Sequence[SE3] | npt.ArrayLike,
    *,
    task: TaskName | IkTask = "pose",
    rounding: float = 0.0,
    rotation_rounding: float = 0.1,
    deviation: float = 1e-3,
    rotation_deviation: float = 1e-2,
    translation_step: float = 0.05,
    rotation_step: float = 0.2,
    max_joint_step: float = 0.3,
    rng: int | np.random.Generator = 0,
) -> PosesPlanResult:
    """Move the tcp through all poses, on a straight line from each to the next, as :func:`plan_linear` does.

    The arm stops at each pose (the ``corners`` of the path). With ``rounding``, it passes the poses on a smooth curve.

    Parameters
    ----------
    checker
        Defines the bodies and margins.
    start
        (n,) the first configuration, from which a line leads to the first pose. If None, the move begins at the first
        pose. The IK branch is used from which the move gets farthest; if several reach the end, the branch whose joints
        take the least time at their maximum velocity.
    poses
        (k, 4, 4) ``base_from_tcp``, or a sequence of ``pin.SE3``.
    task
        As for :func:`plan_linear`.
    rounding, rotation_rounding
        Maximum distance (m) and angle (rad) between a pose and the rounded path. If ``rounding`` is 0, the arm stops at
        every pose. It always stops at a pose at which the direction is reversed.
    deviation, rotation_deviation
        Allowed deviation (m, rad) of the tcp from the lines and roundings.
    translation_step, rotation_step, max_joint_step
        As for :func:`plan_linear`.
    rng
        Seed or Generator of the search for a first configuration if the arm has no closed form.

    Raises
    ------
    InputError
        If there is no pose, a shape is wrong, a number is not finite, a setting is out of its range, or the task
        constrains only part of the position or exactly one rotation.
    """
    require_type("checker", checker, CollisionChecker)
    arm = checker.arm
    follower = RouteFollower(
        arm=arm, task=line_task(task), deviation=deviation, rotation_deviation=rotation_deviation,
        translation_step=translation_step, rotation_step=rotation_step, max_joint_step=max_joint_step,
    )  # fmt: skip
    if not rounding >= 0 or not rotation_rounding > 0:
        raise InputError(
            f"rounding = {rounding} must be 0 m or more, and rotation_rounding = {rotation_rounding} above 0 rad"
        )
    targets = [rigid("pose", pose) for pose in rigid_many("poses", poses)]
    if not targets:
        raise InputError("poses has no pose; give at least one")
    if start is not None:
        first = arm.limits.snap(arm.configuration(start, "start"))
        if message := _outside_limits(arm, first):
            return PosesPlanResult(LinearStatus.LIMIT, None, None, 0.0, -1, message)
        return _poses_result(_follow_poses(follower, first, targets, rounding, rotation_rounding), checker, -1)
    # All IK branches at the first pose if there is a closed form, otherwise different solutions.
    starts = None
    if follower.task == IkTask() and arm.dof <= 6:
        with contextlib.suppress(NoClosedForm):
            starts = AnalyticIk().solve_all(arm, targets[0]).q[:MAX_STARTS]
    if starts is None:
        starts = Clik().solve_many(arm, targets[0], rng=rng, count=SAMPLED_STARTS, task=follower.task).q
    if not len(starts):
        message = "the first pose has no IK solution inside the joint limits; Clik().solve reports the reason"
        return PosesPlanResult(LinearStatus.UNREACHABLE, None, None, 0.0, -1, message)
    free = starts[checker.is_free_batch(starts)]
    if not len(free):
        message = f"all {len(starts)} configurations at the first pose are in contact: {checker.check(starts[0])}"
        certificate = certify(_point_path(arm, starts[0]), checker)
        return PosesPlanResult(LinearStatus.CONTACT, None, certificate, 0.0, -1, message)
    # The result that gets farthest; if several reach the end, the fastest one.
    candidates = [_follow_poses(follower, first, targets[1:], rounding, rotation_rounding) for first in free]
    candidates.sort(key=lambda candidate: (1.0 - candidate.fraction, candidate.seconds))
    best = _poses_result(candidates[0], checker, 0)
    for candidate in candidates[1:]:
        if best.fraction >= candidate.fraction:
            break  # the remaining candidates do not get farther even without contacts, or they take longer
        result = _poses_result(candidate, checker, 0)
        best = result if result.fraction > best.fraction else best
    return best


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


def _point_path(arm: Arm, q: Array) -> CubicPath:
    return CubicPath([q], np.zeros((1, len(q))), [0.0], arm.joint_names)


class _FollowedPoses(NamedTuple):
    """The joint curves along several routes, up to the end or to the point at which the move stops.

    The parameter is the length from the start; ``passed`` are those at which poses are reached, ``length`` is that of
    all routes, and ``last`` the last route that was followed, if any. The joints need ``seconds`` at full speed.
    """

    parts: list[CubicPath]
    last: FollowedRoute | None
    passed: list[float]
    length: float
    deviation: float
    rotation_deviation: float
    seconds: float

    @property
    def end(self) -> float:
        """The parameter at the end of the last part."""
        return self.parts[-1].domain[1]

    @property
    def fraction(self) -> float:
        """The fraction of the total length that was followed."""
        complete = self.last is None or self.last.status is LinearStatus.COMPLETE
        return 1.0 if complete else self.end / self.length


def _follow_poses(
    follower: RouteFollower, first: Array, poses: list[SE3], rounding: float, rotation_rounding: float
) -> _FollowedPoses:
    """Follow the routes from the pose at ``first`` (n,) through all poses, as far as possible."""
    targets = [follower.arm.forward_kinematics(first)]
    for pose in poses:
        targets.append(nearest_target(targets[-1], pose, follower.task))
    routes = routes_through(targets, rounding, rotation_rounding)
    parts: list[CubicPath] = []
    passed: list[float] = []
    last: FollowedRoute | None = None
    deviation, rotation_deviation, begin, here = 0.0, 0.0, 0.0, first
    for route in routes:
        if route.length == 0.0:
            passed.append(begin)
            continue
        last = follower.follow(route, here)
        if last.fraction > 0.0:
            path, length = last.path, route.length  # with the parameter begin + length s instead of s
            parts.append(CubicPath(path.q, path.tangents / length, begin + length * path.knots, path.joint_names))
            here = last.path.end
        deviation = max(deviation, last.deviation)
        rotation_deviation = max(rotation_deviation, last.rotation_deviation)
        passed.extend(begin + at * route.length for at in route.passes if at <= last.fraction)
        begin += route.length
        if last.status is not LinearStatus.COMPLETE:
            break
    total, velocity = sum(route.length for route in routes), follower.arm.limits.velocity
    speeds = np.where(np.isfinite(velocity), velocity, 1.0)
    seconds = float(sum((np.abs(np.diff(part.q, axis=0)) / speeds).max(axis=1).sum() for part in parts))
    parts = parts or [_point_path(follower.arm, first)]
    return _FollowedPoses(parts, last, passed, total, deviation, rotation_deviation, seconds)


def _poses_result(followed: _FollowedPoses, checker: CollisionChecker, offset: int) -> PosesPlanResult:
    """Certify the curve and report where the move stops; ``offset`` is the index of the pose at the start, or -1."""
    path, last = BlendedPath.join(*followed.parts), followed.last
    certificate = certify(path, checker)
    if certificate.free and (last is None or last.status is LinearStatus.COMPLETE):
        reached = len(followed.passed) + offset
        stops = f" with {len(path.corners)} stops" if path.corners else ""
        message = f"passed all {reached + 1} poses{stops}; {certificate.message}"
        deviations = followed.deviation, followed.rotation_deviation
        return PosesPlanResult(LinearStatus.COMPLETE, path, certificate, 1.0, reached, message, *deviations)
    # A contact on the curve comes before the point at which the route cannot be followed farther.
    if certificate.free and last is not None:
        status, end, reason, joints, stopped_by = last.status, followed.end, last.reason, last.joints, None
    else:
        (status, end), reason, joints, stopped_by = _stop(certificate), certificate.message, (), certificate
    reached = sum(at <= end for at in followed.passed) + offset
    fraction = end / followed.length if followed.length > 0.0 else 0.0
    location = f"after pose {reached}" if reached >= 0 else "before the first pose"
    message = f"stops at {_percent(fraction)} of the path, {location}: {reason}"
    return PosesPlanResult(status, None, stopped_by, fraction, reached, message, joints=joints)
