"""A planning problem: an arm, what stands around it, a start and goals, and whether these touch anything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Scene
from pinproof.errors import UnknownNameError
from pinproof.model import Arm

__all__ = ["Ends", "PlanProblem", "choose_sets", "is_named", "look_at_ends"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlanProblem:
    """One problem.

    Parameters
    ----------
    collection, set_name, number
        Where it comes from: ``"ur5"``, ``"shelf"``, 3.
    arm, scene
        Who moves, among what.
    start, goals
        (n,) and (g, n) rad or m; any of the goals will do.
    notes
        What had to be changed to ask it of this arm, in sentences.
    """

    collection: str
    set_name: str
    number: int
    arm: Arm
    scene: Scene
    start: Array
    goals: Array
    notes: tuple[str, ...] = ()

    @property
    def full_set(self) -> str:
        """``"ur5/shelf"``."""
        return f"{self.collection}/{self.set_name}"

    @property
    def name(self) -> str:
        """``"ur5/shelf/3"``."""
        return f"{self.full_set}/{self.number}"


@dataclass(frozen=True)
class Ends:
    """What the start and the goals of a problem touch.

    Parameters
    ----------
    hull, exact
        What is wrong with the ends, in sentences that name the bodies: with links as hulls, which planners check, and
        with links as their own meshes. Of several goals, those of the goals only where all of them are bad.
    """

    hull: tuple[str, ...]
    exact: tuple[str, ...]

    @property
    def free(self) -> bool:
        """Whether the problem makes sense: by the exact meshes a start and a goal are free."""
        return not self.exact

    @property
    def hull_only(self) -> bool:
        """Whether only the hulls touch."""
        return bool(self.hull) and not self.exact


def look_at_ends(problem: PlanProblem, hulls: CollisionChecker, exact: CollisionChecker) -> Ends:
    """Look at the ends of a problem with both checkers."""
    return Ends(_wrong(problem, hulls), _wrong(problem, exact))


def _wrong(problem: PlanProblem, checker: CollisionChecker) -> tuple[str, ...]:
    start = _trouble(problem, checker, problem.start)
    goals = [_trouble(problem, checker, goal) for goal in problem.goals]
    found = [f"start: {start}"] if start else []
    if all(goals):
        found += [f"goal: {trouble}" for trouble in dict.fromkeys(goals)]
    return tuple(found)


def _trouble(problem: PlanProblem, checker: CollisionChecker, q: Array) -> str:
    outside = problem.arm.limits.violations(q, problem.arm.joint_names)
    touching = checker.check(q)
    return "; ".join([*outside, *([] if touching.free else [str(touching)])])


def is_named(full_set: str, names: tuple[str, ...]) -> bool:
    """Whether a set such as ``"ur5/shelf"`` is meant by any of the names ``"ur5/shelf"``, ``"ur5"``, ``"shelf"``.

    No names mean all sets.
    """
    return not names or any(name == full_set or name in full_set.split("/") for name in names)


def choose_sets(sets: list[str], names: tuple[str, ...]) -> list[str]:
    """The sets that the names mean.

    Raises
    ------
    UnknownNameError
        For a name that means none.
    """
    for name in names:
        if not any(is_named(full_set, (name,)) for full_set in sets):
            raise UnknownNameError("set of problems", name, {word for s in sets for word in (s, *s.split("/"))})
    return [full_set for full_set in sets if is_named(full_set, names)]
