"""Whether a curve stays within joint limits of position, velocity and acceleration, between samples too."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pinproof.errors import InputError
from pinproof.model import JointLimits, distinct
from pinproof.motion import bezier
from pinproof.motion.curve import Curve, TimedCurve, parameter_text
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import Array

LIMIT_TOLERANCE = 1e-6
"""Rad or m for positions, relative for velocities and accelerations: motion files of other programs are often rounded
to six digits."""

ROUNDINGS = 4
"""Rounding errors of a position, in units in the last place. In a piece of nanoseconds, such as between the points of
two motions that are combined, they are accelerations of thousands of rad/s^2."""

IMPULSE = 0.01
"""rad or m, or per s: the sum of what these errors may change positions, or speeds, in all pieces that they decide."""

Quantity = Literal["position", "velocity", "acceleration"]


@dataclass(frozen=True, eq=False)
class LimitViolation:
    """A joint that exceeds a limit by more than :data:`LIMIT_TOLERANCE`.

    Parameters
    ----------
    joint, quantity, limit
        What is exceeded (rad or m, per s or s^2).
    value
        The extreme over the whole curve; of velocity and acceleration the magnitude.
    time
        The parameter at which it is reached: seconds on a trajectory, waypoint index on a path.
    q
        (n,) the configuration there.
    place
        The parameter as text.
    """

    joint: str
    quantity: Quantity
    value: float
    limit: float
    time: float
    q: Array
    place: str

    def __str__(self) -> str:
        value, limit = distinct(self.value, self.limit)
        unit = {"position": "rad or m", "velocity": "rad/s or m/s", "acceleration": "rad/s^2 or m/s^2"}[self.quantity]
        return f"{self.joint} reaches a {self.quantity} of {value} at {self.place}; its limit is {limit} ({unit})"


@dataclass(frozen=True, eq=False)
class LimitCheck:
    """The comparison of a curve with joint limits.

    Parameters
    ----------
    checked
        The quantities that were compared: of a path only the position, and the acceleration only if it is known for at
        least one joint, because the default accelerations of :class:`~pinproof.JointLimits` are no limits of the robot.
    violations
        At most two for each joint and quantity; empty if the curve is within the limits.
    limits
        The limits that were stated.
    velocity, acceleration
        (n,) those that were compared, in the order of the joints of the curve; infinite where none was.
    unknown
        For a curve with time, the joints whose velocity or acceleration was not compared.
    """

    checked: tuple[Quantity, ...]
    violations: tuple[LimitViolation, ...]
    limits: JointLimits
    velocity: Array
    acceleration: Array
    unknown: Mapping[Quantity, tuple[str, ...]]

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
    timed = isinstance(curve, TimedCurve)
    velocity = np.where(np.isnan(limits.velocity) | (not timed), np.inf, limits.velocity)
    # Accelerations that follow from the velocity limit by default say nothing about the robot.
    open_ended = limits.guessed | np.isnan(limits.acceleration) | (not timed)
    acceleration = np.where(open_ended, np.inf, limits.acceleration)
    ranges: list[tuple[Quantity, Array, Array]] = [("position", limits.lower, limits.upper)]
    ranges += [("velocity", -velocity, velocity), ("acceleration", -acceleration, acceleration)]
    knots, control = curve.bezier()
    width = np.diff(knots)[:, None]
    rounding = np.full((len(width), 1), ROUNDINGS * np.finfo(float).eps) * np.abs(control).max(axis=(0, 1))
    jump = np.zeros_like(rounding, dtype=bool)
    checked: list[Quantity] = []
    violations: list[LimitViolation] = []
    for order, (quantity, low, high) in enumerate(ranges):
        if order:
            # The pieces of the next derivative. The acceleration is infinite where the velocity jumps.
            if order == 2:
                step = np.abs(control[1:, 0] - control[:-1, -1])
                jump = np.pad(step > LIMIT_TOLERANCE + rounding[1:] + rounding[:-1], ((1, 0), (0, 0)))
            rise = 2.0 * bezier.degree(control) * rounding
            rounding = np.divide(rise, width, out=np.zeros_like(rise), where=width > 0.0)
            control = curve.bezier(order)[1] if isinstance(curve, Trajectory) else bezier.derivative(knots, control)
            if not np.isfinite(high).any():
                continue
        checked.append(quantity)
        slack = LIMIT_TOLERANCE * (np.where(np.isfinite(high), high, 0.0) if order else np.ones(len(names)))
        least, most = bezier.hull(control)
        # Most pieces are inside by their control points; only of the others are the extremes computed.
        near = np.flatnonzero(~((least >= low - slack) & (most <= high + slack) & ~jump).all(axis=1))
        if not len(near):
            continue
        least, most = bezier.extremes(control[near])
        most = np.where(jump[near], np.inf, most)
        excess = np.maximum(low - least, most - high)
        # An excess that rounding explains is allowed if all of it together has almost no effect.
        tiny = (excess > slack) & (excess <= slack + rounding[near])
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
                share = bezier.argmax(sign * control[piece, :, joint]) if np.isfinite(value) else 0.0
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
