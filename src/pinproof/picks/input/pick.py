"""Picks: grasps with approach and retreat, families of grasps, places, and how a row of a file states them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pinproof.collision import SMALLEST, Obstacle
from pinproof.common import structs as st
from pinproof.common.files import LinedMapping
from pinproof.common.results import Rows, Shown, View
from pinproof.common.validation import ReadOnlyDict, require_number, unique_names
from pinproof.errors import InputError, UnknownNameError
from pinproof.model import Arm, Payload
from pinproof.motion import ToolLimits
from pinproof.picks.input.tools import POSE_IN_REACH, HandValues
from pinproof.spatial import SE3, Array, finite, frozen, pose, rotation_about, translated, xyz_rpy
from pinproof.units import ANGLE_UNITS, parse_angle, refuse_degrees

STEPS = 24
"""Number of tried rotations of a free spin: one every 15 degrees."""

MOST_STEPS = 3600
"""Largest number of rotations in a range, each of which is tried: 0.1 degrees each over a full rotation."""

SHARES = (0.5, 1.0)
"""Fractions of a tolerance at which grasps are tried."""


@st.described()
class GraspSpin:
    """Rotations (rad) of a grasp about its approach direction."""

    angles: tuple[float, ...] = st.key("the rotations that are tried, in this order", default=(0.0,))
    sampled: bool = st.key(
        "whether the angles are samples of a range. If all of them fail, nothing is proven about those between",
        default=False,
    )

    def __post_init__(self) -> None:
        angles = finite("spin", self.angles, (None,))
        if not len(angles):
            raise InputError("spin has no angle; state at least one or omit spin")
        object.__setattr__(self, "angles", tuple(angles.tolist()))

    @classmethod
    def free(cls, steps: int = STEPS) -> GraspSpin:
        """Any rotation about the approach direction, sampled in ``steps``."""
        outwards = ((k + 1) // 2 * (1 if k % 2 else -1) for k in range(steps))  # 0, 1, -1, 2, -2, ...
        return cls(tuple(2 * np.pi * k / steps for k in outwards), sampled=True)

    @classmethod
    def between(cls, first: float, last: float, steps: int = STEPS) -> GraspSpin:
        """Rotations from ``first`` to ``last``; those with the smallest magnitude are tried first."""
        if not last >= first or not 1 <= steps <= MOST_STEPS:
            raise InputError(
                f"spin from {first} to {last} in {steps} steps; the first angle must not exceed the last and the "
                f"number of steps must be from 1 to {MOST_STEPS}"
            )
        return cls(tuple(sorted(np.linspace(first, last, steps + 1).tolist(), key=abs)), sampled=last > first)


def _angles(name: str, value: object) -> GraspSpin:
    """``free``, one angle, several, or the spin itself."""
    if isinstance(value, GraspSpin):
        return value
    if isinstance(value, str):
        return GraspSpin.free()
    angles = np.atleast_1d(np.asarray(value, dtype=float)).tolist()
    refuse_degrees(name, angles)
    return GraspSpin(tuple(angles))


def _between(range: tuple[float, float], steps: int = STEPS) -> GraspSpin:  # noqa: A002  # the key
    refuse_degrees("range", range)
    return GraspSpin.between(*range, steps)


SPIN_RANGE = st.Table(
    "spin_range",
    "A range of rotations about the approach direction.",
    st.required("range", st.vector(2), "first and last rotation", "rad"),
    st.Key("steps", st.integer(1, MOST_STEPS), "number of steps between them", "", STEPS),
    make=_between,
)

SPIN = st.any_of(st.choice("free"), st.NUMBER, st.list_of(st.NUMBER, 1), SPIN_RANGE, check=_angles)


def _sides(name: str, value: object) -> tuple[float, ...]:
    sides = finite(name, np.broadcast_to(np.asarray(value, dtype=float), 3), (3,)).tolist()
    return tuple(require_number(name, side, "m", minimum=0) for side in sides)


@st.struct("tolerance")
class GraspTolerance:
    """How far a grasp may be moved along and about the axes of the tip if the nominal one fails.

    Half of the tolerance and all of it are tried, one axis at a time.
    """

    position: tuple[float, float, float] = st.key(
        "along x, y, z, in both directions; one number for all of them",
        "m",
        default=(0.0, 0.0, 0.0),
        kind=st.any_of(st.number(minimum=0), st.list_of(st.number(minimum=0), 3, 3), check=_sides),
    )
    tilt: float = st.key("about x and y, in both directions", "rad", default=0.0, minimum=0)

    def groups(self) -> Iterator[list[tuple[str, SE3]]]:
        """Groups of displacements with increasing size: each as text and as ``nominal_from_moved``."""
        yield [("", SE3.Identity())]
        for share in SHARES:
            group = []
            for axis, side in enumerate(self.position):
                for shift in (share * side, -share * side) if side else ():
                    words = f"{shift * 1e3:+.1f} mm along the tip's {'xyz'[axis]}"
                    group.append((words, pose(xyz=[shift * (axis == k) for k in range(3)])))
            for axis in (0, 1) if self.tilt else ():
                for turn in (share * self.tilt, -share * self.tilt):
                    words = f"tilted by {np.degrees(turn):+.1f} deg about the tip's {'xy'[axis]}"
                    group.append((words, pose(rpy=[turn * (axis == k) for k in range(3)])))
            if group:
                yield group


@dataclass(frozen=True, eq=False)
class Member:
    """One grasp of a family: ``nominal_from_tip``, and a text that states how it differs from the nominal grasp."""

    nominal_from_tip: SE3
    words: str = ""

    @property
    def head(self) -> str:
        """The beginning of a reason for this grasp; empty for the nominal one."""
        return f"{self.words}: " if self.words else ""


def family(spin: GraspSpin, tolerance: GraspTolerance, axis: Array) -> Iterator[list[Member]]:
    """The grasps in groups of increasing displacement; the nominal grasp and its rotations are the first group.

    ``axis`` (3,) is the unit vector of the spin axis in the tip frame.
    """
    words_of = {angle: f"spun by {np.degrees(angle):+.0f} deg" if angle else "" for angle in spin.angles}
    turns = [(SE3(rotation_about(axis, angle), np.zeros(3)), words_of[angle]) for angle in spin.angles]
    for group in tolerance.groups():
        pairs = ((*displaced, *turned) for displaced in group for turned in turns)
        yield [Member(turn * shift, ", ".join(filter(None, [spun, words]))) for words, shift, turn, spun in pairs]


TIP, ROOT, OBJECT = "tip", "root", "object"
"""The frame of a direction is the tip or the root link; the pose of a place is that of the tip or the object."""

MOVES = ("approach", "retreat")

LONGEST_MOVE = 20.0
"""Metres: the largest approach or retreat. Larger values are probably stated in millimetres."""


def _line(text: str, default: float = 0.1) -> Any:
    """The key of the length of a straight line."""
    text = f"length of the straight line {text}; 0 for none"
    return st.key(text, "m", default=default, minimum=0, maximum=LONGEST_MOVE)


def _direction(move: str, default: tuple[float, float, float]) -> Any:
    return st.key(f"direction of the {move}; it is normalised", default=default)


def _frame_of(move: str, default: str) -> Any:
    text = f"the frame of `{move}_direction`: the tip of the tool or the root link of the robot"
    return st.key(text, default=default, kind=st.choice(TIP, ROOT))


LINE_KEYS = tuple(f"{move}{part}" for move in MOVES for part in ("", "_direction", "_frame"))


def support_names(stated: str | Sequence[str] | None) -> tuple[str, ...] | None:
    """The names of the obstacles that support an object; None if they are determined automatically."""
    return None if stated is None else unique_names("support", stated)


SUPPORT = st.any_of(st.TEXT, st.simple({**st.list_of(st.TEXT, 1).schema, "uniqueItems": True}), check=unique_names)


class StraightLines:
    """The straight lines of a pick or a place; ``tip`` is the pose of the tip at the grasp or the release."""

    approach: float
    approach_direction: st.Direction
    approach_frame: str
    retreat: float
    retreat_direction: st.Direction
    retreat_frame: str

    def before(self, tip: SE3, share: float = 1.0) -> SE3:
        """The pose of the tip on the approach, from 0 at ``tip`` to 1 at the start of the line."""
        along = self.approach_direction if self.approach_frame == ROOT else tip.rotation @ self.approach_direction
        return translated(tip, -share * self.approach * np.asarray(along))

    def after(self, tip: SE3, share: float = 1.0) -> SE3:
        """The pose of the tip on the retreat, from 0 at ``tip`` to 1 at the end of the line."""
        along = self.retreat_direction if self.retreat_frame == ROOT else tip.rotation @ self.retreat_direction
        return translated(tip, share * self.retreat * np.asarray(along))

    def axis_in(self, tip: SE3) -> Array:
        """(3,) the approach direction in the axes of the tip."""
        direction = np.array(self.approach_direction)
        return direction if self.approach_frame == TIP else np.asarray(tip.rotation.T @ direction)


ORIENTATION = (
    st.Key(
        "rpy",
        st.vector(item=st.ANGLE),
        "orientation of the tip: angles about fixed axes, R = Rz(yaw) Ry(pitch) Rx(roll)",
        "rad",
    ),
    st.Key("quat_xyzw", st.vector(4), "the orientation as a quaternion, scalar last, instead of `rpy`"),
)


def _released(object_pose: SE3 | None = None, **tip: Any) -> dict[str, Any]:
    if object_pose is not None and tip:
        given = " and ".join(tip)
        raise InputError(f"states {given} of the tip, and object_pose; only one or the other is possible")
    if object_pose is not None:
        return {"pose": object_pose, "pose_of": OBJECT}
    if "xyz" not in tip or len(tip) < 2:
        raise InputError("place does not state its xyz and rpy or quat_xyzw, or its object_pose")
    return {"pose": POSE_IN_REACH.make(**tip)}


RELEASE = st.Table(
    "release",
    "The pose at a release.",
    st.Key("xyz", st.vector(), "position of the tip at the release, in `frame`", "m"),
    *ORIENTATION,
    st.Key(
        "object_pose",
        POSE_IN_REACH,
        "the final pose of the object, in `frame`, instead of the pose of the tip: frame_from_object, with the pose "
        "that the object has in the scene file, or in `object`, as its own frame",
    ),
    rules={
        "oneOf": [
            {"required": ["object_pose"], **st.without("xyz", "rpy", "quat_xyzw")},
            {"required": ["xyz", "rpy"]},
            {"required": ["xyz", "quat_xyzw"]},
        ]
    },
    make=_released,
)


@st.struct("place", eq=False, first=("pose", "frame", *LINE_KEYS))
class PlaceTarget(StraightLines):
    """Where the object is put down.

    The pose is that of the tool's tip at the release (``xyz`` with ``rpy`` or ``quat_xyzw``), or that of the object
    (``object_pose``). For a family of grasps the pose of the tip is that of the nominal grasp; the object has the same
    final pose for every grasp of the family.
    """

    pose: SE3 = st.key(
        "``frame_from_tip`` at the release; with ``pose_of='object'`` the final pose of the object", inline=RELEASE
    )
    frame: str = st.key("the frame of the pose, as for a pick; by default the root link of the robot", default="")
    approach: float = _line("to the release")
    approach_direction: st.Direction = _direction("approach", (0.0, 0.0, -1.0))
    approach_frame: str = _frame_of("approach", ROOT)
    retreat: float = _line("of the empty tool after the release")
    retreat_direction: st.Direction = _direction("retreat", (0.0, 0.0, -1.0))
    retreat_frame: str = _frame_of("retreat", TIP)
    support: str | Sequence[str] | None = st.key(
        "the obstacle, or a list of obstacles, that the object is put onto; by default those within 1 mm below it. "
        "Stored as a tuple of names",
        default=None,
        kind=SUPPORT,
    )
    pose_of: str = st.key("``'tip'`` or ``'object'``", default=TIP, kind=st.choice(TIP, OBJECT), hidden=True)


_PARTS = {
    "transit": "from home to the start of the approach",
    "approach": "the straight line before the grasp",
    "retreat": "the straight line after the grasp",
    "transfer": "with the object to the start of the line to its place",
    "place": "the straight line to the release",
    "leave": "the straight line of the empty tool after the release",
}
PARTS = tuple(_PARTS)
"""The parts of the motion of a pick, in order."""

RETURN = "return"
"""The motion to home after the part is put down, which programs of controllers and sequences have."""

SPEED_READ_ONLY = "the speeds of a pick are read-only; make another pick with dataclasses.replace(pick, speed=...)"


@st.struct("tool_speed", kw_only=True, rules=[{"minProperties": 1}])
class ToolSpeed:
    """Limits of the tcp, relative to the base. At least one is stated. See :class:`pinproof.motion.ToolLimits`."""

    linear_speed: float | None = st.key("largest speed of the tcp, above 0", "m/s", default=None, above=0)
    angular_speed: float | None = st.key("largest angular speed, above 0", "rad/s", default=None, above=0)
    linear_acceleration: float | None = st.key(
        "largest acceleration of the tcp, above 0", "m/s²", default=None, above=0
    )
    angular_acceleration: float | None = st.key(
        "largest angular acceleration, above 0", "rad/s²", default=None, above=0
    )

    def __post_init__(self) -> None:
        if all(value is None for value in vars(self).values()):
            raise InputError(f"a speed states none of {', '.join(vars(self))}")

    def limits(self, arm: Arm) -> ToolLimits:
        """The constraint of the timing for an arm."""
        return ToolLimits(arm, **vars(self))


def _part_speeds(name: str, value: Any) -> Mapping[str, ToolSpeed]:
    """The limits by part; a number is the linear speed of all."""
    if not isinstance(value, Mapping):
        value = dict.fromkeys(PARTS, ToolSpeed(linear_speed=value))
    for part in value:
        if part not in PARTS:
            raise UnknownNameError("part", part, PARTS, name)
    return ReadOnlyDict(value, SPEED_READ_ONLY)


_SPEED = st.any_of(
    st.number(above=0),
    st.table_of(ToolSpeed),
    check=lambda _, value: value if isinstance(value, ToolSpeed) else ToolSpeed(linear_speed=value),
)
STAGE_SPEEDS = st.Table(
    "stage_speeds",
    "Limits of the tcp on parts of the motion of a pick. A number is a linear speed in m/s.",
    *(st.Key(part, _SPEED, text) for part, text in _PARTS.items()),
)


def angle_in(stated: Any) -> Any:
    """An angle of a file: ``5 deg``, ``0.1 rad``, or a number in radians."""
    if not isinstance(stated, str) or not stated.strip().endswith(tuple(ANGLE_UNITS)):
        return st.parsed(stated)
    try:
        return parse_angle(stated)
    except ValueError as error:
        raise InputError(str(error)) from None


ANGLE_TEXT = st.simple({"type": "string", "pattern": r"^[-+0-9.eE]+ *(deg|rad)$"})

UPRIGHT = st.simple(
    st.any_of(st.number(minimum=SMALLEST, below=np.pi / 2), ANGLE_TEXT).schema,
    lambda name, value: require_number(name, value, "rad", minimum=SMALLEST, below=np.pi / 2),
    angle_in,
)

_OBSTACLE = st.table_of(Obstacle)
BODY = st.Table(
    "object",
    "The grasped object as a shape. Its pose is tip_from_object.",
    st.Key("name", st.TEXT, "its name in reports", "", "object"),
    *(key for key in _OBSTACLE.keys if key.name != "name"),
    make=partial(Obstacle, name="object"),
)

_PAYLOAD = st.table_of(Payload)
OBJECT_PAYLOAD = st.Table(
    "object_payload",
    "The mass of a grasped object, in the frame of the object.",
    *(key for key in _PAYLOAD.keys if key.name != "frame"),
    make=Payload,
)


def _carried(name: str, value: Any) -> Any:
    if not isinstance(value, Obstacle) and not (isinstance(value, str) and value):
        raise InputError(f"{name} is {value!r}; it must be the name of an obstacle, or an obstacle")
    return value


NO_XYZ = "does not state its xyz"


def _grasp(xyz: Any = None, **turned: Any) -> SE3:
    if xyz is None:
        raise InputError(NO_XYZ)
    if not turned:
        raise InputError("states no orientation; add rpy or quat_xyzw to the pick or to the defaults")
    made: SE3 = POSE_IN_REACH.make(xyz=xyz, **turned)
    return made


GRASP = st.Table(
    "grasp",
    "The pose of a grasp.",
    st.Key("xyz", st.vector(), "position of the tool's tip at the grasp, in `frame`", "m"),
    *ORIENTATION,
    rules=st.ONE_ORIENTATION,
    make=_grasp,
)

_ANY_GRASP = st.Table(
    GRASP.title,
    GRASP.text,
    *GRASP.keys,
    rules=GRASP.rules,
    make=lambda xyz=None, **turned: {} if xyz is None else {"pose": _grasp(xyz, **turned)},
)
"""The pose of a grasp, or none."""


@st.struct(
    "pick",
    eq=False,
    repr=False,
    first=("name", "pose", "frame", "part", "grasp", "tool", "object", *LINE_KEYS, "spin", "tolerance", "support"),
)
class Pick(HandValues, StraightLines, Shown):
    """One grasp, or a family of them, with its straight approach and retreat."""

    name: str = st.key("its name, unique in the file")
    pose: st.Accepting[SE3, SE3 | None] = st.key(
        "``frame_from_tip``: the target pose of the tool's tip at the grasp. A pick of a part type needs none: the "
        "grasps of its part are tried in order, and ``pose`` is that of the object",
        default=None,
        kind=st.simple({}, lambda name, value: None if value is None else st.TRANSFORM.check(name, value)),
        inline=_ANY_GRASP,
    )
    approach: float = _line("before the grasp")
    retreat: float = _line("after the grasp")
    retreat_direction: st.Direction = _direction("retreat", (0.0, 0.0, 1.0))
    approach_direction: st.Direction = _direction("approach", (0.0, 0.0, 1.0))
    approach_frame: str = _frame_of("approach", TIP)
    retreat_frame: str = _frame_of("retreat", ROOT)
    frame: str = st.key(
        "the frame of the pose: one of `frames`, an obstacle, or a link that does not move; by default the root link "
        "of the robot",
        default="",
    )
    spin: GraspSpin = st.key(
        f"equivalent rotations about the approach direction: one, a list, a range, or `free` for any ({STEPS} are "
        "tried)",
        "rad",
        default_factory=GraspSpin,
        kind=SPIN,
        shown=0,
    )
    tolerance: GraspTolerance = st.key(
        "how far the grasp may be moved if the nominal one fails", default_factory=GraspTolerance, shown=None
    )
    carried: Obstacle | str | None = st.key(
        "the grasped object: the name of an obstacle of the scene, or a shape, whose pose is tip_from_object and which "
        "is an obstacle there until it is grasped. It moves with the tool after the grasp; without it, the motion "
        "after the grasp is judged with the empty tool. In a pattern, `{i}`, `{j}` and `{k}` are replaced by the "
        "indices",
        default=None,
        name="object",
        kind=st.any_of(st.TEXT, BODY, check=_carried),
    )
    support: str | Sequence[str] | None = st.key(
        "the obstacle, or a list of obstacles, that the object may touch until it is lifted; by default those within 1 "
        "mm below it. Stored as a tuple of names",
        default=None,
        kind=SUPPORT,
    )
    place: PlaceTarget | None = st.key(
        "where the object is put down; by default the pick ends with the retreat", default=None
    )
    upright: float | None = st.key(
        "while the object is carried, the axis of the tip that is vertical at the grasp stays within this angle of the "
        "vertical, such as `5 deg`; by default any orientation is allowed. The transfer is planned under this "
        "constraint",
        "rad",
        default=None,
        kind=UPRIGHT,
    )
    upright_axis: st.Direction | None = st.key(
        "another axis for `upright`, in the frame of the tip; it must point up within the angle", default=None
    )
    payload: Payload | None = st.key(
        "the mass of the object, in its own frame; the torque limits of the joints then apply",
        default=None,
        kind=OBJECT_PAYLOAD,
    )
    speed: Mapping[str, ToolSpeed] = st.key(
        "limits of the tcp by part of the motion; a number is the largest linear speed (m/s) of all parts",
        default_factory=dict,
        kind=st.any_of(st.number(above=0), STAGE_SPEEDS, check=_part_speeds),
        shown=None,
    )
    arm: str | None = st.key(
        "in a file with `robots`, the one that executes the pick; by default any may", default=None
    )
    part: str | None = st.key("the type of its object, one of `parts`", default=None)
    grasp: str | None = st.key("the grasp of its part; by default all of them are tried in order", default=None)
    tool: str | None = st.key("the tool, one of `tools`; by default that of the grasp or of the part", default=None)
    by_part: bool = st.key(
        "whether the grasps of the part are tried, because no pose is stated", default=False, hidden=True
    )

    def __post_init__(self) -> None:
        if self.pose is None:
            if self.part is None:
                raise InputError(NO_XYZ)
            for name, value in {"pose": frozen(SE3.Identity()), "frame": str(self.carried), "by_part": True}.items():
                object.__setattr__(self, name, value)
        if self.part is not None and not isinstance(self.carried, str):
            raise InputError(f"pick {self.name!r} states a part but not the name of its object in the scene")
        if self.by_part is False and self.grasp is not None and self.part is None:
            raise InputError(f"pick {self.name!r} states a grasp but no part")
        if self.carried is None and (self.place is not None or self.support is not None):
            raise InputError(f"pick {self.name!r} states a place or a support but no object")
        if self.upright is not None and self.carried is None:
            raise InputError(f"pick {self.name!r} states upright but no object, whose orientation it limits")
        if self.upright is None and self.upright_axis is not None:
            raise InputError(f"pick {self.name!r} states upright_axis but not upright, the allowed angle")
        if self.payload is not None and (self.carried is None or self.payload.frame is not None):
            reason = "no object" if self.carried is None else "a frame; the payload moves with the object"
            raise InputError(f"pick {self.name!r} states a payload and {reason}")

    def transformed(self, root_from_pick: SE3) -> Pick:
        """Return the pick transformed as by :meth:`Picks.transformed`."""
        place = None if self.place is None else _transformed(self.place, root_from_pick)
        return replace(_transformed(self, root_from_pick), place=place)

    def _view(self) -> View:
        x, y, z = self.pose.translation
        frame = f" in {self.frame}" if self.frame else ""
        carries = "" if self.object_name is None else f", object {self.object_name}"
        lines = f"approach {self.approach * 1e3:g} mm, retreat {self.retreat * 1e3:g} mm"
        placed = ", placed" if carries and self.place is not None else ""
        poses: list[tuple[str, Pick | PlaceTarget]] = [("grasp", self)]
        poses += [] if self.place is None else [("place", self.place)]
        rows = [(kind, *xyz_rpy(each.pose), each.frame or "root", each.approach, each.retreat) for kind, each in poses]
        columns = ("pose", "x", "y", "z", "roll", "pitch", "yaw", "frame", "approach", "retreat")
        head = f"{self.name!r} at ({x:.4g}, {y:.4g}, {z:.4g}) m{frame}, {lines}{carries}{placed}"
        return View(head, [Rows(columns, rows)], title=f"Pick {self.name}{carries} (m, rad)")

    @property
    def object_name(self) -> str | None:
        """The name of the grasped object; None without one."""
        return self.carried.name if isinstance(self.carried, Obstacle) else self.carried


_Target = TypeVar("_Target", Pick, PlaceTarget)


def _transformed(target: _Target, placement: SE3) -> _Target:
    directions = {
        f"{move}_direction": tuple((placement.rotation @ getattr(target, f"{move}_direction")).tolist())
        for move in MOVES
        if getattr(target, f"{move}_frame") == ROOT
    }
    pose = target.pose if target.frame else placement * target.pose
    return replace(target, pose=pose, **directions)  # type: ignore[arg-type]  # three numbers each


LARGEST_PATTERN = 100_000
"""Largest number of picks of one row; :class:`pinproof.picks.PickGrid` generates more on demand."""

GRID = st.Table(
    "grid",
    "The grid of a pattern, along the axes of the pick's frame.",
    st.required("counts", st.list_of(st.integer(1), 3, 3), "number of picks along x, y, z"),
    st.required("step", st.vector(), "distance of neighbours along x, y, z", "m"),
)

PATTERN = st.Table(
    "pattern",
    "Copies of a pick; they are named `part[0,0]`, `part[0,1]`, ..., or with three indices if there are layers.",
    st.required("grid", GRID, "a regular grid"),
)

DEFAULTS = st.Table(
    "defaults",
    "Keys of a pick that apply where a pick does not state them.",
    *(key for key in st.table_of(Pick).keys if key.name != "name"),
    rules=st.ONE_ORIENTATION,
)

PICK = st.Table(
    "pick",
    "One grasp, or a family of them. `xyz` and an orientation (`rpy` or `quat_xyzw`) are required, here or in "
    "`defaults`, unless a `part` is stated; an `object` is required for `part`, `support`, `place` and `upright`.",
    *st.table_of(Pick).keys,
    st.Key("pattern", PATTERN, "copies of this pick on a grid"),
    rules=st.ONE_ORIENTATION,
    make=Pick,
)


def completed(defaults: Mapping[str, Any], row: Mapping[str, Any]) -> LinedMapping:
    """A row with the defaults that it does not state; its orientation, in either notation, replaces theirs."""
    turned = {"rpy", "quat_xyzw"}
    given = {key: value for key, value in defaults.items() if not (key in turned and turned & row.keys())}
    whole = LinedMapping({**given, **row})
    whole.line, whole.column = getattr(row, "line", 0), getattr(row, "column", 0)
    whole.positions = {**getattr(defaults, "positions", {}), **getattr(row, "positions", {})}
    return whole


def _refuse_unused(stated: Mapping[str, Any], whole: Mapping[str, Any], lines: Pick | PlaceTarget, *steps: str) -> None:
    """Raise Misread at a key of a straight line that has no effect: the line has no length, or a frame no direction.

    ``whole`` is what is stated with the defaults. Without an approach, its direction is still that of the spin and of
    the grip. The length and the direction may be those of a grasp of the part.
    """
    of_part = isinstance(lines, Pick) and lines.part is not None
    for move in () if of_part else ("retreat",) if isinstance(lines, Pick) else MOVES:
        for name in (f"{move}_direction", f"{move}_frame"):
            if name in stated and getattr(lines, move) == 0.0:
                reason = f"has no effect, because {move} is 0; state the length of the line, or remove the key"
                raise st.Misread(reason, (*steps, f".{name}"), st.position(stated, name))
    for name in () if of_part else (f"{move}_frame" for move in MOVES):
        direction, usual = name.replace("frame", "direction"), next(k for k in fields(lines) if k.name == name).default
        if name in stated and direction not in whole and getattr(lines, name) != usual:
            reason = f"is the frame of {direction}, which is not stated; state the direction, or remove the key"
            raise st.Misread(reason, (*steps, f".{name}"), st.position(stated, name))


def picks_of_row(row: Any, defaults: Mapping[str, Any], path: Path, *, incomplete: bool = False) -> list[Pick]:
    """The pick of a row of a file at a path, or the picks of its pattern; InputError if it is invalid.

    A row that is ``incomplete``, the defaults, need not state the length of the lines of which it states the direction.
    """
    if not isinstance(row, dict):
        raise InputError(f"{row!r} is not a pick; valid keys: {', '.join(PICK.names)}")
    if "name" not in row:
        raise InputError("states no name; a pick needs a name")
    # The pick of the row
    whole = completed(defaults, row)
    if "part" in whole and "xyz" not in whole:
        # The grasps of the part are tried; an orientation of the defaults is for other picks
        posed = ("rpy", "quat_xyzw", "frame")
        if foreign := next((name for name in posed if name in row), ""):
            raise InputError(f"states {foreign} but no xyz; state both, or neither to try the grasps of the part")
        for name in posed:
            whole.pop(name, None)
    elif "grasp" in whole:
        raise InputError("states a grasp of its part and xyz, a pose of its own; remove one of them")
    values = PICK.values("the pick", whole, path)
    pattern = values.pop("pattern", None)
    first: Pick = PICK.made(whole, values)
    if not incomplete:
        _refuse_unused(row, whole, first)
        if first.place is not None and isinstance(own := row.get("place"), dict):
            _refuse_unused(own, own, first.place, ".place")
    if pattern is None:
        return [first]
    # Its copies on a grid
    counts, step = pattern["grid"]["counts"], pattern["grid"]["step"]
    if prod(counts) > LARGEST_PATTERN:
        raise InputError(f"pattern.grid has {prod(counts)} picks; at most {LARGEST_PATTERN} are allowed")
    made = []
    for index in product(*map(range, counts)):
        own = index if counts[2] > 1 else index[:2]
        carried = first.carried
        if isinstance(carried, str):
            for letter, place in zip("ijk", own, strict=False):
                carried = carried.replace(f"{{{letter}}}", str(place))
        placed = translated(first.pose, [k * d for k, d in zip(index, step, strict=True)])
        made.append(replace(first, name=f"{first.name}[{','.join(map(str, own))}]", pose=placed, carried=carried))
    return made
