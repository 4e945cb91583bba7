"""The worker pool: does a task for all picks, chunk by chunk, with any executor; finds the pick that kills workers."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from dataclasses import dataclass
from typing import Any

from pinproof.common.validation import require_integer
from pinproof.errors import CampaignError, InputError
from pinproof.picks.campaign.chunks import MAX_DEATHS, Chunk, ChunkQueue, Outcome
from pinproof.picks.campaign.worker import Answer, SingleWorkerExecutor, Task, usable_cores, work

__all__ = ["IN_FLIGHT", "TaskPackage", "TrackedExecutor", "Workers", "do_chunks"]

FAILED_STARTS = 3
"""How many executors in a row may break before they have received the task; then the run ends with an error."""


@dataclass(frozen=True)
class TaskPackage:
    """What goes to the workers: the pickled task under its key, and the picks of a chunk."""

    key: str
    package: bytes
    part: Callable[[int, int], Any]


class TrackedExecutor:
    """Submits chunks to one executor, and finds the chunk that breaks it.

    If several chunks were pending in an executor that broke, any of them may be the cause. They are submitted again in
    groups with no others beside them, and a group that breaks the executor is halved, until it is a single chunk: the
    death is attributed to that chunk. All other chunks are completed on the way. New chunks wait until then.

    Parameters
    ----------
    make
        Makes the executor. Called again when it has broken.
    width
        How many chunks are pending at a time.
    callers_own
        The executor belongs to the caller: it is never shut down, and no other is made when it breaks.
    """

    def __init__(self, make: Callable[[], Executor], *, width: int, callers_own: bool = False) -> None:
        self._make, self._width, self._callers_own = make, width, callers_own
        self._executor: Executor | None = None
        self._ready = False
        self._group = self._failed_starts = 0
        self._suspects: list[list[Chunk]] = []
        self._told: set[str] = set()
        self.pending: dict[Future[Answer], Chunk | None] = {}
        """The pending chunks; None stands for the task alone, which is sent first to each executor."""

    def submit_chunks(self, queue: ChunkQueue, sent: TaskPackage) -> None:
        """Submit as many chunks as ``width`` allows."""
        if self._executor is None:
            if not self._suspects and not queue.left:
                return
            self._executor, self._ready = self._make(), False
            self._submit(self._executor, None, sent, packed=True)
        if not self._ready:
            return
        if not self.pending:
            group = self._suspects.pop() if self._suspects else []
            self._group = len(group)
            for chunk in group:
                self._submit(self._executor, chunk, sent)
        if self._group or self._suspects:
            return
        while len(self.pending) < self._width and (next_one := queue.take()) is not None:
            self._submit(self._executor, next_one, sent)

    def _submit(self, executor: Executor, chunk: Chunk | None, sent: TaskPackage, *, packed: bool = False) -> None:
        start, part = (0, None) if chunk is None else (chunk.start, sent.part(chunk.start, chunk.stop))
        try:
            future = executor.submit(work, sent.key, sent.package if packed else None, start, part)
        except BrokenExecutor as error:  # since it was last heard of: that is found out like any other break
            future = Future()
            future.set_exception(error)
        self.pending[future] = chunk

    def collect(self, future: Future[Answer], sent: TaskPackage) -> Iterator[Outcome]:
        """What came of a future that is done; if its executor broke, also of all that was under way beside it."""
        if future not in self.pending or self._executor is None:
            return  # it was under way in an executor that broke
        chunk = self.pending[future]
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
            del self.pending[future]
            yield from self._suspect(chunk, self._group == 1, MAX_DEATHS, error)
            return
        del self.pending[future]
        if chunk is None:
            self._ready, self._failed_starts = True, 0
        elif answer.known:
            yield Outcome(chunk.start, chunk.stop, answer.result, False, answer.seconds, answer.worker)
        else:
            # A worker that joins returns all that waits for it; to send the task with each of these would be a flood.
            packed = chunk.returned or answer.worker not in self._told
            self._told.add(answer.worker)
            chunk.returned = not packed
            self._submit(self._executor, chunk, sent, packed=packed)

    def _suspect(self, chunk: Chunk | None, certain: bool, deaths: int, error: BaseException) -> Iterator[Outcome]:
        """A chunk that was under way where workers died; ``certain`` if nothing else was under way."""
        if chunk is None:
            self._start_failed(error)
        elif certain:
            chunk.deaths += deaths
            if chunk.deaths < MAX_DEATHS:
                self._suspects.append([chunk])
            elif len(chunk) > 1:
                self._suspects += [[half] for half in reversed(chunk.halves())]
            else:
                yield Outcome(chunk.start, chunk.stop, crashed=True)
        else:
            self._suspects.append([chunk])

    def _broken(self, error: BaseException) -> Iterator[Outcome]:
        """Keep what was done in the executor that broke, let go of it, and line up what may have broken it."""
        wait(self.pending)
        failed: list[Chunk] = []
        for future, chunk in self.pending.items():
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
        self.pending.clear()
        if self._callers_own:
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
        if self._failed_starts >= FAILED_STARTS or self._callers_own:
            raise CampaignError(
                f"no worker starts ({_told(error)}); what it said is on stderr. A program that starts processes needs "
                "its main part under: if __name__ == '__main__'"
            ) from error

    def close(self, *, wait_for_it: bool = False) -> None:
        """Give up what is under way; let go of the executor."""
        for future in self.pending:
            future.cancel()
        self.pending.clear()
        executor, self._executor = self._executor, None
        if executor is not None and not self._callers_own:
            executor.shutdown(wait=wait_for_it)


def _told(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _killed_workers(error: Exception) -> bool:
    """Whether Dask gave up a task because its workers died, on which it has tried it several times itself."""
    return type(error).__name__ == "KilledWorker" and type(error).__module__.startswith("distributed.")


MAX_CRASHES_FIRST = 10
"""How many picks in a row may be crash_filter for dead workers while not one was judged."""

Workers = Executor | Callable[[], Executor]
"""An executor, or what makes one: then a broken one is made anew."""

IN_FLIGHT = 64
"""How many chunks are under way at a time in an executor of the caller's, which cannot be asked for its workers: enough
for 32 of them to find the next chunk waiting."""


def do_chunks(
    task: Task,
    part: Callable[[int, int], Any],
    ranges: Iterable[tuple[int, int]],
    *,
    executor: Workers | None = None,
    workers: int | None = None,
    in_flight: int = IN_FLIGHT,
    chunk: int | None = None,
) -> Generator[Outcome, None, None]:
    """Do ``task(start, part(start, stop))`` for chunks that cover the ranges, in the order in which they end.

    Parameters
    ----------
    task
        Goes to each worker once; it pickles.
    part
        Gives what goes with the picks from ``start`` up to ``stop``; it pickles too.
    ranges
        (start, stop) of what is to be done.
    executor
        Where; by default ``workers`` processes of this machine.
    workers
        How many processes, without an executor; by default one a core.
    in_flight
        How many chunks are under way at a time in ``executor``.
    chunk
        How many picks make a chunk; by default about a second of work.

    Raises
    ------
    CampaignError
        If no worker starts, if all workers die whatever they are given, or if an executor that cannot be made anew
        breaks.
    InputError
        If the task cannot be sent to a worker.
    Exception
        Whatever the task raised.
    """
    require_integer("in_flight", in_flight, 1)
    if chunk is not None:
        require_integer("chunk", chunk, 1)
    if executor is None:
        count = usable_cores() if workers is None else workers
        require_integer("workers", count, 1)
        executors = [TrackedExecutor(SingleWorkerExecutor, width=1) for _ in range(count)]
    elif workers is not None:
        raise InputError("workers counts the processes of this machine; the executor that is given has its own")
    elif isinstance(executor, Executor):
        executors = [TrackedExecutor(lambda: executor, width=in_flight, callers_own=True)]
    else:
        executors = [TrackedExecutor(executor, width=in_flight)]
    sent = _packed(task, part)
    queue = ChunkQueue(ranges, in_flight if executor is not None else len(executors), chunk)
    finished, crash_filter = False, _CrashFilter()
    try:
        while True:
            for tracked in executors:
                tracked.submit_chunks(queue, sent)
            pending = [future for tracked in executors for future in tracked.pending]
            if not pending:
                finished = True
                yield from crash_filter.all()
                return
            done = wait(pending, return_when=FIRST_COMPLETED).done
            for tracked in executors:
                for future in [future for future in tracked.pending if future in done]:
                    for outcome in tracked.collect(future, sent):
                        if not outcome.crashed:
                            queue.learn(outcome.stop - outcome.start, outcome.seconds)
                        yield from crash_filter.passed_on(outcome)
    finally:
        for tracked in executors:
            tracked.close(wait_for_it=finished)


class _CrashFilter:
    """Holds back crashed picks until another pick was judged: if none is, the picks are hardly what kills workers."""

    def __init__(self) -> None:
        self._kept: list[Outcome] = []
        self._some_judged = False

    def passed_on(self, outcome: Outcome) -> Iterator[Outcome]:
        """The outcomes that can be reported now."""
        self._some_judged = self._some_judged or not outcome.crashed
        self._kept.append(outcome)
        if self._some_judged:
            yield from self.all()
        elif len(self._kept) >= MAX_CRASHES_FIRST:
            raise CampaignError(
                f"each of the first {MAX_CRASHES_FIRST} picks has killed every process that judged it, and none was "
                "judged: the picks are hardly the cause; is there enough memory for a worker?"
            )

    def all(self) -> Iterator[Outcome]:
        """All outcomes that were held back."""
        kept, self._kept = self._kept, []
        yield from kept


def _packed(task: Task, part: Callable[[int, int], Any]) -> TaskPackage:
    try:
        package = pickle.dumps(task, protocol=pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"what is to be done cannot be sent to a worker ({error}); functions must be importable by name"
        ) from error
    return TaskPackage(hashlib.sha256(package).hexdigest(), package, part)
