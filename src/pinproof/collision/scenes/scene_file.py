"""Scene files and shapes in YAML.

The keys are in :mod:`pinproof.collision.scenes.scene_keys`, and docs/formats/scene.md describes them with an example. A
MoveIt planning scene is recognised by its key ``world`` and read by :mod:`pinproof.collision.scenes.moveit`.

Unknown keys and invalid values are refused with their line, because a scene that is read wrongly can cause a collision.
"""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinproof.collision.geometry.depth_image import DepthView, Intrinsics
from pinproof.collision.geometry.occupancy import MOST_CELLS, OccupancyGrid
from pinproof.collision.geometry.shapes import SHAPES_BY_KEY, Box, Mesh, Obstacle, Shape
from pinproof.collision.scenes.scene_keys import ATTACHED, INTRINSICS, OBSTACLE, POSE, SCENE, SHAPES, VIEW
from pinproof.common.files import is_file
from pinproof.common.yaml_file import (
    LinedMapping,
    parse_number,
    read_yaml,
    refuse_unknown,
    require_list,
    write_yaml,
)
from pinproof.errors import InputError, SceneError, UnknownNameError
from pinproof.spatial import SE3, Array, finite, pose
from pinproof.units import MOST_REACH, refuse_degrees

GRID_SOURCES = ("cells", "views", "octomap")
"""The keys of which an occupancy grid has exactly one."""

LARGEST_INDEX = 2**53
"""Up to this number every integer is a double."""


def read_shape(path: Path, kind: str, stated: object, where: str) -> Shape:
    """Return the shape under one of the keys :data:`~pinproof.collision.scenes.scene_keys.SHAPES`.

    SceneError for an unknown key, with file, place and the valid keys; InputError for invalid sizes.
    """
    if kind == "box":
        if not isinstance(stated, list):
            raise InputError(f"box: {stated!r} is not a list of its full sides; write box: [x, y, z]")
        return Box(*finite("box", numbers_of("box", stated), (3,)))
    table = SHAPES[kind].value
    if not isinstance(stated, dict):
        wanted = ", ".join(f"{key}: ..." for key in table.names)
        raise InputError(f"{kind}: {stated!r} is not a mapping; write {kind}: {{{wanted}}}")
    refuse_unknown(SceneError, path, f"key of {kind}", stated, table.names or ("none",), where)
    if kind == "mesh":
        return _mesh(path, stated)
    if kind == "occupancy_grid":
        return _grid(path, stated, where)
    missing = [key for key in table.required if key not in stated]
    if missing:
        raise InputError(f"{kind} does not state its {' and '.join(missing)}")
    return SHAPES_BY_KEY[kind](**{key: numbers_of(f"{kind}.{key}", value) for key, value in stated.items()})


def stated_shape(shape: Shape, folder: Path) -> tuple[str, Any]:
    """Return the key and value of a shape for a file in ``folder``; an unknown shape is refused."""
    if isinstance(shape, Box):
        return "box", [shape.x, shape.y, shape.z]
    if isinstance(shape, Mesh):
        how = {"hollow": shape.hollow} if shape.hull is None else {"hull": shape.hull, "hollow": shape.hollow}
        if shape.path is None:
            return "mesh", {"vertices": _listed(shape.vertices), "triangles": _listed(shape.triangles), **how}
        file = Path(shape.path).resolve()
        inside = file.relative_to(folder) if file.is_relative_to(folder) else file
        return "mesh", {"path": inside.as_posix(), "scale": _listed(shape.scale), **how}
    if isinstance(shape, OccupancyGrid):
        return "occupancy_grid", _stated_grid(shape)
    kind = next((kind for kind, made in SHAPES_BY_KEY.items() if type(shape) is made), None)
    if kind is None:
        raise InputError(f"a {type(shape).__name__} has no key in files; valid: {', '.join(SHAPES)}")
    return kind, {field.name: _listed(getattr(shape, field.name)) for field in fields(shape)}


def numbers_of(key: str, stated: object) -> Any:
    """Return one number, or nested lists of numbers, each as :func:`~pinproof.common.yaml_file.parse_number` reads it.

    InputError if a value is not a number.
    """
    try:
        return [numbers_of(key, part) for part in stated] if isinstance(stated, list) else parse_number(stated)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{key}: {error}") from error


