"""The bodies of a checker placed at a configuration, and the distances between them.

Convex bodies are checked by the compiled core, whose bounds hold independently of the convergence of the iteration.
Coal checks bodies without a support function, and computes penetration depths.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from pinproof._core import Workspace, World
from pinproof.collision.checking.assembly import CheckedBodies
from pinproof.collision.checking.coal_checks import CoalWorkspace, Distance, MeasureConvex
from pinproof.spatial import Array


class NearestBodies(NamedTuple):
    """The smallest distance at a configuration, as far as the compiled core determines it."""

    contacts: list[int]
    """The pairs that overlap."""
    left_to_coal: list[int]
    """The pairs that coal has to measure."""
    lower: float
    """A lower bound (m) of the smallest distance over all other pairs; inf without one."""
    upper: float
    """An upper bound (m) of it, or of one that overlaps."""
    nearest: int
    """The pair of ``upper``, or -1."""


class PlacedBodies:
    """The bodies of a checker at one configuration; each thread needs its own instance.

    ``world`` is the world of the checker, or a part of it.
    """

    def __init__(self, checker: CheckedBodies, world: World) -> None:
        self._checker, self._core = checker, Workspace(world)
        self._q = np.zeros(checker.group.dof)
        self._moves = 0
        self._coal: CoalWorkspace | None = None
        self._convex: MeasureConvex | None = None
        self.core_judge = self._core.judge
        """:meth:`judge` for a contiguous array of doubles, without preparation for :meth:`any_left_touches`."""
        self.judge_many = self._core.judge_many
        """(N,) the result of :meth:`judge` for each row of Q (N, n)."""
        self.root_from_body = self._core.root_from_body
        """The placement (4, 4) of the body with an index."""

    def judge(self, q: Array) -> int:
        """Place every body at q (n,), and return the number of pairs that coal has to check.

        Or a negative number: ``CONTACT`` of the core if another pair is in contact, ``NOT_FINITE`` if q is not finite.
        """
        left: int = self._core.judge(np.ascontiguousarray(q, dtype=float))
        if left > 0:
            self._moved(q)
        return left

    def any_left_touches(self) -> bool:
        """Whether one of the pairs that coal has to check after :meth:`judge` is within its margin."""
        return any(self.touches(k) for k in self._core.left)

    def clearances(self, Q: Array) -> Array:
        """Return (N,) the smallest distance at each row of Q (N, n); NaN where coal is needed to determine it."""
        lower, open_pairs = self._core.find_nearest_many(Q)
        lower[open_pairs] = np.nan
        return np.asarray(lower)

    def nearest(self, q: Array) -> NearestBodies:
        """Place every body at q (n,), finite, and find the pair with the smallest distance."""
        self._moved(q)
        return NearestBodies(*self._core.find_nearest(self._q))

    def contacts(self, q: Array) -> list[int]:
        """Return the pairs in contact at q (n,), finite, that a joint moves relative to each other."""
        self._moved(q)
        contacts, left_to_coal = self._core.find_contacts(self._q)
        return [*contacts, *(k for k in left_to_coal if self.touches(k))]

    def touching(self, q: Array) -> list[tuple[int, Distance]]:
        """Return the pairs of :meth:`contacts` with their distances."""
        return [(k, self.measure(k)) for k in self.contacts(q)]

    def move(self, q: Array) -> None:
        """Place every body at q (n,), finite."""
        self._moved(q)
        self._core.place(self._q)

    def measure(self, k: int) -> Distance:
        """Return the distance of pair k; a body inside an exact watertight mesh penetrates it."""
        if not self._checker.convex[k]:
            return self._by_coal().measure(k)
        lower, upper, points, normal = self._core.measure(k)
        if lower > 0:
            return Distance(lower, lower, upper, points, normal)
        i, j = self._checker.pairs[k]
        bodies, place = self._checker.bodies, self.root_from_body
        if self._convex is None:
            self._convex = MeasureConvex()
        deep = self._convex(bodies[i], place(i), bodies[j], place(j))
        return deep._replace(distance=min(deep.distance, upper), proven=lower, attained=upper)

    def touches(self, k: int) -> bool:
        """Whether pair k, which coal has to check, is within its margin."""
        return self._by_coal().touches(k)

    def one_inside_other(self, k: int) -> bool:
        """Whether a part of one body of pair k lies inside the exact watertight mesh of the other."""
        return self._by_coal().one_inside_other(k)

    def _moved(self, q: Array) -> None:
        self._q[:] = q
        self._moves += 1

    def _by_coal(self) -> CoalWorkspace:
        if self._coal is None:
            self._coal = CoalWorkspace(self._checker)
        self._coal.move(self._q, self._moves)
        return self._coal


class CoalJudge:
    """Measures the pairs that the compiled core leaves to coal, when the core calls it during a proof or a search."""

    def __init__(self, space: PlacedBodies) -> None:
        self._space = space

    def measure(self, q: Array, pairs: Iterable[int]) -> list[tuple[float, float]]:
        """Return for each pair at q (n,) the upper and the lower bound (m) of its distance."""
        self._space.move(q)
        measured = map(self._space.measure, pairs)
        return [(distance.attained, distance.proven) for distance in measured]

    def any_contact(self, q: Array, pairs: Iterable[int]) -> bool:
        """Whether a pair is within its margin at q (n,)."""
        self._space.move(q)
        return any(map(self._space.touches, pairs))


class FixedPairs(NamedTuple):
    """The result for the pairs that no joint moves relative to each other: the same at every configuration."""

    touching: tuple[tuple[int, Distance], ...]
    """The pairs in contact."""
    lower: float
    """Their smallest signed distance (m), as in :meth:`pinproof.CollisionChecker.clearance`."""
    upper: float
    """An upper bound (m) of it."""


def check_fixed_pairs(space: PlacedBodies, q: Array) -> FixedPairs:
    """Check the pairs of a workspace that has only such pairs, at any q (n,)."""
    touching = tuple(space.touching(q))
    near = space.nearest(q)
    judged = [space.measure(k) for k in (*near.contacts, *near.left_to_coal)]
    lower = min((near.lower, *(measured.distance for measured in judged)))
    return FixedPairs(touching, lower, min((near.upper, *(measured.attained for measured in judged))))
