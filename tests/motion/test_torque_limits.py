"""Torque limits: bounds between samples against Pinocchio, timing, payloads, and what is refused."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof import InputError
from pinproof.errors import TimingError
from pinproof.model import load_robot
from pinproof.motion import JointPath, ToolLimits, TorqueLimits, Trajectory, time_parametrise

from ..heavy_robot import heavy_robot_text

PART = pp.Payload(3.0, (0.0, 0.03, 0.1), (0.02, 0.02, 0.03))


@pytest.fixture(scope="module")
def panda():
    return pp.load_robot("panda").arm()


@pytest.fixture(scope="module", params=["heavy", "panda", "ur5", "stanford", "scara"])
def arm(request):
    if request.param == "heavy":
        return load_robot(heavy_robot_text()).arm(tcp="tool")
    return pp.load_robot(request.param).arm()


def random_trajectory(arm, rng, *, quintic, points=8):
    low, high = arm.limits.sampling_range()
    q = rng.uniform(low, high) + np.cumsum(rng.normal(scale=0.1, size=(points, arm.dof)), axis=0)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.2, points - 1))])
    v, a = 0.5 * rng.normal(size=q.shape), 4.0 * rng.normal(size=q.shape)
    return Trajectory(times, q, v, arm.joint_names, accelerations=a if quintic else None)


def samples(trajectory, count):
    """Times within the pieces: at a knot the acceleration of a cubic jumps."""
    inside = np.linspace(1e-7, 1.0 - 1e-7, count)
    times = trajectory.times[:-1, None] + np.diff(trajectory.times)[:, None] * inside
    return times.ravel()


def torques_by_pinocchio(arm, trajectory, times, payload):
    """(N, n) of the motion and (N, n) of gravity, by the recursive algorithm on the model of the arm."""
    model = arm.model
    frame = model.frames[model.getFrameId(arm.tcp, pin.FrameType.BODY)]
    body = pin.Inertia(payload.mass, np.array(payload.center_of_mass), np.array(payload.inertia))
    model.inertias[frame.parentJoint] += frame.placement.act(body)
    data, rows = model.createData(), []
    for q, v, a in zip(trajectory(times), trajectory.velocity(times), trajectory.acceleration(times), strict=True):
        at = arm.model_configuration(q)
        still = pin.computeGeneralizedGravity(model, data, at).copy()
        moving = pin.rnea(model, data, at, arm.scale @ v, arm.scale @ a).copy()
        rows.append((arm.scale.T @ (moving - still), arm.scale.T @ still))
    return np.swapaxes(np.array(rows), 0, 1)


@pytest.mark.parametrize("quintic", [False, True])
def test_the_bound_covers_dense_samples_and_is_tight(arm, quintic):
    rng = np.random.default_rng(5)
    trajectory = random_trajectory(arm, rng, quintic=quintic)
    limits = TorqueLimits(arm, PART)
    of_motion, of_gravity = torques_by_pinocchio(arm, trajectory, samples(trajectory, 150), PART)
    # A limit that standstill keeps everywhere, and that the motion exceeds in some pieces.
    limits = TorqueLimits(arm, PART, limits=1.2 * np.abs(of_gravity).max(axis=0) + 0.5)
    quotient = np.maximum(of_motion / (limits.limits - of_gravity), -of_motion / (limits.limits + of_gravity))
    dense = np.sqrt(np.maximum(quotient, 0.0)).max(axis=1).reshape(-1, 150).max(axis=1)
    excess = limits.excess(trajectory)
    assert (excess >= dense * (1.0 - 1e-9)).all()
    assert excess.max() > 1.0
    over = excess > 1.0
    assert (excess[over] <= 1.005 * dense[over]).all()  # 1e-4 of slack, and what the samples miss
    peaks, largest = limits.peaks(trajectory), np.abs(of_motion + of_gravity).max(axis=0)
    bounds = np.array([peak.torque for peak in peaks])
    assert [peak.share for peak in peaks] == pytest.approx(bounds / limits.limits)
    assert (bounds >= largest * (1.0 - 1e-9)).all()
    assert (bounds <= 1.005 * largest + 1e-5 * largest.max()).all()
    worst = int(np.argmax(bounds))
    at = np.abs(np.sum(torques_by_pinocchio(arm, trajectory, [peaks[worst].time], PART), axis=0)[0, worst])
    assert quintic is False or at == pytest.approx(bounds[worst], rel=1e-3)


def test_a_motion_that_is_slowed_down_by_the_factor_keeps_the_limits(panda):
    trajectory = random_trajectory(panda, np.random.default_rng(1), quintic=True)
    limits = TorqueLimits(panda, PART, limits=[60, 80, 60, 60, 20, 20, 20])
    factor = float(limits.excess(trajectory).max())
    assert factor > 1.5

    def slowed(f):
        return Trajectory(
            trajectory.times * f,
            trajectory.q,
            trajectory.velocities / f,
            panda.joint_names,
            accelerations=trajectory.accelerations / f**2,
        )

    assert limits.excess(slowed(1.0005 * factor)).max() <= 1.0
    assert limits.excess(slowed(0.999 * factor)).max() > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("jerk", [None, 500.0])
def test_timing_keeps_the_torque_limits(panda, jerk):
    fast = dataclasses.replace(panda.limits, acceleration=np.full(7, 15.0))
    path = JointPath(
        [panda.home, panda.home + 0.8, panda.home + np.array([0.0, 0.7, 0.2, -0.3, 0.0, 0.3, 0.0])], panda.joint_names
    )
    limits = TorqueLimits(panda, PART, limits=0.7 * panda.limits.torque)
    free = time_parametrise(path, fast, jerk=jerk)
    kept = time_parametrise(path, fast, jerk=jerk, rate_limits=[limits])
    assert limits.excess(free).max() > 1.0 + 1e-3
    assert kept.duration > free.duration
    torques = np.abs(np.sum(torques_by_pinocchio(panda, kept, samples(kept, 100), PART), axis=0))
    assert (torques.max(axis=0) <= limits.limits * (1.0 + 1e-9)).all()
    assert (torques / limits.limits).max() > 0.99


def test_a_torque_that_standstill_exceeds_is_reported_with_joint_and_configuration(panda):
    limits = TorqueLimits(panda, pp.Payload(20.0))
    path = JointPath([panda.home, panda.home + np.array([0.0, 0.9, 0.0, 0.8, 0.0, 0.0, 0.0])], panda.joint_names)
    with pytest.raises(TimingError, match=r"'panda_joint2'.*87 N m.*payload 20 kg") as error:
        time_parametrise(path, panda.limits, rate_limits=[limits])
    assert "q = [" in str(error.value)
    with pytest.raises(TimingError, match="'panda_joint2'"):
        limits.excess(time_parametrise(path, panda.limits))
    assert "'panda_joint2'" in limits.standstill(path.end)
    assert TorqueLimits(panda).standstill(path.end) == ""


def test_the_coefficients_are_the_torques_along_the_path(panda):
    rng = np.random.default_rng(2)
    q, slope, curvature = panda.home + rng.uniform(-0.5, 0.5, (3, 4, 7))
    alpha, beta, gamma, bound = TorqueLimits(panda, PART).coefficients(q, slope, curvature)
    speed, gain = 1.7, -2.3
    torques = panda.torques_batch(q, slope * speed, slope * gain + curvature * speed**2, payload=PART)
    np.testing.assert_allclose(alpha * gain + beta * speed**2 + gamma, torques, atol=1e-10)
    assert (bound == panda.limits.torque).all()


def test_joints_without_a_limit_are_not_limited(panda):
    limits = TorqueLimits(panda, limits=[np.nan, 87, np.inf, 87, 12, 12, 12])
    assert limits.coefficients(panda.home[None], panda.home[None], panda.home[None])[0].shape == (1, 5)
    assert "panda_joint1, panda_joint3" in limits.notes[0]
    again = pickle.loads(pickle.dumps(limits))
    assert again.limits.tolist() == limits.limits.tolist()


def test_one_number_is_the_limit_of_every_joint_and_the_limits_cannot_be_changed(panda):
    limits = TorqueLimits(panda, limits=30.0)
    assert limits.limits.tolist() == [30.0] * 7
    for array in (limits.limits, limits.gravity):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_the_share_at_standstill_is_the_largest_one_of_gravity(panda):
    q = np.random.default_rng(4).uniform(*panda.limits.sampling_range(), (20, 7))
    limits = TorqueLimits(panda, PART, limits=[40, 90, 50, 60, 10, 20, 5])
    still = np.zeros(7)
    needed = np.abs([panda.torques(each, still, still, payload=PART) for each in q]) / limits.limits
    assert limits.standstill_share(q) == pytest.approx(needed.max())
    for each, share in zip(q, needed, strict=True):
        assert limits.standstill_share(each) == pytest.approx(share.max())
        assert (limits.standstill(each) == "") == bool((share <= 1.0).all())


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("limit", [0.0, -5.0, -np.inf])
def test_the_joint_whose_limit_is_not_above_0_is_named(panda, joint, limit):
    with pytest.raises(InputError, match=f"'panda_joint{joint + 1}'"):
        TorqueLimits(panda, limits=np.where(np.arange(7) == joint, limit, 87.0))


@pytest.mark.parametrize("limits", [[87.0] * 6, [87.0] * 6 + [-12.0], [87.0] * 6 + [0.0], [np.nan] * 7, "many"])
def test_limits_of_wrong_length_or_sign_are_refused(panda, limits):
    with pytest.raises(InputError, match="torque limit"):
        TorqueLimits(panda, limits=limits)


def test_a_robot_without_torque_limits_needs_them(panda):
    bare = panda.with_limits(dataclasses.replace(panda.limits, torque=None))
    with pytest.raises(InputError, match="max_effort"):
        TorqueLimits(bare)
    with pytest.raises(InputError, match="torque"):
        dataclasses.replace(panda.limits, torque=[1.0] * 6)
    with pytest.raises(InputError, match="torque"):
        dataclasses.replace(panda.limits, torque=[-1.0] * 7)


def test_rates_beyond_the_range_of_doubles_are_never_within_the_limits(panda):
    q, v = np.tile(panda.home, (2, 1)), np.full((2, 7), 1e200)
    trajectory = Trajectory([0.0, 0.1], q, v, panda.joint_names)
    limits = TorqueLimits(panda)
    with pytest.raises(TimingError, match="no finite bound"):
        limits.excess(trajectory)
    assert max(peak.torque for peak in limits.peaks(trajectory)) == np.inf
    assert ToolLimits(panda, linear_speed=1.0).excess(trajectory).tolist() == [np.inf]


def test_a_trajectory_of_another_arm_is_refused(panda):
    other = pp.load_robot("ur5").arm()
    with pytest.raises(InputError, match="panda_joint1"):
        TorqueLimits(panda).excess(random_trajectory(other, np.random.default_rng(0), quintic=False))


def test_generated_masses_are_stated_in_the_notes(panda):
    generated = TorqueLimits(pp.load_robot("gen3_lite").arm(), PART).notes
    assert any("generated" in note for note in generated)
    assert not any("generated" in note for note in TorqueLimits(panda, PART).notes)


def test_a_torque_at_its_limit_holds_the_arm(panda):
    still = np.zeros((1, panda.dof))
    needed = np.abs(TorqueLimits(panda)._tree.torques(panda.home[None], still, still)[1][0])
    limits = np.where(needed > 1e-3, needed, 1.0)
    assert TorqueLimits(panda, limits=limits).standstill(panda.home) == ""
    for joint in np.flatnonzero(needed > 1e-3):
        less = limits * np.where(np.arange(panda.dof) == joint, 1.0 - 1e-12, 1.0)
        assert panda.joint_names[joint] in TorqueLimits(panda, limits=less).standstill(panda.home)
