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

What makes the attempts of a search: compiled loops, or the same loop on Pinocchio for those who watch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from pinproof.ik.seeds import Seeds
from pinproof.ik.task import Task, drift
from pinproof.ik.windings import TURN, turning
from pinproof.model import Arm
from pinproof.spatial import SE3, matrix

__all__ = [
    "CompiledEngine",
    "Descent",
    "Ended",
    "Here",
    "IkStep",
    "KernelRule",
    "PinocchioEngine",
    "Query",
    "Stall",
    "StepRule",
    "box_of",
    "descend",
]

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

    ``goal`` is packed (:func:`pinproof.ik.task.packed_goal`). The descent ends where it has stalled.
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


OnStep = Callable[[IkStep], None]

KernelRule = tuple[int, tuple[float, float, float]]
"""A compiled method: its number in :mod:`pinproof.kernels.descent`, and its settings."""

POLISH = Stall(progress=1 - 1e-6, patience=20)
"""A nearest miss is polished until its squared residual falls by less than a millionth in so many steps."""


_BOXES: WeakKeyDictionary[Arm, Array] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Query:
    """One question: which q of the arm brings the tcp to the target, from where, with which wish besides.

    ``start`` (n,) is the caller's q0, in or outside the limits; ``first`` (n,) the same inside them; ``matrix`` (4, 4)
    the target once more; ``box`` (5, n) the limits as kernels read them.
    """

    arm: Arm
    box: Array
    target: SE3
    matrix: Array
    task: Task
    goal: Array
    start: Array
    first: Array
    seeds: Seeds


class Ended(NamedTuple):
    """How a run of attempts ended: at the first that reached the task, or with the nearest of all."""

    q: Array
    iterations: int
    attempts: int


class CompiledEngine:
    """Attempts in :mod:`pinproof.kernels.search`."""

    name = "compiled"

    def __init__(
        self, rule: KernelRule, tolerances: tuple[float, float], max_iterations: int, max_step: float, stall: Stall
    ) -> None:
        self._rule, self._settings = rule[0], np.array(rule[1], dtype=float)
        self._tolerances = np.array(tolerances, dtype=float)
        self._max_iterations, self._max_step, self._stall = max_iterations, max_step, stall

    def __call__(self, query: Query, *, first: int, count: int, polish: bool) -> Ended:
        """Attempts number ``first`` and on, ``count`` in all; the nearest is polished if none reaches the task.

        ``attempts`` of the end counts those before ``first`` too.
        """
        found = self.many(
            query.arm, query.box, query.matrix[None], query.task, query.goal, query.first[None], query.seeds,
            first=first, count=count, polish=polish,
        )  # fmt: skip
        return Ended(found[0][0], int(found[1][0]), int(found[2][0]))

    def many(
        self,
        arm: Arm,
        box: Array,
        targets: Array,
        task: Task,
        goal: Array,
        starts: Array,
        seeds: Seeds,
        *,
        first: int = 0,
        count: int,
        polish: bool = True,
    ) -> tuple[Array, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """N targets (N, 4, 4) from N starts (N, n): where each ended, the steps and the attempts it took."""
        from pinproof.kernels.search import search

        q, iterations, attempts = np.array(starts), np.empty(len(starts), np.int64), np.empty(len(starts), np.int64)
        search(
            self._rule,
            self._settings,
            arm.packed,
            box,
            self._tolerances,
            task.asked,
            goal,
            np.array([self._max_iterations, self._max_step, count, polish, *self._stall], dtype=float),
            seeds.q,
            seeds.poses,
            seeds.weights(task.asked),
            first,
            np.ascontiguousarray(targets),
            q,
            iterations,
            attempts,
        )
        return q, iterations, attempts


class PinocchioEngine:
    """The same attempts in :mod:`pinproof.ik.loop`."""

    name = "pinocchio"

    def __init__(
        self, rule: Callable[[], StepRule], max_iterations: int, max_step: float, stall: Stall, on_step: OnStep | None
    ) -> None:
        self._rule, self._max_iterations, self._max_step = rule, max_iterations, max_step
        self._stall, self._on_step = stall, on_step

    def __call__(self, query: Query, *, first: int, count: int, polish: bool) -> Ended:
        """As the compiled one."""
        total, nearest, q = 0, None, query.first
        order = query.seeds.nearest(query.matrix, query.task.asked).tolist()
        for attempt in range(count):
            if attempt == 1:
                q = self._flip_or_seed(query, q, order)
            elif attempt > 1:
                q = query.seeds.q[order.pop(0)]
            if 0 < attempt < first:
                continue
            watched = self._on_step if attempt >= first else None
            descent = self._descend(query, q, attempt, watched, self._stall)
            q = descent.q
            if attempt < first:  # made again, since the flips begin where it ended
                continue
            total += descent.iterations
            if descent.reached:
                return Ended(q, total, attempt + 1)
            if nearest is None or descent.squared_residual < nearest.squared_residual:
                nearest = descent
        end = q if nearest is None else nearest.q
        if not polish:
            return Ended(end, total, count)
        descent = self._descend(query, end, count - 1, self._on_step, POLISH)
        return Ended(descent.q, total + descent.iterations, count)

    def _descend(self, query: Query, q: Array, attempt: int, on_step: OnStep | None, stall: Stall) -> Descent:
        return descend(
            query.arm,
            query.target,
            query.task,
            query.goal,
            q,
            self._rule(),
            max_iterations=self._max_iterations,
            max_step=self._max_step,
            stall=stall,
            attempt=attempt,
            on_step=on_step,
        )

    def _flip_or_seed(self, query: Query, q: Array, order: list[int]) -> Array:
        """The nearest in pose of the flips of q and of the seeds; see :mod:`pinproof.kernels.search`."""
        limits = query.arm.limits
        with np.errstate(invalid="ignore"):
            middle = np.where(np.isfinite(limits.upper - limits.lower), (limits.lower + limits.upper) / 2, 0.0)
        flips = [np.where(np.arange(len(q)) == i, 2 * middle - q, q) for i in range(len(q))]
        choice = [query.seeds.q[order[0]], *flips]
        best = int(np.argmin([self._away(query, one) for one in choice]))
        if best == 0:
            order.pop(0)
        return choice[best]

    def _away(self, query: Query, q: Array) -> float:
        distance, spin = query.seeds.weights(query.task.asked)
        seen = query.target.actInv(query.arm.forward_kinematics(q))
        return float(distance * seen.translation @ seen.translation - spin * np.trace(seen.rotation))


def box_of(arm: Arm) -> Array:
    """The limits as kernels read them (5, n): see :mod:`pinproof.kernels.limits`."""
    box = _BOXES.get(arm)
    if box is None:
        limits, turns = arm.limits, turning(arm)
        stops = np.where(turns, -np.inf, limits.lower), np.where(turns, np.inf, limits.upper)
        box = _BOXES[arm] = np.array([limits.lower, limits.upper, *stops, turns], dtype=float)
    return box
