"""The transit from home to where the approach begins, and the whole turns of it that the limits leave."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, certify
from pinproof.errors import InputError
from pinproof.model import Arm
from pinproof.motion import JointPath
from pinproof.picks.stages.lines import Way
from pinproof.picks.stages.task import Task
from pinproof.picks.verdict import Stage, StageResult
from pinproof.planning import PlanResult, RrtConnect, shortcut
from pinproof.planning.ends import with_turns

__all__ = ["Crossing", "planner", "shortened", "transit", "whole_turns"]

Array = npt.NDArray[np.float64]


STRAIGHT = 2
"""Waypoints of a path that cannot be shortened."""


def planner(nodes: int) -> RrtConnect:
    """Its budget is its nodes and samples: the same pick gets the same verdict on a slow machine."""
    return RrtConnect(max_nodes=nodes, max_samples=4 * nodes, time_limit=math.inf)


class Crossing(NamedTuple):
    """A path, the way it leads to, what is to be said, and the least clearance (m) seen on it."""

    result: StageResult
    way: Way | None = None
    path: JointPath | None = None
    clearance: float = np.inf


def transit(task: Task, ways: list[Way], nodes: int, seeds: list[int]) -> Crossing:
    """A path from home to the entrance of one of some ways."""
    plan = planner(nodes).plan(task.outside, task.cell.home, np.array([way.entrance for way in ways]), rng=seeds[0])
    if plan.path is None or plan.goal is None:
        figures = {"nodes": float(plan.nodes), "goals": float(len(ways))}
        return Crossing(StageResult(Stage.TRANSIT, False, f"from home: {plan.message}", figures))
    path, clearance = shortened(plan, task.outside, seeds[1])
    said = f"{path.length:.2f} rad, {len(path)} waypoints"
    figures = {"length": path.length, "waypoints": float(len(path)), "nodes": float(plan.nodes)}
    return Crossing(StageResult(Stage.TRANSIT, True, said, figures), ways[plan.goal], path, clearance)


def shortened(plan: PlanResult, checker: CollisionChecker, seed: int) -> tuple[JointPath, float]:
    """The path of a plan that found one, shortened, and the least clearance (m) seen on it."""
    if plan.path is None or plan.certificate is None:
        raise InputError("a plan without a path cannot be shortened")
    if len(plan.path) <= STRAIGHT:
        return plan.path, plan.certificate.observed
    path = shortcut(plan.path, checker, rng=seed)
    return path, certify(path, checker).observed


def whole_turns(arm: Arm, home: Array, way: Way) -> Array:
    """(k, n) by how many whole turns (rad) all of a way can be moved inside the limits; as it is first."""
    entrances, _ = with_turns(arm, home, way.entrance[None])
    shifts = entrances - way.entrance
    low, high = way.span()
    inside = ((low + shifts >= arm.limits.lower) & (high + shifts <= arm.limits.upper)).all(axis=1)
    return np.asarray(shifts[inside | (np.arange(len(shifts)) == 0)])
