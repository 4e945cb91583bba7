import logging
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pinproof import InputError, TimingError
from pinproof.motion import CubicPath, JointPath, time_parametrise
from pinproof.motion.smooth_timing import IMAGE_TOLERANCE

RELATIVE = 1 + 1e-9


def limits_of(velocity, acceleration, **others):
    return SimpleNamespace(velocity=np.array(velocity, float), acceleration=np.array(acceleration, float), **others)


def names(n):
    return tuple(f"joint_{i}" for i in range(n))


TWO_TO_SIX = st.integers(2, 6)
SIZES = st.sampled_from([1e-3, 1.0, 1e3])  # hair, arm, gantry


@st.composite
def problems(draw, points=TWO_TO_SIX, size=SIZES):
    """Waypoints (m, n) of 1 to 8 joints, each joint of its own scale, and limits that differ between joints."""
    n, m = draw(st.integers(1, 8)), draw(points)
    scale = np.array(draw(st.lists(size, min_size=n, max_size=n)))
    q = draw(arrays(float, (m, n), elements=st.floats(-3, 3, allow_subnormal=False))) * scale
    rate = arrays(float, n, elements=st.floats(0.1, 10))
    return JointPath(q, names(n)), limits_of(draw(rate) * scale, draw(rate) * scale)


def assert_within(trajectory, limits):
    assert (trajectory.max_velocity() <= limits.velocity * RELATIVE).all()
    assert (trajectory.max_acceleration() <= limits.acceleration * RELATIVE).all()
    if trajectory.duration > 1e-3:  # finite differences, which know nothing of the polynomials
        t = np.linspace(0, trajectory.duration, 2001)
        step = t[1] - t[0]
        q = trajectory(t)
        rounding = 8 * np.finfo(float).eps * np.abs(q).max(axis=0)
        assert (np.abs(np.diff(q, axis=0)) / step <= limits.velocity * RELATIVE + rounding / step).all()
        second = np.abs(np.diff(q, 2, axis=0)) / step**2
        assert (second <= limits.acceleration * 1.000001 + 4 * rounding / step**2).all()


def distance_to_polyline(points, q):
    """(N,) largest coordinate's distance of each point to the nearest segment."""
    a, d = q[:-1], np.diff(q, axis=0)
    square = np.maximum((d * d).sum(axis=1), np.finfo(float).tiny)
    s = np.clip(((points[:, None] - a) * d).sum(axis=2) / square, 0, 1)
    return np.abs(points[:, None] - (a + s[..., None] * d)).max(axis=2).min(axis=1)


@settings(deadline=None, max_examples=150)
@given(problems())
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


@settings(deadline=None)
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


def test_the_closed_form_agrees_with_toppra():
    q = np.array([[0.0, 0, 0], [1, -2, 0.5]])
    limits = limits_of([1, 1.5, 2], [3, 2, 5])
    straight = time_parametrise(JointPath(q, names(3)), limits)
    gridded = time_parametrise(CubicPath.through(q, names(3)), limits, grid=100)
    assert straight.duration <= gridded.duration
    assert gridded.duration == pytest.approx(straight.duration, rel=1e-3)


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


@st.composite
def smooth_problems(draw):
    n, m = draw(st.integers(1, 8)), draw(st.integers(2, 12))
    size = draw(st.sampled_from([1e-4, 0.03, 0.5]))
    phase, weight = (draw(arrays(float, n, elements=st.floats(-3, 3))) for _ in range(2))
    s = np.linspace(0, 1, m)
    q = size * (np.sin(2 * s[:, None] + phase) + (1 + weight) * s[:, None])
    rate = arrays(float, n, elements=st.floats(0.3, 5))
    return CubicPath.through(q, names(n), s), limits_of(draw(rate), draw(rate))


@settings(deadline=None, max_examples=40)
@given(smooth_problems())
def test_timing_keeps_the_image_and_the_limits_of_smooth_paths(problem):
    path, limits = problem
    trajectory = time_parametrise(path, limits)
    np.testing.assert_array_equal(trajectory.start, path.start)
    np.testing.assert_array_equal(trajectory.end, path.end)
    assert not trajectory.velocities[[0, -1]].any()
    assert_within(trajectory, limits)
    fine = path(np.linspace(*path.domain, 3000))
    samples = trajectory(np.linspace(0, trajectory.duration, 300))
    chord = np.abs(np.diff(fine, n=2, axis=0)).max()  # how far the fine polyline itself is from the path
    # the tolerance is one a joint; the nearest point in the Euclidean sense may be off by sqrt(n) of it in one
    assert distance_to_polyline(samples, fine).max() <= IMAGE_TOLERANCE * np.sqrt(len(path.joint_names)) + chord


