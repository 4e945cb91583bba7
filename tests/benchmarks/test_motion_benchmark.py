"""The motion benchmark: every row is checked independently, and the page shows the stored figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.planning import limit_excess, motion_benchmark, motion_blocks, pose_goals

import pinproof as pp


@pytest.mark.slow
def test_motions_are_certified_checked_and_shown(mbm: Path) -> None:
    table = motion_benchmark(mbm, problems=1)
    assert {row.variant for row in table["rows"]} == {"", "3 kg"}
    free = next(row for row in table["rows"] if not row.variant)
    assert free.certified
    assert free.faults == ()
    assert free.goals > 1
    assert free.lower_bound <= free.duration <= free.before
    assert free.excess <= 1e-9
    assert set(free.ms) == {"goals", "plan", "optimise"}
    assert motion_blocks(table)["no load"][2].startswith("| all sets | 1 of 1 | 0 |")


def test_every_goal_has_the_pose_and_is_free() -> None:
    arm = pp.load_robot("panda").arm()
    checker = pp.CollisionChecker(arm)
    pose = arm.forward_kinematics(arm.home)
    goals = pose_goals(checker, pose, arm.home)
    assert len(goals) > 5
    assert checker.is_free_batch(goals).all()
    assert np.abs(arm.forward_kinematics_batch(goals) - pose.homogeneous).max() < 1e-5


def test_a_limit_that_is_exceeded_is_found() -> None:
    arm = pp.load_robot("panda").arm()
    path = pp.JointPath([arm.home, arm.home + 0.1], arm.joint_names)
    limits = replace(arm.limits, acceleration=np.full(arm.dof, 5.0))
    trajectory = pp.time_parametrise(path, limits, jerk=100.0)
    assert limit_excess(trajectory, limits, 100.0) <= 1e-9
    assert limit_excess(trajectory, limits, 50.0) == pytest.approx(1.0)
