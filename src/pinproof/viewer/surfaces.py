"""Triangle surfaces of links, obstacles and markers, in metres.

:func:`shade` welds vertices and computes normals that are smooth on curved surfaces and sharp at edges. Meshes keep the
colours and textures of their files. :data:`SHAPES` and :data:`PRIMITIVES` list the shapes that the viewer can draw; any
other shape is refused.
"""

from __future__ import annotations

import inspect
import re
from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from pinproof import collision
from pinproof.common import theme
from pinproof.common.content_hash import cached, content_digest
from pinproof.common.structs import described, key
from pinproof.description import (
    COLOURED_SUFFIXES,
    LinkGeometry,
    TriangleMesh,
    meshes,
    metres_per_unit,
    read_mesh,
    resolved,
    z_up,
)
from pinproof.errors import InputError, MeshError, ViewerError
from pinproof.spatial import Array

Rgba = tuple[float, float, float, float]
Triangles = tuple[Array, npt.NDArray[np.int64]]
"""Vertices (V, 3) in metres and triangles (F, 3) of vertex indices."""

CREASE = np.deg2rad(38.0)
"""Radians. Adjacent faces that meet at a larger angle keep a sharp edge. The sides of a 16-sided cylinder meet at 22
degrees, the smallest chamfers of machined parts at 45 degrees."""

WELD_GRID = 1e-5
"""Metres. Vertices that round to the same point of this grid are merged; the difference is not visible."""

UV_GRID = 1 / 8192
"""Texture coordinates are rounded to this fraction of the texture's width, which is less than a pixel."""


@described(eq=False)
class Surface:
    """Triangles of one colour."""

    vertices: Array = key("(V, 3) in metres")
    normals: Array = key(
        "(V, 3) unit normals. They point outwards if the triangles are counter-clockwise seen from outside"
    )
    triangles: npt.NDArray[np.int64] = key("(F, 3) vertex indices")
    rgba: Rgba = key("colour and opacity, 0 to 1. The colours of a texture are multiplied by it")
    uv: Array | None = key(
        "(V, 2) texture coordinates, 0 to 1, from the lower left corner of the texture", default=None
    )
    image: str | None = key("the texture as a ``data:`` URL", default=None)

    def moved(self, a_from_b: Array) -> Surface:
        """Return the surface after a rigid transform (4, 4)."""
        rotation, shift = a_from_b[:3, :3], a_from_b[:3, 3]
        return replace(self, vertices=self.vertices @ rotation.T + shift, normals=self.normals @ rotation.T)


LEAST_AREA = 1e-14
"""Square metres: twice the area of the smallest triangle that is drawn."""


