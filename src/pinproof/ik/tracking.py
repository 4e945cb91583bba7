"""What tracking answers: the joint motions, and where, how long and why the tcp slipped from its targets.

Following a sequence of poses under joint position and speed limits: a whole sequence, or tick by tick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import require_positive
from pinproof.errors import IkFailed, InputError
from pinproof.ik.result import AT_LIMIT
from pinproof.ik.task import GoalName, IkGoal, IkTask, Task, TaskName, make_task, packed_goal
from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.spatial import SE3, finite, matrix, rigid, rigid_many

__all__ = ["TrackResult", "Tracker", "slips", "track"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

AT_FULL_SPEED = 1 - 1e-6
"""The share of its speed limit from which a joint is named as moving at it."""

NEAR_SINGULAR = 0.05
"""A smallest singular value (metres and radians mixed) below this is named as a reason for a slip."""

NAMED = 3
"""Slips that a message describes, the worst first."""


@dataclass(frozen=True, eq=False)
class TrackResult:
    """The answer of :func:`pinproof.track` for N poses.

    Parameters
    ----------
    arm, task, poses
        What was followed, by whom.
    q0
        (n,) where the arm stood at time 0.
    q
        (N, n) the configurations, inside the limits, unwrapped.
    times
        (N,) in seconds, when each pose was due.
    durations
        (N,) in seconds: of the tick before each sample.
    velocity
        (n,) the speed limits that were kept, in rad/s or m/s.

    Attributes
    ----------
    position_error, orientation_error
        (N,) the slip: metres and radians from each pose to the tcp, by Pinocchio's forward kinematics, apart from the
        loop that made q. (Of the coordinates that the task asks for; where it asks for none of the one or the other,
        that is reported whole.)
    reached
        (N,) whether the slip is within the tolerances.
    """

    arm: Arm
    task: Task
    poses: Array = field(repr=False)
    q0: Array
    q: Array
    times: Array
    durations: Array
    velocity: Array
    position_error: Array = field(init=False)
    orientation_error: Array = field(init=False)
    reached: Flags = field(init=False)

    def __post_init__(self) -> None:
        errors = slips(self.arm, self.task, self.poses, self.q)
        measured = {
            "position_error": errors[:, 0],
            "orientation_error": errors[:, 1],
            "reached": self.task.fulfilled(errors),
        }
        for name in ("poses", "q0", "q", "times", "durations", "velocity"):
            measured[name] = getattr(self, name)
        for name, value in measured.items():
            array = np.array(value)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def ok(self) -> bool:
        """Whether every sample is within the tolerances."""
        return bool(self.reached.all())

    @property
    def speed_shares(self) -> Array:
        """(N, n) how far each joint moved in the tick before each sample, as a share of what its speed limit allows."""
        moved = np.abs(np.diff(self.q, axis=0, prepend=self.q0[None]))
        allowed = self.velocity * self.durations[:, None]
        return np.divide(moved, allowed, out=np.zeros_like(moved), where=allowed > 0)

    @property
    def speed_share(self) -> Array:
        """(N,) the largest of them."""
        return np.asarray(self.speed_shares.max(axis=1))

    @property
    def at_speed_limit(self) -> Flags:
        """(N, n) which joints moved at their speed limit."""
        return np.asarray(self.speed_shares >= AT_FULL_SPEED)

    @property
    def at_position_limit(self) -> Flags:
        """(N, n) which joints stand at a limit."""
        limits = self.arm.limits
        return np.asarray(np.minimum(self.q - limits.lower, limits.upper - self.q) <= AT_LIMIT)

    @property
    def message(self) -> str:
        """The answer in words: where and how long the tcp slipped, and why."""
        position, orientation = float(self.position_error.max()), float(self.orientation_error.max())
        worst = f"{position:.3g} m and {orientation:.3g} rad"
        if self.ok:
            return (
                f"all {len(self)} poses followed, slip at most {worst}; "
                f"joints moved at up to {self.speed_share.max():.0%} of their speed limits"
            )
        runs = self._slipping_runs()
        described = sorted(sorted(runs, key=self._slip_of, reverse=True)[:NAMED])
        more = f"; and {len(runs) - NAMED} more" if len(runs) > NAMED else ""
        return (
            f"{np.count_nonzero(~self.reached)} of {len(self)} poses slipped, by at most {worst}: "
            f"{'; '.join(self._described(*run) for run in described)}{more}"
        )

    def to_path(self) -> JointPath:
        """The samples as waypoints of a path without timing, q0 not among them."""
        return JointPath(self.q, self.arm.joint_names)

    def or_raise(self) -> TrackResult:
        """The track itself if every sample is within the tolerances.

        Raises
        ------
        IkFailed
            If one is not, with the message; ``.result`` of the error is this value.
        """
        if not self.ok:
            raise IkFailed(self.message, self)
        return self

    def __len__(self) -> int:
        return len(self.q)

    def _slipping_runs(self) -> list[tuple[int, int]]:
        """First and last sample of each slip."""
        edges = np.flatnonzero(np.diff(~self.reached, prepend=False, append=False))
        return [(first, end - 1) for first, end in edges.reshape(-1, 2).tolist()]

    def _slip_of(self, run: tuple[int, int]) -> float:
        rows = slice(run[0], run[1] + 1)
        return float((self.position_error[rows] + self.orientation_error[rows]).max())

    def _described(self, first: int, last: int) -> str:
        rows = slice(first, last + 1)
        names = np.array(self.arm.joint_names)
        fast, stopped = (names[at[rows].any(axis=0)] for at in (self.at_speed_limit, self.at_position_limit))
        worst = first + int((self.position_error[rows] + self.orientation_error[rows]).argmax())
        smallest = self._smallest_singular_value(worst)
        why = []
        if fast.size:
            why.append(f"speed limit of {', '.join(fast)}")
        if stopped.size:
            why.append(f"position limit of {', '.join(stopped)}")
        if smallest < NEAR_SINGULAR:
            why.append(f"near a singularity (smallest singular value {smallest:.2g})")
        end = "to the end" if last == len(self) - 1 else f"until {self.times[last]:.6g} s"
        when = f"from {self.times[first]:.6g} s {end} (samples {first} to {last})"
        if first == last:
            when = f"at {self.times[first]:.6g} s (sample {first})"
        return (
            f"{when} by at most "
            f"{self.position_error[rows].max():.3g} m and {self.orientation_error[rows].max():.3g} rad: "
            f"{', '.join(why) or 'out of reach on this branch'}"
        )

    def _smallest_singular_value(self, row: int) -> float:
        """Of the Jacobian of what the task asks for, in the axes of the target."""
        spin = self.poses[row, :3, :3].T
        jacobian = self.arm.jacobian(self.q[row])
        asked = np.vstack([spin @ jacobian[:3], spin @ jacobian[3:]])[self.task.asked > 0]
        return float(np.linalg.svd(asked, compute_uv=False)[-1])


def slips(arm: Arm, task: Task, poses: Array, q: Array) -> Array:
    """(N, 2) metres and radians from the poses (N, 4, 4) to the tcp at q (N, n), by Pinocchio."""
    from pinproof.kernels.task import measure_many

    errors = np.empty((len(q), 2))
    measure_many(np.ascontiguousarray(poses), arm.forward_kinematics_batch(q), task.asked, errors)
    return errors


TaskLike = TaskName | IkTask | Sequence[bool]

EITHER = "track needs either dt, the seconds of a tick, or times, the seconds at which the poses are due"


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
    orientation_tolerance: float = 1e-6,
) -> TrackResult:
    """Joint motions that follow a sequence of poses as well as position and speed limits allow.

    Each tick ends at the configuration, among all that these limits let the arm reach within the tick, whose tcp is
    nearest to the pose (one metre weighed as one radian). So no joint ever jumps. Where a pose cannot be reached in
    time, near a singularity for instance, the tcp slips, and catches up at the speed limit afterwards; by how much is
    said sample by sample. q is never wrapped: joints keep winding as long as their limits allow.

    The branch is kept: a motion through a singularity goes on as it came. An arm that slips, as its targets leave its
    reach, comes back with the elbow on its old side (not promised for a redundant arm, or a task that leaves freedom).

    Parameters
    ----------
    arm
        The arm.
    poses
        (N, 4, 4) ``base_from_target``, or a sequence of ``pin.SE3``; at least one.
    q0
        (n,) inside the limits: where the arm stands at time 0.
    dt
        Seconds of a tick. Pose k is due at (k + 1) dt.
    times
        (N,) instead of ``dt``: when each pose is due, in seconds, increasing, none before 0. At time 0 the arm still
        stands at q0.
    velocity
        Speed limits, rad/s or m/s, one for all joints or (n,); by default those of the arm.
    task
        As for :meth:`pinproof.Clik.solve`: ``"pose"``, ``"position"``, ``"spin_z"``, ... or an :class:`IkTask`.
    goal
        What the joints shall do besides, where the task leaves them free, as for :meth:`pinproof.Clik.solve`; it never
        costs the task anything. Its gain counts per second here. ``"near"`` is near q0.
    position_tolerance, orientation_tolerance
        In m and rad: a sample within them counts as reached.

    Raises
    ------
    InputError
        For poses that are not rigid, a q0 outside the limits, speeds that are not known or not above 0, times that do
        not increase; for both or neither of ``dt`` and ``times``; for an unknown task or goal.
    """
    many = rigid_many("poses", poses)
    if len(many) == 0:
        raise InputError("poses has no pose; there is nothing to track")
    if dt is not None and times is not None:
        raise InputError(EITHER)
    if dt is not None:
        require_positive("dt", dt)
        clock, durations = dt * np.arange(1.0, len(many) + 1), np.full(len(many), float(dt))
    elif times is not None:
        clock = finite("times", times, (len(many),))
        durations = np.diff(clock, prepend=0.0)
        if clock[0] < 0 or (durations[1:] <= 0).any():
            raise InputError("times must increase from pose to pose, the first at 0 or later")
    else:
        raise InputError(EITHER)
    follower = _Follower(arm, q0, velocity, task, goal, position_tolerance, orientation_tolerance)
    q = follower(many, durations)
    return TrackResult(arm, follower.task, many, follower.start, q, clock, durations, follower.velocity)


class Tracker:
    """:func:`track` tick by tick, for a control loop: the same answers, bit for bit.

    What is not named here is as for :func:`track`, and so is what is raised. The first tick of a process may load
    compiled code; the constructor makes one on the side, so that no tick of the loop does.

    Parameters
    ----------
    arm
        The arm.
    dt
        Seconds of a tick.
    q0
        (n,) inside the limits: where the arm stands.
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
        orientation_tolerance: float = 1e-6,
    ) -> None:
        require_positive("dt", dt)
        self.arm, self.dt = arm, float(dt)
        self._settings = velocity, task, goal, position_tolerance, orientation_tolerance
        self._durations = np.array([self.dt])
        self.reset(q0)
        self.step(arm.forward_kinematics(self.q))
        self.reset(q0)

    def reset(self, q0: npt.ArrayLike) -> None:
        """Begin anew at q0 (n,), at rest.

        Raises
        ------
        InputError
            If it is not inside the limits.
        """
        self._follower = _Follower(self.arm, q0, *self._settings)
        self._pose: Array | None = None

    @property
    def q(self) -> Array:
        """(n,) where the arm stands now."""
        return self._follower.state[0].copy()

    @property
    def slip(self) -> tuple[float, float]:
        """Metres and radians from the last pose to the tcp, as in :class:`TrackResult`; 0 before the first."""
        if self._pose is None:
            return 0.0, 0.0
        position, orientation = slips(self.arm, self._follower.task, self._pose, self._follower.state[:1])[0].tolist()
        return position, orientation

    @property
    def ok(self) -> bool:
        """Whether the last pose was reached within the tolerances."""
        return self._pose is None or bool(self._follower.task.fulfilled(np.array([self.slip]))[0])

    def step(self, pose: SE3 | npt.ArrayLike) -> Array:
        """The configuration (n,) at the end of the tick in which this pose, ``base_from_target``, is due.

        Raises
        ------
        InputError
            If the pose is not rigid; the arm then stands where it stood.
        """
        self._pose = matrix(rigid("pose", pose))[None]
        return self._follower(self._pose, self._durations)[0]


