"""Timed motions in joint space, as they are certified and sent to a controller."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common.results import PLOT_POINTS, Rows, Shown, View, html_plot
from pinproof.common.structs import Accepting, described, key
from pinproof.common.validation import require_positive
from pinproof.errors import InputError, TrajectoryError
from pinproof.model import guess_mark
from pinproof.motion import trajectory_files
from pinproof.motion.curve import MEET_TOLERANCE, Bezier, BezierCurve, checked_joint_names, ends_meet, read_only
from pinproof.motion.limits import MotionLimits
from pinproof.motion.plot import DrawnConstraint, plot_trajectory
from pinproof.motion.trajectory_files import LONGEST, NANO, RATES, Certified, MotionRecord, seconds, whole_nanoseconds
from pinproof.spatial import Array, finite
from pinproof.verifier import curve_digest


@described(eq=False, repr=False)
class Trajectory(BezierCurve, Shown):
    """A Hermite curve between points in time: cubic, or quintic if accelerations are given.

    This is the curve that the joint_trajectory_controller of ros2_control reconstructs with its default interpolation
    (``spline``): linear between points with positions only, cubic with velocities, and quintic with velocities and
    accelerations (ros2_controllers, Trajectory::interpolate_between_points). Hence the presence of accelerations
    changes the curve. Times are rounded to nanoseconds by the constructor and not when the trajectory is saved, so that
    the certified curve is the one in the file.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, joint names are invalid, times do not start at 0 or do not
        increase by at least 1 ns, or a single point has a velocity or acceleration.
    """

    times: Accepting[Array, npt.ArrayLike] = key(
        "(m,) times in seconds, strictly increasing from 0, m >= 1. A single point is a motion of duration 0"
    )
    q: Accepting[Array, npt.ArrayLike] = key("(m, n) positions in radians or metres")
    velocities: Accepting[Array, npt.ArrayLike] = key("(m, n) velocities in rad/s or m/s")
    joint_names: Accepting[tuple[str, ...], Iterable[str]] = key("the n joints, in the order of the columns")
    limits_note: str = key("a text that states the source of the limits", default="")
    accelerations: Accepting[Array | None, npt.ArrayLike | None] = key(
        "(m, n) accelerations in rad/s^2 or m/s^2 of a quintic; None for a cubic, whose acceleration may jump",
        default=None,
        kw_only=True,
    )
    certified: Accepting[tuple[MotionRecord, ...], Iterable[MotionRecord]] = key(
        "the setups with which the parts of the motion were certified; empty if unknown", default=(), kw_only=True
    )

    NUMBERS = ("times", "q", "velocities", "accelerations")

    def __post_init__(self) -> None:
        names = checked_joint_names(self.joint_names)
        positions = finite("q", self.q, (None, len(names)))
        if len(positions) == 0:
            raise InputError("q has no point; a trajectory requires at least one")
        rates, second = finite("velocities", self.velocities, positions.shape), self.accelerations
        second = None if second is None else finite("accelerations", second, positions.shape)
        if len(positions) == 1 and (rates.any() or (second is not None and second.any())):
            raise InputError(
                "a trajectory with a single point must be at rest there; its velocity or acceleration is not 0"
            )
        # Times are rounded to nanoseconds here, so that a file holds exactly the curve of memory.
        given = finite("times", self.times, (len(positions),))
        if abs(given).max() > LONGEST:
            raise InputError(
                f"times reach {abs(given).max():g} s; the maximum is {LONGEST:g} s, up to which nanoseconds are exact"
            )
        clock = whole_nanoseconds(given)
        if clock[0] != 0:
            raise InputError(f"times must start at 0, not at {given[0]} s")
        if len(late := np.flatnonzero(np.diff(clock) <= 0)):
            i = int(late[0])
            raise InputError(
                f"times must increase by at least a nanosecond; {given[i]} s is followed by {given[i + 1]} s"
            )
        self._set(times=seconds(clock), q=positions, velocities=rates, accelerations=second)
        self._set(joint_names=names, limits_note=str(self.limits_note), certified=tuple(self.certified))

    @classmethod
    def at_rest(
        cls, q: npt.ArrayLike, joint_names: Iterable[str], duration: float = 0.0, *, quintic: bool = False
    ) -> Trajectory:
        """A rest of ``duration`` (s) at the configuration ``q`` (n,), as a cubic or a quintic."""
        points = np.repeat(finite("q", q, (None,))[None], 2 if duration else 1, axis=0)
        still = np.zeros_like(points)
        times = [0.0, duration][: len(points)]
        return cls(times, points, still, joint_names, accelerations=still if quintic else None)

    @classmethod
    def join(cls, *parts: Trajectory) -> Trajectory:
        """Concatenate trajectories in time.

        Raises
        ------
        InputError
            If there is no trajectory, or position, velocity or acceleration at the end of one differ from those at the
            start of the next one.
        """
        if not parts:
            raise InputError("Trajectory.join requires at least one trajectory")
        if len(parts) == 1 and not parts[0].certified:
            return parts[0]
        for i, (first, second) in enumerate(pairwise(parts)):
            second.refuse_gap_after(first, f"parts {i} and {i + 1}")
        times_ns, start = [whole_nanoseconds(parts[0].times)], 0
        for previous, part in pairwise(parts):
            start += int(whole_nanoseconds(previous.times)[-1])
            times_ns.append(start + whole_nanoseconds(part.times)[1:])
        # The rows of all parts, without the first row of each part after the first one.
        _, q, velocities, *rates = (
            np.concatenate([rows[0], *(row[1:] for row in rows[1:])])
            for rows in zip(*(part._points for part in parts), strict=True)
        )
        note = "; ".join(dict.fromkeys(part.limits_note for part in parts if part.limits_note))
        accelerations = rates[0] if rates else None
        times = seconds(np.concatenate(times_ns))
        return cls(times, q, velocities, parts[0].joint_names, note, accelerations=accelerations)

    def refuse_gap_after(self, before: Trajectory, where: str) -> None:
        """Raise InputError unless the motion continues another one without a jump; ``where`` names both."""
        ends_meet(before, self, where)
        if before.interpolant != self.interpolant:
            both = f"a {before.interpolant} and a {self.interpolant} curve"
            raise InputError(f"{where} are {both}; time both with or both without a jerk limit")
        for kind in RATES:
            last, first = getattr(before, kind), getattr(self, kind)
            if last is not None and (jump := np.abs(first[0] - last[-1])).max() > MEET_TOLERANCE:
                name = self.joint_names[int(jump.argmax())]
                raise InputError(f"{where} have different {kind} of joint {name!r} at the connection")

    def split(self, time: float) -> tuple[Trajectory, Trajectory]:
        """The parts before and after a point at which the motion rests; :meth:`join` restores the trajectory exactly.

        Raises
        ------
        InputError
            If the trajectory has no inner point at this time, or moves there.
        """
        require_positive("time (s)", time, zero=True)
        clock, now = whole_nanoseconds(self.times), round(time * NANO)
        k = int(np.searchsorted(clock, now))
        if not 0 < k < len(clock) - 1 or clock[k] != now:
            raise InputError(f"the trajectory has no point between its ends at {time} s")
        if self.velocities[k].any():
            raise InputError(f"the trajectory moves at {time} s; it can be split only where it rests")
        return self.between(0, k), self.between(k, len(clock) - 1)

    def between(self, first: int, last: int) -> Trajectory:
        """The motion from one of its points to another, by their indices; the arm may move at both."""
        rows = slice(first, last + 1)
        clock = whole_nanoseconds(self.times)[rows]
        return self._with_points(seconds(clock - clock[0]), *(values[rows] for values in self._points[1:]))

    def _with_points(self, times: Array, q: Array, velocities: Array, accelerations: Array | None = None) -> Trajectory:
        """Another motion of the same joints, with the same source of the limits."""
        return Trajectory(times, q, velocities, self.joint_names, self.limits_note, accelerations=accelerations)

    def after(self, time: float) -> Trajectory:
        """The part of the motion after ``time`` (s), where it may move; after its end, a single point.

        Between its points it is the same motion up to rounding.

        Raises
        ------
        InputError
            If the time is negative or not finite, or after the end of a trajectory that does not rest there.
        """
        require_positive("time (s)", time, zero=True)
        if time >= self.duration and any(rates[-1].any() for rates in self._points[2:]):
            names = ", ".join(self.joint_names)
            raise InputError(
                f"the trajectory of {names} ends at {self.duration:.6g} s, still moving; {time:.6g} s is late"
            )
        clock, now = whole_nanoseconds(self.times), round(min(time, self.duration) * NANO)
        at, rows = now / NANO, clock > now
        now_at = (self(at), self.velocity(at), self.acceleration(at))
        points = [np.vstack([state, known[rows]]) for state, known in zip(now_at, self._points[1:], strict=False)]
        return self._with_points(seconds(np.concatenate([[0], clock[rows] - now])), *points)

    def slowed(self, factor: float) -> Trajectory:
        """The same motion with ``factor`` times the duration; accelerations are divided by the square of the factor.

        The curve is evaluated at integer nanoseconds of the new time, so that the image is the same to rounding.

        Raises
        ------
        InputError
            If the factor is below 1, which could violate limits, or not finite.
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
        # The jerk jumps at a knot, so an acceleration evaluated beside it would change a slow segment after a fast one.
        accelerations = None if self.accelerations is None else self.accelerations / factor**2
        return self._with_points(times, q, velocities, accelerations)

    @classmethod
    def load(cls, path: str | Path, joint_names: Iterable[str] | None = None, *, subset: bool = False) -> Trajectory:
        """Read an output of :meth:`save`, or a trajectory_msgs/JointTrajectory with positions and velocities.

        Points with accelerations define a quintic, as in a controller. Points with positions only are refused, because
        the velocity of a linear interpolation jumps.

        Parameters
        ----------
        path
            A .json, .yaml or .csv file.
        joint_names
            The requested joints and their order; columns are matched by name. By default, the joints of the file.
        subset
            If True, the file may contain other joints, such as all joints of the robot. They must not move, because
            a certificate of the motion would not include them.

        Raises
        ------
        TrajectoryError
            If the file cannot be read, has another structure, contains NaN, or has other joints. The message names the
            file and the location.
        """
        record = trajectory_files.read(path)
        try:
            names = checked_joint_names(record.joint_names)
        except InputError as error:
            raise TrajectoryError(path, str(error), "joint_names") from error
        wanted = names if joint_names is None else checked_joint_names(joint_names)
        missing, others = (sorted(set(a) - set(b)) for a, b in ((wanted, names), (names, wanted)))
        if missing or (others and not subset):
            hint = "" if missing else " (subset=True ignores joints that do not move)"
            raise TrajectoryError(
                path,
                f"the file has the joints {list(names)}, the requested ones are {list(wanted)}; they differ in "
                f"{missing + others}{hint}",
                "joint_names",
            )
        for name in others:
            j = names.index(name)
            if np.ptp(record.q[:, j]) or any(rates[:, j].any() for rates in record.rates):
                raise TrajectoryError(path, f"joint {name!r} moves; it cannot be ignored", "joint_names")
        order = [names.index(name) for name in wanted]
        try:
            complete = cls.of_record(record)
            if wanted == names:
                return complete
            ordered = cls.of_record(record.columns(order, wanted))
            # A record is for the curve with this hash, which depends on the order of the joints.
            renamed = {complete.digest(): ordered.digest()}
            return ordered.with_records(
                replace(own, curve=renamed.get(own.curve, own.curve)) for own in complete.certified
            )
        except InputError as error:
            raise TrajectoryError(path, str(error)) from error

    def save(self, path: str | Path, *, certificate: Certified | None = None) -> None:
        """Write the trajectory to a file; :meth:`load` restores every number exactly.

        A .json file has the structure of trajectory_msgs/JointTrajectory and an additional key ``pinproof`` with the
        interpolant, the units and the source of the limits. A .csv file has one row per point. A cubic is written
        without accelerations, because a controller would reconstruct a quintic from them, which is not the certified
        curve. An existing file is only replaced by a complete one.

        Parameters
        ----------
        path
            The file.
        certificate
            The certificate of this trajectory. The file then records the setup of the certificate: the attached bodies,
            the held joints, the obstacles and the margin. By default, the file records :attr:`certified`.

        Raises
        ------
        TrajectoryError
            If the file extension is unknown, or the file cannot be written.
        InputError
            If the certificate is for another motion.
        """
        certified = self.certified
        if certificate is not None:
            if certificate.curve != self.digest():
                raise InputError("the certificate is for another motion; save the motion that was certified")
            certified = (certificate.motion_record(end=self.duration),)
        trajectory_files.write(path, self.record(certified))

    def record(self, certified: tuple[MotionRecord, ...] = ()) -> trajectory_files.Record:
        """The points as they are written to a file."""
        clock, note = whole_nanoseconds(self.times), self.limits_note
        points = self.q, self.velocities, self.accelerations
        return trajectory_files.Record(self.joint_names, clock, *points, note, certified)

    @classmethod
    def of_record(cls, record: trajectory_files.Record) -> Trajectory:
        """The trajectory of the points of a file."""
        points = seconds(record.nanoseconds), record.q, record.velocities
        further = {"accelerations": record.accelerations, "certified": record.certified}
        return cls(*points, record.joint_names, record.limits_note, **further)  # type: ignore[arg-type]

    def digest(self) -> str:
        """The hash of joints, knots and polynomial pieces that certificates contain."""
        return curve_digest(self.joint_names, *self.bezier())

    def with_records(self, certified: Iterable[MotionRecord]) -> Trajectory:
        """The same motion with other records."""
        make, points = self.__reduce__()
        return make(*points, certified=certified)

    def velocity(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) velocities in rad/s or m/s; InputError outside [0, duration]."""
        return self.bezier(1).at(t)

    def acceleration(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) accelerations in rad/s^2 or m/s^2; where they jump, the value after the jump."""
        return self.bezier(2).at(t)

    def jerk(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) jerks within the pieces, in rad/s^3 or m/s^3; the jerk may jump between pieces."""
        return self.bezier(3).at(t)

    def bezier(self, order: int = 0) -> Bezier:
        """Knots (k+1,) in seconds and control points, one piece between consecutive points.

        The curve has (k, 4 or 6, n) control points; ``order`` 1 to 3 selects its derivatives with respect to time.
        """
        return self._jerk if order == 3 else self._derivatives[order]

    derivative = bezier

    @property
    def interpolant(self) -> str:
        """``"cubic"`` or ``"quintic"``: the Hermite curve between the points."""
        return "cubic" if self.accelerations is None else "quintic"

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return float(self.times[-1])

    def max_velocity(self) -> Array:
        """(n,) maximum speed of each joint over the motion, from the exact extremes of the pieces."""
        return np.asarray(self.bezier(1).largest().max(axis=0))

    def max_acceleration(self) -> Array:
        """(n,) maximum acceleration of each joint over the motion, from the exact extremes of the pieces."""
        return np.asarray(self.bezier(2).largest().max(axis=0))

    def max_jerk(self) -> Array:
        """(n,) maximum jerk of each joint; infinite for a joint that moves on a cubic, whose acceleration jumps."""
        if self.accelerations is None:
            return np.where(np.ptp(self.bezier().control, axis=(0, 1)) > 0.0, np.inf, 0.0)
        return np.asarray(self.bezier(3).largest().max(axis=0))

    @cached_property
    def _points(self) -> tuple[Array, ...]:
        """The times, positions, velocities, and the accelerations of a quintic."""
        cubic = self.times, self.q, self.velocities
        return cubic if self.accelerations is None else (*cubic, self.accelerations)

    @cached_property
    def _derivatives(self) -> tuple[Bezier, Bezier, Bezier]:
        """The position, velocity and acceleration as pieces."""
        if len(self.q) == 1:
            position = Bezier(np.zeros(2), np.stack([self.q] * 4, axis=1))
            velocity = Bezier(position.knots, np.zeros((1, 3, len(self.joint_names))))
        else:
            position, velocity = Bezier.hermite(*self._points), Bezier.hermite_slope(*self._points)
        pieces = position, velocity, velocity.derivative()
        for array in (position.knots, *(part.control for part in pieces)):
            read_only(array)
        return pieces

    @cached_property
    def _jerk(self) -> Bezier:
        jerk = self._derivatives[2].derivative()
        read_only(jerk.control)
        return jerk

    def plot(
        self,
        limits: MotionLimits | None = None,
        *,
        jerk: npt.ArrayLike | None = None,
        rate_limits: Sequence[DrawnConstraint] = (),
    ) -> Any:
        """Draw position, velocity, acceleration and jerk of each joint over time, with limits as dashed lines.

        Parameters
        ----------
        limits, jerk, rate_limits
            The limits that are drawn, as for :func:`~pinproof.time_parametrise`. A constraint, such as
            :class:`~pinproof.motion.TorqueLimits`, adds a panel.

        Returns
        -------
        A :class:`matplotlib.figure.Figure`; ``figure.savefig("motion.png")`` writes it.

        Raises
        ------
        InputError
            If a limit has a wrong shape or is not positive.
        """
        return plot_trajectory(self, limits, jerk=jerk, rate_limits=rate_limits)

    def __reduce__(self) -> tuple[Callable[..., Trajectory], tuple[Any, ...]]:
        # default pickling would restore writable arrays
        again = partial(Trajectory, accelerations=self.accelerations, certified=self.certified)
        return again, (self.times, self.q, self.velocities, self.joint_names, self.limits_note)

    def _view(self) -> View:
        points = f"{len(self.times)} points, {self.interpolant}"
        title = f"Trajectory of {self.duration:.4g} s{guess_mark(self.limits_note)}, {points} (rad or m, s)"
        head = f"{self.duration:.6g} s, {points}, {len(self.joint_names)} joints"
        return View(head, self._details(), title=title)

    def _details(self) -> Iterator[object]:
        """The table of joints, the plot, and the source of the limits."""
        columns = ("joint", "start", "end", "lowest", "highest", "largest velocity", "largest acceleration")
        figures = (self.q[0], self.q[-1], *self.range(), self.max_velocity(), self.max_acceleration())
        yield Rows(columns, zip(self.joint_names, *figures, strict=True))
        instants = np.linspace(0.0, self.duration, PLOT_POINTS)
        yield html_plot(instants, dict(zip(self.joint_names, np.asarray(self(instants)).T, strict=True)), "rad or m")
        yield [f"Limits: {self.limits_note}"] if self.limits_note else None
