"""A timed motion: what a controller is sent, and what a certificate is made for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError, TrajectoryError
from pinproof.motion import bezier, trajectory_files
from pinproof.motion.clock import LONGEST, seconds, whole_nanoseconds
from pinproof.motion.curve import MEET_TOLERANCE, Array, checked_joint_names, ends_meet, read_only
from pinproof.spatial import finite

__all__ = ["Trajectory"]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Trajectory:
    """Cubic Hermite curve between written points in time.

    This is the curve that ros2_control's joint_trajectory_controller rebuilds from positions and velocities. Times are
    rounded to whole nanoseconds here and not when saved, so that the curve that was certified is the one in the file.

    Parameters
    ----------
    times
        (m,) seconds, strictly increasing from 0, m >= 1; a single point is a motion of duration 0.
    q
        (m, n) positions in radians or metres.
    velocities
        (m, n) velocities in rad/s or m/s.
    joint_names
        The n joints, in the order of the columns.
    limits_note
        Where the limits it was timed for come from, in words.

    Raises
    ------
    InputError
        For a wrong shape, a number that is not finite, bad joint names, times that do not start at 0 or do not
        increase by a nanosecond at least, or a single point that moves.
    """

    times: Array
    q: Array
    velocities: Array
    joint_names: tuple[str, ...]
    limits_note: str = ""

    def __init__(
        self,
        times: npt.ArrayLike,
        q: npt.ArrayLike,
        velocities: npt.ArrayLike,
        joint_names: Iterable[str],
        limits_note: str = "",
    ) -> None:
        names = checked_joint_names(joint_names)
        positions = finite("q", q, (None, len(names)))
        if len(positions) == 0:
            raise InputError("q has no point; a trajectory needs at least one")
        rates = finite("velocities", velocities, positions.shape)
        if len(positions) == 1 and rates.any():
            raise InputError("a trajectory of a single point must be at rest there; its velocity is not zero")
        object.__setattr__(self, "times", read_only(_checked_times(finite("times", times, (len(positions),)))))
        object.__setattr__(self, "q", read_only(positions))
        object.__setattr__(self, "velocities", read_only(rates))
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "limits_note", str(limits_note))

    @classmethod
    def join(cls, *parts: Trajectory) -> Trajectory:
        """The parts one after another in time.

        Raises
        ------
        InputError
            Without parts, or where position or velocity at the end of one is not that at the start of the next.
        """
        if not parts:
            raise InputError("Trajectory.join needs at least one trajectory")
        for i, (first, second) in enumerate(pairwise(parts)):
            ends_meet(first, second, f"parts {i} and {i + 1}")
            jump = np.abs(second.velocities[0] - first.velocities[-1])
            if jump.max() > MEET_TOLERANCE:
                name = first.joint_names[int(jump.argmax())]
                raise InputError(f"parts {i} and {i + 1} meet with different velocities of joint {name!r}")
        clocks, start = [whole_nanoseconds(parts[0].times)], 0
        for previous, part in pairwise(parts):
            start += int(whole_nanoseconds(previous.times)[-1])
            clocks.append(start + whole_nanoseconds(part.times)[1:])
        return cls(
            seconds(np.concatenate(clocks)),
            np.concatenate([parts[0].q, *(part.q[1:] for part in parts[1:])]),
            np.concatenate([parts[0].velocities, *(part.velocities[1:] for part in parts[1:])]),
            parts[0].joint_names,
            "; ".join(dict.fromkeys(part.limits_note for part in parts if part.limits_note)),
        )

    @classmethod
    def load(cls, path: str | Path, joint_names: Iterable[str] | None = None) -> Trajectory:
        """Read what :meth:`save` wrote, or any trajectory_msgs/JointTrajectory as JSON with positions and velocities.

        Parameters
        ----------
        path
            A .json or .csv file.
        joint_names
            The joints and their order wanted; the file's columns are matched by name. Without it, the file's order.

        Raises
        ------
        TrajectoryError
            Naming file and place, for a file that cannot be read, says something else, holds NaN, or has other joints.
        """
        record = trajectory_files.read(path)
        try:
            names = checked_joint_names(record.joint_names)
        except InputError as error:
            raise TrajectoryError(path, str(error), "joint_names") from error
        wanted = names if joint_names is None else checked_joint_names(joint_names)
        if set(wanted) != set(names):
            odd = sorted(set(wanted) ^ set(names))
            raise TrajectoryError(
                path,
                f"the file has the joints {list(names)}, wanted are {list(wanted)}; they differ in {odd}",
                "joint_names",
            )
        order = [names.index(name) for name in wanted]
        try:
            return cls(
                seconds(record.nanoseconds), record.q[:, order], record.velocities[:, order], wanted, record.limits_note
            )
        except InputError as error:
            raise TrajectoryError(path, str(error)) from error

    def save(self, path: str | Path) -> None:
        """Write the trajectory, whole or not at all; every number comes back bit for bit.

        A name ending in .json is written in the shape of trajectory_msgs/JointTrajectory plus one key ``pinproof``
        (interpolant, units, where the limits come from); .csv has a row a point. Accelerations are left out on
        purpose: a controller that finds them rebuilds a quintic, which is not the curve that was checked.

        Raises
        ------
        TrajectoryError
            For another ending, or a place that cannot be written to.
        """
        trajectory_files.write(
            path,
            trajectory_files.Record(
                self.joint_names, whole_nanoseconds(self.times), self.q, self.velocities, self.limits_note
            ),
        )

    def __call__(self, t: npt.ArrayLike) -> Array:
        """The configuration (n,) at time ``t`` in [0, duration], or (N, n) at (N,) of them; InputError outside."""
        return bezier.evaluate(*self._pieces, t)

    def velocity(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) velocities in rad/s or m/s; InputError outside [0, duration]."""
        return bezier.evaluate(self._pieces[0], self._velocity_control, t)

    def acceleration(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) accelerations in rad/s^2 or m/s^2; where they jump, the value after the jump."""
        return bezier.evaluate(self._pieces[0], self._acceleration_control, t)

    def bezier(self) -> tuple[Array, Array]:
        """Knots (k+1,) in seconds and control points (k, 4, n), one piece between neighbouring points."""
        return self._pieces

    @property
    def domain(self) -> tuple[float, float]:
        """(0, duration) in seconds."""
        return 0.0, self.duration

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return float(self.times[-1])

    @property
    def start(self) -> Array:
        """(n,) first configuration."""
        point: Array = self.q[0]
        return point

    @property
    def end(self) -> Array:
        """(n,) last configuration."""
        point: Array = self.q[-1]
        return point

    def max_velocity(self) -> Array:
        """(n,) largest speed of each joint over the whole motion: the extremum of each piece, not of samples."""
        return np.asarray(self.piece_speeds().max(axis=0))

    def max_acceleration(self) -> Array:
        """(n,) largest acceleration of each joint over the whole motion, exactly as :meth:`max_velocity`."""
        return np.asarray(self.piece_accelerations().max(axis=0))

    def piece_speeds(self) -> Array:
        """(k, n) largest speed of each joint on each piece."""
        low, high = bezier.extremes(self._velocity_control)
        return np.maximum(-low, high)

    def piece_accelerations(self) -> Array:
        """(k, n) largest acceleration of each joint on each piece; it is linear there, so it peaks at an end."""
        return np.asarray(np.abs(self._acceleration_control).max(axis=1))

    def range(self) -> tuple[Array, Array]:
        """Least and greatest position (n,) of each joint that the curve takes, between points too."""
        low, high = bezier.extremes(self._pieces[1])
        return low.min(axis=0), high.max(axis=0)

    def is_close(self, other: Trajectory, tolerance: float = 1e-9) -> bool:
        """Whether joints and number of points agree, and times, positions and velocities to ``tolerance``."""
        mine, theirs = (self.times, self.q, self.velocities), (other.times, other.q, other.velocities)
        same = self.joint_names == other.joint_names and self.q.shape == other.q.shape
        return same and all(bool(np.abs(a - b).max() <= tolerance) for a, b in zip(mine, theirs, strict=True))

    @cached_property
    def _pieces(self) -> tuple[Array, Array]:
        if len(self.q) == 1:
            return read_only(np.zeros(2)), read_only(np.stack([self.q] * 4, axis=1))
        return self.times, read_only(bezier.hermite(self.times, self.q, self.velocities))

    @cached_property
    def _velocity_control(self) -> Array:
        """Bernstein coefficients (k, 3, n) of the velocity.

        3 (b2 - b1) / h with b1 = q0 + h v0 / 3, b2 = q1 - h v1 / 3 is 3 (q1 - q0) / h - v0 - v1; taken from the
        points and not from b1 and b2, whose rounding h would magnify.
        """
        if len(self.q) == 1:
            return np.zeros((1, 3, len(self.joint_names)))
        before, after = self.velocities[:-1], self.velocities[1:]
        mean = np.diff(self.q, axis=0) / np.diff(self.times)[:, None]
        return np.stack([before, 3.0 * mean - before - after, after], axis=1)

    @cached_property
    def _acceleration_control(self) -> Array:
        return bezier.derivative(self._pieces[0], self._velocity_control)

    def __reduce__(self) -> tuple[object, ...]:  # pickling would hand back writable arrays
        return Trajectory, (self.times, self.q, self.velocities, self.joint_names, self.limits_note)

    def __repr__(self) -> str:
        return f"Trajectory({self.duration:.6g} s, {len(self.times)} points, {len(self.joint_names)} joints)"


def _checked_times(times: Array) -> Array:
    if abs(times).max() > LONGEST:
        raise InputError(
            f"times reach {abs(times).max():g} s; at most {LONGEST:g} s can be counted in nanoseconds exactly"
        )
    clock = whole_nanoseconds(times)
    if clock[0] != 0:
        raise InputError(f"times must start at 0, not at {times[0]} s")
    steps = np.diff(clock)
    if (steps <= 0).any():
        i = int(np.flatnonzero(steps <= 0)[0])
        raise InputError(f"times must increase by a nanosecond at least; {times[i]} s is followed by {times[i + 1]} s")
    return seconds(clock)
