"""Symmetric positive definite 6 x 6 systems of least squares, solved in place."""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import inlined

__all__ = ["factor", "gram", "solve_factored"]


@inlined
def gram(rows: Any, square: Any) -> None:
    """A A^T (6, 6) of A = ``rows`` (6, n), lower triangle, into ``square``."""
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(rows.shape[1]):
                total += rows[i, k] * rows[j, k]
            square[i, j] = total


@inlined
def factor(square: Any, shift: float, lower: Any) -> bool:
    """The Cholesky factor of ``square + shift I`` into ``lower``, the diagonal inverted; False if it does not exist."""
    for i in range(6):
        for j in range(i):
            total = square[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = total * lower[j, j]
        pivot = square[i, i] + shift
        for k in range(i):
            pivot -= lower[i, k] * lower[i, k]
        if not pivot > 0.0:
            return False
        lower[i, i] = 1.0 / math.sqrt(pivot)
    return True


@inlined
def solve_factored(lower: Any, vectors: Any, right: int, x: int) -> None:
    """Row ``x`` of ``vectors`` (k, 6) from its row ``right``: ``lower lower^T x = right``."""
    for i in range(6):
        total = vectors[right, i]
        for k in range(i):
            total -= lower[i, k] * vectors[x, k]
        vectors[x, i] = total * lower[i, i]
    for j in range(6):
        i = 5 - j
        total = vectors[x, i]
        for k in range(i + 1, 6):
            total -= lower[k, i] * vectors[x, k]
        vectors[x, i] = total * lower[i, i]
