"""What the Tab key offers: the robots of the catalogue and files; links and groups of the robot already named."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import typer

import pinproof as pp
from pinproof.errors import PinproofError

__all__ = ["file_names", "group_names", "link_names", "robot_names"]

ROBOT_FILES = (".urdf", ".xacro", ".xml")


def robot_names(incomplete: str) -> list[str]:
    """Catalogue names, and robot files that are there."""
    from pinproof.description import catalogue_names

    return [*_beginning(incomplete, catalogue_names()), *file_names(*ROBOT_FILES)(incomplete)]


def file_names(*endings: str) -> Callable[[str], list[str]]:
    """Files with one of these endings, and the folders on the way to them.

    A shell offers files by itself for what is typed as a path; this is for what may also be a file.
    """

    def offer(incomplete: str) -> list[str]:
        folder, _, begun = incomplete.rpartition("/")
        place = Path(f"{folder}/" if "/" in incomplete else ".")
        try:
            there = sorted(place.iterdir())
        except OSError:
            return []
        names = [f"{path.name}/" if path.is_dir() else path.name for path in there]
        fitting = [name for name in names if name.endswith(("/", *endings)) and not name.startswith(".")]
        return [f"{folder}/{name}" if "/" in incomplete else name for name in _beginning(begun, fitting)]

    return offer


def link_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """The links of the robot on the line."""
    robot = _robot(ctx)
    return [] if robot is None else _beginning(incomplete, robot.urdf.links)


def group_names(ctx: typer.Context, incomplete: str) -> list[str]:
    """The groups of the SRDF of the robot on the line."""
    robot = _robot(ctx)
    return [] if robot is None or robot.srdf is None else _beginning(incomplete, robot.srdf.groups)


def _robot(ctx: typer.Context) -> pp.Robot | None:
    """The robot on the line; None where there is none yet, or none that can be read."""
    # A line that ends in an option without its value is not parsed to its end: what was read stands in args.
    name = ctx.params.get("robot") or next(iter(ctx.args), None)
    try:
        return None if name is None else pp.load_robot(name, srdf=ctx.params.get("srdf"))
    except PinproofError:
        return None


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return sorted(name for name in names if name.startswith(incomplete))
