"""Scenes as files, in YAML.

::

    obstacles:
      - name: table
        box: [1.6, 1.2, 0.04]              # full sides x, y, z
        xyz: [0.4, 0, -0.025]              # where its centre lies; without it the origin
        rpy: [0, 0, pi/2]                  # fixed axes; or quat_xyzw: [x, y, z, w]; without either unturned
        rgba: [0.6, 0.5, 0.4, 1]           # optional: how it is drawn, 0 to 1
      - {name: ball, sphere: {radius: 0.1}}
      - {name: bolt, cylinder: {radius: 0.008, length: 0.04}}
      - {name: pipe, capsule: {radius: 0.02, length: 0.3}}
      - {name: part, mesh: {path: part.stl, scale: 0.001}}                 # relative to the scene file
      - {name: floor, half_space: {}, xyz: [0, 0, -0.1]}                   # solid below its z = 0
    allowed_contacts:
      - [base_link, table]                 # a robot link and an obstacle that are meant to touch

    disabled_pairs: []                     # robot links that a MoveIt matrix disabled: checked unless trusted
    frame: base_link                       # optional: the root link that the robot must have

The other shapes (cone, ellipsoid, convex_hull, point_cloud, height_map, meshes with their numbers in the file) are in
:mod:`pinproof.collision.shape_file`. A MoveIt planning scene is recognised by its ``world``, and read by
:mod:`pinproof.collision.moveit_scene`.

Lengths are metres, angles radians; poses are in the frame of the robot's root link. A number may be written as
``[-][k*]pi[/m]``. Whatever has no meaning here is refused with its line: a scene that is read wrongly is a collision.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from pinproof.collision.moveit_scene import is_moveit, moveit_scene
from pinproof.collision.scene import Obstacle, Scene
from pinproof.collision.shape_file import SHAPE_KEYS, numbers_of, pose_of, read_shape, stated_shape
from pinproof.common.files import write_text_whole
from pinproof.common.yaml_file import MOST_REACH, YAML_SUFFIXES, LinedMapping, read_yaml, refuse_unknown, require_list
from pinproof.errors import FileError, InputError, SceneError
from pinproof.spatial import Array, finite

__all__ = ["OBSTACLE_KEYS", "pairs_of", "read_obstacle", "read_scene", "stated_obstacle", "stated_pose", "write_scene"]

SCENE_KEYS = ("obstacles", "allowed_contacts", "disabled_pairs", "frame")
OBSTACLE_KEYS = ("name", *SHAPE_KEYS, "xyz", "rpy", "quat_xyzw", "rgba")


def read_scene(path: str | Path) -> Scene:
    """Read a scene; the way in is :meth:`Scene.load`.

    Raises
    ------
    SceneError
        If the file cannot be read, is no YAML, or says something that has no meaning here; names file, line, obstacle
        and key.
    """
    path = Path(path)
    content = read_yaml(path, SCENE_KEYS, SceneError)
    return moveit_scene(path, content) if is_moveit(content) else _scene(path, content)


def write_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene, whole or not at all; the way in is :meth:`Scene.save`.

    Sizes and positions come back bit for bit, rotations (written as quaternions) to rounding.
    Meshes are named as they lie from the new file's folder where they are in it, else by their full path.

    Raises
    ------
    SceneError
        For another ending than ``.yaml`` or ``.yml``, or a place that cannot be written to.
    """
    path = Path(path)
    if path.suffix.lower() not in YAML_SUFFIXES:
        raise SceneError(path, f"unknown kind of file {path.suffix!r}; valid: {', '.join(YAML_SUFFIXES)}")
    content: dict[str, Any] = {
        "obstacles": [stated_obstacle(obstacle, path.resolve().parent) for obstacle in scene.obstacles]
    }
    if scene.frame:
        content["frame"] = scene.frame
    if scene.allowed:
        content["allowed_contacts"] = [list(pair) for pair in scene.allowed]
    if scene.disabled:
        content["disabled_pairs"] = [list(pair) for pair in scene.disabled]
    try:
        write_text_whole(path, yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None))
    except FileError as error:
        raise SceneError(path, error.reason) from error


