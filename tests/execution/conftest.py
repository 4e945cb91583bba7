"""A UR5 between a table and a post, with motions past the post."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp


@pytest.fixture(scope="session")
def checker():
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    table = pp.Obstacle("table", pp.Box(1.2, 1.6, 0.04), pp.pose((0.4, 0, -0.045)))
    post = pp.Obstacle("post", pp.Cylinder(radius=0.04, length=0.4), pp.pose((0.55, 0, 0.2)))
    crate = pp.Obstacle("crate", pp.Box(0.2, 0.2, 0.2), pp.pose((-0.5, 0.5, 0.1)))
    return pp.CollisionChecker(arm, pp.Scene([table, post, crate], allowed=[("base_link", "table")]), margin=0.005)


def timed(checker, *waypoints):
    return pp.time_parametrise(pp.JointPath(waypoints, checker.arm.joint_names), checker.arm.limits)


HIGH = np.array([0.6, -1.4, 1.2, -1.4, -1.57, 0.0])
LOW = np.array([0.6, -0.9, 1.5, -2.2, -1.57, 0.0])
OTHER = np.array([-0.9, -1.4, 1.2, -1.4, -1.57, 0.0])


@pytest.fixture(scope="session")
def swing(checker):
    """Down, up again and around the post, with rests at its corners."""
    return timed(checker, HIGH, LOW, HIGH, OTHER)
