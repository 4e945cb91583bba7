r"""The shortest tour through jobs with options: a generalised travelling salesman problem with precedence.

Every job has options, of which one is chosen. The time of a tour is

.. math:: s_{o_1} + \sum_k t_{o_k} + \sum_k d_{o_k, o_{k+1}} + e_{o_N}

with the time s from the start to an option, t of an option, d between the exit of one option and the entrance of the
next, and e from an option to the end.

Up to :data:`EXACT` jobs, dynamic programming over subsets gives the optimum. For more, a search alternates between the
order for fixed options, solved as a travelling salesman problem by OR-Tools, and the options for a fixed order, by
dynamic programming (RoboTSP); jobs are then moved to other positions with any of their options until no move helps.

Sources: M. Held, R. Karp (1962), "A dynamic programming approach to sequencing problems", SIAM J. 10(1);
F. Suarez-Ruiz, T. Lembono, Q.-C. Pham (2018), "RoboTSP - a fast solution to the robotic task sequencing problem",
ICRA; M. Fischetti, J. Salazar Gonzalez, P. Toth (1997), "A branch-and-cut algorithm for the symmetric generalized
traveling salesman problem", Operations Research 45(3).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.cell.exchanges import exchanged
from pinproof.cell.precedence import Precedence
from pinproof.errors import InputError

__all__ = ["EXACT", "Tour", "TourProblem"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

EXACT = 10
"""Largest number of jobs for which the optimum is computed."""

MICRO = 1e6
"""Integer costs of OR-Tools are microseconds."""

SEARCH = 300
"""Default number of disturbed tours from which the search starts again; a number, so that the result needs no clock."""

KICK, WINDOW = 4, 12
"""Number of jobs that a disturbance moves, and largest distance between them and of a move, in positions."""

NEAR = 2
"""Jobs that are at most so many positions from a changed place are tried again."""

ROUNDS = 2
"""Largest number of alternations between the order and the options."""

CUTS = 12
"""Largest number of times that violated subtour constraints are added to the lower bound."""

WORTH = 1e-3
"""Share of the total time that an alternation must save for another one."""

GAIN = 1e-9
"""Seconds: smaller differences are rounding."""


@dataclass(frozen=True, eq=False)
class Tour:
    """An order of all jobs, the option of each job in that order, and the total time (s)."""

    order: tuple[int, ...]
    options: tuple[int, ...]
    seconds: float


@dataclass(frozen=True, eq=False)
class TourProblem:
    """Jobs, their options and the times between them.

    Parameters
    ----------
    job
        (M,) the job of each option, ascending; every job from 0 has an option.
    start, end
        (M,) seconds from the start to each option, and from each option to the end.
    inner
        (M,) seconds of each option.
    between
        (M, M) seconds from the exit of an option to the entrance of another.
    precedence
        The pairs of jobs in a fixed order.
    """

    job: Indices
    start: Array
    end: Array
    inner: Array
    between: Array
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
            every = value[:, None] + self.between[np.ix_(before, here)]
            came.append(every.argmin(axis=0))
            value = every.min(axis=0) + self.inner[here]
        value = value + self.end[groups[-1]]
        at = int(value.argmin())
        chosen = [int(groups[-1][at])]
        for group, back in zip(groups[-2::-1], came[::-1], strict=True):
            at = int(back[at])
            chosen.append(int(group[at]))
        return Tour(tuple(order), tuple(chosen[::-1]), float(value.min()))

    # -- orders -------------------------------------------------------------------------------------------------------

    def nearest_neighbour(self) -> Tour:
        """The greedy order: always the option with the shortest time to its entrance, then the best options for it."""
        before = self.precedence.predecessors()
        done: set[int] = set()
        order: list[int] = []
        reach = self.start
        while len(order) < self.count:
            allowed = [job for job in range(self.count) if job not in done and before[job] <= done]
            options = np.concatenate([self.options[job] for job in allowed])
            best = int(options[reach[options].argmin()])
            order.append(int(self.job[best]))
            done.add(order[-1])
            reach = self.between[best]
        return self.best_options(tuple(order))

    def in_order(self, wanted: tuple[int, ...]) -> tuple[int, ...]:
        """The order that satisfies the precedence and takes the first possible job of ``wanted`` each time."""
        before, done, order = self.precedence.predecessors(), set[int](), list[int]()
        left = list(wanted)
        while left:
            job = next(job for job in left if before[job] <= done)
            left.remove(job)
            done.add(job)
            order.append(job)
        return tuple(order)

    def solve(self, first: tuple[int, ...] | None = None, *, search: int = SEARCH, rng: int = 0) -> Tour:
        """A short tour: the optimum up to :data:`EXACT` jobs.

        Parameters
        ----------
        first
            An order from which the search also starts; it must satisfy the precedence.
        search
            Number of times that the best tour is disturbed and improved again.
        rng
            Seed of the disturbances.

        Raises
        ------
        InputError
            If there are more jobs than :data:`EXACT` and OR-Tools is not installed.
        """
        if self.count <= EXACT:
            return self.exact()
        starts = [self.nearest_neighbour()]
        if first is not None:
            starts.append(self.best_options(first))
        best = min((self.improved(tour) for tour in starts), key=lambda tour: tour.seconds)
        best = self._alternated(best)
        random = np.random.default_rng(rng)
        for _ in range(search):
            chosen = self._disturbed(best, random)
            tour = self._improved_near(chosen, _changed(best.options, chosen))
            if tour.seconds < best.seconds - GAIN:
                best = tour
        return self.improved(best)

    def _alternated(self, best: Tour) -> Tour:
        """The tour after alternating between the order and the options until neither helps."""
        for _ in range(ROUNDS):
            tour = self.improved(self.best_options(self._reordered(best)))
            gain = best.seconds - tour.seconds
            best = min(best, tour, key=lambda each: each.seconds)
            if gain <= WORTH * best.seconds:
                break
        return best

    def _disturbed(self, tour: Tour, random: np.random.Generator) -> list[int]:
        """The options of the tour with some jobs, near each other, moved to other positions nearby."""
        wanted = list(tour.order)
        first = int(random.integers(self.count))
        for step in random.choice(WINDOW, min(KICK, WINDOW), replace=False).tolist():
            job = tour.order[(first + step) % self.count]
            at = wanted.index(job)
            wanted.pop(at)
            to = at + int(random.integers(-WINDOW, WINDOW + 1))
            wanted.insert(min(max(to, 0), len(wanted)), job)
        option = dict(zip(tour.order, tour.options, strict=True))
        return [option[job] for job in self.in_order(tuple(wanted))]

    def _improved_near(self, chosen: list[int], places: Iterable[int]) -> Tour:
        """The tour after moving jobs, first those at the given places and then those near each change."""
        queue = dict.fromkeys(int(self.job[chosen[k]]) for k in places)  # in the order of insertion
        while queue:
            job = next(iter(queue))
            del queue[job]
            before = tuple(chosen)
            if self._move(chosen, job):
                queue |= dict.fromkeys(int(self.job[chosen[k]]) for k in _changed(before, chosen))
        return self._exchanged(self.best_options(tuple(int(self.job[each]) for each in chosen)))

    def _exchanged(self, tour: Tour) -> Tour:
        """The tour after reversals and moves of its parts, with the best options for the new order."""
        chosen = np.array(tour.options)
        n = len(chosen)
        times = np.full((n + 2, n + 2), np.inf)
        times[1:-1, 1:-1] = self.between[np.ix_(chosen, chosen)]
        times[0, 1:-1], times[1:-1, -1] = self.start[chosen], self.end[chosen]
        place = np.argsort(tour.order)
        changed = exchanged(times, *(place[list(jobs)] for jobs in self._pairs))
        return min(tour, self.best_options(tuple(tour.order[k] for k in changed)), key=lambda each: each.seconds)

    @cached_property
    def _pairs(self) -> tuple[list[int], list[int]]:
        pairs = list(self.precedence.reasons)
        return [a for a, _ in pairs], [b for _, b in pairs]

    def exact(self) -> Tour:
        """The optimum, by dynamic programming over subsets of jobs."""
        if not self.count:
            return Tour((), (), 0.0)
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
                every = here[:, None] + self.between[:, options]
                best = every.argmin(axis=0)
                value[mask | 1 << job, options] = every[best, np.arange(len(options))] + self.inner[options]
                came[mask | 1 << job, options] = best
        mask = (1 << self.count) - 1
        last = value[mask] + self.end
        option, chosen = int(last.argmin()), list[int]()
        while option >= 0:
            chosen.append(option)
            mask, option = mask & ~(1 << int(self.job[option])), int(came[mask, option])
        chosen.reverse()
        return Tour(tuple(int(self.job[each]) for each in chosen), tuple(chosen), float(last.min()))

    def improved(self, tour: Tour) -> Tour:
        """The tour after moving jobs to other positions, with any of their options, until no move helps."""
        best = tour
        while True:
            chosen = list(best.options)
            moved = False
            for job in range(self.count):
                moved = self._move(chosen, job) or moved
            found = self._exchanged(self.best_options(tuple(int(self.job[each]) for each in chosen)))
            if not moved or found.seconds >= best.seconds - GAIN:
                return min(best, found, key=lambda each: each.seconds)
            best = found

    def _move(self, chosen: list[int], job: int) -> bool:
        """Move a job to its best position with its best option; whether this makes the tour shorter."""
        at = next(k for k, each in enumerate(chosen) if self.job[each] == job)
        old, rest = chosen[at], chosen[:at] + chosen[at + 1 :]
        if not rest:
            return False
        options, others = self.options[job], np.array(rest)
        after_all, before_all = self._successors[job], self._predecessors[job]
        first = max((k + 1 for k, each in enumerate(rest) if int(self.job[each]) in before_all), default=0)
        last = min((k for k, each in enumerate(rest) if int(self.job[each]) in after_all), default=len(rest))
        # the time that inserting each option before position k of the others adds, for k from 0 to their number
        into = np.vstack([self.start[None, options], self.between[np.ix_(others, options)]])
        out = np.vstack([self.between[np.ix_(options, others)].T, self.end[None, options]])
        gap = np.concatenate([[self.start[others[0]]], self.between[others[:-1], others[1:]], [self.end[others[-1]]]])
        with np.errstate(invalid="ignore"):
            added = into + out + self.inner[options] - gap[:, None]
        own = added[at, int(np.flatnonzero(options == old)[0])]
        allowed = np.full(added.shape, np.inf)
        allowed[first : last + 1] = np.nan_to_num(added[first : last + 1], nan=np.inf, posinf=np.inf, neginf=-np.inf)
        k, option = np.unravel_index(int(allowed.argmin()), allowed.shape)
        if not allowed[k, option] < own - GAIN:
            return False
        chosen[:] = [*rest[:k], int(options[option]), *rest[k:]]
        return True

    @cached_property
    def _predecessors(self) -> list[set[int]]:
        return self.precedence.predecessors()

    @cached_property
    def _successors(self) -> list[set[int]]:
        return self.precedence.successors()

    def _reordered(self, tour: Tour) -> tuple[int, ...]:
        """A better order for the options of a tour, by OR-Tools."""
        try:
            from ortools.constraint_solver import pywrapcp, routing_enums_pb2
        except ImportError as error:
            raise InputError(
                f"the order of more than {EXACT} picks needs the extra 'cell': pip install 'pinproof[cell]'"
            ) from error
        chosen = np.array(tour.options)
        chosen = chosen[np.argsort(self.job[chosen])]  # by job
        costs = np.zeros((self.count + 1, self.count + 1))  # the last node is the start and the end
        costs[:-1, :-1] = self.between[np.ix_(chosen, chosen)]
        costs[-1, :-1], costs[:-1, -1] = self.start[chosen], self.end[chosen]
        blocked = 10.0 * (self.seconds(tour.options) + 1.0)
        matrix = np.rint(np.nan_to_num(costs, posinf=blocked).clip(0.0, blocked) * MICRO).astype(np.int64).tolist()
        manager = pywrapcp.RoutingIndexManager(self.count + 1, 1, self.count)
        routing = pywrapcp.RoutingModel(manager)
        transit = routing.RegisterTransitMatrix(matrix)
        routing.SetArcCostEvaluatorOfAllVehicles(transit)
        if self.precedence.reasons:
            step = routing.RegisterUnaryTransitVector([1] * (self.count + 1))
            routing.AddDimension(step, 0, self.count + 1, True, "position")
            position = routing.GetDimensionOrDie("position")
            solver = routing.solver()
            for before, after in self.precedence.essential():
                a, b = (position.CumulVar(manager.NodeToIndex(job)) for job in (before, after))
                solver.Add(a < b)
        settings = pywrapcp.DefaultRoutingSearchParameters()
        settings.local_search_metaheuristic = routing_enums_pb2.LocalSearchMetaheuristic.GREEDY_DESCENT
        settings.time_limit.seconds = 3600  # the descent ends long before
        routing.CloseModelWithParameters(settings)
        first = routing.ReadAssignmentFromRoutes([list(tour.order)], True)
        found = routing.SolveFromAssignmentWithParameters(first, settings)
        if found is None:
            return tour.order
        order: list[int] = []
        index = routing.Start(0)
        while not routing.IsEnd(index):
            if (node := manager.IndexToNode(index)) < self.count:
                order.append(node)
            index = found.Value(routing.NextVar(index))
        return tuple(order)

    # -- the lower bound ----------------------------------------------------------------------------------------------

    def lower_bound(self) -> float:
        """A lower bound (s) of the time of every tour.

        Up to :data:`EXACT` jobs it is the optimum. For more, it is the bound of the linear program of the asymmetric
        travelling salesman problem with the shortest time between any options of two jobs, each with half of the time
        of both options; precedence and some subtour constraints are ignored.
        """
        if self.count <= EXACT:
            return self.exact().seconds
        return _assignment_bound(self._between_jobs())

    def _between_jobs(self) -> Array:
        """(N + 1, N + 1) the shortest times between jobs; the last row and column are the start and the end."""
        n, half = self.count, self.inner / 2
        first = np.searchsorted(self.job, np.arange(n))
        every = half[:, None] + self.between + half[None, :]
        found = np.empty((n + 1, n + 1))
        found[:-1, :-1] = np.minimum.reduceat(np.minimum.reduceat(every, first, axis=0), first, axis=1)
        found[-1, :-1] = np.minimum.reduceat(self.start + half, first)
        found[:-1, -1] = np.minimum.reduceat(half + self.end, first)
        np.fill_diagonal(found, np.inf)
        for before, after in self.precedence.reasons:  # never directly in the other order
            found[after, before] = np.inf
        return found


def _changed(before: Sequence[int], after: Sequence[int]) -> list[int]:
    """The places of a tour of options that are at most :data:`NEAR` positions from the ends of each changed part."""
    differs = np.concatenate([[False], np.array(before) != np.array(after), [False]])
    ends = np.flatnonzero(differs[1:] != differs[:-1])
    places = {int(k) + step for k in ends for step in range(-NEAR, NEAR + 1)}
    return [k for k in sorted(places) if 0 <= k < len(after)]


def _assignment_bound(costs: Array) -> float:
    """The bound of the assignment problem, with constraints that join its cycles (Dantzig et al. 1954)."""
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, vstack
    from scipy.sparse.csgraph import connected_components

    n = len(costs)
    rows, columns = np.nonzero(np.isfinite(costs))
    each = np.arange(len(rows))
    ones = np.ones(len(rows))
    degree = vstack(
        [csr_array((ones, (rows, each)), (n, len(rows))), csr_array((ones, (columns, each)), (n, len(rows)))]
    )
    cuts: list[Array] = []
    bound = 0.0
    for _ in range(CUTS):
        limits = {} if not cuts else {"A_ub": csr_array(np.array(cuts)), "b_ub": -np.ones(len(cuts))}
        found = linprog(costs[rows, columns], A_eq=degree, b_eq=np.ones(2 * n), bounds=(0, 1), method="highs", **limits)
        if not found.success:
            return bound
        bound = float(found.fun)
        used = found.x > 1e-6
        count, label = connected_components(
            csr_array((ones[used], (rows[used], columns[used])), (n, n)), connection="weak"
        )
        if count == 1:
            return bound
        cuts += [-((label[rows] == k) & (label[columns] != k)).astype(float) for k in range(count)]
    return bound
