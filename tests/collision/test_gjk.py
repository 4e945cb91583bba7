"""Both bounds of the distance of convex bodies are valid and converge, also for degenerate bodies."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pinproof import _core

from ..examples import examples

SIGNS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
numbers = st.floats(-2.0, 2.0, allow_subnormal=False)


def core_shape(points, disc, ball, semi):
    """A shape of points (V, 3), each with a disc, and of a ball and semi axes; its bounding box is not used here."""
    own = np.asarray(points, dtype=float)
    around = np.array([[-9.0] * 3, [9.0] * 3])
    return _core.Shape.convex(own, np.full(len(own), float(disc)), ball, np.broadcast_to(semi, 3).astype(float), around)


def placed(translation, rotation=None):
    at = np.eye(4)
    at[:3, :3] = np.eye(3) if rotation is None else rotation
    at[:3, 3] = translation
    return at


def bounds(shapes, at, direction=None, above=np.inf, below=-1.0):
    """(lower, upper, direction, weights, nearest point) of two shapes."""
    u = np.zeros(3) if direction is None else np.array(direction, dtype=float)
    return _core.bound_distance(*(core_shape(*shape) for shape in shapes), at, u, above, below, 1e-9)


def box(x, y, z):
    return SIGNS * (x / 2, y / 2, z / 2), 0.0, 0.0, 0.0


BALL, POINT = ([[0, 0, 0]], 0.0, 0.3, 0.0), ([[0, 0, 0]], 0.0, 0.0, 0.0)
CYLINDER, ELLIPSOID = ([[0, 0, -0.5], [0, 0, 0.5]], 0.2, 0.0, 0.0), ([[0, 0, 0]], 0.0, 0.0, (0.1, 0.2, 0.3))


@examples(200)
@given(at=st.tuples(numbers, numbers, numbers), start=st.tuples(numbers, numbers, numbers))
@example(at=(0.0, 2.0, 6e-8), start=(0.0, 0.0, 0.0))
def test_distance_of_axis_aligned_boxes_is_exact_from_any_start(at, start):
    sizes = np.array([[0.4, 0.6, 0.2], [0.3, 0.1, 0.5]])
    gap = np.abs(at) - sizes.sum(axis=0) / 2
    distance = float(np.linalg.norm(np.maximum(gap, 0)))
    lower, upper, u, _, _ = bounds([box(*sizes[0]), box(*sizes[1])], placed(at), start)
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
        lower, upper, _, _, _ = bounds([shape, POINT], placed(at))
        assert lower <= distance + 1e-12
        assert upper >= distance - 1e-12
        if distance > 1e-6:
            assert upper - lower <= 1e-7


@pytest.mark.parametrize("axis", range(3))
def test_ellipsoids_without_thickness_are_measured_across_it(axis):
    semi = np.roll([0.0, 0.2, 0.3], axis)
    for distance in (0.5, 2.0):
        at = distance * np.eye(3)[axis]
        lower, upper, _, _, _ = bounds([([[0, 0, 0]], 0.0, 0.0, semi), POINT], placed(at), at)
        assert (lower, upper) == pytest.approx((distance, distance), abs=1e-9)


@examples(150)
@given(data=st.data())
def test_support_gap_and_witness_points_equal_the_bounds(data):
    shapes = data.draw(st.lists(st.sampled_from([box(0.2, 0.3, 0.4), CYLINDER, ELLIPSOID]), min_size=2, max_size=2))
    at = np.array(data.draw(st.tuples(numbers, numbers, numbers)))
    turn = np.linalg.qr(np.random.default_rng(data.draw(st.integers(0, 10**6))).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    lower, upper, u, weights, nearest = bounds(shapes, placed(at, turn))

    def reach(shape, d):
        points, disc, ball, semi = shape
        return (np.asarray(points, float) @ d + disc * np.hypot(d[0], d[1])).max() + ball + np.linalg.norm(semi * d)

    gap = u @ at - reach(shapes[0], u) - reach(shapes[1], turn.T @ -u)
    assert lower == pytest.approx(gap, abs=1e-12)
    assert lower <= upper + 1e-12
    assert min(weights) >= 0
    assert sum(weights) == pytest.approx(1.0, abs=1e-9)
    if upper > 0:
        assert np.linalg.norm(nearest) == pytest.approx(upper, abs=1e-9)


@pytest.mark.parametrize("count", [4, 8, 9, 30, 100])
def test_hulls_of_random_points_are_measured_from_any_start(count):
    """The lower bound is the gap of the supports, the upper one is attained at points of both hulls, and they meet."""
    rng, apart = np.random.default_rng(count), 0
    for _ in range(60):
        own = [rng.normal(size=(count, 3)) * rng.uniform(0.05, 0.5, 3) for _ in range(2)]
        balls = rng.uniform(0, 0.2, 2) * rng.integers(0, 2, 2)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        at = rng.normal(size=3) * rng.choice([0.6, 2.0])
        shapes = [(points, 0.0, ball, 0.0) for points, ball in zip(own, balls, strict=True)]
        there = own[1] @ turn.T + at
        lower, upper, u, weights, nearest = bounds(shapes, placed(at, turn), rng.normal(size=3) * rng.integers(0, 2))
        gap = (there @ u).min() - (own[0] @ u).max() - balls.sum()
        assert lower == pytest.approx(gap, abs=1e-12)
        assert sum(weights) == pytest.approx(1.0, abs=1e-9)
        if upper > 1e-9:
            apart += 1
            assert upper - lower <= 1e-8
            assert np.linalg.norm(nearest) - balls.sum() == pytest.approx(upper, abs=1e-9)
        else:  # no direction separates them by more than rounding
            assert lower <= 1e-9
            some = rng.normal(size=(2000, 3))
            some /= np.linalg.norm(some, axis=1, keepdims=True)
            assert ((there @ some.T).min(axis=0) - (own[0] @ some.T).max(axis=0) - balls.sum()).max() <= 1e-9
        again = bounds(shapes, placed(at, turn), u)
        assert again[0] == pytest.approx(lower, abs=1e-8) or upper == 0.0
    assert apart >= 15


@pytest.mark.parametrize("noise", [0.0, 1e-17, 1e-16, 1e-15, 1e-13, 1e-11, 1e-9])
def test_bounds_hold_for_points_that_almost_coincide(noise):
    """Copies of the points of a hull, moved by about the rounding of numbers, give flat triangles and tetrahedra."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        few = [rng.normal(size=(int(rng.integers(1, 5)), 3)) * rng.choice([1.0, 1e-6], 3) for _ in range(2)]
        own = [np.concatenate([points + noise * rng.normal(size=points.shape) for _ in range(6)]) for points in few]
        at = rng.normal(size=3) * rng.choice([1.0, 3.0])
        shapes = [(points, 0.0, 0.0, 0.0) for points in own]
        lower, upper, u, weights, nearest = bounds(shapes, placed(at), rng.normal(size=3) * rng.integers(2))
        assert lower == pytest.approx((own[1] @ u).min() + at @ u - (own[0] @ u).max(), abs=1e-12)
        assert lower <= upper + 1e-12
        assert sum(weights) == pytest.approx(1.0, abs=1e-9)
        if upper > 0:
            assert np.linalg.norm(nearest) == pytest.approx(upper, abs=1e-9)
            assert upper - lower <= 1e-6
        turned = np.roll(np.arange(len(own[0])), 7)
        other = bounds([(own[0][turned], 0.0, 0.0, 0.0), shapes[1]], placed(at))
        assert other[0] <= upper + 1e-12
        assert other[1] >= lower - 1e-12


