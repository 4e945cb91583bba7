"""An arm prepared for the compiled closed form: which triple, which order of joints, and the array of it all.

Several triples may serve. Each is tried on random poses of the arm; of those that find them all again, the one that
needs no quartic, and whose axes are nearest to the ideal, is taken.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.errors import NoClosedForm
from pinproof.ik.analytic.completion import completed
from pinproof.ik.analytic.geometry import EXACT, Line, Triple, find_triples, lines_of, size_of
from pinproof.ik.analytic.reasons import why_not
from pinproof.model import Arm

__all__ = ["Plan", "plan_for", "plans_of"]

Array = npt.NDArray[np.float64]

TRIALS = 12

MADE_UP_TOLERANCE = 1e-3
"""Rad. A joint that was made up to have six stands at zero up to this; forward kinematics of the true arm judges."""

BORDER = 1e-6
"""In squares and parts of the arm's size. A root that fails to exist by less is tried as a double one: exact arms fail
by rounding (1e-16), which singular joints amplify. What is tried and not confirmed keeps a "no" from being a proof."""

MOST_BRANCHES = 8
"""Of six joints: four places where the two curves meet, two elbows or wrists each. Axes that are off the ideal may
split a double root: twice as many rows are kept then."""


@dataclass(frozen=True, eq=False)
class Plan:
    """How an arm is solved.

    Parameters
    ----------
    array
        What the kernels read; tolerances are filled in by :meth:`with_tolerances`.
    dof
        n.
    method
        In words: which axes make it work.
    redundant
        The joint that is swept, of seven; else None.
    miss
        How far the axes are from ideal (rad, or parts of the arm's size); 0 within rounding.
    home
        (n,) the reference where none is given.
    lower, upper
        (n,) limits.
    angular
        (n,) which joints turn.
    capacity
        Rows for branches in a batch.
    kernel
        :func:`pinproof.kernels.branches.branches_of_one`, which is imported late.
    """

    array: Array
    dof: int
    method: str
    redundant: int | None
    miss: float
    home: Array
    lower: Array
    upper: Array
    angular: npt.NDArray[np.bool_]
    capacity: int
    kernel: Callable[[Array, Array, Array, float, Array], int]

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Of what the kernel writes into: the branches and one row more, by q and four entries more."""
        from pinproof.kernels.branches import ROWS

        return ROWS + 1, self.dof + 4

    def with_tolerances(self, position: float, orientation: float) -> Plan:
        """The same for tolerances in m and rad."""
        from pinproof.kernels.roots import ROUNDING

        array = self.array.copy()
        array[0, 7] = max(array[0, 7], 4.0 * max(position / array[0, 6], orientation))
        array[0, 9], array[0, 10] = position, orientation
        array[0, 12] = max(4.0 * max(position / array[0, 6], orientation), ROUNDING)
        array[0, 11] = max(MADE_UP_TOLERANCE, 100.0 * self.miss, 100.0 * max(position, orientation))
        return replace(self, array=array)

    def without_limits(self) -> Plan:
        """The same for joints without limits."""
        array = self.array.copy()
        lines = array[self.dof + 3 :]
        lines[:, 9] = np.where(lines[:, 8] >= 0, -np.inf, lines[:, 9])
        lines[:, 10] = np.where(lines[:, 8] >= 0, np.inf, lines[:, 10])
        return replace(self, array=array)


_PLANS: weakref.WeakKeyDictionary[Arm, dict[tuple[float, float], Plan]] = weakref.WeakKeyDictionary()


def plan_for(arm: Arm, position_tolerance: float, orientation_tolerance: float) -> Plan:
    """The plan of an arm for tolerances in m and rad, made once.

    Raises
    ------
    NoClosedForm
        With the reason, and what to use instead.
    """
    plans = _PLANS.get(arm)
    if plans is None:
        plans = _PLANS[arm] = {}
    tolerances = position_tolerance, orientation_tolerance
    plan = plans.get(tolerances)
    if plan is None:
        untold = next(iter(plans.values())) if plans else _best(arm)
        plan = plans[tolerances] = untold.with_tolerances(*tolerances)
    return plan


def plans_of(arm: Arm) -> Iterator[Plan]:
    """Every plan that the arm's geometry offers, those nearest to ideal axes first; none has been tried."""
    lines, tool = lines_of(arm)
    size = size_of(lines, tool)
    for locked, order in completed(lines, tool, size):
        six = [line for i, line in enumerate(order) if i != locked]
        for triple in sorted(find_triples(six, size), key=lambda triple: triple.miss > EXACT):
            if locked is not None and triple.first < locked < triple.first + 3:
                continue  # the locked joint would move the triple apart
            yield _plan(arm, order, triple, locked, tool, size)


def _best(arm: Arm) -> Plan:
    best, best_score = None, (0, 0, 0.0, 0.0)
    for plan in plans_of(arm):
        score = _score(arm, plan)
        if best is None or score > best_score:
            best, best_score = plan, score
        if best_score[:2] == (TRIALS, 1) and best.redundant is None and best.miss == 0.0:
            break
    if best is None or best_score[0] < TRIALS // 2:
        raise NoClosedForm(why_not(arm, best is not None))
    return best


def _score(arm: Arm, plan: Plan) -> tuple[int, int, float, float]:
    """Poses found again, whether without a quartic, how well the redundant joint tells the arm's place, nearness."""
    rng = np.random.default_rng(0)
    lower, upper = arm.limits.sampling_range()
    tried = plan.with_tolerances(1e-9, 1e-9)
    found, quartic, telling = 0, False, 0.0
    out = np.empty(plan.shape)
    for q in rng.uniform(lower, upper, (TRIALS, plan.dof)):
        target = np.array(arm.forward_kinematics(q).homogeneous)
        value = 0.0 if plan.redundant is None else float(q[plan.redundant])
        count = plan.kernel(tried.array, target, plan.home, value, out)
        apart = np.abs(out[:count, : plan.dof] - q)
        apart = np.where(plan.angular, np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))), apart)
        found += bool((apart.max(axis=1) < 1e-6).any()) if count else 0
        quartic = quartic or bool(out[-1, 3])
        if plan.redundant is not None:
            motion = np.linalg.svd(arm.jacobian(q))[2][-1]
            telling += float(abs(motion[plan.redundant]) / np.abs(motion).max()) / TRIALS
    return found, int(not quartic), round(telling, 3), -plan.miss


