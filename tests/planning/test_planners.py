"""Every planner returns certified, reproducible paths; an unknown name is refused with the valid ones."""

import numpy as np
import pytest

import pinproof as pp
from pinproof.planning import PlanStatus, planner_of

from .arms import ball_arm

START, GOAL = [-1.0, -1.2, 1.2, -1.57, -1.57, 0.0], [1.0, -1.2, 1.2, -1.57, -1.57, 0.0]
WRIST = np.eye(6)[5]
NEAR = pp.Within.box(pp.pose(), (4.0, 4.0, 4.0), tolerance=1e-3)
POST = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose(xyz=(0.55, 0.0, 0.5)))


@pytest.fixture(scope="module")
def checker(ur5):
    return pp.CollisionChecker(ur5, pp.Scene([POST]))


class ViaPoint:
    """The planner of a user, with the one method that is required: it tries random points beside the straight line."""

    def plan(self, checker, start, goals, *, rng=0):
        draws = np.random.default_rng(rng)
        for goal in goals:
            for via in (start + goal) / 2 + draws.uniform(-1.0, 1.0, (200, len(start))):
                legs = np.array([start, via]), np.array([via, goal])
                if checker.edges_free(*legs).all():
                    path = pp.JointPath([start, via, goal], checker.group.joint_names)
                    return pp.PlanResult(PlanStatus.FOUND, path)
        return pp.PlanResult(PlanStatus.OUT_OF_BUDGET, message="no point beside the line is free")


@pytest.fixture(params=["rrt_connect", "benchmarks.ompl_adapter:OmplPlanner", f"{__name__}:ViaPoint"])
def planner(request):
    if "ompl" in request.param:
        pytest.importorskip("ompl")
    return planner_of(request.param)


def test_a_path_is_certified_and_joins_start_and_goal(planner, checker):
    plan = planner.plan(checker, START, GOAL, rng=0).or_raise()
    assert plan.certificate.free
    assert pp.certify(plan.path, checker).free
    np.testing.assert_array_equal(plan.path.q[[0, -1]], [START, GOAL])


def test_the_same_seed_gives_the_same_path_under_a_budget_of_work(planner, checker):
    first, second = (planner.limited_to(2000).plan(checker, START, GOAL, rng=3).or_raise() for _ in range(2))
    np.testing.assert_array_equal(first.path.q, second.path.q)


def test_a_budget_of_work_ends_a_search_without_a_path(planner, checker):
    walls = [pp.Obstacle(f"wall {x}", pp.Box(1.5, 0.02, 3.0), pp.pose(xyz=(x, 0.0, 1.0))) for x in (-1.0, 1.0)]
    divided = checker.with_scene(pp.Scene(walls))
    plan = planner.limited_to(1).plan(divided, START, GOAL, rng=0)
    assert (plan.status, plan.ok) == (PlanStatus.OUT_OF_BUDGET, False)


def test_a_blocked_goal_is_not_reported_as_solved(planner, checker):
    at_goal = checker.arm.forward_kinematics(GOAL).translation
    blocked = checker.with_scene(checker.scene.add(pp.Obstacle("ball", pp.Sphere(0.05), pp.pose(xyz=at_goal))))
    plan = planner.plan(blocked, START, GOAL, rng=0)
    assert not plan.ok
    for name in ("path", "certificate", "goal"):
        with pytest.raises(pp.NoAnswer, match="ball"):
            getattr(plan, name)
    assert "ball" in plan.message


def test_settings_are_passed_to_the_planner_and_an_unknown_one_is_refused_with_the_valid_names():
    assert planner_of("rrt_connect", time_limit=1.5) == pp.RrtConnect(time_limit=1.5)
    with pytest.raises(pp.errors.UnknownNameError) as caught:
        planner_of("rrt")
    assert set(caught.value.valid) == {"rrt_connect", "MODULE:CLASS"}
    with pytest.raises(pp.InputError, match="rrt_connect"):
        pp.picks.PickBudget(planner="rrt")


