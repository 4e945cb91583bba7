"""The damped least-squares step within a box: a small convex problem, solved exactly by an active set.

Source: Stark, Parker (1995), "Bounded-variable least-squares: an algorithm and applications". With damping the minimum
is unique, and the 6 x 6 form A^T (A A^T + shift I)^-1 is valid for any number of joints.
"""

from __future__ import annotations

from typing import Any

from pinproof.kernels.cholesky import factor, gram, solve_factored
from pinproof.kernels.compiled import inlined
from pinproof.kernels.workspace import HELD, PULL, STEP, VALUES

__all__ = ["DOWN", "LEFT", "UP", "WISH", "box_step"]

# Rows of ``joints`` and of ``errors`` after those of the workspace.
WISH, DOWN, UP = 6, 7, 8
LEFT = 4

CHANGES = 4
"""Maximum number of changes of the active set per joint; the step is then used as it is, which is feasible. More
than two are rare; the limit only ends cycles due to rounding."""

MOST_GROWTHS, GROWTH = 20, 4.0
"""Maximum number of increases of the shift, and their factor, until the matrix is numerically positive definite;
more than one is rare."""


@inlined
def box_step(shift: float, jacobian: Any, rows: Any, square: Any, lower: Any, joints: Any, errors: Any) -> float:
    """The d in [DOWN, UP] that minimises |A d + pull|^2 + shift |d|^2, into the row STEP of ``joints``.

    A = ``jacobian`` (6, n); ``rows`` (6, n) is scratch. Returns |pull|^2 - |A d + pull|^2. HELD becomes -1 or 1 for the
    joints at a bound.
    """
    n = jacobian.shape[1]
    for i in range(n):
        joints[STEP, i] = min(max(0.0, joints[DOWN, i]), joints[UP, i])
        joints[HELD, i] = 0.0
        for k in range(6):
            rows[k, i] = jacobian[k, i]
    for k in range(6):
        errors[LEFT, k] = errors[PULL, k]
    for _ in range(CHANGES * n):
        gram(rows, square)
        for _ in range(MOST_GROWTHS):
            if factor(square, shift, lower):
                break
            shift *= GROWTH
        solve_factored(lower, errors, LEFT, VALUES)

        # Free joints move to their unconstrained optimum, up to the first that meets a bound.
        share, stopped = 1.0, -1
        for i in range(n):
            wish = 0.0
            for k in range(6):
                wish -= jacobian[k, i] * errors[VALUES, k]
            joints[WISH, i] = wish
            if joints[HELD, i] == 0.0 and (wish < joints[DOWN, i] or wish > joints[UP, i]):
                bound = joints[UP, i] if wish > joints[UP, i] else joints[DOWN, i]
                part = (bound - joints[STEP, i]) / (wish - joints[STEP, i])
                if part < share:
                    share, stopped = part, i
        for i in range(n):
            if joints[HELD, i] == 0.0:
                joints[STEP, i] += share * (joints[WISH, i] - joints[STEP, i])
        if stopped >= 0:
            beyond = joints[WISH, stopped] > joints[UP, stopped]
            joints[HELD, stopped] = 1.0 if beyond else -1.0
            joints[STEP, stopped] = joints[UP, stopped] if beyond else joints[DOWN, stopped]
            for k in range(6):
                errors[LEFT, k] += jacobian[k, stopped] * joints[STEP, stopped]
                rows[k, stopped] = 0.0
            continue

        # The gradient at a held joint is shift (step - wish); a joint whose optimum is inside the box is released.
        back, freed = 0.0, -1
        for i in range(n):
            inward = joints[HELD, i] * (joints[STEP, i] - joints[WISH, i])
            if inward > back:
                back, freed = inward, i
        if freed < 0:
            break
        joints[HELD, freed] = 0.0
        for k in range(6):
            errors[LEFT, k] -= jacobian[k, freed] * joints[STEP, freed]
            rows[k, freed] = jacobian[k, freed]

    gain = 0.0
    for k in range(6):
        change = 0.0
        for i in range(n):
            change += jacobian[k, i] * joints[STEP, i]
        gain -= change * (2.0 * errors[PULL, k] + change)
    return gain
