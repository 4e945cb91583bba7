"""Arms and scenes that the planning tests share."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp

from .arms import ball_arm


@pytest.fixture(scope="session")
def ur5() -> pp.Arm:
    return pp.load_robot("ur5").arm()


@pytest.fixture(scope="session")
def free(ur5: pp.Arm) -> pp.CollisionChecker:
    return pp.CollisionChecker(ur5)


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
    parts = (("below", 1.74, -0.33), ("above", 0.54, 0.93))
    return pp.Scene([pp.Obstacle(name, pp.Box(0.02, side, 1.0), pp.pose((0.0, y, 0.0))) for name, side, y in parts])


@pytest.fixture(scope="session")
def slot(gantry: pp.Arm, slotted: pp.Scene) -> pp.CollisionChecker:
    return pp.CollisionChecker(gantry, slotted, margin=0.005)


@pytest.fixture(scope="session")
def detour(slot: pp.CollisionChecker) -> pp.JointPath:
    """Round by the slot, with corners to spare."""
    q = [(-0.8, -0.8), (-0.8, 0.0), (-0.4, 0.2), (-0.8, 0.6), (0.8, 0.6), (0.4, 0.2), (0.8, 0.0), (0.8, -0.8)]
    return pp.JointPath(np.array(q), slot.arm.joint_names)