@pytest.mark.parametrize("thin", [0.0, 1e-300, 1e-160, 1e-12, 1e-9])
@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-3, 1.0])
def test_bounds_hold_for_flat_and_tiny_bodies(thin, apart):
    """Plates and needles without thickness give degenerate simplices, for which weights may be 0 / 0."""
    for sizes in ((1.0, 1.0, thin), (1.0, thin, thin), (thin, thin, thin)):
        for direction in ((0, 0, 1), (1, 1, 1), (1e-200, 0, 0)):
            lower, upper, _, _, _ = bounds([box(*sizes), box(*sizes)], placed((0, 0, apart + sizes[2])), direction)
            assert lower <= apart + 1e-12
            assert upper >= apart - 1e-12
            assert upper <= apart + 1e-8


def test_nan_gives_no_proven_distance():
    for at in ((np.nan, 0, 0), (np.inf, 0, 0), (1e308, 1e308, 1e308)):
        lower, upper, _, _, _ = bounds([box(1, 1, 1), box(1, 1, 1)], placed(at))
        assert lower == -np.inf or np.isfinite(at).all()
        assert upper > 0


def test_early_termination_returns_valid_bounds():
    shapes, at = [CYLINDER, box(0.2, 0.3, 0.4)], placed((1.0, 0.3, 0.2))
    exact, _, _, _, _ = bounds(shapes, at)
    lower, upper, _, _, _ = bounds(shapes, at, above=0.1)
    assert 0.1 < lower <= exact <= upper + 1e-12
    lower, upper, _, _, _ = bounds(shapes, at, below=5.0)
    assert lower <= exact <= upper <= 5.0
