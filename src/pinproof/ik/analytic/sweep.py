"""Seven joints: one of them swept, the other six in closed form at each of its values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.ik.analytic.plan import Plan

__all__ = ["Interval", "joined", "sweep", "sweep_many"]

Array = npt.NDArray[np.float64]

END = 1e-9
"""Rad or m: how closely the ends of an interval are told."""

BLOCK = 256
"""Targets that are swept at a time: room is needed for all the branches there could be."""


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
    q, errors, counts, _ = sweep_many(plan, target[None], reference[None], values[None])
    rows = np.zeros((len(q) + 1, plan.dof + 4))
    rows[:-1, : plan.dof], rows[:-1, plan.dof : plan.dof + 2] = q, errors
    return rows, _intervals(plan, target, reference, values, counts[0])


def sweep_many(
    plan: Plan, targets: Array, references: Array, values: Array
) -> tuple[Array, Array, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """The branches for targets (N, 4, 4) at values (1, v) or (N, v), one behind the other, each row's in its order.

    Returns q (b, n), errors (b, 2), how many are of each target and value (N, v), and how many there would be of each
    without limits alone to rule them out (N, v).
    """
    from pinproof.kernels.branches import branches_of_many

    v = values.shape[1]
    counts, outside = np.zeros((2, len(targets) * v), dtype=np.int64)
    known = np.empty(BLOCK * v, dtype=np.bool_)
    found, missed = [np.empty((0, plan.dof))], [np.empty((0, 2))]
    for first in range(0, len(targets), BLOCK):
        rows = slice(first, first + BLOCK)
        some, here = targets[rows], slice(first * v, (first + BLOCK) * v)
        q = np.empty((len(some) * v, plan.capacity, plan.dof))
        errors = np.empty((len(some) * v, plan.capacity, 2))
        own = [each if len(each) == 1 else each[rows] for each in (references, values)]
        branches_of_many(plan.array, some, *own, 0, len(q), q, errors, counts[here], outside[here], known)
        np.maximum(counts[here], 0, out=counts[here])  # other values of what is free there are other values swept
        there = np.arange(plan.capacity) < counts[here, None]
        found.append(q[there])
        missed.append(errors[there])
    return np.concatenate(found), np.concatenate(missed), counts.reshape(-1, v), outside.reshape(-1, v)


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
