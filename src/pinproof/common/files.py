"""Reading an input file: only what is a file, only as much as makes sense, and text only as UTF-8.

Writing a file whole or not at all.
"""

from __future__ import annotations

import codecs
import os
import stat
import uuid
from pathlib import Path

from pinproof.errors import FileError

__all__ = [
    "LARGEST_TEXT",
    "is_file",
    "read_bytes",
    "read_text",
    "refuse_unreadable",
    "write_bytes_whole",
    "write_text_whole",
]

LARGEST_TEXT = 64 * 2**20
"""Bytes of a text file (64 MiB). The largest URDF in the wild has one; parsed, such a file takes a gigabyte."""

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_bytes(path: Path, error: type[FileError], *, largest: int = LARGEST_TEXT, remedy: str = "") -> bytes:
    """What stands in a file.

    Parameters
    ----------
    path
        The file.
    error
        What is raised if it cannot be read.
    largest
        Bytes that it may have; it is not opened if it has more.
    remedy
        What to do then.
    """
    refuse_unreadable(path, error, largest=largest, remedy=remedy)
    try:
        return path.read_bytes()
    except OSError as caught:
        raise error(path, f"cannot be read: {caught.strerror or caught}") from caught


def read_text(path: Path, error: type[FileError], *, largest: int = LARGEST_TEXT, remedy: str = "") -> str:
    """The text of a file, without a byte order mark; else as :func:`read_bytes`."""
    data = read_bytes(path, error, largest=largest, remedy=remedy)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as caught:
        # What Windows PowerShell writes with > and Notepad calls "Unicode".
        hint = "it looks like UTF-16" if data.startswith(_UTF_16) else f"{caught.reason}"
        line = data.count(b"\n", 0, caught.start) + 1
        raise error(path, f"is not UTF-8 text ({hint}); save it as UTF-8", f"line {line}") from caught


def refuse_unreadable(path: Path, error: type[FileError], *, largest: int | None, remedy: str = "") -> None:
    """Refuse what is no file (a pipe would be waited on for ever, a device never ends), or larger than ``largest``."""
    try:
        status = path.stat()
    except (OSError, ValueError) as caught:  # ValueError: a null character in the name
        raise error(ascii(str(path)) if "\0" in str(path) else path, f"cannot be read: {_reason(caught)}") from caught
    if not stat.S_ISREG(status.st_mode):
        what = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
        raise error(path, f"cannot be read: it is {what}, not a file")
    if largest is not None and status.st_size > largest:
        told = f"has {status.st_size / 2**20:,.0f} MiB; at most {largest / 2**20:,.0f} MiB are read"
        raise error(path, f"{told}: {remedy}" if remedy else told)


def is_file(path: Path) -> bool:
    """Whether there is a file of that name; no where the name itself is impossible (too long, a null character)."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _reason(caught: OSError | ValueError) -> str:
    return str(getattr(caught, "strerror", None) or caught)


def write_text_whole(path: str | Path, text: str) -> None:
    """Write ``text`` as UTF-8, its line ends as they are; else as :func:`write_bytes_whole`."""
    write_bytes_whole(path, text.encode("utf-8"))


def write_bytes_whole(path: str | Path, content: bytes) -> None:
    """Write ``content`` to ``path``, or leave what stands there untouched.

    It goes to a new file in the same folder, which then takes the place of ``path`` in one step: a crash, a full
    disk or a reader at the wrong moment never sees half a file.

    Raises
    ------
    FileError
        If the folder does not exist or cannot be written to.
    """
    target = Path(path)
    # Not tempfile: its files are readable by their owner only, and the replacing would hand that on.
    scratch = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    try:
        try:
            with scratch.open("xb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            scratch.replace(target)
        finally:
            scratch.unlink(missing_ok=True)
    except OSError as error:
        raise FileError(target, f"cannot be written: {error.strerror or error}") from error
