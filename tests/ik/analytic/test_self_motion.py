"""The self-motion of arms of seven joints: curves of IK solutions over the redundant joint."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import IkFailed, InputError
from pinproof.ik import CurveEnd
from pinproof.spatial import twist_size

ROBOTS = ("panda", "iiwa14", "xarm7")


@pytest.fixture(scope="module", params=ROBOTS)
def arm(request) -> pp.Arm:
    return pp.load_robot(request.param).arm()


def example(arm: pp.Arm, seed: int = 0):
    q = np.random.default_rng(seed).uniform(*arm.limits.sampling_range())
    return q, arm.forward_kinematics(q)


def test_samples_and_members_between_them_reach_the_target(arm) -> None:
    _, target = example(arm)
    rng = np.random.default_rng(0)
    for curve in pp.AnalyticIk().self_motion(arm, target):
        between = [curve.at(value) for value in rng.uniform(curve.lower, curve.upper, 5)]
        for q in (*curve.q[:: max(len(curve) // 8, 1)], *between):
            assert max(twist_size(target, arm.forward_kinematics(q))) < 1e-8
            assert arm.limits.contains(q)


def test_curves_are_continuous(arm) -> None:
    """Joints move by at most 0.2 rad between samples, and between them without a jump."""
    _, target = example(arm, 1)
    for curve in pp.AnalyticIk().self_motion(arm, target):
        assert (np.diff(curve.values) > 0).all()
        assert np.abs(np.diff(curve.q, axis=0)).max() <= 0.2
        middle = (curve.values[1:] + curve.values[:-1]) / 2
        for value in middle[:: max(len(middle) // 10, 1)]:
            left, q = curve.q[np.searchsorted(curve.values, value) - 1], curve.at(value)
            right = curve.q[np.searchsorted(curve.values, value)]
            assert np.abs(q - (left + right) / 2).max() < 0.1


def test_every_solution_is_on_a_curve(arm) -> None:
    q, target = example(arm, 2)
    solver = pp.AnalyticIk()
    motion = solver.self_motion(arm, target)
    joint = arm.joint_names.index(motion.parameter)
    branches = solver.solve_all(arm, target).branches
    for one in (q, *branches[::7]):
        apart = [curve.at(one[joint]) - one for curve in motion if curve.lower <= one[joint] <= curve.upper]
        turned = [np.abs(each - 2 * np.pi * np.round(each / (2 * np.pi))).max() for each in apart]
        assert min(turned) < 1e-6


def test_curves_end_at_limits_or_folds(arm) -> None:
    _, target = example(arm, 3)
    motion = pp.AnalyticIk().self_motion(arm, target)
    joint = arm.joint_names.index(motion.parameter)
    for curve in motion:
        step = min(1e-4, (curve.upper - curve.lower) / 2)
        before = curve.at(curve.lower + step), curve.at(curve.upper - step)
        for end, q, inwards in zip(curve.ends, curve.q[[0, -1]], before, strict=True):
            margin = np.minimum(q - arm.limits.lower, arm.limits.upper - q).min()
            others = np.delete(np.abs(inwards - q), joint).max()
            assert margin < 1e-4 if end is CurveEnd.LIMIT else others > 10 * step


def test_best_and_nearest_choose_among_all_samples(arm) -> None:
    q, target = example(arm)
    motion = pp.AnalyticIk().self_motion(arm, target, q)
    assert np.abs(motion.nearest(q) - q).max() < 0.1
    samples = np.concatenate([curve.q for curve in motion])
    best = motion.best(lambda many: arm.chain.manipulability_batch(many))
    assert arm.chain.manipulability_batch(best[None])[0] == arm.chain.manipulability_batch(samples).max()
    with pytest.raises(IkFailed, match="rejected"):
        motion.best(lambda many: np.full(len(many), np.nan))
    with pytest.raises(InputError, match="shape"):
        motion.best(lambda many: np.zeros(1))


def test_spread_covers_every_curve_with_distinct_solutions(arm) -> None:
    _, target = example(arm, 4)
    motion = pp.AnalyticIk(redundant_steps=48).self_motion(arm, target)
    goals = motion.spread(0.3)
    for curve in motion:
        for q in curve.q:
            assert np.abs(goals - q).max(axis=1).min() < 0.3
    assert len(goals) < sum(len(curve) for curve in motion)
    for q in goals:
        assert max(twist_size(target, arm.forward_kinematics(q))) < 1e-8
    with pytest.raises(InputError, match="apart"):
        motion.spread(0.0)


def test_targets_without_a_solution_and_arms_without_redundancy_are_reported(arm, ur5) -> None:
    motion = pp.AnalyticIk().self_motion(arm, pp.pose((3.0, 0.0, 0.0)))
    assert not motion.ok
    assert len(motion) == 0
    with pytest.raises(IkFailed):
        motion.nearest(arm.home)
    with pytest.raises(InputError, match="7 joints"):
        pp.AnalyticIk().self_motion(ur5, pp.pose((0.4, 0.1, 0.3)))
    curve = pp.AnalyticIk().self_motion(arm, example(arm)[1]).curves[0]
    with pytest.raises(InputError, match=curve.parameter):
        curve.at(curve.upper + 0.1)


def test_curves_survive_pickling_and_are_evaluated_between_samples_as_before(arm):
    motion = pp.AnalyticIk().self_motion(arm, example(arm)[1])
    again = pickle.loads(pickle.dumps(motion))
    assert (again.message, len(again)) == (motion.message, len(motion))
    for curve, same in zip(motion, again, strict=True):
        values = np.linspace(curve.lower, curve.upper, 7)
        np.testing.assert_array_equal([same.at(value) for value in values], [curve.at(value) for value in values])
