"""Denavit-Hartenberg tables: rows, forward kinematics as a plain matrix product, and YAML and CSV files.

The joint variable q is added to ``theta`` (revolute, continuous) or to ``d`` (prismatic). Row i transforms frame
dh_(i-1) to frame dh_i:

- ``standard`` (Denavit and Hartenberg 1955; Spong, Hutchinson and Vidyasagar, "Robot Modeling and Control", eq. 3.10)::

      A = Rz(theta) Tz(d) Tx(a) Rx(alpha)

- ``modified`` (Craig, "Introduction to Robotics", eq. 3.6), where row i holds a_(i-1) and alpha_(i-1)::

      A = Rx(alpha) Tx(a) Rz(theta) Tz(d)

docs/formats/dh.md describes the keys of YAML files and the columns of CSV files with examples. A number may be written
as ``[-][k*]pi[/m]``, because a rounded 1.5708 is not pi/2.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import yaml

from pinproof.common import structs as st
from pinproof.common.files import (
    csv_text,
    other_separator,
    read_text,
    read_yaml,
    refuse_unknown,
    unknown_suffix,
    write_text_whole,
)
from pinproof.common.results import Rows, Shown, View
from pinproof.errors import DhTableError, FileError, InputError
from pinproof.spatial import Array, finite, matrix, rigid
from pinproof.units import refuse_degree_limit, refuse_degrees, refuse_millimetres

CONVENTIONS = ("standard", "modified")
JOINT_TYPES = ("revolute", "prismatic", "continuous")


@dataclass(frozen=True)
class Make:
    """The Denavit-Hartenberg table that a manufacturer publishes for its arms.

    ``signs`` has for each row a text that fixes the direction of its x axis: ``+alpha`` or ``-alpha`` if the axes are
    at a right angle and alpha has this sign, ``-a`` or ``+a`` if they are parallel and a has this sign, empty if x is
    free. theta is 0 in all rows.
    """

    name: str
    convention: str
    signs: tuple[str, ...]


MAKES = {
    "ur": Make("Universal Robots", "standard", ("+alpha", "-a", "-a", "+alpha", "-alpha", "")),
    "franka": Make("Franka", "modified", ("", "-alpha", "+alpha", "+alpha", "-alpha", "+alpha", "+alpha")),
}
"""Universal Robots, "DH parameters for calculations of kinematics and dynamics"; Franka Robotics, "Robot limits and
interface specifications: Denavit-Hartenberg parameters"."""

LARGEST = 1e6
"""Metres, radians, m/s, rad/s. Larger numbers are typing errors; sines would lose digits and products overflow."""

NEARLY_PARALLEL = 0.05
"""Rad. Axes closer to parallel than this, but not parallel, have a far common normal; calibrated axes of Universal
Robots are up to 0.015 rad from parallel."""

DEFAULT_REVOLUTE_LIMIT = math.pi
"""Rad. Default limits of a revolute row are -pi and pi: one full rotation."""
DEFAULT_REVOLUTE_VELOCITY = math.pi
"""Rad/s. Default velocity limit of a revolute or continuous row, a common value for small arms."""
DEFAULT_PRISMATIC_VELOCITY = 1.0
"""M/s. Default velocity limit of a prismatic row, a common value for linear axes."""
DEFAULT_EFFORT = 100.0
"""N m or N. Default effort limit, because a URDF must state one; a typical value for small arms."""

VALUE = st.number(minimum=-LARGEST, maximum=LARGEST)
ABOVE_ZERO = st.number(above=0, maximum=LARGEST)


def _printable(pattern: str, more: str = "") -> st.Kind:
    """A name that matches a pattern."""

    def check(name: str, value: object) -> str:
        if not isinstance(value, str) or not re.search(pattern, value) or not value.isprintable():
            raise InputError(f"{name} = {value!r} is not a valid name; use printable text{more}")
        return value

    return st.simple({"type": "string", "minLength": 1, "pattern": pattern}, check)


NAME = _printable(r"^\S(.*\S)?$", " without leading or trailing spaces")


def _limit(name: str, value: Any) -> float | None:
    """A limit of q; a continuous row reads back its own missing limits as infinities (dataclasses.replace)."""
    if value is None or (isinstance(value, float) and math.isinf(value)):
        return value
    return cast(float, VALUE.check(name, value))


