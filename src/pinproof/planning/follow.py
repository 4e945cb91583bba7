"""What a straight move asks of the tcp, and where it is led to when part of the target's orientation is free.

How far the tcp may be off its route anywhere on a joint curve: a bound, from samples and second derivatives.

Between two samples that are h apart, a twice differentiable vector D differs from the straight line through its values
there by at most h^2 / 8 sup |D''|, so |D| is at most the larger of the two values plus that. D is taken as

* the difference of the positions, D = p - p_route, with |D''| <= |p''| + |p_route''|;
* the difference of the orientations as matrices (Frobenius norm), or of one axis; an angle of theta between two
  rotations is a distance of 2 sqrt(2) sin(theta / 2), between two unit vectors one of 2 sin(theta / 2).

For a chain of joints with values theta_k(s), outward k = 1..m, let r_k bound the distance of the tcp from the origin of
joint k (1 in its place for a joint that slides). Then

    |p''| <= sum_k r_k |theta_k''| + sum_k r_k |theta_k'| (|theta_k'| + 2 sum_{i<k} |theta_i'|)
    |w|   <= sum_k |theta_k'|,    |w'| <= sum_k |theta_k''| + sum_{i<k} |theta_i'| |theta_k'|

where the sums over i, and all of w, are over joints that turn: since d p / d theta_k = z_k x (p - o_k) is at most r_k
long, and turning an inner joint i turns it as a whole. With R' = [w] R and R'' = ([w'] + [w]^2) R the Frobenius norm of
R'' is at most sqrt(2) (|w'| + |w|^2), and the second derivative of one axis at most |w'| + |w|^2.

Source of the chain's derivatives: J. Craig, "Introduction to Robotics" (2005), sections 5.6 and 5.7.

Configurations that take the tcp along a route, on one branch and without a jump, as a smooth curve.
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

__all__ = ["Following", "Stray", "Walked", "aimed", "line_task"]

Array = npt.NDArray[np.float64]

OPPOSITE = 1e-9
"""Of two unit vectors whose sum is shorter, no shortest turn leads from one to the other: the target's own is taken."""


def line_task(task: TaskName | IkTask | Sequence[bool]) -> IkTask:
    """A task by its name or coordinates.

    Raises
    ------
    UnknownNameError
        For an unknown name.
    InputError
        If it asks for part of the position, or for one turn alone: no line leads there.
    """
    asked = make_task(task, 1.0, 1.0).mask > 0.0
    if asked[:3].sum() not in (0, 3) or asked[3:].sum() == 1:
        raise InputError(
            "a straight move asks for the whole position or none of it, and leaves free all turning, one turn or none; "
            f"it was asked for {task}"
        )
    return IkTask(*asked.tolist())


def aimed(here: SE3, target: SE3, task: IkTask) -> SE3:
    """The target, but in what the task leaves free such that it is reached from ``here`` with the least motion."""
    asked = np.array([task.rx, task.ry, task.rz])
    place = target.translation if task.x else here.translation
    if asked.all():
        return SE3(target.rotation, place)
    if not asked.any():
        return SE3(here.rotation, place)
    axis = int(np.flatnonzero(~asked)[0])
    before, behind = here.rotation[:, axis], target.rotation[:, axis]
    if np.linalg.norm(before + behind) < OPPOSITE:
        return SE3(target.rotation, place)
    return SE3(_least_turn(before, behind) @ here.rotation, place)


def _least_turn(a: Array, b: Array) -> Array:
    """The rotation (3, 3) by the smallest angle that takes the unit vector a to b, which is not its opposite."""
    v, cosine = np.cross(a, b), float(a @ b)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


REMAINDER = 0.1
"""Share of the deviation allowed that may go to what lies between samples; it says how many are taken."""

FEWEST_SAMPLES, MOST_SAMPLES = 3, 4096
"""Steps between samples on a piece. A piece that would need more is refused: it is to be cut."""

SLIDES, LEADER, MULTIPLIER, OFFSET = 12, 13, 14, 15
"""Columns of :attr:`Arm.packed`, see :mod:`pinproof.kernels.chain`."""


