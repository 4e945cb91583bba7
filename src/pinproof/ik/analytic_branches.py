"""Results of the closed form for one and for many targets, and the sweep over redundant joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from pinproof import _core
from pinproof.common.results import Rows, View
from pinproof.common.structs import described, key
from pinproof.ik.analytic_plan import Plan, plan_for
from pinproof.ik.analytic_self_motion import IkFamily, branches_elsewhere, families_of
from pinproof.ik.result import TURN, IkAnswer, nearest_winding
from pinproof.model import AT_LIMIT, Arm
from pinproof.spatial import Array, rigid, rigid_matrix
from pinproof.units import far_hint

END = 1e-9
"""Rad or m: accuracy of the ends of an interval."""

BLOCK = 256
"""Number of targets that are swept at a time, which bounds the memory for their branches."""


@dataclass(frozen=True)
class Interval:
    """An interval from ``lower`` to ``upper`` of the redundant joint in which the number of branches is constant."""

    lower: float
    upper: float
    branches: int


def joined(intervals: tuple[Interval, ...]) -> list[tuple[float, float]]:
    """Lower and upper ends of the ranges with solutions: adjacent intervals are merged."""
    spans: list[tuple[float, float]] = []
    for one in intervals:
        if spans and one.lower - spans[-1][1] <= 2 * END:
            spans[-1] = (spans[-1][0], one.upper)
        else:
            spans.append((one.lower, one.upper))
    return spans


def branches_at(plan: Plan, target: Array, reference: Array, grid: Array) -> tuple[_core.Branches, Array]:
    """The branches at the values of the redundant joints, nearest to the reference first, and their number for each."""
    q, errors, counts, _ = sweep_many(plan, target[None], reference[None], grid[None])
    order = np.argsort(np.abs(q - reference).max(axis=1, initial=0.0), kind="stable")
    return _core.Branches(q[order], errors[order]), counts[0]


def intervals_of(plan: Plan, target: Array, reference: Array, values: Array, counts: Array) -> tuple[Interval, ...]:
    """The intervals between the values (v,) of the redundant joint at which the numbers of branches are ``counts``.

    An interval ends where the number of branches changes between two adjacent values; branches that appear and
    disappear between two values are not found.
    """

    def count_at(value: float) -> int:
        return len(plan.solve(target, reference, value))

    intervals, start, count = [], float(values[0]), int(counts[0])
    for i in range(len(values) - 1):
        low = float(values[i])
        while count != counts[i + 1]:
            # bisection to where the count ends
            high = float(values[i + 1])
            while high - low > END:
                middle = (low + high) / 2
                low, high = (middle, high) if count_at(middle) == count else (low, middle)
            intervals.append(Interval(start, low, count))
            # The count may differ from that at the next grid value, as several changes may lie between two values.
            start = low = high
            count = count_at(high)
    intervals.append(Interval(start, float(values[-1]), count))
    return tuple(one for one in intervals if one.branches)


def sweep_many(
    plan: Plan, targets: Array, references: Array, values: Array
) -> tuple[Array, Array, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """The branches for targets (N, 4, 4) at values (1, v) or (N, v) of the redundant joint, or (1, v, 2) of two.

    Returns q (b, n) and errors (b, 2), ordered by target and value, the number of branches for each target and value
    (N, v), and the number of further branches outside the limits (N, v).
    """
    counts, outside = np.zeros((2, len(targets), values.shape[1]), dtype=np.int64)
    found, missed = [np.empty((0, plan.dof))], [np.empty((0, 2))]
    for first in range(0, len(targets), BLOCK):
        rows = slice(first, first + BLOCK)
        reference, value = (each if len(each) == 1 else each[rows] for each in (references, values))
        value = value.reshape(*value.shape[:2], len(plan.redundant))
        q, errors, number, outside[rows], _ = plan.core.solve_batch(targets[rows], reference, value, plan.capacity)
        counts[rows] = np.maximum(number, 0)  # negative codes: the sweep covers other values of free joints
        exists = np.arange(plan.capacity) < counts[rows, :, None]
        found.append(q[exists])
        missed.append(errors[exists])
    return np.concatenate(found), np.concatenate(missed), counts, outside


class IkBranches(IkAnswer):
    """All IK solutions of an arm for one target, within its limits.

    ``branches`` (b, n) are distinct modulo 2 pi: all combinations of shoulder, elbow and wrist, each shifted by
    multiples of 2 pi to be closest to q0 (by default ``arm.home``). ``q`` (k, n) contains in addition every other
    rotation by 2 pi that the limits permit (for joints without limits, only the one closest to q0). Both are sorted by
    the largest joint difference from q0. Attributes are computed when they are first read.

    For up to six joints these are all solutions. If joints are free to move at a singular target, each such motion is
    one of the ``families``, and its member at q0 is one of the ``branches``. For seven and eight joints, ``branches``
    are those at the values of ``grid`` of the redundant joints, and if one joint is swept, ``intervals`` give their
    number in between.

    Parameters
    ----------
    arm
        The arm.
    target
        (4, 4) the pose, rigid up to rounding.
    reference
        (n,) q0.
    found
        The branches of the compiled core, nearest to q0 first.
    intervals, grid
        The intervals with a constant number of branches of seven joints, and the values (v,) of the redundant joint, or
        (v, 2) of two.
    """

    # Values of most results, which the constructor does not set again: it takes a tenth of the time of a solution.
    grid: Array | None = None
    intervals: tuple[Interval, ...] = ()
    _swept = True
    _branches: Array | None = None  # computed when first read
    _selected: tuple[int, ...] | None = None  # the indices that remain of all branches; None for all

    def __init__(
        self,
        arm: Arm,
        plan: Plan,
        target: Array,
        reference: Array,
        found: _core.Branches,
        intervals: tuple[Interval, ...] = (),
        grid: Array | None = None,
        *,
        swept: bool = True,
    ) -> None:
        self.arm, self._plan, self._stated, self.reference, self._found = arm, plan, target, reference, found
        if grid is not None:
            self.grid, self.intervals, self._swept = grid, intervals, swept

    @cached_property
    def target(self) -> Array:
        """(4, 4) the pose, with an exact rotation."""
        return rigid_matrix("target", self._stated)

    @classmethod
    def solved(
        cls, arm: Arm, plan: Plan, target: Array, reference: Array, grid: Array | None = None, *, swept: bool = True
    ) -> IkBranches:
        """All branches; ``grid`` are the values of the redundant joints, between which one that is swept has others."""
        if grid is not None:
            at_values, counts = branches_at(plan, target, reference, grid)
            swept = swept and grid.ndim == 1
            intervals = intervals_of(plan, target, reference, grid, counts) if swept else ()
            return cls(arm, plan, target, reference, at_values, intervals, grid, swept=swept)
        found = plan.core.solve(target, reference)
        if not found and (found is None or found.all_free_joints):
            rigid("target", target)  # raises with the reason
            found = branches_elsewhere(arm, plan, target, reference)
        return cls(arm, plan, target, reference, found)

    def _values(self) -> tuple[object, ...]:
        return self.arm, self._plan.tolerances, self.target, self.reference, self.grid, self._swept, self._selected

    def __reduce__(self) -> tuple[object, ...]:
        return _solved_again, self._values()  # the objects of the core are not pickled

    @property
    def branches(self) -> Array:
        """(b, n) the solutions that are distinct modulo 2 pi, read-only."""
        # The lock of cached_property would take a tenth of the time of a solution.
        if self._branches is None:
            self._branches = self._found.q
        return self._branches

    @cached_property
    def _expanded(self) -> tuple[Array, npt.NDArray[np.int64]]:
        arm, rows, source = self.arm, [np.empty((0, self._plan.dof))], list[int]()
        for index, branch in enumerate(self.branches):
            # all shifts of the periodic joints by 2 pi that the limits permit
            choices = []
            for joint, value in enumerate(branch.tolist()):
                lower, upper = arm.limits.lower[joint], arm.limits.upper[joint]
                if not arm.periodic[joint] or not np.isfinite(upper - lower):
                    choices.append([value])
                    continue
                fewest, most = np.ceil((lower - AT_LIMIT - value) / TURN), np.floor((upper + AT_LIMIT - value) / TURN)
                turns = {0.0, *np.arange(fewest, most + 1).tolist()}
                choices.append([min(max(value + k * TURN, lower), upper) if k else value for k in sorted(turns)])
            rows.append(np.array(list(product(*choices))).reshape(-1, arm.dof))
            source += [index] * len(rows[-1])
        q = np.concatenate(rows)
        order = np.argsort(np.abs(q - self.reference).max(axis=1, initial=0.0), kind="stable")
        q = q[order]
        q.setflags(write=False)
        return q, np.array(source, dtype=np.int64)[order]

    @property
    def q(self) -> Array:
        """(k, n) every branch with every rotation by 2 pi within the limits, read-only."""
        return self._expanded[0]

    @property
    def position_error(self) -> Array:
        """(k,) distance (m) of the tcp from the target at each row of :attr:`q`, by forward kinematics."""
        return np.asarray(self.errors[:, 0])

    @property
    def orientation_error(self) -> Array:
        """(k,) angle (rad) between the orientations of tcp and target at each row of :attr:`q`."""
        return np.asarray(self.errors[:, 1])

    @cached_property
    def errors(self) -> Array:
        """(k, 2) :attr:`position_error` (m) and :attr:`orientation_error` (rad)."""
        return np.asarray(self._found.errors[self._expanded[1]])

    @cached_property
    def _families(self) -> tuple[tuple[IkFamily, ...], bool]:
        """The families, and whether each solution with a free joint belongs to one of them."""
        if self._plan.redundant or not self._found.all_free_joints:
            return (), True
        families, all_met = families_of(self.arm, self._plan, self.target, self.reference, self._found)
        return tuple(families), all_met

    @property
    def families(self) -> tuple[IkFamily, ...]:
        """The self-motions at a singular target at which joints are free; empty for most targets."""
        return self._families[0]

    @property
    def ok(self) -> bool:
        """Whether there is at least one solution."""
        return len(self._found) > 0

    @property
    def complete(self) -> bool:
        """Whether these are proven to be all solutions.

        This is the case for up to six joints, unless a candidate close to a double root failed its check, or joints are
        free at the target and no member of their family was found or the family ends where neither a limit nor a fold
        explains it, or two joints are free independently of each other. Arms that are solved by elimination must
        account for all 16 eigenvalues, and have no proof at targets that are singular for one of the solutions.
        """
        found = self._found
        if self._plan.redundant or found.failed or found.doubtful:
            return False
        return not found.all_free_joints or (self.ok and self._families[1])

    @property
    def outside(self) -> int:
        """Number of solutions outside the limits, which are not among :attr:`branches`."""
        return int(self._found.outside)

    @property
    def redundant_joints(self) -> tuple[str, ...]:
        """The joints at whose values in ``grid`` the arm is solved: one of seven, two of eight, else none."""
        return tuple(self.arm.joint_names[joint] for joint in self._plan.redundant)

    @property
    def message(self) -> str:
        """The number of branches, and the reason if no solution was found, as text."""
        count, outside, failed = len(self._found), self._found.outside, self._found.failed
        if self.grid is not None:
            names = " and ".join(self.redundant_joints)
            if not self._swept:
                return f"{count} configurations at {len(self.grid)} values of {names}"
            spans = ", ".join(f"[{low:.4g}, {high:.4g}]" for low, high in joined(self.intervals))
            where = f"solutions exist for its values in {spans}" if spans else "no value has a solution"
            return f"{count} configurations over a sweep of {names}; {where}"
        text = f"{count} branch{'' if count == 1 else 'es'}"
        if outside:
            text += f", {outside} more outside the limits"
        if failed:
            text += f", {failed} not confirmed by forward kinematics"
        if self.families:
            text += f", {len(self.families)} of them with a free joint"
        # without a branch, the reason
        if count:
            return text
        if outside:
            return f"{text}: the joint limits exclude every solution; move the target or widen the limits"
        short = self.arm.dof < 6
        why = f"an arm of {self.arm.dof} joints reaches few poses exactly" if short else "the target is out of reach"
        far = far_hint(float(np.linalg.norm(self.target[:3, 3])), self.arm.robot.size)
        return f"{text}: {why}; use Clik to get the closest configuration and its residual{far}"

    def nearest(self, q: npt.ArrayLike) -> Array:
        """(n,) the solution with the smallest largest joint difference from ``q`` (n,), including shifts by 2 pi.

        Raises
        ------
        IkFailed
            If there is no solution.
        """
        self.or_raise()
        reference = self.arm.configuration(q)
        choice = [*nearest_winding(self.arm, self.branches, reference)]
        choice += [nearest_winding(self.arm, family.nearest(reference), reference) for family in self.families]
        return np.array(min(choice, key=lambda one: float(np.abs(one - reference).max())))

    def free(self, accept: Callable[[Array], bool]) -> IkBranches:
        """The branches for which ``accept`` returns True; it is called with a copy of each of :attr:`branches`.

        Rotations by 2 pi do not change the pose of any link, so they are accepted or rejected together.
        """
        return self._select([i for i, branch in enumerate(self.branches) if accept(branch.copy())])

    def _select(self, indices: list[int]) -> IkBranches:
        found = self._found.select(indices)
        known = self.target, self.reference, found, self.intervals, self.grid
        some = IkBranches(self.arm, self._plan, *known, swept=self._swept)
        some._selected = tuple(indices if self._selected is None else (self._selected[i] for i in indices))
        return some

    def __len__(self) -> int:
        return len(self.q)

    def __iter__(self) -> Iterator[Array]:
        return iter(self.q)

    def _view(self) -> View:
        errors = zip(self.q, self.position_error, self.orientation_error, strict=True)
        rows = ([number, *q, *rest] for number, (q, *rest) in enumerate(errors))
        columns = ("branch", *self.arm.joint_names, "position error [m]", "orientation error [rad]")
        title = f"IK branches of {self.arm.robot.name} (rad or m): {self.message}"
        return View(self.message, [Rows(columns, rows, len(self))], title=title)


def _solved_again(
    arm: Arm,
    tolerances: tuple[float, float],
    target: Array,
    reference: Array,
    grid: Array | None,
    swept: bool,
    selected: tuple[int, ...] | None,
) -> IkBranches:
    every = IkBranches.solved(arm, plan_for(arm, *tolerances), target, reference, grid, swept=swept)
    return every if selected is None else every._select(list(selected))


@described(eq=False)
class IkBranchesBatch:
    """The branches for N targets."""

    q: Array = key(
        "(N, k, n) distinct branches, each shifted by 2 pi to be closest to q0; NaN where a target has fewer than k"
    )
    count: npt.NDArray[np.int64] = key("(N,) number of branches of each target")
    position_error: Array = key("(N, k) by forward kinematics; NaN where a target has fewer than k branches", "m")
    orientation_error: Array = key("(N, k) the same", "rad")
    outside: npt.NDArray[np.int64] = key(
        "(N,) number of further branches that violate the limits; for a swept joint, at the values of the sweep"
    )
    complete: npt.NDArray[np.bool_] = key(
        "(N,) whether these are proven to be all solutions of the target. False if joints are free at the target: "
        ":attr:`IkBranches.families` contains the other solutions"
    )

    @property
    def ok(self) -> npt.NDArray[np.bool_]:
        """(N,) which targets have a solution."""
        return np.asarray(self.count > 0)

    def __len__(self) -> int:
        return len(self.q)
