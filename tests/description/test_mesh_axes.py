"""One small mesh of each format: for any axes and unit of the file, the mesh is in metres in the link's axes."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.description.meshes import read_mesh

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


def dae(path, up, unit, shift="0 0 0"):
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
    np.testing.assert_allclose(bounds(dae(tmp_path / "m.dae", up, unit)), BOUNDS, atol=1e-6)


def test_collada_nodes_place_their_geometry(tmp_path):
    placed = bounds(dae(tmp_path / "m.dae", "Z_UP", 0.001, shift="0 0 500"))
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
    file = dae(tmp_path / "m.dae", "Z_UP", 1.0)
    file.write_text(file.read_text().replace('meter="1.0"', f'meter="{unit}"'))
    with pytest.raises(pp.errors.MeshError, match="unit that is not a positive number"):
        read_mesh(file)
