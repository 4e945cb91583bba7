"""The results of planners and of Cartesian moves: a certified curve or the reason of a failure."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from pinproof.collision import Certificate, CollisionChecker, Contact
from pinproof.common.results import Answer, Solution, View
from pinproof.errors import PlanFailed
from pinproof.motion import BlendedPath, CubicPath, JointPath


class LinearStatus(Enum):
    """The outcome of a linear move, or of a move through poses."""

    COMPLETE = "complete"
    UNREACHABLE = "a pose on the line cannot be reached on the current IK branch"
    LIMIT = "a joint is at its limit"
    JUMP = "the joints would have to jump"
    CONTACT = "two bodies are in contact"
    UNDECIDED = "the proof reached its tolerance without a decision"


class PlanStatus(Enum):
    """The outcome of a plan."""

    FOUND = "a certified path was found"
    START_INVALID = "the start is in contact, outside the joint limits or violates a constraint"
    GOAL_INVALID = "every goal is in contact, outside the joint limits or violates a constraint"
    IMPOSSIBLE = "no path exists: a joint cannot pass a value between the start and every goal"
    OUT_OF_BUDGET = "no path was found within the budget; one may exist"
    NOT_PROVEN = "the planner returned a path that is not proven free from the start to a goal"
    CANCELLED = "the progress callback requested to stop"


@dataclass(frozen=True)
class PlanProgress:
    """The progress of a search.

    Parameters
    ----------
    nodes
        Number of configurations in both trees.
    samples
        Number of random samples so far.
    seconds
        Time since the search began.
    gap
        Smallest distance (rad or m, Euclidean) measured between the trees; infinite before the first measurement.
    """

    nodes: int
    samples: int
    seconds: float
    gap: float


# A callback that is called many times a second during a search. If it returns False, the search ends as CANCELLED.
Progress = Callable[[PlanProgress], bool | None]


class PlanAnswer(Answer):
    """The part that all results of planning share."""

    failure = PlanFailed
    status: PlanStatus | LinearStatus

    @property
    def ok(self) -> bool:
        """Whether the result is a certified motion to a goal or along the complete path."""
        return self.status in (PlanStatus.FOUND, LinearStatus.COMPLETE)

    def _view(self) -> View:
        parts = [vars(self).get(name) for name in ("path", "certificate")]
        return View(f"{self.status.name}: {self.message}", parts, title=self.message)


@dataclass(frozen=True, eq=False)
class PlanResult(PlanAnswer):
    """The outcome of a plan. Where it has no path, reading one raises :class:`pinproof.errors.PlanFailed`.

    Parameters
    ----------
    status
        FOUND, or the reason of the failure.
    path
        The path from the start to the goal that was reached, if FOUND.
    certificate
        The FREE certificate of ``path``, if FOUND.
    goal
        The index of the goal that was reached, if FOUND.
    message
        The outcome and the remedy as text.
    nodes
        Number of configurations in both trees, or in the graph of the planner.
    cut
        Number of edges that were removed because they failed the proof, although their samples were free.
    samples
        Number of random samples.
    seconds
        Duration of the search.
    gap
        Smallest distance (rad or m, Euclidean) between the trees of the start and of the goals; 0 for a path, NaN
        if there was no search.
    contacts
        The contacts of the start or of the goals if they are the reason of the failure.
    checker
        The checker for which the certificate holds. It is the given checker, or, if an end was in contact only because
        of coarse bounding bodies, one with finer bodies for those pairs (:meth:`~pinproof.CollisionChecker.finer_at`).
        Use it for later steps: shortcuts, blends, the certificate of the trajectory.
    """

    status: PlanStatus
    path: Solution[JointPath] = Solution()
    certificate: Solution[Certificate] = Solution()
    goal: Solution[int] = Solution()
    message: str = ""
    nodes: int = 0
    cut: int = 0
    samples: int = 0
    seconds: float = 0.0
    gap: float = np.nan
    contacts: tuple[Contact, ...] = ()
    checker: Solution[CollisionChecker] = Solution()

    def _view(self) -> View:
        path = self.path if self.ok else None
        lines = (self._counts,) if path is None else (repr(path), self._counts)
        return View(f"{self.status.name}: {self.message}", [[self._counts], path], lines)

    @property
    def _counts(self) -> str:
        return f"{self.nodes:,} nodes, {self.samples:,} samples, {self.seconds:.3g} s"


@dataclass(frozen=True, eq=False, repr=False)
class LinearPlanResult(PlanAnswer):
    """A straight move of the tcp. Where it has no path, reading one raises :class:`pinproof.errors.PlanFailed`.

    Parameters
    ----------
    status
        COMPLETE, or the reason why the move stops.
    path
        The joint curve, if COMPLETE.
    certificate
        The FREE certificate if COMPLETE; the certificate that stopped the move if CONTACT or UNDECIDED.
    fraction
        The fraction of the line, 0 to 1, up to which the move is possible and proven free.
    message
        The outcome as text.
    deviation, rotation_deviation
        Upper bounds (m, rad) of the deviation of the tcp from the line, over all of ``path``; NaN without a path.
    joints
        The joints that are at their limits or would have to jump, if this stops the move.
    """

    status: LinearStatus
    path: Solution[CubicPath] = Solution()
    certificate: Solution[Certificate] = Solution()
    fraction: float = 0.0
    message: str = ""
    deviation: float = math.nan
    rotation_deviation: float = math.nan
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class PosesPlanResult(PlanAnswer):
    """A move of the tcp through a sequence of poses.

    Parameters
    ----------
    status, certificate, message, deviation, rotation_deviation, joints
        As for a :class:`LinearPlanResult`.
    path
        The joint curve, with ``corners`` at which the arm stops, if COMPLETE.
    fraction
        The fraction of the path length up to which the move is possible and proven free.
    reached
        The index of the last pose that is reached, or passed if its corner is rounded; -1 if no pose is reached.
    """

    status: LinearStatus
    path: Solution[BlendedPath] = Solution()
    certificate: Solution[Certificate] = Solution()
    fraction: float = 0.0
    reached: int = -1
    message: str = ""
    deviation: float = math.nan
    rotation_deviation: float = math.nan
    joints: tuple[str, ...] = ()
