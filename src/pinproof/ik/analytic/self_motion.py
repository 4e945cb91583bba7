"""The self-motion of an arm of seven joints at a target: curves of IK solutions over the redundant joint."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from pinproof.common.results import View
from pinproof.common.validation import require_positive
from pinproof.errors import IkFailed, InputError
from pinproof.ik.analytic.plan import Plan, plan_for
from pinproof.ik.result import IkAnswer
from pinproof.ik.windings import difference, nearest_winding
from pinproof.model import Arm
from pinproof.spatial import Array

END = 1e-9
"""Rad or m: accuracy of the ends of a curve."""

PREDICTED = 0.05
"""Rad or m: a solution belongs to the curve if it is this close to the linear prediction; otherwise the step is
halved."""

LARGEST = 0.2
"""Rad or m: largest motion of a joint between two samples."""

SAME = 1e-5
"""Rad or m. Solutions closer than this are the same."""

AT_LIMIT = 1e-4
"""Rad or m: a curve whose joint is this close to a limit at its end is considered to end there."""


APART = 0.15
"""Rad or m: the default difference of :meth:`SelfMotion.spread`; motions to closer goals are similar."""


class CurveEnd(Enum):
    """Why a curve ends."""

    LIMIT = "limit"
    """A joint is at a limit."""
    FOLD = "fold"
    """The redundant joint reverses: another curve continues from there."""


@dataclass(frozen=True, eq=False)
class SelfMotionCurve:
    """A curve of IK solutions over a range of the redundant joint.

    Parameters
    ----------
    parameter
        The name of the redundant joint.
    values
        (m,) ascending values of the redundant joint; their distances are smaller where other joints move fast.
    q
        (m, n) the solution at each value.
    ends
        Why the curve ends at its lower and upper end.
    """

    parameter: str
    values: Array
    q: Array
    ends: tuple[CurveEnd, CurveEnd]
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


@dataclass(frozen=True, eq=False)
class SelfMotion(IkAnswer):
    """All curves of IK solutions that were found for a target.

    Every solution at each of ``grid`` belongs to a curve; a curve shorter than the distance of two grid values may be
    missing.

    Parameters
    ----------
    arm
        The arm.
    target
        (4, 4) ``base_from_tcp``.
    parameter
        The name of the redundant joint.
    grid
        (v,) the values of the redundant joint at which curves were searched.
    curves
        The curves, the longest first.
    """

    arm: Arm
    target: Array
    parameter: str
    grid: Array
    curves: tuple[SelfMotionCurve, ...]

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
            if any(np.abs(difference(arm, q, other)).max() < SAME for other in on_curves[i]):
                continue
            before, low_end = _follow(arm, plan, target, q, grid[: i + 1][::-1])
            after, high_end = _follow(arm, plan, target, q, grid[i:])
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
        ahead = float(grid[goal]) - value
        step = np.sign(ahead) * min(abs(ahead), abs(step))
        guess = samples[-1] + slope * step
        reached = float(grid[goal]) if step == ahead else value + step
        found = _nearest(plan, target, guess, reached)
        if found is None or np.abs(found - guess).max() > PREDICTED or np.abs(found - samples[-1]).max() > LARGEST:
            step /= 2
            if abs(step) > END:
                continue
            return samples, _end(arm, samples[-1])
        slope = (found - samples[-1]) / (reached - value)
        samples.append(found)
        value, step = reached, 2 * step
        goal += reached == grid[goal]
    return samples, CurveEnd.LIMIT


def _nearest(plan: Plan, target: Array, guess: Array, value: float) -> Array | None:
    """The solution at a value of the redundant joint that is closest to a guess (n,)."""
    found = plan.solve(target, guess, value)  # the first is the one with the smallest difference from its reference
    return np.array(found.q[0]) if len(found) else None


def _end(arm: Arm, q: Array) -> CurveEnd:
    at_limit = np.minimum(np.abs(q - arm.limits.lower), np.abs(q - arm.limits.upper)) <= AT_LIMIT
    return CurveEnd.LIMIT if at_limit.any() else CurveEnd.FOLD
