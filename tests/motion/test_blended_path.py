"""Rounded corners: on the legs, within the deviation, twice differentiable; stops only where requested."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.motion import REVERSAL, Bezier, Curve, corner_distance

from ..examples import examples

NAMES = ("a", "b", "c")


def derivatives(path: pp.motion.BlendedPath) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First and second derivative (k, points, n) as Bernstein coefficients, over the path's knots."""
    return path.knots, path.derivative(1).control, path.derivative(2).control


@st.composite
def polylines(draw: st.DrawFn) -> tuple[pp.JointPath, np.ndarray]:
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
    return pp.JointPath(q, NAMES), reach


@examples(60)
@given(polylines())
def test_smooth_but_at_the_stops_and_on_the_polyline_elsewhere(drawn: tuple[pp.JointPath, np.ndarray]) -> None:
    path, reach = drawn
    smooth = pp.motion.BlendedPath.rounded(path, reach)
    assert isinstance(smooth, Curve)
    assert np.array_equal(smooth.start, path.start)
    assert np.array_equal(smooth.end, path.end)
    knots, first, second = derivatives(smooth)
    assert np.abs(second[:, [0, -1]]).max() < 1e-6 * np.abs(second).max() + 1e-8
    step = np.abs(first[1:, 0] - first[:-1, -1]).max(axis=1)
    for knot, gap in zip(knots[1:-1], step, strict=True):
        assert knot in smooth.corners or gap < 1e-5
    speed = np.linalg.norm(Bezier(knots, first).at(np.linspace(*smooth.domain, 500)), axis=1)
    assert speed.max() < 1.02
    assert speed.min() > 0.04  # the sharpest corners are slow in their middle
    assert smooth.length <= path.length * (1 + 1e-9)


@examples(60)
@given(st.floats(0.0, 0.95 * np.pi), st.floats(0.01, 1.0))
def test_the_stated_corner_deviation_is_exact(turn: float, reach: float) -> None:
    q = np.array([(-1.0, 0, 0), (0, 0, 0), (np.cos(turn), np.sin(turn), 0)])
    line = np.diff(q, axis=0)
    smooth = pp.motion.BlendedPath.rounded(pp.JointPath(q, NAMES), [0, reach, 0])
    points = smooth(np.linspace(*smooth.domain, 4001))
    nearest = np.linalg.norm(points, axis=1).min()
    assert nearest == pytest.approx(reach * float(corner_distance(line[:1], line[1:])[0]), abs=2e-3 * reach)
    # nowhere is the curve farther from the legs than at its middle
    legs = [np.linalg.norm(points - np.clip(points @ leg, *ends)[:, None] * leg, axis=1)
            for leg, ends in ((line[0], (-1, 0)), (line[1], (0, 1)))]  # fmt: skip
    assert np.minimum(*legs).max() <= nearest + 1e-9


def test_three_times_differentiable_inside_and_twice_at_the_joins_by_finite_differences() -> None:
    path = pp.JointPath([(0, 0, 0), (1, 0, 0), (1, 1, 0.5), (0, 1, 1)], NAMES)
    smooth = pp.motion.BlendedPath.rounded(path, [0, 0.4, 0.3, 0])
    assert smooth.corners == ()
    h = 1e-4
    for knot in smooth.knots[1:-1]:
        before, behind = (smooth(knot + side * h * np.arange(3)) for side in (-1, 1))
        assert np.allclose((before[0] - before[1]) / h, (behind[1] - behind[0]) / h, atol=1e-5)
        for points in (before, behind):
            assert (
                np.abs(np.diff(points, 2, axis=0)).max() / h**2 < 0.1
            )  # it is 0 at the join and grows at a bounded rate
    assert np.abs(np.diff(smooth(np.linspace(0.65, 0.75, 50)), 2, axis=0)).max() > 0


def test_the_corner_that_is_kept_is_a_stop() -> None:
    path = pp.JointPath([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], NAMES)
    smooth = pp.motion.BlendedPath.rounded(path, [0, 0.5, 0, 0])
    assert len(smooth.corners) == 1
    assert np.array_equal(smooth(smooth.corners[0]), path.q[2])
    assert len(pp.motion.BlendedPath.rounded(path, np.zeros(4)).corners) == 2
    straight = pp.JointPath([(0, 0, 0), (1, 0, 0), (3, 0, 0)], NAMES)
    assert pp.motion.BlendedPath.rounded(straight, np.zeros(3)).corners == ()  # no corner where nothing turns


def test_length_is_that_of_a_dense_sample() -> None:
    path = pp.JointPath([(0, 0, 0), (1, 0, 0), (1, 1, 0.5), (0, 1, 1)], NAMES)
    smooth = pp.motion.BlendedPath.rounded(path, [0, 0.5, 0.4, 0])
    dense = np.linalg.norm(np.diff(smooth(np.linspace(*smooth.domain, 100_001)), axis=0), axis=1).sum()
    assert smooth.length == pytest.approx(dense, rel=1e-8)
    assert smooth.length < path.length


