"""One-parameter families of IK solutions at singular targets, where joints move while the tcp is at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof import _core
from pinproof.errors import InputError
from pinproof.ik.analytic.plan import Plan
from pinproof.ik.jacobian_methods import Clik
from pinproof.ik.windings import TURN, difference
from pinproof.model import Arm
from pinproof.spatial import Array

SCAN = 72
"""Number of values of the parameter over its range at which members are computed to find the ends of the family."""

END = 1e-9
"""Rad or m: accuracy of the ends."""

FINE_SCAN = 720
"""Number of values if families are known to exist and no member was found at SCAN values."""

COARSE_SCAN = 24
"""Number of values for each of two joints that are both free."""

SEARCHED = 1e-10
"""M and rad: tolerance of the numerical solution whose free joints are tried if no scanned value has branches."""

DOUBLY_SINGULAR = 1e-6
"""If the second smallest singular value of the Jacobian is below this, its null space has more than one dimension."""

STEP = 1e-4
"""Rad or m: step of the difference quotient for the direction of the family in that case."""

FOLDED = 10.0
"""At a fold, another joint moves faster than the parameter by more than this factor within STEP of the end."""

MOVES = 1e-6
"""A joint moves along the family if its component of the unit direction is larger than this."""

SAME = 1e-5
"""Rad or m. Configurations closer than this are the same member."""


@dataclass(frozen=True, eq=False)
class IkFamily:
    """A one-parameter family of IK solutions for the same singular target.

    Parameters
    ----------
    parameter
        The joint whose value is the parameter of the family.
    joints
        The joints that move along the family.
    q
        (n,) the member at the value of the parameter in q0.
    direction
        (n,) the unit direction of the self-motion at ``q``; constant for a straight wrist, but not for four parallel
        axes.
    lower, upper
        The range of the parameter (rad or m) around ``q`` in which members exist within the limits.
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
    _number: int

    @classmethod
    def at_branch(cls, arm: Arm, plan: Plan, target: Array, q: Array, number: int, joint: int) -> IkFamily:
        """The family of a branch with this ``number`` in which the joint with index ``joint`` is free."""
        n = plan.dof
        _, values, motions = np.linalg.svd(arm.jacobian(q))
        direction = motions[-1]
        # With a two-dimensional null space, the direction of the family follows from a difference quotient.
        if n >= 2 and len(values) >= n and values[-2] < DOUBLY_SINGULAR:
            family = cls(arm.joint_names[joint], (), q, direction, 0.0, 0.0, arm, plan, target, number)
            direction = family._tangent(float(q[joint]), direction)
        direction = direction * (1.0 if direction[joint] >= 0 else -1.0)
        moving = tuple(name for name, part in zip(arm.joint_names, direction, strict=True) if abs(part) > MOVES)
        lower, upper = arm.limits.sampling_range()
        low, high = min(lower[joint], q[joint]), max(upper[joint], q[joint])
        family = cls(arm.joint_names[joint], moving, q, direction, low, high, arm, plan, target, number)
        lower_end, upper_end = (family._end(float(q[joint]), float(bound)) for bound in (low, high))
        return replace(family, lower=lower_end, upper=upper_end)

    def at(self, value: float) -> Array:
        """(n,) the member at a value of the parameter.

        Raises
        ------
        InputError
            If there is no member within the limits.
        """
        member = self._member(float(value))
        if member is None:
            raise InputError(
                f"the family has no member at {self.parameter} = {value:g}; choose a value from {self.lower:g} to "
                f"{self.upper:g}"
            )
        return member

    def nearest(self, q: npt.ArrayLike) -> Array:
        """(n,) the member with the smallest largest joint difference from q (n,), to 1e-6 of the range."""
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

    def holds(self, q: Array) -> bool:
        """Whether a configuration (n,) is a member."""
        value = float(q[self._joint])
        if not self.lower - MOVES <= value <= self.upper + MOVES:
            return False
        member = self._member(value)
        return member is not None and bool(np.abs(difference(self._arm, member, q)).max() < SAME)

    def ends_are_explained(self) -> bool:
        """Whether each end of the range is a limit, or a fold where the parameter turns back along the family.

        Elsewhere the members that are found end because rounding decides whether they are within the limits, for
        example if a joint that does not move along the family is exactly at its limit.
        """
        bounds = [float(bound[self._joint]) for bound in self._arm.limits.sampling_range()]
        for end, bound, inwards in zip((self.lower, self.upper), bounds, (STEP, -STEP), strict=True):
            if (end - bound) * inwards <= MOVES * STEP:  # at the bound or, for a joint without limits, beyond it
                continue
            last, before = self._member(end), self._member(end + inwards)
            if last is None or before is None or self.upper - self.lower < STEP:
                return False
            speed = np.abs(difference(self._arm, last, before)) / STEP
            lower, upper = self._arm.limits.lower, self._arm.limits.upper
            at_limit = np.minimum(np.abs(last - lower), np.abs(last - upper)) <= MOVES
            if not (speed > FOLDED).any() and not (at_limit & (speed > MOVES)).any():
                return False
        return True

    @property
    def _joint(self) -> int:
        return self._arm.joint_names.index(self.parameter)

    def _tangent(self, value: float, otherwise: Array) -> Array:
        """(n,) the unit direction of the family at a value of the parameter; ``otherwise`` without a member nearby."""
        for step in (STEP, -STEP):
            member = self._member(value + step)
            if member is not None:
                motion = difference(self._arm, member, self.q) / step
                return np.asarray(motion / np.linalg.norm(motion))
        return otherwise

    def _end(self, inside: float, bound: float) -> float:
        """The last value of the parameter with a member, from ``inside`` towards ``bound``."""
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
        joint = self._joint
        reference = self.q.copy()
        reference[joint] = value
        found = self._plan.solve(self._target, reference)
        for q, free, number in zip(found.q, found.free_joints, found.numbers, strict=True):
            if number == self._number and free and abs(q[joint] - value) < MOVES:
                return np.array(q)
        return None


