"""The parts of a planning problem: checks of its edges, the valid start and goals, and proofs that no path exists.

A joint cannot pass a value if bodies are in contact there that it alone moves relative to each other: they have the
same distance at all configurations with this value. If the value is between the start and a goal, every path to this
goal contains the contact, because the joint passes the value (intermediate value theorem). An example is the second arm
of a mobile robot in front of a shelf: it is held in place, moves with the torso alone, and cannot pass the boards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby, product
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof._core import EdgeChecker, Manifold
from pinproof.collision import CollisionChecker, PathConstraint, amount, overlap_hint
from pinproof.common.structs import described, key
from pinproof.common.validation import require_type
from pinproof.errors import InputError
from pinproof.model import AT_LIMIT, JointGroup
from pinproof.motion import TorqueLimits
from pinproof.planning.plan_results import Barrier, InvalidEnd, OutsideLimits, PlanResult, PlanStatus
from pinproof.spatial import Array, finite
from pinproof.units import MOST_TURN, hint_at_unit

# Default distance (m) in addition to the margin that samples must keep.
PAD = 5e-4
# Largest factor by which the resolution is refined. Denser samples would cost more than the proofs that they save.
MAX_REFINEMENT = 16
# Share of the torque limits that holding the arm at rest may need; the rest is for the motion and between samples.
STANDSTILL_SHARE = 0.95
# Relative rounding error of the torques at the ends.
AT_ENDS = 1e-9

TURN = 2 * np.pi

# Maximum number of goals including the shifted ones; those nearest to the start are kept. A UR5 has 32 per branch.
MAX_GOALS = 512
# Maximum number of invalid goals that a message describes.
MAX_REPORTED = 5
# Number of values of a joint that are checked between the start and the nearest goal.
VALUES = 128
# Number of values in contact that are checked with finer bodies: a contact of hulls alone proves nothing.
CONFIRMED = 8


# -- edges -------------------------------------------------------------------------------------------------------------


class Edges:
    """The edges of one planning problem.

    Parameters
    ----------
    checker
        Defines the bodies and margins.
    resolution
        Distance (m) by which bodies move between two samples of an edge. It only steers the search.
    ends
        (e, n) free configurations that must stay reachable. If one of them is closer to a body than ``pad``, the pad is
        reduced.
    pad
        Distance (m) in addition to the margin that samples must keep. A path that barely keeps the margin is difficult
        to prove.
    torque_limits
        Only samples at which the joints can hold the arm at rest are free, with a reserve for the motion unless an end
        has none. Proofs do not cover torques.

    Attributes
    ----------
    steering
        The checker with the padded margin.
    core
        The edge checker of the compiled core.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        resolution: float,
        ends: Array,
        *,
        pad: float = PAD,
        torque_limits: TorqueLimits | None = None,
    ) -> None:
        if not resolution > 0:
            raise InputError(f"resolution = {resolution}; it must be a distance above 0 m")
        self._checker, self._resolution, self._finest = checker, resolution, resolution / MAX_REFINEMENT
        self.core = EdgeChecker(checker.world, resolution)
        if torque_limits is not None:
            share = float(np.clip(torque_limits.standstill_share(ends) * (1.0 + AT_ENDS), STANDSTILL_SHARE, 1.0))
            self.core.set_torque_limits(torque_limits.tree, torque_limits.limits * share)
        # The ends must keep twice the pad beyond the margin; where they do not, the pad is half of what they keep.
        common = len(checker.margins) == 0 or float(checker.margins.min()) >= checker.margin
        if not (common and bool(checker.padded(2 * pad).is_free_batch(ends).all())):
            spare = float(checker.clearance_batch(ends).min(initial=np.inf)) - checker.margin
            pad = min(pad, max(spare, 0.0) / 2)
        self._steer(pad)

    def _steer(self, pad: float) -> None:
        self._pad, self.steering = pad, self._checker.padded(pad)
        blocked = bool(self.steering.fixed_contacts)
        self.core.set_steering(self.steering.world, blocked)

    @property
    def samples(self) -> int:
        """Total number of samples so far."""
        return int(self.core.samples)

    def samples_free(self, a: Array, b: Array) -> bool:
        """Whether the samples from a (n,), exclusive, to b (n,), inclusive, are free; b is checked first."""
        return bool(self.core.samples_free(np.ascontiguousarray(a), np.ascontiguousarray(b)))

    def proven_free(self, a: Array, b: Array) -> bool:
        """Whether the edge from a (n,) to b (n,) is proven free; the proof is attempted if its samples are free."""
        return bool(self.core.proven_free(np.ascontiguousarray(a), np.ascontiguousarray(b)))

    def refine(self) -> None:
        """Halve the resolution, down to a limit. To be called if an edge with free samples fails the proof."""
        self._resolution = max(self._resolution / 2, self._finest)
        self.core.set_resolution(self._resolution)

    def reduce_pad(self) -> None:
        """Reduce the pad to a quarter, so that narrower passages are found."""
        self._steer(self._pad / 4)


