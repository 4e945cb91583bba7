"""SRDF files: groups, named states, end effectors, and link pairs excluded from collision checking."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from pinproof.common.validation import ReadOnlyDict
from pinproof.description.xml_reader import Element, numbers, parse_file, place, required
from pinproof.errors import UrdfError

T = TypeVar("T")

DEEPEST = 100
"""Largest nesting depth of groups."""


@dataclass(frozen=True)
class DisabledPair:
    """Two links that the SRDF excludes from collision checking, and the stated reason (may be empty)."""

    links: tuple[str, str]
    reason: str


@dataclass(frozen=True)
class SrdfGroup:
    """A planning group including its subgroups: joints and links by name, chains from a base link to a tip link.

    ``missing`` lists subgroups that the file does not define; such a group cannot be used.
    """

    name: str
    joints: tuple[str, ...] = ()
    chains: tuple[tuple[str, str], ...] = ()
    links: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class GroupState:
    """A named state of a group: joint name to values, one value for each degree of freedom of the joint."""

    name: str
    group: str
    joints: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class EndEffector:
    """An end effector and its parent link, which is the tcp of the group."""

    name: str
    parent_link: str
    group: str


GROUPS_READ_ONLY = "the groups of a robot are read-only; load a changed SRDF"


@dataclass(frozen=True)
class Srdf:
    """The contents of an SRDF that are used for planning.

    Pairs that the file enables explicitly are not in ``disabled``. ``disabled_links`` are the links whose pairs are
    disabled by default; these pairs are checked nevertheless, unless they are in ``disabled`` too.
    """

    path: Path | None = None
    disabled: tuple[DisabledPair, ...] = ()
    groups: Mapping[str, SrdfGroup] = field(default_factory=dict)
    states: tuple[GroupState, ...] = ()
    end_effectors: tuple[EndEffector, ...] = ()
    disabled_links: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "groups", ReadOnlyDict(self.groups, GROUPS_READ_ONLY))

    def __repr__(self) -> str:
        path = "" if self.path is None else f"{self.path.name!r}, "
        counts = f"{len(self.groups)} groups, {len(self.states)} states, {len(self.disabled)} disabled pairs"
        return f"Srdf({path}{counts})"


def read_srdf(path: str | Path) -> Srdf:
    """Read an SRDF.

    Raises
    ------
    UrdfError
        If the file is missing, is not XML, is a URDF, or lacks a required name or number; the message states the line.
    """
    path = Path(path)
    root = parse_file(path)
    link = root.find("link")
    if link is not None:  # a URDF has the same root element and would be read as an empty SRDF
        raise UrdfError(path, "contains links: this is a URDF, not an SRDF", place(link))
    return srdf_of(root, path)


def srdf_of(root: Element, path: Path) -> Srdf:
    """Read the SRDF from an XML element; ``path`` is used in errors."""
    if root.tag != "robot":
        raise UrdfError(path, f"is not an SRDF: the root element is <{root.tag}>, not <robot>", place(root))
    # pairs that are disabled, and not enabled again
    enabled = {frozenset(_pair(e, path)) for e in root.findall("enable_collisions")}
    disabled = [
        DisabledPair(_pair(e, path), e.get("reason", ""))
        for e in root.findall("disable_collisions")
        if frozenset(_pair(e, path)) not in enabled
    ]
    # groups may be stated in several elements, and contain other groups
    elements: dict[str, list[Element]] = {}
    for e in root.findall("group"):
        elements.setdefault(required(e, "name", path), []).append(e)
    groups: dict[str, SrdfGroup] = {}
    for name in elements:
        _add_group(name, elements, groups, path, ())
    effectors = [
        EndEffector(
            required(e, "name", path), required(e, "parent_link", path), e.get("parent_group", e.get("group", ""))
        )
        for e in root.findall("end_effector")
    ]
    return Srdf(
        path,
        tuple(disabled),
        groups,
        tuple(_state(e, path) for e in root.findall("group_state")),
        tuple(effectors),
        tuple(required(e, "link", path) for e in root.findall("disable_default_collisions")),
    )


def _pair(element: Element, path: str | Path) -> tuple[str, str]:
    return required(element, "link1", path), required(element, "link2", path)


def _state(element: Element, path: Path) -> GroupState:
    joints = {
        required(j, "name", path): numbers(j, "value", len(j.get("value", "0").split()) or 1, path)
        for j in element.findall("joint")
    }
    return GroupState(required(element, "name", path), element.get("group", "").strip(), joints)


def _add_group(
    name: str,
    elements: Mapping[str, Sequence[Element]],
    groups: dict[str, SrdfGroup],
    path: Path,
    within: tuple[str, ...],
) -> SrdfGroup:
    """Add a group with the contents of its subgroups to ``groups``; duplicate definitions are combined."""
    if name in groups:
        return groups[name]
    if len(within) > DEEPEST:
        raise UrdfError(path, f"the groups {' -> '.join(within[:3])} -> ... are nested more than {DEEPEST} deep")
    if name in within:
        raise UrdfError(path, f"the groups {' -> '.join((*within, name))} contain each other")
    if name not in elements:
        return SrdfGroup(name, missing=(name,))
    # all elements of that name, with the groups they contain
    joints: list[str] = []
    links: list[str] = []
    missing: list[str] = []
    chains: list[tuple[str, str]] = []
    for element in elements[name]:
        joints += [required(j, "name", path) for j in element.findall("joint")]
        links += [required(part, "name", path) for part in element.findall("link")]
        chains += [(required(c, "base_link", path), required(c, "tip_link", path)) for c in element.findall("chain")]
        for sub in element.findall("group"):
            part = _add_group(required(sub, "name", path), elements, groups, path, (*within, name))
            joints += part.joints
            links += part.links
            chains += part.chains
            missing += part.missing
    groups[name] = SrdfGroup(name, _unique(joints), _unique(chains), _unique(links), _unique(missing))
    return groups[name]


def _unique(names: Sequence[T]) -> tuple[T, ...]:
    return tuple(dict.fromkeys(names))


def srdf_text(robot: str, srdf: Srdf, disabled: Sequence[DisabledPair]) -> str:
    """Return the XML text of an SRDF with more disabled pairs.

    Parameters
    ----------
    robot
        Name of the robot.
    srdf
        The present SRDF. If it was read from a file, all elements of the file are kept; otherwise its pairs.
    disabled
        The pairs to disable, where ``srdf`` does not disable them.
    """
    from lxml import etree

    root = etree.Element("robot", name=robot) if srdf.path is None else parse_file(srdf.path)
    stated = {frozenset(_pair(element, robot)) for element in root.findall("disable_collisions")}
    for pair in (*srdf.disabled, *disabled):
        if frozenset(pair.links) not in stated:
            stated.add(frozenset(pair.links))
            first, second = pair.links
            etree.SubElement(root, "disable_collisions", link1=first, link2=second, reason=pair.reason)
    etree.indent(root)
    return '<?xml version="1.0"?>\n' + str(etree.tostring(root, encoding="unicode")) + "\n"
