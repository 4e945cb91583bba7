"""Constraints of the tcp along a motion: an upright tool, a region, an axis that points at a point.

Each constraint is the condition ``error(arm, q) <= tolerance`` at every configuration of a curve. :func:`certify`
proves it between samples too, and the planners of :mod:`pinproof.planning` plan motions that satisfy it.

A constraint is stated in the frame of the base of its arm, or relative to the tcp of another arm: the joints between
both tcps are a chain like those of one arm. :func:`held_together` states with three of them that two arms hold one
object.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from pinproof._core import Chain
from pinproof._core import PathConstraint as CompiledConstraint
from pinproof.common.structs import described, key
from pinproof.common.validation import require_number
from pinproof.errors import InputError
from pinproof.model import Arm, JointGroup
from pinproof.spatial import SE3, Array, finite, frozen, matrix, rigid

Vector = tuple[float, float, float]

SMALLEST = 1e-6
"""rad or m: the smallest tolerance; rounding errors and the steps of a controller are not far below it."""

ZERO = 1e-9
"""Length below which a vector has no direction."""


@described(kw_only=True)
class TcpConstraint:
    """The part that the constraints share: the tcp, and the frame in which its constraint is stated."""

    arm: str | None = key("the arm of a joint group with several arms", default=None)
    relative_to: str | None = key(
        "another arm of the group, whose tcp is the frame of the constraint in place of the base", default=None
    )

    def chain(self, group: JointGroup) -> Chain:
        """The joints that determine the error, for the compiled core."""
        return group.tcp_chain(self.arm, self.relative_to)

    def _placement(self, group: JointGroup, q: npt.ArrayLike) -> SE3:
        return group.tcp_placement(q, self.arm, self.relative_to)

    def _of(self, text: str) -> str:
        """The text of a constraint, with the arms if they are stated."""
        relative = "" if self.relative_to is None else f" relative to {self.relative_to}"
        return text if self.arm is None else f"{self.arm}{relative}: {text}"


@described(kw_only=True)
class Upright(TcpConstraint):
    """An axis of the tcp stays within an angle of a direction of the base, such as the axis of an open part.

    Raises
    ------
    InputError
        If the tolerance is out of its range, or a vector is zero or not finite.
    """

    name: ClassVar[str] = "upright"
    """The name in messages and files."""
    unit: ClassVar[str] = "rad"
    """The unit of the error and the tolerance."""
    tolerance: float = key("the largest angle between the two, from 1e-6 to below pi/2", "rad")
    axis_in_tcp: Vector = key(
        "the axis in the tcp frame; it is normalised. :meth:`keeping` takes the axis that points up at a configuration",
        default=(0.0, 0.0, 1.0),
    )
    up: Vector = key("the direction in the base frame; it is normalised", default=(0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "tolerance", _angle("Upright.tolerance", self.tolerance))
        object.__setattr__(self, "axis_in_tcp", _unit("Upright.axis_in_tcp", self.axis_in_tcp))
        object.__setattr__(self, "up", _unit("Upright.up", self.up))

    @classmethod
    def keeping(cls, arm: Arm, q: npt.ArrayLike, *, tolerance: float, up: npt.ArrayLike = (0.0, 0.0, 1.0)) -> Upright:
        """Return the constraint with the axis of the tcp that points along ``up`` at q (n,)."""
        axis = arm.forward_kinematics(q).rotation.T @ np.array(_unit("up", up))
        return cls(tolerance=tolerance, axis_in_tcp=_vector(axis), up=_vector(up))

    def error(self, arm: JointGroup, q: npt.ArrayLike) -> float:
        """The angle (rad) at q (n,), by Pinocchio's forward kinematics."""
        return _angle_between(self._placement(arm, q).rotation @ self.axis_in_tcp, np.array(self.up))

    def compiled(self) -> Any:
        """The constraint in the compiled core."""
        return CompiledConstraint.direction(np.array(self.axis_in_tcp), np.array(self.up), self.tolerance)

    def __str__(self) -> str:
        axis = f"tcp axis {_shown(self.axis_in_tcp)}"
        if self.relative_to is not None:
            return self._of(f"{axis} keeps its direction within {math.degrees(self.tolerance):.6g} deg")
        return self._of(f"upright within {math.degrees(self.tolerance):.6g} deg ({axis})")


