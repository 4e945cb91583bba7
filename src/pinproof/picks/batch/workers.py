"""The worker pool: runs a task for all picks, chunk by chunk, with any executor, and finds a pick that kills workers.

A worker process keeps the task between chunks, so that it is transferred once per process instead of once per chunk. A
chunk is sent with the key of its task. A worker that does not know the task reports this, and the chunk is sent again
together with the task. This requires only ``submit`` of an executor, so it is the same for local processes and for a
cluster whose workers join and leave.
"""

from __future__ import annotations

import hashlib
import math
import multiprocessing
import os
import pickle
import platform
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from pinproof.common.validation import require_integer
from pinproof.errors import CampaignError, InputError

__all__ = [
    "IN_FLIGHT",
    "MAX_DEATHS",
    "Answer",
    "Chunk",
    "ChunkQueue",
    "Outcome",
    "SingleWorkerExecutor",
    "Task",
    "TaskPackage",
    "TrackedExecutor",
    "Workers",
    "do_chunks",
    "usable_cores",
    "work",
]

Task = Callable[[int, Any], Any]
"""What is done with a chunk: ``task(start, part)``, ``part`` being the picks from place ``start`` on. It pickles."""

KEPT = 4
"""How many tasks a process keeps: a cluster may serve more than one campaign at a time."""

_known: dict[str, Task] = {}
"""The tasks of this process by their keys: a cache, from which no answer depends."""


class Answer(NamedTuple):
    """What a worker sends back."""

    known: bool
    """Whether it knew the task; if not, nothing was done."""
    result: Any = None
    seconds: float = 0.0
    worker: str = ""
    """Host and process."""


def work(key: str, package: bytes | None, start: int, part: Any) -> Answer:
    """Do one chunk.

    Parameters
    ----------
    key
        Names the task.
    package
        The task, pickled; None where the worker is thought to know it.
    start, part
        What the task is called with; nothing is done but to learn the task where ``part`` is None.
    """
    here = f"{platform.node()}:{os.getpid()}"
    task = _known.get(key)
    if task is None:
        if package is None:
            return Answer(known=False, worker=here)
        while len(_known) >= KEPT:
            _known.pop(next(iter(_known)), None)  # the oldest; another thread may be quicker
        task = _known[key] = pickle.loads(package)
    begun = time.perf_counter()
    result = None if part is None else task(start, part)
    return Answer(True, result, time.perf_counter() - begun, here)


class SingleWorkerExecutor(ProcessPoolExecutor):
    """An executor of one process.

    Several of these stand in for one pool of several processes: when a process dies, the others live on, and what it
    was doing is known. Processes are spawned: a child forked from a process that has used OpenMP hangs.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        # The worker holds the other end: it reads an end of file when this process lets go of it or is no more. Without
        # it, the workers of a killed campaign would wait for ever for their next chunk.
        parent_end, self._child_end = context.Pipe(duplex=False)
        super().__init__(1, mp_context=context, initializer=_watch_parent, initargs=(parent_end,))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hand over a call; the first starts the process."""
        # Ctrl-C goes to the whole group of processes. Who started the campaign acts on it; a worker is started with it
        # blocked, so that it does not complain, not even while it is still loading. The tracker of multiprocessing
        # unblocks it when it starts, so that goes first.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the process: after its work if ``wait``, else at once."""
        if not wait:
            self._child_end.close()
        super().shutdown(wait=wait, cancel_futures=cancel_futures)
        self._child_end.close()


def _watch_parent(parent_end: Connection) -> None:
    threading.Thread(target=_exit_with_parent, args=(parent_end,), daemon=True).start()


def _exit_with_parent(parent_end: Connection) -> None:
    try:
        parent_end.recv()  # nothing is ever sent
    except (EOFError, OSError):
        os._exit(1)


def usable_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
                    raise CampaignError(f"the workers cannot load the task: {_told(error)}") from error
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
                f"the executor broke ({_told(error)}); pass a function that creates executors instead "
                "of an executor, so that a broken one can be replaced"
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
                f"no worker starts ({_told(error)}); see its output on stderr. A program that starts processes must "
                "protect its main part with: if __name__ == '__main__'"
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
        raise InputError("workers is the number of local processes and cannot be combined with an executor")
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
                f"every worker process died on each of the first {MAX_CRASHES_FIRST} picks, so the picks are probably "
                "not the cause; check that the workers have enough memory"
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
            f"the task cannot be sent to a worker ({error}); functions must be importable by name"
        ) from error
    return TaskPackage(hashlib.sha256(package).hexdigest(), package, part)
