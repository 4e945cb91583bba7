"""Limits of torques and of the tool: bounds between samples against Pinocchio, timing, payloads, what is refused."""

import dataclasses
import pickle

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof import InputError
from pinproof.errors import TimingError
from pinproof.model import load_robot
from pinproof.motion import (
    BlendedPath,
    CubicPath,
    JointPath,
    ToolLimits,
    TorqueLimits,
    Trajectory,
    rate_violations,
    split,
    time_parametrise,
)

from ..heavy_robot import heavy_robot_text

PART = pp.Payload(3.0, (0.0, 0.03, 0.1), (0.02, 0.02, 0.03))
RATES = ("linear_speed", "angular_speed", "linear_acceleration", "angular_acceleration")


@pytest.fixture(scope="module")
def panda():
    return pp.load_robot("panda").arm()


@pytest.fixture(scope="module", params=["heavy", "panda", "ur5", "stanford", "scara"])
def arm(request):
    heavy = request.param == "heavy"
    return load_robot(heavy_robot_text()).arm(tcp="tool") if heavy else pp.load_robot(request.param).arm()


def random_trajectory(arm, seed, *, quintic, points=8):
    rng = np.random.default_rng(seed)
    q = rng.uniform(*arm.limits.sampling_range()) + np.cumsum(rng.normal(scale=0.1, size=(points, arm.dof)), axis=0)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.2, points - 1))])
    v, a = 0.5 * rng.normal(size=q.shape), 4.0 * rng.normal(size=q.shape)
    return Trajectory(times, q, v, arm.joint_names, accelerations=a if quintic else None)


def samples(trajectory, count):
    """Times within the pieces: at a knot the acceleration of a cubic jumps."""
    inside = np.linspace(1e-7, 1.0 - 1e-7, count)
    return (trajectory.times[:-1, None] + np.diff(trajectory.times)[:, None] * inside).ravel()


def states(arm, trajectory, times):
    """Configuration, velocity and acceleration of the model at each time."""
    for q, v, a in zip(trajectory(times), trajectory.velocity(times), trajectory.acceleration(times), strict=True):
        yield arm.model_configuration(q), arm.scale @ v, arm.scale @ a


def torques_by_pinocchio(arm, trajectory, times, payload):
    """(N, n) of the motion and (N, n) of gravity, by the recursive algorithm on the model of the arm."""
    model = arm.model
    frame = model.frames[model.getFrameId(arm.tcp, pin.FrameType.BODY)]
    body = pin.Inertia(payload.mass, np.array(payload.center_of_mass), np.array(payload.inertia))
    model.inertias[frame.parentJoint] += frame.placement.act(body)
    data, rows = model.createData(), []
    for q, v, a in states(arm, trajectory, times):
        still = pin.computeGeneralizedGravity(model, data, q).copy()
        rows.append((arm.scale.T @ (pin.rnea(model, data, q, v, a) - still), arm.scale.T @ still))
    return np.swapaxes(np.array(rows), 0, 1)


def rates_by_pinocchio(arm, trajectory, times):
    """(N, 4) speeds and accelerations of the tcp frame."""
    model, axes, rows = arm.model, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, []
    data, frame = model.createData(), model.getFrameId(arm.tcp, pin.FrameType.BODY)
    for state in states(arm, trajectory, times):
        pin.forwardKinematics(model, data, *state)
        speed = pin.getFrameVelocity(model, data, frame, axes)
        gain = pin.getFrameClassicalAcceleration(model, data, frame, axes)
        rows.append([np.linalg.norm(x) for x in (speed.linear, speed.angular, gain.linear, gain.angular)])
    return np.array(rows)


def assert_tight(excess, dense):
    """The factors (k,) cover those of dense samples, and exceed them by the slack and what the samples miss."""
    assert (excess >= dense * (1.0 - 1e-9)).all()
    over = excess > 1.0
    assert over.any()
    assert (excess[over] <= 1.005 * dense[over]).all()


