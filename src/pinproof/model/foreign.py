"""Robots as objects of other libraries: a pinocchio.Model, a yourdfpy.URDF, a description of robot_descriptions.

Each becomes a URDF, which is validated as any other, so that all that follows is one path: what the object states is
written with all digits, and read again.

Types are recognised by their attributes, so none of these libraries is imported here but Pinocchio.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from pinproof.common.validation import optional_module
from pinproof.description import Urdf, add_joint, mesh_of_file, numbers_text, origin_attributes, stored_mesh, urdf_of
from pinproof.errors import InputError, UnknownNameError
from pinproof.model.chain import joint_axis
from pinproof.spatial import Array

# -- geometry of coal --------------------------------------------------------------------------------------------------


class CoalShape(NamedTuple):
    """A geometry of coal in numbers."""

    kind: str
    """The name of the shape as in files; ``convex`` if it is that of the hull of the vertices."""
    size: tuple[float, ...] = ()
    """Full sides of a box, radius and length of round shapes, semi-axes of an ellipsoid; for a half-space the normal
    and the distance of its plane."""
    vertices: Array = np.empty((0, 3))
    triangles: npt.NDArray[np.int64] = np.empty((0, 3), dtype=np.int64)


def coal_shape(name: str, geometry: Any) -> CoalShape:
    """Read a geometry of coal, or of hppfcl, which has the same classes; ``name`` is for messages.

    A swept sphere radius is added to the size of boxes, spheres, cylinders and capsules; a box or cylinder with its
    edges sharp contains the rounded one.

    Raises
    ------
    InputError
        If the kind of the geometry is not supported, or has a swept sphere radius that cannot be added.
    """
    kind = type(geometry).__name__
    swept = float(getattr(geometry, "getSweptSphereRadius", float)())
    if swept and kind not in ("Box", "Sphere", "Cylinder", "Capsule"):
        raise InputError(
            f"{name} is a {kind} with the swept sphere radius {swept:g}; valid with one: Box, Sphere, Cylinder, Capsule"
        )
    if kind == "Box":
        return CoalShape("box", tuple(2 * (float(half) + swept) for half in geometry.halfSide))
    if kind == "Sphere":
        return CoalShape("sphere", (geometry.radius + swept,))
    if kind in ("Cylinder", "Capsule", "Cone"):  # the length of a capsule is that between its caps
        longer = swept if kind == "Cylinder" else 0.0
        return CoalShape(kind.lower(), (geometry.radius + swept, 2 * (geometry.halfLength + longer)))
    if kind == "Ellipsoid":
        return CoalShape("ellipsoid", tuple(map(float, geometry.radii)))
    if kind == "Halfspace":
        return CoalShape("half_space", (*map(float, geometry.n), float(geometry.d)))
    if kind.startswith("BVHModel") and geometry.num_tris:
        corners = [(each[0], each[1], each[2]) for each in map(geometry.tri_indices, range(geometry.num_tris))]
        return CoalShape("mesh", vertices=np.array(geometry.vertices()), triangles=np.array(corners, dtype=np.int64))
    if kind.startswith("Convex"):
        from trimesh.convex import convex_hull

        points = np.array(geometry.points()).reshape(-1, 3)
        if len(points) < 4 or np.linalg.matrix_rank(points - points[0]) < 3:
            raise InputError(f"{name} is a Convex whose {len(points)} points are all in one plane")
        hull = convex_hull(points)
        return CoalShape("convex", vertices=np.asarray(hull.vertices), triangles=np.asarray(hull.faces))
    valid = "Box, Sphere, Cylinder, Capsule, Cone, Ellipsoid, Halfspace, Convex and BVHModel with triangles"
    raise InputError(f"{name} is a {type(geometry).__module__.partition('.')[0]} {kind}; supported are {valid}")


# -- pinocchio.Model ---------------------------------------------------------------------------------------------------

SINGLE_AXIS = re.compile(r"JointModel(R|P|RUB)[XYZ]|JointModel(Revolute|RevoluteUnbounded|Prismatic)Unaligned")

FRAMES = (pin.FrameType.BODY, pin.FrameType.OP_FRAME, pin.FrameType.SENSOR)
"""The frames that become links; those of joints only name the fixed joints."""

STEP = 0.5
"""Rad or m: the largest step of a mimic joint and of its leader from which the axis follows."""


def urdf_of_model(model: pin.Model, geometry_model: Any = None) -> Urdf:
    """Return the description of a model whose joints have one degree of freedom.

    Its links are the frames of bodies, operational frames and sensors. A joint without a link at its origin, and the
    universe without one, get a link of their own. Inertias are those of the joints, geometry and placements those of
    the model as it is now. InputError if a joint is of another kind, or a link has geometry that a URDF cannot
    represent; the message names it.
    """
    return _Conversion(model, geometry_model).result()


class _Conversion:
    """The URDF of a model. The pose of a link is relative to the joint that moves it; the universe is joint 0."""

    def __init__(self, model: pin.Model, geometry_model: Any) -> None:
        from lxml import etree

        self.model, self.geometry_model = model, geometry_model
        self.element, self.robot = etree.SubElement, etree.Element("robot", name=model.name or "robot")
        self.links: dict[str, tuple[Any, int, pin.SE3]] = {}  # the element, the joint and the pose of each link
        self.of_frame: dict[int, str] = {}
        self.main: list[str] = []  # the link at the origin of each joint
        self.joint_names = {*model.names}

    def result(self) -> Urdf:
        model = self.model
        for number, frame in enumerate(model.frames):
            if number and frame.type in FRAMES and frame.name not in self.links:
                self.of_frame[number] = self.add_link(frame.name, frame.parentJoint, frame.placement)
        for joint in range(model.njoints):
            at_origin = (name for name, (_, own, pose) in self.links.items() if own == joint and pose.isIdentity(0.0))
            own = _unused("world" if joint == 0 else f"{model.names[joint]}_link", self.links)
            self.main.append(next(at_origin, "") or self.add_link(own, joint, pin.SE3.Identity()))
            if model.inertias[joint].mass:
                self.add_inertia(self.main[joint], model.inertias[joint])
        # the joints between links that are fixed to each other, then those that move
        for number, name in self.of_frame.items():
            if name != self.main[model.frames[number].parentJoint]:
                self.add_fixed(number, name)
        leaders = dict(zip(model.mimicking_joints, model.mimicked_joints, strict=True))
        for joint in range(1, model.njoints):
            self.add_moving(joint, leaders.get(joint))
        for thing in () if self.geometry_model is None else self.geometry_model.geometryObjects:
            self.add_geometry(thing)
        return urdf_of(self.robot, f"the pinocchio.Model {model.name!r}", None)

    def add_link(self, name: str, joint: int, pose: pin.SE3) -> str:
        self.links[name] = self.element(self.robot, "link", name=name), joint, pose
        return name

    def add_inertia(self, link: str, inertia: Any) -> None:
        element = self.element(self.links[link][0], "inertial")
        self.element(element, "origin", xyz=numbers_text(inertia.lever))
        self.element(element, "mass", value=repr(float(inertia.mass)))
        moments = {f"i{'xyz'[i]}{'xyz'[j]}": float(inertia.inertia[i, j]) for i in range(3) for j in range(i, 3)}
        self.element(element, "inertia", {name: repr(value) for name, value in moments.items()})

    def link_above(self, frame: int, joint: int) -> str:
        """The first link of a joint among a frame and its ancestors, by default that at the origin of the joint."""
        while 0 < frame < self.model.nframes:
            if self.model.frames[frame].parentJoint == joint and frame in self.of_frame:
                return self.of_frame[frame]
            above = self.model.frames[frame].parentFrame
            frame = above if above < frame else 0
        return self.main[joint]

    def joined(self, name: str, kind: str, parent: str, child: str, placement: pin.SE3) -> Any:
        """Add a joint at a placement in the frame of the joint that moves the parent."""
        element = add_joint(self.robot, name, kind, parent, child)
        self.element(element, "origin", origin_attributes(self.links[parent][2].actInv(placement).homogeneous))
        return element

    def add_fixed(self, number: int, name: str) -> None:
        above = self.model.frames[number].parentFrame
        stated, (_, joint, pose) = self.model.frames[above], self.links[name]
        own = above and stated.type == pin.FrameType.FIXED_JOINT and stated.name not in self.joint_names
        label = stated.name if own else _unused(f"{name}_joint", self.joint_names)
        self.joint_names.add(label)
        self.joined(label, "fixed", self.link_above(above if above < number else 0, joint), name, pose)

    def add_moving(self, joint: int, leader: int | None) -> None:
        model, kind, name = self.model, self.model.joints[joint], self.model.names[joint]
        # its axis and its limits; those of a mimic joint are not in a model
        limits: dict[str, float] = {}
        if leader is not None:
            axis, prismatic = self.mimic_axis(joint, leader)
        elif SINGLE_AXIS.fullmatch(kind.shortname()):
            axis, prismatic = joint_axis(model, joint)
            q, v = kind.idx_q, kind.idx_v  # the lower velocity limit of a URDF is positive in Pinocchio 4.1
            stated = {
                "velocity": min(model.upperVelocityLimit[v], abs(model.lowerVelocityLimit[v])),
                "effort": min(model.upperEffortLimit[v], abs(model.lowerEffortLimit[v])),
            }
            if kind.nq == 1:
                stated |= {"lower": model.lowerPositionLimit[q], "upper": model.upperPositionLimit[q]}
            # Pinocchio has the largest number where no limit was stated
            limits = {key: float(value) for key, value in stated.items() if abs(value) < np.finfo(float).max}
        else:
            raise InputError(
                f"joint {name!r} of the model is a {kind.shortname()}; supported are joints with one degree of "
                "freedom: revolute, continuous, prismatic, mimic. Load the robot without it, such as on a fixed base"
            )
        urdf_kind = "prismatic" if prismatic else "revolute" if {"lower", "upper"} & {*limits} else "continuous"
        # the link that it is mounted on: that of its frame, if the model has one
        frame = model.getFrameId(name, pin.FrameType.JOINT)
        parent = self.link_above(model.frames[frame].parentFrame if frame < model.nframes else 0, model.parents[joint])
        element = self.joined(name, urdf_kind, parent, self.main[joint], model.jointPlacements[joint])
        self.element(element, "axis", xyz=numbers_text(axis))
        self.element(element, "limit", {key: repr(value) for key, value in limits.items()})
        if leader is not None:
            follower = kind.extract()
            factors = {"multiplier": repr(float(follower.scaling)), "offset": repr(float(follower.offset))}
            self.element(element, "mimic", joint=model.names[leader], **factors)

    def mimic_axis(self, joint: int, leader: int) -> tuple[Array, bool]:
        """The axis of a mimic joint, which Pinocchio does not state, from its motion when its leader moves."""
        model, kind = self.model, self.model.joints[joint]
        factor = kind.extract().scaling
        if factor == 0.0:
            raise InputError(f"mimic joint {model.names[joint]!r} of the model has the multiplier 0; make it fixed")
        # Neither joint may turn by more than half a turn, beyond which the angle is ambiguous.
        step, moved = np.zeros(model.nv), STEP / max(1.0, abs(factor))
        step[model.joints[leader].idx_v] = moved
        data, placements = kind.createData(), []
        for q in (pin.neutral(model), pin.integrate(model, pin.neutral(model), step)):
            kind.calc(data, q)
            placements.append(pin.SE3(data.M))
        twist = pin.log6(placements[0].actInv(placements[1])).vector / (moved * factor)
        linear, angular = twist[:3], twist[3:]
        prismatic = bool(np.abs(angular).max() < np.abs(linear).max())
        return (linear if prismatic else angular), prismatic

    def add_geometry(self, thing: Any) -> None:
        """Add a geometry object to a link: a mesh as its file if it is unchanged, else as a file that is written."""
        if not 0 <= thing.parentJoint < self.model.njoints:
            raise InputError(f"geometry {thing.name!r} has the parent joint {thing.parentJoint}, which is not in model")
        link = self.link_above(thing.parentFrame, thing.parentJoint)
        label, (x, y, z) = f"geometry {thing.name!r} of link {link!r}", map(float, thing.meshScale)
        if type(thing.geometry).__name__.startswith("BVH") and mesh_of_file(thing.meshPath, (x, y, z), thing.geometry):
            kind, keys = "mesh", {"filename": str(Path(thing.meshPath).resolve()), "scale": numbers_text((x, y, z))}
        else:
            kind, size, vertices, triangles = coal_shape(label, thing.geometry)
            if kind == "box":
                keys = {"size": numbers_text(size)}
            elif kind in ("sphere", "cylinder", "capsule"):
                keys = {name: repr(float(value)) for name, value in zip(("radius", "length"), size, strict=False)}
            elif kind in ("mesh", "convex"):
                kind, keys = "mesh", {"filename": str(stored_mesh(vertices, triangles))}
            else:
                valid = "Box, Sphere, Cylinder, Capsule, Convex, BVHModel"
                what = f"{label} is a {type(thing.geometry).__name__}, which a URDF cannot have"
                raise InputError(f"{what}; valid for links: {valid}")
        element = self.element(self.links[link][0], "collision")
        pose = self.links[link][2].actInv(thing.placement)
        self.element(element, "origin", origin_attributes(pose.homogeneous))
        self.element(self.element(element, "geometry"), kind, keys)


def _unused(name: str, taken: Any) -> str:
    while name in taken:
        name += "_"
    return name


# -- yourdfpy.URDF -----------------------------------------------------------------------------------------------------


def urdf_of_yourdfpy(source: Any, package_dirs: list[Path]) -> Urdf:
    """Return the description of a ``yourdfpy.URDF`` as it is now; meshes are the files that its handler names."""
    root, robot = source.write_xml().getroot(), source.robot
    # its writer leaves out which joints follow others, and rounds the angles of some poses
    for element, joint in zip(root.findall("joint"), robot.joints, strict=True):
        if joint.mimic is not None and element.find("mimic") is None:
            factors = {name: repr(float(getattr(joint.mimic, name))) for name in ("multiplier", "offset")}
            element.append(element.makeelement("mimic", {"joint": joint.mimic.joint, **factors}))
    for element, thing in _elements(root, robot):
        origin = element.find("origin")
        if origin is not None and thing.origin is not None:
            origin.attrib.update(origin_attributes(np.asarray(thing.origin)))
    for mesh in root.iter("mesh"):
        file = Path(source._filename_handler(mesh.get("filename")))
        if file.is_file():
            mesh.set("filename", str(file.resolve()))
    return urdf_of(root, f"the yourdfpy.URDF {robot.name!r}", None, package_dirs)


def _elements(root: Any, robot: Any) -> Iterator[tuple[Any, Any]]:
    """The elements that have an origin, and their values."""
    yield from zip(root.findall("joint"), robot.joints, strict=True)
    for link, stated in zip(root.findall("link"), robot.links, strict=True):
        for tag, things in ("visual", stated.visuals), ("collision", stated.collisions):
            yield from zip(link.findall(tag), things, strict=True)
        if stated.inertial is not None:
            yield link.find("inertial"), stated.inertial


# -- robot_descriptions ------------------------------------------------------------------------------------------------


def named_description(name: str) -> Any:
    """Import the module of this name of robot_descriptions, which downloads its files at first use.

    InputError if robot_descriptions is not installed, UnknownNameError if it has no description of this name.
    """
    known = optional_module("robot_descriptions", f"robot {name!r}").DESCRIPTIONS
    if name not in known:
        raise UnknownNameError("robot", name, known, "robot_descriptions")
    return importlib.import_module(f"robot_descriptions.{name}")


def description_files(module: Any) -> tuple[Path, Path | None, list[Path], Mapping[str, str]] | None:
    """The file of a module of robot_descriptions, its SRDF, package folders and xacro arguments; None for others."""
    path = next(filter(None, (getattr(module, f"{kind}_PATH", None) for kind in ("URDF", "XACRO", "MJCF"))), None)
    if path is None:
        return None
    package, srdf = Path(module.PACKAGE_PATH), getattr(module, "SRDF_PATH", None)
    folders = [package.parent, package, Path(module.REPOSITORY_PATH), Path(path).parent]
    arguments = getattr(module, "XACRO_ARGS", {}) if Path(path).suffix == ".xacro" else {}
    return Path(path), srdf and Path(srdf), [folder for folder in folders if folder.is_dir()], arguments
