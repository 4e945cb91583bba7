"""Completeness: the generating configuration is among the branches, for real and for random arms of each class."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import pinproof as pp
from pinproof import _core
from pinproof.ik import IkStatus
from pinproof.ik.analytic_plan import lines_of, plans_of

from ...examples import examples
from .arms import (
    apart,
    arm_named,
    arm_of,
    assert_reaches,
    conditioning,
    misses,
    others,
    planar,
    random_configurations,
    six_axes,
    spherical,
)

GENERAL = ["xarm6", "crx10ia", "jaco2", "gen3_lite"]
"""No three consecutive axes meet or are parallel."""

INDUSTRIAL = ["ur5", "ur10", "puma560", "irb120", "generic_6dof", "stanford", "z1", *GENERAL]

SAME = 1e-5


def solved(arm, q, least=1e-6, tolerance=SAME):
    """The branches of the targets of q, each of which is among them unless it is singular."""
    found = pp.AnalyticIk(orientation_tolerance=1e-9).solve_all_batch(arm, arm.forward_kinematics_batch(q))
    regular = np.array([conditioning(arm, one) > least for one in q])
    assert (misses(arm, found.q, q)[regular] < tolerance).all()
    return found, regular


def assert_all_reach(arm, found, targets):
    for target, answers in zip(targets, found.q, strict=False):
        for answer in answers[~np.isnan(answers[:, 0])]:
            assert_reaches(arm, answer, target)


@pytest.mark.parametrize("name", INDUSTRIAL)
def test_the_generating_configuration_is_a_branch(name):
    arm = arm_named(name)
    found, _ = solved(arm, random_configurations(arm, 2000, seed=1), 0.0, 1e-9 if name in GENERAL else SAME)
    assert found.complete.mean() > 0.99
    assert max(np.nanmax(found.position_error), np.nanmax(found.orientation_error)) <= 1e-9


@pytest.mark.parametrize("name", INDUSTRIAL)
def test_special_angles_are_solved(name):
    """Joints at right angles, close to zero, and at their limits: a solution is always found."""
    arm = arm_named(name)
    rng = np.random.default_rng(2)
    lower, upper = arm.limits.sampling_range()
    q = random_configurations(arm, 600, seed=3)
    near = rng.choice([0.0, np.pi / 2, -np.pi / 2, np.pi], q.shape) + rng.choice([0.0, 1.0, -1.0], q.shape) * (
        10.0 ** rng.uniform(-12, -1, q.shape)
    )
    q = np.where(rng.random(q.shape) < 0.4, near, q)
    q = np.where(rng.random(q.shape) < 0.1, np.where(rng.random(q.shape) < 0.5, lower, upper), q).clip(lower, upper)
    targets = arm.forward_kinematics_batch(q)
    found = pp.AnalyticIk().solve_all_batch(arm, targets, q)
    regular = np.array([conditioning(arm, one) > 1e-6 for one in q])
    assert (misses(arm, found.q, q)[regular] < SAME).all()
    assert found.ok.all()
    assert_all_reach(arm, found, targets[:100])


@pytest.mark.slow
@examples(110)
@given(made=six_axes())
def test_any_six_joints_with_a_triple_are_solved_also_from_another_branch(made):
    """The set of branches depends neither on the branch that generated the target nor on q0."""
    axes, tool, rng = made
    arm = arm_of(axes, tool)
    many = random_configurations(arm, 25)
    assume(max(conditioning(arm, one) for one in many) > 1e-3)  # arms that are singular everywhere have no closed form
    solved(arm, many)
    q = many[0]
    assume(conditioning(arm, q) > 1e-3)
    branches = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q)).branches
    assume(min(conditioning(arm, one) for one in branches) > 1e-4)
    for one in branches:
        again = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(one), rng.uniform(-1, 1, 6) * 0.5).branches
        assert len(again) == len(branches)
        assert (apart(arm, again[:, None], branches[None]).min(axis=0) < SAME).all()


@pytest.mark.parametrize("name", ["ur5", "puma560", "generic_6dof", "stanford", "crx10ia", "PRRPRR", "RPPPRR"])
def test_dense_random_search_finds_no_further_branch(name):
    """Of arms by name, and of axes in general position by the kinds of the joints."""
    arm = arm_of(others(np.random.default_rng(1), name, False)) if set(name) == {"P", "R"} else arm_named(name)
    solver = pp.Clik(position_tolerance=1e-9, orientation_tolerance=1e-9, restarts=0)
    for q in random_configurations(arm, 4, seed=4):
        target = arm.forward_kinematics(q)
        branches = pp.AnalyticIk().solve_all(arm, target).branches
        starts = random_configurations(arm, 2500, seed=5)
        searched = solver.solve_batch(arm, np.tile(target.homogeneous, (2500, 1, 1)), starts)
        assert searched.ok.sum() > 50
        gaps = apart(arm, searched.q[searched.ok][:, None], branches[None])
        assert (gaps.min(axis=1) < SAME).all()
        assert set(gaps.argmin(axis=1)) == set(range(len(branches)))  # and each branch is come by


def test_branches_are_distinct():
    arm = arm_named("ur5")
    for q in random_configurations(arm, 50, seed=6):
        branches = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q)).branches
        gaps = apart(arm, branches[:, None], branches[None]) + 9 * np.eye(len(branches))
        assert gaps.min() > 1e-6


def test_parallel_and_spherical_triples_give_the_same_branches(generic):
    plans = [plan.with_tolerances(1e-9, 1e-9) for plan in plans_of(generic)]
    kinds = {(plan.core.plan.first_of_triple, plan.core.plan.planar) for plan in plans}
    assert {(1, True), (3, False)} <= kinds
    for q in random_configurations(generic, 200, seed=7):
        target = np.array(generic.forward_kinematics(q).homogeneous)
        sets = [plan.solve(target, plan.home).q for plan in plans]
        for one in sets[1:]:
            assert len(one) == len(sets[0])
            assert (apart(generic, one[:, None], sets[0][None]).min(axis=0) < SAME).all()


@examples(24)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 6), prismatic=st.sets(st.integers(0, 5), max_size=3))
@pytest.mark.slow
def test_joints_in_general_position_are_solved(seed, count, prismatic):
    """Three to six axes in general position, up to three of them prismatic."""
    rng = np.random.default_rng(seed)
    kinds = "".join("P" if k in prismatic else "R" for k in range(count))
    arm = arm_of(others(rng, kinds, False), rng.uniform(-0.5, 0.5, 3))
    q = random_configurations(arm, 20, seed % 1000)
    targets = arm.forward_kinematics_batch(q)
    found, regular = solved(arm, q, 1e-4)
    assert found.complete[regular].mean() > 0.7
    far = pp.AnalyticIk().solve(arm, pp.pose((30.0, 0.0, 0.0)))
    assert far.status is IkStatus.IMPOSSIBLE
    assert_all_reach(arm, found, targets)


def test_two_axes_that_pass_at_two_millimetres_are_solved():
    """They are close to intersecting axes, from which Newton's method does not reach every solution."""
    rng = np.random.default_rng(18457)
    arm = arm_of([*others(rng, "R", False), *others(rng, "R", False)])
    found, _ = solved(arm, random_configurations(arm, 20, seed=9), 0.0)
    assert found.complete.all()


