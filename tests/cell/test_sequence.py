"""Sequences of picks: the shortest order against brute force, scenes of the moment, certificates and bad input."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell import SequenceResult
from pinproof.cell.precedence import Precedence
from pinproof.cell.tour import TourProblem
from pinproof.errors import UnknownNameError
from pinproof.picks import PickBudget, PickSetup, PlaceTarget, SuctionCup

ROOT = Path(__file__).parents[2]
DOWN = (np.pi, 0.0, 0.0)
SIDE = 0.05


def random_problem(jobs: int, options: int, pairs: int, seed: int) -> TourProblem:
    rng = np.random.default_rng(seed)
    job = np.repeat(np.arange(jobs), options)
    at, to = rng.uniform(0, 1, (2, len(job), 2))
    reasons = {}
    for _ in range(pairs):
        a, b = sorted(rng.choice(jobs, 2, replace=False).tolist())
        reasons[a, b] = "stated"
    names = tuple(f"p{k}" for k in range(jobs))
    between = np.linalg.norm(to[:, None] - at[None], axis=2)
    start, end = np.linalg.norm(at, axis=1), np.linalg.norm(to, axis=1)
    return TourProblem(job, start, end, rng.uniform(0, 1, len(job)), between, Precedence(names, reasons))


def brute_force(problem: TourProblem) -> float:
    orders = (order for order in permutations(range(problem.count)) if problem.precedence.allows(order))
    return min(problem.best_options(order).seconds for order in orders)


@pytest.mark.parametrize("seed", range(4))
def test_small_tour_is_the_best_of_all_orders(seed: int) -> None:
    problem = random_problem(6, 3, 4, seed)
    found = problem.solve()
    assert found.seconds == pytest.approx(brute_force(problem), abs=1e-12)
    assert problem.seconds(found.options) == pytest.approx(found.seconds, abs=1e-12)
    assert problem.precedence.allows(found.order)
    assert problem.lower_bound() == pytest.approx(found.seconds, abs=1e-12)


def test_options_of_an_order_are_the_best_of_all_choices() -> None:
    problem = random_problem(4, 3, 0, 7)
    order = (2, 0, 3, 1)
    choices = np.array(np.meshgrid(*(problem.options[job] for job in order))).reshape(4, -1).T
    assert problem.best_options(order).seconds == pytest.approx(min(map(problem.seconds, choices)), abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("pairs", [0, 20])
def test_search_finds_the_optimum_of_a_line_of_jobs(pairs: int) -> None:
    """On a line the best tour visits the jobs in order of their position; 24 jobs are too many for the exact method."""
    at = np.linspace(0.1, 1.0, 24)
    names = tuple(map(str, range(24)))
    between = np.abs(at[:, None] - at[None])
    reasons = {(k, k + 3): "stated" for k in range(pairs)}
    shuffled = np.random.default_rng(1).permutation(24)
    back = np.argsort(shuffled)
    reasons = {(int(back[a]), int(back[b])): why for (a, b), why in reasons.items()}
    problem = TourProblem(
        np.arange(24), at[shuffled], 1.0 - at[shuffled], np.ones(24), between[np.ix_(shuffled, shuffled)],
        Precedence(names, reasons),
    )  # fmt: skip
    found = problem.solve()
    assert found.seconds == pytest.approx(25.0, abs=1e-9)
    assert problem.lower_bound() <= 25.0 + 1e-9
    assert problem.lower_bound() >= 0.95 * 25.0
    assert problem.precedence.allows(found.order)


def test_contradictory_precedence_names_a_cycle() -> None:
    with pytest.raises(pp.InputError, match=r"a before b .*b before c .*c before a"):
        Precedence.stated("abcd", [("a", "b"), ("b", "c"), ("c", "a"), ("a", "d")])


def cell(picks: pp.Picks, scene: pp.Scene) -> PickSetup:
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    return PickSetup.make(arm, scene, picks, home=None, rng=0, budget=PickBudget(remedies=0, motion=40))


def boxes(*places: tuple[float, float, float]) -> list[pp.Obstacle]:
    box = pp.Box(SIDE, SIDE, SIDE)
    return [pp.Obstacle(f"box_{k}", box, pp.pose(place)) for k, place in enumerate(places)]


def tray_cell(before: list[tuple[float, float, float]], after: list[tuple[float, float, float]]) -> PickSetup:
    """A UR5 with a suction cup and boxes, each with its place."""
    table = pp.Obstacle("table", pp.Box(1.6, 1.6, 0.04), pp.pose((0.3, 0, -0.025)))
    picks = [
        pp.Pick(
            f"pick_{k}",
            pp.pose((x, y, z + SIDE / 2), DOWN),
            approach=0.06,
            retreat=0.07,
            carried=f"box_{k}",
            place=PlaceTarget(pp.pose(np.add(to, (0, 0, SIDE / 2)), DOWN), approach=0.06, retreat=0.06),
        )
        for k, ((x, y, z), to) in enumerate(zip(before, after, strict=True))
    ]
    lance = pp.Obstacle("lance", pp.Cylinder(radius=0.01, length=0.15), pp.pose((0, 0, 0.075)))
    shared = pp.Picks(picks, tip=pp.pose((0, 0, 0.15)), tool=(lance,), cup=SuctionCup(radius=0.01), margin=0.002)
    scene = pp.Scene([table, *boxes(*before)], allowed=[("base_link", "table")])
    setup = cell(shared, scene)
    object.__setattr__(setup, "given", tuple(picks))
    return setup


FLOOR = SIDE / 2 - 0.005
STACK = [(0.45, 0.25, FLOOR), (0.45, 0.25, FLOOR + SIDE), (0.35, 0.35, FLOOR)]
PALLET = [(0.45, -0.25, FLOOR + SIDE), (0.45, -0.25, FLOOR), (0.36, -0.30, FLOOR)]


@pytest.fixture(scope="module")
def stacked() -> SequenceResult:
    """box_1 is on box_0, and at the places box_0 is on box_1."""
    setup = tray_cell(STACK, PALLET)
    return pp.sequence(setup, setup.given, grip_dwell=0.2, release_dwell=0.1)  # type: ignore[attr-defined]


@pytest.mark.slow
def test_part_is_picked_before_its_support_and_placed_after_it(stacked: SequenceResult) -> None:
    assert stacked.ok
    assert stacked.order.index("pick_1") < stacked.order.index("pick_0")
    reasons = {(stacked.precedence.names[a], stacked.precedence.names[b]) for a, b in stacked.precedence.reasons}
    assert ("pick_1", "pick_0") in reasons


@pytest.mark.slow
def test_parts_move_with_the_sequence(stacked: SequenceResult) -> None:
    at = {name: np.array(place) for name, place in zip(("box_0", "box_1", "box_2"), STACK, strict=True)}
    target = {name: np.array(place) for name, place in zip(("box_0", "box_1", "box_2"), PALLET, strict=True)}
    for step in stacked:
        carried = str(step.pick.carried)
        for name, place in at.items():
            assert np.allclose(step.scene[name].pose.translation, place, atol=1e-9)
        for motion in step.verdict.motions:
            holding = motion.name in ("retreat", "transfer", "place")
            assert (carried in motion.scene.names) is not holding
            assert (carried in {thing.name for thing in motion.attached}) is holding
        at[carried] = target[carried]
        assert np.allclose(step.verdict.motions[-1].scene[carried].pose.translation, at[carried], atol=1e-9)


@pytest.mark.slow
def test_motions_are_joined_and_add_up_to_the_total_time(stacked: SequenceResult) -> None:
    motions = stacked.motions
    assert np.array_equal(motions[0].trajectory.start, stacked.setup.home)
    assert np.array_equal(motions[-1].trajectory.end, stacked.setup.home)
    for before, after in pairwise(motions):
        assert np.allclose(before.trajectory.end, after.trajectory.start, atol=1e-12)
    seconds = sum(motion.trajectory.duration for motion in motions)
    assert stacked.moving == pytest.approx(seconds, abs=1e-6)
    assert stacked.duration == pytest.approx(seconds + 3 * (0.2 + 0.1), abs=1e-6)
    assert stacked.lower_bound <= seconds + 1e-6
    times = pp.cell.cycle_time(stacked)
    assert sum(times.by_phase.values()) == pytest.approx(stacked.duration, abs=1e-6)
    assert all(pick.shortest <= pick.duration + 1e-9 for pick in times.picks)


@pytest.mark.slow
def test_every_motion_is_free_in_a_new_checker_of_its_moment(stacked: SequenceResult) -> None:
    arm = stacked.setup.checker.arm
    for motion in stacked.motions:
        touching = [("lance", name) for name in motion.scene.names if name.startswith("box")]
        if motion.name in ("transit", "transfer"):
            touching = []
        held = [thing.name for thing in motion.attached if thing.name.startswith("box")]
        touching += [("lance", name) for name in held]
        checker = pp.CollisionChecker(arm, motion.scene, margin=0.002, attached=motion.attached)
        names = set(checker.obstacles_and_links)
        checker = checker.allowing(*(pair for pair in touching if set(pair) <= names))
        if motion.name in ("transit", "transfer", "approach", "leave"):
            assert pp.certify(motion.trajectory, checker).free
            assert pp.audit(motion.trajectory, checker, measure=False).clean
        assert motion.certificate.free


@pytest.mark.slow
def test_given_order_is_kept_and_an_impossible_one_is_refused() -> None:
    setup = tray_cell(STACK, PALLET)
    picks = setup.given  # type: ignore[attr-defined]
    kept = pp.sequence(setup, picks, order=["pick_2", "pick_1", "pick_0"], refinements=0)
    assert kept.order == ("pick_2", "pick_1", "pick_0")
    with pytest.raises(pp.InputError, match="pick_1 must come before pick_0"):
        pp.sequence(setup, picks, order=["pick_0", "pick_1", "pick_2"])
    with pytest.raises(UnknownNameError, match="pick_9"):
        pp.sequence(setup, picks, precedence=[("pick_9", "pick_0")])
    with pytest.raises(pp.InputError, match="repeated: pick_0"):
        pp.sequence(setup, [picks[0], picks[0]])
    with pytest.raises(pp.InputError, match="same object 'box_0'"):
        pp.sequence(setup, [picks[0], replace(picks[0], name="again")])
    with pytest.raises(pp.InputError, match="no place"):
        pp.sequence(setup, [replace(picks[0], place=None)])
