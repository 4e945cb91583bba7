"""YAML files read with care: mappings know their line; a key given twice or not asked for is refused.

Numbers of a file that can only be meant in another unit: degrees for radians, millimetres for metres.

Only where the number itself proves it: 30 rad may be somebody's limit, but nobody turns a table by 90 rad.
"""

from __future__ import annotations

import math
import re
from collections.abc import Hashable, Iterable, Sequence
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer, ComposerError
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.parser import Parser
from yaml.reader import Reader
from yaml.resolver import Resolver
from yaml.scanner import Scanner

from pinproof.common.files import read_text
from pinproof.errors import FileError, InputError, UnknownNameError

__all__ = [
    "MOST_REACH",
    "YAML_SUFFIXES",
    "LinedMapping",
    "listed",
    "read_yaml",
    "refuse_degree_limit",
    "refuse_degrees",
    "refuse_millimetres",
    "refuse_unknown",
]

YAML_SUFFIXES = (".yaml", ".yml")

LARGEST_YAML = 16 * 2**20
"""Bytes (16 MiB): some 40 s of parsing. What is larger has its place in a file of another kind."""

MOST_VALUES = 3_000_000
"""Values in a file once its aliases are written out: nine aliases of nine of nine ... fill any memory."""

LARGEST_INTEGER = 10**300
"""Beyond it an integer is no double, and Python refuses to print it."""

_END_MARK = re.compile(r"\n---\s*\Z")
"""What ``ros2 topic echo`` prints after each message; it would begin a second, empty document."""

_NO_YAML = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")
"""Characters that YAML does not allow (YAML 1.1, section 5.1)."""


def read_yaml(
    path: Path, keys: Iterable[str], error: type[FileError], *, suffixes: tuple[str, ...] = YAML_SUFFIXES
) -> LinedMapping:
    """The mapping a YAML file holds.

    Parameters
    ----------
    path
        The file; its name ends in one of ``suffixes``. JSON is read as the YAML that it is.
    keys
        The keys it may have, for the message when it is no mapping at all.
    error
        What is raised when it cannot be read; names file and line.
    """
    if path.suffix.lower() not in suffixes:
        raise error(path, f"unknown kind of file {path.suffix!r}; valid: {', '.join(suffixes)}")
    remedy = "put meshes and points in mesh files, picks in a CSV table"
    text = _END_MARK.sub("\n", read_text(path, error, largest=LARGEST_YAML, remedy=remedy))
    if odd := _NO_YAML.search(text):
        line = text.count("\n", 0, odd.start()) + 1
        raise error(path, f"is no valid YAML: it holds the character U+{ord(odd[0]):04X}", f"line {line}")
    try:
        content = _LinedLoader(text).get_single_data()
    except RecursionError as caught:
        raise error(path, "is no valid YAML: it is nested too deep") from caught
    except Exception as caught:  # not only YAMLErrors: dates and tags that make no sense raise what Python raises
        mark = getattr(caught, "problem_mark", None)
        problem = getattr(caught, "problem", None) or str(caught) or type(caught).__name__
        context = getattr(caught, "context_mark", None)
        if mark and context and context.line != mark.line:
            problem += f" (for what begins in line {context.line + 1})"
        if mark and "\t" in _indent(text, mark.line):
            problem += "; indent with blanks, YAML takes no tabs there"
        raise error(path, f"is no valid YAML: {problem}", f"line {mark.line + 1}" if mark else "") from caught
    if not isinstance(content, LinedMapping):
        what = "is empty" if content is None else f"holds {type(content).__name__}"
        raise error(path, f"{what}; wanted are the keys {', '.join(keys)}")
    return content


class LinedMapping(dict[Any, Any]):
    """A YAML mapping that knows on which line it starts."""

    line: int


def listed(error: type[FileError], path: Path, key: str, stated: object) -> list[Any]:
    """A list, which is what must stand under ``key``."""
    if not isinstance(stated, list):
        how = ": write '- ' before each" if isinstance(stated, dict) else ""
        raise error(path, f"holds {stated!r}, not a list{how}", f"key {key}")
    return stated


def refuse_unknown(
    error: type[FileError], path: Path, kind: str, stated: Iterable[Any], valid: tuple[str, ...], where: str
) -> None:
    """Refuse the first key that is not one of ``valid``, naming those that are."""
    for key in stated:
        if key not in valid:
            comma = "; decimals have a point, not a comma" if isinstance(key, int) else ""
            raise error(path, f"{UnknownNameError(kind, key, valid)}{comma}", where)


def _indent(text: str, line: int) -> str:
    lines = text.split("\n", line + 1)
    return re.match(r"\s*", lines[line])[0] if line < len(lines) else ""  # type: ignore[index]  # always matches


class _PlainParser(Reader, Scanner, Parser):
    """From text to events, in Python."""

    def __init__(self, stream: str) -> None:
        Reader.__init__(self, stream)
        Scanner.__init__(self)
        Parser.__init__(self)


