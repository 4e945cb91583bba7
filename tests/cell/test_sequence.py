"""Sequences of picks: the shortest order against brute force, scenes of the moment, certificates and bad input."""

from __future__ import annotations

import csv
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import palletising_cell
import pytest

import pinproof as pp
from pinproof.cell import SequenceResult
from pinproof.cell.sequencing import sequence as sequencing
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.cell.sequencing.sequence import SequenceRun, judge_options
from pinproof.cell.sequencing.tour import TourProblem, arc_bound
from pinproof.cell.sequencing.transits import (
    MotionFailure,
    SequencedPick,
    StepMotions,
    closing_motion,
    scene_after,
)
from pinproof.description import robots_folder
from pinproof.picks import GraspSpin, GripperFingers, PickBudget, PickSetup, PickVerdict, PlaceTarget, SuctionCup

ROOT = Path(__file__).parents[2]
DOWN = (np.pi, 0.0, 0.0)
SIDE = 0.05
Place = tuple[float, float, float]


def random_problem(jobs: int, options: int, pairs: int, seed: int) -> TourProblem:
    rng = np.random.default_rng(seed)
    job = np.repeat(np.arange(jobs), options)
    at, to = rng.uniform(0, 1, (2, len(job), 2))
    reasons = {tuple(sorted(rng.choice(jobs, 2, replace=False).tolist())): "stated" for _ in range(pairs)}
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
    here, between = at[shuffled], between[np.ix_(shuffled, shuffled)]
    problem = TourProblem(np.arange(24), here, 1.0 - here, np.ones(24), between, Precedence(names, reasons))
    found = problem.solve()
    assert found.seconds == pytest.approx(25.0, abs=1e-9)
    assert 0.95 * 25.0 <= problem.lower_bound() <= 25.0 + 1e-9
    assert problem.precedence.allows(found.order)


@pytest.mark.parametrize("seed", range(6))
def test_no_allowed_reversal_or_move_makes_an_improved_tour_shorter(seed: int) -> None:
    problem = random_problem(12, 2, 4 * (seed % 3), seed)
    first = problem.best_options(tuple(range(12)))
    found = problem.improved(first)
    assert found.seconds == pytest.approx(problem.seconds(found.options), abs=1e-12)
    assert problem.precedence.allows(found.order)
    assert found.seconds <= first.seconds
    assert problem.best_options(found.order).seconds >= found.seconds - 1e-9
    pairs = problem.precedence.reasons
    tour = list(found.options)
    for i, option in enumerate(tour):
        rest = tour[:i] + tour[i + 1 :]
        others = [[*rest[:k], each, *rest[k:]] for k in range(12) for each in problem.options[problem.job[option]]]
        for j in range(i + 2, 13):
            part, apart = tour[i:j], tour[:i] + tour[j:]
            inside = {int(problem.job[each]) for each in part}
            if not any(a in inside and b in inside for a, b in pairs):
                others.append([*tour[:i], *part[::-1], *tour[j:]])
                if j - i <= 8:
                    others += [[*apart[:k], *part, *apart[k:]] for k in range(len(apart) + 1)]
        for other in others:
            allowed = problem.precedence.allows([int(problem.job[each]) for each in other])
            assert not (allowed and problem.seconds(other) < found.seconds - 1e-9)


@pytest.mark.slow
def test_optimum_of_ten_jobs_is_found_by_the_search_and_not_below_the_bound() -> None:
    for seed in range(4):
        problem = random_problem(10, 3, 3 * seed, seed)
        first = problem.best_options(tuple(range(10)))
        searched = problem._searched(first, np.random.default_rng(0).random((300, 8)))
        assert searched.seconds == pytest.approx(problem.exact().seconds, abs=1e-9)
        bounds = [arc_bound(problem.times_of_arcs(), problem.job, np.array(first.options), k) for k in (1, 12)]
        assert 0.5 * searched.seconds < bounds[0] <= bounds[1] <= searched.seconds + 1e-9
        assert seed or bounds[1] > 0.95 * searched.seconds


def test_greedy_tour_continues_with_the_nearest_option_that_the_precedence_permits() -> None:
    problem = random_problem(8, 3, 4, 2)
    tour, done = problem.greedy(), set[int]()
    before, reach = problem.precedence.predecessors(), problem.start
    for job, option in zip(tour.order, tour.options, strict=True):
        others = [k for k in range(24) if problem.job[k] not in done and before[problem.job[k]] <= done]
        assert problem.job[option] == job
        assert reach[option] == min(reach[others])
        done.add(job)
        reach = problem.between[option]
    assert tour.seconds == pytest.approx(problem.seconds(tour.options), abs=1e-12)
    assert problem.nearest_neighbour().order == tour.order
    assert problem.nearest_neighbour().seconds <= tour.seconds


