"""Proofs that a pose is out of reach: never for reachable poses, and each one checked in NumPy and by a search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof import _core
from pinproof.errors import InputError
from pinproof.ik import Overlap, ReachStatus, is_provable
from pinproof.ik.reach_check import CUT_LOWER, EXCLUDED, SPLIT, Steps, check_exclusion
from pinproof.model import load_robot_from_text
from pinproof.model.limits import AT_LIMIT
from pinproof.spatial import rigid

ROBOTS = ("panda", "iiwa14", "xarm7", "so100", "scara")


@pytest.fixture(scope="module")
def arms() -> dict[str, pp.Arm]:
    return {name: pp.load_robot(name).arm() for name in ROBOTS}


def turned(rng: np.random.Generator, place: np.ndarray) -> np.ndarray:
    """A pose at a place (3,) with a random orientation."""
    return np.array(pp.pose(place, quat_xyzw=rng.normal(size=4)).homogeneous)


def off_by(rng: np.random.Generator, pose: np.ndarray, tolerance: float) -> np.ndarray:
    """The pose, moved by almost the tolerance in position and in orientation."""
    shift, axis = (0.999 * tolerance * v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    moved = pose.copy()
    moved[:3, 3] += shift
    moved[:3, :3] = pose[:3, :3] @ pin.exp3(axis)
    return np.array(rigid("pose", moved).homogeneous)


def unreachable(arm: pp.Arm, count: int, seed: int = 0) -> list[pp.ik.ReachProof]:
    """Proofs for poses near the arm's workspace with random orientations."""
    rng, proofs = np.random.default_rng(seed), []
    lower, upper = arm.limits.sampling_range()
    while len(proofs) < count:
        place = arm.forward_kinematics(rng.uniform(lower, upper)).translation * rng.uniform(0.9, 1.1)
        proof = pp.prove_unreachable(arm, turned(rng, place))
        if proof.proven:
            proofs.append(proof)
    return proofs


@pytest.fixture(scope="module")
def narrow_miss(arms) -> pp.ik.ReachProof:
    """A proof with several boxes: a pose close to one that five joints reach."""
    arm, rng = arms["so100"], np.random.default_rng(1)
    q = rng.uniform(*arm.limits.sampling_range())
    return pp.prove_unreachable(arm, off_by(rng, arm.forward_kinematics(q).homogeneous, 1e-4))


@pytest.mark.parametrize("name", ROBOTS)
def test_search_never_excludes_a_configuration_that_reaches_the_target(arms, name) -> None:
    """Along the boxes around the configuration; the target is moved by almost the tolerance."""
    arm, rng, count = arms[name], np.random.default_rng(3), 60
    lower, upper = arm.limits.sampling_range()
    q = rng.uniform(lower, upper, (count, arm.dof))
    chosen, case = rng.random(q.shape) < 0.5, np.arange(count)[:, None] % 3
    away = rng.choice([0.0, 1e-9, 1e-6], q.shape)
    at_limit = np.where(rng.random(q.shape) < 0.5, lower + away, upper - away)
    special = rng.choice([0.0, np.pi / 2, -np.pi / 2], q.shape) + rng.choice([0.0, 1e-9, -1e-6], q.shape)
    q = np.where(chosen & (case == 1), at_limit, np.where(chosen & (case == 2), np.clip(special, lower, upper), q))
    tolerances = rng.choice([1e-6, 1e-4, 1e-2], count)
    poses = [
        off_by(rng, pose, tolerance)
        for pose, tolerance in zip(arm.forward_kinematics_batch(q), tolerances, strict=True)
    ]
    # the search covers one full rotation, from slightly below the lower limit
    lowest = lower - AT_LIMIT
    turned = np.where(arm.angular, q - 2 * np.pi * np.floor((q - lowest) / (2 * np.pi)), q)
    prover = _core.Reach(
        arm.chain, lowest, np.where(arm.angular, np.minimum(upper + AT_LIMIT, lowest + 2 * np.pi), upper)
    )
    assert prover.keeps(np.array(poses), turned, tolerances, 15).all()
    # the same method notices a configuration that does not reach its target
    assert not prover.keeps(np.array(poses), np.roll(turned, 1, axis=0), tolerances, 15).any()


@pytest.mark.parametrize("name", ROBOTS)
def test_proofs_are_confirmed_in_numpy_and_not_contradicted_by_a_search(arms, name) -> None:
    arm = arms[name]
    for proof in unreachable(arm, 8):
        assert proof.verify()
        assert not pp.Clik().solve(arm, proof.target, rng=1).ok


