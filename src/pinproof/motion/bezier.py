"""Polynomial pieces in the Bernstein basis: evaluation, subdivision, derivatives and bounds.

A curve is ``knots`` (k+1,) and ``control`` (k, degree+1, n): for a parameter t in [knots[i], knots[i+1]] and
u = (t - knots[i]) / (knots[i+1] - knots[i]), piece i is sum_r C(degree, r) u^r (1-u)^(degree-r) control[i, r].
The n columns are independent (one per joint), in the units of the curve. A piece of zero width represents the single
configuration control[i, 0].

In this basis, a piece is inside the convex hull of its control points, subdivision is exact up to the rounding of
averages, and the coefficients of the derivative are scaled differences.

Source: R. T. Farouki, "The Bernstein polynomial basis: a centennial retrospective", Computer Aided Geometric Design 29
(2012), sections 3 (hull, differences) and 5 (de Casteljau's algorithm).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.spatial import Array

EXTREME_TOLERANCE = 1e-12
"""Maximum error of an extremum, relative to the largest coefficient, for degrees without a closed form: far above the
rounding of de Casteljau's averages, far below the tolerance of every limit."""


def degree(control: Array) -> int:
    """The polynomial degree of the pieces ``control`` (..., degree+1, n)."""
    return int(control.shape[-2]) - 1


def evaluate(knots: Array, control: Array, t: npt.ArrayLike) -> Array:
    """Points of the curve, by de Casteljau's algorithm.

    Parameters
    ----------
    knots, control
        The curve, (k+1,) and (k, degree+1, n).
    t
        A parameter or (N,) parameters in [knots[0], knots[-1]]. At an inner knot, the later piece is used.

    Returns
    -------
    (n,) for a scalar, else (N, n). The values at both ends of every piece are exactly its end control points.

    Raises
    ------
    InputError
        If ``t`` is not finite, is outside the domain, or has more than one axis.
    """
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
    u = np.divide(flat - knots[piece], width, out=np.zeros_like(flat), where=width > 0.0)
    points = on_pieces(control, piece, u)
    return points[0] if parameter.ndim == 0 else points


def on_pieces(control: Array, piece: npt.NDArray[np.intp], u: Array) -> Array:
    """(N, n) points at the local parameters ``u`` (N,) in [0, 1] of the given pieces (N,)."""
    return _de_casteljau(control[piece], u[:, None])


def split(control: Array, u: float = 0.5) -> tuple[Array, Array]:
    """Subdivide every piece at the local parameter ``u`` in [0, 1] into left and right parts, shaped as ``control``.

    Each control point is a convex combination, so that rounding errors are not amplified (Farouki 2012, 5.1).
    """
    left, right = np.empty_like(control), np.empty_like(control)
    rest, last = control, degree(control)
    for r in range(last + 1):
        left[..., r, :] = rest[..., 0, :]
        right[..., last - r, :] = rest[..., -1, :]
        rest = rest[..., :-1, :] * (1.0 - u) + rest[..., 1:, :] * u
    return left, right


def derivative(knots: Array, control: Array) -> Array:
    """Control points (k, degree, n) of the derivative with respect to the parameter, over the same ``knots``.

    The derivative of a piece of degree 0, shape (k, 1, n), or of zero width is zero.
    """
    if degree(control) == 0:
        return np.zeros_like(control)
    width = (knots[1:] - knots[:-1])[:, None, None]
    rise = degree(control) * (control[:, 1:] - control[:, :-1])
    return np.divide(rise, width, out=np.zeros_like(rise), where=width > 0.0)


def elevate(control: Array, to: int) -> Array:
    """The same pieces with control points (k, to+1, n) of the degree ``to``, at least their own (Farouki 2012, 5.2)."""
    while (n := degree(control)) < to:
        share = (np.arange(n + 2) / (n + 1))[:, None]
        before = np.concatenate([control[:, :1], control], axis=1)  # the repeated ends have weight 0
        control = share * before + (1.0 - share) * np.concatenate([control, control[:, -1:]], axis=1)
    return control


def hull(control: Array) -> tuple[Array, Array]:
    """Lower and upper bounds (k, n) of the curve per piece and joint; not tight in general."""
    return control.min(axis=-2), control.max(axis=-2)


