"""Shifts by 2 pi: same pose, within the limits, closest to the reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.ik.result import difference, nearest_winding


@given(seed=st.integers(0, 10**6))
def test_shifted_configuration_is_within_limits_and_has_the_same_pose(ur5, seed):
    rng = np.random.default_rng(seed)
    q, reference = rng.uniform(ur5.limits.lower, ur5.limits.upper), rng.uniform(-15, 15, 6)
    shifted = nearest_winding(ur5, q, reference)
    assert ur5.limits.contains(shifted)
    assert ur5.forward_kinematics(shifted).isApprox(ur5.forward_kinematics(q), 1e-12)


@given(seed=st.integers(0, 10**6))
def test_no_other_rotation_within_the_limits_is_closer(ur5, seed):
    rng = np.random.default_rng(seed)
    q, reference = rng.uniform(ur5.limits.lower, ur5.limits.upper), rng.uniform(-15, 15, 6)
    shifted = nearest_winding(ur5, q, reference)
    for turns in (-2, -1, 1, 2):
        other = shifted + turns * 2 * np.pi
        inside = (other >= ur5.limits.lower) & (other <= ur5.limits.upper)
        assert (np.abs(other - reference) >= np.abs(shifted - reference) - 1e-12)[inside].all()


def test_panda_joint_6_keeps_its_range(panda):
    q = panda.home
    q[5] = 3.7
    assert nearest_winding(panda, q, np.zeros(7))[5] == 3.7


def test_a_limit_of_2_pi_is_not_exceeded_by_rounding(planar):
    arm = planar(f"{-6 * np.pi!r} {6 * np.pi!r}")
    for q in np.linspace(0, 2 * np.pi, 1000):
        assert arm.limits.contains(nearest_winding(arm, np.array([q]), np.array([100.0])))


def test_many_rows_are_shifted_at_once(ur5):
    rows = np.random.default_rng(0).uniform(-6, 6, (5, 6))
    reference = np.full(6, 3.0)
    # The elbow's range is one turn; the others have two.
    rows[:, 2] = np.clip(rows[:, 2], -3, 3)
    expected = [nearest_winding(ur5, row, reference) for row in rows]
    assert np.array_equal(nearest_winding(ur5, rows, reference), expected)


def test_a_joint_whose_follower_moves_half_as_far_is_not_shifted(planar):
    assert planar("", "").periodic.tolist() == [True, True]
    assert planar("", "", mimic="j1 -2").periodic.tolist() == [True, True]
    arm = planar("", "", mimic="j1 0.5")
    assert arm.periodic.tolist() == [False, True]
    assert nearest_winding(arm, np.array([0.5, 0.5]), np.array([6.5, 6.5])) == pytest.approx([0.5, 0.5 + 2 * np.pi])


def test_the_difference_ignores_full_rotations(ur5):
    a = np.array([6.2, 0, 0, 0, -6.2, 1.0])
    assert difference(ur5, a, np.zeros(6)) == pytest.approx([6.2 - 2 * np.pi, 0, 0, 0, 2 * np.pi - 6.2, 1.0])


def test_solution_uses_the_rotation_closest_to_q0(ur5):
    q0 = np.array([-5.0, -4.0, 1.0, 5.0, 4.0, -6.0])
    target = ur5.forward_kinematics(q0 + 0.05)
    result = pp.Clik().solve(ur5, target, q0=q0)
    assert result.ok
    assert np.abs(result.q - q0).max() < np.pi


def test_continuous_joint_stays_unwrapped_near_q0(planar):
    arm = planar("", "")
    q = np.array([20.0, -15.0])
    result = pp.Clik().solve(arm, arm.forward_kinematics(q), q0=q + 0.1)
    assert result.q == pytest.approx(q, abs=1e-5)
