"""MoveIt planning scenes (moveit_msgs/PlanningScene), as YAML or as a message: obstacles and the allowed collisions.

MoveIt writes the values of a message as mappings (``position: {x: 0, y: 0, z: 1}``), others, such as the scenes of
MotionBenchMaker, as lists (``position: [0, 0, 1]``); both are read. Nothing is dropped silently:

- an object of several shapes becomes the obstacles NAME/1, NAME/2, ...; a plane becomes the half-space behind it;
- a watertight mesh is a solid of its own shape; any other is replaced by its convex hull, with a note of the scene;
- contacts that the matrix allows between a link and an object are allowed; pairs of links are listed in
  :attr:`Scene.disabled <pinproof.Scene.disabled>`;
- the frame of the objects must be the robot's root: empty, ``world``, one of the fixed frames of the file, or the name
  of the root link, which the checker compares; if the file places a floating robot, that pose is inverted;
- an octomap (binary or full) becomes the obstacle ``<octomap>``, an :class:`~pinproof.OccupancyGrid`. MoveIt treats its
  unknown cells as free; here they are obstacles, with a note;
- attached objects and operations other than ADD are refused; paddings and scales of links become a note.

Joint positions are not read: joints outside the arm keep the values that the arm holds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinproof.collision.geometry.bodies import triangles_of
from pinproof.collision.geometry.hulls import Solid, hull_triangles, rounded_corners
from pinproof.collision.geometry.occupancy import OccupancyGrid
from pinproof.collision.geometry.octomap_file import octomap_leaves
from pinproof.collision.geometry.shapes import (
    ANYTHING,
    Box,
    Capsule,
    Cone,
    ConvexShape,
    Cylinder,
    HalfSpace,
    Mesh,
    Obstacle,
    Shape,
    Sphere,
)
from pinproof.common.files import LinedMapping, refuse_unknown
from pinproof.common.structs import parsed
from pinproof.description import locate
from pinproof.errors import FileError, InputError, MeshError, SceneError
from pinproof.spatial import Array, finite, pose

OCTOMAP = "<octomap>"

Pairs = list[tuple[str, str]]


def allowed_pairs(path: Path, matrix: Mapping[str, Any], parts: Mapping[str, tuple[str, ...]]) -> tuple[Pairs, Pairs]:
    """Return the pairs (robot link, obstacle) that may touch, and the pairs of robot links that the matrix disables.

    ``parts`` are the obstacles made of each object of the file; every other name is assumed to be a robot link.
    """
    names = [str(name) for name in matrix.get("entry_names") or []]
    rows: list[Any] = [
        row.get("enabled") if isinstance(row, Mapping) else row for row in matrix.get("entry_values") or []
    ]
    if len(rows) != len(names) or any(not isinstance(row, list) or len(row) != len(names) for row in rows):
        raise SceneError(
            path, "entry_values is not square with a row for each of entry_names", "allowed_collision_matrix"
        )
    # An entry overrides the defaults, and a pair of two defaults needs both, as in MoveIt
    # (AllowedCollisionMatrix::getAllowedCollision). A pair whose two entries differ is not allowed.
    entries = {
        frozenset((names[i], names[j])): rows[i][j] is True and rows[j][i] is True
        for i, j in combinations(range(len(names)), 2)
    }
    default_names, values = matrix.get("default_entry_names") or [], matrix.get("default_entry_values") or []
    if len(default_names) != len(values):
        raise SceneError(path, "default_entry_values has another length than its names", "allowed_collision_matrix")
    defaults = {str(name): value is True for name, value in zip(default_names, values, strict=True)}
    links = sorted({*names, *defaults} - set(parts) - {OCTOMAP})

    def may_touch(a: str, b: str) -> bool:
        by_default = [defaults[name] for name in (a, b) if name in defaults]
        return entries.get(frozenset((a, b)), bool(by_default) and all(by_default))

    allowed: Pairs = []
    for thing, pieces in parts.items():
        touching = [link for link in links if may_touch(link, thing)]
        if defaults.get(thing, False):
            if len(touching) < len(links):
                refused = ", ".join(link for link in links if link not in touching)
                reason = (
                    f"lets {thing!r} touch anything by default, but not {refused}; list the links that it may touch"
                )
                raise SceneError(path, reason, "allowed_collision_matrix")
            touching = [ANYTHING]
        allowed += [(link, piece) for piece in pieces for link in touching]
    return allowed, [(a, b) for a, b in combinations(links, 2) if may_touch(a, b)]


SCENE_KEYS = (
    "name", "robot_state", "robot_model_name", "fixed_frame_transforms", "allowed_collision_matrix", "link_padding",
    "link_scale", "object_colors", "world", "is_diff",
)  # fmt: skip
OBJECT_KEYS = (
    "id", "header", "pose", "type", "operation", "primitives", "primitive_poses", "meshes", "mesh_poses", "planes",
    "plane_poses", "subframe_names", "subframe_poses",
)  # fmt: skip

TREE_KEYS = ("header", "binary", "id", "resolution", "data")

PRIMITIVES = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}
"""The numbers of shape_msgs/SolidPrimitive."""

COUNTS = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}

WORLD = ("", "world")
"""Names of the frame of the robot's root."""


