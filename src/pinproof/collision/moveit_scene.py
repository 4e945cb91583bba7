"""MoveIt planning scenes (moveit_msgs/PlanningScene as YAML): obstacles, and contacts that are meant to be.

What a message may hold is written by MoveIt as mappings (``position: {x: 0, y: 0, z: 1}``) and by others, such as the
scenes of MotionBenchMaker, as lists (``position: [0, 0, 1]``); both are read. So that nothing is dropped silently:

- an object of several shapes becomes the obstacles NAME/1, NAME/2, ...; a plane becomes the half-space behind it;
- a watertight mesh is solid in its own shape; another one becomes its convex hull, and a note of the scene says so;
- contacts that the matrix allows between a link and an object are allowed; pairs of links stand in
  :attr:`Scene.disabled <pinproof.Scene.disabled>`;
- the frame of the objects must be the robot's root: given empty, as ``world``, as one of the file's own fixed frames,
  or by the name of the root link, which the checker compares; where the file places a floating robot, that is undone;
- attached objects, octomaps and operations other than ADD are refused; paddings and scales of links stand in a note.

Joint positions are not read: joints outside the arm stand where the arm holds them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinproof.collision.bodies import triangles_of
from pinproof.collision.moveit_matrix import allowed_pairs
from pinproof.collision.scene import Obstacle, Scene
from pinproof.collision.shape_file import numbers_of
from pinproof.collision.shapes import Box, Cone, Cylinder, HalfSpace, Mesh, Shape, Sphere
from pinproof.collision.solid import Solid
from pinproof.common.yaml_file import LinedMapping, refuse_unknown, require_list
from pinproof.description.packages import locate
from pinproof.errors import InputError, MeshError, SceneError
from pinproof.spatial import Array, finite, pose

__all__ = ["is_moveit", "moveit_scene"]

SCENE_KEYS = (
    "name", "robot_state", "robot_model_name", "fixed_frame_transforms", "allowed_collision_matrix", "link_padding",
    "link_scale", "object_colors", "world", "is_diff",
)  # fmt: skip
OBJECT_KEYS = (
    "id", "header", "pose", "type", "operation", "primitives", "primitive_poses", "meshes", "mesh_poses", "planes",
    "plane_poses", "subframe_names", "subframe_poses",
)  # fmt: skip

PRIMITIVES = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}
"""The numbers of shape_msgs/SolidPrimitive."""

COUNTS = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}

WORLD = ("", "world")
"""Names of the frame the robot stands in."""


def is_moveit(content: Mapping[str, Any]) -> bool:
    """Whether a YAML file is a planning scene and not one of ours."""
    return "world" in content and "obstacles" not in content


def moveit_scene(path: Path, content: LinedMapping) -> Scene:
    """The scene that a planning scene states.

    Raises
    ------
    SceneError
        If it says something that cannot be obeyed; names file, line and object.
    """
    try:
        return _scene(path, content)
    except InputError as error:
        raise SceneError(path, str(error)) from error
    except (AttributeError, KeyError, TypeError) as error:  # a number where a mapping belongs, somewhere in the message
        raise SceneError(path, f"is not laid out as moveit_msgs/PlanningScene: {error}") from error


def _scene(path: Path, content: LinedMapping) -> Scene:
    refuse_unknown(SceneError, path, "key of a planning scene", content, SCENE_KEYS, "")
    world = _mapping(path, content["world"], "world")
    refuse_unknown(SceneError, path, "key of world", world, ("collision_objects", "octomap"), "")
    state = _mapping(path, content.get("robot_state") or {}, "robot_state")
    carried = [_carried(part) for part in state.get("attached_collision_objects") or []]
    if carried:
        how = "take them out of the file and give them to the CollisionChecker as attached"
        raise SceneError(path, f"has objects attached to the robot ({', '.join(carried)}), which are not read; {how}")
    octomap = world.get("octomap") or {}
    if (octomap.get("octomap") or octomap).get("data"):
        raise SceneError(path, "holds an octomap, which is not read; give its points as a PointCloud", "key octomap")
    frames = _Frames(path, content, state)
    colours = {part.get("id"): part.get("color") for part in content.get("object_colors") or []}
    notes = [
        f"{key} is not applied; use the checker's margin"
        for key in ("link_padding", "link_scale")
        if _told(content, key)
    ]
    obstacles: list[Obstacle] = []
    parts: dict[str, tuple[str, ...]] = {}
    for stated in require_list(SceneError, path, "world.collision_objects", world.get("collision_objects") or []):
        name, where = _name(path, stated)
        if name in parts:
            raise SceneError(path, f"a second object is named {name!r}", where)
        try:
            shapes = _shapes(path, stated, notes, name)
            root_from_object = frames.placed(stated, where)
            rgba = _colour(colours.get(name))
            names = [name] if len(shapes) == 1 else [f"{name}/{i}" for i in range(1, len(shapes) + 1)]
            made = [
                Obstacle(n, shape, root_from_object * at, rgba) for n, (shape, at) in zip(names, shapes, strict=True)
            ]
        except (InputError, MeshError, AttributeError, KeyError, TypeError) as error:
            raise SceneError(path, str(error), where) from error
        obstacles += made
        parts[name] = tuple(names)
    allowed, disabled = allowed_pairs(path, content.get("allowed_collision_matrix") or {}, parts)
    return Scene(obstacles, allowed=allowed, disabled=disabled, frame=frames.root, notes=notes, source=path)


class _Frames:
    """Where the frames of the file lie in that of the robot's root."""

    def __init__(self, path: Path, content: LinedMapping, state: Mapping[str, Any]) -> None:
        self._path, self.root = path, ""
        self._root_from: dict[str, pin.SE3] = {}
        floating = state.get("multi_dof_joint_state") or {}
        transforms = floating.get("transforms") or []
        if len(transforms) > 1:
            raise SceneError(path, f"moves the robot by {len(transforms)} floating joints; one can be undone")
        root_from_world = _transform(transforms[0]).inverse() if transforms else pin.SE3.Identity()
        for stated in content.get("fixed_frame_transforms") or []:
            world_from_frame = _transform(stated.get("transform") or {})
            self._root_from[str(stated.get("child_frame_id", ""))] = root_from_world * world_from_frame
            planning = str((stated.get("header") or {}).get("frame_id", ""))
            self._root_from.setdefault(planning, root_from_world)
        for name in WORLD:
            self._root_from.setdefault(name, root_from_world)

    def placed(self, stated: Mapping[str, Any], where: str) -> pin.SE3:
        """root_from_object, where the object's own pose counts too."""
        frame = str((stated.get("header") or {}).get("frame_id") or "").lstrip("/")
        if frame not in self._root_from:
            if self.root and frame != self.root:
                known = ", ".join(repr(name) for name in (*self._root_from, self.root))
                raise SceneError(
                    self._path, f"stands in the frame {frame!r}, which the file does not place; known: {known}", where
                )
            self.root = frame
        return self._root_from.get(frame, pin.SE3.Identity()) * _pose(stated.get("pose"))