@st.struct(
    "row",
    rules=[
        {
            "allOf": [
                {
                    "if": {"required": ["type"], "properties": {"type": {"const": "prismatic"}}},
                    "then": {"required": ["lower", "upper"], "properties": {"lower": st.NUMBER, "upper": st.NUMBER}},
                },
                {
                    "if": {"required": ["type"], "properties": {"type": {"const": "continuous"}}},
                    "then": {"properties": {"lower": {"type": "null"}, "upper": {"type": "null"}}},
                },
            ]
        }
    ],
    first=("name", "type"),
)
class DhRow:
    """One joint and the link that it moves.

    The joint variable q is added to ``theta`` (revolute, continuous) or to ``d`` (prismatic).

    Raises
    ------
    InputError
        If a value is invalid; the message states the row and the column.
    """

    name: str = st.key("name of the joint, unique in the table", kind=NAME)
    theta: float = st.key(
        "angle about z; for a revolute or continuous joint the offset added to q",
        "rad",
        kind=st.simple(st.ANGLE, VALUE.check, st.parsed),
    )
    d: float = st.key("distance along z; for a prismatic joint the offset added to q", "m", kind=VALUE)
    a: float = st.key("distance along x", "m", kind=VALUE)
    alpha: float = st.key("angle about x", "rad", kind=st.simple(st.ANGLE, VALUE.check, st.parsed))
    joint_type: str = st.key(
        "type of the joint; `continuous` is revolute without limits",
        default="revolute",
        name="type",
        kind=st.choice(*JOINT_TYPES),
    )
    # None means "not stated" and is replaced by the default in __post_init__.
    lower: float = st.key(
        "lower limit of q; by default -pi for a revolute joint. A prismatic joint must state it, a continuous joint "
        "must not",
        "rad or m",
        default=None,
        kind=st.Kind(st.optional(VALUE).schema, _limit, st.optional(VALUE).parse),
    )
    upper: float = st.key(
        "upper limit of q; by default pi for a revolute joint, otherwise as `lower`",
        "rad or m",
        default=None,
        kind=st.Kind(st.optional(VALUE).schema, _limit, st.optional(VALUE).parse),
    )
    velocity: float = st.key(
        "velocity limit; by default pi rad/s or 1 m/s", "rad/s or m/s", default=None, kind=st.optional(ABOVE_ZERO)
    )
    effort: float = st.key(
        "largest torque or force, used where torques are limited; the default is not that of a real robot",
        "N m or N",
        default=None,
        kind=st.optional(ABOVE_ZERO),
        shown=DEFAULT_EFFORT,
    )

    def __post_init__(self) -> None:
        for column in ("lower", "upper"):
            value: float | None = getattr(self, column)
            # limits must be stated, omitted or finite, depending on the type
            free = -math.inf if column == "lower" else math.inf
            if self.is_prismatic and value is None:
                raise self._wrong(column, "is not stated; a prismatic row must state its limits in metres")
            if self.joint_type == "continuous" and value not in (None, free):
                raise self._wrong(column, f"is {value}; a continuous row has no limits: omit it, or change the type")
            if self.joint_type != "continuous" and value is not None and math.isinf(value):
                raise self._wrong(column, f"is {value}, which is not a finite number")
        limit = math.inf if self.joint_type == "continuous" else DEFAULT_REVOLUTE_LIMIT
        velocity = DEFAULT_PRISMATIC_VELOCITY if self.is_prismatic else DEFAULT_REVOLUTE_VELOCITY
        defaults = {"lower": -limit, "upper": limit, "velocity": velocity, "effort": DEFAULT_EFFORT}
        for column, default in defaults.items():
            if getattr(self, column) is None:
                object.__setattr__(self, column, default)
        if self.lower > self.upper:
            raise self._wrong("lower", f"is {self.lower:.17g}, above the upper limit {self.upper:.17g}")

    def _wrong(self, column: str, reason: str) -> InputError:
        error = InputError(f"{column} of row {self.name!r} {reason}")
        error.argument = column
        return error

    @property
    def is_prismatic(self) -> bool:
        """Whether q is a displacement along z."""
        return self.joint_type == "prismatic"


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


class CsvRow(dict[str, str]):
    """The cells of a line by column, without empty ones."""

    line = number = 0

    def at(self, column: str | None = None) -> str:
        """The position of a cell, or of the line."""
        return f"line {self.line}, row {self.number}" + (f", column {column}" if column else "")


