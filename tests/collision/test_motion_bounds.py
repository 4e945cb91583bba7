"""The motion bound: how near bodies may come between samples, and the shortcuts that would be unsound."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof import _core

FREE, COLLIDING = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING


class Bounds:
    """The core's bounds of a checker's pairs on a piece about q: by default straight, from -delta to delta."""

    def __init__(self, checker, q, delta, extra=None, piece=None):
        extra = np.zeros(len(q)) if extra is None else extra
        self.piece = np.array([q - delta, q + delta]) if piece is None else piece
        self._core = _core.MotionBounds(checker.world, q, np.abs(self.piece - q).max(axis=0), extra)
        self.roughly = self._core.rough

    def closely(self, k, u, split=None):
        split = self.roughly(k).split if split is None else split
        bound = self._core.tight(k, u, split, self.piece)
        return bound.distance, bound.growth


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof", "stanford", "planar_2r"])
def test_no_pair_comes_nearer_than_its_rough_bound_allows(request, oracle, name):
    """Anywhere in the box about q, tolerance and growth included."""
    arm = pp.load_robot("stanford").arm() if name == "stanford" else request.getfixturevalue(name)
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.2, 0.2), pp.pose((0.5, 0.3, 0.4)))])
    checker = pp.CollisionChecker(
        arm, scene, attached=[pp.Obstacle("tool", pp.Box(0.02, 0.02, 0.2), pp.pose((0, 0, 0.1)))]
    )
    independent, rng = oracle(checker), np.random.default_rng(2)
    for _ in range(6):
        q, more = rng.uniform(-2, 2, arm.dof), float(rng.choice([0.0, 0.01, 0.2]))
        delta, extra = rng.uniform(0, rng.choice([0.01, 0.1, 0.5]), arm.dof), rng.uniform(0, 0.05, arm.dof)
        bounds = Bounds(checker, q, delta, extra)
        said = [bounds.roughly(k) for k in range(len(checker.pairs))]
        allowed = np.array([bound.distance + more * bound.growth for bound in said])
        before = np.maximum(independent.distances(q), 0)
        for corner in rng.choice([-1.0, 1.0], size=(12, arm.dof)):
            after = np.maximum(independent.distances(q + corner * (delta + extra + more)), 0)
            assert (before - after <= allowed + 1e-9).all()


@pytest.mark.parametrize("name", ["ur5", "panda", "generic_6dof", "stanford", "planar_2r"])
@pytest.mark.parametrize("straight", [True, False])
def test_no_support_gap_shrinks_by_more_than_its_close_bound_allows(request, name, straight):
    """Along the curve, off it by the tolerance, and off it by the amount for which the growth is valid; for every
    division of the joints between the two bodies. The gap is that of supports in a direction that the
    middle link carries.
    """
    arm = pp.load_robot("stanford").arm() if name == "stanford" else request.getfixturevalue(name)
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.2, 0.2), pp.pose((0.5, 0.3, 0.4)))])
    checker = pp.CollisionChecker(
        arm, scene, attached=[pp.Obstacle("tool", pp.Box(0.02, 0.02, 0.2), pp.pose((0, 0, 0.1)))]
    )
    rng, tight = np.random.default_rng(4), []
    for _ in range(4):
        q, size = rng.uniform(-2, 2, arm.dof), rng.choice([0.005, 0.05, 0.3])
        delta, extra = rng.uniform(-size, size, arm.dof), rng.uniform(0, 0.02, arm.dof) * rng.integers(2)
        start = rng.uniform(-size, size, arm.dof)
        bent = np.array([q + start, q - (start + delta) / 2, q + delta])  # a parabola whose middle is q
        bounds = Bounds(checker, q, delta, extra, None if straight else bent)
        more = float(rng.choice([0.0, _core.GROWTH_RANGE]))
        shares = rng.uniform(0, 1, 12)
        points = [_on(bounds.piece, s) + rng.choice([-1, 1], arm.dof) * (extra + more) for s in (0.0, 1.0, *shares)]
        for k in rng.choice(len(checker.pairs), size=min(12, len(checker.pairs)), replace=False).tolist():
            measured = checker.placed(q).measure(k)
            if measured.proven <= 0:
                continue
            for split in range(len(checker.world.joints_between(k)) + 1):
                near, growth = bounds.closely(k, measured.normal, split)
                least = min(checker.placed(p).measure(k).proven for p in points)
                assert least >= measured.proven - near - more * growth - 1e-9
            rough = bounds.roughly(k).distance
            if not extra.any() and rough > 0:
                tight.append(bounds.closely(k, measured.normal)[0] / rough)
    if name != "planar_2r" and straight:
        assert np.median(tight) < 0.7  # it is worth its name


def _on(piece, s):
    while len(piece) > 1:
        piece = piece[:-1] * (1 - s) + piece[1:] * s
    return piece[0]


def test_a_folded_planar_arm_is_not_judged_by_the_least_radius_or_by_exchanged_roles(planar_2r, path):
    """The second link is folded back onto the first, its tip at the shoulder, a peg beside it near the shoulder.

    The tip is 0 away from the first axis: a least radius, or joint 1 judged by another body than the one that is walked
    to, says that nothing can come nearer. In fact the far end of the folded link sweeps past.
    """
    folded = np.array([0.0, np.pi])
    peg = pp.Obstacle("peg", pp.Sphere(0.02), pp.pose((0.5 * np.cos(0.35), 0.5 * np.sin(0.35), 0.03)))
    checker = pp.CollisionChecker(planar_2r, pp.Scene([peg]))
    assert checker.is_free(folded)
    moving = path(planar_2r, folded, folded + np.array([0.7, 0.0]))
    assert checker.is_free(moving.end)
    certificate = pp.certify(moving, checker)
    assert certificate.status is COLLIDING
    assert "peg" in certificate.first_contact.bodies
    names = [tuple(checker.bodies[i].owner for i in pair) for pair in checker.pairs]
    bound = Bounds(checker, folded, np.array([0.35, 0.0])).roughly(names.index(("fore", "peg"))).distance
    by_hand = 2 * np.sin(0.35 / 2) * np.hypot(0.5, 0.01)  # the farthest corner of the folded link from the first axis
    assert by_hand <= bound <= 1.05 * by_hand


def test_a_folded_planar_arm_is_not_judged_with_roles_exchanged_joint_by_joint(arm_from_links, path, first_touch):
    """The tip is folded back onto the shoulder, a peg is at the elbow, both small.

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
    checker = pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("peg", pp.Sphere(0.01), pp.pose((0.5, 0, 0)))]))
    folded, turn = np.array([0.0, np.pi]), np.full(2, 1.3 * np.pi / 3)
    edge = path(arm, folded - turn, folded + turn)
    for q in (edge.start, folded, edge.end):
        assert checker.clearance(q) > 0.2
    certificate = pp.certify(edge, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.time == pytest.approx(first_touch(checker, edge), abs=1e-3)


def test_the_proven_clearance_is_never_above_the_true_one(slider, path):
    """Straight at a cylinder that is 0.1 m away in the end; its bounding box is rotated so that it proves nothing."""
    post = pp.Obstacle("post", pp.Cylinder(0.3, 1), pp.pose((0.71, 0, 0), (0, 0, np.pi / 4)))
    certificate = pp.certify(path(slider, [0.0], [0.3]), pp.CollisionChecker(slider, pp.Scene([post])))
    assert certificate.status is FREE
    assert 0.05 < certificate.clearance <= 0.1


@pytest.mark.parametrize("thickness", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("kind", ["box", "disc", "hull", "exact"])
def test_a_thin_plate_across_a_fast_wrist_is_never_jumped_over(
    ur5, mesh_file, thickness, kind, path, assert_free_until
):
    """A tool of 0.5 m swings through half a turn in one edge; both ends are free."""
    shape = {
        "box": lambda: pp.Box(0.3, 0.3, thickness),
        "disc": lambda: pp.Cylinder(0.15, thickness),
        "hull": lambda: pp.Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, thickness)))),
        "exact": lambda: pp.Mesh(mesh_file(trimesh.creation.box((0.3, 0.3, thickness))), hull=False),
    }[kind]()
    tool = pp.Obstacle("tool", pp.Cylinder(0.003, 0.5), pp.pose((0, 0, 0.25)))
    start, end = ur5.home.copy(), ur5.home.copy()
    start[3] -= 1.2
    end[3] += 0.8
    middle = (start + end) / 2
    turned = ur5.forward_kinematics(middle) * pp.pose((0, 0, 0.45), (0, np.pi / 2, 0))  # its plane holds the tool
    across = turned * pp.pose(rpy=(0, 0, 0))
    scene = pp.Scene([pp.Obstacle("plate", shape, across)])
    checker = pp.CollisionChecker(ur5, scene, attached=[tool], allowed=[("tool", f) for f in ("wrist_2_link",)])
    swing = path(ur5, start, end)
    assert checker.is_free(start)
    assert checker.is_free(end)
    certificate = pp.certify(swing, checker)
    assert certificate.status is COLLIDING
    assert certificate.first_contact.bodies == ("tool", "plate")
    assert_free_until(checker, swing, certificate.first_contact.proven_free_until, 100)
