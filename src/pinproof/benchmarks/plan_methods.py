"""What a method in the planning benchmark is, and the method of this package."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter_ns

from pinproof.benchmarks.plan_problems import PlanProblem
from pinproof.collision import CollisionChecker, certify
from pinproof.errors import TimingError
from pinproof.motion import Curve, time_parametrise
from pinproof.planning import DEFAULT_PLANNER, RrtConnect, make_planner, simplify

STEPS = ("plan", "simplify", "time", "certify")
"""The timed steps, in their order."""

TIME_LIMIT = RrtConnect().time_limit
"""Time limit of every planner in s: the default of ours."""

OURS = "pinproof"
"""Key of our method with the default planner."""

NANOSECONDS_PER_MS = 1e6


@dataclass(frozen=True, eq=False)
class PlanAnswer:
    """The answer of a method to a problem; None for what it does not have.

    ``ms`` maps each of :data:`STEPS` that was carried out to its time. ``certified`` states whether the motion has a
    FREE certificate with this ``clearance`` (m), ``rejected_edges`` counts edges that were free at their samples but
    failed the proof, and ``message`` states why there is no motion, or no certificate. The ``duration`` is in s.
    """

    curve: Curve | None
    ms: dict[str, float] = field(default_factory=dict)
    certified: bool | None = None
    clearance: float | None = None
    duration: float | None = None
    rejected_edges: int | None = None
    message: str = ""


Solve = Callable[[int], PlanAnswer]
"""Solves the problem that it was prepared for with a seed."""


@dataclass(frozen=True, eq=False)
class PlanMethod:
    """A method of the table: its identifier, its name in the table, and the distribution that installs it (None: ours).

    ``prepare`` takes a problem and the checker with convex hulls; its time does not count. It raises ImportError if the
    method is not installed, and NotApplicableError if it cannot solve such problems.
    """

    key: str
    label: str
    prepare: Callable[[PlanProblem, CollisionChecker], Solve]
    distribution: str | None = None


class Stopwatch:
    """Measures consecutive steps in milliseconds, by default of wall time."""

    def __init__(self, clock: Callable[[], int] = perf_counter_ns) -> None:
        self.ms: dict[str, float] = {}
        self._clock, self._last = clock, clock()

    def lap(self, step: str) -> None:
        """Record the time since the last lap under the name of a step."""
        now = self._clock()
        self.ms[step] = (now - self._last) / NANOSECONDS_PER_MS
        self._last = self._clock()


def _prepare(planner_name: str, problem: PlanProblem, checker: CollisionChecker) -> Solve:
    planner = make_planner(planner_name, time_limit=TIME_LIMIT)

    def solve(seed: int) -> PlanAnswer:
        watch = Stopwatch()
        plan = planner.plan(checker, problem.start, problem.goals, rng=seed)
        watch.lap("plan")
        answer = partial(PlanAnswer, ms=watch.ms, rejected_edges=plan.cut)
        if plan.path is None:
            return answer(None, certified=False, message=plan.message)
        used = plan.checker or checker  # with finer link shapes if start or goal collides by its hulls only
        simple = simplify(plan.path, used, rng=seed, certificate=plan.certificate)
        watch.lap("simplify")
        try:
            trajectory = time_parametrise(simple.path, problem.group.limits)
        except TimingError as error:
            return answer(None, certified=False, message=str(error))
        watch.lap("time")
        certificate = certify(trajectory, used)
        watch.lap("certify")
        if not certificate.free:
            return answer(trajectory, certified=False, duration=trajectory.duration, message=certificate.message)
        return answer(trajectory, certified=True, clearance=certificate.clearance, duration=trajectory.duration)

    return solve


def own_method(planner: str) -> PlanMethod:
    """Return the method of this package with a planner: plan, simplify, time, and certify what would be saved.

    Raises
    ------
    UnknownNameError
        If ``planner`` is not a key of :data:`pinproof.planning.PLANNERS`.
    InputError
        If the library of the planner is not installed.
    """
    make_planner(planner)
    names = (OURS, OURS) if planner == DEFAULT_PLANNER else (f"{OURS}_{planner}", f"{OURS}, {planner}")
    return PlanMethod(*names, partial(_prepare, planner))
