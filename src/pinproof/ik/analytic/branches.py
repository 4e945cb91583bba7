"""Every configuration of an arm for one pose, and for many: what the closed form answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from pinproof.errors import IkFailed
from pinproof.ik.analytic.family import IkFamily, families_of
from pinproof.ik.analytic.plan import Plan
from pinproof.ik.analytic.sweep import Interval, joined
from pinproof.ik.windings import TURN, nearest_winding
from pinproof.model import Arm

__all__ = ["IkBranches", "IkBranchesBatch"]

Array = npt.NDArray[np.float64]


class IkBranches:
    """All configurations inside the limits that bring an arm's tcp to a target.

    ``branches`` (b, n) are distinct modulo whole turns: every elbow, shoulder and wrist, each with the whole turns
    nearest to the q0 that was given (else to ``arm.home``). ``q`` (k, n) adds every whole turn that the limits leave to
    each joint (of a joint without limits, the nearest to q0 alone). Both are sorted, the nearest to q0 (largest joint
    difference) first. Everything is worked out when it is asked for.

    For six joints and fewer these are all there are; where some joints are free to move at this very target, each such
    motion is among the ``families``, and its member at q0 among the ``branches``. Of seven joints, the redundant one
    was swept: ``branches`` are those at the values of ``grid``, and ``intervals`` say how many there are in between.

    Parameters
    ----------
    arm
        Whose configurations these are.
    target
        (4, 4) the pose.
    reference
        (n,) q0.
    out, count
        (c + 1, n + 4) as the kernel wrote it: ``count`` rows of q, distance (m), angle (rad), free joints (bits) and
        which solution; in the last row free joints, branches that failed the check, branches outside the limits,
        whether a quartic was solved, and what was left in doubt.
    grid, intervals
        Of seven joints: the values that the redundant one was given, and where it has how many branches.
    """

    def __init__(
        self,
        arm: Arm,
        plan: Plan,
        target: Array,
        reference: Array,
        out: Array,
        count: int,
        grid: Array | None = None,
        intervals: tuple[Interval, ...] = (),
    ) -> None:
        self.arm, self._plan, self.target, self.reference = arm, plan, target, reference
        self._out, self._count, self.grid, self.intervals = out, count, grid, intervals

    @cached_property
    def rows(self) -> Array:
        """(b, n + 4) as the kernel wrote them, the nearest to q0 first."""
        rows = self._out[: self._count]
        away = np.abs(rows[:, : self._plan.dof] - self.reference).max(axis=1, initial=0.0)
        return rows[np.argsort(away, kind="stable")]

    @property
    def _tail(self) -> Array:
        return np.asarray(self._out[-1])

    @cached_property
    def branches(self) -> Array:
        """(b, n) distinct modulo whole turns, read-only."""
        return _locked(self.rows[:, : self._plan.dof].copy())

    @cached_property
    def _expanded(self) -> tuple[Array, npt.NDArray[np.int64]]:
        rows, source = [], []
        for index, branch in enumerate(self.branches):
            turned = _windings(self.arm, branch)
            rows.append(turned)
            source += [index] * len(turned)
        q = np.concatenate(rows) if rows else np.empty((0, self._plan.dof))
        order = np.argsort(np.abs(q - self.reference).max(axis=1, initial=0.0), kind="stable")
        return _locked(q[order]), np.array(source, dtype=np.int64)[order]

    @property
    def q(self) -> Array:
        """(k, n) every branch with every whole turn inside the limits, read-only."""
        return self._expanded[0]

    @property
    def position_error(self) -> Array:
        """(k,) distance (m) of the tcp from the target at each row of :attr:`q`, by forward kinematics."""
        return np.asarray(self.rows[self._expanded[1], self._plan.dof])

    @property
    def orientation_error(self) -> Array:
        """(k,) angle (rad) between them."""
        return np.asarray(self.rows[self._expanded[1], self._plan.dof + 1])

    @property
    def errors(self) -> Array:
        """(k, 2) distances (m) and angles (rad)."""
        return np.stack([self.position_error, self.orientation_error], axis=1)

    @cached_property
    def _families(self) -> tuple[tuple[IkFamily, ...], bool]:
        """The families, and whether each solution with a free joint belongs to one of them."""
        if self._plan.redundant is not None or not self._tail[0]:
            return (), True
        found, all_met = families_of(self.arm, self._plan, self.target, self.reference, self.rows, self._tail)
        return tuple(found), all_met

    @property
    def families(self) -> tuple[IkFamily, ...]:
        """The motions that leave the pose, of a target at which some joints are free; most targets have none."""
        return self._families[0]

    @property
    def ok(self) -> bool:
        """Whether there is any."""
        return self._count > 0

    @property
    def complete(self) -> bool:
        """Whether these are proven to be all.

        So it is for six joints and fewer of exact geometry, with these exceptions: a branch that may exist by a hair
        failed its check; joints are free at the target, and no member of their family was found, or two joints are
        free independently of each other.
        """
        if self._plan.redundant is not None or self._plan.miss > 0.0 or self._tail[1] or int(self._tail[4]) & 1:
            return False
        return not self._tail[0] or (self.ok and self._families[1])

    @property
    def redundant_joint(self) -> str | None:
        """The joint that was swept, of an arm of seven."""
        return None if self._plan.redundant is None else self.arm.joint_names[self._plan.redundant]

    @property
    def message(self) -> str:
        """The answer in words."""
        count = self._count
        if self._plan.redundant is not None:
            spans = ", ".join(f"[{low:.4g}, {high:.4g}]" for low, high in joined(self.intervals)) or "nowhere"
            return f"{count} configurations over a sweep of {self.redundant_joint}; there are some in {spans}"
        said = f"{count} branch{'' if count == 1 else 'es'}"
        if self._tail[2]:
            said += f", {int(self._tail[2])} more outside the limits"
        if self._tail[1]:
            said += f", {int(self._tail[1])} that forward kinematics did not confirm"
        if self.families:
            said += f", {len(self.families)} of them free to move"
        if count:
            return said
        if self._tail[2]:
            return f"{said}: the limits stand in the way"
        short = self.arm.dof < 6
        why = f"{self.arm.dof} joints reach few poses exactly" if short else "out of reach"
        return f"{said}: {why}; Clik gives the nearest configuration and how far it is off"

    def nearest(self, q: npt.ArrayLike) -> Array:
        """(n,) the configuration whose largest joint difference from ``q`` (n,) is smallest, whole turns considered.

        Raises
        ------
        IkFailed
            If there is none.
        """
        self.or_raise()
        reference = self.arm.configuration(q)
        choice = [*nearest_winding(self.arm, self.branches, reference)]
        choice += [nearest_winding(self.arm, family.nearest(reference), reference) for family in self.families]
        return np.array(min(choice, key=lambda one: float(np.abs(one - reference).max())))

    def free(self, accept: Callable[[Array], bool]) -> IkBranches:
        """Those of the branches that ``accept`` takes; it is called with a copy of each of :attr:`branches`.

        Whole turns do not change where any link is, so they are taken or refused together.
        """
        taken = np.array([bool(accept(branch.copy())) for branch in self.branches], dtype=bool)
        return IkBranches(
            self.arm,
            self._plan,
            self.target,
            self.reference,
            np.vstack([self.rows[taken], self._tail]),
            int(taken.sum()),
            self.grid,
            self.intervals,
        )

    def or_raise(self) -> IkBranches:
        """The branches themselves if there are any.

        Raises
        ------
        IkFailed
            If there are none; ``.result`` of the error is this value.
        """
        if not self.ok:
            raise IkFailed(self.message, self)
        return self

    def __len__(self) -> int:
        return len(self.q)

    def __iter__(self) -> Iterator[Array]:
        return iter(self.q)

    def __repr__(self) -> str:
        return f"IkBranches({self.message})"


@dataclass(frozen=True, eq=False)
class IkBranchesBatch:
    """The branches for N targets.

    Parameters
    ----------
    q
        (N, k, n) distinct branches, each with the whole turns nearest to q0; NaN where a target has fewer than k.
    count
        (N,) how many each has.
    position_error, orientation_error
        (N, k) in m and rad, by forward kinematics; NaN likewise.
    outside
        (N,) how many more there would be if limits were left aside; of a swept joint, at the values swept.
    complete
        (N,) whether these are proven to be all the configurations of the target. Not where joints are free at it:
        :attr:`IkBranches.families` has the others.
    """

    q: Array
    count: npt.NDArray[np.int64]
    position_error: Array
    orientation_error: Array
    outside: npt.NDArray[np.int64]
    complete: npt.NDArray[np.bool_]

    @property
    def ok(self) -> npt.NDArray[np.bool_]:
        """(N,) which targets have a solution."""
        return np.asarray(self.count > 0)

    def __len__(self) -> int:
        return len(self.q)


def _windings(arm: Arm, branch: Array) -> Array:
    """(w, n) the branch with every whole turn of its periodic joints that the limits leave."""
    choices = []
    for joint, value in enumerate(branch.tolist()):
        lower, upper = arm.limits.lower[joint], arm.limits.upper[joint]
        if not arm.periodic[joint] or not np.isfinite(upper - lower):
            choices.append([value])
            continue
        fewest, most = np.ceil((lower - value) / TURN), np.floor((upper - value) / TURN)
        turns = {0.0, *np.arange(fewest, most + 1).tolist()}
        choices.append([min(max(value + k * TURN, lower), upper) if k else value for k in sorted(turns)])
    return np.array(list(product(*choices))).reshape(-1, arm.dof)


def _locked(array: Array) -> Array:
    array.setflags(write=False)
    return array
