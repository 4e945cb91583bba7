"""The search that every iterative method shares: starts, restarts, acceptance, and the final check."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.ik.loop import PROGRESS, Descent, IkStep, StepRule, descend
from pinproof.ik.messages import found, not_found, refused, sampled
from pinproof.ik.result import IkBatch, IkResult, IkSolutions, IkStatus
from pinproof.ik.settings import Rng, positive, random_generator, seed_sequence, whole
from pinproof.ik.task import Task, TaskName, make_task
from pinproof.ik.verdict import Candidate, judge
from pinproof.ik.windings import difference, nearest_winding
from pinproof.model import Arm
from pinproof.spatial import SE3, finite, rigid

__all__ = ["IterativeIk"]

Array = npt.NDArray[np.float64]
Accept = Callable[[Array], bool]
OnStep = Callable[[IkStep], None]

SAME_SOLUTION = 1e-3
"""Two solutions whose joints all differ by less (rad or m) are one. At a singular target, poses within 1e-6 of it come
from configurations up to about this far apart."""

POLISH_PROGRESS = 1 - 1e-6
"""A nearest miss is polished until its squared residual falls by less than a millionth in PATIENCE steps."""


@dataclass(frozen=True, kw_only=True)
class IterativeIk(ABC):
    """Settings and search of the iterative methods; a method adds its :meth:`step_rule`.

    Parameters
    ----------
    position_tolerance
        In m. A solution's tcp is at most this far from the target.
    orientation_tolerance
        In rad. A solution's tcp is turned from the target by at most this angle.
    max_iterations
        Steps of one attempt.
    restarts
        Attempts after the first. With those from random starts, a pose that is solved by 4 attempts of 5 is missed
        once in 5^51.
    max_step
        The most a joint moves in one step, in rad or m.

    Raises
    ------
    InputError
        For a setting that makes no sense.
    """

    position_tolerance: float = 1e-6
    orientation_tolerance: float = 1e-6
    max_iterations: int = 100
    restarts: int = 50
    max_step: float = 1.0

    engine: ClassVar[str] = "pinocchio"

    def __post_init__(self) -> None:
        for name in ("position_tolerance", "orientation_tolerance", "max_step"):
            positive(name, getattr(self, name))
        whole("max_iterations", self.max_iterations, 1)
        whole("restarts", self.restarts, 0)

    @abstractmethod
    def step_rule(self, dof: int) -> StepRule:
        """A fresh step rule for one attempt with an arm of ``dof`` joints."""

    def solve(
        self,
        arm: Arm,
        target: SE3 | npt.ArrayLike,
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        task: TaskName = "pose",
        accept: Accept | None = None,
        on_step: OnStep | None = None,
    ) -> IkResult:
        """A configuration of the arm that brings its tcp to the target.

        Parameters
        ----------
        arm
            The arm.
        target
            ``base_from_target``, as ``pin.SE3`` or (4, 4).
        q0
            (n,) where the first attempt starts; by default ``arm.home``. A joint outside its limits starts inside them:
            whole turns away where it is an angle and they do it, else at the nearest limit. Of the whole turns that
            reach the same pose, solutions take the one nearest to q0.
        rng
            Seed or Generator of the random starts of the others.
        task
            ``"pose"``, or only the ``"position"`` or ``"orientation"`` of the target.
        accept
            Called with a copy of each solution (n,): False refuses it, and the search goes on.
        on_step
            Called with every step, for plots and lessons.

        Raises
        ------
        InputError
            For a target that is not rigid, a q0 of wrong shape, an unknown task, an rng that is none.
        """
        query = _Query(arm, rigid("target", target), self._task(task), _start(arm, q0), accept)
        return self._solve(query, random_generator(rng), on_step)

    def solve_batch(
        self,
        arm: Arm,
        targets: npt.ArrayLike | Sequence[SE3],
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        task: TaskName = "pose",
        accept: Accept | None = None,
        threads: int = 1,
    ) -> IkBatch:
        """:meth:`solve` for N targets.

        Parameters
        ----------
        targets
            (N, 4, 4) ``base_from_target``, or a sequence of ``pin.SE3``.
        q0
            (n,) for all targets, or (N, n).
        rng
            Each target draws from a stream of its own, spawned from this: its answer depends on its place in the
            batch, not on the other targets nor on ``threads``.
        threads
            Threads that share the work. (This engine runs under Python's lock and gains nothing from more than one.)

        The others are those of :meth:`solve`.

        Raises
        ------
        InputError
            As :meth:`solve`; names the target.
        """
        goal = self._task(task)
        whole("threads", threads, 1)
        placements = _placements(targets)
        starts = _starts(arm, q0, len(placements))
        streams = seed_sequence(rng).spawn(len(placements))

        def one(index: int) -> IkResult:
            query = _Query(arm, placements[index], goal, starts[index], accept)
            return self._solve(query, random_generator(streams[index]), None)

        if threads == 1:
            results = [one(index) for index in range(len(placements))]
        else:
            with ThreadPoolExecutor(threads) as pool:
                results = list(pool.map(one, range(len(placements))))
        return IkBatch.of(results, arm.dof, self.engine)

    def solve_many(
        self,
        arm: Arm,
        target: SE3 | npt.ArrayLike,
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        count: int = 8,
        attempts: int = 64,
        task: TaskName = "pose",
        accept: Accept | None = None,
    ) -> IkSolutions:
        """Several different solutions, such as elbow up and elbow down, nearest to q0 first.

        A sample: ``attempts`` descents, the first from q0 and the others from random starts, until ``count`` different
        solutions are there. Others may exist. Configurations that differ by whole turns count as one, the one nearest
        to q0; of a redundant arm's continuum, points at least 1e-3 apart in some joint are different.

        Parameters
        ----------
        count
            Solutions after which the search ends.
        attempts
            Descents after which the search ends.

        The others are those of :meth:`solve`.
        """
        whole("count", count, 1)
        whole("attempts", attempts, 1)
        query = _Query(arm, rigid("target", target), self._task(task), _start(arm, q0), accept)
        kept: list[Candidate] = []
        tried = iterations = refusals = 0
        for descent in self._descents(query, random_generator(rng), attempts, None):
            tried, iterations = tried + 1, iterations + descent.iterations
            candidate = query.judge(descent)
            if not candidate.fulfils or any(_same(arm, candidate.q, other.q) for other in kept):
                continue
            if not query.accepts(candidate):
                refusals += 1
                continue
            kept.append(candidate)
            if len(kept) == count:
                break
        kept.sort(key=lambda candidate: float(np.abs(candidate.q - query.start).max()))
        return IkSolutions(
            q=np.array([candidate.q for candidate in kept], dtype=float).reshape(len(kept), arm.dof),
            position_error=np.array([candidate.errors[0] for candidate in kept], dtype=float),
            orientation_error=np.array([candidate.errors[1] for candidate in kept], dtype=float),
            attempts=tried,
            iterations=iterations,
            engine=self.engine,
            message=sampled(len(kept), tried, refusals),
        )

    def _task(self, name: str) -> Task:
        return make_task(name, self.position_tolerance, self.orientation_tolerance)

    def _solve(self, query: _Query, rng: np.random.Generator, on_step: OnStep | None) -> IkResult:
        tried = iterations = refusals = 0
        first_refused: Candidate | None = None
        nearest: Descent | None = None

        def result(status: IkStatus, candidate: Candidate, message: str) -> IkResult:
            return IkResult(status, candidate.q, *candidate.errors, iterations, tried - 1, self.engine, message)

        for descent in self._descents(query, rng, self.restarts + 1, on_step):
            tried, iterations = tried + 1, iterations + descent.iterations
            if nearest is None or descent.squared_residual < nearest.squared_residual:
                nearest = descent
            if not descent.reached:
                continue
            candidate = query.judge(descent)
            if not candidate.fulfils:
                continue
            if query.accepts(candidate):
                return result(IkStatus.FOUND, candidate, found(candidate.errors, iterations, tried - 1))
            refusals += 1
            first_refused = first_refused or candidate
        if first_refused is not None:
            return result(IkStatus.REFUSED, first_refused, refused(refusals, tried))

        # Nothing was reached. The nearest miss stalled on its way; brought to its end, its errors mean something.
        polished = self._descend(
            query, query.start if nearest is None else nearest.q, tried - 1, POLISH_PROGRESS, on_step
        )
        iterations += polished.iterations
        candidate = query.judge(polished)
        if candidate.fulfils:
            if query.accepts(candidate):
                return result(IkStatus.FOUND, candidate, found(candidate.errors, iterations, tried - 1))
            return result(IkStatus.REFUSED, candidate, refused(1, tried))
        message = not_found(query.arm, candidate.q, candidate.errors, iterations, tried)
        return result(IkStatus.NOT_FOUND, candidate, message)

    def _descents(
        self, query: _Query, rng: np.random.Generator, count: int, on_step: OnStep | None
    ) -> Iterator[Descent]:
        """``count`` descents: from the caller's start, then from uniform ones inside the limits."""
        lower, upper = query.arm.limits.sampling_range()
        for attempt in range(count):
            q = query.first() if attempt == 0 else rng.uniform(lower, upper)
            yield self._descend(query, q, attempt, PROGRESS, on_step)

    def _descend(self, query: _Query, q: Array, attempt: int, progress: float, on_step: OnStep | None) -> Descent:
        return descend(
            query.arm,
            query.target,
            query.task,
            q,
            self.step_rule(query.arm.dof),
            max_iterations=self.max_iterations,
            max_step=self.max_step,
            attempt=attempt,
            progress=progress,
            on_step=on_step,
        )


@dataclass(frozen=True, eq=False)
class _Query:
    """One question: which q of the arm brings the tcp to the target, counted from where it starts."""

    arm: Arm
    target: SE3
    task: Task
    start: Array
    accept: Accept | None

    def first(self) -> Array:
        """The start inside the limits: by whole turns where they do it, else at the nearest limit."""
        return self.arm.limits.clip(nearest_winding(self.arm, self.start, self.start))

    def judge(self, descent: Descent) -> Candidate:
        """What the end of a descent is worth."""
        return judge(self.arm, self.target, self.task, descent.q, self.start)

    def accepts(self, candidate: Candidate) -> bool:
        """Whether the caller takes a solution; the callable gets a copy."""
        return self.accept is None or bool(self.accept(candidate.q.copy()))


def _start(arm: Arm, q0: npt.ArrayLike | None) -> Array:
    return arm.home if q0 is None else arm.configuration(q0, "q0")


def _starts(arm: Arm, q0: npt.ArrayLike | None, count: int) -> list[Array]:
    """A start for each of ``count`` targets: one for all, or a row each."""
    if q0 is None or np.ndim(q0) <= 1:
        return [_start(arm, q0)] * count
    return list(finite("q0", q0, (count, arm.dof)))


def _placements(targets: npt.ArrayLike | Sequence[SE3]) -> list[SE3]:
    shape = np.shape(targets) if isinstance(targets, np.ndarray) else None
    if shape is not None and shape[1:] != (4, 4):
        raise InputError(f"targets must have the shape (N, 4, 4); it has {shape}")
    try:
        sequence = list(targets)  # type: ignore[arg-type]  # array-likes that cannot be walked are refused here
    except TypeError as error:
        raise InputError(f"targets must be (N, 4, 4) or a sequence of poses, not {type(targets).__name__}") from error
    return [rigid(f"targets[{index}]", target) for index, target in enumerate(sequence)]


def _same(arm: Arm, a: Array, b: Array) -> bool:
    return bool(np.abs(difference(arm, a, b)).max() < SAME_SOLUTION)
