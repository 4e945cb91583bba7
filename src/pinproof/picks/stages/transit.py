"""The transit from home to where the approach begins, to any whole turn of it that the limits leave."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.picks.stages.lines import Way
from pinproof.picks.stages.task import Task
from pinproof.picks.verdict import Stage, StageResult
from pinproof.planning import RrtConnect, shortcut
from pinproof.planning.goals import with_turns

__all__ = ["planner", "transit"]

Array = npt.NDArray[np.float64]


def planner(nodes: int) -> RrtConnect:
    """Its budget is its nodes and samples: the same pick gets the same verdict on a slow machine."""
    return RrtConnect(max_nodes=nodes, max_samples=4 * nodes, time_limit=math.inf)


def transit(
    task: Task, ways: list[Way], nodes: int, seeds: list[int]
) -> tuple[Way | None, JointPath | None, StageResult]:
    """A path from home to the entrance of one of some ways, that way moved by whole turns, and what is to be said."""
    turned = _turned(task.arm, task.cell.home, ways)
    plan = planner(nodes).plan(task.outside, task.cell.home, np.array([way.entrance for way in turned]), rng=seeds[0])
    if plan.path is None or plan.goal is None:
        figures = {"nodes": float(plan.nodes), "goals": float(len(turned))}
        return None, None, StageResult(Stage.TRANSIT, False, f"from home: {plan.message}", figures)
    path = shortcut(plan.path, task.outside, rng=seeds[1])
    said = f"{path.length:.2f} rad, {len(path)} waypoints"
    clearance = (
        np.nan if plan.certificate is None else plan.certificate.clearance
    )  # of the path before it was shortened
    figures = {
        "length": path.length, "waypoints": float(len(path)), "nodes": float(plan.nodes), "plan_clearance": clearance
    }  # fmt: skip
    return turned[plan.goal], path, StageResult(Stage.TRANSIT, True, said, figures)


def _turned(arm: Arm, home: Array, ways: list[Way]) -> list[Way]:
    """The ways, and the same poses with joints whole turns away wherever all of the way stays inside the limits."""
    entrances, index_of = with_turns(arm, home, np.array([way.entrance for way in ways]))
    spans = [way.span() for way in ways]
    every = []
    for entrance, index in zip(entrances, index_of, strict=True):
        shift = entrance - ways[index].entrance
        low, high = spans[index]
        if (low + shift >= arm.limits.lower).all() and (high + shift <= arm.limits.upper).all():
            every.append(replace(ways[index], shift=ways[index].shift + shift) if shift.any() else ways[index])
    return every or list(ways)
