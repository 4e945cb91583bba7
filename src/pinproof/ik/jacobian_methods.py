"""The methods that use the Jacobian: CLIK, damped least squares, and the pseudo-inverse."""

from __future__ import annotations

import numpy as np

from pinproof._core import ClikStep, SingularStep
from pinproof.common.structs import key, struct
from pinproof.ik.iterative import IterativeIk
from pinproof.ik.loop import NOTHING, CompiledRule, DescentState, ObservingRule, StepRule
from pinproof.spatial import Array


@struct(kw_only=True)
class Clik(IterativeIk):
    """Closed-loop inverse kinematics: the default method, for every arm and task.

    Each step solves, with the residual r and A = dr/dq (see :mod:`pinproof.ik.task`)::

        step = -A^T (A A^T + lambda I)^-1 r,      lambda = growth * damping/2 * |r|^2

    The damping decreases with the square of the error, so that convergence is fast and singular targets are reached
    within the tolerance. The factor ``growth`` increases in two cases: if a step exceeds ``max_step``, until it does
    not, which suppresses the nearly singular directions first; and after a step that increased the error, so that an
    arm with an unreachable target converges to a stretched configuration without oscillation.

    References
    ----------
    Sugihara (2011), "Solvability-Unconcerned Inverse Kinematics by the Levenberg-Marquardt Method", eq. 22.
    More (1978), "The Levenberg-Marquardt algorithm: implementation and theory": damping that fits the step to a bound.
    """

    damping: float = key("the factor above. Larger values are slower and more robust", default=0.1, minimum=0)

    def step_rule(self) -> ObservingRule:
        """The damped least-squares step with these settings."""
        return _DampedStep(self.damping, self.max_step)

    def compiled_rule(self) -> CompiledRule:
        """The compiled form of :meth:`step_rule`."""
        return ClikStep(self.damping)


class _DampedStep:
    """The step rule of :class:`Clik`, with the current factor of its damping."""

    def __init__(self, damping: float, max_step: float) -> None:
        self._constants = ClikStep
        self._damping, self._max_step = damping, max_step
        self._last, self._growth = np.inf, 1.0

    def observe(self, here: DescentState) -> None:
        # damping grows after a step that increased the error, and is relieved otherwise
        better = here.squared_residual < self._last
        reduced = max(1.0, self._growth * self._constants.RELIEF)
        self._growth = reduced if better else self._growth * self._constants.GROWTH
        self._last = here.squared_residual
        self._squared_residual = min(here.squared_residual, 1.0)

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        # more damping until the step is not longer than the bound
        square = jacobian @ jacobian.T
        damping = 0.5 * self._growth * self._damping * self._squared_residual + self._constants.SMALLEST_DAMPING
        step = np.zeros(jacobian.shape[1])
        for _ in range(self._constants.MOST_GROWTHS):
            step = -jacobian.T @ np.linalg.solve(square + damping * np.eye(6), residual)
            if np.abs(step).max() <= self._max_step:
                break
            damping *= self._constants.GROWTH
        return np.asarray(step)


@struct(kw_only=True)
class DampedLeastSquares(IterativeIk):
    """Inverse kinematics by damped least squares: step = -A^T (A A^T + lambda^2 I)^-1 r.

    The damping depends on the distance from a singularity and from the target: with s the smallest singular value of A
    within its rank, ``lambda^2 = damping^2 |r| (1 - (s / region)^2)`` for s below ``region``, else 0. It decreases with
    the residual, so that singular targets are reached within the tolerance.

    References
    ----------
    Wampler (1986), "Manipulator inverse kinematic solutions based on vector formulations and damped least-squares
    methods"; Maciejewski, Klein (1988), "Numerical filtering for the operation of robotic manipulators through
    kinematically singular configurations": the damping that follows the smallest singular value. Chan, Lawrence (1988),
    "General inverse kinematics with the error damped pseudoinverse": the damping that follows the error.
    """

    damping: float = key("the largest lambda, at a singularity for a residual of norm 1", default=0.5, above=0)
    region: float = key(
        "the singular value (metres and radians mixed) below which the step is damped", default=0.5, above=0
    )

    def step_rule(self) -> StepRule:
        """The damped least-squares step."""
        return _SingularStep(0.0, self.damping, self.region)

    def compiled_rule(self) -> CompiledRule:
        """The compiled form of :meth:`step_rule`."""
        return SingularStep(0.0, self.damping, self.region)


@struct(kw_only=True)
class PseudoInverse(IterativeIk):
    """Inverse kinematics by the Moore-Penrose inverse of the Jacobian: step = -A^+ r.

    Singular values s of A up to ``cutoff`` times the largest are treated as zero. Just above that threshold the step
    grows as 1/s and is bounded by ``max_step`` only, so that the method oscillates near singularities; the damped
    methods do not.

    References
    ----------
    Whitney (1969), "Resolved motion rate control of manipulators and human prostheses"; Golub, Kahan (1965),
    "Calculating the singular values and pseudo-inverse of a matrix".
    """

    cutoff: float = key("the fraction of the largest singular value", default=1e-4, minimum=0, below=1)

    def step_rule(self) -> StepRule:
        """The pseudo-inverse step."""
        return _SingularStep(self.cutoff, 0.0, 1.0)

    def compiled_rule(self) -> CompiledRule:
        """The compiled form of :meth:`step_rule`."""
        return SingularStep(self.cutoff, 0.0, 1.0)


class _SingularStep:
    """The step rule of :class:`DampedLeastSquares` and :class:`PseudoInverse`, from the singular values of A."""

    def __init__(self, cutoff: float, damping: float, region: float) -> None:
        self._cutoff, self._damping, self._region = cutoff, damping, region

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        # rows that the task does not select and columns of held joints are zero, and reduce the rank
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        nonzero = np.abs(jacobian) > NOTHING
        rank = min(nonzero.any(axis=1).sum(), nonzero.any(axis=0).sum())
        share = (values[rank - 1] if rank else 0.0) / self._region
        squared = self._damping**2 * float(np.linalg.norm(residual)) * (1 - share**2) if share < 1 else 0.0
        kept = values > max(self._cutoff * values[0], NOTHING)
        factors = values[kept] / (values[kept] ** 2 + squared)
        return np.asarray(-right[kept].T @ (factors * (left[:, kept].T @ residual)))
