"""The optimal joint motions of a FABRIK pass, against a search over all values of the joint."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.kernels.limits import TURN
from pinproof.kernels.step_fabrik import _allowed, _angle, _fit, _invert, _move

from ..examples import examples


def random_hinge(rng):
    direction = rng.normal(size=3)
    return rng.normal(size=3), direction / np.linalg.norm(direction)


def row(pose):
    return np.concatenate([pose.rotation.ravel(), pose.translation])


@examples(60)
@given(seed=st.integers(0, 10**6))
def test_the_chosen_angle_and_translation_are_optimal(seed):
    """No other angle or translation has the point and the direction closer to their targets."""
    rng = np.random.default_rng(seed)
    o, d = random_hinge(rng)
    x, e = random_hinge(rng)
    point, direction = rng.uniform(0.1, 2, 2)
    moved = np.zeros((3, 12))
    moved[0] = row(pp.pose(rng.normal(size=3), rng.normal(size=3)))
    moved[1, [0, 4, 8]] = 1.0
    wanted, shift = moved[0, :9].reshape(3, 3), moved[0, 9:]

    def miss(angle, along):
        _move(moved, 1, 2, *o, *d, angle, along)
        turn, off = moved[2, :9].reshape(3, 3), moved[2, 9:]
        there = turn @ x + off - wanted @ x - shift
        return point * there @ there + direction * np.sum(((turn - wanted) @ e) ** 2)

    along, c, s = _fit(*o, *d, moved, 0, point, *x, direction, *e)
    best = miss(_angle(s, c), 0.0)
    assert all(best <= miss(angle, 0.0) + 1e-9 for angle in np.linspace(-np.pi, np.pi, 200))
    best = miss(0.0, along / point)
    assert all(best <= miss(0.0, slide) + 1e-9 for slide in np.linspace(-6, 6, 200))


@examples(100)
@given(
    low=st.floats(-4, 3.9),
    width=st.floats(0.01, 6.2),
    share=st.floats(0, 1),
    change=st.floats(-np.pi, np.pi),
)
def test_the_allowed_change_is_within_limits_and_closest_on_the_circle(low, width, share, change):
    box = np.array([[low], [low + width], [low], [low + width], [0.0]])
    value = low + share * width
    got = _allowed(box, 0, value, change)
    assert low - 1e-12 <= value + got <= low + width + 1e-12

    def away(other):
        return abs((other - change + np.pi) % TURN - np.pi)

    inside = np.linspace(low, low + width, 300) - value
    assert away(got) <= away(inside).min() + 1e-6


def test_a_joint_with_a_range_of_2_pi_is_not_stopped():
    box = np.array([[-np.pi], [np.pi], [-np.inf], [np.inf], [1.0]])
    assert _allowed(box, 0, 3.0, 2.0) == 2.0


@examples(30)
@given(seed=st.integers(0, 10**6))
def test_a_motion_times_its_inverse_is_the_identity(seed):
    rng = np.random.default_rng(seed)
    moved = np.zeros((2, 12))
    pose = pp.pose(rng.normal(size=3), rng.normal(size=3))
    moved[0] = row(pose)
    _invert(moved, 0, 1)
    assert moved[1] == pytest.approx(row(pose.inverse()), abs=1e-12)
