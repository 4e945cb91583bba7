"""The rows of a campaign on disk: a journal in order of arrival, then a file in the order of the picks.

Both are JSON lines: a header, then one row per pick with its position under ``index``. A running campaign appends to
``journal.jsonl``. At the end ``rows.jsonl`` is written from it, completely or not at all, and replaces it. Memory use
is nine bytes per row.

Each row ends with a checksum over the header and the row. A row whose checksum does not match was damaged, edited by
hand, or copied from another campaign; its pick is judged again.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from pinproof.common.files import os_errors
from pinproof.errors import CampaignError, FileError

SYNC_SECONDS = 1.0
"""Seconds between calls of fsync. A killed process loses no rows; a system crash can lose the rows of this period."""


class LineFile:
    """A file opened for appending; the first :meth:`append` removes an incomplete last line.

    ``size`` is the number of bytes in complete lines, ``torn`` the number of bytes in an incomplete last line.

    Raises
    ------
    FileError
        If the file cannot be opened or written to, for example because the disk is full, or if another process uses it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with os_errors(path, "cannot be written"):
            # Unbuffered: written data has left this process, and a failed write is not repeated implicitly.
            self._file = path.open("a+b", buffering=0)
        try:
            self._lock()
            self.size = self._size_of_complete_rows()
            self.torn = self._file.seek(0, os.SEEK_END) - self.size
        except OSError as error:
            self._file.close()
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error
        except FileError:
            self._file.close()
            raise
        self._synced = time.monotonic()

    def _lock(self) -> None:
        import fcntl

        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise FileError(self.path, "is in use by another process") from error
        except OSError:
            pass  # some network file systems do not support locks; a single process can still use the file

    def _size_of_complete_rows(self) -> int:
        """The number of bytes in complete lines."""
        end = self._file.seek(0, os.SEEK_END)
        while end > 0:
            begin = max(0, end - (1 << 16))
            self._file.seek(begin)
            found = self._file.read(end - begin).rfind(b"\n")
            if found >= 0:
                return begin + found + 1
            end = begin
        return 0

    def append(self, lines: bytes) -> None:
        """Append complete lines.

        Raises
        ------
        FileError
            If the lines cannot be written completely; a partial line is removed after the file is next opened.
        """
        rest = memoryview(lines)
        with os_errors(self.path, "cannot be written"):
            if self.torn:
                self._file.truncate(self.size)
                self.torn = 0
            while rest:
                rest = rest[self._file.write(rest) :]
            if time.monotonic() - self._synced > SYNC_SECONDS:
                os.fsync(self._file.fileno())
                self._synced = time.monotonic()
        self.size += len(lines)

    def close(self) -> None:
        """Close the file and release its lock."""
        self._file.close()

    def __enter__(self) -> LineFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


SCHEMA = "pinproof/campaign/2"

JOURNAL, ROWS = "journal.jsonl", "rows.jsonl"

CRASHED = "crashed"
"""The verdict on a pick that could not be judged: the judge failed, or the process died."""

RETRY = "retry"
"""The key that marks rows whose picks the next run judges again, because a worker died or had no memory."""

_CHECKSUM = re.compile(rb',"checksum":"([0-9a-f]{16})"\}\n\Z')
"""End of each row. 64 bits detect damage and manual edits; they do not protect against forgery."""


def to_line(value: Mapping[str, Any]) -> bytes:
    """Encode a value as a line of JSON.

    Raises
    ------
    TypeError, ValueError
        If the value contains something that JSON cannot represent, such as NaN.
    """
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode() + b"\n"


class _Checksum:
    """Adds and checks the checksums of rows that belong to one header."""

    def __init__(self, header: bytes) -> None:
        self._header = hashlib.sha256(header)

    def _of(self, content: bytes) -> bytes:
        digest = self._header.copy()
        digest.update(content)
        return digest.hexdigest()[:16].encode()

    def add(self, line: bytes) -> bytes:
        """The line with its checksum; ``line`` is a JSON object that ends with a line feed."""
        content = line[: line.rindex(b"}")]
        return content + b',"checksum":"' + self._of(content) + b'"}\n'

    def row(self, line: bytes) -> dict[str, Any] | None:
        """A row without its checksum; None if the checksum does not match."""
        found = _CHECKSUM.search(line)
        if found is None or self._of(line[: found.start()]) != found[1]:
            return None
        return dict(json.loads(line[: found.start()] + b"}"))


def is_to_retry(row: Mapping[str, Any]) -> bool:
    """Whether the next run judges the pick of a row again."""
    return row.get("verdict") == CRASHED and row.get(RETRY) is True


def row_checker(header: bytes) -> Callable[[bytes], dict[str, Any] | None]:
    """A function that reads a line of a file with this header: the row, or None if it is damaged."""
    return _Checksum(header).row