@described(kw_only=True, eq=False)
class Within(TcpConstraint):
    """A point of the tcp stays within a distance of a box, a plane or a line.

    :meth:`box`, :meth:`plane` and :meth:`line` create it. The region is a box whose sides may be 0 or infinite: a plane
    has no height, a line neither height nor depth.

    Raises
    ------
    InputError
        If the tolerance is out of its range, a number is not finite, or ``low`` exceeds ``high``.
    """

    name: ClassVar[str] = "within"
    """The name in messages and files."""
    unit: ClassVar[str] = "m"
    """The unit of the error and the tolerance."""
    tolerance: float = key("the largest distance of the point from the region, 1e-6 or more", "m")
    base_from_region: SE3 = key("the frame of the region")
    low: Vector = key("the lower corner of the region in its frame; -inf for a side without an end", "m")
    high: Vector = key("the upper corner; inf for a side without an end", "m")
    point_in_tcp: Vector = key("the point (m) in the tcp frame", default=(0.0, 0.0, 0.0))
    shape: str = key("the name of the region in messages", default="region")

    def __post_init__(self) -> None:
        tolerance = float(finite("Within.tolerance", [self.tolerance], (1,))[0])
        if not tolerance >= SMALLEST:
            raise InputError(f"Within.tolerance = {tolerance} m; it must be at least {SMALLEST:g} m")
        # Sides may be 0 or infinite, but a lower end must not exceed the upper one.
        low, high = (np.array(side, dtype=float) for side in (self.low, self.high))
        if low.shape != (3,) or high.shape != (3,) or not (low <= high).all():
            raise InputError(f"Within: low {self.low} and high {self.high} must be 3 numbers (m), low at most high")
        object.__setattr__(self, "tolerance", tolerance)
        object.__setattr__(self, "base_from_region", frozen(rigid("Within.base_from_region", self.base_from_region)))
        object.__setattr__(self, "low", _vector(low))
        object.__setattr__(self, "high", _vector(high))
        object.__setattr__(self, "point_in_tcp", _vector(finite("Within.point_in_tcp", self.point_in_tcp, (3,))))

    @classmethod
    def box(
        cls, base_from_box: SE3, size: npt.ArrayLike, *, tolerance: float, point_in_tcp: npt.ArrayLike = (0, 0, 0)
    ) -> Within:
        """A box with full sides ``size`` (m), centred at its frame."""
        half = finite("size of the box", size, (3,)) / 2
        if (half < 0).any():
            raise InputError(f"size of the box {tuple((2 * half).tolist())}: the sides must be 0 or more")
        return cls(
            tolerance=tolerance, base_from_region=base_from_box, low=_vector(-half), high=_vector(half),
            point_in_tcp=_vector(point_in_tcp), shape="box",
        )  # fmt: skip

    @classmethod
    def plane(
        cls, point: npt.ArrayLike, normal: npt.ArrayLike, *, tolerance: float, point_in_tcp: npt.ArrayLike = (0, 0, 0)
    ) -> Within:
        """The plane through a point (m) of the base frame with a normal."""
        return cls(
            tolerance=tolerance, base_from_region=_frame_at(point, "normal of the plane", normal),
            low=(-np.inf, -np.inf, 0.0), high=(np.inf, np.inf, 0.0), point_in_tcp=_vector(point_in_tcp), shape="plane",
        )  # fmt: skip

    @classmethod
    def line(
        cls,
        point: npt.ArrayLike,
        direction: npt.ArrayLike,
        *,
        tolerance: float,
        point_in_tcp: npt.ArrayLike = (0, 0, 0),
    ) -> Within:
        """The line through a point (m) of the base frame along a direction."""
        return cls(
            tolerance=tolerance, base_from_region=_frame_at(point, "direction of the line", direction),
            low=(0.0, 0.0, -np.inf), high=(0.0, 0.0, np.inf), point_in_tcp=_vector(point_in_tcp), shape="line",
        )  # fmt: skip

    def error(self, arm: JointGroup, q: npt.ArrayLike) -> float:
        """The distance (m) of the point from the region at q (n,), by Pinocchio's forward kinematics."""
        point = self._placement(arm, q).act(np.array(self.point_in_tcp))
        local = self.base_from_region.actInv(point)
        return float(np.linalg.norm(local - np.clip(local, self.low, self.high)))

    def compiled(self) -> Any:
        """The constraint in the compiled core."""
        return CompiledConstraint.region(
            np.array(self.point_in_tcp),
            np.ascontiguousarray(matrix(self.base_from_region)),
            np.array(self.low),
            np.array(self.high),
            self.tolerance,
        )

    def __str__(self) -> str:
        return self._of(f"within {self.tolerance * 1e3:.6g} mm of a {self.shape}")


