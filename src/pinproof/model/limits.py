"""Joint limits: position, velocity, acceleration, and where the last came from."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError, UnknownNameError

__all__ = ["AT_LIMIT", "DEFAULT_RAMP", "JointLimits", "distinct"]

Array = npt.NDArray[np.float64]

DEFAULT_RAMP = 0.5
"""Seconds in which a joint reaches its velocity limit when no acceleration limit is known (URDF has none)."""


AT_LIMIT = 1e-9
"""Rad or m by which a joint value may lie beyond its limit and is taken as the limit: sums of windings, conversions
from degrees and files with 10 digits are off by less."""

DIGITS = 17
"""Significant digits at which any two different doubles look different."""


def distinct(*values: float) -> list[str]:
    """The values as text with the fewest digits, 6 or more, at which those that differ look different."""
    for digits in range(6, DIGITS + 1):
        said = [f"{value:.{digits}g}" for value in values]
        if len(set(said)) == len({float(value) for value in values}):
            return said
    return said


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the n joints of an arm, in joint order.

    Parameters
    ----------
    lower, upper
        (n,) positions in rad or m; -inf and inf for a continuous joint.
    velocity
        (n,) in rad/s or m/s, above 0; NaN where it is not known (timing then asks for it).
    acceleration
        (n,) in rad/s^2 or m/s^2, above 0. By default the velocity limit reached in :data:`DEFAULT_RAMP`.
    acceleration_source
        Where the accelerations come from, for results that depend on them.
    jerk
        (n,) in rad/s^3 or m/s^3, above 0, NaN for a joint of which it is not known; None where it is of none.
    jerk_source
        Where the jerks come from.

    Raises
    ------
    InputError
        If shapes differ, lower > upper, or a velocity, acceleration or jerk is not above 0.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array = None  # type: ignore[assignment]  # filled in below; never None afterwards
    acceleration_source: str = ""
    jerk: Array | None = None
    jerk_source: str = ""

    def __post_init__(self) -> None:
        source = self.acceleration_source or "given by the caller"
        acceleration = self.acceleration
        if acceleration is None:
            acceleration = np.asarray(self.velocity, dtype=float) / DEFAULT_RAMP
            source = f"default: the velocity limit reached in {DEFAULT_RAMP} s (no acceleration limit is known)"
        arrays = {
            "lower": self.lower,
            "upper": self.upper,
            "velocity": self.velocity,
            "acceleration": acceleration,
            **({} if self.jerk is None else {"jerk": self.jerk}),
        }
        for name, value in arrays.items():
            array = np.array(value, dtype=float)
            if array.ndim != 1 or array.shape != np.shape(self.lower):
                raise InputError(f"limits.{name} must have the shape {np.shape(self.lower)}; it has {array.shape}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "acceleration_source", source)
        if self.jerk is not None:
            object.__setattr__(self, "jerk_source", self.jerk_source or "given by the caller")
            if (self.jerk <= 0).any():
                raise InputError("jerk limits must be above 0 (NaN where not known)")
        if np.isnan(self.lower).any() or np.isnan(self.upper).any() or (self.lower > self.upper).any():
            raise InputError(f"limits must hold lower <= upper; they are {self.lower} and {self.upper}")
        if (self.velocity <= 0).any() or (self.acceleration <= 0).any():
            raise InputError("velocity and acceleration limits must be above 0 (NaN where not known)")

    def __len__(self) -> int:
        return len(self.lower)

    def contains(self, q: Array, tolerance: float = 0.0) -> bool:
        """Whether every joint of q (n,) is inside its limits, widened by ``tolerance`` (rad or m)."""
        lower, upper = (self.lower - tolerance, self.upper + tolerance) if tolerance else (self.lower, self.upper)
        inside = (q >= lower) & (q <= upper)  # NaN is not
        return bool(np.count_nonzero(inside) == len(inside))

    def clip(self, q: Array) -> Array:
        """The configuration inside the limits nearest to q (n,)."""
        return np.clip(q, self.lower, self.upper)

    def snap(self, q: Array) -> Array:
        """Q (..., n) with every joint that lies beyond its limit by less than :data:`AT_LIMIT` put at the limit."""
        clipped = self.clip(q)
        return np.asarray(np.where(np.abs(q - clipped) < AT_LIMIT, clipped, q))

    def violations(self, q: Array, joint_names: Sequence[str]) -> list[str]:
        """One sentence for each joint of q (n,) that is outside its limits; empty when all are inside.

        There is no tolerance; :meth:`snap` configurations that come from elsewhere before.
        """
        found = []
        for name, value, low, high in zip(joint_names, q, self.lower, self.upper, strict=True):
            if not low <= value <= high:
                said, lowest, highest = distinct(value, low, high)
                found.append(f"{name} = {said} is outside [{lowest}, {highest}]")
        return found

    def replace(self, joint_names: Sequence[str], ranges: Mapping[str, tuple[float, float]]) -> JointLimits:
        """These limits with the position ranges of some joints changed, by joint name."""
        lower, upper = self.lower.copy(), self.upper.copy()
        for name, bounds in ranges.items():
            if name not in joint_names:
                raise UnknownNameError("joint", name, joint_names, "limits")
            if np.shape(bounds) != (2,):
                raise InputError(f"the limits of joint {name!r} must be (lower, upper), not {bounds!r}")
            low, high = bounds
            index = list(joint_names).index(name)
            lower[index], upper[index] = low, high
        return dataclasses.replace(self, lower=lower, upper=upper)

    def sampling_range(self) -> tuple[Array, Array]:
        """Finite (lower, upper), each (n,): where a joint has no bounds, one turn about 0 (or one metre each way)."""
        lower, upper = self.lower.copy(), self.upper.copy()
        open_below, open_above = np.isinf(lower), np.isinf(upper)
        lower[open_below] = np.where(open_above, -np.pi, upper - 2 * np.pi)[open_below]
        upper[open_above] = np.where(open_below, np.pi, lower + 2 * np.pi)[open_above]
        return lower, upper
