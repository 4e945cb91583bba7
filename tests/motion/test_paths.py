import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicSpline

from pinproof import InputError
from pinproof.motion import Bezier, CubicPath, Curve, JointPath, refuse_broken

from ..examples import examples

NAMES = ("shoulder", "elbow")
CORNER = JointPath([[0, 0], [3, 4], [3, 5]], NAMES)


@pytest.mark.parametrize("curve", [CORNER, CubicPath.through(CORNER.q, NAMES), JointPath([[1, 2]], NAMES)])
def test_paths_are_curves_whose_pieces_are_what_is_evaluated(curve):
    assert isinstance(curve, Curve)
    knots, control = curve.bezier()
    assert (knots[0], knots[-1]) == curve.domain
    t = np.linspace(*curve.domain, 17)
    np.testing.assert_array_equal(curve(t), Bezier(knots, control).at(t))
    np.testing.assert_array_equal(curve(t[0]), curve.start)
    np.testing.assert_array_equal(curve(t[-1]), curve.end)


@pytest.mark.parametrize("path", [JointPath([[1, 2]], NAMES), CubicPath([[1, 2]], [[0, 0]], [3], NAMES)])
def test_a_single_configuration_has_one_piece(path):
    knots, control = path.bezier()
    assert knots.shape == (2,)
    assert (control == [1, 2]).all()
    assert len(control) == 1
    np.testing.assert_array_equal(path(path.domain[0]), [1, 2])


def test_a_joint_path_runs_over_its_waypoints_indices():
    np.testing.assert_allclose(CORNER(0.5), [1.5, 2])
    np.testing.assert_array_equal(CORNER([0, 1, 2]), CORNER.q)
    assert CORNER.domain == (0, 2)
    assert CORNER.length == pytest.approx(6)


def test_reversing_a_joint_path_reverses_its_waypoints():
    np.testing.assert_array_equal(CORNER.reversed().q, CORNER.q[::-1])


def test_joined_paths_share_the_point_where_they_meet():
    joined = CORNER + JointPath([[3, 5], [0, 0]], NAMES)
    np.testing.assert_array_equal(joined.q, [[0, 0], [3, 4], [3, 5], [0, 0]])
    assert JointPath.join(CORNER).is_close(CORNER, 0)


def test_ends_that_differ_by_rounding_are_both_kept():
    assert len(CORNER + JointPath([[3, 5 + 1e-15], [0, 0]], NAMES)) == 5


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (JointPath([[3, 5.1], [0, 0]], NAMES), "joint 'elbow' ends at 5.0 .* 5.1"),
        (JointPath([[3, 5], [0, 0]], ("elbow", "shoulder")), "different joints"),
    ],
)
def test_paths_that_do_not_meet_are_not_joined(other, message):
    with pytest.raises(InputError, match=message):
        JointPath.join(CORNER, other)


@pytest.mark.parametrize(
    ("q", "names", "message"),
    [
        ([[0, np.nan]], NAMES, "nan"),
        ([0, 1], NAMES, "shape"),
        (np.zeros((0, 2)), NAMES, "at least one"),
        ([[0, 0, 0]], NAMES, "shape"),
        ([[0, 0]], ("a", "a"), "twice"),
        ([[0, 0]], "ab", "sequence"),
        ([[0, 0]], ("a", ""), "non-empty"),
        ([[]], (), "empty"),
    ],
)
def test_an_invalid_path_is_refused(q, names, message):
    with pytest.raises(InputError, match=message):
        JointPath(q, names)


def test_paths_copy_what_they_are_given_and_lock_it():
    q = np.zeros((2, 2))
    path = JointPath(q, list(NAMES))
    q[0] = 7
    assert not path.q.any()
    assert path.joint_names == NAMES
    for array in (path.q, path.start, *path.bezier(), *CubicPath.through(CORNER.q, NAMES).bezier()):
        assert not array.flags.writeable


@pytest.mark.parametrize("path", [CORNER, CubicPath.through(CORNER.q, NAMES)])
def test_pickled_paths_are_equal_and_still_locked(path):
    copy = pickle.loads(pickle.dumps(path))
    assert copy.is_close(path, 0)
    assert not copy.q.flags.writeable


def test_is_close_compares_joints_shape_and_values():
    assert CORNER.is_close(JointPath(CORNER.q + 1e-10, NAMES))
    assert not CORNER.is_close(JointPath(CORNER.q + 1e-8, NAMES))
    assert not CORNER.is_close(JointPath(CORNER.q, ("a", "b")))
    assert not CORNER.is_close(JointPath(CORNER.q[:2], NAMES))