def is_moveit(content: Mapping[str, Any]) -> bool:
    """Whether a YAML file is a MoveIt planning scene and not a pinproof scene."""
    return "world" in content and "obstacles" not in content


ADD = (None, 0, "ADD", "add", b"\x00", "\x00")
"""The values of ``operation`` that add an object: by name, and as a byte of a message of ROS 2."""


def read_moveit_message(message: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a scene for a message of nested mappings and lists, as :func:`read_moveit_scene` does."""
    return read_moveit_scene(Path("moveit_msgs/PlanningScene"), _lined(message))


def _lined(value: Any) -> Any:
    """The same nested mappings and lists with mappings that have a line, 0."""
    if isinstance(value, Mapping):
        mapping = LinedMapping({key: _lined(each) for key, each in value.items()})
        mapping.line = 0
        return mapping
    return [_lined(each) for each in value] if isinstance(value, (list, tuple)) else value


def moveit_message(
    obstacles: Sequence[Obstacle], allowed: Sequence[tuple[str, str]], disabled: Sequence[tuple[str, str]], frame: str
) -> dict[str, Any]:
    """Return the fields of a planning scene that adds obstacles: a difference (``is_diff``) to the present scene.

    InputError if the message has no shape for an obstacle.
    """
    # Obstacles with their shapes and colours.
    header = {"frame_id": frame or WORLD[1]}
    objects = [
        {"header": header, "id": each.name, **_pose_fields(each.pose), **_shape_fields(each)} for each in obstacles
    ]
    colours = [
        {"id": each.name, "color": dict(zip("rgba", map(float, each.rgba), strict=True))}
        for each in obstacles
        if each.rgba is not None
    ]
    message: dict[str, Any] = {"is_diff": True, "world": {"collision_objects": objects}, "object_colors": colours}
    if allowed or disabled:  # the matrix of these pairs and no others; a body that may touch anything is a default
        pairs = {frozenset(pair) for pair in (*allowed, *disabled) if ANYTHING not in pair}
        names = sorted({name for pair in pairs for name in pair})
        anything = sorted({name for pair in allowed if ANYTHING in pair for name in pair if name != ANYTHING})
        message["allowed_collision_matrix"] = {
            "entry_names": names,
            "entry_values": [{"enabled": [frozenset((a, b)) in pairs for b in names]} for a in names],
            "default_entry_names": anything,
            "default_entry_values": [True] * len(anything),
        }
    return message


def _shape_fields(obstacle: Obstacle) -> dict[str, Any]:
    """The shapes of an obstacle, in its own frame."""
    shape = obstacle.shape
    # Primitives: number of the kind, dimensions, and height in the frame of the obstacle.
    if isinstance(shape, Box):
        parts = [(1, [shape.x, shape.y, shape.z], 0.0)]
    elif isinstance(shape, Sphere):
        parts = [(2, [shape.radius], 0.0)]
    elif isinstance(shape, (Cylinder, Cone)):
        parts = [(3 if isinstance(shape, Cylinder) else 4, [shape.length, shape.radius], 0.0)]
    elif isinstance(shape, Capsule):
        balls = [(2, [shape.radius], side * shape.length / 2) for side in (-1, 1)]
        parts = [(3, [shape.length, shape.radius], 0.0), *balls]
    # A plane has its material behind it; all else is a mesh.
    elif isinstance(shape, HalfSpace):
        return {"planes": [{"coef": [0.0, 0.0, 1.0, 0.0]}], "plane_poses": [_pose_fields(pin.SE3.Identity())["pose"]]}
    elif isinstance(shape, (Mesh, ConvexShape)):
        if isinstance(shape, ConvexShape):
            vertices, hull = rounded_corners(shape.points, shape.radius), True
        else:
            read = triangles_of(shape)
            vertices, triangles, hull = read.vertices, read.triangles, bool(shape.hull)
        if hull:  # only the vertices of the hull
            used, triangles = np.unique(hull_triangles(vertices), return_inverse=True)
            vertices, triangles = vertices[used], triangles.reshape(-1, 3)
        points = [dict(zip("xyz", row, strict=True)) for row in vertices.tolist()]
        mesh = {"vertices": points, "triangles": [{"vertex_indices": row} for row in triangles.tolist()]}
        return {"meshes": [mesh], "mesh_poses": [_pose_fields(pin.SE3.Identity())["pose"]]}
    else:
        valid = "box, sphere, cylinder, cone, capsule, half-space, mesh and convex hull"
        raise InputError(
            f"a planning scene has no shape for the {type(shape).__name__} {obstacle.name!r}; it has shapes for {valid}"
        )
    poses = [_pose_fields(pin.SE3(np.eye(3), np.array([0.0, 0.0, z])))["pose"] for _, _, z in parts]
    return {"primitives": [{"type": k, "dimensions": sizes} for k, sizes, _ in parts], "primitive_poses": poses}


def _pose_fields(place: pin.SE3) -> dict[str, Any]:
    """The field ``pose``, a geometry_msgs/Pose."""
    quaternion = pin.Quaternion(place.rotation).coeffs().tolist()  # x y z w
    position = dict(zip("xyz", place.translation.tolist(), strict=True))
    return {"pose": {"position": position, "orientation": dict(zip("xyzw", quaternion, strict=True))}}


def read_moveit_scene(path: Path, content: LinedMapping) -> dict[str, Any]:
    """Return the arguments of a scene for a planning scene; SceneError, with file, line and object, if it cannot."""
    try:
        return _scene(path, content)
    except InputError as error:
        raise SceneError(path, str(error)) from error
    except (AttributeError, KeyError, TypeError) as error:  # a value of the wrong type in the message
        raise SceneError(path, f"is not structured as moveit_msgs/PlanningScene: {error}") from error


def _scene(path: Path, content: LinedMapping) -> dict[str, Any]:
    # Keys that are not known, and bodies that the robot carries, are refused.
    refuse_unknown(SceneError, path, "key of a planning scene", content, SCENE_KEYS, "")
    world = _mapping(path, content["world"], "world")
    refuse_unknown(SceneError, path, "key of world", world, ("collision_objects", "octomap"), "")
    state = _mapping(path, content.get("robot_state") or {}, "robot_state")
    attached = state.get("attached_collision_objects") or []
    carried = [f"{(part.get('object') or {}).get('id')!r} on {part.get('link_name')!r}" for part in attached]
    if carried:
        how = "remove them from the file and pass them to the CollisionChecker as attached"
        raise SceneError(path, f"has objects attached to the robot ({', '.join(carried)}), which are not read; {how}")
    # What is read, and what is noted because it is not applied.
    frames = _Frames(path, content, state)
    colours = {part.get("id"): part.get("color") for part in content.get("object_colors") or []}
    notes = [
        f"{key} is not applied; use the checker's margin"
        for key, word, nothing in (("link_padding", "padding", 0.0), ("link_scale", "scale", 1.0))
        if any(part.get(word, nothing) != nothing for part in content.get(key) or [])
    ]
    obstacles = _octomap(path, _mapping(path, world.get("octomap") or {}, "octomap"), frames, notes)
    parts: dict[str, tuple[str, ...]] = {each.name: (each.name,) for each in obstacles}
    # Each object becomes one obstacle for each of its shapes.
    objects = world.get("collision_objects") or []
    if not isinstance(objects, list):
        what = f"is {objects!r}, not a list; write '- ' before each element"
        raise SceneError(path, what, "key world.collision_objects")
    for stated in objects:
        name, where = _name(path, stated)
        if name in parts:
            raise SceneError(path, f"a second object is named {name!r}", where)
        try:
            shapes = _shapes(path, stated, notes, name)
            root_from_object = frames.placed(stated, where)
            colour, rgba = colours.get(name), None
            if isinstance(colour, Mapping) and float(colour.get("a", 0.0)) > 0:
                r, g, b, a = (float(colour.get(key, 0.0)) for key in "rgba")
                rgba = (r, g, b, a)
            names = [name] if len(shapes) == 1 else [f"{name}/{i}" for i in range(1, len(shapes) + 1)]
            made = [
                Obstacle(n, shape, root_from_object * at, rgba) for n, (shape, at) in zip(names, shapes, strict=True)
            ]
        except (InputError, MeshError, AttributeError, KeyError, TypeError) as error:
            raise SceneError(path, str(error), where) from error
        obstacles += made
        parts[name] = tuple(names)
    allowed, disabled = allowed_pairs(path, content.get("allowed_collision_matrix") or {}, parts)
    pairs = {"allowed": allowed, "disabled": disabled}
    return {"obstacles": obstacles, **pairs, "frame": frames.root, "notes": notes}


def _octomap(path: Path, stated: Mapping[str, Any], frames: _Frames, notes: list[str]) -> list[Obstacle]:
    """The obstacle of an octomap_msgs/OctomapWithPose; none if it is empty."""
    tree = _mapping(path, stated.get("octomap") or {}, "octomap")
    where = "key octomap"
    refuse_unknown(SceneError, path, "key of world.octomap", stated, ("header", "origin", "octomap"), where)
    refuse_unknown(SceneError, path, "key of the octomap", tree, TREE_KEYS, where)
    data = tree.get("data")
    if data is None or len(data) == 0:
        return []
    missing = [key for key in ("binary", "id", "resolution") if key not in tree]
    if missing:
        raise SceneError(path, f"does not state {' and '.join(missing)} of the octomap", where)
    if not isinstance(tree["binary"], bool):
        raise SceneError(path, f"states binary = {tree['binary']!r}, which is neither true nor false", where)
    # The data are signed bytes in messages, and may be a list of integers in YAML.
    try:
        if not isinstance(data, bytes | bytearray):
            numbers = np.asarray(data)
            if numbers.ndim != 1 or numbers.dtype.kind not in "iu" or numbers.min() < -128 or numbers.max() > 255:
                raise InputError("the data of the octomap must be a list of integers of 8 bits")
            data = numbers.astype(np.int64).astype(np.uint8).tobytes()
        resolution = float(finite("resolution of the octomap", tree["resolution"], ()))
        leaves = octomap_leaves(path, bytes(data), str(tree["id"]), resolution, binary=tree["binary"])
        grid = OccupancyGrid.from_octomap(replace(leaves, source=f"octomap in {path.name}"))
    except (FileError, InputError, ValueError, OverflowError) as error:
        raise SceneError(path, str(getattr(error, "reason", error)), where) from error
    notes.append(
        "space that is unknown in the octomap is an obstacle, which it is not in MoveIt; "
        "pinproof.collision.remove_robot removes the robot from the grid"
    )
    root_from_map = frames.placed({"header": stated.get("header"), "pose": stated.get("origin")}, where)
    return [Obstacle(OCTOMAP, grid, root_from_map)]


class _Frames:
    """The poses of the frames of the file in the frame of the robot's root."""

    def __init__(self, path: Path, content: LinedMapping, state: Mapping[str, Any]) -> None:
        self._path, self.root = path, ""
        self._root_from: dict[str, pin.SE3] = {}
        floating = state.get("multi_dof_joint_state") or {}
        transforms = floating.get("transforms") or []
        if len(transforms) > 1:
            raise SceneError(path, f"moves the robot by {len(transforms)} floating joints; at most one is supported")
        root_from_world = _transform(transforms[0]).inverse() if transforms else pin.SE3.Identity()
        # Frames of the file are fixed to the world, which may be another frame than the root.
        for stated in content.get("fixed_frame_transforms") or []:
            world_from_frame = _transform(stated.get("transform") or {})
            self._root_from[str(stated.get("child_frame_id", ""))] = root_from_world * world_from_frame
            planning = str((stated.get("header") or {}).get("frame_id", ""))
            self._root_from.setdefault(planning, root_from_world)
        for name in WORLD:
            self._root_from.setdefault(name, root_from_world)

    def placed(self, stated: Mapping[str, Any], where: str) -> pin.SE3:
        """Return root_from_object, including the object's own pose."""
        frame = str((stated.get("header") or {}).get("frame_id") or "").lstrip("/")
        if frame not in self._root_from:
            if self.root and frame != self.root:
                known = ", ".join(repr(name) for name in (*self._root_from, self.root))
                raise SceneError(
                    self._path, f"is in the frame {frame!r}, which the file does not define; known: {known}", where
                )
            self.root = frame
        return self._root_from.get(frame, pin.SE3.Identity()) * _pose(stated.get("pose"))


def _shapes(path: Path, stated: Mapping[str, Any], notes: list[str], name: str) -> list[tuple[Shape, pin.SE3]]:
    """Return the shapes of an object, each with object_from_shape."""
    refuse_unknown(SceneError, path, "key of a collision object", stated, OBJECT_KEYS, f"object {name!r}")
    if stated.get("operation") not in ADD:
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
                # The half-space a x + b y + c z + d <= 0 of a plane.
                a, b, c, d = finite("coef of a plane", parsed(thing.get("coef")), (4,))
                normal = np.array([a, b, c])
                length = float(np.linalg.norm(normal))
                if length < 1e-9:
                    raise InputError(f"coef of a plane: the normal {normal.tolist()} has no length")
                turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), normal / length)
                shape = HalfSpace()
                object_from_thing = object_from_thing * pin.SE3(turn, -d / length**2 * normal)
                notes.append(f"the plane of {name!r} is read as the half-space behind it")
            made.append((shape, object_from_thing))
    if not made:
        raise InputError("has no primitives, meshes or planes")
    return made


