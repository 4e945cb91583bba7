"""FREE includes the joint limits: in the certificate, in the proof file, and for its verifier."""

from __future__ import annotations

import dataclasses
import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.motion import BlendedPath, check_limits
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


def test_a_path_is_compared_with_the_ranges_only(ur5, checker) -> None:
    path = pp.JointPath([ur5.home, ur5.home + 9.0 * np.eye(6)[0]], ur5.joint_names)
    certificate = pp.certify(path, checker)
    assert (certificate.status, certificate.limits.checked) == (VIOLATED, ("position",))
    assert pp.certify(pp.JointPath([ur5.home, ur5.home + 0.1], ur5.joint_names), checker).status is FREE


def test_a_blend_that_swings_past_a_limit_only_between_its_waypoints_is_violated(ur5, checker) -> None:
    control = np.stack([ur5.home, ur5.home + 0.3 * np.eye(6)[0], ur5.home])[None]
    curve = BlendedPath([0.0, 1.0], control, ur5.joint_names)
    upper = ur5.limits.upper.copy()
    for room, status in ((0.149, VIOLATED), (0.151, FREE)):  # the top of this parabola is at 0.15
        upper[0] = ur5.home[0] + room
        assert pp.certify(curve, checker, limits=with_limits(ur5, upper=upper)).status is status


def test_limits_of_another_number_of_joints_are_refused(ur5, checker) -> None:
    motion = swing(ur5, 0.1, 1.0)
    with pytest.raises(pp.InputError, match="7 joints"):
        pp.certify(motion, checker, limits=pp.load_robot("panda").arm().limits)
    with pytest.raises(pp.InputError, match="JointLimits"):
        pp.certify(motion, checker, limits="none")


def random_motion(rng: np.random.Generator, dof: int, *, quintic: bool) -> pp.Trajectory:
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, rng.integers(1, 5)))])
    q, v, a = (rng.normal(size=(len(times), dof)) for _ in range(3))
    return pp.Trajectory(times, q, v, [f"j{k}" for k in range(dof)], accelerations=a if quintic else None)


@examples(60)
@given(seed=st.integers(0, 2**32 - 1), quintic=st.booleans())
def test_the_check_agrees_with_dense_samples(seed: int, quintic: bool) -> None:
    """Limits a little above the sampled extremes are kept, and those a little below are not, quantity by quantity."""
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, 2, quintic=quintic)
    knots = motion.bezier()[0]
    t = np.unique(np.concatenate([np.linspace(a, b, 800) for a, b in pairwise(knots)]))
    q, speed, rise = motion(t), np.abs(motion.velocity(t)), np.abs(motion.acceleration(t))
    inner = np.abs(motion.acceleration(np.nextafter(knots[1:], 0.0)))  # accelerations jump at knots of cubics
    tops = {"velocity": speed.max(axis=0), "acceleration": np.maximum(rise.max(axis=0), inner.max(axis=0))}
    low, high, wide = q.min(axis=0), q.max(axis=0), 1.01
    room = 0.01 * (high - low) + 1e-3
    limits = {"lower": low - room, "upper": high + room, **{kind: wide * top + 1e-3 for kind, top in tops.items()}}
    assert check_limits(motion, pp.JointLimits(**limits)).violations == ()
    joint = int(rng.integers(2))
    for kind, quantity in (("lower", "position"), ("upper", "position"), *((k, k) for k in tops)):
        less = {name: value.copy() for name, value in limits.items()}
        if quantity == "position":
            less[kind][joint] = low[joint] + 2e-6 if kind == "lower" else high[joint] - 2e-6
        else:
            less[kind][joint] = (1 - 2e-6) * tops[kind][joint]
        (violation,) = check_limits(motion, pp.JointLimits(**less)).violations
        assert (violation.joint, violation.quantity) == (f"j{joint}", quantity)
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


@pytest.mark.parametrize("seed", range(8))
def test_a_violation_states_the_time_at_which_its_value_is_reached(seed: int) -> None:
    """The knots are not at whole numbers, so that a time is not the share of a piece."""
    motion = random_motion(np.random.default_rng(seed), 2, quintic=bool(seed % 2))
    low, high = motion.range()
    inner = 0.1 * (high - low) + 1e-3
    limits = pp.JointLimits(low + inner, high - inner, 0.9 * motion.max_velocity(), np.full(2, np.nan))
    found = check_limits(motion, limits).violations
    assert len(found) >= 2
    for violation in found:
        joint = list(motion.joint_names).index(violation.joint)
        rates = {"position": motion(violation.time), "velocity": np.abs(motion.velocity(violation.time))}
        assert rates[violation.quantity][joint] == pytest.approx(violation.value, rel=1e-6, abs=1e-9)
