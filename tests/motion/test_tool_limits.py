"""Limits of the tool: bounds between samples against Pinocchio, timing, and what is refused."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof import InputError
from pinproof.model import load_robot
from pinproof.motion import BlendedPath, CubicPath, JointPath, ToolLimits, rate_violations, time_parametrise

from ..heavy_robot import heavy_robot_text
from .test_torque_limits import random_trajectory, samples

RATES = ("linear_speed", "angular_speed", "linear_acceleration", "angular_acceleration")


@pytest.fixture(scope="module")
def panda():
    return pp.load_robot("panda").arm()


def rates_by_pinocchio(arm, trajectory, times):
    """(N, 4) speeds and accelerations of the tcp frame."""
    model = arm.model
    data, frame = model.createData(), model.getFrameId(arm.tcp, pin.FrameType.BODY)
    rows = []
    for q, v, a in zip(trajectory(times), trajectory.velocity(times), trajectory.acceleration(times), strict=True):
        pin.forwardKinematics(model, data, arm.model_configuration(q), arm.scale @ v, arm.scale @ a)
        speed = pin.getFrameVelocity(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        gain = pin.getFrameClassicalAcceleration(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        rows.append([np.linalg.norm(x) for x in (speed.linear, speed.angular, gain.linear, gain.angular)])
    return np.array(rows)


def test_each_exceeded_limit_is_a_sentence_with_its_figures(panda):
    trajectory = random_trajectory(panda, np.random.default_rng(3), quintic=False)
    peaks = ToolLimits(panda, linear_speed=1.0).peaks(trajectory)
    low = {rate: 0.5 * peaks[rate] for rate in RATES}
    for rate in RATES:
        (sentence,) = rate_violations([ToolLimits(panda, **{rate: low[rate]})], trajectory)
        assert (f"{peaks[rate]:.6g}" in sentence, f"{low[rate]:g}" in sentence) == (True, True)
        assert rate_violations([ToolLimits(panda, **{rate: 1.01 * peaks[rate]})], trajectory) == []
    assert len(rate_violations([ToolLimits(panda, **low)], trajectory)) == len(RATES)

    class Own:
        name = "own limit"

        def coefficients(self, q, slope, curvature):
            raise NotImplementedError

        def excess(self, trajectory):
            return np.full(len(trajectory.times) - 1, self.factor)

    own = Own()
    for own.factor, expected in ((1.0, 0), (1.0 + 1e-3, 1)):
        assert [own.name in sentence for sentence in rate_violations([own], trajectory)] == [True] * expected
    # A limit that is not proven to be kept is reported even where the bounds of the peaks do not exceed it.
    tool = ToolLimits(panda, linear_speed=1.01 * peaks["linear_speed"])
    tool.excess = lambda trajectory: np.array([1.1])
    assert len(rate_violations([tool], trajectory)) == 1


@pytest.mark.parametrize("quintic", [False, True])
@pytest.mark.parametrize("name", ["heavy", "panda", "stanford", "scara"])
def test_the_bounds_cover_dense_samples_and_are_tight(name, quintic):
    arm = load_robot(heavy_robot_text()).arm(tcp="tool") if name == "heavy" else pp.load_robot(name).arm()
    trajectory = random_trajectory(arm, np.random.default_rng(3), quintic=quintic)
    dense = rates_by_pinocchio(arm, trajectory, samples(trajectory, 150))
    limits = 0.4 * dense.max(axis=0)
    tool = ToolLimits(arm, **dict(zip(RATES, limits, strict=True)))
    share = dense / limits
    share[:, 2:] = np.sqrt(share[:, 2:])
    factor = share.max(axis=1).reshape(-1, 150).max(axis=1)
    excess = tool.excess(trajectory)
    assert (excess >= factor * (1.0 - 1e-9)).all()
    over = excess > 1.0
    assert over.any()
    assert (excess[over] <= 1.005 * factor[over]).all()
    peaks = np.array([tool.peaks(trajectory)[rate] for rate in RATES])
    assert (peaks >= dense.max(axis=0) * (1.0 - 1e-9)).all()
    assert (peaks <= 1.005 * dense.max(axis=0)).all()


@pytest.mark.parametrize("limit", [{"linear_speed": 0.25}, {"linear_acceleration": 1.5, "angular_acceleration": 4.0}])
def test_timing_keeps_the_limits_of_the_tool(panda, limit):
    fast = dataclasses.replace(panda.limits, acceleration=np.full(7, 15.0))
    path = JointPath([panda.home, panda.home + np.array([0.4, 0.2, 0.3, 0.2, 0.1, 0.3, 0.2])], panda.joint_names)
    trajectory = time_parametrise(path, fast, rate_limits=[ToolLimits(panda, **limit)])
    largest = rates_by_pinocchio(panda, trajectory, samples(trajectory, 60)).max(axis=0)
    shares = [largest[RATES.index(name)] / value for name, value in limit.items()]
    assert max(shares) <= 1.0 + 1e-9
    assert max(shares) > 0.98


def test_the_coefficients_are_the_limits_of_the_motion_along_the_path(panda):
    """A polygon inside the circle replaces the length of an acceleration; see DIRECTIONS."""
    rng, limits = np.random.default_rng(2), np.array([0.3, 1.1, 2.0, 5.0])
    tool = ToolLimits(panda, **dict(zip(RATES, limits, strict=True)))
    q, slope, curvature = panda.home + rng.uniform(-0.5, 0.5, (3, 40, 7))
    slope[0], curvature[1] = 0.0, 0.0
    for speed, gain in [(0.7, 0.0), (0.0, 1.3), *rng.normal(size=(8, 2))]:
        rows = []
        for place in zip(q, slope * speed, slope * gain + curvature * speed**2, strict=True):
            start, v, a = (np.stack([x, x]) for x in place)
            motion = pp.Trajectory([0, 1], start, v, panda.joint_names, accelerations=a)
            rows.append(rates_by_pinocchio(panda, motion, [0.0])[0])
        used = (np.array(rows) / limits) ** [2, 2, 1, 1]
        alpha, beta, gamma, bound = tool.coefficients(q, slope, curvature)
        assert (gamma == 0.0).all()
        share = np.abs(alpha * gain + beta * speed**2) / bound
        share = np.column_stack([share[:, :2], share[:, 2:18].max(axis=1), share[:, 18:].max(axis=1)])
        assert (share >= used * (1 - 1e-9)).all()
        assert (share[:, :2] <= used[:, :2] * (1 + 1e-9) + 1e-12).all()
        assert (share[:, 2:] <= used[:, 2:] / np.cos(np.pi / 32) * (1 + 1e-9) + 1e-12).all()


def test_an_arm_at_rest_keeps_every_limit(panda):
    trajectory = time_parametrise(JointPath([panda.home, panda.home], panda.joint_names), panda.limits)
    assert ToolLimits(panda, linear_speed=1e-6).excess(trajectory).tolist() == [0.0]
    assert set(ToolLimits(panda, linear_speed=1e-6).peaks(trajectory).values()) == {0.0}


def test_limits_pickle(panda):
    assert repr(pickle.loads(pickle.dumps(ToolLimits(panda, angular_speed=1.5)))) == (
        "ToolLimits('panda_hand_tcp', angular_speed=1.5)"
    )


@pytest.mark.parametrize("limit", [{}, {"linear_speed": 0.0}, {"angular_speed": -1.0}, {"linear_acceleration": np.nan}])
def test_a_limit_that_is_not_positive_is_refused(panda, limit):
    with pytest.raises(InputError, match=next(iter(limit), "linear_speed")):
        ToolLimits(panda, **limit)


@pytest.mark.parametrize("seed", [3, 14])
def test_a_limit_of_acceleration_along_a_spline_costs_no_more_than_on_a_finer_grid(seed):
    """Where a component of the acceleration does not depend on s'', it limits the speed only."""
    ur5 = pp.load_robot("ur5").arm(tcp="tool0")
    rng = np.random.default_rng(seed)
    path = CubicPath.through(rng.uniform(-2, 2, (int(rng.integers(3, 9)), 6)), ur5.joint_names)
    limit = ToolLimits(ur5, linear_acceleration=2.0)
    knots, control = path.bezier()
    halves = [half for piece in control for half in halved(piece)]
    finer = BlendedPath(np.sort([*knots, *(knots[1:] + knots[:-1]) / 2]), halves, ur5.joint_names)
    coarse, fine = (time_parametrise(each, ur5.limits, rate_limits=[limit]) for each in (path, finer))
    assert coarse.duration == pytest.approx(fine.duration, rel=0.01)
    assert limit.peaks(coarse)["linear_acceleration"] <= 2.0 * (1 + 2e-4)


def halved(points):
    """The control points of both halves of a piece, by de Casteljau's algorithm."""
    rows = [points]
    while len(rows[-1]) > 1:
        rows.append((rows[-1][:-1] + rows[-1][1:]) / 2)
    return [np.array([row[0] for row in rows]), np.array([row[-1] for row in rows[::-1]])]
