"""Rotations by 2 pi, limits, joints without limits, the workspace boundary, and calibrated arms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.ik import IkStatus
from pinproof.ik.analytic_plan import plan_for
from pinproof.spatial import SE3

from ...examples import examples
from .arms import (
    Axis,
    apart,
    arm_named,
    arm_of,
    assert_reaches,
    conditioning,
    misses,
    others,
    random_configurations,
    spherical,
)


def wrist_axes(seed=3):
    rng = np.random.default_rng(seed)
    return [*others(rng, "RRR", square=False), *spherical(rng, square=True)]


def test_every_rotation_by_2_pi_within_the_limits_is_returned(ur5):
    """The joints of the UR5 have a range of 4 pi, except the elbow with 2 pi."""
    q = np.array([0.5, -1.2, 1.0, 0.7, 1.1, -2.0])
    target = ur5.forward_kinematics(q)
    found = pp.AnalyticIk().solve_all(ur5, target)
    per_branch = np.prod(np.where(ur5.limits.upper > 4.0, 2, 1))
    assert len(found.q) == len(found.branches) * per_branch
    assert len({tuple(row.round(9)) for row in found.q}) == len(found.q)
    for row in found.q[:: max(len(found.q) // 40, 1)]:
        assert_reaches(ur5, row, target.homogeneous)
    assert found.position_error.shape == found.orientation_error.shape == (len(found.q),)
    assert np.array(list(found)) == pytest.approx(found.q)


def test_nearest_includes_rotations_by_2_pi(ur5):
    q = np.array([5.0, -1.2, 1.0, -4.7, 1.1, 6.0])
    found = pp.AnalyticIk().solve_all(ur5, ur5.forward_kinematics(q))
    goal = q + 0.05
    nearest = found.nearest(goal)
    assert nearest == pytest.approx(q, abs=1e-8)
    assert pp.AnalyticIk().solve(ur5, ur5.forward_kinematics(q), goal).q == pytest.approx(q, abs=1e-8)
    assert np.abs(nearest - goal).max() <= np.abs(found.q - goal).max(axis=1).min() + 1e-12
    assert np.abs(found.q - found.reference).max(axis=1) == pytest.approx(
        sorted(np.abs(found.q - found.reference).max(axis=1))
    )


@pytest.mark.parametrize("name", ["puma560", "irb120", "stanford", "generic_6dof"])
@pytest.mark.parametrize("bound", ["lower", "upper"])
def test_joints_exactly_at_their_limits_are_solved(name, bound):
    arm = arm_named(name)
    limit = getattr(arm.limits, bound)
    for joint in range(6):
        q = random_configurations(arm, 40, seed=joint)
        q[:, joint] = limit[joint]
        found = pp.AnalyticIk().solve_all_batch(arm, arm.forward_kinematics_batch(q))
        regular = np.array([conditioning(arm, one) > 1e-6 for one in q])  # the textbook arm's q5 = pi is singular
        assert (misses(arm, found.q, q)[regular] < 1e-6).all()
        assert found.ok.all()
        assert (np.isnan(found.q) | ((found.q >= arm.limits.lower) & (found.q <= arm.limits.upper))).all()


def test_a_joint_at_its_limit_is_solved_at_a_singular_target():
    """Where branches meet, rounding moves a joint 1e-8 beyond its limit; the branch is corrected, not discarded."""
    arm = arm_named("stanford")
    q = np.array([arm.limits.upper[0], 0.0, 0.5, 0.4, -0.8, 1.2])
    found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q))
    assert found.ok
    assert_reaches(arm, found.branches[0], arm.forward_kinematics(q).homogeneous)


def test_branches_outside_the_limits_are_reported_and_omitted():
    axes = wrist_axes()
    wide, tight = arm_of(axes, limits=[None] * 6), arm_of(axes, limits=[(-1.0, 1.0)] * 6)
    q = random_configurations(tight, 30, seed=4)
    for one in q:
        target = wide.forward_kinematics(one)
        every, some = pp.AnalyticIk().solve_all(wide, target), pp.AnalyticIk().solve_all(tight, target)
        inside = [branch for branch in every.branches if tight.limits.contains(branch)]
        assert len(inside) == len(some.branches) > 0
        outside = len(every.branches) - len(inside)
        assert (f"{outside} more outside the limits" in some.message) == (outside > 0)


def test_the_reason_names_the_joint_limits():
    axes = wrist_axes()
    wide, tight = arm_of(axes), arm_of(axes, limits=[(-0.1, 0.1)] * 6)
    q = np.array([1.0, 0.9, 0.8, 0.7, 0.6, 0.5])
    answer = pp.AnalyticIk().solve(tight, wide.forward_kinematics(q))
    assert answer.status is IkStatus.IMPOSSIBLE
    assert "joint limits" in answer.message
    assert tight.limits.contains(answer.q)
    assert answer.position_error > 1e-3


def test_joints_without_limits_are_solved():
    arm = arm_of(wrist_axes(5), limits=[None] * 6)
    q = np.array([20.0, -9.0, 7.0, 30.0, 2.0, -12.0])
    target = arm.forward_kinematics(q)
    found = pp.AnalyticIk().solve_all(arm, target, q + 0.1)
    assert found.nearest(q) == pytest.approx(q, abs=1e-7)
    assert len(found.q) == len(found.branches)
    assert (np.abs(found.branches - q - 0.1) <= np.pi + 1e-9).all()


@pytest.mark.parametrize("beyond", [-1e-3, -1e-8, -1e-12, 0.0, 1e-12, 1e-4])
def test_branches_appear_at_the_workspace_boundary(beyond):
    """Near the stretched arm: two elbow branches become one, then none."""
    places = zip("zyyxyx", (0.0, 0.0, 0.4, 0.7, 0.7, 0.7), strict=True)
    axes = [Axis(np.eye(3)["xyz".index(axis)], np.array([x, 0, 0])) for axis, x in places]
    arm = arm_of(axes, tool=(0.8, 0, 0))
    stretched = arm.forward_kinematics([0.0, 0.3, 0.0, 0.4, 0.9, -0.5])
    away = np.array([np.cos(0.3), 0.0, -np.sin(0.3)])
    target = SE3(stretched.rotation, stretched.translation + beyond * away)
    answer = pp.AnalyticIk().solve(arm, target)
    assert answer.ok == (beyond <= 1e-10)
    assert (answer.status is IkStatus.IMPOSSIBLE) == (beyond > 1e-10)
    if answer.ok:
        elbows = pp.AnalyticIk().solve_all(arm, target).branches[:, 2]
        assert np.abs(elbows).max() < 0.2
        assert_reaches(arm, answer.q, target.homogeneous)


@examples(40)
@given(seed=st.integers(0, 10**6), name=st.sampled_from(["ur5", "puma560", "generic_6dof"]), scale=st.floats(0.2, 1.6))
def test_targets_that_clik_reaches_are_never_impossible(seed, name, scale):
    arm = arm_named(name)
    target = arm.forward_kinematics(random_configurations(arm, 1, seed)[0])
    target.translation *= scale
    answer = pp.AnalyticIk().solve(arm, target)
    searched = pp.Clik(position_tolerance=1e-9, orientation_tolerance=1e-9, restarts=20).solve(arm, target)
    assert answer.status in (IkStatus.FOUND, IkStatus.IMPOSSIBLE)
    assert answer.ok or not searched.ok
    if answer.ok:
        assert_reaches(arm, answer.q, target.homogeneous)


CALIBRATED = {
    "ur5": ([0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, -1], [0, 1, 0]),
    "puma": ([0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 0, 1]),
}
PLACES = {
    "ur5": ([0, 0, 0.1], [0, 0.1, 0.1], [0.4, 0.1, 0.1], [0.8, 0.1, 0.1], [0.8, 0.1, 0.1], [0.8, 0.1, 0]),
    "puma": ([0, 0, 0], [0, 0.15, 0], [0.43, 0.15, 0], [0.43, 0.15, 0.43], [0.43, 0.15, 0.43], [0.43, 0.15, 0.43]),
}


def calibrated(name, rng, amount):
    axes = []
    for direction, place in zip(CALIBRATED[name], PLACES[name], strict=True):
        tilted = np.array(direction, dtype=float) + rng.uniform(-amount, amount, 3)
        axes.append(Axis(tilted / np.linalg.norm(tilted), np.array(place) + rng.uniform(-amount, amount, 3)))
    return arm_of(axes, tool=(0.6, 0.3, 0.2))


@examples(24)
@given(seed=st.integers(0, 10**6), name=st.sampled_from(sorted(CALIBRATED)), amount=st.sampled_from([1e-6, 1e-4, 1e-3]))
def test_calibrated_arms_are_solved(seed, name, amount):
    """All branches of an arm whose axes deviate from the ideal are found."""
    arm = calibrated(name, np.random.default_rng(seed), amount)
    plan = plan_for(arm, 1e-9, 1e-9)
    assert 0.0 < plan.deviation < 10 * amount
    q = random_configurations(arm, 40, seed)
    targets = arm.forward_kinematics_batch(q)
    found = pp.AnalyticIk().solve_all_batch(arm, targets)
    regular = np.array([conditioning(arm, one) > 1e-4 for one in q])
    assert (misses(arm, found.q, q)[regular] < 1e-6).all()
    assert found.ok.all()
    for target, answers in zip(targets, found.q, strict=True):
        for answer in answers[~np.isnan(answers[:, 0])]:
            assert_reaches(arm, answer, target)


def test_calibrated_arms_are_solved_near_singularities():
    """There the branches of the true arm are far from those of the ideal arm, or have no partner; none is missed."""
    arm = calibrated("ur5", np.random.default_rng(4), 5e-4)
    q = random_configurations(arm, 6000, seed=9)
    q = np.array([one for one in q if conditioning(arm, one) < 0.02])
    assert len(q) > 300
    found = pp.AnalyticIk().solve_all_batch(arm, arm.forward_kinematics_batch(q))
    assert (misses(arm, found.q, q) < 1e-6).all()
    assert found.complete.mean() > 0.9


def test_a_calibrated_arm_has_the_branches_that_a_search_finds():
    arm = calibrated("ur5", np.random.default_rng(1), 2e-3)
    q = np.array([0.3, -0.8, 1.1, 0.4, 1.2, -0.5])
    target = arm.forward_kinematics(q)
    branches = pp.AnalyticIk().solve_all(arm, target).branches
    assert pp.AnalyticIk().solve_all(arm, target).complete
    solver = pp.Clik(position_tolerance=1e-9, orientation_tolerance=1e-9, restarts=0)
    starts = random_configurations(arm, 1500, seed=2)
    searched = solver.solve_batch(arm, np.tile(target.homogeneous, (len(starts), 1, 1)), starts)
    gaps = apart(arm, searched.q[searched.ok][:, None], branches[None])
    assert (gaps.min(axis=1) < 1e-6).all()
    assert set(gaps.argmin(axis=1)) == set(range(len(branches)))
