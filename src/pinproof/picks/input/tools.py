"""The hand that holds parts: its keys, which a picks file, its tools and the robots of a cell share; and tool files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pinproof.collision import Obstacle
from pinproof.common import structs as st
from pinproof.common.files import read_yaml
from pinproof.common.results import ByValue
from pinproof.errors import InputError, PicksError, UnknownNameError
from pinproof.model import Arm, JointLimits, Payload, checked_payloads, load_robot
from pinproof.picks.input.settings import GripLimits, GripperFingers, SuctionCup, bodies
from pinproof.spatial import SE3
from pinproof.units import MOST_REACH, refuse_millimetres

MOST_TOOL = 5.0
"""Metres. A longer tool is stated in millimetres."""


def pose_in_reach(most: float = MOST_REACH) -> st.Table:
    """The keys of a pose whose position (m) is not clearly in millimetres: no number is above ``most``."""

    def make(**stated: Any) -> SE3:
        placed = st.pose_of(**stated)
        refuse_millimetres("xyz", placed.translation.tolist(), most=most)
        return placed

    return st.Table(st.POSE.title, st.POSE.text, *st.POSE.keys, rules=st.POSE.rules, make=make)


POSE_IN_REACH = pose_in_reach()


# -- the hand ---------------------------------------------------------------------------------------------------------

HELD = st.Table(
    "open_and_grip",
    "Two values of a finger joint of the robot.",
    st.required("open", st.NUMBER, "before the grasp and after the release", "rad or m"),
    st.Key(
        "grip",
        st.NUMBER,
        "from the grasp to the release; by default the fingers close until two of them touch the object, towards the "
        "limit of the joint that is farther from `open`",
        "rad or m",
    ),
)


def _joint_values(when: str) -> st.Kind:
    """Values of joints by name; of those with two values, the one of the open or of the gripping hand."""
    stated = st.mapping_to(st.any_of(st.NUMBER, HELD), "joint names to values, or to open and grip")

    def parse(name: str, values: object, path: Path) -> dict[str, float | None]:
        return {
            joint: value.get(when) if isinstance(value, dict) else value
            for joint, value in stated.parse(name, values, path).items()
            if when == "open" or isinstance(value, dict)
        }

    return st.Kind(stated.schema, st.mapping_to(st.NUMBER if when == "open" else st.optional(st.NUMBER)).check, parse)


def _held() -> Any:
    return st.key(
        "values of joints outside the arm, by name; two values for finger joints of the robot, whose links may touch "
        "the object",
        "rad or m",
        default_factory=dict,
        kind=_joint_values("open"),
    )


def _grip() -> Any:
    return st.key(
        "the values of those joints that differ while an object is held, from the grasp to the release; None where the "
        "fingers close until they touch it",
        "rad or m",
        default_factory=dict,
        name="held",
        kind=_joint_values("grip"),
    )


ONE_HOLDER = st.Rule(
    ("cup",),
    lambda hand: (
        "state a cup and fingers; a part is held by one of them"
        if hand.cup is not None and (hand.fingers is not None or hand.grip)
        else ""
    ),
)


@st.struct("hand", kw_only=True, eq=False)
class Hand:
    """The hand that holds parts."""

    tip: SE3 = st.key(
        "tcp_from_tip: the frame that is moved to the poses of picks",
        default_factory=SE3.Identity,
        kind=st.Kind(st.POSE, st.TRANSFORM.check, pose_in_reach(MOST_TOOL).parse),
    )
    tool: Sequence[Obstacle] = st.key(
        "bodies that move with the tcp, grey without `rgba`; poses are tcp_from_body", default=(), kind=bodies()
    )
    fingers: GripperFingers | None = st.key(
        "two moving fingers that are not part of the robot, open before the grasp and closed on the object after it",
        default=None,
    )
    cup: SuctionCup | None = st.key(
        "a suction cup at the tip, instead of fingers; its body is one of `tool`", default=None
    )
    gripper: tuple[str, ...] = st.key(
        "more links of the robot that may touch the object during and after the approach, as `tool` and `fingers` may",
        default=(),
        kind=st.list_of(st.ANY_TEXT),
    )
    held: Mapping[str, float] = _held()
    grip: Mapping[str, float | None] = _grip()
    payload: Sequence[Payload] = st.key(
        "the mass of the tool, or of several bodies; the torque limits of the joints then apply",
        default=(),
        kind=st.any_of(
            st.table_of(Payload), st.list_of(st.table_of(Payload)), check=lambda _, value: checked_payloads(value)
        ),
        shown=None,
    )
    grip_limits: GripLimits = st.key("the criteria for holding an object", default_factory=GripLimits)

    @property
    def open_tool(self) -> tuple[Obstacle, ...]:
        """The bodies attached to the tcp before the grasp: the tool and the open fingers."""
        return (*self.tool, *(() if self.fingers is None else self.fingers.apart()))


HAND = st.table_of(Hand)


# -- values of the hand for a part, a grasp or a pick -----------------------------------------------------------------


def _some_of(title: str, of: type, *names: str) -> Any:
    """The key of some of the values of a struct of the hand, as a mapping that replaces those of the tool."""
    table = st.table_of(of)
    keys = (st.Key(own.name, own.kind, own.text, own.unit) for own in table.keys if not names or own.name in names)
    kind = st.Table(title, f"{table.text} Keys that are not stated are those of the tool.", *keys)

    def check(name: str, value: Mapping[str, Any]) -> dict[str, Any]:
        for own in value:
            if own not in kind.names:
                raise UnknownNameError("key", own, kind.names, name)
        return {own.name: own.kind.check(own.name, value[own.name]) for own in kind.keys if own.name in value}

    return st.key(
        f"keys of `{title.split('_of_')[0]}` that replace those of the tool",
        default_factory=dict,
        kind=st.Kind(kind, check, kind.parse),
    )


Own = TypeVar("Own", bound="HandValues")


@st.struct("hand_values", kw_only=True, eq=False)
class HandValues:
    """Values of the hand that a part type, a pick or a grasp states in place of those of the tool."""

    held: Mapping[str, float] = _held()
    grip: Mapping[str, float | None] = _grip()
    fingers: Mapping[str, float] = _some_of("fingers_of_part", GripperFingers, "opening", "grip")
    cup: Mapping[str, float] = _some_of("cup_of_part", SuctionCup)
    grip_limits: Mapping[str, float] = _some_of("grip_limits_of_part", GripLimits)

    VALUES: ClassVar[tuple[str, ...]] = ("held", "grip", "fingers", "cup", "grip_limits")

    def that_fit(self, *hands: Hand) -> HandValues:
        """The values of fingers, cup and gripping joints that one of the hands has; several may hold the same part."""
        grips = {joint for hand in hands for joint in hand.grip}
        joints = {own: {j: v for j, v in getattr(self, own).items() if j in grips} for own in ("held", "grip")}
        there = {own: any(getattr(hand, own) is not None for hand in hands) for own in ("fingers", "cup")}
        shapes = {own: getattr(self, own) if has else {} for own, has in there.items()}
        return HandValues(**joints, **shapes, grip_limits=self.grip_limits)

    def refuse_unused(self, hands: Sequence[Hand], steps: tuple[str, ...] = ()) -> None:
        """Raise Misread, at the key below ``steps``, if a value is for fingers, a cup or a joint that no hand has."""
        fitting = HandValues.that_fit(self, *hands)
        for joint in self.held:
            if joint not in fitting.held:
                valid = dict.fromkeys(joint for hand in hands for joint in hand.grip)
                unknown = UnknownNameError("joint", joint, valid or ("none",), "the gripping joints of the hands")
                raise st.Misread(str(unknown), (*steps, ".held"))
        for own in ("fingers", "cup"):
            if getattr(self, own) and not getattr(fitting, own):
                has = [f"`{each}`" for each in ("fingers", "cup") if any(getattr(hand, each) for hand in hands)]
                has += ["`held`"] * any(hand.grip for hand in hands) + ["`grip_limits`"]
                reason = f"states values of `{own}`, which no tool that may hold the part has; valid: {', '.join(has)}"
                raise st.Misread(reason, (*steps, f".{own}"))

    def hand_values(self, *more: HandValues) -> dict[str, Mapping[str, Any]]:
        """The values by field, replaced by those of ``more``, of which the last one has precedence."""
        return {
            name: {own: value for each in (self, *more) for own, value in getattr(each, name).items()}
            for name in self.VALUES
        }


HandLike = TypeVar("HandLike", bound=Hand)


def with_values(hand: HandLike, values: HandValues, name: str) -> HandLike:
    """The hand with the values of a resolved pick; ``name`` is that of the hand in messages."""
    changes: dict[str, Any] = {own: {**getattr(hand, own), **getattr(values, own)} for own in ("held", "grip")}
    for own in ("fingers", "cup", "grip_limits"):
        if stated := getattr(values, own):
            if (before := getattr(hand, own)) is None:
                raise InputError(f"states {own} ({', '.join(stated)}), but {name} has no {own}")
            changes[own] = replace(before, **stated)
    return replace(hand, **changes)


# -- tools ------------------------------------------------------------------------------------------------------------


def _robot(_: str, stated: object, path: Path) -> str:
    """A catalogue name, or a path relative to the picks file."""
    name: str = st.TEXT.check("robot", stated)
    return str(path.parent / name) if Path(name).suffix or "/" in name else name


def _argument(name: str, value: Any) -> str:
    if isinstance(value, (dict, list)) or value is None:
        raise InputError(f"argument {name!r} is {value!r}; it must be a number or a text")
    return str(value).lower() if isinstance(value, bool) else str(value)


FOLDER = st.file_of("folder")


@st.struct("robot_and_hand", kw_only=True, eq=False)
class RobotAndHand(Hand):
    """The robot that a file states, with its tcp and limits, and the hand."""

    robot: str | None = st.key(
        "a name of the catalogue, or a robot file (URDF, xacro, MJCF, DH table)",
        default=None,
        kind=st.Kind(st.TEXT.schema, st.TEXT.check, _robot),
    )
    srdf: Path | None = st.key("an SRDF file of the robot", default=None, kind=st.file_of())
    package_dirs: tuple[Path, ...] = st.key(
        "a folder, or a list of folders, that contain ROS packages",
        default=(),
        kind=st.any_of(
            FOLDER, st.list_of(FOLDER), check=lambda _, value: (value,) if isinstance(value, Path) else tuple(value)
        ),
    )
    xacro_args: Mapping[str, str] = st.key(
        "values of the arguments of a xacro file",
        default_factory=dict,
        kind=st.mapping_to(st.simple({"type": ["string", "number", "boolean"]}, _argument), "argument names to values"),
    )
    calibration: Path | None = st.key(
        "a file with the measured kinematics of this one arm: [calibrated arms](../calibration.md)",
        default=None,
        kind=st.file_of(),
    )
    visual_bodies: bool = st.key(
        "whether links with visual but no collision geometry are checked with their visual geometry", default=False
    )
    limits: Path | None = st.key("a file of [joint limits](limits.md)", default=None, kind=st.file_of())
    tcp: str | None = st.key("the tcp frame of the arm; by default that of the robot", default=None)
    source: Path | None = st.key("the file they were read from", default=None, hidden=True)
    places: Mapping[str, str] = st.key(
        "positions in that file of the keys that name something of the robot, for messages",
        default_factory=dict,
        hidden=True,
    )

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
        if self.robot is None:
            raise InputError(f"{self.source or 'picks'}: states no robot; add 'robot: ur5' or the path of a robot file")
        try:
            # A name that does not exist is reported at its key
            robot = load_robot(
                self.robot,
                srdf=self.srdf,
                package_dirs=self.package_dirs,
                xacro_args=self.xacro_args or None,
                calibration=self.calibration,
                visual_bodies=self.visual_bodies,
            )
            limits = None if self.limits is None else JointLimits.load(self.limits)
            return robot.arm(self.tcp, limits=limits, held=self.held)
        except UnknownNameError as error:
            keys = {"robot": "robot", "frame": "tcp"}
            own = keys.get(error.kind) or f"{'held' if error.kind == 'joint' else 'xacro_args'}.{error.name}"
            if self.source is None or own not in self.places:
                raise
            raise PicksError(self.source, str(error), self.places[own]) from error


@st.struct("tool", kw_only=True, eq=False, rules=[ONE_HOLDER])
class Tool(RobotAndHand, ByValue):
    """A tool: the hand, and the robot whose links are its fingers.

    Notes
    -----
    Without ``robot``, the tool consists of the bodies that it states. In a picks file with ``tools``, the robot is
    that of the file.
    """

    name: str = st.key("its name in messages", default="tool", hidden=True)

    @classmethod
    def load(cls, path: str | Path) -> Tool:
        """Read a tool file (YAML), which docs/formats/tool.md describes.

        Raises
        ------
        PicksError
            If the file cannot be read or its content is invalid; the message names file, line and key.
        """
        path, table = Path(path), st.table_of(cls)
        content = read_yaml(path, table.names, PicksError)
        with st.errors_of(path, PicksError):
            values = table.values("the file", content, path)
            made: Tool = table.made(content, {**values, "source": path, "name": path.stem})
            return made


_OWN = st.Table(
    "tool_of_picks", "A tool. Links that are its fingers are those of the robot of the file.", *HAND.keys, make=Tool
)


def _tool(name: str, stated: Any, path: Path) -> Tool:
    """A tool of a picks file, or that of the tool file which it names."""
    if isinstance(stated, str):
        return replace(Tool.load(path.parent / stated), name=name)
    made: Tool = _OWN.made(stated, {**_OWN.values(name, stated, path), "name": name})
    return made


TOOL = st.Kind(st.any_of(_OWN, st.file_of()).schema, lambda _, tool: tool, _tool)
"""A tool of a picks file."""
