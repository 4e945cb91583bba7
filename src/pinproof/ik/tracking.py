"""Tracking of a sequence of poses within joint position and velocity limits: a whole sequence, or cycle by cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

import numpy as np
import numpy.typing as npt

from pinproof._core import Tracker as CompiledTracker
from pinproof.common.results import View, html_plot
from pinproof.common.structs import described, key
from pinproof.common.validation import freeze_arrays, require_positive, require_type
from pinproof.errors import InputError
from pinproof.ik.result import NEAR_LIMIT, IkAnswer
from pinproof.ik.task import GoalName, IkGoal, Task, TaskLike, make_goal, make_task, orientation_tolerance_of
from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.spatial import SE3, Array, finite, matrix, rigid, rigid_many

Flags = npt.NDArray[np.bool_]

AT_FULL_SPEED = 1 - 1e-6
"""A joint that moves at this fraction of its speed limit or more is reported as being at the limit."""

NEAR_SINGULAR = 0.05
"""A smallest singular value (metres and radians mixed) below this is reported as a reason for a tracking error."""

NAMED = 3
"""Number of intervals above the tolerance that a message describes: those with the largest errors."""


@described(eq=False)
class TrackResult(IkAnswer):
    """The result of :func:`pinproof.track` for N poses.

    Attributes
    ----------
    position_error, orientation_error
        (N,) distance in m and angle in rad from each pose to the tcp, by forward kinematics at the returned q. Only
        coordinates that the task selects count; if the task selects no position or no orientation, the complete error
        is reported.
    reached
        (N,) whether both errors are within the tolerances.
    """

    arm: Arm = key("the arm")
    task: Task = key("the task")
    poses: Array = key("(N, 4, 4) the poses that were tracked")
    q0: Array = key("(n,) the configuration at time 0")
    q: Array = key("(N, n) the configurations, within the limits, not wrapped to (-pi, pi]")
    times: Array = key("(N,) the time in seconds at which each pose was due")
    durations: Array = key("(N,) the duration in seconds of the cycle before each sample")
    velocity: Array = key("(n,) the speed limits, in rad/s or m/s")
    position_error: Array = field(init=False)
    orientation_error: Array = field(init=False)
    reached: Flags = field(init=False)

    def _view(self) -> View:
        lines = dict(zip(self.arm.joint_names, self.q.T, strict=True))
        return View(self.message, [html_plot(self.times, lines, "rad or m") if len(self.times) else None])

    def __post_init__(self) -> None:
        errors = pose_errors(self.arm, self.task, self.poses, self.q)
        measured = {"position_error": errors[:, 0], "orientation_error": errors[:, 1]}
        for name, value in {**measured, "reached": self.task.fulfilled(errors)}.items():
            object.__setattr__(self, name, value)
        freeze_arrays(self, "poses", "q0", "q", "times", "durations", "velocity", *measured, "reached")

    @property
    def ok(self) -> bool:
        """Whether every sample is within the tolerances."""
        return bool(self.reached.all())

    @property
    def speed_shares(self) -> Array:
        """(N, n) the motion of each joint in the cycle before each sample, divided by what its speed limit allows."""
        moved = np.abs(np.diff(self.q, axis=0, prepend=self.q0[None]))
        allowed = self.velocity * self.durations[:, None]
        return np.divide(moved, allowed, out=np.zeros_like(moved), where=allowed > 0)

    @property
    def speed_share(self) -> Array:
        """(N,) the largest of :attr:`speed_shares` over the joints."""
        return np.asarray(self.speed_shares.max(axis=1))

    @property
    def at_speed_limit(self) -> Flags:
        """(N, n) which joints moved at their speed limit."""
        return np.asarray(self.speed_shares >= AT_FULL_SPEED)

    @property
    def at_position_limit(self) -> Flags:
        """(N, n) which joints are at a position limit."""
        limits = self.arm.limits
        return np.asarray(np.minimum(self.q - limits.lower, limits.upper - self.q) <= NEAR_LIMIT)

    @property
    def message(self) -> str:
        """Status, largest error, and the time, size and cause of the largest errors above the tolerances."""
        position, orientation = float(self.position_error.max()), float(self.orientation_error.max())
        worst = f"{position:.3g} m and {orientation:.3g} rad"
        if self.ok:
            return (
                f"all {len(self)} poses reached; largest error {worst}; "
                f"joint speeds up to {self.speed_share.max():.0%} of the limits"
            )
        # first and last sample of each interval in which the errors exceed the tolerances; the worst are described
        edges = np.flatnonzero(np.diff(~self.reached, prepend=False, append=False))
        runs = [(first, end - 1) for first, end in edges.reshape(-1, 2).tolist()]
        errors = self.position_error + self.orientation_error
        described = sorted(sorted(runs, key=lambda run: -float(errors[run[0] : run[1] + 1].max()))[:NAMED])
        more = f"; and {len(runs) - NAMED} more intervals" if len(runs) > NAMED else ""
        return (
            f"{np.count_nonzero(~self.reached)} of {len(self)} poses not reached; largest error {worst}: "
            f"{'; '.join(self._described(*run) for run in described)}{more}"
        )

    def to_path(self) -> JointPath:
        """The samples as waypoints of a path without timing; q0 is not included."""
        return JointPath(self.q, self.arm.joint_names)

    def __len__(self) -> int:
        return len(self.q)

    def _described(self, first: int, last: int) -> str:
        """The time, the errors and the cause of an interval of samples that are not within the tolerances."""
        rows = slice(first, last + 1)
        names = np.array(self.arm.joint_names)
        fast, stopped = (names[at[rows].any(axis=0)] for at in (self.at_speed_limit, self.at_position_limit))
        why = [f"{what} limit of {', '.join(of)}" for what, of in (("speed", fast), ("position", stopped)) if of.size]
        # the Jacobian at the worst sample, its rows that the task selects in the axes of the target
        worst = first + int((self.position_error[rows] + self.orientation_error[rows]).argmax())
        spin, jacobian = self.poses[worst, :3, :3].T, self.arm.jacobian(self.q[worst])
        selected = np.vstack([spin @ jacobian[:3], spin @ jacobian[3:]])[self.task.mask > 0]
        smallest = float(np.linalg.svd(selected, compute_uv=False)[-1])
        if smallest < NEAR_SINGULAR:
            why.append(f"near a singularity (smallest singular value {smallest:.2g})")
        # when, how much and why
        end = "to the end" if last == len(self) - 1 else f"until {self.times[last]:.6g} s"
        when = f"from {self.times[first]:.6g} s {end} (samples {first} to {last})"
        if first == last:
            when = f"at {self.times[first]:.6g} s (sample {first})"
        return (
            f"{when} error up to "
            f"{self.position_error[rows].max():.3g} m and {self.orientation_error[rows].max():.3g} rad, "
            f"{', '.join(why) or 'out of reach on this IK branch'}"
        )


def pose_errors(arm: Arm, task: Task, poses: Array, q: Array) -> Array:
    """(N, 2) distances (m) and angles (rad) from the poses (N, 4, 4) to the tcp at q (N, n)."""
    return np.asarray(task.compiled.measure_batch(np.ascontiguousarray(poses), arm.forward_kinematics_batch(q)))


def track(
    arm: Arm,
    poses: npt.ArrayLike | Sequence[SE3],
    q0: npt.ArrayLike,
    *,
    dt: float | None = None,
    times: npt.ArrayLike | None = None,
    velocity: float | npt.ArrayLike | None = None,
    task: TaskLike = "pose",
    goal: GoalName | IkGoal | None = None,
    position_tolerance: float = 1e-6,
    orientation_tolerance: float | None = None,
) -> TrackResult:
    """Compute joint motions that track a sequence of poses within position and speed limits.

    Each cycle ends at the configuration whose tcp is closest to the pose (one metre has the weight of one radian) among
    those that the limits allow within the cycle. Joints therefore never jump. If a pose cannot be reached in time, for
    example near a singularity, the tcp deviates from it and returns at the speed limit; the deviation is reported for
    every sample. q is not wrapped to (-pi, pi].

    The IK branch is preserved: a motion through a singularity continues smoothly, and if targets leave the workspace
    and return, the elbow remains on its side (not guaranteed for redundant arms or tasks with free coordinates).

    Parameters
    ----------
    arm
        The arm.
    poses
        (N, 4, 4) ``base_from_target``, or a sequence of ``pin.SE3``; at least one.
    q0
        (n,) the configuration at time 0, within the limits.
    dt
        Cycle time in seconds. Pose k is due at (k + 1) dt.
    times
        (N,) instead of ``dt``: the time in seconds at which each pose is due, increasing, at least 0. The arm is at q0
        at time 0.
    velocity
        Speed limits, rad/s or m/s, one for all joints or (n,); by default those of the arm.
    task
        As for :meth:`pinproof.Clik.solve`: ``"pose"``, ``"position"``, ``"spin_z"``, ... or an
        :class:`~pinproof.ik.IkTask`.
    goal
        Null-space objective, as for :meth:`pinproof.Clik.solve`; it never increases the error of the task. Its gain is
        per second here. ``"near"`` refers to q0.
    position_tolerance, orientation_tolerance
        In m and rad: a sample within both counts as reached. The angle is by default that of :class:`pinproof.Clik`.

    Raises
    ------
    InputError
        If a pose is not rigid, q0 is outside the limits, a speed limit is unknown or not positive, the times do not
        increase, both or neither of ``dt`` and ``times`` are given, or the task or goal is unknown.
    """
    many = rigid_many("poses", poses)
    if len(many) == 0:
        raise InputError("poses is empty; track requires at least one pose")
    # the time (s) at which each pose is due, and the time since the pose before it
    if dt is not None and times is None:
        require_positive("dt", dt)
        clock, durations = dt * np.arange(1.0, len(many) + 1), np.full(len(many), float(dt))
    elif times is not None and dt is None:
        clock = finite("times", times, (len(many),))
        durations = np.diff(clock, prepend=0.0)
        if clock[0] < 0 or (durations[1:] <= 0).any():
            raise InputError("times must increase from pose to pose, the first at 0 or later")
    else:
        raise InputError("track requires either dt, the cycle time, or times, the time in s at which each pose is due")
    # all cycles in the compiled core, which Tracker calls one by one
    tracking = _CompiledTracking(arm, q0, velocity, task, goal, position_tolerance, orientation_tolerance)
    q = np.asarray(tracking.core.track(many, durations))
    return TrackResult(arm, tracking.task, many, tracking.start, q, clock, durations, tracking.velocity)


class Tracker:
    """:func:`track` cycle by cycle, for a control loop, with bit-identical results.

    The other parameters and the exceptions are those of :func:`track`. The constructor runs one cycle, so that compiled
    code is loaded before the first cycle of the control loop.

    Parameters
    ----------
    arm
        The arm.
    dt
        Cycle time in seconds.
    q0
        (n,) the initial configuration, within the limits.
    """

    def __init__(
        self,
        arm: Arm,
        dt: float,
        q0: npt.ArrayLike,
        *,
        velocity: float | npt.ArrayLike | None = None,
        task: TaskLike = "pose",
        goal: GoalName | IkGoal | None = None,
        position_tolerance: float = 1e-6,
        orientation_tolerance: float | None = None,
    ) -> None:
        require_positive("dt", dt)
        self.arm, self.dt = arm, float(dt)
        self._settings = velocity, task, goal, position_tolerance, orientation_tolerance
        self._durations = np.array([self.dt])
        self.reset(q0)
        self.step(arm.forward_kinematics(self.q))
        self.reset(q0)

    def reset(self, q0: npt.ArrayLike) -> None:
        """Restart from q0 (n,), at rest.

        Raises
        ------
        InputError
            If q0 is outside the limits.
        """
        self._tracking = _CompiledTracking(self.arm, q0, *self._settings)
        self._pose: Array | None = None

    @property
    def q(self) -> Array:
        """(n,) the current configuration."""
        return np.asarray(self._tracking.core.q)

    @property
    def slip(self) -> tuple[float, float]:
        """Distance (m) and angle (rad) from the last pose to the tcp; 0 before the first pose."""
        if self._pose is None:
            return 0.0, 0.0
        position, orientation = pose_errors(self.arm, self._tracking.task, self._pose, self.q[None])[0].tolist()
        return position, orientation

    @property
    def ok(self) -> bool:
        """Whether the last pose was reached within the tolerances."""
        return self._pose is None or bool(self._tracking.task.fulfilled(np.array([self.slip]))[0])

    def step(self, pose: SE3 | npt.ArrayLike) -> Array:
        """The configuration (n,) at the end of the cycle in which this pose, ``base_from_target``, is due.

        Raises
        ------
        InputError
            If the pose is not rigid; the configuration then does not change.
        """
        self._pose = matrix(rigid("pose", pose))[None]
        return np.asarray(self._tracking.core.track(self._pose, self._durations)[0])


class _CompiledTracking:
    """The compiled tracker with its task, its start and its speed limits."""

    def __init__(
        self,
        arm: Arm,
        q0: npt.ArrayLike,
        velocity: float | npt.ArrayLike | None,
        task: TaskLike,
        goal: GoalName | IkGoal | None,
        position_tolerance: float,
        orientation_tolerance: float | None,
    ) -> None:
        require_type("arm", arm, Arm)
        require_positive("position_tolerance", position_tolerance)
        orientation = orientation_tolerance_of(arm, orientation_tolerance, usual=1e-6)
        require_positive("orientation_tolerance", orientation)
        self.task: Task = make_task(task, position_tolerance, orientation)
        self.start = arm.limits.snap(arm.configuration(q0, "q0"))
        # the speed limits of each joint: all must be known
        given = arm.limits.velocity if velocity is None else velocity
        try:
            self.velocity = np.array(np.broadcast_to(np.asarray(given, dtype=float), (arm.dof,)))
        except (TypeError, ValueError) as error:
            raise InputError(f"velocity must be one number or {arm.dof} numbers, not {velocity!r}") from error
        if not (np.isfinite(self.velocity) & (self.velocity > 0)).all():
            named = ", ".join(f"{name} {value:g}" for name, value in zip(arm.joint_names, self.velocity, strict=True))
            why = "the arm has unknown speed limits" if velocity is None else "speed limits must be finite and above 0"
            raise InputError(f"{why} ({named}); pass velocity= in rad/s or m/s")
        if outside := arm.limits.violations(self.start, arm.joint_names):
            raise InputError(f"q0 must be inside the limits: {'; '.join(outside)}")
        # the start is inside the limits, which each cycle keeps
        null_space = make_goal(goal, arm, self.start)
        self.core = CompiledTracker(
            arm.chain, arm.limits.lower, arm.limits.upper, self.velocity, self.task.compiled,
            None if null_space is None else null_space.compiled, self.start,
        )  # fmt: skip
