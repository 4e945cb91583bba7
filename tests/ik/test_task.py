"""Residuals and their Jacobians against finite differences, and measured errors against known rotations."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.ik.result import difference, judge, nearest_winding
from pinproof.ik.task import IkTask, make_goal, make_task
from pinproof.spatial import log6

from ..examples import examples
from .plain_rules import left_jacobian_inverse, residual_and_jacobian, rotation_vector

HALF_STEP = 1e-6
TASKS = ["pose", "position", "orientation", "spin_x", "spin_y", "spin_z", (1, 0, 1, 0, 1, 0)]


def moved(arm, q, rng):
    """A pose near that of q: up to 2.5 rad away, since at pi the rotation vector itself jumps."""
    off = rng.normal(size=3)
    off *= rng.uniform(0, 2.5) / np.linalg.norm(off)
    half, angle = off / 2, np.linalg.norm(off) / 2
    quaternion = [*(half / angle * np.sin(angle)), np.cos(angle)]
    return arm.forward_kinematics(q) * pp.pose(rng.uniform(-1, 1, 3), quat_xyzw=quaternion)


def evaluate(arm, task, target, q):
    base_from_tcp, local = arm.local_jacobian(q)
    seen = target.actInv(base_from_tcp)
    turned = np.vstack([seen.rotation @ local[:3], seen.rotation @ local[3:]])
    return task.compiled.residual_and_jacobian(seen.homogeneous, turned)


@pytest.mark.parametrize("name", TASKS, ids=str)
@examples(50)
@given(seed=st.integers(0, 10**6))
def test_jacobian_is_the_derivative_of_the_residual(panda, name, seed):
    """If all angles are selected, the derivative is compared up to the factor Jl, which preserves the residual."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(panda.limits.lower, panda.limits.upper)
    target = moved(panda, q, rng)
    task = make_task(name if isinstance(name, str) else [bool(one) for one in name], 1e-6, 1e-6)
    residual, analytic = evaluate(panda, task, target, q)
    steps = HALF_STEP * np.eye(panda.dof)
    difference = [evaluate(panda, task, target, q + s)[0] - evaluate(panda, task, target, q - s)[0] for s in steps]
    numeric = np.stack(difference, axis=1) / (2 * HALF_STEP)
    if task.mask[3:].all():
        inverse = left_jacobian_inverse(residual[3:])
        assert inverse @ residual[3:] == pytest.approx(residual[3:], abs=1e-12)
        analytic[3:] = inverse @ analytic[3:]
    assert np.abs(analytic - numeric).max() < 1e-7


def test_pose_residual_is_the_displacement_from_the_target(ur5):
    q = np.array([0.3, -1.0, 1.2, 0.4, 0.9, -0.2])
    base_from_tcp, target = ur5.forward_kinematics(q), pp.pose((0.3, 0.2, 0.5), (0.3, 0.2, 0.1))
    seen = target.actInv(base_from_tcp)
    residual, _ = evaluate(ur5, make_task("pose", 1e-6, 1e-6), target, q)
    assert residual == pytest.approx([*seen.translation, *log6(seen)[3:]], abs=1e-12)


@given(seed=st.integers(0, 10**6), near_pi=st.booleans())
def test_compiled_residual_and_jacobian_are_the_same(panda, seed, near_pi):
    rng = np.random.default_rng(seed)
    q = rng.uniform(panda.limits.lower, panda.limits.upper)
    if near_pi:
        axis = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)]
        spin = pp.pose(quat_xyzw=[*(axis / np.linalg.norm(axis)), rng.choice([0.0, 1e-9, 1e-4, -1e-3])])
        target = panda.forward_kinematics(q) * spin
    else:
        target = moved(panda, q, rng)
    task = make_task(IkTask(*[bool(one) for one in rng.random(5) < 0.7], True), 1e-6, 1e-6)
    base_from_tcp, local = panda.local_jacobian(q)
    seen = target.actInv(base_from_tcp)
    turned = np.vstack([seen.rotation @ local[:3], seen.rotation @ local[3:]])
    residual, jacobian = residual_and_jacobian(task, seen.homogeneous, turned)
    compiled_residual, compiled = task.compiled.residual_and_jacobian(seen.homogeneous, turned)
    assert np.linalg.norm(compiled_residual) == pytest.approx(np.linalg.norm(residual), abs=1e-12)
    if abs(np.linalg.norm(rotation_vector(seen.rotation)) - np.pi) > 1e-6:  # there the sign is rounding
        assert compiled_residual == pytest.approx(residual, abs=1e-9)
        assert compiled == pytest.approx(jacobian, abs=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-6, 0.5, 3.0, np.pi - 1e-9, np.pi])
