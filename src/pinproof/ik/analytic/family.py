"""Where joints are free to move and the tcp stays: the whole family of configurations of a singular target."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.ik.analytic.plan import Plan
from pinproof.ik.windings import TURN, difference
from pinproof.model import Arm

__all__ = ["IkFamily", "branches_elsewhere", "families_of"]

Array = npt.NDArray[np.float64]

SCAN = 72
"""Values of the parameter looked at over its range, to find where the family ends."""

END = 1e-9
"""Rad or m: how closely ends are told."""

FINE_SCAN = 720
"""The same where families are known to exist, of which the first values have no member."""

COARSE_SCAN = 24
"""The same for each of two joints that are both free."""

DOUBLY_SINGULAR = 1e-6
"""Of the second smallest singular value of the Jacobian: below, its null space has more motions than the family's."""

STEP = 1e-4
"""Rad or m: the step of the difference quotient that the family's motion is then taken from."""

MOVES = 1e-6
"""A joint whose part of the unit direction is larger moves along the family."""


SAME = 1e-5
"""Rad or m. Configurations nearer than this are one member."""


@dataclass(frozen=True, eq=False)
class IkFamily:
    """Configurations of an arm that all have their tcp at the same singular target, along one free motion.

    Parameters
    ----------
    parameter
        The joint whose value tells the members apart.
    joints
        The joints that move along the family.
    q
        (n,) the member at q0's value of the parameter.
    direction
        (n,) the unit motion at ``q`` that leaves the pose; constant for a straight wrist, not for four parallel axes.
    lower, upper
        The range of the parameter (rad or m) around ``q`` in which members exist inside the limits.
    """

    parameter: str
    joints: tuple[str, ...]
    q: Array
    direction: Array
    lower: float
    upper: float
    _arm: Arm
    _plan: Plan
    _target: Array
    _which: float

    @classmethod
    def at_branch(cls, arm: Arm, plan: Plan, target: Array, row: Array, joint: int) -> IkFamily:
        """The family of a branch (a kernel's row) of which joint number ``joint`` is free."""
        n = plan.dof
        q = row[:n].copy()
        _, values, motions = np.linalg.svd(arm.jacobian(q))
        direction = motions[-1]
        if (
            n >= 2 and len(values) >= n and values[-2] < DOUBLY_SINGULAR
        ):  # the Jacobian loses two: which is the family's?
            family = cls(arm.joint_names[joint], (), q, direction, 0.0, 0.0, arm, plan, target, float(row[n + 3]))
            direction = family._tangent(float(q[joint]), direction)
        direction = direction * (1.0 if direction[joint] >= 0 else -1.0)
        moving = tuple(name for name, part in zip(arm.joint_names, direction, strict=True) if abs(part) > MOVES)
        lower, upper = arm.limits.sampling_range()
        low, high = min(lower[joint], q[joint]), max(upper[joint], q[joint])
        family = cls(arm.joint_names[joint], moving, q, direction, low, high, arm, plan, target, float(row[n + 3]))
        lower_end, upper_end = (family._end(float(q[joint]), float(bound)) for bound in (low, high))
        return replace(family, lower=lower_end, upper=upper_end)

    def at(self, value: float) -> Array:
        """(n,) the member at a value of the parameter.

        Raises
        ------
        InputError
            If there is none inside the limits.
        """
        member = self._member(float(value))
        if member is None:
            raise InputError(
                f"no member at {self.parameter} = {value:g}; the family runs from {self.lower:g} to {self.upper:g}"
            )
        return member

    def nearest(self, q: npt.ArrayLike) -> Array:
        """(n,) the member whose largest joint difference from q (n,) is smallest (found to 1e-6 of the range)."""
        goal = self._arm.configuration(q)

        def away(value: float) -> float:
            member = self._member(value)
            return np.inf if member is None else float(np.abs(member - goal).max())

        values = np.linspace(self.lower, self.upper, SCAN + 1)
        best = int(np.argmin([away(value) for value in values]))
        low, high = values[max(best - 1, 0)], values[min(best + 1, SCAN)]
        while high - low > 1e-6 * max(self.upper - self.lower, END):
            third = (high - low) / 3
            if away(low + third) <= away(high - third):
                high -= third
            else:
                low += third
        choice = [self._member(float(value)) for value in ((low + high) / 2, values[best])]
        members = [self.q, *(one for one in choice if one is not None)]
        return min(members, key=lambda one: float(np.abs(one - goal).max()))

    def holds(self, row: Array) -> bool:
        """Whether a branch (a kernel's row) is a member."""
        value = float(row[self._arm.joint_names.index(self.parameter)])
        if not self.lower - MOVES <= value <= self.upper + MOVES:
            return False
        member = self._member(value)
        return member is not None and bool(np.abs(difference(self._arm, member, row[: self._plan.dof])).max() < SAME)

    def _tangent(self, value: float, otherwise: Array) -> Array:
        """(n,) the unit motion of the members at a value of the parameter; ``otherwise`` if none is beside it."""
        for step in (STEP, -STEP):
            member = self._member(value + step)
            if member is not None:
                motion = difference(self._arm, member, self.q) / step
                return np.asarray(motion / np.linalg.norm(motion))
        return otherwise

    def _end(self, inside: float, bound: float) -> float:
        """How far the family goes from ``inside`` towards ``bound``."""
        values = np.linspace(inside, bound, SCAN + 1)
        low = inside
        for value in values[1:].tolist():
            if self._member(value) is None:
                break
            low = value
        else:
            return bound
        high = value
        while abs(high - low) > END:
            middle = (low + high) / 2
            low, high = (middle, high) if self._member(middle) is not None else (low, middle)
        return low

    def _member(self, value: float) -> Array | None:
        plan, n = self._plan, self._plan.dof
        reference = self.q.copy()
        reference[self._arm.joint_names.index(self.parameter)] = value
        out = np.empty(plan.shape)
        count = plan.kernel(plan.array, self._target, reference, 0.0, out)
        for row in out[:count]:
            at_value = abs(row[self._arm.joint_names.index(self.parameter)] - value) < MOVES
            if row[n + 3] == self._which and row[n + 2] and at_value:
                return np.array(row[:n])
        return None


