"""Motions along tool paths: audited independently, optimal, and the reasons where no motion exists."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.tool_path_audits import arm_of, best_of_tries, random_problem, wrong

import pinproof as pp
from pinproof.description import with_frame
from pinproof.motion import CubicPath
from pinproof.planning import Route
from pinproof.tool_paths import FollowCosts, FollowPlan, FollowStatus, Obstruction, PathPiece, ToolPath, following
from pinproof.tool_paths.curves import CurveMaker
from pinproof.tool_paths.search import HOPELESS, SPIN, Search

UP = (0.0, 0.0, 1.0)
LINE = np.column_stack([np.full(7, 0.4), np.linspace(-0.3, 0.3, 7), np.full(7, 0.2)])
CHECKED = {"free_rotation": True, "deviation": 1e-3, "rotation_deviation": np.radians(1.0)}


@pytest.fixture(scope="module")
def ur5():
    return arm_of("ur5")


@pytest.fixture(scope="module")
def free(ur5):
    return pp.CollisionChecker(ur5)


def walled(arm, centre, sides=(0.3, 0.02, 0.5)):
    return pp.CollisionChecker(arm, pp.Scene([pp.Obstacle("wall", pp.Box(*sides), pp.pose(centre))]))


@pytest.mark.parametrize("name", ["ur5", "irb120", "crx10ia", "puma560", "panda"])
def test_random_paths_pass_an_independent_dense_check(name):
    found = 0
    for seed in range(6):
        checker, path, settings = random_problem(name, np.random.default_rng(seed))
        plan = pp.follow(checker, path, **settings)
        if plan.ok:
            found += 1
            assert wrong(plan, settings) == [], seed
            assert plan.certificate.matches(plan.trajectory, checker.arm, checker.scene)
        else:
            assert plan.blocked or plan.cuts, seed
    assert found


@pytest.mark.parametrize(("name", "seed"), [("panda", 139), ("panda", 194), ("irb120", 148)])
def test_what_is_blocked_on_the_grid_is_followed_between_its_values_or_its_poses(monkeypatch, name, seed):
    checker, path, settings = random_problem(name, np.random.default_rng(seed))
    plan = pp.follow(checker, path, **settings).or_raise()
    assert wrong(plan, settings) == []
    assert plan.cuts == ()
    monkeypatch.setattr(Search, "finer", lambda *_: None)
    assert not pp.follow(checker, path, **settings).ok


def test_poses_out_of_reach_are_the_answer_before_the_budget_is_used_up():
    checker, path, settings = random_problem("panda", np.random.default_rng(107))
    plan = pp.follow(checker, path, **settings)
    assert (plan.status, plan.blocked[0].obstruction) == (FollowStatus.BLOCKED, Obstruction.OUT_OF_REACH)
    assert plan.blocked[0].pose < 0.0  # the approach
    assert plan.rungs <= 61 + HOPELESS


@pytest.mark.parametrize(
    ("name", "seed"), [("ur5", 27), ("ur5", 151), ("panda", 55), ("panda", 57), ("panda", 40), ("panda", 68)]
)
def test_no_motion_from_a_random_start_costs_less(name, seed):
    """The optimum is between the values of the grid or its rungs, near another sequence, or at a joint limit."""
    checker, path, settings = random_problem(name, np.random.default_rng(seed))
    plan = pp.follow(checker, path, **settings).or_raise()
    _, least, own = best_of_tries(checker, path, settings, plan, np.random.default_rng([seed, 1]))
    assert own <= least * (1.0 + 5e-4)  # it is not at the places of the tries at its rounded corners
    assert wrong(plan, settings) == []


def test_the_speed_of_the_path_is_kept_and_proven(free):
    plan = pp.follow(free, ToolPath.through(LINE, UP, speed=0.1), speed_tolerance=0.05).or_raise()
    (piece,) = plan.pieces
    assert 0.095 <= piece.speed[0] <= piece.speed[1] <= 0.1 * (1 + 1e-4)
    assert max(piece.ramps) < 0.005
    times = np.linspace(0, piece.trajectory.duration, 4000)
    points = np.array([free.arm.forward_kinematics(q).translation for q in piece.trajectory(times)])
    speed = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(times)
    along = np.cumsum(speed * np.diff(times))
    inside = (along > piece.ramps[0] + 1e-3) & (along < along[-1] - piece.ramps[1] - 1e-3)
    assert speed[inside].min() >= piece.speed[0] - 1e-6
    assert speed.max() <= piece.speed[1] + 1e-6


def test_a_speed_that_the_joints_do_not_permit_is_too_slow_only_with_a_tolerance(free):
    fast = ToolPath.through(LINE, UP, speed=2.0)
    plan = pp.follow(free, fast, speed_tolerance=0.1)
    assert (plan.status, plan.ok) == (FollowStatus.TOO_SLOW, False)
    plan = pp.follow(free, fast).or_raise()
    assert plan.pieces[0].speed_share < 0.9
    assert "slows down" in plan.message


def test_each_part_of_the_path_has_its_own_speed(free):
    plan = pp.follow(free, ToolPath.through(LINE, UP, speed=[0.1] * 3 + [0.05] * 3)).or_raise()
    assert plan.duration == pytest.approx(3.0 + 6.0, abs=0.2)
    trajectory = plan.pieces[0].trajectory
    places = [free.arm.forward_kinematics(trajectory(t)).translation[1] for t in (1.0, 2.0, 5.0, 7.0)]
    assert (places[1] - places[0], places[3] - places[2]) == pytest.approx((0.1, 0.1), abs=2e-3)


def test_the_rotation_of_the_tool_stays_in_its_range(free):
    # The wrist of a fixed tool would pass close to a singular configuration
    arm, low, high = free.arm, -0.3, 0.4
    path = ToolPath.through(LINE, UP, speed=0.1)
    plan = pp.follow(free, path, free_rotation=(low, high)).or_raise()
    times = np.linspace(0, plan.duration, 500)
    relative = path.poses[0, :3, :3].T @ np.array([arm.forward_kinematics(q).rotation for q in plan.trajectory(times)])
    angle = np.arctan2(relative[:, 1, 0], relative[:, 0, 0])
    assert angle.min() >= low - np.radians(1.0)
    assert angle.max() <= high + np.radians(1.0)
    fixed = pp.follow(free, path, free_rotation=False).or_raise()
    assert fixed.pieces[0].rotations == pytest.approx(0.0, abs=1e-6)
    assert pp.follow(free, path).cost <= plan.cost * 1.01 <= fixed.cost * 1.02


def test_the_cost_chooses_the_motion(free):
    path = ToolPath.through(LINE, UP, speed=0.1)
    checker = walled(free.arm, (0.4, 0.0, 0.45), (0.1, 0.1, 0.1))

    def clearance(plan):
        times = np.linspace(0, plan.duration, 60)
        return float(np.mean(checker.clearance_batch(plan.trajectory(times))))

    near, far = (pp.follow(checker, path, cost=cost).or_raise() for cost in ("travel", "clearance"))
    assert clearance(far) > clearance(near)
    travel = [(np.abs(np.diff(plan.pieces[0].q, axis=0)) / free.arm.limits.velocity).sum() for plan in (near, far)]
    assert travel[0] < travel[1]
    own = pp.follow(checker, path, cost=FollowCosts(travel=1.0, time=0.1, effort=1e-3))
    assert own.cost == near.cost


def test_finer_values_around_the_optimum_never_cost_more(free):
    plan = pp.follow(free, ToolPath.through(LINE, UP, speed=0.1), rotations=5)
    assert plan.cost <= plan.pieces[0].grid_cost + 1e-9
    assert plan.cost == pytest.approx(pp.follow(free, plan.path, rotations=48).cost, rel=0.02)


def test_a_path_of_one_pose_and_repeated_poses(free):
    one = pp.follow(free, ToolPath.through(LINE[:1], UP)).or_raise()
    assert (one.duration, len(one.trajectory.q)) == (0.0, 1)
    touched = pp.follow(free, ToolPath.through(LINE[:1], UP), approach=0.05).or_raise()
    assert touched.duration > 0.1
    start, end = (
        free.arm.forward_kinematics(q).translation for q in (touched.trajectory.start, touched.trajectory.end)
    )
    assert start == pytest.approx(LINE[0] + [0, 0, 0.05], abs=1e-6)
    assert end == pytest.approx(start, abs=1e-6)
    twice = pp.follow(free, ToolPath.through(np.repeat(LINE, 2, axis=0), UP, speed=0.1)).or_raise()
    assert twice.cost == pytest.approx(pp.follow(free, ToolPath.through(LINE, UP, speed=0.1)).cost)


def test_a_closed_path_and_a_path_that_returns_are_followed(free):
    a = np.linspace(0, 2 * np.pi, 61)
    circle = np.column_stack([0.45 + 0.1 * np.cos(a), 0.1 * np.sin(a), np.full(61, 0.2)])
    plan = pp.follow(free, ToolPath.through(circle, UP, speed=0.1)).or_raise()
    assert plan.path.closed
    assert wrong(plan, CHECKED) == []
    back = pp.follow(free, ToolPath.through(LINE[[0, 3, 0, 3]], UP, speed=0.1)).or_raise()
    assert wrong(back, CHECKED) == []
    speed = np.linalg.norm(back.trajectory.velocity(np.array(back.trajectory.times)), axis=1)
    assert (speed < 1e-9).sum() == 4  # it stops where it reverses


def test_corners_are_rounded_within_the_deviation(free):
    square = np.array([[0.4, -0.1, 0.2], [0.5, -0.1, 0.2], [0.5, 0.1, 0.2], [0.4, 0.1, 0.2], [0.4, -0.1, 0.2]])
    for deviation in (3e-4, 3e-3):
        settings = {**CHECKED, "deviation": deviation}
        plan = pp.follow(free, ToolPath.through(square, UP, speed=0.05), deviation=deviation).or_raise()
        assert wrong(plan, settings) == []
        assert plan.deviation <= deviation
        speed = np.linalg.norm(plan.trajectory.velocity(np.linspace(0.5, plan.duration - 0.5, 3000)), axis=1)
        assert speed.min() > 1e-3  # it does not stop


def test_the_free_rotation_does_not_swing_between_the_poses():
    # Where corners are rounded by a little, splines with few points swing far out between them
    share, checker = np.linspace(0.0, 1.0, 15)[:, None], pp.CollisionChecker(pp.load_robot("puma560").arm(), pp.Scene())
    zigzag = (np.arange(15) % 2)[:, None] * [-0.004, 0.0036, -0.0128]
    points = [-0.42, -0.524, 0.781] + share * [-0.057, 0.02, 0.025] + zigzag
    axes = np.column_stack([-0.385 + 0.077 * np.sin(np.pi * share), 0.0 * share - 0.92, 0.0 * share - 0.145])
    plan = pp.follow(checker, ToolPath.through(points, -axes, speed=0.161), rotations=12, deviation=3e-4)
    last = plan.trajectory(np.linspace(0.0, plan.duration, 2000))[:, 5]
    assert np.ptp(last) < np.ptp(plan.pieces[0].q[:, 5]) + 1e-3


def test_poses_out_of_reach_are_blocked_with_a_proof(free):
    path = ToolPath.through(np.column_stack([np.linspace(0.4, 1.4, 11), np.zeros(11), np.full(11, 0.3)]), UP, speed=0.1)
    plan = pp.follow(free, path)
    (blocked,) = plan.blocked
    assert (plan.status, blocked.obstruction, blocked.proven) == (FollowStatus.BLOCKED, Obstruction.OUT_OF_REACH, True)
    assert blocked.last == 10
    reach = [np.linalg.norm(pose[:3, 3]) for pose in path.poses]
    assert reach[int(np.ceil(blocked.pose))] > 0.8
    with pytest.raises(pp.errors.PlanFailed, match="out of reach"):
        plan.or_raise()


def test_a_path_through_the_axis_of_the_base_is_blocked_there(free):
    points = np.column_stack([np.linspace(0.35, -0.35, 15), np.zeros(15), np.full(15, 0.3)])
    plan = pp.follow(free, ToolPath.through(points, UP, speed=0.1))
    (blocked,) = plan.blocked
    assert blocked.obstruction is Obstruction.OUT_OF_REACH
    assert blocked.pose < 7 < blocked.last


def test_contacts_name_the_bodies(ur5):
    plan = pp.follow(walled(ur5, (0.4, 0.0, 0.2)), ToolPath.through(LINE, UP, speed=0.1))
    blocked = next(each for each in plan.blocked if each.obstruction is Obstruction.CONTACT)
    assert blocked.proven
    assert blocked.pose <= 3 <= blocked.last
    assert all("wall" in pair for pair, _ in zip(blocked.contacts, range(3), strict=False))
    assert not plan.checker.is_free(blocked.q)


def test_a_wrist_that_winds_up_needs_one_lift_and_is_planned_with_it(free):
    poses = [pp.pose((0.4, 0.1, 0.2), (np.pi, 0, angle)) for angle in np.linspace(0, 4 * np.pi + 1.0, 40) % (2 * np.pi)]
    plan = pp.follow(free, poses, free_rotation=False)
    assert (plan.status, len(plan.cuts), plan.blocked) == (FollowStatus.LIFTS_NEEDED, 1, ())
    assert [piece.trajectory is not None for piece in plan.pieces] == [True, True]
    lifted = pp.follow(free, poses, free_rotation=False, lifts=1, approach=0.03).or_raise()
    assert len(lifted.transits) == 1
    assert lifted.certificate.matches(lifted.trajectory, free.arm, free.scene)
    assert wrong(lifted, {**CHECKED, "free_rotation": False}) == []
    # One joint cannot rotate by more than its range, so that fewer pieces do not suffice
    wrist = [piece.q[:, 5] for piece in plan.pieces]
    assert wrist[0].min() == pytest.approx(free.arm.limits.lower[5], abs=0.01)
    assert wrist[0].max() + 2 * np.pi > free.arm.limits.upper[5]
    once = pp.follow(free, poses[:30], free_rotation=False)
    assert once.ok


def test_a_singular_wrist_is_avoided_by_the_free_rotation_or_the_branch(ur5, free):
    # The line passes through a configuration with a straight wrist, at a fixed orientation
    q = np.array([0.0, -1.2, 1.8, -0.6, 0.0, 0.3])
    centre = ur5.forward_kinematics(q)
    poses = [pp.pose((0, y, 0)) * centre for y in np.linspace(-0.15, 0.15, 13)]
    for settings in ({"free_rotation": True}, {"free_rotation": False}):
        plan = pp.follow(free, ToolPath(poses, 0.05), **settings)
        if plan.ok:
            assert wrong(plan, {**CHECKED, **settings}) == []
        else:
            assert plan.cuts or plan.blocked


def test_the_motion_begins_at_a_given_configuration(ur5, free):
    start = pp.AnalyticIk().solve_all(ur5, pp.pose((0.45, -0.3, 0.3), (np.pi, 0, 0))).q
    start = start[free.is_free_batch(start)][0]
    plan = pp.follow(free, ToolPath.through(LINE, UP, speed=0.1), start=start).or_raise()
    assert plan.trajectory.start == pytest.approx(start, abs=1e-9)
    assert wrong(plan, CHECKED) == []
    touching = walled(ur5, (0.45, -0.3, 0.3), (0.1, 0.1, 0.1))
    refused = pp.follow(touching, ToolPath.through(LINE, UP, speed=0.1), start=start)
    assert refused.blocked[0].obstruction is Obstruction.CONTACT


def test_a_start_at_the_first_pose_leaves_each_line_its_speed(free):
    path = ToolPath.through(LINE[::3], UP, speed=[0.02, 0.2])
    usual = pp.follow(free, path, rotations=8).or_raise()
    again = pp.follow(free, path, rotations=8, start=usual.trajectory.start).or_raise()
    (piece,) = again.pieces
    assert (piece.first, piece.last) == (0.0, 2.0)
    assert again.duration == pytest.approx(usual.duration, rel=0.05)
    assert wrong(again, CHECKED) == []


def test_a_motion_that_avoids_the_start_of_another_starts_in_another_branch(free):
    path, starts = ToolPath.through(LINE, UP, speed=0.1), []
    for _ in range(3):
        plan = pp.follow(free, path, avoid=np.reshape(starts, (-1, 6))).or_raise()
        apart = [np.abs((plan.trajectory.start - start + np.pi) % (2 * np.pi) - np.pi).max() for start in starts]
        assert min(apart, default=1.0) > 0.9
        starts.append(plan.trajectory.start)


def test_avoided_starts_are_no_proof_that_a_pose_cannot_be_passed(free):
    path, starts = ToolPath.through(LINE, UP, speed=0.1), []
    while (plan := pp.follow(free, path, free_rotation=False, avoid=np.reshape(starts, (-1, 6)))).ok:
        starts.append(plan.trajectory.start)
        assert len(starts) < 12
    (blocked,) = plan.blocked
    assert (blocked.obstruction, blocked.proven) == (Obstruction.AVOIDED, False)
    with pytest.raises(pp.InputError, match="avoid"):
        pp.follow(free, path, start=starts[0], avoid=starts)


def test_the_windings_of_a_given_start_are_kept(ur5, free):
    for winding in (0.0, -2 * np.pi):
        start = pp.AnalyticIk().solve_all(ur5, pp.pose((0.45, -0.3, 0.3), (np.pi, 0, 0))).q[0].copy()
        start[5] += winding if start[5] > 0 else -winding
        plan = pp.follow(free, ToolPath.through(LINE[:3], UP, speed=0.1), start=start).or_raise()
        assert plan.trajectory.start == pytest.approx(start, abs=1e-9)


def test_the_speed_holds_on_steps_of_a_fraction_of_a_millimetre(free):
    dense = np.column_stack([np.full(101, 0.4), np.linspace(-0.02, 0.02, 101), np.full(101, 0.2)])
    (piece,) = pp.follow(free, ToolPath.through(dense, UP, speed=0.05), speed_tolerance=0.2).or_raise().pieces
    assert 0.04 <= piece.speed[0] <= piece.speed[1] <= 0.05 * (1 + 1e-4)
    assert piece.trajectory.duration == pytest.approx(0.04 / 0.05, rel=0.1)


def test_where_the_tool_reverses_it_is_slower_only_in_the_reported_intervals(free):
    plan = pp.follow(free, ToolPath.through(LINE[[0, 3, 0]], UP, speed=0.1), speed_tolerance=0.05).or_raise()
    (piece,) = plan.pieces
    ((begin, end),) = piece.slow
    times = np.linspace(0, piece.trajectory.duration, 8001)
    points = np.array([free.arm.forward_kinematics(q).translation for q in piece.trajectory(times)])
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    speed, along, middle = lengths / np.diff(times), np.cumsum(lengths), 0.5 * (times[1:] + times[:-1])
    between = (along > piece.ramps[0] + 1e-4) & (along < along[-1] - piece.ramps[1] - 1e-4)
    slow = (middle > begin - 1e-3) & (middle < end + 1e-3)
    assert speed[between & ~slow].min() >= piece.speed[0] - 1e-6
    assert speed[between & slow].min() < 0.5 * piece.speed[0]


def test_tilts_pass_where_the_axis_of_the_path_is_in_contact(ur5):
    # A bar beside the path, which the wrist touches unless the tool leans away from it
    post = pp.Obstacle("bar", pp.Box(0.02, 0.9, 0.02), pp.pose((0.445, 0.0, 0.24)))
    checker = pp.CollisionChecker(ur5, pp.Scene([post]))
    path = ToolPath.through(LINE, UP, speed=0.1)
    assert pp.follow(checker, path).blocked
    tilted = pp.follow(checker, path, tilts=8, rotation_deviation=1.0, rotations=12).or_raise()
    assert wrong(tilted, {**CHECKED, "rotation_deviation": 1.0}) == []


def test_the_same_seed_gives_the_same_motion(free):
    path = ToolPath.through(LINE, UP, speed=0.1)
    one, other = (pp.follow(free, path) for _ in range(2))
    assert one.trajectory.q.tobytes() == other.trajectory.q.tobytes()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"deviation": 0.5}, "deviation .*millimetres|deviation .*mm"), ({"rotation_deviation": 2.0}, "degrees"),
        ({"deviation": 1e-6}, "deviation"), ({"rotations": 0}, "rotations"), ({"cost": "cheap"}, "balanced"),
        ({"free_rotation": (1.0, -1.0)}, "range"), ({"approach": -0.1}, "approach"), ({"approach": 50.0}, "at most 10"),
        ({"step": 0.0}, "step"),
        ({"speed_tolerance": 2.0}, "speed_tolerance"), ({"lifts": -1}, "lifts"), ({"start": [0.0]}, "start"),
    ],
)  # fmt: skip
def test_settings_out_of_range_are_refused_by_name(free, settings, words):
    with pytest.raises(pp.InputError, match=words):
        pp.follow(free, ToolPath.through(LINE, UP), **settings)


def test_a_piece_of_one_rung_has_no_speed_and_the_result_remains_json():
    path = ToolPath.through(LINE, UP)
    piece = PathPiece(0.0, 0.0, np.zeros((1, 6)), np.zeros(1), np.zeros(1), 0.0, 0.0, None, 0.0, 0.0)
    plan = FollowPlan(FollowStatus.BLOCKED, "", path, (piece,))
    assert json.loads(json.dumps(plan.to_dict(), allow_nan=False))["pieces"][0]["speed"] is None


def test_results_are_saved_and_shown(free, tmp_path):
    plan = pp.follow(free, ToolPath.through(LINE, UP, speed=0.1)).or_raise()
    proof = plan.save(tmp_path / "seam.json")
    assert proof.name == "seam.proof.json"
    assert pp.Trajectory.load(tmp_path / "seam.json").q == pytest.approx(plan.trajectory.q)
    assert plan.to_dict()["pieces"][0]["last"] == 6.0
    assert "seam" not in repr(plan)
    assert repr(plan).startswith("FollowPlan(FOUND: follows 7 poses")
    blocked = pp.follow(free, [pp.pose((3.0, 0.0, 0.0))])
    assert "out of reach" in repr(blocked)
    for each, name in ((plan, "found.html"), (blocked, "blocked.html")):
        each.to_html(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 10_000


def test_the_elbow_that_passes_a_post_is_found(ur5):
    q = np.array([0.0, -1.3, 1.9, -2.17, -1.57, 0.0])
    tool, elbow = ur5.forward_kinematics(q), ur5.frame_placement(q, "forearm_link").translation
    post = pp.Obstacle("post", pp.Box(0.06, 0.06, 0.1), pp.pose(elbow))
    checker = pp.CollisionChecker(ur5, pp.Scene([post]), trust_disabled=True)
    assert not checker.is_free(q)
    poses = [pp.pose(xyz) * tool for xyz in ((0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0.1, 0.1, -0.1), (0, 0, 0))]
    plan = pp.follow(checker, poses, free_rotation=False).or_raise()
    assert wrong(plan, {**CHECKED, "free_rotation": False}) == []


def test_an_arm_of_two_sliding_joints_stops_at_its_limit_and_at_a_wall():
    arm = pp.load_robot(GANTRY).arm(tcp="l2")
    wall = pp.Obstacle("wall", pp.Box(0.1, 0.4, 1.0), pp.pose((0.5, 0.5, 0.0)))
    checker = pp.CollisionChecker(arm, pp.Scene([wall]))

    def followed(*places):
        return pp.follow(checker, ToolPath([pp.pose((*place, 0)) for place in places], 0.2), free_rotation=False)

    plan = followed((0.0, 0.0), (0.0, -0.9), (0.9, -0.9)).or_raise()
    assert wrong(plan, {**CHECKED, "free_rotation": False}) == []
    (blocked,) = followed((0.0, 0.0), (0.0, -1.5)).blocked
    assert (blocked.obstruction, blocked.pose) == (Obstruction.LIMIT, pytest.approx(1.0 / 1.5, abs=0.02))
    (blocked,) = followed((0.0, 0.5), (0.9, 0.5)).blocked
    assert (blocked.obstruction, set(blocked.contacts)) == (Obstruction.CONTACT, {("l2", "wall")})
    assert (blocked.pose, blocked.last) == (pytest.approx(0.4 / 0.9, abs=0.03), pytest.approx(0.6 / 0.9, abs=0.03))


GANTRY = """<robot name="gantry"><link name="l0"/>
<link name="l1"/><joint name="x" type="prismatic"><parent link="l0"/><child link="l1"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<link name="l2"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="y" type="prismatic"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