def _shapes(path: Path, stated: Mapping[str, Any], notes: list[str], name: str) -> list[tuple[Shape, pin.SE3]]:
    """The shapes of an object and object_from_shape."""
    refuse_unknown(SceneError, path, "key of a collision object", stated, OBJECT_KEYS, f"object {name!r}")
    if stated.get("operation") not in (None, 0, "ADD", "add"):
        raise InputError(f"operation {stated['operation']!r} is not read; a scene file adds its objects")
    made: list[tuple[Shape, pin.SE3]] = []
    for key in ("primitive", "mesh", "plane"):
        things = stated.get({"mesh": "meshes"}.get(key, f"{key}s")) or []
        poses = stated.get(f"{key}_poses") or []
        if len(poses) not in (0, len(things)):
            raise InputError(f"{len(things)} of its shapes are of the kind {key}, with {len(poses)} poses")
        for i, thing in enumerate(things):
            object_from_thing = _pose(poses[i] if poses else None)
            if key == "primitive":
                shape: Shape = _primitive(thing)
            elif key == "mesh":
                shape = _mesh(path, thing, notes, name)
            else:
                shape, thing_from_half = _half_space(thing)
                object_from_thing = object_from_thing * thing_from_half
                notes.append(f"the plane of {name!r} is taken as all that lies behind it")
            made.append((shape, object_from_thing))
    if not made:
        raise InputError("has no primitives, meshes or planes")
    return made


def _primitive(stated: Mapping[str, Any]) -> Shape:
    """A primitive; the height of a cylinder or cone comes before its radius (shape_msgs/SolidPrimitive)."""
    kind = stated.get("type")
    kind = PRIMITIVES.get(kind, kind) if isinstance(kind, int) else str(kind).lower()
    if kind not in COUNTS:
        raise InputError(f"a primitive of the type {kind!r} is not read; valid: {', '.join(COUNTS)}")
    sizes = finite(
        f"dimensions of a {kind}", numbers_of("dimensions", stated.get("dimensions")), (COUNTS[kind],)
    ).tolist()
    if kind == "box":
        return Box(*sizes)
    if kind == "sphere":
        return Sphere(*sizes)
    height, radius = sizes
    return Cylinder(radius, height) if kind == "cylinder" else Cone(radius, height)


