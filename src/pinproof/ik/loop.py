"""The loop that all iterative methods share: seeds, limits, step bounds, stopping, and the two engines that run it.

A method is defined by its :class:`StepRule` alone. One descent repeats::

    compute the residual r and its Jacobian A at q          stop if the task is satisfied and there is no goal
    pass |r|^2 to the rule, and limit |r| to SATURATION
    z = step of the null-space goal, if the task is satisfied, else 0
    step = z + rule(r + A z, A)                             joints that would leave their limits are held at them,
                                                            and the rule is evaluated again for the others
    scale the step to max_step, add it, shift joints with a range of 2 pi back within their limits
    stop if the residual has not decreased enough for some steps

:class:`PinocchioSearch` is the loop on Pinocchio, for user-defined methods and for ``on_step``. The built-in methods
run the same loop in the compiled core (``src/core/ik``); tests compare their iterates.
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
from pinproof.common.structs import described, key
from pinproof.common.validation import Rng, random_generator
from pinproof.errors import InputError
from pinproof.ik.result import TURN, Candidate, judge, nearest_winding, stops, wraps
from pinproof.ik.task import CostGoal, Goal, Task
from pinproof.model import Arm
from pinproof.spatial import SE3, Array, matrix, rigid

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
    shift, root = random_generator(rng).random(arm.dof), 2.0
    for _ in range(64):  # fixed-point iteration; it halves the error at least in each step
        root = (1 + root) ** (1 / (arm.dof + 1))
    steps = root ** -np.arange(1.0, arm.dof + 1)
    lower, upper = arm.limits.sampling_range()
    q = lower + (upper - lower) * ((shift + np.arange(1, COUNT + 1)[:, None] * steps) % 1.0)
    seeds = Seeds(q, CompiledSeeds(arm.chain, q))
    return keep(_SEEDS, arm, rng, seeds, SETS_KEPT) if type(rng) is int else seeds


SATURATION: float = IkSolver.SATURATION
SMALLEST_STEP: float = IkSolver.SMALLEST_STEP
GOAL_CONVERGED: float = IkSolver.GOAL_CONVERGED
GOAL_STEPS: int = IkSolver.GOAL_STEPS

LEAST_SHARE = 1e-4
"""Share of a step for a cost; if even a shorter one increases the cost, it is as small as the task allows."""


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


@described(eq=False)
class IkStep:
    """One step of a descent, as passed to ``on_step``."""

    attempt: int = key("index of the descent; 0 starts at q0")
    iteration: int = key("index of the step, from 0")
    q: Array = key("(n,) the configuration before the step")
    step: Array = key("(n,) the motion of each joint, in rad or m; at most the solver's ``max_step``")
    residual: Array = key(
        "(6,) position error (m) and rotation vector (rad) at q, in the axes of the target; zero in coordinates that "
        "the task does not select"
    )


OnStep = Callable[[IkStep], None]

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
    """The attempts of ``_core.Search``, with Pinocchio's kinematics; ``rule`` makes the step rule of an attempt.

    The first attempt starts at q0 (n,), within or outside the limits, and each ends by the criterion ``stall``.
    """

    def __init__(
        self,
        arm: Arm,
        target: Array,
        task: Task,
        goal: Goal | CostGoal | None,
        seeds: Seeds,
        q0: Array,
        *,
        rule: Callable[[], StepRule],
        stall: Stall,
        max_iterations: int,
        max_step: float,
        on_step: OnStep | None,
    ) -> None:
        self._arm, self._task, self._goal, self._rule, self._on_step = arm, task, goal, rule, on_step
        self._stall, self._max_iterations, self._max_step = stall, max_iterations, max_step
        self._target = rigid("target", target)
        self._matrix = matrix(self._target)
        self._seeds, self._q0 = seeds, arm.limits.snap(q0)
        q0 = self._q0
        self._q = q0 if arm.limits.contains(q0) else arm.limits.clip(nearest_winding(arm, q0, q0))
        self._order: list[int] = seeds.compiled.nearest(task.compiled, self._matrix)
        self._attempts = self._iterations = 0
        self._wraps, (self._low, self._high) = wraps(arm), stops(arm)

    def next(self, count: int, polish: bool) -> Candidate:
        """As :meth:`Search.next`."""
        best, best_squared = None, np.inf
        while self._attempts < count:
            # q0, then a flip of the first result or a seed, then the seeds nearest in pose to the target
            if self._attempts == 1:
                self._q = self._flip_or_seed()
            elif self._attempts > 1:
                self._q = self._seeds.q[self._order.pop(0)]
            squared, reached = self._descend(self._attempts, self._stall)
            self._attempts += 1
            if reached:
                return self._candidate()
            if best is None or squared < best_squared:
                best, best_squared = self._q, squared
        # no attempt satisfied the task: the best one, refined
        if best is not None:
            self._q = best
        if polish:
            self._descend(count - 1, POLISH)
        return self._candidate()

    def _candidate(self) -> Candidate:
        return judge(self._arm, self._matrix, self._task, self._q, self._q0, self._iterations, self._attempts)

    def _flip_or_seed(self) -> Array:
        """The closest in pose to the target among the flips of q (one joint mirrored) and the seeds."""
        arm, q = self._arm, self._q
        lower, upper = arm.limits.lower, arm.limits.upper
        with np.errstate(invalid="ignore"):
            middle = np.where(np.isfinite(upper - lower), (lower + upper) / 2, 0.0)
        flips = [np.where(np.arange(len(q)) == i, 2 * middle - q, q) for i in range(len(q))]
        choice = [self._seeds.q[self._order[0]], *flips]
        distance, spin = self._seeds.compiled.weights(self._task.compiled)
        seen = [self._target.actInv(arm.forward_kinematics(one)) for one in choice]
        away = [float(distance * e.translation @ e.translation - spin * np.trace(e.rotation)) for e in seen]
        best = int(np.argmin(away))
        if best == 0:
            self._order.pop(0)
        return choice[best]

    def _descend(self, attempt: int, stall: Stall) -> tuple[float, bool]:
        """Descend from q within the limits until the task is satisfied or the descent stalls.

        q becomes the best configuration; the result is its squared residual, and whether it satisfies the task.
        """
        arm, task, goal, q = self._arm, self._task, self._goal, self._q
        rule = self._rule()
        if not callable(rule):
            raise InputError(f"step_rule() must return a function of (residual, jacobian), not {rule!r:.80}")
        observe = getattr(rule, "observe", None)
        best_q, best, best_cost, share, reached = q, np.inf, np.inf, 1.0, False
        mark, marked_at, iteration = np.inf, 0, 0
        while True:
            # the residual, and whether q is the best configuration so far
            base_from_tcp, local = arm.local_jacobian(q)
            target_from_tcp = matrix(self._target.actInv(base_from_tcp))
            rotation = target_from_tcp[:3, :3]
            in_target_axes = np.vstack([rotation @ local[:3], rotation @ local[3:]])
            residual, jacobian = task.compiled.residual_and_jacobian(target_from_tcp, in_target_axes)
            squared = float(residual.dot(residual))
            satisfied = task.reached(residual)
            # A step for a cost that increased it, because the solutions are curved, is undone and made half as long.
            if satisfied and isinstance(goal, CostGoal):
                cost = goal.cost(q)
                share = min(2.0 * share, 1.0) if cost <= best_cost else share / 4.0
                if cost > best_cost and share > LEAST_SHARE and iteration < self._max_iterations + GOAL_STEPS:
                    q, iteration = best_q, iteration + 1
                    continue
                if cost > best_cost:
                    break
                best_cost = cost
            if satisfied or (not reached and squared < best):
                best_q, best = q, squared
            reached = reached or satisfied
            if satisfied and goal is None:
                break
            # the end without a solution, or of the improvement of a goal; also if the residual is NaN
            if squared < stall.progress * mark:
                mark, marked_at = squared, iteration
            stalled = iteration - marked_at >= stall.patience and not reached
            most = self._max_iterations + (GOAL_STEPS if reached else 0)
            if stalled or iteration >= most or not squared < np.inf:
                break
            # the step of the rule, for a residual that is not so long that its linearisation means nothing
            if observe is not None:
                observe(DescentState(arm, self._target, task, q, squared, iteration, iteration - marked_at))
            limited = residual if squared <= SATURATION**2 else residual * (SATURATION / np.sqrt(squared))
            goal_step = share * goal.step(arm, q, jacobian) if satisfied and goal is not None else np.zeros(arm.dof)
            step = self._step_within_limits(q, limited, jacobian, goal_step, rule)
            largest = float(np.abs(step).max())
            if largest <= SMALLEST_STEP or (satisfied and largest <= GOAL_CONVERGED):
                break
            if largest > self._max_step:
                step = step * (self._max_step / largest)
            if self._on_step is not None:
                self._on_step(IkStep(attempt, iteration, q.copy(), step.copy(), residual.copy()))
            # joints with a range of 2 pi continue at the other end of it
            q, lower, upper = q + step, arm.limits.lower, arm.limits.upper
            turned = np.where(q > upper, q - TURN, np.where(q < lower, q + TURN, q))
            q = np.clip(np.where(self._wraps, turned, q), lower, upper)
            iteration += 1
        self._q = best_q
        self._iterations += iteration
        return best, reached

    def _step_within_limits(
        self, q: Array, residual: Array, jacobian: Array, goal_step: Array, rule: StepRule
    ) -> Array:
        """The step of the rule within the limits (active set), added to the step of a goal.

        Joints that would leave their limits are moved to them and held. The effect of that motion is added to the
        residual, and the rule is evaluated again for the remaining joints until none leaves its limits.
        """
        held = np.zeros(len(q), dtype=bool)
        fixed, max_step = goal_step, self._max_step
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
