"""The bodies of a checker placed at a configuration, and the distances between them.

Convex bodies are checked by compiled loops, whose bounds hold independently of the convergence of the iteration. Coal
checks bodies without a support function, and computes penetration depths.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision.assembly import CheckedBodies
from pinproof.collision.coal_checks import CoalWorkspace, Distance, MeasureConvex

__all__ = [
    "CONTACT",
    "EVERY",
    "FIRST_ONLY",
    "NEAREST",
    "NOT_FINITE",
    "FixedPairs",
    "Near",
    "PlacedBodies",
    "check_fixed_pairs",
]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

FIRST_ONLY, EVERY, NEAREST = 0, 1, 2
"""Queries of :mod:`pinproof.kernels.near` (imported late): one contact, all contacts, the smallest distance."""

CONTACT, NOT_FINITE = -1, -2
"""Results of :meth:`PlacedBodies.judge` other than a number of pairs that coal has to check."""


class Near(NamedTuple):
    """The result of the compiled loop for a configuration, see :func:`pinproof.kernels.near.near`."""

    contacts: list[int]
    left_to_coal: list[int]
    lower: float
    upper: float
    nearest: int


class PlacedBodies:
    """The bodies of a checker at one configuration; each thread needs its own instance.

    Parameters
    ----------
    checker
        The checker.
    numbers, indices
        Its flattened arrays, or a part of them.
    """

    def __init__(self, checker: CheckedBodies, numbers: Array, indices: Indices) -> None:
        from pinproof.kernels import near

        self._kernels, self._touching = near, near.touching
        self._checker, self._numbers, self._indices = checker, numbers, indices
        self.at = checker.at.copy()
        self._q = np.zeros(checker.arm.dof)
        self._pairs = np.full((3, max(len(checker.pairs), near.LIKELY)), -1)
        self._moves = 0
        self._coal: CoalWorkspace | None = None
        self._convex: MeasureConvex | None = None

    def judge(self, q: Array) -> int:
        """Place every body at q (n,), and return the result of :func:`pinproof.kernels.near.touching`."""
        self._q[:] = q
        self._moves += 1
        return self._touching(self._numbers, self._indices, self.at, self._q, self._pairs)

    def left_to_coal(self, count: int) -> list[int]:
        """Return the pairs that coal has to check after the last query."""
        return self._pairs[1, :count].tolist()

    def judge_many(self, Q: Array, question: int, out: Array) -> None:
        """Write the result of :func:`pinproof.kernels.near.near` for each row of Q (N, n) into ``out`` (N, 5)."""
        self._kernels.near_many(self._numbers, self._indices, self.at, Q, question, self._pairs, out)

    def near(self, q: Array, question: int) -> Near:
        """Place every body at q (n,), finite, and check the pairs that a joint moves relative to each other."""
        self._q[:] = q
        self._moves += 1
        contacts, left, lower, upper, nearest = self._kernels.near(
            self._numbers, self._indices, self.at, self._q, question, self._pairs
        )
        return Near(self._pairs[0, :contacts].tolist(), self.left_to_coal(left), lower, upper, nearest)

    def touching(self, q: Array) -> list[tuple[int, Distance]]:
        """Return the pairs in contact at q (n,), finite, that a joint moves relative to each other."""
        near = self.near(q, EVERY)
        pairs = [*near.contacts, *(k for k in near.left_to_coal if self.touches(k))]
        return [(k, self.measure(k)) for k in pairs]

    def move(self, q: Array) -> None:
        """Place every body at q (n,), finite."""
        self._q[:] = q
        self._moves += 1
        self._kernels.place_bodies(self._numbers, self._indices, self._q, self.at)

    def measure(self, k: int) -> Distance:
        """Return the distance of pair k; a body inside an exact watertight mesh penetrates it."""
        if not self._checker.convex[k]:
            return self._by_coal().measure(k)
        points, normal = np.empty((2, 3)), np.empty(3)
        lower, upper = self._kernels.measure(self._numbers, self._indices, self.at, k, points, normal)
        if lower > 0:
            return Distance(lower, lower, upper, points, normal)
        i, j = self._checker.pairs[k]
        bodies = self._checker.bodies
        if self._convex is None:
            self._convex = MeasureConvex()
        deep = self._convex(bodies[i], self.at[i], bodies[j], self.at[j])
        return deep._replace(distance=min(deep.distance, upper), proven=lower, attained=upper)

    def touches(self, k: int) -> bool:
        """Whether pair k, which coal has to check, is within its margin."""
        return self._by_coal().touches(k)

    def one_inside_other(self, k: int) -> bool:
        """Whether a part of one body of pair k lies inside the exact watertight mesh of the other."""
        return self._by_coal().one_inside_other(k)

    def _by_coal(self) -> CoalWorkspace:
        if self._coal is None:
            self._coal = CoalWorkspace(self._checker)
        self._coal.move(self._q, self._moves)
        return self._coal


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
    near = space.near(q, NEAREST)
    judged = [space.measure(k) for k in (*near.contacts, *near.left_to_coal)]
    lower = min((near.lower, *(measured.distance for measured in judged)))
    return FixedPairs(touching, lower, min((near.upper, *(measured.attained for measured in judged))))
