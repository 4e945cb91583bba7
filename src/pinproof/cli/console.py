"""Output of the commands: results on stdout; progress, notes and errors on stderr; files.

The names of output files are checked before a command starts its work, so that a typing error costs no time.
"""

from __future__ import annotations

import json
import logging
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from pinproof.common.files import os_errors, unknown_suffix
from pinproof.common.steps import LOG, step
from pinproof.errors import FileError, InputError

if TYPE_CHECKING:
    from pinproof.picks import PickReport

_STYLES = {
    "good": "green",
    "impossible": "red",
    "not found": "dark_orange",
    "unreadable": "yellow",
    "crashed": "magenta",
}


class Interrupted(Exception):
    """Ctrl-C was pressed; the message states what happened to the work, whose result may have been printed before."""

    def __init__(self, message: str = "interrupted; there is no result", *, result_printed: bool = False) -> None:
        super().__init__(message)
        self.result_printed = result_printed


def print_line(text: str) -> None:
    """Print one line to stdout."""
    sys.stdout.write(f"{text}\n")


def print_note(text: str) -> None:
    """Print one line to stderr."""
    sys.stderr.write(f"pinproof: {text}\n")


def print_error(text: str) -> None:
    """Print one line to stderr, in red on a terminal."""
    if not sys.stderr.isatty() or "NO_COLOR" in os.environ:
        print_note(text)
        return
    from rich.console import Console

    Console(stderr=True, highlight=False, soft_wrap=True, markup=False).print(f"pinproof: {text}", style="red")


def print_result(data: dict[str, Any], lines: Iterable[str], *, as_json: bool, ok: bool = True) -> None:
    """Print a result as JSON, or as lines of text; the process then ends with exit code 1 unless it is ``ok``."""
    if as_json:
        print_json(data)
    else:
        for line in lines:
            print_line(line)
    if not ok:
        raise typer.Exit(1)


def written(*files: Path | str | None) -> list[str]:
    """The line that names the files that were written; empty without files."""
    *others, last = [str(file) for file in files if file is not None] or [""]
    return [f"wrote {', '.join(others)}{' and ' if others else ''}{last}"] if last else []


def print_json(value: dict[str, Any]) -> None:
    """Print values and arrays as JSON to stdout and flush it; infinite and undefined numbers become null."""
    json.dump(_finite(value), sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")
    sys.stdout.flush()  # the live view keeps running after this line


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_finite(part) for part in (value.tolist() if isinstance(value, np.ndarray) else value)]
    return None if isinstance(value, float) and not math.isfinite(value) else value


SILENT = 2.0
"""Seconds after which a step that has not ended is printed."""

REPORTED_EVERY = 30.0
"""Seconds between two lines of progress if stderr is not a terminal."""


class LongSteps(logging.Handler):
    """Prints a step of the library as one line on stderr if it has not ended after :data:`SILENT` seconds."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._running: list[threading.Timer] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Start the timer of a step that begins, and cancel that of a step that ends."""
        if record.__dict__["seconds"] is None:
            timer = threading.Timer(SILENT, print_note, [record.getMessage()])
            timer.daemon = True
            timer.start()
            self._running.append(timer)
        elif self._running:
            self._running.pop().cancel()

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Print long steps until the block ends."""
        level = LOG.level
        LOG.addHandler(self)
        LOG.setLevel(min(level or logging.INFO, logging.INFO))
        try:
            yield
        finally:
            LOG.removeHandler(self)
            LOG.setLevel(level)
            for timer in self._running:
                timer.cancel()


@contextmanager
def progress_status(text: str) -> Iterator[Callable[[str], None]]:
    """Show a status line on stderr; the function yielded changes its text, if stderr is a terminal."""
    if not sys.stderr.isatty():
        with step(text, level=logging.INFO):
            yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True, highlight=False).status(text) as status:
        yield status.update


@contextmanager
def progress_bar(text: str) -> Iterator[Callable[[str, int, int], None]]:
    """Show a progress bar with the rate and the time left on stderr, or now and then a line if it is no terminal.

    The function yielded takes the name of a stage, and the numbers of its finished and of all parts.
    """
    if not sys.stderr.isatty():
        with step(text, level=logging.INFO):
            yield _ProgressLines(text)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Rate(ProgressColumn):
        """Parts per second."""

        def render(self, task: Any) -> Text:
            return Text("" if task.speed is None else f"{task.speed:,.1f}/s")

    # Parts per second and the time left of the present stage
    console = Console(stderr=True)
    columns: tuple[ProgressColumn, ...] = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Rate())
    columns += (TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        current, task = "", bar.add_task(text, total=None)

        def show(stage: str, done: int, total: int) -> None:
            nonlocal current
            if stage != current:  # the rate of another stage does not count
                current = stage
                bar.reset(task, description=f"{text}: {stage}" if stage else text, total=total)
            bar.update(task, completed=done, total=total)

        yield show


class _ProgressLines:
    """Prints the progress and the time left of a stage every :data:`REPORTED_EVERY` seconds."""

    def __init__(self, text: str) -> None:
        self._text, self._stage = text, ""
        self._start = self._printed = time.monotonic()

    def __call__(self, stage: str, done: int, total: int) -> None:
        now = time.monotonic()
        if stage != self._stage:
            self._stage, self._start = stage, now
        if now - self._printed < REPORTED_EVERY or not 0 < done < total:
            return
        self._printed, left = now, (now - self._start) * (total - done) / done
        print_note(f"{self._text}: {done:,} of {total:,} {stage}, about {left:.0f} s left")


@contextmanager
def until_interrupted() -> Iterator[None]:
    """Turn Ctrl-C, which ends a live view, into :class:`Interrupted`."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted("the live view is closed", result_printed=True) from None


