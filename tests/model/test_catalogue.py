"""Every robot of the catalogue loads, has the intended arm and a collision-free home; dual arms share a body."""

from __future__ import annotations

import functools
import re
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import robot_table

import pinproof as pp
from pinproof.collision.checking.links import Overlaps
from pinproof.description import catalogue_names, find_robot
from pinproof.description.ros_files import example_robot_data

NAMED = {
    "generic_6dof", "ur3", "ur5", "ur10", "panda", "iiwa14", "puma560", "stanford", "scara", "irb120", "xarm7",
    "kinova", "z1", "so100", "so101", "baxter_left", "baxter_right", "tiago", "tiago_dual_left", "tiago_pro_right",
    "pr2_left", "talos_left", "xarm6", "crx10ia", "m0609", "jaco2", "piper", "gen3_lite",
}  # fmt: skip

FILES = {name: (find_robot(name).urdf, find_robot(name).srdf) for name in catalogue_names()}


def test_the_promised_names_are_there():
    assert set(catalogue_names()) >= NAMED


@functools.cache
def robot_of(urdf, srdf):
    """The catalogue's robot of these files, whose collision bodies all arms share."""
    return pp.load_robot(next(name for name in catalogue_names() if FILES[name] == (urdf, srdf)))


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(catalogue_names(), key=lambda name: str(FILES[name])))
def test_the_robot_is_complete_and_its_home_is_collision_free(name):
    entry, robot = find_robot(name), pp.load_robot(name)
    arm = robot.arm()
    assert arm.tcp == entry.tcp
    assert arm.base == (entry.base or robot.urdf.root)
    assert set(arm.joint_names) <= set(entry.home) <= set(robot.urdf.joints)
    assert arm.limits.contains(np.array([entry.home[joint] for joint in arm.joint_names]))
    for joint, value in arm.held.items():
        lower, upper = robot.urdf.joints[joint].lower, robot.urdf.joints[joint].upper
        assert (-np.inf if lower is None else lower) <= value <= (np.inf if upper is None else upper), joint
    held = {joint: value for joint, value in arm.held.items() if robot.urdf.joints[joint].mimic is None}
    same = robot_of(*FILES[name]).arm(arm.tcp, base=arm.base, held=held)
    assert (same.joint_names, same.held) == (arm.joint_names, arm.held)
    assert pp.CollisionChecker(same).check(arm.home).contacts == ()
    assert not [note for note in robot.notes if "not found" in note]


@pytest.mark.parametrize("name", catalogue_names())
def test_overlaps_are_links_of_the_robot(name):
    links = pp.load_robot(name).urdf.links
    assert all(link in links for pair in find_robot(name).overlaps for link in pair)


@pytest.mark.parametrize("family", ["alex", "baxter", "g1", "pr2", "romeo", "talos", "tiago_dual", "tiago_pro"])
@pytest.mark.slow
def test_arms_of_a_dual_arm_robot_hold_each_other(family):
    left, right = (pp.load_robot(f"{family}_{side}").arm() for side in ("left", "right"))
    assert not set(left.joint_names) & set(right.joint_names)
    assert [left.held[joint] for joint in right.joint_names] == right.home.tolist()
    data = dict(zip(right.joint_names, right.limits.clip(right.home + 0.1), strict=True))
    moved = left.robot.arm(held=data)
    assert [moved.held[joint] for joint in right.joint_names] == list(data.values())
    before, after = (arm.frame_placement(left.home, right.tcp) for arm in (left, moved))
    assert not before.isApprox(after, 1e-3)
    assert left.frame_placement(left.home, left.tcp).isApprox(moved.forward_kinematics(left.home), 1e-12)


def test_a_tcp_outside_the_default_base_replaces_the_default():
    robot = pp.load_robot("tiago")
    assert robot.arm().base == "torso_lift_link"
    assert robot.arm("torso_lift_link").base == "base_footprint"
    assert robot.arm(base="base_link").dof == 8


def test_a_robot_of_a_missing_package_names_the_package(monkeypatch):
    monkeypatch.setattr("pinproof.description.catalogue.example_robot_data", lambda: None)
    with pytest.raises(pp.InputError, match="'ur5' requires example-robot-data: pip install example-robot-data"):
        pp.load_robot("ur5")


def test_meshes_named_with_three_slashes_are_found():
    file = example_robot_data() / "example-robot-data/robots/talos_data/robots/talos_full_v2.urdf"
    assert pp.load_robot(file).notes == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", {find_robot(name).urdf: name for name in FILES if find_robot(name).overlaps}.values())
def test_overlaps_are_contacts_that_the_srdf_does_not_disable(name, monkeypatch):
    # Pairs that touch in all of the first 50 samples are left out; to sample them 1,950 times more would spare some.
    monkeypatch.setattr(Overlaps.__init__, "__defaults__", (50, 50))
    entry = find_robot(name)
    arm = pp.load_robot(entry.urdf, srdf=entry.srdf).arm(entry.tcp, base=entry.base)
    touching = {frozenset(contact.bodies) for contact in pp.CollisionChecker(arm).check(arm.home).contacts}
    spine_of_alex = {frozenset(("SpineYawLink", "Torso"))}  # touches by its hulls only
    assert {frozenset(pair) for pair in entry.overlaps} - spine_of_alex <= touching


# docs/robots.md: its tables agree with the readers, and its example runs.


ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "robots.md"


@pytest.mark.slow
def test_tables_are_what_the_script_writes():
    text = PAGE.read_text(encoding="utf-8")
    written_with = re.search(r"^example-robot-data (\S+):$", text, re.MULTILINE)
    assert written_with is not None
    if written_with.group(1) != version("example-robot-data"):
        pytest.skip(f"the tables are of example-robot-data {written_with.group(1)}")
    assert robot_table.page(text) == text, "run scripts/robot_table.py"


def test_example_runs():
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(block, names)
    assert names["left"].held["right_s0"] == -1.0
    assert names["arm"].dof == 7
