"""CLIK: textbook cases, verified solutions, residuals of failures, bounded steps, repeatable results."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.ik import IkSolutions, IkStatus, IkStep

from ..examples import examples


def errors(arm, q, target):
    """Distance and angle between tcp and target, computed independently of the solver."""
    offset = np.linalg.inv(np.asarray(target)) @ arm.forward_kinematics(q).homogeneous
    angle = np.linalg.norm(offset[:3, :3] - np.eye(3)) / np.sqrt(2)  # the chord, 2 sin(angle / 2)
    return np.linalg.norm(offset[:3, 3]), 2 * np.arcsin(min(angle / 2, 1.0))


def reachable(arm, count, seed):
    lower, upper = arm.limits.sampling_range()
    return arm.forward_kinematics_batch(np.random.default_rng(seed).uniform(lower, upper, (count, arm.dof)))


def test_the_textbook_target_is_found_from_zero(generic):
    target = pp.pose((0.4, 0.2, 0.5))
    result = pp.Clik(position_tolerance=1e-9).solve(generic, target, np.zeros(6), task="position")
    assert result.ok
    assert generic.forward_kinematics(result.q).translation == pytest.approx([0.4, 0.2, 0.5], abs=1e-9)
    assert result.restarts == 0
    assert "rad" not in result.message  # the orientation is free


@pytest.mark.parametrize("name", ["ur5", "panda", "generic"])
def test_every_random_reachable_pose_is_found(name, request):
    arm = request.getfixturevalue(name)
    targets = reachable(arm, 300, seed=11)
    batch = pp.Clik().solve_batch(arm, targets, rng=0)
    assert batch.ok.all()
    for target, q in zip(targets, batch.q, strict=True):
        assert arm.limits.contains(q)
        position, orientation = errors(arm, q, target)
        assert position <= 1e-6
        assert orientation <= 1.000001e-6  # the chord is read off a product of rounded matrices


@examples(40)
@given(seed=st.integers(0, 10**6), task=st.sampled_from(["pose", "position", "orientation"]), scale=st.floats(0, 3))
def test_solutions_are_verified_and_failures_report_their_residual(ur5, seed, task, scale):
    """Poses at, near and beyond the workspace boundary, and with joints at their limits."""
    rng = np.random.default_rng(seed)
    q = rng.choice([0.0, np.pi / 2, *rng.uniform(-3, 3, 3)], 6)
    at_limit = rng.random(6) < 0.3
    q[at_limit] = ur5.limits.upper[at_limit]
    target = ur5.forward_kinematics(q)
    target.translation *= scale
    result = pp.Clik(restarts=3).solve(ur5, target, rng=seed, task=task)
    assert ur5.limits.contains(result.q)
    position, orientation = errors(ur5, result.q, target)
    assert result.position_error == pytest.approx(position, abs=1e-12)
    assert result.orientation_error == pytest.approx(orientation, abs=1e-8, rel=1e-6)
    fulfilled = (task == "orientation" or result.position_error <= 1e-6) and (
        task == "position" or result.orientation_error <= 1e-6
    )
    assert result.ok == fulfilled


@pytest.mark.parametrize("joints", [[2], [4], [2, 4], [0, 1, 2, 3, 4, 5]])
def test_singular_targets_are_reached(ur5, joints):
    q = np.array([0.4, -1.1, 1.3, -0.7, 0.9, 0.2])
    q[joints] = 0.0
    assert ur5.singularity(q).smallest < 1e-12
    result = pp.Clik().solve(ur5, ur5.forward_kinematics(q), q0=q + 0.3).or_raise()
    assert max(errors(ur5, result.q, ur5.forward_kinematics(q))) < 1.1e-6


@pytest.mark.parametrize("joints", [[2], [4], [2, 4]])
def test_steps_away_from_a_singular_start_are_found(ur5, joints):
    q0 = np.array([0.4, -1.1, 1.3, -0.7, 0.9, 0.2])
    target = ur5.forward_kinematics(q0)
    q0[joints] = 0.0
    assert pp.Clik().solve(ur5, target, q0=q0).ok


def test_steps_of_a_stretched_arm_stay_bounded_for_an_unreachable_target(planar):
    arm = planar("-3 3", "-3 3")
    steps: list[IkStep] = []
    solver = pp.Clik(restarts=4, max_step=0.2)
    result = solver.solve(arm, pp.pose((2.5, 0, 0)), np.zeros(2), task="position", on_step=steps.append)
    assert result.status is IkStatus.NOT_FOUND
    assert not result.ok
    assert result.position_error == pytest.approx(0.5, abs=1e-6)
    assert result.q == pytest.approx([0, 0], abs=1e-3)
    assert "500 mm" in result.message
    assert len(steps) == result.iterations
    assert max(np.abs(step.step).max() for step in steps) <= 0.2


@examples(25)
@given(seed=st.integers(0, 10**6), max_step=st.floats(0.01, 2.0))
def test_no_step_exceeds_max_step(panda, seed, max_step):
    steps: list[IkStep] = []
    target = reachable(panda, 1, seed)[0]
    pp.Clik(max_step=max_step, restarts=1).solve(panda, target, on_step=steps.append)
    assert all(np.abs(step.step).max() <= max_step * (1 + 1e-12) for step in steps)
    assert all(panda.limits.contains(step.q) for step in steps)


def test_failed_search_returns_the_closest_reachable_point(planar):
    """Two links of 1 m reach a disc of radius 2: the residual is the distance to it."""
    arm = planar("", "")
    for x, y in [(3.0, 0.0), (-4.0, 3.0), (0.0, -100.0)]:
        result = pp.Clik().solve(arm, pp.pose((x, y, 0)), task="position")
        assert not result.ok
        assert result.position_error == pytest.approx(np.hypot(x, y) - 2, abs=1e-4)


def test_failed_search_respects_limits_and_names_the_joint(planar):
    """One link with limits of 1 rad and a target at 2 rad: the result is at the limit."""
    arm = planar("-1 1")
    result = pp.Clik().solve(arm, pp.pose((np.cos(2), np.sin(2), 0)), task="position")
    assert not result.ok
    assert result.q == pytest.approx([1.0])
    assert "joint j1 is at its upper limit" in result.message


def test_panda_joint_6_beyond_pi_is_found(panda):
    q = panda.home
    q[5] = 3.7
    q0 = q - 0.1
    result = pp.Clik().solve(panda, panda.forward_kinematics(q), q0=q0)
    assert result.ok
    assert result.q[5] > np.pi


def test_orientation_task_rotates_the_tcp(ur5):
    result = pp.Clik().solve(ur5, pp.pose((9, 9, 9), (np.pi, 0, 0.3)), task="orientation").or_raise()
    expected = pp.pose(rpy=(np.pi, 0, 0.3)).rotation
    assert ur5.forward_kinematics(result.q).rotation == pytest.approx(expected, abs=2e-6)
    assert result.position_error > 1


def test_solution_at_q0_takes_no_step(ur5):
    q0 = np.array([0.3, -1.0, 1.2, 0.4, 0.9, -0.2])
    result = pp.Clik().solve(ur5, ur5.forward_kinematics(q0), q0)
    assert (result.iterations, result.restarts) == (0, 0)
    assert np.array_equal(result.q, q0)


def test_targets_with_joints_at_their_limits_and_starts_outside_of_them_are_solved_within_the_limits(planar):
    for limits, q, q0 in (
        (("-1 1", "-1 1"), [1.0, -1.0], [-0.5, 0.5]),
        (("-1 1", "-4 4"), [0.9, 1.0], [1.5, 1 + 2 * np.pi]),
    ):
        arm = planar(*limits)
        result = pp.Clik().solve(arm, arm.forward_kinematics(q), q0=q0)
        assert result.ok
        assert arm.limits.contains(result.q)


def test_the_search_continues_after_a_rejected_solution(ur5):
    target = ur5.forward_kinematics([0.3, -1.0, 1.2, 0.4, 0.9, -0.2])
    plain = pp.Clik().solve(ur5, target)
    other = pp.Clik().solve(ur5, target, accept=lambda q: bool(np.abs(q - plain.q).max() > 0.5))
    assert other.ok
    assert np.abs(other.q - plain.q).max() > 0.5
    assert other.restarts > plain.restarts


def test_rejected_solutions_have_the_status_refused(ur5):
    target = ur5.forward_kinematics([0.3, -1.0, 1.2, 0.4, 0.9, -0.2])
    seen = []
    result = pp.Clik(restarts=5).solve(ur5, target, accept=lambda q: seen.append(q.copy()) or q.fill(0.0))
    assert result.status is IkStatus.REFUSED
    assert not result.ok
    assert np.array_equal(result.q, seen[0])  # what accept does to its copy stays with it
    assert "rejected: accept returned False" in result.message
    with pytest.raises(pp.errors.IkFailed, match="rejected: accept returned False") as caught:
        result.or_raise()
    assert caught.value.result is result


def test_batch_entries_equal_their_results(ur5):
    targets = reachable(ur5, 3, seed=1)
    targets[1, :3, 3] = 5.0
    batch = pp.Clik(restarts=2).solve_batch(ur5, targets, q0=np.tile(ur5.home, (3, 1)))
    assert batch.ok.tolist() == [True, False, True]
    assert [result.status for result in batch] == list(batch.status)
    assert batch[1].message == batch.messages[1]
    assert batch.q.shape == (3, 6)
    assert not batch.q.flags.writeable


def test_batch_accepts_poses_and_an_empty_list(ur5):
    poses = [ur5.forward_kinematics(ur5.home + x) for x in (0.1, 0.2)]
    assert pp.Clik().solve_batch(ur5, poses).ok.tolist() == [True, True]
    empty = pp.Clik().solve_batch(ur5, np.empty((0, 4, 4)))
    assert empty.q.shape == (0, 6)


def test_planar_arm_has_its_two_elbows(planar):
    arm = planar("-3 3", "-3 3")
    q = np.array([0.4, 1.1])
    many = pp.Clik().solve_many(arm, arm.forward_kinematics(q), q0=q, task="position")
    assert isinstance(many, IkSolutions)
    assert many.q == pytest.approx(np.array([[0.4, 1.1], [0.4 + 1.1, -1.1]]), abs=1e-5)
    assert "sample" in many.message


def test_ur5_branches_are_distinct_and_sorted_by_distance(ur5):
    q0 = np.array([0.3, -1.2, 1.4, -0.4, 0.9, -0.2])
    target = ur5.forward_kinematics(q0)
    many = pp.Clik().solve_many(ur5, target, q0=q0, attempts=100)
    assert len(many) == 8
    assert many.q[0] == pytest.approx(q0, abs=1e-5)
    distance = np.abs(many.q - q0).max(axis=1)
    assert (np.diff(distance) >= 0).all()
    for i, q in enumerate(many.q):
        assert ur5.limits.contains(q)
        assert max(errors(ur5, q, target)) < 1.1e-6
        turned = np.abs((many.q[i + 1 :] - q + np.pi) % (2 * np.pi) - np.pi)
        assert (turned.max(axis=1, initial=0.0) > 1e-3).all()


def test_solve_many_has_no_solution_for_an_unreachable_target(ur5):
    many = pp.Clik().solve_many(ur5, pp.pose((5, 0, 0)), attempts=3)
    assert len(many) == 0
    assert many.q.shape == (0, 6)
    with pytest.raises(pp.errors.IkFailed, match="attempts"):
        many.or_raise()


def test_results_survive_pickling(ur5):
    result = pp.Clik(restarts=1).solve(ur5, pp.pose((5, 0, 0)))
    copy = pickle.loads(pickle.dumps(result))
    assert copy.status is result.status
    assert np.array_equal(copy.q, result.q)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"position_tolerance": 0.0}, "position_tolerance"),
        ({"orientation_tolerance": float("nan")}, "orientation_tolerance"),
        ({"max_step": -1.0}, "max_step"),
        ({"max_step": "fast"}, "max_step"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"restarts": 1.5}, "restarts"),
        ({"restarts": True}, "restarts"),
        ({"damping": -0.1}, "damping"),
    ],
)
def test_invalid_settings_are_refused_by_name(settings, message):
    with pytest.raises(pp.InputError, match=message):
        pp.Clik(**settings)
    with pytest.raises(TypeError, match="tolerance"):
        pp.Clik(tolerance=1e-3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda arm: pp.Clik().solve(arm, np.full((4, 4), np.nan)), "target"),
        (lambda arm: pp.Clik().solve(arm, np.eye(3)), "target"),
        (lambda arm: pp.Clik().solve(arm, pp.pose(), q0=[0.0] * 5), "shoulder_pan_joint"),
        (lambda arm: pp.Clik().solve(arm, pp.pose(), q0=[np.nan] * 6), "q0"),
        (lambda arm: pp.Clik().solve(arm, pp.pose(), rng=-1), "rng"),
        (lambda arm: pp.Clik().solve(arm, pp.pose(), rng=None), "rng"),
        (lambda arm: [pp.Clik().solve(arm, pp.pose(), rng=seed) for seed in (1, True)], "rng"),
        (lambda arm: pp.Clik().solve_batch(arm, np.eye(4)), "targets"),
        (lambda arm: pp.Clik().solve_batch(arm, 3.0), "targets"),
        (lambda arm: pp.Clik().solve_batch(arm, [np.eye(4), np.ones((4, 4))]), r"targets\[1\]"),
        (lambda arm: pp.Clik().solve_batch(arm, [np.eye(4)], q0=np.zeros((2, 6))), "q0"),
        (lambda arm: pp.Clik().solve_batch(arm, [np.eye(4)], threads=0), "threads"),
        (lambda arm: pp.Clik().solve_many(arm, pp.pose(), count=0), "count"),
    ],
)
def test_misuse_is_refused_by_name(ur5, call, message):
    with pytest.raises(pp.InputError, match=message):
        call(ur5)


@pytest.mark.parametrize(
    "call",
    [
        lambda robot, target: pp.Clik().solve(robot, target),
        lambda robot, target: pp.Clik().solve_batch(robot, [target]),
        lambda robot, target: pp.Clik().solve_many(robot, target),
        lambda robot, target: pp.AnalyticIk().solve_all(robot, target),
        lambda robot, target: pp.AnalyticIk().solve_batch(robot, [target]),
        lambda robot, target: pp.prove_unreachable(robot, target),
        lambda robot, target: pp.track(robot, [target], [0.0] * 6, dt=0.1),
    ],
)
def test_a_robot_or_its_name_instead_of_an_arm_is_refused(ur5, call):
    for robot in (ur5.robot, "ur5"):
        with pytest.raises(pp.InputError, match="arm must be of type Arm"):
            call(robot, pp.pose())
