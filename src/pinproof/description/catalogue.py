"""Robots by name, from the catalogue, and the reading of a description of any format.

The catalogue has for each name its files, the tcp frame and a home configuration, read from
``catalogue.yaml`` and ``catalogue_overlaps.yaml`` in this folder.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pinproof.common.structs import described, key
from pinproof.description.mjcf import read_mjcf
from pinproof.description.ros_files import example_robot_data
from pinproof.description.srdf import Srdf
from pinproof.description.urdf import Urdf, read_urdf
from pinproof.description.xml_reader import parse_file
from pinproof.errors import InputError, UnknownNameError
from pinproof.units import refuse_degree_limit, refuse_millimetres

OVERLAP_REASON = "catalogue: overlaps by design"
"""The reason with which the catalogue excludes a pair of links."""


SIDES = ("left", "right")
"""The suffixes of the two entries of a robot with two arms."""


@described()
class CatalogueEntry:
    """A robot of the catalogue."""

    name: str = key("name in the catalogue")
    urdf: Path = key("its URDF file")
    srdf: Path | None = key("its SRDF file")
    tcp: str = key("default tcp of ``robot.arm()``")
    home: Mapping[str, float] = key(
        "home configuration without self-collision: joint name to value (rad or m)", default_factory=dict
    )
    base: str | None = key(
        "default base of ``robot.arm()`` if the tcp is a descendant of it; None for the root link", default=None
    )
    overlaps: tuple[tuple[str, str], ...] = key(
        "pairs of links whose collision geometry overlaps by design (`pinproof info --overlaps`)", default=()
    )
    arms: Mapping[str, str] = key(
        "the tcp frames of the arms of ``robot.arms()`` by name, for a robot with several", default_factory=dict
    )


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
    # a robot with two arms has an entry for each of them
    stem, _, side = name.rpartition("_")
    both = {arm: f"{stem}_{arm}" for arm in SIDES}
    if side not in SIDES or not all(entry in robots for entry in both.values()):
        both = {}
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
        {arm: robots[entry]["tcp"] for arm, entry in both.items()},
    )


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

    # libyaml, which PyYAML usually has, reads it ten times as fast
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return dict(yaml.load(Path(__file__).with_name(file).read_text(encoding="utf-8"), Loader=loader))


def _file(name: str, path: str) -> Path:
    """Resolve a path of the catalogue: ``robots/...`` is in this repository, others are in example-robot-data."""
    if path.startswith("robots/"):
        return robots_folder() / path.removeprefix("robots/")
    share = example_robot_data()
    if share is None:
        raise InputError(f"robot {name!r} requires example-robot-data: pip install example-robot-data")
    return share / "example-robot-data" / "robots" / path


# -- descriptions of any format ---------------------------------------------------------------------------------------


NAMED = 5
"""Largest number of names that a note lists."""


def notes(urdf: Urdf, srdf: Srdf) -> tuple[str, ...]:
    """Return sentences on missing meshes, limits that are probably in degrees, and unknown names in the SRDF."""
    # meshes that were not found
    lines: list[str] = []
    for kind, geometries in (("collision", urdf.collisions), ("visual", urdf.visuals)):
        lost = [g for g in geometries if g.mesh is not None and g.mesh.path is None]
        if lost:
            uris = list(dict.fromkeys(g.mesh.uri for g in lost if g.mesh is not None))
            how = "; use / in paths, not \\" if any("\\" in uri for uri in uris) else ""
            meshes = "mesh was" if len(lost) == 1 else "meshes were"
            lines.append(f"{len(lost)} {kind} {meshes} not found: {_listed(uris)}{how}")
    # limits that are probably in other units
    for joint in urdf.joints.values():
        limits = [limit for limit in (joint.lower, joint.upper) if limit is not None]
        try:
            if joint.type == "prismatic":
                refuse_millimetres(f"limit of joint {joint.name!r}", limits)
            for limit in limits if joint.type == "revolute" else ():
                refuse_degree_limit(f"limit of joint {joint.name!r}", limit)
        except InputError as odd:
            lines.append(str(odd))
    # names in the SRDF that the robot does not have
    links, joints = set(urdf.links), set(urdf.joints)
    pairs = [pair.links for pair in srdf.disabled if not links.issuperset(pair.links)]
    if pairs:
        unknown = [name for name in dict.fromkeys(n for pair in pairs for n in pair) if name not in links]
        lines.append(
            f"the SRDF disables {len(pairs)} pairs with links that the robot does not have: {_listed(unknown)}"
        )
    for group in srdf.groups.values():
        if group.missing:
            lines.append(f"SRDF group {group.name!r} contains undefined groups: {_listed(group.missing)}")
        ends = (end for chain in group.chains for end in chain)
        unknown = [n for n in (*group.links, *ends) if n not in links] + [n for n in group.joints if n not in joints]
        if unknown:
            lines.append(f"SRDF group {group.name!r} refers to links or joints that do not exist: {_listed(unknown)}")
    for state in srdf.states:
        unknown = [name for name in state.joints if name not in joints]
        if unknown:
            lines.append(f"SRDF state {state.name!r} refers to joints that do not exist: {_listed(unknown)}")
    for effector in srdf.end_effectors:
        if effector.parent_link not in links:
            lines.append(f"parent link {effector.parent_link!r} of SRDF end effector {effector.name!r} does not exist")
    if srdf.disabled_links:
        lines.append(
            f"the SRDF disables all pairs of {_listed(srdf.disabled_links)} by default; they are checked nevertheless"
        )
    return tuple(lines)


def _listed(names: Sequence[str]) -> str:
    more = f", ... ({len(names)} in all)" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def read_description(
    path: Path, *, package_dirs: Sequence[str | Path] = (), xacro_args: Mapping[str, str] | None = None
) -> tuple[Urdf, Srdf]:
    """Read a URDF, xacro or MJCF file; for MJCF, excluded contacts and keyframes are returned as an SRDF (else empty).

    Raises
    ------
    UrdfError
        If the file is invalid; the message states the line.
    InputError
        If the extra for the format, ``xacro`` or ``mjcf``, is not installed.
    """
    if path.suffix in (".xml", ".mjcf") and parse_file(path).tag == "mujoco":
        return read_mjcf(path)
    return read_urdf(path, package_dirs=package_dirs, xacro_args=xacro_args), Srdf()
