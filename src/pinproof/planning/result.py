"""What a planner says: a certified path, or why there is none; and how far it is meanwhile.

What a straight move of the tcp came to: a certified curve, or where it stops and why.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from pinproof.collision import Certificate, CollisionChecker, Contact
from pinproof.errors import PlanFailed
from pinproof.motion import BlendedPath, CubicPath, JointPath

__all__ = [
    "LinearPlanResult",
    "LinearStatus",
    "PlanProgress",
    "PlanResult",
    "PlanStatus",
    "PosesPlanResult",
    "Progress",
]


class PlanStatus(Enum):
    """How a plan ended."""

    FOUND = "found"
    START_INVALID = "the start is in contact or outside its limits"
    GOAL_INVALID = "no goal is free and inside its limits"
    OUT_OF_BUDGET = "no path was found within the budget; there may be one"
    CANCELLED = "the progress callback said to stop"


@dataclass(frozen=True)
class PlanProgress:
    """How far a search is.

    Parameters
    ----------
    nodes
        Configurations in both trees.
    samples
        Random samples so far.
    seconds
        Since the search began.
    gap
        Smallest distance (rad or m, Euclidean) seen between the trees; inf before any was looked at.
    """

    nodes: int
    samples: int
    seconds: float
    gap: float


Progress = Callable[[PlanProgress], bool | None]
"""Called many times a second while a plan is searched; where it returns False, the search ends as CANCELLED."""


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
        Configurations in both trees, or in whatever graph the planner has.
    cut
        Edges that looked free at their samples and failed the proof.
    samples
        Random samples that were taken.
    seconds
        How long it took.
    gap
        Smallest distance (rad or m, Euclidean) between what was reached from the start and from the goals; 0 where they
        met, NaN where nothing was searched.
    contacts
        What the start touches, or the goals, where that is why there is no path.
    checker
        The checker the certificate holds for: the caller's, or where an end touched by coarse bodies alone one that
        judges those pairs more finely (:meth:`~pinproof.CollisionChecker.finer_at`). Hand it on to what changes the
        path: shortcuts, blends, the certificate of the trajectory.
    """

    status: PlanStatus
    path: JointPath | None
    certificate: Certificate | None
    goal: int | None
    message: str
    nodes: int = 0
    cut: int = 0
    samples: int = 0
    seconds: float = 0.0
    gap: float = np.nan
    contacts: tuple[Contact, ...] = ()
    checker: CollisionChecker | None = None

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


class LinearStatus(Enum):
    """How a straight move, or one through poses, ended."""

    COMPLETE = "complete"
    UNREACHABLE = "a pose on the way is out of reach without leaving the branch"
    LIMIT = "a joint is at its limit"
    JUMP = "the joints would have to jump"
    CONTACT = "a body touches"
    UNDECIDED = "the proof met its tolerance"


@dataclass(frozen=True, eq=False)
class LinearPlanResult:
    """A straight move of the tcp.

    Parameters
    ----------
    status
        COMPLETE, or why it stops.
    path
        The joint curve; None unless COMPLETE.
    certificate
        FREE when COMPLETE; the verdict that stopped it for CONTACT and UNDECIDED; else None.
    fraction
        The share of the line, 0 to 1, up to which the move is possible and proven free.
    message
        The outcome in a sentence.
    deviation, rotation_deviation
        By how much (m, rad) the tcp may be off where it should be anywhere on ``path``: bounds, not samples; NaN
        without one.
    joints
        Those at their limits, or that would have to jump, where that is what stops it.
    """

    status: LinearStatus
    path: CubicPath | None
    certificate: Certificate | None
    fraction: float
    message: str
    deviation: float = math.nan
    rotation_deviation: float = math.nan
    joints: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the whole line is possible and proven free."""
        return self.status is LinearStatus.COMPLETE

    def or_raise(self) -> LinearPlanResult:
        """Return the move if it is complete.

        Raises
        ------
        PlanFailed
            With the message otherwise.
        """
        if not self.ok:
            raise PlanFailed(self.message, self)
        return self


@dataclass(frozen=True, eq=False)
class PosesPlanResult:
    """A move of the tcp through a sequence of poses.

    Parameters
    ----------
    status, certificate, message, deviation, rotation_deviation, joints
        As of a :class:`LinearPlanResult`.
    path
        The joint curve, its ``corners`` where the arm stops; None unless COMPLETE.
    fraction
        The share of the whole way, by its length, up to which the move is possible and proven free.
    reached
        The index of the last pose that is reached (or passed, where its corner is rounded); -1 for none.
    """

    status: LinearStatus
    path: BlendedPath | None
    certificate: Certificate | None
    fraction: float
    reached: int
    message: str
    deviation: float = math.nan
    rotation_deviation: float = math.nan
    joints: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the whole way is possible and proven free."""
        return self.status is LinearStatus.COMPLETE

    def or_raise(self) -> PosesPlanResult:
        """Return the move if it is complete.

        Raises
        ------
        PlanFailed
            With the message otherwise.
        """
        if not self.ok:
            raise PlanFailed(self.message, self)
        return self
