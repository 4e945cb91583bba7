"""Straight edges in joint space, quickly looked at before a proof is begun."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.errors import InputError

__all__ = ["Edges"]

Array = npt.NDArray[np.float64]

PAD = 5e-4
"""Metres that looks keep beyond the margin if they are told nothing else."""

FINEST = 16
"""Edges are looked at this many times as closely at most: a closer look would cost more than the proofs it saves."""


class Edges:
    """Edges of one planning problem.

    Parameters
    ----------
    checker
        What an edge must be free of.
    resolution
        Metres that bodies move between two samples of a quick look. It steers the search and decides nothing.
    ends
        (e, n) free configurations that must stay within reach: where one of them stands nearer to a body, looks keep
        less than ``pad``.
    pad
        Metres of distance that looks keep beyond the margin: a path that only just keeps the margin is hard to prove.

    Attributes
    ----------
    steering
        The checker with the margin of quick looks.
    resolution
        As it is now.
    asked, counts
        What :func:`pinproof.kernels.rrt_edge.look` works in: (s, n) samples that only coal can judge; how many these
        are, samples looked at so far, and the pair that touched last.
    """

    def __init__(self, checker: CollisionChecker, resolution: float, ends: Array, *, pad: float = PAD) -> None:
        from pinproof.kernels import rrt_edge

        if not resolution > 0:
            raise InputError(f"resolution = {resolution}; it is the metres between two samples, above 0")
        self._kernel = rrt_edge
        self._checker, self.resolution, self._finest = checker, resolution, resolution / FINEST
        spare = min((checker.clearance(q) for q in ends), default=np.inf) - checker.margin
        self._pad = min(pad, max(spare, 0.0) / 2)
        self.steering = checker.padded(self._pad)
        self.asked = np.empty((rrt_edge.MOST_LOOKS, checker.arm.dof))
        self.counts = np.array([0, 0, -1])
        self._edge = np.empty((2, checker.arm.dof))

    @property
    def looks(self) -> int:
        """Samples looked at so far."""
        return int(self.counts[self._kernel.LOOKS])

    def looks_free(self, a: Array, b: Array) -> bool:
        """Whether the samples after a (n,) up to and with b (n,) are free: the end first, then ever finer halvings."""
        k, steering = self._kernel, self.steering
        if steering.still.touching:
            return False
        self._edge[:] = a, b
        at, edge = steering.workspace.at, self._edge
        said = k.look(steering.numbers, steering.indices, at, edge, self.resolution, self.asked, self.counts)
        return self.judged_free() if said == k.ASK else said == k.FREE

    def judged_free(self) -> bool:
        """Whether the samples that were left to coal are free."""
        count = self.counts[self._kernel.ASKED]
        return all(self.steering.is_free_unchecked(q) for q in self.asked[:count])

    def look_closer(self) -> None:
        """Halve the resolution, after an edge that looked free was not: something here is thinner than a step."""
        self.resolution = max(self.resolution / 2, self._finest)

    def keep_less(self) -> None:
        """Keep a quarter of the pad from now on, so that narrower ways are seen."""
        self._pad /= 4
        self.steering = self._checker.padded(self._pad)
