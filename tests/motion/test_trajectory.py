import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pinproof import InputError
from pinproof.motion import Bezier, Curve, Trajectory

from ..examples import examples

NAMES = ("slide", "turn")
value = st.floats(-5, 5, allow_subnormal=False)


@st.composite
def trajectories(draw):
    m = draw(st.integers(2, 5))
    steps = draw(arrays(float, m - 1, elements=st.floats(0.05, 2)))
    q = draw(arrays(float, (m, 2), elements=value))
    return Trajectory(np.concatenate([[0.0], np.cumsum(steps)]), q, draw(arrays(float, (m, 2), elements=value)), NAMES)


@given(trajectories())
def test_a_trajectory_is_the_cubic_hermite_curve_through_its_points(trajectory):
    from scipy.interpolate import CubicHermiteSpline

    oracle = CubicHermiteSpline(trajectory.times, trajectory.q, trajectory.velocities)
    t = np.linspace(0, trajectory.duration, 60)
    np.testing.assert_allclose(trajectory(t), oracle(t), atol=1e-11)
    np.testing.assert_allclose(trajectory.velocity(t), oracle(t, 1), atol=1e-9)
    inside = np.setdiff1d(t, trajectory.times)  # accelerations jump at the points
    np.testing.assert_allclose(trajectory.acceleration(inside), oracle(inside, 2), atol=1e-7)
    assert isinstance(trajectory, Curve)
    np.testing.assert_array_equal(trajectory(t), Bezier(*trajectory.bezier()).at(t))


@given(trajectories())
def test_extremes_hold_for_dense_samples_and_are_reached(trajectory):
    t = np.linspace(0, trajectory.duration, 4001)
    step = trajectory.duration / 4000
    peak = np.abs(trajectory.velocity(t)).max(axis=0)
    assert (peak <= trajectory.max_velocity() + 1e-9).all()
    assert (peak >= trajectory.max_velocity() - trajectory.max_acceleration() * step - 1e-9).all()
    assert (np.abs(trajectory.acceleration(t)).max(axis=0) <= trajectory.max_acceleration() * (1 + 1e-9) + 1e-9).all()
    low, high = trajectory.range()
    samples = trajectory(t)
    assert (samples >= low - 1e-12).all()
    assert (samples <= high + 1e-12).all()
    slack = trajectory.max_velocity() * step + 1e-9
    assert (samples.min(axis=0) <= low + slack).all()
    assert (samples.max(axis=0) >= high - slack).all()


def rebuilt(trajectory, t):
    """q, v, a (n,) at t as ros2_control's joint_trajectory_controller finds them from the points of a message.

    It solves for the coefficients of the lowest polynomial in the time since the point before that has what both
    points state: positions and velocities, or accelerations too. Here by a linear system, not by its formulas.
    """
    times = trajectory.times
    i = min(int(np.searchsorted(times, t, side="right")) - 1, len(times) - 2)
    order = 2 if trajectory.accelerations is None else 3
    width = times[i + 1] - times[i]

    def row(at, k):  # the k-th derivative of 1, x, x^2, ... at x = at
        return [np.prod(np.arange(p - k + 1, p + 1)) * at ** (p - k) if p >= k else 0.0 for p in range(2 * order)]

    stated = [trajectory.q, trajectory.velocities, trajectory.accelerations][:order]
    left, right = ([values[j] for values in stated] for j in (i, i + 1))
    system = [row(at, k) for at in (0.0, width) for k in range(order)]
    coefficients = np.linalg.solve(system, np.array(left + right))
    return [np.array(row(t - times[i], k)) @ coefficients for k in range(3)]


@pytest.mark.slow
@given(trajectories(), st.booleans(), st.data())
def test_a_controller_rebuilds_the_same_curve_from_the_points(cubic, quintic, data):
    accelerations = data.draw(arrays(float, cubic.q.shape, elements=value)) if quintic else None
    trajectory = Trajectory(cubic.times, cubic.q, cubic.velocities, NAMES, accelerations=accelerations)
    assert trajectory.bezier()[1].shape[1] == (6 if quintic else 4)
    for t in np.setdiff1d(np.linspace(0, trajectory.duration, 23), trajectory.times):
        q, v, a = rebuilt(trajectory, t)
        np.testing.assert_allclose(trajectory(t), q, atol=1e-8)
        np.testing.assert_allclose(trajectory.velocity(t), v, atol=1e-7)
        np.testing.assert_allclose(trajectory.acceleration(t), a, atol=1e-6)


@st.composite
def quintics(draw):
    cubic = draw(trajectories())
    accelerations = draw(arrays(float, cubic.q.shape, elements=value))
    return Trajectory(cubic.times, cubic.q, cubic.velocities, NAMES, accelerations=accelerations)


