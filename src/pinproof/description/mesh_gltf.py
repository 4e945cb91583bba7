"""glTF 2.0 files: JSON with buffers beside it, or GLB. Paragraphs of the standard are those of Khronos glTF 2.0.1."""

from __future__ import annotations

import base64
import json
import struct
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from pinproof.common.files import parse_json, read_bytes
from pinproof.description import mesh_reading
from pinproof.errors import MeshError

APPEARANCE = (
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "KHR_xmp",
    "EXT_lights_",
    "EXT_texture_",
    "MSFT_texture_",
)
"""The beginnings of the names of extensions that do not change where a surface is. Others are refused."""

OBJECTS = {
    "nodes": ("camera", "children", "matrix", "mesh", "rotation", "scale", "skin", "translation", "weights"),
    "meshes": ("primitives", "weights"),
    "primitives": ("attributes", "indices", "material", "mode", "targets"),
    "accessors": ("bufferView", "byteOffset", "componentType", "count", "max", "min", "normalized", "sparse", "type"),
    "bufferViews": ("buffer", "byteLength", "byteOffset", "byteStride", "target"),
    "buffers": ("byteLength", "uri"),
    "scenes": ("nodes",),
}
"""The keys of the objects that have geometry (5), besides ``name``, ``extensions``, ``extras``; others are refused."""

INDEX_TYPES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}

TRIANGLES = 4
MODES = {TRIANGLES: lambda corners: corners.reshape(-1, 3), 5: mesh_reading.strip, 6: mesh_reading.fan}
"""The triangles of each mode of a primitive with a surface (3.7.2.1)."""

NO_SURFACE = (0, 1, 2, 3)
"""Modes of points and lines."""

ROTATION = 1e-3
"""The length of a quaternion may differ from 1 by this, for rounding to single precision or few digits."""

MALFORMED = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError, struct.error)
"""What reading JSON of another structure raises."""


def read_gltf(data: bytes, path: Path, files: Mapping[str, bytes]) -> mesh_reading.Reading:
    """Read a GLB or glTF file with its ``files`` (:func:`external_files`); the scene that is shown, y up, in metres."""
    try:
        document, chunk = _document(data)
        return _Gltf(document, chunk, files).read(path)
    except MALFORMED as error:
        what = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else str(error)
        raise mesh_reading.refused(path, what) from error


def external_files(data: bytes, path: Path, largest: int) -> dict[str, bytes]:
    """The contents of the buffers beside a glTF file, by URI; MeshError for files outside of its folder."""
    files: dict[str, bytes] = {}
    try:
        document, _ = _document(data)
        names = [buffer["uri"] for buffer in document.get("buffers", []) if "uri" in buffer]
        for name in names:
            if not name.startswith("data:"):
                file = (path.parent / unquote(name)).resolve()
                if not file.is_relative_to(path.parent.resolve()):
                    raise ValueError(f"the buffer {name!r} is not in the folder of the file")
                files[name] = read_bytes(file, MeshError, largest=largest)
    except MALFORMED as error:
        raise mesh_reading.refused(path, str(error)) from error
    return files


