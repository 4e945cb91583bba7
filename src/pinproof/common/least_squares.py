"""Least squares with shares of 0 or more.

Source: C. Lawson, R. Hanson, "Solving least squares problems" (1974), chapter 23 (algorithm NNLS). SciPy has it too, in
a package that takes half a second to load.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-12
"""A column whose product with the rest is at most this share of the rest does not reduce it."""

SOLVED = 1e-12
"""Share of the wanted vector that counts as no rest."""

MOST_EXCHANGES, VANISHED = 1000, 1e-15
"""Largest number of columns that are taken, of which 5 to 30 are usual, and a share that counts as 0."""


def non_negative_shares(system: Array, wanted: Array) -> Array:
    """The shares (k,), 0 or more, with which the columns (m, k) come nearest to the wanted vector (m,)."""
    shares, used = np.zeros(system.shape[1]), np.zeros(system.shape[1], dtype=bool)
    for _ in range(MOST_EXCHANGES):
        # The column that reduces the rest most is used too; without any, the rest is the smallest possible. Columns
        # exchange places without end where the rest consists of rounding errors only
        left = wanted - system @ shares
        gain, rest = np.where(used, -np.inf, left @ system), float(np.linalg.norm(left))
        if rest <= SOLVED * float(np.linalg.norm(wanted)) or gain.max(initial=-np.inf) <= TOLERANCE * rest:
            break
        used[gain.argmax()] = True
        while True:
            rows = np.flatnonzero(used)
            best = np.linalg.lstsq(system[:, rows], wanted, rcond=None)[0]
            if (best > 0.0).all():
                shares[rows] = best
                break
            # As far towards the best shares as all remain positive, and without those that become 0
            shrink = best <= 0.0
            here, there = shares[rows[shrink]], best[shrink]
            step = (here / np.maximum(here - there, np.finfo(float).tiny)).min()
            shares[rows] += step * (best - shares[rows])
            used[rows[shrink & (shares[rows] <= VANISHED)]] = False
            shares[~used] = 0.0
    return shares
