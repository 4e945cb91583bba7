"""The ends of a plan: inside the limits and free, by closer bodies where coarse ones touch, or why not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker
from pinproof.planning.goals import read_goals, with_turns
from pinproof.planning.result import PlanResult, PlanStatus

__all__ = ["Ends", "read_ends"]

Array = npt.NDArray[np.float64]

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
