"""DH tables as files: YAML, which holds everything, and CSV, which holds the rows.

YAML::

    name: generic_6dof            # optional, else the file's name
    convention: standard          # or modified; without it the file is refused
    base: {xyz: [0, 0, 0], rpy: [0, 0, 0]}        # optional; also quat_xyzw, or matrix: four rows of four
    tool: {xyz: [0, 0, 0.1]}                      # likewise
    rows:
      - {name: joint_1, type: revolute, theta: 0, d: 0.33, a: 0, alpha: pi/2, lower: -pi, upper: pi, velocity: 3}

CSV::

    # convention: standard
    name,type,theta,d,a,alpha,lower,upper,velocity
    joint_1,revolute,0,0.33,0,pi/2,-pi,pi,3

Lengths are metres, angles radians. A number may be written as ``[-][k*]pi[/m]``, for a rounded 1.5708 bends an arm. The
columns ``type``, ``lower``, ``upper`` and ``velocity`` may be left out or empty where :class:`DhRow` has a default.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pinproof.description.dh_row import DhRow, row_problem
from pinproof.description.dh_table import DhTable
from pinproof.description.input_file import read_text
from pinproof.description.lined_yaml import read_yaml, refuse_unknown
from pinproof.description.units import refuse_degree_limit, refuse_degrees, refuse_millimetres
from pinproof.description.whole_file import write_text_whole
from pinproof.errors import DhTableError, InputError
from pinproof.spatial import finite, pose

__all__ = ["load_table", "other_separator", "parse_number", "save_table"]

SUFFIXES = (".yaml", ".yml", ".csv")
TABLE_KEYS = ("name", "convention", "base", "tool", "rows")
COLUMNS = ("name", "type", "theta", "d", "a", "alpha", "lower", "upper", "velocity")
MUST_STATE = ("name", "theta", "d", "a", "alpha")
POSE_KEYS = ("xyz", "rpy", "quat_xyzw", "matrix")

_DECIMAL = r"(?:\d+(?:\.\d*)?|\.\d+)"
_PLAIN = re.compile(rf"[+-]?{_DECIMAL}(?:[eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?\d+,\d+")
_WITH_PI = re.compile(rf"(?P<sign>[+-]?)(?:(?P<times>{_DECIMAL})\s*\*\s*)?pi(?:\s*/\s*(?P<over>{_DECIMAL}))?")


def load_table(path: str | Path) -> DhTable:
    """Read a table; the way in is :meth:`DhTable.load`."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise DhTableError(path, f"unknown kind of file {path.suffix!r}; valid: {', '.join(SUFFIXES)}")
    return _table_from_csv(path) if path.suffix.lower() == ".csv" else _table_from_yaml(path)


def save_table(table: DhTable, path: str | Path) -> None:
    """Write a table; the way in is :meth:`DhTable.save`."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise DhTableError(path, f"unknown kind of file {path.suffix!r}; valid: {', '.join(SUFFIXES)}")
    write_text_whole(path, _csv_text(table) if path.suffix.lower() == ".csv" else _yaml_text(table))


def parse_number(value: object) -> float:
    """A number as a file states it: a number, or text such as ``0.33``, ``1e-3``, ``-pi/2`` or ``3*pi/4``.

    Raises
    ------
    ValueError
        If it is anything else; nothing is ever evaluated.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise ValueError("an integer here is larger than any double") from None
    text = value.strip() if isinstance(value, str) else ""
    if _PLAIN.fullmatch(text):
        return float(text)
    match = _WITH_PI.fullmatch(text)
    if match is None or (match["over"] is not None and float(match["over"]) == 0.0):
        comma = ": decimals have a point, not a comma" if _WITH_COMMA.fullmatch(text) else ""
        raise ValueError(f"{value!r} is not a number{comma}; wanted is a decimal or [-][k*]pi[/m]")
    size = float(match["times"] or 1) * math.pi / float(match["over"] or 1)
    return -size if match["sign"] == "-" else size


