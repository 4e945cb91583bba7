"""The manipulability of an arm at many configurations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pinproof.kernels.chain import jacobian_of, walk, whole_vectors
from pinproof.kernels.compiled import compiled
from pinproof.kernels.goals import log_manipulability

__all__ = ["manipulability_many"]


@compiled
def manipulability_many(chain: Any, Q: Any, out: Any) -> None:
    """sqrt(det(J J^T)) of the tcp's Jacobian at each row of Q (N, n) into ``out`` (N,); J^T J with n < 6 joints."""
    m, n = chain.shape[0] - 1, Q.shape[1]
    start, turns, axes = np.eye(3, 4), np.zeros((3, whole_vectors(m))), np.empty((m, 6))
    end, jacobian, square, lower = np.empty((3, 4)), np.empty((6, n)), np.empty((6, 6)), np.empty((6, 6))
    for i in range(Q.shape[0]):
        walk(chain, start, Q[i], turns, axes, end)
        jacobian_of(chain, axes, end, jacobian)
        out[i] = math.exp(log_manipulability(jacobian, square, lower))
