"""Sampled collision checks of straight edges in joint space, which decide whether an edge is worth a proof."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, is_proven_free
from pinproof.errors import InputError
from pinproof.motion import JointPath

__all__ = ["Edges"]

Array = npt.NDArray[np.float64]

PAD = 5e-4
"""Default distance (m) in addition to the margin that samples must keep."""

MAX_REFINEMENT = 16
"""Largest factor by which the resolution is refined. Denser samples would cost more than the proofs that they save."""


class Edges:
    """The edges of one planning problem.

    Parameters
    ----------
    checker
        Defines the bodies and margins.
    resolution
        Distance (m) by which bodies move between two samples of an edge. It only steers the search.
    ends
        (e, n) free configurations that must stay reachable. If one of them is closer to a body than ``pad``, the pad is
        reduced.
    pad
        Distance (m) in addition to the margin that samples must keep. A path that barely keeps the margin is difficult
        to prove.

    Attributes
    ----------
    steering
        The checker with the padded margin.
    resolution
        The current resolution.
    deferred, counts
        The working arrays of :func:`pinproof.kernels.rrt_edge.look`: (s, n) samples that only coal can check; their
        number, the total number of samples, and the pair that was in contact most recently.
    """

    def __init__(self, checker: CollisionChecker, resolution: float, ends: Array, *, pad: float = PAD) -> None:
        from pinproof.kernels import rrt_edge

        if not resolution > 0:
            raise InputError(f"resolution = {resolution}; it must be a distance above 0 m")
        self._kernel = rrt_edge
        self._checker, self.resolution, self._finest = checker, resolution, resolution / MAX_REFINEMENT
        spare = min((checker.clearance(q) for q in ends), default=np.inf) - checker.margin
        self._pad = min(pad, max(spare, 0.0) / 2)
        self.steering = checker.padded(self._pad)
        self.deferred = np.empty((rrt_edge.MOST_LOOKS, checker.arm.dof))
        self.counts = np.array([0, 0, -1])
        self._edge = np.empty((2, checker.arm.dof))

    @property
    def samples(self) -> int:
        """Total number of samples so far."""
        return int(self.counts[self._kernel.LOOKS])

    def load_kernels(self, q: Array) -> None:
        """Sample and prove the edge from q (n,) to q once, so that later calls do not include compilation."""
        before = self.counts.copy()
        self.samples_free(q, q)
        is_proven_free(JointPath([q], self._checker.arm.joint_names), self._checker)
        self.counts[:] = before

    def samples_free(self, a: Array, b: Array) -> bool:
        """Whether the samples from a (n,), exclusive, to b (n,), inclusive, are free; b is checked first."""
        k, steering = self._kernel, self.steering
        if steering.still.touching:
            return False
        self._edge[:] = a, b
        at, edge = steering.workspace.at, self._edge
        verdict = k.look(steering.numbers, steering.indices, at, edge, self.resolution, self.deferred, self.counts)
        return self.deferred_free() if verdict == k.ASK else verdict == k.FREE

    def deferred_free(self) -> bool:
        """Whether the samples that the compiled loop left to coal are free."""
        count = self.counts[self._kernel.ASKED]
        return all(self.steering.is_free_unchecked(q) for q in self.deferred[:count])

    def proven_free(self, a: Array, b: Array) -> bool:
        """Whether the edge from a (n,) to b (n,) is proven free; the proof is attempted if its samples are free."""
        if not self.samples_free(a, b):
            return False
        return is_proven_free(JointPath([a, b], self._checker.arm.joint_names), self._checker)

    def refine(self) -> None:
        """Halve the resolution, down to a limit. To be called if an edge with free samples fails the proof."""
        self.resolution = max(self.resolution / 2, self._finest)

    def reduce_pad(self) -> None:
        """Reduce the pad to a quarter, so that narrower passages are found."""
        self._pad /= 4
        self.steering = self._checker.padded(self._pad)
