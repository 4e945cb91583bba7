"""The elementary equations of the closed forms, against numpy's roots and the angles of the C library."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof import _core

from ..examples import examples

number = st.floats(-3, 3, allow_nan=False)


def wound(value, lower, upper, reference):
    return _core.nearest_winding(value, lower, upper, 1e-9, reference)


@given(A=number, B=number, angle=number)
def test_a_revolute_joint_has_the_generating_root(A, B, angle):
    C = -A * math.cos(angle) - B * math.sin(angle)
    roots = _core.linear_roots(False, A, B, C, 1e-11)
    if math.hypot(A, B) < 1e-3:
        return
    assert min(math.hypot(c - math.cos(angle), s - math.sin(angle)) for c, s in roots) < 1e-5
    for c, s in roots:
        assert math.hypot(c, s) == pytest.approx(1.0, abs=1e-9)
        assert A * c + B * s + C == pytest.approx(0.0, abs=1e-9)


@given(A=number, B=number, value=number)
def test_a_prismatic_joint_has_the_generating_root(A, B, value):
    if abs(B) < 1e-3:
        return
    roots = _core.linear_roots(True, A, B, -A * value - B * value * value, 1e-11)
    assert min(abs(t - value) for t, _ in roots) < 1e-4
    assert all(square == t * t for t, square in roots)


def test_cases_without_a_root_with_one_and_with_all_values():
    assert _core.linear_roots(False, 1.0, 0.0, -2.0, 1e-6) == []
    (state,) = _core.linear_roots(False, 1.0, 0.0, -1.0 - 1e-8, 1e-6)
    assert state == pytest.approx((1.0, 0.0))
    assert _core.linear_roots(False, 0.0, 0.0, 0.0, 1e-6) is None
    assert _core.linear_roots(True, 0.0, 0.0, 0.0, 1e-6) is None
    assert _core.linear_roots(True, 0.0, 0.0, 1.0, 1e-6) == []


@examples(300)
@given(st.lists(number, min_size=4, max_size=4), st.booleans())
def test_a_quartic_has_the_generating_roots(values, pair):
    """Four real roots, or two real roots and a conjugate pair."""
    real = sorted(values[:2] if pair else values)
    rest = [1.0, -2 * values[2], values[2] ** 2 + values[3] ** 2 + 0.01] if pair else [1.0]
    coefficients = np.polymul(np.poly(real), rest)[::-1].copy()
    found = np.array(_core.quartic_roots(coefficients))
    all_roots = [*real, complex(values[2], math.hypot(values[3], 0.1))] if pair else real
    for i, root in enumerate(real):
        apart = min(abs(root - other) for k, other in enumerate(all_roots) if k != i)
        assert np.abs(found - root).min() < (1e-10 / apart**3 if apart > 1e-2 else 5e-3)
    size = np.abs(coefficients).max()
    assert np.abs(np.polyval(coefficients[::-1], found)).max() < 1e-3 * size


def test_angles_equal_the_c_library():
    rng = np.random.default_rng(0)
    size = 10.0 ** rng.uniform(-300, 300, 20000)
    angle = rng.uniform(-np.pi, np.pi, 20000)
    x, y = size * np.cos(angle), size * np.sin(angle)
    x[:4], y[:4] = [1, -1, 0, 0], [0, 0, 1, -1]
    out = [_core.angle_of(*point) for point in zip(y, x, strict=True)]
    assert np.abs(out - np.arctan2(y, x)).max() < 1e-15
    assert _core.angle_of(0.0, 0.0) == 0.0


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
