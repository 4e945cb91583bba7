"""One row of a Denavit-Hartenberg table: one joint, and the matrix that it stands for.

With q the joint's own variable, which is added to ``theta`` (revolute, continuous) or to ``d``
(prismatic), row i moves frame dh_(i-1) to frame dh_i:

- ``standard`` (Denavit and Hartenberg 1955; Spong, Hutchinson and Vidyasagar, "Robot Modeling and Control", eq. 3.10)::

      A = Rz(theta) Tz(d) Tx(a) Rx(alpha)

- ``modified`` (Craig, "Introduction to Robotics", eq. 3.6), where row i holds a_(i-1) and alpha_(i-1)::

      A = Rx(alpha) Tx(a) Rz(theta) Tz(d)

DH tables as files: YAML, which holds everything, and CSV, which holds the rows.

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

Denavit-Hartenberg tables: a serial arm on paper, and the plain matrix product that says where it stands.

The matrix of one row, in both conventions, stands in :mod:`pinproof.description.dh`.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import yaml

from pinproof.common.files import read_text, write_text_whole
from pinproof.common.yaml_file import read_yaml, refuse_degree_limit, refuse_degrees, refuse_millimetres, refuse_unknown
from pinproof.errors import DhTableError, InputError, UnknownNameError
from pinproof.spatial import finite, matrix, pose, rigid

__all__ = [
    "CONVENTIONS",
    "DEFAULT_PRISMATIC_VELOCITY",
    "DEFAULT_REVOLUTE_LIMIT",
    "DEFAULT_REVOLUTE_VELOCITY",
    "JOINT_TYPES",
    "DhRow",
    "DhTable",
    "load_table",
    "other_separator",
    "parse_number",
    "row_problem",
    "row_transform",
    "save_table",
]

Array = npt.NDArray[np.float64]

CONVENTIONS = ("standard", "modified")
JOINT_TYPES = ("revolute", "prismatic", "continuous")

DEFAULT_REVOLUTE_LIMIT = math.pi
"""A revolute row that states no limit turns by this much (rad) to either side: one whole turn."""
DEFAULT_REVOLUTE_VELOCITY = math.pi
"""Speed (rad/s) of a revolute or continuous row that states none: half a turn a second, common for small arms."""
DEFAULT_PRISMATIC_VELOCITY = 1.0
"""Speed (m/s) of a prismatic row that states none: common for linear axes."""
LARGEST = 1e6
"""Metres, radians, m/s, rad/s: beyond it sines lose their digits and products overflow; it is a slip of the pen."""


@dataclass(frozen=True)
class DhRow:
    """One row of a DH table: one joint and the link it moves.

    Parameters
    ----------
    name
        Name of the joint.
    theta, d, a, alpha
        Angles in radians, lengths in metres. ``theta`` of a revolute or continuous row and ``d`` of a prismatic row are
        offsets: the joint's q is added to them.
    joint_type
        ``"revolute"``, ``"prismatic"`` or ``"continuous"`` (revolute without end stops).
    lower, upper
        Limits of q in radians or metres. Revolute rows without them get [-pi, pi]; continuous rows have none
        ([-inf, inf]); prismatic rows must state both, for no stroke is plausible for every arm.
    velocity
        Largest joint speed in rad/s or m/s; pi rad/s and 1 m/s if not stated.

    Raises
    ------
    InputError
        Naming the row and the column that makes no sense.
    """

    name: str
    theta: float
    d: float
    a: float
    alpha: float
    joint_type: str = "revolute"
    # None stands for "not stated" and is replaced before anyone can read it, so readers see floats.
    lower: float = cast(float, None)
    upper: float = cast(float, None)
    velocity: float = cast(float, None)

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
        """Whether q is a length along z and not an angle about it."""
        return self.joint_type == "prismatic"


def row_problem(values: dict[str, Any]) -> tuple[str, str] | None:
    """The first thing wrong with the fields of a row: the column and the reason, or None if the row is sound.

    ``values`` holds every field of :class:`DhRow`, with None for a limit or a velocity that is not stated.
    """
    name = values["name"]
    if not isinstance(name, str) or not name or name != name.strip() or not name.isprintable():
        return "name", f"{name!r} is no name; wanted is printable text without spaces at its ends"
    joint_type = values["joint_type"]
    if joint_type not in JOINT_TYPES:
        return "joint_type", f"unknown joint type {joint_type!r}; valid: {', '.join(JOINT_TYPES)}"
    for column in ("theta", "d", "a", "alpha", "lower", "upper", "velocity"):
        value = values[column]
        optional = column in ("lower", "upper", "velocity")
        if value is None and optional:
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
            return column, f"{value!r} is not a number"
        # A continuous row reads back its own missing limits as infinities (dataclasses.replace).
        unlimited = joint_type == "continuous" and value == {"lower": -math.inf, "upper": math.inf}.get(column)
        if not math.isfinite(value) and not unlimited:
            return column, f"{value} is not a finite number"
        if abs(value) > LARGEST and not unlimited:
            return column, f"{value} is beyond {LARGEST:g} m, rad, m/s or rad/s, which no arm reaches"
    return _limit_problem(joint_type, values["lower"], values["upper"], values["velocity"])


def _limit_problem(
    joint_type: str, lower: float | None, upper: float | None, velocity: float | None
) -> tuple[str, str] | None:
    for column, value in (("lower", lower), ("upper", upper)):
        if joint_type == "prismatic" and value is None:
            return column, "a prismatic row must state its lower and upper limit in metres"
        if joint_type == "continuous" and value is not None and math.isfinite(value):
            return column, f"a continuous row has no limits, yet {value} is given; make it revolute or leave it out"
    if joint_type != "continuous":
        low = -DEFAULT_REVOLUTE_LIMIT if lower is None else lower
        high = DEFAULT_REVOLUTE_LIMIT if upper is None else upper
        if low > high:
            return "lower", f"the lower limit {low:.17g} lies above the upper limit {high:.17g}"
    if velocity is not None and velocity <= 0:
        return "velocity", f"{velocity:.17g} is no speed; it must be greater than 0"
    return None


def _defaults(joint_type: str) -> dict[str, float]:
    if joint_type == "prismatic":
        return {"velocity": DEFAULT_PRISMATIC_VELOCITY}
    limit = math.inf if joint_type == "continuous" else DEFAULT_REVOLUTE_LIMIT
    return {"lower": -limit, "upper": limit, "velocity": DEFAULT_REVOLUTE_VELOCITY}


def _stated(values: dict[str, Any]) -> dict[str, float]:
    """The numbers that were given, as plain floats (NumPy scalars and integers among them)."""
    return {k: float(v) for k, v in values.items() if v is not None and k not in ("name", "joint_type")}


def row_transform(row: DhRow, convention: str, q: float) -> Array:
    """The (4, 4) matrix A of one row at its joint variable q; the formulas stand at the top of this module."""
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
        stated = _stated_number(row)
        writer.writerow([stated.get(column, "") for column in COLUMNS])
    return out.getvalue()


def _yaml_text(table: DhTable) -> str:
    content: dict[str, Any] = {"name": table.name, "convention": table.convention}
    for which in ("base", "tool"):
        transform = getattr(table, which)
        if not np.array_equal(transform, np.eye(4)):
            content[which] = {"matrix": transform.tolist()}
    content["rows"] = [_stated_number(row) for row in table.rows]
    return yaml.dump(content, Dumper=_FlatRows, sort_keys=False, allow_unicode=True, width=200)


def _stated_number(row: DhRow) -> dict[str, Any]:
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


@dataclass(frozen=True, eq=False)
class DhTable:
    """A serial arm as a Denavit-Hartenberg table.

    Frame ``dh_0`` stands at ``base`` in the arm's base frame, row i leads from dh_(i-1) to dh_i, and the tool stands at
    ``tool`` in dh_n.

    Parameters
    ----------
    rows
        One :class:`DhRow` a joint, base first; names differ.
    convention
        ``"standard"`` or ``"modified"``; never guessed.
    name
        Name of the robot.
    base
        base_from_dh_0, a ``pin.SE3`` or a (4, 4) matrix in metres; kept as a read-only (4, 4) array.
    tool
        dh_n_from_tool, likewise.

    Raises
    ------
    InputError
        For no rows, names that occur twice, an unknown convention (:class:`~pinproof.errors.UnknownNameError`), or a
        base or tool that is no rigid transform.
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
            raise InputError(f"{self.name!r} is no name for a robot; wanted is printable text")
        object.__setattr__(self, "rows", rows)
        for which in ("base", "tool"):
            transform = matrix(rigid(which, getattr(self, which)))
            transform.setflags(write=False)
            object.__setattr__(self, which, transform)

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor again: NumPy forgets on the way through pickle that an array was read-only.
        return _rebuild, (self.rows, self.convention, self.name, self.base, self.tool)

    def __len__(self) -> int:
        return len(self.rows)

    @classmethod
    def load(cls, path: str | Path) -> DhTable:
        """Read a table from a ``.yaml``, ``.yml`` or ``.csv`` file; see :mod:`pinproof.description.dh`.

        Raises
        ------
        DhTableError
            Naming the file, and the row and column where there is one.
        """
        return load_table(path)

    def save(self, path: str | Path) -> None:
        """Write the table to a ``.yaml``, ``.yml`` or ``.csv`` file, whole or not at all; every number keeps its bits.

        Raises
        ------
        InputError
            If a base or a tool would be lost in a ``.csv``, which has no place for them.
        FileError
            If the file cannot be written; :class:`~pinproof.errors.DhTableError` for any other ending.
        """
        save_table(self, path)

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
        """(n,) largest joint speeds, rad/s or m/s."""
        return np.array([row.velocity for row in self.rows])

    def frames(self, q: npt.ArrayLike) -> Array:
        """Where the frames dh_0 ... dh_n stand.

        Parameters
        ----------
        q
            (n,) joint variables, rad or m; limits are not looked at.

        Returns
        -------
        (n + 1, 4, 4)
            base_from_dh_i. The first is ``base``; the tool comes after the last and is not part of it.

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
        """base_from_tool (4, 4) at joint variables q (n,): the plain product base A_1 ... A_n tool.

        This is the oracle that everything converted from the table is held against.

        Raises
        ------
        InputError
            If q has the wrong length or is not finite.
        """
        return np.array(self.frames(q)[-1] @ self.tool)

    def is_close(self, other: DhTable, *, tolerance: float = 0.0) -> bool:
        """Whether both tables hold the same words and, up to ``tolerance`` (rad, m, rad/s, m/s), the same numbers."""

        def words(table: DhTable) -> object:
            return table.name, table.convention, [(row.name, row.joint_type) for row in table.rows]

        def numbers(table: DhTable) -> Array:
            columns = [(r.theta, r.d, r.a, r.alpha, r.lower, r.upper, r.velocity) for r in table.rows]
            return np.concatenate([np.ravel(columns), table.base.ravel(), table.tool.ravel()])

        same = words(self) == words(other)
        return same and np.allclose(numbers(self), numbers(other), rtol=0.0, atol=tolerance)


def _checked_rows(rows: Iterable[DhRow]) -> tuple[DhRow, ...]:
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


def _rebuild(rows: tuple[DhRow, ...], convention: str, name: str, base: Array, tool: Array) -> DhTable:
    return DhTable(rows, convention=convention, name=name, base=base, tool=tool)
