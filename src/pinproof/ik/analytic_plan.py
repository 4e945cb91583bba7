"""The preparation of an arm for the closed form: its axes, the triples among them, and the choice of a plan.

A *triple* consists of three consecutive axes that meet in one point or generate motions of one plane. If several
triples are possible, each is tested on random poses of the arm. Among those that recover all of them, the plan without
a quartic and with the smallest deviation from the ideal geometry is used. The true axes of arms that deviate from it,
or that have no triple, are solved in general position (``src/core/closed_form/general_loop.h``).

A prismatic joint commutes with an adjacent revolute joint whose axis is parallel: a SCARA with the order RRPR is
equivalent to RRRP.

Of seven joints one is *locked* at given values, of eight the first two. A rail or turntable before an arm of six joints
is locked itself; other arms of seven joints are considered with each joint locked in turn.

An arm of fewer than six joints is completed by virtual revolute joints, whose values must be zero. If two of its axes
meet or are parallel, one virtual joint completes them to a triple; a single revolute axis needs two, and no revolute
axis three. The remaining virtual axes pass near the tcp in general position: the best conditioned of some random draws.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from pinproof import _core
from pinproof.errors import InputError, NoClosedForm
from pinproof.model import Arm
from pinproof.spatial import Array, rigid, rotation_about_line

SNAP_TOLERANCE = 5e-3
"""Rad, and m for an arm of 1 m. Calibration moves axes by less, and Newton's method on the true arm still converges."""

EXACT = 1e-9
"""Rad, and fraction of the arm's size. Axes this close to the ideal are treated as ideal: the error of a branch is then
below the finest tolerance."""

DISTINCT = 1e-2
"""Rad, and fraction of the arm's size. Two axes closer than this act as one joint and are not used in one triple."""

FAR = 0.25
"""Fraction of the arm's size. The first two axes of arms with seven joints are closer than this (0.16 for a Tiago)."""

DRAWS = 24
"""Number of random choices of virtual axes that are compared."""

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
class JointLine:
    """A joint axis: unit direction (3,), point (3,) in m, whether it is prismatic, and its index in q (-1: virtual)."""

    direction: Array
    point: Array
    prismatic: bool = False
    joint: int = -1

    def nearest_to(self, other: JointLine) -> Array:
        """The point (3,) of this line that is closest to another line; for parallel lines, to the other's point."""
        gap = other.point - self.point
        cosine = float(self.direction @ other.direction)
        across = 1.0 - cosine**2
        if across < DISTINCT**2:
            return np.asarray(self.point + (gap @ self.direction) * self.direction)
        along = (gap @ self.direction - (gap @ other.direction) * cosine) / across
        return np.asarray(self.point + along * self.direction)


Order = list[JointLine]


@dataclass(frozen=True, eq=False)
class Triple:
    """Three consecutive axes of six that meet in one point, or that generate motions of one plane (``planar``)."""

    first: int  # index of the first axis
    planar: bool
    deviation: float  # from the ideal geometry: rad, or m divided by the arm's size
    lines: tuple[JointLine, ...]  # the three axes, moved to the ideal geometry


def lines_of(arm: Arm) -> tuple[Order, Array]:
    """The joint axes at q = 0, and base_from_tcp (4, 4) at q = 0; NoClosedForm if the chain contains a mimic joint."""
    chain = arm.chain
    if chain.has_mimic_joints:
        raise NoClosedForm(
            f"no closed form: the chain from {arm.base!r} to {arm.tcp!r} contains a mimic joint, which couples the "
            "equations; use Clik"
        )
    pose, lines = np.eye(4), []
    for joint in chain.joints:
        pose = pose @ joint.before
        lines.append(JointLine(pose[:3, 2].copy(), pose[:3, 3].copy(), joint.prismatic, joint.index))
    return lines, pose @ chain.tool


def size_of(lines: Sequence[JointLine], tool: Array) -> float:
    """The size of the arm (m): the largest distance between its joints and the tcp."""
    points = np.array([line.point for line in lines] + [tool[:3, 3]])
    return max(float(np.linalg.norm(points[:, None] - points[None], axis=2).max()), 1e-3)


