"""Curves in joint space: the protocol, and the polynomial pieces as which every curve is represented.

A curve is a sequence of polynomials in the Bernstein basis, :class:`Bezier`: ``knots`` (k+1,) and ``control``
(k, degree+1, n). For a parameter t in [knots[i], knots[i+1]] and u = (t - knots[i]) / (knots[i+1] - knots[i]), piece i
is sum_r C(degree, r) u^r (1-u)^(degree-r) control[i, r]. The n columns are independent (one per joint), in the units of
the curve. A piece of zero width represents the single configuration control[i, 0].

In this basis, a piece is inside the convex hull of its control points, subdivision is exact up to the rounding of
averages, and the coefficients of the derivative are scaled differences.

Source: R. T. Farouki, "The Bernstein polynomial basis: a centennial retrospective", Computer Aided Geometric Design 29
(2012), sections 3 (hull, differences) and 5 (de Casteljau's algorithm).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import fields
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from pinproof.common.results import ByValue
from pinproof.common.structs import described, key
from pinproof.errors import InputError
from pinproof.spatial import Array, finite

MEET_TOLERANCE = 1e-12
"""Maximum difference (rad or m, rad/s or m/s) of two ends that are joined: rounding errors only."""

# Maximum error of an extremum, relative to the largest coefficient, for degrees without a closed form: far above the
# rounding of de Casteljau's averages, far below the tolerance of every limit.
EXTREME_TOLERANCE = 1e-12


# -- the protocol -----------------------------------------------------------------------------------------------------


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
        """The curve as ``knots`` (k+1,) and control points (k, degree+1, n), as in :class:`~pinproof.motion.Bezier`.

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


# -- the representation -----------------------------------------------------------------------------------------------


