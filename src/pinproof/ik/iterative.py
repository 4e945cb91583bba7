"""The base class of the iterative methods: settings, restarts, acceptance, and the final check."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import ClassVar, Literal
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from pinproof._core import IkSolver, World
from pinproof._core import Search as CompiledSearch
from pinproof.common.structs import key, struct
from pinproof.common.validation import Rng, require_integer, require_type
from pinproof.errors import InputError
from pinproof.ik.loop import (
    AnyCandidate,
    CompiledRule,
    OnStep,
    PinocchioSearch,
    Search,
    Stall,
    StepRule,
    keep,
    seeds_of,
)
from pinproof.ik.result import (
    STATUSES,
    IkBatch,
    IkResult,
    IkSolutions,
    IkStatus,
    difference,
    joint_ranges,
    not_found,
    plural,
    refused,
)
from pinproof.ik.task import CostGoal, GoalLike, Task, TaskLike, make_goal, make_task, orientation_tolerance_of
from pinproof.model import Arm
from pinproof.spatial import SE3, Array, finite, rigid_many, rigid_matrix

Accept = Callable[[Array], bool]
EngineName = Literal["auto", "compiled", "pinocchio"]

SAME_SOLUTION = 1e-3
"""Solutions whose joints all differ by less (rad or m) count as one. At a singular target, configurations up to about
this far apart have poses within 1e-6 of each other."""


@struct(kw_only=True)
class IterativeIk(ABC):
    """Base class of the iterative methods: settings and search. A method implements :meth:`step_rule`.

    Raises
    ------
    InputError
        If a setting is invalid.
    """

    position_tolerance: float = key(
        "largest distance between the tcp and the target for a solution", "m", default=1e-6, above=0
    )
    orientation_tolerance: float | None = key(
        "largest angle between the orientations of tcp and target for a solution; by default 1e-6, and 3e-5 for arms "
        "with fewer than six joints, which rounded numbers in a description turn out of the poses they should reach",
        "rad",
        default=None,
        above=0,
    )
    max_iterations: int = key("maximum number of steps of one attempt", default=100, minimum=1)
    restarts: int = key(
        "maximum number of attempts after the first. The first attempt starts at q0. The second starts at the "
        "configuration closest in pose to the target among the flips of the first result (one joint mirrored about the "
        "middle of its range) and a low-discrepancy set within the limits; the others start at the closest of that set",
        default=50,
        minimum=0,
    )
    max_step: float = key("largest motion of a joint in one step", "rad or m", default=1.0, above=0)
    engine: EngineName = key(
        '``"compiled"``; ``"pinocchio"``, which computes the same iterates with the kinematics of Pinocchio about a '
        'hundred times slower; or ``"auto"``: compiled, unless ``on_step`` is given or the method has no compiled rule',
        default="auto",
    )

    stall: ClassVar[Stall] = Stall()
    """The criterion for ending an attempt of this method early."""

    @abstractmethod
    def step_rule(self) -> StepRule:
        """A fresh step rule for one attempt: any function of residual and Jacobian (:class:`StepRule`)."""

    def check(self, arm: Arm, task: Task, goal: GoalLike | None) -> None:  # noqa: B027 - most do it all
        """Reject arms, tasks and goals that the method does not support; by default none.

        Raises
        ------
        InputError
            If one is not supported; the message names the alternatives.
        """

    def _task(self, arm: Arm, task: TaskLike) -> Task:
        orientation = orientation_tolerance_of(arm, self.orientation_tolerance, usual=1e-6)
        return make_task(task, self.position_tolerance, orientation)

    def compiled_rule(self) -> CompiledRule | None:
        """The step rule of the compiled core, or None if the method has none."""
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
        goal: GoalLike | None = None,
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
            that axis of the target; or an :class:`~pinproof.ik.IkTask` with any of the six coordinates.
        accept
            Called with a copy of each solution (n,). If it returns False, the search continues.
        goal
            Null-space objective for the degrees of freedom that the task leaves: ``"centre"`` (middle of the joint
            ranges), ``"near"`` (close to q0), ``"manipulability"``, or an :class:`~pinproof.ik.IkGoal`. Also any
            function of q (n,) that returns a number to make small, or pairs of a weight and such a function: among the
            configurations that satisfy the task, the search continues while the sum decreases. It then runs on
            Pinocchio. :func:`~pinproof.ik.posture` and :func:`~pinproof.ik.look_at` return such functions.
        on_step
            Called with every step, for example for plots.

        Raises
        ------
        InputError
            If the target is not rigid, q0 has the wrong shape, the task or goal is unknown, or rng is invalid.
        """
        require_type("arm", arm, Arm)
        matrix, start = rigid_matrix("target", target, batch="solve_batch"), _start(arm, q0)
        resolved = self._task(arm, task)
        search, engine = self._search(arm, matrix, start, rng, resolved, goal, on_step)
        return self._solve(arm, search, engine, accept, resolved)

    def solve_batch(
        self,
        arm: Arm,
        targets: npt.ArrayLike | Sequence[SE3],
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        task: TaskLike = "pose",
        accept: Accept | None = None,
        goal: GoalLike | None = None,
        threads: int = 1,
    ) -> IkBatch:
        """:meth:`solve` for N targets.

        The other parameters are those of :meth:`solve`. ``accept=checker.is_free`` is evaluated in the compiled core.

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
        require_type("arm", arm, Arm)
        require_integer("threads", threads, 1)
        many = rigid_many("targets", targets)
        if q0 is None or np.ndim(q0) <= 1:
            starts = np.tile(_start(arm, q0), (len(many), 1))
        else:
            starts = finite("q0", q0, (len(many), arm.dof))
        resolved = self._task(arm, task)
        null_space = make_goal(goal, arm, arm.home)
        called_back = isinstance(null_space, CostGoal) and self.engine != "compiled"
        solver = None if called_back else self._compiled(arm, resolved, None)
        # one target after the other, where Python is called back
        world = _world(accept, arm)
        if solver is None or (accept is not None and world is None):

            def one(index: int) -> IkResult:
                search, engine = self._search(arm, many[index], starts[index], rng, resolved, goal, None)
                return self._solve(arm, search, engine, accept, resolved)

            name = "pinocchio" if solver is None else "compiled"
            if threads == 1:
                return IkBatch.of([one(index) for index in range(len(many))], arm, name)
            with ThreadPoolExecutor(threads) as pool:
                return IkBatch.of(list(pool.map(one, range(len(many)))), arm, name)

        # all targets at once in the compiled core, which does not call back
        self.check(arm, resolved, goal)
        seeds = seeds_of(arm, rng).compiled
        compiled = None if null_space is None else null_space.compiled
        q, position, orientation, ok, iterations, attempts, refusals = solver.solve_batch(
            many, starts, seeds, compiled, self.restarts + 1, world, threads
        )
        failed = np.where(refusals > 0, STATUSES.index(IkStatus.REFUSED), STATUSES.index(IkStatus.NOT_FOUND))
        codes = np.where(ok, STATUSES.index(IkStatus.FOUND), failed).astype(np.int8)
        counts = zip(ok.tolist(), refusals.tolist(), attempts.tolist(), strict=True)
        words = None
        if (~ok & (refusals > 0)).any():
            words = tuple(None if found or not count else refused(count, tried) for found, count, tried in counts)
        restarts, counted = attempts - 1, resolved.counted
        return IkBatch(q, codes, position, orientation, iterations, restarts, "compiled", arm, words, counted)

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
        require_type("arm", arm, Arm)
        require_integer("count", count, 1)
        require_integer("attempts", attempts, 1)
        start = _start(arm, q0)
        resolved = self._task(arm, task)
        search, engine = self._search(arm, rigid_matrix("target", target), start, rng, resolved, None, None)
        # attempts until enough distinct solutions are found
        kept: list[AnyCandidate] = []
        tried = iterations = refusals = 0
        while tried < attempts and len(kept) < count:
            candidate = search.next(attempts, False)
            q, tried, iterations = candidate.q, candidate.attempts, candidate.iterations
            apart = (np.abs(difference(arm, q, other.q)).max() for other in kept)
            if not candidate.fulfils or any(away < SAME_SOLUTION for away in apart):
                continue
            if not _accepts(accept, q):
                refusals += 1
                continue
            kept.append(candidate)
        kept.sort(key=lambda candidate: float(np.abs(candidate.q - start).max()))
        rejected = f", {plural(refusals, 'solution')} rejected by accept" if refusals else ""
        more = "increase attempts, or call solve() for the residual of the closest configuration"
        remedy = "" if kept else f"; {more}"
        return IkSolutions(
            q=np.array([candidate.q for candidate in kept], dtype=float).reshape(len(kept), arm.dof),
            position_error=np.array([candidate.position_error for candidate in kept], dtype=float),
            orientation_error=np.array([candidate.orientation_error for candidate in kept], dtype=float),
            attempts=tried,
            iterations=iterations,
            engine=engine,
            message=(
                f"{plural(len(kept), 'distinct solution')} from {plural(tried, 'attempt')}{rejected}; "
                f"this is a sample, and further solutions may exist{remedy}"
            ),
        )

    def _search(
        self, arm: Arm, target: Array, start: Array, rng: Rng, task: Task, goal: GoalLike | None, on_step: OnStep | None
    ) -> tuple[Search, str]:
        """The attempts for a target (4, 4), and the name of the engine that makes them."""
        self.check(arm, task, goal)
        seeds, null_space = seeds_of(arm, rng), make_goal(goal, arm, start)
        called_back = isinstance(null_space, CostGoal) and self.engine != "compiled"
        solver = None if called_back else self._compiled(arm, task, on_step)
        if solver is not None:
            compiled = None if null_space is None else null_space.compiled
            return CompiledSearch(solver, seeds.compiled, compiled, target, start), "compiled"
        search = PinocchioSearch(
            arm, target, task, null_space, seeds, start, rule=self.step_rule, stall=self.stall,
            max_iterations=self.max_iterations, max_step=self.max_step, on_step=on_step,
        )  # fmt: skip
        return search, "pinocchio"

    def _compiled(self, arm: Arm, task: Task, on_step: OnStep | None) -> IkSolver | None:
        """The solver of the compiled core, which is cached; None if the loop on Pinocchio must be used."""
        usable = on_step is None and self.engine != "pinocchio"
        solver = _SOLVERS.get(arm, {}).get((self, task)) if usable else None
        if solver is not None:
            return solver
        # a method without a compiled rule runs on Pinocchio, unless the caller demands the core
        rule = self.compiled_rule() if usable else None
        if rule is None:
            if self.engine == "compiled":
                why = "this method has no compiled rule" if usable else "on_step requires the loop on Pinocchio"
                raise InputError(f"engine='compiled' is not available: {why}; use engine='auto'")
            return None
        solver = IkSolver(
            arm.chain,
            joint_ranges(arm),
            task=task.compiled,
            rule=rule,
            max_iterations=self.max_iterations,
            max_step=self.max_step,
            progress=self.stall.progress,
            patience=self.stall.patience,
        )
        return keep(_SOLVERS, arm, (self, task), solver, SOLVERS_KEPT)

    def _solve(self, arm: Arm, search: Search, engine: str, accept: Accept | None, task: Task) -> IkResult:
        count, refusals = self.restarts + 1, 0

        def result(status: IkStatus, found: AnyCandidate, words: str | None = None) -> IkResult:
            errors = found.position_error, found.orientation_error
            return IkResult(status, found.q, *errors, found.iterations, found.attempts - 1, engine, words, task.counted)

        first: IkResult | None = None  # the first that accept rejected
        while True:
            found = search.next(count, first is None)
            if found.fulfils:
                solution = result(IkStatus.FOUND, found)
                if _accepts(accept, solution.q):
                    return solution
                refusals += 1
                first = first or solution
            if found.attempts < count:
                continue
            # All attempts are used: the closest configuration, or the first solution that was rejected.
            if first is None:
                errors = found.position_error, found.orientation_error
                message = not_found(arm, task.counted, found.q, errors, found.iterations, found.attempts)
                return result(IkStatus.NOT_FOUND, found, message)
            words = refused(refusals, found.attempts)
            iterations, restarts = found.iterations, found.attempts - 1
            return replace(first, status=IkStatus.REFUSED, iterations=iterations, restarts=restarts, words=words)


SOLVERS_KEPT = 16
"""Number of compiled solvers that are cached for an arm."""

_SOLVERS: WeakKeyDictionary[Arm, dict[tuple[IterativeIk, Task], IkSolver]] = WeakKeyDictionary()


def _accepts(accept: Accept | None, q: Array) -> bool:
    """Whether ``accept`` returns True for a copy of the solution, or is not given."""
    return accept is None or bool(accept(q.copy()))


def _world(accept: Accept | None, arm: Arm) -> World | None:
    """The world in which the core decides the same as ``accept``, if that is the method of a collision checker."""
    world_for = getattr(getattr(accept, "__self__", None), "world_for", None)
    return None if world_for is None else world_for(accept, arm)


def _start(arm: Arm, q0: npt.ArrayLike | None) -> Array:
    return arm.home if q0 is None else arm.configuration(q0, "q0")
