"""Polynomial pieces by their Bernstein coefficients: evaluate, split, differentiate, bound.

A curve is ``knots`` (k+1,) and ``control`` (k, degree+1, n): for a parameter t in [knots[i], knots[i+1]] and
u = (t - knots[i]) / (knots[i+1] - knots[i]), piece i is sum_r C(degree, r) u^r (1-u)^(degree-r) control[i, r].
The n columns are independent (one a joint), in whatever units the curve has. A piece of zero width is legal and stands
for the single configuration control[i, 0].

Why this basis: a piece never leaves the convex hull of its control points, halving is exact up to the rounding of
averages, and coefficients of the derivative are scaled differences.

Source: R. T. Farouki, "The Bernstein polynomial basis: a centennial retrospective", Computer Aided Geometric Design 29
(2012), sections 3 (hull, differences) and 5 (de Casteljau's algorithm).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError

__all__ = [
    "EXTREME_TOLERANCE",
    "degree",
    "derivative",
    "elevate",
    "evaluate",
    "extremes",
    "hermite",
    "hermite_slope",
    "hull",
    "largest",
    "on_pieces",
    "split",
]

Array = npt.NDArray[np.float64]

EXTREME_TOLERANCE = 1e-12
"""By how much, relative to its largest coefficient, an extremum may be overstated where none is in closed form: far
above the rounding of de Casteljau's averages, far below every limit's tolerance."""


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
        A parameter, or (N,) of them, in [knots[0], knots[-1]]. At an inner knot the piece to its right is used.

    Returns
    -------
    (n,) for a scalar, else (N, n). Both ends of every piece are met bit for bit.

    Raises
    ------
    InputError
        If ``t`` is not finite, lies outside the curve, or has more than one axis.
    """
    try:
        parameter = np.asarray(t, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"a curve is evaluated at numbers: {error}") from error
    if parameter.ndim > 1:
        raise InputError(f"a curve is evaluated at a scalar or at (N,) parameters, not at the shape {parameter.shape}")
    outside = ~((parameter >= knots[0]) & (parameter <= knots[-1]))  # written so that NaN is outside
    if outside.any():
        raise InputError(f"the parameter {parameter[outside][0]} lies outside the curve: [{knots[0]}, {knots[-1]}]")
    flat = parameter.reshape(-1)
    piece = np.clip(np.searchsorted(knots, flat, side="right") - 1, 0, len(control) - 1)
    width = knots[piece + 1] - knots[piece]
    u = np.divide(flat - knots[piece], width, out=np.zeros_like(flat), where=width > 0.0)
    points = on_pieces(control, piece, u)
    return points[0] if parameter.ndim == 0 else points


def on_pieces(control: Array, piece: npt.NDArray[np.intp], u: Array) -> Array:
    """(N, n) points at local parameters ``u`` (N,) in [0, 1] of the pieces (N,) told."""
    return _de_casteljau(control[piece], u[:, None])


def split(control: Array, u: float = 0.5) -> tuple[Array, Array]:
    """Cut every piece at the local parameter ``u`` in [0, 1]; left and right halves, each shaped as ``control``.

    The halves trace the same curve; each point is a convex combination, so nothing is magnified (Farouki 2012, 5.1).
    """
    left, right = np.empty_like(control), np.empty_like(control)
    rest, last = control, degree(control)
    for r in range(last + 1):
        left[..., r, :] = rest[..., 0, :]
        right[..., last - r, :] = rest[..., -1, :]
        rest = rest[..., :-1, :] * (1.0 - u) + rest[..., 1:, :] * u
    return left, right


def derivative(knots: Array, control: Array) -> Array:
    """Control points (k, degree, n) of the derivative by the curve's parameter, over the same ``knots``.

    A piece of degree 0 gives (k, 1, n) zeros, and so does a piece of zero width.
    """
    if degree(control) == 0:
        return np.zeros_like(control)
    width = np.diff(knots)[:, None, None]
    rise = degree(control) * np.diff(control, axis=1)
    return np.divide(rise, width, out=np.zeros_like(rise), where=width > 0.0)


def elevate(control: Array, to: int) -> Array:
    """The same pieces with control points (k, to+1, n) of a degree that is not below theirs (Farouki 2012, 5.2)."""
    while (n := degree(control)) < to:
        share = (np.arange(n + 2) / (n + 1))[:, None]
        before = np.concatenate([control[:, :1], control], axis=1)  # the doubled ends have no weight
        control = share * before + (1.0 - share) * np.concatenate([control, control[:, -1:]], axis=1)
    return control


