"""The limits for which a motion is timed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.spatial import Array

RATE_TOLERANCE = 1e-9
"""Relative excess over a velocity, acceleration or jerk limit that is attributed to rounding."""

POSITION_TOLERANCE = 1e-9
"""Excess over a position limit (rad or m) that is attributed to rounding, such as the rounding of an IK solution."""


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


def _rates(kind: str, value: object, joint_names: tuple[str, ...]) -> Array:
    rates = _array(kind, value, joint_names)
    for name, rate in zip(joint_names, rates.tolist(), strict=True):
        if not 0.0 < rate < np.inf:
            found = "is not known" if np.isnan(rate) else f"is {rate:g}, which is not positive and finite"
            raise InputError(f"the {kind} limit of joint {name!r} {found}; give it with limits=")
    return rates


def _positions(kind: str, value: object, joint_names: tuple[str, ...], default: float) -> Array:
    if value is None:
        return np.full(len(joint_names), default)
    positions = _array(kind, value, joint_names)
    for name, position in zip(joint_names, positions.tolist(), strict=True):
        if np.isnan(position):
            raise InputError(f"the {kind} position limit of joint {name!r} is NaN; give it with limits= (inf for none)")
    return positions


def _array(kind: str, value: object, joint_names: tuple[str, ...]) -> Array:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"limits.{kind} must have one number per joint: {error}") from error
    if array.shape != (len(joint_names),):
        raise InputError(f"limits.{kind} must have the shape ({len(joint_names)},); it has {array.shape}")
    return array
