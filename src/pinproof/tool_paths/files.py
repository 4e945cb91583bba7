"""Files of tool paths: a job with robot, scene, tool and strokes, in YAML or JSON, and the files that strokes name.

docs/formats/tool_paths.md describes them. The keys of robot, scene and tool are those of picks files.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import CollisionChecker, Scene
from pinproof.common import structs as st
from pinproof.common.files import YAML_SUFFIXES, other_separator, read_text, read_yaml, unknown_suffix
from pinproof.common.results import Rows, Shown, View
from pinproof.description import with_frame
from pinproof.errors import InputError, ToolPathError, UnknownNameError
from pinproof.model import Arm
from pinproof.picks import SETTINGS, Picks, checker_of_picks, read_settings, root_from_frame
from pinproof.spatial import SE3, Array, finite
from pinproof.tool_paths.path import ToolPath
from pinproof.tool_paths.rungs import COSTS, FollowCosts
from pinproof.tool_paths.strokes import Stroke, numbered
from pinproof.units import FAR

# The link that is added to the robot at the tip of the tool.
TIP = "tool_tip"

UNITS = {"m": 1.0, "mm": 1e-3, "in": 0.0254}
"""Metres per unit of length."""

COLUMNS = {
    "name": ("name",),
    "xyz": ("x", "y", "z"),
    "normal": ("nx", "ny", "nz"),
    "rpy": ("roll", "pitch", "yaw"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "speed": ("speed",),
}
"""The columns of a table of a path by key; each line is a pose."""

SUFFIXES = (*YAML_SUFFIXES, ".json")

VECTORS = st.array_of(st.list_of(st.vector(), 1), (None, 3))


def _one_or_many(name: str, value: Any) -> Array:
    many = np.iterable(value) and any(map(np.iterable, value))
    return finite(name, value, (None, 3) if many else (3,))


def _poses(name: str, value: Any) -> tuple[SE3, ...]:
    return tuple(st.TRANSFORM.check(f"{name}[{index}]", pose) for index, pose in enumerate(value))


def _as_many(own: PathPoints) -> str:
    if own.points is None or own.normals is None or own.normals.ndim == 1 or len(own.normals) == len(own.points):
        return ""
    return f"has {len(own.normals)} normals for {len(own.points)} points; state one normal, or one for each point"


@st.struct("path", kw_only=True, eq=False, rules=[st.Rule(("normals",), _as_many)])
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

    def paths(self, name: str, given: float = 1.0, remark: str = "") -> list[tuple[ToolPath, bool]]:
        """The path, if it is stated here; ``given`` are the metres of a unit of length, which ``remark`` explains."""
        if self.poses is not None:
            scaled = [SE3(pose.rotation, given * pose.translation) for pose in self.poses]
            path = ToolPath(scaled, self.speed, name)
        elif self.points is None:
            raise InputError("states no path; add poses, points with normals, or a file")
        elif self.normals is None:
            raise InputError("states points without normals; add normals, such as 'normals: [0, 0, 1]'")
        else:
            path = ToolPath.through(given * self.points, self.normals, speed=self.speed, name=name)
        return [(replace(path, notes=(*path.notes, remark)) if remark else path, True)]


@st.struct(
    "stroke", kw_only=True, eq=False,
    rules=[
        {"oneOf": [{"required": ["poses"]}, {"required": ["points", "normals"]}, {"required": ["file"]}]},
        st.Rule(("normals",), _as_many),
        st.Rule(
            ("file",),
            lambda own: "" if sum(each is not None for each in (own.poses, own.points, own.file)) == 1 else (
                "must state one of poses, points (with normals) and file"
            ),
        ),
    ],
)  # fmt: skip
class StrokeSource(PathPoints):
    """A stroke, or a file with one or several strokes."""

    name: str = st.key("its name; by default that of the file, or its number", default="")
    file: Path | None = st.key(
        "a file of paths: a table (`.csv`) or points (`.json`, `.yaml`)", default=None, kind=st.file_of()
    )
    process: bool | None = st.key(
        "whether the process is on while the strokes are followed; by default as the file states, otherwise on",
        default=None,
    )
    reversible: bool = st.key("whether strokes may be followed from their end to their start", default=True)
    closed: bool | None = st.key(
        "whether strokes may start at any of their poses; by default those whose first and last pose are equal",
        default=None,
    )

    def strokes(self, number: int, speed: float | None) -> list[Stroke]:
        """The strokes, with a default of their speed (m/s)."""
        own = self if self.speed is not None else replace(self, speed=speed)
        name = self.name or (self.file.stem if self.file else f"stroke {number}")
        if self.file is None:
            if self.unit not in (None, "m"):
                raise InputError("unit is that of a file; poses and points are in metres")
            paths = own.paths(name)
        elif self.file.suffix.lower() in READERS:
            paths = READERS[self.file.suffix.lower()](self.file, own, name)
        else:
            raise InputError(unknown_suffix(self.file, READERS))
        stated = [(path, on if self.process is None else self.process) for path, on in paths]
        return numbered(name, stated, closed=self.closed, reversible=self.reversible)


# -- files of one path ------------------------------------------------------------------------------------------------


def metres_of(points: Array, stated: str | None) -> tuple[float, str]:
    """Metres per unit of length of points (N, 3), and a remark if the unit was recognised by their size."""
    if stated is None and len(points) and np.abs(points).max() > FAR:
        return UNITS["mm"], f"coordinates up to {np.abs(points).max():.4g} are read as millimetres; state the unit"
    return UNITS[stated or "m"], ""


@contextmanager
def at_line(number: int) -> Iterator[None]:
    """Add the number of a line to errors about it."""
    try:
        yield
    except InputError as error:
        raise st.Misread(str(error), (), f"line {number}") from error


def read_points(file: Path, source: StrokeSource, name: str) -> list[tuple[ToolPath, bool]]:
    """The path of a JSON or YAML file with the keys of :class:`PathPoints`."""
    table = st.table_of(PathPoints)
    content = read_yaml(file, table.names, ToolPathError, suffixes=SUFFIXES)
    with st.errors_of(file, ToolPathError):
        read: PathPoints = table.parse("the file", content, file)
        own = {key: value for key in ("normals", "unit", "speed") if (value := getattr(source, key)) is not None}
        read = replace(read, **(own if read.speed is None else own | {"speed": read.speed}))
        places = [pose.translation for pose in read.poses] if read.poses else read.points
        return read.paths(name, *metres_of(np.array([] if places is None else places), read.unit))


def read_table(file: Path, source: StrokeSource, name: str) -> list[tuple[ToolPath, bool]]:
    """The path of a CSV file with the columns :data:`COLUMNS`, of which a line is a pose."""
    lines = read_text(file, ToolPathError).splitlines()
    rows = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if len(rows) < 2:
        raise ToolPathError(file, "has no poses below a line with the names of columns, such as x,y,z,nx,ny,nz")
    # The columns, which may state the unit of lengths: x [mm]
    number, header = rows[0]
    units, known = set(), [name for group in COLUMNS.values() for name in group]
    columns = []
    for cell in next(csv.reader([header])):
        column, _, unit = cell.replace("[", " ").replace("]", "").strip().partition(" ")
        columns.append(column.strip())
        if columns[-1] in COLUMNS["xyz"]:
            units.add(unit.strip())
    with st.errors_of(file, ToolPathError), at_line(number):
        if other := other_separator(columns):
            raise InputError(other)
        for column in columns:
            if column not in known:
                raise UnknownNameError("column", column, known)
        if len(set(columns)) < len(columns) or len(units) > 1 or not units <= {"", *UNITS}:
            raise InputError(f"states a column twice, or units of x, y, z other than one of {', '.join(UNITS)}")
        groups = {key: names for key, names in COLUMNS.items() if set(names) & set(columns)}
        lacking = [each for names in ({**groups, "xyz": COLUMNS["xyz"]}).values() for each in names]
        if missing := [each for each in lacking if each not in columns]:
            raise InputError(f"lacks the column {missing[0]}")
    cells: dict[str, list[Any]] = {column: [] for column in columns}
    for number, line in rows[1:]:
        with st.errors_of(file, ToolPathError), at_line(number):
            values = next(csv.reader([line]))
            if len(values) != len(columns):
                raise InputError(f"has {len(values)} cells under {len(columns)} columns")
            for column, value in zip(columns, values, strict=True):
                cells[column].append(value.strip() if column == "name" else st.parsed(value.strip()))
    # Poses, or points with normals
    arrays = {key: np.column_stack([cells[c] for c in names]) for key, names in groups.items() if key != "name"}
    with st.errors_of(file, ToolPathError):
        metres, remark = metres_of(arrays["xyz"], source.unit or next(iter(units)) or None)
        names, stated = cells.get("name", ()), arrays.get("speed")
        speed: Any = source.speed if stated is None else stated[1:, 0]
        if "rpy" in arrays or "quat_xyzw" in arrays:
            key = "rpy" if "rpy" in arrays else "quat_xyzw"
            placed = zip((metres * arrays["xyz"]).tolist(), arrays[key].tolist(), strict=True)
            poses = [st.pose_of(xyz, **{key: turned}) for xyz, turned in placed]
            path = ToolPath(poses, speed, name, names)
        else:
            normals = arrays.get("normal", source.normals)
            if normals is None:
                raise InputError("has points without normals; add the columns nx, ny, nz, or 'normals: [0, 0, 1]'")
            path = ToolPath.through(metres * arrays["xyz"], normals, speed=speed, name=name, names=names)
        return [(replace(path, notes=(*path.notes, remark)) if remark else path, True)]


READERS: dict[str, Callable[[Path, StrokeSource, str], list[tuple[ToolPath, bool]]]] = {
    ".csv": read_table,
    **dict.fromkeys(SUFFIXES, read_points),
}
"""The readers of the files that a stroke may name, by suffix; each path is with whether the process is on."""


# -- jobs -------------------------------------------------------------------------------------------------------------


def _free_rotation(name: str, value: Any) -> bool | tuple[float, float]:
    return bool(value) if isinstance(value, bool | np.bool_) else st.vector(2).check(name, value)


@st.struct("job", kw_only=True, eq=False, repr=False)
class ToolJob(Shown):
    """A job of tool paths: its strokes, the robot, the scene and the tool, and how the paths are followed."""

    strokes: tuple[Stroke, ...] = st.key("the strokes in the order of the file, in ``frame``", hidden=True)
    settings: Picks = st.key(
        "what the file states of robot, scene, tool, frames and home; without picks", default=Picks(()), hidden=True
    )
    source: Path | None = st.key("the file it was read from", default=None, hidden=True)
    frame: str = st.key(
        "the frame of the paths: one of `frames`, an obstacle, or a link that does not move; by default the root link",
        default="", kind=st.ANY_TEXT, shown="",
    )  # fmt: skip
    speed: float | None = st.key(
        "speed of the tool where a path states none; by default as fast as the joints permit", "m/s", default=None,
        above=0,
    )  # fmt: skip
    free_rotation: bool | tuple[float, float] = st.key(
        "whether the tool may rotate about its axis, or the range of its rotation away from the poses of the paths",
        "rad", default=True, kind=st.any_of(st.BOOLEAN, st.vector(2), check=_free_rotation),
    )  # fmt: skip
    rotations: int = st.key("number of rotations of the tool on the grid", default=24, minimum=1)
    tilts: int = st.key(
        "number of directions in which the grid tilts the tool by half of `rotation_deviation`", default=0, minimum=0
    )
    redundant: int | None = st.key("number of values of redundant joints on the grid", default=None, minimum=2)
    deviation: float = st.key("allowed distance of the tool from the path", "m", default=1e-3, above=0)
    rotation_deviation: float = st.key(
        "allowed angle of the tool, or of its axis if its rotation is free, to the path", "rad",
        default=float(np.radians(1.0)), above=0, shown=None,
    )  # fmt: skip
    speed_tolerance: float | None = st.key(
        "share by which the tool may be slower than the speed of the path; by default it may be slower where a joint "
        "does not permit the speed",
        default=None, minimum=0.01, below=1,
    )  # fmt: skip
    approach: float = st.key("length of the straight move along the tool axis to a path", "m", default=0.0, minimum=0)
    departure: float | None = st.key(
        "length of that away from a path; by default that of `approach`", "m", default=None, minimum=0
    )
    lifts: int = st.key("number of times the tool may be lifted within a path", default=0, minimum=0)
    cost: str | FollowCosts = st.key(
        "the cost of a motion: a name, or weights", default="balanced",
        kind=st.any_of(
            st.choice(*COSTS), st.table_of(FollowCosts),
            check=lambda name, value: value if isinstance(value, FollowCosts) else st.choice(*COSTS).check(name, value),
        ),
    )  # fmt: skip

    @property
    def options(self) -> dict[str, Any]:
        """The keyword arguments of :func:`pinproof.follow` that the job states."""
        return {name: getattr(self, name) for name in OPTIONS}

    def load_arm(self) -> Arm:
        """Load the arm that the file states, with its limits and held joints; its tcp is the tip of the tool.

        Raises
        ------
        InputError, PicksError
            As :meth:`pinproof.picks.Tool.load_arm`.
        """
        arm = self.settings.load_arm()
        if self.settings.tip.isIdentity():
            return arm
        urdf = with_frame(arm.robot.urdf, TIP, arm.tcp, self.settings.tip.homogeneous)
        return replace(arm.robot, urdf=urdf).arm(TIP, base=arm.base, limits=arm.limits, held=arm.held)

    def load_scene(self) -> Scene:
        """Load the scene that the file states; an empty one if it states none."""
        return self.settings.load_scene()

    def load_checker(self, arm: Arm | None = None, scene: Scene | None = None) -> CollisionChecker:
        """The arm in its scene with the tool attached, by default as :meth:`load_arm` and :meth:`load_scene` load them.

        Raises
        ------
        InputError
            For the reasons of :meth:`load_arm`, and if margins or contacts name bodies that do not exist.
        FileError
            If a file cannot be read.
        """
        arm, scene = arm or self.load_arm(), scene or self.load_scene()
        tip = self.settings.tip.inverse() if arm.tcp == TIP else SE3.Identity()
        tool = [replace(body, pose=tip * body.pose) for body in self.settings.tool]
        return checker_of_picks(arm, scene, replace(self.settings, tool=tool))

    def base_from_frame(self, checker: CollisionChecker) -> SE3:
        """The pose of the frame of the paths in the base frame of the arm."""
        arm = checker.arm
        root_from_paths = root_from_frame(self.frame, self.settings.frames, checker.scene, arm)
        return arm.root_from_base.inverse() * root_from_paths

    def placed(self, checker: CollisionChecker) -> tuple[Stroke, ...]:
        """The strokes in the base frame of the arm, as :func:`pinproof.follow` takes their paths."""
        placement = self.base_from_frame(checker)
        return tuple(stroke.transformed(placement) for stroke in self.strokes)

    def _view(self) -> View:
        count = sum(len(stroke.path) for stroke in self.strokes)
        head = f"{len(self.strokes)} strokes, {count} poses{f', from {self.source.name}' if self.source else ''}"
        rows = [
            [own.name, len(own.path), own.path.length, own.path.closed, own.process] for own in self.strokes
        ]  # fmt: skip
        notes = [f"{own.name}: {note}" for own in self.strokes for note in own.path.notes]
        table = Rows(("stroke", "poses", "length [m]", "closed", "process"), rows, len(rows))
        return View(head, [table, notes], notes)


OPTIONS = (
    "free_rotation", "rotations", "tilts", "redundant", "deviation", "rotation_deviation", "speed_tolerance",
    "approach", "departure", "lifts", "cost",
)  # fmt: skip

SHARED = (
    "robot", "srdf", "package_dirs", "xacro_args", "calibration", "limits", "tcp", "held", "scene", "margin",
    "margins", "home", "tip", "tool", "program", "frames",
)  # fmt: skip
"""The keys of picks files that a job has too."""

JOB = st.Table(
    "tool_paths",
    "A job of tool paths: its strokes, the robot, the scene and the tool, and how the paths are followed. Files that "
    "it names are relative to its folder.",
    *(own for name in SHARED for own in SETTINGS.keys if own.name == name),
    *st.table_of(ToolJob).keys,
    st.required("strokes", st.list_of(st.table_of(StrokeSource), 1), "the strokes, or files with strokes"),
)


def read_tool_paths(path: str | Path) -> ToolJob:
    """Read a job of tool paths: a YAML or JSON file, which docs/formats/tool_paths.md describes.

    Raises
    ------
    ToolPathError, PicksError
        If the file, or a file of paths that it names, cannot be read or its content is invalid; the message names
        file, line and key.
    """
    path = Path(path)
    content = read_yaml(path, JOB.names, ToolPathError, suffixes=SUFFIXES)
    with st.errors_of(path, ToolPathError):
        stated = JOB.values("the file", content, path)
        strokes: list[Stroke] = []
        for number, (source, row) in enumerate(zip(stated["strokes"], content["strokes"], strict=True), 1):
            key, where = f".strokes[{number - 1}]", st.position(row)
            for own in st.step(key, where, source.strokes, number, stated.get("speed")):
                if own.name in {other.name for other in strokes}:
                    raise st.Misread(f"a second stroke is named {own.name!r}; their names must differ", (key,), where)
                strokes.append(own)
        own_keys = {name: value for name, value in stated.items() if name in st.table_of(ToolJob).names}
        values = {**own_keys, "strokes": tuple(strokes), "settings": read_settings(content, path), "source": path}
        made: ToolJob = st.table_of(ToolJob).made(content, values)
        return made