class _Follower:
    """The compiled loop with what goes from tick to tick."""

    def __init__(
        self,
        arm: Arm,
        q0: npt.ArrayLike,
        velocity: float | npt.ArrayLike | None,
        task: TaskLike,
        goal: GoalName | IkGoal | None,
        position_tolerance: float,
        orientation_tolerance: float,
    ) -> None:
        require_positive("position_tolerance", position_tolerance)
        require_positive("orientation_tolerance", orientation_tolerance)
        self.task: Task = make_task(task, position_tolerance, orientation_tolerance)
        self.start, self.velocity = arm.limits.snap(arm.configuration(q0, "q0")), _speeds(arm, velocity)
        if outside := arm.limits.violations(self.start, arm.joint_names):
            raise InputError(f"q0 must be inside the limits: {'; '.join(outside)}")
        self.state = np.zeros((3, arm.dof))
        self.state[0] = self.start
        limits = np.array([arm.limits.lower, arm.limits.upper])
        self._fixed = arm.packed, limits, self.velocity, self.task.asked, packed_goal(goal, arm, self.start)

    def __call__(self, poses: Array, durations: Array) -> Array:
        """The next N configurations (N, n)."""
        from pinproof.kernels.track import track_many

        q = np.empty((len(poses), self.state.shape[1]))
        track_many(*self._fixed, self.state, poses, durations, q)
        return q


def _speeds(arm: Arm, velocity: float | npt.ArrayLike | None) -> Array:
    """The speed limits (n,), checked."""
    given = arm.limits.velocity if velocity is None else velocity
    try:
        speeds = np.array(np.broadcast_to(np.asarray(given, dtype=float), (arm.dof,)))
    except (TypeError, ValueError) as error:
        raise InputError(f"velocity must be one number or {arm.dof}, not {velocity!r}") from error
    if not (np.isfinite(speeds) & (speeds > 0)).all():
        named = [f"{name} {value:g}" for name, value in zip(arm.joint_names, speeds, strict=True)]
        why = "the arm's speed limits are not all known" if velocity is None else "speed limits must be finite, above 0"
        raise InputError(f"{why} ({', '.join(named)}); give track velocity=, in rad/s or m/s")
    return speeds