def csv_content(path: Path, names: tuple[str, ...], error: type[FileError], comments: Sequence[str]) -> dict[str, Any]:
    """The content of a CSV file as that of a YAML file: the ``rows``, and the values of comments before the header.

    Parameters
    ----------
    path
        The file.
    names
        The valid columns.
    error
        Type of the exception if the file is invalid; the message states line and row.
    comments
        The keys that comments may state, such as ``# convention: standard``.
    """
    lines = read_text(path, error).splitlines()
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), len(lines))
    stated: dict[str, Any] = {}
    for name in comments:
        # Spreadsheets append commas to every line, these included.
        pattern = rf"^\s*#\s*{name}\s*:\s*([^\s,]+)[\s,]*$"
        values = re.findall(pattern, "\n".join(lines[:first]), re.MULTILINE)
        if len(set(values)) > 1:
            raise error(path, f"states more than one {name}: {', '.join(values)}")
        if values:
            stated[name] = values[0]
    try:
        reader = csv.reader(lines[first:])
        content = [(first + reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as caught:
        raise error(path, f"is not valid CSV: {caught}") from caught
    if not content:
        raise error(path, f"has no header; valid columns: {', '.join(names)}")
    header = [cell.strip() for cell in content[0][1]]
    if separator := other_separator(header):
        raise error(path, separator, "header")
    refuse_unknown(error, path, "column", header, names, "header")
    twice = sorted({column for column in header if header.count(column) > 1})
    if twice:
        raise error(path, f"duplicate column {twice[0]}", "header")
    rows = []
    for count, (line, cells) in enumerate(content[1:], start=1):
        row = CsvRow({column: cell.strip() for column, cell in zip(header, cells, strict=False) if cell.strip()})
        row.line, row.number = line, count
        if len(cells) != len(header):
            more = "; use decimal points, not commas" if len(cells) > len(header) else ""
            raise error(path, f"has {len(cells)} cells; the header has {len(header)}{more}", row.at())
        rows.append(row)
    return {"rows": rows, **stated}


def _refuse_other_units(rows: Sequence[DhRow], mappings: Sequence[Any]) -> None:
    """Refuse rows of a file that are probably in degrees or millimetres."""

    def in_row(row: DhRow, column: str) -> None:
        value = getattr(row, column)
        if column in ("theta", "alpha"):
            refuse_degrees(column, [value])
        elif row.joint_type == "revolute":
            refuse_degree_limit(column, value)
        elif row.is_prismatic and column == "upper":
            refuse_millimetres(column, [row.lower, value])

    for row, mapping in zip(rows, mappings, strict=True):
        for column in ("theta", "alpha", "lower", "upper"):
            if column in mapping:
                st.step(f".rows[{row.name!r}].{column}", st.position(mapping, column), in_row, row, column)
    refuse_millimetres("a and d", [length for row in rows for length in (row.a, row.d)])


class _FlatRows(yaml.SafeDumper):
    """A SafeDumper that writes mappings and lists without nested ones (rows of a table or of a matrix) on one line."""

    def represent_mapping(self, tag: str, mapping: Any, flow_style: bool | None = None) -> yaml.MappingNode:  # noqa: ARG002
        return super().represent_mapping(tag, mapping, flow_style=_is_flat(mapping.values()))

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> yaml.SequenceNode:  # noqa: ARG002
        return super().represent_sequence(tag, sequence, flow_style=_is_flat(sequence))


def _is_flat(values: Iterable[object]) -> bool:
    return not any(isinstance(value, (dict, list)) for value in values)


def _placed(name: str, value: Any) -> Array:
    placed = matrix(rigid(name, value))
    placed.setflags(write=False)
    return placed


def _transform(matrix: Any = None, **keys: Any) -> Any:
    if matrix is not None and keys:
        raise InputError("use either matrix, or xyz with rpy or quat_xyzw")
    return st.pose_of(**keys) if matrix is None else matrix


TRANSFORM = st.Table(
    "transform",
    "A rigid transform: a position and an orientation, or a matrix.",
    *st.POSE.keys,
    st.Key("matrix", st.list_of(st.vector(4), 4, 4), "four rows of four numbers, instead of the other keys"),
    rules={**st.ONE_ORIENTATION, "if": {"required": ["matrix"]}, "then": {"maxProperties": 1}},
    make=_transform,
)


@st.struct("dh", first=("name", "convention", "base", "tool"), eq=False, repr=False)
class DhTable(Shown):
    """A serial arm as a Denavit-Hartenberg table: frame dh_(i-1) is transformed to frame dh_i by row i."""

    rows: st.Accepting[tuple[DhRow, ...], Iterable[DhRow]] = st.key(
        "the joints, base first", kind=st.list_of(st.table_of(DhRow), 1, named="row")
    )
    convention: str = st.key(
        "`standard`: Rz(theta) Tz(d) Tx(a) Rx(alpha); `modified` (Craig): Rx(alpha) Tx(a) Rz(theta) Tz(d), where row i "
        "holds a and alpha of link i - 1",
        kw_only=True,
        kind=st.choice(*CONVENTIONS),
    )
    name: str = st.key(
        "name of the robot; by default the name of the file",
        default="dh_arm",
        kw_only=True,
        kind=_printable(r"\S"),
        shown=None,
    )
    base: st.Accepting[Array, npt.ArrayLike] = st.key(
        "base_from_dh_0: the pose of frame dh_0 in the base frame; a read-only (4, 4) array",
        default_factory=lambda: np.eye(4),
        kw_only=True,
        kind=st.Kind(TRANSFORM, _placed, TRANSFORM.parse),
        shown={},
    )
    tool: st.Accepting[Array, npt.ArrayLike] = st.key(
        "dh_n_from_tool: the pose of the tool in the last frame; a read-only (4, 4) array",
        default_factory=lambda: np.eye(4),
        kw_only=True,
        kind=st.Kind(TRANSFORM, _placed, TRANSFORM.parse),
        shown={},
    )

    def __len__(self) -> int:
        return len(self.rows)

    def _view(self) -> View:
        names = ("name", "joint_type", "theta", "d", "a", "alpha", "lower", "upper", "velocity")
        cells = ([getattr(row, name) for name in names] for row in self.rows)
        lines = (
            f"{row.name}: {row.joint_type}, theta {row.theta:.6g}, d {row.d:.6g}, a {row.a:.6g}, alpha {row.alpha:.6g}"
            for row in self.rows
        )
        return View(
            f"{self.name!r}, {self.convention}, {len(self)} rows",
            [Rows([name.replace("_", " ") for name in names], cells, len(self))],
            lines,
            len(self),
            f"{self.name}: DH table, {self.convention} convention (m, rad)",
        )

    @classmethod
    def load(cls, path: str | Path) -> DhTable:
        """Read a table from a ``.yaml``, ``.yml`` or ``.csv`` file; see :mod:`pinproof.description.dh`.

        Raises
        ------
        DhTableError
            If the file is invalid; the message states the file and, where possible, the row and column.
        """
        path, table = _table_file(path), st.table_of(cls)
        in_csv = path.suffix.lower() == ".csv"
        content = (
            csv_content(path, st.table_of(DhRow).names, DhTableError, ("convention",))
            if in_csv
            else read_yaml(path, table.names, DhTableError)
        )
        with st.errors_of(path, DhTableError, keys=not in_csv):
            table.refuse_unknown(content)
            if "convention" not in content:
                raise InputError("no convention; add 'convention: standard' or 'convention: modified' (CSV: after #)")
            values = {"name": path.stem, **table.values("the table", content, path)}
            made: DhTable = table.made(content, values)
            _refuse_other_units(made.rows, content["rows"])
        return made

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
        # the columns of each row, without infinite limits and without the default effort
        names = st.table_of(DhRow).names
        stated = ({name: getattr(row, "joint_type" if name == "type" else name) for name in names} for row in self.rows)
        rows = [
            {
                name: value
                for name, value in row.items()
                if isinstance(value, str) or (math.isfinite(value) and (name, value) != ("effort", DEFAULT_EFFORT))
            }
            for row in stated
        ]
        # a base or tool that is not the identity needs a YAML file
        moved = [which for which in ("base", "tool") if not np.array_equal(getattr(self, which), np.eye(4))]
        if path.suffix.lower() == ".csv":
            for which in moved:
                what = f"the {which} of the table is not the identity, which a CSV cannot store"
                raise InputError(f"{what}; save a .yaml file")
            columns = [name for name in names if name != "effort" or any("effort" in row for row in rows)]
            cells = ([row.get(column, "") for column in columns] for row in rows)
            write_text_whole(path, csv_text(columns, cells, comment=f"# convention: {self.convention}"))
            return
        content: dict[str, Any] = {"name": self.name, "convention": self.convention}
        content |= {which: {"matrix": getattr(self, which).tolist()} for which in moved}
        content["rows"] = rows
        text = yaml.dump(content, Dumper=_FlatRows, sort_keys=False, allow_unicode=True, width=200)
        write_text_whole(path, text)

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

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on nearly parallel axes, whose common normal is farther away than the arm is long."""
        lines = []
        for i, row in enumerate(self.rows):
            # alpha is the angle between the axes of a joint and the next; the last standard row ends at the tool
            first = i if self.convention == "standard" else i - 1
            if not 0 <= first < len(self.rows) - 1:
                continue
            before, after = self.rows[first], self.rows[first + 1]
            angle = abs(math.asin(math.sin(row.alpha)))
            length = max(1.0, sum(abs(each.a) for each in self.rows))
            if 0.0 < angle < NEARLY_PARALLEL and max(abs(before.d), abs(after.d)) > length:
                lines.append(
                    f"the axes of {before.name!r} and {after.name!r} are nearly parallel ({1e3 * angle:.3g} mrad), so "
                    f"d ({before.d:.6g} m and {after.d:.6g} m) is the distance to their far common normal and no "
                    "length of the arm; for links in their places, load the robot by name with its calibration"
                )
        return tuple(lines)

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