def test_a_smooth_path_is_run_through_without_stopping():
    s = np.linspace(0, 1, 9)[:, None]
    path = CubicPath.through(np.hstack([np.sin(s), np.cos(s)]), names(2), s[:, 0])
    trajectory = time_parametrise(path, limits_of([1, 1], [4, 4]))
    inner = np.abs(trajectory.velocities[1:-1]).max(axis=1)
    assert inner.min() > 0
    assert trajectory.duration < time_parametrise(JointPath(path.q, names(2)), limits_of([1, 1], [4, 4])).duration / 2


def test_what_toppra_exceeds_between_its_grid_points_is_slowed_down(monkeypatch):
    from pinproof.motion import smooth_timing

    s = np.linspace(0, 1, 8)[:, None]
    path = CubicPath.through(np.hstack([np.sin(6 * s), np.cos(5 * s)]), names(2), s[:, 0])
    limits = limits_of([1, 1], [2, 2])
    honest = smooth_timing._toppra_speeds
    asked = time_parametrise(path, limits)
    monkeypatch.setattr(smooth_timing, "_toppra_speeds", lambda *args: 1.07 * honest(*args))
    monkeypatch.setattr(smooth_timing, "_ROUGH_ROUNDS", 0)
    hurried = time_parametrise(path, limits)
    assert_within(hurried, limits)
    assert hurried.duration >= asked.duration * 0.97


def test_a_failure_of_toppra_is_a_timing_error(monkeypatch):
    from toppra.algorithm import TOPPRA

    path = CubicPath.through([[0.0], [1.0]], names(1))
    for answer in ((None, None, None), (None, np.full(9, np.nan), None), (None, np.zeros(9), None)):
        monkeypatch.setattr(TOPPRA, "compute_parameterization", lambda *args, answer=answer: answer)
        with pytest.raises(TimingError, match="toppra"):
            time_parametrise(path, limits_of([1], [1]))


def test_toppra_says_nothing_and_its_logger_is_left_as_it_was(caplog, capfd):
    logger = logging.getLogger("toppra")
    level = logger.level
    with caplog.at_level(logging.DEBUG):
        time_parametrise(CubicPath.through([[0.0], [1.0]], names(1)), limits_of([1], [1]))
    assert caplog.text == ""
    assert capfd.readouterr() == ("", "")
    assert logger.level == level


@pytest.mark.parametrize("make", [JointPath, CubicPath.through])
def test_a_path_outside_the_position_limits_is_refused_by_joint(make):
    path = make([[0, 0], [1, 0.5]], names(2))
    with pytest.raises(TimingError, match="'joint_1'"):
        time_parametrise(path, limits_of([1, 1], [1, 1], lower=[-2, -2], upper=[2, 0.4]))
    time_parametrise(path, limits_of([1, 1], [1, 1], lower=[0, -np.inf], upper=[1, 0.5]))


def test_a_bulge_between_points_outside_the_position_limits_is_seen():
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
def test_limits_that_are_not_known_are_asked_for_by_joint(limits, message):
    with pytest.raises(InputError, match=message):
        time_parametrise(JointPath([[0, 0], [1, 1]], names(2)), limits)


def test_the_result_says_where_its_acceleration_limits_come_from():
    limits = limits_of([1], [2], acceleration_source="default: the velocity limit reached in 0.5 s")
    path = JointPath([[0.0], [1.0]], names(1))
    assert time_parametrise(path, limits).limits_note == f"acceleration limits: {limits.acceleration_source}"
    assert "given by the caller" in time_parametrise(path, limits_of([1], [2])).limits_note


def test_only_paths_are_timed():
    limits = limits_of([1], [1])
    path = JointPath([[0.0], [1.0]], names(1))
    with pytest.raises(InputError, match="not a Trajectory"):
        time_parametrise(time_parametrise(path, limits), limits)
    with pytest.raises(InputError, match="grid"):
        time_parametrise(path, limits, grid=0)
