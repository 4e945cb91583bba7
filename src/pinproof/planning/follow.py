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
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pinproof._core import JointCurve, RouteDirection, RoutePiece
from pinproof._core import Route as CompiledRoute
from pinproof._core import RouteFollower as CompiledFollower
from pinproof.common.validation import require_positive
from pinproof.errors import InputError
from pinproof.ik import NEAR_LIMIT, IkTask, TaskName, make_task, track
from pinproof.model import Arm
from pinproof.motion import REVERSAL, CubicPath, corner_spacing
from pinproof.planning.plan_results import LinearStatus
from pinproof.spatial import SE3, Array, log6, matrix

Flags = npt.NDArray[np.bool_]
_Stop = tuple[LinearStatus, str, tuple[str, ...]]

# Weight of rotations (m/rad) in the length of a segment, about the size of a gripper. It affects the spacing of poses
# only.
LEVER = 0.25
# Length (m) below which a segment or a rounding is omitted: a tenth of the tolerance with which poses are reached.
MIN_LENGTH = 1e-7
# Two unit vectors are opposite if the norm of their sum is below this. The smallest rotation is then not unique, and
# the orientation of the target is used.
OPPOSITE = 1e-9
# Position (m) and orientation (rad) error at which a pose of the route counts as reached.
POSE_TOLERANCE = 1e-6
# Minimum number of pieces of a route: a spline through fewer poses is only a parabola.
MIN_PIECES = 3
# Excess over a joint limit (rad or m) that is attributed to floating-point errors.
ROUNDING = 1e-9
# Reduction of the joint limits (rad or m) in a second attempt; it exceeds the overshoot of a spline.
LIMIT_GUARD = 2e-3
# Joint step (rad or m) that is allowed in the test whether a pose can be reached by a jump.
ANY_STEP = 2 * np.pi


# -- routes ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PoseSegment:
    """The straight segment between poses, with its length (m), rotation included, and its directions (3,) per metre."""

    start: Array
    translation: Array
    rotation: Array
    length: float

    @classmethod
    def between(cls, first: SE3, last: SE3) -> PoseSegment:
        """The segment on which the orientation rotates about one fixed axis."""
        translation, rotation = last.translation - first.translation, log6(first.inverse() * last)[3:]
        length = float(np.hypot(np.linalg.norm(translation), LEVER * np.linalg.norm(rotation)))
        length = length if length > MIN_LENGTH else 0.0
        per = 1.0 / length if length > 0.0 else 0.0
        return cls(matrix(first), translation * per, rotation * per, length)

    def piece_count(self, translation_step: float, rotation_step: float) -> int:
        """The number of equal pieces that do not exceed the steps (m, rad)."""
        distance = self.length * float(np.linalg.norm(self.translation))
        angle = self.length * float(np.linalg.norm(self.rotation))
        return int(np.ceil(max(distance / translation_step, angle / rotation_step)))

    @property
    def direction(self) -> Array:
        """(6,) the direction as a unit vector, with the rotation weighted by :data:`LEVER`."""
        return np.concatenate([self.translation, LEVER * self.rotation])


@dataclass(frozen=True, eq=False)
class _RoutePiece:
    """The pose (c, C), the incoming and outgoing segments, and the coefficients (6,) of a and b (m); see the module."""

    pose: Array
    into: PoseSegment
    out: PoseSegment
    a: Array
    b: Array
    width: float

    def derivatives(self) -> tuple[float, float, float]:
        """Bounds of ``|p''|``, ``|w|`` and ``|w'|`` for position p and angular velocity w by the local parameter."""
        first, second = 5.0 * np.diff([self.a, self.b], axis=1), 20.0 * np.diff([self.a, self.b], 2, axis=1)
        speed, acceleration = np.abs(first).max(axis=1), np.abs(second).max(axis=1)
        translation = np.array([np.linalg.norm(self.into.translation), np.linalg.norm(self.out.translation)])
        rotation = np.array([np.linalg.norm(self.into.rotation), np.linalg.norm(self.out.rotation)])
        return (
            float(acceleration @ translation),
            float(speed @ rotation),
            float(acceleration @ rotation + speed[0] * rotation[0] * speed[1] * rotation[1]),
        )


