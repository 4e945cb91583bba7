"""What an SRDF group means on the tree of links: one chain, from a base link to a tip link."""

from __future__ import annotations

from collections.abc import Sequence

from pinproof.description import Srdf, Urdf
from pinproof.errors import InputError, UnknownNameError

__all__ = ["group_ends"]


def group_ends(urdf: Urdf, srdf: Srdf, name: str) -> tuple[str, str]:
    """Base and tip link of a group; an end effector that is declared for the group wins over the chain's tip.

    A group of joints or links is a chain if these lie on one way outwards; as in MoveIt, a link brings the joint that
    carries it.

    Raises
    ------
    UnknownNameError
        If the group, or something it names, does not exist.
    InputError
        If it names nothing, or joints that do not lie on one way from the root outwards.
    """
    group = srdf.groups.get(name)
    if group is None:
        raise UnknownNameError("group", name, srdf.groups, f"the SRDF of robot {urdf.name!r}")
    if group.missing:
        raise UnknownNameError("subgroup", group.missing[0], srdf.groups, f"group {name!r} of the SRDF")
    for kind, named, known in (
        ("joint", group.joints, urdf.joints),
        ("link", (*group.links, *(end for chain in group.chains for end in chain)), urdf.links),
    ):
        for word in named:
            if word not in known:
                raise UnknownNameError(kind, word, known, f"group {name!r} of the SRDF")
    declared = [e.parent_link for e in srdf.end_effectors if e.group == name]
    if len(group.chains) == 1:
        base, tip = group.chains[0]
    elif group.chains:
        raise InputError(f"group {name!r} holds the chains {list(group.chains)}; name one of them with base= and tcp=")
    else:
        base, tip = _ends_of_joints(urdf, name, _joints(urdf, group.joints, group.links))
    return base, declared[0] if declared else tip


def _joints(urdf: Urdf, joints: Sequence[str], links: Sequence[str]) -> list[str]:
    carriers = [joint.name for joint in map(urdf.parent_joint, links) if joint is not None]
    return list(dict.fromkeys([*joints, *carriers]))


def _ends_of_joints(urdf: Urdf, name: str, joints: Sequence[str]) -> tuple[str, str]:
    """The parent of the innermost joint and the child of the outermost."""
    if not joints:
        raise InputError(f"group {name!r} names neither a chain nor joints nor links that move; give tcp=")
    above = {joint: _joints_above(urdf, joint) for joint in joints}
    outermost = max(joints, key=lambda joint: len(above[joint]))
    aside = [joint for joint in joints if joint not in above[outermost]]
    if aside:
        raise InputError(
            f"group {name!r} is no chain: {aside[0]!r} does not lie on the way to {outermost!r}; name base= and tcp="
        )
    innermost = min(joints, key=lambda joint: len(above[joint]))
    return urdf.joints[innermost].parent, urdf.joints[outermost].child


def _joints_above(urdf: Urdf, joint: str) -> list[str]:
    """The joint itself and all on the way to the root."""
    way, carrier = [joint], urdf.parent_joint(urdf.joints[joint].parent)
    while carrier is not None:
        way.append(carrier.name)
        carrier = urdf.parent_joint(carrier.parent)
    return way
