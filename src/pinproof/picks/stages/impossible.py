"""Is every grasp refuted? Where an end of its motions cannot be held at all, no way of getting there helps."""

from __future__ import annotations

from pinproof.collision import CollisionChecker
from pinproof.picks.configurations import configurations
from pinproof.picks.family import Member
from pinproof.picks.stages.grasp import contact_words
from pinproof.picks.stages.reach import every_branch_is_known
from pinproof.picks.stages.task import Task
from pinproof.spatial import SE3

__all__ = ["refuted_by_name", "unreached"]

NO_BRANCH, INSIDE = "no branch reaches", "inside the limits"


def refuted_by_name(task: Task, members: list[Member], seed: int) -> tuple[str, ...]:
    """Why each branch of each grasp is out, at the grasp or at the far end of a line; empty if not every one is.

    A line that a search could not follow proves nothing; an end that no branch reaches, or that each branch reaches in
    contact, does.
    """
    said: list[str] = []
    for member in members:
        grasp, pick = task.grasp(member), task.pick
        found = _refuted(task, grasp, task.at_grasp, "the grasp", seed)
        if not found and pick.approach:
            found = _refuted(task, task.approach_end(grasp), task.at_grasp, "the end of the approach", seed)
        if not found and pick.retreat:
            found = _refuted(task, task.retreat_end(grasp), task.carrying(member), "the end of the retreat", seed)
        if not found:
            return ()
        said += [f"{member.words}: {words}" if member.words else words for words in found]
    return tuple(said)


def _refuted(task: Task, root_from_tip: SE3, checker: CollisionChecker, where: str, seed: int) -> list[str]:
    """Why each branch at a pose is out; empty if one is not, or not all are known."""
    if not every_branch_is_known(task, [task.target(root_from_tip)]):
        return []
    _, many = configurations(task.arm, task.targets([root_from_tip]), task.cell.home, seed)
    if checker.is_free_batch(many).any():
        return []
    said = []
    for q in many:
        result = checker.finer_at(q).check(q)  # a contact of hulls alone refutes nothing
        if result.free:
            return []
        said.append(f"at {where}: {'; '.join(contact_words(result))}")
    return said or [f"{NO_BRANCH} {where} {INSIDE}"]


def unreached(member: Member) -> str:
    """Why a grasp is out that no branch reaches."""
    return f"{member.words}: {NO_BRANCH} the grasp {INSIDE}" if member.words else f"{NO_BRANCH} the grasp {INSIDE}"
