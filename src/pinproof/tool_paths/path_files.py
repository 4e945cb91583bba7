"""Files of one path: points and normals, or poses, in JSON, YAML and tables."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.common import structs as st
from pinproof.common.files import YAML_SUFFIXES, other_separator, read_text, read_yaml
from pinproof.errors import InputError, ToolPathError, UnknownNameError
from pinproof.spatial import SE3, Array, finite
from pinproof.tool_paths.path import ToolPath
from pinproof.units import FAR, LENGTH_UNITS

COLUMNS = {
    "name": ("name",),
    "xyz": ("x", "y", "z"),
    "normal": ("nx", "ny", "nz"),
    "rpy": ("roll", "pitch", "yaw"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "speed": ("speed",),
}
"""The columns of a table of a path by key; each line is a pose."""

UNITS = {"speed": "m/s", **dict.fromkeys(COLUMNS["rpy"], "rad")}
"""The units of columns that are not lengths."""

SUFFIXES = (*YAML_SUFFIXES, ".json")

VECTORS = st.array_of(st.list_of(st.vector(), 1), (None, 3))


def _one_or_many(name: str, value: Any) -> Array:
    many = np.iterable(value) and any(map(np.iterable, value))
    return finite(name, value, (None, 3) if many else (3,))


def _poses(name: str, value: Any) -> tuple[SE3, ...]:
    return tuple(st.TRANSFORM.check(f"{name}[{index}]", pose) for index, pose in enumerate(value))


def as_many(own: PathPoints) -> str:
    """Why the number of normals does not fit that of the points; empty if it does."""
    if own.points is None or own.normals is None or own.normals.ndim == 1 or len(own.normals) == len(own.points):
        return ""
    return f"has {len(own.normals)} normals for {len(own.points)} points; state one normal, or one for each point"


@st.struct("path", kw_only=True, eq=False, rules=[st.Rule(("normals",), as_many)])
class PathPoints:
    """The poses of one path, or points and normals of a surface."""

    poses: tuple[SE3, ...] | None = st.key(
        "poses of the tip of the tool, whose z axis is the axis of the tool", default=None,
        kind=st.Kind(st.list_of(st.POSE, 1).schema, _poses, st.list_of(st.POSE, 1).parse),
    )  # fmt: skip
    points: npt.NDArray[np.float64] | None = st.key(
        "points of a surface, in order, instead of `poses`", "m", default=None, kind=VECTORS
    )
    normals: npt.NDArray[np.float64] | None = st.key(
        "the outward normal of the surface at each point, or one for all of them; the axis of the tool points in the "
        "opposite direction, and the x axis of the tip along the path. Files without normals need one for all",
        default=None, kind=st.simple({"anyOf": [st.vector(), VECTORS]}, _one_or_many, st.parsed),
    )  # fmt: skip
    unit: Literal["m", "mm", "in"] | None = st.key(
        "unit of lengths in the file. By default that of the file; a file that states none is in metres, or in "
        "millimetres if a coordinate is above 10, which a note of the path states",
        default=None,
    )
    speed: float | None = st.key(
        "speed of the tool, in place of that of the file; by default that of the job", "m/s", default=None, above=0
    )

    def path(self, name: str, speed: npt.ArrayLike | None = None, names: Sequence[str] = ()) -> ToolPath:
        """The path, if it is stated here; a ``speed`` and ``names`` of poses are those of a table."""
        metres, remark = LENGTH_UNITS[self.unit or "m"], ""
        places = self.points if self.poses is None else np.array([pose.translation for pose in self.poses])
        if self.unit is None and places is not None and (far := float(np.abs(places).max(initial=0.0))) > FAR:
            metres, remark = LENGTH_UNITS["mm"], f"coordinates up to {far:.4g} are read as millimetres; state the unit"
        speed = self.speed if speed is None else speed
        if self.poses is not None:
            if self.normals is not None:
                raise InputError("states normals for poses, whose z axes are the axis of the tool; remove normals")
            scaled = [SE3(pose.rotation, metres * pose.translation) for pose in self.poses]
            path = ToolPath(scaled, speed, name, names)
        elif self.points is None:
            raise InputError("states no path; add poses, points with normals, or a file")
        elif self.normals is None:
            raise InputError("states points without normals; add normals, such as 'normals: [0, 0, 1]'")
        else:
            path = ToolPath.through(metres * self.points, self.normals, speed=speed, name=name, names=names)
        return replace(path, notes=(*path.notes, remark)) if remark else path


def read_points(file: Path, source: PathPoints, name: str) -> list[tuple[ToolPath, bool]]:
    """The path of a JSON or YAML file with the keys of :class:`PathPoints`, with whether the process is on."""
    table = st.table_of(PathPoints)
    content = read_yaml(file, table.names, ToolPathError, suffixes=SUFFIXES)
    with st.errors_of(file, ToolPathError):
        read: PathPoints = table.parse("the file", content, file)
        own = {key: value for key in ("normals", "unit", "speed") if (value := getattr(source, key)) is not None}
        return [(replace(read, **own).path(name), True)]


def read_table(file: Path, source: PathPoints, name: str) -> list[tuple[ToolPath, bool]]:
    """The path of a CSV file with the columns :data:`COLUMNS`, with whether the process is on."""
    lines = read_text(file, ToolPathError).splitlines()
    rows = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if len(rows) < 2:
        raise ToolPathError(file, "has no poses below a line with the names of columns, such as x,y,z,nx,ny,nz")
    with st.errors_of(file, ToolPathError):
        columns, unit = st.step("", f"line {rows[0][0]}", _columns, rows[0][1])
        cells = [st.step("", f"line {number}", _cells, columns, line) for number, line in rows[1:]]
        by_column = dict(zip(columns, zip(*cells, strict=True), strict=True))
        values = {
            key: np.column_stack([by_column[column] for column in names])
            for key, names in COLUMNS.items()
            if key != "name" and names[0] in columns
        }
        if "normal" in values and not (directed := values["normal"].any(axis=1)).all():
            number = rows[1 + int(directed.argmin())][0]
            raise InputError(f"line {number}: the normal has length 0; every point needs a direction")
        stated: dict[str, Any] = {"normals": values.get("normal", source.normals), "unit": source.unit or unit or None}
        if turned := {"rpy", "quat_xyzw"} & values.keys():
            (key,) = turned
            rows_of = zip(values["xyz"].tolist(), values[key].tolist(), strict=True)
            stated |= {"poses": [st.pose_of(xyz, **{key: row}) for xyz, row in rows_of], "normals": None}
        else:
            stated["points"] = values["xyz"]
        speed = values["speed"][1:, 0] if "speed" in values and source.speed is None else source.speed
        return [(PathPoints(**stated).path(name, speed, by_column.get("name", ())), True)]


def _columns(header: str) -> tuple[list[str], str]:
    """The columns of a table, and the unit of lengths if they state it: ``x [mm]``."""
    cells = [cell.replace("[", " ").replace("]", "").split() for cell in next(csv.reader([header]))]
    columns = [cell[0] if cell else "" for cell in cells]
    if other := other_separator([header] if len(cells) == 1 else columns):
        raise InputError(other)
    known = [name for names in COLUMNS.values() for name in names]
    for column in columns:
        if column not in known:
            raise UnknownNameError("column", column, known)
    needed = [names for key, names in COLUMNS.items() if key == "xyz" or set(names) & set(columns)]
    if missing := [name for names in needed for name in names if name not in columns]:
        raise InputError(f"lacks the column {missing[0]}")
    units = {" ".join(cell[1:]) for cell in cells if cell[0] in COLUMNS["xyz"]}
    for column, *own in cells:
        if own and column not in COLUMNS["xyz"] and own != (unit := UNITS.get(column, "")).split():
            what = f"is in {unit}" if unit else "has no unit"
            raise InputError(f"states the column {column} in {' '.join(own)!r}, but it {what}; convert it")
    if len(units) > 1 or not units <= {"", *LENGTH_UNITS}:
        raise InputError(f"must state one unit for x, y and z, one of {', '.join(LENGTH_UNITS)}")
    if len(set(columns)) < len(columns) or {"roll", "qx"} <= set(columns):
        raise InputError("states a column twice, or angles and a quaternion")
    return columns, units.pop()


def _cells(columns: Sequence[str], line: str) -> list[Any]:
    values = [value.strip() for value in next(csv.reader([line]))]
    if len(values) != len(columns):
        raise InputError(f"has {len(values)} cells under {len(columns)} columns")
    return [value if name == "name" else st.parsed(value) for name, value in zip(columns, values, strict=True)]
