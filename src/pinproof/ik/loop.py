"""The loop that every iterative method shares: limits, step bounds, whole turns, stopping and stalls.

A method is its :class:`StepRule`, so that comparing methods compares methods and not loops. One descent::

    measure the residual r and its Jacobian A at q         -> reached? done
    tell the rule |r|^2, saturate r                        far targets pull no harder than near ones
    step = rule(r, A), joints that meet a limit held there, the others asked again
    scale the step to max_step, move, turn whole-turn joints back inside
    no progress for PATIENCE steps                         -> stalled: give the next start a chance
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pinproof.ik.task import Task
from pinproof.ik.windings import TURN
from pinproof.model import Arm
from pinproof.spatial import SE3

__all__ = ["Descent", "IkStep", "StepRule", "descend"]

Array = npt.NDArray[np.float64]

SATURATION = 1.0
"""Largest norm of the residual (m and rad together) that a step rule is shown; longer ones are shortened to it."""

PATIENCE = 10
"""Steps within which the squared residual must fall by PROGRESS; else the descent has stalled."""

PROGRESS = 0.5
"""A descent that converges more than halves its squared residual in PATIENCE steps, even at a singular target."""

SMALLEST_STEP = 1e-12
"""A step (rad or m) that no longer changes a pose: the descent stands still."""


class StepRule(Protocol):
    """A method: from a residual and its Jacobian to a step of the joints. One object serves one descent."""

    def observe(self, squared_residual: float) -> None:
        """Told once before each step what is still to go, unsaturated; for methods that learn from their steps."""

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        """The step (n,) that shall shrink ``residual`` (m,), whose Jacobian is (m, n).

        Columns of joints that are held at a limit are zero; what the rule answers for them is not used.
        """


@dataclass(frozen=True, eq=False)
class IkStep:
    """One step of a descent, for those who watch (``on_step``).

    Parameters
    ----------
    attempt, iteration
        Which descent (0 starts at q0) and which of its steps, both from 0.
    q
        (n,) the configuration the step starts from.
    step
        (n,) how far each joint moves, in rad or m; never more than the solver's ``max_step``.
    residual
        (m,) what is still to go at q: (6,) log6 for a pose, (3,) for a position or an orientation.
    """

    attempt: int
    iteration: int
    q: Array
    step: Array
    residual: Array


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a descent ended: the best configuration it saw, inside limits, and its squared residual."""

    q: Array
    squared_residual: float
    reached: bool
    iterations: int


def descend(
    arm: Arm,
    target: SE3,
    task: Task,
    q: Array,
    rule: StepRule,
    *,
    max_iterations: int,
    max_step: float,
    attempt: int = 0,
    progress: float = PROGRESS,
    on_step: Callable[[IkStep], None] | None = None,
) -> Descent:
    """Descend from q, inside the limits, to a configuration that fulfils the task, or to where progress ends.

    ``progress`` is the part of the squared residual that may remain after PATIENCE steps without a stall being called.
    """
    box = _Box(arm)
    best_q, best = q, np.inf
    mark, marked_at, iteration = np.inf, 0, 0
    while True:
        base_from_tcp, local = arm.local_jacobian(q)
        target_from_tcp = target.actInv(base_from_tcp)
        residual = task.residual(target_from_tcp)
        squared = float(residual.dot(residual))
        if squared < best:
            best_q, best = q, squared
        if task.reached(residual):
            return Descent(q, squared, True, iteration)
        if squared < progress * mark:
            mark, marked_at = squared, iteration
        # Written so that a NaN ends the descent too.
        if iteration - marked_at >= PATIENCE or iteration >= max_iterations or not squared < np.inf:
            return Descent(best_q, best, False, iteration)

        rule.observe(squared)
        pull = residual if squared <= SATURATION**2 else residual * (SATURATION / np.sqrt(squared))
        step = box.step(q, pull, task.jacobian(target_from_tcp, local), rule)
        length = float(step.dot(step))
        if length > max_step**2:  # the norm bounds the largest entry, and is cheaper
            largest = float(np.abs(step).max())
            if largest > max_step:
                step = step * (max_step / largest)
        if length <= SMALLEST_STEP**2:
            return Descent(best_q, best, False, iteration)
        if on_step is not None:
            on_step(IkStep(attempt, iteration, q.copy(), step.copy(), residual.copy()))
        q = box.inside(q + step)
        iteration += 1


class _Box:
    """The limits as a descent meets them.

    A joint that can make a whole turn is not stopped by its limits: beyond one it goes on a turn away, same pose.
    """

    def __init__(self, arm: Arm) -> None:
        limits = arm.limits
        self._turning = arm.periodic & (limits.upper - limits.lower >= TURN)
        self._lower, self._upper = limits.lower, limits.upper
        self._low = np.where(self._turning, -np.inf, limits.lower)
        self._high = np.where(self._turning, np.inf, limits.upper)

    def step(self, q: Array, residual: Array, jacobian: Array, rule: StepRule) -> Array:
        """The rule's step within the limits (active set).

        Joints that would leave their limits are moved to them and held; what that does to the residual is taken into
        account, and the rule is asked again for the joints that are left, until none of them leaves.
        """
        step = rule(residual, jacobian)
        held: npt.NDArray[np.bool_] | None = None
        while True:
            moved = q + step
            outside = (moved < self._low) | (moved > self._high)
            if held is not None:
                outside &= ~held
            if not np.count_nonzero(outside):  # a sixth of the cost of .any()
                return step
            held = outside if held is None else held | outside
            to_limit = np.where(held, np.clip(moved, self._low, self._high) - q, 0.0)
            step = np.where(held, to_limit, rule(residual + jacobian @ to_limit, np.where(held, 0.0, jacobian)))

    def inside(self, q: Array) -> Array:
        """Whole turns taken out, and rounding clipped: q (n,) inside the limits."""
        clipped: Array = np.minimum(np.maximum(q, self._lower), self._upper)
        if not np.count_nonzero(self._turning & (clipped != q)):
            return clipped
        turned = np.where(q > self._upper, q - TURN, q + TURN)
        q = np.where(self._turning & (clipped != q), turned, q)
        return np.minimum(np.maximum(q, self._lower), self._upper)
