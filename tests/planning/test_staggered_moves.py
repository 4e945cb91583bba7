"""Moves whose joints choose when they move: around obstacles, at rest at both ends, within all limits."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion import Bounds, Move, MoveSequence, Steering, least_times, rate_excess, rest
from pinproof.planning import Edges

START, GOAL = np.array([-0.8, -0.4]), np.array([0.5, 0.6])


@pytest.mark.parametrize("jerk", [None, 500.0])
def test_a_staggered_move_avoids_an_obstacle_and_takes_little_longer_than_the_lower_bound(
    gantry: pp.Arm, slotted: pp.Scene, jerk: float | None
) -> None:
    checker = pp.CollisionChecker(gantry, slotted)
    bounds = Bounds.of(gantry.limits, gantry.joint_names, jerk)
    steering, edges = Steering(bounds), Edges(checker, 0.05, np.array([START, GOAL]))
    search = steering.staggered(edges.core, START, GOAL[None], 0.05)
    draws = np.random.default_rng(0).random((300, search.draws_per_motion))
    found = search.run(10.0, draws)
    assert not edges.samples_free(START, GOAL)
    lower_bound = least_times(GOAL - START, bounds)
    assert found.goal == 0
    assert lower_bound <= found.duration < 1.35 * lower_bound
    motion = MoveSequence([Move(found)])
    trajectory = motion.trajectory(gantry.joint_names, "", rest(START), rest(GOAL), smooth=jerk is not None)
    assert rate_excess(trajectory, bounds).max() <= 1.0
    assert pp.certify(trajectory, checker).free
    assert np.allclose(trajectory(0.4 * found.duration), found.at_time(0.4 * found.duration)[0], atol=1e-6)
    assert search.run(lower_bound, draws) is None
