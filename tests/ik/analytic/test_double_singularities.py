"""Targets at and near several singularities at once: claims of completeness are true."""

import numpy as np
import pytest

import pinproof as pp
from pinproof.ik import IkStatus

from .arms import TURN, apart, arm_named, assert_reaches, misses

ARMS = ["kinova", "stanford", "generic_6dof", "irb120", "puma560", "ur5", "z1"]

REPRESENTED = 0.02
"""Rad or m. Near two singularities at once, rounding of the target (1e-16) moves a joint by about this."""


def limited_wrist(name):
    """An arm whose joint 4 turns by 1 rad."""
    return pp.load_robot(name).arm(limits={arm_named(name).joint_names[3]: (-1.0, 1.0)})


def special_configurations(arm, count, seed):
    """(count, n): one to three joints at 0, +-pi/2, +-pi or a limit, or off by 1e-12 to 1e-6."""
    rng = np.random.default_rng(seed)
    lower, upper = arm.limits.sampling_range()
    q = rng.uniform(lower, upper, (count, arm.dof))
    chosen = rng.random(q.shape).argsort(axis=1) < rng.integers(1, 4, count)[:, None]
    value = rng.choice([0.0, np.pi / 2, -np.pi / 2, np.pi, -np.pi], q.shape)
    value = np.where(rng.random(q.shape) < 0.12, np.where(rng.random(q.shape) < 0.5, lower, upper), value)
    value += rng.choice([0.0, 0.0, 1.0, -1.0], q.shape) * 10.0 ** rng.uniform(-12, -6, q.shape)
    return np.where(chosen, value, q).clip(lower, upper)


def distance_from_families(arm, families, q):
    """The largest joint difference between q and the closest sampled member of any family."""
    least = np.inf
    for family in families:
        joint = arm.joint_names.index(family.parameter)
        values = [value for value in q[joint] + TURN * np.arange(-2, 3) if family.lower <= value <= family.upper]
        values.append(np.clip(q[joint], family.lower, family.upper))
        for value in values:
            try:
                least = min(least, float(apart(arm, family.at(value), q)))
            except pp.InputError:
                continue
        if least > REPRESENTED:
            least = min(least, float(apart(arm, family.nearest(q), q)))
    return least


def assert_claims_hold(arm, q):
    """No generated target has the status IMPOSSIBLE, and each row is found if completeness is claimed."""
    solver = pp.AnalyticIk()
    targets = arm.forward_kinematics_batch(q)
    found = solver.solve_all_batch(arm, targets)
    missed = misses(arm, found.q, q) > REPRESENTED
    assert not (missed & found.complete).any()
    for i in np.flatnonzero(missed):
        branches = solver.solve_all(arm, targets[i])
        assert branches.ok or solver.solve(arm, targets[i]).status is not IkStatus.IMPOSSIBLE, q[i]
        if branches.complete and apart(arm, branches.branches, q[i]).min() > REPRESENTED:
            assert distance_from_families(arm, branches.families, q[i]) < REPRESENTED, q[i]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_completeness_claims_at_special_angles_are_true(name):
    arm = arm_named(name)
    found = assert_claims_hold(arm, special_configurations(arm, 700, seed=11))
    assert found.ok.mean() > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "fixed"), [("stanford", {1: 0.0, 4: 0.0}), ("generic_6dof", {1: np.pi / 2, 2: 0.0, 4: 0.0})]
)
def test_a_limited_wrist_at_a_straight_elbow_is_solved(name, fixed):
    """The elbow is known to 1e-8 only, the direction of the wrist is undetermined, and joint 4 is limited."""
    arm = limited_wrist(name)
    q = np.random.default_rng(0).uniform(
        *arm.limits.sampling_range(), (150, 6)
    )  # finds an error in 2 % with a probability of 95 %
    q[:, list(fixed)] = list(fixed.values())
    targets = arm.forward_kinematics_batch(q)
    found = pp.AnalyticIk().solve_batch(arm, targets)
    assert found.ok.all()
    for target, one in zip(targets, found.q, strict=True):
        assert_reaches(arm, one, target)
    assert_claims_hold(arm, q[:30])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stanford", "generic_6dof"])
