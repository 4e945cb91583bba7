"""Is a line refuted? Where its far end cannot be held at all, no way of following it helps."""

from __future__ import annotations

from pinproof.picks.configurations import configurations
from pinproof.picks.family import Member
from pinproof.picks.stages.grasp import contact_words
from pinproof.picks.stages.reach import every_branch_is_known
from pinproof.picks.stages.task import Task
from pinproof.picks.verdict import Stage

__all__ = ["refuted_at_the_end"]


def refuted_at_the_end(task: Task, members: list[Member], stage: Stage, seed: int) -> tuple[str, ...]:
    """Why each branch of each grasp is out at the far end of its approach or retreat; empty if not every one is.

    A line that a search could not follow proves nothing; an end that no branch reaches, or that each branch reaches in
    contact, does.
    """
    said: list[str] = []
    for member in members:
        root_from_tip = task.grasp(member)
        out = stage is Stage.RETREAT
        end = task.retreat_end(root_from_tip) if out else task.approach_end(root_from_tip)
        if not every_branch_is_known(task, [task.target(end)]):
            return ()
        checker = task.carrying(member) if out else task.at_grasp
        _, many = configurations(task.arm, task.targets([end]), task.cell.home, seed)
        which = f"{member.words}: " if member.words else ""
        if not len(many):
            said.append(f"{which}no branch reaches the end of the {stage.value} inside the limits")
        for q in many:
            result = checker.finer_at(q).check(q)  # a contact of hulls alone refutes nothing
            if result.free:
                return ()
            said.append(f"{which}at the end of the {stage.value}: {'; '.join(contact_words(result))}")
    return tuple(said)
