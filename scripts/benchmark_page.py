"""What the scripts of all benchmarks share: the command line, the page in docs/benchmarks, and clocks.

A script measures a table, or reads the stored one with ``--render``, and prints its page or writes it to the manual.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any, TypeVar

from pinproof.benchmarks.tables import BenchmarkTable

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "benchmarks"
ROBOTS = FOLDER.parents[1] / "robots"

Table = TypeVar("Table", bound=BenchmarkTable)


def page_parser(text: str | None, name: str) -> argparse.ArgumentParser:
    """Return a parser with the options of every benchmark; ``text`` is the docstring of the script."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", action="store_true", help=f"write docs/benchmarks/{name}.*")
    parser.add_argument("--render", action="store_true", help=f"rewrite the page from {name}.json")
    return parser


def run(
    parser: argparse.ArgumentParser,
    name: str,
    kind: type[Table],
    measure: Callable[[argparse.Namespace], Table],
    page: Callable[[Table], str],
    write: Callable[[Table, Path], Any] | None = None,
) -> None:
    """Measure or read a table, write it with ``--docs`` or ``--render``, else print its page.

    ``write`` writes the table to a folder; by default as JSON, with its page as Markdown. The exit code is 1 if the
    table has :func:`faults`.
    """
    options = parser.parse_args()
    table = kind.load(FOLDER / f"{name}.json") if options.render else measure(options)
    if not (options.docs or options.render):
        print(page(table))
    elif write is None:
        table.write(FOLDER, name, page(table))
    else:
        write(table, FOLDER)
    for text in (wrong := faults(table)):
        report(f"wrong: {text}")
    sys.exit(1 if wrong else 0)


def faults(table: BenchmarkTable) -> list[str]:
    """Return the wrong verdicts of a table, and its motions in which the independent check found a fault."""
    unsafe = (f"{row.name}: {'; '.join(row.faults)}" for row in getattr(table, "unsafe", ()))
    return [*getattr(table, "wrong", ()), *unsafe]


def report(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr)


def seconds(call: Callable[[], object], clock: Callable[[], float] = process_time) -> float:
    """Return the time of a call in s, by default processor time."""
    begin = clock()
    call()
    return clock() - begin


def fastest(call: Callable[[], object], runs: int, clock: Callable[[], float] = process_time) -> float:
    """Return the time in s of the fastest of several calls, which reduces the influence of other processes."""
    return min(seconds(call, clock) for _ in range(runs))
