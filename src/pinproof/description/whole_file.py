"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import uuid
from pathlib import Path

from pinproof.errors import FileError

__all__ = ["write_bytes_whole", "write_text_whole"]


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