def _primitive(stated: Mapping[str, Any]) -> Shape:
    """Return a primitive; the height of a cylinder or cone is before its radius (shape_msgs/SolidPrimitive)."""
    kind = stated.get("type")
    kind = PRIMITIVES.get(kind, kind) if isinstance(kind, int) else str(kind).lower()
    if kind not in COUNTS:
        raise InputError(f"a primitive of the type {kind!r} is not read; valid: {', '.join(COUNTS)}")
    sizes = finite(f"dimensions of a {kind}", parsed(stated.get("dimensions")), (COUNTS[kind],)).tolist()
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
            places = "\n  ".join(str(place) for place in found.searched)
            raise InputError(f"the mesh {found.uri} was not found; it was looked for in\n  {places}")
        scale = parsed(stated.get("dimensions", [1.0, 1.0, 1.0]))
        mesh = Mesh(found.path, tuple(scale) if isinstance(scale, list) else scale)
    else:
        vertices = [_three(part) for part in stated.get("vertices") or []]
        triangles = [
            part["vertex_indices"] if isinstance(part, dict) else part for part in stated.get("triangles") or []
        ]
        mesh = Mesh.from_arrays(vertices, triangles)
    # A mesh that is not watertight has no inside, so that its hull is the obstacle.
    read = triangles_of(mesh)
    if Solid(read.vertices, read.triangles).watertight:
        return mesh
    notes.append(f"a mesh of {name!r} is not watertight, so its convex hull is used")
    return replace(mesh, hull=True)


