r"""Roots of equations that are linear in the state of a joint, and of quartic polynomials.

The state of a revolute joint is b = (cos q, sin q), that of a prismatic joint b = (q, q^2). A b_1 + B b_2 + C = 0 has
at most two roots: with rho^2 = A^2 + B^2 and w^2 = rho^2 - C^2,

.. math:: (\cos q, \sin q) = \big(-A C \mp B w,\; -B C \pm A w\big) / \rho^2 .

If w^2 is slightly below zero, the equation fails by |C| - rho; up to a given border the state is kept as a double root,
and forward kinematics decides.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import compiled, inlined

__all__ = ["FREE", "ROUNDING", "UNCERTAIN", "linear_roots", "quartic_roots", "root_errors"]

FREE = 1e-10
"""In lengths of the arm. A vector shorter than this does not determine a joint: the joint is free. The error of a
branch with any value of such a joint is below this."""

ROUNDING = 1e-15
"""The error of the coefficients of an equation before any joint is known, in lengths of the arm."""

UNCERTAIN = 100.0
"""A vector shorter than this multiple of its error has no certain direction: the joint that depends on it may be
free. Otherwise that joint is known to about 0.01 rad."""

NEARLY_REAL = 1e-3
"""A root of a quartic with a smaller imaginary part may be real: rounding (1e-16) separates double roots by its
square root (1e-8), fourfold ones by 1e-4. Forward kinematics verifies the result."""

ROUNDS = 60
SETTLED = 1e-15


@inlined
def root_errors(slides: Any, A: float, B: float, state: Any, rounding: float, tolerance: float) -> Any:
    """The error of the root ``state`` of A b_1 + B b_2 + C = 0, if C has the error ``rounding``, or ``tolerance``.

    An error d of an equation with slope s and curvature k moves a simple root by d / s, a double root by sqrt(d / k).
    An error of 1 or more means that the joint is undetermined.
    """
    if slides:
        slope, curvature = abs(A + 2.0 * B * state[0]), abs(B)
    else:
        slope, curvature = abs(B * state[0] - A * state[1]), math.sqrt(A * A + B * B)
    if slope * slope >= tolerance * curvature and slope > tolerance >= rounding:
        inverse = 1.0 / slope
        return rounding * inverse, tolerance * inverse
    return (
        rounding / max(max(slope, math.sqrt(rounding * curvature)), rounding),
        tolerance / max(max(slope, math.sqrt(tolerance * curvature)), tolerance),
    )


@inlined
def linear_roots(
    slides: Any, A: float, B: float, C: float, square: float, border: float, spread: float, free: float
) -> Any:
    """The roots of A b_1 + B b_2 + C = 0: their number, and two states. A number of -1: every value is a root.

    Every value is a root if A and B are smaller than ``free``.

    ``square`` is w^2 if the caller knows it more accurately than from A, B and C; else NaN. If the equation fails to
    have a root by less than ``border``, the closest state is a root; the two returned states are then ``spread`` (in
    w^2) apart, as starts of a refinement.
    """
    if slides:
        if abs(B) < FREE:
            if abs(A) < free:
                return (-1 if abs(C) <= border else 0), (0.0, 0.0), (0.0, 0.0)
            t = -C / A
            return 1, (t, t * t), (t, t * t)
        half = -0.5 * A / B
        beyond = half * half - C / B
        if beyond < 0.0 and -beyond * abs(B) > border:
            return 0, (0.0, 0.0), (0.0, 0.0)
        beyond = math.sqrt(max(beyond, spread))
        t, r = half + beyond, half - beyond
        return (1 if beyond == 0.0 else 2), (t, t * t), (r, r * r)
    rho2 = A * A + B * B
    rho = math.sqrt(rho2)
    if rho < free:
        return (-1 if abs(C) <= border + free else 0), (1.0, 0.0), (1.0, 0.0)
    w2 = rho2 - C * C
    if not math.isnan(square):
        w2 = square
    if w2 < 0.0 and abs(C) - rho > border:
        return 0, (1.0, 0.0), (1.0, 0.0)
    w = math.sqrt(max(w2, spread * rho2))
    inverse = 1.0 / rho2
    if abs(C) > rho or spread > 0.0:  # Outside the circle: moved back onto it.
        inverse = 1.0 / math.sqrt(rho2 * (C * C + w * w))
    first = ((-A * C - B * w) * inverse, (-B * C + A * w) * inverse)
    second = ((-A * C + B * w) * inverse, (-B * C - A * w) * inverse)
    return (1 if w == 0.0 else 2), first, second


@compiled
def quartic_roots(a: Any, nearly: float, found: Any) -> int:
    """The real roots of a[0] + ... + a[4] t^4 = 0 into ``found`` (8,); returns their number; a[4] is not small.

    All four complex roots are computed at once by Aberth's iteration (1973, "Iteration methods for finding all zeros of
    a polynomial simultaneously"), which needs no initial guess. A complex pair with small imaginary parts (below
    NEARLY_REAL, or ``nearly``) counts as two roots that nearly meet: candidates on both sides of them, and the middle,
    in case rounding separated a double root.
    """
    lead = 1.0 / a[4]
    b0, b1, b2, b3 = a[0] * lead, a[1] * lead, a[2] * lead, a[3] * lead
    radius = 0.5 + max(max(abs(b3), math.sqrt(abs(b2))), max(abs(b1) ** (1.0 / 3.0), abs(b0) ** 0.25))
    z0, z1 = complex(radius, 0.35 * radius) - 0.25 * b3, complex(-0.4 * radius, radius) - 0.25 * b3
    z2, z3 = complex(-radius, -0.3 * radius) - 0.25 * b3, complex(0.45 * radius, -radius) - 0.25 * b3
    for _ in range(ROUNDS):
        largest = 0.0
        for _ in range(4):
            z = z0
            p = (((z + b3) * z + b2) * z + b1) * z + b0
            if p != 0.0:
                slope = ((4.0 * z + 3.0 * b3) * z + 2.0 * b2) * z + b1
                near = 0.0j
                for other in (z1, z2, z3):
                    gap = z - other
                    if gap != 0.0:
                        near += 1.0 / gap
                below = slope - p * near
                step = p / below if below != 0.0 else 1e-3 + 1e-3j
                z -= step
                largest = max(largest, abs(step) / (1.0 + abs(z)))
            z0, z1, z2, z3 = z1, z2, z3, z
        if largest < SETTLED:
            break
    count = 0
    for z in (z0, z1, z2, z3):
        size = 1.0 + abs(z)
        if abs(z.imag) < max(NEARLY_REAL, nearly) * size:
            # For a pair, candidates on both sides, and the middle in case they coincide.
            found[count] = z.real + z.imag
            count += 1
            if 1e-12 * size < abs(z.imag) < NEARLY_REAL * size:
                found[count] = z.real
                count += 1
    return count
