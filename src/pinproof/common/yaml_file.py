"""Reading YAML input files, with line numbers in error messages. Duplicate and unknown keys are errors."""

from __future__ import annotations

import math
import re
from collections.abc import Hashable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml
from yaml.composer import Composer, ComposerError
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.parser import Parser
from yaml.reader import Reader
from yaml.resolver import Resolver
from yaml.scanner import Scanner

from pinproof.common.files import read_text, unknown_suffix, write_text_whole
from pinproof.errors import FileError, UnknownNameError

YAML_SUFFIXES = (".yaml", ".yml")

LARGEST_YAML = 16 * 2**20
"""Bytes (16 MiB), about 40 s of parsing. Larger data belongs in mesh files or CSV tables."""

MOST_VALUES = 3_000_000
"""Largest number of values after the expansion of aliases; nested aliases could otherwise fill the memory."""

LARGEST_INTEGER = 10**300
"""Larger integers cannot be converted to a double or printed."""

_END_MARK = re.compile(r"\n---\s*\Z")
"""The separator that ``ros2 topic echo`` prints after each message; it would start a second, empty document."""

_NO_YAML = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")
"""Characters that YAML does not allow (YAML 1.1, section 5.1)."""


def read_yaml(
    path: Path, keys: Iterable[str], error: type[FileError], *, suffixes: tuple[str, ...] = YAML_SUFFIXES
) -> LinedMapping:
    """Read a YAML file that contains a mapping.

    Parameters
    ----------
    path
        The file, with one of the ``suffixes``. JSON files are valid YAML.
    keys
        The valid keys, for the message if the file does not contain a mapping.
    error
        Type of the exception if the file cannot be read; the message states file and line.
    """
    if path.suffix.lower() not in suffixes:
        raise error(path, unknown_suffix(path, suffixes))
    remedy = "put meshes and points in mesh files, picks in a CSV table"
    text = _END_MARK.sub("\n", read_text(path, error, largest=LARGEST_YAML, remedy=remedy))
    if odd := _NO_YAML.search(text):
        line = text.count("\n", 0, odd.start()) + 1
        raise error(path, f"is not valid YAML: it contains the character U+{ord(odd[0]):04X}", f"line {line}")
    try:
        content = _LinedLoader(text).get_single_data()
    except RecursionError as caught:
        raise error(path, "is not valid YAML: it is nested too deeply") from caught
    except Exception as caught:  # invalid dates and tags raise other exceptions than YAMLError
        mark = getattr(caught, "problem_mark", None)
        problem = getattr(caught, "problem", None) or str(caught) or type(caught).__name__
        if "nesting depth" in problem:  # PyYAML 6.0.4 has a limit of its own; earlier versions end with RecursionError
            problem = "it is nested too deeply"
        context = getattr(caught, "context_mark", None)
        if mark and context and context.line != mark.line:
            problem += f" (in the block that starts in line {context.line + 1})"
        if mark and "\t" in _indent(text, mark.line):
            problem += "; indent with spaces, YAML does not allow tabs"
        raise error(path, f"is not valid YAML: {problem}", f"line {mark.line + 1}" if mark else "") from caught
    if not isinstance(content, LinedMapping):
        what = "is empty" if content is None else f"contains a {type(content).__name__}, not a mapping"
        raise error(path, f"{what}; valid keys: {', '.join(keys)}")
    return content


def write_yaml(path: str | Path, content: Mapping[str, Any], error: type[FileError]) -> None:
    """Write a YAML file atomically; raise ``error`` if its suffix is another, or it cannot be written."""
    path = Path(path)
    if path.suffix.lower() not in YAML_SUFFIXES:
        raise error(path, unknown_suffix(path, YAML_SUFFIXES))
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None)
    write_text_whole(path, text, error)


class LinedMapping(dict[Any, Any]):
    """A YAML mapping with the line and the column where it starts, and the positions of its keys."""

    line: int
    column: int
    positions: Mapping[Any, tuple[int, int]] = MappingProxyType({})

    def at(self, key: object = None) -> str:
        """Return the position of a key, or of the mapping, for messages: ``line 3, column 1``; empty without one."""
        line, column = self.positions.get(key, (self.line, self.column)) if self.positions else (0, 0)
        return f"line {line}, column {column}" if line else ""

    def place(self, key: object, kind: str = "key") -> str:
        """Return the position of a key for messages: ``line 3, column 1, key robot``."""
        if key not in self.positions:
            return f"{kind} {key}"
        line, column = self.positions[key]
        return f"line {line}, column {column}, {kind} {key}"


def require_list(error: type[FileError], path: Path, key: str, stated: object) -> list[Any]:
    """Return the value of ``key``, which must be a list."""
    if not isinstance(stated, list):
        how = "; write '- ' before each element" if isinstance(stated, dict) else ""
        raise error(path, f"is {stated!r}, not a list{how}", f"key {key}")
    return stated


def refuse_unknown(
    error: type[FileError], path: Path, kind: str, stated: Iterable[Any], valid: tuple[str, ...], where: str
) -> None:
    """Raise ``error`` for the first key that is not in ``valid``."""
    for key in stated:
        if key not in valid:
            comma = "; use a decimal point, not a comma" if isinstance(key, int) else ""
            place = where or (stated.place(key) if isinstance(stated, LinedMapping) else "")
            raise error(path, f"{UnknownNameError(kind, key, valid)}{comma}", place)


def _indent(text: str, line: int) -> str:
    lines = text.split("\n", line + 1)
    return re.match(r"\s*", lines[line])[0] if line < len(lines) else ""  # type: ignore[index]  # always matches


class _PlainParser(Reader, Scanner, Parser):
    """The parser of PyYAML in pure Python."""

    def __init__(self, stream: str) -> None:
        Reader.__init__(self, stream)
        Scanner.__init__(self)
        Parser.__init__(self)


