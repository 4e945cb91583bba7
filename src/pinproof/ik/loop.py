"""The loop that all iterative methods share: seeds, limits, step bounds, stopping, and the two engines that run it.

A method is defined by its :class:`StepRule` alone. One descent repeats::

    compute the residual r and its Jacobian A at q          stop if the task is satisfied and there is no goal
    pass |r|^2 to the rule, and limit |r| to SATURATION
    z = step of the null-space goal, if the task is satisfied, else 0
    step = z + rule(r + A z, A)                             joints that would leave their limits are held at them,
                                                            and the rule is evaluated again for the others
    scale the step to max_step, add it, shift joints with a range of 2 pi back within their limits
    stop if the residual has not decreased enough for some steps

:func:`descend` is the loop on Pinocchio, for user-defined methods and for ``on_step``. The built-in methods run the
same loop compiled (:mod:`pinproof.kernels.descent`); tests compare their iterates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import Rng, random_generator
from pinproof.ik.task import Task, drift
from pinproof.ik.windings import TURN, turning
from pinproof.model import Arm
from pinproof.spatial import SE3, matrix

__all__ = [
    "CompiledEngine",
    "Descent",
    "DescentState",
    "IkStep",
    "KernelRule",
    "PinocchioEngine",
    "Query",
    "SearchEnd",
    "Seeds",
    "Stall",
    "StepRule",
    "box_of",
    "descend",
    "seeds_of",
]

Array = npt.NDArray[np.float64]

COUNT = 1024
"""Number of seeds of a set. The choice among them takes a microsecond; four times as many cost more than they save."""

SPIN_WEIGHT = 0.4
"""Weight of the rotation in the distance between poses, in units of the variance (m^2) of the positions."""

SETS_KEPT = 4
"""Number of sets that are cached for an arm; computing one takes a quarter of a millisecond."""


@dataclass(frozen=True, eq=False)
class Seeds:
    """Configurations (T, n) within the limits, their poses (12, T) in single precision, and the weight of rotations."""

    q: Array
    poses: npt.NDArray[np.float32]
    spin_weight: float

    def weights(self, mask: Array) -> Array:
        """(2,) the weights of the squared distance and of the trace of the rotation, for a task mask (6,)."""
        if not mask[:3].any():
            return np.array([0.0, 1.0])
        return np.array([1.0, self.spin_weight if mask[3:].all() else 0.0])

    def nearest(self, target: Array, mask: Array) -> npt.NDArray[np.int64]:
        """The indices of the seeds sorted by their distance in pose from a target (4, 4), for the loop on Pinocchio."""
        distance, spin = self.weights(mask).astype(np.float32)
        p = self.poses.reshape(3, 4, -1)
        t = target[:3].astype(np.float32)
        away = ((p[:, 3] - t[:, 3:]) ** 2).sum(axis=0)
        return np.argsort(distance * away - spin * (p[:, :3] * t[:, :3, None]).sum(axis=(0, 1)), kind="stable")


_KEPT: WeakKeyDictionary[Arm, dict[int, Seeds]] = WeakKeyDictionary()


def seeds_of(arm: Arm, rng: Rng | np.random.SeedSequence) -> Seeds:
    """The seeds of an arm within its limits: an additive recurrence, shifted by ``rng``.

    Source: Roberts (2018), "The unreasonable effectiveness of quasirandom sequences": x_k = s + k a mod 1, a_j = g^-j
    with g the root of g^(n + 1) = g + 1; the shift is that of Cranley and Patterson (1976).
    """
    kept = _KEPT.setdefault(arm, {})
    if isinstance(rng, int) and rng in kept:
        return kept[rng]
    seeds = _made(arm, random_generator(rng).random(arm.dof))
    if isinstance(rng, int) and not isinstance(rng, bool):
        while len(kept) >= SETS_KEPT:
            kept.pop(next(iter(kept)), None)
        kept[rng] = seeds
    return seeds


def _made(arm: Arm, shift: Array) -> Seeds:
    from pinproof.kernels.chain import forward_many

    root = 2.0
    for _ in range(64):
        root = (1 + root) ** (1 / (arm.dof + 1))
    steps = root ** -np.arange(1.0, arm.dof + 1)
    lower, upper = arm.limits.sampling_range()
    q = lower + (upper - lower) * ((shift + np.arange(1, COUNT + 1)[:, None] * steps) % 1.0)
    poses = np.empty((COUNT, 4, 4))
    forward_many(arm.packed, q, poses)
    spread = float(poses[:, :3, 3].var(axis=0).sum())
    return Seeds(q, np.ascontiguousarray(poses[:, :3].reshape(COUNT, 12).T, dtype=np.float32), SPIN_WEIGHT * spread)


SATURATION = 1.0
"""Largest norm of the residual (m and rad together) that is passed to a step rule; longer residuals are scaled."""

SMALLEST_STEP = 1e-12
"""Rad or m. A descent stops if its step is at most this, which does not change a pose."""

GOAL_CONVERGED = 1e-4
"""Rad or m. A goal has converged if its step moves no joint by more than this."""

GOAL_STEPS = 300
"""Additional steps for a goal after the task is satisfied. A step of a goal changes the task by the square of its
length only, which the following steps correct."""


NOTHING = 1e-12
"""An entry or a singular value of a Jacobian below this (m or rad) is due to rounding."""


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
    """A method: computes a step of the joints from a residual and its Jacobian. One object serves one descent."""

    def observe(self, here: DescentState) -> None:
        """Called once before each step, for methods that adapt their settings or need q."""

    def __call__(self, residual: Array, jacobian: Array) -> Array:
        """The step (n,) that reduces ``residual`` (6,), whose Jacobian is (6, n).

        Rows that the task does not select are zero, and so are the columns of joints that are held at a limit; the
        components of the step for those joints are ignored.
        """


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
    """Descend from q within the limits until the task is satisfied or the descent stalls.

    ``goal`` is packed (:func:`pinproof.ik.task.packed_goal`).
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
        # The condition on squared also ends the descent if it is NaN.
        if stalled or iteration >= (max_iterations + GOAL_STEPS if reached else max_iterations) or not squared < np.inf:
            break

        rule.observe(DescentState(arm, target, task, q, squared, iteration, iteration - marked_at))
        rotation = target_from_tcp[:3, :3]
        jacobian = task.jacobian(target_from_tcp, np.vstack([rotation @ local[:3], rotation @ local[3:]]))
        pull = residual if squared <= SATURATION**2 else residual * (SATURATION / np.sqrt(squared))
        step = box.step(q, pull, jacobian, drift(goal, arm, q) if here else np.zeros(arm.dof), rule, max_step)
        largest = float(np.abs(step).max())
        if largest <= SMALLEST_STEP or (here and largest <= GOAL_CONVERGED):
            break
        if largest > max_step:
            step = step * (max_step / largest)
        if on_step is not None:
            on_step(IkStep(attempt, iteration, q.copy(), step.copy(), residual.copy()))
        q = box.inside(q + step)
        iteration += 1
    return Descent(best_q, best, reached, iteration)