@examples(50)
@given(quintics())
def test_extremes_of_quintics_hold_for_dense_samples_and_are_reached(trajectory):
    t = np.linspace(0, trajectory.duration, 4001)
    step = trajectory.duration / 4000
    bounds = [trajectory.max_velocity(), trajectory.max_acceleration(), trajectory.max_jerk()]
    samples = [np.abs(rate(t)).max(axis=0) for rate in (trajectory.velocity, trajectory.acceleration, trajectory.jerk)]
    for bound, seen in zip(bounds, samples, strict=True):
        assert (seen <= bound * (1 + 1e-9) + 1e-9).all()
    for bound, seen, rate in zip(bounds[:2], samples[:2], bounds[1:], strict=True):
        assert (seen >= bound - rate * step - 1e-9 * (1 + bound)).all()
    low, high = trajectory.range()
    assert (trajectory(t) >= low - 1e-12).all()
    assert (trajectory(t) <= high + 1e-12).all()


def test_jerk_is_the_slope_of_the_acceleration_and_infinite_for_what_moves_along_a_cubic():
    ends = [[0.0, 0], [1, 0]], np.zeros((2, 2))
    quintic = Trajectory([0, 1], *ends, NAMES, accelerations=np.zeros((2, 2)))
    np.testing.assert_allclose(quintic.max_jerk(), [60, 0])  # 10 u^3 - 15 u^4 + 6 u^5
    t = np.linspace(0.01, 0.99, 9)
    slope = (quintic.acceleration(t + 1e-5) - quintic.acceleration(t - 1e-5)) / 2e-5
    np.testing.assert_allclose(quintic.jerk(t), slope, atol=1e-6)
    np.testing.assert_array_equal(Trajectory([0, 1], *ends, NAMES).max_jerk(), [np.inf, 0])


def test_a_speed_peak_between_points_is_detected():
    trajectory = Trajectory([0, 1], [[0.0, 0], [1, 0]], np.zeros((2, 2)), NAMES)
    np.testing.assert_allclose(trajectory.max_velocity(), [1.5, 0])
    np.testing.assert_allclose(trajectory.max_acceleration(), [6, 0])


def test_times_are_integer_nanoseconds_from_the_start():
    trajectory = Trajectory([0, 0.1 + 1e-12, 1 / 3], np.zeros((3, 2)), np.zeros((3, 2)), NAMES)
    np.testing.assert_array_equal(trajectory.times, [0, 0.1, 0.333333333])


@given(st.integers(1, 2**50))
def test_every_count_of_nanoseconds_survives_as_seconds(count):
    times = Trajectory([0, count / 10**9], np.zeros((2, 1)), np.zeros((2, 1)), ["j"]).times
    assert round(times[1] * 10**9) == count
    assert times[1] == count / 10**9


def test_a_single_point_is_a_motion_of_no_duration():
    trajectory = Trajectory([0], [[1, 2]], [[0, 0]], NAMES)
    assert trajectory.duration == 0
    np.testing.assert_array_equal(trajectory(0), [1, 2])
    np.testing.assert_array_equal(trajectory.velocity(0), [0, 0])
    np.testing.assert_array_equal(trajectory.max_acceleration(), [0, 0])
    knots, control = trajectory.bezier()
    assert knots.tolist() == [0, 0]
    assert control.shape == (1, 4, 2)


@pytest.mark.parametrize("t", [-1e-9, 1 + 1e-9, np.nan])
def test_times_outside_the_trajectory_are_refused(t):
    trajectory = Trajectory([0, 1], np.zeros((2, 2)), np.zeros((2, 2)), NAMES)
    for call in (trajectory, trajectory.velocity, trajectory.acceleration):
        with pytest.raises(InputError, match="outside"):
            call(t)


@pytest.mark.parametrize(
    ("times", "q", "velocities", "message"),
    [
        ([0, 0], np.zeros((2, 2)), np.zeros((2, 2)), "increase"),
        ([0, 4e-10], np.zeros((2, 2)), np.zeros((2, 2)), "increase"),
        ([1, 2], np.zeros((2, 2)), np.zeros((2, 2)), "start at 0"),
        ([0, 1], np.zeros((2, 2)), np.full((2, 2), np.inf), "velocities holds inf"),
        ([0, 1], np.zeros((2, 2)), np.zeros((1, 2)), "velocities must have the shape"),
        ([0, 1e9], np.zeros((2, 2)), np.zeros((2, 2)), "nanoseconds"),
        ([0], np.zeros((1, 2)), np.ones((1, 2)), "at rest"),
        ([], np.zeros((0, 2)), np.zeros((0, 2)), "at least one"),
    ],
)
def test_an_invalid_motion_is_refused(times, q, velocities, message):
    with pytest.raises(InputError, match=message):
        Trajectory(times, q, velocities, NAMES)


