"""Arguments and options that several commands share, and the parsing of their values.

A command states a group of options as one parameter whose type is a dataclass, such as :class:`ChainOptions`;
:func:`expand_options` turns each field of the dataclass into an option.
"""

from __future__ import annotations

import copy
import functools
import inspect
import math
from collections.abc import Callable, Iterable, Sized
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

import numpy as np
import typer

import pinproof as pp
from pinproof.cli.console import Interrupted, print_note
from pinproof.errors import InputError, PinproofError
from pinproof.units import MOST_MARGIN, parse_angle, refuse_degrees, warn_of_degrees, warn_of_millimetres

if TYPE_CHECKING:
    import numpy.typing as npt

    from pinproof.description import Calibration
    from pinproof.spatial import SE3


def robot_names(incomplete: str) -> list[str]:
    """Catalogue names and existing robot files."""
    from pinproof.description import catalogue_names
    from pinproof.model import ROBOT_SUFFIXES

    return [*_starting_with(incomplete, catalogue_names()), *file_names(*ROBOT_SUFFIXES)(incomplete)]


def method_names(incomplete: str) -> list[str]:
    """The registered IK methods."""
    return _starting_with(incomplete, pp.ik.IK_METHODS)


def format_names(incomplete: str) -> list[str]:
    """The file formats."""
    return _starting_with(incomplete, pp.formats.FORMATS)


def file_names(*suffixes: str) -> Callable[[str], list[str]]:
    """A completion function for files with one of these suffixes, and for folders.

    Shells complete paths by themselves for options of type path. This function is for arguments that may be a name or
    a file.
    """

    def complete(incomplete: str) -> list[str]:
        folder, _, prefix = incomplete.rpartition("/")
        try:
            entries = sorted(Path(f"{folder}/" if "/" in incomplete else ".").iterdir())
        except OSError:
            return []
        names = [f"{path.name}/" if path.is_dir() else path.name for path in entries]
        matching = [name for name in names if name.endswith(("/", *suffixes)) and not name.startswith(".")]
        return [f"{folder}/{name}" if "/" in incomplete else name for name in _starting_with(prefix, matching)]

    return complete


def link_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """The links of the robot on the command line."""
    robot = _robot(ctx)
    return [] if robot is None else _starting_with(incomplete, robot.urdf.links)


def group_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """The joint groups of the SRDF of the robot on the command line."""
    robot = _robot(ctx)
    return [] if robot is None or robot.srdf is None else _starting_with(incomplete, robot.srdf.groups)


def _robot(ctx: typer.Context) -> pp.Robot | None:
    """The robot on the command line, or None if it is not stated yet or cannot be read."""
    # The parser stops at an option without a value; the arguments parsed so far are then in ctx.args.
    name = ctx.params.get("robot") or next(iter(ctx.args), None)
    try:
        return None if name is None else pp.load_robot(name, srdf=ctx.params.get("srdf"))
    except PinproofError:
        return None


def _starting_with(incomplete: str, names: Iterable[str]) -> list[str]:
    return sorted(name for name in names if name.startswith(incomplete))


