import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof import InputError
from pinproof.errors import TimingError
from pinproof.motion import CubicPath, JointPath, time_parametrise
from pinproof.motion.timing import IMAGE_TOLERANCE

from ..examples import examples
from .timing_problems import (
    assert_on_path,
    assert_within,
    distance_to_polyline,
    limits_of,
    names,
    problems,
    rounded_problems,
    smooth_problems,
)


@examples(150)
@given(problems())
@pytest.mark.slow
def test_timing_keeps_the_image_and_the_limits_of_straight_paths(problem):
    path, limits = problem
    trajectory = time_parametrise(path, limits)
    np.testing.assert_array_equal(trajectory.start, path.start)
    np.testing.assert_array_equal(trajectory.end, path.end)
    assert not trajectory.velocities[[0, -1]].any()
    assert_within(trajectory, limits)
    samples = trajectory(np.linspace(0, trajectory.duration, 500))
    assert distance_to_polyline(samples, path.q).max() <= 1e-12 * max(1, np.abs(path.q).max())
    if len(trajectory.q) > 1:  # and each waypoint is passed; the pieces are straight, so chords will do
        assert distance_to_polyline(path.q, trajectory.q).max() <= 1e-12 * max(1, np.abs(path.q).max())


@given(problems(points=st.just(2), size=st.just(1.0)))
def test_a_straight_motion_is_as_fast_as_can_be(problem):
    path, limits = problem
    step = np.abs(path.end - path.start)
    if step.max() < 1e-3:
        return
    moving = step > 0
    speed = (limits.velocity[moving] / step[moving]).min()
    acceleration = (limits.acceleration[moving] / step[moving]).min()
    fastest = 2 / np.sqrt(acceleration) if speed**2 >= acceleration else 1 / speed + speed / acceleration
    assert time_parametrise(path, limits).duration == pytest.approx(fastest, rel=1e-6)


def test_a_motion_of_weeks_is_refused():
    with pytest.raises(TimingError, match="longer than"):
        time_parametrise(JointPath([[0.0], [1e20]], names(1)), limits_of([1], [1]))


def test_a_straight_stretch_takes_three_pieces():
    path = JointPath([[0, 0], [3, 0], [3, 3]], names(2))
    assert len(time_parametrise(path, limits_of([1, 1], [1, 1])).times) == 7


def test_the_motion_stops_at_corners_and_runs_through_straight_runs():
    line = np.linspace(0, 1, 11)[:, None] * [1.0, 2.0]
    limits = limits_of([1, 1], [1, 1])
    once = time_parametrise(JointPath(line[[0, -1]], names(2)), limits)
    assert time_parametrise(JointPath(line, names(2)), limits).is_close(once)
    there_and_back = time_parametrise(JointPath([[0, 0], [1, 2], [0, 0]], names(2)), limits)
    assert there_and_back.duration == pytest.approx(2 * once.duration)
    np.testing.assert_array_equal(there_and_back.velocity(once.duration), [0, 0])


def test_a_gentle_corner_is_a_corner():
    path = JointPath([[0, 0], [1, 1e-9], [2, 0]], names(2))
    trajectory = time_parametrise(path, limits_of([1, 1], [1, 1]))
    assert path.q[1].tolist() in trajectory.q.tolist()


def test_repeated_waypoints_take_no_time():
    limits = limits_of([1, 1], [1, 1])
    once = time_parametrise(JointPath([[0, 0], [1, 0], [1, 1]], names(2)), limits)
    again = time_parametrise(JointPath([[0, 0], [0, 0], [1, 0], [1, 0], [1, 1], [1, 1]], names(2)), limits)
    assert again.is_close(once, 0)


