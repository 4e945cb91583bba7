"""Comparison of set-ups pick by pick, and the tolerance of the poses of parts."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell import PickChange, compare, tolerance_study
from pinproof.picks import PickBudget

ROBOTS = Path(__file__).parents[2] / "robots"
QUICK = PickBudget(motion=0, compared=4, remedies=0)


@pytest.fixture(scope="module")
def cell() -> tuple[pp.Arm, pp.Scene, pp.Picks]:
    picks = pp.read_picks(ROBOTS / "ur5" / "plate_picks.yaml")
    chosen = tuple(pick for pick in picks if pick.name in ("bolts[0,0]", "bolts[1,1]", "unturned"))
    return picks.load_arm(), pp.Scene.load(ROBOTS / "ur5" / "plate_scene.yaml"), replace(picks, picks=chosen)


@pytest.fixture(scope="module")
def report(cell) -> pp.picks.PickReport:
    return pp.validate_picks(*cell, budget=QUICK)


@pytest.mark.slow
def test_each_kind_of_change_is_found(cell, report) -> None:
    arm, scene, picks = cell
    without_stop = scene.remove("stop")
    blocked = pp.Obstacle("post", pp.Box(0.02, 0.02, 0.3), scene["bolt_1_1"].pose * pp.pose(xyz=(0.03, 0, 0.1)))
    after = pp.validate_picks(arm, without_stop.add(blocked), picks, budget=QUICK)
    found = compare(report, after)
    first, *others = [(each.name, each.change) for each in found.differences]
    assert first in [("bolts[0,0]", each) for each in (PickChange.SAME, PickChange.FASTER, PickChange.SLOWER)]
    assert others == [("bolts[1,1]", PickChange.LOST), ("unturned", PickChange.WON)]
    # The reason of a pick that is good in both is empty, and that of a won pick is why it failed before
    assert [found.differences[k].reason for k in (0, 2)] == ["", report.verdicts[2].reason]
    assert not found.ok
    (lost,) = found.of(PickChange.LOST)
    assert "post" in lost.reason
    backwards = compare(after, report)
    assert [each.name for each in backwards.of(PickChange.LOST)] == ["unturned"]


@pytest.mark.slow
def test_slower_joints_make_picks_slower(cell, report) -> None:
    arm, scene, picks = cell
    limits = arm.limits
    slow = arm.with_limits(pp.JointLimits(limits.lower, limits.upper, limits.velocity / 2, limits.acceleration / 4))
    found = compare(report, pp.validate_picks(slow, scene, picks, budget=QUICK))
    assert [each.change for each in found.differences] == [PickChange.SLOWER, PickChange.SLOWER, PickChange.FAILING]
    before, after = found.seconds
    assert after == pytest.approx(2 * before, rel=0.02)  # half the speed, a quarter of the acceleration: twice as long
    assert [each.change for each in compare(report, report).differences[:2]] == [PickChange.SAME] * 2


def test_comparison_is_saved(tmp_path, report) -> None:
    found = compare(report, report)
    for suffix in ("json", "csv", "md"):
        found.save(tmp_path / f"comparison.{suffix}")
    stored = json.loads((tmp_path / "comparison.json").read_text())
    assert stored["counts"] == {"won": 0, "lost": 0, "faster": 0, "slower": 0, "same": 2, "failing": 1}
    assert len((tmp_path / "comparison.csv").read_text().splitlines()) == 4


@pytest.mark.slow
def test_proven_tolerance_contains_no_collision(report) -> None:
    study = tolerance_study(report, position=0.001, rotation=0.01, samples=4, largest=3.0)
    assert [each.good for each in study.picks] == [True, True, False]
    assert study.proven_share == pytest.approx(2 / 3)
    assert not study.ok
    setup, generator = report.setup, np.random.default_rng(0)
    for verdict, row in zip(report.verdicts, study.picks, strict=True):
        if not verdict.ok:
            continue
        assert row.factor >= 1.0
        name = str(verdict.pick.carried)
        obstacle = setup.checker.scene[name]
        for motion in verdict.motions:
            if motion.name not in ("transit", "approach", "transfer"):
                continue
            allowed = [(body.name, name) for body in motion.attached if body.name != name]
            for _ in range(6):
                shift = generator.uniform(-1, 1, 3) * row.factor * study.position
                turn = generator.uniform(-1, 1) * row.factor * study.rotation / np.sqrt(3)
                moved = pp.pose(xyz=shift.tolist(), rpy=(turn, turn, turn))
                scene, attached = motion.scene, motion.attached
                if name in scene.names:
                    scene = scene.move(name, obstacle.pose * moved)
                else:
                    held = next(each for each in attached if each.name == name)
                    others = [each for each in attached if each is not held]
                    attached = [*others, replace(held, pose=held.pose * moved)]
                settings = {"attached": attached, "allowed": allowed, "margin": setup.checker.margin}
                checker = pp.CollisionChecker(setup.checker.arm, scene, **settings)
                assert pp.certify(motion.trajectory, checker).free


def test_too_large_a_tolerance_is_not_proven(report) -> None:
    study = tolerance_study(report, position=0.2, rotation=0.0, samples=0, largest=1.0)
    assert study.proven_share == 0.0
    assert all(each.limited_by for each in study.picks)
    assert max(each.factor for each in study.picks) * study.position > 0.002


@pytest.mark.slow
def test_workers_do_not_change_a_study(report) -> None:
    one = tolerance_study(report, samples=3)
    with ThreadPoolExecutor(2) as executor:
        assert tolerance_study(report, samples=3, executor=executor).to_dict() == one.to_dict()


def test_reports_on_different_picks_and_invalid_tolerances_are_refused(report) -> None:
    with pytest.raises(pp.UnknownNameError, match="unturned"):
        compare(report, replace(report, verdicts=report.verdicts[:2]))
    for settings, named in (
        ({"position": 0.0, "rotation": 0.0}, "both 0"),
        ({"rotation": 2.0}, "radians"),
        ({"distribution": "gauss"}, "normal"),
        ({"position": -1.0}, "position"),
    ):
        with pytest.raises(pp.InputError, match=named):
            tolerance_study(report, **settings)  # type: ignore[arg-type]