class Stray:
    """Bounds of how far an arm's tcp is off a route.

    Parameters
    ----------
    arm
        The arm.
    asked
        (6,) which coordinates the task asks for. Of the rotation: all, none, or all but one.
    deviation, rotation_deviation
        Metres and radians that are allowed.
    """

    def __init__(self, arm: Arm, asked: Array, deviation: float, rotation_deviation: float) -> None:
        self._arm = arm
        self._allowed = deviation, rotation_deviation
        self._position = bool(asked[:3].any())
        turns = np.flatnonzero(asked[3:] > 0)
        free = np.flatnonzero(asked[3:] == 0)
        self._columns = np.arange(3) if len(turns) == 3 else free if len(turns) == 2 else np.empty(0, dtype=int)
        self._norm = math.sqrt(2.0) if len(turns) == 3 else 1.0

    def bound(self, path: CubicPath, route: Route) -> Array:
        """(k, 2) metres and radians by which the tcp may be off anywhere on each piece.

        Infinite where too many samples were needed to tell. Path and route have the same parameter, and the path's
        knots hold all borders of the route as far as it goes.
        """
        knots, control = path.bezier()
        width = np.diff(knots)
        pull, spin = self._second_derivatives(knots, control, route)
        metres, radians = self._allowed
        chord = 2.0 * self._norm * math.sin(min(radians, math.pi) / 2.0)
        steps = np.zeros(len(width))
        if self._position:
            steps = np.maximum(steps, width * np.sqrt(pull / (8.0 * REMAINDER * metres)))
        if len(self._columns):
            steps = np.maximum(steps, width * np.sqrt(spin / (8.0 * REMAINDER * chord)))
        hopeless = ~(steps <= MOST_SAMPLES)
        counts = np.where(hopeless, FEWEST_SAMPLES, np.clip(np.ceil(steps), FEWEST_SAMPLES, MOST_SAMPLES)).astype(int)
        first = np.concatenate([[0], np.cumsum(counts)])
        piece = np.repeat(np.arange(len(width)), counts)
        inside = (np.arange(first[-1]) - first[:-1][piece]) / counts[piece]
        s = np.minimum(np.append(knots[piece] + width[piece] * inside, knots[-1]), knots[-1])
        seen = np.stack(self._seen(path(s), route.poses(s)), axis=1)
        worst = np.maximum(np.maximum.reduceat(seen[:-1], first[:-1]), seen[first[1:]])
        remainder = (width / counts) ** 2 / 8.0
        off = np.stack([worst[:, 0] + remainder * pull, worst[:, 1] + remainder * spin], axis=1)
        off[:, 1] = 2.0 * np.arcsin(np.minimum(off[:, 1] / (2.0 * self._norm), 1.0))
        off[:, 0] *= self._position
        off[:, 1] *= bool(len(self._columns))
        off[hopeless] = np.inf
        return off

    def _seen(self, q: Array, wanted: Array) -> tuple[Array, Array]:
        """|D| (N,) of position and orientation at configurations q (N, n)."""
        gap = self._arm.forward_kinematics_batch(q)[:, :3] - wanted[:, :3]
        turned = gap[:, :, self._columns]
        return np.linalg.norm(gap[:, :, 3], axis=1), np.sqrt(np.einsum("nij,nij->n", turned, turned))

    def _second_derivatives(self, knots: Array, control: Array, route: Route) -> tuple[Array, Array]:
        """(k,) bounds of |D''| on each piece: of the position, and of the orientation."""
        chain = self._arm.packed
        joints, leader = chain[:-1], chain[:-1, LEADER].astype(int)
        scale, turns = np.abs(joints[:, MULTIPLIER]), joints[:, SLIDES] == 0.0
        first = bezier.derivative(knots, control)
        rate = np.abs(first).max(axis=1)[:, leader] * scale
        second = np.abs(bezier.derivative(knots, first)).max(axis=1)[:, leader] * scale
        turning = rate * turns
        inner = np.cumsum(turning, axis=1) - turning
        lever = self._levers(control)
        pull = (lever * second + lever * rate * (turning + 2.0 * inner)).sum(axis=1)
        spin = turning.sum(axis=1)
        change = (second * turns + turning * inner).sum(axis=1)
        of_route = route.derivatives(knots)
        turned = change + spin**2 + of_route[:, 2] + of_route[:, 1] ** 2
        return pull + of_route[:, 0], self._norm * turned

    def _levers(self, control: Array) -> Array:
        """(m,) how far the tcp is at most from the origin of each joint, 1 for a joint that slides."""
        chain = self._arm.packed
        joints = chain[:-1]
        reached = np.abs(control[:, :, joints[:, LEADER].astype(int)]).max(axis=(0, 1))
        slid = (np.abs(joints[:, MULTIPLIER]) * reached + np.abs(joints[:, OFFSET])) * joints[:, SLIDES]
        links = np.linalg.norm(chain[1:, [3, 7, 11]], axis=1) + np.append(slid[1:], 0.0)
        lever = np.cumsum(links[::-1])[::-1]
        return np.where(joints[:, SLIDES] != 0.0, 1.0, lever)


