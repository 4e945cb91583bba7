"""RRT-Connect between a start and a set of goals, with a certificate for every path that is returned.

Two trees grow towards each other. Sampled collision checks of the edges steer the search. When the trees meet, the
complete path is certified. If the proof of an edge fails, the edge and its subtree are removed, later edges are sampled
more densely, and the search continues.

With constraints of the tcp, every step is projected onto them and its edge is proven to satisfy them.

Sources: J. Kuffner, S. LaValle (2000), "RRT-Connect: an efficient approach to single-query path planning", ICRA;
D. Berenson, S. Srinivasa, J. Kuffner (2011), "Task space regions: a framework for pose-constrained manipulation
planning", International Journal of Robotics Research 30(12) (CBiRRT2).
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof._core import RrtSearch
from pinproof.collision import CollisionChecker, PathConstraint, certify, check_constraints, is_proven_free
from pinproof.errors import InputError
from pinproof.motion import JointPath, TorqueLimits
from pinproof.planning.plan_results import PlanProgress, PlanResult, PlanStatus, Progress
from pinproof.planning.problem import Edges, Ends, manifold_of, no_path, read_ends, sampling_box, with_turns
from pinproof.spatial import Array

# Distance (m) in addition to the margin that the edges of the trees initially keep. With a quarter of it, the proofs
# take 1.5 times as long and three times as many edges fail them. With 5 mm, narrow passages take a third more samples.
SEARCH_PAD = 2e-3
# Number of edge samples after which the pad is reduced to a quarter, so that narrower passages are found. It is reduced
# again after four times as many samples, and so on.
REDUCE_PAD_AFTER = 20_000
# Number of random samples that are drawn at a time.
DRAWS = 256
# Goals (rad or m) that differ by less in every joint are equal.
SAME_GOAL = 1e-6
# Number of edge samples in one call of the compiled loop, about 3 ms. The clock and the callback are checked between
# the calls.
SAMPLES_PER_CALL = 2000
# A joint is named in the message if the values (rad or m) in one tree differ by at least this from all values in the
# other tree.
SEPARATION = 0.05

OTHER_TURNS = "a goal shifted by 2 pi may be reachable: plan to its pose, or call RrtConnect().plan with turns=True"


@dataclass(frozen=True, kw_only=True)
class RrtConnect:
    """A bidirectional planner whose paths are certified.

    Parameters
    ----------
    step
        Maximum length of an edge (Euclidean, in rad or m).
    resolution
        Distance (m) by which bodies move between two collision samples of an edge. The samples steer the search; the
        proof does not depend on them.
    max_nodes
        Number of configurations in both trees at which the search ends.
    max_samples
        Number of random samples at which the search ends. Trees in a closed region gain no nodes, so ``max_nodes`` does
        not end their search. In 400 searches of a TIAGo (8 joints) in narrow shelves, the median was 900 samples and
        the maximum 45,000; the default is well above that.
    time_limit
        Time (s) after which the search ends. The path that a search finds within the limit does not depend on it.

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

    def limited_to(self, nodes: int) -> RrtConnect:
        """Return the planner with a budget of work instead of time: nodes, and four times as many samples."""
        return replace(self, max_nodes=nodes, max_samples=4 * nodes, time_limit=math.inf)

    def supports(self, keyword: str) -> bool:
        """Whether the planner accepts ``constraints`` or ``torque_limits``, which it does."""
        return keyword in ("constraints", "torque_limits")

    def plan(
        self,
        checker: CollisionChecker,
        start: npt.ArrayLike,
        goals: npt.ArrayLike,
        *,
        turns: bool = False,
        constraints: Sequence[PathConstraint] = (),
        torque_limits: TorqueLimits | None = None,
        rng: int | np.random.Generator = 0,
        progress: Progress | None = None,
    ) -> PlanResult:
        """Plan from ``start`` (n,) to one goal (n,) or to any of several (g, n).

        The same ``rng`` gives the same path. A failure is reported in the result: the contacts of the start or the
        goals, the value that a joint cannot pass if this proves that no path exists, or the exhausted budget and the
        smallest distance between the trees.

        Parameters
        ----------
        checker
            Defines the bodies and margins. If the start or all goals are in contact only because of coarse bounding
            bodies, finer bodies are used for those pairs. ``PlanResult.checker`` is the checker of the certificate.
        start, goals
            The first configuration and the goals, inside the arm's limits.
        turns
            If True, each goal is also accepted with periodic joints shifted by multiples of 2 pi, inside the limits.
            The pose of every link is the same, and sometimes only a shifted goal can be reached. The path ends at the
            shifted configuration; ``goal`` is the index of the given one.
        constraints
            Conditions of the tcp that hold on the whole path: :class:`~pinproof.Upright`, :class:`~pinproof.Within`,
            :class:`~pinproof.collision.LookAt`. The start and the goals must satisfy them. The path has many waypoints;
            :func:`simplify`, with the same constraints, makes it short and smooth.
        torque_limits
            The path avoids configurations at which the joints cannot hold the arm at rest; checked at samples, since
            the timing of the path proves it.
        rng
            Seed or Generator of the samples.
        progress
            Called many times a second with a :class:`PlanProgress`. If it returns False, the plan ends as CANCELLED.

        Raises
        ------
        InputError
            If a shape is wrong or a number is not finite.
        """
        constraints = check_constraints(constraints)
        ends = read_ends(checker, start, goals, turns=turns, constraints=constraints, torque_limits=torque_limits)
        if isinstance(ends, PlanResult):
            return ends
        return ConnectSearch(self, ends, constraints, rng, progress).run()


