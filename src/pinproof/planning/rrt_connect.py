"""The two trees of a search: configurations, each with its parent, in the arrays that compiled loops grow.

How two trees stayed apart, in words: what a user of a failed search can act on.

One search: two trees that grow towards each other, and the proof of the way where they meet.

Samples steer the search and decide nothing. When the trees meet, the whole way is proven; an edge that fails is cut out
of its tree with all that hangs on it, edges are looked at more closely from then on, and the search goes on.

Several searches of one problem, each with samples of its own; the shortest path of all is the answer.

RRT-Connect between a start and a set of goals, whose answer is always certified.

Two trees grow towards each other; samples steer the search. When they meet, the whole way is proven; an edge that fails
is cut out of its tree with all that hangs on it, and the search goes on (:mod:`pinproof.planning.rrt_connect`).

Source: J. Kuffner, S. LaValle (2000), "RRT-Connect: an efficient approach to single-query path planning", ICRA.
"""

from __future__ import annotations

import time
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof.collision import Certificate, CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.planning.edges import Edges
from pinproof.planning.ends import Ends, read_ends, with_turns
from pinproof.planning.result import PlanProgress, PlanResult, PlanStatus, Progress

__all__ = ["PAD", "RrtConnect", "Search", "Trees", "best_of", "gap_between", "how_far_apart", "sampling_box"]

Array = npt.NDArray[np.float64]

ROOM = 256
"""Nodes there is room for in either tree at first."""


class Trees:
    """The tree of the start (0) and the tree of the goals (1).

    Parameters
    ----------
    start
        (n,) the root of the first.
    goals
        (g, n) the roots of the second.
    sizes
        (2,) how many nodes each has; written here, and by the loop that grows them.

    Attributes
    ----------
    q
        (2, N, n) the nodes, those of either tree in the order they were added; those that were cut stand at infinity.
    parents
        (2, N) the index of each node's parent, its own for a root.
    """

    def __init__(self, start: Array, goals: Array, sizes: npt.NDArray[np.int64]) -> None:
        room = max(ROOM, len(goals) + 1)
        self.q = np.empty((2, room, len(start)))
        self.parents = np.zeros((2, room), dtype=np.int64)
        self._sizes = sizes
        self.q[0, 0], self.q[1, : len(goals)] = start, goals
        self.parents[1, : len(goals)] = np.arange(len(goals))
        sizes[:] = 1, len(goals)

    def __len__(self) -> int:
        """Nodes that were ever added to either."""
        return int(self._sizes.sum())

    def make_room(self) -> None:
        """Twice the room for nodes."""
        self.q = np.concatenate([self.q, np.empty_like(self.q)], axis=1)
        self.parents = np.concatenate([self.parents, np.empty_like(self.parents)], axis=1)

    def branch(self, tree: int, index: int) -> list[int]:
        """Nodes of a tree from ``index`` up to its root."""
        way = [index]
        while (parent := int(self.parents[tree, way[-1]])) != way[-1]:
            way.append(parent)
        return way

    def cut(self, tree: int, index: int) -> None:
        """Take a node that is no root, and all that hangs on it, out of a tree."""
        dead = np.zeros(self._sizes[tree], dtype=bool)
        dead[index] = True
        for child in range(index + 1, len(dead)):  # children come after their parents
            dead[child] = dead[self.parents[tree, child]]
        self.q[tree, : len(dead)][dead] = np.inf

    def living(self, tree: int) -> Array:
        """(m, n) the nodes of a tree that were not cut."""
        q = self.q[tree, : self._sizes[tree]]
        return q[np.isfinite(q[:, 0])]


NEVER_SHARED = 0.05
"""Rad or m. A joint is named if the values one tree took are at least this far from all that the other took."""


def gap_between(from_start: Array, from_goal: Array) -> float:
    """The smallest distance (Euclidean, in rad or m) between two trees (a, n) and (b, n)."""
    from scipy.spatial import cKDTree

    return float(cKDTree(from_start).query(from_goal)[0].min())


def how_far_apart(arm: Arm, from_start: Array, from_goal: Array, gap: float, *, turns: bool) -> str:
    """The ``gap`` between two trees (a, n) and (b, n) in words, and the joints in which they never met.

    ``turns`` says whether all goals whole turns away were roots; if not, a parted periodic joint suggests them.
    """
    words = f"the trees came within {gap:.3g} (rad or m) of each other in joint space"
    parted = {joint: text for joint in range(arm.dof) if (text := _parted(arm, joint, from_start, from_goal))}
    hint = "a whole turn may lead round it: plan with turns=True"
    hints = [hint] if not turns and any(arm.periodic[joint] for joint in parted) else []
    return "; ".join([words, *parted.values(), *hints])


def _parted(arm: Arm, joint: int, from_start: Array, from_goal: Array) -> str:
    """What keeps the trees apart in one joint; empty if their ranges overlap."""
    one, other = from_start[:, joint], from_goal[:, joint]
    if max(one.min() - other.max(), other.min() - one.max()) < NEVER_SHARED:
        return ""
    return (
        f"{arm.joint_names[joint]} stayed in [{one.min():.2f}, {one.max():.2f}] from the start "
        f"and in [{other.min():.2f}, {other.max():.2f}] from the goal"
    )


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


