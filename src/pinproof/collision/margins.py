"""How far bodies must stay apart: one distance for all, others for single pairs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from pinproof.errors import InputError, UnknownNameError

__all__ = ["Margins", "checked_margin"]

Array = npt.NDArray[np.float64]


class Margins:
    """A margin for every two owners of bodies (links, attached objects, obstacles).

    Parameters
    ----------
    common
        Metres.
    single
        Metres for pairs of owners, in either order, in place of the common ones.

    Raises
    ------
    InputError
        If one is negative or not finite, or a pair is not two names.
    """

    def __init__(self, common: float, single: Mapping[tuple[str, str], float]) -> None:
        self.common = checked_margin("margin", common)
        self.single: dict[frozenset[str], float] = {}
        for pair, margin in single.items():
            names = frozenset(pair) if isinstance(pair, tuple) else frozenset()
            if len(names) != 2 or len(pair) != 2:
                raise InputError(f"margins has the key {pair!r}; it must be two names")
            self.single[names] = checked_margin(f"margins[{pair!r}]", margin)

    def of(self, owners: Iterable[tuple[str, str]], count: int, names: Sequence[str]) -> Array:
        """(P,) the margins of ``count`` pairs of owners, which are only looked at where single pairs have their own.

        Raises
        ------
        UnknownNameError
            If a single margin is for a name that is not among ``names``.
        """
        for pair in self.single:
            for name in sorted(pair):
                if name not in names:
                    raise UnknownNameError("body", name, names, "margins")
        if not self.single:
            return np.full(count, self.common)
        return np.array([self.single.get(frozenset(pair), self.common) for pair in owners], dtype=float)

    def under(self, common: float) -> Margins:
        """The same margins of single pairs, another one for all others."""
        other = Margins(common, {})
        other.single = dict(self.single)
        return other

    def padded(self, by: float) -> Margins:
        """All margins larger by this (m)."""
        more = checked_margin("by", by)
        other = Margins(self.common + more, {})
        other.single = {pair: margin + more for pair, margin in self.single.items()}
        return other

    def without(self, names: set[str]) -> Margins:
        """The margins but those of pairs with one of these names."""
        other = Margins(self.common, {})
        other.single = {pair: margin for pair, margin in self.single.items() if not names & pair}
        return other

    def __repr__(self) -> str:
        single = sorted((*sorted(pair), margin) for pair, margin in self.single.items())
        return f"Margins({self.common!r}, {single!r})"


def checked_margin(name: str, margin: float) -> float:
    """A margin as a number.

    Raises
    ------
    InputError
        If it is negative, not finite, or no number.
    """
    try:
        value = float(margin)
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value) or value < 0:
        raise InputError(f"{name} = {margin}; it is a distance in metres, 0 or more")
    return value
