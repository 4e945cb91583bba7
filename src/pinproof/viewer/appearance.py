"""What links and obstacles look like: meshes with their own colours, and primitives, all as surfaces in metres."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import ConvexHull, Ellipsoid, HalfSpace, HeightMap, Mesh, Obstacle, PointCloud, Shape
from pinproof.collision.bodies import triangles_of
from pinproof.collision.height_map import ground_surface
from pinproof.collision.point_cloud import cell_faces
from pinproof.description import LinkGeometry
from pinproof.description.meshes import collada_unit, read_mesh, resolved, z_up
from pinproof.errors import InputError, MeshError
from pinproof.viewer.pictures import picture_on
from pinproof.viewer.surfaces import Rgba, Surface, merge_by_colour, shade

__all__ = ["ball", "body_surfaces", "cone", "link_surfaces", "obstacle_surfaces", "tube"]

Array = npt.NDArray[np.float64]

LINK_GREY: Rgba = (0.72, 0.74, 0.77, 1.0)
OBSTACLE_SAND: Rgba = (0.80, 0.70, 0.55, 1.0)
BODY_AMBER: Rgba = (0.95, 0.62, 0.10, 0.45)
COLOURED_SUFFIXES = (".dae", ".obj", ".ply", ".glb", ".gltf")
SIDES = 96
"""Sides of a drawn circle; so many that a ball which ends a tube of its own radius meets it in a line without teeth."""

HALF_SPACE, PLATE = 3.0, 0.002
"""Metres: a half-space, which has no end, is drawn as a plate with this side and thickness, under its plane."""

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


def body_surfaces(geometry: LinkGeometry) -> list[Surface]:
    """A ``<collision>`` element in its link's frame as checks take it unless told otherwise: of a mesh, its hull.

    Raises
    ------
    MeshError
        If a mesh is missing or unusable.
    """
    if geometry.kind != "mesh":
        made = [_primitive(geometry.kind, geometry.size, BODY_AMBER)]
    elif geometry.mesh is None:
        raise MeshError(geometry.name, f"the mesh of link {geometry.link!r} names no file")
    else:
        mesh = read_mesh(resolved(geometry.mesh, geometry.link), _three(geometry.size))
        try:
            made = [shade(*_triangles(ConvexHull(mesh.vertices)), BODY_AMBER)]
        except InputError:  # a flat mesh has no hull
            made = [shade(mesh.vertices, mesh.triangles, BODY_AMBER)]
    return [surface.moved(geometry.origin) for surface in made]


def obstacle_surfaces(obstacle: Obstacle) -> list[Surface]:
    """An obstacle in its own frame.

    Raises
    ------
    MeshError
        If its mesh is missing or unusable.
    """
    shape, rgba = obstacle.shape, obstacle.rgba
    if isinstance(shape, Mesh) and shape.path is not None:
        return _mesh(Path(shape.path), _three(shape.scale), rgba, OBSTACLE_SAND, own_colours=rgba is None)
    vertices, triangles = _triangles(shape)
    return [shade(vertices, triangles, rgba or OBSTACLE_SAND)]


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


def cone(tip: Array, direction: Array, radius: float, height: float, rgba: Rgba) -> Surface:
    """A cone that ends at ``tip`` (3,) and points along the unit vector ``direction`` (3,)."""
    side = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    side /= np.linalg.norm(side)
    a_from_cone = np.eye(4)
    a_from_cone[:3, :3] = np.column_stack([side, np.cross(direction, side), direction])
    a_from_cone[:3, 3] = tip - 0.5 * height * direction
    return _primitive("cone", (radius, height), rgba).moved(a_from_cone)


def _triangles(shape: Shape) -> tuple[Array, npt.NDArray[np.int64]]:
    """What is drawn of a shape: vertices (V, 3) and triangles (F, 3)."""
    if isinstance(shape, Mesh):
        mesh = triangles_of(shape)
        return mesh.vertices, mesh.triangles
    if isinstance(shape, HeightMap):
        return ground_surface(shape)
    if isinstance(shape, PointCloud):
        return cell_faces(shape)
    if isinstance(shape, ConvexHull):
        from scipy.spatial import ConvexHull as Hull

        hull = Hull(shape.points)
        inward = np.einsum("ij,ij->i", _cross(shape.points[hull.simplices]), hull.equations[:, :3]) < 0
        return shape.points, np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices).astype(np.int64)
    if isinstance(shape, HalfSpace):
        vertices, triangles = _made("box", (HALF_SPACE, HALF_SPACE, PLATE))
        return vertices - [0.0, 0.0, PLATE / 2], triangles
    if isinstance(shape, Ellipsoid):
        vertices, triangles = _made("sphere", (1.0,))
        return vertices * [shape.rx, shape.ry, shape.rz], triangles
    return _made(type(shape).__name__.lower(), tuple(getattr(shape, field.name) for field in fields(shape)))


def _cross(corners: Array) -> Array:
    return np.asarray(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def _primitive(kind: str, size: tuple[float, ...], rgba: Rgba) -> Surface:
    return shade(*_made(kind, size), rgba)


def _made(kind: str, size: tuple[float, ...]) -> tuple[Array, npt.NDArray[np.int64]]:
    """Vertices and triangles of a box, sphere, cylinder, cone or capsule about the origin."""
    from trimesh import creation

    made: Any
    if kind == "box":
        made = creation.box(extents=size)
    elif kind == "sphere":
        made = creation.icosphere(subdivisions=4, radius=size[0])
    elif kind == "cylinder":
        made = creation.cylinder(radius=size[0], height=size[1], sections=SIDES)
    elif kind == "cone":
        made = creation.cone(radius=size[0], height=size[1], sections=SIDES)
    else:
        made = creation.capsule(radius=size[0], height=size[1], count=(SIDES // 2, SIDES // 4))
    vertices = np.array(made.vertices, dtype=float)
    # cones begin at their disc; capsules have had their origin at an end and at the middle in different releases
    vertices -= (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return vertices, np.array(made.faces, dtype=np.int64)


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
        uv, image = picture_on(part)
        surfaces.append(shade(vertices, np.array(part.faces, dtype=np.int64)[:, ::turn], colour, uv, image))
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