@pytest.mark.parametrize("gap", [1e-6, 1e-9, 1e-12, 1e-15, 1e-200])
def test_hairline_segments_do_not_slow_the_rest(gap):
    limits = limits_of([1, 2, 3], [1, 2, 3])
    q = np.array([[-1.0, 0.3, 2], [0, 0, 0], [0, gap, -gap], [1, 1, 3]])
    trajectory = time_parametrise(JointPath(q, names(3)), limits)
    without = time_parametrise(JointPath(q[[0, 1, 3]], names(3)), limits)
    assert_within(trajectory, limits)
    assert trajectory.duration == pytest.approx(without.duration, abs=0.01)


@pytest.mark.parametrize(
    "path",
    [
        JointPath([[1, 2]], names(2)),
        JointPath([[1, 2], [1, 2]], names(2)),
        CubicPath([[1, 2]], [[0, 0]], [0], names(2)),
        CubicPath([[1, 2], [1, 2]], [[0, 0], [0, 0]], [0, 1], names(2)),
    ],
)
def test_start_is_goal_takes_no_time(path):
    trajectory = time_parametrise(path, limits_of([1, 1], [1, 1]))
    assert trajectory.duration == 0
    assert trajectory.q.tolist() == [[1, 2]]


@pytest.mark.slow
@examples(30)
@given(smooth_problems())
def test_timing_keeps_the_image_and_the_limits_of_smooth_paths(problem):
    path, limits = problem
    trajectory = time_parametrise(path, limits)
    np.testing.assert_array_equal(trajectory.start, path.start)
    np.testing.assert_array_equal(trajectory.end, path.end)
    assert not trajectory.velocities[[0, -1]].any()
    assert_within(trajectory, limits)
    assert_on_path(trajectory, path, IMAGE_TOLERANCE)


@pytest.mark.slow
@examples(30)
@given(rounded_problems())
def test_rounded_corners_are_run_through_within_limits_and_corners_that_are_left_are_stops(problem):
    straight, path, limits = problem
    trajectory = time_parametrise(path, limits)
    assert_within(trajectory, limits)
    assert_on_path(trajectory, path, IMAGE_TOLERANCE)
    stopped = [point.tolist() for point, v in zip(trajectory.q, trajectory.velocities, strict=True) if not v.any()]
    for corner in path.corners:
        assert path(corner).tolist() in stopped
    assert len(stopped) == 2 + len(path.corners)
    assert trajectory.duration <= time_parametrise(straight, limits).duration * 1.01


def test_a_smooth_path_is_run_through_without_stopping():
    s = np.linspace(0, 1, 9)[:, None]
    path = CubicPath.through(np.hstack([np.sin(s), np.cos(s)]), names(2), s[:, 0])
    trajectory = time_parametrise(path, limits_of([1, 1], [4, 4]))
    inner = np.abs(trajectory.velocities[1:-1]).max(axis=1)
    assert inner.min() > 0
    assert trajectory.duration < time_parametrise(JointPath(path.q, names(2)), limits_of([1, 1], [4, 4])).duration / 2


@pytest.mark.parametrize("make", [JointPath, CubicPath.through])
def test_a_path_outside_the_position_limits_is_refused_by_joint(make):
    path = make([[0, 0], [1, 0.5]], names(2))
    with pytest.raises(TimingError, match="'joint_1'"):
        time_parametrise(path, limits_of([1, 1], [1, 1], lower=[-2, -2], upper=[2, 0.4]))
    time_parametrise(path, limits_of([1, 1], [1, 1], lower=[0, -np.inf], upper=[1, 0.5]))


def test_a_position_limit_exceeded_between_points_is_detected():
    path = CubicPath([[0.0], [0.0]], [[1.0], [-1.0]], [0, 1], names(1))  # up to 0.25 and back
    with pytest.raises(TimingError, match="'joint_0'"):
        time_parametrise(path, limits_of([1], [1], lower=[-1], upper=[0.2]))


