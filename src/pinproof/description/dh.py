"""Denavit-Hartenberg tables: rows, forward kinematics as a plain matrix product, and YAML and CSV files.

The joint variable q is added to ``theta`` (revolute, continuous) or to ``d`` (prismatic). Row i transforms frame
dh_(i-1) to frame dh_i:

- ``standard`` (Denavit and Hartenberg 1955; Spong, Hutchinson and Vidyasagar, "Robot Modeling and Control", eq. 3.10)::

      A = Rz(theta) Tz(d) Tx(a) Rx(alpha)

- ``modified`` (Craig, "Introduction to Robotics", eq. 3.6), where row i holds a_(i-1) and alpha_(i-1)::

      A = Rx(alpha) Tx(a) Rz(theta) Tz(d)

The keys of YAML files and the columns of CSV files are in :mod:`pinproof.description.dh_keys`, and docs/formats/dh.md
describes them with examples. A number may be written as ``[-][k*]pi[/m]``, because a rounded 1.5708 is not pi/2.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import yaml

from pinproof.common.display import html_block, html_table, outline
from pinproof.common.files import csv_text, read_text, unknown_suffix, write_text_whole
from pinproof.common.validation import require_type
from pinproof.common.yaml_file import LinedMapping, parse_number, read_yaml, refuse_unknown
from pinproof.description.dh_keys import CONVENTIONS, DEFAULT_EFFORT, JOINT_TYPES, LARGEST, ROW, TABLE, TRANSFORM
from pinproof.errors import DhTableError, InputError, UnknownNameError
from pinproof.spatial import Array, finite, matrix, pose, rigid
from pinproof.units import refuse_degree_limit, refuse_degrees, refuse_millimetres

DEFAULT_REVOLUTE_LIMIT = math.pi
"""Rad. Default limits of a revolute row are -pi and pi: one full rotation."""
DEFAULT_REVOLUTE_VELOCITY = math.pi
"""Rad/s. Default velocity limit of a revolute or continuous row, a common value for small arms."""
DEFAULT_PRISMATIC_VELOCITY = 1.0
"""M/s. Default velocity limit of a prismatic row, a common value for linear axes."""


@dataclass(frozen=True)
class DhRow:
    """One row of a DH table: one joint and the link it moves.

    Parameters
    ----------
    name
        Name of the joint.
    theta, d, a, alpha
        Angles in radians, lengths in metres. ``theta`` of a revolute or continuous row and ``d`` of a prismatic row are
        offsets that are added to the joint variable q.
    joint_type
        ``"revolute"``, ``"prismatic"`` or ``"continuous"`` (revolute without limits).
    lower, upper
        Limits of q in radians or metres. The default is [-pi, pi] for revolute rows and [-inf, inf] for continuous
        rows; prismatic rows must state both.
    velocity
        Velocity limit in rad/s or m/s; by default pi rad/s and 1 m/s.
    effort
        Largest torque or force in N m or N; by default 100. No result depends on it.

    Raises
    ------
    InputError
        If a value is invalid; the message states the row and the column.
    """

    name: str
    theta: float
    d: float
    a: float
    alpha: float
    joint_type: str = "revolute"
    # None means "not stated" and is replaced by the default in __post_init__.
    lower: float = cast(float, None)
    upper: float = cast(float, None)
    velocity: float = cast(float, None)
    effort: float = cast(float, None)

    def __post_init__(self) -> None:
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        problem = row_problem(values)
        if problem is not None:
            column, reason = problem
            raise InputError(f"DH row {self.name!r}, {column}: {reason}")
        for column, value in {**_defaults(self.joint_type), **_stated(values)}.items():
            object.__setattr__(self, column, value)

    @property
    def is_prismatic(self) -> bool:
        """Whether q is a displacement along z."""
        return self.joint_type == "prismatic"


def row_problem(values: dict[str, Any]) -> tuple[str, str] | None:
    """Return the column and the reason of the first invalid field of a row, or None if all are valid.

    ``values`` contains every field of :class:`DhRow`, with None for a limit or a velocity that is not stated.
    """
    name = values["name"]
    if not isinstance(name, str) or not name or name != name.strip() or not name.isprintable():
        return "name", f"{name!r} is not a valid name; use printable text without leading or trailing spaces"
    joint_type = values["joint_type"]
    if joint_type not in JOINT_TYPES:
        return "joint_type", f"unknown joint type {joint_type!r}; valid: {', '.join(JOINT_TYPES)}"
    for column in ("theta", "d", "a", "alpha", "lower", "upper", "velocity", "effort"):
        value = values[column]
        optional = column in ("lower", "upper", "velocity", "effort")
        if value is None and optional:
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            return column, f"{value!r} is not a number"
        # A continuous row reads back its own missing limits as infinities (dataclasses.replace).
        unlimited = joint_type == "continuous" and value == {"lower": -math.inf, "upper": math.inf}.get(column)
        if not math.isfinite(value) and not unlimited:
            return column, f"{value} is not a finite number"
        if abs(float(value)) > LARGEST and not unlimited:
            return column, f"{value} is larger than {LARGEST:g} m, rad, m/s or rad/s"
    if values["effort"] is not None and values["effort"] <= 0:
        return "effort", f"must be greater than 0, not {values['effort']:.17g}"
    return _limit_problem(joint_type, values["lower"], values["upper"], values["velocity"])


def _limit_problem(
    joint_type: str, lower: float | None, upper: float | None, velocity: float | None
) -> tuple[str, str] | None:
    for column, value in (("lower", lower), ("upper", upper)):
        if joint_type == "prismatic" and value is None:
            return column, "a prismatic row must state its lower and upper limit in metres"
        if joint_type == "continuous" and value is not None and math.isfinite(value):
            return column, f"a continuous row has no limits; omit {value}, or change the type to revolute"
    if joint_type != "continuous":
        low = -DEFAULT_REVOLUTE_LIMIT if lower is None else lower
        high = DEFAULT_REVOLUTE_LIMIT if upper is None else upper
        if low > high:
            return "lower", f"the lower limit {low:.17g} is above the upper limit {high:.17g}"
    if velocity is not None and velocity <= 0:
        return "velocity", f"must be greater than 0, not {velocity:.17g}"
    return None


def _defaults(joint_type: str) -> dict[str, float]:
    if joint_type == "prismatic":
        return {"velocity": DEFAULT_PRISMATIC_VELOCITY, "effort": DEFAULT_EFFORT}
    limit = math.inf if joint_type == "continuous" else DEFAULT_REVOLUTE_LIMIT
    return {"lower": -limit, "upper": limit, "velocity": DEFAULT_REVOLUTE_VELOCITY, "effort": DEFAULT_EFFORT}


def _stated(values: dict[str, Any]) -> dict[str, float]:
    """Return the stated numbers as floats (they may be integers or NumPy scalars)."""
    return {k: float(v) for k, v in values.items() if v is not None and k not in ("name", "joint_type")}


def row_transform(row: DhRow, convention: str, q: float) -> Array:
    """Return the (4, 4) matrix A of one row at the joint variable q; see the formulas in the module docstring."""
    theta, d = (row.theta, row.d + q) if row.is_prismatic else (row.theta + q, row.d)
    ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(row.alpha), math.sin(row.alpha)
    if convention == "standard":
        return np.array(
            [
                [ct, -st * ca, st * sa, row.a * ct],
                [st, ct * ca, -ct * sa, row.a * st],
                [0.0, sa, ca, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
    return np.array(
        [
            [ct, -st, 0.0, row.a],
            [st * ca, ct * ca, -sa, -d * sa],
            [st * sa, ct * sa, ca, d * ca],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


SUFFIXES = (".yaml", ".yml", ".csv")


def _table_file(path: str | Path) -> Path:
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise DhTableError(path, unknown_suffix(path, SUFFIXES))
    return path


def _table_from_yaml(path: Path) -> DhTable:
    content = read_yaml(path, TABLE.names, DhTableError)
    refuse_unknown(DhTableError, path, "key", content, TABLE.names, "")
    rows = content.get("rows")
    if not isinstance(rows, list) or not rows:
        raise DhTableError(path, "must be a list with at least one row", "key rows")
    places = []
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, LinedMapping):
            reason = f"{row!r} is not a mapping; valid keys: {', '.join(ROW.names)}"
            raise DhTableError(path, reason, f"row {number}")
        places.append(f"line {row.line}, row {number}")
    return _table(
        path,
        [_row(path, place, row) for place, row in zip(places, rows, strict=True)],
        places,
        convention=content.get("convention"),
        name=content.get("name", path.stem),
        base=_transform(path, "base", content.get("base")),
        tool=_transform(path, "tool", content.get("tool")),
    )


def _table_from_csv(path: Path) -> DhTable:
    lines = read_text(path, DhTableError).splitlines()
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), len(lines))
    # Spreadsheets append commas to every line, this one included.
    conventions = re.findall(r"^\s*#\s*convention\s*:\s*([^\s,]+)[\s,]*$", "\n".join(lines[:first]), re.MULTILINE)
    if len(set(conventions)) > 1:
        raise DhTableError(path, f"states more than one convention: {', '.join(conventions)}")
    convention = conventions[0] if conventions else None
    try:
        reader = csv.reader(lines[first:])
        content = [(first + reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise DhTableError(path, f"is not valid CSV: {error}") from error
    if not content:
        raise DhTableError(path, f"has no header; valid columns: {', '.join(ROW.names)}")
    header = [cell.strip() for cell in content[0][1]]
    if other := other_separator(header):
        raise DhTableError(path, other, "header")
    refuse_unknown(DhTableError, path, "column", header, ROW.names, "header")
    twice = sorted({column for column in header if header.count(column) > 1})
    if twice:
        raise DhTableError(path, f"duplicate column {twice[0]}", "header")
    rows, places = [], []
    for number, (line, cells) in enumerate(content[1:], start=1):
        places.append(f"line {line}, row {number}")
        if len(cells) != len(header):
            more = "; use decimal points, not commas" if len(cells) > len(header) else ""
            raise DhTableError(path, f"has {len(cells)} cells; the header has {len(header)}{more}", places[-1])
        stated = {column: cell.strip() for column, cell in zip(header, cells, strict=True) if cell.strip()}
        rows.append(_row(path, places[-1], stated))
    return _table(path, rows, places, convention=convention, name=path.stem)


def other_separator(header: Sequence[str]) -> str:
    """Return an error text if the header is separated by semicolons or tabs, as some spreadsheets do, else ''."""
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and separator in header[0]:
            return f"columns are separated by {name}; save the file with commas between columns and decimal points"
    return ""


def _row(path: Path, place: str, stated: Mapping[Any, Any]) -> DhRow:
    """Parse one row column by column, so that errors state the column."""
    refuse_unknown(DhTableError, path, "column", stated, ROW.names, place)
    values: dict[str, Any] = {"name": stated.get("name"), "joint_type": stated.get("type", "revolute")}
    for column in ROW.names:
        if stated.get(column) is None and column in ROW.required:
            raise DhTableError(path, "is missing", f"{place}, column {column}")
        if column in ("name", "type"):
            continue
        try:
            values[column] = None if stated.get(column) is None else parse_number(stated[column])
        except ValueError as error:
            raise DhTableError(path, str(error), f"{place}, column {column}") from error
    problem = row_problem(values) or _unit_problem(values)
    if problem is not None:
        column = "type" if problem[0] == "joint_type" else problem[0]
        raise DhTableError(path, problem[1], f"{place}, column {column}")
    return DhRow(**values)


def _unit_problem(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the first column whose angle is probably in degrees, and the reason."""
    try:
        for column in ("theta", "alpha"):
            refuse_degrees(column, [values[column]])
        for column in ("lower", "upper") if values["joint_type"] == "revolute" else ():
            refuse_degree_limit(column, values[column])
    except InputError as error:
        column, _, reason = str(error).partition(": ")
        return column, reason
    return None