def pose_of(stated: Mapping[str, Any]) -> SE3:
    """Return the pose given by ``xyz`` and ``rpy`` or ``quat_xyzw``; InputError if invalid, or clearly in degrees."""
    numbers = {key: numbers_of(key, value) for key, value in stated.items()}
    if "rpy" in numbers:
        refuse_degrees("rpy", finite("rpy", numbers["rpy"], (3,)).tolist())
    return pose(**numbers)


def _mesh(path: Path, stated: Mapping[str, Any]) -> Mesh:
    hull = _truth("mesh.hull", stated["hull"]) if "hull" in stated else None
    hollow = _truth("mesh.hollow", stated.get("hollow", False))
    if "path" not in stated and "vertices" in stated:
        if "scale" in stated:
            raise InputError("mesh.scale: a mesh with vertices in the file has no scale")
        triangles = finite("mesh.triangles", numbers_of("mesh.triangles", stated.get("triangles", [])), (None, 3))
        if (triangles == np.floor(triangles)).all() and np.abs(triangles).max(initial=0) < LARGEST_INDEX:
            triangles = triangles.astype(np.int64)
        vertices = finite("mesh.vertices", numbers_of("mesh.vertices", stated["vertices"]), (None, 3))
        return Mesh.from_arrays(vertices, triangles, hull=hull, hollow=hollow)
    if "path" not in stated:
        raise InputError("mesh does not state its path, nor its vertices and triangles")
    if "vertices" in stated or "triangles" in stated:
        raise InputError("mesh has a path, and vertices or triangles; only one or the other is possible")
    file = _existing(path, "mesh.path", stated["path"])
    scale = numbers_of("mesh.scale", stated.get("scale", 1.0))
    return Mesh(file, tuple(scale) if isinstance(scale, list) else scale, hull, hollow)


def _stated_grid(grid: OccupancyGrid) -> dict[str, Any]:
    """Return a grid as a mapping for a file; it has about one byte for every twenty cells."""
    packed = base64.b64encode(zlib.compress(grid.cells.tobytes(), 9)).decode("ascii")
    return {
        "voxel": grid.voxel,
        "unknown": grid.unknown,
        "low": list(grid.low),
        "count": list(grid.cells.shape),
        "cells": packed,
        "record": list(grid.record),
    }


def _grid(path: Path, stated: Mapping[str, Any], where: str) -> OccupancyGrid:
    """Return the grid of a mapping: the states of its cells, the depth images of which it is made, or a map."""
    source = [key for key in GRID_SOURCES if key in stated]
    if len(source) != 1:
        raise InputError(
            f"occupancy_grid has {' and '.join(source) or 'no source of its cells'}; it needs one of "
            f"{', '.join(GRID_SOURCES)}"
        )
    required = {"cells": ("voxel", "low", "count"), "views": ("voxel", "bounds"), "octomap": ()}[source[0]]
    optional = {"cells": ("record",), "views": (), "octomap": ("bounds", "threshold")}[source[0]]
    valid = (source[0], "unknown", *required, *optional)
    refuse_unknown(SceneError, path, f"key of occupancy_grid with {source[0]}", stated, valid, where)
    missing = [key for key in required if key not in stated]
    if missing:
        raise InputError(f"occupancy_grid does not state its {' and '.join(missing)}")

    def number(key: str, shape: tuple[int, ...] = ()) -> np.ndarray:
        return finite(f"occupancy_grid.{key}", numbers_of(f"occupancy_grid.{key}", stated[key]), shape)

    unknown = stated.get("unknown", "occupied")
    if "octomap" in stated:
        threshold = {"threshold": float(number("threshold"))} if "threshold" in stated else {}
        box = number("bounds", (2, 3)) if "bounds" in stated else None
        file = _existing(path, "occupancy_grid.octomap", stated["octomap"])
        return OccupancyGrid.from_octomap(file, unknown=unknown, bounds=box, **threshold)
    voxel = float(number("voxel"))
    if "cells" in stated:
        low, count = (number(key, (3,)) for key in ("low", "count"))
        record = stated.get("record", [])
        if not isinstance(record, list) or not all(isinstance(line, str) for line in record):
            raise InputError("occupancy_grid.record: must be a list of texts")
        return OccupancyGrid(
            _cells(stated["cells"], count.tolist()), voxel, tuple(low.tolist()), unknown, tuple(record)
        )
    views = stated["views"]
    if not isinstance(views, list) or not views:
        raise InputError(f"occupancy_grid.views: {views!r} is not a list of views")
    bounds = number("bounds", (2, 3))
    grids = []
    for view in views:
        if not isinstance(view, dict):
            raise InputError(f"occupancy_grid.views: {view!r} is not a view; valid keys: {', '.join(VIEW.names)}")
        refuse_unknown(SceneError, path, "key of a view", view, VIEW.names, where)
        seen, margin = _view(path, view, where)
        grids.append(OccupancyGrid.from_view(seen, voxel=voxel, bounds=bounds, unknown=unknown, **margin))
    return grids[0].fuse(*grids[1:])


