"""Tables of the keys of file formats, and JSON Schemas (draft 2020-12) made of them.

Each mapping of a format is described once, by a :class:`KeyTable`. The reader takes the keys that it accepts from the
table, :func:`json_schema` makes the schema for editors, and the tables in the manual are generated from the schema. The
value of a key is a JSON Schema in which further tables may occur.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any

from pinproof.common.yaml_file import NUMBER_PATTERN
from pinproof.units import MOST_TURN

DIALECT = "https://json-schema.org/draft/2020-12/schema"

Schema = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Definition:
    """A schema with a name, under which it is listed once in ``$defs``."""

    title: str
    value: Schema

    def schema(self) -> Schema:
        """The schema, in which further definitions may occur."""
        return {"title": self.title, **self.value}


@dataclass(frozen=True, eq=False)
class FileKey:
    """One key of a mapping in a file.

    Parameters
    ----------
    name
        The key.
    value
        The schema of its value, or a table or definition.
    text
        What the value means, as a phrase or in sentences.
    unit
        Its unit, such as ``"m"``; empty if it has none.
    default
        The value that applies if the key is omitted; None without one.
    required
        Whether the key must be stated.
    """

    name: str
    value: Any
    text: str
    unit: str = ""
    default: Any = None
    required: bool = False

    def schema(self) -> Schema:
        """The schema of the value, with its description; ``x-unit`` is the unit."""
        value = {"$ref": self.value} if isinstance(self.value, (KeyTable, Definition)) else dict(self.value)
        value["description"] = self.text
        if self.unit:
            value["x-unit"] = self.unit
        if self.default is not None:
            value["default"] = self.default
        return value


def required(name: str, value: Any, text: str, unit: str = "") -> FileKey:
    """A key that must be stated."""
    return FileKey(name, value, text, unit, required=True)


class KeyTable:
    """The keys of one kind of mapping.

    Parameters
    ----------
    title
        Its name, such as ``"obstacle"``.
    text
        What it describes.
    keys
        The keys in the order of the manual.
    rules
        Further rules of JSON Schema, such as ``oneOf``.
    more
        Whether other keys are allowed, as additions of the same version.
    """

    def __init__(self, title: str, text: str, *keys: FileKey, rules: Schema | None = None, more: bool = False) -> None:
        self.title, self.text, self.keys, self.more = title, text, keys, more
        self._rules: Schema = rules or {}

    @property
    def names(self) -> tuple[str, ...]:
        """All keys, in order."""
        return tuple(key.name for key in self.keys)

    @property
    def required(self) -> tuple[str, ...]:
        """The keys that must be stated."""
        return tuple(key.name for key in self.keys if key.required)

    def schema(self) -> Schema:
        """The schema of the mapping, in which further tables may occur."""
        stated: dict[str, Any] = {"description": self.text, "type": "object"}
        if self.required:
            stated["required"] = list(self.required)
        stated["properties"] = {key.name: key.schema() for key in self.keys}
        if not self.more:
            stated["additionalProperties"] = False
        return {**stated, **self._rules}


def report_table(title: str, text: str, *keys: FileKey, rules: Schema | None = None) -> KeyTable:
    """The keys of a mapping in a report of this program, in which a later release may add keys."""
    return KeyTable(title, text, *keys, rules=rules, more=True)


NUMBER = Definition("number", {"type": ["number", "string"], "pattern": NUMBER_PATTERN})
"""A number, or a text such as ``pi/2`` or ``-3*pi/4``."""

ANGLE = Definition("angle", {"$ref": NUMBER, "minimum": -MOST_TURN, "maximum": MOST_TURN})
"""An angle of an orientation in radians; larger numbers are in degrees."""

PLAIN_NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
BOOLEAN: Schema = {"type": "boolean"}
TEXT: Schema = {"type": "string", "minLength": 1}
ANY_TEXT: Schema = {"type": "string"}
OPTIONAL_NUMBER: Schema = {"type": ["number", "null"]}
NOT_NEGATIVE: Schema = {**PLAIN_NUMBER, "minimum": 0}
COUNT: Schema = {**INTEGER, "minimum": 0}


def numbers(count: int, number: Any = NUMBER) -> Schema:
    """A list of ``count`` numbers."""
    return list_of(number, count, count)


def list_of(item: Any, least: int = 0, most: int | None = None) -> Schema:
    """A list of at least ``least`` and at most ``most`` items."""
    listed: dict[str, Any] = {"type": "array", "items": item}
    if least:
        listed["minItems"] = least
    if most is not None:
        listed["maxItems"] = most
    return listed


def mapping_to(value: Any) -> Schema:
    """A mapping of names to values."""
    return {"type": "object", "additionalProperties": value}


def any_of(*values: Any) -> Schema:
    """One of several kinds of values."""
    return {"anyOf": list(values)}


def default_of(owner: type, name: str) -> Any:
    """The default of a field of a dataclass as a value of JSON; None if it has none."""
    found = next(each.default for each in fields(owner) if each.name == name)
    return None if found is MISSING else list(found) if isinstance(found, tuple) else found


def fault_in(schema: KeyTable | Schema, value: Any, place: str = "") -> tuple[str, str] | None:
    """Find the first difference of a value of a JSON file from its schema.

    Parameters
    ----------
    schema
        A table, or a schema of the types of JSON with ranges, items, ``const`` and ``enum``.
    value
        The value.
    place
        The position of the value in its file.

    Returns
    -------
    tuple of str, or None
        The position, such as ``points[3].positions``, and the reason; None if there is no difference.
    """
    if isinstance(schema, KeyTable):
        return _fault_in_mapping(schema, value, place)
    if "const" in schema or "enum" in schema:
        valid = [schema["const"]] if "const" in schema else schema["enum"]
        return None if value in valid else (place, f"is {_short(value)}; valid: {', '.join(map(str, valid))}")
    kinds = schema.get("type", ())
    kinds = (kinds,) if isinstance(kinds, str) else kinds
    if kinds and not any(_IS_KIND[kind](value) for kind in kinds):
        return place, f"is {_short(value)}; it must be {' or '.join(_KIND_WORDS[kind] for kind in kinds)}"
    if isinstance(value, list):
        return _fault_in_list(schema, value, place)
    if isinstance(value, dict):
        if odd := [key for key in value if not isinstance(key, str)]:  # YAML
            return place, f"{odd[0]!r} is not a name"
        items = ((f"{place}.{key}".lstrip("."), part) for key, part in value.items())
        inner = schema.get("additionalProperties", {})
        return next((fault for where, part in items if (fault := fault_in(inner, part, where))), None)
    if isinstance(value, (int, float)) and value < schema.get("minimum", -math.inf):
        return place, f"is {_short(value)}; it must be at least {schema['minimum']}"
    if isinstance(value, (int, float)) and value >= schema.get("exclusiveMaximum", math.inf):
        return place, f"is {_short(value)}; it must be below {schema['exclusiveMaximum']}"
    return None


def _fault_in_mapping(table: KeyTable, value: Any, place: str) -> tuple[str, str] | None:
    if not isinstance(value, dict):
        return place, f"is {_short(value)}, not a mapping with the keys {', '.join(table.names)}"
    if missing := [key for key in table.required if key not in value]:
        return place, f"lacks {', '.join(missing)}"
    if unknown := sorted(str(key) for key in value if key not in table.names):
        return place, f"has unknown keys {', '.join(unknown)}; valid: {', '.join(table.names)}"
    for key in table.keys:
        if key.name in value and (fault := fault_in(key.value, value[key.name], f"{place}.{key.name}".lstrip("."))):
            return fault
    return None


def _fault_in_list(schema: Schema, value: list[Any], place: str) -> tuple[str, str] | None:
    least, most = schema.get("minItems", 0), schema.get("maxItems", len(value))
    if not least <= len(value) <= most:
        return place, f"has {len(value)} items; it must have {least if len(value) < least else most}"
    items = ((f"{place}[{index}]", part) for index, part in enumerate(value))
    inner = schema.get("items", {})
    return next((fault for where, part in items if (fault := fault_in(inner, part, where))), None)


_IS_KIND: Mapping[str, Callable[[Any], bool]] = {
    "string": lambda value: isinstance(value, str),
    # an integer above the largest double is still less than infinity
    "number": lambda value: (
        isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
    ),
    "integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
    "boolean": lambda value: isinstance(value, bool),
    "array": lambda value: isinstance(value, list),
    "object": lambda value: isinstance(value, dict),
    "null": lambda value: value is None,
}
_KIND_WORDS = {
    "string": "text",
    "number": "a finite number",
    "integer": "an integer",
    "boolean": "true or false",
    "array": "a list",
    "object": "a mapping",
    "null": "null",
}


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def json_schema(table: KeyTable) -> dict[str, Any]:
    """The complete JSON Schema of the files that a table describes."""
    definitions: dict[str, Any] = {}
    root = _resolved(table.schema(), definitions)
    return {"$schema": DIALECT, "title": table.title, **root, "$defs": dict(sorted(definitions.items()))}


def _resolved(value: Any, definitions: dict[str, Any]) -> Any:
    """The value with a reference in place of each table and definition, which are added to ``definitions``."""
    if isinstance(value, (KeyTable, Definition)):
        return {"$ref": _reference(value, definitions)}
    if isinstance(value, Mapping):
        return {key: _member(key, each, definitions) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_resolved(each, definitions) for each in value]
    return value


def _member(key: str, value: Any, definitions: dict[str, Any]) -> Any:
    if key == "$ref" and isinstance(value, (KeyTable, Definition)):
        return _reference(value, definitions)
    return _resolved(value, definitions)


def _reference(value: KeyTable | Definition, definitions: dict[str, Any]) -> str:
    if value.title not in definitions:
        definitions[value.title] = {}  # a table may contain itself
        definitions[value.title] = _resolved(value.schema(), definitions)
    return f"#/$defs/{value.title}"
