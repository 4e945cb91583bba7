"""RRT-Connect: certified answers, honest failures."""

from __future__ import annotations

import re

import numpy as np
import pytest

import pinproof as pp
from pinproof import _core
from pinproof.planning import Edges

from .arms import assert_free, assert_solves, ball_arm

QUICK = pp.RrtConnect(max_nodes=4000, time_limit=600.0)

TABLE = pp.Obstacle("table", pp.Box(1.2, 1.6, 0.04), pp.pose((0.4, 0.0, -0.03)))


def test_ur5_goes_round_a_post(ur5: pp.Arm) -> None:
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.4), pp.pose((0.5, 0.0, 0.6)))
    checker = pp.CollisionChecker(ur5, pp.Scene([TABLE, post], allowed=[("base_link", "table")]), margin=0.002)
    start, goal = np.array([-0.9, -1.2, 1.2, -1.5, -1.57, 0.0]), np.array([0.9, -1.2, 1.2, -1.5, -1.57, 0.0])
    assert not checker.is_free((start + goal) / 2)  # the straight line is blocked
    assert_solves(QUICK.plan(checker, start, goal, rng=1), checker, start, goal)


def test_panda_between_two_posts(panda: pp.Arm) -> None:
    posts = [
        pp.Obstacle(f"post{i}", pp.Box(0.08, 0.08, 1.0), pp.pose((0.25, y, 0.5))) for i, y in enumerate((-0.25, 0.25))
    ]
    checker = pp.CollisionChecker(panda, pp.Scene(posts), margin=0.002)
    start, goal = panda.home.copy(), panda.home.copy()
    start[0], goal[0] = -1.3, 1.3
    assert not Edges(checker, 0.02, np.array([start, goal])).samples_free(start, goal)
    assert_solves(QUICK.plan(checker, start, goal, rng=0), checker, start, goal)


@pytest.mark.parametrize("seed", range(3))
def test_generic_arm_over_a_wall(generic: pp.Arm, seed: int) -> None:
    wall = pp.Obstacle("wall", pp.Box(0.8, 0.02, 0.25), pp.pose((0.6, 0.0, 0.125)))
    checker = pp.CollisionChecker(generic, pp.Scene([wall]))
    start, goal = (
        next(q for q in pp.Clik().solve_many(generic, pp.pose((0.45, y, 0.15), (np.pi, 0, 0))).q if checker.is_free(q))
        for y in (-0.25, 0.25)
    )
    assert_solves(QUICK.plan(checker, start, goal, rng=seed), checker, start, goal)


def test_through_a_narrow_slot(gantry: pp.Arm, slotted: pp.Scene) -> None:
    checker = pp.CollisionChecker(gantry, slotted, margin=0.005)
    start, goal = np.array([-0.8, -0.8]), np.array([0.8, -0.8])
    plan = QUICK.plan(checker, start, goal, rng=2)
    assert_solves(plan, checker, start, goal)
    crossing = plan.path(np.linspace(*plan.path.domain, 5000))
    at_wall = crossing[np.abs(crossing[:, 0]) < 0.01, 1]
    assert len(at_wall)
    assert (np.abs(at_wall - 0.6) < 0.01).all()


def test_a_tree_grows_by_partial_steps(gantry: pp.Arm) -> None:
    # Two boxes with 6 cm of space on every side of the ball, and no path from one to the other.
    walls = [
        pp.Obstacle(f"wall{cell:+}{i}", pp.Box(0.4 if y else 0.1, 0.4 if x else 0.1, 1.0), pp.pose((cell + x, y, 0.0)))
        for cell in (-0.5, 0.5)
        for i, (x, y) in enumerate(((-0.16, 0.0), (0.16, 0.0), (0.0, -0.16), (0.0, 0.16)))
    ]
    planner = pp.RrtConnect(step=0.25, max_samples=300, time_limit=600.0)
    plan = planner.plan(pp.CollisionChecker(gantry, pp.Scene(walls)), (-0.5, 0.0), (0.5, 0.0))
    reached = re.search(r"x stayed in \[(.*), (.*)\] from the start and in \[(.*), (.*)\] from the goal", plan.message)
    for cell, low, high in ((-0.5, reached[1], reached[2]), (0.5, reached[3], reached[4])):
        assert 0.03 <= cell - float(low) <= 0.0601
        assert 0.03 <= float(high) - cell <= 0.0601


