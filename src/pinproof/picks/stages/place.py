"""Place: the transfer with the object, the straight way down, letting go, and the way off with the empty hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.motion import CubicPath, JointPath
from pinproof.picks.configurations import configurations
from pinproof.picks.pick import Place, moved
from pinproof.picks.stages.grasp import contact_words
from pinproof.picks.stages.lines import Pairs, Way, line
from pinproof.picks.stages.task import Task
from pinproof.picks.stages.transit import planner
from pinproof.picks.verdict import Stage, StageResult
from pinproof.planning import shortcut
from pinproof.planning.goals import with_turns
from pinproof.spatial import SE3

__all__ = ["Placing", "place"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Placing:
    """The parts: ``lift`` and ``leave`` lead from the release outwards; None for what was not asked for."""

    transfer: JointPath
    lift: CubicPath | None
    leave: CubicPath | None
    parting: Pairs


def place(task: Task, way: Way, seeds: list[int]) -> tuple[StageResult, Placing | None]:
    """Put down what a way has grasped."""
    asked = task.place
    if asked is None:
        return StageResult(Stage.PLACE, True, "none asked for"), None
    member, arm = way.candidate.member, task.arm
    release = task.release(member)
    _, many = configurations(arm, task.targets([release]), way.exit, seeds[0])
    if not len(many):
        return StageResult(Stage.PLACE, False, "no configuration was found where the object is let go"), None
    many = many[np.argsort((np.abs(many - way.exit) / arm.limits.velocity).max(axis=1), kind="stable")]
    best = StageResult(Stage.PLACE, False, "")
    for q in many[: task.cell.budget.configurations]:
        result, found = _down(task, asked, way, q, release, seeds)
        if found is not None:
            return result, found
        if not best.message or result.figures.get("passed", 0.0) > best.figures.get("passed", 0.0):
            best = result
    return best, None


def _down(
    task: Task, asked: Place, way: Way, q: Array, release: SE3, seeds: list[int]
) -> tuple[StageResult, Placing | None]:
    """The same for one configuration q (n,) at the release; ``passed`` counts the parts that were possible."""
    member = way.candidate.member
    carrying, free_hand = task.carrying(member), task.letting_go(member)

    def no(passed: int, words: str) -> tuple[StageResult, None]:
        return StageResult(Stage.PLACE, False, words, {"passed": float(passed)}), None

    if not free_hand.is_free(q):
        return no(0, f"when the object is let go: {'; '.join(contact_words(free_hand.check(q)))}")
    parting = task.supports(carrying, q, asked.support)
    above = moved(release, -asked.approach, asked.approach_direction, asked.approach_frame)
    down, lift, _ = line(Stage.PLACE, task, carrying, q, above, asked.approach, parting)
    if not down.ok:
        return no(1, f"way down, {down.message}")
    off = moved(release, asked.retreat, asked.retreat_direction, asked.retreat_frame)
    off_it, leave, _ = line(Stage.PLACE, task, free_hand, q, off, asked.retreat)
    if not off_it.ok:
        return no(2, f"way off: {off_it.message}")
    entrance = q if lift is None else lift.end
    low, high = _span(q, lift, leave)
    limits = task.arm.limits
    goals, _ = with_turns(task.arm, way.exit, entrance[None])
    shifts = [goal - entrance for goal in goals]
    shifts = [s for s in shifts if (low + s >= limits.lower).all() and (high + s <= limits.upper).all()] or shifts[:1]
    plan = planner(task.cell.budget.nodes).plan(carrying, way.exit, entrance + np.array(shifts), rng=seeds[0])
    if plan.path is None or plan.goal is None:
        return no(3, f"transfer: {plan.message}")
    by = shifts[plan.goal]
    lift, leave = (
        None if path is None else CubicPath(path.q + by, path.tangents, path.knots, path.joint_names)
        for path in (lift, leave)
    )
    path = shortcut(plan.path, carrying, rng=seeds[1])
    on = f" onto {', '.join(pair[1] for pair in parting)}" if parting else ""
    said = f"transfer of {path.length:.2f} rad, {asked.approach * 1e3:.0f} mm down{on}, "
    certificate = np.nan if plan.certificate is None else plan.certificate.clearance
    clearance = min(each.figures.get("clearance", np.inf) for each in (down, off_it))
    figures = {"length": path.length, "clearance": min(clearance, certificate)}
    return (
        StageResult(Stage.PLACE, True, f"{said}{asked.retreat * 1e3:.0f} mm off", figures),
        Placing(path, lift, leave, parting),
    )


def _span(q: Array, *paths: CubicPath | None) -> tuple[Array, Array]:
    """Bounds (n,) of every joint along some paths: those of Bezier control points."""
    points = np.vstack([q, *(path.bezier()[1].reshape(-1, len(q)) for path in paths if path is not None)])
    return points.min(axis=0), points.max(axis=0)