class _Box:
    """The limits of a descent.

    A joint with a range of at least 2 pi is not stopped by its limits: beyond one it continues 2 pi away.
    """

    def __init__(self, arm: Arm) -> None:
        limits = arm.limits
        self._turning = turning(arm)
        self._lower, self._upper = limits.lower, limits.upper
        self._low = np.where(self._turning, -np.inf, limits.lower)
        self._high = np.where(self._turning, np.inf, limits.upper)

    def step(self, q: Array, residual: Array, jacobian: Array, drift: Array, rule: StepRule, max_step: float) -> Array:
        """The step of the rule within the limits (active set), added to the step of a goal (``drift``).

        Joints that would leave their limits are moved to them and held. The effect of that motion is added to the
        residual, and the rule is evaluated again for the remaining joints until none leaves its limits.
        """
        held = np.zeros(len(q), dtype=bool)
        fixed = drift
        while True:
            change = np.where(held, 0.0, rule(residual + jacobian @ fixed, np.where(held, 0.0, jacobian)))
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
        return np.clip(np.where(self._turning, turned, q), self._lower, self._upper)


OnStep = Callable[[IkStep], None]

KernelRule = tuple[int, tuple[float, float, float]]
"""A compiled step rule: its number in :mod:`pinproof.kernels.descent`, and its settings."""

POLISH = Stall(progress=1 - 1e-6, patience=20)
"""The best failed attempt is continued until its squared residual decreases by less than 1e-6 of it in 20 steps."""


