"""Options that several commands share, stated once: a parameter that is a dataclass stands for its fields.

Arguments and options that several commands share, and what they mean.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

import pinproof as pp
from pinproof.cli.complete import group_names, link_names, robot_names
from pinproof.cli.console import Stopped
from pinproof.collision.certificate import missing_since
from pinproof.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = [
    "Carried",
    "Chain",
    "Configuration",
    "Html",
    "IgnoreRecord",
    "Json",
    "Robot",
    "Seed",
    "Surroundings",
    "load_motion",
    "numbers",
    "parse_configuration",
    "spread",
]

Verbose = Annotated[bool, typer.Option("--verbose", help="Show the traceback of an error.")]


def spread(command: Callable[..., None], on_verbose: Callable[[], None]) -> Callable[..., None]:
    """A command as the parser takes it: every field of a dataclass among its parameters is an option of its own.

    It also takes ``--verbose``, and ends as :class:`pinproof.cli.console.Stopped` at Ctrl-C, which the parser would
    otherwise swallow.
    """
    # Not get_type_hints: of a parameter whose default is None, Python 3.10 makes an Optional that hides the Annotated.
    told = inspect.signature(command, eval_str=True).parameters
    groups: dict[str, Any] = {name: each.annotation for name, each in told.items() if is_dataclass(each.annotation)}
    options: list[tuple[str, Any, Any]] = []
    for name, parameter in told.items():
        if name in groups:
            inner = get_type_hints(groups[name], include_extras=True)
            options += [
                (field.name, inner[field.name], inspect.Parameter.empty if field.default is MISSING else field.default)
                for field in fields(groups[name])
            ]
        else:
            options.append((name, parameter.annotation, parameter.default))
    options.append(("verbose", Verbose, False))

    @functools.wraps(command)
    def call(*, verbose: bool, **given: Any) -> None:
        if verbose:
            on_verbose()
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        try:
            command(**given)
        except KeyboardInterrupt:
            raise Stopped from None

    by_name = inspect.Parameter.KEYWORD_ONLY
    call.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # what inspect reads first
        [inspect.Parameter(name, by_name, default=default, annotation=hint) for name, hint, default in options]
    )
    call.__annotations__ = {name: hint for name, hint, _ in options}
    return call


Robot = Annotated[
    str,
    typer.Argument(help="A catalogue name such as ur5, or a robot file.", metavar="ROBOT", autocompletion=robot_names),
]
Configuration = Annotated[str | None, typer.Option(help='Joint values in rad or m: "0 -pi/2 pi/2 ...", or home.')]
Seed = Annotated[int, typer.Option(help="Seed of every random choice.", min=0)]
Html = Annotated[Path | None, typer.Option("--html", help="Write a page that shows it.")]
Json = Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")]
IgnoreRecord = Annotated[
    bool,
    typer.Option(
        "--ignore-record",
        help="Judge the motion with what this command states, even if its file records attached bodies, held joints or "
        "obstacles that are missing here.",
    ),
]


@dataclass(frozen=True)
class Carried:
    """What the arm carries at its tcp."""

    tool_of: Annotated[
        Path | None,
        typer.Option(help="A picks file whose open tool the arm carries, with its tip, margin, tcp and held joints."),
    ] = None
    attached: Annotated[
        Path | None,
        typer.Option(
            "--attached", help="A file (YAML) of bodies that move with the tcp; with --tool-of, the bodies of both."
        ),
    ] = None

    @property
    def files(self) -> tuple[Path | None, ...]:
        """The files that are read."""
        return self.tool_of, self.attached

    @cached_property
    def picks(self) -> pp.Picks:
        """What the picks of ``--tool-of`` share; empty without it."""
        return pp.Picks(()) if self.tool_of is None else pp.picks.open_picks(self.tool_of).shared

    @cached_property
    def attachments(self) -> pp.collision.Attachments:
        """The bodies, allowed contacts, held joints and tip of both files.

        Raises
        ------
        InputError
            If both name a body alike, hold a joint at different values, or both state a tip.
        """
        picks = self.picks
        tool = pp.collision.Attachments(picks.open_tool, held=picks.held, tip=picks.tip)
        if self.attached is None:
            return tool
        more = pp.collision.Attachments.load(self.attached)
        both = {body.name for body in tool.bodies} & {body.name for body in more.bodies}
        if both:
            raise InputError(f"--tool-of and --attached both name a body {sorted(both)[0]!r}; rename one of them")
        for name, value in more.held.items():
            if tool.held.get(name, value) != value:
                raise InputError(f"--tool-of holds {name} at {tool.held[name]:g}, --attached at {value:g}; state one")
        if not (more.tip.isIdentity() or tool.tip.isIdentity()):
            raise InputError("--tool-of and --attached both state a tip; remove one of them")
        tip = tool.tip if more.tip.isIdentity() else more.tip
        return pp.collision.Attachments((*tool.bodies, *more.bodies), more.allowed, {**tool.held, **more.held}, tip)


@dataclass(frozen=True)
class Chain:
    """Which chain of a robot is the arm."""

    tcp: Annotated[
        str | None,
        typer.Option(help="The tcp frame; by default the one the robot declares.", autocompletion=link_names),
    ] = None
    base: Annotated[
        str | None,
        typer.Option(help="The link in which poses are given; by default the root.", autocompletion=link_names),
    ] = None
    group: Annotated[
        str | None,
        typer.Option(help="A group of the SRDF, which names base and tcp.", autocompletion=group_names),
    ] = None
    srdf: Annotated[Path | None, typer.Option("--srdf", help="An SRDF file.")] = None
    package_dir: Annotated[
        list[Path] | None,
        typer.Option("--package-dir", help="A folder of ROS packages, for package:// meshes; repeatable."),
    ] = None

    def arm(self, robot: str, limits: Path | None = None, carried: Carried | None = None) -> pp.Arm:
        """The arm of a robot, by its name or file, with the limits of a file and the held joints of what it carries.

        Raises
        ------
        InputError
            If the picks of ``--tool-of`` state another tcp than this command.
        """
        told = None if limits is None else pp.JointLimits.load(limits)
        loaded = pp.load_robot(robot, srdf=self.srdf, package_dirs=self.package_dir or ())
        tcp, of_tool = self.tcp, None if carried is None else carried.picks.tcp
        if tcp is None and self.group is None:
            tcp = of_tool
        arm = loaded.arm(tcp, base=self.base, group=self.group, limits=told)
        return held_by(arm, carried, of_tool)


@dataclass(frozen=True)
class Surroundings:
    """What stands around the arm, and how far from it everything has to stay."""

    scene: Annotated[
        Path | None, typer.Option("--scene", help="A scene file (YAML); by default nothing stands around.")
    ] = None
    margin: Annotated[float, typer.Option(help="Metres that must stay between any two bodies.", min=0.0)] = 0.0

    def load(self) -> pp.Scene:
        """The scene; an empty one where none is named."""
        return pp.Scene() if self.scene is None else pp.Scene.load(self.scene)

    def checker(
        self, arm: pp.Arm, scene: pp.Scene | None = None, carried: Carried | None = None
    ) -> pp.CollisionChecker:
        """The checker of an arm among it, with what it carries; ``scene`` is what :meth:`load` made, if called."""
        what, margin = pp.collision.Attachments(), self.margin
        if carried is not None:
            what, margin = carried.attachments, max(margin, carried.picks.margin)
        world = self.load() if scene is None else scene
        return pp.CollisionChecker(arm, world, margin=margin, attached=what.bodies, allowed=what.allowed)


def held_by(arm: pp.Arm, carried: Carried | None, tcp: str | None = None) -> pp.Arm:
    """The arm with the joints outside it where the carried tool holds them; ``tcp`` is the one the tool is for."""
    if tcp is not None and tcp != arm.tcp:
        raise InputError(f"the tool of --tool-of is for the tcp {tcp!r}, the arm ends in {arm.tcp!r}; give --tcp {tcp}")
    return arm if carried is None or not carried.attachments.held else arm.with_held(carried.attachments.held)


def load_motion(path: Path, checker: pp.CollisionChecker, ignore_record: bool) -> pp.Trajectory:
    """The motion of a file, for the arm of a checker.

    Raises
    ------
    InputError
        If the file records that the motion was certified with attached bodies, held joints or obstacles that the
        checker lacks, unless the record is to be ignored: a verdict without them would be about less.
    """
    trajectory = pp.Trajectory.load(path, checker.arm.joint_names)
    missing = missing_since(trajectory.certified, checker)
    if missing and not ignore_record:
        remedy = (
            "a motion whose attached bodies change on the way is certified part by part by `pinproof pick`"
            if len(trajectory.certified) > 1
            else "state the same by --tool-of PICKS, --attached FILE and --scene FILE"
        )
        raise InputError(
            f"{path}: {'; '.join(missing)}. {remedy[0].upper()}{remedy[1:]}, or judge the motion without it by "
            "--ignore-record"
        )
    return trajectory


def parse_configuration(text: str | None, arm: pp.Arm, name: str) -> npt.NDArray[np.float64]:
    """A configuration (n,) from ``home`` (the default) or n numbers."""
    if text is None or text.strip() == "home":
        return arm.home
    return arm.configuration(numbers(text, name), name)


def numbers(text: str, name: str) -> list[float]:
    """Numbers separated by blanks or commas, each written as ``[-][k*]pi[/m]`` or plainly.

    Raises
    ------
    InputError
        For a part that is no number; names it.
    """
    from pinproof.description.dh import parse_number

    values = []
    for part in text.replace(",", " ").split():
        try:
            values.append(float(parse_number(part)))
        except ValueError as error:
            raise InputError(f"{name}: {error}") from error
    return values
