r"""The triple: three consecutive joints whose common motion W is known.

Their lines are rows 0, 1, 2: f, g, l (first, middle, last). Three conditions determine the joints, in this order:

1. the middle from what the first cannot change, linear in its state (:func:`pinproof.kernels.roots.linear_roots`):
   *spherical* h_f . R_g h_l = h_f . R_W h_l; *planar*, with r = E_g o_l, the distance of r from the first line, or,
   if the first is prismatic along d, its height over d: \|r - o_f\| = \|W o_l - o_f\|, (n x d) . r = (n x d) . W o_l;
2. the first joint by rotating (or moving) R_g h_l to R_W h_l, or r to W o_l;
3. the last joint by the remaining motion of a direction e perpendicular to its line, R_g^T R_f^T R_W e.

If the vector in 2 is parallel to the line (a straight wrist; a folded elbow), the first joint is free, and 3
compensates for its value. A planar triple whose last joint is prismatic is reversed, W^-1 = E_l^-1 E_g^-1 E_f^-1, if
its first one is revolute; if that is prismatic too, the middle joint is the rotation of W, and the others share its
translation.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import compiled
from pinproof.kernels.roots import FREE, ROUNDING, UNCERTAIN, linear_roots, root_errors
from pinproof.kernels.two_curves import (
    CANDIDATES,
    DOUBTFUL,
    FREED,
    NEAR,
    ROUNDING_ERROR,
    SNAPPED,
    TOLERANCE_ERROR,
    UNDECIDED,
    WHICH,
    aligned,
    gram,
    reference_state,
)
from pinproof.kernels.vectors import (
    SLIDING,
    across,
    cross,
    curve,
    direction,
    dot,
    minus,
    moved,
    perpendicular,
    place,
    turned,
    unturned,
)

__all__ = ["STATES", "triple"]

STATES = 16
"""The entries of a solution: six states, the free joints, its number, the free joints that are SNAPPED (see
:mod:`pinproof.kernels.two_curves`), and the error of its joints (rad, or lengths of the arm) due to the tolerances."""

OF_A_SNAPPED_JOINT = 1000
"""Added to the number of a solution with a joint of the triple that is SNAPPED."""


@compiled
def triple(
    lines: Any,
    planar: Any,
    normal: Any,
    reverse: Any,
    rotation: Any,
    shift: Any,
    chosen: Any,
    row: int,
    border: float,
    spread: float,
    snap: Any,
    out: Any,
    count: int,
) -> int:
    """Complete solutions for row ``row`` of ``chosen`` into ``out`` from ``count``; returns the new count.

    ``rotation`` (three rows) and ``shift`` are G; a column of ``out`` (STATES, k) gets the six states in the order of
    ``lines``, then the free joints (bits of rows) and the number of the solution. The lines of a reversed triple are in
    reverse order. With ``snap``, joints that depend on the direction of an UNCERTAIN vector are free.
    """
    x, y, z = (chosen[row, 0], chosen[row, 1]), (chosen[row, 2], chosen[row, 3]), (chosen[row, 4], chosen[row, 5])
    ha, hb, hc = direction(lines, 3), direction(lines, 4), direction(lines, 5)
    oa, ob, oc = place(lines, 3), place(lines, 4), place(lines, 5)
    sa, sb, sc = lines[3, SLIDING] != 0.0, lines[4, SLIDING] != 0.0, lines[5, SLIDING] != 0.0
    hf, hg, hl = direction(lines, 0), direction(lines, 1), direction(lines, 2)
    of, og, ol = place(lines, 0), place(lines, 1), place(lines, 2)
    sf, sg, sl = lines[0, SLIDING] != 0.0, lines[1, SLIDING] != 0.0, lines[2, SLIDING] != 0.0
    R0, R1, R2 = rotation

    # W applied to a point (o_l, or o_g if only the middle joint is revolute) and to the directions e and h_l.
    between = sf and sl
    point = og if between else ol
    e = perpendicular(hg if between else hl)
    goal, seen = point, e
    top = hl
    if reverse:
        d = minus(goal, shift)
        goal = (R0[0] * d[0] + R1[0] * d[1] + R2[0] * d[2], R0[1] * d[0] + R1[1] * d[1] + R2[1] * d[2],
                R0[2] * d[0] + R1[2] * d[1] + R2[2] * d[2])  # fmt: skip
        seen = (R0[0] * e[0] + R1[0] * e[1] + R2[0] * e[2], R0[1] * e[0] + R1[1] * e[1] + R2[1] * e[2],
                R0[2] * e[0] + R1[2] * e[1] + R2[2] * e[2])  # fmt: skip
        goal = moved(ha, oa, sa, y, 1.0, moved(hb, ob, sb, z, 1.0, moved(hc, oc, sc, x, 1.0, goal)))
        seen = unturned(ha, sa, y, 1.0, unturned(hb, sb, z, 1.0, unturned(hc, sc, x, 1.0, seen)))
    else:
        seen = unturned(hc, sc, x, -1.0, unturned(hb, sb, z, -1.0, unturned(ha, sa, y, -1.0, seen)))
        seen = (dot(R0, seen), dot(R1, seen), dot(R2, seen))
        if planar:
            goal = moved(hc, oc, sc, x, -1.0, moved(hb, ob, sb, z, -1.0, moved(ha, oa, sa, y, -1.0, goal)))
            goal = (dot(R0, goal) + shift[0], dot(R1, goal) + shift[1], dot(R2, goal) + shift[2])
        else:
            top = unturned(hc, sc, x, -1.0, unturned(hb, sb, z, -1.0, unturned(ha, sa, y, -1.0, top)))
            top = (dot(R0, top), dot(R1, top), dot(R2, top))

    freed, which, snapped = int(chosen[row, FREED]), 2.0 * chosen[row, WHICH], int(chosen[row, SNAPPED])
    rounding, tolerance = chosen[row, ROUNDING_ERROR], chosen[row, TOLERANCE_ERROR]
    # The equation of the middle joint, A b_1 + B b_2 + C = 0 with the error of C, and the length that decides whether
    # the first joint is free.
    A, B, length = 0.0, 0.0, 1.0
    rounding_g = tolerance_g = 0.0
    if not planar:
        alpha, beta = dot(hf, hg), dot(hl, hg)
        off = across(top, hf)
        square = gram(alpha, beta, dot(hf, top), dot(off, off))
        length = math.sqrt(dot(off, off))
        tilt = abs(abs(alpha) - abs(beta))
        rounding_g = ROUNDING * tilt + (length + rounding) * rounding
        tolerance_g = ROUNDING * tilt + (length + tolerance) * tolerance
        A, B = dot(hf, hl) - alpha * beta, dot(hf, cross(hg, hl))
        near = max(border, NEAR * tolerance_g)
        found, g1, g2 = linear_roots(False, A, B, alpha * beta - dot(hf, top), square, near, spread, FREE)
    elif between:
        c, s, _ = aligned(hg, e, seen)
        found, g1, g2 = 1, (c, s), (c, s)
    else:
        centre, u, w = curve(hg, og, sg, 1.0, ol)
        if sf:
            d = cross(normal, hf)
            A, B, C = dot(d, u), dot(d, w), dot(d, minus(centre, goal))
            rounding_g, tolerance_g = ROUNDING + rounding, ROUNDING + tolerance
        else:
            near_axis, far = across(minus(centre, of), normal), across(minus(goal, of), normal)
            A, C = 2.0 * dot(near_axis, u), dot(near_axis, near_axis) - dot(far, far)
            B = 1.0 if sg else 2.0 * dot(near_axis, w)
            C += 0.0 if sg else dot(u, u)
            length = math.sqrt(dot(far, far))
            rounding_g = ROUNDING + (2.0 * length + rounding) * rounding
            tolerance_g = ROUNDING + (2.0 * length + tolerance) * tolerance
        free = FREE
        if max(abs(A), abs(B)) < UNCERTAIN * rounding_g and max(abs(A), abs(B)) >= 0.7 * FREE:
            chosen[CANDIDATES, UNDECIDED] = float(int(chosen[CANDIDATES, UNDECIDED]) | 2)
            free = 2.0 * UNCERTAIN * rounding_g if snap else FREE
        found, g1, g2 = linear_roots(sg, A, B, C, math.nan, max(border, NEAR * tolerance_g), spread, free)
        if found < 0 and free != FREE:
            snapped |= 2
    if found < 0:
        g1, found, freed = reference_state(lines, 1), 1, freed | 2
    for i in range(found):
        g = g1 if i == 0 else g2
        also, snapped_too = freed, snapped
        known_g, tolerated_g = 0.0, 0.0
        if not between and not freed & 2:
            known_g, tolerated_g = root_errors(sg and planar, A, B, g, rounding_g, tolerance_g)
        off_by = tolerance + tolerated_g
        if between:
            # W o_g - o_g = q_f d_f + q_l R_g d_l, in the plane.
            way, last = minus(goal, og), turned(hg, g[0], g[1], hl)
            det = dot(normal, cross(hf, last))
            if abs(det) < max(FREE, UNCERTAIN * rounding):
                chosen[CANDIDATES, DOUBTFUL] = 1.0  # Both are prismatic in one direction: free, which is not supported.
                continue
            off_by /= min(1.0, abs(det))
            f0, l0 = dot(normal, cross(way, last)) / det, dot(normal, cross(hf, way)) / det
            f1, l1 = f0 * f0, l0 * l0
        else:
            r = moved(hg, og, sg, g, 1.0, ol) if planar else turned(hg, g[0], g[1], hl)
            if sf:
                f0 = dot(hf, minus(goal, r))
                f1 = f0 * f0
            else:
                if planar:
                    f0, f1, size = aligned(hf, minus(r, of), minus(goal, of))
                else:
                    f0, f1, size = aligned(hf, r, top)
                uncertain = UNCERTAIN * ((rounding + known_g) if planar else rounding)
                if size < FREE * FREE or (not planar and dot(off, off) < FREE * FREE):
                    (f0, f1), also = reference_state(lines, 0), also | 1
                elif min(size, length * length) < uncertain * uncertain:
                    chosen[CANDIDATES, UNDECIDED] = float(int(chosen[CANDIDATES, UNDECIDED]) | 2)
                    off_by = 1.0
                    if snap:
                        (f0, f1), also, snapped_too = reference_state(lines, 0), also | 1, snapped_too | 1
                else:
                    off_by += off_by / min(1.0, length)
            left = unturned(hg, sg, g, -1.0, unturned(hf, sf, (f0, f1), -1.0, seen))
            l0, l1, _ = aligned(hl, e, left)
        name = which + i + (OF_A_SNAPPED_JOINT if snapped_too != int(chosen[row, SNAPPED]) else 0)
        states = (
            f0, f1, g[0], g[1], l0, l1, y[0], y[1], z[0], z[1], x[0], x[1], float(also), name, float(snapped_too),
            off_by,
        )  # fmt: skip
        for entry in range(STATES):
            out[entry, count] = states[entry]
        count += 1
    return count
