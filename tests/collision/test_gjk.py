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
    """A shape of points (V, 3), each with a disc, and of a ball and semi axes, within a box that is large."""
    own = np.asarray(points, dtype=float)
    around = np.array([[-9.0] * 3, [9.0] * 3])
    return _core.Shape.convex(own, np.full(len(own), float(disc)), ball, np.broadcast_to(semi, 3).astype(float), around)


def placed(translation, rotation=None):
    at = np.eye(4)
    at[:3, :3] = np.eye(3) if rotation is None else rotation
    at[:3, 3] = translation
    return at


def workspace(shapes, at, direction=None, margin=0.0):
    """Two shapes with the second at a pose in the frame of the first, and how far the first has been moved to there.

    The search for the distance of two bodies of a robot begins with the direction between them at zero: a prismatic
    joint moves the first by 9 m along the direction where it must begin.
    """
    u = np.zeros(3) if direction is None else np.array(direction, dtype=float)
    begins = bool(u.any())
    along = u / np.abs(u).max() if begins else np.array([0.0, 0.0, 1.0])
    turn = np.linalg.qr(np.column_stack([along, np.eye(3)]))[0][:, [1, 2, 0]]
    turn *= np.sign(turn[:, 2] @ along)
    travel = 9.0 * turn[:, 2] * begins
    joint = _core.Joint(before=placed((0, 0, 0), turn), prismatic=True, index=0, multiplier=1.0, offset=0.0)
    bodies = [
        _core.Body(core_shape(*shapes[0]), 0, placed((0, 0, 0), turn.T)),
        _core.Body(core_shape(*shapes[1]), -1, placed(at[:3, 3] + travel, at[:3, :3])),
    ]
    count = 2 if begins else 1
    obstacles = _core.Obstacles(bodies[count:])
    geometry = _core.Geometry(_core.JointTree([joint], 1), bodies[:count], obstacles, 1e-12)
    space = _core.Workspace(_core.World(geometry, _core.PairTable(geometry, np.array([[0, 1]])), np.array([margin])))
    space.place(np.array([9.0 * begins]))
    return space, travel


def bounds(shapes, at, direction=None):
    """(lower, upper, direction, closest points of both) of two shapes, in the frame of the first."""
    space, travel = workspace(shapes, at, direction)
    lower, upper, points, u, *_ = space.measure(0)
    return lower, upper, u, points - travel


def reach(shape, d):
    """The largest d . x over the points x of a shape, for directions d (..., 3)."""
    points, disc, ball, semi = shape
    core = (d @ np.asarray(points, float).T).max(axis=-1) + disc * np.hypot(d[..., 0], d[..., 1])
    return core + ball * np.linalg.norm(d, axis=-1) + np.linalg.norm(np.asarray(semi) * d, axis=-1)


def assert_attained(shapes, at, upper, points):
    """The upper bound is the distance of the two points, and each is a point of its shape."""
    some = np.random.default_rng(0).normal(size=(40, 3))
    assert np.linalg.norm(points[1] - points[0]) == pytest.approx(upper, abs=1e-9)
    local = points[0], at[:3, :3].T @ (points[1] - at[:3, 3])
    for shape, point in zip(shapes, local, strict=True):
        assert (some @ point <= reach(shape, some) + 1e-9).all()


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


@pytest.mark.parametrize("axis", range(3))
def test_ellipsoids_without_thickness_are_measured_across_it(axis):
    semi = np.roll([0.0, 0.2, 0.3], axis)
    for distance in (0.5, 2.0):
        at = distance * np.eye(3)[axis]
        lower, upper, _, _ = bounds([([[0, 0, 0]], 0.0, 0.0, semi), POINT], placed(at), at)
        assert (lower, upper) == pytest.approx((distance, distance), abs=1e-9)