def test_the_search_keeps_off_the_margin_so_that_proofs_succeed(gantry: pp.Arm) -> None:
    wall = pp.Obstacle("wall", pp.Box(0.2, 0.2, 1.0))
    checker = pp.CollisionChecker(gantry, pp.Scene([wall]), margin=0.005)
    for beyond, samples_free in ((3e-4, False), (1e-3, True)):
        y = 0.1 + 0.05 + checker.margin + beyond
        a, b = np.array([-0.9, y]), np.array([0.9, y])
        assert Edges(checker, 0.01, np.array([[-0.9, -0.9]])).samples_free(a, b) is samples_free


def test_between_ends_that_are_tight_themselves_it_keeps_off_less(gantry: pp.Arm) -> None:
    # 0.2 mm beyond the margin on both sides, over the whole path.
    half = 0.05 + 0.005 + 0.0002
    walls = [pp.Obstacle(f"w{s:+}", pp.Box(2.4, 0.1, 1.0), pp.pose((0.0, s * (half + 0.05), 0.0))) for s in (-1, 1)]
    checker = pp.CollisionChecker(gantry, pp.Scene(walls), margin=0.005)
    start, goal = np.array([-0.5, 0.0]), np.array([0.5, 0.0])
    assert_solves(pp.RrtConnect(max_samples=100).plan(checker, start, goal), checker, start, goal)


def test_same_rng_same_path_to_the_last_bit(gantry: pp.Arm, slotted: pp.Scene) -> None:
    start, goal = np.array([-0.8, -0.8]), np.array([0.8, -0.8])
    plans = [QUICK.plan(pp.CollisionChecker(gantry, slotted), start, goal, rng=seed) for seed in (7, 7, 8)]
    assert plans[0].path.q.tobytes() == plans[1].path.q.tobytes()
    assert plans[0].certificate.curve == plans[1].certificate.curve
    assert plans[0].path.q.tobytes() != plans[2].path.q.tobytes()


def test_a_generator_gives_the_same_path_as_its_seed(gantry: pp.Arm, slotted: pp.Scene) -> None:
    checker = pp.CollisionChecker(gantry, slotted)
    start, goal = np.array([-0.8, -0.8]), np.array([0.8, -0.8])
    one, other = (QUICK.plan(checker, start, goal, rng=rng) for rng in (5, np.random.default_rng(5)))
    assert np.array_equal(one.path.q, other.path.q)


def test_start_is_goal(gantry: pp.Arm, slotted: pp.Scene) -> None:
    plan = QUICK.plan(pp.CollisionChecker(gantry, slotted), (0.5, 0.5), (0.5, 0.5))
    assert plan.ok
    assert plan.certificate.free
    assert plan.path.q.tolist() == [[0.5, 0.5]]


def test_start_in_contact_is_named(gantry: pp.Arm, slotted: pp.Scene) -> None:
    plan = QUICK.plan(pp.CollisionChecker(gantry, slotted), (0.03, 0.0), (0.5, 0.5))
    assert plan.status is pp.planning.PlanStatus.START_INVALID
    assert (plan.nodes, plan.cut, plan.samples) == (0, 0, 0)
    assert "below" in plan.message
    assert "l2" in plan.message
    assert not plan.ok
    with pytest.raises(pp.errors.PlanFailed, match="below") as caught:
        plan.or_raise()
    assert caught.value.result is plan


def test_start_outside_limits_is_named(gantry: pp.Arm, slotted: pp.Scene) -> None:
    plan = QUICK.plan(pp.CollisionChecker(gantry, slotted), (0.5, 1.5), (0.5, 0.5))
    assert plan.status is pp.planning.PlanStatus.START_INVALID
    assert "y = 1.5" in plan.message
    assert "[-1, 1]" in plan.message


def test_ends_within_rounding_of_a_limit_are_taken_as_the_limit(gantry: pp.Arm) -> None:
    checker = pp.CollisionChecker(gantry)
    plan = QUICK.plan(checker, (0.5, 1 + 5e-10), (0.0, -1 - 5e-10)).or_raise()
    assert plan.path.q[0].tolist() == [0.5, 1.0]
    assert plan.path.q[-1].tolist() == [0.0, -1.0]
    refused = QUICK.plan(checker, (0.5, 1 + 1e-8), (0.0, 0.0))
    assert refused.status is pp.planning.PlanStatus.START_INVALID
    assert "y = 1.00000001 is outside" in refused.message


def test_every_refused_goal_is_named(gantry: pp.Arm, slotted: pp.Scene) -> None:
    plan = QUICK.plan(pp.CollisionChecker(gantry, slotted), (0.5, 0.5), [(0.0, 0.9), (2.0, 0.0)])
    assert plan.status is pp.planning.PlanStatus.GOAL_INVALID
    assert "goal 0" in plan.message
    assert "above" in plan.message
    assert "goal 1" in plan.message
    assert "x = 2" in plan.message


