"""RRT-Connect between a start and a set of goals, whose answer is always certified.

Two trees grow towards each other; samples steer the search. When they meet, the whole way is proven; an edge that fails
is cut out of its tree with all that hangs on it, and the search goes on.

Source: J. Kuffner, S. LaValle (2000), "RRT-Connect: an efficient approach to single-query path planning", ICRA.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.planning.apart import how_far_apart
from pinproof.planning.edges import Edges
from pinproof.planning.goals import read_goals, with_turns
from pinproof.planning.result import PlanResult, PlanStatus
from pinproof.planning.trees import Trees

__all__ = ["RrtConnect"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RrtConnect:
    """The planner.

    Parameters
    ----------
    step
        Longest edge (Euclidean, in rad or m).
    resolution
        Metres that bodies move between two samples that steer the search; the proof does not depend on it.
    max_nodes
        Configurations in both trees after which the search ends.
    max_samples
        Random samples after which the search ends: trees that are walled in gain no nodes.
    time_limit
        Seconds after which the search ends. Answers that were found before do not depend on it.

    Raises
    ------
    InputError
        If a setting is not above 0.
    """

    step: float = 1.0
    resolution: float = 0.05
    max_nodes: int = 20_000
    max_samples: int = 50_000
    time_limit: float = 20.0

    def __post_init__(self) -> None:
        for name in ("step", "resolution", "max_nodes", "max_samples", "time_limit"):
            if not getattr(self, name) > 0:
                raise InputError(f"RrtConnect.{name} = {getattr(self, name)}; it must be above 0")

    def plan(
        self,
        checker: CollisionChecker,
        start: npt.ArrayLike,
        goals: npt.ArrayLike,
        *,
        turns: bool = False,
        rng: int | np.random.Generator = 0,
    ) -> PlanResult:
        """Plan from ``start`` (n,) to one goal (n,) or to any of several (g, n).

        The same ``rng`` gives the same path. A failure is a result: it says what touches, or which budget ran out.

        Parameters
        ----------
        checker
            What the path must be free of.
        start, goals
            The ends, inside the arm's limits.
        turns
            Take a goal also where joints stand whole turns away from it, inside the limits: the same pose of every
            link, and often the only one that can be reached. The path then ends there; ``goal`` is the index it equals.
        rng
            Seed or Generator of the samples.

        Raises
        ------
        InputError
            If a shape is wrong or a number is not finite.
        """
        first = checker.arm.configuration(start, "start")
        given = read_goals(checker.arm, goals)
        many, index_of = with_turns(checker.arm, first, given) if turns else (given, list(range(len(given))))
        if trouble := _trouble(checker, first):
            return PlanResult(PlanStatus.START_INVALID, None, None, None, f"the start cannot be left: {trouble}")
        troubles = [_trouble(checker, goal) for goal in many]
        valid = [row for row, trouble in enumerate(troubles) if not trouble]
        if not valid:
            listed = "; ".join(f"goal {i}: {t}" for i, t in list(enumerate(troubles[: len(given)]))[:5])
            return PlanResult(PlanStatus.GOAL_INVALID, None, None, None, f"no goal can be entered: {listed}")
        indices = [index_of[row] for row in valid]
        return _Search(self, checker, first, many[valid], indices, turns, np.random.default_rng(rng)).run()


def _trouble(checker: CollisionChecker, q: Array) -> str:
    """Why q (n,) cannot be an end of a path; empty when it can."""
    outside = checker.arm.limits.violations(q, checker.arm.joint_names)
    if outside:
        return "; ".join(outside)
    if checker.is_free_unchecked(q):
        return ""
    return str(checker.check(q))


class _Search:
    """The state of one search; ``indices`` says which goal of the caller's each row of ``goals`` (k, n) is."""

    def __init__(
        self,
        settings: RrtConnect,
        checker: CollisionChecker,
        start: Array,
        goals: Array,
        indices: list[int],
        turns: bool,
        rng: np.random.Generator,
    ) -> None:
        from pinproof.kernels import rrt

        self._kernel = rrt
        self._settings, self._checker, self._rng = settings, checker, rng
        self._edges = Edges(checker, settings.resolution, np.vstack([start, goals]))
        self._start, self._goals, self._indices, self._turns = start, goals, indices, turns
        self._state = np.zeros(rrt.STATE_SIZE, dtype=np.int64)
        self._state[[rrt.TOLD, rrt.MOST_NODES, rrt.MOST_SAMPLES]] = rrt.ASK, settings.max_nodes, settings.max_samples
        self._trees = Trees(start, goals, self._state[rrt.SIZE : rrt.SIZE + 2])
        self._boxes = np.array(
            [
                *(_sampling_box(checker.arm, np.array([start, goal]), np.pi) for goal in goals),
                _sampling_box(checker.arm, np.vstack([start, goals]), np.inf),
            ]
        )
        self._draws, self._ends = np.empty((0, len(start) + 2)), np.empty((2, len(start)))
        self._cut, self._last_cut = 0, ""

    def run(self) -> PlanResult:
        deadline = time.monotonic() + self._settings.time_limit
        if (result := self._straight()) is not None:
            return result
        k, state = self._kernel, self._state
        budget = ""
        while not budget:
            ended = self._grow()
            if ended == k.MET:
                if (result := self._join(int(state[k.AT_START]), int(state[k.AT_GOAL]))) is not None:
                    return result
            elif ended == k.SPENT:
                nodes = len(self._trees) >= self._settings.max_nodes
                budget = self._named("max_nodes" if nodes else "max_samples")
            if time.monotonic() >= deadline:
                budget = budget or f"time_limit = {self._settings.time_limit:g} s"
        failed = f", {self._cut} edges failed the proof, the last because {self._last_cut}" if self._cut else ""
        apart = how_far_apart(self._checker.arm, self._trees.living(0), self._trees.living(1), turns=self._turns)
        message = (
            f"no path within {budget} ({len(self._trees)} nodes, {state[k.SAMPLES]} samples{failed}); {apart}. "
            "Give it more, another rng, or other goals"
        )
        return PlanResult(PlanStatus.OUT_OF_BUDGET, None, None, None, message, len(self._trees), self._cut)

    def _named(self, budget: str) -> str:
        return f"{budget} = {getattr(self._settings, budget)}"

    def _grow(self) -> int:
        """Let the trees grow until something is to be done about it here."""
        k, state, trees, edges, steering = self._kernel, self._state, self._trees, self._edges, self._edges.steering
        state[k.UNTIL] = edges.looks + LOOKS_AT_ONCE
        while True:
            settings = np.array([self._settings.step, edges.resolution, NEAR_SHARE])
            ended: int = k.grow(
                steering.numbers, steering.indices, steering.workspace.at, settings, self._boxes, self._draws,
                trees.q, trees.parents, state, self._ends, edges.asked, edges.counts,
            )  # fmt: skip
            if ended == k.COAL:
                state[k.TOLD] = k.FREE if edges.judged_free() else k.BLOCKED
            elif ended == k.DRAWS:
                self._draws, state[k.DRAWN] = self._rng.random((DRAWS, self._draws.shape[1])), 0
            elif ended == k.NODES:
                trees.make_room()
            else:
                return ended

    def _straight(self) -> PlanResult | None:
        """The straight way to a goal, the nearest first."""
        steps = np.abs(self._goals - self._start).max(axis=1)
        for row in np.argsort(steps, kind="stable").tolist():
            goal = self._goals[row]
            way = np.array([self._start, goal] if steps[row] > 0 else [goal])
            if self._edges.looks_free(self._start, goal) and (result := self._prove(way, row)[0]) is not None:
                return result
        return None

    def _join(self, at_start: int, at_goal: int) -> PlanResult | None:
        """The certified path through two nodes that coincide, or None after cutting the edge that failed."""
        trees = self._trees
        forth, back = trees.branch(0, at_start)[::-1], trees.branch(1, at_goal)
        way = np.concatenate([trees.q[0, forth], trees.q[1, back[1:]]])
        result, failed = self._prove(way, back[-1])
        if result is None:
            # edge i leads from waypoint i to i + 1; a tree hangs an edge on its end that is farther from the root
            if failed < len(forth) - 1:
                trees.cut(0, forth[failed + 1])
            else:
                trees.cut(1, back[failed - (len(forth) - 1)])
        return result

    def _prove(self, way: Array, row: int) -> tuple[PlanResult | None, int]:
        """The path to a goal, certified; or None and the index of the edge that is not free."""
        path = JointPath(way, self._checker.arm.joint_names)
        certificate = certify(path, self._checker)
        if certificate.free:
            message = f"a path of {len(path)} waypoints and {path.length:.3g} rad, {certificate.message}"
            goal = self._indices[row]
            return PlanResult(PlanStatus.FOUND, path, certificate, goal, message, len(self._trees), self._cut), -1
        self._cut, self._last_cut = self._cut + 1, certificate.message
        self._edges.look_closer()
        return None, _failed_edge(certificate, len(way) - 1)


NEAR_SHARE = 0.75
"""The share of samples within half a turn of start and a goal; with joints that turn several times the rest is vast."""

DRAWS = 256
"""Random samples that are drawn at a time."""

LOOKS_AT_ONCE = 2000
"""Samples of edges that are looked at before the clock is: some 10 ms."""


def _failed_edge(certificate: Certificate, edges: int) -> int:
    """The edge of a path, whose parameter is the waypoint's index, on which a proof failed."""
    if certificate.first_contact is not None:
        where = certificate.first_contact.time
    elif certificate.undecided is not None:
        where = (certificate.undecided.start + certificate.undecided.end) / 2
    else:  # pragma: no cover  # a certificate that is not FREE has one of them
        where = 0.0
    return min(int(where), edges - 1)


def _sampling_box(arm: Arm, ends: Array, reach: float) -> tuple[Array, Array]:
    """The limits, at most ``reach`` beyond the ends (e, n); for a joint without bounds always at most half a turn."""
    beyond = np.where(np.isinf(arm.limits.lower) | np.isinf(arm.limits.upper), np.pi, reach)
    low = np.maximum(ends.min(axis=0) - beyond, arm.limits.lower)
    return low, np.minimum(ends.max(axis=0) + beyond, arm.limits.upper)
