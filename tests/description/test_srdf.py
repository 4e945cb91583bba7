"""SRDF: groups, states, end effectors and disabled pairs."""

from __future__ import annotations

import pytest

import pinproof as pp
from pinproof.description import find_robot, read_srdf
from pinproof.description.ros_files import example_robot_data

TEXT = """<robot name="r">
  <group name="arm"><chain base_link="base" tip_link="tip"/></group>
  <group name="hand"><joint name="finger"/></group>
  <group name="all"><joint name="track"/><group name="arm"/><group name="hand"/></group>
  <group_state name="ready" group="arm"><joint name="j1" value="0.5"/></group_state>
  <end_effector name="gripper" parent_link="tip" group="hand" parent_group="arm"/>
  <disable_collisions link1="a" link2="b" reason="Never"/>
  <disable_collisions link1="a" link2="c"/>
</robot>"""


def read(tmp_path, text):
    file = tmp_path / "r.srdf"
    file.write_text(text)
    return read_srdf(file)


def test_srdf_is_kept_as_written(tmp_path):
    srdf = read(tmp_path, TEXT)
    assert srdf.groups["arm"].chains == (("base", "tip"),)
    assert srdf.groups["all"].joints == ("track", "finger")
    assert srdf.groups["all"].chains == (("base", "tip"),)
    assert [(s.name, s.group, s.joints) for s in srdf.states] == [("ready", "arm", {"j1": (0.5,)})]
    assert [(e.parent_link, e.group) for e in srdf.end_effectors] == [("tip", "arm")]
    assert [(p.links, p.reason) for p in srdf.disabled] == [(("a", "b"), "Never"), (("a", "c"), "")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot><group/></robot>", "line 1.*name"),
        (
            '<robot><group name="a"><group name="b"/></group><group name="b"><group name="a"/></group></robot>',
            "a -> b -> a",
        ),
        ('<robot><group_state name="s"><joint name="j" value="x"/></group_state></robot>', "not numeric"),
        ('<robot><disable_collisions link1="a"/></robot>', "link2"),
        ("<launch/>", "<launch>, not <robot>"),
        ("<robot>", "well-formed"),
    ],
)
def test_invalid_srdf_is_refused(tmp_path, text, message):
    with pytest.raises(pp.errors.UrdfError, match=message):
        read(tmp_path, text)


def test_urdf_in_place_of_an_srdf_is_refused():
    with pytest.raises(pp.errors.UrdfError, match=r"line \d+: contains links: this is a URDF, not an SRDF"):
        read_srdf(find_robot("ur5").urdf)


def test_a_missing_subgroup_invalidates_only_the_groups_that_contain_it(tmp_path):
    text = '<robot><group name="a"><group name="b"/></group><group name="c"><joint name="j"/></group></robot>'
    groups = read(tmp_path, text).groups
    assert (groups["a"].missing, groups["c"].missing, groups["c"].joints) == (("b",), (), ("j",))


def test_names_are_trimmed(tmp_path):
    assert set(read(tmp_path, '<robot><group name=" arm "><joint name="j"/></group></robot>').groups) == {"arm"}


def test_panda_group_gives_base_and_tcp():
    entry = find_robot("panda")
    assert entry.srdf is not None
    robot = pp.load_robot("panda")
    arm = robot.arm(group="arm")
    assert (arm.base, arm.tcp, arm.dof) == ("panda_link0", "panda_hand_tcp", 7)
    with pytest.raises(pp.UnknownNameError, match="valid: arm"):
        robot.arm(group="am")


def test_a_name_of_two_groups_keeps_both_states(tmp_path):
    text = """<robot name="r">
      <group_state name="home" group="arm"><joint name="j" value="1"/></group_state>
      <group_state name="home" group="hand"><joint name="f" value="2"/></group_state></robot>"""
    assert [(s.group, dict(s.joints)) for s in read(tmp_path, text).states] == [
        ("arm", {"j": (1.0,)}),
        ("hand", {"f": (2.0,)}),
    ]


def test_joint_of_several_numbers_is_read(tmp_path):
    text = '<robot name="r"><group_state name="s"><joint name="root" value=" 0 0 1  0 0 0 1."/></group_state></robot>'
    assert read(tmp_path, text).states[0].joints["root"] == (0, 0, 1, 0, 0, 0, 1)


def test_pair_that_is_enabled_by_name_is_not_disabled(tmp_path):
    text = """<robot name="r"><disable_default_collisions link="c"/>
      <disable_collisions link1="a" link2="b"/><disable_collisions link1="a" link2="c"/>
      <enable_collisions link1="b" link2="a"/></robot>"""
    srdf = read(tmp_path, text)
    assert [pair.links for pair in srdf.disabled] == [("a", "c")]
    assert srdf.disabled_links == ("c",)


def test_deeply_nested_subgroups_are_read_quickly(tmp_path):
    levels = [
        f'<group name="g{i}">' + (f'<group name="g{i + 1}"/>' * 2 if i < 60 else '<joint name="j"/>') + "</group>"
        for i in range(61)
    ]
    assert read(tmp_path, f'<robot name="r">{"".join(levels)}</robot>').groups["g0"].joints == ("j",)


@pytest.mark.parametrize("file", sorted(example_robot_data().rglob("*.srdf")), ids=lambda file: file.stem)
def test_every_srdf_of_example_robot_data_is_read(file):
    srdf = read_srdf(file)
    assert srdf.groups or srdf.disabled
