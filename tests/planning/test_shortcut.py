"""Shortcuts: shorter, proven, never at the price of the ends."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp

from .arms import assert_free


@pytest.fixture
def checker(gantry: pp.Arm, slotted: pp.Scene) -> pp.CollisionChecker:
    return pp.CollisionChecker(gantry, slotted, margin=0.005)


@pytest.fixture
def detour(checker: pp.CollisionChecker) -> pp.JointPath:
    """Round by the slot, with corners to spare."""
    q = [(-0.8, -0.8), (-0.8, 0.0), (-0.4, 0.2), (-0.8, 0.6), (0.8, 0.6), (0.4, 0.2), (0.8, 0.0), (0.8, -0.8)]
    path = pp.JointPath(q, checker.arm.joint_names)
    assert pp.certify(path, checker).free
    return path


@pytest.mark.parametrize("seed", range(4))
def test_shorter_with_the_same_ends_and_proven(checker: pp.CollisionChecker, detour: pp.JointPath, seed: int) -> None:
    short = pp.shortcut(detour, checker, rng=seed)
    assert np.array_equal(short.start, detour.start)
    assert np.array_equal(short.end, detour.end)
    assert short.length < 0.9 * detour.length
    assert pp.certify(short, checker).free
    assert_free(short, checker)


def test_same_rng_same_path_to_the_last_bit(checker: pp.CollisionChecker, detour: pp.JointPath) -> None:
    paths = [pp.shortcut(detour, checker, rng=seed).q.tobytes() for seed in (3, 3, 4)]
    assert paths[0] == paths[1] != paths[2]


def test_never_longer_whatever_the_path(checker: pp.CollisionChecker) -> None:
    rng = np.random.default_rng(0)
    for seed in range(5):
        q = rng.uniform((0.1, -0.9), (0.9, 0.9), (6, 2))  # a convex space: the straight line is free
        path = pp.JointPath(q, checker.arm.joint_names)
        short = pp.shortcut(path, checker, rng=seed)
        assert np.array_equal(short.q, q[[0, -1]])


def test_a_shortcut_through_a_thin_plate_is_not_taken(gantry: pp.Arm) -> None:
    plate = pp.Obstacle("plate", pp.Box(0.002, 1.0, 1.0), pp.pose((0.013, -0.5, 0.0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([plate]))
    path = pp.JointPath([(-0.9, -0.5), (-0.2, 0.5), (0.2, 0.5), (0.9, -0.5)], gantry.joint_names)
    short = pp.shortcut(path, checker, resolution=0.6, attempts=30)  # its samples step over the plate
    assert pp.certify(short, checker).free
    assert_free(short, checker)


def test_repeated_waypoints_are_dropped(checker: pp.CollisionChecker) -> None:
    a, b, c = (-0.8, -0.8), (-0.8, 0.6), (0.8, 0.6)
    path = pp.JointPath([a, a, b, b, b, c, c], checker.arm.joint_names)
    short = pp.shortcut(path, checker, rng=0)
    assert np.array_equal(short.start, a)
    assert np.array_equal(short.end, c)
    assert np.isfinite(short.q).all()
    assert (np.abs(np.diff(short.q, axis=0)).max(axis=1) > 0).all()
    assert short.length <= path.length


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_path_without_motion(checker: pp.CollisionChecker, count: int) -> None:
    path = pp.JointPath([(0.5, 0.5)] * count, checker.arm.joint_names)
    assert pp.shortcut(path, checker).q.tolist() == [[0.5, 0.5]]


def test_no_attempts_still_skips_waypoints(checker: pp.CollisionChecker, detour: pp.JointPath) -> None:
    short = pp.shortcut(detour, checker, attempts=0)
    kept = {tuple(q) for q in short.q}
    assert kept < {tuple(q) for q in detour.q}
    assert short.length < detour.length


def test_arguments_that_make_no_sense(checker: pp.CollisionChecker, detour: pp.JointPath) -> None:
    with pytest.raises(pp.InputError, match="joints"):
        pp.shortcut(pp.JointPath([(0.0, 0.0)], ("a", "b")), checker)
    with pytest.raises(pp.InputError, match="attempts"):
        pp.shortcut(detour, checker, attempts=-1)
    with pytest.raises(pp.InputError, match="resolution"):
        pp.shortcut(detour, checker, resolution=0.0)


def test_a_waypoint_moves_towards_the_line_between_its_neighbours(gantry: pp.Arm) -> None:
    """It cannot be left out, because of a post; the shortest path passes the post closely."""
    checker = pp.CollisionChecker(gantry, pp.Scene([pp.Obstacle("post", pp.Sphere(0.05), pp.pose((0.0, 0.0, 0.0)))]))
    path = pp.JointPath([(-0.8, 0.0), (0.0, 0.8), (0.8, 0.0)], gantry.joint_names)
    short = pp.shortcut(path, checker, attempts=1)
    assert pp.certify(short, checker).free
    assert short.length < 1.75 < path.length
