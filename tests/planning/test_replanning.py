"""Replanning of running motions: continuous, within all limits, free by independent checks, and honest stops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import pinproof as pp
from pinproof.errors import InputError, PlanFailed
from pinproof.motion import ToolLimits, TorqueLimits
from pinproof.planning import ReplanStatus, replan
from pinproof.planning.moves import FreeMoves
from pinproof.planning.replanning import RAMP, SHARE

from .arms import ball_arm

NEW = (ReplanStatus.CHANGED, ReplanStatus.CHANGED_WITH_STOP)


def motion(arm, *waypoints, jerk=None, limits=None):
    path = pp.JointPath(np.array(waypoints, dtype=float), arm.joint_names)
    return pp.time_parametrise(path, limits or arm.limits, jerk=jerk)


def ball(arm, q, radius, offset=(0.0, 0.0, 0.0), name="ball"):
    """A ball at the tool at q."""
    place = arm.forward_kinematics(np.asarray(q)).translation + offset
    return pp.Obstacle(name, pp.Sphere(radius), pp.pose(place))


def assert_continues(running, result, arm, jerk=None):
    """By differences of positions, across the takeover too: velocity, acceleration and jerk are within their limits.

    Divided differences of order k are means of the k-th derivative, also where that jumps; a jump of a derivative of
    lower order makes them exceed every bound. The acceleration of a cubic may jump at its own points.
    """
    new, limits = result.trajectory, arm.limits
    jerk = limits.acceleration / RAMP if jerk is None else np.broadcast_to(jerk, limits.velocity.shape)
    h = 2e-4
    known = running.times[running.times <= result.takeover + 1e-9][-1 if running.interpolant == "cubic" else 0]
    before = np.arange(1, min(int((result.takeover - known) / h), 40))[::-1]
    after = np.arange(0.0, new.duration, h)
    q = np.concatenate([running(result.takeover - h * before), new(after)])
    for order, limit in enumerate((limits.velocity, limits.acceleration, jerk), start=1):
        rates = np.diff(q, order, axis=0) / h**order
        rounding = 2e-15 * 2**order / h**order
        assert (np.abs(rates) <= limit * (1.0 + 1e-6) + rounding).all(), order
    assert (new(after) >= limits.lower - 1e-9).all()
    assert (new(after) <= limits.upper + 1e-9).all()
    np.testing.assert_array_equal(new.start, running(result.takeover))
    assert not new.velocities[-1].any()
    assert not new.accelerations[-1].any()


def assert_free(result, checker):
    """The certificate is for this motion, and coal finds no contact at dense samples."""
    assert result.certificate.free
    assert result.certificate.matches(result.trajectory, checker.group, checker.scene)
    assert pp.audit(result.trajectory, checker, step=0.02).clean


# -- new motions -------------------------------------------------------------------------------------------------------


def sliding(gantry, jerk):
    """A ball slides to the right; a plate appears in the middle."""
    plate = pp.Obstacle("plate", pp.Box(0.1, 0.6, 0.6), pp.pose((0.3, -0.5, 0.0)))
    return motion(gantry, (-0.8, -0.5), (0.8, -0.4), jerk=jerk), 0.43, pp.Scene([plate])


def reaching(ur5, jerk):
    """A UR5 swings over a table; a ball appears at its tool."""
    start = np.array([1.3, -1.3, 1.2, -1.4, -1.57, 0.0])
    running = motion(ur5, start, start + np.array([-2.8, 0.1, -0.1, 0.0, 0.3, 0.5]), jerk=jerk)
    table = pp.Obstacle("table", pp.Box(1.6, 1.8, 0.04), pp.pose((0.3, 0.0, -0.05)))
    return running, 0.3, pp.Scene([table, ball(ur5, running(0.9), 0.07)], allowed=[("base_link", "table")])


def swinging(polar, jerk):
    """A slide on a continuous joint, which turns past pi; a post appears on its way."""
    post = pp.Obstacle("post", pp.Cylinder(0.1, 0.5), pp.pose((0.5 * np.cos(3.9), 0.5 * np.sin(3.9), 0.0)))
    return motion(polar, (2.0, 0.5), (5.5, 0.4), jerk=jerk), 0.7, pp.Scene([post])


@pytest.fixture(scope="module")
def polar():
    """A ball on a slide that turns about z without limits."""
    return ball_arm(("spin", "x"))


@pytest.mark.parametrize("jerk", [None, 60.0])
@pytest.mark.parametrize(("robot", "case"), [("gantry", sliding), ("polar", swinging), ("ur5", reaching)])
def test_a_new_motion_continues_the_running_one_within_its_limits(robot, case, jerk, request):
    arm = request.getfixturevalue(robot)
    running, now, scene = case(arm, jerk)
    checker = pp.CollisionChecker(arm, scene, margin=0.005)
    assert not pp.certify(running.after(now), checker).free
    result = replan(running, checker, running(now), now, jerk=jerk)
    assert result.ok, result.message
    assert result.status in NEW
    assert now <= result.takeover <= now + 0.03
    assert np.array_equal(result.trajectory.end, running.end)
    assert_continues(running, result, arm, jerk)
    assert_free(result, checker)
    # The same seed gives the same motion, and the result can be replanned in turn.
    again = replan(running, checker, running(now), now, jerk=jerk)
    assert again.trajectory.digest() == result.trajectory.digest()
    later = result.replan(checker, result.trajectory(0.3), 0.3)
    assert later.status is ReplanStatus.KEPT
    assert later.settings["jerk"] == jerk


def test_a_motion_of_plan_is_replanned_to_its_goals_within_its_limits_and_constraints(panda):
    level = pp.Upright.keeping(panda, panda.home, tolerance=np.radians(12))
    goals = panda.home + np.array([[1.2, 0, 0, 0, 0, 0, 0], [1.3, 0, 0, 0, 0, 0, 0.2]])
    motion = pp.plan(pp.CollisionChecker(panda), panda.home, goals, jerk=100.0, constraints=[level]).or_raise()
    running, now = motion.trajectory, 0.3 * motion.duration
    checker = pp.CollisionChecker(panda, pp.Scene([ball(panda, running(0.7 * motion.duration), 0.05)]))
    result = motion.replan(checker, running(now), now)
    assert result.proven
    assert np.array_equal(result.goals, goals)
    assert result.certificate.constraints[0].constraint == level
    assert_continues(running, result, panda, 100.0)
    assert_free(result, checker)
    assert motion.replan(checker, running(now), now, delay=0.1).takeover >= now + 0.1


def test_a_motion_that_stays_free_is_kept(ur5):
    running, now, _ = reaching(ur5, None)
    far = pp.CollisionChecker(ur5, pp.Scene([ball(ur5, running.start, 0.05)]))
    result = replan(running, far, running(now) + 0.005, now)
    assert result.status is ReplanStatus.KEPT
    assert result.takeover == now
    t = np.linspace(0.0, running.duration - now, 50)
    np.testing.assert_allclose(result.trajectory(t), running(now + t), atol=1e-12)
    assert_free(result, far)


def test_the_nearest_of_several_goals_that_can_be_reached_is_chosen(gantry):
    running, now, scene = sliding(gantry, None)
    checker = pp.CollisionChecker(gantry, scene)
    goals = np.array([(0.3, -0.5), (0.8, -0.4), (-0.5, 0.6)])  # the first one is in the plate
    result = replan(running, checker, running(now), now, goals=goals)
    assert np.array_equal(result.trajectory.end, goals[2])
    assert_continues(running, result, gantry)
    assert_free(result, checker)


# -- stops -------------------------------------------------------------------------------------------------------------


def cage(gap=1.2):
    """Walls across the square, right of x = 0.3: what is behind them cannot be reached."""
    return pp.Scene([pp.Obstacle("wall", pp.Box(0.05, 2.0 * gap, 1.0), pp.pose((0.5, 0.0, 0.0)))])


def test_without_a_motion_to_a_goal_the_arm_stops_and_continues_when_the_obstacle_is_gone(gantry):
    running, now, _ = sliding(gantry, None)
    checker = pp.CollisionChecker(gantry, cage())
    result = replan(running, checker, running(now), now)
    assert result.status is ReplanStatus.STOP
    assert result.proven
    assert not result.ok
    with pytest.raises(PlanFailed, match="wall"):
        result.or_raise()
    assert_continues(running, result, gantry)
    assert_free(result, checker)
    stop = result.trajectory
    waiting = result.replan(checker, stop.end, stop.duration + 1.0)  # it stays where it is
    assert waiting.status is ReplanStatus.STOP
    assert np.array_equal(waiting.trajectory.start, stop.end)
    open_again = pp.CollisionChecker(gantry, pp.Scene())
    moving = waiting.replan(open_again, stop.end, waiting.trajectory.duration)
    assert moving.status is ReplanStatus.CHANGED
    assert np.array_equal(moving.trajectory.end, running.end)
    half = 0.5 * stop.duration  # also while it still brakes
    braking = result.replan(open_again, stop(half), half)
    assert braking.status is ReplanStatus.CHANGED
    assert_continues(stop, braking, gantry)


@pytest.mark.parametrize("samples", [True, False])
def test_a_stop_that_is_blocked_ahead_evades_to_the_side(gantry, samples, monkeypatch):
    """Also if samples do not show what blocks the first stops, so that their proofs fail."""
    running, now = motion(gantry, (-0.8, -0.2), (0.8, -0.2)), 0.8
    at = running(now)
    plate = pp.Obstacle("plate", pp.Box(0.02, 0.1, 0.6), pp.pose((at[0] + 0.3, at[1], 0.0)))  # it needs 0.26 m to stop
    checker = pp.CollisionChecker(gantry, pp.Scene([plate]))
    if not samples:
        monkeypatch.setattr(FreeMoves, "free", lambda self, points: True)
    result = replan(running, checker, at, now, goals=[(0.3 + at[0], at[1])])  # the goal is in the plate
    assert result.status is ReplanStatus.STOP
    assert abs(result.trajectory.end[1] - at[1]) > 0.05
    assert_continues(running, result, gantry)
    assert_free(result, checker)


def test_a_stop_that_cannot_be_proven_is_reported_with_its_contact_and_time(gantry):
    running, now = motion(gantry, (-0.8, -0.2), (0.8, -0.2)), 0.8
    at = running(now)
    wall = pp.Obstacle("wall", pp.Box(0.02, 2.0, 0.6), pp.pose((at[0] + 0.1, 0.0, 0.0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([wall]))
    result = replan(running, checker, at, now)
    assert result.status is ReplanStatus.UNPROVEN_STOP
    assert not result.proven
    contact = result.certificate.first_contact
    assert set(contact.bodies) == {"l2", "wall"}
    assert "wall" in result.message
    assert f"{result.takeover + contact.time:.3f} s" in result.message
    # The fastest stop is returned nevertheless: it touches the wall at that time by plain geometry.
    stop = result.trajectory
    t = np.linspace(0.0, stop.duration, 20_000)
    first = t[(stop(t)[:, 0] + 0.05 >= at[0] + 0.1 - 0.01).argmax()]
    assert contact.time == pytest.approx(first, abs=2e-3)
    assert_continues(running, result, gantry)


def test_what_is_free_at_samples_counts_only_with_a_proof(gantry, monkeypatch):
    running, now = motion(gantry, (-0.8, -0.2), (0.8, -0.2)), 0.8
    wall = pp.Obstacle("wall", pp.Box(0.02, 2.0, 0.6), pp.pose((running(now)[0] + 0.1, 0.0, 0.0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([wall]))
    monkeypatch.setattr(FreeMoves, "free", lambda self, points: True)
    assert replan(running, checker, running(now), now).status is ReplanStatus.UNPROVEN_STOP
    behind = replan(running, checker, running(now), now, goals=running.start)  # shortcuts through the wall are tried
    assert behind.status is ReplanStatus.UNPROVEN_STOP


# -- the state in which a motion takes over ----------------------------------------------------------------------------


@pytest.mark.parametrize("joint", [0, 3])
def test_a_measurement_away_from_the_motion_is_refused_with_the_name_of_the_joint(ur5, joint):
    running, now, _ = reaching(ur5, None)
    checker = pp.CollisionChecker(ur5)
    q = running(now) + 0.0099
    assert replan(running, checker, q, now).ok
    q[joint] += 0.0003
    result = replan(running, checker, q, now)
    assert result.status is ReplanStatus.OFF_MOTION
    assert ur5.joint_names[joint] in result.message
    with pytest.raises(PlanFailed, match=ur5.joint_names[joint]):
        _ = result.trajectory
    tolerance = np.full(6, 0.01)
    tolerance[joint] = 0.02
    assert replan(running, checker, q, now, tolerance=tolerance).ok


def test_a_new_motion_takes_over_after_the_delay_until_which_the_running_one_must_be_free(gantry):
    running, now, scene = sliding(gantry, None)
    checker = pp.CollisionChecker(gantry, scene)
    result = replan(running, checker, running(now), now, delay=0.2)
    assert result.status in NEW
    assert result.takeover == pytest.approx(now + 0.2, abs=0.011)
    assert_continues(running, result, gantry)
    assert_free(result, checker)
    late = replan(running, checker, running(now), now, delay=0.9)
    assert late.status is ReplanStatus.UNPROVEN_STOP
    assert "no new motion can take over before" in late.message
    contact = pp.certify(running, checker).first_contact.time
    assert f"{contact:.3f} s" in late.message


def test_a_motion_that_cannot_be_left_at_once_is_left_when_it_has_ceased_to_accelerate(gantry):
    running, _, scene = sliding(gantry, None)
    checker = pp.CollisionChecker(gantry, scene)
    limits, jerk = gantry.limits, SHARE * gantry.limits.acceleration / RAMP
    now = 0.498  # 0.004 m/s below the velocity limit, at full acceleration
    over = running.velocity(now) + running.acceleration(now) ** 2 / (2 * jerk)
    assert over[0] > limits.velocity[0]
    result = replan(running, checker, running(now), now)
    assert result.status in NEW
    assert 0.5 <= result.takeover < 0.502
    assert_continues(running, result, gantry)
    assert_free(result, checker)


def test_an_arm_that_has_arrived_begins_at_rest(gantry):
    running, _, scene = sliding(gantry, None)
    checker = pp.CollisionChecker(gantry, scene)
    result = replan(running, checker, running.end, running.duration + 2.0, goals=running.start)
    assert result.status is ReplanStatus.CHANGED
    assert result.takeover == running.duration + 2.0
    assert not result.trajectory.velocities[0].any()
    assert not result.trajectory.accelerations[0].any()
    assert_free(result, checker)


@pytest.mark.parametrize("share", np.linspace(0.02, 0.8, 9))
def test_any_state_of_a_motion_can_be_left_within_the_limits(ur5, share):
    jerk = 60.0
    running, _, scene = reaching(ur5, jerk)
    checker = pp.CollisionChecker(ur5, scene.remove("ball"))
    now = share * running.duration
    goal = running.start + np.array([-0.5, -0.3, 0.4, 0.2, 0.0, 1.0])
    result = replan(running, checker, running(now), now, goals=goal, jerk=jerk)
    assert result.ok, result.message
    assert_continues(running, result, ur5, jerk)
    assert_free(result, checker)


def test_no_state_of_a_ramp_to_the_velocity_limit_leads_beyond_it(panda):
    """Also those from which the limit is reached exactly, up to rounding, when the acceleration has become zero."""
    jerk = 40.0
    checker, limit = pp.CollisionChecker(panda), panda.limits.velocity
    goal = panda.home - 0.2
    for seed in range(12):
        step = np.random.default_rng(seed).uniform(0.5, 1.5, 7) * np.sign(
            0.5 * (panda.limits.lower + panda.limits.upper) - panda.home + 1e-3
        )
        path = pp.JointPath([panda.home, panda.limits.clip(panda.home + step)], panda.joint_names)
        running = pp.optimise(path, checker, jerk=jerk, budget=30).trajectory

        def spare(t, running=running):
            then = np.abs(running.velocity(t) + running.acceleration(t) ** 2 / (2 * SHARE * jerk))
            return float((1.0 - then / limit).min())

        times = np.linspace(0.05, 0.9 * running.duration, 400)
        signs = np.sign([spare(t) for t in times])
        for k in np.flatnonzero(np.diff(signs)):
            now = brentq(spare, times[k], times[k + 1], xtol=1e-12)
            result = replan(running, checker, running(now), now, goals=goal, jerk=jerk, budget=5)
            assert result.ok, result.message
            assert (result.trajectory.max_velocity() <= limit * (1.0 + 1e-9)).all()


def test_misuse_is_refused(ur5, gantry):
    running, now, _ = reaching(ur5, None)
    checker = pp.CollisionChecker(ur5)
    with pytest.raises(InputError, match="time"):
        replan(running, checker, running.start, -0.1)
    with pytest.raises(InputError, match="q_now"):
        replan(running, checker, running.start[:3], now)
    with pytest.raises(InputError, match="delay"):
        replan(running, checker, running(now), now, delay=-1.0)
    with pytest.raises(InputError, match="goals"):
        replan(running, checker, running(now), now, goals=np.zeros((2, 5)))
    with pytest.raises(InputError, match="joints"):
        replan(running, pp.CollisionChecker(gantry), running(now), now)


# -- what else a motion must keep --------------------------------------------------------------------------------------


def test_torques_stay_within_their_limits(panda):
    limits = TorqueLimits(panda)
    goal = panda.home + np.array([1.6, 0.3, 0.2, 0.4, 0.0, 0.3, 0.0])
    path = pp.JointPath([panda.home, goal], panda.joint_names)
    running = pp.time_parametrise(path, panda.limits, rate_limits=[limits])
    now = 0.3 * running.duration
    checker = pp.CollisionChecker(panda, pp.Scene([ball(panda, running(0.7 * running.duration), 0.06)]))
    result = replan(running, checker, running(now), now, rate_limits=[limits])
    assert result.ok, result.message
    assert_continues(running, result, panda)
    assert_free(result, checker)
    assert limits.excess(result.trajectory).max() <= 1.0 + 1e-9


def test_a_carried_part_stays_upright_in_the_new_motion_and_when_that_is_replanned(panda):
    level = pp.Upright.keeping(panda, panda.home, tolerance=np.radians(12))
    start = panda.home
    goal = start + 1.2 * np.eye(7)[0]
    running = motion(panda, start, goal)
    now = 0.3 * running.duration
    checker = pp.CollisionChecker(panda, pp.Scene([ball(panda, running(0.75 * running.duration), 0.05)]))
    result = replan(running, checker, running(now), now, constraints=[level])
    assert result.proven
    assert level.error(panda, result.trajectory.start) <= level.tolerance
    samples = result.trajectory(np.linspace(0.0, result.trajectory.duration, 300))
    assert max(level.error(panda, q) for q in samples) <= level.tolerance
    assert result.certificate.constraints[0].constraint is level
    assert result.replan(checker, result.trajectory.start, 0.0).certificate.constraints


def test_jerk_limits_of_the_robot_are_used_on_request(panda):
    limits = replace(panda.limits, jerk=np.full(7, 200.0))
    running = motion(panda, panda.home, panda.home + 1.6 * np.eye(7)[0], jerk="limits", limits=limits)
    checker = pp.CollisionChecker(panda, pp.Scene([ball(panda, running(0.75), 0.05)]))
    result = replan(running, checker, running(0.3), 0.3, limits=limits, jerk="limits")
    assert result.ok, result.message
    assert_continues(running, result, panda, 200.0)


@pytest.mark.parametrize("seed", range(6))
def test_random_obstacles_on_the_way_of_a_ur5(ur5, seed):
    """Whatever the outcome is: continuous, within limits and free by coal, or a stop in contact by coal."""
    running, _, scene = reaching(ur5, None)
    rng = np.random.default_rng(seed)
    for _ in range(4):
        now = float(rng.uniform(0.0, 0.7 * running.duration))
        hit = float(rng.uniform(now, running.duration))
        appeared = ball(ur5, running(hit), float(rng.uniform(0.03, 0.1)), 0.04 * rng.normal(size=3), "appeared")
        checker = pp.CollisionChecker(ur5, scene.remove("ball").add(appeared), margin=0.002)
        if not checker.is_free(running(now)):
            continue
        result = replan(running, checker, running(now), now, rng=seed)
        if result.status is ReplanStatus.KEPT:
            assert_free(result, checker)
            continue
        assert_continues(running, result, ur5)
        if result.proven:
            assert_free(result, checker)
        elif result.certificate.first_contact is not None:
            assert not checker.check(result.certificate.first_contact.q).free


def test_a_control_loop_moves_to_and_fro_beside_a_walking_person(ur5):
    """What the arm executes is one motion with a continuous acceleration, free of the person by coal."""
    running, _, scene = reaching(ur5, 60.0)
    scene, tick, began, goals = scene.remove("ball"), 0.05, 0.0, [running.end, running.start]
    pieces, statuses = [(0.0, running)], set()

    def person(t, radius):
        return pp.Obstacle("person", pp.Cylinder(radius, 1.8), pp.pose((0.85, 1.2 - 0.4 * t, 0.0)))

    for t in np.arange(0.0, 5.0, tick):
        since = max(t - began, 0.0)
        q = pieces[-1][1](min(since, pieces[-1][1].duration))
        if np.array_equal(q, goals[0]):
            goals.reverse()
        for radius in (0.35, 0.3, 0.25):
            now = pp.CollisionChecker(ur5, scene.add(person(t, radius)), margin=0.005)
            new = replan(pieces[-1][1], now, q, since, goals=goals[0], delay=tick, jerk=60.0)
            if new.proven:
                break
        statuses.add(new.status)
        if new.status is not ReplanStatus.KEPT:
            began += new.takeover
            pieces.append((began, new.trajectory))
    assert {ReplanStatus.KEPT, ReplanStatus.CHANGED} <= statuses
    assert len(pieces) > 5
    # The executed motion, at steps of 1 ms.
    times = np.arange(0.0, 5.0, 1e-3)
    which = np.searchsorted([begin for begin, _ in pieces], times, side="right") - 1
    q = np.array(
        [pieces[k][1](min(t - pieces[k][0], pieces[k][1].duration)) for k, t in zip(which, times, strict=True)]
    )
    limits = (ur5.limits.velocity, ur5.limits.acceleration, np.full(6, 60.0))
    for order, limit in enumerate(limits, start=1):
        assert (np.abs(np.diff(q, order, axis=0)) / 1e-3**order <= limit * (1 + 1e-6) + 1e-5).all(), order
    for t, at in zip(times[::20], q[::20], strict=True):
        assert pp.CollisionChecker(ur5, pp.Scene([person(t, 0.2)])).is_free(at)


@pytest.mark.parametrize("given", ["velocity", "jerk", "tool"])
def test_a_free_motion_that_exceeds_given_limits_is_not_kept(given, panda):
    running, checker = motion(panda, panda.home, panda.home + 0.6, jerk=200.0), pp.CollisionChecker(panda)
    middle, late = 0.5 * running.duration, running.duration + 0.1
    assert replan(running, checker, running(0.0), 0.0).status is ReplanStatus.KEPT
    slower = replace(panda.limits, velocity=0.3 * panda.limits.velocity)
    tool = ToolLimits(panda, linear_speed=0.3)
    tighter = {"velocity": {"limits": slower}, "jerk": {"jerk": 20.0}, "tool": {"rate_limits": [tool]}}[given]
    result = replan(running, checker, running(0.0), 0.0, **tighter)
    assert result.status in NEW, result.message
    assert "exceeds the given limits" in result.message
    times = np.linspace(0.0, result.trajectory.duration, 500)
    if given == "velocity":
        assert (np.abs(result.trajectory.velocity(times)) <= slower.velocity * (1.0 + 1e-9)).all()
        # In motion, nothing can begin above the limit.
        assert replan(running, checker, running(middle), middle, **tighter).status is ReplanStatus.UNPROVEN_STOP
    elif given == "jerk":
        assert (np.abs(np.diff(result.trajectory.acceleration(times), axis=0)) <= 20.0 * (times[1] + 1e-9)).all()
    else:
        assert tool.excess(running).max() > 1.01
        assert tool.excess(result.trajectory).max() <= 1.0 + 1e-9
    # An arm at the end rests, and limits that the motion keeps are no reason for a new one.
    assert replan(running, checker, running.end, late, **tighter).status is ReplanStatus.KEPT
    kept = replan(running, checker, running(middle), middle, limits=panda.limits, jerk=200.0)
    assert kept.status is ReplanStatus.KEPT


def test_a_motion_with_jumps_of_the_acceleration_is_not_kept_with_a_jerk_limit(gantry):
    running, checker = motion(gantry, (-0.8, -0.5), (0.8, -0.4)), pp.CollisionChecker(gantry)
    assert replan(running, checker, running(0.4), 0.4).status is ReplanStatus.KEPT
    result = replan(running, checker, running(0.4), 0.4, jerk=60.0)
    assert result.status in NEW
    assert_continues(running, result, gantry, 60.0)
    assert result.replan(checker, result.trajectory(0.1), 0.1).status is ReplanStatus.KEPT


def test_an_arm_whose_limits_exclude_zero_leaves_rest_and_motion(panda):
    """The fastest stop of a Panda is inside its limits, although its fourth and sixth joints cannot be at 0."""
    assert not panda.limits.inside(np.zeros(7)).all()
    running, checker = motion(panda, panda.home, panda.home + 0.6, jerk=200.0), pp.CollisionChecker(panda)
    for now in (0.0, 0.4, running.duration):
        result = replan(running, checker, running(now), now, goals=panda.home + 0.2, jerk=200.0)
        assert result.status in NEW, result.message
        assert_continues(running, result, panda, 200.0)
        assert_free(result, checker)
