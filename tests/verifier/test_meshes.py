"""Proofs beside exact meshes: every triangle is in a part that is apart, and nothing is inside a solid mesh."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof.collision.certificates.proof_file import proof_document
from pinproof.collision.geometry.hulls import winding_number
from pinproof.verifier import verify
from pinproof.verifier.parts import BOXED, Body, body_digest
from pinproof.verifier.proof import OUTSIDE

from .forging import Samples, box, mesh_proof, robot

MARGIN = 0.002


@pytest.fixture(scope="module")
def known():
    return mesh_proof()


@pytest.fixture
def changed(known):
    return copy.deepcopy(known)


def pair_of(document, *names):
    return next(p for p in document["pairs"] if {document["bodies"][i]["name"] for i in p["bodies"]} == set(names))


def body_of(document, name):
    return next(body for body in document["bodies"] if body["name"] == name)


def test_the_proof_holds_and_samples_agree(known):
    verdict = verify(known)
    assert verdict.ok, verdict
    assert Samples(known).violation(verdict.clearance) is None
    assert Samples(known).violation(verdict.clearance + 0.01) is not None
    assert len(pair_of(known, "held", "ring")["parts"]) > 10
    assert "parts" not in pair_of(known, "pin", "bar")


def without(key_of_row):
    def apply(document):
        pair = pair_of(document, "held", "ring")
        rows = [k for k in range(len(pair["parts"])) if not key_of_row(k)]
        for key in ("intervals", "directions", "parts"):
            pair[key] = [pair[key][k] for k in rows]

    return apply


def of_ring(change):
    return lambda document: change(pair_of(document, "held", "ring"))


def wider(pair):
    pair["parts"][0] = [0, pair["parts"][-1][1], 0, 10**6]


def move(name, axis, by):
    def apply(document):
        body_of(document, name)["placement"][axis][3] += by

    return apply


def shape(name, key, value):
    def apply(document):
        body_of(document, name)["shape"][key] = value

    return apply


def drop_triangle(document):
    body_of(document, "ring")["shape"]["triangles"].pop()
    most = len(body_of(document, "ring")["shape"]["triangles"])
    for pair in document["pairs"]:
        if "ring" in [document["bodies"][i]["name"] for i in pair["bodies"]]:
            pair["parts"] = [[*row[:-2], min(row[-2], most - 1), min(row[-1], most)] for row in pair["parts"]]


def swap_mesh(document):
    one, other = body_of(document, "ring"), body_of(document, "held")
    one["shape"], other["shape"] = other["shape"], one["shape"]


def other_triangle_order(document):
    triangles = body_of(document, "ring")["shape"]["triangles"]
    triangles[:] = [triangles[k] for k in np.random.default_rng(0).permutation(len(triangles))]


FORGED = {
    "a part is missing": (without(lambda k: k == 3), "leave out triangle"),
    "all but one part are missing": (without(lambda k: k > 0), "leave out triangle"),
    "no part": (without(lambda _: True), "nothing is proven"),
    "parts are not stated": (of_ring(lambda pair: pair.pop("parts")), "parts: is missing"),
    "a part of a convex body": (lambda d: pair_of(d, "pin", "bar").update(parts=[[0, 1]]), "must be missing"),
    "a part is shifted": (of_ring(lambda pair: pair["parts"][0].__setitem__(2, pair["parts"][0][2] + 1)), "leave out"),
    "a part is wider than the mesh": (of_ring(wider), "parts"),
    "a part is empty": (of_ring(lambda pair: pair["parts"][0].__setitem__(1, pair["parts"][0][0])), "parts"),
    "half a triangle": (of_ring(lambda pair: pair["parts"][0].__setitem__(1, 0.5)), "parts"),
    "another direction": (of_ring(lambda pair: pair["directions"].__setitem__(0, [0.0, 0.0, 1.0])), "held and ring"),
    "directions of other parts": (of_ring(lambda pair: pair["directions"].reverse()), "held and ring"),
    "the ring is nearer": (move("ring", 0, -0.05), "and ring"),
    "the pin is in the material of the ring": (move("pin", 0, 0.3), "pin"),
    "a smaller ring": (shape("ring", "vertices", (0.7 * np.array([[0.3, 0, 0]])).tolist()), "triangles"),
    "the meshes are exchanged": (swap_mesh, "held and ring"),
    "the triangles have another order": (other_triangle_order, "and ring"),
    "an open mesh is called solid": (drop_triangle, "do not enclose a volume"),
    "solid is a number": (shape("ring", "solid", 1), "must be true or false"),
    "an index beyond the vertices": (shape("ring", "triangles", [[0, 1, 10**5]]), "indices of vertices"),
    "a negative index": (shape("ring", "triangles", [[0, 1, -1]]), "indices of vertices"),
    "no triangle": (shape("ring", "triangles", []), "triangles"),
    "an unknown field": (shape("ring", "hollow", True), "unknown field"),
}


@pytest.mark.parametrize(("forge", "place"), FORGED.values(), ids=FORGED)
def test_a_forged_proof_is_refused_at_its_place_though_its_hashes_are_right(changed, forge, place):
    forge(changed)
    for body in changed["bodies"]:
        body["sha256"] = body_digest(body)
    verdict = verify(changed)
    assert not verdict.ok
    assert place in str(verdict)


@pytest.mark.parametrize("change", [shape("ring", "solid", False), move("ring", 0, 1e-9)])
def test_a_mesh_that_was_changed_by_accident_shows_in_its_hash(changed, change):
    change(changed)
    assert "sha256" in str(verify(changed))


SHELLS = {
    "a ball": trimesh.creation.icosphere(2, 1.0),
    "an inverted ball": trimesh.Trimesh(
        *(lambda m: (m.vertices, m.faces[:, ::-1]))(trimesh.creation.icosphere(2, 1.0))
    ),
    "a ball within a ball": trimesh.util.concatenate(
        [trimesh.creation.icosphere(1, 1.0), trimesh.creation.icosphere(1, 1.3)]
    ),
}


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("shell", SHELLS.values(), ids=SHELLS)
def test_what_begins_inside_a_solid_mesh_is_refused_though_no_surfaces_meet(shell, held):
    """The maker proves the motion inside a hollow shell; a forger then states that the shell is solid."""
    arm = robot("slider", [("prismatic", "1 0 0", "0 0 0", box("0.1 0.1 0.1"), "")])
    hollow = pp.Mesh.from_arrays(shell.vertices, shell.faces, hull=False, hollow=True)
    curve = pp.JointPath([[0.0], [0.2]], arm.joint_names)
    # The shell around a moving body, or carried by it around a ball.
    scene = pp.Scene([pp.Obstacle("ball", pp.Sphere(0.05), pp.pose((0, 0, 0.5)))])
    tool = [pp.Obstacle("shell", hollow)] if held else []
    scene = scene if held else scene.add(pp.Obstacle("shell", hollow))
    checker = pp.CollisionChecker(arm, scene, attached=tool)
    document = proof_document(pp.certify(curve, checker, record=True).or_raise(), curve, checker)
    assert verify(document).ok
    body = body_of(document, "shell")
    body["shape"]["solid"] = True
    body["sha256"] = body_digest(body)
    assert "is inside shell" in str(verify(document))


def test_winding_numbers_and_connected_parts_agree_with_those_of_the_checker():
    rng = np.random.default_rng(3)
    parts = [
        trimesh.creation.icosphere(1, 0.2),
        trimesh.creation.torus(0.5, 0.1, 9, 7),
        trimesh.creation.box((1, 1, 1)),
    ]
    for part, x in zip(parts, (-1.0, 0.0, 2.0), strict=True):
        part.apply_translation((x, 0, 0))
    mesh = trimesh.util.concatenate(parts)
    row = {"name": "m", "owner": "m", "kind": "obstacle", "geometry": "m", "level": 0, "joint": -1,
           "placement": np.eye(3, 4).tolist(), "sha256": "",
           "shape": {"vertices": mesh.vertices.tolist(), "triangles": mesh.faces.tolist(), "solid": True}}  # fmt: skip
    row["sha256"] = body_digest(row)
    body = Body(row, 0, 0)
    assert len(body.witnesses) == len(parts)
    points = rng.uniform(-2, 3, (300, 3)) * [1, 0.4, 0.4]
    found = [body.winding(point) for point in points]
    inside = [abs(number) > 0.5 for number, _ in found]
    assert inside == [abs(winding_number(point, mesh.triangles)) > 0.5 for point in points]
    assert any(inside)
    assert all(abs(number - round(number)) <= error < 1e-6 for number, error in found)
    for first, end in ((0, 3), (5, 5 + BOXED), (0, len(mesh.faces)), (2, len(mesh.faces) - 7)):
        u = rng.normal(size=(50, 3))
        assert (body.part(first, end).reach(u) >= (mesh.triangles[first:end].reshape(-1, 3) @ u.T).max(axis=0)).all()


@pytest.mark.parametrize("off", [0.0, 1000.0])
def test_a_point_inside_by_the_last_digit_is_never_outside(off):
    """Points beside faces, edges and corners of a cube, at a distance of some roundings or on them."""
    rng, decided = np.random.default_rng(4), 0
    cube = trimesh.creation.box((2.0, 2.0, 2.0))
    vertices = cube.vertices + off
    row = {"name": "m", "owner": "m", "kind": "obstacle", "geometry": "m", "level": 0, "joint": -1,
           "placement": np.eye(3, 4).tolist(), "sha256": "",
           "shape": {"vertices": vertices.tolist(), "triangles": cube.faces.tolist(), "solid": True}}  # fmt: skip
    body = Body(row | {"sha256": body_digest(row)}, 0, 0)
    for _ in range(3000):
        side = off + rng.choice([-1.0, 1.0], 3)
        near = side + rng.choice([0.0, 5e-324, 2.2e-16, 1e-13, 1e-10, 1e-7], 3) * rng.choice([-1.0, 1.0], 3)
        near = np.where(rng.random(3) < 0.3, np.nextafter(side, off), near)
        point = np.where(rng.random(3) < 0.6, near, off + rng.uniform(-1.2, 1.2, 3))
        number, error = body.winding(point)
        inside = ((point >= off - 1.0) & (point <= off + 1.0)).all()
        assert not (inside and abs(number) + error < OUTSIDE)
        decided += abs(number) + error < OUTSIDE
    assert decided > 1000


def test_the_proof_beside_a_mesh_of_ten_thousand_triangles_has_less_than_three_megabytes():
    ring = trimesh.creation.torus(0.3, 0.06, 100, 50)
    arm = pp.load_robot("ur5").arm()
    mesh = pp.Mesh.from_arrays(ring.vertices, ring.faces, hull=False)
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("ring", mesh, pp.pose((0.5, 0.3, 0.3)))]), margin=MARGIN)
    curve = pp.JointPath([arm.home, arm.home + 0.12], arm.joint_names)
    certificate = pp.certify(curve, checker, record=True).or_raise()
    document = proof_document(certificate, curve, checker)
    assert verify(document).clearance >= certificate.clearance - 1e-6
    assert len(json.dumps(document)) < 3e6
