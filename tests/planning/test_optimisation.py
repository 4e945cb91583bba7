"""Optimisation of motions: certified, within all limits, never slower, reproducible."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import pinproof as pp
from pinproof.motion import RATE_TOLERANCE, Bounds, Move, MoveSequence, Steering, least_times, rate_excess, rest
from pinproof.planning import Edges, optimise
from pinproof.planning.optimisation import _goals, _MotionSearch


def limits_of(arm, acceleration=15.0):
    known = arm.limits
    rates = np.full(arm.dof, acceleration)
    return SimpleNamespace(velocity=known.velocity, acceleration=rates, lower=known.lower, upper=known.upper)


def excess_on_grid(trajectory, limits, jerk):
    """The largest ratio of a rate and its limit on a grid, minus 1."""
    t = np.linspace(0.0, trajectory.duration, 10_000)
    ratios = [np.abs(trajectory.velocity(t)) / limits.velocity]
    ratios.append(np.abs(trajectory.acceleration(t)) / limits.acceleration)
    if jerk is not None:
        ratios.append(np.abs(trajectory.jerk(t)) / jerk)
    return max(float(ratio.max()) for ratio in ratios) - 1.0


WAY = [[-0.8, -0.6], [-0.3, 0.6], [0.3, 0.6], [0.8, -0.6]]


@pytest.fixture(scope="module")
def around_the_wall(gantry, slotted):
    """A path through the slot, with corners before and behind it."""
    return pp.CollisionChecker(gantry, slotted), pp.JointPath(WAY, gantry.joint_names)


@pytest.mark.parametrize("jerk", [None, 500.0])
def test_a_motion_around_a_wall_is_shorter_certified_and_within_the_limits(around_the_wall, jerk, tmp_path):
    """Also when a controller interpolates the saved motion."""
    checker, path = around_the_wall
    limits = limits_of(checker.arm)
    result = optimise(path, checker, limits=limits, jerk=jerk, budget=400)
    assert result.certificate.free
    assert result.certificate.matches(result.trajectory, checker.arm, checker.scene)
    assert pp.certify(result.trajectory, checker).free
    assert result.lower_bound <= result.duration < 0.85 * result.duration_before
    assert result.duration_before == pytest.approx(pp.time_parametrise(path, limits, jerk=jerk).duration)
    assert np.array_equal([result.trajectory.start, result.trajectory.end], [path.start, path.end])
    assert not result.trajectory.velocities[[0, -1]].any()
    assert result.trajectory.interpolant == ("cubic" if jerk is None else "quintic")
    result.trajectory.save(tmp_path / "motion.json", certificate=result.certificate)
    rebuilt = pp.Trajectory.load(tmp_path / "motion.json")
    assert rebuilt.digest() == result.trajectory.digest()
    assert excess_on_grid(rebuilt, limits, jerk) <= RATE_TOLERANCE


def test_without_obstacles_the_motion_takes_as_long_as_its_lower_bound(panda):
    checker = pp.CollisionChecker(panda)
    goal = panda.home + 0.5
    path = pp.JointPath([panda.home, panda.home - 0.2, goal], panda.joint_names)
    result = optimise(path, checker, limits=limits_of(panda), jerk=500.0)
    assert result.duration == pytest.approx(result.lower_bound, rel=1e-3)
    assert result.certificate.free


def at_the_slot_of_the_wall(checker, acceleration, seed):
    """A motion whose limits of position are at the middle of the slot: a shortcut that overshoots leaves them."""
    rates = {"velocity": np.ones(2), "acceleration": np.full(2, acceleration)}
    limits = SimpleNamespace(**rates, lower=np.array([-0.8, -0.6]), upper=np.array([0.8, 0.6]))
    path = pp.JointPath(WAY, checker.group.joint_names)
    result = optimise(path, checker, limits=limits, jerk=500.0, budget=200, rng=seed)
    q = result.trajectory(np.linspace(0.0, result.duration, 5000))
    assert ((q >= limits.lower - 1e-9) & (q <= limits.upper + 1e-9)).all()
    assert excess_on_grid(result.trajectory, limits, 500.0) <= RATE_TOLERANCE
    assert result.certificate.free
    return result


@pytest.mark.parametrize(
    ("acceleration", "seed", "share"), [(2.0, 1, 0.76), (6.0, 0, 0.78), (6.0, 2, 0.78), (1.0, 0, 0.63)]
)
def test_narrower_limits_of_position_are_kept_by_a_motion_that_is_still_shorter(
    gantry, slotted, acceleration, seed, share
):
    result = at_the_slot_of_the_wall(pp.CollisionChecker(gantry, slotted), acceleration, seed)
    assert result.duration < share * result.duration_before


def test_limits_of_position_are_kept_even_if_the_search_does_not_check_them(gantry, slotted, monkeypatch):
    monkeypatch.setattr(Steering, "inside", lambda *_: True)
    at_the_slot_of_the_wall(pp.CollisionChecker(gantry, slotted), 2.0, 1)


def test_the_nearest_of_several_goals_is_chosen(around_the_wall):
    checker, path = around_the_wall
    goals = np.array([path.end, [0.0, -0.6], [-0.5, -0.5]])  # the second is inside the wall
    result = optimise(path, checker, goals=goals, budget=100)
    assert result.goal == 2
    assert np.array_equal(result.trajectory.end, goals[2])
    free = optimise(path, checker, goals=goals[[0, 2]], budget=0)
    assert result.lower_bound == free.lower_bound == optimise(path, checker, goals=goals[2], budget=0).lower_bound
    end = optimise(path, checker, goals=goals[0], budget=0).lower_bound
    assert result.lower_bound < end
    assert optimise(path, checker, goals=goals[:2], budget=0).lower_bound == end
    # the bound is the time from rest to rest of the nearest goal
    limits, goals = limits_of(checker.arm), np.array([path.end, (0.7, 0.6), (0.9, -0.2)])
    far, v, a = np.abs(goals - path.start), limits.velocity, limits.acceleration
    times = np.where(far >= v**2 / a, far / v + v / a, 2.0 * np.sqrt(far / a)).max(axis=1)
    bound = optimise(path, checker, goals=goals, limits=limits, budget=0).lower_bound
    assert bound == pytest.approx(times.min(), rel=1e-6)
    assert times.min() < 0.95 * times.max()


def test_the_end_of_the_path_is_a_goal_beside_others(around_the_wall):
    checker, path = around_the_wall
    far = [[0.9, -0.9], [0.95, -0.9]]
    result = optimise(path, checker, goals=far, budget=200)
    assert result.goal is None
    assert np.array_equal(result.trajectory.end, path.end)
    assert result.duration < 0.9 * result.duration_before
    assert result.lower_bound == optimise(path, checker, budget=0).lower_bound


def test_goals_outside_the_limits_of_position_are_ignored(gantry):
    checker = pp.CollisionChecker(gantry)
    path = pp.JointPath([[0.0, 0.0], [0.5, 0.5]], gantry.joint_names)
    limits = limits_of(gantry)
    limits.lower, limits.upper = np.array([-0.4, -0.5]), np.array([0.5, 0.5])
    outside = [[-0.45, 0.0], [0.0, 0.51], [0.0, -0.55]]
    ignored = optimise(path, checker, limits=limits, goals=outside, budget=50)
    assert ignored.goal is None
    assert ignored.lower_bound == optimise(path, checker, limits=limits, budget=0).lower_bound
    result = optimise(path, checker, limits=limits, goals=[*outside, [-0.4, 0.2]], budget=50)
    assert result.goal == 3
    assert result.certificate.free


def test_a_budget_of_zero_only_times_the_path_and_the_same_seed_gives_the_same_motion(around_the_wall):
    checker, path = around_the_wall
    result = optimise(path, checker, budget=0)
    assert result.trajectory.digest() == pp.time_parametrise(path, checker.arm.limits).digest()
    assert result.evaluations == 0
    first, second = (optimise(path, checker, budget=100, rng=3).trajectory for _ in range(2))
    assert first.digest() == second.digest()


def test_a_blended_path_is_never_made_slower_and_a_colliding_one_is_not_reported_as_free(around_the_wall):
    checker, path = around_the_wall
    blended = pp.blend(path, checker)
    result = optimise(blended, checker, jerk=500.0, budget=150)
    assert result.duration <= pp.time_parametrise(blended, checker.arm.limits, jerk=500.0).duration
    assert result.certificate.free
    through = pp.JointPath([[0.0, -0.6], [0.8, -0.6]], checker.arm.joint_names)
    assert optimise(through, checker, budget=50).certificate.status is pp.CertificateStatus.COLLIDING


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"budget": -1}, "budget"),
        ({"budget": 1.5}, "budget"),
        ({"goals": [1.0, 2.0, 3.0]}, "goals"),
        ({"goals": [[0.0, np.nan]]}, "goals"),
        ({"jerk": -5.0}, "jerk"),
        ({"jerk": [5.0, 5.0, 5.0]}, "jerk"),
    ],
)
def test_wrong_settings_are_refused(around_the_wall, settings, words):
    checker, path = around_the_wall
    with pytest.raises(pp.InputError, match=words):
        optimise(path, checker, **settings)


class SpeedLimit:
    """The Euclidean speed in joint space is at most 0.7."""

    name = "speed"
    most = 0.7

    def coefficients(self, q, slope, curvature):
        speed = np.linalg.norm(slope, axis=1, keepdims=True)
        zeros = np.zeros_like(speed)
        return zeros, speed**2, zeros, np.full_like(speed, self.most**2)

    def excess(self, trajectory):
        control = trajectory.bezier(1)[1]
        return np.linalg.norm(control, axis=2).max(axis=1) / self.most


@pytest.mark.slow
def test_torque_limits_are_kept_and_still_shorten_the_motion(panda):
    """The planned path brakes with the load at a large distance, where gravity uses most of the torque."""
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 0.5), pp.pose((0.45, 0, 0.2)))
    checker = pp.CollisionChecker(panda, pp.Scene([post]))
    way = [[-1.0, 0.3, 0, -2.2, 0, 2.5, 0], [0.0, -0.3, 0, -1.4, 0, 1.2, 0], [1.0, 0.9, 0, -1.6, 0, 2.4, 0]]
    path = pp.JointPath(way, panda.joint_names)
    load = pp.Payload(3.0)
    torques, limits = pp.motion.TorqueLimits(panda, load), limits_of(panda)
    free = optimise(path, checker, limits=limits, jerk=500.0, budget=200)
    assert max(peak.share for peak in torques.peaks(free.trajectory)) > 1.2
    result = optimise(path, checker, limits=limits, jerk=500.0, rate_limits=[torques])
    assert pp.certify(result.trajectory, checker).free
    assert excess_on_grid(result.trajectory, limits, 500.0) <= RATE_TOLERANCE
    times = np.linspace(0.0, result.duration, 3000)
    motion = result.trajectory
    states = zip(motion(times), motion.velocity(times), motion.acceleration(times), strict=True)
    needed = np.abs([panda.torques(q, v, a, payload=load) for q, v, a in states])  # by Pinocchio
    assert (needed / torques.limits).max() <= 1.0 + RATE_TOLERANCE
    assert result.duration < 0.85 * result.duration_before


def test_a_constraint_of_the_tcp_is_kept_by_a_shorter_motion(ur5):
    first, last = np.array([-1.0, -1.2, 1.6, -1.97, -1.57, 0.0]), np.array([1.0, -1.2, 1.6, -1.97, -1.57, 0.5])
    checker = pp.CollisionChecker(ur5, pp.Scene([pp.Obstacle("post", pp.Box(0.1, 0.1, 1.2), pp.pose((0.6, 0, 0.3)))]))
    upright = pp.Upright.keeping(ur5, first, tolerance=np.radians(2.0))
    plan = pp.RrtConnect().plan(checker, first, last, constraints=[upright], rng=0).or_raise()
    tilted = last + np.array([0, 0, 0, 0.3, 0, 0])
    result = optimise(plan.path, checker, goals=[last, tilted], constraints=[upright], budget=300)
    assert result.goal == 0
    assert result.duration < 0.7 * result.duration_before
    assert pp.certify(result.trajectory, checker, constraints=[upright]).free
    angles = [upright.error(ur5, q) for q in result.trajectory(np.linspace(0.0, result.duration, 3000))]
    assert max(angles) <= result.certificate.constraints[0].largest <= upright.tolerance


def test_a_constraint_is_kept(around_the_wall):
    checker, path = around_the_wall
    limits, constraint = limits_of(checker.arm), SpeedLimit()
    free = optimise(path, checker, limits=limits, jerk=500.0, budget=300)
    kept = optimise(path, checker, limits=limits, jerk=500.0, budget=300, rate_limits=[constraint])
    fastest, limited = (
        np.linalg.norm(each.trajectory.velocity(np.linspace(0, each.duration, 10_000)), axis=1).max()
        for each in (free, kept)
    )
    assert fastest > 0.8
    assert limited <= constraint.most * (1 + RATE_TOLERANCE)
    assert kept.certificate.free
    assert kept.duration <= kept.duration_before


@pytest.mark.parametrize("with_end", [False, True])
def test_goals_are_those_that_are_free_inside_the_limits_and_the_end_of_the_path(around_the_wall, with_end):
    checker, path = around_the_wall
    limits, rng = checker.arm.limits, np.random.default_rng(2)
    rows = rng.uniform(-1.3, 1.3, (60, 2)) * np.where(rng.random((60, 1)) < 0.4, [0.03, 1.0], 1.0)
    if with_end:
        rows[17] = path.end
    bounds = Bounds.of(limits, checker.arm.joint_names)
    found = _goals(rows, path.end, bounds, checker, None, np.empty(0))
    expected = [q for q in rows if limits.contains(q) and checker.is_free(q)]
    np.testing.assert_array_equal(found, expected if with_end else [path.end, *expected])
    assert 10 < len(expected) < 50
    assert any(limits.contains(q) and not checker.is_free(q) for q in rows)


def test_further_paths_lead_from_the_start_to_their_goal_on_free_edges(around_the_wall, monkeypatch):
    checker, path = around_the_wall
    goals, paths, plan = np.array([path.end, (0.7, 0.6), (0.9, -0.2)]), [], _MotionSearch._plan

    def recorded(search, chosen):
        paths.append(plan(search, chosen))
        return paths[-1]

    monkeypatch.setattr(_MotionSearch, "_plan", recorded)
    for seed in range(6):
        optimise(path, checker, goals=goals, limits=limits_of(checker.arm), budget=300, rng=seed)
    paths = [each for each in paths if each is not None]
    assert len(paths) > 5
    for q, goal in paths:
        np.testing.assert_array_equal(q[[0, -1]], [path.start, goals[goal]])
        for a, b in pairwise(q):
            edge = a + np.linspace(0.0, 1.0, 100)[:, None] * (b - a)
            assert min(checker.clearance(each) for each in edge) > -0.01  # only samples are free


# -- Moves whose joints choose when they move: around obstacles, at rest at both ends, within all limits


START, GOAL = np.array([-0.8, -0.4]), np.array([0.5, 0.6])


@pytest.mark.parametrize("jerk", [None, 500.0])
def test_a_staggered_move_avoids_an_obstacle_and_takes_little_longer_than_the_lower_bound(gantry, slotted, jerk):
    checker = pp.CollisionChecker(gantry, slotted)
    bounds = Bounds.of(gantry.limits, gantry.joint_names, jerk)
    steering, edges = Steering(bounds), Edges(checker, 0.05, np.array([START, GOAL]))
    search = steering.staggered(edges.core, START, GOAL[None], 0.05)
    draws = np.random.default_rng(0).random((300, search.draws_per_motion))
    found = search.run(10.0, draws)
    assert not edges.samples_free(START, GOAL)
    lower_bound = least_times(GOAL - START, bounds)
    assert found.goal == 0
    assert lower_bound <= found.duration < 1.35 * lower_bound
    motion = MoveSequence([Move(found)])
    trajectory = motion.trajectory(gantry.joint_names, "", rest(START), rest(GOAL), smooth=jerk is not None)
    assert rate_excess(trajectory, bounds).max() <= 1.0
    assert pp.certify(trajectory, checker).free
    assert np.allclose(trajectory(0.4 * found.duration), found.at_time(0.4 * found.duration)[0], atol=1e-6)
    assert search.run(lower_bound, draws) is None
