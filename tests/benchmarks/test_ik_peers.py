"""Other libraries receive a chain with the same forward kinematics and limits."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.ik_peers import TIP, chain_urdf, screw_axes
from benchmarks.tables import NotApplicableError

import pinproof as pp
from pinproof.errors import ConversionError
from pinproof.model import load_robot

ROBOTS = ("ur5", "panda", "stanford", "kinova", "puma560", "scara")


@pytest.mark.parametrize("name", ROBOTS)
def test_the_chain_urdf_has_the_kinematics_of_the_arm(name: str) -> None:
    arm = pp.load_robot(name).arm()
    chain = load_robot(chain_urdf(arm)).arm(TIP)
    assert list(chain.joint_names) == list(arm.joint_names)
    q = np.random.default_rng(0).uniform(*arm.limits.sampling_range(), (50, arm.dof))
    np.testing.assert_allclose(chain.forward_kinematics_batch(q), arm.forward_kinematics_batch(q), atol=1e-12)
    np.testing.assert_array_equal(chain.limits.lower, arm.limits.lower)
    np.testing.assert_array_equal(chain.limits.upper, arm.limits.upper)


def test_the_product_of_the_screws_is_the_pose() -> None:
    arm = pp.load_robot("ur5").arm()
    axes, q = screw_axes(arm), np.array([0.3, -1.2, 1.4, -0.5, 0.7, 0.2])
    rotation, position = np.eye(3), np.zeros(3)
    for offset, direction, angle in zip(axes.offsets[:-1], axes.directions, q, strict=True):
        position = position + rotation @ offset
        x, y, z = direction
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        rotation = rotation @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
    pose = arm.forward_kinematics(q)
    np.testing.assert_allclose(position + rotation @ axes.offsets[-1], pose.translation, atol=1e-12)
    np.testing.assert_allclose(rotation @ axes.base_from_tcp[:3, :3], pose.rotation, atol=1e-12)


def test_the_geometry_is_recognised() -> None:
    ur5, puma = (screw_axes(pp.load_robot(name).arm()) for name in ("ur5", "puma560"))
    assert ur5.parallel(1, 2, 3)
    assert not ur5.parallel(0, 1)
    assert ur5.intersecting(3, 4, 5) is None
    moved = puma.intersecting(3, 4, 5)
    assert moved is not None
    np.testing.assert_allclose(moved.offsets[4:6], 0.0, atol=1e-6)
    np.testing.assert_allclose(moved.offsets.sum(axis=0), puma.offsets.sum(axis=0), atol=1e-12)


def test_the_points_of_the_axes_are_the_positions_of_the_joints() -> None:
    """By these points, ssik recognises the spherical wrist of the Puma: its last two joints are at the same point."""
    np.testing.assert_allclose(screw_axes(pp.load_robot("puma560").arm()).offsets[5], 0.0, atol=1e-9)


def test_parallel_axes_do_not_intersect() -> None:
    assert screw_axes(pp.load_robot("ur5").arm()).intersecting(1, 2) is None


def test_mimic_joints_are_refused() -> None:
    text = """<robot name="coupled"><link name="a"/><link name="b"/><link name="c"/>
      <joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
      <joint name="two" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/><mimic joint="one"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
    arm = load_robot(text).arm("c")
    with pytest.raises(NotApplicableError, match="mimic"):
        screw_axes(arm)
    with pytest.raises(ConversionError, match="mimic"):
        chain_urdf(arm)