@pytest.mark.parametrize("name", GENERAL)
def test_targets_near_singularities_are_never_reported_as_impossible(name):
    arm = arm_named(name)
    rng = np.random.default_rng(11)
    special = np.array([0.0, np.pi / 2, -np.pi / 2, np.pi])
    lower, upper = arm.limits.sampling_range()
    q = random_configurations(arm, 1500, seed=12)
    near = rng.choice(special, q.shape) + rng.choice([0.0, 1e-12, 1e-9, 1e-7, 1e-6], q.shape) * rng.normal(size=q.shape)
    q = np.where(rng.random(q.shape) < 0.4, near, q).clip(lower, upper)
    found = pp.AnalyticIk().solve_all_batch(arm, arm.forward_kinematics_batch(q))
    missed = misses(arm, found.q, q) > 1e-3
    assert not (missed & found.complete).any()
    assert found.ok.mean() > 0.99


def test_eigenvalues_and_their_condition_numbers_agree_with_numpy():
    rng = np.random.default_rng(13)
    for scale in (1.0, 1e-6, 1e6):
        matrix = scale * rng.normal(size=(16, 16)) * np.logspace(0, 3, 16)
        ours = np.array(_core.eigenvalues(matrix))
        values, right = np.linalg.eig(matrix)
        condition = np.linalg.norm(np.linalg.inv(right), axis=1) * np.linalg.norm(right, axis=0)
        order = [int(np.abs(values - (x + 1j * y)).argmin()) for x, y, _ in ours]
        assert sorted(order) == list(range(16))
        assert np.abs(ours[:, 0] + 1j * ours[:, 1] - values[order]).max() < 1e-12 * np.linalg.norm(matrix)
        assert ours[:, 2] == pytest.approx(condition[order], rel=1e-5)
    triangular = np.triu(np.ones((16, 16)))  # one eigenvalue of multiplicity 16
    assert np.abs(np.array(_core.eigenvalues(triangular))[:, 0] - 1.0).max() < 0.5


