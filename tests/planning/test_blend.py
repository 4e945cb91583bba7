"""Rounded corners: proven one by one, within the deviation, smaller if a body is in the corner, otherwise a stop."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision import is_proven_free
from pinproof.motion import Bezier

from .arms import assert_free, ball_arm


def arm_and_path(*q: tuple[float, float]) -> tuple[pp.Arm, pp.JointPath]:
    arm = ball_arm(("x", "y"))
    return arm, pp.JointPath(q, arm.joint_names)


def test_every_corner_is_missed_by_the_deviation_at_most() -> None:
    arm, path = arm_and_path((-0.9, 0), (0, 0), (0.5, 0.6), (0.9, -0.9))
    checker = pp.CollisionChecker(arm)
    for deviation in (0.02, 0.1):
        smooth = pp.blend(path, checker, deviation=deviation)
        assert smooth.corners == ()
        points = smooth(np.linspace(*smooth.domain, 20_001))
        for waypoint in path.q[1:-1]:
            assert np.linalg.norm(points - waypoint, axis=1).min() <= deviation + 1e-6  # the samples are 1e-4 apart
        assert np.array_equal(smooth.start, path.start)
        assert np.array_equal(smooth.end, path.end)
        assert smooth.length < path.length


def test_twice_differentiable_all_along() -> None:
    arm, path = arm_and_path((-0.9, 0), (0, 0), (0.5, 0.6), (0.9, -0.9))
    knots, control = pp.blend(path, pp.CollisionChecker(arm)).bezier()
    for _ in range(2):
        knots, control = Bezier(knots, control).derivative()
        assert np.abs(control[1:, 0] - control[:-1, -1]).max() < 1e-6 * max(1.0, np.abs(control).max())


def test_a_body_in_the_corner_shrinks_the_rounding() -> None:
    # The ball (5 cm) turns round a post that stands a little inside its corner.
    arm, path = arm_and_path((-0.9, 0), (0, 0), (0, 0.9))
    post = pp.Obstacle("post", pp.Sphere(0.02), pp.pose((-0.09, 0.09, 0)))
    checker = pp.CollisionChecker(arm, pp.Scene([post]))
    assert pp.certify(path, checker).free
    wide, narrow = (pp.blend(path, c, deviation=0.15) for c in (pp.CollisionChecker(arm), checker))
    assert not pp.certify(wide, checker).free
    assert pp.certify(narrow, checker).free
    assert narrow.corners == ()
    assert narrow.length > wide.length
    assert_free(narrow, checker)


def test_a_corner_without_clearance_stays_a_stop_and_is_reported() -> None:
    # A shallow turn with a post inside it, a hair's breadth from both legs.
    half, gap = np.radians(5), 1e-4
    arm, path = arm_and_path((-0.95, 0), (0, 0), (0.9 * np.cos(2 * half), 0.9 * np.sin(2 * half)))
    out = (0.07 + gap) / np.cos(half) * np.array([-np.sin(half), np.cos(half)])
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("post", pp.Sphere(0.02), pp.pose((*out, 0)))]))
    assert pp.certify(path, checker).free
    smooth = pp.blend(path, checker, deviation=0.2)
    assert len(smooth.corners) == 1
    assert np.array_equal(smooth(smooth.corners[0]), path.q[1])
    assert pp.certify(smooth, checker).free
    assert pp.blend(path, pp.CollisionChecker(arm), deviation=0.2).corners == ()


def test_a_path_stops_where_it_reverses() -> None:
    arm, path = arm_and_path((-0.5, 0), (0.5, 0), (-0.5, 1e-3))
    smooth = pp.blend(path, pp.CollisionChecker(arm))
    assert len(smooth.corners) == 1
    assert smooth.length == pytest.approx(path.length)


def test_collinear_and_repeated_waypoints_are_not_corners() -> None:
    arm, path = arm_and_path((-0.5, 0), (-0.5, 0), (0.0, 0), (0.5, 0), (0.5, 0))
    smooth = pp.blend(path, pp.CollisionChecker(arm))
    assert smooth.corners == ()
    assert smooth.length == pytest.approx(1.0)
    still = pp.JointPath([(0.1, 0.2)] * 3, arm.joint_names)
    assert pp.blend(still, pp.CollisionChecker(arm)).domain == (0.0, 0.0)


def test_short_legs_share_what_there_is() -> None:
    arm, path = arm_and_path((-0.9, 0), (0, 0), (0, 0.02), (0.9, 0.02))
    smooth = pp.blend(path, pp.CollisionChecker(arm), deviation=0.5)
    assert smooth.corners == ()
    assert np.abs(smooth(np.linspace(*smooth.domain, 2001))[:, 1]).max() <= 0.02 + 1e-12


def test_the_quick_proof_agrees_with_certify(ur5: pp.Arm) -> None:
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.4), pp.pose((0.5, 0.0, 0.6)))
    checker = pp.CollisionChecker(ur5, pp.Scene([post]), margin=0.002)
    rng, agreed = np.random.default_rng(0), []
    for _ in range(60):
        a = ur5.limits.clip(ur5.home + rng.uniform(-1, 1, 6))
        path = pp.JointPath([a, a + rng.uniform(-0.4, 0.4, 6)], ur5.joint_names)
        quick, complete = is_proven_free(path, checker), pp.certify(path, checker).free
        assert quick == complete
        agreed.append(quick)
    assert {True, False} == set(agreed)


def test_arguments_that_make_no_sense() -> None:
    arm, path = arm_and_path((-0.9, 0), (0, 0), (0, 0.9))
    checker = pp.CollisionChecker(arm)
    with pytest.raises(pp.InputError, match="joints"):
        pp.blend(pp.JointPath([(0.0, 0.0)], ("a", "b")), checker)
    with pytest.raises(pp.InputError, match="deviation"):
        pp.blend(path, checker, deviation=0.0)


@pytest.mark.parametrize("seed", range(25))
def test_random_corners_are_missed_by_no_more_and_share_their_segments(seed: int) -> None:
    """Segments of very different lengths, without obstacles: no corner is a stop, and none deviates too far."""
    rng, arm = np.random.default_rng(seed), ball_arm(("x", "y"), (-9.0, 9.0))
    angles, lengths = np.cumsum(rng.uniform(-2.5, 2.5, 6)), 10.0 ** rng.uniform(-2, 0, 6)
    steps = lengths[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    path = pp.JointPath(np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)]), arm.joint_names)
    deviation = 10.0 ** rng.uniform(-3, 0)
    smooth = pp.blend(path, pp.CollisionChecker(arm), deviation=deviation)
    assert smooth.corners == ()
    points = smooth(np.linspace(*smooth.domain, 8001))
    for k, waypoint in enumerate(path.q[1:-1]):
        distance = np.linalg.norm(points - waypoint, axis=1).min()
        assert distance <= deviation + 1e-3
        assert distance <= min(lengths[k], lengths[k + 1]) + 1e-3
    assert smooth.length <= path.length * (1 + 1e-9)