@pytest.mark.parametrize("quintic", [False, True])
def test_the_bounds_of_torques_cover_dense_samples_and_are_tight(arm, quintic):
    trajectory = random_trajectory(arm, 5, quintic=quintic)
    of_motion, of_gravity = torques_by_pinocchio(arm, trajectory, samples(trajectory, 100), PART)
    # A limit that standstill keeps everywhere, and that the motion exceeds in some pieces.
    limits = TorqueLimits(arm, PART, limits=1.2 * np.abs(of_gravity).max(axis=0) + 0.5)
    quotient = np.maximum(of_motion / (limits.limits - of_gravity), -of_motion / (limits.limits + of_gravity))
    dense = np.sqrt(np.maximum(quotient, 0.0)).max(axis=1).reshape(-1, 100).max(axis=1)
    assert_tight(limits.excess(trajectory), dense)
    peaks, largest = limits.peaks(trajectory), np.abs(of_motion + of_gravity).max(axis=0)
    bounds = np.array([peak.torque for peak in peaks])
    assert [peak.share for peak in peaks] == pytest.approx(bounds / limits.limits)
    assert (bounds >= largest * (1.0 - 1e-9)).all()
    assert (bounds <= 1.005 * largest + 1e-5 * largest.max()).all()
    worst = int(np.argmax(bounds))
    at = np.abs(np.sum(torques_by_pinocchio(arm, trajectory, [peaks[worst].time], PART), axis=0)[0, worst])
    assert quintic is False or at == pytest.approx(bounds[worst], rel=1e-3)


@pytest.mark.parametrize("quintic", [False, True])
def test_the_bounds_of_the_tool_cover_dense_samples_and_are_tight(arm, quintic):
    trajectory = random_trajectory(arm, 3, quintic=quintic)
    dense = rates_by_pinocchio(arm, trajectory, samples(trajectory, 150))
    limits = 0.4 * dense.max(axis=0)
    tool, share = ToolLimits(arm, **dict(zip(RATES, limits, strict=True))), dense / limits
    share[:, 2:] = np.sqrt(share[:, 2:])
    assert_tight(tool.excess(trajectory), share.max(axis=1).reshape(-1, 150).max(axis=1))
    peaks = np.array([tool.peaks(trajectory)[rate] for rate in RATES]) / dense.max(axis=0)
    assert (peaks >= 1.0 - 1e-9).all()
    assert (peaks <= 1.005).all()


def test_a_motion_that_is_slowed_down_by_the_factor_keeps_the_limits(panda):
    trajectory = random_trajectory(panda, 1, quintic=True)
    limits = TorqueLimits(panda, PART, limits=[60, 80, 60, 60, 20, 20, 20])
    factor = float(limits.excess(trajectory).max())
    assert factor > 1.5
    assert limits.excess(trajectory.slowed(1.0005 * factor)).max() <= 1.0
    assert limits.excess(trajectory.slowed(0.999 * factor)).max() > 1.0


def fast(arm):
    return dataclasses.replace(arm.limits, acceleration=np.full(7, 15.0))


@pytest.mark.slow
@pytest.mark.parametrize("jerk", [None, 500.0])
def test_timing_keeps_the_torque_limits(panda, jerk):
    last = panda.home + np.array([0.0, 0.7, 0.2, -0.3, 0.0, 0.3, 0.0])
    path = JointPath([panda.home, panda.home + 0.8, last], panda.joint_names)
    limits = TorqueLimits(panda, PART, limits=0.7 * panda.limits.torque)
    free = time_parametrise(path, fast(panda), jerk=jerk)
    kept = time_parametrise(path, fast(panda), jerk=jerk, rate_limits=[limits])
    assert limits.excess(free).max() > 1.0 + 1e-3
    assert kept.duration > free.duration
    shares = np.abs(np.sum(torques_by_pinocchio(panda, kept, samples(kept, 100), PART), axis=0)) / limits.limits
    assert 0.99 < shares.max() <= 1.0 + 1e-9


@pytest.mark.parametrize("limit", [{"linear_speed": 0.25}, {"linear_acceleration": 1.5, "angular_acceleration": 4.0}])
def test_timing_keeps_the_limits_of_the_tool(panda, limit):
    path = JointPath([panda.home, panda.home + np.array([0.4, 0.2, 0.3, 0.2, 0.1, 0.3, 0.2])], panda.joint_names)
    trajectory = time_parametrise(path, fast(panda), rate_limits=[ToolLimits(panda, **limit)])
    largest = rates_by_pinocchio(panda, trajectory, samples(trajectory, 60)).max(axis=0)
    assert 0.98 < max(largest[RATES.index(name)] / value for name, value in limit.items()) <= 1.0 + 1e-9


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
    q, slope, curvature = panda.home + np.random.default_rng(2).uniform(-0.5, 0.5, (3, 4, 7))
    alpha, beta, gamma, bound = TorqueLimits(panda, PART).coefficients(q, slope, curvature)
    speed, gain = 1.7, -2.3
    torques = panda.torques_batch(q, slope * speed, slope * gain + curvature * speed**2, payload=PART)
    np.testing.assert_allclose(alpha * gain + beta * speed**2 + gamma, torques, atol=1e-10)
    assert (bound == panda.limits.torque).all()


