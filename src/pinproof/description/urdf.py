"""Reading and validating URDF files: links with visual and collision geometry, joints, limits and mimic rules.

The parsers that Pinocchio uses accept a zero axis, a negative radius, ``lower > upper`` and unknown geometry without an
error. Here each of these is an error with its line. Values that the file does not state are None, not the 0 of the URDF
specification. Kinematics are computed in :mod:`pinproof.model`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np
import numpy.typing as npt

from pinproof.common.structs import described, key
from pinproof.common.validation import ReadOnlyDict
from pinproof.description.ros_files import MeshFile, expand_xacro, leaves_package, locate
from pinproof.description.xml_reader import (
    Element,
    add_joint,
    number,
    numbers,
    numbers_text,
    only,
    parse_file,
    parse_text,
    place,
    required,
    spelt,
    spelt_attributes,
)
from pinproof.errors import InputError, UnknownNameError, UrdfError

Shape = Literal["box", "capsule", "cylinder", "mesh", "sphere"]
Rgba = tuple[float, float, float, float]


@described(eq=False)
class LinkGeometry:
    """One ``<visual>`` or ``<collision>`` element."""

    name: str = key("unique name in the robot: ``LINK_0``, ``LINK_1``, ... in the order of the file")
    link: str = key("name of the link")
    kind: Shape = key("shape")
    size: tuple[float, ...] = key(
        "size of the shape in metres. Box: full sides (x, y, z). Sphere: (radius,). Cylinder and capsule, along z: "
        "(radius, length), the length of a capsule without its caps. Mesh: the scale (x, y, z)"
    )
    origin: npt.NDArray[np.float64] = key("(4, 4) link_from_geometry")
    mesh: MeshFile | None = key("file of a mesh", default=None)
    rgba: Rgba | None = key("colour of the material, 0 to 1", default=None)


FARTHEST = 1e4
"""Metres. Larger origins and sizes are assumed to be errors in the unit; sums of squares could overflow."""


def read_links(
    root: Element, source: str | Path, folder: Path | None, package_dirs: Sequence[Path]
) -> tuple[tuple[LinkGeometry, ...], tuple[LinkGeometry, ...]]:
    """Return all visual and all collision geometries of a ``<robot>``, in the order of the file."""
    colours = {m.get("name"): _rgba(m, source) for m in root.findall("material") if m.get("name")}
    found: dict[str, list[LinkGeometry]] = {"visual": [], "collision": []}
    for link in root.findall("link"):
        spelt(link, ("collision", "inertial", "visual"), source)
        for tag, collected in found.items():
            for index, element in enumerate(link.findall(tag)):
                name = f"{link.get('name').strip()}_{index}"
                collected.append(_geometry(element, name, colours, source, folder, package_dirs))
    return tuple(found["visual"]), tuple(found["collision"])


def rpy_matrix(roll: float, pitch: float, yaw: float) -> npt.NDArray[np.float64]:
    """Return the rotation matrix (3, 3) Rz(yaw) Ry(pitch) Rx(roll), angles in radians about fixed axes."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _geometry(
    element: Element,
    name: str,
    colours: dict[str, Rgba | None],
    source: str | Path,
    folder: Path | None,
    package_dirs: Sequence[Path],
) -> LinkGeometry:
    link = name.rpartition("_")[0]
    spelt(element, ("geometry", "material", "name", "origin"), source)
    shapes = [] if (geometry := element.find("geometry")) is None else list(geometry)
    if len(shapes) != 1:
        what = f"a <{element.tag}> of link {link!r} must have one shape, not {len(shapes)}"
        raise UrdfError(source, what, place(element))
    shape = shapes[0]
    kind, size = _shape(shape, link, source)
    # the colour of the element, or of the material of that name
    material = element.find("material")
    rgba = None if material is None else _rgba(material, source) or colours.get(material.get("name"))
    mesh = None
    if kind == "mesh":
        uri = required(shape, "filename", source)
        if leaves_package(uri):
            raise UrdfError(source, f"{uri} leaves its package through '..'; remove it", place(shape))
        mesh = locate(uri, folder, package_dirs)
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = origin(element, source)
    placement.setflags(write=False)
    return LinkGeometry(name, link, kind, size, placement, mesh, rgba)


