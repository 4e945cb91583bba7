"""Picks files that state the files of an own robot, and cells in which the robot is placed."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.errors import FileError, PicksError
from pinproof.picks import open_picks
from pinproof.picks.input.pick import PlaceTarget
from pinproof.picks.input.picks import NamedFrame

GENERIC = robots_folder() / "generic_6dof"
LIMITS = "joint_limits:\n  joint_1: {has_velocity_limits: true, max_velocity: 0.25}\n"
XACRO = """<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.3"/>
  <xacro:include filename="$(find pkg)/link.xacro"/>
  <link name="a"/><link name="b"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="end" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="$(arg length) 0 0"/></joint>
</robot>"""


def picks_file(folder: Path, *lines: str) -> Path:
    path = folder / "picks.yaml"
    path.write_text("\n".join([*lines, "picks: [{name: p, xyz: [0.4, 0, 0.2], rpy: [pi, 0, 0]}]"]))
    return path


def test_the_files_of_the_robot_are_relative_to_the_picks_file(tmp_path):
    shutil.copy(GENERIC / "dh.yaml", tmp_path / "arm.yaml")
    (tmp_path / "limits.yaml").write_text(LIMITS)
    (tmp_path / "arm.srdf").write_text(
        '<robot name="x"><group_state name="up" group="g"><joint name="joint_1" value="0.5"/></group_state></robot>'
    )
    picks = pp.read_picks(picks_file(tmp_path, "robot: arm.yaml", "srdf: arm.srdf", "limits: limits.yaml"))
    arm = picks.load_arm()
    assert arm.limits.velocity[0] == 0.25
    assert arm.robot.state("up") == {"joint_1": 0.5}
    assert arm.robot.urdf.path == tmp_path / "arm.yaml"


@pytest.mark.slow
def test_xacro_arguments_and_package_folders_are_read(tmp_path):
    pytest.importorskip("xacro")
    (tmp_path / "ros" / "pkg").mkdir(parents=True)
    (tmp_path / "ros" / "pkg" / "link.xacro").write_text('<robot><link name="tip"/></robot>')
    (tmp_path / "arm.urdf.xacro").write_text(XACRO)
    stated = ("robot: arm.urdf.xacro", "package_dirs: [ros]", "xacro_args: {length: 0.75}")
    arm = pp.read_picks(picks_file(tmp_path, *stated)).load_arm()
    np.testing.assert_allclose(arm.forward_kinematics([0.0]).translation, [0.75, 0, 0], atol=1e-15)
    path = picks_file(tmp_path, *stated[:2], "xacro_args: {length: 0.75, lenght: 0.75}")
    with pytest.raises(PicksError, match=r"'lenght'.*length") as caught:
        pp.read_picks(path).load_arm()
    assert (caught.value.path, caught.value.place) == (str(path), "line 3, column 28, key xacro_args, lenght")


@pytest.mark.parametrize(
    ("lines", "place", "reason"),
    [
        (["robot: ur55"], "line 1, column 1, key robot", "'ur55'.*valid: ur5"),
        (["robot: ur5", "tcp: tol0"], "line 2, column 1, key tcp", "'tol0'.*valid: tool0"),
        (["robot: ur5", "held: {finger: 0.1}"], "line 2, column 8, key held, finger", "'finger'"),
    ],
)
def test_a_name_that_the_robot_lacks_is_refused_with_its_position(tmp_path, lines, place, reason):
    path = picks_file(tmp_path, *lines)
    with pytest.raises(PicksError, match=reason) as caught:
        pp.read_picks(path).load_arm()
    assert (caught.value.path, caught.value.place) == (str(path), place)


def test_a_limits_file_with_an_unknown_joint_is_refused_with_its_line(tmp_path):
    limits = tmp_path / "limits.yaml"
    limits.write_text(LIMITS.replace("joint_1", "joint_9"))
    picks = pp.read_picks(picks_file(tmp_path, "robot: generic_6dof", "limits: limits.yaml"))
    with pytest.raises(FileError, match=r"'joint_9'; valid: .*joint_1") as caught:
        picks.load_arm()
    assert (caught.value.path, caught.value.place) == (str(limits), "line 2, column 3, joint joint_9")


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("srdf: none.srdf", "there is no file .*none.srdf"),
        ("limits: none.yaml", "there is no file .*none.yaml"),
        ("limits: 5", "5, which is not a name"),
        ("package_dirs: [nowhere]", "there is no folder .*nowhere"),
        ("package_dirs: 5", "not a name"),
        ("xacro_args: {a: 1}", r"ends in \.xacro"),
        ("xacro_args: [a]", "not a mapping"),
    ],
)
def test_a_bad_value_is_refused_with_its_line_and_key(tmp_path, line, reason):
    path = picks_file(tmp_path, "robot: ur5", "margin: 0", line)
    with pytest.raises(PicksError, match=reason) as caught:
        pp.read_picks(path)
    assert caught.value.path == str(path)
    assert caught.value.place.removesuffix("[0]") == f"line 3, column 1, key {line.partition(':')[0]}"


def placed_cell() -> tuple[pp.Arm, pp.Scene, pp.Picks]:
    picks = pp.read_picks(GENERIC / "picks.yaml")
    return picks.load_arm(), pp.Scene.load(picks.scene), picks


def test_a_transformed_scene_keeps_the_obstacles_relative_to_each_other():
    _, scene, _ = placed_cell()
    place = pp.pose((0.3, -0.2, 0.1), (0.1, 0.2, 0.3))
    moved = scene.transformed(place)
    assert moved.names == scene.names
    assert moved.allowed == scene.allowed
    for a, b in zip(scene.obstacles, moved.obstacles, strict=True):
        assert b.pose.isApprox(place * a.pose, 1e-12)
        assert b.shape == a.shape


def test_transformed_picks_follow_their_cell():
    place = pp.pose((0.3, -0.2, 0.1), (0.1, 0.2, 0.3))
    target = PlaceTarget(pp.pose((0, 0.5, 0)))
    pick = pp.Pick("p", pp.pose((0.4, 0, 0.2)), carried="part", place=target)
    framed = pp.Pick("f", pp.pose((0.4, 0, 0.2)), frame="tray")
    picks = pp.Picks((pick, framed), frames={"tray": NamedFrame(pp.pose((1, 0, 0))), "in": NamedFrame(place, "tray")})
    moved = picks.transformed(place)
    assert moved.picks[0].pose.isApprox(place * pick.pose, 1e-12)
    np.testing.assert_allclose(moved.picks[0].retreat_direction, place.rotation[:, 2], atol=1e-15)
    assert moved.picks[0].approach_direction == (0.0, 0.0, 1.0)  # in the frame of the tip
    assert moved.picks[0].place.pose.isApprox(place * target.pose, 1e-12)
    np.testing.assert_allclose(moved.picks[0].place.approach_direction, -place.rotation[:, 2], atol=1e-15)
    assert moved.picks[1].pose.isApprox(framed.pose, 1e-15)
    assert moved.frames["tray"].pose.isApprox(place * pp.pose((1, 0, 0)), 1e-12)
    assert moved.frames["in"].pose.isApprox(place, 1e-15)


def test_a_table_of_picks_is_transformed_row_by_row(tmp_path):
    table = tmp_path / "many.csv"
    table.write_text("name,x,y,z,roll,pitch,yaw\n" + "".join(f"p{i},0.{i},0,0.2,pi,0,0\n" for i in range(1, 5)))
    place = pp.pose((0, 0, 1))
    source = open_picks(table)
    moved = source.transformed(place)
    assert len(moved) == 4
    assert moved.digest() != source.digest()
    heights = [pick.pose.translation[2] for pick in moved.load()]
    np.testing.assert_allclose(heights, 1.2)


def test_a_cell_and_a_robot_that_move_together_give_the_same_verdicts():
    arm, scene, picks = placed_cell()
    world_from_root = pp.pose((0.5, -0.3, 0.2), (0, 0, 0.7))
    cell, stated = scene.transformed(world_from_root), picks.transformed(world_from_root)
    back = world_from_root.inverse()
    few = picks.picks[:2]
    first = pp.validate_picks(arm, scene, pp.Picks(few, tip=picks.tip, tool=picks.tool, margin=picks.margin))
    restored = pp.Picks(stated.transformed(back).picks[:2], tip=picks.tip, tool=picks.tool, margin=picks.margin)
    again = pp.validate_picks(arm, cell.transformed(back), restored)
    assert [v.ok for v in first.verdicts] == [v.ok for v in again.verdicts]