def extremes(control: Array) -> tuple[Array, Array]:
    """The minimum and maximum (k, n) per piece and joint.

    Up to degree 3, the roots of the derivative are computed in closed form and the curve is evaluated there. Both
    values are attained; an error e of a root changes the value by order e^2 only. For higher degrees, pieces are
    subdivided until their hull is within :data:`EXTREME_TOLERANCE` of a value of the curve (Farouki 2012, sections 3
    and 5: the error of a hull decreases to a quarter with each subdivision). The result then bounds the curve to this
    tolerance.
    """
    if degree(control) > 3:
        pieces, points, n = control.shape
        rows = np.swapaxes(control, 1, 2).reshape(pieces * n, points)
        return -_upper(-rows).reshape(pieces, n), _upper(rows).reshape(pieces, n)
    low = np.minimum(control[:, 0], control[:, -1])
    high = np.maximum(control[:, 0], control[:, -1])
    for u in _critical(np.diff(control, axis=1)):
        value = _de_casteljau(control, u)
        low, high = np.minimum(low, value), np.maximum(high, value)
    return low, high


def largest(control: Array, enough: Array | None = None) -> Array:
    """The maximum magnitude (k, n) per piece and joint, with the accuracy of :func:`extremes`.

    If the hull is not above ``enough`` (n,), the result may be the bound of the hull, which is not smaller.
    """
    size: Array = np.abs(control).max(axis=1)
    above = np.ones(len(size), dtype=bool) if enough is None else (~(size <= enough)).any(axis=1)
    if above.any():
        low, high = extremes(control[above])
        size[above] = np.maximum(-low, high)
    return size


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


def hermite(knots: Array, values: Array, slopes: Array, curvatures: Array | None = None) -> Array:
    """Control points of Hermite pieces with given derivatives (k+1, n) at the knots.

    The pieces are cubic, (k, 4, n), with ``values`` and ``slopes``; with the second derivatives ``curvatures`` they are
    quintic, (k, 6, n). The first two (three) points follow from the derivatives at the left end by the differences of
    the coefficients of the derivative (Farouki 2012, 3), the others from those at the right end.
    """
    width = (knots[1:] - knots[:-1])[:, None]
    first, last = values[:-1], values[1:]
    if curvatures is None:
        third = width / 3.0
        return _stacked(first, first + third * slopes[:-1], last - third * slopes[1:], last)
    fifth, square = width / 5.0, width * width / 20.0
    left, right = fifth * slopes[:-1], fifth * slopes[1:]
    return _stacked(
        first,
        first + left,
        first + (2.0 * left + square * curvatures[:-1]),
        last - (2.0 * right - square * curvatures[1:]),
        last - right,
        last,
    )


def hermite_slope(knots: Array, values: Array, slopes: Array, curvatures: Array | None = None) -> Array:
    """Control points (k, 3 or 5, n) of the derivative of the pieces of :func:`hermite`.

    The outer coefficients are the derivatives at the ends. The middle one follows from the mean slope, which is the
    mean of all coefficients. This uses the points themselves, because differences of inner control points would amplify
    their rounding by 1 / width.
    """
    width = (knots[1:] - knots[:-1])[:, None]
    mean = (values[1:] - values[:-1]) / width
    before, after = slopes[:-1], slopes[1:]
    if curvatures is None:
        return _stacked(before, 3.0 * mean - before - after, after)
    left, right = before + 0.25 * width * curvatures[:-1], after - 0.25 * width * curvatures[1:]
    return _stacked(before, left, 5.0 * mean - before - left - right - after, right, after)


def _stacked(*points: Array) -> Array:
    """(k, r, n) the r control points (k, n) of each piece; as np.stack, in a third of its time."""
    k, n = points[0].shape
    control = np.empty((k, len(points), n))
    for r, each in enumerate(points):
        control[:, r] = each
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


def _critical(slope: Array) -> list[Array]:
    """The roots in [0, 1] of polynomials with Bernstein coefficients ``slope`` (k, 0..3, n), each (k, n).

    If there is no root, the entry is an arbitrary point of [0, 1].
    """
    if slope.shape[1] < 2:  # a constant slope: monotone
        return []
    if slope.shape[1] == 2:
        return [_ratio(slope[:, 0], slope[:, 0] - slope[:, 1])]
    # For a u^2 - 2 b u + c, the larger root is computed first and the other from their product, without cancellation.
    c = slope[:, 0]
    b = slope[:, 0] - slope[:, 1]
    a = slope[:, 0] - 2.0 * slope[:, 1] + slope[:, 2]
    large = b + np.copysign(np.sqrt(np.maximum(b * b - a * c, 0.0)), b)
    return [_ratio(large, a), _ratio(c, large)]


def _ratio(numerator: Array, denominator: Array) -> Array:
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.clip(np.nan_to_num(numerator / denominator, nan=0.0), 0.0, 1.0)
