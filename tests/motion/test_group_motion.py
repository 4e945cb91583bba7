"""The motion of a joint group as one trajectory for each arm, and back."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion import JointPath, TimedColumns, merged, separate, synchronise, time_parametrise


@pytest.fixture(scope="module")
def cell():
    arm = pp.load_robot("ur5").arm()
    return pp.assemble({"a": (arm, np.eye(4)), "b": (arm, pp.pose(xyz=(1.5, 0, 0)))})


def timed(names, start, end, *, jerk=None):
    n = len(names)
    path = JointPath(np.array([np.full(n, start), np.full(n, end)]), names)
    limits = pp.JointLimits(np.full(n, -6.0), np.full(n, 6.0), np.full(n, 1.0), np.full(n, 2.0))
    return time_parametrise(path, limits, jerk=jerk)


@pytest.mark.parametrize("jerk", [None, 20.0])
def test_separated_trajectories_are_combined_to_the_same_motion(cell, tmp_path, jerk) -> None:
    whole = timed(cell.joint_names, 0.1, 0.7, jerk=jerk)
    parts = separate(whole, cell)
    assert parts["b"].joint_names == pp.load_robot("ur5").arm().joint_names
    loaded = {}
    for name, part in parts.items():
        part.save(tmp_path / f"{name}.json")
        loaded[name] = pp.Trajectory.load(tmp_path / f"{name}.json")
    assert synchronise(loaded, cell).digest() == whole.digest()


@pytest.mark.parametrize("jerk", [None, 20.0])
def test_arms_with_other_clocks_keep_their_motion_and_wait(cell, jerk) -> None:
    names = pp.load_robot("ur5").arm().joint_names
    parts = {"a": timed(names, 0.0, 0.9, jerk=jerk), "b": timed(names, 0.2, 0.3, jerk=jerk)}
    whole = synchronise(parts, cell, wait=True)
    t = np.linspace(0.0, whole.duration, 200)
    for name, part in parts.items():
        then = np.minimum(t, part.duration)
        assert np.allclose(whole(t)[:, cell.indices(name)], part(then), atol=1e-12)
    with pytest.raises(pp.InputError, match="different durations"):
        synchronise(parts, cell)


def test_arm_that_is_missing_or_moves_at_its_end_is_refused(cell) -> None:
    names = pp.load_robot("ur5").arm().joint_names
    moving = pp.Trajectory([0.0, 0.1], np.zeros((2, 6)), np.array([np.zeros(6), np.ones(6)]), names)
    longer = timed(names, 0.0, 0.9)
    with pytest.raises(pp.InputError, match="arms b"):
        synchronise({"a": longer}, cell)
    with pytest.raises(pp.InputError, match="arms a"):
        synchronise({"b": longer}, cell)
    with pytest.raises(pp.InputError, match="'b' moves"):
        synchronise({"a": longer, "b": moving}, cell, wait=True)
    with pytest.raises(pp.UnknownNameError, match="unknown arm 'c'"):
        synchronise({"a": longer, "c": longer}, cell)


def test_group_with_a_shared_joint_is_not_separated() -> None:
    group = pp.load_robot("tiago_dual_left").arms("left", "right", base="torso_fixed_link")
    with pytest.raises(pp.InputError, match="torso_lift_joint"):
        separate(timed(group.joint_names, 0.0, 0.1), group)


def test_quintic_and_a_cubic_with_jumping_acceleration_are_not_combined() -> None:
    quintic = pp.Trajectory([0.0, 1.0], [[0.0], [1.0]], np.zeros((2, 1)), ["a"], accelerations=np.zeros((2, 1)))
    jumping = pp.Trajectory([0.0, 0.5, 1.0], [[0.0], [1.0], [1.5]], np.zeros((3, 1)), ["b"])
    parts = [
        TimedColumns(name, each, [0], np.array([k])) for k, (name, each) in enumerate((("x", quintic), ("y", jumping)))
    ]
    with pytest.raises(pp.InputError, match="jump"):
        merged(parts, ("a", "b"))
