"""Where the attempts after the first begin: a low-discrepancy set of configurations, the nearest in pose first."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import Rng, random_generator
from pinproof.model import Arm

__all__ = ["Seeds", "seeds_of"]

Array = npt.NDArray[np.float64]

COUNT = 1024
"""Seeds of a set. Choosing among them costs a microsecond; among four times as many it costs more than it saves."""

SPIN_WEIGHT = 0.4
"""The weight of a rotation in the distance between poses, in units of the variance (m^2) of the positions."""

SETS_KEPT = 4
"""Sets remembered for an arm and its limits; one takes a quarter of a millisecond to make."""


@dataclass(frozen=True, eq=False)
class Seeds:
    """Configurations (T, n) inside the limits, their poses (12, T) in single precision, the weight of a rotation."""

    q: Array
    poses: npt.NDArray[np.float32]
    spin_weight: float

    def weights(self, asked: Array) -> Array:
        """(2,) of the squared distance and of the rotation's trace, for a task (6,)."""
        if not asked[:3].any():
            return np.array([0.0, 1.0])
        return np.array([1.0, self.spin_weight if asked[3:].all() else 0.0])

    def nearest(self, target: Array, asked: Array) -> npt.NDArray[np.int64]:
        """The indices of the seeds, the nearest in pose to a target (4, 4) first; for the loop on Pinocchio."""
        distance, spin = self.weights(asked).astype(np.float32)
        p = self.poses.reshape(3, 4, -1)
        t = target[:3].astype(np.float32)
        away = ((p[:, 3] - t[:, 3:]) ** 2).sum(axis=0)
        return np.argsort(distance * away - spin * (p[:, :3] * t[:, :3, None]).sum(axis=(0, 1)), kind="stable")


_KEPT: WeakKeyDictionary[Arm, dict[int, Seeds]] = WeakKeyDictionary()


def seeds_of(arm: Arm, rng: Rng | np.random.SeedSequence) -> Seeds:
    """The seeds of an arm inside its limits: one additive recurrence, shifted by ``rng``.

    Source: Roberts (2018), "The unreasonable effectiveness of quasirandom sequences": x_k = s + k a mod 1, a_j = g^-j
    with g the root of g^(n + 1) = g + 1; the shift is that of Cranley and Patterson (1976).
    """
    kept = _KEPT.setdefault(arm, {})
    if isinstance(rng, int) and rng in kept:
        return kept[rng]
    seeds = _made(arm, random_generator(rng).random(arm.dof))
    if isinstance(rng, int) and not isinstance(rng, bool):
        while len(kept) >= SETS_KEPT:
            kept.pop(next(iter(kept)), None)
        kept[rng] = seeds
    return seeds


def _made(arm: Arm, shift: Array) -> Seeds:
    from pinproof.kernels.chain import forward_many

    root = 2.0
    for _ in range(64):
        root = (1 + root) ** (1 / (arm.dof + 1))
    steps = root ** -np.arange(1.0, arm.dof + 1)
    lower, upper = arm.limits.sampling_range()
    q = lower + (upper - lower) * ((shift + np.arange(1, COUNT + 1)[:, None] * steps) % 1.0)
    poses = np.empty((COUNT, 4, 4))
    forward_many(arm.packed, q, poses)
    spread = float(poses[:, :3, 3].var(axis=0).sum())
    return Seeds(q, np.ascontiguousarray(poses[:, :3].reshape(COUNT, 12).T, dtype=np.float32), SPIN_WEIGHT * spread)
