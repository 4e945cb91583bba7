"""SRDF groups, states and end effectors on a robot: the arm of each, and the error if there is none."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp

LIMIT = '<limit lower="-2" upper="2" velocity="1" effort="1"/>'
TREE = [  # child, parent, joint type
    ("a1", "base", "revolute"), ("a2", "a1", "revolute"), ("a3", "a2", "revolute"), ("flange", "a3", "fixed"),
    ("finger", "flange", "prismatic"), ("b1", "base", "revolute"), ("raft", "base", "floating"),
]  # fmt: skip

SRDF = """<robot name="r">
  <virtual_joint name="world_joint" type="floating" parent_frame="world" child_link="base"/>
  <group name="chain"><chain base_link="a1" tip_link="flange"/></group>
  <group name="joints"><joint name="j_a3"/><joint name="j_a2"/></group>
  <group name="links"><link name="a2"/><link name="a3"/><link name="flange"/></group>
  <group name="hand"><joint name="j_finger"/></group>
  <group name="all"><group name="chain"/><group name="hand"/></group>
  <group name="two"><chain base_link="base" tip_link="a1"/><chain base_link="base" tip_link="b1"/></group>
  <group name="fork"><joint name="j_a1"/><joint name="j_b1"/></group>
  <group name="empty"/>
  <group name="broken"><group name="nowhere"/></group>
  <group name="ghost"><joint name="j_a4"/></group>
  <group name="ghost_chain"><chain base_link="base" tip_link="a4"/></group>
  <end_effector name="gripper" parent_link="flange" group="hand" parent_group="joints"/>
  <group_state name="ready" group="chain"><joint name="j_a2" value="0.5"/><joint name="j_a3" value="-1"/></group_state>
  <group_state name="ready" group="hand"><joint name="j_finger" value="0.1"/></group_state>
  <group_state name="lost" group="all"><joint name="world_joint" value="0 0 1 0 0 0 1"/><joint name="j_a9" value="1"/>
    <joint name="j_a2" value="0"/></group_state>
  <group_state name="torn" group="chain"><joint name="j_a2" value="1"/></group_state>
  <group_state name="torn" group="joints"><joint name="j_a2" value="2"/></group_state>
  <group_state name="afloat" group="all"><joint name="j_raft" value="0 0 0 0 0 0 1"/></group_state>
  <disable_collisions link1="a1" link2="gone" reason="Never"/><disable_default_collisions link="b1"/>
</robot>"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    parts = ['<link name="base"/>']
    for child, parent, kind in TREE:
        parts.append(
            f'<link name="{child}"/><joint name="j_{child}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="0.1 0 0.2"/><axis xyz="0 1 0"/>{LIMIT}</joint>'
        )
    (folder / "r.urdf").write_text(f'<robot name="r">{"".join(parts)}</robot>')
    (folder / "r.srdf").write_text(SRDF)
    return pp.load_robot(folder / "r.urdf", srdf=folder / "r.srdf")


@pytest.mark.parametrize(
    ("group", "base", "tcp", "joints"),
    [
        ("chain", "a1", "flange", ("j_a2", "j_a3")),
        ("joints", "a1", "flange", ("j_a2", "j_a3")),  # in any order; the end effector's link wins over the last child
        ("links", "a1", "flange", ("j_a2", "j_a3")),  # a link brings the joint that carries it
        ("hand", "flange", "finger", ("j_finger",)),
        ("all", "a1", "flange", ("j_a2", "j_a3")),
    ],
)
def test_group_defines_base_and_tcp(robot, group, base, tcp, joints):
    arm = robot.arm(group=group)
    assert (arm.base, arm.tcp, arm.joint_names) == (base, tcp, joints)


@pytest.mark.parametrize(
    ("group", "message"),
    [
        ("two", r"has the chains .*select one with base and tcp"),
        ("fork", r"is not a chain: joint 'j_.1' is not on the path"),
        ("empty", "no chain, no joints and no moving links"),
        ("broken", "unknown subgroup 'nowhere'"),
        ("ghost", "unknown joint 'j_a4' in group 'ghost' of the SRDF; valid: j_a"),
        ("ghost_chain", "unknown link 'a4' in group 'ghost_chain' of the SRDF; valid: a"),
        ("chian", "unknown group 'chian' in the SRDF of robot 'r'; valid: chain"),
    ],
)
def test_group_that_is_not_a_chain_is_refused(robot, group, message):
    with pytest.raises(pp.InputError, match=message):
        robot.arm(group=group)


