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
from pinproof.planning.tree import Tree

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
        Largest joint step (rad or m) between the samples that steer the search; the proof does not depend on it.
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
        self._settings, self._checker, self._rng = settings, checker, rng
        self._edges = Edges(checker, settings.resolution, np.vstack([start, goals]))
        self._start, self._goals, self._indices, self._turns = start, goals, indices, turns
        self._trees = (Tree(start[None]), Tree(goals))
        self._wide = _sampling_box(checker.arm, np.vstack([start, goals]), np.inf)
        self._near = [_sampling_box(checker.arm, np.array([start, goal]), np.pi) for goal in goals]
        self._cut, self._last_cut = 0, ""

    def run(self) -> PlanResult:
        deadline = time.monotonic() + self._settings.time_limit
        if (result := self._straight()) is not None:
            return result
        samples, budget = 0, ""
        while not budget:
            grow = 0 if len(self._trees[0]) <= len(self._trees[1]) else 1  # the smaller one
            samples += 1
            node = self._extend(self._trees[grow], self._sample())
            if node is not None:
                other = self._connect(self._trees[1 - grow], self._trees[grow].q[node].copy())
                if other is not None:
                    at_start, at_goal = (node, other) if grow == 0 else (other, node)
                    if (result := self._join(at_start, at_goal)) is not None:
                        return result
            budget = self._spent(samples, deadline)
        failed = f", {self._cut} edges failed the proof, the last because {self._last_cut}" if self._cut else ""
        apart = how_far_apart(self._checker.arm, *(tree.living() for tree in self._trees), turns=self._turns)
        message = (
            f"no path within {budget} ({self._nodes} nodes, {samples} samples{failed}); {apart}. "
            "Give it more, another rng, or other goals"
        )
        return PlanResult(PlanStatus.OUT_OF_BUDGET, None, None, None, message, self._nodes, self._cut)

    @property
    def _nodes(self) -> int:
        return sum(map(len, self._trees))

    def _spent(self, samples: int, deadline: float) -> str:
        """Which budget is spent; empty while none is."""
        if self._nodes >= self._settings.max_nodes:
            return f"max_nodes = {self._settings.max_nodes}"
        if samples >= self._settings.max_samples:
            return f"max_samples = {self._settings.max_samples}"
        return f"time_limit = {self._settings.time_limit:g} s" if time.monotonic() >= deadline else ""

    def _straight(self) -> PlanResult | None:
        """The straight way to a goal, the nearest first."""
        steps = np.abs(self._goals - self._start).max(axis=1)
        for row in np.argsort(steps, kind="stable").tolist():
            goal = self._goals[row]
            way = np.array([self._start, goal] if steps[row] > 0 else [goal])
            if self._edges.looks_free(self._start, goal) and (result := self._prove(way, row)[0]) is not None:
                return result
        return None

    def _sample(self) -> Array:
        """A configuration around the start and one of the goals, or now and then anywhere."""
        if self._rng.random() < NEAR_SHARE:
            return self._rng.uniform(*self._near[self._rng.integers(len(self._near))])
        return self._rng.uniform(*self._wide)

    def _extend(self, tree: Tree, target: Array) -> int | None:
        """One step from the nearest node towards a target; the new node, or None when the way is blocked.

        Where a whole step is blocked, ever shorter ones are tried: in a tight place they are all there is.
        """
        near = tree.nearest(target)
        a = tree.q[near].copy()
        towards = target - a
        distance = float(np.linalg.norm(towards))
        if distance == 0:
            return None
        share = min(1.0, self._settings.step / distance)
        for _ in range(SHORTENINGS + 1):
            b = target if share == 1.0 else a + towards * share
            if self._edges.looks_free(a, b):
                return tree.add(b, near)
            share /= 2
        return None

    def _connect(self, tree: Tree, target: Array) -> int | None:
        """Steps from the nearest node all the way to a target; the node at it, or None when the way is blocked."""
        node = tree.nearest(target)
        while not np.array_equal(tree.q[node], target):
            a = tree.q[node].copy()
            distance = float(np.linalg.norm(target - a))
            b = target if distance <= self._settings.step else a + (target - a) * (self._settings.step / distance)
            if not self._edges.looks_free(a, b):
                return None
            node = tree.add(b, node)
        return node

    def _join(self, at_start: int, at_goal: int) -> PlanResult | None:
        """The certified path through two nodes that coincide, or None after cutting the edge that failed."""
        forth, back = self._trees[0].branch(at_start)[::-1], self._trees[1].branch(at_goal)
        way = np.concatenate([self._trees[0].q[forth], self._trees[1].q[back[1:]]])
        result, failed = self._prove(way, back[-1])
        if result is None:
            # edge i leads from waypoint i to i + 1; a tree hangs an edge on its end that is farther from the root
            if failed < len(forth) - 1:
                self._trees[0].cut(forth[failed + 1])
            else:
                self._trees[1].cut(back[failed - (len(forth) - 1)])
        return result

    def _prove(self, way: Array, row: int) -> tuple[PlanResult | None, int]:
        """The path to a goal, certified; or None and the index of the edge that is not free."""
        path = JointPath(way, self._checker.arm.joint_names)
        certificate = certify(path, self._checker)
        if certificate.free:
            message = f"a path of {len(path)} waypoints and {path.length:.3g} rad, {certificate.message}"
            goal = self._indices[row]
            return PlanResult(PlanStatus.FOUND, path, certificate, goal, message, self._nodes, self._cut), -1
        self._cut, self._last_cut = self._cut + 1, certificate.message
        self._edges.look_closer()
        return None, _failed_edge(certificate, len(way) - 1)


NEAR_SHARE = 0.75
"""The share of samples within half a turn of start and a goal; with joints that turn several times the rest is vast."""

SHORTENINGS = 3
"""How often a blocked step is halved before a tree gives a sample up."""


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
