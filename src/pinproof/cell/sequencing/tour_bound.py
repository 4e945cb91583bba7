r"""A lower bound of the time of every tour through jobs with options.

It is the bound of a linear program whose variables :math:`x_{ab}` are the arcs from option a to option b, or home. One
arc leaves the options of each job, as many arcs enter an option as leave it, and the tour is connected: for a set S of
options without home,

.. math:: \sum_{a \in S, b \notin S} x_{ab} \ge 1 \text{ if S has all options of a job}, \qquad
          \sum_{a \in S, b \notin S} x_{ab} \ge \sum_b x_{ob} \text{ for each option o in S}.

Violated constraints of this kind are found as smallest cuts between home and a job or an option, and added in rounds.
Arcs that the program lacks are added if they would reduce its value. The bound follows from the dual values by weak
duality, which holds for all arcs whether or not the program was solved exactly: the time of a tour is at least the sum
of the dual values and of the smallest reduced time that leaves each job. Precedence is only used to exclude arcs.

Source: M. Fischetti, J. Salazar Gonzalez, P. Toth (1997), "A branch-and-cut algorithm for the symmetric generalized
traveling salesman problem", Operations Research 45(3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.spatial import Array

Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

NEAR = 10
"""Number of shortest arcs from and to each option with which the linear program starts."""

ADDED = 5
"""Number of arcs of each option that are added to it at a time."""

UNITS = 1_000_000
"""Capacities of arcs are integers: multiples of 1 / UNITS."""

VIOLATED = 0.01
"""A constraint is added if it is violated by more than this."""

GAIN, PATIENCE = 1e-4, 2
"""The rounds end after so many of them that gained less than this share."""

NONE = 1e-7
"""Values of arcs below it, and reduced times (s) above its negative, are rounding."""


class _Cut(NamedTuple):
    """At least as many arcs leave the options ``inside`` (M + 1,) as leave ``option``, or one if that is -1."""

    inside: Mask
    option: int


@dataclass(frozen=True, eq=False)
class _Solution:
    """The values of the arcs of a linear program, and its dual values."""

    first: Indices
    last: Indices
    value: Array
    of_option: Array
    of_job: Array
    of_cut: Array


def arc_bound(times: Array, job: Indices, tour: Indices, rounds: int) -> float:
    """The lower bound (s), with violated constraints added in at most ``rounds`` linear programs.

    ``times`` (M + 1, M + 1) are those from option to option; the last row and column are home, and excluded arcs are
    infinite. ``job`` (M,) is the job of each option, ascending. ``tour`` (n,) are the options of any tour, so that the
    first linear program has a solution.
    """
    node = np.append(job, job[-1] + 1)  # home is a job with one option
    times = np.where(node[:, None] == node[None], np.inf, times)
    arcs = _shortest(times, NEAR) | _shortest(times.T, NEAR).T
    stops = np.concatenate([[len(job)], tour, [len(job)]])
    arcs[stops[:-1], stops[1:]] = True
    arcs &= np.isfinite(times)
    cuts: list[_Cut] = []
    best, stalled = 0.0, 0
    for _ in range(rounds):
        solution = _solved(times, node, arcs, cuts)
        if solution is None:
            break
        # the bound by the dual values, with the reduced times of all arcs
        reduced = times - solution.of_option[:, None] + solution.of_option[None] - solution.of_job[node][:, None]
        bound = float(solution.of_job.sum())
        for cut, dual in zip(cuts, solution.of_cut.tolist(), strict=True):
            reduced[np.ix_(cut.inside, ~cut.inside)] -= dual
            if cut.option < 0:
                bound += dual
            else:
                reduced[cut.option] += dual
        starts = np.searchsorted(node, np.arange(node[-1] + 1))
        bound += float(np.minimum.reduceat(reduced.min(axis=1), starts).sum())
        stalled = 0 if bound > (1.0 + GAIN) * best else stalled + 1
        best = max(best, bound)
        if stalled == PATIENCE:
            break
        # arcs and constraints that the program lacks are added, and constraints without effect removed
        missing = (reduced < -NONE) & ~arcs
        arcs |= _shortest(np.where(missing, reduced, np.inf), ADDED)
        cuts = [cut for cut, dual in zip(cuts, solution.of_cut, strict=True) if dual > 0.0]
        known = {(cut.inside.tobytes(), cut.option) for cut in cuts}
        more = {(cut.inside.tobytes(), cut.option): cut for cut in _violated(node, solution)}
        new = [cut for key, cut in more.items() if key not in known]
        if not new and not missing.any():
            break
        cuts += new
    return best


def _shortest(times: Array, count: int) -> Mask:
    """The finite entries among the ``count`` smallest of each row."""
    shortest = np.zeros(times.shape, dtype=bool)
    count = min(count, times.shape[1] - 1)
    np.put_along_axis(shortest, np.argpartition(times, count, axis=1)[:, :count], True, axis=1)
    return shortest & np.isfinite(times)


def _solved(times: Array, node: Indices, arcs: Mask, cuts: list[_Cut]) -> _Solution | None:
    """The solution of the linear program with some arcs and constraints; None if they admit none."""
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, vstack

    first, last = np.nonzero(arcs)
    size, count = len(node), len(first)
    number, ones = np.arange(count), np.ones(count)
    # as many arcs enter an option as leave it, and one leaves each job
    leaving = csr_array((ones, (first, number)), (size, count))
    entering = csr_array((ones, (last, number)), (size, count))
    of_job = csr_array((ones, (node[first], number)), (node[-1] + 1, count))
    equal = np.concatenate([np.zeros(size), np.ones(node[-1] + 1)])
    # violated constraints that were found before
    limits = {}
    if cuts:
        rows = [1.0 * (cut.inside[first] & ~cut.inside[last]) - (first == cut.option) for cut in cuts]
        least = [1.0 if cut.option < 0 else 0.0 for cut in cuts]
        limits = {"A_ub": -csr_array(np.array(rows)), "b_ub": -np.array(least)}
    program = linprog(
        times[first, last], A_eq=vstack([leaving - entering, of_job]), b_eq=equal, method="highs-ds", **limits
    )
    if not program.success:
        return None
    dual = program.eqlin.marginals
    of_cut = np.maximum(-program.ineqlin.marginals, 0.0) if cuts else np.zeros(0)
    return _Solution(first, last, program.x, dual[:size], dual[size:], of_cut)


def _violated(node: Indices, solution: _Solution) -> list[_Cut]:
    """Violated constraints of connection: the smallest cuts between home and each job and each partly used option."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    home, jobs = len(node) - 1, int(node[-1])
    used = solution.value > NONE
    first, last = solution.first[used], solution.last[used]
    share = np.bincount(first, weights=solution.value[used], minlength=home)[:home]
    # each job is one more node, to which all its options lead
    flow = np.concatenate([np.rint(UNITS * solution.value[used]), np.full(home, 10 * UNITS)]).astype(np.int32)
    size = home + 1 + jobs
    rows, columns = np.concatenate([first, np.arange(home)]), np.concatenate([last, home + 1 + node[:home]])
    graph = csr_array((flow, (rows, columns)), (size, size))
    partly = np.flatnonzero((share > VIOLATED) & (share < 1.0 - VIOLATED))
    targets = [(home + 1 + k, 1.0, -1) for k in range(jobs)] + [(k, share[k], k) for k in partly.tolist()]
    cuts = []
    for target, need, option in targets:
        through = maximum_flow(graph, home, target)
        if through.flow_value >= UNITS * (need - VIOLATED):
            continue
        left = graph - through.flow
        left.data = np.maximum(left.data, 0)
        left.eliminate_zeros()
        behind = breadth_first_order(left.T.tocsr(), target, return_predecessors=False)
        inside = np.zeros(home + 1, dtype=bool)
        inside[behind[behind <= home]] = True
        cuts.append(_Cut(inside, option))
    return cuts