def test_a_start_outside_the_limits_is_blocked_there(free):
    plan = pp.follow(free, ToolPath.through(LINE, UP, speed=0.1), start=np.full(6, 9.0))
    assert (plan.blocked[0].obstruction, plan.blocked[0].pose) == (Obstruction.LIMIT, -1.0)


def test_the_tool_stops_at_sharp_corners_whose_roundings_cannot_be_timed(monkeypatch):
    checker, path, settings = random_problem("puma560", np.random.default_rng(32))
    timed, failures = following.timed_along, iter([pp.errors.TimingError("bends too sharply")])

    def fails_once(*curves):
        for error in failures:
            raise error
        return timed(*curves)

    monkeypatch.setattr(following, "timed_along", fails_once)
    plan = pp.follow(checker, path, **settings).or_raise()
    assert wrong(plan, settings) == []
    speed = np.linalg.norm(plan.trajectory.velocity(np.array(plan.trajectory.times)), axis=1)
    assert (speed < 1e-9).sum() > 2


def on_rail():
    """A UR5 on a rail along its y axis."""
    arm = arm_of("ur5")
    rail = (
        '<link name="rail"/><joint name="rail" type="prismatic"><parent link="rail"/><child link="world"/>'
        '<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" velocity="1" effort="1"/></joint></robot>'
    )
    return pp.load_robot(arm.robot.urdf.text.replace("</robot>", rail)).arm(tcp=arm.tcp)


