"""SRDF groups, states and end effectors on a robot: the arm of each, and the error if there is none."""

from __future__ import annotations

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