def test_the_coefficients_of_the_tool_are_the_limits_of_the_motion_along_the_path(panda):
    """A polygon inside the circle replaces the length of an acceleration; see DIRECTIONS."""
    rng, limits = np.random.default_rng(2), np.array([0.3, 1.1, 2.0, 5.0])
    tool = ToolLimits(panda, **dict(zip(RATES, limits, strict=True)))
    q, slope, curvature = panda.home + rng.uniform(-0.5, 0.5, (3, 40, 7))
    slope[0], curvature[1] = 0.0, 0.0
    for speed, gain in [(0.7, 0.0), (0.0, 1.3), *rng.normal(size=(8, 2))]:
        rows = []
        for place in zip(q, slope * speed, slope * gain + curvature * speed**2, strict=True):
            start, v, a = (np.stack([x, x]) for x in place)
            motion = Trajectory([0, 1], start, v, panda.joint_names, accelerations=a)
            rows.append(rates_by_pinocchio(panda, motion, [0.0])[0])
        used = (np.array(rows) / limits) ** [2, 2, 1, 1]
        alpha, beta, gamma, bound = tool.coefficients(q, slope, curvature)
        assert (gamma == 0.0).all()
        share = np.abs(alpha * gain + beta * speed**2) / bound
        share = np.column_stack([share[:, :2], share[:, 2:18].max(axis=1), share[:, 18:].max(axis=1)])
        assert (share >= used * (1 - 1e-9)).all()
        allowed = used / np.array([1, 1, np.cos(np.pi / 32), np.cos(np.pi / 32)])
        assert (share <= allowed * (1 + 1e-9) + 1e-12).all()


@pytest.mark.parametrize("seed", [3, 14])
def test_a_limit_of_acceleration_along_a_spline_costs_no_more_than_on_a_finer_grid(seed):
    """Where a component of the acceleration does not depend on s'', it limits the speed only."""
    ur5, rng = pp.load_robot("ur5").arm(tcp="tool0"), np.random.default_rng(seed)
    path = CubicPath.through(rng.uniform(-2, 2, (int(rng.integers(3, 9)), 6)), ur5.joint_names)
    limit = ToolLimits(ur5, linear_acceleration=2.0)
    knots, control = path.bezier()
    halves = np.stack(split(control, 0.5), axis=1).reshape(-1, *control.shape[1:])
    finer = BlendedPath(np.sort([*knots, *(knots[1:] + knots[:-1]) / 2]), halves, ur5.joint_names)
    coarse, fine = (time_parametrise(each, ur5.limits, rate_limits=[limit]) for each in (path, finer))
    assert coarse.duration == pytest.approx(fine.duration, rel=0.01)
    assert limit.peaks(coarse)["linear_acceleration"] <= 2.0 * (1 + 2e-4)


def test_each_exceeded_limit_is_a_sentence_with_its_figures(panda):
    trajectory = random_trajectory(panda, 3, quintic=False)
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


def test_an_arm_at_rest_keeps_every_limit_of_the_tool(panda):
    trajectory = time_parametrise(JointPath([panda.home, panda.home], panda.joint_names), panda.limits)
    tool = ToolLimits(panda, linear_speed=1e-6)
    assert (tool.excess(trajectory).tolist(), set(tool.peaks(trajectory).values())) == ([0.0], {0.0})


