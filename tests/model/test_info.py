"""The description of a robot is complete, has plain values, and lists what is missing."""

from __future__ import annotations

import json

import pytest

import pinproof as pp
from pinproof.model import load_robot


@pytest.fixture(scope="module")
def zoo(zoo_text):
    robot = load_robot(zoo_text)
    return robot.info(robot.arm("tool", held={"finger": 0.02}))


def test_joints_have_their_roles(zoo):
    roles = {joint.name: joint.role for joint in zoo.joints}
    assert roles == {
        "slide": "arm", "turn": "arm", "lift": "arm", "lift_follower": "follower", "wrist": "arm",
        "tool_joint": "fixed", "rod": "follower", "finger": "held", "thumb": "held",
    }  # fmt: skip
    joints = {joint.name: joint for joint in zoo.joints}
    assert (joints["finger"].held_at, joints["thumb"].held_at) == (0.02, 0.02)
    assert joints["lift_follower"].mimic == "-0.5 * lift + 0.3"
    assert joints["turn"].lower is None


def test_limits_are_those_in_use():
    robot = pp.load_robot("ur5")
    info = robot.info(robot.arm(limits={"elbow_joint": (-1, 1)}))
    (elbow,) = [joint for joint in info.joints if joint.name == "elbow_joint"]
    assert (elbow.lower, elbow.upper, elbow.velocity, elbow.acceleration) == (-1, 1, 3.15, 6.3)


def test_dictionary_is_json_without_nan(zoo):
    for info in (zoo, pp.load_robot("baxter_left").info()):
        words = json.loads(json.dumps(info.to_dict(), allow_nan=False))
        assert words["dof"] == info.dof
        assert [joint["name"] for joint in words["joints"]] == [joint.name for joint in info.joints]
        assert len(words["disabled_pairs"]) == len(info.disabled_pairs)


def test_geometries_and_pairs_are_counted():
    robot = pp.load_robot("panda")
    info = robot.info(robot.arm())
    assert sum(info.collisions.values()) == len(robot.urdf.collisions) == 17
    assert len(info.disabled_pairs) == len(robot.srdf.disabled) == 35
    assert (info.groups, info.states) == (("arm", "hand", "arm_and_hand"), ("default",))


def test_missing_parts_are_named(zoo):
    missing = "\n".join(zoo.missing)
    for words in ("no SRDF", "no collision geometry", "no velocity limit: turn", "(continuous): turn", "no home"):
        assert words in missing
    assert any("no acceleration limits" in words for words in zoo.missing)


def test_links_with_visual_geometry_only_are_named():
    robot = pp.load_robot("z1")
    assert "no collision geometry, only visual: link01, link05" in robot.info(robot.arm()).missing


def test_missing_meshes_are_named(tmp_path):
    file = tmp_path / "r.urdf"
    file.write_text(
        '<robot name="r"><link name="a"/><link name="b"><collision><geometry><mesh filename="package://p/gone.stl"/>'
        '</geometry></collision></link><joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
        '<limit lower="-1" upper="1"/></joint></robot>'
    )
    robot = pp.load_robot(file)
    assert robot.notes == ("1 collision mesh was not found: package://p/gone.stl",)
    assert robot.notes[0] in robot.info(robot.arm("b")).missing
    with pytest.raises(pp.errors.MeshError, match=r"the mesh of link 'b' was not found; .*contains 'p'.*; tried:\n"):
        pp.CollisionChecker(robot.arm("b"))
