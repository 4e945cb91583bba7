"""Gauss-Newton steps in a box: the descent of a cycle, and motions that preserve the residual at first order.

The arrays are those of a workspace whose ``joints`` and ``errors`` have the rows of :mod:`pinproof.kernels.box_step`
and those below.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.box_step import DOWN, UP, box_step
from pinproof.kernels.chain import jacobian_of, walk
from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.task import error_jacobian, residual_of
from pinproof.kernels.workspace import DRIFT, PULL, RESIDUAL, STEP

__all__ = [
    "BEGAN",
    "CEILING",
    "FLOOR",
    "clamped",
    "copy",
    "look",
    "look_closely",
    "lost_motion",
    "settle",
    "square_of",
    "wander",
]

# Rows of ``joints``: the start of the cycle, and the bounds of the configurations that it may reach.
BEGAN, FLOOR, CEILING = 9, 10, 11

FAITHFUL = 0.5
"""The smallest fraction of the improvement predicted by the linear model for which a step is accepted."""

DAMPING = 1e-3
"""The damping of a step, per unit of the residual (m or rad); the box bounds the step, so that little is needed."""

SMALLEST_DAMPING = 1e-14
"""Far below the squares of relevant singular values, far above rounding."""

GROWTH, RELIEF = 8.0, 0.125
"""Factors of the damping after a rejected and after an accepted step."""

MOST_STEPS = 20
"""Maximum number of steps of one descent in a cycle. One or two are typical, about ten close to a singularity."""

ARRIVED = 1e-10
"""m and rad: a residual below this is not reduced further; rounding is a hundred times smaller."""

GAIN = 1e-11
"""m and rad: a descent ends if the next step promises a smaller improvement."""

LOST = 1e-8
"""The square of a singular value below which a motion counts as singular, that is, preserves the residual."""


@inlined
def clamped(joints: Any, i: int, value: float) -> float:
    """Clip joint i to the configurations that the cycle may reach."""
    return min(max(value, joints[FLOOR, i]), joints[CEILING, i])


@inlined
def copy(source: Any, target: Any) -> None:
    """Copy the numbers (n,) of one array into another."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@inlined
def square_of(errors: Any) -> float:
    """The squared residual."""
    squared = 0.0
    for k in range(6):
        squared += errors[RESIDUAL, k] * errors[RESIDUAL, k]
    return squared


@compiled
def look(chain: Any, q: Any, work: Any) -> float:
    """Compute the residual at q into the workspace; returns its square."""
    turns, axes, start, end, _, _, _, _, _, errors = work
    walk(chain, start, q, turns, axes, end)
    residual_of(end, errors)
    return square_of(errors)


@compiled
def look_closely(chain: Any, q: Any, work: Any) -> float:
    """Compute the residual at q and its Jacobian into the workspace; returns the square of the residual."""
    turns, axes, start, end, jacobian, _, _, _, _, errors = work
    walk(chain, start, q, turns, axes, end)
    residual_of(end, errors)
    jacobian_of(chain, axes, end, jacobian)
    error_jacobian(end, errors, jacobian)
    return square_of(errors)


@compiled
def settle(chain: Any, q: Any, trial: Any, work: Any) -> float:
    """Descend in the box from q (n,), which becomes the result; returns the squared residual. ``trial`` is scratch."""
    turns, axes, start, end, jacobian, rows, square, lower, joints, errors = work
    n = q.shape[0]
    walk(chain, start, q, turns, axes, end)
    residual_of(end, errors)
    squared, damping, fresh = square_of(errors), DAMPING, True
    for _ in range(MOST_STEPS):
        if squared <= ARRIVED * ARRIVED:
            break
        if fresh:
            jacobian_of(chain, axes, end, jacobian)
            error_jacobian(end, errors, jacobian)
            for i in range(n):
                joints[DOWN, i], joints[UP, i] = joints[FLOOR, i] - q[i], joints[CEILING, i] - q[i]
            for k in range(6):
                errors[PULL, k] = errors[RESIDUAL, k]
        size = math.sqrt(squared)
        promised = box_step(damping * size + SMALLEST_DAMPING, jacobian, rows, square, lower, joints, errors)
        if not promised > 2.0 * size * GAIN:  # The condition also ends the descent if the residual is NaN.
            break
        for i in range(n):
            trial[i] = clamped(joints, i, q[i] + joints[STEP, i])
        walk(chain, start, trial, turns, axes, end)
        residual_of(end, errors)
        there = square_of(errors)
        fresh = squared - there >= FAITHFUL * promised
        if fresh:
            squared, damping = there, max(DAMPING, RELIEF * damping)
            copy(trial, q)
        else:
            damping *= GROWTH
    return squared


@compiled
def lost_motion(chain: Any, q: Any, work: Any) -> None:
    """Reduce the motion DRIFT to the part that preserves the residual at q at first order, within the box."""
    _, _, _, _, jacobian, rows, square, lower, joints, errors = work
    look_closely(chain, q, work)
    for k in range(6):
        errors[PULL, k] = 0.0
    for i in range(q.shape[0]):
        drift = joints[DRIFT, i]
        joints[DOWN, i], joints[UP, i] = joints[FLOOR, i] - q[i] - drift, joints[CEILING, i] - q[i] - drift
        for k in range(6):
            errors[PULL, k] += jacobian[k, i] * drift
    box_step(LOST, jacobian, rows, square, lower, joints, errors)
    for i in range(q.shape[0]):
        joints[DRIFT, i] += joints[STEP, i]


@compiled
def wander(chain: Any, q: Any, trial: Any, work: Any) -> float:
    """Move q along the part of DRIFT that preserves the residual, and descend; returns the squared residual."""
    joints = work.joints
    lost_motion(chain, q, work)
    for i in range(q.shape[0]):
        q[i] = clamped(joints, i, q[i] + joints[DRIFT, i])
    return settle(chain, q, trial, work)
