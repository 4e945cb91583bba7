"""The fastest speeds along a path, against linear programs over all nodes at once, and against toppra's."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.optimize import linprog

from pinproof._core import fastest_speeds
from pinproof.motion import BlendedPath, CubicPath, JointPath, time_parametrise

from ..examples import examples
from .timing_problems import limits_of, names, rounded_problems, smooth_problems


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


# -- toppra: its speeds, and why its own trajectories are not taken --------------------------------------------


class Geometric:
    """A path as toppra wants it: evaluated with its derivatives by the parameter."""

    def __init__(self, path):
        self._derivatives = [path.derivative(order) for order in range(3)]
        self.dof = len(path.joint_names)
        self.path_interval = np.array(path.domain)

    def __call__(self, s, order=0):
        return self._derivatives[order].at(s)


def toppra_speeds(path, limits, steps):
    """Nodes and speeds there, of toppra's fastest motion from rest to rest; the knots are among the nodes."""
    toppra = pytest.importorskip("toppra")
    toppra.setup_logging("ERROR")
    rates = toppra.constraint.JointVelocityConstraint, toppra.constraint.JointAccelerationConstraint
    knots = path.bezier()[0]
    s = np.unique(np.concatenate([np.linspace(a, b, steps + 1) for a, b in pairwise(knots)]))
    both = [np.stack([-limit, limit], axis=1) for limit in (limits.velocity, limits.acceleration)]
    constraints = [kind(limit) for kind, limit in zip(rates, both, strict=True)]
    problem = toppra.algorithm.TOPPRA(constraints, Geometric(path), gridpoints=s, solver_wrapper="seidel")
    return s, problem.compute_parameterization(0.0, 0.0)[1]


smooth = smooth_problems()
rounded = rounded_problems().map(lambda problem: problem[1:]).filter(lambda problem: not problem[0].corners)


@examples(25)
@given(st.one_of(smooth, rounded))
def test_motions_are_within_two_percent_of_toppras_optimum(problem):
    path, limits = problem
    s, speed = toppra_speeds(path, limits, 60)
    if speed is None or not np.isfinite(speed).all():  # toppra fails at times, pinproof does not
        time_parametrise(path, limits)
        return
    optimum = float((2 * np.diff(s) / (speed[:-1] + speed[1:])).sum())
    assert time_parametrise(path, limits).duration <= 1.02 * optimum + 1e-4


def test_the_core_finds_toppras_speeds():
    u = np.linspace(0, 1, 9)[:, None]
    path = CubicPath.through(np.hstack([np.sin(5 * u), np.cos(3 * u), u**2]), names(3), u[:, 0])
    limits = limits_of([1, 2, 1], [3, 2, 4])
    s, theirs = toppra_speeds(path, limits, 12)
    slope, curvature = (path.derivative(order).at(s) for order in (1, 2))
    sides = [np.stack([values[:-1], values[1:]], axis=1) for values in (slope, curvature)]  # C2: both sides are equal
    ceiling = ((limits.velocity / np.abs(slope).clip(1e-9)).min(axis=1)) ** 2
    ceiling[[0, -1]] = 0.0
    acceleration = np.broadcast_to(limits.acceleration, sides[0].shape).copy()
    x, stuck = fastest_speeds(*sides, np.zeros_like(acceleration), acceleration, np.diff(s), ceiling, 0.0, 0.0)
    assert stuck is None
    np.testing.assert_allclose(np.sqrt(x), theirs, rtol=2e-3, atol=1e-3)  # toppra shortens each step by 1e-4


def test_toppras_trajectories_exceed_limits_and_leave_the_path():
    """What a user of it would export: a spline through the points at the times of its nodes."""
    square = JointPath([[0, 0], [2, 0], [2, 2], [0, 2]], names(2))
    path = BlendedPath.rounded(square, [0, 0.3, 0.3, 0])
    limits = limits_of([1, 1], [2, 2])
    s, speed = toppra_speeds(path, limits, 4)
    times = np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / (speed[:-1] + speed[1:]))])
    spline = CubicSpline(times, path(s), bc_type="clamped")
    t = np.linspace(0, times[-1], 20_001)
    assert np.abs(spline(t, 2)).max() > 2 * 1.05
    assert np.abs(spline(t, 1)).max() > 1.0005
    ours = time_parametrise(path, limits)
    assert (ours.max_acceleration() <= 2 * (1 + 1e-9)).all()
    assert (ours.max_velocity() <= 1 + 1e-9).all()


@pytest.mark.parametrize("grid", [5, 20])
def test_toppra_takes_time_where_start_is_goal_nearly(grid):
    """Its absolute tolerances bite on tiny moves; ours takes the textbook's time."""
    tiny = JointPath([[0.0], [1e-8]], names(1))
    exact = 2 * np.sqrt(1e-8 / 2.0)
    assert time_parametrise(tiny, limits_of([1], [2])).duration == pytest.approx(exact, rel=1e-4)
    s, speed = toppra_speeds(tiny, limits_of([1], [2]), grid)
    usable = speed is not None and np.isfinite(speed).all() and (speed[:-1] + speed[1:] > 0).all()
    assert not usable or (2 * np.diff(s) / (speed[:-1] + speed[1:])).sum() > 1.001 * exact
