"""Costs as null-space goals: the task stays satisfied, and the cost is optimal among its solutions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import pinproof as pp
from pinproof.errors import InputError
from pinproof.ik import look_at, posture


@pytest.fixture(scope="module")
def panda() -> pp.Arm:
    return pp.load_robot("panda").arm(tcp="panda_hand")


@pytest.fixture(scope="module")
def ur5() -> pp.Arm:
    return pp.load_robot("ur5").arm(tcp="tool0")


def slopes(cost, q: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """The gradient (n,) of a cost by differences of another step than that of the package."""
    return np.array([(cost(q + step * e) - cost(q - step * e)) / (2 * step) for e in np.eye(len(q))])


def along_solutions(arm: pp.Arm, q: np.ndarray, rows: slice = slice(None)) -> np.ndarray:
    """(n, k) the motions of joints inside their limits that do not move the tcp in the rows of its Jacobian."""
    inside = (q > arm.limits.lower + 1e-5) & (q < arm.limits.upper - 1e-5)
    jacobian = np.concatenate([arm.jacobian(q)[rows], np.eye(arm.dof)[~inside]])
    _, values, right = np.linalg.svd(jacobian)
    return right[(values > 1e-9).sum() :].T


@pytest.mark.parametrize("seed", range(12))
def test_a_cost_is_stationary_along_the_solutions_and_not_above_that_without_a_goal(panda, seed: int) -> None:
    rng = np.random.default_rng(seed)
    lower, upper = panda.limits.sampling_range()
    q0 = rng.uniform(0.8 * lower + 0.2 * upper, 0.2 * lower + 0.8 * upper)
    target = panda.forward_kinematics(q0)
    centre, weights = rng.uniform(lower, upper), rng.uniform(0.2, 2.0, panda.dof)

    def cost(q: np.ndarray) -> float:
        return float((weights * (q - centre) ** 2).sum() + 0.3 * np.sin(2 * q).sum())

    plain = pp.Clik().solve(panda, target, q0).or_raise()
    found = pp.Clik().solve(panda, target, q0, goal=cost).or_raise()
    assert found.engine == "pinocchio"
    assert not panda.limits.violations(found.q, panda.joint_names)
    error = pp.pose().inverse() * target.actInv(panda.forward_kinematics(found.q))
    assert np.linalg.norm(error.homogeneous - np.eye(4)) < 4e-6
    assert cost(found.q) < cost(plain.q)
    gradient = slopes(cost, found.q)
    assert np.abs(along_solutions(panda, found.q).T @ gradient).max(initial=0.0) < 1e-2 * np.linalg.norm(gradient)


def test_the_optimum_is_that_of_a_general_optimiser(panda) -> None:
    q0 = panda.home + 0.1
    target = panda.forward_kinematics(q0)
    wanted = panda.home + np.array([0.4, 0, -0.3, 0, 0.2, 0, 0])
    found = pp.Clik().solve(panda, target, q0, goal=posture(wanted)).or_raise()

    def error(q: np.ndarray) -> np.ndarray:
        difference = target.actInv(panda.forward_kinematics(q)).homogeneous
        return np.array([*difference[:3, 3], difference[2, 1], difference[0, 2], difference[1, 0]])

    other = minimize(posture(wanted), q0, constraints={"type": "eq", "fun": error}, method="SLSQP", tol=1e-14)
    np.testing.assert_allclose(found.q, other.x, atol=2e-3)
    assert posture(wanted)(found.q) <= other.fun + 1e-6


@pytest.mark.parametrize("seed", range(6))
def test_joints_at_limits_are_held_and_the_others_improve(panda, seed: int) -> None:
    """The tip has a place only, so that four joints are free; the posture is beyond the limits of half of them."""
    rng = np.random.default_rng(seed)
    lower, upper = panda.limits.lower, panda.limits.upper
    q0 = rng.uniform(0.7 * lower + 0.3 * upper, 0.3 * lower + 0.7 * upper)
    cost = posture(np.where(rng.random(panda.dof) < 0.5, upper + 0.5, (lower + upper) / 2))
    target = panda.forward_kinematics(q0)
    found = pp.Clik().solve(panda, target, q0, task="position", goal=cost).or_raise()
    assert not panda.limits.violations(found.q, panda.joint_names)

    def error(q: np.ndarray) -> np.ndarray:
        return panda.forward_kinematics(q).translation - target.translation

    other = minimize(
        cost,
        found.q,
        constraints={"type": "eq", "fun": error},
        bounds=list(zip(lower, upper, strict=True)),
        method="SLSQP",
    )
    assert cost(found.q) <= other.fun + 1e-2 * abs(cost(q0) - other.fun)


@pytest.mark.parametrize("seed", range(5))
def test_the_result_is_never_worse_than_the_first_solution_even_of_a_cost_without_slopes(panda, seed: int) -> None:
    q0 = panda.home + 0.3 * np.random.default_rng(seed).normal(size=7)
    target = panda.forward_kinematics(np.clip(q0 + 0.1, panda.limits.lower, panda.limits.upper))

    def noise(q: np.ndarray) -> float:
        return float(np.sin(1e5 * q).sum())

    plain = pp.Clik(engine="pinocchio").solve(panda, target, q0).or_raise()
    assert noise(pp.Clik().solve(panda, target, q0, goal=noise).or_raise().q) <= noise(plain.q)


def test_weighted_costs_are_traded_by_their_weights(panda) -> None:
    q0 = panda.home
    target = panda.forward_kinematics(q0)
    one, two = posture(q0 + 0.5 * np.eye(7)[0]), posture(q0 - 0.5 * np.eye(7)[0])
    firsts = [
        pp.Clik().solve(panda, target, q0, goal=[(a, one), (b, two)]).or_raise().q[0]
        for a, b in ((9, 1), (1, 1), (1, 9))
    ]
    assert firsts[0] > firsts[1] > firsts[2]
    np.testing.assert_allclose(firsts[1], q0[0], atol=1e-3)


def test_an_axis_looks_at_a_point_where_the_task_leaves_the_orientation_free(ur5) -> None:
    q0, point = ur5.home, np.array([0.9, 0.1, 0.05])
    target = ur5.forward_kinematics(q0)
    found = pp.Clik().solve(ur5, target, q0, task="position", goal=look_at(ur5, point)).or_raise()
    place = ur5.forward_kinematics(found.q)
    assert np.linalg.norm(place.translation - target.translation) < 1e-6
    ray = point - place.translation
    assert place.rotation[:, 2] @ ray / np.linalg.norm(ray) > np.cos(1e-2)
    # and of the configurations that look at it, the one that moves the joints least
    near = pp.Clik().solve(ur5, target, q0, task="position", goal=[(1.0, look_at(ur5, point)), (1e-3, posture(q0))])
    away = [np.linalg.norm(q - q0) for q in (near.or_raise().q, found.q)]
    assert away[0] < away[1] + 1e-6


def test_the_ready_costs_have_the_slopes_of_their_formulas(ur5) -> None:
    q = ur5.home + 0.1
    weights = np.arange(1.0, 7.0)
    np.testing.assert_allclose(slopes(posture(ur5.home, weights), q), weights * 0.1, atol=1e-8)
    point, axis = np.array([0.4, 0.3, 0.2]), np.array([0.0, 0.6, 0.8])
    place, jacobian = ur5.forward_kinematics(q), ur5.jacobian(q)
    ray = point - place.translation
    unit, pointing = ray / np.linalg.norm(ray), place.rotation @ axis
    turning = -np.cross(pointing, unit) @ jacobian[3:]
    moving = (pointing - (pointing @ unit) * unit) / np.linalg.norm(ray) @ jacobian[:3]
    np.testing.assert_allclose(slopes(look_at(ur5, point, axis), q), turning + moving, atol=1e-8)


def test_a_batch_gives_the_results_of_single_calls(panda) -> None:
    Q = panda.home + 0.1 * np.random.default_rng(1).normal(size=(3, 7))
    targets = [panda.forward_kinematics(q) for q in Q]
    batch = pp.Clik().solve_batch(panda, targets, Q, goal=posture(panda.home))
    for target, q0, q in zip(targets, Q, batch.q, strict=True):
        np.testing.assert_array_equal(pp.Clik().solve(panda, target, q0, goal=posture(panda.home)).q, q)


def test_the_cost_of_an_arm_without_redundancy_changes_nothing(ur5) -> None:
    q0 = ur5.home + 0.1
    target = ur5.forward_kinematics(q0)
    found = pp.Clik().solve(ur5, target, q0, goal=posture(ur5.home + 1.0)).or_raise()
    np.testing.assert_allclose(found.q, q0, atol=1e-5)


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        (lambda q: np.nan, "finite number"),
        (lambda q: q, "finite number"),
        ([], "pairs of a weight"),
        ([posture(np.zeros(7))], "pairs of a weight"),
        ([(-1.0, posture(np.zeros(7)))], "weight"),
        ("closest", "centre"),
        (3, "goal"),
    ],
)
def test_what_a_goal_lacks_is_named(panda, goal, words: str) -> None:
    with pytest.raises(InputError, match=words):
        pp.Clik().solve(panda, panda.forward_kinematics(panda.home), panda.home, goal=goal)


def test_a_cost_is_refused_where_python_cannot_be_called(panda) -> None:
    target = panda.forward_kinematics(panda.home)
    with pytest.raises(InputError, match="engine='auto'"):
        pp.Clik(engine="compiled").solve(panda, target, panda.home, goal=posture(panda.home))
    with pytest.raises(InputError, match="track"):
        pp.track(panda, [target, target], panda.home, dt=0.1, goal=posture(panda.home))
