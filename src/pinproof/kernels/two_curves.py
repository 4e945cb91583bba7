r"""The three joints outside the triple: the intersection of two curves.

The loop of six joints, cut at one joint, is W^-1 = E_a E_b E_c G^-1, where W is the motion of the triple (three
consecutive joints), a, b, c are the joints that follow it in the loop, and E_a is the motion of joint a from zero. The
lines of joints before the triple are transformed by G^-1, so that the position of the triple in the chain does not
matter. A triple has an invariant, which gives two equations in the states of c (x) and a (y) without b:

*Spherical* (invariant point O): E_b E_c p = E_a^-1 O with p = G^-1 O. Joint b must bring the curves m(x) = E_c p and
n(y) = E_a^-1 O together. If b is revolute about h through o, this is possible if h . m = h . n and \|m - o\|^2 = \|n -
o\|^2; if it is prismatic along h, if m - n has no component perpendicular to h.

*Planar* (invariant direction n, and heights along n): R_b m = k with m(x) = R_c n', k(y) = R_a^T n, n' = R_G^T n, which
is possible for a revolute b if h . m = h . k. The height of E_a E_b E_c p over a point p_0, expressed by k and m,

.. math:: n\cdot o_a + k\cdot(o_b - o_a) + m\cdot(o_c - o_b) + n'\cdot(p - o_c) = n\cdot p_0,

is linear as well; a prismatic joint adds its translation times n . h. (If b itself is prismatic, it preserves
directions: h_a . m = h_a . n and h_c . k = h_c . n' are necessary, m = k is checked for their solutions, and the height
gives its translation.)

Each of these equations is F b(x) + G b(y) + k = 0, linear in the state b of a joint. (For a prismatic joint, \|m\|^2 is
quadratic: b contains its square.) If a combination of the two does not contain one unknown, it gives two roots of the
other, as for most industrial arms. Otherwise b(y) = -G^-1 (F b(x) + k) must be a state, cos^2 + sin^2 = 1, which is a
quartic in the half-angle tangent of x; its solutions are refined on the two equations.

Sources: Pieper (1968), "The kinematics of manipulators under computer control"; Paden (1986), subproblems; Elias and
Wen (2022), "IK-Geo: Unified robot inverse kinematics using subproblem decomposition", for the same decomposition by
geometry.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.roots import FREE, UNCERTAIN, linear_roots, quartic_roots, root_errors
from pinproof.kernels.trigonometry import sincos
from pinproof.kernels.vectors import (
    SLIDING,
    across,
    along,
    cross,
    curve,
    direction,
    dot,
    minus,
    perpendicular,
    place,
    turning_curve,
)

__all__ = [
    "BY_QUARTIC",
    "CANDIDATES",
    "COLUMNS",
    "DOUBTFUL",
    "FIRST",
    "FREED",
    "NEAR",
    "REFERENCE",
    "ROUNDING_ERROR",
    "SNAPPED",
    "TOLERANCE_ERROR",
    "UNDECIDED",
    "WHICH",
    "aligned",
    "gram",
    "reference_state",
    "two_curves",
]

FIRST = 3
"""The row of joint a in an array of lines, after those of the triple; b and c follow."""

REFERENCE = 7
"""The entry of a line for the value of the joint if it is free."""

CANDIDATES = 8
"""Maximum number of solutions: four of a quartic, each of which may be a double root with two candidates."""

BY_QUARTIC = 64
"""Added to the number of solutions if they come from a quartic."""

SEPARABLE = 1e-5
"""A 2 x 2 matrix whose determinant is smaller than this fraction of its squared size is treated as singular. The
error is removed by refinement; a quartic would lose as much accuracy by rounding, which grows with the inverse
square."""

SAME_DIRECTION = 1e-4
"""m = k is considered satisfied up to this; refinement and forward kinematics decide afterwards."""

EXACT = 1e-14
REFINEMENTS = 4

NEAR = 4.0
"""An equation without a root is treated as having a double root if it fails by less than this multiple of the change
that the tolerances permit."""

# The entries of a candidate: states of c, a and b, the free joints (bits of the rows of their lines), its number; the
# error of the rotation about all three joints due to rounding, and due to the tolerances; the joints that are free
# only because an uncertain vector was treated as a zero vector.
X, Y, Z, FREED, WHICH, ROUNDING_ERROR, TOLERANCE_ERROR, SNAPPED = 0, 2, 4, 6, 7, 8, 9, 10
COLUMNS = 11

# The entries of the row after the last candidate: decisions about free joints that rounding may have changed; and
# cases that were omitted, or are not supported.
UNDECIDED, DOUBTFUL = 0, 1

OF_A_SNAPPED_JOINT = 100
"""Added to the number of a candidate with a joint that is SNAPPED."""


@inlined
def gram(alpha: float, beta: float, height: float, off2: float) -> Any:
    r"""w^2 of the equation h . R b = height for a unit vector b that rotates about g (alpha = h.g, beta = b.g).

    It is (1 - alpha^2)(1 - beta^2) - (height - alpha beta)^2, a Gram determinant. If the desired vector, a unit vector
    of that height, is close to h, this loses half the digits; ``off2``, the square of its component perpendicular to h,
    does not: 1 - height^2 = off2.
    """
    if height >= 0.0:
        return off2 * (1.0 - 2.0 * alpha * beta / (1.0 + height)) - (alpha - beta) * (alpha - beta)
    return off2 * (1.0 + 2.0 * alpha * beta / (1.0 - height)) - (alpha + beta) * (alpha + beta)


@inlined
def aligned(h: Any, v: Any, w: Any) -> Any:
    """Cosine and sine of the rotation about h that aligns v with w, and the product of their distances from h.

    From the components perpendicular to h: v . w - (h . v)(h . w) would lose a short component, for example of a nearly
    straight wrist.
    """
    v, w = across(v, h), across(w, h)
    c, s = dot(v, w), dot(h, cross(v, w))
    size = math.sqrt(c * c + s * s)
    if size == 0.0:
        return 1.0, 0.0, 0.0
    return c / size, s / size, size


@inlined
def reference_state(lines: Any, i: int) -> Any:
    """The state of joint i at its reference value."""
    value = lines[i, REFERENCE]
    if lines[i, SLIDING] != 0.0:
        return value, value * value
    s, c = sincos(value)
    return c, s


@compiled
def two_curves(
    lines: Any, planar: Any, p: Any, p0: Any, n: Any, n1: Any, border: float, spread: float, rounding: float,
    tolerance: float, snap: Any, out: Any,
) -> int:  # fmt: skip
    """Solutions (x, y, z) of joints c, a, b into ``out`` (CANDIDATES + 1, COLUMNS); their number (plus BY_QUARTIC).

    ``p`` and ``n1`` are O (or a point of the plane) and n after G^-1, ``p0`` and ``n`` before it. Rounding changes an
    equation by at most ``rounding``, the tolerances of the result by ``tolerance``. With ``snap``, joints that depend
    on the direction of a vector that is UNCERTAIN are free; else only those that depend on a zero vector.
    """
    ha, hb, hc = direction(lines, FIRST), direction(lines, FIRST + 1), direction(lines, FIRST + 2)
    oa, ob, oc = place(lines, FIRST), place(lines, FIRST + 1), place(lines, FIRST + 2)
    sa, sb, sc = lines[FIRST, SLIDING] != 0.0, lines[FIRST + 1, SLIDING] != 0.0, lines[FIRST + 2, SLIDING] != 0.0

    if planar:
        Am, um, wm = turning_curve(hc, sc, 1.0, n1)
        An, un, wn = turning_curve(ha, sa, -1.0, n)
        if sb:
            F00, F01, G00, G01, k0 = dot(ha, um), dot(ha, wm), 0.0, 0.0, dot(ha, Am) - dot(ha, n)
            F10, F11, G10, G11, k1 = 0.0, 0.0, dot(hc, un), dot(hc, wn), dot(hc, An) - dot(hc, n1)
        else:
            F00, F01, G00, G01 = dot(hb, um), dot(hb, wm), -dot(hb, un), -dot(hb, wn)
            k0 = dot(hb, Am) - dot(hb, An)
            arm, lever = minus(ob, oa), minus(oc, ob)
            k1 = -dot(n, p0)
            if sa:
                G10, G11 = dot(n, ha), 0.0
                k1 += dot(n, ob)
            else:
                G10, G11 = dot(un, arm), dot(wn, arm)
                k1 += dot(An, arm) + dot(n, oa)
            if sc:
                F10, F11 = dot(n1, hc), 0.0
                k1 += dot(n1, minus(p, ob))
            else:
                F10, F11 = dot(um, lever), dot(wm, lever)
                k1 += dot(Am, lever) + dot(n1, minus(p, oc))
    else:
        Am, um, wm = curve(hc, oc, sc, 1.0, p)
        An, un, wn = curve(ha, oa, sa, -1.0, p0)
        if sb:
            e = perpendicular(hb)
            f = cross(hb, e)
            gap = minus(Am, An)
            F00, F01, G00, G01, k0 = dot(e, um), dot(e, wm), -dot(e, un), -dot(e, wn), dot(e, gap)
            F10, F11, G10, G11, k1 = dot(f, um), dot(f, wm), -dot(f, un), -dot(f, wn), dot(f, gap)
        else:
            Am, An = minus(Am, ob), minus(An, ob)
            F00, F01, G00, G01 = dot(hb, um), dot(hb, wm), -dot(hb, un), -dot(hb, wn)
            k0 = dot(hb, Am) - dot(hb, An)
            # |A + u b_1 + w b_2|^2 with |u| = |w|, u . w = 0 on a circle; b_2 = b_1^2 on a line
            F10, F11 = 2.0 * dot(Am, um), (1.0 if sc else 2.0 * dot(Am, wm))
            G10, G11 = -2.0 * dot(An, un), (-1.0 if sa else -2.0 * dot(An, wn))
            k1 = dot(Am, Am) - dot(An, An) + (0.0 if sc else dot(um, um)) - (0.0 if sa else dot(un, un))

    sizeF, sizeG = F00 * F00 + F01 * F01 + F10 * F10 + F11 * F11, G00 * G00 + G01 * G01 + G10 * G10 + G11 * G11
    detF, detG = F00 * F11 - F01 * F10, G00 * G11 - G01 * G10
    ratioF = abs(detF) / sizeF if sizeF > FREE * FREE else 0.0
    ratioG = abs(detG) / sizeG if sizeG > FREE * FREE else 0.0
    swap = ratioF < ratioG if min(ratioF, ratioG) < SEPARABLE else ratioF > ratioG
    if swap:
        F00, F01, F10, F11, G00, G01, G10, G11 = G00, G01, G10, G11, F00, F01, F10, F11
        detG, sizeF, sizeG = detF, sizeG, sizeF
        ratioF, ratioG = ratioG, ratioF
    first_slides, second_slides = (sa, sc) if swap else (sc, sa)
    first, second = (FIRST, FIRST + 2) if swap else (FIRST + 2, FIRST)

    count = 0
    undecided = doubtful = 0.0
    if ratioG < SEPARABLE:
        # (v0, v1) G = 0: that combination of the two equations contains the first unknown only.
        if sizeG > FREE * FREE:
            left, right = G00 * G00 + G10 * G10, G01 * G01 + G11 * G11
            u0, u1 = (G00, G10) if left >= right else (G01, G11)
        else:
            left, right = F00 * F00 + F10 * F10, F01 * F01 + F11 * F11
            u1, u0 = (F00, -F10) if left >= right else (F01, -F11)
        size = math.sqrt(u0 * u0 + u1 * u1)
        u0, u1 = (u0 / size, u1 / size) if size > 0.0 else (1.0, 0.0)
        v0, v1 = -u1, u0
        A, B = v0 * F00 + v1 * F10, v0 * F01 + v1 * F11
        left_out = ratioG * math.sqrt(sizeG)  # the part with the other unknown, if not exactly singular
        near = max(border, NEAR * (tolerance + left_out))
        found, x1, x2 = linear_roots(first_slides, A, B, v0 * k0 + v1 * k1, math.nan, near, spread, FREE)
        freed = 0
        if found < 0:
            x1, found, freed = reference_state(lines, first), 1, 1 << first
        for i in range(found):
            x = x1 if i == 0 else x2
            rounding_x, tolerance_x = 0.0, 0.0
            if freed == 0:
                rounding_x, tolerance_x = root_errors(first_slides, A, B, x, rounding, tolerance)
            height = u0 * (F00 * x[0] + F01 * x[1] + k0) + u1 * (F10 * x[0] + F11 * x[1] + k1)
            dx0, dx1 = (1.0, 2.0 * x[0]) if first_slides else (-x[1], x[0])
            growth = abs(u0 * (F00 * dx0 + F01 * dx1) + u1 * (F10 * dx0 + F11 * dx1))
            rounding_y = rounding + (growth + rounding_x) * rounding_x
            tolerance_y = tolerance + (growth + tolerance_x) * tolerance_x
            near = max(border, NEAR * (tolerance_y + left_out))
            square = math.nan
            if planar and not sb and not second_slides and abs(u1) < 1e-9:
                # The equation is then h_b . k = h_b . m alone.
                if swap:
                    other, beta = along(along(An, x[0], un), x[1], wn), dot(hc, n1)
                    alpha = dot(hb, hc)
                else:
                    other, beta = along(along(Am, x[0], um), x[1], wm), dot(ha, n)
                    alpha = dot(hb, ha)
                off = across(other, hb)
                square = gram(alpha, beta, dot(hb, other), dot(off, off))
                part, tilt = math.sqrt(dot(off, off)), abs(abs(alpha) - abs(beta))
                rounding_y = rounding * tilt + (part + rounding + rounding_x) * (rounding + rounding_x)
                tolerance_y = tolerance * tilt + (part + tolerance + tolerance_x) * (tolerance + tolerance_x)
            A2, B2, free = u0 * G00 + u1 * G10, u0 * G01 + u1 * G11, FREE
            unsure = UNCERTAIN * (rounding + growth * rounding_x + rounding_x * rounding_x)
            if unsure > FREE and max(abs(A2), abs(B2)) < unsure and max(abs(A2), abs(B2)) >= 0.7 * FREE:
                undecided = 1.0
                if snap:
                    free = 2.0 * unsure
            more, y1, y2 = linear_roots(second_slides, A2, B2, height, square, near, spread, free)
            also = freed
            if more < 0:
                y1, more, also = reference_state(lines, second), 1, freed | 1 << second
            for j in range(more):
                y = y1 if j == 0 else y2
                out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x[0], x[1], y[0], y[1]
                out[count, FREED], out[count, WHICH] = also, 2 * i + j
                out[count, SNAPPED] = also if also != freed and free != FREE else 0
                # First for each of the two unknowns; for their rotations at the end.
                out[count, 4], out[count, 5] = rounding_x, tolerance_x
                out[count, ROUNDING_ERROR] = out[count, TOLERANCE_ERROR] = 0.0
                if also == freed:
                    out[count, ROUNDING_ERROR], out[count, TOLERANCE_ERROR] = root_errors(
                        second_slides, A2, B2, y, rounding_y, tolerance_y
                    )
                count += 1
        exact = ratioG < EXACT
    else:
        count = _by_quartic(
            F00, F01, F10, F11, G00, G01, G10, G11, k0, k1, detG, first_slides, second_slides,
            max(spread, NEAR * tolerance), out,
        )  # fmt: skip
        if count < 0:
            count, doubtful = 0, 1.0
        exact = False
    if not exact:
        for i in range(count):
            if out[i, SNAPPED] == 0.0:
                _refine(F00, F01, F10, F11, G00, G01, G10, G11, k0, k1, first_slides, second_slides, out, i)
    if ratioG >= SEPARABLE:
        for i in range(count):
            _errors_of_both(
                F00, F01, F10, F11, G00, G01, G10, G11, first_slides, second_slides, rounding, tolerance, out, i
            )

    kept = 0
    for i in range(count):
        x, y = (out[i, 0], out[i, 1]), (out[i, 2], out[i, 3])
        rounding_x, tolerance_x = out[i, 4], out[i, 5]
        rounding_y, tolerance_y = out[i, ROUNDING_ERROR], out[i, TOLERANCE_ERROR]
        if swap:
            x, y = y, x
            rounding_x, tolerance_x, rounding_y, tolerance_y = rounding_y, tolerance_y, rounding_x, tolerance_x
        m, k = along(along(Am, x[0], um), x[1], wm), along(along(An, y[0], un), y[1], wn)
        freed, snapped = int(out[i, FREED]), int(out[i, SNAPPED])
        z0, z1 = 1.0, 0.0
        rounding_z = tolerance_z = 0.0
        if sb and planar:
            gap = minus(m, k)
            tilt = dot(k, hb)
            same = max(SAME_DIRECTION, NEAR * (tolerance + tolerance_x + tolerance_y))
            if dot(gap, gap) > same * same:
                continue
            if abs(tilt) < max(FREE, UNCERTAIN * (rounding_x + rounding_y)):
                doubtful = 1.0  # The prismatic joint moves in the plane of the triple: free, which is not supported.
                continue
            rounding_z, tolerance_z = (rounding_x + rounding_y) / abs(tilt), (tolerance_x + tolerance_y) / abs(tilt)
            height = dot(n, minus(oa, p0)) - dot(k, oa) + dot(m, oc) + dot(n1, minus(p, oc))
            z0 = -height / tilt
            z1 = z0 * z0
        elif sb:
            z0 = dot(hb, minus(k, m))
            z1 = z0 * z0
        else:
            z0, z1, size = aligned(hb, m, k)
            short2 = min(dot(across(m, hb), across(m, hb)), dot(across(k, hb), across(k, hb)))
            away_m, away_k = math.sqrt(dot(um, um)), math.sqrt(dot(un, un))
            off = rounding + away_m * rounding_x + away_k * rounding_y
            if size < FREE * FREE or short2 < FREE * FREE:
                (z0, z1), freed = reference_state(lines, FIRST + 1), freed | 1 << (FIRST + 1)
            elif short2 < (UNCERTAIN * off) * (UNCERTAIN * off):
                undecided = 1.0
                rounding_z = tolerance_z = 1.0
                if snap:
                    (z0, z1), freed = reference_state(lines, FIRST + 1), freed | 1 << (FIRST + 1)
                    snapped |= 1 << (FIRST + 1)
                    rounding_z = tolerance_z = 0.0
            else:
                inverse = 1.0 / math.sqrt(short2)
                rounding_z = off * inverse
                tolerance_z = min(1.0, (tolerance + away_m * tolerance_x + away_k * tolerance_y) * inverse)
        which = out[i, WHICH] + (OF_A_SNAPPED_JOINT if snapped else 0)
        out[kept, 0], out[kept, 1], out[kept, 2], out[kept, 3] = x[0], x[1], y[0], y[1]
        out[kept, 4], out[kept, 5], out[kept, FREED], out[kept, WHICH] = z0, z1, freed, which
        out[kept, SNAPPED] = snapped
        out[kept, ROUNDING_ERROR] = rounding + rounding_x + rounding_y + rounding_z
        out[kept, TOLERANCE_ERROR] = tolerance + tolerance_x + tolerance_y + tolerance_z
        kept += 1
    out[CANDIDATES, UNDECIDED], out[CANDIDATES, DOUBTFUL] = undecided, doubtful
    return kept if ratioG < SEPARABLE else kept + BY_QUARTIC


@compiled
def _by_quartic(
    F00: float, F01: float, F10: float, F11: float, G00: float, G01: float, G10: float, G11: float,
    k0: float, k1: float, det: float, first_slides: Any, second_slides: Any, spread: float, out: Any,
) -> int:  # fmt: skip
    """Solutions (x, y) into ``out``, if G is invertible: det(G) b(y) = -(P, Q), both linear in b(x).

    Returns their number; -1 if the quartic is zero, so that every value is a root.

    As forms of degree 2 in (t, w), b(x) = (w^2 - t^2, 2 t w) / (w^2 + t^2) or (t w, t^2) / w^2. The forms are rotated
    such that no root is near infinity: to the point, among several, where the quartic is largest.
    """
    p0, p1, p2 = G11 * k0 - G01 * k1, G11 * F00 - G01 * F10, G11 * F01 - G01 * F11
    q0, q1, q2 = G00 * k1 - G10 * k0, G00 * F10 - G10 * F00, G00 * F11 - G10 * F01
    scale = 1.0 / max(abs(det), max(max(abs(p0) + abs(p1), abs(p2)), max(abs(q0) + abs(q1), abs(q2))))
    p0, p1, p2, q0, q1, q2, d = p0 * scale, p1 * scale, p2 * scale, q0 * scale, q1 * scale, q2 * scale, det * scale
    form = np.empty((4, 3))  # P, Q, the common denominator; coefficients of w^2, t w, t^2
    for row, c0, c1, c2 in ((0, p0, p1, p2), (1, q0, q1, q2), (2, 1.0, 0.0, 0.0)):
        if first_slides:
            form[row, 0], form[row, 1], form[row, 2] = c0, c1, c2
        else:
            form[row, 0], form[row, 1], form[row, 2] = c0 + c1, 2.0 * c2, c0 - c1
    best, cosine, sine = -1.0, 1.0, 0.0
    for i in range(7):
        s, c = sincos(0.2 + i * (math.pi / 7.0))
        P = form[0, 0] * s * s - form[0, 1] * s * c + form[0, 2] * c * c
        Q = form[1, 0] * s * s - form[1, 1] * s * c + form[1, 2] * c * c
        D = form[2, 0] * s * s - form[2, 1] * s * c + form[2, 2] * c * c
        value = abs(P * P + d * Q * D) if second_slides else abs(P * P + Q * Q - d * d * D * D)
        if value > best:
            best, cosine, sine = value, c, s
    for row in range(3):
        a, b, c = form[row, 0], form[row, 1], form[row, 2]
        form[row, 0] = a * cosine * cosine + b * sine * cosine + c * sine * sine
        form[row, 1] = 2.0 * (c - a) * sine * cosine + b * (cosine * cosine - sine * sine)
        form[row, 2] = a * sine * sine - b * sine * cosine + c * cosine * cosine
    a, roots = np.zeros(5), np.empty(8)
    for i in range(3):
        for j in range(3):
            P = form[0, i] * form[0, j]
            if second_slides:
                a[i + j] += P + d * form[1, i] * form[2, j]
            else:
                a[i + j] += P + form[1, i] * form[1, j] - d * d * form[2, i] * form[2, j]
    if best < 1e-30:
        return -1
    found = quartic_roots(a, math.sqrt(spread), roots)
    roots[:found].sort()
    count = 0
    for i in range(found):
        t, w = roots[i] * cosine + sine, -roots[i] * sine + cosine
        if first_slides:
            if abs(w) < 1e-9 * abs(t):
                continue
            x0 = t / w
            x1 = x0 * x0
        else:
            size = 1.0 / (t * t + w * w)
            x0, x1 = (w * w - t * t) * size, 2.0 * t * w * size
        y0, y1 = -(p0 + p1 * x0 + p2 * x1) / d, -(q0 + q1 * x0 + q2 * x1) / d
        if second_slides:
            y1 = y0 * y0
        else:
            size = math.sqrt(y0 * y0 + y1 * y1)
            y0, y1 = (y0 / size, y1 / size) if size > 0.0 else (1.0, 0.0)
        out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x0, x1, y0, y1
        out[count, FREED], out[count, WHICH], out[count, SNAPPED] = 0, count, 0
        count += 1
    return count


@compiled
def _refine(
    F00: float, F01: float, F10: float, F11: float, G00: float, G01: float, G10: float, G11: float,
    k0: float, k1: float, first_slides: Any, second_slides: Any, out: Any, row: int,
) -> None:  # fmt: skip
    """Newton's steps on the two equations in x and y, while they reduce the residual."""
    x0, x1, y0, y1 = out[row, 0], out[row, 1], out[row, 2], out[row, 3]
    last = math.inf
    for _ in range(REFINEMENTS + 1):
        r0 = F00 * x0 + F01 * x1 + G00 * y0 + G01 * y1 + k0
        r1 = F10 * x0 + F11 * x1 + G10 * y0 + G11 * y1 + k1
        size = abs(r0) + abs(r1)
        if not size < last:
            return
        out[row, 0], out[row, 1], out[row, 2], out[row, 3] = x0, x1, y0, y1
        last = size
        dx0, dx1 = (1.0, 2.0 * x0) if first_slides else (-x1, x0)
        dy0, dy1 = (1.0, 2.0 * y0) if second_slides else (-y1, y0)
        a, b = F00 * dx0 + F01 * dx1, G00 * dy0 + G01 * dy1
        c, d = F10 * dx0 + F11 * dx1, G10 * dy0 + G11 * dy1
        det = a * d - b * c
        if size < EXACT or abs(det) < EXACT:
            return
        dx, dy = (b * r1 - d * r0) / det, (c * r0 - a * r1) / det
        if abs(dx) + abs(dy) > 0.3:
            return
        if first_slides:
            x0 += dx
            x1 = x0 * x0
        else:
            s, c = sincos(dx)
            x0, x1 = x0 * c - x1 * s, x0 * s + x1 * c
        if second_slides:
            y0 += dy
            y1 = y0 * y0
        else:
            s, c = sincos(dy)
            y0, y1 = y0 * c - y1 * s, y0 * s + y1 * c


