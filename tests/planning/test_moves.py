"""Motions that pass states with velocities at their ends."""

from itertools import pairwise

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion import Bounds, Steering, rest
from pinproof.planning import MovingEnds, moves
from pinproof.planning.moves import SHARE, GentleMoves

START, END = np.array([0.0, -1.2, 1.2, -1.6, -1.6, 0.0]), np.array([1.0, -1.0, 1.4, -1.9, -1.6, 0.4])


@pytest.fixture(scope="module")
def arm(ur5):
    return ur5


def straight(arm, *waypoints):
    """A slow motion along waypoints."""
    return pp.time_parametrise(pp.JointPath([*waypoints], arm.joint_names), arm.limits)


def state(q, velocity):
    return q.tolist(), velocity.tolist(), [0.0] * len(q)


def between(arm, scene=None, **more):
    checker = pp.CollisionChecker(arm, scene or pp.Scene())
    return MovingEnds(checker, Bounds.of(arm.limits, arm.joint_names), np.array([START, END]), **more), checker


@pytest.mark.parametrize("speed", [0.0, 0.4, -0.4])
def test_the_motion_has_exactly_the_states_at_its_ends_and_keeps_all_limits(arm, speed):
    ends, checker = between(arm)
    first, last = speed * np.array([0.0, 1.0, 0.5, 0.0, 0.0, 0.0]), speed * np.array([0.0, 0.5, -1.0, 0.7, 0.0, 0.0])
    slow = straight(arm, START, 0.5 * (START + END), END)
    for motion in (
        ends.direct(state(START, first), state(END, last), 10.0),
        ends.changed(slow, state(START, first), state(END, last), 10.0),
    ):
        np.testing.assert_array_equal(motion.q[[0, -1]], [START, END])
        np.testing.assert_array_equal(motion.velocities[[0, -1]], [first, last])
        assert (motion.max_velocity() <= arm.limits.velocity * (1 + 1e-9)).all()
        assert (motion.max_acceleration() <= arm.limits.acceleration * (1 + 1e-9)).all()
        assert pp.certify(motion, checker).free


def test_there_is_no_motion_within_less_than_the_time_it_needs_or_through_an_obstacle(arm):
    ends, _ = between(arm)
    needed = ends.direct(rest(START), rest(END), 10.0).duration
    assert ends.direct(rest(START), rest(END), needed - 1e-3) is None
    middle = arm.forward_kinematics(0.5 * (START + END)).translation
    ball = pp.Obstacle("ball", pp.Sphere(radius=0.08), pp.pose(middle))
    assert between(arm, pp.Scene([ball]))[0].direct(rest(START), rest(END), 10.0) is None
    single = straight(arm, START)  # a motion of a single point is not changed
    assert ends.changed(single, rest(START), state(START, np.full(6, 0.1)), 10.0) is None
    # nor is one of which no part at an end can be replaced
    slow, backwards = straight(arm, START, END), state(START, -0.99 * arm.limits.velocity)
    for last in (rest(END), backwards):
        assert ends.changed(slow, backwards, last, 0.5 * slow.duration) is None


def test_torque_limits_hold_between_samples(arm):
    limit = pp.motion.TorqueLimits(arm, [pp.Payload(12.0, (0.0, 0.0, 0.05))])
    free = between(arm)[0].direct(rest(START), state(END, np.full(6, 0.2)), 20.0)
    assert limit.excess(free).max() > 1.01
    motion = between(arm, rate_limits=[limit])[0].direct(rest(START), state(END, np.full(6, 0.2)), 20.0)
    assert limit.excess(motion).max() <= 1.0 + 1e-9
    assert motion.duration > free.duration


