"""Curves by their Bezier pieces, paths through points, and paths with rounded corners."""

import pickle
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import CubicSpline

from pinproof import InputError
from pinproof.motion import (
    REVERSAL,
    Bezier,
    BlendedPath,
    CubicPath,
    Curve,
    JointPath,
    corner_distance,
    refuse_broken,
    split,
)
from pinproof.motion.curve import argmax, extremes

from ..examples import examples

coordinate = st.floats(-10, 10, allow_subnormal=False)
ANY_DEGREE = st.integers(0, 6)


@st.composite
def curves(draw, degrees=ANY_DEGREE):
    """Knots (k+1,) and control points (k, degree+1, n)."""
    pieces, degree, joints = draw(st.integers(1, 4)), draw(degrees), draw(st.integers(1, 3))
    widths = draw(arrays(float, pieces, elements=st.floats(0.01, 5)))
    control = draw(arrays(float, (pieces, degree + 1, joints), elements=coordinate))
    return np.concatenate([[0.0], np.cumsum(widths)]), control


def on_piece(control, u):
    """Points (U, n) of one piece at local parameters u, by the power of the Bernstein basis itself."""
    degree, u = len(control) - 1, np.asarray(u)[:, None]
    return sum(comb(degree, r) * u**r * (1 - u) ** (degree - r) * control[r] for r in range(degree + 1))


@given(curves(), st.floats(0, 1))
def test_a_curve_is_the_bernstein_sum_bit_for_bit_at_its_ends_and_so_are_both_halves_of_a_split(curve, split_at):
    knots, control = curve
    whole, local = Bezier(knots, control), np.linspace(0, 1, 9)[1:-1]
    np.testing.assert_array_equal(whole.at(knots[:-1]), control[:, 0])
    np.testing.assert_array_equal(whole.at(knots[-1]), control[-1, -1])
    for i, (piece, left, right) in enumerate(zip(control, *split(control, split_at), strict=True)):
        at = knots[i] + local * (knots[i + 1] - knots[i])
        np.testing.assert_allclose(whole.at(at), on_piece(piece, local), atol=1e-11)
        shares = local * split_at, split_at + local * (1 - split_at)
        for half, share in zip((left, right), shares, strict=True):
            np.testing.assert_allclose(on_piece(half, local), on_piece(piece, share), atol=1e-12)


@given(curves())
def test_extremes_contain_every_sample_and_are_reached(curve):
    _, control = curve
    for piece, low, high in zip(control, *extremes(control), strict=True):
        samples = on_piece(piece, np.linspace(0, 1, 2001))
        size = max(np.abs(piece).max(), 1e-140)  # the squares of smaller coordinates underflow
        assert (samples.min(axis=0) >= low - 1e-13 * size).all()
        assert (samples.max(axis=0) <= high + 1e-13 * size).all()
        # between samples h apart a polynomial rises by |p''| h^2 / 8 at most, and |p''| <= 4 d (d - 1) max|control|
        degree = len(piece) - 1
        slack = (0.5 * degree * max(degree - 1, 1) / 2000**2 + 1e-12) * size
        assert (low >= samples.min(axis=0) - slack).all()
        assert (high <= samples.max(axis=0) + slack).all()


@pytest.mark.parametrize("degree", [4, 5, 6, 7])
def test_extremes_of_high_degrees_are_tight_at_flat_and_at_double_tops(degree):
    """Bumps of known height: (4 u (1-u))^2 times a power of u, and twin tops that are equally high."""
    u = np.linspace(0, 1, degree + 1)
    to_bernstein = np.linalg.inv(on_piece(np.eye(degree + 1), u))
    twin = 1 - (u * 2 - 1) ** 2 * ((u * 2 - 1) ** 2 - 0.5)  # degree 4: tops of 17/16 at 2u - 1 = +-1/2
    flat = 1 - (2 * u - 1) ** 4
    low, high = extremes((to_bernstein @ np.stack([twin, flat], axis=1))[None])
    np.testing.assert_allclose(high[0], [17 / 16, 1.0], rtol=1e-11)
    np.testing.assert_allclose(low[0], [0.5, 0.0], atol=1e-11)


