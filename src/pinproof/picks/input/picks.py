"""The settings that picks share: named frames, grippers, the robot or the robots; and lists of picks with them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import Obstacle, Scene
from pinproof.common.files import LinedMapping
from pinproof.common.results import Rows, Shown, View
from pinproof.common.structs import (
    ANY_TEXT,
    NUMBER,
    POSE,
    TEXT,
    TRANSFORM,
    Accepting,
    Kind,
    Rule,
    Table,
    any_of,
    described,
    file_of,
    key,
    list_of,
    mapping_to,
    number,
    parsed,
    position,
    required,
    simple,
    step,
    struct,
    table_of,
)
from pinproof.common.validation import require_number
from pinproof.description import moved_by
from pinproof.errors import InputError, PicksError, UnknownNameError
from pinproof.model import Arm, JointGroup, JointLimits, Payload, assemble, checked_payloads, load_robot
from pinproof.picks.input.pick import POSE_IN_REACH, Pick, pose_in_reach
from pinproof.picks.input.settings import Conveyor, GripLimits, GripperFingers, PickBudget, SuctionCup, bodies
from pinproof.spatial import SE3, frozen, rigid
from pinproof.units import MOST_MARGIN, warn_of_millimetres


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


@struct("problem", more=True, written=True)
class PickProblem:
    """A row of the picks file that could not be read; the other rows are judged."""

    row: int = key("number of the row")
    name: str = key("name of the pick, if it is known")
    reason: str = key("why it could not be read", kind=TEXT)


@described(eq=False)
class CellRobot:
    """One of the robots of a picks file for several robots."""

    world_from_base: SE3 = key("the pose of the base link of its arm in the cell")
    settings: Picks = key(
        "what the file states of the robot, its hand and its home, here or for all robots; without picks"
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "world_from_base", frozen(rigid("world_from_base", self.world_from_base)))


MOST_TOOL = 5.0
"""Metres. A longer tool is stated in millimetres."""


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


def _margin(name: str, value: object) -> float:
    margin = require_number(name, value, "m", minimum=0)
    warn_of_millimetres(name, [margin], most=MOST_MARGIN)
    return margin


def _argument(name: str, value: Any) -> str:
    if isinstance(value, (dict, list)) or value is None:
        raise InputError(f"argument {name!r} is {value!r}; it must be a number or a text")
    return str(value).lower() if isinstance(value, bool) else str(value)


FOLDER = file_of("folder")


def _checks(name: str, value: object) -> tuple[Callable[..., str | None], ...]:
    """The checks as a tuple; InputError if one cannot be called, or has no name by which reports refer to it."""
    checks = tuple(value) if isinstance(value, Iterable) else (value,)
    for check in checks:
        if not callable(check) or not hasattr(check, "__qualname__"):
            raise InputError(
                f"{name} must be functions check(task, candidate) that return a reason, or None if the candidate "
                f"passes; {check!r:.80} is no function"
            )
    return checks


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
class Picks(Shown):
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
        kind=Kind(
            TEXT.schema, lambda _, value: Path(value), lambda name, file, path: path.parent / TEXT.check(name, file)
        ),
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
        kind=any_of(
            FOLDER, list_of(FOLDER), check=lambda _, value: (value,) if isinstance(value, Path) else tuple(value)
        ),
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
    checks: Accepting[tuple[Callable[..., str | None], ...], Iterable[Callable[..., str | None]]] = key(
        "checks of configurations at the grasp, each a :class:`~pinproof.picks.PickCheck`",
        default=(),
        kind=simple({}, _checks),
        hidden=True,
    )
    robots: Mapping[str, CellRobot] = key(
        "the robots of a cell by name, if the file is for several; poses are then in the frame ``world``",
        default_factory=dict,
        hidden=True,
    )

    def _view(self) -> View:
        rows = ([each.name, *each.pose.translation, each.frame, each.approach, each.retreat] for each in self.picks)
        table = Rows(("pick", "x", "y", "z", "frame", "approach", "retreat"), rows, len(self.picks))
        problems = (f"unreadable: {each.name}: {each.reason}" for each in self.problems)
        title = f"{self._headline} (m)"
        return View(self._headline, [table, problems], map(repr, self.picks), len(self.picks), title)

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
            # A name that does not exist is reported at its key
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


SETTINGS = table_of(Picks)

OF_ALL = ("scene", "margin", "torque_limits", "conveyor", "grip_limits", "optimise", "straight", "frames")
"""The settings that all robots of a file share; each robot may state the others."""

CELL_ROBOT = Table(
    "cell_robot",
    "One of several robots. A key that it does not state is that of the file.",
    required("base", POSE_IN_REACH, "the pose of the base link of its arm in the frame `world`"),
    *(own for own in SETTINGS.keys if own.name not in OF_ALL),
)


def read_settings(content: LinedMapping, path: Path) -> Picks:
    """The settings that a picks file states, with its robots; there are no picks in them."""
    # The settings of the file, which apply to all robots
    settings = SETTINGS.values("the file", content, path, part=True)
    shared: Picks = SETTINGS.made(content, {"picks": (), **settings, "source": path, "places": _places(content)})

    def parse(name: str, own: Any, path: Path) -> CellRobot:
        """One of several robots; settings that it does not state are those of the file."""
        values = CELL_ROBOT.values(name, own, path)
        base = values.pop("base")
        return CellRobot(base, replace(shared, **values, places={**shared.places, **_places(own)}))

    # Each robot with its own settings
    robots = mapping_to(Kind({}, lambda _, robot: robot, parse), "names to robots")
    where = position(content, "robots")
    shared = replace(shared, robots=step(".robots", where, robots.parse, "robots", content.get("robots", {}), path))
    for each in [robot.settings for robot in shared.robots.values()] or [shared]:
        if each.xacro_args and not (each.robot or "").endswith(".xacro"):
            reason = "is valid only if the robot is a file that ends in .xacro"
            raise PicksError(path, reason, each.places["xacro_args"])
    return shared


def _places(content: LinedMapping) -> dict[str, str]:
    """The positions of what can be checked only together with the robot."""
    places = {name: content.place(name) for name in ("robot", "tcp", "xacro_args") if name in content}
    for name in ("xacro_args", "held"):
        inner = content.get(name)
        if isinstance(inner, LinedMapping):
            places.update({f"{name}.{own}": inner.place(own, f"key {name},") for own in inner})
    return places