def test_an_arm_on_a_rail_follows_a_path_longer_than_its_reach():
    line = np.column_stack([np.full(9, 0.5), np.linspace(-1.4, 1.4, 9), np.full(9, 0.2)])
    path = ToolPath.through(line, UP, speed=0.3)
    plan = pp.follow(pp.CollisionChecker(on_rail()), path, rotations=6, redundant=12, step=0.1).or_raise()
    assert wrong(plan, CHECKED) == []
    assert np.ptp(plan.pieces[0].q[:, 0]) > 0.8


def test_a_joint_stays_within_a_fifth_of_its_stated_values_between_the_poses_too():
    zigzag = np.column_stack([0.61 + 0.15 * (np.arange(6) % 2), 0.25 + np.linspace(0.0, 0.19, 6), np.full(6, 0.2)])
    path, settings = ToolPath.through(zigzag, UP, speed=0.3), {"redundant": {"rail": [0.0]}, "deviation": 2e-4}
    plan = pp.follow(pp.CollisionChecker(on_rail()), path, rotations=6, **settings).or_raise()
    assert wrong(plan, CHECKED | settings) == []
    rail = np.abs(plan.trajectory(np.linspace(0.0, plan.duration, 3000))[:, 0]).max()
    assert 0.19 < rail < 0.2 + 1e-6
    # From a start farther outside, the first step is a jump
    far = pp.follow(plan.checker, path, rotations=6, start=[0.3, *plan.pieces[0].q[0][1:]], **settings)
    assert (far.status, far.blocked[0].obstruction) == (FollowStatus.BLOCKED, Obstruction.JUMP)


