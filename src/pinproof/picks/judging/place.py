"""The place stage: transfer with the object, straight lowering, release, and retreat with the empty gripper."""

from __future__ import annotations

import heapq
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from pinproof.collision import Certificate
from pinproof.common.steps import step
from pinproof.motion import BlendedPath, CubicPath, JointPath, least_times
from pinproof.picks.input.pick import Member, PlaceTarget
from pinproof.picks.judging.configurations import best_margins, configurations, least_seconds, limit_margin
from pinproof.picks.judging.grasp import closing_words, contact_words, every_branch, out_of_reach
from pinproof.picks.judging.lines import Attempt, Pairs, line, shifted, shortened, span
from pinproof.picks.judging.task import PickTask, once_per_grasp, torque_limits
from pinproof.picks.judging.verdict import Stage, StageResult
from pinproof.planning import planner_of, simplify, with_turns
from pinproof.spatial import Array


class Scores:
    """The scores of the complete motions with one transit and one grasp, and their upper bounds.

    Here all are equal, so that the first possible place is the best.
    """

    def bound(self, clearance: Array | float, seconds: Array, margin: Array, *lines: CubicPath | None) -> Array:
        """Upper bounds of the scores with the clearances (m) and the margins from the limits at or after the release.

        ``seconds`` are lower bounds of the time after the retreat, without the ``lines`` to and from the release.
        """
        del margin, lines
        return np.zeros_like(clearance + seconds)

    def parts(self, placing: Release | None) -> dict[str, float]:
        """The parts of the score with a placing, and their weighted sum as ``score``."""
        del placing
        return {"score": 0.0}


SLACK, SLACK_SECONDS = 1e-8, 1e-6
"""m and s by which bounds without lines are relaxed, more than the errors of distances and of IK solutions."""

DOWN, OFF, TRANSFER = 1, 2, 3
"""Number of possible parts of a place if one part failed."""


@dataclass(frozen=True, eq=False)
class Release:
    """The straight lines from a release q (n,), or the number of possible parts and the reason of the failure.

    ``lift`` and ``leave`` start at the release; they are None if they are not requested. Until the ``transfer`` is
    planned, the full rotations of the lines are not known.
    """

    q: Array
    passed: int = TRANSFER
    why: str = ""
    lift: CubicPath | None = None
    leave: CubicPath | None = None
    parting: Pairs = ()
    proven: float = np.inf
    clearance: float = np.inf
    transfer: JointPath | BlendedPath | None = None

    @property
    def entrance(self) -> Array:
        """(n,) the end of the transfer."""
        return self.q if self.lift is None else self.lift.end

    @property
    def exit(self) -> Array:
        """(n,) the end of the line after the release."""
        return self.q if self.leave is None else self.leave.end

    @property
    def span(self) -> tuple[Array, Array]:
        """Bounds (n,) of every joint on both lines."""
        return span(self.q, self.lift, self.leave)

    def turned(self, by: Array) -> Release:
        """The same with full rotations (n,) added to all configurations."""
        return replace(self, q=self.q + by, lift=shifted(self.lift, by), leave=shifted(self.leave, by))


class _Ahead(NamedTuple):
    """What follows the retreat of a family member, at its m releases."""

    first: Array
    """(k, n) the possible ends of the transfer."""
    down: Array
    """(k, m) lower bound (s) of the time from each of them to each release."""
    after: Array
    """(m,) lower bound (s) of the time from each release to the end."""


