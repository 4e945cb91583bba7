"""What runs in a worker: the task is kept between chunks, so it travels once to a process and not with each chunk.

A chunk comes with the key of its task. A worker that does not know the task says so, and is sent the chunk again with
the task beside it. This needs nothing of an executor but ``submit``, so it is the same for local processes and for a
cluster to which workers come and go.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import platform
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

__all__ = [
    "Answer",
    "SingleWorkerExecutor",
    "Task",
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
