"""Monitoring of a certified motion while a robot executes it.

At each control tick the measured state is compared with the tube of the certificate. With the position error p, the
velocity error w, the acceleration limit a of a joint and the latency L, the state at a time s in [0, L] after the
measurement (q, v) satisfies

    |q(s) - (q + v s)| <= p + w s + a s^2 / 2 .

Tube. Let c be the curve, A the largest acceleration on it, and e(s) = q(s) - c(t + s). Then e differs from the line
through e(0) and e(0) + (v - c'(t)) s by at most p + w s + (a + A) s^2 / 2, so that the state is inside the tube until
the latency has passed if max(|e(0)|, |e(0) + (v - c'(t)) L|) + p + w L + (a + A) L^2 / 2 is at most the tolerance.

Braking. After the latency every joint decelerates such that all stop at the same time, at most T = max (|v| + a L +
w) / a after it, so that the motion is straight in joint space. With the velocity v_L at the beginning, |v_L - v| <= w +
a L, the position is q(L) + v_L r with r in [0, T / 2]. It differs from q + v (L + r) by at most

    p + w L + a L^2 / 2 + (w + a L) T / 2 .

The segment from q to q + v (L + T / 2) with this tolerance of each joint therefore covers the stop, and is certified.

Estimated velocity. The difference quotient of two positions over a tick h is the mean velocity over it, with the errors
of both positions. It differs from the velocity at its end by at most 2 p / h + a h / 2, which is w if it is larger.

Frozen measurement. While q repeats exactly, a joint whose speed was at least u moves by at least u s - a s^2 / 2 in a
time s up to u / a. If the sum since q last changed exceeds the tolerance, q is not the position of the robot.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify, is_proven_free, setup_of
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_positive, require_type
from pinproof.errors import InputError
from pinproof.motion import JointPath, Trajectory, check_limits
from pinproof.spatial import Array, finite, floats

JOINT_TOLERANCE = 0.01
"""rad or m: default deviation of each joint that the tube covers."""

SAMPLES_PER_SECOND, FEWEST, MOST = 200, 50, 4000
"""Configurations of the motion among which the closest one is searched, if the robot is not where it should be."""

REFINED = 33
"""Configurations between two of these samples at which the search continues."""

SIMILAR = 0.25
"""Share of the tolerances: two configurations whose deviations differ by less are similarly close."""

LARGEST = 1e9
"""rad or m, or per s: a larger measurement is invalid."""

LONGEST_STOP = 60.0
"""Seconds. A longer stop is not certified: the velocity, or the acceleration limit, is implausible."""


class MonitorStatus(Enum):
    """The result of a tick."""

    INSIDE = "inside the certified tube"
    OUTSIDE_BRAKING_FREE = "outside the certified tube; braking now is proven collision-free"
    OUTSIDE = "outside the certified tube; braking now is not proven collision-free"
    INVALID = "the measurement is not finite, not later than the last one, or has not changed on a moving robot"
    """A number above 1e9 counts as not finite."""


@described(eq=False)
class MonitorResult(Shown):
    """The result of one control tick."""

    status: MonitorStatus = key("INSIDE; or an alarm: OUTSIDE_BRAKING_FREE, OUTSIDE or INVALID")
    time: float = key("since the start of the motion", "s")
    progress: float = key(
        "the time (s) of the configuration of the motion with which the measurement is compared: ``time``, or the "
        "time of the closest configuration if the robot is early or late"
    )
    deviation: Array = key("(n,) rad or m: the largest deviation of each joint from the motion, within the latency")
    joint: str = key(
        "the joint that leaves the tube farthest in relation to its tolerance; empty if none does", default=""
    )
    excess: float = key("rad or m: by how much this joint leaves the tube; 0 if none does", default=0.0)
    braking: JointPath | None = key(
        "the segment of the stop, from the measurement to the end of the stop; None if the status is INSIDE or INVALID",
        default=None,
    )
    braking_tolerance: Array | None = key(
        "(n,) rad or m: the deviations from the segment that the proof of the stop covers; None without a segment",
        default=None,
    )
    stop: float = key("from the measurement to rest; 0 without a segment", "s", default=0.0)
    q: Array = key(
        "(n,) the measured positions, for :meth:`Monitor.stop_trajectory`; NaN where they are not known",
        default_factory=lambda: np.empty(0),
    )
    dq: Array = key(
        "(n,) the velocities that were measured or estimated from the positions; NaN where they are not known",
        default_factory=lambda: np.empty(0),
    )

    @property
    def inside(self) -> bool:
        """Whether the robot is in the tube until the latency has passed; then the rest of the motion is proven free."""
        return self.status is MonitorStatus.INSIDE

    @property
    def alarm(self) -> bool:
        """Whether the motion must be stopped."""
        return not self.inside

    @property
    def proven(self) -> bool:
        """Whether the rest of the motion, or braking now, is proven collision-free."""
        return self.status in (MonitorStatus.INSIDE, MonitorStatus.OUTSIDE_BRAKING_FREE)

    def __str__(self) -> str:
        text = f"t = {self.time:.4g} s: {self.status.value}"
        if self.status is MonitorStatus.INVALID:
            return f"{text} ({self.joint})" if self.joint else text
        return f"{text}; {self.joint} leaves it by {self.excess:.4g} rad or m" if self.joint else text

    def _view(self) -> View:
        return View(str(self), [self.braking])


class Monitor(Shown):
    """Compares the measured state of a robot with a certified motion, at each tick of a controller.

    Parameters
    ----------
    checker
        The checker for which the motion is proven; it also judges stops.
    trajectory
        The motion. It begins and ends at rest.
    certificate
        The FREE certificate of the motion for ``checker``. Without one, or if it covers smaller deviations than
        ``joint_tolerance``, a smaller margin, or other pairs of bodies than the checker, the motion is certified here.
    joint_tolerance
        rad or m, one number or (n,): the deviations that the tube covers; above 0. Default: the deviations that the
        certificate covers, or 0.01 without one.
    acceleration
        (n,) rad/s^2 or m/s^2 or one number: no joint accelerates faster, also after a failure, and each can brake this
        fast. Default: the limits of the arm.
    latency
        Seconds from a measurement until the brakes act. With at least the time between two ticks, the state is inside
        the tube until the next tick too.
    position_error, velocity_error
        rad or m and rad/s or m/s, one number or (n,): the largest errors of q and dq.

    Raises
    ------
    InputError
        If the certificate is for another motion or setup, the motion does not begin and end at rest, or a setting is
        invalid.
    NotProvenFree
        If the motion is not proven collision-free with the tolerance.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        trajectory: Trajectory,
        *,
        certificate: Certificate | None = None,
        joint_tolerance: npt.ArrayLike | None = None,
        acceleration: npt.ArrayLike | None = None,
        latency: float = 0.0,
        position_error: npt.ArrayLike = 0.0,
        velocity_error: npt.ArrayLike = 0.0,
    ) -> None:
        # the motion and the settings
        n = checker.group.dof
        if not isinstance(trajectory, Trajectory):
            raise InputError(f"a monitor needs a Trajectory, not a {type(trajectory).__name__}; time it first")
        if trajectory.joint_names != checker.group.joint_names:
            raise InputError(f"the motion has the joints {trajectory.joint_names}; the arm {checker.group.joint_names}")
        if trajectory.velocities[[0, -1]].any():
            raise InputError("the motion must begin and end at rest; its first or last velocity is not 0")
        require_positive("latency (s)", latency, zero=True)
        self._checker, self._trajectory, self._latency = checker, trajectory, float(latency)
        limits = checker.group.limits.acceleration if acceleration is None else acceleration
        self._acceleration = per_joint("acceleration", limits, n, above_zero=True)
        self._position_error = per_joint("position_error", position_error, n)
        self._velocity_error = per_joint("velocity_error", velocity_error, n)
        self._certificate, self._tolerance = self._certified(certificate, joint_tolerance)
        # what the state may deviate within the latency beyond what is measured, which the tube must cover
        drift = self._velocity_error * latency + (self._acceleration + trajectory.max_acceleration()) * latency**2 / 2
        self._spread = self._position_error + drift
        if (self._spread >= self._tolerance).any():
            j = int((self._spread / self._tolerance).argmax())
            raise InputError(
                f"within the latency {trajectory.joint_names[j]} may deviate by {self._spread[j]:.4g} rad or m more "
                f"than is measured, but the tube covers {self._tolerance[j]:.4g}; increase joint_tolerance, or lower "
                "latency or the errors"
            )
        # samples for a robot that is early or late, and what is known of the last measurements
        count = int(np.clip(trajectory.duration * SAMPLES_PER_SECOND, FEWEST, MOST))
        self._times = np.linspace(0.0, trajectory.duration, count)
        self._samples = np.asarray(trajectory(self._times))
        self._last: tuple[float, Array] | None = None
        self._changed: tuple[float, Array] | None = None
        self._way = self._moved = self._speed = np.zeros(n)

    def _certified(self, given: Certificate | None, joint_tolerance: npt.ArrayLike | None) -> tuple[Certificate, Array]:
        """Return a FREE certificate of the motion and the tolerance (n,) that it covers."""
        checker, trajectory = self._checker, self._trajectory
        # a given certificate must be for this motion and setup, and counts only if it covers the same pairs
        same = False
        if given is not None:
            require_type("certificate", given, Certificate)
            setup = setup_of(checker)
            if given.curve != trajectory.digest() or given.setup != setup.hash:
                raise InputError("the certificate is for another motion or another setup; certify this motion")
            given.or_raise()
            if given.partings or given.tube is None:
                raise InputError("a certificate with pairs that may touch at the start covers no tube")
            # The hash of the setup contains neither the contacts that a checker allows nor its link meshes.
            pairs = given.pairs, given.excluded, given.notes
            same = pairs == (len(checker.pairs), tuple(checker.excluded), setup.notes)
        # the wanted tolerance, by default the covered one; a certificate for another one is replaced
        covered = np.zeros(checker.group.dof) if given is None or given.tube is None else given.tube.joints
        default = JOINT_TOLERANCE if given is None else covered
        wanted = default if joint_tolerance is None else joint_tolerance
        tolerance = per_joint("joint_tolerance", wanted, checker.group.dof, above_zero=True)
        # A clearance above every margin of the checker holds for pairs with a margin of their own too.
        enough = given is not None and given.clearance >= checker.margins.max(initial=0.0)
        within = given is not None and given.limits is not None
        within = within and not check_limits(trajectory, checker.group.limits).violations
        if given is not None and same and enough and within and (tolerance == covered).all():
            return given, tolerance
        return certify(trajectory, checker, joint_tolerance=tolerance).or_raise(), tolerance

    @property
    def certificate(self) -> Certificate:
        """The certificate of the tube."""
        return self._certificate

    def update(self, time: float, q: npt.ArrayLike, dq: npt.ArrayLike | None = None) -> MonitorResult:
        """Judge the state of the robot at one tick.

        The result is INVALID if a number is not finite, if ``time`` is not later than at the last measurement and has
        not returned to 0 or less, or if q repeats exactly for so long that a joint must have left the tube: it moved
        before, or dq states that it moves.

        Parameters
        ----------
        time
            Seconds since the start of the motion; after its end, the robot must remain at the end.
        q
            (n,) measured positions (rad or m).
        dq
            (n,) measured velocities. Default: the difference quotient of the last two measurements, with the error that
            follows from the acceleration and the position error; at the first tick, and if time has returned to 0 or
            less for the next execution, the velocity of the motion.

        Raises
        ------
        InputError
            If ``time`` is not finite, or a shape is wrong.
        """
        # The measurement: misuse raises, and what a sensor may send is INVALID
        names = self._trajectory.joint_names
        if not isinstance(time, (int, float, np.number)) or not np.isfinite(time):
            raise InputError(f"time = {time!r}; it must be a finite number of seconds")
        at = floats("q", q, (len(names),))
        # Without measured velocities, they follow from the last measurement
        rate, progress = np.zeros(len(names)), min(max(time, 0.0), self._trajectory.duration)
        rate_error = self._velocity_error
        if dq is not None:
            rate = floats("dq", dq, (len(names),))
        elif self._last is None or time <= 0.0 < self._last[0]:
            rate = np.asarray(self._trajectory.velocity(progress))
        elif time > self._last[0]:
            tick = time - self._last[0]
            rate = np.asarray((at - self._last[1]) / tick)
            rate_error = np.maximum(rate_error, 2 * self._position_error / tick + self._acceleration * tick / 2)
        if self._last is not None and time <= self._last[0] and not time <= 0.0 < self._last[0]:
            rate = np.full(len(names), np.nan)  # the clock went back, or a measurement is repeated
        known, rate_known = np.abs(at) < LARGEST, np.abs(rate) < LARGEST  # neither is NaN
        if not (known.all() and rate_known.all()):
            bad = ~(known & rate_known)
            name = "" if known.all() and bad.all() else names[int(bad.argmax())]
            q, dq = np.where(known, at, np.nan), np.where(rate_known, rate, np.nan)
            return MonitorResult(MonitorStatus.INVALID, time, time, np.abs(at), name, np.inf, q=q, dq=dq)
        # A sensor that repeats its values although a joint must have moved
        moved = self._moved_since_change(time, at, rate, measured=dq is not None)
        self._last = time, at
        if (moved > self._tolerance).any():
            name, unknown = names[int((moved / self._tolerance).argmax())], np.full(len(names), np.nan)
            return MonitorResult(MonitorStatus.INVALID, time, time, moved, name, np.inf, q=unknown, dq=unknown)
        # The deviation from the motion at this time or, if the robot is early or late, at the closest configuration
        deviation = self._deviation(progress, at, rate, rate_error)
        if (deviation > self._tolerance).any():
            closest = self._closest(at, progress)
            other = self._deviation(closest, at, rate, rate_error)
            if (other / self._tolerance).max() < (deviation / self._tolerance).max():
                progress, deviation = closest, other
        if (deviation <= self._tolerance).all():
            return MonitorResult(MonitorStatus.INSIDE, time, progress, deviation, q=at, dq=rate)
        # Outside of the tube, the stop from the present state is judged
        j = int((deviation / self._tolerance).argmax())
        path, tolerance, stop = self.stopping(at, rate, rate_error)
        free = self.proves_stop(at, rate, rate_error=rate_error)
        return MonitorResult(
            MonitorStatus.OUTSIDE_BRAKING_FREE if free else MonitorStatus.OUTSIDE,
            time,
            progress,
            deviation,
            names[j],
            float(deviation[j] - self._tolerance[j]),
            path,
            tolerance,
            stop,
            at,
            rate,
        )

    def stopping(self, q: Array, dq: Array, rate_error: Array | None = None) -> tuple[JointPath, Array, float]:
        """Return the segment of a stop from a state, its tolerance (n,) in rad or m, and its duration (s).

        ``rate_error`` (n,) is the largest error of dq, by default the velocity error of the monitor.
        """
        latency, limit = self._latency, self._acceleration
        rate_error = self._velocity_error if rate_error is None else rate_error
        unknown = rate_error + limit * latency  # of the velocity when the brakes act
        braking = float(((np.abs(dq) + unknown) / limit).max())
        end = q + dq * (latency + braking / 2)
        tolerance = self._position_error + rate_error * latency + limit * latency**2 / 2
        tolerance = tolerance + unknown * braking / 2
        path = JointPath([q, end] if (end != q).any() else [q], self._trajectory.joint_names)
        return path, tolerance, latency + braking

    def proves_stop(self, q: Array, dq: Array, error: npt.ArrayLike = 0.0, *, rate_error: Array | None = None) -> bool:
        """Whether a stop is proven collision-free from all positions that differ from q by at most ``error``.

        ``rate_error`` is that of :meth:`stopping`.
        """
        path, tolerance, stop = self.stopping(q, dq, rate_error)
        return stop <= LONGEST_STOP and is_proven_free(
            path, self._checker, joint_tolerance=tolerance + np.asarray(error)
        )

    def start_deviation(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> Array:
        """Return (n,) the deviations of a state from the start of the motion, as shares of the tolerance.

        They are the largest until the latency has passed; the motion may begin if none is above 1. NaN where q or dq is
        not finite.

        Raises
        ------
        InputError
            If a shape is wrong.
        """
        n = len(self._trajectory.joint_names)
        return np.asarray(self._deviation(0.0, floats("q", q, (n,)), floats("dq", dq, (n,))) / self._tolerance)

    def stop_trajectory(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> Trajectory:
        """Return the stop of a result as a motion for a controller: at dq until the latency has passed, then to rest.

        Raises
        ------
        InputError
            If a shape is wrong or a number is not finite.
        """
        n = len(self._trajectory.joint_names)
        at, rate = finite("q", q, (n,)), finite("dq", dq, (n,))
        path, _, stop = self.stopping(at, rate)
        note = "limits: the stop of a monitor"
        if not rate.any():
            return Trajectory([0.0], [at], [rate], path.joint_names, note)
        times, points, rates = [0.0, stop], [at, path.end], [rate, 0 * rate]
        if self._latency > 0.0:
            times.insert(1, self._latency)
            points.insert(1, at + rate * self._latency)
            rates.insert(1, rate)
        return Trajectory(times, points, rates, path.joint_names, note)

    def _moved_since_change(self, time: float, q: Array, dq: Array, *, measured: bool) -> Array:
        """Return (n,) the least distance that each joint must have moved since q last changed, which is 0 if it did."""
        # While q repeats, a joint that moved brakes at its limit at most, unless dq states that it still moves
        before = self._last
        if before is not None and before[0] < time and np.array_equal(q, before[1]):
            step, limit = time - before[0], self._acceleration
            braking = np.minimum(step, self._speed / limit)
            self._moved = self._moved + (self._speed - limit * braking / 2) * braking
            stated = self._way * dq - self._velocity_error if measured else np.zeros(len(q))
            self._speed = np.maximum(np.maximum(self._speed - limit * step, stated), 0.0)
            return np.asarray(self._moved)
        # A sensor that is slower than the ticks repeats q: its speed is that since the change before.
        changed = self._changed
        if not measured and changed is not None and changed[0] < time:
            dq = (q - changed[1]) / (time - changed[0])
        self._changed, self._way, self._moved = (time, q), np.sign(dq), np.zeros(len(q))
        self._speed = np.maximum(np.abs(dq) - self._velocity_error, 0.0)
        return self._moved

    def _deviation(self, progress: float, q: Array, dq: Array, rate_error: Array | None = None) -> Array:
        """Return (n,) the largest deviation of each joint from the motion until the latency has passed."""
        error = q - self._trajectory(progress)
        if self._latency == 0.0:
            return np.asarray(np.abs(error) + self._spread)
        later = error + (dq - self._trajectory.velocity(progress)) * self._latency
        more = 0.0 if rate_error is None else (rate_error - self._velocity_error) * self._latency
        return np.asarray(np.maximum(np.abs(error), np.abs(later)) + self._spread + more)

    def _closest(self, q: Array, time: float) -> float:
        """Return the time of the closest configuration of the motion in relation to the tolerances.

        A motion may pass a configuration several times: of those that are similarly close, the nearest in time counts.
        """
        # The local minima among the samples, then the nearest of these in time
        off = (np.abs(self._samples - q) / self._tolerance).max(axis=1)
        padded = np.concatenate([[np.inf], off, [np.inf]])
        lowest = (off <= padded[:-2]) & (off <= padded[2:]) & (off <= off.min() + SIMILAR)
        found = np.flatnonzero(lowest)
        k = int(found[np.abs(self._times[found] - time).argmin()])
        # Between the samples beside it, the search continues with a smaller step
        times = np.linspace(self._times[max(k - 1, 0)], self._times[min(k + 1, len(self._times) - 1)], REFINED)
        near = (np.abs(np.asarray(self._trajectory(times)) - q) / self._tolerance).max(axis=1)
        return float(times[int(near.argmin())])

    def _view(self) -> View:
        columns = ("joint", "tolerance", "largest drift within the latency", "acceleration")
        rows = zip(self._trajectory.joint_names, self._tolerance, self._spread, self._acceleration, strict=True)
        low, high = float(self._tolerance.min()), float(self._tolerance.max())
        tube = f"{high:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        seconds, latency = f"{self._trajectory.duration:.4g} s", f"latency {self._latency * 1e3:.4g} ms"
        return View(f"{seconds}, tube of {tube} rad or m, {latency}", [Rows(columns, rows)])


def per_joint(name: str, value: npt.ArrayLike, n: int, *, above_zero: bool = False) -> Array:
    """(n,) values of one number for all joints, or of one for each; InputError if one is below 0."""
    array = finite(name, np.full(n, value) if np.ndim(value) == 0 else value, (n,))
    if (array < 0).any() or (above_zero and not (array > 0).all()):
        raise InputError(f"{name} = {value!r}; it must be {'above 0' if above_zero else '0 or more'}")
    return array