class Placer:
    """Plans the place of grasped objects; what does not depend on the attempt is computed once.

    ``seed`` is that of the IK search at the release for arms without a closed form.
    """

    def __init__(self, task: PickTask, seed: int) -> None:
        self.task, self.seed = task, seed
        self.kept: dict[tuple[Hashable, ...], Any] = {}
        self.impossible: dict[str, dict[int, Release]] = {}
        """The releases, by the words of the family member and their index, whose lines are impossible."""

    @once_per_grasp
    def releases(self, member: Member) -> Array:
        """(m, n) the configurations of a family member at the release; empty without a place."""
        task = self.task
        if task.place is None:
            return np.empty((0, task.arm.dof))
        return configurations(task.arm, task.targets([task.release(member)]), task.cell.home, self.seed)[1]

    def rest(self, member: Member, q: Array, exact: bool = True) -> Array:
        """(k,) lower bound (s) of the time from each of q (k, n), after the retreat, to the end; 0 without a place.

        If ``exact``, through the configurations at both ends of the lines, if all of them are known.
        """
        ahead = self._what_is_ahead(member, exact)
        if not len(ahead.first):
            return np.zeros(len(q))
        to_end = (ahead.down + ahead.after).min(axis=1)
        return np.asarray((least_seconds(self.task.arm, q, ahead.first) + to_end).min(axis=1))

    @once_per_grasp
    def _what_is_ahead(self, member: Member, exact: bool) -> _Ahead:
        task, arm, here = self.task, self.task.arm, self.releases(member)
        after, place = np.zeros(len(here)), task.place
        none = np.where(np.eye(len(here), dtype=bool), 0.0, np.inf)
        if place is None or not len(here):
            return _Ahead(here, none, after)
        release = task.release(member)
        if len(behind := every_branch(task, place.after(release), exact and place.retreat > 0)):
            after = least_seconds(arm, here, behind).min(axis=1)
        if len(before := every_branch(task, place.before(release), exact and place.approach > 0)):
            return _Ahead(before, least_seconds(arm, before, here), after)
        return _Ahead(here, none, after)

    @once_per_grasp
    def _clearances(self, member: Member, retreats: bool) -> Array:
        """(m,) the clearances of the empty hand at the releases, which count if it retreats; 0 if in contact."""
        q, free_hand = self.releases(member), self.task.letting_go(member)
        free = free_hand.is_free_batch(q)
        clearances = np.where(free, np.inf, 0.0)
        if retreats:
            clearances[free] = free_hand.clearance_batch(q[free])
        return clearances

    def search(self, attempt: Attempt, seeds: list[int], scores: Scores) -> PlaceSearch:
        """The search for the release of a grasped object that gives the best complete motion.

        ``seeds`` are those of the planner and of the shortening.
        """
        task, member = self.task, attempt.candidate.member
        many = self.releases(member)
        # The releases at which the empty hand is free, in order of the time to them, each with the bound of its score
        all_clearances = self._clearances(member, task.place is not None and task.place.retreat > 0)
        nearest = np.lexsort((least_seconds(task.arm, attempt.exit[None], many)[0], all_clearances == 0.0))
        tried = nearest[: task.cell.budget.configurations]
        ahead = self._what_is_ahead(member, True)
        there = least_seconds(task.arm, attempt.exit[None], ahead.first)[0][:, None] + ahead.down
        seconds = np.maximum(there.min(axis=0, initial=np.inf) + ahead.after - SLACK_SECONDS, 0.0)[tried]
        bounds = scores.bound(all_clearances[tried] + SLACK, seconds, best_margins(task.arm, many)[tried])
        return PlaceSearch(self, attempt, seeds, scores, tried.tolist(), bounds.tolist())

    def place(self, attempt: Attempt, seeds: list[int], scores: Scores) -> tuple[StageResult, Release | None]:
        """The place of a grasped object at the release that gives the best complete motion; see :meth:`search`."""
        if self.task.place is None:
            return StageResult(Stage.PLACE, True, "none requested"), None
        search, best, most = self.search(attempt, seeds, scores), None, -np.inf
        while search.bound > most:
            if (found := search.extend(most)) is not None and (score := scores.parts(found[1])["score"]) > most:
                best, most = found, score
        return (search.failure(), None) if best is None else best

    def may_place(self, member: Member) -> bool:
        """Whether the lines from a release of a family member are possible."""
        task, many = self.task, self.releases(member)
        if task.place is None:
            return True
        free = np.flatnonzero(task.letting_go(member).is_free_batch(many)).tolist() if len(many) else []
        return any(not self.lines(member, index, task.place).why for index in free)

    def cannot_place(self, member: Member) -> bool:
        """Whether the lines of every release of a family member are known to be impossible."""
        impossible = self.impossible.get(member.words, ())
        return len(impossible) > 0 and len(impossible) == len(self.releases(member))

    @once_per_grasp
    def lines(self, member: Member, index: int, place: PlaceTarget) -> Release:
        """The lines of one of the releases."""
        down = release_lines(self.task, place, member, self.releases(member)[index])
        if down.why:
            self.impossible.setdefault(member.words, {})[index] = down
        return down

    def goals(self, attempt: Attempt, down: Release) -> Array:
        """(k, n) the full rotations of the lines of a release within the limits; zero if none are."""
        arm = self.task.arm
        shifts = with_turns(arm, attempt.exit, down.entrance[None])[0] - down.entrance
        inside = shifts[arm.limits.inside(np.array(down.span)[:, None] + shifts).all(axis=0)]
        return inside if len(inside) else shifts[:1]

    def transfer(
        self,
        place: PlaceTarget,
        attempt: Attempt,
        down: Release,
        seeds: list[int],
        shifts: Array | None = None,
        nodes: int | None = None,
    ) -> tuple[StageResult, Release | None]:
        """The transfer from the retreat to the approach of the place, which ends at one of the full rotations.

        ``nodes`` limit the work of the planner; by default, the budget does.
        """
        task, arm = self.task, self.task.arm
        carrying = task.carrying(attempt.candidate.member)
        shifts = np.zeros((1, arm.dof)) if shifts is None else shifts
        # A path with the object, which is shortened unless its orientation is constrained
        planner = planner_of(task.cell.budget.planner).limited_to(nodes or task.cell.budget.nodes)
        goals, constraints = down.entrance + shifts, task.constraints(attempt.candidate.member)
        torques = torque_limits(task, attempt.candidate.member, "transfer", carrying.arm)
        plan = planner.plan(carrying, attempt.exit, goals, constraints=constraints, torque_limits=torques, rng=seeds[0])
        if not plan.ok:
            return _failure(replace(down, why=f"transfer: {plan.message}")), None
        path: JointPath | BlendedPath
        proof: Certificate | None
        if constraints:
            simple = simplify(plan.path, carrying, rng=seeds[1], constraints=constraints, torque_limits=torques)
            path, proof = simple.path, simple.certificate
        else:
            path, proof = shortened(task, plan, carrying, seeds[1], torques)
        # The lines follow at the full rotations at which the transfer ends
        support = f" onto {', '.join(pair[1] for pair in down.parting)}" if down.parting else ""
        upright = f" {constraints[0]}" if constraints else ""
        message = f"transfer of {path.length:.2f} rad{upright}, {place.approach * 1e3:.0f} mm approach{support}, "
        proven, observed = (np.inf, np.inf) if proof is None else (proof.clearance, proof.observed)
        figures = {"length": path.length, "clearance": min(down.proven, proven)}
        placed = replace(down.turned(shifts[plan.goal]), transfer=path, clearance=min(down.clearance, observed))
        return StageResult(Stage.PLACE, True, f"{message}{place.retreat * 1e3:.0f} mm retreat", figures), placed


