"""Which limits of a curve are compared; moves between states within limits, and the least times that they allow."""

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
    check_limits,
    least_times,
    rate_excess,
    rest,
    time_parametrise,
)

NAMES = tuple(f"j{k}" for k in range(5))
WAVE = np.sin(np.arange(20.0).reshape(4, 5))


def motion(*, quintic=False):
    rates = {"accelerations": np.cos(WAVE)} if quintic else {}
    return pp.Trajectory([0.0, 0.5, 0.8, 1.5], WAVE, np.tan(WAVE), NAMES, **rates)


@pytest.mark.parametrize("seed", range(25))
def test_every_limit_that_is_known_is_compared_and_no_other(seed):
    """All limits are far exceeded, except those that are infinite, unknown, or a default value."""
    rng = np.random.default_rng(seed)
    chance = rng.choice([0.0, 0.3, 1.0], 3)[:, None]
    finite, velocity, acceleration = rng.random((3, 5)) < chance
    lower = np.where(finite & (rng.random(5) < 0.7), -1e-3, -np.inf)
    upper = np.where(finite & (rng.random(5) < 0.7), 1e-3, np.inf)
    guessed = rng.random(5) < rng.choice([0.0, 0.5])
    limits = pp.JointLimits(
        lower, upper, np.where(velocity, 1e-3, np.nan), np.where(acceleration | guessed, 2e-3, np.nan), guessed=guessed
    )
    for curve in (motion(), motion(quintic=True), CubicPath.through(WAVE, NAMES), pp.JointPath(WAVE, NAMES)):
        timed = isinstance(curve, pp.Trajectory)
        rates = {
            "velocity": velocity & timed,
            "acceleration": np.isfinite(limits.acceleration) & ~limits.guessed & timed,
        }
        found = check_limits(curve, limits)
        assert found.checked == ("position", *(name for name, known in rates.items() if known.any()))
        expected = [("position", name, -1e-3) for name, low in zip(NAMES, lower, strict=True) if np.isfinite(low)]
        expected += [("position", name, 1e-3) for name, high in zip(NAMES, upper, strict=True) if np.isfinite(high)]
        for kind, known in rates.items():
            bound = 1e-3 if kind == "velocity" else 2e-3
            expected += [(kind, NAMES[j], bound) for j in np.flatnonzero(known)]
            np.testing.assert_array_equal(getattr(found, kind), np.where(known, bound, np.inf))
        assert sorted((each.quantity, each.joint, each.limit) for each in found.violations) == sorted(expected)


@pytest.mark.parametrize(("excess", "count"), [(5e-7, 0), (2e-6, 5)])
@pytest.mark.parametrize("quintic", [False, True])
def test_the_tolerance_is_absolute_for_positions_and_relative_for_rates(excess, count, quintic):
    curve = motion(quintic=quintic)
    low, high = curve.range()
    wide, inf = np.full(5, 1e6), np.full(5, np.inf)
    rates = [top / (1 + excess) for top in (curve.max_velocity(), curve.max_acceleration())]
    for limits in (
        pp.JointLimits(low + excess, inf, wide, wide),
        pp.JointLimits(-inf, high - excess, wide, wide),
        pp.JointLimits(-inf, inf, rates[0], wide),
        pp.JointLimits(-inf, inf, wide, rates[1]),
    ):
        assert len(check_limits(curve, limits).violations) == count


class Polyline:
    """A motion of one joint with constant speeds, of another package."""

    joint_names = ("a",)

    def __init__(self, speeds):
        self.speeds, self.duration = np.array(speeds), float(len(speeds))

    def bezier(self):
        q = np.concatenate([[0.0], np.cumsum(self.speeds)])
        return np.arange(len(q), dtype=float), np.stack([q[:-1], q[1:]], axis=1)[:, :, None]

    def __call__(self, t):
        return np.interp(np.atleast_1d(t), self.bezier()[0], [0.0, *np.cumsum(self.speeds)])

    def velocity(self, t):
        return np.atleast_1d(self.speeds[int(t)])

    start = property(lambda self: self(0.0))
    end = property(lambda self: self(self.duration))
    domain = property(lambda self: (0.0, self.duration))


@pytest.mark.parametrize(("step", "ok"), [(0.0, True), (0.9e-6, True), (-0.9e-6, True), (1.1e-6, False), (-0.3, False)])
def test_a_jump_of_the_velocity_is_an_infinite_acceleration(step, ok):
    limits = pp.JointLimits([-10.0], [10.0], [5.0], [1.0])
    found = check_limits(Polyline((0.5, 0.5, 0.5 + step, 0.5 + step)), limits)
    assert found.checked == ("position", "velocity", "acceleration")
    assert bool(found.violations) != ok
    for violation in found.violations:
        assert (violation.quantity, violation.joint, violation.time) == ("acceleration", "a", 2.0)
        assert violation.value == np.inf


