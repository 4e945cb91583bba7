"""Constraints of the tcp in proof files: verified from the numbers in the file, compared with one's own, not forged."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.motion import CubicPath
from pinproof.verifier import verify

WAYPOINTS = np.array([[-0.6, 0.0, 0.0], [0.3, 0.15, 0.8], [0.5, 0.05, 1.2]])


def constraints_of(arm):
    middle = arm.forward_kinematics(WAYPOINTS[1])
    return [
        pp.Upright.keeping(arm, WAYPOINTS[0], tolerance=1.3),
        pp.collision.LookAt(point=middle.act(np.array([0.0, 0.0, 3.0])), tolerance=1.4),
        pp.Within.line(middle.translation, (1, 2, 0.5), tolerance=1.0, point_in_tcp=(0.05, 0.0, 0.1)),
    ]


@pytest.fixture(scope="module")
def curve(crane):
    return CubicPath.through(WAYPOINTS, crane.joint_names)


@pytest.fixture(scope="module")
def checker(crane):
    return pp.CollisionChecker(crane)


@pytest.fixture(scope="module")
def certificate(crane, checker, curve):
    constraints = constraints_of(crane)
    return pp.certify(curve, checker, constraints=constraints, joint_tolerance=1e-3, record=True).or_raise()


@pytest.fixture(scope="module")
def document(certificate, checker, curve):
    return proof_document(certificate, curve, checker)


def test_a_saved_proof_covers_its_constraints(certificate, crane, curve, document):
    verdict = verify(document)
    assert verdict.ok
    assert len(verdict.constraints) == 3
    for (_, largest, tolerance, _), proof in zip(verdict.constraints, certificate.constraints, strict=True):
        sampled = max(proof.constraint.error(crane, q) for q in curve(np.linspace(*curve.domain, 300)))
        assert sampled <= largest <= tolerance == proof.constraint.tolerance


def test_a_saved_proof_is_compared_with_the_required_constraints(certificate, checker, curve, crane, tmp_path):
    file = tmp_path / "proof.json"
    certificate.save(file)
    upright, *others = constraints_of(crane)
    assert pp.verify_proof(file, checker, curve, [upright, *others]).ok
    assert "the constraints" in pp.verify_proof(file, checker, curve).not_compared
    weaker = pp.Upright(tolerance=1.35, axis_in_tcp=upright.axis_in_tcp)
    stricter = pp.Upright(tolerance=1.2, axis_in_tcp=upright.axis_in_tcp)
    assert pp.verify_proof(file, checker, curve, [weaker]).ok
    for absent in (
        stricter,
        pp.Upright(tolerance=1.3, axis_in_tcp=(0, 1, 0)),
        pp.collision.LookAt(point=(0, 0, 9), tolerance=1.4),
    ):
        verdict = pp.verify_proof(file, checker, curve, [absent])
        assert not verdict.ok
        assert verdict.reasons[0].startswith("constraints")
    with pytest.raises(pp.InputError, match="checker"):
        pp.verify_proof(file, constraints=[upright])


FORGERIES = {
    "a smaller tolerance": lambda row: row.update(tolerance=row["largest"] / 2, largest=row["largest"] / 2),
    "a smaller error": lambda row: row.update(largest=0.9 * row["largest"]),
    "an error above the tolerance": lambda row: row.update(largest=2 * row["tolerance"]),
    "no intervals": lambda row: row.update(intervals=[]),
    "a gap between intervals": lambda row: row.update(intervals=row["intervals"][:-1]),
    "an interval outside the curve": lambda row: row["intervals"].append([0.0, 99.0]),
    "an interval without a length": lambda row: row["intervals"].append([0.1, 0.1]),
    "a joint that does not exist": lambda row: row.update(joint=4),
    "another kind": lambda row: row.update(kind="upright"),
    "an unknown field": lambda row: row.update(comment="accepted"),
    "a tolerance of 0": lambda row: row.update(tolerance=0.0, largest=0.0),
    "a tolerance that is a text": lambda row: row.update(tolerance="1.3"),
    "a missing vector": lambda row: row.pop("point" if row["kind"] == "region" else "axis"),
}


@pytest.mark.parametrize("forgery", FORGERIES)
@pytest.mark.parametrize("number", range(3))
def test_a_forged_constraint_is_refused(document, forgery, number):
    forged = copy.deepcopy(document)
    FORGERIES[forgery](forged["constraints"][number])
    verdict = verify(forged)
    assert not verdict.ok
    assert verdict.reasons[0].startswith(f"constraints[{number}]")


@pytest.mark.parametrize(("number", "key"), [(0, "axis"), (0, "direction"), (1, "axis")])
def test_a_direction_without_unit_length_is_refused(document, number, key):
    forged = copy.deepcopy(document)
    forged["constraints"][number][key] = [0.0, 0.0, 2.0]
    assert not verify(forged).ok


def test_an_angle_of_a_right_angle_or_more_is_refused(document):
    """The bound is valid for convex cones only."""
    forged = copy.deepcopy(document)
    forged["constraints"][0].update(tolerance=1.6, largest=1.6)
    assert not verify(forged).ok
