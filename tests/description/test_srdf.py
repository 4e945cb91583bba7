"""SRDF: groups, states, end effectors and disabled pairs."""

from __future__ import annotations

import pytest

import pinproof as pp
from pinproof.description import find_robot, read_srdf

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
    assert srdf.groups["arm"].chain == ("base", "tip")
    assert srdf.groups["all"].joints == ("track", "finger")
    assert srdf.groups["all"].chain == ("base", "tip")
    assert srdf.states == {"ready": {"j1": 0.5}}
    assert [(e.parent_link, e.group) for e in srdf.end_effectors] == [("tip", "arm")]
    assert [(p.links, p.reason) for p in srdf.disabled] == [(("a", "b"), "Never"), (("a", "c"), "")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot><group/></robot>", "line 1.*name"),
        ('<robot><group name="a"><group name="b"/></group></robot>', "unknown group 'b'"),
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
def test_what_makes_no_sense_is_refused(tmp_path, text, message):
    with pytest.raises(pp.UrdfError, match=message):
        read(tmp_path, text)


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
