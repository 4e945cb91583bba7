"""What tracking answers: the joint motions, and where, how long and why the tcp slipped from its targets."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pinproof.errors import IkFailed
from pinproof.ik.messages import AT_LIMIT
from pinproof.ik.task import Task
from pinproof.model import Arm
from pinproof.motion import JointPath

__all__ = ["Track", "slips"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

AT_FULL_SPEED = 1 - 1e-6
"""The share of its speed limit from which a joint is named as moving at it."""

NEAR_SINGULAR = 0.05
"""A smallest singular value (metres and radians mixed) below this is named as a reason for a slip."""

NAMED = 3
"""Slips that a message describes, the worst first."""


@dataclass(frozen=True, eq=False)
class Track:
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

    def or_raise(self) -> Track:
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
