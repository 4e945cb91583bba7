# ruff: noqa: E501  # documents as they are
"""Writers of mesh files that share no code with the readers: two boxes, in every format, with a change of their text.

``CASES`` lists files that other programs write, and what reading them must give: the two boxes, or a refusal.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

BOXES = np.array([[[0.1, -0.2, 0.3], [0.2, 0.2, 0.9]], [[0.4, 0.1, -0.5], [0.9, 0.3, -0.1]]])
"""Bounds of two boxes that are different in every direction."""

CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
QUADS = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
STRIP = np.array([0, 1, 4, 5, 7, 1, 3, 0, 2, 4, 6, 7, 2, 3])  # a cube as one triangle strip
FANS = np.array([[0, 2, 3, 1, 5, 4, 6, 2], [7, 6, 4, 5, 1, 3, 2, 6]])  # a cube as two triangle fans

Files = dict[str, bytes]


def corners(box: int) -> np.ndarray:
    low, high = BOXES[box]
    return low + CUBE * (high - low)


def triangles() -> np.ndarray:
    return QUADS[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def area() -> np.ndarray:
    """The area of each box."""
    x, y, z = (BOXES[:, 1] - BOXES[:, 0]).T
    return 2 * (x * y + y * z + z * x)


def words(values: Any) -> str:
    return " ".join(map(repr, np.asarray(values).ravel().tolist()))


# STL


def stl_binary() -> bytes:
    soup = np.concatenate([corners(box)[triangles()] for box in range(2)])
    rows = np.zeros(len(soup), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    rows["corners"] = soup
    return b"solid made by a program".ljust(80) + struct.pack("<I", len(rows)) + rows.tobytes()


def stl_text() -> str:
    lines = []
    for box in range(2):
        lines.append(f"solid box {box}")
        for corner in corners(box)[triangles()]:
            lines += ["facet normal 0 0 0", " outer loop", *(f"  vertex {words(point)}" for point in corner)]
            lines += [" endloop", "endfacet"]
        lines.append(f"endsolid box {box}")
    return "\n".join(lines) + "\n"


# OBJ


def obj(quads: bool = False, relative: bool = False) -> str:
    lines = ["# two boxes", "mtllib none.mtl"]
    for box in range(2):
        lines += [f"o box{box}", *(f"v {words(point)}" for point in corners(box))]
        for face in QUADS if quads else triangles():
            indices = face - 8 if relative else face + 8 * box + 1
            lines.append("f " + " ".join(map(str, indices)))
    return "\n".join(lines) + "\n"


def indented(text: str, every: int = 3) -> str:
    return "".join(
        f"  {line}" if number % every == 0 and line.startswith("f") else line
        for number, line in enumerate(text.splitlines(True))
    )


# PLY


def ply(
    kind: str = "ascii", length: str = "uchar", index: str = "int", coordinate: str = "float", extra: int = 0
) -> bytes:
    """``extra`` adds a scalar after the list of a face, and a vertex property before x."""
    codes = {
        "uchar": "B",
        "char": "b",
        "ushort": "H",
        "short": "h",
        "uint": "I",
        "int": "i",
        "float": "f",
        "double": "d",
    }
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    points = np.concatenate([corners(0), corners(1)])
    faces = [*(QUADS.tolist()), *((triangles() + 8).tolist())]
    head = ["ply", f"format {kind} 1.0", "comment two boxes", f"element vertex {len(points)}"]
    head += ["property uchar quality"] * extra + [f"property {coordinate} {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", f"property list {length} {index} vertex_indices"]
    head += ["property short flags"] * extra + ["end_header", ""]
    rows: list[list[tuple[str, Any]]] = []
    for point in points.tolist():
        rows.append([(codes["uchar"], 7)] * extra + [(codes[coordinate], value) for value in point])
    for face in faces:
        rows.append([(codes[length], len(face)), *((codes[index], i) for i in face)] + [("h", -3)] * extra)
    if not order:
        return ("\n".join(head) + "\n".join(" ".join(repr(v) for _, v in row) for row in rows) + "\n").encode()
    return "\n".join(head).encode() + b"".join(struct.pack(order + code, value) for row in rows for code, value in row)


# COLLADA

NAMESPACE = "http://www.collada.org/2005/11/COLLADASchema"


def dae(
    primitive: str = "triangles",
    unit: str = '<unit name="m" meter="1"/>',
    nodes: str = "",
    head: str = "",
    size: float = 1.0,
) -> str:
    """Each box is a geometry ``g0`` or ``g1``; ``nodes`` replaces the nodes of the scene; ``size`` is metres per unit."""
    geometries = ""
    for box in range(2):
        points = corners(box) / size
        pairs = "\n".join(f"{a} 0 {b} 0 {c} 0" for a, b, c in triangles())
        contents = {
            "triangles": f'<triangles count="12">INPUTS<p>{pairs}</p></triangles>',
            "polylist": f'<polylist count="6">INPUTS<vcount>{"4 " * 6}</vcount>'
            f"<p>{' '.join(f'{i} 0' for i in QUADS.ravel())}</p></polylist>",
            "polygons": '<polygons count="6">INPUTS'
            + "".join(f"<p>{' '.join(f'{i} 0' for i in quad)}</p>" for quad in QUADS)
            + "</polygons>",
            "tristrips": f'<tristrips count="1">INPUTS<p>{" ".join(f"{i} 0" for i in STRIP)}</p></tristrips>',
            "trifans": '<trifans count="2">INPUTS'
            + "".join(f"<p>{' '.join(f'{i} 0' for i in one)}</p>" for one in FANS)
            + "</trifans>",
        }
        inputs = f'<input semantic="VERTEX" source="#v{box}" offset="0"/><input semantic="NORMAL" source="#n{box}" offset="1"/>'
        geometries += f"""<geometry id="g{box}"><mesh>
