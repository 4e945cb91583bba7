"""What makes the attempts of a search: compiled loops, or the same loop on Pinocchio for those who watch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from pinproof.ik.loop import Descent, IkStep, Stall, StepRule, descend
from pinproof.ik.seeds import Seeds
from pinproof.ik.task import Task
from pinproof.ik.windings import turning
from pinproof.model import Arm
from pinproof.spatial import SE3

__all__ = ["CompiledEngine", "Ended", "KernelRule", "PinocchioEngine", "Query", "box_of"]

Array = npt.NDArray[np.float64]
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
