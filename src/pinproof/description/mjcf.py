"""Reading MJCF files (MuJoCo) of robots with a fixed base and hinge and slide joints.

The tree of bodies is converted to a URDF, which is validated as any other URDF. Elements that a URDF cannot represent
(ball and free joints, closed loops, planes and height fields, attached files) are errors with their line. Elements that
do not affect the kinematics or collisions (inertias, actuators, sensors, cameras, lights) are ignored.

Pinocchio has its own MJCF reader. It ignores the pose of the first body, returns a shear for an axisangle whose axis is
not normalised, and ignores unknown elements; therefore it is used in the tests only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pinproof.description.srdf import DisabledPair, GroupState, Srdf
from pinproof.description.urdf import Urdf, urdf_of
from pinproof.description.urdf_elements import numbers_text, origin_attributes
from pinproof.description.xml_reader import Element, numbers, place, required, spelt_attributes
from pinproof.errors import UnknownNameError, UrdfError
from pinproof.spatial import Array

Attributes = dict[str, dict[str, str]]

LARGEST = 1e100
"""Largest number; the squares of larger ones overflow."""

PLACED = ("name", "class", "pos", "quat", "axisangle", "xyaxes", "zaxis", "euler", "user")
KNOWN_ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "body": (*PLACED, "childclass", "gravcomp", "mocap", "sleep"),
    "joint": (
        "name", "class", "type", "group", "pos", "axis", "range", "limited", "ref", "springref", "springdamper",
        "margin", "stiffness", "armature", "damping", "frictionloss", "solreflimit", "solimplimit", "solreffriction",
        "solimpfriction", "actuatorfrclimited", "actuatorfrcrange", "actuatorgravcomp", "user",
    ),
    "geom": (
        *PLACED, "type", "size", "fromto", "mesh", "contype", "conaffinity", "condim", "group", "priority", "material",
        "rgba", "friction", "mass", "density", "shellinertia", "solmix", "solref", "solimp", "margin", "gap", "hfield",
        "fitscale", "fluidshape", "fluidcoef",
    ),
    "site": (*PLACED, "type", "group", "material", "size", "fromto", "rgba"),
}  # fmt: skip
"""The attributes of MuJoCo 3.3, against which misspelt ones are compared."""

ORIENTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")


@dataclass(frozen=True)
class MjcfSettings:
    """The compiler settings and default classes of one MJCF file.

    ``classes`` maps class names to tags to attributes, including those of parent classes. ``degrees`` is True if angles
    are in degrees, ``auto_limits`` if a joint with a range is limited.
    """

    path: Path
    classes: Mapping[str, Attributes]
    degrees: bool
    euler: str
    auto_limits: bool
    mesh_folder: Path

    @classmethod
    def of(cls, root: Element, path: Path) -> MjcfSettings:
        """Read the settings and classes of a ``<mujoco>`` element."""
        settings: dict[str, str] = {}
        for compiler in root.findall("compiler"):
            settings.update(compiler.attrib)
        if settings.get("coordinate", "local") != "local":
            raise UrdfError(path, "uses global coordinates, which MuJoCo no longer supports; use coordinate='local'")
        if settings.get("angle", "degree") not in ("degree", "radian"):
            raise UrdfError(path, f"unknown angle unit {settings['angle']!r}; valid: degree, radian")
        euler = settings.get("eulerseq", "xyz")
        if len(euler) != 3 or not set(euler.lower()) <= set("xyz") or not (euler.islower() or euler.isupper()):
            raise UrdfError(path, f"unknown eulerseq {euler!r}; valid: three letters such as 'xyz' or 'XYZ'")
        classes: dict[str, Attributes] = {"main": {}}
        for default in root.findall("default"):
            _read_class(default, "main", {}, classes, path)
        folder = settings.get("meshdir", settings.get("assetdir", ""))
        limits = settings.get("autolimits", "true") == "true"
        return cls(
            path, classes, settings.get("angle", "degree") == "degree", euler, limits, path.resolve().parent / folder
        )

    def attributes(self, element: Element, inherited: str | None) -> dict[str, str]:
        """Return the attributes of an element, with defaults from its class or from the class inherited by its body."""
        spelt_attributes(element, KNOWN_ATTRIBUTES.get(element.tag, element.attrib), self.path)
        name = element.get("class", inherited or "main")
        if name not in self.classes:
            raise UrdfError(self.path, str(UnknownNameError("default class", name, self.classes)), place(element))
        return {**self.classes[name].get(str(element.tag), {}), **element.attrib}

    def angle(self, value: float) -> float:
        """Convert an angle of the file to radians."""
        return float(np.deg2rad(value)) if self.degrees else value

    def numbers(
        self, element: Element, attributes: Mapping[str, str], name: str, count: int, default: str = ""
    ) -> Array:
        """Return ``count`` numbers of an attribute that may come from a class; errors state the line of the element."""
        copy = element.makeelement(element.tag, {name: attributes.get(name, default)})
        copy.sourceline = element.sourceline
        values = np.array(numbers(copy, name, count, self.path))
        if np.abs(values).max(initial=0.0) > LARGEST:
            raise UrdfError(self.path, f"<{element.tag} {name}> is larger than {LARGEST:g}", place(element))
        return values

    def pose(self, element: Element, attributes: Mapping[str, str]) -> Array:
        """Return the pose (4, 4) from ``pos`` (metres) and one of the orientation attributes."""
        from scipy.spatial.transform import Rotation

        out = np.eye(4)
        out[:3, 3] = self.numbers(element, attributes, "pos", 3, "0 0 0")
        given = [name for name in ORIENTATIONS if name in attributes]
        if len(given) > 1:
            raise UrdfError(self.path, f"<{element.tag}> has several orientations: {', '.join(given)}", place(element))
        if not given:
            return out
        count = {"quat": 4, "axisangle": 4, "xyaxes": 6}.get(given[0], 3)
        values = self.numbers(element, attributes, given[0], count)
        if given[0] == "euler":
            # In MJCF lower case means rotations about moving axes; in SciPy it is upper case.
            angles = np.deg2rad(values) if self.degrees else values
            out[:3, :3] = Rotation.from_euler(self.euler.swapcase(), angles).as_matrix()
            return out
        if (np.linalg.norm(values[:3]) < 1e-9 and given[0] != "quat") or np.linalg.norm(values) < 1e-9:
            raise UrdfError(
                self.path, f"<{element.tag}> has the {given[0]} {list(values)}, which has no direction", place(element)
            )
        if given[0] == "quat":
            out[:3, :3] = Rotation.from_quat([*values[1:], values[0]]).as_matrix()
        elif given[0] == "axisangle":
            axis = values[:3] / np.linalg.norm(values[:3])
            out[:3, :3] = Rotation.from_rotvec(axis * self.angle(values[3])).as_matrix()
        elif given[0] == "zaxis":
            out[:3, :3] = _rotation_of_z_to(values)
        else:
            x = values[:3] / np.linalg.norm(values[:3])
            y = values[3:] - (values[3:] @ x) * x
            if np.linalg.norm(y) < 1e-9:
                raise UrdfError(self.path, f"<{element.tag}> has parallel xyaxes", place(element))
            y /= np.linalg.norm(y)
            out[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
        return out


def _rotation_of_z_to(direction: Array) -> Array:
    """Return the smallest rotation (3, 3) that rotates z to a direction (3,)."""
    from scipy.spatial.transform import Rotation

    unit = direction / np.linalg.norm(direction)
    across = np.cross([0.0, 0.0, 1.0], unit)
    sine = float(np.linalg.norm(across))
    axis = across / sine if sine > 1e-12 else np.array([1.0, 0.0, 0.0])
    return np.asarray(Rotation.from_rotvec(axis * np.arctan2(sine, unit[2])).as_matrix())


def _read_class(default: Element, name: str, above: Attributes, classes: dict[str, Attributes], path: Path) -> None:
    """Add a ``<default>`` class and its nested classes, which inherit its attributes."""
    own = {tag: dict(attributes) for tag, attributes in above.items()}
    for element in default:
        if element.tag != "default":
            spelt_attributes(element, KNOWN_ATTRIBUTES.get(element.tag, element.attrib), path)
            own.setdefault(str(element.tag), {}).update(element.attrib)
    classes[name] = own
    for inner in default.findall("default"):
        _read_class(inner, required(inner, "class", path), own, classes, path)


HIDDEN_GROUP = 3
"""MuJoCo draws geoms of the groups 0 to 2; by convention collision-only geoms are in a higher group."""

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3}


def _add_geom(robot: _Robot, link: Element, geom: Element, inherited: str | None) -> None:
    """Add a geom to a link: as collision geometry if it can collide, as visual geometry if it is drawn.

    Raises
    ------
    UrdfError
        For an unsupported type; the message states the line.
    """
    settings = robot.settings
    attributes = settings.attributes(geom, inherited)
    collides = attributes.get("contype", "1") != "0" or attributes.get("conaffinity", "1") != "0"
    drawn = not collides or int(settings.numbers(geom, attributes, "group", 1, "0")[0]) < HIDDEN_GROUP
    kind = attributes.get("type", "sphere")
    pose = settings.pose(geom, attributes)
    if kind == "mesh":
        shape = _mesh(robot, attributes, geom)
    elif kind in SIZES and "mesh" not in attributes:
        shape, pose = _primitive(settings, attributes, geom, kind, pose)
    else:
        what = f"a {kind} fitted to a mesh" if "mesh" in attributes else f"a {kind}"
        reason = f"contains {what}, which is not supported; valid: {', '.join(SIZES)}, mesh"
        raise robot.refuse(reason, geom)
    for tag, wanted in (("collision", collides), ("visual", drawn)):
        if wanted:
            element = robot.make(link, tag, geom)
            robot.make(element, "origin", geom, **origin_attributes(pose))
            robot.make(robot.make(element, "geometry", geom), kind, geom, **shape)
            if "rgba" in attributes:
                robot.make(robot.make(element, "material", geom), "color", geom, rgba=attributes["rgba"])


def _primitive(
    settings: MjcfSettings, attributes: Mapping[str, str], geom: Element, kind: str, pose: Array
) -> tuple[dict[str, str], Array]:
    """Return the attributes of a shape and its pose; MJCF states half sides and half lengths, or ends of the axis."""
    count = SIZES[kind]
    if "fromto" in attributes and kind != "sphere":
        ends = settings.numbers(geom, attributes, "fromto", 6)
        along = ends[3:] - ends[:3]
        length = float(np.linalg.norm(along))
        if length < 1e-9:
            raise UrdfError(settings.path, "<geom fromto> has two equal end points", place(geom))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = _rotation_of_z_to(along), (ends[:3] + ends[3:]) / 2
        # The z axis of MuJoCo points from the second end to the first; all shapes here are symmetric.
        given = max(len(attributes.get("size", "").split()), 1)
        half = [*settings.numbers(geom, attributes, "size", given)[: count - 1], length / 2]
        if kind == "box" and given < 2:
            half = [half[0], half[0], length / 2]
    else:
        # Additional numbers are allowed, because classes may be shared by several types.
        given = max(len(attributes.get("size", "").split()), count)
        half = list(settings.numbers(geom, attributes, "size", given)[:count])
    full = [repr(2 * float(value)) for value in half]
    if kind == "box":
        return {"size": " ".join(full)}, pose
    if kind == "sphere":
        return {"radius": repr(float(half[0]))}, pose
    return {"radius": repr(float(half[0])), "length": full[1]}, pose


def _mesh(robot: _Robot, attributes: Mapping[str, str], geom: Element) -> dict[str, str]:
    name = attributes.get("mesh", "")
    if name not in robot.meshes:
        raise robot.refuse(str(UnknownNameError("mesh", name, robot.meshes, "a <geom>")), geom)
    element = robot.meshes[name]
    asset = robot.settings.attributes(element, None)
    for odd in ("refpos", "refquat", "vertex", "builtin"):
        if odd in asset:
            raise robot.refuse(f"mesh {name!r} has {odd}, which is not supported", element)
    file = Path(required(element, "file", robot.settings.path))
    return {"filename": str(robot.settings.mesh_folder / file), "scale": asset.get("scale", "1 1 1")}


ROOT = "world"
SECTIONS = (
    "actuator", "asset", "compiler", "contact", "custom", "default", "equality", "keyframe", "option", "sensor", "size",
    "statistic", "tendon", "visual", "worldbody",
)  # fmt: skip
IN_BODY = ("body", "camera", "geom", "inertial", "joint", "light", "site")


@dataclass
class _Robot:
    """The URDF under construction."""

    settings: MjcfSettings
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
        self.make(joint, "origin", at, **origin_attributes(pose))
        return joint

    def make(self, parent: Element, tag: str, at: Element, **attributes: str) -> Element:
        """Create an element with the line number of the MJCF element."""
        child = parent.makeelement(tag, attributes)
        child.sourceline = at.sourceline
        parent.append(child)
        return child

    def refuse(self, reason: str, at: Element) -> UrdfError:
        return UrdfError(self.settings.path, reason, place(at))


def mjcf_of(root: Element, path: Path) -> tuple[Urdf, Srdf]:
    """Read the robot of a ``<mujoco>`` element; excluded contacts and keyframes are returned as an SRDF.

    The root link is ``world``. Bodies and named sites become links, sites on fixed joints. A hinge without a range is
    continuous. A joint that an equality couples linearly to another joint becomes a mimic joint.

    Raises
    ------
    UrdfError
        For unsupported elements; the message states the line.
    """
    from lxml import etree

    for section in root:
        if section.tag not in SECTIONS:
            raise UrdfError(path, f"contains <{section.tag}>, which is not supported", place(section))
    settings = MjcfSettings.of(root, path)
    assets = [mesh for asset in root.findall("asset") for mesh in asset.findall("mesh")]
    meshes = {mesh.get("name") or Path(required(mesh, "file", path)).stem: mesh for mesh in assets}
    robot = _Robot(settings, meshes, etree.Element("robot", name=root.get("model") or "robot"))
    worlds = root.findall("worldbody")
    if not worlds:
        raise UrdfError(path, "has no <worldbody>", place(root))
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
    """Add the geoms, the sites and the child bodies of a body."""
    for element in body:
        if element.tag not in IN_BODY and element.tag != "freejoint":
            raise robot.refuse(f"body {name!r} contains <{element.tag}>, which is not supported", element)
        if element.tag == "geom":
            _add_geom(robot, link, element, inherited)
        elif element.tag == "site" and element.get("name"):
            _site(robot, element, name, inherited)
    for inner in body.findall("body"):
        _body(robot, inner, name, inner.get("childclass") or inherited)


def _site(robot: _Robot, site: Element, parent: str, inherited: str | None) -> None:
    attributes = robot.settings.attributes(site, inherited)
    name = required(site, "name", robot.settings.path)
    name = f"{name} (site)" if name in robot.links else name
    robot.link(name, site)
    robot.joint(f"{name} (fixed)", "fixed", parent, name, robot.settings.pose(site, attributes), site)


def _body(robot: _Robot, body: Element, parent: str, inherited: str | None) -> None:
    """Add a body and its joints; the anchor ``pos`` of each joint is in the frame of the body."""
    name = body.get("name") or f"body_{len(robot.links)}"
    spelt_attributes(body, KNOWN_ATTRIBUTES["body"], robot.settings.path)
    pose = robot.settings.pose(body, dict(body.attrib))
    joints = body.findall("joint")
    if (free := body.find("freejoint")) is not None:
        raise robot.refuse(f"body {name!r} has a free joint; the base must be fixed", free)
    here, anchor = parent, np.zeros(3)
    for index, element in enumerate(joints):
        attributes = robot.settings.attributes(element, inherited)
        at = robot.settings.numbers(element, attributes, "pos", 3, "0 0 0")
        last = index == len(joints) - 1 and not at.any()
        child = name if last else f"{name} (joint {index + 1})"
        if not last:
            robot.link(child, element)
        step = np.eye(4)
        step[:3, 3] = at - anchor
        _joint(robot, element, attributes, here, child, pose @ step)
        here, anchor, pose = child, at, np.eye(4)
    link = robot.link(name, body)
    if here != name:
        pose[:3, 3] -= pose[:3, :3] @ anchor
        robot.joint(f"{name} (fixed)", "fixed", here, name, pose, body)
    _fill(robot, body, link, name, inherited)


def _joint(
    robot: _Robot, element: Element, attributes: Mapping[str, str], parent: str, child: str, pose: Array
) -> None:
    name = attributes.get("name") or f"joint_{len(robot.joints)}"
    kind = attributes.get("type", "hinge")
    if kind not in ("hinge", "slide"):
        raise robot.refuse(f"joint {name!r} is a {kind} joint, which is not supported; valid: hinge, slide", element)
    if float(robot.settings.numbers(element, attributes, "ref", 1, "0")[0]) != 0.0:
        raise robot.refuse(f"joint {name!r} has a ref other than 0, which is not supported", element)
    limited = attributes.get("limited", "auto")
    has_limits = limited == "true" or (limited == "auto" and robot.settings.auto_limits and "range" in attributes)
    urdf_kind = "prismatic" if kind == "slide" else "revolute" if has_limits else "continuous"
    joint = robot.joint(name, urdf_kind, parent, child, pose, element)
    axis = robot.settings.numbers(element, attributes, "axis", 3, "0 0 1")
    robot.make(joint, "axis", element, xyz=numbers_text(axis))
    if has_limits:
        ends = robot.settings.numbers(element, attributes, "range", 2, "0 0")
        low, high = (robot.settings.angle(float(end)) if kind == "hinge" else float(end) for end in ends)
        robot.make(joint, "limit", element, lower=repr(low), upper=repr(high))
    robot.joints.append(name)


def _couple(robot: _Robot, root: Element) -> None:
    """Convert linear equalities between two joints to mimic joints; other equalities are errors (closed loops)."""
    found = {joint.get("name"): joint for joint in robot.robot.findall("joint")}
    for element in (e for section in root.findall("equality") for e in section):
        attributes = robot.settings.attributes(element, None)
        if attributes.get("active", "true") != "true":
            continue
        line = (
            robot.settings.numbers(element, attributes, "polycoef", 5, "0 1 0 0 0")
            if element.tag == "joint"
            else np.ones(5)
        )
        if line[2:].any() or "joint2" not in attributes or attributes.get("joint1") not in found:
            reason = f"the equality <{element.tag}> is not a linear coupling of two joints, which alone is supported"
            raise robot.refuse(reason, element)
        follower = found[attributes["joint1"]]
        robot.make(
            follower,
            "mimic",
            element,
            joint=attributes["joint2"],
            multiplier=repr(float(line[1])),
            offset=repr(float(line[0])),
        )


def _state(robot: _Robot, key: Element) -> GroupState:
    values = numbers(key, "qpos", len(robot.joints), robot.settings.path, " ".join(["0"] * len(robot.joints)))
    joints = {joint: (value,) for joint, value in zip(robot.joints, values, strict=True)}
    return GroupState(key.get("name", ""), "", joints)
