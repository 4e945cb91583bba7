"""Second solutions close to a first one: if two branches nearly meet, a deviation from the ideal moves them far.

Two branches of six joints meet where the Jacobian J is singular; near there both are along the joint motion v that J
maps nearly to zero. Their distance is proportional to the square root of the deviation of the arm from one at which
they meet: for a calibrated arm they may be far from those of the ideal arm, or only one of them may exist. Starts of
Newton's method are therefore distributed along v.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.chain import jacobian_of, walk, whole_vectors
from pinproof.kernels.cholesky import factor, gram, solve_factored
from pinproof.kernels.compiled import compiled

__all__ = ["WAYS", "weakest_motion"]

WAYS = np.array([0.004, -0.004, 0.02, -0.02, 0.08, -0.08, 0.25, -0.25, 0.6, -0.6])
"""Rad or m along v. Newton's method converges to the closest solution; these starts are a few times further apart."""

SHIFT = 1e-12
"""Added to J^T J, so that it is invertible if it is singular."""

ROUNDS = 3


@compiled
def weakest_motion(plan: Any, n: int, fixed: int, q: Any, motion: Any) -> float:
    """The unit joint motion (n,) that moves the tcp least at q (n,), and that motion (m and rad), for six joints.

    By inverse iteration on J^T J. Infinite if not exactly six joints move; ``fixed`` is the locked joint of seven (-1:
    none).
    """
    if n - (0 if fixed < 0 else 1) != 6:
        return math.inf
    chain = plan[1 : n + 2]
    turns, axes, end, start = np.zeros((3, whole_vectors(n))), np.empty((n, 6)), np.empty((3, 4)), np.zeros((3, 4))
    jacobian, rows, square, lower = np.empty((6, n)), np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    start[0, 0] = start[1, 1] = start[2, 2] = 1.0
    walk(chain, start, q, turns, axes, end)
    jacobian_of(chain, axes, end, jacobian)
    k = 0
    for j in range(n):
        if j != fixed:
            for i in range(6):
                rows[k, i] = jacobian[i, j]
            k += 1
    gram(rows, square)
    if not factor(square, SHIFT, lower):
        return math.inf
    vectors = np.empty((2, 6))
    for i in range(6):
        vectors[0, i] = 1.0 - 0.1 * i
    size = 1.0
    for _ in range(ROUNDS):
        solve_factored(lower, vectors, 0, 1)
        size = 0.0
        for i in range(6):
            size += vectors[1, i] * vectors[1, i]
        size = math.sqrt(size)
        for i in range(6):
            vectors[0, i] = vectors[1, i] / size
    k = 0
    for j in range(n):
        motion[j] = 0.0
        if j != fixed:
            motion[j] = vectors[0, k]
            k += 1
    return 1.0 / math.sqrt(size)
