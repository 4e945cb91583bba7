"""What a method in the table of inverse kinematics is: how one target is asked, how many, how answers are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.spatial import SE3, rigid

__all__ = ["RESTARTS", "TOLERANCE", "Asked", "IkMethod", "Solvers", "Unsuitable", "choose"]

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-6
"""In m and rad: what an answer may be off."""

RESTARTS = 50
"""Attempts after the first where a method may restart; the default of the solvers."""


def as_se3(pose: Array) -> SE3:
    """A target as the methods of this package take it."""
    return rigid("target", pose)


def nothing(_: Array) -> None:
    """Most methods remember nothing."""


class Unsuitable(Exception):
    """A method that cannot be asked for this arm; the message says why. Only ever seen inside this room."""


@dataclass(frozen=True)
class Asked:
    """What is asked of a method: one part of the table."""

    problem: Literal["random", "trajectory"]
    task: Literal["position", "pose"]
    restarts: bool


@dataclass(frozen=True)
class Solvers:
    """A method, ready for one arm.

    Parameters
    ----------
    one
        Called with a target and a start q0 (n,); this call is what is timed.
    read
        The answers (k, n) in what ``one`` returned, none of them where it said no; not timed.
    target
        The target that ``one`` takes, from (4, 4); not timed.
    many
        All targets (N, 4, 4) in one call from q0 (n,): answers (N, k, n), NaN where there is none. One thread.
    begin
        Called with the start before the first call of ``one``, by methods that remember where they are; not timed.
    """

    one: Callable[[Any, Array], Any]
    read: Callable[[Any], Array]
    target: Callable[[Array], Any] = as_se3
    many: Callable[[Array, Array], Array] | None = None
    begin: Callable[[Array], None] = nothing


@dataclass(frozen=True)
class IkMethod:
    """A row of the table.

    Parameters
    ----------
    key, label
        Its name on the command line, and in the table.
    prepare
        The solvers for an arm; None where this part of the table does not fit the method. Raises :class:`Unsuitable`,
        ImportError or an error of its own where the method cannot be had for the arm.
    tolerance
        In m and rad: what its answers may be off.
    textbook
        The textbook's cell: mean in ms, and success as a share.
    rival
        Of a peer: the key of the method of ours that answers the same question.
    most_points
        Targets after which a slow method is stopped.
    distribution
        Of a peer: the package that brings it, for its version.
    """

    key: str
    label: str
    prepare: Callable[[Arm, Asked], Solvers | None]
    tolerance: float = TOLERANCE
    textbook: tuple[float, float] | None = None
    rival: str | None = None
    most_points: int | None = None
    distribution: str | None = None


def choose(keys: tuple[str, ...] | None, methods: tuple[IkMethod, ...]) -> tuple[IkMethod, ...]:
    """The methods of these keys, in the table's order; all of them for None.

    Raises
    ------
    InputError
        For a key that no method has; names those that exist.
    """
    known = [method.key for method in methods]
    unknown = [key for key in keys or () if key not in known]
    if unknown:
        raise InputError(f"no method is called {', '.join(unknown)}; there are {', '.join(known)}")
    return tuple(method for method in methods if keys is None or method.key in keys)