@given(curves(st.integers(1, 4)))
def test_the_derivative_is_that_of_the_polynomial(curve):
    knots, control = curve
    curve, u = Bezier(knots, control), np.linspace(0, 1, 12)
    assert curve.derivative().degree == curve.degree - 1
    for piece, slope, width in zip(control, curve.derivative().control, np.diff(knots), strict=True):
        fits = (np.polynomial.Polynomial.fit(u, row, deg=len(piece) - 1) for row in on_piece(piece, u).T)
        expected = np.array([fit.deriv()(0.3) for fit in fits]) / width
        np.testing.assert_allclose(on_piece(slope, [0.3])[0], expected, rtol=1e-8, atol=1e-7)


@given(arrays(float, (3, 4, 2), elements=coordinate), st.floats(0.1, 3), st.booleans())
def test_hermite_pieces_have_the_requested_points_and_slopes(derivatives, width, quintic):
    knots = np.array([0.0, width, 2.5 * width])
    request = derivatives[:, : 3 if quintic else 2].swapaxes(0, 1)
    curve = Bezier.hermite(knots, *request)
    for values in request:
        np.testing.assert_allclose(curve.at(knots), values, atol=1e-9 / min(width, 1) ** 2)
        curve = curve.derivative()
        if not quintic and values is request[-1]:
            break  # a cubic's second derivative jumps
    slope, expected = Bezier.hermite_slope(knots, *request), Bezier.hermite(knots, *request).derivative()
    np.testing.assert_allclose(slope.control, expected.control, atol=1e-10 / width)


@pytest.mark.parametrize(
    ("t", "message"),
    [*((t, "outside") for t in (-1e-9, 1.0 + 1e-9, np.nan, np.inf, [0.5, 2.0])), (np.zeros((2, 2)), "shape")],
)
def test_a_parameter_off_the_curve_is_refused(t, message):
    with pytest.raises(InputError, match=message):
        Bezier(np.array([0.0, 1.0]), np.zeros((1, 2, 1))).at(t)


def test_a_piece_of_zero_width_is_its_configuration():
    still = Bezier(np.zeros(2), np.full((1, 4, 3), 0.7))
    np.testing.assert_array_equal(still.at(0.0), np.full(3, 0.7))
    np.testing.assert_array_equal(still.derivative().control, np.zeros((1, 3, 3)))


def test_elevated_pieces_are_the_same_pieces():
    control = np.random.default_rng(0).normal(size=(2, 3, 4))
    control[1, 0] = control[0, -1]
    curve, t = Bezier(np.array([0.0, 1.0, 3.0]), control), np.linspace(0, 3, 100)
    raised = curve.elevated(5)
    assert raised.control.shape == (2, 6, 4)
    assert np.allclose(raised.at(t), curve.at(t), atol=1e-14)
    assert np.array_equal(raised.control[:, [0, -1]], control[:, [0, -1]])
    assert curve.elevated(2).control is control


@settings(max_examples=25)
@given(curves(st.integers(1, 5)), st.booleans())
def test_argmax_is_where_a_polynomial_is_largest(curve, falling):
    for row in np.moveaxis(curve[1], 2, 1).reshape(-1, curve[1].shape[1]):
        row = np.sort(row)[::-1] if falling else row
        dense = on_piece(row[:, None], np.linspace(0.0, 1.0, 400))[:, 0]
        u = argmax(row)
        assert 0.0 <= u <= 1.0
        assert on_piece(row[:, None], [u])[0, 0] >= dense.max() - 1e-9 * np.abs(row).max()


# -- paths -------------------------------------------------------------------------------------------------------------

NAMES = ("shoulder", "elbow")
CORNER = JointPath([[0, 0], [3, 4], [3, 5]], NAMES)
SPLINE = CubicPath.through(CORNER.q, NAMES)
POINT = JointPath([[1, 2]], NAMES)
STANDING = CubicPath([[1, 2]], [[0, 0]], [3], NAMES)


