"""Robots known by name: where their files lie, which frame is their tcp, and a home configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from pathlib import Path

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
        A comfortable configuration, joint name to value (rad or m).
    """

    name: str
    urdf: Path
    srdf: Path | None
    tcp: str
    home: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Shipped:
    """Paths inside the folder of robots that comes with an installation, or inside example-robot-data."""

    urdf: str
    tcp: str
    home: Mapping[str, float]
    srdf: str | None = None
    ours: bool = False


_UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
_UR_HOME = dict(zip(_UR, (0.0, -pi / 2, pi / 2, -pi / 2, -pi / 2, 0.0), strict=True))
_PANDA_HOME = {f"panda_joint{i + 1}": q for i, q in enumerate((0, -pi / 4, 0, -3 * pi / 4, 0, pi / 2, pi / 4))}

_ROBOTS = {
    "generic_6dof": _Shipped(
        "generic_6dof/generic_6dof.urdf",
        "tool0",
        dict(zip((f"joint_{i}" for i in range(1, 7)), (0.0, pi / 3, -2 * pi / 3, -pi / 6, pi / 2, 0.0), strict=True)),
        ours=True,
    ),
    "panda": _Shipped(
        "panda_description/urdf/panda.urdf", "panda_hand_tcp", _PANDA_HOME, "panda_description/srdf/panda.srdf"
    ),
    "ur5": _Shipped("ur_description/urdf/ur5_robot.urdf", "tool0", _UR_HOME, "ur_description/srdf/ur5.srdf"),
}


def catalogue_names() -> tuple[str, ...]:
    """The names that :func:`find_robot` knows, sorted."""
    return tuple(sorted(_ROBOTS))


def find_robot(name: str) -> CatalogueEntry:
    """The catalogue entry of a robot.

    Raises
    ------
    UnknownNameError
        If no robot has that name; names those that exist.
    InputError
        If the robot's files are not installed.
    """
    if name not in _ROBOTS:
        raise UnknownNameError("robot", name, _ROBOTS, "the catalogue (a path must end in .urdf)")
    shipped = _ROBOTS[name]
    if shipped.ours:
        folder = robots_folder()
    else:
        share = example_robot_data()
        if share is None:
            raise InputError(f"robot {name!r} comes with example-robot-data, which is not installed here")
        folder = share / "example-robot-data" / "robots"
    srdf = None if shipped.srdf is None else folder / shipped.srdf
    return CatalogueEntry(name, folder / shipped.urdf, srdf, shipped.tcp, shipped.home)


def robots_folder() -> Path:
    """The folder ``robots/`` of this installation: inside the package in a wheel, beside ``src/`` in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "robots", package.parents[1] / "robots"):
        if folder.is_dir():
            return folder
    raise InputError(f"the folder robots/ is neither in {package} nor in {package.parents[1]}: reinstall pinproof")
