"""Reading input files (regular files of limited size, text as UTF-8) and writing files atomically."""

from __future__ import annotations

import codecs
import csv
import io
import json
import math
import os
import re
import stat
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pinproof.errors import FileError, InputError

LARGEST_TEXT = 64 * 2**20
"""Bytes (64 MiB). Known URDF files have at most 1 MiB; a parsed file of this size takes about 1 GiB of memory."""

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_bytes(path: Path, error: type[FileError], *, largest: int = LARGEST_TEXT, remedy: str = "") -> bytes:
    """Read a regular file.

    Parameters
    ----------
    path
        The file.
    error
        Type of the exception if the file cannot be read.
    largest
        Largest size in bytes; larger files are not opened.
    remedy
        Advice for the message if the file is too large.
    """
    refuse_unreadable(path, error, largest=largest, remedy=remedy)
    with os_errors(path, error=error):
        return path.read_bytes()


def read_text(path: Path, error: type[FileError], *, largest: int = LARGEST_TEXT, remedy: str = "") -> str:
    """Read a UTF-8 text file without its byte order mark; parameters as for :func:`read_bytes`."""
    data = read_bytes(path, error, largest=largest, remedy=remedy)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as caught:
        # Windows PowerShell writes UTF-16 with >, and Notepad calls it "Unicode".
        hint = "it looks like UTF-16" if data.startswith(_UTF_16) else f"{caught.reason}"
        line = data.count(b"\n", 0, caught.start) + 1
        raise error(path, f"is not UTF-8 text ({hint}); save it as UTF-8", f"line {line}") from caught


def unknown_suffix(path: Path, valid: Iterable[str]) -> str:
    """The text of an error for a file whose name has another suffix than the valid ones."""
    stated = f"unknown file type {path.suffix!r}" if path.suffix else "the file name has no suffix"
    return f"{stated}; valid: {', '.join(valid)}"


def refuse_unreadable(path: Path, error: type[FileError], *, largest: int | None, remedy: str = "") -> None:
    """Raise ``error`` unless ``path`` is a regular file (a pipe may block forever) of at most ``largest`` bytes."""
    try:
        status = path.stat()
    except (OSError, ValueError) as caught:  # ValueError: a null character in the name
        raise error(ascii(str(path)) if "\0" in str(path) else path, f"cannot be read: {_reason(caught)}") from caught
    if not stat.S_ISREG(status.st_mode):
        what = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
        raise error(path, f"cannot be read: it is {what}, not a file")
    if largest is not None and status.st_size > largest:
        reason = f"has {status.st_size / 2**20:,.0f} MiB; the limit is {largest / 2**20:,.0f} MiB"
        raise error(path, f"{reason}: {remedy}" if remedy else reason)


def is_file(path: Path) -> bool:
    """Whether ``path`` is a file; False for invalid names (too long, a null character)."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _reason(caught: OSError | ValueError) -> str:
    return str(getattr(caught, "strerror", None) or caught)


@contextmanager
def os_errors(path: str | Path, failure: str = "cannot be read", error: type[FileError] = FileError) -> Iterator[None]:
    """Raise ``error`` with the path, ``failure`` and the reason in place of an OSError."""
    try:
        yield
    except OSError as caught:
        raise error(path, f"{failure}: {caught.strerror or caught}") from caught


def write_text_whole(path: str | Path, text: str, error: type[FileError] = FileError) -> None:
    """Write ``text`` atomically as UTF-8 with unchanged line ends; see :func:`write_bytes_whole`."""
    write_bytes_whole(path, text.encode("utf-8"), error)


def write_bytes_whole(path: str | Path, content: bytes | Iterable[bytes], error: type[FileError] = FileError) -> None:
    """Write ``content``, or the parts that it yields, to ``path`` atomically.

    The content is written to a new file in the same folder, which then replaces ``path``. After a crash or on a full
    disk the previous file is unchanged, and other processes never read an incomplete file.

    Raises
    ------
    error
        If the folder does not exist or cannot be written to.
    """
    target = Path(path)
    # tempfile is not used because its files are readable by their owner only.
    scratch = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    with os_errors(target, "cannot be written", error):
        try:
            with scratch.open("xb") as file:
                file.writelines([content] if isinstance(content, bytes) else content)
                file.flush()
                os.fsync(file.fileno())
            scratch.replace(target)
        finally:
            scratch.unlink(missing_ok=True)


def save_as(path: str | Path, formats: Mapping[str, Callable[[], str | bytes | None]]) -> None:
    """Write a file, completely or not at all, in the format that its suffix names.

    Parameters
    ----------
    path
        The file.
    formats
        For each suffix a function that returns the content, or that writes the file and returns None.

    Raises
    ------
    InputError
        For another suffix.
    FileError
        If the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in formats:
        raise InputError(f"{path}: {unknown_suffix(path, formats)}")
    content = formats[path.suffix.lower()]()
    if isinstance(content, str):
        write_text_whole(path, content)
    elif content is not None:
        write_bytes_whole(path, content)


def json_text(value: Any, indent: int = 1) -> str:
    """Plain values as JSON without NaN and infinity."""
    return json.dumps(value, indent=indent, allow_nan=False) + "\n"


def csv_text(columns: Sequence[str], rows: Iterable[Iterable[object]], *, comment: str = "") -> str:
    """A table as CSV below an optional line of comment."""
    out = io.StringIO()
    out.write(f"{comment}\n" if comment else "")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return out.getvalue()


def other_separator(header: Sequence[str]) -> str:
    """Return an error text if the header is separated by semicolons or tabs, as some spreadsheets do, else ''."""
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and separator in header[0]:
            return f"columns are separated by {name}; save the file with commas between columns and decimal points"
    return ""


def figure(value: float | None) -> str:
    """A number with nine digits in a CSV table; empty for None and NaN."""
    return "" if value is None or math.isnan(value) else f"{value:.9g}"


def file_stems(names: Iterable[str]) -> list[str]:
    """A file name without suffix for each name: unique, without folders, and never ``report`` or ``*.program``."""
    stems: list[str] = []
    used = {"report"}
    for name in names:
        plain = re.sub(r"[^\w.+-]+", "_", name).lstrip(".") or "pick"
        stem = plain = plain.replace(".program", "_program")  # the suffix of program files
        count = 1
        while stem.lower() in used:
            count += 1
            stem = f"{plain}_{count}"
        used.add(stem.lower())
        stems.append(stem)
    return stems