@examples(150)
@given(data=st.data())
def test_support_gap_and_witness_points_equal_the_bounds(data):
    shapes = data.draw(st.lists(st.sampled_from([box(0.2, 0.3, 0.4), CYLINDER, ELLIPSOID]), min_size=2, max_size=2))
    at = np.array(data.draw(st.tuples(numbers, numbers, numbers)))
    turn = np.linalg.qr(np.random.default_rng(data.draw(st.integers(0, 10**6))).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    lower, upper, u, points = bounds(shapes, placed(at, turn))
    gap = u @ at - reach(shapes[0], u) - reach(shapes[1], turn.T @ -u)
    assert lower == pytest.approx(gap, abs=1e-12)
    assert lower <= upper + 1e-12
    if upper > 0:
        assert_attained(shapes, placed(at, turn), upper, points)


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
        lower, upper, u, points = bounds(shapes, placed(at, turn), rng.normal(size=3) * rng.integers(0, 2))
        gap = (there @ u).min() - (own[0] @ u).max() - balls.sum()
        assert lower == pytest.approx(gap, abs=1e-12)
        if upper > 1e-9:
            apart += 1
            assert upper - lower <= 1e-8
            assert_attained(shapes, placed(at, turn), upper, points)
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
        lower, upper, u, points = bounds(shapes, placed(at), rng.normal(size=3) * rng.integers(2))
        assert lower == pytest.approx((own[1] @ u).min() + at @ u - (own[0] @ u).max(), abs=1e-12)
        assert lower <= upper + 1e-12
        if upper > 0:
            assert_attained(shapes, placed(at), upper, points)
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
        for direction in ((0, 0, 1), (1, 1, 1), (1, 0, 0)):
            lower, upper, _, _ = bounds([box(*sizes), box(*sizes)], placed((0, 0, apart + sizes[2])), direction)
            assert lower <= apart + 1e-12
            assert upper >= apart - 1e-12
            assert upper <= apart + 1e-8


@pytest.mark.parametrize("far", [np.nan, np.inf, 1e308])
def test_numbers_that_overflow_give_no_proven_distance(far):
    space, _ = workspace([box(1, 1, 1), box(1, 1, 1)], placed((0, 0, 0)), (1, 1, 1))
    space.place(np.array([far]))
    lower, upper, *_ = space.measure(0)
    assert lower == -np.inf or np.isfinite(far)
    assert upper > 0


@examples(150)
@given(data=st.data())
def test_contact_is_decided_on_both_sides_of_the_margin(data):
    """The search ends as soon as a bound decides; the distance without an early end is the reference."""
    kinds = st.sampled_from([box(0.2, 0.3, 0.4), CYLINDER, ELLIPSOID, BALL])
    shapes, at = data.draw(st.tuples(kinds, kinds)), placed(data.draw(st.tuples(numbers, numbers, numbers)))
    lower, upper, _, _ = bounds(shapes, at)
    for margin in (lower - 1e-6, upper + 1e-6, upper + 0.1):
        if margin > 0:
            space, _ = workspace(shapes, at, margin=margin)
            assert space.judge(np.zeros(1)) == (_core.CONTACT if margin > upper else 0)
    q = np.zeros(1)
    overlapping, below, above, pair = workspace(shapes, at)[0].find_nearest(q)
    assert overlapping == ([0] if lower <= 0 else [])
    if lower > 0:
        assert (below, above, pair) == (pytest.approx(lower, abs=1e-9), pytest.approx(upper, abs=1e-9), 0)


@pytest.mark.parametrize("count", [17, 150, 1024])
def test_the_farthest_point_of_a_hull_is_found_along_every_direction(count):
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3))
    points[: count // 2] = np.round(points[: count // 2])  # several points may be the farthest one
    hull = _core.Body(core_shape(points, 0.0, 0.0, 0.0), 0, np.eye(4))
    joint = _core.Joint(before=np.eye(4), prismatic=True, index=0, multiplier=1.0, offset=0.0)
    # Also directions between the cells into which the core sorts them, with zeros of both signs.
    borders = np.array(list(itertools.product((-1.0, -0.5, -0.0, 0.0, 0.5, 1.0), repeat=3)))
    for normal in [*rng.normal(size=(200, 3)), *borders[borders.any(axis=1)]]:
        turn = np.linalg.qr(np.column_stack([normal, np.eye(3)]))[0][:, [1, 2, 0]]
        turn *= np.sign(turn[:, 2] @ normal)
        plane = _core.Body(_core.Shape.half_space(np.array([[-9.0] * 3, [9.0] * 3])), -1, placed((0, 0, 0), turn))
        geometry = _core.Geometry(_core.JointTree([joint], 1), [hull], _core.Obstacles([plane]), 1e-12)
        pairs = _core.PairTable(geometry, np.array([[0, 1]]))
        space = _core.Workspace(_core.World(geometry, pairs, np.array([0.0])))
        assert space.measure(0)[0] == pytest.approx((points @ turn[:, 2]).min(), abs=1e-12)
