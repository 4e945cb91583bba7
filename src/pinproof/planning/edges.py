"""Straight edges in joint space: quickly looked at, then proven."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.motion import JointPath

__all__ = ["Edges"]

Array = npt.NDArray[np.float64]


class Edges:
    """Edges of one planning problem.

    Parameters
    ----------
    checker
        What an edge must be free of.
    resolution
        Largest joint step (rad or m) between two samples of a quick look. It steers the search and decides nothing.
    """

    def __init__(self, checker: CollisionChecker, resolution: float) -> None:
        if not resolution > 0:
            raise InputError(f"resolution = {resolution}; it is a joint step in rad or m, above 0")
        self._checker, self._resolution = checker, resolution

    def looks_free(self, a: Array, b: Array) -> bool:
        """Whether the samples after a (n,) up to and with b (n,) are free: the end first, then ever finer halvings."""
        steps = max(int(np.ceil(np.abs(b - a).max() / self._resolution)), 1)
        return all(self._checker.is_free_unchecked(a + (b - a) * share) for share in _spread(steps))

    def prove(self, a: Array, b: Array) -> Certificate:
        """The certificate of the straight edge from a (n,) to b (n,)."""
        return certify(JointPath([a, b], self._checker.arm.joint_names), self._checker)


_SPREADS: dict[int, tuple[float, ...]] = {}


def _spread(steps: int) -> tuple[float, ...]:
    """1/steps .. steps/steps, so ordered that contacts are met early: the end, the middle, the quarters, ..."""
    if steps not in _SPREADS:
        order, stride = [steps], 1 << (steps - 1).bit_length()
        seen = {0, steps}
        while stride >= 1:
            for index in range(stride, steps, stride):
                if index not in seen:
                    seen.add(index)
                    order.append(index)
            stride //= 2
        _SPREADS[steps] = tuple(index / steps for index in order)
    return _SPREADS[steps]
