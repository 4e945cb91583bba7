"""Arguments and options that several commands share, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import pinproof as pp
from pinproof.cli.complete import group_names, link_names, robot_names
from pinproof.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = [
    "Chain",
    "Configuration",
    "Html",
    "Json",
    "Robot",
    "Seed",
    "Surroundings",
    "numbers",
    "parse_configuration",
]

Robot = Annotated[
    str,
    typer.Argument(help="A catalogue name such as ur5, or a robot file.", metavar="ROBOT", autocompletion=robot_names),
]
Configuration = Annotated[str | None, typer.Option(help='Joint values in rad or m: "0 -pi/2 pi/2 ...", or home.')]
Seed = Annotated[int, typer.Option(help="Seed of every random choice.", min=0)]
Html = Annotated[Path | None, typer.Option("--html", help="Write a page that shows it.")]
Json = Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")]


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

    def arm(self, robot: str, limits: Path | None = None) -> pp.Arm:
        """The arm of a robot, by its name or file, with the limits of a file where one is given."""
        told = None if limits is None else pp.load_limits(limits)
        loaded = pp.load_robot(robot, srdf=self.srdf, package_dirs=self.package_dir or ())
        return loaded.arm(self.tcp, base=self.base, group=self.group, limits=told)


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

    def checker(self, arm: pp.Arm, scene: pp.Scene | None = None) -> pp.CollisionChecker:
        """The checker of an arm among it; ``scene`` is what :meth:`load` made, if that was called before."""
        return pp.CollisionChecker(arm, self.load() if scene is None else scene, margin=self.margin)


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
    from pinproof.description.dh_files import parse_number

    values = []
    for part in text.replace(",", " ").split():
        try:
            values.append(float(parse_number(part)))
        except ValueError as error:
            raise InputError(f"{name}: {error}") from error
    return values
