"""Motions of the joints with the tcp at rest: families of solutions at singular targets, and curves for seven joints.

A family exists at a singular target of any arm, over the value of a joint that is free there. An arm of seven joints
moves at every target; its curves are followed over the redundant joint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import Enum

import numpy as np
import numpy.typing as npt

from pinproof import _core
from pinproof.common.results import View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_positive
from pinproof.errors import IkFailed, InputError
from pinproof.ik.analytic_plan import Plan, plan_for
from pinproof.ik.jacobian_methods import Clik
from pinproof.ik.result import TURN, IkAnswer, difference, nearest_winding
from pinproof.model import Arm
from pinproof.spatial import Array

SCAN = 72
"""Number of values of the parameter over its range at which members are computed to find the ends of the family."""

FINE_SCAN = 720
"""Number of values if families are known to exist and no member was found at SCAN values."""

COARSE_SCAN = 24
"""Number of values for each of two joints that are both free."""

SEARCHED = 1e-10
"""M and rad: tolerance of the numerical solution whose free joints are tried if no scanned value has branches."""

END = 1e-9
"""Rad or m: accuracy of the ends of families and curves."""

SAME = 1e-5
"""Rad or m. Configurations closer than this are the same member or solution."""

DOUBLY_SINGULAR = 1e-6
"""If the second smallest singular value of the Jacobian is below this, its null space has more than one dimension."""

STEP = 1e-4
"""Rad or m: step of the difference quotient for the direction of the family in that case."""

FOLDED = 10.0
"""At a fold, another joint moves faster than the parameter by more than this factor within STEP of the end."""

MOVES = 1e-6
"""A joint moves along the family if its component of the unit direction is larger than this."""

PREDICTED = 0.05
"""Rad or m: a solution belongs to the curve if it is this close to the linear prediction; otherwise the step is
halved."""

LARGEST = 0.2
"""Rad or m: largest motion of a joint between two samples of a curve."""

ENDS_AT_LIMIT = 1e-4
"""Rad or m: a curve whose joint is this close to a limit at its end is considered to end there."""

APART = 0.15
"""Rad or m: the default difference of :meth:`SelfMotion.spread`; motions to closer goals are similar."""


@described(eq=False)
class IkFamily:
    """A one-parameter family of IK solutions for the same singular target."""

    parameter: str = key("the joint whose value is the parameter of the family")
    joints: tuple[str, ...] = key("the joints that move along the family")
    q: Array = key("(n,) the member at the value of the parameter in q0")
    direction: Array = key(
        "(n,) the unit direction of the self-motion at ``q``; constant for a straight wrist, but not for four "
        "parallel axes"
    )
    lower: float = key("the smallest value of the parameter, in the range around ``q`` within the limits", "rad or m")
    upper: float = key("the largest value of the parameter in this range", "rad or m")
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
            for step in (STEP, -STEP):
                member = family._member(float(q[joint]) + step)
                if member is not None:
                    motion = difference(arm, member, q) / step
                    direction = np.asarray(motion / np.linalg.norm(motion))
                    break
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

        # the closest of SCAN members, then a ternary search between its neighbours
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
    lower, upper = arm.limits.sampling_range()
    for many in (SCAN, FINE_SCAN) if len(joints) == 1 else (COARSE_SCAN,):
        # the values of a grid, the closest to the reference first
        values = [np.linspace(lower[joint], upper[joint], many + 1) for joint in joints]
        grid = np.stack([one.ravel() for one in np.meshgrid(*values, indexing="ij")], axis=1)
        for index in np.argsort(np.abs(grid - reference[joints]).max(axis=1), kind="stable"):
            moved = reference.copy()
            moved[joints] = grid[index]
            elsewhere = plan.solve(target, moved)
            if len(elsewhere):
                return elsewhere
    # the values of a numerical solution, if there is one
    numerical = Clik(position_tolerance=SEARCHED, orientation_tolerance=SEARCHED).solve(arm, target, reference, rng=0)
    if numerical.ok:
        moved = reference.copy()
        moved[joints] = numerical.q[joints]
        for tried in (moved, numerical.q):
            elsewhere = plan.solve(target, tried)
            if len(elsewhere):
                return elsewhere
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
    # missing: bits of the solutions with a free joint of which no member was found yet
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
            # members at other values of the parameter than that in the reference belong to further families
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
                # The other root of the middle joint of the triple has the number with the other bit 0; it is omitted
                # if both roots coincide.
                other = 1 << (bit.bit_length() - 1 ^ 1)
                if other not in met and not unmet & other:
                    proven |= other
        outside &= proven
    return outside


def _away(arm: Arm, q: Array) -> Array:
    """(k, n) the smallest limit violation of each joint of q (k, n), including shifts by 2 pi."""
    lower, upper = arm.limits.lower, arm.limits.upper
    below, above = lower - q, q - upper
    # full rotations that move a joint past the limit that it violates, and one fewer
    away = np.maximum(np.maximum(below, above), 0.0)
    turns = np.where(below > 0.0, np.ceil(below / TURN), np.where(above > 0.0, -np.ceil(above / TURN), 0.0))
    for turn in (turns, turns - np.sign(turns)):
        other = q + turn * TURN
        nearer = np.maximum(np.maximum(lower - other, other - upper), 0.0)
        away = np.where(arm.periodic, np.minimum(away, nearer), away)
    return np.asarray(away)


def _with_free_joint(found: _core.Branches, joint: int) -> list[tuple[Array, int]]:
    """The branches in which a joint is free, and their numbers."""
    rows = zip(found.q, found.free_joints, found.numbers, strict=True)
    return [(q.copy(), number) for q, free, number in rows if free >> joint & 1]


def _members(bits: int) -> list[int]:
    """The indices in a set of joints."""
    return [joint for joint in range(bits.bit_length()) if bits >> joint & 1]


class CurveEnd(Enum):
    """Why a curve ends."""

    LIMIT = "limit"
    """A joint is at a limit."""
    FOLD = "fold"
    """The redundant joint reverses: another curve continues from there."""


@described(eq=False)
class SelfMotionCurve:
    """A curve of IK solutions over a range of the redundant joint."""

    parameter: str = key("the name of the redundant joint")
    values: Array = key(
        "(m,) ascending values of the redundant joint; their distances are smaller where other joints move fast"
    )
    q: Array = key("(m, n) the solution at each value")
    ends: tuple[CurveEnd, CurveEnd] = key("why the curve ends at its lower and upper end")
    _arm: Arm
    _tolerances: tuple[float, float]
    _target: Array

    @property
    def lower(self) -> float:
        """The smallest value of the redundant joint."""
        return float(self.values[0])

    @property
    def upper(self) -> float:
        """The largest value of the redundant joint."""
        return float(self.values[-1])

    def at(self, value: float) -> Array:
        """(n,) the solution at a value of the redundant joint, exact as all closed-form solutions.

        Raises
        ------
        InputError
            If the value is outside the curve.
        """
        if not self.lower <= value <= self.upper:
            raise InputError(
                f"the curve has no solution at {self.parameter} = {value:g}; choose a value from {self.lower:g} to "
                f"{self.upper:g}"
            )
        index = int(np.searchsorted(self.values, value))
        if self.values[index] == value:
            return self.q[index].copy()
        share = (value - self.values[index - 1]) / (self.values[index] - self.values[index - 1])
        guess = (1 - share) * self.q[index - 1] + share * self.q[index]
        # The plan is cached for the arm; it is in the compiled core, which cannot be pickled.
        found = _nearest(plan_for(self._arm, *self._tolerances), self._target, guess, float(value))
        return self.q[index - 1 if share < 0.5 else index].copy() if found is None else found

    def nearest(self, q: npt.ArrayLike) -> Array:
        """(n,) the sample with the smallest largest joint difference from q (n,), modulo 2 pi."""
        goal = self._arm.configuration(q)
        turned = nearest_winding(self._arm, self.q, goal)
        return np.array(turned[np.abs(turned - goal).max(axis=1).argmin()])

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        return f"SelfMotionCurve({self.parameter} in [{self.lower:.4g}, {self.upper:.4g}])"


@described(eq=False)
class SelfMotion(IkAnswer):
    """All curves of IK solutions that were found for a target.

    Every solution at each of ``grid`` belongs to a curve; a curve shorter than the distance of two grid values may be
    missing.
    """

    arm: Arm = key("the arm")
    target: Array = key("(4, 4) ``base_from_tcp``")
    parameter: str = key("the name of the redundant joint")
    grid: Array = key("(v,) the values of the redundant joint at which curves were searched")
    curves: tuple[SelfMotionCurve, ...] = key("the curves, the longest first")

    @property
    def ok(self) -> bool:
        """Whether there is at least one solution."""
        return bool(self.curves)

    @property
    def message(self) -> str:
        """The ranges of the redundant joint as text."""
        if not self.curves:
            return f"no IK solution at {len(self.grid)} values of {self.parameter}"
        spans = ", ".join(f"[{curve.lower:.4g}, {curve.upper:.4g}]" for curve in self.curves)
        plural = "" if len(self.curves) == 1 else "s"
        return f"{len(self.curves)} curve{plural} of IK solutions over {self.parameter} in {spans}"

    def spread(self, apart: float = APART) -> Array:
        """(k, n) configurations along all curves, for example as goals of :func:`pinproof.optimise` or of a planner.

        The ends of each curve and, between them, samples that differ by at least ``apart`` (rad or m) in some joint
        from the one before.
        """
        require_positive("apart", apart)
        chosen: list[Array] = []
        for curve in self.curves:
            chosen.append(curve.q[0])
            for q in curve.q[1:]:
                if np.abs(q - chosen[-1]).max() >= apart:
                    chosen.append(q)
            if len(curve) > 1 and chosen[-1] is not curve.q[-1]:
                chosen.append(curve.q[-1])
        return np.array(chosen).reshape(-1, self.arm.dof)

    def nearest(self, q: npt.ArrayLike) -> Array:
        """(n,) the sample of all curves with the smallest largest joint difference from q (n,), modulo 2 pi.

        Raises
        ------
        IkFailed
            If there is no solution.
        """
        goal = self.arm.configuration(q)
        found = self.best(lambda many: -np.abs(nearest_winding(self.arm, many, goal) - goal).max(axis=1))
        return nearest_winding(self.arm, found, goal)

    def best(self, score: Callable[[Array], Array]) -> Array:
        """(n,) the sample of all curves with the largest score; ``score`` gives (m,) values for samples (m, n).

        Samples whose score is NaN or minus infinity are rejected.

        Raises
        ------
        IkFailed
            If there is no solution, or each is rejected.
        """
        self.or_raise()
        samples = np.concatenate([curve.q for curve in self.curves])
        scores = np.asarray(score(samples.copy()), dtype=float)
        if scores.shape != (len(samples),):
            raise InputError(f"score must return {len(samples)} values, one for each sample, not shape {scores.shape}")
        scores = np.where(np.isnan(scores), -np.inf, scores)
        if not (scores > -np.inf).any():
            raise IkFailed(f"score rejected each of {len(samples)} samples of {self.message}", self)
        return np.array(samples[int(scores.argmax())])

    def __len__(self) -> int:
        return len(self.curves)

    def __iter__(self) -> Iterator[SelfMotionCurve]:
        return iter(self.curves)

    def _view(self) -> View:
        return View(self.message, lines=map(repr, self.curves), total=len(self.curves))


def self_motion_of(
    arm: Arm, tolerances: tuple[float, float], joint: int, target: Array, reference: Array, grid: Array
) -> SelfMotion:
    """The curves through all solutions at the values of ``grid`` (v,) of the redundant joint, ascending.

    ``tolerances`` are those of solutions, in m and rad.
    """
    plan = plan_for(arm, *tolerances)
    curves: list[SelfMotionCurve] = []
    on_curves: list[list[Array]] = [[] for _ in grid]
    for i, value in enumerate(grid.tolist()):
        for q in plan.solve(target, reference, value).q:
            # a solution on a known curve starts no other
            if any(np.abs(difference(arm, q, other)).max() < SAME for other in on_curves[i]):
                continue
            before, low_end = _follow(arm, plan, target, q, grid[: i + 1][::-1])
            after, high_end = _follow(arm, plan, target, q, grid[i:])
            # both directions from the solution, in ascending order of the redundant joint
            samples = np.array([*before[:0:-1], *after])
            values = samples[:, joint].copy()
            for array in (samples, values):
                array.setflags(write=False)
            for k in np.flatnonzero(np.isin(grid, values)):
                on_curves[k].append(samples[int(np.searchsorted(values, grid[k]))])
            name = arm.joint_names[joint]
            curves.append(SelfMotionCurve(name, values, samples, (low_end, high_end), arm, tolerances, target))
    curves.sort(key=lambda curve: curve.lower - curve.upper)
    return SelfMotion(arm, target, arm.joint_names[joint], grid, tuple(curves))


def _follow(arm: Arm, plan: Plan, target: Array, q: Array, grid: Array) -> tuple[list[Array], CurveEnd]:
    """The solutions from q at the first value of ``grid`` along the others, and why the last one is the end."""
    samples, goal = [q], 1
    value, step = float(grid[0]), np.inf
    slope = np.zeros_like(q)
    while goal < len(grid):
        # a linear prediction at the next value of the grid, or at a smaller step
        ahead = float(grid[goal]) - value
        step = np.sign(ahead) * min(abs(ahead), abs(step))
        guess = samples[-1] + slope * step
        reached = float(grid[goal]) if step == ahead else value + step
        found = _nearest(plan, target, guess, reached)
        # A solution far from the prediction is on another curve, or the step was too long.
        if found is None or np.abs(found - guess).max() > PREDICTED or np.abs(found - samples[-1]).max() > LARGEST:
            step /= 2
            if abs(step) > END:
                continue
            last, lower, upper = samples[-1], arm.limits.lower, arm.limits.upper
            at_limit = np.minimum(np.abs(last - lower), np.abs(last - upper)) <= ENDS_AT_LIMIT
            return samples, CurveEnd.LIMIT if at_limit.any() else CurveEnd.FOLD
        slope = (found - samples[-1]) / (reached - value)
        samples.append(found)
        value, step = reached, 2 * step
        goal += reached == grid[goal]
    return samples, CurveEnd.LIMIT


def _nearest(plan: Plan, target: Array, guess: Array, value: float) -> Array | None:
    """The solution at a value of the redundant joint that is closest to a guess (n,)."""
    found = plan.solve(target, guess, value)  # the first is the one with the smallest difference from its reference
    return np.array(found.q[0]) if len(found) else None
