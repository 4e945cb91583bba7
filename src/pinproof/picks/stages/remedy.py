"""What would work: the nearest shorter line, other spin, and shift of the grasp that pass the stage that failed.

Each is judged by the same stages before it is said. That the later stages pass too is not promised.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
import numpy.typing as npt

from pinproof.ik import Clik
from pinproof.picks.family import Member, Spin, Tolerance, family
from pinproof.picks.pick import TIP
from pinproof.picks.stages.grasp import rank
from pinproof.picks.stages.lines import along
from pinproof.picks.stages.reach import reach
from pinproof.picks.stages.task import Task
from pinproof.picks.verdict import Stage, StageResult
from pinproof.spatial import SE3

__all__ = ["remedy"]

Array = npt.NDArray[np.float64]

SHIFTS = (0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.075, 0.1)
"""Metres by which a grasp is moved in each direction, the least first."""

DIRECTIONS = sorted((d for d in product((0, 1, -1), repeat=3) if any(d)), key=lambda d: sum(map(abs, d)))
"""In the root frame: its axes first, then between two of them, then between all three."""

STRETCHES = (1.02, 1.1, 1.25, 1.5, 2.0)
"""Times what is missing to a pose out of reach: shifts towards the nearest pose that was reached."""

WAYS_A_MEMBER = 2
"""Configurations of each changed grasp whose lines are tried."""

STEP = 1e-3
"""Metres: distances that work are told to the millimetre."""


def remedy(task: Task, failed: StageResult, seed: int) -> str:
    """The nearest changes that pass the stage, in words; empty if none was found within the budget."""
    tries = task.cell.budget.remedies
    if not tries or failed.stage not in (
        Stage.REACH,
        Stage.LIMITS,
        Stage.SELF,
        Stage.GRASP,
        Stage.APPROACH,
        Stage.RETREAT,
    ):
        return ""
    found: list[str | None] = [_shorter(task, failed, seed, tries)]
    if not task.pick.spin.sampled:
        found.append(_first(task, failed.stage, _spins(task), seed, tries))
    found.append(_first(task, failed.stage, list(_shifts(task, failed, seed)), seed, tries))
    said = [each for each in found if each]
    return f"passes the {failed.stage.value}: {'; or '.join(said)}" if said else ""


def _shorter(task: Task, failed: StageResult, seed: int, tries: int) -> str:
    """The largest distance, to the millimetre, at which a line that failed passes."""
    if failed.stage not in (Stage.APPROACH, Stage.RETREAT):
        return ""
    key = failed.stage.value
    works, fails = 0.0, float(getattr(task.pick, key))
    guess = failed.figures.get("possible", 0.0)
    for _ in range(tries):
        middle = np.floor((guess if works < guess < fails else (works + fails) / 2) / STEP) * STEP
        if not works < middle < fails:
            break
        if _first(task.with_pick(**{key: middle}), failed.stage, [Member(SE3.Identity())], seed, 1) is not None:
            works = float(middle)
        else:
            fails = float(middle)
        guess = 0.0
    return f"{key} {works * 1e3:.0f} mm instead of {getattr(task.pick, key) * 1e3:.0f} mm" if works else ""


def _first(task: Task, stage: Stage, members: list[Member], seed: int, tries: int) -> str | None:
    """The first of some grasps that passes a stage, in words; None if none does."""
    reached = reach(task, members, seed)
    if not len(reached.q):
        return None
    if stage in (Stage.REACH, Stage.LIMITS):
        return members[int(reached.member.min())].words
    free = task.at_grasp.is_free_batch(reached.q)
    if not free.any():
        return None
    if stage in (Stage.SELF, Stage.GRASP):
        return members[int(reached.member[free].min())].words
    for index in np.unique(reached.member[free])[:tries].tolist():
        q = reached.q[free & (reached.member == index)]
        for candidate in rank(task, q, [members[index]] * len(q))[:WAYS_A_MEMBER]:
            judged = along(task, candidate).stages
            if any(result.stage is stage and result.ok for result in judged):
                return members[index].words
    return None


def _spins(task: Task) -> list[Member]:
    """The grasp turned about its approach, the smallest turns first."""
    axis = np.array(task.pick.approach_direction)
    if task.pick.approach_frame != TIP:
        axis = task.pick.pose.rotation.T @ axis
    return next(iter(family(Spin.free(), Tolerance(), axis)))[1:]


def _shifts(task: Task, failed: StageResult, seed: int) -> Iterator[Member]:
    """The grasp shifted, the nearest first; one out of reach towards where the arm comes nearest to it."""
    if failed.stage is Stage.REACH:
        target = task.target(task.pick.pose)
        nearest = Clik().solve(task.arm, target, task.cell.home, rng=seed)
        gap = task.arm.forward_kinematics(nearest.q).translation - target.translation
        away = task.arm.root_from_base.rotation @ gap
        for stretch in STRETCHES:
            yield _shifted(task, stretch * away, "towards the arm")
        return
    for distance in SHIFTS:
        for direction in DIRECTIONS:
            along_it = distance * np.array(direction) / np.linalg.norm(direction)
            words = " ".join(f"{'-+'[sign > 0]}{axis}" for axis, sign in zip("xyz", direction, strict=True) if sign)
            yield _shifted(task, along_it, f"along {words} of the root")


def _shifted(task: Task, by: Array, where: str) -> Member:
    """The grasp moved by (3,) m in the root frame."""
    pose = task.pick.pose
    return Member(SE3(np.eye(3), pose.rotation.T @ by), f"shifted by {np.linalg.norm(by) * 1e3:.0f} mm {where}")
