"""RRT-Connect: certified answers, honest failures, and what a joint alone cannot pass."""

import importlib
import re

import numpy as np
import pytest
import trimesh

import pinproof as pp
from pinproof import _core
from pinproof.model import load_robot
from pinproof.planning import Edges, PlanStatus, find_barriers, with_turns

from .arms import assert_free, assert_solves, ball_arm

QUICK = pp.RrtConnect(max_nodes=4000, time_limit=600.0)
FEW = pp.RrtConnect(max_nodes=100, max_samples=500, time_limit=600.0)
START, GOAL = np.array([-0.8, -0.8]), np.array([0.8, -0.8])


def box(name, sides, x, y, z=0.0):
    return pp.Obstacle(name, pp.Box(*sides), pp.pose((x, y, z)))


def checker_of(arm, *obstacles, **settings):
    return pp.CollisionChecker(arm, pp.Scene(obstacles), **settings)


def test_ur5_goes_round_a_post(ur5):
    obstacles = box("table", (1.2, 1.6, 0.04), 0.4, 0.0, -0.03), box("post", (0.1, 0.1, 1.4), 0.5, 0.0, 0.6)
    checker = pp.CollisionChecker(ur5, pp.Scene(obstacles, allowed=[("base_link", "table")]), margin=0.002)
    start, goal = np.array([-0.9, -1.2, 1.2, -1.5, -1.57, 0.0]), np.array([0.9, -1.2, 1.2, -1.5, -1.57, 0.0])
    assert not checker.is_free((start + goal) / 2)  # the straight line is blocked
    assert_solves(QUICK.plan(checker, start, goal, rng=1), checker, start, goal)


def test_panda_between_two_posts(panda):
    checker = checker_of(
        panda, *(box(f"post{y}", (0.08, 0.08, 1.0), 0.25, y, 0.5) for y in (-0.25, 0.25)), margin=0.002
    )
    start, goal = panda.home.copy(), panda.home.copy()
    start[0], goal[0] = -1.3, 1.3
    assert not Edges(checker, 0.02, np.array([start, goal])).samples_free(start, goal)
    assert_solves(QUICK.plan(checker, start, goal, rng=0), checker, start, goal)


@pytest.mark.parametrize("seed", range(3))
def test_generic_arm_over_a_wall(generic, seed):
    checker = checker_of(generic, box("wall", (0.8, 0.02, 0.25), 0.6, 0.0, 0.125))
    start, goal = (
        next(q for q in pp.Clik().solve_many(generic, pp.pose((0.45, y, 0.15), (np.pi, 0, 0))).q if checker.is_free(q))
        for y in (-0.25, 0.25)
    )
    assert_solves(QUICK.plan(checker, start, goal, rng=seed), checker, start, goal)


def test_through_a_narrow_slot_by_the_same_path_for_the_same_seed(slot):
    plan = QUICK.plan(slot, START, GOAL, rng=2)
    assert_solves(plan, slot, START, GOAL)
    crossing = plan.path(np.linspace(*plan.path.domain, 5000))
    at_wall = crossing[np.abs(crossing[:, 0]) < 0.01, 1]
    assert len(at_wall)
    assert (np.abs(at_wall - 0.6) < 0.01).all()
    assert plan.samples > 0
    assert (plan.gap, plan.checker is slot, plan.contacts) == (0.0, True, ())
    plans = [QUICK.plan(slot, START, GOAL, rng=rng) for rng in (2, np.random.default_rng(2), 8)]
    for same in plans[:2]:  # a generator gives the path of its seed
        assert same.path.q.tobytes() == plan.path.q.tobytes()
        assert same.certificate.curve == plan.certificate.curve
    assert plans[2].path.q.tobytes() != plan.path.q.tobytes()


# -- how close the search comes to obstacles ---------------------------------------------------------------------------


def test_a_tree_grows_by_partial_steps(gantry):
    # Two boxes with 6 cm of space on every side of the ball, and no path from one to the other.
    walls = [
        box(f"wall{cell:+}{i}", (0.4 if y else 0.1, 0.4 if x else 0.1, 1.0), cell + x, y)
        for cell in (-0.5, 0.5)
        for i, (x, y) in enumerate(((-0.16, 0.0), (0.16, 0.0), (0.0, -0.16), (0.0, 0.16)))
    ]
    planner = pp.RrtConnect(step=0.25, max_samples=300, time_limit=600.0)
    plan = planner.plan(checker_of(gantry, *walls), (-0.5, 0.0), (0.5, 0.0))
    reached = re.search(r"x stayed in \[(.*), (.*)\] from the start and in \[(.*), (.*)\] from the goal", plan.message)
    for cell, low, high in ((-0.5, reached[1], reached[2]), (0.5, reached[3], reached[4])):
        assert 0.03 <= cell - float(low) <= 0.0601
        assert 0.03 <= float(high) - cell <= 0.0601


