"""Arms that hold one part together: the motion, its proven deviation, and the reason if no motion exists."""

from __future__ import annotations

import json

import numpy as np
import pinocchio as pin
import pytest

import pinproof as pp
from pinproof.collision import audit, held_together
from pinproof.planning import CarryPlan, PlanStatus, plan_carry

DOWN = (np.pi, 0, 0)
BOX = pp.Obstacle("box", pp.Box(0.2, 1.2, 0.15))
OVER_THE_POST = pp.pose((0.5, 0, 0.3)), pp.pose((1.0, 0, 0.3))
TRAY = pp.Obstacle("tray", pp.Box(0.25, 0.3, 0.06))
# From the sides of the tray, each hand towards the other
BY_THE_SIDES = {"left": pp.pose((0, 0.16, 0), (np.pi / 2, 0, 0)), "right": pp.pose((0, -0.16, 0), (-np.pi / 2, 0, 0))}


def from_above(*names: str) -> dict[str, pin.SE3]:
    """``tcp_from_part`` of hands on the upper side of the box, 0.9 m apart."""
    return {name: pp.pose((0, y, 0.0775), DOWN).inverse() for name, y in zip(names, (-0.45, 0.45), strict=True)}


@pytest.fixture(scope="module")
def pair() -> pp.CollisionChecker:
    """Two UR10e and a post between the places of the box."""
    ur10e = pp.load_robot("ur10e").arm()
    group = pp.assemble({"left": (ur10e, pp.pose((0, -0.7, 0))), "right": (ur10e, pp.pose((0, 0.7, 0)))})
    obstacles = [
        pp.Obstacle("floor", pp.Box(4, 4, 0.02), pp.pose((0, 0, -0.02))),
        pp.Obstacle("post", pp.Cylinder(radius=0.06, length=0.5), pp.pose((0.75, 0, 0.25))),
    ]
    scene = pp.Scene(obstacles, allowed=[("left/base_link", "floor"), ("right/base_link", "floor")])
    return pp.CollisionChecker(group, scene, margin=0.002)


@pytest.fixture(scope="module")
def baxter() -> pp.CollisionChecker:
    """Both arms of a Baxter, of seven joints each, and a post on a table."""
    obstacles = [
        pp.Obstacle("table", pp.Box(0.5, 1.2, 0.04), pp.pose((0.85, 0, -0.25))),
        pp.Obstacle("post", pp.Cylinder(radius=0.02, length=0.4), pp.pose((0.6, 0, -0.03))),
    ]
    group = pp.load_robot("baxter_left").arms()
    return pp.CollisionChecker(group, pp.Scene(obstacles), margin=0.002, trust_disabled=True)


@pytest.fixture(scope="module")
def over_the_post(pair: pp.CollisionChecker) -> CarryPlan:
    return plan_carry(pair, BOX, from_above("left", "right"), *OVER_THE_POST, rng=1)


@pytest.fixture(scope="module")
def tray_over_the_post(baxter: pp.CollisionChecker) -> CarryPlan:
    grasps = {name: pose.inverse() for name, pose in BY_THE_SIDES.items()}
    return plan_carry(baxter, TRAY, grasps, pp.pose((0.45, 0, 0.1)), pp.pose((0.75, 0, 0.1)), rng=0)