_Parser: Any = getattr(getattr(yaml, "cyaml", None), "CParser", _PlainParser)
"""The parser of libyaml where available; it is four times as fast."""


class _LinedLoader(Composer, _Parser, SafeConstructor, Resolver):  # type: ignore[misc]  # PyYAML is not typed
    """A loader of plain values that stores line numbers and rejects ambiguous content.

    Ambiguous are duplicate keys (PyYAML keeps the last), ``010`` (8 in YAML 1.1) and ``1:30`` (90 in YAML 1.1). The
    composer of PyYAML is used, because the composer of libyaml recurses in C and crashes on deeply nested files.
    """

    def __init__(self, stream: str) -> None:
        _Parser.__init__(self, stream)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._values = 0
        self._values_of: dict[str, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node and count the values in it."""
        event: Any = self.peek_event()
        alias = isinstance(event, yaml.AliasEvent)
        before = self._values
        node = super().compose_node(parent, index)
        if not alias:
            self._values += 1
            if event.anchor is not None:
                self._values_of[event.anchor] = self._values - before
        elif event.anchor not in self._values_of:
            raise ComposerError(None, None, f"the alias *{event.anchor} refers to its own parent", event.start_mark)
        else:
            self._values += self._values_of[event.anchor]
        if self._values > MOST_VALUES:
            what = f"it has more than {MOST_VALUES} values after the expansion of aliases"
            raise ComposerError(None, None, what, event.start_mark)
        return node


def _lined(loader: _LinedLoader, node: yaml.MappingNode) -> Any:
    mapping = LinedMapping()
    mapping.line, mapping.column = node.start_mark.line + 1, node.start_mark.column + 1
    mapping.positions = positions = {}
    yield mapping
    for key_node, value_node in node.value:
        if key_node.tag == "tag:yaml.org,2002:merge":
            raise ConstructorError(None, None, "merge keys (<<) are not supported", key_node.start_mark)
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, Hashable):
            raise ConstructorError(None, None, "a list or a mapping cannot be a key", key_node.start_mark)
        if key in mapping:
            raise ConstructorError(None, None, f"duplicate key {key!r}", key_node.start_mark)
        positions[key] = key_node.start_mark.line + 1, key_node.start_mark.column + 1
        mapping[key] = loader.construct_object(value_node, deep=True)


def _number(loader: _LinedLoader, node: yaml.ScalarNode) -> int | float:
    """Construct a decimal number; octal and base 60 numbers of YAML 1.1 are rejected because they look like others."""
    if ":" in node.value or re.match(r"[+-]?0[0-9_]", node.value):
        why = f"{node.value!r} is ambiguous in YAML 1.1; write a decimal number, or quote the text"
        raise ConstructorError(None, None, why, node.start_mark)
    if node.tag.endswith(":float"):
        return float(loader.construct_yaml_float(node))
    value = int(loader.construct_yaml_int(node))
    if abs(value) > LARGEST_INTEGER:
        raise ConstructorError(None, None, "an integer here is larger than any double", node.start_mark)
    return value


def _angle(loader: _LinedLoader, node: yaml.ScalarNode) -> float:
    """Construct ``!degrees 90`` and ``!radians 1.5``, which are tags of xacro and MoveIt, as radians."""
    try:
        value = parse_number(loader.construct_scalar(node))
    except (ValueError, ConstructorError) as error:
        raise ConstructorError(None, None, f"the value of {node.tag}: {error}", node.start_mark) from error
    return math.radians(value) if node.tag == "!degrees" else value


def _unknown_tag(_loader: _LinedLoader, node: yaml.Node) -> None:
    raise ConstructorError(None, None, f"unknown tag {node.tag!r}; valid: {', '.join(ANGLE_TAGS)}", node.start_mark)


ANGLE_TAGS = ("!degrees", "!radians")
for _tag in ANGLE_TAGS:
    _LinedLoader.add_constructor(_tag, _angle)
_LinedLoader.add_constructor(None, _unknown_tag)

for _kind, _made in (("map", _lined), ("int", _number), ("float", _number)):
    _LinedLoader.add_constructor(f"tag:yaml.org,2002:{_kind}", _made)


_DECIMAL = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_PLAIN = rf"[+-]?{_DECIMAL}(?:[eE][+-]?[0-9]+)?"
_WITH_PI = rf"([+-]?)(?:({_DECIMAL})\s*\*\s*)?pi(?:\s*/\s*(?=[0-9.]*[1-9])({_DECIMAL}))?"  # not divided by zero
_WITH_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+")

NUMBER_PATTERN = rf"^\s*(?:{_PLAIN}|{_WITH_PI})\s*$"
"""The texts that :func:`parse_number` accepts, as a regular expression for JSON Schema."""


def parse_number(value: object) -> float:
    """Parse a number of a file: a number, or text such as ``0.33``, ``1e-3``, ``-pi/2`` or ``3*pi/4``.

    Raises
    ------
    ValueError
        For anything else; expressions are not evaluated.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise ValueError("the integer is too large for a double") from None
    text = value.strip() if isinstance(value, str) else ""
    if re.fullmatch(_PLAIN, text):
        return float(text)
    match = re.fullmatch(_WITH_PI, text)
    if match is None or (match[3] is not None and float(match[3]) == 0.0):
        comma = ": use a decimal point, not a comma" if _WITH_COMMA.fullmatch(text) else ""
        raise ValueError(
            f"{value!r} is not a number{comma}; write a decimal number, or a multiple of pi such as -pi/2 or 3*pi/4"
        )
    size = float(match[2] or 1) * math.pi / float(match[3] or 1)
    return -size if match[1] == "-" else size