def _existing(path: Path, key: str, stated: object) -> Path:
    """Return the file that a key of the scene file ``path`` names."""
    if not isinstance(stated, str) or not stated:
        raise InputError(f"{key}: {stated!r} is not a file name")
    file = path.parent / stated
    if not is_file(file):
        raise InputError(f"{key}: there is no file {stated!r} in {path.parent}; paths are relative to the scene file")
    return file


def _cells(stated: object, count: list[float]) -> np.ndarray:
    """Return the states of cells (nx, ny, nz) of their text."""
    shape = tuple(int(side) for side in count)
    size = math.prod(shape)
    if list(shape) != count or min(shape) < 1 or size > MOST_CELLS:
        raise InputError(f"occupancy_grid.count: {count} must be three integers, with at most {MOST_CELLS} cells")
    try:
        unpacked = zlib.decompressobj()
        data = unpacked.decompress(base64.b64decode(str(stated), validate=True), size + 1)
    except (binascii.Error, ValueError, zlib.error) as error:
        raise InputError(f"occupancy_grid.cells: cannot be decoded ({error}); Scene.save writes it") from error
    if len(data) != size:
        raise InputError(f"occupancy_grid.cells: does not hold the states of {size} cells")
    return np.frombuffer(data, dtype=np.uint8).reshape(shape)


def _view(path: Path, stated: Mapping[str, Any], where: str) -> tuple[DepthView, dict[str, int]]:
    """Return a depth image or point cloud as seen by its camera, and the ``pixel_margin`` if it is stated."""
    missing = [key for key in VIEW.required if key not in stated]
    if missing:
        raise InputError(f"a view of occupancy_grid does not state its {' and '.join(missing)}")
    source = [key for key in ("image", "points") if key in stated]
    if len(source) != 1 or ("points" in stated and "depth_scale" in stated):
        raise InputError("a view of occupancy_grid needs one of image and points; points have no depth_scale")
    file = _existing(path, f"view.{source[0]}", stated[source[0]])
    for key, table in (("intrinsics", INTRINSICS), ("camera", POSE)):
        if not isinstance(stated[key], dict):
            raise InputError(f"view.{key}: {stated[key]!r} is not a mapping of {', '.join(table.names)}")
        refuse_unknown(SceneError, path, f"key of {key}", stated[key], table.names, where)
    lens = {key: numbers_of(f"intrinsics.{key}", value) for key, value in stated["intrinsics"].items()}
    settings = {
        key: float(finite(f"view.{key}", numbers_of(f"view.{key}", stated[key]), ()))
        for key in ("depth_scale", "depth_uncertainty")
        if key in stated
    }
    for key in ("width", "height"):
        if isinstance(lens.get(key), float) and lens[key].is_integer():
            lens[key] = int(lens[key])
    read = DepthView.read if source == ["image"] else DepthView.from_points
    seen = read(file, Intrinsics(**lens), pose_of(stated["camera"]), **settings)
    return seen, {key: stated[key] for key in ("pixel_margin",) if key in stated}


def _truth(key: str, stated: object) -> bool:
    if not isinstance(stated, bool):
        raise InputError(f"{key}: {stated!r} must be true or false")
    return stated


def _listed(value: Any) -> Any:
    return np.asarray(value).tolist()