def test_a_single_configuration_outside_the_position_limits_is_refused():
    with pytest.raises(TimingError, match="'joint_0'"):
        time_parametrise(JointPath([[3.0]], names(1)), limits_of([1], [1], lower=[-1], upper=[1]))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (limits_of([1, np.nan], [1, 1]), "velocity limit of joint 'joint_1' is not known; give it with limits="),
        (limits_of([1, 1], [np.nan, 1]), "acceleration limit of joint 'joint_0' is not known"),
        (limits_of([1, 0], [1, 1]), "velocity limit of joint 'joint_1' is 0"),
        (limits_of([1, 1], [1, np.inf]), "acceleration limit of joint 'joint_1' is inf"),
        (limits_of([1], [1, 1]), "limits.velocity must have the shape"),
        (limits_of([1, 1], [1, 1], lower=[np.nan, 0]), "lower position limit of joint 'joint_0' is NaN"),
    ],
)
def test_joints_with_unknown_limits_are_named(limits, message):
    with pytest.raises(InputError, match=message):
        time_parametrise(JointPath([[0, 0], [1, 1]], names(2)), limits)


def test_the_result_states_the_source_of_its_acceleration_limits():
    limits = limits_of([1], [2], acceleration_source="default: the velocity limit reached in 0.5 s")
    path = JointPath([[0.0], [1.0]], names(1))
    assert time_parametrise(path, limits).limits_note == f"acceleration limits: {limits.acceleration_source}"
    assert "given by the caller" in time_parametrise(path, limits_of([1], [2])).limits_note


def test_only_paths_are_timed():
    limits = limits_of([1], [1])
    path = JointPath([[0.0], [1.0]], names(1))
    with pytest.raises(InputError, match="not a Trajectory"):
        time_parametrise(time_parametrise(path, limits), limits)
    with pytest.raises(InputError, match="not a list"):
        time_parametrise([path], limits)


class Bare:
    """A curve of two cubic pieces with a corner between them, which names no corners."""

    joint_names = names(2)
    domain = (0.0, 2.0)
    start, end = np.zeros(2), np.array([1.0, 1.0])

    def bezier(self):
        control = [[[0, 0], [0.3, 0.1], [0.7, 0.1], [1, 0]], [[1, 0], [1.1, 0.3], [1.1, 0.7], [1, 1]]]
        return np.array([0.0, 1.0, 2.0]), np.array(control, float)

    def __call__(self, t):
        from pinproof.motion import Bezier

        return Bezier(*self.bezier()).at(t)


@pytest.mark.parametrize("jerk", [None, 20.0])
def test_any_curve_is_timed_and_stops_where_its_tangent_jumps(jerk):
    limits = limits_of([1, 1], [2, 2])
    trajectory = time_parametrise(Bare(), limits, jerk=jerk)
    assert_within(trajectory, limits, jerk)
    assert_on_path(trajectory, Bare(), IMAGE_TOLERANCE)
    still = [point.tolist() for point, v in zip(trajectory.q, trajectory.velocities, strict=True) if not v.any()]
    assert still == [[0, 0], [1, 0], [1, 1]]


@pytest.mark.parametrize("seed", range(20))
def test_a_path_that_reverses_on_a_line_turns_where_it_says(seed):
    """The waypoints on one line are passed in their order; those between two turning points are no stops."""
    rng = np.random.default_rng(seed)
    direction, s = rng.normal(size=3), rng.uniform(-1, 1, 6)
    if seed < 6:  # after a reversal, the point is still in front of the first one
        s = np.concatenate([[0.0, 1.0, 0.5], 1.0 + np.sort(rng.uniform(0, 1, 3))])
    path = JointPath(np.outer(s, direction) + 1.0, names(3))
    trajectory = time_parametrise(path, limits_of([1, 1, 1], [2, 2, 2]))
    turns = [s[0], *(b for a, b, c in zip(s[:-2], s[1:-1], s[2:], strict=True) if (b - a) * (c - b) < 0), s[-1]]
    rests = trajectory.q[~trajectory.velocities.any(axis=1)]
    np.testing.assert_allclose((rests - 1.0) @ direction / (direction @ direction), turns, atol=1e-9)
