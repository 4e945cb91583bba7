r"""Arrays with proven bounds of their rounding errors; only the basic operations of IEEE 754 are assumed.

Additions, subtractions, multiplications, divisions and square roots round to nearest in double precision: the relative
error is at most the unit roundoff u = 2^-53. That of a sum of n products is at most :math:`\gamma_n = n u / (1 - n u)`
of the sum of their magnitudes, in any order and with or without fused operations (Higham 2002, section 3.1). Results
below 2^-1022 have an absolute error of 2^-1075, which :data:`TINY` includes.

A :class:`Near` carries a bound of the distance of its computed array from the exact one (midpoint-radius arithmetic,
Rump 1999). The bound is one number for the whole array: absolute for numbers, Euclidean for vectors (the last axis),
and the spectral norm for rotations, whose errors then add up along a chain of joints instead of being multiplied.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

UNIT_ROUNDOFF = 2.0**-53

TINY = 2.0**-500
"""Above the errors of results that underflow, and of square roots of such results."""

UP = 1.0 + 2.0**-20
"""Covers the rounding of the bounds themselves, and of gamma_n above n u for n up to 2^32."""

ROOT_3 = 1.7320508075688774
"""Above the square root of 3."""

PI_HALF = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
"""Parts of pi/2, of 33, 33 and 53 bits, whose sum differs from pi/2 by less than 1e-36."""

MOST_TURNS = 1 << 20
"""Up to this number, whole multiples of the first two parts of pi/2 are exact: angles up to 1.6e6 rad."""


class Near:
    """An array, and how far the exact one is away at most, see :mod:`pinproof.verifier.rounding`."""

    __slots__ = ("_size", "error", "value")

    def __init__(self, value: Array, error: float = 0.0, size: float | None = None) -> None:
        self.value, self.error, self._size = value, error, size

    @property
    def size(self) -> float:
        """A bound of the magnitudes of the computed numbers, or of the lengths of the computed vectors."""
        if self._size is None:
            self._size = ROOT_3 * self.measured().size
        return self._size

    @property
    def lower(self) -> Array:
        """Numbers that are not above the exact ones."""
        return np.nextafter(self.value - self.error, -np.inf)

    @property
    def upper(self) -> Array:
        """Numbers that are not below the exact ones."""
        return np.nextafter(self.value + self.error, np.inf)

    def __getitem__(self, key: Any) -> Near:
        return Near(self.value[key], self.error, self._size)

    def __neg__(self) -> Near:
        return Near(-self.value, self.error, self._size)

    def __add__(self, other: Near | Array | float) -> Near:
        other = near(other)
        return rounded(self.value + other.value, self.error + other.error, 1, self.size + other.size)

    def __sub__(self, other: Near | Array | float) -> Near:
        return self + -near(other)

    def __mul__(self, other: Near | Array | float) -> Near:
        """Numbers times numbers, or times vectors."""
        other = near(other)
        return rounded(self.value * other.value, _of_product(self, other), 1, self.size * other.size)

    def measured(self) -> Near:
        """These numbers, with the largest of them as their size instead of a bound."""
        return Near(self.value, self.error, float(np.maximum.reduce(np.abs(self.value), axis=None, initial=0.0)))

    def least(self, axis: int) -> Near:
        """The smallest numbers along an axis."""
        return Near(self.value.min(axis=axis), self.error, self._size)

    def sums(self) -> Near:
        """(c + 1, ...) the sums of the first 0, 1, .., c rows of numbers."""
        count, begin = len(self.value), np.zeros((1, *self.value.shape[1:]))
        error = count * (self.error + count * UNIT_ROUNDOFF * self.size)
        return Near(np.concatenate([begin, np.cumsum(self.value, axis=0)]), UP * (error + TINY))


def near(value: Near | Array | float) -> Near:
    """Return numbers as they are, or exact ones as numbers without an error."""
    return value if isinstance(value, Near) else Near(np.asarray(value))


def rounded(value: Array, error: float, roundings: int, size: float | None = None) -> Near:
    """Return an array of this error, and in addition so many roundings of numbers or vectors of this size.

    The size is that of the exact result; without it, the computed result is measured.
    """
    found = Near(value)
    size = found.size if size is None else size
    found.error = UP * (error + roundings * UNIT_ROUNDOFF * size + TINY)
    found._size = UP * size + found.error
    return found


def _of_product(a: Near, b: Near) -> float:
    """Return how the errors of two factors change their product, which is a number, a vector, or a cross product."""
    return (a.size + a.error) * b.error + b.size * a.error


def choose(first: npt.NDArray[np.bool_], a: Near, b: Near) -> Near:
    """Return the numbers of ``a`` where ``first`` is true, and those of ``b`` elsewhere."""
    return Near(np.where(first, a.value, b.value), *_largest([a, b]))


def stacked(arrays: list[Near]) -> Near:
    """Return arrays of one shape as one array."""
    return Near(np.array([a.value for a in arrays]), *_largest(arrays))


def _largest(arrays: list[Near]) -> tuple[float, float]:
    """Return the largest error and size; NaN, after an overflow, is larger than all."""
    total = sum(a.error + a.size for a in arrays)
    return (max(a.error for a in arrays), max(a.size for a in arrays)) if total == total else (total, total)


def dot(a: Near, b: Near) -> Near:
    """Return inner products of vectors: 3 products are summed, and Cauchy-Schwarz bounds the sum of their sizes."""
    return rounded(np.einsum("...x,...x->...", a.value, b.value), _of_product(a, b), 3, a.size * b.size)


def cross(a: Near, b: Near) -> Near:
    """Return cross products: two roundings of each entry, of vectors up to sqrt(2) times the product of the lengths."""
    x, y = a.value, b.value
    value = np.empty(np.broadcast_shapes(x.shape, y.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        value[..., k] = x[..., i] * y[..., j] - x[..., j] * y[..., i]
    return rounded(value, _of_product(a, b), 3, a.size * b.size)


def weighted(weights: Near, rows: Near) -> Near:
    """Return the sums over c of numbers (c, r, k) times vectors (c, r, 3), or times numbers (c, r): (r, k, ...)."""
    value = np.einsum("crk,cr...->rk...", weights.value, rows.value)
    count = len(rows.value)
    error = count * _of_product(weights, rows)
    return Near(value, rounded(value, error, count + 1, count * weights.size * rows.size).error)


def length(v: Near) -> Near:
    """Return the lengths of vectors: a relative error of 1.5 u of the sum of squares and its root, and one more."""
    return rounded(np.sqrt(np.einsum("...x,...x->...", v.value, v.value)), v.error, 3, v.size)


def hypotenuse(a: Near, b: Near) -> Near:
    """Return the lengths of vectors of two numbers each."""
    return rounded(np.sqrt(a.value * a.value + b.value * b.value), a.error + b.error, 3)


def rotated(rotation: Near, v: Near, back: bool = False) -> Near:
    """Return vectors (..., 3) rotated by (..., 3, 3), or by the inverse.

    |R| has the norm sqrt(3) of its entries, so that the 3 roundings of each entry are 5.2 u of the length.
    """
    turn = rotation.value if back else np.swapaxes(rotation.value, -1, -2)
    value = (v.value[..., None, :] @ turn)[..., 0, :] if v.value.ndim < turn.ndim else v.value @ turn
    size = (1.0 + rotation.error) * (v.size + v.error)
    return rounded(value, (1.0 + rotation.error) * v.error + rotation.error * v.size, 6, size)


def composed(a: Near, b: Near) -> Near:
    """Return products of rotations: the 3 roundings of each entry are 9 u in the norm of all entries."""
    error, size = a.error + b.error + a.error * b.error, (1.0 + a.error) * (1.0 + b.error)
    return rounded(a.value @ b.value, error, 10, size)


def sine_cosine(angle: Near) -> tuple[Near, Near]:
    """Return sine and cosine of angles (rad), by reduction to [-pi/4, pi/4] and Taylor polynomials.

    The remainders are |r|^19 / 19! and |r|^18 / 18!, below 2.1e-18. Reduction has three roundings of numbers below 1,
    the polynomials by Horner's scheme have less than 4 u, since their terms decrease by factors below 0.32.
    """
    x = angle.value
    turns = np.rint(x * (2.0 / np.pi))
    r = ((x - turns * PI_HALF[0]) - turns * PI_HALF[1]) - turns * PI_HALF[2]
    z = r * r
    sine, cosine = np.ones_like(z), np.ones_like(z)
    for n in range(16, 0, -2):
        sine, cosine = 1.0 - sine * z / (n * (n + 1.0)), 1.0 - cosine * z / (n * (n - 1.0))
    sine = sine * r
    quarter = turns % 4.0
    odd = quarter % 2.0 == 1.0
    error = 2.0 if (np.abs(turns) >= MOST_TURNS).any() else UP * (angle.error + 8 * UNIT_ROUNDOFF)
    signs = np.where(quarter >= 2.0, -1.0, 1.0), np.where((quarter == 1.0) | (quarter == 2.0), -1.0, 1.0)
    parts = np.where(odd, cosine, sine), np.where(odd, sine, cosine)
    return Near(signs[0] * parts[0], error, 1.0 + error), Near(signs[1] * parts[1], error, 1.0 + error)


def angle_above(y: Array, x: Array) -> Array:
    """Return angles (rad) whose tangent is y / x at least, for y >= 0; infinite where x is not positive.

    The arctangent of the system is only a guess: sine and cosine of the angle prove it, or it is infinite.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        angle = np.arctan2(y, x) + 64 * UNIT_ROUNDOFF
        sine, cosine = sine_cosine(Near(angle))
        least, most = sine.lower * x * (1.0 - 4 * UNIT_ROUNDOFF), cosine.upper * y * (1.0 + 4 * UNIT_ROUNDOFF)
        proven = (x > 0.0) & (least >= most)
    return np.where(proven, angle, np.inf)
