"""The description of a cell: several robots in one kinematic tree, with the names of the robots as prefixes."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pinproof.description.dh_urdf import rpy_of
from pinproof.description.srdf import DisabledPair, EndEffector, Group, GroupState, Srdf
from pinproof.description.urdf import Urdf, urdf_of
from pinproof.description.xml_reader import Element, parse_text

WORLD = "world"
"""The root link of a cell."""

NAMED = {
    "link": ("name",),
    "joint": ("name",),
    "parent": ("link",),
    "child": ("link",),
    "mimic": ("joint",),
    "material": ("name",),
}
"""The attributes of URDF elements that hold a name."""

KEPT = ("link", "joint", "material")
"""The elements of a robot that a cell takes over; others, such as transmissions, have no effect on its motion."""


def cell_urdf(name: str, robots: Mapping[str, tuple[Urdf, npt.NDArray[np.float64]]]) -> Urdf:
    """Return the description of robots that are fixed to a common root link, :data:`WORLD`.

    Parameters
    ----------
    name
        Name of the cell.
    robots
        For each prefix (such as ``"left/"``) a description and ``world_from_root`` (4, 4), the pose of its root link.
    """
    from lxml import etree

    root = etree.Element("robot", name=name)
    etree.SubElement(root, "link", name=WORLD)
    for prefix, (urdf, world_from_root) in robots.items():
        mount = etree.SubElement(root, "joint", name=f"{prefix}mount", type="fixed")
        etree.SubElement(mount, "parent", link=WORLD)
        etree.SubElement(mount, "child", link=prefix + urdf.root)
        xyz, rpy = world_from_root[:3, 3], np.array(rpy_of(world_from_root[:3, :3]))
        etree.SubElement(mount, "origin", xyz=_text(xyz), rpy=_text(rpy))
        root.extend(_prefixed(urdf, prefix))
    return urdf_of(root, f"cell {name}", None)


class Axis(NamedTuple):
    """A joint that is added to the root link of a description, and the link behind it."""

    link: str
    """Name of the link. At 0 it has the axes of the root link, and its origin is ``point``."""
    type: str
    """Type of the joint in the URDF."""
    direction: npt.NDArray[np.float64]
    """(3,) the axis in the frame of the root link."""
    point: npt.NDArray[np.float64]
    """(3,) a point (m) on the axis in the frame of the root link."""
    lower: float
    upper: float


def urdf_with_axes(urdf: Urdf, axes: Mapping[str, Axis]) -> Urdf:
    """Return a description with further joints, by name, at the root link."""
    from lxml import etree

    root = etree.Element("robot", name=urdf.name)
    root.extend(_prefixed(urdf, ""))
    for name, axis in axes.items():
        etree.SubElement(root, "link", name=axis.link)
        joint = etree.SubElement(root, "joint", name=name, type=axis.type)
        etree.SubElement(joint, "parent", link=urdf.root)
        etree.SubElement(joint, "child", link=axis.link)
        etree.SubElement(joint, "origin", xyz=_text(axis.point), rpy="0 0 0")
        etree.SubElement(joint, "axis", xyz=_text(axis.direction))
        limits = {"lower": repr(axis.lower), "upper": repr(axis.upper)}
        etree.SubElement(joint, "limit", **limits, velocity="0", effort="0")
    return urdf_of(root, f"{urdf.name} with movers", None)


def _prefixed(urdf: Urdf, prefix: str) -> list[Element]:
    """Return the links and joints of a robot with a prefix before each name, and absolute paths of the meshes."""
    found = {g.mesh.uri: g.mesh.path for g in (*urdf.visuals, *urdf.collisions) if g.mesh is not None}
    elements = [deepcopy(each) for each in parse_text(urdf.text, urdf.name) if each.tag in KEPT]
    for element in (each for top in elements for each in top.iter(*NAMED, "mesh")):
        for attribute in NAMED.get(element.tag, ()):
            if stated := str(element.get(attribute) or "").strip():
                element.set(attribute, prefix + stated)
        if element.tag == "mesh":
            path = found.get(str(element.get("filename", "")).strip())
            if path is not None:
                element.set("filename", str(path.resolve()))
    return elements


def _text(values: npt.NDArray[np.float64]) -> str:
    return " ".join(repr(float(value)) for value in values)


def cell_srdf(srdfs: Mapping[str, Srdf]) -> Srdf:
    """Return the pairs, groups, states and end effectors of several robots, with a prefix before each name."""
    disabled: list[DisabledPair] = []
    groups: dict[str, Group] = {}
    states: list[GroupState] = []
    effectors: list[EndEffector] = []
    links: list[str] = []
    for prefix, srdf in srdfs.items():

        def named(names: tuple[str, ...], prefix: str = prefix) -> tuple[str, ...]:
            return tuple(prefix + name for name in names)

        disabled += [replace(each, links=(prefix + each.links[0], prefix + each.links[1])) for each in srdf.disabled]
        for each in srdf.groups.values():
            chains = tuple((prefix + base, prefix + tip) for base, tip in each.chains)
            groups[prefix + each.name] = Group(
                prefix + each.name, named(each.joints), chains, named(each.links), named(each.missing)
            )
        for state in srdf.states:
            joints = {prefix + joint: values for joint, values in state.joints.items()}
            states.append(GroupState(state.name, prefix + state.group, joints))
        effectors += [EndEffector(e.name, prefix + e.parent_link, prefix + e.group) for e in srdf.end_effectors]
        links += named(srdf.disabled_links)
    return Srdf(None, tuple(disabled), groups, tuple(states), tuple(effectors), tuple(links))
