"""What the commands share: tables to stdout, words of progress and complaints to stderr."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.box import ROUNDED
from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from pinproof.picks import PickReport

__all__ = ["Stopped", "complain", "print_json", "print_report", "remark", "say", "until_stopped", "working"]

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
    # few columns, so that the reason has room in a hundred characters: stage, figures and remedy stand below
    table = Table(title=Text(f"Picks of {report.robot}"), title_justify="left", box=ROUNDED, show_lines=True)
    for column, least in (("pick", 8), ("verdict", 10), ("clearance\nduration", 9), ("reason", 40)):
        table.add_column(column, overflow="fold", min_width=least)
    suggestions = {verdict.pick.name: verdict.suggestions for verdict in report.verdicts}
    for name, verdict, stage, clearance, duration, reason, _ in report.rows():
        # Texts, not strings: what stands between brackets in a name would be taken for a style.
        judged = Text.assemble((verdict, _STYLES.get(verdict, "")), f"\nat {stage}" if stage else "")
        words = Text(reason)
        for suggestion in suggestions.get(name, ()):
            words.append(f"\nsuggestion: {suggestion}", "bold")
        table.add_row(Text(name), judged, Text("\n".join(filter(None, (clearance, duration)))), words)
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