def test_roundings_may_fill_a_complete_segment() -> None:
    path = pp.JointPath([(0, 0, 0), (0.3, 0, 0), (0.3, 0.3, 0), (0.6, 0.3, 0)], NAMES)
    smooth = pp.motion.BlendedPath.rounded(path, [0, 0.15, 0.15, 0])
    assert len(smooth) == 4
    assert smooth.corners == ()


def test_values_are_frozen_pickled_and_turned_round_exactly() -> None:
    path = pp.JointPath([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], NAMES)
    smooth = pp.motion.BlendedPath.rounded(path, [0, 0.4, 0, 0])
    again = pickle.loads(pickle.dumps(smooth))
    assert again.control.tobytes() == smooth.control.tobytes()
    assert again.corners == smooth.corners
    for array in (smooth.knots, smooth.control, again.knots, again.control):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    back = smooth.reversed()
    t = np.linspace(0, 1, 101) * smooth.domain[1]
    assert np.allclose(back(t), smooth(smooth.domain[1] - t), atol=1e-12)
    assert np.array_equal(back(back.corners[0]), path.q[2])
    assert back.reversed().is_close(smooth, 1e-12)
    assert not back.is_close(smooth)


def test_joined_curves_stop_only_where_derivatives_differ() -> None:
    curve = pp.motion.CubicPath.through([(0, 0, 0), (1, 0.5, 0), (2, 0, 1)], NAMES)
    straight = pp.JointPath([(2, 0, 1), (2, 0, 1), (3, 1, 1)], NAMES)
    both = pp.motion.BlendedPath.join(curve, straight)
    assert len(both) == 3  # the piece that stands still is gone
    assert both.corners == (curve.domain[1],)
    t = np.linspace(*curve.domain, 50)
    assert np.allclose(both(t), curve(t), atol=1e-14)
    assert np.array_equal(both.end, straight.end)
    knots = curve.knots
    halves = (
        pp.motion.CubicPath(curve.q[i : i + 2], curve.tangents[i : i + 2], knots[i : i + 2], NAMES) for i in (0, 1)
    )
    assert pp.motion.BlendedPath.join(*halves).corners == ()
    still = pp.JointPath([(2, 0, 1)], NAMES)
    assert pp.motion.BlendedPath.join(still, still).domain == (0.0, 0.0)
    with pytest.raises(pp.InputError, match="do not meet"):
        pp.motion.BlendedPath.join(straight, curve)


def test_a_path_without_motion() -> None:
    still = pp.motion.BlendedPath.rounded(pp.JointPath([(1, 2, 3)], NAMES), [0])
    assert still.domain == (0.0, 0.0)
    assert still(0.0).tolist() == [1, 2, 3]
    assert still.length == 0
    assert still.reversed().is_close(still)


@pytest.mark.parametrize(
    ("reach", "word"),
    [([0, 0.6, 0.6, 0], "overlap"), ([0, -0.1, 0, 0], "0 or more"), ([0.1, 0, 0, 0], "both ends"), ([0, 0], "4 num")],
)
def test_a_reach_that_makes_no_sense(reach: list[float], word: str) -> None:
    path = pp.JointPath([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], NAMES)
    with pytest.raises(pp.InputError, match=word):
        pp.motion.BlendedPath.rounded(path, reach)


def test_invalid_paths_are_refused() -> None:
    with pytest.raises(pp.InputError, match="waypoint 1"):
        pp.motion.BlendedPath.rounded(pp.JointPath([(0, 0, 0), (1, 0, 0), (0, 0, 0)], NAMES), [0, 0.1, 0])
    with pytest.raises(pp.InputError, match="equal"):
        pp.motion.BlendedPath.rounded(pp.JointPath([(0, 0, 0), (0, 0, 0), (1, 0, 0)], NAMES), [0, 0, 0])
    line = np.array([[(0, 0, 0), (1, 0, 0)], [(1, 0, 0), (1, 1, 0)]], dtype=float)
    with pytest.raises(pp.InputError, match="jumps at"):
        pp.motion.BlendedPath([0, 1, 2], line, NAMES)
    assert pp.motion.BlendedPath([0, 1, 2], line, NAMES, [1.0]).corners == (1.0,)
    with pytest.raises(pp.InputError, match="inner knots"):
        pp.motion.BlendedPath([0, 1, 2], line, NAMES, [0.5])
    with pytest.raises(pp.InputError, match="do not meet"):
        pp.motion.BlendedPath([0, 1, 2], line + np.array([0, 1e-9])[:, None, None], NAMES, [1.0])
    with pytest.raises(pp.InputError, match="do not meet"):  # in one joint only
        pp.motion.BlendedPath([0, 1, 2], line + np.array([0, 1e-9])[:, None, None] * [0, 1, 0], NAMES, [1.0])
    with pytest.raises(pp.InputError, match="increase"):
        pp.motion.BlendedPath([0, 1, 1], line, NAMES, [1.0])
    with pytest.raises(pp.InputError, match="degree"):
        pp.motion.BlendedPath([0, 1], np.zeros((1, 8, 3)), NAMES)
    with pytest.raises(pp.InputError, match="zero width"):
        pp.motion.BlendedPath([0, 0], line[:1], NAMES)
