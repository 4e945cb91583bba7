"""What a yes takes for granted: bodies that stand for others, joints that stand still, links that touch nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pinproof.collision.certificate import changed_files

if TYPE_CHECKING:
    from pinproof.collision.checker import CollisionChecker

__all__ = ["notes_of"]

NAMED = 6
"""How many names a note lists before it only counts."""


def notes_of(checker: CollisionChecker) -> tuple[str, ...]:
    """Sentences on what was hulled, assumed or left out of a checker's verdicts; pairs of bodies left out are not said.

    Those stand in :attr:`CollisionChecker.excluded`, each with its reason.
    """
    arm, said = checker.arm, list(checker.scene.notes)
    by_remark: dict[str, dict[str, None]] = {}
    for body in checker.bodies:
        if body.remark:
            by_remark.setdefault(body.remark, {})[body.owner] = None
    said += [f"{_some(tuple(owners))}: {remark}" for remark, owners in by_remark.items()]
    how: dict[str, list[str]] = {}
    for pair in checker.finer:
        how.setdefault(f"judged by {pair.by}, since {pair.reason}", []).append(" and ".join(pair.owners))
    said += [f"{_some(pairs)}: {judged}" for judged, pairs in how.items()]
    solid = {body.link for body in checker.bodies if body.owner == body.link}
    if not solid:
        said.append("the robot has no collision geometry: its links touch nothing")
    elif drawn := [link for link in dict.fromkeys(g.link for g in arm.robot.urdf.visuals) if link not in solid]:
        said.append(f"{_some(drawn)}: drawn, but without collision geometry, so touching nothing")
    if changed := [file.path.name for file in changed_files(checker)]:
        said.append(f"{_some(changed)}: changed after the checker had read it; make a new checker")
    if arm.held:
        said.append(f"joints outside the arm stand still: {_some([f'{n} = {v:g}' for n, v in arm.held.items()])}")
    return tuple(dict.fromkeys(said))


def _some(names: Sequence[str]) -> str:
    more = f", ... ({len(names)} in all)" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more