def test_the_search_keeps_off_the_margin_so_that_proofs_succeed(gantry):
    checker = checker_of(gantry, box("wall", (0.2, 0.2, 1.0), 0.0, 0.0), margin=0.005)
    for beyond, samples_free in ((3e-4, False), (1e-3, True)):
        y = 0.1 + 0.05 + checker.margin + beyond
        edges = Edges(checker, 0.01, np.array([[-0.9, -0.9]]))
        assert edges.samples_free(np.array([-0.9, y]), np.array([0.9, y])) is samples_free


HALF = 0.05 + 0.005 + 0.0002  # the ball, the margin, and less beyond it than the search keeps elsewhere


@pytest.mark.parametrize(
    ("planner", "walls", "start", "goal"),
    [
        # over the whole path
        (
            pp.RrtConnect(max_samples=100),
            [box(f"w{s}", (2.4, 0.1, 1.0), 0.0, s * (HALF + 0.05)) for s in (-1, 1)], (-0.5, 0.0), (0.5, 0.0),
        ),
        # at the ends
        (QUICK, [box("wall", (0.02, 1.2, 1.0), 0.0, -0.4)], (-0.01 - HALF, -0.5), (0.01 + HALF, -0.5)),
        # a passage narrower than the preferred clearance, with 1 mm beyond the margin on both sides
        (
            pp.RrtConnect(time_limit=600.0),
            [box(f"w{s}", (0.2, 1.0, 1.0), 0.0, s * (0.056 + 0.5)) for s in (-1, 1)], (-0.9, 0.0), (0.9, 0.0),
        ),
    ],
)  # fmt: skip
def test_tight_ends_and_passages_are_left_and_entered(gantry, planner, walls, start, goal):
    checker = checker_of(gantry, *walls, margin=0.005)
    plan = planner.plan(checker, start, goal, rng=0)
    assert_solves(plan, checker, np.array(start), np.array(goal))
    assert_free(plan.path, checker, step=0.002)
    if start[0] == -0.9:
        assert not pp.RrtConnect(max_samples=50, time_limit=600.0).plan(checker, start, goal, rng=0).ok


def test_an_edge_with_free_samples_that_fails_the_proof_is_removed(gantry):
    # A plate of 2 mm across all but a slot; at this resolution samples step over it.
    plates = box("below", (0.002, 1.4, 1.0), 0.013, -0.5), box("above", (0.002, 0.4, 1.0), 0.013, 0.8)
    checker, start, goal = checker_of(gantry, *plates), np.array([-0.9, -0.5]), np.array([0.9, -0.5])
    assert Edges(checker, 0.6, np.array([start, goal])).samples_free(start, goal)
    plan = pp.RrtConnect(resolution=0.6, max_nodes=4000, time_limit=600.0).plan(checker, start, goal, rng=0)
    assert plan.cut >= 1
    assert_solves(plan, checker, start, goal)
    whole = checker_of(gantry, box("plate", (0.002, 3.0, 1.0), 0.013, 0.0))
    plan = pp.RrtConnect(resolution=0.6, max_nodes=150, time_limit=600.0).plan(whole, (-0.9, 0.0), (0.9, 0.0))
    assert plan.status is PlanStatus.OUT_OF_BUDGET
    assert plan.cut >= 1
    assert (f"{plan.cut} edges failed the proof" in plan.message, "plate" in plan.message) == (True, True)


