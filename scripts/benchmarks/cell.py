"""Benchmark of base placement: searches on cells of the package and random variants, and exhaustive grids.

./scripts/benchmark cell                          all cells; prints the table
./scripts/benchmark cell bolts --workers 2        one cell
./scripts/benchmark cell "small bolts"            judges every placement of a small grid; takes long
./scripts/benchmark cell pallets --scale 10000    only screens so many placements, kills the process and resumes
./scripts/benchmark cell bolts --docs             replaces these rows in docs/benchmarks/cell.*
./scripts/benchmark cell --render                 rewrites the page from cell.json
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep
from typing import Any, ClassVar

import numpy as np

import pinproof as pp
from benchmarks.tables import BenchmarkTable, markdown_table, provenance, provenance_text, wrapped
from pinproof.cell import PlacementBudget, PlacementRegion, PlacementResult, place_base, without_parts
from pinproof.cell.placement.placed_robot import PlacedRobot
from pinproof.cell.placement.screening import FREE
from pinproof.description import robots_folder
from pinproof.picks import PickBudget, PickWeights
from pinproof.picks.judging.setup import PickSetup

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "benchmarks"

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


@dataclass(frozen=True)
class PlacementRow:
    """A search: the work and the time (s), and the cycle times (s) of its result and of the median placement."""

    cell: str
    picks: int
    screened: int
    workers: int
    seconds: float
    cpu_seconds: float
    good: int
    best: float | None
    median: float | None
    load: float | None = None
    feasible: int = 0
    tried: int = 0


@dataclass(frozen=True)
class ScaleRow:
    """A screened grid: the work (s), memory and storage (MB), and what was left after the process was killed.

    ``equal`` states whether the resumed search has the same rows as one that was not killed.
    """

    cell: str
    picks: int
    placements: int
    workers: int
    seconds: float
    cpu_seconds: float
    memory: float
    worker_memory: float
    storage: float
    killed_after: int
    equal: bool
    load: float | None = None


@dataclass(frozen=True)
class ExhaustiveRow:
    """An exhaustive grid: its placements, those that were judged, those where all picks are good, and times (s)."""

    cell: str
    picks: int
    grid: int
    judged: int
    feasible: int
    cpu_seconds: float
    grid_best: float
    grid_median: float
    search_best: float
    search_cpu_seconds: float
    load: float | None = None


@dataclass(frozen=True)
class CellTable(BenchmarkTable):
    """The results of all searches."""

    placements: tuple[PlacementRow, ...] = ()
    exhaustive: tuple[ExhaustiveRow, ...] = ()
    scale: tuple[ScaleRow, ...] = ()

    topic: ClassVar[str] = "cells"
    row_types: ClassVar[Mapping[str, Callable[..., Any]]] = {
        "placements": PlacementRow,
        "exhaustive": ExhaustiveRow,
        "scale": ScaleRow,
    }


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


def measure(name: str, cell: BenchmarkCell, workers: int | None) -> PlacementRow:
    """One search, with the certified median over feasible placements of its grid."""
    load = os.getloadavg()[0]
    found, seconds, cpu = search(cell, workers)
    times = times_over_grid(cell, found)
    feasible = int(np.isfinite(times).sum())
    good = len(found.least_failing.report.good) if found.least_failing is not None else 0
    return PlacementRow(
        name,
        len(cell.picks),
        found.evaluations,
        workers or 1,
        seconds,
        cpu,
        good,
        found.best.cycle_time if found.ok else None,
        float(np.nanmedian(times)) if feasible else None,
        load,
        feasible,
        len(times),
    )


def screen_into(name: str, placements: int, workers: int, folder: Path) -> PlacementResult:
    """A search without refinement and proofs that keeps its rows in a folder."""
    cell = CELLS[name]()
    budget = PlacementBudget(grid=placements, runs=0, evaluations=0, certified=1)
    return place_base(
        cell.arm, cell.scene, cell.picks, cell.region, moves_with_base=cell.moves_with_base,
        placement_budget=budget, workers=workers, folder=folder,
    )  # fmt: skip


def scale(name: str, placements: int, workers: int) -> ScaleRow:
    """Screen a large grid; then again in a process that is killed, and resume."""
    load = os.getloadavg()[0]
    with TemporaryDirectory() as scratch:
        once, killed = Path(scratch) / "once", Path(scratch) / "killed"
        start, before = perf_counter(), cpu_seconds()
        found = screen_into(name, placements, workers, once)
        seconds, cpu = perf_counter() - start, cpu_seconds() - before
        memory = [resource.getrusage(who).ru_maxrss / 1e3 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        storage = sum(file.stat().st_size for file in once.rglob("*") if file.is_file()) / 1e6
        command = [
            sys.executable,
            "-m",
            "benchmarks",
            "cell",
            name,
            "--scale",
            str(placements),
            "--workers",
            str(workers),
        ]
        process = subprocess.Popen([*command, "--folder", str(killed)], stdout=subprocess.DEVNULL)
        journal = killed / "grid" / "journal.jsonl"
        while process.poll() is None and not (journal.exists() and lines(journal) > 0.4 * placements):
            sleep(0.1)
        process.kill()
        process.wait()
        done = lines(journal) if journal.exists() else placements
        again = screen_into(name, placements, workers, killed)
    equal = again.to_dict() == found.to_dict() and again.map is not None and found.map is not None
    equal = equal and again.map.to_csv() == found.map.to_csv()  # type: ignore[union-attr]
    rows = 0 if found.map is None else len(found.map)
    return ScaleRow(name, len(found.picks), rows, workers, seconds, cpu, *memory, storage, done, equal, load)


def lines(path: Path) -> int:
    """The number of complete rows of a journal."""
    return path.read_bytes().count(b"\n") - 1


def exhaustive(name: str) -> ExhaustiveRow:
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
    return ExhaustiveRow(
        name, len(cell.picks), len(grid), len(times), int(np.isfinite(times).sum()), cpu, float(np.nanmin(times)),
        float(np.nanmedian(times)), found.best.cycle_time if found.ok else np.nan, search_cpu, load,
    )  # fmt: skip


def markdown(table: CellTable) -> str:
    """The page."""
    note = "Times are in seconds. The load of a row is the load average of the machine when it was started."
    lines = ["# Cell benchmark", "", *wrapped(provenance_text(table), note), "", "## Base placement", ""]
    lines += section(
        "Searches over x, y, z and yaw of the base. Screened: placements at which all picks are screened. Seconds: of "
        "the complete search, including the start of the workers, on a machine with the load stated "
        "above; CPU: the processor time of all processes. Good: picks that are certified at the best placement. Best: "
        "the certified cycle time there, and how far it is below the median. For the median, placements of the grid at "
        f"which the base and all grasps are free are judged, {QUANTILES} at equal steps of the rank of their estimated "
        "cycle time, and those at which all picks are good count; feasible states how many.",
        {
            "cell": lambda row: row.cell,
            "picks": lambda row: row.picks,
            "screened": lambda row: f"{row.screened:,}",
            "workers": lambda row: row.workers,
            "seconds": lambda row: f"{row.seconds:.0f}",
            "CPU": lambda row: f"{row.cpu_seconds:.0f}",
            "good": lambda row: row.good,
            "best": lambda row: _number(row.best),
            "median": lambda row: _number(row.median),
            "below": lambda row: "" if None in (row.best, row.median) else f"{1 - row.best / row.median:.0%}",
            "feasible": lambda row: f"{row.feasible} of {row.tried}" if row.tried else "",
            "load": lambda row: _number(row.load),
        },
        table.placements,
    )
    lines += section(
        "Exhaustive grids: every placement of the grid at which the base and all grasps are free is judged with all "
        "picks, or up to the first pick that fails. The median is that of all placements at which all picks are good. "
        "The search is that of the table above, on the same region and without knowledge of this grid.",
        {
            "cell": lambda row: row.cell,
            "picks": lambda row: row.picks,
            "grid": lambda row: f"{row.grid:,}",
            "judged": lambda row: row.judged,
            "all good": lambda row: row.feasible,
            "CPU": lambda row: f"{row.cpu_seconds:.0f}",
            "grid best": lambda row: _number(row.grid_best),
            "grid median": lambda row: _number(row.grid_median),
            "search best": lambda row: _number(row.search_best),
            "below median": lambda row: f"{1 - row.search_best / row.grid_median:.0%}",
            "difference": lambda row: f"{row.search_best / row.grid_best - 1:+.1%}",
            "CPU of search": lambda row: f"{row.search_cpu_seconds:.0f}",
            "load": lambda row: _number(row.load),
        },
        table.exhaustive,
    )
    lines += section(
        "Large grids: every placement of the grid is screened with all picks and stored in a folder, and the best is "
        "certified. Memory: the largest resident memory of the main process and of a worker. The search is then run "
        "again, its process is killed with SIGKILL after the stated number of placements, and the search is resumed: "
        "the last column states whether the result and the heat map are equal to those of the first run.",
        {
            "cell": lambda row: row.cell,
            "picks": lambda row: row.picks,
            "placements": lambda row: f"{row.placements:,}",
            "workers": lambda row: row.workers,
            "seconds": lambda row: f"{row.seconds:.0f}",
            "CPU": lambda row: f"{row.cpu_seconds:.0f}",
            "MB": lambda row: f"{row.memory:.0f}",
            "MB of a worker": lambda row: f"{row.worker_memory:.0f}",
            "MB stored": lambda row: f"{row.storage:.1f}",
            "killed after": lambda row: f"{row.killed_after:,}",
            "equal": lambda row: "yes" if row.equal else "NO",
            "load": lambda row: _number(row.load),
        },
        table.scale,
    )
    return "\n".join(lines).rstrip() + "\n"


def section(text: str, columns: Mapping[str, Callable[[Any], object]], rows: Sequence[Any]) -> list[str]:
    """The text and the table of some rows; nothing without rows."""
    if not rows:
        return []
    cells = [[str(cell(row)) for cell in columns.values()] for row in rows]
    return [*wrapped(text), "", *markdown_table(tuple(columns), cells, text_columns=1), ""]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("cells", nargs="*", metavar="CELL", help=f"any of: {', '.join((*CELLS, *SMALL))}")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--scale", type=int, metavar="N", help="only screen N placements, kill the process and resume")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--docs", action="store_true", help="replace the rows in docs/benchmarks/cell.json and cell.md")
    parser.add_argument("--render", action="store_true", help="rewrite the page from cell.json")
    stated = parser.parse_args(arguments)
    if stated.render:
        table = CellTable.load(FOLDER / "cell.json")
        table.write(FOLDER, "cell", markdown(table))
        return
    if unknown := [name for name in stated.cells if name not in (*CELLS, *SMALL)]:
        parser.error(f"unknown cell {unknown[0]!r}; valid: {', '.join((*CELLS, *SMALL))}")
    chosen = stated.cells or [*CELLS]
    if stated.folder is not None:
        screen_into(chosen[0], stated.scale, stated.workers, stated.folder)
        return
    table = CellTable({"workers": stated.workers}, provenance(0))
    for name in chosen:
        if stated.scale:
            table = replace(table, scale=(*table.scale, scale(name, stated.scale, stated.workers)))
        elif name in SMALL:
            table = replace(table, exhaustive=(*table.exhaustive, exhaustive(name)))
        else:
            row = measure(name, CELLS[name](), stated.workers)
            table = replace(table, placements=(*table.placements, row))
        sys.stderr.write(f"{name}: done\n")
    sys.stdout.write(markdown(table))
    if stated.docs:
        table = merged(CellTable.load(FOLDER / "cell.json"), table)
        table.write(FOLDER, "cell", markdown(table))


def merged(stored: CellTable, new: CellTable) -> CellTable:
    """The stored table with the new rows in the place of those of the same cells; other cells are left out."""
    kinds = {}
    for kind in CellTable.row_types:
        rows = {row.cell: row for table in (stored, new) for row in getattr(table, kind)}
        kinds[kind] = tuple(rows[name] for name in (*CELLS, *SMALL) if name in rows)
    return replace(new, **kinds)