class PlaceSearch:
    """The branch-and-bound search for the best place after one attempt.

    The release with the highest ``bound`` of its score is extended by one step: its lines, then the transfer.
    """

    def __init__(
        self, placer: Placer, attempt: Attempt, seeds: list[int], scores: Scores, tried: list[int], bounds: list[float]
    ) -> None:
        self._placer, self._attempt, self._seeds, self._scores, self._tried = placer, attempt, seeds, scores, tried
        known = placer.impossible.get(attempt.candidate.member.words, {})
        self._queue: list[tuple[float, int, Release | None]] = [
            (-bound, k, None) for k, bound in enumerate(bounds) if tried[k] not in known
        ]
        heapq.heapify(self._queue)
        self._without_lines = {k: _failure(known[index]) for k, index in enumerate(tried) if index in known}
        self._without_transfer: list[StageResult] = []
        self.succeeded = False

    def __len__(self) -> int:
        return len(self._queue)

    @property
    def bound(self) -> float:
        """Upper bound of the scores of the releases that are left; minus infinity without any."""
        return -self._queue[0][0] if self._queue else -np.inf

    @step(Stage.PLACE.value)
    def extend(self, least: float = -np.inf) -> tuple[StageResult, Release] | None:
        """Extend a release; the place, if it is complete. Scores below ``least`` are not wanted."""
        _, order, down = heapq.heappop(self._queue)
        placer, attempt = self._placer, self._attempt
        member, place = attempt.candidate.member, placer.task.place
        if place is None:
            return None
        if down is None:
            down = placer.lines(member, self._tried[order], place)
            if down.why:
                self._without_lines[order] = _failure(down)
            else:
                heapq.heappush(self._queue, (-float(self._bounds(down)[1].max()), order, down))
            return None
        # A transfer that must be better than a known one is short, and is found soon or not at all
        nodes = placer.task.cell.budget.quick_nodes if least > -np.inf else None
        shifts, bounds = self._bounds(down)
        result, placing = placer.transfer(place, attempt, down, self._seeds, shifts[bounds >= least], nodes)
        if placing is None:
            self._without_transfer.append(result)
            return None
        self.succeeded = True
        return result, placing

    def _bounds(self, down: Release) -> tuple[Array, Array]:
        """The full rotations (k, n) of the lines of a release, and the bounds (k,) of the scores with them."""
        arm, shifts = self._placer.task.arm, self._placer.goals(self._attempt, down)
        low, high = down.span
        seconds = least_times(down.entrance + shifts - self._attempt.exit, arm.limits, full_speed=True)
        margins = limit_margin(arm, low + shifts, high + shifts)
        return shifts, self._scores.bound(down.clearance, seconds, margins, down.lift, down.leave)

    def failure(self) -> StageResult:
        """Why no release is possible: the reason of the one with the most possible parts."""
        task, member = self._placer.task, self._attempt.candidate.member
        failed = (*(self._without_lines[order] for order in sorted(self._without_lines)), *self._without_transfer)
        if not failed:
            target = task.target(task.release(member))
            return out_of_reach(task, Stage.PLACE, target, self._placer.seed, "the release is out of reach", "it")
        farthest = max(failed, key=lambda result: result.figures["passed"])
        if (count := len(self._placer.releases(member))) > 1:
            message = f"{farthest.message}; {len(self._tried)} of {count} IK solutions at the release were tried"
            farthest = replace(farthest, message=message)
        return farthest


