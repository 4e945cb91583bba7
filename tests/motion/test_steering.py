"""Moves between states: limits, continuity, and the closed form of their shortest durations."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion import (
    Bounds,
    CubicPath,
    JointPath,
    MoveSequence,
    Steering,
    least_times,
    rate_excess,
    rest,
    time_parametrise,
)

NAMES = ("a", "b", "c")
V, A, J = np.array([2.0, 1.0, 3.0]), np.array([15.0, 4.0, 9.0]), np.array([500.0, 60.0, 90.0])


def bounds_with(jerk: bool = True) -> Bounds:
    return Bounds.of(SimpleNamespace(velocity=V, acceleration=A), NAMES, J if jerk else None)


def random_state(rng: np.random.Generator) -> tuple[list[float], list[float], list[float]]:
    q, v, a = rng.uniform(-1, 1, (3, 3))
    return (2 * q).tolist(), (0.6 * v * V).tolist(), (0.3 * a * A).tolist()


@pytest.mark.parametrize("jerk", [True, False])
def test_rest_to_rest_times_agree_with_ruckig(jerk: bool) -> None:
    bounds, rng = bounds_with(jerk), np.random.default_rng(1)
    steering = Steering(bounds)
    for size in (1e-4, 1e-2, 0.3, 4.0):
        distance = rng.uniform(0.1, 1.0, 3) * size
        move = steering.move(rest(np.zeros(3)), rest(distance))
        assert move is not None
        assert move.duration == pytest.approx(least_times(distance, bounds), rel=1e-4)


@pytest.mark.parametrize("jerk", [True, False])
def test_a_sequence_becomes_a_trajectory_with_the_same_motion(jerk: bool) -> None:
    bounds, rng = bounds_with(jerk), np.random.default_rng(2)
    steering = Steering(bounds)
    middle = [random_state(rng) for _ in range(3)]
    states = [rest(np.zeros(3)), *middle, rest(np.ones(3))]
    moves = [steering.move(first, last) for first, last in pairwise(states)]
    sequence = MoveSequence([move for move in moves if move is not None])
    assert len(sequence.moves) == 4
    between = steering.move(sequence.state(0.2), sequence.state(0.5))
    assert between is not None
    cut = sequence.replaced(0.2, 0.5, [between])
    for each in (sequence, cut):
        trajectory = each.trajectory(NAMES, "", states[0], states[-1], smooth=jerk)
        times = np.linspace(0.0, each.duration, 2000)
        found = np.array([each.state(t)[0] for t in times.tolist()])
        assert np.abs(trajectory(times) - found).max() < 1e-6
        assert (trajectory.max_velocity() <= V * (1 + 1e-6)).all()
        assert rate_excess(trajectory, bounds).max() < 1.001


@pytest.mark.parametrize("jerk", [True, False])
def test_the_states_of_a_trajectory_are_its_positions_and_derivatives(jerk: bool) -> None:
    bounds = bounds_with(jerk)
    path = CubicPath.through(np.sin(np.arange(15.0).reshape(5, 3)), NAMES)
    trajectory = time_parametrise(
        path, SimpleNamespace(velocity=0.9 * V, acceleration=0.9 * A), jerk=J if jerk else None
    )
    sequence = MoveSequence.of(trajectory, bounds)
    for time in np.random.default_rng(0).uniform(0.0, trajectory.duration, 200).tolist():
        derivatives = (trajectory, trajectory.velocity, trajectory.acceleration)
        for value, derivative in zip(sequence.state(time), derivatives, strict=True):
            np.testing.assert_allclose(value, derivative(time), atol=1e-9)
    (move,) = sequence.moves
    states = np.array([state[0] for state in move.states(0.05)])
    times = np.linspace(0.0, trajectory.duration, len(states) + 1)[1:]
    assert times[0] <= 0.05
    np.testing.assert_allclose(states, trajectory(times), atol=1e-9)


@pytest.mark.parametrize("jerk", [True, False])
def test_rest_to_rest_times_are_those_of_the_timing(jerk: bool) -> None:
    """Over orders of magnitude, so that each phase is left out in some of the moves."""
    rng = np.random.default_rng(6)
    for distance, velocity, ramp, rise in 10.0 ** rng.uniform([-3, -1, -1.3, -1.7], [2, 1, 0.7, 0.3], (60, 4)):
        acceleration, rate = velocity / ramp, velocity / ramp / rise
        limits = SimpleNamespace(velocity=[velocity], acceleration=[acceleration])
        timed = time_parametrise(JointPath([[0.0], [distance]], ("a",)), limits, jerk=[rate] if jerk else None)
        bounds = Bounds.of(limits, ("a",), [rate] if jerk else None)
        least = least_times(np.array([distance]), bounds, by_joint=True)[0]
        assert least <= timed.duration + 3e-9  # times are rounded to nanoseconds
        assert timed.duration <= 1.005 * least + 3e-9  # phases of a millisecond are left out


def test_a_straight_move_is_straight() -> None:
    steering = Steering(bounds_with())
    end = np.array([1.0, -0.3, 0.2])
    move = steering.straight(np.zeros(3), end)
    assert move is not None
    q = np.array([state[0] for state in move.states(0.01)])
    assert np.abs(q - q[:, :1] * end).max() < 1e-9


def test_a_state_beyond_the_limits_is_not_reached() -> None:
    steering = Steering(bounds_with())
    assert steering.move(rest(np.ones(3)), ([0.0] * 3, [2.5, 0.0, 0.0], [0.0] * 3)) is None


def test_no_motion_is_faster_than_the_least_times() -> None:
    """At full speed, and from rest to rest, against time-optimal motions over random distances."""
    arm, generator = pp.load_robot("ur5").arm(tcp="tool0"), np.random.default_rng(3)
    bounds = Bounds.of(arm.limits, arm.joint_names)
    distances = generator.uniform(-2.0, 2.0, (20, arm.dof))
    full_speed, from_rest = least_times(distances, arm.limits, full_speed=True), least_times(distances, bounds)
    assert (full_speed < from_rest).all()
    for distance, most, least in zip(distances, full_speed, from_rest, strict=True):
        assert most == max(abs(d) / v for d, v in zip(distance, arm.limits.velocity, strict=True))
        straight = pp.JointPath([-distance / 2, distance / 2], arm.joint_names)
        assert pp.time_parametrise(straight, arm.limits).duration >= least * (1 - 1e-9)
    assert least_times(np.zeros((0, arm.dof)), arm.limits, full_speed=True).shape == (0,)


def test_a_joint_without_a_velocity_limit_needs_no_time_at_full_speed() -> None:
    limits = replace(pp.load_robot("ur5").arm(tcp="tool0").limits, velocity=np.array([np.inf] * 5 + [2.0]))
    assert least_times(np.full((2, 6), 3.0), limits, full_speed=True).tolist() == [1.5, 1.5]
    assert least_times(np.array([3.0] * 5 + [0.0]), limits, full_speed=True) == 0.0
