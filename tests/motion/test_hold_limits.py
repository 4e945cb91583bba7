"""Limits of a motion by the grip: against linear programmes, closed forms, Newton-Euler, and a simulation."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest
from benchmarks.holding import PAD, TIP, Carried, across, random_grasp, share_by_pyramids, simulated

import pinproof as pp
from pinproof.errors import InputError, SlipError
from pinproof.motion import ContactPatch, HoldLimits, HoldPeak

MU, FORCE = 0.5, 20.0
SHARE = 2e-4
"""The relative tolerance of shares, which are upper bounds."""


@pytest.fixture(scope="module")
def arm() -> pp.Arm:
    return pp.load_robot("ur5").arm(tcp="tool0")


def square(at, normal, side: float = 0.01) -> np.ndarray:
    """Points of a square patch."""
    steps = side * ((np.arange(30) + 0.5) / 30 - 0.5)
    return at + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) @ across(np.asarray(normal, dtype=float))


def two_fingers(force: float = FORCE, width: float = 0.04, side: float = 0.01, at=(0, 0, 0.1)) -> list[ContactPatch]:
    """Two pads that close along y of the tcp."""
    at = np.array(at)
    return [
        ContactPatch(square(at - [0, s * width / 2, 0], (0, s, 0), side), (0, s, 0), force, MU) for s in (1.0, -1.0)
    ]


def about(at, *wrenches) -> np.ndarray:
    """Wrenches about a point as wrenches about the tcp."""
    rows = np.array(wrenches, dtype=float)
    return np.hstack([rows[:, :3], rows[:, 3:] + np.cross(at, rows[:, :3])])


# -- loads -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("points", "count"), [(8, 12), (60, 4)])
def test_share_is_within_the_bracket_of_linear_programmes(arm, points, count) -> None:
    """Joined to 6 x 6 cells, patches of many points transmitted up to 30 % less, where tilting moments limit them."""
    rng, done = np.random.default_rng(0), 0
    while done < count:
        _, contacts, wrench = random_grasp(rng, points)
        try:
            (share,) = HoldLimits(arm, pp.Payload(1.0), contacts).shares([wrench])
        except InputError:
            continue
        done += 1
        low, high = (share_by_pyramids(contacts, wrench, inside=inside) for inside in (False, True))
        assert low * (1 - 1e-6) <= share <= high * (1 + 1e-3)


def test_share_is_right_where_points_of_a_patch_need_no_friction(arm) -> None:
    rng, done = np.random.default_rng(2), 0
    while done < 198:  # of this grasp, the best direction is across a pad, up to rounding
        _, contacts, wrench = random_grasp(rng, 12)
        try:
            limits = HoldLimits(arm, pp.Payload(1.0), contacts)
        except InputError:
            continue
        done += 1
        rng.normal(0, 0.1)
    for change in 1.0 + 0.02 * rng.standard_normal((8, 6)):
        (share,) = limits.shares([change * wrench])
        low, high = (share_by_pyramids(contacts, change * wrench, inside=inside) for inside in (False, True))
        assert low * (1 - 1e-6) <= share <= high * (1 + 1e-3)


def test_share_is_tight_where_a_grip_hardly_resists_the_opposite_load(arm) -> None:
    """The friction cones of inclined pads almost miss each other: what a displaced load may change was 1 %."""
    tilt = 0.9997 * np.arctan(MU)
    normals = [np.array([side * np.cos(tilt), 0.0, np.sin(tilt)]) for side in (1.0, -1.0)]
    pads = [square((0, 0, 0.1) - 0.02 * normal, normal).reshape(30, 30, 3)[::14, ::14] for normal in normals]
    contacts = [ContactPatch(pad.reshape(-1, 3), n, FORCE, MU) for pad, n in zip(pads, normals, strict=True)]
    limits = HoldLimits(arm, pp.Payload(1.0), contacts)
    for load in about((0, 0, 0.1), (0.1, -0.1, 0.6, 0, 0.002, 0), (-0.1, 0.05, 0.8, 0.001, 0, 0.002)):
        (share,) = limits.shares([load])
        low, high = (share_by_pyramids(contacts, load, inside=inside) for inside in (False, True))
        assert low * (1 - 1e-6) <= share <= high * (1 + 1e-3)


def test_limits_of_two_fingers_are_those_of_coulomb(arm) -> None:
    limits = HoldLimits(arm, pp.Payload(1.0), two_fingers())
    across_pads, along, torsion, couple = about(
        (0, 0, 0.1),
        (0, 0, 2 * MU * FORCE, 0, 0, 0), (0, FORCE, 0, 0, 0, 0), (0, 0, 0, 0, 2 * MU * FORCE * 0.003826, 0),
        (0, 0, 0, 0, 0, 2 * MU * FORCE * 0.02),
    )  # fmt: skip
    shares = limits.shares([across_pads, along, torsion])
    assert shares[:2] == pytest.approx(1.0, abs=3e-4)
    assert 1.0 - 3e-4 <= shares[2] <= 1.012  # 0.3826 of the side is the mean distance from the centre of a square
    # The couple of the friction, 2 mu F times half the width, and what the tilt of the pressure adds
    assert 0.7 < limits.shares([couple])[0] < 1.0


def test_limits_of_a_cup_are_pull_off_friction_and_tilt(arm) -> None:
    turns, radius = 2 * np.pi * np.arange(64) / 64, 0.02
    rim = np.column_stack([radius * np.cos(turns), radius * np.sin(turns), np.full(64, 0.1)])
    limits = HoldLimits(arm, pp.Payload(1.0), [ContactPatch(rim, (0, 0, 1), 60.0, MU, pulls=True)])
    pulled, sheared, tilted, turned = about(
        (0, 0, 0.1), (0, 0, -60, 0, 0, 0), (MU * 60, 0, 0, 0, 0, 0), (0, 0, 0, 60 * radius / 2, 0, 0),
        (0, 0, 0, 0, 0, MU * 60 * radius),
    )  # fmt: skip
    shares = limits.shares([-pulled, pulled, sheared, tilted, turned])
    assert shares[:3] == pytest.approx(1.0, abs=3e-4)
    assert (shares[3:] >= 1.0 - 3e-4).all()
    assert (shares[3:] <= 1.06).all()  # few points of the rim press a little nearer to its centre
    both = limits.shares([0.5 * pulled + 0.5 * sheared])[0]
    assert both == pytest.approx(1.0, abs=3e-4)  # a load that pulls takes from what friction may carry


# -- motions -----------------------------------------------------------------------------------------------------------

PART = pp.Payload(0.5, (0.004, 0.003, 0.112), (0.002, 0.001, 0.0015))


def newton_euler(arm: pp.Arm, trajectory: pp.Trajectory, count: int = 1000, fall: float = 9.81) -> np.ndarray:
    """(count, 6) the loads of the part by Pinocchio's accelerations of the frame of the tcp."""
    model = arm.model
    data, frame = model.createData(), model.getFrameId(arm.tcp)
    body = pin.Inertia(PART.mass, np.array(PART.center_of_mass), np.array(PART.inertia))
    loads = []
    for t in np.linspace(0.0, trajectory.duration, count):
        pin.forwardKinematics(model, data, trajectory(t), trajectory.velocity(t), trajectory.acceleration(t))
        pin.updateFramePlacements(model, data)
        v, a = (f(model, data, frame, pin.LOCAL) for f in (pin.getFrameVelocity, pin.getFrameAcceleration))
        gravity = pin.Motion(data.oMf[frame].rotation.T @ [0, 0, -fall], np.zeros(3))
        load = body * (a - gravity) + v.cross(body * v)
        loads.append([*load.linear, *load.angular])
    return np.array(loads)


