"""The limits a motion is timed for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.motion.trajectory import Trajectory

__all__ = ["POSITION_TOLERANCE", "RATE_TOLERANCE", "Bounds", "MotionLimits"]

Array = npt.NDArray[np.float64]

RATE_TOLERANCE = 1e-9
"""Relative excess over a velocity or acceleration limit that is taken for rounding."""

POSITION_TOLERANCE = 1e-9
"""Radians or metres beyond a position limit that are taken for rounding: what an inverse kinematics answer carries."""


class MotionLimits(Protocol):
    """What :func:`~pinproof.motion.time_parametrise` asks of limits; ``arm.limits`` is one.

    ``lower`` and ``upper`` (n,) and ``acceleration_source`` (a text) are used where they exist.
    """

    @property
    def velocity(self) -> Array:
        """(n,) largest speeds, rad/s or m/s."""

    @property
    def acceleration(self) -> Array:
        """(n,) largest accelerations, rad/s^2 or m/s^2."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Checked limits, (n,) each, and a note that says where the accelerations come from."""

    velocity: Array
    acceleration: Array
    lower: Array
    upper: Array
    note: str

    @classmethod
    def of(cls, limits: MotionLimits, joint_names: tuple[str, ...]) -> Bounds:
        """Check ``limits`` against the joints of a path; InputError names the joint and the remedy."""
        velocity = _rates("velocity", limits.velocity, joint_names)
        acceleration = _rates("acceleration", limits.acceleration, joint_names)
        lower = _positions("lower", getattr(limits, "lower", None), joint_names, -np.inf)
        upper = _positions("upper", getattr(limits, "upper", None), joint_names, np.inf)
        source = getattr(limits, "acceleration_source", "") or "as given by the caller"
        return cls(velocity, acceleration, lower, upper, f"acceleration limits: {source}")

    def excess(self, trajectory: Trajectory) -> Array:
        """(k,) by which factor each piece must slow down to hold its limits; 1 or less where it does.

        Slowing down by f divides velocities by f and accelerations by f^2.
        """
        speed = (trajectory.piece_speeds() / self.velocity).max(axis=1)
        acceleration = (trajectory.piece_accelerations() / self.acceleration).max(axis=1)
        slower: Array = np.maximum(speed, np.sqrt(acceleration))
        return slower

    @staticmethod
    def too_fast(excess: Array) -> npt.NDArray[np.bool_]:
        """Which pieces exceed a limit by more than :data:`RATE_TOLERANCE`; half of it, for the square root's sake."""
        # written so that NaN is too fast
        return ~(excess <= 1.0 + 0.5 * RATE_TOLERANCE)


def _rates(kind: str, value: object, joint_names: tuple[str, ...]) -> Array:
    rates = _array(kind, value, joint_names)
    for name, rate in zip(joint_names, rates, strict=True):
        if not 0.0 < rate < np.inf:
            known = "is not known" if np.isnan(rate) else f"is {rate:g}, which is not positive and finite"
            raise InputError(f"the {kind} limit of joint {name!r} {known}; give it with limits=")
    return rates


def _positions(kind: str, value: object, joint_names: tuple[str, ...], default: float) -> Array:
    if value is None:
        return np.full(len(joint_names), default)
    positions = _array(kind, value, joint_names)
    for name, position in zip(joint_names, positions, strict=True):
        if np.isnan(position):
            raise InputError(f"the {kind} position limit of joint {name!r} is NaN; give it with limits= (inf for none)")
    return positions


def _array(kind: str, value: object, joint_names: tuple[str, ...]) -> Array:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"limits.{kind} must be numbers, one a joint: {error}") from error
    if array.shape != (len(joint_names),):
        raise InputError(f"limits.{kind} must have the shape ({len(joint_names)},), one a joint; it has {array.shape}")
    return array
