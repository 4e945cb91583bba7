"""A small run of the picks benchmark."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from benchmarks.picks import BENCHMARK, CELLS, pick_cell, picks_benchmark, steady_rate
from benchmarks.tables import Results, Row

import pinproof as pp
from pinproof.errors import InputError


@pytest.fixture(scope="module")
def table() -> Results:
    return picks_benchmark(["generic_6dof"], picks=4, poses=200, campaign=0, overhead=20, durations=())


@pytest.mark.slow
def test_every_part_is_there(table: Results) -> None:
    complete = table["verdicts"][0]
    assert (complete.cell, complete.verdict, complete.picks) == ("generic_6dof", "all", 4)
    assert sum(row.picks for row in table["verdicts"][1:]) == 4
    assert 0 < complete.median_ms <= complete.p95_ms <= complete.largest_ms
    assert [row.poses for row in table["screening"]] == ["picks", "random configurations"]
    for row in table["screening"]:
        assert 0 < row.free <= 1
        assert min(row.rate, row.with_clearance, row.reach_only, row.two_threads) > 0
    assert table["overhead"][0].picks == 20
    assert table.provenance["seed"] == 0


def test_speed_ups_are_relative_to_one_process() -> None:
    rows = [
        Row(
            cell="ur5",
            workers=f"{n} process",
            picks=100,
            wall_s=10 / n + 1,
            rate=100 / (10 / n + 1),
            steady_rate=10 * n,
        )
        for n, t in ((1, 11.0), (2, 6.0))
    ]
    lines = BENCHMARK.blocks(Results({}, {}, {"campaigns": rows}))["campaigns"]
    assert lines[-1] == "| ur5 | 2 process | 100 | 6.0 | 16.7 | 1.83 | 20.0 | 2.00 |"


def test_the_steady_rate_excludes_start_and_end() -> None:
    slow_start = [(0.0, 0), (5.0, 10), *((5.0 + k, 10 + 10 * k) for k in range(1, 9)), (30.0, 100)]
    assert steady_rate(slow_start, 100) == pytest.approx(10.0)


@pytest.mark.parametrize("name", CELLS)
def test_the_same_seed_gives_the_same_picks_above_the_table(name: str) -> None:
    cell = pick_cell(name)
    one, two = (cell.picks(5, 3) for _ in range(2))
    for a, b in zip(one, two, strict=True):
        assert pp.xyz_rpy(a.pose) == pytest.approx(pp.xyz_rpy(b.pose))
        assert a.pose.rotation[2, 2] < -np.cos(np.radians(30.0)) + 1e-9
        assert a.pose.translation[2] >= 0.035
        assert (a.place is not None) == name.endswith("carried")


@pytest.mark.parametrize("how", [{"picks": -1}, {"poses": -1}, {"cells": ["moon"]}, {"durations": ["moon"]}])
def test_invalid_settings_are_refused(how: dict) -> None:
    with pytest.raises(InputError):
        picks_benchmark(**{"cells": [], "durations": (), **how})


@pytest.mark.slow
def test_the_command_prints_the_table(printed: Callable[..., str]) -> None:
    nothing = ("--poses", "0", "--campaign", "0", "--overhead", "0")
    lines = printed("picks", "generic_6dof", "--picks", "2", *nothing, "--files", "generic_6dof/picks").splitlines()
    assert any(line.startswith("| generic_6dof | all | 2 |") for line in lines)
    durations = next(line for line in lines if line.startswith("| generic_6dof/picks |"))
    assert durations.endswith("| 0 of 2 |")  # motions in contact
