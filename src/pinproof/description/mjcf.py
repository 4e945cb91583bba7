"""MJCF, as far as it describes a robot that stands somewhere: a tree of bodies with hinges and slides.

The tree is rewritten as a URDF and then passes every check of one. What would be lost on the way (ball and free joints,
closed loops, planes and height fields, attached files) is refused by its line. Left aside is what moves nothing:
inertias, actuators, sensors, cameras, lights, tendons that bind nothing.

Pinocchio has a reader of its own. It sets the first body on the origin whatever its pose, makes a shear of an axisangle
whose axis has not length 1, and drops what it does not know; so it serves as the tests' second opinion only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.description.mjcf_defaults import Words
from pinproof.description.mjcf_geoms import add_geom
from pinproof.description.srdf import DisabledPair, GroupState, Srdf
from pinproof.description.urdf import Urdf, urdf_of
from pinproof.description.xml_reader import Element, numbers, place, required
from pinproof.errors import UrdfError
from pinproof.spatial import xyz_rpy

__all__ = ["mjcf_of"]

Array = npt.NDArray[np.float64]

ROOT = "world"
SECTIONS = (
    "actuator", "asset", "compiler", "contact", "custom", "default", "equality", "keyframe", "option", "sensor", "size",
    "statistic", "tendon", "visual", "worldbody",
)  # fmt: skip
IN_BODY = ("body", "camera", "geom", "inertial", "joint", "light", "site")


@dataclass
class _Robot:
    """The URDF that grows while the bodies are walked."""

    words: Words
    meshes: Mapping[str, Element]
    robot: Element
    joints: list[str] = field(default_factory=list)
    links: set[str] = field(default_factory=set)

    def link(self, name: str, at: Element) -> Element:
        self.links.add(name)
        return self.make(self.robot, "link", at, name=name)

    def joint(self, name: str, kind: str, parent: str, child: str, pose: Array, at: Element) -> Element:
        joint = self.make(self.robot, "joint", at, name=name, type=kind)
        self.make(joint, "parent", at, link=parent)
        self.make(joint, "child", at, link=child)
        self.origin(joint, pose, at)
        return joint

    def origin(self, parent: Element, pose: Array, at: Element) -> None:
        values = [repr(float(value)) for value in xyz_rpy(pose)]
        self.make(parent, "origin", at, xyz=" ".join(values[:3]), rpy=" ".join(values[3:]))

    def make(self, parent: Element, tag: str, at: Element, **attributes: str) -> Element:
        """A new element that answers to the MJCF's line."""
        child = parent.makeelement(tag, attributes)
        child.sourceline = at.sourceline
        parent.append(child)
        return child

    def refuse(self, reason: str, at: Element) -> UrdfError:
        return UrdfError(self.words.path, f"{reason}: it would be lost", place(at))


def mjcf_of(root: Element, path: Path) -> tuple[Urdf, Srdf]:
    """The robot in a ``<mujoco>`` element, its excluded contacts as disabled pairs, and its keyframes as states.

    The root link is ``world``. Bodies and named sites are links, sites on fixed joints. A hinge without a range is
    continuous. A mesh's file is looked for in the folder that the file names. A joint that an equality binds to another
    by a straight line is a mimic joint.

    Raises
    ------
    UrdfError
        With the line, for what is not read: it would be lost otherwise.
    """
    from lxml import etree

    for section in root:
        if section.tag not in SECTIONS:
            raise UrdfError(path, f"holds <{section.tag}>, which is not read: it would be lost", place(section))
    words = Words.of(root, path)
    assets = [mesh for asset in root.findall("asset") for mesh in asset.findall("mesh")]
    meshes = {mesh.get("name") or Path(required(mesh, "file", path)).stem: mesh for mesh in assets}
    robot = _Robot(words, meshes, etree.Element("robot", name=root.get("model") or "robot"))
    worlds = root.findall("worldbody")
    if not worlds:
        raise UrdfError(path, "holds no <worldbody>: it describes no robot", place(root))
    link = robot.link(ROOT, worlds[0])
    for world in worlds:
        _fill(robot, world, link, ROOT, world.get("childclass"))
    _couple(robot, root)
    excluded = [
        DisabledPair((required(e, "body1", path), required(e, "body2", path)), "MJCF: excluded")
        for contact in root.findall("contact")
        for e in contact.findall("exclude")
    ]
    states = [_state(robot, key) for frames in root.findall("keyframe") for key in frames.findall("key")]
    return urdf_of(robot.robot, path, path), Srdf(disabled=tuple(excluded), states=tuple(states))