def deviations(motion: CarryPlan, count: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """(count,) metres and radians by which the follower is off its place at the part, by Pinocchio."""
    group, (leader, follower) = motion.checker.group, motion.grasps
    model = group.model
    data, off = model.createData(), []
    frames = [model.getFrameId(group.ends[name][1]) for name in (leader, follower)]
    placed = motion.grasps[leader] * motion.grasps[follower].inverse()
    for q in motion.trajectory(np.linspace(0, motion.duration, count)):
        pin.framesForwardKinematics(model, data, group.model_configuration(q))
        there = data.oMf[frames[0]].inverse() * data.oMf[frames[1]]
        rotation = pin.log3(placed.rotation.T @ there.rotation)
        off.append((np.linalg.norm(there.translation - placed.translation), np.linalg.norm(rotation)))
    return np.array(off).T


@pytest.mark.parametrize("name", ["over_the_post", "tray_over_the_post"])
def test_the_hands_stay_at_the_part_within_the_proven_deviation(name, request):
    motion = request.getfixturevalue(name).or_raise()
    (proven,) = motion.deviations.values()
    position, rotation = deviations(motion)
    assert position.max() <= proven.position <= 2e-4
    assert rotation.max() <= proven.rotation <= np.radians(0.1)
    # The part passes the post, whose top is above its start and its goal, and nothing touches, at samples by coal
    root_from_part = motion.checker.group.tcp_placements
    leader = motion.leader
    heights = [
        (root_from_part(q)[leader] * motion.grasps[leader]).translation[2]
        for q in motion.trajectory(np.linspace(0, motion.duration, 50))
    ]
    assert max(heights) > heights[0] + 0.05
    assert audit(motion.trajectory, motion.checker, step=0.02, measure=False).clean


def test_the_angle_of_a_hand_follows_from_those_of_two_axes(over_the_post):
    """It is that of the axis which turns more, or larger; at most the square root of the sum of both squares."""
    (proven,) = over_the_post.deviations.values()
    one, other = (proof.largest for proof in over_the_post.certificate.constraints[1:])
    assert max(one, other) <= proven.rotation <= 1.0001 * np.hypot(one, other)


def test_the_motion_keeps_the_limits_of_all_joints(over_the_post):
    motion, limits = over_the_post.trajectory, over_the_post.checker.group.limits
    t = np.linspace(0, motion.duration, 2000)
    assert limits.inside(motion(t)).all()
    assert (np.abs(motion.velocity(t)) <= limits.velocity * (1 + 1e-9)).all()
    assert not motion.velocity(np.array([0.0, motion.duration])).any()


def test_the_part_is_at_its_poses_at_the_start_and_at_the_goal(over_the_post):
    group, leader = over_the_post.checker.group, over_the_post.leader
    for q, pose in zip(over_the_post.trajectory.q[[0, -1]], OVER_THE_POST, strict=True):
        assert pose.isApprox(group.tcp_placements(q)[leader] * over_the_post.grasps[leader], 1e-6)


def test_a_motion_whose_follower_is_late_is_violated(over_the_post):
    """The right arm follows the same path 5 ms later, which is too late by more than the tolerance."""
    given, group = over_the_post.trajectory, over_the_post.checker.group
    parts = pp.motion.separate(given, group)
    late = pp.Trajectory.at_rest(parts["right"].start, parts["right"].joint_names, 0.005)
    parts["right"] = pp.Trajectory.join(late, parts["right"])
    whole = pp.motion.synchronise(parts, group, wait=True)
    constraints = [proof.constraint for proof in over_the_post.certificate.constraints]
    proof = pp.certify(whole, over_the_post.checker, constraints=constraints)
    assert proof.status is pp.CertificateStatus.VIOLATED
    assert proof.violation.constraint.relative_to == "left"


def test_straight_edges_do_not_close_the_chain(over_the_post):
    """Between two configurations that close it, a straight edge leaves the tolerance by far."""
    trajectory, constraints = over_the_post.trajectory, over_the_post.certificate.constraints
    edge = pp.JointPath(trajectory.q[[0, -1]], trajectory.joint_names)
    proof = pp.certify(edge, over_the_post.checker, constraints=[each.constraint for each in constraints])
    assert max(each.observed for each in proof.constraints) > 0.01


def test_the_proof_of_a_carried_part_is_verified_from_its_file(over_the_post, tmp_path):
    over_the_post.save(tmp_path / "carry.json")
    constraints = [proof.constraint for proof in over_the_post.certificate.constraints]
    known = tmp_path / "carry.proof.json", over_the_post.checker, over_the_post.trajectory
    verdict = pp.verify_proof(*known, constraints)
    assert verdict.ok
    assert [row[1] <= row[2] for row in verdict.constraints] == [True] * 3
    # Its bound is exact to first order too: the motions of both arms cancel, so that few intervals suffice
    stated = json.loads((tmp_path / "carry.proof.json").read_text())["constraints"]
    for row, proof in zip(stated, over_the_post.certificate.constraints, strict=True):
        assert len(row["intervals"]) < 3 * proof.intervals
    # The same constraint relative to the base of the arm is another one
    other = pp.Within.box(constraints[0].base_from_region, (0, 0, 0), tolerance=2e-4)
    fixed = pp.Within(**{**vars(other), "arm": "right"})
    assert not pp.verify_proof(*known, [fixed]).ok


def test_constraints_of_the_part_hold_along_the_motion(pair):
    """The box stays level: an axis of the leader's tcp keeps its direction in the base."""
    level = pp.Upright(arm="left", axis_in_tcp=(0, 0, -1), tolerance=0.05)
    motion = plan_carry(pair, BOX, from_above("left", "right"), *OVER_THE_POST, rng=0, constraints=[level]).or_raise()
    tilt = [level.error(pair.group, q) for q in motion.trajectory(np.linspace(0, motion.duration, 300))]
    assert max(tilt) <= motion.certificate.constraints[-1].largest <= 0.05


def test_a_configuration_is_a_start_and_a_goal(pair, over_the_post):
    start, goal = over_the_post.trajectory.q[[0, -1]]
    grasps = from_above("left", "right")
    again = plan_carry(pair, BOX, grasps, start, goal, rng=1)
    assert again.ok
    assert np.allclose(again.trajectory.q[[0, -1]], [start, goal])
    away = start + np.eye(12)[11] * 0.01
    wrong = plan_carry(pair, BOX, grasps, away, goal)
    assert wrong.status is PlanStatus.START_INVALID
    assert "right relative to left" in wrong.message


def test_an_arm_that_does_not_reach_the_part_is_named(pair):
    goal = pp.pose((0.5, 1.2, 0.3))
    result = plan_carry(pair, BOX, from_above("left", "right"), OVER_THE_POST[0], goal)
    assert result.status is PlanStatus.GOAL_UNREACHABLE
    assert "'left'" in result.message
    assert "'right'" not in result.message
    assert result.poses[0].unreachable


def test_a_part_in_contact_at_the_goal_is_named_with_the_obstacle(pair):
    result = plan_carry(pair, BOX, from_above("left", "right"), OVER_THE_POST[0], pp.pose((0.75, 0, 0.3)))
    assert result.status is PlanStatus.GOAL_INVALID
    assert any(set(contact.bodies) == {"box", "post"} for contact in result.contacts)


def test_a_search_that_finds_nothing_says_whether_contacts_are_the_reason(pair):
    """The post is higher than the arms reach, and between the hands."""
    high = pp.Obstacle("post", pp.Cylinder(radius=0.06, length=4.0), pp.pose((0.75, 0, 2.0)))
    walled = pair.with_scene(pair.scene.remove("post").add(high))
    planner = pp.RrtConnect(max_nodes=200, max_samples=400)
    result = plan_carry(walled, BOX, from_above("left", "right"), *OVER_THE_POST, planner=planner)
    assert result.status is PlanStatus.OUT_OF_BUDGET
    assert "without contacts, the arms can carry" in result.message


def test_the_hands_may_touch_the_part_and_the_other_links_may_not(over_the_post):
    pairs = {frozenset(pair.owners) for pair in over_the_post.checker.excluded}
    assert {frozenset(("box", "right/link_6")), frozenset(("box", "left/link_6"))} <= pairs
    assert frozenset(("box", "right/link_5")) not in pairs


@pytest.mark.parametrize(
    ("robot", "arms", "base"), [("baxter_left", ("left", "right"), None), ("tiago_dual_left", (), "torso_fixed_link")]
)
def test_the_chain_between_two_hands_is_that_of_pinocchio(robot, arms, base):
    """Also where both arms hang on a torso that moves: its joint cancels."""
    group = pp.load_robot(robot).arms(*arms, base=base)
    one, other = group.ends
    for q in np.random.default_rng(0).uniform(*group.limits.sampling_range(), size=(20, group.dof)):
        placed = group.tcp_placements(q)
        expected = (placed[other].inverse() * placed[one]).homogeneous
        assert np.allclose(group.tcp_chain(one, other).forward_batch(q[None])[0], expected, atol=1e-12)
        assert np.allclose(group.tcp_placement(q, one, other).homogeneous, expected, atol=1e-12)
    used = {group.joint_names[joint.index] for joint in group.tcp_chain(one, other).joints}
    assert used == set(group.joint_names) - set(group.shared_joints)


@pytest.mark.parametrize("seed", range(6))
def test_the_bound_of_the_deviation_holds_for_random_motions(pair, baxter, seed):
    """Both arms move at random; what is proven of a tolerance that the motion keeps is never below dense samples."""
    group = (pair if seed % 2 else baxter).group
    rng = np.random.default_rng(seed)
    lower, upper = group.limits.sampling_range()
    q = rng.uniform(lower, upper)
    q = np.clip(q + rng.normal(scale=0.05, size=(4, group.dof)).cumsum(axis=0), lower, upper)
    curve = pp.motion.CubicPath.through(q, group.joint_names)
    pose = group.tcp_placement(q[1], "right", "left")
    constraints = held_together("right", "left", pose, tolerance=1.0, rotation_tolerance=1.0)
    alone = pp.CollisionChecker(group, trust_disabled=True)
    alone = alone.without_pairs(range(len(alone.pairs)))
    proof = pp.certify(curve, alone, constraints=constraints, limits=None)
    assert proof.free
    samples = curve(np.linspace(*curve.domain, 400))
    for each in proof.constraints:
        largest = max(each.constraint.error(group, q) for q in samples)
        assert largest <= each.largest <= 1.2 * largest + 0.5 * (each.constraint.tolerance - largest)
    angles = [
        np.linalg.norm(pin.log3(pose.rotation.T @ group.tcp_placement(q, "right", "left").rotation)) for q in samples
    ]
    sines = sum(np.sin(each.largest / 2) ** 2 for each in proof.constraints[1:])
    assert max(angles) <= 2 * np.arcsin(np.sqrt(sines))


@pytest.mark.parametrize("tolerance", [0.01, 1.0, 3.0])
def test_a_rotation_within_the_constraints_is_within_the_tolerance(pair, tolerance):
    """About an axis in the plane of the two that are kept, each of them turns the least in relation to the rotation."""
    group, q = pair.group, pair.group.home
    there = group.tcp_placement(q, "right", "left")
    for angle in np.array([0.999, 1.001]) * tolerance:
        for axis in ([1, 1, 0], [1, -1, 0], [1, 0, 0], [1, 2, 1]):
            turn = pin.SE3(pin.exp3(angle * np.array(axis) / np.linalg.norm(axis)), np.zeros(3))
            place, *axes = held_together(
                "right", "left", there * turn.inverse(), tolerance=1e-3, rotation_tolerance=tolerance
            )
            assert place.error(group, q) <= place.tolerance
            kept = all(each.error(group, q) <= each.tolerance for each in axes)
            assert not kept or angle <= tolerance
            assert kept or angle > tolerance or axis[1] != axis[0]
    with pytest.raises(pp.InputError, match="rotation_tolerance"):
        held_together("right", "left", there, tolerance=1e-3, rotation_tolerance=np.pi)


@pytest.mark.parametrize(
    ("grasps", "error", "named"),
    [
        ({"left": np.eye(4)}, pp.InputError, "at least two"),
        ({"left": np.eye(4), "middle": np.eye(4)}, pp.UnknownNameError, "middle"),
        ({"left": np.eye(4), "right": np.diag([1, 1, 2, 1])}, pp.InputError, "right"),
    ],
)
def test_grasps_that_hold_nothing_are_refused(pair, grasps, error, named):
    with pytest.raises(error, match=named):
        plan_carry(pair, BOX, grasps, *OVER_THE_POST)


LIFT = """<robot name="lift"><link name="base"/><link name="torso"/><link name="a"/><link name="b"/>
<joint name="lift" type="prismatic"><parent link="base"/><child link="torso"/><axis xyz="0 0 1"/>{limit}</joint>
<joint name="a" type="prismatic"><parent link="torso"/><child link="a"/><axis xyz="1 0 0"/>{limit}</joint>
<joint name="b" type="prismatic"><parent link="torso"/><child link="b"/><axis xyz="1 0 0"/>{limit}</joint>
</robot>""".format(limit='<limit lower="-1" upper="1" velocity="1" effort="1"/>')


def test_poses_of_arms_that_share_a_joint_are_refused():
    group = pp.model.load_robot(LIFT).arms("a", "b", base="base")
    checker = pp.CollisionChecker(group)
    with pytest.raises(pp.InputError, match="shared"):
        plan_carry(checker, TRAY, dict.fromkeys(group.ends, np.eye(4)), group.home, pp.pose((0.5, 0, 0.8)))
