"""The loop that every iterative method shares: limits, step bounds, whole turns, stopping and stalls.

A method is its :class:`StepRule`, so that comparing methods compares methods and not loops. One descent::

    measure the residual r and its Jacobian A at q         -> reached, and no goal? done
    tell the rule |r|^2, saturate r                        far targets pull no harder than near ones
    z = what a goal wishes for besides, once reached       followed as far as the task leaves it free
    step = z + rule(r + A z, A), joints that meet a limit held there, the others asked again
    scale the step to max_step, move, turn whole-turn joints back inside
    no progress for some steps                             -> stalled: give the next start a chance

This is the loop on Pinocchio, for methods of one's own and for those who watch (``on_step``). The built-in methods run
the same one compiled (:mod:`pinproof.kernels.descent`); tests hold the two equal, iterate by iterate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from pinproof.ik.goal import drift
from pinproof.ik.task import Task
from pinproof.ik.windings import TURN, turning
from pinproof.model import Arm
from pinproof.spatial import SE3, matrix

__all__ = ["Descent", "Here", "IkStep", "Stall", "StepRule", "descend"]

Array = npt.NDArray[np.float64]

SATURATION = 1.0
"""Largest norm of the residual (m and rad together) that a step rule is shown; longer ones are shortened to it."""

SMALLEST_STEP = 1e-12
"""A step (rad or m) that no longer changes a pose: the descent stands still."""

STILL = 1e-4
"""A goal counts as followed to its end when no joint moves more than this (rad or m) for it."""

GOAL_STEPS = 300
"""Steps that may follow a goal once the task is fulfilled. A goal is only followed from where it is: its steps leave
the task by their square, and those between them lead back."""


NOTHING = 1e-12
"""An entry or a singular value of a Jacobian below this (m or rad) is rounding."""


class Stall(NamedTuple):
    """The share of the squared residual that may remain after so many steps, lest a descent has stalled.

    A Newton-like step that converges more than halves it in five, even at a singular target.
    """

    progress: float = 0.5
    patience: int = 5


class Here(NamedTuple):
    """Where a descent stands before a step: what is asked, q (n,), and the squared residual, unsaturated.

    ``waited`` is the number of steps since the squared residual last fell enough (:class:`Stall`).
    """

    arm: Arm
    target: SE3
    task: Task
    q: Array
    squared_residual: float
    iteration: int
    waited: int


class StepRule(Protocol):
    """A method: from a residual and its Jacobian to a step of the joints. One object serves one descent."""

    def observe(self, here: Here) -> None:
        """Told once before each step where the descent stands; for methods that learn from it, or need q."""

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        """The step (n,) that shall shrink ``residual`` (6,), whose Jacobian is (6, n).

        Rows that the task does not ask for are zero. So are the columns of joints that are held at a limit; what the
        rule answers for them is not used.
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
        (6,) what is still to go at q: metres, then rotation vector, in the target's axes; zero where nothing is asked.
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
    goal: Array,
    q: Array,
    rule: StepRule,
    *,
    max_iterations: int,
    max_step: float,
    stall: Stall,
    attempt: int = 0,
    on_step: Callable[[IkStep], None] | None = None,
) -> Descent:
    """Descend from q, inside the limits, to a configuration that fulfils the task, or to where progress ends.

    ``goal`` is packed (:func:`pinproof.ik.goal.packed_goal`). The descent ends where it has stalled.
    """
    box = _Box(arm)
    best_q, best, reached = q, np.inf, False
    mark, marked_at, iteration = np.inf, 0, 0
    while True:
        base_from_tcp, local = arm.local_jacobian(q)
        target_from_tcp = matrix(target.actInv(base_from_tcp))
        residual = task.residual(target_from_tcp)
        squared = float(residual.dot(residual))
        here = task.reached(residual)
        if here or (not reached and squared < best):
            best_q, best = q, squared
        reached = reached or here
        if here and goal[0, 0] == 0.0:
            break
        if squared < stall.progress * mark:
            mark, marked_at = squared, iteration
        stalled = iteration - marked_at >= stall.patience and not reached
        # Written so that a NaN ends the descent too.
        if stalled or iteration >= (max_iterations + GOAL_STEPS if reached else max_iterations) or not squared < np.inf:
            break

        rule.observe(Here(arm, target, task, q, squared, iteration, iteration - marked_at))
        rotation = target_from_tcp[:3, :3]
        jacobian = task.jacobian(target_from_tcp, np.vstack([rotation @ local[:3], rotation @ local[3:]]))
        pull = residual if squared <= SATURATION**2 else residual * (SATURATION / np.sqrt(squared))
        step = box.step(q, pull, jacobian, drift(goal, arm, q) if here else np.zeros(arm.dof), rule, max_step)
        largest = float(np.abs(step).max())
        if largest <= SMALLEST_STEP or (here and largest <= STILL):
            break
        if largest > max_step:
            step = step * (max_step / largest)
        if on_step is not None:
            on_step(IkStep(attempt, iteration, q.copy(), step.copy(), residual.copy()))
        q = box.inside(q + step)
        iteration += 1
    return Descent(best_q, best, reached, iteration)


class _Box:
    """The limits as a descent meets them.

    A joint that can make a whole turn is not stopped by its limits: beyond one it goes on a turn away, same pose.
    """

    def __init__(self, arm: Arm) -> None:
        limits = arm.limits
        self._turning = turning(arm)
        self._lower, self._upper = limits.lower, limits.upper
        self._low = np.where(self._turning, -np.inf, limits.lower)
        self._high = np.where(self._turning, np.inf, limits.upper)

    def step(self, q: Array, residual: Array, jacobian: Array, drift: Array, rule: StepRule, max_step: float) -> Array:
        """The rule's step within the limits (active set), after a goal's drift.

        Joints that would leave their limits are moved to them and held; what that does to the residual is taken into
        account, and the rule is asked again for the joints that are left, until none of them leaves.
        """
        held = np.zeros(len(q), dtype=bool)
        settled = drift
        while True:
            asked = np.where(held, 0.0, rule(residual + jacobian @ settled, np.where(held, 0.0, jacobian)))
            # Before limits are looked at: an endless step would pin joints to limits they need not meet.
            largest = float(np.abs(asked).max())
            asked = asked * (max_step / largest) if largest > max_step else asked
            step = np.where(held, settled, settled + asked)
            moved = q + step
            outside = ((moved < self._low) | (moved > self._high)) & ~held
            if not outside.any():
                return np.asarray(step)
            held = held | outside
            settled = np.where(outside, np.clip(moved, self._low, self._high) - q, settled)

    def inside(self, q: Array) -> Array:
        """Whole turns taken out, and rounding clipped: q (n,) inside the limits."""
        turned = np.where(q > self._upper, q - TURN, np.where(q < self._lower, q + TURN, q))
        return np.clip(np.where(self._turning, turned, q), self._lower, self._upper)
