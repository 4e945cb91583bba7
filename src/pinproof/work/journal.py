"""The rows of long work in an SQLite file, so that the work can be interrupted at any moment and resumed.

Each chunk of rows is one transaction in a write-ahead log: a killed process loses no finished chunk, and a crash of the
system or a full disk leaves the chunks before it. A row is a line of JSON with its ``index``, which ends with a
checksum over the header of the journal and the row. A row whose checksum does not match was damaged, edited by hand, or
copied from other work; it counts as missing.
"""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common.files import os_errors
from pinproof.errors import CampaignError, FileError

JOURNAL = "journal.sqlite"

APPLICATION = 0x70696E70
"""The application id in the header of the SQLite file; another file is never changed."""

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


class Checksums:
    """Adds and checks the checksums of the rows that belong to one header line."""

    def __init__(self, header: bytes) -> None:
        self._header = hashlib.sha256(header)

    def _of(self, content: bytes) -> bytes:
        total = self._header.copy()
        total.update(content)
        return total.hexdigest()[:16].encode()

    def add(self, line: bytes) -> bytes:
        """The line with its checksum; ``line`` is a JSON object that ends with a line feed."""
        # The checksum becomes the last key of the object
        content = line[: line.rindex(b"}")]
        return content + b',"checksum":"' + self._of(content) + b'"}\n'

    def row(self, line: bytes) -> dict[str, Any] | None:
        """A row without its checksum; None if the checksum does not match."""
        match = _CHECKSUM.search(line)
        if match is None or self._of(line[: match.start()]) != match[1]:
            return None
        return dict(json.loads(line[: match.start()] + b"}"))


