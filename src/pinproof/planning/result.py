"""What a planner says: a certified path, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pinproof.collision import Certificate
from pinproof.errors import PlanFailed
from pinproof.motion import JointPath

__all__ = ["PlanResult", "PlanStatus"]


class PlanStatus(Enum):
    """How a plan ended."""

    FOUND = "found"
    START_INVALID = "the start is in contact or outside its limits"
    GOAL_INVALID = "no goal is free and inside its limits"
    OUT_OF_BUDGET = "no path was found within the budget; there may be one"


@dataclass(frozen=True, eq=False)
class PlanResult:
    """The outcome of a plan.

    Parameters
    ----------
    status
        FOUND, or why not.
    path
        The path from start to the goal that was reached; None unless FOUND.
    certificate
        FREE, for exactly ``path``; None unless FOUND.
    goal
        The index of the goal that was reached; None unless FOUND.
    message
        The outcome in a sentence, with what to do.
    nodes
        Configurations in both trees.
    cut
        Edges that looked free at their samples and failed the proof.
    """

    status: PlanStatus
    path: JointPath | None
    certificate: Certificate | None
    goal: int | None
    message: str
    nodes: int = 0
    cut: int = 0

    @property
    def ok(self) -> bool:
        """Whether a certified path was found."""
        return self.status is PlanStatus.FOUND

    def or_raise(self) -> PlanResult:
        """Return the result if a path was found.

        Raises
        ------
        PlanFailed
            With the message otherwise.
        """
        if not self.ok:
            raise PlanFailed(self.message, self)
        return self