def test_contradictory_precedence_names_a_cycle() -> None:
    with pytest.raises(pp.InputError, match=r"a before b .*b before c .*c before a"):
        Precedence.stated("abcd", [("a", "b"), ("b", "c"), ("c", "a"), ("a", "d")])


def cell(picks: pp.Picks, scene: pp.Scene) -> PickSetup:
    arm = pp.load_robot("ur5").arm(tcp="tool0")
    return PickSetup.make(arm, scene, picks, home=None, rng=0, budget=PickBudget(remedies=0, motion=40))


def boxes(*places: Place) -> list[pp.Obstacle]:
    box = pp.Box(SIDE, SIDE, SIDE)
    return [pp.Obstacle(f"box_{k}", box, pp.pose(place)) for k, place in enumerate(places)]


TABLE = pp.Obstacle("table", pp.Box(1.6, 1.6, 0.04), pp.pose((0.3, 0, -0.025)))
ROD = pp.Obstacle("lance", pp.Cylinder(radius=0.01, length=0.15), pp.pose((0, 0, 0.075)))
LANCE = {"tip": pp.pose((0, 0, 0.15)), "tool": (ROD,), "cup": SuctionCup(radius=0.01), "margin": 0.002}


def tray_cell(before: list[Place], after: list[Place]) -> tuple[PickSetup, tuple[pp.Pick, ...]]:
    """A UR5 with a suction cup and boxes, each with its place."""
    picks = []
    for k, ends in enumerate(zip(before, after, strict=True)):
        grasp, release = (pp.pose(np.add(at, (0, 0, SIDE / 2)), DOWN) for at in ends)
        place = PlaceTarget(release, approach=0.06, retreat=0.06)
        picks.append(pp.Pick(f"pick_{k}", grasp, approach=0.06, retreat=0.07, carried=f"box_{k}", place=place))
    scene = pp.Scene([TABLE, *boxes(*before)], allowed=[("base_link", "table")])
    return cell(pp.Picks(picks, **LANCE), scene), tuple(picks)


FLOOR = SIDE / 2 - 0.005
STACK = [(0.45, 0.25, FLOOR), (0.45, 0.25, FLOOR + SIDE), (0.35, 0.35, FLOOR)]
PALLET = [(0.45, -0.25, FLOOR + SIDE), (0.45, -0.25, FLOOR), (0.36, -0.30, FLOOR)]


@pytest.fixture(scope="module")
def stacked() -> SequenceResult:
    """box_1 is on box_0, and at the places box_0 is on box_1."""
    setup, picks = tray_cell(STACK, PALLET)
    return pp.sequence(setup, picks, grip_dwell=0.2, release_dwell=0.1)


@pytest.mark.slow
def test_part_is_picked_before_its_support_and_placed_after_it(stacked: SequenceResult) -> None:
    assert stacked.ok
    assert stacked.order.index("pick_1") < stacked.order.index("pick_0")
    reasons = {(stacked.precedence.names[a], stacked.precedence.names[b]) for a, b in stacked.precedence.reasons}
    assert ("pick_1", "pick_0") in reasons
    # Parts move with the sequence
    at, target = ({f"box_{k}": np.array(place) for k, place in enumerate(places)} for places in (STACK, PALLET))
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
    assert sum(stacked.by_phase.values()) == pytest.approx(stacked.duration, abs=1e-6)
    assert all(step.shortest <= step.duration + 1e-9 for step in stacked)


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
    setup, picks = tray_cell(STACK, PALLET)
    no_refinement = pp.cell.SequenceBudget(refinements=0)
    kept = pp.sequence(setup, picks, order=["pick_2", "pick_1", "pick_0"], budget=no_refinement)
    assert kept.order == ("pick_2", "pick_1", "pick_0")
    first = picks[0]
    for some, settings, named in (
        (picks, {"order": ["pick_0", "pick_1", "pick_2"]}, "pick_1 must come before pick_0"),
        (picks, {"precedence": [("pick_9", "pick_0")]}, "pick_9"),
        (picks, {"precedence": [("pick_0", "pick_1", "pick_2")]}, r"precedence\[0\].*pair of names"),
        (picks, {"precedence": ["pick_0"]}, r"precedence\[0\].*pair of names"),
        (picks, {"budget": PickBudget()}, "budget must be of type SequenceBudget"),
        ([first, first], {}, "repeated: pick_0"),
        ([first, replace(first, name="again")], {}, "same object 'box_0'"),
        ([replace(first, place=None)], {}, "no place"),
    ):
        with pytest.raises((pp.InputError, pp.UnknownNameError), match=named):
            pp.sequence(setup, some, **settings)


