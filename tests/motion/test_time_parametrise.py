"""Timing keeps the image and the limits of any path, also with limits of jerk and with velocities at the ends."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof import InputError, JointLimits
from pinproof.errors import TimingError
from pinproof.motion import Bezier, BlendedPath, CubicPath, JointPath, Trajectory, time_parametrise
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

UNIT = limits_of([1, 1], [1, 1])
LIMITS = limits_of([1, 1], [2, 2])
LINE = JointPath([[0, 0], [2, 1]], names(2))
RISES = st.sampled_from([0.01, 0.1, 1.0])
"""Seconds from no acceleration to the limit."""


def timed(path, limits, rise=None, **velocities):
    """The motion with limits of jerk, if a rise is given; what holds for any motion is asserted."""
    jerk = None if rise is None else limits.acceleration / rise
    trajectory = time_parametrise(path, limits, jerk=jerk, **velocities)
    assert_within(trajectory, limits, jerk)
    np.testing.assert_array_equal([trajectory.start, trajectory.end], [path.start, path.end])
    if not velocities:
        assert not trajectory.velocities[[0, -1]].any()
        assert rise is None or not trajectory.accelerations[[0, -1]].any()
    return trajectory


def waypoints_at_rest(trajectory):
    return [point.tolist() for point, v in zip(trajectory.q, trajectory.velocities, strict=True) if not v.any()]


@pytest.mark.slow
@examples(120)
@given(st.one_of(st.tuples(problems(), st.none()), st.tuples(problems(size=st.just(1.0)), RISES)))
def test_timing_keeps_the_image_and_the_limits_of_straight_paths(case):
    (path, limits), rise = case
    trajectory, size = timed(path, limits, rise), max(1, np.abs(path.q).max())
    samples = trajectory(np.linspace(0, trajectory.duration, 500))
    assert distance_to_polyline(samples, path.q).max() <= 1e-12 * size
    if len(trajectory.q) > 1:  # and each waypoint is passed; the pieces are straight, so chords will do
        assert distance_to_polyline(path.q, trajectory.q).max() <= 1e-12 * size


@pytest.mark.slow
@examples(40)
@given(smooth_problems(), st.sampled_from([None, None, 0.02, 0.3]))
def test_timing_keeps_the_image_and_the_limits_of_smooth_paths(problem, rise):
    path, limits = problem
    assert_on_path(timed(path, limits, rise), path, IMAGE_TOLERANCE)


@pytest.mark.slow
@examples(50)
@given(rounded_problems(), st.one_of(st.none(), RISES))
def test_rounded_corners_are_run_through_within_limits_and_corners_that_are_left_are_stops(problem, rise):
    straight, path, limits = problem
    trajectory = timed(path, limits, rise)
    assert_on_path(trajectory, path, IMAGE_TOLERANCE)
    if rise is None:
        stopped = waypoints_at_rest(trajectory)
        assert all(path(corner).tolist() in stopped for corner in path.corners)
        assert len(stopped) == 2 + len(path.corners)
        assert trajectory.duration <= time_parametrise(straight, limits).duration * 1.01


@given(problems(points=st.just(2), size=st.just(1.0)))
def test_a_straight_motion_is_as_fast_as_can_be(problem):
    path, limits = problem
    step = np.abs(path.end - path.start)
    if step.max() < 1e-3:
        return
    moving = step > 1e-100  # a smaller step limits nothing, and its quotient may be too large for a double
    speed, acceleration = ((rate[moving] / step[moving]).min() for rate in (limits.velocity, limits.acceleration))
    fastest = 2 / np.sqrt(acceleration) if speed**2 >= acceleration else 1 / speed + speed / acceleration
    assert time_parametrise(path, limits).duration == pytest.approx(fastest, rel=1e-6)


@pytest.mark.parametrize(
    ("length", "seconds"),
    [
        # V = 1, A = 2, J = 8 in turn: with a cruise; up to A without one; neither
        (3.0, 3.0 + 0.5 + 0.25),
        (0.5, 2 * (0.25 + (0.25**2 / 4 + 0.5 / 2) ** 0.5 - 0.125)),
        (0.0625, 4 * (0.0625 / 16) ** (1 / 3)),
    ],
)
def test_a_straight_stretch_with_a_jerk_limit_takes_the_time_of_the_textbook(length, seconds):
    path = JointPath([[0.0, 0], [length, -length / 2]], names(2))
    trajectory = time_parametrise(path, limits_of([1, 9], [2, 9]), jerk=[8, 90])
    assert trajectory.duration == pytest.approx(seconds, rel=1e-6)
    assert len(trajectory.times) <= 8


def test_a_straight_stretch_takes_three_pieces():
    assert len(time_parametrise(JointPath([[0, 0], [3, 0], [3, 3]], names(2)), UNIT).times) == 7


def test_the_motion_stops_at_corners_and_runs_through_straight_runs():
    line = np.linspace(0, 1, 11)[:, None] * [1.0, 2.0]
    once = time_parametrise(JointPath(line[[0, -1]], names(2)), UNIT)
    assert time_parametrise(JointPath(line, names(2)), UNIT).is_close(once)
    there_and_back = time_parametrise(JointPath([[0, 0], [1, 2], [0, 0]], names(2)), UNIT)
    assert there_and_back.duration == pytest.approx(2 * once.duration)
    np.testing.assert_array_equal(there_and_back.velocity(once.duration), [0, 0])
    gentle = JointPath([[0, 0], [1, 1e-9], [2, 0]], names(2))
    assert gentle.q[1].tolist() in time_parametrise(gentle, UNIT).q.tolist()


@pytest.mark.parametrize("seed", range(12))
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


def test_repeated_waypoints_take_no_time():
    once = time_parametrise(JointPath([[0, 0], [1, 0], [1, 1]], names(2)), UNIT)
    again = time_parametrise(JointPath([[0, 0], [0, 0], [1, 0], [1, 0], [1, 1], [1, 1]], names(2)), UNIT)
    assert again.is_close(once, 0)


@pytest.mark.parametrize("gap", [1e-6, 1e-9, 1e-12, 1e-15, 1e-200])
def test_hairline_segments_do_not_slow_the_rest(gap):
    limits = limits_of([1, 2, 3], [1, 2, 3])
    q = np.array([[-1.0, 0.3, 2], [0, 0, 0], [0, gap, -gap], [1, 1, 3]])
    without = time_parametrise(JointPath(q[[0, 1, 3]], names(3)), limits)
    assert timed(JointPath(q, names(3)), limits).duration == pytest.approx(without.duration, abs=0.01)


def test_zero_motions_take_no_time_and_tiny_ones_almost_none():
    one, two, still = [[1, 2]], [[1, 2], [1, 2]], np.zeros((2, 2))
    for path in (
        JointPath(one, names(2)), JointPath(two, names(2)),
        CubicPath(one, still[:1], [0], names(2)), CubicPath(two, still, [0, 1], names(2)),
    ):  # fmt: skip
        for jerk, kind in ((None, "cubic"), (5.0, "quintic")):
            trajectory = time_parametrise(path, UNIT, jerk=jerk)
            assert (trajectory.duration, trajectory.q.tolist(), trajectory.interpolant) == (0, one, kind)
    for gap in (1e-6, 1e-9, 1e-13):
        assert timed(JointPath([[1, 2], [1 + gap, 2]], names(2)), UNIT, 0.2).duration < 0.1


def test_a_motion_of_weeks_is_refused():
    with pytest.raises(TimingError, match="longer than"):
        time_parametrise(JointPath([[0.0], [1e20]], names(1)), limits_of([1], [1]))


def test_a_smooth_path_is_run_through_without_stopping():
    s, limits = np.linspace(0, 1, 9)[:, None], limits_of([1, 1], [4, 4])
    path = CubicPath.through(np.hstack([np.sin(s), np.cos(s)]), names(2), s[:, 0])
    trajectory = time_parametrise(path, limits)
    assert np.abs(trajectory.velocities[1:-1]).max(axis=1).min() > 0
    assert trajectory.duration < time_parametrise(JointPath(path.q, names(2)), limits).duration / 2


@pytest.mark.parametrize(
    ("path", "lower", "upper", "joint", "wide"),
    [
        (JointPath([[0, 0], [1, 0.5]], names(2)), [-2, -2], [2, 0.4], "joint_1", ([0, -np.inf], [1, 0.5])),
        (CubicPath.through([[0, 0], [1, 0.5]], names(2)), [-2, -2], [2, 0.4], "joint_1", ([0, -np.inf], [1, 0.5])),
        # up to 0.25 and back between the points
        (CubicPath([[0.0], [0.0]], [[1.0], [-1.0]], [0, 1], names(1)), [-1], [0.2], "joint_0", ([-1], [0.25])),
        (JointPath([[3.0]], names(1)), [-1], [1], "joint_0", ([-1], [3])),
    ],
)
def test_a_path_outside_the_position_limits_is_refused_by_joint(path, lower, upper, joint, wide):
    rates = np.ones((2, len(lower)))
    with pytest.raises(TimingError, match=f"'{joint}'"):
        time_parametrise(path, limits_of(*rates, lower=lower, upper=upper))
    time_parametrise(path, limits_of(*rates, lower=wide[0], upper=wide[1]))


WITH_JERK = limits_of([1, 1], [2, 2], jerk=np.array([7.0, 9.0]), jerk_source="cell.yaml")


@pytest.mark.parametrize(
    ("limits", "jerk", "message"),
    [
        (limits_of([1, np.nan], [1, 1]), None, "velocity limit of joint 'joint_1' is not known; give it with limits="),
        (limits_of([1, 1], [np.nan, 1]), None, "acceleration limit of joint 'joint_0' is not known"),
        (limits_of([1, 0], [1, 1]), None, "velocity limit of joint 'joint_1' is 0"),
        (limits_of([1, 1], [1, np.inf]), None, "acceleration limit of joint 'joint_1' is inf"),
        (limits_of([1], [1, 1]), None, "limits.velocity must have 2 numbers, not 1"),
        (limits_of([1, 1], [1, 1], lower=[np.nan, 0]), None, "lower position limit of joint 'joint_0' is NaN"),
        (LIMITS, "limits", "hold no jerk"),
        (JointLimits(-np.ones(2), np.ones(2), np.ones(2)), "limits", "hold no jerk"),
        (WITH_JERK, "some", "'limits'"),
        (WITH_JERK, [1.0], "limits.jerk must have 2 numbers, not 1"),
        (WITH_JERK, 0.0, "jerk limit of joint 'joint_0' is 0"),
        (WITH_JERK, np.nan, "jerk limit of joint 'joint_0' is not known"),
    ],
)
def test_joints_with_unknown_limits_are_named(limits, jerk, message):
    with pytest.raises(InputError, match=message):
        time_parametrise(LINE, limits, jerk=jerk)


def test_the_result_states_the_source_of_its_limits():
    limits = limits_of([1, 1], [2, 2], acceleration_source="default: the velocity limit reached in 0.5 s")
    assert time_parametrise(LINE, limits).limits_note == f"acceleration limits: {limits.acceleration_source}"
    assert "given by the caller" in time_parametrise(LINE, LIMITS).limits_note
    trajectory = time_parametrise(LINE, WITH_JERK, jerk="limits")
    assert trajectory.max_jerk() == pytest.approx([7.0, 3.5])
    assert "jerk limits: cell.yaml" in trajectory.limits_note
    assert "jerk limits: given by the caller" in time_parametrise(LINE, WITH_JERK, jerk=5).limits_note
    assert time_parametrise(LINE, WITH_JERK).interpolant == "cubic"


def test_only_paths_are_timed():
    for wrong, kind in ((time_parametrise(LINE, LIMITS), "Trajectory"), ([LINE], "list")):
        with pytest.raises(InputError, match=f"not a {kind}"):
            time_parametrise(wrong, LIMITS)


class Bare:
    """A curve of two cubic pieces with a corner between them, which names no corners."""

    joint_names = names(2)
    domain = (0.0, 2.0)
    start, end = np.zeros(2), np.array([1.0, 1.0])

    def bezier(self):
        control = [[[0, 0], [0.3, 0.1], [0.7, 0.1], [1, 0]], [[1, 0], [1.1, 0.3], [1.1, 0.7], [1, 1]]]
        return np.array([0.0, 1.0, 2.0]), np.array(control, float)

    def __call__(self, t):
        return Bezier(*self.bezier()).at(t)


@pytest.mark.parametrize("rise", [None, 0.1])
def test_any_curve_is_timed_and_stops_where_its_tangent_jumps(rise):
    trajectory = timed(Bare(), LIMITS, rise)
    assert_on_path(trajectory, Bare(), IMAGE_TOLERANCE)
    assert waypoints_at_rest(trajectory) == [[0, 0], [1, 0], [1, 1]]


# -- limits of jerk ----------------------------------------------------------------------------------------------------


def test_a_jerk_limit_that_does_not_bind_costs_next_to_nothing():
    s = np.linspace(0, 1, 8)[:, None]
    path = CubicPath.through(np.hstack([np.sin(3 * s), np.cos(2 * s)]), names(2), s[:, 0])
    limits = limits_of([1, 1], [4, 4])
    free = time_parametrise(path, limits).duration
    assert 0.995 * free < time_parametrise(path, limits, jerk=4e4).duration < 1.01 * free


def test_windows_cost_less_than_a_third_over_the_textbook():
    """A straight line that is not recognised as one: the average over a window against the double S."""
    limits = limits_of([1.0], [3.0])
    for length in (0.05, 0.3, 1.0):
        best = time_parametrise(JointPath([[0.0], [length]], names(1)), limits, jerk=15.0).duration
        bent = CubicPath.through(length * np.array([[0.0], [0.501], [1.0]]), names(1), [0, 0.5, 1])
        assert best * 0.99 <= time_parametrise(bent, limits, jerk=15.0).duration <= 1.3 * best


def test_a_rounded_corner_is_run_through_at_an_even_speed():
    corner = JointPath([[0, 0], [2, 0], [2, 2]], names(2))
    trajectory = time_parametrise(BlendedPath.rounded(corner, [0, 0.5, 0]), LIMITS, jerk=20.0)
    inside = (trajectory.q[:, 0] > 1.5 + 1e-9) & (trajectory.q[:, 1] < 0.5 - 1e-9)
    assert inside.sum() > 2
    assert np.linalg.norm(trajectory.velocities, axis=1)[inside].min() > 0.5
    assert trajectory.duration < time_parametrise(corner, LIMITS, jerk=20.0).duration


# -- motions that begin or end while moving ----------------------------------------------------------------------------


def slope(path, at):
    """The tangent at the start or at the end."""
    first, last = path.domain
    h = 1e-4 * (last - first)
    a, b = (first, first + h) if at == "start" else (last - h, last)
    knots, control = path.bezier()
    width = np.diff(knots)
    piece = control[0] if at == "start" else control[-1]
    tangent = (piece[1] - piece[0]) / width[0] if at == "start" else (piece[-1] - piece[-2]) / width[-1]
    assert tangent @ (path(b) - path(a)) > 0
    return tangent


@pytest.mark.parametrize("rise", [None, 0.2])
@pytest.mark.parametrize(("start", "end"), [(0.5, 0), (0, 0.7), (0.4, 0.8), (1.0, 1.0), (0.9, 0.1)])
def test_a_line_begins_and_ends_at_the_requested_velocities(start, end, rise):
    begin, finish = np.array([1.0, 0.5]) * start, np.array([1.0, 0.5]) * end
    trajectory = timed(LINE, LIMITS, rise, start_velocity=begin, end_velocity=finish)
    np.testing.assert_array_equal(trajectory.velocities[[0, -1]], [begin, finish])
    assert trajectory.duration <= timed(LINE, LIMITS, rise).duration


def test_the_time_from_speed_to_speed_is_that_of_the_textbook():
    up, down = (1 - 0.6) / 2, (1 - 0.2) / 2
    path = JointPath([[0.0], [2.0]], names(1))
    trajectory = time_parametrise(path, limits_of([1.0], [2.0]), start_velocity=[0.6], end_velocity=[0.2])
    assert trajectory.duration == pytest.approx(up + down + (2 - 0.8 * up - 0.6 * down), rel=1e-5)


def test_motions_that_meet_while_moving_are_joined():
    full, middle = JointPath([[0, 0], [4, 2]], names(2)), np.array([0.8, 0.4])
    for jerk in (None, 8.0):
        first = time_parametrise(LINE, LIMITS, jerk=jerk, end_velocity=middle)
        second = time_parametrise(JointPath([[2, 1], [4, 2]], names(2)), LIMITS, jerk=jerk, start_velocity=middle)
        joined = Trajectory.join(first, second)
        assert_within(joined, LIMITS, jerk)
        assert joined.duration >= time_parametrise(full, LIMITS, jerk=jerk).duration - 1e-6


SHARES = st.floats(0, 1)


@pytest.mark.slow
@examples(40)
@given(st.one_of(smooth_problems(), rounded_problems().map(lambda p: p[1:])), SHARES, SHARES, st.booleans())
def test_any_path_begins_and_ends_at_the_velocities_or_is_refused(problem, start, end, with_jerk):
    path, limits = problem
    velocities = {}
    for place, share in (("start", start), ("end", end)):
        tangent = slope(path, place)
        velocities[f"{place}_velocity"] = share * tangent * (limits.velocity / np.abs(tangent)).min()
    try:
        trajectory = timed(path, limits, 0.05 if with_jerk else None, **velocities)
    except TimingError as error:
        refused = str(error)
    else:
        refused = ""
    if refused:
        assert ("velocit" in refused, max(start, end) > 0) == (True, True)
        return
    np.testing.assert_array_equal(trajectory.velocities[[0, -1]], [*velocities.values()])
    assert_on_path(trajectory, path, IMAGE_TOLERANCE)


@pytest.mark.parametrize(("velocity", "message"), [([0.4], "must have"), ([np.nan, 0], "nan")])
@pytest.mark.parametrize("place", ["start_velocity", "end_velocity"])
def test_velocities_that_are_not_one_number_for_each_joint_are_refused(place, velocity, message):
    with pytest.raises(InputError, match=message) as caught:
        time_parametrise(LINE, LIMITS, **{place: velocity})
    assert place in str(caught.value)


@pytest.mark.parametrize("seed", range(12))
def test_a_velocity_is_accepted_if_it_is_along_the_tangent_and_within_its_limit(seed):
    """At both ends of paths that do not begin at the origin, with limits of any size."""
    rng = np.random.default_rng(seed)
    limits = limits_of(rng.uniform(0.2, 5.0, 3), rng.uniform(5.0, 20.0, 3))
    curve = CubicPath.through(np.cumsum(rng.uniform(-1, 1, (4, 3)), axis=0) + 5.0, names(3))
    for path, place in product((curve, JointPath(curve(np.linspace(*curve.domain, 2)), names(3))), ("start", "end")):
        tangent, key = slope(path, place), f"{place}_velocity"
        shares = limits.velocity / np.abs(tangent)
        inside = 0.3 * tangent * shares.min()
        trajectory = time_parametrise(path, limits, **{key: inside})
        np.testing.assert_allclose(trajectory.velocities[0 if place == "start" else -1], inside)
        fastest = rf"velocity limit {limits.velocity[shares.argmin()]:g} of joint 'joint_{shares.argmin()}'"
        refused = [(1.001 / 0.3 * inside, f"exceeds the {fastest}"), (-inside, ".*backward")]
        refused += [
            (inside + side * 1e-3 * np.abs(inside).max() * off, ".*not parallel to the path")
            for off, side in product(np.eye(3), (1, -1))
        ]
        for velocity, message in refused:
            with pytest.raises(InputError, match=f"{key} {message}"):
                time_parametrise(path, limits, **{key: velocity})


@pytest.mark.parametrize("jerk", [None, 50.0])
@pytest.mark.parametrize("make", [JointPath, CubicPath.through])
def test_a_velocity_that_cannot_be_braked_is_refused(make, jerk):
    with pytest.raises(TimingError, match="velocit"):
        time_parametrise(make([[0.0], [0.1]], names(1)), limits_of([1], [2]), jerk=jerk, start_velocity=[1.0])


def test_a_path_of_length_0_has_no_velocity():
    with pytest.raises(InputError, match="start_velocity"):
        time_parametrise(JointPath([[1.0], [1.0]], names(1)), limits_of([1], [1]), start_velocity=[0.1])
