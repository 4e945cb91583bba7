"""Tab completion of robot names, robot files, IK methods, links and joint groups."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import typer

import pinproof as pp
from pinproof.errors import PinproofError


def robot_names(incomplete: str) -> list[str]:
    """Catalogue names and existing robot files."""
    from pinproof.description import catalogue_names
    from pinproof.model import ROBOT_SUFFIXES

    return [*_starting_with(incomplete, catalogue_names()), *file_names(*ROBOT_SUFFIXES)(incomplete)]


def method_names(incomplete: str) -> list[str]:
    """The registered IK methods."""
    return _starting_with(incomplete, pp.ik.IK_METHODS)


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