FIVE = """<link name="burner"/><joint name="burner" type="fixed"><parent link="wrist_2_link"/><child link="burner"/>
<origin xyz="0 0.05 0.15" rpy="0.4 0.9 0"/></joint></robot>"""


@pytest.fixture(scope="module")
def five():
    """A UR5 whose tool is on the fifth link, so that each pose of its axis has one rotation in each branch."""
    robot = pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", FIVE))
    return pp.CollisionChecker(robot.arm("burner"))


def turned_path(arm, count=9):
    """A path that the arm can follow, whose poses are rotated about the axis of the tool."""
    shares = np.linspace(0.0, 1.0, count)[:, None]
    q = np.array([0.2, -1.4, 1.7, -1.0, -0.9]) + shares * np.array([0.4, 0.15, -0.2, 0.1, 0.3])
    turns = [pp.pose((0, 0, 0), (0, 0, angle)).homogeneous for angle in np.linspace(0.3, 2.0, count)]
    return ToolPath(arm.forward_kinematics_batch(q) @ np.array(turns), 0.1)


def test_an_arm_that_cannot_choose_the_rotation_of_the_tool_finds_the_one_of_each_branch(five):
    path = turned_path(five.arm)
    plan = pp.follow(five, path).or_raise()
    assert wrong(plan, CHECKED) == []
    # All solutions are known, so that poses out of reach are proven to be at any rotation
    far = pp.follow(five, replace(path, poses=pp.pose((0, 0, 1.0)).homogeneous @ path.poses))
    assert far.blocked[0].proven
    assert "at all rotations" in far.message
    assert pp.follow(five, path, free_rotation=(-2.05, -0.25)).ok
    assert not pp.follow(five, path, free_rotation=(-0.1, 0.2)).ok


