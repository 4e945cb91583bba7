"""Validation of the start and the goals of a plan, and goals shifted by multiples of 2 pi."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Contact, PathConstraint, overlap_hint
from pinproof.common.validation import require_type
from pinproof.errors import InputError
from pinproof.model import AT_LIMIT, JointGroup
from pinproof.motion import TorqueLimits
from pinproof.planning.constrained import manifold_of, violations_at
from pinproof.planning.result import PlanResult, PlanStatus
from pinproof.spatial import Array, finite

TURN = 2 * np.pi

MAX_GOALS = 512
"""Maximum number of goals including the shifted ones; those nearest to the start are kept. A UR5 has 32 per branch."""

MAX_REPORTED = 5
"""Maximum number of invalid goals that a message describes."""


@dataclass(frozen=True, eq=False)
class Ends:
    """The valid start and goals of a plan.

    Parameters
    ----------
    checker
        The checker for which the start and every goal are free.
    start
        (n,) the first configuration.
    goals
        (k, n) the goals, at least one.
    indices
        For each goal, the index of the given goal that it equals up to multiples of 2 pi.
    turns
        Whether shifted goals were requested.
    torque_limits
        The torques that hold the arm at rest at the start and the goals are within these limits; None for no limits.
    """

    checker: CollisionChecker
    start: Array
    goals: Array
    indices: tuple[int, ...]
    turns: bool
    torque_limits: TorqueLimits | None = None


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
    try:
        dimensions, size = np.ndim(goals), np.size(goals)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"goals must have the shape ({group.dof},) or (g, {group.dof}): {error}") from error
    if size == 0:
        raise InputError("goals is empty; give at least one configuration")
    many = group.configuration(goals, "goals")[None] if dimensions == 1 else finite("goals", goals, (None, group.dof))
    given = group.limits.snap(many)
    many, index_of = with_turns(group, first, given) if turns else (given, list(range(len(given))))
    outside = np.maximum(group.limits.lower - many, many - group.limits.upper).max(axis=1)
    inside = [excess <= 0.0 for excess in outside.tolist()]
    if constraints:
        tolerances, manifold = np.array([each.tolerance for each in constraints]), manifold_of(checker.arm, constraints)
        inside = [ok and bool((manifold.errors(q) <= tolerances).all()) for ok, q in zip(inside, many, strict=True)]
    if torque_limits is not None:
        require_arm(torque_limits, group)
        inside = [ok and torque_limits.standstill_share(q) <= 1.0 for ok, q in zip(inside, many, strict=True)]
    violated = _violations(checker, first, constraints, torque_limits)
    if not violated and not checker.is_free_unchecked(first):
        checker = checker.finer_at(first)
    if violated or not checker.is_free_unchecked(first):
        found = checker.check(first)
        hint = overlap_hint(checker, first, found)
        reason = "; ".join(filter(None, [*(violated or [str(found)]), hint]))
        return _failed(PlanStatus.START_INVALID, f"the start is invalid: {reason}", checker, found.contacts)

    def valid() -> list[int]:
        rows = np.flatnonzero(inside)
        return np.asarray(rows[checker.is_free_batch(many[rows])]).tolist()

    rows = valid()
    if not rows:
        for goal in given:
            checker = checker.finer_at(goal)
        rows = valid()
    if not rows:
        reasons = "; ".join(
            f"goal {i}: {'; '.join(_violations(checker, q, constraints, torque_limits) or [str(checker.check(q))])}"
            for i, q in enumerate(given[:MAX_REPORTED])
        )
        more = f"; and {len(given) - MAX_REPORTED} more" if len(given) > MAX_REPORTED else ""
        contacts = tuple(contact for goal in given for contact in checker.check(goal).contacts)
        return _failed(PlanStatus.GOAL_INVALID, f"no goal is valid: {reasons}{more}", checker, contacts)
    return Ends(checker, first, many[rows], tuple(index_of[row] for row in rows), turns, torque_limits)


def require_arm(torque_limits: TorqueLimits, arm: JointGroup) -> None:
    """Raise InputError unless torque limits are for the joints of an arm."""
    if torque_limits.arm.joint_names != arm.joint_names:
        names = torque_limits.arm.joint_names
        raise InputError(f"torque_limits are for the joints {names}; the joints of the arm are {arm.joint_names}")


def _violations(
    checker: CollisionChecker, q: Array, constraints: Sequence[PathConstraint], torque_limits: TorqueLimits | None
) -> list[str]:
    """What q (n,) violates except distances of bodies: limits of joints, constraints of the tcp, and torques."""
    found = checker.group.limits.violations(q, checker.group.joint_names) + violations_at(checker, q, constraints)
    heavy = "" if torque_limits is None else torque_limits.standstill(q)
    return [*found, heavy] if heavy else found


def _failed(status: PlanStatus, message: str, checker: CollisionChecker, contacts: tuple[Contact, ...]) -> PlanResult:
    return PlanResult(status, message=message, contacts=contacts, checker=checker)
