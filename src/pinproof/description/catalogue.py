"""The catalogue of robots: for each name its files, the tcp frame and a home configuration.

The data are in ``catalogue.yaml`` and ``catalogue_overlaps.yaml`` in this folder.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from pinproof.description.packages import example_robot_data
from pinproof.errors import InputError, UnknownNameError

OVERLAP_REASON = "catalogue: overlaps by design"
"""The reason with which the catalogue excludes a pair of links."""


@dataclass(frozen=True)
class CatalogueEntry:
    """A robot of the catalogue.

    Parameters
    ----------
    name
        Name in the catalogue.
    urdf, srdf
        Files of the robot.
    tcp
        Default tcp of ``robot.arm()``.
    home
        Home configuration without self-collision: joint name to value (rad or m).
    base
        Default base of ``robot.arm()`` if the tcp is a descendant of it; None for the root link.
    overlaps
        Pairs of links whose collision geometry overlaps by design (`pinproof info --overlaps`).
    arms
        The tcp frames of the arms of ``robot.arms()`` by name, for a robot with several.
    """

    name: str
    urdf: Path
    srdf: Path | None
    tcp: str
    home: Mapping[str, float] = field(default_factory=dict)
    base: str | None = None
    overlaps: tuple[tuple[str, str], ...] = ()
    arms: Mapping[str, str] = field(default_factory=dict)


def catalogue_names() -> tuple[str, ...]:
    """Return the names of all robots, sorted."""
    return tuple(sorted(_table("catalogue.yaml")))


def find_robot(name: str) -> CatalogueEntry:
    """Return the catalogue entry of a robot.

    Raises
    ------
    UnknownNameError
        If no robot has that name.
    InputError
        If the files of the robot are not installed.
    """
    robots = _table("catalogue.yaml")
    if name not in robots:
        where = "the catalogue (the name of a file ends in .urdf, .xacro, .xml, .yaml or .csv)"
        raise UnknownNameError("robot", name, robots, where)
    data = robots[name]
    srdf = None if data.get("srdf") is None else _file(name, data["srdf"])
    overlaps = tuple((first, second) for first, second in _table("catalogue_overlaps.yaml").get(data["urdf"], ()))
    return CatalogueEntry(
        name,
        _file(name, data["urdf"]),
        srdf,
        data["tcp"],
        data.get("home", {}),
        data.get("base"),
        overlaps,
        _arms(name, robots),
    )


SIDES = ("left", "right")
"""The suffixes of the two entries of a robot with two arms."""


def _arms(name: str, robots: Mapping[str, Any]) -> dict[str, str]:
    """Return the tcps of the arms ``left`` and ``right`` of a robot that has an entry for each of them."""
    stem, _, side = name.rpartition("_")
    both = [f"{stem}_{each}" for each in SIDES]
    if side not in SIDES or not all(each in robots for each in both):
        return {}
    return {each: robots[entry]["tcp"] for each, entry in zip(SIDES, both, strict=True)}


def robots_folder() -> Path:
    """Return the folder ``robots/``: inside the installed package, or beside ``src/`` in a checkout."""
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
    """Resolve a path of the catalogue: ``robots/...`` is in this repository, others are in example-robot-data."""
    if path.startswith("robots/"):
        return robots_folder() / path.removeprefix("robots/")
    share = example_robot_data()
    if share is None:
        raise InputError(f"robot {name!r} requires example-robot-data: pip install example-robot-data")
    return share / "example-robot-data" / "robots" / path