@pytest.mark.parametrize("resolution", [0.05, 0.5])
def test_meshes_that_only_coal_can_judge(gantry, resolution):
    # The slotted wall as one closed mesh: with 0.5 m between looks some edges that look free are not.
    spans = ((-1.2, 0.54), (0.66, 1.2))
    parts = [trimesh.creation.box(bounds=[(-0.01, low, -0.5), (0.01, high, 0.5)]) for low, high in spans]
    both = trimesh.util.concatenate(parts)
    wall = pp.Obstacle("wall", pp.Mesh.from_arrays(both.vertices, both.faces, hull=False))
    checker = checker_of(gantry, wall, margin=0.005)
    assert not checker.convex.all()
    planner = pp.RrtConnect(resolution=resolution, time_limit=600.0)
    plan, again = (planner.plan(checker, START, GOAL, rng=1).or_raise() for _ in range(2))
    assert_free(plan.path, checker)
    assert plan.path.q.tobytes() == again.path.q.tobytes()


# -- ends and goals ----------------------------------------------------------------------------------------------------


def test_start_is_goal(gantry, slotted):
    plan = QUICK.plan(pp.CollisionChecker(gantry, slotted), (0.5, 0.5), (0.5, 0.5))
    assert (plan.ok, plan.certificate.free, plan.path.q.tolist()) == (True, True, [[0.5, 0.5]])


@pytest.mark.parametrize(
    ("start", "goals", "status", "words", "contacts"),
    [
        ((0.03, 0.0), (0.5, 0.5), "START_INVALID", ["below", "l2"], ["below"]),
        ((0.5, 1.5), (0.5, 0.5), "START_INVALID", ["y = 1.5", "[-1, 1]"], []),
        ((0.5, 1 + 1e-8), (0.5, 0.5), "START_INVALID", ["y = 1.00000001 is outside"], []),
        ((0.5, 0.5), [(0.0, 0.9), (2.0, 0.0)], "GOAL_INVALID", ["goal 0", "above", "goal 1", "x = 2"], ["above"]),
        ((0.5, 0.5), [(0.03, 0.0), (0.03, 0.9), (0.5, 2.0)], "GOAL_INVALID", ["goal 2"], ["below", "above"]),
    ],
)
def test_ends_in_contact_or_outside_limits_are_named(gantry, slotted, start, goals, status, words, contacts):
    plan = QUICK.plan(pp.CollisionChecker(gantry, slotted), start, goals)
    assert (plan.status.name, plan.ok, plan.nodes, plan.cut, plan.samples) == (status, False, 0, 0, 0)
    assert [contact.bodies for contact in plan.contacts] == [("l2", name) for name in contacts]
    assert np.isnan(plan.gap)
    assert [word for word in words if word not in plan.message] == []
    with pytest.raises(pp.errors.PlanFailed, match=re.escape(words[0])) as caught:
        plan.or_raise()
    assert caught.value.result is plan


def test_ends_within_rounding_of_a_limit_are_taken_as_the_limit(gantry):
    plan = QUICK.plan(pp.CollisionChecker(gantry), (0.5, 1 + 5e-10), (0.0, -1 - 5e-10)).or_raise()
    assert plan.path.q[[0, -1]].tolist() == [[0.5, 1.0], [0.0, -1.0]]


WALLED = [box("along_y", (0.02, 1.2, 1.0), 0.0, 0.6), box("along_x", (1.2, 0.02, 1.0), 0.6, 0.0)]
"""The quadrant x, y > 0 is closed off by two walls."""


def test_of_several_goals_the_valid_and_reachable_one_is_reached(gantry, slotted):
    for checker, start, goals in (
        (pp.CollisionChecker(gantry, slotted), START, [(0.0, 0.9), (2.0, 0.0), GOAL]),
        (checker_of(gantry, *WALLED), np.array([-0.3, 0.8]), [(0.3, 0.3), (0.6, 0.6), GOAL]),  # two nearer, walled in
    ):
        plan = QUICK.plan(checker, start, goals)
        assert plan.goal == 2
        assert_solves(plan, checker, start, GOAL)


@pytest.mark.parametrize(
    ("settings", "spent"),
    [
        ({"max_nodes": 300, "time_limit": 600.0}, "max_nodes = 300"),
        ({"max_samples": 50, "time_limit": 600.0}, "max_samples = 50"),
        ({"time_limit": 1e-9}, "time_limit = 1e-09 s"),
    ],
)
def test_an_exhausted_budget_is_reported(gantry, settings, spent):
    plan = pp.RrtConnect(**settings).plan(checker_of(gantry, *WALLED), (-0.5, 0.5), (0.5, 0.5))
    assert (plan.status, plan.ok, spent in plan.message) == (PlanStatus.OUT_OF_BUDGET, False, True)
    assert plan.nodes >= 2