def test_limited_wrists_are_solved_at_special_angles(name):
    arm = limited_wrist(name)
    assert_claims_hold(arm, special_configurations(arm, 400, seed=12))


@pytest.mark.parametrize(
    "q",
    [
        [2.145058310565056, np.pi, 3.141592678694418, -1.079137891799557, 3.1415926537864363, -2.872578212599749],
        [-0.8909227772814243, 3.1415926535067356, np.pi, -2.664570781074295, 3.1415925725387774, -2.2994096173802],
        [-2.5990038175565724, 3.1415926634558433, 3.1415926489721433, 2.843213068196471, np.pi, -1.8478153303145],
    ],
)
def test_two_double_roots_at_once_are_not_called_complete(q):
    """The arm points straight up: shoulder and elbow are double roots, and the wrist depends on both."""
    assert_claims_hold(arm_named("kinova"), np.array([q]))


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_completeness_is_never_claimed_for_seven_joints(name):
    arm = arm_named(name)
    targets = arm.forward_kinematics_batch(special_configurations(arm, 40, seed=13))
    solver = pp.AnalyticIk(redundant_steps=8)
    assert not solver.solve_all_batch(arm, targets).complete.any()
    assert IkStatus.IMPOSSIBLE not in solver.solve_batch(arm, targets).status


@pytest.mark.parametrize("name", ARMS)
def test_completeness_is_claimed_at_regular_targets(name):
    arm = arm_named(name)
    q = np.random.default_rng(14).uniform(*arm.limits.sampling_range(), (20000, 6))
    found = pp.AnalyticIk().solve_all_batch(arm, arm.forward_kinematics_batch(q))
    assert found.ok.all()
    assert found.complete.mean() > 0.999


def test_batches_and_single_calls_claim_completeness_alike():
    arm = arm_named("puma560")
    targets = arm.forward_kinematics_batch(special_configurations(arm, 200, seed=15))
    targets[::7, :3, 3] *= 1.5
    batch = pp.AnalyticIk().solve_all_batch(arm, targets)
    for target, claimed in zip(targets, batch.complete, strict=True):
        single = pp.AnalyticIk().solve_all(arm, target)
        assert claimed == (single.complete and not single.families)


@pytest.mark.parametrize("tolerance", [1e-9, 1e-7, 1e-6])
def test_the_tolerance_is_part_of_the_completeness_claim(ur5, tolerance):
    """Just beyond a straight elbow: a target that a search reaches within the tolerance is not IMPOSSIBLE."""
    tolerances = {"position_tolerance": tolerance, "orientation_tolerance": tolerance}
    closed, search = pp.AnalyticIk(**tolerances), pp.Clik(**tolerances)
    rng = np.random.default_rng(0)
    searched = solved = 0
    for _ in range(200):
        q = rng.uniform(-3.0, 3.0, 6)
        q[2] = 0.0
        target = np.array(ur5.forward_kinematics(q).homogeneous)
        direction = rng.normal(size=3)
        target[:3, 3] += direction / np.linalg.norm(direction) * tolerance * rng.uniform(0.0, 1.5)
        answer = closed.solve(ur5, target)
        if search.solve(ur5, target, q).ok:
            searched += 1
            solved += answer.ok
            assert answer.status is not IkStatus.IMPOSSIBLE
        if answer.ok:
            assert_reaches(ur5, answer.q, target, 1.000001 * tolerance)
    assert searched > 100
    assert solved >= 0.99 * searched


