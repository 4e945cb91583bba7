"""Constraints of the tcp: errors, the bound between samples, verdicts of certificates, and misuse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision.certificates.path_constraints import ConstraintProof, PathConstraint
from pinproof.model import load_robot

from ..examples import examples
from .conftest import urdf_of
from .exact_cells import constraint_bound

FREE, COLLIDING, VIOLATED = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING, pp.CertificateStatus.VIOLATED

START = np.array([-1.0, -1.2, 1.6, -1.97, -1.57, 0.0])


def _crane() -> pp.Arm:
    """A revolute, a prismatic and a revolute joint, and a prismatic one that follows the first prismatic one."""
    rows = (
        ("revolute", "0 0 0.3", "0 0 1"), ("prismatic", "0.4 0 0", "1 0 0"), ("revolute", "0.3 0 0.2", "0 0.6 0.8"),
        ("prismatic", "0.2 0 0", "0 0 1", '<mimic joint="j1" multiplier="-0.5"/>'),
    )  # fmt: skip
    joints = [(f"j{k}", kind, f"l{k}", f"l{k + 1}", *rest) for k, (kind, *rest) in enumerate(rows)]
    text = urdf_of({f"l{k}": "" for k in range(5)}, joints)
    text = text.replace("<origin ", '<origin rpy="0.2 0.1 0" ').replace('lower="-7" upper="7"', 'lower="-3" upper="3"')
    return load_robot(text).arm(tcp="l4")


ARMS = {name: pp.load_robot(name).arm() for name in ("ur5", "panda", "stanford", "scara")} | {"crane": _crane()}


def random_constraint(arm: pp.Arm, q: np.ndarray, rng: np.random.Generator, tolerance: float) -> PathConstraint:
    """A constraint that q (n,) satisfies, of any kind."""
    placement = arm.forward_kinematics(q)
    point, kind = rng.normal(scale=0.1, size=3), rng.integers(5)
    at = placement.act(point)
    if kind == 0:
        return pp.Upright.keeping(arm, q, tolerance=tolerance, up=rng.normal(size=3))
    if kind == 1:
        axis = rng.normal(size=3)
        target = placement.act(axis / np.linalg.norm(axis) * rng.uniform(0.2, 2.0))
        return pp.collision.LookAt(point=target, tolerance=tolerance, axis_in_tcp=axis)
    if kind == 2:
        return pp.Within.plane(at, rng.normal(size=3), tolerance=tolerance, point_in_tcp=point)
    if kind == 3:
        return pp.Within.line(at, rng.normal(size=3), tolerance=tolerance, point_in_tcp=point)
    frame = pp.pose(at, rng.normal(size=3))
    return pp.Within.box(frame, rng.uniform(0.0, 0.3, size=3), tolerance=tolerance, point_in_tcp=point)


@examples(60)
@given(name=st.sampled_from(sorted(ARMS)), seed=st.integers(0, 10**6), size=st.floats(1e-3, 1.5))
def test_no_error_on_a_piece_exceeds_its_bound(name: str, seed: int, size: float) -> None:
    """Anywhere on a cubic piece, with deviations of the joints within their tolerance."""
    arm, rng = ARMS[name], np.random.default_rng(seed)
    low, high = arm.limits.sampling_range()
    piece = rng.uniform(low, high) + size * rng.uniform(-1, 1, size=(4, arm.dof)) * rng.uniform(size=arm.dof)
    extra = rng.uniform(size=arm.dof) * rng.choice([0.0, 0.01, 0.2])
    constraint = random_constraint(arm, rng.uniform(low, high), rng, 0.5)
    error, _ = constraint_bound(arm, constraint, piece[:1], extra)
    assert error == pytest.approx(constraint.error(arm, piece[0]), abs=1e-9)
    _, bound = constraint_bound(arm, constraint, piece, extra)
    u = rng.uniform(size=(40, 1))
    basis = np.hstack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3])
    for on_curve in basis @ piece:
        assert constraint.error(arm, on_curve + extra * rng.choice([-1.0, 1.0], size=arm.dof)) <= bound


@pytest.mark.parametrize("name", sorted(ARMS))
def test_the_rounding_of_a_bound_grows_with_reach_travel_and_full_rotations(name: str) -> None:
    """Without motion the bound of a region is the error and the rounding: 1e-11 for each metre and 1,000 rad."""
    arm = ARMS[name]
    region = pp.Within.plane((0, 0, 0.1), (0, 0, 1), tolerance=0.5)
    multiplied = np.abs(arm.scale).sum(axis=0)
    for q in (np.zeros(arm.dof), np.full(arm.dof, 0.5), *(x * row for row in np.eye(arm.dof) for x in (300.0, 3e4))):
        error, bound = constraint_bound(arm, region, q[None], 0 * q)
        travel = (np.abs(q) * multiplied)[~arm.angular].sum()
        turns = max((np.abs(q) * multiplied).sum() / 1e3, 1.0)
        reach = np.linalg.norm(arm.forward_kinematics(0 * q).translation)
        assert bound - error >= 1e-11 * (max(reach, 1.0) + 0.99 * travel) * 0.99 * turns - 1e-9 * error
        assert bound - error <= 1e-11 * (6.0 + 1.01 * travel) * 1.01 * turns + 1e-9 * error


def test_a_tilt_between_two_upright_waypoints_is_found() -> None:
    """The ends satisfy the constraint; in the middle of the straight edge the tool tilts."""
    arm = ARMS["panda"]
    start, end = (
        pp.Clik().solve(arm, pp.pose((x, y, 0.3), (np.pi, 0, 0)), arm.home, rng=0).or_raise().q
        for x, y in ((0.35, -0.3), (0.6, 0.3))
    )
    upright = pp.Upright(tolerance=math.radians(1.0), axis_in_tcp=(0, 0, -1))
    assert max(upright.error(arm, start), upright.error(arm, end)) < 1e-5
    certificate = pp.certify(
        pp.JointPath([start, end], arm.joint_names), pp.CollisionChecker(arm), constraints=[upright]
    )
    assert certificate.status is VIOLATED
    assert not certificate.free
    assert np.isnan(certificate.clearance)
    assert 0 < certificate.violation.satisfied_until <= certificate.violation.time < 0.5
    with pytest.raises(pp.errors.NotProvenFree, match="upright"):
        certificate.or_raise()


def test_a_contact_is_reported_before_a_violation() -> None:
    arm = ARMS["ur5"]
    path = pp.JointPath([START, START + np.array([0, 0, 0, 1.0, 0, 0])], arm.joint_names)
    ball = pp.Obstacle("ball", pp.Sphere(0.1), pp.pose(arm.forward_kinematics(path.end).translation))
    checker = pp.CollisionChecker(arm, pp.Scene([ball]))
    certificate = pp.certify(path, checker, constraints=[pp.Upright.keeping(arm, START, tolerance=0.1)])
    assert certificate.status is COLLIDING
    assert certificate.violation is not None
    assert "upright" in certificate.message


def test_a_joint_tolerance_widens_the_bound_of_a_constraint() -> None:
    arm = ARMS["ur5"]
    path = pp.JointPath([START, START + np.array([0.5, 0, 0, 0, 0, 0])], arm.joint_names)  # about the vertical
    upright, checker = pp.Upright.keeping(arm, START, tolerance=0.05), pp.CollisionChecker(arm)
    exact = pp.certify(path, checker, constraints=[upright]).constraints[0].largest
    wide = pp.certify(path, checker, constraints=[upright], joint_tolerance=0.005).constraints[0].largest
    too_wide = pp.certify(path, checker, constraints=[upright], joint_tolerance=0.02)
    assert exact < 1e-3
    assert 4 * 0.005 < wide < 0.05  # four horizontal axes
    assert too_wide.status is pp.CertificateStatus.UNDECIDED
    assert too_wide.undecided_constraint.constraint is upright


def test_a_certificate_matches_with_the_constraints_that_it_proves() -> None:
    arm = ARMS["ur5"]
    path = pp.JointPath([START], arm.joint_names)
    upright, other = (pp.Upright.keeping(arm, START, tolerance=tolerance) for tolerance in (0.1, 0.2))
    plane = pp.Within.plane(arm.forward_kinematics(START).translation, (0, 0, 1), tolerance=1e-3)
    again = pp.Within.plane(arm.forward_kinematics(START).translation, (0, 0, 1), tolerance=1e-3)
    certificate = pp.certify(path, pp.CollisionChecker(arm), constraints=[upright, plane])
    assert certificate.free
    assert certificate.matches(path, arm, pp.Scene(), constraints=[again])
    assert certificate.matches(path, arm, pp.Scene(), constraints=[upright])
    assert certificate.matches(path, arm, pp.Scene(), constraints=[again, upright])
    assert not certificate.matches(path, arm, pp.Scene(), constraints=[other, again])
    assert certificate.matches(path, arm, pp.Scene())
    assert not certificate.matches(path, arm, pp.Scene(), constraints=[other])
    assert not pp.certify(path, pp.CollisionChecker(arm)).matches(path, arm, pp.Scene(), constraints=[upright])


def test_a_motion_file_records_its_constraints(tmp_path) -> None:
    arm, file = ARMS["ur5"], tmp_path / "motion.json"
    checker = pp.CollisionChecker(arm)
    trajectory = pp.time_parametrise(
        pp.JointPath([START, START + np.array([0.5, 0, 0, 0, 0, 0])], arm.joint_names), arm.limits
    )
    upright = pp.Upright.keeping(arm, START, tolerance=0.1)
    trajectory.save(file, certificate=pp.certify(trajectory, checker, constraints=[upright]))
    read = pp.Trajectory.load(file)
    assert any("Upright" in note for note in pp.certify(read, checker).notes)
    assert not any("Upright" in note for note in pp.certify(read, checker, constraints=[upright]).notes)


def test_a_proof_of_a_constraint_ends_with_its_number_of_intervals() -> None:
    """The error is at its limit over the whole curve of many pieces, or exceeds it in the middle of one."""
    arm = ARMS["ur5"]
    turn, tilt = np.eye(6)[0], np.eye(6)[3]
    path = pp.JointPath([START + x * turn for x in np.linspace(0, 2, 9)], arm.joint_names)
    limit = pp.Within.plane(arm.forward_kinematics(START).translation, (0, 0, 1), tolerance=2e-6)
    bent = pp.JointPath([START, START + tilt, START], arm.joint_names)
    upright = pp.Upright.keeping(arm, START, tolerance=0.3)
    checker = pp.CollisionChecker(arm)
    for curve, constraint, tolerance in ((path, limit, 3e-3), (bent, upright, 0.0)):
        complete = pp.certify(curve, checker, constraints=[constraint], joint_tolerance=tolerance)
        needed = complete.constraints[0].intervals
        assert not complete.free
        assert needed > 4
        for most in (1, 2, 4, needed):
            certificate = pp.certify(
                curve, checker, constraints=[constraint], joint_tolerance=tolerance, max_intervals=most
            )
            assert certificate.constraints[0].intervals <= most
            assert not certificate.free


def test_values_of_constraints_at_the_ends_of_their_ranges() -> None:
    assert pp.Upright(tolerance=2e-6).tolerance == 2e-6
    for smaller in (5e-7, 1e-9):
        with pytest.raises(pp.InputError, match="tolerance"):
            pp.Upright(tolerance=smaller)
    assert pp.Upright(tolerance=0.1, axis_in_tcp=(0, 3e200, 4e200)).axis_in_tcp == pytest.approx((0, 0.6, 0.8))
    at = ARMS["ur5"].forward_kinematics(START)
    for constraint in (
        pp.Within.box(at, (0, 0, 0), tolerance=0.1),
        pp.Within.plane(at.translation, (0, 0, 1), tolerance=0.1),
        pp.Within.line(at.translation, (0, 0, 1), tolerance=0.1),
    ):
        assert tuple(constraint.point_in_tcp) == (0, 0, 0)
        assert constraint.error(ARMS["ur5"], START) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("create", "words"),
    [
        (lambda: pp.Upright(tolerance=5), "286.479 deg"),
        (lambda: pp.Upright(tolerance=0.0), "tolerance"),
        (lambda: pp.Upright(tolerance=float("nan")), "tolerance"),
        (lambda: pp.Upright(tolerance=0.1, axis_in_tcp=(0, 0, 0)), "axis_in_tcp"),
        (lambda: pp.Upright(tolerance=0.1, up=(0, 1)), "up"),
        (lambda: pp.collision.LookAt(point=(0, 0, float("inf")), tolerance=0.1), "point"),
        (lambda: pp.Within.plane((0, 0, 0), (0, 0, 0), tolerance=0.1), "normal"),
        (lambda: pp.Within.line((0, 0, 0), (1, 0, 0), tolerance=-0.1), "tolerance"),
        (lambda: pp.Within.box(pp.pose(), (1, -1, 1), tolerance=0.1), "size"),
        (lambda: pp.Within(tolerance=0.1, base_from_region=pp.pose(), low=(1, 0, 0), high=(0, 0, 0)), "low"),
        (lambda: pp.Within(tolerance=0.1, base_from_region=pp.pose(), low=(0,), high=(1, 1, 1)), "low"),
        (lambda: pp.Within(tolerance=0.1, base_from_region=pp.pose(), low=(0, 0, 0), high=1), "high"),
    ],
)
def test_invalid_constraints_are_refused(create, words: str) -> None:
    with pytest.raises(pp.InputError, match=words):
        create()


@pytest.mark.parametrize("constraints", [pp.Upright(tolerance=0.1), ["upright"], [None]])
def test_an_object_that_is_not_a_constraint_is_refused(constraints) -> None:
    arm = ARMS["ur5"]
    with pytest.raises(pp.InputError, match="constraints"):
        pp.certify(pp.JointPath([START], arm.joint_names), pp.CollisionChecker(arm), constraints=constraints)


def test_the_message_names_the_limit_that_left_a_constraint_undecided() -> None:
    """One of two constraints is proven by the first interval; evidence is kept on request only."""
    arm = ARMS["ur5"]
    path = pp.JointPath([START + x * np.eye(6)[0] for x in (0.0, 2.0)], arm.joint_names)
    at = arm.forward_kinematics(START).translation
    easy, hard = (pp.Within.plane(at, (0, 0, 1), tolerance=tolerance) for tolerance in (10.0, 2e-6))
    checker = pp.CollisionChecker(arm)
    certificate = pp.certify(path, checker, constraints=[easy, hard], joint_tolerance=3e-3, max_intervals=40)
    few = [proof.intervals for proof in certificate.constraints]
    assert few[0] < 40 <= few[1]
    assert certificate.status is pp.CertificateStatus.UNDECIDED
    assert "max_intervals of the proof was reached" in certificate.message
    assert [proof.evidence for proof in certificate.constraints] == [None, None]
    coarse = pp.certify(path, checker, constraints=[easy, hard], joint_tolerance=3e-3, tolerance=1.0)
    assert "the tolerance of the proof was reached" in coarse.message
    kept = pp.certify(path, checker, constraints=[easy], record=True).constraints[0].evidence
    assert len(kept) >= 1


@pytest.mark.parametrize(
    ("constraint", "error", "text"),
    [
        (pp.Upright(tolerance=0.1), math.radians(1.001), "1.01 deg"),
        (pp.Upright(tolerance=0.1), math.radians(1.25), "1.25 deg"),
        (pp.Within.plane((0, 0, 0), (0, 0, 1), tolerance=0.1), 0.0010001, "1.001 mm"),
        (pp.Within.plane((0, 0, 0), (0, 0, 1), tolerance=0.1), 0.0, "0.000 mm"),
    ],
)
def test_a_proven_error_is_rounded_up(constraint, error: float, text: str) -> None:
    assert text in str(ConstraintProof(constraint, error, 0.0, 1))
