"""Trajectories on disk: JSON and YAML in the shape of trajectory_msgs/JointTrajectory, and CSV.

Numbers are written by ``repr``, the shortest text that reads back to the same double; times as integers of
nanoseconds. So a file holds the very curve that was in memory.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pinproof.description.input_file import read_text
from pinproof.description.lined_yaml import YAML_SUFFIXES
from pinproof.errors import TrajectoryError
from pinproof.motion.trajectory_csv import from_csv, to_csv
from pinproof.motion.trajectory_message import from_json, from_yaml, to_json
from pinproof.motion.trajectory_reader import Reader, Record

__all__ = ["Record", "read", "write"]

Codec = TypeVar("Codec")

_WRITERS: dict[str, Callable[[Record], str]] = {".json": to_json, ".csv": to_csv}
_READERS: dict[str, Callable[[Reader, str], Record]] = {
    ".json": from_json,
    ".csv": from_csv,
    **dict.fromkeys(YAML_SUFFIXES, from_yaml),
}


def write(path: str | Path, record: Record) -> None:
    """Write ``record`` as its file's ending says, whole or not at all: beside the target first, then moved over it."""
    target = Path(path)
    text = _by_ending(target, _WRITERS, "written")(record)
    beside = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        try:
            with beside.open("x", encoding="utf-8", newline="") as file:
                file.write(text)
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise TrajectoryError(target, f"cannot be written: {error.strerror or error}") from error


def read(path: str | Path) -> Record:
    """Read a file that :func:`write` wrote, or a JointTrajectory message with positions and velocities."""
    source = Path(path)
    parse = _by_ending(source, _READERS, "read")
    return parse(Reader(source), read_text(source, TrajectoryError))


def _by_ending(path: Path, codecs: dict[str, Codec], done: str) -> Codec:
    if path.suffix.lower() not in codecs:
        raise TrajectoryError(
            path, f"a trajectory is {done} as {', '.join(codecs)}, not {path.suffix or 'a file without ending'}"
        )
    return codecs[path.suffix.lower()]