def test_excluded_boxes_cover_the_joint_ranges(arms, narrow_miss) -> None:
    proof = narrow_miss
    assert proof.proven
    assert proof.examined > 1
    lower, upper = arms["so100"].limits.sampling_range()
    q = np.random.default_rng(0).uniform(lower, upper, (2000, 5))
    boxes = proof.boxes
    inside = ((q[:, None] >= boxes[:, 0]) & (q[:, None] <= boxes[:, 1])).all(axis=2)
    assert inside.any(axis=1).all()


def test_reachable_pose_is_found(arms) -> None:
    arm = arms["panda"]
    proof = pp.prove_unreachable(arm, arm.forward_kinematics(arm.home))
    assert proof.status is ReachStatus.FOUND
    assert proof.verify()
    assert proof.or_raise() is proof


def test_damaged_proof_is_refused(arms, narrow_miss) -> None:
    arm, proof = arms["so100"], narrow_miss
    steps, loop = proof.steps, proof._loop
    lower, upper = arm.limits.sampling_range()
    lower, upper = lower - AT_LIMIT, np.minimum(upper + AT_LIMIT, lower - AT_LIMIT + 2 * np.pi)

    def holds(other: Steps, target: np.ndarray = proof.target, tolerance: float = 1e-6) -> bool:
        return check_exclusion(loop, other, (lower, upper), target, (tolerance, tolerance))

    def without(kept: np.ndarray) -> Steps:
        return Steps(*(getattr(steps, name)[kept] for name in Steps.__dataclass_fields__))

    assert holds(steps)
    assert not holds(without(np.arange(len(steps)) < len(steps) - 1))  # a box is missing
    assert not holds(without(np.arange(len(steps)) != np.flatnonzero(steps.kinds == SPLIT)[0]))
    assert not holds(replace(steps, constraints=np.where(steps.kinds == EXCLUDED, 0, steps.constraints)))
    cut = int(np.flatnonzero(steps.kinds == CUT_LOWER)[0])
    too_far = steps.values.copy()
    too_far[cut] += 0.2
    assert not holds(replace(steps, values=too_far))
    assert not holds(steps, tolerance=0.2)
    assert not holds(steps, np.array(arm.forward_kinematics(arm.home).homogeneous))
    assert not holds(without(np.zeros(len(steps), dtype=bool)))


def test_limits_decide_what_is_out_of_reach(planar) -> None:
    """Two joints of 1 m links: the pose at an angle of 2 rad needs a joint beyond +-1 rad."""
    target = pp.pose((np.cos(2.0) * 2, np.sin(2.0) * 2, 0), (0, 0, 2.0))
    assert pp.prove_unreachable(planar("-1 1", "-1 1"), target).proven
    assert pp.prove_unreachable(planar("-2.1 2.1", "-1 1"), target).status is ReachStatus.FOUND
    assert pp.prove_unreachable(planar("", "-2.2 2.2", ""), target).status is ReachStatus.FOUND


def test_tolerance_belongs_to_the_proof(planar) -> None:
    arm = planar("-3 3", "-3 3")
    beyond = pp.pose((2.001, 0, 0))
    assert pp.prove_unreachable(arm, beyond, position_tolerance=0.9e-3).proven
    assert pp.prove_unreachable(arm, beyond, position_tolerance=1.1e-3, orientation_tolerance=0.1).status is (
        ReachStatus.FOUND
    )


def test_undecided_proof_has_nothing_to_verify(arms) -> None:
    arm = arms["panda"]
    proof = pp.prove_unreachable(arm, arm.forward_kinematics(arm.home), budget=3, search=False)
    assert proof.status is ReachStatus.UNDECIDED
    with pytest.raises(InputError, match="budget"):
        proof.verify()


def test_closed_form_without_a_branch_returns_a_proof_for_redundant_arms(arms) -> None:
    found = pp.AnalyticIk().solve(arms["panda"], pp.pose((0.9, 0.0, 0.4)))
    assert found.status is pp.ik.IkStatus.IMPOSSIBLE


def links_of(arm: pp.Arm, q: np.ndarray) -> list[np.ndarray]:
    """The poses (4, 4) of the links of the chain in the base."""
    poses = [np.eye(4)]
    for before, prismatic, value in zip(arm.chain.before, arm.chain.prismatic, q, strict=True):
        motion = (
            pin.SE3(np.eye(3), np.array([0, 0, value]))
            if prismatic
            else pin.SE3(pin.exp3(np.array([0, 0, value])), np.zeros(3))
        )
        poses.append(poses[-1] @ before @ motion.homogeneous)
    return poses


