"""Proofs compared with one's own robot, scene, motion and constraints, value by value; the command reports it."""

from __future__ import annotations

import copy
import json

import jsonschema
import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.proof_file import constraint_of, proof_document
from pinproof.formats import file_schema
from pinproof.motion import CubicPath
from pinproof.verifier import Proof, body_digest, curve_digest, verify
from pinproof.verifier.__main__ import main

from ..collision.conftest import urdf_of
from ..collision.exact_cells import cell
from .conftest import CRANE

SHIFT = 1e-5


@pytest.fixture(scope="module")
def case():
    """A checker, a curve and the document of its proof; individual margins, limits and a constraint are stated too."""
    known = cell(1, "rrrr")
    rng = np.random.default_rng(2)
    some = rng.uniform(-0.5, 0.5, (100, 4))
    q = some[known.distances(some).min(axis=1).argmax()]
    arm = known.checker.arm
    checker = known.checker.with_margin(0.001, {("link3", "thing0"): 0.002})
    curve = pp.JointPath([q, q + 1e-3], arm.joint_names)
    upright = pp.Upright.keeping(arm, q, tolerance=0.5)
    certificate = pp.certify(curve, checker, constraints=[upright], joint_tolerance=1e-4, record=True).or_raise()
    return checker, curve, upright, proof_document(certificate, curve, checker)


def rehashed(document: dict) -> dict:
    for row in document["bodies"]:
        row["sha256"] = body_digest(row)
    c = document["curve"]
    document["hashes"]["curve"] = curve_digest(tuple(c["joint_names"]), np.array(c["knots"]), np.array(c["control"]))
    return document


def compared(document: dict, tmp_path, *args, **settings):
    (tmp_path / "proof.json").write_text(json.dumps(document))
    return pp.verify_proof(tmp_path / "proof.json", *args, **settings)


def values(holder, line=()):
    """The places of all numbers and texts."""
    for key, value in holder.items() if isinstance(holder, dict) else enumerate(holder):
        if isinstance(value, (dict, list)):
            yield from values(value, (*line, key))
        elif value is not None:
            yield (*line, key)


def test_the_proof_is_that_of_its_own_robot_scene_and_motion(case, tmp_path) -> None:
    checker, curve, upright, document = case
    verdict = compared(document, tmp_path, checker, curve, constraints=[upright])
    assert verdict.ok, verdict.reasons
    assert verdict.compared == ("the robot", "the scene", "the limits of position", "the constraints", "the motion")
    assert verdict.not_compared == ()
    unlimited = compared({**document, "limits": None}, tmp_path, checker, curve, constraints=[upright])
    assert unlimited.ok
    assert len(unlimited.not_compared) == 1
    assert "limits" in unlimited.not_compared[0]


def test_any_other_value_of_a_robot_a_scene_or_a_motion_is_not_yours(case, tmp_path) -> None:
    """Each is changed alone, by little, with right hashes: the proof then may hold, but for another cell."""
    checker, curve, upright, document = case
    ignored = {"sha256", "source", "mesh_sha256"}
    places = [("joints", *line) for line in values(document["joints"])]
    places += [("bodies", *line) for line in values(document["bodies"])]
    places += [("robot", "held", name) for name in document["robot"]["held"]]
    places += [("curve", *line) for line in values(document["curve"])]
    places = [line for line in places if line[-1] not in ignored]
    rng = np.random.default_rng(0)
    first = {tuple(key for key in line if isinstance(key, str)): line for line in places[::-1]}  # one place of each key
    chosen = {*first.values(), *(places[k] for k in rng.choice(len(places), 20, replace=False))}
    for line in sorted(chosen, key=str):
        forged = copy.deepcopy(document)
        holder = forged
        for key in line[:-1]:
            holder = holder[key]
        value = holder[line[-1]]
        holder[line[-1]] = f"{value}x" if isinstance(value, str) else value + (1 if isinstance(value, int) else SHIFT)
        verdict = compared(rehashed(forged), tmp_path, checker, curve, constraints=[upright])
        assert not verdict.ok, line
        assert np.isnan(verdict.clearance)


def test_rounding_of_a_number_is_no_difference_and_more_than_five_differences_are_counted(case, tmp_path) -> None:
    checker, curve, upright, document = case
    rounded = copy.deepcopy(document)
    for row in (*rounded["joints"], *rounded["bodies"]):
        row["placement"][0][3] += 5e-14
    assert compared(rehashed(rounded), tmp_path, checker, curve, constraints=[upright]).ok
    forged = copy.deepcopy(document)
    for k, row in enumerate(forged["bodies"][:7]):
        row["placement"][0][3] += 1e-6
        assert len(compared(rehashed(forged), tmp_path, checker, curve).reasons) == min(k + 1, 6), k
    missing = checker.with_scene(checker.scene.add(pp.Obstacle("more", pp.Sphere(0.01), pp.pose((9, 9, 9)))))
    assert len(compared(document, tmp_path, missing, curve).reasons) == 1


def test_a_link_that_your_robot_does_not_have_is_reported(case, tmp_path) -> None:
    """It is excluded from all pairs, so that the proof holds."""
    checker, curve, upright, document = case
    forged = copy.deepcopy(document)
    ghost = {**copy.deepcopy(forged["bodies"][0]), "name": "ghost_0", "owner": "ghost", "geometry": "ghost_0"}
    forged["excluded"] += [["ghost", owner, "made up"] for owner in dict.fromkeys(b["owner"] for b in forged["bodies"])]
    forged["bodies"].append(ghost)
    assert verify(rehashed(forged)).ok
    verdict = compared(forged, tmp_path, checker, curve, constraints=[upright])
    assert "ghost_0" in str(verdict)
    assert not verdict.ok


