"""The protocol of curves in joint space, and the validation that their constructors share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.motion import bezier
from pinproof.spatial import Array, finite

MEET_TOLERANCE = 1e-12
"""Maximum difference (rad or m, rad/s or m/s) of two ends that are joined: rounding errors only."""


@runtime_checkable
class Curve(Protocol):
    """A curve in joint space: a sequence of polynomial pieces over a scalar parameter.

    :class:`~pinproof.motion.JointPath` and :class:`~pinproof.motion.CubicPath` have a path parameter,
    :class:`~pinproof.motion.Trajectory` has the time in seconds.
    """

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The n joints, in the order of the columns."""

    @property
    def domain(self) -> tuple[float, float]:
        """First and last parameter."""

    @property
    def start(self) -> Array:
        """(n,) first configuration, in radians or metres."""

    @property
    def end(self) -> Array:
        """(n,) last configuration."""

    def bezier(self) -> tuple[Array, Array]:
        """The curve as ``knots`` (k+1,) and control points (k, degree+1, n), see :mod:`pinproof.motion.bezier`.

        There is at least one piece: a single configuration is one piece of zero width, k = 1.
        """

    def __call__(self, t: npt.ArrayLike) -> Array:
        """The configuration (n,) at a scalar parameter, or (N, n) at (N,) parameters."""


@runtime_checkable
class TimedCurve(Curve, Protocol):
    """A curve whose parameter is the time in seconds."""

    @property
    def duration(self) -> float:
        """Seconds from start to end."""

    def velocity(self, t: npt.ArrayLike) -> Array:
        """(n,) or (N, n) velocities in rad/s or m/s."""


class BezierCurve:
    """Domain, ends, evaluation and comparison of a curve that is stored as Bezier pieces."""

    joint_names: tuple[str, ...]
    NUMBERS: ClassVar[tuple[str, ...]] = ()
    """The names of the attributes that :meth:`is_close` compares."""

    def bezier(self) -> tuple[Array, Array]:
        """Knots (k+1,) and control points (k, degree+1, n)."""
        raise NotImplementedError

    def __call__(self, t: npt.ArrayLike) -> Array:
        """The configuration (n,) at ``t`` in the domain, or (N, n) at (N,) of them; InputError outside."""
        return bezier.evaluate(*self.bezier(), t)

    @property
    def domain(self) -> tuple[float, float]:
        """First and last parameter."""
        knots, _ = self.bezier()
        return float(knots[0]), float(knots[-1])

    @property
    def start(self) -> Array:
        """(n,) first configuration."""
        point: Array = self.bezier()[1][0, 0]
        return point

    @property
    def end(self) -> Array:
        """(n,) last configuration."""
        point: Array = self.bezier()[1][-1, -1]
        return point

    def is_close(self, other: BezierCurve, tolerance: float = 1e-9) -> bool:
        """Whether the joints are the same, and all numbers that define the curves agree to ``tolerance``."""

        def agree(a: npt.ArrayLike | None, b: npt.ArrayLike | None) -> bool:
            if a is None or b is None or np.shape(a) != np.shape(b):
                return a is b
            return bool(np.abs(np.subtract(a, b)).max(initial=0.0) <= tolerance)

        same = type(self) is type(other) and self.joint_names == other.joint_names
        return same and all(agree(getattr(self, name), getattr(other, name)) for name in self.NUMBERS)

    def __reduce__(self) -> tuple[Any, ...]:  # default pickling would restore writable arrays
        return type(self), tuple(getattr(self, each.name) for each in fields(self))  # type: ignore[arg-type]


def parameter_text(curve: Curve, parameter: float) -> str:
    """A curve parameter for messages: seconds on a trajectory, waypoint index on a path."""
    return f"t = {parameter:.4g} s" if hasattr(curve, "duration") else f"path parameter {parameter:.4g}"


def read_only(array: Array) -> Array:
    """The same array, set to read-only."""
    array.flags.writeable = False
    return array


def increasing(knots: Array) -> Array:
    """The same knots (k,); InputError unless they increase strictly."""
    if not (np.diff(knots) > 0.0).all():
        i = int(np.flatnonzero(np.diff(knots) <= 0.0)[0])
        raise InputError(f"knots must increase strictly; {knots[i]} is followed by {knots[i + 1]} at index {i + 1}")
    return knots


def checked_joint_names(names: Iterable[str]) -> tuple[str, ...]:
    """Validate joint names and return them as a tuple.

    Raises
    ------
    InputError
        If there is no name, a name is empty or not a string, or a name occurs twice.
    """
    if isinstance(names, str):
        raise InputError(f"joint_names must be a sequence of names, not the single string {names!r}")
    try:
        result: tuple[object, ...] = tuple(names)
    except TypeError as error:
        raise InputError(f"joint_names must be a sequence of names, not {names!r}") from error
    if not result:
        raise InputError("joint_names is empty: a curve needs at least one joint")
    checked: list[str] = []
    for name in result:
        if not isinstance(name, str) or not name:
            raise InputError(f"joint_names must contain non-empty strings; it contains {name!r}")
        if name in checked:
            raise InputError(f"joint_names contains {name!r} twice")
        checked.append(name)
    return tuple(checked)


def refuse_broken(curve: Curve) -> None:
    """Check the pieces of a curve of a class that is not of this package, whose constructors check them themselves.

    Raises
    ------
    InputError
        If shapes differ, a number is not finite, the knots do not increase, or a piece does not begin where the piece
        before it ends, where the arm would jump.
    """
    if isinstance(curve, BezierCurve):
        return
    what = f"bezier() of the {type(curve).__name__}"
    knots, control = curve.bezier()
    points = finite(f"{what}: the control points", control, (None, None, len(curve.joint_names)))
    parameter = finite(f"{what}: the knots", knots, (len(points) + 1,))
    if not points.size:
        raise InputError(f"{what} has no control point; a curve needs at least one piece")
    still = len(points) == 1 and parameter[0] == parameter[1] and not np.ptp(points, axis=1).any()
    if not still:
        increasing(parameter)
    gap = np.abs(points[1:, 0] - points[:-1, -1])
    if gap.max(initial=0.0) > MEET_TOLERANCE:
        k, joint = np.unravel_index(int(gap.argmax()), gap.shape)
        raise InputError(
            f"{what}: {curve.joint_names[joint]} jumps by {gap[k, joint]:.4g} at the knot {parameter[k + 1]:g}"
        )


def ends_meet(first: Curve, second: Curve, where: str) -> None:
    """Check that ``second`` begins at the end of ``first``.

    Raises
    ------
    InputError
        If their joints differ, or their ends differ by more than :data:`MEET_TOLERANCE`; ``where`` names the two.
    """
    if first.joint_names != second.joint_names:
        raise InputError(f"{where} have different joints: {first.joint_names} and {second.joint_names}")
    gap = np.abs(second.start - first.end)
    joint = int(gap.argmax())
    if gap[joint] > MEET_TOLERANCE:
        raise InputError(
            f"{where} do not meet: joint {first.joint_names[joint]!r} ends at {first.end[joint]} and continues at "
            f"{second.start[joint]}"
        )
