"""Closed-loop inverse kinematics: damped least squares whose damping follows the error and the singularities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.ik.loop import StepRule
from pinproof.ik.settings import positive
from pinproof.ik.solver import IterativeIk

__all__ = ["Clik"]

Array = npt.NDArray[np.float64]

SMALLEST_DAMPING = 1e-10
"""Added to the damping, so that the matrix is positive definite when the error has vanished. At a residual of 1e-6 from
a singular target the singular value that has to lead there is about 1e-3; its square is far above this."""

GROWTH = 4.0
"""Factor by which the damping grows while a step is longer than allowed, and after each step that made things worse."""

RELIEF = 0.5
"""Factor by which that growth is taken back after each step that made things better."""

MOST_GROWTHS = 20
"""4^20 is 1e12: enough for any step out of a singularity."""


@dataclass(frozen=True, kw_only=True)
class Clik(IterativeIk):
    """Inverse kinematics on Pinocchio's kinematics, for every arm.

    Each step solves, with the residual r = log6(target_from_tcp) and A = dr/dq (see :mod:`pinproof.ik.task`)::

        (A^T A + lambda I) step = -A^T r,      lambda = growth * damping/2 * |r|^2

    The damping vanishes with the square of the error, so convergence stays fast and singular targets are reached to the
    tolerance. It grows by itself near singularities: where a step would exceed ``max_step``, until the step fits, so
    that directions which the arm has lost are given up first and the others kept; and after a step that made things
    worse, so that an arm which is asked further out than it reaches comes to rest stretched out, and does not shake.

    Parameters
    ----------
    damping
        The factor above, at least 0; higher is slower and steadier.

    The other settings are those of :class:`~pinproof.ik.solver.IterativeIk`.

    References
    ----------
    Sugihara (2011), "Solvability-Unconcerned Inverse Kinematics by the Levenberg-Marquardt Method", eq. 22.
    More (1978), "The Levenberg-Marquardt algorithm: implementation and theory": damping that fits the step to a bound.
    """

    damping: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        positive("damping", self.damping, zero=True)

    def step_rule(self, dof: int) -> StepRule:
        """The damped least squares step with these settings, for ``dof`` joints."""
        return _DampedStep(self.damping, self.max_step, dof)


class _DampedStep:
    """The step rule of :class:`Clik`; remembers how its damping has grown."""

    def __init__(self, damping: float, max_step: float, dof: int) -> None:
        # LAPACK's Cholesky solver itself: np.linalg.solve costs four times as much at this size.
        from scipy.linalg.lapack import dposv

        self._cholesky_solve = dposv
        self._damping, self._max_step = damping, max_step
        self._identity = np.eye(dof)
        self._last, self._growth = np.inf, 1.0

    def observe(self, squared_residual: float) -> None:
        better = squared_residual < self._last
        self._growth = max(1.0, self._growth * RELIEF) if better else self._growth * GROWTH
        self._last = squared_residual

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        square = jacobian.T @ jacobian
        pull = -(residual @ jacobian)
        damping = 0.5 * self._growth * self._damping * residual.dot(residual) + SMALLEST_DAMPING
        step = pull
        for _ in range(MOST_GROWTHS):
            _, step, failed = self._cholesky_solve(square + damping * self._identity, pull)
            if not failed and (step.dot(step) <= self._max_step**2 or np.abs(step).max() <= self._max_step):
                break
            damping *= GROWTH
        return np.asarray(step)
