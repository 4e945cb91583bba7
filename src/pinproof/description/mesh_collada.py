"""COLLADA files (DAE), versions 1.4 and 1.5: the meshes of the scene that is shown, in the unit of the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from pinproof.description import mesh_reading
from pinproof.description.xml_reader import Element, parse_text, place
from pinproof.errors import MeshError

PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans")
NO_SURFACE = ("lines", "linestrips")
"""Primitives that are read over."""

INSTANCES = ("instance_geometry", "instance_controller", "instance_node")

TRANSFORMS = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3}
"""The transforms of a node that are supported, with how many numbers they have."""

ASSET = {"contributor", "coverage", "created", "extra", "keywords", "modified", "revision", "subject", "title"}
ASSET |= {"unit", "up_axis"}
"""The elements of an asset."""

Mesh = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]


def read_collada(data: bytes, path: Path) -> mesh_reading.Reading:
    """Read a DAE file. Its up axis is not applied."""
    root = parse_text(data, path, MeshError, huge=True)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return _Collada(root, path).read()


class _Collada:
    """The elements of a document; MeshError with the line for one that is invalid or not supported."""

    def __init__(self, root: Element, path: Path) -> None:
        self.root, self.path = root, path
        self.meshes: dict[Element, Mesh] = {}
        self.targets: dict[tuple[str, str], list[Element]] = {}
        for element in root.iter("geometry", "node", "visual_scene"):
            self.targets.setdefault((element.tag, element.get("id", "")), []).append(element)

    def refused(self, element: Element, reason: str) -> MeshError:
        return mesh_reading.refused(self.path, reason, place(element))

    def read(self) -> mesh_reading.Reading:
        # An element with a misspelt name must not be read over: the unit would be lost.
        # whatever is not known could hold geometry
        for element in self.root:
            if element.tag not in ("asset", "scene", "extra") and not element.tag.startswith("library_"):
                raise self.refused(element, f"<{element.tag}> is not supported")
        for element in self.root.iterfind("asset/*"):
            if element.tag not in ASSET:
                raise self.refused(element, f"<{element.tag}> is not supported")
        # one unit for the whole file, in its own asset or repeated in those of parts
        unit = 1.0
        for element in self.root.iter("unit"):
            if element.getparent().tag != "asset":
                continue
            try:
                (meter,) = mesh_reading.numbers(element.get("meter", "1").encode(), np.float64)
            except ValueError:
                meter = np.nan
            if not 0 < meter < np.inf:
                raise self.refused(element, "it has a unit that is not a positive number of metres")
            if set(element.attrib) - {"name", "meter"}:
                raise self.refused(
                    element, f"<unit> has the attributes {', '.join(element.attrib)}; valid: name, meter"
                )
            if element.getparent().getparent() is self.root:
                unit = meter
            elif meter != unit:
                raise self.refused(element, f"a part has the unit {meter:g} m, the file {unit:g} m")
        # a geometry that is not shown is refused, because it may be meant to be part of the mesh
        instances, triangles, vertices = self.instances(), 0, 0
        placed_geometries = {geometry for _, geometry in instances}
        for element in self.root.iterfind("library_geometries/geometry"):
            if element not in placed_geometries:
                raise self.refused(
                    element, f"the geometry {element.get('id')!r} is not part of the scene that is shown"
                )
        # the sizes are counted before the triangles of all instances are made
        for _, geometry in instances:
            points, corners = self.mesh(geometry)
            triangles, vertices = triangles + len(corners), vertices + len(points)
            mesh_reading.refuse_many(self.path, triangles, vertices)
        return mesh_reading.Reading(
            *mesh_reading.placed((matrix, *self.mesh(geometry)) for matrix, geometry in instances), unit
        )

    def instances(self) -> list[tuple[npt.NDArray[np.float64], Element]]:
        """The geometries of the scene that is shown, each with its transform."""
        # the scene that is shown must be the only one with geometry
        shown = [self.target(element, "visual_scene") for element in self.root.iterfind("scene/instance_visual_scene")]
        if len(shown) != 1:
            raise mesh_reading.refused(self.path, f"it shows {len(shown)} scenes (<instance_visual_scene>); valid: one")
        for scene in self.root.iter("visual_scene"):
            if scene is not shown[0] and next(scene.iter(*INSTANCES), None) is not None:
                raise self.refused(scene, f"the scene {scene.get('id')!r} has geometry, but is not shown")
        instances = []
        nodes = 0
        # nodes from the root, each with its transform; no recursion, because files may nest without end
        stack = [(shown[0], np.eye(4), None, 0)]
        while stack:
            node, matrix, unsupported, depth = stack.pop()
            nodes += 1
            if nodes > mesh_reading.MOST_NODES or depth > mesh_reading.DEEPEST_NODE:
                most = f"{mesh_reading.MOST_NODES:,} nodes with all instances"
                what = f"the limit of a scene is {most}, {mesh_reading.DEEPEST_NODE} below each other"
                raise self.refused(node, what)
            # transforms apply in the order of the file, also to what follows them
            children = []
            for element in node:
                if element.tag in TRANSFORMS:
                    matrix = matrix @ self.transform(element)
                elif element.tag in ("lookat", "skew"):
                    unsupported = element
                elif element.tag == "node":
                    children.append(element)
                elif element.tag == "instance_node":
                    children.append(self.target(element, "node"))
                elif element.tag == "instance_geometry":
                    if unsupported is not None:
                        raise self.refused(unsupported, f"<{unsupported.tag}> is not supported")
                    instances.append((matrix, self.target(element, "geometry")))
                elif element.tag not in ("asset", "evaluate_scene", "extra", "instance_camera", "instance_light"):
                    raise self.refused(element, f"<{element.tag}> is not supported")
            stack += [(child, matrix, unsupported, depth + 1) for child in reversed(children)]
        return instances

    def target(self, element: Element, tag: str) -> Element:
        """The element that a URL names."""
        url = element.get("url", "")
        named = self.targets.get((tag, url[1:]), []) if url.startswith("#") else []
        if len(named) != 1:
            raise self.refused(element, f"{url!r} names {len(named)} elements <{tag}> of this file; valid: one")
        return named[0]

    def transform(self, element: Element) -> npt.NDArray[np.float64]:
        values = self.floats(self.text(element), TRANSFORMS[element.tag], element)
        matrix = np.eye(4)
        if element.tag == "matrix":
            matrix = values.reshape(4, 4)
            if (matrix[3] != (0, 0, 0, 1)).any():
                raise self.refused(element, "the last row of a <matrix> is 0 0 0 1")
        elif element.tag == "translate":
            matrix[:3, 3] = values
        elif element.tag == "scale":
            matrix[range(3), range(3)] = values
        elif values[3] != 0 and not values[:3].any():
            raise self.refused(element, "the axis of a <rotate> is not 0 0 0")
        elif values[3] != 0:
            x, y, z = axis = values[:3] / np.linalg.norm(values[:3])
            turn, across = np.radians(values[3]), np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            matrix[:3, :3] = (
                np.cos(turn) * np.eye(3) + np.sin(turn) * across + (1 - np.cos(turn)) * np.outer(axis, axis)
            )
        return matrix

    def mesh(self, geometry: Element) -> Mesh:
        """Vertices and triangles of a geometry, read once."""
        if geometry not in self.meshes:
            contents = [element for element in geometry if element.tag not in ("asset", "extra")]
            if [element.tag for element in contents] != ["mesh"]:
                names = ", ".join(f"<{element.tag}>" for element in contents) or "nothing"
                raise self.refused(geometry, f"the geometry {geometry.get('id')!r} has {names}; supported: one <mesh>")
            points = self.positions(contents[0])
            parts = [np.empty((0, 3), dtype=np.int64)]
            for element in contents[0]:
                if element.tag in PRIMITIVES:
                    parts.append(self.triangles(element, points))
                elif element.tag not in ("source", "vertices", "extra", *NO_SURFACE):
                    raise self.refused(element, f"<{element.tag}> is not supported")
            triangles = np.concatenate(parts)
            self.meshes[geometry] = (points if len(triangles) else np.empty((0, 3))), triangles
        return self.meshes[geometry]

    def positions(self, mesh: Element) -> npt.NDArray[np.float64]:
        """The points (V, 3) of the ``<vertices>`` of a mesh."""
        inputs = mesh.findall("vertices/input[@semantic='POSITION']")
        sources = (
            [source for source in mesh.findall("source") if f"#{source.get('id')}" == inputs[0].get("source")]
            if len(inputs) == 1
            else []
        )
        if len(sources) != 1:
            raise self.refused(
                mesh, "it needs one <vertices> with one input POSITION, whose <source> is in the same mesh"
            )
        (source,) = sources
        array, accessor = source.find("float_array"), source.find("technique_common/accessor")
        if array is None or accessor is None or accessor.get("source") != f"#{array.get('id')}":
            raise self.refused(source, "it needs a <float_array> and its <accessor>")
        values = self.floats(self.text(array), self.whole(array, "count"), array)
        # the accessor states which of the numbers are coordinates
        count, stride, offset = (
            self.whole(accessor, "count"),
            self.whole(accessor, "stride", 1),
            self.whole(accessor, "offset", 0),
        )
        # A parameter without a name is a value to skip.
        columns = [column for column, param in enumerate(accessor.findall("param")) if param.get("name")]
        names = [param.get("name") for param in accessor.findall("param") if param.get("name")]
        if [name.upper() for name in names] != ["X", "Y", "Z"] or columns[-1] >= stride:
            raise self.refused(accessor, f"it has the parameters {', '.join(names) or 'none'}; supported: X, Y, Z")
        if offset + count * stride > len(values):
            raise self.refused(accessor, f"it reads {offset + count * stride:,} numbers, but there are {len(values):,}")
        return values[offset : offset + count * stride].reshape(count, stride)[:, columns]

    def triangles(self, element: Element, points: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
        """Triangles (F, 3) of a primitive, exactly as many polygons as it states."""
        inputs = element.findall("input")
        # each corner has one index for each input, of which that of the vertex is needed
        offsets = [self.whole(source, "offset") for source in inputs if source.get("semantic") == "VERTEX"]
        if len(offsets) != 1:
            raise self.refused(element, f"it has {len(offsets)} inputs VERTEX; valid: one")
        for child in element:
            if child.tag not in ("input", "p", "vcount", "extra"):  # <ph> is a polygon with holes
                raise self.refused(child, f"<{child.tag}> is not supported")
        stride = 1 + max(self.whole(source, "offset") for source in inputs)
        lists = []
        for child in element.iterfind("p"):
            values = self.integers(self.text(child), child)
            if len(values) % stride:
                raise self.refused(child, f"it has {len(values):,} indices, no multiple of its {stride} inputs")
            lists.append(values.reshape(-1, stride)[:, offsets[0]])
        corners = np.concatenate([np.empty(0, dtype=np.int64), *lists])
        if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
            raise self.refused(element, f"it has vertex indices outside the {len(points)} vertices")
        # the number of corners of each polygon; their number and sum must be those that are stated
        sizes = np.array([len(part) for part in lists], dtype=np.int64)
        if element.tag == "triangles":
            sizes = np.full(len(corners) // 3, 3)
        elif element.tag == "polylist":
            sizes = np.concatenate(
                [np.empty(0, dtype=np.int64), *(self.integers(self.text(v), v) for v in element.iterfind("vcount"))]
            )
        if len(sizes) != self.whole(element, "count") or sizes.sum() != len(corners):
            what = f"it states {element.get('count')} polygons, but has {len(sizes):,} with {len(corners):,} corners"
            raise self.refused(element, what)
        if len(sizes) and sizes.min() < 3:
            raise self.refused(
                element, f"polygon {sizes.argmin() + 1} has {sizes.min()} corners; valid: at least three"
            )
        mesh_reading.refuse_many(self.path, int((sizes - 2).sum()))
        if element.tag in ("tristrips", "trifans"):
            return np.concatenate(
                [(mesh_reading.strip if element.tag == "tristrips" else mesh_reading.fan)(part) for part in lists]
            )
        try:
            return mesh_reading.triangulate(points, corners, sizes)
        except ValueError as error:
            raise self.refused(element, str(error)) from error

    def text(self, element: Element) -> str:
        if len(element):
            raise self.refused(element[0], f"<{element[0].tag}> inside <{element.tag}> is not supported")
        return element.text or ""

    def floats(self, text: str, count: int, element: Element) -> npt.NDArray[np.float64]:
        try:
            values = mesh_reading.numbers(text.encode(), np.float64)
        except ValueError as error:
            raise self.refused(element, str(error)) from error
        if len(values) != count:
            raise self.refused(element, f"it has {len(values):,} numbers, not {count:,}")
        return values

    def integers(self, text: str, element: Element) -> npt.NDArray[np.int64]:
        try:
            return mesh_reading.numbers(text.encode(), np.int64)
        except ValueError as error:
            raise self.refused(element, str(error)) from error

    def whole(self, element: Element, attribute: str, default: int | None = None) -> int:
        text = element.get(attribute, "" if default is None else str(default)).strip()
        if not (text.isascii() and text.isdecimal() and len(text) < 12):
            raise self.refused(element, f"{attribute}={text!r} is no whole number")
        return int(text)
