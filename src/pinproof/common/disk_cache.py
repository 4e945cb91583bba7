"""A cache on disk for values that follow from the content of files and take long to compute, such as convex hulls.

An entry is found by a hash of its inputs, of the source files that compute it, and of the versions of the libraries. An
entry that is damaged or cannot be read is computed again, so the cache never changes a result. It is in the user's
cache folder (``XDG_CACHE_HOME``); the environment variable ``PINPROOF_CACHE`` names another folder, or is ``off``.
"""

from __future__ import annotations

import hashlib
import json
import os
import uuid
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

LARGEST_CACHE = 512 * 2**20
"""Bytes (512 MiB). The oldest entries are deleted when new ones exceed it; a robot needs 5 to 20 MiB."""

Arrays = Mapping[str, npt.NDArray[Any]]


def folder() -> Path | None:
    """The folder of the cache; None if it is disabled or cannot be created."""
    stated = os.environ.get("PINPROOF_CACHE", "")
    if stated.lower() in ("off", "0", "no"):
        return None
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "pinproof" / "meshes"
    place = Path(stated) if stated else base
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return place if os.access(place, os.W_OK) else None


def content_digest(*parts: bytes | npt.NDArray[Any] | str | float | None) -> str:
    """A hash (hexadecimal) of bytes, arrays, texts and numbers."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(repr((part.dtype.str, part.shape)).encode())
            data = np.ascontiguousarray(part).tobytes()
        else:
            data = part if isinstance(part, bytes) else repr(part).encode("utf-8", "backslashreplace")
        digest.update(b"%d:" % len(data))
        digest.update(data)
    return digest.hexdigest()


def cached(
    kind: str, key: str, make: Callable[[], Arrays], *, code: Sequence[str], libraries: Sequence[str] = ()
) -> Arrays:
    """The arrays of an entry, computed by ``make`` if it does not exist.

    Parameters
    ----------
    kind
        What is computed.
    key
        The hash of all inputs (:func:`content_digest`).
    make
        Computes the arrays by name; texts are arrays of ``uint8``. Its exceptions are not cached.
    code
        The source files that determine the result.
    libraries
        The distributions whose versions determine the result.
    """
    place = folder()
    if place is None:
        return make()
    path = place / f"{content_digest(kind, key, _made_with(tuple(code), tuple(libraries)))}.npz"
    damaged = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile)
    with suppress(*damaged), path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}
    found = make()
    content = BytesIO()
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in found.items()}
    np.savez(content, **arrays)
    temporary = path.with_name(f".{uuid.uuid4().hex}.part")
    try:
        temporary.write_bytes(content.getvalue())
        temporary.replace(path)
        _delete_oldest(place)
    except OSError:  # a full disk, for example; the result is valid nevertheless
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
    return found


@cache
def _made_with(code: tuple[str, ...], libraries: tuple[str, ...]) -> str:
    from importlib.metadata import version

    sources = [hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in code]
    return json.dumps([sources, {name: version(name) for name in ("numpy", *libraries)}])


def _delete_oldest(place: Path) -> None:
    entries = [(entry.stat(), entry) for entry in place.glob("*.npz")]
    total = 0
    for status, entry in sorted(entries, key=lambda each: each[0].st_mtime_ns, reverse=True):
        total += status.st_size
        if total > LARGEST_CACHE:
            entry.unlink(missing_ok=True)
