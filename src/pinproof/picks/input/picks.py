"""The settings that picks share: named frames, grippers, the robot or the robots; and lists of picks with them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from pinproof.collision import MARGIN, PAIR_MARGINS, PairMargin, Scene
from pinproof.common import structs as st
from pinproof.common.files import LinedMapping
from pinproof.common.results import Rows, Shown, View
from pinproof.common.validation import refuse_repeated, require_number
from pinproof.description import moved_by
from pinproof.errors import InputError, PicksError, UnknownNameError
from pinproof.model import Arm, JointGroup, assemble
from pinproof.picks.input.parts import PART_TYPE, PartType, grasps_of
from pinproof.picks.input.pick import ANGLE_TEXT, Pick, angle_in
from pinproof.picks.input.settings import Conveyor, GripLimits, PickBudget, ProgramSettings
from pinproof.picks.input.tools import ONE_HOLDER, POSE_IN_REACH, TOOL, Hand, RobotAndHand, Tool, with_values
from pinproof.spatial import SE3, frozen, rigid
from pinproof.units import parse_angle, refuse_degree_limit


def _winding(name: str, stated: object) -> float:
    try:
        angle = parse_angle(stated) if isinstance(stated, str) else require_number(name, stated, "rad")
    except ValueError as error:
        raise InputError(f"{name}: {error}") from None
    refuse_degree_limit(name, angle)
    return require_number(name, angle, "rad", above=0)


WINDING = st.simple(st.any_of(st.number(above=0), ANGLE_TEXT).schema, _winding, angle_in)


@st.struct("frame", eq=False)
class NamedFrame:
    """A named frame in which picks can be stated: parent_from_frame."""

    pose: SE3 = st.key("its pose in the parent", inline=POSE_IN_REACH)
    frame: str = st.key(
        "the parent: another frame, an obstacle, or a link that does not move", default="", kind=st.ANY_TEXT, shown=""
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


@st.struct("problem", written=True)
class PickProblem:
    """A row of the picks file that could not be read; the other rows are judged."""

    row: int = st.key("number of the row")
    name: str = st.key("name of the pick, if it is known")
    reason: str = st.key("why it could not be read", kind=st.TEXT)


@st.described(eq=False)
class CellRobot:
    """One of the robots of a picks file for several robots."""

    world_from_base: SE3 = st.key("the pose of the base link of its arm in the cell")
    settings: Picks = st.key(
        "what the file states of the robot, its hand and its home, here or for all robots; without picks"
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "world_from_base", frozen(rigid("world_from_base", self.world_from_base)))


MOUNTED = "mounted"
"""The change of tools that are all mounted at the same time."""


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


@st.struct(
    eq=False,
    repr=False,
    rules=[ONE_HOLDER],
    first=(
        "robot", "srdf", "package_dirs", "xacro_args", "calibration", "visual_bodies", "limits", "tcp", "held", "scene",
        "margin", "margins", "home", "windings", "tip", "tool", "fingers", "cup", "gripper", "payload", "grip_limits",
        "tools", "tool_change", "parts", "torque_limits", "conveyor", "optimise", "straight", "program", "robots",
        "frames",
    ),
)  # fmt: skip
class Picks(RobotAndHand, Shown):
    """A list of picks and their shared settings."""

    picks: st.Accepting[tuple[Pick, ...], Iterable[Pick]] = st.key(
        "the picks in order; their names are unique", hidden=True
    )
    problems: tuple[PickProblem, ...] = st.key("rows of the file that could not be read", default=(), hidden=True)
    tools: Mapping[str, Tool] = st.key(
        "tools by name, or for each the name of a [tool file](tool.md). `tip`, `fingers`, `cup` and gripping joints "
        "are then those of the tool of a pick; `tool`, `gripper`, `held` and `payload` of the file are always mounted",
        default_factory=dict,
        kind=st.mapping_to(TOOL, "names to tools"),
    )
    tool_change: float | Literal["mounted"] | None = st.key(
        "time for a change of the tool, at the home configuration; `mounted` if all tools are mounted at the same "
        "time. Required for several tools",
        "s",
        default=None,
        kind=st.any_of(
            st.choice(MOUNTED),
            st.number("s", minimum=0),
            check=lambda name, value: value if value == MOUNTED else require_number(name, value, "s", minimum=0),
        ),
    )
    parts: Mapping[str, PartType] = st.key(
        "part types by name", default_factory=dict, kind=st.mapping_to(PART_TYPE, "names to part types")
    )
    conveyor: Conveyor | None = st.key("a belt that moves objects of picks", default=None)
    optimise: int | None = st.key(
        "number of evaluations to shorten each transit and each transfer; 0 to follow the planned paths. A budget that "
        "a caller states overrides it",
        default=None,
        minimum=0,
        shown=PickBudget().motion,
    )
    straight: float = st.key(
        "share of each approach and retreat, next to the part, that is a straight line; the arm may leave out the rest "
        "to pass without a stop, where a certified motion does. All of it is straight where `speed` limits the stage",
        default=0.5,
        above=0,
        maximum=1,
    )
    frames: Mapping[str, NamedFrame] = st.key("named frames for the poses of picks and places", default_factory=dict)
    margin: float = st.key("smallest allowed distance between any two bodies", "m", default=0.0, kind=MARGIN)
    margins: tuple[PairMargin, ...] = st.key(
        "margins of pairs of bodies, which replace `margin` and those of the same pair in the scene file. Two "
        "links of one gripper need no margin: they are checked for contact, unless the SRDF disables the pair",
        default=(),
        kind=PAIR_MARGINS,
    )
    torque_limits: bool = st.key(
        "whether the torque limits of the joints (effort in the URDF, or in `limits`) apply without a payload too",
        default=False,
    )
    scene: Path | None = st.key(
        "a [scene file](scene.md); by default an empty scene",
        default=None,
        kind=st.Kind(
            st.TEXT.schema,
            lambda _, value: Path(value),
            lambda name, file, path: path.parent / st.TEXT.check(name, file),
        ),
    )
    home: Mapping[str, float] = st.key(
        "joint values, by name, where motions start; by default the robot's own",
        "rad or m",
        default_factory=dict,
        kind=st.mapping_to(st.NUMBER, "joint names to values"),
        shown=None,
    )
    windings: Mapping[str, float] = st.key(
        "budgets of rotation of revolute joints, by name, such as `400 deg`: at every instant of a "
        "[sequence](sequence.md), a joint stays within its budget of its value at home. Single picks are not limited",
        "rad",
        default_factory=dict,
        kind=st.mapping_to(WINDING, "joint names to angles"),
    )
    program: ProgramSettings = st.key(
        "what programs of a robot controller state beside the moves", default=ProgramSettings(), shown=None
    )
    checks: st.Accepting[tuple[Callable[..., str | None], ...], Iterable[Callable[..., str | None]]] = st.key(
        "checks of configurations at the grasp, each a :class:`~pinproof.picks.PickCheck`",
        default=(),
        kind=st.simple({}, _checks),
        hidden=True,
    )
    robots: Mapping[str, CellRobot] = st.key(
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
        refuse_repeated("picks", (pick.name for pick in self.picks))

    def __len__(self) -> int:
        return len(self.picks)

    def __iter__(self) -> Iterator[Pick]:
        return iter(self.picks)

    def grasps_of(self, pick: Pick) -> tuple[Pick, ...]:
        """The picks with one grasp and one tool each that a pick describes, in the order in which they are tried.

        A pick without a part, or with a pose of its own, describes one grasp.

        Raises
        ------
        InputError
            If the part, the grasp or the tool does not exist, or it is not clear which tool is used.
        """
        return tuple(grasps_of(pick, self.parts, self.tools, self))

    def with_tool(self, name: str | None) -> Picks:
        """The settings with the hand of one of the tools, beside what is always mounted."""
        if name is None:
            return self
        own, others = self.tools[name], [tool for other, tool in self.tools.items() if other != name]
        mounted = others if self.tool_change == MOUNTED else []
        held = {joint: value for tool in (*mounted, own) for joint, value in tool.held.items()}
        return replace(
            self,
            tip=own.tip,
            tool=(*self.tool, *own.tool, *(body for tool in mounted for body in tool.open_tool)),
            fingers=own.fingers,
            cup=own.cup,
            gripper=(*self.gripper, *own.gripper),
            held={**self.held, **held},
            grip=own.grip,
            payload=(*self.payload, *own.payload, *(each for tool in mounted for each in tool.payload)),
            grip_limits=own.grip_limits,
        )

    @property
    def always_mounted(self) -> Picks:
        """The settings with the hand that is mounted for all picks: that of the only tool, or of all mounted ones."""
        one = len(self.tools) == 1 or self.tool_change == MOUNTED
        return self.with_tool(next(iter(self.tools))) if self.tools and one else self

    def for_pick(self, pick: Pick) -> Picks:
        """The settings with the hand of a pick with one grasp, see :meth:`grasps_of`."""
        if self.hand_key(pick) is None:
            return self
        name = "the hand of the picks" if pick.tool is None else f"tool {pick.tool!r}"
        return with_values(self.with_tool(pick.tool), pick, name)

    @staticmethod
    def hand_key(pick: Pick) -> Hashable:
        """What the hand of a pick with one grasp depends on; None for the hand of the file."""
        values = [getattr(pick, name) for name in pick.VALUES]
        if pick.tool is None and not any(values):
            return None
        return pick.tool, *(tuple(sorted(stated.items())) for stated in values)

    def check_tools(self) -> None:
        """Check that the tools fit each other and the settings of the file.

        Raises
        ------
        InputError
            Its message names the key.
        """
        count, stated = len(self.tools), [own for own in ("fingers", "cup", "grip") if getattr(self, own)]
        stated += ["grip_limits"] * (self.grip_limits != GripLimits())
        if count and (stated or not self.tip.isIdentity()):
            own = {"grip": "held"}.get(stated[0], stated[0]) if stated else "tip"
            raise st.Misread(f"is stated beside tools; state it in one of {', '.join(self.tools)}", (f".{own}",))
        if count > 1 and self.tool_change is None:
            raise st.Misread(
                f"{count} tools are stated but no tool_change; state the seconds of a change, or tool_change: mounted "
                "if all are mounted at the same time",
                (".tools",),
            )
        mounted = self.tools.values() if self.tool_change == MOUNTED else ()
        names = Counter(body.name for body in (*self.tool, *(body for tool in mounted for body in tool.open_tool)))
        if doubled := [name for name, number in names.items() if number > 1]:
            raise st.Misread(
                f"a second body is named {doubled[0]!r}; the bodies of mounted tools need names", (".tools",)
            )

    def check_parts(self, robots: Sequence[Picks] = ()) -> None:
        """Check that part types state only tools that exist, and only values of hands that may hold them.

        ``robots`` are the settings of all robots of a file, which states the tool of every grasp if one has several.

        Raises
        ------
        InputError
            Its message names the key.
        """
        every = robots or (self,)
        tools = list(dict.fromkeys(name for each in every for name in each.tools))

        def hands(tool: str | None) -> list[Hand]:
            """The hands that a tool names: without a name, all."""
            some = ([own for name, own in each.tools.items() if tool in (None, name)] for each in every)
            return [own for each, named in zip(every, some, strict=True) for own in named or [each][: not each.tools]]

        for name, part in self.parts.items():
            steps: tuple[str, ...] = (".parts", f".{name}")
            grasps = [(own, (*steps, ".grasps", f"[{own.name!r}]")) for own in part.grasps]
            for tool, where in {part.tool: steps, **{own.tool: where for own, where in grasps}}.items():
                if tool is not None and tool not in tools:
                    raise st.Misread(str(UnknownNameError("tool", tool, tools or ("none",))), (*where, ".tool"))
            used = dict.fromkeys([own.tool or part.tool for own in part.grasps] or [part.tool])
            part.refuse_unused([hand for tool in used for hand in hands(tool)], steps)
            for own, where in grasps:
                own.refuse_unused(hands(own.tool or part.tool), where)
            if robots and len(self.tools) > 1 and None in used:
                reason = f"states no tool for some of its grasps; choose one of {', '.join(tools)} for the part"
                raise st.Misread(reason, steps)

    def refuse_conveyor(self, what: str) -> None:
        """Raise InputError if the picks have a conveyor, which ``what`` does not support."""
        if self.conveyor is not None:
            raise InputError(f"{what} does not support picks from a conveyor; use validate_picks or pinproof pick")

    def load_arm(self) -> Arm:
        """Load the arm that the file states, as :meth:`Tool.load_arm` does; InputError if it states several robots."""
        if self.robots:
            raise InputError(
                f"{self.source or 'picks'}: is for several robots ({', '.join(self.robots)}), not for a single arm; "
                "use pinproof cell allocate"
            )
        return super().load_arm()

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
        parts = {
            name: replace(part, grasps=tuple(grasp.turned(placement.rotation) for grasp in part.grasps))
            for name, part in self.parts.items()
        }
        return replace(self, picks=picks, frames=frames, conveyor=belt, parts=parts)

    def home_configuration(self, joint_names: Iterable[str], default: npt.NDArray[np.float64]) -> list[float]:
        """The home configuration of the file, or ``default`` (n,) if it states none.

        Raises
        ------
        InputError, PicksError
            If the file states only some of the joints, or a joint that the arm does not have.
        """
        names = list(joint_names)
        if not self.home:
            return [float(value) for value in default]
        missing, foreign = [n for n in names if n not in self.home], [n for n in self.home if n not in names]
        if missing or foreign:
            stated = (("lacks", missing), ("names", foreign))
            what = " and ".join(f"{verb} {', '.join(joints)}" for verb, joints in stated if joints)
            reason = f"the home {what}; the arm's joints are {', '.join(names)}"
            if self.source is None or "home" not in self.places:
                raise InputError(reason)
            raise PicksError(self.source, reason, self.places["home"])
        return [float(self.home[name]) for name in names]


SETTINGS = st.table_of(Picks)

OF_ALL = ("scene", "margin", "margins", "torque_limits", "conveyor", "parts", "optimise", "straight", "frames")
"""The settings that all robots of a file share; each robot may state the others."""

CELL_ROBOT = st.Table(
    "cell_robot",
    "One of several robots. A key that it does not state is that of the file.",
    st.required("base", POSE_IN_REACH, "the pose of the base link of its arm in the frame `world`"),
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
    robots = st.mapping_to(st.Kind({}, lambda _, robot: robot, parse), "names to robots")
    where = st.position(content, "robots")
    shared = replace(shared, robots=st.step(".robots", where, robots.parse, "robots", content.get("robots", {}), path))
    every = [robot.settings for robot in shared.robots.values()] or [shared]
    for each in every:
        try:
            each.check_tools()
            each.check_parts(every)
        except st.Misread as error:
            # The position of the innermost of the steps that is a key of a mapping
            where, holder = "", content
            for own in (str(each).removeprefix(".") for each in error.steps):
                if not isinstance(holder, LinedMapping) or own not in holder:
                    break
                where, holder = st.position(holder, own), holder[own]
            raise st.Misread(error.reason, error.steps, where) from error
        if each.xacro_args and not (each.robot or "").endswith(".xacro"):
            reason = "is valid only if the robot is a file that ends in .xacro"
            raise PicksError(path, reason, each.places["xacro_args"])
    return shared


def _places(content: LinedMapping) -> dict[str, str]:
    """The positions of what can be checked only together with the robot."""
    names = ("robot", "tcp", "xacro_args", "home", "frame", "part", "redundant")  # of jobs of tool paths too
    places = {name: content.place(name) for name in names if name in content}
    for name in ("xacro_args", "held", "windings"):
        inner = content.get(name)
        if isinstance(inner, LinedMapping):
            places.update({f"{name}.{own}": inner.place(own, f"key {name},") for own in inner})
    return places
