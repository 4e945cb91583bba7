"""What the scripts share that write files of the repository or check whether they are up to date."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path


def with_tables(text: str, script: str, tables: Mapping[str, str]) -> str:
    """Return the text of a page with new tables, each between the two comments with its name."""
    for name, table in tables.items():
        begin, end = f"<!-- begin: {name} (written by scripts/{script}) -->", f"<!-- end: {name} -->"
        before, _, rest = text.partition(begin)
        _, found, after = rest.partition(end)
        if not found:
            raise SystemExit(f"the page has no lines {begin!r} and {end!r}")
        text = f"{before}{begin}\n{table}\n{end}{after}"
    return text


def main(document: str | None, files: Callable[[], Mapping[Path, str]]) -> None:
    """Write the files with these texts; with ``--check`` only compare them, with exit code 1 if one differs."""
    parser = argparse.ArgumentParser(description=document, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare only")
    check = parser.parse_args().check
    old = [
        (path, text) for path, text in files().items() if not path.exists() or path.read_text(encoding="utf-8") != text
    ]
    for path, text in old:
        if check:
            print(f"{path} is not up to date", file=sys.stderr)
        else:
            path.write_text(text, encoding="utf-8")
    sys.exit(1 if check and old else 0)