class Journal:
    """The rows of one campaign or search in a folder, new or resumed; a context that closes the file.

    Parameters
    ----------
    folder
        The folder, which is created if it does not exist.
    header
        What all rows depend on: ``header["setup"]`` maps the parts of the work to texts that identify them.

    Raises
    ------
    CampaignError
        If the existing journal belongs to other work; the message names the difference.
    FileError
        If the journal cannot be read or written, for example because the disk is full, or if another process uses it.
    """

    def __init__(self, folder: Path, header: Mapping[str, Any]) -> None:
        self.path, self.header = folder / JOURNAL, to_line(header)
        self.damaged = 0
        """The number of rows that are not valid rows of this work; they are ignored."""
        self._checksums = Checksums(self.header)
        with os_errors(folder, "cannot be created"):
            folder.mkdir(parents=True, exist_ok=True)
        self._file = sqlite3.connect(self.path, timeout=0, isolation_level=None, check_same_thread=False)
        try:
            with self._errors():
                (application,) = self._file.execute("PRAGMA application_id").fetchone()
                has_tables = self._file.execute("SELECT 1 FROM sqlite_master").fetchone() is not None
                if application not in (0, APPLICATION) or (application == 0 and has_tables):
                    raise CampaignError(f"{self.path}: does not belong to a campaign; choose another folder")
                # The lock of this process lasts until the file is closed, and needs no shared memory, which network
                # file systems do not offer.
                self._file.execute("PRAGMA locking_mode = EXCLUSIVE")
                self._file.execute("PRAGMA journal_mode = WAL")
                self._file.execute("PRAGMA synchronous = NORMAL")  # no wait for the disk after each chunk
                # The header and the tables are written in one transaction, or found as they were
                self._file.execute("BEGIN EXCLUSIVE")
                self._file.execute(f"PRAGMA application_id = {APPLICATION}")
                self._file.execute("CREATE TABLE IF NOT EXISTS header (line BLOB NOT NULL)")
                self._file.execute(
                    "CREATE TABLE IF NOT EXISTS rows (stage TEXT, number INTEGER, line BLOB NOT NULL,"
                    " PRIMARY KEY (stage, number)) WITHOUT ROWID"
                )
                self._file.execute("CREATE TABLE IF NOT EXISTS timings (start, stop, seconds, worker)")
                if (stored := self._file.execute("SELECT line FROM header").fetchone()) is None:
                    self._file.execute("INSERT INTO header VALUES (?)", (self.header,))
                else:
                    refuse_foreign(self.path, json.loads(stored[0]), header)
                self._file.execute("COMMIT")
        except BaseException:
            self._file.close()
            raise

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Raise the errors of SQLite as errors of the file."""
        try:
            yield
        except sqlite3.DatabaseError as error:
            if "not a database" in str(error):
                raise CampaignError(f"{self.path}: does not belong to a campaign; choose another folder") from error
            locked = "is in use by another process" if "locked" in str(error) else f"cannot be written: {error}"
            raise FileError(self.path, locked) from error

    def rows(self, stage: str = "") -> Iterator[tuple[int, dict[str, Any]]]:
        """The valid rows of a stage with their indices, in order."""
        with self._errors():
            for number, line in self._file.execute(
                "SELECT number, line FROM rows WHERE stage = ? ORDER BY number", (stage,)
            ):
                row = self._checksums.row(line)
                if row is None or row.pop("index", None) != number:
                    self.damaged += 1
                else:
                    yield number, row

    def append(
        self, start: int, lines: Sequence[bytes], stage: str = "", timing: tuple[float, str] | None = None
    ) -> None:
        """Store consecutive rows, the first of which has the index ``start``, each with its checksum.

        ``timing`` is the duration of the chunk in seconds, and the worker that computed it.
        """
        entries = ((stage, number, self._checksums.add(line)) for number, line in enumerate(lines, start))
        with self._errors():
            self._file.execute("BEGIN")
            try:
                self._file.executemany("INSERT OR REPLACE INTO rows VALUES (?, ?, ?)", entries)
                if timing is not None:
                    self._file.execute("INSERT INTO timings VALUES (?, ?, ?, ?)", (start, start + len(lines), *timing))
                self._file.execute("COMMIT")
            except BaseException:
                if self._file.in_transaction:  # SQLite itself rolls back if the disk is full
                    self._file.execute("ROLLBACK")
                raise

    def lines(self, stage: str = "") -> Iterator[bytes]:
        """The lines of the rows with their checksums, in order."""
        with self._errors():
            query = "SELECT line FROM rows WHERE stage = ? ORDER BY number"
            yield from (line for (line,) in self._file.execute(query, (stage,)))

    def timings(self) -> list[dict[str, Any]]:
        """The durations and workers of all chunks, in order of their completion."""
        with self._errors():
            rows = self._file.execute("SELECT start, stop, seconds, worker FROM timings ORDER BY rowid").fetchall()
        return [dict(zip(("start", "stop", "seconds", "worker"), row, strict=True)) for row in rows]

    def remove(self) -> None:
        """Close and remove the file, after its rows were stored elsewhere."""
        self._file.close()
        for path in (self.path, *(self.path.with_name(f"{JOURNAL}{suffix}") for suffix in ("-wal", "-shm"))):
            with os_errors(path, "cannot be removed"):
                path.unlink(missing_ok=True)

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def ranges_missing(done: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """The ranges (start, stop) of consecutive items that are not done."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~done, [False]]).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def refuse_foreign(path: Path, there: Mapping[str, Any], header: Mapping[str, Any]) -> None:
    """Raise :class:`CampaignError` if the header of a file differs from ``header``; names the differences."""
    if to_line(there) == to_line(header):
        return
    if there.get("schema") != header.get("schema"):
        schemas = f"the schema {there.get('schema')}, but {header.get('schema')} is required"
        raise CampaignError(f"{path}: has {schemas}; choose another folder")
    # The parts of the work that differ, by name
    theirs, ours = (dict(part.get("setup", {})) for part in (there, header))
    different = [
        f"{name} ({theirs.get(name, 'nothing')} there, {ours.get(name, 'nothing')} here)"
        for name in dict.fromkeys([*ours, *theirs])
        if theirs.get(name) != ours.get(name)
    ]
    raise CampaignError(
        f"{path}: belongs to another campaign, which differs in {'; '.join(different) or 'its header'}. Choose another "
        "folder, or remove this one to start again"
    )