def test_tcp_and_base_precede_the_group(robot):
    arm = robot.arm("a3", group="chain", base="base")
    assert (arm.base, arm.tcp) == ("base", "a3")


def test_state_combines_the_groups_of_its_name(robot):
    assert robot.state("ready") == {"j_a2": 0.5, "j_a3": -1.0, "j_finger": 0.1}
    assert robot.state("ready", group="hand") == {"j_finger": 0.1}


def test_state_in_the_order_of_the_arm(robot):
    assert robot.arm(group="chain").state("ready").tolist() == [0.5, -1.0]


@pytest.mark.parametrize(
    ("name", "group", "message"),
    [
        ("redy", None, "unknown state 'redy' in the SRDF of robot 'r'; valid: ready"),
        ("ready", "fork", "unknown state 'ready'"),
        ("torn", None, "'j_a2' different values; name its group="),
        ("afloat", None, "joint 'j_raft' 7 numbers"),
    ],
)
def test_an_invalid_state_is_refused(robot, name, group, message):
    with pytest.raises(pp.InputError, match=message):
        robot.state(name, group=group)


def test_state_without_a_value_for_a_joint_is_refused(robot):
    assert robot.state("lost") == {"j_a2": 0.0}
    with pytest.raises(pp.InputError, match="no value for the joints j_a3"):
        robot.arm(group="chain").state("lost")


def test_notes_list_unknown_names_of_the_srdf(robot):
    notes = "\n".join(robot.notes)
    for words in (
        "disables 1 pairs with links that the robot does not have: gone",
        "group 'broken' contains undefined groups: nowhere",
        "group 'ghost' refers to links or joints that do not exist: j_a4",
        "group 'ghost_chain' refers to links or joints that do not exist: a4",
        "state 'lost' refers to joints that do not exist: world_joint, j_a9",
        "disables all pairs of b1 by default; they are checked",
    ):
        assert words in notes


def test_a_floating_joint_outside_the_arm_is_fixed(robot):
    arm = robot.arm(group="chain")
    placement = arm.robot.arm("a3").frame_placement([0.1, 0.2, 0.3], "raft")
    assert placement.translation.tolist() == [0.1, 0, 0.2]
    with pytest.raises(pp.InputError, match="'j_raft' is floating; it is fixed at its neutral configuration"):
        robot.arm(group="chain", held={"j_raft": 1.0})


# Joint groups: several arms of one robot, and cells of several robots.


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


@pytest.mark.parametrize(
    ("robot", "arms", "error", "named"),
    [
        ("baxter_left", ("left", "rigt"), pp.UnknownNameError, "rigt"),
        ("baxter_left", ("left", "left"), pp.InputError, "twice"),
        ("baxter_left", ({"one": "left_gripper", "two": "left"},), pp.InputError, "same tcp"),
        ("baxter_left", (3,), pp.InputError, "3"),
        ("ur5", (), pp.InputError, "declares no arms"),
        (
            "pr2_left",  # both would move the shoulder, without a base above it
            ("l_wrist_roll_link", "l_gripper_tool_frame"),
            pp.InputError,
            "l_shoulder_pan_joint.*'l_wrist_roll_link' and 'l_gripper_tool_frame'",
        ),
    ],
)
def test_wrong_arms_are_refused(robot: str, arms: tuple[str, ...], error: type[Exception], named: str) -> None:
    with pytest.raises(error, match=named):
        pp.load_robot(robot).arms(*arms)


def test_linear_axis_before_the_arm_is_a_joint_of_the_group() -> None:
    arm = pp.load_robot("tiago_dual_left").arm("hand_left_grasping_frame", base="torso_fixed_link")
    assert arm.joint_names[0] == "torso_lift_joint"
    assert not arm.angular[0]
    assert arm.dof == 8


def test_arm_is_the_group_of_itself() -> None:
    arm = pp.load_robot("ur5").arm()
    assert isinstance(arm, pp.model.JointGroup)
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