def with_second_root(data: bytes) -> bytes:
    """The same file with an empty node beside the roots of each scene.

    coal ignores the transform of a scene's only root for the nodes below it; see ``coal/mesh_loader/assimp.cpp``.
    """
    document, _ = _document(data)
    document["nodes"].append({})
    for scene in document["scenes"]:
        scene.setdefault("nodes", []).append(len(document["nodes"]) - 1)
    text = json.dumps(document).encode()
    if data[:4] != b"glTF":
        return text
    text += b" " * (-len(text) % 4)
    rest = data[20 + int.from_bytes(data[12:16], "little") :]
    return b"glTF" + struct.pack("<III4s", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


def _document(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """The JSON of a file and the binary chunk of a GLB."""
    binary = None
    if data[:4] == b"glTF":
        version, length = struct.unpack_from("<II", data, 4)
        if version != 2 or length != len(data):
            raise ValueError(f"its header states version {version} and {length:,} bytes, but it has {len(data):,}")
        chunks, position = [], 12
        while position < length:
            size, kind = struct.unpack_from("<I4s", data, position)
            if position + 8 + size > length:
                raise ValueError(f"the file is truncated: a chunk announces {size:,} bytes")
            chunks.append((kind, data[position + 8 : position + 8 + size]))
            position += 8 + size
        if not chunks or chunks[0][0] != b"JSON" or any(kind in (b"JSON", b"BIN\0") for kind, _ in chunks[2:]):
            raise ValueError("its chunks are not JSON and BIN")
        data = chunks[0][1]
        binary = next((content for kind, content in chunks[1:] if kind == b"BIN\0"), None)

    document = parse_json(data.decode("utf-8"))
    if not isinstance(document, dict) or not str(document["asset"]["version"]).startswith("2."):
        raise ValueError("it is not glTF 2.0")
    return document, binary


class _Gltf:
    """The objects of a document by kind and index; ValueError for one that is missing, invalid or not supported."""

    def __init__(self, document: dict[str, Any], chunk: bytes | None, files: Mapping[str, bytes]) -> None:
        self.document, self.chunk, self.files = document, chunk, files
        self.arrays: dict[tuple[int, str], npt.NDArray[Any]] = {}
        self.contents: dict[int, bytes] = {}

    def read(self, path: Path) -> mesh_reading.Reading:
        for name in self.document.get("extensionsRequired", []):
            if not name.startswith(APPEARANCE):
                raise ValueError(f"it requires the extension {name}, which is not supported")
        if self.document["asset"].get("minVersion", "2.0") != "2.0":
            raise ValueError(f"it requires glTF {self.document['asset']['minVersion']}")
        parts = []
        for matrix, primitive, place in self.instances(path):
            points = self.accessor(primitive["attributes"]["POSITION"], "VEC3", {5126: "<f4"})
            corners = np.arange(len(points))
            if "indices" in primitive:
                corners = self.accessor(primitive["indices"], "SCALAR", INDEX_TYPES)[:, 0].astype(np.int64)
            if corners.max() >= len(points):
                raise ValueError(f"{place} has vertex indices outside the {len(points)} vertices")
            parts.append((matrix, points, MODES[primitive.get("mode", TRIANGLES)](corners)))
        return mesh_reading.Reading(*mesh_reading.placed(parts))

    def instances(self, path: Path) -> list[tuple[npt.NDArray[np.float64], dict[str, Any], str]]:
        """The primitives with a surface, each with its transform (3.5.3) and its name for messages."""
        instances: list[tuple[npt.NDArray[np.float64], dict[str, Any], str]] = []
        triangles = vertices = 0
        nodes, roots = [self.item("nodes", index) for index in range(len(self.document.get("nodes", [])))], self.roots()
        # Every node has one parent, or is a root of the scene: then none is reached twice.
        parents = Counter([*roots, *(child for node in nodes for child in node.get("children", []))])
        if shared := [index for index, count in parents.items() if count > 1]:
            raise ValueError(f"nodes[{shared[0]}] has several parents, or is also a root of the scene")
        seen: set[int] = set()
        placed_meshes: set[int] = set()
        stack = [(index, np.eye(4), 1) for index in roots]
        while stack:
            index, above, depth = stack.pop()
            node = self.item("nodes", index)
            if depth > mesh_reading.DEEPEST_NODE or len(seen) >= mesh_reading.MOST_NODES:
                most = f"{mesh_reading.MOST_NODES:,} nodes, {mesh_reading.DEEPEST_NODE} below each other"
                raise ValueError(f"the limit of its scene is {most}")
            seen.add(index)
            matrix = above @ _local(node, index)
            stack += [(child, matrix, depth + 1) for child in node.get("children", [])]
            if "mesh" not in node:
                continue
            if "skin" in node:
                raise ValueError(f"nodes[{index}] is deformed by a skin, which is not supported")
            mesh = self.item("meshes", node["mesh"])
            if any(node.get("weights", mesh.get("weights", []))):
                raise ValueError(f"nodes[{index}] is deformed by morph weights, which are not supported")
            placed_meshes.add(node["mesh"])
            if not mesh["primitives"]:
                raise ValueError(f"meshes[{node['mesh']}] has no primitives")
            for number, primitive in enumerate(mesh["primitives"]):
                place = f"meshes[{node['mesh']}].primitives[{number}]"
                _known(primitive, "primitives", place)
                mode = _whole(primitive, "mode", TRIANGLES)
                if mode in NO_SURFACE:
                    continue
                if mode not in MODES:
                    raise ValueError(f"{place} has the unknown mode {mode}")
                vertex_count = corner_count = _whole(
                    self.item("accessors", primitive["attributes"]["POSITION"]), "count"
                )
                if "indices" in primitive:
                    corner_count = _whole(self.item("accessors", primitive["indices"]), "count")
                if corner_count < 3 or (mode == TRIANGLES and corner_count % 3):
                    raise ValueError(f"{place} has {corner_count} corners, which make no triangles")
                triangles += corner_count // 3 if mode == TRIANGLES else corner_count - 2
                vertices += vertex_count
                mesh_reading.refuse_many(path, triangles, vertices)
                instances.append((matrix, primitive, place))
        hidden = [index for index, node in enumerate(nodes) if "mesh" in node and index not in seen]
        if hidden:
            raise ValueError(f"nodes[{hidden[0]}] has a mesh, but is not part of the scene that is shown")
        unplaced = set(range(len(self.document.get("meshes", [])))) - placed_meshes
        if unplaced:
            raise ValueError(f"meshes[{min(unplaced)}] is not placed by any node")
        return instances

    def roots(self) -> list[int]:
        """The roots of the scene that is shown: the stated or the only one."""
        scenes = self.document.get("scenes", [])
        if "scene" not in self.document and len(scenes) != 1:
            raise ValueError(f"it has {len(scenes)} scenes, and does not state which is shown")
        roots: list[int] = self.item("scenes", self.document.get("scene", 0)).get("nodes", [])
        return roots

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        objects = self.document.get(kind, [])
        if type(index) is not int or not 0 <= index < len(objects):
            raise ValueError(f"{kind}[{index}] does not exist")
        _known(objects[index], kind, f"{kind}[{index}]")
        value: dict[str, Any] = objects[index]
        return value

    def accessor(self, index: int, shape: str, types: Mapping[int, str]) -> npt.NDArray[Any]:
        """The elements (N, width) of an accessor (3.6.2), with its sparse substitutions (3.6.2.3)."""
        if (index, shape) in self.arrays:
            return self.arrays[index, shape]
        accessor, place = self.item("accessors", index), f"accessors[{index}]"
        if accessor["type"] != shape or accessor["componentType"] not in types or accessor.get("normalized"):
            kind = f"{accessor['type']} of component type {accessor['componentType']}"
            raise ValueError(f"{place} is {kind}; supported is {shape} of {', '.join(map(str, types))}")
        dtype, count = types[accessor["componentType"]], _whole(accessor, "count")
        width = 3 if shape == "VEC3" else 1
        sparse = accessor.get("sparse")
        # the elements; without a view they are zero, and a sparse accessor replaces some of them
        if "bufferView" in accessor:
            values = self.view(accessor, dtype, count, width)
        elif sparse is not None:
            values = np.zeros((count, width), dtype=dtype)
        else:
            raise ValueError(f"{place} has no data")
        if sparse is not None:
            number = _whole(sparse, "count")
            rows = self.view(sparse["indices"], INDEX_TYPES[sparse["indices"]["componentType"]], number, 1)[:, 0]
            if rows.max(initial=0) >= count:
                raise ValueError(f"{place} substitutes elements that do not exist")
            values[rows] = self.view(sparse["values"], dtype, number, width)
        # the stated bounds are a check of what was read
        for key, limit in ("min", np.min), ("max", np.max):
            if key in accessor and not np.allclose(limit(values, axis=0), accessor[key], rtol=1e-5, atol=1e-6):
                raise ValueError(f"{place} states another {key} than its elements have")
        self.arrays[index, shape] = values
        return values

    def view(self, source: dict[str, Any], dtype: str, count: int, width: int) -> npt.NDArray[Any]:
        """A copy of the elements that an accessor reads from a buffer view."""
        view, place = self.item("bufferViews", source["bufferView"]), f"bufferViews[{source['bufferView']}]"
        content = self.buffer(view["buffer"])
        start, length, offset = (
            _whole(view, "byteOffset", 0),
            _whole(view, "byteLength"),
            _whole(source, "byteOffset", 0),
        )
        size = np.dtype(dtype).itemsize
        stride = _whole(view, "byteStride", size * width)
        if (
            start + length > len(content)
            or stride < size * width
            or offset + (count - 1) * stride + size * width > length
        ):
            raise ValueError(f"{place} is too short for its {count:,} elements, or exceeds its buffer")
        return np.ndarray((count, width), dtype, content, start + offset, (stride, size)).copy()

    def buffer(self, index: int) -> bytes:
        if index in self.contents:
            return self.contents[index]
        buffer, place = self.item("buffers", index), f"buffers[{index}]"
        # the binary chunk, a data URI, or a file beside the document
        uri, length = buffer.get("uri"), _whole(buffer, "byteLength")
        if uri is None:
            if index != 0 or self.chunk is None:
                raise ValueError(f"{place} has no data")
            content = self.chunk
        elif uri.startswith("data:"):
            head, _, text = uri.partition(",")
            if not head.endswith(";base64"):
                raise ValueError(f"{place} is not encoded as base64")
            content = base64.b64decode(text, validate=True)
        else:
            content = self.files[uri]
        if len(content) < length:
            raise ValueError(f"{place} is truncated: it states {length:,} bytes, but has {len(content):,}")
        self.contents[index] = content[:length]
        return self.contents[index]


def _whole(value: dict[str, Any], key: str, default: int | None = None) -> int:
    number = value[key] if default is None else value.get(key, default)
    if type(number) is not int or not 0 <= number <= 2**40:
        raise ValueError(f"{key} is {number!r}; valid: a whole number")
    return number


def _known(value: dict[str, Any], kind: str, place: str) -> None:
    """Raise ValueError for a key or an extension that is not known."""
    for name in value:
        if name not in (*OBJECTS[kind], "name", "extensions", "extras"):
            raise ValueError(f"{place} has the unknown key {name!r}")
    for name in value.get("extensions", {}):
        if not name.startswith(APPEARANCE):
            raise ValueError(f"{place} uses the extension {name}, which is not supported")


def _local(node: dict[str, Any], index: int) -> npt.NDArray[np.float64]:
    """The transform of a node: a matrix, stored by columns, or translation, rotation (a quaternion) and scale."""
    parts = [name for name in ("translation", "rotation", "scale") if name in node]
    if "matrix" in node:
        matrix = np.array(node["matrix"], dtype=float).reshape(4, 4).T
        if parts or (matrix[3] != (0, 0, 0, 1)).any():
            raise ValueError(f"nodes[{index}] has a matrix that is not affine, or other transforms beside it")
        return matrix
    # the rotation matrix of the normalised quaternion, then scale and translation
    matrix = np.eye(4)
    x, y, z, w = map(float, node.get("rotation", (0, 0, 0, 1)))
    length = (x * x + y * y + z * z + w * w) ** 0.5
    if not abs(length - 1) <= ROTATION:
        raise ValueError(f"nodes[{index}] has a rotation of length {length:g}; a quaternion has length 1")
    x, y, z, w = x / length, y / length, z / length, w / length
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), dtype=float).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=float).reshape(3)
    return matrix