class Bezier(NamedTuple):
    """Polynomial pieces in the Bernstein basis: piece i is over [knots[i], knots[i+1]].

    Parameters
    ----------
    knots
        (k+1,) parameters at the ends of the pieces.
    control
        (k, degree+1, n) control points.
    """

    knots: Array
    control: Array

    @classmethod
    def hermite(cls, knots: Array, values: Array, slopes: Array, curvatures: Array | None = None) -> Bezier:
        """Hermite pieces with given derivatives (k+1, n) at the knots.

        The pieces are cubic with ``values`` and ``slopes``, and quintic with the second derivatives ``curvatures``. The
        first two (three) points follow from the derivatives at the left end by the differences of the coefficients of
        the derivative (Farouki 2012, 3), the others from those at the right end.
        """
        width = (knots[1:] - knots[:-1])[:, None]
        first, last = values[:-1], values[1:]
        if curvatures is None:
            third = width / 3.0
            return cls(knots, _stacked(first, first + third * slopes[:-1], last - third * slopes[1:], last))
        fifth, square = width / 5.0, width * width / 20.0
        left, right = fifth * slopes[:-1], fifth * slopes[1:]
        second, fourth = 2.0 * left + square * curvatures[:-1], 2.0 * right - square * curvatures[1:]
        return cls(knots, _stacked(first, first + left, first + second, last - fourth, last - right, last))

    @classmethod
    def hermite_slope(cls, knots: Array, values: Array, slopes: Array, curvatures: Array | None = None) -> Bezier:
        """The derivative of the pieces of :meth:`hermite`.

        The outer coefficients are the derivatives at the ends. The middle one follows from the mean slope, which is the
        mean of all coefficients. This uses the points themselves, because differences of inner control points would
        amplify their rounding by 1 / width.
        """
        width = (knots[1:] - knots[:-1])[:, None]
        mean = (values[1:] - values[:-1]) / width
        before, after = slopes[:-1], slopes[1:]
        if curvatures is None:
            return cls(knots, _stacked(before, 3.0 * mean - before - after, after))
        left, right = before + 0.25 * width * curvatures[:-1], after - 0.25 * width * curvatures[1:]
        return cls(knots, _stacked(before, left, 5.0 * mean - before - left - right - after, right, after))

    @property
    def degree(self) -> int:
        """The polynomial degree of the pieces."""
        return int(self.control.shape[1]) - 1

    def at(self, t: npt.ArrayLike) -> Array:
        """(n,) point of the curve at a parameter, or (N, n) points at (N,) of them, by de Casteljau's algorithm.

        The values at both ends of every piece are exactly its end control points. At an inner knot, the later piece is
        used.

        Raises
        ------
        InputError
            If ``t`` is not finite, is outside the domain, or has more than one axis.
        """
        knots, control = self
        try:
            parameter = np.asarray(t, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"the parameter of a curve must be a number: {error}") from error
        if parameter.ndim > 1:
            raise InputError(f"the parameter must be a scalar or have the shape (N,); its shape is {parameter.shape}")
        outside = ~((parameter >= knots[0]) & (parameter <= knots[-1]))  # True for NaN
        if outside.any():
            raise InputError(f"the parameter {parameter[outside][0]} is outside the domain [{knots[0]}, {knots[-1]}]")
        flat = parameter.reshape(-1)
        piece = np.minimum(np.maximum(knots.searchsorted(flat, side="right") - 1, 0), len(control) - 1)
        width = knots[piece + 1] - knots[piece]
        points = self.on(piece, np.divide(flat - knots[piece], width, out=np.zeros_like(flat), where=width > 0.0))
        return points[0] if parameter.ndim == 0 else points

    def on(self, piece: npt.NDArray[np.intp], u: Array) -> Array:
        """(N, n) points at the local parameters ``u`` (N,) in [0, 1] of the given pieces (N,)."""
        return _de_casteljau(self.control[piece], u[:, None])

    def derivative(self) -> Bezier:
        """The derivative with respect to the parameter; zero on a piece of degree 0 or of zero width."""
        knots, control = self
        if self.degree == 0:
            return Bezier(knots, np.zeros_like(control))
        width = (knots[1:] - knots[:-1])[:, None, None]
        rise = self.degree * (control[:, 1:] - control[:, :-1])
        return Bezier(knots, np.divide(rise, width, out=np.zeros_like(rise), where=width > 0.0))

    def elevated(self, degree: int) -> Bezier:
        """The same pieces with the control points of a degree that is at least their own (Farouki 2012, 5.2)."""
        control = self.control
        for n in range(self.degree, degree):
            share = (np.arange(n + 2) / (n + 1))[:, None]
            before = np.concatenate([control[:, :1], control], axis=1)  # the repeated ends have weight 0
            control = share * before + (1.0 - share) * np.concatenate([control, control[:, -1:]], axis=1)
        return Bezier(self.knots, control)

    def largest(self, enough: Array | None = None) -> Array:
        """The maximum magnitude (k, n) per piece and joint, with the accuracy of :func:`extremes`.

        If the hull is not above ``enough`` (n,), the result may be the bound of the hull, which is not smaller.
        """
        size: Array = np.abs(self.control).max(axis=1)
        above = np.ones(len(size), dtype=bool) if enough is None else (~(size <= enough)).any(axis=1)
        if above.any():
            low, high = extremes(self.control[above])
            size[above] = np.maximum(-low, high)
        return size


def split(control: Array, u: float = 0.5) -> tuple[Array, Array]:
    """Subdivide pieces (..., degree+1, n) at the local parameter ``u`` in [0, 1] into left and right parts.

    Each control point is a convex combination, so that rounding errors are not amplified (Farouki 2012, 5.1).
    """
    left, right = np.empty_like(control), np.empty_like(control)
    rest, last = control, control.shape[-2] - 1
    for r in range(last + 1):
        left[..., r, :] = rest[..., 0, :]
        right[..., last - r, :] = rest[..., -1, :]
        rest = rest[..., :-1, :] * (1.0 - u) + rest[..., 1:, :] * u
    return left, right


def extremes(control: Array) -> tuple[Array, Array]:
    """The minimum and maximum (k, n) of pieces (k, degree+1, n), per piece and joint; bounds for degrees above 3."""
    pieces, points, n = control.shape
    if points > 4:
        # Pieces are subdivided until their hull is within EXTREME_TOLERANCE of a value of the curve (Farouki 2012,
        # sections 3 and 5: the error of a hull decreases to a quarter with each subdivision).
        rows = np.swapaxes(control, 1, 2).reshape(pieces * n, points)
        return -_upper(-rows).reshape(pieces, n), _upper(rows).reshape(pieces, n)
    low = np.minimum(control[:, 0], control[:, -1])
    high = np.maximum(control[:, 0], control[:, -1])
    # The curve at the roots in [0, 1] of the derivative, in closed form, or at any points of [0, 1] where it has none.
    # An error e of a root changes the value by order e^2 only.
    slope = np.diff(control, axis=1)
    roots: list[Array] = []
    if points == 3:
        roots = [_ratio(slope[:, 0], slope[:, 0] - slope[:, 1])]
    elif points == 4:
        # For a u^2 - 2 b u + c, the larger root comes first and the other from their product, without cancellation.
        c = slope[:, 0]
        b = slope[:, 0] - slope[:, 1]
        a = slope[:, 0] - 2.0 * slope[:, 1] + slope[:, 2]
        large = b + np.copysign(np.sqrt(np.maximum(b * b - a * c, 0.0)), b)
        roots = [_ratio(large, a), _ratio(c, large)]
    for u in roots:
        value = _de_casteljau(control, u)
        low, high = np.minimum(low, value), np.maximum(high, value)
    return low, high