def branches_elsewhere(arm: Arm, plan: Plan, target: Array, reference: Array) -> _core.Branches:
    """The branches at the values of the free joints that are closest to q0 and have branches.

    For targets with free joints that have no branch within the limits at their values in ``reference``. Tries SCAN
    values of one joint, then FINE_SCAN; COARSE_SCAN values of each of two. At targets with several
    singularities, such as a stretched elbow with parallel wrist axes, branches may exist at single values only; these
    are then taken from a solution of :class:`pinproof.Clik`, and the closed form computes and verifies the branches.
    """
    found = plan.solve(target, reference)
    joints = _members(found.all_free_joints)[:2]
    for many in (SCAN, FINE_SCAN) if len(joints) == 1 else (COARSE_SCAN,):
        elsewhere = _nearest_with_branches(arm, plan, target, reference, joints, many)
        if len(elsewhere):
            return elsewhere
    numerical = Clik(position_tolerance=SEARCHED, orientation_tolerance=SEARCHED).solve(arm, target, reference, rng=0)
    if numerical.ok:
        moved = reference.copy()
        moved[joints] = numerical.q[joints]
        for tried in (moved, numerical.q):
            elsewhere = plan.solve(target, tried)
            if len(elsewhere):
                return elsewhere
    return found


def _nearest_with_branches(
    arm: Arm, plan: Plan, target: Array, reference: Array, joints: list[int], many: int
) -> _core.Branches:
    """The branches at the closest of ``many`` values of each joint that has any."""
    lower, upper = arm.limits.sampling_range()
    values = [np.linspace(lower[joint], upper[joint], many + 1) for joint in joints]
    grid = np.stack([one.ravel() for one in np.meshgrid(*values, indexing="ij")], axis=1)
    away = np.abs(grid - reference[joints]).max(axis=1)
    for index in np.argsort(away, kind="stable"):
        moved = reference.copy()
        moved[joints] = grid[index]
        found = plan.solve(target, moved)
        if len(found):
            break
    return found


