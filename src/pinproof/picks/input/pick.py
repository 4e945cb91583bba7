"""Picks: grasps with approach and retreat, families of grasps, named frames, grippers, and lists of picks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from pinproof.collision import Mesh, Obstacle, Scene
from pinproof.collision.certificates.path_constraints import SMALLEST
from pinproof.common.display import html_block, html_list, html_table, outline
from pinproof.common.structs import (
    ANGLE,
    ANY_TEXT,
    NUMBER,
    ONE_ORIENTATION,
    POSE,
    TEXT,
    TRANSFORM,
    Accepting,
    Direction,
    Key,
    Kind,
    Rule,
    Table,
    any_of,
    choice,
    file_of,
    integer,
    key,
    list_of,
    mapping_to,
    number,
    parsed,
    pose_of,
    required,
    simple,
    struct,
    table_of,
    vector,
    without,
)
from pinproof.common.validation import ReadOnlyDict, require_number, unique_names
from pinproof.description.meshes import COLOURED_SUFFIXES
from pinproof.description.urdf import moved_by
from pinproof.errors import InputError, PicksError, UnknownNameError
from pinproof.model import Arm, JointGroup, JointLimits, Payload, assemble, load_robot
from pinproof.model.dynamics import checked_payloads
from pinproof.motion import ToolLimits
from pinproof.picks.input.conveyor import Conveyor
from pinproof.picks.input.settings import GripLimits, PickBudget
from pinproof.spatial import SE3, Array, finite, frozen, pose, rigid, rotation_about, translated, xyz_rpy
from pinproof.units import (
    ANGLE_UNITS,
    MOST_MARGIN,
    MOST_REACH,
    parse_angle,
    refuse_degrees,
    refuse_millimetres,
    warn_of_millimetres,
)

STEPS = 24
"""Number of tried rotations of a free spin: one every 15 degrees."""

MOST_STEPS = 3600
"""Largest number of rotations in a range, each of which is tried: 0.1 degrees each over a full rotation."""

SHARES = (0.5, 1.0)
"""Fractions of a tolerance at which grasps are tried."""


@dataclass(frozen=True)
class GraspSpin:
    """Rotations (rad) of a grasp about its approach direction.

    Parameters
    ----------
    angles
        The rotations that are tried, in this order.
    sampled
        Whether the angles are samples of a range. If all of them fail, nothing is proven about those between.
    """

    angles: tuple[float, ...] = (0.0,)
    sampled: bool = False

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


SPIN_RANGE = Table(
    "spin_range",
    "A range of rotations about the approach direction.",
    required("range", vector(2), "first and last rotation", "rad"),
    Key("steps", integer(1, MOST_STEPS), "number of steps between them", "", STEPS),
    make=_between,
)

SPIN = any_of(choice("free"), NUMBER, list_of(NUMBER, 1), SPIN_RANGE, check=_angles)


def _sides(name: str, value: object) -> tuple[float, ...]:
    sides = finite(name, np.broadcast_to(np.asarray(value, dtype=float), 3), (3,)).tolist()
    return tuple(require_number(name, side, "m", minimum=0) for side in sides)


@struct("tolerance")
class GraspTolerance:
    """How far a grasp may be moved along and about the axes of the tip if the nominal one fails.

    Half of the tolerance and all of it are tried, one axis at a time.
    """

    position: tuple[float, float, float] = key(
        "along x, y, z, in both directions; one number for all of them",
        "m",
        default=(0.0, 0.0, 0.0),
        kind=any_of(number(minimum=0), list_of(number(minimum=0), 3, 3), check=_sides),
    )
    tilt: float = key("about x and y, in both directions", "rad", default=0.0, minimum=0)

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


def family(spin: GraspSpin, tolerance: GraspTolerance, axis: Array) -> Iterator[list[Member]]:
    """The grasps in groups of increasing displacement; the nominal grasp and its rotations are the first group.

    ``axis`` (3,) is the unit vector of the spin axis in the tip frame.
    """
    turns = [(SE3(rotation_about(axis, angle), np.zeros(3)), _spun(angle)) for angle in spin.angles]
    for group in tolerance.groups():
        yield [
            Member(turn * shift, ", ".join(filter(None, [spun, words])))
            for words, shift in group
            for turn, spun in turns
        ]


def _spun(angle: float) -> str:
    return f"spun by {np.degrees(angle):+.0f} deg" if angle else ""


def pose_in_reach(most: float = MOST_REACH) -> Table:
    """The keys of a pose whose position (m) is not clearly in millimetres: no number is above ``most``."""

    def make(**stated: Any) -> SE3:
        placed = pose_of(**stated)
        refuse_millimetres("xyz", placed.translation.tolist(), most=most)
        return placed

    return Table(POSE.title, POSE.text, *POSE.keys, rules=POSE.rules, make=make)


POSE_IN_REACH = pose_in_reach()


@struct("frame", eq=False)
class NamedFrame:
    """A named frame in which picks can be stated: parent_from_frame."""

    pose: SE3 = key("its pose in the parent", inline=POSE_IN_REACH)
    frame: str = key(
        "the parent: another frame, an obstacle, or a link that does not move", default="", kind=ANY_TEXT, shown=""
    )


def root_from_frame(name: str, frames: Mapping[str, NamedFrame], scene: Scene, arm: Arm) -> SE3:
    """``root_from_frame`` of a named frame; ``""`` is the frame of the robot's root link.

    A name is looked up first in ``frames``, then in the obstacles, then in the links.

    Raises
    ------
    UnknownNameError
        If no frame, obstacle or link has this name.
    InputError
        If the frames form a cycle, or the arm moves the link.
    """
    placement, seen = SE3.Identity(), list[str]()
    while name in frames:
        if name in seen:
            raise InputError(f"the frames {', '.join(seen)} form a cycle")
        seen.append(name)
        placement, name = frames[name].pose * placement, frames[name].frame
    if name in ("", arm.robot.urdf.root):
        return placement
    if name in scene:
        return scene[name].pose * placement
    if name not in arm.robot.urdf.links:
        raise UnknownNameError("frame", name, [*frames, *scene, *arm.robot.urdf.links])
    if moving := moved_by(arm.robot.urdf, name, (*arm.joint_names, *arm.followers)):
        raise InputError(f"the frame {name!r} is a link that joint {moving} moves; picks need a fixed frame")
    return arm.root_from_base * arm.frame_placement(arm.home, name) * placement


def bodies(least: int = 0, most: int | None = None) -> Kind:
    """Bodies with different names; in a file, they are grey if neither they nor their mesh state a colour."""
    obstacles = list_of(table_of(Obstacle), least, most, named="body")

    def parse(name: str, stated: object, path: Path) -> list[Obstacle]:
        found: list[Obstacle] = []
        for body in obstacles.parse(name, stated, path):
            coloured = isinstance(body.shape, Mesh) and str(body.shape.path).lower().endswith(COLOURED_SUFFIXES)
            found.append(body if body.rgba or coloured else replace(body, rgba=TOOL_GREY))
        return found

    return Kind(obstacles.schema, obstacles.check, parse)


@struct(
    "fingers",
    first=("opening", "grip", "axis"),
    rules=[
        Rule(
            ("grip", "opening"),
            lambda fingers: (
                f"open to {fingers.opening} m and grip at {fingers.grip} m; required: 0 <= grip <= opening"
                if fingers.grip > fingers.opening
                else ""
            ),
        )
    ],
    eq=False,
)
class GripperFingers:
    """Two fingers of a parallel gripper that are not part of the robot."""

    bodies: tuple[Obstacle, Obstacle] = key("the two fingers, fully closed; poses are tcp_from_body", kind=bodies(2, 2))
    opening: float = key("distance between their faces before the grasp", "m", minimum=0)
    grip: float = key("distance between their faces on the object, at most `opening`", "m", minimum=0)
    axis: Direction = key(
        "opening direction of the first finger, in the tcp frame; the second moves in the opposite direction",
        default=(0.0, 1.0, 0.0),
    )

    def apart(self) -> tuple[Obstacle, Obstacle]:
        """The open fingers, before the grasp."""
        return self._at(self.opening)

    def gripping(self) -> tuple[Obstacle, Obstacle]:
        """The fingers on the object."""
        return self._at(self.grip)

    def _at(self, gap: float) -> tuple[Obstacle, Obstacle]:
        aside = SE3(np.eye(3), gap / 2 * np.array(self.axis))
        first, second = self.bodies
        return replace(first, pose=aside * first.pose), replace(second, pose=aside.inverse() * second.pose)


@struct("cup", kw_only=True)
class SuctionCup:
    """The face of a suction cup: a disc centred at the tip, which faces along the z axis of the tip."""

    radius: float = key("radius of the face, above 0", "m", above=0)
    gap: float = key(
        "largest distance of any point of the rim from the surface of the object along the axis, in front of the face "
        "or behind it; the default suits a flat cup, and bellows allow more",
        "m",
        default=1e-3,
        above=0,
    )
    tilt: float = key(
        "largest angle between the face and the surface at its rim", "rad", default=0.1, above=0, below=np.pi / 2
    )
    rise: float | None = key(
        "how far the object may protrude into the cup, inside the rim and beyond the face; by default `gap`",
        "m",
        default=None,
        above=0,
    )

    @property
    def highest(self) -> float:
        """Metres: how far the object may protrude into the cup."""
        return self.gap if self.rise is None else self.rise


TIP, ROOT, OBJECT = "tip", "root", "object"
"""The frame of a direction is the tip or the root link; the pose of a place is that of the tip or the object."""

MOVES = ("approach", "retreat")

LONGEST_MOVE = 20.0
"""Metres: the largest approach or retreat. Larger values are probably stated in millimetres."""


def _line(text: str, default: float = 0.1) -> Any:
    """The key of the length of a straight line."""
    text = f"length of the straight line {text}; 0 for none"
    return key(text, "m", default=default, minimum=0, maximum=LONGEST_MOVE)


def _direction(move: str, default: tuple[float, float, float]) -> Any:
    return key(f"direction of the {move}; it is normalised", default=default)


def _frame_of(move: str, default: str) -> Any:
    text = f"the frame of `{move}_direction`: the tip of the tool or the root link of the robot"
    return key(text, default=default, kind=choice(TIP, ROOT))


LINE_KEYS = tuple(f"{move}{part}" for move in MOVES for part in ("", "_direction", "_frame"))


def support_names(stated: str | Sequence[str] | None) -> tuple[str, ...] | None:
    """The names of the obstacles that support an object; None if they are determined automatically."""
    return None if stated is None else unique_names("support", stated)


SUPPORT = any_of(TEXT, simple({**list_of(TEXT, 1).schema, "uniqueItems": True}), check=unique_names)


class StraightLines:
    """The straight lines of a pick or a place; ``tip`` is the pose of the tip at the grasp or the release."""

    approach: float
    approach_direction: Direction
    approach_frame: str
    retreat: float
    retreat_direction: Direction
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
    Key(
        "rpy",
        vector(item=ANGLE),
        "orientation of the tip: angles about fixed axes, R = Rz(yaw) Ry(pitch) Rx(roll)",
        "rad",
    ),
    Key("quat_xyzw", vector(4), "the orientation as a quaternion, scalar last, instead of `rpy`"),
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


RELEASE = Table(
    "release",
    "The pose at a release.",
    Key("xyz", vector(), "position of the tip at the release, in `frame`", "m"),
    *ORIENTATION,
    Key(
        "object_pose",
        POSE_IN_REACH,
        "the final pose of the object, in `frame`, instead of the pose of the tip: frame_from_object, with the pose "
        "that the object has in the scene file, or in `object`, as its own frame",
    ),
    rules={
        "oneOf": [
            {"required": ["object_pose"], **without("xyz", "rpy", "quat_xyzw")},
            {"required": ["xyz", "rpy"]},
            {"required": ["xyz", "quat_xyzw"]},
        ]
    },
    make=_released,
)


@struct("place", eq=False, first=("pose", "frame", *LINE_KEYS))
class PlaceTarget(StraightLines):
    """Where the object is put down.

    The pose is that of the tool's tip at the release (``xyz`` with ``rpy`` or ``quat_xyzw``), or that of the object
    (``object_pose``). For a family of grasps the pose of the tip is that of the nominal grasp; the object has the same
    final pose for every grasp of the family.
    """

    pose: SE3 = key(
        "``frame_from_tip`` at the release; with ``pose_of='object'`` the final pose of the object", inline=RELEASE
    )
    frame: str = key("the frame of the pose, as for a pick; by default the root link of the robot", default="")
    approach: float = _line("to the release")
    approach_direction: Direction = _direction("approach", (0.0, 0.0, -1.0))
    approach_frame: str = _frame_of("approach", ROOT)
    retreat: float = _line("of the empty tool after the release")
    retreat_direction: Direction = _direction("retreat", (0.0, 0.0, -1.0))
    retreat_frame: str = _frame_of("retreat", TIP)
    support: str | Sequence[str] | None = key(
        "the obstacle, or a list of obstacles, that the object is put onto; by default those within 1 mm below it. "
        "Stored as a tuple of names",
        default=None,
        kind=SUPPORT,
    )
    pose_of: str = key("``'tip'`` or ``'object'``", default=TIP, kind=choice(TIP, OBJECT), hidden=True)


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

SPEED_READ_ONLY = "the speeds of a pick are read-only; make another pick with dataclasses.replace(pick, speed=...)"


@struct("tool_speed", kw_only=True, rules=[{"minProperties": 1}])
class ToolSpeed:
    """Limits of the tcp, relative to the base. At least one is stated. See :class:`pinproof.motion.ToolLimits`."""

    linear_speed: float | None = key("largest speed of the tcp, above 0", "m/s", default=None, above=0)
    angular_speed: float | None = key("largest angular speed, above 0", "rad/s", default=None, above=0)
    linear_acceleration: float | None = key("largest acceleration of the tcp, above 0", "m/s²", default=None, above=0)
    angular_acceleration: float | None = key("largest angular acceleration, above 0", "rad/s²", default=None, above=0)

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


def _part_speed(_: str, value: Any) -> ToolSpeed:
    return value if isinstance(value, ToolSpeed) else ToolSpeed(linear_speed=value)


STAGE_SPEEDS = Table(
    "stage_speeds",
    "Limits of the tcp on parts of the motion of a pick. A number is a linear speed in m/s.",
    *(
        Key(part, any_of(number(above=0), table_of(ToolSpeed), check=_part_speed), text)
        for part, text in _PARTS.items()
    ),
)


def _angle(name: str, value: Any) -> float:
    return require_number(name, value, "rad", minimum=SMALLEST, below=np.pi / 2)


def _angle_in(stated: Any) -> Any:
    """An angle of a file: ``5 deg``, ``0.1 rad``, or a number in radians."""
    if not isinstance(stated, str) or not stated.strip().endswith(tuple(ANGLE_UNITS)):
        return parsed(stated)
    try:
        return parse_angle(stated)
    except ValueError as error:
        raise InputError(str(error)) from None


UPRIGHT = simple(
    any_of(
        number(minimum=SMALLEST, below=np.pi / 2),
        simple({"type": "string", "pattern": r"^[-+0-9.eE]+ *(deg|rad)$"}),
    ).schema,
    _angle,
    _angle_in,
)

_OBSTACLE = table_of(Obstacle)
BODY = Table(
    "object",
    "The grasped object as a shape. Its pose is tip_from_object.",
    Key("name", TEXT, "its name in reports", "", "object"),
    *(key for key in _OBSTACLE.keys if key.name != "name"),
    make=partial(Obstacle, name="object"),
)

_PAYLOAD = table_of(Payload)
OBJECT_PAYLOAD = Table(
    "object_payload",
    "The mass of a grasped object, in the frame of the object.",
    *(key for key in _PAYLOAD.keys if key.name != "frame"),
    make=Payload,
)


def _carried(name: str, value: Any) -> Any:
    if not isinstance(value, Obstacle) and not (isinstance(value, str) and value):
        raise InputError(f"{name} is {value!r}; it must be the name of an obstacle, or an obstacle")
    return value


def _grasp(xyz: Any = None, **turned: Any) -> SE3:
    if xyz is None:
        raise InputError("does not state its xyz")
    if not turned:
        raise InputError("states no orientation; add rpy or quat_xyzw to the pick or to the defaults")
    return POSE_IN_REACH.make(xyz=xyz, **turned)


GRASP = Table(
    "grasp",
    "The pose of a grasp.",
    Key("xyz", vector(), "position of the tool's tip at the grasp, in `frame`", "m"),
    *ORIENTATION,
    rules=ONE_ORIENTATION,
    make=_grasp,
)


@struct("pick", eq=False, repr=False, first=("name", "pose", "frame", *LINE_KEYS))
class Pick(StraightLines):
    """One grasp, or a family of them, with its straight approach and retreat."""

    name: str = key("its name, unique in the file")
    pose: SE3 = key("``frame_from_tip``: the target pose of the tool's tip at the grasp", inline=GRASP)
    approach: float = _line("before the grasp")
    retreat: float = _line("after the grasp")
    retreat_direction: Direction = _direction("retreat", (0.0, 0.0, 1.0))
    approach_direction: Direction = _direction("approach", (0.0, 0.0, 1.0))
    approach_frame: str = _frame_of("approach", TIP)
    retreat_frame: str = _frame_of("retreat", ROOT)
    frame: str = key(
        "the frame of the pose: one of `frames`, an obstacle, or a link that does not move; by default the root link "
        "of the robot",
        default="",
    )
    spin: GraspSpin = key(
        f"equivalent rotations about the approach direction: one, a list, a range, or `free` for any ({STEPS} are "
        "tried)",
        "rad",
        default_factory=GraspSpin,
        kind=SPIN,
        shown=0,
    )
    tolerance: GraspTolerance = key(
        "how far the grasp may be moved if the nominal one fails", default_factory=GraspTolerance, shown=None
    )
    carried: Obstacle | str | None = key(
        "the grasped object: the name of an obstacle of the scene, or a shape, whose pose is tip_from_object. It moves "
        "with the tool after the grasp; without it, the motion after the grasp is judged with the empty tool. In a "
        "pattern, `{i}`, `{j}` and `{k}` are replaced by the indices",
        default=None,
        name="object",
        kind=any_of(TEXT, BODY, check=_carried),
    )
    support: str | Sequence[str] | None = key(
        "the obstacle, or a list of obstacles, that the object may touch until it is lifted; by default those within 1 "
        "mm below it. Stored as a tuple of names",
        default=None,
        kind=SUPPORT,
    )
    place: PlaceTarget | None = key(
        "where the object is put down; by default the pick ends with the retreat", default=None
    )
    upright: float | None = key(
        "while the object is carried, the axis of the tip that is vertical at the grasp stays within this angle of the "
        "vertical, such as `5 deg`; by default any orientation is allowed. The transfer is planned under this "
        "constraint",
        "rad",
        default=None,
        kind=UPRIGHT,
    )
    upright_axis: Direction | None = key(
        "another axis for `upright`, in the frame of the tip; it must point up within the angle", default=None
    )
    payload: Payload | None = key(
        "the mass of the object, in its own frame; the torque limits of the joints then apply",
        default=None,
        kind=OBJECT_PAYLOAD,
    )
    speed: Mapping[str, ToolSpeed] = key(
        "limits of the tcp by part of the motion; a number is the largest linear speed (m/s) of all parts",
        default_factory=dict,
        kind=any_of(number(above=0), STAGE_SPEEDS, check=_part_speeds),
        shown=None,
    )
    arm: str | None = key("in a file with `robots`, the one that executes the pick; by default any may", default=None)

    def __post_init__(self) -> None:
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

    def __repr__(self) -> str:
        x, y, z = self.pose.translation
        frame = f" in {self.frame}" if self.frame else ""
        what = (
            "" if self.object_name is None else f", object {self.object_name}{'' if self.place is None else ', placed'}"
        )
        lines = f"approach {self.approach * 1e3:g} mm, retreat {self.retreat * 1e3:g} mm"
        return f"Pick({self.name!r} at ({x:.4g}, {y:.4g}, {z:.4g}) m{frame}, {lines}{what})"

    def _repr_html_(self) -> str:
        poses: list[tuple[str, Pick | PlaceTarget]] = [("grasp", self)]
        poses += [] if self.place is None else [("place", self.place)]
        rows = [(kind, *xyz_rpy(each.pose), each.frame or "root", each.approach, each.retreat) for kind, each in poses]
        columns = ("pose", "x", "y", "z", "roll", "pitch", "yaw", "frame", "approach", "retreat")
        carries = "" if self.object_name is None else f", object {self.object_name}"
        return html_block(f"Pick {self.name}{carries} (m, rad)", html_table(columns, rows))

    @property
    def object_name(self) -> str | None:
        """The name of the grasped object; None without one."""
        return self.carried.name if isinstance(self.carried, Obstacle) else self.carried

    def approach_pose(self) -> SE3:
        """``frame_from_tip`` at the start of the approach."""
        return self.before(self.pose)

    def retreat_pose(self) -> SE3:
        """``frame_from_tip`` at the end of the retreat."""
        return self.after(self.pose)


_Target = TypeVar("_Target", Pick, PlaceTarget)


def _transformed(target: _Target, placement: SE3) -> _Target:
    directions = {
        f"{move}_direction": tuple((placement.rotation @ getattr(target, f"{move}_direction")).tolist())
        for move in MOVES
        if getattr(target, f"{move}_frame") == ROOT
    }
    pose = target.pose if target.frame else placement * target.pose
    return replace(target, pose=pose, **directions)  # type: ignore[arg-type]  # three numbers each


@struct("problem", more=True, written=True)
class PickProblem:
    """A row of the picks file that could not be read; the other rows are judged."""

    row: int = key("number of the row")
    name: str = key("name of the pick, if it is known")
    reason: str = key("why it could not be read", kind=TEXT)


@dataclass(frozen=True, eq=False)
class CellRobot:
    """One of the robots of a picks file for several robots.

    Parameters
    ----------
    world_from_base
        The pose of the base link of its arm in the cell.
    settings
        What the file states of the robot, its hand and its home, here or for all robots; without picks.
    """

    world_from_base: SE3
    settings: Picks

    def __post_init__(self) -> None:
        object.__setattr__(self, "world_from_base", frozen(rigid("world_from_base", self.world_from_base)))


MOST_TOOL = 5.0
"""Metres. A longer tool is stated in millimetres."""

TOOL_GREY = (0.30, 0.32, 0.36, 1.0)
"""The colour of tools and fingers without ``rgba``, so that they differ from obstacles in pictures."""

HELD = Table(
    "open_and_grip",
    "Two values of a finger joint of the robot.",
    required("open", NUMBER, "before the grasp and after the release", "rad or m"),
    required("grip", NUMBER, "from the grasp to the release", "rad or m"),
)


def _joint_values(when: str) -> Kind:
    """Values of joints by name; of those with two values, the one of the open or of the gripping hand."""
    stated = mapping_to(any_of(NUMBER, HELD), "joint names to values, or to open and grip")

    def parse(name: str, values: object, path: Path) -> dict[str, float]:
        return {
            joint: value[when] if isinstance(value, dict) else value
            for joint, value in stated.parse(name, values, path).items()
            if when == "open" or isinstance(value, dict)
        }

    return Kind(stated.schema, mapping_to(NUMBER).check, parse)


def _robot(_: str, stated: object, path: Path) -> str:
    """A catalogue name, or a path relative to the picks file."""
    name: str = TEXT.check("robot", stated)
    return str(path.parent / name) if Path(name).suffix or "/" in name else name


def _scene(name: str, stated: object, path: Path) -> Path:
    return path.parent / TEXT.check(name, stated)


def _margin(name: str, value: object) -> float:
    margin = require_number(name, value, "m", minimum=0)
    warn_of_millimetres(name, [margin], most=MOST_MARGIN)
    return margin


def _argument(name: str, value: Any) -> str:
    if isinstance(value, (dict, list)) or value is None:
        raise InputError(f"argument {name!r} is {value!r}; it must be a number or a text")
    return str(value).lower() if isinstance(value, bool) else str(value)


FOLDER = file_of("folder")


def _folders(_: str, value: Any) -> tuple[Path, ...]:
    return (value,) if isinstance(value, Path) else tuple(value)


@struct(
    eq=False,
    repr=False,
    rules=[
        Rule(
            ("cup",),
            lambda picks: (
                "state a cup and fingers; a part is held by one of them"
                if picks.cup is not None and (picks.fingers is not None or picks.grip)
                else ""
            ),
        )
    ],
    first=(
        "robot", "srdf", "package_dirs", "xacro_args", "limits", "tcp", "held", "scene", "margin", "home", "tip",
        "tool", "fingers", "cup", "gripper", "payload", "torque_limits", "conveyor", "grip_limits", "optimise",
        "straight", "robots", "frames",
    ),
)  # fmt: skip
class Picks:
    """A list of picks and their shared settings."""

    picks: Accepting[tuple[Pick, ...], Iterable[Pick]] = key("the picks in order; their names are unique", hidden=True)
    problems: tuple[PickProblem, ...] = key("rows of the file that could not be read", default=(), hidden=True)
    tip: SE3 = key(
        "tcp_from_tip: the frame that is moved to the poses of picks",
        default_factory=SE3.Identity,
        kind=Kind(POSE, TRANSFORM.check, pose_in_reach(MOST_TOOL).parse),
    )
    tool: Accepting[tuple[Obstacle, ...], Iterable[Obstacle]] = key(
        "bodies that move with the tcp, grey without `rgba`; poses are tcp_from_body", default=(), kind=bodies()
    )
    fingers: GripperFingers | None = key(
        "two moving fingers that are not part of the robot, open before the grasp and closed on the object after it",
        default=None,
    )
    cup: SuctionCup | None = key(
        "a suction cup at the tip, instead of fingers; its body is one of `tool`", default=None
    )
    conveyor: Conveyor | None = key("a belt that moves objects of picks", default=None)
    gripper: tuple[str, ...] = key(
        "more links of the robot that may touch the object during and after the approach, as `tool` and `fingers` may",
        default=(),
        kind=list_of(ANY_TEXT),
    )
    held: Mapping[str, float] = key(
        "values of joints outside the arm, by name; two values for finger joints of the robot, whose links may touch "
        "the object",
        "rad or m",
        default_factory=dict,
        kind=_joint_values("open"),
    )
    grip: Mapping[str, float] = key(
        "the values of those joints that differ while an object is held, from the grasp to the release",
        "rad or m",
        default_factory=dict,
        name="held",
        kind=_joint_values("grip"),
    )
    grip_limits: GripLimits = key("the criteria for holding an object", default_factory=GripLimits)
    optimise: int | None = key(
        "number of evaluations to shorten each transit and each transfer; 0 to follow the planned paths. A budget that "
        "a caller states overrides it",
        default=None,
        minimum=0,
        shown=PickBudget().motion,
    )
    straight: float = key(
        "share of each approach and retreat, next to the part, that is a straight line; the arm may leave out the rest "
        "to pass without a stop, where a certified motion does. All of it is straight where `speed` limits the stage",
        default=0.5,
        above=0,
        maximum=1,
    )
    frames: Mapping[str, NamedFrame] = key("named frames for the poses of picks and places", default_factory=dict)
    margin: float = key(
        "smallest allowed distance between any two bodies",
        "m",
        default=0.0,
        kind=simple(number(minimum=0).schema, _margin, parsed),
    )
    payload: Accepting[tuple[Payload, ...], Payload | Iterable[Payload]] = key(
        "the mass of the tool, or of several bodies; the torque limits of the joints then apply",
        default=(),
        kind=any_of(table_of(Payload), list_of(table_of(Payload)), check=lambda _, value: checked_payloads(value)),
        shown=None,
    )
    torque_limits: bool = key(
        "whether the torque limits of the joints (effort in the URDF, or in `limits`) apply without a payload too",
        default=False,
    )
    robot: str | None = key(
        "a name of the catalogue, or a robot file (URDF, xacro, MJCF, DH table)",
        default=None,
        kind=Kind(TEXT.schema, TEXT.check, _robot),
    )
    tcp: str | None = key("the tcp frame of the arm; by default that of the robot", default=None)
    scene: Path | None = key(
        "a [scene file](scene.md); by default an empty scene",
        default=None,
        kind=Kind(TEXT.schema, lambda _, value: Path(value), _scene),
    )
    home: Mapping[str, float] = key(
        "joint values, by name, where motions start; by default the robot's own",
        "rad or m",
        default_factory=dict,
        kind=mapping_to(NUMBER, "joint names to values"),
        shown=None,
    )
    srdf: Path | None = key("an SRDF file of the robot", default=None, kind=file_of())
    package_dirs: tuple[Path, ...] = key(
        "a folder, or a list of folders, that contain ROS packages",
        default=(),
        kind=any_of(FOLDER, list_of(FOLDER), check=_folders),
    )
    xacro_args: Mapping[str, str] = key(
        "values of the arguments of a xacro file",
        default_factory=dict,
        kind=mapping_to(simple({"type": ["string", "number", "boolean"]}, _argument), "argument names to values"),
    )
    limits: Path | None = key("a file of [joint limits](limits.md)", default=None, kind=file_of())
    source: Path | None = key("the file they were read from", default=None, hidden=True)
    places: Mapping[str, str] = key(
        "positions in that file of the keys that name something of the robot, for messages",
        default_factory=dict,
        hidden=True,
    )
    robots: Mapping[str, CellRobot] = key(
        "the robots of a cell by name, if the file is for several; poses are then in the frame ``world``",
        default_factory=dict,
        hidden=True,
    )

    def __repr__(self) -> str:
        return outline(f"Picks({self._headline})", map(repr, self.picks), total=len(self.picks))

    def _repr_html_(self) -> str:
        rows = ([each.name, *each.pose.translation, each.frame, each.approach, each.retreat] for each in self.picks)
        columns = ("pick", "x", "y", "z", "frame", "approach", "retreat")
        problems = html_list(f"unreadable: {each.name}: {each.reason}" for each in self.problems)
        return html_block(f"{self._headline} (m)", html_table(columns, rows, total=len(self.picks)), problems)

    @property
    def _headline(self) -> str:
        count = len(self.picks)
        unreadable = f", {len(self.problems)} unreadable" if self.problems else ""
        source = "" if self.source is None else f", from {self.source.name}"
        return f"{count} pick{'' if count == 1 else 's'}{unreadable}{source}"

    def __post_init__(self) -> None:
        for name in ("picks", "problems"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        names = Counter(pick.name for pick in self.picks)
        doubled = sorted(name for name, count in names.items() if count > 1)
        if doubled:
            raise InputError(f"the names of picks must be unique; repeated: {', '.join(doubled)}")

    def __len__(self) -> int:
        return len(self.picks)

    def __iter__(self) -> Iterator[Pick]:
        return iter(self.picks)

    @property
    def open_tool(self) -> tuple[Obstacle, ...]:
        """The bodies attached to the tcp before the grasp: the tool and the open fingers."""
        return self.tool if self.fingers is None else (*self.tool, *self.fingers.apart())

    def refuse_conveyor(self, what: str) -> None:
        """Raise InputError if the picks have a conveyor, which ``what`` does not support."""
        if self.conveyor is not None:
            raise InputError(f"{what} does not support picks from a conveyor; use validate_picks or pinproof pick")

    def load_arm(self) -> Arm:
        """Load the arm that the file states, with its limits and held joints.

        Raises
        ------
        InputError
            If the file states no robot; also for the reasons of :func:`pinproof.load_robot` and
            :meth:`pinproof.Robot.arm`.
        PicksError
            If a name in the file does not exist: a robot, a xacro argument, a tcp or a held joint.
        """
        if self.robots:
            raise InputError(
                f"{self.source or 'picks'}: is for several robots ({', '.join(self.robots)}), not for a single arm; "
                "use pinproof cell allocate"
            )
        if self.robot is None:
            raise InputError(f"{self.source or 'picks'}: states no robot; add 'robot: ur5' or the path of a robot file")
        try:
            robot = load_robot(
                self.robot, srdf=self.srdf, package_dirs=self.package_dirs, xacro_args=self.xacro_args or None
            )
            limits = None if self.limits is None else JointLimits.load(self.limits)
            return robot.arm(self.tcp, limits=limits, held=self.held)
        except UnknownNameError as error:
            keys = {"robot": "robot", "frame": "tcp"}
            key = keys.get(error.kind) or f"{'held' if error.kind == 'joint' else 'xacro_args'}.{error.name}"
            if self.source is None or key not in self.places:
                raise
            raise PicksError(self.source, str(error), self.places[key]) from error

    def load_scene(self) -> Scene:
        """Load the scene that the file states; an empty one if it states none."""
        return Scene() if self.scene is None else Scene.load(self.scene)

    def load_cell(self) -> JointGroup:
        """Load the robots that the file states, and assemble them at their poses.

        Raises
        ------
        InputError
            If the file is for one robot; also for the reasons of :func:`pinproof.assemble` and :meth:`load_arm`.
        PicksError
            If a name in the file does not exist.
        """
        if not self.robots:
            raise InputError(
                f"{self.source or 'picks'}: is for one robot; a cell needs the key robots, such as "
                "'robots: {left: {base: {xyz: [-0.5, 0, 0]}}, right: {base: {xyz: [0.5, 0, 0]}}}'"
            )
        return assemble({name: (each.settings.load_arm(), each.world_from_base) for name, each in self.robots.items()})

    def transformed(self, root_from_picks: SE3 | npt.ArrayLike) -> Picks:
        """Return the picks, stated in the frame of a cell, in the frame of a robot that is placed in it.

        Poses that name no frame, named frames without a parent, and directions in the root frame are transformed.
        Poses in the frame of an obstacle follow their obstacle (:meth:`pinproof.Scene.transformed`); those in the frame
        of a robot link are unchanged.

        Parameters
        ----------
        root_from_picks
            The pose of the cell in the root frame of the robot, SE3 or (4, 4).
        """
        placement = rigid("root_from_picks", root_from_picks)
        frames = {
            name: frame if frame.frame else NamedFrame(placement * frame.pose) for name, frame in self.frames.items()
        }
        belt = self.conveyor
        if belt is not None:
            belt = replace(belt, direction=tuple((placement.rotation @ belt.direction).tolist()))
        picks = tuple(pick.transformed(placement) for pick in self.picks)
        return replace(self, picks=picks, frames=frames, conveyor=belt)

    def tcp_target(self, root_from_tip: SE3, root_from_base: SE3) -> SE3:
        """``base_from_tcp`` that places the tip at a pose in the root frame."""
        return root_from_base.actInv(root_from_tip * self.tip.inverse())

    def home_configuration(self, joint_names: Iterable[str], default: npt.NDArray[np.float64]) -> list[float]:
        """The home configuration of the file, or ``default`` (n,) if it states none.

        Raises
        ------
        InputError
            If the file states only some of the joints, or a joint that the arm does not have.
        """
        names = list(joint_names)
        if not self.home:
            return [float(value) for value in default]
        missing, foreign = [n for n in names if n not in self.home], [n for n in self.home if n not in names]
        if missing or foreign:
            what = f"lacks {', '.join(missing)}" if missing else f"names {', '.join(foreign)}"
            raise InputError(f"the home of the picks {what}; the arm's joints are {', '.join(names)}")
        return [float(self.home[name]) for name in names]
