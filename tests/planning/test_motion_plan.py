"""`pp.plan`: a motion that is planned, shortened, timed and certified in one call, or the reason why there is none."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import PlanFailed


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return pp.load_robot("ur5").arm()


def test_plan_is_a_certified_motion_between_the_configurations(arm: pp.Arm) -> None:
    start, goal = arm.home, arm.home + np.array([0.8, 0.3, -0.3, 0.0, 0.2, 0.0])
    found = pp.plan(pp.CollisionChecker(arm), start, goal, budget=5, rate_limits=[pp.motion.TorqueLimits(arm)])
    assert found.or_raise() is found
    assert found.certificate.free
    np.testing.assert_allclose(found.trajectory.start, start, atol=1e-12)
    np.testing.assert_allclose(found.trajectory.end, goal, atol=1e-12)
    values = found.to_dict()
    assert values["duration"] == found.trajectory.duration <= values["duration_of_path"]
    assert len(values["torques"]) == arm.dof
    assert "optimised motion" in found.message
    assert "largest torque" in found.to_text()


def test_plan_without_a_path_states_the_reason(arm: pp.Arm) -> None:
    wall = pp.Obstacle("wall", pp.Sphere(0.03), arm.forward_kinematics(arm.home))
    found = pp.plan(pp.CollisionChecker(arm, pp.Scene([wall])), arm.home, arm.home + 0.1)
    assert (found.ok, found.to_dict()["status"]) == (False, "START_INVALID")
    assert "wall" in found.to_text()
    for read in (lambda: found.trajectory, lambda: found.certificate, found.or_raise):
        with pytest.raises(PlanFailed, match="wall"):
            read()