@given(arrays(float, (5, 2), elements=st.floats(-3, 3)))
def test_a_cubic_path_has_the_points_and_tangents_it_was_given(values):
    knots = np.array([0.0, 0.4, 1.0, 1.5, 2.5])
    path = CubicPath(values, values[::-1], knots, NAMES)
    np.testing.assert_array_equal(path(knots), values)
    slopes = path.derivative(1).control
    np.testing.assert_allclose(slopes[:, 0], values[::-1][:-1], atol=1e-13)
    np.testing.assert_allclose(slopes[:, -1], values[::-1][1:], atol=1e-13)  # the same from both sides: C1


def test_through_reproduces_a_cubic():
    s = np.array([0.0, 0.3, 0.5, 1.1, 2.0])

    def cubic(t):
        return np.stack([t**3 - t, 2 * t**2 + 1], axis=1)

    path = CubicPath.through(cubic(s), NAMES, s)
    t = np.linspace(0, 2, 50)
    np.testing.assert_allclose(path(t), cubic(t), atol=1e-13)


def test_through_without_knots_runs_over_the_chord_length():
    np.testing.assert_allclose(CubicPath.through(CORNER.q, NAMES).knots, [0, 5, 6])


def test_through_two_points_is_straight_and_through_one_is_that_one():
    line = CubicPath.through(CORNER.q[:2], NAMES, [0, 1])
    np.testing.assert_allclose(line(0.25), [0.75, 1])
    assert CubicPath.through(CORNER.q[:1], NAMES).domain == (0, 0)


def test_a_reversed_cubic_path_has_the_same_image():
    path = CubicPath.through([[0, 0], [1, 2], [3, 1], [4, 4]], NAMES, [1, 2, 4, 4.5])
    t = np.linspace(1, 4.5, 40)
    np.testing.assert_allclose(path.reversed()(5.5 - t), path(t), atol=1e-14)


def test_equal_neighbours_need_knots():
    with pytest.raises(InputError, match="1 and 2 are equal"):
        CubicPath.through([[0, 0], [1, 1], [1, 1]], NAMES)


@pytest.mark.parametrize("knots", [[0, 1, 1], [0, 2, 1], [0, 1]])
def test_knots_must_increase_and_be_as_many_as_points(knots):
    with pytest.raises(InputError, match="knots"):
        CubicPath(CORNER.q, CORNER.q, knots, NAMES)


@examples(60)
@given(count=st.integers(2, 9), seed=st.integers(0, 2**32 - 1))
def test_the_spline_is_that_of_scipy(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    knots, points = np.cumsum(10 ** rng.uniform(-2, 0, count)), rng.normal(size=(count, 3))
    expected = CubicSpline(knots, points)(knots, 1)
    assert np.allclose(
        CubicPath.through(points, ("a", "b", "c"), knots=knots).tangents, expected, atol=1e-9 * np.abs(expected).max()
    )


class OwnCurve:
    """A curve of another package."""

    joint_names = ("a", "b")

    def __init__(self, knots, control) -> None:
        self.pieces = np.asarray(knots, dtype=float), np.asarray(control, dtype=float)

    def bezier(self):
        return self.pieces


def test_pieces_of_foreign_curves_must_meet_and_take_time():
    line, on = [[0, 0], [1, 1]], [[1, 1], [2, 0]]
    refuse_broken(OwnCurve([0, 1, 2], [line, on]))
    refuse_broken(OwnCurve([2, 2], [[[1, 1], [1, 1]]]))  # at rest
    for knots, control, named in (
        ([0, 1, 1], [line, on], "increas"),
        ([1, 1], [line], "increas"),
        ([0, 1, 2], [line, [[1, 1.5], [2, 0]]], "b jumps by 0.5 at the knot 1"),
        ([0, 1, 2, 3], [line, [[1, 1.1], [2, 0]], [[2.7, 0.0], [3, 3]]], "a jumps by 0.7 at the knot 2"),
        ([0, 1], [[[0, np.nan], [1, 1]]], "control points"),
        ([0, 1, 2], [line], "knots"),
        ([0], np.zeros((0, 2, 2)), "no control point"),
    ):
        with pytest.raises(InputError, match=named):
            refuse_broken(OwnCurve(knots, control))
