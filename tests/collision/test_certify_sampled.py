"""Certificates and audits of random edges of robots, against an oracle with its own shapes, and dense samples."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.collision.checking.audit import audit
from pinproof.motion import CubicPath

from ..examples import examples


@pytest.fixture(scope="module")
def torus(mesh_file):
    return mesh_file(trimesh.creation.torus(0.15, 0.04))


@cache
def arm_of(name: str) -> pp.Arm:
    """One arm of each robot: another one would sample again which of its links touch by design."""
    return pp.load_robot(name).arm()


def random_scene(rng, torus) -> pp.Scene:
    obstacles = []
    for i in range(rng.integers(1, 5)):
        size, at = rng.uniform(0.02, 0.2), rng.normal(size=3)
        shape = (
            pp.Box(size, 2 * size, size / 2),
            pp.Box(0.4, 0.3, float(rng.choice([1e-4, 1e-3, 5e-3]))),
            pp.Sphere(size),
            pp.Cylinder(0.4 * size, 2 * size),
            pp.Capsule(0.3 * size, 2 * size),
            pp.Mesh(torus, hull=bool(rng.integers(2))),
        )[rng.integers(6)]
        at *= rng.uniform(0.35, 1.0) / np.linalg.norm(at)
        obstacles.append(pp.Obstacle(f"thing_{i}", shape, pp.pose(at, rng.uniform(-3, 3, 3))))
    return pp.Scene(obstacles)


def random_curve(rng, arm, checker):
    lower, upper = arm.limits.sampling_range()
    lower, upper = np.maximum(lower, -np.pi), np.minimum(upper, np.pi)
    start = next((q for q in rng.uniform(lower, upper, (10, arm.dof)) if checker.is_free(q)), lower)
    end = start + rng.normal(size=arm.dof) * rng.choice([0.2, 0.6, 1.5])
    if rng.random() < 0.4:
        return CubicPath.through(np.stack([start, start + rng.normal(size=arm.dof) * 0.5, end]), arm.joint_names)
    return pp.JointPath(np.stack([start, end]), arm.joint_names)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof", "xarm7", "stanford"])
@examples(8)
@given(seed=st.integers(0, 2**32 - 1), margin=st.sampled_from([0.0, 0.002, 0.01]))
def test_no_verdict_is_wrong(oracle, torus, name, seed, margin):
    arm, rng = arm_of(name), np.random.default_rng(seed)
    checker = pp.CollisionChecker(arm, random_scene(rng, torus), margin=margin)
    curve, independent = random_curve(rng, arm, checker), oracle(checker)
    certificate = pp.certify(curve, checker, max_intervals=2000, limits=None)
    first, last = curve.domain
    if certificate.status is pp.CertificateStatus.FREE:
        seen = min(independent.clearance(q) for q in curve(np.linspace(first, last, 40)))
        assert seen > margin
        assert seen >= certificate.clearance - 1e-9
        assert certificate.clearance > margin
        assert certificate.observed >= certificate.clearance
    elif certificate.status is pp.CertificateStatus.COLLIDING:
        contact = certificate.first_contact
        assert contact.distance <= margin
        if contact.distance >= 0:  # what lies wholly inside a hull is not seen by the oracle
            assert independent.clearance(contact.q) <= margin + 1e-6
        assert not checker.is_free(contact.q)
        np.testing.assert_allclose(curve(contact.time), contact.q, atol=1e-9)
        before = curve(np.linspace(first, contact.proven_free_until, 30, endpoint=False))
        if contact.proven_free_until > first:
            assert min(independent.clearance(q) for q in before) > margin
    else:
        assert certificate.undecided.distance < margin + 0.05


HOME = np.array([0.0, -1.2, 1.4, -1.7, -1.57, 0.0])


@pytest.fixture(scope="module")
def arm():
    return pp.load_robot("ur5").arm()


def swing(arm):
    return pp.JointPath([HOME, HOME + np.array([1.5, 0, 0, 0, 0, 0])], arm.joint_names)


@pytest.mark.slow
@pytest.mark.parametrize("thickness", [5e-3, 0.1])
def test_a_plate_across_the_path_is_detected(arm, thickness):
    half_way = arm.forward_kinematics(HOME + np.array([0.75, 0, 0, 0, 0, 0])).translation
    plate = pp.Obstacle("plate", pp.Box(0.4, thickness, 0.4), pp.pose(half_way, (0, 0, 0.75)))
    checker = pp.CollisionChecker(arm, pp.Scene([plate]), link_meshes="mesh")
    seen = audit(swing(arm), checker)
    assert not seen.clean
    assert any("plate" in pair for _, pair in seen.contacts)
    assert "plate" in seen.message
    first = seen.contacts[0][0]
    assert not checker.is_free(swing(arm)(first))


def test_a_free_swing_is_clean_and_dense(arm):
    checker = pp.CollisionChecker(arm, link_meshes="mesh")
    seen = audit(swing(arm), checker, step=0.01)
    assert seen.clean
    assert seen.samples >= 151
    assert "no contact" in seen.message
    assert seen.geometry.startswith("7 triangle meshes, 1 simple shapes (")
    least = min(checker.clearance(q) for q in swing(arm)(np.linspace(0, 1, 16)))
    assert seen.distance == pytest.approx(least, abs=2e-3)
    assert f"{seen.distance * 1e3:.1f} mm" in seen.message


def test_meshes_are_their_triangles_whatever_the_checker_uses(arm):
    """The hulls of the links, and the convex pieces of an angle bracket, are not what is audited."""
    plates = [trimesh.creation.box((0.4, 0.4, 0.02)), trimesh.creation.box((0.4, 0.02, 0.4))]
    bracket = trimesh.boolean.union([plates[0], plates[1].apply_translation((0, 0.19, 0.19))], engine="manifold")
    shape = pp.Mesh.from_arrays(np.asarray(bracket.vertices), np.asarray(bracket.faces))
    scene = pp.Scene(
        [
            pp.Obstacle("post", pp.Box(0.1, 0.1, 1), pp.pose((-0.6, 0, 0.5))),
            pp.Obstacle("bracket", shape, pp.pose((0.2, -0.8, 0.2))),
        ]
    )
    checker = pp.CollisionChecker(arm, scene)
    assert sum(body.owner == "bracket" for body in checker.bodies) > 1
    exact = checker.exact()
    assert all(body.is_exact or body.owner in ("ee_link", "post") for body in exact.bodies)

    def owners(judge):
        return {frozenset((judge.bodies[i].owner, judge.bodies[j].owner)) for i, j in judge.pairs}

    assert owners(exact) == owners(checker)
    assert {pair.owners for pair in exact.excluded} == {pair.owners for pair in checker.excluded}
    assert audit(swing(arm), checker, step=0.2).geometry.startswith("8 triangle meshes, 2 simple shapes (")
    # A ball in the hollow of a link, which its hull fills.
    near, rng = arm.frame_placement(HOME, "upper_arm_link").translation, np.random.default_rng(0)
    for point in near + rng.uniform(-0.12, 0.12, (500, 3)):
        judge = checker.with_scene(pp.Scene([pp.Obstacle("ball", pp.Sphere(0.002), pp.pose(point))]))
        if not judge.is_free(HOME) and judge.exact().clearance(HOME) > 0.002:
            break
    still = pp.JointPath([HOME], arm.joint_names)
    assert audit(still, judge).clean
    assert not audit(still, judge, exact=False).clean


@pytest.mark.parametrize("floor", [False, True])
def test_every_pair_in_contact_is_listed_in_the_order_of_time(slider, floor):
    """The ball of 1 cm passes two obstacles at the same place, after one that the scene lists last."""
    late = [pp.Obstacle(name, pp.Sphere(0.02), pp.pose((0.3, 0.0, 0.0))) for name in ("late", "twin")]
    early = pp.Obstacle("very_early", pp.Box(0.02, 0.02, 0.02), pp.pose((0.1, 0.0, 0.0)))
    # It touches the end of the path only; its box is infinite.
    wall = [pp.Obstacle("wall", pp.HalfSpace(), pp.pose((0.51, 0, 0), (0, -np.pi / 2, 0)))] if floor else []
    checker = pp.CollisionChecker(slider, pp.Scene([*late, *wall, early]))
    curve = pp.JointPath([[0.0], [0.505]], slider.joint_names)
    seen = audit(curve, checker, step=1e-3)
    assert set(seen.contacts[0][1]) == {"ball", "very_early"}
    assert {frozenset(pair) for _, pair in seen.contacts} == {
        frozenset({"ball", name}) for name in ["very_early", "late", "twin", *(["wall"] if floor else [])]
    }
    assert np.diff([t for t, _ in seen.contacts]).min() >= 0
    assert seen.contacts[0][0] * 0.505 == pytest.approx(0.08, abs=2e-3)
    assert seen.samples >= 506
    free = audit(pp.JointPath([[0.0], [0.07]], slider.joint_names), checker, step=1e-3)
    assert free.clean
    assert free.distance == pytest.approx(0.01, abs=1e-4)
    # On a cubic too, no joint moves farther than the step between two samples: this one has a speed of 2 at its ends.
    swing = CubicPath(np.zeros((2, 1)), [[2.0], [-2.0]], [0.0, 1.0], slider.joint_names)
    assert audit(swing, checker, step=1e-3, measure=False).samples >= 2001


def test_joints_of_another_arm_and_steps_of_no_length_are_refused(arm):
    for curve, words, step in ((pp.JointPath([[0.0], [1.0]], ["j"]), "joints", 0.1), (swing(arm), "step", 0.0)):
        with pytest.raises(pp.InputError, match=words):
            audit(curve, pp.CollisionChecker(arm), step=step)
