"""Sampled collision checks of straight edges in joint space, which decide whether an edge is worth a proof."""

from __future__ import annotations

import numpy as np

from pinproof._core import EdgeChecker
from pinproof.collision import CoalJudge, CollisionChecker
from pinproof.errors import InputError
from pinproof.motion import TorqueLimits
from pinproof.spatial import Array

PAD = 5e-4
"""Default distance (m) in addition to the margin that samples must keep."""

MAX_REFINEMENT = 16
"""Largest factor by which the resolution is refined. Denser samples would cost more than the proofs that they save."""


STANDSTILL_SHARE = 0.95
"""Share of the torque limits that holding the arm at rest may need; the rest is for the motion and between samples."""

AT_ENDS = 1e-9
"""Relative rounding error of the torques at the ends."""


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
    torque_limits
        Only samples at which the joints can hold the arm at rest are free, with a reserve for the motion unless an end
        has none. Proofs do not cover torques.

    Attributes
    ----------
    steering
        The checker with the padded margin.
    core
        The edge checker of the compiled core.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        resolution: float,
        ends: Array,
        *,
        pad: float = PAD,
        torque_limits: TorqueLimits | None = None,
    ) -> None:
        if not resolution > 0:
            raise InputError(f"resolution = {resolution}; it must be a distance above 0 m")
        self._checker, self._resolution, self._finest = checker, resolution, resolution / MAX_REFINEMENT
        self.core = EdgeChecker(checker.world, CoalJudge(checker.workspace), resolution)
        if torque_limits is not None:
            share = float(np.clip(torque_limits.standstill_share(ends) * (1.0 + AT_ENDS), STANDSTILL_SHARE, 1.0))
            self.core.set_torque_limits(torque_limits.tree, torque_limits.limits * share)
        # The ends must keep twice the pad beyond the margin; where they do not, the pad is half of what they keep.
        common = len(checker.margins) == 0 or float(checker.margins.min()) >= checker.margin
        if not (common and bool(checker.padded(2 * pad).is_free_batch(ends).all())):
            spare = float(checker.clearance_batch(ends).min(initial=np.inf)) - checker.margin
            pad = min(pad, max(spare, 0.0) / 2)
        self._steer(pad)

    def _steer(self, pad: float) -> None:
        self._pad, self.steering = pad, self._checker.padded(pad)
        blocked = bool(self.steering.still.touching)
        self.core.set_steering(self.steering.world, CoalJudge(self.steering.workspace), blocked)

    @property
    def samples(self) -> int:
        """Total number of samples so far."""
        return int(self.core.samples)

    def samples_free(self, a: Array, b: Array) -> bool:
        """Whether the samples from a (n,), exclusive, to b (n,), inclusive, are free; b is checked first."""
        return bool(self.core.samples_free(np.ascontiguousarray(a), np.ascontiguousarray(b)))

    def proven_free(self, a: Array, b: Array) -> bool:
        """Whether the edge from a (n,) to b (n,) is proven free; the proof is attempted if its samples are free."""
        return bool(self.core.proven_free(np.ascontiguousarray(a), np.ascontiguousarray(b)))

    def refine(self) -> None:
        """Halve the resolution, down to a limit. To be called if an edge with free samples fails the proof."""
        self._resolution = max(self._resolution / 2, self._finest)
        self.core.set_resolution(self._resolution)

    def reduce_pad(self) -> None:
        """Reduce the pad to a quarter, so that narrower passages are found."""
        self._steer(self._pad / 4)