class Journal:
    """The journal of a campaign in a folder, new or resumed.

    In its header, ``header["picks"]`` is the number of rows, and ``header["setup"]`` identifies the campaign.

    Raises
    ------
    CampaignError
        If the existing journal belongs to another campaign; the message names the difference.
    FileError
        If the journal cannot be read or written.
    """

    def __init__(self, folder: Path, header: Mapping[str, Any]) -> None:
        self.path, self.rows_path = folder / JOURNAL, folder / ROWS
        self._header = to_line(header)
        self._checksum = _Checksum(self._header)
        self.damaged = 0
        """The number of lines that are not valid rows of this campaign; they are ignored."""
        total = int(header["picks"])
        self.done = np.zeros(total, dtype=bool)
        """(picks,) whether each row exists."""
        self._at = np.zeros(total, dtype=np.int64)  # offset in bytes of each row
        self._file = LineFile(self.path)
        try:
            if self._file.size:
                self._read(header)
            else:
                self._begin()
        except BaseException:
            self._file.close()
            raise

    def _begin(self) -> None:
        """Write the header; an incomplete header is overwritten, any other content is refused."""
        if self._file.torn > len(self._header) or not self._header.startswith(_content(self.path)):
            raise CampaignError(f"{self.path}: does not belong to a campaign; choose another folder")
        self._file.append(self._header)

    def _read(self, header: Mapping[str, Any]) -> None:
        """Read the existing rows."""
        with os_errors(self.path), self.path.open("rb") as file:
            refuse_foreign(self.path, _parsed_header(self.path, file.readline()), header)
            for at, line in _lines(file):
                if at == self._file.size:
                    break  # an incomplete line
                row = self._checksum.row(line)
                if row is None:
                    self.damaged += 1
                    continue
                index = int(row["index"])
                self._at[index], self.done[index] = at, not is_to_retry(row)  # a later row replaces an earlier one

    def missing(self) -> list[tuple[int, int]]:
        """The ranges (start, stop) of missing rows."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], ~self.done, [False]]).astype(np.int8)))
        return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]

    def append(self, start: int, lines: list[bytes]) -> None:
        """Append consecutive rows, the first of which has the index ``start``, each with its checksum."""
        if self.done[start : start + len(lines)].any():
            raise RuntimeError(f"rows {start} to {start + len(lines) - 1} are there already")
        lines = [self._checksum.add(line) for line in lines]
        lengths = np.array([len(line) for line in lines], dtype=np.int64)
        at = self._file.size
        self._file.append(b"".join(lines))
        self._at[start : start + len(lines)] = at + np.cumsum(lengths) - lengths
        self.done[start : start + len(lines)] = True

    def finish(self) -> None:
        """Write the rows in order to the final file, and remove the journal.

        Raises
        ------
        FileError
            If the file cannot be written; the journal is then kept.
        """
        if not self.done.all():
            raise RuntimeError(f"{np.count_nonzero(~self.done)} rows are missing")
        scratch = self.rows_path.with_name(f".{ROWS}.tmp")  # only this process writes it
        try:
            with self.path.open("rb") as journal, scratch.open("wb") as rows:
                rows.write(self._header)
                for at in map(int, self._at):
                    if journal.tell() != at:  # most rows are consecutive
                        journal.seek(at)
                    rows.write(journal.readline())
                rows.flush()
                os.fsync(rows.fileno())
            scratch.replace(self.rows_path)
            _sync_folder(self.rows_path.parent)  # remove the journal only after the rows are durable
            self.path.unlink(missing_ok=True)
        except OSError as error:
            scratch.unlink(missing_ok=True)
            raise FileError(self.rows_path, f"cannot be written: {error.strerror or error}") from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def rows_there(folder: Path) -> int:
    """The number of picks that have a row in the journal of a campaign; 0 if there is no journal."""
    try:
        with (folder / JOURNAL).open("rb") as file:
            read = row_checker(file.readline())
            return len({row["index"] for line in file if (row := read(line)) is not None})
    except OSError:
        return 0


def read_header(path: Path) -> dict[str, Any]:
    """Read the header of a journal or of a file of rows.

    Raises
    ------
    CampaignError
        If the file does not belong to a campaign, or has another version of the schema.
    FileError
        If the file cannot be read.
    """
    with os_errors(path), path.open("rb") as file:
        return _parsed_header(path, file.readline())


def _parsed_header(path: Path, line: bytes) -> dict[str, Any]:
    try:
        header = json.loads(line)
        schema = header["schema"]
    except (ValueError, TypeError, KeyError) as error:
        raise CampaignError(f"{path}: does not belong to a campaign; choose another folder") from error
    if schema != SCHEMA:
        raise CampaignError(f"{path}: has the schema {schema}, but {SCHEMA} is required; choose another folder")
    return dict(header)


def refuse_foreign(path: Path, there: Mapping[str, Any], header: Mapping[str, Any]) -> None:
    """Raise :class:`CampaignError` if the header of a file differs from ``header``; names the differences."""
    if to_line(there) == to_line(header):
        return
    a, b = (dict(each.get("setup", {})) for each in (there, header))
    different = [
        f"{name} ({a.get(name, 'nothing')} there, {b.get(name, 'nothing')} here)"
        for name in dict.fromkeys([*b, *a])
        if a.get(name) != b.get(name)
    ]
    raise CampaignError(
        f"{path}: belongs to another campaign, which differs in {'; '.join(different) or 'its header'}. Choose another "
        "folder, or remove this one to start again"
    )


def _content(path: Path) -> bytes:
    with os_errors(path):
        return path.read_bytes()


def _lines(file: Any) -> Iterator[tuple[int, bytes]]:
    at = file.tell()
    for line in file:
        yield at, line
        at += len(line)
