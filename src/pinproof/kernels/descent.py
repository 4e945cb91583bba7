"""The loop of the iterative methods, compiled; it computes the same iterates as :mod:`pinproof.ik.loop`.

A method is given by its step rule: one of the numbers below, and up to three settings. The box (5, n) is described in
:mod:`pinproof.kernels.limits`.
"""

from __future__ import annotations

import math
from typing import Any

from pinproof.kernels.chain import jacobian_of, walk
from pinproof.kernels.compiled import compiled, inlined
from pinproof.kernels.goals import NONE, drift_of
from pinproof.kernels.limits import HIGH, LOW, LOWER, TURN, TURNING, UPPER
from pinproof.kernels.step_clik import GROWTH, RELIEF, step_clik
from pinproof.kernels.step_fabrik import step_fabrik
from pinproof.kernels.step_singular import step_singular
from pinproof.kernels.task import error_jacobian, residual_of
from pinproof.kernels.workspace import BEST, DRIFT, HELD, MOVED, PULL, RESIDUAL, STEP

__all__ = ["CLIK", "FABRIK", "SINGULAR", "descend"]

CLIK, SINGULAR, FABRIK = 0, 1, 2
"""The first setting of ``FABRIK`` is that of Clik; the second is the squared residual below which the step of Clik
is used."""

SATURATION = 1.0
"""Largest norm of the residual (m and rad together) that is passed to a step rule; longer residuals are scaled."""

SMALLEST_STEP = 1e-12
"""Rad or m. A descent stops if its step is at most this, which does not change a pose."""

STILL = 1e-4
"""Rad or m. A goal has converged if its step moves no joint by more than this."""

GOAL_STEPS = 300
"""Additional steps for a goal after the task is satisfied. A step of a goal changes the task by the square of its
length only, which the following steps correct."""


@compiled
def descend(
    rule: int,
    settings: Any,
    chain: Any,
    box: Any,
    tolerances: Any,
    goal: Any,
    most: int,
    longest: float,
    progress: float,
    patience: int,
    q: Any,
    work: Any,
    moved: Any,
) -> Any:
    """Descend from q (n,) within the limits until the task is satisfied or the descent stalls.

    The workspace contains target_from_base (start) and the mask of the task; q becomes the best configuration found.
    ``tolerances`` are in m and rad, ``most`` is the maximum number of steps, ``longest`` the largest motion of a joint
    in one step. The descent has stalled if the squared residual has not fallen below the fraction ``progress`` within
    ``patience`` steps. ``moved`` (m + 2, 12) is the scratch of FABRIK.

    Returns whether the task is satisfied, the number of steps, and the squared residual.
    """
    n = q.shape[0]
    turns, axes, start, end, jacobian, rows, square, lower, joints, errors = work
    best = mark = last = math.inf
    growth = 1.0
    marked = iteration = 0
    reached = False
    while True:
        walk(chain, start, q, turns, axes, end)
        residual_of(end, errors)
        position = angle = 0.0
        for i in range(3):
            position += errors[RESIDUAL, i] * errors[RESIDUAL, i]
            angle += errors[RESIDUAL, i + 3] * errors[RESIDUAL, i + 3]
        squared = position + angle
        here = position <= tolerances[0] * tolerances[0] and angle <= tolerances[1] * tolerances[1]
        if here or (not reached and squared < best):
            best = squared
            for i in range(n):
                joints[BEST, i] = q[i]
        reached = reached or here
        if here and goal[0, 0] == NONE:
            break
        if squared < progress * mark:
            mark, marked = squared, iteration
        stalled = iteration - marked >= patience and not reached
        # The condition also ends the descent if the residual is NaN.
        if stalled or iteration >= (most + GOAL_STEPS if reached else most) or not squared < math.inf:
            break
        if squared < last:
            growth = max(1.0, growth * RELIEF)
        else:
            growth *= GROWTH
        last = squared

        for i in range(n):
            joints[DRIFT, i] = 0.0
        if here and goal[0, 0] != NONE:
            drift_of(goal, chain, q, start, turns, axes, end, jacobian, square, lower, joints)
        if rule == FABRIK and squared > settings[1]:
            step_fabrik(iteration, iteration - marked, chain, box, q, axes, end, moved, joints, errors)
        else:
            jacobian_of(chain, axes, end, jacobian)
            error_jacobian(end, errors, jacobian)
            if squared > SATURATION * SATURATION:
                for i in range(6):
                    errors[RESIDUAL, i] *= SATURATION / math.sqrt(squared)
            _bounded_step(rule, settings, growth, longest, here, box, q, jacobian, rows, square, lower, joints, errors)
        largest = 0.0
        for i in range(n):
            largest = max(largest, abs(joints[STEP, i]))
        if largest <= SMALLEST_STEP or (here and largest <= STILL):
            break
        share = longest / largest if largest > longest else 1.0
        for i in range(n):
            q[i] = _inside(box, i, q[i] + share * joints[STEP, i])
        iteration += 1
    for i in range(n):
        q[i] = joints[BEST, i]
    return reached, iteration, best