def test_a_motion_may_end_beyond_a_tolerance_and_is_nowhere_farther_beyond_it(arm):
    upright = pp.Upright.keeping(arm, START, tolerance=0.05)
    ends, _ = between(arm, constraints=[upright])
    tilted = START + np.array([0.3, 0, 0, 0.2, 0, 0])
    for first, last in ((START, tilted), (tilted, START)):
        motion = ends.direct(rest(first), rest(last), 10.0)
        errors = [upright.error(arm, q) for q in motion(np.linspace(0.0, motion.duration, 200))]
        assert max(errors) <= max(errors[0], errors[-1]) + 1e-9
        assert max(errors) > 0.15


def test_a_constraint_of_the_tcp_holds_at_every_sample_of_a_motion(arm):
    """Upright motions, whose ends may use all of the tolerance, and none where every fast motion tilts the tool."""
    first, last = np.array([-1.0, -1.2, 1.6, -1.97, -1.57, 0.0]), np.array([1.0, -1.2, 1.6, -1.97, -1.57, 0.5])
    kept = []
    for tolerance, tilt in [(0.02, 0.0), (0.02, 0.019), (0.3, 0.0), (0.3, 0.29)]:
        upright = pp.Upright.keeping(arm, first, tolerance=tolerance)
        end = last + np.array([0, 0, 0, tilt, 0, 0])
        for middle in (0.0, 0.1, 0.4):  # of the wrist, half way
            ends, _ = between(arm, constraints=[upright])
            via = 0.5 * (first + end) + np.array([0, 0, 0, middle, 0, 0])
            slow = straight(arm, first, via, end)
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


class Slow:
    """A limit of the speed of a joint that the coefficients do not show, so that only ``excess`` notices it."""

    name = "slow"

    def __init__(self, joint, limit):
        self.joint, self.limit = joint, limit

    def coefficients(self, q, slope, curvature):
        zeros = np.zeros((len(q), 1))
        return zeros, zeros, zeros, zeros + 1.0

    def excess(self, trajectory):
        return np.abs(trajectory.bezier(1)[1][..., self.joint]).max(axis=1) / self.limit


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_motion_that_exceeds_any_of_several_limits_between_its_samples_is_refused(arm, place):
    for limit, allowed in ((0.05, False), (50.0, True)):
        limits = [Slow(1, 50.0), Slow(2, 60.0)]
        limits.insert(place, Slow(0, limit))
        ends, _ = between(arm, rate_limits=limits)
        motion = ends.direct(rest(START), state(END, np.full(6, 0.2)), 20.0)
        assert (motion is not None) == allowed
        slow = straight(arm, START, END)
        assert (ends.changed(slow, rest(START), state(END, np.full(6, 0.2)), 20.0) is not None) == allowed


@pytest.mark.parametrize(("speed", "tool"), [(0.3, None), (-0.5, None), (0.06, 0.8)])
def test_a_changed_end_is_the_fastest_of_those_of_all_parts_that_may_be_replaced(arm, monkeypatch, speed, tool):
    """For each part alone and for all together, at the start and at the end, and if the time is short."""
    limits = {"rate_limits": [pp.motion.ToolLimits(arm, linear_speed=tool)] if tool else []}
    path = pp.JointPath([START, 0.5 * (START + END) + 0.3, END], arm.joint_names)
    slow, moving = pp.time_parametrise(path, arm.limits, **limits), speed * (END - START)
    for first in (True, False):
        for extra in (1.0, -0.05):
            states = (state(START, moving), rest(END)) if first else (rest(START), state(END, moving))
            ends, longest = between(arm, **limits)[0], slow.duration * moves.MOVING_SHARE**-0.5 + extra
            alone = []
            for fraction in moves.FRACTIONS:
                with monkeypatch.context() as only:
                    only.setattr(moves, "FRACTIONS", (fraction,))
                    if (motion := ends.changed(slow, *states, longest)) is not None:
                        alone.append(motion.duration)
                        assert motion.duration < longest
            found = ends.changed(slow, *states, longest)
            assert (found is None) == (not alone)
            if found is not None:
                assert found.duration == pytest.approx(min(alone), abs=1e-6)
                np.testing.assert_array_equal(found.velocities[0 if first else -1], moving)


