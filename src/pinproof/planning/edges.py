"""Straight edges in joint space: quickly looked at, then proven."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.motion import JointPath

__all__ = ["Edges"]

Array = npt.NDArray[np.float64]

PAD = 5e-4
"""Metres. The search keeps this much more distance than the margin: a path that only just keeps it is hard to prove."""

FINEST = 16
"""Edges are looked at this many times as closely at most: a closer look would cost more than the proofs it saves."""


class Edges:
    """Edges of one planning problem.

    Parameters
    ----------
    checker
        What an edge must be free of.
    resolution
        Largest joint step (rad or m) between two samples of a quick look. It steers the search and decides nothing.
    ends
        (e, n) free configurations that must stay within reach: where one of them stands nearer to a body, the search
        keeps less than :data:`PAD`.
    """

    def __init__(self, checker: CollisionChecker, resolution: float, ends: Array) -> None:
        if not resolution > 0:
            raise InputError(f"resolution = {resolution}; it is a joint step in rad or m, above 0")
        self._checker, self._resolution, self._finest = checker, resolution, resolution / FINEST
        spare = min((checker.clearance(q) for q in ends), default=np.inf) - checker.margin
        self._steering = checker.with_margin(checker.margin + min(PAD, max(spare, 0.0) / 2))

    def looks_free(self, a: Array, b: Array) -> bool:
        """Whether the samples after a (n,) up to and with b (n,) are free: the end first, then ever finer halvings."""
        steps = max(int(np.ceil(np.abs(b - a).max() / self._resolution)), 1)
        return all(self._steering.is_free_unchecked(a + (b - a) * share) for share in _spread(steps))

    def look_closer(self) -> None:
        """Halve the resolution, after an edge that looked free was not: something here is thinner than a step."""
        self._resolution = max(self._resolution / 2, self._finest)

    def prove(self, a: Array, b: Array) -> Certificate:
        """The certificate of the straight edge from a (n,) to b (n,)."""
        return certify(JointPath([a, b], self._checker.arm.joint_names), self._checker)


@cache
def _spread(steps: int) -> tuple[float, ...]:
    """1/steps .. steps/steps, so ordered that contacts are met early: the end, the middle, the quarters, ..."""
    order, stride = [steps], 1 << (steps - 1).bit_length()
    seen = {0, steps}
    while stride >= 1:
        for index in range(stride, steps, stride):
            if index not in seen:
                seen.add(index)
                order.append(index)
        stride //= 2
    return tuple(index / steps for index in order)