def argmax(row: Array) -> float:
    """The local parameter in [0, 1] at which one polynomial with the coefficients ``row`` (degree+1,) is largest.

    It is an end or a root of the derivative. In powers of u, the derivative has the coefficients C(m, j) times the j-th
    differences of its Bernstein coefficients (Farouki 2012, section 3).
    """
    slope, m = np.diff(row), len(row) - 2
    powers = [math.comb(m, j) * float(np.diff(slope, j)[0]) for j in range(m + 1)]
    candidates = np.concatenate([[0.0, 1.0], np.clip(np.roots(powers[::-1]).real, 0.0, 1.0)])
    values = _de_casteljau(np.tile(row[:, None], (len(candidates), 1, 1)), candidates[:, None])[:, 0]
    return float(candidates[values.argmax()])


def _stacked(*points: Array) -> Array:
    """(k, r, n) the r control points (k, n) of each piece; as np.stack, in a third of its time."""
    k, n = points[0].shape
    control = np.empty((k, len(points), n))
    for r, point in enumerate(points):
        control[:, r] = point
    return control


def _upper(rows: Array) -> Array:
    """An upper bound (R,) of each polynomial with coefficients ``rows`` (R, degree+1), tight to EXTREME_TOLERANCE."""
    proven, seen = rows.max(axis=1), np.maximum(rows[:, 0], rows[:, -1])
    slack = EXTREME_TOLERANCE * np.abs(rows).max(axis=1)
    owner = np.flatnonzero(proven > seen + slack)
    parts = rows[owner][:, :, None]
    while len(owner):
        left, right = split(parts)
        np.maximum.at(seen, owner, left[:, -1, 0])
        parts, owner = np.concatenate([left, right]), np.concatenate([owner, owner])
        exceeds = parts.max(axis=(1, 2)) > seen[owner] + slack[owner]
        parts, owner = parts[exceeds], owner[exceeds]
    return np.minimum(proven, seen + slack)


def _de_casteljau(control: Array, u: Array) -> Array:
    """One point per piece; ``u`` is broadcast to (k, n)."""
    weight = u[:, None, :]
    while control.shape[1] > 1:
        control = control[:, :-1] * (1.0 - weight) + control[:, 1:] * weight
    return control[:, 0]


def _ratio(numerator: Array, denominator: Array) -> Array:
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.clip(np.nan_to_num(numerator / denominator, nan=0.0), 0.0, 1.0)


class BezierCurve(ByValue):
    """Domain, ends, evaluation and comparison of a curve that is stored as Bezier pieces."""

    joint_names: tuple[str, ...]
    NUMBERS: ClassVar[tuple[str, ...]] = ()
    """The names of the attributes that :meth:`is_close` compares."""

    def bezier(self) -> Bezier:
        """Knots (k+1,) and control points (k, degree+1, n)."""
        return self._pieces

    @cached_property
    def _pieces(self) -> Bezier:
        raise NotImplementedError

    def derivative(self, order: int) -> Bezier:
        """The derivative of an order with respect to the parameter."""
        pieces = Bezier(*self.bezier())
        for _ in range(order):
            pieces = pieces.derivative()
        return pieces

    def __call__(self, t: npt.ArrayLike) -> Array:
        """The configuration (n,) at ``t`` in the domain, or (N, n) at (N,) of them; InputError outside."""
        return Bezier(*self.bezier()).at(t)

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

    def range(self) -> tuple[Array, Array]:
        """Minimum and maximum position (n,) of each joint over the curve."""
        low, high = extremes(self.bezier()[1])
        return low.min(axis=0), high.max(axis=0)

    def is_close(self, other: BezierCurve, tolerance: float = 1e-9) -> bool:
        """Whether the joints are the same, and all numbers that define the curves agree to ``tolerance``."""

        def agree(a: npt.ArrayLike | None, b: npt.ArrayLike | None) -> bool:
            if a is None or b is None or np.shape(a) != np.shape(b):
                return a is b
            return bool(np.abs(np.subtract(a, b)).max(initial=0.0) <= tolerance)

        same = type(self) is type(other) and self.joint_names == other.joint_names
        return same and all(agree(getattr(self, name), getattr(other, name)) for name in self.NUMBERS)

    def __reduce__(self) -> tuple[Any, ...]:  # default pickling would restore writable arrays
        return type(self), tuple(getattr(self, own.name) for own in fields(self))  # type: ignore[arg-type]

    def _set(self, **values: object) -> None:
        """Set the fields of a frozen dataclass in its constructor; arrays become read-only."""
        for name, value in values.items():
            object.__setattr__(self, name, read_only(value) if isinstance(value, np.ndarray) else value)