def shade(
    vertices: Array, triangles: npt.NDArray[np.int64], rgba: Rgba, uv: Array | None = None, image: str | None = None
) -> Surface:
    """Weld vertices and compute a normal for each; vertices on a sharp edge are duplicated.

    The corners of the triangles are the nodes of a graph. If two faces share an edge and meet at an angle below
    :data:`CREASE`, their corners are connected at both ends of the edge. Each connected component becomes one vertex.
    Its normal is the mean of the normals of its faces, weighted by area. With a texture (``uv`` (V, 2) and ``image``),
    vertices on a seam of the texture are duplicated too.
    """
    # Vertices at the same place become one point
    grid = np.rint(vertices / WELD_GRID).astype(np.int64)
    _, first, welded = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    points, faces = vertices[first], welded.reshape(-1)[triangles]
    # The length of a cross product is twice the triangle's area, so sums of them are weighted by area.
    cross = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    area = np.linalg.norm(cross, axis=1)
    valid = area > LEAST_AREA  # degenerate triangles have no normal
    faces, cross, area = faces[valid], cross[valid], area[valid]
    unit = cross / area[:, None]

    # Every face has three edges. Corner k is the start of edge k, corner (k + 1) % 3 its end.
    count = len(faces)
    corner = np.arange(3 * count).reshape(count, 3)
    starts, ends = faces, np.roll(faces, -1, axis=1)
    flipped = (starts > ends).ravel()
    low_corner = np.where(flipped, np.roll(corner, -1, axis=1).ravel(), corner.ravel())
    high_corner = np.where(flipped, corner.ravel(), np.roll(corner, -1, axis=1).ravel())
    edge = np.minimum(starts, ends).ravel() * np.int64(len(points)) + np.maximum(starts, ends).ravel()
    order = np.argsort(edge, kind="stable")
    first_edge, second_edge = order[:-1], order[1:]
    shared = edge[first_edge] == edge[second_edge]
    first_edge, second_edge = first_edge[shared], second_edge[shared]
    smooth = np.einsum("ij,ij->i", unit[first_edge // 3], unit[second_edge // 3]) > np.cos(CREASE)
    first_edge, second_edge = first_edge[smooth], second_edge[smooth]
    rows = np.concatenate([low_corner[first_edge], high_corner[first_edge]])
    columns = np.concatenate([low_corner[second_edge], high_corner[second_edge]])
    label = collision.connected_parts(3 * count, rows, columns)
    total = int(label.max(initial=-1)) + 1

    # The normal of a vertex is the sum of those of its faces, each as long as twice its area
    normals = np.zeros((total, 3))
    np.add.at(normals, label, np.repeat(cross, 3, axis=0))
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, size, out=np.zeros_like(normals), where=size > 0)
    positions = np.zeros((total, 3))
    positions[label] = points[faces.ravel()]
    if uv is None or image is None:
        return Surface(positions, normals, label.reshape(count, 3).astype(np.int64), rgba)
    # A vertex with several texture coordinates is duplicated
    vertex_uv = np.column_stack([label, np.rint(uv[triangles[valid]].reshape(-1, 2) / UV_GRID).astype(np.int64)])
    vertex_uv, vertex = np.unique(vertex_uv, axis=0, return_inverse=True)
    source = vertex_uv[:, 0]
    corners = vertex.reshape(count, 3).astype(np.int64)
    return Surface(positions[source], normals[source], corners, rgba, vertex_uv[:, 1:] * UV_GRID, image)


def merge_by_colour(surfaces: Sequence[Surface]) -> list[Surface]:
    """Merge surfaces of equal colour and texture, in order of first appearance; fewer objects render faster."""
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


MAX_TEXTURE_SIZE = 1024
"""Pixels of a side; larger textures are scaled down to keep the page small."""

JPEG_QUALITY = 88


def _texture(part: Any) -> tuple[npt.NDArray[np.float64] | None, str | None]:
    """Texture coordinates (V, 2) and ``data:`` URL of a part of a trimesh scene; (None, None) without a texture.

    If the texture cannot be read, the part is drawn in its plain colour.
    """
    material, uv = getattr(part.visual, "material", None), getattr(part.visual, "uv", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None or uv is None or np.shape(uv) != (len(part.vertices), 2) or not np.isfinite(uv).all():
        return None, None
    transparent = image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info
    kind, content = "PNG" if transparent else "JPEG", BytesIO()
    try:
        small = image.convert("RGBA" if transparent else "RGB")
        small.thumbnail((MAX_TEXTURE_SIZE, MAX_TEXTURE_SIZE))
        small.save(content, kind, **({} if transparent else {"quality": JPEG_QUALITY}))
    except (OSError, ValueError, SyntaxError):  # Pillow raises these for damaged files
        return None, None
    url = f"data:image/{kind.lower()};base64,{b64encode(content.getvalue()).decode('ascii')}"
    return np.asarray(uv, dtype=float), url


LINK_GREY, OBSTACLE_SAND, COLLISION_AMBER = theme.rgba("link"), theme.rgba("obstacle"), theme.rgba("collision", 0.45)
REFERENCE = re.compile(rb"\.(?:bin|bmp|gif|jpe?g|mtl|png|tga|tiff?|webp)\b", re.IGNORECASE)
"""The ends of the names of files in a mesh file."""

NOT_IN_NAMES = re.compile(rb"[\x00-\x1f<>\"'|*?]")
LONGEST_NAME = 200
"""Characters that separate the name of a file from other text, and the largest number of bytes of a name."""

LEAST_SIDES, MOST_SIDES, SAGITTA = 24, 96, 2e-4
"""Segments of a circle, at least and at most, and by how much (m) they may be inside it: of many small bodies a page
would become large. The number is a multiple of 8."""

PLATE_SIZE, PLATE_THICKNESS = 3.0, 0.002
"""Metres. A half-space is drawn as a square plate of this size just below its plane."""

TUBE_SIDES = 10
"""Segments of the cross section of a drawn line."""


def link_surfaces(geometry: LinkGeometry) -> list[Surface]:
    """Surfaces of a ``<visual>`` or ``<collision>`` element in the frame of its link, one for each colour.

    The colours of the mesh file take precedence over the material of the URDF; the default is grey. MeshError if a mesh
    is missing or unusable; ViewerError if the viewer cannot draw this kind of geometry.
    """
    if geometry.kind == "mesh":
        surfaces = _mesh(_file_of(geometry), _three(geometry.size), geometry.rgba, LINK_GREY)
    else:
        surfaces = [shade(*_primitive(geometry), geometry.rgba or LINK_GREY)]
    return [surface.moved(geometry.origin) for surface in surfaces]


def body_surfaces(geometry: LinkGeometry) -> list[Surface]:
    """Surfaces of a ``<collision>`` element in the frame of its link, a mesh as its hull; errors as `link_surfaces`."""
    if geometry.kind != "mesh":
        surface = shade(*_primitive(geometry), COLLISION_AMBER)
    else:
        mesh = read_mesh(_file_of(geometry), _three(geometry.size))

        def hull() -> list[Surface]:
            try:
                return [shade(*_hull(collision.ConvexShape(mesh.vertices)), COLLISION_AMBER)]
            except InputError:  # a flat mesh has no hull
                return [shade(mesh.vertices, mesh.triangles, COLLISION_AMBER)]

        (surface,) = _stored("hull", content_digest(mesh.vertices, mesh.triangles), hull)
    return [surface.moved(geometry.origin)]


def _file_of(geometry: LinkGeometry) -> Path:
    """Return the mesh file of a link."""
    if geometry.mesh is None:
        raise MeshError(geometry.name, f"the mesh of link {geometry.link!r} names no file")
    return resolved(geometry.mesh, geometry.link)


def obstacle_surfaces(obstacle: collision.Obstacle) -> list[Surface]:
    """Surfaces of an obstacle in its own frame; MeshError if its mesh is missing, ViewerError for an unknown shape."""
    shape, rgba = obstacle.shape, obstacle.rgba
    if isinstance(shape, collision.Mesh) and shape.path is not None:
        return _mesh(Path(shape.path), _three(shape.scale), rgba, OBSTACLE_SAND, own_colours=rgba is None)
    draw = SHAPES.get(type(shape))
    if draw is None:
        known = ", ".join(kind.__name__ for kind in SHAPES)
        raise ViewerError(f"the viewer cannot draw a {type(shape).__name__}; it can draw {known}")
    return [shade(*draw(shape), rgba or OBSTACLE_SAND)]


def tube(points: Array, radius: float, rgba: Rgba) -> Surface | None:
    """A tube along ``points`` (N, 3), or None if they coincide. WebGL would draw lines only one pixel wide."""
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
    # Each ring reuses the side direction of the previous one, orthogonalised, so that the tube does not twist.
    side = np.eye(3)[np.abs(steps[0]).argmin()]
    angles = np.linspace(0, 2 * np.pi, TUBE_SIDES, endpoint=False)[:, None]
    rings, outwards = [], []
    for corner, tangent, before in zip(corners, tangents, np.concatenate([steps[:1], steps]), strict=True):
        along = tangent if np.linalg.norm(tangent) > 1e-6 else before  # the path reverses its direction here
        along = along / np.linalg.norm(along)
        flat = side - (side @ along) * along
        side = flat / np.linalg.norm(flat) if np.linalg.norm(flat) > 1e-6 else np.eye(3)[np.abs(along).argmin()]
        outward = np.cos(angles) * side + np.sin(angles) * np.cross(along, side)
        outwards.append(outward)
        rings.append(corner + radius * outward)
    # Two triangles between neighbouring corners of neighbouring rings
    ring = np.arange(TUBE_SIDES)
    quad = np.column_stack([ring, np.roll(ring, -1), ring + TUBE_SIDES, np.roll(ring, -1) + TUBE_SIDES])
    quads = (quad + TUBE_SIDES * np.arange(len(corners) - 1)[:, None, None]).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [2, 1, 3]]])
    return Surface(np.concatenate(rings), np.concatenate(outwards), triangles, rgba)


