"""The step of :class:`pinproof.Clik`: damped by the error, and further until the step fits the bound."""

from __future__ import annotations

from typing import Any

from pinproof.kernels.cholesky import factor, gram, solve_factored
from pinproof.kernels.compiled import inlined
from pinproof.kernels.workspace import PULL, RESIDUAL, STEP, VALUES

__all__ = ["GROWTH", "MOST_GROWTHS", "RELIEF", "SMALLEST_DAMPING", "step_clik"]

SMALLEST_DAMPING = 1e-10
"""Added to the damping, so that the matrix is positive definite if the error is zero. At a residual of 1e-6 from a
singular target the relevant singular value is about 1e-3; its square is far larger than this."""

GROWTH = 4.0
"""Factor by which the damping grows while a step is too long, and after each step that increased the error."""

RELIEF = 0.5
"""Factor of that growth after each step that decreased the error."""

MOST_GROWTHS = 20
"""4^20 is 1e12, which is sufficient for any step at a singularity."""


@inlined
def step_clik(
    damping: float, growth: float, longest: float, jacobian: Any, square: Any, lower: Any, joints: Any, errors: Any
) -> None:
    """The step -A^T (A A^T + lambda I)^-1 pull with A = ``jacobian``, into the row STEP of ``joints``.

    lambda = growth damping/2 |residual|^2, multiplied by ``GROWTH`` until no joint moves by more than ``longest``.
    """
    size = 0.0
    for k in range(6):
        size += errors[RESIDUAL, k] * errors[RESIDUAL, k]
    shift = 0.5 * growth * damping * size + SMALLEST_DAMPING
    gram(jacobian, square)
    for _ in range(MOST_GROWTHS):
        if factor(square, shift, lower):
            solve_factored(lower, errors, PULL, VALUES)
            largest = 0.0
            for i in range(jacobian.shape[1]):
                total = 0.0
                for k in range(6):
                    total -= jacobian[k, i] * errors[VALUES, k]
                joints[STEP, i] = total
                largest = max(largest, abs(total))
            if largest <= longest:
                return
        shift *= GROWTH