Robot = Annotated[
    str,
    typer.Argument(
        help="A catalogue name such as ur5, a robot file, or a DH table.", metavar="ROBOT", autocompletion=robot_names
    ),
]
Configuration = Annotated[
    str | None,
    typer.Option(help='Joint values in rad or m, as "0 -pi/2 pi/2 ...", or home. Default: home.', metavar="VALUES"),
]
Seed = Annotated[int, typer.Option(help="Seed of the random number generator.", min=0)]
Html = Annotated[Path | None, typer.Option("--html", help="Write the result as an HTML page.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Limits = Annotated[
    Path | None, typer.Option("--limits", help="A file of joint limits in the format of MoveIt's joint_limits.yaml.")
]
Place = Annotated[
    str,
    typer.Option(
        help='Placement of the robot base: "x y z" in metres, and optionally a rotation about z (rad).', metavar="POSE"
    ),
]
Live = Annotated[
    bool | None,
    typer.Option(
        help="Whether pages (.html) compute: a grasp or the base of the robot is moved in the page, and the grasps are "
        "checked again. Default: if that enlarges them by 1 MB at most."
    ),
]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print the traceback of an error.")]
IgnoreRecord = Annotated[
    bool,
    typer.Option(
        "--ignore-record",
        help="Use only the tool and scene of this command, even if the motion file records attached bodies, held "
        "joints or obstacles that are missing here.",
    ),
]


def option(text: str, default: Any, *names: str, **settings: Any) -> Any:
    """An option: its help, its default (MISSING for none), its names, and settings of ``typer.Option``.

    The value is the field of a group of options, or the default of a parameter of a command.
    """
    return field(default=default, metadata={"option": typer.Option(*names, help=text, **settings)})


def argument(text: str, default: Any, **settings: Any) -> Any:
    """An argument, as :func:`option`."""
    return field(default=default, metadata={"option": typer.Argument(help=text, **settings)})


@dataclass(frozen=True)
class RobotFileOptions:
    """Options for the files of the robot."""

    PANEL: ClassVar = "Robot"

    srdf: Path | None = option("The SRDF file of the robot: its joint groups, and links that need no check.", None)
    package_dir: list[Path] | None = option(
        "A folder of ROS packages, to resolve package:// URLs; can be given several times.", None, metavar="FOLDER"
    )
    xacro_arg: list[str] | None = option(
        "A value for an argument of a xacro file; can be given several times.", None, metavar="NAME=VALUE"
    )  # fmt: skip
    calibration: Path | None = option(
        "The calibration of this one arm: calibration.conf or kinematics (YAML) of Universal Robots, or differences of "
        "a DH table (CSV).",
        None,
    )
    visual_bodies: bool = option(
        "Check links that have visual but no collision geometry with their visual geometry.", False, "--visual-bodies"
    )

    @property
    def xacro_args(self) -> dict[str, str]:
        """The arguments of ``--xacro-arg``.

        InputError if an argument is not of the form NAME=VALUE, or a name is repeated.
        """
        found: dict[str, str] = {}
        for text in self.xacro_arg or ():
            name, equals, value = text.replace(":=", "=", 1).partition("=")
            if not equals or not name.strip():
                raise InputError(f"--xacro-arg must be NAME=VALUE, not {text!r}")
            if name.strip() in found:
                raise InputError(f"--xacro-arg states {name.strip()!r} twice; state it once")
            found[name.strip()] = value
        return found

    def load(self, robot: str, measured: Calibration | None = None) -> pp.Robot:
        """Load a robot by catalogue name or file, ``measured`` as a motion file states it unless an option does."""
        return pp.load_robot(
            robot,
            srdf=self.srdf,
            package_dirs=self.package_dir or (),
            xacro_args=self.xacro_args,
            calibration=self.calibration or measured,
            visual_bodies=self.visual_bodies,
        )


@dataclass(frozen=True)
class ChainOptions(RobotFileOptions):
    """Options that select the kinematic chain of the arm, and those for the files of the robot."""

    tcp: str | None = option(
        "The tcp frame. Default: the frame that the robot declares.", None, autocompletion=link_names, metavar="LINK"
    )
    base: str | None = option(
        "The link in whose frame poses are given. Default: the root link.",
        None,
        autocompletion=link_names,
        metavar="LINK",
    )
    group: str | None = option(
        "A joint group of the SRDF, which defines base and tcp.", None, autocompletion=group_names, metavar="GROUP"
    )

    limits: Limits = None

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The input files."""
        return self.srdf, self.limits, self.calibration

    def arm(self, robot: str, motion: Path | None = None) -> pp.Arm:
        """Load the arm of a robot by catalogue name or file, calibrated as a motion file states it if no option is."""
        limits = None if self.limits is None else pp.JointLimits.load(self.limits)
        measured = None
        if motion is not None and self.calibration is None and not pp.motion.is_program_file(motion):
            stated = [own for record in pp.Trajectory.load(motion).certified for own in record.calibrations.values()]
            if stated:
                measured = stated[0]
                print_note(f"note: the arm is calibrated as {motion} states, with the numbers of {measured.path}")
        return self.load(robot, measured).arm(self.tcp, base=self.base, group=self.group, limits=limits)


SCENE_PANEL = "Scene and tool"


@dataclass(frozen=True)
class SetupOptions(ChainOptions):
    """Options for the arm, the obstacles, the required distance to them, and the bodies that the tcp carries."""

    scene: Path | None = option("A scene file (YAML). Default: no obstacles.", None, rich_help_panel=SCENE_PANEL)
    margin: float = option(
        "Distance in metres that every two bodies must keep from each other.", 0.0, min=0.0, rich_help_panel=SCENE_PANEL
    )
    tool_of: Path | None = option(
        "A picks file, whose tool the arm carries with the gripper open. Its tip, margin, tcp, held joints and "
        "calibration apply too.",
        None,
        rich_help_panel=SCENE_PANEL,
    )
    attached: Path | None = option(
        "A YAML file of bodies attached to the tcp; can be combined with --tool-of.", None, rich_help_panel=SCENE_PANEL
    )

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The input files."""
        return *super().files, self.scene, self.tool_of, self.attached

    def target(self, xyz: str, rpy: str) -> SE3:
        """base_from_tcp at which the tcp, or the tip of the tool if it has one, is at ``--xyz`` and ``--rpy``."""
        angles = numbers(rpy, "--rpy", "roll pitch yaw")
        refuse_degrees("--rpy", angles)
        target = pp.pose(numbers(xyz, "--xyz", "x y z"), angles)
        return target * self.attachments.tip.inverse() if self.has_tool else target

    @property
    def has_tool(self) -> bool:
        """Whether a file states what the tcp carries."""
        return self.tool_of is not None or self.attached is not None

    @property
    def surrounds(self) -> bool:
        """Whether a scene or a tool is given, so that collisions are of interest."""
        return self.scene is not None or self.has_tool

    @cached_property
    def picks(self) -> pp.Picks:
        """The shared settings of the picks file of ``--tool-of``; without it, the defaults."""
        return pp.Picks(()) if self.tool_of is None else pp.picks.open_picks(self.tool_of).shared

    @cached_property
    def attachments(self) -> pp.collision.Attachments:
        """The attached bodies, allowed contacts, held joints and tip of both files.

        InputError if both files name the same body, hold a joint at different values, or state a tip.
        """
        picks = self.picks.always_mounted
        if len(picks.tools) > 1 and picks.tool_change != "mounted":
            raise InputError(f"--tool-of: {self.tool_of} has several tools ({', '.join(picks.tools)}); use --attached")
        tool = pp.collision.Attachments(picks.open_tool, held=picks.held, tip=picks.tip)
        if self.attached is None:
            return tool
        return tool.with_more(pp.collision.Attachments.load(self.attached), ("--tool-of", "--attached"))

    def arm(self, robot: str, motion: Path | None = None) -> pp.Arm:
        """Load the arm of a robot, with tcp and calibration of ``--tool-of`` if none are selected, and its held joints.

        InputError if the picks file of ``--tool-of`` states another tcp than the command.
        """
        if not self.has_tool:  # the packages that read these files are not imported then
            return super().arm(robot, motion)
        # The tool is made for the tcp of its picks file, unless the command selects a chain; its arm is calibrated
        tcp = self.picks.tcp
        own = replace(
            self,
            calibration=self.calibration or self.picks.calibration,
            visual_bodies=self.visual_bodies or self.picks.visual_bodies,
        )
        arm = ChainOptions.arm(own if self.tcp or self.group else replace(own, tcp=tcp), robot, motion)
        if tcp is not None and tcp != arm.tcp:
            raise InputError(
                f"the tool of --tool-of is made for tcp {tcp!r}, but the arm ends in {arm.tcp!r}; use --tcp {tcp}"
            )
        return arm.with_held(self.attachments.held) if self.attachments.held else arm

    def world(self) -> pp.Scene:
        """The scene; without ``--scene`` it is empty."""
        return pp.Scene() if self.scene is None else pp.Scene.load(self.scene)

    def checker(self, arm: pp.Arm, world: pp.Scene | None = None) -> pp.CollisionChecker:
        """The collision checker of an arm and its tool in a scene, by default in :meth:`world`."""
        attachments = self.attachments if self.has_tool else pp.collision.Attachments()
        margin = max(self.margin, self.picks.margin) if self.has_tool else self.margin
        warn_of_millimetres("--margin", [self.margin], most=MOST_MARGIN)
        world = self.world() if world is None else world
        return pp.CollisionChecker(arm, world, margin=margin, attached=attachments.bodies, allowed=attachments.allowed)


@dataclass(frozen=True)
class ConstraintOptions:
    """Options for the constraints of the tcp along a motion."""

    PANEL: ClassVar = "Limits and constraints"

    upright: str | None = option(
        'Keep the axis of the tcp that points up at the start within this angle of the vertical: "5 deg", or radians.',
        None,
        metavar="ANGLE",
    )
    upright_axis: str | None = option(
        'For --upright: the axis in the tcp frame, as "x y z". Default: the axis that points up at the start.',
        None,
        metavar="AXIS",
    )

    def constraints(self, arm: pp.Arm, start: npt.NDArray[np.float64]) -> tuple[pp.Upright, ...]:
        """The constraints for a motion that begins at ``start`` (n,).

        InputError if an option is not an angle or a direction, or ``--upright-axis`` is given without ``--upright``.
        """
        if self.upright is None:
            if self.upright_axis is not None:
                raise InputError("--upright-axis needs --upright, the allowed angle")
            return ()
        try:
            tolerance = parse_angle(self.upright)
        except ValueError as error:
            raise InputError(f"--upright: {error}") from None
        if not tolerance < math.pi / 2:
            degrees = f'; for degrees write "{self.upright} deg"' if self.upright.strip().isdigit() else ""
            raise InputError(
                f"--upright: {tolerance:g} rad ({math.degrees(tolerance):g} deg) must be below 90 deg{degrees}"
            )
        # The vertical in the frame in which constraints are stated
        up = arm.root_from_base.rotation.T @ np.array([0.0, 0.0, 1.0])
        if self.upright_axis is None:
            return (pp.Upright.keeping(arm, start, tolerance=tolerance, up=up),)
        x, y, z = numbers(self.upright_axis, "--upright-axis", "x y z")
        return (pp.Upright(tolerance=tolerance, axis_in_tcp=(x, y, z), up=tuple(up.tolist())),)


MASS_FORMS = ("mass", "mass x y z", "mass x y z ixx iyy izz")
"""The forms of a payload: mass (kg), centre of mass (m) and inertia about it (kg m^2), in the tcp frame."""


@dataclass(frozen=True)
class RateOptions:
    """Options for the torques of the joints and the speed of the tool."""

    PANEL: ClassVar = "Limits and constraints"

    payload: str | None = option(
        'Mass in kg that the tcp carries, as "mass", "mass x y z" with its centre (m), or "mass x y z ixx iyy '
        'izz" with its inertia (kg m^2). The torque limits of the joints then apply.',
        None,
        metavar="MASS",
    )
    torque: bool = option("Apply the torque limits of the joints (effort in the URDF).", False)
    tool_speed: float | None = option("Largest speed of the tcp in m/s, such as 0.25 beside persons.", None)

    def limits(self, arm: pp.Arm) -> list[pp.motion.RateConstraint]:
        """The limits for the timing of an arm beside those of its joints.

        InputError if the payload is not a mass, a centre and an inertia, or the arm has no torque limits or masses.
        """
        # A payload implies the torque limits, which then hold with it
        limits: list[pp.motion.RateConstraint] = []
        if self.payload is not None:
            values = numbers(self.payload, "--payload", *MASS_FORMS)
            center, inertia = np.array(values[1:4] or [0.0, 0.0, 0.0]), np.array(values[4:])
            payload = pp.Payload(values[0], center, inertia if len(inertia) else None)
            limits.append(pp.motion.TorqueLimits(arm, payload))
        elif self.torque:
            limits.append(pp.motion.TorqueLimits(arm))
        if self.tool_speed is not None:
            limits.append(pp.motion.ToolLimits(arm, linear_speed=self.tool_speed))
        return limits


def expand_options(command: Callable[..., None], on_verbose: Callable[[], None]) -> Callable[..., None]:
    """Return a command in which each field of a dataclass parameter is an option of the command line.

    The help lists the options of a dataclass in the panel that its ``PANEL`` names. The command also accepts
    ``--verbose``, and Ctrl-C raises :class:`pinproof.cli.console.Interrupted`; the parser would otherwise hide it.
    """
    # Not get_type_hints: Python 3.10 wraps a parameter with the default None in Optional, which hides the Annotated.
    parameters = inspect.signature(command, eval_str=True).parameters
    # The parameters that are groups of options, by name
    groups: dict[str, Any] = {
        name: each.annotation for name, each in parameters.items() if is_dataclass(each.annotation)
    }
    # Each field of a group, and each other parameter, becomes an option with its default
    options: list[tuple[str, Any, Any]] = []
    for name, parameter in parameters.items():
        if name in groups:
            hints = get_type_hints(groups[name], include_extras=True)
            for each in fields(groups[name]):
                default = inspect.Parameter.empty if each.default is MISSING else each.default
                info = each.metadata.get("option")
                hint = hints[each.name] if info is None else Annotated[hints[each.name], info]
                panel = getattr(groups[name], "PANEL", None)
                options.append((each.name, _with_value(each.name, hint, default, panel), default))
        elif isinstance(parameter.default, Field):
            default = inspect.Parameter.empty if parameter.default.default is MISSING else parameter.default.default
            info = parameter.default.metadata["option"]
            options.append((name, _with_value(name, Annotated[parameter.annotation, info], default), default))
        else:
            options.append((name, _with_value(name, parameter.annotation, parameter.default), parameter.default))
    options.append(("verbose", Verbose, False))

    @functools.wraps(command)
    def call(*, verbose: bool, **given: Any) -> None:
        if verbose:
            on_verbose()
        for name, group in groups.items():
            given[name] = group(**{each.name: given.pop(each.name) for each in fields(group)})
        try:
            command(**given)
        except KeyboardInterrupt:
            raise Interrupted from None

    # The parser reads the signature and the annotations of the new command
    keyword_only = inspect.Parameter.KEYWORD_ONLY
    call.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # inspect reads this attribute first
        [inspect.Parameter(name, keyword_only, default=default, annotation=hint) for name, hint, default in options]
    )
    call.__annotations__ = {name: hint for name, hint, _ in options}
    return call


