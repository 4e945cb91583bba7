"""Limits of joints: those for which a motion is timed, the least time that they allow, and the check of a curve.

A curve is compared with its limits by the exact extremes of its polynomial pieces, so that the result holds between
samples too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.common.structs import described, key
from pinproof.errors import InputError, TimingError
from pinproof.model import JointLimits, distinct
from pinproof.motion.curve import Bezier, BezierCurve, Curve, argmax, extremes, parameter_text
from pinproof.spatial import Array, floats

RATE_TOLERANCE = 1e-9
"""Relative excess over a velocity, acceleration or jerk limit that is attributed to rounding."""

# Excess over a position limit (rad or m) that is attributed to rounding, such as the rounding of an IK solution.
POSITION_TOLERANCE = 1e-9

LIMIT_TOLERANCE = 1e-6
"""Rad or m for positions, relative for velocities and accelerations: motion files of other programs are often rounded
to six digits."""

# Rounding errors of a position, in units in the last place. In a piece of nanoseconds, such as between the points of
# two motions that are combined, they are accelerations of thousands of rad/s^2.
ROUNDINGS, EPSILON = 4, float(np.finfo(float).eps)
# rad or m, or per s: the sum of what these errors may change positions, or speeds, in all pieces that they decide.
IMPULSE = 0.01

Quantity = Literal["position", "velocity", "acceleration"]


class MotionLimits(Protocol):
    """The attributes that :func:`~pinproof.motion.time_parametrise` requires; ``arm.limits`` has them.

    The arrays ``lower``, ``upper`` and ``jerk`` (n,) and the texts ``acceleration_source`` and ``jerk_source`` are used
    if they exist.
    """

    @property
    def velocity(self) -> Array:
        """(n,) velocity limits in rad/s or m/s."""

    @property
    def acceleration(self) -> Array:
        """(n,) acceleration limits in rad/s^2 or m/s^2."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Validated limits, (n,) each; jerk may be None. The note states the source of acceleration and jerk limits."""

    velocity: Array
    acceleration: Array
    jerk: Array | None
    lower: Array
    upper: Array
    note: str

    @classmethod
    def of(
        cls, limits: MotionLimits, joint_names: tuple[str, ...], jerk: npt.ArrayLike | Literal["limits"] | None = None
    ) -> Bounds:
        """Validate ``limits`` for the joints of a path; InputError names the joint and the remedy.

        ``jerk`` is None (no limit), ``"limits"`` (use ``limits.jerk``), a number for all joints, or (n,).
        """
        if not hasattr(limits, "velocity"):
            raise InputError(f"limits must be JointLimits, such as arm.limits, not {limits!r:.80}")
        velocity, acceleration = (
            _rates(kind, getattr(limits, kind), joint_names) for kind in ("velocity", "acceleration")
        )
        ends = []
        for kind, unlimited in (("lower", -np.inf), ("upper", np.inf)):
            given = getattr(limits, kind, None)
            n = len(joint_names)
            ends.append(floats(f"limits.{kind}", np.full(n, unlimited) if given is None else given, (n,)))
            if (unknown := np.flatnonzero(np.isnan(ends[-1]))).size:
                name = joint_names[int(unknown[0])]
                raise InputError(
                    f"the {kind} position limit of joint {name!r} is NaN; give it with limits= (inf for none)"
                )
        lower, upper = ends
        source = getattr(limits, "acceleration_source", "") or "as given by the caller"
        note = f"acceleration limits: {source}"
        if jerk is None:
            return cls(velocity, acceleration, None, lower, upper, note)
        if isinstance(jerk, str):
            if jerk != "limits":
                raise InputError(f"jerk must be numbers, None or 'limits', not {jerk!r}")
            if getattr(limits, "jerk", None) is None:
                raise InputError("the limits hold no jerk; give it with jerk=, or in a file of limits")
            jerk, source = limits.jerk, getattr(limits, "jerk_source", "") or source  # type: ignore[attr-defined]
        else:
            jerk, source = np.broadcast_to(jerk, velocity.shape) if np.ndim(jerk) == 0 else jerk, "given by the caller"
        return cls(
            velocity, acceleration, _rates("jerk", jerk, joint_names), lower, upper, f"{note}; jerk limits: {source}"
        )


