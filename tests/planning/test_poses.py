"""Sequences of poses: straight in between, stops or roundings at the corners, the index where it ends, the branch."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import pinproof as pp
from pinproof.planning import LinearStatus
from pinproof.spatial import SE3, interpolate, twist_size

from .arms import assert_free, ball_arm

READY = np.array([0.0, -1.3, 1.9, -2.17, -1.57, 0.0])


@pytest.fixture(scope="module")
def free(ur5: pp.Arm) -> pp.CollisionChecker:
    return pp.CollisionChecker(ur5)


def square(arm: pp.Arm, q: np.ndarray) -> list[SE3]:
    """Four poses around the tcp's at q, the second turned."""
    here = arm.forward_kinematics(q)
    poses = []
    for xyz, turn in (((0.1, 0, 0), 0), ((0.1, 0.1, 0), 0.5), ((0.1, 0.1, -0.1), 0), ((0, 0, 0), 0)):
        pose = here * pp.pose((0, 0, 0), (0, 0, turn))
        pose.translation = here.translation + np.array(xyz)
        poses.append(pose)
    return poses


def off_the_lines(arm: pp.Arm, line: list[SE3], path: pp.motion.BlendedPath) -> float:
    """How far (m) the tcp is from the polyline through the poses, at most."""
    points = arm.forward_kinematics_batch(path(np.linspace(*path.domain, 1501)))[:, :3, 3]
    nearest = np.full(len(points), np.inf)
    for first, last in pairwise(line):
        a, ab = first.translation, last.translation - first.translation
        share = np.clip((points - a) @ ab / (ab @ ab), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - share[:, None] * ab, axis=1))
    return float(nearest.max())


