"""Every mesh file is read completely or refused: nothing is lost, scaled or moved without an error."""

from __future__ import annotations

import json
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.description import mesh_reading as reading
from pinproof.description import meshes
from pinproof.description.meshes import READERS, TriangleMesh, read_mesh
from pinproof.viewer.surfaces import obstacle_surfaces

from .mesh_files import (
    BOTH,
    BOXES,
    CASES,
    EITHER,
    REFUSED,
    area,
    dae,
    glb,
    gltf,
    ply,
    stl_binary,
    stl_text,
    with_data_uri,
    write_polygons,
)


def boxes_of(mesh: TriangleMesh) -> list[int]:
    """The boxes that a mesh consists of: all its triangles are in one, and have its area, volume and bounds."""
    corners = mesh.vertices[mesh.triangles]
    found = []
    taken = np.zeros(len(corners), dtype=bool)
    for box, (low, high) in enumerate(BOXES):
        inside = ((corners > low - 1e-6) & (corners < high + 1e-6)).all(axis=(1, 2))
        taken |= inside
        if inside.any():
            a, b, c = corners[inside].transpose(1, 0, 2)
            np.testing.assert_allclose(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2, area()[box], rtol=1e-5)
            np.testing.assert_allclose(np.einsum("ij,ij->", a, np.cross(b, c)) / 6, np.prod(high - low), rtol=1e-5)
            np.testing.assert_allclose(corners[inside].min(axis=(0, 1)), low, atol=1e-6)
            np.testing.assert_allclose(corners[inside].max(axis=(0, 1)), high, atol=1e-6)
            assert inside.sum() == 12
            found.append(box)
    assert taken.all()
    return found


@pytest.mark.parametrize(
    ("suffix", "files", "expected"), [pytest.param(*case[1:], id=f"{case[1]} {case[0]}") for case in CASES]
)
def test_two_boxes_are_read_or_refused(tmp_path, suffix, files, expected):
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    path = tmp_path / f"mesh.{suffix}"
    try:
        boxes: object = boxes_of(read_mesh(path))
    except pp.errors.MeshError as error:
        assert Path(error.path).parent == tmp_path  # noqa: PT017  # some cases are read, others refused
        boxes = REFUSED
    assert boxes in {BOTH: [[0, 1]], "one box": [[1]], REFUSED: [REFUSED], EITHER: [[0, 1], REFUSED]}[expected]


@pytest.mark.parametrize(
    ("suffix", "files"), [pytest.param(*case[1:3], id=f"{case[1]} {case[0]}") for case in CASES if case[3] == BOTH]
)
def test_what_is_drawn_is_what_is_read(tmp_path, suffix, files):
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    surfaces = obstacle_surfaces(pp.Obstacle("boxes", pp.Mesh(tmp_path / f"mesh.{suffix}", hull=False)))
    corners = np.concatenate([surface.vertices[surface.triangles] for surface in surfaces])
    assert boxes_of(TriangleMesh(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3))) == [0, 1]


def read_or_refused(path: Path, content: bytes) -> object:
    path.write_bytes(content)
    try:
        return boxes_of(read_mesh(path))
    except pp.errors.MeshError:
        return REFUSED


COUNTED = {
    "stl": [stl_binary(), stl_text().encode()],
    "ply": [ply(kind) for kind in ("ascii", "binary_little_endian", "binary_big_endian")],
    "dae": [dae().encode(), dae("polylist").encode()],
    "glb": [glb(*gltf())],
    "gltf": [with_data_uri(*gltf())],
}
"""Files of the formats that state how much they hold."""

counted = pytest.mark.parametrize(
    ("suffix", "content"), [(suffix, content) for suffix, files in COUNTED.items() for content in files]
)


@counted
def test_a_file_cut_off_anywhere_is_refused(tmp_path, suffix, content):
    path = tmp_path / f"mesh.{suffix}"
    assert read_or_refused(path, content) == [0, 1]
    whole = len(content) - len(b"\n") if content.endswith(b"\n") else len(content)
    if content.startswith(b"solid box"):
        whole -= len(b" box 1")  # a name that nobody needs
    for end in [*range(0, whole, 17), *range(whole - 40, whole)]:
        assert read_or_refused(path, content[:end]) == REFUSED, end


