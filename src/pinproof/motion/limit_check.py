"""Whether a curve stays within joint limits of position, velocity and acceleration, between samples too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pinproof.errors import InputError
from pinproof.model.limits import JointLimits, distinct
from pinproof.motion import bezier
from pinproof.motion.curve import Curve, parameter_text
from pinproof.motion.trajectory import Trajectory
from pinproof.spatial import Array

LIMIT_TOLERANCE = 1e-6
"""Rad or m for positions, relative for velocities and accelerations: motion files of other programs are often rounded
to six digits."""

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
    """

    checked: tuple[Quantity, ...]
    violations: tuple[LimitViolation, ...]
    limits: JointLimits
    velocity: Array
    acceleration: Array


def check_limits(curve: Curve, limits: JointLimits) -> LimitCheck:
    """Compare a curve with joint limits by the exact extremes of its polynomial pieces.

    Parameters
    ----------
    curve
        Velocities and accelerations are compared if it is a :class:`~pinproof.Trajectory`.
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
    timed = isinstance(curve, Trajectory)
    velocity = np.where(np.isnan(limits.velocity) | (not timed), np.inf, limits.velocity)
    # Accelerations that follow from the velocity limit by default say nothing about the robot.
    unknown = limits.guessed | np.isnan(limits.acceleration) | (not timed)
    acceleration = np.where(unknown, np.inf, limits.acceleration)
    ranges: list[tuple[Quantity, Array, Array, Array]] = [("position", limits.lower, limits.upper, np.ones(len(names)))]
    ranges += [("velocity", -velocity, velocity, velocity), ("acceleration", -acceleration, acceleration, acceleration)]
    checked: list[Quantity] = []
    violations: list[LimitViolation] = []
    for order, (quantity, low, high, scale) in enumerate(ranges):
        if order and not np.isfinite(high).any():
            continue
        checked.append(quantity)
        slack = LIMIT_TOLERANCE * np.where(np.isfinite(scale), scale, 0.0)
        knots, control = curve.bezier(order) if isinstance(curve, Trajectory) else curve.bezier()
        least, most = bezier.hull(control)
        # Most pieces are inside by their control points; only of the others are the extremes computed.
        near = np.flatnonzero(~((least >= low - slack) & (most <= high + slack)).all(axis=1))
        if not len(near):
            continue
        least, most = bezier.extremes(control[near])
        sides = ((-1.0, -least, -low), (1.0, most, high))
        outside = [~(extreme <= limit + slack) for _, extreme, limit in sides]  # also true for NaN
        for joint in np.flatnonzero((outside[0] | outside[1]).any(axis=0)):
            # Both ends of a range can be exceeded; of a rate, the larger magnitude is reported.
            worst = [
                (float(extreme[:, joint].max()), sign, near[int(extreme[:, joint].argmax())])
                for (sign, extreme, _), beyond in zip(sides, outside, strict=True)
                if beyond[:, joint].any()
            ]
            for value, sign, piece in worst if order == 0 else [max(worst)]:
                share = bezier.argmax(sign * control[piece, :, joint])
                time = float(knots[piece] + share * (knots[piece + 1] - knots[piece]))
                q, limit = curve(min(time, float(knots[-1]))), (high if sign > 0 or order else low)[joint]
                size = value if order else sign * value
                found = LimitViolation(names[joint], quantity, size, float(limit), time, q, parameter_text(curve, time))
                violations.append(found)
    return LimitCheck(tuple(checked), tuple(violations), limits, velocity, acceleration)
