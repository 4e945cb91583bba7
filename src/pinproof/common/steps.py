"""Steps of long work, which are reported through :mod:`logging`.

The library prints nothing. It logs the start and the end of each step to :data:`LOG`, and programs decide what they
show: ``logging.basicConfig(level="INFO")`` prints the steps on meshes, and the command line prints a step that takes
longer than two seconds. A step on a large input has the level INFO, the stages of a pick or a tool path have the level
DEBUG.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager

LOG = logging.getLogger("pinproof.steps")
SUGGESTIONS = "suggestions"
"""The step whose inner steps are a part of it."""


@contextmanager
def step(text: str, *, level: int = logging.DEBUG) -> Iterator[None]:
    """Log the start and the end of a step; the record of the end has its ``seconds``, that of the start has None."""
    if not LOG.isEnabledFor(level):
        yield
        return
    LOG.log(level, "%s", text, extra={"step": text, "seconds": None})
    start = time.perf_counter()
    try:
        yield
    finally:
        seconds = time.perf_counter() - start
        LOG.log(level, "%s: %.2f s", text, seconds, extra={"step": text, "seconds": seconds})
