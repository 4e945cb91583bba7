"""Certificates for a tube around the curve: joints that deviate, obstacles with a position tolerance."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp

FREE, COLLIDING, UNDECIDED = pp.CertificateStatus.FREE, pp.CertificateStatus.COLLIDING, pp.CertificateStatus.UNDECIDED

GAP = 0.05
"""Metres between the slider's ball of 1 cm, on its path along x, and the obstacle beside it."""


def beside(slider, **settings):
    return pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle("post", pp.Sphere(0.04), pp.pose((0.2, 0.05 + GAP, 0)))]), **settings
    )


@pytest.mark.parametrize("margin", [0.0, 0.01])
@pytest.mark.parametrize("share", [0.5, 0.999])
def test_obstacles_may_be_displaced_by_the_clearance_beyond_the_margin(slider, path, margin, share):
    moved = share * (GAP - margin)
    certificate = pp.certify(path(slider, [0.0], [0.4]), beside(slider, margin=margin), obstacle_tolerance=moved)
    assert certificate.status is FREE
    assert margin < certificate.clearance <= GAP - moved + 1e-9
    assert certificate.tube.obstacles == moved
    assert moved + certificate.tube.largest_obstacles <= GAP - margin + 1e-9


@pytest.mark.parametrize("margin", [0.0, 0.01])
def test_a_displaced_obstacle_in_contact_is_reported_with_its_distance(slider, path, margin):
    moved = GAP - margin + 1e-3
    certificate = pp.certify(path(slider, [0.0], [0.4]), beside(slider, margin=margin), obstacle_tolerance=moved)
    assert certificate.status is COLLIDING
    contact = certificate.first_contact
    bare = np.hypot(contact.q[0] - 0.2, 0.05 + GAP) - 0.05
    assert contact.distance == pytest.approx(bare - moved, abs=1e-6)
    assert contact.distance <= margin
    assert contact.penetrating == (contact.distance < 0)


def test_links_are_not_moved_by_the_tolerance_of_obstacles(planar_2r, path):
    """Distances between links are unchanged; only obstacles may be displaced."""
    curve, checker = path(planar_2r, [0.0, 0.5], [0.3, 1.0]), pp.CollisionChecker(planar_2r)
    alone = pp.certify(curve, checker)
    with_tolerance = pp.certify(curve, checker, obstacle_tolerance=1.0)
    assert alone.status is with_tolerance.status is FREE
    assert with_tolerance.clearance == alone.clearance
    assert with_tolerance.tube.largest_obstacles == np.inf


@pytest.mark.parametrize("off", [0.01, 0.04])
def test_joints_may_leave_the_curve(slider, path, off):
    """The ball ends 5 cm before a wall."""
    checker = pp.CollisionChecker(
        slider, pp.Scene([pp.Obstacle("wall", pp.Box(0.1, 1, 1), pp.pose((0.26 + GAP, 0, 0)))])
    )
    curve = path(slider, [0.0], [0.2])
    certificate = pp.certify(curve, checker, joint_tolerance=off)
    assert certificate.status is FREE
    assert certificate.clearance <= GAP - off + 1e-9
    assert off + certificate.tube.largest_joints <= GAP + 1e-9
    assert pp.certify(curve, checker, joint_tolerance=GAP + 1e-3).status is not FREE


def test_every_motion_in_the_largest_tube_is_free(ur5, path):
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.2, 0.2), pp.pose((0.5, 0.3, 0.4)))])
    checker, rng = pp.CollisionChecker(ur5, scene), np.random.default_rng(3)
    proven = 0
    for _ in range(12):
        q = rng.uniform(-2, 2, (2, 6))
        certificate = pp.certify(path(ur5, *q), checker, joint_tolerance=0.002)
        if not certificate.free:
            continue
        proven += 1
        off = 0.002 + certificate.tube.largest_joints
        for s in np.linspace(0, 1, 60):
            assert checker.is_free(q[0] + s * (q[1] - q[0]) + rng.choice([-1, 1], 6) * off)
        # Obstacles moved by the largest tube: the same as that much more margin to them.
        more = checker.with_obstacle_tolerance(certificate.tube.largest_obstacles * (1 - 1e-9))
        assert all(more.is_free(q[0] + s * (q[1] - q[0])) for s in np.linspace(0, 1, 60))
    assert proven >= 3


def test_a_tolerance_for_each_joint(planar_2r, path):
    checker = pp.CollisionChecker(planar_2r)
    certificate = pp.certify(path(planar_2r, [0.0, 0.5], [0.3, 1.0]), checker, joint_tolerance=[0.1, 0.0])
    assert certificate.tube.joints.tolist() == [0.1, 0.0]
    assert "joints may deviate by up to the given tolerances" in certificate.message
    equal = pp.certify(path(planar_2r, [0.0, 0.5], [0.3, 1.0]), checker, joint_tolerance=[0.1, 0.1])
    assert "joints may deviate by up to 0.1 rad" in equal.message


@pytest.mark.parametrize(
    "settings",
    [
        {"joint_tolerance": -1e-9},
        {"joint_tolerance": float("nan")},
        {"joint_tolerance": [0.0, 0.1]},
        {"obstacle_tolerance": -1e-9},
        {"obstacle_tolerance": float("nan")},
        {"obstacle_tolerance": float("inf")},
    ],
)
def test_a_tube_that_makes_no_sense_is_refused(slider, path, settings):
    with pytest.raises(pp.InputError):
        pp.certify(path(slider, [0.0], [0.4]), beside(slider), **settings)


def test_evidence_covers_every_pair_on_the_complete_curve(ur5, path):
    """Each pair's intervals cover the curve without a gap, and their statements about its middle are true."""
    scene = pp.Scene([pp.Obstacle("box", pp.Box(0.2, 0.2, 0.2), pp.pose((0.7, 0.3, 0.4)))])
    checker, curve = pp.CollisionChecker(ur5, scene), path(ur5, [0, -1.5, 1, 0, 0, 0], [0.5, -1.2, 1, 0.3, 0, 0])
    certificate = pp.certify(curve, checker, record=True)
    assert certificate.status is FREE
    rows = certificate.evidence
    for pair in sorted(set(range(len(checker.pairs))) - set(checker.still_pairs.tolist())):
        mine = rows[rows[:, 2] == pair]
        reached = 0.0
        for start, end in sorted(mine[:, :2].tolist()):
            assert start <= reached
            reached = max(reached, end)
        assert reached == 1.0
        for start, end, _, proven in mine[:, :4].tolist():
            assert checker.placed(curve((start + end) / 2)).measure(pair).attained >= proven
    assert pp.certify(curve, checker).evidence is None
