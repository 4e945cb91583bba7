"""Following a sequence of poses under joint position and speed limits: a whole sequence, or tick by tick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.ik.goal import GoalName, IkGoal, packed_goal
from pinproof.ik.settings import positive
from pinproof.ik.task import IkTask, Task, TaskName, make_task
from pinproof.ik.track_result import Track, slips
from pinproof.model import Arm
from pinproof.spatial import SE3, finite, matrix, rigid, rigid_many

__all__ = ["Tracker", "track"]

Array = npt.NDArray[np.float64]
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
) -> Track:
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
        positive("dt", dt)
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
    return Track(arm, follower.task, many, follower.start, q, clock, durations, follower.velocity)


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
        positive("dt", dt)
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
        """Metres and radians from the last pose to the tcp, by Pinocchio, as in :class:`Track`; 0 before the first."""
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
        positive("position_tolerance", position_tolerance)
        positive("orientation_tolerance", orientation_tolerance)
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
