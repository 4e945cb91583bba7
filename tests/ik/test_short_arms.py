"""Arms with fewer than six joints whose description is rounded: they reach the poses that the exact arm would reach.

The SO-ARM100 states 1.57079 for pi/2, which turns its tool by some 1e-6 rad out of the vertical plane through its base.
"""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.ik import IkStatus, ReachStatus

TIP = pp.pose([0.0, -0.09, 0.0], [np.pi / 2, 0.0, 0.0])
"""tcp_from_tip: the z axis of the tip is the axis about which the last joint turns."""


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return pp.load_robot("so100").arm()


@pytest.fixture(scope="module")
def upright(arm: pp.Arm) -> list[np.ndarray]:
    """Poses ``base_from_tcp`` in which the tip points exactly down, near configurations in the middle of the limits."""
    low, high = arm.limits.lower, arm.limits.upper
    many = np.random.default_rng(0).uniform(low + 0.2 * (high - low), high - 0.2 * (high - low), (8000, arm.dof))
    tips = arm.forward_kinematics_batch(many) @ TIP.homogeneous
    near = tips[tips[:, 2, 2] < -0.9999]
    assert len(near) >= 3
    turns = np.arctan2(near[:, 1, 0], near[:, 0, 0])
    return [
        (pp.pose(tip[:3, 3], [np.pi, 0.0, turn]) * TIP.inverse()).homogeneous
        for tip, turn in zip(near, turns, strict=True)
    ]


@pytest.mark.parametrize(
    "method", [pp.Clik(), pp.AnalyticIk(), pp.DampedLeastSquares()], ids=lambda m: type(m).__name__
)
def test_exactly_vertical_poses_are_reached(arm: pp.Arm, upright: list[np.ndarray], method) -> None:
    for target in upright:
        found = method.solve(arm, target)
        assert found.ok
        off = np.linalg.inv(target) @ arm.forward_kinematics(found.q).homogeneous
        assert np.linalg.norm(off[:3, 3]) <= 1e-6
        assert np.linalg.norm(off[:3, :3] - np.eye(3)) <= np.sqrt(2.0) * 3e-5


def test_a_stated_tolerance_applies(arm: pp.Arm, upright: list[np.ndarray]) -> None:
    found = [pp.Clik(orientation_tolerance=1e-8, restarts=3).solve(arm, target).ok for target in upright]
    known = [pp.AnalyticIk(orientation_tolerance=1e-9).solve_all(arm, target).ok for target in upright]
    assert not any(found)
    assert not any(known)


def test_no_pose_that_is_reached_within_the_tolerance_is_proven_impossible(
    arm: pp.Arm, upright: list[np.ndarray]
) -> None:
    proofs = [pp.prove_unreachable(arm, target, budget=300) for target in upright]
    assert {proof.status for proof in proofs} == {ReachStatus.FOUND}


def test_a_tilt_that_five_joints_cannot_make_is_not_reached(arm: pp.Arm, upright: list[np.ndarray]) -> None:
    for target in upright:
        down = pp.spatial.SE3(target)
        away = np.cross(down.translation, [0.0, 0.0, 1.0])
        tilted = pp.spatial.SE3(
            pp.spatial.rotation_about(np.cross(away / np.linalg.norm(away), [0, 0, 1.0]), 2e-3), np.zeros(3)
        )
        target = pp.spatial.SE3(tilted.rotation @ down.rotation, down.translation)
        assert pp.AnalyticIk().solve(arm, target).status in (IkStatus.IMPOSSIBLE, IkStatus.NOT_FOUND)


def test_straight_lines_keep_the_tip_vertical(arm: pp.Arm, upright: list[np.ndarray]) -> None:
    start = pp.Clik().solve(arm, upright[0]).or_raise().q
    checker = pp.CollisionChecker(arm)
    above = pp.spatial.SE3(upright[0])
    above.translation = above.translation + np.array([0.0, 0.0, 0.02])
    line = pp.plan_linear(checker, start, above)
    assert line.ok
    for q in line.path(np.linspace(*line.path.domain, 50)):
        tip = arm.forward_kinematics(q) * TIP
        assert tip.rotation[2, 2] == pytest.approx(-1.0, abs=1e-6)
