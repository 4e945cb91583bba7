"""Reach and limits: the configurations of every grasp of the family; without any, why there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pinproof.ik import AnalyticIk, Clik
from pinproof.model import Arm
from pinproof.picks.configurations import STARTS, configurations, limit_margins, turned_inside
from pinproof.picks.family import Member
from pinproof.picks.stages.task import Task
from pinproof.picks.verdict import Stage, StageResult
from pinproof.spatial import SE3, twist_size

__all__ = ["Reached", "every_branch", "every_branch_is_known", "reach"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reached:
    """Configurations at the grasp.

    Parameters
    ----------
    q
        (k, n) inside the limits.
    member
        (k,) which of the members each is for.
    stages
        What is to be said of reach and limits.
    refuted
        If there is none: every branch there would be, each with the limit that refutes it.
    complete
        Whether these are proven to be all.
    """

    q: Array
    member: npt.NDArray[np.int64]
    stages: tuple[StageResult, ...]
    refuted: tuple[str, ...] = ()
    complete: bool = False


def reach(task: Task, members: list[Member], seed: int) -> Reached:
    """The configurations that bring the tip to each of some grasps."""
    arm, home = task.arm, task.cell.home
    targets = [task.target(task.grasp(member)) for member in members]
    row, q = configurations(arm, task.targets([task.grasp(member) for member in members]), home, seed)
    if not len(q) and not task.cell.closed_form:  # brings the nearest miss to its end, which may be the target
        nearest = Clik().solve(arm, targets[0], home, rng=seed)
        if nearest.ok:
            row, q = np.zeros(1, dtype=np.int64), np.array([nearest.q])
    return _reached(task, members, targets, row, q) if len(q) else _none(task, members, targets, seed)


def _reached(task: Task, members: list[Member], targets: list[SE3], row: npt.NDArray[np.int64], q: Array) -> Reached:
    arm = task.arm
    off = max(twist_size(targets[i], arm.forward_kinematics(each))[0] for i, each in zip(row[:8], q[:8], strict=True))
    spread = f" of {len(members)} grasps" if len(members) > 1 else ""
    said = f"{len(q)} configuration{'' if len(q) == 1 else 's'}{spread}, {off:.1e} m off"
    figures = {"configurations": float(len(q)), "grasps": float(len(members)), "position_error": off}
    margins = limit_margins(arm, q)
    stages = (
        StageResult(Stage.REACH, True, said, figures),
        StageResult(Stage.LIMITS, True, "inside all limits", {"widest_margin": float(margins.max())}),
    )
    return Reached(q, row, stages)


def every_branch_is_known(task: Task, targets: list[SE3], arm: Arm | None = None) -> bool:
    """Whether the closed form is proven to give every configuration for each of some targets."""
    if not task.cell.closed_form:
        return False
    for target in targets:
        found = AnalyticIk().solve_all(arm or task.arm, target, task.cell.home)
        if not found.complete or found.families:
            return False
    return True


def every_branch(task: Task, root_from_tip: SE3, wanted: bool = True) -> Array:
    """(m, n) all configurations at a pose; none where not all are known, or they are not wanted."""
    if not wanted or not every_branch_is_known(task, [task.target(root_from_tip)]):
        return np.empty((0, task.arm.dof))
    return configurations(task.arm, task.targets([root_from_tip]), task.cell.home, 0)[1]


def _none(task: Task, members: list[Member], targets: list[SE3], seed: int) -> Reached:
    """Why no configuration was found: limits alone, or reach."""
    arm, wide, limits = task.arm, task.cell.wide_arm, task.arm.limits
    empty = np.empty((0, arm.dof)), np.empty(0, dtype=np.int64)
    row, free = configurations(wide, task.targets([task.grasp(m) for m in members]), task.cell.home, seed)
    inside = [turned_inside(arm, q) for q in free]
    complete = every_branch_is_known(task, targets)
    if not inside:
        nearest = Clik().solve(arm, targets[0], task.cell.home, rng=seed)
        short = f"{nearest.position_error * 1e3:.1f} mm and {np.degrees(nearest.orientation_error):.1f} deg short"
        said = f"out of reach: the nearest configuration found is {short}"
        complete = complete and every_branch_is_known(task, targets, wide)
        if not task.cell.closed_form:
            said += f" ({STARTS} starts)"
        figures = {"position_error": nearest.position_error, "orientation_error": nearest.orientation_error}
        failed = StageResult(Stage.REACH, False, said, figures)
        refuted = tuple(f"{_of(member)}no branch of the closed form reaches the pose" for member in members)
        return Reached(*empty, (failed,), refuted if complete else (), complete)
    by = [float(np.abs(q - limits.clip(q)).sum()) for q in inside]
    best = int(np.argmin(by))
    if by[best] == 0.0:  # a search that only met it under wider limits
        return _reached(task, members, targets, row[[best]], np.array([inside[best]]))
    beyond = np.abs(inside[best] - limits.clip(inside[best]))
    outside = "; ".join(limits.violations(inside[best], arm.joint_names))
    outside += f" ({', '.join(f'{arm.joint_names[j]} by {beyond[j]:.3g}' for j in np.flatnonzero(beyond))})"
    figures = {"outside": by[best], "configurations": float(len(inside))}
    reached = StageResult(
        Stage.REACH, True, "reachable if limits are left aside", {"configurations": float(len(inside))}
    )
    failed = StageResult(Stage.LIMITS, False, f"found only outside the limits: {outside}", figures)
    refuted = tuple(
        f"{_of(members[i])}{'; '.join(limits.violations(q, arm.joint_names))}" for i, q in zip(row, inside, strict=True)
    )
    return Reached(*empty, (reached, failed), refuted if complete else (), complete)


def _of(member: Member) -> str:
    return f"{member.words}: " if member.words else ""