# -- triples ----------------------------------------------------------------------------------------------------------


def find_triples(lines: Sequence[JointLine], size: float, tolerance: float = SNAP_TOLERANCE) -> Iterator[Triple]:
    """All triples of consecutive lines whose deviation is within the tolerance."""
    for first in range(len(lines) - 2):
        three = lines[first : first + 3]
        for triple in (_spherical(first, three, size), _planar(first, three, size)):
            if triple is not None and triple.deviation <= tolerance:
                yield triple


def _spherical(first: int, three: Sequence[JointLine], size: float) -> Triple | None:
    if any(line.prismatic for line in three):
        return None
    axes = np.array([line.direction for line in three])
    if min(np.linalg.norm(np.cross(axes[i], axes[i + 1])) for i in range(2)) < DISTINCT:
        return None
    # the point closest to all three lines
    points = np.array([line.point for line in three])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centre = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    deviation = float(np.linalg.norm(np.einsum("kij,kj->ki", across, centre - points), axis=1).max()) / size
    return Triple(first, False, deviation, tuple(replace(line, point=centre) for line in three))


def _planar(first: int, three: Sequence[JointLine], size: float) -> Triple | None:
    # the normal of the plane: the mean direction of the axes that turn
    turning = [line for line in three if not line.prismatic]
    if not turning:
        return None
    same = np.array([np.sign(line.direction @ turning[0].direction) * line.direction for line in turning])
    normal = same.sum(axis=0)
    if np.linalg.norm(normal) < 0.5:
        return None
    normal /= np.linalg.norm(normal)
    deviation = max(
        float(abs(line.direction @ normal) if line.prismatic else np.linalg.norm(np.cross(line.direction, normal)))
        for line in three
    )
    # axes that slide are turned into the plane; those that turn become normal to it
    level = normal @ turning[0].point
    ideal: Order = []
    for line in three:
        if line.prismatic:
            direction = line.direction - (line.direction @ normal) * normal
            if np.linalg.norm(direction) < 0.5:
                return None
            ideal.append(replace(line, direction=direction / np.linalg.norm(direction)))
        else:
            direction = np.sign(line.direction @ normal) * normal
            ideal.append(replace(line, direction=direction, point=line.point + (level - normal @ line.point) * normal))
    # neighbours that coincide act as one joint
    for a, b in pairwise(ideal):
        if a.prismatic and b.prismatic and np.linalg.norm(np.cross(a.direction, b.direction)) < DISTINCT:
            return None
        if not (a.prismatic or b.prismatic) and np.linalg.norm(a.point - b.point) / size < DISTINCT / 10:
            return None
    return Triple(first, True, deviation, tuple(ideal))


# -- completion to six axes -------------------------------------------------------------------------------------------

Locked = tuple[int, ...]
"""Indices of locked joints, ascending."""


def choices_of_locked(lines: Order, size: float) -> list[list[Locked]]:
    """The sets of joints that may be locked, in groups; a group is used if none before it has a plan for all poses.

    The first of seven joints is taken to be external if it is prismatic, or unless its axis is perpendicular to the
    next one and near it, as those of arms with seven joints are.
    """
    outer = tuple(range(len(lines) - 6))
    if len(lines) != 7:
        return [[outer]]
    one, other = lines[:2]
    tilted = abs(one.direction @ other.direction) > SNAP_TOLERANCE
    apart = np.linalg.norm(one.nearest_to(other) - other.nearest_to(one)) > FAR * size
    each: list[Locked] = [(joint,) for joint in range(7)]
    return [[outer], each] if one.prismatic or tilted or apart else [each]


def completed(lines: Order, tool: Array, size: float) -> Iterator[Order]:
    """Chains of six lines."""
    # the orders that result from swapping adjacent joints that commute, the original order first
    orders = [lines]
    for order in orders:
        for i, (a, b) in enumerate(pairwise(order)):
            if a.prismatic != b.prismatic and np.linalg.norm(np.cross(a.direction, b.direction)) <= 1e-9:
                swapped = [*order[:i], b, a, *order[i + 2 :]]
                if not any([x.joint for x in swapped] == [x.joint for x in other] for other in orders):
                    orders.append(swapped)
    for order in orders:
        for with_triple in _with_triple(order, tool, size):
            yield in_general_position(with_triple, tool, size)


