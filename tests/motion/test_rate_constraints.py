"""Timing with limits beside those of the joints."""

import re

import numpy as np
import pytest

from pinproof import InputError
from pinproof.errors import TimingError
from pinproof.motion import Bezier, BlendedPath, CubicPath, JointPath, RateConstraint, time_parametrise

from .timing_problems import RELATIVE, assert_on_path, assert_within, limits_of, names

U = np.linspace(0, 1, 7)[:, None]
WAVE = CubicPath.through(np.hstack([np.sin(4 * U), np.cos(3 * U), U]), names(3), U[:, 0])
CORNER = BlendedPath.rounded(JointPath([[0, 0, 0], [1, 0, 0.5], [1, 1, 0]], names(3)), [0, 0.2, 0])
PATHS = [WAVE, CORNER, JointPath([[0, 0, 0], [1, 1, 0], [1, 0, 2]], names(3))]
WIDE = limits_of([50, 50, 50], [500, 500, 500])


class Linear:
    """|matrix @ q''| <= bound without weight; with it, |matrix @ q'' + weight * q| <= bound."""

    name = "force"

    def __init__(self, matrix, bound, weight=0.0):
        self.matrix, self.bound, self.weight = np.atleast_2d(matrix), np.asarray(bound, float), weight

    def coefficients(self, q, slope, curvature):
        rows = [values @ self.matrix.T for values in (slope, curvature, self.weight * q)]
        return (*rows, np.broadcast_to(self.bound, rows[0].shape))

    def excess(self, trajectory):
        knots, acceleration = trajectory.bezier(2)
        force = acceleration @ self.matrix.T
        if not self.weight:
            return np.sqrt(np.maximum(Bezier(knots, force).largest() / self.bound, 0)).max(axis=1)
        hold = np.abs(trajectory.bezier()[1] @ self.matrix.T * self.weight).max(axis=1)
        return np.sqrt(np.abs(force).max(axis=1) / np.maximum(self.bound - hold, 1e-12)).max(axis=1)


class ToolSpeed:
    """The speed of a planar point whose velocity is the first two joints'."""

    name = "tool speed"

    def __init__(self, limit):
        self.limit = limit

    def coefficients(self, q, slope, curvature):
        square = (slope[:, :2] ** 2).sum(axis=1, keepdims=True)
        return 0 * square, square, 0 * square, np.full_like(square, self.limit**2)

    def excess(self, trajectory):
        speed = np.linalg.norm(trajectory.bezier(1)[1][..., :2], axis=2)
        return speed.max(axis=1) / self.limit


class Hopeful:
    """A constraint whose coefficients permit more than the limit, so that only ``excess`` keeps it."""

    def __init__(self, constraint, factor=3.0):
        self.name, self.excess, self._given, self._factor = constraint.name, constraint.excess, constraint, factor

    def coefficients(self, q, slope, curvature):
        *rows, bound = self._given.coefficients(q, slope, curvature)
        return (*rows, self._factor**2 * bound)


@pytest.mark.parametrize("path", PATHS)
def test_joint_accelerations_as_a_constraint_give_the_same_motion(path):
    limits, wide = limits_of([2, 2, 2], [3, 4, 5]), limits_of([2, 2, 2], [500, 500, 500])
    constrained = time_parametrise(path, wide, rate_limits=[Linear(np.eye(3), limits.acceleration)])
    assert_within(constrained, limits)
    assert_on_path(constrained, path, 1e-5)
    assert constrained.duration == pytest.approx(time_parametrise(path, limits).duration, rel=0.01)


def fastest(trajectory):
    return np.linalg.norm(trajectory.velocity(np.linspace(0, trajectory.duration, 10_001))[:, :2], axis=1).max()


@pytest.mark.parametrize("jerk", [None, 200.0])
@pytest.mark.parametrize("path", [WAVE, CORNER])
def test_a_tool_speed_is_held_everywhere_and_reached(path, jerk):
    """Also if the timing assumes a limit that is 7 % too high, as if limits were exceeded between the nodes."""
    trajectory = time_parametrise(path, WIDE, jerk=jerk, rate_limits=[ToolSpeed(0.25)])
    assert 0.24 < fastest(trajectory) <= 0.25 * RELATIVE
    assert_within(trajectory, WIDE, jerk)
    if path is WAVE:
        hurried = time_parametrise(path, WIDE, jerk=jerk, rate_limits=[Hopeful(ToolSpeed(0.25), 1.07)])
        assert fastest(hurried) <= 0.25 * RELATIVE
        assert hurried.duration >= trajectory.duration * 0.97


@pytest.mark.parametrize("jerk", [None, 500.0])
def test_a_force_with_a_share_at_standstill_is_held(jerk):
    force = Linear([[1.0, 0.5, 0.2]], [3.0], weight=1.0)
    trajectory = time_parametrise(WAVE, WIDE, jerk=jerk, rate_limits=[force])
    t = np.linspace(0, trajectory.duration, 10_001)
    size = np.abs((trajectory.acceleration(t) + trajectory(t)) @ force.matrix.T)
    assert 2.0 < size.max() <= 3.0 * RELATIVE