def test_every_pose_is_a_stop_and_met(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    poses = square(ur5, READY)
    move = pp.planning.plan_poses(free, READY, poses).or_raise()
    assert move.reached == 3
    assert move.fraction == 1.0
    assert len(move.path.corners) == 3
    assert np.array_equal(move.path.start, READY)
    stops = [ur5.forward_kinematics(move.path(t)) for t in (*move.path.corners, move.path.domain[1])]
    for stop, pose in zip(stops, poses, strict=True):
        assert max(twist_size(stop, pose)) < 3e-6
    assert off_the_lines(ur5, [ur5.forward_kinematics(READY), *poses], move.path) <= move.deviation <= 1e-3
    assert move.certificate.matches(move.path, ur5, free.scene)
    assert_free(move.path, free)


def test_between_two_stops_it_is_the_line_of_plan_linear(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    poses = square(ur5, READY)
    move = pp.planning.plan_poses(free, READY, poses).or_raise()
    begin, end = move.path.corners[:2]
    for s in np.linspace(0, 1, 201):
        wanted = interpolate(poses[0], poses[1], s)
        metres, radians = twist_size(wanted, ur5.forward_kinematics(move.path(begin + s * (end - begin))))
        assert metres <= 1e-3
        assert radians <= 1e-2


@pytest.mark.parametrize("rounding", [0.003, 0.02])
def test_rounded_it_runs_through_and_misses_by_no_more(ur5: pp.Arm, free: pp.CollisionChecker, rounding: float) -> None:
    poses = square(ur5, READY)
    move = pp.planning.plan_poses(free, READY, poses, rounding=rounding).or_raise()
    assert move.path.corners == ()
    assert off_the_lines(ur5, [ur5.forward_kinematics(READY), *poses], move.path) <= rounding + move.deviation
    q = move.path(np.linspace(*move.path.domain, 5001))
    seen = ur5.forward_kinematics_batch(q)[:, :3, 3]
    for pose in poses[:-1]:
        missed = np.linalg.norm(seen - pose.translation, axis=1).min()
        assert 0.2 * rounding < missed <= rounding + move.deviation + 1e-4
    rate = np.diff(q, axis=0)
    assert np.abs(np.diff(rate, axis=0)).max() < 0.05 * np.abs(rate).max()  # no kink
    assert_free(move.path, free)


def test_a_reversal_remains_a_stop_after_rounding(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    out, _, _, home = square(ur5, READY)
    move = pp.planning.plan_poses(free, READY, [out, home], rounding=0.02).or_raise()
    assert len(move.path.corners) == 1
    assert max(twist_size(ur5.forward_kinematics(move.path(move.path.corners[0])), out)) < 3e-6


def test_the_pose_at_which_a_move_stops_is_reported(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    poses = square(ur5, READY)
    far = poses[0].copy()
    far.translation = far.translation + np.array([0.9, 0, 0])
    move = pp.planning.plan_poses(free, READY, [*poses[:2], far, poses[3]])
    assert move.status is LinearStatus.UNREACHABLE
    assert move.reached == 1
    assert 0 < move.fraction < 1
    assert "after pose 1" in move.message
    assert not move.ok
    with pytest.raises(pp.errors.PlanFailed, match="after pose 1"):
        move.or_raise()


def test_contact_and_limit_are_named() -> None:
    arm = ball_arm(("x", "y"))
    wall = pp.Obstacle("wall", pp.Box(0.1, 0.4, 1.0), pp.pose((0.5, 0.5, 0.0)))
    checker = pp.CollisionChecker(arm, pp.Scene([wall]))
    line = [pp.pose((0.0, 0.5, 0)), pp.pose((0.9, 0.5, 0)), pp.pose((0.9, -0.5, 0))]
    move = pp.planning.plan_poses(checker, (0.0, 0.0), line)
    assert move.status is LinearStatus.CONTACT
    assert move.reached == 0
    assert "wall" in move.message
    assert move.fraction == pytest.approx((0.5 + 0.4) / 2.4, abs=1e-3)
    move = pp.planning.plan_poses(checker, (0.0, 0.0), [pp.pose((0, -0.5, 0)), pp.pose((0, -1.5, 0))])
    assert move.status is LinearStatus.LIMIT
    assert move.joints == ("y",)
    assert move.reached == 0
    move = pp.planning.plan_poses(checker, (0.0, 0.0), [pp.pose((0, 1.5, 0))])
    assert move.reached == -1
    assert "before the first pose" in move.message


@pytest.mark.slow
def test_without_a_start_the_branch_that_gets_to_the_end_is_found(ur5: pp.Arm) -> None:
    # A post that only some elbows pass.
    poses = square(ur5, READY)
    post = pp.Obstacle("post", pp.Box(0.06, 0.06, 0.1), pp.pose(ur5.frame_placement(READY, "forearm_link").translation))
    checker = pp.CollisionChecker(ur5, pp.Scene([post]), trust_disabled=True)
    assert not checker.is_free(READY)
    move = pp.planning.plan_poses(checker, None, poses).or_raise()
    assert move.reached == 3
    assert max(twist_size(ur5.forward_kinematics(move.path.start), poses[0])) < 1e-6
    assert_free(move.path, checker)
    again = pp.planning.plan_poses(checker, None, poses)
    assert again.path.control.tobytes() == move.path.control.tobytes()


def test_of_branches_that_get_there_the_quickest_is_taken(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    poses = square(ur5, READY)

    def time_needed(move: pp.planning.PosesPlanResult) -> float:
        q = move.path(np.linspace(*move.path.domain, 400))
        return float((np.abs(np.diff(q, axis=0)) / ur5.limits.velocity).max(axis=1).sum())

    best = time_needed(pp.planning.plan_poses(free, None, poses).or_raise())
    for q in pp.AnalyticIk().solve_all(ur5, poses[0]).branches:
        other = pp.planning.plan_poses(free, q, poses[1:])
        assert not other.ok or best <= time_needed(other) * 1.02


def test_a_redundant_arm_is_started_from_a_sample_of_its_branches(panda: pp.Arm) -> None:
    here = panda.forward_kinematics(panda.home)
    poses = [here, here * pp.pose((0.1, 0, 0)), here * pp.pose((0.1, 0.1, 0.05))]
    one, same = (pp.planning.plan_poses(pp.CollisionChecker(panda), None, poses, rng=3).or_raise() for _ in range(2))
    assert one.path.start.tobytes() == same.path.start.tobytes()
    assert max(twist_size(panda.forward_kinematics(one.path.start), here)) < 1e-5


def test_a_first_pose_that_no_branch_can_take(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    move = pp.planning.plan_poses(free, None, [pp.pose((3, 0, 0))])
    assert move.status is LinearStatus.UNREACHABLE
    assert move.reached == -1
    tool = ur5.forward_kinematics(READY)
    block = pp.Obstacle("block", pp.Box(0.3, 0.3, 0.3), pp.pose(tool.translation))
    move = pp.planning.plan_poses(pp.CollisionChecker(ur5, pp.Scene([block])), None, [tool])
    assert move.status is LinearStatus.CONTACT
    assert "block" in move.message


def test_a_single_pose_and_repeated_ones(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    here = ur5.forward_kinematics(READY)
    still = pp.planning.plan_poses(free, READY, [here, here]).or_raise()
    assert still.reached == 1
    assert np.abs(still.path(np.linspace(*still.path.domain, 9)) - READY).max() < 1e-6
    poses = square(ur5, READY)
    move = pp.planning.plan_poses(free, READY, [poses[0], poses[0], poses[1]]).or_raise()
    assert move.reached == 2
    assert len(move.path.corners) == 1


def test_arguments_that_make_no_sense(ur5: pp.Arm, free: pp.CollisionChecker) -> None:
    with pytest.raises(pp.InputError, match="no pose"):
        pp.planning.plan_poses(free, READY, [])
    with pytest.raises(pp.InputError, match="rounding"):
        pp.planning.plan_poses(free, READY, square(ur5, READY), rounding=-1.0)
    move = pp.planning.plan_poses(free, READY + 9, square(ur5, READY))
    assert move.status is LinearStatus.LIMIT
    assert move.reached == -1
