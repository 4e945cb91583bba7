"""Any geometric planner of OMPL, steered by our checker and certified by our proof.

OMPL (I. Sucan, M. Moll, L. Kavraki (2012), "The Open Motion Planning Library", IEEE Robotics & Automation Magazine)
calls back for every edge it thinks of; it is told "free" only of edges that are proven, so that the path it returns can
be certified as a whole.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, certify, is_proven_free
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import JointPath
from pinproof.planning.edges import Edges
from pinproof.planning.ends import Ends, read_ends
from pinproof.planning.result import PlanResult, PlanStatus
from pinproof.planning.rrt_connect import PAD, sampling_box

__all__ = ["OmplPlanner", "ompl_planners"]

Array = npt.NDArray[np.float64]


def ompl_planners() -> tuple[str, ...]:
    """The names of all planners that the installed OMPL has.

    Raises
    ------
    InputError
        If OMPL is not installed.
    """
    ob, og, _ = _ompl()
    return tuple(
        sorted(name for name, kind in vars(og).items() if isinstance(kind, type) and issubclass(kind, ob.Planner))
    )


@dataclass(frozen=True)
class OmplPlanner:
    """A planner of OMPL (extra ``ompl``).

    Planners that seek the shortest path (``RRTstar``, ``PRMstar``, ``BITstar``, ...) take all of the time; the others
    end at the first path.

    Parameters
    ----------
    planner
        Its name, one of :func:`ompl_planners`.
    time_limit
        Seconds after which it ends.
    max_edges
        Edges it may ask about: a budget that does not depend on the clock.
    resolution
        Metres that bodies move between two samples of an edge that are looked at before it is proven.
    parameters
        The planner's own settings by OMPL's names, such as ``{"range": 0.5, "goalBias": 0.1}``.

    Raises
    ------
    InputError
        If OMPL is not installed, or a number is not above 0.
    UnknownNameError
        If it has no such planner, or the planner no such setting.
    """

    planner: str = "RRTConnect"
    time_limit: float = field(default=5.0, kw_only=True)
    max_edges: int = field(default=1_000_000, kw_only=True)
    resolution: float = field(default=0.08, kw_only=True)
    parameters: Mapping[str, Any] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("time_limit", "max_edges", "resolution"):
            if not getattr(self, name) > 0:
                raise InputError(f"OmplPlanner.{name} = {getattr(self, name)}; it must be above 0")
        planners = ompl_planners()
        if self.planner not in planners:
            raise UnknownNameError("planner", self.planner, planners, "the OMPL that is installed")
        kind = getattr(_ompl()[1], self.planner)
        settings = {name[3].lower() + name[4:] for name in dir(kind) if name.startswith("set")} - NOT_PARAMETERS
        for name in self.parameters:
            if name not in settings:
                raise UnknownNameError("parameter", name, settings, self.planner)
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def plan(
        self,
        checker: CollisionChecker,
        start: npt.ArrayLike,
        goals: npt.ArrayLike,
        *,
        turns: bool = False,
        rng: int | np.random.Generator = 0,
    ) -> PlanResult:
        """Plan from ``start`` (n,) to one goal (n,) or to any of several (g, n), as :meth:`RrtConnect.plan` does.

        The seed of OMPL's random numbers, of which it has one for the whole process, is set from ``rng``. With the same
        seed a planner that ends at its first path gives the same path, if neither budget ended it before. Planners that
        seek the shortest path until ``time_limit`` give what the clock let them; ``max_edges`` makes most of them
        repeatable. Those with threads of their own (``PRM``, ``PRMstar``) are not, strictly. Not to be used from
        several threads at a time.

        A joint without limits is given half a turn beyond the ends.

        Raises
        ------
        InputError
            If a shape is wrong or a number is not finite.
        """
        began = time.monotonic()
        ends = read_ends(checker, start, goals, turns=turns)
        if isinstance(ends, PlanResult):
            return ends
        seed = int(np.random.default_rng(rng).integers(1, 2**31))
        with _silent():
            left = max(self.time_limit - (time.monotonic() - began), 0.0)
            judge = _Judge(self, ends)
            q, nodes, off = _solve(self, ends, seed, left, judge)
        if judge.failure is not None:
            raise judge.failure
        seconds, asked = time.monotonic() - began, judge.asked

        def result(status: PlanStatus, message: str, **known: Any) -> PlanResult:
            given = {"path": None, "certificate": None, "goal": None, "gap": off, **known}
            return PlanResult(
                status, message=message, nodes=nodes, samples=asked, seconds=seconds, checker=ends.checker, **given
            )

        if q is None:
            near = f"it came within {off:.3g} (rad or m) of a goal. " if np.isfinite(off) else ""
            spent = (
                f"max_edges = {self.max_edges}" if asked >= self.max_edges else f"time_limit = {self.time_limit:g} s"
            )
            words = f"{self.planner} of OMPL found no path within {spent} ({nodes} nodes, {asked} edges); {near}"
            return result(PlanStatus.OUT_OF_BUDGET, f"{words}Give it more, another rng, or another planner")
        path = JointPath(q, checker.arm.joint_names)
        certificate = certify(path, ends.checker)
        if not certificate.free:  # pragma: no cover  # its edges were proven one by one
            words = f"the path that {self.planner} of OMPL found fails the proof: {certificate.message}"
            return result(PlanStatus.OUT_OF_BUDGET, words)
        row = int(np.abs(ends.goals - q[-1]).max(axis=1).argmin())
        words = (
            f"{self.planner} of OMPL: a path of {len(path)} waypoints and {path.length:.3g} rad, {certificate.message}"
        )
        return result(PlanStatus.FOUND, words, path=path, certificate=certificate, goal=ends.indices[row], gap=0.0)


NOT_PARAMETERS = {"name", "problemDefinition", "plannerInputStates"}
"""What a planner has setters for, too."""


class _Judge:
    """What OMPL asks while it plans.

    It holds none of OMPL's own objects, those that hold it would never be freed; only, while one plans, the condition
    ``until`` that ends it.
    """

    def __init__(self, settings: OmplPlanner, ends: Ends) -> None:
        both = np.vstack([ends.start, ends.goals])
        self._edges, self._checker = Edges(ends.checker, settings.resolution, both, pad=PAD), ends.checker
        self._most, self._dof = settings.max_edges, len(ends.start)
        self.until: Any = None
        self.asked = 0
        self.failure: BaseException | None = None

    def free(self, state: Any) -> bool:
        """Whether a configuration is free."""
        q = self.configuration(state)
        return self._guarded(lambda: self._checker.is_free_unchecked(q))

    def proven(self, state: Any, other: Any) -> bool:
        """Whether an edge is proven free."""
        if self.asked >= self._most:
            self.until.terminate()
            return False
        self.asked += 1
        a, b = self.configuration(state), self.configuration(other)
        return self._guarded(lambda: self._proven(a, b))

    def configuration(self, state: Any) -> Array:
        """A state of OMPL as q (n,)."""
        return np.array([state[joint] for joint in range(self._dof)])

    def _proven(self, a: Array, b: Array) -> bool:
        edge = JointPath([a, b], self._checker.arm.joint_names)
        return self._edges.looks_free(a, b) and is_proven_free(edge, self._checker)

    def _guarded(self, judge: Callable[[], bool]) -> bool:
        """``judge()``, but what it raises waits until OMPL has come to an end: there it could end the process."""
        if self.failure is not None:
            return False
        try:
            return judge()
        except BaseException as failure:  # noqa: BLE001  # raised again in plan, Ctrl-C among them
            # The frames of an exception keep their callers, and so OMPL's objects, which then complain at the exit.
            self.failure = failure if isinstance(failure, Exception) else failure.with_traceback(None)
            self.until.terminate()
            return False


def _solve(
    settings: OmplPlanner, ends: Ends, seed: int, seconds: float, judge: _Judge
) -> tuple[Array | None, int, float]:
    """A path (m, n) or None, the nodes, and how far from a goal the planner ended."""
    ob, og, ou = _ompl()
    ou.RNG.setSeed(seed)
    arm, both = ends.checker.arm, np.vstack([ends.start, ends.goals])
    space, bounds = ob.RealVectorStateSpace(arm.dof), ob.RealVectorBounds(arm.dof)
    for joint, (low, high) in enumerate(sampling_box(arm, both).T.tolist()):
        bounds.setLow(joint, low)
        bounds.setHigh(joint, high)
    space.setBounds(bounds)

    def state_at(q: Array) -> Any:
        state = space.allocState()
        for joint, value in enumerate(q.tolist()):
            state[joint] = value
        return state

    judge.until = ob.timedPlannerTerminationCondition(seconds)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(judge.free)
    information.setMotionValidator(_validator(judge, information))
    information.setup()
    problem, goal = ob.ProblemDefinition(information), ob.GoalStates(information)
    problem.addStartState(state_at(ends.start))
    for q in ends.goals:
        goal.addState(state_at(q))
    problem.setGoal(goal)
    planner = getattr(og, settings.planner)(information)
    for name, value in settings.parameters.items():
        getattr(planner, f"set{name[0].upper()}{name[1:]}")(value)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(judge.until)
    judge.until = None
    data = ob.PlannerData(information)
    planner.getPlannerData(data)
    path, off = None, np.nan
    if problem.hasExactSolution():
        path = np.array([judge.configuration(state) for state in problem.getSolutionPath().getStates()])
    elif problem.hasApproximateSolution():
        off = float(problem.getSolutionDifference())
    return path, int(data.numVertices()), off


def _ompl() -> tuple[Any, Any, Any]:
    try:
        from ompl import base, geometric, util
    except ImportError as error:
        raise InputError("planners of OMPL need the extra 'ompl': pip install 'pinproof[ompl]'") from error
    return base, geometric, util


def _validator(judge: _Judge, information: Any) -> Any:
    """OMPL's view of the judge of edges; its class can only be made where OMPL is."""
    ob, _, _ = _ompl()

    class Validator(ob.MotionValidator):  # type: ignore[misc,name-defined]  # ompl is untyped
        def checkMotion(self, state: Any, other: Any, *_: Any) -> bool:
            return judge.proven(state, other)  # a third argument is for the last free state on the way

    return Validator(information)


@contextmanager
def _silent() -> Iterator[None]:
    """OMPL writes to the console of its own; here nothing does."""
    _, _, ou = _ompl()
    before = ou.getLogLevel()
    ou.setLogLevel(ou.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(before)
