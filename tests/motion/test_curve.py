from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pinproof import InputError
from pinproof.motion import Bezier, split
from pinproof.motion.curve import argmax, extremes

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
    degree = len(control) - 1
    return sum(
        comb(degree, r) * u[:, None] ** r * (1 - u[:, None]) ** (degree - r) * control[r] for r in range(degree + 1)
    )


@given(curves())
def test_evaluate_is_the_bernstein_sum(curve):
    knots, control = curve
    u = np.linspace(0, 1, 9)[1:-1]
    for i, piece in enumerate(control):
        t = knots[i] + u * (knots[i + 1] - knots[i])
        np.testing.assert_allclose(Bezier(knots, control).at(t), on_piece(piece, u), atol=1e-11)


@given(curves())
def test_a_piece_starts_at_its_first_control_point_and_the_curve_ends_at_its_last_bit_for_bit(curve):
    knots, control = curve
    np.testing.assert_array_equal(Bezier(knots, control).at(knots[:-1]), control[:, 0])
    np.testing.assert_array_equal(Bezier(knots, control).at(knots[-1]), control[-1, -1])


@given(curves(), st.floats(0, 1))
def test_both_halves_of_a_split_trace_the_same_curve(curve, u):
    _, control = curve
    left, right = split(control, u)
    local = np.linspace(0, 1, 7)
    for i in range(len(control)):
        np.testing.assert_allclose(on_piece(left[i], local), on_piece(control[i], local * u), atol=1e-12)
        np.testing.assert_allclose(on_piece(right[i], local), on_piece(control[i], u + local * (1 - u)), atol=1e-12)


@given(curves())
def test_the_hull_contains_every_sample(curve):
    _, control = curve
    low, high = control.min(axis=1), control.max(axis=1)
    for i, piece in enumerate(control):
        samples = on_piece(piece, np.linspace(0, 1, 101))
        assert (samples >= low[i] - 1e-13).all()
        assert (samples <= high[i] + 1e-13).all()


@given(curves())
def test_extremes_contain_every_sample_and_are_reached(curve):
    _, control = curve
    low, high = extremes(control)
    for i, piece in enumerate(control):
        samples = on_piece(piece, np.linspace(0, 1, 2001))
        size = max(np.abs(piece).max(), 1e-140)  # the squares of smaller coordinates underflow
        assert (samples.min(axis=0) >= low[i] - 1e-13 * size).all()
        assert (samples.max(axis=0) <= high[i] + 1e-13 * size).all()
        # between samples h apart a polynomial rises by |p''| h^2 / 8 at most, and |p''| <= 4 d (d - 1) max|control|
        degree = len(piece) - 1
        slack = (0.5 * degree * max(degree - 1, 1) / 2000**2 + 1e-12) * size
        assert (low[i] >= samples.min(axis=0) - slack).all()
        assert (high[i] <= samples.max(axis=0) + slack).all()


@pytest.mark.parametrize("degree", [4, 5, 6, 7])
def test_extremes_of_high_degrees_are_tight_at_flat_and_at_double_tops(degree):
    """Bumps of known height: (4 u (1-u))^2 times a power of u, and twin tops that are equally high."""
    u = np.linspace(0, 1, degree + 1)
    to_bernstein = np.linalg.inv(
        np.array([[comb(degree, r) * x**r * (1 - x) ** (degree - r) for r in range(degree + 1)] for x in u])
    )
    twin = 1 - (u * 2 - 1) ** 2 * ((u * 2 - 1) ** 2 - 0.5)  # degree 4: tops of 17/16 at 2u - 1 = +-1/2
    flat = 1 - (2 * u - 1) ** 4
    control = (to_bernstein @ np.stack([twin, flat], axis=1))[None]
    low, high = extremes(control)
    np.testing.assert_allclose(high[0], [17 / 16, 1.0], rtol=1e-11)
    np.testing.assert_allclose(low[0], [0.5, 0.0], atol=1e-11)


@given(curves(st.integers(1, 4)))
def test_the_derivative_is_that_of_the_polynomial(curve):
    knots, control = curve
    curve = Bezier(knots, control)
    slope = curve.derivative().control
    assert curve.derivative().degree == curve.degree - 1
    for i, piece in enumerate(control):
        power = np.array(
            [
                np.polynomial.Polynomial.fit(*_samples(piece[:, j]), deg=len(piece) - 1).deriv()(0.3)
                for j in range(piece.shape[1])
            ]
        )
        np.testing.assert_allclose(
            on_piece(slope[i], np.array([0.3]))[0], power / (knots[i + 1] - knots[i]), rtol=1e-8, atol=1e-7
        )


def _samples(coefficients):
    u = np.linspace(0, 1, 12)
    return u, on_piece(coefficients[:, None], u)[:, 0]


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


@pytest.mark.parametrize("t", [-1e-9, 1.0 + 1e-9, np.nan, np.inf, [0.5, 2.0]])
def test_a_parameter_off_the_curve_is_refused(t):
    with pytest.raises(InputError, match="outside"):
        Bezier(np.array([0.0, 1.0]), np.zeros((1, 2, 1))).at(t)


def test_a_piece_of_zero_width_is_its_configuration():
    knots, control = np.zeros(2), np.full((1, 4, 3), 0.7)
    np.testing.assert_array_equal(Bezier(knots, control).at(0.0), np.full(3, 0.7))
    np.testing.assert_array_equal(Bezier(knots, control).derivative().control, np.zeros((1, 3, 3)))


def test_elevated_pieces_are_the_same_pieces() -> None:
    rng = np.random.default_rng(0)
    knots, control = np.array([0.0, 1.0, 3.0]), rng.normal(size=(2, 3, 4))
    control[1, 0] = control[0, -1]
    raised = Bezier(knots, control).elevated(5)
    assert raised.control.shape == (2, 6, 4)
    t = np.linspace(0, 3, 100)
    assert np.allclose(raised.at(t), Bezier(knots, control).at(t), atol=1e-14)
    assert np.array_equal(raised.control[:, [0, -1]], control[:, [0, -1]])
    assert Bezier(knots, control).elevated(2).control is control


@settings(max_examples=25)
@given(curves(st.integers(1, 5)), st.booleans())
def test_argmax_is_where_a_polynomial_is_largest(curve, falling):
    for row in np.moveaxis(curve[1], 2, 1).reshape(-1, curve[1].shape[1]):
        row = np.sort(row)[::-1] if falling else row
        dense = on_piece(row[:, None], np.linspace(0.0, 1.0, 400))[:, 0]
        u = argmax(row)
        assert 0.0 <= u <= 1.0
        assert on_piece(row[:, None], np.array([u]))[0, 0] >= dense.max() - 1e-9 * np.abs(row).max()


def test_a_parameter_with_two_dimensions_is_refused():
    with pytest.raises(InputError, match="shape"):
        Bezier(np.array([0.0, 1.0]), np.zeros((1, 2, 1))).at(np.zeros((2, 2)))