def test_measured_angles_are_accurate_at_every_size(ur5, angle):
    q = ur5.home
    target = ur5.forward_kinematics(q) * pp.pose(
        (3e-4, 4e-4, 0), quat_xyzw=[0, np.sin(angle / 2), 0, np.cos(angle / 2)]
    )
    measured = judge(ur5, target.homogeneous, make_task("pose", 1, 1), q, q)
    assert measured.position_error == pytest.approx(5e-4, abs=1e-15)
    assert measured.orientation_error == pytest.approx(angle, rel=1e-9, abs=3e-16)


def test_unknown_task_names_the_valid_ones(ur5):
    with pytest.raises(pp.UnknownNameError, match="valid: pose, orientation, position, spin_x, spin_y, spin_z"):
        pp.Clik().solve(ur5, pp.pose(), task="posse")


@pytest.mark.parametrize("task", [IkTask, [True] * 5, [1, 1, 1, 1, 1, 1], 7])
def test_a_task_is_a_name_or_six_coordinates(ur5, task):
    with pytest.raises(pp.InputError, match="IkTask"):
        pp.Clik().solve(ur5, pp.pose(), task=task)


def test_a_task_selects_at_least_one_coordinate():
    with pytest.raises(pp.InputError, match="at least one coordinate"):
        IkTask(False, False, False, False, False, False)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_spin_about_an_axis_of_the_target_is_free(ur5, axis):
    """The axis and the origin of the tcp coincide with those of the target; the rotation about the axis is free."""
    target = pp.pose((0.4, 0.2, 0.3), (2.9, 0.3, 0.2))
    found = pp.Clik().solve(ur5, target, task=f"spin_{'xyz'[axis]}").or_raise()
    tcp = ur5.forward_kinematics(found.q)
    assert tcp.translation == pytest.approx(target.translation, abs=1e-6)
    assert tcp.rotation[:, axis] == pytest.approx(target.rotation[:, axis], abs=1.1e-6)
    assert found.orientation_error <= 1e-6


@pytest.mark.parametrize(
    ("task", "expected", "absent"),
    [
        ("pose", "task position", ""),
        ("position", "move the target", "task position|rad "),
        ("orientation", "rotate", "m,"),
    ],
)
def test_the_advice_of_a_failed_search_fits_the_task(task, expected, absent):
    arm = pp.load_robot("scara").arm()
    target = pp.pose((9.0, 0.0, 0.0), (1.0, 1.0, 0.0))
    single = pp.Clik(restarts=3).solve(arm, target, task=task)
    batch = pp.Clik(restarts=3).solve_batch(arm, [target], task=task)
    assert not single.ok
    assert single.message == batch.messages[0]
    assert expected in single.message
    assert not absent or not re.search(absent, single.message)


def test_a_small_residual_asks_for_more_attempts():
    arm = pp.load_robot("ur5").arm()
    target = arm.forward_kinematics(arm.home)
    close = arm.home + 0.05
    found = pp.Clik(restarts=0, max_iterations=1).solve(arm, target, close)
    assert not found.ok
    assert "restarts" in found.message
    assert "out of reach" not in found.message


