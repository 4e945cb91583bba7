"""Where picks come from: a list, a grid, a table on disk; any stretch of them can be asked for, none need be held."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from math import prod
from typing import Protocol

from pinproof.common.content_hash import digest, digest_many
from pinproof.errors import InputError
from pinproof.picks.pick import Pick, PickProblem, Picks
from pinproof.spatial import SE3, finite

__all__ = ["PickGrid", "PickList", "PickSource", "as_source"]


class Part(Protocol):
    """A stretch of picks, which pickles to little; they are made where they are looked at."""

    def __iter__(self) -> Iterator[Pick | PickProblem]: ...


class PickSource(ABC):
    """Picks in an order. A row that makes no pick is a :class:`PickProblem` in its place, and stops nobody."""

    shared: Picks
    """What the picks share: tip, tool, margin, home, and the robot and the scene if they are named. It lists none."""

    @abstractmethod
    def __len__(self) -> int:
        """How many there are."""

    @abstractmethod
    def part(self, start: int, stop: int) -> Iterable[Pick | PickProblem]:
        """Those from place ``start`` up to ``stop``; it pickles."""

    @abstractmethod
    def digest(self) -> str:
        """A hash of all of them."""

    def load(self) -> Picks:
        """All of them at once, as a list."""
        items = list(self.part(0, len(self)))
        picks = tuple(item for item in items if isinstance(item, Pick))
        return replace(
            self.shared, picks=picks, problems=tuple(item for item in items if isinstance(item, PickProblem))
        )


class PickList(PickSource):
    """Picks that are held in memory; rows that could not be read stand behind them."""

    def __init__(self, picks: Picks) -> None:
        self.shared = replace(picks, picks=(), problems=())
        self._items: tuple[Pick | PickProblem, ...] = (*picks.picks, *picks.problems)

    def __len__(self) -> int:
        return len(self._items)

    def part(self, start: int, stop: int) -> Iterable[Pick | PickProblem]:
        """Those from place ``start`` up to ``stop``."""
        return self._items[start:stop]

    def digest(self) -> str:
        """A hash of all of them."""
        return digest_many(self._items)


@dataclass(frozen=True, eq=False)
class PickGrid(PickSource):
    """Copies of one pick, set off along the axes of the robot's root link: bolts in rows, a volume to be tried.

    They are named after the first and their place: ``bolt_0_2_1``. The last axis runs fastest.

    Parameters
    ----------
    first
        The pick at the corner of the grid.
    counts
        How many along x, y and z; 1 or more each.
    step
        (3,) metres between neighbours along x, y and z.
    shared
        What the picks share.
    """

    first: Pick
    counts: tuple[int, int, int]
    step: tuple[float, float, float]
    shared: Picks = field(default_factory=lambda: Picks(()))

    def __post_init__(self) -> None:
        counts = tuple(self.counts)
        if len(counts) != 3 or not all(isinstance(n, int) and not isinstance(n, bool) and n > 0 for n in counts):
            raise InputError(f"counts of a grid are three whole numbers above 0, not {self.counts!r}")
        object.__setattr__(self, "counts", counts)
        object.__setattr__(self, "step", tuple(finite("step of a grid", self.step, (3,)).tolist()))
        object.__setattr__(self, "shared", replace(self.shared, picks=(), problems=()))

    def __len__(self) -> int:
        return prod(self.counts)

    def part(self, start: int, stop: int) -> Iterable[Pick | PickProblem]:
        """Those from place ``start`` up to ``stop``."""
        return _GridPart(self.first, self.counts, self.step, start, min(stop, len(self)))

    def digest(self) -> str:
        """A hash of all of them."""
        return digest((self.first, self.counts, self.step))


@dataclass(frozen=True, eq=False)
class _GridPart:
    first: Pick
    counts: tuple[int, int, int]
    step: tuple[float, float, float]
    start: int
    stop: int

    def __iter__(self) -> Iterator[Pick]:
        _, along_y, along_z = self.counts
        corner = self.first.pose
        for index in range(self.start, self.stop):
            row, k = divmod(index, along_z)
            i, j = divmod(row, along_y)
            shift = [n * step for n, step in zip((i, j, k), self.step, strict=True)]
            placed = SE3(corner.rotation, corner.translation + shift)
            yield replace(self.first, name=f"{self.first.name}_{i}_{j}_{k}", pose=placed)


def as_source(picks: Picks | PickSource) -> PickSource:
    """A list of picks as a source; a source is handed back as it is."""
    return PickList(picks) if isinstance(picks, Picks) else picks