class Route:
    """A twice differentiable sequence of segments and roundings; the parameter, 0 to 1, is proportional to the length.

    ``passes`` are the parameters at which the route passes poses: the middle of each rounding, and the end.
    """

    def __init__(self, pieces: list[_RoutePiece]) -> None:
        self._pieces = pieces
        ends = np.cumsum([piece.width for piece in pieces])
        self.length = float(ends[-1])
        share = ends / self.length if self.length > 0.0 else np.arange(1.0, len(pieces) + 1) / len(pieces)
        self.borders: Array = np.concatenate([[0.0], share[:-1], [1.0]])
        rounded = [k for k, piece in enumerate(pieces) if piece.into is not piece.out]
        self.passes = (*((self.borders[k] + self.borders[k + 1]) / 2 for k in rounded), 1.0)

    @classmethod
    def straight(cls, first: SE3, last: SE3) -> Route:
        """The route of a single segment."""
        segment = PoseSegment.between(first, last)
        return cls([_straight_piece(segment, 0.0, segment.length)])

    @cached_property
    def compiled(self) -> CompiledRoute:
        """The route as the compiled core uses it."""
        pieces = []
        ends = zip(self._pieces, self.borders[:-1], self.borders[1:], self._derivatives, strict=True)
        for piece, start, end, sizes in ends:
            into, out = (RouteDirection(each.translation, each.rotation) for each in (piece.into, piece.out))
            pieces.append(RoutePiece(piece.pose, into, out, piece.a, piece.b, start, end, *sizes))
        return CompiledRoute(pieces)

    def poses(self, s: Array) -> Array:
        """(N, 4, 4) ``base_from_tcp`` at parameters (N,)."""
        return np.asarray(self.compiled.poses(s))

    @cached_property
    def _derivatives(self) -> Array:
        """(k, 3) bounds of ``|p''|``, ``|w|`` and ``|w'|`` on each piece."""
        width = np.diff(self.borders)
        return np.array([piece.derivatives() for piece in self._pieces]) / np.stack([width**2, width, width**2], 1)

    def derivatives(self, knots: Array) -> Array:
        """(k, 3) bounds of ``|p''|``, ``|w|`` and ``|w'|`` between knots (k+1,), which must include all borders."""
        middle = 0.5 * (knots[1:] + knots[:-1])
        piece = np.clip(np.searchsorted(self.borders, middle, side="right") - 1, 0, len(self._pieces) - 1)
        result: Array = self._derivatives[piece]
        return result

    def knots(self, translation_step: float, rotation_step: float, min_pieces: int) -> Array:
        """The borders and parameters between them, such that no piece exceeds the steps (m, rad)."""
        parts = []
        for piece, low, high in zip(self._pieces, self.borders[:-1], self.borders[1:], strict=True):
            share = piece.width / max(piece.out.length, np.finfo(float).tiny)
            count = piece.out.piece_count(translation_step, rotation_step) * share
            count = max(count, min_pieces / len(self._pieces), 1)
            parts.append(np.linspace(low, high, int(np.ceil(count)), endpoint=False))
        return np.concatenate([*parts, [1.0]])


def routes_through(poses: list[SE3], rounding: float, rotation_rounding: float) -> list[Route]:
    """The routes through poses, divided where the tcp stops.

    A corner is rounded if its pose is missed by at most ``rounding`` (m) and ``rotation_rounding`` (rad). With 0, no
    corner is rounded. A corner at which the direction is reversed is never rounded.
    """
    segments = [PoseSegment.between(first, last) for first, last in pairwise(poses)]
    reach = np.zeros(len(poses))
    tiny = np.finfo(float).tiny
    for i, (into, out) in enumerate(pairwise(segments), 1):
        # The distance before and after a pose at which its rounding begins and ends.
        reversed_there = np.linalg.norm(into.direction + out.direction) < REVERSAL
        if min(into.length, out.length, rounding, rotation_rounding) <= 0.0 or reversed_there:
            continue
        share = (16.0 - 25.0 * float(corner_spacing(into.direction, out.direction))) / 32.0  # of it, in the middle
        distance = share * float(np.linalg.norm(out.translation - into.translation))
        angle = share * float(np.linalg.norm(into.rotation) + np.linalg.norm(out.rotation))
        allowed = rounding / max(distance, tiny), rotation_rounding / max(angle, tiny)
        longest = min(*allowed, into.length / 2, out.length / 2)
        reach[i] = longest if longest > MIN_LENGTH else 0.0
    routes: list[Route] = []
    pieces: list[_RoutePiece] = []
    for i, segment in enumerate(segments):
        low, high = reach[i], segment.length - reach[i + 1]
        if high - low > MIN_LENGTH or segment.length == 0.0:
            pieces.append(_straight_piece(segment, low, high))
        if reach[i + 1] > 0.0:
            out = segments[i + 1]
            h = reach[i + 1] * float(corner_spacing(segment.direction, out.direction))
            increasing = np.array([0.0, 0.0, 0.0, reach[i + 1] - 2 * h, reach[i + 1] - h, reach[i + 1]])
            pieces.append(_RoutePiece(out.start, segment, out, increasing[::-1], increasing, 5.0 * h))
        else:
            routes.append(Route(pieces))
            pieces = []
    return routes


