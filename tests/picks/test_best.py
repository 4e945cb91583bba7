"""The best complete motion: bounds of the score exclude only candidates that cannot win; its place and its attempts."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import pinproof as pp
from pinproof.model import JointLimits
from pinproof.motion import CubicPath, JointPath
from pinproof.picks import PickSetup, PickWeights
from pinproof.picks.judging import grasp, lines, place
from pinproof.picks.judging.configurations import at_full_speed, least_seconds
from pinproof.picks.judging.grasp import INSTANT, GraspCandidate, reach, screen
from pinproof.picks.judging.grip import GripResult
from pinproof.picks.judging.judge import BestFirst, Scoring, _Completions, _judge
from pinproof.picks.judging.lines import Attempt, Crossing, ToolLine, along, full_rotations, shifted, span
from pinproof.picks.judging.place import Placer, Release, Scores, release_lines
from pinproof.picks.judging.task import PickTask
from pinproof.picks.judging.verdict import Stage, StageResult

from .conftest import cell_of, named

ALL = pp.picks.PickBudget(configurations=10_000, compared=10_000, remedies=0)
SEEDS = [1, 2]
TURN = 2 * np.pi


def setup(robot: str, file: str, weights: PickWeights | None = None) -> tuple[PickSetup, pp.Picks]:
    arm, scene, picks = cell_of(robot, file)
    return PickSetup.make(arm, scene, picks, home=None, rng=0, weights=weights, budget=ALL), picks


def search(made: PickSetup, pick: pp.Pick, *, bounded: bool) -> BestFirst:
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
        ("ur5", "picks.yaml", "bolt_5", PickWeights(clearance=0, manipulability=0, limit_margin=0)),
        ("ur5", "picks.yaml", "bolt_7", PickWeights(duration=0.2)),
        ("ur5", "carry.yaml", "over_the_wall", None),
        ("generic_6dof", "picks.yaml", None, None),
        ("panda", "picks.yaml", "cube_2", None),
    ],
)
@pytest.mark.slow
def test_the_bound_leaves_the_winner_as_it_is(robot: str, file: str, name: str | None, weights) -> None:
    made, picks = setup(robot, file, weights)
    pick = picks.picks[0] if name is None else named(picks, name)
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
    # An exhausted budget is reported
    made, picks = setup("panda", "picks.yaml", PickWeights(clearance=0, limit_margin=0, manipulability=0))
    short = replace(made, budget=replace(ALL, compared=1))
    figures = short.judge(0, picks.picks[0]).stages[-1].figures
    assert figures["complete"] == 1
    verdict = replace(made, budget=replace(ALL, configurations=1)).judge(1, picks.picks[1])
    assert verdict.ok
    assert verdict.stages[-1].figures["untried"] + verdict.stages[-1].figures["excluded"] > 0


def test_the_score_is_made_of_parts_between_0_and_1() -> None:
    made, picks = setup("ur5", "carry.yaml", PickWeights(clearance=2.0, duration=0.5))
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
    made, picks = setup("ur5", "carry.yaml", PickWeights(duration=0.2))
    first = picks.picks[0]
    drop = replace(first.place, frame="", pose=pp.pose(xyz, (np.pi, 0, yaw)))
    pick = replace(first, place=drop)
    best = search(made, pick, bounded=True).best
    every, place = Placer.releases, Placer.search
    count = len(every(Placer(PickTask(pick, made.cell), SEEDS[0]), next(iter(PickTask(pick, made.cell).groups()))[0]))
    assert count > 1
    scores = []
    for index in range(count):

        def only(self: Placer, *args: object, k: int = index):
            """Puts down at one release; all others stay known, since scores refer to them."""
            found = place(self, *args)
            found._queue = [each for each in found._queue if found._tried[each[1]] == k]
            return found

        monkeypatch.setattr(Placer, "search", only)
        if (alone := search(made, pick, bounded=True).best) is not None:
            scores.append(alone.parts["score"])
    assert len(scores) > 1
    assert best.parts["score"] == pytest.approx(max(scores), abs=1e-9)


def test_the_bound_of_a_configuration_holds_for_its_best_full_rotations() -> None:
    made, picks = setup("ur5", "picks.yaml", PickWeights(clearance=0, manipulability=0, duration=0))
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


# -- the parts of a place, compared with dense samples of its lines ----------------------------------------------------


@pytest.fixture(scope="module")
def task() -> PickTask:
    cell = cell_of("ur5", "carry.yaml", "over_the_wall")
    return PickTask(cell[2].picks[0], PickSetup.make(*cell, home=None, rng=0).cell)


@pytest.fixture(scope="module")
def releases(task) -> list[Release]:
    """The possible releases of the nearest grasp."""
    member = task.nearest_group[0]
    found = [release_lines(task, task.place, member, q) for q in Placer(task, 0).releases(member)]
    return [each for each in found if not each.why]


@pytest.fixture(scope="module")
def attempt(task) -> Attempt:
    group = task.nearest_group
    return along(task, screen(task, group, reach(task, group, 0)).candidates[0])


def test_the_lines_of_a_release_have_the_clearance_of_the_closer_one_and_end_at_the_stated_poses(
    task, releases, monkeypatch
) -> None:
    member, arm, release = task.nearest_group[0], task.arm, releases[0]
    at = task.release(member)
    ends = (release.q, at), (release.lift.end, task.place.before(at)), (release.leave.end, task.place.after(at))
    for q, wanted in ends:
        tip = arm.root_from_base * arm.forward_kinematics(q) * task.cell.shared.tip
        np.testing.assert_allclose(tip.homogeneous, wanted.homogeneous, atol=1e-5)
    carrying, dense = task.carrying(member).allowing(*release.parting), np.linspace(0.0, 1.0, 100)
    observed = min(
        checker.clearance(each)
        for checker, line in ((carrying, release.lift), (task.letting_go(member), release.leave))
        for each in line(dense)
    )
    assert release.proven <= observed + 1e-9
    assert release.clearance == pytest.approx(observed, abs=2e-3)
    for each in ((0.01, 0.03), (0.03, 0.01)):
        lines = iter([ToolLine(StageResult(Stage.PLACE, True, "", {"clearance": c}), None, 1.0, c + 0.1) for c in each])
        monkeypatch.setattr(place, "line", lambda *args, lines=lines, **settings: next(lines))
        found = release_lines(task, task.place, member, release.q)
        assert (found.proven, found.clearance) == (0.01, pytest.approx(0.11))


def test_a_transfer_ends_at_full_rotations_that_keep_the_lines_of_the_release_within_the_limits(
    task, releases, attempt
) -> None:
    assert attempt.passed
    limits, placer, tried = task.arm.limits, Placer(task, 0), 0
    for down in releases:
        for shift in full_rotations(task.arm, task.cell.home, attempt)[:4]:
            turned = attempt.turned(shift)
            result, placing = placer.transfer(task.place, turned, down, SEEDS, placer.goals(turned, down))
            if placing is None:
                continue
            tried += 1
            polygon = np.vstack([line.bezier()[1].reshape(-1, 6) for line in (down.lift, down.leave)])
            low, high = polygon.min(axis=0), polygon.max(axis=0)
            nearest = min(
                np.abs(down.entrance + by - placing.transfer.start).max()
                for by in 2 * np.pi * np.array(list(product((-1, 0, 1), repeat=6)))
                if (low + by >= limits.lower).all() and (high + by <= limits.upper).all()
            )
            assert np.abs(placing.transfer.end - placing.transfer.start).max() <= nearest + 1e-9
            np.testing.assert_allclose(placing.transfer.start, attempt.exit + shift, atol=1e-9)
            np.testing.assert_allclose(placing.transfer.end, placing.lift.end, atol=1e-9)
            turns = (placing.lift.start - down.q) / (2 * np.pi)
            np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
            for line in (placing.lift, placing.leave):
                np.testing.assert_allclose(line.start, placing.lift.start, atol=1e-9)
                points = line(np.linspace(0.0, 1.0, 50))
                assert (points >= limits.lower - 1e-9).all()
                assert (points <= limits.upper + 1e-9).all()
            assert result.figures["clearance"] <= down.proven
    assert tried > 2
    assert placer.place(attempt, SEEDS, Scores())[1] is not None


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_the_score_of_a_complete_motion_counts_every_part_of_it(task, releases, attempt, side) -> None:
    arm, limits, release = task.arm, task.arm.limits, releases[0]
    candidates = screen(task, task.nearest_group, reach(task, task.nearest_group, 0)).candidates
    scoring = Scoring.of(task, candidates, Placer(task, 0).rest)
    crossing = JointPath([task.cell.home, attempt.entrance], arm.joint_names)
    scores = _Completions(scoring, attempt, Crossing(StageResult(Stage.TRANSIT, True, ""), attempt, crossing, 0.03))
    # A transfer that passes close to a limit, which only it does
    aside = task.cell.home.copy()
    aside[3] = getattr(limits, side)[3] + (0.2 if side == "lower" else -0.2)
    transfer = JointPath([attempt.exit, aside, release.entrance], arm.joint_names)
    placing = replace(release, transfer=transfer, clearance=0.02)

    def control_polygon(line) -> np.ndarray:
        return line.bezier()[1].reshape(-1, 6)

    picked = [crossing.q, control_polygon(attempt.approach), control_polygon(attempt.retreat)]
    for parts, points in (
        (scores.parts(None), picked),
        (scores.parts(placing), [*picked, transfer.q, control_polygon(release.lift), control_polygon(release.leave)]),
    ):
        seconds = sum((np.abs(np.diff(each, axis=0)) / limits.velocity).max(axis=1).sum() for each in points)
        assert parts["duration"] == pytest.approx((scoring.least + INSTANT) / (seconds + INSTANT), rel=1e-9)
        every = np.vstack(points)
        margins = np.minimum(every - limits.lower, limits.upper - every) / ((limits.upper - limits.lower) / 2)
        assert parts["limit_margin"] == pytest.approx(margins.min(), abs=1e-12)
    assert scores.parts(placing)["limit_margin"] == pytest.approx(0.2 / (2 * np.pi), rel=1e-6)


def test_a_trial_for_the_place_is_good_if_a_release_is_possible(task) -> None:
    cell = task.cell.for_trials(Stage.PLACE)
    assert _judge(task.pick, cell, [1, 2, 3, 4]).ok
    far = replace(task.pick.place, pose=pp.pose((1.2, 0.0, 0.035), (np.pi, 0.0, 0.0)), frame="")
    verdict = _judge(replace(task.pick, place=far), cell, [1, 2, 3, 4])
    assert verdict.failed is Stage.PLACE
    assert verdict.reason.startswith("no IK solution at the release")


def test_a_trial_plans_the_configurations_in_the_order_of_their_rank(task) -> None:
    trial = PickTask(task.pick, task.cell.for_trials(Stage.GRASP))
    candidates = screen(trial, trial.nearest_group, reach(trial, trial.nearest_group, 0)).candidates
    found = BestFirst(trial, candidates, SEEDS)
    motion = found.run()
    assert found.made == 1
    tried = [candidates.index(attempt.candidate) for attempt in found.attempts]
    assert tried == list(range(len(tried)))
    assert motion.attempt.candidate in candidates[: len(tried)]


def test_a_trial_that_needs_the_grip_closes_the_hand_before_anything_else(task, monkeypatch) -> None:
    failed = GripResult(held=False, message="no contact")
    monkeypatch.setattr(PickTask, "grip", lambda task, member: failed)
    of_trial = {
        stage: _judge(task.pick, task.cell.for_trials(stage), [1, 2, 3, 4]) for stage in (Stage.GRASP, Stage.GRIP)
    }
    assert [verdict.failed for verdict in of_trial.values()] == [Stage.GRIP] * 2
    assert Stage.GRASP in [result.stage for result in of_trial[Stage.GRASP].stages]
    assert [result.stage for result in of_trial[Stage.GRIP].stages] == [Stage.INPUT, Stage.GRIP]


def test_releases_at_which_the_empty_hand_is_free_are_tried_first(task, releases, attempt, monkeypatch) -> None:
    """The releases nearest in time are in contact, and the budget is one release."""
    placer, member = Placer(copy(task), 0), attempt.candidate.member
    placer.task.cell = replace(task.cell, budget=replace(task.cell.budget, configurations=1))
    nearest = placer.search(attempt, [1, 2], Scores())._tried
    clearances = np.full(len(placer.releases(member)), 0.01)
    clearances[nearest] = 0.0
    monkeypatch.setattr(Placer, "_clearances", lambda placer, member, retreats: clearances)
    other = placer.search(attempt, [1, 2], Scores())._tried
    assert len(nearest) == len(other) == 1
    assert other != nearest


def test_a_shortened_path_has_its_own_certificate_and_none_in_a_trial(task, attempt) -> None:
    """The plan has a detour of 0.1 rad, with the certificate of that path."""
    arm, checker, ends = task.arm, task.outside, [task.cell.home, attempt.entrance]
    detour = JointPath(np.array([ends[0], np.mean(ends, axis=0) + 0.1, ends[1]]), arm.joint_names)
    proof = pp.certify(detour, checker)
    plan = pp.RrtConnect().plan(checker, *ends).changed(path=detour, certificate=proof)
    path, own = lines.shortened(task, plan, checker, 0, None)
    assert path.length < detour.length
    assert own.curve == pp.certify(path, checker).curve != proof.curve
    trial = PickTask(task.pick, task.cell.for_trials(Stage.GRASP))
    same, none = lines.shortened(trial, plan, checker, 0, None)
    assert (same.q == path.q).all()
    assert none is None


# -- attempts at full rotations of their joints, compared with all rotations within the limits -------------------------


def attempt_of(arm: pp.Arm, rng: np.random.Generator) -> Attempt:
    """A grasp between two curved lines of random extent."""
    q, names = rng.uniform(-2.5, 2.5, arm.dof), arm.joint_names
    ends, tangents = q + rng.normal(0, 0.4, (2, arm.dof)), rng.normal(0, 0.5, (2, 2, arm.dof))
    lines = [CubicPath(np.array([q, ends[k]]), tangents[k], [0.0, 1.0], names) for k in range(2)]
    return Attempt(GraspCandidate(q, None, 0.0, 0.0), q, approach=lines[0], retreat=lines[1])


@pytest.mark.parametrize("seed", range(3))
def test_full_rotations_are_all_that_keep_both_lines_within_the_limits(arms, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ur5 = arms["ur5"]
    low, high = -rng.uniform(3.0, 5.5, 6), rng.uniform(3.0, 5.5, 6)
    wide = JointLimits(low, high, ur5.limits.velocity, ur5.limits.acceleration)
    arm = ur5.with_limits(wide)
    attempt = attempt_of(arm, rng)
    shifts = full_rotations(arm, arm.home, attempt)
    assert not shifts[0].any()
    dense = np.linspace(0.0, 1.0, 200)
    points = np.vstack([attempt.q, attempt.approach(dense), attempt.retreat(dense)])
    every = np.array(list(product((-2, -1, 0, 1, 2), repeat=6)))
    bounds = span(attempt.q, attempt.approach, attempt.retreat)
    low, high = points.min(axis=0), points.max(axis=0)

    def fitting(least: np.ndarray, largest: np.ndarray) -> set[tuple[int, ...]]:
        inside = (least + TURN * every >= wide.lower).all(axis=1) & (largest + TURN * every <= wide.upper).all(axis=1)
        return set(map(tuple, every[inside].tolist()))

    # The control points bound the lines, so that rotations are left out only where a line nearly reaches a limit.
    given = {tuple(np.round(shift / TURN).astype(int).tolist()) for shift in shifts}
    assert given - fitting(low, high) <= {(0,) * 6}
    assert given == fitting(*bounds) | {(0,) * 6}
    assert (bounds[0] <= low + 1e-12).all()
    assert (bounds[1] >= high - 1e-12).all()


def test_an_attempt_at_full_rotations_has_the_same_poses_at_its_ends(arms) -> None:
    arm, rng = arms["ur5"], np.random.default_rng(5)
    for _ in range(5):
        attempt, by = attempt_of(arm, rng), TURN * rng.integers(-1, 2, arm.dof)
        turned = attempt.turned(by)
        assert turned.candidate is attempt.candidate
        for line, before, end in (
            (turned.approach, attempt.approach, turned.entrance),
            (turned.retreat, attempt.retreat, turned.exit),
        ):
            for share in np.linspace(0.0, 1.0, 11):
                np.testing.assert_allclose(line(share) - before(share), by, atol=1e-12)
            np.testing.assert_allclose(line.end, end, atol=1e-12)
            np.testing.assert_allclose(line.start, turned.q, atol=1e-12)
    alone = Attempt(attempt.candidate, attempt.q).turned(by)
    assert (alone.approach, alone.retreat) == (None, None)
    for q in (alone.entrance, alone.exit):
        np.testing.assert_array_equal(q, attempt.q + by)
    assert shifted(None, by) is None


def test_the_time_at_full_speed_is_the_same_in_both_directions_and_no_less_than_any_bound(arms) -> None:
    rng = np.random.default_rng(0)
    for arm in arms.values():
        for _ in range(20):
            points = rng.uniform(-3.0, 3.0, (rng.integers(1, 6), arm.dof))
            slowest = [
                max(abs(step[j]) / arm.limits.velocity[j] for j in range(arm.dof)) for step in np.diff(points, axis=0)
            ]
            assert at_full_speed(arm, points) == pytest.approx(sum(slowest))
            assert at_full_speed(arm, points[::-1]) == pytest.approx(sum(slowest))
            assert at_full_speed(arm, points) >= least_seconds(arm, points[:1], points[-1:])[0, 0] - 1e-12


def test_ranked_configurations_reach_the_grasps_that_they_belong_to(arms, cells, monkeypatch) -> None:
    """Also if there are more than are ranked; those with the shortest time from home are kept."""
    monkeypatch.setattr(grasp, "RANKED", 5)
    arm, (scene, picks) = arms["ur5"], cells["ur5"]
    made = PickSetup.make(arm, scene, picks, home=None, rng=0)
    tolerance = pp.picks.GraspTolerance(position=(0.005, 0.005, 0.0), tilt=0.1)
    task = PickTask(pp.Pick("bolt", picks.picks[0].pose, tolerance=tolerance), made.cell)
    members = [member for group in task.groups() for member in group]
    reached = grasp.reach(task, members, 0)
    assert len(reached.q) > 20
    ranked = grasp.rank(task, reached.q, [members[i] for i in reached.member])
    assert len(ranked) == 5
    times = (np.abs(reached.q - task.cell.home) / arm.limits.velocity).max(axis=1)
    slowest = max((np.abs(each.q - task.cell.home) / arm.limits.velocity).max() for each in ranked)
    assert slowest == pytest.approx(np.sort(times)[4])
    for each in ranked:
        reached_tip = arm.root_from_base * arm.forward_kinematics(each.q) * picks.tip
        np.testing.assert_allclose(reached_tip.homogeneous, task.grasp(each.member).homogeneous, atol=1e-5)
    assert len({each.member.words for each in ranked}) > 1


def test_an_attempt_passed_if_its_last_stage_did() -> None:
    first, last = (StageResult(Stage.APPROACH, True, ""), StageResult(Stage.RETREAT, True, ""))
    candidate = GraspCandidate(np.zeros(6), None, 0.0, 0.0)
    for stages, passed in (((first,), True), ((first, last), True), ((first, replace(last, ok=False)), False)):
        assert Attempt(candidate, np.zeros(6), stages).passed is passed


LINKAGE = """<robot name="linkage"><link name="base"/><link name="slide"/>
<link name="hand"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="rod"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<joint name="a" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="b" type="prismatic"><parent link="slide"/><child link="hand"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="c" type="prismatic"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="a"/></joint></robot>"""
"""The hand does not move if one slide moves by as much as the other moves back, and the rod does."""


def test_contact_with_a_link_that_moves_while_the_tcp_rests_is_not_one_at_every_configuration() -> None:
    arm = pp.load_robot(LINKAGE).arm(tcp="hand")
    stone = pp.Obstacle("stone", pp.Sphere(0.02), pp.pose((0.0, 0.0, 0.06)))
    checker = pp.CollisionChecker(arm, pp.Scene([stone]))
    here, there = np.zeros(2), np.array([0.5, -0.5])
    np.testing.assert_allclose(arm.forward_kinematics(here).homogeneous, arm.forward_kinematics(there).homogeneous)
    met, left = ({frozenset(each.bodies) for each in checker.check(q).contacts} for q in (here, there))
    assert {frozenset(("hand", "rod")), frozenset(("hand", "stone"))} <= met
    assert left == {frozenset(("hand", "stone"))}
    for q in (here, there):
        (words,) = grasp.contacts_everywhere(checker, q)
        assert "hand" in words
        assert "stone" in words
