"""RRT-Connect between a start and a set of goals, whose answer is always certified.

Two trees grow towards each other; samples steer the search. When they meet, every edge of the way is proven; an edge
that fails is cut out of its tree with all that hangs on it, and the search goes on.

Source: J. Kuffner, S. LaValle (2000), "RRT-Connect: an efficient approach to single-query path planning", ICRA.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.planning.edges import Edges
from pinproof.planning.result import PlanResult, PlanStatus
from pinproof.planning.tree import Tree
from pinproof.spatial import finite

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
        Largest joint step between the samples that steer the search; the proof does not depend on it.
    max_nodes
        Configurations in both trees after which the search ends.
    time_limit
        Seconds after which the search ends. Answers that were found before do not depend on it.
    """

    step: float = 1.0
    resolution: float = 0.05
    max_nodes: int = 20_000
    time_limit: float = 20.0

    def __post_init__(self) -> None:
        for name in ("step", "resolution", "max_nodes", "time_limit"):
            if not getattr(self, name) > 0:
                raise InputError(f"RrtConnect.{name} = {getattr(self, name)}; it must be above 0")

    def plan(
        self,
        checker: CollisionChecker,
        start: npt.ArrayLike,
        goals: npt.ArrayLike,
        *,
        rng: int | np.random.Generator = 0,
    ) -> PlanResult:
        """Plan from ``start`` (n,) to one goal (n,) or to any of several (g, n).

        The same ``rng`` gives the same path. A failure is a result: it says what touches, or which budget ran out.

        Raises
        ------
        InputError
            If a shape is wrong or a number is not finite.
        """
        arm = checker.arm
        first = arm.configuration(start, "start")
        many = np.array(goals, dtype=float) if np.ndim(goals) != 1 else np.array(goals, dtype=float)[None]
        many = finite("goals", many, (None, arm.dof))
        if len(many) == 0:
            raise InputError("goals is empty; give at least one configuration")
        if trouble := _trouble(checker, first):
            return PlanResult(PlanStatus.START_INVALID, None, None, None, f"the start cannot be left: {trouble}")
        troubles = [_trouble(checker, goal) for goal in many]
        valid = [index for index, trouble in enumerate(troubles) if not trouble]
        if not valid:
            listed = "; ".join(f"goal {i}: {t}" for i, t in list(enumerate(troubles))[:5])
            return PlanResult(PlanStatus.GOAL_INVALID, None, None, None, f"no goal can be entered: {listed}")
        generator = np.random.default_rng(rng)
        return _Search(self, checker, first, many, valid, generator).run()


def _trouble(checker: CollisionChecker, q: Array) -> str:
    """Why q (n,) cannot be an end of a path; empty when it can."""
    outside = checker.arm.limits.violations(q, checker.arm.joint_names)
    if outside:
        return "; ".join(outside)
    result = checker.check(q)
    return "" if result.free else str(result)