def manifold_of(group: JointGroup, constraints: Sequence[PathConstraint]) -> Manifold:
    """The configurations of a joint group, within its limits, that satisfy the constraints."""
    lower, upper = np.ascontiguousarray(group.limits.lower), np.ascontiguousarray(group.limits.upper)
    # Consecutive constraints of one tcp share its forward kinematics
    tcps = groupby(constraints, lambda each: (each.arm, each.relative_to))
    parts = [(group.tcp_chain(*tcp), [each.compiled() for each in of_tcp]) for tcp, of_tcp in tcps]
    return Manifold(parts, lower, upper)


def sampling_box(arm: JointGroup, ends: Array) -> Array:
    """(2, n) the joint limits; an unbounded joint gets the range of the ends (e, n), extended by pi on both sides."""
    unbounded = np.isinf(arm.limits.lower) | np.isinf(arm.limits.upper)
    low = np.where(unbounded, np.maximum(ends.min(axis=0) - np.pi, arm.limits.lower), arm.limits.lower)
    high = np.where(unbounded, np.minimum(ends.max(axis=0) + np.pi, arm.limits.upper), arm.limits.upper)
    return np.array([low, high])


# -- start and goals ---------------------------------------------------------------------------------------------------


@described(eq=False)
class Ends:
    """The valid start and goals of a plan."""

    checker: CollisionChecker = key("the checker for which the start and every goal are free")
    start: Array = key("(n,) the first configuration")
    goals: Array = key("(k, n) the goals, at least one")
    indices: tuple[int, ...] = key("for each goal, the index of the given goal that it equals up to multiples of 2 pi")
    turns: bool = key("whether shifted goals were requested")
    torque_limits: TorqueLimits | None = key(
        "the torques that hold the arm at rest at the start and the goals are within these limits; None for no limits",
        default=None,
    )
    in_coarse_contact: tuple[Array, ...] = key("further goals (n,), which may be free with finer bodies", default=())

    def barriers(self) -> tuple[Barrier, ...]:
        """The barriers between the start and every goal, those that are free only with finer bodies included."""
        found, checker = find_barriers(self.checker, self.start, self.goals), self.checker
        if not found:
            return ()
        finer = [q for q in self.in_coarse_contact if checker.finer_at(q).is_free_unchecked(q)]
        return find_barriers(checker, self.start, np.array([*self.goals, *finer])) if finer else found


def with_turns(arm: JointGroup, start: Array, goals: Array) -> tuple[Array, list[int]]:
    """The goals, and the goals with periodic joints shifted by multiples of 2 pi inside the limits.

    For an unbounded joint, only the two angles nearest to the start, one on each side, are added.

    Parameters
    ----------
    arm
        Defines the periodic joints and the limits.
    start
        (n,) the first configuration of the plan.
    goals
        (g, n) the given goals.

    Returns
    -------
    (k, n) the given goals, followed by the shifted ones sorted by the largest joint step from the start; and for each
    the index of the given goal that it equals.
    """
    limits, shifted, index_of = arm.limits, [goals[:0]], list[int]()
    for index, goal in enumerate(goals):
        # The multiples of 2 pi by which each joint may be shifted, including 0.
        turns = [[0] for _ in range(arm.dof)]
        for joint in np.flatnonzero(arm.periodic).tolist():
            below = math.floor((start[joint] - goal[joint]) / TURN)
            low, high = float(limits.lower[joint]), float(limits.upper[joint])
            fewest = below if math.isinf(low) else math.ceil((low - AT_LIMIT - goal[joint]) / TURN)
            most = below + 1 if math.isinf(high) else math.floor((high + AT_LIMIT - goal[joint]) / TURN)
            turns[joint] = sorted({0, *range(fewest, most + 1)})
        shift = TURN * np.array(list(product(*turns)), dtype=float)
        shift = shift[shift.any(axis=1)]
        # Clipping removes rounding only: a shift may end one bit beyond a limit that is a multiple of 2 pi.
        shifted.append(np.where(shift != 0, np.clip(goal + shift, limits.lower, limits.upper), goal))
        index_of += [index] * len(shift)
    every = np.concatenate(shifted)
    order = np.argsort(np.abs(every - start).max(axis=1), kind="stable")[: max(MAX_GOALS - len(goals), 0)]
    return np.vstack([goals, every[order]]), [*range(len(goals)), *(index_of[k] for k in order.tolist())]


