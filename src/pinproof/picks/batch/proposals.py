"""Candidate configurations for many poses, in rounds: later rounds treat only the poses that are still open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np
import numpy.typing as npt

from pinproof.ik import AnalyticIk, Clik
from pinproof.model import Arm
from pinproof.picks.judging.configurations import SWEEP, has_closed_form, turned_inside, widened

__all__ = ["Proposals", "Proposed", "Span", "Wanted", "proposals_for"]

Array = npt.NDArray[np.float64]

FINEST_SPAN = 1e-6
"""Metres: more than a solved pose may be off."""


class Span:
    """How far an arm stretches: a search for what lies beyond costs all its restarts, this two products.

    A rotation about an axis keeps the points of the axis. So the origin of the first joint is fixed in the base, that
    of the last one in the target, and between them lie the lengths from joint to joint at most.
    """

    def __init__(self, arm: Arm) -> None:
        from pinproof.kernels.chain import LEADER, MULTIPLIER, OFFSET, SLIDES

        chain, limits = arm.packed, arm.limits
        rows, slides = chain[:-1], chain[:-1, SLIDES] != 0.0
        reach = np.maximum(np.abs(limits.lower), np.abs(limits.upper))[rows[:, LEADER].astype(int)]
        travel = np.where(slides, np.abs(rows[:, MULTIPLIER]) * reach + np.abs(rows[:, OFFSET]), 0.0)
        self._longest = np.linalg.norm(rows[1:, [3, 7, 11]], axis=1).sum() + travel.sum()
        self._first = rows[0, [3, 7, 11]]
        tool = np.vstack([chain[-1, :12].reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
        self._last = np.linalg.inv(tool)[:, 3]

    def may_reach(self, targets: Array) -> npt.NDArray[np.bool_]:
        """(N,) whether targets (N, 4, 4) are near enough; those that are not cannot be reached."""
        away = (targets @ self._last)[:, :3] - self._first
        return np.asarray(np.linalg.norm(away, axis=1) <= self._longest + FINEST_SPAN)


Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

RESTARTS = 8
"""Of a search for a pose: enough for all but a few in a thousand, and an eighth of the time that a pose out of reach
would take with the solver's own number."""

GROUPS = 2, 4, 8
"""Values of a swept joint that are looked at in the first rounds; the last one has the others. Most poses need few."""

TURN = 2 * np.pi


class Wanted(Enum):
    """Which poses a round is for."""

    OPEN = auto()
    """Those of which nothing free is known yet."""
    REACHED = auto()
    """Of these, those that are known to be reachable."""
    UNREACHED = auto()
    """Of these, the others."""


@dataclass(frozen=True, eq=False)
class Proposed:
    """What a round found.

    Parameters
    ----------
    row
        (k,) which of the targets each is for.
    q
        (k, n) configurations that reach them, inside the limits.
    outside
        (N,) whether limits alone were seen to rule one out, by target.
    complete
        (N,) whether these are proven to be all configurations of a target.
    """

    row: Indices
    q: Array
    outside: Mask
    complete: Mask


class Proposals:
    """Configurations for poses of an arm.

    ``complete``: those of the first round are all that there are, but at singular targets (:class:`Proposed`).
    """

    complete = False

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        """For which poses each round is, and its number; with ``why`` also those that only tell why there is none."""
        raise NotImplementedError

    def propose(self, number: int, targets: Array) -> Proposed:
        """What a round finds for targets (N, 4, 4), ``base_from_tcp``."""
        raise NotImplementedError


def proposals_for(arm: Arm, home: Array, *, attempts: int, rng: int) -> Proposals:
    """Every branch where there is a closed form, a sweep of an arm of seven, a search for others."""
    if has_closed_form(arm):
        return _Closed(arm, home)
    return _Swept(arm, home, rng) if has_closed_form(arm, most=7) else _Searched(arm, home, attempts, rng)