def branches_elsewhere(arm: Arm, plan: Plan, target: Array, reference: Array, out: Array) -> tuple[Array, int]:
    """What the kernel wrote, and its count, at other values of the free joints: at the nearest that has branches.

    For targets at which joints are free, and have no branch inside the limits at their values in ``reference``. Looks
    at SCAN values of one joint, then at FINE_SCAN; at COARSE_SCAN of two.
    """
    joints = _free(out)[:2]
    for many in (SCAN, FINE_SCAN) if len(joints) == 1 else (COARSE_SCAN,):
        found, count = _nearest_with_branches(arm, plan, target, reference, joints, many)
        if count:
            return found, count
    return out, 0


def _nearest_with_branches(
    arm: Arm, plan: Plan, target: Array, reference: Array, joints: list[int], many: int
) -> tuple[Array, int]:
    """What the kernel wrote, and its count, at the nearest of ``many`` values of each joint that has branches."""
    lower, upper = arm.limits.sampling_range()
    values = [np.linspace(lower[joint], upper[joint], many + 1) for joint in joints]
    grid = np.stack([one.ravel() for one in np.meshgrid(*values, indexing="ij")], axis=1)
    away = np.abs(grid - reference[joints]).max(axis=1)
    for index in np.argsort(away, kind="stable"):
        moved, found = reference.copy(), np.empty(plan.shape)
        moved[joints] = grid[index]
        count = plan.kernel(plan.array, target, moved, 0.0, found)
        if count:
            return found, count
    return found, 0


