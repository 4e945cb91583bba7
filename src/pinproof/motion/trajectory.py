"""A timed motion: what a controller is sent, and what a certificate is made for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError, TrajectoryError
from pinproof.motion import bezier, trajectory_files
from pinproof.motion.curve import MEET_TOLERANCE, Array, checked_joint_names, ends_meet, read_only
from pinproof.motion.motion_record import Certified, MotionRecord, records_of
from pinproof.motion.trajectory_files import LONGEST, seconds, whole_nanoseconds
from pinproof.spatial import finite
from pinproof.verifier import curve_digest

__all__ = ["Trajectory"]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Trajectory:
    """Hermite curve between written points in time: cubic, or quintic where accelerations are given.

    This is the curve that ros2_control's joint_trajectory_controller rebuilds with its default interpolation
    (``spline``): between points that bear positions only it goes in a straight line, with velocities too along the
    cubic, and with accelerations too along the quintic that has them at both ends (ros2_controllers, Trajectory::
    interpolate_between_points). So accelerations are not a remark: they choose the curve. Times are rounded to whole
    nanoseconds here and not when saved, so that the curve that was certified is the one in the file.

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
    accelerations
        (m, n) accelerations in rad/s^2 or m/s^2 of a quintic, or None for a cubic, whose accelerations may jump.
    certified
        What the motion, part by part in time, was certified with, as its file records it; empty if nothing is known.

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
    accelerations: Array | None = None
    certified: tuple[MotionRecord, ...] = ()

    def __init__(
        self,
        times: npt.ArrayLike,
        q: npt.ArrayLike,
        velocities: npt.ArrayLike,
        joint_names: Iterable[str],
        limits_note: str = "",
        *,
        accelerations: npt.ArrayLike | None = None,
        certified: Iterable[MotionRecord] = (),
    ) -> None:
        names = checked_joint_names(joint_names)
        positions = finite("q", q, (None, len(names)))
        if len(positions) == 0:
            raise InputError("q has no point; a trajectory needs at least one")
        rates = finite("velocities", velocities, positions.shape)
        second = None if accelerations is None else finite("accelerations", accelerations, positions.shape)
        if len(positions) == 1 and (rates.any() or (second is not None and second.any())):
            raise InputError(
                "a trajectory of a single point must be at rest there; its velocity or acceleration is not 0"
            )
        object.__setattr__(self, "times", read_only(_checked_times(finite("times", times, (len(positions),)))))
        object.__setattr__(self, "q", read_only(positions))
        object.__setattr__(self, "velocities", read_only(rates))
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "limits_note", str(limits_note))
        object.__setattr__(self, "accelerations", None if second is None else read_only(second))
        object.__setattr__(self, "certified", tuple(certified))

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
            if first.interpolant != second.interpolant:
                raise InputError(
                    f"parts {i} and {i + 1} are a {first.interpolant} and a {second.interpolant} curve; time both with "
                    "a jerk limit, or both without"
                )
            for kind in ("velocities", "accelerations"):
                before, after = getattr(first, kind), getattr(second, kind)
                if before is not None and (jump := np.abs(after[0] - before[-1])).max() > MEET_TOLERANCE:
                    name = first.joint_names[int(jump.argmax())]
                    raise InputError(f"parts {i} and {i + 1} meet with different {kind} of joint {name!r}")
        clocks, start = [whole_nanoseconds(parts[0].times)], 0
        for previous, part in pairwise(parts):
            start += int(whole_nanoseconds(previous.times)[-1])
            clocks.append(start + whole_nanoseconds(part.times)[1:])
        curvatures = [part.accelerations for part in parts if part.accelerations is not None]
        return cls(
            seconds(np.concatenate(clocks)),
            _one_after_another([part.q for part in parts]),
            _one_after_another([part.velocities for part in parts]),
            parts[0].joint_names,
            "; ".join(dict.fromkeys(part.limits_note for part in parts if part.limits_note)),
            accelerations=_one_after_another(curvatures) if curvatures else None,
        )

    def slowed(self, factor: float) -> Trajectory:
        """The same motion, ``factor`` times as long: velocities are divided by it, accelerations by its square.

        Points are read off the curve at whole nanoseconds of the new time, so the image is the same to rounding.

        Raises
        ------
        InputError
            If the factor is below 1 or not finite: only slowing down keeps all limits.
        """
        if not 1.0 <= factor < np.inf:
            raise InputError(f"factor = {factor}; it must be 1 or more, and finite")
        if len(self.q) == 1:
            return self
        clock = whole_nanoseconds(self.times)
        factor = math.ceil(factor * int(clock[-1])) / int(clock[-1])
        times = seconds(np.rint(clock * factor))
        then = (times / factor).clip(0.0, self.duration)
        q, velocities = self(then), self.velocity(then) / factor
        q[[0, -1]], velocities[-1] = self.q[[0, -1]], self.velocities[-1] / factor
        accelerations = None if self.accelerations is None else self.acceleration(then) / factor**2
        return Trajectory(times, q, velocities, self.joint_names, self.limits_note, accelerations=accelerations)

    @classmethod
    def load(cls, path: str | Path, joint_names: Iterable[str] | None = None, *, subset: bool = False) -> Trajectory:
        """Read what :meth:`save` wrote, or any trajectory_msgs/JointTrajectory with positions and velocities.

        Points that bear accelerations too make a quintic, as a controller makes of them. Points of positions alone are
        refused: a straight line from each to the next jumps in speed.

        Parameters
        ----------
        path
            A .json, .yaml or .csv file.
        joint_names
            The joints and their order wanted; the file's columns are matched by name. Without it, the file's order.
        subset
            Let the file have other joints too, such as those of the whole robot. They must stand still in it: what
            moves may not be left out of a motion that is to be proven.

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
        missing, others = (sorted(set(a) - set(b)) for a, b in ((wanted, names), (names, wanted)))
        if missing or (others and not subset):
            hint = "" if missing else " (subset=True leaves out joints that stand still)"
            raise TrajectoryError(
                path,
                f"the file has the joints {list(names)}, wanted are {list(wanted)}; they differ in "
                f"{missing + others}{hint}",
                "joint_names",
            )
        for name in others:
            j = names.index(name)
            if np.ptp(record.q[:, j]) or any(rates[:, j].any() for rates in record.rates):
                raise TrajectoryError(path, f"joint {name!r} moves; it cannot be left out", "joint_names")
        order = [names.index(name) for name in wanted]
        try:
            whole = cls._of(record, names, list(range(len(names))))
            return whole if wanted == names else whole._in_order(cls._of(record, wanted, order))
        except InputError as error:
            raise TrajectoryError(path, str(error)) from error

    @classmethod
    def _of(cls, record: trajectory_files.Record, names: tuple[str, ...], columns: list[int]) -> Trajectory:
        """Columns of a file, as the joints that are named."""
        rates = [values[:, columns] for values in record.rates]
        return cls(
            seconds(record.nanoseconds),
            record.q[:, columns],
            rates[0],
            names,
            record.limits_note,
            accelerations=rates[1] if len(rates) > 1 else None,
            certified=record.certified,
        )

    def _in_order(self, other: Trajectory) -> Trajectory:
        """The same motion with its joints in another order; records of this one become records of that one."""
        told = {self.digest(): other.digest()}
        return other.with_records(replace(each, curve=told.get(each.curve, each.curve)) for each in self.certified)

    def save(self, path: str | Path, *, certificate: Certified | None = None) -> None:
        """Write the trajectory, whole or not at all; every number comes back bit for bit.

        A name ending in .json is written in the shape of trajectory_msgs/JointTrajectory plus one key ``pinproof``
        (interpolant, units, where the limits come from); .csv has a row a point. A cubic is written without
        accelerations on purpose: a controller that finds them rebuilds a quintic, which is not the curve that was
        checked.

        Parameters
        ----------
        path
            The file.
        certificate
            The certificate of exactly this trajectory. The file then records what the motion was certified with: the
            attached bodies, the held joints, the obstacles and the margin. Without it, the file records
            :attr:`certified`.

        Raises
        ------
        TrajectoryError
            For another ending, or a place that cannot be written to.
        InputError
            If the certificate is of another motion.
        """
        certified = self.certified if certificate is None else records_of(certificate, self.digest(), self.duration)
        trajectory_files.write(
            path,
            trajectory_files.Record(
                self.joint_names,
                whole_nanoseconds(self.times),
                self.q,
                self.velocities,
                self.accelerations,
                self.limits_note,
                certified,
            ),
        )

    def digest(self) -> str:
        """A hash of joints, knots and polynomial pieces to the last bit, as certificates state it."""
        return curve_digest(self.joint_names, *self.bezier())

    def with_records(self, certified: Iterable[MotionRecord]) -> Trajectory:
        """The same motion with other records of what it was certified with."""
        make, points = self.__reduce__()
        return make(*points, certified=certified)

    def __call__(self, t: npt.ArrayLike) -> Array:
        """The configuration (n,) at time ``t`` in [0, duration], or (N, n) at (N,) of them; InputError outside."""
        return bezier.evaluate(self._knots, self._derivatives[0], t)

    def velocity(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) velocities in rad/s or m/s; InputError outside [0, duration]."""
        return bezier.evaluate(self._knots, self._derivatives[1], t)

    def acceleration(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) accelerations in rad/s^2 or m/s^2; where they jump, the value after the jump."""
        return bezier.evaluate(self._knots, self._derivatives[2], t)

    def jerk(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) derivatives of the acceleration within the pieces, in rad/s^3 or m/s^3; it jumps at points."""
        return bezier.evaluate(self._knots, self._jerk_control, t)

    def bezier(self, order: int = 0) -> tuple[Array, Array]:
        """Knots (k+1,) in seconds and control points, one piece between neighbouring points.

        The curve itself has (k, 4 or 6, n) of them; ``order`` 1 to 3 is for its derivatives by time.
        """
        return self._knots, self._jerk_control if order == 3 else self._derivatives[order]

    @property
    def interpolant(self) -> str:
        """``"cubic"`` or ``"quintic"``: the Hermite curve between the points."""
        return "cubic" if self.accelerations is None else "quintic"

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
        return np.asarray(bezier.largest(self._derivatives[1]).max(axis=0))

    def max_acceleration(self) -> Array:
        """(n,) largest acceleration of each joint over the whole motion, exactly as :meth:`max_velocity`."""
        return np.asarray(bezier.largest(self._derivatives[2]).max(axis=0))

    def max_jerk(self) -> Array:
        """(n,) largest jerk of each joint; infinite for a joint that moves along a cubic, whose acceleration jumps."""
        if self.accelerations is None:
            return np.where(np.ptp(self._derivatives[0], axis=(0, 1)) > 0.0, np.inf, 0.0)
        return np.asarray(bezier.largest(self._jerk_control).max(axis=0))

    def range(self) -> tuple[Array, Array]:
        """Least and greatest position (n,) of each joint that the curve takes, between points too."""
        low, high = bezier.extremes(self._derivatives[0])
        return low.min(axis=0), high.max(axis=0)

    def is_close(self, other: Trajectory, tolerance: float = 1e-9) -> bool:
        """Whether joints, interpolant and number of points agree, and all numbers of the points to ``tolerance``."""
        same = self.joint_names == other.joint_names and self.interpolant == other.interpolant
        return same and all(
            a.shape == b.shape and bool(np.abs(a - b).max() <= tolerance)
            for a, b in zip(self._points, other._points, strict=True)
        )

    @cached_property
    def _points(self) -> tuple[Array, ...]:
        """What a file holds of each point: times, positions, velocities, and accelerations if it is a quintic."""
        cubic = self.times, self.q, self.velocities
        return cubic if self.accelerations is None else (*cubic, self.accelerations)

    @cached_property
    def _knots(self) -> Array:
        return self.times if len(self.q) > 1 else read_only(np.zeros(2))

    @cached_property
    def _derivatives(self) -> tuple[Array, ...]:
        """Control points (k, degree+1-r, n) of the r-th derivative by time, r from 0 to 2."""
        if len(self.q) == 1:
            position, velocity = np.stack([self.q] * 4, axis=1), np.zeros((1, 3, len(self.joint_names)))
        else:
            position, velocity = bezier.hermite(*self._points), bezier.hermite_slope(*self._points)
        acceleration = bezier.derivative(self._knots, velocity)
        return tuple(read_only(control) for control in (position, velocity, acceleration))

    @cached_property
    def _jerk_control(self) -> Array:
        return read_only(bezier.derivative(self._knots, self._derivatives[2]))

    def __reduce__(self) -> tuple[Callable[..., Trajectory], tuple[Any, ...]]:
        # pickling would hand back writable arrays
        again = partial(Trajectory, accelerations=self.accelerations, certified=self.certified)
        return again, (self.times, self.q, self.velocities, self.joint_names, self.limits_note)

    def __repr__(self) -> str:
        points = f"{len(self.times)} points, {self.interpolant}"
        return f"Trajectory({self.duration:.6g} s, {points}, {len(self.joint_names)} joints)"


def _one_after_another(parts: list[Array]) -> Array:
    """Rows of all parts, without the first one of each that goes on from another."""
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


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