class SceneContent(NamedTuple):
    """The content of a scene file, from which :meth:`pinproof.Scene.load` makes a scene."""

    obstacles: Sequence[Obstacle]
    allowed: Sequence[tuple[str, str]] = ()
    disabled: Sequence[tuple[str, str]] = ()
    frame: str = ""
    notes: Sequence[str] = ()


def write_scene(scene: SceneContent, path: str | Path) -> None:
    """Write a scene file atomically; called by :meth:`pinproof.Scene.save`.

    Sizes and positions are restored exactly, rotations (written as quaternions) to rounding. Mesh paths are relative to
    the folder of the file if the mesh is inside it, otherwise absolute.
    """
    folder = Path(path).resolve().parent
    content: dict[str, Any] = {"obstacles": [stated_obstacle(obstacle, folder) for obstacle in scene.obstacles]}
    if scene.frame:
        content["frame"] = scene.frame
    if scene.allowed:
        content["allowed_contacts"] = [list(pair) for pair in scene.allowed]
    if scene.disabled:
        content["disabled_pairs"] = [list(pair) for pair in scene.disabled]
    write_yaml(path, content, SceneError)


def read_scene(path: Path, content: LinedMapping) -> SceneContent:
    """Read the parsed YAML of a scene file in pinproof's own format; called by :meth:`pinproof.Scene.load`.

    SceneError if the content is invalid; the message names file, line, obstacle and key.
    """
    refuse_unknown(SceneError, path, "key", content, SCENE.names, "")
    if "obstacles" not in content:
        raise SceneError(path, "has no obstacles; write 'obstacles: []' for an empty scene")
    obstacles = _read_bodies(path, content, "obstacles", "obstacle")
    allowed = pairs_of(path, content, "allowed_contacts", "[robot link, obstacle]")
    disabled = pairs_of(path, content, "disabled_pairs", "of robot links")
    frame = content.get("frame", "")
    if not isinstance(frame, str):
        raise SceneError(path, f"holds {frame!r}, not the name of a link", "key frame")
    return SceneContent(obstacles, allowed, disabled, frame, _far(obstacles))


def _read_bodies(path: Path, content: LinedMapping, key: str, what: str) -> list[Obstacle]:
    """Return the obstacles or attached bodies (``what``) under a key of a file."""
    bodies: list[Obstacle] = []
    for number, stated in enumerate(require_list(SceneError, path, key, content[key]), start=1):
        if not isinstance(stated, LinedMapping):
            valid = ", ".join(OBSTACLE.names)
            raise SceneError(path, f"{stated!r} is not an {what}; valid keys: {valid}", f"key {key}, #{number}")
        bodies.append(read_obstacle(path, number, stated))
        if any(bodies[-1].name == other.name for other in bodies[:-1]):
            raise SceneError(path, f"a second {what} is named {bodies[-1].name!r}", f"line {stated.line}")
    return bodies


def _far(obstacles: list[Obstacle]) -> list[str]:
    """Return a note on each obstacle that is implausibly far away, such as for a missing decimal point."""
    far = [(thing.name, float(np.abs(thing.pose.translation).max())) for thing in obstacles]
    return [f"obstacle {name!r} is {off:g} m away; lengths are in metres" for name, off in far if off > MOST_REACH]


def pairs_of(path: Path, content: LinedMapping, key: str, what: str) -> list[tuple[str, str]]:
    """Return the pairs of names under a key; raises SceneError for anything else."""
    pairs = require_list(SceneError, path, key, content.get(key, []))
    for pair in pairs:
        if not (isinstance(pair, list) and len(pair) == 2 and all(isinstance(name, str) for name in pair)):
            raise SceneError(path, f"{pair!r} is not a pair {what}", f"key {key}")
    return [(first, second) for first, second in pairs]