@pytest.mark.slow
def test_motions_are_certified_again_in_a_new_setup_of_their_moment(stacked: SequenceResult) -> None:
    setup = stacked.setup
    for step in stacked:
        fresh = PickSetup.make(setup.checker.arm, step.scene, setup.shared, home=None, rng=1)
        certificates = fresh.recertify(step.program(), step.verdict.pick)
        assert [each.free for each in certificates] == [True] * 6
        assert {event.kind: event.dwell for event in step.program().events} == {"grip": 0.2, "release": 0.1}
    # The motions of the last step cannot be certified in the scene before the first one
    last = list(stacked)[-1]
    certificates = setup.recertify(last.program(), last.verdict.pick)
    assert last.pick.name == "pick_0"  # box_1 is on its part at first
    assert not all(each.free for each in certificates)


@pytest.mark.slow
def test_pick_that_fails_is_left_out_with_those_that_must_follow_it() -> None:
    setup, picks = tray_cell(STACK, PALLET)
    far = replace(picks[1], place=replace(picks[1].place, pose=pp.pose((3.0, 0.0, 0.3), DOWN)))
    result = pp.sequence(setup, [picks[0], far, picks[2]])
    assert result.order == ("pick_2",)
    assert not result.ok
    reasons = {each.name: each.reason for each in result.left_out}
    assert reasons["pick_1"].startswith("place:")
    assert "pick_1" in reasons["pick_0"]
    with pytest.raises(pp.PinproofError, match="pick_1"):
        result.or_raise()


@pytest.mark.slow
def test_order_that_failed_motions_suggest_does_not_raise_the_lower_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    setup, picks = tray_cell([(0.5, 0.0, FLOOR), (0.3, 0.4, FLOOR), (0.3, -0.4, FLOOR)], [(0.6, 0.2, FLOOR)] * 3)
    places = (pp.pose((x, y, SIDE), DOWN) for x, y in [(0.3, 0.5), (0.45, -0.3), (0.6, 0.2)])
    picks = [replace(pick, place=replace(pick.place, pose=at)) for pick, at in zip(picks, places, strict=True)]
    alone = pp.sequence(setup, picks[1:])
    first, second = alone.order
    certified, reported = StepMotions.certified, set[str]()

    def failing(self: StepMotions, step: SequencedPick) -> PickVerdict | MotionFailure:
        name = step.option.pick.name
        if name == "pick_0":
            return MotionFailure("transfer", "not certified")
        if name == first and name not in reported:
            reported.add(name)
            return MotionFailure("transfer", "in contact", (f"box_{second[-1]}",))
        return certified(self, step)

    monkeypatch.setattr(StepMotions, "certified", failing)
    result = pp.sequence(setup, picks)
    assert [each.name for each in result.left_out] == ["pick_0"]
    assert result.order == (second, first)
    assert result.lower_bound == pytest.approx(alone.lower_bound, abs=1e-9)


def scattered() -> tuple[PickSetup, list[pp.Pick]]:
    """Three boxes that are apart, as their places are."""
    before, after = [(0.5, 0.0), (0.3, 0.4), (0.3, -0.4)], [(0.3, 0.5), (0.45, -0.3), (0.6, 0.2)]
    setup, picks = tray_cell(*([(*at, FLOOR) for at in places] for places in (before, after)))
    return setup, list(picks)


