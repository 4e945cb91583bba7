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

    An interval ends where the number of branches changes between two neighbouring values; what comes and goes between
    two of them is not seen.
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
    found, start = [], float(values[0])
    for i in range(len(values) - 1):
        if counts[i] == counts[i + 1]:
            continue
        end = _change(plan, target, reference, float(values[i]), float(values[i + 1]), int(counts[i]))
        found.append(Interval(start, end, int(counts[i])))
        start = end
    found.append(Interval(start, float(values[-1]), int(counts[-1])))
    return tuple(one for one in found if one.branches)


def _change(plan: Plan, target: Array, reference: Array, low: float, high: float, count: int) -> float:
    """Where, between two values, the number of branches leaves ``count``; the last value that still has it."""
    out = np.empty(plan.shape)
    while high - low > END:
        middle = (low + high) / 2
        if plan.kernel(plan.array, target, reference, middle, out) == count:
            low = middle
        else:
            high = middle
    return low if count else high