_Parser: Any = getattr(getattr(yaml, "cyaml", None), "CParser", _PlainParser)
"""libyaml's, four times as fast, where PyYAML was built with it."""


class _LinedLoader(Composer, _Parser, SafeConstructor, Resolver):  # type: ignore[misc]  # PyYAML's way to make loaders
    """A loader of plain values whose mappings know their line, and which refuses what would be read wrongly.

    That is a key given twice (YAML would keep the last), ``010`` (YAML's 8) and ``1:30`` (its 90). The composer is
    PyYAML's own: libyaml's recurses in C, and a file nested deep enough would end the interpreter.
    """

    def __init__(self, stream: str) -> None:
        _Parser.__init__(self, stream)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._values = 0
        self._values_of: dict[str, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """A node, counted with all that stands in it."""
        event: Any = self.peek_event()
        alias = isinstance(event, yaml.AliasEvent)
        before = self._values
        node = super().compose_node(parent, index)
        if not alias:
            self._values += 1
            if event.anchor is not None:
                self._values_of[event.anchor] = self._values - before
        elif event.anchor not in self._values_of:
            raise ComposerError(None, None, f"the alias *{event.anchor} stands in what it names", event.start_mark)
        else:
            self._values += self._values_of[event.anchor]
        if self._values > MOST_VALUES:
            what = f"it holds more than {MOST_VALUES} values once its aliases are written out"
            raise ComposerError(None, None, what, event.start_mark)
        return node


def _lined(loader: _LinedLoader, node: yaml.MappingNode) -> Any:
    mapping = LinedMapping()
    mapping.line = node.start_mark.line + 1
    yield mapping
    for key_node, value_node in node.value:
        if key_node.tag == "tag:yaml.org,2002:merge":
            raise ConstructorError(None, None, "<< is not read; write the keys out", key_node.start_mark)
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, Hashable):
            raise ConstructorError(None, None, "a list or a mapping is no key", key_node.start_mark)
        if key in mapping:
            raise ConstructorError(None, None, f"the key {key!r} is given twice", key_node.start_mark)
        mapping[key] = loader.construct_object(value_node, deep=True)


def _number(loader: _LinedLoader, node: yaml.ScalarNode) -> int | float:
    """A number as it looks; YAML 1.1 has octal numbers and numbers to the base 60 that look like others."""
    if ":" in node.value or re.match(r"[+-]?0[0-9_]", node.value):
        why = f"{node.value!r} is another number in YAML 1.1; write it as a decimal, or a text in quotes"
        raise ConstructorError(None, None, why, node.start_mark)
    if node.tag.endswith(":float"):
        return float(loader.construct_yaml_float(node))
    value = int(loader.construct_yaml_int(node))
    if abs(value) > LARGEST_INTEGER:
        raise ConstructorError(None, None, "an integer here is larger than any double", node.start_mark)
    return value


for _kind, _made in (("map", _lined), ("int", _number), ("float", _number)):
    _LinedLoader.add_constructor(f"tag:yaml.org,2002:{_kind}", _made)


MOST_TURN = 4 * math.pi
"""Rad. An orientation is written within one turn, or two; 15 degrees and more lie beyond."""

DEGREE_LIMITS = (50.0, 720.0)
"""A whole number of radians between these, as the limit of a joint: eight turns and more, or two turns in degrees."""

MOST_REACH = 100.0
"""Metres. What an arm shall reach, or bears, is no farther off."""


def refuse_degrees(name: str, angles: Sequence[float]) -> None:
    """Refuse angles of an orientation beyond two turns.

    Raises
    ------
    InputError
        That says what they would be in radians.
    """
    for angle in angles:
        if abs(angle) > MOST_TURN:
            raise InputError(f"{name}: {angle:g} rad is more than two turns; {_degrees(angle)}")


def refuse_degree_limit(name: str, limit: float | None) -> None:
    """The same for a limit of a turning joint, which may have many turns."""
    if limit is not None and DEGREE_LIMITS[0] < abs(limit) <= DEGREE_LIMITS[1] and limit == round(limit):
        raise InputError(f"{name}: {limit:g} rad is {abs(limit) / math.tau:.0f} turns; {_degrees(limit)}")


def refuse_millimetres(name: str, lengths: Sequence[float]) -> None:
    """Refuse lengths (m) of which one is beyond 100 m, and each 1 m or more, or 0: no arm has such a set of them.

    Raises
    ------
    InputError
        That says what they would be in metres.
    """
    stated = [abs(length) for length in lengths if length]
    if stated and max(stated) > MOST_REACH and min(stated) >= 1.0:
        far = max(stated)
        raise InputError(f"{name}: {far:g} m; lengths are metres, {far:g} millimetres are {far / 1000:g}")


def _degrees(angle: float) -> str:
    return f"angles are radians, {angle:g} degrees are {math.radians(angle):.6g}"