def _shape(shape: Element, link: str, source: str | Path) -> tuple[Shape, tuple[float, ...]]:
    kind = shape.tag
    if kind not in get_args(Shape):
        reason = str(UnknownNameError("geometry", kind, get_args(Shape), f"link {link!r}"))
        raise UrdfError(source, reason, place(shape))
    if kind == "mesh":
        scale = numbers(shape, "scale", 3, source, "1 1 1")
        if 0.0 in scale:
            what = f"a mesh of link {link!r} has the scale {list(scale)}, which must not be 0"
            raise UrdfError(source, what, place(shape))
        return "mesh", scale
    if kind == "box":
        size = numbers(shape, "size", 3, source)
    else:
        size = tuple(number(shape, key, source) for key in ("radius", "length")[: 1 if kind == "sphere" else 2])
    if min(size) <= 0 or max(size) > FARTHEST:
        what = f"a {kind} of link {link!r} has the size {list(size)}; sizes must be above 0 and at most {FARTHEST:g} m"
        raise UrdfError(source, what, place(shape))
    return cast(Shape, kind), size


def origin(element: Element, source: str | Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the rotation (3, 3) and the translation (3,) in metres of the ``<origin>`` of an element."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    only(origin, ("xyz", "rpy"), source)
    xyz = np.array(numbers(origin, "xyz", 3, source, "0 0 0"))
    if np.abs(xyz).max() > FARTHEST:
        raise UrdfError(source, f"<origin xyz={origin.get('xyz')!r}> is more than {FARTHEST:g} m away", place(origin))
    return rpy_matrix(*numbers(origin, "rpy", 3, source, "0 0 0")), xyz


def _rgba(material: Element, source: str | Path) -> Rgba | None:
    colour = material.find("color")
    if colour is None:
        return None
    r, g, b, a = (min(max(v, 0.0), 1.0) for v in numbers(colour, "rgba", 4, source))
    return (r, g, b, a) if math.isfinite(a) else None


SMALLEST_AXIS = 1e-6
"""An axis vector whose entries are all smaller than this has no defined direction."""

UNBOUNDED = 1e4
"""Rad or m. Larger limits, such as 1e16 for a wheel in files of simulators, are treated as no limit."""

JOINT_PARTS = ("axis", "calibration", "child", "dynamics", "limit", "mimic", "origin", "parent", "safety_controller")

LIMITS = ("lower", "upper", "velocity", "effort")

JointType = Literal["revolute", "continuous", "prismatic", "fixed", "floating", "planar"]


@dataclass(frozen=True)
class Mimic:
    """The rule of a mimic joint: q = multiplier * q_leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF; limits are None where the file states none.

    A limit beyond :data:`UNBOUNDED`, and a velocity or effort limit of 0 ("unknown" in practice), are None too.
    """

    name: str
    type: JointType
    parent: str
    child: str
    lower: float | None
    upper: float | None
    velocity: float | None
    mimic: Mimic | None
    effort: float | None = None

    @property
    def bounds(self) -> tuple[float, float]:
        """The lower and upper limit, infinite where the file states none."""
        return -math.inf if self.lower is None else self.lower, math.inf if self.upper is None else self.upper


def read_joint(element: Element, links: Mapping[str, Element], source: str | Path) -> UrdfJoint:
    """Read a ``<joint>`` element; ``links`` are the links of the robot by name."""
    name, kind = required(element, "name", source), required(element, "type", source)
    where = place(element)
    if kind not in get_args(JointType):
        reason = str(UnknownNameError("joint type", kind, get_args(JointType), f"joint {name!r}"))
        raise UrdfError(source, reason, where)
    # the links that the joint connects
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        if end is None:
            raise UrdfError(source, f"joint {name!r} has no <{tag}>", where)
        link = required(end, "link", source)
        if link not in links:
            raise UrdfError(source, str(UnknownNameError("link", link, links, f"joint {name!r}")), place(end))
        ends.append(link)
    spelt(element, JOINT_PARTS, source)
    origin(element, source)
    # the axis needs a direction; its length is not used
    axis = element.find("axis")
    if axis is not None and kind != "fixed":
        only(axis, ("xyz",), source)
        vector = numbers(axis, "xyz", 3, source)
        if np.abs(vector).max() < SMALLEST_AXIS:
            raise UrdfError(source, f"joint {name!r} has the axis {list(vector)}, which has no direction", place(axis))
    lower, upper, velocity, effort = _limits(element, name, kind, source)
    # a mimic joint follows another one
    mimic = element.find("mimic")
    rule = None
    if mimic is not None and kind != "fixed":
        leader = required(mimic, "joint", source)
        rule = Mimic(leader, number(mimic, "multiplier", source, "1"), number(mimic, "offset", source, "0"))
        if max(abs(rule.multiplier), abs(rule.offset)) > FARTHEST:
            what = f"mimic joint {name!r} has the multiplier {rule.multiplier:g} and the offset {rule.offset:g}"
            raise UrdfError(source, f"{what}; the limit is {FARTHEST:g}", place(mimic))
    return UrdfJoint(name, cast(JointType, kind), ends[0], ends[1], lower, upper, velocity, rule, effort)


def _limits(
    element: Element, name: str, kind: str, source: str | Path
) -> tuple[float | None, float | None, float | None, float | None]:
    """Return lower, upper, velocity, effort; a missing limit is None, not the 0 of the URDF specification."""
    limit = element.find("limit")
    if limit is None or kind == "fixed":
        return None, None, None, None
    spelt_attributes(limit, LIMITS, source)
    lower, upper, velocity, effort = (
        number(limit, key, source) if limit.get(key) is not None else None for key in LIMITS
    )
    if lower is not None and upper is not None and lower > upper:
        raise UrdfError(source, f"joint {name!r} has lower = {lower} above upper = {upper}", place(limit))
    for what, value in (("velocity", velocity), ("effort", effort)):
        if value is not None and value < 0:
            raise UrdfError(source, f"joint {name!r} has the negative {what} limit {value}", place(limit))
    if kind == "continuous":
        lower = upper = None
    return _usable(lower), _usable(upper), _usable(velocity) or None, _usable(effort) or None


def _usable(bound: float | None) -> float | None:
    return None if bound is None or abs(bound) > UNBOUNDED else bound


def check_mimics(joints: Mapping[str, UrdfJoint], source: str | Path) -> None:
    """Raise UrdfError for a mimic joint whose leader does not exist or is not an independent single-axis joint."""
    for joint in joints.values():
        if joint.mimic is None:
            continue
        if joint.type in ("floating", "planar"):
            raise UrdfError(source, f"joint {joint.name!r} is {joint.type} and cannot be a mimic joint")
        leader = joints.get(joint.mimic.leader)
        if leader is None:
            reason = str(UnknownNameError("joint", joint.mimic.leader, joints, f"mimic of {joint.name!r}"))
            raise UrdfError(source, reason)
        if leader.mimic is not None or leader.type not in ("revolute", "continuous", "prismatic"):
            what = "is a mimic joint itself" if leader.mimic is not None else f"is {leader.type}"
            raise UrdfError(
                source,
                f"joint {joint.name!r} mimics {leader.name!r}, which {what}; "
                "valid leaders are revolute, continuous or prismatic joints without <mimic>",
            )


VISUALS_CAN_BE_CHECKED = "visual_bodies (--visual-bodies) checks them with their visual geometry"

MAX_LINKS = 1000
"""Largest number of links; urdfdom recurses for each link and crashes at about 5,000."""


JOINTS_READ_ONLY = "the joints of a robot are read-only; load a changed URDF"


@dataclass(frozen=True, eq=False)
class Urdf:
    """A validated robot description.

    ``kinematics`` is URDF text for Pinocchio: the same links, joints and inertias without geometry. Continuous joints
    are written as revolute ones, so that each joint is one angle, and mimic tags are omitted because
    :mod:`pinproof.model` handles them. ``text`` is the complete XML text.
    """

    name: str
    path: Path | None
    root: str
    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]
    collisions: tuple[LinkGeometry, ...]
    visuals: tuple[LinkGeometry, ...]
    kinematics: str
    text: str

    @property
    def visual_only(self) -> tuple[str, ...]:
        """The links with visual geometry but no collision geometry."""
        solid = {geometry.link for geometry in self.collisions}
        return tuple(dict.fromkeys(geometry.link for geometry in self.visuals if geometry.link not in solid))

    def with_visual_bodies(self) -> Urdf:
        """Return the description in which links without collision geometry have their visual geometry as such."""
        from copy import deepcopy

        from lxml import etree

        links = set(self.visual_only)
        root = parse_text(self.text, self.name)
        for link in root.findall("link"):
            for visual in link.findall("visual") if link.get("name").strip() in links else ():
                body = deepcopy(visual)
                body.tag = "collision"
                for material in body.findall("material"):
                    body.remove(material)
                link.append(body)
        solid = (*self.collisions, *(geometry for geometry in self.visuals if geometry.link in links))
        return replace(self, collisions=solid, text=str(etree.tostring(root, encoding="unicode")))

    def text_for(self, path: Path) -> str:
        """Return the XML text for a file at ``path``, from which all meshes that were found are found again."""
        from lxml import etree

        folder = path.resolve().parent
        moved = {}
        for geometry in (*self.visuals, *self.collisions):
            mesh = geometry.mesh
            if mesh is not None and mesh.path is not None and locate(mesh.uri, folder, ()).path != mesh.path:
                moved[mesh.uri] = str(mesh.path.resolve())
        root = parse_text(self.text, path)
        for element in root.iter("mesh"):
            uri = str(element.get("filename", "")).strip()
            element.set("filename", moved.get(uri, uri))
        return '<?xml version="1.0"?>\n' + str(etree.tostring(root, encoding="unicode")) + "\n"

    def __repr__(self) -> str:
        geometry = f"{len(self.collisions)} collision and {len(self.visuals)} visual geometries"
        return f"Urdf({self.name!r}, {len(self.links)} links, {len(self.joints)} joints, {geometry})"

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", ReadOnlyDict(self.joints, JOINTS_READ_ONLY))

    def model_joint(self, joint: str) -> str:
        """The name of a joint in ``kinematics``; it differs where a link has the same name, which Pinocchio rejects."""
        return _model_joint(joint, self.links)

    def parent_joint(self, link: str) -> UrdfJoint | None:
        """The parent joint of a link; None for the root."""
        return next((joint for joint in self.joints.values() if joint.child == link), None)