def overlap_near(rng: np.random.Generator, arm: pp.Arm, q: np.ndarray, gap: float) -> Overlap:
    """A ball and a box on different links whose distance at q (n,) is ``gap``; below 0, they overlap."""
    links = links_of(arm, q)
    ball_link, box_link = rng.choice(arm.dof + 1, 2, replace=False).tolist()
    at = links[ball_link] @ [*rng.uniform(-0.3, 0.3, 3), 1.0]
    link_from_box = turned(rng, rng.uniform(-0.5, 0.5, 3))
    in_box = np.linalg.inv(links[box_link] @ link_from_box) @ at
    half = rng.uniform(0.0, 0.3, 3) * rng.choice([0.0, 1.0])
    beyond = np.abs(in_box[:3]) - half
    signed = np.linalg.norm(np.maximum(beyond, 0.0)) if beyond.max() > 0 else beyond.max()
    radius = signed - gap
    share = rng.uniform() if radius > 0 else 0.0
    centre = (np.linalg.inv(links[ball_link]) @ at)[:3]
    if radius < 0:  # the box shrinks until the gap remains
        half = np.maximum(half + radius, 0.0)
        beyond = np.abs(in_box[:3]) - half
        radius = max((np.linalg.norm(np.maximum(beyond, 0.0)) if beyond.max() > 0 else beyond.max()) - gap, 0.0)
    return Overlap(("a", "b"), ball_link, centre, share * radius, box_link, link_from_box, half, (1 - share) * radius)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.slow
def test_overlaps_never_exclude_a_configuration_without_one(arms, name) -> None:
    """The configuration is barely free of each overlap; some of them, slightly larger, do exclude their targets."""
    arm, rng, proven = arms[name], np.random.default_rng(5), 0
    for _ in range(10):
        q = rng.uniform(*arm.limits.sampling_range())
        target, count = arm.forward_kinematics(q), int(rng.integers(1, 12))
        free = [overlap_near(rng, arm, q, 2e-6 * 10.0 ** rng.uniform(0, 3)) for _ in range(count)]
        assert not pp.prove_unreachable(arm, target, search=False, budget=150, overlaps=free).proven
        large = [overlap_near(rng, arm, q, -0.3) for _ in range(count)]
        proof = pp.prove_unreachable(arm, target, search=False, budget=150, overlaps=large)
        proven += proof.proven
        assert not proof.proven or (proof.verify() and proof.bodies == (("a", "b"),))
    assert proven > 0


@pytest.mark.slow
def test_overlap_on_every_solution_is_a_proof_that_numpy_confirms(arms) -> None:
    """The elbow of a Panda is within a sphere at every solution; a smaller sphere proves nothing."""
    arm = arms["panda"]
    target = pp.pose((0.5, 0.1, 0.4), rpy=(np.pi, 0, 0))
    curves = pp.AnalyticIk().self_motion(arm, target)
    elbows = np.array([links_of(arm, q)[4][:3, 3] for curve in curves for q in curve.q])
    away = np.linalg.norm(elbows - elbows.mean(axis=0), axis=1)
    at = np.eye(4)
    at[:3, 3] = elbows.mean(axis=0)

    def proof(radius: float) -> pp.ik.ReachProof:
        elbow = Overlap(("elbow", "ball"), 4, np.zeros(3), 0.02, 0, at, np.zeros(3), radius)
        return pp.prove_unreachable(arm, target, search=False, budget=3000, overlaps=[elbow])

    assert not proof(away.max() - 0.021).proven
    proven = proof(away.max() + 0.02)
    assert proven.proven
    assert proven.examined > 10
    assert proven.verify()
    assert "elbow with ball" in proven.message
    smaller = replace(proven.overlaps[0], box_radius=away.max() - 0.021)
    assert not replace(proven, overlaps=(smaller,)).verify()
    lower, upper = arm.limits.sampling_range()
    ranges = lower - AT_LIMIT, upper + AT_LIMIT
    for overlaps in ((), (smaller,)):
        assert not check_exclusion(proven._loop, proven.steps, ranges, proven.target, (1e-6, 1e-6), overlaps)
    with pytest.raises(InputError, match="search"):
        pp.prove_unreachable(arm, target, overlaps=proven.overlaps)


def test_unsupported_arms_and_settings_are_refused(planar) -> None:
    mimic = load_robot_from_text(
        '<robot name="two"><link name="a"/><link name="b"/><link name="c"/><joint name="j" type="continuous"><parent '
        'link="a"/><child link="b"/><axis xyz="0 0 1"/></joint><joint name="k" type="continuous"><parent link="b"/>'
        '<child link="c"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/><mimic joint="j"/></joint></robot>'
    ).arm(tcp="c")
    assert not is_provable(mimic)
    with pytest.raises(InputError, match="mimic"):
        pp.prove_unreachable(mimic, np.eye(4))
    assert is_provable(planar("-1 1"))
    for wrong in ({"position_tolerance": 0.0}, {"orientation_tolerance": np.nan}, {"budget": 0}):
        with pytest.raises(InputError):
            pp.prove_unreachable(planar("-1 1"), np.eye(4), **wrong)
    with pytest.raises(InputError):
        pp.prove_unreachable(planar("-1 1"), 2 * np.eye(4))