def families_of(
    arm: Arm, plan: Plan, target: Array, reference: Array, found: _core.Branches
) -> tuple[list[IkFamily], bool]:
    """The families of the branches, and those without a member at the value of their parameter in q0.

    Each free joint is tried at SCAN values of its range, with the other joints at q0, and at FINE_SCAN values if
    solutions with a free joint have no member found so far. The second value is whether a member of each was found; if
    not, there may be families in narrower ranges.
    """
    lower, upper = arm.limits.sampling_range()
    families: list[IkFamily] = []
    missing = found.unresolved
    for scan in (SCAN, FINE_SCAN):
        if scan == FINE_SCAN:
            missing &= ~_outside_everywhere(arm, plan, target, reference, found)
            if not missing:
                break
        for joint in _members(found.all_free_joints):
            more = [
                IkFamily.at_branch(arm, plan, target, q, number, joint)
                for q, number in (_with_free_joint(found, joint) if scan == SCAN else ())
            ]
            before, moved = [one for one in families if one.parameter == arm.joint_names[joint]], reference.copy()
            for value in np.linspace(lower[joint], upper[joint], scan + 1).tolist():
                moved[joint] = value
                here = plan.solve(target, moved)
                missing &= here.unresolved
                for q, number in _with_free_joint(here, joint):
                    if not any(one.holds(q) for one in (*before, *more)):
                        more.append(IkFamily.at_branch(arm, plan, target, q, number, joint))
            families += more
            if scan == FINE_SCAN and not missing:
                break
    return families, not missing and all(family.ends_are_explained() for family in families)


def _outside_everywhere(arm: Arm, plan: Plan, target: Array, reference: Array, found: _core.Branches) -> int:
    """The unresolved solutions (bits) in which some joint violates its limits for every value of the free joints.

    This is considered proven if, at all SCAN values, one joint is outside its limits by more than it moves between
    adjacent values.
    """
    wide = plan.without_limits()
    lower, upper = arm.limits.sampling_range()
    outside = -1
    for joint in _members(found.all_free_joints):
        met: dict[int, list[Array]] = {}
        moved, unmet = reference.copy(), 0
        for value in np.linspace(lower[joint], upper[joint], SCAN + 1).tolist():
            moved[joint] = value
            here = wide.solve(target, moved)
            unmet |= here.unresolved
            for q, free, bit in zip(here.q, here.free_joints, here.solution_bits, strict=True):
                if free >> joint & 1:
                    met.setdefault(bit, []).append(q)
        proven = 0
        for bit, members in met.items():
            q = np.array(members)
            away = _away(arm, q)
            steps = np.abs(difference(arm, q[1:], q[:-1])).max(axis=0, initial=0.0)
            if len(q) > SCAN and (away.min(axis=0) > steps + MOVES).any():
                proven |= bit
                other = _other_root(bit)  # it is omitted if both roots coincide
                if other not in met and not unmet & other:
                    proven |= other
        outside &= proven
    return outside


def _away(arm: Arm, q: Array) -> Array:
    """(k, n) the smallest limit violation of each joint of q (k, n), including shifts by 2 pi."""
    lower, upper = arm.limits.lower, arm.limits.upper
    below, above = lower - q, q - upper
    away = np.maximum(np.maximum(below, above), 0.0)
    turns = np.where(below > 0.0, np.ceil(below / TURN), np.where(above > 0.0, -np.ceil(above / TURN), 0.0))
    for turn in (turns, turns - np.sign(turns)):
        other = q + turn * TURN
        nearer = np.maximum(np.maximum(lower - other, other - upper), 0.0)
        away = np.where(arm.periodic, np.minimum(away, nearer), away)
    return np.asarray(away)


def _other_root(bit: int) -> int:
    """The bit of the solution with the second root of the middle joint of the triple; the numbers differ in bit 0."""
    number = bit.bit_length() - 1
    return 1 << (number ^ 1)


def _with_free_joint(found: _core.Branches, joint: int) -> list[tuple[Array, int]]:
    """The branches in which a joint is free, and their numbers."""
    rows = zip(found.q, found.free_joints, found.numbers, strict=True)
    return [(q.copy(), number) for q, free, number in rows if free >> joint & 1]


def _members(bits: int) -> list[int]:
    """The indices in a set of joints."""
    return [joint for joint in range(bits.bit_length()) if bits >> joint & 1]
