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


def test_a_constraint_of_the_tcp_holds_at_every_sample_of_a_motion(arm) -> None:
    """Upright motions, whose ends may use all of the tolerance, and none where every fast motion tilts the tool."""
    first, last = np.array([-1.0, -1.2, 1.6, -1.97, -1.57, 0.0]), np.array([1.0, -1.2, 1.6, -1.97, -1.57, 0.5])
    kept = []
    for tolerance, tilt in [(0.02, 0.0), (0.02, 0.019), (0.3, 0.0), (0.3, 0.29)]:
        upright = pp.Upright.keeping(arm, first, tolerance=tolerance)
        end = last + np.array([0, 0, 0, tilt, 0, 0])
        for middle in (0.0, 0.1, 0.4):  # of the wrist, half way
            ends, _ = between(arm, constraints=[upright])
            via = 0.5 * (first + end) + np.array([0, 0, 0, middle, 0, 0])
            slow = pp.time_parametrise(pp.JointPath([first, via, end], arm.joint_names), arm.limits)
            speed = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.2])
            for motion in (
                ends.direct(rest(first), state(end, speed), 10.0),
                ends.changed(slow, state(first, speed), rest(end), 10.0),
            ):
                if motion is not None:
                    errors = [upright.error(arm, q) for q in motion(np.linspace(0.0, motion.duration, 300))]
                    kept.append(max(errors) <= tolerance + 2e-3)  # samples are 40 ms apart
    assert len(kept) > 8
    assert sum(kept) >= len(kept) - 4  # a part of the given motion that is kept may violate the constraint


def test_there_is_no_changed_motion_if_no_part_at_an_end_can_be_replaced(arm) -> None:
    ends, _ = between(arm)
    slow = pp.time_parametrise(pp.JointPath([START, END], arm.joint_names), arm.limits)
    backwards = state(START, -0.99 * arm.limits.velocity)
    assert ends.changed(slow, backwards, rest(END), 0.5 * slow.duration) is None
    assert ends.changed(slow, backwards, backwards, 0.5 * slow.duration) is None


class Slow:
    """A limit of the speed of a joint that the coefficients do not show, so that only ``excess`` notices it."""

    name = "slow"

    def __init__(self, joint: int, limit: float) -> None:
        self.joint, self.limit = joint, limit

    def coefficients(self, q, slope, curvature):
        zeros = np.zeros((len(q), 1))
        return zeros, zeros, zeros, zeros + 1.0

    def excess(self, trajectory: pp.Trajectory) -> np.ndarray:
        return np.abs(trajectory.bezier(1)[1][..., self.joint]).max(axis=1) / self.limit


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_motion_that_exceeds_any_of_several_limits_between_its_samples_is_refused(arm, place: int) -> None:
    for limit, allowed in ((0.05, False), (50.0, True)):
        limits = [Slow(1, 50.0), Slow(2, 60.0)]
        limits.insert(place, Slow(0, limit))
        ends, _ = between(arm, rate_limits=limits)
        motion = ends.direct(rest(START), state(END, np.full(6, 0.2)), 20.0)
        assert (motion is not None) == allowed
        slow = pp.time_parametrise(pp.JointPath([START, END], arm.joint_names), arm.limits)
        assert (ends.changed(slow, rest(START), state(END, np.full(6, 0.2)), 20.0) is not None) == allowed
