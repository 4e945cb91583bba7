"""Surfaces as a renderer wants them: welded triangles with normals that are smooth over curves and sharp at edges.

Pictures on meshes, as a page can hold them.

What links and obstacles look like: meshes with their own colours, and primitives, all as surfaces in metres.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.collision import ConvexHull, Ellipsoid, HalfSpace, HeightMap, Mesh, Obstacle, PointCloud, Shape
from pinproof.collision.bodies import triangles_of
from pinproof.collision.surfaces import cell_faces, ground_surface
from pinproof.description import LinkGeometry
from pinproof.description.meshes import collada_unit, read_mesh, resolved, z_up
from pinproof.errors import InputError, MeshError

__all__ = [
    "Rgba",
    "Surface",
    "ball",
    "body_surfaces",
    "cone",
    "link_surfaces",
    "merge_by_colour",
    "obstacle_surfaces",
    "picture_on",
    "shade",
    "tube",
]

Array = npt.NDArray[np.float64]
Rgba = tuple[float, float, float, float]

CREASE = np.deg2rad(38.0)
"""Neighbouring faces that meet at a larger angle (rad) keep a sharp edge: a 16-sided cylinder's sides bend by 22
degrees, the smallest chamfers of machined parts by 45."""

WELD_GRID = 1e-5
"""Metres. Vertices that fall on the same point of this grid are one; a hundredth of a millimetre is never seen."""


UV_GRID = 1 / 8192
"""Of a picture's side: less than a pixel of any that is shown."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one colour.

    Parameters
    ----------
    vertices
        (V, 3) in metres.
    normals
        (V, 3) of unit length, outwards where the triangles turn counter-clockwise seen from outside.
    triangles
        (F, 3) indices of vertices.
    rgba
        0 to 1; of a surface with a picture on it, what the picture's colours are multiplied by.
    uv
        (V, 2) where on the picture each vertex lies, from 0 to 1, from its lower left corner.
    image
        The picture, as a ``data:`` address.
    """

    vertices: Array
    normals: Array
    triangles: npt.NDArray[np.int64]
    rgba: Rgba
    uv: Array | None = None
    image: str | None = None

    def moved(self, a_from_b: Array) -> Surface:
        """The same surface after a rigid transform (4, 4)."""
        rotation, shift = a_from_b[:3, :3], a_from_b[:3, 3]
        return replace(self, vertices=self.vertices @ rotation.T + shift, normals=self.normals @ rotation.T)


def shade(
    vertices: Array, triangles: npt.NDArray[np.int64], rgba: Rgba, uv: Array | None = None, image: str | None = None
) -> Surface:
    """Weld vertices and give each a normal, split where the surface has a crease.

    The corners of the triangles are the nodes of a graph. Two faces that share an edge and meet at less than
    :data:`CREASE` have their corners joined at both ends of it. Each connected set of corners becomes one vertex; its
    normal is the mean of its faces' normals, weighted by area. With a picture (``uv`` (V, 2) and ``image``) it is
    split further, where the picture has a seam.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    grid = np.rint(vertices / WELD_GRID).astype(np.int64)
    _, first, welded = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    points, faces = vertices[first], welded.reshape(-1)[triangles]
    # cross products have twice the area as length, so sums of them are weighted by area
    cross = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    area = np.linalg.norm(cross, axis=1)
    solid = area > 1e-14  # slivers have no direction
    faces, cross, area = faces[solid], cross[solid], area[solid]
    unit = cross / area[:, None]

    # every face has three edges; corner k is the edge's start, corner (k + 1) % 3 its end
    count = len(faces)
    corner = np.arange(3 * count).reshape(count, 3)
    starts, ends = faces, np.roll(faces, -1, axis=1)
    flipped = (starts > ends).ravel()
    low_corner = np.where(flipped, np.roll(corner, -1, axis=1).ravel(), corner.ravel())
    high_corner = np.where(flipped, corner.ravel(), np.roll(corner, -1, axis=1).ravel())
    edge = np.minimum(starts, ends).ravel() * np.int64(len(points)) + np.maximum(starts, ends).ravel()
    order = np.argsort(edge, kind="stable")
    here, there = order[:-1], order[1:]
    shared = edge[here] == edge[there]
    here, there = here[shared], there[shared]
    soft = np.einsum("ij,ij->i", unit[here // 3], unit[there // 3]) > np.cos(CREASE)
    here, there = here[soft], there[soft]
    rows = np.concatenate([low_corner[here], high_corner[here]])
    columns = np.concatenate([low_corner[there], high_corner[there]])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(3 * count, 3 * count))
    total, label = connected_components(graph, directed=False)

    normals = np.zeros((total, 3))
    np.add.at(normals, label, np.repeat(cross, 3, axis=0))
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, size, out=np.zeros_like(normals), where=size > 0)
    positions = np.zeros((total, 3))
    positions[label] = points[faces.ravel()]
    if uv is None or image is None:
        return Surface(positions, normals, label.reshape(count, 3).astype(np.int64), rgba)
    spots = np.column_stack([label, np.rint(uv[triangles[solid]].reshape(-1, 2) / UV_GRID).astype(np.int64)])
    spots, vertex = np.unique(spots, axis=0, return_inverse=True)
    kind = spots[:, 0]
    corners = vertex.reshape(count, 3).astype(np.int64)
    return Surface(positions[kind], normals[kind], corners, rgba, spots[:, 1:] * UV_GRID, image)


def merge_by_colour(surfaces: Sequence[Surface]) -> list[Surface]:
    """One surface for each colour or picture, in the order of their first appearance: fewer objects draw faster."""
    groups: dict[tuple[Rgba, str | None], list[Surface]] = {}
    for surface in surfaces:
        groups.setdefault((surface.rgba, surface.image), []).append(surface)
    merged = []
    for (rgba, image), group in groups.items():
        offsets = np.cumsum([0, *(len(s.vertices) for s in group[:-1])])
        triangles = np.concatenate([s.triangles + o for s, o in zip(group, offsets, strict=True)])
        vertices, normals = np.concatenate([s.vertices for s in group]), np.concatenate([s.normals for s in group])
        uv = None if image is None else np.concatenate([s.uv for s in group if s.uv is not None])
        merged.append(Surface(vertices, normals, triangles, rgba, uv, image))
    return merged


LARGEST = 1024
"""Pixels of a side; larger pictures are made smaller, as nobody looks at a robot from that near."""

QUALITY = 88
"""Of JPEG."""


def picture_on(part: Any) -> tuple[npt.NDArray[np.float64] | None, str | None]:
    """The picture on a part of a trimesh scene: ``uv`` (V, 2) and a ``data:`` address; (None, None) if it has none.

    A picture that cannot be read leaves the part in its plain colour.
    """
    material, uv = getattr(part.visual, "material", None), getattr(part.visual, "uv", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None or uv is None or np.shape(uv) != (len(part.vertices), 2) or not np.isfinite(uv).all():
        return None, None
    try:
        return np.asarray(uv, dtype=float), _address(image)
    except (OSError, ValueError, SyntaxError):  # what Pillow raises for torn files
        return None, None


def _address(image: Any) -> str:
    clear = image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info
    small = image.convert("RGBA" if clear else "RGB")
    small.thumbnail((LARGEST, LARGEST))
    content = BytesIO()
    if clear:
        small.save(content, "PNG")
    else:
        small.save(content, "JPEG", quality=QUALITY)
    return f"data:image/{'png' if clear else 'jpeg'};base64,{b64encode(content.getvalue()).decode('ascii')}"


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
