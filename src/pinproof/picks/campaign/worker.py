"""What runs in a worker: the task is kept between chunks, so it travels once to a process and not with each chunk.

A chunk comes with the key of its task. A worker that does not know the task says so, and is sent the chunk again with
the task beside it. This needs nothing of an executor but ``submit``, so it is the same for local processes and for a
cluster to which workers come and go.
"""

from __future__ import annotations

import os
import pickle
import platform
import time
from collections.abc import Callable
from typing import Any, NamedTuple

__all__ = ["Answer", "Task", "work"]

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
