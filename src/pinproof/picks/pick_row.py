"""One row of a picks file, of whatever kind: what it states, with the defaults filled in, becomes a pick."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pinproof.collision.shape_file import numbers_of
from pinproof.errors import InputError
from pinproof.picks.pick import Pick
from pinproof.spatial import pose

__all__ = ["DEFAULT_KEYS", "PICK_KEYS", "POSE_KEYS", "is_turned", "make_pick", "pick_of_row"]

POSE_KEYS = ("xyz", "rpy", "quat_xyzw")
DEFAULT_KEYS = (*POSE_KEYS, "approach", "retreat", "retreat_direction")
PICK_KEYS = ("name", *DEFAULT_KEYS)


def pick_of_row(name: str, row: Mapping[str, Any], defaults: Mapping[str, Any]) -> Pick:
    """The pick that a row states.

    Raises
    ------
    InputError
        If it makes none; says why.
    """
    # An orientation of its own, however it is written, goes before the default one; two of its own are refused.
    given = {key: value for key, value in defaults.items() if not (is_turned(row) and key in ("rpy", "quat_xyzw"))}
    stated = {**given, **row}
    if "xyz" not in stated:
        raise InputError("does not state its xyz")
    if not is_turned(stated):
        raise InputError("states no orientation: give it rpy or quat_xyzw, or the defaults")
    return make_pick(name, stated)


def is_turned(stated: Mapping[str, Any]) -> bool:
    """Whether an orientation is stated."""
    return "rpy" in stated or "quat_xyzw" in stated


def make_pick(name: str, stated: Mapping[str, Any]) -> Pick:
    """A pick of what is stated under :data:`DEFAULT_KEYS`."""
    numbers = {key: numbers_of(key, stated[key]) for key in DEFAULT_KEYS if key in stated}
    placed = pose(**{key: numbers.pop(key) for key in POSE_KEYS if key in numbers})
    return Pick(name, placed, **numbers)