class WithoutSeed:
    def plan(self, checker, start, goals):
        raise AssertionError


@pytest.mark.parametrize(
    ("given", "stated"),
    [
        *((name, name) for name in ("nowhere.to_be_found:Planner", "pinproof:NoPlanner", "pinproof:", "rrt")),
        ("pinproof:Clik", "must have the method plan"),
        (3, "3 lacks it"),
        (pp.RrtConnect, r"give an object of it: RrtConnect\(\)"),
        (WithoutSeed(), "WithoutSeed .* 'rng'"),
    ],
)
def test_what_is_no_planner_is_refused_with_what_is_missing(given, stated):
    with pytest.raises(pp.UnknownNameError if given == stated else pp.InputError, match=stated):
        planner_of(given)


# -- planners of other packages: their answers are checked ------------------------------------------------------------


class Answers:
    """A planner that answers what it is given."""

    def __init__(self, status=PlanStatus.FOUND, path=None, message=""):
        self.answer = pp.PlanResult(status, path, message=message)

    def plan(self, checker, start, goals, *, rng=0):
        return self.answer


def path_of(ur5, *points):
    return pp.JointPath(points, ur5.joint_names)


def test_a_path_through_an_obstacle_is_not_proven(ur5, checker):
    plan = planner_of(Answers(path=path_of(ur5, START, GOAL))).plan(checker, START, GOAL)
    assert (plan.ok, plan.status) == (False, PlanStatus.NOT_PROVEN)
    assert {"post"} < {name for contact in plan.contacts for name in contact.bodies}
    found = pp.plan(checker, START, GOAL, planner=Answers(path=path_of(ur5, START, GOAL)))
    assert not found.ok
    assert "post" in found.message


def test_a_path_that_violates_the_limits_is_not_proven(ur5):
    beyond = np.array(START) + 7.0 * WRIST
    path = path_of(ur5, START, beyond, START)
    plan = planner_of(Answers(path=path)).plan(pp.CollisionChecker(ur5), START, START)
    assert plan.status is PlanStatus.NOT_PROVEN
    assert "wrist_3_joint" in plan.message


@pytest.mark.parametrize("shift", [np.array([[1e-3], [0.0]]), np.array([[0.0], [1e-3]]), np.array([[np.pi], [0.0]])])
def test_a_path_between_other_configurations_is_not_proven(ur5, shift):
    q = np.array([START, START]) + shift
    plan = planner_of(Answers(path=path_of(ur5, *q))).plan(pp.CollisionChecker(ur5), START, START)
    assert plan.status is PlanStatus.NOT_PROVEN


def test_rounded_ends_of_a_path_become_those_that_were_given(ur5, checker):
    near = np.array(START) + 1e-4
    path = path_of(ur5, np.float32(START).astype(float), np.float32(near).astype(float))
    plan = planner_of(Answers(path=path)).plan(checker, START, [GOAL, near]).or_raise()
    np.testing.assert_array_equal(plan.path.q, [START, near])
    assert plan.goal == 1
    assert plan.certificate.matches(plan.path, checker.group, checker.scene)


def test_a_path_of_one_point_is_that_of_an_arm_that_is_there(ur5, checker):
    assert len(planner_of(Answers(path=path_of(ur5, START))).plan(checker, START, START).or_raise().path) == 1


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        (PlanStatus.IMPOSSIBLE, PlanStatus.OUT_OF_BUDGET),
        (PlanStatus.GOAL_INVALID, PlanStatus.OUT_OF_BUDGET),
        (PlanStatus.CANCELLED, PlanStatus.CANCELLED),
    ],
)
def test_only_proofs_of_our_own_state_that_no_path_exists(checker, status, expected):
    plan = planner_of(Answers(status, message="my reason")).plan(checker, START, GOAL)
    assert (plan.status, plan.message) == (expected, "my reason")


