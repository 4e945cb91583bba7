"""The verdict on one pick, stage by stage; see :class:`pinproof.picks.Stage`.

The grasps of a family are judged in groups of equal distance from the nominal grasp. The IK solutions of all grasps of
a group are checked together, and the best motion is searched among those that pass
(:mod:`pinproof.picks.judging.search`). If no motion exists, the verdict describes the attempt that passed the most
stages.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pinproof.errors import InputError
from pinproof.picks.input.pick import Member, Pick
from pinproof.picks.judging.configurations import REDUNDANT
from pinproof.picks.judging.grasp import (
    GraspCandidate,
    Reached,
    every_branch_is_known,
    reach,
    reach_between,
    refuted_at_release,
    refuted_by_contacts,
    refuted_by_name,
    screen,
    unreached,
)
from pinproof.picks.judging.intercept import VALID, judge_on_conveyor, on_conveyor
from pinproof.picks.judging.lines import Attempt
from pinproof.picks.judging.search import BestFirst, CompleteMotion
from pinproof.picks.judging.suggest import suggest
from pinproof.picks.judging.task import PickCell, PickTask
from pinproof.picks.judging.timing import TimedPart, time_motion
from pinproof.picks.judging.verdict import PickStatus, PickVerdict, Stage, StageResult


class _GroupVerdict(NamedTuple):
    """The verdict on a group of grasps, and the attempt that passed the most stages if a line failed."""

    verdict: PickVerdict
    attempt: Attempt | None = None


def judge(pick: Pick, cell: PickCell, rng: np.random.Generator) -> PickVerdict:
    """The verdict on one pick in a cell."""
    seeds = rng.integers(2**31, size=4).tolist()
    return judge_on_conveyor(pick, cell, seeds) if on_conveyor(pick, cell) else _judge(pick, cell, seeds)


def _judge(pick: Pick, cell: PickCell, seeds: list[int]) -> PickVerdict:
    try:
        task = PickTask(pick, cell)
    except InputError as error:
        return PickVerdict(pick, PickStatus.UNREADABLE, (StageResult(Stage.INPUT, False, str(error)),))
    tried, members, judged = 0, 0, list[_GroupVerdict]()
    for group in task.groups():
        judged.append(_judge_group(task, group, seeds))
        verdict = judged[-1].verdict
        tried, members = tried + verdict.configurations, members + len(group)
        if verdict.ok:
            return replace(verdict, pick=pick, configurations=tried)
    verdict, attempt = _failed(task, judged, tried, members)
    failed = verdict.stages[-1]
    suggestions = suggest(
        task, pick, failed, attempt, lambda other: _judge(other, cell.for_trials(failed.stage), seeds)
    )
    return replace(verdict, pick=pick, suggestions=suggestions)


def _failed(
    task: PickTask, groups: list[_GroupVerdict], tried: int, members: int
) -> tuple[PickVerdict, Attempt | None]:
    """The verdict on a pick without a good group: that of the group that passed the most stages, and its attempt."""
    farthest, attempt = max(groups, key=lambda group: len(group.verdict.stages))
    status, stages = farthest.status, farthest.stages
    # a range of rotations or a tolerance is only sampled, so the grasps between the samples are not refuted
    if task.sampled:
        status = PickStatus.NOT_FOUND
        stages = (*stages[:-1], replace(stages[-1], message=f"{stages[-1].message}; {members} grasps were tried"))
    if task.cell.trial is None and (hint := task.frame_hint()):
        stages = (*stages[:-1], replace(stages[-1], message=f"{stages[-1].message}; {hint}"))
    refuted = farthest.refuted if status is PickStatus.IMPOSSIBLE else ()
    return replace(farthest, status=status, stages=stages, configurations=tried, refuted=refuted), attempt


def _judge_group(task: PickTask, group: list[Member], seeds: list[int]) -> _GroupVerdict:
    """The verdict on a group of grasps with equal displacement from the nominal grasp."""
    reached = reach(task, group, seeds[0])
    if not len(reached.q):
        return _not_good(task, (VALID, *reached.stages), 0, reached.refuted)
    screened = screen(task, group, reached)
    failed = task.arm.dof == REDUNDANT and not screened.candidates and not screened.not_held and not task.cell.trial
    if failed and (between := reach_between(task, group, reached)) is not None:
        reached, screened = between, screen(task, group, between)
    stages, tried = (VALID, *reached.stages, *screened.stages), len(reached.q)
    if screened.candidates:
        return _search(task, group, screened.candidates, stages, tried, seeds)
    if screened.not_held:
        return _not_good(task, stages, tried, screened.refuted)
    if stages[-1].stage is not Stage.GRIP and (finer := _finer(task, reached)) is not None:
        return _judge_group(finer, group, seeds)
    refuted: tuple[str, ...] = ()
    if every_branch_is_known(task, [task.target(task.grasp(member)) for member in group]):
        reachable = set(reached.member.tolist())
        refuted = (*screened.refuted, *(unreached(each) for i, each in enumerate(group) if i not in reachable))
    elif stages[-1].stage in (Stage.SELF, Stage.GRASP) and not task.cell.trial:
        refuted = refuted_by_contacts(task, group, reached, seeds[0])
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
) -> _GroupVerdict:
    """The verdict on a group without a motion: impossible if every configuration is refuted."""
    status = PickStatus.IMPOSSIBLE if refuted else PickStatus.NOT_FOUND
    return _GroupVerdict(PickVerdict(task.pick, status, stages, tried, refuted=refuted), attempt)


def _search(
    task: PickTask,
    group: list[Member],
    candidates: tuple[GraspCandidate, ...],
    stages: tuple[StageResult, ...],
    tried: int,
    seeds: list[int],
) -> _GroupVerdict:
    """The verdict on a group with collision-free configurations, by the best motion through one of them."""
    search, trial = BestFirst(task, candidates, seeds[1:3]), task.cell.trial
    if trial is Stage.PLACE and not search.may_place():
        unplaced = StageResult(Stage.PLACE, False, "no IK solution at the release is collision-free with its lines")
        return _not_good(task, (*stages, unplaced), tried)
    while (motion := search.run() or search.with_full_budget()) is not None:
        result, timed = time_motion(task, motion.attempt, motion.path, motion.placing)
        if timed is not None:
            passed = (*stages, *motion.stages, _compared(result, search))
            return _GroupVerdict(_good(task, motion, passed, timed, tried))
        search.reject(motion, (*motion.stages, result))
    if search.failed:
        farthest = max(reversed(search.failed), key=len)
        placing = farthest[-1].stage is Stage.PLACE and not trial
        refuted = refuted_at_release(task, group, seeds[0]) if placing else ()
        return _not_good(task, (*stages, *farthest), tried, refuted)
    best = max(search.attempts, key=lambda attempt: (len(attempt.stages), attempt.fraction))
    refuted = () if trial is not None else refuted_by_name(task, group, seeds[0])
    last = best.stages[-1]
    if not refuted:
        tries = f"; {len(search.attempts)} of {len(candidates)} collision-free IK solutions were tried"
        last = replace(last, message=last.message + tries)
    return _not_good(task, (*stages, *best.stages[:-1], last), tried, refuted, best)


def _compared(result: StageResult, search: BestFirst) -> StageResult:
    """The last stage of a good pick, with the number of candidates it was compared to.

    Candidates are the complete motions and those that the bound of their score excludes.
    """
    counts = {"complete": search.made, "excluded": search.excluded, "untried": search.untried}
    compared = search.made + search.excluded
    notes = [f"best of {compared} candidates"] if compared > 1 else []
    if search.untried:
        notes.append(f"{search.untried} more not tried within the budget")
    figures = {**result.figures, **{name: float(count) for name, count in counts.items()}}
    return replace(result, message="; ".join([result.message, *notes]), figures=figures)


def _finer(task: PickTask, reached: Reached) -> PickTask | None:
    """The task with finer bodies, if a configuration is in contact only between convex hulls of meshes."""
    # all configurations are checked if they can prove that the pick is impossible, otherwise only the first ones
    for q in reached.q[: task.cell.budget.configurations] if task.sampled else reached.q:
        finer = task.at_grasp.finer_at(q)
        if finer is not task.at_grasp and finer.is_free(q):
            return PickTask(task.pick, replace(task.cell, checker=task.outside.finer_at(q)))
    return None


def _good(
    task: PickTask, motion: CompleteMotion, stages: tuple[StageResult, ...], timed: TimedPart, tried: int
) -> PickVerdict:
    """The verdict on a pick that passed every stage."""
    return PickVerdict(
        task.pick,
        PickStatus.GOOD,
        stages,
        tried,
        motion.attempt.q,
        timed.trajectory,
        timed.grasp_time,
        timed.motions[0].certificate if task.name is None else None,
        timed.motions,
        timed.release_time,
        member=motion.attempt.candidate.member.words,
        score=motion.parts,
        grip=None if task.name is None else task.grip(motion.attempt.candidate.member),
    )