@pytest.mark.parametrize(("count", "ok"), [(200, True), (4000, False)])
def test_accelerations_that_rounding_explains_are_allowed_while_their_sum_is_negligible(count, ok):
    """Points at 1 rad, a nanosecond apart, speed up with 5000 rad/s^2: after 4 microseconds it is 0.02 rad/s."""
    t = 1e-9 * np.arange(count)
    motion = pp.Trajectory(t, 1.0 + 2500.0 * t[:, None] ** 2, 5000.0 * t[:, None], ("a",))
    found = check_limits(motion, pp.JointLimits([-10.0], [10.0], [5.0], [1.0]))
    assert ("acceleration" in [each.quantity for each in found.violations]) == (not ok)


# -- moves between states: limits, continuity, and the closed form of their shortest durations -------------------------

ABC = ("a", "b", "c")
V, A, J = np.array([2.0, 1.0, 3.0]), np.array([15.0, 4.0, 9.0]), np.array([500.0, 60.0, 90.0])


def bounds_with(jerk=True):
    return Bounds.of(SimpleNamespace(velocity=V, acceleration=A), ABC, J if jerk else None)


def random_state(rng):
    q, v, a = rng.uniform(-1, 1, (3, 3))
    return (2 * q).tolist(), (0.6 * v * V).tolist(), (0.3 * a * A).tolist()


@pytest.mark.parametrize("jerk", [True, False])
def test_rest_to_rest_times_agree_with_ruckig(jerk):
    bounds, rng = bounds_with(jerk), np.random.default_rng(1)
    steering = Steering(bounds)
    for size in (1e-4, 1e-2, 0.3, 4.0):
        distance = rng.uniform(0.1, 1.0, 3) * size
        move = steering.move(rest(np.zeros(3)), rest(distance))
        assert move.duration == pytest.approx(least_times(distance, bounds), rel=1e-4)


@pytest.mark.parametrize("jerk", [True, False])
def test_a_sequence_becomes_a_trajectory_with_the_same_motion(jerk):
    bounds, rng = bounds_with(jerk), np.random.default_rng(2)
    steering = Steering(bounds)
    middle = [random_state(rng) for _ in range(3)]
    states = [rest(np.zeros(3)), *middle, rest(np.ones(3))]
    sequence = MoveSequence([steering.move(first, last) for first, last in pairwise(states)])
    cut = sequence.replaced(0.2, 0.5, [steering.move(sequence.state(0.2), sequence.state(0.5))])
    for each in (sequence, cut):
        trajectory = each.trajectory(ABC, "", states[0], states[-1], smooth=jerk)
        times = np.linspace(0.0, each.duration, 2000)
        found = np.array([each.state(t)[0] for t in times.tolist()])
        assert np.abs(trajectory(times) - found).max() < 1e-6
        assert (trajectory.max_velocity() <= V * (1 + 1e-6)).all()
        assert rate_excess(trajectory, bounds).max() < 1.001


@pytest.mark.parametrize("jerk", [True, False])
def test_the_states_of_a_trajectory_are_its_positions_and_derivatives(jerk):
    bounds = bounds_with(jerk)
    path = CubicPath.through(np.sin(np.arange(15.0).reshape(5, 3)), ABC)
    slower = SimpleNamespace(velocity=0.9 * V, acceleration=0.9 * A)
    trajectory = time_parametrise(path, slower, jerk=J if jerk else None)
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
def test_rest_to_rest_times_are_those_of_the_timing(jerk):
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


def test_a_straight_move_is_straight_and_no_move_ends_beyond_the_limits():
    steering, end = Steering(bounds_with()), np.array([1.0, -0.3, 0.2])
    q = np.array([state[0] for state in steering.straight(np.zeros(3), end).states(0.01)])
    assert np.abs(q - q[:, :1] * end).max() < 1e-9
    # a state beyond the limits is not reached
    assert steering.move(rest(np.ones(3)), ([0.0] * 3, [2.5, 0.0, 0.0], [0.0] * 3)) is None


def test_no_motion_is_faster_than_the_least_times():
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


def test_a_joint_without_a_velocity_limit_needs_no_time_at_full_speed():
    limits = replace(pp.load_robot("ur5").arm(tcp="tool0").limits, velocity=np.array([np.inf] * 5 + [2.0]))
    assert least_times(np.full((2, 6), 3.0), limits, full_speed=True).tolist() == [1.5, 1.5]
    assert least_times(np.array([3.0] * 5 + [0.0]), limits, full_speed=True) == 0.0
