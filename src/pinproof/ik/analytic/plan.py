"""The preparation of an arm for the compiled closed form: the choice of a triple and of the order of the joints.

If several triples are possible, each is tested on random poses of the arm. Among those that recover all of them, the
plan without a quartic and with the smallest deviation from the ideal geometry is used.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pinproof.errors import NoClosedForm
from pinproof.ik.analytic.geometry import EXACT, Line, Triple, completed, find_triples, lines_of, size_of
from pinproof.model import Arm

__all__ = ["Plan", "plan_for", "plans_of", "why_not"]


def why_not(arm: Arm, tried: bool) -> str:
    """The reason why an arm has no closed form; ``tried`` if a triple exists but does not recover the test poses."""
    if arm.dof > 7:
        return (
            f"no closed form: the arm has {arm.dof} joints, and at most 7 are supported; "
            "select a shorter chain (robot.arm with another base or tcp), or use Clik"
        )
    if tried:
        return (
            "no closed form: three of the axes meet or are parallel, but the arm is singular in every configuration; "
            "use Clik"
        )
    lines, tool = lines_of(arm)
    size = size_of(lines, tool)
    nearest = sorted(find_triples(lines, size, float("inf")), key=lambda triple: triple.deviation)
    text = "no three consecutive axes meet in one point, are parallel, or generate motions of one plane"
    if nearest:
        best = nearest[0]
        names = ", ".join(arm.joint_names[line.joint] for line in best.lines)
        amount = f"{best.deviation:.3g} rad" if best.planar else f"{best.deviation * size:.3g} m"
        what = "planar motions" if best.planar else "a common point"
        text += f"; the closest are the axes of {names}, which deviate from {what} by {amount}"
    if arm.dof < 6:
        text += ", and virtual joints cannot complete such a triple"
    if arm.dof == 7:
        text += ", also with any one joint locked"
    return f"no closed form: {text} (Pieper's condition); use Clik"


Array = npt.NDArray[np.float64]

TRIALS = 12

VIRTUAL_TOLERANCE = 1e-3
"""Rad. The value of a virtual joint must be zero up to this; forward kinematics of the true arm decides afterwards."""

BORDER = 1e-6
"""In squares, relative to the arm's size. A root that fails to exist by less is tried as a double root: for exact arms
the failure is rounding (1e-16), amplified by singular joints. If such a candidate is not confirmed, the absence of a
solution is not proven."""

MOST_BRANCHES = 8
"""For six joints: four intersections of the two curves, with two elbows or wrists each. A deviation from the ideal
geometry may split double roots, so that twice as many rows are reserved."""


@dataclass(frozen=True, eq=False)
class Plan:
    """The prepared solution of an arm.

    Parameters
    ----------
    array
        The input of the kernels; tolerances are filled in by :meth:`with_tolerances`.
    dof
        n.
    method
        The triple that is used, as text.
    redundant
        Index of the joint that is swept for an arm of seven joints; else None.
    deviation
        Deviation of the axes from the ideal geometry (rad, or fraction of the arm's size); 0 within rounding.
    home
        (n,) the default reference configuration.
    lower, upper
        (n,) limits.
    angular
        (n,) which joints are revolute.
    capacity
        Number of rows for branches in a batch.
    kernel
        :func:`pinproof.kernels.branches.branches_of_one`, which is imported late.
    """

    array: Array
    dof: int
    method: str
    redundant: int | None
    deviation: float
    home: Array
    lower: Array
    upper: Array
    angular: npt.NDArray[np.bool_]
    capacity: int
    kernel: Callable[[Array, Array, Array, float, Array], int]

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Shape of the output array of the kernel: one row per branch and a last row, with n + 4 columns."""
        from pinproof.kernels.branches import ROWS

        return ROWS + 1, self.dof + 4

    def with_tolerances(self, position: float, orientation: float) -> Plan:
        """A copy of the plan for tolerances in m and rad."""
        from pinproof.kernels.roots import ROUNDING

        array = self.array.copy()
        array[0, 7] = max(array[0, 7], 4.0 * max(position / array[0, 6], orientation))
        array[0, 9], array[0, 10] = position, orientation
        array[0, 12] = max(4.0 * max(position / array[0, 6], orientation), ROUNDING)
        array[0, 11] = max(VIRTUAL_TOLERANCE, 100.0 * self.deviation, 100.0 * max(position, orientation))
        return replace(self, array=array)

    def without_limits(self) -> Plan:
        """A copy of the plan for joints without limits."""
        array = self.array.copy()
        lines = array[self.dof + 3 :]
        lines[:, 9] = np.where(lines[:, 8] >= 0, -np.inf, lines[:, 9])
        lines[:, 10] = np.where(lines[:, 8] >= 0, np.inf, lines[:, 10])
        return replace(self, array=array)


_PLANS: weakref.WeakKeyDictionary[Arm, dict[tuple[float, float], Plan]] = weakref.WeakKeyDictionary()


def plan_for(arm: Arm, position_tolerance: float, orientation_tolerance: float) -> Plan:
    """The plan of an arm for tolerances in m and rad; it is cached.

    Raises
    ------
    NoClosedForm
        If the arm has no closed form; the message states the reason and the alternative.
    """
    plans = _PLANS.get(arm)
    if plans is None:
        plans = _PLANS[arm] = {}
    tolerances = position_tolerance, orientation_tolerance
    plan = plans.get(tolerances)
    if plan is None:
        base = next(iter(plans.values())) if plans else _best(arm)
        plan = plans[tolerances] = base.with_tolerances(*tolerances)
    return plan


def plans_of(arm: Arm) -> Iterator[Plan]:
    """All plans that the arm's geometry permits, exact ones first, before they are tested."""
    lines, tool = lines_of(arm)
    size = size_of(lines, tool)
    for locked, order in completed(lines, tool, size):
        six = [line for i, line in enumerate(order) if i != locked]
        for triple in sorted(find_triples(six, size), key=lambda triple: triple.deviation > EXACT):
            if locked is not None and triple.first < locked < triple.first + 3:
                continue  # the locked joint is between the axes of the triple
            yield _plan(arm, order, triple, locked, tool, size)


def _best(arm: Arm) -> Plan:
    best, best_score = None, (0, 0, 0.0, 0.0)
    for plan in plans_of(arm):
        score = _score(arm, plan)
        if best is None or score > best_score:
            best, best_score = plan, score
        if best_score[:2] == (TRIALS, 1) and best.redundant is None and best.deviation == 0.0:
            break
    if best is None or best_score[0] < TRIALS // 2:
        raise NoClosedForm(why_not(arm, best is not None))
    return best


def _score(arm: Arm, plan: Plan) -> tuple[int, int, float, float]:
    """The quality of a plan, for comparison.

    Returns the number of recovered poses, whether no quartic is needed, the share of the redundant joint in the
    self-motion, and the negative deviation.
    """
    rng = np.random.default_rng(0)
    lower, upper = arm.limits.sampling_range()
    tried = plan.with_tolerances(1e-9, 1e-9)
    found, quartic, sensitivity = 0, False, 0.0
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
            sensitivity += float(abs(motion[plan.redundant]) / np.abs(motion).max()) / TRIALS
    return found, int(not quartic), round(sensitivity, 3), -plan.deviation


def _plan(arm: Arm, order: Sequence[Line], triple: Triple, locked: int | None, tool: Array, size: float) -> Plan:
    from pinproof.kernels.branches import branches_of_one
    from pinproof.kernels.roots import ROUNDING

    six = [i for i in range(len(order)) if i != locked]
    ideal = list(order)
    for i, line in zip(six[triple.first : triple.first + 3], triple.lines, strict=True):
        ideal[i] = line
    outside = [six[(triple.first + 3 + k) % 6] for k in range(3)]
    _choose_points(ideal, outside)
    deviation = triple.deviation if triple.deviation > EXACT else 0.0
    turning = next(k for k in range(3) if not triple.lines[k].prismatic)
    reverse = triple.planar and triple.lines[2].prismatic and not triple.lines[0].prismatic
    n = arm.dof
    array = np.zeros((n + 3 + len(order), 16))
    array[0, :7] = n, triple.first, triple.planar, reverse, turning, -1 if locked is None else locked, size
    array[0, 7], array[0, 8] = max(BORDER, 20.0 * deviation), 20.0 * deviation
    array[0, 13] = ROUNDING if deviation else max(ROUNDING, 4.0 * triple.deviation)
    chain = arm.chain
    array[1 : n + 2, :12] = np.vstack([chain.before, chain.tool[None]])[:, :3].reshape(n + 1, 12)
    array[1 : n + 1, 12:] = np.column_stack([chain.prismatic, chain.index, chain.multiplier, chain.offset])
    scaled = tool.copy()
    scaled[:3, 3] /= size
    array[n + 2, :12] = scaled[:3].ravel()
    for row, line in zip(array[n + 3 :], ideal, strict=True):
        row[:3], row[3:6], row[6], row[8] = line.direction, line.point / size, line.prismatic, line.joint
        row[9:11] = (arm.limits.lower[line.joint], arm.limits.upper[line.joint]) if line.joint >= 0 else (0.0, 0.0)
    names = [arm.joint_names[order[i].joint] if order[i].joint >= 0 else "a virtual joint" for i in six]
    method = f"the axes of {', '.join(names[triple.first : triple.first + 3])} {triple.name}"
    if deviation:
        method += f" up to {deviation:.2g}; solutions are refined on the true arm"
    return Plan(
        array=array,
        dof=n,
        method=method,
        redundant=None if locked is None else order[locked].joint,
        deviation=deviation,
        home=arm.home,
        lower=np.array(arm.limits.lower),
        upper=np.array(arm.limits.upper),
        angular=arm.angular,
        capacity=MOST_BRANCHES * (2 if deviation else 1),
        kernel=branches_of_one,
    )


def _choose_points(lines: list[Line], outside: Sequence[int]) -> None:
    """Set the point of each of the joints a, b, c closest to its neighbour: if axes meet, terms vanish."""
    a, b, c = outside
    pairs = ((a, b), (b, a), (c, b)) if b == a + 1 else ((a, b), (b, c), (c, b))
    for one, other in pairs:
        if abs(one - other) == 1:
            lines[one] = replace(lines[one], point=lines[one].nearest_to(lines[other]))
