"""Mesh files: found by every kind of URI, named with the places searched when not, scaled and checked when read."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import read_urdf
from pinproof.description.meshes import read_mesh, resolved
from pinproof.description.ros_files import locate

TRIANGLES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def mesh(tmp_path):
    """tmp_path/ws/arm_description/{urdf,meshes}; the mesh is a tetrahedron."""
    package = tmp_path / "ws" / "arm_description"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    file = package / "meshes" / "a part.obj"
    file.write_text(TRIANGLES)
    return file


def robot(folder, uri):
    file = folder / "arm.urdf"
    file.write_text(
        f'<robot name="r"><link name="a"><visual><geometry><mesh filename="{uri}"/></geometry></visual></link></robot>'
    )
    return file


@pytest.mark.parametrize(
    "uri",
    [
        "package://arm_description/meshes/a part.obj",
        "package://arm_description/meshes/a%20part.obj",
        "../meshes/a part.obj",
    ],
)
def test_mesh_is_found_from_the_urdf_alone(mesh, uri):
    (visual,) = read_urdf(robot(mesh.parents[1] / "urdf", uri)).visuals
    assert visual.mesh is not None
    assert visual.mesh.path is not None
    assert visual.mesh.path.samefile(mesh)


@pytest.mark.parametrize("prefix", ["file://", ""])
def test_mesh_is_found_by_absolute_path(mesh, tmp_path, prefix):
    (visual,) = read_urdf(robot(tmp_path, f"{prefix}{mesh}")).visuals
    assert visual.mesh is not None
    assert visual.mesh.path == mesh


def test_package_folders_are_searched_first(mesh, tmp_path):
    other = tmp_path / "other" / "arm_description" / "meshes" / "a part.obj"
    other.parent.mkdir(parents=True)
    other.write_text(TRIANGLES)
    uri = "package://arm_description/meshes/a part.obj"
    (visual,) = read_urdf(robot(mesh.parents[1] / "urdf", uri), package_dirs=[tmp_path / "other"]).visuals
    assert visual.mesh is not None
    assert visual.mesh.path == other


@pytest.mark.parametrize("uri", ["package://arm_description/meshes/no.stl", "no.stl", "file:///no/such.stl"])
def test_missing_mesh_names_link_and_every_place_searched(tmp_path, uri):
    found = locate(uri, tmp_path / "urdf", [tmp_path / "packages"])
    with pytest.raises(pp.errors.MeshError) as caught:
        resolved(found, "forearm")
    text = str(caught.value)
    assert "forearm" in text
    assert found.searched
    assert all(str(place) in text for place in found.searched)
    if not uri.startswith("file"):
        assert str(tmp_path / "packages") in text


def test_scale_is_applied_and_a_mirrored_mesh_keeps_its_outside_out(mesh):
    plain, mirrored = read_mesh(mesh, (2, 1, 1)), read_mesh(mesh, (-2, 1, 1))

    def volume(m):
        a, b, c = m.vertices[m.triangles].transpose(1, 0, 2)
        return np.einsum("ij,ij->", a, np.cross(b, c)) / 6

    assert volume(plain) == pytest.approx(1 / 3)
    assert volume(mirrored) == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.obj", "v 0 0 0\n", "no triangle|cannot be read"),
        ("a.obj", TRIANGLES.replace("v 1 0 0", "v nan 0 0"), "not finite"),
        ("a.stl", "nonsense", "cannot be read|no triangle"),
        ("a.txt", "", "unknown file type"),
    ],
)
def test_unusable_mesh_is_refused(tmp_path, name, text, message):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(pp.errors.MeshError, match=message):
        read_mesh(file)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(pp.errors.MeshError, match="No such file"):
        read_mesh(tmp_path / "a.stl")


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_catalogue_robots_have_their_meshes(name):
    urdf = pp.load_robot(name).urdf
    meshes = [g for g in (*urdf.visuals, *urdf.collisions) if g.mesh is not None]
    assert meshes
    assert all(resolved(g.mesh, g.link).is_file() for g in meshes)