@counted
def test_a_number_or_bytes_lost_or_added_anywhere_are_refused(tmp_path, suffix, content):
    path = tmp_path / f"mesh.{suffix}"
    if suffix in ("glb", "gltf") or b"\0" in content:
        for start in range(0, len(content), 29):
            for changed in (content[:start] + content[start + 3 :], content[:start] + b"\7" + content[start:]):
                assert read_or_refused(path, changed) in (REFUSED, [0, 1]), start
        return
    spans = [match.span() for match in re.finditer(rb"(?<=[\s>])-?[0-9][-+.e0-9]*(?=[\s<])", content)]
    start = content.rindex(b"end_header") if suffix == "ply" else 0
    for first, last in [span for span in spans if span[0] > start][::5]:
        for changed in (b"", content[first:last] + b" " + content[first:last], b"x"):
            text = content[:first] + changed + content[last:]
            assert read_or_refused(path, text) in (REFUSED, [0, 1]), content[first - 20 : last + 20]


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "dae", "glb"])
def test_more_triangles_than_the_limit_are_refused(tmp_path, suffix, monkeypatch):
    name, _, files, _ = next(case for case in CASES if case[1] == suffix)
    path = tmp_path / f"mesh.{suffix}"
    path.write_bytes(files[path.name])
    monkeypatch.setattr(reading, "MOST_TRIANGLES", 24)
    assert len(read_mesh(path).triangles) == 24, name
    monkeypatch.setattr(reading, "MOST_TRIANGLES", 23)
    monkeypatch.setenv("PINPROOF_CACHE", "off")
    with pytest.raises(pp.errors.MeshError, match="the limit is 23"):
        read_mesh(path)


@pytest.mark.parametrize("content", ['<instance_geometry url="#g0"/>', ""])
def test_nested_instances_are_refused_before_they_are_expanded(tmp_path, content):
    # 30 nodes, each with two instances of the next: 2^30 boxes
    levels = [f'<node id="l{i}">' + f'<instance_node url="#l{i + 1}"/>' * 2 + "</node>" for i in range(30)]
    last = f'<node id="l30">{content}</node>'
    library = f"<library_nodes>{''.join(levels)}{last}</library_nodes><library_visual_scenes>"
    text = dae(nodes='<node><instance_geometry url="#g1"/><instance_node url="#l0"/></node>')
    (tmp_path / "mesh.dae").write_text(text.replace("<library_visual_scenes>", library))
    tracemalloc.start()
    with pytest.raises(pp.errors.MeshError, match="10,000 nodes"):
        read_mesh(tmp_path / "mesh.dae")
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


@pytest.mark.parametrize("depth", [99, 102, 20_000])
@pytest.mark.parametrize("suffix", ["dae", "gltf"])
def test_nodes_too_deep_for_recursive_programs_are_refused(tmp_path, depth, suffix):
    path = tmp_path / f"mesh.{suffix}"
    if suffix == "dae":
        levels = [f'<node id="l{i}"><instance_node url="#l{i + 1}"/></node>' for i in range(depth - 1)]
        last = f'<node id="l{depth - 1}"><instance_geometry url="#g0"/></node>'
        library = f"<library_nodes>{''.join(levels)}{last}</library_nodes><library_visual_scenes>"
        text = dae(nodes='<node><instance_geometry url="#g1"/></node><instance_node url="#l0"/>')
        path.write_text(text.replace("<library_visual_scenes>", library))
    else:
        document, blob = gltf()
        document["nodes"] = [{"mesh": 0}, *({"children": [i + 2]} for i in range(depth - 1)), {"mesh": 1}]
        path.write_bytes(with_data_uri(document, blob))
    if depth < 100:
        assert boxes_of(read_mesh(path)) == [0, 1]
    else:
        with pytest.raises(pp.errors.MeshError, match="100 below each other"):
            read_mesh(path)


L_SHAPE = [[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]]
STAR = [[np.cos(a) * r, np.sin(a) * r] for a, r in zip(np.arange(14) * np.pi / 7, [1, 0.3] * 7, strict=True)]
KEYHOLE = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]]
CHEVRON = [[0, 0], [2, 1], [0, 2], [0.5, 1]]


