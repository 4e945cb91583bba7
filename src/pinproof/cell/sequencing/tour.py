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

import numpy as np
import numpy.typing as npt

from pinproof._core import search_tour
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.cell.sequencing.tour_bound import arc_bound
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
        """The optimum, by dynamic programming over subsets of jobs."""
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
        (:mod:`pinproof.cell.sequencing.tour_bound`) to which violated constraints are added ``rounds`` times.
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
