"""Reach maps agree with inverse kinematics and the collision checker for each pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.errors import FileError
from pinproof.picks import ReachMap
from pinproof.spatial import matrix

from ..examples import examples

TABLE = pp.Obstacle("table", pp.Box(2.0, 2.0, 0.05), pp.pose(xyz=(0.6, 0.0, -0.2)))
WALL = pp.Obstacle("wall", pp.Box(0.05, 1.0, 1.0), pp.pose(xyz=(0.45, 0.3, 0.2)))
BOX = pp.picks.ReachRegion.box((-0.6, -0.6, 0.1), (0.6, 0.6, 0.5), 0.4)
DOWN = pp.picks.tool_orientations(spins=3)


@pytest.fixture(scope="module")
def ur5() -> pp.CollisionChecker:
    return pp.CollisionChecker(pp.load_robot("ur5").arm("tool0"), pp.Scene([TABLE, WALL]), margin=0.002)


@pytest.fixture(scope="module")
def map_of_ur5(ur5: pp.CollisionChecker) -> ReachMap:
    return pp.reach_map(ur5, BOX, DOWN)


def _targets(arm: pp.Arm, found: ReachMap) -> list[tuple[tuple[int, int], np.ndarray]]:
    frames = []
    for i, point in enumerate(found.region.points):
        for k, rotation in enumerate(found.orientations):
            root_from_tip = np.eye(4)
            root_from_tip[:3, :3], root_from_tip[:3, 3] = rotation, point
            frames.append(((i, k), np.linalg.inv(matrix(arm.root_from_base)) @ root_from_tip))
    return frames


def test_a_closed_form_judges_every_branch(ur5: pp.CollisionChecker, map_of_ur5: ReachMap) -> None:
    assert map_of_ur5.complete
    assert 0 < map_of_ur5.free.sum() < map_of_ur5.reachable.sum() < map_of_ur5.reachable.size
    for where, target in _targets(ur5.arm, map_of_ur5):
        branches = pp.AnalyticIk().solve_all(ur5.arm, target).branches
        free = [q for q in branches if ur5.is_free(q)]
        assert map_of_ur5.reachable[where] == bool(len(branches))
        assert map_of_ur5.free[where] == bool(free)
        if free:  # it reports the most manipulable branch
            volumes = [np.sqrt(np.linalg.det(J @ J.T)) for J in map(ur5.arm.jacobian, free)]
            assert map_of_ur5.manipulability[where] == pytest.approx(max(volumes), rel=1e-6)
            assert any(map_of_ur5.clearance[where] == pytest.approx(ur5.clearance(q)) for q in free)
        else:
            assert np.isnan(map_of_ur5.manipulability[where])
            assert np.isnan(map_of_ur5.clearance[where])


def test_a_redundant_arm_is_searched_and_what_is_free_is_free() -> None:
    checker = pp.CollisionChecker(pp.load_robot("panda").arm(), pp.Scene([TABLE, WALL]))
    found = pp.reach_map(checker, BOX, DOWN)
    assert not found.complete
    assert 0 < found.free.sum() < found.free.size
    for where, target in _targets(checker.arm, found):
        if found.reachable[where]:
            assert pp.Clik().solve(checker.arm, target).ok
        elif np.linalg.norm(target[:3, 3]) < 0.3:
            assert not pp.Clik(restarts=3).solve(checker.arm, target).ok


def test_targets_beyond_the_span_of_an_arm_are_not_searched() -> None:
    """On an arm that is searched: poses that its own configurations take are never left out."""
    from pinproof.picks.batch.screening import Span

    rng = np.random.default_rng(1)
    for name in ("panda", "stanford", "scara", "ur5", "iiwa14"):
        arm = pp.load_robot(name).arm()
        low, high = arm.limits.sampling_range()
        targets = arm.forward_kinematics_batch(rng.uniform(low, high, (300, arm.dof)))
        assert Span(arm).may_reach(targets).all()
        targets[:, :3, 3] += 10.0
        assert not Span(arm).may_reach(targets).any()


def test_the_answers_do_not_depend_on_the_number_of_threads(ur5: pp.CollisionChecker, map_of_ur5: ReachMap) -> None:
    again = pp.reach_map(ur5, BOX, DOWN, threads=3)
    assert np.array_equal(again.free, map_of_ur5.free)
    assert np.array_equal(again.clearance, map_of_ur5.clearance, equal_nan=True)


def test_the_tip_is_what_reaches_the_points(ur5: pp.CollisionChecker) -> None:
    tip = pp.pose(xyz=(0.0, 0.0, 0.1))
    point = np.array([0.3, -0.4, 0.2])
    of_tip = pp.reach_map(ur5, pp.picks.ReachRegion(point[None]), DOWN, tip=tip)
    of_tcp = pp.reach_map(ur5, pp.picks.ReachRegion(point[None] + [0.0, 0.0, 0.1]), DOWN)  # the tool looks down
    assert of_tip.manipulability == pytest.approx(of_tcp.manipulability)


def test_the_region_is_transformed_to_the_base_of_a_moved_robot(ur5: pp.CollisionChecker) -> None:
    stands = pp.pose(xyz=(0.3, -0.2, 0.1), rpy=(0.0, 0.0, 0.7))
    moved = pp.reach_map(ur5, BOX, DOWN, world_from_root=stands)
    seen = (BOX.points - stands.translation) @ stands.rotation
    turned = np.array([stands.rotation.T @ frame for frame in DOWN])
    same = pp.reach_map(ur5, pp.picks.ReachRegion(seen), turned)
    assert np.array_equal(moved.free, same.free)
    assert moved.free.any()
    assert np.array_equal(moved.region.points, BOX.points)
    assert "the robot at (0.3, -0.2, 0.1) m" in moved.title


def test_a_wall_taken_away_is_only_won(ur5: pp.CollisionChecker, map_of_ur5: ReachMap) -> None:
    change = pp.picks.ReachComparison(map_of_ur5, pp.reach_map(ur5.with_scene(pp.Scene([TABLE])), BOX, DOWN))
    assert change.won.any()
    assert not change.lost.any()
    assert "won" in change.summary


def test_maps_of_other_poses_are_not_compared(ur5: pp.CollisionChecker, map_of_ur5: ReachMap) -> None:
    other = pp.reach_map(ur5, pp.picks.ReachRegion.box((0, 0, 0), (0.4, 0, 0), 0.2), DOWN)
    with pytest.raises(pp.InputError, match="different regions"):
        pp.picks.ReachComparison(map_of_ur5, other)


def test_a_map_comes_back_from_its_file(map_of_ur5: ReachMap, tmp_path: Path) -> None:
    map_of_ur5.save(tmp_path / "map.npz")
    back = ReachMap.load(tmp_path / "map.npz")
    assert not pp.picks.ReachComparison(back, map_of_ur5).won.any()
    assert np.array_equal(back.free, map_of_ur5.free)
    assert back.summary == map_of_ur5.summary
    # The table has a row for each point
    map_of_ur5.save(tmp_path / "map.csv")
    rows = (tmp_path / "map.csv").read_text().splitlines()
    assert len(rows) == 1 + len(BOX)
    assert float(rows[1].split(",")[4]) == pytest.approx(map_of_ur5.free_share[0])


def test_the_slices_show_the_share_by_colour(map_of_ur5: ReachMap, tmp_path: Path) -> None:
    from PIL import Image

    map_of_ur5.save(tmp_path / "map.png")
    pixels = np.asarray(Image.open(tmp_path / "map.png").convert("RGB")).reshape(-1, 3)
    for colour in ((253, 231, 36), (68, 1, 84)):  # all and none, in matplotlib's viridis
        assert (np.abs(pixels.astype(int) - colour).max(axis=1) <= 2).sum() > 500


def test_files_that_are_not_maps_and_slices_of_single_points_are_refused(
    ur5: pp.CollisionChecker, tmp_path: Path
) -> None:
    for content in (b"", b"PK nonsense", b"x,y\n1,2\n"):
        (tmp_path / "odd.npz").write_bytes(content)
        with pytest.raises(FileError, match=r"odd\.npz"):
            ReachMap.load(tmp_path / "odd.npz")
    with pytest.raises(pp.InputError, match="grid"):
        pp.reach_map(ur5, pp.picks.ReachRegion([[0.3, 0.0, 0.3]]), DOWN).save(tmp_path / "map.png")


def test_regions_and_directions_that_make_no_sense_are_refused() -> None:
    for lower, upper, step, named in (
        ((0, 0, 0), (1, -1, 0), 0.1, "lower y"),
        ((0, 0, 0), (1, 1, 1), 0.0, "step"),
        ((0, 0, 0), (1, 1, 1), 1e-4, "larger"),
        ((0, 0, np.nan), (1, 1, 1), 0.1, "lower"),
    ):
        with pytest.raises(pp.InputError, match=named):
            pp.picks.ReachRegion.box(lower, upper, step)
    for directions in ("down", [[0, 0, 1], [0, 1]], [0, 0], [[0, 0, "x"]], [0, 0, np.nan]):
        with pytest.raises(pp.InputError, match="directions"):
            pp.picks.tool_orientations(directions)


@given(st.integers(1, 60), st.floats(0.01, np.pi), st.integers(1, 12), st.integers(0, 1000))
@examples(50)
def test_orientations_are_rotations_inside_their_cone(count: int, angle: float, spins: int, seed: int) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    directions = pp.picks.approach_directions(axis, angle, count)
    frames = pp.picks.tool_orientations(directions, spins)
    assert frames.shape == (count * spins, 3, 3)
    assert np.abs(frames @ frames.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    assert np.linalg.det(frames) == pytest.approx(1.0)
    assert frames[::spins, :, 2] == pytest.approx(directions)
    assert (directions @ (axis / np.linalg.norm(axis)) >= np.cos(angle) - 1e-9).all()


def test_directions_all_round_weigh_the_sphere_evenly() -> None:
    directions = pp.picks.approach_directions(half_angle=np.pi, count=500)
    assert np.abs(directions.mean(axis=0)).max() < 0.01
    assert np.abs(directions.T @ directions / 500 - np.eye(3) / 3).max() < 0.01

    one, several = pp.picks.tool_orientations((0, 1, 0), 2), pp.picks.tool_orientations([(0, 1, 0)], 2)
    np.testing.assert_array_equal(one, several)
    assert one.shape == (2, 3, 3)