@pytest.mark.parametrize("curve", [CORNER, SPLINE, POINT, STANDING])
def test_paths_are_locked_curves_whose_pieces_are_what_is_evaluated_also_after_pickling(curve):
    again = pickle.loads(pickle.dumps(curve))
    assert again.is_close(curve, 0)
    for path in (curve, again):
        assert isinstance(path, Curve)
        knots, control = path.bezier()
        assert (knots[0], knots[-1]) == path.domain
        assert len(knots) == len(control) + 1 >= 2  # a single configuration has one piece
        t = np.linspace(*path.domain, 17)
        np.testing.assert_array_equal(path(t), Bezier(knots, control).at(t))
        np.testing.assert_array_equal(path(t[[0, -1]]), [path.start, path.end])
        assert not any(array.flags.writeable for array in (path.q, path.start, knots, control))
    if curve in (POINT, STANDING):
        assert (control == [1, 2]).all()
        assert len(control) == 1


def test_a_joint_path_runs_over_its_waypoints_indices_and_copies_them():
    np.testing.assert_allclose(CORNER(0.5), [1.5, 2])
    np.testing.assert_array_equal(CORNER([0, 1, 2]), CORNER.q)
    assert (CORNER.domain, CORNER.length) == ((0, 2), pytest.approx(6))
    np.testing.assert_array_equal(CORNER.reversed().q, CORNER.q[::-1])
    q = np.zeros((2, 2))
    path = JointPath(q, list(NAMES))
    q[0] = 7
    assert not path.q.any()
    assert path.joint_names == NAMES


def test_joined_paths_share_the_point_where_they_meet_and_keep_ends_that_differ_by_rounding():
    joined = CORNER + JointPath([[3, 5], [0, 0]], NAMES)
    np.testing.assert_array_equal(joined.q, [[0, 0], [3, 4], [3, 5], [0, 0]])
    assert JointPath.join(CORNER).is_close(CORNER, 0)
    assert len(CORNER + JointPath([[3, 5 + 1e-15], [0, 0]], NAMES)) == 5


def test_is_close_compares_joints_shape_and_values():
    assert CORNER.is_close(JointPath(CORNER.q + 1e-10, NAMES))
    for q, names in ((CORNER.q + 1e-8, NAMES), (CORNER.q, ("a", "b")), (CORNER.q[:2], NAMES)):
        assert not CORNER.is_close(JointPath(q, names))


@given(arrays(float, (5, 2), elements=st.floats(-3, 3)))
def test_a_cubic_path_has_the_points_and_tangents_it_was_given(values):
    knots = np.array([0.0, 0.4, 1.0, 1.5, 2.5])
    path = CubicPath(values, values[::-1], knots, NAMES)
    np.testing.assert_array_equal(path(knots), values)
    slopes = path.derivative(1).control
    np.testing.assert_allclose(slopes[:, 0], values[::-1][:-1], atol=1e-13)
    np.testing.assert_allclose(slopes[:, -1], values[::-1][1:], atol=1e-13)  # the same from both sides: C1


@examples(60)
@given(count=st.integers(2, 9), seed=st.integers(0, 2**32 - 1))
def test_the_spline_is_that_of_scipy(count, seed):
    rng = np.random.default_rng(seed)
    knots, points = np.cumsum(10 ** rng.uniform(-2, 0, count)), rng.normal(size=(count, 3))
    expected = CubicSpline(knots, points)(knots, 1)
    found = CubicPath.through(points, ("a", "b", "c"), knots=knots).tangents
    assert np.allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_through_runs_over_the_chord_length_unless_knots_are_given():
    np.testing.assert_allclose(SPLINE.knots, [0, 5, 6])
    line = CubicPath.through(CORNER.q[:2], NAMES, [0, 1])
    np.testing.assert_allclose(line(0.25), [0.75, 1])
    assert CubicPath.through(CORNER.q[:1], NAMES).domain == (0, 0)


def test_a_reversed_cubic_path_has_the_same_image():
    path = CubicPath.through([[0, 0], [1, 2], [3, 1], [4, 4]], NAMES, [1, 2, 4, 4.5])
    t = np.linspace(1, 4.5, 40)
    np.testing.assert_allclose(path.reversed()(5.5 - t), path(t), atol=1e-14)


