"""The speeds along a path against toppra's, and why toppra's own trajectories are not taken."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinproof.motion import BlendedPath, JointPath, time_parametrise

from ..examples import examples
from .timing_problems import limits_of, names, rounded_problems, smooth_problems

toppra = pytest.importorskip("toppra")
toppra.setup_logging("ERROR")


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
    from toppra.algorithm import TOPPRA
    from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

    knots = path.bezier()[0]
    s = np.unique(np.concatenate([np.linspace(a, b, steps + 1) for a, b in pairwise(knots)]))
    both = [np.stack([-limit, limit], axis=1) for limit in (limits.velocity, limits.acceleration)]
    constraints = [JointVelocityConstraint(both[0]), JointAccelerationConstraint(both[1])]
    problem = TOPPRA(constraints, Geometric(path), gridpoints=s, solver_wrapper="seidel")
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
    from pinproof._core import fastest_speeds
    from pinproof.motion import CubicPath

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
    from scipy.interpolate import CubicSpline

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
