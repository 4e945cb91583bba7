"""Joint curves along which the tcp follows a route, on one IK branch and without jumps.

The poses of a route are solved one after another and joined by a spline. The deviation of the tcp from the route is
bounded at every point of the spline, from samples and second derivatives:

Between two samples at a distance h, a twice differentiable vector D differs from the linear interpolation of its values
by at most h^2 / 8 sup |D''|. Hence |D| is at most the larger of the two values plus this term. D is

* the difference of the positions, D = p - p_route, with |D''| <= |p''| + |p_route''|;
* the difference of the orientations as matrices (Frobenius norm), or of one axis. An angle theta between two rotations
  corresponds to a distance of 2 sqrt(2) sin(theta / 2), between two unit vectors to 2 sin(theta / 2).

For a chain of joints with values theta_k(s), from the base outward k = 1..m, let r_k bound the distance of the tcp from
the origin of joint k; for a prismatic joint, r_k is replaced by 1. Then

    |p''| <= sum_k r_k |theta_k''| + sum_k r_k |theta_k'| (|theta_k'| + 2 sum_{i<k} |theta_i'|)
    |w|   <= sum_k |theta_k'|,    |w'| <= sum_k |theta_k''| + sum_{i<k} |theta_i'| |theta_k'|

where the sums over i, and all of w, are over revolute joints: d p / d theta_k = z_k x (p - o_k) has at most the length
r_k, and a rotation of an inner joint i rotates this vector. With R' = [w] R and R'' = ([w'] + [w]^2) R, the Frobenius
norm of R'' is at most sqrt(2) (|w'| + |w|^2), and the second derivative of one axis at most |w'| + |w|^2.

Source of the derivatives of the chain: J. Craig, "Introduction to Robotics" (2005), sections 5.6 and 5.7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.ik import IkTask, TrackResult, track
from pinproof.ik.task import TaskName, make_task
from pinproof.model import Arm
from pinproof.motion import CubicPath, bezier
from pinproof.planning.result import LinearStatus
from pinproof.planning.route import Route
from pinproof.spatial import SE3

__all__ = ["DeviationBound", "FollowedRoute", "RouteFollower", "line_task", "nearest_target"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
_Stop = tuple[LinearStatus, str, tuple[str, ...]]

OPPOSITE = 1e-9
"""Two unit vectors are opposite if the norm of their sum is below this. The smallest rotation is then not unique, and
the orientation of the target is used."""

POSE_TOLERANCE = 1e-6
"""Position (m) and orientation (rad) error at which a pose of the route counts as reached."""

MIN_PIECES = 3
"""Minimum number of pieces of a route: a spline through fewer poses is only a parabola."""

MAX_ROUNDS = 16
"""Maximum number of rounds in which the spacing of the poses is reduced."""

MIN_SPACING = 2.0**-6
"""Fraction of the initial spacing below which no piece is subdivided. A faster change counts as a jump."""

ROUNDING = 1e-9
"""Excess over a joint limit (rad or m) that is attributed to floating-point errors."""

END_PARTS = 8
"""Number of parts into which the piece is divided in which the route becomes unreachable, to locate the end."""

LIMIT_GUARD = 2e-3
"""Reduction of the joint limits (rad or m) in a second attempt; it exceeds the overshoot of a spline."""

ANY_STEP = 2 * np.pi
"""Joint step (rad or m) that is allowed in the test whether a pose can be reached by a jump."""

SAMPLING_SHARE = 0.1
"""Fraction of the allowed deviation that the term h^2 / 8 sup |D''| may take. It determines the number of samples."""

MIN_SAMPLES, MAX_SAMPLES = 3, 4096
"""Minimum and maximum number of sampling steps on a piece. A piece that requires more must be subdivided."""


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
    return SE3(_smallest_rotation(here_axis, target_axis) @ here.rotation, position)


def _smallest_rotation(a: Array, b: Array) -> Array:
    """The rotation (3, 3) by the smallest angle that maps the unit vector a to b, where b is not -a."""
    v, cosine = np.cross(a, b), float(a @ b)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


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
    """The settings with which routes are followed; see :func:`pinproof.plan_linear`.

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
            if not getattr(self, name) > 0:
                raise InputError(f"{name} = {getattr(self, name)}; it must be above 0")

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

    def _follow_within(self, arm: Arm, route: Route, first: Array) -> FollowedRoute:
        """Follow a route; the poses are solved within the limits of ``arm``, the curve keeps those of :attr:`arm`."""
        bound = DeviationBound(self.arm, self.mask, self.deviation, self.rotation_deviation)
        knots = route.knots(self.translation_step, self.rotation_step, MIN_PIECES)
        spacing = float(np.diff(knots).max())
        stop: _Stop = (LinearStatus.COMPLETE, "", ())
        rounds = 0
        while len(knots) > 1:
            rounds += 1
            wide = (np.diff(knots) > MIN_SPACING * spacing) & (rounds <= MAX_ROUNDS)
            tracked = self._track(arm, route, knots[1:], first)
            if not tracked.ok:
                at = int(np.flatnonzero(~tracked.reached)[0])
                if wide[at] and tracked.at_speed_limit[at].any():
                    knots = _subdivide(knots, np.logical_and(self._at_step_limit(tracked, at), wide))
                elif wide[at]:  # locate the end of the reachable part
                    knots = _subdivide(knots, np.arange(len(wide)) == at, END_PARTS)
                else:
                    here = first if at == 0 else tracked.q[at - 1]
                    stop = self._reason(route, float(knots[at]), spacing, here, tracked.at_position_limit[at])
                    knots = knots[: at + 1]
                continue
            path = CubicPath.through(np.vstack([first, tracked.q]), self.arm.joint_names, knots=knots)
            off, outside = bound.bound(path, route), self._outside(path)
            bad: Flags = np.asarray(
                (off > (self.deviation, self.rotation_deviation)).any(axis=1) | (outside > ROUNDING).any(axis=1)
            )
            if not bad.any():
                metres, radians = off.max(axis=0).tolist()
                return FollowedRoute(path, float(knots[-1]), metres, radians, *stop)
            at = int(np.flatnonzero(bad)[0])
            if wide[at]:
                knots = _subdivide(knots, np.logical_and(bad, wide))
            else:
                stop = self._deviation_stop(off[at], outside[at])
                knots = knots[: at + 1]
        point = CubicPath([first], np.zeros((1, len(first))), [0.0], self.arm.joint_names)
        return FollowedRoute(point, 0.0, 0.0, 0.0, *stop)

    def _track(self, arm: Arm, route: Route, s: Array, first: Array, step: float | None = None) -> TrackResult:
        """Solve the poses at s (N,), each from the previous one, with a maximum joint step between them."""
        return track(
            arm,
            route.poses(s),
            first,
            dt=1.0,
            velocity=self.max_joint_step if step is None else step,
            task=self.task,
            position_tolerance=POSE_TOLERANCE,
            orientation_tolerance=POSE_TOLERANCE,
        )

    @staticmethod
    def _at_step_limit(tracked: TrackResult, first: int) -> Flags:
        """(N,) the pieces, beginning with ``first``, in which a joint moved by the maximum step."""
        fast: Flags = np.array(tracked.at_speed_limit.any(axis=1))
        fast[:first] = False
        return fast

    def _outside(self, path: CubicPath) -> Array:
        """(k, n) upper bounds of the excess over the joint limits on each piece, from the control points."""
        _, control = path.bezier()
        limits = self.arm.limits
        return np.maximum(limits.lower - control.min(axis=1), control.max(axis=1) - limits.upper)

    def _reason(self, route: Route, s: float, spacing: float, here: Array, at_limit: Flags) -> _Stop:
        """Why the route cannot be followed beyond ``here`` (n,), at the parameter s.

        ``at_limit`` (n,) are the joints at their limits. The reasons are distinguished by solving a later pose with
        arbitrary joint steps.
        """
        arm = self.arm
        ahead = self._track(arm, route, np.array([min(s + spacing, 1.0)]), here, ANY_STEP)
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

    def _deviation_stop(self, off: Array, outside: Array) -> _Stop:
        """Why the curve is not accepted on a piece of the minimum length."""
        joint = int(outside.argmax())
        if outside[joint] > ROUNDING:
            name = self.arm.joint_names[joint]
            reason = f"{name} may exceed its limits by {outside[joint]:.2g} between the solved poses"
            return LinearStatus.LIMIT, reason, (name,)
        reason = f"the tcp may deviate by {off[0] * 1e3:.2g} mm and {off[1]:.2g} rad between the solved poses"
        return LinearStatus.JUMP, reason, ()


