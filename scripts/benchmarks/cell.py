"""Benchmark of base placement: searches on cells of the package and random variants, and exhaustive grids.

./scripts/benchmark cell                          all cells; prints the table
./scripts/benchmark cell bolts --workers 2        one cell
./scripts/benchmark cell "small bolts"            judges every placement of a small grid; takes long
./scripts/benchmark cell pallets --scale 10000    only screens so many placements, kills the process and resumes
./scripts/benchmark cell bolts --docs             replaces these rows in docs/benchmarks/cell.*
"""

from __future__ import annotations

import argparse
import os
import resource
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep
from typing import Any

import numpy as np

import pinproof as pp
from benchmarks.tables import Benchmark, Blocks, Results, Row, page_parser, provenance, report, row_table
from pinproof.cell import PlacementBudget, PlacementRegion, PlacementResult, place_base, without_parts
from pinproof.cell.placement.region import PlacedRobot
from pinproof.cell.placement.screening import FREE
from pinproof.description import robots_folder
from pinproof.picks import PickBudget, PickWeights
from pinproof.picks.judging.setup import PickSetup
from pinproof.work.journal import JOURNAL

QUANTILES = 24
"""Number of placements of the grid, at equal steps of the rank of their estimates, that are judged for the median."""

FASTEST = PickWeights(clearance=0.0, limit_margin=0.0, manipulability=0.0, duration=1.0)
JUDGING = PickBudget(remedies=0)


LARGE = PlacementBudget(grid=10_000, runs=6, evaluations=200, certified=4)


@dataclass(frozen=True)
class BenchmarkCell:
    """A cell whose robot is placed."""

    arm: pp.Arm
    scene: pp.Scene
    picks: pp.Picks
    region: PlacementRegion
    moves_with_base: tuple[str, ...] = ()
    budget: PlacementBudget = LARGE


def bolts(count: tuple[int, int] = (20, 10), seed: int | None = None) -> BenchmarkCell:
    """Bolts in a bin on a table and a UR5 on a pedestal; with a seed, at random positions."""
    shared = pp.read_picks(robots_folder() / "ur5" / "picks.yaml")
    x, y = np.meshgrid(0.35 + 0.4 * np.arange(count[0]) / count[0], -0.135 + 0.3 * np.arange(count[1]) / count[1])
    places = np.column_stack([x.ravel(), y.ravel()])
    generator = np.random.default_rng(seed)
    if seed is not None:
        places = generator.uniform([0.35, -0.14], [0.74, 0.14], (len(places), 2))  # the wrist must clear the walls
    picks = [pp.Pick(f"bolt_{k}", pp.pose(xyz=(*at, 0.035), rpy=(np.pi, 0, 0))) for k, at in enumerate(places.tolist())]
    heads = [
        pp.Obstacle(pick.name, pp.Cylinder(0.008, 0.04), pp.pose(xyz=(*pick.pose.translation[:2], 0.01)))
        for pick in picks
    ]
    height = 0.12 if seed is None else float(generator.uniform(0.05, 0.2))
    sides = {"near": (0.29, 0.0, 0.01, 0.42), "far": (0.81, 0.0, 0.01, 0.42), "right": (0.55, -0.21, 0.53, 0.01),
             "left": (0.55, 0.21, 0.53, 0.01)}  # fmt: skip
    walls = [
        pp.Obstacle(name, pp.Box(dx, dy, height), pp.pose(xyz=(at, to, height / 2 - 0.009)))
        for name, (at, to, dx, dy) in sides.items()
    ]
    table = pp.Obstacle("table", pp.Box(1.2, 1.0, 0.04), pp.pose(xyz=(0.55, 0, -0.03)))
    pedestal = pp.Obstacle("pedestal", pp.Box(0.2, 0.2, 0.5), pp.pose(xyz=(0, 0, -0.26)))
    return BenchmarkCell(
        shared.load_arm(),
        pp.Scene([table, *walls, *heads, pedestal]),
        replace(shared, picks=tuple(picks)),
        PlacementRegion(x=(-0.6, 1.7), y=(-1.1, 1.1), z=(-0.1, 0.5), yaw=(-np.pi, np.pi)),
        ("pedestal",),
    )