def _with_triple(lines: Order, tool: Array, size: float) -> Iterator[Order]:
    """The lines, completed by the fewest virtual axes such that three consecutive ones are a triple."""
    missing, place, rng, found = 6 - len(lines), tool[:3, 3], np.random.default_rng(1), False
    if missing == 0 or any(find_triples(lines, size)):
        yield lines
        return
    # one virtual axis completes two adjacent axes
    for i, (a, b) in enumerate(pairwise(lines)):
        virtual = _third(a, b, place, size)
        if virtual is None:
            continue
        for at in (i, i + 1, i + 2):
            order = [*lines[:at], virtual, *lines[at:]]
            if any(triple.first <= at < triple.first + 3 for triple in find_triples(order, size)):
                found = True
                yield order
    if found:
        return
    # two complete a revolute axis, in the point of it that is closest to the tcp; three are a triple of their own
    if missing >= 2:
        for i, line in enumerate(lines):
            if not line.prismatic:
                centre = line.point + ((place - line.point) @ line.direction) * line.direction
                found = True
                yield [*lines[: i + 1], *(JointLine(_unit(rng), centre) for _ in range(2)), *lines[i + 1 :]]
    if missing >= 3 and not found:
        yield [*lines, *(JointLine(direction, place) for direction in np.eye(3))]


def _third(a: JointLine, b: JointLine, place: Array, size: float) -> JointLine | None:
    """The virtual axis that completes two adjacent axes to a triple, if one does."""
    normal = np.cross(a.direction, b.direction)
    sine = np.linalg.norm(normal)
    if a.prismatic and b.prismatic:
        return JointLine(normal / sine, place) if sine > DISTINCT else None
    if a.prismatic or b.prismatic:
        turning = b if a.prismatic else a
        perpendicular = abs(a.direction @ b.direction) < SNAP_TOLERANCE
        return _beside(turning.direction, turning, turning, place, size) if perpendicular else None
    if sine < SNAP_TOLERANCE:
        return _beside(a.direction, a, b, place, size)
    centre = a.nearest_to(b)
    meet = sine > DISTINCT and np.linalg.norm(centre - b.nearest_to(a)) < SNAP_TOLERANCE * size
    return JointLine(normal / sine, centre) if meet else None


def _beside(direction: Array, a: JointLine, b: JointLine, place: Array, size: float) -> JointLine:
    """A parallel axis distinct from both: through the tcp, or at a distance from it."""
    aside = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    for offset in (0.0, 0.5, 1.1, 1.7):
        point = place + offset * size * aside
        if min(np.linalg.norm(np.cross(direction, point - line.point)) for line in (a, b)) > 0.1 * size:
            return JointLine(direction, point)
    return JointLine(direction, place)


def in_general_position(lines: Order, tool: Array, size: float) -> Order:
    """The lines, completed to six by virtual axes near the tcp: the best conditioned of some random draws."""
    missing = 6 - len(lines)
    best, best_value = lines, -1.0
    for draw in range(DRAWS if missing > 0 else 0):
        rng = np.random.default_rng(draw)
        more = [JointLine(_unit(rng), tool[:3, 3] + rng.uniform(-0.5, 0.5, 3) * size) for _ in range(missing)]
        order = [*lines, *more]
        value = min(_conditioning(order, np.random.default_rng(7 + k), size) for k in range(4))
        if value > best_value:
            best, best_value = order, value
    return best


def _conditioning(lines: Sequence[JointLine], rng: np.random.Generator, size: float) -> float:
    """The smallest singular value of the screws of the lines, at random values of the joints that are not virtual."""
    moved, screws = np.eye(4), []
    for line in lines:
        h = moved[:3, :3] @ line.direction
        o = moved[:3, :3] @ line.point + moved[:3, 3]
        screws.append(
            np.concatenate([h, np.zeros(3)]) if line.prismatic else np.concatenate([np.cross(o, h) / size, h])
        )
        if line.joint >= 0:
            value, step = float(rng.uniform(-2.0, 2.0)), np.eye(4)
            if line.prismatic:
                step[:3, 3] = value * size * line.direction
            else:
                step = rotation_about_line(line.point, line.direction, value)
            moved = moved @ step
    return float(np.linalg.svd(np.array(screws), compute_uv=False)[-1])


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