def _straight_piece(segment: PoseSegment, low: float, high: float) -> _RoutePiece:
    return _RoutePiece(segment.start, segment, segment, np.zeros(6), np.linspace(low, high, 6), high - low)


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
    task: IkTask
    deviation: float
    rotation_deviation: float
    translation_step: float
    rotation_step: float
    max_joint_step: float
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
        """Follow a route from its first pose, at which the arm has the configuration ``first`` (n,).

        If a redundant arm moves along a joint limit, the solved poses are at the limit and the spline through them
        exceeds it. In this case, there is a second attempt with reduced limits.
        """
        lower, upper = self.arm.limits.lower, self.arm.limits.upper
        curve, stop = self._follow_within(lower, upper, route, first)
        if stop[0] is LinearStatus.LIMIT and self.arm.dof > self.mask.sum():
            guard = np.minimum(LIMIT_GUARD, (upper - lower) / 4)
            inside = np.minimum(lower + guard, first), np.maximum(upper - guard, first)
            second, why = self._follow_within(*inside, route, first)
            if second.knots[-1] > curve.knots[-1]:
                curve, stop = second, why
        path = CubicPath(curve.q, curve.slopes, curve.knots, self.arm.joint_names)
        return FollowedRoute(path, float(path.knots[-1]), curve.deviation, curve.rotation_deviation, *stop)

    def bound(self, path: CubicPath, route: Route) -> Array:
        """(k, 2) upper bounds of the deviation in metres and radians on each piece of a path.

        A bound is infinite if it would require too many samples. Path and route have the same parameter, and the knots
        of the path include all borders of the route up to its end.
        """
        knots, control = path.bezier()
        return np.asarray(
            self._compiled(self.arm.limits.lower, self.arm.limits.upper).deviations(
                route.compiled, knots, np.ascontiguousarray(control)
            )
        )

    def _compiled(self, lower: Array, upper: Array) -> CompiledFollower:
        """The follower that solves poses within the given limits (n,); the curve keeps the limits of :attr:`arm`."""
        limits = self.arm.limits
        return CompiledFollower(
            chain=self.arm.chain,
            lower=limits.lower,
            upper=limits.upper,
            tracked_lower=lower,
            tracked_upper=upper,
            task=make_task(self.task, POSE_TOLERANCE, POSE_TOLERANCE).compiled,
            max_joint_step=self.max_joint_step,
            deviation=self.deviation,
            rotation_deviation=self.rotation_deviation,
            only_complete=self.least >= 1.0,
        )

    def _follow_within(self, lower: Array, upper: Array, route: Route, first: Array) -> tuple[JointCurve, _Stop]:
        """Follow a route with poses solved within the given limits (n,)."""
        knots = route.knots(self.translation_step, self.rotation_step, MIN_PIECES)
        curve = self._compiled(lower, upper).follow(route.compiled, knots, np.ascontiguousarray(first))
        stop: _Stop = (LinearStatus.COMPLETE, "", ())
        if curve.stopped_by_pose:
            at_limit = np.minimum(curve.reached - lower, upper - curve.reached) <= NEAR_LIMIT
            if curve.knots[-1] < self.least:
                stop = LinearStatus.LIMIT if at_limit.any() else LinearStatus.UNREACHABLE, "", ()
            else:
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
        return curve, stop

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
