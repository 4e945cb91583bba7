"""What is odd about a description, though nothing in it had to be refused: said once, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from pinproof.description.srdf import Srdf
from pinproof.description.units import refuse_degree_limit
from pinproof.description.urdf import Urdf
from pinproof.errors import InputError

__all__ = ["notes"]

NAMED = 5
"""How many names a sentence lists before it only counts."""


def notes(urdf: Urdf, srdf: Srdf) -> tuple[str, ...]:
    """Sentences on meshes that were not found, and on what the SRDF names that the URDF does not have."""
    said: list[str] = []
    for kind, geometries in (("collision", urdf.collisions), ("visual", urdf.visuals)):
        lost = [g for g in geometries if g.mesh is not None and g.mesh.path is None]
        if lost:
            uris = list(dict.fromkeys(g.mesh.uri for g in lost if g.mesh is not None))
            how = "; paths have / and not \\" if any("\\" in uri for uri in uris) else ""
            said.append(f"{len(lost)} {kind} meshes were not found: {_some(uris)}{how}")
    for joint in urdf.joints.values():
        try:
            for limit in (joint.lower, joint.upper) if joint.type == "revolute" else ():
                refuse_degree_limit(f"limit of joint {joint.name!r}", limit)
        except InputError as odd:
            said.append(str(odd))
    links, joints = set(urdf.links), set(urdf.joints)
    pairs = [pair.links for pair in srdf.disabled if not links.issuperset(pair.links)]
    if pairs:
        unknown = [name for name in dict.fromkeys(n for pair in pairs for n in pair) if name not in links]
        said.append(f"the SRDF disables {len(pairs)} pairs of links that the robot does not have: {_some(unknown)}")
    for group in srdf.groups.values():
        if group.missing:
            said.append(f"SRDF group {group.name!r} holds groups that the SRDF does not: {_some(group.missing)}")
        ends = (end for chain in group.chains for end in chain)
        unknown = [n for n in (*group.links, *ends) if n not in links] + [n for n in group.joints if n not in joints]
        if unknown:
            said.append(f"SRDF group {group.name!r} names what the robot does not have: {_some(unknown)}")
    for state in srdf.states:
        unknown = [name for name in state.joints if name not in joints]
        if unknown:
            said.append(f"SRDF state {state.name!r} names joints that the robot does not have: {_some(unknown)}")
    for effector in srdf.end_effectors:
        if effector.parent_link not in links:
            said.append(f"SRDF end effector {effector.name!r} hangs on {effector.parent_link!r}, which does not exist")
    if srdf.disabled_links:
        said.append(f"the SRDF disables all pairs of {_some(srdf.disabled_links)} by default; they are checked")
    return tuple(said)


def _some(names: Sequence[str]) -> str:
    more = f", ... ({len(names)} in all)" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more
