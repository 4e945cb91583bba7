"""AnalyticIk: accepted and refused arguments, batches, threads, and arms of seven joints."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import NoClosedForm
from pinproof.ik import IkStatus

from .arms import Axis, apart, arm_of, assert_reaches, others, random_configurations, unit

TARGET_Q = np.array([0.3, -0.8, 1.1, 0.4, 1.2, -0.5])


def test_targets_are_accepted_in_every_form(ur5):
    pose = ur5.forward_kinematics(TARGET_Q)
    plain = np.array(pose.homogeneous)
    expected = pp.AnalyticIk().solve_all(ur5, pose).q
    locked = plain.copy()
    locked.setflags(write=False)
    for form in (plain, locked, np.asfortranarray(plain), plain.tolist(), plain[None][0], plain.astype(">f8")):
        assert pp.AnalyticIk().solve_all(ur5, form).q == pytest.approx(expected, abs=1e-12)
    single = pp.AnalyticIk().solve_all(ur5, plain.astype(np.float32))
    assert apart(ur5, single.branches, TARGET_Q).min() < 1e-5


@pytest.mark.parametrize(
    "spoil",
    [
        lambda T: T * 1.1,
        lambda T: np.where(np.eye(4) > 0, np.nan, T),
        lambda T: T + np.array([[0, 0, 0, np.inf]] + [[0] * 4] * 3),
        lambda T: T @ np.diag([1, 1, -1, 1.0]),
        lambda T: T + np.array([[0.0] * 4] * 3 + [[0, 0, 0.1, 0]]),
        lambda T: T[:3],
        lambda T: "here",
    ],
)
def test_targets_that_are_not_poses_are_refused(ur5, spoil):
    target = spoil(np.array(ur5.forward_kinematics(TARGET_Q).homogeneous))
    for call in (pp.AnalyticIk().solve_all, pp.AnalyticIk().solve):
        with pytest.raises(pp.InputError, match="target"):
            call(ur5, target)
    with pytest.raises(pp.InputError, match="targets"):
        pp.AnalyticIk().solve_all_batch(ur5, [ur5.forward_kinematics(TARGET_Q).homogeneous, target])


def test_a_target_within_rounding_of_rigid_is_reached_exactly(ur5):
    target = np.array(ur5.forward_kinematics(TARGET_Q).homogeneous)
    target[:3, :3] += 3e-8 * np.random.default_rng(0).normal(size=(3, 3))
    found = pp.AnalyticIk().solve_all(ur5, target)
    assert apart(ur5, found.branches, TARGET_Q).min() < 1e-5


def test_invalid_settings_and_arguments_are_refused(ur5):
    target = ur5.forward_kinematics(TARGET_Q)
    with pytest.raises(pp.InputError):
        pp.AnalyticIk(position_tolerance=0.0)
    with pytest.raises(pp.InputError):
        pp.AnalyticIk(redundant_steps=1)
    with pytest.raises(pp.InputError, match="q0"):
        pp.AnalyticIk().solve_all(ur5, target, [0.0] * 5)
    with pytest.raises(pp.InputError, match="Clik"):
        pp.AnalyticIk().solve(ur5, target, task="position")
    with pytest.raises(pp.InputError, match="threads"):
        pp.AnalyticIk().solve_all_batch(ur5, [target], threads=0)


@pytest.mark.parametrize("name", ["ur5", "puma560", "stanford", "scara"])
def test_batches_equal_single_calls_for_any_number_of_threads(name):
    arm = pp.load_robot(name).arm(tcp="tool0") if name == "ur5" else pp.load_robot(name).arm()
    q = random_configurations(arm, 101, seed=1)
    targets = arm.forward_kinematics_batch(q)
    targets[::10, :3, 3] *= 3.0
    starts = random_configurations(arm, 101, seed=2)
    solver = pp.AnalyticIk()
    batch, again = (solver.solve_all_batch(arm, targets, starts, threads=threads) for threads in (1, 3))
    assert np.array_equal(batch.q, again.q, equal_nan=True)
    assert np.array_equal(batch.count, again.count)
    chosen = solver.solve_batch(arm, targets, starts, threads=2)
    for i in range(len(q)):
        single = solver.solve_all(arm, targets[i], starts[i])
        assert batch.count[i] == len(single.branches)
        mine = batch.q[i, : batch.count[i]]
        assert sorted(map(tuple, mine)) == sorted(map(tuple, single.branches))
        assert np.isnan(batch.q[i, batch.count[i] :]).all()
        one = solver.solve(arm, targets[i], starts[i])
        assert chosen.ok[i] == one.ok == single.ok
        assert chosen.q[i] == pytest.approx(one.q, abs=1e-12)


def test_an_empty_batch_has_no_results(ur5):
    none = pp.AnalyticIk().solve_all_batch(ur5, np.empty((0, 4, 4)))
    assert len(none) == 0
    assert none.q.shape[2] == 6
    assert len(pp.AnalyticIk().solve_batch(ur5, np.empty((0, 4, 4))).q) == 0


def test_accept_free_and_or_raise_agree(ur5):
    target = ur5.forward_kinematics(TARGET_Q)
    found = pp.AnalyticIk().solve_all(ur5, target)

    def elbow_up(q):
        return q[2] > 0

    some = found.free(elbow_up)
    assert 0 < len(some.branches) < len(found.branches)
    assert (some.branches[:, 2] > 0).all()
    assert some.or_raise() is some
    taken = pp.AnalyticIk().solve(ur5, target, accept=elbow_up)
    assert taken.ok
    assert taken.q[2] > 0
    refused = pp.AnalyticIk().solve(ur5, target, accept=lambda q: False)
    assert refused.status is IkStatus.REFUSED
    assert_reaches(ur5, refused.q, target.homogeneous)
    with pytest.raises(pp.errors.IkFailed):
        found.free(lambda q: False).or_raise()
    far = pp.AnalyticIk().solve_all(ur5, pp.pose((9.0, 0, 0)))
    with pytest.raises(pp.errors.IkFailed, match="0 branches"):
        far.or_raise()
    with pytest.raises(pp.errors.IkFailed):
        far.nearest(np.zeros(6))
    assert len(far) == 0
    assert far.q.shape == (0, 6)


def test_results_are_read_only_and_the_solver_can_be_pickled(ur5):
    solver = pp.AnalyticIk(redundant_steps=33)
    target = ur5.forward_kinematics(TARGET_Q)
    found = solver.solve_all(ur5, target)
    with pytest.raises(ValueError, match="read-only"):
        found.q[0, 0] = 1.0
    copy = pickle.loads(pickle.dumps(solver))
    assert copy == solver
    assert np.array_equal(copy.solve_all(ur5, target).q, found.q)


def test_one_solver_can_be_used_for_several_arms(ur5, generic):
    solver = pp.AnalyticIk()
    for arm in (ur5, generic, ur5):
        q = random_configurations(arm, 1, seed=3)[0]
        assert apart(arm, solver.solve_all(arm, arm.forward_kinematics(q)).branches, q).min() < 1e-6


def test_four_prismatic_joints_have_no_closed_form():
    rng = np.random.default_rng(0)
    arm = arm_of(others(rng, "RPPPPR", square=False))
    with pytest.raises(NoClosedForm, match="singular in every configuration"):
        pp.AnalyticIk().solve_all(arm, pp.pose((0.1, 0.2, 0.3)))


def test_an_arm_without_a_closed_form_is_searched_only_once(monkeypatch):
    """The search takes up to a second, and the stages of a pick ask hundreds of times."""
    from pinproof.ik import analytic_plan as plan

    arm = arm_of([Axis(unit(np.random.default_rng(2)), np.zeros(3)) for _ in range(8)])
    searched = []
    best = plan._best
    monkeypatch.setattr(plan, "_best", lambda each: searched.append(each) or best(each))
    for _ in range(3):
        with pytest.raises(NoClosedForm, match="8 joints"):
            pp.AnalyticIk().solve_all(arm, pp.pose())
    assert searched == [arm]


def test_mimic_and_eight_joints_have_no_closed_form():
    rng = np.random.default_rng(0)
    arm = arm_of(others(rng, "RRRR", square=False), mimic='<mimic joint="j2" multiplier="0.5"/>')
    with pytest.raises(NoClosedForm, match="mimic"):
        pp.AnalyticIk().solve_all(arm, pp.pose())
    arm = arm_of([Axis(unit(rng), rng.uniform(-0.5, 0.5, 3)) for _ in range(8)])
    with pytest.raises(NoClosedForm, match="8 joints"):
        pp.AnalyticIk().solve_all(arm, pp.pose())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "share"), [("panda", 1.0), ("iiwa14", 1.0), ("xarm7", 0.98)])
def test_seven_joints_have_the_generating_configuration_at_its_redundant_value(name, share):
    arm = pp.load_robot(name).arm()
    solver = pp.AnalyticIk(redundant_steps=2)
    q = random_configurations(arm, 150, seed=4)
    hits = 0
    for one in q:
        start = np.where(np.arange(7) == arm.joint_names.index(redundant(arm)), one, arm.home)
        found = solver.solve_all(arm, arm.forward_kinematics(one), start)
        hits += bool(len(found.branches)) and apart(arm, found.branches, one).min() < 1e-6
    assert hits >= share * len(q)


def redundant(arm):
    return pp.AnalyticIk(redundant_steps=2).solve_all(arm, arm.forward_kinematics(arm.home)).redundant_joint


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_interval_ends_of_seven_joints_are_where_the_number_of_branches_changes(name):
    arm = pp.load_robot(name).arm()
    q = random_configurations(arm, 1, seed=5)[0]
    target = arm.forward_kinematics(q)
    found = pp.AnalyticIk(redundant_steps=64).solve_all(arm, target, q)
    joint = arm.joint_names.index(found.redundant_joint)
    lower, upper = arm.limits.lower[joint], arm.limits.upper[joint]
    assert any(one.lower - 1e-9 <= q[joint] <= one.upper + 1e-9 for one in found.intervals)
    for row in found.branches:
        assert_reaches(arm, row, target.homogeneous)
        assert any(one.lower - 1e-9 <= row[joint] <= one.upper + 1e-9 for one in found.intervals)

    def branches_at(value):
        start = q.copy()
        start[joint] = value
        swept = pp.AnalyticIk(redundant_steps=2).solve_all(arm, target, start).branches
        return int((np.abs(swept[:, joint] - value) < 1e-12).sum())

    for one in found.intervals:
        assert branches_at((one.lower + one.upper) / 2) == one.branches
        for end, direction in ((one.lower, -1), (one.upper, 1)):
            if lower + 1e-6 < end < upper - 1e-6:
                assert branches_at(end - direction * 1e-6) == one.branches
                assert branches_at(end + direction * 1e-6) != one.branches


def test_values_of_the_redundant_joint_can_be_given():
    arm, solver = pp.load_robot("panda").arm(), pp.AnalyticIk(redundant_steps=24)
    targets = arm.forward_kinematics_batch(np.random.default_rng(4).uniform(*arm.limits.sampling_range(), (20, 7)))
    joint, values = solver.redundant_grid(arm)
    complete = solver.solve_all_batch(arm, targets)
    parts = [solver.solve_all_batch(arm, targets, redundant_values=some) for some in (values[::2], values[1::2])]
    np.testing.assert_array_equal(sum(part.count for part in parts), complete.count)
    np.testing.assert_array_equal(sum(part.outside for part in parts), complete.outside)
    even = parts[0].q[:, :, joint]
    assert np.isin(even[np.isfinite(even)], values[::2]).all()
    for target, row, count in zip(targets, complete.q, complete.count, strict=True):
        np.testing.assert_array_equal(row[:count], solver.solve_all(arm, target).branches)


def test_redundant_values_require_an_arm_of_seven_joints(ur5):
    assert pp.AnalyticIk().redundant_grid(ur5) is None
    with pytest.raises(pp.InputError, match="redundant"):
        pp.AnalyticIk().solve_all_batch(ur5, np.eye(4)[None], redundant_values=[0.0])


def test_branches_outside_the_limits_are_counted(ur5):
    targets = ur5.forward_kinematics_batch(np.random.default_rng(5).uniform(-3.0, 3.0, (50, 6)))
    all_round = pp.AnalyticIk().solve_all_batch(ur5, targets)
    half = ur5.with_limits(pp.JointLimits(ur5.limits.lower / 4, ur5.limits.upper / 4, ur5.limits.velocity))
    found = pp.AnalyticIk().solve_all_batch(half, targets)
    assert not all_round.outside.any()
    assert found.outside.any()
    np.testing.assert_array_equal(found.count + found.outside, all_round.count)
