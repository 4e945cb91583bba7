"""The motion of a controller by its rules, compared with a step-by-step simulation of them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import pinproof as pp
from pinproof.collision import trace_line
from pinproof.motion import ControllerMove, controller_motion, fastest, fewest_moves

STEP = 1e-4


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    arm, rng = pp.load_robot("ur5").arm(tcp="tool0"), np.random.default_rng(7)
    acceleration = rng.uniform(3.0, 20.0, 6)
    return arm.with_limits(replace(arm.limits, acceleration=acceleration, acceleration_source="measured"))


def simulated_share(top: float, gain: float, loss: float) -> np.ndarray:
    """The share of a move at each step: it accelerates, and brakes when the remaining distance needs it."""
    passed, rate, rows = 0.0, 0.0, [0.0]
    while passed < 1.0 - 1e-7:
        faster = min(rate + gain * STEP, top, np.sqrt(2.0 * loss * (1.0 - passed)))
        passed += min((rate + faster) / 2.0, faster) * STEP
        rate = faster
        rows.append(min(passed, 1.0))
    return np.array(rows)


def simulated_corner(paths, zone, limits, before: float, behind: float) -> float:
    """Seconds of two joint moves with a zone, stepped in time, with the speeds (shares per second) at the zone."""
    travel = [path.end - path.start for path in paths]
    gains = [(limits.acceleration / np.abs(each)).min() for each in travel]
    tops = [(limits.velocity / np.abs(each)).min() for each in travel]
    # the shortest time in which all joints can change from one velocity to the other
    both = (np.abs(behind * travel[1] - before * travel[0]) / limits.acceleration).max()
    if before > tops[0] or behind > tops[1] or before * both / 2 > zone[0] or behind * both / 2 > zone[1]:
        return np.inf
    seconds = both
    for speed, gain, top, used in zip(
        (before, behind), gains, tops, (before * both / 2, behind * both / 2), strict=True
    ):
        # the rest of each move, from rest to the speed at the zone; the second one backwards
        left, rate, steps = 1.0 - used, 0.0, 0
        while left > 0.0:
            rate = min(rate + gain * STEP, top, np.sqrt(speed**2 + 2.0 * gain * left))
            left -= rate * STEP
            steps += 1
        if rate < speed * 0.99:
            return np.inf
        seconds += STEP * steps
    return seconds


def moves_of(arm: pp.Arm, rng: np.random.Generator, count: int) -> list[pp.JointPath]:
    q = np.cumsum(np.vstack([arm.home, rng.uniform(-0.8, 0.8, (count, 6))]), axis=0)
    return [pp.JointPath(q[k : k + 2], arm.joint_names) for k in range(count)]


def test_a_joint_move_takes_the_time_of_a_simulated_synchronous_trapezoid(arm) -> None:
    rng = np.random.default_rng(0)
    for (path,) in (moves_of(arm, rng, 1) for _ in range(20)):
        travel = np.abs(path.q[1] - path.q[0])
        gain = (arm.limits.acceleration / travel).min()
        seconds = STEP * (len(simulated_share((arm.limits.velocity / travel).min(), gain, gain)) - 1)
        assert controller_motion([ControllerMove(path)], arm.limits).duration == pytest.approx(seconds, rel=2e-3)


def test_the_speeds_at_a_zone_are_nearly_the_best_of_a_simulation(arm) -> None:
    rng = np.random.default_rng(4)
    for zone in [(0.1, 0.2), (0.5, 0.5), (0.05, 0.4)]:
        paths = moves_of(arm, rng, 2)
        moves = [ControllerMove(paths[0], None, zone), ControllerMove(paths[1])]
        found = controller_motion(moves, arm.limits).duration
        speeds = np.geomspace(0.15, 6.0, 16)
        times = [simulated_corner(paths, zone, arm.limits, a, b) for a in speeds for b in speeds]
        assert found <= 1.01 * min(times)
        assert found >= 0.9 * min(times)


@pytest.mark.parametrize("zone", [None, (0.1, 0.2), (0.5, 0.5)])
def test_superposed_moves_add_up_in_their_zones_and_keep_all_limits(arm, zone) -> None:
    rng = np.random.default_rng(1)
    for _ in range(10):
        paths = moves_of(arm, rng, 3)
        zones = [zone, zone, None]
        if zone is None:
            with_stops = controller_motion([ControllerMove(path) for path in paths], arm.limits)
            assert with_stops.duration == pytest.approx(sum(fastest(path, arm.limits).duration for path in paths))
            continue
        made = controller_motion([ControllerMove(p, None, z) for p, z in zip(paths, zones, strict=True)], arm.limits)
        stopping = sum(fastest(path, arm.limits).duration for path in paths)
        assert controller_motion(made.moves, arm.limits, optional=True).duration <= min(stopping, made.duration) + 1e-9
        # The speed of each move, summed in small steps from its start; the displacements add up
        times = np.arange(0.0, made.duration + STEP, STEP)
        q, superposed = np.tile(paths[0].start, (len(times), 1)), np.zeros(len(times))
        for k, (path, profile, start) in enumerate(zip(paths, made.profiles, made.starts, strict=True)):
            rates = np.interp(times - start, profile.times, profile.speeds, left=0.0, right=0.0)
            shares = np.concatenate([[0.0], np.cumsum((rates[1:] + rates[:-1]) / 2.0) * STEP])
            assert shares[-1] == pytest.approx(1.0, abs=2e-3)
            q += shares[:, None] * (path.end - path.start)
            moving = (shares > 1e-3) & (shares < 1.0 - 1e-3)
            superposed += moving
            # Two moves are superposed in the zones only
            if k:
                both = (superposed == 2) & moving
                assert (shares[both] <= zone[1] + 2e-3).all()
            superposed = moving.astype(float)
        found = made.trajectory(np.minimum(times, made.trajectory.duration))
        assert np.abs(found - q).max() < 2e-3
        # Finite differences keep the limits
        rates = np.diff(found, axis=0) / STEP
        assert (np.abs(rates) <= arm.limits.velocity * (1.0 + 1e-3) + 1e-3).all()
        coarse = made.trajectory(np.arange(0.0, made.trajectory.duration, 5e-3))
        bends = np.abs(np.diff(coarse, 2, axis=0)) / 25e-6
        assert (bends <= arm.limits.acceleration * (1.0 + 1e-3) + 1e-2).all()


def test_a_linear_move_keeps_the_limits_of_the_joints_on_the_whole_line(arm) -> None:
    q = np.array([0.3, -1.2, 1.5, -1.9, -1.5, 0.2])
    target = arm.forward_kinematics(q)
    target.translation += [0.0, 0.0, -0.15]
    path = pp.collision.trace_line(arm, q, target).path
    motion = controller_motion([ControllerMove(path)], arm.limits)
    dense = motion.trajectory(np.arange(0.0, motion.duration, 2e-3))
    assert (np.abs(np.diff(dense, axis=0)) / 2e-3 <= arm.limits.velocity).all()
    assert (np.abs(np.diff(dense, 2, axis=0)) / 4e-6 <= 1.01 * arm.limits.acceleration).all()
    tcp = arm.forward_kinematics_batch(dense)[:, :3, 3]
    assert np.abs(tcp[:, :2] - tcp[0, :2]).max() < 1e-6
    optimal = pp.time_parametrise(pp.motion.CubicPath.through(path.q[::20], arm.joint_names), arm.limits)
    assert optimal.duration <= motion.duration <= 1.25 * optimal.duration


def test_a_linear_move_in_a_zone_keeps_the_accelerations_of_the_joints_there() -> None:
    arm, rng = pp.load_robot("ur5").arm(tcp="tool0"), np.random.default_rng(3)
    blended = 0
    for _ in range(12):
        q = np.array([0.0, -1.2, 1.4, -1.7, -1.57, 0.0]) + 0.4 * rng.normal(size=(3, 6))
        shift = pp.pose(0.05 * rng.normal(size=3), 0.05 * rng.normal(size=3))
        line = trace_line(arm, q[1], arm.forward_kinematics(q[1]) * shift)
        if line.reason:
            continue
        ends = ([q[0], q[1]], [line.path.end, q[2]])
        first, last = (pp.JointPath(points, arm.joint_names) for points in ends)
        zone = tuple(rng.uniform(0.1, 0.5, 2))
        alike = bool(blended % 2)
        middle = ControllerMove(line.path, None, zone, alike=alike)
        moves = [ControllerMove(first, None, zone), middle, ControllerMove(last)]
        made = controller_motion(moves, arm.limits)
        assert not alike or np.ptp(made.profiles[1].gains) < 1e-6 * made.profiles[1].gains[0]
        times = np.linspace(0.0, made.duration, 4001)
        passed = np.zeros((len(times), 6))
        for move, profile, start in zip(moves, made.profiles, made.starts, strict=True):
            shares, _ = profile.at(times - start)
            points, at = move.path.q, np.linspace(0.0, 1.0, len(move.path.q))
            passed += make_interp_spline(at, points, k=min(3, len(points) - 1))(shares) - points[0]
        bends = np.abs(np.diff(passed, 2, axis=0)) / times[1] ** 2
        assert (bends <= arm.limits.acceleration * 1.005).all()
        blended += 1
    assert blended > 6


def test_a_line_near_a_singularity_keeps_the_accelerations_between_rest_and_a_zone(arm) -> None:
    """Its limits differ much from place to place, and the short motion brakes early or accelerates late."""
    rng, count = np.random.default_rng(21), 0
    for k in range(10):
        q = np.array([0.0, -1.2, 1.4, -1.7, 0.0, 0.0]) + 0.4 * rng.normal(size=6)
        q[4] = rng.uniform(0.1, 0.3)
        line = trace_line(arm, q, arm.forward_kinematics(q) * pp.pose(0.1 * rng.normal(size=3)))
        if line.reason:
            continue
        away = line.path.end + 0.5 * rng.normal(size=6)
        paths = [line.path, pp.JointPath([line.path.end, away], arm.joint_names)]
        if k % 2:
            paths = [path.reversed() for path in paths[::-1]]
        moves = [ControllerMove(paths[0], None, (0.1, 0.1), alike=k > 4), ControllerMove(paths[1], alike=k > 4)]
        made = controller_motion(moves, arm.limits)
        assert k < 5 or all(np.ptp(profile.gains) < 1e-6 * profile.gains[0] for profile in made.profiles)
        times, passed = np.linspace(0.0, made.duration, 4001), np.zeros((4001, 6))
        for move, profile, start in zip(moves, made.profiles, made.starts, strict=True):
            q, (shares, _) = move.path.q, profile.at(times - start)
            passed += make_interp_spline(np.linspace(0.0, 1.0, len(q)), q, k=min(3, len(q) - 1))(shares) - q[0]
        bends = np.abs(np.diff(passed, 2, axis=0)) / times[1] ** 2
        assert (bends <= arm.limits.acceleration * 1.005).all()
        count += 1
    assert count > 6


def test_joint_moves_lead_through_few_points_with_proven_lines_only(arm) -> None:
    """A wall in the plane of two joints, around which the points lead."""
    along = np.linspace(0.0, np.pi, 21)
    points = np.zeros((21, 6))
    points[:, 0], points[:, 1] = -np.cos(along), np.sin(along)

    def proven(one, other) -> bool:
        line = one + np.linspace(0.0, 1.0, 200)[:, None] * (other - one)
        return bool((np.linalg.norm(line[:, :2], axis=1) > 0.6).all())

    found = points[fewest_moves(points, arm.limits, proven)]
    assert len(found) <= 4
    np.testing.assert_array_equal(found[[0, -1]], points[[0, -1]])
    assert all(proven(*pair) for pair in pairwise(found))
    assert fewest_moves(points, arm.limits, lambda *_: False) is None
