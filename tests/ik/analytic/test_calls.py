"""AnalyticIk: accepted and refused arguments, batches, threads, and arms of seven joints."""

import pickle

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import IkFailed, InputError, NoClosedForm
from pinproof.ik import CurveEnd, IkStatus
from pinproof.ik import analytic_plan as plan
from pinproof.spatial import twist_size

from .arms import Axis, apart, arm_named, arm_of, assert_reaches, others, random_configurations, unit

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
        with pytest.raises(InputError, match="target"):
            call(ur5, target)
    with pytest.raises(InputError, match="targets"):
        pp.AnalyticIk().solve_all_batch(ur5, [ur5.forward_kinematics(TARGET_Q).homogeneous, target])


def test_a_target_within_rounding_of_rigid_is_reached_exactly(ur5):
    target = np.array(ur5.forward_kinematics(TARGET_Q).homogeneous)
    target[:3, :3] += 3e-8 * np.random.default_rng(0).normal(size=(3, 3))
    found = pp.AnalyticIk().solve_all(ur5, target)
    assert apart(ur5, found.branches, TARGET_Q).min() < 1e-5


def test_a_transform_is_checked_and_repaired_as_its_matrix(ur5):
    exact = ur5.forward_kinematics(TARGET_Q)
    for target in (exact, pp.spatial.rigid("target", exact)):
        for method in (pp.AnalyticIk().solve_all, pp.Clik().solve):
            one, other = method(ur5, target), method(ur5, np.array(target.homogeneous))
            assert np.array_equal(one.q, other.q)
            assert np.array_equal(one.position_error, other.position_error)
    # beyond rounding, the rotation is the nearest one, and the caller's transform stays as it is
    sheared = exact.copy()
    sheared.rotation = exact.rotation + 3e-8 * np.random.default_rng(0).normal(size=(3, 3))
    before = sheared.homogeneous
    repaired = pp.AnalyticIk().solve_all(ur5, sheared).target
    assert np.array_equal(repaired, pp.spatial.rigid("target", sheared).homogeneous)
    assert not np.array_equal(repaired, before)
    assert np.array_equal(sheared.homogeneous, before)
    for number, reason in ((np.nan, "not finite"), (1.1, "not a rigid transform")):
        wrong = exact.copy()
        wrong.rotation = exact.rotation * number
        for method in (pp.AnalyticIk().solve_all, pp.Clik().solve):
            with pytest.raises(InputError, match=f"target .*{reason}"):
                method(ur5, wrong)


def test_invalid_settings_and_arguments_are_refused(ur5):
    target = ur5.forward_kinematics(TARGET_Q)
    for settings in ({"position_tolerance": 0.0}, {"redundant_steps": 1}):
        with pytest.raises(InputError):
            pp.AnalyticIk(**settings)
    with pytest.raises(InputError, match="q0"):
        pp.AnalyticIk().solve_all(ur5, target, [0.0] * 5)
    with pytest.raises(InputError, match="Clik"):
        pp.AnalyticIk().solve(ur5, target, task="position")
    with pytest.raises(InputError, match="threads"):
        pp.AnalyticIk().solve_all_batch(ur5, [target], threads=0)


@pytest.mark.parametrize("name", ["ur5", "puma560", "stanford", "scara"])
def test_batches_equal_single_calls_for_any_number_of_threads(name):
    arm = arm_named(name)
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
    with pytest.raises(IkFailed):
        found.free(lambda q: False).or_raise()
    far = pp.AnalyticIk().solve_all(ur5, pp.pose((9.0, 0, 0)))
    with pytest.raises(IkFailed, match="0 branches"):
        far.or_raise()
    with pytest.raises(IkFailed):
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


def test_an_arm_without_a_closed_form_is_searched_only_once(monkeypatch):
    """The search takes up to a second, and the stages of a pick ask hundreds of times."""
    arm = arm_of([Axis(unit(np.random.default_rng(2)), np.zeros(3)) for _ in range(9)])
    searched = []
    best = plan._best
    monkeypatch.setattr(plan, "_best", lambda each: searched.append(each) or best(each))
    for _ in range(3):
        with pytest.raises(NoClosedForm, match="9 joints"):
            pp.AnalyticIk().solve_all(arm, pp.pose())
    assert searched == [arm]