def _rates(kind: str, value: npt.ArrayLike, joint_names: tuple[str, ...]) -> Array:
    rates = floats(f"limits.{kind}", value, (len(joint_names),))
    for name, rate in zip(joint_names, rates.tolist(), strict=True):
        if not 0.0 < rate < np.inf:
            found = "is not known" if np.isnan(rate) else f"is {rate:g}, which is not positive and finite"
            raise InputError(f"the {kind} limit of joint {name!r} {found}; give it with limits=")
    return rates


def least_times(
    distance: npt.ArrayLike, limits: MotionLimits, *, full_speed: bool = False, by_joint: bool = False
) -> Array:
    """(...,) lower bounds of the times (s) of all motions between two configurations, whatever the path.

    Parameters
    ----------
    distance
        (..., n) distances in rad or m.
    limits
        The limits of the joints, such as :class:`Bounds`; without ``jerk``, there is no jerk limit.
    full_speed
        Whether joints move at their velocity limit from the first instant to the last; by default, they begin and end
        at rest.
    by_joint
        Whether to return the shortest times (..., n) of single joints.

    Notes
    -----
    L. Biagiotti, C. Melchiorri, "Trajectory Planning for Automatic Machines and Robots" (2008), section 3.4, for rest
    at both ends.
    """
    d, v, a = np.abs(distance), limits.velocity, limits.acceleration
    j = getattr(limits, "jerk", None)
    if full_speed:
        times = d / v
    elif j is None:
        times = np.where(d * a < v * v, 2.0 * np.sqrt(d / a), d / v + v / a)
    else:
        # To a speed u and back to rest: 2 (u / a + a / j) if the acceleration limit is reached, else 4 sqrt(u / j). The
        # distance on the way is u times half of this.
        reached = v * j > a * a
        ramps = np.where(reached, v / a + a / j, 2.0 * np.sqrt(v / j))
        cruising = 2.0 * ramps + (d - v * ramps) / v
        speed = 0.5 * a * (np.sqrt((a / j) ** 2 + 4.0 * d / a) - a / j)
        with_limit, without = 2.0 * (speed / a + a / j), 4.0 * np.cbrt(d / (2.0 * j))
        slower = np.where(speed * j >= a * a, with_limit, without)
        times = np.where(d >= v * ramps, cruising, slower)
    return np.asarray(times if by_joint else times.max(axis=-1, initial=0.0))


def rate_excess(trajectory: BezierCurve, bounds: Bounds, further: Sequence[Any] = ()) -> Array:
    """(k,) the factor by which each piece must be slowed down to satisfy the limits of the rates; 1 or less if it does.

    A factor f divides velocities by f, accelerations by f^2 and jerks by f^3. The extremes of the pieces are exact. It
    is infinite if one of the ``further`` constraints (:class:`~pinproof.motion.RateConstraint`) is violated at rest.
    """
    try:
        shares = [limit.excess(trajectory) for limit in further]
    except TimingError:
        return np.full(len(trajectory.bezier().control), np.inf)
    for order, limit in enumerate((bounds.velocity, bounds.acceleration, bounds.jerk), start=1):
        if limit is not None:
            knots, control = trajectory.derivative(order)
            shares.append(Bezier(knots, control / limit).largest(np.ones_like(limit)).max(axis=1) ** (1.0 / order))
    return np.asarray(np.max(shares, axis=0))


