"""The solver :class:`AnalyticIk`: all IK branches, and the interface of the other IK methods."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from itertools import product
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from pinproof import _core
from pinproof.common.structs import key, struct
from pinproof.common.validation import Rng, random_generator, require_integer, require_type
from pinproof.errors import InputError
from pinproof.ik.analytic_branches import IkBranches, IkBranchesBatch, sweep_many
from pinproof.ik.analytic_plan import Plan, plan_for
from pinproof.ik.analytic_self_motion import SelfMotion, branches_elsewhere, self_motion_of
from pinproof.ik.iterative import Accept
from pinproof.ik.reach_proof import is_provable, prove_unreachable
from pinproof.ik.result import STATUSES, IkBatch, IkResult, IkStatus, judge, nearest_winding
from pinproof.ik.task import Task, TaskLike, make_task, orientation_tolerance_of
from pinproof.model import Arm
from pinproof.spatial import SE3, Array, finite, rigid, rigid_many

DOUBLE, SHAPE = np.dtype(np.float64), (4, 4)

NO_VALUE = np.zeros((1, 1, 0))
"""The values of the redundant joints of an arm without one."""

FINEST_PROOF = 1e-6
"""M or rad. IMPOSSIBLE is returned only for tolerances up to this: with larger ones, a reachable pose close to the
target might satisfy them."""

PROOF_BOXES = 400
"""Largest number of boxes of a proof for a target at which the closed form found no branch and is not complete."""


@struct(kw_only=True)
class AnalyticIk:
    """All IK branches, in closed form or by elimination.

    Six joints, up to three of them prismatic, may be in any position. If three consecutive axes meet in one point, are
    parallel, or generate motions of one plane (Pieper's condition, ``src/core/closed_form/outer_joints.h``), the
    solution is a closed form. Otherwise, and if axes deviate after calibration, the true axes are solved by elimination
    and eigenvalues (``src/core/closed_form/elimination.h``), or with two or three prismatic joints by the roots of a
    polynomial (``src/core/closed_form/prismatic_loop.h``). Shorter arms are completed to six joints. Of seven joints,
    one is swept: a rail or a turntable before an arm of six joints, else the one that the self-motion moves most. Of
    eight joints, the first two are swept, such as those of a gantry. Every solution is verified by forward kinematics.

    References
    ----------
    Pieper (1968), "The kinematics of manipulators under computer control"; Elias, Wen (2022), "IK-Geo: Unified robot
    inverse kinematics using subproblem decomposition"; Raghavan, Roth (1993), "Inverse kinematics of the general 6R
    manipulator and related linkages".
    """

    position_tolerance: float = key("largest distance of a solution from the target", "m", default=1e-9, above=0)
    orientation_tolerance: float | None = key(
        "largest angle of a solution from the target; by default 1e-9, and 3e-5 for arms with fewer than six joints",
        "rad",
        default=None,
        above=0,
    )
    redundant_steps: int = key(
        "number of values in the sweep of a redundant joint; two joints have about as many pairs of values",
        default=128,
        minimum=2,
    )

    engine: ClassVar[str] = "analytic"
    _latest: ClassVar[tuple[Any, Any]] = (lambda: None, None)

    def solve_all(
        self,
        arm: Arm,
        target: SE3 | npt.ArrayLike,
        q0: npt.ArrayLike | None = None,
        *,
        redundant_values: npt.ArrayLike | None = None,
    ) -> IkBranches:
        """All configurations of the arm within its limits that bring its tcp to the target.

        Parameters
        ----------
        arm
            The arm.
        target
            ``base_from_target``, as ``pin.SE3`` or (4, 4).
        q0
            (n,) by default ``arm.home``. Solutions are sorted by their distance from it, and shifted by 2 pi to be
            closest to it; joints that are free at the target keep their value of q0 if possible.
        redundant_values
            A value or (v,) values (rad or m) of the redundant joint of an arm of seven joints, at which alone it is
            solved; (2,) or (v, 2) for eight joints. Default: a sweep.

        Raises
        ------
        NoClosedForm
            If the arm has no closed form; the message states the reason and the alternative.
        InputError
            If the target is not rigid, q0 has the wrong shape, or there are values but no redundant joint.
        """
        known, plan = self._latest  # a lookup by the arm would take a third of the time of the solution
        if known() is not arm:
            plan = self._plan(arm)
        reference = plan.home if q0 is None else _reference(arm, plan, q0)
        if isinstance(target, SE3):
            target = target.homogeneous  # a new array, which the core orthonormalises, or refuses if it is not rigid
        elif not (
            type(target) is np.ndarray and target.dtype is DOUBLE and target.shape == SHAPE and target.flags.carray
        ):
            target = np.array(rigid("target", target, batch="solve_batch, or solve_all_batch,").homogeneous)
        if redundant_values is None and not plan.redundant:
            if (found := plan.core.solve_here(target, reference)) is None:
                return IkBranches.solved(arm, plan, target, reference)
            return IkBranches(arm, plan, target, reference, found)
        swept = redundant_values is None
        grid = self._grid(arm, plan, reference) if redundant_values is None else _stated(arm, plan, redundant_values)
        target = np.array(rigid("target", target).homogeneous)
        return IkBranches.solved(arm, plan, target, reference, grid, swept=swept)

    def solve_all_batch(
        self,
        arm: Arm,
        targets: npt.ArrayLike | Sequence[SE3],
        q0: npt.ArrayLike | None = None,
        *,
        redundant_values: npt.ArrayLike | None = None,
        threads: int = 1,
    ) -> IkBranchesBatch:
        """The distinct branches for N targets, each shifted by multiples of 2 pi to be closest to q0.

        Parameters
        ----------
        targets
            (N, 4, 4) ``base_from_target``, or a sequence of ``pin.SE3``.
        q0
            (n,) for all targets, or (N, n); by default ``arm.home``.
        redundant_values
            As for :meth:`solve_all`; by default ``redundant_steps`` values over the limits, and the value in q0.
        threads
            Number of threads; the results do not depend on it.

        Raises
        ------
        NoClosedForm, InputError
            As :meth:`solve_all`; the message names the target.
        """
        require_integer("threads", threads, 1)
        plan = self._plan(arm)
        many = _poses(targets)
        references = _references(arm, plan, q0, len(many))
        if redundant_values is not None or plan.redundant:
            stated = None if redundant_values is None else _stated(arm, plan, redundant_values)
            return self._swept_batch(arm, plan, rigid_many("targets", many), references, stated)
        q, errors, counts, outside, known = (
            part[:, 0] for part in plan.core.solve_batch(many, references, NO_VALUE, plan.capacity, threads)
        )
        # negative counts are codes: no rigid transform, or no branch at the values of free joints in the reference
        if (counts < 0).any():
            if (counts == _core.BAD_TARGET).any():
                rigid_many("targets", many)  # raises with the index and the reason
            for row in np.flatnonzero(counts == _core.ELSEWHERE):
                reference = references[row if len(references) > 1 else 0]
                found = plan.solve(many[row], reference)
                if not len(found):
                    found = branches_elsewhere(arm, plan, many[row], reference)
                counts[row] = count = len(found)
                if count > q.shape[1]:
                    more = ((0, 0), (0, count - q.shape[1]), (0, 0))
                    q, errors = np.pad(q, more, constant_values=np.nan), np.pad(errors, more, constant_values=np.nan)
                q[row, :count], errors[row, :count] = found.q, found.errors
        # as many columns as the target with the most branches has
        k = max(int(counts.max(initial=0)), 1)
        return IkBranchesBatch(q[:, :k], counts, errors[:, :k, 0], errors[:, :k, 1], outside, known)

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
        """The branch closest to q0 (largest joint difference, including shifts by 2 pi) that ``accept`` accepts.

        The parameters are those of :meth:`pinproof.Clik.solve`; ``rng`` is not used, and ``task`` must be ``"pose"``.
        Without a solution, the status is IMPOSSIBLE if the branches are proven to be complete or
        :func:`pinproof.prove_unreachable` excludes all joint values, else NOT_FOUND.
        """
        random_generator(rng)
        resolved = self._pose_only(arm, task)
        found = self.solve_all(arm, target, q0)
        reference, branches = found.reference, found.branches
        refused = 0

        def result(status: IkStatus, q: Array, message: str) -> IkResult:
            candidate = judge(arm, found.target, resolved, q, reference)
            errors = candidate.position_error, candidate.orientation_error
            return IkResult(status, candidate.q, *errors, 0, 0, self.engine, message)

        # the branches and the closest member of each family, nearest to the reference first
        nearest = [family.nearest(reference) for family in found.families]
        choice = nearest_winding(arm, np.array([*branches, *nearest]).reshape(-1, arm.dof), reference)
        for index in np.argsort(np.abs(choice - reference).max(axis=1, initial=0.0), kind="stable"):
            if accept is None or accept(choice[index].copy()):
                return result(IkStatus.FOUND, choice[index], f"found: closest to q0 of {found.message}")
            refused += 1
        if refused:
            text = f"rejected: accept returned False for each of {found.message}"
            return result(IkStatus.REFUSED, choice[0], f"{text}; check why it rejects q, or move the target")
        # without any, whether that is proven decides on the status
        position, orientation = self._tolerances(arm)
        proven = found.complete and max(position, orientation) <= FINEST_PROOF
        text = f"{'proven impossible' if proven else 'not reached'}: {found.message}"
        if not proven and is_provable(arm):
            proof = prove_unreachable(
                arm,
                found.target,
                position_tolerance=position,
                orientation_tolerance=orientation,
                budget=PROOF_BOXES,
                search=False,
            )
            proven, text = proof.proven, proof.message if proof.proven else text
        status = IkStatus.IMPOSSIBLE if proven else IkStatus.NOT_FOUND
        return result(status, arm.limits.clip(nearest_winding(arm, reference, reference)), text)

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
        require_integer("threads", threads, 1)
        self._pose_only(arm, task)
        plan = self._plan(arm)
        many = rigid_many("targets", targets)
        references = _references(arm, plan, q0, len(many))
        if accept is not None or plan.redundant or plan.deviation > 0.0:
            starts = np.broadcast_to(references, (len(many), arm.dof))
            results = [self.solve(arm, many[i], starts[i], accept=accept) for i in range(len(many))]
            return IkBatch.of(results, arm, self.engine)
        # the branch closest to the reference, without the loop over targets
        found = self.solve_all_batch(arm, many, references[0] if len(references) == 1 else references, threads=threads)
        away = np.abs(found.q - references[:, None]).max(axis=2)
        best = np.where(np.isnan(away), np.inf, away).argmin(axis=1)
        rows = np.arange(len(many))
        none = ~found.ok
        q = np.where(none[:, None], arm.limits.clip(references), found.q[rows, best])
        position, orientation = found.position_error[rows, best], found.orientation_error[rows, best]
        codes = np.full(len(many), STATUSES.index(IkStatus.FOUND), dtype=np.int8)
        words = [f"found: closest to q0 of {count} branches" for count in found.count.tolist()]
        # a target without a branch gets the status and the message of a single solution
        for row in np.flatnonzero(none):
            single = self.solve(arm, many[row], references[row if len(references) > 1 else 0])
            q[row], position[row], orientation[row] = single.q, single.position_error, single.orientation_error
            codes[row], words[row] = STATUSES.index(single.status), single.message
        zeros = np.zeros(len(many), dtype=np.int64)
        return IkBatch(q, codes, position, orientation, zeros, zeros, self.engine, arm, tuple(words))

    def _plan(self, arm: Arm) -> Plan:
        require_type("arm", arm, Arm)
        plan = plan_for(arm, *self._tolerances(arm))
        object.__setattr__(self, "_latest", (weakref.ref(arm), plan))
        return plan

    def _tolerances(self, arm: Arm) -> tuple[float, float]:
        return self.position_tolerance, orientation_tolerance_of(arm, self.orientation_tolerance, usual=1e-9)

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name != "_latest"}

    def _pose_only(self, arm: Arm, task: TaskLike) -> Task:
        resolved = make_task(task, *self._tolerances(arm))
        if not resolved.mask.all():
            raise InputError(f"AnalyticIk supports task='pose' only, not task={task!r}; use Clik for this task")
        return resolved

    def branches_at(
        self, arm: Arm, targets: npt.ArrayLike, redundant_values: npt.ArrayLike
    ) -> tuple[Array, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """The branches (b, n) for N targets (N, 4, 4) at values of the redundant joint, closest to ``arm.home``.

        They are those of :meth:`solve_all_batch`, one target after another, but not sorted. Also their number (N,), and
        the number of further ones outside the limits (N,).

        Raises
        ------
        NoClosedForm, InputError
            As :meth:`solve_all`.
        """
        plan, many = self._plan(arm), rigid_many("targets", targets)
        values, references = _stated(arm, plan, redundant_values)[None], _references(arm, plan, None, len(many))
        found, _, counts, outside = sweep_many(plan, many, references, values)
        return found, counts.sum(axis=1), outside.sum(axis=1)

    def _swept_batch(
        self, arm: Arm, plan: Plan, many: Array, references: Array, stated: Array | None
    ) -> IkBranchesBatch:
        if stated is not None:
            values = stated[None]
        elif len(plan.redundant) > 1:
            values = self._grid(arm, plan, references[0])[None]
        else:
            grids = [self._grid(arm, plan, each) for each in references]
            most = max(map(len, grids), default=1)  # a grid that contains its reference is shorter by one value
            values = np.array([g if len(g) == most else np.sort([*g, (g[0] + g[1]) / 2]) for g in grids])
        found, missed, per_value, outside = sweep_many(plan, many, references, values)
        counts = per_value.sum(axis=1)
        # one row for each target, its branches sorted by their distance from the reference
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

    def self_motion(self, arm: Arm, target: SE3 | npt.ArrayLike, q0: npt.ArrayLike | None = None) -> SelfMotion:
        """The curves of IK solutions of an arm of seven joints over its redundant joint.

        Curves are followed from the solutions at ``redundant_steps`` values of that joint to their ends, where a joint
        is at a limit or the redundant joint reverses.

        Parameters
        ----------
        arm
            An arm of seven joints.
        target
            ``base_from_target``, as ``pin.SE3`` or (4, 4).
        q0
            (n,) full rotations are chosen closest to it where a curve starts; by default ``arm.home``.

        Raises
        ------
        NoClosedForm
            As :meth:`solve_all`.
        InputError
            If the arm has no redundant joint or the target is not rigid.
        """
        plan = self._plan(arm)
        if len(plan.redundant) != 1:
            raise InputError(
                f"self_motion requires an arm of 7 joints, and this arm has {arm.dof}; at singular targets of up to 6 "
                "joints, solve_all(...).families contains its self-motions"
            )
        reference = _reference(arm, plan, q0)
        matrix = np.array(rigid("target", target).homogeneous)
        return self_motion_of(
            arm, plan.tolerances, plan.redundant[0], matrix, reference, self._grid(arm, plan, reference)
        )

    def redundant_joints(self, arm: Arm) -> tuple[int, ...]:
        """The indices of the swept joints of an arm of seven or eight joints; empty for other arms.

        Raises
        ------
        NoClosedForm
            As :meth:`solve_all`.
        """
        return tuple(self._plan(arm).redundant)

    def redundant_grid(self, arm: Arm, q0: npt.ArrayLike | None = None) -> tuple[int, Array] | None:
        """The index of the swept joint of an arm of seven, and its values (v,) (rad or m); None for other arms.

        Raises
        ------
        NoClosedForm, InputError
            As :meth:`solve_all`.
        """
        plan = self._plan(arm)
        if len(plan.redundant) != 1:
            return None
        return plan.redundant[0], self._grid(arm, plan, _reference(arm, plan, q0))

    def _grid(self, arm: Arm, plan: Plan, reference: Array) -> Array:
        """Values (v,) or (v, 2) of the redundant joints: equidistant over the limits, and those of the reference."""
        steps = max(round(self.redundant_steps ** (1 / len(plan.redundant))), 2)
        axes = []
        for joint in plan.redundant:
            lower, upper = (float(bound[joint]) for bound in arm.limits.sampling_range())
            own = float(np.clip(reference[joint], lower, upper))
            axes.append(np.unique(np.append(np.linspace(lower, upper, steps), own)))
        return axes[0] if len(axes) == 1 else np.array(list(product(*axes)))


def _stated(arm: Arm, plan: Plan, values: npt.ArrayLike) -> Array:
    """The stated values (v,) of the redundant joint, or (v, 2) of two; InputError if the arm has none."""
    count = len(plan.redundant)
    if not count:
        raise InputError(f"redundant_values requires an arm of 7 or 8 joints, and this arm has {arm.dof}; omit it")
    if count == 1:
        return finite("redundant_values", np.atleast_1d(np.asarray(values)), (None,))
    return finite("redundant_values", np.atleast_2d(np.asarray(values)), (None, count))


def _reference(arm: Arm, plan: Plan, q0: npt.ArrayLike | None) -> Array:
    """(n,) the reference configuration."""
    return plan.home if q0 is None else arm.limits.snap(arm.configuration(q0, "q0"))


def _references(arm: Arm, plan: Plan, q0: npt.ArrayLike | None, count: int) -> Array:
    """(1, n) or (count, n) the reference configurations."""
    if q0 is None or np.ndim(q0) <= 1:
        return _reference(arm, plan, q0)[None]
    return arm.limits.snap(finite("q0", q0, (count, arm.dof)))


def _poses(targets: npt.ArrayLike | Sequence[SE3]) -> Array:
    """The targets as an array (N, 4, 4) for the compiled core, which checks itself whether they are rigid."""
    plain = isinstance(targets, np.ndarray) and targets.dtype is DOUBLE and targets.flags.carray
    if plain and targets.ndim == 3 and targets.shape[1:] == SHAPE:  # type: ignore[union-attr]  # plain is an array
        return targets  # type: ignore[return-value]
    return rigid_many("targets", targets)