@pytest.mark.parametrize(
    "outline", [L_SHAPE, STAR, KEYHOLE, CHEVRON], ids=["L", "star", "square with a hole", "chevron"]
)
@pytest.mark.parametrize("first", [0, 1, 3])
@pytest.mark.parametrize("turned", [0, 1, 2, 3])
@pytest.mark.parametrize("suffix", ["obj", "ply", "dae"])
def test_polygons_that_are_not_convex_are_filled_exactly(tmp_path, outline, first, turned, suffix):
    flat = np.roll(np.array(outline, dtype=float), first, axis=0)
    n = len(flat)
    x, y = flat.T
    area = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    points = np.concatenate([np.c_[flat, np.zeros(n)], np.c_[flat, np.ones(n)]])
    turn = pp.pose(rpy=[(0, 0, 0), (np.pi / 2, 0, 0), (0, np.pi / 2, 0), (1.0, 2.0, 3.0)][turned]).rotation
    faces = [list(range(n))[::-1], list(range(n, 2 * n))]
    faces += [[i, (i + 1) % n, (i + 1) % n + n, i + n] for i in range(n)]
    path = tmp_path / f"mesh.{suffix}"
    write_polygons(path, points @ turn.T, faces)
    mesh = read_mesh(path)
    corners = mesh.vertices[mesh.triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    around = np.linalg.norm(np.roll(flat, -1, axis=0) - flat, axis=1).sum()
    assert len(corners) == sum(len(face) - 2 for face in faces)
    np.testing.assert_allclose(np.linalg.norm(cross, axis=1).sum(), 2 * area + around)
    np.testing.assert_allclose(np.einsum("ij,ij->", corners[:, 0], cross) / 3, area)


def test_a_polygon_with_too_many_corners_is_refused(tmp_path):
    angles = np.arange(2002) * np.pi / 1001
    points = np.c_[np.cos(angles), np.sin(angles), np.zeros(2002)] * np.where(np.arange(2002) % 2, 1, 0.5)[:, None]
    write_polygons(tmp_path / "mesh.obj", points, [list(range(2002))])
    with pytest.raises(pp.errors.MeshError, match="the limit is 2,000"):
        read_mesh(tmp_path / "mesh.obj")


def lost(mesh: reading.Reading) -> reading.Reading:
    return reading.Reading(mesh.vertices, mesh.triangles[:-1], mesh.unit)


def scaled(mesh: reading.Reading) -> reading.Reading:
    return reading.Reading(mesh.vertices * 1.0001, mesh.triangles, mesh.unit)


def moved(mesh: reading.Reading) -> reading.Reading:
    """Box 1, within the bounds of both."""
    far = mesh.vertices[:, 0] > 0.3
    return reading.Reading(mesh.vertices + np.outer(far, [-0.001, 0, 0]), mesh.triangles, mesh.unit)


def connected_otherwise(mesh: reading.Reading) -> reading.Reading:
    triangles = mesh.triangles.copy()
    triangles[[0, 4], 2] = triangles[[4, 0], 2]
    return reading.Reading(mesh.vertices, triangles, mesh.unit)


@pytest.mark.parametrize("fault", [lost, scaled, moved, connected_otherwise])
@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "dae", "glb"])
@pytest.mark.parametrize("many", [0, meshes.MANY])
def test_a_fault_of_a_reader_is_noticed_by_the_second_reading(tmp_path, suffix, fault, many, monkeypatch):
    monkeypatch.setattr(meshes, "MANY", many)  # large STL files are compared with their bytes
    files = next(case[2] for case in CASES if case[1] == suffix)
    path = tmp_path / f"mesh.{suffix}"
    path.write_bytes(files[path.name])
    monkeypatch.setenv("PINPROOF_CACHE", "off")
    assert boxes_of(read_mesh(path)) == [0, 1]
    reader = READERS[suffix]
    monkeypatch.setitem(READERS, suffix, lambda *args: fault(reader(*args)))
    with pytest.raises(pp.errors.MeshError, match="disagree"):
        read_mesh(path)


