"""An executor at work: what is under way in it, and which chunks it may have broken of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from dataclasses import dataclass
from typing import Any

from pinproof.errors import CampaignError
from pinproof.picks.campaign.chunks import DEADLY, Chunk, Outcome, Supply
from pinproof.picks.campaign.worker import Answer, work

__all__ = ["Lane", "Parcel"]

FAILED_STARTS = 3
"""How many executors in a row may break before they have learnt the task, until it is clear that none will."""


@dataclass(frozen=True)
class Parcel:
    """What goes to the workers: the pickled task under its key, and the picks of a chunk."""

    key: str
    package: bytes
    part: Callable[[int, int], Any]


class Lane:
    """Feeds one executor, and finds the chunk that breaks it.

    Where several chunks were under way in an executor that broke, any of them may be at fault. So they are tried again
    in groups with nothing beside them, halved until a group breaks that is a single chunk: to that the death is put
    down. The innocent are done on the way, and new chunks wait until the matter is settled.

    Parameters
    ----------
    make
        Makes the executor. Called again when it has broken.
    width
        How many chunks are under way at a time.
    borrowed
        The executor is the caller's: it is never shut down, and when it breaks there is no other.
    """

    def __init__(self, make: Callable[[], Executor], *, width: int, borrowed: bool = False) -> None:
        self._make, self._width, self._borrowed = make, width, borrowed
        self._executor: Executor | None = None
        self._ready = False
        self._group = self._failed_starts = 0
        self._suspects: list[list[Chunk]] = []
        self._told: set[str] = set()
        self.flying: dict[Future[Answer], Chunk | None] = {}
        """What is under way; None stands for the task alone, with which every executor is tried first."""

    def feed(self, supply: Supply, parcel: Parcel) -> None:
        """Hand out as much as there is room for."""
        if self._executor is None:
            if not self._suspects and not supply.left:
                return
            self._executor, self._ready = self._make(), False
            self._fly(self._executor, None, parcel, packed=True)
        if not self._ready:
            return
        if not self.flying:
            group = self._suspects.pop() if self._suspects else []
            self._group = len(group)
            for chunk in group:
                self._fly(self._executor, chunk, parcel)
        if self._group or self._suspects:
            return
        while len(self.flying) < self._width and (next_one := supply.take()) is not None:
            self._fly(self._executor, next_one, parcel)

    def _fly(self, executor: Executor, chunk: Chunk | None, parcel: Parcel, *, packed: bool = False) -> None:
        start, part = (0, None) if chunk is None else (chunk.start, parcel.part(chunk.start, chunk.stop))
        try:
            future = executor.submit(work, parcel.key, parcel.package if packed else None, start, part)
        except BrokenExecutor as error:  # since it was last heard of: that is found out like any other break
            future = Future()
            future.set_exception(error)
        self.flying[future] = chunk

    def land(self, future: Future[Answer], parcel: Parcel) -> Iterator[Outcome]:
        """What came of a future that is done; if its executor broke, also of all that was under way beside it."""
        if future not in self.flying or self._executor is None:
            return  # it was under way in an executor that broke
        chunk = self.flying[future]
        try:
            answer = future.result()
        except (BrokenExecutor, CancelledError) as error:
            yield from self._broken(error)
            return
        except Exception as error:
            if not _killed_workers(error):
                if chunk is None:
                    raise CampaignError(f"the workers cannot take the task: {_told(error)}") from error
                raise
            del self.flying[future]
            yield from self._suspect(chunk, self._group == 1, DEADLY, error)
            return
        del self.flying[future]
        if chunk is None:
            self._ready, self._failed_starts = True, 0
        elif answer.known:
            yield Outcome(chunk.start, chunk.stop, answer.result, False, answer.seconds, answer.worker)
        else:
            # A worker that joins returns all that waits for it; to send the task with each of these would be a flood.
            packed = chunk.returned or answer.worker not in self._told
            self._told.add(answer.worker)
            chunk.returned = not packed
            self._fly(self._executor, chunk, parcel, packed=packed)

    def _suspect(self, chunk: Chunk | None, certain: bool, deaths: int, error: BaseException) -> Iterator[Outcome]:
        """A chunk that was under way where workers died; ``certain`` if nothing else was under way."""
        if chunk is None:
            self._start_failed(error)
        elif certain:
            chunk.deaths += deaths
            if chunk.deaths < DEADLY:
                self._suspects.append([chunk])
            elif len(chunk) > 1:
                self._suspects += [[half] for half in reversed(chunk.halves())]
            else:
                yield Outcome(chunk.start, chunk.stop, crashed=True)
        else:
            self._suspects.append([chunk])

    def _broken(self, error: BaseException) -> Iterator[Outcome]:
        """Keep what was done in the executor that broke, let go of it, and line up what may have broken it."""
        wait(self.flying)
        failed: list[Chunk] = []
        for future, chunk in self.flying.items():
            try:
                answer = future.result()
            except Exception:  # noqa: BLE001  # what else ails a chunk shows when it is tried again
                if chunk is None:
                    self._start_failed(error)
                else:
                    failed.append(chunk)
            else:
                if chunk is not None and answer.known:
                    yield Outcome(chunk.start, chunk.stop, answer.result, False, answer.seconds, answer.worker)
                elif chunk is not None:
                    failed.append(chunk)
        self.flying.clear()
        if self._borrowed:
            raise CampaignError(
                f"the executor broke ({_told(error)}); give a function that makes one in place of the executor, so "
                "that another can be made"
            ) from error
        self.close()
        if len(failed) == 1:
            yield from self._suspect(failed[0], True, 1, error)
        elif failed:
            middle = (len(failed) + 1) // 2
            self._suspects += [failed[middle:], failed[:middle]]

    def _start_failed(self, error: BaseException) -> None:
        self._failed_starts += 1
        if self._failed_starts >= FAILED_STARTS or self._borrowed:
            raise CampaignError(
                f"no worker starts ({_told(error)}); what it said is on stderr. A program that starts processes needs "
                "its main part under: if __name__ == '__main__'"
            ) from error

    def close(self, *, wait_for_it: bool = False) -> None:
        """Give up what is under way; let go of the executor."""
        for future in self.flying:
            future.cancel()
        self.flying.clear()
        executor, self._executor = self._executor, None
        if executor is not None and not self._borrowed:
            executor.shutdown(wait=wait_for_it)


def _told(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _killed_workers(error: Exception) -> bool:
    """Whether Dask gave up a task because its workers died, on which it has tried it several times itself."""
    return type(error).__name__ == "KilledWorker" and type(error).__module__.startswith("distributed.")