class OwnCurve:
    """A curve of another package."""

    joint_names = ("a", "b")

    def __init__(self, knots, control):
        self.pieces = np.asarray(knots, dtype=float), np.asarray(control, dtype=float)
        refuse_broken(self)

    def bezier(self):
        return self.pieces


LEG, ON = [[0, 0], [1, 1]], [[1, 1], [2, 0]]


def test_pieces_of_foreign_curves_may_rest():
    OwnCurve([0, 1, 2], [LEG, ON])
    OwnCurve([2, 2], [[[1, 1], [1, 1]]])


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (JointPath.join, (CORNER, JointPath([[3, 5.1], [0, 0]], NAMES)), "joint 'elbow' ends at 5.0 .* 5.1"),
        (JointPath.join, (CORNER, JointPath([[3, 5], [0, 0]], NAMES[::-1])), "different joints"),
        (JointPath, ([[0, np.nan]], NAMES), "nan"),
        (JointPath, ([0, 1], NAMES), "shape"),
        (JointPath, (np.zeros((0, 2)), NAMES), "at least one"),
        (JointPath, ([[0, 0, 0]], NAMES), "shape"),
        (JointPath, ([[0, 0]], ("a", "a")), "twice"),
        (JointPath, ([[0, 0]], "ab"), "sequence"),
        (JointPath, ([[0, 0]], ("a", "")), "non-empty"),
        (JointPath, ([[]], ()), "empty"),
        (CubicPath.through, ([[0, 0], [1, 1], [1, 1]], NAMES), "1 and 2 are equal"),
        *((CubicPath, (CORNER.q, CORNER.q, knots, NAMES), "knots") for knots in ([0, 1, 1], [0, 2, 1], [0, 1])),
        (OwnCurve, ([0, 1, 1], [LEG, ON]), "increas"),
        (OwnCurve, ([1, 1], [LEG]), "increas"),
        (OwnCurve, ([0, 1, 2], [LEG, [[1, 1.5], [2, 0]]]), "b jumps by 0.5 at the knot 1"),
        (OwnCurve, ([0, 1, 2, 3], [LEG, [[1, 1.1], [2, 0]], [[2.7, 0.0], [3, 3]]]), "a jumps by 0.7 at the knot 2"),
        (OwnCurve, ([0, 1], [[[0, np.nan], [1, 1]]]), "control points"),
        (OwnCurve, ([0, 1, 2], [LEG]), "knots"),
        (OwnCurve, ([0], np.zeros((0, 2, 2))), "no control point"),
    ],
)
def test_an_invalid_path_is_refused(make, arguments, message):
    with pytest.raises(InputError, match=message):
        make(*arguments)


# -- rounded corners: on the legs, within the deviation, twice differentiable; stops only where requested --------------

XYZ = ("a", "b", "c")
SQUARE = JointPath([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], XYZ)
RISING = JointPath([(0, 0, 0), (1, 0, 0), (1, 1, 0.5), (0, 1, 1)], XYZ)


@st.composite
def polylines(draw):
    """A path of 2 to 6 waypoints, and a reach for each corner: none, or up to half the shorter leg."""
    count = draw(st.integers(2, 6))
    q = np.array(draw(st.lists(st.tuples(*[st.floats(-3, 3)] * 3), min_size=count, max_size=count)))
    length = np.linalg.norm(np.diff(q, axis=0), axis=1)
    if not (length > 1e-3).all():
        q = np.cumsum(np.abs(q) + 0.1, axis=0)
        length = np.linalg.norm(np.diff(q, axis=0), axis=1)
    direction = np.diff(q, axis=0) / length[:, None]
    reach = np.zeros(count)
    for i in range(1, count - 1):
        if np.linalg.norm(direction[i] + direction[i - 1]) > 2 * REVERSAL:
            reach[i] = draw(st.sampled_from([0.0, 0.01, 0.3, 1.0])) * min(length[i - 1], length[i]) / 2
    return JointPath(q, XYZ), reach