def test_of_several_goals_the_valid_one_is_reached(gantry: pp.Arm, slotted: pp.Scene) -> None:
    goals = np.array([(0.0, 0.9), (2.0, 0.0), (0.8, -0.8)])
    checker = pp.CollisionChecker(gantry, slotted)
    plan = QUICK.plan(checker, (-0.8, -0.8), goals)
    assert plan.goal == 2
    assert_solves(plan, checker, np.array([-0.8, -0.8]), goals[2])


def _cell(gantry: pp.Arm) -> pp.CollisionChecker:
    """The quadrant x, y > 0 closed off by two walls."""
    walls = [
        pp.Obstacle("along_y", pp.Box(0.02, 1.2, 1.0), pp.pose((0.0, 0.6, 0.0))),
        pp.Obstacle("along_x", pp.Box(1.2, 0.02, 1.0), pp.pose((0.6, 0.0, 0.0))),
    ]
    return pp.CollisionChecker(gantry, pp.Scene(walls))


def test_of_several_goals_the_reachable_one_is_reached(gantry: pp.Arm) -> None:
    goals = np.array([(0.3, 0.3), (0.6, 0.6), (0.8, -0.8)])  # the first two are nearer, and walled in
    checker = _cell(gantry)
    start = np.array([-0.3, 0.8])
    plan = QUICK.plan(checker, start, goals)
    assert plan.goal == 2
    assert_solves(plan, checker, start, goals[2])


@pytest.mark.parametrize(
    ("planner", "spent"),
    [
        (pp.RrtConnect(max_nodes=300, time_limit=600.0), "max_nodes = 300"),
        (pp.RrtConnect(max_samples=50, time_limit=600.0), "max_samples = 50"),
        (pp.RrtConnect(time_limit=1e-9), "time_limit = 1e-09 s"),
    ],
)
def test_an_exhausted_budget_is_reported(gantry: pp.Arm, planner: pp.RrtConnect, spent: str) -> None:
    plan = planner.plan(_cell(gantry), (-0.5, 0.5), (0.5, 0.5))
    assert plan.status is pp.planning.PlanStatus.OUT_OF_BUDGET
    assert not plan.ok
    assert spent in plan.message
    assert plan.nodes >= 2


def test_trees_that_cannot_grow_end_too(gantry: pp.Arm) -> None:
    # Both ends sit in holes hardly larger than the ball: hardly a node is ever added.
    walls = [
        pp.Obstacle(f"{side}{x:+}", box, pp.pose((x + dx, dy, 0.0)))
        for x in (-0.5, 0.5)
        for side, box, dx, dy in (
            ("left", pp.Box(0.1, 0.3, 1.0), -0.101, 0.0),
            ("right", pp.Box(0.1, 0.3, 1.0), 0.101, 0.0),
            ("near", pp.Box(0.3, 0.1, 1.0), 0.0, -0.101),
            ("far", pp.Box(0.3, 0.1, 1.0), 0.0, 0.101),
        )
    ]
    checker = pp.CollisionChecker(gantry, pp.Scene(walls))
    plan = pp.RrtConnect(max_samples=500, time_limit=600.0).plan(checker, (-0.5, 0.0), (0.5, 0.0))
    assert plan.status is pp.planning.PlanStatus.OUT_OF_BUDGET
    assert "max_samples" in plan.message
    assert "x stayed in" in plan.message  # the joint in which the trees never met


def test_an_edge_with_free_samples_that_fails_the_proof_is_removed(gantry: pp.Arm) -> None:
    # A plate of 2 mm across all but a slot; at this resolution samples step over it.
    plates = [
        pp.Obstacle("below", pp.Box(0.002, 1.4, 1.0), pp.pose((0.013, -0.5, 0.0))),
        pp.Obstacle("above", pp.Box(0.002, 0.4, 1.0), pp.pose((0.013, 0.8, 0.0))),
    ]
    checker = pp.CollisionChecker(gantry, pp.Scene(plates))
    start, goal = np.array([-0.9, -0.5]), np.array([0.9, -0.5])
    coarse = 0.6
    assert Edges(checker, coarse, np.array([start, goal])).samples_free(start, goal)
    plan = pp.RrtConnect(resolution=coarse, max_nodes=4000, time_limit=600.0).plan(checker, start, goal, rng=0)
    assert plan.cut >= 1
    assert_solves(plan, checker, start, goal)


