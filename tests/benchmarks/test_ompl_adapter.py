"""Planners of OMPL: any by name, and nothing but certified paths."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from benchmarks.ompl_adapter import OmplPlanner, ompl_planners

import pinproof as pp
from pinproof.planning import Edges, planner_of

from ..planning.arms import assert_solves, ball_arm

START, GOAL = np.array([-0.8, -0.8]), np.array([0.8, -0.8])


def test_without_ompl_the_error_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ompl", "ompl.base", "ompl.geometric", "ompl.util"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(pp.InputError, match="pip install ompl"):
        OmplPlanner("RRTConnect")


pytest.importorskip("ompl")


@pytest.fixture(scope="module")
def gantry() -> pp.Arm:
    return ball_arm(("x", "y"))


@pytest.fixture(scope="module")
def turntable() -> pp.Arm:
    return ball_arm(("turn",))


@pytest.fixture(scope="module")
def ur5() -> pp.Arm:
    return pp.load_robot("ur5").arm()


def test_it_is_a_planner_that_the_command_line_and_the_picks_can_name() -> None:
    name = "benchmarks.ompl_adapter:OmplPlanner"
    assert planner_of(name, max_edges=7) == planner_of(OmplPlanner(max_edges=7))
    assert pp.picks.PickBudget(planner=name).planner == name


def test_constraints_are_refused(slot: pp.CollisionChecker) -> None:
    with pytest.raises(pp.InputError, match="rrt_connect"):
        planner_of(OmplPlanner()).plan(slot, START, GOAL, constraints=[pp.Upright(tolerance=0.1)])


@pytest.fixture
def slot(gantry: pp.Arm) -> pp.CollisionChecker:
    """A wall along y with a slot of 40 cm about y = 0.6; the ball has 10 cm."""
    walls = [
        pp.Obstacle("below", pp.Box(0.02, 1.6, 1.0), pp.pose((0.0, -0.4, 0.0))),
        pp.Obstacle("above", pp.Box(0.02, 0.4, 1.0), pp.pose((0.0, 1.0, 0.0))),
    ]
    return pp.CollisionChecker(gantry, pp.Scene(walls), margin=0.005)


@pytest.mark.parametrize("name", ["RRTConnect", "PRM", "BKPIECE1", "BFMT"])
def test_through_a_slot_with_any_planner(slot: pp.CollisionChecker, name: str) -> None:
    plan = planner_of(OmplPlanner(name, time_limit=60.0, max_edges=4000)).plan(slot, START, GOAL, rng=1)
    assert_solves(plan, slot, START, GOAL)
    assert name in plan.message
    assert plan.nodes > 0
    assert 0 < plan.samples <= 4000


def test_a_planner_that_shortens_is_the_same_within_a_budget_of_edges(slot: pp.CollisionChecker) -> None:
    planner = planner_of(OmplPlanner("RRTstar", time_limit=600.0, max_edges=2500, parameters={"range": 0.3}))
    plans = [planner.plan(slot, START, GOAL, rng=seed) for seed in (2, 2, 3)]
    for plan in plans:
        assert_solves(plan, slot, START, GOAL)
    assert plans[0].path.q.tobytes() == plans[1].path.q.tobytes()
    assert plans[0].path.q.tobytes() != plans[2].path.q.tobytes()
    quick = planner_of(OmplPlanner("RRTConnect", time_limit=600.0)).plan(slot, START, GOAL, rng=2)
    assert plans[0].path.length < quick.path.length


def test_an_edge_with_free_samples_that_fails_the_proof_is_never_used(gantry: pp.Arm) -> None:
    plates = [
        pp.Obstacle("below", pp.Box(0.002, 1.4, 1.0), pp.pose((0.013, -0.5, 0.0))),
        pp.Obstacle("above", pp.Box(0.002, 0.4, 1.0), pp.pose((0.013, 0.8, 0.0))),
    ]
    checker = pp.CollisionChecker(gantry, pp.Scene(plates))
    start, goal = np.array([-0.9, -0.5]), np.array([0.9, -0.5])
    assert Edges(checker, 0.6, np.array([start, goal])).samples_free(start, goal)
    plan = planner_of(OmplPlanner(time_limit=600.0, resolution=0.6, max_edges=20_000)).plan(checker, start, goal)
    assert_solves(plan, checker, start, goal)


def test_of_several_goals_the_reachable_one_is_reached(gantry: pp.Arm) -> None:
    walls = [
        pp.Obstacle("along_y", pp.Box(0.02, 1.2, 1.0), pp.pose((0.0, 0.6, 0.0))),
        pp.Obstacle("along_x", pp.Box(1.2, 0.02, 1.0), pp.pose((0.6, 0.0, 0.0))),
    ]
    checker = pp.CollisionChecker(gantry, pp.Scene(walls))
    start, goals = np.array([-0.3, 0.8]), np.array([(0.3, 0.3), (0.0, 0.5), (0.8, -0.8)])
    plan = planner_of(OmplPlanner(time_limit=600.0, max_edges=20_000)).plan(checker, start, goals)
    assert plan.goal == 2
    assert_solves(plan, checker, start, goals[2])


def test_a_continuous_joint_goes_round(turntable: pp.Arm) -> None:
    checker = pp.CollisionChecker(turntable)
    plan = planner_of(OmplPlanner(time_limit=60.0)).plan(checker, [0.1], [2 * np.pi - 0.1], turns=True)
    assert plan.ok
    assert plan.path.end[0] in (pytest.approx(-0.1), pytest.approx(2 * np.pi - 0.1))


def test_a_blocked_goal_is_not_found(gantry: pp.Arm) -> None:
    checker = pp.CollisionChecker(gantry, pp.Scene([pp.Obstacle("wall", pp.Box(0.02, 4.0, 1.0))]))
    plan = planner_of(OmplPlanner("RRT", time_limit=600.0, max_edges=200)).plan(checker, START, GOAL)
    assert plan.status is pp.planning.PlanStatus.OUT_OF_BUDGET
    assert not plan.ok
    assert "max_edges = 200" in plan.message
    assert plan.gap > 0.7  # from the wall to the goal
    timed = planner_of(OmplPlanner("RRTConnect", time_limit=0.05)).plan(checker, START, GOAL)
    assert "time_limit = 0.05 s" in timed.message


def test_an_end_in_contact_is_named(slot: pp.CollisionChecker) -> None:
    plan = planner_of(OmplPlanner()).plan(slot, (0.03, 0.0), GOAL)
    assert plan.status is pp.planning.PlanStatus.START_INVALID
    assert "below" in plan.message


@pytest.mark.parametrize("name", ["RRTConnect", "PRM"])
def test_exceptions_raised_inside_ompl_are_propagated(
    slot: pp.CollisionChecker, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(Edges, "proven_free", fail)
    with pytest.raises(KeyboardInterrupt):
        planner_of(OmplPlanner(name, time_limit=600.0)).plan(slot, START, GOAL)


def test_nothing_is_printed(slot: pp.CollisionChecker, capfd: pytest.CaptureFixture[str]) -> None:
    planner_of(OmplPlanner("RRTConnect", time_limit=60.0)).plan(slot, START, GOAL)
    assert capfd.readouterr() == ("", "")


def test_names_that_do_not_exist() -> None:
    with pytest.raises(pp.UnknownNameError, match="RRTstar") as caught:
        OmplPlanner("RRTsta")
    assert set(caught.value.valid) == set(ompl_planners())
    with pytest.raises(pp.UnknownNameError, match="range"):
        OmplPlanner("RRTConnect", parameters={"rnage": 1.0})


@pytest.mark.parametrize("name", ["time_limit", "max_edges", "resolution"])
def test_settings_that_make_no_sense(name: str) -> None:
    with pytest.raises(pp.InputError, match=name):
        OmplPlanner(**{name: 0})
