"""Several searches of one problem: the answer does not depend on where, or how many at a time, they run."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

import pinproof as pp

from .arms import assert_free

START, GOAL = np.array([-0.8, -0.8]), np.array([0.8, -0.8])

PLANNER = pp.RrtConnect(time_limit=600.0)


@pytest.fixture
def slot(gantry: pp.Arm, slotted: pp.Scene) -> pp.CollisionChecker:
    return pp.CollisionChecker(gantry, slotted, margin=0.005)


@pytest.mark.slow
def test_the_shortest_path_wins_wherever_the_searches_run(slot: pp.CollisionChecker) -> None:
    single = [PLANNER.plan(slot, START, GOAL, rng=rng).path for rng in np.random.default_rng(5).spawn(4)]
    here = PLANNER.plan(slot, START, GOAL, rng=5, portfolio=4).or_raise()
    assert here.path.length == min(path.length for path in single)
    assert here.path.length < max(path.length for path in single)
    answers = []
    for workers in (1, 2):
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            answers.append(PLANNER.plan(slot, START, GOAL, rng=5, portfolio=4, executor=pool))
    with ThreadPoolExecutor(2) as pool:
        answers.append(PLANNER.plan(slot, START, GOAL, rng=5, portfolio=4, executor=pool))
    for answer in answers:
        assert answer.path.q.tobytes() == here.path.q.tobytes()
        assert answer.certificate.curve == here.certificate.curve
        assert answer.checker is slot
        assert answer.certificate.matches(answer.path, slot.arm, slot.scene)
    assert_free(here.path, slot)


def test_a_failed_portfolio_has_one_message(slot: pp.CollisionChecker) -> None:
    plan = pp.RrtConnect(max_samples=5, time_limit=600.0).plan(slot, START, GOAL, portfolio=3)
    assert plan.status is pp.planning.PlanStatus.OUT_OF_BUDGET
    assert plan.message.startswith("none of 3 searches")
    assert "max_samples = 5" in plan.message


def test_invalid_ends_are_reported_without_a_search(slot: pp.CollisionChecker) -> None:
    plan = PLANNER.plan(slot, (0.03, 0.0), GOAL, portfolio=3, executor=_Never())
    assert plan.status is pp.planning.PlanStatus.START_INVALID


class _Never(Executor):
    """An executor that never gets to anything."""

    def __init__(self) -> None:
        self.futures: list[Future] = []

    def submit(self, *args: object, **kwargs: object) -> Future:
        self.futures.append(Future())
        return self.futures[-1]


def test_a_callback_stops_searches_that_wait(slot: pp.CollisionChecker) -> None:
    pool, data = _Never(), []

    def stop(progress: pp.planning.PlanProgress) -> bool:
        data.append(progress)
        return len(data) < 2

    plan = PLANNER.plan(slot, START, GOAL, portfolio=3, executor=pool, progress=stop)
    assert plan.status is pp.planning.PlanStatus.CANCELLED
    assert "0 of 3 searches" in plan.message
    assert all(future.cancelled() for future in pool.futures)


class _Some(Executor):
    """An executor that completes all searches but the last with given results."""

    def __init__(self, results: list[pp.planning.PlanResult]) -> None:
        self.results, self.futures = list(results), []

    def submit(self, *args: object, **kwargs: object) -> Future:
        self.futures.append(Future())
        if self.results:
            self.futures[-1].set_result(self.results.pop(0))
        return self.futures[-1]


def test_the_progress_of_a_portfolio_is_the_sum_of_its_complete_searches(slot: pp.CollisionChecker) -> None:
    out = pp.planning.PlanStatus.OUT_OF_BUDGET
    results = [pp.planning.PlanResult(out, message="", nodes=n, samples=10 * n, gap=0.1 * n) for n in (3, 2, 5)]
    pool, data = _Some(results), []

    def stop(progress: pp.planning.PlanProgress) -> bool:
        data.append(progress)
        return len(data) < 2

    plan = PLANNER.plan(slot, START, GOAL, portfolio=4, executor=pool, progress=stop)
    assert plan.status is pp.planning.PlanStatus.CANCELLED
    assert "3 of 4 searches" in plan.message
    for each in (*data, plan):
        assert (each.nodes, each.samples, each.gap) == (10, 100, pytest.approx(0.2))
    assert 0 <= data[0].seconds <= data[1].seconds <= plan.seconds < 100
    assert pool.futures[-1].cancelled()


def test_a_callback_stops_searches_here(slot: pp.CollisionChecker) -> None:
    plan = PLANNER.plan(slot, START, GOAL, portfolio=3, progress=lambda _: False)
    assert plan.status is pp.planning.PlanStatus.CANCELLED


def test_an_empty_portfolio_is_refused(slot: pp.CollisionChecker) -> None:
    with pytest.raises(pp.InputError, match=r"portfolio must be .* not 0"):
        PLANNER.plan(slot, START, GOAL, portfolio=0)
