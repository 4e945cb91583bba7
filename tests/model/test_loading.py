"""Loading robots from DH tables, and saving their URDF."""

from __future__ import annotations

import pickle
import shutil

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.errors import ConversionError, DhTableError

GENERIC = robots_folder() / "generic_6dof"


@pytest.mark.parametrize("suffix", [".yaml", ".csv"])
def test_a_dh_table_file_is_a_robot(suffix, tmp_path):
    table = pp.DhTable.load(GENERIC / "dh.yaml")
    table = pp.DhTable(table.rows, convention=table.convention, name="mine")  # a CSV file holds no tool
    path = tmp_path / f"mine{suffix}"
    table.save(path)
    robot = pp.load_robot(path)
    arm = robot.arm()
    assert (robot.name, robot.urdf.path, arm.tcp, arm.joint_names) == ("mine", path, "tool0", table.joint_names)
    for q in np.random.default_rng(0).uniform(table.lower, table.upper, (20, len(table))):
        np.testing.assert_allclose(arm.forward_kinematics(q).homogeneous, table.forward_kinematics(q), atol=1e-12)
    assert robot.urdf.collisions


def test_a_table_in_memory_is_a_robot_and_survives_pickling():
    table = pp.DhTable([pp.DhRow("j1", 0, 0.3, 0, np.pi / 2), pp.DhRow("j2", 0, 0, 0.4, 0)], convention="standard")
    robot = pickle.loads(pickle.dumps(pp.load_robot(table)))
    assert robot.urdf.path is None
    q = [0.3, -0.7]
    np.testing.assert_allclose(
        robot.arm().forward_kinematics(q).homogeneous, table.forward_kinematics(q), rtol=0, atol=1e-12
    )


def test_an_srdf_applies_to_a_table(tmp_path):
    (tmp_path / "arm.srdf").write_text(
        '<robot name="x"><group_state name="up" group="arm">'
        + "".join(f'<joint name="joint_{i}" value="0.{i}"/>' for i in range(1, 7))
        + "</group_state></robot>"
    )
    arm = pp.load_robot(GENERIC / "dh.yaml", srdf=tmp_path / "arm.srdf").arm()
    np.testing.assert_allclose(arm.state("up"), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


def test_a_bad_table_names_its_row(tmp_path):
    (tmp_path / "t.csv").write_text("# convention: standard\nname,theta,d,a,alpha\nj1,0,zero,0,0\n")
    with pytest.raises(DhTableError, match=r"t\.csv: line 3, row 1.*column d"):
        pp.load_robot(tmp_path / "t.csv")


def test_a_table_whose_urdf_differs_is_refused(monkeypatch):
    from pinproof.description import urdf_of_table

    def tampered(table):
        return urdf_of_table(table).replace('xyz="0.3 0.0 0.0"', 'xyz="0.31 0.0 0.0"')

    monkeypatch.setattr("pinproof.model.loading.urdf_of_table", tampered)
    with pytest.raises(ConversionError, match="off by"):
        pp.load_robot(GENERIC / "dh.yaml")


def test_xacro_arguments_for_a_table_are_refused():
    with pytest.raises(pp.InputError, match=r"\.xacro files only"):
        pp.load_robot(GENERIC / "dh.yaml", xacro_args={"a": "1"})


def test_a_saved_urdf_finds_its_meshes_from_another_folder(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    mesh = next(g.mesh.path for g in pp.load_robot("ur5").urdf.collisions if g.mesh is not None)
    shutil.copy(mesh, source / f"part{mesh.suffix}")
    (source / "r.urdf").write_text(
        f'<robot name="r"><link name="a"><collision><geometry><mesh filename="part{mesh.suffix}"/></geometry>'
        "</collision></link></robot>"
    )
    (tmp_path / "target").mkdir()
    pp.load_robot(source / "r.urdf").save_urdf(tmp_path / "target" / "r.urdf")
    (found,) = pp.load_robot(tmp_path / "target" / "r.urdf").urdf.collisions
    assert found.mesh.path == source / f"part{mesh.suffix}"


def test_a_saved_urdf_keeps_uris_that_are_still_found(tmp_path):
    robot = pp.load_robot("ur5")
    robot.save_urdf(tmp_path / "ur5.urdf")
    again = pp.load_robot(tmp_path / "ur5.urdf")
    assert next(g.mesh for g in again.urdf.visuals if g.mesh).uri.startswith("package://")
    assert [g.mesh and (g.mesh.uri, g.mesh.path) for g in again.urdf.collisions] == [
        g.mesh and (g.mesh.uri, g.mesh.path) for g in robot.urdf.collisions
    ]


def test_the_text_of_a_urdf_is_a_robot(tmp_path):
    file = pp.load_robot("ur5").urdf.path
    for text in (file.read_text(), "\ufeff" + file.read_text(), "\n" + file.read_text().partition("?>")[2]):
        robot = pp.load_robot(text, srdf=None, package_dirs=[file.parents[3]])
        arm, same = robot.arm(tcp="tool0"), pp.load_robot(file).arm(tcp="tool0")
        assert arm.forward_kinematics(same.home).isApprox(same.forward_kinematics(same.home), 1e-12)
        assert len(pp.CollisionChecker(arm).bodies) == len(pp.CollisionChecker(same).bodies)
    assert pickle.loads(pickle.dumps(robot.arm(tcp="tool0"))).joint_names == same.joint_names


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco/>", "root element is <mujoco>"),
        ("<robot", "line 1.*well-formed"),
        ("\n\n<robot", "line 3.*well-formed"),
        ('<?xml version="1.0"?>\n<robot name="r"/>', "no links"),
        ("<ur5.urdf", "well-formed"),
    ],
)
def test_text_that_is_no_urdf_is_refused_with_its_line(text, message):
    with pytest.raises(pp.errors.UrdfError, match=message):
        pp.load_robot(text)
    with pytest.raises(pp.InputError, match="xacro_args"):
        pp.load_robot(text, xacro_args={"a": "b"})