def _mesh(path: Path, stated: Mapping[str, Any], notes: list[str], name: str) -> Mesh:
    if "resource" in stated:
        found = locate(str(stated["resource"]), path.parent, ())
        if found.path is None:
            places = "\n  ".join(str(place) for place in found.looked_in)
            raise InputError(f"the mesh {found.uri} was not found; it was looked for in\n  {places}")
        scale = numbers_of("dimensions", stated.get("dimensions", [1.0, 1.0, 1.0]))
        mesh = Mesh(found.path, tuple(scale) if isinstance(scale, list) else scale)
    else:
        vertices = [_three(part) for part in stated.get("vertices") or []]
        triangles = [
            part["vertex_indices"] if isinstance(part, dict) else part for part in stated.get("triangles") or []
        ]
        mesh = Mesh.from_arrays(vertices, triangles)
    read = triangles_of(mesh)
    if Solid(read.vertices, read.triangles).watertight:
        return mesh
    notes.append(f"a mesh of {name!r} is not watertight: its hull is taken")
    return replace(mesh, hull=True)


def _half_space(stated: Mapping[str, Any]) -> tuple[HalfSpace, pin.SE3]:
    """The half-space a x + b y + c z + d <= 0 of a plane, and plane_from_half_space."""
    a, b, c, d = finite("coef of a plane", numbers_of("coef", stated.get("coef")), (4,))
    normal = np.array([a, b, c])
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        raise InputError(f"coef of a plane: the normal {normal.tolist()} has no length")
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), normal / length)
    return HalfSpace(), pin.SE3(turn, -d / length**2 * normal)


def _name(path: Path, stated: object) -> tuple[str, str]:
    if not isinstance(stated, LinedMapping):
        raise SceneError(path, f"{stated!r} is no collision object", "key world.collision_objects")
    name = stated.get("id")
    if not isinstance(name, str) or not name:
        raise SceneError(path, f"an object has the id {name!r}, which is no text", f"line {stated.line}")
    return name, f"line {stated.line}, object {name!r}"


def _carried(stated: Mapping[str, Any]) -> str:
    return f"{(stated.get('object') or {}).get('id')!r} on {stated.get('link_name')!r}"


def _told(content: Mapping[str, Any], key: str) -> bool:
    """Whether a padding or a scale of a link is other than none."""
    word, nothing = ("padding", 0.0) if key == "link_padding" else ("scale", 1.0)
    return any(part.get(word, nothing) != nothing for part in content.get(key) or [])


def _colour(stated: object) -> tuple[float, float, float, float] | None:
    if not isinstance(stated, Mapping):
        return None
    r, g, b, a = (float(stated.get(key, 0.0)) for key in "rgba")
    return (r, g, b, a) if a > 0 else None


def _transform(stated: Mapping[str, Any]) -> pin.SE3:
    return _pose({"position": stated.get("translation"), "orientation": stated.get("rotation")})


def _pose(stated: object) -> pin.SE3:
    """A pose; what is not told is zero, and a quaternion of zeros is unturned, as MoveIt takes it."""
    if stated is None:
        return pin.SE3.Identity()
    if not isinstance(stated, Mapping):
        raise InputError(f"{stated!r} is no pose; wanted are position and orientation")
    told = stated.get("orientation")
    quaternion = [told.get(key, 0.0) for key in "xyzw"] if isinstance(told, Mapping) else told
    quaternion = None if quaternion is None else numbers_of("orientation", quaternion)
    position = _three(stated["position"]) if stated.get("position") is not None else np.zeros(3)
    return pose(position.tolist(), quat_xyzw=quaternion if quaternion is not None and np.any(quaternion) else None)


def _three(stated: object) -> Array:
    values = [stated.get(key, 0.0) for key in "xyz"] if isinstance(stated, Mapping) else stated
    return finite("position", numbers_of("position", values), (3,))


def _mapping(path: Path, stated: object, key: str) -> Mapping[str, Any]:
    if not isinstance(stated, Mapping):
        raise SceneError(path, f"holds {stated!r}, not a mapping", f"key {key}")
    return stated