@pytest.mark.parametrize("roll", [np.pi / 2, 1.5708])
def test_an_arm_that_rolls_its_tool_chooses_the_rotation_whatever_digits_its_tip_has(roll):
    robot = pp.load_robot("so100")
    tip = pp.pose((0.0, -0.09, 0.0), (roll, 0.0, 0.0)).homogeneous
    arm = replace(robot, urdf=with_frame(robot.urdf, "tip", robot.arm().tcp, tip)).arm("tip")
    low, high = arm.limits.lower, arm.limits.upper
    q = np.random.default_rng(0).uniform(low + 0.2 * (high - low), high - 0.2 * (high - low), (8000, arm.dof))
    tips = arm.forward_kinematics_batch(q)
    for point in tips[tips[:, 2, 2] < -0.9995][:4, :3, 3]:
        inwards = 0.01 * np.array([*point[:2], 0.0]) / np.linalg.norm(point[:2])
        path = ToolPath.through([point, point - inwards], UP, speed=0.02)
        for free_rotation in (True, (0.0, 0.5)):
            plan = pp.follow(pp.CollisionChecker(arm), path, rotations=12, free_rotation=free_rotation).or_raise()
            assert wrong(plan, CHECKED | {"free_rotation": free_rotation}) == []


@pytest.mark.parametrize("free_rotation", [(0.0, 0.0), (0.0, 0.5), (-0.5, 0.0)])
def test_a_range_of_the_rotation_includes_its_ends(five, free_rotation):
    rng = np.random.default_rng(0)
    for q in [q for q in rng.uniform(-2.0, 2.0, (12, 5)) if five.is_free(q)]:
        one = ToolPath(five.arm.forward_kinematics(q).homogeneous[None])
        assert pp.follow(five, one, free_rotation=free_rotation).ok


