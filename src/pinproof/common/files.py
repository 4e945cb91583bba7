"""Files: those of limited size are read, as UTF-8 text or YAML with line numbers; others are written atomically.

In YAML, duplicate and unknown keys are errors.
"""

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
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
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

from pinproof.errors import FileError, InputError, UnknownNameError

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
    remedy = "; a calibration of an arm belongs to --calibration" if path.suffix.lower() == ".conf" else ""
    return f"{stated}; valid: {', '.join(valid)}{remedy}"


def refuse_unreadable(path: Path, error: type[FileError], *, largest: int | None, remedy: str = "") -> None:
    """Raise ``error`` unless ``path`` is a regular file (a pipe may block forever) of at most ``largest`` bytes."""
    try:
        status = path.stat()
    except (OSError, ValueError) as caught:  # ValueError: a null character in the name
        reason = getattr(caught, "strerror", None) or caught
        raise error(ascii(str(path)) if "\0" in str(path) else path, f"cannot be read: {reason}") from caught
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
    disk the previous file is unchanged, and other processes never read an incomplete file. ``error`` is raised if the
    folder does not exist or cannot be written to.
    """
    # A new file in the same folder replaces the old one, which is atomic on every file system
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

    ``formats`` has for each suffix a function that returns the content, or that writes the file and returns None.
    InputError for another suffix, FileError if the file cannot be written.
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


def parse_json(text: str) -> Any:
    """Parse JSON; ValueError also if it holds NaN or infinity, or a key twice, of which Python would keep the last."""

    def not_finite(token: str) -> None:
        raise ValueError(f"it holds {token}; all numbers must be finite")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        if len(set(keys)) < len(keys):
            raise ValueError(f"it gives the key {next(key for key in keys if keys.count(key) > 1)!r} twice")
        return dict(pairs)

    try:
        return json.loads(text, parse_constant=not_finite, object_pairs_hook=once)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"invalid JSON: {error}") from error


def read_json(path: Path, error: type[FileError]) -> Any:
    """Read a JSON file as :func:`parse_json` does; raise ``error`` if it cannot be read."""
    try:
        return parse_json(read_text(path, error))
    except ValueError as caught:
        raise error(path, str(caught)) from caught


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
    # Equal names, also if they differ only in case, get a number
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


YAML_SUFFIXES = (".yaml", ".yml")

LARGEST_YAML = 16 * 2**20
"""Bytes (16 MiB), about 40 s of parsing. Larger data belongs in mesh files or CSV tables."""

MOST_VALUES = 3_000_000
"""Largest number of values after the expansion of aliases; nested aliases could otherwise fill the memory."""

LARGEST_INTEGER = 10**300
"""Larger integers cannot be converted to a double or printed."""

_END_MARK = re.compile(r"\n---\s*\Z")
"""The separator that ``ros2 topic echo`` prints after each message; it would start a second, empty document."""

_NO_YAML = "[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
"""Characters that YAML does not allow (YAML 1.1, section 5.1); compiled at first use, because it takes 10 ms."""


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
    # Text that YAML does not allow is refused by its line before it is parsed
    remedy = "put meshes and points in mesh files, picks in a CSV table"
    text = _END_MARK.sub("\n", read_text(path, error, largest=LARGEST_YAML, remedy=remedy))
    if odd := re.search(_NO_YAML, text):
        line = text.count("\n", 0, odd.start()) + 1
        raise error(path, f"is not valid YAML: it contains the character U+{ord(odd[0]):04X}", f"line {line}")
    # The error of the parser, with what a reader can do about it
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
        here = text.split("\n")[mark.line : mark.line + 1] if mark else []
        if here and "\t" in here[0][: len(here[0]) - len(here[0].lstrip())]:
            problem += "; indent with spaces, YAML does not allow tabs"
        raise error(path, f"is not valid YAML: {problem}", f"line {mark.line + 1}" if mark else "") from caught
    # A valid document of another kind
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


def refuse_unknown(
    error: type[FileError], path: Path, kind: str, stated: Iterable[Any], valid: tuple[str, ...], where: str
) -> None:
    """Raise ``error`` for the first key that is not in ``valid``."""
    for key in stated:
        if key not in valid:
            comma = "; use a decimal point, not a comma" if isinstance(key, int) else ""
            place = where or (stated.place(key) if isinstance(stated, LinedMapping) else "")
            raise error(path, f"{UnknownNameError(kind, key, valid)}{comma}", place)


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
        # An alias counts as many values as the value it refers to, so that nested aliases cannot fill the memory
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
    # 1:30 and 010 mean 90 and 8 in YAML 1.1
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

    ValueError for anything else; expressions are not evaluated.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise ValueError("the integer is too large for a double") from None
    text = value.strip() if isinstance(value, str) else ""
    if re.fullmatch(_PLAIN, text):
        return float(text)
    # A multiple of pi, such as 3*pi/4; expressions are never evaluated
    match = re.fullmatch(_WITH_PI, text)
    if match is None or (match[3] is not None and float(match[3]) == 0.0):
        comma = ": use a decimal point, not a comma" if _WITH_COMMA.fullmatch(text) else ""
        raise ValueError(
            f"{value!r} is not a number{comma}; write a decimal number, or a multiple of pi such as -pi/2 or 3*pi/4"
        )
    size = float(match[2] or 1) * math.pi / float(match[3] or 1)
    return -size if match[1] == "-" else size