ONE_LINE_WIDTH = 100
"""Columns of a terminal from which the verdict of a pick has its stage and its figures on one line."""


def print_report(report: PickReport) -> None:
    """Print the verdict of each pick as a table, and the summary, to stdout."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from pinproof.picks import FIGURES

    # The columns depend on the width of the terminal, so that no text is cropped
    console = Console(highlight=False)
    narrow = console.width < ONE_LINE_WIDTH  # then stage and figures share columns, so that no text is cropped
    table = Table(title=Text(f"Picks of {report.robot}"), title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    guessed = report.guessed_accelerations
    seconds = "duration*" if guessed else "duration"
    figures = (f"clearance\n{seconds}",) if narrow else ("clearance", seconds)
    for column in ("pick", "verdict", *figures, "reason"):
        table.add_column(column, overflow="fold")
    # One row for each pick, with its suggestions below the reason
    suggestions = {verdict.pick.name: verdict.suggestions for verdict in report.verdicts}
    for name, verdict, stage, clearance, duration, reason, _, *own in report.rows():
        # Text objects, because Rich would interpret brackets in a string as markup.
        place = f"{chr(10) if narrow else ' '}at {stage}" if stage else ""
        outcome = Text.assemble((verdict.upper(), _STYLES.get(verdict, "")), place)
        explanation = Text(reason)
        for column, cell in zip(report.columns, own, strict=True):
            explanation.append(f"\n{column}: {cell}" if cell else "")
        for suggestion in suggestions.get(name, ()):
            explanation.append(f"\nsuggestion: {suggestion}", "bold")
        shown = ("\n".join(filter(None, (clearance, duration))),) if narrow else (clearance, duration)
        table.add_row(Text(name), outcome, *map(Text, shown), explanation)
    console.print(table)
    print_line(report.summary)
    if guessed and report.good:
        print_line(f"* {guessed}")
    if report.exported:
        print_line(FIGURES)
    for note in report.notes:
        print_line(f"not covered: {note}")


def check_output_files(
    outputs: Iterable[Path | None], inputs: Iterable[str | Path | None] = (), suffixes: Sequence[str] = ()
) -> None:
    """Refuse output files that cannot be written or would overwrite a file of the same command.

    InputError if an output is also an input, is named twice, or has none of the suffixes; FileError if an output is a
    folder, or its folder does not exist.
    """
    # Files are compared by their real paths, so that a link does not hide that two are the same
    used = {os.path.realpath(path): "an input" for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        if suffixes and path.suffix.lower() not in suffixes:
            raise InputError(f"{path}: {unknown_suffix(path, suffixes)}")
        target = os.path.realpath(path)
        if target in used:
            raise InputError(f"{path}: is also {used[target]} of this command; name another output file")
        with os_errors(path, "cannot be written"):
            is_folder, has_folder = Path(target).is_dir(), Path(target).parent.is_dir()
        if is_folder:
            raise FileError(path, "cannot be written: it is a folder")
        if not has_folder:
            # The command adds that the folder does not exist, as for inputs.
            raise FileError(
                path,
                f"cannot be written: {path.parent} is not a folder" if path.parent.exists() else "cannot be written",
            )
        used[target] = "another output"


def check_report_output(path: Path, suffixes: Sequence[str]) -> bool:
    """Refuse an output that is neither a file with one of the suffixes nor a folder; return whether it is a folder.

    A folder and its parents are created.

    InputError if the suffix is unknown, or the folder of a file does not exist; FileError if the folder cannot be
    created.
    """
    if path.suffix.lower() in suffixes and not path.is_dir():
        if not path.parent.is_dir():
            raise InputError(f"{path}: the folder {path.parent} does not exist")
        return False
    if path.suffix and not path.is_dir():
        raise InputError(f"{path}: unknown file type; use {', '.join(suffixes)}, or the name of a folder")
    with os_errors(path, "the folder cannot be created"):
        path.mkdir(parents=True, exist_ok=True)
    return True
