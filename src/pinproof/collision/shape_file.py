"""Shapes as mappings of a file.

::

    box: [1.6, 1.2, 0.04]                        # full sides x, y, z
    sphere: {radius: 0.1}
    cylinder: {radius: 0.008, length: 0.04}
    capsule: {radius: 0.02, length: 0.3}
    cone: {radius: 0.02, length: 0.05}
    ellipsoid: {rx: 0.1, ry: 0.1, rz: 0.2}       # semi-axes
    half_space: {}                               # solid below z = 0
    convex_hull: {points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}
    mesh: {path: part.stl, scale: 0.001}                                 # the path from the file's folder
    mesh: {path: part.stl, hull: true}           # its convex hull; false: its triangles, also hollow: true
    mesh: {vertices: [[0, 0, 0], ...], triangles: [[0, 1, 2], ...], hull: true}
    point_cloud: {points: [[0, 0, 0], ...], resolution: 0.01}
    height_map: {heights: [[0, 0.1], [0, 0]], x: 2, y: 2, bottom: -0.1}

What the numbers mean stands at the classes in :mod:`pinproof.collision.shapes`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.collision.shapes import (
    Box,
    Capsule,
    Cone,
    ConvexHull,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    HeightMap,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from pinproof.common.files import is_file
from pinproof.common.yaml_file import refuse_degrees, refuse_unknown
from pinproof.description.dh import parse_number
from pinproof.errors import InputError, SceneError
from pinproof.spatial import SE3, finite, pose

__all__ = ["SHAPE_KEYS", "numbers_of", "pose_of", "read_shape", "stated_shape"]

KINDS: dict[str, Any] = {
    "sphere": Sphere,
    "cylinder": Cylinder,
    "capsule": Capsule,
    "cone": Cone,
    "ellipsoid": Ellipsoid,
    "half_space": HalfSpace,
    "convex_hull": ConvexHull,
    "point_cloud": PointCloud,
    "height_map": HeightMap,
}
SHAPE_KEYS = ("box", *KINDS, "mesh")
MESH_KEYS = ("path", "scale", "hull", "hollow", "vertices", "triangles")
OPTIONAL = ("bottom",)

LARGEST_INDEX = 2**53
"""Up to it every whole number is a double."""


def read_shape(path: Path, kind: str, stated: object, where: str) -> Shape:
    """The shape that stands under one of :data:`SHAPE_KEYS`.

    Raises
    ------
    SceneError
        For a key that has no meaning; names file, place and the valid keys.
    InputError
        For sizes that make no sense.
    """
    if kind == "box":
        if not isinstance(stated, list):
            raise InputError(f"box: {stated!r} is no list of its full sides: box: [x, y, z]")
        return Box(*finite("box", numbers_of("box", stated), (3,)))
    keys = MESH_KEYS if kind == "mesh" else tuple(field.name for field in fields(KINDS[kind]))
    if not isinstance(stated, dict):
        wanted = ", ".join(f"{key}: ..." for key in keys)
        raise InputError(f"{kind}: {stated!r} is no mapping; write {kind}: {{{wanted}}}")
    refuse_unknown(SceneError, path, f"key of {kind}", stated, keys or ("none",), where)
    if kind == "mesh":
        return _mesh(path, stated)
    missing = [key for key in keys if key not in stated and key not in OPTIONAL]
    if missing:
        raise InputError(f"{kind} does not state its {' and '.join(missing)}")
    made: Shape = KINDS[kind](**{key: numbers_of(f"{kind}.{key}", value) for key, value in stated.items()})
    return made


def stated_shape(shape: Shape, folder: Path) -> tuple[str, Any]:
    """The key and value by which a file in ``folder`` states a shape."""
    if isinstance(shape, Box):
        return "box", [shape.x, shape.y, shape.z]
    if isinstance(shape, Mesh):
        how = {"hollow": shape.hollow} if shape.hull is None else {"hull": shape.hull, "hollow": shape.hollow}
        if shape.path is None:
            return "mesh", {"vertices": _listed(shape.vertices), "triangles": _listed(shape.triangles), **how}
        file = Path(shape.path).resolve()
        inside = file.relative_to(folder) if file.is_relative_to(folder) else file
        return "mesh", {"path": inside.as_posix(), "scale": _listed(shape.scale), **how}
    kind = next(kind for kind, made in KINDS.items() if type(shape) is made)
    return kind, {field.name: _listed(getattr(shape, field.name)) for field in fields(shape)}


def numbers_of(key: str, stated: object) -> Any:
    """One number, or a list of them in any depth, each as :func:`~pinproof.description.dh.parse_number` reads it.

    Raises
    ------
    InputError
        If something there is no number.
    """
    try:
        return [numbers_of(key, part) for part in stated] if isinstance(stated, list) else parse_number(stated)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{key}: {error}") from error


def pose_of(stated: Mapping[str, Any]) -> SE3:
    """The pose that ``xyz`` and ``rpy`` or ``quat_xyzw`` state.

    Raises
    ------
    InputError
        If they state none, or angles that can only be degrees.
    """
    numbers = {key: numbers_of(key, value) for key, value in stated.items()}
    placed = pose(**numbers)
    refuse_degrees("rpy", numbers.get("rpy", ()))
    return placed


def _mesh(path: Path, stated: Mapping[str, Any]) -> Mesh:
    hull = _truth("mesh.hull", stated["hull"]) if "hull" in stated else None
    hollow = _truth("mesh.hollow", stated.get("hollow", False))
    if "path" not in stated and "vertices" in stated:
        if "scale" in stated:
            raise InputError("mesh.scale: a mesh whose vertices stand in the file has none")
        triangles = finite("mesh.triangles", numbers_of("mesh.triangles", stated.get("triangles", [])), (None, 3))
        if (triangles == np.floor(triangles)).all() and np.abs(triangles).max(initial=0) < LARGEST_INDEX:
            triangles = triangles.astype(np.int64)
        vertices = finite("mesh.vertices", numbers_of("mesh.vertices", stated["vertices"]), (None, 3))
        return Mesh.from_arrays(vertices, triangles, hull=hull, hollow=hollow)
    if "path" not in stated:
        raise InputError("mesh does not state its path, nor its vertices and triangles")
    if "vertices" in stated or "triangles" in stated:
        raise InputError("mesh states a path, and vertices or triangles too; it is one or the other")
    file = stated["path"]
    if not isinstance(file, str) or not file:
        raise InputError(f"mesh.path: {file!r} is no file name")
    full = path.parent / file
    if not is_file(full):
        raise InputError(f"mesh.path: there is no file {full}; paths are relative to the scene file")
    scale = numbers_of("mesh.scale", stated.get("scale", 1.0))
    return Mesh(full, tuple(scale) if isinstance(scale, list) else scale, hull, hollow)


def _truth(key: str, stated: object) -> bool:
    if not isinstance(stated, bool):
        raise InputError(f"{key}: {stated!r} is neither true nor false")
    return stated


def _listed(value: Any) -> Any:
    return np.asarray(value).tolist()
