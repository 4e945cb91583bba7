"""Suggestions: applied exactly as printed they help, and they are the smallest of those tried."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pinproof as pp
from pinproof.errors import InputError
from pinproof.picks import (
    LengthSuggestion,
    NamedFrame,
    PickSetup,
    RetreatSuggestion,
    ShiftSuggestion,
    Stage,
    StageResult,
    TurnSuggestion,
)
from pinproof.picks.judging import suggest
from pinproof.picks.judging.lines import Attempt, ToolLine
from pinproof.picks.judging.suggest import DIRECTIONS, DISTANCES, TILTS, TURNS
from pinproof.picks.judging.task import PickTask
from pinproof.spatial import SE3

from ..examples import examples
from .conftest import DOWN, cell_of, judge_in

PICK = pp.Pick("part", pp.pose((0.45, 0.1, 0.2), DOWN), approach=0.05, retreat=0.05)
TURNED = NamedFrame(pp.pose((0.1, -0.1, 0.0), (0, 0, 0.7)))


@pytest.fixture(scope="module")
def arm(arms) -> pp.Arm:
    return arms["ur5"]


ROD = (pp.Obstacle("rod", pp.Cylinder(radius=0.012, length=0.1), pp.pose((0, 0, 0.05))),)
TOOL = {"tool": ROD, "tip": pp.pose((0, 0, 0.1))}


def judge(arm: pp.Arm, pick: pp.Pick, *obstacles: pp.Obstacle, remedies: int = 0, **shared) -> pp.picks.PickVerdict:
    budget = pp.picks.PickBudget(compared=1, motion=0, remedies=remedies)
    return judge_in(arm, pp.Scene(obstacles), pick, budget=budget, margin=0.002, **shared)


def vector(text: str) -> np.ndarray:
    """The vector (mm) that is printed, read independently of the library."""
    if found := re.search(r"([\d.]+) mm along ([-+])([xyz])", text):
        return float(found[1]) * (1 if found[2] == "+" else -1) * np.eye(3)["xyz".index(found[3])]
    return np.array([float(each) for each in re.search(r"by \(([^)]*)\) mm", text)[1].split(",")])


def shifted(pick: pp.Pick, millimetres: np.ndarray) -> pp.Pick:
    return replace(pick, pose=SE3(pick.pose.rotation, pick.pose.translation + millimetres / 1e3))


def shift_of(verdict: pp.picks.PickVerdict) -> ShiftSuggestion:
    return next(each for each in verdict.suggestions if each.text.startswith("move the pick"))


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.0235, 0.031])
def test_the_smallest_shift_of_all_candidates_is_suggested(arm, gap) -> None:
    stone = pp.Obstacle("stone", pp.Sphere(0.02), pp.pose((0.45, 0.1 + gap, 0.2)))
    near = pp.Obstacle("other", pp.Sphere(0.02), pp.pose((0.45 - 0.001, 0.1 - 0.12, 0.2)))
    verdict = judge(arm, PICK, stone, near, remedies=500, **TOOL)
    assert verdict.failed is Stage.GRASP
    by = vector(str(shift_of(verdict)))
    assert judge(arm, shifted(PICK, by), stone, near, **TOOL).ok
    smaller = 0
    for distance in DISTANCES:
        for direction in DIRECTIONS:
            other = np.array(direction) * max(1.0, np.round(distance / np.linalg.norm(direction)))
            if np.linalg.norm(other) < np.linalg.norm(by) - 1e-9:
                smaller += 1
                assert not judge(arm, shifted(PICK, other), stone, near, **TOOL).ok, other
    assert smaller > 20


@pytest.mark.slow
def test_a_shift_of_a_few_millimetres_is_found_with_the_default_budget(arm) -> None:
    # The post and the rod would overlap by 1 mm in the grasp; with the margin of 2 mm, more than 3 mm are needed.
    for side, axis in ((1, "-"), (-1, "+")):
        post = pp.Obstacle("post", pp.Box(0.02, 0.02, 0.02), pp.pose((0.45, 0.1 + side * 0.021, 0.23)))
        verdict = judge(arm, PICK, post, remedies=pp.picks.PickBudget().remedies, **TOOL)
        assert str(shift_of(verdict)) == f"move the pick 4 mm along {axis}y (base frame)"


@pytest.mark.slow
def test_every_suggestion_for_random_failed_picks_does_what_it_states(arm) -> None:
    rng, checked, kinds = np.random.default_rng(3), 0, set()
    wall = pp.Obstacle("wall", pp.Box(0.02, 0.6, 0.3), pp.pose((0.6, 0.0, 0.15)))
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 0.3), pp.pose((0.4, -0.2, 0.15)))
    while checked < 25:
        xyz, rpy = rng.uniform((0.25, -0.4, 0.05), (1.0, 0.4, 0.35)), rng.normal((np.pi, 0, 0), (0.2, 0.2, 2))
        frame = str(rng.choice(["", "turned"]))
        pose = TURNED.pose.inverse() * pp.pose(xyz, rpy) if frame else pp.pose(xyz, rpy)
        away = (0, 0, 1) if rng.random() < 0.5 else tuple(rng.normal(size=3))
        lengths = {key: float(rng.choice([0.05, 0.1, 0.4])) for key in ("approach", "retreat")}
        pick = pp.Pick("part", pose, frame=frame, retreat_direction=away, **lengths)
        verdict = judge(arm, pick, wall, post, remedies=4, frames={"turned": TURNED})
        for suggestion in verdict.suggestions:
            there, text = judge(arm, suggestion.apply(pick), wall, post, frames={"turned": TURNED}), str(suggestion)
            later = re.search(r"fails at the (\S+) stage", text)
            assert there.ok if later is None else there.failed.value == later[1], text
            checked += 1
            kinds.add(text.split()[0])
    assert {"move", "turn"} <= kinds


@pytest.mark.slow
def test_a_pick_out_of_reach_is_moved_by_the_printed_vector_into_reach(arm) -> None:
    rng = np.random.default_rng(8)
    for _ in range(10):
        angle, far = rng.uniform(-1, 1), rng.uniform(0.9, 1.3)
        pick = pp.Pick("p", pp.pose((far * np.cos(angle), far * np.sin(angle), rng.uniform(0, 0.3)), DOWN))
        verdict = judge(arm, pick, remedies=4)
        assert verdict.failed is Stage.REACH
        text = str(shift_of(verdict))
        by = vector(text)
        assert (by == np.round(by)).all()
        there = judge(arm, shifted(pick, by))
        assert there.ok or there.failed.value in text


@pytest.fixture(scope="module")
def cell() -> tuple[pp.Arm, pp.Scene, pp.Picks]:
    return cell_of("ur5", "carry.yaml", "over_the_wall")


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_grasp_and_place_move_together_so_that_the_object_is_placed_where_it_was_to_be(cell, turn) -> None:
    arm, scene, picks = cell
    (bolt,) = picks
    bolt = replace(bolt, place=replace(bolt.place, pose=bolt.place.pose * pp.pose(rpy=(0, 0, turn))))
    post = pp.Obstacle("post", pp.Box(0.02, 0.02, 0.02), pp.pose((0.46, 0.15 + 0.029, 0.08)))
    scene = scene.add(post)

    def of(pick: pp.Pick, remedies: int) -> pp.picks.PickVerdict:
        budget = pp.picks.PickBudget(remedies=remedies, compared=1)
        return pp.validate_picks(arm, scene, replace(picks, picks=(pick,)), budget=budget).verdicts[0]

    verdict = of(bolt, 12)
    assert verdict.failed is Stage.GRASP
    suggestion = shift_of(verdict)
    pick_part, place_part = suggestion.text.split(" and the place ")
    assert pick_part.endswith("(base frame)")
    assert place_part.endswith("(frame 'drop')")
    there = suggestion.apply(bolt)
    np.testing.assert_allclose((there.pose.translation - bolt.pose.translation) * 1e3, vector(pick_part), atol=1e-9)
    moved = there.place.pose.translation - bolt.place.pose.translation
    np.testing.assert_allclose(moved * 1e3, vector(place_part), atol=1e-9)
    # root_from_object at the release, from the tip's pose there and the grasp
    released, wanted = (each.place.pose * each.pose.inverse() for each in (there, bolt))
    stands = scene["bolt_1"].pose
    np.testing.assert_allclose((released * stands).translation, (wanted * stands).translation, atol=2e-5)
    np.testing.assert_allclose(released.rotation, wanted.rotation, atol=1e-12)
    assert of(there, 0).ok


def test_a_vector_is_in_the_frame_of_the_pick(arm) -> None:
    pick = pp.Pick("p", TURNED.pose.inverse() * pp.pose((1.0, 0.0, 0.2), DOWN), frame="turned")
    verdict = judge(arm, pick, remedies=4, frames={"turned": TURNED})
    suggestion = shift_of(verdict)
    text = str(suggestion)
    assert "(frame 'turned')" in text
    assert judge(arm, shifted(pick, vector(text)), frames={"turned": TURNED}).ok or "; it then" in text
    with pytest.raises(InputError, match="its pick is stated in the base frame"):
        suggestion.apply(PICK)


numbers = st.integers(-200_000, 200_000).map(lambda value: value / 100)


@examples(200)
@given(st.tuples(numbers, numbers, numbers).filter(any))
def test_a_printed_vector_is_the_vector_that_is_applied(by) -> None:
    suggestion = ShiftSuggestion(by=by)
    np.testing.assert_allclose(vector(suggestion.text), by, atol=1e-9)
    moved = suggestion.apply(PICK).pose.translation - PICK.pose.translation
    np.testing.assert_allclose(moved * 1e3, by, atol=1e-9)


@examples(100)
@given(
    st.integers(-180, 180).filter(bool),
    st.tuples(numbers, numbers, numbers).filter(lambda axis: max(map(abs, axis)) > 1),
)
def test_a_printed_turn_is_the_turn_that_is_applied(degrees, axis) -> None:
    axis = np.array(axis) / np.linalg.norm(axis)
    turned = TurnSuggestion.about(axis, degrees, with_place=False).apply(PICK)
    turn = PICK.pose.actInv(turned.pose)
    np.testing.assert_allclose(turn.rotation @ axis, axis, atol=2e-6)
    cosine = (np.trace(turn.rotation) - 1) / 2
    assert cosine == pytest.approx(np.cos(np.radians(degrees)), abs=1e-9)
    np.testing.assert_array_equal(turned.pose.translation, PICK.pose.translation)


@pytest.mark.parametrize(
    ("suggestion", "text"),
    [
        (ShiftSuggestion(by=(-20, 0, 0)), "move the pick 20 mm along -x (base frame)"),
        (
            ShiftSuggestion(by=(3, 0, -3), place_by=(3, 1, 0), place_frame="bin", effect="ends"),
            "move the pick by (+3, 0, -3) mm (base frame) and the place by (+3, +1, 0) mm (frame 'bin'); it then ends",
        ),
        (ShiftSuggestion(place_by=(0, 0, 0.5)), "move the place 0.5 mm along +z (base frame)"),
        (
            TurnSuggestion.about(np.array([0, 0, -1.0]), 30.0, with_place=True),
            "turn the pick and the place by -30 deg about the z axis of the tip",
        ),
        (
            TurnSuggestion.about(np.array([0.6, -0.8, 0]), 15.0, with_place=False),
            "turn the pick by -15 deg about (-0.600000, 0.800000, -0.000000) of the tip",
        ),
        (LengthSuggestion(line="approach", before=300, after=222), "shorten the approach from 300 mm to 222 mm"),
        (RetreatSuggestion(), "retreat straight up, along +z (base frame)"),
    ],
)
def test_suggestions_read_as_documented(suggestion, text) -> None:
    assert str(suggestion) == text


def test_a_line_is_shortened_and_a_retreat_is_turned_upwards() -> None:
    assert LengthSuggestion(line="approach", before=50, after=20).apply(PICK).approach == 0.02
    assert LengthSuggestion(line="retreat", before=50, after=20).apply(PICK).retreat == 0.02
    up = RetreatSuggestion().apply(replace(PICK, retreat_direction=(1, 0, 0), retreat_frame="tip"))
    assert (up.retreat_direction, up.retreat_frame) == ((0, 0, 1), "root")


def test_a_suggestion_that_does_not_fit_the_pick_is_refused() -> None:
    for suggestion in (
        ShiftSuggestion(by=(-20, 0, 0), frame="bin"),
        ShiftSuggestion(place_by=(-20, 0, 0)),
        LengthSuggestion(line="approach", before=70, after=20),
        TurnSuggestion(degrees=30, axis=(0, 0, 1), with_place=True),
    ):
        with pytest.raises(InputError, match="does not fit pick 'part'"):
            suggestion.apply(PICK)


def test_no_suggestion_is_made_without_a_budget(arm) -> None:
    assert judge(arm, pp.Pick("p", pp.pose((3.0, 0.0, 0.2), DOWN)), remedies=0).suggestions == ()


def test_a_change_that_cannot_be_good_is_not_judged_and_not_good_when_it_is_tried_again() -> None:
    judged: list[str] = []
    trials = suggest._Trials(lambda pick, stage: judged.append(pick), Stage.GRASP, 3, lambda pick: False, list)
    change = suggest.Change(PICK, partial(ShiftSuggestion, by=(0, 0, 10)), 10.0)
    assert [trials.good(change), trials.good(change)] == [False, False]
    assert (judged, trials.best, trials.left) == ([], None, 3)


def verdict_on(pick: pp.Pick, *, good: bool, stage: Stage = Stage.RETREAT) -> pp.picks.PickVerdict:
    status = pp.picks.PickStatus.GOOD if good else pp.picks.PickStatus.NOT_FOUND
    return pp.picks.PickVerdict(pick, status, (StageResult(stage, good, ""),))


def test_failures_at_later_stages_count_until_a_smaller_change_is_known_to_help() -> None:
    counted: list[Stage] = []

    def verdict(other: pp.Pick, stage: Stage) -> pp.picks.PickVerdict:
        counted.append(stage)
        return verdict_on(other, good=False, stage=Stage.PLACE)

    trials = suggest._Trials(verdict, Stage.GRASP, 9, lambda other: True, list)
    for mm in (20.0, 10.0, 30.0):
        trials.good(suggest.Change(PICK, partial(ShiftSuggestion, by=(mm, 0, 0)), mm))
    assert counted == [Stage.GRASP, Stage.GRASP, Stage.TIMING]
    effect = "passes the grasp stage and fails at the place stage"
    assert trials.suggestion() == ShiftSuggestion(by=(10.0, 0, 0), effect=effect)


def shifts_along_x() -> list[suggest.Change]:
    return [suggest.Change(PICK, partial(ShiftSuggestion, by=(mm, 0, 0)), float(mm)) for mm in range(1, 101)]


def test_changes_are_judged_by_size_among_those_that_pass_the_screening_until_one_is_good() -> None:
    """Those by an even number of millimetres pass the screening, and those by at least 13 mm are good."""
    seen, screened = [], []

    def verdict(other: pp.Pick, stage: Stage) -> pp.picks.PickVerdict:
        seen.append(round(float(other.pose.translation[0] - PICK.pose.translation[0]) * 1e3))
        return verdict_on(other, good=seen[-1] >= 13)

    def screen(changes: list[suggest.Change]) -> list[suggest.Change]:
        screened.extend(changes)
        return [change for change in changes if change.size % 2 == 0]

    trials = suggest._Trials(verdict, Stage.GRASP, 20, lambda other: True, screen)
    assert trials.nearest(shifts_along_x()) == ShiftSuggestion(by=(14, 0, 0))
    assert seen == [2, 4, 6, 8, 10, 12, 14]
    assert len(screened) == suggest.SCREENED_TOGETHER
    trials = suggest._Trials(verdict, Stage.GRASP, 5, lambda other: True, screen)
    trials.nearest(shifts_along_x())
    assert trials.best is None
    assert seen[7:] == [2, 4, 6, 8, 10]


def test_finer_changes_are_judged_before_a_coarse_one() -> None:
    seen = []

    def verdict(other: pp.Pick, stage: Stage) -> pp.picks.PickVerdict:
        seen.append(round(float(other.pose.translation[0] - PICK.pose.translation[0]) * 1e3))
        return verdict_on(other, good=seen[-1] >= 13)

    trials, every = suggest._Trials(verdict, Stage.GRASP, 9, lambda other: True, list), shifts_along_x()
    found = trials.nearest(every[9::10], lambda change: every[int(change.size) - 8 : int(change.size) - 1 : 3])
    assert found == ShiftSuggestion(by=(13, 0, 0))
    assert seen == [3, 6, 9, 10, 13]


def test_a_change_passes_the_screening_if_a_line_leads_from_a_free_configuration_to_another_one(arm) -> None:
    """Compared with the motions that are planned from each configuration of the closed form."""
    post = pp.Obstacle("post", pp.Box(0.1, 0.1, 0.3), pp.pose((0.5, 0.25, 0.25)))
    pick = replace(PICK, pose=pp.pose((0.6, 0.3, 0.3), DOWN), approach=0.2)
    task = PickTask(pick, PickSetup.make(arm, pp.Scene([post]), pp.Picks((pick,)), home=None, rng=0).cell)
    shifts = suggest._vectors((20, 50, 100, 200), len(DIRECTIONS))
    changes, checker = suggest._shift_changes(task, pick, shifts, of_place=False), task.at_grasp
    passed, lost = set(suggest._screened(task, changes)), 0
    for change in changes:
        grasp, before = (task.target(pose) for pose in (change.pick.pose, change.pick.before(change.pick.pose)))
        starts = [q for q in pp.AnalyticIk().solve_all(arm, grasp).q if checker.is_free(q)]
        paths = [
            pp.planning.RouteFollower(arm=arm).follow(pp.planning.Route.straight(grasp, before), q) for q in starts
        ]
        leads = any(found.fraction == 1.0 and checker.is_free(found.path(1.0)) for found in paths)
        assert (change in passed) == leads, change.suggestion
        lost += bool(starts) and not leads
    assert lost > 3
    assert len(passed) > 10


@pytest.mark.parametrize(("longest", "judged", "found"), [(44, [42, 43, 45], 43), (42, [42, 43], 42), (41, [42], None)])
def test_the_first_length_whose_line_is_possible_is_judged_and_then_longer_ones(
    arm, monkeypatch, longest: int, judged: list[int], found: int | None
) -> None:
    """Lines of up to 42.5 mm are possible, and complete picks of up to a longest length."""
    pick = replace(PICK, retreat=0.08)
    task = PickTask(pick, PickSetup.make(arm, pp.Scene(), pp.Picks((pick,)), home=None, rng=0).cell)
    planned, seen = [], []

    def line_out(shorter: PickTask, candidate: object) -> tuple[ToolLine, tuple[()]]:
        planned.append(shorter.pick.retreat)
        fraction = min(0.0425 / shorter.pick.retreat, 1.0)
        return ToolLine(StageResult(Stage.RETREAT, fraction == 1.0, ""), None, fraction), ()

    def verdict(other: pp.Pick, stage: Stage) -> pp.picks.PickVerdict:
        seen.append(round(other.retreat * 1e3))
        return verdict_on(other, good=seen[-1] <= longest)

    monkeypatch.setattr(suggest, "line_out", line_out)
    attempt = Attempt(None, np.zeros(6), fraction=0.606)
    trials = suggest._Trials(verdict, Stage.RETREAT, 10, lambda other: True, list)
    suggestion = suggest._shorter(task, pick, Stage.RETREAT, attempt, trials)
    np.testing.assert_allclose(planned, [0.048, 0.042])
    assert seen == judged
    assert suggestion == (None if found is None else LengthSuggestion(line="retreat", before=80.0, after=float(found)))


@pytest.mark.parametrize("main", [0, 1, 2])
def test_turns_about_the_approach_and_tilts_about_both_other_axes_are_candidates(arm, monkeypatch, main) -> None:
    """The approach is along one axis of the tip."""
    axis = np.eye(3)[main]
    pick = replace(PICK, approach_direction=tuple(axis.tolist()), approach_frame="tip")
    picks, budget = pp.Picks((pick,)), pp.picks.PickBudget(remedies=4)
    task = PickTask(pick, PickSetup.make(arm, pp.Scene(), picks, home=None, rng=0, budget=budget).cell)
    candidates: list[suggest.Change] = []
    monkeypatch.setattr(suggest, "_screened", lambda task, changes, **_: candidates.extend(changes) or [])
    suggest.suggest(task, pick, StageResult(Stage.GRASP, False, ""), None, None)
    turned = [change for change in candidates if isinstance(change.suggestion, TurnSuggestion)]
    turns = {(int(np.argmax(change.suggestion.axis)), change.suggestion.degrees) for change in turned}
    about = {(main, sign * degrees) for degrees in TURNS for sign in (1, -1)} - {(main, -180)}
    across = {(axis, sign * degrees) for axis in {0, 1, 2} - {main} for degrees in TILTS for sign in (1, -1)}
    assert turns == about | across
    for change in turned:
        tilt = np.arccos(np.clip((change.pick.pose.rotation @ axis) @ (pick.pose.rotation @ axis), -1.0, 1.0))
        assert np.degrees(tilt) == pytest.approx(0.0 if change.suggestion.axis[main] else change.size, abs=1e-4)