def panda_bin() -> BenchmarkCell:
    """The picks of the Panda bin that work at its present placement; the Panda has seven joints."""
    folder = robots_folder() / "panda"
    picks = pp.read_picks(folder / "bin_picks.yaml")
    names = ("standing", "round", "leaning", "lying")
    return BenchmarkCell(
        picks.load_arm(),
        pp.Scene.load(folder / "bin_scene.yaml"),
        replace(picks, picks=tuple(pick for pick in picks if pick.name in names)),
        PlacementRegion(x=(-0.3, 0.2), y=(-0.4, 0.4), yaw=(-1.0, 1.0)),
        budget=PlacementBudget(grid=1000, runs=4, evaluations=60, certified=4),
    )


def pallets(every: int = 1) -> BenchmarkCell:
    """The palletising cell: boxes from two supplies in turn onto two pallets, each judged without the other boxes."""
    picks = pp.read_picks(robots_folder() / "ur10" / "pallet_picks.yaml")
    arm, scene = picks.load_arm(), pp.Scene.load(robots_folder() / "ur10" / "pallet_scene.yaml")
    alone, picks = without_parts(arm, scene, replace(picks, picks=picks.picks[::every]))
    boxes = [name for name in alone.names if "deck" not in name and name != "floor"]
    return BenchmarkCell(
        arm,
        alone.remove(*boxes),
        picks,
        PlacementRegion(x=(-0.6, 0.8), y=(-0.6, 0.6), z=(0.0, 0.5), yaw=(-np.pi, np.pi)),
        budget=PlacementBudget(grid=4000, runs=3, evaluations=80, certified=2),
    )


CELLS: Mapping[str, Callable[[], BenchmarkCell]] = {
    "bolts": bolts,
    "bolts, random 1": lambda: bolts(seed=1),
    "bolts, random 2": lambda: bolts(seed=2),
    "panda bin": panda_bin,
    "pallets": pallets,
    "pallets, one supply": lambda: pallets(4),
}

SMALL = {
    "small bolts": (lambda: bolts((5, 4)), (15, 15, 4, 6)),
    "small bolts, random 1": (lambda: bolts((3, 3), seed=1), (12, 12, 3, 6)),
    "small pallets": (lambda: pallets(21), (9, 8, 3, 12)),
}
"""Cells for which every placement of a grid is judged, and the numbers of cells of the grid along x, y, z and yaw."""


