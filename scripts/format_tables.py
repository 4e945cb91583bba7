"""Generate the tables of keys in docs/formats/ from the JSON Schemas of the formats.

python scripts/format_tables.py            writes the tables
python scripts/format_tables.py --check    exit code 1 if a page is not up to date
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from generated_files import main, with_tables

from pinproof.formats import FORMATS, file_schema
from pinproof.picks.input.sources import COLUMNS

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "formats"
NUMBERS = "index.md#numbers"
ROOT = "File"
SAME_AS = {"defaults": "pick", "object": "obstacle"}
"""Mappings that are described by their differences from another one."""


def keys_text(name: str) -> str:
    """The tables of a format: that of the file, then those of the mappings that occur in it."""
    schema, own = file_schema(name), owned()[name]
    sections = [(ROOT, schema), *((title, schema["$defs"][title]) for title in in_order(schema) if title in own)]
    return "\n\n".join(section(name, title, table) for title, table in sections)


def columns_text() -> str:
    """The columns of a table of picks."""
    rows = [f"| {', '.join(f'`{name}`' for name in names)} | `{key}` |" for key, names in COLUMNS.items()]
    return "\n".join(["| columns | key |", "|---|---|", *rows])


def owned() -> dict[str, set[str]]:
    """For each format the mappings that its page describes: those that no page before it describes."""
    seen: dict[str, Any] = {}
    found: dict[str, set[str]] = {}
    for name in FORMATS:
        tables = {title: table for title, table in file_schema(name)["$defs"].items() if "properties" in table}
        found[name] = {title for title, table in tables.items() if seen.get(title) != table}
        seen = {**tables, **seen}
    return found


def in_order(schema: dict[str, Any]) -> list[str]:
    """The mappings of a schema in the order in which they are first referred to."""
    found: dict[str, None] = {}

    def visit(value: Any) -> None:
        if isinstance(value, dict):
            title = value.get("$ref", "").removeprefix("#/$defs/") if isinstance(value.get("$ref"), str) else ""
            if title and title not in found:
                table = schema["$defs"][title]
                if "properties" in table:
                    found[title] = None
                visit(table.get("properties", {}))
            for key, part in value.items():
                if key != "$defs":
                    visit(part)
        elif isinstance(value, list):
            for part in value:
                visit(part)

    visit(schema["properties"])
    return list(found)


def section(name: str, title: str, table: dict[str, Any]) -> str:
    """One mapping: its description and its keys."""
    schema = file_schema(name)
    lines, keys = [f"### {title}", "", table["description"]], table["properties"]
    if title in SAME_AS:
        other = schema["$defs"][SAME_AS[title]]["properties"]
        keys = {key: value for key, value in keys.items() if other.get(key) != value}
        left_out = ", ".join(f"`{key}`" for key in other if key not in table["properties"])
        lines[-1] += f" It has the keys of {link(name, SAME_AS[title])}" + (f" except {left_out}." if left_out else ".")
    if keys:
        lines += ["", "| key | value | unit | default | meaning |", "|---|---|---|---|---|"]
    for key, value in keys.items():
        default = "required" if key in table.get("required", ()) else ""
        if "default" in value:
            default = f"`{json.dumps(value['default'])}`"
        cells = (f"`{key}`", words(name, schema, value), value.get("x-unit", ""), default, value["description"])
        lines.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return "\n".join(lines)


def words(name: str, schema: dict[str, Any], value: Any, many: bool = False) -> str:
    """The kind of a value in words."""
    s = "s" if many else ""
    if "$ref" in value:
        title = value["$ref"].removeprefix("#/$defs/")
        return link(name, title) if "properties" in schema["$defs"][title] else f"[number{s}]({NUMBERS})"
    if "title" in value:
        return str(value["title"])
    if "anyOf" in value:
        return " or ".join(dict.fromkeys(words(name, schema, each, many) for each in value["anyOf"]))
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value and not all(isinstance(each, str) for each in value["enum"]):
        return "mapping of names to texts"
    if "enum" in value:
        return " or ".join(f"`{each}`" for each in value["enum"])
    kinds = value.get("type", "any")
    kinds = [kinds] if isinstance(kinds, str) else kinds
    return " or ".join(kind_words(kind, name, schema, value, s) for kind in kinds)


def kind_words(kind: str, name: str, schema: dict[str, Any], value: dict[str, Any], s: str) -> str:
    """One of the types of JSON in words."""
    if kind == "array":
        if value.get("maxItems") == 0:
            return "empty list"
        count = value.get("maxItems") if value.get("maxItems") == value.get("minItems") else None
        items = words(name, schema, value["items"], many=True) if "items" in value else "values"
        if count is not None:
            return f"list{s} of {count} {items}"
        return f"list{s} of {items}"
    if kind == "object":
        return f"mapping{s} of names to {words(name, schema, value['additionalProperties'], many=True)}"
    plain = {"number": "number", "integer": "integer", "string": "text", "any": "anything", "null": "null"}
    if kind == "boolean":
        return "`true` or `false`"
    return plain[kind] + (s if kind in ("number", "integer", "string") else "")


def link(name: str, title: str) -> str:
    """A link to the table of a mapping, on this page or another."""
    found = owned()
    page = next(each for each in (name, *FORMATS) if title in found[each])
    return f"[{title}]({'' if page == name else f'{page}.md'}#{title})"


def page(name: str) -> str:
    """The text of a page with new tables."""
    tables = {"keys": keys_text(name), **({"columns": columns_text()} if name == "picks" else {})}
    return with_tables((FOLDER / f"{name}.md").read_text(encoding="utf-8"), "format_tables.py", tables)


if __name__ == "__main__":
    main(__doc__, lambda: {FOLDER / f"{name}.md": page(name) for name in FORMATS})
