"""Joint curves along which the tcp follows a route, on one IK branch and without jumps.

The poses of a route are solved one after another and joined by a spline, whose deviation from the route is bounded at
every point. The loop is compiled (``src/core/planning/route_follower.h``, with the derivation of the bounds).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pinproof._core import RouteFollower as CompiledFollower
from pinproof.common.validation import require_positive
from pinproof.errors import InputError
from pinproof.ik import AT_LIMIT, IkTask, TaskName, make_task, track
from pinproof.model import Arm
from pinproof.motion import CubicPath
from pinproof.planning.result import LinearStatus
from pinproof.planning.route import Route
from pinproof.spatial import SE3, Array

Flags = npt.NDArray[np.bool_]
_Stop = tuple[LinearStatus, str, tuple[str, ...]]

OPPOSITE = 1e-9
"""Two unit vectors are opposite if the norm of their sum is below this. The smallest rotation is then not unique, and
the orientation of the target is used."""

POSE_TOLERANCE = 1e-6
"""Position (m) and orientation (rad) error at which a pose of the route counts as reached."""

MIN_PIECES = 3
"""Minimum number of pieces of a route: a spline through fewer poses is only a parabola."""

ROUNDING = 1e-9
"""Excess over a joint limit (rad or m) that is attributed to floating-point errors."""

LIMIT_GUARD = 2e-3
"""Reduction of the joint limits (rad or m) in a second attempt; it exceeds the overshoot of a spline."""

ANY_STEP = 2 * np.pi
"""Joint step (rad or m) that is allowed in the test whether a pose can be reached by a jump."""


def line_task(task: TaskName | IkTask | Sequence[bool]) -> IkTask:
    """The task of a linear move, from its name or its coordinates.

    Raises
    ------
    UnknownNameError
        If the name is unknown.
    InputError
        If the task constrains only part of the position, or exactly one rotation: the line is then not defined.
    """
    constrained = make_task(task, 1.0, 1.0).mask > 0.0
    if constrained[:3].sum() not in (0, 3) or constrained[3:].sum() == 1:
        raise InputError(
            "a linear move must constrain all or none of x, y and z, and none, two or all of the rotations; its task "
            f"is {task}"
        )
    return IkTask(*constrained.tolist())


def nearest_target(here: SE3, target: SE3, task: IkTask) -> SE3:
    """The target pose with the coordinates that are not constrained by the task chosen for the least motion."""
    constrained = np.array([task.rx, task.ry, task.rz])
    position = target.translation if task.x else here.translation
    if constrained.all():
        return SE3(target.rotation, position)
    if not constrained.any():
        return SE3(here.rotation, position)
    axis = int(np.flatnonzero(~constrained)[0])
    here_axis, target_axis = here.rotation[:, axis], target.rotation[:, axis]
    if np.linalg.norm(here_axis + target_axis) < OPPOSITE:
        return SE3(target.rotation, position)
    # The smallest rotation that maps one axis to the other.
    v, cosine = np.cross(here_axis, target_axis), float(here_axis @ target_axis)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    smallest = np.eye(3) + cross + cross @ cross / (1.0 + cosine)
    return SE3(smallest @ here.rotation, position)


@dataclass(frozen=True, eq=False)
class FollowedRoute:
    """The joint curve along a route, up to its end or to the point at which it stops.

    Parameters
    ----------
    path
        The curve over [0, fraction] of the parameter of the route.
    fraction
        The parameter of the route at the end of the curve, 0 to 1.
    deviation, rotation_deviation
        Upper bounds (m, rad) of the deviation of the tcp from the route.
    status, reason, joints
        COMPLETE, or why the curve stops; the joints that are at their limits or would have to jump.
    """

    path: CubicPath
    fraction: float
    deviation: float
    rotation_deviation: float
    status: LinearStatus = LinearStatus.COMPLETE
    reason: str = ""
    joints: tuple[str, ...] = field(default=())


@dataclass(frozen=True, kw_only=True)
class RouteFollower:
    """The settings for following routes; see :func:`pinproof.plan_linear`.

    Raises
    ------
    InputError
        If a setting is not above 0.
    """

    arm: Arm
    task: IkTask
    deviation: float
    rotation_deviation: float
    translation_step: float
    rotation_step: float
    max_joint_step: float

    def __post_init__(self) -> None:
        for name in ("deviation", "rotation_deviation", "translation_step", "rotation_step", "max_joint_step"):
            if getattr(self, name) != math.inf:  # infinite: without limit
                require_positive(name, getattr(self, name))

    @property
    def mask(self) -> Array:
        """(6,) 1 for each coordinate that the task constrains, else 0."""
        task = self.task
        return np.array([task.x, task.y, task.z, task.rx, task.ry, task.rz], dtype=float)

    def follow(self, route: Route, first: Array) -> FollowedRoute:
        """Follow a route from its first pose, at which the arm has the configuration ``first`` (n,).

        If a redundant arm moves along a joint limit, the solved poses are at the limit and the spline through them
        exceeds it. In this case, there is a second attempt with reduced limits.
        """
        followed = self._follow_within(self.arm, route, first)
        if followed.status is not LinearStatus.LIMIT or self.arm.dof <= self.mask.sum():
            return followed
        limits = self.arm.limits
        guard = np.minimum(LIMIT_GUARD, (limits.upper - limits.lower) / 4)
        inside = replace(
            limits, lower=np.minimum(limits.lower + guard, first), upper=np.maximum(limits.upper - guard, first)
        )
        second = self._follow_within(self.arm.with_limits(inside), route, first)
        return second if second.fraction > followed.fraction else followed

    def bound(self, path: CubicPath, route: Route) -> Array:
        """(k, 2) upper bounds of the deviation in metres and radians on each piece of a path.

        A bound is infinite if it would require too many samples. Path and route have the same parameter, and the knots
        of the path include all borders of the route up to its end.
        """
        knots, control = path.bezier()
        return np.asarray(self._compiled(self.arm).deviations(route.compiled, knots, np.ascontiguousarray(control)))

    def _compiled(self, arm: Arm) -> CompiledFollower:
        """The follower that solves poses within the limits of ``arm``; the curve keeps the limits of :attr:`arm`."""
        limits, tracked = self.arm.limits, arm.limits
        return CompiledFollower(
            chain=arm.chain,
            lower=limits.lower.tolist(),
            upper=limits.upper.tolist(),
            tracked_lower=tracked.lower.tolist(),
            tracked_upper=tracked.upper.tolist(),
            task=make_task(self.task, POSE_TOLERANCE, POSE_TOLERANCE).compiled,
            max_joint_step=self.max_joint_step,
            deviation=self.deviation,
            rotation_deviation=self.rotation_deviation,
        )

    def _follow_within(self, arm: Arm, route: Route, first: Array) -> FollowedRoute:
        """Follow a route with poses solved within the limits of ``arm``."""
        knots = route.knots(self.translation_step, self.rotation_step, MIN_PIECES)
        curve = self._compiled(arm).follow(route.compiled, knots, np.ascontiguousarray(first))
        stop: _Stop = (LinearStatus.COMPLETE, "", ())
        if curve.stopped_by_pose:
            at_limit = np.minimum(curve.reached - arm.limits.lower, arm.limits.upper - curve.reached) <= AT_LIMIT
            stop = self._reason(route, curve.at, float(np.diff(knots).max()), curve.before, at_limit)
        elif curve.stopped_by_deviation:  # on a piece of the minimum length
            joint = int(curve.outside.argmax())
            if curve.outside[joint] > ROUNDING:
                name = self.arm.joint_names[joint]
                excess = f"{name} may exceed its limits by {curve.outside[joint]:.2g} between the solved poses"
                stop = LinearStatus.LIMIT, excess, (name,)
            else:
                by = f"{curve.deviation_there * 1e3:.2g} mm and {curve.rotation_deviation_there:.2g} rad"
                stop = LinearStatus.JUMP, f"the tcp may deviate by {by} between the solved poses", ()
        path = CubicPath(curve.q, curve.slopes, curve.knots, self.arm.joint_names)
        return FollowedRoute(path, float(path.knots[-1]), curve.deviation, curve.rotation_deviation, *stop)

    def _reason(self, route: Route, s: float, spacing: float, here: Array, at_limit: Flags) -> _Stop:
        """Why the route cannot be followed beyond ``here`` (n,), at the parameter s.

        ``at_limit`` (n,) are the joints at their limits. The reasons are distinguished by solving a later pose with
        arbitrary joint steps.
        """
        arm = self.arm
        ahead = track(
            arm,
            route.poses(np.array([min(s + spacing, 1.0)])),
            here,
            dt=1.0,
            velocity=ANY_STEP,
            task=self.task,
            position_tolerance=POSE_TOLERANCE,
            orientation_tolerance=POSE_TOLERANCE,
        )
        step = np.abs(ahead.q[0] - here)
        short = (
            f"{ahead.position_error[0] * 1e3:.1f} mm and {ahead.orientation_error[0]:.2g} rad short of the next pose"
        )
        jacobian = arm.jacobian(here, reference="LOCAL")[self.mask > 0.0]
        singular = f"smallest singular value {np.linalg.svd(jacobian, compute_uv=False)[-1]:.2g}"
        if at_limit.any():
            names = tuple(np.array(arm.joint_names)[at_limit].tolist())
            detail = "the line continues beyond it" if ahead.ok else short
            return LinearStatus.LIMIT, f"{', '.join(names)} at the limit, {detail}", names
        if ahead.ok:
            name = arm.joint_names[int(step.argmax())]
            return LinearStatus.JUMP, f"{name} would jump by {step.max():.2f}, {singular}", (name,)
        return LinearStatus.UNREACHABLE, f"{short}, {singular}", ()
