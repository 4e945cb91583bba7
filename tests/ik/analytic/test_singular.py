"""Singular targets: families of solutions, without NaN."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.model import load_robot

from .arms import apart, arm_of, assert_reaches, others, random_configurations, spherical

CASES = {
    "straight wrist": ("puma560", [0.3, 0.4, -0.5, 0.6, 0.0, 0.7], {"joint_4", "joint_6"}),
    "wrist centre on the first axis": ("irb120", None, {"joint_1", "joint_4", "joint_5", "joint_6"}),
    "four parallel axes": (
        "ur5",
        [0.4, -1.1, 1.3, -0.7, 0.0, 0.2],
        {"shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_3_joint"},
    ),
}


def case(name):
    robot, q, joints = CASES[name]
    arm = pp.load_robot(robot).arm(tcp="tool0") if robot == "ur5" else pp.load_robot(robot).arm()
    return arm, np.array(q if q is not None else over_the_shoulder(arm)), joints


def over_the_shoulder(arm):
    """A configuration of the IRB 120 with its wrist centre on axis 1 (x = y = 0): q3 is computed at q1 = q2 = 0."""

    def beside(q3):
        # The wrist centre: where the tcp would be without the flange, 0.072 m along its approach.
        pose = arm.forward_kinematics([0.0, -0.6, q3, 0.0, 0.0, 0.0]).homogeneous
        approach = arm.jacobian([0.0, -0.6, q3, 0.0, 0.0, 0.0])[3:, 5]
        return (pose[:3, 3] - WRIST * approach)[0]

    low, high = -1.9, 1.2
    values = np.linspace(low, high, 400)
    signs = np.sign([beside(v) for v in values])
    i = int(np.flatnonzero(signs[1:] != signs[:-1])[0])
    low, high = values[i], values[i + 1]
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if np.sign(beside(middle)) == signs[i] else (low, middle)
    return [0.3, -0.6, (low + high) / 2, 0.5, 0.8, -0.4]


WRIST = 0.072


@pytest.mark.parametrize("name", CASES)
def test_the_family_is_reported_and_every_member_reaches_the_target(name):
    arm, q, joints = case(name)
    target = arm.forward_kinematics(q)
    found = pp.AnalyticIk().solve_all(arm, target, q)
    assert found.ok
    assert np.isfinite(found.q).all()
    assert apart(arm, found.branches, q).min() < 1e-6  # q0 itself is the member at q0
    mine = [one for one in found.families if apart(arm, one.q, q) < 1e-6]
    assert mine
    for family in mine:
        assert set(family.joints) == joints
        assert family.parameter in joints
        assert np.abs(arm.jacobian(family.q) @ family.direction).max() < 1e-7
        assert np.linalg.norm(family.direction) == pytest.approx(1.0)
        assert family.lower < q[arm.joint_names.index(family.parameter)] < family.upper
        for value in np.linspace(family.lower, family.upper, 25):
            member = family.at(value)
            assert member[arm.joint_names.index(family.parameter)] == pytest.approx(value, abs=1e-5)
            assert_reaches(arm, member, target)


@pytest.mark.parametrize("name", CASES)
def test_a_family_has_no_member_beyond_its_ends(name):
    arm, q, _ = case(name)
    family = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q), q).families[0]
    with pytest.raises(pp.InputError, match=rf"no member at {family.parameter} = .*; choose a value from"):
        family.at(family.upper + 1e-3)
    with pytest.raises(pp.InputError, match=rf"no member at {family.parameter} = .*; choose a value from"):
        family.at(family.lower - 1e-3)


def test_outer_joints_of_a_straight_wrist_rotate_in_opposite_directions():
    arm, q, _ = case("straight wrist")
    family = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q), q).families[0]
    assert np.abs(family.direction) == pytest.approx([0, 0, 0, np.sqrt(0.5), 0, np.sqrt(0.5)], abs=1e-7)
    sums = {round(float(np.cos(member[3] + member[5])), 9) for member in map(family.at, np.linspace(-1.5, 1.5, 9))}
    assert sums == {round(float(np.cos(q[3] + q[5])), 9)}


@pytest.mark.parametrize("name", CASES)
def test_nearest_returns_the_closest_member(name):
    arm, q, _ = case(name)
    target = arm.forward_kinematics(q)
    family = pp.AnalyticIk().solve_all(arm, target, q).families[0]
    goal = q + np.array([0.02, -0.03, 0.05, 0.3, 0.01, -0.2])
    nearest = family.nearest(goal)
    assert_reaches(arm, nearest, target)
    members = [family.at(value) for value in np.linspace(family.lower, family.upper, 400)]
    assert np.abs(nearest - goal).max() <= min(np.abs(member - goal).max() for member in members) + 1e-6


def test_nearest_of_all_branches_includes_families():
    arm, q, _ = case("straight wrist")
    found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q), q)
    goal = q + np.array([0, 0, 0, 0.6, 0, -0.6])
    assert np.abs(found.nearest(goal) - goal).max() < 1e-5


@pytest.mark.parametrize("name", CASES)
def test_targets_generated_at_any_member_are_solved_from_home(name):
    """Also if the family has no member at the value of the free joint in q0."""
    arm, q, _ = case(name)
    family = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q), q).families[0]
    for value in np.linspace(family.lower, family.upper, 7):
        target = arm.forward_kinematics(family.at(value))
        found = pp.AnalyticIk().solve(arm, target)
        assert found.ok
        assert_reaches(arm, found.q, target.homogeneous)


def test_simultaneous_shoulder_and_wrist_singularity_is_solved():
    arm, q, _ = case("wrist centre on the first axis")
    q[4] = 0.0
    found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q), q)
    assert apart(arm, found.branches, q).min() < 1e-6
    assert {"joint_1", "joint_4"} <= {family.parameter for family in found.families}
    for family in found.families:
        for value in np.linspace(family.lower, family.upper, 9):
            assert_reaches(arm, family.at(value), found.target)


def test_a_free_joint_without_a_solution_at_its_value_in_q0_is_solved():
    """Straight wrist; at the value of joint 4 in q0, joint 6 violates its limits. Other members are found."""
    rng = np.random.default_rng(0)
    axes = [*others(rng, "RRR", square=False), *spherical(rng, square=True)]
    arm = arm_of(axes, limits=[(-3.1, 3.1)] * 3 + [(-2.0, 2.0), (-2.0, 2.0), (-0.1, 0.1)])
    q = np.array([0.4, 0.5, 0.6, 1.5, 0.0, 0.05])
    target = arm.forward_kinematics(q)
    away = q.copy()
    away[3] = -1.9
    found = pp.AnalyticIk().solve_all(arm, target, away)
    assert found.families
    assert any(family.lower <= 1.5 <= family.upper for family in found.families)
    for solved in (
        pp.AnalyticIk().solve(arm, target, away).q,
        pp.AnalyticIk().solve_batch(arm, [target], away).q[0],
        pp.AnalyticIk().solve_all_batch(arm, [target], away).q[0, 0],
    ):
        assert_reaches(arm, solved, target.homogeneous)


def test_regular_targets_have_no_families(ur5):
    q = random_configurations(ur5, 1, seed=1)[0]
    assert pp.AnalyticIk().solve_all(ur5, ur5.forward_kinematics(q)).families == ()


def test_parallel_axes_beside_a_prismatic_joint_have_families_and_are_never_impossible():
    """Joints 1 and 5 are parallel at q3 = pi/2 and turn against each other; the prismatic joints compensate."""
    half = np.pi / 2
    rows = [
        pp.DhRow("j1", half, 0.0, 0.27, 0.0, "revolute", -3.1, 3.1, 1.0),
        pp.DhRow("j2", 0.0, -0.28, 0.0, -half, "prismatic", -0.5, 0.5, 1.0),
        pp.DhRow("j3", 0.0, 0.0, 0.0, half, "revolute", -3.1, 3.1, 1.0),
        pp.DhRow("j4", half, 0.0, 0.1, -half, "prismatic", -0.5, 0.5, 1.0),
        pp.DhRow("j5", 0.4, 0.0, 0.0, 0.6, "revolute", -3.1, 3.1, 1.0),
        pp.DhRow("j6", -2.6, -0.27, 0.0, -half, "prismatic", -0.5, 0.5, 1.0),
    ]
    arm = load_robot(pp.dh_to_urdf(pp.DhTable(rows, convention="standard", name="rails"))).arm()
    q = random_configurations(arm, 30, seed=3)
    q[:, 2] = half
    for one in q:
        found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(one))
        assert found.families
        assert len(found.branches)


def test_parallel_prismatic_joints_at_a_target_are_never_impossible():
    """Joints 2 and 4 are parallel at q3 = pi/2, and move against each other."""
    half, third = np.pi / 2, np.pi / 3
    rows = [
        pp.DhRow("j1", half, -0.034, 0.0, half, "revolute", -3.1, 3.1, 1.0),
        pp.DhRow("j2", 2.961, 0.0, 0.195, third, "prismatic", -0.5, 0.5, 1.0),
        pp.DhRow("j3", half, 0.0, 0.083, third, "revolute", -3.1, 3.1, 1.0),
        pp.DhRow("j4", 0.0, 0.0, 0.063, half, "prismatic", -0.5, 0.5, 1.0),
        pp.DhRow("j5", 0.0, -0.014, -0.105, third, "revolute", -3.1, 3.1, 1.0),
        pp.DhRow("j6", half, 0.0, 0.0, 0.0, "revolute", -3.1, 3.1, 1.0),
    ]
    arm = load_robot(pp.dh_to_urdf(pp.DhTable(rows, convention="standard", name="rails"))).arm()
    q = random_configurations(arm, 30, seed=4)
    assert all(len(pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(one)).branches) for one in q)
    q[:, 2] = half
    for one in q:
        found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(one))
        assert len(found.branches)
        assert not found.complete
