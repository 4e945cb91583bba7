"""The singular value decomposition of a (6, n) Jacobian by one-sided Jacobi rotations.

Source: Hestenes (1958), "Inversion of matrices by biorthogonalization and related results": rotations of pairs of rows
of J make all rows orthogonal; then their lengths are the singular values, the unit rows the right singular vectors,
and the product of the rotations the left ones.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.compiled import compiled
from pinproof.kernels.workspace import VALUES

__all__ = ["decompose"]

MOST_SWEEPS = 30
"""Sweeps converge quadratically: six are the usual number."""

ORTHOGONAL = 1e-15
"""Rows count as orthogonal when their cosine is below this."""


@compiled
def decompose(rows: Any, left: Any, errors: Any) -> None:
    """Decompose ``rows`` (6, n) = left diag(values) right; the rows of ``right`` times ``values`` stay in ``rows``.

    ``left`` (6, 6) contains one left singular vector per column; the values, row VALUES of ``errors``, are not sorted.
    """
    n = rows.shape[1]
    for i in range(6):
        for j in range(6):
            left[i, j] = 1.0 if i == j else 0.0
    for _ in range(MOST_SWEEPS):
        turned = False
        for i in range(5):
            for j in range(i + 1, 6):
                a = b = c = 0.0
                for k in range(n):
                    a += rows[i, k] * rows[i, k]
                    b += rows[j, k] * rows[j, k]
                    c += rows[i, k] * rows[j, k]
                if c * c <= ORTHOGONAL * ORTHOGONAL * a * b:
                    continue
                turned = True
                tangent = (b - a) / (2.0 * c)
                t = (1.0 if tangent >= 0.0 else -1.0) / (abs(tangent) + math.sqrt(1.0 + tangent * tangent))
                cosine = 1.0 / math.sqrt(1.0 + t * t)
                sine = cosine * t
                for k in range(n):
                    x, y = rows[i, k], rows[j, k]
                    rows[i, k], rows[j, k] = cosine * x - sine * y, sine * x + cosine * y
                for k in range(6):
                    x, y = left[k, i], left[k, j]
                    left[k, i], left[k, j] = cosine * x - sine * y, sine * x + cosine * y
        if not turned:
            break
    for i in range(6):
        total = 0.0
        for k in range(n):
            total += rows[i, k] * rows[i, k]
        errors[VALUES, i] = math.sqrt(total)