Flags = npt.NDArray[np.bool_]
_Stop = tuple[LinearStatus, str, tuple[str, ...]]

POSE_TOLERANCE = 1e-6
"""Metres and radians: a pose on the route within which the arm gets is reached."""

LEAST_PIECES = 3
"""Of a route: a spline through fewer poses is no better than a parabola."""

ROUNDS = 16
"""Times that poses are put closer together, where joints move too far between them or the tcp strays, at most."""

NARROWEST = 2.0**-6
"""Share of the first spacing below which no piece is cut any further: what changes faster is a jump."""

ROUNDING = 1e-9
"""Rad or m. What floating-point error may put a point beside a solved pose at a limit beyond it, with room."""

LOOKED_FOR = 8
"""Into how many parts the piece is cut on which a route ends."""

GUARD = 2e-3
"""Rad or m by which limits are drawn in for a second try: more than a spline overshoots the poses it goes through."""

ANY_STEP = 2 * np.pi
"""Rad or m: the step that a joint is let make where it is asked whether a pose can be reached by a jump."""


@dataclass(frozen=True, eq=False)
class Walked:
    """How far a route was followed.

    Parameters
    ----------
    path
        The curve over [0, fraction] of the route's parameter.
    fraction
        Up to where, 0 to 1.
    deviation, rotation_deviation
        By how much (m, rad) the tcp may be off the route anywhere on the path: bounds.
    status, why, joints
        What stands in the way; COMPLETE at the end. Joints at their limits, or that would have to jump.
    """

    path: CubicPath
    fraction: float
    deviation: float
    rotation_deviation: float
    status: LinearStatus = LinearStatus.COMPLETE
    why: str = ""
    joints: tuple[str, ...] = field(default=())


