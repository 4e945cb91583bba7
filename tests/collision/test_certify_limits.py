"""FREE includes the joint limits, for curves of every kind: in the certificate, the proof file and its verifier."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly

import pinproof as pp
from pinproof.model import load_robot
from pinproof.motion import BlendedPath, CubicPath, StreamedTrajectory, check_limits, make_program
from pinproof.verifier import Proof, verify

from ..examples import examples

FREE, VIOLATED = pp.CertificateStatus.FREE, pp.CertificateStatus.VIOLATED


@pytest.fixture(scope="module")
def checker(ur5: pp.Arm) -> pp.CollisionChecker:
    return pp.CollisionChecker(ur5)


def swing(arm: pp.Arm, amount: float, duration: float) -> pp.Trajectory:
    """The first joint moves by ``amount`` on one cubic that rests at both ends."""
    q = np.stack([arm.home, arm.home + amount * np.eye(arm.dof)[0]])
    return pp.Trajectory([0.0, duration], q, np.zeros_like(q), arm.joint_names)


def with_limits(arm: pp.Arm, **changed: object) -> pp.JointLimits:
    limits = arm.limits
    values = {kind: getattr(limits, kind) for kind in ("lower", "upper", "velocity", "acceleration")}
    return pp.JointLimits(**{**values, **changed})


def test_a_motion_at_428_times_the_speed_limit_outside_the_range_is_violated(ur5, checker) -> None:
    certificate = pp.certify(swing(ur5, 9.0, 0.01), checker)
    assert certificate.status is VIOLATED
    assert not certificate.free
    assert np.isnan(certificate.clearance)
    found = {violation.quantity: violation for violation in certificate.limits.violations}
    assert set(found) == {"position", "velocity"}
    assert found["velocity"].value == pytest.approx(1.5 * 9.0 / 0.01)
    assert found["position"].value == pytest.approx(ur5.home[0] + 9.0)
    assert found["position"].joint == "shoulder_pan_joint"
    assert found["velocity"].time == pytest.approx(0.005)
    assert found["position"].time == pytest.approx(0.01)
    assert certificate.violation is found["velocity"]  # the first one
    with pytest.raises(pp.errors.NotProvenFree):
        certificate.or_raise()


def test_limits_that_are_left_out_are_stated_in_the_notes(ur5, checker) -> None:
    certificate = pp.certify(swing(ur5, 9.0, 0.01), checker, limits=None)
    assert certificate.free
    assert certificate.limits is None
    assert any("joint limits were not compared" in note for note in certificate.notes)


def test_stated_limits_hold_for_the_arm_among_movers_too(ur5) -> None:
    scene = pp.Scene([pp.Obstacle("part", pp.Box(0.1, 0.1, 0.1), pp.pose((3, 0, 0)))])
    checker, motion = pp.CollisionChecker(ur5, scene), swing(ur5, 1.0, 2.0)
    belt = pp.Mover.constant("belt", ["part"], 0.1, 2.0)
    slow = with_limits(ur5, velocity=np.full(6, 0.7))  # the motion has 0.75 rad/s
    for limits, free in (
        ("arm", True),
        (slow, False),
        (with_limits(ur5, velocity=np.full(6, 0.8)), True),
        (None, True),
    ):
        certificate = pp.certify(motion, checker, movers=[belt], limits=limits)
        assert certificate.free is free
        assert (certificate.limits is None) is (limits is None)
    narrow = pp.CollisionChecker(ur5.with_limits(slow), scene)
    assert not pp.certify(motion, narrow, movers=[belt]).free


def test_a_contact_is_reported_before_a_violated_limit(ur5, checker) -> None:
    motion = swing(ur5, 9.0, 0.01)
    at = ur5.forward_kinematics(motion(0.005)).translation
    scene = pp.Scene([pp.Obstacle("ball", pp.Sphere(0.1), pp.pose(at))])
    certificate = pp.certify(motion, checker.with_scene(scene))
    assert certificate.status is pp.CertificateStatus.COLLIDING
    assert len(certificate.limits.violations) == 2


def test_default_accelerations_are_not_compared_and_known_ones_are(ur5, checker) -> None:
    motion = swing(ur5, 0.5, 0.6)  # the acceleration at the ends is 6 * 0.5 / 0.6^2
    known = with_limits(ur5, acceleration=np.full(6, 8.0))
    assert pp.certify(motion, checker).limits.checked == ("position", "velocity")
    assert pp.certify(motion, checker, limits=known).limits.checked == ("position", "velocity", "acceleration")
    (violation,) = pp.certify(motion, checker, limits=known).limits.violations
    assert (violation.quantity, violation.limit) == ("acceleration", 8.0)
    assert violation.value == pytest.approx(6 * 0.5 / 0.36)
    assert pp.certify(motion, checker, limits=with_limits(ur5, acceleration=np.full(6, 8.34))).status is FREE


def test_limits_of_another_number_of_joints_are_refused(ur5, checker) -> None:
    motion = swing(ur5, 0.1, 1.0)
    with pytest.raises(pp.InputError, match="7 joints"):
        pp.certify(motion, checker, limits=pp.load_robot("panda").arm().limits)
    with pytest.raises(pp.InputError, match="JointLimits"):
        pp.certify(motion, checker, limits="none")


@examples(30)
@given(seed=st.integers(0, 2**32 - 1), quintic=st.booleans())
def test_the_check_agrees_with_dense_samples(seed: int, quintic: bool) -> None:
    """Limits a little above the sampled extremes are kept, and those a little below are not, quantity by quantity."""
    rng = np.random.default_rng(seed)
    motion = random_trajectory(rng, quintic=quintic)
    knots = motion.bezier()[0]
    t = np.unique(np.concatenate([np.linspace(a, b, 800) for a, b in pairwise(knots)]))
    q, speed, rise = motion(t), np.abs(motion.velocity(t)), np.abs(motion.acceleration(t))
    inner = np.abs(motion.acceleration(np.nextafter(knots[1:], 0.0)))  # accelerations jump at knots of cubics
    tops = {"velocity": speed.max(axis=0), "acceleration": np.maximum(rise.max(axis=0), inner.max(axis=0))}
    low, high, wide = q.min(axis=0), q.max(axis=0), 1.01
    room = 0.01 * (high - low) + 1e-3
    limits = {"lower": low - room, "upper": high + room, **{kind: wide * top + 1e-3 for kind, top in tops.items()}}
    assert check_limits(motion, pp.JointLimits(**limits)).violations == ()
    joint = int(rng.integers(3))
    for kind, quantity in (("lower", "position"), ("upper", "position"), *((k, k) for k in tops)):
        less = {name: value.copy() for name, value in limits.items()}
        if quantity == "position":
            less[kind][joint] = low[joint] + 2e-6 if kind == "lower" else high[joint] - 2e-6
        else:
            less[kind][joint] = (1 - 2e-6) * tops[kind][joint]
        (violation,) = check_limits(motion, pp.JointLimits(**less)).violations
        assert (violation.joint, violation.quantity) == (NAMES[joint], quantity)
        # The value is reached at the stated time; accelerations of a cubic jump at its knots.
        derivative = {"position": motion, "velocity": motion.velocity, "acceleration": motion.acceleration}[quantity]
        instants = [violation.time, np.nextafter(violation.time, 0.0)]
        values = np.atleast_2d(derivative(instants))[:, joint]
        values = values if quantity == "position" else np.abs(values)
        assert np.abs(values - violation.value).min() <= 1e-9 * max(1.0, abs(violation.value))
        np.testing.assert_array_equal(motion(violation.time), violation.q)


@pytest.fixture(scope="module")
def document(ur5, checker, tmp_path_factory) -> dict:
    motion = pp.time_parametrise(pp.JointPath([ur5.home, ur5.home + 0.4, ur5.home - 0.2], ur5.joint_names), ur5.limits)
    file = tmp_path_factory.mktemp("proof") / "proof.json"
    known = with_limits(ur5)  # the same accelerations, stated by the caller
    certificate = pp.certify(motion, checker, limits=known, record=True)
    assert certificate.limits.checked == ("position", "velocity", "acceleration")
    certificate.save(file)
    return json.loads(file.read_text())


class TestProofFile:
    """The limits are part of the proof, and its verifier derives them again."""

    def test_the_verifier_confirms_each_quantity(self, document) -> None:
        verdict = verify(document)
        assert verdict.ok, verdict.reasons
        assert verdict.limits == ("position", "velocity", "acceleration")

    @pytest.mark.parametrize("key", ["lower", "upper", "velocity", "acceleration"])
    def test_a_limit_that_the_motion_exceeds_slightly_is_refused(self, document, key: str) -> None:
        curve = Proof(document).curve
        forged = json.loads(json.dumps(document))
        positions = curve.control.reshape(-1, curve.dof)  # the waypoints of this motion are its extremes
        tight = {"lower": positions.min(axis=0) + 1e-5, "upper": positions.max(axis=0) - 1e-5}
        at_ends = 3 * np.abs(np.diff(curve.control, axis=1)) / np.diff(curve.knots)[:, None, None]  # those of the rates
        tight["velocity"] = 0.99 * at_ends[:, [0, -1]].max(axis=(0, 1))
        tight["acceleration"] = 0.99 * np.array(document["limits"]["acceleration"])  # which the timing reaches
        forged["limits"][key] = tight[key].tolist()
        quantity = "position" if key in ("lower", "upper") else key
        (reason,) = verify(forged).reasons
        assert quantity in reason

    def test_a_proof_without_limits_states_that(self, document) -> None:
        verdict = verify({**document, "limits": None})
        assert verdict.ok
        assert verdict.limits == ()
        assert "joint limits are NOT claimed" in str(verdict)

    @pytest.mark.parametrize(
        "limits",
        [
            {},
            {"lower": [0.0]},
            {"lower": [1.0] * 6, "upper": [0.0] * 6, "velocity": [1.0] * 6, "acceleration": [1.0] * 6},
            {"lower": [None] * 6, "upper": [None] * 6, "velocity": [-1.0] * 6, "acceleration": [1.0] * 6},
            {"lower": [None] * 5, "upper": [None] * 6, "velocity": [None] * 6, "acceleration": [None] * 6},
            {"lower": ["a"] * 6, "upper": [None] * 6, "velocity": [None] * 6, "acceleration": [None] * 6},
            7,
        ],
    )
    def test_malformed_limits_are_refused(self, document, limits: object) -> None:
        assert verify({**document, "limits": limits}).reasons

    def test_wider_limits_than_those_of_the_robot_are_not_accepted(self, document, checker, tmp_path) -> None:
        (tmp_path / "proof.json").write_text(json.dumps(document))
        assert pp.verify_proof(tmp_path / "proof.json", checker).ok
        for key, by in (("upper", 0.1), ("velocity", 0.1)):
            wider = json.loads(json.dumps(document))
            wider["limits"][key] = [value + by for value in wider["limits"][key]]
            (tmp_path / "wider.json").write_text(json.dumps(wider))
            verdict = pp.verify_proof(tmp_path / "wider.json", checker)
            assert not verdict.ok
            assert all(reason.startswith(("limits: ", "and ")) for reason in verdict.reasons)

    def test_limits_that_the_proof_does_not_claim_are_not_compared(self, document, checker, tmp_path) -> None:
        none = [None] * 6
        ranges = {**document, "limits": {**document["limits"], "velocity": none, "acceleration": none}}
        (tmp_path / "ranges.json").write_text(json.dumps(ranges))
        verdict = pp.verify_proof(tmp_path / "ranges.json", checker)
        assert verdict.ok
        assert verdict.limits == ("position",)
        assert "the joint limits" not in verdict.compared
        assert any("velocity" in text for text in verdict.not_compared)

    def test_an_acceleration_that_is_known_for_one_joint_must_be_claimed(
        self, document, ur5, checker, tmp_path
    ) -> None:
        known = ur5.limits.guessed.copy()
        known[2] = False
        strict = pp.CollisionChecker(ur5.with_limits(dataclasses.replace(ur5.limits, guessed=known)))
        (tmp_path / "proof.json").write_text(json.dumps(document))
        assert pp.verify_proof(tmp_path / "proof.json", strict).ok
        less = json.loads(json.dumps(document))
        less["limits"]["acceleration"][2] = None
        (tmp_path / "less.json").write_text(json.dumps(less))
        (reason,) = pp.verify_proof(tmp_path / "less.json", strict).reasons
        assert "elbow_joint" in reason
        assert "acceleration" in reason


LIMIT = '<limit lower="-99" upper="99" velocity="99" effort="1"/>'
TEXT = """<robot name="three"><link name="base"/><link name="a"/><link name="b"/><link name="tcp"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{limit}</joint>
<joint name="lift" type="revolute"><parent link="b"/><child link="tcp"/><axis xyz="0 1 0"/>{limit}</joint></robot>"""
NAMES = ("turn", "slide", "lift")


@cache
def robot() -> pp.Robot:
    return load_robot(TEXT.format(limit=LIMIT))


def known(velocity: float, acceleration: float) -> pp.JointLimits:
    return pp.JointLimits([-9] * 3, [9] * 3, [velocity] * 3, [acceleration] * 3)


class OwnCurve:
    """A curve of another package: any class with the attributes of the protocol, with time if it has a duration."""

    def __init__(self, knots: np.ndarray, control: np.ndarray) -> None:
        self.knots, self.control, self.joint_names = knots, control, NAMES
        self.domain = (float(knots[0]), float(knots[-1]))
        self.start, self.end = control[0, 0], control[-1, -1]

    def bezier(self) -> tuple[np.ndarray, np.ndarray]:
        return self.knots, self.control

    def __call__(self, t: float | np.ndarray) -> np.ndarray:
        return BPoly(np.moveaxis(self.control, 1, 0), self.knots)(t)


class OwnTimedCurve(OwnCurve):
    @property
    def duration(self) -> float:
        return self.domain[1]

    def velocity(self, t: float | np.ndarray) -> np.ndarray:
        return BPoly(np.moveaxis(self.control, 1, 0), self.knots).derivative()(t)


def random_trajectory(
    rng: np.random.Generator, *, quintic: bool, end: float | None = None, rests: bool = False
) -> pp.Trajectory:
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, rng.integers(1, 5)))])
    if end is not None:
        times *= end / times[-1]
    q, v, a = (rng.normal(size=(len(times), 3)) for _ in range(3))
    if rests:
        v[[0, -1]] = a[[0, -1]] = 0.0
    return pp.Trajectory(times, q, v, NAMES, accelerations=a if quintic else None)


def random_curve(kind: str, rng: np.random.Generator):
    if kind in ("cubic", "quintic", "tube", "program"):
        program = kind == "program"  # which begins and ends at rest
        return random_trajectory(rng, quintic=kind == "quintic" or (program and rng.random() < 0.5), rests=program)
    path = pp.JointPath(rng.normal(size=(int(rng.integers(3, 6)), 3)), NAMES)
    lines = np.diff(path.q, axis=0)
    steps = np.linalg.norm(lines, axis=1)
    reach = np.concatenate([[0.0], rng.uniform(0.05, 0.45, len(path.q) - 2) * np.minimum(steps[:-1], steps[1:]), [0.0]])
    reach[1:-1][(lines[:-1] * lines[1:]).sum(axis=1) < -0.9 * steps[:-1] * steps[1:]] = 0.0  # almost a reversal
    curves = {
        "path": lambda: path,
        "blended": lambda: BlendedPath.rounded(path, reach),
        "cubic path": lambda: CubicPath.through(path.q, NAMES),
        "timed": lambda: pp.time_parametrise(BlendedPath.rounded(path, reach), known(2.0, 5.0)),
        "slowed": lambda: pp.time_parametrise(path, known(2.0, 5.0), jerk=40).slowed(1.3),
        "own": lambda: OwnCurve(np.array([0.0, 1.0]), rng.normal(size=(1, int(rng.integers(2, 6)), 3))),
        "own timed": lambda: OwnTimedCurve(np.array([0.0, rng.uniform(0.1, 2)]), rng.normal(size=(1, 5, 3))),
    }  # fmt: skip
    return curves[kind]()


@dataclass
class Sampled:
    """Dense samples of a curve and its derivatives: positions, velocities, accelerations (N, n) where it has time."""

    values: list[np.ndarray]
    smooth: list[BPoly]

    @classmethod
    def of(cls, curve, count: int = 400) -> Sampled:
        if isinstance(curve, pp.Trajectory):
            columns = [curve.q, curve.velocities, *([] if curve.accelerations is None else [curve.accelerations])]
            poly = BPoly.from_derivatives(curve.times, np.stack(columns, axis=1))
            smooth = [poly, poly.derivative(), poly.derivative(2)]
        else:
            knots, control = curve.bezier()
            poly = BPoly(np.moveaxis(control, 1, 0), knots)
            smooth = [poly, poly.derivative(), poly.derivative(2)] if hasattr(curve, "duration") else [poly]
        # Both sides of each knot: the acceleration may jump there.
        t = np.concatenate(
            [np.linspace(a, np.nextafter(b, a), count) for a, b in zip(poly.x, poly.x[1:], strict=False)]
        )
        return cls([each(t) for each in smooth], smooth)


def around(rng: np.random.Generator, extreme: np.ndarray) -> np.ndarray:
    """A limit for each extreme (n,): mostly above it, some just above or below."""
    close = rng.choice([1e-3, 1e-5, 3e-6, -3e-6, -1e-5, -1e-3], size=len(extreme))
    shares = np.where(rng.random(len(extreme)) < 0.9, 0.05, close)
    return extreme + shares * np.maximum(np.abs(extreme), 1e-3)


def random_limits(rng: np.random.Generator, sampled: Sampled) -> pp.JointLimits:
    q, n = sampled.values[0], sampled.values[0].shape[1]
    low, high = -around(rng, -q.min(axis=0)), around(rng, q.max(axis=0))
    low, high = np.minimum(low, high), np.maximum(low, high)
    low[rng.random(n) < 0.2], high[rng.random(n) < 0.2] = -np.inf, np.inf
    if len(sampled.values) == 1:
        return pp.JointLimits(low, high, np.full(n, 1e-3), np.full(n, 1e-3))  # a path has no rates
    rates = [np.maximum(around(rng, np.abs(each).max(axis=0)), 1e-3) for each in sampled.values[1:]]
    rates[0][rng.random(n) < 0.2] = np.nan
    rates[1][rng.random(n) < 0.2] = np.nan
    if rng.random() < 0.2:
        return pp.JointLimits(low, high, rates[0])  # guessed accelerations
    return pp.JointLimits(low, high, *rates)


def largest_excess(sampled: Sampled, limits: pp.JointLimits) -> float:
    """By how much the samples exceed the limits: rad or m of positions, relative of rates; negative inside."""
    found = [(limits.lower - sampled.values[0]).max(), (sampled.values[0] - limits.upper).max()]
    if len(sampled.values) > 1:
        rates = [limits.velocity, np.where(limits.guessed, np.nan, limits.acceleration)]
        for values, limit in zip(sampled.values[1:], rates, strict=True):
            known = ~np.isnan(limit)
            found.append((np.abs(values[:, known]) / limit[known]).max(initial=0.0) - 1.0)
    return float(max(found))


def check_statements(certificate: pp.Certificate, sampled: Sampled, names: tuple[str, ...]) -> None:
    """Each violation states joint, value, limit and time truly."""
    for violation in certificate.limits.violations:
        order = ["position", "velocity", "acceleration"].index(violation.quantity)
        joint, poly = names.index(violation.joint), sampled.smooth[order]
        sides = [violation.time, np.nextafter(violation.time, -1.0), np.nextafter(violation.time, np.inf)]
        values = poly(np.clip(sides, poly.x[0], np.nextafter(poly.x[-1], 0.0)))[:, joint]
        values = np.abs(values) if order else values
        assert np.abs(values - violation.value).min() <= 1e-6 * max(1.0, abs(violation.value))
        below = not order and violation.value < violation.limit
        assert (violation.limit - violation.value if below else violation.value - violation.limit) > 0
        assert len(violation.q) == len(names)


KINDS = ("cubic", "quintic", "path", "blended", "cubic path", "timed", "slowed", "own", "own timed", "tube", "program")


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@examples(25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_free_is_within_all_limits_and_a_violation_is_one(kind: str, seed: int, tmp_path_factory) -> None:
    rng = np.random.default_rng(seed)
    curve = random_curve(kind, rng)
    sampled = Sampled.of(curve)
    limits = random_limits(rng, sampled)
    arm = robot().arm("tcp", limits=limits)
    excess = largest_excess(sampled, arm.limits)
    checker = pp.CollisionChecker(arm)
    if kind == "program":
        goal = make_program([StreamedTrajectory(curve.record())], curve.joint_names, dialect="ros2")
        status = pp.collision.certify_program(goal, checker).status
        assert (status is FREE) <= (excess <= 1.001e-6)
        assert (status is VIOLATED) <= (excess > -1e-4)
        return
    tolerance = 0.01 if kind == "tube" else 0.0
    certificate = pp.certify(curve, checker, joint_tolerance=tolerance, record=rng.random() < 0.2)
    if certificate.free:
        assert excess <= 1.001e-6
        assert certificate.limits.violations == ()
        assert certificate.violation is None
    else:
        assert certificate.status is VIOLATED
        assert excess > -1e-4  # samples are a little below the extremes
        assert certificate.violation in certificate.limits.violations
        check_statements(certificate, sampled, NAMES)
    if certificate.free and certificate.evidence is not None:
        file = tmp_path_factory.mktemp("proof") / "proof.json"
        certificate.save(file)
        assert verify(json.loads(file.read_text())).ok
        assert pp.verify_proof(file, checker, curve).ok


@pytest.mark.slow
@examples(25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_free_of_several_arms_and_among_movers_is_within_the_limits_of_all(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [random_trajectory(rng, quintic=True, end=1.5) for _ in range(2)]
    samples = [Sampled.of(part) for part in parts]
    limits = [random_limits(rng, sampled) for sampled in samples]
    arms = {
        name: (robot().arm("tcp", limits=own), pp.pose((x, 0, 0)))
        for name, own, x in zip("ab", limits, (0, 9), strict=True)
    }
    cell = pp.assemble(arms)
    whole = pp.motion.synchronise(dict(zip("ab", parts, strict=True)), cell)
    certificate = pp.certify(whole, pp.CollisionChecker(cell))
    excess = max(largest_excess(sampled, own) for sampled, own in zip(samples, limits, strict=True))
    assert certificate.free <= (excess <= 1.001e-6)
    assert (certificate.status is VIOLATED) <= (excess > -1e-4)

    def renamed(part: pp.Trajectory, arm: str) -> pp.Trajectory:
        names = [f"{arm}/{name}" for name in NAMES]
        return pp.Trajectory(part.times, part.q, part.velocities, names, accelerations=part.accelerations)

    own, other = renamed(parts[0], "a"), renamed(parts[1], "b")
    among = pp.certify(own, pp.CollisionChecker(cell.arms["a"]), movers=[other])
    assert among.free <= (largest_excess(samples[0], limits[0]) <= 1.001e-6)
    # The other arm has the limits of its description, which this motion may exceed too.
    described = robot().arm("tcp").limits
    excess = max(largest_excess(samples[0], limits[0]), largest_excess(samples[1], described))
    assert among.free <= (excess <= 1.001e-6)
    assert (among.status is VIOLATED) <= (excess > -1e-4)


def test_an_own_curve_with_time_is_compared_with_rates_and_one_with_a_corner_has_no_finite_acceleration() -> None:
    checker = pp.CollisionChecker(robot().arm("tcp", limits=known(2.0, 50.0)))
    q = np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 0, 0]])
    fast = OwnTimedCurve(np.array([0.0, 0.1]), q[None, :2])
    assert pp.certify(fast, checker).violation.value == pytest.approx(5.0)
    corner = OwnTimedCurve(np.array([0.0, 0.5, 1.0]), np.stack([q[:2], q[1:]]))
    (violation,) = pp.certify(corner, checker).limits.violations
    assert (violation.quantity, violation.value, violation.time) == ("acceleration", np.inf, 0.5)
    assert pp.certify(OwnCurve(corner.knots, corner.control), checker).free


@pytest.mark.parametrize(
    ("knots", "control", "place"),
    [
        ([0, 1, 2], [[[0, 0, 0], [1, 0, 0]], [[2, 0, 0], [3, 0, 0]]], "turn jumps by 1"),
        ([0, 1, 0.5], [[[0, 0, 0], [1, 0, 0]], [[1, 0, 0], [3, 0, 0]]], "increase"),
        ([0, np.nan], [[[0, 0, 0], [1, 0, 0]]], "finite"),
        ([0, 1], [[[0, 0, np.nan], [1, 0, 0]]], "finite"),
        ([0, 1, 2], [[[0, 0, 0], [1, 0, 0]]], "knots"),
        ([0, 0], [[[0, 0, 0], [1, 0, 0]]], "increase"),
    ],
)
def test_an_own_curve_with_broken_pieces_is_refused(knots: list, control: list, place: str) -> None:
    checker = pp.CollisionChecker(robot().arm("tcp"))
    with pytest.raises(pp.InputError, match=place):
        pp.certify(OwnCurve(np.array(knots, dtype=float), np.array(control, dtype=float)), checker)


def test_rounding_of_pieces_of_nanoseconds_is_no_acceleration_and_a_jump_of_the_speed_is_one() -> None:
    """Positions near 3 rad are rounded by 4e-16 rad: in pieces of a nanosecond, that is 400 rad/s^2."""
    path = pp.JointPath([[3.0, 0, 0], [2.0, 1, 0], [2.5, 0, 1]], NAMES)
    limits = known(2.0, 5.0)
    motion = pp.time_parametrise(path, limits)
    inner = motion.times[len(motion.times) // 2]
    late = motion.after(inner - 1e-9)
    assert np.diff(late.times).min() < 2e-9
    assert late.max_acceleration().max() > 6.0
    assert check_limits(late, limits).violations == ()
    # The same acceleration for longer than rounding explains, and a jump of the speed within ten nanoseconds.
    times = np.array([0.0, 1e-8, 1.0])
    jump = pp.Trajectory(times, [[3, 0, 0], [3 + 5e-9, 0, 0], [4, 0, 0]], [[0, 0, 0], [1, 0, 0], [1, 0, 0]], NAMES)
    (violation,) = check_limits(jump, limits).violations
    assert (violation.joint, violation.quantity) == ("turn", "acceleration")
    assert violation.time <= 1e-8