def inside_position_limits(trajectory: BezierCurve, bounds: Bounds) -> bool:
    """Whether a motion keeps the position limits, to rounding; the extremes of the pieces are exact."""
    control = trajectory.bezier()[1]
    if ((control.min(axis=(0, 1)) >= bounds.lower) & (control.max(axis=(0, 1)) <= bounds.upper)).all():
        return True  # the hull is inside, and so is the curve
    low, high = trajectory.range()
    inside = (low >= bounds.lower - POSITION_TOLERANCE) & (high <= bounds.upper + POSITION_TOLERANCE)
    return bool(inside.all())


# -- the check of a curve ----------------------------------------------------------------------------------------------


@described(eq=False)
class LimitViolation:
    """A joint that exceeds a limit by more than :data:`LIMIT_TOLERANCE`."""

    joint: str = key("the joint")
    quantity: Quantity = key("the quantity whose limit is exceeded")
    value: float = key("the extreme over the whole curve; of velocity and acceleration the magnitude")
    limit: float = key("the limit that is exceeded", "rad or m, per s or s^2")
    time: float = key("the parameter at which it is reached: seconds on a trajectory, waypoint index on a path")
    q: Array = key("(n,) the configuration there")
    place: str = key("the parameter as text")

    def __str__(self) -> str:
        value, limit = distinct(self.value, self.limit)
        unit = {"position": "rad or m", "velocity": "rad/s or m/s", "acceleration": "rad/s^2 or m/s^2"}[self.quantity]
        return f"{self.joint} reaches a {self.quantity} of {value} at {self.place}; its limit is {limit} ({unit})"


@described(eq=False)
class LimitCheck:
    """The comparison of a curve with joint limits."""

    checked: tuple[Quantity, ...] = key(
        "the quantities that were compared: of a path only the position, and the acceleration only if it is known "
        "for at least one joint, because the default accelerations of :class:`~pinproof.JointLimits` are no limits "
        "of the robot"
    )
    violations: tuple[LimitViolation, ...] = key(
        "at most two for each joint and quantity; empty if the curve is within the limits"
    )
    limits: JointLimits = key("the limits that were stated")
    velocity: Array = key("(n,) the limits that were compared, for the joints of the curve; infinite where none was")
    acceleration: Array = key("(n,) the same of accelerations")
    unknown: Mapping[Quantity, tuple[str, ...]] = key(
        "for a curve with time, the joints whose velocity or acceleration was not compared"
    )

    def __str__(self) -> str:
        if self.violations:
            return "outside the limits: " + "; ".join(map(str, self.violations))
        kinds = " and ".join(filter(None, (", ".join(self.checked[:-1]), self.checked[-1])))
        # A quantity that was not compared is unknown for every joint.
        remark = ", ".join(
            " ".join([f"no {kind} limit is known", *([f"of {', '.join(names)}"] if kind in self.checked else [])])
            for kind, names in self.unknown.items()
        )
        return f"within the limits of {kinds}{f' ({remark})' if remark else ''}"


