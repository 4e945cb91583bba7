"""Progress and interruption of a search, and several searches of one problem, wherever they run."""

import multiprocessing
import signal
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

import pinproof as pp
from pinproof.planning import PlanResult, PlanStatus

from .arms import assert_free

START, GOAL = np.array([-0.8, -0.8]), np.array([0.8, -0.8])
PLANNER = pp.RrtConnect(time_limit=600.0)
ENDLESS = pp.RrtConnect(max_nodes=10**9, max_samples=10**9, time_limit=600.0)


@pytest.fixture(scope="module")
def parted(gantry):
    """A wall from end to end between start and goal."""
    return pp.CollisionChecker(gantry, pp.Scene([pp.Obstacle("wall", pp.Box(0.02, 4.0, 1.0))]))


class Watch:
    """A callback that keeps the progress, and stops at a number of calls."""

    def __init__(self, calls=10**9):
        self.data, self.calls = [], calls

    def __call__(self, progress):
        self.data.append(progress)
        return len(self.data) < self.calls


def test_the_callback_receives_the_progress(parted):
    watch = Watch()
    plan = pp.RrtConnect(max_samples=3000, time_limit=600.0).plan(parted, START, GOAL, progress=watch)
    assert plan.status is PlanStatus.OUT_OF_BUDGET
    assert len(watch.data) > 3
    for name in ("nodes", "samples", "seconds"):
        values = [getattr(each, name) for each in watch.data]
        assert values == sorted(values)
    assert watch.data[0].gap == np.inf
    assert 0.5 > watch.data[-1].gap >= plan.gap >= 0.12  # the ball is 10 cm wide, the wall 2 cm
    assert plan.nodes >= watch.data[-1].nodes
    assert plan.samples == 3000 >= watch.data[-1].samples


def test_a_callback_does_not_change_the_path(slot):
    alone, watched = (PLANNER.plan(slot, START, GOAL, rng=4, progress=progress) for progress in (None, lambda _: None))
    assert alone.path.q.tobytes() == watched.path.q.tobytes()


@pytest.mark.parametrize("calls", [1, 4])
def test_a_callback_stops_the_search(parted, calls):
    watch = Watch(calls)
    plan = ENDLESS.plan(parted, START, GOAL, progress=watch)
    assert (plan.status, plan.ok, len(watch.data)) == (PlanStatus.CANCELLED, False, calls)
    assert (plan.nodes, plan.samples) == (watch.data[-1].nodes, watch.data[-1].samples)
    assert plan.gap <= watch.data[-1].gap
    assert ("cancelled" in plan.message, f"{plan.nodes} nodes" in plan.message) == (True, True)
    with pytest.raises(pp.errors.PlanFailed, match="cancelled"):
        plan.or_raise()


def test_ctrl_c_stops_the_search_and_the_checker_remains_usable(parted):
    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(KeyboardInterrupt):
            ENDLESS.plan(parted, START, GOAL)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert (parted.is_free(START), parted.is_free([0.0, 0.0])) == (True, False)
    assert pp.RrtConnect().plan(parted, START, (-0.5, 0.5)).ok


def test_a_failed_search_is_deterministic_and_reports_its_residual(parted):
    planner = pp.RrtConnect(max_samples=400, time_limit=600.0)
    plans = [planner.plan(parted, START, GOAL, rng=3) for _ in range(2)]
    assert plans[0].message == plans[1].message
    assert plans[0].samples == 400
    assert 0.12 <= plans[0].gap < 1.6  # ends are that far apart
    assert f"within {plans[0].gap:.3g}" in plans[0].message
    assert plans[0].seconds > 0.0


@pytest.mark.slow
def test_the_shortest_path_wins_wherever_the_searches_run(slot):
    single = [PLANNER.plan(slot, START, GOAL, rng=rng).path for rng in np.random.default_rng(5).spawn(4)]
    here = PLANNER.plan(slot, START, GOAL, rng=5, portfolio=4).or_raise()
    assert here.path.length == min(path.length for path in single)
    assert here.path.length < max(path.length for path in single)
    for pool in (
        ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")),
        *(ThreadPoolExecutor(workers) for workers in (1, 2)),
    ):
        with pool:
            answer = PLANNER.plan(slot, START, GOAL, rng=5, portfolio=4, executor=pool)
        assert answer.path.q.tobytes() == here.path.q.tobytes()
        assert answer.certificate.curve == here.certificate.curve
        assert answer.checker is slot
        assert answer.certificate.matches(answer.path, slot.arm, slot.scene)
    assert_free(here.path, slot)


class Some(Executor):
    """An executor that completes searches with given results, and never gets to the others."""

    def __init__(self, *results):
        self.results, self.futures = list(results), []

    def submit(self, *_args, **_settings):
        self.futures.append(Future())
        if self.results:
            self.futures[-1].set_result(self.results.pop(0))
        return self.futures[-1]


def test_a_failed_portfolio_has_one_message_and_invalid_ends_are_reported_without_a_search(slot):
    plan = pp.RrtConnect(max_samples=5, time_limit=600.0).plan(slot, START, GOAL, portfolio=3)
    assert plan.status is PlanStatus.OUT_OF_BUDGET
    assert plan.message.startswith("none of 3 searches")
    assert "max_samples = 5" in plan.message
    plan = PLANNER.plan(slot, (0.03, 0.0), GOAL, portfolio=3, executor=Some())
    assert plan.status is PlanStatus.START_INVALID
    with pytest.raises(pp.InputError, match=r"portfolio must be .* not 0"):
        PLANNER.plan(slot, START, GOAL, portfolio=0)


@pytest.mark.parametrize("complete", [0, 3])
def test_a_callback_stops_searches_that_wait_and_adds_those_that_are_complete(slot, complete):
    out = PlanStatus.OUT_OF_BUDGET
    results = [PlanResult(out, message="", nodes=n, samples=10 * n, gap=0.1 * n) for n in (3, 2, 5)[:complete]]
    pool, watch = Some(*results), Watch(2)
    plan = PLANNER.plan(slot, START, GOAL, portfolio=complete + 1, executor=pool, progress=watch)
    assert plan.status is PlanStatus.CANCELLED
    assert f"{complete} of {complete + 1} searches" in plan.message
    if complete:
        for each in (*watch.data, plan):
            assert (each.nodes, each.samples, each.gap) == (10, 100, pytest.approx(0.2))
    assert 0 <= watch.data[0].seconds <= watch.data[1].seconds <= plan.seconds < 100
    assert all(future.cancelled() for future in pool.futures[complete:])
    assert PLANNER.plan(slot, START, GOAL, portfolio=3, progress=lambda _: False).status is PlanStatus.CANCELLED
