"""Motions that pass states with velocities at their ends."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion.limits import Bounds
from pinproof.motion.steering import State, rest
from pinproof.planning.moving_ends import MovingEnds

START, END = np.array([0.0, -1.2, 1.2, -1.6, -1.6, 0.0]), np.array([1.0, -1.0, 1.4, -1.9, -1.6, 0.4])


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return pp.load_robot("ur5").arm(tcp="tool0")


def state(q: np.ndarray, velocity: np.ndarray) -> State:
    return q.tolist(), velocity.tolist(), [0.0] * len(q)


def between(arm: pp.Arm, scene: pp.Scene | None = None, **more) -> tuple[MovingEnds, pp.CollisionChecker]:
    checker = pp.CollisionChecker(arm, scene or pp.Scene())
    return MovingEnds(checker, Bounds.of(arm.limits, arm.joint_names), np.array([START, END]), **more), checker


@pytest.mark.parametrize("speed", [0.0, 0.4, -0.4])
def test_the_motion_has_exactly_the_states_at_its_ends_and_keeps_all_limits(arm, speed: float) -> None:
    ends, checker = between(arm)
    first, last = speed * np.array([0.0, 1.0, 0.5, 0.0, 0.0, 0.0]), speed * np.array([0.0, 0.5, -1.0, 0.7, 0.0, 0.0])
    slow = pp.time_parametrise(pp.JointPath([START, 0.5 * (START + END), END], arm.joint_names), arm.limits)
    for motion in (
        ends.direct(state(START, first), state(END, last), 10.0),
        ends.changed(slow, state(START, first), state(END, last), 10.0),
    ):
        np.testing.assert_array_equal(motion.q[[0, -1]], [START, END])
        np.testing.assert_array_equal(motion.velocities[[0, -1]], [first, last])
        assert (motion.max_velocity() <= arm.limits.velocity * (1 + 1e-9)).all()
        assert (motion.max_acceleration() <= arm.limits.acceleration * (1 + 1e-9)).all()
        assert pp.certify(motion, checker).free


def test_there_is_no_motion_within_less_than_the_time_it_needs_or_through_an_obstacle(arm) -> None:
    ends, _ = between(arm)
    needed = ends.direct(rest(START), rest(END), 10.0).duration
    assert ends.direct(rest(START), rest(END), needed - 1e-3) is None
    middle = arm.forward_kinematics(0.5 * (START + END)).translation
    ball = pp.Obstacle("ball", pp.Sphere(radius=0.08), pp.pose(middle))
    assert between(arm, pp.Scene([ball]))[0].direct(rest(START), rest(END), 10.0) is None


def test_a_motion_of_a_single_point_is_not_changed(arm) -> None:
    ends, _ = between(arm)
    single = pp.time_parametrise(pp.JointPath([START], arm.joint_names), arm.limits)
    assert ends.changed(single, rest(START), state(START, np.full(6, 0.1)), 10.0) is None


def test_torque_limits_hold_between_samples(arm) -> None:
    limit = pp.motion.TorqueLimits(arm, [pp.Payload(12.0, (0.0, 0.0, 0.05))])
    free = between(arm)[0].direct(rest(START), state(END, np.full(6, 0.2)), 20.0)
    assert limit.excess(free).max() > 1.01
    motion = between(arm, rate_limits=[limit])[0].direct(rest(START), state(END, np.full(6, 0.2)), 20.0)
    assert limit.excess(motion).max() <= 1.0 + 1e-9
    assert motion.duration > free.duration