def cpu_seconds() -> float:
    """Processor time (s) of this process and its finished children."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    )


def search(cell: BenchmarkCell, workers: int | None) -> tuple[PlacementResult, float, float]:
    """The result of a search, its duration and its processor time (s)."""
    start, before = perf_counter(), cpu_seconds()
    found = place_base(
        cell.arm, cell.scene, cell.picks, cell.region, moves_with_base=cell.moves_with_base,
        placement_budget=cell.budget, workers=workers,
    )  # fmt: skip
    return found, perf_counter() - start, cpu_seconds() - before


def time_if_all_good(cell: BenchmarkCell, placed: PlacedRobot, values: np.ndarray) -> float:
    """The certified cycle time (s) at a placement; NaN if a pick is not good, and the picks after it are not judged."""
    setup = PickSetup.make(
        placed.arm_at(values), placed.scene, cell.picks, home=None, rng=0, weights=FASTEST, budget=JUDGING
    )
    total = 0.0
    for index, pick in enumerate(cell.picks):
        trajectory = setup.judge(index, pick).trajectory
        if trajectory is None:
            return np.nan
        total += trajectory.duration
    return total


def times_over_grid(cell: BenchmarkCell, found: PlacementResult) -> list[float]:
    """The certified times (s) at placements of the grid at equal steps of their rank; NaN if a pick is not good.

    The base and all grasps are free at these placements. Those without an estimate, at which a line seems to be
    blocked, are ranked last and not left out.
    """
    if found.map is None or not found.ok:
        return []
    free = np.flatnonzero(found.map.base & (found.map.codes == FREE).all(axis=1))
    free = free[np.argsort(found.map.seconds[free], kind="stable")]
    chosen = free[((np.arange(QUANTILES) + 0.5) / QUANTILES * len(free)).astype(int)]
    return [time_if_all_good(cell, found.best.placed, found.map.placements[k]) for k in chosen]


def search_row(name: str, workers: int) -> Row:
    """One search, with the certified median over feasible placements of its grid; times in s."""
    load, cell = os.getloadavg()[0], CELLS[name]()
    found, seconds, cpu = search(cell, workers)
    times = times_over_grid(cell, found)
    feasible = int(np.isfinite(times).sum())
    return Row(
        cell=name,
        picks=len(cell.picks),
        screened=found.evaluations,
        workers=workers,
        seconds=seconds,
        cpu_seconds=cpu,
        good=len(found.least_failing.report.good) if found.least_failing is not None else 0,
        best=found.best.cycle_time if found.ok else None,
        median=float(np.nanmedian(times)) if feasible else None,
        load=load,
        feasible=feasible,
        tried=len(times),
    )


def screen_into(name: str, placements: int, workers: int, folder: Path) -> PlacementResult:
    """A search without refinement and proofs that keeps its rows in a folder."""
    cell = CELLS[name]()
    budget = PlacementBudget(grid=placements, runs=0, evaluations=0, certified=1)
    return place_base(
        cell.arm, cell.scene, cell.picks, cell.region, moves_with_base=cell.moves_with_base,
        placement_budget=budget, workers=workers, folder=folder,
    )  # fmt: skip


def scale_row(name: str, placements: int, workers: int) -> Row:
    """Screen a large grid; then again in a process that is killed, and resume; memory and storage in MB."""
    load = os.getloadavg()[0]
    with TemporaryDirectory() as scratch:
        once, killed = Path(scratch) / "once", Path(scratch) / "killed"
        start, before = perf_counter(), cpu_seconds()
        found = screen_into(name, placements, workers, once)
        seconds, cpu = perf_counter() - start, cpu_seconds() - before
        memory = [resource.getrusage(who).ru_maxrss / 1e3 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        storage = sum(file.stat().st_size for file in once.rglob("*") if file.is_file()) / 1e6
        options = ["--scale", str(placements), "--workers", str(workers), "--folder", str(killed)]
        command = [sys.executable, "-m", "benchmarks", "cell", name, *options]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        while process.poll() is None and screened(killed) <= 0.4 * placements:
            sleep(0.1)
        process.kill()
        process.wait()
        done = screened(killed)
        again = screen_into(name, placements, workers, killed)
    if again.map is None or found.map is None:
        raise RuntimeError(f"{name}: no placement was screened")
    return Row(
        cell=name,
        picks=len(found.picks),
        placements=len(found.map),
        workers=workers,
        seconds=seconds,
        cpu_seconds=cpu,
        memory=memory[0],
        worker_memory=memory[1],
        storage=storage,
        killed_after=done,
        equal=again.to_dict() == found.to_dict() and again.map.to_csv() == found.map.to_csv(),
        load=load,
    )


def screened(folder: Path) -> int:
    """The number of placements in the journal of a search."""
    journal = folder / "grid" / JOURNAL
    if not journal.exists():
        return 0
    with closing(sqlite3.connect(journal)) as database:
        return int(database.execute("SELECT count(*) FROM rows").fetchone()[0])


def exhaustive_row(name: str) -> Row:
    """Judge every placement of a grid at which the base and all grasps are free, and search for the best placement."""
    load, before = os.getloadavg()[0], cpu_seconds()
    make, numbers = SMALL[name]
    cell = make()
    placed = PlacedRobot.make(cell.arm, cell.scene, np.eye(4), cell.moves_with_base)
    grid = np.stack(np.meshgrid(*cell.region.cells(numbers), indexing="ij"), axis=-1).reshape(-1, 4)
    free = placed.checker(cell.picks).is_free_batch(np.hstack([grid, np.tile(cell.arm.home, (len(grid), 1))]))
    times = []
    for values in grid[free]:
        screened = pp.screen_picks(placed.arm_at(values), placed.scene, cell.picks)
        if screened.free.all():  # with every configuration enumerated, a grasp that is not free excludes the placement
            times.append(time_if_all_good(cell, placed, values))
    cpu = cpu_seconds() - before
    found, _, search_cpu = search(cell, None)
    return Row(
        cell=name,
        picks=len(cell.picks),
        grid=len(grid),
        judged=len(times),
        feasible=int(np.isfinite(times).sum()),
        cpu_seconds=cpu,
        grid_best=float(np.nanmin(times)),
        grid_median=float(np.nanmedian(times)),
        search_best=found.best.cycle_time if found.ok else None,
        search_cpu_seconds=search_cpu,
        load=load,
    )


def blocks(results: Results) -> Blocks:
    """The tables of the page."""

    def share(ours: float | None, other: float | None, sign: str = "") -> str:
        return "" if ours is None or other is None else f"{ours / other - 1:{sign}.1%}"

    first = {"cell": "{.cell}", "picks": "{.picks}"}
    last = {"load": "{.load:.2f}"}
    placements = {
        **first,
        "screened": "{.screened:,}",
        "workers": "{.workers}",
        "seconds": "{.seconds:.0f}",
        "CPU": "{.cpu_seconds:.0f}",
        "good": "{.good}",
        "best": "{.best:.2f}",
        "median": "{.median:.2f}",
        "against the median": lambda row: share(row.best, row.median),
        "feasible": lambda row: f"{row.feasible} of {row.tried}" if row.tried else "",
        **last,
    }
    exhaustive = {
        **first,
        "grid": "{.grid:,}",
        "judged": "{.judged}",
        "all good": "{.feasible}",
        "CPU": "{.cpu_seconds:.0f}",
        "grid best": "{.grid_best:.2f}",
        "grid median": "{.grid_median:.2f}",
        "search best": "{.search_best:.2f}",
        "against the median": lambda row: share(row.search_best, row.grid_median),
        "against the best": lambda row: share(row.search_best, row.grid_best, "+"),
        "CPU of search": "{.search_cpu_seconds:.0f}",
        **last,
    }
    scale = {
        **first,
        "placements": "{.placements:,}",
        "workers": "{.workers}",
        "seconds": "{.seconds:.0f}",
        "CPU": "{.cpu_seconds:.0f}",
        "MB": "{.memory:.0f}",
        "MB of a worker": "{.worker_memory:.0f}",
        "MB stored": "{.storage:.1f}",
        "killed after": "{.killed_after:,}",
        "equal": lambda row: "yes" if row.equal else "NO",
        **last,
    }
    kinds = {"placements": placements, "exhaustive": exhaustive, "scale": scale}
    return {name: row_table(columns, results[name]) for name, columns in kinds.items()}


def measure(options: argparse.Namespace) -> Results:
    """Measure the cells that the options select."""
    names = options.cells or [*CELLS]
    if options.folder is not None:
        screen_into(names[0], options.scale, options.workers, options.folder)
        sys.exit()
    parts: dict[str, Any] = {"placements": [], "exhaustive": [], "scale": []}
    results = Results({"workers": options.workers}, provenance(0), parts)
    for name in names:
        if options.scale:
            parts["scale"].append(scale_row(name, options.scale, options.workers))
        elif name in SMALL:
            parts["exhaustive"].append(exhaustive_row(name))
        else:
            parts["placements"].append(search_row(name, options.workers))
        report(f"{name}: done")
    return results


BENCHMARK = Benchmark("cell", measure, blocks, keys=("cell",))


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "cell")
    parser.add_argument(
        "cells", nargs="*", metavar="CELL", choices=[*CELLS, *SMALL, []], help=", ".join([*CELLS, *SMALL])
    )
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--scale", type=int, metavar="N", help="only screen N placements, kill the process and resume")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    BENCHMARK.run(parser)
