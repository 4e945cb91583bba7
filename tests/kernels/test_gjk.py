"""Both bounds of the distance of convex bodies are valid and converge, also for degenerate bodies."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.kernels.gjk import SIMPLEX, WEIGHT, between
from pinproof.kernels.world import BODY_COLUMNS, CONVEX, DISCS, FIRST, LAST, RADIUS, SEMI

from ..examples import examples

SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
numbers = st.floats(-2.0, 2.0, allow_subnormal=False)


def bodies_of(*shapes):
    """Rows of bodies and the points of all: each shape is (points (V, 3), disc radius, ball radius, semi axes)."""
    rows, points, count = np.zeros((len(shapes), BODY_COLUMNS)), [], 0
    for row, (own, disc, ball, semi) in zip(rows, shapes, strict=True):
        own = np.asarray(own, dtype=float)
        points.append(np.vstack([own.T, np.full(len(own), disc)]))
        row[FIRST], row[LAST] = count, count + len(own)
        row[DISCS], row[RADIUS], row[CONVEX] = disc > 0, ball, 1.0
        row[SEMI : SEMI + 3] = semi
        count += len(own)
    return rows, np.ascontiguousarray(np.hstack(points))


def placed(translation, rotation=None):
    rotation = np.eye(3) if rotation is None else rotation
    return np.concatenate([rotation.ravel(), np.asarray(translation, dtype=float)])


def bounds(shapes, rel, direction=None, above=np.inf, below=-1.0):
    rows, points = bodies_of(*shapes)
    simplex, u = np.full(SIMPLEX, np.nan), np.zeros(3) if direction is None else np.array(direction, dtype=float)
    lower, upper = between(rows, points, 0, 1, rel, u, simplex, above, below, 1e-9)
    return lower, upper, u, simplex


def box(x, y, z):
    return SIGNS * (x / 2, y / 2, z / 2), 0.0, 0.0, 0.0


BALL, POINT = ([[0, 0, 0]], 0.0, 0.3, 0.0), ([[0, 0, 0]], 0.0, 0.0, 0.0)
CYLINDER, ELLIPSOID = ([[0, 0, -0.5], [0, 0, 0.5]], 0.2, 0.0, 0.0), ([[0, 0, 0]], 0.0, 0.0, (0.1, 0.2, 0.3))


@examples(200)
@given(at=st.tuples(numbers, numbers, numbers), start=st.tuples(numbers, numbers, numbers))
def test_distance_of_axis_aligned_boxes_is_exact_from_any_start(at, start):
    sizes = np.array([[0.4, 0.6, 0.2], [0.3, 0.1, 0.5]])
    gap = np.abs(at) - sizes.sum(axis=0) / 2
    distance = float(np.linalg.norm(np.maximum(gap, 0)))
    lower, upper, u, _ = bounds([box(*sizes[0]), box(*sizes[1])], placed(at), start)
    assert lower <= distance + 1e-12
    assert upper >= distance - 1e-12
    if distance > 1e-6:
        # Support points are ambiguous for corners equal to 1e-8; the choice changes the last digits of both bounds.
        assert upper - lower <= 1e-8
        assert np.linalg.norm(u) == pytest.approx(1.0, abs=1e-12)
    if gap.max() < -1e-6:
        assert upper == 0.0


@examples(200)
@given(at=st.tuples(numbers, numbers, numbers))
def test_distance_of_curved_bodies_to_a_point_is_exact(at):
    x, y, z = at
    ball = max(np.linalg.norm(at) - 0.3, 0.0)
    tube = float(np.hypot(max(np.hypot(x, y) - 0.2, 0.0), max(abs(z) - 0.5, 0.0)))
    for shape, distance in ((BALL, ball), (CYLINDER, tube)):
        lower, upper, _, _ = bounds([shape, POINT], placed(at))
        assert lower <= distance + 1e-12
        assert upper >= distance - 1e-12
        if distance > 1e-6:
            assert upper - lower <= 1e-7


@examples(150)
@given(data=st.data())
def test_support_gap_and_witness_points_equal_the_bounds(data):
    shapes = data.draw(st.lists(st.sampled_from([box(0.2, 0.3, 0.4), CYLINDER, ELLIPSOID]), min_size=2, max_size=2))
    at = np.array(data.draw(st.tuples(numbers, numbers, numbers)))
    turn = np.linalg.qr(np.random.default_rng(data.draw(st.integers(0, 10**6))).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    lower, upper, u, simplex = bounds(shapes, placed(at, turn))

    def reach(shape, d):
        points, disc, ball, semi = shape
        return (np.asarray(points, float) @ d + disc * np.hypot(d[0], d[1])).max() + ball + np.linalg.norm(semi * d)

    gap = u @ at - reach(shapes[0], u) - reach(shapes[1], turn.T @ -u)
    assert lower == pytest.approx(gap, abs=1e-12)
    assert lower <= upper + 1e-12
    weights = simplex[:, WEIGHT]
    assert weights.min() >= 0
    assert weights.sum() == pytest.approx(1.0, abs=1e-9)
    if upper > 0:
        assert np.linalg.norm(weights @ np.nan_to_num(simplex[:, :3])) == pytest.approx(upper, abs=1e-9)


@pytest.mark.parametrize("thin", [0.0, 1e-300, 1e-160, 1e-12, 1e-9])
@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-3, 1.0])
def test_bounds_hold_for_flat_and_tiny_bodies(thin, apart):
    """Plates and needles without thickness give degenerate simplices, for which weights may be 0 / 0."""
    for sizes in ((1.0, 1.0, thin), (1.0, thin, thin), (thin, thin, thin)):
        for direction in ((0, 0, 1), (1, 1, 1), (1e-200, 0, 0)):
            lower, upper, _, _ = bounds([box(*sizes), box(*sizes)], placed((0, 0, apart + sizes[2])), direction)
            assert lower <= apart + 1e-12
            assert upper >= apart - 1e-12
            assert upper <= apart + 1e-8


def test_nan_proves_nothing():
    for at in ((np.nan, 0, 0), (np.inf, 0, 0), (1e308, 1e308, 1e308)):
        lower, upper, _, _ = bounds([box(1, 1, 1), box(1, 1, 1)], placed(at))
        assert lower == -np.inf or np.isfinite(at).all()
        assert upper > 0


def test_early_termination_returns_valid_bounds():
    shapes, rel = [CYLINDER, box(0.2, 0.3, 0.4)], placed((1.0, 0.3, 0.2))
    exact, _, _, _ = bounds(shapes, rel)
    lower, upper, _, _ = bounds(shapes, rel, above=0.1)
    assert 0.1 < lower <= exact <= upper + 1e-12
    lower, upper, _, _ = bounds(shapes, rel, below=5.0)
    assert lower <= exact <= upper <= 5.0
