"""The goals of a plan: checked numbers, and the same poses whole turns away.

The ends of a plan: inside the limits and free, by closer bodies where coarse ones touch, or why not.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.planning.result import PlanResult, PlanStatus
from pinproof.spatial import finite

__all__ = ["Ends", "read_ends", "read_goals", "with_turns"]

Array = npt.NDArray[np.float64]

TURN = 2 * np.pi

MOST_TURNED = 512
"""Goals with their turns; of more, those nearest to the start are kept. A UR5 has 32 for each branch."""


def read_goals(arm: Arm, goals: npt.ArrayLike) -> Array:
    """One goal (n,) or several (g, n) as (g, n).

    Raises
    ------
    InputError
        If there is none, a shape is wrong or a number is not finite.
    """
    try:
        dimensions, size = np.ndim(goals), np.size(goals)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"goals must have the shape ({arm.dof},) or (g, {arm.dof}): {error}") from error
    if size == 0:
        raise InputError("goals is empty; give at least one configuration")
    return arm.configuration(goals, "goals")[None] if dimensions == 1 else finite("goals", goals, (None, arm.dof))


def with_turns(arm: Arm, start: Array, goals: Array) -> tuple[Array, list[int]]:
    """The goals and all their equals: the same poses, periodic joints whole turns away inside the limits.

    Where limits leave a joint unbounded, only the two angles on either side of the start's.

    Parameters
    ----------
    arm
        Says which joints are periodic.
    start
        (n,) where the plan begins.
    goals
        (g, n), kept as they are.

    Returns
    -------
    (k, n) goals, the given ones first, then by the largest joint step from the start; and, for each, the index of the
    given goal it equals.
    """
    turned: list[tuple[float, int, Array]] = []
    for index, goal in enumerate(goals):
        for turns in product(*(_turns(arm, joint, start[joint], goal[joint]) for joint in range(arm.dof))):
            if any(turns):
                shift = TURN * np.array(turns)
                # only rounding is clipped: a turn may end one bit beyond a limit that is a multiple of 2 pi
                q = np.where(shift != 0, np.clip(goal + shift, arm.limits.lower, arm.limits.upper), goal)
                turned.append((float(np.abs(q - start).max()), index, q))
    turned.sort(key=lambda entry: entry[:2])
    turned = turned[: max(MOST_TURNED - len(goals), 0)]
    return np.vstack([goals, *(q for _, _, q in turned)]), [*range(len(goals)), *(index for _, index, _ in turned)]


def _turns(arm: Arm, joint: int, start: float, goal: float) -> list[int]:
    """By how many turns a joint may be moved; 0 is always among them."""
    if not arm.periodic[joint]:
        return [0]
    below = int(np.floor((start - goal) / TURN))
    low, high = arm.limits.lower[joint], arm.limits.upper[joint]
    fewest = below if np.isinf(low) else int(np.ceil((low - goal) / TURN))
    most = below + 1 if np.isinf(high) else int(np.floor((high - goal) / TURN))
    return sorted({0, *range(fewest, most + 1)})


TOLD = 5
"""Goals whose troubles are told one by one."""


@dataclass(frozen=True, eq=False)
class Ends:
    """What there is to plan between.

    Parameters
    ----------
    checker
        By which the start and every goal are free.
    start
        (n,)
    goals
        (k, n), at least one.
    indices
        For each goal the index of the caller's that it is, or equals but for whole turns.
    turns
        Whether whole turns were asked for.
    """

    checker: CollisionChecker
    start: Array
    goals: Array
    indices: tuple[int, ...]
    turns: bool


def read_ends(
    checker: CollisionChecker, start: npt.ArrayLike, goals: npt.ArrayLike, *, turns: bool
) -> Ends | PlanResult:
    """The ends of a plan from ``start`` (n,) to ``goals`` (n,) or (g, n); or, if there are none, the result of it.

    Closer bodies are slower to judge. So they are looked at only where the start touches, or every goal does.

    Raises
    ------
    InputError
        If a shape is wrong or a number is not finite.
    """
    arm = checker.arm
    first = arm.limits.snap(arm.configuration(start, "start"))
    given = arm.limits.snap(read_goals(arm, goals))
    many, index_of = with_turns(arm, first, given) if turns else (given, list(range(len(given))))
    inside = [not arm.limits.violations(goal, arm.joint_names) for goal in many]
    if arm.limits.violations(first, arm.joint_names):
        return _invalid_start(checker, first)
    judge = checker
    if not judge.is_free_unchecked(first):
        judge = judge.finer_at(first)
        if not judge.is_free_unchecked(first):
            return _invalid_start(judge, first)

    def valid() -> list[int]:
        return [row for row, goal in enumerate(many) if inside[row] and judge.is_free_unchecked(goal)]

    rows = valid()
    if not rows:
        for goal in given:
            judge = judge.finer_at(goal)
        rows = valid()
    if not rows:
        return _invalid_goals(judge, given)
    return Ends(judge, first, many[rows], tuple(index_of[row] for row in rows), turns)


def _trouble(checker: CollisionChecker, q: Array) -> str:
    """Why q (n,) cannot be an end of a path."""
    outside = checker.arm.limits.violations(q, checker.arm.joint_names)
    return "; ".join(outside) if outside else str(checker.check(q))


def _invalid_start(checker: CollisionChecker, start: Array) -> PlanResult:
    message = f"the start cannot be left: {_trouble(checker, start)}"
    contacts = checker.check(start).contacts
    return PlanResult(PlanStatus.START_INVALID, None, None, None, message, contacts=contacts, checker=checker)


def _invalid_goals(checker: CollisionChecker, goals: Array) -> PlanResult:
    told = "; ".join(f"goal {i}: {_trouble(checker, goal)}" for i, goal in enumerate(goals[:TOLD]))
    more = f"; and {len(goals) - TOLD} more" if len(goals) > TOLD else ""
    contacts = tuple(contact for goal in goals for contact in checker.check(goal).contacts)
    message = f"no goal can be entered: {told}{more}"
    return PlanResult(PlanStatus.GOAL_INVALID, None, None, None, message, contacts=contacts, checker=checker)