class _Closed(Proposals):
    """Every branch of every target, at once."""

    complete = True

    def __init__(self, arm: Arm, home: Array) -> None:
        self._arm, self._home = arm, home

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        del why
        yield Wanted.OPEN, 0

    def propose(self, number: int, targets: Array) -> Proposed:
        del number
        found = AnalyticIk().solve_all_batch(self._arm, targets, self._home)
        row, column = np.nonzero(np.arange(found.q.shape[1]) < found.count[:, None])
        return Proposed(row, found.q[row, column], found.outside > 0, found.complete)


class _Swept(Proposals):
    """The branches of an arm of seven at the values of one joint that a pick is judged at, then a search.

    What limits rule out is looked for in a whole turn of that joint.
    """

    def __init__(self, arm: Arm, home: Array, rng: int) -> None:
        self._arm, self._home, self._rng, self._span = arm, home, rng, Span(arm)
        joint, values = SWEEP.redundant_grid(arm, home) or (0, home[:0])
        spread = values[np.argsort([_reversed_bits(k) for k in range(len(values))])]
        self._groups = [group for group in np.split(spread, np.cumsum(GROUPS)) if len(group)]
        step = float(np.diff(values).max(initial=TURN))
        self._beyond = np.arange(values[-1] + step, values[0] + TURN, step) if arm.angular[joint] else values[:0]
        self._search = len(self._groups)

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        yield from ((Wanted.OPEN, k) for k in range(self._search))
        yield Wanted.UNREACHED, self._search
        if why and len(self._beyond):
            yield Wanted.UNREACHED, self._search + 1

    def propose(self, number: int, targets: Array) -> Proposed:
        if number == self._search:
            return _searched(self._arm, targets, self._home, self._rng, self._span)
        values = self._groups[number] if number < self._search else self._beyond
        found = SWEEP.solve_all_batch(self._arm, targets, self._home, redundant_values=values)
        row, column = np.nonzero(np.arange(found.q.shape[1]) < found.count[:, None])
        return Proposed(row, found.q[row, column], found.outside > 0, found.complete)


class _Searched(Proposals):
    """What a search finds from several starts."""

    def __init__(self, arm: Arm, home: Array, attempts: int, rng: int) -> None:
        low, high = arm.limits.sampling_range()
        others = np.random.default_rng(rng).uniform(low, high, (attempts - 1, arm.dof))
        self._arm, self._wide, self._rng = arm, widened(arm), rng
        self._starts, self._span = np.vstack([home, others]), Span(arm)

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        yield Wanted.OPEN, 0
        # what the first search did not reach, with all its restarts, another start would hardly reach either
        yield from ((Wanted.REACHED, k) for k in range(1, len(self._starts)))
        if why:
            yield Wanted.UNREACHED, len(self._starts)

    def propose(self, number: int, targets: Array) -> Proposed:
        if number < len(self._starts):
            return _searched(self._arm, targets, self._starts[number], self._rng + number, self._span)
        wide = _searched(self._wide, targets, self._starts[0], self._rng, Span(self._wide))
        q, limits, outside = turned_inside(self._arm, wide.q), self._arm.limits, wide.outside
        inside = ((q >= limits.lower) & (q <= limits.upper)).all(axis=1)
        outside[wide.row[~inside]] = True
        return Proposed(wide.row[inside], np.ascontiguousarray(q[inside]), outside, np.zeros(len(targets), dtype=bool))


def _searched(arm: Arm, targets: Array, start: Array, rng: int, span: Span) -> Proposed:
    near = np.flatnonzero(span.may_reach(targets))
    found = Clik(restarts=RESTARTS).solve_batch(arm, targets[near], start, rng=rng)
    none = np.zeros(len(targets), dtype=bool)
    return Proposed(near[found.ok], np.ascontiguousarray(found.q[found.ok]), none, none.copy())


def _reversed_bits(k: int) -> int:
    """The number of ten binary digits that k read backwards is: in its order, neighbours come far from each other."""
    return int(f"{k:010b}"[::-1], 2)