@pytest.mark.parametrize("selected", [(0, 1, 1, 1, 1, 1), (1, 0, 1, 0, 1, 0), (0, 0, 1, 1, 1, 1), (1, 1, 0, 0, 0, 0)])
def test_the_errors_of_a_solution_are_those_of_the_selected_coordinates(ur5, selected):
    mask = np.array(selected, dtype=bool)
    task, rng = (
        IkTask(**dict(zip(("x", "y", "z", "rx", "ry", "rz"), mask.tolist(), strict=True))),
        np.random.default_rng(1),
    )
    free = []
    for seed in range(6):
        target = ur5.forward_kinematics(rng.uniform(-2, 2, 6))
        result = pp.Clik().solve(ur5, target, rng.uniform(-2, 2, 6), task=task, rng=seed)
        seen = target.actInv(ur5.forward_kinematics(result.q))
        assert result.ok
        assert result.position_error == pytest.approx(np.linalg.norm(seen.translation[mask[:3]]), abs=1e-9)
        if mask[3:].any():
            angles = rotation_vector(seen.rotation)[mask[3:]]
            assert result.orientation_error == pytest.approx(np.linalg.norm(angles), abs=1e-8)
        free.append(np.linalg.norm(seen.translation[~mask[:3]]))
    assert max(free) > 0.05


# -- null-space goals: the task remains satisfied, and the goal is optimal in the null space ---------------------------


def free_direction(arm, q):
    """The unit self-motion (7,) of the elbow."""
    return np.linalg.svd(arm.jacobian(q))[2][-1]


def away_from_centre(arm, q):
    goal = make_goal("centre", arm, q)
    return goal.weight * (q - goal.posture)


def test_centre_has_no_gradient_in_the_null_space(panda):
    rng = np.random.default_rng(2)
    for q in rng.uniform(panda.limits.lower, panda.limits.upper, (10, 7)):
        target = panda.forward_kinematics(q)
        plain, centred = (pp.Clik().solve(panda, target, q, goal=goal).or_raise() for goal in (None, "centre"))
        at_limit = np.minimum(centred.q - panda.limits.lower, panda.limits.upper - centred.q).min() < 1e-3
        pull = abs(away_from_centre(panda, centred.q) @ free_direction(panda, centred.q))
        assert pull < 1e-2 or at_limit
        cost = [away_from_centre(panda, r.q) @ (r.q - make_goal("centre", panda, q).posture) for r in (plain, centred)]
        assert cost[1] <= cost[0] + 1e-9


def test_near_stays_closer_to_q0(panda):
    rng = np.random.default_rng(3)
    lower, upper = panda.limits.lower, panda.limits.upper
    gains = []
    for q in rng.uniform(lower, upper, (10, 7)):
        target, q0 = panda.forward_kinematics(q), np.clip(q + rng.normal(size=7) * 0.2, lower, upper)
        plain, near = (pp.Clik(restarts=0).solve(panda, target, q0, goal=goal) for goal in (None, "near"))
        if plain.ok and near.ok:
            gains.append(np.linalg.norm(plain.q - q0) - np.linalg.norm(near.q - q0))
            assert gains[-1] >= -1e-4
    assert len(gains) >= 5
    assert max(gains) > 1e-3


def test_manipulability_grows(panda):
    def volume(q):
        jacobian = panda.jacobian(q)
        return np.sqrt(np.linalg.det(jacobian @ jacobian.T))

    rng = np.random.default_rng(4)
    for q in rng.uniform(panda.limits.lower, panda.limits.upper, (6, 7)):
        target = panda.forward_kinematics(q)
        plain, better = (pp.Clik().solve(panda, target, q, goal=goal).or_raise() for goal in (None, "manipulability"))
        assert volume(better.q) >= volume(plain.q) * (1 - 1e-6)


def test_a_free_spin_is_used_by_the_goal(ur5):
    target = pp.pose((0.4, 0.2, 0.3), (np.pi, 0, 0))
    q0 = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 1.0])
    plain, near = (pp.Clik().solve(ur5, target, q0, task="spin_z", goal=goal).or_raise() for goal in (None, "near"))
    assert np.linalg.norm(near.q - q0) < np.linalg.norm(plain.q - q0)
    assert ur5.forward_kinematics(near.q).rotation[:, 2] == pytest.approx([0, 0, -1], abs=1.1e-6)


