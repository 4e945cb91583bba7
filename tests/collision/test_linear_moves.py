"""The tolerance of a traced line is not smaller than the bound that its module derives, and neither are its factors."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof.collision.certificates.program_proof import ROUNDED, TURN_SHARE, UNIT, levers, trace_line


@pytest.fixture(scope="module", params=["ur5", "generic_6dof"])
def arm(request) -> pp.Arm:
    return pp.load_robot(request.param).arm()


def scaled_jacobian(arm: pp.Arm, q: np.ndarray) -> np.ndarray:
    """The Jacobian (6, n) with lengths in units of UNIT."""
    return np.array([1.0 / UNIT] * 3 + [1.0] * 3)[:, None] * arm.jacobian(q)


def change(arm: pp.Arm) -> float:
    """The bound of the change of the Jacobian per unit change of the joint values."""
    return float(np.sqrt(arm.dof * (1.0 + (levers(arm) / UNIT) ** 2).sum()))


def test_levers_bound_the_distance_of_the_tcp_from_each_axis(arm) -> None:
    rng = np.random.default_rng(0)
    speeds = np.array([np.linalg.norm(arm.jacobian(q)[:3], axis=0) for q in rng.uniform(-3, 3, (300, arm.dof))])
    assert (speeds.max(axis=0) <= levers(arm) + 1e-12).all()
    assert (levers(arm) <= 2.0 * speeds.max(axis=0) + 0.2).all()


def test_the_jacobian_changes_by_no_more_than_its_bound(arm) -> None:
    rng = np.random.default_rng(1)
    for q in rng.uniform(-3, 3, (50, arm.dof)):
        step = rng.normal(size=arm.dof)
        step *= 10.0 ** rng.uniform(-4, -1) / np.linalg.norm(step)
        moved = np.linalg.norm(scaled_jacobian(arm, q + step) - scaled_jacobian(arm, q), 2)
        assert moved <= change(arm) * np.linalg.norm(step)


def test_the_tolerance_is_the_derived_bound(arm) -> None:
    """The chord between samples, and the turn of the orientation by its share, with the inverse at the samples."""
    rng, traced = np.random.default_rng(2), 0
    while traced < 4:
        start = rng.uniform(-2, 2, arm.dof)
        first = arm.forward_kinematics(start)
        axis, angle = rng.normal(size=3), float(rng.choice([0.0, 1e-4, 5e-4]))
        turn = pin.exp3(angle * axis / np.linalg.norm(axis))
        target = pin.SE3(first.rotation @ turn, first.translation + rng.uniform(-0.025, 0.025, 3))
        trace = trace_line(arm, start, target)
        if trace.reason:
            continue
        traced += 1
        q = trace.path.q
        ends = [arm.forward_kinematics(each) for each in (q[0], q[-1])]
        assert np.abs(ends[1].homogeneous - target.homogeneous).max() < 1e-9
        length = np.hypot(np.linalg.norm(target.translation - first.translation) / UNIT, angle)
        step, bound = length / (len(q) - 1), change(arm)
        inverse = np.array([np.linalg.norm(np.linalg.inv(scaled_jacobian(arm, each)), 2) for each in q])
        left = 1 / inverse**2 - 2 * bound * step
        chord = (bound * left**-1.5).max() * step**2 / 8
        tube = ((np.sqrt(left) - np.sqrt(left - 2 * bound * TURN_SHARE * angle)) / bound).max()
        assert chord + tube <= trace.tolerance <= (1 + 1e-6) * (chord + tube) + 1.01 * ROUNDED
        # The samples are on the line, in equal steps, and on one branch.
        for share, each in zip(np.linspace(0, 1, len(q)), q, strict=True):
            at = arm.forward_kinematics(each).translation
            np.testing.assert_allclose(
                at, first.translation + share * (target.translation - first.translation), atol=1e-9
            )
        assert (np.linalg.norm(np.diff(q, axis=0), axis=1) * bound * inverse[1:] < 0.5).all()


def test_a_line_close_to_a_singularity_is_not_traced() -> None:
    """The elbow of the UR5 is nearly stretched at the end; at the start it is bent."""
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    bent, stretched = np.array([0.3, -1.2, 1.0, -1.4, -1.5, 0.2]), np.array([0.3, -1.2, 1e-4, -0.4, -1.5, 0.2])
    end = arm.forward_kinematics(bent)
    end.translation = arm.forward_kinematics(stretched).translation
    assert trace_line(arm, bent, end).reason
    turned = arm.forward_kinematics(bent)
    turned.rotation = turned.rotation @ pp.pose(rpy=(0.5, 0, 0)).rotation
    assert "not published" in trace_line(arm, bent, turned).reason