def read_configurations(group: JointGroup, q: npt.ArrayLike, name: str) -> Array:
    """(g, n) one configuration (n,) or several (g, n); InputError for anything else."""
    try:
        dimensions, size = np.ndim(q), np.size(q)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"{name} must have the shape ({group.dof},) or (g, {group.dof}): {error}") from error
    if size == 0:
        raise InputError(f"{name} is empty; give at least one configuration")
    return group.configuration(q, name)[None] if dimensions == 1 else finite(name, q, (None, group.dof))


def read_ends(
    checker: CollisionChecker,
    start: npt.ArrayLike,
    goals: npt.ArrayLike,
    *,
    turns: bool,
    constraints: Sequence[PathConstraint] = (),
    torque_limits: TorqueLimits | None = None,
) -> Ends | PlanResult:
    """Validate ``start`` (n,) and ``goals`` (n,) or (g, n); a failed result if the start or all goals are invalid.

    Finer bodies are slower to check. They are used only if the start or every goal is in contact with the coarse ones.

    Raises
    ------
    InputError
        If there is no goal, a shape is wrong or a number is not finite.
    """
    require_type("checker", checker, CollisionChecker)
    group = checker.group
    first = group.limits.snap(group.configuration(start, "start"))
    given = group.limits.snap(read_configurations(group, goals, "goals"))
    many, index_of = with_turns(group, first, given) if turns else (given, list(range(len(given))))
    outside = np.maximum(group.limits.lower - many, many - group.limits.upper).max(axis=1)
    inside = [excess <= 0.0 for excess in outside.tolist()]
    if constraints:
        tolerances, manifold = (
            np.array([constraint.tolerance for constraint in constraints]),
            manifold_of(checker.group, constraints),
        )
        inside = [ok and bool((manifold.errors(q) <= tolerances).all()) for ok, q in zip(inside, many, strict=True)]
    if torque_limits is not None:
        if (names := torque_limits.arm.joint_names) != group.joint_names:
            raise InputError(f"torque_limits are for the joints {names}; the joints of the arm are {group.joint_names}")
        inside = [ok and torque_limits.standstill_share(q) <= 1.0 for ok, q in zip(inside, many, strict=True)]
    violated = _violations(checker, first, constraints, torque_limits)
    if not violated and not checker.is_free_unchecked(first):
        checker = checker.finer_at(first)
    if violated or not checker.is_free_unchecked(first):
        end = _invalid_end(checker, first, None, violated)
        hint = overlap_hint(checker, first, checker.check(first))
        message = "; ".join(filter(None, [f"the start is invalid: {end.message}", hint]))
        return _failed(PlanStatus.START_INVALID, message, checker, [end])

    def valid() -> list[int]:
        rows = np.flatnonzero(inside)
        return np.asarray(rows[checker.is_free_batch(many[rows])]).tolist()

    rows = valid()
    free = set(rows)
    coarse = tuple(q for row, q in enumerate(many) if inside[row] and row not in free) if rows else ()
    if not rows:
        for goal, ok in zip(given, inside, strict=False):  # finer bodies are no remedy for what else is violated
            checker = checker.finer_at(goal) if ok else checker
        rows = valid()
    if not rows:
        ends = [
            _invalid_end(checker, q, i, _violations(checker, q, constraints, torque_limits))
            for i, q in enumerate(given)
        ]
        message = f"the goal is invalid: {ends[0].message}"
        if len(ends) > 1:
            reasons = "; ".join(f"goal {end.goal}: {end.message}" for end in ends[:MAX_REPORTED])
            more = f"; and {len(ends) - MAX_REPORTED} more" if len(ends) > MAX_REPORTED else ""
            message = f"no goal is valid: {reasons}{more}"
        return _failed(PlanStatus.GOAL_INVALID, message, checker, ends)
    return Ends(checker, first, many[rows], tuple(index_of[row] for row in rows), turns, torque_limits, coarse)


