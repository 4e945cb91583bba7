"""Changes of the order of a tour: the reversal of a part, and the exchange of two neighbouring parts.

The times between the stops of a tour are a matrix D (N, N), which need not be symmetric, with the start and the end as
its first and last stop. Sums along the tour in both directions give the gain of every reversal at once (2-opt), and of
every move of a short part to another position (Or-opt). A change is made if it keeps all pairs in their fixed order;
parts with such a pair inside are not changed.

Sources: G. Croes (1958), "A method for solving traveling-salesman problems", Operations Research 6(6); I. Or (1976),
"Traveling salesman-type combinatorial problems and their relation to the logistics of regional blood banking".
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["exchanged"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

LONGEST = 8
"""Largest number of stops of a part that moves to another position."""

GAIN = 1e-9
"""Seconds: smaller differences are rounding."""


def exchanged(times: Array, before: Indices, after: Indices) -> Indices:
    """The order (N,) of the stops of a tour after the best changes, until none helps.

    Parameters
    ----------
    times
        (N + 2, N + 2) times between the start, the stops in their present order, and the end.
    before, after
        (K,) pairs of stops, by their present position from 0: the first must remain before the second.
    """
    order = np.arange(len(times))
    while True:
        now = times[np.ix_(order, order)]
        place = np.argsort(order)
        latest, earliest = np.full(len(order), -1), np.full(len(order), len(order))
        np.maximum.at(latest, place[after + 1], place[before + 1])
        np.minimum.at(earliest, place[before + 1], place[after + 1])
        gain, change = min((_reversal(now, latest), _move(now, latest, earliest)), key=lambda each: each[0])
        if not gain < -GAIN:
            return order[1:-1] - 1
        order = order[change]


def _reversal(now: Array, latest: Indices) -> tuple[float, Indices]:
    """The best reversal of the stops i to j: the change of the time (s) and the new order."""
    n = len(now)
    here = np.arange(n)
    step, back = now[here[:-1], here[1:]], now[here[1:], here[:-1]]
    with np.errstate(invalid="ignore"):
        forth, reverse = (np.concatenate([[0.0], np.cumsum(each)]) for each in (step, back))
        i, j = here[1:-1, None], here[None, 1:-1]
        change = now[i - 1, j] + now[i, j + 1] - step[i - 1] - step[j]
        change = change + (reverse[j] - reverse[i]) - (forth[j] - forth[i])
    within = np.maximum.accumulate(np.where(j >= i, latest[1:-1], -1), axis=1)  # of the stops i to j
    change = np.where((j > i) & (within < i) & np.isfinite(change), change, np.inf)
    first, last = np.unravel_index(int(change.argmin()), change.shape)
    order = here.copy()
    order[first + 1 : last + 2] = order[first + 1 : last + 2][::-1]
    return float(change[first, last]), order


def _move(now: Array, latest: Indices, earliest: Indices) -> tuple[float, Indices]:
    """The best move of at most :data:`LONGEST` consecutive stops: the change of the time (s) and the new order."""
    n = len(now)
    here = np.arange(n)
    step = now[here[:-1], here[1:]]
    best, found = np.inf, here
    for length in range(1, min(LONGEST, n - 3) + 1):
        i = here[1 : n - length, None]  # the stops i to i + length - 1 move between k and k + 1
        k = here[None, :-1]
        last = i + length - 1
        with np.errstate(invalid="ignore"):
            change = now[i - 1, last + 1] - step[i - 1] - step[last] - step[k] + now[k, i] + now[last, k + 1]
        windows = i + here[None, :length]
        low, high = latest[windows].max(axis=1)[:, None], earliest[windows].min(axis=1)[:, None]
        left, right = (k < i - 1) & (k >= low), (k > last) & (k < high)
        change = np.where((left | right) & np.isfinite(change), change, np.inf)
        row, to = (int(each) for each in np.unravel_index(int(change.argmin()), change.shape))
        if change[row, to] < best:
            best, at = float(change[row, to]), row + 1
            part = here[at : at + length]
            rest = np.concatenate([here[:at], here[at + length :]])
            cut = to + 1 if to < at else to + 1 - length
            found = np.concatenate([rest[:cut], part, rest[cut:]])
    return best, found