def test_a_barrier_is_found_for_any_planner():
    rail = ball_arm(("x",))
    checker = pp.CollisionChecker(rail, pp.Scene([pp.Obstacle("wall", pp.Box(0.02, 4.0, 1.0))]))
    plan = planner_of(Answers(PlanStatus.OUT_OF_BUDGET)).plan(checker, [-0.8], [0.8])
    assert plan.status is PlanStatus.IMPOSSIBLE
    assert "wall" in plan.message


@pytest.mark.parametrize("answer", [None, [START, GOAL]])
def test_an_answer_of_another_type_is_refused(checker, answer):
    planner = Answers()
    planner.answer = answer
    with pytest.raises(pp.InputError, match=f"Answers.plan must return a PlanResult, not {type(answer).__name__}"):
        planner_of(planner).plan(checker, START, GOAL)


def test_a_found_result_needs_a_path_and_a_status(checker):
    planner = Answers()
    planner.answer = pp.PlanResult(PlanStatus.FOUND)
    with pytest.raises(pp.InputError, match=r"Answers[.]plan returned the status FOUND without a path"):
        planner_of(planner).plan(checker, START, GOAL)
    planner.answer = pp.PlanResult(1)  # type: ignore[arg-type]
    with pytest.raises(pp.InputError, match=r"status of the result of Answers[.]plan must be of type PlanStatus"):
        planner_of(planner).plan(checker, START, GOAL)


def test_a_path_of_another_type_or_of_other_joints_is_refused(ur5, checker):
    with pytest.raises(pp.InputError, match="must be of type JointPath"):
        planner_of(Answers(path=np.array([START, GOAL]))).plan(checker, START, GOAL)
    with pytest.raises(pp.InputError, match="joints"):
        planner_of(Answers(path=pp.JointPath([START, GOAL], ur5.joint_names[::-1]))).plan(checker, START, GOAL)


def test_a_task_that_the_planner_does_not_support_is_refused(ur5, checker):
    planner = planner_of(ViaPoint())
    assert not planner.supports("constraints")
    with pytest.raises(pp.InputError, match="ViaPoint does not support constraints"):
        planner.plan(checker, START, GOAL, constraints=[NEAR])
    with pytest.raises(pp.InputError, match="ViaPoint does not support torque_limits"):
        pp.plan(checker, START, GOAL, planner=ViaPoint(), rate_limits=[pp.motion.TorqueLimits(ur5)])


def test_a_planner_with_more_keywords_gets_what_the_task_demands(checker):
    seen = {}

    class Full(ViaPoint):
        def limited_to(self, nodes):
            seen["nodes"] = nodes
            return self

        def plan(self, checker, start, goals, *, rng=0, constraints=(), **more):
            seen.update(more, constraints=constraints, goals=goals.shape)
            return super().plan(checker, start, goals, rng=rng)

    plan = planner_of(Full()).limited_to(30).plan(checker, START, GOAL, constraints=[NEAR], turns=True)
    assert plan.or_raise().certificate.constraints[0].constraint == NEAR
    assert (seen["nodes"], seen["constraints"]) == (30, (NEAR,))
    assert seen["goals"][0] > 1


def test_goals_of_full_rotations_count_as_the_given_one(ur5):
    shifted = np.array(START) + 2 * np.pi * WRIST
    planner = planner_of(Answers(path=path_of(ur5, START, shifted)))
    checker = pp.CollisionChecker(ur5)
    plan = planner.plan(checker, START, [GOAL, START], turns=True).or_raise()
    assert plan.goal == 1
    np.testing.assert_allclose(plan.path.q[-1], shifted, atol=1e-12)


def test_motions_are_planned_by_any_planner(ur5, checker):
    motion = pp.plan(checker, START, GOAL, planner=ViaPoint(), budget=5).or_raise()
    assert motion.certificate.free
    assert pp.certify(motion.trajectory, checker).free
