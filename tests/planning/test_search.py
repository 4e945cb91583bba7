"""Progress and interruption of a search, and searches in other processes."""

import multiprocessing
import signal
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import pinproof as pp
from pinproof.planning import PlanStatus

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


def found(checker, rng):
    return PLANNER.plan(checker, START, GOAL, rng=rng).or_raise()


@pytest.mark.slow
def test_searches_in_other_processes_find_the_same_paths(slot):
    here = [found(slot, rng) for rng in range(3)]
    assert len({plan.path.length for plan in here}) == 3
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = list(pool.map(found, [slot] * 3, range(3)))
    for one, other in zip(here, there, strict=True):
        assert one.path.q.tobytes() == other.path.q.tobytes()
        assert other.certificate.matches(other.path, slot.arm, slot.scene)