class _Search:
    """The state of one search."""

    def __init__(
        self,
        settings: RrtConnect,
        checker: CollisionChecker,
        start: Array,
        goals: Array,
        valid: list[int],
        rng: np.random.Generator,
    ) -> None:
        self._settings, self._checker, self._rng = settings, checker, rng
        self._edges = Edges(checker, settings.resolution)
        self._start, self._goals, self._valid = start, goals, valid
        self._trees = (Tree(start[None]), Tree(goals[valid]))
        self._wide = _sampling_box(checker.arm, start, goals[valid], np.inf)
        self._near = _sampling_box(checker.arm, start, goals[valid], np.pi)
        self._cut = 0

    def run(self) -> PlanResult:
        deadline = time.monotonic() + self._settings.time_limit
        for goal in sorted(self._valid, key=lambda i: float(np.abs(self._goals[i] - self._start).max())):
            way = np.array([self._start, self._goals[goal]])
            if self._edges.looks_free(*way) and self._edges.prove(*way).free:
                return self._found(way, goal)
        grow, meet = 0, 1
        while sum(map(len, self._trees)) < self._settings.max_nodes and time.monotonic() < deadline:
            box = self._near if self._rng.random() < NEAR_SHARE else self._wide
            sample = self._rng.uniform(*box)
            node = self._extend(self._trees[grow], sample)
            if node is not None:
                other = self._connect(self._trees[meet], self._trees[grow].q[node].copy())
                if other is not None:
                    at_start, at_goal = (node, other) if grow == 0 else (other, node)
                    if (result := self._join(at_start, at_goal)) is not None:
                        return result
            grow, meet = meet, grow
        budget = "time" if time.monotonic() >= deadline else "number of nodes"
        nodes = sum(map(len, self._trees))
        gap = _gap(*self._trees)
        message = (
            f"no path within the {budget} limit ({nodes} nodes, {self._cut} edges failed the proof); "
            f"the trees came within {gap:.3g} rad of each other. Give it more, another rng, or other goals"
        )
        return PlanResult(PlanStatus.OUT_OF_BUDGET, None, None, None, message, nodes, self._cut)

    def _extend(self, tree: Tree, target: Array) -> int | None:
        """One step from the nearest node towards a target; the new node, or None when the way is blocked."""
        near = tree.nearest(target)
        return self._step(tree, near, target)

    def _connect(self, tree: Tree, target: Array) -> int | None:
        """Steps from the nearest node all the way to a target; the node at it, or None when the way is blocked."""
        node: int | None = tree.nearest(target)
        while node is not None and not np.array_equal(tree.q[node], target):
            node = self._step(tree, node, target)
        return node

    def _step(self, tree: Tree, near: int, target: Array) -> int | None:
        a = tree.q[near].copy()
        distance = float(np.linalg.norm(target - a))
        b = target if distance <= self._settings.step else a + (target - a) * (self._settings.step / distance)
        return tree.add(b, near) if distance > 0 and self._edges.looks_free(a, b) else None

    def _join(self, at_start: int, at_goal: int) -> PlanResult | None:
        """The certified path through two nodes that coincide, or None after cutting the edge that failed."""
        for tree, node in zip(self._trees, (at_start, at_goal), strict=True):
            way = tree.branch(node)
            for child, parent in reversed(list(itertools.pairwise(way))):
                if tree.proven[child]:
                    continue
                if not self._edges.prove(tree.q[parent], tree.q[child]).free:
                    tree.cut(child)
                    self._cut += 1
                    return None
                tree.proven[child] = True
        forth, back = self._trees[0].branch(at_start)[::-1], self._trees[1].branch(at_goal)
        way_q = np.concatenate([self._trees[0].q[forth], self._trees[1].q[back[1:]]])
        return self._found(way_q, self._valid[back[-1]])

    def _found(self, way: Array, goal: int) -> PlanResult:
        path = JointPath(way, self._checker.arm.joint_names)
        certificate = certify(path, self._checker)
        nodes = sum(map(len, self._trees))
        if not certificate.free:  # every edge was proven; the whole path is proven again before it is handed over
            message = f"the path's edges were proven but not the path: {certificate.message}"
            return PlanResult(PlanStatus.OUT_OF_BUDGET, None, None, None, message, nodes, self._cut)
        message = f"a path of {len(path)} waypoints and {path.length:.3g} rad, {certificate.message}"
        return PlanResult(PlanStatus.FOUND, path, certificate, goal, message, nodes, self._cut)


NEAR_SHARE = 0.75
"""The share of samples within half a turn of start and goals; with joints that turn several times the rest is vast."""


def _sampling_box(arm: Arm, start: Array, goals: Array, reach: float) -> tuple[Array, Array]:
    """The limits, at most ``reach`` beyond start and goals; for a joint without bounds always at most half a turn."""
    ends = np.vstack([start, goals])
    beyond = np.where(np.isinf(arm.limits.lower) | np.isinf(arm.limits.upper), np.pi, reach)
    low = np.maximum(ends.min(axis=0) - beyond, arm.limits.lower)
    return low, np.minimum(ends.max(axis=0) + beyond, arm.limits.upper)


def _gap(one: Tree, other: Tree) -> float:
    """The smallest Euclidean distance between two trees' living nodes, over at most 2,000 of each."""
    a, b = (tree.q[: len(tree)][tree.alive[: len(tree)]][:2000] for tree in (one, other))
    return float(min(np.linalg.norm(b - q, axis=1).min() for q in a))