def test_trees_that_cannot_grow_end_too(gantry):
    # Both ends sit in holes hardly larger than the ball: hardly a node is ever added.
    walls = [
        box(f"{dx}{dy}{x:+}", (0.1, 0.3, 1.0) if dx else (0.3, 0.1, 1.0), x + dx, dy)
        for x in (-0.5, 0.5)
        for dx, dy in ((-0.101, 0.0), (0.101, 0.0), (0.0, -0.101), (0.0, 0.101))
    ]
    planner = pp.RrtConnect(max_samples=500, time_limit=600.0)
    plan = planner.plan(checker_of(gantry, *walls), (-0.5, 0.0), (0.5, 0.0))
    assert (plan.status, "max_samples" in plan.message) == (PlanStatus.OUT_OF_BUDGET, True)
    assert "x stayed in" in plan.message  # the joint in which the trees never met


@pytest.mark.parametrize(
    ("start", "goals", "words"),
    [
        ((0.0,), (0.5, 0.5), "start"),
        ((0.5, 0.5), [], "goals is empty"),
        *(((0.5, 0.5), goals, "goals") for goals in ((0.5, 0.5, 0.5), [(0.5, np.nan)], [(0.5, 0.5), (0.5,)])),
    ],
)
def test_arguments_that_make_no_sense(gantry, start, goals, words):
    with pytest.raises(pp.InputError, match=words):
        QUICK.plan(pp.CollisionChecker(gantry), start, goals)


@pytest.mark.parametrize("name", ["step", "resolution", "max_nodes", "max_samples", "time_limit"])
def test_settings_that_make_no_sense(name):
    with pytest.raises(pp.InputError, match=name):
        pp.RrtConnect(**{name: 0})


# -- continuous joints -------------------------------------------------------------------------------------------------


def test_prismatic_and_continuous_joints_together():
    checker = checker_of(ball_arm(("x", "turn")), box("post", (0.2, 0.2, 1.0), 0.0, 1.0))
    start, goal = np.array([0.0, 0.0]), np.array([0.0, np.pi])
    assert_solves(QUICK.plan(checker, start, goal, rng=0), checker, start, goal)


def test_a_continuous_joint_is_not_wrapped_and_takes_the_shorter_direction_with_rotations(turntable):
    checker = pp.CollisionChecker(turntable)
    assert QUICK.plan(checker, [0.1], [2 * np.pi - 0.1]).path.q.ravel().tolist() == [0.1, 2 * np.pi - 0.1]
    plan = QUICK.plan(checker, [0.1], [2 * np.pi - 0.1], turns=True)
    assert plan.goal == 0
    assert plan.path.end[0] == pytest.approx(-0.1, abs=1e-12)


def test_rotations_reach_a_goal_behind_a_wall_and_are_suggested_unless_all_are_goals(turntable):
    posts = [box(f"post_{y}", (0.2, 0.2, 1.0), 0.0, y) for y in (1.0, -1.0)]  # at a quarter turn
    checker = checker_of(turntable, posts[0])
    plan = FEW.plan(checker, [0.0], [3.0], turns=True)
    assert plan.path.end[0] == pytest.approx(3.0 - 2 * np.pi, abs=1e-12)
    assert_free(plan.path, checker)
    both = checker_of(turntable, *posts)
    for checks, goals, suggested in ((checker, [3.0], True), (both, [[3.0], [3.0 - 2 * np.pi]], False)):
        plan = FEW.plan(checks, [0.0], goals)
        assert (plan.status, "turns=True" in plan.message) == (PlanStatus.IMPOSSIBLE, suggested)


def test_shifts_by_2_pi_stay_within_the_limits(ur5):
    goal = np.array([3.0, -1.5, 1.0, -5.0, 1.0, 6.0])
    many, index_of = with_turns(ur5, ur5.home, goal[None])
    assert np.array_equal(many[0], goal)
    assert len(many) == 2**5  # every joint but the elbow has two angles inside +-2 pi
    assert set(index_of) == {0}
    assert all(ur5.limits.contains(q) for q in many)
    poses = ur5.forward_kinematics_batch(many)
    assert np.abs(poses - ur5.forward_kinematics(goal).homogeneous).max() < 1e-12


