"""The best sequence through the rungs of a ladder graph, against all sequences."""

from types import SimpleNamespace

import numpy as np
import pytest

from pinproof._core import Ladder
from pinproof.tool_paths.rungs import FollowCosts, LadderSettings, Rung, RungLadder

TURN = 2 * np.pi


def small_instance(rng):
    """An arm with a joint of several windings, one of a single winding and a prismatic one, and rungs of few nodes."""
    n, count = 3, int(rng.integers(2, 5))
    lower = np.array([-rng.uniform(3.3, 7.0), -2.5, -1.0])
    upper = np.array([rng.uniform(3.3, 7.0), 2.5, 1.0])
    limits = SimpleNamespace(
        lower=lower, upper=upper, velocity=rng.uniform(0.5, 2.0, n), clip=lambda q: np.clip(q, lower, upper)
    )
    arm = SimpleNamespace(limits=limits, periodic=np.array([True, True, False]), dof=n)
    rungs = []
    drift = rng.uniform(-3.0, 3.0)
    for index in range(count):
        q = rng.uniform(-1.0, 1.0, (int(rng.integers(1, 4)), n)) * [1.5, 0.7, 0.4]
        q[:, 0] = (q[:, 0] + drift * index + np.pi) % TURN - np.pi
        rungs.append(Rung(0, float(index), np.eye(4), float(index), q, np.ones(len(q), dtype=bool)))
        rungs[-1].rates = rng.uniform(0.0, 0.5, len(q))
    durations = rng.uniform(0.1, 2.0, count - 1)
    timed = rng.random(count - 1) < 0.7
    costs = FollowCosts(time=rng.uniform(0, 2), travel=rng.uniform(0, 2), effort=rng.uniform(0, 2))
    settings = LadderSettings(costs, rng.uniform(0.0, 1.5), rng.uniform(0.2, 1.0), np.array([3.1, 2.0, 1.0]))
    return arm, rungs, durations, timed, settings


def best_of_all(arm, rungs, durations, timed, settings):
    """The least cost over all sequences of nodes and windings; infinite without one."""
    limits, costs = arm.limits, settings.costs
    share = np.zeros(len(rungs))
    share[:-1] += durations / 2
    share[1:] += durations / 2
    choices = []
    for rung in rungs:
        choices.append([
            (q + TURN * k * np.array([1, 0, 0]), rate)
            for q, rate in zip(rung.nodes, rung.rates, strict=True)
            for k in range(-3, 4)
            if limits.lower[0] <= q[0] + TURN * k <= limits.upper[0]
        ])  # fmt: skip
    # The costs of all sequences as one array with an axis for each rung
    total = np.zeros(())
    for i, (time, choice) in enumerate(zip(share, choices, strict=True)):
        total = total[..., None] + time * np.array([rate for _, rate in choice])
        if i:
            step = np.abs(np.array([[b - a for b, _ in choice] for a, _ in choices[i - 1]]))
            duration = durations[i - 1]
            seconds = duration / settings.slowest if timed[i - 1] else np.inf
            reach = np.minimum(limits.velocity * max(seconds, settings.steps), settings.jump)
            r = step / limits.velocity
            edge = costs.time * np.maximum(r.max(axis=2), duration if timed[i - 1] else 0.0)
            edge += costs.travel * r.sum(axis=2) + costs.effort * (r**2).sum(axis=2) / duration
            total = total + np.where((step > reach).any(axis=2), np.inf, edge)
    return float(total.min())


def test_the_optimum_equals_that_of_all_sequences_and_windings():
    found = 0
    for seed in range(200):
        arm, rungs, durations, timed, settings = small_instance(np.random.default_rng(seed))
        best = best_of_all(arm, rungs, durations, timed, settings)
        course = RungLadder(arm, rungs, durations, timed, settings).solve(0, len(rungs) - 1)
        complete = len(course.nodes) == len(rungs)
        assert complete == np.isfinite(best), seed
        if complete:
            found += 1
            assert course.cost == pytest.approx(best, rel=1e-9, abs=1e-9), seed
            assert (course.q >= arm.limits.lower).all()
            assert (course.q <= arm.limits.upper).all()
            for q, rung, node in zip(course.q, rungs, course.nodes, strict=True):
                turns = (q - rung.nodes[node]) / [TURN, 1, 1]
                assert turns == pytest.approx([round(turns[0]), 0, 0], abs=1e-9)
    assert 60 < found < 195


def test_other_sequences_are_the_cheapest_to_ends_that_are_apart():
    for seed in range(30):
        arm, rungs, durations, timed, settings = small_instance(np.random.default_rng(seed))
        arm.limits.lower[0], arm.limits.upper[0] = -np.pi, np.pi  # one winding
        course = RungLadder(arm, rungs, durations, timed, settings).solve(0, len(rungs) - 1, others=5, apart=0.3)
        if len(course.nodes) < len(rungs):
            continue
        costs = []
        for node in range(len(rungs[-1].q)):
            ends = [*rungs[:-1], Rung(0, 0.0, np.eye(4), 0.0, rungs[-1].q[node : node + 1], np.ones(1, dtype=bool))]
            ends[-1].rates = rungs[-1].rates[node : node + 1]
            costs.append(best_of_all(arm, ends, durations, timed, settings))
        chosen = []
        for node in np.argsort(costs, kind="stable"):
            far = [(np.abs(rungs[-1].q[node] - rungs[-1].q[other]) > 0.3).sum() > 1 for other in chosen]
            if all(far) and np.isfinite(costs[node]):
                chosen.append(int(node))
        found = [course, *course.others]
        assert [own.nodes[-1] for own in found] == chosen
        assert [own.cost for own in found] == pytest.approx([costs[node] for node in chosen])


def test_a_joint_that_winds_up_is_followed_only_as_far_as_its_limits():
    limits = SimpleNamespace(
        lower=np.array([-4.0]), upper=np.array([4.0]), velocity=np.ones(1), clip=lambda q: np.clip(q, -4.0, 4.0)
    )
    arm = SimpleNamespace(limits=limits, periodic=np.array([True]), dof=1)

    def rungs(angles):
        made = []
        for index, angle in enumerate(angles):
            q = np.array([[(angle + np.pi) % TURN - np.pi]])
            made.append(Rung(0, float(index), np.eye(4), float(index), q, np.ones(1, dtype=bool)))
            made[-1].rates = np.zeros(1)
        return made

    settings = LadderSettings(FollowCosts(), 0.0, 1.0, np.array([0.5]))
    for end, reaches in ((3.95, True), (4.2, False)):
        angles = np.arange(-3.9, end, 0.25)
        ladder = RungLadder(
            arm, rungs(angles), np.ones(len(angles) - 1), np.ones(len(angles) - 1, dtype=bool), settings
        )
        course = ladder.solve(0, len(angles) - 1)
        assert (len(course.nodes) == len(angles)) == reaches
        assert np.diff(course.q[:, 0]) == pytest.approx(0.25)


def test_removed_edges_are_not_used():
    q = np.array([[0.0], [0.0], [0.1], [0.3]])
    ladder = Ladder(
        np.array([1, 3]), q, np.zeros(4), np.zeros(1), np.ones(1), np.array([[1.0]]), np.ones(1), np.ones(1),
        time=1.0, travel=1.0, effort=0.0,
    )  # fmt: skip
    for expected in (1, 2, 3):
        assert ladder.solve(0, 1).nodes.tolist() == [0, expected]
        ladder.remove(0, expected)
    course = ladder.solve(0, 1)
    assert (course.nodes.tolist(), course.reachable.tolist()) == ([0], [0])
