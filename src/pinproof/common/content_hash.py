"""Short content hashes that are equal in every process and on every machine, and a cache on disk by such hashes."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import uuid
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from io import BytesIO
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.spatial import SE3, matrix

LENGTH = 16
"""Hexadecimal digits (64 bits); an accidental collision is practically impossible."""


def digest(value: object) -> str:
    """Hash numbers, strings, arrays, transforms, dataclasses, and lists, tuples and mappings of these.

    Functions, and objects with attributes such as a planner of another program, are hashed by their code, and these by
    their attributes too.

    Pickles are not suitable for this purpose, because equal values may have different pickles. TypeError for any other
    type.
    """
    return digest_many([value])


def digest_many(values: Iterable[object], *, length: int = LENGTH) -> str:
    """Hash a sequence of values, which may come from a generator; see :func:`digest`."""
    into = hashlib.sha256()
    for value in values:
        _update(into, value)
    return into.hexdigest()[:length]


def _update(into: Any, value: object) -> None:
    if isinstance(value, np.generic):
        _update(into, value.item())
    elif value is None or isinstance(value, (bool, int, float, str, bytes)):
        word = repr(value).encode("utf-8", "backslashreplace")
        into.update(b"%d:" % len(word) + word)
    elif isinstance(value, np.ndarray):
        _update(into, (value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes()))
    elif isinstance(value, SE3):
        _update(into, matrix(value))
    elif isinstance(value, (Enum, PurePath)):
        _update(into, (type(value).__name__, str(value)))
    elif is_dataclass(value) and not isinstance(value, type):
        _update(into, (type(value).__name__, {field.name: getattr(value, field.name) for field in fields(value)}))
    elif isinstance(value, Mapping):
        into.update(b"{%d" % len(value))
        for key in sorted(value, key=repr):
            _update(into, (key, value[key]))
    elif isinstance(value, (list, tuple)):
        into.update(b"[%d" % len(value))
        for each in value:
            _update(into, each)
    elif hasattr(value, "__qualname__"):
        _update(into, describe_code(value))
    elif hasattr(value, "__dict__"):
        _update(into, (type(value), vars(value)))
    else:
        raise TypeError(f"cannot hash a {type(value).__name__}")


def describe_code(code: Any) -> str:
    """The name of a function or a class, followed by a hash of its source unless it is part of pinproof."""
    name = f"{code.__module__}.{code.__qualname__}"
    if code.__module__.partition(".")[0] == "pinproof":
        return name
    try:
        return f"{name} {digest(inspect.getsource(code))}"
    except (OSError, TypeError):  # without a source file, the name alone identifies it
        return name


PACKAGE = Path(__file__).parents[1]

WITHOUT_VERDICTS = ("cli", "viewer")
"""Packages that do not affect verdicts. They are not hashed, so editing them does not invalidate stored rows."""

LIBRARIES = ("pin", "coal", "numpy")
"""The libraries whose results enter the verdicts."""


@cache
def code_here() -> str:
    """The code of this process as one line: version and source hash of pinproof, and the versions of :data:`LIBRARIES`.

    The version alone is not sufficient, because it does not change while a checkout is being edited.
    """
    from pinproof import _core

    # The sources of the core and of all modules that affect verdicts
    into = hashlib.sha256(_core.SOURCE_HASH.encode())
    for path in sorted(PACKAGE.rglob("*.py"), key=lambda path: path.relative_to(PACKAGE).as_posix()):
        name = path.relative_to(PACKAGE)
        if name.parts[0] not in WITHOUT_VERDICTS:
            content = path.read_bytes()
            into.update(f"{name.as_posix()}\0{len(content)}\0".encode() + content)
    # The libraries whose results enter the verdicts
    versions = []
    for library in ("pinproof", *LIBRARIES):
        try:
            versions.append(version(library))
        except PackageNotFoundError:
            versions.append("unknown")
    libraries = ", ".join(f"{name} {number}" for name, number in zip(LIBRARIES, versions[1:], strict=True))
    return f"{versions[0]} {into.hexdigest()[:LENGTH]} on {libraries}"


# -- the cache ---------------------------------------------------------------------------------------------------------
#
# It holds values that follow from the content of files and take long to compute, such as convex hulls. An entry is
# found by a hash of its inputs, of the source files that compute it, and of the versions of the libraries. One that
# is damaged or cannot be read is computed again, so the cache never changes a result. It is in the user's cache folder
# (``XDG_CACHE_HOME``); the environment variable ``PINPROOF_CACHE`` names another folder, or is ``off``.

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
    """A hash (hexadecimal, 256 bits) of bytes, arrays, texts and numbers, for keys of the cache."""
    return digest_many(parts, length=64)


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
    # An entry that cannot be read is computed again
    damaged = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile)
    with suppress(*damaged), path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}
    found = make()
    # The entry is written to a new file, so that other processes never read an incomplete one
    content = BytesIO()
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in found.items()}
    np.savez(content, **arrays)
    temporary = path.with_name(f".{uuid.uuid4().hex}.part")
    try:
        temporary.write_bytes(content.getvalue())
        temporary.replace(path)
        # the new entry replaces the oldest ones
        entries, total = [(entry.stat(), entry) for entry in place.glob("*.npz")], 0
        for status, entry in sorted(entries, key=lambda each: each[0].st_mtime_ns, reverse=True):
            total += status.st_size
            if total > LARGEST_CACHE:
                entry.unlink(missing_ok=True)
    except OSError:  # a full disk, for example; the result is valid nevertheless
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
    return found


@cache
def _made_with(code: tuple[str, ...], libraries: tuple[str, ...]) -> str:
    from importlib.metadata import version

    sources = [hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in code]
    return json.dumps([sources, {name: version(name) for name in ("numpy", *libraries)}])
