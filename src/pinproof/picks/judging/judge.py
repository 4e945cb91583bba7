r"""The verdict on one pick, stage by stage, and the best motion by branch and bound; see :class:`pinproof.picks.Stage`.

The grasps of a family are judged in groups of equal distance from the nominal grasp. The IK solutions of all grasps of
a group are checked together, and the best motion is searched among those that pass. If no motion exists, the verdict
describes the attempt that passed the most stages.

The score of a complete motion is the weighted sum of four parts from 0 to 1: the smallest clearance observed on the
motion, the smallest distance of a joint from its limits, the manipulability at the grasp, and the duration part

.. math:: \frac{T_0 + c}{T + c}

where T is the time of the motion at full speed, without stops at corners, and c is a constant. T_0 is a lower bound of
that time over all configurations at the grasp, so the score of one does not depend on which others were planned.

A part of the motion bounds the score from above: its clearance and its distance from limits are at least those of the
complete motion, and a motion takes at least the time of the joint with the longest travel, from home to the start of
the approach, to the grasp, to the end of the retreat, and to the release. Where the closed form gives every
configuration at these poses, the motion passes through one of them; otherwise only the grasp is used.

The search expands the candidate with the highest bound: first the configuration at the grasp, then its two lines at
each of their full rotations, then the transit, then the lines of each release, then the transfer to it, at the full
rotations that can still be the best. It stops when no bound exceeds the best score of a complete motion, so that the
result is the same as if all candidates had been planned, or when the budget of complete motions is exhausted.

Source of the search: A. Land, A. Doig (1960), "An automatic method of solving discrete programming problems",
Econometrica 28(3).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from itertools import compress
from typing import NamedTuple

import numpy as np

from pinproof.collision import LineSurface, Obstacle, Scene
from pinproof.common.results import Answer, Rows, View
from pinproof.common.structs import described, key
from pinproof.common.validation import require_type
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import JointGroup, Payload
from pinproof.motion import ContactPatch, CubicPath, HoldLimits, HoldPeak, JointPath, Trajectory, least_times
from pinproof.picks.input.pick import Member, Pick
from pinproof.picks.input.picks import Picks
from pinproof.picks.input.tools import Hand, Tool
from pinproof.picks.judging.configurations import REDUNDANT, at_full_speed, best_margins, least_seconds, limit_margin
from pinproof.picks.judging.conveyor import VALID, judge_on_conveyor, on_conveyor
from pinproof.picks.judging.grasp import (
    NO_SOLUTION,
    GraspCandidate,
    every_branch,
    every_branch_is_known,
    reach,
    reach_between,
    reasons_against_every_branch,
    reasons_at_release,
    reasons_by_contact,
    score_parts,
    screen,
)
from pinproof.picks.judging.grip import GripResult
from pinproof.picks.judging.hold import contacts_of, hold_data_missing, with_inertia
from pinproof.picks.judging.lines import (
    Attempt,
    Crossing,
    along,
    control_points,
    full_rotations,
    may_approach,
    transit,
)
from pinproof.picks.judging.place import Placer, PlaceSearch, Release, Scores
from pinproof.picks.judging.suggest import suggest
from pinproof.picks.judging.task import PickCell, PickTask, check_held_joints, checker_of_picks
from pinproof.picks.judging.timing import time_motion
from pinproof.picks.judging.verdict import PickStatus, PickVerdict, Stage, StageResult, grasp_failure
from pinproof.spatial import SE3, Array, rigid

MANY = 64
"""Largest number of grasps for which the ends of the lines are solved to obtain tighter bounds of the time."""


@dataclass(frozen=True, eq=False)
class Scoring:
    """The scores of complete motions from given configurations.

    ``bounds`` (k,) are upper bounds of the score from each configuration, at any full rotations; ``least`` is T_0 (s).
    """

    task: PickTask
    bounds: Array
    least: float

    @classmethod
    def of(
        cls, task: PickTask, candidates: tuple[GraspCandidate, ...], rest: Callable[[Member, Array, bool], Array]
    ) -> Scoring:
        """The scoring for the given configurations; ``rest`` is :meth:`Placer.rest`."""
        arm, pick, home = task.arm, task.pick, task.cell.home[None]
        every = np.array([candidate.q for candidate in candidates]).reshape(-1, arm.dof)
        if task.cell.trial is not None:  # any complete motion is sufficient, so the order is that of the candidates
            least = float(least_seconds(arm, home, every).min(initial=np.inf))
            return cls(task, -np.arange(len(candidates), dtype=float), least)
        members: dict[str, list[int]] = {}
        for i, candidate in enumerate(candidates):
            members.setdefault(candidate.member.words, []).append(i)
        exact = len(members) <= MANY and task.cell.closed_form
        # Lower bounds of the time of a complete motion, through the configurations at the ends of the lines if known
        seconds = np.empty(len(candidates))
        for own in members.values():
            q, member = every[own], candidates[own[0]].member
            grasp = task.grasp(member)
            before = every_branch(task, pick.before(grasp), exact and pick.approach > 0)
            after = every_branch(task, pick.after(grasp), exact and pick.retreat > 0)
            into = least_seconds(arm, home, q)[0]
            if len(before):
                into = (least_seconds(arm, home, before) + least_seconds(arm, q, before)).min(axis=1)
            if len(after):
                seconds[own] = into + (least_seconds(arm, q, after) + rest(member, after, exact)).min(axis=1)
            else:
                seconds[own] = into + rest(member, q, exact)
        margins = best_margins(arm, every)
        # Upper bounds of the score; the manipulability is that of the configuration
        clearances = np.array([candidate.clearance for candidate in candidates])
        volumes = np.array([candidate.manipulability for candidate in candidates])
        least = float(seconds.min(initial=np.inf))
        parts = score_parts(task.cell.weights, least, clearances, margins, volumes, seconds)
        return cls(task, parts["score"], least)

    def parts(
        self, clearance: Array | float, margin: Array | float, manipulability: float, seconds: Array | float
    ) -> dict[str, Array]:
        """The four parts (0 to 1), and their weighted sum as ``score``."""
        return score_parts(self.task.cell.weights, self.least, clearance, margin, manipulability, seconds)


Key = tuple[float, int, int]
"""The order of the search: minus the bound, then the index of the configuration, then of the full rotations."""


@dataclass(frozen=True, eq=False)
class CompleteMotion:
    """A complete motion that passed every stage before the timing, with the parts of its score."""

    attempt: Attempt
    stages: tuple[StageResult, ...]
    path: JointPath
    placing: Release | None
    parts: dict[str, float]
    key: Key


class _OpenAttempt(NamedTuple):
    """An attempt that can be extended to a complete motion, at full rotations ``shift`` (n,); keys are unique."""

    key: Key
    attempt: Attempt
    shift: Array
    crossing: Crossing | None = None
    scores: _Completions | None = None
    place: PlaceSearch | None = None

    @property
    def candidates(self) -> int:
        """The number of complete motions to which it can be extended: one for each release."""
        return 1 if self.place is None else len(self.place)


class BestFirst:
    """The branch-and-bound search for the best motion through one of the configurations at the grasp.

    ``seeds`` are those of the planner and of the shortening. Unless ``bounded``, all motions within the budget are
    planned, not only those whose bound exceeds the best score.
    """

    def __init__(
        self, task: PickTask, candidates: tuple[GraspCandidate, ...], seeds: list[int], *, bounded: bool = True
    ) -> None:
        self._task, self._budget, self._seeds, self._bounded = task, task.cell.budget, seeds, bounded
        self._candidates, self._placer = candidates, Placer(task, seeds[0])
        self._scoring = Scoring.of(task, candidates, self._placer.rest)
        self._order = np.argsort(-self._scoring.bounds, kind="stable").tolist()
        self._next = 0
        self._open: list[_OpenAttempt] = []
        self._stuck: set[int] = set()
        self.attempts: list[Attempt] = []
        """The attempts: one for each configuration whose lines were planned."""
        self.motions: list[CompleteMotion] = []
        """The complete motions that are not rejected."""
        self.made = 0
        """The number of complete motions, rejected ones included."""
        self.failed: list[tuple[StageResult, ...]] = []
        """The stages of attempts whose lines are possible but which cannot be completed."""

    @property
    def best(self) -> CompleteMotion | None:
        """The best complete motion."""
        return min(self.motions, key=lambda motion: motion.key, default=None)

    def left(self, best: CompleteMotion) -> tuple[int, int]:
        """Numbers of configurations and full rotations that were not completed.

        They are those whose bound does not exceed the best score, and those that could be better but were not tried
        within the budget.
        """
        left = [((-float(self._scoring.bounds[index]), index, 0), 1) for index in self._order[self._next :]]
        left += [(each.key, each.candidates) for each in self._open if each.key[1] not in self._stuck]
        excluded = sum(count for key, count in left if key > best.key)
        return excluded, sum(count for _, count in left) - excluded

    def run(self) -> CompleteMotion | None:
        """The best complete motion; None if none was found within the budget."""
        while self.made < self._budget.compared:
            # The next step: the best open attempt, or a configuration whose lines are not planned yet. In a trial, any
            # complete motion is sufficient, so open attempts come first
            while self._open and self._is_hopeless(self._open[0].key[1]):
                heapq.heappop(self._open)
            while self._next < len(self._order) and self._is_hopeless(self._order[self._next]):
                self._next += 1
            key, best = self._open[0].key if self._open else None, self.best
            more = self._next < len(self._order) and len(self.attempts) < self._budget.configurations
            if more and (key is None or self._task.cell.trial is None):
                index = self._order[self._next]
                key = min(filter(None, (key, (-float(self._scoring.bounds[index]), index, -1))))
            if key is None or (self._bounded and best is not None and key > best.key):
                break
            if not self._open or key != self._open[0].key:
                self._lines()
                continue
            # The transit of the open attempt or, after it, one step of the search for its place
            here = heapq.heappop(self._open)
            if here.crossing is None:
                moved = here.attempt.turned(here.shift)
                left = self._crossed(here, transit(self._task, [moved], self._budget.quick_nodes, self._seeds))
            else:
                left = self._placed(here)
            if left is not None:
                heapq.heappush(self._open, left)
        return self.best

    def may_place(self) -> bool:
        """Whether a release of a grasp is possible, which does not depend on how the object is brought there."""
        members = {candidate.member.words: candidate.member for candidate in self._candidates}
        return any(self._placer.may_place(member) for member in members.values())

    def reject(self, motion: CompleteMotion, stages: tuple[StageResult, ...]) -> None:
        """Remove a motion that failed a later stage."""
        self.motions.remove(motion)
        self.failed.append(stages)

    def with_full_budget(self) -> CompleteMotion | None:
        """A motion to any attempt with possible lines, planned with the larger budget; None if none was found."""
        while self._next < len(self._order) and len(self.attempts) < self._budget.configurations:
            self._lines()
        passed = [attempt for attempt in self.attempts if attempt.passed]
        if not passed or any(stages[-1].stage is not Stage.TRANSIT for stages in self.failed):
            return None
        arm, home = self._task.arm, self._task.cell.home
        every = [attempt.turned(shift) for attempt in passed for shift in full_rotations(arm, home, attempt)]
        crossing = transit(self._task, every, self._budget.nodes, self._seeds)
        if crossing.attempt is None:
            self.failed.append((*passed[0].stages, crossing.result))
            return None
        left = self._crossed(_OpenAttempt((0.0, 0, 0), crossing.attempt, np.zeros(arm.dof)), crossing)
        while left is not None and (self.best is None or left.key < self.best.key):
            left = self._placed(left)
        return self.best

    def _lines(self) -> None:
        """Plan the lines of the next configuration, and bound the scores at all its full rotations."""
        task, index = self._task, self._order[self._next]
        self._next += 1
        tried = ((len(each.stages), 1.0 if each.passed else each.fraction) for each in self.attempts)
        attempt = along(task, self._candidates[index], max(tried, default=(1, 0.0)))
        self.attempts.append(attempt)
        if not attempt.passed:
            return
        # A complete motion is at most as good as its lines, at any full rotations within the limits
        arm, (low, high) = task.arm, attempt.span
        shifts = full_rotations(arm, task.cell.home, attempt)
        distance = attempt.entrance + shifts - task.cell.home
        after = float(self._placer.rest(attempt.candidate.member, attempt.exit[None])[0])
        seconds = least_times(distance, arm.limits, full_speed=True) + after
        seconds += sum(at_full_speed(arm, each) for each in control_points(arm.dof, attempt.approach, attempt.retreat))
        margins = limit_margin(arm, low + shifts, high + shifts)
        clearance = min(attempt.candidate.clearance, attempt.clearance)
        bounds = self._scoring.parts(clearance, margins, attempt.candidate.manipulability, seconds)["score"]
        for k, (score, shift) in enumerate(zip(bounds.tolist(), shifts, strict=True)):
            heapq.heappush(self._open, _OpenAttempt((-score, index, k), attempt, shift))

    def _crossed(self, here: _OpenAttempt, crossing: Crossing) -> _OpenAttempt | None:
        """An attempt after its transit, ready for the search of the place; None if that completes or ends it."""
        if crossing.attempt is None:
            self._stop(here.key, (*here.attempt.stages, crossing.result))
            return None
        scores = _Completions(self._scoring, crossing.attempt, crossing)
        here = here._replace(attempt=crossing.attempt, crossing=crossing, scores=scores)
        if self._task.place is None:
            self._complete(here, StageResult(Stage.PLACE, True, "none requested"), None)
            return None
        return self._with_bound(here._replace(place=self._placer.search(crossing.attempt, self._seeds, scores)))

    def _placed(self, here: _OpenAttempt) -> _OpenAttempt | None:
        """An attempt after one step of the search for its place; None if nothing is left of it."""
        best = self.best if self._bounded else None
        if here.place is not None and (placed := here.place.extend(-np.inf if best is None else -best.key[0])):
            self._complete(here, *placed)
        return self._with_bound(here)

    def _with_bound(self, here: _OpenAttempt) -> _OpenAttempt | None:
        """An attempt with the bound of its place; None if no release is left, which is a failure if none was good."""
        if here.place is not None and len(here.place):
            return here._replace(key=(-here.place.bound, *here.key[1:]))
        if here.place is not None and here.crossing is not None and not here.place.succeeded:
            self._stop(here.key, (*here.attempt.stages, here.crossing.result, here.place.failure()))
        return None

    def _complete(self, here: _OpenAttempt, placed: StageResult, placing: Release | None) -> None:
        """Add a complete motion."""
        if here.crossing is None or here.crossing.path is None or here.scores is None:
            return
        parts, stages = here.scores.parts(placing), (*here.attempt.stages, here.crossing.result, placed)
        key = (-parts["score"], *here.key[1:])
        self.motions.append(CompleteMotion(here.attempt, stages, here.crossing.path, placing, parts, key))
        self.made += 1

    def _is_hopeless(self, index: int) -> bool:
        """Whether no motion through a configuration is possible, which is known from others."""
        return index in self._stuck or self._placer.cannot_place(self._candidates[index].member)

    def _stop(self, key: Key, stages: tuple[StageResult, ...]) -> None:
        """Record a failure, which also excludes the other full rotations of the attempt."""
        self._stuck.add(key[1])
        self.failed.append(stages)


class _Completions(Scores):
    """The :class:`Scores` of the motions with one crossing and the lines of its attempt."""

    def __init__(self, scoring: Scoring, attempt: Attempt, crossing: Crossing) -> None:
        self._scoring, self._arm = scoring, scoring.task.arm
        self._manipulability = attempt.candidate.manipulability
        self._clearance = min(attempt.candidate.clearance, attempt.clearance, crossing.clearance)
        curves = crossing.path, attempt.approach, attempt.retreat
        points = [attempt.q[None], *control_points(self._arm.dof, *curves)]
        self._seconds = sum(at_full_speed(self._arm, each) for each in points)
        self._low, self._high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
        self._margin = limit_margin(self._arm, self._low, self._high)

    def bound(self, clearance: Array | float, seconds: Array, margin: Array, *lines: CubicPath | None) -> Array:
        seconds = seconds + sum(at_full_speed(self._arm, each) for each in control_points(self._arm.dof, *lines))
        clearance, seconds = np.minimum(clearance, self._clearance), seconds + self._seconds
        return self._scoring.parts(clearance, np.minimum(margin, self._margin), self._manipulability, seconds)["score"]

    def parts(self, placing: Release | None) -> dict[str, float]:
        """The parts of the score of the complete motion."""
        clearance, margin, seconds = self._clearance, self._margin, self._seconds
        if placing is not None:
            points = [*control_points(self._arm.dof, placing.transfer, placing.lift, placing.leave)]
            for each in points:
                seconds += at_full_speed(self._arm, each)
            every = np.vstack([self._low, self._high, *points])
            margin = limit_margin(self._arm, every.min(axis=0), every.max(axis=0))
            clearance = min(clearance, placing.clearance)
        parts = self._scoring.parts(clearance, margin, self._manipulability, seconds)
        return {name: float(part) for name, part in parts.items()}


# -- the stages -------------------------------------------------------------------------------------------------------


Judged = tuple[PickVerdict, Attempt | None]
"""The verdict on a group of grasps, and the attempt that passed the most stages if a line failed."""


def judge(pick: Pick, cell: PickCell, rng: np.random.Generator) -> PickVerdict:
    """The verdict on one pick in a cell: that of the first of its grasps that is good, else of the furthest one."""
    seeds = rng.integers(2**31, size=4).tolist()
    alone = judge_on_conveyor if on_conveyor(pick, cell) else _judge
    try:
        grasps = cell.shared.grasps_of(pick)
    except InputError as error:
        return _unreadable(pick, error)
    if not grasps:
        return _unreadable(pick, InputError(f"part {pick.part!r} states no grasps; add some, or a pose to the pick"))
    proposed = pick.by_part and cell.shared.parts[str(pick.part)].proposed
    if len(grasps) == 1 and not proposed:
        return alone(grasps[0], cell, seeds)
    # The grasps of the part in their order, without suggestions for those that fail. Of proposals, which are many, only
    # those with a configuration that is free at the nominal grasp are judged, at first without the reasons of a failure
    first = cell.without_remedies
    if proposed:
        first = cell.for_trials(Stage.REACH)
        tasks = () if on_conveyor(pick, cell) else (PickTask(grasp, first) for grasp in grasps)
        reached = ((task, reach(task, task.nearest_group, seeds[0]).q) for task in tasks)
        likely = [
            grasp for grasp, (task, q) in zip(grasps, reached, strict=False) if task.at_grasp.is_free_batch(q).any()
        ]
        grasps = tuple(likely) or grasps[:UNLIKELY]
    tried: list[PickVerdict] = []
    for grasp in grasps:
        verdict = alone(grasp, first, seeds)
        if verdict.ok and proposed:
            verdict = alone(grasp, cell.without_remedies, seeds)
        if verdict.ok:
            return replace(verdict, grasps_failed=tuple(map(grasp_failure, tried)))
        tried.append(verdict)
    # No grasp is good: the furthest one, with suggestions; impossible only if every grasp is, and no others exist
    furthest = max(tried, key=lambda found: len(found.stages))
    verdict = alone(furthest.pick, cell, seeds) if cell.budget.remedies else furthest
    refuted = not proposed and all(found.status is PickStatus.IMPOSSIBLE for found in tried)
    if not refuted and verdict.status is PickStatus.IMPOSSIBLE:
        verdict = replace(verdict, status=PickStatus.NOT_FOUND, refuted=())
    return replace(verdict, grasps_failed=tuple(grasp_failure(found) for found in tried if found is not furthest))


UNLIKELY = 12
"""Number of proposed grasps that are judged if none has a configuration that is free of contact."""


def _unreadable(pick: Pick, error: InputError) -> PickVerdict:
    return PickVerdict(pick, PickStatus.UNREADABLE, (StageResult(Stage.INPUT, False, str(error)),))


def _judge(pick: Pick, cell: PickCell, seeds: list[int]) -> PickVerdict:
    try:
        task = PickTask(pick, cell)
    except InputError as error:
        return _unreadable(pick, error)
    # Group by group, in order of the distance from the nominal grasp
    tried, members, judged = 0, 0, list[Judged]()
    for group in task.groups():
        judged.append(_judge_group(task, group, seeds))
        verdict, _ = judged[-1]
        tried, members = tried + verdict.configurations, members + len(group)
        if verdict.ok:
            return replace(verdict, pick=pick, configurations=tried)
    # No group is good: the verdict is that of the group that passed the most stages
    verdict, attempt = max(judged, key=lambda found: len(found[0].stages))
    status, message = verdict.status, verdict.reason
    if task.sampled:  # of a range or a tolerance, the grasps between the samples are not refuted
        status, message = PickStatus.NOT_FOUND, f"{message}; {members} grasps were tried"
    if cell.trial is None and (hint := task.frame_hint()):
        message = f"{message}; {hint}"
    # Changed picks are judged in the same way, without suggestions of their own
    failed = replace(verdict.stages[-1], message=message)
    suggestions = suggest(
        task, pick, failed, attempt, lambda other, stage: _judge(other, cell.for_trials(stage), seeds)
    )
    return replace(
        verdict,
        pick=pick,
        status=status,
        stages=(*verdict.stages[:-1], failed),
        configurations=tried,
        refuted=verdict.refuted if status is PickStatus.IMPOSSIBLE else (),
        suggestions=suggestions,
    )


def _judge_group(task: PickTask, group: list[Member], seeds: list[int]) -> Judged:
    """The verdict on a group of grasps with equal displacement from the nominal grasp."""
    # In a trial in which a failed grip does not count, the hand is closed first: this needs no configuration
    trial = task.cell.trial
    grip_first = trial is not None and task.name is not None and not Stage.GRIP.is_later_than(trial)
    if grip_first and not any(task.grip(member).held for member in group):
        return _not_good(task, (VALID, StageResult(Stage.GRIP, False, "no grasp holds the part")), 0)
    # Reach and limits
    reached = reach(task, group, seeds[0])
    if not len(reached.q):
        return _not_good(task, (VALID, *reached.stages), 0, reached.refuted)
    # Contacts and grip
    screened = screen(task, group, reached)
    failed = task.arm.dof == REDUNDANT and not screened.candidates and not screened.not_held and not trial
    if failed and (between := reach_between(task, group, reached)) is not None:
        reached, screened = between, screen(task, group, between)
    stages, tried = (VALID, *reached.stages, *screened.stages), len(reached.q)
    candidates = screened.candidates
    if candidates and trial is not None:
        # In a trial, the reasons of failures are not wanted, so one call sorts out most configurations
        candidates = tuple(compress(candidates, may_approach(task, candidates).tolist()))
        if not candidates:
            return _not_good(task, (*stages, StageResult(Stage.APPROACH, False, "no straight line exists")), tried)
    if candidates:
        return _search(task, group, candidates, stages, tried, seeds)
    if screened.not_held:
        return _not_good(task, stages, tried, screened.refuted)
    if stages[-1].stage is Stage.CHECK:  # a check of the user refutes the configurations that it saw, and no others
        return _not_good(task, stages, tried)
    if stages[-1].stage is not Stage.GRIP:
        # A configuration may be in contact only between convex hulls of meshes, so finer bodies are used. All are
        # checked if they can prove that the pick is impossible, otherwise only the first ones
        for q in reached.q[: task.cell.budget.configurations] if task.sampled else reached.q:
            finer = task.at_grasp.finer_at(q)
            if finer is not task.at_grasp and finer.is_free(q):
                cell = replace(task.cell, checker=task.outside.finer_at(q))
                return _judge_group(PickTask(task.pick, cell), group, seeds)
    # Is every configuration refuted?
    refuted: tuple[str, ...] = ()
    if every_branch_is_known(task, [task.target(task.grasp(member)) for member in group]):
        reachable = set(reached.member.tolist())
        others = (member for i, member in enumerate(group) if i not in reachable)
        refuted = (*screened.refuted, *(f"{member.head}{NO_SOLUTION} the grasp" for member in others))
    elif stages[-1].stage in (Stage.SELF, Stage.GRASP) and not trial:
        refuted = reasons_by_contact(task, group, reached)
    if not refuted:
        message = f"{stages[-1].message}; more IK solutions may exist ({tried} tried)"
        stages = (*stages[:-1], replace(stages[-1], message=message))
    return _not_good(task, stages, tried, refuted)


def _not_good(
    task: PickTask,
    stages: tuple[StageResult, ...],
    tried: int,
    refuted: tuple[str, ...] = (),
    attempt: Attempt | None = None,
) -> Judged:
    """The verdict on a group without a motion: impossible if every configuration is refuted."""
    status = PickStatus.IMPOSSIBLE if refuted else PickStatus.NOT_FOUND
    return PickVerdict(task.pick, status, stages, tried, refuted=refuted), attempt


def _search(
    task: PickTask,
    group: list[Member],
    candidates: tuple[GraspCandidate, ...],
    stages: tuple[StageResult, ...],
    tried: int,
    seeds: list[int],
) -> Judged:
    """The verdict on a group with collision-free configurations, by the best motion through one of them."""
    # For a suggestion about the place, it is sufficient that a release is possible
    search, trial = BestFirst(task, candidates, seeds[1:3]), task.cell.trial
    if trial is not None and not Stage.PLACE.is_later_than(trial) and not search.may_place():
        unplaced = StageResult(Stage.PLACE, False, "no IK solution at the release is collision-free with its lines")
        return _not_good(task, (*stages, unplaced), tried)
    # The best motion that can be timed
    while (motion := search.run() or search.with_full_budget()) is not None:
        timed = time_motion(task, motion.attempt, motion.path, motion.placing)
        if isinstance(timed, StageResult):
            search.reject(motion, (*motion.stages, timed))
            continue
        # Good: the last stage states the number of candidates that it was compared to, planned or excluded by a bound
        *held, result = timed.stages
        excluded, untried = search.left(motion)
        counts = {"complete": search.made, "excluded": excluded, "untried": untried}
        compared = search.made + excluded
        notes = [f"best of {compared} candidates"] if compared > 1 else []
        notes += [f"{untried} more not tried within the budget"] if untried else []
        figures = {**result.figures, **{name: float(count) for name, count in counts.items()}}
        result = replace(result, message="; ".join([result.message, *notes]), figures=figures)
        every = (*stages, *motion.stages, *held, result)
        return replace(timed, stages=every, configurations=tried, score=motion.parts), None
    # No motion is complete: the reason is that of the attempt that passed the most stages
    if search.failed:
        farthest = max(reversed(search.failed), key=len)
        placing = farthest[-1].stage is Stage.PLACE and not trial
        refuted = reasons_at_release(task, group, seeds[0]) if placing else ()
        return _not_good(task, (*stages, *farthest), tried, refuted)
    # No line is possible
    best = max(search.attempts, key=lambda attempt: (len(attempt.stages), attempt.fraction))
    refuted = () if trial is not None else reasons_against_every_branch(task, group, seeds[0])
    last = best.stages[-1]
    if not refuted:
        tries = f"; {len(search.attempts)} of {len(candidates)} collision-free IK solutions were tried"
        last = replace(last, message=last.message + tries)
    return _not_good(task, (*stages, *best.stages[:-1], last), tried, refuted, best)


# -- several hands -----------------------------------------------------------------------------------------------------


@described(eq=False)
class HandsResult(Answer):
    """Whether every hand holds the part; result of :func:`judge_hands`."""

    grips: dict[str, GripResult] = key("the grip of each arm, by its name")
    limits: HoldLimits | None = key(
        "the limits of motions of the group by all grips together, with a payload and if every hand holds the part: a "
        "rate limit of :func:`pinproof.planning.plan_carry`",
        default=None,
    )
    hold: HoldPeak | None = key("the largest load of the motion that was judged", default=None)

    @property
    def ok(self) -> bool:
        """Whether all hands hold the part, also in the motion that was judged."""
        return all(grip.held for grip in self.grips.values()) and (self.hold is None or self.hold.holds)

    @property
    def message(self) -> str:
        """The reason of each hand that does not hold the part, or what all hands touch and whether they carry it."""
        every = all(grip.held for grip in self.grips.values())
        shown = [f"{name}: {grip.message}" for name, grip in self.grips.items() if every or not grip.held]
        return "; ".join(shown if self.hold is None else [*shown, f"the part {self.hold}"])

    def _view(self) -> View:
        rows = [(name, "holds" if grip.held else "does not hold", grip.message) for name, grip in self.grips.items()]
        return View(self.message, [Rows(("arm", "grip", "reason"), rows)])


def judge_hands(
    group: JointGroup,
    part: Obstacle,
    grasps: Mapping[str, SE3],
    tools: Mapping[str, Tool],
    *,
    payload: Payload | None = None,
    motion: Trajectory | None = None,
) -> HandsResult:
    """Judge for each arm of a joint group whether its hand holds a part, by the criteria of the grip of a pick.

    A motion of these arms with the part is planned by :func:`pinproof.planning.plan_carry`. With a payload, the hands
    must also carry the part in a motion: at every instant, between samples too, forces at the contacts of all hands
    must exist that give the part its acceleration and carry its weight.

    Parameters
    ----------
    group
        The joint group; fingers that are links are those of its robots.
    part
        The part, with its pose in the frame of the part.
    grasps
        ``tcp_from_part`` of each arm that holds it.
    tools
        The tool of each of these arms, with the criteria of its grip. Without fingers and cup, the tip must be at the
        surface of the part. With a payload, each states its force.
    payload
        Mass, centre of mass and inertia of the part, in the frame of the part; by default, the inertia is that of a
        uniform density.
    motion
        A motion of the group with the part; it needs the payload. The part moves with the first of these arms.

    Raises
    ------
    UnknownNameError
        If the group has no arm of a name.
    InputError
        If no arm is named, an arm has no tool, or a tool does not fit its robot; if there is a motion but no payload,
        a payload but no force of a tool, or the contacts do not resist loads in every direction.
    """
    require_type("part", part, Obstacle)
    require_type("grasps", grasps, Mapping)
    require_type("tools", tools, Mapping)
    if not grasps:
        raise InputError("grasps names no arm; state tcp_from_part of each arm that holds the part")
    if motion is not None and payload is None:
        raise InputError("the motion needs the payload: whether the hands carry the part depends on its mass")
    leader, leader_from_part = next((name, rigid(f"grasps[{name!r}]", pose)) for name, pose in grasps.items())
    grips, contacts = {}, list[ContactPatch]()
    for name, given in grasps.items():
        if name not in group.ends:
            raise UnknownNameError("arm", name, group.ends, "grasps")
        if name not in tools:
            raise InputError(f"arm {name!r} has no tool; tools must state one for each of {', '.join(grasps)}")
        # A pick of the part by this arm alone, without a scene: the grip does not depend on where the part is
        tool, tcp_from_part = tools[name], rigid(f"grasps[{name!r}]", given)
        require_type(f"tools[{name!r}]", tool, Tool)
        in_hand = replace(part, pose=tool.tip.actInv(tcp_from_part * part.pose))
        shared = Picks([], **{own.name: getattr(tool, own.name) for own in fields(Hand)})
        arm = group.arms[name].with_held(tool.held)
        check_held_joints(arm, shared)
        cell = PickCell(checker_of_picks(arm, Scene(), shared), shared, arm.home)
        task = PickTask(Pick(part.name, tcp_from_part.actInv(tool.tip), carried=in_hand, payload=payload), cell)
        grips[name] = task.grip(task.nearest_group[0])
        if payload is not None and (missing := hold_data_missing(task.pick, shared)):
            raise InputError(f"tools[{name!r}] does not state {' and '.join(missing)}")
        # The contacts of all hands in the frame of the first, which the part follows
        if grips[name].held:
            own = contacts_of(shared, grips[name], part.name) if payload is not None else []
            contacts += [patch.placed(leader_from_part * tcp_from_part.inverse()) for patch in own]
    if payload is None or not all(grip.held for grip in grips.values()):
        return HandsResult(grips)
    body = with_inertia(payload.placed(part.pose.inverse()), LineSurface.of_obstacle(part))
    body = replace(body.placed(leader_from_part * part.pose), frame=group.tcp_of(leader))
    limits = HoldLimits(group, body, contacts)
    return HandsResult(grips, limits, None if motion is None else limits.peak(motion))
