"""Trajectories: their curve, its exact extremes, joining, slowing, the motions of several arms, and plots."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicHermiteSpline

import pinproof as pp
from pinproof import InputError
from pinproof.motion import Bezier, Curve, JointPath, TimedColumns, Trajectory, merged, separate, synchronise
from pinproof.motion import time_parametrise as timing

from ..examples import examples

NAMES = ("slide", "turn")
STILL, ENDS = np.zeros((2, 2)), np.array([[0.0, 0], [1, 0]])
value = st.floats(-5, 5, allow_subnormal=False)


@st.composite
def cubics(draw):
    m = draw(st.integers(2, 5))
    steps = draw(arrays(float, m - 1, elements=st.floats(0.05, 2)))
    q = draw(arrays(float, (m, 2), elements=value))
    return Trajectory(np.concatenate([[0.0], np.cumsum(steps)]), q, draw(arrays(float, (m, 2), elements=value)), NAMES)


@st.composite
def quintics(draw):
    cubic = draw(cubics())
    accelerations = draw(arrays(float, cubic.q.shape, elements=value))
    return Trajectory(cubic.times, cubic.q, cubic.velocities, NAMES, accelerations=accelerations)


@given(cubics())
def test_a_trajectory_is_the_cubic_hermite_curve_through_its_points(trajectory):
    oracle = CubicHermiteSpline(trajectory.times, trajectory.q, trajectory.velocities)
    t = np.linspace(0, trajectory.duration, 60)
    np.testing.assert_allclose(trajectory(t), oracle(t), atol=1e-11)
    np.testing.assert_allclose(trajectory.velocity(t), oracle(t, 1), atol=1e-9)
    inside = np.setdiff1d(t, trajectory.times)  # accelerations jump at the points
    np.testing.assert_allclose(trajectory.acceleration(inside), oracle(inside, 2), atol=1e-7)
    assert isinstance(trajectory, Curve)
    np.testing.assert_array_equal(trajectory(t), Bezier(*trajectory.bezier()).at(t))


@examples(70)
@given(st.one_of(cubics(), quintics()))
def test_extremes_hold_for_dense_samples_and_are_reached(trajectory):
    t, step = np.linspace(0, trajectory.duration, 4001), trajectory.duration / 4000
    quintic = trajectory.interpolant == "quintic"
    bounds = [trajectory.max_velocity(), trajectory.max_acceleration(), *([trajectory.max_jerk()] if quintic else [])]
    rates = (trajectory.velocity, trajectory.acceleration, trajectory.jerk)[: len(bounds)]
    samples = [np.abs(rate(t)).max(axis=0) for rate in rates]
    for bound, seen in zip(bounds, samples, strict=True):
        assert (seen <= bound * (1 + 1e-9) + 1e-9).all()
    for bound, seen, rate in zip(bounds[:-1], samples[:-1], bounds[1:], strict=True):
        assert (seen >= bound - rate * step - 1e-9 * (1 + bound)).all()
    (low, high), q, slack = trajectory.range(), trajectory(t), bounds[0] * step + 1e-9
    for seen, bound, sign in ((q.min(axis=0), low, 1), (q.max(axis=0), high, -1)):
        assert (sign * (seen - bound) >= -1e-12).all()
        assert (sign * (seen - bound) <= slack).all()


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
@examples(50)
@given(st.one_of(cubics(), quintics()))
def test_a_controller_rebuilds_the_same_curve_from_the_points(trajectory):
    assert trajectory.bezier()[1].shape[1] == (6 if trajectory.interpolant == "quintic" else 4)
    for t in np.setdiff1d(np.linspace(0, trajectory.duration, 23), trajectory.times):
        found = trajectory(t), trajectory.velocity(t), trajectory.acceleration(t)
        for mine, theirs, tolerance in zip(found, rebuilt(trajectory, t), (1e-8, 1e-7, 1e-6), strict=True):
            np.testing.assert_allclose(mine, theirs, atol=tolerance)


def test_rates_between_points_and_the_jerk_that_is_infinite_for_what_moves_along_a_cubic():
    quintic, cubic = Trajectory([0, 1], ENDS, STILL, NAMES, accelerations=STILL), Trajectory([0, 1], ENDS, STILL, NAMES)
    np.testing.assert_allclose(quintic.max_jerk(), [60, 0])  # 10 u^3 - 15 u^4 + 6 u^5
    t = np.linspace(0.01, 0.99, 9)
    slope = (quintic.acceleration(t + 1e-5) - quintic.acceleration(t - 1e-5)) / 2e-5
    np.testing.assert_allclose(quintic.jerk(t), slope, atol=1e-6)
    np.testing.assert_array_equal(cubic.max_jerk(), [np.inf, 0])
    np.testing.assert_allclose(cubic.max_velocity(), [1.5, 0])
    np.testing.assert_allclose(cubic.max_acceleration(), [6, 0])


@given(st.integers(1, 2**50))
def test_times_are_integer_nanoseconds_from_the_start_and_every_count_survives(count):
    times = Trajectory([0, count / 10**9], np.zeros((2, 1)), np.zeros((2, 1)), ["j"]).times
    assert round(times[1] * 10**9) == count
    assert times[1] == count / 10**9
    rounded = Trajectory([0, 0.1 + 1e-12, 1 / 3], np.zeros((3, 2)), np.zeros((3, 2)), NAMES)
    np.testing.assert_array_equal(rounded.times, [0, 0.1, 0.333333333])


def test_a_single_point_is_a_motion_of_no_duration():
    trajectory = Trajectory([0], [[1, 2]], [[0, 0]], NAMES)
    assert trajectory.duration == 0
    np.testing.assert_array_equal(trajectory(0), [1, 2])
    for zero in (trajectory.velocity(0), trajectory.max_acceleration()):
        np.testing.assert_array_equal(zero, [0, 0])
    knots, control = trajectory.bezier()
    assert (knots.tolist(), control.shape) == ([0, 0], (1, 4, 2))


@pytest.mark.parametrize("t", [-1e-9, 1 + 1e-9, np.nan])
def test_times_outside_the_trajectory_are_refused(t):
    trajectory = Trajectory([0, 1], STILL, STILL, NAMES)
    for call in (trajectory, trajectory.velocity, trajectory.acceleration):
        with pytest.raises(InputError, match="outside"):
            call(t)


@examples(50)
@given(cubics(), cubics())
def test_joined_motions_run_one_after_the_other(first, second):
    q = np.concatenate([[first.end], (second.q - second.q[0] + first.end)[1:]])
    velocities = np.concatenate([first.velocities[-1:], second.velocities[1:]])
    second = Trajectory(second.times, q, velocities, NAMES, "b")
    joined = Trajectory.join(first, second)
    assert joined.duration == pytest.approx(first.duration + second.duration, abs=1e-12)
    assert joined.limits_note == "b"
    noted = Trajectory(first.times, first.q, first.velocities, NAMES, "a")
    assert Trajectory.join(noted, second).limits_note == "a; b"
    t = np.linspace(0, first.duration, 20)
    np.testing.assert_array_equal(joined(t)[:-1], first(t)[:-1])
    t = np.linspace(0, second.duration, 20)
    np.testing.assert_allclose(joined(np.minimum(first.duration + t, joined.duration)), second(t), atol=1e-12)


def test_times_do_not_drift_however_many_motions_are_joined():
    assert Trajectory.join(*[Trajectory([0, 0.1], STILL, STILL, NAMES)] * 1000).duration == 100.0


@examples(40)
@given(st.one_of(cubics(), quintics()), st.sampled_from([1.0, 1.1, 1.5, np.pi, 20.0]))
def test_a_motion_slowed_down_keeps_its_image_and_lowers_its_rates(trajectory, factor):
    slow = trajectory.slowed(factor)
    assert slow.interpolant == trajectory.interpolant
    assert slow.duration == pytest.approx(factor * trajectory.duration, abs=2e-9)
    np.testing.assert_array_equal(slow.q[[0, -1]], trajectory.q[[0, -1]])
    t = np.linspace(0, trajectory.duration, 50)
    np.testing.assert_allclose(slow((t * factor).clip(0, slow.duration)), trajectory(t), atol=1e-6)
    for order, rate in ((1, Trajectory.max_velocity), (2, Trajectory.max_acceleration)):
        np.testing.assert_allclose(rate(slow) * factor**order, rate(trajectory), rtol=1e-5, atol=1e-5)


def pushed(acceleration):
    return Trajectory([0, 1], STILL, STILL, NAMES, accelerations=[[0, acceleration], [0, 0]])


REST = Trajectory([0, 1], STILL, STILL, NAMES)


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (Trajectory, ([0, 0], STILL, STILL, NAMES), "increase"),
        (Trajectory, ([0, 4e-10], STILL, STILL, NAMES), "increase"),
        (Trajectory, ([1, 2], STILL, STILL, NAMES), "start at 0"),
        (Trajectory, ([0, 1], STILL, np.full((2, 2), np.inf), NAMES), "velocities holds inf"),
        (Trajectory, ([0, 1], STILL, np.zeros((1, 2)), NAMES), "velocities must have the shape"),
        (Trajectory, ([0, 1e9], STILL, STILL, NAMES), "nanoseconds"),
        (Trajectory, ([0], STILL[:1], np.ones((1, 2)), NAMES), "at rest"),
        (Trajectory, ([], STILL[:0], STILL[:0], NAMES), "at least one"),
        (REST.slowed, (0.5,), "1 or more"),
        (Trajectory.join, (REST, Trajectory([0, 1], np.ones((2, 2)), STILL, NAMES)), "do not meet"),
        (Trajectory.join, (REST, Trajectory([0, 1], STILL, [[0, 1], [0, 0]], NAMES)), "different velocities .* 'turn'"),
        (Trajectory.join, (pushed(0), pushed(1)), "different accelerations .* 'turn'"),
        (Trajectory.join, (REST, pushed(0)), "a cubic and a quintic"),
    ],
)
def test_an_invalid_motion_is_refused(make, arguments, message):
    with pytest.raises(InputError, match=message):
        make(*arguments)
    assert Trajectory.join(pushed(0), pushed(0)).accelerations.shape == (3, 2)


@pytest.mark.parametrize("accelerations", [None, np.ones((2, 2))])
def test_pickled_trajectories_are_equal_and_still_locked(accelerations):
    trajectory = Trajectory([0, 1 / 3], [[0, 0], [1, 2]], np.ones((2, 2)), NAMES, "note", accelerations=accelerations)
    copy = pickle.loads(pickle.dumps(trajectory))
    assert copy.is_close(trajectory, 0)
    assert (copy.limits_note, copy.interpolant) == ("note", trajectory.interpolant)
    assert not copy.q.flags.writeable


@pytest.mark.parametrize("quintic", [False, True])
def test_a_rest_can_be_joined_with_a_motion_and_cut_out_again(quintic):
    q = np.array([[0.0, 1.0], [0.5, 2.0]])
    motion = Trajectory([0.0, 1.0], q, STILL, NAMES, accelerations=STILL if quintic else None)
    waiting = Trajectory.at_rest(q[0], NAMES, 0.25, quintic=quintic)
    assert (waiting.duration, len(waiting.times)) == (0.25, 2)
    whole = Trajectory.join(waiting, motion)
    assert whole.duration == 1.25
    assert whole.between(1, 2).is_close(motion)
    assert len(Trajectory.at_rest(q[0], NAMES).times) == 1
    assert not waiting.is_close(motion)


# -- the motion of a joint group as one trajectory for each arm, and back ----------------------------------------------


ARM = pp.load_robot("ur5").arm()


@pytest.fixture(scope="module")
def cell():
    return pp.assemble({"a": (ARM, np.eye(4)), "b": (ARM, pp.pose(xyz=(1.5, 0, 0)))})


def timed(names, start, end, *, jerk=None):
    n = len(names)
    limits = pp.JointLimits(np.full(n, -6.0), np.full(n, 6.0), np.full(n, 1.0), np.full(n, 2.0))
    return timing(JointPath([np.full(n, start), np.full(n, end)], names), limits, jerk=jerk)


@pytest.mark.parametrize("jerk", [None, 20.0])
def test_separated_trajectories_are_combined_to_the_same_motion(cell, tmp_path, jerk):
    whole = timed(cell.joint_names, 0.1, 0.7, jerk=jerk)
    parts = separate(whole, cell)
    assert parts["b"].joint_names == ARM.joint_names
    for name, part in parts.items():
        part.save(tmp_path / f"{name}.json")
    loaded = {name: Trajectory.load(tmp_path / f"{name}.json") for name in parts}
    assert synchronise(loaded, cell).digest() == whole.digest()


@pytest.mark.parametrize("jerk", [None, 20.0])
def test_arms_with_other_clocks_keep_their_motion_and_wait(cell, jerk):
    names = ARM.joint_names
    parts = {"a": timed(names, 0.0, 0.9, jerk=jerk), "b": timed(names, 0.2, 0.3, jerk=jerk)}
    whole = synchronise(parts, cell, wait=True)
    t = np.linspace(0.0, whole.duration, 200)
    for name, part in parts.items():
        assert np.allclose(whole(t)[:, cell.indices(name)], part(np.minimum(t, part.duration)), atol=1e-12)
    with pytest.raises(InputError, match="different durations"):
        synchronise(parts, cell)


def test_arm_that_is_missing_or_moves_at_its_end_is_refused(cell):
    names = ARM.joint_names
    moving = Trajectory([0.0, 0.1], np.zeros((2, 6)), np.array([np.zeros(6), np.ones(6)]), names)
    longer = timed(names, 0.0, 0.9)
    for parts, error, message in (
        ({"a": longer}, InputError, "arms b"),
        ({"b": longer}, InputError, "arms a"),
        ({"a": longer, "b": moving}, InputError, "'b' moves"),
        ({"a": longer, "c": longer}, pp.UnknownNameError, "unknown arm 'c'"),
    ):
        with pytest.raises(error, match=message):
            synchronise(parts, cell, wait=parts.get("b") is moving)


def test_group_with_a_shared_joint_is_not_separated():
    group = pp.load_robot("tiago_dual_left").arms("left", "right", base="torso_fixed_link")
    with pytest.raises(InputError, match="torso_lift_joint"):
        separate(timed(group.joint_names, 0.0, 0.1), group)


def test_quintic_and_a_cubic_with_jumping_acceleration_are_not_combined():
    quintic = Trajectory([0.0, 1.0], [[0.0], [1.0]], np.zeros((2, 1)), ["a"], accelerations=np.zeros((2, 1)))
    jumping = Trajectory([0.0, 0.5, 1.0], [[0.0], [1.0], [1.5]], np.zeros((3, 1)), ["b"])
    parts = [TimedColumns("x", quintic, [0], np.array([0])), TimedColumns("y", jumping, [0], np.array([1]))]
    with pytest.raises(InputError, match="jump"):
        merged(parts, ("a", "b"))


# -- plots: the drawn curves and limits are those of the motion --------------------------------------------------------

LIMITS = SimpleNamespace(velocity=np.array([1.0, 2.0]), acceleration=np.array([3.0, 4.0]), upper=[2.0, np.inf])


class Sum:
    """A limit of the sum of the velocities."""

    name = "sum"

    def coefficients(self, q, slope, curvature):
        total = slope.sum(axis=1, keepdims=True)
        return 0 * total, total, 0 * total, np.full_like(total, 5.0)

    def excess(self, trajectory):
        return np.ones(len(trajectory.times) - 1)


@pytest.fixture(scope="module")
def drawn():
    return timing(JointPath([[0.0, 0.0], [1.0, -1.0]], ("a", "b")), LIMITS, jerk=20.0)


def test_each_panel_shows_each_joint_and_its_limits(drawn):
    panels = drawn.plot(LIMITS, jerk=20.0).axes
    assert len(panels) == 4
    velocity = panels[1].lines
    levels = {float(line.get_ydata()[0]) for line in velocity if line.get_linestyle() == "--"}
    assert levels == {-1.0, 1.0, -2.0, 2.0}
    times, shown = velocity[0].get_data()
    assert np.abs(shown - drawn.velocity(times)[:, 0]).max() < 1e-9
    assert np.abs(panels[3].lines[0].get_ydata()).max() == pytest.approx(drawn.max_jerk()[0])
    with_sum = drawn.plot(rate_limits=[Sum()]).axes
    assert (len(with_sum), with_sum[4].get_ylabel()) == (5, "sum")


def test_a_notebook_shows_the_picture(drawn):
    from IPython.core.formatters import DisplayFormatter

    shown, _ = DisplayFormatter().format(drawn.plot(LIMITS))
    assert shown["image/png"].startswith(b"\x89PNG")
    assert pickle.loads(pickle.dumps(drawn.plot())).axes


def test_plots_with_limits_of_another_length_are_refused(drawn):
    with pytest.raises(InputError, match="velocity"):
        drawn.plot(SimpleNamespace(velocity=np.ones(3), acceleration=np.ones(2)))
    with pytest.raises(InputError, match="jerk"):
        drawn.plot(LIMITS, jerk=-1.0)