def _violations(
    checker: CollisionChecker, q: Array, constraints: Sequence[PathConstraint], torque_limits: TorqueLimits | None
) -> list[str]:
    """What q (n,) violates except distances of bodies: limits of joints, constraints of the tcp, and torques."""
    found = checker.group.limits.violations(q, checker.group.joint_names)
    for constraint in constraints:
        error = constraint.error(checker.group, q)
        if not error <= constraint.tolerance:
            excess = amount(constraint, error - constraint.tolerance)
            found.append(f"{constraint} is violated: the error is {amount(constraint, error)}, {excess} too much")
    heavy = "" if torque_limits is None else torque_limits.standstill(q)
    return [*found, heavy] if heavy else found


def _invalid_end(checker: CollisionChecker, q: Array, goal: int | None, violated: list[str]) -> InvalidEnd:
    """The start or a goal q (n,) with what it violates and its contacts."""
    group = checker.group
    ranges = zip(group.joint_names, q.tolist(), group.limits.lower.tolist(), group.limits.upper.tolist(), strict=True)
    outside = tuple(OutsideLimits(*each) for each in ranges if not each[2] <= each[1] <= each[3])
    found, large = checker.check(q), q[group.angular & (np.abs(q) > MOST_TURN)]
    violated = [*violated, hint_at_unit(float(large[0]), "rad")] if outside and len(large) else violated
    return InvalidEnd(q, goal, outside, found.contacts, "; ".join([*violated, *([] if found.free else [str(found)])]))


def _failed(status: PlanStatus, message: str, checker: CollisionChecker, ends: list[InvalidEnd]) -> PlanResult:
    contacts = tuple(contact for end in ends for contact in end.contacts)
    return PlanResult(status, message=message, contacts=contacts, invalid=tuple(ends), checker=checker)


# -- no path -----------------------------------------------------------------------------------------------------------


def find_barriers(checker: CollisionChecker, start: Array, goals: Array) -> tuple[Barrier, ...]:
    """Return barriers between the start (n,) and the goals (g, n) if every goal is behind a barrier, otherwise ()."""
    # The pairs of bodies that a single joint moves relative to each other, by the index of the joint.
    pairs_of: dict[int, set[int]] = {}
    for pair in range(len(checker.margins)):
        between = {joint.index for joint in checker.world.joints_between(pair)}
        if len(between) == 1:
            pairs_of.setdefault(between.pop(), set()).add(pair)

    reachable = np.ones(len(goals), dtype=bool)
    barriers = []
    for joint, pairs in sorted(pairs_of.items()):
        judge = checker.without_pairs(set(range(len(checker.margins))) - pairs)
        owners = {frozenset(checker.bodies[i].owner for i in checker.indices_of(pair)) for pair in pairs}
        for side in (-1.0, 1.0):
            steps = side * (goals[:, joint] - start[joint])
            behind = reachable & (steps > 0)
            if not behind.any():
                continue
            # Values of the joint between the start and the nearest goal on this side at which a pair is in contact.
            q = np.tile(start, (VALUES, 1))
            q[:, joint] += side * float(steps[behind].min()) * np.arange(1, VALUES + 1) / (VALUES + 1)
            blocked = [k for k in range(VALUES) if not judge.is_free_unchecked(q[k])]
            chosen = np.linspace(0, len(blocked) - 1, min(CONFIRMED, len(blocked)))
            # Contacts of hulls are no proof; the deepest contact of finer bodies is the barrier.
            confirmed = [
                Barrier(judge.group.joint_names[joint], float(q[k, joint]), contact)
                for k in (blocked[round(row)] for row in chosen.tolist())
                for contact in judge.finer_at(q[k]).check(q[k]).contacts
                if frozenset(contact.bodies) in owners  # checkers with finer bodies check all pairs again
            ]
            if confirmed:
                barriers.append(min(confirmed, key=lambda barrier: barrier.contact.distance))
                reachable &= ~behind
    return () if reachable.any() else tuple(barriers)


def no_path(barriers: tuple[Barrier, ...]) -> dict[str, Any]:
    """The fields of the result of a plan to goals behind these barriers."""
    remedy = "Move what collides, hold its joints at other values, or choose goals before this value"
    message = f"no path exists: {'; '.join(map(str, barriers))}. {remedy}"
    contacts = tuple(barrier.contact for barrier in barriers)
    return {"status": PlanStatus.IMPOSSIBLE, "message": message, "contacts": contacts, "barriers": barriers}
