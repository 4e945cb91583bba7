"""Random grasps around random parts: none is called held that an independent measurement does not hold."""

from __future__ import annotations

import importlib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.line_surface import LineSurface
from pinproof.picks.judging.grip import HeldPart, grip_by_fingers

COUNT = 50
"""Number of grasps. An error in 6 % of the grasps is found with a probability of 95 %."""
ROUNDING = 0.05
"""Share of a limit within which sampled areas of the two may be on different sides of it."""

DIRECTION = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def oracle(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    return importlib.import_module("grip_oracle")


@pytest.mark.slow
def test_no_random_grasp_is_called_held_that_does_not_hold(oracle, arms) -> None:
    wrong, refused, seen = [], [], Counter()
    for index in range(COUNT):
        rng = np.random.default_rng([7, index])
        grasp = oracle.random_grasp(rng)
        part = HeldPart(LineSurface.of_obstacle(pp.Obstacle("part", grasp.shape)), grasp.pose)
        found = grip_by_fingers(grasp.moving(arms["ur5"]), part, DIRECTION, oracle.LIMITS)
        truth, by = oracle.judge(grasp, rng)
        seen[truth] += 1
        if by > ROUNDING and found.held != (truth == "held"):
            (wrong if found.held else refused).append((index, found.message, truth, by))
    assert wrong == []
    assert refused == []
    assert seen["held"] > 10
    assert seen["the open fingers overlap"] > 2
    assert seen["gap, area or overlap"] > 20
    assert seen["a finger meets nothing"] > 2
