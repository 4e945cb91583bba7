"""Certificates in changed scenes from stored evidence: the verdict is that of a certificate from scratch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.collision.certificates.reuse import SetupChange, StoredProof
from pinproof.errors import InputError

from .conftest import urdf_of

POST = pp.Obstacle("post", pp.Cylinder(radius=0.04, length=0.4), pp.pose((0.55, 0, 0.2)))
CRATE = pp.Obstacle("crate", pp.Box(0.2, 0.2, 0.2), pp.pose((-0.5, 0.5, 0.1)))
TABLE = pp.Obstacle("table", pp.Box(1.2, 1.6, 0.04), pp.pose((0.4, 0, -0.045)))
GRIPPER = pp.Obstacle("gripper", pp.Box(0.05, 0.05, 0.1), pp.pose((0, 0, 0.05)))


@pytest.fixture(scope="module")
def checker(ur5):
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    return pp.CollisionChecker(arm, pp.Scene([TABLE, POST, CRATE], allowed=[("base_link", "table")]), margin=0.005)


@pytest.fixture(scope="module")
def motion(checker):
    high, low = [0.6, -1.4, 1.2, -1.4, -1.57, 0], [0.6, -0.9, 1.5, -2.2, -1.57, 0]
    path = pp.JointPath([high, low, high, [-0.9, *high[1:]]], checker.arm.joint_names)
    return pp.time_parametrise(path, checker.arm.limits)


@pytest.fixture(scope="module")
def proof(checker, motion):
    return StoredProof(pp.certify(motion, checker, record=True))


def slider(base: float = 0.1, ball: float = 0.01) -> pp.Arm:
    """A ball that slides along x, far from its base; the sizes (m) of both may be changed."""
    links = {"root": f'<box size="{base} 1 1"/>@0 -9 0', "ball": f'<sphere radius="{ball}"/>'}
    return pp.load_robot(urdf_of(links, [("slide", "prismatic", "root", "ball", "0 0 0", "1 0 0")])).arm(tcp="ball")


def changed_scene(scene: pp.Scene, near: np.ndarray, rng: np.random.Generator) -> pp.Scene:
    """The scene with one obstacle moved, removed, or added at a point that the tool passes."""
    kind, name = rng.integers(3), str(rng.choice(scene.names))
    if kind == 0:
        shape = pp.Sphere(rng.uniform(0.01, 0.08)) if rng.random() < 0.5 else pp.Box(*rng.uniform(0.02, 0.2, 3))
        place = pp.pose(near + rng.normal(size=3) * 0.15, rng.uniform(-3, 3, 3))
        return scene.add(pp.Obstacle("new", shape, place))
    if kind == 1:
        return scene.remove(name)
    pose = scene[name].pose.copy()
    pose.translation = pose.translation + rng.normal(size=3) * rng.choice([0.005, 0.05, 0.3])
    return scene.move(name, pose)


def test_the_limits_are_those_of_the_new_checker(checker, motion, proof) -> None:
    limits = replace(checker.arm.limits, velocity=checker.arm.limits.velocity / 2)
    slower = pp.CollisionChecker(checker.arm.with_limits(limits), checker.scene, margin=checker.margin)
    change = SetupChange(checker, slower)
    assert change.changed == 0
    again = proof.certify(change)
    assert again.status is pp.CertificateStatus.VIOLATED
    assert {each.quantity for each in again.limits.violations} == {"velocity"}
    stated = StoredProof(pp.certify(motion, checker, limits=checker.arm.limits.select(range(6)), record=True))
    assert stated.certify(change).free  # other limits than those of the arm were stated for this motion
    left_out = StoredProof(pp.certify(motion, checker, limits=None, record=True)).certify(change)
    assert (left_out.free, left_out.limits) == (True, None)


def test_random_changes_give_the_verdict_of_a_certificate_from_scratch(checker, motion, proof) -> None:
    rng, found = np.random.default_rng(0), dict.fromkeys(pp.CertificateStatus, 0)
    for trial in range(24):
        passed = checker.arm.forward_kinematics(motion(rng.uniform(0, motion.duration))).translation
        other = checker.with_scene(changed_scene(checker.scene, passed, rng))
        again, fresh = proof.certify(SetupChange(checker, other)), pp.certify(motion, other)
        assert again.status is fresh.status
        assert (again.curve, again.setup, again.notes, again.pairs) == (
            fresh.curve, fresh.setup, fresh.notes, fresh.pairs,
        )  # fmt: skip
        found[again.status] += 1
        if again.free:
            assert other.margin <= again.clearance <= again.observed
            if trial % 10 == 0:
                assert not pp.audit(motion, other, step=0.02).contacts
        elif again.first_contact is not None:
            assert other.check(again.first_contact.q).contacts
    assert min(found[pp.CertificateStatus.FREE], found[pp.CertificateStatus.COLLIDING]) >= 3


def test_the_observed_distance_includes_that_of_kept_pairs_at_the_start() -> None:
    """The nearest obstacle is kept, whatever its number among the pairs."""
    arm = slider()
    path, ball = pp.JointPath([[0.0], [0.2]], arm.joint_names), pp.Sphere(0.05)
    near, far = (pp.Obstacle(name, ball, pp.pose((-0.5, y, 0.0))) for name, y in (("near", 0.4), ("far", 3.0)))
    for obstacles in ([near, far], [far, near]):
        checker = pp.CollisionChecker(arm, pp.Scene(obstacles))
        moved = checker.with_scene(checker.scene.move("far", pp.pose((-0.5, 4.0, 0.0))))
        again = StoredProof(pp.certify(path, checker, record=True)).certify(SetupChange(checker, moved))
        assert again.free
        assert again.clearance <= again.observed <= moved.clearance(path.start) + 1e-9


def test_the_figures_of_kept_pairs_are_reduced_by_the_rounding_of_a_larger_scene(checker, motion) -> None:
    proof = StoredProof(pp.certify(motion, checker, obstacle_tolerance=0.002, record=True))
    far = checker.with_scene(checker.scene.add(pp.Obstacle("far", pp.Box(1, 1, 1), pp.pose((2e3, 0, 0)))))
    more = far.rounding - checker.rounding
    assert more > 1e-7
    obstacles = np.array([checker.bodies[j].link is None for _, j in checker.pairs])
    lowest = np.nanmin(proof.lowest - 0.002 * obstacles)
    for after, lost in ((far, more), (checker, 0.0)):
        known = SetupChange(checker, after).known(proof)
        assert known.proven == pytest.approx(lowest - lost, abs=1e-12)
        assert known.joint_tube == pytest.approx(proof.joint_tube - lost, abs=1e-12)
        assert known.obstacle_tube == pytest.approx(proof.obstacle_tube - lost, abs=1e-12)


def test_constraints_and_tolerances_of_the_stored_certificate_hold_in_the_new_scene(checker, motion, proof) -> None:
    level = pp.Upright.keeping(checker.arm, motion.end, tolerance=1.5)
    stored = StoredProof(pp.certify(motion, checker, constraints=[level], joint_tolerance=1e-3, record=True))
    removed = checker.with_scene(checker.scene.remove("post"))
    # With a wider margin nothing that is stored suffices, so all is proven again.
    for after in (removed, checker.with_margin(margins={("wrist_3_link", "post"): 0.03})):
        again = stored.certify(SetupChange(checker, after))
        assert again.free
        assert [each.constraint for each in again.constraints] == [level]
        assert (again.tube.joints == 1e-3).all()
    damaged = StoredProof(replace(stored.certificate, evidence=stored.leaves[1:]))
    again = damaged.certify(SetupChange(checker, removed))
    assert ([each.constraint for each in again.constraints], again.tube.joints.tolist()) == ([level], [1e-3] * 6)


def test_removal_of_an_obstacle_proves_no_pair_again(checker, motion, proof) -> None:
    change = SetupChange(checker, checker.with_scene(checker.scene.remove("post")))
    assert change.changed == 0
    again = proof.certify(change)
    assert again.free
    assert again.intervals <= 1
    assert again.pairs == len(checker.pairs) - sum(checker.bodies[j].owner == "post" for _, j in checker.pairs)


def test_move_of_an_obstacle_proves_only_its_pairs_again(checker, proof) -> None:
    moved = checker.with_scene(checker.scene.move("crate", pp.pose((-0.5, 0.45, 0.1))))
    change = SetupChange(checker, moved)
    own = [k for k, (_, j) in enumerate(moved.pairs) if moved.bodies[j].owner == "crate"]
    assert change.changed == len(own) - len(set(own) & set(moved.still_pairs.tolist()))
    assert proof.certify(change).free


def test_combined_evidence_is_a_portable_proof(checker, motion, proof, tmp_path) -> None:
    moved = checker.with_scene(checker.scene.move("post", pp.pose((0.55, 0.0, 0.17))))
    certificate = proof.certify(SetupChange(checker, moved), record=True).or_raise()
    certificate.save(tmp_path / "proof.json")
    assert pp.verify_proof(tmp_path / "proof.json", moved, motion).ok
    again = StoredProof(certificate).certify(SetupChange(moved, checker))
    assert again.free
    assert again.setup == proof.certificate.setup
    assert again.evidence is None


def test_tolerances_of_the_stored_certificate_apply_to_new_obstacles(checker, motion) -> None:
    wide = StoredProof(pp.certify(motion, checker, joint_tolerance=0.01, obstacle_tolerance=0.003, record=True))
    for distance in np.linspace(0.0, 0.05, 6):
        moved = checker.with_scene(checker.scene.move("post", pp.pose((0.55, 0.0, 0.17 + distance))))
        again = wide.certify(SetupChange(checker, moved))
        fresh = pp.certify(motion, moved, joint_tolerance=0.01, obstacle_tolerance=0.003)
        assert again.status is fresh.status
        assert (again.tube.joints == 0.01).all()
        assert again.tube.obstacles == 0.003


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda c: c.with_margin(0.006), "margin"),
        (lambda c: c.with_attached(GRIPPER), "gripper"),
        (lambda c: pp.CollisionChecker(pp.load_robot("ur3").arm(), margin=0.005), "ur3"),
        (lambda c: pp.CollisionChecker(c.arm, c.scene, margin=0.005, link_meshes="decomposed"), "geometry of"),
    ],
)  # fmt: skip
def test_another_setup_is_refused_by_name(checker, change, named) -> None:
    with pytest.raises(InputError, match=named):
        SetupChange(checker, change(checker))


@pytest.mark.parametrize(("sizes", "named"), [((0.2, 0.01), "root"), ((0.1, 0.02), "ball")])
def test_a_link_of_another_size_is_refused_by_name(sizes, named) -> None:
    before, after = (pp.CollisionChecker(slider(*each)) for each in ((0.1, 0.01), sizes))
    assert before.group.robot.urdf.kinematics == after.group.robot.urdf.kinematics
    with pytest.raises(InputError, match=f"geometry of the links: {named}"):
        SetupChange(before, after)


def test_a_proof_with_less_to_spare_than_the_rounding_of_a_larger_scene_is_not_used() -> None:
    arm = slider()
    path = pp.JointPath([[-0.2], [0.2]], arm.joint_names)
    post = pp.Obstacle("post", pp.Sphere(0.05), pp.pose((0.0, 0.06 + 0.002 + 5e-6, 0.0)))
    checker = pp.CollisionChecker(arm, pp.Scene([post]), margin=0.002)
    proof = StoredProof(pp.certify(path, checker, record=True))
    for distance, used in ((100.0, True), (9e3, False)):
        larger = checker.with_scene(checker.scene.add(pp.Obstacle("far", pp.Sphere(1), pp.pose((0, distance, 0)))))
        change = SetupChange(checker, larger)
        assert (change.known(proof) is not None) is used
        assert proof.certify(change).free is used


def test_a_proof_is_for_the_checker_at_which_the_change_begins(checker, proof) -> None:
    other = checker.with_scene(checker.scene.remove("crate"))
    with pytest.raises(InputError, match="another checker"):
        proof.certify(SetupChange(other, checker))


def test_a_pair_with_a_larger_margin_is_proven_again(checker, motion, proof) -> None:
    wider = checker.with_margin(margins={("wrist_3_link", "post"): 0.03})
    change = SetupChange(checker, wider)
    assert change.changed == 1
    assert proof.certify(change).status is pp.certify(motion, wider).status
    for margin in (0.2, 0.5):  # larger than the distance of the two
        required = checker.with_margin(margins={("wrist_3_link", "post"): margin})
        assert not proof.certify(SetupChange(checker, required)).free


def test_a_pair_that_was_excluded_is_proven_again(checker, motion) -> None:
    lenient = checker.allowing(("wrist_3_link", "post"), ("wrist_2_link", "post"))
    proof = StoredProof(pp.certify(motion, lenient, record=True))
    blocked = checker.scene.move("post", pp.pose(checker.arm.forward_kinematics(motion.end).translation))
    change = SetupChange(lenient, checker)
    assert change.changed == 2
    assert proof.certify(change).free
    strict = pp.CollisionChecker(checker.arm, blocked, margin=0.005)
    assert proof.certify(SetupChange(lenient, strict)).status is pp.CertificateStatus.COLLIDING


@pytest.mark.parametrize("which", ["first", "inner", "last"])
def test_incomplete_evidence_is_not_used(checker, proof, which) -> None:
    """One interval of one pair is missing: at the start, at the end, or between others."""
    evidence = proof.leaves
    pairs, counts = np.unique(evidence[:, 2], return_counts=True)
    pair = int(pairs[counts.argmax()])
    rows = np.flatnonzero(evidence[:, 2] == pair)
    rows = rows[np.argsort(evidence[rows, 0])]
    assert len(rows) >= 3
    left_out = rows[{"first": 0, "inner": len(rows) // 2, "last": -1}[which]]
    damaged = StoredProof(replace(proof.certificate, evidence=np.delete(evidence, left_out, axis=0)))
    change = SetupChange(checker, checker.with_scene(checker.scene.remove("crate")))
    assert np.isnan(damaged.lowest[pair])
    assert set(np.flatnonzero(np.isnan(damaged.lowest))) == {pair, *np.flatnonzero(np.isnan(proof.lowest))}
    assert change.known(damaged) is None
    assert change.known(proof) is not None
    assert damaged.certify(change).free


def test_the_distance_of_a_pair_is_the_smallest_of_its_intervals(checker, proof) -> None:
    for pair in np.unique(proof.leaves[:, 2]).astype(int):
        assert proof.lowest[pair] == proof.leaves[proof.leaves[:, 2] == pair, 3].min()


def test_certificates_without_evidence_are_refused(checker, motion) -> None:
    with pytest.raises(InputError, match="record=True"):
        StoredProof(pp.certify(motion, checker))
    at_the_end = pp.pose(checker.arm.forward_kinematics(motion.end).translation)
    through = checker.with_scene(checker.scene.move("post", at_the_end))
    with pytest.raises(InputError, match="COLLIDING"):
        StoredProof(pp.certify(motion, through, record=True))