def _table_from_yaml(path: Path) -> DhTable:
    content = read_yaml(path, TABLE_KEYS, DhTableError)
    refuse_unknown(DhTableError, path, "key", content, TABLE_KEYS, "")
    rows = content.get("rows")
    if not isinstance(rows, list) or not rows:
        raise DhTableError(path, "holds no rows; wanted is a list under the key rows", "key rows")
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, dict):
            raise DhTableError(path, f"{row!r} is no row; wanted are the keys {', '.join(COLUMNS)}", f"row {number}")
    return _table(
        path,
        [_row(path, number, row) for number, row in enumerate(rows, start=1)],
        convention=content.get("convention"),
        name=content.get("name", path.stem),
        base=_transform(path, "base", content.get("base")),
        tool=_transform(path, "tool", content.get("tool")),
    )


def _table_from_csv(path: Path) -> DhTable:
    lines = read_text(path, DhTableError).splitlines()
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), len(lines))
    # Spreadsheets pad every line with commas, this one too.
    conventions = re.findall(r"^\s*#\s*convention\s*:\s*([^\s,]+)[\s,]*$", "\n".join(lines[:first]), re.MULTILINE)
    if len(set(conventions)) > 1:
        raise DhTableError(path, f"states more than one convention: {', '.join(conventions)}")
    convention = conventions[0] if conventions else None
    try:
        content = [row for row in csv.reader(lines[first:]) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise DhTableError(path, f"is no valid CSV: {error}") from error
    if not content:
        raise DhTableError(path, f"holds no header; wanted are the columns {', '.join(COLUMNS)}")
    header = [cell.strip() for cell in content[0]]
    if other := other_separator(header):
        raise DhTableError(path, other, "header")
    refuse_unknown(DhTableError, path, "column", header, COLUMNS, "header")
    twice = sorted({column for column in header if header.count(column) > 1})
    if twice:
        raise DhTableError(path, f"the column {twice[0]} stands there more than once", "header")
    rows = []
    for number, cells in enumerate(content[1:], start=1):
        if len(cells) != len(header):
            more = "; decimals have a point, not a comma" if len(cells) > len(header) else ""
            raise DhTableError(path, f"has {len(cells)} cells; the header has {len(header)}{more}", f"row {number}")
        stated = {column: cell.strip() for column, cell in zip(header, cells, strict=True) if cell.strip()}
        rows.append(_row(path, number, stated))
    return _table(path, rows, convention=convention, name=path.stem)


def other_separator(header: Sequence[str]) -> str:
    """What is wrong with a header that is not parted by commas, as spreadsheets of many countries write it; else ''."""
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and separator in header[0]:
            return f"columns are parted by {name}; save it with commas between columns, and points in decimals"
    return ""


def _row(path: Path, number: int, stated: Mapping[Any, Any]) -> DhRow:
    """One row from what the file states of it, column by column so that the culprit can be named."""
    refuse_unknown(DhTableError, path, "column", stated, COLUMNS, f"row {number}")
    values: dict[str, Any] = {"name": stated.get("name"), "joint_type": stated.get("type", "revolute")}
    for column in COLUMNS:
        if stated.get(column) is None and column in MUST_STATE:
            raise DhTableError(path, "is missing", f"row {number}, column {column}")
        if column in ("name", "type"):
            continue
        try:
            values[column] = None if stated.get(column) is None else parse_number(stated[column])
        except ValueError as error:
            raise DhTableError(path, str(error), f"row {number}, column {column}") from error
    problem = row_problem(values) or _unit_problem(values)
    if problem is not None:
        column = "type" if problem[0] == "joint_type" else problem[0]
        raise DhTableError(path, problem[1], f"row {number}, column {column}")
    return DhRow(**values)


def _unit_problem(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """The first column of a sound row whose angle can only be meant in degrees, and the reason."""
    turns = [column for column in ("lower", "upper") if values["joint_type"] == "revolute"]
    for column, refuse in (
        ("theta", _refuse_degrees),
        ("alpha", _refuse_degrees),
        *((c, refuse_degree_limit) for c in turns),
    ):
        try:
            refuse(column, values[column])
        except InputError as error:
            return column, str(error).removeprefix(f"{column}: ")
    return None


def _refuse_degrees(column: str, angle: float) -> None:
    refuse_degrees(column, [angle])


def _table(path: Path, rows: Sequence[DhRow], *, convention: object, **rest: Any) -> DhTable:
    if convention is None:
        raise DhTableError(path, "states no convention; add 'convention: standard' or 'convention: modified'")
    names = [row.name for row in rows]
    for number, name in enumerate(names, start=1):
        if name in names[: number - 1]:
            reason = f"row {names.index(name) + 1} is already named {name!r}"
            raise DhTableError(path, reason, f"row {number}, column name")
    try:
        refuse_millimetres("a and d", [length for row in rows for length in (row.a, row.d)])
        return DhTable(tuple(rows), convention=convention, **rest)  # type: ignore[arg-type]
    except InputError as error:
        raise DhTableError(path, str(error)) from error


def _transform(path: Path, key: str, stated: object) -> Any:
    """A base or tool as the file states it, as something :class:`DhTable` takes."""
    if stated is None:
        return np.eye(4)
    if not isinstance(stated, dict):
        raise DhTableError(path, f"{stated!r} is no transform; valid keys: {', '.join(POSE_KEYS)}", f"key {key}")
    refuse_unknown(DhTableError, path, "key", stated, POSE_KEYS, f"key {key}")
    if "matrix" in stated and len(stated) > 1:
        raise DhTableError(path, "give matrix alone, or xyz with rpy or quat_xyzw", f"key {key}")
    numbers: dict[str, Any] = {}
    for part, value in stated.items():
        try:
            parsed = _parsed(value)
            numbers[part] = finite(part, parsed, (4, 4) if part == "matrix" else (4,) if part == "quat_xyzw" else (3,))
        except ValueError as error:  # an InputError is one
            raise DhTableError(path, str(error), f"key {key}.{part}") from error
    if "matrix" in numbers:
        return numbers["matrix"]
    try:
        refuse_degrees("rpy", numbers.get("rpy", ()))
        return pose(**numbers)
    except InputError as error:
        raise DhTableError(path, str(error), f"key {key}") from error


def _parsed(value: object, depth: int = 2) -> Any:
    """Numbers in lists up to ``depth`` deep (YAML anchors can make a list hold itself)."""
    if isinstance(value, list) and depth > 0:
        return [_parsed(part, depth - 1) for part in value]
    return parse_number(value)


def _csv_text(table: DhTable) -> str:
    for which in ("base", "tool"):
        if not np.array_equal(getattr(table, which), np.eye(4)):
            raise InputError(f"a DH CSV has no place for the table's {which}, which is not the identity; save a .yaml")
    out = io.StringIO()
    out.write(f"# convention: {table.convention}\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in table.rows:
        stated = _stated(row)
        writer.writerow([stated.get(column, "") for column in COLUMNS])
    return out.getvalue()


def _yaml_text(table: DhTable) -> str:
    content: dict[str, Any] = {"name": table.name, "convention": table.convention}
    for which in ("base", "tool"):
        transform = getattr(table, which)
        if not np.array_equal(transform, np.eye(4)):
            content[which] = {"matrix": transform.tolist()}
    content["rows"] = [_stated(row) for row in table.rows]
    return yaml.dump(content, Dumper=_FlatRows, sort_keys=False, allow_unicode=True, width=200)


def _stated(row: DhRow) -> dict[str, Any]:
    """A row as a file states it; the limits that a continuous row does not have are left out."""
    values: dict[str, Any] = {"name": row.name, "type": row.joint_type}
    values |= {column: getattr(row, column) for column in COLUMNS[2:]}
    return {column: value for column, value in values.items() if isinstance(value, str) or math.isfinite(value)}


class _FlatRows(yaml.SafeDumper):
    """A SafeDumper that writes what holds only words and numbers (a row of the table or of a matrix) on one line."""

    def represent_mapping(self, tag: str, mapping: Any, flow_style: bool | None = None) -> yaml.MappingNode:  # noqa: ARG002
        return super().represent_mapping(tag, mapping, flow_style=_is_flat(mapping.values()))

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> yaml.SequenceNode:  # noqa: ARG002
        return super().represent_sequence(tag, sequence, flow_style=_is_flat(sequence))


def _is_flat(values: Iterable[object]) -> bool:
    return not any(isinstance(value, (dict, list)) for value in values)
