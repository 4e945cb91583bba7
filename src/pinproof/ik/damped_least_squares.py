"""The textbook's damped least squares, damped near singularities only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import require_positive
from pinproof.ik.loop import NOTHING, Here, StepRule
from pinproof.ik.solver import IterativeIk, KernelRule

__all__ = ["DampedLeastSquares"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DampedLeastSquares(IterativeIk):
    """Inverse kinematics by damped least squares: step = -A^T (A A^T + lambda^2 I)^-1 r.

    The damping adapts to how near a singularity is and to how far the target: with s the smallest singular value that A
    can have, ``lambda^2 = damping^2 |r| (1 - (s / region)^2)`` for s below ``region``, and none beyond. As it vanishes
    with the residual, singular targets are reached to the tolerance.

    Settings that are not named here are those of :class:`~pinproof.ik.solver.IterativeIk`.

    Parameters
    ----------
    damping
        The largest lambda, reached at the singularity for a residual of 1; above 0.
    region
        The singular value (metres and radians mixed) at which the damping begins; above 0.

    References
    ----------
    Wampler (1986), "Manipulator inverse kinematic solutions based on vector formulations and damped least-squares
    methods"; Maciejewski, Klein (1988), "Numerical filtering for the operation of robotic manipulators through
    kinematically singular configurations": the damping that follows the smallest singular value. Chan, Lawrence (1988),
    "General inverse kinematics with the error damped pseudoinverse": the damping that follows the error.
    """

    damping: float = 0.5
    region: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("damping", self.damping)
        require_positive("region", self.region)

    def step_rule(self) -> StepRule:
        """The step of damped least squares."""
        return _DampedLeastSquaresStep(self.damping, self.region)

    def kernel_rule(self) -> KernelRule:
        """The same, compiled."""
        from pinproof.kernels.descent import SINGULAR

        return SINGULAR, (0.0, self.damping, self.region)


class _DampedLeastSquaresStep:
    def __init__(self, damping: float, region: float) -> None:
        self._damping, self._region = damping, region

    def observe(self, here: Here) -> None:
        """Nothing is learnt."""

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        there = np.abs(jacobian) > NOTHING
        rank = min(there.any(axis=1).sum(), there.any(axis=0).sum())
        smallest = values[rank - 1] if rank else 0.0
        size = float(np.linalg.norm(residual))
        squared = self._damping**2 * size * (1 - (smallest / self._region) ** 2) if smallest < self._region else 0.0
        kept = values > NOTHING
        shares = values[kept] / (values[kept] ** 2 + squared)
        return np.asarray(-right[kept].T @ (shares * (left[:, kept].T @ residual)))