def ball(centre: Array, radius: float, rgba: Rgba) -> Surface:
    """A sphere with the centre ``centre`` (3,)."""
    surface = shade(*_sphere(radius), rgba)
    return Surface(surface.vertices + centre, surface.normals, surface.triangles, rgba)


def cone(tip: Array, direction: Array, radius: float, height: float, rgba: Rgba) -> Surface:
    """A cone with its apex at ``tip`` (3,) that points along the unit vector ``direction`` (3,)."""
    side = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    side /= np.linalg.norm(side)
    a_from_cone = np.eye(4)
    a_from_cone[:3, :3] = np.column_stack([side, np.cross(direction, side), direction])
    a_from_cone[:3, 3] = tip - 0.5 * height * direction
    return shade(*_cone(radius, height), rgba).moved(a_from_cone)


def sides_of(radius: float) -> int:
    """The number of segments with which a circle is drawn."""
    least = np.pi / np.arccos(max(1.0 - SAGITTA / radius, 0.0))
    return int(np.clip(8 * np.ceil(least / 8), LEAST_SIDES, MOST_SIDES))


def revolved(radii: npt.ArrayLike, heights: npt.ArrayLike, *, sides: int | None = None) -> Triangles:
    """The surface that a profile of M points describes about z, from a point on the axis to a point on the axis."""
    radius, height = np.asarray(radii, dtype=float), np.asarray(heights, dtype=float)
    sides = sides or sides_of(float(radius.max()))
    rings = len(radius) - 2  # the first and the last point are on the axis
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    around = np.concatenate(
        [np.column_stack([r * circle, np.full(sides, z)]) for r, z in zip(radius, height, strict=True)]
    )
    vertices = np.vstack([[0.0, 0.0, height[0]], around[sides:-sides], [0.0, 0.0, height[-1]]])
    here = np.arange(sides)
    after, last = (here + 1) % sides, 1 + rings * sides
    triangles = [np.column_stack([np.zeros_like(here), 1 + after, 1 + here])]
    for ring in range(rings - 1):
        low, high = 1 + ring * sides, 1 + (ring + 1) * sides
        triangles.append(np.column_stack([low + here, low + after, high + after]))
        triangles.append(np.column_stack([low + here, high + after, high + here]))
    top = last - sides
    triangles.append(np.column_stack([top + here, top + after, np.full_like(here, last)]))
    return vertices, np.concatenate(triangles).astype(np.int64)