def _name(path: Path, stated: object) -> tuple[str, str]:
    if not isinstance(stated, LinedMapping):
        raise SceneError(path, f"{stated!r} is not a collision object", "key world.collision_objects")
    name = stated.get("id")
    if not isinstance(name, str) or not name:
        raise SceneError(path, f"an object has the id {name!r}, which is not a text", f"line {stated.line}")
    return name, f"line {stated.line}, object {name!r}" if stated.line else f"object {name!r}"


def _transform(stated: Mapping[str, Any]) -> pin.SE3:
    return _pose({"position": stated.get("translation"), "orientation": stated.get("rotation")})


def _pose(stated: object) -> pin.SE3:
    """Return a pose; missing values are zero, and a quaternion of zeros is the identity, as in MoveIt."""
    if stated is None:
        return pin.SE3.Identity()
    if not isinstance(stated, Mapping):
        raise InputError(f"{stated!r} is not a pose with position and orientation")
    rotation, quaternion = stated.get("orientation"), None
    if rotation is not None:
        listed = [rotation.get(key, 0.0) for key in "xyzw"] if isinstance(rotation, Mapping) else rotation
        quaternion = finite("orientation", parsed(listed), (4,)).tolist()
    position = _three(stated["position"]) if stated.get("position") is not None else np.zeros(3)
    return pose(position.tolist(), quat_xyzw=quaternion if quaternion is not None and any(quaternion) else None)


def _three(stated: object) -> Array:
    values = [stated.get(key, 0.0) for key in "xyz"] if isinstance(stated, Mapping) else stated
    return finite("position", parsed(values), (3,))


def _mapping(path: Path, stated: object, key: str) -> Mapping[str, Any]:
    if not isinstance(stated, Mapping):
        raise SceneError(path, f"holds {stated!r}, not a mapping", f"key {key}")
    return stated