_BOXES: WeakKeyDictionary[Arm, Array] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Query:
    """One IK problem.

    ``start`` (n,) is the caller's q0, within or outside the limits, and ``first`` (n,) the same within them; ``matrix``
    (4, 4) is the target; ``box`` (5, n) are the limits in the form of :func:`box_of`; ``goal`` is packed.
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


class SearchEnd(NamedTuple):
    """The result of a series of attempts: the first that satisfies the task, or the one with the smallest residual."""

    q: Array
    iterations: int
    attempts: int


class CompiledEngine:
    """Runs the attempts in :mod:`pinproof.kernels.search`."""

    name = "compiled"

    def __init__(
        self, rule: KernelRule, tolerances: tuple[float, float], max_iterations: int, max_step: float, stall: Stall
    ) -> None:
        self._rule, self._settings = rule[0], np.array(rule[1], dtype=float)
        self._tolerances = np.array(tolerances, dtype=float)
        self._max_iterations, self._max_step, self._stall = max_iterations, max_step, stall

    def __call__(self, query: Query, *, first: int, count: int, polish: bool) -> SearchEnd:
        """Run the attempts ``first`` to ``count - 1``; if none satisfies the task and ``polish``, refine the best.

        ``attempts`` of the result includes those before ``first``.
        """
        found = self.many(
            query.arm, query.box, query.matrix[None], query.task, query.goal, query.first[None], query.seeds,
            first=first, count=count, polish=polish,
        )  # fmt: skip
        return SearchEnd(found[0][0], int(found[1][0]), int(found[2][0]))

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
        """Solve N targets (N, 4, 4) from N starts (N, n); returns q (N, n), and the numbers of steps and attempts."""
        from pinproof.kernels.search import search

        q, iterations, attempts = np.array(starts), np.empty(len(starts), np.int64), np.empty(len(starts), np.int64)
        search(
            self._rule,
            self._settings,
            arm.packed,
            box,
            self._tolerances,
            task.mask,
            goal,
            np.array([self._max_iterations, self._max_step, count, polish, *self._stall], dtype=float),
            seeds.q,
            seeds.poses,
            seeds.weights(task.mask),
            first,
            np.ascontiguousarray(targets),
            q,
            iterations,
            attempts,
        )
        return q, iterations, attempts


class PinocchioEngine:
    """Runs the same attempts with :func:`descend`."""

    name = "pinocchio"

    def __init__(
        self, rule: Callable[[], StepRule], max_iterations: int, max_step: float, stall: Stall, on_step: OnStep | None
    ) -> None:
        self._rule, self._max_iterations, self._max_step = rule, max_iterations, max_step
        self._stall, self._on_step = stall, on_step

    def __call__(self, query: Query, *, first: int, count: int, polish: bool) -> SearchEnd:
        """As :meth:`CompiledEngine.__call__`."""
        total, nearest, q = 0, None, query.first
        order = query.seeds.nearest(query.matrix, query.task.mask).tolist()
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
            if attempt < first:  # repeated, because the flips start from its result
                continue
            total += descent.iterations
            if descent.reached:
                return SearchEnd(q, total, attempt + 1)
            if nearest is None or descent.squared_residual < nearest.squared_residual:
                nearest = descent
        end = q if nearest is None else nearest.q
        if not polish:
            return SearchEnd(end, total, count)
        descent = self._descend(query, end, count - 1, self._on_step, POLISH)
        return SearchEnd(descent.q, total + descent.iterations, count)

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
        """The closest in pose to the target among the flips of q and the seeds; see :mod:`pinproof.kernels.search`."""
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
        distance, spin = query.seeds.weights(query.task.mask)
        seen = query.target.actInv(query.arm.forward_kinematics(q))
        return float(distance * seen.translation @ seen.translation - spin * np.trace(seen.rotation))


def box_of(arm: Arm) -> Array:
    """The limits (5, n) in the form of :mod:`pinproof.kernels.limits`."""
    box = _BOXES.get(arm)
    if box is None:
        limits, turns = arm.limits, turning(arm)
        stops = np.where(turns, -np.inf, limits.lower), np.where(turns, np.inf, limits.upper)
        box = _BOXES[arm] = np.array([limits.lower, limits.upper, *stops, turns], dtype=float)
    return box