def _table(path: Path, rows: Sequence[DhRow], places: Sequence[str], *, convention: object, **rest: Any) -> DhTable:
    if convention is None:
        raise DhTableError(path, "states no convention; add 'convention: standard' or 'convention: modified'")
    names = [row.name for row in rows]
    for number, name in enumerate(names, start=1):
        if name in names[: number - 1]:
            reason = f"row {names.index(name) + 1} is already named {name!r}"
            raise DhTableError(path, reason, f"{places[number - 1]}, column name")
    try:
        refuse_millimetres("a and d", [length for row in rows for length in (row.a, row.d)])
        return DhTable(tuple(rows), convention=convention, **rest)  # type: ignore[arg-type]
    except InputError as error:
        raise DhTableError(path, str(error)) from error


def _transform(path: Path, key: str, stated: object) -> Any:
    """Parse the base or the tool of a table."""
    if stated is None:
        return np.eye(4)
    if not isinstance(stated, dict):
        reason = f"{stated!r} is not a transform; valid keys: {', '.join(TRANSFORM.names)}"
        raise DhTableError(path, reason, f"key {key}")
    refuse_unknown(DhTableError, path, "key", stated, TRANSFORM.names, f"key {key}")
    if "matrix" in stated and len(stated) > 1:
        raise DhTableError(path, "use either matrix, or xyz with rpy or quat_xyzw", f"key {key}")
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
    """Parse numbers in nested lists up to ``depth`` (with YAML anchors a list can contain itself)."""
    if isinstance(value, list) and depth > 0:
        return [_parsed(part, depth - 1) for part in value]
    return parse_number(value)


