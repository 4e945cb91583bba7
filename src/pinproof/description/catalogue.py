"""Robots known by name: where their files lie, which frame is their tcp, and a home configuration.

The tables themselves are ``catalogue.yaml`` and ``catalogue_overlaps.yaml`` beside this file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from pinproof.description.packages import example_robot_data
from pinproof.errors import InputError, UnknownNameError

__all__ = ["CatalogueEntry", "catalogue_names", "find_robot", "robots_folder"]


@dataclass(frozen=True)
class CatalogueEntry:
    """A robot known by name.

    Parameters
    ----------
    name
        Its name in the catalogue.
    urdf, srdf
        Its files.
    tcp
        The frame meant when ``robot.arm()`` names none.
    home
        A comfortable configuration, joint name to value (rad or m), free of self-collision.
    base
        The link meant when ``robot.arm()`` names none and the tcp hangs on it; None for the root.
    overlaps
        Pairs of links whose collision geometry overlaps in every sampled configuration (scripts/catalogue_overlaps.py).
    """

    name: str
    urdf: Path
    srdf: Path | None
    tcp: str
    home: Mapping[str, float] = field(default_factory=dict)
    base: str | None = None
    overlaps: tuple[tuple[str, str], ...] = ()


def catalogue_names() -> tuple[str, ...]:
    """The names that :func:`find_robot` knows, sorted."""
    return tuple(sorted(_table("catalogue.yaml")))


def find_robot(name: str) -> CatalogueEntry:
    """The catalogue entry of a robot.

    Raises
    ------
    UnknownNameError
        If no robot has that name; names those that exist.
    InputError
        If the robot's files are not installed.
    """
    robots = _table("catalogue.yaml")
    if name not in robots:
        raise UnknownNameError("robot", name, robots, "the catalogue (a path must end in .urdf, .xacro or .xml)")
    words = robots[name]
    srdf = None if words.get("srdf") is None else _file(name, words["srdf"])
    overlaps = tuple((first, second) for first, second in _table("catalogue_overlaps.yaml").get(words["urdf"], ()))
    return CatalogueEntry(
        name, _file(name, words["urdf"]), srdf, words["tcp"], words.get("home", {}), words.get("base"), overlaps
    )


def robots_folder() -> Path:
    """The folder ``robots/`` of this installation: inside the package in a wheel, beside ``src/`` in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "robots", package.parents[1] / "robots"):
        if folder.is_dir():
            return folder
    raise InputError(f"the folder robots/ is neither in {package} nor in {package.parents[1]}: reinstall pinproof")


@cache
def _table(file: str) -> dict[str, Any]:
    import yaml

    return dict(yaml.safe_load(Path(__file__).with_name(file).read_text(encoding="utf-8")))


def _file(name: str, path: str) -> Path:
    """``robots/...`` is ours; anything else lies in example-robot-data."""
    if path.startswith("robots/"):
        return robots_folder() / path.removeprefix("robots/")
    share = example_robot_data()
    if share is None:
        raise InputError(f"robot {name!r} comes with example-robot-data, which is not installed here")
    return share / "example-robot-data" / "robots" / path
