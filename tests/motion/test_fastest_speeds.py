"""The fastest speeds along a path, against linear programs over all nodes at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof._core import fastest_speeds

from ..examples import examples


def grid(seed, steps, joints):
    rng = np.random.default_rng(seed)
    nodes = np.cumsum(np.concatenate([[0.0], rng.uniform(0.05, 0.3, steps)]))
    phase, weight = rng.uniform(0, 6, joints), rng.uniform(0.2, 2, joints)
    slope = weight * np.cos(3 * nodes[:, None] + phase)
    curvature = -3 * weight * np.sin(3 * nodes[:, None] + phase)
    both = [np.stack([values[:-1], values[1:]], axis=1) for values in (slope, curvature)]
    ceiling = (rng.uniform(0.5, 3, joints) / np.abs(slope)).min(axis=1) ** 2
    bound = np.broadcast_to(rng.uniform(0.5, 5, joints), both[0].shape).copy()
    gamma = bound * rng.uniform(-0.9, 0.9, joints) * rng.integers(0, 2)
    return (*both, gamma, bound, np.diff(nodes), ceiling)


def largest_by_lp(slope, curvature, gamma, bound, step, ceiling, start, end):
    """x at every node: the largest from which the end is reachable; None if the path is infeasible."""
    from scipy.optimize import linprog

    steps, _, joints = slope.shape
    rows, bounds = [], []
    for i in range(steps):
        for side in range(2):
            for j in range(joints):
                row = np.zeros(steps + 1)
                row[i], row[i + 1] = -slope[i, side, j] / (2 * step[i]), slope[i, side, j] / (2 * step[i])
                row[i + side] += curvature[i, side, j]
                for sign in (1, -1):
                    rows.append(sign * row)
                    bounds.append(bound[i, side, j] - sign * gamma[i, side, j])
    limits = [(0.0, top) for top in ceiling]
    limits[0], limits[-1] = (start, start), (end, end)
    for node in range(steps + 1):
        program = linprog(-np.eye(steps + 1)[node], np.array(rows), np.array(bounds), bounds=limits, method="highs")
        if not program.success:
            return None
        limits[node] = (program.x[node] * (1 - 1e-10), program.x[node])
    return program.x


@examples(50)
@given(st.integers(0, 2**32 - 1), st.integers(2, 7), st.integers(1, 7), st.floats(0, 1), st.floats(0, 1))
def test_speeds_equal_the_linear_programming_optimum(seed, steps, joints, start, end):
    problem = grid(seed, steps, joints)
    start, end = start**2 * problem[-1][0], end**2 * problem[-1][-1]
    x, stuck = fastest_speeds(*problem, start, end)
    expected = largest_by_lp(*problem, start, end)
    if expected is None or stuck is not None:  # both, but on the brink itself
        wider, narrower = (
            (*problem[:3], problem[3] * scale, *problem[4:], start, end) for scale in (1 + 1e-6, 1 - 1e-6)
        )
        assert stuck is not None or largest_by_lp(*wider) is not None
        assert expected is None or largest_by_lp(*narrower) is None
        return
    np.testing.assert_allclose(x, expected, rtol=1e-5, atol=1e-7)


def test_the_motion_stops_at_a_node_with_ceiling_0():
    slope = np.ones((4, 2, 1))
    ceiling = np.array([0.0, 9, 0, 9, 0])
    x, stuck = fastest_speeds(slope, 0 * slope, 0 * slope, 2 * slope, np.ones(4), ceiling, 0.0, 0.0)
    assert stuck is None
    np.testing.assert_allclose(x, [0, 4, 0, 4, 0])


@pytest.mark.parametrize(("start", "end", "stuck"), [(9.0, 0.0, 0), (0.0, 9.0, 0), (0.0, 17.0, 4)])
def test_infeasible_end_speeds_are_reported(start, end, stuck):
    slope = np.ones((4, 2, 1))
    ceiling = np.full(5, 16.0)
    assert fastest_speeds(slope, 0 * slope, 0 * slope, slope, np.ones(4), ceiling, start, end)[1] == stuck


def test_a_nearly_resting_joint_limits_the_speed_by_its_curvature():
    for tiny in (0.0, 5e-324, 1e-310, 1e-200):
        slope = np.array([[[1.0], [tiny]], [[tiny], [-1.0]]])
        curvature = np.full((2, 2, 1), -1.0)
        x, stuck = fastest_speeds(
            slope, curvature, 0 * slope, np.full_like(slope, 4.0), np.ones(2), np.full(3, 100.0), 0.0, 0.0
        )
        assert stuck is None
        assert 0 < x[1] <= 4.0
