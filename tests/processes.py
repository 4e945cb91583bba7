"""Starting processes in tests: they react to SIGINT, and are always killed at the end. Waiting for events."""

from __future__ import annotations

import contextlib
import os
import signal
import sqlite3
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

RUN_CLI = (
    "import sys; sys.argv[0] = 'pinproof'\nfrom pinproof.cli import main\nif __name__ == '__main__': sys.exit(main())"
)
"""The command line of pinproof as a program for ``python -c``."""

PATIENCE = 1800.0
"""Seconds after which a test stops waiting for an event; far longer than any process needs on a busy machine."""


@contextlib.contextmanager
def started(command: Sequence[str | os.PathLike[str]], **settings: Any) -> Iterator[subprocess.Popen[str]]:
    """Start a process with pipes for its output in a new session; at the end, kill it and all processes it started.

    A shell starts background jobs with SIGINT ignored, and their child processes inherit that. Here SIGINT interrupts
    the process as it does in a terminal.
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
    """Restore the default action of SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def is_alive(pid: int) -> bool:
    """Whether a process runs. A zombie, whose parent has not read its exit code, does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(event: Callable[[], bool], *, by: subprocess.Popen[str] | None = None) -> None:
    """Wait until ``event()`` is true; fail if the process ``by`` that causes it ends before."""
    end = time.monotonic() + PATIENCE
    while not event():
        assert by is None or by.poll() is None or event(), f"the process ended with {by.returncode} before the event"
        assert time.monotonic() < end, f"the event did not come within {PATIENCE:g} s"
        time.sleep(0.01)


WRITTEN = 12 * 4096
"""Bytes of the write-ahead log of a journal after some chunks: at least one page for each, and those of its tables."""


def rows_in(journal: Path) -> int:
    """The number of rows in a journal that no process has open."""
    with contextlib.closing(sqlite3.connect(journal)) as file:
        return int(file.execute("SELECT count(*) FROM rows").fetchone()[0])
