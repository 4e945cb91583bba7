"""A URDF on paper: read, checked element by element, and handed on only when nothing in it would be dropped or misread.

The parsers behind Pinocchio take a zero axis, a negative radius, ``lower > upper`` and unknown geometry without an
error; here each is refused with its line. What is kept is what the file says; kinematics begin in
:mod:`pinproof.model`.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pinproof.description.geometry import LinkGeometry
from pinproof.description.urdf_joints import JointType, Mimic, UrdfJoint, check_mimics, read_joint
from pinproof.description.urdf_links import read_links
from pinproof.description.xacro_files import expand_xacro
from pinproof.description.xml_reader import Element, number, numbers, parse_file, parse_text, place, required
from pinproof.errors import InputError, UrdfError

__all__ = ["MAX_LINKS", "JointType", "Mimic", "Urdf", "UrdfJoint", "read_urdf", "read_urdf_text", "urdf_of"]

MAX_LINKS = 1000
"""Longer robots are refused: urdfdom recurses once a link and ends the interpreter at about 5,000."""


@dataclass(frozen=True, eq=False)
class Urdf:
    """A robot description that has passed every check.

    ``kinematics`` is URDF text for Pinocchio: the same links, joints and inertias, without geometry; continuous joints
    stand as revolute ones, so that each joint is one angle, and mimic tags are left to :mod:`pinproof.model`.
    """

    name: str
    path: Path | None
    root: str
    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]
    collisions: tuple[LinkGeometry, ...]
    visuals: tuple[LinkGeometry, ...]
    kinematics: str

    def model_joint(self, joint: str) -> str:
        """The name of a joint in ``kinematics``: its own, unless a link has that name too, which Pinocchio refuses."""
        return _model_joint(joint, self.links)

    def parent_joint(self, link: str) -> UrdfJoint | None:
        """The joint that carries a link; None for the root."""
        return next((joint for joint in self.joints.values() if joint.child == link), None)


def read_urdf(
    path: str | Path, *, package_dirs: Sequence[str | Path] = (), xacro_args: Mapping[str, str] | None = None
) -> Urdf:
    """Read and check a URDF file, or a xacro file that expands to one.

    Parameters
    ----------
    path
        The file; a name that ends in ``.xacro`` is expanded first (the extra ``xacro``).
    package_dirs
        Folders that hold ROS packages, searched first for ``package://`` meshes.
    xacro_args
        What a xacro file is told for its ``<xacro:arg>``.

    Raises
    ------
    UrdfError
        With the line, for anything that would be misread or dropped.
    """
    path = Path(path)
    if path.suffix == ".xacro":
        name = f"{path} (expanded)"
        root = parse_text(expand_xacro(path, xacro_args or {}, [Path(d) for d in package_dirs]), name)
        return urdf_of(root, name, path, package_dirs)
    if xacro_args:
        raise InputError(f"{path} is no .xacro file, so it takes no xacro_args")
    return urdf_of(parse_file(path), path, path, package_dirs)


def read_urdf_text(text: str, *, name: str = "URDF text", package_dirs: Sequence[str | Path] = ()) -> Urdf:
    """Read and check URDF text; ``name`` stands for the file in errors."""
    return urdf_of(parse_text(text, name), name, None, package_dirs)


def urdf_of(root: Element, source: str | Path, path: Path | None, package_dirs: Sequence[str | Path] = ()) -> Urdf:
    """The URDF in an XML element: ``source`` is named in errors, meshes are looked for from the folder of ``path``."""
    if root.tag != "robot":
        raise UrdfError(source, f"the root element is <{root.tag}>, not <robot>: this is no URDF", place(root))
    macro = next((e for e in root.iter() if "xacro" in e.tag.rpartition("}")[0]), None)
    if macro is not None:
        raise UrdfError(source, "holds xacro macros, which would be dropped; expand it to a plain URDF", place(macro))
    link_elements = root.findall("link")
    if not link_elements:
        raise UrdfError(source, "holds no link: it describes no robot", place(root))
    if len(link_elements) > MAX_LINKS:
        raise UrdfError(source, f"has {len(link_elements)} links; more than {MAX_LINKS} are refused")
    links = _unique(link_elements, source)
    if "universe" in links:
        raise UrdfError(
            source, "has a link named 'universe', a name Pinocchio keeps for itself", place(links["universe"])
        )
    joints = {name: read_joint(e, links, source) for name, e in _unique(root.findall("joint"), source).items()}
    check_mimics(joints, source)
    folder = None if path is None else path.resolve().parent
    visuals, collisions = read_links(root, source, folder, [Path(d) for d in package_dirs])
    return Urdf(
        name=root.get("name") or "robot",
        path=path,
        root=_root_link(links, joints, source),
        links=tuple(links),
        joints=joints,
        collisions=collisions,
        visuals=visuals,
        kinematics=_kinematics(root, joints),
    )


def _unique(elements: Sequence[Element], source: str | Path) -> dict[str, Element]:
    named: dict[str, Element] = {}
    for element in elements:
        name = required(element, "name", source)
        if name in named:
            raise UrdfError(source, f"a second <{element.tag}> is named {name!r}", place(element))
        named[name] = element
    return named


def _root_link(links: Mapping[str, Element], joints: Mapping[str, UrdfJoint], source: str | Path) -> str:
    """The one link without a parent; every other must hang on it, each on one joint only."""
    parents: dict[str, str] = {}
    for joint in joints.values():
        if joint.child in parents:
            what = f"link {joint.child!r} hangs on more than one joint: URDF robots are trees"
            raise UrdfError(source, what, place(links[joint.child]))
        parents[joint.child] = joint.parent
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        what = (
            f"the links {roots} all have no parent" if roots else "no link is without a parent, so joints form a ring"
        )
        raise UrdfError(source, f"{what}; a URDF has exactly one root", place(links[roots[1]]) if roots else "")
    reached, edge = {roots[0]}, [roots[0]]
    children: dict[str, list[str]] = {}
    for child, parent in parents.items():
        children.setdefault(parent, []).append(child)
    while edge:
        fresh = children.get(edge.pop(), [])
        reached.update(fresh)
        edge.extend(fresh)
    if len(reached) != len(links):
        ring = [link for link in links if link not in reached]
        raise UrdfError(source, f"the links {ring} form a ring that does not hang on the root", place(links[ring[0]]))
    return roots[0]


def _kinematics(root: Element, joints: Mapping[str, UrdfJoint]) -> str:
    """The URDF text for Pinocchio; numbers are copied as the file writes them."""
    from lxml import etree

    robot = etree.Element("robot", name=root.get("name") or "robot")
    links = {link.get("name").strip() for link in root.findall("link")}
    for link in root.findall("link"):
        copy = etree.SubElement(robot, "link", name=link.get("name").strip())
        copy.extend(_inertial(link))
    for element in root.findall("joint"):
        joint = joints[element.get("name").strip()]
        kind = "revolute" if joint.type == "continuous" else joint.type
        copy = etree.SubElement(robot, "joint", name=_model_joint(joint.name, links), type=kind)
        etree.SubElement(copy, "parent", link=joint.parent)
        etree.SubElement(copy, "child", link=joint.child)
        where, axis = element.find("origin"), element.find("axis")
        if where is not None:
            etree.SubElement(copy, "origin", {a: where.get(a) for a in ("xyz", "rpy") if where.get(a) is not None})
        if axis is not None and joint.type != "fixed":
            vector = np.array([float(part) for part in axis.get("xyz").split()])
            vector /= np.abs(vector).max()  # so that no square overflows
            unit = vector / np.linalg.norm(vector)
            etree.SubElement(copy, "axis", xyz=" ".join(repr(float(v)) for v in unit))
        if kind in ("revolute", "prismatic"):
            # The limits that count are JointLimits; Pinocchio's parser only insists that some are there.
            etree.SubElement(copy, "limit", lower="-1e9", upper="1e9", velocity="1e9", effort="1e9")
    return str(etree.tostring(robot, encoding="unicode"))


def _model_joint(joint: str, links: Container[str]) -> str:
    return f"{joint} (joint)" if joint in links or joint == "universe" else joint


def _inertial(link: Element) -> list[Element]:
    """A copy of the link's inertial element, if it is complete and numeric; nothing here depends on inertias."""
    from copy import deepcopy

    inertial = link.find("inertial")
    if inertial is None:
        return []
    mass, inertia, where = inertial.find("mass"), inertial.find("inertia"), inertial.find("origin")
    if mass is None or inertia is None:
        return []
    try:
        number(mass, "value", "")
        for moment in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
            number(inertia, moment, "")
        if where is not None:
            numbers(where, "xyz", 3, "", "0 0 0")
            numbers(where, "rpy", 3, "", "0 0 0")
    except UrdfError:
        return []  # urdfdom would print its complaint and drop it too
    return [deepcopy(inertial)]