def _scene(path: Path, content: LinedMapping) -> Scene:
    refuse_unknown(SceneError, path, "key", content, SCENE_KEYS, "")
    if "obstacles" not in content:
        raise SceneError(path, "holds no obstacles; a scene without any says 'obstacles: []'")
    obstacles: list[Obstacle] = []
    for number, stated in enumerate(require_list(SceneError, path, "obstacles", content["obstacles"]), start=1):
        if not isinstance(stated, LinedMapping):
            raise SceneError(path, f"{stated!r} is no obstacle; valid keys: {', '.join(OBSTACLE_KEYS)}", f"#{number}")
        obstacle = read_obstacle(path, number, stated)
        if any(obstacle.name == other.name for other in obstacles):
            raise SceneError(path, f"a second obstacle is named {obstacle.name!r}", f"line {stated.line}")
        obstacles.append(obstacle)
    allowed = pairs_of(path, content, "allowed_contacts", "[robot link, obstacle]")
    disabled = pairs_of(path, content, "disabled_pairs", "of robot links")
    frame = content.get("frame", "")
    if not isinstance(frame, str):
        raise SceneError(path, f"holds {frame!r}, not the name of a link", "key frame")
    try:
        return Scene(obstacles, allowed=allowed, disabled=disabled, frame=frame, notes=_far(obstacles), source=path)
    except InputError as error:
        raise SceneError(path, str(error), "key allowed_contacts or disabled_pairs") from error


def _far(obstacles: list[Obstacle]) -> list[str]:
    """A note on each obstacle that stands where no arm of a few metres has one, perhaps for want of a point."""
    far = [(thing.name, float(np.abs(thing.pose.translation).max())) for thing in obstacles]
    return [f"obstacle {name!r} stands {off:g} m off; lengths are metres" for name, off in far if off > MOST_REACH]


def pairs_of(path: Path, content: LinedMapping, key: str, what: str) -> list[tuple[str, str]]:
    """The pairs of names that are listed under a key; SceneError for anything else."""
    pairs = require_list(SceneError, path, key, content.get(key, []))
    for pair in pairs:
        if not (isinstance(pair, list) and len(pair) == 2 and all(isinstance(name, str) for name in pair)):
            raise SceneError(path, f"{pair!r} is no pair {what}", f"key {key}")
    return [(first, second) for first, second in pairs]


def read_obstacle(path: Path, number: int, stated: LinedMapping) -> Obstacle:
    """The obstacle that a mapping of a file states; ``number`` names it as long as it has no name.

    Raises
    ------
    SceneError
        If it makes no sense; names file, line, obstacle and key.
    """
    name = stated.get("name")
    if not isinstance(name, str) or not name:
        told = "has no name" if name is None else f"has the name {name!r}, which is no text (put it in quotes)"
        raise SceneError(path, f"obstacle {number} {told}", f"line {stated.line}")
    where = f"line {stated.line}, obstacle {name!r}"
    refuse_unknown(SceneError, path, "key", stated, OBSTACLE_KEYS, where)
    kinds = [key for key in SHAPE_KEYS if key in stated]
    if len(kinds) != 1:
        what = " and ".join(kinds) or "no shape"
        raise SceneError(path, f"has {what}; it needs one of {', '.join(SHAPE_KEYS)}", where)
    try:
        shape = read_shape(path, kinds[0], stated[kinds[0]], where)
        placement = pose_of({key: stated[key] for key in ("xyz", "rpy", "quat_xyzw") if key in stated})
        return Obstacle(name, shape, placement, _rgba(stated["rgba"]) if "rgba" in stated else None)
    except InputError as error:
        raise SceneError(path, str(error), where) from error


def _rgba(stated: object) -> tuple[float, float, float, float]:
    r, g, b, a = finite("rgba", numbers_of("rgba", stated), (4,)).tolist()
    if min(r, g, b, a) < 0 or max(r, g, b, a) > 1:
        raise InputError(f"rgba = {[r, g, b, a]}; its numbers are from 0 to 1")
    return r, g, b, a


def stated_obstacle(obstacle: Obstacle, folder: Path) -> dict[str, Any]:
    """An obstacle as a file states it."""
    kind, shape = stated_shape(obstacle.shape, folder)
    stated: dict[str, Any] = {"name": obstacle.name, kind: shape, **stated_pose(obstacle.pose)}
    if obstacle.rgba is not None:
        stated["rgba"] = [float(value) for value in obstacle.rgba]
    return stated


def stated_pose(placement: pin.SE3) -> dict[str, Any]:
    """The keys and values by which a file states a pose."""
    stated = {"xyz": placement.translation.tolist()}
    rotation: Array = placement.rotation
    if not np.array_equal(rotation, np.eye(3)):
        stated["quat_xyzw"] = pin.Quaternion(rotation).coeffs().tolist()
    return stated