@given(trajectories(), trajectories())
def test_joined_motions_run_one_after_the_other(first, second):
    second = Trajectory(
        second.times,
        second.q - second.q[0] + first.end,
        np.concatenate([first.velocities[-1:], second.velocities[1:]]),
        NAMES,
    )
    second = Trajectory(second.times, np.concatenate([[first.end], second.q[1:]]), second.velocities, NAMES, "b")
    joined = Trajectory.join(first, second)
    assert joined.duration == pytest.approx(first.duration + second.duration, abs=1e-12)
    assert joined.limits_note == "b"
    noted = Trajectory(first.times, first.q, first.velocities, NAMES, "a")
    assert Trajectory.join(noted, second).limits_note == "a; b"
    t = np.linspace(0, first.duration, 20)
    np.testing.assert_array_equal(joined(t)[:-1], first(t)[:-1])
    t = np.linspace(0, second.duration, 20)
    after = np.minimum(first.duration + t, joined.duration)
    np.testing.assert_allclose(joined(after), second(t), atol=1e-12)


def test_times_do_not_drift_however_many_motions_are_joined():
    part = Trajectory([0, 0.1], [[0, 0], [0, 0]], np.zeros((2, 2)), NAMES)
    assert Trajectory.join(*[part] * 1000).duration == 100.0


@examples(40)
@given(st.one_of(trajectories(), quintics()), st.sampled_from([1.0, 1.1, 1.5, np.pi, 20.0]))
def test_a_motion_slowed_down_keeps_its_image_and_lowers_its_rates(trajectory, factor):
    slow = trajectory.slowed(factor)
    assert slow.interpolant == trajectory.interpolant
    assert slow.duration == pytest.approx(factor * trajectory.duration, abs=2e-9)
    np.testing.assert_array_equal(slow.q[[0, -1]], trajectory.q[[0, -1]])
    t = np.linspace(0, trajectory.duration, 50)
    np.testing.assert_allclose(slow((t * factor).clip(0, slow.duration)), trajectory(t), atol=1e-6)
    for order, (mine, theirs) in enumerate(
        [(slow.max_velocity(), trajectory.max_velocity()), (slow.max_acceleration(), trajectory.max_acceleration())], 1
    ):
        np.testing.assert_allclose(mine * factor**order, theirs, rtol=1e-5, atol=1e-5)


def test_a_motion_is_not_hurried():
    with pytest.raises(InputError, match="1 or more"):
        Trajectory([0, 1], np.zeros((2, 2)), np.zeros((2, 2)), NAMES).slowed(0.5)


def test_motions_that_do_not_meet_are_not_joined():
    still = Trajectory([0, 1], np.zeros((2, 2)), np.zeros((2, 2)), NAMES)
    away = Trajectory([0, 1], np.ones((2, 2)), np.zeros((2, 2)), NAMES)
    moving = Trajectory([0, 1], np.zeros((2, 2)), [[0, 1], [0, 0]], NAMES)
    with pytest.raises(InputError, match="do not meet"):
        Trajectory.join(still, away)
    with pytest.raises(InputError, match=r"different velocities .* 'turn'"):
        Trajectory.join(still, moving)
    at_rest, pushed = (
        Trajectory([0, 1], np.zeros((2, 2)), np.zeros((2, 2)), NAMES, accelerations=[[0, a], [0, 0]]) for a in (0, 1)
    )
    assert Trajectory.join(at_rest, at_rest).accelerations.shape == (3, 2)
    with pytest.raises(InputError, match=r"different accelerations .* 'turn'"):
        Trajectory.join(at_rest, pushed)
    with pytest.raises(InputError, match="a cubic and a quintic"):
        Trajectory.join(still, at_rest)


@pytest.mark.parametrize("accelerations", [None, np.ones((2, 2))])
def test_pickled_trajectories_are_equal_and_still_locked(accelerations):
    trajectory = Trajectory([0, 1 / 3], [[0, 0], [1, 2]], np.ones((2, 2)), NAMES, "note", accelerations=accelerations)
    copy = pickle.loads(pickle.dumps(trajectory))
    assert copy.is_close(trajectory, 0)
    assert copy.limits_note == "note"
    assert not copy.q.flags.writeable
    assert copy.interpolant == trajectory.interpolant


@pytest.mark.parametrize("quintic", [False, True])
def test_a_rest_can_be_joined_with_a_motion_and_cut_out_again(quintic: bool) -> None:
    names, q = ("a", "b"), np.array([[0.0, 1.0], [0.5, 2.0]])
    still = np.zeros((2, 2))
    motion = Trajectory([0.0, 1.0], q, still, names, accelerations=still if quintic else None)
    waiting = Trajectory.at_rest(q[0], names, 0.25, quintic=quintic)
    assert (waiting.duration, len(waiting.times)) == (0.25, 2)
    whole = Trajectory.join(waiting, motion)
    assert whole.duration == 1.25
    assert whole.between(1, 2).is_close(motion)
    assert len(Trajectory.at_rest(q[0], names).times) == 1
    assert not waiting.is_close(motion)