@inlined
def _bounded_step(
    rule: int,
    settings: Any,
    growth: float,
    longest: float,
    drifts: bool,
    box: Any,
    q: Any,
    jacobian: Any,
    rows: Any,
    square: Any,
    lower: Any,
    joints: Any,
    errors: Any,
) -> None:
    """The step of the rule within the limits (active set), added to the step of the goal.

    Joints that would leave their limits are moved to them and held. The effect of that motion is added to the residual,
    and the rule is evaluated again for the remaining joints until none leaves its limits.
    """
    n = q.shape[0]
    for i in range(n):
        joints[HELD, i] = 0.0
        joints[MOVED, i] = joints[DRIFT, i]
    for k in range(6):
        errors[PULL, k] = errors[RESIDUAL, k]
    if drifts:
        for i in range(n):
            _take_into_account(i, joints[DRIFT, i], jacobian, errors)
    while True:
        if rule == SINGULAR:
            step_singular(settings[0], settings[1], settings[2], jacobian, rows, square, joints, errors)
        else:
            step_clik(settings[0], growth, longest, jacobian, square, lower, joints, errors)
        _shorten(longest, joints)
        again = False
        for i in range(n):
            if joints[HELD, i] != 0.0:
                joints[STEP, i] = joints[MOVED, i]
                continue
            joints[STEP, i] += joints[MOVED, i]
            there = q[i] + joints[STEP, i]
            if there < box[LOW, i] or there > box[HIGH, i]:
                again = True
                to_limit = min(max(there, box[LOW, i]), box[HIGH, i]) - q[i]
                _take_into_account(i, to_limit - joints[MOVED, i], jacobian, errors)
                joints[HELD, i], joints[MOVED, i] = 1.0, to_limit
                for k in range(6):
                    jacobian[k, i] = 0.0
        if not again:
            return


@inlined
def _shorten(longest: float, joints: Any) -> None:
    """The step of the rule, scaled such that no free joint moves by more than ``longest``.

    It is scaled before the limits are applied: a very long step would hold joints at limits unnecessarily.
    """
    largest = 0.0
    for i in range(joints.shape[1]):
        largest = max(largest, (1.0 - joints[HELD, i]) * abs(joints[STEP, i]))
    if largest > longest:
        for i in range(joints.shape[1]):
            joints[STEP, i] *= longest / largest


@inlined
def _take_into_account(i: int, moved: float, jacobian: Any, errors: Any) -> None:
    """Add the effect of the fixed motion of joint i to the residual."""
    for k in range(6):
        errors[PULL, k] += jacobian[k, i] * moved


@inlined
def _inside(box: Any, i: int, value: float) -> float:
    """Joint i within its limits: shifted by 2 pi if its range permits, else clipped (which only removes rounding)."""
    if box[TURNING, i] != 0.0:
        if value > box[UPPER, i]:
            value -= TURN
        elif value < box[LOWER, i]:
            value += TURN
    return min(max(value, box[LOWER, i]), box[UPPER, i])