def hull(control: Array) -> tuple[Array, Array]:
    """Per piece and joint, bounds (low, high), each (k, n), which the curve does not leave; not tight in general."""
    return control.min(axis=-2), control.max(axis=-2)


def extremes(control: Array) -> tuple[Array, Array]:
    """Per piece and joint, the least and greatest value taken, each (k, n).

    Up to degree 3 the derivative's roots are found in closed form and the curve is evaluated there, so both values are
    attained: a root that is off by e moves the value by order e^2 only. Above that, pieces are halved until their hull
    is within :data:`EXTREME_TOLERANCE` of a value that is taken (Farouki 2012, 3 and 5: a hull is off by a quarter
    after each halving); what is returned then bounds the curve and is above what it takes by no more than that.
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
    """Per piece and joint, the largest magnitude taken (k, n), as good as :func:`extremes`.

    Where the hull tells that it is not above ``enough`` (n,), the hull's may be returned, which is no smaller.
    """
    size: Array = np.abs(control).max(axis=1)
    above = np.ones(len(size), dtype=bool) if enough is None else (~(size <= enough)).any(axis=1)
    if above.any():
        low, high = extremes(control[above])
        size[above] = np.maximum(-low, high)
    return size


def hermite(knots: Array, values: Array, slopes: Array, curvatures: Array | None = None) -> Array:
    """Control points of the pieces with these derivatives (k+1, n) at the knots.

    Cubic, (k, 4, n), through ``values`` with ``slopes``; with ``curvatures``, the second derivatives, quintic,
    (k, 6, n). The first two (three) points follow from the derivatives at the left end alone, by the differences of
    the derivative's coefficients (Farouki 2012, 3), the others from those at the right.
    """
    width = np.diff(knots)[:, None]
    if curvatures is None:
        third = width / 3.0
        inner = [values[:-1] + third * slopes[:-1], values[1:] - third * slopes[1:]]
    else:
        fifth, square = width / 5.0, width * width / 20.0
        left, right = fifth * slopes[:-1], fifth * slopes[1:]
        inner = [
            values[:-1] + left,
            values[:-1] + (2.0 * left + square * curvatures[:-1]),
            values[1:] - (2.0 * right - square * curvatures[1:]),
            values[1:] - right,
        ]
    return np.stack([values[:-1], *inner, values[1:]], axis=1)


def hermite_slope(knots: Array, values: Array, slopes: Array, curvatures: Array | None = None) -> Array:
    """Control points (k, 3 or 5, n) of the derivative of the pieces of :func:`hermite`.

    The outer coefficients are the derivatives at the ends. The one in the middle is what is left of the mean slope,
    which is the mean of all coefficients. So it comes from the points themselves: differences of inner control points
    would magnify their rounding by 1 / width.
    """
    width = np.diff(knots)[:, None]
    mean = np.diff(values, axis=0) / width
    before, after = slopes[:-1], slopes[1:]
    if curvatures is None:
        return np.stack([before, 3.0 * mean - before - after, after], axis=1)
    left, right = before + 0.25 * width * curvatures[:-1], after - 0.25 * width * curvatures[1:]
    return np.stack([before, left, 5.0 * mean - before - left - right - after, right, after], axis=1)


def _upper(rows: Array) -> Array:
    """A bound (R,) on each polynomial with coefficients ``rows`` (R, degree+1), tight to EXTREME_TOLERANCE."""
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
    """One point a piece; ``u`` broadcasts against (k, n)."""
    weight = u[:, None, :]
    while control.shape[1] > 1:
        control = control[:, :-1] * (1.0 - weight) + control[:, 1:] * weight
    return control[:, 0]


def _critical(slope: Array) -> list[Array]:
    """Where in [0, 1] a polynomial with Bernstein coefficients ``slope`` (k, 0..3, n) vanishes, each (k, n).

    Without a root the entry is a harmless point of [0, 1].
    """
    if slope.shape[1] < 2:  # a constant slope: monotone
        return []
    if slope.shape[1] == 2:
        return [_ratio(slope[:, 0], slope[:, 0] - slope[:, 1])]
    # a u^2 - 2 b u + c with the larger root first, the other from their product: no cancellation
    c = slope[:, 0]
    b = slope[:, 0] - slope[:, 1]
    a = slope[:, 0] - 2.0 * slope[:, 1] + slope[:, 2]
    large = b + np.copysign(np.sqrt(np.maximum(b * b - a * c, 0.0)), b)
    return [_ratio(large, a), _ratio(c, large)]


def _ratio(numerator: Array, denominator: Array) -> Array:
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.clip(np.nan_to_num(numerator / denominator, nan=0.0), 0.0, 1.0)
