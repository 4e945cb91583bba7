"""The methods that use the Jacobian: CLIK, damped least squares, and the pseudo-inverse."""

from __future__ import annotations

import numpy as np

from pinproof._core import ClikStep, SingularStep
from pinproof.common.structs import key, struct
from pinproof.ik.iterative import IterativeIk
from pinproof.ik.loop import DescentState, ObservingRule, StepRule
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
        return _DampedStep(self.compiled_rule(), self.max_step)

    def compiled_rule(self) -> ClikStep:
        """The compiled form of :meth:`step_rule`."""
        return ClikStep(self.damping)


class _DampedStep:
    """The step rule of :class:`Clik`, with the current factor of its damping."""

    def __init__(self, rule: ClikStep, max_step: float) -> None:
        self._rule, self._max_step = rule, max_step
        self._last, self._growth = np.inf, 1.0

    def observe(self, here: DescentState) -> None:
        # damping grows after a step that increased the error, and is relieved otherwise
        better, rule = here.squared_residual < self._last, self._rule
        self._growth = max(1.0, self._growth * rule.RELIEF) if better else self._growth * rule.GROWTH
        self._last = here.squared_residual

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        return self._rule.step(self._growth, self._max_step, min(self._last, 1.0), residual, jacobian)


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
        return self.compiled_rule().step

    def compiled_rule(self) -> SingularStep:
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
        return self.compiled_rule().step

    def compiled_rule(self) -> SingularStep:
        """The compiled form of :meth:`step_rule`."""
        return SingularStep(self.cutoff, 0.0, 1.0)