@pytest.mark.parametrize("name", ["stanford", "irb120", "z1", "ur5"])
@pytest.mark.parametrize("tolerance", [1e-9, 1e-6])
@pytest.mark.slow
def test_targets_off_by_less_than_the_tolerance_are_not_impossible(name, tolerance):
    """A configuration at special angles or limits reaches the targets within the tolerance."""
    arm = arm_named(name)
    rng = np.random.default_rng(21)
    targets = arm.forward_kinematics_batch(special_configurations(arm, 700, seed=16))
    direction = rng.normal(size=(len(targets), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    targets[:, :3, 3] += direction * 0.95 * tolerance * rng.random((len(direction), 1))
    solver = pp.AnalyticIk(position_tolerance=tolerance, orientation_tolerance=tolerance)
    found = solver.solve_all_batch(arm, targets)
    assert found.ok.mean() > 0.9
    for target in targets[~found.ok]:
        assert solver.solve(arm, target).status is IkStatus.NOT_FOUND


@pytest.mark.parametrize(
    "q",
    [
        [-4.0185122892, -6.0354708363, -8.8447127056e-11, -np.pi / 2, np.pi, -0.53117261234],
        [-1.8497003017, -2.2007341673, 0.0, -np.pi / 2, np.pi, 1.2812370847],
        [4.5460066564, 3.5531867545, 3.3008130106e-10, -np.pi / 2, -2 * np.pi, -1.9817788758],
        [5.4613757139, -4.0290278865, 4.1281417943e-11, 4.7108220638, np.pi, -2.2257544812],
    ],
)
def test_a_stretched_elbow_with_parallel_wrist_axes_is_solved(ur5, q):
    """Branches exist only where the wrist happens to keep the elbow straight, which no scanned value meets."""
    target = ur5.forward_kinematics(q)
    found = pp.AnalyticIk().solve_all(ur5, target)
    assert found.ok
    for row in found.q:
        assert_reaches(ur5, row, target.homogeneous)
    assert pp.AnalyticIk().solve(ur5, target).ok
    assert pp.AnalyticIk().solve_all_batch(ur5, [target]).ok[0]
    assert_claims_hold(ur5, np.array([q]))


def test_a_double_root_between_two_simple_ones_is_not_called_impossible():
    arm = pp.load_robot("pr2_left").arm(tcp="l_wrist_flex_link", base="torso_lift_link")
    q = [2.2853981634, -0.2175600694796525, 0.0, -2.290377654558246, 1.5707958056617823, -1.1164156898720963]
    assert pp.AnalyticIk().solve(arm, arm.forward_kinematics(q)).status is not IkStatus.IMPOSSIBLE


def test_families_that_rounding_cuts_into_pieces_are_not_called_complete():
    """The elbow is exactly at its limit, 0; whether a member is within the limits is then a matter of rounding."""
    arm = pp.load_robot("romeo_left").arm(tcp="LWristRollLink", base="torso")
    q = np.array([np.pi / 2, 1.14032, 0.4080726811922806, 0.0, -1.303123311212126])
    found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q))
    assert any(family.upper - family.lower < 1e-4 for family in found.families)
    assert not found.complete


@pytest.mark.parametrize(
    "q",
    [
        [1.5452975915081117, -0.035191685560664654, 0.0, 0.0, -1.5707966439948295, -0.10078082365857188],
        [1.7918579034261903, 1.008364373187371, 1.7576773516372045e-13, 0.0, 1.5707962566224112, -0.6587222467334191],
        [
            0.38049833118519105,
            0.7644607792338042,
            -1.3420183762122563e-07,
            0.0,
            1.5707963269966811,
            -0.0729511160098073,
        ],
    ],
)
def test_no_completeness_is_claimed_where_the_tolerances_leave_a_joint_undetermined(q) -> None:
    """The elbow is straight up to 2e-6 rad, so that the rolls before and behind it are known only by their sum."""
    arm = pp.load_robot("pr2_left").arm(base="torso_lift_link", tcp="l_wrist_flex_link")
    target = np.array(arm.forward_kinematics(q).homogeneous)
    found = pp.AnalyticIk().solve_all(arm, target)
    assert np.abs(found.branches - q).max(axis=1).min() > 1.0  # the generating configuration is another one
    assert not found.complete
    assert not pp.AnalyticIk().solve_all_batch(arm, target[None]).complete[0]
