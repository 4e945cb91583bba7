"""Chunks of a campaign: stretches of picks that are handed out together."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

__all__ = ["MAX_DEATHS", "Chunk", "ChunkQueue", "Outcome"]

MAX_DEATHS = 3
"""How many workers must die of a chunk before it is halved, and of a single pick before it is said to kill them: one
death may come from outside, such as memory that others used up."""

CHUNK_SECONDS = 1.0
"""How long a chunk should take: the hand-over of some ms is nothing beside it, and little is lost with a worker."""

LARGEST = 1024
"""The most picks in a chunk, so that what is under way fits into memory."""

GROWTH = 4
"""How much larger or smaller than the last chunk measured the next may be: a first chunk also loads compiled code, and
picks differ."""


@dataclass(eq=False)
class Chunk:
    """The picks from ``start`` up to ``stop``.

    ``deaths``: how many workers have died of them. ``returned``: a worker that did not know the task has sent it back.
    """

    start: int
    stop: int
    deaths: int = 0
    returned: bool = False

    def __len__(self) -> int:
        return self.stop - self.start

    def halves(self) -> list[Chunk]:
        """Both halves. One more death halves a half again; a single pick has all of its own deaths before it."""
        middle = (self.start + self.stop + 1) // 2
        halves = [Chunk(self.start, middle), Chunk(middle, self.stop)]
        for half in halves:
            half.deaths = MAX_DEATHS - 1 if len(half) > 1 else 0
        return halves


@dataclass(frozen=True)
class Outcome:
    """What came of the picks from ``start`` up to ``stop``.

    ``crashed``: it is a single pick, and every worker that was given it alone has died; there is no ``result``.
    """

    start: int
    stop: int
    result: Any = None
    crashed: bool = False
    seconds: float = 0.0
    worker: str = ""


class ChunkQueue:
    """Cuts what is to be done into chunks of about :data:`CHUNK_SECONDS`.

    How picks are cut never shows in a result: each is judged by itself.

    Parameters
    ----------
    ranges
        (start, stop) of what is to be done, in order.
    slots
        How many chunks may be under way; towards the end chunks get smaller, so that all of them are busy to the last.
    size
        A fixed number of picks in a chunk, in place of a measured one.
    """

    def __init__(self, ranges: Iterable[tuple[int, int]], slots: int, size: int | None = None) -> None:
        self._ranges = [(start, stop) for start, stop in ranges if stop > start][::-1]
        self.left = sum(stop - start for start, stop in self._ranges)
        self._slots, self._fixed, self._size = slots, size, 1

    def take(self) -> Chunk | None:
        """The next chunk; None if all is handed out."""
        if not self._ranges:
            return None
        size = self._fixed or max(1, min(self._size, math.ceil(self.left / (2 * self._slots))))
        start, stop = self._ranges.pop()
        cut = min(stop, start + size)
        if cut < stop:
            self._ranges.append((cut, stop))
        self.left -= cut - start
        return Chunk(start, cut)

    def learn(self, picks: int, seconds: float) -> None:
        """Take note of how long a chunk took."""
        wanted = int(picks * CHUNK_SECONDS / max(seconds, 1e-6))
        self._size = max(1, min(LARGEST, max(wanted, picks // GROWTH), picks * GROWTH))
