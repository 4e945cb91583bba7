"""Routes of the tcp in space, and joint curves along which the tcp follows them on one IK branch without jumps.

A route consists of straight segments between poses, with optionally rounded corners. On every piece, with a local
parameter u from 0 to 1, the pose is

    position     c - a(u) t + b(u) t'
    orientation  C exp(-a(u) w) exp(b(u) w')

where (c, C) is a pose, (t, w) the direction of the incoming and (t', w') of the outgoing segment, each a
translation in the base frame and a rotation vector in the tcp frame. On a segment, a = 0 and b is linear. In the
rounding of a corner, a decreases from the reach d to 0 and b increases from 0 to d, with the Bernstein coefficients of
:func:`pinproof.motion.round_corner`, so that segments and roundings together are twice differentiable.

The poses of a route are solved one after another and joined by a spline, whose deviation from the route is bounded at
every point. The loop is compiled (``src/core/planning/route_follower.h``, with the derivation of the bounds).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof._core import Route as CompiledRoute
from pinproof._core import RouteFollower as CompiledFollower
from pinproof._core import RoutePiece, RouteSegment
from pinproof.common.validation import require_positive
from pinproof.errors import InputError
from pinproof.ik import NEAR_LIMIT, IkTask, TaskName, make_task, orientation_tolerance_of, track
from pinproof.model import Arm
from pinproof.motion import REVERSAL, CubicPath, corner_spacing
from pinproof.planning.plan_results import LinearStatus
from pinproof.spatial import SE3, Array, matrix

Flags = npt.NDArray[np.bool_]
_Stop = tuple[LinearStatus, str, tuple[str, ...]]

# Length (m) below which a segment or a rounding is omitted: a tenth of the tolerance with which poses are reached.
MIN_LENGTH: float = RouteSegment.MIN_LENGTH
# Two unit vectors are opposite if the norm of their sum is below this. The smallest rotation is then not unique, and
# the orientation of the target is used.
OPPOSITE = 1e-9
# Position (m) and orientation (rad) error at which a pose of the route counts as reached; for arms of fewer than six
# joints, the orientation has the tolerance of their IK.
POSE_TOLERANCE = 1e-6
# Excess over a joint limit (rad or m) that is attributed to floating-point errors.
ROUNDING = 1e-9
# Joint step (rad or m) that is allowed in the test whether a pose can be reached by a jump.
ANY_STEP = 2 * np.pi


# -- routes ------------------------------------------------------------------------------------------------------------


class Route:
    """A twice differentiable sequence of segments and roundings; the parameter, 0 to 1, is proportional to the length.

    ``passes`` are the parameters at which the route passes poses: the middle of each rounding, and the end.
    """

    def __init__(self, pieces: list[RoutePiece], rounded: Sequence[int] = ()) -> None:
        self.compiled = CompiledRoute(pieces)
        """The route as the compiled core uses it."""
        self.length = sum(piece.width for piece in pieces)
        made = self.compiled.pieces
        self.passes = (*((made[k].start + made[k].end) / 2 for k in rounded), 1.0)

    @classmethod
    def straight(cls, first: SE3, last: SE3) -> Route:
        """The route of a single segment."""
        start, end = matrix(first), matrix(last)
        segment = RouteSegment.between(start, end)
        return cls([_straight_piece(start, segment, 0.0, segment.length)])

    def poses(self, s: Array) -> Array:
        """(N, 4, 4) ``base_from_tcp`` at parameters (N,)."""
        return np.asarray(self.compiled.poses(s))


def routes_through(poses: list[SE3], rounding: float, rotation_rounding: float) -> list[Route]:
    """The routes through poses, divided where the tcp stops.

    A corner is rounded if its pose is missed by at most ``rounding`` (m) and ``rotation_rounding`` (rad). With 0, no
    corner is rounded. A corner at which the direction is reversed is never rounded.
    """
    starts = [matrix(pose) for pose in poses]
    segments = [RouteSegment.between(first, last) for first, last in pairwise(starts)]
    directions = [np.concatenate([each.translation, RouteSegment.LEVER * each.rotation]) for each in segments]
    reach = np.zeros(len(poses))
    tiny = np.finfo(float).tiny
    for i, (into, out) in enumerate(pairwise(segments), 1):
        # The distance before and after a pose at which its rounding begins and ends.
        reversed_there = np.linalg.norm(directions[i - 1] + directions[i]) < REVERSAL
        if min(into.length, out.length, rounding, rotation_rounding) <= 0.0 or reversed_there:
            continue
        share = (16.0 - 25.0 * float(corner_spacing(directions[i - 1], directions[i]))) / 32.0  # of it, in the middle
        distance = share * float(np.linalg.norm(out.translation - into.translation))
        angle = share * float(np.linalg.norm(into.rotation) + np.linalg.norm(out.rotation))
        allowed = rounding / max(distance, tiny), rotation_rounding / max(angle, tiny)
        longest = min(*allowed, into.length / 2, out.length / 2)
        reach[i] = longest if longest > MIN_LENGTH else 0.0
    routes: list[Route] = []
    pieces: list[RoutePiece] = []
    rounded: list[int] = []
    for i, segment in enumerate(segments):
        low, high = reach[i], segment.length - reach[i + 1]
        if high - low > MIN_LENGTH or segment.length == 0.0:
            pieces.append(_straight_piece(starts[i], segment, low, high))
        if reach[i + 1] > 0.0:
            h = reach[i + 1] * float(corner_spacing(directions[i], directions[i + 1]))
            increasing = np.array([0.0, 0.0, 0.0, reach[i + 1] - 2 * h, reach[i + 1] - h, reach[i + 1]])
            rounded.append(len(pieces))
            pieces.append(RoutePiece(starts[i + 1], segment, segments[i + 1], increasing[::-1], increasing, 5.0 * h))
        else:
            routes.append(Route(pieces, rounded))
            pieces, rounded = [], []
    return routes


def _straight_piece(start: Array, segment: RouteSegment, low: float, high: float) -> RoutePiece:
    return RoutePiece(start, segment, segment, np.zeros(6), np.linspace(low, high, 6), high - low)


# -- following a route -------------------------------------------------------------------------------------------------


def line_task(task: TaskName | IkTask | Sequence[bool]) -> IkTask:
    """The task of a linear move, from its name or its coordinates; InputError if it does not define the line."""
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
    """The joint curve over [0, fraction] of the parameter of a route; see :class:`LinearPlanResult` for the fields."""

    path: CubicPath
    fraction: float
    deviation: float
    rotation_deviation: float
    status: LinearStatus = LinearStatus.COMPLETE
    reason: str = ""
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RouteFollower:
    """The settings for following routes; see :func:`pinproof.plan_linear`.

    Of a route that ends at a pose before the parameter ``least``, the reason is not computed, and with 1 not the curve.

    Raises
    ------
    InputError
        If a setting is not above 0.
    """

    arm: Arm
    task: IkTask = field(default_factory=IkTask)
    deviation: float = 1e-3
    rotation_deviation: float = 1e-2
    translation_step: float = 0.05
    rotation_step: float = 0.2
    max_joint_step: float = 0.3
    least: float = 0.0

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
        """Follow a route from its first pose, at which the arm has the configuration ``first`` (n,)."""
        curve = self._compiled.follow(route.compiled, np.ascontiguousarray(first))
        path = CubicPath(curve.q, curve.slopes, curve.knots, self.arm.joint_names)
        stop: _Stop = (LinearStatus.COMPLETE, "", ())
        if curve.stopped_by_pose:
            at_limit = np.minimum(curve.reached - curve.lower, curve.upper - curve.reached) <= NEAR_LIMIT
            if curve.knots[-1] < self.least:
                stop = LinearStatus.LIMIT if at_limit.any() else LinearStatus.UNREACHABLE, "", ()
            else:
                stop = self._reason(route, curve.at, curve.spacing, curve.before, at_limit)
        elif curve.stopped_by_deviation:  # on a piece of the minimum length
            joint = int(curve.outside.argmax())
            if curve.outside[joint] > ROUNDING:
                name = self.arm.joint_names[joint]
                excess = f"{name} may exceed its limits by {curve.outside[joint]:.2g} between the solved poses"
                stop = LinearStatus.LIMIT, excess, (name,)
            else:
                by = f"{curve.deviation_there * 1e3:.2g} mm and {curve.rotation_deviation_there:.2g} rad"
                stop = LinearStatus.JUMP, f"the tcp may deviate by {by} between the solved poses", ()
        return FollowedRoute(path, float(path.knots[-1]), curve.deviation, curve.rotation_deviation, *stop)

    def ends_of_lines(self, starts: Array, targets: Array) -> Array:
        """(N, n) the ends of straight lines from configurations (N, n) to ``base_from_tcp`` (N, 4, 4).

        NaN for lines that cannot be followed to their end. Contacts are not checked.
        """
        return np.asarray(self._compiled.ends_of_lines(np.ascontiguousarray(starts), np.ascontiguousarray(targets)))

    def bound(self, path: CubicPath, route: Route) -> Array:
        """(k, 2) upper bounds of the deviation in metres and radians on each piece of a path.

        A bound is infinite if it would require too many samples. Path and route have the same parameter, and the knots
        of the path include all borders of the route up to its end.
        """
        knots, control = path.bezier()
        return np.asarray(self._compiled.deviations(route.compiled, knots, np.ascontiguousarray(control)))

    @property
    def _tolerances(self) -> tuple[float, float]:
        return POSE_TOLERANCE, orientation_tolerance_of(self.arm, None, usual=POSE_TOLERANCE)

    @cached_property
    def _compiled(self) -> CompiledFollower:
        limits = self.arm.limits
        return CompiledFollower(
            chain=self.arm.chain,
            lower=limits.lower,
            upper=limits.upper,
            task=make_task(self.task, *self._tolerances).compiled,
            max_joint_step=self.max_joint_step,
            translation_step=self.translation_step,
            rotation_step=self.rotation_step,
            deviation=self.deviation,
            rotation_deviation=self.rotation_deviation,
            only_complete=self.least >= 1.0,
        )

    def _reason(self, route: Route, s: float, spacing: float, here: Array, at_limit: Flags) -> _Stop:
        """Why the route cannot be followed beyond ``here`` (n,), at the parameter s, with these joints at limits."""
        arm = self.arm
        # The reasons are distinguished by solving a later pose with arbitrary joint steps.
        ahead = track(
            arm,
            route.poses(np.array([min(s + spacing, 1.0)])),
            here,
            dt=1.0,
            velocity=ANY_STEP,
            task=self.task,
            position_tolerance=self._tolerances[0],
            orientation_tolerance=self._tolerances[1],
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
