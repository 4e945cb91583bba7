"""The allowed-collision matrix of a MoveIt planning scene."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

from pinproof.collision.scene import ANYTHING
from pinproof.errors import SceneError

__all__ = ["allowed_pairs"]

OCTOMAP = "<octomap>"

Pairs = list[tuple[str, str]]


def allowed_pairs(path: Path, matrix: Mapping[str, Any], parts: Mapping[str, tuple[str, ...]]) -> tuple[Pairs, Pairs]:
    """Who may touch, by (robot link, obstacle), and the pairs of robot links that the matrix disables.

    An entry of the matrix stands before the defaults, and a pair of two defaults needs both, as in MoveIt
    (``AllowedCollisionMatrix::getAllowedCollision``). A pair whose two entries differ is not allowed.

    Parameters
    ----------
    parts
        The obstacles that each object of the file became; every other name is taken for a robot link.

    Raises
    ------
    SceneError
        If the matrix is not square.
    """
    names = [str(name) for name in matrix.get("entry_names") or []]
    rows: list[Any] = [
        row.get("enabled") if isinstance(row, Mapping) else row for row in matrix.get("entry_values") or []
    ]
    if len(rows) != len(names) or any(not isinstance(row, list) or len(row) != len(names) for row in rows):
        raise SceneError(
            path, "entry_values is not square with a row for each of entry_names", "allowed_collision_matrix"
        )
    told = {
        frozenset((names[i], names[j])): rows[i][j] is True and rows[j][i] is True
        for i, j in combinations(range(len(names)), 2)
    }
    default_names, values = matrix.get("default_entry_names") or [], matrix.get("default_entry_values") or []
    if len(default_names) != len(values):
        raise SceneError(path, "default_entry_values has another length than its names", "allowed_collision_matrix")
    defaults = {str(name): value is True for name, value in zip(default_names, values, strict=True)}
    links = sorted({*names, *defaults} - set(parts) - {OCTOMAP})

    def may_touch(a: str, b: str) -> bool:
        by_default = [defaults[name] for name in (a, b) if name in defaults]
        return told.get(frozenset((a, b)), bool(by_default) and all(by_default))

    allowed: Pairs = []
    for thing, pieces in parts.items():
        touching = [link for link in links if may_touch(link, thing)]
        if defaults.get(thing, False):
            if len(touching) < len(links):
                refused = ", ".join(link for link in links if link not in touching)
                reason = f"lets {thing!r} touch anything by default, but not {refused}: name the links it may touch"
                raise SceneError(path, reason, "allowed_collision_matrix")
            touching = [ANYTHING]
        allowed += [(link, piece) for piece in pieces for link in touching]
    return allowed, [(a, b) for a, b in combinations(links, 2) if may_touch(a, b)]