@dataclass(frozen=True, kw_only=True)
class Following:
    """How routes are followed; see :func:`pinproof.plan_linear`.

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
    def asked(self) -> Array:
        """(6,) of 1 and 0."""
        task = self.task
        return np.array([task.x, task.y, task.z, task.rx, task.ry, task.rz], dtype=float)

    def walk(self, route: Route, first: Array) -> Walked:
        """Follow a route from its first pose, at which the arm stands in ``first`` (n,).

        A redundant arm that slides along a joint's limit has poses at the limit and, for a spline through them, none to
        spare; it is let try again a little inside of it.
        """
        walked = self._walk(self.arm, route, first)
        if walked.status is not LinearStatus.LIMIT or self.arm.dof <= self.asked.sum():
            return walked
        limits = self.arm.limits
        guard = np.minimum(GUARD, (limits.upper - limits.lower) / 4)
        inside = replace(
            limits, lower=np.minimum(limits.lower + guard, first), upper=np.maximum(limits.upper - guard, first)
        )
        again = self._walk(self.arm.with_limits(inside), route, first)
        return again if again.fraction > walked.fraction else walked

    def _walk(self, arm: Arm, route: Route, first: Array) -> Walked:
        """The same, solved within the limits of ``arm``; the curve keeps those of :attr:`arm`."""
        stray = Stray(self.arm, self.asked, self.deviation, self.rotation_deviation)
        knots = route.knots(self.translation_step, self.rotation_step, LEAST_PIECES)
        spacing = float(np.diff(knots).max())
        stop: _Stop = (LinearStatus.COMPLETE, "", ())
        rounds = 0
        while len(knots) > 1:
            rounds += 1
            wide = (np.diff(knots) > NARROWEST * spacing) & (rounds <= ROUNDS)
            tracked = self._track(arm, route, knots[1:], first)
            if not tracked.ok:
                at = int(np.flatnonzero(~tracked.reached)[0])
                if wide[at] and tracked.at_speed_limit[at].any():
                    knots = _cut(knots, np.logical_and(self._too_fast(tracked, at), wide))
                elif wide[at]:  # it ends here: where exactly?
                    knots = _cut(knots, np.arange(len(wide)) == at, LOOKED_FOR)
                else:
                    here = first if at == 0 else tracked.q[at - 1]
                    stop = self._reason(route, float(knots[at]), spacing, here, tracked.at_position_limit[at])
                    knots = knots[: at + 1]
                continue
            path = CubicPath.through(np.vstack([first, tracked.q]), self.arm.joint_names, knots=knots)
            off, outside = stray.bound(path, route), self._outside(path)
            bad: Flags = np.asarray(
                (off > (self.deviation, self.rotation_deviation)).any(axis=1) | (outside > ROUNDING).any(axis=1)
            )
            if not bad.any():
                metres, radians = off.max(axis=0).tolist()
                return Walked(path, float(knots[-1]), metres, radians, *stop)
            at = int(np.flatnonzero(bad)[0])
            if wide[at]:
                knots = _cut(knots, np.logical_and(bad, wide))
            else:
                stop = self._strayed(off[at], outside[at])
                knots = knots[: at + 1]
        still = CubicPath([first], np.zeros((1, len(first))), [0.0], self.arm.joint_names)
        return Walked(still, 0.0, 0.0, 0.0, *stop)

    def _track(self, arm: Arm, route: Route, s: Array, first: Array, step: float | None = None) -> TrackResult:
        """The poses at s (N,) one from the other, no joint moving farther than a step between two."""
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
    def _too_fast(tracked: TrackResult, first: int) -> Flags:
        """(N,) the pieces from ``first`` on in which a joint moved as far as it may."""
        fast: Flags = np.array(tracked.at_speed_limit.any(axis=1))
        fast[:first] = False
        return fast

    def _outside(self, path: CubicPath) -> Array:
        """(k, n) by how much joints may leave their limits on a piece; control points inside prove that none does."""
        _, control = path.bezier()
        limits = self.arm.limits
        return np.maximum(limits.lower - control.min(axis=1), control.max(axis=1) - limits.upper)

    def _reason(self, route: Route, s: float, spacing: float, here: Array, stuck: Flags) -> _Stop:
        """Why the arm gets no farther than ``here`` (n,), at the parameter s, with the joints ``stuck`` (n,) at limits.

        What can be reached a little farther on, if joints may jump, tells the one reason from the other.
        """
        arm = self.arm
        ahead = self._track(arm, route, np.array([min(s + spacing, 1.0)]), here, ANY_STEP)
        step = np.abs(ahead.q[0] - here)
        short = (
            f"{ahead.position_error[0] * 1e3:.1f} mm and {ahead.orientation_error[0]:.2g} rad short of the next pose"
        )
        asked = arm.jacobian(here, reference="LOCAL")[self.asked > 0.0]
        singular = f"smallest singular value {np.linalg.svd(asked, compute_uv=False)[-1]:.2g}"
        if stuck.any():
            names = tuple(np.array(arm.joint_names)[stuck].tolist())
            beyond = "the line goes on beyond it" if ahead.ok else short
            return LinearStatus.LIMIT, f"{', '.join(names)} at the limit, {beyond}", names
        if ahead.ok:
            name = arm.joint_names[int(step.argmax())]
            return LinearStatus.JUMP, f"{name} would jump by {step.max():.2f}, {singular}", (name,)
        return LinearStatus.UNREACHABLE, f"{short}, {singular}", ()

    def _strayed(self, off: Array, outside: Array) -> _Stop:
        """Why a curve through reached poses is no good on a piece that is not cut any further."""
        joint = int(outside.argmax())
        if outside[joint] > ROUNDING:
            name = self.arm.joint_names[joint]
            why = f"{name} may leave its limits by {outside[joint]:.2g} between the solved poses"
            return LinearStatus.LIMIT, why, (name,)
        why = f"between the solved poses the tcp may stray {off[0] * 1e3:.2g} mm and {off[1]:.2g} rad"
        return LinearStatus.JUMP, why, ()


def _cut(knots: Array, which: Flags, parts: int = 2) -> Array:
    """The knots (k+1,) with some pieces (k,) cut into equal parts."""
    inner = knots[:-1][which][:, None] + np.diff(knots)[which][:, None] * (np.arange(1, parts) / parts)
    return np.sort(np.concatenate([knots, inner.ravel()]))