class ConnectSearch:
    """One search between the start and the goals, which satisfy the constraints of the tcp.

    A Generator is made of the seed ``rng`` when the first random samples are drawn.
    """

    def __init__(
        self,
        settings: RrtConnect,
        ends: Ends,
        constraints: tuple[PathConstraint, ...],
        rng: int | np.random.Generator,
        progress: Progress | None,
    ) -> None:
        self._constraints = constraints
        self._manifold = manifold_of(ends.checker.group, constraints) if constraints else None
        self._settings, self._given, self._checker, self._rng = settings, ends, ends.checker, rng
        self._progress = progress
        both = np.vstack([ends.start, ends.goals])
        self._edges = Edges(ends.checker, settings.resolution, both, pad=SEARCH_PAD, torque_limits=ends.torque_limits)
        self._core = RrtSearch(
            self._edges.core,
            np.ascontiguousarray(ends.start),
            np.ascontiguousarray(ends.goals),
            sampling_box(ends.checker.group, both),
            step=settings.step,
            max_nodes=settings.max_nodes,
            max_samples=settings.max_samples,
            manifold=self._manifold,
        )
        self._cut, self._last_cut, self._reduce_pad_at = 0, "", REDUCE_PAD_AFTER
        self._barriers_tried = False
        self._began = time.monotonic()

    def run(self) -> PlanResult:
        """Search until a path is certified, a budget is exhausted or the callback requests to stop."""
        search, settings, happened = self._core, self._settings, RrtSearch.Event
        if self._stop_requested():
            return self._cancelled()
        if (result := self._try_direct_edges()) is not None:
            return result
        while True:
            if self._edges.samples >= self._reduce_pad_at:
                if (result := self._blocked()) is not None:
                    return result
                self._edges.reduce_pad()
                self._reduce_pad_at *= 4
                if (result := self._try_direct_edges()) is not None:
                    return result
            event = search.grow(self._edges.samples + SAMPLES_PER_CALL)
            if event is happened.MET:
                # The path through the two coincident nodes; if an edge fails the proof, it is removed.
                forward, backward = search.branch(0, search.meeting(0))[::-1], search.branch(1, search.meeting(1))
                q = np.concatenate([search.configurations(0, forward), search.configurations(1, backward[1:])])
                result, failed = self._prove(q, backward[-1])
                if result is not None:
                    return result
                # Edge i connects the waypoints i and i + 1. A tree stores an edge with its child node.
                if failed < len(forward) - 1:
                    search.cut(0, forward[failed + 1])
                else:
                    search.cut(1, backward[failed - (len(forward) - 1)])
            elif event is happened.NEEDS_DRAWS:
                self._rng = np.random.default_rng(self._rng)
                search.add_draws(self._rng.random((DRAWS, len(self._given.start) + 2)))
            elif event is happened.SPENT:
                full = self._nodes >= settings.max_nodes
                return self._out_of_budget("max_nodes" if full else "max_samples")
            if self._stop_requested():
                return self._cancelled()
            if self._seconds >= settings.time_limit:
                return self._out_of_budget("time_limit")

    @property
    def _seconds(self) -> float:
        return time.monotonic() - self._began

    @property
    def _nodes(self) -> int:
        """The number of nodes that were added to both trees, including those that were removed."""
        return int(self._core.size(0) + self._core.size(1))

    def _stop_requested(self) -> bool:
        if self._progress is None:
            return False
        search = self._core
        return self._progress(PlanProgress(self._nodes, search.samples, self._seconds, search.gap)) is False

    def _try_direct_edges(self) -> PlanResult | None:
        """The straight segment to a goal if one is proven free; the goals are tried in the order of their distance."""
        start, goals = self._given.start, self._given.goals
        steps = np.abs(goals - start).max(axis=1)
        for row in np.argsort(steps, kind="stable").tolist():
            if self._seconds >= self._settings.time_limit:
                break
            q = np.array([start, goals[row]] if steps[row] > 0 else [start])
            if self._manifold is not None and not self._manifold.edge_proven(start, goals[row]):
                continue
            if self._edges.samples_free(start, goals[row]) and (result := self._prove(q, row)[0]) is not None:
                return result
        return None

    def _prove(self, q: Array, row: int) -> tuple[PlanResult | None, int]:
        """The certified path q (m, n) to a goal; or None and the index of the edge that is not free."""
        path = JointPath(q, self._checker.group.joint_names)
        found: dict[str, Any] = {"gap": 0.0, "path": path, "goal": self._given.indices[row]}
        found["message"] = f"found a path with {len(path)} waypoints and length {path.length:.3g}"
        # The margin is proven first, which takes a third of the time; the clearance when it is asked for
        inside = self._checker.group.limits.inside(q).all()
        if inside and not self._constraints and is_proven_free(path, self._checker):
            found["message"] += ", proven collision-free"
            return self._result(PlanStatus.FOUND, certificate=partial(certify, path, self._checker), **found), -1
        certificate = certify(path, self._checker, constraints=self._constraints)
        if certificate.free:
            found["message"] += f"; {certificate.message}"
            return self._result(PlanStatus.FOUND, certificate=certificate, **found), -1
        self._cut, self._last_cut = self._cut + 1, certificate.message
        self._edges.refine()
        # The parameter of the path is the index of the waypoint.
        return None, min(int(certificate.fails_at), len(q) - 2)

    def _blocked(self) -> PlanResult | None:
        """The result if it is proven that no path exists; None otherwise, and after the first call."""
        if self._barriers_tried:
            return None
        self._barriers_tried = True
        barriers = self._given.barriers()
        if not barriers:
            return None
        gap = self._core.distance_of_trees()
        periodic = {self._checker.group.joint_names[k] for k in np.flatnonzero(self._checker.group.periodic)}
        shifted = not self._given.turns and self._has_other_turns()
        hint = f"; {OTHER_TURNS}" if shifted and periodic.intersection(barrier.joint for barrier in barriers) else ""
        fields = no_path(barriers)
        return self._result(**{**fields, "message": fields["message"] + hint}, gap=gap)

    def _out_of_budget(self, budget: str) -> PlanResult:
        if (result := self._blocked()) is not None:
            return result
        unit = " s" if budget == "time_limit" else ""
        spent = f"no path within {budget} = {getattr(self._settings, budget):g}{unit}"
        advice = f"Try a larger {budget}, another rng or other goals"
        return self._without_path(PlanStatus.OUT_OF_BUDGET, spent, advice)

    def _cancelled(self) -> PlanResult:
        stopped = f"cancelled after {self._seconds:.3g} s without a path"
        return self._without_path(PlanStatus.CANCELLED, stopped, "A path may exist")

    def _without_path(self, status: PlanStatus, why: str, advice: str) -> PlanResult:
        failed = f", {self._cut} edges failed the proof, the last one: {self._last_cut}" if self._cut else ""
        trees = (self._core.nodes(0), self._core.nodes(1))
        gap = self._core.distance_of_trees()
        # The joints whose ranges in the two trees do not overlap, and whether goals shifted by 2 pi may help.
        arm, separated = self._checker.group, list[str]()
        periodic = False
        for joint, (one, other) in enumerate(zip(trees[0].T, trees[1].T, strict=True)):
            if max(one.min() - other.max(), other.min() - one.max()) < SEPARATION:
                continue
            periodic = periodic or bool(arm.periodic[joint])
            separated.append(
                f"{arm.joint_names[joint]} stayed in [{one.min():.2f}, {one.max():.2f}] from the start "
                f"and in [{other.min():.2f}, {other.max():.2f}] from the goal"
            )
        hints = [OTHER_TURNS] if periodic and not self._given.turns and self._has_other_turns() else []
        near = f"the trees came within {gap:.3g} (rad or m) of each other in joint space"
        separation = "; ".join([near, *separated, *hints])
        if self._given.torque_limits is not None:
            advice = f"{advice}. Configurations at which the torque limits do not permit a standstill were avoided"
        work = f"{self._nodes} nodes, {self._core.samples} samples{failed}"
        return self._result(status, f"{why} ({work}); {separation}. {advice}", gap=gap)

    def _has_other_turns(self) -> bool:
        """Whether a goal shifted by multiples of 2 pi is inside the limits and is not itself a goal."""
        goals = self._given.goals
        others = with_turns(self._checker.group, self._given.start, goals)[0][len(goals) :]
        return bool((np.abs(goals[:, None] - others).max(axis=2).min(axis=0) > SAME_GOAL).any())

    def _result(self, status: PlanStatus, message: str, gap: float, **found: Any) -> PlanResult:
        return PlanResult(
            status, message=message, nodes=self._nodes, cut=self._cut, samples=self._core.samples,
            seconds=self._seconds, gap=gap, checker=self._checker, **found,
        )  # fmt: skip