def path(arm: pp.Arm, rng: np.random.Generator) -> pp.motion.CubicPath:
    """A smooth path on which the part hangs between the pads, which stay within 20 degrees of upright."""
    turn = np.array([1.0, 0.15, 0.15, 0.1, 0.1, 1.0])
    q = arm.home + turn * rng.uniform(-0.8, 0.8, (4, 6))
    return pp.motion.CubicPath.through(q, arm.joint_names)


def nearly_slipping(arm: pp.Arm, curve: pp.motion.CubicPath, part: pp.Payload = PART, **pads: float) -> HoldLimits:
    """The limits of a grip of which gravity alone uses up to 92 % on a path."""
    limits = HoldLimits(arm, part, two_fingers(**pads))
    rests = [limits.at_rest(arm.root_from_frame(q, arm.tcp)).share for q in curve(np.linspace(*curve.domain, 50))]
    return HoldLimits(arm, part, two_fingers(force=FORCE * max(rests) / 0.92, **pads))


@pytest.mark.parametrize("seed", range(4))
def test_no_sample_needs_more_than_the_proven_bound(arm, seed) -> None:
    limits = HoldLimits(arm, PART, two_fingers())
    motion = pp.time_parametrise(path(arm, np.random.default_rng(seed)), arm.limits)
    shares, peak = limits.shares(newton_euler(arm, motion)), limits.peak(motion)
    assert shares.max() <= peak.share <= 1.005 * shares.max()
    loads, times = newton_euler(arm, motion), np.linspace(0.0, motion.duration, 1000)
    assert peak.force == pytest.approx(np.linalg.norm(loads[np.abs(times - peak.time).argmin(), :3]), rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_motion_that_is_slowed_by_the_excess_holds_at_every_sample(arm, seed) -> None:
    curve = path(arm, np.random.default_rng(seed))
    motion, limits = pp.time_parametrise(curve, arm.limits), nearly_slipping(arm, curve)
    excess = limits.excess(motion).max()
    assert excess > 1.0
    assert not limits.peak(motion).holds
    slow = motion.slowed(excess)
    assert limits.peak(slow).holds
    assert 0.99 < limits.shares(newton_euler(arm, slow)).max() <= 1.0 + SHARE


def test_bound_covers_the_inside_of_a_long_piece(arm) -> None:
    rng, inside = np.random.default_rng(0), 0
    limits = HoldLimits(arm, PART, two_fingers(), gravity=(0, 0, -0.5))
    for _ in range(12):
        q = arm.home + rng.uniform(-1.5, 1.5, (2, 6))
        motion = pp.Trajectory([0.0, rng.uniform(0.5, 1.0)], q, np.zeros((2, 6)), arm.joint_names)
        shares = limits.shares(newton_euler(arm, motion, fall=0.5))
        assert shares.max() <= limits.peak(motion).share <= 1.003 * shares.max()
        inside += 0 < shares.argmax() < 999
        tight = HoldLimits(arm, PART, two_fingers(FORCE * shares.max() / 1.01), gravity=(0, 0, -0.5))
        slow = motion.slowed(float(tight.excess(motion).max()))
        assert slow.duration > motion.duration
        assert tight.shares(newton_euler(arm, slow, fall=0.5)).max() <= 1.0 + SHARE
    assert inside >= 4


def test_timing_is_as_fast_as_the_grip_allows(arm) -> None:
    curve = path(arm, np.random.default_rng(1))
    free = pp.time_parametrise(curve, arm.limits)
    limits = nearly_slipping(arm, curve)
    motion = pp.time_parametrise(curve, arm.limits, rate_limits=[limits])
    assert motion.duration > free.duration
    assert limits.excess(motion).max() <= 1.0 + 1e-9
    assert limits.peak(motion).reserve < 0.01
    assert limits.shares(newton_euler(arm, motion)).max() <= 1.0 + SHARE
    slowed = free.slowed(limits.excess(free).max())
    assert motion.duration < slowed.duration


def test_path_on_which_gravity_alone_is_too_much_cannot_be_timed(arm) -> None:
    limits = HoldLimits(arm, PART, two_fingers(force=3.0))
    with pytest.raises(SlipError, match=r"slips at rest .* N and .* N m of .* N"):
        pp.time_parametrise(path(arm, np.random.default_rng(1)), arm.limits, rate_limits=[limits])
    rest = limits.at_rest(arm.root_from_frame(arm.home, arm.tcp))
    assert rest.force == pytest.approx(0.5 * 9.81)
    assert not rest.holds


def test_limits_are_pickled_with_their_contacts(arm) -> None:
    limits = HoldLimits(arm, PART, two_fingers(), gravity=(0, 0, -1.62))
    load = [[1.0, 2.0, -3.0, 0.1, 0.0, 0.05]]
    assert pickle.loads(pickle.dumps(limits)).shares(load) == pytest.approx(limits.shares(load))


def test_contacts_that_resist_nothing_in_a_direction_are_refused(arm) -> None:
    with pytest.raises(InputError, match="every direction"):
        HoldLimits(arm, PART, two_fingers()[:1])
    with pytest.raises(InputError, match="at least one"):
        HoldLimits(arm, PART, [])
    with pytest.raises(InputError, match="friction"):
        ContactPatch([[0, 0, 0]], (0, 0, 1), 10.0, 0.0)


# -- simulation --------------------------------------------------------------------------------------------------------


def test_part_stays_in_the_simulated_hand_and_slips_with_half_of_the_friction(arm) -> None:
    size, payload = np.array([0.04, 0.03, 0.05]), pp.Payload(0.4, (0.002, 0, 0.004), (2e-4, 2e-4, 2e-4))
    tcp_from_part = pp.pose(TIP, (np.pi, 0, 0))
    curve = path(arm, np.random.default_rng(1))
    limits = nearly_slipping(arm, curve, payload.placed(tcp_from_part), width=size[1], side=PAD[0], at=TIP)
    motion = pp.time_parametrise(curve, arm.limits, rate_limits=[limits])
    assert limits.peak(motion).reserve < 0.05
    carried = Carried(arm, motion, size, tcp_from_part, payload, TIP, PAD, limits.contacts[0].force, MU)
    moved, turned = simulated(carried)
    assert moved < 1e-3
    assert turned < np.deg2rad(2.0)
    assert simulated(carried, slippery=0.5)[0] > 5e-3


def test_part_does_not_creep_in_a_simulated_hand_that_rotates_far_from_the_origin_of_the_tcp(arm) -> None:
    """Simulated with the body of the hand at the tcp, the part moved by 2.6 mm, with half of the grip in reserve."""
    payload, tcp_from_part = pp.Payload(0.3, (0, 0, 0), (2e-4, 2e-4, 2e-4)), pp.pose(TIP, (np.pi, 0, 0))
    limits = HoldLimits(arm, payload.placed(tcp_from_part), two_fingers(40.0, width=0.03, side=PAD[0], at=TIP))
    turn = np.array([arm.home, arm.home + np.array([0, 0, 0, 0, 3.0, 0])])
    motion = pp.Trajectory([0.0, 0.8], turn, np.zeros((2, 6)), arm.joint_names)
    assert limits.peak(motion).reserve > 0.5
    size = np.array([0.04, 0.03, 0.05])
    assert simulated(Carried(arm, motion, size, tcp_from_part, payload, TIP, PAD, 40.0, MU))[0] < 4e-4


def test_motion_on_which_the_part_slips_even_at_rest_has_a_peak(arm) -> None:
    limits = HoldLimits(arm, PART, two_fingers(force=0.3 * FORCE))
    path = pp.JointPath([arm.home, arm.home + np.array([0.3, 0.2, 0, 0, 0, 0.2])], arm.joint_names)
    trajectory = pp.time_parametrise(path, arm.limits)
    with pytest.raises(SlipError):
        limits.excess(trajectory)
    peak = limits.peak(trajectory)
    assert not peak.holds
    assert peak.share >= limits.shares(newton_euler(arm, trajectory)).max() * (1 - 1e-3)


def test_the_stated_factor_of_the_duration_is_not_rounded_below_the_proven_one() -> None:
    peak = HoldPeak(1.2, 0.5, 10.0, 1.0, 12.344)
    assert float(str(peak).split("held in ")[1].split()[0]) >= 12.344
