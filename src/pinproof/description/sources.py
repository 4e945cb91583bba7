"""Reading a robot description of any format, and notes on inconsistencies that are not errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from pinproof.description.mjcf import read_mjcf
from pinproof.description.srdf import Srdf
from pinproof.description.urdf import Urdf, read_urdf
from pinproof.description.xml_reader import parse_file
from pinproof.errors import InputError
from pinproof.units import refuse_degree_limit, refuse_millimetres

NAMED = 5
"""Largest number of names that a note lists."""


def notes(urdf: Urdf, srdf: Srdf) -> tuple[str, ...]:
    """Return sentences on missing meshes, limits that are probably in degrees, and unknown names in the SRDF."""
    found: list[str] = []
    for kind, geometries in (("collision", urdf.collisions), ("visual", urdf.visuals)):
        lost = [g for g in geometries if g.mesh is not None and g.mesh.path is None]
        if lost:
            uris = list(dict.fromkeys(g.mesh.uri for g in lost if g.mesh is not None))
            how = "; use / in paths, not \\" if any("\\" in uri for uri in uris) else ""
            meshes = "mesh was" if len(lost) == 1 else "meshes were"
            found.append(f"{len(lost)} {kind} {meshes} not found: {_listed(uris)}{how}")
    for joint in urdf.joints.values():
        limits = [limit for limit in (joint.lower, joint.upper) if limit is not None]
        try:
            if joint.type == "prismatic":
                refuse_millimetres(f"limit of joint {joint.name!r}", limits)
            for limit in limits if joint.type == "revolute" else ():
                refuse_degree_limit(f"limit of joint {joint.name!r}", limit)
        except InputError as odd:
            found.append(str(odd))
    links, joints = set(urdf.links), set(urdf.joints)
    pairs = [pair.links for pair in srdf.disabled if not links.issuperset(pair.links)]
    if pairs:
        unknown = [name for name in dict.fromkeys(n for pair in pairs for n in pair) if name not in links]
        found.append(
            f"the SRDF disables {len(pairs)} pairs with links that the robot does not have: {_listed(unknown)}"
        )
    for group in srdf.groups.values():
        if group.missing:
            found.append(f"SRDF group {group.name!r} contains undefined groups: {_listed(group.missing)}")
        ends = (end for chain in group.chains for end in chain)
        unknown = [n for n in (*group.links, *ends) if n not in links] + [n for n in group.joints if n not in joints]
        if unknown:
            found.append(f"SRDF group {group.name!r} refers to links or joints that do not exist: {_listed(unknown)}")
    for state in srdf.states:
        unknown = [name for name in state.joints if name not in joints]
        if unknown:
            found.append(f"SRDF state {state.name!r} refers to joints that do not exist: {_listed(unknown)}")
    for effector in srdf.end_effectors:
        if effector.parent_link not in links:
            found.append(f"parent link {effector.parent_link!r} of SRDF end effector {effector.name!r} does not exist")
    if srdf.disabled_links:
        found.append(
            f"the SRDF disables all pairs of {_listed(srdf.disabled_links)} by default; they are checked nevertheless"
        )
    return tuple(found)


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
