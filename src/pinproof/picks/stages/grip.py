"""Grip: the closed hand holds the object, and closing it touches nothing else."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pinproof.collision.checker import CheckResult
from pinproof.picks.family import Member
from pinproof.picks.stages.task import Task
from pinproof.picks.verdict import Stage, StageResult

__all__ = ["Gripped", "closing_words", "grip_holds", "judge_grip", "not_held_words"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SAID = 6
"""Contacts that a reason names at most."""


@dataclass(frozen=True, eq=False)
class Gripped:
    """Which configurations hold the object, and what is to be said of the stage.

    Parameters
    ----------
    kept
        (k,) those whose grasp holds the object, and at which the hand can close.
    result
        The stage.
    refuted
        (k,) why each of the others is out; empty for those that are kept.
    """

    kept: Mask
    result: StageResult
    refuted: tuple[str, ...]


def grip_holds(task: Task, member: Member) -> bool:
    """Whether a grasp holds the object; without an object there is nothing to hold."""
    return task.name is None or task.grip(member).held


def not_held_words(task: Task, member: Member) -> str:
    """Why a grasp does not hold the object."""
    return _of(member) + task.grip(member).message


def judge_grip(task: Task, members: list[Member], q: Array, of: npt.NDArray[np.int64]) -> Gripped:
    """Judge configurations q (k, n) that are free at the grasp, each of the member ``of`` (k,)."""
    if task.name is None:
        said = "not judged: the pick names no object"
        return Gripped(np.ones(len(q), dtype=bool), StageResult(Stage.GRIP, True, said), ("",) * len(q))
    refuted = ["" if task.grip(members[i]).held else not_held_words(task, members[i]) for i in of]
    kept = np.array([not why for why in refuted])
    if not kept.any():
        tried = sorted(set(of.tolist()))
        best = task.grip(members[tried[0]])
        more = f" (the first of {len(tried)} grasps, none of which holds it)" if len(tried) > 1 else ""
        return Gripped(kept, StageResult(Stage.GRIP, False, best.message + more, best.figures), tuple(refuted))
    if not task.cell.fingers:
        grip = task.grip(members[of[kept][0]])
        return Gripped(kept, StageResult(Stage.GRIP, True, grip.message, grip.figures), tuple(refuted))
    closing = task.closing
    closes = kept.copy()
    closes[kept] = closing.is_free_batch(q[kept])
    if not closes.any():
        found = [(int(i), closing.check(q[i])) for i in np.flatnonzero(kept)]
        for i, contact in found:
            refuted[i] = _of(members[of[i]]) + closing_words(task, contact)
        worst = max(found, key=lambda each: min((c.distance for c in each[1].contacts), default=-np.inf))
        said = f"{closing_words(task, worst[1])}{_many(len(found))}"
        figures = {"distance": min((c.distance for c in worst[1].contacts), default=np.nan)}
        return Gripped(closes, StageResult(Stage.GRIP, False, said, figures), tuple(refuted))
    for i in np.flatnonzero(kept & ~closes).tolist():
        refuted[i] = _of(members[of[i]]) + closing_words(task, closing.check(q[i]))
    first = int(np.flatnonzero(closes)[0])
    grip = task.grip(members[of[first]])
    clear = closing.clearance(q[first])
    said = f"{grip.message}; {clear * 1e3:.1f} mm clearance while they close"
    figures = {**grip.figures, "closing_clearance": clear}
    return Gripped(closes, StageResult(Stage.GRIP, True, said, figures), tuple(refuted))


def closing_words(task: Task, result: CheckResult) -> str:
    """What the fingers meet while they close or open, each pair once, the deepest first."""
    finger_of = {body.name: name for name, bodies in task.cell.swept.items() for body in bodies}
    said: dict[frozenset[str], str] = {}
    for contact in result.contacts:
        first, second = (finger_of.get(name, name) for name in contact.bodies)
        said.setdefault(frozenset((first, second)), str(replace(contact, bodies=(first, second))))
    words = list(said.values())
    more = f"; and {len(words) - SAID} more" if len(words) > SAID else ""
    return f"while the fingers move, {'; '.join(words[:SAID])}{more}"


def _many(count: int) -> str:
    return f" (the least of {count} configurations)" if count > 1 else ""


def _of(member: Member) -> str:
    return f"{member.words}: " if member.words else ""
