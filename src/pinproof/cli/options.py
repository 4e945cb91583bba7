"""Arguments and options that several commands share, and what they mean."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
import typer

from pinproof.collision import Scene
from pinproof.description.dh_files import parse_number
from pinproof.errors import InputError
from pinproof.model import Arm, load_limits, load_robot

__all__ = [
    "Base",
    "Group",
    "Html",
    "Json",
    "LimitsFile",
    "Margin",
    "PackageDirs",
    "Robot",
    "SceneFile",
    "Seed",
    "SrdfFile",
    "Tcp",
    "load_arm",
    "load_scene",
    "numbers",
    "parse_configuration",
]

Robot = Annotated[str, typer.Argument(help="A catalogue name such as ur5, or a robot file.", metavar="ROBOT")]
Tcp = Annotated[str | None, typer.Option(help="The tcp frame; by default the one the robot declares.")]
Base = Annotated[str | None, typer.Option(help="The link in which poses are given; by default the root.")]
Group = Annotated[str | None, typer.Option(help="A group of the SRDF, which names base and tcp.")]
SrdfFile = Annotated[Path | None, typer.Option("--srdf", help="An SRDF file.")]
PackageDirs = Annotated[
    list[Path] | None,
    typer.Option("--package-dir", help="A folder of ROS packages, for package:// meshes; repeatable."),
]
SceneFile = Annotated[
    Path | None, typer.Option("--scene", help="A scene file (YAML); by default nothing stands around.")
]
LimitsFile = Annotated[
    Path | None, typer.Option("--limits", help="Limits of joints, as MoveIt's joint_limits.yaml states them.")
]
Margin = Annotated[float, typer.Option(help="Metres that must stay between any two bodies.", min=0.0)]
Seed = Annotated[int, typer.Option(help="Seed of every random choice.", min=0)]
Html = Annotated[Path | None, typer.Option("--html", help="Write a page that shows it.")]
Json = Annotated[bool, typer.Option("--json", help="Print the answer as JSON.")]


def load_arm(
    robot: str,
    tcp: str | None = None,
    base: str | None = None,
    group: str | None = None,
    srdf: Path | None = None,
    package_dirs: list[Path] | None = None,
    limits: Path | None = None,
) -> Arm:
    """The arm that the shared options name."""
    told = None if limits is None else load_limits(limits)
    return load_robot(robot, srdf=srdf, package_dirs=package_dirs or ()).arm(tcp, base=base, group=group, limits=told)


def load_scene(path: Path | None) -> Scene:
    """The scene of a file; an empty one without."""
    return Scene() if path is None else Scene.load(path)


def parse_configuration(text: str | None, arm: Arm, name: str) -> npt.NDArray[np.float64]:
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
    values = []
    for part in text.replace(",", " ").split():
        try:
            values.append(float(parse_number(part)))
        except ValueError as error:
            raise InputError(f"{name}: {error}") from error
    return values