def test_a_goal_has_no_effect_without_redundancy(ur5):
    q = np.array([0.3, -1.2, 1.4, -0.5, 0.7, 0.2])
    target = ur5.forward_kinematics(q)
    centred = pp.Clik().solve(ur5, target, q + 0.05, goal="centre").or_raise()
    assert centred.q == pytest.approx(q, abs=1e-4)


# -- shifts by 2 pi: same pose, within the limits, closest to the reference --------------------------------------------


@given(seed=st.integers(0, 10**6))
def test_shifted_configuration_is_within_limits_has_the_same_pose_and_is_the_closest(ur5, seed):
    rng = np.random.default_rng(seed)
    q, reference = rng.uniform(ur5.limits.lower, ur5.limits.upper), rng.uniform(-15, 15, 6)
    shifted = nearest_winding(ur5, q, reference)
    assert ur5.limits.contains(shifted)
    assert ur5.forward_kinematics(shifted).isApprox(ur5.forward_kinematics(q), 1e-12)
    for turns in (-2, -1, 1, 2):
        other = shifted + turns * 2 * np.pi
        inside = (other >= ur5.limits.lower) & (other <= ur5.limits.upper)
        assert (np.abs(other - reference) >= np.abs(shifted - reference) - 1e-12)[inside].all()


def test_panda_joint_6_keeps_its_range(panda):
    q = panda.home
    q[5] = 3.7
    assert nearest_winding(panda, q, np.zeros(7))[5] == 3.7


def test_a_limit_of_2_pi_is_not_exceeded_by_rounding(planar):
    arm = planar(f"{-6 * np.pi!r} {6 * np.pi!r}")
    for q in np.linspace(0, 2 * np.pi, 1000):
        assert arm.limits.contains(nearest_winding(arm, np.array([q]), np.array([100.0])))


def test_many_rows_are_shifted_at_once(ur5):
    rows = np.random.default_rng(0).uniform(-6, 6, (5, 6))
    reference = np.full(6, 3.0)
    # The elbow's range is one turn; the others have two.
    rows[:, 2] = np.clip(rows[:, 2], -3, 3)
    expected = [nearest_winding(ur5, row, reference) for row in rows]
    assert np.array_equal(nearest_winding(ur5, rows, reference), expected)


def test_a_joint_whose_follower_moves_half_as_far_is_not_shifted(planar):
    assert planar("", "").periodic.tolist() == [True, True]
    assert planar("", "", mimic="j1 -2").periodic.tolist() == [True, True]
    arm = planar("", "", mimic="j1 0.5")
    assert arm.periodic.tolist() == [False, True]
    assert nearest_winding(arm, np.array([0.5, 0.5]), np.array([6.5, 6.5])) == pytest.approx([0.5, 0.5 + 2 * np.pi])


def test_the_difference_ignores_full_rotations(ur5):
    a = np.array([6.2, 0, 0, 0, -6.2, 1.0])
    assert difference(ur5, a, np.zeros(6)) == pytest.approx([6.2 - 2 * np.pi, 0, 0, 0, 2 * np.pi - 6.2, 1.0])


def test_solution_uses_the_rotation_closest_to_q0(ur5):
    q0 = np.array([-5.0, -4.0, 1.0, 5.0, 4.0, -6.0])
    target = ur5.forward_kinematics(q0 + 0.05)
    result = pp.Clik().solve(ur5, target, q0=q0)
    assert result.ok
    assert np.abs(result.q - q0).max() < np.pi


def test_continuous_joint_stays_unwrapped_near_q0(planar):
    arm = planar("", "")
    q = np.array([20.0, -15.0])
    result = pp.Clik().solve(arm, arm.forward_kinematics(q), q0=q + 0.1)
    assert result.q == pytest.approx(q, abs=1e-5)