BOX_FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
"""The corners of the six faces of a box, counter-clockwise seen from outside; corner 4 x + 2 y + z, each 0 or 1."""


def box_triangles(x: float, y: float, z: float) -> Triangles:
    """Vertices and triangles of a box with these sides, centred at the origin."""
    vertices = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * [x, y, z]
    return vertices, np.concatenate([BOX_FACES[:, [0, 1, 2]], BOX_FACES[:, [0, 2, 3]]]).astype(np.int64)


def _sphere(radius: float) -> Triangles:
    return _capsule(radius, 0.0)


def _ellipsoid(*radii: float) -> Triangles:
    vertices, triangles = _sphere(max(radii))
    return vertices * np.array(radii) / max(radii), triangles


def _cylinder(radius: float, length: float) -> Triangles:
    return revolved([0, radius, radius, 0], [-length / 2, -length / 2, length / 2, length / 2])


def _cone(radius: float, length: float) -> Triangles:
    return revolved([0, radius, 0], [-length / 2, -length / 2, length / 2])


def _capsule(radius: float, length: float) -> Triangles:
    angles = np.linspace(-np.pi / 2, 0, sides_of(radius) // 4 + 1)
    radii, heights = radius * np.cos(angles), radius * np.sin(angles) - length / 2
    ends = slice(None, -1) if length == 0 else slice(None)
    radii, heights = np.concatenate([radii, radii[ends][::-1]]), np.concatenate([heights, -heights[ends][::-1]])
    radii[[0, -1]] = 0.0
    return revolved(radii, heights)


def _hull(shape: collision.ConvexShape) -> Triangles:
    corners = collision.rounded_corners(shape.points, shape.radius)
    return corners, collision.hull_triangles(corners)


PLATE = box_triangles(PLATE_SIZE, PLATE_SIZE, PLATE_THICKNESS)

SHAPES: dict[type, Callable[[Any], Triangles]] = {
    collision.Box: lambda shape: box_triangles(shape.x, shape.y, shape.z),
    collision.Sphere: lambda shape: _sphere(shape.radius),
    collision.Cylinder: lambda shape: _cylinder(shape.radius, shape.length),
    collision.Capsule: lambda shape: _capsule(shape.radius, shape.length),
    collision.Cone: lambda shape: _cone(shape.radius, shape.length),
    collision.Ellipsoid: lambda shape: _ellipsoid(shape.rx, shape.ry, shape.rz),
    collision.HalfSpace: lambda _: (PLATE[0] - [0.0, 0.0, PLATE_THICKNESS / 2], PLATE[1]),
    collision.ConvexShape: _hull,
    collision.Mesh: lambda shape: (collision.triangles_of(shape).vertices, collision.triangles_of(shape).triangles),
    collision.PointCloud: collision.cell_faces,
    collision.OccupancyGrid: collision.cell_faces,
    collision.HeightMap: collision.ground_surface,
}
"""How each shape of an obstacle or attached object is drawn. A new shape is registered here."""

PRIMITIVES: dict[str, Callable[..., Triangles]] = {
    "box": box_triangles,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "capsule": _capsule,
}
"""How each primitive of a robot description is drawn; the arguments are the numbers of ``LinkGeometry.size``."""


def _primitive(geometry: LinkGeometry) -> Triangles:
    """Triangles of a primitive of a link; see :data:`PRIMITIVES`."""
    draw = PRIMITIVES.get(geometry.kind)
    if draw is None:
        known = ", ".join([*PRIMITIVES, "mesh"])
        raise ViewerError(f"the viewer cannot draw a {geometry.kind} of link {geometry.link!r}; it can draw {known}")
    return draw(*geometry.size)


def _mesh(
    path: Path, scale: tuple[float, float, float], stated: Rgba | None, default: Rgba, own_colours: bool = True
) -> list[Surface]:
    """Surfaces of a mesh file; ``own_colours`` keeps the colours and textures that the file states."""
    checked = read_mesh(path, scale)
    if not own_colours or path.suffix.lower() not in COLOURED_SUFFIXES:
        key = content_digest(checked.vertices, checked.triangles, repr(stated or default))
        return _stored("shaded", key, lambda: [shade(checked.vertices, checked.triangles, stated or default)])
    data = path.read_bytes()
    settings = repr((scale, stated, default, _referred(path, data)))
    key = content_digest(data, path.suffix, str(path.parent), settings)
    return _stored("coloured", key, lambda: _coloured(path, scale, checked, stated, default))


def _referred(path: Path, data: bytes) -> list[tuple[str, int, int]]:
    """The files that a mesh file names (textures, materials, buffers): name, size and time of change; -1 if missing."""
    names = set()
    for end in REFERENCE.finditer(data):
        name = NOT_IN_NAMES.split(data[max(0, end.start() - LONGEST_NAME) : end.end()])[-1].strip()
        names |= {name, name.split()[-1]}  # "map_Kd texture.png"
    found = []
    for name in sorted(names):
        text = unquote(name.decode("utf-8", "replace"))
        file = path.parent / text
        try:
            status = file.stat()
        except (OSError, ValueError):
            found.append((text, -1, -1))
            continue
        found.append((text, status.st_size, status.st_mtime_ns))
        if file.suffix.lower() == ".mtl" and path.suffix.lower() != ".mtl":
            found += _referred(file, file.read_bytes())
    return found


def _stored(kind: str, key: str, make: Callable[[], list[Surface]]) -> list[Surface]:
    """The surfaces of an entry of the cache on disk, or those that ``make`` computes."""

    def arrays() -> dict[str, npt.NDArray[Any]]:
        found: dict[str, npt.NDArray[Any]] = {}
        for number, each in enumerate(make()):
            values = {"vertices": each.vertices, "normals": each.normals, "triangles": each.triangles}
            values["rgba"] = np.array(each.rgba)
            if each.uv is not None and each.image is not None:
                values |= {"uv": each.uv, "image": np.frombuffer(each.image.encode("ascii"), dtype=np.uint8)}
            found |= {f"{number:04d} {name}": value for name, value in values.items()}
        return found

    found = cached(
        kind,
        key,
        arrays,
        code=[__file__, theme.__file__, *meshes.MESH_CODE, inspect.getfile(collision.connected_parts)],
        libraries=["trimesh", "pycollada", "pillow"],
    )
    # Back from the arrays of the cache
    surfaces = []
    for number in sorted({name.split()[0] for name in found}):
        values = {name.split()[1]: value for name, value in found.items() if name.startswith(f"{number} ")}
        r, g, b, a = values["rgba"].tolist()
        image = values["image"].tobytes().decode("ascii") if "image" in values else None
        shape = values["vertices"], values["normals"], values["triangles"]
        surfaces.append(Surface(*shape, (r, g, b, a), values.get("uv"), image))
    return surfaces


def _coloured(
    path: Path, scale: tuple[float, float, float], checked: TriangleMesh, stated: Rgba | None, default: Rgba
) -> list[Surface]:
    """Surfaces in the colours that trimesh reads; in one colour if it does not read the triangles that are checked."""
    import trimesh

    plain = [shade(checked.vertices, checked.triangles, stated or default)]
    try:
        scene = trimesh.load(path, force="scene", process=False)
    except Exception:  # noqa: BLE001  # trimesh raises whatever its many readers raise
        return plain
    # trimesh ignores the unit and the up axis of a COLLADA file
    factor = np.asarray(scale) * metres_per_unit(path)
    order = -1 if np.prod(scale) < 0 else 1  # a mirrored mesh needs its triangles reversed
    surfaces, drawn = [], []
    for node in scene.graph.nodes_geometry:
        scene_from_node, name = scene.graph[node]
        part = scene.geometry[name]
        if not isinstance(part, trimesh.Trimesh) or len(part.faces) == 0:
            continue
        vertices = np.asarray(part.vertices) @ scene_from_node[:3, :3].T + scene_from_node[:3, 3]
        vertices = vertices @ z_up(path).T * factor
        # The colour that the file states for the part. COLLADA files of robots are mostly written by Blender, with
        # linear colours; without conversion they appear black.
        material = getattr(part.visual, "material", None)
        source = part.visual if material is None else material
        raw = getattr(source, "main_color", None) if part.visual.defined else None
        colour = stated or default
        if raw is not None:
            r, g, b, a = (float(component) / 255.0 for component in raw)
            if path.suffix.lower() == ".dae":
                r, g, b = (12.92 * c if c <= 0.0031308 else 1.055 * c ** (1 / 2.4) - 0.055 for c in (r, g, b))
            colour = (r, g, b, a if a > 0 else 1.0)
        uv, image = _texture(part)
        triangles = np.array(part.faces, dtype=np.int64)[:, ::order]
        drawn.append(vertices[triangles].reshape(-1, 3))
        surfaces.append(shade(vertices, triangles, colour, uv, image))
    # The drawn triangles must be those that are checked: equally many, and with the same bounds
    corners = checked.vertices[checked.triangles].reshape(-1, 3)
    near = 1e-5 * np.abs(corners).max()
    if sum(map(len, drawn)) != len(corners) or any(
        np.abs(limit(np.concatenate(drawn), axis=0) - limit(corners, axis=0)).max() > near for limit in (np.min, np.max)
    ):
        return plain
    return merge_by_colour(surfaces)


def _three(values: Any) -> tuple[float, float, float]:
    x, y, z = values
    return (float(x), float(y), float(z))
