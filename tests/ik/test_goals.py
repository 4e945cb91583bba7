"""Null-space goals: the task remains satisfied, and the goal is optimal in the null space."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.ik.task import make_goal


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
