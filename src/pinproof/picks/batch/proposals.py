"""Candidate configurations for many poses, in rounds; later rounds process only the poses that are not solved yet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pinproof.ik import AnalyticIk, Clik, IkBranchesBatch
from pinproof.model import Arm
from pinproof.picks.judging.configurations import SWEEP, has_closed_form, turned_inside, widened
from pinproof.spatial import Array

Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]

FINEST_SPAN = 1e-6
"""Metres: a tolerance larger than the position error of a solved pose."""


class Span:
    """An upper bound of the reach of an arm.

    The bound excludes distant targets with two matrix products, whereas a search would spend all its restarts on them.

    A rotation about an axis leaves the points of the axis fixed. Therefore the origin of the first joint is fixed in
    the base and that of the last joint is fixed in the target. The distance between them is at most the sum of the
    distances between consecutive joints.
    """

    def __init__(self, arm: Arm) -> None:
        chain, limits = arm.chain, arm.limits
        reach = np.maximum(np.abs(limits.lower), np.abs(limits.upper))[chain.index]
        travel = np.where(chain.prismatic, np.abs(chain.multiplier) * reach + np.abs(chain.offset), 0.0)
        joints = chain.before[:, :3, 3]
        self._longest = np.linalg.norm(joints[1:], axis=1).sum() + travel.sum()
        self._first = joints[0]
        self._last = np.linalg.inv(chain.tool)[:, 3]

    def may_reach(self, targets: Array) -> Mask:
        """(N,) whether targets (N, 4, 4) are within the bound; all others are proven to be out of reach."""
        away = (targets @ self._last)[:, :3] - self._first
        return np.asarray(np.linalg.norm(away, axis=1) <= self._longest + FINEST_SPAN)


RESTARTS = 8
"""Restarts of the search for one pose. They are sufficient for all but a few poses in a thousand, and a pose out of
reach takes an eighth of the time that it would take with the default of the solver."""

GROUPS = 2, 4, 8
"""Numbers of values of the swept joint in the first rounds; the last round has the rest. Most poses need few."""

TURN = 2 * np.pi


class Wanted(Enum):
    """The poses that a round processes."""

    OPEN = auto()
    """Poses without a known free configuration."""
    REACHED = auto()
    """The open poses that are known to be reachable."""
    UNREACHED = auto()
    """The open poses that are not known to be reachable."""


@dataclass(frozen=True, eq=False)
class Proposed:
    """The configurations q (k, n) within the limits that a round finds, and the index (k,) of the target of each.

    For each target (N,), ``outside`` states whether a configuration was found that only the limits exclude, and
    ``complete`` whether the configurations are proven to be all.
    """

    row: Indices
    q: Array
    outside: Mask
    complete: Mask


class Proposals(Protocol):
    """Configurations for poses of an arm.

    ``complete``: the first round gives all configurations, except at singular targets (see :class:`Proposed`).
    """

    complete: bool = False

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        """The poses of each round, and its number.

        With ``why``, there are additional rounds that only determine why no configuration was found.
        """

    def propose(self, number: int, targets: Array) -> Proposed:
        """The configurations that a round finds for targets (N, 4, 4), ``base_from_tcp``."""


def proposals_for(arm: Arm, home: Array, *, attempts: int, rng: int) -> Proposals:
    """All IK branches if there is a closed form, a sweep for arms with seven joints, otherwise a search."""
    if has_closed_form(arm):
        return _Closed(arm, home)
    return _Swept(arm, home, rng) if has_closed_form(arm, most=7) else _Searched(arm, home, attempts, rng)


class _Closed(Proposals):
    """All IK branches of all targets, in one round."""

    complete = True

    def __init__(self, arm: Arm, home: Array) -> None:
        self._arm, self._home = arm, home

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        del why
        yield Wanted.OPEN, 0

    def propose(self, number: int, targets: Array) -> Proposed:
        del number
        return _branches(AnalyticIk().solve_all_batch(self._arm, targets, self._home))


class _Swept(Proposals):
    """The branches of an arm with seven joints at fixed values of one joint, followed by a search.

    The values are those at which a pick is judged. To find configurations outside the limits, the joint is swept over a
    full rotation.
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
        return _branches(SWEEP.solve_all_batch(self._arm, targets, self._home, redundant_values=values))


class _Searched(Proposals):
    """The results of a search from several start configurations."""

    def __init__(self, arm: Arm, home: Array, attempts: int, rng: int) -> None:
        low, high = arm.limits.sampling_range()
        others = np.random.default_rng(rng).uniform(low, high, (attempts - 1, arm.dof))
        self._arm, self._wide, self._rng = arm, widened(arm), rng
        self._starts, self._span = np.vstack([home, others]), Span(arm)

    def rounds(self, *, why: bool) -> Iterator[tuple[Wanted, int]]:
        yield Wanted.OPEN, 0
        # a pose that the first search did not reach with all its restarts is unlikely to be reached from another start
        yield from ((Wanted.REACHED, k) for k in range(1, len(self._starts)))
        if why:
            yield Wanted.UNREACHED, len(self._starts)

    def propose(self, number: int, targets: Array) -> Proposed:
        if number < len(self._starts):
            return _searched(self._arm, targets, self._starts[number], self._rng + number, self._span)
        wide = _searched(self._wide, targets, self._starts[0], self._rng, Span(self._wide))
        q, outside = turned_inside(self._arm, wide.q), wide.outside
        inside = self._arm.limits.inside(q)
        outside[wide.row[~inside]] = True
        return Proposed(wide.row[inside], np.ascontiguousarray(q[inside]), outside, np.zeros(len(targets), dtype=bool))


def _branches(found: IkBranchesBatch) -> Proposed:
    row, column = np.nonzero(np.arange(found.q.shape[1]) < found.count[:, None])
    return Proposed(row, found.q[row, column], found.outside > 0, found.complete)


def _searched(arm: Arm, targets: Array, start: Array, rng: int, span: Span) -> Proposed:
    near = np.flatnonzero(span.may_reach(targets))
    found = Clik(restarts=RESTARTS).solve_batch(arm, targets[near], start, rng=rng)
    none = np.zeros(len(targets), dtype=bool)
    return Proposed(near[found.ok], np.ascontiguousarray(found.q[found.ok]), none, none.copy())


def _reversed_bits(k: int) -> int:
    """The ten binary digits of k reversed. Sorting by this number places neighbouring values far apart."""
    return int(f"{k:010b}"[::-1], 2)
