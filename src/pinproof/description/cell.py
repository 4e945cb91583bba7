"""Descriptions made of others: robots in one kinematic tree, and robots with further joints at their root link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pinproof.description.srdf import DisabledPair, EndEffector, GroupState, Srdf, SrdfGroup
from pinproof.description.urdf import JointType, LinkGeometry, Urdf, UrdfJoint, origin, urdf_of
from pinproof.description.xml_reader import add_joint, numbers_text, origin_attributes, parse_text
from pinproof.errors import InputError
from pinproof.spatial import Array

WORLD = "world"
"""The root link of a cell."""

CELL = "placement_cell"
"""The root link of a description with a movable base."""

PLACEMENT_JOINTS = ("placement_x", "placement_y", "placement_z", "placement_yaw")
"""The joints from the cell to the base, in this order: three prismatic ones (m), and a revolute one about z (rad)."""

MOUNTING = "placement_mounting"

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


def cell_urdf(name: str, robots: Mapping[str, tuple[Urdf, Array]]) -> Urdf:
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
        # a fixed joint carries the root of the robot
        mount = add_joint(root, f"{prefix}mount", "fixed", WORLD, prefix + urdf.root)
        etree.SubElement(mount, "origin", origin_attributes(world_from_root))
        # its elements, with a prefix before each name and the absolute paths of the meshes
        meshes = {g.mesh.uri: g.mesh.path for g in (*urdf.visuals, *urdf.collisions) if g.mesh is not None}
        copies = [deepcopy(part) for part in parse_text(urdf.text, urdf.name) if part.tag in KEPT]
        for element in (inner for part in copies for inner in part.iter(*NAMED, "mesh")):
            for attribute in NAMED.get(element.tag, ()):
                if value := str(element.get(attribute) or "").strip():
                    element.set(attribute, prefix + value)
            if element.tag == "mesh":
                path = meshes.get(str(element.get("filename", "")).strip())
                if path is not None:
                    element.set("filename", str(path.resolve()))
        root.extend(copies)
    return urdf_of(root, f"cell {name}", None)


def cell_srdf(srdfs: Mapping[str, Srdf]) -> Srdf:
    """Return the pairs, groups, states and end effectors of several robots, with a prefix before each name."""
    disabled: list[DisabledPair] = []
    groups: dict[str, SrdfGroup] = {}
    states: list[GroupState] = []
    effectors: list[EndEffector] = []
    links: list[str] = []
    for prefix, srdf in srdfs.items():

        def named(names: tuple[str, ...], prefix: str = prefix) -> tuple[str, ...]:
            return tuple(prefix + name for name in names)

        disabled += [replace(pair, links=(prefix + pair.links[0], prefix + pair.links[1])) for pair in srdf.disabled]
        for group in srdf.groups.values():
            chains = tuple((prefix + base, prefix + tip) for base, tip in group.chains)
            groups[prefix + group.name] = SrdfGroup(
                prefix + group.name, named(group.joints), chains, named(group.links), named(group.missing)
            )
        for state in srdf.states:
            joints = {prefix + joint: values for joint, values in state.joints.items()}
            states.append(GroupState(state.name, prefix + state.group, joints))
        effectors += [EndEffector(e.name, prefix + e.parent_link, prefix + e.group) for e in srdf.end_effectors]
        links += named(srdf.disabled_links)
    return Srdf(None, tuple(disabled), groups, tuple(states), tuple(effectors), tuple(links))


class Axis(NamedTuple):
    """A joint that is added to the root link of a description, and the link behind it."""

    link: str
    """Name of the link. At 0 it has the axes of the root link, and its origin is ``point``."""
    type: JointType
    """Type of the joint in the URDF."""
    direction: Array
    """(3,) the unit vector of the axis in the frame of the root link."""
    point: Array
    """(3,) a point (m) on the axis in the frame of the root link."""
    lower: float
    upper: float


class _AddedJoint(NamedTuple):
    joint: UrdfJoint
    origin: Array
    """(4, 4) the pose of the child link in the parent link at 0."""
    axis: Array | None = None
    """(3,) the unit vector of the axis in the child link; None for a fixed joint."""


def urdf_with_axes(urdf: Urdf, axes: Mapping[str, Axis]) -> Urdf:
    """Return a description with further joints, by name, at the root link."""
    added = []
    for name, axis in axes.items():
        lower, upper = (None, None) if axis.type == "continuous" else (axis.lower, axis.upper)
        joint = UrdfJoint(name, axis.type, urdf.root, axis.link, lower, upper, None, None)
        origin = np.eye(4)
        origin[:3, 3] = axis.point
        added.append(_AddedJoint(joint, origin, axis.direction))
    return _extended(urdf, [axis.link for axis in axes.values()], added)


def with_movable_base(urdf: Urdf, mounting: Array, mount: Sequence[LinkGeometry] = ()) -> Urdf:
    """Return a description with the root link :data:`CELL`, from which :data:`PLACEMENT_JOINTS` lead to the old root.

    Parameters
    ----------
    urdf
        The robot.
    mounting
        (4, 4) the pose of the old root behind the placement joints, such as that of a robot on a wall.
    mount
        Bodies that move with the base, each on a separate link that is fixed to the old root; their origins are
        ``root_from_geometry``.

    Raises
    ------
    InputError
        If the robot already has links or joints of these names.
    """
    ends = [CELL, *(f"{name}_link" for name in PLACEMENT_JOINTS)]
    mounts = list(dict.fromkeys(part.link for part in mount))
    directions = np.eye(3)[[0, 1, 2, 2]]
    added = []
    for number, (name, direction) in enumerate(zip(PLACEMENT_JOINTS, directions, strict=True)):
        joint = _unlimited(name, "revolute" if number == 3 else "prismatic", ends[number], ends[number + 1])
        added.append(_AddedJoint(joint, np.eye(4), direction))
    added.append(_AddedJoint(_unlimited(MOUNTING, "fixed", ends[-1], urdf.root), mounting))
    added += [_AddedJoint(_unlimited(f"{link} (mount)", "fixed", urdf.root, link), np.eye(4)) for link in mounts]
    extended = _extended(urdf, [*ends, *mounts], added)
    return replace(extended, root=CELL, collisions=(*urdf.collisions, *mount), visuals=(*urdf.visuals, *mount))


def with_frame(urdf: Urdf, name: str, parent: str, placement: Array) -> Urdf:
    """Return a description with a link without bodies that is fixed to another one; ``placement`` is parent_from_link.

    Raises
    ------
    InputError
        If the robot already has a link or a joint of this name.
    """
    joint = _unlimited(f"{name} (mount)", "fixed", parent, name)
    return _extended(urdf, [name], [_AddedJoint(joint, placement)])


def with_spin(urdf: Urdf, name: str, parent: str) -> Urdf:
    """Return a description with a link that rotates about the z axis of another one without limits.

    Raises
    ------
    InputError
        If the robot already has a link or a joint of this name.
    """
    joint = _unlimited(f"{name} (joint)", "continuous", parent, name)
    return _extended(urdf, [name], [_AddedJoint(joint, np.eye(4), np.eye(3)[2])])


def rerooted(urdf: Urdf, root: str) -> Urdf:
    """Return the kinematics of a robot, without bodies, with another link as the root; joints keep names and values.

    The joints from the old root to the new one connect their links in the opposite order. The inverse of the motion of
    a joint is that about, or along, the opposite axis.
    """
    from lxml import etree

    robot = parse_text(urdf.text, urdf.name)
    for link in robot.findall("link"):
        for part in list(link):
            link.remove(part)
    elements = {str(each.get("name")).strip(): each for each in robot.findall("joint")}
    while (joint := urdf.parent_joint(root)) is not None:
        element, placement = elements[joint.name], np.eye(4)
        placement[:3, :3], placement[:3, 3] = origin(element, urdf.name)
        for part in element.findall("origin"):
            element.remove(part)
        element.find("parent").set("link", joint.child)
        fixed = element
        if joint.type != "fixed":  # a link at the joint, behind it, and the old parent fixed to that
            at_joint, axis = f"{joint.name} (reversed)", element.find("axis")
            axis = etree.SubElement(element, "axis", xyz="1 0 0") if axis is None else axis
            axis.set("xyz", numbers_text(-np.array([float(part) for part in str(axis.get("xyz")).split()])))
            etree.SubElement(robot, "link", name=at_joint)
            element.find("child").set("link", at_joint)
            fixed = add_joint(robot, f"{joint.name} (mount)", "fixed", at_joint, joint.parent)
        fixed.find("child").set("link", joint.parent)
        etree.SubElement(fixed, "origin", origin_attributes(np.asarray(np.linalg.inv(placement))))
        root = joint.parent
    return urdf_of(robot, f"{urdf.name} as seen from another link", None)


def _unlimited(name: str, kind: JointType, parent: str, child: str) -> UrdfJoint:
    return UrdfJoint(name, kind, parent, child, None, None, None, None)


def _extended(urdf: Urdf, links: Sequence[str], added: Sequence[_AddedJoint]) -> Urdf:
    """Return a description with more links and joints; InputError if it already has links or joints of these names."""
    from lxml import etree

    joints = {step.joint.name: step.joint for step in added}
    # names must stay unique
    if taken := {*urdf.links, *urdf.joints} & {*links, *joints}:
        raise InputError(f"robot {urdf.name!r} already has links or joints named {', '.join(sorted(taken))}")
    larger = replace(urdf, links=(*urdf.links, *links), joints={**urdf.joints, **joints})

    def text_of(text: str, names: Mapping[str, str], kinds: Mapping[str, str]) -> str:
        robot = etree.fromstring(text)
        for link in links:
            etree.SubElement(robot, "link", name=link)
        for joint, place, axis in added:
            kind = kinds.get(joint.type, joint.type)
            element = add_joint(robot, names.get(joint.name, joint.name), kind, joint.parent, joint.child)
            etree.SubElement(element, "origin", origin_attributes(place))
            if axis is not None:
                etree.SubElement(element, "axis", xyz=numbers_text(axis))
                lower, upper = (
                    free if bound is None else repr(bound)
                    for bound, free in ((joint.lower, "-1e9"), (joint.upper, "1e9"))
                )
                etree.SubElement(element, "limit", lower=lower, upper=upper, velocity="1e9", effort="1e9")
        return str(etree.tostring(robot, encoding="unicode"))

    # Pinocchio reads joints under other names if a link has the same, and continuous joints as revolute ones
    in_model = {name: larger.model_joint(name) for name in joints}
    return replace(
        larger,
        kinematics=text_of(urdf.kinematics, in_model, {"continuous": "revolute"}),
        text=text_of(urdf.text, {}, {}),
    )