TELL_EVERY = 0.1
"""Seconds between two calls of the progress callback while others search."""


def best_of(
    settings: RrtConnect,
    ends: Ends,
    count: int,
    rng: np.random.Generator,
    executor: Executor | None,
    progress: Progress | None,
) -> PlanResult:
    """The shortest path that ``count`` searches find, of equals the one of the first search.

    All of them are waited for, so that the answer depends neither on how many run at a time nor on which is quicker.
    """
    try:
        streams = rng.spawn(count)
    except TypeError as error:
        raise InputError("this Generator cannot be split; make it with numpy.random.default_rng") from error
    if executor is None:
        results = []
        for stream in streams:
            results.append(Search(settings, ends, stream, progress).run())
            if results[-1].status is PlanStatus.CANCELLED:
                break
    else:
        futures = [executor.submit(_search, settings, ends, stream) for stream in streams]
        results = _gathered(futures, progress)
    return replace(_best(results), checker=ends.checker)


def _search(settings: RrtConnect, ends: Ends, rng: np.random.Generator) -> PlanResult:
    """One search in a worker; its checker need not travel back."""
    return replace(Search(settings, ends, rng, None).run(), checker=None)


def _gathered(futures: list[Future[PlanResult]], progress: Progress | None) -> list[PlanResult]:
    """What all workers say; if somebody says to stop, what those said that were through by then.

    A search that has begun in a worker cannot be stopped from here: it ends within its budgets.
    """
    began, waiting = time.monotonic(), set(futures)
    try:
        while waiting:
            _, waiting = wait(waiting, None if progress is None else TELL_EVERY, FIRST_COMPLETED)
            if progress is not None:
                known = [future.result() for future in futures if future.done()]
                nodes, samples = sum(result.nodes for result in known), sum(result.samples for result in known)
                gap = min((result.gap for result in known), default=np.inf)
                if waiting and progress(PlanProgress(nodes, samples, time.monotonic() - began, gap)) is False:
                    message = f"cancelled with {len(known)} of {len(futures)} searches through"
                    seconds = time.monotonic() - began
                    stopped = PlanResult(
                        PlanStatus.CANCELLED,
                        None,
                        None,
                        None,
                        message,
                        nodes,
                        samples=samples,
                        seconds=seconds,
                        gap=gap,
                    )
                    return [*known, stopped]
        return [future.result() for future in futures]
    finally:
        for future in futures:
            future.cancel()


def _best(results: list[PlanResult]) -> PlanResult:
    found = [result for result in results if result.path is not None]
    if found:
        return min(found, key=lambda result: result.path.length if result.path is not None else np.inf)
    if results[-1].status is PlanStatus.CANCELLED:
        return results[-1]
    nearest = min(results, key=lambda result: result.gap)
    return replace(
        nearest, message=f"none of {len(results)} searches found a path; the one that came nearest: {nearest.message}"
    )


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
        Random samples after which the search ends: trees that are walled in gain no nodes. A TIAGo's 8 joints in narrow
        shelves took 900 in the median and up to 45,000 in 400 searches, which is why the default is far above that.
    time_limit
        Seconds after which the search ends. Answers that were found before do not depend on it, and it never decides
        where one of the other two budgets ends the search first.

    Raises
    ------
    InputError
        If a setting is not above 0.
    """

    step: float = 0.7
    resolution: float = 0.08
    max_nodes: int = 20_000
    max_samples: int = 200_000
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
        progress: Progress | None = None,
        portfolio: int = 1,
        executor: Executor | None = None,
    ) -> PlanResult:
        """Plan from ``start`` (n,) to one goal (n,) or to any of several (g, n).

        The same ``rng`` gives the same path. A failure is a result: it says what touches, or which budget ran out and
        how near the search came.

        Parameters
        ----------
        checker
            What the path must be free of. Where the start, or every goal, touches by coarse bodies alone, those pairs
            are judged more finely; ``PlanResult.checker`` is the checker the path is proven with.
        start, goals
            The ends, inside the arm's limits.
        turns
            Take a goal also where joints stand whole turns away from it, inside the limits: the same pose of every
            link, and often the only one that can be reached. The path then ends there; ``goal`` is the index it equals.
        rng
            Seed or Generator of the samples.
        progress
            Called many times a second with a :class:`PlanProgress`; where it returns False, the plan is CANCELLED.
        portfolio
            How many searches there are, each with samples of its own; the shortest of their paths is the answer.
        executor
            Where the searches of a portfolio run; without one, one after the other here. The answer is the same.

        Raises
        ------
        InputError
            If a shape is wrong, a number is not finite or there is no search in the portfolio.
        """
        if portfolio < 1:
            raise InputError(f"portfolio = {portfolio}; it is the number of searches, at least 1")
        ends = read_ends(checker, start, goals, turns=turns)
        if isinstance(ends, PlanResult):
            return ends
        generator = np.random.default_rng(rng)
        if portfolio == 1 and executor is None:
            return Search(self, ends, generator, progress).run()
        return best_of(self, ends, portfolio, generator, executor, progress)
