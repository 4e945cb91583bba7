"""An own planner as an example: the geometric planners of OMPL, called by name; the paths are certified.

``pinproof plan --planner benchmarks.ompl_adapter:OmplPlanner`` uses it if scripts/ is on PYTHONPATH.

OMPL (I. Sucan, M. Moll, L. Kavraki (2012), "The Open Motion Planning Library", IEEE Robotics & Automation Magazine)
calls the adapter for every edge. An edge is reported as valid only if it is proven free, so that the complete path,
which :func:`pinproof.plan` certifies, passes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from pinproof.collision import CollisionChecker
from pinproof.common.validation import require_positive
from pinproof.errors import InputError, UnknownNameError
from pinproof.motion import JointPath, TorqueLimits
from pinproof.planning import Edges, PlanResult, PlanStatus, sampling_box
from pinproof.planning.rrt_connect import SEARCH_PAD
from pinproof.spatial import Array

UNLIMITED = 86_400.0
"""Time limit (s) of a planner that is limited by its edges; OMPL does not accept infinity."""

NOT_PARAMETERS = {"name", "problemDefinition", "plannerInputStates"}
"""Setters of a planner that do not belong to its parameters."""


def ompl_planners() -> tuple[str, ...]:
    """The names of all planners of the installed OMPL.

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
    """A planner of OMPL.

    Optimising planners (``RRTstar``, ``PRMstar``, ``BITstar``, ...) use the complete time limit; the others end with
    the first path.

    Parameters
    ----------
    planner
        The name of the planner, one of :func:`ompl_planners`.
    time_limit
        Time (s) after which the planner ends.
    max_edges
        Maximum number of edges that are checked. This budget does not depend on the clock.
    resolution
        Distance (m) by which bodies move between two samples of an edge that are checked before its proof.
    parameters
        Parameters of the planner by their names in OMPL, such as ``{"range": 0.5, "goalBias": 0.1}``.

    Raises
    ------
    InputError
        If OMPL is not installed, or a number is not above 0.
    UnknownNameError
        If OMPL does not have the planner, or the planner does not have a parameter.
    """

    planner: str = "RRTConnect"
    time_limit: float = field(default=5.0, kw_only=True)
    max_edges: int = field(default=1_000_000, kw_only=True)
    resolution: float = field(default=0.08, kw_only=True)
    parameters: Mapping[str, Any] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        for name in ("time_limit", "max_edges", "resolution"):
            require_positive(f"OmplPlanner.{name}", getattr(self, name))
        planners = ompl_planners()
        if self.planner not in planners:
            raise UnknownNameError("planner", self.planner, planners, "the OMPL that is installed")
        kind = getattr(_ompl()[1], self.planner)
        settings = {name[3].lower() + name[4:] for name in dir(kind) if name.startswith("set")} - NOT_PARAMETERS
        for name in self.parameters:
            if name not in settings:
                raise UnknownNameError("parameter", name, settings, self.planner)
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def limited_to(self, nodes: int) -> OmplPlanner:
        """Return the planner with a budget of work instead of time: four edges for each node."""
        return replace(self, max_edges=4 * nodes, time_limit=UNLIMITED)

    def plan(
        self,
        checker: CollisionChecker,
        start: Array,
        goals: Array,
        *,
        torque_limits: TorqueLimits | None = None,
        rng: int = 0,
    ) -> PlanResult:
        """Plan from ``start`` (n,) to any of ``goals`` (g, n).

        OMPL has one random seed per process; it is set from ``rng``. With the same seed, a planner that ends with its
        first path gives the same path, unless a budget ends it before. The path of an optimising planner depends on the
        speed of the computer; with ``max_edges``, most of these planners are repeatable. Multithreaded planners
        (``PRM``, ``PRMstar``) are not strictly repeatable. Do not call this method from several threads at a time.

        An unbounded joint has the range of its values at the start and the goals, extended by pi on both sides.
        """
        ends = np.vstack([start, goals])
        validity = _Validity(self, checker, ends, torque_limits)
        with _silent():
            q, nodes, gap = _solve(self, checker, ends, int(np.random.default_rng(rng).integers(1, 2**31)), validity)
        if validity.failure is not None:
            raise validity.failure
        if q is not None:
            path = JointPath(q, checker.group.joint_names)
            message = f"{self.planner} of OMPL found a path with {len(path)} waypoints and length {path.length:.3g}"
            return PlanResult(PlanStatus.FOUND, path, message=message, nodes=nodes, samples=validity.edges)
        near = f"it came within {gap:.3g} (rad or m) of a goal. " if np.isfinite(gap) else ""
        budget, value = ("max_edges", f"{self.max_edges}")
        if validity.edges < self.max_edges:
            budget, value = "time_limit", f"{self.time_limit:g} s"
        work = f"{nodes} nodes, {validity.edges} edges"
        message = (
            f"{self.planner} of OMPL found no path within {budget} = {value} ({work}); {near}Try a larger {budget}, "
            "another rng or another planner"
        )
        return PlanResult(PlanStatus.OUT_OF_BUDGET, message=message, nodes=nodes, samples=validity.edges, gap=gap)


