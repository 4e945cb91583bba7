"""Joint groups: several arms of one robot, and cells of several robots."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp

MOUNT = pp.pose(xyz=(0.9, 0.2, 0.1), rpy=(0.3, -0.2, np.pi))


@pytest.fixture(scope="module")
def baxter():
    return pp.load_robot("baxter_left").arms("left", "right")


@pytest.fixture(scope="module")
def two_ur5():
    arm = pp.load_robot("ur5").arm()
    return pp.assemble({"a": (arm, pin.SE3.Identity()), "b": (arm, MOUNT)})


@pytest.mark.parametrize("name", ["baxter", "tiago_dual", "pr2", "talos"])
def test_group_has_the_joints_limits_and_tcps_of_both_arms(name: str) -> None:
    left, right = pp.load_robot(f"{name}_left").arm(), pp.load_robot(f"{name}_right").arm()
    group = pp.load_robot(f"{name}_left").arms("left", "right")
    assert group.joint_names == left.joint_names + right.joint_names
    assert np.array_equal(group.limits.upper, np.concatenate([left.limits.upper, right.limits.upper]))
    assert np.array_equal(group.home, np.concatenate([left.home, right.home]))
    q = np.random.default_rng(0).uniform(*group.limits.sampling_range())
    placed = group.tcp_placements(q)
    for side, arm in (("left", left), ("right", right)):
        expected = arm.root_from_base * arm.forward_kinematics(q[group.indices(side)])
        assert placed[side].isApprox(expected, 1e-12)
        assert group.arms[side].joint_names == arm.joint_names


def test_shared_torso_belongs_to_both_arms_where_the_base_is_above_it() -> None:
    robot = pp.load_robot("tiago_dual_left")
    group = robot.arms("left", "right", base="torso_fixed_link")
    assert group.dof == 15
    assert group.shared_joints == ("torso_lift_joint",)
    assert group.indices("left")[0] == group.indices("right")[0] == 0
    high, low = group.home, group.home
    high[0] += 0.1
    for side in ("left", "right"):
        rise = group.tcp_placements(high)[side].translation - group.tcp_placements(low)[side].translation
        assert np.allclose(rise, (0, 0, 0.1), atol=1e-9)


def test_shared_joint_without_a_base_is_refused() -> None:
    with pytest.raises(pp.InputError, match=r"l_shoulder_pan_joint.*'l_wrist_roll_link' and 'l_gripper_tool_frame'"):
        pp.load_robot("pr2_left").arms("l_wrist_roll_link", "l_gripper_tool_frame")


@pytest.mark.parametrize(
    ("arms", "error", "words"),
    [
        (("left", "rigt"), pp.UnknownNameError, "rigt"),
        (("left", "left"), pp.InputError, "twice"),
        (({"one": "left_gripper", "two": "left"},), pp.InputError, "same tcp"),
        ((3,), pp.InputError, "3"),
    ],
)
def test_wrong_arms_are_refused(arms: tuple[str, ...], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        pp.load_robot("baxter_left").arms(*arms)


def test_robot_with_one_arm_declares_none() -> None:
    with pytest.raises(pp.InputError, match="declares no arms"):
        pp.load_robot("ur5").arms()


def test_linear_axis_before_the_arm_is_a_joint_of_the_group() -> None:
    arm = pp.load_robot("tiago_dual_left").arm("hand_left_grasping_frame", base="torso_fixed_link")
    assert arm.joint_names[0] == "torso_lift_joint"
    assert not arm.angular[0]
    assert arm.dof == 8


def test_arm_is_the_group_of_itself() -> None:
    arm = pp.load_robot("ur5").arm()
    assert isinstance(arm, pp.JointGroup)
    assert arm.arms == {arm.tcp: arm}
    assert arm.tcp_placements(arm.home)["tool0"].isApprox(arm.root_from_base * arm.forward_kinematics(arm.home), 1e-12)


def test_cell_places_each_robot_under_its_own_names(two_ur5) -> None:
    arm = pp.load_robot("ur5").arm()
    q = np.random.default_rng(1).uniform(-2, 2, 12)
    placed = two_ur5.tcp_placements(q)
    assert placed["a"].isApprox(arm.forward_kinematics(q[:6]), 1e-12)
    assert placed["b"].isApprox(MOUNT * arm.forward_kinematics(q[6:]), 1e-12)
    assert two_ur5.joint_names[0] == "a/shoulder_pan_joint"
    assert two_ur5.joint_names[6] == "b/shoulder_pan_joint"
    b = two_ur5.arms["b"]
    assert b.forward_kinematics(q[6:]).isApprox(arm.forward_kinematics(q[6:]), 1e-12)  # relative to its own base
    assert np.allclose(b.root_from_base.homogeneous, MOUNT.homogeneous, atol=1e-12)


def test_ik_of_an_arm_in_a_cell_is_that_of_the_robot_alone(two_ur5) -> None:
    target = pp.pose(xyz=(0.4, 0.2, 0.3), rpy=(np.pi, 0, 0))
    alone = pp.AnalyticIk().solve_all(pp.load_robot("ur5").arm(), target)
    assert np.allclose(pp.AnalyticIk().solve_all(two_ur5.arms["b"], target).q, alone.q, atol=1e-9)


def test_cell_keeps_limits_and_held_joints() -> None:
    panda = pp.load_robot("panda")
    arm = panda.arm(limits={"panda_joint1": (-0.5, 0.5)}, held={"panda_finger_joint1": 0.03})
    cell = pp.assemble({"left": (arm, pin.SE3.Identity()), "ur": (pp.load_robot("ur5").arm(), MOUNT)})
    assert cell.limits.upper[0] == 0.5
    assert cell.held["left/panda_finger_joint1"] == 0.03
    assert cell.held["left/panda_finger_joint2"] == 0.03  # the mimic follower


def test_cell_of_a_robot_with_two_arms_names_each_arm(baxter) -> None:
    cell = pp.assemble({"big": (baxter, pin.SE3.Identity()), "ur": (pp.load_robot("ur5").arm(), MOUNT)})
    assert tuple(cell.ends) == ("big/left", "big/right", "ur")
    assert cell.dof == 20


def test_torques_of_a_cell_are_those_of_its_robots() -> None:
    arm = pp.load_robot("ur5").arm()
    cell = pp.assemble({"a": (arm, pin.SE3.Identity()), "b": (arm, pp.pose(xyz=(2, 0, 0)))})
    q, v = np.random.default_rng(2).uniform(-2, 2, (2, 12))
    expected = np.concatenate([arm.torques(q[:6], v[:6]), arm.torques(q[6:], v[6:])])
    assert np.allclose(cell.torques(q, v), expected, atol=1e-9)
    assert np.allclose(cell.torques_batch(q[None], v[None])[0], expected, atol=1e-9)
    with pytest.raises(pp.InputError, match="a, b"):
        cell.torques(q, payload=pp.Payload(mass=1.0, center_of_mass=(0, 0, 0)))


def test_saved_cell_is_the_same_robot(two_ur5, tmp_path) -> None:
    two_ur5.robot.save_urdf(tmp_path / "cell.urdf")
    again = pp.load_robot(tmp_path / "cell.urdf").arms({"a": "a/tool0", "b": "b/tool0"})
    q = np.random.default_rng(3).uniform(-2, 2, 12)
    for name, pose in again.tcp_placements(q).items():
        assert pose.isApprox(two_ur5.tcp_placements(q)[name], 1e-12)


def test_group_with_other_limits_or_held_joints_has_arms_with_them(baxter) -> None:
    tight = baxter.limits.replace(baxter.joint_names, {"right_s0": (0.0, 0.5)})
    assert baxter.with_limits(tight).arms["right"].limits.upper[0] == 0.5
    assert baxter.with_held({"head_pan": 0.4}).arms["left"].held["head_pan"] == 0.4
    assert baxter.held["head_pan"] == 0.0


def test_group_is_read_only_and_survives_pickle(two_ur5) -> None:
    with pytest.raises(AttributeError, match="read-only"):
        two_ur5.held = {}
    again = pickle.loads(pickle.dumps(two_ur5))
    assert np.array_equal(again.tcp_placements(two_ur5.home)["b"], two_ur5.tcp_placements(two_ur5.home)["b"])


@pytest.mark.parametrize(
    ("arms", "words"),
    [
        (lambda arm: {}, "at least one robot"),
        (lambda arm: {"a/b": (arm, MOUNT)}, "a/b"),
        (lambda arm: {"world": (arm, MOUNT)}, "world"),
        (lambda arm: {"a": arm}, "world_from_base"),
        (lambda arm: {"a": (arm, np.ones((4, 4)))}, "pose of robot 'a'"),
    ],
)
def test_wrong_cells_are_refused(arms, words: str) -> None:
    with pytest.raises(pp.InputError, match=words):
        pp.assemble(arms(pp.load_robot("ur5").arm()))
