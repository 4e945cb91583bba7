"""The elementary equations of the closed forms, against numpy's roots and the angles of the C library."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.kernels.arctangent import angle_of
from pinproof.kernels.compiled import compiled
from pinproof.kernels.lanes import wind
from pinproof.kernels.roots import FREE, linear_roots, quartic_roots

from ..examples import examples

number = st.floats(-3, 3, allow_nan=False)


@compiled
def roots_of_equation(slides, A, B, C, border):
    return linear_roots(slides, A, B, C, math.nan, border, 0.0, FREE)


@compiled
def angles_of(y, x, out):
    for i in range(out.shape[0]):
        out[i] = angle_of(y[i], x[i])


@compiled
def wound(value, lower, upper, reference):
    return wind(value, lower, upper, 1e-9, reference)


@given(A=number, B=number, angle=number)
def test_a_revolute_joint_has_the_generating_root(A, B, angle):
    C = -A * math.cos(angle) - B * math.sin(angle)
    found, first, second = roots_of_equation(False, A, B, C, 1e-11)
    if math.hypot(A, B) < 1e-3:
        return
    roots = [first, second][:found]
    assert min(math.hypot(c - math.cos(angle), s - math.sin(angle)) for c, s in roots) < 1e-5
    for c, s in roots:
        assert math.hypot(c, s) == pytest.approx(1.0, abs=1e-9)
        assert A * c + B * s + C == pytest.approx(0.0, abs=1e-9)


@given(A=number, B=number, direction=number)
def test_a_prismatic_joint_has_the_generating_root(A, B, direction):
    if abs(B) < 1e-3:
        return
    found, first, second = roots_of_equation(True, A, B, -A * direction - B * direction * direction, 1e-11)
    roots = [first, second][:found]
    assert min(abs(t - direction) for t, _ in roots) < 1e-4
    assert all(square == t * t for t, square in roots)


def test_cases_without_a_root_with_one_and_with_all_values():
    assert roots_of_equation(False, 1.0, 0.0, -2.0, 1e-6)[0] == 0
    found, state, _ = roots_of_equation(False, 1.0, 0.0, -1.0 - 1e-8, 1e-6)
    assert (found, state) == (1, pytest.approx((1.0, 0.0)))
    assert roots_of_equation(False, 0.0, 0.0, 0.0, 1e-6)[0] == -1
    assert roots_of_equation(True, 0.0, 0.0, 0.0, 1e-6)[0] == -1
    assert roots_of_equation(True, 0.0, 0.0, 1.0, 1e-6)[0] == 0


@examples(300)
@given(st.lists(number, min_size=4, max_size=4), st.booleans())
def test_a_quartic_has_the_generating_roots(values, pair):
    """Four real roots, or two real roots and a conjugate pair."""
    real = sorted(values[:2] if pair else values)
    rest = [1.0, -2 * values[2], values[2] ** 2 + values[3] ** 2 + 0.01] if pair else [1.0]
    coefficients = np.polymul(np.poly(real), rest)[::-1].copy()
    found = np.empty(8)
    count = quartic_roots(coefficients, 0.0, found)
    all_roots = [*real, complex(values[2], math.hypot(values[3], 0.1))] if pair else real
    for i, root in enumerate(real):
        apart = min(abs(root - other) for k, other in enumerate(all_roots) if k != i)
        assert np.abs(found[:count] - root).min() < (1e-10 / apart**3 if apart > 1e-2 else 5e-3)
    size = np.abs(coefficients).max()
    assert np.abs(np.polyval(coefficients[::-1], found[:count])).max() < 1e-3 * size


def test_angles_equal_the_c_library():
    rng = np.random.default_rng(0)
    size = 10.0 ** rng.uniform(-300, 300, 20000)
    angle = rng.uniform(-np.pi, np.pi, 20000)
    x, y = size * np.cos(angle), size * np.sin(angle)
    x[:4], y[:4] = [1, -1, 0, 0], [0, 0, 1, -1]
    out = np.empty_like(x)
    angles_of(y, x, out)
    assert np.abs(out - np.arctan2(y, x)).max() < 1e-15
    angles_of(np.zeros(1), np.zeros(1), out[:1])
    assert out[0] == 0.0


@examples(300)
@given(value=st.floats(-20, 20), lower=st.floats(-8, 0), width=st.floats(0.1, 13), reference=st.floats(-20, 20))
def test_winding_is_within_limits_and_closest_if_possible(value, lower, width, reference):
    upper = lower + width
    turns = value + 2 * np.pi * np.arange(-8, 9)
    got = wound(value, lower, upper, reference)
    assert np.abs(turns - got).min() < 1e-12
    outside = np.maximum(np.maximum(lower - turns, turns - upper) - 1e-9, 0.0)
    mine = max(lower - got, got - upper, 0.0)
    assert mine <= outside.min() + 2e-9
    if outside.min() == 0.0:
        assert abs(got - reference) <= np.abs(turns[outside == 0.0] - reference).min() + 1e-9


def test_winding_works_without_limits():
    assert wound(0.5, -math.inf, math.inf, 20.0) == pytest.approx(0.5 + 6 * math.pi)