def moved_by(urdf: Urdf, link: str, joints: Collection[str]) -> str:
    """The joint that moves a link, of the given joints and their mimic followers; empty without one."""
    while (joint := urdf.parent_joint(link)) is not None:
        if joint.name in joints or (joint.mimic is not None and joint.mimic.leader in joints):
            return joint.name
        link = joint.parent
    return ""


def read_urdf(
    path: str | Path, *, package_dirs: Sequence[str | Path] = (), xacro_args: Mapping[str, str] | None = None
) -> Urdf:
    """Read and validate a URDF file, or a xacro file that expands to one.

    Parameters
    ----------
    path
        The file; a file with the suffix ``.xacro`` is expanded first (requires the extra ``xacro``).
    package_dirs
        Folders that contain ROS packages, searched first for ``package://`` meshes.
    xacro_args
        Values for the ``<xacro:arg>`` elements of a xacro file.

    Raises
    ------
    UrdfError
        If the file is invalid or contains unsupported elements; the message states the line.
    """
    path = Path(path)
    if path.suffix == ".xacro":
        name = f"{path} (expanded)"
        root = parse_text(expand_xacro(path, xacro_args or {}, [Path(d) for d in package_dirs]), name)
        return urdf_of(root, name, path, package_dirs)
    if xacro_args:
        raise InputError(f"xacro_args are valid for .xacro files only, not for {path}")
    return urdf_of(parse_file(path), path, path, package_dirs)


