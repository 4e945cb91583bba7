"""The monitor: no contact without an earlier alarm, and stops that stay inside their certified tube."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import pinproof as pp
from pinproof.errors import InputError
from pinproof.execution import MonitorStatus
from pinproof.model import load_robot

from .conftest import HIGH, LOW, OTHER, timed

TICK = 0.004


@pytest.fixture(scope="module")
def certificate(checker, swing):
    return pp.certify(swing, checker, joint_tolerance=0.02)


@pytest.fixture
def monitor(checker, swing, certificate):
    return pp.Monitor(checker, swing, certificate=certificate, latency=TICK, velocity_error=0.02)


def test_tracking_with_noise_stays_inside(monitor, swing) -> None:
    rng = np.random.default_rng(0)
    for time in np.arange(0.0, swing.duration, 0.01):
        q, dq = swing(time) + rng.uniform(-0.01, 0.01, 6), swing.velocity(time) + rng.uniform(-0.02, 0.02, 6)
        result = monitor.update(time, q, dq)
        assert result.inside
        assert result.proven
        assert not result.alarm
        assert result.progress == time


def test_a_late_robot_is_inside_at_an_earlier_point(monitor, swing) -> None:
    result = monitor.update(1.2, swing(1.0), swing.velocity(1.0))  # the same configurations are passed before 0.7 s
    assert result.inside
    assert result.progress == pytest.approx(1.0, abs=2e-3)


def test_the_joint_that_leaves_the_tube_is_named_with_its_excess(monitor, swing) -> None:
    q = swing(0.5).copy()
    q[4] += 0.05
    result = monitor.update(0.5, q, swing.velocity(0.5))
    assert result.alarm
    assert result.joint == "wrist_2_joint"
    assert 0.03 <= result.excess <= 0.032  # 0.05 - 0.02, and the errors within the latency
    assert result.status is MonitorStatus.OUTSIDE_BRAKING_FREE
    assert result.proven


def test_a_stop_that_leads_into_an_obstacle_is_not_proven(monitor, checker, swing) -> None:
    assert checker.is_free(LOW)
    down = np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0])  # the shoulder lowers the tool onto the table
    result = monitor.update(0.7, LOW + np.array([0, 0.05, 0, 0, 0, 0]), down)
    assert result.status is MonitorStatus.OUTSIDE
    assert not result.proven


def test_a_stop_is_proven_with_all_its_tolerance_and_only_if_it_ends_soon(checker, swing) -> None:
    low, high = 0.0, 1.5  # of the shoulder, which lowers the arm onto the table
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if checker.is_free(OTHER + middle * np.eye(6)[1]) else (low, middle)
    beside, rest = OTHER + (low - 0.01) * np.eye(6)[1], np.zeros(6)
    for error, status in ((0.02, MonitorStatus.OUTSIDE), (0.005, MonitorStatus.OUTSIDE_BRAKING_FREE)):
        judge = pp.Monitor(checker, swing, joint_tolerance=0.03, position_error=error * np.eye(6)[1])
        assert judge.update(0.0, beside, rest).status is status
    turning = np.eye(6)[5]  # the last joint can turn at any angle
    for stop, status in ((61.0, MonitorStatus.OUTSIDE), (59.0, MonitorStatus.OUTSIDE_BRAKING_FREE)):
        judge = pp.Monitor(checker, swing, joint_tolerance=0.03, acceleration=1.0 / stop)
        result = judge.update(0.5, swing(0.5) + 0.05 * turning, turning)
        assert result.status is status
        assert result.stop == pytest.approx(stop)


def test_measurements_that_are_not_finite_are_an_alarm(monitor, swing) -> None:
    q = swing(0.5).copy()
    q[2] = np.nan
    result = monitor.update(0.5, q, np.zeros(6))
    assert result.status is MonitorStatus.INVALID
    assert result.alarm
    assert not result.proven
    assert result.joint == "elbow_joint"
    for dq in (np.full(6, 1e308), np.full(6, -1e300)):  # no velocity of a robot, and its stop would overflow
        result = monitor.update(0.6, swing(0.6), dq)
        assert result.status is MonitorStatus.INVALID
        assert np.isnan(result.dq).all()
    for time in (np.nan, np.inf, "0.5", None):
        with pytest.raises(pp.InputError, match="time"):
            monitor.update(time, swing(0.5), np.zeros(6))


@pytest.mark.slow
def test_no_contact_happens_without_an_earlier_alarm(checker, swing) -> None:
    rng, contacts, alarms = np.random.default_rng(1), 0, 0
    limit, tube = checker.arm.limits.acceleration, pp.certify(swing, checker, joint_tolerance=0.02)
    for _ in range(12):
        monitor = pp.Monitor(checker, swing, certificate=tube, latency=TICK)
        fails, failure = rng.uniform(0.0, swing.duration), rng.uniform(-1.0, 1.0, 6) * limit
        time, q, dq, alarm = 0.0, swing.start.copy(), np.zeros(6), False
        while time < swing.duration + 0.5 and not alarm:
            alarm = monitor.update(time, q, dq).alarm
            if alarm:
                alarms += 1
                break
            if time < fails:  # a noisy controller that follows the motion within the acceleration limits
                t = min(time + TICK, swing.duration)
                wanted = (swing.velocity(t) - dq) / TICK + 40 * (swing(t) - q) + rng.normal(size=6) * 2
                acceleration = np.clip(wanted, -limit, limit)
            else:
                acceleration = failure
            steps = np.linspace(0.0, TICK, 5)[1:, None]
            path = q + dq * steps + 0.5 * acceleration * steps**2
            contacts += int((~checker.is_free_batch(path)).sum())
            q, dq, time = path[-1], dq + acceleration * TICK, time + TICK
        stop = monitor.update(time, q, dq)
        if stop.braking is not None and stop.proven:  # dense samples of a stop that is proven
            contacts += int((~checker.is_free_batch(stop.braking(np.linspace(0, 1, 50)))).sum())
    assert contacts == 0
    assert alarms == 12, "every failure is detected"


def worst_deviation(swing, progress, q, dq, latency, position_error, velocity_error, acceleration):
    """(6,) the largest deviation within the latency, among robots that deviate and accelerate as far as they may."""
    s = np.linspace(0.0, latency, 41)[:, None]
    motion = swing(np.minimum(progress + s[:, 0], swing.duration))
    worst = np.zeros(6)
    for side in (1, -1):
        robot = q + side * position_error + (dq + side * velocity_error) * s + side * acceleration * s**2 / 2
        worst = np.maximum(worst, np.abs(robot - motion).max(axis=0))
    return worst


@pytest.mark.parametrize("position_error", [0.0, 2e-4])
def test_velocities_that_are_estimated_have_the_error_of_the_estimate(
    checker, swing, certificate, position_error
) -> None:
    """The robot brakes and then accelerates within a tick, so that its mean velocity is below that at the end."""
    limit, latency = checker.arm.limits.acceleration, 0.02
    monitor = pp.Monitor(checker, swing, certificate=certificate, latency=latency, position_error=position_error)
    rng, inside, s = np.random.default_rng(0), 0, np.linspace(0.0, latency, 21)[:, None]
    for _ in range(150):
        begin = rng.uniform(0.1, swing.duration - 0.1)
        acceleration, noise = rng.choice([-1, 1], 6) * limit, rng.choice([-1, 1], (2, 6)) * position_error
        q, dq = swing(begin) + rng.uniform(0.0, 0.015) * np.sign(acceleration), swing.velocity(begin)
        monitor.update(-1.0, swing.start, np.zeros(6))
        monitor.update(begin, q + noise[0])
        for change in (-acceleration, acceleration):
            q, dq = q + dq * latency / 2 + change * latency**2 / 8, dq + change * latency / 2
        result = monitor.update(begin + latency, q + noise[1])
        inside += result.inside
        off = np.abs(q + dq * s + acceleration * s**2 / 2 - swing(result.progress + s[:, 0]))
        assert not result.inside or off.max() <= 0.02
    assert inside > 50


@pytest.mark.parametrize(
    ("latency", "position_error", "velocity_error"),
    [(0.0, 0.002, 0.0), (0.02, 0.0, 0.0), (0.02, 0.003, 0.1), (0.01, np.arange(6) * 1e-3, np.arange(6) * 0.05)],
)
def test_the_deviation_is_the_largest_one_of_robots_within_the_errors(
    checker, swing, latency, position_error, velocity_error
) -> None:
    limit, rng, tube = checker.arm.limits.acceleration, np.random.default_rng(3), 0.03 + 0.01 * np.arange(6) / 5
    monitor = pp.Monitor(
        checker, swing, joint_tolerance=tube, acceleration=limit, latency=latency, position_error=position_error,
        velocity_error=velocity_error,
    )  # fmt: skip
    drift = position_error + velocity_error * latency + (limit + swing.max_acceleration()) * latency**2 / 2
    tight, outside = np.zeros(6), 0
    for time in np.sort(rng.uniform(0.001, swing.duration, 120)):
        size = rng.choice([0.01, 0.05])
        q, dq = swing(time) + rng.uniform(-size, size, 6), swing.velocity(time) + rng.uniform(-0.3, 0.3, 6)
        result = monitor.update(time, q, dq)
        worst = worst_deviation(swing, result.progress, q, dq, latency, position_error, velocity_error, limit)
        assert (worst <= result.deviation + 1e-12).all()
        tight = np.maximum(tight, worst / result.deviation)
        # The configuration of the motion with which the state is compared is no worse than that of the same time.
        off, speed = q - swing(time), dq - swing.velocity(time)
        own = np.maximum(np.abs(off), np.abs(off + speed * latency)) + drift
        assert (result.deviation / tube).max() <= (own / tube).max() + 1e-12
        if (own <= tube).all():
            assert result.progress == time
        assert result.inside == bool((result.deviation <= tube).all())
        if result.alarm:
            j = int((result.deviation / tube).argmax())
            assert result.joint == swing.joint_names[j]
            assert result.excess == pytest.approx(result.deviation[j] - tube[j])
            outside += 1
    assert (tight[np.ptp(swing.q, axis=0) > 0.0] > 0.999).all()  # the motion accelerates against the robot at times
    assert outside > 20


def test_a_robot_that_is_late_is_compared_with_the_closest_configuration(checker) -> None:
    motion, rng, tube = timed(checker, HIGH, OTHER), np.random.default_rng(0), np.array([1, 2, 1, 2, 3, 1]) * 0.01
    monitor = pp.Monitor(checker, motion, joint_tolerance=tube)
    dense = np.linspace(0.0, motion.duration, 8_001)
    configurations = motion(dense)
    for time in rng.uniform(0.4, motion.duration - 0.4, 20):
        q = motion(time + rng.choice([-0.3, 0.3])) + rng.uniform(-0.5, 0.5, 6) * tube
        off = (np.abs(configurations - q) / tube).max(axis=1)
        result = monitor.update(0.0, motion.start, np.zeros(6)) and monitor.update(time, q, np.zeros(6))
        assert result.inside
        assert (result.deviation / tube).max() <= off.min() + 0.05
        assert off[np.abs(dense - result.progress).argmin()] <= off.min() + 0.05


def test_a_certificate_of_an_arm_without_pairs_is_used() -> None:
    arm = load_robot(
        '<robot name="one"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>'
    ).arm(tcp="b")
    checker = pp.CollisionChecker(arm)
    motion = pp.time_parametrise(pp.JointPath([[0.0], [1.0]], arm.joint_names), arm.limits)
    certificate = pp.certify(motion, checker, joint_tolerance=0.01)
    assert pp.Monitor(checker, motion, certificate=certificate).certificate is certificate


@pytest.mark.parametrize("latency", [0.0, 0.02])
def test_a_resting_robot_leaves_the_tube_where_its_errors_may(checker, swing, latency) -> None:
    monitor = pp.Monitor(
        checker, swing, joint_tolerance=0.03, latency=latency, position_error=0.002, velocity_error=0.05
    )
    drift = (checker.arm.limits.acceleration + swing.max_acceleration()) * latency**2 / 2
    distance = 0.03 - 0.002 - 0.05 * latency - drift
    for k, (j, side, share) in enumerate(product(range(1, 6), (1, -1), (0.999, 1.001))):  # the first joint moved
        at = swing.end + side * share * distance[j] * np.eye(6)[j]
        result = monitor.update(swing.duration + 1 + k, at, np.zeros(6))
        assert result.inside == (share < 1)
        assert result.joint == ("" if share < 1 else swing.joint_names[j])
        assert result.excess == pytest.approx(max(share - 1, 0) * distance[j])


def test_simulated_stops_stay_inside_the_certified_tube_and_reach_its_border(checker) -> None:
    rng, limit = np.random.default_rng(2), checker.arm.limits.acceleration
    for latency, error, off in ((0.0, 0.0, 0.0), (0.004, 0.01, 0.0), (0.004, 0.01, 0.002)):
        judge = pp.Monitor(
            checker, timed(checker, HIGH, OTHER), joint_tolerance=0.02, latency=latency, velocity_error=error,
            position_error=off,
        )  # fmt: skip
        for _ in range(20):
            q, measured = rng.normal(size=6), rng.normal(size=6)
            path, tolerance, stop = judge.stopping(q, measured)
            start, step = path.start, path.end - path.start
            v = measured + rng.uniform(-error, error, 6)
            positions = [q + rng.uniform(-off, off, 6)]
            for _ in range(40):  # any acceleration within the limits until the brakes act
                acceleration = rng.uniform(-1, 1, 6) * limit
                dt = latency / 40
                positions.append(positions[-1] + v * dt + 0.5 * acceleration * dt**2)
                v = v + acceleration * dt
            duration = (np.abs(v) / limit).max()
            assert latency + duration <= stop + 1e-12
            t = np.linspace(0, duration, 200)[:, None]
            positions = np.vstack([positions, positions[-1] + v * (t - t**2 / (2 * max(duration, 1e-12)))])
            for point in positions[:: len(positions) // 30]:
                # The shares of the segment at which each joint is within its tolerance have a share in common.
                ends = np.sort([(point - start - side * tolerance) / step for side in (1, -1)], axis=0)
                assert max(ends[0].max(), 0.0) <= min(ends[1].min(), 1.0) + 1e-9
            # The robot that is as far, as fast and as much accelerated as possible in the direction of its motion.
            way = np.sign(measured)
            v = measured + way * error
            last = q + way * off + v * latency + way * limit * latency**2 / 2
            v = v + way * limit * latency
            duration = (np.abs(v) / limit).max()
            assert latency + duration == pytest.approx(stop)
            np.testing.assert_allclose(last + v * duration / 2 - path.end, way * tolerance, atol=1e-12)


def test_certificates_of_other_motions_and_setups_are_refused(checker, swing) -> None:
    other = pp.certify(timed(checker, HIGH, LOW), checker, joint_tolerance=0.02)
    with pytest.raises(InputError, match="another motion"):
        pp.Monitor(checker, swing, certificate=other)
    bare = pp.certify(swing, checker)
    with pytest.raises(InputError, match="joint_tolerance"):
        pp.Monitor(checker, swing, certificate=bare)
    wide = pp.certify(swing, checker, joint_tolerance=0.02)
    assert pp.Monitor(checker, swing, certificate=wide).certificate is wide
    stricter = checker.with_margin(wide.clearance + 0.05)
    with pytest.raises(pp.errors.NotProvenFree):
        pp.Monitor(stricter, swing, certificate=wide)


def test_a_certificate_for_wider_limits_than_those_of_the_arm_is_not_used(checker, swing) -> None:
    limits = checker.arm.limits
    slow = checker.arm.with_limits(replace(limits, velocity=swing.max_velocity() * 0.9 + 1e-3))
    strict = pp.CollisionChecker(slow, checker.scene, margin=checker.margin)
    for others in (limits, None):
        tube = pp.certify(swing, strict, joint_tolerance=0.01, limits=others)
        assert tube.free
        with pytest.raises(pp.errors.NotProvenFree, match="velocity"):
            pp.Monitor(strict, swing, certificate=tube)


def test_certificate_that_allows_more_contacts_is_not_used(checker, swing) -> None:
    ball = pp.Obstacle("ball", pp.Sphere(0.05), checker.arm.forward_kinematics(swing(swing.duration / 2)))
    strict = checker.with_scene(checker.scene.add(ball))
    lax = strict.allowing(*((name, "ball") for name in strict.obstacles_and_links if name.endswith("_link")))
    wide = pp.certify(swing, lax, joint_tolerance=0.01).or_raise()
    with pytest.raises(pp.errors.NotProvenFree):
        pp.Monitor(strict, swing, certificate=wide)
    assert pp.Monitor(lax, swing, certificate=wide).certificate is wide


def test_velocity_is_that_of_an_array_that_the_controller_uses_again(checker, swing) -> None:
    monitor = pp.Monitor(checker, swing, joint_tolerance=0.02, latency=TICK)
    buffer, off = swing(0.5).copy(), np.array([0, 0, 0, 0, 0, 0.012])
    assert monitor.update(0.5, buffer).inside
    buffer += off + swing.velocity(0.5) * TICK  # within the tube, at 3 rad/s beside it
    assert monitor.update(0.5 + TICK, buffer).joint == "wrist_3_joint"


@pytest.mark.parametrize("time", [0.5, 0.4])
@pytest.mark.parametrize("measured", [False, True])
def test_a_measurement_that_is_not_later_is_invalid(monitor, swing, time, measured) -> None:
    def update(at):
        return monitor.update(at, swing(at), swing.velocity(at) if measured else None)

    assert update(0.5).inside
    result = update(time)
    assert result.status is MonitorStatus.INVALID
    assert "later" in str(result)
    assert update(0.5 + TICK).inside
    assert update(0.0).inside  # the next execution


@pytest.mark.parametrize("stated", ["the last velocity", "no velocity", "rest"])
def test_a_measurement_that_freezes_while_the_robot_moves_is_invalid(checker, swing, certificate, stated) -> None:
    """The alarm comes when the robot has surely moved by the tolerance, and not after three times this distance."""
    for begin in (0.2, 0.3, 0.5, 1.3):
        monitor = pp.Monitor(checker, swing, certificate=certificate, latency=TICK)
        for time in np.arange(0.0, begin, TICK):
            assert monitor.update(time, swing(time), None if stated == "no velocity" else swing.velocity(time)).inside
        frozen, way = time, 0.0
        rate = {"the last velocity": swing.velocity(frozen), "no velocity": None, "rest": np.zeros(6)}[stated]
        while (result := monitor.update(time := time + TICK, swing(frozen), rate)).inside:
            way = np.abs(swing(time) - swing(frozen)).max()
            assert way < 0.06
        assert result.status is MonitorStatus.INVALID
        assert np.isnan(result.q).all()
        assert way > 0.01
        moving = int(np.abs(swing.velocity(frozen)).argmax())
        assert result.joint == swing.joint_names[moving]
        later = time + TICK
        assert monitor.update(later, swing(later), swing.velocity(later)).inside  # it is measured again


@pytest.mark.parametrize("measured", [True, False])
def test_a_repeated_measurement_is_valid_if_the_robot_may_be_there(checker, swing, certificate, measured) -> None:
    """It brakes with all its acceleration and rests, or its sensor is slower than the ticks."""
    limit = checker.arm.limits.acceleration
    for begin in (0.2, 0.3, 0.5):
        monitor = pp.Monitor(checker, swing, certificate=certificate)
        time, q, dq = begin, swing(begin).copy(), swing.velocity(begin).copy()
        for _ in range(200):
            result = monitor.update(time, q, dq if measured else None)
            assert result.status is not MonitorStatus.INVALID
            slower = np.sign(dq) * np.maximum(np.abs(dq) - limit * TICK, 0.0)
            time, q, dq = time + TICK, q + (dq + slower) / 2 * TICK, slower
        assert not dq.any()
    monitor = pp.Monitor(checker, swing, certificate=certificate)
    for time in np.arange(0.0, swing.duration, 0.001):
        sensed = np.floor(time * 200 + 1e-9) / 200
        rate = swing.velocity(sensed) if measured else None
        assert monitor.update(time, swing(sensed), rate).inside


def test_only_the_start_counts_for_the_deviation_from_the_start(monitor, swing) -> None:
    assert (monitor.start_deviation(swing.start, np.zeros(6)) < 1.0).all()
    for time in np.linspace(0.2, swing.duration, 50):
        for rate in (np.zeros(6), swing.velocity(time)):
            away = np.abs(swing(time) - swing.start).max() > 0.02
            assert not away or (monitor.start_deviation(swing(time), rate) > 1.0).any()
    assert not (monitor.start_deviation(swing.start, np.full(6, np.nan)) <= 1.0).any()


def test_latency_that_uses_up_the_tube_is_refused(checker, swing) -> None:
    with pytest.raises(InputError, match="latency"):
        pp.Monitor(checker, swing, joint_tolerance=0.02, latency=0.2)