def test_configurations_that_gravity_does_not_permit_are_avoided(ur5):
    """The straight segment stretches the arm horizontally, which a load of 15 kg does not permit."""
    checker, planner, joint = pp.CollisionChecker(ur5, pp.Scene()), pp.RrtConnect(), "shoulder_lift_joint"
    torques = pp.motion.TorqueLimits(ur5, pp.model.Payload(15.0))
    ends = np.array([[0, -0.4, 2.4, -1.6, -1.57, 0], [0, -0.4, -2.0, 1.6, -1.57, 0]])
    stretched = ends.mean(axis=0)
    assert joint in torques.standstill(stretched)
    direct = planner.plan(checker, *ends, rng=0).or_raise()
    with pytest.raises(pp.errors.TimingError, match=joint):
        pp.time_parametrise(direct.path, ur5.limits, rate_limits=[torques])
    plan = planner.plan(checker, *ends, torque_limits=torques, rng=0).or_raise()
    path = pp.simplify(plan.path, checker, torque_limits=torques).path
    assert torques.standstill_share(path(np.linspace(*path.domain, 2000))) <= 1.0
    assert pp.time_parametrise(path, ur5.limits, rate_limits=[torques]).duration > 0
    refused = planner.plan(checker, ends[0], stretched, torque_limits=torques)
    assert (refused.status, joint in refused.message) == (PlanStatus.GOAL_INVALID, True)
    assert planner.plan(checker, stretched, ends[0], torque_limits=torques).status is PlanStatus.START_INVALID


# -- the trees: nearest nodes, branches, and what a cut takes away -----------------------------------------------------


def tree_search(arm, start, goals):
    edges = Edges(pp.CollisionChecker(arm), 0.1, start[None])
    low, high = [-9.0] * arm.dof, [9.0] * arm.dof
    return _core.RrtSearch(edges.core, start, goals, np.array([low, high]), step=0.7, max_nodes=1000, max_samples=1000)


def test_a_cut_removes_the_subtree_and_nothing_else(gantry):
    search = tree_search(gantry, np.array([5.0, 5.0]), np.array([[0.0, 0.0], [10.0, 0.0]]))
    a = search.add(1, np.array([1.0, 0.0]), 0)
    b = search.add(1, np.array([2.0, 0.0]), a)
    c = search.add(1, np.array([0.0, 1.0]), 0)
    d = search.add(1, np.array([3.0, 0.0]), b)
    assert search.branch(1, d) == [d, b, a, 0]
    search.cut(1, a)
    assert sorted(map(tuple, search.nodes(1))) == [(0.0, 0.0), (0.0, 1.0), (10.0, 0.0)]
    assert search.nodes(0).tolist() == [[5.0, 5.0]]
    assert [search.nearest(1, np.array(q)) for q in ([3.0, 0.1], [0.1, 2.0])] == [0, c]
    assert search.size(0) + search.size(1) == 7  # what was ever added: cutting gives no budget back


def test_nearest_is_the_nearest_of_all(ur5):
    rng = np.random.default_rng(0)
    search = tree_search(ur5, np.zeros(6), rng.uniform(-1, 1, (1, 6)))
    for _ in range(600):
        search.add(1, rng.uniform(-1, 1, 6), search.size(1) - 1)
    for target in rng.uniform(-1, 1, (20, 6)):
        assert search.nearest(1, target) == np.linalg.norm(search.nodes(1) - target, axis=1).argmin()


# -- goals that a joint cannot reach, because bodies that it alone moves cannot pass an obstacle -----------------------

BUDGET = pp.RrtConnect(max_nodes=300, max_samples=600, time_limit=600.0)
LOW, HIGH = np.array([0.0, 0.0, 0.0]), np.array([0.5, 0.4, -0.4])


def lift(rack):
    """A lift (z) with a rack, which no other joint moves, and an arm of two revolute joints with a ball at its end."""
    geometry = {
        "base": "",
        "carriage": f'<collision><origin xyz="0 0.6 0"/><geometry>{rack}</geometry></collision>',
        "upper": "",
        "hand": '<collision><origin xyz="0.3 0 0"/><geometry><sphere radius="0.03"/></geometry></collision>',
        "tip": "",
    }
    joints = [
        ("z", "prismatic", "base", "carriage", "0 0 0", "0 0 1"),
        ("one", "revolute", "carriage", "upper", "0 0 0", "0 0 1"),
        ("two", "revolute", "upper", "hand", "0.3 0 0", "0 0 1"),
        ("end", "fixed", "hand", "tip", "0.3 0 0", "0 0 1"),
    ]
    text = "".join(f'<link name="{name}">{inner}</link>' for name, inner in geometry.items())
    text += "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
        for name, kind, parent, child, at, axis in joints
    )
    return load_robot(f'<robot name="lift">{text}</robot>').arm(tcp="tip")


