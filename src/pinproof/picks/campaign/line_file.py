"""A file that only grows, by whole lines; of a line that a kill has torn, the rest is dropped."""

from __future__ import annotations

import os
import time
from pathlib import Path
from types import TracebackType

from pinproof.errors import FileError

__all__ = ["LineFile"]

SYNC_SECONDS = 1.0
"""How often what was written is forced to the disk. A killed process loses nothing; only a machine that goes down
may lose this much."""


class LineFile:
    """A file open for appending; a torn last line is taken off by the first :meth:`append`.

    ``size`` is the number of bytes in whole lines, ``torn`` that of a last line without an end.

    Raises
    ------
    FileError
        If it cannot be opened or written to, a full disk for instance, or if another process has it open.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            # Unbuffered: what is written has left this process, and what failed is not tried again behind its back.
            self._file = path.open("a+b", buffering=0)
        except OSError as error:
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error
        try:
            self._lock()
            self.size = self._whole_size()
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
            raise FileError(self.path, "is being written by another process") from error
        except OSError:
            pass  # some network file systems know no locks; they keep nobody from working alone

    def _whole_size(self) -> int:
        """How many bytes make whole lines."""
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
        """Add whole lines.

        Raises
        ------
        FileError
            If they cannot be written, wholly or in part; a part is taken off when the file is next opened.
        """
        rest = memoryview(lines)
        try:
            if self.torn:
                self._file.truncate(self.size)
                self.torn = 0
            while rest:
                rest = rest[self._file.write(rest) :]
            if time.monotonic() - self._synced > SYNC_SECONDS:
                os.fsync(self._file.fileno())
                self._synced = time.monotonic()
        except OSError as error:
            raise FileError(self.path, f"cannot be written: {error.strerror or error}") from error
        self.size += len(lines)

    def close(self) -> None:
        """Let go of it."""
        self._file.close()

    def __enter__(self) -> LineFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
