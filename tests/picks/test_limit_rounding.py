"""Joint values beyond a limit by less than 1e-9 count as the limit in every stage of a pick."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.model.limits import AT_LIMIT
from pinproof.picks.input.pick import Member
from pinproof.picks.judging.configurations import turned_inside
from pinproof.picks.judging.grasp import GraspCandidate
from pinproof.picks.judging.lines import Attempt, full_rotations
from pinproof.planning import with_turns
from pinproof.spatial import SE3

TURN = 2 * np.pi
FIRST, FOURTH = np.eye(6)[[0, 3]]


def limited(upper: float) -> pp.Arm:
    """A UR5 whose first joint has the limits -pi and ``upper``."""
    return pp.load_robot("ur5").arm(tcp="tool0", limits={"shoulder_pan_joint": (-np.pi, upper)})


@pytest.mark.parametrize(("beyond", "rotations"), [(0.0, 2), (0.5 * AT_LIMIT, 2), (2 * AT_LIMIT, 1)])
def test_full_rotations_that_end_at_a_limit_are_found(beyond, rotations):
    q = np.array([-1.0, -1.2, 1.0, 0.7, 1.1, 0.5])
    arm = limited(q[0] + TURN - beyond)
    attempt = Attempt(GraspCandidate(q, Member(SE3.Identity()), 0.1, 1.0), q)
    shifts = full_rotations(arm, arm.home, attempt)
    assert len({round(float(shift[0]), 6) for shift in shifts}) == rotations
    goals, _ = with_turns(arm, arm.home, q[None])
    assert len({round(float(goal[0]), 6) for goal in goals}) == rotations
    assert arm.limits.inside(goals).all()
    assert (goals[:, 0] <= arm.limits.upper[0]).all()
    found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q))
    own = found.q[np.abs(np.sin((found.q - q) / 2)).max(axis=1) < 1e-8]
    assert len({round(float(each[0]), 6) for each in own}) == rotations
    assert (found.q <= arm.limits.upper).all()


def test_poses_at_a_limit_are_not_called_outside():
    arm = limited(2.0)
    q = np.array([2.0 + 0.5 * AT_LIMIT, -1.2, 1.0, 0.7, 1.1, 0.5])
    assert turned_inside(arm, q)[0] == 2.0
    assert turned_inside(arm, q - TURN * FIRST)[0] == 2.0
    assert turned_inside(arm, q + AT_LIMIT * FIRST)[0] > 2.0


def test_the_home_of_a_screening_may_be_at_a_limit():
    arm = limited(2.0)
    home = np.array([2.0, -1.2, 1.0, 0.7, 1.1, 0.5])
    poses = [pp.pose((0.4, y, 0.3), (np.pi, 0, 0)) for y in (-0.2, 0.0, 0.2)]
    at_limit, beyond = (pp.screen_picks(arm, pp.Scene(), poses, home=home + by * FIRST) for by in (0.0, 0.5 * AT_LIMIT))
    assert np.array_equal(at_limit.q, beyond.q, equal_nan=True)


def test_free_joints_of_the_closed_form_keep_a_reference_at_the_limit():
    """With wrist joint 2 at 0, only the difference of joints 4 and 6 is determined by the target."""
    base = pp.load_robot("generic_6dof")
    arm = base.arm()
    lower, upper = arm.limits.lower.copy(), arm.limits.upper.copy()
    upper[3] = 0.7
    arm = arm.with_limits(pp.JointLimits(lower, upper, arm.limits.velocity))
    q = np.array([0.3, -0.8, 0.9, 0.7, 0.0, 0.2])
    target = arm.forward_kinematics(q)
    found = [pp.AnalyticIk().solve_all(arm, target, q + by * FOURTH) for by in (0.0, 0.5 * AT_LIMIT)]
    assert found[0].ok
    assert np.array_equal(found[0].branches, found[1].branches)
    batches = [pp.AnalyticIk().solve_all_batch(arm, [target], q + by * FOURTH) for by in (0.0, 0.5 * AT_LIMIT)]
    assert np.array_equal(batches[0].q, batches[1].q, equal_nan=True)


def test_continuous_joints_without_limits_are_not_turned():
    arm = pp.load_robot("kinova").arm()
    assert np.isinf(arm.limits.lower).any()
    q = np.where(np.isinf(arm.limits.lower), 20.0, arm.home)
    with np.errstate(all="raise"):
        np.testing.assert_array_equal(turned_inside(arm, q), q)
