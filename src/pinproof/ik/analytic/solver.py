"""Closed-form inverse kinematics with the calls of the other methods, and with all branches."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from pinproof.common.validation import Rng, random_generator, require_integer, require_positive
from pinproof.errors import InputError
from pinproof.ik.analytic.branches import IkBranches, IkBranchesBatch
from pinproof.ik.analytic.family import branches_elsewhere
from pinproof.ik.analytic.plan import Plan, plan_for
from pinproof.ik.analytic.sweep import sweep, sweep_many
from pinproof.ik.result import STATUSES, IkBatch, IkResult, IkStatus, judge
from pinproof.ik.solver import Accept, TaskLike
from pinproof.ik.task import Task, make_task
from pinproof.ik.windings import nearest_winding
from pinproof.model import Arm
from pinproof.spatial import SE3, finite, rigid, rigid_many

__all__ = ["AnalyticIk"]

Array = npt.NDArray[np.float64]

DOUBLE, SHAPE = np.dtype(np.float64), (4, 4)

FINEST_PROOF = 1e-6
"""M or rad. That no configuration reaches a pose is claimed at tolerances up to this; at coarser ones, neighbours of
the pose that can be reached may do."""


@dataclass(frozen=True, kw_only=True)
class AnalyticIk:
    """Inverse kinematics in closed form: all branches at once, for arms whose geometry allows it.

    What it takes is read off the chain (:mod:`pinproof.kernels.two_curves`): three neighbouring axes that meet in one
    point, are parallel, or move in one plane, anywhere among six (Pieper's condition). Shorter arms are completed to
    six, arms of seven swept along one joint. Axes up to 5e-3 rad or 5 mm (on an arm of 1 m) off such a geometry, as
    calibration leaves them, are solved for the ideal arm and refined on the true one by Newton's iteration. Every
    answer is checked by forward kinematics of the true chain.

    Parameters
    ----------
    position_tolerance, orientation_tolerance
        In m and rad: how far off an answer may be.
    redundant_steps
        Values of the redundant joint that are looked at, of an arm of seven.

    References
    ----------
    Pieper (1968), "The kinematics of manipulators under computer control"; Elias, Wen (2022), "IK-Geo: Unified robot
    inverse kinematics using subproblem decomposition".
    """

    position_tolerance: float = 1e-9
    orientation_tolerance: float = 1e-9
    redundant_steps: int = 128

    def __post_init__(self) -> None:
        require_positive("position_tolerance", self.position_tolerance)
        require_positive("orientation_tolerance", self.orientation_tolerance)
        require_integer("redundant_steps", self.redundant_steps, 2)

    engine: ClassVar[str] = "analytic"
    _latest: ClassVar[tuple[Any, Any]] = (lambda: None, None)

    def solve_all(self, arm: Arm, target: SE3 | npt.ArrayLike, q0: npt.ArrayLike | None = None) -> IkBranches:
        """Every configuration of the arm, inside its limits, that brings its tcp to the target.

        Parameters
        ----------
        arm
            The arm.
        target
            ``base_from_target``, as ``pin.SE3`` or (4, 4).
        q0
            (n,) by default ``arm.home``: answers are sorted by their distance from it, whole turns and joints that are
            free at the target take what is nearest to it.

        Raises
        ------
        NoClosedForm
            If the arm's geometry has none; says why, and what to use instead.
        InputError
            For a target that is not rigid, or a q0 of wrong shape.
        """
        known, plan = self._latest  # looking it up by the arm would take as long as a third of the solution
        if known() is not arm:
            plan = self._plan(arm)
        reference = plan.home if q0 is None else arm.configuration(q0, "q0")
        if not (
            type(target) is np.ndarray and target.dtype is DOUBLE and target.shape == SHAPE and target.flags.carray
        ):
            target = np.array(rigid("target", target).homogeneous)
        if plan.redundant is not None:
            return self._swept(arm, plan, np.array(rigid("target", target).homogeneous), reference)
        out = np.empty(plan.shape)
        count = plan.kernel(plan.array, target, reference, 0.0, out)
        if count <= 0:
            if count < 0:
                rigid("target", target)  # says what is wrong with it
            elif out[-1, 0]:
                out, count = branches_elsewhere(arm, plan, target, reference, out)
        return IkBranches(arm, plan, target, reference, out, count)

    def solve_all_batch(
        self,
        arm: Arm,
        targets: npt.ArrayLike | Sequence[SE3],
        q0: npt.ArrayLike | None = None,
        *,
        redundant_values: npt.ArrayLike | None = None,
        threads: int = 1,
    ) -> IkBranchesBatch:
        """The distinct branches for N targets, each with the whole turns nearest to q0.

        Parameters
        ----------
        targets
            (N, 4, 4) ``base_from_target``, or a sequence of ``pin.SE3``.
        q0
            (n,) for all targets, or (N, n); by default ``arm.home``.
        redundant_values
            (v,) values (rad or m) of the redundant joint at which an arm of seven is looked at; by default
            ``redundant_steps`` over its limits, and where q0 has it.
        threads
            Threads that share the work; the answers do not depend on their number.

        Raises
        ------
        NoClosedForm, InputError
            As :meth:`solve_all`; names the target.
        """
        from pinproof.kernels.branches import BAD_TARGET, ELSEWHERE, branches_of_many

        require_integer("threads", threads, 1)
        plan = self._plan(arm)
        many = _poses(targets)
        references = self._references(arm, plan, q0, len(many))
        if plan.redundant is not None:
            return self._swept_batch(arm, plan, rigid_many("targets", many), references, redundant_values)
        if redundant_values is not None:
            raise InputError(f"redundant_values are for arms with a redundant joint, not for one of {arm.dof}")
        q = np.empty((len(many), plan.capacity, plan.dof))
        errors = np.empty((len(many), plan.capacity, 2))
        counts, outside = np.empty((2, len(many)), dtype=np.int64)
        known = np.empty(len(many), dtype=np.bool_)
        no_value = np.zeros((1, 1))

        def share(start: int, stop: int) -> None:
            branches_of_many(plan.array, many, references, no_value, start, stop, q, errors, counts, outside, known)

        if threads == 1:
            share(0, len(many))
        else:
            cuts = np.linspace(0, len(many), threads + 1).astype(int).tolist()
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(lambda cut: share(*cut), pairwise(cuts)))
        if (counts < 0).any():
            if (counts == BAD_TARGET).any():
                rigid_many("targets", many)  # says which is wrong, and what
            for row in np.flatnonzero(counts == ELSEWHERE):
                rows = self.solve_all(arm, many[row], references[row if len(references) > 1 else 0]).rows
                counts[row] = len(rows)
                if len(rows) > q.shape[1]:
                    more = ((0, 0), (0, len(rows) - q.shape[1]), (0, 0))
                    q, errors = np.pad(q, more, constant_values=np.nan), np.pad(errors, more, constant_values=np.nan)
                q[row, : len(rows)], errors[row, : len(rows)] = rows[:, : arm.dof], rows[:, arm.dof : arm.dof + 2]
        k = max(int(counts.max(initial=0)), 1)
        complete = known & (plan.miss == 0.0)
        return IkBranchesBatch(q[:, :k], counts, errors[:, :k, 0], errors[:, :k, 1], outside, complete)

    def solve(
        self,
        arm: Arm,
        target: SE3 | npt.ArrayLike,
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        task: TaskLike = "pose",
        accept: Accept | None = None,
    ) -> IkResult:
        """The branch nearest to q0 (largest joint difference, whole turns considered) that ``accept`` takes.

        The parameters are those of :meth:`pinproof.Clik.solve`; ``rng`` is not drawn from, and ``task`` can only be
        ``"pose"``. A "no" is IMPOSSIBLE where the branches are all there are, and NOT_FOUND where they may not be.
        """
        random_generator(rng)
        asked = self._pose_only(task)
        found = self.solve_all(arm, target, q0)
        reference, branches = found.reference, found.branches
        refused = 0

        def result(status: IkStatus, q: Array, message: str) -> IkResult:
            candidate = judge(arm, found.target, asked, q, reference)
            return IkResult(status, candidate.q, *candidate.errors, 0, 0, self.engine, message)

        nearest = [branch for family in found.families for branch in [family.nearest(reference)]]
        choice = nearest_winding(arm, np.array([*branches, *nearest]).reshape(-1, arm.dof), reference)
        for index in np.argsort(np.abs(choice - reference).max(axis=1, initial=0.0), kind="stable"):
            if accept is None or accept(choice[index].copy()):
                return result(IkStatus.FOUND, choice[index], f"the nearest of {found.message}")
            refused += 1
        if refused:
            said = f"accept refused each of {found.message}; see what it objects to at q, or move the target"
            return result(IkStatus.REFUSED, choice[0], said)
        proven = found.complete and max(self.position_tolerance, self.orientation_tolerance) <= FINEST_PROOF
        status = IkStatus.IMPOSSIBLE if proven else IkStatus.NOT_FOUND
        return result(status, arm.limits.clip(nearest_winding(arm, reference, reference)), found.message)

    def solve_batch(
        self,
        arm: Arm,
        targets: npt.ArrayLike | Sequence[SE3],
        q0: npt.ArrayLike | None = None,
        *,
        rng: Rng = 0,
        task: TaskLike = "pose",
        accept: Accept | None = None,
        threads: int = 1,
    ) -> IkBatch:
        """:meth:`solve` for N targets; the parameters are those of :meth:`pinproof.Clik.solve_batch`."""
        random_generator(rng)
        self._pose_only(task)
        plan = self._plan(arm)
        many = rigid_many("targets", targets)
        references = self._references(arm, plan, q0, len(many))
        if accept is not None or plan.redundant is not None or plan.miss > 0.0:
            starts = np.broadcast_to(references, (len(many), arm.dof))
            results = [self.solve(arm, many[i], starts[i], accept=accept) for i in range(len(many))]
            return IkBatch.of(results, arm, self.engine)
        found = self.solve_all_batch(arm, many, references[0] if len(references) == 1 else references, threads=threads)
        away = np.abs(found.q - references[:, None]).max(axis=2)
        best = np.where(np.isnan(away), np.inf, away).argmin(axis=1)
        rows = np.arange(len(many))
        none = ~found.ok
        q = np.where(none[:, None], arm.limits.clip(references), found.q[rows, best])
        position, orientation = found.position_error[rows, best], found.orientation_error[rows, best]
        for row in np.flatnonzero(none):  # how far a "no" is off, from where it was asked
            single = self.solve(arm, many[row], references[row if len(references) > 1 else 0])
            q[row], position[row], orientation[row] = single.q, single.position_error, single.orientation_error
        code = STATUSES.index(IkStatus.FOUND)
        codes = np.full(len(many), code, dtype=np.int8)
        words = [f"the nearest of {count} branches" for count in found.count.tolist()]
        for row in np.flatnonzero(none):
            single = self.solve(arm, many[row], references[row if len(references) > 1 else 0])
            codes[row], words[row] = STATUSES.index(single.status), single.message
        zeros = np.zeros(len(many), dtype=np.int64)
        return IkBatch(q, codes, position, orientation, zeros, zeros, self.engine, arm, tuple(words))

    def _plan(self, arm: Arm) -> Plan:
        plan = plan_for(arm, self.position_tolerance, self.orientation_tolerance)
        object.__setattr__(self, "_latest", (weakref.ref(arm), plan))
        return plan

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name != "_latest"}

    def _references(self, arm: Arm, plan: Plan, q0: npt.ArrayLike | None, count: int) -> Array:
        """(1, n) or (count, n) where to choose from."""
        if q0 is None:
            return plan.home[None]
        return arm.configuration(q0, "q0")[None] if np.ndim(q0) <= 1 else finite("q0", q0, (count, arm.dof))

    def _pose_only(self, task: TaskLike) -> Task:
        asked = make_task(task, self.position_tolerance, self.orientation_tolerance)
        if not asked.asked.all():
            raise InputError(f"AnalyticIk solves for whole poses, not for task={task!r}; use Clik for this task")
        return asked

    def _swept(self, arm: Arm, plan: Plan, target: Array, reference: Array) -> IkBranches:
        grid = self._grid(arm, plan, reference)
        rows, intervals = sweep(plan, target, reference, grid)
        return IkBranches(arm, plan, target, reference, rows, len(rows) - 1, grid, intervals)

    def _swept_batch(
        self, arm: Arm, plan: Plan, many: Array, references: Array, given: npt.ArrayLike | None
    ) -> IkBranchesBatch:
        if given is not None:
            values = finite("redundant_values", given, (None,))[None]
        else:
            grids = [self._grid(arm, plan, each) for each in references]
            most = max(map(len, grids), default=1)  # one less where the reference is on the grid: its middle makes up
            values = np.array([g if len(g) == most else np.sort([*g, (g[0] + g[1]) / 2]) for g in grids])
        found, missed, per_value, outside = sweep_many(plan, many, references, values)
        counts = per_value.sum(axis=1)
        row = np.repeat(np.arange(len(many)), counts)
        away = np.abs(found - references[row if len(references) > 1 else 0]).max(axis=1, initial=0.0)
        order = np.lexsort((away, row))
        place = np.arange(len(found)) - np.repeat(np.cumsum(counts) - counts, counts)
        padded = np.full((len(many), max(int(counts.max(initial=0)), 1), arm.dof + 2), np.nan)
        padded[row, place, : arm.dof], padded[row, place, arm.dof :] = found[order], missed[order]
        return IkBranchesBatch(
            padded[:, :, : arm.dof], counts, padded[:, :, arm.dof], padded[:, :, arm.dof + 1], outside.sum(axis=1),
            np.zeros(len(many), dtype=bool),
        )  # fmt: skip

    def redundant_grid(self, arm: Arm, q0: npt.ArrayLike | None = None) -> tuple[int, Array] | None:
        """The joint of an arm of seven that is swept, and its values (v,) (rad or m); None for other arms.

        Raises
        ------
        NoClosedForm, InputError
            As :meth:`solve_all`.
        """
        plan = self._plan(arm)
        if plan.redundant is None:
            return None
        return plan.redundant, self._grid(arm, plan, plan.home if q0 is None else arm.configuration(q0, "q0"))

    def _grid(self, arm: Arm, plan: Plan, reference: Array) -> Array:
        """Values of the redundant joint: evenly over its limits, and where the reference has it."""
        joint = plan.redundant
        lower, upper = (float(bound[joint]) for bound in arm.limits.sampling_range())
        own = float(np.clip(reference[joint], lower, upper))
        return np.unique(np.append(np.linspace(lower, upper, self.redundant_steps), own))


def _poses(targets: npt.ArrayLike | Sequence[SE3]) -> Array:
    """The targets as a kernel takes them, (N, 4, 4); it looks itself whether they are rigid."""
    plain = isinstance(targets, np.ndarray) and targets.dtype is DOUBLE and targets.flags.carray
    if plain and targets.ndim == 3 and targets.shape[1:] == SHAPE:  # type: ignore[union-attr]  # plain is an array
        return targets  # type: ignore[return-value]
    return rigid_many("targets", targets)