RACK = lift('<box size="0.2 0.2 0.05"/>')
BOARD, ROD = box("board", (0.4, 0.4, 0.02), 0, 0.6, 0.25), box("board", (0.05, 0.05, 0.02), 0, 0.6, 0.25)
POST = box("post", (0.1, 0.1, 0.1), 0.6, 0, 0.25)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_rack_that_cannot_pass_a_board_makes_the_plan_impossible(direction):
    checker, ends = checker_of(RACK, BOARD, margin=0.001), [LOW, HIGH][::direction]
    plan = BUDGET.plan(checker, *ends)
    assert (plan.status, plan.ok) == (PlanStatus.IMPOSSIBLE, False)
    assert ("z cannot pass 0.2" in plan.message, "carriage penetrates board" in plan.message) == (True, True)
    assert plan.gap > 0
    far = BUDGET.plan(checker, ends[0], [ends[1], ends[1] + [0.1 * direction, 0, 0]])
    assert far.status is PlanStatus.IMPOSSIBLE
    long = pp.RrtConnect(time_limit=600.0).plan(checker, *ends)  # it ends with the proof, not with its budget
    assert long.status is PlanStatus.IMPOSSIBLE
    assert long.samples < pp.RrtConnect().max_samples / 4


def test_what_other_joints_avoid_or_a_goal_does_not_need_is_no_barrier():
    plan = BUDGET.plan(checker_of(RACK, BOARD, margin=0.001), LOW, [HIGH, [0.2, 0.4, -0.4]])
    assert (plan.ok, plan.goal) == (True, 1)
    checker = checker_of(RACK, POST, margin=0.001)
    assert not checker.is_free([0.25, 0, 0])
    assert find_barriers(checker, LOW, np.array([[0.5, 0, 0]])) == ()
    assert BUDGET.plan(checker, LOW, [0.5, 0, 0]).ok


def test_a_contact_of_the_hull_alone_proves_nothing(tmp_path):
    """A rod passes between the two bars of the rack, which its hull joins; a wide board does not."""
    bars = [trimesh.creation.box(bounds=[(x - 0.02, -0.1, -0.02), (x + 0.02, 0.1, 0.02)]) for x in (-0.08, 0.08)]
    trimesh.util.concatenate(bars).export(tmp_path / "rack.stl")
    rack, at = lift(f'<mesh filename="{tmp_path / "rack.stl"}"/>'), np.array([0.25, 0, 0])
    checker = checker_of(rack, ROD, margin=0.001)
    assert not checker.is_free(at)
    assert BUDGET.plan(checker, LOW, HIGH).status is PlanStatus.OUT_OF_BUDGET
    wide = checker_of(rack, box("board", (0.4, 0.05, 0.02), 0, 0.6, 0.25), margin=0.001)
    assert BUDGET.plan(wide, LOW, HIGH).status is PlanStatus.IMPOSSIBLE
    # Where the hull of the rack is in contact, the hand at its start is in a post, which it can pass elsewhere.
    checker = checker_of(rack, ROD, POST, margin=0.001)
    assert {contact.bodies for contact in checker.check(at).contacts} == {("carriage", "board"), ("hand", "post")}
    assert {contact.bodies for contact in checker.exact_at(at).check(at).contacts} == {("hand", "post")}
    assert find_barriers(checker, LOW, np.array([[0.5, 0, 0], HIGH])) == ()


def test_a_goal_that_is_free_with_finer_bodies_is_reachable_although_another_one_is_behind_a_barrier(tmp_path):
    bars = [trimesh.creation.box(bounds=[(x - 0.02, -0.1, -0.02), (x + 0.02, 0.1, 0.02)]) for x in (-0.08, 0.08)]
    trimesh.util.concatenate(bars).export(tmp_path / "rack.stl")
    rack, at = lift(f'<mesh filename="{tmp_path / "rack.stl"}"/>'), np.array([0.25, 0, 0])
    checker = checker_of(rack, ROD, box("wide", (0.4, 0.05, 0.02), 0, 0.6, 0.4), margin=0.001)
    assert not checker.is_free(at)
    assert checker.finer_at(at).is_free(at)
    assert BUDGET.plan(checker, LOW, HIGH).status is PlanStatus.IMPOSSIBLE
    assert BUDGET.plan(checker, LOW, [HIGH, at]).status is PlanStatus.OUT_OF_BUDGET


