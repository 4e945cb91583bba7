"""Certificates of splines of SciPy and of functions of the time, against dense samples of the motions themselves."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicSpline, PPoly, make_interp_spline

import pinproof as pp
from pinproof.errors import InputError

from ..examples import examples

FREE, COLLIDING = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING
VIOLATED, UNDECIDED = pp.CertificateStatus.VIOLATED, pp.CertificateStatus.UNDECIDED


class Swing:
    """Joint i moves by ``amount[i] * sin(rate[i] t)`` about a configuration; its speed is at most the product."""

    def __init__(self, middle, amount, rate) -> None:
        self.middle, self.amount, self.rate = map(np.asarray, (middle, amount, rate))
        self.bound = np.abs(self.amount * self.rate)
        self.calls = 0

    def __call__(self, t: float) -> np.ndarray:
        self.calls += 1
        return self.middle + self.amount * np.sin(self.rate * t)


@cache
def ur5_among(*boxes: tuple[float, float, float]) -> pp.CollisionChecker:
    arm = pp.load_robot("ur5").arm()
    things = [pp.Obstacle(f"box_{i}", pp.Box(0.1, 0.1, 0.1), pp.pose(xyz=xyz)) for i, xyz in enumerate(boxes)]
    return pp.CollisionChecker(arm, pp.Scene(things), margin=0.001)


@pytest.fixture
def checker() -> pp.CollisionChecker:
    return ur5_among((0.6, 0.3, 0.2))


def swing(checker, amount: float = 0.2, rate: float = 1.0) -> Swing:
    n = checker.group.dof
    return Swing(checker.group.home, np.full(n, amount), rate * (1 + 0.1 * np.arange(n)))


@pytest.mark.slow
@examples(30)
@given(st.integers(0, 2**31))
def test_a_function_is_free_only_where_dense_samples_are_and_collides_only_where_it_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    checker = ur5_among(*(tuple(x) for x in np.random.default_rng(seed % 7).uniform((-0.6,) * 3, 0.8, (3, 3))))
    n = checker.group.dof
    motion = Swing(rng.uniform(-1.5, 1.5, n), rng.uniform(0, 0.6, n), rng.uniform(0.3, 2.0, n))
    certificate = pp.certify(motion, checker, domain=(0.0, 2.0), speed_bound=motion.bound, limits=None)
    times = np.linspace(0.0, 2.0, 1500)
    clearances = [checker.clearance(motion(t)) for t in times]
    if certificate.free:
        assert min(clearances) >= certificate.clearance - 1e-9 > checker.margin - 1e-9
    elif certificate.status is COLLIDING:
        contact = certificate.first_contact
        np.testing.assert_array_equal(contact.q, motion(contact.time))
        assert not checker.is_free(contact.q)
        before = times[times < contact.proven_free_until]
        assert all(checker.is_free(motion(t)) for t in before)
    else:
        assert certificate.status is UNDECIDED
        assert min(clearances) < checker.margin + 2e-3


def test_a_thin_contact_between_coarse_samples_is_found(slider) -> None:
    """At t = 0.5 the ball is in the wall for a moment; samples at 0 and 1 are 0.3 m before it."""
    wall = pp.Obstacle("wall", pp.Box(0.02, 1, 1), pp.pose(xyz=(0.35, 0, 0)))
    checker = pp.CollisionChecker(slider, pp.Scene([wall]))
    certificate = pp.certify(
        lambda t: [0.345 - 6.9 * abs(t - 0.5) ** 1.5], checker, domain=(0.0, 1.0), speed_bound=7.4, limits=None
    )
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies[1] == "wall"
    assert 0.4 < certificate.first_contact.proven_free_until <= certificate.first_contact.time <= 0.5


@given(st.floats(-1, 1), st.floats(0.0, 2.0), st.floats(0.1, 3.0))
def test_the_deviation_is_that_of_the_motion_that_leaves_the_line_the_farthest(
    slope: float, more: float, h: float
) -> None:
    """At full speed up from one sample, then at full speed down to the other."""
    speed = abs(slope) + more + 1e-3

    def motion(t: float) -> list[float]:
        return [min(speed * t, slope * h + speed * (h - t))]

    samples = pp.motion.SampledMotion(motion, ("slide",), (0.0, h), speed)
    times = np.append(np.linspace(0.0, h, 1001), h * (slope + speed) / (2 * speed))
    farthest = max(motion(t)[0] - slope * t for t in times)
    assert samples.deviations[0, 0] == pytest.approx(farthest, abs=1e-9)
    assert samples.deviations[0, 0] >= farthest


@examples(25)
@given(st.floats(0.05, 0.95), st.floats(1e-4, 0.029))
def test_a_spike_between_samples_is_never_free(slider, at: float, height: float) -> None:
    """The ball rests 0.2 spikes before the wall, and moves into it for a moment at a time of no sample."""
    wall = pp.Obstacle("wall", pp.Box(0.02, 1, 1), pp.pose(xyz=(0.02 + 0.2 * height, 0, 0)))
    certificate = pp.certify(
        lambda t: [max(0.0, height - 2.0 * abs(t - at))],
        pp.CollisionChecker(slider, pp.Scene([wall])),
        domain=(0.0, 1.0),
        speed_bound=2.0,
        limits=None,
    )
    assert not certificate.free


def test_the_bound_is_stated_as_trusted_and_the_proof_can_be_saved(checker, tmp_path) -> None:
    motion = swing(checker)
    certificate = pp.certify(motion, checker, domain=(0.0, 3.0), speed_bound=motion.bound, record=True)
    assert certificate.status is FREE
    assert any("speed_bound, which is trusted" in note for note in certificate.notes)
    assert certificate.limits.checked == ("position", "velocity")
    certificate.save(tmp_path / "proof.json")
    assert pp.verify_proof(tmp_path / "proof.json", checker).ok


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_bound_that_samples_violate_is_refused_with_joint_and_time(checker, share: float) -> None:
    motion = swing(checker)
    with pytest.raises(InputError, match=r"speed_bound of \w+_joint, 0\.\d+ rad/s or m/s, is violated between"):
        pp.certify(motion, checker, domain=(0.0, 3.0), speed_bound=share * motion.bound)


def test_a_bound_by_interval_needs_fewer_samples(checker) -> None:
    """The motion is fast in the first tenth of a second only."""
    n = checker.group.dof
    fast = 1.5
    calls = []

    def motion(t: float) -> np.ndarray:
        calls.append(t)
        return checker.group.home + fast * min(t, 0.1) * np.eye(n)[0]

    def bound(first: float, last: float) -> np.ndarray:
        return fast * (first < 0.1) * np.eye(n)[0]

    assert pp.certify(motion, checker, domain=(0.0, 4.0), speed_bound=fast * np.eye(n)[0]).free
    constant = len(calls)
    assert pp.certify(motion, checker, domain=(0.0, 4.0), speed_bound=bound).free
    assert len(calls) - constant < constant / 4


def test_limits_of_a_function_are_compared(checker) -> None:
    arm, motion = checker.group, swing(checker)
    fast = swing(checker, rate=40.0)
    found = pp.certify(fast, checker, domain=(0.0, 1.0), speed_bound=fast.bound)
    assert found.status is VIOLATED
    assert found.violation.quantity == "velocity"
    far = Swing(arm.home, 7.0 * np.eye(arm.dof)[5], np.full(arm.dof, 0.4))
    found = pp.certify(far, checker, domain=(0.0, 4.0), speed_bound=far.bound)
    assert found.status is VIOLATED
    assert (found.violation.quantity, found.violation.joint) == ("position", "wrist_3_joint")
    # a bound above the limit proves nothing of the speed, although no sample is too fast
    loose = pp.certify(motion, checker, domain=(0.0, 1.0), speed_bound=10.0)
    assert loose.status is UNDECIDED
    assert np.isnan(loose.clearance)
    assert pp.certify(motion, checker, domain=(0.0, 1.0), speed_bound=10.0, limits=None).free


def test_a_motion_that_may_leave_its_range_between_samples_is_undecided(checker) -> None:
    arm = checker.group
    upper = arm.home.copy() + np.where(np.arange(arm.dof) == 0, 1e-5, 3.0)
    tight = pp.JointLimits(arm.home - 3.0, upper, arm.limits.velocity)
    rests = pp.certify(lambda t: arm.home, checker, domain=(0.0, 1.0), speed_bound=0.05, limits=tight)
    assert rests.status is UNDECIDED
    assert "shoulder_pan_joint" in rests.message
    assert pp.certify(lambda t: arm.home, checker, domain=(0.0, 1.0), speed_bound=0.0, limits=tight).free


def test_constraints_and_tolerances_apply_to_a_function(checker) -> None:
    arm, motion = checker.group, swing(checker)
    place = arm.forward_kinematics(arm.home)
    box = pp.Within.box(place, (0.2, 0.2, 0.2), tolerance=0.05)
    found = pp.certify(motion, checker, domain=(0.0, 3.0), speed_bound=motion.bound, constraints=[box])
    assert found.status is VIOLATED
    np.testing.assert_array_equal(found.violation.q, motion(found.violation.time))
    assert box.error(arm, found.violation.q) > box.tolerance
    assert all(box.error(arm, motion(t)) <= box.tolerance for t in np.linspace(0, found.violation.satisfied_until, 200))
    wide = pp.Within.box(place, (3.0, 3.0, 3.0), tolerance=0.05)
    certificate = pp.certify(
        motion, checker, domain=(0.0, 3.0), speed_bound=motion.bound, constraints=[wide], joint_tolerance=0.01
    )
    assert certificate.free
    assert (certificate.tube.joints > 0.01).all()


def splines(checker) -> dict[str, object]:
    times = np.array([0.0, 0.7, 1.6, 2.0, 3.0])
    points = checker.group.home + 0.3 * np.sin(np.outer(times, 1 + 0.2 * np.arange(checker.group.dof)))
    cubic = CubicSpline(times, points)
    return {
        "cubic": cubic,
        "quintic": make_interp_spline(np.linspace(0, 3, 9), cubic(np.linspace(0, 3, 9)), k=5),
        "polynomials": PPoly(cubic.c, cubic.x),
        "bernstein": BPoly.from_power_basis(cubic),
        "steps": make_interp_spline(times, points, k=1),
    }


@pytest.mark.parametrize("kind", ["cubic", "quintic", "polynomials", "bernstein", "steps"])
def test_a_spline_is_certified_as_it_is(checker, kind: str) -> None:
    spline, names = splines(checker)[kind], checker.group.joint_names
    curve = pp.motion.TimedCurvePart.of_spline(spline, names)
    times = np.linspace(0.0, 3.0, 700)
    np.testing.assert_allclose(curve(times), spline(times), atol=1e-12)
    np.testing.assert_allclose(curve.velocity(times[1:-1]), spline.derivative()(times[1:-1]), atol=1e-9)
    certificate = pp.certify(spline, checker)
    assert certificate.free
    assert certificate.limits.checked == ("position", "velocity")  # accelerations of the arm are not known
    assert certificate.curve == pp.certify(curve, checker).curve
    assert not any("trusted" in note for note in certificate.notes)


def test_a_spline_of_other_joints_and_one_that_jumps_are_refused(checker) -> None:
    cubic = splines(checker)["cubic"]
    n = checker.group.dof
    with pytest.raises(InputError, match="CubicSpline"):
        pp.certify(CubicSpline(cubic.x, cubic(cubic.x)[:, :3]), checker)
    broken = cubic.c.copy()
    broken[-1, 2, 1] += 0.1
    with pytest.raises(InputError, match=r"jumps at 1.6 s: shoulder_lift_joint by 0\.1"):
        pp.certify(PPoly(broken, cubic.x), checker)
    with pytest.raises(InputError, match="must increase"):
        pp.certify(PPoly(np.zeros((2, 1, n)), [1.0, 0.0]), checker)


@pytest.mark.parametrize(
    ("motion", "settings", "words"),
    [
        (lambda t: np.zeros(6), {}, "domain="),
        (lambda t: np.zeros(6), {"domain": (0.0, 1.0)}, "speed_bound="),
        (lambda t: np.zeros(6), {"domain": (1.0, 1.0), "speed_bound": 1.0}, "earlier"),
        (lambda t: np.zeros(5), {"domain": (0.0, 1.0), "speed_bound": 1.0}, "the motion at 0 s"),
        (lambda t: np.full(6, np.nan), {"domain": (0.0, 1.0), "speed_bound": 1.0}, "the motion at 0 s"),
        (lambda t: np.zeros(6), {"domain": (0.0, 1.0), "speed_bound": -1.0}, "0 or more"),
        (lambda t: np.zeros(6), {"domain": (0.0, 1.0), "speed_bound": np.ones(3)}, "speed_bound from"),
        ("a path", {}, "must be a curve"),
    ],
)
def test_what_a_motion_lacks_is_named(checker, motion, settings: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        pp.certify(motion, checker, **settings)


def test_a_curve_has_a_domain_of_its_own(checker) -> None:
    path = pp.JointPath(np.tile(checker.group.home, (2, 1)) + np.array([[0], [0.1]]), checker.group.joint_names)
    with pytest.raises(InputError, match="has its own"):
        pp.certify(path, checker, domain=(0.0, 1.0))