VALUES = {int: "INTEGER", float: "NUMBER", Path: "FILE", str: "TEXT"}
"""What the help shows for the value of an option by default."""


def _with_value(name: str, hint: Any, default: Any, panel: str | None = None) -> Any:
    """An annotation whose option names the value that the user may enter, such as ``NUMBER>=0``, and its panel.

    A switch that is off by default has no opposite (``--no-...``).
    """
    kind, info = get_args(hint)
    info = copy.copy(info)
    info.rich_help_panel = info.rich_help_panel or panel
    if default is False and not isinstance(info.default, str):  # typer stores the first stated name there
        info.param_decls = (f"--{name.replace('_', '-')}",)
    # What the help shows for the value: the choices, or a kind of number with its range
    plain = next(each for each in (*get_args(kind), kind) if each is not type(None))
    if info.metavar is None and get_origin(kind) is Literal:
        info.metavar = "|".join(get_args(kind))
    elif info.metavar is None and plain in VALUES:
        ends = [f"{end:g}" for end in (info.min, info.max) if end is not None]
        info.metavar = "..".join(ends) if len(ends) == 2 else f"{VALUES[plain]}{'>=' if ends else ''}{''.join(ends)}"
    return Annotated[kind, info]


def load_motion(path: Path, checker: pp.CollisionChecker, ignore_record: bool) -> pp.Trajectory:
    """Load a motion file for the arm of a checker.

    InputError if the file records that the motion was certified with attached bodies, held joints or obstacles that the
    checker does not have, because FREE would then state less than the file suggests; ``ignore_record`` allows it.
    """
    # FREE would state less than the file suggests if the checker lacks what the motion was certified with
    trajectory = pp.Trajectory.load(path, checker.arm.joint_names)
    missing = pp.collision.missing_since(trajectory.certified, checker)
    if missing and not ignore_record:
        remedy = (
            "The attached bodies change along this motion; `pinproof pick` certifies such a motion part by part"
            if len(trajectory.certified) > 1
            else "State what is missing with --tool-of PICKS, --attached FILE or --scene FILE"
        )
        raise InputError(f"{path}: {'; '.join(missing)}. {remedy}, or use --ignore-record to certify without them")
    return trajectory


