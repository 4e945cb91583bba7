"""Newton's method on the true chain, for branches of an ideal arm that is close to the true one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.chain import jacobian_of, walk, whole_vectors
from pinproof.kernels.cholesky import factor, gram, solve_factored
from pinproof.kernels.compiled import compiled
from pinproof.kernels.lanes import wind
from pinproof.kernels.vectors import SLIDING

__all__ = ["AT_LIMIT", "refined"]

SPREAD = 8
OWN, LOWER, UPPER = 8, 9, 10

STEPS = 60

SMALLEST_DAMPING, LARGEST_DAMPING = 1e-13, 1e-4
"""Added to J J^T. Near a singular target the singular direction has no residual, and the others are not affected."""

AT_LIMIT = 1e-5
"""Rad or m. Where two branches meet, rounding (1e-16) moves joints by its square root (1e-8), where several meet by
more."""

GROWTH, RELIEF = 8.0, 0.25
"""Factors of the damping after a step that increased the error, or decreased it."""

SMALL_ENOUGH, ROUNDING = 1e-14, 1e-11
"""The residual (m and rad) is converged; or too small for further steps with more damping."""

SLOW, PATIENCE = 0.5, 3
"""Maximum number of consecutive steps that reduce the squared residual by less than this factor: there is no
solution."""

LONGEST = 0.3
"""Rad or m: the largest step."""


@compiled
def refined(
    plan: Any, n: int, top: int, locked: int, pose: Any, reference: Any, Q: Any, b: int, slack: float, at_limit: float,
    still: int,
) -> Any:  # fmt: skip
    """Refine column b of Q (n, lanes) in place; returns distance (m), angle (rad), and the violation of the limits.

    Steps are J^T (J J^T + damping)^-1 times the residual in the axes of the target, as long as they reduce it. A joint
    that exceeds a limit by less than ``slack`` is moved to it. If it exceeds it by less than ``at_limit``, the other
    joints compensate: at a singular target rounding moves a joint by that much. Joints whose bit is set in ``still``
    are held.
    """
    chain = plan[1 : n + 2]
    turns, axes, end = np.zeros((3, whole_vectors(n))), np.empty((n, 6)), np.empty((3, 4))
    start, jacobian, q, best = np.empty((3, 4)), np.empty((6, n)), np.empty(n), np.empty(n)
    square, lower, vectors, held = np.empty((6, 6)), np.empty((6, 6)), np.empty((2, 6)), np.zeros(n)
    for i in range(3):
        for j in range(3):
            start[i, j] = pose[j, i]
        start[i, 3] = -(pose[0, i] * pose[0, 3] + pose[1, i] * pose[1, 3] + pose[2, i] * pose[2, 3])
    fixed = -1 if locked < 0 else int(plan[top + locked, OWN])
    lines = 6 if locked < 0 else 7
    if fixed >= 0:
        held[fixed] = 1.0
    for j in range(n):
        q[j] = best[j] = Q[j, b]
        if still >> j & 1:
            held[j] = 1.0

    # The deviation from an ideal arm is rounding: one or two steps remove it, or none does.
    patience = PATIENCE if plan[0, SPREAD] > 0.0 else 0
    distance = angle = beyond = math.inf
    for again in range(2):
        least, growth, slow = math.inf, 1.0, 0
        for _ in range(STEPS):
            walk(chain, start, q, turns, axes, end)
            # The rotation vector for small angles: half of the vector of R - R^T.
            x, y, z = 0.5 * (end[2, 1] - end[1, 2]), 0.5 * (end[0, 2] - end[2, 0]), 0.5 * (end[1, 0] - end[0, 1])
            sine, cosine = math.sqrt(x * x + y * y + z * z), 0.5 * (end[0, 0] + end[1, 1] + end[2, 2] - 1.0)
            way = math.sqrt(end[0, 3] * end[0, 3] + end[1, 3] * end[1, 3] + end[2, 3] * end[2, 3])
            left = way * way + sine * sine
            if cosine < 0.0:
                break
            if left < least:
                slow = slow + 1 if left > SLOW * least else 0
                least, distance, angle = left, way, math.atan2(sine, cosine)
                growth = max(growth * RELIEF, 1.0)
                for j in range(n):
                    best[j] = q[j]
                if left < SMALL_ENOUGH * SMALL_ENOUGH or slow > patience:
                    break
                vectors[0, 0], vectors[0, 1], vectors[0, 2] = end[0, 3], end[1, 3], end[2, 3]
                vectors[0, 3], vectors[0, 4], vectors[0, 5] = x, y, z
                jacobian_of(chain, axes, end, jacobian)
                for j in range(n):
                    if held[j] != 0.0:
                        for i in range(6):
                            jacobian[i, j] = 0.0
                gram(jacobian, square)
            else:
                if least < ROUNDING * ROUNDING or patience == 0:
                    break
                growth *= GROWTH
            if not factor(square, growth * min(max(least, SMALLEST_DAMPING), LARGEST_DAMPING), lower):
                break
            solve_factored(lower, vectors, 0, 1)
            longest = 0.0
            for j in range(n):
                turns[0, j] = 0.0
                for i in range(6):
                    turns[0, j] += jacobian[i, j] * vectors[1, i]
                longest = max(longest, abs(turns[0, j]))
            share = min(1.0, LONGEST / longest) if longest > 0.0 else 1.0
            for j in range(n):
                q[j] = best[j] - share * turns[0, j]

        beyond, clipped, retry = 0.0, False, False
        for k in range(top, top + lines):
            own = int(plan[k, OWN])
            if own < 0:
                continue
            low, high = plan[k, LOWER], plan[k, UPPER]
            value = best[own]
            if plan[k, SLIDING] == 0.0 and own != fixed:
                value = wind(value, low, high, slack, reference[own])
            inside = min(max(value, low), high)
            if abs(value - inside) > slack:
                beyond = max(beyond, abs(value - inside))
                if again == 0 and held[own] == 0.0 and abs(value - inside) <= at_limit:
                    held[own] = 1.0
                    retry = True
            clipped = clipped or inside != value
            Q[own, b] = q[own] = inside
        if not retry or beyond > at_limit:
            break
    if clipped:
        walk(chain, start, q, turns, axes, end)
        x, y, z = 0.5 * (end[2, 1] - end[1, 2]), 0.5 * (end[0, 2] - end[2, 0]), 0.5 * (end[1, 0] - end[0, 1])
        angle = math.atan2(math.sqrt(x * x + y * y + z * z), 0.5 * (end[0, 0] + end[1, 1] + end[2, 2] - 1.0))
        distance = math.sqrt(end[0, 3] * end[0, 3] + end[1, 3] * end[1, 3] + end[2, 3] * end[2, 3])
    return distance, angle, beyond
