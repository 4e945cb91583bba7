"""The worker pool: runs a task for all picks in chunks with any executor, and isolates picks that kill workers.

A worker process keeps the task between chunks, so that it is transferred once per process instead of once per chunk. A
chunk is sent with the key of its task. A worker without this task reports that it is missing, and the chunk is sent
again together with the task. Only the method ``submit`` of an executor is required, so this works both with local
processes and with a cluster whose workers join and leave.
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

Task = Callable[[int, Any], Any]
"""A picklable function ``task(start, part)``; ``part`` has the picks of a chunk, the first with index ``start``."""

KEPT = 4
"""Number of tasks that a process keeps; a cluster may run several campaigns at a time."""

_known: dict[str, Task] = {}
"""The tasks of this process by key; a cache that does not affect results."""


class Answer(NamedTuple):
    """The reply of a worker, its host and process; if it did not know the task, nothing was computed."""

    known: bool
    result: Any = None
    seconds: float = 0.0
    worker: str = ""


def work(key: str, package: bytes | None, start: int, part: Any) -> Answer:
    """Run the task with a key for one chunk; ``package`` is the pickled task, None if the worker should have it.

    With None as ``part``, the task is only stored.
    """
    here = f"{platform.node()}:{os.getpid()}"
    task = _known.get(key)
    if task is None:
        if package is None:
            return Answer(known=False, worker=here)
        while len(_known) >= KEPT:
            _known.pop(next(iter(_known)), None)  # the oldest; another thread may have removed it
        task = _known[key] = pickle.loads(package)
    start_time = time.perf_counter()
    result = None if part is None else task(start, part)
    return Answer(True, result, time.perf_counter() - start_time, here)


class LocalExecutor(ProcessPoolExecutor):
    """An executor with local processes, by default one.

    Several executors of one process replace one pool of several processes: if a process dies, the others are not
    affected, and its chunk is known. Processes are spawned, because a child forked from a process that has used OpenMP
    can hang.
    """

    def __init__(self, processes: int = 1) -> None:
        context = multiprocessing.get_context("spawn")
        # The worker reads from its end of the pipe and receives end-of-file when this process closes the other end or
        # dies. Without the pipe, the workers of a killed campaign would wait for their next chunk indefinitely.
        parent_end, self._child_end = context.Pipe(duplex=False)
        super().__init__(processes, mp_context=context, initializer=_watch_parent, initargs=(parent_end,))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call; the first call starts the process."""
        # Ctrl-C sends SIGINT to the complete process group, but only the main process must handle it. Workers are
        # started with SIGINT blocked, so that they print no traceback, not even while they import modules. The resource
        # tracker of multiprocessing unblocks the signal when it starts, so it is started first.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the process: after its pending calls if ``wait``, otherwise immediately."""
        if not wait:
            self._child_end.close()
        # Without its end of the pipe the process ends at once, so that this does not wait long either. At the exit of
        # the interpreter, Python would otherwise wake a thread of the pool that may be closing its pipe (CPython 3.11).
        super().shutdown(wait=True, cancel_futures=cancel_futures)
        self._child_end.close()


def _watch_parent(parent_end: Connection) -> None:
    """End this process when the other end of the pipe is closed."""

    def exit_with_parent() -> None:
        try:
            parent_end.recv()  # nothing is ever sent
        except (EOFError, OSError):
            os._exit(1)

    threading.Thread(target=exit_with_parent, daemon=True).start()


MAX_DEATHS = 3
"""Number of workers that must die on a chunk before it is halved, and on a single pick before it is reported as
crashed. A single death may have another cause, such as other processes that exhaust the memory."""

CHUNK_SECONDS = 1.0
"""Target duration of a chunk: long compared to the overhead of some ms, and short enough to lose little work."""

LARGEST = 1024
"""Largest number of picks in a chunk, so that all pending chunks fit into memory."""

GROWTH = 4
"""Largest factor between the sizes of the last measured chunk and of the next one. Measurements vary, because the first
chunk also loads compiled code and picks differ in cost."""


@dataclass(eq=False)
class Chunk:
    """The picks with indices from ``start`` (included) to ``stop`` (excluded).

    ``deaths`` is the number of workers that died on the chunk; ``returned`` is True if a worker without the task
    returned it.
    """

    start: int
    stop: int
    deaths: int = 0
    returned: bool = False

    def __len__(self) -> int:
        return self.stop - self.start

    def halves(self) -> list[Chunk]:
        """Both halves. One more death halves a half again; for a single pick, deaths are counted from zero."""
        middle = (self.start + self.stop + 1) // 2
        halves = [Chunk(self.start, middle), Chunk(middle, self.stop)]
        for half in halves:
            half.deaths = MAX_DEATHS - 1 if len(half) > 1 else 0
        return halves