def _failure(down: Release) -> StageResult:
    return StageResult(Stage.PLACE, False, down.why, {"passed": float(down.passed)})


def release_lines(task: PickTask, place: PlaceTarget, member: Member, q: Array) -> Release:
    """The approach to a release q (n,), and the retreat from it with the empty hand."""
    release = task.release(member)
    carrying, free_hand = task.carrying(member), task.letting_go(member)
    if not free_hand.is_free(q):
        return Release(q, 0, f"at the release: {'; '.join(contact_words(free_hand.check(q)))}")
    # The approach with the object, planned from the release outwards; in a trial, the reason of a failure is not wanted
    parting, planned = task.supports(carrying, q, place.support), partial(line, Stage.PLACE, task, start="the release")
    least = 0.0 if task.cell.trial is None else 1.0
    down = planned(carrying, q, place.before(release), place.approach, parting, least=least)
    if not down.result.ok:
        return Release(q, DOWN, f"approach to the place: {down.result.message}")
    if task.cell.fingers and not (opening := task.opening(member)).is_free(q):
        return Release(q, OFF, f"at the release: {closing_words(task, member, opening.check(q))}")
    # The retreat of the empty hand
    hand, end = task.passing(member, placed=True), place.after(release)
    leave = planned(free_hand, q, end, place.retreat, hand=hand, least=least)
    if not leave.result.ok:
        return Release(q, OFF, f"retreat from the place: {leave.result.message}")
    proven = min(each.result.figures.get("clearance", np.inf) for each in (down, leave))
    clearance = min(down.clearance, leave.clearance)
    return Release(q, TRANSFER, "", down.path, leave.path, parting, proven, clearance)