def test_limits_pickle_and_cannot_be_changed(panda):
    again = pickle.loads(pickle.dumps(ToolLimits(panda, angular_speed=1.5)))
    assert repr(again) == "ToolLimits('panda_hand_tcp', angular_speed=1.5)"
    limits = TorqueLimits(panda, limits=30.0)
    assert limits.limits.tolist() == pickle.loads(pickle.dumps(limits)).limits.tolist() == [30.0] * 7
    for array in (limits.limits, limits.gravity):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_joints_without_a_torque_limit_are_not_limited(panda):
    limits = TorqueLimits(panda, limits=[np.nan, 87, np.inf, 87, 12, 12, 12])
    assert limits.coefficients(panda.home[None], panda.home[None], panda.home[None])[0].shape == (1, 5)
    assert "panda_joint1, panda_joint3" in limits.notes[0]


def test_the_share_at_standstill_is_the_largest_one_of_gravity(panda):
    q = np.random.default_rng(4).uniform(*panda.limits.sampling_range(), (20, 7))
    limits = TorqueLimits(panda, PART, limits=[40, 90, 50, 60, 10, 20, 5])
    still = np.zeros(7)
    needed = np.abs([panda.torques(each, still, still, payload=PART) for each in q]) / limits.limits
    assert limits.standstill_share(q) == pytest.approx(needed.max())
    for each, share in zip(q, needed, strict=True):
        assert limits.standstill_share(each) == pytest.approx(share.max())
        assert (limits.standstill(each) == "") == bool((share <= 1.0).all())


def test_a_torque_at_its_limit_holds_the_arm(panda):
    still = np.zeros((1, panda.dof))
    needed = np.abs(TorqueLimits(panda)._tree.torques(panda.home[None], still, still)[1][0])
    limits = np.where(needed > 1e-3, needed, 1.0)
    assert TorqueLimits(panda, limits=limits).standstill(panda.home) == ""
    for joint in np.flatnonzero(needed > 1e-3):
        less = limits * np.where(np.arange(panda.dof) == joint, 1.0 - 1e-12, 1.0)
        assert panda.joint_names[joint] in TorqueLimits(panda, limits=less).standstill(panda.home)


@pytest.mark.parametrize(
    ("make", "settings", "message"),
    [
        (ToolLimits, {}, "linear_speed"),
        (ToolLimits, {"linear_speed": 0.0}, "linear_speed"),
        (ToolLimits, {"angular_speed": -1.0}, "angular_speed"),
        (ToolLimits, {"linear_acceleration": np.nan}, "linear_acceleration"),
        *(
            (TorqueLimits, {"limits": limits}, "torque limit")
            for limits in ([87.0] * 6, [87.0] * 6 + [-12.0], [87.0] * 6 + [0.0], [np.nan] * 7, "many")
        ),
        *(
            (TorqueLimits, {"limits": np.where(np.arange(7) == joint, limit, 87.0)}, f"'panda_joint{joint + 1}'")
            for joint in range(7)
            for limit in (0.0, -5.0, -np.inf)
        ),
    ],
)
def test_a_limit_that_is_not_positive_is_refused(panda, make, settings, message):
    with pytest.raises(InputError, match=message):
        make(panda, **settings)


def test_a_robot_without_torque_limits_needs_them(panda):
    bare = panda.with_limits(dataclasses.replace(panda.limits, torque=None))
    with pytest.raises(InputError, match="max_effort"):
        TorqueLimits(bare)
    for wrong in ([1.0] * 6, [-1.0] * 7):
        with pytest.raises(InputError, match="torque"):
            dataclasses.replace(panda.limits, torque=wrong)


def test_rates_beyond_the_range_of_doubles_are_never_within_the_limits(panda):
    trajectory = Trajectory([0.0, 0.1], np.tile(panda.home, (2, 1)), np.full((2, 7), 1e200), panda.joint_names)
    limits = TorqueLimits(panda)
    with pytest.raises(TimingError, match="no finite bound"):
        limits.excess(trajectory)
    assert max(peak.torque for peak in limits.peaks(trajectory)) == np.inf
    assert ToolLimits(panda, linear_speed=1.0).excess(trajectory).tolist() == [np.inf]


def test_a_trajectory_of_another_arm_is_refused(panda):
    with pytest.raises(InputError, match="panda_joint1"):
        TorqueLimits(panda).excess(random_trajectory(pp.load_robot("ur5").arm(), 0, quintic=False))


def test_generated_masses_are_stated_in_the_notes(panda):
    generated = TorqueLimits(pp.load_robot("gen3_lite").arm(), PART).notes
    assert any("generated" in note for note in generated)
    assert not any("generated" in note for note in TorqueLimits(panda, PART).notes)
