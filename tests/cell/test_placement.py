"""Base placement: results are confirmed by judging the original robot in the transformed cell."""

from __future__ import annotations

import csv
import gc
import json
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pinproof as pp
from pinproof.cell import (
    PlacementBudget,
    PlacementChoice,
    PlacementRegion,
    PlacementResult,
    place_base,
    without_parts,
)
from pinproof.cell.placement.placed_work import CertifyTask, PickWork
from pinproof.cell.placement.placement_result import CertifiedPlacement
from pinproof.cell.placement.region import PlacedRobot, mounting_pose
from pinproof.picks import (
    PickBudget,
    PickSetup,
    PickStatus,
    PickVerdict,
    PickWeights,
    PlaceTarget,
    ScreenStatus,
    Stage,
    StageResult,
)
from pinproof.picks.batch.screening import code_of
from pinproof.work import LocalWorkers, executors, runner

from ..pages import run_main
from ..processes import RUN_CLI, WRITTEN, rows_in, started, wait_for

ROBOTS = Path(__file__).parents[2] / "robots"
SMALL = PlacementBudget(grid=60, runs=2, evaluations=24, certified=2, deviations=0)
QUICK = PickBudget(motion=0, compared=4, remedies=0)


@pytest.fixture(scope="module", autouse=True)
def earlier_objects_are_not_searched() -> None:
    """A search collects garbage after each placement, and would search all that earlier tests have kept."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="module")
def picks() -> pp.Picks:
    return pp.read_picks(ROBOTS / "ur5" / "picks.yaml")


@pytest.fixture(scope="module")
def arm(picks) -> pp.Arm:
    return picks.load_arm()


@pytest.fixture(scope="module")
def scene(picks) -> pp.Scene:
    return pp.Scene.load(picks.scene)


def seconds_of(report: pp.picks.PickReport) -> float:
    """The sum of the times of the good picks."""
    return sum(verdict.trajectory.duration for verdict in report.good)


def some(picks: pp.Picks, *names: str) -> pp.Picks:
    return replace(picks, picks=tuple(pick for pick in picks if pick.name in names))


@pytest.fixture(scope="module")
def bolts(picks) -> pp.Picks:
    return some(picks, "bolt_1", "bolt_2", "bolt_5")


def search(*cell: object, **settings: object) -> PlacementResult:
    return place_base(*cell, **{"placement_budget": SMALL, "budget": QUICK, **settings})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def found(arm, scene, bolts) -> PlacementResult:
    return search(arm, scene, bolts, PlacementRegion(x=(-0.3, 0.1), y=(-0.3, 0.3), yaw=(-np.pi, np.pi)))


def judged_again(
    arm: pp.Arm, scene: pp.Scene, picks: pp.Picks, root_from_cell: object, moved: tuple[str, ...] = ()
) -> pp.picks.PickReport:
    """The picks judged with the original robot, in the scene moved into its frame."""
    there = scene.transformed(root_from_cell)
    for name in moved:
        there = there.move(name, scene[name].pose)
    weights = PickWeights(clearance=0, limit_margin=0, manipulability=0, duration=1)
    return pp.validate_picks(arm, there, picks.transformed(root_from_cell), weights=weights, budget=QUICK)


@pytest.mark.parametrize("mounting", ["floor", "wall", "ceiling"])
def test_placed_arm_collides_as_the_original_in_the_transformed_scene(arm, scene, mounting: str) -> None:
    generator = np.random.default_rng(3)
    obstacles = pp.Scene([each for each in scene.obstacles if each.name != "table"])
    placed = PlacedRobot.make(arm, obstacles, mounting_pose(mounting).homogeneous)
    wide = pp.CollisionChecker(placed.wide_arm, placed.scene, margin=0.002)
    for _ in range(4):
        values = generator.uniform([-0.9, -0.9, -0.2, -3.0], [0.2, 0.9, 0.9, 3.0])
        root_from_cell = np.linalg.inv(placed.cell_from_root(values[None])[0])
        plain = pp.CollisionChecker(arm, obstacles.transformed(root_from_cell), margin=0.002)
        own = pp.CollisionChecker(placed.arm_at(values), placed.scene, margin=0.002)
        q = generator.uniform(-np.pi, np.pi, (200, 6))
        expected = plain.is_free_batch(q)
        assert np.array_equal(own.is_free_batch(q), expected)
        assert np.array_equal(wide.is_free_batch(np.hstack([np.tile(values, (200, 1)), q])), expected)
        np.testing.assert_allclose(own.clearance_batch(q[:20]), plain.clearance_batch(q[:20]), atol=1e-7)


def test_bodies_that_move_with_the_base_collide_with_the_scene(arm) -> None:
    column = pp.Obstacle("column", pp.Box(0.2, 0.2, 0.5), pp.pose(xyz=(0, 0, -0.3)))
    wall = pp.Obstacle("wall", pp.Box(0.1, 2.0, 0.4), pp.pose(xyz=(0.6, 0, -0.3)))
    placed = PlacedRobot.make(arm, pp.Scene([column, wall]), np.eye(4), ["column"])
    checker = pp.CollisionChecker(placed.wide_arm, placed.scene)
    at = [np.concatenate([[x, 0, 0, 0], arm.home]) for x in (0.0, 0.44, 0.46)]
    assert checker.is_free_batch(at).tolist() == [True, True, False]
    assert checker.check(at[2]).contacts[0].bodies == ("column", "wall")


def test_best_placement_is_confirmed_by_the_original_robot(arm, scene, bolts, found) -> None:
    assert found.ok
    assert [len(each.report.good) for each in found.candidates] == [3, 3]
    assert found.candidates[0].cycle_time <= found.candidates[1].cycle_time
    for each in found.candidates:
        report = judged_again(arm, scene, bolts, each.root_from_cell)
        assert report.ok
        assert seconds_of(report) == pytest.approx(each.cycle_time, rel=1e-3)
        assert all(verdict.certificate.free for verdict in each.report.verdicts)
    # Its time is below the median of feasible placements
    grid, placed = found.map, PlacedRobot.make(arm, scene, np.eye(4))
    feasible = np.flatnonzero(grid.feasible)
    assert len(feasible) > 20
    median = feasible[np.argsort(grid.seconds[feasible])[len(feasible) // 2]]
    report = judged_again(arm, scene, bolts, placed.root_from_cell(grid.placements[median]))
    assert report.ok
    assert found.best.cycle_time < seconds_of(report)
    # The grid agrees with the screening of picks
    for k in range(0, len(grid), 7):
        if grid.base[k]:
            there = placed.root_from_cell(grid.placements[k])
            screened = pp.screen_picks(arm, scene.transformed(there), bolts.transformed(there))
            assert (screened.codes == 5).tolist() == (grid.codes[k] == 5).tolist()


@pytest.mark.slow
def test_placement_with_the_best_judged_sample_is_certified(arm, scene, bolts, monkeypatch) -> None:
    monkeypatch.setattr("pinproof.cell.placement.place_base.SAMPLE", 2)
    region = PlacementRegion(x=(-0.3, 0.1), y=(-0.3, 0.3))
    stages: dict[str, int] = {}

    def candidates(**budget: int) -> tuple[CertifiedPlacement, ...]:
        stages.clear()
        settings = {"placement_budget": replace(SMALL, **budget)}
        settings["progress"] = lambda stage, done, total: stages.update({stage: total})
        return search(arm, scene, bolts, region, **settings).candidates

    all_judged, one = candidates(sampled=0, certified=8), candidates(sampled=8, certified=1)
    assert stages["sample"] == 8 * 2
    assert stages["certify_1"] == 1  # the verdicts on the other two are known
    sample = np.random.default_rng(0).permutation(3)[:2]
    assert (len(all_judged), len(one)) == (8, 1)
    times = [sum(each.report.verdicts[k].trajectory.duration for k in sample) for each in all_judged]
    assert one[0].placement == all_judged[int(np.argmin(times))].placement


@pytest.mark.slow
def test_workers_do_not_change_the_result(arm, scene, bolts, found) -> None:
    with ThreadPoolExecutor(2) as executor:
        assert search(arm, scene, bolts, found.region, executor=executor).to_dict() == found.to_dict()


def test_interrupted_search_resumes_from_its_folder(tmp_path, arm, scene, bolts, found) -> None:
    stages: list[str] = []

    def stop(stage: str, done: int, total: int) -> None:
        stages.append(stage)
        if stage == "certify_1" and done == 2:
            raise KeyboardInterrupt

    here = arm, scene, bolts, found.region
    with pytest.raises(pp.errors.RunInterrupted) as error:
        search(*here, progress=stop, folder=tmp_path)
    kept = error.value.result
    assert kept.interrupted
    assert kept.map.to_csv() == found.map.to_csv()
    stages.clear()
    again = search(*here, progress=lambda stage, *_: stages.append(stage), folder=tmp_path)
    assert again.to_dict() == found.to_dict()
    assert "grid" not in stages
    assert "certify_1" in stages
    with pytest.raises(pp.errors.CampaignError, match="seed"):
        search(*here, rng=1, folder=tmp_path)


@pytest.mark.slow
def test_killed_search_with_two_workers_resumes_to_the_same_result(tmp_path) -> None:
    picks, region = ROBOTS / "ur5" / "picks.yaml", "-0.3 0.1 -0.3 0.3 0 0 -pi pi"
    words = ["cell", "place", str(picks), "--region", region, "--grid", "300", "--runs", "0", "--certified", "1"]
    killed, journal = str(tmp_path / "killed"), tmp_path / "killed" / "journal.sqlite"
    with started([sys.executable, "-c", RUN_CLI, *words, "--workers", "2", "--campaign", killed]) as running:
        log = journal.with_name("journal.sqlite-wal")
        wait_for(lambda: log.exists() and log.stat().st_size > WRITTEN, by=running)
        running.kill()
    assert rows_in(journal) < 300
    resumed, once = (run_main(*words, "--json", *more)[:2] for more in (("--campaign", killed), ()))
    assert resumed == once
    assert resumed[0] == 1  # some picks of the file are wrong on purpose
    assert json.loads(resumed[1])["placements"][0]["good"] > 0


def test_resumed_search_starts_its_workers_once(tmp_path, arm, scene, bolts, monkeypatch) -> None:
    started: list[LocalWorkers] = []

    class Counted(LocalWorkers):
        def __init__(self, count: int) -> None:
            super().__init__(count)
            started.append(self)

    monkeypatch.setattr(runner, "LocalWorkers", Counted)
    monkeypatch.setattr(executors, "LocalExecutor", lambda: ThreadPoolExecutor(1))
    tiny = PlacementBudget(grid=4, runs=0, evaluations=0, certified=1, deviations=0)
    here = arm, scene, some(bolts, "bolt_1"), PlacementRegion(x=(-0.05, 0.05), y=(-0.05, 0.05))
    for _ in range(2):  # rows from the folder have no motions, so the second search judges the picks again
        search(*here, placement_budget=tiny, folder=tmp_path, workers=1)
    assert len(started) == 2


def test_setups_of_other_placements_keep_no_caches(arm, scene, bolts) -> None:
    """Caches of a judged setup may take hundreds of megabytes, and dozens of placements are judged."""
    placed = PlacedRobot.make(arm, scene, np.eye(4))
    work = PickWork(bolts)
    home, weights = arm.home if not bolts.home else bolts.home_configuration(arm.joint_names, arm.home), PickWeights()
    works = tuple(
        work.at(placed.arm_at(np.array([x, 0, 0, 0])), placed.scene, home, 0, weights, QUICK) for x in (-0.1, -0.05)
    )
    task = CertifyTask(works)
    rows = task(0, [(0, 0)])
    judged = weakref.ref(task._current[0][1].setup)
    rows += task(1, [(1, 0), (1, 1)])
    assert judged() is None
    assert [row["ok"] for row in rows] == [True, True, True]
    assert ["cell" in vars(each.setup) for each in works] == [False, False]
    expected = works[1].setup.judge(1, bolts.picks[1])
    assert rows[2]["duration"] == expected.trajectory.duration  # type: ignore[union-attr]  # it is good


def test_base_stays_out_of_forbidden_zones(arm, scene, bolts) -> None:
    zone = pp.Obstacle("walkway", pp.Box(1.0, 0.6, 1.0), pp.pose(xyz=(0, -0.3, 0)))
    region = PlacementRegion(x=(-0.3, 0.1), y=(-0.5, 0.4), forbidden=(zone,))
    result = search(arm, scene, bolts, region)
    assert result.ok
    assert result.best.placement.y > 0.05  # the radius of the base
    blocked = search(arm, scene, bolts, replace(region, y=(-0.3, -0.2)))
    assert not blocked.ok
    assert "walkway" in blocked.message
    assert set(blocked.failing) == {"bolt_1", "bolt_2", "bolt_5"}


def test_pedestal_moves_with_the_base(arm, scene, bolts) -> None:
    pedestal = pp.Obstacle("pedestal", pp.Cylinder(0.1, 0.3), pp.pose(xyz=(0, 0, -0.16)))
    floor = pp.Obstacle("floor", pp.Box(4, 4, 0.1), pp.pose(xyz=(0, 0, -0.6)))
    parts = pp.Scene([floor, pedestal, *(scene[each.carried or each.name] for each in bolts)])  # type: ignore[index]
    region = PlacementRegion(x=(-0.4, 0.3), y=(-0.6, 0.3), z=(-0.1, 0.2))
    result = search(arm, parts, bolts, region, moves_with_base=["pedestal"])
    assert result.ok
    assert judged_again(arm, parts, bolts, result.best.root_from_cell, ("pedestal",)).ok


def test_choices_are_compared(arm, scene, bolts) -> None:
    region = PlacementRegion(x=(-0.25, -0.05), y=(-0.1, 0.1))
    small = pp.load_robot("ur3").arm(tcp="tool0")
    choices = [PlacementChoice("ur5"), PlacementChoice("ur3", arm=small)]
    result = search(arm, scene, bolts, region, choices=choices)
    assert result.ok
    assert result.best.placement.choice == "ur5"
    share = [result.map.share[result.map.choice == k].max() for k in (0, 1)]
    assert share[0] == 1.0
    assert share[1] < 1.0


def test_robot_on_the_ceiling_is_judged_with_the_vertical_of_the_cell(arm, picks) -> None:
    ceiling = pp.Obstacle("ceiling", pp.Box(3, 3, 0.1), pp.pose(xyz=(0, 0, 0.96)))
    parts = pp.Scene([ceiling], allowed=[("base_link", "ceiling")])
    region = PlacementRegion(x=(0.2, 0.8), y=(-0.3, 0.3), z=(0.9, 0.9))
    bare = replace(some(picks, "bolt_1", "bolt_2"), home={})
    choice = PlacementChoice("ceiling", mounting="ceiling")
    result = search(arm, parts, bare, region, choices=[choice])
    assert result.ok
    up = result.best.arm.root_from_base.rotation @ np.array([0, 0, 1.0])
    np.testing.assert_allclose(up, [0, 0, -1], atol=1e-12)
    assert judged_again(arm, parts, bare, result.best.root_from_cell).ok


def test_no_placement_names_the_picks_that_fail_everywhere(arm, scene, picks) -> None:
    region = PlacementRegion(x=(-0.1, 0.1), y=(-0.1, 0.1))
    chosen = some(picks, "bolt_1", "bolt_3", "bolt_6")
    result = search(arm, scene, chosen, region)
    assert not result.ok
    assert result.least_failing is not None
    assert set(result.failing) == {"bolt_3", "bolt_6"}
    assert "out of reach" in result.failing["bolt_6"]
    assert "bin_far" in result.failing["bolt_3"]
    for answer in (result.or_raise, lambda: result.best):
        with pytest.raises(pp.NoAnswer, match="bolt_3"):
            answer()


def test_deviations_of_the_base_end_where_a_pick_fails_in_any_stage(arm, scene, bolts, monkeypatch) -> None:
    """A transit is made to fail beyond 30 mm, which no screening of poses can notice."""
    judge, judged = PickSetup.judge, dict[float, set[str]]()
    start = -0.1

    def with_a_blocked_transit(self: PickSetup, index: int, pick: pp.Pick) -> PickVerdict:
        verdict, off = judge(self, index, pick), self.checker.arm.held["placement_x"] - start
        judged.setdefault(off, set()).add(pick.name)
        if pick.name != "bolt_2" or off <= 0.03:
            return verdict
        return replace(verdict, status=PickStatus.NOT_FOUND, stages=(StageResult(Stage.TRANSIT, False, "blocked"),))

    monkeypatch.setattr(PickSetup, "judge", with_a_blocked_transit)
    budget = PlacementBudget(grid=1, runs=0, evaluations=0, certified=1, deviations=3)
    region = PlacementRegion(x=(start, start), y=(0.0, 0.0))
    chosen = some(bolts, "bolt_1", "bolt_2")
    result = search(arm, scene, chosen, region, placement_budget=budget)
    assert result.ok
    row = result.sensitivity[0]
    assert (row.axis, row.first_above, row.why_above) == ("x", "bolt_2", "transit")
    assert 0.0285 < row.above <= 0.03
    assert row.below > 0.0
    for most, count, sign in ((row.above, row.judged_above, 1), (row.below, row.judged_below, -1)):
        good = [names for off, names in judged.items() if 1e-9 < sign * off < most + 1e-9]
        assert len(good) == count > 0
        assert all(names == {pick.name for pick in chosen} for names in good)
    assert f"x -{1e3 * row.below:.1f} mm to {1e3 * row.above:.1f} mm" in result.message
    assert str(sum(each.judged_below + each.judged_above for each in result.sensitivity)) in result.message


@pytest.fixture(scope="module")
def shelf_cell() -> tuple[pp.Scene, pp.Picks]:
    """Blocks on a table that are put onto a shelf, at the limit of the reach of a UR5."""
    down = (np.pi, 0, 0)
    blocks = [
        pp.Obstacle(f"block_{i}", pp.Box(0.04, 0.04, 0.1), pp.pose((0.35 + 0.1 * i, -0.1, -0.0045))) for i in (0, 1)
    ]
    table = pp.Obstacle("table", pp.Box(1.6, 1.2, 0.05), pp.pose((0.4, 0, -0.08)))
    shelf = pp.Obstacle("shelf", pp.Box(0.3, 0.8, 0.03), pp.pose((0.1, 0.75, 0.25)))
    parts = [
        pp.Pick(
            f"part_{i}", pp.pose((0.35 + 0.1 * i, -0.1, 0.046), down), carried=f"block_{i}",
            place=PlaceTarget(pp.pose((0.02 + 0.15 * i, 0.7, 0.3665), down)),
        )
        for i in (0, 1)
    ]  # fmt: skip
    return pp.Scene([table, shelf, *blocks]), pp.Picks(tuple(parts), tip=pp.pose((0, 0, 0.12)))


@pytest.fixture(scope="module")
def on_shelf(arm, shelf_cell) -> PlacementResult:
    budget = replace(SMALL, runs=1, certified=1, deviations=2)
    return search(arm, *shelf_cell, PlacementRegion(x=(-0.3, 0.3), y=(-0.5, 0.4)), placement_budget=budget)


@pytest.mark.slow
def test_every_pick_is_good_within_the_stated_deviations_of_the_base(arm, shelf_cell, on_shelf) -> None:
    """Random deviations, judged with the original robot; beyond them the releases are out of reach first."""
    assert on_shelf.ok
    placed, generator, limited = PlacedRobot.make(arm, shelf_cell[0], np.eye(4)), np.random.default_rng(2), 0

    def report(axis: int, by: float) -> pp.picks.PickReport:
        values = on_shelf.best.placement.values.copy()
        values[axis] += by
        return judged_again(arm, *shelf_cell, placed.root_from_cell(values))

    for axis, row in enumerate(on_shelf.sensitivity):
        assert row.searched == pytest.approx(0.4 if row.axis == "yaw" else 0.2)
        for sign, most, first, judged in (
            (-1, row.below, row.first_below, row.judged_below),
            (1, row.above, row.first_above, row.judged_above),
        ):
            assert (first == "") == (most == row.searched)
            assert (judged > 0) == (most > 0)
            for by in generator.uniform(0, most, 2):
                assert report(axis, sign * by).ok, (row.axis, sign * by)
            if first.startswith("part"):
                limited += not report(axis, sign * (1.2 * most + 0.002)).ok
    assert limited >= 2
    assert on_shelf.sensitivity[1].below < 0.15  # farther from the shelf no release is in reach, but every grasp is


@pytest.mark.slow
def test_the_map_counts_no_pick_whose_release_is_out_of_reach(arm, shelf_cell, on_shelf) -> None:
    grid = on_shelf.map
    scene, parts = shelf_cell
    grasps_only = replace(parts, picks=tuple(replace(pick, place=None) for pick in parts))
    fewer = 0
    for row in np.flatnonzero(grid.base)[::4]:
        root_from_cell = PlacedRobot.make(arm, scene, np.eye(4)).root_from_cell(grid.placements[row])
        report = judged_again(arm, scene, parts, root_from_cell)
        counted = round(grid.share[row] * len(parts))
        assert counted >= len(report.good)  # to pass the screening is necessary
        assert counted == (grid.codes[row] == code_of(ScreenStatus.FREE)).sum()
        releases = sum(
            verdict.failed is Stage.PLACE and verdict.status is PickStatus.IMPOSSIBLE for verdict in report.verdicts
        )
        assert counted <= len(parts) - releases
        there = scene.transformed(root_from_cell), grasps_only.transformed(root_from_cell)
        fewer += counted < pp.screen_picks(arm, *there).free.sum()
    assert fewer > 0


def test_files_hold_the_result(tmp_path, found) -> None:
    assert found.sensitivity == ()  # without deviations
    for suffix in ("json", "md", "csv", "png"):
        found.save(tmp_path / f"placement.{suffix}")
    stored = json.loads((tmp_path / "placement.json").read_text())
    assert stored["placements"][0]["cycle_time"] == found.candidates[0].cycle_time
    with (tmp_path / "placement.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found.map)
    seconds = [float(row["estimated_seconds"]) for row in rows if row["estimated_seconds"]]
    assert min(seconds) == pytest.approx(np.nanmin(found.map.seconds))
    assert (tmp_path / "placement.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(pp.InputError, match=r"\.txt"):
        found.save(tmp_path / "placement.txt")


def test_heat_map_is_drawn_on_the_floor(found) -> None:
    grid = found.map
    columns = len(grid.axes[0]) * len(grid.axes[1])
    assert len(grid.floor_points().xyz) == columns
    seconds = grid.floor_points(seconds=True, height=0.1)
    assert 0 < len(seconds.xyz) <= columns
    assert (seconds.xyz[:, 2] == 0.1).all()
    fastest = grid.placements[np.nanargmin(grid.seconds)]
    assert np.abs(seconds.xyz[:, :2] - fastest[:2]).max(axis=1).min() < 1e-12


def test_grid_covers_the_region_with_similar_steps() -> None:
    region = PlacementRegion(x=(0.0, 2.0), y=(0.0, 1.0), yaw=(-np.pi, np.pi))
    x, y, z, yaw = region.axes(1000)
    assert len(z) == 1
    assert len(x) * len(y) * len(yaw) == pytest.approx(1000, rel=0.2)
    assert x[1] - x[0] == pytest.approx(y[1] - y[0], rel=0.15)
    assert x[0] == pytest.approx((x[1] - x[0]) / 2)


def test_invalid_regions_and_choices_are_refused() -> None:
    for change, named in (
        ({"x": (0.2, -0.2)}, "empty"),
        ({"x": (300.0, 400.0)}, "metres"),
        ({"yaw": (-180.0, 180.0)}, "radians"),
        ({"forbidden": [pp.Obstacle("a", pp.Sphere(1))] * 2}, "repeated: a"),
    ):
        with pytest.raises(pp.InputError, match=named):
            PlacementRegion(**{"x": (0, 1), "y": (0, 1), **change})  # type: ignore[arg-type]
    with pytest.raises(pp.UnknownNameError, match="ceiling"):
        PlacementChoice("a", mounting="roof")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"objective": "cycletime"}, "cycle_time"),
        ({"moves_with_base": ["tabel"]}, "table"),
        ({"choices": [PlacementChoice("a"), PlacementChoice("a")]}, "repeated: a"),
        ({"picks": []}, "no picks"),
        ({"picks": [pp.Pick("a", pp.pose(), frame="base_link")]}, "moves with the base"),
    ],
)
def test_invalid_searches_are_refused(arm, scene, bolts, change: dict[str, object], words: str) -> None:
    region = PlacementRegion(x=(0, 1), y=(0, 1))
    with pytest.raises(pp.InputError, match=words):
        search(arm, scene, region=region, **{"picks": bolts, **change})


def test_parts_in_the_way_are_left_out(arm) -> None:
    picks = pp.read_picks(ROBOTS / "ur5" / "plate_picks.yaml")
    stacked = pp.Scene.load(ROBOTS / "ur5" / "plate_scene.yaml")
    lid = pp.Obstacle("lid", pp.Box(0.03, 0.03, 0.01), stacked["bolt_0_0"].pose * pp.pose(xyz=(0, 0, 0.0255)))
    on_top = pp.Pick("lid", lid.pose * pp.pose(xyz=(0, 0, 0.01), rpy=(np.pi, 0, 0)), carried="lid", support="bolt_0_0")
    above, scene = pp.pose(xyz=(0, 0, 0.02), rpy=(np.pi, 0, 0)), stacked.add(lid)
    below = replace(some(picks, "bolts[0,0]").picks[0], frame="bolt_0_0", pose=above)
    both = replace(picks, picks=(below, on_top))
    assert [verdict.ok for verdict in pp.validate_picks(arm, scene, both, budget=QUICK).verdicts] == [False, True]
    bare, alone = without_parts(arm, scene, both)
    assert set(scene.names) - set(bare.names) == {"lid", "bolt_0_0"}
    report = pp.validate_picks(arm, bare, alone, budget=QUICK)
    assert [verdict.ok for verdict in report.verdicts] == [True, True]
    assert "bolt_0_0" in [body.name for body in report.verdicts[0].motions[2].attached]


def test_a_missing_extra_is_reported_before_anything_is_screened(arm, scene, bolts, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "cma", None)
    region, reports = PlacementRegion(x=(-0.1, 0.1), y=(-0.1, 0.1)), []
    with pytest.raises(pp.InputError, match=r"pinproof\[cell\]"):
        search(arm, scene, bolts, region, progress=lambda *report: reports.append(report))
    assert reports == []
    grid_only = replace(SMALL, grid=1, runs=0, certified=1)
    assert search(arm, scene, bolts, region, placement_budget=grid_only).evaluations > 0