@examples(60)
@given(polylines())
def test_smooth_but_at_the_stops_and_on_the_polyline_elsewhere(drawn):
    path, reach = drawn
    smooth = BlendedPath.rounded(path, reach)
    assert isinstance(smooth, Curve)
    assert np.array_equal([smooth.start, smooth.end], path.q[[0, -1]])
    first, second = (smooth.derivative(order).control for order in (1, 2))
    assert np.abs(second[:, [0, -1]]).max() < 1e-6 * np.abs(second).max() + 1e-8
    step = np.abs(first[1:, 0] - first[:-1, -1]).max(axis=1)
    assert all(knot in smooth.corners or gap < 1e-5 for knot, gap in zip(smooth.knots[1:-1], step, strict=True))
    speed = np.linalg.norm(Bezier(smooth.knots, first).at(np.linspace(*smooth.domain, 500)), axis=1)
    assert speed.max() < 1.02
    assert speed.min() > 0.04  # the sharpest corners are slow in their middle
    assert smooth.length <= path.length * (1 + 1e-9)


@examples(60)
@given(st.floats(0.0, 0.95 * np.pi), st.floats(0.01, 1.0))
def test_the_stated_corner_deviation_is_exact(turn, reach):
    q = np.array([(-1.0, 0, 0), (0, 0, 0), (np.cos(turn), np.sin(turn), 0)])
    line = np.diff(q, axis=0)
    smooth = BlendedPath.rounded(JointPath(q, XYZ), [0, reach, 0])
    points = smooth(np.linspace(*smooth.domain, 4001))
    nearest = np.linalg.norm(points, axis=1).min()
    assert nearest == pytest.approx(reach * float(corner_distance(line[:1], line[1:])[0]), abs=2e-3 * reach)
    # nowhere is the curve farther from the legs than at its middle
    legs = [np.linalg.norm(points - np.clip(points @ leg, *ends)[:, None] * leg, axis=1)
            for leg, ends in ((line[0], (-1, 0)), (line[1], (0, 1)))]  # fmt: skip
    assert np.minimum(*legs).max() <= nearest + 1e-9


def test_three_times_differentiable_inside_and_twice_at_the_joins_by_finite_differences():
    smooth, h = BlendedPath.rounded(RISING, [0, 0.4, 0.3, 0]), 1e-4
    assert smooth.corners == ()
    for knot in smooth.knots[1:-1]:
        before, behind = (smooth(knot + side * h * np.arange(3)) for side in (-1, 1))
        assert np.allclose((before[0] - before[1]) / h, (behind[1] - behind[0]) / h, atol=1e-5)
        for points in (before, behind):  # it is 0 at the join and grows at a bounded rate
            assert np.abs(np.diff(points, 2, axis=0)).max() / h**2 < 0.1
    assert np.abs(np.diff(smooth(np.linspace(0.65, 0.75, 50)), 2, axis=0)).max() > 0


def test_the_corner_that_is_kept_is_a_stop():
    smooth = BlendedPath.rounded(SQUARE, [0, 0.5, 0, 0])
    assert len(smooth.corners) == 1
    assert np.array_equal(smooth(smooth.corners[0]), SQUARE.q[2])
    assert len(BlendedPath.rounded(SQUARE, np.zeros(4)).corners) == 2
    straight = JointPath([(0, 0, 0), (1, 0, 0), (3, 0, 0)], XYZ)
    assert BlendedPath.rounded(straight, np.zeros(3)).corners == ()  # no corner where nothing turns
    # roundings may fill a complete segment
    short = JointPath([(0, 0, 0), (0.3, 0, 0), (0.3, 0.3, 0), (0.6, 0.3, 0)], XYZ)
    full = BlendedPath.rounded(short, [0, 0.15, 0.15, 0])
    assert (len(full), full.corners) == (4, ())


def test_length_is_that_of_a_dense_sample():
    smooth = BlendedPath.rounded(RISING, [0, 0.5, 0.4, 0])
    dense = np.linalg.norm(np.diff(smooth(np.linspace(*smooth.domain, 100_001)), axis=0), axis=1).sum()
    assert smooth.length == pytest.approx(dense, rel=1e-8)
    assert smooth.length < RISING.length


