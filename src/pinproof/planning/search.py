"""One search: two trees that grow towards each other, and the proof of the way where they meet.

Samples steer the search and decide nothing. When the trees meet, the whole way is proven; an edge that fails is cut out
of its tree with all that hangs on it, edges are looked at more closely from then on, and the search goes on.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, certify
from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.planning.apart import gap_between, how_far_apart
from pinproof.planning.edges import Edges
from pinproof.planning.ends import Ends
from pinproof.planning.goals import with_turns
from pinproof.planning.result import PlanProgress, PlanResult, PlanStatus, Progress
from pinproof.planning.trees import Trees

if TYPE_CHECKING:
    from pinproof.planning.rrt_connect import RrtConnect

__all__ = ["PAD", "Search", "sampling_box"]

Array = npt.NDArray[np.float64]

PAD = 2e-3
"""Metres of distance beyond the margin that the trees keep at first. With a quarter of it, proofs take half as long
again and three times as many edges fail them; with 5 mm, narrow places take a third more samples."""

LESS_AFTER = 20_000
"""Samples of edges after which the trees keep a quarter of that, so that narrower ways are tried; after four times as
many a quarter again, and so on."""

DRAWS = 256
"""Random samples that are drawn at a time."""

SAME_GOAL = 1e-6
"""Rad or m: goals that differ by less in every joint are one."""

LOOKS_AT_ONCE = 2000
"""Samples of edges that are looked at before the clock is: some 10 ms."""


class Search:
    """One search between two ends.

    Parameters
    ----------
    settings
        Its budgets and steps.
    ends
        What it is to connect.
    rng
        Where random samples come from.
    progress
        Whom to tell.
    """

    def __init__(self, settings: RrtConnect, ends: Ends, rng: np.random.Generator, progress: Progress | None) -> None:
        from pinproof.kernels import rrt

        self._kernel = rrt
        self._settings, self._given, self._checker, self._rng = settings, ends, ends.checker, rng
        self._progress, self._began = progress, time.monotonic()
        both = np.vstack([ends.start, ends.goals])
        self._edges = Edges(ends.checker, settings.resolution, both, pad=PAD)
        self._state = np.zeros(rrt.STATE_SIZE, dtype=np.int64)
        self._state[[rrt.TOLD, rrt.MOST_NODES, rrt.MOST_SAMPLES]] = rrt.ASK, settings.max_nodes, settings.max_samples
        self._trees = Trees(ends.start, ends.goals, self._state[rrt.SIZE : rrt.SIZE + 2])
        self._box = sampling_box(ends.checker.arm, both)
        self._draws, self._ends = np.empty((0, len(ends.start) + 2)), np.empty((2, len(ends.start)))
        self._gap = np.array([np.inf])
        self._cut, self._last_cut, self._less_at = 0, "", LESS_AFTER

    def run(self) -> PlanResult:
        """Search until a path is proven, a budget is spent or somebody says to stop."""
        k, state, settings = self._kernel, self._state, self._settings
        if self._told_to_stop():
            return self._cancelled()
        if (result := self._straight()) is not None:
            return result
        while True:
            if self._edges.looks >= self._less_at:
                self._edges.keep_less()
                self._less_at *= 4
                if (result := self._straight()) is not None:
                    return result
            ended = self._grow()
            if ended == k.MET:
                if (result := self._join(int(state[k.AT_START]), int(state[k.AT_GOAL]))) is not None:
                    return result
            elif ended == k.COAL:
                state[k.TOLD] = k.FREE if self._edges.judged_free() else k.BLOCKED
            elif ended == k.DRAWS:
                self._draws, state[k.DRAWN] = self._rng.random((DRAWS, self._draws.shape[1])), 0
            elif ended == k.NODES:
                self._trees.make_room()
            elif ended == k.SPENT:
                full = len(self._trees) >= settings.max_nodes
                return self._nothing("max_nodes" if full else "max_samples")
            if self._told_to_stop():
                return self._cancelled()
            if self._seconds >= settings.time_limit:
                return self._nothing("time_limit")

    @property
    def _seconds(self) -> float:
        return time.monotonic() - self._began

    def _told_to_stop(self) -> bool:
        if self._progress is None:
            return False
        samples = int(self._state[self._kernel.SAMPLES])
        return self._progress(PlanProgress(len(self._trees), samples, self._seconds, float(self._gap[0]))) is False

    def _straight(self) -> PlanResult | None:
        """The straight way to a goal, the nearest first."""
        start, goals = self._given.start, self._given.goals
        steps = np.abs(goals - start).max(axis=1)
        for row in np.argsort(steps, kind="stable").tolist():
            if self._seconds >= self._settings.time_limit:
                break
            way = np.array([start, goals[row]] if steps[row] > 0 else [start])
            if self._edges.looks_free(start, goals[row]) and (result := self._prove(way, row)[0]) is not None:
                return result
        return None

    def _grow(self) -> int:
        """Let the trees grow until something is to be done about it here; what that is."""
        state, trees, edges = self._state, self._trees, self._edges
        steering = edges.steering
        state[self._kernel.UNTIL] = edges.looks + LOOKS_AT_ONCE
        ended: int = self._kernel.grow(
            steering.numbers, steering.indices, steering.workspace.at, self._settings.step, edges.resolution, self._box,
            self._draws, trees.q, trees.parents, state, self._ends, edges.asked, edges.counts, self._gap,
        )  # fmt: skip
        return ended

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
            self._gap[0] = np.inf  # the nodes that were near may be gone
        return result

    def _prove(self, way: Array, row: int) -> tuple[PlanResult | None, int]:
        """The path to a goal, certified; or None and the index of the edge that is not free."""
        path = JointPath(way, self._checker.arm.joint_names)
        certificate = certify(path, self._checker)
        if certificate.free:
            message = f"a path of {len(path)} waypoints and {path.length:.3g} rad, {certificate.message}"
            found = self._result(PlanStatus.FOUND, message, gap=0.0)
            return replace(found, path=path, certificate=certificate, goal=self._given.indices[row]), -1
        self._cut, self._last_cut = self._cut + 1, certificate.message
        self._edges.look_closer()
        return None, _failed_edge(certificate, len(way) - 1)

    def _nothing(self, budget: str) -> PlanResult:
        unit = " s" if budget == "time_limit" else ""
        spent = f"no path within {budget} = {getattr(self._settings, budget):g}{unit}"
        advice = "Give it more, another rng, or other goals"
        return self._without_path(PlanStatus.OUT_OF_BUDGET, spent, advice)

    def _cancelled(self) -> PlanResult:
        stopped = f"cancelled after {self._seconds:.3g} s without a path"
        return self._without_path(PlanStatus.CANCELLED, stopped, "Nothing says that there is none")

    def _without_path(self, status: PlanStatus, why: str, advice: str) -> PlanResult:
        failed = f", {self._cut} edges failed the proof, the last because {self._last_cut}" if self._cut else ""
        trees = (self._trees.living(0), self._trees.living(1))
        gap = gap_between(*trees)
        apart = how_far_apart(self._checker.arm, *trees, gap, turns=self._given.turns or not self._has_other_turns())
        work = f"{len(self._trees)} nodes, {self._state[self._kernel.SAMPLES]} samples{failed}"
        return self._result(status, f"{why} ({work}); {apart}. {advice}", gap=gap)

    def _has_other_turns(self) -> bool:
        """Whether a goal has an equal whole turns away, inside the limits, that is not a goal itself."""
        goals = self._given.goals
        others = with_turns(self._checker.arm, self._given.start, goals)[0][len(goals) :]
        return any(np.abs(goals - other).max(axis=1).min() > SAME_GOAL for other in others)

    def _result(self, status: PlanStatus, message: str, *, gap: float) -> PlanResult:
        return PlanResult(
            status,
            None,
            None,
            None,
            message,
            nodes=len(self._trees),
            cut=self._cut,
            samples=int(self._state[self._kernel.SAMPLES]),
            seconds=self._seconds,
            gap=gap,
            checker=self._checker,
        )


def _failed_edge(certificate: Certificate, edges: int) -> int:
    """The edge of a path, whose parameter is the waypoint's index, on which a proof failed."""
    if certificate.first_contact is not None:
        where = certificate.first_contact.time
    elif certificate.undecided is not None:
        where = (certificate.undecided.start + certificate.undecided.end) / 2
    else:  # pragma: no cover  # a certificate that is not FREE has one of them
        where = 0.0
    return min(int(where), edges - 1)


def sampling_box(arm: Arm, ends: Array) -> Array:
    """(2, n) the limits; for a joint without bounds half a turn beyond the ends (e, n)."""
    unbounded = np.isinf(arm.limits.lower) | np.isinf(arm.limits.upper)
    low = np.where(unbounded, np.maximum(ends.min(axis=0) - np.pi, arm.limits.lower), arm.limits.lower)
    high = np.where(unbounded, np.minimum(ends.max(axis=0) + np.pi, arm.limits.upper), arm.limits.upper)
    return np.array([low, high])
