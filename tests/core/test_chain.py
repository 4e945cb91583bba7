"""The compiled chain against Pinocchio, for every kind of joint, axis and coupling."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof import _core
from pinproof.model import load_robot

from ..examples import examples

NAMES = ["ur5", "panda", "iiwa14", "xarm7", "kinova", "stanford", "scara", "puma560", "so100"]


def evaluate(arm, q, start):
    """``start`` times base_from_tcp, and the Jacobian in the axes of ``start``."""
    end, jacobian = arm.chain.evaluate(q, start)
    return end[:3], jacobian


@st.composite
def chains(draw):
    """1 to 10 joints of any kind and axis, some of them mimic joints; random base and tcp."""
    number = st.floats(-2, 2, allow_nan=False)
    triple = st.tuples(number, number, number)
    count = draw(st.integers(1, 10))
    parts = ['<robot name="r"><link name="l0"/>']
    for i in range(1, count + 1):
        xyz, rpy = (" ".join(map(str, draw(triple))) for _ in range(2))
        axis = draw(triple.filter(lambda v: np.linalg.norm(v) > 1e-2))
        kind = draw(st.sampled_from(["revolute", "continuous", "prismatic"]))
        limit = "" if kind == "continuous" else '<limit lower="-3" upper="3" velocity="1" effort="1"/>'
        follows = draw(st.integers(0, i - 1)) if draw(st.integers(0, 3)) == 0 else 0
        mimic = f'<mimic joint="j{follows}" multiplier="{draw(number)}" offset="{draw(number)}"/>' if follows else ""
        parts.append(
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{" ".join(map(str, axis))}"/>{limit}{mimic}</joint>'
        )
    parts.append("</robot>")
    return "".join(parts)


@pytest.mark.parametrize("name", NAMES)
def test_equals_pinocchio_on_real_arms(name):
    arm = pp.load_robot(name).arm()
    rng = np.random.default_rng(5)
    for q in rng.uniform(*arm.limits.sampling_range(), (50, arm.dof)):
        end, jacobian = evaluate(arm, q, np.eye(4))
        assert end == pytest.approx(arm.forward_kinematics(q).homogeneous[:3], abs=1e-12)
        assert jacobian == pytest.approx(arm.jacobian(q), abs=1e-12)


@examples(60)
@given(urdf=chains(), seed=st.integers(0, 10**6))
def test_equals_pinocchio_on_any_chain(urdf, seed):
    try:
        robot = load_robot(urdf)
    except pp.errors.UrdfError:  # a follower of a follower
        return
    arm = robot.arm(tcp=f"l{urdf.count('<joint ')}")
    rng = np.random.default_rng(seed)
    q, start = rng.uniform(-3, 3, arm.dof), pp.pose(rng.normal(size=3), rng.normal(size=3)).homogeneous
    end, jacobian = evaluate(arm, q, start)
    size = 1 + np.abs(arm.forward_kinematics(q).translation).max()
    assert end == pytest.approx((start @ arm.forward_kinematics(q).homogeneous)[:3], abs=1e-12 * size)
    turned = np.kron(np.eye(2), start[:3, :3]) @ arm.jacobian(q)
    assert jacobian == pytest.approx(turned, abs=1e-12 * (1 + np.abs(turned).max()))


def test_jacobian_is_the_finite_difference_of_the_pose():
    arm, step = pp.load_robot("panda").arm(), 1e-6
    q = np.random.default_rng(1).uniform(*arm.limits.sampling_range())
    end, jacobian = evaluate(arm, q, np.eye(4))
    for j in range(arm.dof):
        shift = np.eye(arm.dof)[j] * step
        difference = (evaluate(arm, q + shift, np.eye(4))[0] - evaluate(arm, q - shift, np.eye(4))[0]) / (2 * step)
        spin = difference[:, :3] @ end[:, :3].T
        rate = [*difference[:, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
        assert rate == pytest.approx(jacobian[:, j], abs=1e-8)


def test_batches_equal_single_rows():
    arm = pp.load_robot("stanford").arm()
    Q = np.random.default_rng(2).uniform(*arm.limits.sampling_range(), (7, arm.dof))
    single = np.array([arm.forward_kinematics(q).homogeneous for q in Q])
    assert arm.forward_kinematics_batch(Q) == pytest.approx(single, abs=1e-12)
    volumes = [np.sqrt(np.linalg.det(J @ J.T)) for J in map(arm.jacobian, Q)]
    assert arm.chain.manipulability_batch(Q) == pytest.approx(volumes, rel=1e-6)


@given(st.floats(-7e5, 7e5))
def test_sine_and_cosine_equal_the_c_library(angle):
    about_z = _core.Chain([_core.Joint(np.eye(4), False, 0, 1.0, 0.0)], np.eye(4), 1)
    cosine, sine = about_z.forward_batch(np.array([[angle]]))[0, :2, 0]
    assert (sine, cosine) == pytest.approx((np.sin(angle), np.cos(angle)), rel=0, abs=2.3e-16)


def test_large_angles_are_as_accurate_as_small_ones():
    arm = pp.load_robot("ur5").arm()
    q = np.array([1e9, -3e7, 0.1, 1e6, -2.0, 5e5])
    assert arm.forward_kinematics_batch(q[None])[0] == pytest.approx(arm.forward_kinematics(q).homogeneous, abs=1e-12)


def test_a_pickled_chain_is_the_same():
    arm = pp.load_robot("panda").arm()
    copy = pickle.loads(pickle.dumps(arm.chain))
    Q = np.random.default_rng(3).uniform(*arm.limits.sampling_range(), (5, arm.dof))
    assert (copy.forward_batch(Q) == arm.chain.forward_batch(Q)).all()


def test_arrays_of_a_wrong_size_are_refused():
    chain = pp.load_robot("ur5").arm().chain
    with pytest.raises(ValueError, match=r"configurations has shape \(2, 5\), expected \(N, 6\)"):
        chain.forward_batch(np.zeros((2, 5)))
    with pytest.raises(ValueError, match=r"start has shape \(3, 3\), expected \(4, 4\)"):
        chain.evaluate(np.zeros(6), np.eye(3))