def check_limits(curve: Curve, limits: JointLimits) -> LimitCheck:
    """Compare a curve with joint limits by the exact extremes of its polynomial pieces.

    Parameters
    ----------
    curve
        Velocities and accelerations are compared if it has a time, such as a :class:`~pinproof.Trajectory`.
    limits
        The limits of the joints of the curve, in the same order.

    Raises
    ------
    InputError
        If the limits are those of another number of joints.
    """
    names = curve.joint_names
    if len(limits) != len(names):
        raise InputError(f"limits are those of {len(limits)} joints; the curve has {len(names)}: {', '.join(names)}")
    timed = hasattr(curve, "duration") and hasattr(curve, "velocity")  # faster than a check of the protocol
    velocity = np.where(np.isnan(limits.velocity) | (not timed), np.inf, limits.velocity)
    # Accelerations that follow from the velocity limit by default say nothing about the robot.
    open_ended = limits.guessed | np.isnan(limits.acceleration) | (not timed)
    acceleration = np.where(open_ended, np.inf, limits.acceleration)
    ranges: list[tuple[Quantity, Array, Array]] = [("position", limits.lower, limits.upper)]
    if timed:
        ranges += [("velocity", -velocity, velocity), ("acceleration", -acceleration, acceleration)]
    pieces = whole = Bezier(*curve.bezier())
    knots, control = whole
    width = np.diff(knots)[:, None]

    def rounding(order: int) -> Array:
        """(k, n) the rounding errors of a derivative of the pieces: each one divides them by the width of the piece."""
        errors = np.full((len(width), 1), ROUNDINGS * EPSILON) * np.abs(whole.control).max(axis=(0, 1))
        for degree in range(whole.degree, whole.degree - order, -1):
            rise = 2.0 * max(degree, 0) * errors
            errors = np.divide(rise, width, out=np.zeros_like(rise), where=width > 0.0)
        return errors

    checked: list[Quantity] = []
    violations: list[LimitViolation] = []
    for order, (quantity, low, high) in enumerate(ranges):
        jump: npt.NDArray[np.bool_] | None = None
        if order:
            # The acceleration is infinite where the velocity jumps by more than its rounding errors.
            if order == 2 and (large := (step := np.abs(control[1:, 0] - control[:-1, -1])) > LIMIT_TOLERANCE).any():
                errors = rounding(1)
                jump = np.zeros((len(width), len(names)), dtype=bool)
                jump[1:] = large & (step > LIMIT_TOLERANCE + errors[1:] + errors[:-1])
            # The pieces of the next derivative.
            pieces = curve.derivative(order) if isinstance(curve, BezierCurve) else pieces.derivative()
        control = pieces.control
        if order and not np.isfinite(high).any():
            continue
        checked.append(quantity)
        slack = LIMIT_TOLERANCE * (np.where(np.isfinite(high), high, 0.0) if order else np.ones(len(names)))
        # Most pieces are inside by their control points; only of the others are the extremes computed.
        inside = (control.min(axis=1) >= low - slack) & (control.max(axis=1) <= high + slack)
        if jump is not None:
            inside &= ~jump
        near = np.flatnonzero(~inside.all(axis=1))
        if not len(near):
            continue
        least, most = extremes(control[near])
        most = most if jump is None else np.where(jump[near], np.inf, most)
        excess = np.maximum(low - least, most - high)
        # An excess that rounding explains is allowed if all of it together has almost no effect.
        tiny = (excess > slack) & (excess <= slack + rounding(order)[near])
        tiny &= (np.where(tiny, excess, 0.0) * width[near]).sum(axis=0) <= IMPULSE
        outside = ~(excess <= slack) & ~tiny  # also true for NaN
        for joint in np.flatnonzero(outside.any(axis=0)):
            rows = outside[:, joint]
            worst = []
            for sign, limit, extreme in ((-1.0, low[joint], -least), (1.0, high[joint], most)):
                k = int(extreme[rows, joint].argmax())
                if not (value := float(extreme[rows, joint][k])) <= sign * limit + slack[joint]:
                    worst.append((value, sign, float(limit), int(near[rows][k])))
            # Both ends of a range can be exceeded; of a rate, the larger magnitude is reported.
            for value, sign, limit, piece in [max(worst)] if order else worst:
                share = argmax(sign * control[piece, :, joint]) if np.isfinite(value) else 0.0
                time = min(float(knots[piece] + share * width[piece, 0]), float(knots[-1]))
                size, bound = (value, abs(limit)) if order else (sign * value, limit)
                place = parameter_text(curve, time)
                violations.append(LimitViolation(names[joint], quantity, size, bound, time, curve(time), place))
    rates: dict[Quantity, Array] = {"velocity": velocity, "acceleration": acceleration}
    unknown = {
        kind: tuple(name for name, limit in zip(names, values, strict=True) if np.isinf(limit))
        for kind, values in rates.items()
        if timed and np.isinf(values).any()
    }
    return LimitCheck(tuple(checked), tuple(violations), limits, velocity, acceleration, unknown)
