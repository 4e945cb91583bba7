"""The parts of a place, compared with dense samples of its lines."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import pinproof as pp
from pinproof.description import robots_folder
from pinproof.motion import JointPath
from pinproof.picks.judging import place
from pinproof.picks.judging.grasp import INSTANT, reach, screen
from pinproof.picks.judging.judge import Scoring, _Completions, _judge
from pinproof.picks.judging.lines import Crossing, ToolLine, along, full_rotations
from pinproof.picks.judging.place import Placer, Placing, Scores, release_lines
from pinproof.picks.judging.task import PickTask
from pinproof.picks.judging.verdict import Stage, StageResult

SEEDS = [1, 2]


@pytest.fixture(scope="module")
def task() -> PickTask:
    picks = pp.read_picks(robots_folder() / "ur5" / "carry.yaml")
    pick = next(each for each in picks.picks if each.place is not None)
    arm = pp.load_robot("ur5").arm(tcp=picks.tcp, held=picks.held)
    made = pp.picks.PickSetup.make(arm, pp.Scene.load(picks.scene), picks, home=None, rng=0)
    return PickTask(pick, made.cell)


def test_the_lines_of_a_release_have_the_clearance_of_the_closer_one_and_end_at_the_stated_poses(
    task, monkeypatch
) -> None:
    member, arm = task.nearest_group[0], task.arm
    (release, *_) = [
        found for q in Placer(task, 0).releases(member) if not (found := release_lines(task, task.place, member, q)).why
    ]
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


def test_a_transfer_ends_at_full_rotations_that_keep_the_lines_of_the_release_within_the_limits(task) -> None:
    group = task.nearest_group
    attempt = along(task, screen(task, group, reach(task, group, 0)).candidates[0])
    assert attempt.passed
    limits, placer = task.arm.limits, Placer(task, 0)
    downs = [release_lines(task, task.place, group[0], q) for q in placer.releases(group[0])]
    tried = 0
    for down in downs:
        if down.why:
            continue
        for shift in full_rotations(task.arm, task.cell.home, attempt)[:4]:
            result, placing = placer.transfer(task.place, attempt.turned(shift), down, SEEDS)
            if placing is None:
                continue
            tried += 1
            low, high = (bound(np.vstack([line.bezier()[1].reshape(-1, 6) for line in (down.lift, down.leave)]), axis=0)
                         for bound in (np.min, np.max))  # fmt: skip
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
def test_the_score_of_a_complete_motion_counts_every_part_of_it(task, side) -> None:
    group, arm, limits = task.nearest_group, task.arm, task.arm.limits
    candidates = screen(task, group, reach(task, group, 0)).candidates
    attempt = along(task, candidates[0])
    placer = Placer(task, 0)
    lines = (release_lines(task, task.place, group[0], q) for q in placer.releases(group[0]))
    release = next(each for each in lines if not each.why)
    scoring = Scoring.of(task, candidates, placer.rest)
    crossing = JointPath([task.cell.home, attempt.entrance], arm.joint_names)
    scores = _Completions(scoring, attempt, Crossing(StageResult(Stage.TRANSIT, True, ""), attempt, crossing, 0.03))
    # A transfer that passes close to a limit, which only it does
    aside = task.cell.home.copy()
    aside[3] = getattr(limits, side)[3] + (0.2 if side == "lower" else -0.2)
    transfer = JointPath([attempt.exit, aside, release.entrance], arm.joint_names)
    placing = Placing(transfer, release.lift, release.leave, release.parting, 0.02)

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
