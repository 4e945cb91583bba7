"""The best complete motion: bounds of the score exclude only candidates that cannot win."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.picks.judging.grasp import reach, screen
from pinproof.picks.judging.judge import BestFirst, Scoring
from pinproof.picks.judging.place import Placer
from pinproof.picks.judging.task import PickTask

ALL = pp.picks.PickBudget(configurations=10_000, compared=10_000, remedies=0)
SEEDS = [1, 2]


def setup(robot: str, file: str, weights: pp.picks.PickWeights | None = None) -> tuple[pp.picks.PickSetup, pp.Picks]:
    picks = pp.read_picks(robots_folder() / robot / file)
    arm = pp.load_robot(robot).arm(tcp=picks.tcp, held=picks.held)
    scene = pp.Scene.load(picks.scene)
    return pp.picks.PickSetup.make(arm, scene, picks, home=None, rng=0, weights=weights, budget=ALL), picks


def search(made: pp.picks.PickSetup, pick: pp.Pick, *, bounded: bool) -> BestFirst:
    task = PickTask(pick, made.cell)
    ring = next(iter(task.groups()))
    candidates = screen(task, ring, reach(task, ring, 0)).candidates
    found = BestFirst(task, candidates, SEEDS, bounded=bounded)
    found.run()
    return found


@pytest.mark.parametrize(
    ("robot", "file", "name", "weights"),
    [
        ("ur5", "picks.yaml", "bolt_1", None),
        ("ur5", "picks.yaml", "bolt_5", pp.picks.PickWeights(clearance=0, manipulability=0, limit_margin=0)),
        ("ur5", "picks.yaml", "bolt_7", pp.picks.PickWeights(duration=0.2)),
        ("ur5", "carry.yaml", "over_the_wall", None),
        ("generic_6dof", "picks.yaml", None, None),
        ("panda", "picks.yaml", "cube_2", None),
    ],
)
@pytest.mark.slow
def test_the_bound_leaves_the_winner_as_it_is(robot: str, file: str, name: str | None, weights) -> None:
    made, picks = setup(robot, file, weights)
    pick = picks.picks[0] if name is None else next(each for each in picks if each.name == name)
    quick, complete = (search(made, pick, bounded=bounded) for bounded in (True, False))
    assert quick.best is not None
    np.testing.assert_array_equal(quick.best.attempt.q, complete.best.attempt.q)
    assert quick.best.parts == complete.best.parts
    assert quick.best.path.q.tobytes() == complete.best.path.q.tobytes()
    assert quick.made <= complete.made
    # What came out is never above what was said before: each whole pick was bounded from its configuration on.
    scores = {each.key[1]: each.parts["score"] for each in complete.motions}
    assert all(score <= complete._scoring.bounds[index] + 1e-12 for index, score in scores.items())
    assert complete.left(complete.best) == (0, 0)
    excluded, untried = quick.left(quick.best)
    assert untried == 0
    assert quick.made + excluded >= min(complete.made, 2)


def test_the_verdict_reports_the_numbers_of_judged_and_excluded_candidates() -> None:
    made, picks = setup("ur5", "picks.yaml")
    verdict = made.judge(0, picks.picks[0])
    figures = verdict.stages[-1].figures
    assert verdict.ok
    assert figures["complete"] >= 1
    assert figures["excluded"] > 10
    assert figures["untried"] == 0
    assert f"best of {figures['complete'] + figures['excluded']:.0f} candidates" in verdict.reason


def test_an_exhausted_budget_is_reported() -> None:
    made, picks = setup("panda", "picks.yaml", pp.picks.PickWeights(clearance=0, limit_margin=0, manipulability=0))
    short = replace(made, budget=replace(ALL, compared=1))
    figures = short.judge(0, picks.picks[0]).stages[-1].figures
    assert figures["complete"] == 1
    verdict = replace(made, budget=replace(ALL, configurations=1)).judge(1, picks.picks[1])
    assert verdict.ok
    assert verdict.stages[-1].figures["untried"] + verdict.stages[-1].figures["excluded"] > 0


def test_the_score_is_made_of_parts_between_0_and_1() -> None:
    made, picks = setup("ur5", "carry.yaml", pp.picks.PickWeights(clearance=2.0, duration=0.5))
    verdict = made.judge(0, picks.picks[0])
    parts = dict(verdict.score)
    total = parts.pop("score")
    assert all(0 <= part <= 1 for part in parts.values())
    assert total == pytest.approx(
        2.0 * parts["clearance"] + parts["limit_margin"] + parts["manipulability"] + 0.5 * parts["duration"]
    )


@pytest.mark.slow
@pytest.mark.parametrize(("xyz", "yaw"), [((0.371, -0.403, 0.192), -0.97), ((0.406, -0.305, 0.217), -0.67)])
def test_the_best_release_is_taken_and_not_the_nearest(monkeypatch, xyz, yaw) -> None:
    made, picks = setup("ur5", "carry.yaml", pp.picks.PickWeights(duration=0.2))
    first = picks.picks[0]
    drop = replace(first.place, frame="", pose=pp.pose(xyz, (np.pi, 0, yaw)))
    pick = replace(first, place=drop)
    best = search(made, pick, bounded=True).best
    every, place = Placer.releases, Placer.place
    count = len(every(Placer(PickTask(pick, made.cell), SEEDS[0]), next(iter(PickTask(pick, made.cell).groups()))[0]))
    assert count > 1
    scores = []
    for index in range(count):

        def only(self: Placer, *args: object, k: int = index):
            """Puts down at one release; all others stay known, since scores refer to them."""
            self.releases = lambda member: every(self, member)[k : k + 1]
            try:
                return place(self, *args)
            finally:
                del self.releases

        monkeypatch.setattr(Placer, "place", only)
        if (alone := search(made, pick, bounded=True).best) is not None:
            scores.append(alone.parts["score"])
    assert len(scores) > 1
    assert best.parts["score"] == pytest.approx(max(scores), abs=1e-9)


def test_the_bound_of_a_configuration_holds_for_its_best_full_rotations() -> None:
    made, picks = setup("ur5", "picks.yaml", pp.picks.PickWeights(clearance=0, manipulability=0, duration=0))
    task = PickTask(picks.picks[0], made.cell)
    ring = next(iter(task.groups()))
    candidate = screen(task, ring, reach(task, ring, 0)).candidates[0]
    lower, upper = task.arm.limits.lower, task.arm.limits.upper
    turned = candidate.q + 2 * np.pi * np.array(list(product(range(-2, 3), repeat=6)))
    inside = turned[((turned >= lower) & (turned <= upper)).all(axis=1)]
    margins = (np.minimum(inside - lower, upper - inside) / ((upper - lower) / 2)).min(axis=1)
    assert margins.max() > margins.min() + 0.1
    candidates = tuple(replace(candidate, q=q) for q in inside)
    bounds = Scoring.of(task, candidates, Placer(task, 0).rest).bounds
    np.testing.assert_allclose(bounds, np.full(len(inside), margins.max()), atol=1e-12)
