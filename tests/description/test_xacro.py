"""xacro files: expanded with their arguments and packages, refused with xacro's own reason."""

from __future__ import annotations

import os
import sys

import pytest

import pinproof as pp
from pinproof.description.ros_files import expand_xacro, find_package, locate

from ..processes import PATIENCE

pytestmark = pytest.mark.slow

XACRO = """<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.3"/>
  <xacro:property name="l" value="$(arg length)"/>
  <xacro:include filename="$(find pkg)/limits.xacro"/>
  <link name="a"/><link name="b"/><link name="tip"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/><xacro:limits/></joint>
  <joint name="end" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0 0 ${2 * l}"/></joint>
</robot>"""
LIMITS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="limits"><limit lower="${-pi / 2}" upper="${pi / 2}" velocity="1" effort="1"/></xacro:macro>
</robot>"""


@pytest.fixture
def file(tmp_path):
    pytest.importorskip("xacro")
    (tmp_path / "packages" / "pkg").mkdir(parents=True)
    (tmp_path / "packages" / "pkg" / "limits.xacro").write_text(LIMITS)
    (tmp_path / "r.urdf.xacro").write_text(XACRO)
    return tmp_path / "r.urdf.xacro"


def test_xacro_is_expanded(file, tmp_path):
    robot = pp.load_robot(file, package_dirs=[tmp_path / "packages"], xacro_args={"length": "0.5"})
    arm = robot.arm()
    assert arm.forward_kinematics([0.4]).translation[2] == 1.0
    assert arm.limits.upper[0] == pytest.approx(1.5707963)


def test_defaults_of_arguments_hold(file, tmp_path):
    arm = pp.load_robot(str(file), package_dirs=[tmp_path / "packages"]).arm()
    assert arm.forward_kinematics([0.0]).translation[2] == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("$(find pkg)", "$(find nowhere)", "'nowhere' was not found"),
        ("<xacro:limits/>", "<xacro:nix/>", "unknown macro name: xacro:nix"),
        ("${2 * l}", "${2 * m}", "m"),
        ("</robot>", "", "not well-formed XML"),
        ('link name="tip"', 'link name="tap"', r"expanded.*unknown link 'tip'"),
    ],
)
def test_invalid_xacro_is_refused_with_its_reason(file, tmp_path, before, after, message):
    file.write_text(XACRO.replace(before, after))
    with pytest.raises(pp.errors.UrdfError, match=message):
        pp.load_robot(file, package_dirs=[tmp_path / "packages"])


def test_endless_expansion_is_stopped(file, tmp_path):
    file.write_text(XACRO.replace("${2 * l}", "${9**9**9}"))
    with pytest.raises(pp.errors.UrdfError, match="within 2 s"):
        expand_xacro(file, {}, [tmp_path / "packages"], time_limit=2.0)


def test_expansion_that_exceeds_the_memory_is_refused(file, tmp_path):
    file.write_text(XACRO.replace("${2 * l}", "${len('x' * 10**11)}"))
    with pytest.raises(pp.errors.UrdfError, match="when evaluating expression 'len"):
        expand_xacro(file, {}, [tmp_path / "packages"], time_limit=PATIENCE)


def test_arguments_for_a_plain_urdf_are_refused(tmp_path):
    (tmp_path / "r.urdf").write_text('<robot name="r"><link name="a"/></robot>')
    with pytest.raises(pp.InputError, match=r"\.xacro files only"):
        pp.load_robot(tmp_path / "r.urdf", xacro_args={"a": "b"})


def test_missing_xacro_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(pp.InputError, match=r"pinproof\[xacro\]"):
        pp.load_robot(tmp_path / "r.xacro")


def test_missing_file_is_named(tmp_path):
    pytest.importorskip("xacro")
    with pytest.raises(pp.errors.UrdfError, match="No such file"):
        pp.load_robot(tmp_path / "r.xacro")


def test_relative_package_dirs_are_those_of_the_working_directory(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arm = pp.load_robot("r.urdf.xacro", package_dirs=["packages"]).arm()
    assert arm.forward_kinematics([0.0]).translation[2] == pytest.approx(0.6)


def test_a_mistyped_argument_is_refused_and_the_nearest_is_named(file, tmp_path):
    with pytest.raises(pp.errors.UnknownNameError) as caught:
        pp.load_robot(file, package_dirs=[tmp_path / "packages"], xacro_args={"lenght": "0.5"})
    assert (caught.value.name, caught.value.valid) == ("lenght", ["length"])
    assert "r.urdf.xacro" in str(caught.value)


def test_an_argument_that_an_included_file_declares_is_accepted(file, tmp_path):
    (tmp_path / "packages" / "pkg" / "limits.xacro").write_text(
        LIMITS.replace("<xacro:macro", '<xacro:arg name="speed" default="1"/>\n<xacro:macro').replace(
            'velocity="1"', 'velocity="$(arg speed)"'
        )
    )
    arm = pp.load_robot(file, package_dirs=[tmp_path / "packages"], xacro_args={"speed": "2.5"}).arm()
    assert arm.limits.velocity[0] == 2.5


def test_an_argument_that_is_used_but_not_declared_is_accepted(file, tmp_path):
    file.write_text(XACRO.replace('<xacro:arg name="length" default="0.3"/>', ""))
    arm = pp.load_robot(file, package_dirs=[tmp_path / "packages"], xacro_args={"length": "0.5"}).arm()
    assert arm.forward_kinematics([0.0]).translation[2] == pytest.approx(1.0)


def test_the_expanded_urdf_is_saved_and_is_the_same_robot(file, tmp_path):
    robot = pp.load_robot(file, package_dirs=[tmp_path / "packages"], xacro_args={"length": "0.5"})
    robot.save_urdf(tmp_path / "expanded.urdf")
    text = (tmp_path / "expanded.urdf").read_text()
    assert "$(" not in text
    assert "xacro:" not in text
    again = pp.load_robot(tmp_path / "expanded.urdf")
    assert again.arm().forward_kinematics([0.4]).isApprox(robot.arm().forward_kinematics([0.4]), 1e-15)
    assert (again.arm().limits.upper == robot.arm().limits.upper).all()


def test_files_and_macros_that_call_themselves_are_named(tmp_path):
    begin, end = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">', "</robot>"
    (tmp_path / "a.xacro").write_text(f'{begin}<xacro:include filename="b.xacro"/>{end}')
    (tmp_path / "b.xacro").write_text(f'{begin}<xacro:include filename="a.xacro"/>{end}')
    with pytest.raises(pp.errors.UrdfError, match=r"a\.xacro -> .*b\.xacro -> .*a\.xacro$"):
        pp.load_robot(tmp_path / "a.xacro")
    macro = '<xacro:macro name="arm" params="n"><link name="l${n}"/><xacro:arm n="${n + 1}"/></xacro:macro>'
    (tmp_path / "m.xacro").write_text(f'{begin}{macro}<xacro:arm n="0"/>{end}')
    with pytest.raises(pp.errors.UrdfError, match=r"arm -> arm, in .*m\.xacro$"):
        pp.load_robot(tmp_path / "m.xacro")


# Search paths of meshes: packages of ROS 1 and ROS 2, and URIs that leave their package.


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