<source id="p{box}"><float_array id="a{box}" count="24">{words(points)}</float_array><technique_common>
<accessor source="#a{box}" count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param
 name="Z" type="float"/></accessor></technique_common></source>
<source id="n{box}"><float_array id="m{box}" count="3">0 0 1</float_array><technique_common>
<accessor source="#m{box}" count="1" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param
 name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v{box}"><input semantic="POSITION" source="#p{box}"/></vertices>
{contents[primitive].replace("INPUTS", inputs)}</mesh></geometry>
"""
    nodes = nodes or "".join(f'<node id="n{i}"><instance_geometry url="#g{i}"/></node>\n' for i in range(2))
    return f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="{NAMESPACE}" version="1.4.1">{head}
<asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified>{unit}<up_axis>Z_UP</up_axis></asset>
<library_geometries>{geometries}</library_geometries>
<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""


# glTF: y is up, so that (x, y, z) of the robot's link is written as (x, z, -y).


def gltf(
    mode: int = 4, index: str = "<u2", change: Callable[[dict[str, Any], bytearray], None] | None = None
) -> tuple[dict[str, Any], bytes]:
    """The document and its buffer: bufferViews 2i and 2i + 1 hold the positions and the indices of box i."""
    blob, views, accessors, meshes = bytearray(), [], [], []
    for box in range(2):
        points = (corners(box) @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])).astype("<f4")
        primitives = []
        lists = {4: [triangles().ravel()], 5: [STRIP], 6: list(FANS)}[mode]
        accessors.append({"bufferView": len(views), "componentType": 5126, "count": 8, "type": "VEC3"})
        accessors[-1] |= {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        place = len(accessors) - 1
        for values in [points, *(np.asarray(one).astype(index) for one in lists)]:
            blob += b"\0" * (-len(blob) % 4)
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": values.nbytes})
            blob += values.tobytes()
            if values is not points:
                code = {"<u1": 5121, "<u2": 5123, "<u4": 5125}[index]
                accessors.append(
                    {"bufferView": len(views) - 1, "componentType": code, "count": len(values), "type": "SCALAR"}
                )
                primitives.append({"attributes": {"POSITION": place}, "indices": len(accessors) - 1, "mode": mode})
        meshes.append({"primitives": primitives})
    blob += b"\0" * (-len(blob) % 4)
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"mesh": 1}],
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
    }
    if change is not None:
        change(document, blob)
    return document, bytes(blob)


def glb(document: dict[str, Any], blob: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def with_data_uri(document: dict[str, Any], blob: bytes) -> bytes:
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    return json.dumps(document).encode()


def write_polygons(path: Path, points: np.ndarray, faces: list[list[int]]) -> None:
    """Write polygons as OBJ, PLY or DAE."""
    if path.suffix == ".obj":
        rows = [f"v {words(point)}" for point in points] + [f"f {words(np.array(face) + 1)}" for face in faces]
    elif path.suffix == ".ply":
        rows = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
        rows += [f"property double {axis}" for axis in "xyz"]
        rows += [f"element face {len(faces)}", "property list int int vertex_index", "end_header"]
        rows += [words(point) for point in points] + [words([len(face), *face]) for face in faces]
    else:
        indices = [index for face in faces for index in face]
        polygons = f'<polylist count="{len(faces)}"><input semantic="VERTEX" source="#v0" offset="0"/>'
        polygons += f"<vcount>{words([len(face) for face in faces])}</vcount><p>{words(indices)}</p></polylist>"
        text = dae(nodes='<node><instance_geometry url="#g0"/></node>')
        second = text.index('<geometry id="g1">')
        text = text[:second] + text[text.index("</library_geometries>") :]
        start, end = text.index("<triangles"), text.index("</triangles>") + len("</triangles>")
        text = text[:start] + polygons + text[end:]
        text = text.replace('count="24"', f'count="{points.size}"', 1).replace('count="8"', f'count="{len(points)}"', 1)
        rows = [text.replace(words(corners(0)), words(points))]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


BOTH, REFUSED = "both boxes", "refused"
EITHER = "both boxes, or refused"  # valid files that assimp 6.0 does not read, or not completely

Case = tuple[str, str, Files, str]
"""A name, the suffix of ``mesh.*``, the files in its folder, and what reading it must give."""


def _cases() -> Iterator[Case]:
    for name, suffix, content, expected in (*_stl_cases(), *_obj_cases(), *_ply_cases(), *_dae_cases()):
        yield name, suffix, {f"mesh.{suffix}": content if isinstance(content, bytes) else content.encode()}, expected
    yield from _gltf_cases()


Change = tuple[str, str, str | bytes, str]


def _stl_cases() -> Iterator[Change]:
    data, text = stl_binary(), stl_text()
    yield "binary", "stl", data, BOTH
    yield "binary, cut off", "stl", data[:-50], REFUSED
    yield "binary, fewer stated", "stl", data[:80] + struct.pack("<I", 12) + data[84:], REFUSED
    yield "binary, more stated", "stl", data[:80] + struct.pack("<I", 25) + data[84:], REFUSED
    yield "text", "stl", text, BOTH
    yield "text, CRLF", "stl", text.replace("\n", "\r\n"), BOTH
    yield "text, CR", "stl", text.replace("\n", "\r"), BOTH
    yield "text, tabs", "stl", text.replace(" ", "\t"), BOTH
    yield "text, capitals", "stl", text.upper(), EITHER
    yield "text, no names", "stl", text.replace(" box 0", "").replace(" box 1", ""), BOTH
    yield "text, indented", "stl", text.replace("\n", "\n   "), BOTH
    yield "text, cut off after a facet", "stl", text[: text.rindex("endsolid")], REFUSED
    yield "text, cut off in a number", "stl", text[: text.rindex("vertex") + 10], REFUSED
    yield "text, facet of four corners", "stl", text.replace(" endloop", "  vertex 0 0 0\n endloop", 1), REFUSED
    yield "text, facet misspelt", "stl", text.replace("endfacet\nfacet normal", "endfacet\nfacet normals", 1), REFUSED
    yield "text, a missing endsolid", "stl", text.replace("endsolid box 0\n", ""), REFUSED
    yield "text, facets outside", "stl", text.replace("solid box 1\n", "facet\nsolid box 1\n", 1), REFUSED
    yield "text, comma for point", "stl", text.replace("0.2 ", "0,2 "), REFUSED
    yield "text, underscore", "stl", text.replace("0.2 ", "0_2 "), REFUSED


def _obj_cases() -> Iterator[Change]:
    text, quads = obj(), obj(quads=True)
    yield "triangles", "obj", text, BOTH
    yield "quads", "obj", quads, BOTH
    yield "relative indices between vertex blocks", "obj", obj(relative=True), BOTH
    yield "relative quads", "obj", obj(quads=True, relative=True), BOTH
    yield "tabs in some faces", "obj", text.replace("f 1 3 4", "f\t1\t3\t4").replace("f 9 11 12", "f\t9 11\t12"), BOTH
    yield (
        "tabs in all faces",
        "obj",
        "".join(s.replace(" ", "\t") if s[0] == "f" else s for s in text.splitlines(True)),
        BOTH,
    )
    yield (
        "tabs in vertices",
        "obj",
        "".join(s.replace(" ", "\t") if s[0] == "v" else s for s in text.splitlines(True)),
        BOTH,
    )
    yield "some faces indented", "obj", indented(text), BOTH
    yield "all indented", "obj", text.replace("\n", "\n    "), BOTH
    yield "CRLF", "obj", text.replace("\n", "\r\n"), BOTH
    yield "CR", "obj", text.replace("\n", "\r"), REFUSED
    yield "continued lines", "obj", quads.replace("f 1 3 4 2", "f 1 3 \\\n4 2"), BOTH
    yield "comment that ends with a backslash", "obj", text.replace("# two boxes", "# C:\\boxes\\"), REFUSED
    yield "comments after numbers", "obj", text.replace("\nf ", " # comment\nf "), BOTH
    yield "normals and textures", "obj", _with_slashes(quads, "/1/1"), BOTH
    yield "normals", "obj", _with_slashes(quads, "//1"), BOTH
    yield "textures", "obj", _with_slashes(quads, "/1"), BOTH
    yield "lines and points", "obj", text + "l 1 2 3\np 1 2\n", BOTH
    yield "groups and materials", "obj", text.replace("o box1", "g a b\ns off\nusemtl b_1\no box1"), BOTH
    yield (
        "materials between faces",
        "obj",
        text.replace("f 9", "usemtl m\nf 9", 1).replace("f 2", "usemtl m\nf 2", 1),
        BOTH,
    )
    yield (
        "colours of vertices",
        "obj",
        "".join(s[:-1] + " 1 0 0\n" if s[0] == "v" else s for s in text.splitlines(True)),
        BOTH,
    )
    yield "weights 1", "obj", "".join(s[:-1] + " 1.0\n" if s[0] == "v" else s for s in text.splitlines(True)), BOTH
    yield "weights", "obj", "".join(s[:-1] + " 2.0\n" if s[0] == "v" else s for s in text.splitlines(True)), REFUSED
    yield "a free-form surface", "obj", text + "cstype bezier\ndeg 3 3\nsurf 0 1 0 1 1 2 3 4\nend\n", REFUSED
    yield "a call", "obj", text + "call other.obj\n", REFUSED
    yield "capital F", "obj", text.replace("f 1 ", "F 1 "), REFUSED
    yield "index 0", "obj", text + "f 0 1 2\n", REFUSED
    yield "index beyond", "obj", text + "f 1 2 17\n", REFUSED
    yield "index before", "obj", text + "f -17 -1 -2\n", REFUSED
    yield "two corners", "obj", text + "f 1 2\n", REFUSED
    yield "no coordinate z", "obj", text.replace("0.3\n", "\n", 1), REFUSED
    yield "spaces around slashes", "obj", text + "f 1 / 1 2 / 1 3 / 1\n", REFUSED


def _with_slashes(text: str, end: str) -> str:
    lines = text.splitlines(True)
    faces = [
        " ".join(word if word == "f" else word + end for word in line.split()) + "\n" if line[0] == "f" else line
        for line in lines
    ]
    return "vt 0 0\nvn 0 0 1\n" + "".join(faces)


def _ply_cases() -> Iterator[Change]:
    for kind in ("ascii", "binary_little_endian", "binary_big_endian"):
        for length, index, coordinate, extra in (
            *product(("uchar", "ushort"), ("int", "uchar"), ("float", "double"), (0,)),
            *[("uchar", "uint", "float", 1), ("int", "short", "double", 1), ("uint", "ushort", "float", 1)],
        ):
            data = ply(kind, length, index, coordinate, extra)
            yield f"{kind}, {length}, {index}, {coordinate}, {extra}", "ply", data, BOTH
        data = ply(kind)
        yield f"{kind}, cut off in the faces", "ply", data[:-40], REFUSED
        yield (
            f"{kind}, cut off after a face",
            "ply",
            data[: -len(b"3 9 13 12\n" if kind == "ascii" else bytes(13))],
            REFUSED,
        )
        yield f"{kind}, cut off in the header", "ply", data[:120], REFUSED
        yield f"{kind}, fewer faces stated", "ply", data.replace(b"element face 18", b"element face 17"), REFUSED
        yield f"{kind}, more faces stated", "ply", data.replace(b"element face 18", b"element face 19"), REFUSED
        yield f"{kind}, fewer vertices stated", "ply", data.replace(b"element vertex 16", b"element vertex 15"), REFUSED
        yield f"{kind}, a second list", "ply", data.replace(b"end_header", b"element face 0\nend_header"), REFUSED
        yield f"{kind}, other list", "ply", data.replace(b"vertex_indices", b"corners"), REFUSED
        yield f"{kind}, vertex_index", "ply", data.replace(b"vertex_indices", b"vertex_index"), BOTH
        yield f"{kind}, CRLF", "ply", _crlf(data, kind == "ascii"), BOTH
        yield f"{kind}, float indices", "ply", ply(kind, index="float"), EITHER
    text = ply().decode()
    yield "edges", "ply", text.replace("end_header", "element edge 1\nproperty int a\nend_header") + "3\n", BOTH
    yield "tristrips", "ply", _tristrips(), REFUSED
    yield (
        "tristrips beside faces",
        "ply",
        text.replace("end_header", "element tristrips 1\nproperty list int int vertex_indices\nend_header")
        + "3 0 1 2\n",
        REFUSED,
    )
    yield "faces before vertices", "ply", _faces_first(text), EITHER
    yield (
        "one line",
        "ply",
        text.partition("end_header\n")[0] + "end_header\n" + text.partition("end_header\n")[2].replace("\n", " "),
        EITHER,
    )
    yield (
        "blank lines",
        "ply",
        text.partition("end_header\n")[0] + "end_header\n" + text.partition("end_header\n")[2].replace("\n", "\n\n"),
        EITHER,
    )
    yield "y missing", "ply", text.replace("property float y", "property float w"), REFUSED
    yield "a word", "ply", text.replace("0.3", "O.3", 1), REFUSED
    yield "two corners", "ply", text.replace("element face 18", "element face 19") + "2 0 1\n", REFUSED
    yield "a negative index", "ply", text.replace("element face 18", "element face 19") + "3 0 1 -1\n", REFUSED
    yield "unknown type", "ply", text.replace("property float z", "property half z"), REFUSED
    yield "version 2", "ply", text.replace("ascii 1.0", "ascii 2.0"), REFUSED


def _crlf(data: bytes, everywhere: bool) -> bytes:
    head, mark, body = data.partition(b"end_header\n")
    head = (head + mark).replace(b"\n", b"\r\n")
    return head + (body.replace(b"\n", b"\r\n") if everywhere else body)


def _tristrips() -> str:
    points = np.concatenate([corners(0), corners(1)])
    head = "ply\nformat ascii 1.0\nelement vertex 16\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    rows = [words(point) for point in points] + [words([29, *STRIP, -1, *(STRIP + 8)])]
    return head + "\n".join(rows) + "\n"


def _faces_first(text: str) -> str:
    head, _, body = text.partition("end_header\n")
    first, _, face = head.partition("element face")
    start, _, vertex = first.partition("element vertex")
    lines = body.splitlines(True)
    return start + "element face" + face + "element vertex" + vertex + "end_header\n" + "".join(lines[16:] + lines[:16])


def _dae_cases() -> Iterator[Change]:
    for primitive in ("triangles", "polylist", "polygons", "tristrips", "trifans"):
        yield primitive, "dae", dae(primitive), EITHER if primitive == "trifans" else BOTH
        yield (
            f"{primitive}, more stated",
            "dae",
            dae(primitive).replace(f'<{primitive} count="', f'<{primitive} count="9', 1),
            REFUSED,
        )
    yield "triangles, fewer stated", "dae", dae().replace('<triangles count="12"', '<triangles count="11"'), REFUSED
    text, milli = dae(), '<unit name="mm" meter="0.001"/>'
    both = "".join(f'<instance_geometry url="#g{i}"/>' for i in range(2))
    yield "millimetres", "dae", dae(unit=milli, size=0.001), BOTH
    yield "inches", "dae", dae(unit='<unit meter="0.0254" name="inch"/>', size=0.0254), BOTH
    yield "a misspelt unit", "dae", dae(unit='<units meter="0.001"/>', size=0.001), REFUSED
    yield "a misspelt meter", "dae", dae(unit='<unit metre="0.001"/>', size=0.001), REFUSED
    yield "a misspelt asset", "dae", dae(unit=milli, size=0.001).replace("asset>", "assets>"), REFUSED
    yield "a geometry that is not placed", "dae", dae(nodes='<node><instance_geometry url="#g0"/></node>'), REFUSED
    yield "no unit", "dae", dae(unit=""), BOTH
    yield "a comment with another unit", "dae", dae(head=f"<!-- {milli} -->"), BOTH
    yield "a comment with the old unit", "dae", dae(unit=milli, size=0.001, head='<!-- <unit meter="1"/> -->'), BOTH
    yield "a unit after 100 kB", "dae", dae(unit=milli, size=0.001, head="<!--" + " x" * 60_000 + "-->"), BOTH
    yield "a unit with a namespace", "dae", _prefixed(dae(unit=milli, size=0.001)), EITHER
    yield "no namespace", "dae", text.replace(f' xmlns="{NAMESPACE}"', ""), BOTH
    yield "version 1.5", "dae", text.replace(NAMESPACE, "http://www.collada.org/2008/03/COLLADASchema"), BOTH
    yield (
        "another unit in a part",
        "dae",
        text.replace('<geometry id="g1">', f'<geometry id="g1"><asset>{milli}</asset>'),
        REFUSED,
    )
    yield "a unit with comma", "dae", dae(unit='<unit meter="0,001"/>', size=0.001), REFUSED
    yield "comments in numbers", "dae", text.replace(" 0.3", " <!-- 1 2 --> 0.3"), EITHER
    yield "an element in numbers", "dae", text.replace("<p>", "<p>0 0<x/>", 1), REFUSED
    yield "CDATA", "dae", text.replace("<p>0 0", "<p><![CDATA[0 0]]>"), EITHER
    yield (
        "a polygon with a hole",
        "dae",
        dae("polygons").replace("</polygons>", "<ph><p>0 0 1 0 2 0 3 0</p><h>0 0 1 0 2 0</h></ph></polygons>", 1),
        REFUSED,
    )
    yield (
        "all polygons with holes",
        "dae",
        dae("polygons").replace("<p>", "<ph><p>").replace("</p>", "</p></ph>"),
        REFUSED,
    )
    yield "an element in polygons", "dae", dae("polygons").replace("<p>0 0 ", "<p><x/>0 0 ", 1), REFUSED
    yield (
        "lines beside",
        "dae",
        text.replace(
            "</mesh>", '<lines count="1"><input semantic="VERTEX" source="#v0" offset="0"/><p>0 1</p></lines></mesh>', 1
        ),
        BOTH,
    )
    controller = '<library_controllers><controller id="c"><skin source="#g1"/></controller></library_controllers><library_visual_scenes>'
    yield (
        "a controller",
        "dae",
        dae(nodes='<node><instance_geometry url="#g0"/></node><node><instance_controller url="#c"/></node>').replace(
            "<library_visual_scenes>", controller
        ),
        REFUSED,
    )
    yield "one node", "dae", dae(nodes=f"<node>{both}</node>"), BOTH
    yield (
        "nodes in nodes",
        "dae",
        dae(
            nodes='<node><node><node><instance_geometry url="#g0"/></node></node><instance_geometry url="#g1"/></node>'
        ),
        BOTH,
    )
    library = "<library_nodes>{}</library_nodes><library_visual_scenes>"
    instance = '<node><instance_node url="#{}"/></node>'
    yield (
        "instance_node",
        "dae",
        dae(nodes=instance.format("k")).replace(
            "<library_visual_scenes>", library.format(f'<node id="k">{both}</node>')
        ),
        BOTH,
    )
    nested = '<node id="k"><instance_geometry url="#g0"/><instance_node url="#l"/></node><node id="l"><instance_geometry url="#g1"/></node>'
    yield (
        "nested instance_node",
        "dae",
        dae(nodes=instance.format("k")).replace("<library_visual_scenes>", library.format(nested)),
        BOTH,
    )
    circle = nested.replace('<node id="l">', '<node id="l"><instance_node url="#k"/>')
    yield (
        "circular instance_node",
        "dae",
        dae(nodes=instance.format("k")).replace("<library_visual_scenes>", library.format(circle)),
        REFUSED,
    )
    yield "instance of a missing node", "dae", dae(nodes=f"<node>{both}</node>" + instance.format("k")), REFUSED
    yield "a geometry of another file", "dae", text.replace('url="#g1"', 'url="other.dae#g1"'), REFUSED
    yield "a missing geometry", "dae", text.replace('url="#g1"', 'url="#g2"'), REFUSED
    yield "two geometries of one name", "dae", text.replace('<geometry id="g1">', '<geometry id="g0">'), REFUSED
    moved = '<node id="n1"><translate>1 2 3</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale>{}<instance_geometry url="#g1"/></node>'
    back = "<scale>0.5 0.5 0.5</scale><rotate>0 0 1 -90</rotate><translate>-1 -2 -3</translate>"
    first = '<node id="n0"><instance_geometry url="#g0"/></node>'
    yield "transforms that cancel", "dae", dae(nodes=first + moved.format(back)), BOTH
    yield (
        "transforms that cancel in nodes",
        "dae",
        dae(
            nodes=f'{first}<node><matrix>0 -2 0 1 2 0 0 2 0 0 2 3 0 0 0 1</matrix><node>{back}<instance_geometry url="#g1"/></node></node>'
        ),
        BOTH,
    )
    yield (
        "a mirror twice",
        "dae",
        dae(
            nodes=f'{first}<node><scale>-1 1 1</scale><node><scale>-1 1 1</scale><instance_geometry url="#g1"/></node></node>'
        ),
        BOTH,
    )
    yield (
        "a projective matrix",
        "dae",
        dae(
            nodes=f'{first}<node><matrix>{words(np.eye(4).ravel()[:-1])} 2</matrix><instance_geometry url="#g1"/></node>'
        ),
        REFUSED,
    )
    yield (
        "lookat",
        "dae",
        dae(nodes=f'{first}<node><lookat>0 0 1 0 0 0 0 1 0</lookat><instance_geometry url="#g1"/></node>'),
        REFUSED,
    )
    yield (
        "skew",
        "dae",
        dae(nodes=f'{first}<node><skew>30 1 0 0 0 1 0</skew><node><instance_geometry url="#g1"/></node></node>'),
        REFUSED,
    )
    camera = '<node><lookat>0 0 1 0 0 0 0 1 0</lookat><instance_camera url="#camera"/></node>'
    yield "a camera with lookat", "dae", dae(nodes=f"<node>{both}</node>{camera}"), BOTH
    second = f'</visual_scene><visual_scene id="t"><node>{both}</node></visual_scene>'
    yield "two scenes with geometry", "dae", text.replace("</visual_scene>", second), REFUSED
    yield (
        "a second, empty scene",
        "dae",
        text.replace("</visual_scene>", '</visual_scene><visual_scene id="t"><node/></visual_scene>'),
        BOTH,
    )
    yield "no scene shown", "dae", text.replace('<instance_visual_scene url="#s"/>', ""), REFUSED
    yield "two scenes shown", "dae", text.replace("<scene>", '<scene><instance_visual_scene url="#s"/>'), REFUSED
    yield "an unknown primitive", "dae", text.replace("triangles", "patches"), REFUSED
    yield "splines", "dae", text.replace("<mesh>", "<spline>", 1).replace("</mesh>", "</spline>", 1), REFUSED
    yield (
        "a convex mesh",
        "dae",
        text.replace("<mesh>", "<convex_mesh>", 1).replace("</mesh>", "</convex_mesh>", 1),
        REFUSED,
    )
    yield "an index beyond", "dae", text.replace("<p>0 0", "<p>8 0", 1), REFUSED
    yield "too few numbers", "dae", text.replace(words(corners(1)), words(corners(1)).rpartition(" ")[0]), REFUSED
    yield (
        "more numbers read than there are",
        "dae",
        text.replace('count="8" stride="3"', 'count="9" stride="3"'),
        REFUSED,
    )
    yield "a parameter to skip", "dae", _with_fourth_value(), BOTH
    yield (
        "columns in another order",
        "dae",
        text.replace('name="X"', 'name="Q"').replace('name="Y"', 'name="X"').replace('name="Q"', 'name="Y"'),
        REFUSED,
    )
    yield "cut off", "dae", text[: len(text) // 2], REFUSED


def _prefixed(text: str) -> str:
    import re

    return re.sub(r"<(/?)([A-Za-z])", r"<\1c:\2", text).replace("xmlns=", "xmlns:c=")


def _with_fourth_value() -> str:
    text = dae()
    for box in range(2):
        four = np.concatenate([corners(box), np.full((8, 1), 9.0)], axis=1)
        text = text.replace(words(corners(box)), words(four))
    skipped = '<param type="float"/></accessor></technique_common></source>\n<source id="n'
    text = text.replace('count="24"', 'count="32"').replace('count="8" stride="3"', 'count="8" stride="4"')
    return text.replace('</accessor></technique_common></source>\n<source id="n', skipped)


def _gltf_cases() -> Iterator[Case]:
    for mode, index in product((4, 5, 6), ("<u1", "<u2", "<u4")):
        yield f"mode {mode}, {index}", "glb", {"mesh.glb": glb(*gltf(mode, index))}, BOTH
    yield "buffer in the file", "gltf", {"mesh.gltf": with_data_uri(*gltf())}, BOTH
    document, blob = gltf()
    document["buffers"][0]["uri"] = "my%20data.bin"
    main = json.dumps(document).encode()
    yield "buffer beside the file", "gltf", {"mesh.gltf": main, "my data.bin": blob}, BOTH
    yield "buffer beside the file, cut off", "gltf", {"mesh.gltf": main, "my data.bin": blob[:-4]}, REFUSED
    yield "buffer missing", "gltf", {"mesh.gltf": main}, REFUSED
    data = glb(*gltf())
    yield "cut off", "glb", {"mesh.glb": data[:-8]}, REFUSED
    yield (
        "cut off, length corrected",
        "glb",
        {"mesh.glb": data[:8] + struct.pack("<I", len(data) - 8) + data[12:-8]},
        REFUSED,
    )
    yield "more than stated", "glb", {"mesh.glb": data + bytes(4)}, REFUSED
    yield "version 1", "glb", {"mesh.glb": data[:4] + struct.pack("<I", 1) + data[8:]}, REFUSED
    for name, change, expected in _gltf_changes():
        yield name, "glb", {"mesh.glb": glb(*gltf(change=change))}, expected


def _gltf_changes() -> Iterator[tuple[str, Callable[[dict[str, Any], bytearray], None], str]]:
    def put(path: str, value: Any) -> Callable[[dict[str, Any], bytearray], None]:
        """Set ``document[a][1]...`` for the path ``a.1...``."""

        def change(document: dict[str, Any], _blob: bytearray) -> None:
            *above, last = [int(word) if word.isdigit() else word for word in path.split(".")]
            target: Any = document
            for word in above:
                target = target[word]
            target[last] = value

        return change

    def several(*changes: Callable[[dict[str, Any], bytearray], None]) -> Callable[[dict[str, Any], bytearray], None]:
        def change(document: dict[str, Any], blob: bytearray) -> None:
            for one in changes:
                one(document, blob)

        return change

    def sparse(kept: bool) -> Callable[[dict[str, Any], bytearray], None]:
        """All positions of box 1 come from sparse values; without ``kept`` there is no buffer view below them."""

        def change(document: dict[str, Any], blob: bytearray) -> None:
            accessor = document["accessors"][2]
            view = document["bufferViews"][accessor["bufferView"]]
            start = view["byteOffset"]
            points = blob[start : start + view["byteLength"]]
            blob[start : start + view["byteLength"]] = bytes(view["byteLength"])
            views = document["bufferViews"]
            for content in (bytes(range(8)), bytes(points)):
                views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(content)})
                blob += content
            document["buffers"][0]["byteLength"] = len(blob)
            indices = {"bufferView": len(views) - 2, "componentType": 5121}
            accessor["sparse"] = {"count": 8, "indices": indices, "values": {"bufferView": len(views) - 1}}
            if not kept:
                del accessor["bufferView"]

        return change

    def interleaved(document: dict[str, Any], blob: bytearray) -> None:
        view = document["bufferViews"][0]
        points = np.frombuffer(bytes(blob[: view["byteLength"]]), dtype="<f4").reshape(-1, 3)
        wide = np.concatenate([np.full((8, 1), 5, "<f4"), points, np.full((8, 1), 6, "<f4")], axis=1).astype("<f4")
        document["bufferViews"][0] = {"buffer": 0, "byteOffset": len(blob), "byteLength": wide.nbytes, "byteStride": 20}
        document["accessors"][0]["byteOffset"] = 4
        blob += wide.tobytes()
        document["buffers"][0]["byteLength"] = len(blob)

    half = 0.5**0.5
    moved = {"mesh": 1, "translation": [1, 2, 3], "rotation": [0, half, 0, half], "scale": [2, 2, 2]}
    # the inverse of that transform, stored by columns
    inverse = [0, 0, 0.5, 0, 0, 0.5, 0, 0, -0.5, 0, 0, 0, 1.5, -1, -0.5, 1]
    yield "sparse positions", sparse(True), BOTH
    yield "sparse positions on zeros", sparse(False), BOTH
    yield "interleaved", interleaved, BOTH
    yield "no scene stated, one there", lambda document, _: document.pop("scene"), BOTH
    yield "no scenes", several(lambda d, _: d.pop("scene"), lambda d, _: d.pop("scenes")), REFUSED
    yield "two scenes", put("scenes", [{"nodes": [0]}, {"nodes": [1]}]), REFUSED
    yield "a node outside of the scene", put("scenes.0.nodes", [0]), REFUSED
    yield (
        "a node with two parents",
        put("nodes", [{"mesh": 0, "children": [2]}, {"children": [2]}, {"mesh": 1}]),
        REFUSED,
    )
    yield (
        "a root that is a child",
        put("nodes", [{"mesh": 0, "children": [1], "scale": [2, 2, 2]}, {"mesh": 1}]),
        REFUSED,
    )
    yield (
        "a circle of nodes",
        several(put("nodes", [{"mesh": 0, "children": [1]}, {"mesh": 1, "children": [0]}]), put("scenes.0.nodes", [])),
        REFUSED,
    )
    yield (
        "a single root with a transform",
        several(
            put(
                "nodes",
                [
                    {"children": [1, 2], "translation": [1, 2, 3]},
                    {"mesh": 0, "translation": [-1, -2, -3]},
                    {"mesh": 1, "translation": [-1, -2, -3]},
                ],
            ),
            put("scenes.0.nodes", [0]),
        ),
        BOTH,
    )
    yield (
        "transforms that cancel",
        several(
            put("nodes", [{"mesh": 0}, moved | {"children": [2]}, {"mesh": 1, "matrix": inverse}]),
            lambda d, _: d["nodes"][1].pop("mesh"),
        ),
        BOTH,
    )
    yield (
        "a matrix beside a scale",
        put("nodes.1", {"mesh": 1, "matrix": np.eye(4).ravel().tolist(), "scale": [2, 2, 2]}),
        REFUSED,
    )
    yield "a quaternion of length 2", put("nodes.1.rotation", [0, 0, 0, 2]), REFUSED
    yield "a skin", several(put("nodes.1.skin", 0), put("skins", [{"joints": [0]}])), REFUSED
    targets = put("meshes.1.primitives.0.targets", [{"POSITION": 0}])
    yield "morph weights of the mesh", several(targets, put("meshes.1.weights", [1])), REFUSED
    yield "morph weights of the node", several(targets, put("nodes.1.weights", [0.5])), REFUSED
    yield "morph weights 0", several(targets, put("meshes.1.weights", [0])), BOTH
    yield "lines beside", put("meshes.0.primitives.0.mode", 1), "one box"
    yield "mode 7", put("meshes.0.primitives.0.mode", 7), REFUSED
    yield (
        "instancing",
        several(
            put("extensionsRequired", ["EXT_mesh_gpu_instancing"]),
            put("nodes.1.extensions", {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}),
        ),
        REFUSED,
    )
    yield (
        "instancing, not required",
        put("nodes.1.extensions", {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}),
        REFUSED,
    )
    yield (
        "quantization",
        several(put("extensionsRequired", ["KHR_mesh_quantization"]), put("accessors.0.componentType", 5122)),
        REFUSED,
    )
    yield "quantization, not required", put("accessors.0.componentType", 5122), REFUSED
    draco = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    yield "Draco", put("meshes.0.primitives.0.extensions", draco), REFUSED
    yield "meshopt", put("bufferViews.0.extensions", {"EXT_meshopt_compression": {"buffer": 0}}), REFUSED
    yield (
        "materials by extension",
        several(put("extensionsRequired", ["KHR_materials_unlit"]), put("extensionsUsed", ["KHR_materials_unlit"])),
        BOTH,
    )
    yield "lights by extension", put("nodes.0.extensions", {"KHR_lights_punctual": {"light": 0}}), BOTH
    yield "glTF 3", put("asset", {"version": "3.0"}), REFUSED
    yield "glTF 2.1 required", put("asset", {"version": "2.1", "minVersion": "2.1"}), REFUSED
    yield "indices of a wrong type", put("accessors.1.componentType", 5122), REFUSED
    yield "indices beyond", lambda document, blob: blob.__setitem__(slice(96, 98), b"\x08\x00"), REFUSED
    yield "35 indices", put("accessors.1.count", 35), REFUSED
    yield "more elements than the view", put("accessors.0.count", 9), REFUSED
    yield "a view beyond the buffer", put("bufferViews.0.byteLength", 10**6), REFUSED
    yield "a buffer beyond the file", put("buffers.0.byteLength", 10**6), REFUSED
    yield "an accessor without data", lambda document, _: document["accessors"][0].pop("bufferView"), REFUSED
    yield "a missing mesh", put("nodes.1.mesh", 5), REFUSED
    yield "a negative index", put("nodes.1.mesh", -1), REFUSED
    yield "a number as list", put("nodes", 3), REFUSED


CASES = list(_cases())
