"""One row of a Denavit-Hartenberg table: one joint, and the matrix that it stands for.

With q the joint's own variable, which is added to ``theta`` (revolute, continuous) or to ``d``
(prismatic), row i moves frame dh_(i-1) to frame dh_i:

- ``standard`` (Denavit and Hartenberg 1955; Spong, Hutchinson and Vidyasagar, "Robot Modeling and Control", eq. 3.10)::

      A = Rz(theta) Tz(d) Tx(a) Rx(alpha)

- ``modified`` (Craig, "Introduction to Robotics", eq. 3.6), where row i holds a_(i-1) and alpha_(i-1)::

      A = Rx(alpha) Tx(a) Rz(theta) Tz(d)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError

__all__ = [
    "CONVENTIONS",
    "DEFAULT_PRISMATIC_VELOCITY",
    "DEFAULT_REVOLUTE_LIMIT",
    "DEFAULT_REVOLUTE_VELOCITY",
    "JOINT_TYPES",
    "DhRow",
    "row_problem",
    "row_transform",
]

Array = npt.NDArray[np.float64]

CONVENTIONS = ("standard", "modified")
JOINT_TYPES = ("revolute", "prismatic", "continuous")

DEFAULT_REVOLUTE_LIMIT = math.pi
"""A revolute row that states no limit turns by this much (rad) to either side: one whole turn."""
DEFAULT_REVOLUTE_VELOCITY = math.pi
"""Speed (rad/s) of a revolute or continuous row that states none: half a turn a second, common for small arms."""
DEFAULT_PRISMATIC_VELOCITY = 1.0
"""Speed (m/s) of a prismatic row that states none: common for linear axes."""
LARGEST = 1e6
"""Metres, radians, m/s, rad/s: beyond it sines lose their digits and products overflow; it is a slip of the pen."""


@dataclass(frozen=True)
class DhRow:
    """One row of a DH table: one joint and the link it moves.

    Parameters
    ----------
    name
        Name of the joint.
    theta, d, a, alpha
        Angles in radians, lengths in metres. ``theta`` of a revolute or continuous row and ``d`` of a prismatic row are
        offsets: the joint's q is added to them.
    joint_type
        ``"revolute"``, ``"prismatic"`` or ``"continuous"`` (revolute without end stops).
    lower, upper
        Limits of q in radians or metres. Revolute rows without them get [-pi, pi]; continuous rows have none
        ([-inf, inf]); prismatic rows must state both, for no stroke is plausible for every arm.
    velocity
        Largest joint speed in rad/s or m/s; pi rad/s and 1 m/s if not stated.

    Raises
    ------
    InputError
        Naming the row and the column that makes no sense.
    """

    name: str
    theta: float
    d: float
    a: float
    alpha: float
    joint_type: str = "revolute"
    # None stands for "not stated" and is replaced before anyone can read it, so readers see floats.
    lower: float = cast(float, None)
    upper: float = cast(float, None)
    velocity: float = cast(float, None)

    def __post_init__(self) -> None:
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        problem = row_problem(values)
        if problem is not None:
            column, reason = problem
            raise InputError(f"DH row {self.name!r}, {column}: {reason}")
        for column, value in {**_defaults(self.joint_type), **_stated(values)}.items():
            object.__setattr__(self, column, value)

    @property
    def is_prismatic(self) -> bool:
        """Whether q is a length along z and not an angle about it."""
        return self.joint_type == "prismatic"


def row_problem(values: dict[str, Any]) -> tuple[str, str] | None:
    """The first thing wrong with the fields of a row: the column and the reason, or None if the row is sound.

    ``values`` holds every field of :class:`DhRow`, with None for a limit or a velocity that is not stated.
    """
    name = values["name"]
    if not isinstance(name, str) or not name or name != name.strip() or not name.isprintable():
        return "name", f"{name!r} is no name; wanted is printable text without spaces at its ends"
    joint_type = values["joint_type"]
    if joint_type not in JOINT_TYPES:
        return "joint_type", f"unknown joint type {joint_type!r}; valid: {', '.join(JOINT_TYPES)}"
    for column in ("theta", "d", "a", "alpha", "lower", "upper", "velocity"):
        value = values[column]
        optional = column in ("lower", "upper", "velocity")
        if value is None and optional:
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            return column, f"{value!r} is not a number"
        # A continuous row reads back its own missing limits as infinities (dataclasses.replace).
        unlimited = joint_type == "continuous" and value == {"lower": -math.inf, "upper": math.inf}.get(column)
        if not math.isfinite(value) and not unlimited:
            return column, f"{value} is not a finite number"
        if abs(value) > LARGEST and not unlimited:
            return column, f"{value} is beyond {LARGEST:g} m, rad, m/s or rad/s, which no arm reaches"
    return _limit_problem(joint_type, values["lower"], values["upper"], values["velocity"])


def _limit_problem(
    joint_type: str, lower: float | None, upper: float | None, velocity: float | None
) -> tuple[str, str] | None:
    for column, value in (("lower", lower), ("upper", upper)):
        if joint_type == "prismatic" and value is None:
            return column, "a prismatic row must state its lower and upper limit in metres"
        if joint_type == "continuous" and value is not None and math.isfinite(value):
            return column, f"a continuous row has no limits, yet {value} is given; make it revolute or leave it out"
    if joint_type != "continuous":
        low = -DEFAULT_REVOLUTE_LIMIT if lower is None else lower
        high = DEFAULT_REVOLUTE_LIMIT if upper is None else upper
        if low > high:
            return "lower", f"the lower limit {low:.17g} lies above the upper limit {high:.17g}"
    if velocity is not None and velocity <= 0:
        return "velocity", f"{velocity:.17g} is no speed; it must be greater than 0"
    return None


def _defaults(joint_type: str) -> dict[str, float]:
    if joint_type == "prismatic":
        return {"velocity": DEFAULT_PRISMATIC_VELOCITY}
    limit = math.inf if joint_type == "continuous" else DEFAULT_REVOLUTE_LIMIT
    return {"lower": -limit, "upper": limit, "velocity": DEFAULT_REVOLUTE_VELOCITY}


def _stated(values: dict[str, Any]) -> dict[str, float]:
    """The numbers that were given, as plain floats (NumPy scalars and integers among them)."""
    return {k: float(v) for k, v in values.items() if v is not None and k not in ("name", "joint_type")}


def row_transform(row: DhRow, convention: str, q: float) -> Array:
    """The (4, 4) matrix A of one row at its joint variable q; the formulas stand at the top of this module."""
    theta, d = (row.theta, row.d + q) if row.is_prismatic else (row.theta + q, row.d)
    ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(row.alpha), math.sin(row.alpha)
    if convention == "standard":
        return np.array(
            [
                [ct, -st * ca, st * sa, row.a * ct],
                [st, ct * ca, -ct * sa, row.a * st],
                [0.0, sa, ca, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
    return np.array(
        [
            [ct, -st, 0.0, row.a],
            [st * ca, ct * ca, -sa, -d * sa],
            [st * sa, ct * sa, ca, d * ca],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