def _fill(robot: _Robot, body: Element, link: Element, name: str, inherited: str | None) -> None:
    """What stands on a body, and the bodies on it."""
    for element in body:
        if element.tag not in IN_BODY and element.tag != "freejoint":
            raise robot.refuse(f"body {name!r} holds <{element.tag}>, which is not read", element)
        if element.tag == "geom":
            add_geom(robot.words, robot.meshes, link, element, inherited)
        elif element.tag == "site" and element.get("name"):
            _site(robot, element, name, inherited)
    for inner in body.findall("body"):
        _body(robot, inner, name, inner.get("childclass") or inherited)


def _site(robot: _Robot, site: Element, parent: str, inherited: str | None) -> None:
    words = robot.words.attributes(site, inherited)
    name = required(site, "name", robot.words.path)
    name = f"{name} (site)" if name in robot.links else name
    robot.link(name, site)
    robot.joint(f"{name} (fixed)", "fixed", parent, name, robot.words.pose(site, words), site)


def _body(robot: _Robot, body: Element, parent: str, inherited: str | None) -> None:
    """A body, behind its joints: each turns or slides at its own anchor ``pos``, in the body's frame."""
    name = body.get("name") or f"body_{len(robot.links)}"
    pose = robot.words.pose(body, dict(body.attrib))
    joints = body.findall("joint")
    if (free := body.find("freejoint")) is not None:
        raise robot.refuse(f"body {name!r} floats freely, and an arm stands on something", free)
    here, anchor = parent, np.zeros(3)
    for index, element in enumerate(joints):
        words = robot.words.attributes(element, inherited)
        at = robot.words.numbers(element, words, "pos", 3, "0 0 0")
        last = index == len(joints) - 1 and not at.any()
        child = name if last else f"{name} (joint {index + 1})"
        if not last:
            robot.link(child, element)
        step = np.eye(4)
        step[:3, 3] = at - anchor
        _joint(robot, element, words, here, child, pose @ step)
        here, anchor, pose = child, at, np.eye(4)
    link = robot.link(name, body)
    if here != name:
        pose[:3, 3] -= pose[:3, :3] @ anchor
        robot.joint(f"{name} (fixed)", "fixed", here, name, pose, body)
    _fill(robot, body, link, name, inherited)


def _joint(robot: _Robot, element: Element, words: Mapping[str, str], parent: str, child: str, pose: Array) -> None:
    name = words.get("name") or f"joint_{len(robot.joints)}"
    kind = words.get("type", "hinge")
    if kind not in ("hinge", "slide"):
        raise robot.refuse(f"joint {name!r} is a {kind} joint; hinge and slide are read", element)
    if float(robot.words.numbers(element, words, "ref", 1, "0")[0]) != 0.0:
        raise robot.refuse(f"joint {name!r} has a ref other than 0", element)
    limited = words.get("limited", "auto")
    has_limits = limited == "true" or (limited == "auto" and robot.words.auto_limits and "range" in words)
    urdf_kind = "prismatic" if kind == "slide" else "revolute" if has_limits else "continuous"
    joint = robot.joint(name, urdf_kind, parent, child, pose, element)
    axis = robot.words.numbers(element, words, "axis", 3, "0 0 1")
    robot.make(joint, "axis", element, xyz=" ".join(repr(float(value)) for value in axis))
    if has_limits:
        ends = robot.words.numbers(element, words, "range", 2, "0 0")
        low, high = (robot.words.angle(float(end)) if kind == "hinge" else float(end) for end in ends)
        robot.make(joint, "limit", element, lower=repr(low), upper=repr(high))
    robot.joints.append(name)


def _couple(robot: _Robot, root: Element) -> None:
    """Equalities: a straight line from joint to joint is a mimic; every other one would close a loop."""
    found = {joint.get("name"): joint for joint in robot.robot.findall("joint")}
    for element in (e for section in root.findall("equality") for e in section):
        words = robot.words.attributes(element, None)
        if words.get("active", "true") != "true":
            continue
        line = robot.words.numbers(element, words, "polycoef", 5, "0 1 0 0 0") if element.tag == "joint" else np.ones(5)
        if line[2:].any() or "joint2" not in words or words.get("joint1") not in found:
            raise robot.refuse(f"an equality <{element.tag}> binds more than one joint to another by a line", element)
        follower = found[words["joint1"]]
        robot.make(
            follower,
            "mimic",
            element,
            joint=words["joint2"],
            multiplier=repr(float(line[1])),
            offset=repr(float(line[0])),
        )


def _state(robot: _Robot, key: Element) -> GroupState:
    values = numbers(key, "qpos", len(robot.joints), robot.words.path, " ".join(["0"] * len(robot.joints)))
    joints = {joint: (value,) for joint, value in zip(robot.joints, values, strict=True)}
    return GroupState(key.get("name", ""), "", joints)