def test_the_order_that_one_option_demands_does_not_exclude_the_other_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another part always blocks the first option of pick_1, and the second one is possible before pick_0 only."""
    setup, picks = scattered()
    certified, options = StepMotions.certified, list[np.ndarray]()

    def blocked(self: StepMotions, step: SequencedPick) -> PickVerdict | MotionFailure:
        if step.option.pick.name != "pick_1":
            return certified(self, step)
        options.append(step.option.entrance)
        moved = not step.scene["box_0"].pose.isApprox(setup.checker.scene["box_0"].pose)
        if np.array_equal(options[0], step.option.entrance):
            return MotionFailure("approach", "in contact", ("box_2" if moved else "box_0",))
        return MotionFailure("approach", "in contact", ("box_0",)) if moved else certified(self, step)

    monkeypatch.setattr(StepMotions, "certified", blocked)
    budget = pp.cell.SequenceBudget(options=2, motion=0, refinements=0)
    result = pp.sequence(setup, picks, budget=budget).or_raise()
    assert result.order.index("pick_1") < result.order.index("pick_0")
    assert result.precedence.allows(picks.index(step.pick) for step in result)

    # without its second option it is left out, with the number of orders that were tried
    result = pp.sequence(setup, picks, budget=replace(budget, options=1))
    (left,) = result.left_out
    assert left.name == "pick_1"
    assert "in 6 other orders" in left.reason


def test_a_better_order_that_cannot_be_certified_leaves_out_no_pick(monkeypatch: pytest.MonkeyPatch) -> None:
    certified, tours = SequenceRun._certified, list[object]()

    def failing(self: SequenceRun, problem: TourProblem, *rest):
        tours.append(rest)
        if len(tours) == 2:
            self.precedence = self.precedence.with_pairs({(0, 1): "a part blocks", (1, 2): "a part blocks"})
            raise sequencing._ImpossibleError({0: "in contact"})
        return certified(self, problem, *rest)

    monkeypatch.setattr(SequenceRun, "_certified", failing)
    monkeypatch.setattr(sequencing, "WORTH", -1.0)  # every order is worth a try
    result = pp.sequence(*scattered(), budget=pp.cell.SequenceBudget(options=1, motion=0, refinements=1))
    assert len(tours) == 2
    assert len(result.or_raise().steps) == 3
    assert not result.precedence.reasons


@pytest.mark.slow
def test_interrupted_search_returns_the_certified_beginning() -> None:
    def stop(work: str, done: int, _: int) -> None:
        if work == "motions" and done == 2:
            raise KeyboardInterrupt

    with pytest.raises(pp.errors.RunInterrupted) as caught:
        pp.sequence(*tray_cell(STACK, PALLET), progress=stop)
    result = caught.value.result
    assert (len(result.steps), result.interrupted, result.complete) == (2, True, False)
    assert all(motion.certificate.free for motion in result.motions)


@pytest.mark.slow
def test_sequence_does_not_depend_on_the_number_of_workers(stacked: SequenceResult) -> None:
    setup, picks = tray_cell(STACK, PALLET)
    with ThreadPoolExecutor(2) as executor:
        shared = pp.sequence(setup, picks, grip_dwell=0.2, release_dwell=0.1, executor=executor)
    assert shared.order == stacked.order
    for one, other in zip(stacked.motions, shared.motions, strict=True):
        assert one.trajectory.digest() == other.trajectory.digest()
        assert one.certificate.clearance == other.certificate.clearance
    assert shared.or_raise().lower_bound == stacked.lower_bound


@pytest.mark.slow
def test_free_ends_have_no_motion_to_home_and_parts_of_a_pick_may_be_slower() -> None:
    setup, picks = tray_cell(STACK[2:], PALLET[2:])
    free = pp.sequence(setup, picks, start="free", end="free")
    assert free.closing is None
    assert free.motions[0].trajectory.duration == 0.0
    assert free.moving < pp.sequence(setup, picks).moving
    slow = replace(picks[0], speed={"approach": pp.picks.ToolSpeed(linear_speed=0.01)})
    (step,) = pp.sequence(setup, [slow])
    assert step.by_phase["approach"] >= 6.0 - 1e-6  # 60 mm
    assert step.limited_by == "approach: tool speed"


@pytest.mark.slow
def test_options_behind_a_post_beside_the_base_are_reached_by_a_full_rotation() -> None:
    """A bolt at the foot of the UR5 blocks its upper arm, so that the shoulder cannot pass this angle."""
    bolt = pp.Obstacle("bolt", pp.Cylinder(radius=0.008, length=0.04), pp.pose((0.13, 0.06, 0.015)))
    pick = pp.Pick("pick", pp.pose((0.5, 0.1, 0.2), DOWN), approach=0.05, retreat=0.05)
    place = PlaceTarget(pp.pose((0.45, 0.2, 0.2), DOWN), approach=0.05, retreat=0.05)
    carried = pp.Obstacle("part", pp.Sphere(radius=0.02), pp.pose((0, 0, 0.024)))
    picks = [pick, replace(pick, name="placed", carried=carried, place=place)]
    behind = 0
    for obstacles in ([], [bolt]):
        setup = cell(pp.Picks(picks, margin=0.002), pp.Scene(obstacles))
        jobs = judge_options(setup, picks, pp.cell.SequenceBudget(options=8)).jobs
        assert len(jobs) == 2
        ends = np.array([[option.entrance, option.exit] for job in jobs for option in job.options]).reshape(-1, 6)
        assert all(pp.RrtConnect(max_nodes=2000).plan(setup.checker, setup.home, q, rng=1).ok for q in ends)
        assert setup.checker.arm.limits.inside(ends).all()
        behind = int((np.abs(ends[:, 0]) > np.pi).sum())
        assert bool(behind) is bool(obstacles)


@pytest.mark.slow
def test_files_have_every_pick_in_order(stacked: SequenceResult, tmp_path: Path) -> None:
    for suffix in pp.cell.SequenceResult.formats:
        stacked.save(tmp_path / f"cell{suffix}")
    with (tmp_path / "cell.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(row["pick"] for row in rows) == stacked.order
    assert float(rows[-1]["start"]) + float(rows[-1]["duration"]) == pytest.approx(list(stacked)[-1].end, abs=1e-9)
    content = json.loads((tmp_path / "cell.json").read_text(encoding="utf-8"))
    assert tuple(step["name"] for step in content["steps"]) == stacked.order
    seconds = sum(phase["duration"] for step in content["steps"] for phase in step["phases"])
    assert seconds == pytest.approx(content["duration"] - content["closing"], abs=1e-6)
    with pytest.raises(pp.InputError, match=r"cell\.txt"):
        stacked.save(tmp_path / "cell.txt")


def test_the_files_of_the_palletising_cell_are_up_to_date() -> None:
    for path, text in palletising_cell.files().items():
        assert path.read_text(encoding="utf-8") == text
    picks = pp.read_picks(ROOT / "robots" / "ur10" / "pallet_picks.yaml")
    assert len(picks) == 200
    assert not picks.problems


def test_object_that_rotates_with_the_tcp_is_placed_as_its_option_rotates_it() -> None:
    bar = pp.Obstacle("bar", pp.Box(0.2, 0.03, 0.03), pp.pose((0, 0, 0.016)))
    place = PlaceTarget(pp.pose((0.45, -0.2, 0.05), DOWN), approach=0.06, retreat=0.06)
    spin = GraspSpin((0.0, np.pi / 2))
    pick = pp.Pick("pick", pp.pose((0.45, 0.2, 0.05), DOWN), spin=spin, carried=bar, place=place)
    shared = pp.Picks([pick], **LANCE)
    setup = cell(shared, pp.Scene([TABLE], allowed=[("base_link", "table")]))
    (job,) = judge_options(setup, [pick], pp.cell.SequenceBudget(options=8)).jobs
    assert len(job.places) == 2
    for option in job.options:
        tip = setup.checker.arm.forward_kinematics(option.release.q) * shared.tip
        placed = scene_after(setup.checker.scene, job, option)["bar"]
        assert placed.pose.isApprox(tip * bar.pose, 1e-6)


def test_a_pick_is_in_the_sequence_though_its_nearest_releases_are_in_contact() -> None:
    picks = pp.read_picks(robots_folder() / "ur5" / "carry.yaml")
    only = replace(picks, picks=tuple(pick for pick in picks.picks if pick.name == "over_the_wall"))
    setup = pp.picks.PickSetup.make(only.load_arm(), only.load_scene(), only, home=None, rng=0)
    result = pp.sequence(setup, only.picks)
    assert result.order == ("over_the_wall",)
    assert not result.left_out


@pytest.mark.parametrize("pin", ["beside the block", "beside its place"])
def test_fingers_that_close_and_open_do_not_pass_through_parts_of_other_picks(pin: str) -> None:
    """The pin is between the open and the closed finger, so that neither end of the closing motion touches it."""
    fingers = tuple(
        pp.Obstacle(f"f{k}", pp.Box(0.015, 0.01, 0.05), pp.pose((0, y, 0.13))) for k, y in ((1, 0.005), (2, -0.005))
    )
    places = (
        [(0.45, 0.228, 0.022), (0.6, 0.0, 0.022)]
        if pin == "beside the block"
        else [(0.6, 0.0, 0.022), (0.45, -0.172, 0.022)]
    )
    picks = []
    for name, (at, to), yaw in (("block", [(0.45, 0.2, 0.022), (0.45, -0.2, 0.022)], 0.0), ("pin", places, np.pi / 2)):
        grasp, release = (pp.pose(xyz, (np.pi, 0, yaw)) for xyz in (at, to))
        place = PlaceTarget(release, approach=0.08, retreat=0.08)
        picks.append(pp.Pick(name, grasp, approach=0.08, retreat=0.08, carried=name, place=place))
    parts = [
        pp.Obstacle("block", pp.Box(0.02, 0.02, 0.04), pp.pose((0.45, 0.2, 0.017))),
        pp.Obstacle("pin", pp.Cylinder(radius=0.002, length=0.04), pp.pose((*places[0][:2], 0.017))),
    ]
    hand = GripperFingers(bodies=fingers, opening=0.08)
    shared = pp.Picks(picks, tip=pp.pose((0, 0, 0.145)), fingers=hand, margin=0.001)
    setup = cell(shared, pp.Scene([TABLE, *parts], allowed=[("base_link", "table")]))
    only = pp.cell.SequenceBudget(options=1, motion=0, refinements=0)
    possible = ["pin", "block"] if pin == "beside the block" else ["block", "pin"]
    assert pp.sequence(setup, picks, budget=only).or_raise().order == tuple(possible)
    wrong = pp.sequence(setup, picks, budget=only, order=possible[::-1])
    (left,) = wrong.left_out
    assert left.name == "block"
    assert "fingers move: f2 penetrates pin" in left.reason
    assert not wrong.precedence.reasons
    # from where the other pick begins, the impossible order is the shorter one
    jobs = {job.pick.name: job for job in judge_options(setup, picks, only).jobs}
    near = jobs[possible[1]].options[0].entrance
    assert pp.sequence(setup, picks, start=near, end="free", budget=only).or_raise().order == tuple(possible)


def test_objects_that_picks_state_themselves_are_not_covered_before_these_picks() -> None:
    picks = []
    for name, (at, to) in {"first": ((0.5, 0.2), (0.3, -0.45)), "second": ((0.5, 0.0), (0.5, -0.3))}.items():
        grasp, release = (pp.pose((*xy, 0.2), DOWN) for xy in (at, to))
        high = pp.Obstacle(f"of_{name}", pp.Box(0.05, 0.05, 0.2), pp.pose((0, 0, 0.1002)))
        place = PlaceTarget(release, approach=0.06, retreat=0.06)
        picks.append(pp.Pick(name, grasp, approach=0.06, retreat=0.06, carried=high, place=place))
    setup = cell(pp.Picks(picks, **LANCE), pp.Scene([TABLE], allowed=[("base_link", "table")]))
    only = pp.cell.SequenceBudget(options=1, motion=0, refinements=0)
    result = pp.sequence(setup, picks, order=["first", "second"], budget=only).or_raise()
    assert all("of_second" not in motion.scene for motion in result.steps[0].verdict.motions)
    assert any("the objects of second before" in note for note in result.notes)
    assert not any("the objects of" in note for note in pp.sequence(setup, picks[:1], budget=only).notes)


def test_motions_that_are_certified_again_and_the_last_one_have_their_torques() -> None:
    setup, picks = tray_cell(STACK[2:], PALLET[2:])
    setup = replace(setup, shared=replace(setup.shared, torque_limits=True))
    (job,) = judge_options(setup, picks, pp.cell.SequenceBudget(options=1)).jobs
    step = SequencedPick(setup.checker.scene, setup.home, job.options[0], 0, None, {})
    first = StepMotions(setup).certified(step)
    known = {motion.name: motion.trajectory for motion in first.motions}
    again = StepMotions(setup).certified(replace(step, known=known))
    for motion, same in zip(first.motions, again.motions, strict=True):
        assert same.trajectory is motion.trajectory
        assert len(same.torques) == 6
        assert same.torques == motion.torques
    scene, q = scene_after(step.scene, job, step.option), step.option.exit
    made = closing_motion(setup, scene, q, setup.home, {}, picks[0])
    kept = closing_motion(setup, scene, q, setup.home, {"transit": made.trajectory}, picks[0])
    assert made.torques
    assert kept.torques == made.torques
