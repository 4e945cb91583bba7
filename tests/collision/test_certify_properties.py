"""Random edges among random obstacles, judged by an oracle with its own shapes and kinematics."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
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
@examples(16)
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