def parse_configuration(text: str | None, arm: pp.Arm, option: str) -> npt.NDArray[np.float64]:
    """A configuration (n,) from n numbers, or the home configuration for ``home`` and None."""
    if text is None or text.strip() == "home":
        return arm.home
    values = numbers(text, option)
    if len(values) != arm.dof:
        joints = ", ".join(arm.joint_names)
        raise InputError(f"{option} needs a value for each joint ({joints}); {text!r} has {_count(values)}")
    q = arm.configuration(values, option)
    warn_of_degrees(option, q[arm.angular & np.isfinite(arm.limits.lower)].tolist())
    return q


def note_limits(arm: pp.Arm, q: npt.NDArray[np.float64]) -> None:
    """Report on stderr each joint of q (n,) outside its limits, for commands that accept such values."""
    for sentence in arm.limits.violations(arm.limits.snap(q), arm.joint_names):
        print_note(f"note: {sentence}")


def placement(text: str) -> SE3:
    """The placement of ``--place``: world_from_root."""
    values = numbers(text, "--place", "x y z", "x y z rotation")
    refuse_degrees("--place", values[3:])
    return pp.pose(values[:3], (0.0, 0.0, values[3] if len(values) == 4 else 0.0))


def numbers(text: str, option: str, *forms: str) -> list[float]:
    """Numbers separated by spaces or commas, each a decimal number or of the form ``[-][k*]pi[/m]``.

    InputError names the option if a part is no number, or their count differs from that of all forms, such as "x y z".
    """
    from pinproof.common.files import parse_number

    # Numbers are separated by spaces or commas
    values = []
    for part in text.replace(",", " ").split():
        try:
            values.append(float(parse_number(part)))
        except ValueError as error:
            raise InputError(f"{option}: {error}") from error
    if forms and len(values) not in {len(form.split()) for form in forms}:
        valid = " or ".join(f'"{form}"' for form in forms)
        raise InputError(f"{option} must be {valid}; {text!r} has {_count(values)}")
    return values


def _count(values: Sized) -> str:
    return "1 number" if len(values) == 1 else f"{len(values)} numbers"
