"""What an SRDF says about a robot: groups, named states, end effectors, and pairs of links not to be checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pinproof.description.xml_reader import Element, number, parse_file, place, required
from pinproof.errors import UnknownNameError, UrdfError

__all__ = ["DisabledPair", "EndEffector", "Group", "Srdf", "read_srdf"]


@dataclass(frozen=True)
class DisabledPair:
    """Two links that the SRDF takes out of collision checking, and the reason it gives (empty when none)."""

    links: tuple[str, str]
    reason: str


@dataclass(frozen=True)
class Group:
    """A planning group: its joints by name, or a chain from a base link to a tip link."""

    name: str
    joints: tuple[str, ...] = ()
    chain: tuple[str, str] | None = None


@dataclass(frozen=True)
class EndEffector:
    """An end effector and the link it hangs on: the tcp that a group declares."""

    name: str
    parent_link: str
    group: str


@dataclass(frozen=True)
class Srdf:
    """The parts of an SRDF that planning needs."""

    path: Path | None = None
    disabled: tuple[DisabledPair, ...] = ()
    groups: Mapping[str, Group] = field(default_factory=dict)
    states: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    end_effectors: tuple[EndEffector, ...] = ()


def read_srdf(path: str | Path) -> Srdf:
    """Read an SRDF.

    Raises
    ------
    UrdfError
        If the file is missing, is no XML, or lacks a name or number where one must stand; names file and line.
    """
    path = Path(path)
    root = parse_file(path)
    if root.tag != "robot":
        raise UrdfError(path, f"the root element is <{root.tag}>, not <robot>: this is no SRDF", place(root))
    disabled = [
        DisabledPair((required(e, "link1", path), required(e, "link2", path)), e.get("reason", ""))
        for e in root.findall("disable_collisions")
    ]
    groups = {required(e, "name", path): _group(e, path) for e in root.findall("group")}
    states: dict[str, Mapping[str, float]] = {}
    for e in root.findall("group_state"):
        joints = {required(j, "name", path): number(j, "value", path) for j in e.findall("joint")}
        states[required(e, "name", path)] = joints
    effectors = [
        EndEffector(
            required(e, "name", path), required(e, "parent_link", path), e.get("parent_group", e.get("group", ""))
        )
        for e in root.findall("end_effector")
    ]
    flat = {name: _flatten(name, groups, root, path, ()) for name in groups}
    return Srdf(path, tuple(disabled), flat, states, tuple(effectors))


def _group(element: Element, path: Path) -> Group:
    joints = tuple(required(j, "name", path) for j in element.findall("joint"))
    chains = element.findall("chain")
    chain = (required(chains[0], "base_link", path), required(chains[0], "tip_link", path)) if chains else None
    return Group(required(element, "name", path), joints, chain)


def _flatten(name: str, groups: Mapping[str, Group], root: Element, path: Path, seen: tuple[str, ...]) -> Group:
    """Join the joints of subgroups into their group."""
    if name in seen:
        raise UrdfError(path, f"the groups {' -> '.join((*seen, name))} contain each other")
    if name not in groups:
        raise UrdfError(path, str(UnknownNameError("group", name, groups)))
    group = groups[name]
    element = next(e for e in root.findall("group") if required(e, "name", path) == name)
    joints, chain = list(group.joints), group.chain
    for sub in element.findall("group"):
        part = _flatten(required(sub, "name", path), groups, root, path, (*seen, name))
        joints += [j for j in part.joints if j not in joints]
        chain = chain or part.chain
    return Group(name, tuple(joints), chain)