def _csv_text(table: DhTable) -> str:
    for which in ("base", "tool"):
        if not np.array_equal(getattr(table, which), np.eye(4)):
            raise InputError(
                f"the {which} of the table is not the identity, which a CSV cannot store; save a .yaml file"
            )
    rows = [_stated_columns(row) for row in table.rows]
    columns = [name for name in ROW.names if name != "effort" or any("effort" in row for row in rows)]
    cells = ([stated.get(column, "") for column in columns] for stated in rows)
    return csv_text(columns, cells, comment=f"# convention: {table.convention}")


def _yaml_text(table: DhTable) -> str:
    content: dict[str, Any] = {"name": table.name, "convention": table.convention}
    for which in ("base", "tool"):
        transform = getattr(table, which)
        if not np.array_equal(transform, np.eye(4)):
            content[which] = {"matrix": transform.tolist()}
    content["rows"] = [_stated_columns(row) for row in table.rows]
    return yaml.dump(content, Dumper=_FlatRows, sort_keys=False, allow_unicode=True, width=200)


def _stated_columns(row: DhRow) -> dict[str, Any]:
    """Return the columns of a row for a file, without infinite limits and without the default effort."""
    values: dict[str, Any] = {"name": row.name, "type": row.joint_type}
    values |= {column: getattr(row, column) for column in ROW.names[2:]}
    if row.effort == DEFAULT_EFFORT:
        del values["effort"]
    return {column: value for column, value in values.items() if isinstance(value, str) or math.isfinite(value)}


