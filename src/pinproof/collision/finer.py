"""Closer geometry for pairs that touch by their hulls although the links themselves do not."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from pinproof.collision.links import DECOMPOSED, EXACT

__all__ = ["finer_levels"]

Pair = frozenset[str]
Levels = Mapping[Pair, int]


def finer_levels(touching: Callable[[Levels], Collection[Pair]], levels: Levels) -> dict[Pair, int]:
    """The levels at which pairs of owners have to be judged so that only those touch whose exact meshes do.

    Each pair takes the coarsest level on which it does not touch: several hulls are still convex, and compiled. A pair
    that touches on every level stays on its own: the contact is real, and finer bodies would only cost time.

    Parameters
    ----------
    touching
        The pairs of owners in contact, and worth judging more finely, where pairs are judged on given levels.
    levels
        Those that pairs are judged on now, where it is not as told.
    """
    found = dict(levels)
    open_pairs = set(touching(levels))
    for level in (DECOMPOSED, EXACT):
        if raised := {pair for pair in open_pairs if found.get(pair, 0) < level}:
            found.update(dict.fromkeys(raised, level))
            open_pairs &= set(touching(found))
    for pair in open_pairs:
        found.pop(pair)
        if pair in levels:
            found[pair] = levels[pair]
    return found
