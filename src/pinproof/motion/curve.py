"""What every curve in joint space can do, and the checks its constructors share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError

__all__ = ["MEET_TOLERANCE", "Curve", "checked_joint_names", "ends_meet", "read_only"]

Array = npt.NDArray[np.float64]

MEET_TOLERANCE = 1e-12
"""How far apart (rad or m, rad/s or m/s) two ends may be that are joined: rounding, not a step the arm would feel."""


@runtime_checkable
class Curve(Protocol):
    """A curve in joint space: a sequence of polynomial pieces over a scalar parameter.

    :class:`~pinproof.motion.JointPath` and :class:`~pinproof.motion.CubicPath` run over a path parameter,
    :class:`~pinproof.motion.Trajectory` over time in seconds.
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

        There is always a piece to look at: a single configuration is one piece of zero width, k = 1.
        """

    def __call__(self, t: npt.ArrayLike) -> Array:
        """The configuration (n,) at a scalar parameter, or (N, n) at (N,) parameters."""


def read_only(array: Array) -> Array:
    """The same array, locked."""
    array.flags.writeable = False
    return array


def checked_joint_names(names: Iterable[str]) -> tuple[str, ...]:
    """Joint names as a tuple.

    Raises
    ------
    InputError
        If there is none, one is no text or empty, or one occurs twice.
    """
    if isinstance(names, str):
        raise InputError(f"joint_names must be a sequence of names, not the single text {names!r}")
    try:
        result: tuple[object, ...] = tuple(names)
    except TypeError as error:
        raise InputError(f"joint_names must be a sequence of names, not {names!r}") from error
    if not result:
        raise InputError("joint_names is empty: a curve needs at least one joint")
    checked: list[str] = []
    for name in result:
        if not isinstance(name, str) or not name:
            raise InputError(f"joint_names must hold non-empty texts; it holds {name!r}")
        if name in checked:
            raise InputError(f"joint_names holds {name!r} twice")
        checked.append(name)
    return tuple(checked)


def ends_meet(first: Curve, second: Curve, where: str) -> None:
    """Check that ``second`` goes on where ``first`` ends.

    Raises
    ------
    InputError
        If their joints differ or their ends lie more than :data:`MEET_TOLERANCE` apart; ``where`` names the two.
    """
    if first.joint_names != second.joint_names:
        raise InputError(f"{where} have different joints: {first.joint_names} and {second.joint_names}")
    gap = np.abs(second.start - first.end)
    joint = int(gap.argmax())
    if gap[joint] > MEET_TOLERANCE:
        raise InputError(
            f"{where} do not meet: joint {first.joint_names[joint]!r} ends at {first.end[joint]} and goes on at "
            f"{second.start[joint]}"
        )