def read_urdf_text(text: str, *, name: str = "URDF text", package_dirs: Sequence[str | Path] = ()) -> Urdf:
    """Read and validate URDF text; ``name`` is used instead of a file in errors."""
    return urdf_of(parse_text(text, name), name, None, package_dirs)


def urdf_of(root: Element, source: str | Path, path: Path | None, package_dirs: Sequence[str | Path] = ()) -> Urdf:
    """Read the URDF from an XML element; ``source`` is used in errors, ``path`` to find relative mesh paths."""
    from lxml import etree

    if root.tag != "robot":
        raise UrdfError(source, f"is not a URDF: the root element is <{root.tag}>, not <robot>", place(root))
    macro = next((e for e in root.iter() if "xacro" in e.tag.rpartition("}")[0]), None)
    if macro is not None:
        reason = "contains xacro elements; rename the file to .urdf.xacro, or expand it to a plain URDF"
        raise UrdfError(source, reason, place(macro))
    # links, whose number and names Pinocchio must accept
    link_elements = root.findall("link")
    if not link_elements:
        raise UrdfError(source, "has no links", place(root))
    if len(link_elements) > MAX_LINKS:
        raise UrdfError(source, f"has {len(link_elements)} links; the limit is {MAX_LINKS}")
    links = _unique(link_elements, source)
    if "universe" in links:
        reason = "has a link named 'universe', a name reserved by Pinocchio; rename it"
        raise UrdfError(source, reason, place(links["universe"]))
    # joints form a tree; followers have leaders
    joints = {name: read_joint(e, links, source) for name, e in _unique(root.findall("joint"), source).items()}
    check_mimics(joints, source)
    # geometry, with the files of its meshes
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
        text=str(etree.tostring(root, encoding="unicode")),
    )