# -- plans ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Plan:
    """The prepared solution of an arm of n joints; it does not hold the arm, so that the arm can be freed."""

    core: _core.ClosedForm  # the solver of the compiled core
    dof: int
    redundant: Locked  # indices of the joints that are locked or swept; empty for up to six joints
    deviation: float  # of the axes from the ideal geometry (rad, or fraction of the arm's size); 0 within rounding
    home: Array  # (n,) the default reference configuration
    capacity: int  # number of rows for branches in a batch
    tolerances: tuple[float, float] = UNCHECKED  # of a solution, in m and rad

    def solve(self, target: Array, reference: Array, *values: float) -> _core.Branches:
        """The branches for a pose (4, 4), at the values of the redundant joints.

        InputError if the pose is not rigid.
        """
        found = self.core.solve(target, reference, np.array(values))
        if found is None:
            rigid("target", target)  # raises with the reason
            raise InputError("the target is not a rigid transform")
        return found

    def with_tolerances(self, position: float, orientation: float) -> Plan:
        """A copy of the plan for tolerances in m and rad."""
        virtual = max(VIRTUAL_TOLERANCE, 100.0 * self.deviation, 100.0 * max(position, orientation))
        core = self.core.with_tolerances(position, orientation, virtual)
        return replace(self, core=core, tolerances=(position, orientation))

    def without_limits(self) -> Plan:
        """A copy of the plan for joints without limits."""
        return replace(self, core=self.core.without_limits())


_PLANS: weakref.WeakKeyDictionary[Arm, dict[tuple[float, float], Plan] | str] = weakref.WeakKeyDictionary()
"""The plans of each arm by tolerances, or why it has none: the search for one takes up to a second."""


