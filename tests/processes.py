"""Processes that tests start: interruptible however the suite was started, waited for by events, and always ended."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

RUN_CLI = (
    "import sys; sys.argv[0] = 'pinproof'\nfrom pinproof.cli import main\nif __name__ == '__main__': sys.exit(main())"
)
"""A program that is the command line; for ``python -c``."""

PATIENCE = 1800.0
"""Seconds after which a test stops waiting for an event. Only a process that hangs takes so long, on any machine."""


@contextlib.contextmanager
def started(command: Sequence[str | os.PathLike[str]], **settings: Any) -> Iterator[subprocess.Popen[str]]:
    """A process with pipes for its output, in a session of its own; at the end it and what it started are killed.

    A shell starts what it puts into the background with SIGINT ignored, and whoever is started by that inherits it.
    Here SIGINT ends the process as it does from a terminal.
    """
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, start_new_session=True, preexec_fn=interruptible, **{**pipes, **settings})
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        with process:  # closes the pipes and waits
            pass


def interruptible() -> None:
    """Take SIGINT as a process in the foreground does."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that is dead and waits for its parent to read its exit code does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(event: Callable[[], bool], *, by: subprocess.Popen[str] | None = None) -> None:
    """Wait until the event has come; fail if the process that is to bring it has ended without it."""
    end = time.monotonic() + PATIENCE
    while not event():
        assert by is None or by.poll() is None or event(), f"the process ended with {by.returncode} before the event"
        assert time.monotonic() < end, f"the event did not come within {PATIENCE:g} s"
        time.sleep(0.01)
