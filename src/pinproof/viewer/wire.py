"""Commands to meshcat's browser viewer as dictionaries, with their arrays in one binary block.

Only the JavaScript viewer of the installed meshcat is used. Its Python package is not imported: it loads ZeroMQ,
IPython and Pillow, prints warnings, and names objects by the time, so that pages would not be reproducible. The
commands (``set_object``, ``set_transform``, ``set_property``, ``set_animation``) are those that meshcat documents for
clients in any language; objects are in the JSON object format 4 of three.js.
"""

from __future__ import annotations

import json
from base64 import b64encode
from hashlib import blake2b
from typing import Any

import numpy as np
import numpy.typing as npt

from pinproof.common import theme
from pinproof.spatial import Array
from pinproof.viewer.surfaces import Surface

TYPED_ARRAYS = {"float32": "Float32Array", "int8": "Int8Array", "uint16": "Uint16Array", "uint32": "Uint32Array"}


def node_name(name: str) -> str:
    """The name of a node in meshcat's tree. A slash would separate levels; it is replaced by a similar character."""
    return name.replace("/", "\u2215")


def node_path(*names: str) -> str:
    """A path in meshcat's tree from the names of the links or obstacles."""
    return "/" + "/".join(map(node_name, names))


def script_json(value: Any) -> str:
    """A value as JSON, escaped for a ``<script>`` element."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


class Commands:
    """A sequence of commands and the arrays that they refer to."""

    def __init__(self) -> None:
        self.items: list[dict[str, Any]] = []
        self.pictures: dict[str, list[list[str]]] = {}
        """Nodes by the ``data:`` URL of their texture. The page applies them itself, because meshcat does so late."""
        self._blob = bytearray()
        self._stored: dict[tuple[str, bytes], dict[str, Any]] = {}
        self._objects = 0

    def set_transform(self, path: str, a_from_b: Array) -> None:
        """Place a node in its parent's frame."""
        self.items.append(transform_command(path, a_from_b))

    def set_property(self, path: str, name: str, value: Any) -> None:
        """Set a property of a node, or of the three.js object in it when the path ends in ``<object>``."""
        self.items.append({"type": "set_property", "path": path, "property": name, "value": value})

    def set_animation(self, animations: list[dict[str, Any]]) -> None:
        """Set tracks that are played in a loop; they are paused at first."""
        options = {"play": False, "repetitions": 1_000_000}
        self.items.append({"type": "set_animation", "path": "", "animations": animations, "options": options})

    def set_surface(self, path: str, surface: Surface, **material: Any) -> None:
        """Draw a surface; ``material`` adds to or replaces properties of its Phong material."""
        wide = len(surface.vertices) > np.iinfo(np.uint16).max
        attributes = {
            "position": self._attribute(surface.vertices.astype(np.float32)),
            # The error of a normal in three bytes is below half a degree, which is not visible.
            "normal": {**self._attribute(np.rint(surface.normals * 127).astype(np.int8)), "normalized": True},
        }
        if surface.uv is not None and surface.image is not None:
            attributes["uv"] = {**self._attribute(surface.uv.astype(np.float32)), "itemSize": 2}
            self.pictures.setdefault(surface.image, []).append([*path.strip("/").split("/")])
        index = {**self._attribute(surface.triangles.astype(np.uint32 if wide else np.uint16)), "itemSize": 1}
        geometry = {"type": "BufferGeometry", "data": {"attributes": attributes, "index": index}}
        self.set_mesh(path, geometry, surface.rgba, **material)

    def set_mesh(self, path: str, geometry: dict[str, Any], rgba: tuple[float, ...], **material: Any) -> None:
        """Draw a geometry of three.js."""
        # three.js takes a colour as one number
        r, g, b = (round(255 * min(max(c, 0.0), 1.0)) for c in rgba[:3])
        # A transparent surface may coincide with an opaque one, such as a bin with a part that touches it: it is drawn
        # slightly behind, so that there are no stripes, and hides nothing
        behind = {"depthWrite": False, "polygonOffset": True, "polygonOffsetFactor": 1, "polygonOffsetUnits": 4}
        look = {
            "type": "MeshPhongMaterial",
            "color": r << 16 | g << 8 | b,
            "specular": theme.number("gloss"),
            "shininess": 28,
            "side": 2,  # both sides, because the triangles of some files are oriented inwards
            "opacity": rgba[3],
            "transparent": rgba[3] < 1.0,
            **(behind if rgba[3] < 1.0 else {}),
            **material,
        }
        self.set_object(path, "Mesh", {"geometry": geometry, "material": look})

    def set_lines(self, path: str, segments: Array, rgba: tuple[float, ...], **material: Any) -> None:
        """Draw separate segments, each between two neighbouring rows of ``segments`` (2N, 3)."""
        r, g, b = (round(255 * c) for c in rgba[:3])
        look = {"type": "LineBasicMaterial", "color": r << 16 | g << 8 | b, "opacity": rgba[3], "transparent": True}
        self._set_vertices(path, "LineSegments", {**look, **material}, position=segments)

    def set_points(self, path: str, points: Array, rgb: Array, size: float) -> None:
        """Draw ``points`` (N, 3) in their colours ``rgb`` (N, 3), as squares of ``size`` metres."""
        look = {"type": "PointsMaterial", "size": size, "vertexColors": 2}
        self._set_vertices(path, "Points", look, position=points, color=rgb)

    def _set_vertices(self, path: str, kind: str, look: dict[str, Any], **rows: Array) -> None:
        """Draw an object without triangles, from the attributes (N, 3) of its vertices."""
        attributes = {name: self._attribute(values.astype(np.float32)) for name, values in rows.items()}
        geometry = {"type": "BufferGeometry", "data": {"attributes": attributes}}
        self.set_object(path, kind, {"geometry": geometry, "material": look})

    def set_object(self, path: str, kind: str, parts: dict[str, Any], **properties: Any) -> None:
        """Set the three.js object of a node; ``parts`` (geometry, material) are numbered."""
        self._objects += 1
        thing: dict[str, Any] = {"metadata": {"version": 4.5, "type": "Object"}}
        inner: dict[str, Any] = {"uuid": f"object-{self._objects}", "type": kind, **properties}
        for field, plural in (("geometry", "geometries"), ("material", "materials")):
            if field in parts:
                inner[field] = f"{field}-{self._objects}"
                thing[plural] = [{"uuid": inner[field], **parts[field]}]
        self.items.append({"type": "set_object", "path": path, "object": {**thing, "object": inner}})

    def array(self, values: npt.NDArray[Any]) -> dict[str, Any]:
        """Store an array and return a reference, which the script of the page replaces by a typed array.

        Equal arrays, such as the times of several tracks, are stored once.
        """
        content = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"), copy=False).tobytes()
        kind = TYPED_ARRAYS[values.dtype.name]
        key = (kind, blake2b(content).digest())
        if key not in self._stored:
            self._blob.extend(b"\0" * (-len(self._blob) % 4))  # offsets of typed arrays are multiples of the item size
            self._stored[key] = {"$buffer": [kind, len(self._blob), values.size]}
            self._blob.extend(content)
        return self._stored[key]

    def base64(self) -> str:
        """The arrays in base64."""
        return b64encode(bytes(self._blob)).decode("ascii")

    def _attribute(self, rows: npt.NDArray[Any]) -> dict[str, Any]:
        return {"itemSize": 3, "type": TYPED_ARRAYS[rows.dtype.name], "array": self.array(rows), "normalized": False}


def transform_command(path: str, a_from_b: Array) -> dict[str, Any]:
    """The command that sets the pose of a node; three.js stores matrices by columns."""
    return {"type": "set_transform", "path": path, "matrix": [float(v) for v in a_from_b.T.ravel()]}