def test_removed_edges_are_reported_if_no_path_is_found(gantry: pp.Arm) -> None:
    plate = pp.Obstacle("plate", pp.Box(0.002, 3.0, 1.0), pp.pose((0.013, 0.0, 0.0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([plate]))
    planner = pp.RrtConnect(resolution=0.6, max_nodes=150, time_limit=600.0)
    plan = planner.plan(checker, (-0.9, 0.0), (0.9, 0.0))
    assert plan.status is pp.planning.PlanStatus.OUT_OF_BUDGET
    assert plan.cut >= 1
    assert f"{plan.cut} edges failed the proof" in plan.message
    assert "plate" in plan.message


def test_ends_hardly_beyond_the_margin_are_left_and_entered(gantry: pp.Arm) -> None:
    # 0.2 mm beyond the margin, less than the search keeps elsewhere.
    wall = pp.Obstacle("wall", pp.Box(0.02, 1.2, 1.0), pp.pose((0.0, -0.4, 0.0)))
    checker = pp.CollisionChecker(gantry, pp.Scene([wall]), margin=0.005)
    start, goal = np.array([-0.0652, -0.5]), np.array([0.0652, -0.5])
    assert_solves(QUICK.plan(checker, start, goal, rng=0), checker, start, goal)


def test_prismatic_and_continuous_joints_together() -> None:
    arm = ball_arm(("x", "turn"))
    post = pp.Obstacle("post", pp.Box(0.2, 0.2, 1.0), pp.pose((0.0, 1.0, 0.0)))
    checker = pp.CollisionChecker(arm, pp.Scene([post]))
    start, goal = np.array([0.0, 0.0]), np.array([0.0, np.pi])
    assert_solves(QUICK.plan(checker, start, goal, rng=0), checker, start, goal)


def test_a_continuous_joint_is_not_wrapped(turntable: pp.Arm) -> None:
    checker = pp.CollisionChecker(turntable)
    plan = QUICK.plan(checker, [0.1], [2 * np.pi - 0.1])
    assert plan.path.q.ravel().tolist() == [0.1, 2 * np.pi - 0.1]


def test_with_rotations_a_continuous_joint_takes_the_shorter_direction(turntable: pp.Arm) -> None:
    checker = pp.CollisionChecker(turntable)
    plan = QUICK.plan(checker, [0.1], [2 * np.pi - 0.1], turns=True)
    assert plan.goal == 0
    assert plan.path.end[0] == pytest.approx(-0.1, abs=1e-12)


def test_with_rotations_a_goal_behind_a_wall_is_reached_in_the_other_direction(turntable: pp.Arm) -> None:
    post = pp.Obstacle("post", pp.Box(0.2, 0.2, 1.0), pp.pose((0.0, 1.0, 0.0)))  # at a quarter turn
    checker = pp.CollisionChecker(turntable, pp.Scene([post]))
    budget = pp.RrtConnect(max_nodes=100, max_samples=500, time_limit=600.0)
    without = budget.plan(checker, [0.0], [3.0])
    assert without.status is pp.planning.PlanStatus.IMPOSSIBLE
    assert "turns=True" in without.message
    plan = budget.plan(checker, [0.0], [3.0], turns=True)
    assert plan.path.end[0] == pytest.approx(3.0 - 2 * np.pi, abs=1e-12)
    assert_free(plan.path, checker)


def test_rotations_are_not_suggested_if_all_are_goals(turntable: pp.Arm) -> None:
    posts = [pp.Obstacle(f"post_{y}", pp.Box(0.2, 0.2, 1.0), pp.pose((0.0, y, 0.0))) for y in (1.0, -1.0)]
    checker = pp.CollisionChecker(turntable, pp.Scene(posts))
    budget = pp.RrtConnect(max_nodes=100, max_samples=500, time_limit=600.0)
    plan = budget.plan(checker, [0.0], [[3.0], [3.0 - 2 * np.pi]])
    assert plan.status is pp.planning.PlanStatus.IMPOSSIBLE
    assert "turns=True" not in plan.message


def test_shifts_by_2_pi_stay_within_the_limits(ur5: pp.Arm) -> None:
    goal = np.array([3.0, -1.5, 1.0, -5.0, 1.0, 6.0])
    from pinproof.planning import with_turns

    many, index_of = with_turns(ur5, ur5.home, goal[None])
    assert np.array_equal(many[0], goal)
    assert len(many) == 2**5  # every joint but the elbow has two angles inside +-2 pi
    assert set(index_of) == {0}
    pose = ur5.forward_kinematics(goal)
    for q in many:
        assert ur5.limits.contains(q)
        assert np.abs(ur5.forward_kinematics(q).homogeneous - pose.homogeneous).max() < 1e-12


@pytest.mark.parametrize(
    ("start", "goals", "words"),
    [
        ((0.0,), (0.5, 0.5), "start"),
        ((0.5, 0.5), [], "goals is empty"),
        ((0.5, 0.5), (0.5, 0.5, 0.5), "goals"),
        ((0.5, 0.5), [(0.5, np.nan)], "goals"),
        ((0.5, 0.5), [(0.5, 0.5), (0.5,)], "goals"),
    ],
)
def test_arguments_that_make_no_sense(gantry: pp.Arm, start: object, goals: object, words: str) -> None:
    with pytest.raises(pp.InputError, match=words):
        QUICK.plan(pp.CollisionChecker(gantry), start, goals)


@pytest.mark.parametrize("name", ["step", "resolution", "max_nodes", "max_samples", "time_limit"])
def test_settings_that_make_no_sense(name: str) -> None:
    with pytest.raises(pp.InputError, match=name):
        pp.RrtConnect(**{name: 0})


def test_configurations_that_gravity_does_not_permit_are_avoided(ur5: pp.Arm) -> None:
    """The straight segment stretches the arm horizontally, which a load of 15 kg does not permit."""
    checker = pp.CollisionChecker(ur5, pp.Scene())
    torques = pp.motion.TorqueLimits(ur5, pp.model.Payload(15.0))
    ends = np.array([[0, -0.4, 2.4, -1.6, -1.57, 0], [0, -0.4, -2.0, 1.6, -1.57, 0]])
    stretched = ends.mean(axis=0)
    assert "shoulder_lift_joint" in torques.standstill(stretched)
    direct = pp.RrtConnect().plan(checker, *ends, rng=0).or_raise()
    with pytest.raises(pp.errors.TimingError, match="shoulder_lift_joint"):
        pp.time_parametrise(direct.path, ur5.limits, rate_limits=[torques])
    plan = pp.RrtConnect().plan(checker, *ends, torque_limits=torques, rng=0).or_raise()
    path = pp.simplify(plan.path, checker, torque_limits=torques).path
    assert torques.standstill_share(path(np.linspace(*path.domain, 2000))) <= 1.0
    assert pp.time_parametrise(path, ur5.limits, rate_limits=[torques]).duration > 0
    refused = pp.RrtConnect().plan(checker, ends[0], stretched, torque_limits=torques)
    assert refused.status is pp.planning.PlanStatus.GOAL_INVALID
    assert "shoulder_lift_joint" in refused.message
    assert pp.RrtConnect().plan(checker, stretched, ends[0], torque_limits=torques).status is (
        pp.planning.PlanStatus.START_INVALID
    )


# -- The trees: nearest nodes, branches, and what a cut takes away


def _search(arm: pp.Arm, start: np.ndarray, goals: np.ndarray) -> _core.RrtSearch:
    edges = Edges(pp.CollisionChecker(arm), 0.1, start[None])
    box = np.array([[-9.0] * arm.dof, [9.0] * arm.dof])
    return _core.RrtSearch(edges.core, start, goals, box, step=0.7, max_nodes=1000, max_samples=1000)


def test_a_cut_removes_the_subtree_and_nothing_else(gantry: pp.Arm) -> None:
    search = _search(gantry, np.array([5.0, 5.0]), np.array([[0.0, 0.0], [10.0, 0.0]]))
    a = search.add(1, np.array([1.0, 0.0]), 0)
    b = search.add(1, np.array([2.0, 0.0]), a)
    c = search.add(1, np.array([0.0, 1.0]), 0)
    d = search.add(1, np.array([3.0, 0.0]), b)
    assert search.branch(1, d) == [d, b, a, 0]
    search.cut(1, a)
    assert sorted(map(tuple, search.nodes(1))) == [(0.0, 0.0), (0.0, 1.0), (10.0, 0.0)]
    assert search.nodes(0).tolist() == [[5.0, 5.0]]
    assert search.nearest(1, np.array([3.0, 0.1])) == 0
    assert search.nearest(1, np.array([0.1, 2.0])) == c
    assert search.size(0) + search.size(1) == 7  # what was ever added: cutting gives no budget back


def test_nearest_is_the_nearest_of_all(ur5: pp.Arm) -> None:
    rng = np.random.default_rng(0)
    search = _search(ur5, np.zeros(6), rng.uniform(-1, 1, (1, 6)))
    for _ in range(600):
        search.add(1, rng.uniform(-1, 1, 6), search.size(1) - 1)
    for target in rng.uniform(-1, 1, (20, 6)):
        assert search.nearest(1, target) == np.linalg.norm(search.nodes(1) - target, axis=1).argmin()
