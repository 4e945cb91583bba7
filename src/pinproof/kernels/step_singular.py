"""The steps of :class:`pinproof.PseudoInverse` and :class:`pinproof.DampedLeastSquares`, from singular values."""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import compiled
from pinproof.kernels.singular_values import decompose
from pinproof.kernels.workspace import PULL, STEP, VALUES

__all__ = ["step_singular"]


NOTHING = 1e-12
"""An entry or a singular value of a Jacobian below this (m or rad) is due to rounding."""


@compiled
def step_singular(
    cutoff: float, damping: float, region: float, jacobian: Any, rows: Any, left: Any, joints: Any, errors: Any
) -> None:
    """The step -A^T (A A^T + lambda^2 I)^-1 pull with A = ``jacobian``, into the row STEP of ``joints``.

    Singular values up to ``cutoff`` times the largest are treated as zero. With the smallest singular value s within
    the rank of A, lambda^2 = damping^2 |pull| (1 - (s / region)^2) for s below ``region``, else 0. Without damping this
    is the pseudo-inverse.
    """
    n, largest = jacobian.shape[1], 0.0
    for i in range(6):
        for j in range(n):
            rows[i, j] = jacobian[i, j]
    decompose(rows, left, errors)
    for i in range(6):
        largest = max(largest, errors[VALUES, i])
    squared = 0.0
    if damping > 0.0:
        smallest = _smallest(jacobian, errors)
        if smallest < region:
            size = 0.0
            for i in range(6):
                size += errors[PULL, i] * errors[PULL, i]
            squared = damping * damping * math.sqrt(size) * (1.0 - (smallest / region) * (smallest / region))
    for j in range(n):
        joints[STEP, j] = 0.0
    for i in range(6):
        value = errors[VALUES, i]
        if value <= max(cutoff * largest, NOTHING):
            continue
        along = 0.0
        for k in range(6):
            along += left[k, i] * errors[PULL, k]
        along /= value * value + squared
        for j in range(n):
            joints[STEP, j] -= rows[i, j] * along


@compiled
def _smallest(jacobian: Any, errors: Any) -> float:
    """The smallest singular value within the rank, given the rows that the task omits and the columns that are held."""
    rows = columns = 0
    for i in range(6):
        for j in range(jacobian.shape[1]):
            if abs(jacobian[i, j]) > NOTHING:
                rows += 1
                break
    for j in range(jacobian.shape[1]):
        for i in range(6):
            if abs(jacobian[i, j]) > NOTHING:
                columns += 1
                break
    rank = min(rows, columns)
    for i in range(6):
        value, above = errors[VALUES, i], 0
        for j in range(6):
            if errors[VALUES, j] > value or (errors[VALUES, j] == value and j < i):
                above += 1
        if above == rank - 1:
            return float(value)
    return 0.0