@described(eq=False)
class CurvePart(BezierCurve):
    """A part of a curve with the same parameter; proofs of motions divide curves into such parts."""

    knots: Array = key("(k+1,) as in :class:`Bezier`")
    control: Array = key("(k, degree+1, n) as in :class:`Bezier`")
    joint_names: tuple[str, ...] = key("the n joints, in the order of the columns")

    NUMBERS = ("knots", "control")

    @classmethod
    def of(cls, curve: Curve, first: float, last: float) -> CurvePart:
        """Return the part from ``first`` to ``last``; a single configuration if they are equal."""
        knots, control = curve.bezier()
        names = tuple(curve.joint_names)
        if first >= last:
            here = Bezier(knots, control).at(last)
            return cls(np.array([last, last]), np.stack([here] * control.shape[1])[None], names)
        i = int(np.clip(np.searchsorted(knots, first, side="right") - 1, 0, len(control) - 1))
        j = int(np.clip(np.searchsorted(knots, last, side="left") - 1, 0, len(control) - 1))
        pieces = control[i : j + 1].copy()
        if last < knots[j + 1]:  # split at the end first, which keeps the start of the piece
            pieces[-1] = split(pieces[-1], (last - knots[j]) / (knots[j + 1] - knots[j]))[0]
        if first > knots[i]:
            ends = last if i == j else knots[i + 1]
            pieces[0] = split(pieces[0], (first - knots[i]) / (ends - knots[i]))[1]
        return cls(np.array([first, *knots[i + 1 : j + 1], last]), pieces, names)

    @cached_property
    def _pieces(self) -> Bezier:
        return Bezier(self.knots, self.control)

    def reversed(self) -> CurvePart:
        """The same image from end to start, over the same domain."""
        knots = self.knots[0] + self.knots[-1] - self.knots[::-1]
        return CurvePart(knots, self.control[::-1, ::-1], self.joint_names)


# -- validation -------------------------------------------------------------------------------------------------------


def parameter_text(curve: Curve, parameter: float) -> str:
    """A curve parameter for messages: seconds on a trajectory, waypoint index on a path."""
    return f"t = {parameter:.4g} s" if hasattr(curve, "duration") else f"path parameter {parameter:.4g}"


def read_only(array: Array) -> Array:
    """The same array, set to read-only."""
    array.flags.writeable = False
    return array


def increasing(knots: Array) -> Array:
    """The same knots (k,); InputError unless they increase strictly."""
    if len(flat := np.flatnonzero(~(np.diff(knots) > 0.0))):
        i = int(flat[0])
        raise InputError(f"knots must increase strictly; {knots[i]} is followed by {knots[i + 1]} at index {i + 1}")
    return knots


def checked_joint_names(names: Iterable[str]) -> tuple[str, ...]:
    """The joint names as a tuple; InputError if there is none, one is empty or no text, or one occurs twice."""
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
    """Raise InputError unless ``second`` begins at the end of ``first``, with the same joints; ``where`` names them."""
    if first.joint_names != second.joint_names:
        raise InputError(f"{where} have different joints: {first.joint_names} and {second.joint_names}")
    gap = np.abs(second.start - first.end)
    joint = int(gap.argmax())
    if gap[joint] > MEET_TOLERANCE:
        raise InputError(
            f"{where} do not meet: joint {first.joint_names[joint]!r} ends at {first.end[joint]} and continues at "
            f"{second.start[joint]}"
        )
