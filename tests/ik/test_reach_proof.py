"""Proofs that a pose is out of reach: never for reachable poses, and each one checked in NumPy and by a search."""

from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof import _core
from pinproof.errors import InputError
from pinproof.ik import BodyOverlap, ReachStatus, is_provable
from pinproof.ik.reach_check import CUT_LOWER, EXCLUDED, SPLIT, Steps, check_exclusion
from pinproof.model import load_robot
from pinproof.model.limits import AT_LIMIT
from pinproof.spatial import rigid

ROBOTS = ("panda", "iiwa14", "xarm7", "so100", "scara")


@pytest.fixture(scope="module")
def arms():
    return {name: pp.load_robot(name).arm() for name in ROBOTS}


def turned(rng, place):
    """A pose at a place (3,) with a random orientation."""
    return np.array(pp.pose(place, quat_xyzw=rng.normal(size=4)).homogeneous)


def off_by(rng, pose, tolerance):
    """The pose, moved by almost the tolerance in position and in orientation."""
    shift, axis = (0.999 * tolerance * v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    moved = pose.copy()
    moved[:3, 3] += shift
    moved[:3, :3] = pose[:3, :3] @ pin.exp3(axis)
    return np.array(rigid("pose", moved).homogeneous)


def unreachable(arm, count, seed=0):
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
def narrow_miss(arms):
    """A proof with several boxes: a pose close to one that five joints reach."""
    arm, rng = arms["so100"], np.random.default_rng(1)
    q = rng.uniform(*arm.limits.sampling_range())
    target = off_by(rng, arm.forward_kinematics(q).homogeneous, 1e-4)
    return pp.prove_unreachable(arm, target, orientation_tolerance=1e-6)


@pytest.mark.parametrize("name", ROBOTS)
def test_search_never_excludes_a_configuration_that_reaches_the_target(arms, name):
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
def test_proofs_are_confirmed_in_numpy_and_not_contradicted_by_a_search(arms, name):
    arm = arms[name]
    for proof in unreachable(arm, 8):
        assert proof.verify()
        assert not pp.Clik().solve(arm, proof.target, rng=1).ok


def test_excluded_boxes_cover_the_joint_ranges(arms, narrow_miss):
    proof = narrow_miss
    assert proof.proven
    assert proof.examined > 1
    lower, upper = arms["so100"].limits.sampling_range()
    q = np.random.default_rng(0).uniform(lower, upper, (2000, 5))
    boxes = proof.boxes
    inside = ((q[:, None] >= boxes[:, 0]) & (q[:, None] <= boxes[:, 1])).all(axis=2)
    assert inside.any(axis=1).all()


def test_reachable_pose_is_found_and_the_target_of_a_proof_cannot_be_changed(arms):
    arm = arms["panda"]
    proof = pp.prove_unreachable(arm, arm.forward_kinematics(arm.home))
    assert proof.status is ReachStatus.FOUND
    assert proof.verify()
    assert proof.or_raise() is proof
    with pytest.raises(ValueError, match="read-only"):
        pp.prove_unreachable(arms["scara"], pp.pose((9.0, 0, 0))).target[0, 3] = 0.1
    found = pp.AnalyticIk().solve(arm, pp.pose((0.9, 0.0, 0.4)))
    assert found.status is pp.ik.IkStatus.IMPOSSIBLE  # the closed form without a branch returns a proof


def test_damaged_proof_is_refused(arms, narrow_miss):
    arm, proof = arms["so100"], narrow_miss
    steps, loop = proof.steps, proof._loop
    lower, upper = arm.limits.sampling_range()
    lower, upper = lower - AT_LIMIT, np.minimum(upper + AT_LIMIT, lower - AT_LIMIT + 2 * np.pi)

    def holds(other, target=proof.target, tolerance=1e-06):
        return check_exclusion(loop, other, (lower, upper), target, (tolerance, tolerance))

    def without(kept):
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


def test_limits_and_tolerances_decide_what_is_out_of_reach(planar):
    """Two joints of 1 m links: the pose at an angle of 2 rad needs a joint beyond +-1 rad."""
    target = pp.pose((np.cos(2.0) * 2, np.sin(2.0) * 2, 0), (0, 0, 2.0))
    assert pp.prove_unreachable(planar("-1 1", "-1 1"), target).proven
    assert pp.prove_unreachable(planar("-2.1 2.1", "-1 1"), target).status is ReachStatus.FOUND
    assert pp.prove_unreachable(planar("", "-2.2 2.2", ""), target).status is ReachStatus.FOUND
    arm, beyond = planar("-3 3", "-3 3"), pp.pose((2.001, 0, 0))
    assert pp.prove_unreachable(arm, beyond, position_tolerance=0.9e-3).proven
    wide = pp.prove_unreachable(arm, beyond, position_tolerance=1.1e-3, orientation_tolerance=0.1)
    assert wide.status is ReachStatus.FOUND


def test_a_search_without_a_solution_is_no_answer(arms):
    """Poses that need more boxes than are examined before the search: proven with a budget, undecided with less."""
    arm, rng, counts = arms["so100"], np.random.default_rng(1), []
    for _ in range(12):
        q = rng.uniform(*arm.limits.sampling_range())
        target = off_by(rng, arm.forward_kinematics(q).homogeneous, 2e-6)
        alone = pp.prove_unreachable(arm, target, orientation_tolerance=1e-6, search=False, budget=600)
        if alone.proven and alone.examined > 64 and len(counts) < 2:
            counts.append(alone.examined)
            with_search = pp.prove_unreachable(arm, target, orientation_tolerance=1e-6, budget=600)
            assert with_search.status is ReachStatus.IMPOSSIBLE
            with pytest.raises(pp.NoAnswer, match="proven impossible"):
                with_search.q  # noqa: B018
            assert with_search.verify()
            assert len(with_search.boxes) > 64
            undecided = pp.prove_unreachable(arm, target, orientation_tolerance=1e-6, budget=65)
            assert undecided.status is ReachStatus.UNDECIDED
            assert undecided.examined >= 65
            assert len(undecided.steps) == 0
    assert len(counts) == 2


def test_a_configuration_within_the_tolerance_of_the_limits_is_never_excluded(planar):
    """Joint values beyond a limit by less than AT_LIMIT are valid everywhere, also for much smaller tolerances."""
    arm = planar("-1 1", "-0.5 2")
    for first, second in product(
        (-1 - 0.9 * AT_LIMIT, 1 + 0.9 * AT_LIMIT), (-0.5 - 0.9 * AT_LIMIT, 2 + 0.9 * AT_LIMIT)
    ):
        total = first + second
        target = pp.pose((np.cos(first) + np.cos(total), np.sin(first) + np.sin(total), 0), (0, 0, total))
        settings = {"position_tolerance": 1e-12, "orientation_tolerance": 1e-12, "search": False}
        assert not pp.prove_unreachable(arm, target, **settings).proven
    beyond = pp.pose((np.cos(1 + 5e-9) + np.cos(1.3), np.sin(1 + 5e-9) + np.sin(1.3), 0), (0, 0, 1.3))
    assert pp.prove_unreachable(arm, beyond, **settings).proven


def nearly_meeting(offset):
    """Five joints whose axes miss each other by an offset, which counts as one point with an error, and a slide."""
    axes = ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 0 1")
    places = ("0 0 0.3", f"{offset} 0 0", f"0 {offset} {offset}", "0.4 0 0", f"0 0 {offset}")
    parts = ['<robot name="near"><link name="l0"/>']
    for k, (axis, place) in enumerate(zip(axes, places, strict=True), 1):
        kind = "prismatic" if k == 4 else "revolute"
        parts.append(
            f'<link name="l{k}"/><joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/><child link="l{k}"/>'
            f'<origin xyz="{place}"/><axis xyz="{axis}"/>'
            '<limit lower="-1.5" upper="1.2" velocity="1" effort="1"/></joint>'
        )
    return load_robot("".join([*parts, "</robot>"])).arm(tcp="l5")


def box_around(rng, q):
    """A box of joint values that contains q (n,), near its border in some joints."""
    width = 10.0 ** rng.uniform(-9, rng.choice([-3.0, 0.5]), len(q))
    low = width * rng.choice([0.0, 0.01, 0.5, 1.0], len(q))
    return q - low, q + width - low


def check_step(proof, number, ranges, target, tolerances, overlaps=()):
    """Whether one distance, or one overlap, excludes the complete ranges."""
    steps = Steps(*[[value] for value in (EXCLUDED, -1, number, 0, 0.0)])
    return check_exclusion(proof._loop, steps, ranges, np.array(target), tolerances, overlaps)


@pytest.mark.parametrize("name", [*ROBOTS, "near"])
def test_the_check_accepts_no_exclusion_of_a_box_with_a_solution(arms, name):
    """Of all distances and overlaps, for boxes of any width, and targets that are moved by almost the tolerances."""
    arm, rng = arms.get(name) or nearly_meeting(2e-5), np.random.default_rng(7)
    far = pp.prove_unreachable(arm, pp.pose((99.0, 0, 0)))
    count, excluded, overlapping = len(far._loop.pairs), 0, 0
    for _ in range(8):
        q, some = rng.uniform(*arm.limits.sampling_range()), rng.permutation(count)[:20].tolist()
        ranges, size = box_around(rng, q), 10.0 ** rng.uniform(-9, -1)
        target = off_by(rng, arm.forward_kinematics(q).homogeneous, size)
        assert not any(check_step(far, k, ranges, target, (size, size)) for k in some)
        # The same distances exclude boxes whose configurations do not reach the target.
        excluded += any(check_step(far, k, ranges, off_by(rng, target, 0.5), (1e-6, 1e-6)) for k in some)
        pose = arm.forward_kinematics(q).homogeneous
        free = [overlap_near(rng, arm, q, 1e-7) for _ in range(3)]
        deep = [overlap_near(rng, arm, q, -0.3) for _ in range(3)]
        for number in range(count, count + 3):
            assert not check_step(far, number, ranges, pose, (1e-9, 1e-9), free)
            overlapping += check_step(far, number, ranges, pose, (1e-9, 1e-9), deep)
        assert not check_step(far, count + 3, ranges, pose, (1e-9, 1e-9), deep)
    assert excluded > 2
    assert overlapping > 4


def test_undecided_proof_has_nothing_to_verify(arms):
    arm = arms["panda"]
    proof = pp.prove_unreachable(arm, arm.forward_kinematics(arm.home), budget=3, search=False)
    assert proof.status is ReachStatus.UNDECIDED
    with pytest.raises(InputError, match="budget"):
        proof.verify()
    large = overlap_near(np.random.default_rng(0), arm, arm.home, -0.3)
    settings = {"search": False, "overlaps": [large], "position_tolerance": 0.1, "orientation_tolerance": 1.0}
    for budget in (1, 30):
        undecided = pp.prove_unreachable(arm, arm.forward_kinematics(arm.home), budget=budget, **settings)
        assert (undecided.status, undecided.bodies) == (ReachStatus.UNDECIDED, ())


def links_of(arm, q):
    """The poses (4, 4) of the links of the chain in the base."""
    poses = [np.eye(4)]
    for joint, value in zip(arm.chain.joints, q, strict=True):
        along, still = np.array([0, 0, value]), np.zeros(3)
        motion = pin.SE3(np.eye(3), along) if joint.prismatic else pin.SE3(pin.exp3(along), still)
        poses.append(poses[-1] @ joint.before @ motion.homogeneous)
    return poses


def overlap_near(rng, arm, q, gap):
    """A ball and a box on different links whose distance at q (n,) is ``gap``; below 0, they overlap."""
    links = links_of(arm, q)
    ball_link, box_link = rng.choice(arm.dof + 1, 2, replace=False).tolist()
    at = links[ball_link] @ [*rng.uniform(-0.3, 0.3, 3), 1.0]
    link_from_box = turned(rng, rng.uniform(-0.5, 0.5, 3))
    in_box = np.linalg.inv(links[box_link] @ link_from_box) @ at

    def distance(half):
        beyond = np.abs(in_box[:3]) - half
        return np.linalg.norm(np.maximum(beyond, 0.0)) if beyond.max() > 0 else beyond.max()

    half = rng.uniform(0.0, 0.3, 3) * rng.choice([0.0, 1.0])
    radius = distance(half) - gap
    share = rng.uniform() if radius > 0 else 0.0
    centre = (np.linalg.inv(links[ball_link]) @ at)[:3]
    if radius < 0:  # the box shrinks until the gap remains
        half = np.maximum(half + radius, 0.0)
        radius = max(distance(half) - gap, 0.0)
    return BodyOverlap(
        ("a", "b"), ball_link, centre, share * radius, box_link, link_from_box, half, (1 - share) * radius
    )


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.slow
def test_overlaps_never_exclude_a_configuration_without_one(arms, name):
    """The configuration is barely free of each overlap; some of them, slightly larger, do exclude their targets."""
    arm, rng, proven = arms[name], np.random.default_rng(5), 0
    for _ in range(10):
        q = rng.uniform(*arm.limits.sampling_range())
        target, count = arm.forward_kinematics(q), int(rng.integers(1, 12))
        free = [overlap_near(rng, arm, q, 2e-6 * 10.0 ** rng.uniform(0, 3)) for _ in range(count)]
        assert not pp.prove_unreachable(
            arm, target, orientation_tolerance=1e-6, search=False, budget=150, overlaps=free
        ).proven
        large = [overlap_near(rng, arm, q, -0.3) for _ in range(count)]
        proof = pp.prove_unreachable(arm, target, orientation_tolerance=1e-6, search=False, budget=150, overlaps=large)
        proven += proof.proven
        assert not proof.proven or (proof.verify() and proof.bodies == (("a", "b"),))
    assert proven > 0


@pytest.mark.slow
def test_overlap_on_every_solution_is_a_proof_that_numpy_confirms(arms):
    """The elbow of a Panda is within a sphere at every solution; a smaller sphere proves nothing."""
    arm = arms["panda"]
    target = pp.pose((0.5, 0.1, 0.4), rpy=(np.pi, 0, 0))
    curves = pp.AnalyticIk().self_motion(arm, target)
    elbows = np.array([links_of(arm, q)[4][:3, 3] for curve in curves for q in curve.q])
    away = np.linalg.norm(elbows - elbows.mean(axis=0), axis=1)
    at = np.eye(4)
    at[:3, 3] = elbows.mean(axis=0)

    def proof(radius):
        elbow = BodyOverlap(("elbow", "ball"), 4, np.zeros(3), 0.02, 0, at, np.zeros(3), radius)
        return pp.prove_unreachable(
            arm, target, orientation_tolerance=1e-6, search=False, budget=3000, overlaps=[elbow]
        )

    assert not proof(away.max() - 0.021).proven
    proven = proof(away.max() + 0.02)
    assert proven.proven
    assert proven.examined > 10
    assert proven.verify()
    assert "elbow with ball" in proven.message
    smaller = replace(proven.overlaps[0], box_radius=away.max() - 0.021)
    again = (proven.target, proven.position_tolerance, proven.orientation_tolerance, proven.examined, None)
    assert not pp.ik.ReachProof(proven.status, arm, *again, (smaller,)).verify()
    lower, upper = arm.limits.sampling_range()
    ranges = lower - AT_LIMIT, upper + AT_LIMIT
    for overlaps in ((), (smaller,)):
        assert not check_exclusion(proven._loop, proven.steps, ranges, proven.target, (1e-6, 1e-6), overlaps)
    with pytest.raises(InputError, match="search"):
        pp.prove_unreachable(arm, target, orientation_tolerance=1e-6, overlaps=proven.overlaps)


def test_unsupported_arms_and_settings_are_refused(planar):
    mimic = load_robot(
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
