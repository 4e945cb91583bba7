"""Targets are reachable, inside the limits, reproducible, and smooth along a trajectory."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.ik_methods import PERIOD
from benchmarks.ik_run import random_targets, smooth_targets, with_reduced_ranges

import pinproof as pp

ROBOTS = ("ur5", "panda", "kinova", "scara")


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("make", [random_targets, smooth_targets])
def test_targets_are_poses_of_configurations_inside_the_limits(name: str, make) -> None:
    arm = with_reduced_ranges(pp.load_robot(name).arm())
    targets = make(arm, 30, 3)
    assert all(arm.limits.contains(q) for q in [*targets.q, targets.start])
    np.testing.assert_array_equal(targets.poses, arm.forward_kinematics_batch(targets.q))


@pytest.mark.parametrize("make", [random_targets, smooth_targets])
def test_targets_depend_on_the_seed(make) -> None:
    arm = pp.load_robot("panda").arm()
    np.testing.assert_array_equal(make(arm, 9, 1).q, make(arm, 9, 1).q)
    assert np.abs(make(arm, 9, 1).q - make(arm, 9, 2).q).max() > 0.1


@pytest.mark.parametrize("name", ROBOTS)
def test_the_trajectory_keeps_the_velocity_limits_and_moves_every_joint(name: str) -> None:
    arm = with_reduced_ranges(pp.load_robot(name).arm())
    q = smooth_targets(arm, 10_000, 0).q
    speed = np.abs(np.diff(q, axis=0)).max(axis=0) / PERIOD
    assert (speed <= np.where(np.isnan(arm.limits.velocity), np.inf, arm.limits.velocity)).all()
    assert (np.ptp(q, axis=0) > 0).all()


def test_only_ranges_wider_than_one_rotation_are_reduced() -> None:
    ur5 = pp.load_robot("ur5").arm()
    assert ur5.limits.upper.max() > 6.0
    np.testing.assert_allclose(with_reduced_ranges(ur5).limits.upper, np.pi, atol=1e-8)
    np.testing.assert_allclose(with_reduced_ranges(ur5).limits.lower, -np.pi, atol=1e-8)
    panda, kinova = (pp.load_robot(name).arm() for name in ("panda", "kinova"))
    np.testing.assert_array_equal(with_reduced_ranges(panda).limits.upper, panda.limits.upper)
    unbounded = np.isinf(kinova.limits.upper)
    assert unbounded.any()
    assert np.isinf(with_reduced_ranges(kinova).limits.upper[unbounded]).all()
