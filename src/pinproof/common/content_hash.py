"""A short hash of a value: equal for equal content, in every process and on every machine."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np

from pinproof.spatial import SE3, matrix

__all__ = ["digest", "digest_many"]

LENGTH = 16
"""Hexadecimal digits: 64 bits, which no two set-ups of a lifetime share by accident."""


def digest(value: object) -> str:
    """The hash of numbers, texts, arrays, transforms, dataclasses, and of lists, tuples and mappings of such.

    Pickles will not do for this: equal values may have different ones.

    Raises
    ------
    TypeError
        For anything else.
    """
    return digest_many([value])


def digest_many(values: Iterable[object]) -> str:
    """:meth:`digest` of many values one after another, which need not all be there at a time."""
    into = hashlib.sha256()
    for value in values:
        _take_in(into, value)
    return into.hexdigest()[:LENGTH]


def _take_in(into: Any, value: object) -> None:
    if isinstance(value, np.generic):
        _take_in(into, value.item())
    elif value is None or isinstance(value, (bool, int, float, str, bytes)):
        word = repr(value).encode("utf-8", "backslashreplace")
        into.update(b"%d:" % len(word) + word)
    elif isinstance(value, np.ndarray):
        _take_in(into, (value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes()))
    elif isinstance(value, SE3):
        _take_in(into, matrix(value))
    elif isinstance(value, (Enum, PurePath)):
        _take_in(into, (type(value).__name__, str(value)))
    elif is_dataclass(value) and not isinstance(value, type):
        _take_in(into, (type(value).__name__, {field.name: getattr(value, field.name) for field in fields(value)}))
    elif isinstance(value, Mapping):
        into.update(b"{%d" % len(value))
        for key in sorted(value, key=repr):
            _take_in(into, (key, value[key]))
    elif isinstance(value, (list, tuple)):
        into.update(b"[%d" % len(value))
        for each in value:
            _take_in(into, each)
    else:
        raise TypeError(f"no hash is known for {type(value).__name__}")
