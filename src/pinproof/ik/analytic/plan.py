"""The preparation of an arm for the compiled solver: the choice of a triple and of the order of the joints.

If several triples are possible, each is tested on random poses of the arm. Among those that recover all of them, the
plan without a quartic and with the smallest deviation from the ideal geometry is used. The true axes of arms that
deviate from it, or that have no triple, are solved in general position (``src/core/closed_form/general_loop.h``).
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof import _core
from pinproof.errors import InputError, NoClosedForm
from pinproof.ik.analytic.geometry import (
    EXACT,
    JointLine,
    Triple,
    completed,
    find_triples,
    in_general_position,
    lines_of,
    size_of,
)
from pinproof.model import Arm
from pinproof.spatial import Array, rigid

TRIALS = 12
"""Number of random poses on which a plan is tested."""

UNCHECKED = (0.0, 0.0)
"""The key of the plan before its tolerances are set."""

VIRTUAL_TOLERANCE = 1e-3
"""Rad. The value of a virtual joint must be zero up to this; forward kinematics of the true arm decides afterwards."""

BORDER = 1e-6
"""In squares, relative to the arm's size. A root that fails to exist by less is tried as a double root: for exact arms
the failure is rounding (1e-16), amplified by singular joints. If such a candidate is not confirmed, the absence of a
solution is not proven."""

MOST_BRANCHES = 8
"""For six joints with a triple: four intersections of the two curves, with two elbows or wrists each. Without a triple,
or if the axes deviate from it, there are up to twice as many."""


@dataclass(frozen=True, eq=False)
class Plan:
    """The prepared solution of an arm.

    Parameters
    ----------
    core
        The solver of the compiled core.
    dof
        n.
    size
        Length of the arm (m).
    method
        The triple that is used, as text.
    redundant
        Index of the joint that is swept for an arm of seven joints; else None.
    deviation
        Deviation of the axes from the ideal geometry (rad, or fraction of the arm's size); 0 within rounding.
    home
        (n,) the default reference configuration.
    angular
        (n,) which joints are revolute.
    capacity
        Number of rows for branches in a batch.
    """

    core: _core.ClosedForm
    dof: int
    size: float
    method: str
    redundant: int | None
    deviation: float
    home: Array
    angular: npt.NDArray[np.bool_]
    capacity: int

    def solve(self, target: Array, reference: Array, value: float = 0.0) -> _core.Branches:
        """The branches for a pose (4, 4), at a value of the redundant joint of an arm of seven joints.

        Raises
        ------
        InputError
            If the pose is not rigid.
        """
        found = self.core.solve(target, reference, value)
        if found is None:
            rigid("target", target)  # raises with the reason
            raise InputError("the target is not a rigid transform")
        return found

    def with_tolerances(self, position: float, orientation: float) -> Plan:
        """A copy of the plan for tolerances in m and rad."""
        virtual = max(VIRTUAL_TOLERANCE, 100.0 * self.deviation, 100.0 * max(position, orientation))
        return replace(self, core=self.core.with_tolerances(position, orientation, virtual))

    def without_limits(self) -> Plan:
        """A copy of the plan for joints without limits."""
        return replace(self, core=self.core.without_limits())


_PLANS: weakref.WeakKeyDictionary[Arm, dict[tuple[float, float], Plan] | str] = weakref.WeakKeyDictionary()
"""The plans of each arm by tolerances, or why it has none: the search for one takes up to a second."""


def plan_for(arm: Arm, position_tolerance: float, orientation_tolerance: float) -> Plan:
    """The plan of an arm for tolerances in m and rad; it is cached, as is the reason why no plan exists.

    Raises
    ------
    NoClosedForm
        If the arm has no closed form; the message states the reason and the alternative.
    """
    plans = _PLANS.get(arm)
    if plans is None:
        try:
            plans = {UNCHECKED: _best(arm)}
        except NoClosedForm as error:
            plans = str(error)
        _PLANS[arm] = plans
    if isinstance(plans, str):
        raise NoClosedForm(plans)
    tolerances = position_tolerance, orientation_tolerance
    if tolerances not in plans:
        plans[tolerances] = plans[UNCHECKED].with_tolerances(*tolerances)
    return plans[tolerances]


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
    if arm.dof > 7:
        raise NoClosedForm(
            f"no closed form: the arm has {arm.dof} joints, and at most 7 are supported; "
            "select a shorter chain (robot.arm with another base or tcp), or use Clik"
        )
    best, best_score = None, (0, 0, 0.0, 0.0)
    for plan in plans_of(arm):
        score = _score(arm, plan)
        if best is None or score > best_score:
            best, best_score = plan, score
        if best_score[:2] == (TRIALS, 1) and best.redundant is None and best.deviation == 0.0:
            break
    if best_score[0] < TRIALS:
        for plan in general_plans_of(arm):
            score = _score(arm, plan)
            if score[0] > best_score[0] or (score[0] == best_score[0] and score[2:] > best_score[2:]):
                best, best_score = plan, score
    if best is None or best_score[0] < TRIALS // 2:
        raise NoClosedForm(
            "no closed form: the arm is singular in every configuration, or its axes nearly are; use Clik"
        )
    return best


def general_plans_of(arm: Arm) -> Iterator[Plan]:
    """The plans that solve the axes by elimination, without a triple."""
    lines, tool = lines_of(arm)
    size = size_of(lines, tool)
    if len(lines) == 7:
        orders: list[tuple[int | None, list[JointLine]]] = [(locked, list(lines)) for locked in range(7)]
    elif len(lines) == 6:
        orders = [(None, list(lines))]
    else:
        orders = [(None, in_general_position(list(lines), 6 - len(lines), tool, size))]
    for locked, order in orders:
        plan = _plan(arm, order, None, locked, tool, size)
        if plan.core.plan.cuts:
            yield plan


def _score(arm: Arm, plan: Plan) -> tuple[int, int, float, float]:
    """The quality of a plan, for comparison.

    Returns the number of recovered poses, whether no quartic is needed, the share of the redundant joint in the
    self-motion, and the negative deviation.
    """
    rng = np.random.default_rng(0)
    lower, upper = arm.limits.sampling_range()
    tried = plan.with_tolerances(1e-9, 1e-9)
    found, quartic, sensitivity = 0, False, 0.0
    for q in rng.uniform(lower, upper, (TRIALS, plan.dof)):
        target = np.array(arm.forward_kinematics(q).homogeneous)
        value = 0.0 if plan.redundant is None else float(q[plan.redundant])
        branches = tried.solve(target, plan.home, value)
        apart = np.abs(branches.q - q)
        apart = np.where(plan.angular, np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))), apart)
        found += bool((apart.max(axis=1) < 1e-6).any()) if len(branches) else 0
        quartic = quartic or branches.by_quartic
        if plan.redundant is not None:
            motion = np.linalg.svd(arm.jacobian(q))[2][-1]
            sensitivity += float(abs(motion[plan.redundant]) / np.abs(motion).max()) / TRIALS
    return found, int(not quartic), round(sensitivity, 3), -plan.deviation


def _plan(
    arm: Arm, order: Sequence[JointLine], triple: Triple | None, locked: int | None, tool: Array, size: float
) -> Plan:
    six = [i for i in range(len(order)) if i != locked]
    ideal = list(order)
    names = [arm.joint_names[order[i].joint] if order[i].joint >= 0 else "a virtual joint" for i in six]
    deviation = 0.0
    rounding = _core.EQUATION_ROUNDING
    if triple is None:
        method = "the solution for six joints in general position"
    else:
        for i, line in zip(six[triple.first : triple.first + 3], triple.lines, strict=True):
            ideal[i] = line
        _choose_points(ideal, [six[(triple.first + 3 + k) % 6] for k in range(3)])
        method = f"the axes of {', '.join(names[triple.first : triple.first + 3])} {triple.name}"
        if triple.deviation > EXACT:
            deviation = triple.deviation
            method += f" up to {deviation:.2g}; solutions are refined on the true arm"
        else:
            rounding = max(rounding, 4.0 * triple.deviation)
    tool_in_lengths = tool.copy()
    tool_in_lengths[:3, 3] /= size
    eliminated = triple is None or (deviation > 0.0 and locked is None)
    core_plan = _core.ArmPlan(
        chain=arm.chain,
        size=size,
        joints=_planned(arm, ideal, size),
        tool=tool_in_lengths,
        first_of_triple=-1 if triple is None else triple.first,
        planar=triple is not None and triple.planar,
        reversed=triple is not None and triple.planar and triple.lines[2].prismatic and not triple.lines[0].prismatic,
        normal=0 if triple is None else next(k for k in range(3) if not triple.lines[k].prismatic),
        locked=-1 if locked is None else locked,
        border=max(BORDER, 20.0 * deviation),
        spread=20.0 * deviation,
        rounding=rounding,
        true_joints=_planned(arm, order, size) if eliminated else [],
    )
    return Plan(
        core=_core.ClosedForm(core_plan),
        dof=arm.dof,
        size=size,
        method=method,
        redundant=None if locked is None else order[locked].joint,
        deviation=deviation,
        home=arm.home,
        angular=arm.angular,
        capacity=MOST_BRANCHES * (1 if triple is not None and deviation == 0.0 else 2),
    )


def _planned(arm: Arm, lines: Sequence[JointLine], size: float) -> list[_core.PlannedJoint]:
    """The joints with these lines, lengths relative to the size; a virtual joint (index -1) has the limits 0."""
    joints = []
    for line in lines:
        limits = (arm.limits.lower[line.joint], arm.limits.upper[line.joint]) if line.joint >= 0 else (0.0, 0.0)
        joints.append(_core.PlannedJoint(line.direction, line.point / size, bool(line.prismatic), line.joint, *limits))
    return joints


def _choose_points(lines: list[JointLine], outside: Sequence[int]) -> None:
    """Set the point of each of the joints a, b, c closest to its neighbour: if axes meet, terms vanish."""
    a, b, c = outside
    pairs = ((a, b), (b, a), (c, b)) if b == a + 1 else ((a, b), (b, c), (c, b))
    for one, other in pairs:
        if abs(one - other) == 1:
            lines[one] = replace(lines[one], point=lines[one].nearest_to(lines[other]))
