"""What the commands share: tables to stdout, words of progress and complaints to stderr.

Files that commands write: where they may stand, and a good pick as its page and its motion.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

import pinproof as pp
from pinproof.errors import FileError, InputError

if TYPE_CHECKING:
    from pinproof.picks import PickReport

__all__ = [
    "Stopped",
    "check_outputs",
    "complain",
    "file_stems",
    "make_folder",
    "print_json",
    "print_report",
    "remark",
    "say",
    "until_stopped",
    "working",
    "write_motion",
]

_STYLES = {
    "good": "green",
    "impossible": "red",
    "not found": "dark_orange",
    "unreadable": "yellow",
    "crashed": "magenta",
}


class Stopped(Exception):
    """Ctrl-C; the message says what became of the work, ``answered`` whether the answer was printed before."""

    def __init__(self, message: str = "interrupted; no answer was given", *, answered: bool = False) -> None:
        super().__init__(message)
        self.answered = answered


def say(text: str) -> None:
    """One line to stdout."""
    Console(highlight=False, soft_wrap=True, markup=False).print(text)


def complain(text: str) -> None:
    """One line to stderr."""
    Console(stderr=True, highlight=False, soft_wrap=True, markup=False).print(f"pinproof: {text}", style="red")


def print_json(value: dict[str, Any]) -> None:
    """A value for machines, to stdout at once; numbers that JSON does not know (infinite, undefined) become null."""
    json.dump(_finite(value), sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")
    sys.stdout.flush()  # a command may go on for long after it, as the live view does


def remark(text: str) -> None:
    """One line to stderr that is no complaint."""
    Console(stderr=True, highlight=False, soft_wrap=True, markup=False).print(f"pinproof: {text}")


@contextmanager
def working(text: str) -> Iterator[Callable[[str], None]]:
    """Show on stderr that work goes on, if somebody looks; what it yields changes the text."""
    console = Console(stderr=True, highlight=False)
    if console.is_terminal:
        with console.status(text) as status:
            yield status.update
    else:
        yield lambda _: None


def print_report(report: PickReport) -> None:
    """The verdict table and its summary, to stdout."""
    console = Console(highlight=False)
    table = Table(title=Text(f"Picks of {report.robot}"), title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for column, least in (("pick", 8), ("verdict", 10), ("clearance", 9), ("duration", 8), ("reason", 40)):
        table.add_column(column, overflow="fold", min_width=least)
    suggestions = {verdict.pick.name: verdict.suggestions for verdict in report.verdicts}
    for name, verdict, stage, clearance, duration, reason, _ in report.rows():
        # Text objects, because rich would interpret brackets in a string as a style.
        judged = Text.assemble((verdict.upper(), _STYLES.get(verdict, "")), f" at {stage}" if stage else "")
        words = Text(reason)
        for suggestion in suggestions.get(name, ()):
            words.append(f"\nsuggestion: {suggestion}", "bold")
        table.add_row(Text(name), judged, Text(clearance), Text(duration), words)
    console.print(table)
    say(report.summary)
    for note in report.notes:
        say(f"not covered: {note}")


@contextmanager
def until_stopped() -> Iterator[None]:
    """Show a live view until Ctrl-C, which is how it ends."""
    try:
        yield
    except KeyboardInterrupt:
        raise Stopped("the live view has ended", answered=True) from None


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[str | Path | None] = ()) -> None:
    """Refuse, before the work and not after it, a file that cannot be written or that this command needs otherwise.

    Raises
    ------
    InputError
        If an output is also an input, or is named twice.
    FileError
        If there is no folder for it, or it is a folder itself.
    """
    taken = {os.path.realpath(path): "read" for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        place = os.path.realpath(path)
        if place in taken:
            raise InputError(f"{path}: is {taken[place]} by this same command; name another file to write to")
        try:
            is_folder, has_folder = Path(place).is_dir(), Path(place).parent.is_dir()
        except OSError as error:
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error
        if is_folder:
            raise FileError(path, "cannot be written: it is a folder")
        if not has_folder:
            raise FileError(path, f"cannot be written: there is no folder {path.parent}")
        taken[place] = "written to"


def write_motion(verdict: pp.PickVerdict, arm: pp.Arm, html: Path, motion: Path) -> list[Path]:
    """Write the trajectory of a good pick and its page, or a page for each motion where what is carried changes.

    The files written are handed back.
    """
    if verdict.trajectory is None:
        raise InputError(f"pick {verdict.pick.name!r} is not good, so it has no motion to write")
    verdict.save_motion(motion)
    pages = []
    for number, part in enumerate(verdict.motions, start=1):
        alone = len(verdict.motions) == 1
        pages.append(html if alone else html.with_name(f"{html.stem}_{number}_{part.name}{html.suffix}"))
        pp.write_html(
            pages[-1],
            arm.with_held(part.held),
            part.scene,
            part.trajectory,
            certificate=part.certificate,
            attached=part.attached,
            title=f"{arm.robot.name}: {verdict.pick.name}" + ("" if alone else f", {part.name}"),
        )
    return [*pages, motion]


def make_folder(path: Path) -> None:
    """Make a folder, and those above it, unless it is there.

    Raises
    ------
    FileError
        If it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(path, f"cannot be made a folder: {error.strerror or error}") from error


def file_stems(names: Iterable[str]) -> list[str]:
    """A file name without ending for each name: all different, none that leaves its folder, none called ``report``."""
    stems: list[str] = []
    taken = {"report"}
    for name in names:
        stem = plain = re.sub(r"[^\w.+-]+", "_", name).lstrip(".") or "pick"
        count = 1
        while stem.lower() in taken:
            count += 1
            stem = f"{plain}_{count}"
        taken.add(stem.lower())
        stems.append(stem)
    return stems
