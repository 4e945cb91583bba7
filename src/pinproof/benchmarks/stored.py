"""Tables on disk: JSON with a line a row, written whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pinproof.common.files import write_text_whole
from pinproof.errors import FileError

__all__ = ["read_table", "write_table"]


def write_table(path: str | Path, words: dict[str, Any]) -> None:
    """Write a table as JSON; of what it lists, each entry is a line."""
    parts = [f"{json.dumps(key)}: {_stated(value)}" for key, value in words.items()]
    write_text_whole(Path(path), "{\n" + ",\n".join(parts) + "\n}\n")


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


def _stated(value: Any) -> str:
    if isinstance(value, (list, tuple)) and value:
        return "[\n" + ",\n".join(json.dumps(entry, allow_nan=False) for entry in value) + "\n]"
    return json.dumps(value, indent=1, allow_nan=False)
