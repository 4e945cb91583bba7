"""What the table runs: a method is prepared for a problem, which is not timed, and then asked, step by step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter_ns

from pinproof.benchmarks.plan_problem import PlanProblem
from pinproof.collision import CollisionChecker, certify
from pinproof.errors import TimingError
from pinproof.motion import Curve, time_parametrise
from pinproof.planning import RrtConnect, simplify

__all__ = ["OURS", "PLANNER", "STEPS", "Answer", "PlanMethod", "Stopwatch"]

STEPS = ("plan", "simplify", "time", "certify")
"""What is timed, in the order in which it is done."""

PLANNER = RrtConnect()
"""Our planner with the settings it comes with. Others get its time limit."""

MILLION = 1e6
"""Nanoseconds in a millisecond."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method says to a problem.

    Parameters
    ----------
    curve
        The motion; None where it found none.
    ms
        Milliseconds of each step taken, by the names of :data:`STEPS`.
    certified
        Whether a proof that the curve is free comes with it; None of a method that offers none.
    clearance
        Metres that are proven to stay between any two bodies; None without a proof.
    duration
        Seconds that the motion takes; None of a path without timing.
    cut
        Edges that looked free at their samples and failed the proof.
    message
        Why there is no curve, or no proof.
    """

    curve: Curve | None
    ms: dict[str, float] = field(default_factory=dict)
    certified: bool | None = None
    clearance: float | None = None
    duration: float | None = None
    cut: int | None = None
    message: str = ""


Ask = Callable[[int], Answer]
"""Answers the problem it was prepared for, from a seed."""


@dataclass(frozen=True, eq=False)
class PlanMethod:
    """A method.

    Parameters
    ----------
    key, label
        Its short name, and how the tables call it.
    prepare
        Takes a problem and the checker with links as hulls; raises ImportError where the method is not installed and
        :class:`~pinproof.benchmarks.ik_methods.Unsuitable` where it cannot be asked this.
    distribution
        The distribution that brings it; None for ours.
    """

    key: str
    label: str
    prepare: Callable[[PlanProblem, CollisionChecker], Ask]
    distribution: str | None = None


class Stopwatch:
    """Milliseconds of one step after another."""

    def __init__(self) -> None:
        self.ms: dict[str, float] = {}
        self._last = perf_counter_ns()

    def lap(self, step: str) -> None:
        """What was done since the last lap was this step."""
        now = perf_counter_ns()
        self.ms[step] = (now - self._last) / MILLION
        self._last = perf_counter_ns()


def _ours(problem: PlanProblem, checker: CollisionChecker) -> Ask:
    def ask(seed: int) -> Answer:
        watch = Stopwatch()
        plan = PLANNER.plan(checker, problem.start, problem.goals, rng=seed)
        watch.lap("plan")
        if plan.path is None:
            return Answer(None, watch.ms, certified=False, cut=plan.cut, message=plan.message)
        judge = plan.checker or checker  # finer than ours where an end touches by its hulls alone
        simple = simplify(plan.path, judge, rng=seed, certificate=plan.certificate)
        watch.lap("simplify")
        try:
            trajectory = time_parametrise(simple.path, problem.arm.limits)
        except TimingError as error:
            return Answer(None, watch.ms, certified=False, cut=plan.cut, message=str(error))
        watch.lap("time")
        certificate = certify(trajectory, judge)
        watch.lap("certify")
        return Answer(
            trajectory,
            watch.ms,
            certified=certificate.free,
            clearance=certificate.clearance if certificate.free else None,
            duration=trajectory.duration,
            cut=plan.cut,
            message="" if certificate.free else certificate.message,
        )

    return ask


OURS = PlanMethod("pinproof", "pinproof", _ours)
"""Plan, shorten and round, time, and prove the trajectory that would be saved."""