def test_the_command_returns_whether_the_proof_holds(case, tmp_path, capsys) -> None:
    document = case[3]
    for changed, code in ((document, 0), ({**document, "claim": {"status": "FREE", "clearance": 9.0}}, 1), (None, 2)):
        file = tmp_path / "proof.json"
        file.write_text("not JSON" if changed is None else json.dumps(changed))
        assert main([str(file)]) == code
        seen = capsys.readouterr()
        assert bool(seen.out) is (code < 2)
        assert bool(seen.err) is (code == 2)
        assert ("HOLDS" in seen.out) is (code == 0)
        if code < 2:
            listed = sum(line.startswith("not checked: ") for line in seen.out.splitlines())
            assert listed == (len(document["excluded"]) if code == 0 else 0)
    assert main([str(tmp_path / "nothing.json")]) == 2
    assert str(tmp_path / "nothing.json") in capsys.readouterr().err
    assert main([]) == main(["a", "b"]) == 2
    assert "usage" in capsys.readouterr().err


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


@pytest.fixture(scope="module", params=["tip", "slide"])
def offset(request):
    """Joints of both kinds, the last link of which carries a tcp at a distance, and a path with long travel.

    In the second case only a prismatic joint moves, so that no error of others adds to the bounds.
    """
    (name, kind, parent, child, _, axis), *rest = CRANE
    raised = (name, kind, parent, child, "0 0 0.3", axis)
    end = ("end", "fixed", "finger", "tip", '0.1 0.25 0.2" rpy="0.4 -0.3 0.2', "1 0 0")
    links = dict.fromkeys(("base", "bar", "slide", "hand", "finger", "tip"), "")
    arm = pp.load_robot(urdf_of(links, [raised, *rest, end], name="offset")).arm(tcp=request.param)
    points = np.array([[-0.6, 0.0, 0.0], [0.3, 2.5, 0.8], [0.3, -1.0, 0.8], [1.4, -1.0, 2.8]])
    if request.param == "slide":
        points = points[:, :2] * [0.0, 1.0]
    path = pp.JointPath(points, arm.joint_names)
    checker = pp.CollisionChecker(arm)
    return arm, path, proof_document(pp.certify(path, checker, record=True).or_raise(), path, checker)


@pytest.mark.parametrize("seed", range(2))
def test_no_sampled_error_exceeds_the_bound_of_the_verifier(offset, seed):
    """Random constraints on random intervals, also across waypoints; on short intervals the bound is close."""
    arm, path, document = offset
    rng = np.random.default_rng(seed)
    at = arm.forward_kinematics(path(rng.uniform(0, 3)))
    point = rng.normal(scale=0.1, size=3)
    constraints = [
        pp.Upright(tolerance=1.5, axis_in_tcp=rng.normal(size=3), up=rng.normal(size=3)),
        pp.collision.LookAt(point=at.act(rng.normal(size=3)), tolerance=1.5, axis_in_tcp=rng.normal(size=3)),
        pp.Within.plane(at.translation, rng.normal(size=3), tolerance=9.0, point_in_tcp=point),
        pp.Within.line(at.translation, (1, 0, 0), tolerance=9.0, point_in_tcp=point),
        pp.Within.box(pp.pose(at.translation, rng.normal(size=3)), rng.uniform(0, 0.1, 3), tolerance=9.0),
    ]
    rows = [{**constraint_of(arm, each), "largest": each.tolerance, "intervals": []} for each in constraints]
    proof = Proof({**document, "constraints": rows})
    start = rng.uniform(0, 2.99, 40)
    spans = np.column_stack([start, np.minimum(start + 10 ** rng.uniform(-4, 0.3, 40), 3.0)])
    short = np.ptp(spans, axis=1) < 1e-3
    for constraint, stated in zip(constraints, proof.constraints, strict=True):
        bounds = proof.errors_of(stated, spans)
        sampled = np.array([max(constraint.error(arm, q) for q in path(np.linspace(*span, 25))) for span in spans])
        assert (sampled <= bounds + 1e-12).all()
        close = short & (sampled < 1.2)  # angles at or beyond a right angle have no bound
        assert (bounds[close] <= sampled[close] + 0.01).all()


def test_the_schema_accepts_a_proof_and_no_other_number_of_coordinates(document) -> None:
    validator = jsonschema.Draft202012Validator(file_schema("proof"))
    whole = json.loads(json.dumps(document))
    validator.validate(whole)
    assert {row["joint"] for row in whole["bodies"]} >= {-1, 0}
    other = copy.deepcopy(whole)
    other["curve"]["control"] = other["curve"]["control"][:1]
    other["hashes"]["more"] = "0" * 64
    validator.validate(other)
    for line in (
        ("bodies", 0, "placement"), ("bodies", 0, "placement", 0), ("joints", 0, "placement", 0), ("joints", 0, "axis"),
        ("pairs", 0, "bodies"), ("pairs", 0, "directions", 0), ("excluded", 0), ("intervals", 0),
        ("constraints", 2, "low"), ("constraints", 2, "high"), ("constraints", 0, "intervals", 0),
    ):  # fmt: skip
        for change in (list.pop, lambda values: values.append(values[-1])):
            changed = copy.deepcopy(whole)
            holder = changed
            for key in line:
                holder = holder[key]
            change(holder)
            assert not validator.is_valid(changed), line
