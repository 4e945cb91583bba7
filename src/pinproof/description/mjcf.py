"""Reading MJCF files of robots with a fixed base and hinge and slide joints, with MuJoCo's own parser (extra ``mjcf``).

MuJoCo resolves includes, attached files, default classes, frames and replicated bodies, and validates the file; what it
compiles is converted to a URDF, which is validated as any other URDF. What a URDF cannot represent (ball and free
joints, closed loops, planes and height fields) is an error with its line. What affects neither kinematics nor
collisions (inertias, actuators, sensors, cameras, lights) is ignored.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.common.validation import optional_module
from pinproof.description.srdf import DisabledPair, GroupState, Srdf
from pinproof.description.urdf import Urdf, urdf_of
from pinproof.description.xml_reader import Element, add_joint, numbers_text, origin_attributes
from pinproof.errors import UrdfError
from pinproof.spatial import Array

ROOT = "world"

HIDDEN_GROUP = 3
"""MuJoCo draws geoms of the groups 0 to 2; by convention collision-only geoms are in a higher group."""

AUTO_LIMITED = 2
"""mjLIMITED_AUTO: a joint is limited if it has a range."""

SHAPES = ("sphere", "capsule", "cylinder", "box", "mesh")


def read_mjcf(path: Path) -> tuple[Urdf, Srdf]:
    """Read the robot of an MJCF file; excluded contacts and keyframes are returned as an SRDF.

    The root link is ``world``. Bodies and named sites become links, sites on fixed joints. A hinge without a range is
    continuous. A joint that an equality couples linearly to another joint becomes a mimic joint.

    UrdfError if MuJoCo refuses the file, or for unsupported elements; the message states the line. InputError if the
    extra ``mjcf`` is not installed.
    """
    mujoco = optional_module("mujoco", f"{path} is read by MuJoCo, which", "mjcf")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = spec.compiler.discardvisual = False  # bodies and geoms keep their numbers
        for body in spec.bodies[1:]:  # MuJoCo refuses bodies without mass, which kinematics do not need
            body.explicitinertial, body.mass, body.inertia, body.fullinertia = True, 1.0, np.ones(3), np.full(6, np.nan)
        for mesh in spec.meshes:  # meshes that are only drawn need no volume
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        model = spec.compile()
    except (ValueError, OSError) as error:
        text = " ".join(str(error).removeprefix("Error: ").removeprefix("XML Error: ").split())
        line = re.search(r"line \d+", text)
        raise UrdfError(path, f"is refused by MuJoCo: {text}", line[0] if line else "") from error
    return _Conversion(path, spec, model).result()


class _Conversion:
    """The URDF of a compiled MuJoCo model; ``spec`` has the lines of the elements, with the numbers of the model."""

    def __init__(self, path: Path, spec: Any, model: Any) -> None:
        from lxml import etree

        self.path, self.spec, self.model = path, spec, model
        self.element = etree.SubElement
        self.robot = etree.Element("robot", name=spec.modelname or "robot")
        # Names that the file omits are made of the kind and the number.
        self.bodies = [ROOT, *(model.body(i).name or f"body_{i}" for i in range(1, model.nbody))]
        self.joints = [model.joint(i).name or f"joint_{i}" for i in range(model.njnt)]

    def refuse(self, reason: str, element: Any) -> UrdfError:
        line = re.search(r"line \d+", element.info or element.parent.info)  # a <freejoint> has no line of its own
        return UrdfError(self.path, reason, line[0] if line else "")

    def result(self) -> tuple[Urdf, Srdf]:
        links = [self.element(self.robot, "link", name=name) for name in self.bodies]
        for body in range(1, self.model.nbody):
            self.add_joints(body)
        for geom in self.spec.geoms:
            self.add_geom(links[self.model.geom_bodyid[geom.id]], geom)
        for site in self.spec.sites:
            if site.name:
                name = f"{site.name} (site)" if site.name in self.bodies else site.name
                self.element(self.robot, "link", name=name)
                placed = _pose(self.model.site_pos[site.id], self.model.site_quat[site.id])
                self.joint(f"{name} (fixed)", "fixed", self.bodies[self.model.site_bodyid[site.id]], name, placed)
        self.couple_joints()
        excluded = tuple(
            DisabledPair((pair.bodyname1, pair.bodyname2), "MJCF: excluded") for pair in self.spec.excludes
        )
        # keyframes are the named states of a robot
        states = tuple(
            GroupState(key.name, "", {name: (float(q),) for name, q in zip(self.joints, qpos, strict=True)})
            for key, qpos in zip(self.spec.keys, self.model.key_qpos, strict=True)
        )
        return urdf_of(self.robot, self.path, self.path), Srdf(disabled=excluded, states=states)

    def joint(self, name: str, kind: str, parent: str, child: str, parent_from_joint: Array) -> Element:
        joint = add_joint(self.robot, name, kind, parent, child)
        self.element(joint, "origin", **origin_attributes(parent_from_joint))
        return joint

    def add_joints(self, body: int) -> None:
        """Add the joints between a body and its parent.

        MJCF states several joints of one body by their anchors in the frame of the body; a URDF needs a link behind
        each, with its origin in the anchor, and a fixed joint back to the frame of the body.
        """
        model, name = self.model, self.bodies[body]
        here, anchor = self.bodies[model.body_parentid[body]], np.zeros(3)
        pose = _pose(model.body_pos[body], model.body_quat[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for number in range(first, first + count):
            # joints of a body apply one after the other, so all but the last have a link without geometry
            stated, label, position = self.spec.joints[number], self.joints[number], model.jnt_pos[number]
            kind = ("free", "ball", "slide", "hinge")[model.jnt_type[number]]
            if kind not in ("slide", "hinge"):
                reason = (
                    f"joint {label!r} of body {name!r} is a {kind} joint; valid are hinge and slide on a fixed base"
                )
                raise self.refuse(reason, stated)
            if stated.ref != 0.0:
                raise self.refuse(f"joint {label!r} has a ref other than 0, which is not supported", stated)
            if stated.limited == AUTO_LIMITED and stated.range[0] > stated.range[1]:  # unlimited for MuJoCo
                ends = "{:g} {:g}".format(*stated.range)
                raise self.refuse(f"the range {ends!r} of joint {label!r} has its lower limit above the upper", stated)
            child = name
            if number < first + count - 1 or position.any():
                child = f"{name} (joint {number - first + 1})"
                self.element(self.robot, "link", name=child)
            # its origin is the anchor of the joint, which for MuJoCo is a point of the body
            limited = bool(model.jnt_limited[number])
            urdf_kind = "prismatic" if kind == "slide" else "revolute" if limited else "continuous"
            joint = self.joint(label, urdf_kind, here, child, pose @ _pose(position - anchor))
            self.element(joint, "axis", xyz=numbers_text(model.jnt_axis[number]))
            if limited:
                low, high = model.jnt_range[number].tolist()
                self.element(joint, "limit", lower=repr(low), upper=repr(high))
            here, anchor, pose = child, position, np.eye(4)
        # a body without joints, or whose last anchor is not its origin, is fixed to what moves it
        if here != name:
            self.joint(f"{name} (fixed)", "fixed", here, name, pose @ _pose(-anchor))

    def add_geom(self, link: Element, geom: Any) -> None:
        """Add a geom to a link: as collision geometry if it can collide, as visual geometry if it is drawn."""
        import mujoco

        model, number = self.model, geom.id
        kind = mujoco.mjtGeom(int(model.geom_type[number])).name.removeprefix("mjGEOM_").lower()
        if kind not in SHAPES:
            valid = ", ".join(SHAPES)
            raise self.refuse(f"contains a geom of type {kind}, which is not supported; valid: {valid}", geom)
        pose = _pose(model.geom_pos[number], model.geom_quat[number])
        size = model.geom_size[number].tolist()
        if kind == "mesh":
            shape, pose = self.mesh(int(model.geom_dataid[number]), pose)
        elif kind == "box":  # MJCF states half sides and half lengths
            shape = {"size": numbers_text(2 * side for side in size)}
        else:
            shape = {"radius": repr(size[0]), **({} if kind == "sphere" else {"length": repr(2 * size[1])})}
        # colour and use: what collides, and what MuJoCo draws by default
        material = int(model.geom_matid[number])
        colour = model.geom_rgba[number] if material < 0 else model.mat_rgba[material]
        collides = bool(model.geom_contype[number] or model.geom_conaffinity[number])
        drawn = not collides or model.geom_group[number] < HIDDEN_GROUP
        for tag in (*(["collision"] if collides else []), *(["visual"] if drawn else [])):
            element = self.element(link, tag)
            self.element(element, "origin", **origin_attributes(pose))
            self.element(self.element(element, "geometry"), kind, **shape)
            self.element(self.element(element, "material"), "color", rgba=numbers_text(colour))

    def mesh(self, number: int, link_from_mesh: Array) -> tuple[dict[str, str], Array]:
        """Return the file and scale of a mesh, and the pose of the frame of the file.

        The compiled mesh is centred: mesh_pos and mesh_quat are the pose of its frame in that of the file.
        """
        model, mesh = self.model, self.spec.meshes[number]
        if not mesh.file or np.any(mesh.refpos) or not np.allclose(mesh.refquat, (1, 0, 0, 0)):
            raise self.refuse(f"mesh {mesh.name!r} is not a file, or has a refpos or refquat: not supported", mesh)
        start = int(model.mesh_pathadr[number])
        file = Path(model.paths[start : model.paths.index(b"\0", start)].decode())
        pose = link_from_mesh @ np.linalg.inv(_pose(model.mesh_pos[number], model.mesh_quat[number]))
        return {"filename": str(self.path.resolve().parent / file), "scale": numbers_text(mesh.scale)}, pose

    def couple_joints(self) -> None:
        """Convert linear equalities between two joints to mimic joints; other active ones are errors (closed loops)."""
        import mujoco

        model = self.model
        elements = {joint.get("name"): joint for joint in self.robot.findall("joint")}
        for equality in self.spec.equalities:
            number = equality.id
            if not model.eq_active0[number]:
                continue
            offset, factor, *higher = model.eq_data[number][:5].tolist()
            # a URDF has linear couplings of two joints only
            between = model.eq_type[number] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj2id[number] >= 0
            if not between or any(higher):
                kind = mujoco.mjtEq(int(model.eq_type[number])).name.removeprefix("mjEQ_").lower()
                reason = f"the equality <{kind}> is not a linear coupling of two joints; only these are supported"
                raise self.refuse(reason, equality)
            follower, leader = self.joints[model.eq_obj1id[number]], self.joints[model.eq_obj2id[number]]
            factors = {"multiplier": repr(factor), "offset": repr(offset)}
            self.element(elements[follower], "mimic", joint=leader, **factors)


def _pose(xyz: Array, quat_wxyz: Array = np.array([1.0, 0.0, 0.0, 0.0])) -> Array:  # noqa: B008
    """Return the pose (4, 4) of a position and a unit quaternion with w first, as MuJoCo stores them."""
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(quat_wxyz[[1, 2, 3, 0]]).as_matrix()
    pose[:3, 3] = xyz
    return pose