@described(kw_only=True)
class LookAt(TcpConstraint):
    """An axis of the tcp points at a point of the base frame, such as the axis of a camera.

    Raises
    ------
    InputError
        As :class:`Upright`.
    """

    name: ClassVar[str] = "look_at"
    """The name in messages and files."""
    unit: ClassVar[str] = "rad"
    """The unit of the error and the tolerance."""
    point: Vector = key("the point (m) in the base frame")
    tolerance: float = key(
        "the largest angle between the axis and the direction from the tcp to the point, from 1e-6 to below pi/2", "rad"
    )
    axis_in_tcp: Vector = key("the axis in the tcp frame; it is normalised", default=(0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _vector(finite("LookAt.point", self.point, (3,))))
        object.__setattr__(self, "tolerance", _angle("LookAt.tolerance", self.tolerance))
        object.__setattr__(self, "axis_in_tcp", _unit("LookAt.axis_in_tcp", self.axis_in_tcp))

    def error(self, arm: JointGroup, q: npt.ArrayLike) -> float:
        """The angle (rad) at q (n,), by Pinocchio's forward kinematics; pi if the tcp is at the point."""
        placement = self._placement(arm, q)
        view = np.array(self.point) - placement.translation
        return _angle_between(placement.rotation @ self.axis_in_tcp, view) if np.linalg.norm(view) > ZERO else math.pi

    def compiled(self) -> Any:
        """The constraint in the compiled core."""
        return CompiledConstraint.target(np.array(self.axis_in_tcp), np.array(self.point), self.tolerance)

    def __str__(self) -> str:
        return self._of(f"look at {_shown(self.point)} within {math.degrees(self.tolerance):.6g} deg")


PathConstraint = Upright | Within | LookAt
"""A constraint of the tcp along a motion."""


def held_together(
    arm: str, relative_to: str, pose: SE3, *, tolerance: float, rotation_tolerance: float
) -> tuple[Within, Upright, Upright]:
    """Return the constraints by which the tcps of two arms keep their relative pose, as if they held one object.

    The origin of the tcp of ``arm`` stays within ``tolerance`` (m) of its place in the tcp frame of ``relative_to``,
    which ``pose`` is, and the rotation away from it within ``rotation_tolerance`` (rad, below pi): two of its axes keep
    their direction within an angle of about that divided by the square root of 2. For a rotation by an angle t about a
    unit vector n, an axis e turns by an angle a with sin(a/2)^2 = sin(t/2)^2 (1 - (n . e)^2), and the sum over two
    perpendicular axes is at least sin(t/2)^2.
    """
    turn = require_number("rotation_tolerance", rotation_tolerance, "rad", above=0, below=math.pi)
    given = rigid("pose", pose)
    place = Within.box(given, (0.0, 0.0, 0.0), tolerance=tolerance)
    x, y = (
        Upright(
            tolerance=2.0 * math.asin(math.sin(turn / 2.0) / math.sqrt(2.0)),
            axis_in_tcp=_vector(axis),
            up=_vector(given.rotation @ axis),
            arm=arm,
            relative_to=relative_to,
        )
        for axis in np.eye(3)[:2]
    )
    return replace(place, arm=arm, relative_to=relative_to, shape="point"), x, y


@described(eq=False)
class ConstraintProof:
    """The proof of one constraint over a curve, or the reason why it is not proven."""

    constraint: PathConstraint = key("the constraint")
    largest: float = key(
        "proven upper bound (rad or m) of the error over the whole curve, at most the tolerance; NaN if the "
        "constraint is not proven"
    )
    observed: float = key(
        "the largest error (rad or m) that was computed on the curve: a lower bound of the true largest error"
    )
    intervals: int = key("number of intervals that were checked")
    evidence: Array | None = key(
        "(K, 2) if recorded: start and end of each interval of the parameter on which it was proven", default=None
    )

    def __str__(self) -> str:
        if math.isnan(self.largest):
            return f"{self.constraint}: not proven, at least {amount(self.constraint, self.observed)} is reached"
        return f"{self.constraint}: at most {amount(self.constraint, self.largest)} proven"


@described(eq=False)
class ConstraintViolation:
    """The first violation of a constraint on a curve."""

    constraint: PathConstraint = key("the constraint")
    time: float = key("the curve's parameter: seconds on a trajectory, waypoint index on a path")
    q: Array = key("(n,) the configuration there")
    error: float = key("the error (rad or m) there, above the tolerance")
    satisfied_until: float = key("the parameter up to which the constraint is proven")


@dataclass(frozen=True, eq=False)
class UndecidedConstraint:
    """A span [start, end] of the parameter in which a constraint is neither proven nor violated; error (rad or m)."""

    start: float
    end: float
    constraint: PathConstraint
    error: float


def check_constraints(constraints: Sequence[PathConstraint]) -> tuple[PathConstraint, ...]:
    """Return the constraints as a tuple; InputError if one of them is not a constraint."""
    if isinstance(constraints, (Upright, Within, LookAt)):
        raise InputError("constraints must be a sequence of constraints; write constraints=[...]")
    for each in constraints:
        if not isinstance(each, (Upright, Within, LookAt)):
            raise InputError(f"constraints must be Upright, Within or LookAt, not {type(each).__name__}")
    return tuple(constraints)


def exact_text(constraint: PathConstraint) -> str:
    """Return the constraint as text, exact to the last bit; equal texts mean equal constraints."""
    if isinstance(constraint, Within):
        place = matrix(constraint.base_from_region).tolist()
        numbers = (constraint.tolerance, place, constraint.low, constraint.high, constraint.point_in_tcp)
        return constraint._of(f"within {numbers!r}")
    return repr(constraint)


def amount(constraint: PathConstraint, error: float) -> str:
    """Return an error of a constraint as text: degrees or millimetres, rounded up."""
    if constraint.unit == "rad":
        return f"{_rounded_up(math.degrees(error), 2)} deg"
    return f"{_rounded_up(error * 1e3, 3)} mm"


def _rounded_up(value: float, digits: int) -> str:
    scale = 10.0**digits
    return f"{math.ceil(value * scale * (1 - 1e-12)) / scale:.{digits}f}" if math.isfinite(value) else str(value)


def _angle(name: str, value: float) -> float:
    angle = float(finite(name, [value], (1,))[0])
    if not SMALLEST <= angle < math.pi / 2:
        raise InputError(
            f"{name} = {angle:g} rad ({math.degrees(angle):g} deg); it must be from {SMALLEST:g} rad to below 90 deg, "
            "in radians"
        )
    return angle


def _unit(name: str, value: npt.ArrayLike | Array) -> Vector:
    vector = finite(name, value, (3,))
    largest = float(np.abs(vector).max())
    if largest < ZERO:
        raise InputError(f"{name} is zero; it must be a direction")
    vector = vector / largest  # so that no square overflows
    return _vector(vector / np.linalg.norm(vector))


def _vector(value: npt.ArrayLike) -> Vector:
    x, y, z = np.asarray(value, dtype=float).tolist()
    return (x, y, z)


def _angle_between(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _frame_at(point: npt.ArrayLike, name: str, direction: npt.ArrayLike) -> SE3:
    """Return a frame at a point whose z axis has a given direction."""
    z = np.array(_unit(name, direction))
    x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
    x /= np.linalg.norm(x)
    return SE3(np.column_stack([x, np.cross(z, x), z]), finite("point", point, (3,)))


def _shown(vector: Vector) -> str:
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in np.round(vector, 3)) + ")"
