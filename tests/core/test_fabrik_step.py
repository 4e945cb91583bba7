"""The optimal joint motions of a FABRIK pass, against a search over all values of the joint."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof import _core

from ..examples import examples

TURN = 2 * np.pi


def random_hinge(rng):
    direction = rng.normal(size=3)
    return rng.normal(size=3), direction / np.linalg.norm(direction)


@examples(60)
@given(seed=st.integers(0, 10**6))
def test_the_chosen_angle_and_translation_are_optimal(seed):
    """No other angle or translation has the point and the direction closer to their targets."""
    rng = np.random.default_rng(seed)
    o, d = random_hinge(rng)
    x, e = random_hinge(rng)
    point, direction = rng.uniform(0.1, 2, 2)
    wanted = pp.pose(rng.normal(size=3), rng.normal(size=3)).homogeneous

    def miss(angle, along):
        motion = _core.hinge_motion(o, d, False, angle) @ _core.hinge_motion(o, d, True, along)
        off = ((motion - wanted) @ [*x, 1.0])[:3]
        return point * off @ off + direction * np.sum(((motion - wanted)[:3, :3] @ e) ** 2)

    angle, along = _core.hinge_fit(o, d, wanted, point, x, direction, e)
    best = miss(angle, 0.0)
    assert all(best <= miss(other, 0.0) + 1e-9 for other in np.linspace(-np.pi, np.pi, 200))
    best = miss(0.0, along)
    assert all(best <= miss(0.0, slide) + 1e-9 for slide in np.linspace(-6, 6, 200))


@examples(100)
@given(
    low=st.floats(-4, 3.9),
    width=st.floats(0.01, 6.2),
    share=st.floats(0, 1),
    change=st.floats(-np.pi, np.pi),
)
def test_the_allowed_change_is_within_limits_and_closest_on_the_circle(low, width, share, change):
    value = low + share * width
    got = _core.JointRange(low, low + width, True, False).allowed_change(value, change)
    assert low - 1e-12 <= value + got <= low + width + 1e-12

    def away(other):
        return abs((other - change + np.pi) % TURN - np.pi)

    inside = np.linspace(low, low + width, 300) - value
    assert away(got) <= away(inside).min() + 1e-6


def test_a_joint_with_a_range_of_2_pi_is_not_stopped():
    assert _core.JointRange(-np.pi, np.pi, True, True).allowed_change(3.0, 2.0) == 2.0


@examples(30)
@given(seed=st.integers(0, 10**6), prismatic=st.booleans(), value=st.floats(-7, 7))
def test_a_hinge_moves_points_about_its_axis(seed, prismatic, value):
    rng = np.random.default_rng(seed)
    o, d = random_hinge(rng)
    quaternion = [*(np.sin(value / 2) * d), np.cos(value / 2)]
    there = pp.pose(value * d) if prismatic else pp.pose(o) * pp.pose(quat_xyzw=quaternion) * pp.pose(-o)
    motion = _core.hinge_motion(o, d, prismatic, value)
    assert motion == pytest.approx(there.homogeneous, abs=1e-12)
    assert motion @ _core.hinge_motion(o, d, prismatic, -value) == pytest.approx(np.eye(4), abs=1e-12)
