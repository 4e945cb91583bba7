"""The limits a motion is timed for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.motion import bezier
from pinproof.motion.trajectory import Trajectory

__all__ = ["POSITION_TOLERANCE", "RATE_TOLERANCE", "Bounds", "MotionLimits"]

Array = npt.NDArray[np.float64]

RATE_TOLERANCE = 1e-9
"""Relative excess over a limit of velocity, acceleration or jerk that is taken for rounding."""

POSITION_TOLERANCE = 1e-9
"""Radians or metres beyond a position limit that are taken for rounding: what an inverse kinematics answer carries."""


class MotionLimits(Protocol):
    """What :func:`~pinproof.motion.time_parametrise` asks of limits; ``arm.limits`` is one.

    ``lower`` and ``upper`` (n,), ``jerk`` (n,) and the texts ``acceleration_source`` and ``jerk_source`` are used where
    they exist.
    """

    @property
    def velocity(self) -> Array:
        """(n,) largest speeds, rad/s or m/s."""

    @property
    def acceleration(self) -> Array:
        """(n,) largest accelerations, rad/s^2 or m/s^2."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Checked limits, (n,) each, and a note that says where those come from that no URDF has; jerk may be None."""

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
        """Check ``limits`` against the joints of a path; InputError names the joint and the remedy.

        ``jerk`` is None (it does not count), ``"limits"`` (that of the limits), a number for all joints or (n,).
        """
        velocity = _rates("velocity", limits.velocity, joint_names)
        acceleration = _rates("acceleration", limits.acceleration, joint_names)
        lower = _positions("lower", getattr(limits, "lower", None), joint_names, -np.inf)
        upper = _positions("upper", getattr(limits, "upper", None), joint_names, np.inf)
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

    def excess(self, trajectory: Trajectory) -> Array:
        """(k,) by which factor each piece must slow down to hold its limits; 1 or less where it does.

        Slowing down by f divides velocities by f, accelerations by f^2 and jerks by f^3.
        """
        limits = [self.velocity, self.acceleration] + ([] if self.jerk is None else [self.jerk])
        shares = [
            bezier.largest(trajectory.bezier(order)[1] / limit, np.ones_like(limit)).max(axis=1) ** (1.0 / order)
            for order, limit in enumerate(limits, start=1)
        ]
        slower: Array = np.max(shares, axis=0)
        return slower

    @staticmethod
    def too_fast(excess: Array) -> npt.NDArray[np.bool_]:
        """Which pieces exceed a limit by more than :data:`RATE_TOLERANCE`; a third of it, for the roots' sake."""
        # written so that NaN is too fast
        return ~(excess <= 1.0 + RATE_TOLERANCE / 3.0)


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