@compiled
def _errors_of_both(
    F00: float, F01: float, F10: float, F11: float, G00: float, G01: float, G10: float, G11: float,
    first_slides: Any, second_slides: Any, rounding: float, tolerance: float, out: Any, row: int,
) -> None:  # fmt: skip
    """The errors of x and y of a row due to ``rounding`` and due to ``tolerance``, where both equations contain both.

    From the inverse of the Jacobian of the equations; up to four roots may coincide, which an error d moves by d^(1/4).
    """
    x0, x1, y0, y1 = out[row, 0], out[row, 1], out[row, 2], out[row, 3]
    dx0, dx1 = (1.0, 2.0 * x0) if first_slides else (-x1, x0)
    dy0, dy1 = (1.0, 2.0 * y0) if second_slides else (-y1, y0)
    a, b = F00 * dx0 + F01 * dx1, G00 * dy0 + G01 * dy1
    c, d = F10 * dx0 + F11 * dx1, G10 * dy0 + G11 * dy1
    det = abs(a * d - b * c)
    of_x, of_y = abs(b) + abs(d), abs(a) + abs(c)
    least_rounding, least_tolerance = rounding**0.75, tolerance**0.75
    out[row, 4] = min(1.0, of_x * rounding / max(det, least_rounding))
    out[row, 5] = min(1.0, of_x * tolerance / max(det, least_tolerance))
    out[row, ROUNDING_ERROR] = min(1.0, of_y * rounding / max(det, least_rounding))
    out[row, TOLERANCE_ERROR] = min(1.0, of_y * tolerance / max(det, least_tolerance))