def test_values_are_frozen_pickled_and_turned_round_exactly():
    smooth = BlendedPath.rounded(SQUARE, [0, 0.4, 0, 0])
    again = pickle.loads(pickle.dumps(smooth))
    assert (again.control.tobytes(), again.corners) == (smooth.control.tobytes(), smooth.corners)
    for array in (smooth.knots, smooth.control, again.knots, again.control):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    back, t = smooth.reversed(), np.linspace(0, 1, 101) * smooth.domain[1]
    assert np.allclose(back(t), smooth(smooth.domain[1] - t), atol=1e-12)
    assert np.array_equal(back(back.corners[0]), SQUARE.q[2])
    assert back.reversed().is_close(smooth, 1e-12)
    assert not back.is_close(smooth)


ARC = CubicPath.through([(0, 0, 0), (1, 0.5, 0), (2, 0, 1)], XYZ)
AWAY = JointPath([(2, 0, 1), (2, 0, 1), (3, 1, 1)], XYZ)


def test_joined_curves_stop_only_where_derivatives_differ():
    both = BlendedPath.join(ARC, AWAY)
    assert len(both) == 3  # the piece that stands still is gone
    assert both.corners == (ARC.domain[1],)
    t = np.linspace(*ARC.domain, 50)
    assert np.allclose(both(t), ARC(t), atol=1e-14)
    assert np.array_equal(both.end, AWAY.end)
    halves = (CubicPath(ARC.q[i : i + 2], ARC.tangents[i : i + 2], ARC.knots[i : i + 2], XYZ) for i in (0, 1))
    assert BlendedPath.join(*halves).corners == ()
    still = JointPath([(2, 0, 1)], XYZ)
    assert BlendedPath.join(still, still).domain == (0.0, 0.0)


def test_a_rounded_path_without_motion():
    still = BlendedPath.rounded(JointPath([(1, 2, 3)], XYZ), [0])
    assert (still.domain, still(0.0).tolist(), still.length) == ((0.0, 0.0), [1, 2, 3], 0)
    assert still.reversed().is_close(still)


LINES = np.array([[(0, 0, 0), (1, 0, 0)], [(1, 0, 0), (1, 1, 0)]], dtype=float)
TORN = np.array([0, 1e-9])[:, None, None]


@pytest.mark.parametrize(
    ("make", "arguments", "word"),
    [
        (BlendedPath.rounded, (SQUARE, [0, 0.6, 0.6, 0]), "overlap"),
        (BlendedPath.rounded, (SQUARE, [0, -0.1, 0, 0]), "0 or more"),
        (BlendedPath.rounded, (SQUARE, [0.1, 0, 0, 0]), "both ends"),
        (BlendedPath.rounded, (SQUARE, [0, 0]), "4 num"),
        (BlendedPath.rounded, (JointPath([(0, 0, 0), (1, 0, 0), (0, 0, 0)], XYZ), [0, 0.1, 0]), "waypoint 1"),
        (BlendedPath.rounded, (JointPath([(0, 0, 0), (0, 0, 0), (1, 0, 0)], XYZ), [0, 0, 0]), "equal"),
        (BlendedPath, ([0, 1, 2], LINES, XYZ), "jumps at"),
        (BlendedPath, ([0, 1, 2], LINES, XYZ, [0.5]), "inner knots"),
        (BlendedPath, ([0, 1, 2], LINES + TORN, XYZ, [1.0]), "do not meet"),
        (BlendedPath, ([0, 1, 2], LINES + TORN * [0, 1, 0], XYZ, [1.0]), "do not meet"),  # in one joint only
        (BlendedPath, ([0, 1, 1], LINES, XYZ, [1.0]), "increase"),
        (BlendedPath, ([0, 1], np.zeros((1, 8, 3)), XYZ), "degree"),
        (BlendedPath, ([0, 0], LINES[:1], XYZ), "zero width"),
        (BlendedPath.join, (AWAY, ARC), "do not meet"),
    ],
)
def test_an_invalid_rounded_path_is_refused(make, arguments, word):
    with pytest.raises(InputError, match=word):
        make(*arguments)
    assert BlendedPath([0, 1, 2], LINES, XYZ, [1.0]).corners == (1.0,)
