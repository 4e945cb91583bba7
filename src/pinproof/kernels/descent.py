"""The loop that every iterative method shares, compiled; the twin of :mod:`pinproof.ik.loop`, iterate by iterate.

A method is its rule: one of the numbers below, and up to three settings. The box is (5, n), see
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
"""The first setting of ``FABRIK`` is Clik's; its second the squared residual below which Clik's step takes over."""

SATURATION = 1.0
"""Largest norm of the residual (m and rad together) that a step rule is shown; longer ones are shortened to it."""

SMALLEST_STEP = 1e-12
"""A step (rad or m) that no longer changes a pose: the descent stands still."""

STILL = 1e-4
"""A goal counts as followed to its end when no joint moves more than this (rad or m) for it."""

GOAL_STEPS = 300
"""Steps that may follow a goal once the task is fulfilled. A goal is only followed from where it is: its steps leave
the task by their square, and those between them lead back."""


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
    """Descend from q (n,), inside the limits, to where the task is fulfilled.

    The workspace holds target_from_base (start) and what is asked for; q is moved to the best configuration seen.
    ``tolerances`` are in m and rad, ``most`` is the number of steps, ``longest`` the most a joint moves in one. The
    descent has stalled when more than the share ``progress`` of the squared residual is left after ``patience`` steps.
    ``moved`` (m + 2, 12) is the scratch of FABRIK.
    Returns whether the task is fulfilled, the steps taken, and the squared residual.
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
        # Written so that a NaN ends the descent too.
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
    """The rule's step within the limits (active set), after the goal's drift.

    Joints that would leave their limits are moved to them and held; what that does to the residual is taken into
    account, and the rule is asked again for the joints that are left, until none of them leaves.
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
    """The rule's step, shortened until no free joint moves more than ``longest``.

    Before limits are looked at: an endless step near a singularity would pin joints to limits they need not meet.
    """
    largest = 0.0
    for i in range(joints.shape[1]):
        largest = max(largest, (1.0 - joints[HELD, i]) * abs(joints[STEP, i]))
    if largest > longest:
        for i in range(joints.shape[1]):
            joints[STEP, i] *= longest / largest


@inlined
def _take_into_account(i: int, moved: float, jacobian: Any, errors: Any) -> None:
    """What a motion of joint i that is settled does to the residual."""
    for k in range(6):
        errors[PULL, k] += jacobian[k, i] * moved


@inlined
def _inside(box: Any, i: int, value: float) -> float:
    """Joint i inside its limits: a turn away where it can turn, else at the nearest limit (only rounding is cut)."""
    if box[TURNING, i] != 0.0:
        if value > box[UPPER, i]:
            value -= TURN
        elif value < box[LOWER, i]:
            value += TURN
    return min(max(value, box[LOWER, i]), box[UPPER, i])
