"""Seven joints: one of them swept, the other six in closed form at each of its values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.ik.analytic.plan import Plan

__all__ = ["Interval", "joined", "sweep"]

Array = npt.NDArray[np.float64]

END = 1e-9
"""Rad or m: how closely the ends of an interval are told."""


@dataclass(frozen=True)
class Interval:
    """Values of the redundant joint, from ``lower`` to ``upper``, each of which has ``branches`` configurations."""

    lower: float
    upper: float
    branches: int


def joined(intervals: tuple[Interval, ...]) -> list[tuple[float, float]]:
    """Lower and upper ends of where there are any branches: neighbouring intervals put together."""
    spans: list[tuple[float, float]] = []
    for one in intervals:
        if spans and one.lower - spans[-1][1] <= 2 * END:
            spans[-1] = (spans[-1][0], one.upper)
        else:
            spans.append((one.lower, one.upper))
    return spans


def sweep(plan: Plan, target: Array, reference: Array, values: Array) -> tuple[Array, tuple[Interval, ...]]:
    """The rows (b + 1, n + 4) of all values together, as the kernel lays out those of one, and the intervals.

    An interval ends where the number of branches changes between two neighbouring values; branches that come and go
    between two values are not seen.
    """
    from pinproof.kernels.branches import branches_of_values

    counts = np.zeros(len(values), dtype=np.int64)
    q = np.empty((len(values), plan.capacity, plan.dof))
    errors = np.empty((len(values), plan.capacity, 2))
    branches_of_values(plan.array, target, reference, values, q, errors, counts)
    there = np.arange(plan.capacity) < counts[:, None]
    rows = np.zeros((int(there.sum()) + 1, plan.dof + 4))
    rows[:-1, : plan.dof], rows[:-1, plan.dof : plan.dof + 2] = q[there], errors[there]
    return rows, _intervals(plan, target, reference, values, counts)


def _intervals(
    plan: Plan, target: Array, reference: Array, values: Array, counts: npt.NDArray[np.int64]
) -> tuple[Interval, ...]:
    found, start, count, out = [], float(values[0]), int(counts[0]), np.empty(plan.shape)
    for i in range(len(values) - 1):
        low = float(values[i])
        while count != counts[i + 1]:
            high = float(values[i + 1])
            while high - low > END:
                middle = (low + high) / 2
                if plan.kernel(plan.array, target, reference, middle, out) == count:
                    low = middle
                else:
                    high = middle
            found.append(Interval(start, low, count))
            # Not always what the next value of the grid has: several changes may lie between two values.
            start = low = high
            count = plan.kernel(plan.array, target, reference, high, out)
    found.append(Interval(start, float(values[-1]), count))
    return tuple(one for one in found if one.branches)
