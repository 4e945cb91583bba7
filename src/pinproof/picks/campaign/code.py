"""Which code judges: rows of one file come from one code, whoever goes on with it and wherever the workers are."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pinproof import __version__
from pinproof.picks.identity import LENGTH, digest

__all__ = ["code_here", "judge_words"]

PACKAGE = Path(__file__).parents[2]

BESIDE_IT = ("benchmarks", "cli", "viewer")
"""Rooms that no verdict comes from: a folder is not to be refused for a word of help that was mended."""

LIBRARIES = ("pin", "coal", "numpy", "numba")
"""The libraries whose numbers stand in verdicts."""


@cache
def code_here() -> str:
    """The code of this process in a line: version and hash of pinproof's own source, and the libraries beneath it.

    A version is not enough: it stays the same in a checkout that is worked on.
    """
    into = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py"), key=lambda path: path.relative_to(PACKAGE).as_posix()):
        name = path.relative_to(PACKAGE)
        if name.parts[0] not in BESIDE_IT:
            content = path.read_bytes()
            into.update(f"{name.as_posix()}\0{len(content)}\0".encode() + content)
    libraries = ", ".join(f"{name} {_version(name)}" for name in LIBRARIES)
    return f"{__version__} {into.hexdigest()[:LENGTH]} on {libraries}"


def judge_words(judge: Callable[..., Any]) -> str:
    """A judge by its name and, if it is not one of pinproof's own, a hash of its source."""
    name = f"{judge.__module__}.{judge.__qualname__}"
    if judge.__module__.partition(".")[0] == PACKAGE.name:
        return name
    try:
        return f"{name} {digest(inspect.getsource(judge))}"
    except (OSError, TypeError):  # without a source file it goes by its name
        return name


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
