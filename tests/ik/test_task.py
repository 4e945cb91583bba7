"""Residuals and their Jacobians against finite differences, and the verdict against known rotations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.ik.task import make_task
from pinproof.ik.verdict import judge

HALF_STEP = 1e-6


@pytest.mark.parametrize("name", ["pose", "position", "orientation"])
@given(seed=st.integers(0, 10**6))
def test_jacobian_is_the_derivative_of_the_residual(panda, name, seed):
    rng = np.random.default_rng(seed)
    lower, upper = panda.limits.lower, panda.limits.upper
    q = rng.uniform(lower, upper)
    # Targets up to 2.5 rad away: at pi the logarithm itself jumps.
    off = rng.normal(size=3)
    off *= rng.uniform(0, 2.5) / np.linalg.norm(off)
    half, angle = off / 2, np.linalg.norm(off) / 2
    quaternion = [*(half / angle * np.sin(angle)), np.cos(angle)]
    target = panda.forward_kinematics(q) * pp.pose(rng.uniform(-1, 1, 3), quat_xyzw=quaternion)
    task = make_task(name, 1e-6, 1e-6)

    def residual(q):
        return task.residual(target.actInv(panda.forward_kinematics(q)))

    base_from_tcp, local = panda.local_jacobian(q)
    analytic = task.jacobian(target.actInv(base_from_tcp), local)
    steps = HALF_STEP * np.eye(panda.dof)
    numeric = np.stack([(residual(q + s) - residual(q - s)) / (2 * HALF_STEP) for s in steps], axis=1)
    assert np.abs(analytic - numeric).max() < 1e-7


def test_pose_residual_is_the_negative_logarithm_of_the_way_to_the_target(ur5):
    from pinproof.spatial import log6

    q = np.array([0.3, -1.0, 1.2, 0.4, 0.9, -0.2])
    base_from_tcp, target = ur5.forward_kinematics(q), pp.pose((0.3, 0.2, 0.5), (0.3, 0.2, 0.1))
    residual = make_task("pose", 1e-6, 1e-6).residual(target.actInv(base_from_tcp))
    assert residual == pytest.approx(-log6(base_from_tcp.actInv(target)), abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-6, 0.5, 3.0, np.pi - 1e-9, np.pi])
def test_verdict_measures_angles_of_every_size(ur5, angle):
    q = ur5.home
    target = ur5.forward_kinematics(q) * pp.pose(
        (3e-4, 4e-4, 0), quat_xyzw=[0, np.sin(angle / 2), 0, np.cos(angle / 2)]
    )
    position_error, orientation_error = judge(ur5, target, make_task("pose", 1, 1), q, q).errors
    assert position_error == pytest.approx(5e-4, abs=1e-15)
    assert orientation_error == pytest.approx(angle, rel=1e-9, abs=3e-16)


def test_unknown_task_names_the_valid_ones(ur5):
    with pytest.raises(pp.UnknownNameError, match=r"pose.*position.*orientation"):
        pp.Clik().solve(ur5, pp.pose(), task="posse")