def _unique(elements: Sequence[Element], source: str | Path) -> dict[str, Element]:
    named: dict[str, Element] = {}
    for element in elements:
        name = required(element, "name", source)
        if name in named:
            raise UrdfError(source, f"duplicate <{element.tag}> name {name!r}", place(element))
        named[name] = element
    return named


def _root_link(links: Mapping[str, Element], joints: Mapping[str, UrdfJoint], source: str | Path) -> str:
    """Return the root link; every other link must have exactly one parent joint and be connected to the root."""
    parents: dict[str, str] = {}
    for joint in joints.values():
        if joint.child in parents:
            what = f"link {joint.child!r} is the child of more than one joint; a URDF must be a tree"
            raise UrdfError(source, what, place(links[joint.child]))
        parents[joint.child] = joint.parent
    # exactly one link has no parent
    roots = [link for link in links if link not in parents]
    if len(roots) != 1:
        what = f"the links {roots} have no parent" if roots else "all links have a parent, so the joints form a loop"
        raise UrdfError(source, f"{what}; a URDF must have exactly one root", place(links[roots[1]]) if roots else "")
    # every link is connected to the root; links in a loop have parents, but are not
    reached, edge = {roots[0]}, [roots[0]]
    children: dict[str, list[str]] = {}
    for child, parent in parents.items():
        children.setdefault(parent, []).append(child)
    while edge:
        fresh = children.get(edge.pop(), [])
        reached.update(fresh)
        edge.extend(fresh)
    if len(reached) != len(links):
        loop = [link for link in links if link not in reached]
        reason = f"the links {loop} form a loop that is not connected to the root"
        raise UrdfError(source, reason, place(links[loop[0]]))
    return roots[0]


def _kinematics(root: Element, joints: Mapping[str, UrdfJoint]) -> str:
    """Return the URDF text for Pinocchio; numbers are copied verbatim from the file."""
    from lxml import etree

    robot = etree.Element("robot", name=root.get("name") or "robot")
    links = {link.get("name").strip() for link in root.findall("link")}
    for link in root.findall("link"):
        copy = etree.SubElement(robot, "link", name=link.get("name").strip())
        copy.extend(_inertial(link))
    for element in root.findall("joint"):
        joint = joints[element.get("name").strip()]
        kind = "revolute" if joint.type == "continuous" else joint.type
        copy = add_joint(robot, _model_joint(joint.name, links), kind, joint.parent, joint.child)
        # origins verbatim, axes as unit vectors
        where, axis = element.find("origin"), element.find("axis")
        if where is not None:
            etree.SubElement(copy, "origin", {a: where.get(a) for a in ("xyz", "rpy") if where.get(a) is not None})
        if axis is not None and joint.type != "fixed":
            vector = np.array([float(part) for part in axis.get("xyz").split()])
            vector /= np.abs(vector).max()  # so that no square overflows
            unit = vector / np.linalg.norm(vector)
            etree.SubElement(copy, "axis", xyz=numbers_text(unit))
        if kind in ("revolute", "prismatic"):
            # The parser of Pinocchio requires limits; those in use are in JointLimits.
            effort = "1e9" if joint.effort is None else repr(joint.effort)
            etree.SubElement(copy, "limit", lower="-1e9", upper="1e9", velocity="1e9", effort=effort)
    return str(etree.tostring(robot, encoding="unicode"))


def _model_joint(joint: str, links: Container[str]) -> str:
    return f"{joint} (joint)" if joint in links or joint == "universe" else joint


def _inertial(link: Element) -> list[Element]:
    """Return a copy of the inertial element of a link if it is complete and numeric, else nothing."""
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
        return []  # urdfdom prints an error and ignores it too
    return [deepcopy(inertial)]