class _FlatRows(yaml.SafeDumper):
    """A SafeDumper that writes mappings and lists without nested ones (rows of a table or of a matrix) on one line."""

    def represent_mapping(self, tag: str, mapping: Any, flow_style: bool | None = None) -> yaml.MappingNode:  # noqa: ARG002
        return super().represent_mapping(tag, mapping, flow_style=_is_flat(mapping.values()))

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> yaml.SequenceNode:  # noqa: ARG002
        return super().represent_sequence(tag, sequence, flow_style=_is_flat(sequence))


def _is_flat(values: Iterable[object]) -> bool:
    return not any(isinstance(value, (dict, list)) for value in values)


@dataclass(frozen=True, eq=False)
class DhTable:
    """A serial arm as a Denavit-Hartenberg table.

    ``base`` is the pose of frame dh_0 in the base frame, row i transforms dh_(i-1) to dh_i, and ``tool`` is the pose of
    the tool in dh_n.

    Parameters
    ----------
    rows
        One :class:`DhRow` for each joint, base first, with distinct names.
    convention
        ``"standard"`` or ``"modified"``.
    name
        Name of the robot.
    base
        base_from_dh_0, a ``pin.SE3`` or a (4, 4) matrix in metres; stored as a read-only (4, 4) array.
    tool
        dh_n_from_tool, as ``base``.

    Raises
    ------
    InputError
        If there are no rows, names are not distinct, the convention is unknown
        (:class:`~pinproof.errors.UnknownNameError`), or the base or tool is not a rigid transform.
    """

    rows: tuple[DhRow, ...]
    convention: str = field(kw_only=True)
    name: str = field(default="dh_arm", kw_only=True)
    base: Array = field(default_factory=lambda: np.eye(4), kw_only=True)
    tool: Array = field(default_factory=lambda: np.eye(4), kw_only=True)

    def __post_init__(self) -> None:
        rows = _checked_rows(self.rows)
        if self.convention not in CONVENTIONS:
            raise UnknownNameError("DH convention", self.convention, CONVENTIONS)
        name: object = self.name
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            raise InputError(f"{self.name!r} is not a valid robot name; use printable text")
        object.__setattr__(self, "rows", rows)
        for which in ("base", "tool"):
            transform = matrix(rigid(which, getattr(self, which)))
            transform.setflags(write=False)
            object.__setattr__(self, which, transform)

    def __reduce__(self) -> tuple[Any, ...]:
        # The constructor makes the arrays read-only again; pickle does not preserve this flag.
        settings = {"convention": self.convention, "name": self.name, "base": self.base, "tool": self.tool}
        return partial(DhTable, **settings), (self.rows,)  # type: ignore[arg-type]  # the values have several types

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        rows = (
            f"{row.name}: {row.joint_type}, theta {row.theta:.6g}, d {row.d:.6g}, a {row.a:.6g}, alpha {row.alpha:.6g}"
            for row in self.rows
        )
        return outline(f"DhTable({self.name!r}, {self.convention}, {len(self)} rows)", rows, total=len(self))

    def _repr_html_(self) -> str:
        names = ("name", "joint_type", "theta", "d", "a", "alpha", "lower", "upper", "velocity")
        rows = ([getattr(row, name) for name in names] for row in self.rows)
        title = f"{self.name}: DH table, {self.convention} convention (m, rad)"
        return html_block(title, html_table([name.replace("_", " ") for name in names], rows, total=len(self)))

    @classmethod
    def load(cls, path: str | Path) -> DhTable:
        """Read a table from a ``.yaml``, ``.yml`` or ``.csv`` file; see :mod:`pinproof.description.dh`.

        Raises
        ------
        DhTableError
            If the file is invalid; the message states the file and, where possible, the row and column.
        """
        path = _table_file(path)
        return _table_from_csv(path) if path.suffix.lower() == ".csv" else _table_from_yaml(path)

    def save(self, path: str | Path) -> None:
        """Write the table atomically to a ``.yaml``, ``.yml`` or ``.csv`` file, without rounding.

        Raises
        ------
        InputError
            If the table has a base or a tool, which a ``.csv`` file cannot store.
        FileError
            If the file cannot be written (:class:`~pinproof.errors.DhTableError` for an unknown suffix).
        """
        path = _table_file(path)
        write_text_whole(path, _csv_text(self) if path.suffix.lower() == ".csv" else _yaml_text(self))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, base first."""
        return tuple(row.name for row in self.rows)

    @property
    def lower(self) -> Array:
        """(n,) lower limits of q, rad or m; -inf for continuous rows."""
        return np.array([row.lower for row in self.rows])

    @property
    def upper(self) -> Array:
        """(n,) upper limits of q, rad or m; inf for continuous rows."""
        return np.array([row.upper for row in self.rows])

    @property
    def velocity(self) -> Array:
        """(n,) velocity limits, rad/s or m/s."""
        return np.array([row.velocity for row in self.rows])

    @property
    def effort(self) -> Array:
        """(n,) effort limits, N m or N."""
        return np.array([row.effort for row in self.rows])

    def frames(self, q: npt.ArrayLike) -> Array:
        """Compute the poses of the frames dh_0 ... dh_n.

        Parameters
        ----------
        q
            (n,) joint variables, rad or m; limits are not checked.

        Returns
        -------
        (n + 1, 4, 4)
            base_from_dh_i. The first is ``base``; the tool is not included.

        Raises
        ------
        InputError
            If q has the wrong length or is not finite.
        """
        variables = finite("q", q, (len(self.rows),))
        frames = [self.base]
        for row, value in zip(self.rows, variables, strict=True):
            frames.append(frames[-1] @ row_transform(row, self.convention, float(value)))
        return np.array(frames)

    def forward_kinematics(self, q: npt.ArrayLike) -> Array:
        """Compute base_from_tool (4, 4) at the joint variables q (n,) as the product base A_1 ... A_n tool.

        Conversions of the table are compared with this product.

        Raises
        ------
        InputError
            If q has the wrong length or is not finite.
        """
        return np.array(self.frames(q)[-1] @ self.tool)

    def is_close(self, other: DhTable, *, tolerance: float = 0.0) -> bool:
        """Whether both tables have the same names and types and equal numbers up to ``tolerance`` (SI units, rad)."""

        def names(table: DhTable) -> object:
            return table.name, table.convention, [(row.name, row.joint_type) for row in table.rows]

        def numbers(table: DhTable) -> Array:
            columns = [(r.theta, r.d, r.a, r.alpha, r.lower, r.upper, r.velocity, r.effort) for r in table.rows]
            return np.concatenate([np.ravel(columns), table.base.ravel(), table.tool.ravel()])

        same = names(self) == names(other)
        return same and np.allclose(numbers(self), numbers(other), rtol=0.0, atol=tolerance)


def _checked_rows(rows: Iterable[DhRow]) -> tuple[DhRow, ...]:
    require_type("rows", rows, Iterable)
    rows = tuple(rows)
    if not rows:
        raise InputError("a DH table needs at least one row")
    seen: dict[str, int] = {}
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, DhRow):
            raise InputError(f"row {number} of a DH table must be a DhRow, not {type(row).__name__}")
        if row.name in seen:
            raise InputError(f"rows {seen[row.name]} and {number} of the DH table are both named {row.name!r}")
        seen[row.name] = number
    return rows
