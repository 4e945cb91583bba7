"""One pick, judged stage by stage; see :class:`pinproof.picks.verdict.Stage`.

The configurations of all grasps of a ring of the family are looked at together. Those that are free are ranked, and
taken on in this order; of the first whole picks the best is returned. Where none is whole, the verdict tells of the way
that came farthest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError
from pinproof.motion import JointPath
from pinproof.picks.family import Member
from pinproof.picks.pick import Pick
from pinproof.picks.stages.cell import Cell
from pinproof.picks.stages.grasp import AMPLE, limit_margin, screen, weighed
from pinproof.picks.stages.impossible import refuted_at_the_end
from pinproof.picks.stages.lines import Way, along
from pinproof.picks.stages.place import Placing, place
from pinproof.picks.stages.reach import Reached, every_branch_is_known, reach
from pinproof.picks.stages.remedy import remedy
from pinproof.picks.stages.task import Task
from pinproof.picks.stages.timing import Timed, time_whole
from pinproof.picks.stages.transit import transit
from pinproof.picks.verdict import PickStatus, PickVerdict, Stage, StageResult

__all__ = ["judge"]

Array = npt.NDArray[np.float64]

INSTANT = 0.1
"""Seconds that are added to durations before they are compared: what differs by less is as good."""


@dataclass(frozen=True, eq=False)
class _Whole:
    """A pick that passed every stage but the timing, with its score."""

    way: Way
    stages: tuple[StageResult, ...]
    path: JointPath
    placing: Placing | None
    parts: dict[str, float]


def judge(pick: Pick, cell: Cell, rng: np.random.Generator) -> PickVerdict:
    """The verdict on one pick.

    Parameters
    ----------
    pick
        The pick.
    cell
        Where it is judged.
    rng
        Where random choices come from.
    """
    seeds = rng.integers(2**31, size=4).tolist()
    try:
        task = Task(pick, cell)
    except InputError as error:
        return PickVerdict(pick, PickStatus.UNREADABLE, (StageResult(Stage.INPUT, False, str(error)),))
    farthest, tried, members = None, 0, 0
    for ring in task.rings():
        verdict = _ring(task, ring, seeds)
        tried, members = tried + verdict.configurations, members + len(ring)
        if verdict.ok:
            return replace(verdict, pick=pick, configurations=tried)
        if farthest is None or len(verdict.stages) > len(farthest.stages):
            farthest = verdict
    return replace(_no(task, farthest or verdict, tried, members, seeds[3]), pick=pick)


def _no(task: Task, farthest: PickVerdict, tried: int, members: int, seed: int) -> PickVerdict:
    """The verdict on a pick of which no ring is good: that of the ring that came farthest, and what would work."""
    status, stages = farthest.status, farthest.stages
    # of a range of turns or a tolerance only some places were tried: the grasps between them are not refuted
    if task.sampled:
        status = PickStatus.NOT_FOUND
        stages = (*stages[:-1], replace(stages[-1], message=f"{stages[-1].message}; {members} grasps were tried"))
    return replace(
        farthest,
        status=status,
        stages=stages,
        configurations=tried,
        refuted=farthest.refuted if status is PickStatus.IMPOSSIBLE else (),
        remedy=remedy(task, farthest.stages[-1], seed),
    )


def _ring(task: Task, ring: list[Member], seeds: list[int]) -> PickVerdict:
    """The verdict on grasps that are as far from the nominal one as each other."""
    pick, budget = task.pick, task.cell.budget
    start = (StageResult(Stage.INPUT, True, "read"),)
    reached = reach(task, ring, seeds[0])
    stages = (*start, *reached.stages)
    if not len(reached.q):
        status = PickStatus.IMPOSSIBLE if reached.complete else PickStatus.NOT_FOUND
        return PickVerdict(pick, status, stages, refuted=reached.refuted)
    tried = len(reached.q)
    screened = screen(task, ring, reached)
    stages = (*stages, *screened.stages)
    if not screened.candidates:
        if (finer := _finer(task, reached)) is not None:
            return _ring(finer, ring, seeds)
        known = every_branch_is_known(task, [task.target(task.grasp(member)) for member in ring])
        status = PickStatus.IMPOSSIBLE if known else PickStatus.NOT_FOUND
        return PickVerdict(pick, status, stages, tried, refuted=screened.refuted)
    ways: list[Way] = []
    wholes: list[_Whole] = []
    failed: list[tuple[StageResult, ...]] = []
    for candidate in screened.candidates[: budget.configurations]:
        way = along(task, candidate)
        ways.append(way)
        if way.passed:
            whole, told = _whole(task, [way], budget.quick_nodes, seeds)
            failed.append((*way.stages, *told))
            if whole is not None:
                wholes.append(whole)
            if len(wholes) == budget.compared:
                break
    passed = [way for way in ways if way.passed]
    if not wholes and passed and all(told[-1].stage is Stage.TRANSIT for told in failed):
        whole, told = _whole(task, passed, budget.nodes, seeds)
        failed.append((*passed[0].stages, *told))
        wholes = [] if whole is None else [whole]
    for whole in _ranked(task, wholes):
        result, timed = time_whole(task, whole.way, whole.path, whole.placing)
        told = (*whole.stages, result)
        if timed is not None:
            return _good(task, whole, (*stages, *told), timed, tried)
        failed.append(told)
    if failed:
        return PickVerdict(pick, PickStatus.NOT_FOUND, (*stages, *max(reversed(failed), key=len)), tried)
    best = max(ways, key=lambda way: (len(way.stages), way.fraction))
    refuted = refuted_at_the_end(task, ring, best.stages[-1].stage, seeds[0])
    status = PickStatus.IMPOSSIBLE if refuted else PickStatus.NOT_FOUND
    last = best.stages[-1]
    if not refuted:
        of = f"; {len(ways)} of {len(screened.candidates)} free configurations were tried"
        last = replace(last, message=last.message + of)
    return PickVerdict(pick, status, (*stages, *best.stages[:-1], last), tried, refuted=refuted)


def _finer(task: Task, reached: Reached) -> Task | None:
    """The same with closer bodies, if a configuration is in contact by the hulls of meshes alone."""
    # of a sample, which proves nothing anyway, the first; else all, for a contact of hulls alone refutes nothing
    for q in reached.q[: task.cell.budget.configurations] if task.sampled else reached.q:
        finer = task.at_grasp.finer_at(q)
        if finer is not task.at_grasp and finer.is_free(q):
            return Task(task.pick, replace(task.cell, checker=task.outside.finer_at(q)))
    return None


def _whole(task: Task, ways: list[Way], nodes: int, seeds: list[int]) -> tuple[_Whole | None, tuple[StageResult, ...]]:
    """One of some ways as a whole pick; and what is to be said from the transit on."""
    way, path, crossed = transit(task, ways, nodes, seeds[1:3])
    if way is None or path is None:
        return None, (crossed,)
    placed, placing = place(task, way, seeds[1:3])
    if not placed.ok:
        return None, (crossed, placed)
    curves = [path, way.line_in(), way.line_out()]
    clearances = [crossed.figures["plan_clearance"], *(stage.figures.get("clearance", np.inf) for stage in way.stages)]
    if placing is not None:
        curves += [placing.transfer, placing.lift, placing.leave]
        clearances.append(placed.figures["clearance"])
    points = [curve.bezier()[1].reshape(-1, task.arm.dof) for curve in curves if curve is not None]
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    parts = {
        "clearance": float(np.clip(min(clearances), 0.0, AMPLE)) / AMPLE,
        "limit_margin": limit_margin(task, low, high),
        "manipulability": way.candidate.parts["manipulability"],
        "duration": sum(_seconds(task, each) for each in points),  # made a share where wholes are compared
    }
    return _Whole(way, (*way.stages, crossed, placed), path, placing, parts), (crossed, placed)


def _seconds(task: Task, points: Array) -> float:
    """A bound of the time (s) that a curve takes by its control points (k, n), at full speed."""
    return float((np.abs(np.diff(points, axis=0)) / task.arm.limits.velocity).max(axis=1, initial=0.0).sum())


def _ranked(task: Task, wholes: list[_Whole]) -> list[_Whole]:
    """The best first."""
    shortest = min((whole.parts["duration"] for whole in wholes), default=0.0)
    compared = []
    for whole in wholes:
        seconds = whole.parts["duration"]
        parts = {**whole.parts, "duration": (shortest + INSTANT) / (seconds + INSTANT)}
        compared.append(replace(whole, parts={**parts, "score": weighed(parts, task.cell.weights)}))
    return sorted(compared, key=lambda whole: -whole.parts["score"])


def _good(task: Task, whole: _Whole, stages: tuple[StageResult, ...], timed: Timed, tried: int) -> PickVerdict:
    """The verdict on a pick that passed every stage."""
    return PickVerdict(
        task.pick,
        PickStatus.GOOD,
        stages,
        tried,
        whole.way.q,
        timed.trajectory,
        timed.grasp_time,
        timed.motions[0].certificate if task.name is None else None,
        timed.motions,
        timed.release_time,
        member=whole.way.candidate.member.words,
        score=whole.parts,
    )
