"""Every planner returns certified, reproducible paths; an unknown name is refused with the valid ones."""

import numpy as np
import pytest

import pinproof as pp
from pinproof.planning import make_planner, planner_of

START, GOAL = [-1.0, -1.2, 1.2, -1.57, -1.57, 0.0], [1.0, -1.2, 1.2, -1.57, -1.57, 0.0]
POST = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose(xyz=(0.55, 0.0, 0.5)))


@pytest.fixture(scope="module")
def checker(ur5):
    return pp.CollisionChecker(ur5, pp.Scene([POST]))


@pytest.fixture(params=["rrt_connect", "benchmarks.ompl_adapter:OmplPlanner"])
def planner(request):
    if "ompl" in request.param:
        pytest.importorskip("ompl")
    return make_planner(request.param)


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
    assert (plan.status, plan.ok) == (pp.planning.PlanStatus.OUT_OF_BUDGET, False)


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
    assert make_planner("rrt_connect", time_limit=1.5) == pp.RrtConnect(time_limit=1.5)
    with pytest.raises(pp.errors.UnknownNameError) as caught:
        make_planner("rrt")
    assert set(caught.value.valid) == {"rrt_connect", "MODULE:CLASS"}
    with pytest.raises(pp.InputError, match="rrt_connect"):
        pp.picks.PickBudget(planner="rrt")


class OnlyLimited:
    def limited_to(self, seconds):
        return self


class OnlyPlans:
    def plan(self, *_args, **_settings):
        raise AssertionError


@pytest.mark.parametrize(
    ("make", "planner", "message"),
    [
        *((make_planner, name, name) for name in ("nowhere.to_be_found:Planner", "pinproof:NoPlanner", "pinproof:")),
        (make_planner, "pinproof:Clik", "plan"),
        (planner_of, OnlyLimited(), "lacks plan"),
        (planner_of, OnlyPlans(), "lacks limited_to"),
        (planner_of, 3, "lacks plan"),
    ],
)
def test_what_is_no_planner_is_refused_with_what_is_missing(make, planner, message):
    with pytest.raises(pp.errors.UnknownNameError if message == planner else pp.InputError, match=message):
        make(planner)


# -- `pp.plan`: planned, shortened, timed and certified in one call, or the reason why there is no motion --------------


def test_plan_is_a_certified_motion_between_the_configurations(ur5):
    start, goal = ur5.home, ur5.home + np.array([0.8, 0.3, -0.3, 0.0, 0.2, 0.0])
    found = pp.plan(pp.CollisionChecker(ur5), start, goal, budget=5, rate_limits=[pp.motion.TorqueLimits(ur5)])
    assert found.or_raise() is found
    assert found.certificate.free
    np.testing.assert_allclose(found.trajectory.start, start, atol=1e-12)
    np.testing.assert_allclose(found.trajectory.end, goal, atol=1e-12)
    values = found.to_dict()
    assert values["duration"] == found.trajectory.duration <= values["duration_of_path"]
    assert len(values["torques"]) == ur5.dof
    assert "optimised motion" in found.message
    assert "largest torque" in found.to_text()


def test_plan_without_a_path_states_the_reason(ur5):
    wall = pp.Obstacle("wall", pp.Sphere(0.03), ur5.forward_kinematics(ur5.home))
    found = pp.plan(pp.CollisionChecker(ur5, pp.Scene([wall])), ur5.home, ur5.home + 0.1)
    assert (found.ok, found.to_dict()["status"]) == (False, "START_INVALID")
    assert "wall" in found.to_text()
    for read in (lambda: found.trajectory, lambda: found.certificate, found.or_raise):
        with pytest.raises(pp.errors.PlanFailed, match="wall"):
            read()