GEARED = """<link name="{0}"/><joint name="{0}" type="revolute"><parent link="{1}"/><child link="{0}"/>
<axis xyz="0 0 1"/><limit lower="-9" upper="9" velocity="9" effort="1"/><mimic joint="{2}" multiplier="2"/></joint>"""


def test_the_range_of_the_rotation_counts_the_followers_of_a_joint():
    """Between two points in the range, the last joint moves by less than the margin, the tool by five times that."""
    gears = "".join(GEARED.format(*names, "wrist_3_joint") for names in (("gear", "tool0"), ("spindle", "gear")))
    arm = pp.load_robot(pp.load_robot("ur5").urdf.text.replace("</robot>", gears + "</robot>")).arm("spindle")
    q, bulge = np.array([0.2, -1.4, 1.7, -1.0, -0.9, 0.1]), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.2])
    curve = CubicPath(np.array([q, q]), np.array([bulge, -bulge]), np.array([0.0, 1.0]), arm.joint_names)
    here, middle = (arm.forward_kinematics(each) for each in (q, curve(np.array([0.5]))[0]))
    turned = np.arccos(np.clip(0.5 * (np.trace(here.rotation.T @ middle.rotation) - 1.0), -1.0, 1.0))
    route = Route.straight(here, here * pp.pose((0, 0, 1e-9)))
    for margin, leaves in ((0.5 * turned, True), (2.5 * turned, False)):
        maker = CurveMaker(arm, SPIN, 1e-3, margin, (0.0, 0.0), SPIN)
        assert maker._spins(curve, route).tolist() == [leaves]
