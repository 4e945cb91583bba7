"""Search paths of meshes: packages of ROS 1 and ROS 2, and URIs that leave their package."""

from __future__ import annotations

import os

import pytest

import pinproof as pp
from pinproof.description.ros_files import find_package, locate

URDF = '<robot name="r"><link name="a"><collision><geometry>{}</geometry></collision></link></robot>'


@pytest.fixture(autouse=True)
def no_ros(monkeypatch):
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def put(path, text="solid"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def manifest(folder, name):
    put(folder / "package.xml", f"<package><name> {name} </name></package>")


def test_ros_package_path_holds_packages(tmp_path, monkeypatch):
    mesh = put(tmp_path / "b" / "pkg" / "m.stl")
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join([str(tmp_path / "a"), str(tmp_path / "b"), ""]))
    assert locate("package://pkg/m.stl", None, []).path == mesh


def test_ros_package_path_may_be_the_package_itself(tmp_path, monkeypatch):
    mesh = put(tmp_path / "pkg" / "m.stl")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "pkg"))
    assert locate("package://pkg/m.stl", None, []).path == mesh


def test_packages_of_a_workspace_are_found_by_their_manifest(tmp_path, monkeypatch):
    mesh = put(tmp_path / "src" / "repository" / "folder_of_another_name" / "m.stl")
    manifest(mesh.parent, "pkg")
    put(tmp_path / "src" / "repository" / "pkg_2" / "m.stl")
    manifest(tmp_path / "src" / "repository" / "pkg_2", "pkg_2")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "src"))
    assert locate("package://pkg/m.stl", None, []).path == mesh


def test_ament_prefixes_hold_packages_in_share(tmp_path, monkeypatch):
    mesh = put(tmp_path / "install" / "share" / "pkg" / "m.stl")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    assert locate("package://pkg/m.stl", None, []).path == mesh


def test_package_folders_precede_the_environment(tmp_path, monkeypatch):
    put(tmp_path / "ros" / "pkg" / "m.stl")
    mesh = put(tmp_path / "mine" / "pkg" / "m.stl")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    assert locate("package://pkg/m.stl", None, [tmp_path / "mine"]).path == mesh


def test_a_package_in_another_folder_is_found_by_its_manifest(tmp_path):
    mesh = put(tmp_path / "clone" / "meshes" / "m.stl")
    manifest(tmp_path / "clone", "pkg")
    assert locate("package://pkg/meshes/m.stl", tmp_path / "clone" / "urdf", []).path == mesh
    assert find_package("pkg", tmp_path / "clone" / "urdf", []) == tmp_path / "clone"


def test_a_third_slash_is_not_an_absolute_path(tmp_path):
    mesh = put(tmp_path / "pkg" / "m.stl")
    assert locate("package:///pkg/m.stl", None, [tmp_path]).path == mesh
    assert locate(f"package:///{mesh}", None, []).path is None


def test_missing_mesh_names_every_place_of_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament"))
    looked = locate("package://pkg/m.stl", None, []).searched
    assert {tmp_path / "ros" / "pkg" / "m.stl", tmp_path / "ament" / "share" / "pkg" / "m.stl"} <= set(looked)


@pytest.mark.parametrize(
    "uri", ["package://a/../../etc/passwd", "package://a/b/../../c", "package://a/%2e%2e/c.stl", "package://../c.stl"]
)
def test_uri_that_climbs_out_of_its_package_is_refused(tmp_path, uri):
    file = put(tmp_path / "r.urdf", URDF.format(f'<mesh filename="{uri}"/>'))
    with pytest.raises(pp.errors.UrdfError, match=r"line 1.*leaves its package"):
        pp.load_robot(file)


def test_a_second_slash_inside_is_not_an_absolute_path(tmp_path):
    outside = put(tmp_path / "outside.stl")
    assert locate(f"package://a/{outside}", None, [tmp_path]).path is None


@pytest.mark.parametrize("name", ["x" * 5000, "a/" * 3000, "a\0b"])
def test_name_that_no_file_can_have_is_not_found(tmp_path, name):
    for uri in (name, f"package://{name}", f"package://a/{name}", f"file:///{name}"):
        assert locate(uri, tmp_path, [tmp_path]).path is None


def test_dots_inside_the_package_are_followed(tmp_path):
    mesh = put(tmp_path / "a" / "m.stl")
    (tmp_path / "a" / "urdf").mkdir()
    assert locate("package://a/urdf/../m.stl", None, [tmp_path]).path.resolve() == mesh.resolve()
