"""Every planner returns certified, reproducible paths; an unknown name is refused with the valid ones."""

from __future__ import annotations

import numpy as np
import pytest

import pinproof as pp
from pinproof.planning import Planner, make_planner, planner_of

START, GOAL = [-1.0, -1.2, 1.2, -1.57, -1.57, 0.0], [1.0, -1.2, 1.2, -1.57, -1.57, 0.0]
POST = pp.Obstacle("post", pp.Box(0.1, 0.1, 1.0), pp.pose(xyz=(0.55, 0.0, 0.5)))


@pytest.fixture(scope="module")
def checker() -> pp.CollisionChecker:
    return pp.CollisionChecker(pp.load_robot("ur5").arm(), pp.Scene([POST]))


@pytest.fixture(params=["rrt_connect", "benchmarks.ompl_adapter:OmplPlanner"])
def planner(request: pytest.FixtureRequest) -> Planner:
    if "ompl" in request.param:
        pytest.importorskip("ompl")
    return make_planner(request.param)


def test_a_path_is_certified_and_joins_start_and_goal(planner: Planner, checker: pp.CollisionChecker) -> None:
    plan = planner.plan(checker, START, GOAL, rng=0).or_raise()
    assert plan.certificate.free
    assert pp.certify(plan.path, checker).free
    np.testing.assert_array_equal(plan.path.q[[0, -1]], [START, GOAL])


def test_the_same_seed_gives_the_same_path_under_a_budget_of_work(
    planner: Planner, checker: pp.CollisionChecker
) -> None:
    first, second = (planner.limited_to(2000).plan(checker, START, GOAL, rng=3).or_raise() for _ in range(2))
    np.testing.assert_array_equal(first.path.q, second.path.q)


def test_a_budget_of_work_ends_a_search_without_a_path(planner: Planner, checker: pp.CollisionChecker) -> None:
    walls = [pp.Obstacle(f"wall {x}", pp.Box(1.5, 0.02, 3.0), pp.pose(xyz=(x, 0.0, 1.0))) for x in (-1.0, 1.0)]
    divided = checker.with_scene(pp.Scene(walls))
    plan = planner.limited_to(1).plan(divided, START, GOAL, rng=0)
    assert plan.status is pp.planning.PlanStatus.OUT_OF_BUDGET
    assert not plan.ok


def test_a_blocked_goal_is_not_reported_as_solved(planner: Planner, checker: pp.CollisionChecker) -> None:
    at_goal = checker.arm.forward_kinematics(GOAL).translation
    blocked = checker.with_scene(checker.scene.add(pp.Obstacle("ball", pp.Sphere(0.05), pp.pose(xyz=at_goal))))
    plan = planner.plan(blocked, START, GOAL, rng=0)
    assert not plan.ok
    for name in ("path", "certificate", "goal"):
        with pytest.raises(pp.NoAnswer, match="ball"):
            getattr(plan, name)
    assert "ball" in plan.message


def test_settings_are_passed_to_the_planner() -> None:
    assert make_planner("rrt_connect", time_limit=1.5) == pp.RrtConnect(time_limit=1.5)


def test_an_unknown_planner_is_refused_with_the_valid_names() -> None:
    with pytest.raises(pp.errors.UnknownNameError) as caught:
        make_planner("rrt")
    assert set(caught.value.valid) == {"rrt_connect", "MODULE:CLASS"}
    with pytest.raises(pp.InputError, match="rrt_connect"):
        pp.picks.PickBudget(planner="rrt")


@pytest.mark.parametrize("name", ["nowhere.to_be_found:Planner", "pinproof:NoPlanner", "pinproof:"])
def test_a_class_that_cannot_be_imported_is_refused_by_its_name(name: str) -> None:
    with pytest.raises(pp.errors.UnknownNameError, match=name):
        make_planner(name)


def test_a_class_without_the_methods_of_a_planner_is_refused_with_what_is_missing() -> None:
    with pytest.raises(pp.InputError, match="plan"):
        make_planner("pinproof:Clik")


class OnlyLimited:
    def limited_to(self, seconds: float):
        return self


class OnlyPlans:
    def plan(self, *_args, **_settings):
        raise AssertionError


@pytest.mark.parametrize(
    ("planner", "missing"), [(OnlyLimited(), "lacks plan"), (OnlyPlans(), "lacks limited_to"), (3, "lacks plan")]
)
def test_a_planner_without_a_method_is_refused(planner, missing) -> None:
    with pytest.raises(pp.InputError, match=missing):
        planner_of(planner)
