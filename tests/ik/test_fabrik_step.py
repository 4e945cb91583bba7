"""The parts of a pass of FABRIK: the compiled passes are equal to these (see test_fabrik.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.ik.fabrik import _Passes
from pinproof.spatial import matrix

from ..examples import examples

TURN = 2 * np.pi


def passes(prismatic: bool = False, low: float = -np.inf, high: float = np.inf) -> Any:
    """The step of an arm with one joint, whose changes stop at these limits."""
    step: Any = _Passes(None, 0.0)  # type: ignore[arg-type]
    step._prismatic, step._position_weight = [prismatic], 1.0
    step._low, step._high = np.array([low]), np.array([high])
    return step


def random_hinge(rng: np.random.Generator) -> np.ndarray:
    direction = rng.normal(size=3)
    return np.array([rng.normal(size=3), direction / np.linalg.norm(direction)])


@examples(60)
@given(seed=st.integers(0, 10**6))
def test_the_chosen_angle_and_translation_are_optimal(seed):
    """No other angle or translation has the points and the direction closer to their targets."""
    rng = np.random.default_rng(seed)
    hinge, end, other_end = (random_hinge(rng) for _ in range(3))
    heavy, light = rng.uniform(0.1, 2, 2)
    wanted = pp.pose(rng.normal(size=3), rng.normal(size=3)).homogeneous
    weight = _Passes(None, 0.0)._constants.HINGE_HALF_LENGTH ** 2  # type: ignore[arg-type]
    ends = [(heavy, end), (light, other_end[:1])]

    def miss(kind: bool, value: float) -> float:
        off = passes(kind)._motion(0, hinge, value) - wanted
        points = sum(share * np.sum((off @ [*one[0], 1.0])[:3] ** 2) for share, one in ends)
        return float(points + heavy * weight * np.sum((off[:3, :3] @ end[1]) ** 2))

    for kind, others in ((False, np.linspace(-np.pi, np.pi, 200)), (True, np.linspace(-6, 6, 200))):
        best = miss(kind, passes(kind)._best(0, hinge, wanted, ends))
        assert all(best <= miss(kind, other) + 1e-9 for other in others)


@examples(100)
@given(
    low=st.floats(-4, 3.9),
    width=st.floats(0.01, 6.2),
    share=st.floats(0, 1),
    change=st.floats(-np.pi, np.pi),
)
def test_the_allowed_change_is_within_limits_and_closest_on_the_circle(low, width, share, change):
    value = low + share * width
    got = passes(False, low, low + width)._allowed(0, value, change)
    assert low - 1e-12 <= value + got <= low + width + 1e-12

    def away(other):
        return abs((other - change + np.pi) % TURN - np.pi)

    inside = np.linspace(low, low + width, 300) - value
    assert away(got) <= away(inside).min() + 1e-6


def test_a_joint_that_is_not_stopped_has_every_change():
    assert passes()._allowed(0, 3.0, 2.0) == 2.0


@examples(30)
@given(seed=st.integers(0, 10**6), prismatic=st.booleans(), value=st.floats(-7, 7))
def test_a_hinge_moves_points_about_its_axis(seed, prismatic, value):
    o, d = hinge = random_hinge(np.random.default_rng(seed))
    quaternion = [*(np.sin(value / 2) * d), np.cos(value / 2)]
    there = pp.pose(value * d) if prismatic else pp.pose(o) * pp.pose(quat_xyzw=quaternion) * pp.pose(-o)
    motion = passes(prismatic)._motion(0, hinge, value)
    assert motion == pytest.approx(matrix(there), abs=1e-12)
    assert motion @ passes(prismatic)._motion(0, hinge, -value) == pytest.approx(np.eye(4), abs=1e-12)