def test_a_certificate_is_made_when_it_is_read_and_no_path_is_found_that_is_not_proven(ur5, monkeypatch):
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose((0.55, 0.0, 0.5)))
    checker = pp.CollisionChecker(ur5, pp.Scene([post]))
    start, goal = [-1.0, -1.2, 1.2, -1.57, -1.57, 0.0], [1.0, -1.2, 1.2, -1.57, -1.57, 0.0]
    for seed in range(20):
        plan = pp.RrtConnect().plan(checker, start, goal, rng=seed).or_raise()
        assert plan.certificate.free
        assert plan.certificate is plan.certificate
        assert plan.certificate.matches(plan.path, ur5, checker.scene)
    # Where the proof fails, the search continues until its budget ends
    home = importlib.import_module("pinproof.planning.rrt_connect")
    monkeypatch.setattr(home, "is_proven_free", lambda *_: False)
    monkeypatch.setattr(home, "certify", lambda path, *_, **__: pp.certify(path, blocked))
    blocked = checker.with_scene(pp.Scene([pp.Obstacle("ball", pp.Sphere(0.05), ur5.forward_kinematics(goal))]))
    assert not pp.RrtConnect().limited_to(200).plan(checker, start, goal).ok


# -- ends that touch by their hulls and not by their meshes are planned with finer bodies ------------------------------

HOLE = 0.15
THREADED, BESIDE = np.array([0.0, 0.0]), np.array([0.0, 0.6])


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """A ring about x (hole of 0.15 m) that slides along x and y: its hull has no hole."""
    torus = trimesh.creation.torus(HOLE + 0.05, 0.05, 24, 12)
    torus.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    file = tmp_path_factory.mktemp("ring") / "ring.stl"
    torus.export(file)
    return ball_arm(("x", "y"), geometry=f'<mesh filename="{file}"/>')


def peg(side):
    return box("peg", (0.3, side, side), 0, 0)


@pytest.mark.parametrize(("side", "by"), [(0.1, "several hulls"), (HOLE * np.sqrt(2) * 0.95, "exact meshes")])
def test_a_ring_is_taken_off_a_peg(ring, side, by):
    checker, exact = checker_of(ring, peg(side)), checker_of(ring, peg(side), link_meshes="mesh")
    assert not checker.is_free(THREADED)
    for start, goal in ((THREADED, BESIDE), (BESIDE, THREADED)):
        plan = QUICK.plan(checker, start, goal).or_raise()
        assert [pair.by for pair in plan.checker.finer] == [by]
        assert plan.certificate.free
        assert pp.certify(plan.path, plan.checker).free
        assert np.array_equal(plan.path.q[[0, -1]], [start, goal])
        along = plan.path(np.linspace(*plan.path.domain, 400))
        assert exact.is_free_batch(along).all()
        assert np.abs(along[:, 0]).max() > 0.2  # off the end of the peg


def test_a_pose_at_which_only_the_hulls_touch_is_reached(ring):
    motion = pp.plan(checker_of(ring, peg(0.1)), BESIDE, ring.forward_kinematics(THREADED), budget=5).or_raise()
    np.testing.assert_allclose(motion.trajectory.end, THREADED, atol=1e-6)
    assert [pair.by for pair in motion.checker.finer] == ["several hulls"]
    assert pp.certify(motion.trajectory, motion.checker).free


def test_finer_bodies_are_checked_only_if_the_hulls_do_not_suffice_and_a_real_contact_is_named(ring):
    checker = checker_of(ring, peg(0.1))
    plan = QUICK.plan(checker, BESIDE, [THREADED, -BESIDE]).or_raise()
    assert (plan.checker is checker, plan.goal) == (True, 1)
    thick = checker_of(ring, peg(0.3))
    plan = QUICK.plan(thick, THREADED, BESIDE)
    assert plan.status is PlanStatus.START_INVALID
    assert [contact.bodies for contact in plan.contacts] == [("l2", "peg")]
    plan = QUICK.plan(thick, BESIDE, [THREADED])
    assert (plan.status, "l2 penetrates peg" in plan.message) == (PlanStatus.GOAL_INVALID, True)
