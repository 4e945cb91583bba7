"""Tables on disk: JSON, written whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pinproof.description.whole_file import write_text_whole
from pinproof.errors import FileError

__all__ = ["read_table", "write_table"]


def write_table(path: str | Path, words: dict[str, Any]) -> None:
    """Write a table as JSON."""
    write_text_whole(Path(path), json.dumps(words, indent=1, allow_nan=False) + "\n")


def read_table(path: str | Path, what: str) -> dict[str, Any]:
    """Read what :func:`write_table` wrote; ``what`` says in errors what it should hold.

    Raises
    ------
    FileError
        If the file cannot be read or is no JSON of a table.
    """
    try:
        words = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileError(path, f"holds no table of {what}: {error}") from error
    if not isinstance(words, dict):
        raise FileError(path, f"holds no table of {what}")
    return words
