"""The base class of the iterative methods: settings, restarts, acceptance, and the final check."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Literal, get_args

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import Rng, require_integer, require_positive
from pinproof.errors import InputError, UnknownNameError
from pinproof.ik.loop import (
    CompiledEngine,
    KernelRule,
    OnStep,
    PinocchioEngine,
    Query,
    Stall,
    StepRule,
    box_of,
    seeds_of,
)
from pinproof.ik.result import (
    STATUSES,
    Candidate,
    IkBatch,
    IkResult,
    IkSolutions,
    IkStatus,
    found,
    judge,
    judge_many,
    not_found,
    refused,
    sampled,
)
from pinproof.ik.task import GoalName, IkGoal, IkTask, Task, TaskName, make_task, packed_goal
from pinproof.ik.windings import difference, nearest_winding
from pinproof.model import Arm
from pinproof.spatial import SE3, finite, matrix, rigid, rigid_many

__all__ = ["IterativeIk", "KernelRule"]

Array = npt.NDArray[np.float64]
Accept = Callable[[Array], bool]
EngineName = Literal["auto", "compiled", "pinocchio"]
TaskLike = TaskName | IkTask | Sequence[bool]

SAME_SOLUTION = 1e-3
"""Solutions whose joints all differ by less (rad or m) count as one. At a singular target, configurations up to about
this far apart have poses within 1e-6 of each other."""


@dataclass(frozen=True, kw_only=True)
class IterativeIk(ABC):
    """Base class of the iterative methods: settings and search. A method implements :meth:`step_rule`.

    Parameters
    ----------
    position_tolerance
        Largest distance in m between the tcp and the target for a solution.
    orientation_tolerance
        Largest angle in rad between the orientations of tcp and target for a solution.
    max_iterations
        Maximum number of steps of one attempt.
    restarts
        Maximum number of attempts after the first. The first attempt starts at q0. The second starts at the
        configuration closest in pose to the target among the flips of the first result (one joint mirrored about the
        middle of its range) and a low-discrepancy set within the limits; the others start at the closest of that set.
    max_step
        Largest motion of a joint in one step, in rad or m.
    engine
        ``"compiled"``; ``"pinocchio"``, which computes the same iterates with Pinocchio's kinematics about a hundred
        times slower; or ``"auto"``: compiled, unless ``on_step`` is given or the method has no compiled rule.

    Raises
    ------
    InputError
        If a setting is invalid.
    """

    position_tolerance: float = 1e-6
    orientation_tolerance: float = 1e-6
    max_iterations: int = 100
    restarts: int = 50
    max_step: float = 1.0
    engine: EngineName = "auto"

    stall: ClassVar[Stall] = Stall()
    """The criterion for ending an attempt of this method early."""

    def __post_init__(self) -> None:
        for name in ("position_tolerance", "orientation_tolerance", "max_step"):
            require_positive(name, getattr(self, name))
        require_integer("max_iterations", self.max_iterations, 1)
        require_integer("restarts", self.restarts, 0)
        if self.engine not in get_args(EngineName):
            raise UnknownNameError("engine", self.engine, get_args(EngineName))

    @abstractmethod
    def step_rule(self) -> StepRule:
        """A fresh step rule for one attempt."""

    def check(self, arm: Arm, task: Task, goal: GoalName | IkGoal | None) -> None:  # noqa: B027 - most do it all
        """Reject arms, tasks and goals that the method does not support; by default none.

        Raises
        ------
        InputError
            If one is not supported; the message names the alternatives.
        """

    def kernel_rule(self) -> KernelRule | None:
        """The compiled form of the step rule, or None if the method has none."""
        return None

    def solve(
        self,
        arm: Arm,
        target: SE3 | npt.ArrayLike,
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        task: TaskLike = "pose",
        accept: Accept | None = None,
        goal: GoalName | IkGoal | None = None,
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
            (n,) start of the first attempt; by default ``arm.home``. A joint outside its limits is shifted by multiples
            of 2 pi if that brings it within them, else clipped. Among the rotations by 2 pi that reach the same pose,
            a solution uses the one closest to q0.
        rng
            Seed or Generator that shifts the set of starts of the other attempts.
        task
            ``"pose"``, ``"position"``, ``"orientation"``; ``"spin_z"`` (or x, y), the pose with a free rotation about
            that axis of the target; or an :class:`IkTask` with any of the six coordinates.
        accept
            Called with a copy of each solution (n,). If it returns False, the search continues.
        goal
            Null-space objective for the degrees of freedom that the task leaves: ``"centre"`` (middle of the joint
            ranges), ``"near"`` (close to q0), ``"manipulability"``, or an :class:`IkGoal`.
        on_step
            Called with every step, for example for plots.

        Raises
        ------
        InputError
            If the target is not rigid, q0 has the wrong shape, the task or goal is unknown, or rng is invalid.
        """
        placement, start = rigid("target", target), _start(arm, q0)
        engine = self._engine(on_step)
        return self._solve(engine, self._query(arm, placement, start, rng, task, goal), accept)

    def solve_batch(
        self,
        arm: Arm,
        targets: npt.ArrayLike | Sequence[SE3],
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        task: TaskLike = "pose",
        accept: Accept | None = None,
        goal: GoalName | IkGoal | None = None,
        threads: int = 1,
    ) -> IkBatch:
        """:meth:`solve` for N targets.

        The other parameters are those of :meth:`solve`.

        Parameters
        ----------
        targets
            (N, 4, 4) ``base_from_target``, or a sequence of ``pin.SE3``.
        q0
            (n,) for all targets, or (N, n).
        threads
            Number of threads. A result does not depend on it, nor on the other targets.

        Raises
        ------
        InputError
            As :meth:`solve`; the message names the target.
        """
        require_integer("threads", threads, 1)
        many = rigid_many("targets", targets)
        starts = _starts(arm, q0, len(many))
        engine = self._engine(None)
        if accept is not None or not isinstance(engine, CompiledEngine):

            def one(index: int) -> IkResult:
                query = self._query(arm, rigid("target", many[index]), starts[index], rng, task, goal)
                return self._solve(engine, query, accept)

            with ThreadPoolExecutor(threads) as pool:
                return IkBatch.of(list(pool.map(one, range(len(many)))), arm, engine.name)

        resolved = make_task(task, self.position_tolerance, self.orientation_tolerance)
        self.check(arm, resolved, goal)
        packed, seeds = packed_goal(goal, arm, arm.home), seeds_of(arm, rng)
        box = box_of(arm)
        firsts = arm.limits.clip(nearest_winding(arm, starts, starts))

        def share(rows: slice) -> tuple[npt.NDArray[np.generic], ...]:
            q, iterations, attempts = engine.many(
                arm, box, many[rows], resolved, packed, firsts[rows], seeds, count=self.restarts + 1
            )
            return (*judge_many(arm, many[rows], resolved, q, starts[rows]), iterations, attempts)

        cuts = np.linspace(0, len(many), threads + 1).astype(int)
        with ThreadPoolExecutor(threads) as pool:
            shares = list(pool.map(share, [slice(a, b) for a, b in pairwise(cuts.tolist())]))
        q, errors, ok, iterations, attempts = (np.concatenate(part) for part in zip(*shares, strict=True))
        codes = np.where(ok, STATUSES.index(IkStatus.FOUND), STATUSES.index(IkStatus.NOT_FOUND)).astype(np.int8)
        return IkBatch(q, codes, errors[:, 0], errors[:, 1], iterations, attempts - 1, engine.name, arm)

    def solve_many(
        self,
        arm: Arm,
        target: SE3 | npt.ArrayLike,
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        count: int = 8,
        attempts: int = 64,
        task: TaskLike = "pose",
        accept: Accept | None = None,
    ) -> IkSolutions:
        """Several distinct solutions, such as elbow up and elbow down, sorted by distance from q0.

        The result is a sample: descents from q0 and from a set of starts are made until ``count`` distinct solutions
        are found. Others may exist. Configurations that differ by multiples of 2 pi count as one, the one closest to
        q0. For a redundant arm, configurations that differ by at least 1e-3 in some joint are distinct.

        The other parameters are those of :meth:`solve`.

        Parameters
        ----------
        count
            Number of solutions after which the search ends.
        attempts
            Number of descents after which the search ends.
        """
        require_integer("count", count, 1)
        require_integer("attempts", attempts, 1)
        query = self._query(arm, rigid("target", target), _start(arm, q0), rng, task, None)
        engine = self._engine(None)
        kept: list[Candidate] = []
        tried = iterations = refusals = 0
        while tried < attempts and len(kept) < count:
            end = engine(query, first=tried, count=attempts, polish=False)
            tried, iterations = end.attempts, iterations + end.iterations
            candidate = judge(arm, query.matrix, query.task, end.q, query.start)
            if not candidate.fulfils or any(_same(arm, candidate.q, other.q) for other in kept):
                continue
            if not _accepts(accept, candidate):
                refusals += 1
                continue
            kept.append(candidate)
        kept.sort(key=lambda candidate: float(np.abs(candidate.q - query.start).max()))
        return IkSolutions(
            q=np.array([candidate.q for candidate in kept], dtype=float).reshape(len(kept), arm.dof),
            position_error=np.array([candidate.errors[0] for candidate in kept], dtype=float),
            orientation_error=np.array([candidate.errors[1] for candidate in kept], dtype=float),
            attempts=tried,
            iterations=iterations,
            engine=engine.name,
            message=sampled(len(kept), tried, refusals),
        )

    def _engine(self, on_step: OnStep | None) -> CompiledEngine | PinocchioEngine:
        rule = self.kernel_rule() if self.engine != "pinocchio" and on_step is None else None
        if rule is None:
            if self.engine == "compiled":
                why = (
                    "on_step requires the loop on Pinocchio"
                    if on_step is not None
                    else "this method has no compiled rule"
                )
                raise InputError(f"engine='compiled' is not available: {why}; use engine='auto'")
            return PinocchioEngine(self.step_rule, self.max_iterations, self.max_step, self.stall, on_step)
        tolerances = self.position_tolerance, self.orientation_tolerance
        return CompiledEngine(rule, tolerances, self.max_iterations, self.max_step, self.stall)

    def _query(
        self, arm: Arm, target: SE3, start: Array, rng: Rng, task: TaskLike, goal: GoalName | IkGoal | None
    ) -> Query:
        resolved: Task = make_task(task, self.position_tolerance, self.orientation_tolerance)
        self.check(arm, resolved, goal)
        first = start if arm.limits.contains(start) else arm.limits.clip(nearest_winding(arm, start, start))
        packed = packed_goal(goal, arm, start)
        return Query(arm, box_of(arm), target, matrix(target), resolved, packed, start, first, seeds_of(arm, rng))

    def _solve(self, engine: CompiledEngine | PinocchioEngine, query: Query, accept: Accept | None) -> IkResult:
        count, tried, iterations, refusals = self.restarts + 1, 0, 0, 0
        first_refused: Candidate | None = None

        def result(status: IkStatus, candidate: Candidate, message: str) -> IkResult:
            return IkResult(status, candidate.q, *candidate.errors, iterations, tried - 1, engine.name, message)

        while True:
            end = engine(query, first=tried, count=count, polish=first_refused is None)
            tried, iterations = end.attempts, iterations + end.iterations
            candidate = judge(query.arm, query.matrix, query.task, end.q, query.start)
            if candidate.fulfils:
                if _accepts(accept, candidate):
                    return result(IkStatus.FOUND, candidate, found(candidate.errors, iterations, tried - 1))
                refusals += 1
                first_refused = first_refused or candidate
            if tried < count:
                continue
            if first_refused is not None:
                return result(IkStatus.REFUSED, first_refused, refused(refusals, tried))
            message = not_found(query.arm, candidate.q, candidate.errors, iterations, tried)
            return result(IkStatus.NOT_FOUND, candidate, message)


def _accepts(accept: Accept | None, candidate: Candidate) -> bool:
    """Whether ``accept`` returns True for a copy of the solution, or is not given."""
    return accept is None or bool(accept(candidate.q.copy()))


def _start(arm: Arm, q0: npt.ArrayLike | None) -> Array:
    return arm.home if q0 is None else arm.limits.snap(arm.configuration(q0, "q0"))


def _starts(arm: Arm, q0: npt.ArrayLike | None, count: int) -> Array:
    """The starts (count, n): q0 (n,) for all targets, or q0 (count, n)."""
    if q0 is None or np.ndim(q0) <= 1:
        return np.tile(_start(arm, q0), (count, 1))
    return arm.limits.snap(finite("q0", q0, (count, arm.dof)))


def _same(arm: Arm, a: Array, b: Array) -> bool:
    return bool(np.abs(difference(arm, a, b)).max() < SAME_SOLUTION)
