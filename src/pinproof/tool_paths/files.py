"""Files of tool paths: a job with robot, scene, tool and strokes, in YAML or JSON, and the files that strokes name.

docs/formats/tool_paths.md describes them. The keys of robot, scene and tool are those of picks files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision import CollisionChecker, Obstacle, Scene
from pinproof.common import structs as st
from pinproof.common.files import read_yaml, unknown_suffix
from pinproof.common.results import Rows, Shown, View
from pinproof.description import MESH_SUFFIXES, moved_by, with_frame
from pinproof.errors import InputError, NoClosedForm, ToolPathError
from pinproof.model import Arm, JointGroup, JointLimits
from pinproof.picks import SETTINGS, Picks, checker_of_picks, read_settings, root_from_frame
from pinproof.spatial import SE3
from pinproof.tool_paths.geometry import Contour, Raster, paths_on
from pinproof.tool_paths.machine_code import read_gcode
from pinproof.tool_paths.path import LONGEST_LINE, ToolPath
from pinproof.tool_paths.path_files import SUFFIXES, PathPoints, as_many, read_points, read_table
from pinproof.tool_paths.rungs import COSTS, FollowCosts, PathArm, redundant_axes
from pinproof.tool_paths.strokes import Stroke, strokes_of

READERS: dict[str, Callable[[Path, Any, str], list[tuple[ToolPath, bool]]]] = {
    ".csv": read_table,
    **dict.fromkeys(SUFFIXES, read_points),
    **dict.fromkeys((".gcode", ".nc", ".ngc"), read_gcode),
}
"""The readers of the files of paths, by suffix; each path is with whether the process is on."""

# The link that is added to the robot at the tip of the tool.
TIP = "tool_tip"


@st.struct(
    "stroke", kw_only=True, eq=False,
    rules=[
        {"oneOf": [{"required": ["poses"]}, {"required": ["points", "normals"]}, {"required": ["file"]}]},
        st.Rule(("normals",), as_many),
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
    file: Path | None = st.key("a file of paths, or a mesh with `contour` or `raster`", default=None, kind=st.file_of())
    contour: Contour | None = st.key("the edges of a face of a mesh, or its section with a plane", default=None)
    raster: Raster | None = st.key("parallel lines along the surface of a mesh", default=None)
    process: bool | None = st.key(
        "whether the process is on while the strokes are followed; by default as the file states, otherwise on",
        default=None,
    )
    reversible: bool = st.key("whether strokes may be followed from their end to their start", default=True)
    closed: bool | None = st.key(
        "whether strokes may start at any of their poses; by default those whose first and last pose are equal",
        default=None,
    )

    def strokes(self, number: int, speed: float | None) -> tuple[Stroke, ...]:
        """The strokes, with a default of their speed (m/s)."""
        name = self.name or (self.file.stem if self.file else f"stroke {number}")
        if self.file is None:
            if self.unit not in (None, "m"):
                raise InputError("unit is that of a file; poses and points are in metres")
            found = [(self.path(name), True)]
        elif (suffix := self.file.suffix.lower()) in READERS:
            found = READERS[suffix](self.file, self, name)
        elif suffix in MESH_SUFFIXES:
            kind = self.contour or self.raster
            if kind is None or (self.contour and self.raster):
                raise InputError(f"{self.file.name} is a mesh; state either contour or raster")
            if self.normals is not None:
                raise InputError(f"{self.file.name} is a mesh, which has its own normals; remove normals")
            found = [(path, True) for path in paths_on(self.file, kind, self.unit)]
            found = found if self.speed is None else [(replace(path, speed=self.speed), on) for path, on in found]
        else:
            raise InputError(unknown_suffix(self.file, (*READERS, *MESH_SUFFIXES)))
        if (self.contour or self.raster) and (self.file is None or suffix not in MESH_SUFFIXES):
            raise InputError("contour and raster are for files of meshes")
        stated = [(path, on if self.process is None else self.process) for path, on in found]
        return strokes_of(name, stated, speed, reversible=self.reversible, closed=self.closed)


VALUES = st.mapping_to(st.list_of(st.NUMBER, 1))
"""Values of joints by name."""

# -- jobs -------------------------------------------------------------------------------------------------------------


def _free_rotation(name: str, value: Any) -> bool | tuple[float, float]:
    if isinstance(value, bool | np.bool_):
        return bool(value)
    low, high = st.vector(2).check(name, value)
    if low > high:
        raise InputError(f"{name} = [{low:g}, {high:g}] must state the smaller angle first")
    return low, high


@st.struct("job", kw_only=True, eq=False, repr=False)
class ToolJob(Shown):
    """A job of tool paths: its strokes, the robot, the scene and the tool, and how the paths are followed."""

    strokes: tuple[Stroke, ...] = st.key("the strokes in the order of the file, in ``frame``", hidden=True)
    settings: Picks = st.key(
        "what the file states of robot, scene, tool, frames and home; without picks", default=Picks(()), hidden=True
    )
    source: Path | None = st.key("the file it was read from", default=None, hidden=True)
    frame: str = st.key(
        "the frame of the paths: one of `frames`, an obstacle, or a link; by default the root link. Joints between the "
        "root link and this link, such as those of a turntable, move with the arm, except for those in `held`",
        default="", kind=st.ANY_TEXT, shown="",
    )  # fmt: skip
    part: tuple[Obstacle, ...] = st.key(
        "bodies that are fixed to a `frame` that moves, such as the part on a turntable; poses are in this frame",
        default=(), kind=st.list_of(st.table_of(Obstacle), named="body"),
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
    redundant: int | dict[str, tuple[float, ...]] | None = st.key(
        "number of values on the grid of redundant joints and of those that move `frame`, or their values by name",
        "rad or m", default=None,
        kind=st.any_of(
            st.integer(2), VALUES,
            check=lambda name, value: (VALUES if isinstance(value, Mapping) else st.integer(2)).check(name, value),
        ),
    )  # fmt: skip
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
    approach: float = st.key(
        "length of the straight move along the tool axis to a path", "m", default=0.0, minimum=0, maximum=LONGEST_LINE
    )
    departure: float | None = st.key(
        "length of that away from a path; by default that of `approach`",
        "m",
        default=None,
        minimum=0,
        maximum=LONGEST_LINE,
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
        moving = {} if self.carrier is None else {"frame": self.carrier[0], "arm": "tool"}
        return {name: getattr(self, name) for name in OPTIONS} | moving

    @cached_property
    def carrier(self) -> tuple[str, SE3] | None:
        """The link that carries the paths, if joints outside the arm move it, and the pose of their frame in it."""
        placement, name = SE3.Identity(), self.frame
        for _ in self.settings.frames:  # a cycle is an error of the transform
            if name in self.settings.frames:
                frame = self.settings.frames[name]
                placement, name = frame.pose * placement, frame.frame
        if name in ("", *self.settings.frames, *self.load_scene()):
            return None
        arm = self.settings.load_arm()
        urdf, held = arm.robot.urdf, self.settings.held
        moving = [joint for joint in arm.held if joint not in held and urdf.joints[joint].mimic is None]
        if name not in urdf.links or moved_by(urdf, name, moving):
            return (name, placement) if name in urdf.links else None
        follower = urdf.joints.get(moved_by(urdf, name, arm.joint_names))
        if follower is not None and follower.mimic is not None:
            raise self._at(
                "frame",
                f"link {name!r} moves with the arm: joint {follower.name} follows {follower.mimic.leader} (mimic). The "
                "frame of a job must be fixed, or moved by joints outside the arm; pp.follow(checker, path, "
                f"frame={name!r}) follows paths in it",
            )
        return None

    def load_arm(self) -> JointGroup:
        """Load the arm that the file states, with its limits and held joints; its tcp is the tip of the tool.

        If joints outside the arm move the frame of the paths, it is a joint group of the arm ``"tool"`` and of those
        joints, ``"part"``.

        Raises
        ------
        InputError, PicksError
            As :meth:`pinproof.picks.Tool.load_arm`, and :meth:`pinproof.Robot.arms` if the part moves.
        """
        return self.with_part(self.at_tip(self.settings.load_arm()))

    def at_tip(self, arm: Arm) -> Arm:
        """An arm with the tip of the tool as its tcp."""
        if self.settings.tip.isIdentity():
            return arm
        urdf = with_frame(arm.robot.urdf, TIP, arm.tcp, self.settings.tip.homogeneous)
        # with_held ignores the values of mimic joints, which follow from those of the others
        return replace(arm.robot, urdf=urdf).arm(TIP, base=arm.base, limits=arm.limits).with_held(arm.held)

    def with_part(self, arm: Arm) -> JointGroup:
        """An arm and the joints outside it that move the frame of the paths; the arm itself if there are none."""
        if self.carrier is None:
            return arm
        limits = None if self.settings.limits is None else JointLimits.load(self.settings.limits)
        names = {"tool": arm.tcp, "part": self.carrier[0]}
        return arm.robot.arms(names, limits=limits, held=self.settings.held)

    def load_scene(self) -> Scene:
        """Load the scene that the file states; an empty one if it states none."""
        return self.settings.load_scene()

    def load_checker(self, arm: JointGroup | None = None, scene: Scene | None = None) -> CollisionChecker:
        """The arm in its scene with the tool attached, by default as :meth:`load_arm` and :meth:`load_scene` load them.

        Raises
        ------
        InputError
            For the reasons of :meth:`load_arm`, and if margins or contacts name bodies that do not exist.
        FileError
            If a file cannot be read.
        """
        arm, scene = arm or self.load_arm(), scene or self.load_scene()
        moving = self.carrier
        tip = self.settings.tip.inverse() if TIP in arm.robot.urdf.links else SE3.Identity()
        own = None if moving is None else "tool"
        tool = [replace(body, pose=tip * body.pose, arm=own) for body in self.settings.tool]
        if moving is not None:
            tool += [replace(body, pose=moving[1] * body.pose, arm="part") for body in self.part]
        elif self.part:
            raise self._at(
                "part", "has bodies that move with the frame of the paths, but no joint outside the arm does"
            )
        return checker_of_picks(arm, scene, replace(self.settings, tool=tool))

    def base_from_frame(self, checker: CollisionChecker) -> SE3:
        """The pose of the frame of the paths in the base frame of the arm, or in the link that carries them."""
        if self.carrier is not None:
            return self.carrier[1]
        arm = checker.arm
        try:
            root_from_paths = root_from_frame(self.frame, self.settings.frames, checker.scene, arm)
        except InputError as error:
            raise self._at("frame", str(error)) from error
        return arm.root_from_base.inverse() * root_from_paths

    def _at(self, key: str, reason: str) -> InputError | ToolPathError:
        """The error of a key, with its line in the file if there is one."""
        place = self.settings.places.get(key)
        return InputError(f"{key}: {reason}") if self.source is None or place is None else (
            ToolPathError(self.source, reason, place)
        )  # fmt: skip

    def placed(self, checker: CollisionChecker) -> tuple[Stroke, ...]:
        """The strokes as :func:`pinproof.follow` takes their paths with :attr:`options`.

        They are in the base frame of the arm, or in the frame of the link that carries them if joints move it.
        """
        placement = self.base_from_frame(checker)
        if isinstance(self.redundant, dict):
            frame, name = (self.carrier[0], "tool") if self.carrier else (None, None)
            try:
                redundant_axes(PathArm.of(checker.group, frame, name), self.redundant)
            except NoClosedForm:  # the values are not used
                pass
            except InputError as error:
                raise self._at("redundant", str(error)) from error
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
    "robot", "srdf", "package_dirs", "xacro_args", "calibration", "visual_bodies", "limits", "tcp", "held", "scene",
    "margin", "margins", "home", "tip", "tool", "program", "frames",
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