def shares(trajectory, limits, constraints):
    """(N, k) the share of each limit that a motion uses at equal times."""
    t = np.linspace(0, trajectory.duration, 3001)
    velocity, acceleration = trajectory.velocity(t), trajectory.acceleration(t)
    used = [np.abs(velocity) / limits.velocity, np.abs(acceleration) / limits.acceleration]
    for each in constraints:
        if isinstance(each, ToolSpeed):
            used.append(np.linalg.norm(velocity[:, :2], axis=1, keepdims=True) / each.limit)
        else:
            used.append(np.abs(acceleration @ each.matrix.T) / each.bound)
    return np.hstack(used)


def several_limits(path, rng):
    """Limits of the joints, and three constraints in any order: the motion without them exceeds each by 0.8 to 2."""
    limits = limits_of(rng.uniform(0.3, 2, 3), rng.uniform(1, 8, 3))
    given = [ToolSpeed(1.0), *(Linear(row, 1.0) for row in rng.normal(size=(2, 3)))]
    given = [given[k] for k in rng.permutation(3)]
    most = shares(time_parametrise(path, limits), limits, given)[:, 6:].max(axis=0)
    for each, largest, excess in zip(given, most, rng.uniform(0.8, 2.0, 3), strict=True):
        setattr(each, "limit" if isinstance(each, ToolSpeed) else "bound", np.asarray(largest / excess))
    return limits, given


@pytest.mark.parametrize("path", PATHS)
def test_among_several_constraints_every_one_is_kept_and_one_is_used_at_any_time(path):
    rng, strictest = np.random.default_rng(7), set()
    for _ in range(8):
        limits, given = several_limits(path, rng)
        used = shares(time_parametrise(path, limits, rate_limits=given), limits, given)
        assert used.max() <= RELATIVE
        assert (used.max(axis=1) > 0.9).mean() > 0.95  # at almost every time a limit is used: no motion is faster
        strictest.add(int(used.max(axis=0).argmax()))
    assert len(strictest) > 2


@pytest.mark.parametrize("jerk", [None, 50.0])
@pytest.mark.parametrize("path", PATHS)
def test_constraints_that_are_exceeded_between_the_nodes_are_all_kept(path, jerk):
    rng = np.random.default_rng(7)
    for _ in range(3):
        limits, given = several_limits(path, rng)
        trajectory = time_parametrise(path, limits, jerk=jerk, rate_limits=[Hopeful(each) for each in given])
        assert shares(trajectory, limits, given).max() <= RELATIVE
        assert jerk is None or (trajectory.max_jerk() <= jerk * RELATIVE).all()


def test_a_constraint_that_is_violated_at_standstill_is_named_with_its_place():
    for path in (WAVE, JointPath([[1.0, 2, 3]], names(3))):
        with pytest.raises(TimingError, match=r"'force' is violated at standstill at q = \[") as caught:
            time_parametrise(path, WIDE, rate_limits=[Linear([[1.0, 1, 1]], [1.2], weight=1.0)])
        found = re.search(r"q = \[(.*)\]: component 0 is (\S+), the limit is 1.2;", str(caught.value))
        assert float(found[2]) > 1.2
        assert float(found[2]) == pytest.approx(sum(map(float, found[1].split(","))), abs=1e-3)


class Changed(ToolSpeed):
    """A constraint with other coefficients."""

    def __init__(self, change):
        super().__init__(1.0)
        self.change = change

    def coefficients(self, q, slope, curvature):
        return self.change(super().coefficients(q, slope, curvature))


def test_a_constraint_without_a_component_changes_nothing():
    nothing = Changed(lambda rows: tuple(row[:, :0] for row in rows))
    nothing.excess = lambda trajectory: np.zeros(len(trajectory.bezier()[1]))
    for path in (WAVE, JointPath([[1.0, 2, 3]], names(3))):
        assert time_parametrise(path, WIDE, rate_limits=[nothing]).digest() == time_parametrise(path, WIDE).digest()


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        (ToolSpeed(1.0), "sequence"),
        ([3], "not a int"),
        ([Changed(lambda rows: rows[:3])], "'tool speed' must be four arrays"),
        ([Changed(lambda rows: (*rows[:3], rows[3][:-1]))], "'tool speed' must be four arrays"),
        ([Changed(lambda rows: (*rows[:3], np.nan * rows[3]))], "'tool speed' hold a number that is not finite"),
    ],
)
def test_objects_that_are_no_constraints_are_refused(constraints, message):
    with pytest.raises(InputError, match=message):
        time_parametrise(WAVE, WIDE, rate_limits=constraints)
    assert isinstance(ToolSpeed(1.0), RateConstraint)
