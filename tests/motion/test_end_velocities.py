"""Motions that begin or end while moving."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof import InputError
from pinproof.errors import TimingError
from pinproof.motion import CubicPath, JointPath, Trajectory, time_parametrise
from pinproof.motion.timing import IMAGE_TOLERANCE

from ..examples import examples
from .timing_problems import assert_on_path, assert_within, limits_of, names, rounded_problems, smooth_problems

LIMITS = limits_of([1, 1], [2, 2])
LINE = JointPath([[0, 0], [2, 1]], names(2))
shares = st.floats(0, 1)


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


@pytest.mark.parametrize("jerk", [None, 10.0])
@pytest.mark.parametrize(("start", "end"), [(0.5, 0), (0, 0.7), (0.4, 0.8), (1.0, 1.0), (0.9, 0.1)])
def test_a_line_begins_and_ends_at_the_requested_velocities(start, end, jerk):
    begin, finish = np.array([1.0, 0.5]) * start, np.array([1.0, 0.5]) * end
    trajectory = time_parametrise(LINE, LIMITS, jerk=jerk, start_velocity=begin, end_velocity=finish)
    assert_within(trajectory, LIMITS, jerk)
    np.testing.assert_array_equal(trajectory.velocities[[0, -1]], [begin, finish])
    np.testing.assert_array_equal(trajectory.q[[0, -1]], LINE.q)
    assert trajectory.duration <= time_parametrise(LINE, LIMITS, jerk=jerk).duration


def test_the_time_from_speed_to_speed_is_that_of_the_textbook():
    path = JointPath([[0.0], [2.0]], names(1))
    limits = limits_of([1.0], [2.0])
    request = {"start_velocity": [0.6], "end_velocity": [0.2]}
    up, down = (1 - 0.6) / 2, (1 - 0.2) / 2
    expected = up + down + (2 - 0.8 * up - 0.6 * down)
    assert time_parametrise(path, limits, **request).duration == pytest.approx(expected, rel=1e-5)


def test_motions_that_meet_while_moving_are_joined():
    full = JointPath([[0, 0], [4, 2]], names(2))
    middle = np.array([0.8, 0.4])
    for jerk in (None, 8.0):
        first = time_parametrise(LINE, LIMITS, jerk=jerk, end_velocity=middle)
        second = time_parametrise(JointPath([[2, 1], [4, 2]], names(2)), LIMITS, jerk=jerk, start_velocity=middle)
        joined = Trajectory.join(first, second)
        assert_within(joined, LIMITS, jerk)
        assert joined.duration >= time_parametrise(full, LIMITS, jerk=jerk).duration - 1e-6


@pytest.mark.slow
@examples(40)
@given(st.one_of(smooth_problems(), rounded_problems().map(lambda p: p[1:])), shares, shares, st.booleans())
def test_any_path_begins_and_ends_at_the_velocities_or_is_refused(problem, start, end, with_jerk):
    path, limits = problem
    velocities = []
    for place, share in (("start", start), ("end", end)):
        tangent = slope(path, place)
        velocities.append(share * tangent * (limits.velocity / np.abs(tangent)).min())
    jerk = limits.acceleration * 20 if with_jerk else None
    try:
        trajectory = time_parametrise(path, limits, jerk=jerk, start_velocity=velocities[0], end_velocity=velocities[1])
    except TimingError as error:
        expected = str(error)
    else:
        expected = ""
    if expected:
        assert "velocit" in expected
        assert max(start, end) > 0
        return
    assert_within(trajectory, limits, jerk)
    np.testing.assert_array_equal(trajectory.velocities[[0, -1]], velocities)
    np.testing.assert_array_equal(trajectory.start, path.start)
    np.testing.assert_array_equal(trajectory.end, path.end)
    assert_on_path(trajectory, path, IMAGE_TOLERANCE)


@pytest.mark.parametrize(
    ("velocity", "message"),
    [
        ([0.5, 0.3], "path"),
        ([-0.4, -0.2], "backward"),
        ([1.2, 0.6], "velocity limit 1 of joint 'joint_0'"),
        ([0.4], "must have"),
        ([np.nan, 0], "nan"),
    ],
)
@pytest.mark.parametrize("place", ["start_velocity", "end_velocity"])
def test_velocities_that_would_leave_the_path_are_refused(place, velocity, message):
    with pytest.raises(InputError, match=message) as caught:
        time_parametrise(LINE, LIMITS, **{place: velocity})
    assert place in str(caught.value)


@pytest.mark.parametrize("jerk", [None, 50.0])
@pytest.mark.parametrize("make", [JointPath, CubicPath.through])
def test_a_velocity_that_cannot_be_braked_is_refused(make, jerk):
    path = make([[0.0], [0.1]], names(1))
    with pytest.raises(TimingError, match="velocit"):
        time_parametrise(path, limits_of([1], [2]), jerk=jerk, start_velocity=[1.0])


def test_a_path_of_length_0_has_no_velocity():
    with pytest.raises(InputError, match="start_velocity"):
        time_parametrise(JointPath([[1.0], [1.0]], names(1)), limits_of([1], [1]), start_velocity=[0.1])


@pytest.mark.parametrize("seed", range(20))
def test_a_velocity_is_accepted_if_it_is_along_the_tangent_and_within_its_limit(seed):
    """At both ends of paths that do not begin at the origin, with limits of any size."""
    rng = np.random.default_rng(seed)
    limits = limits_of(rng.uniform(0.2, 5.0, 3), rng.uniform(5.0, 20.0, 3))
    curve = CubicPath.through(np.cumsum(rng.uniform(-1, 1, (4, 3)), axis=0) + 5.0, names(3))
    for path, place in product((curve, JointPath(curve(np.linspace(*curve.domain, 2)), names(3))), ("start", "end")):
        tangent = slope(path, place)
        fastest = tangent * (limits.velocity / np.abs(tangent)).min()
        key = f"{place}_velocity"
        inside = 0.3 * fastest
        trajectory = time_parametrise(path, limits, **{key: inside})
        np.testing.assert_allclose(trajectory.velocities[0 if place == "start" else -1], inside)
        with pytest.raises(InputError, match=f"{key} exceeds the velocity limit"):
            time_parametrise(path, limits, **{key: 1.001 * fastest})
        with pytest.raises(InputError, match=f"{key} .*backward"):
            time_parametrise(path, limits, **{key: -inside})
        for off, side in product(np.eye(3), (1, -1)):
            with pytest.raises(InputError, match=f"{key} .*not parallel"):
                time_parametrise(path, limits, **{key: inside + side * 1e-3 * np.abs(inside).max() * off})