class _Validity:
    """The validity checks that OMPL calls.

    An instance does not refer to objects of OMPL, because such reference cycles would never be freed. The only
    exception is the termination condition ``until`` while a planner runs.
    """

    def __init__(
        self, settings: OmplPlanner, checker: CollisionChecker, ends: Array, torque_limits: TorqueLimits | None
    ) -> None:
        self._checker = checker
        self._edges = Edges(checker, settings.resolution, ends, pad=SEARCH_PAD, torque_limits=torque_limits)
        self._max_edges, self._dof = settings.max_edges, ends.shape[1]
        self.until: Any = None
        self.edges = 0
        self.failure: BaseException | None = None

    def free(self, state: Any) -> bool:
        """Whether a configuration is free."""
        q = self.configuration(state)
        return self._guarded(lambda: self._checker.is_free_unchecked(q))

    def proven(self, state: Any, other: Any) -> bool:
        """Whether an edge is proven free."""
        if self.edges >= self._max_edges:
            self.until.terminate()
            return False
        self.edges += 1
        a, b = self.configuration(state), self.configuration(other)
        return self._guarded(lambda: self._edges.proven_free(a, b))

    def configuration(self, state: Any) -> Array:
        """A state of OMPL as q (n,)."""
        return np.array([state[joint] for joint in range(self._dof)])

    def _guarded(self, check: Callable[[], bool]) -> bool:
        """Call ``check``. An exception is stored until OMPL has returned, because OMPL could abort the process."""
        if self.failure is not None:
            return False
        try:
            return check()
        except BaseException as failure:  # noqa: BLE001  # raised again in plan, including KeyboardInterrupt
            # The frames of an exception refer to their callers, and thereby to OMPL's objects, which warn at the exit.
            self.failure = failure if isinstance(failure, Exception) else failure.with_traceback(None)
            self.until.terminate()
            return False


def _solve(
    settings: OmplPlanner, checker: CollisionChecker, ends: Array, seed: int, validity: _Validity
) -> tuple[Array | None, int, float]:
    """A path from the first of the ends (1 + g, n) to another or None, the nodes, and the gap that is left or NaN."""
    ob, og, ou = _ompl()
    ou.RNG.setSeed(seed)
    arm = checker.group
    space, bounds = ob.RealVectorStateSpace(arm.dof), ob.RealVectorBounds(arm.dof)
    for joint, (low, high) in enumerate(sampling_box(arm, ends).T.tolist()):
        bounds.setLow(joint, low)
        bounds.setHigh(joint, high)
    space.setBounds(bounds)

    def state_at(q: Array) -> Any:
        state = space.allocState()
        for joint, value in enumerate(q.tolist()):
            state[joint] = value
        return state

    validity.until = ob.timedPlannerTerminationCondition(settings.time_limit)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(validity.free)
    information.setMotionValidator(_validator(validity, information))
    information.setup()
    problem, goal = ob.ProblemDefinition(information), ob.GoalStates(information)
    problem.addStartState(state_at(ends[0]))
    for q in ends[1:]:
        goal.addState(state_at(q))
    problem.setGoal(goal)
    planner = getattr(og, settings.planner)(information)
    for name, value in settings.parameters.items():
        getattr(planner, f"set{name[0].upper()}{name[1:]}")(value)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(validity.until)
    validity.until = None
    data = ob.PlannerData(information)
    planner.getPlannerData(data)
    path, gap = None, np.nan
    if problem.hasExactSolution():
        path = np.array([validity.configuration(state) for state in problem.getSolutionPath().getStates()])
    elif problem.hasApproximateSolution():
        gap = float(problem.getSolutionDifference())
    return path, int(data.numVertices()), gap


def _ompl() -> tuple[Any, Any, Any]:
    try:
        from ompl import base, geometric, util
    except ImportError as error:
        raise InputError("the planners of OMPL need its package: pip install ompl") from error
    return base, geometric, util


def _validator(validity: _Validity, information: Any) -> Any:
    """The edge checks as an object of OMPL. The class is local because its base requires OMPL."""
    ob, _, _ = _ompl()

    class Validator(ob.MotionValidator):  # type: ignore[misc,name-defined]  # ompl is untyped
        def checkMotion(self, state: Any, other: Any, *_: Any) -> bool:
            return validity.proven(state, other)  # an optional third argument receives the last valid state

    return Validator(information)


@contextmanager
def _silent() -> Iterator[None]:
    """Disable OMPL's messages on the console."""
    _, _, ou = _ompl()
    before = ou.getLogLevel()
    ou.setLogLevel(ou.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(before)
