"""The textbook's pseudo-inverse: Newton's step, by singular values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import require_positive
from pinproof.ik.loop import NOTHING, Here, StepRule
from pinproof.ik.solver import IterativeIk, KernelRule

__all__ = ["PseudoInverse"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PseudoInverse(IterativeIk):
    """Inverse kinematics by the Moore-Penrose inverse of the Jacobian: step = -A^+ r.

    Of the singular values s of A, those up to ``cutoff`` times the largest count as zero: their directions are given up
    for this step. Just above it, steps are as long as 1/s, and ``max_step`` alone bounds them: near singularities this
    method shakes, which is why the damped ones exist.

    Settings that are not named here are those of :class:`~pinproof.ik.solver.IterativeIk`.

    Parameters
    ----------
    cutoff
        The share of the largest singular value, at least 0 and below 1.

    References
    ----------
    Whitney (1969), "Resolved motion rate control of manipulators and human prostheses"; Golub, Kahan (1965),
    "Calculating the singular values and pseudo-inverse of a matrix".
    """

    cutoff: float = 1e-4

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("cutoff", self.cutoff, zero=True, below=1.0)

    def step_rule(self) -> StepRule:
        """The step of the pseudo-inverse."""
        return _PseudoInverseStep(self.cutoff)

    def kernel_rule(self) -> KernelRule:
        """The same, compiled."""
        from pinproof.kernels.descent import SINGULAR

        return SINGULAR, (self.cutoff, 0.0, 0.0)


class _PseudoInverseStep:
    def __init__(self, cutoff: float) -> None:
        self._cutoff = cutoff

    def observe(self, here: Here) -> None:
        """Nothing is learnt."""

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        kept = values > max(self._cutoff * values[0], NOTHING)
        return np.asarray(-right[kept].T @ (left[:, kept].T @ residual / values[kept]))
