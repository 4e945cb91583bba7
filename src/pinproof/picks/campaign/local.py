"""Workers on this machine: one process each, which ends with the process that started it, however that ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any

__all__ = ["OneProcess", "usable_cores"]


class OneProcess(ProcessPoolExecutor):
    """An executor of one process.

    Several of these stand in for one pool of several processes: when a process dies, the others live on, and what it
    was doing is known. Processes are spawned: a child forked from a process that has used OpenMP hangs.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        # The worker holds the other end: it reads an end of file when this process lets go of it or is no more. Without
        # it, the workers of a killed campaign would wait for ever for their next chunk.
        leash, self._leash = context.Pipe(duplex=False)
        super().__init__(1, mp_context=context, initializer=_on_leash, initargs=(leash,))

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
            self._leash.close()
        super().shutdown(wait=wait, cancel_futures=cancel_futures)
        self._leash.close()


def _on_leash(leash: Connection) -> None:
    threading.Thread(target=_end_with, args=(leash,), daemon=True).start()


def _end_with(leash: Connection) -> None:
    try:
        leash.recv()  # nothing is ever sent
    except (EOFError, OSError):
        os._exit(1)


def usable_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
