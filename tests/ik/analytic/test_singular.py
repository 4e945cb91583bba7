"""Singular targets: families of solutions, without NaN."""

import numpy as np
import pytest
from scipy.optimize import brentq

import pinproof as pp
from pinproof.model import load_robot

from .arms import apart, arm_named, arm_of, assert_reaches, others, random_configurations, spherical


def over_the_shoulder():
    """A configuration of the IRB 120 with its wrist centre on axis 1 (x = y = 0): q3 is computed at q1 = q2 = 0."""
    arm = arm_named("irb120")

    def beside(q3):
        # The wrist centre: where the tcp would be without the flange, 0.072 m along its approach.
        q = [0.0, -0.6, q3, 0.0, 0.0, 0.0]
        return arm.forward_kinematics(q).translation[0] - 0.072 * arm.jacobian(q)[3, 5]

    values = np.linspace(-1.9, 1.2, 400)
    signs = np.sign([beside(v) for v in values])
    i = int(np.flatnonzero(signs[1:] != signs[:-1])[0])
    return [0.3, -0.6, brentq(beside, values[i], values[i + 1], xtol=1e-16), 0.5, 0.8, -0.4]


CASES = {
    "straight wrist": ("puma560", [0.3, 0.4, -0.5, 0.6, 0.0, 0.7], {"joint_4", "joint_6"}),
    "wrist centre on the first axis": ("irb120", over_the_shoulder(), {"joint_1", "joint_4", "joint_5", "joint_6"}),
    "four parallel axes": (
        "ur5",
        [0.4, -1.1, 1.3, -0.7, 0.0, 0.2],
        {"shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_3_joint"},
    ),
}


def case(name):
    """The arm, the configuration, the joints of its family, and what is found for its target."""
    arm, q = arm_named(CASES[name][0]), np.array(CASES[name][1])
    return arm, q, CASES[name][2], pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(q), q)


@pytest.mark.parametrize("name", CASES)
def test_the_family_is_reported_and_every_member_reaches_the_target(name):
    arm, q, joints, found = case(name)
    target = arm.forward_kinematics(q)
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
    family = case(name)[-1].families[0]
    for beyond in (family.upper + 1e-3, family.lower - 1e-3):
        with pytest.raises(pp.InputError, match=rf"no member at {family.parameter} = .*; choose a value from"):
            family.at(beyond)


def test_outer_joints_of_a_straight_wrist_rotate_in_opposite_directions():
    _, q, _, found = case("straight wrist")
    family = found.families[0]
    assert np.abs(family.direction) == pytest.approx([0, 0, 0, np.sqrt(0.5), 0, np.sqrt(0.5)], abs=1e-7)
    sums = {round(float(np.cos(member[3] + member[5])), 9) for member in map(family.at, np.linspace(-1.5, 1.5, 9))}
    assert sums == {round(float(np.cos(q[3] + q[5])), 9)}
    goal = q + np.array([0, 0, 0, 0.6, 0, -0.6])
    assert np.abs(found.nearest(goal) - goal).max() < 1e-5  # the nearest of all branches includes families


@pytest.mark.parametrize("name", CASES)
def test_nearest_returns_the_closest_member(name):
    arm, q, _, found = case(name)
    target, family = arm.forward_kinematics(q), found.families[0]
    goal = q + np.array([0.02, -0.03, 0.05, 0.3, 0.01, -0.2])
    nearest = family.nearest(goal)
    assert_reaches(arm, nearest, target)
    members = [family.at(value) for value in np.linspace(family.lower, family.upper, 400)]
    assert np.abs(nearest - goal).max() <= min(np.abs(member - goal).max() for member in members) + 1e-6


@pytest.mark.parametrize("name", CASES)
def test_targets_generated_at_any_member_are_solved_from_home(name):
    """Also if the family has no member at the value of the free joint in q0."""
    arm, _, _, found = case(name)
    family = found.families[0]
    for value in np.linspace(family.lower, family.upper, 7):
        target = arm.forward_kinematics(family.at(value))
        again = pp.AnalyticIk().solve(arm, target)
        assert again.ok
        assert_reaches(arm, again.q, target.homogeneous)


def test_simultaneous_shoulder_and_wrist_singularity_is_solved():
    arm, q, *_ = case("wrist centre on the first axis")
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


def rails(*rows):
    """An arm from the rows (theta, d, a, alpha) of its table; the kind of its joints is P or R."""
    kinds = {"P": ("prismatic", -0.5, 0.5, 1.0), "R": ("revolute", -3.1, 3.1, 1.0)}
    rows = [pp.DhRow(f"j{k}", *numbers, *kinds[kind]) for k, (kind, *numbers) in enumerate(rows, 1)]
    return load_robot(pp.dh_to_urdf(pp.DhTable(rows, convention="standard", name="rails"))).arm()


HALF, THIRD = np.pi / 2, np.pi / 3


def test_parallel_axes_beside_a_prismatic_joint_have_families_and_are_never_impossible():
    """Joints 1 and 5 are parallel at q3 = pi/2 and turn against each other; the prismatic joints compensate."""
    arm = rails(
        ("R", HALF, 0, 0.27, 0), ("P", 0, -0.28, 0, -HALF), ("R", 0, 0, 0, HALF),
        ("P", HALF, 0, 0.1, -HALF), ("R", 0.4, 0, 0, 0.6), ("P", -2.6, -0.27, 0, -HALF),
    )  # fmt: skip
    q = random_configurations(arm, 30, seed=3)
    q[:, 2] = HALF
    for one in q:
        found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(one))
        assert found.families
        assert len(found.branches)


def test_parallel_prismatic_joints_at_a_target_are_never_impossible():
    """Joints 2 and 4 are parallel at q3 = pi/2, and move against each other."""
    arm = rails(
        ("R", HALF, -0.034, 0, HALF), ("P", 2.961, 0, 0.195, THIRD), ("R", HALF, 0, 0.083, THIRD),
        ("P", 0, 0, 0.063, HALF), ("R", 0, -0.014, -0.105, THIRD), ("R", HALF, 0, 0, 0),
    )  # fmt: skip
    q = random_configurations(arm, 30, seed=4)
    assert all(len(pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(one)).branches) for one in q)
    q[:, 2] = HALF
    for one in q:
        found = pp.AnalyticIk().solve_all(arm, arm.forward_kinematics(one))
        assert len(found.branches)
        assert not found.complete
