r"""The shortest tour through jobs with options: a generalised travelling salesman problem with precedence.

Every job has options, of which one is chosen. The time of a tour is

.. math:: s_{o_1} + \sum_k t_{o_k} + \sum_k d_{o_k, o_{k+1}} + e_{o_N}

with the time s from the start to an option, t of an option, d between the exit of one option and the entrance of the
next, and e from an option to the end.

Up to :data:`EXACT` jobs, dynamic programming over subsets gives the optimum. For more, a compiled search
(``src/core/planning/tour_search.h``) moves jobs and parts of the tour, reverses parts, and chooses the options for an
order by dynamic programming, also after random disturbances.

Sources: M. Held, R. Karp (1962), "A dynamic programming approach to sequencing problems", SIAM J. 10(1);
F. Suarez-Ruiz, T. Lembono, Q.-C. Pham (2018), "RoboTSP - a fast solution to the robotic task sequencing problem",
ICRA.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof._core import search_tour
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.spatial import Array

Indices = npt.NDArray[np.int64]

EXACT = 10
"""Largest number of jobs for which the optimum is computed."""

SEARCH = 6000
"""Default number of disturbances, after each of which a tour is improved; a number, so that no clock is needed."""

STARTS = 2
"""Number of searches, which share the disturbances."""

DRAWS = 8
"""Number of random numbers of a disturbance."""

BLOCKED = 1e6
"""Seconds: the time of an arc that is excluded, in place of infinity."""

ROUNDS = 12
"""Default number of times that violated constraints are added to the lower bound."""


@dataclass(frozen=True, eq=False)
class Tour:
    """An order of all jobs, the option of each job in that order, and the total time (s)."""

    order: tuple[int, ...]
    options: tuple[int, ...]
    seconds: float


@dataclass(frozen=True, eq=False)
class TourProblem:
    """Jobs, their options and the times between them."""

    # (M,) the job of each option, ascending; every job from 0 has an option.
    job: Indices
    # (M,) seconds from the start to each option, and from each option to the end.
    start: Array
    end: Array
    # (M,) seconds of each option.
    inner: Array
    # (M, M) seconds from the exit of an option to the entrance of another.
    between: Array
    # The pairs of jobs in a fixed order.
    precedence: Precedence

    @property
    def count(self) -> int:
        """Number of jobs."""
        return len(self.precedence.names)

    @cached_property
    def options(self) -> list[Indices]:
        """The options of each job."""
        return [np.flatnonzero(self.job == job) for job in range(self.count)]

    # -- a fixed order ------------------------------------------------------------------------------------------------

    def seconds(self, options: npt.ArrayLike) -> float:
        """The time of a tour through these options in order."""
        chosen = np.asarray(options, dtype=int)
        if not len(chosen):
            return 0.0
        way = self.start[chosen[0]] + self.inner[chosen].sum() + self.end[chosen[-1]]
        return float(way + self.between[chosen[:-1], chosen[1:]].sum())

    def best_options(self, order: tuple[int, ...]) -> Tour:
        """The best options for a fixed order, by dynamic programming."""
        if not order:
            return Tour((), (), 0.0)
        groups = [self.options[job] for job in order]
        value = self.start[groups[0]] + self.inner[groups[0]]
        came: list[Indices] = []
        for before, here in itertools.pairwise(groups):
            reached = value[:, None] + self.between[np.ix_(before, here)]
            came.append(reached.argmin(axis=0))
            value = reached.min(axis=0) + self.inner[here]
        value = value + self.end[groups[-1]]
        # back from the best last option
        best = int(value.argmin())
        chosen = [int(groups[-1][best])]
        for group, back in zip(groups[-2::-1], came[::-1], strict=True):
            best = int(back[best])
            chosen.append(int(group[best]))
        return Tour(tuple(order), tuple(chosen[::-1]), float(value.min()))

    # -- orders -------------------------------------------------------------------------------------------------------

    def nearest_neighbour(self) -> Tour:
        """The order of :meth:`greedy` with the best options for it."""
        return self.best_options(self.greedy().order)

    def greedy(self) -> Tour:
        """The tour that always continues with the option with the shortest time to its entrance."""
        before = self.precedence.predecessors()
        chosen: list[int] = []
        order: list[int] = []
        reach = self.start
        while len(order) < self.count:
            allowed = [job for job in range(self.count) if job not in order and before[job] <= set(order)]
            options = np.concatenate([self.options[job] for job in allowed])
            chosen.append(int(options[reach[options].argmin()]))
            order.append(int(self.job[chosen[-1]]))
            reach = self.between[chosen[-1]]
        return Tour(tuple(order), tuple(chosen), self.seconds(chosen))

    def in_order(self, wanted: tuple[int, ...]) -> tuple[int, ...]:
        """The order that satisfies the precedence and takes the first possible job of ``wanted`` each time."""
        before, left, order = self.precedence.predecessors(), list(wanted), list[int]()
        while left:
            order.append(next(job for job in left if before[job] <= set(order)))
            left.remove(order[-1])
        return tuple(order)

    def solve(self, first: tuple[int, ...] | None = None, *, search: int = SEARCH, rng: int = 0) -> Tour:
        """A short tour: the optimum up to :data:`EXACT` jobs.

        The search also starts from the order ``first``, which must satisfy the precedence. ``search`` is the number of
        times that a tour is disturbed and improved again, ``rng`` the seed of the disturbances.
        """
        if self.count <= EXACT:
            return self.exact()
        starts = [self.nearest_neighbour()] * STARTS
        if first is not None:
            starts[0] = self.best_options(first)
        draws = np.random.default_rng(rng).random((STARTS, search // STARTS, DRAWS))
        tours = [self._searched(tour, numbers) for tour, numbers in zip(starts, draws, strict=True)]
        return min(tours, key=lambda tour: tour.seconds)

    def improved(self, tour: Tour) -> Tour:
        """The tour after changes of its order and its options, until none makes it shorter."""
        return self._searched(tour, np.empty((0, DRAWS)))

    def _searched(self, tour: Tour, draws: Array) -> Tour:
        """The tour after a local search, and after as many disturbances as there are rows of random numbers."""
        if not tour.order:
            return tour
        pairs = np.array(list(self.precedence.reasons), dtype=np.int64).reshape(-1, 2)
        options = np.array(tour.options, dtype=np.int64)
        chosen = search_tour(self.job.astype(np.int64), self._times, pairs, options, np.ascontiguousarray(draws))
        return Tour(tuple(self.job[chosen].tolist()), tuple(chosen.tolist()), self.seconds(chosen))

    @cached_property
    def _times(self) -> Array:
        """(M + 1, M + 1) the times from option to option, with that of the second one; the last is start and end."""
        size = len(self.job)
        times = np.zeros((size + 1, size + 1))
        times[:-1, :-1], times[-1, :-1], times[:-1, -1] = self.between + self.inner, self.start + self.inner, self.end
        return np.nan_to_num(times, posinf=BLOCKED)

    def exact(self) -> Tour:
        """The optimum, by dynamic programming over subsets of jobs; its time is infinite if no tour is possible."""
        if not self.count:
            return Tour((), (), 0.0)
        # value[jobs, option]: the least time through a subset of jobs (bits of ``mask``) that ends at an option of one
        before = [sum(1 << job for job in jobs) for jobs in self.precedence.predecessors()]
        size = len(self.job)
        value = np.full((1 << self.count, size), np.inf)
        came = np.full((1 << self.count, size), -1, dtype=np.int64)
        for job, options in enumerate(self.options):
            if not before[job]:
                value[1 << job, options] = self.start[options] + self.inner[options]
        for mask in range(1, 1 << self.count):
            here = value[mask]
            if not np.isfinite(here).any():
                continue
            for job, options in enumerate(self.options):
                if mask >> job & 1 or before[job] & ~mask:
                    continue
                reached = here[:, None] + self.between[:, options]
                best = reached.argmin(axis=0)
                value[mask | 1 << job, options] = reached[best, np.arange(len(options))] + self.inner[options]
                came[mask | 1 << job, options] = best
        # back from the best last option
        mask = (1 << self.count) - 1
        last = value[mask] + self.end
        if not np.isfinite(last).any():  # no tour is possible: one of infinite time through all jobs
            return self.nearest_neighbour()
        option, chosen = int(last.argmin()), list[int]()
        while option >= 0:
            chosen.append(option)
            mask, option = mask & ~(1 << int(self.job[option])), int(came[mask, option])
        chosen.reverse()
        return Tour(tuple(int(self.job[k]) for k in chosen), tuple(chosen), float(last.min()))

    # -- the lower bound ----------------------------------------------------------------------------------------------

    def lower_bound(self, rounds: int = ROUNDS) -> float:
        """A lower bound (s) of the time of every tour.

        Up to :data:`EXACT` jobs it is the optimum. For more, it is that of a linear program
        (:func:`arc_bound`) to which violated constraints are added ``rounds`` times.
        """
        if self.count <= EXACT:
            return self.exact().seconds
        return arc_bound(self.times_of_arcs(), self.job, np.array(self.nearest_neighbour().options), rounds)

    def times_of_arcs(self) -> Array:
        """(M + 1, M + 1) seconds from option to option with half of both; home is last, excluded arcs are infinite."""
        times = np.append(np.append(self.between, self.end[:, None], axis=1), [[*self.start, np.inf]], axis=0)
        half = np.append(self.inner / 2, 0.0)
        times = times + half[:, None] + half[None]
        for before, after in self.precedence.reasons:  # never directly in the other order
            times[np.ix_(self.options[after], self.options[before])] = np.inf
        return times


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


def arc_bound(times: Array, job: Indices, tour: Indices, rounds: int) -> float:
    """The lower bound (s), with violated constraints added in at most ``rounds`` linear programs.

    ``times`` (M + 1, M + 1) are those from option to option; the last row and column are home, and excluded arcs are
    infinite. ``job`` (M,) is the job of each option, ascending. ``tour`` (n,) are the options of any tour, so that the
    first linear program has a solution.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, vstack

    node = np.append(job, job[-1] + 1)  # home is a job with one option
    times = np.where(node[:, None] == node[None], np.inf, times)
    arcs = _shortest(times, NEAR) | _shortest(times.T, NEAR).T
    stops = np.concatenate([[len(job)], tour, [len(job)]])
    arcs[stops[:-1], stops[1:]] = True
    arcs &= np.isfinite(times)
    cuts: list[_Cut] = []
    best, stalled = 0.0, 0
    for _ in range(rounds):
        # As many arcs enter an option as leave it, and one leaves each job; violated constraints that were found before
        first, last = np.nonzero(arcs)
        size, number, ones = len(node), np.arange(len(first)), np.ones(len(first))
        leaving, entering = (csr_array((ones, (end, number)), (size, len(first))) for end in (first, last))
        leaving_job = csr_array((ones, (node[first], number)), (node[-1] + 1, len(first)))
        equal, limits = np.concatenate([np.zeros(size), np.ones(node[-1] + 1)]), {}
        if cuts:
            rows = [1.0 * (cut.inside[first] & ~cut.inside[last]) - (first == cut.option) for cut in cuts]
            least = [1.0 if cut.option < 0 else 0.0 for cut in cuts]
            limits = {"A_ub": -csr_array(np.array(rows)), "b_ub": -np.array(least)}
        balance = vstack([leaving - entering, leaving_job])
        program = linprog(times[first, last], A_eq=balance, b_eq=equal, method="highs-ds", **limits)
        if not program.success:
            break
        # the bound by the dual values, with the reduced times of all arcs
        of_option, of_job = np.split(program.eqlin.marginals, [size])
        of_cut = np.maximum(-program.ineqlin.marginals, 0.0) if cuts else np.zeros(0)
        reduced = times - of_option[:, None] + of_option[None] - of_job[node][:, None]
        bound = float(of_job.sum())
        for cut, dual in zip(cuts, of_cut.tolist(), strict=True):
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
        cuts = [cut for cut, dual in zip(cuts, of_cut, strict=True) if dual > 0.0]
        known = {(cut.inside.tobytes(), cut.option) for cut in cuts}
        more = {(cut.inside.tobytes(), cut.option): cut for cut in _violated(node, first, last, program.x)}
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


def _violated(node: Indices, first: Indices, last: Indices, value: Array) -> list[_Cut]:
    """Violated constraints of connection: the smallest cuts between home and each job and each partly used option."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, maximum_flow

    home, jobs = len(node) - 1, int(node[-1])
    used = value > NONE
    first, last, value = first[used], last[used], value[used]
    share = np.bincount(first, weights=value, minlength=home)[:home]
    # each job is one more node, to which all its options lead
    flow = np.concatenate([np.rint(UNITS * value), np.full(home, 10 * UNITS)]).astype(np.int32)
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
