"""What the scripts of all benchmarks share: their options, and the page that they write to docs/benchmarks."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pinproof.benchmarks.tables import BenchmarkTable

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "benchmarks"


def page_parser(text: str | None, name: str) -> argparse.ArgumentParser:
    """Return a parser with the options of every benchmark; ``text`` is the docstring of the script."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", action="store_true", help=f"write docs/benchmarks/{name}.*")
    parser.add_argument("--render", action="store_true", help=f"rewrite the page from {name}.json")
    return parser


def finish(table: BenchmarkTable, name: str, page: str, options: argparse.Namespace) -> None:
    """Write the table and its page with ``--docs`` or ``--render``, and print the page."""
    if options.docs or options.render:
        table.write(FOLDER, name, page)
    print(page)


def report(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr)