def test_four_prismatic_joints_mimic_and_nine_joints_have_no_closed_form():
    rng = np.random.default_rng(0)
    for arm, message in (
        (arm_of(others(rng, "RPPPPR", square=False)), "singular in every configuration"),
        (arm_of(others(rng, "RRRR", square=False), mimic='<mimic joint="j2" multiplier="0.5"/>'), "mimic"),
        (arm_of([Axis(unit(rng), rng.uniform(-0.5, 0.5, 3)) for _ in range(9)]), "9 joints"),
    ):
        with pytest.raises(NoClosedForm, match=message):
            pp.AnalyticIk().solve_all(arm, pp.pose((0.1, 0.2, 0.3)))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "share"), [("panda", 1.0), ("iiwa14", 1.0), ("xarm7", 0.98)])
def test_seven_joints_have_the_generating_configuration_at_its_redundant_value(name, share):
    arm = arm_named(name)
    solver = pp.AnalyticIk(redundant_steps=2)
    q = random_configurations(arm, 150, seed=4)
    hits = 0
    for one in q:
        start = np.where(np.arange(7) == arm.joint_names.index(redundant(arm)), one, arm.home)
        found = solver.solve_all(arm, arm.forward_kinematics(one), start)
        hits += bool(len(found.branches)) and apart(arm, found.branches, one).min() < 1e-6
    assert hits >= share * len(q)


def redundant(arm):
    return pp.AnalyticIk(redundant_steps=2).solve_all(arm, arm.forward_kinematics(arm.home)).redundant_joints[0]


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_interval_ends_of_seven_joints_are_where_the_number_of_branches_changes(name):
    arm = arm_named(name)
    q = random_configurations(arm, 1, seed=5)[0]
    target = arm.forward_kinematics(q)
    found = pp.AnalyticIk(redundant_steps=64).solve_all(arm, target, q)
    joint = arm.joint_names.index(found.redundant_joints[0])
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
    arm, solver = arm_named("panda"), pp.AnalyticIk(redundant_steps=24)
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
    with pytest.raises(InputError, match="redundant"):
        pp.AnalyticIk().solve_all_batch(ur5, np.eye(4)[None], redundant_values=[0.0])


def test_branches_outside_the_limits_are_counted(ur5):
    targets = ur5.forward_kinematics_batch(np.random.default_rng(5).uniform(-3.0, 3.0, (50, 6)))
    all_round = pp.AnalyticIk().solve_all_batch(ur5, targets)
    half = ur5.with_limits(pp.JointLimits(ur5.limits.lower / 4, ur5.limits.upper / 4, ur5.limits.velocity))
    found = pp.AnalyticIk().solve_all_batch(half, targets)
    assert not all_round.outside.any()
    assert found.outside.any()
    np.testing.assert_array_equal(found.count + found.outside, all_round.count)


# -- the self-motion of arms of seven joints: curves of IK solutions over the redundant joint --------------------------

ROBOTS = ("panda", "iiwa14", "xarm7")


@pytest.fixture(scope="module", params=ROBOTS)
def arm(request):
    return arm_named(request.param)


def example(arm, seed=0):
    q = np.random.default_rng(seed).uniform(*arm.limits.sampling_range())
    return q, arm.forward_kinematics(q)


def test_samples_and_members_between_them_reach_the_target(arm):
    _, target = example(arm)
    rng = np.random.default_rng(0)
    for curve in pp.AnalyticIk().self_motion(arm, target):
        between = [curve.at(value) for value in rng.uniform(curve.lower, curve.upper, 5)]
        for q in (*curve.q[:: max(len(curve) // 8, 1)], *between):
            assert max(twist_size(target, arm.forward_kinematics(q))) < 1e-8
            assert arm.limits.contains(q)


def test_curves_are_continuous(arm):
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


def test_every_solution_is_on_a_curve(arm):
    q, target = example(arm, 2)
    solver = pp.AnalyticIk()
    motion = solver.self_motion(arm, target)
    joint = arm.joint_names.index(motion.parameter)
    branches = solver.solve_all(arm, target).branches
    for one in (q, *branches[::7]):
        apart = [curve.at(one[joint]) - one for curve in motion if curve.lower <= one[joint] <= curve.upper]
        turned = [np.abs(each - 2 * np.pi * np.round(each / (2 * np.pi))).max() for each in apart]
        assert min(turned) < 1e-6


def test_curves_end_at_limits_or_folds(arm):
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


def test_best_and_nearest_choose_among_all_samples(arm):
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


def test_spread_covers_every_curve_with_distinct_solutions(arm):
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


def test_targets_without_a_solution_and_arms_without_redundancy_are_reported(arm, ur5):
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
