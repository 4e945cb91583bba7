"""A proof that holds is compared with one's own robot, scene and motion value by value; the command reports it."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.verifier import body_digest, curve_digest, verify
from pinproof.verifier.__main__ import main

from ..collision.exact_cells import cell

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
        row["placement"][0][3] += 1e-13
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
