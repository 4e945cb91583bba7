"""Taking arms from robots: tcp, base, limits, and the catalogue."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.model import load_robot

LIMIT = '<limit lower="-2" upper="2" velocity="1" effort="1"/>'


def two_tips(kinds=("revolute", "fixed", "fixed")):
    ends = [("base", "arm"), ("arm", "left"), ("arm", "right")]
    joints = "".join(
        f'<link name="{child}"/><joint name="{child}_joint" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/>{LIMIT}</joint>'
        for (parent, child), kind in zip(ends, kinds, strict=False)
    )
    return load_robot(f'<robot name="two"><link name="base"/>{joints}</robot>')


def test_tcp_is_the_only_leaf_on_a_fixed_joint():
    assert two_tips(("revolute", "fixed")).arm().tcp == "left"


def test_frames_of_a_dh_table_are_not_tools(tmp_path):
    pp.write_urdf(pp.DhTable.load(robots_folder() / "generic_6dof" / "dh.yaml"), tmp_path / "r.urdf")
    assert pp.load_robot(tmp_path / "r.urdf").arm().tcp == "tool0"


@pytest.mark.parametrize("kinds", [("revolute", "fixed", "fixed"), ("revolute", "revolute")])
def test_tcp_is_never_guessed(kinds):
    with pytest.raises(pp.InputError, match=r"tcp=.*left"):
        two_tips(kinds).arm()


def test_tcp_without_a_moving_joint_is_refused():
    with pytest.raises(pp.InputError, match="no joint moves"):
        two_tips().arm(tcp="left", base="arm")


def test_base_behind_the_tcp_is_refused():
    with pytest.raises(pp.InputError, match="is not on the path"):
        two_tips().arm(tcp="left", base="right")


def test_floating_joint_on_the_chain_is_refused():
    with pytest.raises(pp.InputError, match="floating"):
        two_tips(("floating", "revolute")).arm(tcp="left")


def test_base_that_the_arm_itself_moves_through_a_mimic_joint_is_refused():
    text = (
        '<robot name="r"><link name="root"/><link name="base"/><link name="tip"/>'
        f'<joint name="b" type="revolute"><parent link="root"/><child link="base"/>{LIMIT}<mimic joint="t"/></joint>'
        f'<joint name="t" type="revolute"><parent link="base"/><child link="tip"/>{LIMIT}</joint></robot>'
    )
    with pytest.raises(pp.InputError, match="mimic"):
        load_robot(text).arm(tcp="tip", base="base")


def test_limits_can_be_tightened_by_name_and_replaced():
    robot = pp.load_robot("ur5")
    tight = robot.arm(limits={"elbow_joint": (0.0, 3.0)})
    assert tight.limits.lower[2] == 0.0
    assert tight.limits.lower[1] == robot.arm().limits.lower[1]
    assert robot.arm(limits=tight.limits).limits.upper[2] == 3.0
    with pytest.raises(pp.UnknownNameError, match="elbow_joint"):
        robot.arm(limits={"elbow": (0.0, 1.0)})
    with pytest.raises(pp.InputError, match=r"at most limits\.upper"):
        robot.arm(limits={"elbow_joint": (1.0, 0.0)})
    for wrong in (3.0, ("a", "b"), (0.0, 1.0, 2.0), "12", {-1.0: 0, 2.0: 0}, {1.0, 2.0}):
        with pytest.raises(pp.InputError, match=r"elbow_joint.*\(lower, upper\)"):
            robot.arm(limits={"elbow_joint": wrong})
    with pytest.raises(pp.InputError, match="limits must be of type"):
        robot.arm(limits=[(-1.0, 1.0)] * 6)
    with pytest.raises(pp.InputError, match="6"):
        robot.arm(limits=pp.JointLimits(np.zeros(2), np.ones(2), np.ones(2)))


def test_panda_joint_6_keeps_its_limits():
    limits = pp.load_robot("panda").arm().limits
    assert limits.lower[5] == pytest.approx(-0.0175)
    assert limits.upper[5] == pytest.approx(3.7525)


def test_panda_arm_is_a_chain_without_its_fingers():
    assert pp.load_robot("panda").arm().dof == 7


def test_unknown_robot_names_the_catalogue():
    with pytest.raises(pp.UnknownNameError, match="valid: ur5"):
        pp.load_robot("ur55")


def test_file_of_another_kind_and_a_folder_are_refused(tmp_path):
    with pytest.raises(pp.errors.UrdfError, match="ends in"):
        pp.load_robot(tmp_path / "robot.sdf")
    with pytest.raises(pp.errors.UrdfError, match="is a folder"):
        pp.load_robot(tmp_path)


def test_one_package_folder_without_a_list_is_refused(tmp_path):
    for folder in (tmp_path, str(tmp_path)):
        with pytest.raises(pp.InputError, match="package_dirs must be a list"):
            pp.load_robot("ur5", package_dirs=folder)


def test_missing_package_folder_is_refused(tmp_path):
    with pytest.raises(pp.FileError, match="pakages: is not a folder"):
        pp.load_robot("ur5", package_dirs=[tmp_path / "pakages"])
