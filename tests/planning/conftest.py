"""Arms and scenes that the planning tests share."""

from __future__ import annotations

import pytest

import pinproof as pp

from .arms import ball_arm


@pytest.fixture(scope="session")
def ur5() -> pp.Arm:
    return pp.load_robot("ur5").arm()


@pytest.fixture(scope="session")
def panda() -> pp.Arm:
    return pp.load_robot("panda").arm()


@pytest.fixture(scope="session")
def generic() -> pp.Arm:
    return pp.load_robot("generic_6dof").arm()


@pytest.fixture(scope="session")
def gantry() -> pp.Arm:
    """A ball of 5 cm in the square [-1, 1]^2: what it can do is plain on paper."""
    return ball_arm(("x", "y"))


@pytest.fixture(scope="session")
def turntable() -> pp.Arm:
    """A ball 1 m out on a continuous joint."""
    return ball_arm(("turn",))


@pytest.fixture(scope="session")
def slotted() -> pp.Scene:
    """A wall along the y axis of the gantry, 2 cm thick, with a slot of 12 cm about y = 0.6."""
    return pp.Scene(
        [
            pp.Obstacle("below", pp.Box(0.02, 1.74, 1.0), pp.pose((0.0, -0.33, 0.0))),
            pp.Obstacle("above", pp.Box(0.02, 0.54, 1.0), pp.pose((0.0, 0.93, 0.0))),
        ]
    )
