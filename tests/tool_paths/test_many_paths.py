"""Base placement of jobs of tool paths, and campaigns over many paths: both agree with following the paths directly."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell import PlacementBudget, PlacementRegion
from pinproof.tool_paths import Stroke, ToolPath, follow_job, path_campaign, place_job, read_tool_paths

ROBOTS = Path(__file__).parents[2] / "robots"
TINY = PlacementBudget(grid=24, runs=0, evaluations=0, certified=1, deviations=0)
REGION = PlacementRegion(x=(-0.3, 0.3), y=(0.2, 0.5), yaw=(-1.0, 0.0))


@pytest.fixture(scope="module")
def job():
    """The weld seam, in the frame of the cell."""
    return read_tool_paths(ROBOTS / "ur5" / "weld_seam.yaml")


@pytest.fixture(scope="module")
def placed(job):
    return place_job(job, REGION, placement_budget=TINY)


def test_the_original_robot_follows_the_job_at_the_best_placement(job, placed):
    assert placed.ok
    best, root_from_cell = placed.best, placed.best.root_from_cell
    # The job and the scene are moved into the frame of the root, by the pose alone
    strokes = tuple(own.transformed(root_from_cell) for own in job.strokes)
    moved = replace(job, strokes=strokes, settings=job.settings.transformed(root_from_cell))
    checker = moved.load_checker(moved.load_arm(), job.load_scene().transformed(root_from_cell))
    found = follow_job(moved, checker=checker)
    assert found.ok
    assert found.total_time == pytest.approx(best.cycle_time, rel=0.02)
    assert pp.audit(found.motion.trajectory, checker, step=0.02).clean
    assert (best.good, best.judged) == (1, 1)
    assert best.clearance == best.report.motion.certificate.clearance


def test_a_placement_that_passes_the_screening_has_a_free_solution_at_every_place(job, placed):
    grid = placed.map
    assert 0 < grid.feasible.sum() < len(grid)
    rng, checker = np.random.default_rng(0), placed.best.report.checker
    for k in rng.choice(len(grid), 6, replace=False):
        arm = job.at_tip(placed.best.placed.arm_at(grid.placements[k]))
        own = job.load_checker(arm, placed.best.scene)
        base_from_cell = arm.root_from_base.inverse().homogeneous
        solved = []
        for pose in job.strokes[0].path.at(np.linspace(0.0, 1.0, 24)):
            turns = [pp.pose(rpy=(0, 0, 2 * np.pi * m / 12)).homogeneous for m in range(12)]
            q = pp.AnalyticIk().solve_all_batch(arm, base_from_cell @ pose @ turns).q.reshape(-1, arm.dof)
            solved.append(any(own.is_free(each) for each in q[np.isfinite(q).all(axis=1)]))
        assert (not grid.feasible[k]) or all(solved)
    assert len(checker.attached) == 2


def test_a_job_that_no_placement_allows_names_the_places(job):
    far = PlacementRegion(x=(3.0, 3.5), y=(3.0, 3.5))
    found = place_job(job, far, placement_budget=replace(TINY, grid=4))
    assert not found.ok
    assert "out of reach" in found.failing["seam at 0 %"]
    assert found.least_failing.good == 0
    with pytest.raises(pp.InputError, match="moves with the base"):
        place_job(replace(job, frame="base_link"), far, placement_budget=TINY)
    with pytest.raises(pp.InputError, match="placement_budget"):
        place_job(job, far, placement_budget=4)


@pytest.fixture(scope="module")
def many(job):
    """Six seams, of which some are out of reach."""
    seam = job.strokes[0]
    strokes = [
        replace(
            seam,
            name=f"seam {k}",
            path=replace(seam.path, poses=pp.pose((0.1 * k, 0, 0.1)).homogeneous @ seam.path.poses),
        )
        for k in range(6)
    ]
    return replace(job, strokes=tuple(strokes), lifts=0)


@pytest.mark.slow  # it starts processes
def test_the_rows_of_a_campaign_are_those_of_each_path_alone(many, tmp_path):
    result = path_campaign(many).run(tmp_path / "out", workers=1)
    checker = many.load_checker()
    expected = [pp.follow(checker, own.path, rng=0, **many.options) for own in many.placed(checker)]
    rows = list(result.rows())
    assert [row["name"] for row in rows] == [own.name for own in many.strokes]
    assert [row["verdict"] == "good" for row in rows] == [plan.ok for plan in expected]
    assert [row["status"] for row in rows] == [plan.status.name for plan in expected]
    assert 0 < result.good < 6
    assert result.items == "paths"
    assert f"{result.good} of 6 paths good" in result.summary
    for row, plan in zip(rows, expected, strict=True):
        assert row.get("duration") == (plan.duration if plan.ok else None)
    # The same rows byte for byte if it is interrupted and resumed
    first = (tmp_path / "out" / "rows.jsonl").read_bytes()
    campaign, seen = path_campaign(many), []

    def stop(done, total):
        seen.append((done, total))
        if done >= 2:
            raise KeyboardInterrupt

    with pytest.raises(pp.errors.RunInterrupted, match="paths"):
        campaign.run(tmp_path / "again", executor=ThreadPoolExecutor(1), chunk=1, progress=stop)
    assert path_campaign(many).run(tmp_path / "again", executor=ThreadPoolExecutor(1)).resumed >= 2
    assert (tmp_path / "again" / "rows.jsonl").read_bytes() == first


def test_the_page_of_a_campaign_shows_every_path_with_its_verdict(many, tmp_path):
    few = path_campaign(replace(many, strokes=(many.strokes[0], many.strokes[5])))
    result = few.run(tmp_path / "out", executor=ThreadPoolExecutor(1))
    few.write_page(result, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    for row, verdict in zip(result.rows(), ("good", "not found"), strict=True):
        assert row["verdict"] == verdict
        assert f"<td>{row['name']}</td><td>{verdict}</td>" in page
    assert "cannot be passed" in page


def test_a_campaign_with_other_settings_or_paths_is_refused(many, tmp_path):
    few = replace(many, strokes=many.strokes[:1])
    path_campaign(few).run(tmp_path, executor=ThreadPoolExecutor(1))
    for other in (replace(few, approach=0.04), replace(few, strokes=many.strokes[1:2])):
        with pytest.raises(pp.errors.CampaignError):
            path_campaign(other).run(tmp_path, executor=ThreadPoolExecutor(1))


def test_only_a_path_whose_pose_is_proven_is_impossible(job, tmp_path):
    away = ToolPath.through([[3.0, 0.0, 0.2], [3.0, 0.1, 0.2]], (0, 0, 1), speed=0.1)
    for free, verdict in ((True, "not found"), (False, "impossible")):
        own = replace(job, strokes=(Stroke("far", away),), free_rotation=free)
        (row,) = path_campaign(own).run(tmp_path / verdict, executor=ThreadPoolExecutor(1)).rows()
        assert (row["verdict"], row["failed_at"]) == (verdict, "blocked")


def test_a_path_that_is_out_of_reach_by_less_than_its_deviation_is_not_impossible(job, tmp_path):
    arm, reach = job.load_checker().arm, 0.5
    pose = pp.pose((0.0, 0.0, 0.3), (np.pi, 0.0, 0.0)).homogeneous
    while True:  # the last place on this line that is reached, to 1 mm
        pose[0, 3] = reach
        if not pp.AnalyticIk().solve_all(arm, pose).ok:
            break
        reach += 1e-3
    ends = np.array([pose, pose])
    ends[1, 1, 3] = 0.02
    own = replace(job, strokes=(Stroke("edge", ToolPath(ends)),), free_rotation=False, approach=0.0, deviation=5e-3)
    checker = own.load_checker()
    (row,) = path_campaign(own).run(tmp_path, executor=ThreadPoolExecutor(1)).rows()
    near = ends.copy()
    near[:, 0, 3] -= 2e-3
    inside = pp.follow(checker, ToolPath(near), **{**own.options, "deviation": 2e-3})
    assert (row["verdict"], inside.ok) == ("not found", True)  # a motion within 4 mm of the path exists
