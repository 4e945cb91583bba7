"""Schemas of values, and a check of JSON files by the tables of their keys."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from typing import Any

from pinproof.common.structs import _NUMBER as NUMBER
from pinproof.common.structs import ANGLE, Definition, Schema, json_schema, required
from pinproof.common.structs import Key as FileKey
from pinproof.common.structs import Table as KeyTable

__all__ = ["ANGLE", "NUMBER", "Definition", "FileKey", "KeyTable", "Schema", "json_schema", "required"]


def report_table(title: str, text: str, *keys: FileKey, rules: Schema | None = None) -> KeyTable:
    """The keys of a mapping in a report of this program, in which a later release may add keys."""
    return KeyTable(title, text, *keys, rules=rules, more=True)


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
        if key.name in value and (fault := fault_in(key.kind, value[key.name], f"{place}.{key.name}".lstrip("."))):
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
