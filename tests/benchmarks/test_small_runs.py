"""Benchmarks on their smallest sizes: each runs, finds no wrong verdict and fills its tables."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks import programs, rates, several_arms, stations, tool_paths
from benchmarks.__main__ import main

import pinproof as pp


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