def test_vertices_without_triangles_do_not_belong_to_the_mesh(tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_text("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 2 4 3\nf 2 3 5\nf 2 5 4\nf 3 4 5\n")
    mesh = read_mesh(path)
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert mesh.vertices[mesh.triangles[0]].tolist() == [[0, 0, 0], [0, 1, 0], [1, 0, 0]]


def test_a_changed_buffer_beside_a_gltf_file_is_read_again(tmp_path):
    document, blob = gltf()
    document["buffers"][0]["uri"] = "data.bin"
    for accessor in document["accessors"]:
        accessor.pop("min", None), accessor.pop("max", None)
    (tmp_path / "mesh.gltf").write_bytes(json.dumps(document).encode())
    (tmp_path / "data.bin").write_bytes(blob)
    assert boxes_of(read_mesh(tmp_path / "mesh.gltf")) == [0, 1]
    points = np.frombuffer(blob, dtype="<f4", count=24) * np.float32(2)
    (tmp_path / "data.bin").write_bytes(points.tobytes() + blob[96:])
    assert read_mesh(tmp_path / "mesh.gltf").vertices.max() == pytest.approx(2 * BOXES[0].max())


# One small mesh of each format: for any axes and unit of the file, the mesh is in metres in the link's axes.


# A box that is different in every direction, so that no rotation or unit goes unseen.
BOUNDS = np.array([[0.1, -0.2, 0.3], [0.2, 0.2, 0.9]])

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><created>2026-01-01T00:00:00</created><modified>2026-01-01T00:00:00</modified>
  <unit name="u" meter="{unit}"/><up_axis>{up}</up_axis></asset>
 <library_geometries><geometry id="g" name="g"><mesh>
  <source id="p"><float_array id="a" count="{count}">{numbers}</float_array>
   <technique_common><accessor source="#a" count="{points}" stride="3"><param name="X" type="float"/>
    <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles count="{faces}"><input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s"><node id="n"><translate>{shift}</translate>
  <instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""


def box(scale: float = 1.0) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=BOUNDS * scale)


def dae_box(path, up, unit, shift="0 0 0"):
    made = box(1 / unit)
    path.write_text(
        DAE.format(
            up=up, unit=unit, shift=shift, count=made.vertices.size, points=len(made.vertices), faces=len(made.faces),
            numbers=" ".join(map(repr, made.vertices.ravel().tolist())), indices=" ".join(map(str, made.faces.ravel())),
        )
    )  # fmt: skip
    return path


def bounds(path, scale=(1.0, 1.0, 1.0)):
    vertices = read_mesh(path, scale).vertices
    return vertices.min(axis=0), vertices.max(axis=0)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_formats_without_axes_are_not_rotated(tmp_path, suffix):
    box().export(tmp_path / f"m.{suffix}")
    np.testing.assert_allclose(bounds(tmp_path / f"m.{suffix}"), BOUNDS, atol=1e-6)


def test_millimetres_of_an_stl_are_scaled_by_the_urdf(tmp_path):
    box(1000).export(tmp_path / "m.stl")
    np.testing.assert_allclose(bounds(tmp_path / "m.stl", (0.001, 0.001, 0.001)), BOUNDS, atol=1e-6)


@pytest.mark.parametrize("up", ["X_UP", "Y_UP", "Z_UP"])
@pytest.mark.parametrize("unit", [1.0, 0.001, 0.0254])
def test_the_unit_of_collada_is_used_and_its_up_axis_ignored(tmp_path, up, unit):
    np.testing.assert_allclose(bounds(dae_box(tmp_path / "m.dae", up, unit)), BOUNDS, atol=1e-6)


def test_collada_nodes_place_their_geometry(tmp_path):
    placed = bounds(dae_box(tmp_path / "m.dae", "Z_UP", 0.001, shift="0 0 500"))
    np.testing.assert_allclose(placed, BOUNDS + np.array([0, 0, 0.5]), atol=1e-6)


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_gltf_is_rotated_from_y_up_to_z_up(tmp_path, suffix):
    # x right, y up, z towards the viewer: the standard's (x, y, z) is the link's (x, -z, y)
    upright = box()
    upright.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    scene = trimesh.Scene()
    scene.add_geometry(upright, transform=trimesh.transformations.translation_matrix([0, 0.25, 0]))
    for name, data in trimesh.exchange.gltf.export_gltf(scene).items() if suffix == "gltf" else ():
        (tmp_path / name).write_bytes(data)
    file = tmp_path / ("model.gltf" if suffix == "gltf" else "m.glb")
    if suffix == "glb":
        scene.export(file)
    np.testing.assert_allclose(bounds(file), BOUNDS + np.array([0, 0, 0.25]), atol=1e-6)
    np.testing.assert_allclose(bounds(file, (1, 1, 2)), (BOUNDS + np.array([0, 0, 0.25])) * [1, 1, 2], atol=1e-6)


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf", "mm"])
def test_an_unknown_unit_is_refused(tmp_path, unit):
    file = dae_box(tmp_path / "m.dae", "Z_UP", 1.0)
    file.write_text(file.read_text().replace('meter="1.0"', f'meter="{unit}"'))
    with pytest.raises(pp.errors.MeshError, match="unit that is not a positive number"):
        read_mesh(file)
