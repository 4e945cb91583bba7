"""What links and obstacles look like: meshes with their own colours, and primitives, all as surfaces in metres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import Box, Capsule, Cylinder, Mesh, Obstacle, Sphere
from pinproof.description import LinkGeometry
from pinproof.description.meshes import collada_unit, read_mesh, resolved, z_up
from pinproof.errors import MeshError
from pinproof.viewer.surfaces import Rgba, Surface, merge_by_colour, shade

__all__ = ["ball", "link_surfaces", "obstacle_surfaces", "tube"]

Array = npt.NDArray[np.float64]

LINK_GREY: Rgba = (0.72, 0.74, 0.77, 1.0)
OBSTACLE_SAND: Rgba = (0.80, 0.70, 0.55, 1.0)
COLOURED_SUFFIXES = (".dae", ".obj", ".ply", ".glb", ".gltf")
SIDES = 48
"""Sides of a drawn circle."""

TUBE_SIDES = 10
"""Sides of a drawn line, which is thin."""


def link_surfaces(geometry: LinkGeometry) -> list[Surface]:
    """A ``<visual>`` or ``<collision>`` element in its link's frame, one surface a colour.

    A mesh's own colours come first, then the URDF's material, then grey.

    Raises
    ------
    MeshError
        If a mesh is missing or unusable.
    """
    if geometry.kind == "mesh":
        if geometry.mesh is None:
            raise MeshError(geometry.name, f"the mesh of link {geometry.link!r} names no file")
        path = resolved(geometry.mesh, geometry.link)
        surfaces = _mesh(path, _three(geometry.size), geometry.rgba, LINK_GREY)
    else:
        surfaces = [_primitive(geometry.kind, geometry.size, geometry.rgba or LINK_GREY)]
    return [surface.moved(geometry.origin) for surface in surfaces]


def obstacle_surfaces(obstacle: Obstacle) -> list[Surface]:
    """An obstacle in its own frame.

    Raises
    ------
    MeshError
        If its mesh is missing or unusable.
    """
    shape, rgba = obstacle.shape, obstacle.rgba
    if isinstance(shape, Mesh):
        return _mesh(Path(shape.path), _three(shape.scale), rgba, OBSTACLE_SAND, own_colours=rgba is None)
    return [_primitive(*_kind_and_size(shape), rgba or OBSTACLE_SAND)]


def tube(points: Array, radius: float, rgba: Rgba) -> Surface | None:
    """A round line through ``points`` (N, 3), None if they are all one point; WebGL draws plain lines a pixel wide."""
    keep = [0]
    for i in range(1, len(points)):
        if np.linalg.norm(points[i] - points[keep[-1]]) > radius:
            keep.append(i)
    corners = points[keep]
    if len(corners) < 2:
        return None
    steps = np.diff(corners, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    tangents = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    # each ring takes over its neighbour's side direction, made perpendicular again: the tube does not twist
    side = np.eye(3)[np.abs(steps[0]).argmin()]
    angles = np.linspace(0, 2 * np.pi, TUBE_SIDES, endpoint=False)[:, None]
    rings, outwards = [], []
    for corner, tangent, before in zip(corners, tangents, np.concatenate([steps[:1], steps]), strict=True):
        along = tangent if np.linalg.norm(tangent) > 1e-6 else before  # a path that turns back on itself
        along = along / np.linalg.norm(along)
        flat = side - (side @ along) * along
        side = flat / np.linalg.norm(flat) if np.linalg.norm(flat) > 1e-6 else np.eye(3)[np.abs(along).argmin()]
        outward = np.cos(angles) * side + np.sin(angles) * np.cross(along, side)
        outwards.append(outward)
        rings.append(corner + radius * outward)
    ring = np.arange(TUBE_SIDES)
    quad = np.column_stack([ring, np.roll(ring, -1), ring + TUBE_SIDES, np.roll(ring, -1) + TUBE_SIDES])
    quads = (quad + TUBE_SIDES * np.arange(len(corners) - 1)[:, None, None]).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [2, 1, 3]]])
    return Surface(np.concatenate(rings), np.concatenate(outwards), triangles, rgba)


def ball(centre: Array, radius: float, rgba: Rgba) -> Surface:
    """A sphere about ``centre`` (3,)."""
    surface = _primitive("sphere", (radius,), rgba)
    return Surface(surface.vertices + centre, surface.normals, surface.triangles, rgba)


def _kind_and_size(shape: Box | Sphere | Cylinder | Capsule) -> tuple[str, tuple[float, ...]]:
    if isinstance(shape, Box):
        return "box", (shape.x, shape.y, shape.z)
    if isinstance(shape, Sphere):
        return "sphere", (shape.radius,)
    return ("cylinder" if isinstance(shape, Cylinder) else "capsule"), (shape.radius, shape.length)


def _primitive(kind: str, size: tuple[float, ...], rgba: Rgba) -> Surface:
    from trimesh import creation

    made: Any
    if kind == "box":
        made = creation.box(extents=size)
    elif kind == "sphere":
        made = creation.icosphere(subdivisions=3, radius=size[0])
    elif kind == "cylinder":
        made = creation.cylinder(radius=size[0], height=size[1], sections=SIDES)
    else:
        made = creation.capsule(radius=size[0], height=size[1], count=(SIDES, SIDES // 2))
    vertices = np.array(made.vertices, dtype=float)
    # capsules have had their origin at an end and at the middle in different trimesh releases
    vertices -= (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return shade(vertices, np.array(made.faces, dtype=np.int64), rgba)


def _mesh(
    path: Path, scale: tuple[float, float, float], told: Rgba | None, default: Rgba, own_colours: bool = True
) -> list[Surface]:
    checked = read_mesh(path, scale)
    if not own_colours or path.suffix.lower() not in COLOURED_SUFFIXES:
        return [shade(checked.vertices, checked.triangles, told or default)]
    import trimesh

    scene = trimesh.load(path, force="scene", process=False)
    factor = np.asarray(scale) * collada_unit(path)
    turn = -1 if np.prod(scale) < 0 else 1
    surfaces = []
    for node in scene.graph.nodes_geometry:
        scene_from_node, name = scene.graph[node]
        part = scene.geometry[name]
        if not isinstance(part, trimesh.Trimesh) or len(part.faces) == 0:
            continue
        vertices = np.asarray(part.vertices) @ scene_from_node[:3, :3].T + scene_from_node[:3, 3]
        vertices = vertices @ z_up(path).T * factor
        colour = _own_colour(part, linear=path.suffix.lower() == ".dae") or told or default
        surfaces.append(shade(vertices, np.array(part.faces, dtype=np.int64)[:, ::turn], colour))
    return merge_by_colour(surfaces)


def _own_colour(part: Any, *, linear: bool) -> Rgba | None:
    """The colour that a mesh file gives a part, None if it gives none.

    Robot meshes in COLLADA come out of Blender, which writes linear light; shown as they are, they look black.
    """
    visual = part.visual
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    raw = getattr(visual, "main_color", None) if material is None else material.main_color
    if raw is None:
        return None
    r, g, b, a = (float(v) / 255.0 for v in raw)
    if linear:
        r, g, b = (12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055 for c in (r, g, b))
    return (r, g, b, a if a > 0 else 1.0)


def _three(values: Any) -> tuple[float, float, float]:
    x, y, z = values
    return (float(x), float(y), float(z))