@pytest.mark.slow
@examples(30)
@given(
    seed=st.integers(0, 2**32 - 1),
    front=st.sampled_from(["", "R", "P"]),
    core=st.sampled_from(["", "meet", "parallel", "two meet", "two parallel", "PRR", "RPR"]),
    behind=st.sampled_from(["", "R"]),
)
def test_short_arms_are_solved(seed, front, core, behind):
    """Up to five joints with a triple or a pair among them; up to two joints of any kind."""
    rng = np.random.default_rng(seed)
    if core in ("meet", "two meet"):
        middle = spherical(rng, square=False)[: 2 if core == "two meet" else 3]
    else:
        middle = planar(rng, {"parallel": "RRR", "two parallel": "RR"}.get(core, core))
    axes = [*others(rng, front, False), *middle, *others(rng, behind, False)]
    assume(axes)
    arm = arm_of(axes)
    q = random_configurations(arm, 20, seed=9)
    assume(min(conditioning(arm, one) for one in q) > 1e-3)
    solved(arm, q)


@pytest.mark.parametrize("name", ["scara", "so100", "so101"])
def test_short_arms_of_the_catalogue_are_solved(name):
    arm = pp.load_robot(name).arm()
    assert arm.dof < 6
    solved(arm, random_configurations(arm, 300, seed=10), 0.0)


def test_a_planar_arm_has_elbow_up_and_down_and_reports_why_a_shorter_one_does_not_reach(request):
    links = request.getfixturevalue("planar")  # the triples of the helpers have this name too
    answer = pp.AnalyticIk().solve_all(links("-3 3", "-3 3"), pp.pose((1.2, 0.3, 0.0)))
    assert not answer.ok
    assert ("2 joints" in answer.message, "Clik" in answer.message) == (True, True)
    arm = links("-3 3", "-3 3", "-3 3")
    q = np.array([0.3, 0.8, -0.4])
    branches = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q)).branches
    assert len(branches) == 2
    assert sorted(branches[:, 1]) == pytest.approx([-0.8, 0.8], abs=1e-9)


def test_lines_are_the_joint_axes():
    arm = arm_named("puma560")
    lines, tool = lines_of(arm)
    assert tool == pytest.approx(arm.forward_kinematics(np.zeros(6)).homogeneous, abs=1e-12)
    jacobian = arm.jacobian(np.zeros(6))
    for line, column in zip(lines, jacobian.T, strict=True):
        assert line.direction == pytest.approx(column[3:], abs=1e-12)
        assert np.cross(line.direction, tool[:3, 3] - line.point) == pytest.approx(column[:3], abs=1e-12)