def _subdivide(knots: Array, which: Flags, parts: int = 2) -> Array:
    """The knots (k+1,) with the selected pieces (k,) divided into equal parts."""
    inner = knots[:-1][which][:, None] + np.diff(knots)[which][:, None] * (np.arange(1, parts) / parts)
    return np.sort(np.concatenate([knots, inner.ravel()]))


class DeviationBound:
    """Upper bounds of the deviation of the tcp from a route; see the module for the derivation.

    Parameters
    ----------
    arm
        The arm.
    mask
        (6,) 1 for each coordinate that the task constrains. Of the rotation, these are all, none, or all but one.
    deviation, rotation_deviation
        The allowed deviation in metres and radians.
    """

    def __init__(self, arm: Arm, mask: Array, deviation: float, rotation_deviation: float) -> None:
        self._arm = arm
        self._allowed = deviation, rotation_deviation
        self._position = bool(mask[:3].any())
        turns = np.flatnonzero(mask[3:] > 0)
        free = np.flatnonzero(mask[3:] == 0)
        self._columns = np.arange(3) if len(turns) == 3 else free if len(turns) == 2 else np.empty(0, dtype=int)
        self._norm = math.sqrt(2.0) if len(turns) == 3 else 1.0

    def bound(self, path: CubicPath, route: Route) -> Array:
        """(k, 2) upper bounds of the deviation in metres and radians on each piece.

        A bound is infinite if it would require too many samples. Path and route have the same parameter, and the knots
        of the path include all borders of the route up to its end.
        """
        knots, control = path.bezier()
        width = np.diff(knots)
        linear, angular = self._second_derivatives(knots, control, route)
        metres, radians = self._allowed
        chord = 2.0 * self._norm * math.sin(min(radians, math.pi) / 2.0)
        steps = np.zeros(len(width))
        if self._position:
            steps = np.maximum(steps, width * np.sqrt(linear / (8.0 * SAMPLING_SHARE * metres)))
        if len(self._columns):
            steps = np.maximum(steps, width * np.sqrt(angular / (8.0 * SAMPLING_SHARE * chord)))
        skipped = ~(steps <= MAX_SAMPLES)
        counts = np.where(skipped, MIN_SAMPLES, np.clip(np.ceil(steps), MIN_SAMPLES, MAX_SAMPLES)).astype(int)
        first = np.concatenate([[0], np.cumsum(counts)])
        piece = np.repeat(np.arange(len(width)), counts)
        inside = (np.arange(first[-1]) - first[:-1][piece]) / counts[piece]
        s = np.minimum(np.append(knots[piece] + width[piece] * inside, knots[-1]), knots[-1])
        differences = np.stack(self._differences(path(s), route.poses(s)), axis=1)
        worst = np.maximum(np.maximum.reduceat(differences[:-1], first[:-1]), differences[first[1:]])
        remainder = (width / counts) ** 2 / 8.0
        off = np.stack([worst[:, 0] + remainder * linear, worst[:, 1] + remainder * angular], axis=1)
        off[:, 1] = 2.0 * np.arcsin(np.minimum(off[:, 1] / (2.0 * self._norm), 1.0))
        off[:, 0] *= self._position
        off[:, 1] *= bool(len(self._columns))
        off[skipped] = np.inf
        return off

    def _differences(self, q: Array, wanted: Array) -> tuple[Array, Array]:
        """|D| (N,) of position and of orientation at the configurations q (N, n)."""
        gap = self._arm.forward_kinematics_batch(q)[:, :3] - wanted[:, :3]
        rotation = gap[:, :, self._columns]
        return np.linalg.norm(gap[:, :, 3], axis=1), np.sqrt(np.einsum("nij,nij->n", rotation, rotation))

    def _second_derivatives(self, knots: Array, control: Array, route: Route) -> tuple[Array, Array]:
        """(k,) bounds of |D''| on each piece, for the position and for the orientation."""
        chain = self._arm.chain
        leader, scale, turns = chain.index, np.abs(chain.multiplier), ~chain.prismatic
        first = bezier.derivative(knots, control)
        rate = np.abs(first).max(axis=1)[:, leader] * scale
        second = np.abs(bezier.derivative(knots, first)).max(axis=1)[:, leader] * scale
        turning = rate * turns
        inner = np.cumsum(turning, axis=1) - turning
        lever = self._levers(control)
        linear = (lever * second + lever * rate * (turning + 2.0 * inner)).sum(axis=1)
        rate_sum = turning.sum(axis=1)
        change = (second * turns + turning * inner).sum(axis=1)
        of_route = route.derivatives(knots)
        rotation = change + rate_sum**2 + of_route[:, 2] + of_route[:, 1] ** 2
        return linear + of_route[:, 0], self._norm * rotation

    def _levers(self, control: Array) -> Array:
        """(m,) how far the tcp is at most from the origin of each joint, 1 for a prismatic joint."""
        chain = self._arm.chain
        reached = np.abs(control[:, :, chain.index]).max(axis=(0, 1))
        shift = (np.abs(chain.multiplier) * reached + np.abs(chain.offset)) * chain.prismatic
        behind = np.vstack([chain.before[1:, :3, 3], chain.tool[:3, 3]])
        links = np.linalg.norm(behind, axis=1) + np.append(shift[1:], 0.0)
        lever = np.cumsum(links[::-1])[::-1]
        return np.where(chain.prismatic, 1.0, lever)
