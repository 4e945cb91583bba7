"""Closed-loop inverse kinematics: damped least squares whose damping follows the error and the singularities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import require_positive
from pinproof.ik.loop import Here, StepRule
from pinproof.ik.solver import IterativeIk, KernelRule

__all__ = ["Clik"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Clik(IterativeIk):
    """Inverse kinematics for every arm; the default.

    Each step solves, with the residual r and A = dr/dq (see :mod:`pinproof.ik.task`)::

        step = -A^T (A A^T + lambda I)^-1 r,      lambda = growth * damping/2 * |r|^2

    The damping vanishes with the square of the error, so convergence stays fast and singular targets are reached to the
    tolerance. It grows by itself near singularities: where a step would exceed ``max_step``, until the step fits, so
    that directions which the arm has lost are given up first and the others kept; and after a step that made things
    worse, so that an arm which is asked further out than it reaches comes to rest stretched out, and does not shake.

    Settings that are not named here are those of :class:`~pinproof.ik.solver.IterativeIk`.

    Parameters
    ----------
    damping
        The factor above, at least 0; higher is slower and steadier.

    References
    ----------
    Sugihara (2011), "Solvability-Unconcerned Inverse Kinematics by the Levenberg-Marquardt Method", eq. 22.
    More (1978), "The Levenberg-Marquardt algorithm: implementation and theory": damping that fits the step to a bound.
    """

    damping: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("damping", self.damping, zero=True)

    def step_rule(self) -> StepRule:
        """The damped least squares step with these settings."""
        return _DampedStep(self.damping, self.max_step)

    def kernel_rule(self) -> KernelRule:
        """The same, compiled."""
        from pinproof.kernels.descent import CLIK

        return CLIK, (self.damping, 0.0, 0.0)


class _DampedStep:
    """The step rule of :class:`Clik`; remembers how its damping has grown."""

    def __init__(self, damping: float, max_step: float) -> None:
        from pinproof.kernels import step_clik

        self._constants = step_clik
        self._damping, self._max_step = damping, max_step
        self._last, self._growth = np.inf, 1.0

    def observe(self, here: Here) -> None:
        better = here.squared_residual < self._last
        relieved = max(1.0, self._growth * self._constants.RELIEF)
        self._growth = relieved if better else self._growth * self._constants.GROWTH
        self._last = here.squared_residual
        self._shown = min(here.squared_residual, 1.0)

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        square = jacobian @ jacobian.T
        damping = 0.5 * self._growth * self._damping * self._shown + self._constants.SMALLEST_DAMPING
        step = np.zeros(jacobian.shape[1])
        for _ in range(self._constants.MOST_GROWTHS):
            step = -jacobian.T @ np.linalg.solve(square + damping * np.eye(6), residual)
            if np.abs(step).max() <= self._max_step:
                break
            damping *= self._constants.GROWTH
        return np.asarray(step)