def read_obstacle(path: Path, number: int, stated: LinedMapping) -> Obstacle:
    """Return the obstacle of a mapping in a file; ``number`` identifies it in messages if it has no name.

    SceneError if it is invalid; the message names file, line, obstacle and key.
    """
    name = stated.get("name")
    if not isinstance(name, str) or not name:
        problem = "has no name" if name is None else f"has the name {name!r}, which is not a text (put it in quotes)"
        raise SceneError(path, f"obstacle {number} {problem}", f"line {stated.line}")
    where = f"line {stated.line}, obstacle {name!r}"
    refuse_unknown(SceneError, path, "key", stated, OBSTACLE.names, where)
    kinds = [key for key in SHAPES if key in stated]
    if len(kinds) != 1:
        what = " and ".join(kinds) or "no shape"
        raise SceneError(path, f"has {what}; it needs one of {', '.join(SHAPES)}", where)
    try:
        shape = read_shape(path, kinds[0], stated[kinds[0]], where)
        placement = pose_of({key: stated[key] for key in POSE.names if key in stated})
        return Obstacle(name, shape, placement, _rgba(stated["rgba"]) if "rgba" in stated else None)
    except InputError as error:
        raise SceneError(path, str(error), where) from error


def _rgba(stated: object) -> tuple[float, float, float, float]:
    r, g, b, a = finite("rgba", numbers_of("rgba", stated), (4,)).tolist()
    if min(r, g, b, a) < 0 or max(r, g, b, a) > 1:
        raise InputError(f"rgba = {[r, g, b, a]}; its values must be from 0 to 1")
    return r, g, b, a


def stated_obstacle(obstacle: Obstacle, folder: Path) -> dict[str, Any]:
    """Return an obstacle as a mapping for a file."""
    kind, shape = stated_shape(obstacle.shape, folder)
    stated: dict[str, Any] = {"name": obstacle.name, kind: shape, **stated_pose(obstacle.pose)}
    if obstacle.rgba is not None:
        stated["rgba"] = [float(value) for value in obstacle.rgba]
    return stated


def stated_pose(placement: pin.SE3) -> dict[str, Any]:
    """Return the keys and values of a pose for a file."""
    stated = {"xyz": placement.translation.tolist()}
    rotation: Array = placement.rotation
    if not np.array_equal(rotation, np.eye(3)):
        stated["quat_xyzw"] = pin.Quaternion(rotation).coeffs().tolist()
    return stated


def read_attached(path: Path) -> dict[str, Any]:
    """Return the fields of :class:`pinproof.collision.Attachments` that a file states; called by its ``load``.

    SceneError if the content is invalid; the message names file, line and key.
    """
    content = read_yaml(path, ATTACHED.names, SceneError)
    refuse_unknown(SceneError, path, "key", content, ATTACHED.names, "")
    if "attached" not in content:
        raise SceneError(path, "has no attached bodies; list them under 'attached:'")
    bodies = _read_bodies(path, content, "attached", "attached body")
    values = {}
    for key, read in (("held", _held), ("tip", _tip)):
        stated = content.get(key, {})
        try:
            values[key] = read(stated)
        except InputError as error:
            line = f"line {stated.line}, " if isinstance(stated, LinedMapping) else ""
            raise SceneError(path, str(error), f"{line}key {key}") from error
    return {"bodies": bodies, "allowed": pairs_of(path, content, "allowed_contacts", "of names"), **values}


def _held(stated: object) -> dict[str, float]:
    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping of joint names to values")
    return {str(name): float(finite(str(name), [numbers_of(str(name), v)], (1,))[0]) for name, v in stated.items()}


def _tip(stated: object) -> SE3:
    if not isinstance(stated, dict):
        raise InputError(f"holds {stated!r}, not a mapping with the keys {', '.join(POSE.names)}")
    for key in stated:
        if key not in POSE.names:
            raise UnknownNameError("key", key, POSE.names)
    return pose_of(stated)


def write_attached(
    path: str | Path,
    bodies: Sequence[Obstacle],
    allowed: Sequence[tuple[str, str]],
    held: Mapping[str, float],
    tip: pin.SE3,
) -> None:
    """Write a file of attached bodies atomically; called by :meth:`pinproof.collision.Attachments.save`."""
    folder = Path(path).resolve().parent
    content: dict[str, Any] = {"attached": [stated_obstacle(body, folder) for body in bodies]}
    if allowed:
        content["allowed_contacts"] = [list(pair) for pair in allowed]
    if held:
        content["held"] = {name: float(value) for name, value in held.items()}
    if not tip.isIdentity():
        content["tip"] = stated_pose(tip)
    write_yaml(path, content, SceneError)
