"""The steps of null-space goals.

A goal is an array (3, n). Row 0: its kind in the first entry (:data:`NONE` and the others below), its gain in the
second (row 0 has at least two entries). For a posture, row 1 is the configuration and row 2 the weight of each joint;
``NEAR`` is the posture from which a search starts.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.chain import jacobian_of, walk
from pinproof.kernels.cholesky import factor, gram
from pinproof.kernels.compiled import compiled
from pinproof.kernels.workspace import DRIFT

__all__ = ["MANIPULABILITY", "NEAR", "NONE", "POSTURE", "drift_of", "log_manipulability"]

NONE, POSTURE, MANIPULABILITY, NEAR = 0.0, 1.0, 2.0, 3.0

FINITE_STEP = 1e-5
"""Rad or m, for central differences of the manipulability: truncation and rounding errors are both about 1e-10 of
it."""

TINY = 1e-14
"""Added to the squares of the singular values, so that the logarithm is finite at singularities."""

LONGEST_DRIFT = 0.2
"""Rad or m: the largest motion of a joint for a goal in one step, so that the task remains nearly satisfied."""


@compiled
def drift_of(
    goal: Any,
    chain: Any,
    q: Any,
    start: Any,
    turns: Any,
    axes: Any,
    end: Any,
    jacobian: Any,
    square: Any,
    lower: Any,
    joints: Any,
) -> None:
    """The step (n,) of the goal before its projection into the null space, into the row DRIFT of ``joints``.

    ``axes`` and ``end`` are left in the state of :func:`walk` at q; ``jacobian`` is not.
    """
    kind, gain, n = goal[0, 0], goal[0, 1], q.shape[0]
    largest = 0.0
    for i in range(n):
        if kind != MANIPULABILITY:
            joints[DRIFT, i] = gain * goal[2, i] * (goal[1, i] - q[i])
        else:
            kept, change = q[i], 0.0
            for side in (-1.0, 1.0):
                q[i] = kept + side * FINITE_STEP
                walk(chain, start, q, turns, axes, end)
                jacobian_of(chain, axes, end, jacobian)
                change += side * log_manipulability(jacobian, square, lower)
            q[i] = kept
            joints[DRIFT, i] = gain * change / (2.0 * FINITE_STEP)
        largest = max(largest, abs(joints[DRIFT, i]))
    if kind == MANIPULABILITY:
        walk(chain, start, q, turns, axes, end)
    if largest > LONGEST_DRIFT:
        for i in range(n):
            joints[DRIFT, i] *= LONGEST_DRIFT / largest


@compiled
def log_manipulability(jacobian: Any, square: Any, lower: Any) -> float:
    """The logarithm of sqrt(det(J J^T + TINY I)) of a Jacobian (6, n); with n < 6 joints of J^T J in its place.

    Source: Yoshikawa (1985), "Manipulability of robotic mechanisms".
    """
    n = jacobian.shape[1]
    gram(jacobian, square)
    if n < 6:  # J^T J, completed by ones on the diagonal
        for i in range(6):
            for j in range(i + 1):
                square[i, j] = 1.0 if i == j else 0.0
                if i < n:
                    square[i, j] = 0.0
                    for k in range(6):
                        square[i, j] += jacobian[k, i] * jacobian[k, j]
    if not factor(square, TINY, lower):
        return math.log(TINY)
    total = 0.0
    for i in range(6):
        total -= math.log(lower[i, i])
    return total
