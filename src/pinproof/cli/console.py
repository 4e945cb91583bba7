"""What the commands share: tables to stdout, words of progress and complaints to stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.table import Table

from pinproof.picks import PickReport
from pinproof.picks.report import COLUMNS

__all__ = ["complain", "print_json", "print_report", "say", "working"]

_STYLES = {"good": "green", "not found": "red", "unreadable": "yellow"}


def say(text: str) -> None:
    """One line to stdout."""
    Console(highlight=False, soft_wrap=True, markup=False).print(text)


def complain(text: str) -> None:
    """One line to stderr."""
    Console(stderr=True, highlight=False, soft_wrap=True, markup=False).print(f"pinproof: {text}", style="red")


def print_json(value: dict[str, Any]) -> None:
    """A value for machines, to stdout."""
    json.dump(value, sys.stdout, indent=2)
    sys.stdout.write("\n")


@contextmanager
def working(text: str) -> Iterator[None]:
    """Show on stderr that work goes on, if somebody looks."""
    console = Console(stderr=True, highlight=False)
    if console.is_terminal:
        with console.status(text):
            yield
    else:
        yield


def print_report(report: PickReport) -> None:
    """The verdict table and its summary, to stdout."""
    console = Console(highlight=False)
    table = Table(title=f"Picks of {report.robot}", title_justify="left")
    for column in COLUMNS:
        table.add_column(column, overflow="fold")
    for row in report.rows():
        table.add_row(row[0], f"[{_STYLES.get(row[1], '')}]{row[1]}[/]", *(_plain(cell) for cell in row[2:]))
    console.print(table)
    console.print(report.summary)


def _plain(cell: str) -> str:
    return cell.replace("[", "\\[")
