"""The loop that all iterative methods share: seeds, limits, step bounds, stopping, and the two engines that run it.

A method is defined by its :class:`StepRule` alone. One descent repeats::

    compute the residual r and its Jacobian A at q          stop if the task is satisfied and there is no goal
    pass |r|^2 to the rule, and limit |r| to SATURATION
    z = step of the null-space goal, if the task is satisfied, else 0
    step = z + rule(r + A z, A)                             joints that would leave their limits are held at them,
                                                            and the rule is evaluated again for the others
    scale the step to max_step, add it, shift joints with a range of 2 pi back within their limits
    stop if the residual has not decreased enough for some steps

:class:`Descender` is the loop on Pinocchio, for user-defined methods and for ``on_step``. The built-in methods run the
same loop in the compiled core (``src/core/ik``); tests compare their iterates.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from pinproof._core import Candidate as CompiledCandidate
from pinproof._core import ClikStep, FabrikStep, IkSolver, SingularStep
from pinproof._core import Search as CompiledSearch
from pinproof._core import Seeds as CompiledSeeds
from pinproof.common.validation import Rng, random_generator
from pinproof.errors import InputError
from pinproof.ik.result import Candidate, judge
from pinproof.ik.task import Goal, Task
from pinproof.ik.windings import TURN, nearest_winding, stops, wraps
from pinproof.model import Arm
from pinproof.spatial import SE3, Array, matrix

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")

COUNT = 1024
"""Number of seeds of a set. The choice among them takes a microsecond; four times as many cost more than they save."""

SETS_KEPT = 4
"""Number of sets that are cached for an arm."""


@dataclass(frozen=True, eq=False)
class Seeds:
    """Configurations (T, n) within the limits, and the same with their poses for the compiled core."""

    q: Array
    compiled: CompiledSeeds


def keep(cache: WeakKeyDictionary[Arm, dict[Key, Value]], arm: Arm, key: Key, value: Value, most: int) -> Value:
    """Add a value to the cache, which keeps the last ``most`` values of each arm, and return it."""
    values = cache.setdefault(arm, {})
    while len(values) >= most:
        values.pop(next(iter(values)), None)
    values[key] = value
    return value


_SEEDS: WeakKeyDictionary[Arm, dict[int, Seeds]] = WeakKeyDictionary()


def seeds_of(arm: Arm, rng: Rng | np.random.SeedSequence) -> Seeds:
    """The seeds of an arm within its limits: an additive recurrence, shifted by ``rng``.

    Source: Roberts (2018), "The unreasonable effectiveness of quasirandom sequences": x_k = s + k a mod 1, a_j = g^-j
    with g the root of g^(n + 1) = g + 1; the shift is that of Cranley and Patterson (1976).
    """
    if type(rng) is int and (found := _SEEDS.get(arm, {}).get(rng)) is not None:
        return found
    seeds = _quasirandom_seeds(arm, random_generator(rng).random(arm.dof))
    return keep(_SEEDS, arm, rng, seeds, SETS_KEPT) if type(rng) is int else seeds


def _quasirandom_seeds(arm: Arm, shift: Array) -> Seeds:
    root = 2.0
    for _ in range(64):
        root = (1 + root) ** (1 / (arm.dof + 1))
    steps = root ** -np.arange(1.0, arm.dof + 1)
    lower, upper = arm.limits.sampling_range()
    q = lower + (upper - lower) * ((shift + np.arange(1, COUNT + 1)[:, None] * steps) % 1.0)
    return Seeds(q, CompiledSeeds(arm.chain, q))


NOTHING: float = SingularStep.NOTHING
SATURATION: float = IkSolver.SATURATION
SMALLEST_STEP: float = IkSolver.SMALLEST_STEP
GOAL_CONVERGED: float = IkSolver.GOAL_CONVERGED
GOAL_STEPS: int = IkSolver.GOAL_STEPS


class Stall(NamedTuple):
    """The stall criterion: the squared residual must fall below the fraction ``progress`` within ``patience`` steps.

    Newton-like steps that converge more than halve it in five steps, even at a singular target.
    """

    progress: float = 0.5
    patience: int = 5


class DescentState(NamedTuple):
    """The state of a descent before a step: the problem, q (n,), and the squared residual before saturation.

    ``waited`` is the number of steps since the last sufficient decrease of the squared residual (:class:`Stall`).
    """

    arm: Arm
    target: SE3
    task: Task
    q: Array
    squared_residual: float
    iteration: int
    waited: int


class StepRule(Protocol):
    """A method: computes a step of the joints from a residual and its Jacobian. One object serves one descent.

    Any function is a step rule. If it has a method ``observe`` (:class:`ObservingRule`), that is called before each
    step.
    """

    def __call__(self, residual: Array, jacobian: Array, /) -> Array:
        """The step (n,) that reduces ``residual`` (6,), whose Jacobian is (6, n).

        Rows that the task does not select are zero, and so are the columns of joints that are held at a limit; the
        components of the step for those joints are ignored.
        """


class ObservingRule(StepRule, Protocol):
    """A step rule that adapts its settings, or needs q."""

    def observe(self, here: DescentState) -> None:
        """Called once before each step."""


@dataclass(frozen=True, eq=False)
class IkStep:
    """One step of a descent, as passed to ``on_step``.

    Parameters
    ----------
    attempt, iteration
        Index of the descent (0 starts at q0) and index of the step, both from 0.
    q
        (n,) the configuration before the step.
    step
        (n,) the motion of each joint, in rad or m; at most the solver's ``max_step``.
    residual
        (6,) position error (m) and rotation vector (rad) at q, in the axes of the target; zero in coordinates that the
        task does not select.
    """

    attempt: int
    iteration: int
    q: Array
    step: Array
    residual: Array


@dataclass(frozen=True, eq=False)
class Descent:
    """The result of a descent: the best configuration within the limits, and its squared residual."""

    q: Array
    squared_residual: float
    reached: bool
    iterations: int


OnStep = Callable[[IkStep], None]


@dataclass(frozen=True, eq=False)
class Descender:
    """The loop on Pinocchio for an arm, a target, a task and a method.

    Parameters
    ----------
    arm, target, task, goal
        The problem.
    rule
        Makes the step rule of one attempt.
    max_iterations, max_step
        The settings of :class:`~pinproof.ik.iterative.IterativeIk`.
    on_step
        Called with every step.
    """

    arm: Arm
    target: SE3
    task: Task
    goal: Goal | None
    rule: Callable[[], StepRule]
    max_iterations: int
    max_step: float
    on_step: OnStep | None

    def descend(self, q: Array, stall: Stall, attempt: int) -> Descent:
        """Descend from q (n,) within the limits until the task is satisfied or the descent stalls."""
        arm, task, goal, rule = self.arm, self.task, self.goal, self.rule()
        if not callable(rule):
            raise InputError(f"step_rule() must return a function of (residual, jacobian), not {rule!r:.80}")
        observe = getattr(rule, "observe", None)
        box = _LimitBox(arm)
        best_q, best, reached = q, np.inf, False
        mark, marked_at, iteration = np.inf, 0, 0
        while True:
            base_from_tcp, local = arm.local_jacobian(q)
            target_from_tcp = matrix(self.target.actInv(base_from_tcp))
            residual = task.residual(target_from_tcp)
            squared = float(residual.dot(residual))
            satisfied = task.reached(residual)
            if satisfied or (not reached and squared < best):
                best_q, best = q, squared
            reached = reached or satisfied
            if satisfied and goal is None:
                break
            if squared < stall.progress * mark:
                mark, marked_at = squared, iteration
            stalled = iteration - marked_at >= stall.patience and not reached
            # The condition on squared also ends the descent if it is NaN.
            most = self.max_iterations + (GOAL_STEPS if reached else 0)
            if stalled or iteration >= most or not squared < np.inf:
                break

            if observe is not None:
                observe(DescentState(arm, self.target, task, q, squared, iteration, iteration - marked_at))
            rotation = target_from_tcp[:3, :3]
            jacobian = task.jacobian(target_from_tcp, np.vstack([rotation @ local[:3], rotation @ local[3:]]))
            limited = residual if squared <= SATURATION**2 else residual * (SATURATION / np.sqrt(squared))
            goal_step = goal.step(arm, q) if satisfied and goal is not None else np.zeros(arm.dof)
            step = box.step(q, limited, jacobian, goal_step, rule, self.max_step)
            largest = float(np.abs(step).max())
            if largest <= SMALLEST_STEP or (satisfied and largest <= GOAL_CONVERGED):
                break
            if largest > self.max_step:
                step = step * (self.max_step / largest)
            if self.on_step is not None:
                self.on_step(IkStep(attempt, iteration, q.copy(), step.copy(), residual.copy()))
            q = box.inside(q + step)
            iteration += 1
        return Descent(best_q, best, reached, iteration)


class _LimitBox:
    """The limits of a descent.

    A joint with a range of at least 2 pi is not stopped by its limits: beyond one it continues 2 pi away.
    """

    def __init__(self, arm: Arm) -> None:
        limits = arm.limits
        self._wraps = wraps(arm)
        self._lower, self._upper = limits.lower, limits.upper
        self._low, self._high = stops(arm)

    def step(
        self, q: Array, residual: Array, jacobian: Array, goal_step: Array, rule: StepRule, max_step: float
    ) -> Array:
        """The step of the rule within the limits (active set), added to the step of a goal (``goal_step``).

        Joints that would leave their limits are moved to them and held. The effect of that motion is added to the
        residual, and the rule is evaluated again for the remaining joints until none leaves its limits.
        """
        held = np.zeros(len(q), dtype=bool)
        fixed = goal_step
        while True:
            stated = rule(residual + jacobian @ fixed, np.where(held, 0.0, jacobian))
            if np.shape(stated) != np.shape(q):
                raise InputError(f"a step rule must return a step ({len(q)},), not {stated!r:.80}")
            change = np.where(held, 0.0, stated)
            # Scaled before the limits are applied: a very long step would hold joints at limits unnecessarily.
            largest = float(np.abs(change).max())
            change = change * (max_step / largest) if largest > max_step else change
            step = np.where(held, fixed, fixed + change)
            moved = q + step
            outside = ((moved < self._low) | (moved > self._high)) & ~held
            if not outside.any():
                return np.asarray(step)
            held = held | outside
            fixed = np.where(outside, np.clip(moved, self._low, self._high) - q, fixed)

    def inside(self, q: Array) -> Array:
        """Q (n,) shifted by 2 pi where possible, and clipped, to be within the limits."""
        turned = np.where(q > self._upper, q - TURN, np.where(q < self._lower, q + TURN, q))
        return np.clip(np.where(self._wraps, turned, q), self._lower, self._upper)


CompiledRule: TypeAlias = ClikStep | SingularStep | FabrikStep
"""A step rule of the compiled core."""

POLISH = Stall(progress=CompiledSearch.POLISH_PROGRESS, patience=CompiledSearch.POLISH_PATIENCE)
"""The best failed attempt is continued until its squared residual decreases by less than 1e-6 of it in 20 steps."""


AnyCandidate = Candidate | CompiledCandidate
"""A candidate of the loop on Pinocchio, or of the compiled core; both have the same attributes."""


class Search(Protocol):
    """The attempts for one target: an instance of ``_core.Search`` or of :class:`PinocchioSearch`."""

    def next(self, count: int, polish: bool) -> AnyCandidate:
        """Make attempts until one satisfies the task, or until there are ``count`` for this target.

        Without a solution, the result is the best attempt of this call, refined if ``polish``.
        """


class PinocchioSearch:
    """The same attempts as those of ``_core.Search``, by a :class:`Descender`.

    The first attempt starts at q0 (n,), within or outside the limits, and each ends by the criterion ``stall``.
    """

    def __init__(self, descender: Descender, seeds: Seeds, q0: Array, stall: Stall) -> None:
        arm = descender.arm
        self._descender, self._seeds, self._stall = descender, seeds, stall
        self._q0 = q0 = arm.limits.snap(q0)
        self._q = q0 if arm.limits.contains(q0) else arm.limits.clip(nearest_winding(arm, q0, q0))
        self._matrix = matrix(descender.target)
        self._order: list[int] = seeds.compiled.nearest(descender.task.compiled, self._matrix)
        self._attempts = self._iterations = 0

    def next(self, count: int, polish: bool) -> Candidate:
        """As :meth:`Search.next`."""
        best: Descent | None = None
        while self._attempts < count:
            if self._attempts == 1:
                self._q = self._flip_or_seed()
            elif self._attempts > 1:
                self._q = self._seeds.q[self._order.pop(0)]
            descent = self._descend(self._attempts, self._stall)
            self._attempts += 1
            if descent.reached:
                return self._candidate()
            if best is None or descent.squared_residual < best.squared_residual:
                best = descent
        if best is not None:
            self._q = best.q
        if polish:
            self._descend(count - 1, POLISH)
        return self._candidate()

    def _descend(self, attempt: int, stall: Stall) -> Descent:
        descent = self._descender.descend(self._q, stall, attempt)
        self._q = descent.q
        self._iterations += descent.iterations
        return descent

    def _candidate(self) -> Candidate:
        arm, task = self._descender.arm, self._descender.task
        return judge(arm, self._matrix, task, self._q, self._q0, self._iterations, self._attempts)

    def _flip_or_seed(self) -> Array:
        """The closest in pose to the target among the flips of q (one joint mirrored) and the seeds."""
        limits, q = self._descender.arm.limits, self._q
        with np.errstate(invalid="ignore"):
            middle = np.where(np.isfinite(limits.upper - limits.lower), (limits.lower + limits.upper) / 2, 0.0)
        flips = [np.where(np.arange(len(q)) == i, 2 * middle - q, q) for i in range(len(q))]
        choice = [self._seeds.q[self._order[0]], *flips]
        best = int(np.argmin([self._away(one) for one in choice]))
        if best == 0:
            self._order.pop(0)
        return choice[best]

    def _away(self, q: Array) -> float:
        problem = self._descender
        distance, spin = self._seeds.compiled.weights(problem.task.compiled)
        seen = problem.target.actInv(problem.arm.forward_kinematics(q))
        return float(distance * seen.translation @ seen.translation - spin * np.trace(seen.rotation))
