"""The class of a chain: spherical wrists, parallel axes, prismatic joints, and near misses of these."""

from __future__ import annotations

import pytest

import pinproof as pp
from pinproof.model import kinematic_class, load_robot


def arm(joints):
    """A chain of (type, origin xyz, axis) joints."""
    text = '<link name="l0"/>'
    for i, (kind, xyz, axis) in enumerate(joints, start=1):
        text += (
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{xyz}" rpy="0.1 0.2 0.3"/><axis xyz="{axis}"/><limit lower="-2" upper="2"/></joint>'
        )
    return load_robot(f'<robot name="r">{text}</robot>').arm(f"l{len(joints)}")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("ur5", "6 revolute joints (RRRRRR): three parallel axes (joints 2, 3, 4)"),
        ("kinova", "6 revolute joints (RRRRRR): spherical wrist (joints 4, 5, 6)"),
        ("xarm7", "7 revolute joints (RRRRRRR): spherical shoulder (joints 1, 2, 3); redundant by 1"),
        ("talos_left", "7 revolute joints (RRRRRRR): spherical wrist (joints 5, 6, 7); redundant by 1"),
    ],
)
def test_known_arms(name, text):
    assert kinematic_class(pp.load_robot(name).arm()) == text


def test_prismatic_joints_are_counted_beside_a_wrist():
    text = kinematic_class(pp.load_robot("stanford").arm())
    assert text == "5 revolute and 1 prismatic joints (RRPRRR): spherical wrist (joints 4, 5, 6)"


def test_all_axes_of_a_scara_are_parallel():
    assert "RRPR): all axes parallel; fewer than six joints" in kinematic_class(pp.load_robot("scara").arm())


@pytest.mark.parametrize(("offset", "found"), [(0.0, True), (1e-7, True), (1e-3, False)])
def test_an_offset_wrist_is_not_spherical(offset, found):
    wrist = [("revolute", "0 0 0", "0 0 1"), ("revolute", f"{offset} 0 0", "0 1 0"), ("revolute", "0 0 0", "0 0 1")]
    joints = [("revolute", "0.3 0.1 0.4", axis) for axis in ("0 0 1", "0 1 0", "1 0 0")] + wrist
    assert ("spherical wrist (joints 4, 5, 6)" in kinematic_class(arm(joints))) is found


@pytest.mark.parametrize(("lean", "found"), [(0.0, True), (4e-6, True), (1e-2, False)])
def test_tilted_axes_are_not_parallel(lean, found):
    joints = [("revolute", "0.3 0 0", "0 0 1")] * 4
    plain = '<origin xyz="0.3 0 0" rpy="0 0 0.3"/>'
    text = '<link name="l0"/>'
    for i, (kind, _, _) in enumerate(joints, start=1):
        origin = plain if i < 3 else plain.replace('rpy="0', f'rpy="{lean}')
        text += (
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'{origin}<axis xyz="0 0 1"/><limit lower="-2" upper="2"/></joint>'
        )
    chain = load_robot(f'<robot name="r">{text}</robot>').arm("l4")
    assert ("all axes parallel" in kinematic_class(chain)) is found


def test_a_general_chain_is_reported_as_such():
    joints = [("revolute", "0.3 0.1 0.4", axis) for axis in ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "1 0 0")]
    assert kinematic_class(arm(joints)).endswith("no three neighbouring axes intersect in a point or are parallel")


def test_mimic_joint_on_the_chain_is_named(zoo_text):
    zoo = load_robot(zoo_text).arm("tool")
    assert kinematic_class(zoo).endswith("coupled by mimic joints on the chain")
