"""Tracking: limits hold at every sample, errors are measured independently, singularities cause no jumps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

import pinproof as pp
from pinproof import _core
from pinproof.model import load_robot

from ..examples import examples

REACHED = 1e-6
"""m and rad: the permitted error if a continuous solution exists."""


def line(centre, rates, dt, count, shift=0.0):
    """Configurations (count, n) on a line about the centre, shifted by the fraction ``shift`` of a cycle."""
    return np.asarray(centre) + np.outer((np.arange(count) - count // 2 + shift) * dt, rates)


def kept_limits(arm, tracked, velocity=None):
    """Check position and speed limits of every sample, computed from the result alone."""
    velocity = arm.limits.velocity if velocity is None else velocity
    steps = np.diff(tracked.q, axis=0, prepend=tracked.q0[None])
    assert (np.abs(steps) <= velocity * tracked.durations[:, None]).all()
    assert (tracked.q >= arm.limits.lower).all()
    assert (tracked.q <= arm.limits.upper).all()


@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof", "xarm7", "stanford", "scara"])
def test_a_smooth_motion_is_tracked_within_tolerance(name):
    arm, times = pp.load_robot(name).arm(), np.arange(1000) * 2e-3
    rng = np.random.default_rng(1)
    lower, upper = arm.limits.sampling_range()
    swing = np.minimum(0.3 * (upper - lower) / 2, 0.2 * arm.limits.velocity)
    Q = (lower + upper) / 2 + swing * np.sin(2 * times[:, None] + rng.uniform(0, 6, arm.dof))
    tracked = pp.track(arm, arm.forward_kinematics_batch(Q), Q[0], dt=2e-3).or_raise()
    kept_limits(arm, tracked)
    assert max(tracked.position_error.max(), tracked.orientation_error.max()) < 1e-9
    assert tracked.speed_share.max() < 0.9
    assert "all 1000 poses" in tracked.message


SINGULAR = {
    "wrist of the UR5": ("ur5", [0.3, -1.2, 1.4, -1.0, 0.0, 0.2]),
    "elbow of the UR5": ("ur5", [0.3, -1.2, 0.0, -1.0, 0.9, 0.2]),
    "shoulder of the UR5": ("ur5", [0.3, -2.3765570574796397, 1.4, -1.0, 0.9, 0.2]),
    "wrist of the Puma": ("puma560", [0.3, 0.6, -2.0, 0.5, 0.0, 0.3]),
    "wrist of the textbook's arm": ("generic_6dof", [0.1, 1.0, -1.5, 0.4, 0.0, 0.2]),
}


@pytest.mark.parametrize("shift", [0.0, 0.37])
@pytest.mark.parametrize("dt", [1e-3, 1e-2, 5e-2])
@pytest.mark.parametrize(("name", "centre"), SINGULAR.values(), ids=SINGULAR)
def test_a_motion_through_a_singularity_continues_smoothly(name, centre, dt, shift):
    """The samples are those of the line in joint space, though one direction vanishes on the line (for shift 0, on a
    sample, where a line of configurations is equally good)."""
    arm = pp.load_robot(name).arm()
    assert arm.singularity(centre).smallest < 1e-9
    rates = np.array([0.24, 0.16, -0.2, 0.32, 0.48, -0.24])
    Q = line(centre, rates, dt, 40 if dt > 0.01 else 300, shift)
    tracked = pp.track(arm, arm.forward_kinematics_batch(Q), Q[0] - rates * dt, dt=dt)
    kept_limits(arm, tracked)
    assert max(tracked.position_error.max(), tracked.orientation_error.max()) <= REACHED
    assert np.abs(np.diff(tracked.q, axis=0)).max() <= 1.2 * np.abs(rates).max() * dt
    assert np.abs(tracked.q - Q).max() < 0.2 * np.abs(rates).max() * dt


def past_the_wrist(arm, gap, dt):
    """The last joint's axis passes the fourth's on a straight line at 0.5 rad/s, ``gap`` rad from it; then it rests.

    The fourth joint then has to turn by nearly pi, within about 3 gap / 0.5 seconds.
    """
    along = np.arange(-0.6, 0.6, 0.5 * dt)
    along = np.concatenate([along, np.full(int(1 / dt), along[-1])])
    turn = np.arctan2(gap, along) - np.pi / 2
    wrist = np.column_stack([turn + 0.2, np.hypot(along, gap), 0.3 - turn])
    return np.hstack([np.tile([0.3, 0.6, -2.0], (len(along), 1)), wrist])


@pytest.mark.parametrize("gap", [0.3, 0.1, 0.03, 0.002, 1e-5])
@pytest.mark.parametrize("name", ["puma560", "generic_6dof"])
def test_the_tcp_deviates_briefly_near_a_wrist_singularity(name, gap):
    arm, dt = pp.load_robot(name).arm(), 4e-3
    Q = past_the_wrist(arm, gap, dt)
    tracked = pp.track(arm, arm.forward_kinematics_batch(Q), Q[0], dt=dt)
    kept_limits(arm, tracked)
    needed = (np.abs(np.diff(Q, axis=0)) / (arm.limits.velocity * dt)).max()
    if needed < 1:
        assert tracked.ok
        assert tracked.q == pytest.approx(Q, abs=1e-6)
    else:
        assert not tracked.ok
        assert tracked.reached[:200].all()
        assert tracked.at_speed_limit[:, 3].any() or gap < 1e-3
        assert tracked.reached[-100:].all()
        assert max(tracked.position_error.max(), tracked.orientation_error.max()) < 0.04
        assert "near a singularity" in tracked.message or "speed limit of" in tracked.message


def test_an_arm_leaves_a_singular_start():
    """At q5 = 0 the gradient is zero: the target rotates about the singular axis of the wrist."""
    arm = pp.load_robot("puma560").arm()
    q = np.array([0.3, 0.6, -2.0, 0.5, 0.0, 0.3])
    lost = arm.singularity(q).direction[3:]
    placement = arm.forward_kinematics(q)
    poses = []
    for angle in [*np.linspace(0, 0.4, 400), *[0.4] * 600]:
        axis = lost / np.linalg.norm(lost) * np.sin(angle / 2)
        turned = pp.pose(quat_xyzw=[*axis, np.cos(angle / 2)]).rotation @ placement.rotation
        poses.append(np.block([[turned, placement.translation[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))
    tracked = pp.track(arm, poses, q, dt=2e-3)
    kept_limits(arm, tracked)
    assert not tracked.ok
    assert "speed limit of" in tracked.message
    assert tracked.reached[-300:].all()


@pytest.mark.parametrize("elbow", [1.0, -1.0])
@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_the_elbow_keeps_its_side_when_the_target_leaves_and_returns(elbow, dt, ur5):
    q = np.array([0.3, -1.0, elbow, -1.0, 1.2, 0.2])
    placement, times = ur5.forward_kinematics(q), np.arange(0, 4, dt)
    poses = np.tile(placement.homogeneous, (len(times), 1, 1))
    outward = placement.translation / np.linalg.norm(placement.translation)
    poses[:, :3, 3] += 0.6 * np.sin(np.pi * np.minimum(times, 3) / 3)[:, None] ** 2 * outward
    tracked = pp.track(ur5, poses, q, dt=dt)
    kept_limits(ur5, tracked)
    assert tracked.position_error.max() > 0.3
    assert tracked.reached[times > 3.3].all()
    assert (np.sign(tracked.q[:, 2]) == elbow).all()
    assert tracked.q[-1] == pytest.approx(q, abs=1e-2)


def test_a_far_target_is_approached_at_the_speed_limit(ur5):
    q = np.array([0.3, -1.0, 1.0, -1.0, 1.2, 0.2])
    there = ur5.forward_kinematics(q + np.array([0.5, 0.2, -0.2, 0.2, 0.1, 0.3]))
    tracked = pp.track(ur5, [there] * 300, q, dt=1e-3)
    kept_limits(ur5, tracked)
    assert tracked.speed_share[:100] == pytest.approx(np.ones(100), abs=1e-9)
    slip = tracked.position_error + tracked.orientation_error
    assert (np.diff(slip[:100]) < 0).all()
    assert tracked.reached[-50:].all()


def test_given_speed_limits_are_respected(ur5):
    rates, dt = np.array([1.0, 0.5, -0.5, 0.3, 0.2, 0.4]), 1e-2
    Q = line([0.3, -1.0, 1.0, -1.0, 1.2, 0.2], rates, dt, 50)
    tracked = pp.track(ur5, ur5.forward_kinematics_batch(Q), Q[0], dt=dt, velocity=0.4)
    kept_limits(ur5, tracked, 0.4)
    assert not tracked.ok
    assert tracked.at_speed_limit[:, 0].sum() > 20
    assert "speed limit of shoulder_pan_joint" in tracked.message
    with pytest.raises(pp.errors.IkFailed, match="not reached"):
        tracked.or_raise()


def test_a_joint_at_its_position_limit_is_named(planar):
    arm = planar("-1 1", "-0.5 0.5")
    Q = line([0.0, 0.0], [0.5, 0.5], 0.01, 400)
    free = planar("-9 9", "-9 9").forward_kinematics_batch(Q)
    tracked = pp.track(arm, free, np.clip(Q[0], [-1, -0.5], [1, 0.5]), dt=0.01, task="position")
    kept_limits(arm, tracked)
    assert tracked.at_position_limit.any(axis=0).all()
    assert "position limit of j1, j2" in tracked.message
    assert tracked.reached[150:250].all()


def test_a_continuous_joint_is_not_wrapped(planar):
    arm = planar("", "-2 2")
    Q = line([0.0, 1.0], [0.9, 0.0], 0.05, 1000)
    tracked = pp.track(arm, arm.forward_kinematics_batch(Q), Q[0], dt=0.05, velocity=1.0, task="position").or_raise()
    assert tracked.q == pytest.approx(Q, abs=1e-6)
    assert np.ptp(tracked.q[:, 0]) > 6 * 2 * np.pi


def test_rotations_by_2_pi_are_kept_until_the_limit(ur5):
    """A joint with limits of +-2 pi moves from one end of its range to the other, and stops there."""
    Q = line([0.0, -1.0, 1.0, -1.0, 1.2, 0.2], [1.0, 0, 0, 0, 0, 0], 0.01, 1300)
    start = ur5.limits.clip(Q[0])
    tracked = pp.track(ur5, ur5.forward_kinematics_batch(Q), start, dt=0.01)
    kept_limits(ur5, tracked)
    inside = np.abs(Q[:, 0]) < 6.28
    assert tracked.q[inside] == pytest.approx(Q[inside], abs=1e-6)
    assert tracked.at_position_limit[-1, 0]
    assert "position limit of shoulder_pan_joint" in tracked.message


def test_coordinates_outside_the_task_are_free(ur5):
    Q = line([0.3, -1.0, 1.0, -1.0, 1.2, 0.2], [0.5, 0.3, -0.4, 0.6, 0.3, 0.8], 0.01, 100)
    poses = ur5.forward_kinematics_batch(Q)
    spun = poses @ pp.pose(rpy=(0, 0, 2.0)).homogeneous
    tracked = pp.track(ur5, spun, Q[0], dt=0.01, task="spin_z").or_raise()
    reached = ur5.forward_kinematics_batch(tracked.q)
    assert reached[:, :3, 2:] == pytest.approx(poses[:, :3, 2:], abs=2e-6)
    tracked = pp.track(ur5, spun, Q[0], dt=0.01, task="position").or_raise()
    assert ur5.forward_kinematics_batch(tracked.q)[:, :3, 3] == pytest.approx(poses[:, :3, 3], abs=1e-6)
    assert tracked.orientation_error.max() > 0.1


def test_a_goal_moves_a_redundant_arm_without_tracking_error(panda):
    q = panda.home + 0.3
    poses = [panda.forward_kinematics(q)] * 1000
    still = pp.track(panda, poses, q, dt=5e-3).or_raise()
    tracked = pp.track(panda, poses, q, dt=5e-3, goal=pp.ik.IkGoal("near", 2.0)).or_raise()
    assert np.abs(still.q - q).max() < 1e-9
    assert np.abs(tracked.q - q).max() < 1e-6
    lower, upper = panda.limits.lower, panda.limits.upper
    centred = pp.track(panda, poses, q, dt=5e-3, goal=pp.ik.IkGoal("centre", 20.0)).or_raise()
    kept_limits(panda, centred)

    def away(row):
        return np.sum(((row - (lower + upper) / 2) / (upper - lower)) ** 2)

    measure = np.array([away(row) for row in centred.q])
    assert (np.diff(measure) < 1e-9).all()
    assert measure[-1] < away(q) - 4e-4
    assert np.abs(centred.q[-1] - centred.q[-2]).max() < 1e-6


def test_times_may_be_uneven_and_begin_at_zero(ur5):
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(1e-3, 2e-2, 200)) - 1e-3
    times[0] = 0.0
    rates = np.array([0.5, 0.3, -0.4, 0.6, 0.3, 0.8])
    Q = np.array([0.3, -1.0, 1.0, -1.0, 1.2, 0.2]) + np.outer(times, rates)
    tracked = pp.track(ur5, ur5.forward_kinematics_batch(Q), Q[0], times=times).or_raise()
    kept_limits(ur5, tracked)
    assert (tracked.q[0] == Q[0]).all()
    assert tracked.q == pytest.approx(Q, abs=1e-8)
    assert len(tracked.to_path()) == len(tracked) == 200


@pytest.mark.parametrize("goal", [None, "centre"])
def test_cycles_equal_the_sequence_bit_for_bit_also_when_repeated(panda, goal):
    Q = line(panda.home, [0.9, 0.7, -0.8, 0.9, 0.9, -0.9, 1.5], 5e-3, 200)
    poses = panda.forward_kinematics_batch(Q)
    poses[120:] = poses[0]  # a jump, so that there is slip too
    complete = pp.track(panda, poses, Q[0], dt=5e-3, goal=goal)
    tracker = pp.ik.Tracker(panda, 5e-3, Q[0], goal=goal)
    for again in range(2):
        ticks = np.array([tracker.step(pose) for pose in poses])
        assert (ticks == complete.q).all(), again
        assert tracker.slip == (complete.position_error[-1], complete.orientation_error[-1])
        assert tracker.ok == complete.reached[-1]
        assert (tracker.q == complete.q[-1]).all()
        tracker.reset(Q[0])


@pytest.mark.parametrize("name", ["ur5", "panda", "stanford", "kinova", "scara"])
@examples(25)
@given(seed=st.integers(0, 10**6), dt=st.sampled_from([1e-3, 1e-2, 0.3]), singular=st.booleans())
def test_limits_hold_and_ok_is_verified_for_any_targets(name, seed, dt, singular):
    """Targets that move, jump and leave the workspace; errors are measured by Pinocchio for each sample."""
    arm, rng = ARMS[name], np.random.default_rng(seed)
    lower, upper = arm.limits.sampling_range()
    q = np.zeros(arm.dof) if singular else rng.uniform(lower, upper)
    q = arm.limits.clip(q)
    walk = q + np.cumsum(rng.normal(size=(40, arm.dof)) * rng.choice([0.1, 1.0, 3.0]) * dt, axis=0)
    walk[rng.integers(40) :] += rng.normal(size=arm.dof) * rng.choice([0.0, 1.0])
    tracked = pp.track(arm, arm.forward_kinematics_batch(walk), q, dt=dt)
    kept_limits(arm, tracked)
    for pose, row, reached in zip(tracked.poses, tracked.q, tracked.reached, strict=True):
        seen = arm.forward_kinematics(row)
        distance = np.linalg.norm(seen.translation - pose[:3, 3])
        angle = np.linalg.norm(pp.xyz_rpy(_turn(pose, seen))[3:])
        assert not reached or (distance <= 1e-6 and angle <= 2e-6)
        assert reached or distance > 0.99e-6 or angle > 0.5e-6
    assert tracked.ok == tracked.reached.all()
    assert (tracked.speed_share <= 1).all()
    assert isinstance(tracked.message, str)


def _turn(pose, seen):
    turned = np.eye(4)
    turned[:3, :3] = pose[:3, :3].T @ seen.rotation
    return turned


ARMS = {name: pp.load_robot(name).arm() for name in ["ur5", "panda", "stanford", "kinova", "scara"]}


@examples(200)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 10), rank=st.integers(1, 6))
def test_the_bounded_step_equals_scipy(seed, n, rank):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, rank)) @ rng.normal(size=(rank, n))
    pull, shift = rng.normal(size=6), 10 ** rng.uniform(-6, 0)
    low, high = -rng.uniform(0, 1, n) * rng.choice([0.1, 1.0, 10.0]), rng.uniform(1e-3, 1, n)
    low[rng.random(n) < 0.1] = 0.0
    away = rng.normal(size=n) * (rng.random() < 0.3)  # 0 need not be in the box
    low, high = low + away, high + away
    step, held, gain = _core.box_step(A, pull, shift, low, high)
    stacked, right = np.vstack([A, np.sqrt(shift) * np.eye(n)]), np.concatenate([-pull, np.zeros(n)])
    oracle = lsq_linear(stacked, right, (low, high), method="bvls", tol=1e-14).x

    def cost(d):
        return np.sum((stacked @ d - right) ** 2)

    assert (step >= low).all()
    assert (step <= high).all()
    assert cost(step) <= cost(oracle) * (1 + 1e-9) + 1e-12
    assert gain == pytest.approx(pull @ pull - np.sum((A @ step + pull) ** 2), rel=1e-9, abs=1e-9)
    assert ((held == 0) | (step == low) | (step == high)).all()


def test_the_message_describes_the_intervals_with_the_largest_errors(ur5):
    poses = np.tile(ur5.forward_kinematics(ur5.home).homogeneous, (60, 1, 1))
    jumps = {5: 0.3, 15: 0.05, 25: 0.2, 35: 0.1, 45: 0.4}  # m: poses that are out of the way for one sample
    for sample, size in jumps.items():
        poses[sample, 2, 3] += size
    message = pp.track(ur5, poses, ur5.home, dt=1e-3).message
    named = [sample for sample in jumps if f"{(sample + 1) * 1e-3:.6g} s (sample" in message]
    assert named == [5, 25, 45]
    assert "and 2 more intervals" in message


def test_a_start_within_rounding_of_a_limit_starts_at_the_limit(ur5):
    q = ur5.home.copy()
    q[2] = ur5.limits.upper[2] + 5e-10
    track = pp.track(ur5, [ur5.forward_kinematics(q)], q, dt=1e-3)
    assert ur5.limits.contains(track.q[0])
    assert track.q[0] == pytest.approx(q, abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"q0": [0, 0, 4.0, 0, 0, 0]}, "q0 must be inside the limits: elbow_joint = 4"),
        ({"poses": [np.full((4, 4), np.nan)]}, r"poses\[0\] holds numbers that are not finite"),
        ({"poses": []}, "at least one pose"),
        *(({"dt": dt}, "dt must be a finite number above 0") for dt in (0.0, -1e-3, np.nan, np.inf)),
        ({"dt": None}, "either dt"),
        ({"dt": None, "poses": [np.eye(4)] * 2, "times": [0.1, 0.1]}, "times must increase"),
        ({"dt": None, "times": [-0.1]}, "first at 0 or later"),
        *(({"velocity": velocity}, "finite and above 0") for velocity in (0.0, np.inf, [1.0, 1, 1, 1, 1, -1])),
        ({"velocity": [1.0, 2.0]}, "6 numbers"),
        ({"task": "pos"}, "spin_z"),
    ],
)
def test_invalid_input_is_refused_with_its_name(ur5, changes, message):
    request = {"poses": [ur5.forward_kinematics(ur5.home)], "q0": ur5.home, "dt": 1e-3, **changes}
    with pytest.raises(pp.UnknownNameError if "task" in changes else pp.InputError, match=message):
        pp.track(ur5, **request)


def test_unknown_speed_limits_are_named(planar):
    arm = planar("-1 1", "")
    with pytest.raises(pp.InputError, match=r"j1 1, j2 nan.*velocity="):
        pp.track(arm, [arm.forward_kinematics([0, 0])], [0, 0], dt=1e-3)


def test_a_tracker_refuses_an_invalid_pose_and_keeps_its_state(ur5):
    tracker = pp.ik.Tracker(ur5, 1e-3, ur5.home)
    assert (tracker.q == ur5.home).all()
    assert tracker.slip == (0.0, 0.0)
    with pytest.raises(pp.InputError, match="pose holds numbers that are not finite"):
        tracker.step(np.full((4, 4), np.nan))
    assert (tracker.q == ur5.home).all()


def test_a_prismatic_joint_keeps_its_speed_limit():
    urdf = (
        '<robot name="slider"><link name="l0"/><link name="l1"/><joint name="j1" type="prismatic"><parent link="l0"/>'
        '<child link="l1"/><axis xyz="1 0 0"/><limit lower="0" upper="0.5" velocity="0.2" effort="1"/></joint></robot>'
    )
    arm = load_robot(urdf).arm(tcp="l1")
    poses = [pp.pose((x, 0, 0)) for x in np.linspace(0, 0.7, 100)]
    tracked = pp.track(arm, poses, [0.0], dt=0.1)
    kept_limits(arm, tracked)
    assert tracked.reached[:70].all()
    assert tracked.q[-1] == 0.5
    assert "position limit of j1" in tracked.message