@dataclass(frozen=True)
class Outcome:
    """The result of the picks with indices from ``start`` (included) to ``stop`` (excluded).

    ``crashed`` means that this is a single pick, and that every worker that processed it alone died; there is then no
    ``result``.
    """

    start: int
    stop: int
    result: Any = None
    crashed: bool = False
    seconds: float = 0.0
    worker: str = ""


def _outcome(chunk: Chunk, answer: Answer) -> Outcome:
    return Outcome(chunk.start, chunk.stop, answer.result, False, answer.seconds, answer.worker)


class ChunkQueue:
    """Divides ranges (start, stop) of picks into chunks of about :data:`CHUNK_SECONDS`, or of a fixed ``size``.

    The division does not affect any result, because each pick is judged independently. Chunks become smaller towards
    the end to keep all workers busy; ``slots`` is the number of chunks that may be pending.
    """

    def __init__(self, ranges: Iterable[tuple[int, int]], slots: int, size: int | None = None) -> None:
        self._ranges = [(start, stop) for start, stop in ranges if stop > start][::-1]
        self.left = sum(stop - start for start, stop in self._ranges)
        self._slots, self._fixed, self._size = slots, size, 1

    def take(self) -> Chunk | None:
        """The next chunk; None if no picks are left."""
        if not self._ranges:
            return None
        # Small chunks at the end keep all workers busy
        size = self._fixed or max(1, min(self._size, math.ceil(self.left / (2 * self._slots))))
        start, stop = self._ranges.pop()
        cut = min(stop, start + size)
        if cut < stop:
            self._ranges.append((cut, stop))
        self.left -= cut - start
        return Chunk(start, cut)

    def learn(self, picks: int, seconds: float) -> None:
        """Adapt the size of chunks to the measured duration of one."""
        # The size follows the measured speed, by limited steps
        wanted = int(picks * CHUNK_SECONDS / max(seconds, 1e-6))
        self._size = max(1, min(LARGEST, max(wanted, picks // GROWTH), picks * GROWTH))


FAILED_STARTS = 3
"""Number of consecutive executors that may break before they have received the task; the run then fails."""


class TaskPackage(NamedTuple):
    """The data sent to workers: the pickled task with its key, and a function that gives the picks of a chunk."""

    key: str
    package: bytes
    part: Callable[[int, int], Any]


class TrackedExecutor:
    """Submits chunks to one executor, and identifies a chunk that breaks it.

    If several chunks were pending in an executor that broke, any of them may be the cause. They are submitted again in
    groups, one group at a time. A group that breaks the executor is halved until it is a single chunk, and the death is
    attributed to that chunk. All other chunks are completed in the process. New chunks wait until then.

    ``make`` creates the executor, also after it has broken, and ``width`` chunks are pending at a time. An executor of
    the caller (``callers_own``) is never shut down, and not replaced if it breaks.
    """

    def __init__(self, make: Callable[[], Executor], *, width: int, callers_own: bool = False) -> None:
        self._make, self._width, self._callers_own = make, width, callers_own
        self._executor: Executor | None = None
        self._task = ""  # the key of the task that the executor has received or is about to
        self._ready = False
        self._group = self._failed_starts = 0
        self._suspects: list[list[Chunk]] = []
        self._workers_with_task: set[str] = set()
        self.pending: dict[Future[Answer], Chunk | None] = {}
        """The pending chunks; None represents the task alone, which is sent first to each executor."""

    def submit_chunks(self, queue: ChunkQueue, sent: TaskPackage) -> None:
        """Submit as many chunks as ``width`` allows."""
        # A new executor receives the task alone first, so that a task that kills workers is known as the cause
        if self._executor is None or self._task != sent.key:
            if not self._suspects and not queue.left:
                return
            self._executor = self._executor or self._make()
            self._task, self._ready = sent.key, False
            self._workers_with_task.clear()
            self._submit(self._executor, None, sent, packed=True)
        if not self._ready:
            return
        # Suspects run in groups, one at a time; new chunks wait until the cause is known
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
        except BrokenExecutor as error:  # broke while idle; handled in collect
            future = Future()
            future.set_exception(error)
        self.pending[future] = chunk

    def collect(self, future: Future[Answer], sent: TaskPackage) -> Iterator[Outcome]:
        """The outcomes of a finished future; if its executor broke, also those of all other pending futures."""
        if future not in self.pending or self._executor is None:
            return  # it was pending in an executor that broke
        # A broken executor concerns all pending chunks; an error of a cluster only this one
        chunk = self.pending[future]
        try:
            answer = future.result()
        except (BrokenExecutor, CancelledError) as error:
            yield from self._broken(error)
            return
        except Exception as error:
            # Dask gives up a task after it has retried it several times because its workers died
            if type(error).__name__ != "KilledWorker" or not type(error).__module__.startswith("distributed."):
                if chunk is None:
                    raise CampaignError(f"the workers cannot load the task: {_error_text(error)}") from error
                raise
            del self.pending[future]
            yield from self._suspect(chunk, self._group == 1, MAX_DEATHS, error)
            return
        del self.pending[future]
        if chunk is None:
            self._ready, self._failed_starts = True, 0
        elif answer.known:
            yield _outcome(chunk, answer)
        else:
            # A new worker returns all chunks queued for it; the task is large, so it is sent with only one of them.
            packed = chunk.returned or answer.worker not in self._workers_with_task
            self._workers_with_task.add(answer.worker)
            chunk.returned = not packed
            self._submit(self._executor, chunk, sent, packed=packed)

    def _suspect(self, chunk: Chunk | None, certain: bool, deaths: int, error: BaseException) -> Iterator[Outcome]:
        """Handle a chunk that was pending when workers died; ``certain`` if no other chunk was pending."""
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
        """Keep the results of the broken executor, close it, and queue the chunks that may have broken it."""
        wait(self.pending)
        failed: list[Chunk] = []
        for future, chunk in self.pending.items():
            try:
                answer = future.result()
            except Exception:  # noqa: BLE001  # any other error recurs when the chunk is submitted again
                if chunk is None:
                    self._start_failed(error)
                else:
                    failed.append(chunk)
            else:
                if chunk is not None and answer.known:
                    yield _outcome(chunk, answer)
                elif chunk is not None:
                    failed.append(chunk)
        self.pending.clear()
        if self._callers_own:
            raise CampaignError(
                f"the executor broke ({_error_text(error)}); pass a function that creates executors instead "
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
                f"no worker starts ({_error_text(error)}); see its output on stderr. A program that starts processes "
                "must protect its main part with: if __name__ == '__main__'"
            ) from error

    def close(self, *, wait_for_it: bool = False) -> None:
        """Cancel all pending chunks and release the executor."""
        for future in self.pending:
            future.cancel()
        self.pending.clear()
        executor, self._executor = self._executor, None
        if executor is not None and not self._callers_own:
            executor.shutdown(wait=wait_for_it)


class LocalWorkers:
    """Local processes that are kept until :meth:`close` for any number of calls of :func:`do_chunks`."""

    def __init__(self, count: int) -> None:
        require_integer("workers", count, 1)
        self.executors = [TrackedExecutor(LocalExecutor, width=1) for _ in range(count)]

    def close(self, *, wait_for_them: bool) -> None:
        """End the processes."""
        for tracked in self.executors:
            tracked.close(wait_for_it=wait_for_them)


def _error_text(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


MAX_CRASHES_FIRST = 10
"""Number of picks that may crash at the start of a run before any pick was judged; the run then fails."""

Workers = Executor | Callable[[], Executor]
"""An executor, or a function that creates one; in the latter case a broken executor is replaced."""

IN_FLIGHT = 64
"""Number of chunks that are pending at a time in an executor of the caller, whose number of workers is unknown. It is
sufficient for 32 workers, each with one more chunk queued."""


def do_chunks(
    task: Task,
    part: Callable[[int, int], Any],
    ranges: Iterable[tuple[int, int]],
    *,
    executor: Workers | LocalWorkers | None = None,
    workers: int | None = None,
    in_flight: int = IN_FLIGHT,
    chunk: int | None = None,
) -> Generator[Outcome, None, None]:
    """Run ``task(start, part(start, stop))`` for chunks that cover the ranges; yields in order of completion.

    The task, which is sent to each worker once, and the parts must be picklable. ``executor`` may also be local
    processes to keep. The other arguments are those of :meth:`pinproof.picks.Campaign.run`.

    Raises
    ------
    CampaignError
        If no worker starts, if workers die on each of the first picks, or if an executor breaks and cannot be
        replaced.
    InputError
        If the task cannot be sent to a worker.
    Exception
        Any exception raised by the task.
    """
    require_integer("in_flight", in_flight, 1)
    if chunk is not None:
        require_integer("chunk", chunk, 1)
    if executor is not None and workers is not None:
        raise InputError("workers is the number of local processes and cannot be combined with an executor")
    # The executors, each with its own pending chunks; those that the caller keeps are not closed
    kept = isinstance(executor, LocalWorkers)
    if executor is None:
        # By default, as many processes as cores that this process may use
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        executor = LocalWorkers(cores if workers is None else workers)
    slots = in_flight
    if isinstance(executor, LocalWorkers):
        executors, slots = executor.executors, len(executor.executors)
    elif isinstance(executor, Executor):
        executors = [TrackedExecutor(lambda: executor, width=in_flight, callers_own=True)]
    else:
        executors = [TrackedExecutor(executor, width=in_flight)]
    sent = _packed(task, part)
    queue = ChunkQueue(ranges, slots, chunk)
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
        if not (kept and finished):
            for tracked in executors:
                tracked.close(wait_for_it=finished)


class _CrashFilter:
    """Holds back crashed picks until another pick was judged; if none is, the picks are probably not the cause."""

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
        """The outcomes that were held back."""
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
