"""Configurations that take the tcp along a route, on one branch and without a jump, as a smooth curve."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.ik import IkTask, Track, track
from pinproof.model import Arm
from pinproof.motion import CubicPath
from pinproof.planning.linear_move import LinearStatus
from pinproof.planning.route import Route
from pinproof.planning.stray import Stray

__all__ = ["Following", "Walked"]

Array = npt.NDArray[np.float64]
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

    def _track(self, arm: Arm, route: Route, s: Array, first: Array, step: float | None = None) -> Track:
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
    def _too_fast(tracked: Track, first: int) -> Flags:
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
