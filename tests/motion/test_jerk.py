"""Timing with limits of jerk: quintics whose exact extremes hold them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof import InputError, JointLimits
from pinproof.motion import BlendedPath, CubicPath, JointPath, time_parametrise
from pinproof.motion.timing import IMAGE_TOLERANCE

from ..examples import examples
from .timing_problems import (
    assert_on_path,
    assert_within,
    limits_of,
    names,
    problems,
    rounded_problems,
    smooth_problems,
)

rise_times = st.sampled_from([0.01, 0.1, 1.0])  # seconds from no acceleration to the limit


def at_rest(trajectory):
    return not (trajectory.velocities[[0, -1]].any() or trajectory.accelerations[[0, -1]].any())


@pytest.mark.slow
@examples(40)
@given(problems(size=st.just(1.0)), rise_times)
def test_straight_paths_keep_their_jerk_limits(problem, rise):
    path, limits = problem
    jerk = limits.acceleration / rise
    trajectory = time_parametrise(path, limits, jerk=jerk)
    assert_within(trajectory, limits, jerk)
    assert at_rest(trajectory)
    np.testing.assert_array_equal(trajectory.start, path.start)
    np.testing.assert_array_equal(trajectory.end, path.end)
    assert_on_path(trajectory, path, 1e-12)


@pytest.mark.slow
@examples(25)
@given(rounded_problems(), rise_times)
def test_rounded_paths_keep_their_jerk_limits(problem, rise):
    _, path, limits = problem
    jerk = limits.acceleration / rise
    trajectory = time_parametrise(path, limits, jerk=jerk)
    assert_within(trajectory, limits, jerk)
    assert at_rest(trajectory)
    assert_on_path(trajectory, path, IMAGE_TOLERANCE)


@pytest.mark.slow
@examples(15)
@given(smooth_problems(), st.sampled_from([0.02, 0.3]))
def test_smooth_paths_keep_their_jerk_limits(problem, rise):
    path, limits = problem
    jerk = limits.acceleration / rise
    trajectory = time_parametrise(path, limits, jerk=jerk)
    assert_within(trajectory, limits, jerk)
    assert at_rest(trajectory)
    assert_on_path(trajectory, path, IMAGE_TOLERANCE)


@pytest.mark.parametrize(
    ("length", "seconds"),
    [
        # V = 1, A = 2, J = 8 in turn: with a cruise; up to A without one; neither
        (3.0, 3.0 + 0.5 + 0.25),
        (0.5, 2 * (0.25 + (0.25**2 / 4 + 0.5 / 2) ** 0.5 - 0.125)),
        (0.0625, 4 * (0.0625 / 16) ** (1 / 3)),
    ],
)
def test_a_straight_stretch_takes_the_time_of_the_textbook(length, seconds):
    path = JointPath([[0.0, 0], [length, -length / 2]], names(2))
    trajectory = time_parametrise(path, limits_of([1, 9], [2, 9]), jerk=[8, 90])
    assert trajectory.duration == pytest.approx(seconds, rel=1e-6)
    assert len(trajectory.times) <= 8


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
    path = BlendedPath.rounded(corner, [0, 0.5, 0])
    trajectory = time_parametrise(path, limits_of([1, 1], [2, 2]), jerk=20.0)
    speed = np.linalg.norm(trajectory.velocities, axis=1)
    inside = (trajectory.q[:, 0] > 1.5 + 1e-9) & (trajectory.q[:, 1] < 0.5 - 1e-9)
    assert inside.sum() > 2
    assert speed[inside].min() > 0.5
    assert trajectory.duration < time_parametrise(corner, limits_of([1, 1], [2, 2]), jerk=20.0).duration


def test_jerk_limits_come_from_the_limits_or_the_caller_and_are_noted():
    path = JointPath([[0.0], [1.0]], names(1))
    with_jerk = limits_of([1], [2], jerk=np.array([7.0]), jerk_source="cell.yaml")
    trajectory = time_parametrise(path, with_jerk, jerk="limits")
    assert trajectory.max_jerk() == pytest.approx([7.0])
    assert "jerk limits: cell.yaml" in trajectory.limits_note
    assert "jerk limits: given by the caller" in time_parametrise(path, with_jerk, jerk=5).limits_note
    assert time_parametrise(path, with_jerk).interpolant == "cubic"
    for limits, jerk, message in [
        (limits_of([1], [2]), "limits", "hold no jerk"),
        (JointLimits(-np.ones(1), np.ones(1), np.ones(1)), "limits", "hold no jerk"),
        (with_jerk, "some", "'limits'"),
        (with_jerk, [1.0, 2.0], "limits.jerk must have the shape"),
        (with_jerk, 0.0, "jerk limit of joint 'joint_0' is 0"),
        (with_jerk, np.nan, "jerk limit of joint 'joint_0' is not known"),
    ]:
        with pytest.raises(InputError, match=message):
            time_parametrise(path, limits, jerk=jerk)


def test_zero_and_tiny_motions_take_almost_no_time():
    limits = limits_of([1, 1], [1, 1])
    still = time_parametrise(JointPath([[1, 2], [1, 2]], names(2)), limits, jerk=5.0)
    assert (still.duration, still.interpolant) == (0, "quintic")
    for gap in (1e-6, 1e-9, 1e-13):
        trajectory = time_parametrise(JointPath([[1, 2], [1 + gap, 2]], names(2)), limits, jerk=5.0)
        assert_within(trajectory, limits, 5.0)
        assert trajectory.duration < 0.1
