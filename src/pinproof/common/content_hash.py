"""Short content hashes that are equal for equal values in every process and on every machine."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from pinproof.spatial import SE3, matrix

LENGTH = 16
"""Hexadecimal digits (64 bits); an accidental collision is practically impossible."""


def digest(value: object) -> str:
    """Hash numbers, strings, arrays, transforms, dataclasses, and lists, tuples and mappings of these.

    Pickles are not suitable for this purpose, because equal values may have different pickles.

    Raises
    ------
    TypeError
        For any other type.
    """
    return digest_many([value])


def digest_many(values: Iterable[object]) -> str:
    """Hash a sequence of values, which may come from a generator; see :func:`digest`."""
    into = hashlib.sha256()
    for value in values:
        _update(into, value)
    return into.hexdigest()[:LENGTH]


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
    else:
        raise TypeError(f"cannot hash a {type(value).__name__}")


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

    into = hashlib.sha256(_core.SOURCE_HASH.encode())
    for path in sorted(PACKAGE.rglob("*.py"), key=lambda path: path.relative_to(PACKAGE).as_posix()):
        name = path.relative_to(PACKAGE)
        if name.parts[0] not in WITHOUT_VERDICTS:
            content = path.read_bytes()
            into.update(f"{name.as_posix()}\0{len(content)}\0".encode() + content)
    versions = []
    for library in ("pinproof", *LIBRARIES):
        try:
            versions.append(version(library))
        except PackageNotFoundError:
            versions.append("unknown")
    libraries = ", ".join(f"{name} {number}" for name, number in zip(LIBRARIES, versions[1:], strict=True))
    return f"{versions[0]} {into.hexdigest()[:LENGTH]} on {libraries}"
