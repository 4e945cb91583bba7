"""The results of planners and of Cartesian moves: a certified curve or the reason of a failure."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinproof.collision import Certificate, CollisionChecker, Contact, certify
from pinproof.common.results import Answer, Solution, View
from pinproof.common.structs import described, key
from pinproof.errors import PlanFailed
from pinproof.motion import CubicPath, JointPath, Trajectory
from pinproof.spatial import Array

if TYPE_CHECKING:
    from pinproof.viewer import LiveView, PlotLimits


class LinearStatus(Enum):
    """The outcome of a linear move."""

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
    GOAL_UNREACHABLE = "no configuration within the joint limits was found at any of the goal poses"
    IMPOSSIBLE = "no path exists: a joint cannot pass a value between the start and every goal"
    OUT_OF_BUDGET = "no path was found within the budget; one may exist"
    NOT_PROVEN = "the path or the motion that was found is not proven free from the start to a goal"
    NOT_TIMED = "the path that was found cannot be timed within the limits"
    CANCELLED = "the progress callback requested to stop"


@described()
class PlanProgress:
    """The progress of a search."""

    nodes: int = key("number of configurations in both trees")
    samples: int = key("number of random samples so far")
    seconds: float = key("time since the search began")
    gap: float = key(
        "smallest distance (rad or m, Euclidean) measured between the trees; infinite before the first measurement"
    )


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


class PlannedMotion(Answer):
    """A motion with its certificate, which is saved and shown, or the reason why there is none."""

    failure = PlanFailed

    if TYPE_CHECKING:  # stated by the subclasses as fields or properties

        @property
        def checker(self) -> CollisionChecker:
            """The checker of the certificate."""

        @property
        def trajectory(self) -> Trajectory:
            """The motion; without one, reading it raises :class:`pinproof.errors.PlanFailed`."""

        @property
        def certificate(self) -> Certificate:
            """The certificate of the motion; without one, reading it raises :class:`pinproof.errors.PlanFailed`."""

    @property
    def duration(self) -> float:
        """Seconds from start to end; without a motion, reading it raises :class:`pinproof.errors.PlanFailed`."""
        return self.trajectory.duration

    def save(self, path: str | Path) -> Path:
        """Write the motion as :meth:`Trajectory.save` does, and beside it its proof, for others to verify.

        The proof of ``motion.json`` is ``motion.proof.json``: ``python -m pinproof.verifier motion.proof.json`` checks
        it with NumPy only, and :func:`pinproof.verify_proof` compares it with the arm, the scene and the motion.

        Returns
        -------
        Path
            The file of the proof.

        Raises
        ------
        PlanFailed
            Without a motion that is proven FREE.
        TrajectoryError, FileError
            If a file cannot be written.
        """
        self.or_raise()
        constraints = [proof.constraint for proof in self.certificate.constraints]
        recorded = certify(self.trajectory, self.checker, constraints=constraints, record=True)
        self.trajectory.save(path, certificate=self.certificate)
        proof = Path(path).with_suffix(".proof.json")
        recorded.save(proof)
        return proof

    def show(self, *, open_browser: bool = False) -> LiveView:
        """Show the motion live in the browser; without a motion, the configuration that is the reason."""
        from pinproof.viewer import show

        motion, content = self._pictured()
        checker = self.checker
        return show(checker.group, checker.scene, motion, open_browser=open_browser, **content)

    def to_html(self, path: str | Path) -> None:
        """Write a page with the motion and its certificate; without a motion, the configuration that is the reason."""
        from pinproof.viewer import write_html

        motion, content = self._pictured()
        checker = self.checker
        write_html(path, checker.group, checker.scene, motion, plot=self._plot_limits(), checker=checker, **content)

    def _pictured(self) -> tuple[Trajectory | None, dict[str, Any]]:
        """The motion, and the further content of its picture as for :func:`pinproof.write_html`."""
        raise NotImplementedError

    def _plot_limits(self) -> PlotLimits | None:
        """The limits in the plots of the page; None for those of the arm."""
        return None


@dataclass(frozen=True)
class OutsideLimits:
    """A joint whose ``value`` (rad or m) is not between its ``lower`` and ``upper`` limit."""

    joint: str
    value: float
    lower: float
    upper: float


@described(eq=False)
class InvalidEnd:
    """Why the start or a goal is not valid."""

    q: Array = key("(n,) the configuration")
    goal: int | None = key("the index of the goal; None for the start")
    limits: tuple[OutsideLimits, ...] = key("the joints outside their limits")
    contacts: tuple[Contact, ...] = key("the bodies in contact, the deepest first")
    message: str = key(
        "all reasons as text: also constraints of the tcp that are violated, and torques that exceed their limits"
    )


@dataclass(frozen=True, eq=False)
class Barrier:
    """A value (rad or m) that a joint cannot pass, and the contact of bodies that only this joint moves."""

    joint: str
    value: float
    contact: Contact

    def __str__(self) -> str:
        return f"{self.joint} cannot pass {self.value:.4g}, where {self.contact} at all values of the other joints"


@described(eq=False)
class PlanResult(PlanAnswer):
    """The outcome of a plan. Where it has no path, reading one raises :class:`pinproof.errors.PlanFailed`."""

    not_pickled = ("checker",)

    status: PlanStatus = key("FOUND, or the reason of the failure")
    path: Solution[JointPath] = key(
        "the path from the start to the goal that was reached, if FOUND", default=Solution()
    )
    certificate: Solution[Certificate] = key("the FREE certificate of ``path``, if FOUND", default=Solution())
    goal: Solution[int] = key("the index of the goal that was reached, if FOUND", default=Solution())
    message: str = key("the outcome and the remedy as text", default="")
    nodes: int = key("number of configurations in both trees, or in the graph of the planner", default=0)
    cut: int = key(
        "number of edges that were removed because they failed the proof, although their samples were free", default=0
    )
    samples: int = key("number of random samples", default=0)
    seconds: float = key("duration of the search", default=0.0)
    gap: float = key(
        "smallest distance (rad or m, Euclidean) between the trees of the start and of the goals; 0 for a path, NaN "
        "if there was no search",
        default=np.nan,
    )
    contacts: tuple[Contact, ...] = key(
        "the contacts that are the reason of the failure: of the start, of the goals, at barriers, or on the path",
        default=(),
    )
    invalid: tuple[InvalidEnd, ...] = key("why the start or each goal is not valid, if this is the reason", default=())
    barriers: tuple[Barrier, ...] = key(
        "the values that joints cannot pass, if it is proven that no path exists", default=()
    )
    checker: Solution[CollisionChecker] = key(
        "the checker for which the certificate holds. It is the given checker, or, if an end was in contact only "
        "because of coarse bounding bodies, one with finer bodies for those pairs "
        "(:meth:`~pinproof.CollisionChecker.finer_at`). Use it for later steps: shortcuts, blends, the certificate of"
        " the trajectory",
        default=Solution(),
    )

    def _view(self) -> View:
        path = self.path if self.ok else None
        lines = (self._counts,) if path is None else (repr(path), self._counts)
        return View(f"{self.status.name}: {self.message}", [[self._counts], path], lines)

    @property
    def _counts(self) -> str:
        return f"{self.nodes:,} nodes, {self.samples:,} samples, {self.seconds:.3g} s"


@described(eq=False, repr=False)
class LinearPlanResult(PlanAnswer):
    """A straight move of the tcp. Where it has no path, reading one raises :class:`pinproof.errors.PlanFailed`."""

    status: LinearStatus = key("COMPLETE, or the reason why the move stops")
    path: Solution[CubicPath] = key("the joint curve, if COMPLETE", default=Solution())
    certificate: Solution[Certificate] = key(
        "the FREE certificate if COMPLETE; the certificate that stopped the move if CONTACT or UNDECIDED",
        default=Solution(),
    )
    fraction: float = key(
        "the fraction of the line, 0 to 1, up to which the move is possible and proven free", default=0.0
    )
    message: str = key("the outcome as text", default="")
    deviation: float = key(
        "upper bounds (m, rad) of the deviation of the tcp from the line, over all of ``path``; NaN without a path",
        default=math.nan,
    )
    rotation_deviation: float = key(
        "upper bounds (m, rad) of the deviation of the tcp from the line, over all of ``path``; NaN without a path",
        default=math.nan,
    )
    joints: tuple[str, ...] = key(
        "the joints that are at their limits or would have to jump, if this stops the move", default=()
    )