class Load:
    """A constraint on the sum of weighted accelerations, and another one on the squares of velocities."""

    name = "load"

    def __init__(self, weights, most, speed):
        self.weights, self.most, self.speed = weights, most, speed

    def coefficients(self, q, slope, curvature):
        shift = 0.2 * self.most * np.sin(q[:, :1])
        return (
            np.hstack([slope @ self.weights[:, None], np.zeros((len(q), 1))]),
            np.hstack([curvature @ self.weights[:, None], (slope**2).sum(axis=1, keepdims=True)]),
            np.hstack([shift, np.zeros((len(q), 1))]),
            np.tile([self.most, self.speed], (len(q), 1)),
        )

    def excess(self, trajectory):
        raise NotImplementedError


def shares(load, q, velocity, acceleration):
    """The rows divided by their bounds."""
    first = acceleration @ load.weights + 0.2 * load.most * np.sin(q[:, 0])
    return np.stack([np.abs(first) / load.most, (velocity**2).sum(axis=1) / load.speed], axis=1)


def load_of(rng, arm, tight):
    weights = rng.uniform(0.2, 1.0, arm.dof)
    return Load(weights, tight * (weights @ arm.limits.acceleration), tight * (arm.limits.velocity**2).sum())


def test_gentle_moves_keep_constraints_and_take_little_longer(arm):
    rng, bounds = np.random.default_rng(3), Bounds.of(arm.limits, arm.joint_names)
    steering, reduced = Steering(bounds, SHARE), 0
    for _ in range(12):
        load = load_of(rng, arm, rng.uniform(0.3, 0.6))
        gentle = GentleMoves(steering, bounds, [load])
        places = [rest(q) for q in np.cumsum(rng.uniform(-0.7, 0.7, (3, 6)), axis=0)]
        moves = [steering.move(a, b) for a, b in pairwise(places)]
        each = [gentle.connect([a, b], [move], 100.0) for (a, b), move in zip(pairwise(places), moves, strict=True)]
        assert all(each)
        needed = sum(found[0].duration for found in each)
        fast = sum(move.duration for move in moves)
        both = gentle.connect(places, list(moves), needed * 1.001)
        assert [move.duration for move in both] == pytest.approx([found[0].duration for found in each])
        assert gentle.connect(places, list(moves), needed * 0.999) is None or needed == pytest.approx(fast)
        for (start, _), move, found in zip(pairwise(places), moves, each, strict=True):
            states = np.array([start, *found[0].states(1e-3)])
            assert shares(load, *states.swapaxes(0, 1)).max() <= 1.0
            # All of the motion slower is one way to satisfy the constraints; the other takes no longer.
            rates = np.array([start, *move.states(1e-3)]).swapaxes(0, 1)
            square = (np.abs(rates[2] @ load.weights) / (load.most * (1.0 - 0.2))).max()
            uniform = np.sqrt(max(square, shares(load, *rates)[:, 1].max(), 1.0))
            assert found[0].duration <= 1.25 * uniform * move.duration
            reduced += found[0] is not move
    assert reduced > 10


def test_the_slowdown_of_a_motion_is_just_sufficient(arm):
    rng, bounds = np.random.default_rng(4), Bounds.of(arm.limits, arm.joint_names)
    factors = []
    for _ in range(12):
        load = load_of(rng, arm, rng.uniform(0.05, 0.8))
        gentle = GentleMoves(Steering(bounds, SHARE), bounds, [load])
        motion = pp.time_parametrise(pp.JointPath(rng.uniform(-1, 1, (3, 6)), arm.joint_names), arm.limits)
        factor = gentle.slowdown(motion)
        factors.append(factor)
        times = np.linspace(0.0, motion.duration, 4000)
        q, velocity, acceleration = motion(times), motion.velocity(times), motion.acceleration(times)
        most = shares(load, q, velocity / factor, acceleration / factor**2).max()
        assert most <= 1.0 + 1e-9
        assert most >= 0.97 or factor == 1.0
    assert min(factors) == 1.0 < max(factors)