def plan_for(arm: Arm, position_tolerance: float, orientation_tolerance: float) -> Plan:
    """The plan of an arm for tolerances in m and rad; it is cached, as is the reason why no plan exists.

    NoClosedForm if the arm has no closed form; the message states the reason and the alternative.
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


def _best(arm: Arm) -> Plan:
    if arm.dof > 8:
        raise NoClosedForm(
            f"no closed form: the arm has {arm.dof} joints, and at most 8 are supported; "
            "select a shorter chain (robot.arm with another base or tcp), or use Clik"
        )
    best, best_score = None, (0, 0, 0.0, 0.0)
    lines, tool = lines_of(arm)
    for choices in choices_of_locked(lines, size_of(lines, tool)):
        # the plan that recovers the most poses; one that is exact and recovers all needs no comparison
        for plan in plans_of(arm, choices):
            score = _score(arm, plan)
            if best is None or score > best_score:
                best, best_score = plan, score
            if best_score[:2] == (TRIALS, 1) and len(choices) == 1 and best.deviation == 0.0:
                break
        # no triple recovers all poses: the plans by elimination, for which it does not count that they need a quartic
        if best_score[0] < TRIALS:
            for plan in plans_of(arm, choices, general=True):
                score = _score(arm, plan)
                if score[0] > best_score[0] or (score[0] == best_score[0] and score[2:] > best_score[2:]):
                    best, best_score = plan, score
        if best_score[0] == TRIALS:
            break
    if best is None or best_score[0] < TRIALS // 2:
        raise NoClosedForm(
            "no closed form: the arm is singular in every configuration, or its axes nearly are; use Clik"
        )
    return best


def plans_of(arm: Arm, choices: Sequence[Locked] = ((),), *, general: bool = False) -> Iterator[Plan]:
    """All plans that the arm's geometry permits before they are tested, exact ones first.

    With ``general``, those that solve the axes by elimination, without a triple.
    """
    lines, tool = lines_of(arm)
    size = size_of(lines, tool)
    if general:
        order = in_general_position(lines, tool, size)
        plans = (_plan(arm, order, None, locked, tool, size) for locked in choices)
        yield from (plan for plan in plans if plan.core.plan.cuts)
        return
    for locked, order in product(choices, [lines] if len(lines) > 6 else completed(lines, tool, size)):
        six = [line for i, line in enumerate(order) if i not in locked]
        for triple in sorted(find_triples(six, size), key=lambda triple: triple.deviation > EXACT):
            # a locked joint between the axes of the triple would change its geometry
            if not any(triple.first < joint < triple.first + 3 for joint in locked):
                yield _plan(arm, order, triple, locked, tool, size)


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
        branches = tried.solve(target, plan.home, *q[list(plan.redundant)])
        apart = np.abs(branches.q - q)
        apart = np.where(arm.angular, np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))), apart)
        found += bool((apart.max(axis=1) < 1e-6).any()) if len(branches) else 0
        quartic = quartic or branches.by_quartic
        if plan.redundant:
            motion = np.abs(np.linalg.svd(arm.jacobian(q))[2][-1])
            sensitivity += float(motion[plan.redundant[0]] / motion.max()) / TRIALS
    return found, int(not quartic), round(sensitivity, 3), -plan.deviation


def _plan(arm: Arm, order: Order, triple: Triple | None, locked: Locked, tool: Array, size: float) -> Plan:
    """The plan for six axes and those that are locked; without a triple, by elimination."""
    six = [i for i in range(len(order)) if i not in locked]
    ideal, deviation, rounding = list(order), 0.0, _core.EQUATION_ROUNDING
    planar, reverse, normal = False, False, 0
    if triple is not None:
        for i, line in zip(six[triple.first : triple.first + 3], triple.lines, strict=True):
            ideal[i] = line
        # the point of each of the other joints a, b, c closest to its neighbour: if axes meet, terms vanish
        a, b, c = (six[(triple.first + 3 + k) % 6] for k in range(3))
        for one, other in ((a, b), (b, a), (c, b)) if b == a + 1 else ((a, b), (b, c), (c, b)):
            if abs(one - other) == 1:
                ideal[one] = replace(ideal[one], point=ideal[one].nearest_to(ideal[other]))
        if triple.deviation > EXACT:
            deviation = triple.deviation  # solutions are refined on the true arm
        else:
            rounding = max(rounding, 4.0 * triple.deviation)
        planar = triple.planar
        reverse = planar and triple.lines[2].prismatic and not triple.lines[0].prismatic
        normal = next(k for k in range(3) if not triple.lines[k].prismatic)
    # the core computes with lengths relative to the size of the arm
    tool_in_lengths = tool.copy()
    tool_in_lengths[:3, 3] /= size
    # the first branches of an arm of seven suffice, but those of an arm on a rail are all wanted
    eliminated = triple is None or (deviation > 0.0 and locked == tuple(range(len(order) - 6)))
    core_plan = _core.ArmPlan(
        chain=arm.chain,
        size=size,
        joints=_planned(arm, ideal, size),
        tool=tool_in_lengths,
        first_of_triple=-1 if triple is None else triple.first,
        planar=planar,
        reversed=reverse,
        normal=normal,
        locked=list(locked),
        border=max(BORDER, 20.0 * deviation),
        spread=20.0 * deviation,
        rounding=rounding,
        true_joints=_planned(arm, order, size) if eliminated else [],
    )
    redundant = tuple(order[joint].joint for joint in locked)
    capacity = MOST_BRANCHES * (1 if triple is not None and deviation == 0.0 else 2)
    return Plan(_core.ClosedForm(core_plan), arm.dof, redundant, deviation, arm.home, capacity)


def _planned(arm: Arm, lines: Sequence[JointLine], size: float) -> list[_core.PlannedJoint]:
    """The joints with these lines, lengths relative to the size; a virtual joint (index -1) has the limits 0."""
    joints = []
    for line in lines:
        limits = (arm.limits.lower[line.joint], arm.limits.upper[line.joint]) if line.joint >= 0 else (0.0, 0.0)
        joints.append(_core.PlannedJoint(line.direction, line.point / size, bool(line.prismatic), line.joint, *limits))
    return joints