def _plan(arm: Arm, order: Sequence[Line], triple: Triple, locked: int | None, tool: Array, size: float) -> Plan:
    from pinproof.kernels.branches import branches_of_one
    from pinproof.kernels.roots import ROUNDING

    six = [i for i in range(len(order)) if i != locked]
    ideal = list(order)
    for i, line in zip(six[triple.first : triple.first + 3], triple.lines, strict=True):
        ideal[i] = line
    outside = [six[(triple.first + 3 + k) % 6] for k in range(3)]
    _choose_points(ideal, outside)
    miss = triple.miss if triple.miss > EXACT else 0.0
    turning = next(k for k in range(3) if not triple.lines[k].slides)
    reverse = triple.planar and triple.lines[2].slides and not triple.lines[0].slides
    n = arm.dof
    array = np.zeros((n + 3 + len(order), 16))
    array[0, :7] = n, triple.first, triple.planar, reverse, turning, -1 if locked is None else locked, size
    array[0, 7], array[0, 8] = max(BORDER, 20.0 * miss), 20.0 * miss
    array[0, 13] = ROUNDING if miss else max(ROUNDING, 4.0 * triple.miss)
    array[1 : n + 2] = arm.packed
    scaled = tool.copy()
    scaled[:3, 3] /= size
    array[n + 2, :12] = scaled[:3].ravel()
    for row, line in zip(array[n + 3 :], ideal, strict=True):
        row[:3], row[3:6], row[6], row[8] = line.direction, line.point / size, line.slides, line.own
        row[9:11] = (arm.limits.lower[line.own], arm.limits.upper[line.own]) if line.own >= 0 else (0.0, 0.0)
    names = [arm.joint_names[order[i].own] if order[i].own >= 0 else "one made up" for i in six]
    method = f"the axes of {', '.join(names[triple.first : triple.first + 3])} {triple.name}"
    if miss:
        method += f" but for {miss:.2g}, refined on the true arm"
    return Plan(
        array=array,
        dof=n,
        method=method,
        redundant=None if locked is None else order[locked].own,
        miss=miss,
        home=arm.home,
        lower=np.array(arm.limits.lower),
        upper=np.array(arm.limits.upper),
        angular=arm.angular,
        capacity=MOST_BRANCHES * (2 if miss else 1),
        kernel=branches_of_one,
    )


def _choose_points(lines: list[Line], outside: Sequence[int]) -> None:
    """On each of the joints a, b, c the point nearest to its neighbour: where axes meet, terms then vanish."""
    a, b, c = outside
    pairs = ((a, b), (b, a), (c, b)) if b == a + 1 else ((a, b), (b, c), (c, b))
    for one, other in pairs:
        if abs(one - other) == 1:
            lines[one] = replace(lines[one], point=lines[one].nearest_to(lines[other]))
