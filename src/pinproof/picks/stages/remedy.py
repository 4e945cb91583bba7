"""What would work: the nearest shorter line, other spin, and shift of the grasp that pass the stage that failed.

Each is judged by the same stages before it is said. That the later stages pass too is not promised.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
import numpy.typing as npt

from pinproof.ik import Clik
from pinproof.picks.configurations import configurations
from pinproof.picks.family import Member, Spin, Tolerance, family
from pinproof.picks.pick import ROOT, TIP, Place
from pinproof.picks.stages.grasp import rank
from pinproof.picks.stages.grip import grip_holds, judge_grip
from pinproof.picks.stages.lines import Way, line_in, line_out
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

UP = (0.0, 0.0, 1.0)

STEP = 1e-3
"""Metres: distances that work are told to the millimetre."""


def remedy(task: Task, failed: StageResult, way: Way | None, seed: int) -> str:
    """The nearest changes that pass the stage, in words; empty if none was found within the budget.

    Parameters
    ----------
    failed
        The stage.
    way
        If a line failed: the way that came farthest.
    """
    tries = task.cell.budget.remedies
    if tries and failed.stage is Stage.PLACE and task.place is not None:
        return _nearer(task, task.place, seed)
    if not tries or failed.stage not in (
        Stage.REACH,
        Stage.LIMITS,
        Stage.SELF,
        Stage.GRASP,
        Stage.GRIP,
        Stage.APPROACH,
        Stage.RETREAT,
    ):
        return ""
    found: list[str | None] = [_shorter(task, failed.stage, way, tries), _upwards(task, failed.stage, way)]
    if not task.pick.spin.sampled:
        found.append(_first(task, failed.stage, _spins(task), seed, tries))
    found.append(_first(task, failed.stage, list(_shifts(task, failed, seed)), seed, tries))
    said = [each for each in found if each]
    return f"passes the {failed.stage.value}: {'; or '.join(said)}" if said else ""


def _shorter(task: Task, stage: Stage, way: Way | None, tries: int) -> str:
    """The largest distance, to the millimetre, at which a line that failed passes: less than was possible of it."""
    if way is None or stage not in (Stage.APPROACH, Stage.RETREAT):
        return ""
    key = stage.value
    asked = float(getattr(task.pick, key))
    length = np.floor(way.fraction * asked / STEP) * STEP
    for _ in range(tries):
        if not 0 < length < asked:
            break
        shorter = task.with_pick(**{key: float(length)})
        line = line_in(shorter, way.candidate) if stage is Stage.APPROACH else line_out(shorter, way.candidate)[0]
        if line.result.ok:
            return f"{key} {length * 1e3:.0f} mm instead of {asked * 1e3:.0f} mm"
        length = np.floor(min(line.fraction * length, length - STEP) / STEP) * STEP
    return ""


def _upwards(task: Task, stage: Stage, way: Way | None) -> str:
    """Straight up, if that is the way out."""
    pick = task.pick
    if way is None or stage is not Stage.RETREAT or (pick.retreat_frame == ROOT and pick.retreat_direction == UP):
        return ""
    up = task.with_pick(retreat_frame=ROOT, retreat_direction=UP)
    return "retreat straight up" if line_out(up, way.candidate)[0].result.ok else ""


def _first(task: Task, stage: Stage, members: list[Member], seed: int, tries: int) -> str | None:
    """The first of some grasps that passes a stage and holds the object, in words; None if none does."""
    members = [member for member in members if grip_holds(task, member)]
    if not members:
        return None
    reached = reach(task, members, seed)
    if not len(reached.q):
        return None
    if stage in (Stage.REACH, Stage.LIMITS):
        return members[int(reached.member.min())].words
    free = task.at_grasp.is_free_batch(reached.q)
    if stage not in (Stage.SELF, Stage.GRASP) and free.any():
        free[free] = judge_grip(task, members, reached.q[free], reached.member[free]).kept
    if not free.any():
        return None
    if stage in (Stage.SELF, Stage.GRASP, Stage.GRIP):
        return members[int(reached.member[free].min())].words
    left = tries
    for index in np.unique(reached.member[free]).tolist():
        if left == 0:
            break
        if not _ends_free(task, stage, members[index], seed):
            left -= stage is Stage.RETREAT  # for which every grasp takes a checker of its own
            continue
        left -= 1
        q = reached.q[free & (reached.member == index)]
        for candidate in rank(task, q, [members[index]] * len(q))[:WAYS_A_MEMBER]:
            if stage is Stage.RETREAT and not line_out(task, candidate)[0].result.ok:
                continue
            if line_in(task, candidate).result.ok:
                return members[index].words
    return None


def _ends_free(task: Task, stage: Stage, member: Member, seed: int) -> bool:
    """Whether the arm can stand, free, where the line of a stage ends: without that, it need not be walked."""
    out, grasp = stage is Stage.RETREAT, task.grasp(member)
    end = task.retreat_end(grasp) if out else task.approach_end(grasp)
    _, q = configurations(task.arm, task.targets([end]), task.cell.home, seed)
    checker = task.carrying(member) if out else task.at_grasp
    return bool(checker.is_free_batch(q).any())


def _nearer(task: Task, place: Place, seed: int) -> str:
    """The place shifted towards where the arm comes nearest to it, if it is out of reach; empty if it is not."""
    target = task.targets([place.pose])
    if len(configurations(task.arm, target, task.cell.home, seed)[1]):
        return ""
    for stretch in STRETCHES:
        by = stretch * _short_of(task, place.pose, seed)
        there = SE3(place.pose.rotation, place.pose.translation + by)
        if len(configurations(task.arm, task.targets([there]), task.cell.home, seed)[1]):
            return f"reaches the place: shifted by {np.linalg.norm(by) * 1e3:.0f} mm towards the arm"
    return ""


def _short_of(task: Task, root_from_tip: SE3, seed: int) -> Array:
    """(3,) metres in the root frame from a pose to where the arm comes nearest to it."""
    target = task.target(root_from_tip)
    nearest = Clik().solve(task.arm, target, task.cell.home, rng=seed)
    gap = task.arm.forward_kinematics(nearest.q).translation - target.translation
    return np.asarray(task.arm.root_from_base.rotation @ gap)


def _spins(task: Task) -> list[Member]:
    """The grasp turned about its approach, the smallest turns first."""
    axis = np.array(task.pick.approach_direction)
    if task.pick.approach_frame != TIP:
        axis = task.pick.pose.rotation.T @ axis
    return next(iter(family(Spin.free(), Tolerance(), axis)))[1:]


def _shifts(task: Task, failed: StageResult, seed: int) -> Iterator[Member]:
    """The grasp shifted, the nearest first; one out of reach towards where the arm comes nearest to it."""
    if failed.stage is Stage.REACH:
        away = _short_of(task, task.pick.pose, seed)
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
