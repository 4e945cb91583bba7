"""Benchmarks on their smallest sizes: each runs, finds no wrong verdict and fills its tables."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import yaml
from benchmarks import (
    arm_picks,
    carried_parts,
    cell,
    depth,
    programs,
    rates,
    sequence,
    several_arms,
    stations,
    tool_paths,
    worker_peers,
)
from benchmarks.__main__ import main
from benchmarks.planning_problems import own_problems
from scipy.interpolate import BPoly

import pinproof as pp
from pinproof.cell import PlacementBudget


@pytest.mark.parametrize("mbm", ["box"], indirect=True)
@pytest.mark.parametrize(
    ("options", "cells"),
    [
        (["timing"], ["| pinproof |"]),
        (["replanning", "--runs", "0"], ["| all | 2 |"]),
        (["reuse", "--changes", "3"], ["| box | 3 |"]),
    ],
    ids=["timing", "replanning", "reuse"],
)
def test_benchmarks_of_motions_run(
    mbm: Path, options: list[str], cells: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["benchmark", *options, "--mbm", str(mbm), "--problems", "1"])
    if options[0] == "timing":
        main()
    else:
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == 0
    printed = capsys.readouterr().out
    assert all(cell in printed for cell in cells), printed


def test_bounds_of_rates_hold_at_samples() -> None:
    row = rates.measure_robot("ur5", 2, 20)
    assert row.violations == 0
    assert row.samples > 20


def test_a_program_is_certified_and_sampled() -> None:
    row = programs.measured(0, 0)
    assert row is not None
    assert (row.free, row.contacts, row.wrong) == (1, 0, [])
    assert row.samples > 500


def test_a_tool_path_is_audited() -> None:
    row = tool_paths.audited("ur5", 0)
    assert row.wrong == []
    assert row.status in {status.name for status in pp.tool_paths.FollowStatus}


def test_two_gp4_have_the_published_kinematics_and_their_motion_is_certified() -> None:
    group, scene = stations.stations()["two GP4"]
    arm = pp.load_robot(stations._gp4()).arm(tcp="flange")
    # Upper arm 0.26 m, forearm 0.29 m with 0.015 m offset, flange 0.072 m, shoulder at 0.33 m
    assert arm.forward_kinematics(np.zeros(6)).translation == pytest.approx([0.362, 0.0, 0.605])
    problem = next(each for each in stations.station_problems(1, 0) if each.set_name == "two GP4")
    assert problem.group.dof == group.dof == 12
    assert "table" in scene.names
    row = several_arms.measure_problem(problem, 0)
    assert (row.status, row.wrong) == ("FREE", [])
    together = stations.coordinated(problem, 0)
    assert together.ok
    assert together.wrong == []


def test_a_second_view_only_makes_known_what_was_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(depth, "REPEATS", 1)
    monkeypatch.setattr(depth, "CAMERA", pp.collision.Intrinsics(75, 75, 39.5, 29.5, 80, 60))
    monkeypatch.setattr(depth, "VOXEL", 0.02)
    rows = {row.step: row.result for row in depth.time_rows(0)}
    one, both = (
        [int(part.split()[0].replace(",", "")) for part in rows[step].split(", ")]
        for step in ("`OccupancyGrid.from_depth`", "fusing with a second view")
    )
    assert sum(one) == sum(both) == 50**3  # a cube of 1 m
    assert both[2] < one[2]
    # Points are cells as the grid has them, and occupied alike
    among = [rows[f"`certify` among the {kind}"] for kind in ("points", "grid")]
    assert all(text.startswith("FREE, clearance ") for text in among)
    assert among[0] == among[1]


def test_every_judged_placement_of_a_small_cell_is_no_faster_than_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    budget = PlacementBudget(grid=100, runs=0, evaluations=0, certified=1, deviations=0)
    monkeypatch.setitem(cell.SMALL, "tiny", (lambda: replace(cell.bolts((2, 1)), budget=budget), (3, 3, 1, 2)))
    row = cell.exhaustive_row("tiny")
    assert (row.picks, row.grid) == (2, 18)
    assert 0 < row.feasible <= row.judged < row.grid
    assert row.grid_best <= row.grid_median
    # The search has another, finer grid, of which one placement is certified
    assert row.search_best <= row.grid_best


def test_the_motions_of_a_sequence_are_between_the_bound_and_other_orders(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sequence.CELLS, "few", ("ur5/picks.yaml", sequence.POINTS["ur5"], 3, 3))
    row = sequence.sequence_row("few")
    assert (row.picks, row.left_out, row.motions, row.unsafe) == (3, 0, 10, 0)
    assert row.bound_s <= row.motions_s < row.file_order_s
    assert row.motions_s <= min(row.nearest_s, row.greedy_s)
    assert row.proven_mm > 0


def shortened(file: Path, folder: Path, keep: slice) -> Path:
    """A copy of a picks file with some of its picks, beside a copy of its scene."""
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    shutil.copy(file.parent / content["scene"], folder)
    content["picks"] = content["picks"][keep]
    if belt := content.get("conveyor"):
        belt["parts"] = belt["parts"][keep]
    made = folder / file.name
    made.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return made


def test_a_part_is_taken_from_a_belt_without_a_contact(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = shortened(arm_picks.ROBOTS / "ur5" / "conveyor_picks.yaml", tmp_path, slice(1))
    monkeypatch.setattr(arm_picks, "CONVEYORS", {"one block": file})
    (row,) = arm_picks.belt_rows((0.2,), 0)
    assert (row.parts, row.taken, row.missed, row.wrong) == (1, 1, [], [])
    assert row.samples > 1000


def test_two_arms_empty_a_bin_faster_than_one_without_a_contact(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arm_picks, "TWO_ARMS", shortened(arm_picks.TWO_ARMS, tmp_path, slice(0, None, 39)))
    row = arm_picks.shared_bin_row(0)
    assert (row.picks, row.status, row.wrong) == (2, "FREE", [])
    assert row.makespan < row.one_arm
    assert row.samples > 500


def test_a_carried_part_keeps_its_proven_deviation_and_the_check_finds_a_smaller_one() -> None:
    carriers = carried_parts.carriers()[0]
    row = carried_parts._measured(carriers, 1, 0)
    assert (row.problems, row.found, row.failed, row.wrong) == (1, 1, [], [])
    assert 0.0 < row.share <= 1.0
    start, goal = (pp.pose(*np.split(ranges.mean(axis=0), 2)) for ranges in (carriers.start, carriers.goal))
    motion = pp.planning.plan_carry(carriers.checker, carriers.part, carriers.grasps, start, goal, rng=0)
    claimed = SimpleNamespace(
        **{name: getattr(motion, name) for name in ("checker", "trajectory", "leader", "grasps")},
        deviations={name: replace(bound, position=1e-9) for name, bound in motion.deviations.items()},
    )
    assert any("are proven" in fault for fault in carried_parts.check(claimed)[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("work", "message"), [("os._exit(3)", "ended with 3"), ("time.sleep(60)", "no answer within 1 s")]
)
def test_a_worker_without_an_answer_has_not_solved_its_problem(
    work: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker = f"import os, sys, time\nprint(sys.stdin.readline() and '{{}}', flush=True)\nsys.stdin.readline()\n{work}\n"
    (tmp_path / "worker.py").write_text(worker, encoding="utf-8")
    (easy,) = own_problems("generic_6dof", "shelf", 1)
    command = sys.executable, str(tmp_path / "worker.py")
    solve = worker_peers._prepare(command, easy, pp.CollisionChecker(easy.arm, easy.scene))
    monkeypatch.setattr(worker_peers, "PATIENCE", 1.0)
    answer = solve(0)
    assert answer.curve is None
    assert message in answer.message


def test_toppra_takes_the_analytic_time_of_a_straight_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "copp_py", ModuleType("copp_py"))  # installed in another environment
    timing_worker = pytest.importorskip("benchmarks.timing_worker")
    curve = BPoly(np.array([[[0.0, 0.0]], [[2.0, 1.0]]]), [0.0, 1.0])
    seconds = timing_worker._toppra(curve, np.array([1.0, 1.0]), 4.0, np.linspace(0.0, 1.0, 401))
    assert seconds == pytest.approx(2.0 / 1.0 + 1.0 / 4.0, rel=0.005)
