"""Progress and interruption of a search, messages of failures, and preferred clearance."""

from __future__ import annotations

import signal

import numpy as np
import pytest
import trimesh

import pinproof as pp

from .arms import assert_free

SLOTTED = ((-1.2, 0.54), (0.66, 1.2))
"""From where to where along y the parts of the slotted wall reach."""

START, GOAL = np.array([-0.8, -0.8]), np.array([0.8, -0.8])


@pytest.fixture
def slot(gantry: pp.Arm, slotted: pp.Scene) -> pp.CollisionChecker:
    return pp.CollisionChecker(gantry, slotted, margin=0.005)


@pytest.fixture
def parted(gantry: pp.Arm) -> pp.CollisionChecker:
    """A wall from end to end between start and goal."""
    return pp.CollisionChecker(gantry, pp.Scene([pp.Obstacle("wall", pp.Box(0.02, 4.0, 1.0))]))


ENDLESS = pp.RrtConnect(max_nodes=10**9, max_samples=10**9, time_limit=600.0)


def test_the_callback_receives_the_progress(parted: pp.CollisionChecker) -> None:
    data: list[pp.planning.PlanProgress] = []
    plan = pp.RrtConnect(max_samples=3000, time_limit=600.0).plan(parted, START, GOAL, progress=data.append)
    assert plan.status is pp.planning.PlanStatus.OUT_OF_BUDGET
    assert len(data) > 3
    for name in ("nodes", "samples", "seconds"):
        values = [getattr(each, name) for each in data]
        assert values == sorted(values)
    assert data[0].gap == np.inf
    assert data[-1].gap >= plan.gap >= 0.12  # the ball is 10 cm wide, the wall 2 cm
    assert data[-1].gap < 0.5
    assert plan.nodes >= data[-1].nodes
    assert plan.samples == 3000 >= data[-1].samples


def test_a_callback_does_not_change_the_path(slot: pp.CollisionChecker) -> None:
    planner = pp.RrtConnect(time_limit=600.0)
    alone = planner.plan(slot, START, GOAL, rng=4)
    watched = planner.plan(slot, START, GOAL, rng=4, progress=lambda _: None)
    assert alone.path.q.tobytes() == watched.path.q.tobytes()


@pytest.mark.parametrize("calls", [1, 4])
def test_a_callback_stops_the_search(parted: pp.CollisionChecker, calls: int) -> None:
    data: list[pp.planning.PlanProgress] = []

    def stop(progress: pp.planning.PlanProgress) -> bool:
        data.append(progress)
        return len(data) < calls

    plan = ENDLESS.plan(parted, START, GOAL, progress=stop)
    assert plan.status is pp.planning.PlanStatus.CANCELLED
    assert len(data) == calls
    assert not plan.ok
    assert (plan.nodes, plan.samples) == (data[-1].nodes, data[-1].samples)
    assert plan.gap <= data[-1].gap
    assert "cancelled" in plan.message
    assert f"{plan.nodes} nodes" in plan.message
    with pytest.raises(pp.errors.PlanFailed, match="cancelled"):
        plan.or_raise()


def test_ctrl_c_stops_the_search_and_the_checker_remains_usable(parted: pp.CollisionChecker) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(KeyboardInterrupt):
            ENDLESS.plan(parted, START, GOAL)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert parted.is_free(START)
    assert not parted.is_free([0.0, 0.0])
    assert pp.RrtConnect().plan(parted, START, (-0.5, 0.5)).ok


def test_a_failed_search_is_deterministic_and_reports_its_residual(parted: pp.CollisionChecker) -> None:
    planner = pp.RrtConnect(max_samples=400, time_limit=600.0)
    plans = [planner.plan(parted, START, GOAL, rng=3) for _ in range(2)]
    assert plans[0].message == plans[1].message
    assert plans[0].samples == 400
    assert 0.12 <= plans[0].gap < 1.6  # ends are that far apart
    assert f"within {plans[0].gap:.3g}" in plans[0].message
    assert plans[0].seconds > 0.0


def test_a_plan_reports_its_samples(slot: pp.CollisionChecker) -> None:
    plan = pp.RrtConnect(time_limit=600.0).plan(slot, START, GOAL).or_raise()
    assert plan.samples > 0
    assert plan.gap == 0.0
    assert plan.checker is slot
    assert plan.contacts == ()


def test_contacts_of_the_ends_are_reported(slot: pp.CollisionChecker) -> None:
    at_start = pp.RrtConnect().plan(slot, (0.03, 0.0), GOAL)
    assert [contact.bodies for contact in at_start.contacts] == [("l2", "below")]
    at_goals = pp.RrtConnect().plan(slot, START, [(0.03, 0.0), (0.03, 0.9), (0.5, 2.0)])
    assert at_goals.status is pp.planning.PlanStatus.GOAL_INVALID
    assert [contact.bodies for contact in at_goals.contacts] == [("l2", "below"), ("l2", "above")]
    assert np.isnan(at_goals.gap)


def test_a_passage_narrower_than_the_preferred_clearance(gantry: pp.Arm) -> None:
    half = 0.05 + 0.005 + 0.001  # 1 mm beyond the margin on both sides
    slot = [
        pp.Obstacle(f"wall{s:+}", pp.Box(0.2, 1.0, 1.0), pp.pose((0.0, s * (half + 0.5), 0.0))) for s in (-1.0, 1.0)
    ]
    checker = pp.CollisionChecker(gantry, pp.Scene(slot), margin=0.005)
    start, goal = np.array([-0.9, 0.0]), np.array([0.9, 0.0])
    plan = pp.RrtConnect(time_limit=600.0).plan(checker, start, goal, rng=0).or_raise()
    assert_free(plan.path, checker, step=0.002)
    assert not pp.RrtConnect(max_samples=50, time_limit=600.0).plan(checker, start, goal, rng=0).ok


@pytest.mark.parametrize("resolution", [0.05, 0.5])
def test_meshes_that_only_coal_can_judge(gantry: pp.Arm, resolution: float) -> None:
    # The slotted wall as one closed mesh: with 0.5 m between looks some edges that look free are not.
    parts = [trimesh.creation.box(bounds=[(-0.01, low, -0.5), (0.01, high, 0.5)]) for low, high in SLOTTED]
    both = trimesh.util.concatenate(parts)
    wall = pp.Obstacle("wall", pp.Mesh.from_arrays(both.vertices, both.faces, hull=False))
    checker = pp.CollisionChecker(gantry, pp.Scene([wall]), margin=0.005)
    assert not checker.convex.all()
    plan = pp.RrtConnect(resolution=resolution, time_limit=600.0).plan(checker, START, GOAL, rng=1).or_raise()
    assert_free(plan.path, checker)
    again = pp.RrtConnect(resolution=resolution, time_limit=600.0).plan(checker, START, GOAL, rng=1)
    assert plan.path.q.tobytes() == again.path.q.tobytes()
