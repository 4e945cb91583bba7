"""`pp.plan`: a certified motion in one call, to any kind of goal, or the reason with its evidence."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

import pinproof as pp
from pinproof.planning import PlanStatus

from .arms import ball_arm

START, GOAL = [-1.0, -1.2, 1.2, -1.57, -1.57, 0.0], [1.0, -1.2, 1.2, -1.57, -1.57, 0.0]
POST = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose(xyz=(0.55, 0.0, 0.5)))
DOWN = (np.pi, 0.0, 0.0)
BESIDE, INSIDE = pp.pose((0.4, 0.35, 0.3), DOWN), pp.pose((0.55, 0.0, 0.3), DOWN)
FAR, SHELF = pp.pose((1.4, 0.1, 0.3), DOWN), pp.pose((0.3, -0.4, 0.4), DOWN)


@pytest.fixture(scope="module")
def checker(ur5):
    return pp.CollisionChecker(ur5, pp.Scene([POST]), margin=0.002)


@pytest.fixture(scope="module")
def to_pose(checker):
    return pp.plan(checker, START, BESIDE, budget=40)


def assert_moves(motion, checker, start, step=0.002):
    """Independent of the planner: the motion begins at the start, at rest, and dense samples are free and inside."""
    motion.or_raise()
    times = np.linspace(0.0, motion.duration, int(motion.duration / step) + 2)
    q = motion.trajectory(times)
    np.testing.assert_allclose(q[0], start, atol=1e-9)
    assert checker.is_free_batch(q).all()
    assert checker.group.limits.inside(q).all()
    assert (np.abs(motion.trajectory.velocity(times)) <= checker.group.limits.velocity * (1 + 1e-9)).all()
    assert motion.certificate.matches(motion.trajectory, checker.group, checker.scene, checker.attached)


def at(arm, motion):
    return arm.forward_kinematics(motion.trajectory.end).homogeneous


# -- goals -------------------------------------------------------------------------------------------------------------


def test_a_configuration(checker):
    motion = pp.plan(checker, START, GOAL, budget=40)
    assert_moves(motion, checker, START)
    np.testing.assert_allclose(motion.trajectory.end, GOAL, atol=1e-9)
    assert motion.duration <= motion.to_dict()["duration_of_path"]


def test_several_configurations_of_which_one_is_free(checker):
    motion = pp.plan(checker, START, [[0.0, 0.5, 0.0, 0.0, 0.0, 9.0], GOAL], budget=40)
    assert_moves(motion, checker, START)
    assert motion.goal == 1


def test_a_pose_is_reached_by_any_of_its_ik_solutions(ur5, checker, to_pose):
    assert_moves(to_pose, checker, START)
    np.testing.assert_allclose(at(ur5, to_pose), BESIDE.homogeneous, atol=1e-6)
    assert len(to_pose.goals) > 8
    assert checker.is_free_batch(to_pose.goals).all()
    assert (to_pose.goal, len(to_pose.poses)) == (0, 1)


def test_of_several_poses_a_reachable_one(ur5, checker):
    motion = pp.plan(checker, START, [FAR, INSIDE, BESIDE, SHELF], budget=40)
    assert_moves(motion, checker, START)
    assert motion.goal in (2, 3)
    np.testing.assert_allclose(at(ur5, motion), (BESIDE, SHELF)[motion.goal - 2].homogeneous, atol=1e-6)


def test_ik_branches(ur5, checker, to_pose):
    motion = pp.plan(checker, START, pp.AnalyticIk().solve_all(ur5, BESIDE, START), budget=40)
    np.testing.assert_array_equal(motion.trajectory.q, to_pose.trajectory.q)


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_a_pose_of_a_redundant_arm(name):
    arm = pp.load_robot(name).arm()
    there = arm.forward_kinematics(arm.home)
    pose = pp.pose(there.translation + np.array([-0.05, 0.2, 0.0])) * pp.pose(rpy=pp.xyz_rpy(there)[3:])
    checker = pp.CollisionChecker(arm)
    motion = pp.plan(checker, arm.home, pose, budget=40)
    assert_moves(motion, checker, arm.home)
    np.testing.assert_allclose(at(arm, motion), pose.homogeneous, atol=1e-6)


def test_an_arm_without_a_closed_form_uses_iterative_ik():
    rail = ball_arm(("x", "y"))
    checker = pp.CollisionChecker(rail, pp.Scene([pp.Obstacle("peg", pp.Box(0.2, 0.2, 1.0))]))
    motion = pp.plan(checker, [-0.5, 0.0], pp.pose((0.5, 0.1, 0.0)), budget=10)
    assert_moves(motion, checker, [-0.5, 0.0])
    np.testing.assert_allclose(motion.trajectory.end, [0.5, 0.1], atol=1e-6)


@pytest.mark.parametrize(
    ("goal", "stated"),
    [
        ("home", "goal must be numbers"),
        ([1.0, 2.0], "goal must have 6 numbers"),
        (np.eye(4), "pin.SE3"),
        ([], "goal is empty"),
        (None, "goal must"),
        ([BESIDE, GOAL], "poses and other values"),
        ([GOAL, [1.0]], "goal must have the shape"),
    ],
)
def test_anything_else_is_refused(checker, goal, stated):
    with pytest.raises(pp.InputError, match=stated):
        pp.plan(checker, START, goal)


def test_branches_of_another_arm_are_refused(checker):
    other = pp.load_robot("puma560").arm()
    branches = pp.AnalyticIk().solve_all(other, other.forward_kinematics(other.home))
    with pytest.raises(pp.InputError, match="joints"):
        pp.plan(checker, START, branches)


# -- what the motion keeps to ------------------------------------------------------------------------------------------


def test_given_limits_hold_and_are_proven(ur5, checker):
    upper = np.minimum(ur5.limits.upper, np.array(GOAL) + 0.1)
    acceleration = np.full(6, 3.0)
    limits = replace(ur5.limits, upper=upper, acceleration=acceleration, acceleration_source="data sheet")
    motion = pp.plan(checker, START, GOAL, limits=limits, jerk=60.0, budget=40).or_raise()
    times = np.linspace(0.0, motion.duration, 2000)
    assert (motion.trajectory(times) <= upper + 1e-9).all()
    assert np.abs(motion.trajectory.acceleration(times)).max() <= 3.0 * (1 + 1e-6)
    assert motion.trajectory.max_jerk().max() <= 60.0 * (1 + 1e-6)
    assert "acceleration" in motion.certificate.limits.checked
    assert pp.plan(checker, START, np.array(GOAL) + 0.2, limits=limits).status is PlanStatus.GOAL_INVALID
    narrow = replace(ur5.limits, lower=np.array(START) - 0.1, upper=np.array(START) + 0.1)
    assert pp.plan(checker, START, BESIDE, limits=narrow).status is PlanStatus.GOAL_UNREACHABLE


def test_constraints_hold_on_the_whole_motion(ur5, tmp_path):
    checker = pp.CollisionChecker(ur5)
    upright = pp.Upright(tolerance=0.1, axis_in_tcp=(0.0, 0.0, -1.0))
    start = [-1.0, -1.2, 1.6, -1.97, -1.57, 0.0]
    goal = ur5.forward_kinematics([1.0, -1.2, 1.6, -1.97, -1.57, 0.5])
    motion = pp.plan(checker, start, goal, constraints=[upright], budget=20).or_raise()
    q = motion.trajectory(np.linspace(0.0, motion.duration, 500))
    assert max(upright.error(ur5, each) for each in q) <= 0.1
    assert motion.certificate.constraints[0].constraint == upright
    motion.save(tmp_path / "motion.json")
    assert len(json.loads((tmp_path / "motion.proof.json").read_text())["constraints"]) == 1


def test_torques_are_limits_of_the_motion(ur5):
    found = pp.plan(pp.CollisionChecker(ur5), START, GOAL, budget=5, rate_limits=[pp.motion.TorqueLimits(ur5)])
    assert len(found.to_dict()["torques"]) == ur5.dof
    assert "largest torque" in found.to_text()


def test_the_same_seed_gives_the_same_motion(checker, to_pose):
    again = pp.plan(checker, START, BESIDE, budget=40)
    np.testing.assert_array_equal(again.trajectory.q, to_pose.trajectory.q)


# -- failures and their evidence ---------------------------------------------------------------------------------------


def test_a_start_in_contact_has_its_bodies_and_depth(checker, ur5):
    inside = pp.AnalyticIk().solve_all(ur5, INSIDE).q[0]
    motion = pp.plan(checker, inside, GOAL)
    assert motion.status is PlanStatus.START_INVALID
    (end,) = motion.invalid
    assert end.goal is None
    assert {"post"} < {name for contact in end.contacts for name in contact.bodies}
    assert max(contact.depth for contact in motion.contacts) > 0.01
    assert "post" in motion.message


def test_a_start_in_contact_is_reported_before_a_goal_out_of_reach(checker, ur5):
    inside = pp.AnalyticIk().solve_all(ur5, INSIDE).q[0]
    assert pp.plan(checker, inside, FAR).status is PlanStatus.START_INVALID


def test_a_goal_outside_its_limits_has_joint_value_and_limit(checker, ur5):
    motion = pp.plan(checker, START, [*GOAL[:5], 8.0])
    assert motion.status is PlanStatus.GOAL_INVALID
    (joint,) = motion.invalid[0].limits
    assert (joint.joint, joint.value) == ("wrist_3_joint", 8.0)
    assert joint.upper == pytest.approx(ur5.limits.upper[5])


def test_a_pose_out_of_reach_is_proven_with_the_nearest_configuration(checker, ur5):
    motion = pp.plan(checker, START, FAR)
    assert motion.status is PlanStatus.GOAL_UNREACHABLE
    (pose,) = motion.poses
    assert pose.unreachable
    assert pose.proof is None or pose.proof.verify()
    error = np.linalg.norm(ur5.forward_kinematics(pose.nearest.q).translation - FAR.translation)
    assert pose.nearest.position_error == pytest.approx(error)
    assert motion.to_dict()["poses"][0]["position_error"] == pytest.approx(error)


def test_a_pose_out_of_reach_of_a_redundant_arm_is_proven():
    arm = pp.load_robot("panda").arm()
    motion = pp.plan(pp.CollisionChecker(arm), arm.home, pp.pose((0.9, 0.0, 0.9)))
    assert motion.status is PlanStatus.GOAL_UNREACHABLE
    assert motion.poses[0].proof.verify()


def test_a_pose_within_an_obstacle_states_that_all_solutions_are_in_contact(checker, ur5):
    motion = pp.plan(checker, START, INSIDE)
    assert motion.status is PlanStatus.GOAL_INVALID
    (pose,) = motion.poses
    branches = pp.AnalyticIk().solve_all(ur5, INSIDE).branches
    assert (len(pose.branches), len(pose.invalid), pose.complete) == (len(branches), len(branches), True)
    for end in pose.invalid:
        assert {"post"} < {name for contact in end.contacts for name in contact.bodies}
    least = min(max(contact.depth for contact in end.contacts) for end in pose.invalid)
    assert f"{least * 1e3:.1f} mm" in motion.message.partition(";")[2].partition(";")[0]
    assert f"all IK solutions ({len(branches)})" in motion.message


def test_several_poses_that_fail_have_their_own_reasons(checker):
    motion = pp.plan(checker, START, [FAR, INSIDE])
    assert motion.status is PlanStatus.GOAL_INVALID
    far, inside = motion.poses
    assert far.unreachable
    assert not far.invalid
    assert inside.invalid
    assert not inside.unreachable


def test_a_barrier_has_joint_value_and_contact():
    rail = ball_arm(("x",))
    checker = pp.CollisionChecker(rail, pp.Scene([pp.Obstacle("wall", pp.Box(0.02, 4.0, 1.0))]))
    motion = pp.plan(checker, [-0.8], [0.8])
    assert motion.status is PlanStatus.IMPOSSIBLE
    (barrier,) = motion.barriers
    assert (barrier.joint, "wall" in barrier.contact.bodies) == ("x", True)
    assert not motion.checker.is_free([barrier.value])
    assert motion.to_dict()["barriers"][0]["value"] == barrier.value


def test_a_barrier_before_the_nearest_angle_of_a_joint_without_limits_is_passed_on_the_other_side(turntable):
    post = pp.Obstacle("post", pp.Cylinder(0.05, 0.5), pp.pose((np.cos(3.0), np.sin(3.0), 0.0)))
    checker = pp.CollisionChecker(turntable, pp.Scene([post]))
    pose = turntable.forward_kinematics(np.array([3.5]))
    motion = pp.plan(checker, [2.5], pose, budget=0)
    assert_moves(motion, checker, [2.5])
    np.testing.assert_allclose(at(turntable, motion), pose.homogeneous, atol=1e-6)
    assert (motion.goals == motion.trajectory.end).all(axis=1).any()


def test_barriers_are_no_proof_for_a_pose_with_unknown_solutions():
    # Two slides in x: the outer one alone reaches the pose, the inner one cannot pass the wall
    slide = '<joint name="{1}" type="prismatic"><parent link="{0}"/><child link="{1}"/><axis xyz="1 0 0"/>'
    slide += '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
    box = '<collision><origin xyz="0 0 -0.5"/><geometry><box size="0.05 0.05 0.05"/></geometry></collision>'
    links = f'<link name="base"/><link name="inner">{box}</link><link name="outer"/>'
    urdf = f'<robot name="slides">{links}{slide.format("base", "inner")}{slide.format("inner", "outer")}</robot>'
    arm = pp.load_robot(urdf).arm(tcp="outer")
    wall = pp.Obstacle("wall", pp.Box(0.04, 0.2, 0.2), pp.pose((0.055, 0.0, -0.5)))
    checker = pp.CollisionChecker(arm, pp.Scene([wall]))
    assert pp.plan(checker, [0.0, 0.0], [0.0, 0.95], budget=0).ok
    motion = pp.plan(checker, [0.0, 0.0], pp.pose((0.95, 0.0, 0.0)), budget=0)
    assert (motion.goals[:, 0] > 0.0).all()
    assert (motion.status, motion.barriers) == (PlanStatus.OUT_OF_BUDGET, ())
    assert "inner cannot pass" in motion.message


def test_a_search_that_ends_without_a_path_states_its_work(checker):
    walls = [pp.Obstacle(f"wall {x}", pp.Box(1.5, 0.02, 3.0), pp.pose(xyz=(x, 0.0, 1.0))) for x in (-1.0, 1.0)]
    divided = checker.with_scene(pp.Scene(walls)).with_margin(0.0)
    motion = pp.plan(divided, START, GOAL, planner=pp.RrtConnect().limited_to(1))
    assert motion.status is PlanStatus.OUT_OF_BUDGET
    assert motion.planned.nodes > 0
    assert 0.0 < motion.planned.gap < np.inf
    assert motion.to_dict()["nodes"] == motion.planned.nodes


def test_a_path_that_cannot_be_timed_is_a_status(checker, monkeypatch):
    def refuse(*_args, **_settings):
        raise pp.errors.TimingError("too heavy")

    monkeypatch.setattr("pinproof.planning.motion_plan.optimise", refuse)
    motion = pp.plan(checker, START, GOAL)
    assert (motion.status, motion.ok, motion.message) == (PlanStatus.NOT_TIMED, False, "too heavy")


def test_a_motion_that_is_not_proven_is_no_motion(checker, monkeypatch, to_pose):
    optimise = pp.optimise

    def unproven(path, checker, **settings):
        found = optimise(path, checker, **settings)
        wall = pp.Obstacle("wall", pp.Sphere(0.05), checker.arm.forward_kinematics(path.end))
        return replace(found, certificate=pp.certify(found.trajectory, checker.with_scene(pp.Scene([wall]))))

    monkeypatch.setattr("pinproof.planning.motion_plan.optimise", unproven)
    motion = pp.plan(checker, START, GOAL, budget=0)
    assert (motion.status, motion.ok) == (PlanStatus.NOT_PROVEN, False)
    assert "wall" in motion.message
    with pytest.raises(pp.errors.PlanFailed, match="wall"):
        motion.or_raise()


@pytest.mark.parametrize("goal", [FAR, INSIDE, [*GOAL[:5], 8.0]])
def test_reading_what_does_not_exist_raises_with_the_evidence(checker, goal, tmp_path):
    motion = pp.plan(checker, START, goal)
    reads = ("trajectory", "certificate", "duration", "goal", "simplified", "optimised")
    for read in (*(lambda name=name: getattr(motion, name) for name in reads), motion.or_raise):
        with pytest.raises(pp.errors.PlanFailed) as caught:
            read()
        assert caught.value.result is motion
    with pytest.raises(pp.errors.PlanFailed):
        motion.save(tmp_path / "motion.json")
    assert not list(tmp_path.iterdir())


# -- files and pages ---------------------------------------------------------------------------------------------------


def test_a_motion_is_saved_with_a_proof_that_others_verify(checker, to_pose, tmp_path):
    to_pose.save(tmp_path / "motion.json")
    loaded = pp.Trajectory.load(tmp_path / "motion.json", checker.group.joint_names)
    np.testing.assert_array_equal(loaded.q, to_pose.trajectory.q)
    assert not pp.collision.missing_since(loaded.certified, checker)
    proof = pp.verify_proof(tmp_path / "motion.proof.json")
    assert proof.ok


def test_a_page_shows_the_motion_with_its_certificate(to_pose, tmp_path):
    to_pose.to_html(tmp_path / "motion.html")
    text = (tmp_path / "motion.html").read_text()
    assert "FREE" in text
    assert "NOT VALIDATED" not in text


@pytest.mark.parametrize(("goal", "shown"), [(INSIDE, "IN CONTACT"), (FAR, "goal 0")])
def test_a_page_shows_the_configuration_that_is_the_reason(checker, goal, shown, tmp_path):
    pp.plan(checker, START, goal).to_html(tmp_path / "motion.html")
    text = (tmp_path / "motion.html").read_text()
    assert shown in text
    assert ">FREE<" not in text


def test_a_pickle_has_the_motion_and_its_certificate_without_the_checker(to_pose, checker):
    size = len(pickle.dumps(checker))
    plan = pp.RrtConnect().plan(checker, START, GOAL)
    for result in (to_pose, plan, pp.plan(checker, START, INSIDE)):
        data = pickle.dumps(result)
        assert len(data) < 0.3 * size
        again = pickle.loads(data)
        assert (again.status, again.message) == (result.status, result.message)
        with pytest.raises(pp.errors.PlanFailed, match="checker"):
            _ = pickle.loads(pickle.dumps(to_pose)).checker
    assert pickle.loads(pickle.dumps(to_pose)).certificate.free
    assert pickle.loads(pickle.dumps(plan)).certificate.free


def test_show_serves_the_motion(to_pose):
    with to_pose.show() as shown:
        assert shown.url.startswith("http://127.0.0.1")


def test_a_goal_in_degrees_is_recognised(checker):
    assert "90 degrees" in pp.plan(checker, START, [90.0, -90.0, 90.0, 0.0, 0.0, 0.0]).message


def test_a_contact_that_no_joint_ends_names_its_remedy(ur5):
    checker = pp.CollisionChecker(ur5, pp.Scene([pp.Obstacle("table", pp.Box(1, 1, 0.1), pp.pose((0, 0, -0.05)))]))
    failed = pp.plan(checker, ur5.home, ur5.home + 0.2)
    assert failed.status is PlanStatus.START_INVALID
    assert "base_link and table in every configuration" in failed.message
    assert "allowed=" in failed.message
    assert pp.plan(checker.allowing(("base_link", "table")), ur5.home, ur5.home + 0.2).ok
