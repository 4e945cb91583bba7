"""The motion bound: how near bodies may come between samples, and the shortcuts that would be unsound."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pinproof import (
    Box,
    CertificateStatus,
    CollisionChecker,
    Cylinder,
    Mesh,
    Obstacle,
    Scene,
    Sphere,
    certify,
    pose,
)
from pinproof.collision.motion_bounds import MotionBounds

FREE, COLLIDING = CertificateStatus.FREE, CertificateStatus.COLLIDING


@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof", "planar_2r"])
def test_no_pair_comes_nearer_than_its_bound_allows(request, oracle, name):
    arm = request.getfixturevalue(name)
    scene = Scene([Obstacle("box", Box(0.2, 0.2, 0.2), pose((0.5, 0.3, 0.4)))])
    checker = CollisionChecker(arm, scene, attached=[Obstacle("tool", Box(0.02, 0.02, 0.2), pose((0, 0, 0.1)))])
    bounds, independent, rng = MotionBounds(checker), oracle(checker), np.random.default_rng(2)
    everything = np.arange(len(checker.pairs))
    for _ in range(6):
        q = rng.uniform(-2, 2, arm.dof)
        delta = rng.uniform(0, rng.choice([0.01, 0.1, 0.5]), arm.dof)
        frame = bounds.at(q, checker.placed(q))
        allowed, coarse, before = frame.approach(delta, everything), frame.coarse_distance(everything), None
        before = np.maximum(independent.distances(q), 0)
        assert (coarse <= before + 1e-9).all()
        for corner in rng.choice([-1.0, 1.0], size=(12, arm.dof)):
            after = np.maximum(independent.distances(q + corner * delta), 0)
            assert (before - after <= allowed + 1e-9).all()


def test_a_folded_planar_arm_is_not_judged_by_the_least_radius_or_by_exchanged_roles(planar_2r, path):
    """The second link is folded back onto the first, its tip at the shoulder, a peg beside it near the shoulder.

    The tip is 0 away from the first axis: a least radius, or joint 1 judged by another body than the one that is walked
    to, says that nothing can come nearer. In fact the far end of the folded link sweeps past.
    """
    folded = np.array([0.0, np.pi])
    peg = Obstacle("peg", Sphere(0.02), pose((0.5 * np.cos(0.35), 0.5 * np.sin(0.35), 0.03)))
    checker = CollisionChecker(planar_2r, Scene([peg]))
    assert checker.is_free(folded)
    moving = path(planar_2r, folded, folded + np.array([0.7, 0.0]))
    assert checker.is_free(moving.end)
    certificate = certify(moving, checker)
    assert certificate.status is COLLIDING
    assert "peg" in certificate.first_contact.bodies
    frame = MotionBounds(checker).at(folded, checker.placed(folded))
    names = [tuple(checker.bodies[i].owner for i in pair) for pair in checker.pairs]
    k = names.index(("fore", "peg"))
    by_hand = np.hypot(0.5, 0.01) * 0.35  # the farthest corner of the folded link from the first axis
    assert frame.approach(np.array([0.35, 0.0]), np.array([k]))[0] == pytest.approx(by_hand, rel=1e-2)


def test_a_folded_planar_arm_is_not_judged_with_roles_exchanged_joint_by_joint(arm_from_links, path, first_touch):
    """The tip is folded back onto the shoulder, a peg stands at the elbow, both small.

    The tip is near the first axis and the peg near the second: taking joint 1 by the tip and joint 2 by the peg bounds
    the approach by 3 cm. In fact the tip runs into the peg, 0.5 m away, when each joint has turned by 60 degrees; a
    little farther it is free again, so that neither end of this edge nor its middle touches.
    """
    arm = arm_from_links(
        {"base": "", "upper": "", "fore": '<sphere radius="0.01"/>@0.5 0 0', "tip": ""},
        [
            ("q1", "continuous", "base", "upper", "0 0 0", "0 0 1"),
            ("q2", "continuous", "upper", "fore", "0.5 0 0", "0 0 1"),
            ("end", "fixed", "fore", "tip", "0.5 0 0", "0 0 1"),
        ],
    ).arm(tcp="tip")
    checker = CollisionChecker(arm, Scene([Obstacle("peg", Sphere(0.01), pose((0.5, 0, 0)))]))
    folded, turn = np.array([0.0, np.pi]), np.full(2, 1.3 * np.pi / 3)
    edge = path(arm, folded - turn, folded + turn)
    for q in (edge.start, folded, edge.end):
        assert checker.clearance(q) > 0.2
    certificate = certify(edge, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(checker, edge), abs=1e-3)


def test_the_proven_clearance_is_never_above_the_true_one(slider, path):
    """Straight at a cylinder that is 0.1 m away in the end; its bounding box is turned so that it settles nothing."""
    post = Obstacle("post", Cylinder(0.3, 1), pose((0.71, 0, 0), (0, 0, np.pi / 4)))
    certificate = certify(path(slider, [0.0], [0.3]), CollisionChecker(slider, Scene([post])))
    assert certificate.status is FREE
    assert 0.05 < certificate.clearance <= 0.1


@pytest.mark.parametrize("thickness", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("kind", ["box", "disc", "hull", "exact"])
def test_a_thin_plate_across_a_fast_wrist_is_never_jumped_over(
    ur5, mesh_file, thickness, kind, path, assert_free_until
):
    """A tool of 0.5 m swings through half a turn in one edge; both ends are free."""
    shape = {
        "box": lambda: Box(0.3, 0.3, thickness),
        "disc": lambda: Cylinder(0.15, thickness),
        "hull": lambda: Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, thickness)))),
        "exact": lambda: Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, thickness))), hull=False),
    }[kind]()
    tool = Obstacle("tool", Cylinder(0.003, 0.5), pose((0, 0, 0.25)))
    start, end = ur5.home.copy(), ur5.home.copy()
    start[3] -= 1.2
    end[3] += 0.8
    middle = (start + end) / 2
    turned = ur5.forward_kinematics(middle) * pose((0, 0, 0.45), (0, np.pi / 2, 0))  # its plane holds the tool
    across = turned * pose(rpy=(0, 0, 0))
    scene = Scene([Obstacle("plate", shape, across)])
    checker = CollisionChecker(ur5, scene, attached=[tool], allowed=[("tool", f) for f in ("wrist_2_link",)])
    swing = path(ur5, start, end)
    assert checker.is_free(start)
    assert checker.is_free(end)
    certificate = certify(swing, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies == ("tool", "plate")
    assert_free_until(checker, swing, certificate.first_contact.proven_free_until, 100)