def families_of(
    arm: Arm, plan: Plan, target: Array, reference: Array, rows: Array, tail: Array
) -> tuple[list[IkFamily], bool]:
    """Those that the kernel's ``rows`` belong to, and those that have no member at q0's value of their parameter.

    Each joint that ``tail`` says is free is looked at SCAN values of its range, with the others at q0's; at FINE_SCAN
    values, if solutions that the kernel knows to have a free joint were not met. The second value is whether all of
    them were met in the end: else there may be families in narrower ranges.
    """
    lower, upper = arm.limits.sampling_range()
    found: list[IkFamily] = []
    missing, n = int(tail[4]) >> 1, plan.dof
    for scan in (SCAN, FINE_SCAN):
        if scan == FINE_SCAN:
            missing &= ~_outside_everywhere(arm, plan, target, reference, tail)
            if not missing:
                break
        for joint in _free(tail[None]):
            name = arm.joint_names[joint]
            here = [row for row in rows if int(row[n + 2]) >> joint & 1] if scan == SCAN else []
            before = [one for one in found if one.parameter == name]
            more = [IkFamily.at_branch(arm, plan, target, row, joint) for row in here]
            out, moved = np.empty(plan.shape), reference.copy()
            for value in np.linspace(lower[joint], upper[joint], scan + 1).tolist():
                moved[joint] = value
                count = plan.kernel(plan.array, target, moved, 0.0, out)
                missing &= int(out[-1, 4]) >> 1
                for row in out[:count].copy():
                    if int(row[n + 2]) >> joint & 1 and not any(one.holds(row) for one in (*before, *more)):
                        more.append(IkFamily.at_branch(arm, plan, target, row, joint))
            found += more
            if scan == FINE_SCAN and not missing:
                break
    return found, not missing


def _outside_everywhere(arm: Arm, plan: Plan, target: Array, reference: Array, tail: Array) -> int:
    """Of the solutions that ``tail`` has in doubt, those that some joint keeps outside its limits, whatever is free.

    That is taken for proven where at all of SCAN values one joint is further outside than it moves between neighbours.
    """
    wide, n = plan.without_limits(), plan.dof
    lower, upper = arm.limits.sampling_range()
    outside = -1
    for joint in _free(tail[None]):
        met: dict[int, list[Array]] = {}
        out, moved, unmet = np.empty(wide.shape), reference.copy(), 0
        for value in np.linspace(lower[joint], upper[joint], SCAN + 1).tolist():
            moved[joint] = value
            count = wide.kernel(wide.array, target, moved, 0.0, out)
            unmet |= int(out[-1, 4]) >> 1
            for row in out[:count]:
                if int(row[n + 2]) >> joint & 1:
                    met.setdefault(_number(row[n + 3]), []).append(row[:n].copy())
        proven = 0
        for number, members in met.items():
            q = np.array(members)
            away = _away(arm, q)
            steps = np.abs(difference(arm, q[1:], q[:-1])).max(axis=0, initial=0.0)
            if len(q) > SCAN and (away.min(axis=0) > steps + MOVES).any():
                proven |= 1 << number
                other = number ^ 1  # the second root of the middle joint, which is left out where both are one
                if other not in met and not unmet >> other & 1:
                    proven |= 1 << other
        outside &= proven
    return outside


def _away(arm: Arm, q: Array) -> Array:
    """(k, n) how far each joint of q (k, n) is outside its limits, with the whole turns that bring it nearest."""
    lower, upper = arm.limits.lower, arm.limits.upper
    below, above = lower - q, q - upper
    away = np.maximum(np.maximum(below, above), 0.0)
    turns = np.where(below > 0.0, np.ceil(below / TURN), np.where(above > 0.0, -np.ceil(above / TURN), 0.0))
    for turn in (turns, turns - np.sign(turns)):
        other = q + turn * TURN
        nearer = np.maximum(np.maximum(lower - other, other - upper), 0.0)
        away = np.where(arm.periodic, np.minimum(away, nearer), away)
    return np.asarray(away)


def _number(name: float) -> int:
    """The bit of a solution among those in doubt, by its name: as in :mod:`pinproof.kernels.branches`."""
    return int(name) % 1000 % 200 + (16 if name >= 200.0 else 0)


def _free(out: Array) -> list[int]:
    """The joints that the last row, a kernel's, says are free."""
    bits = int(out[-1, 0])
    return [joint for joint in range(bits.bit_length()) if bits >> joint & 1]
