"""Benchmark of sequences of picks.

./scripts/benchmark sequence                      all cells; prints the table
./scripts/benchmark sequence "ur5, 8 points"      one cell
./scripts/benchmark sequence --docs               rewrites docs/benchmarks/sequence.*
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

import pinproof as pp
from benchmarks.picks import unsafe_motions
from benchmarks.tables import Benchmark, Blocks, Results, Row, page_parser, provenance, report, row_table
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.cell.sequencing.sequence import SequenceRun
from pinproof.cell.sequencing.windings import within_windings
from pinproof.description import robots_folder
from pinproof.picks import PickSetup
from pinproof.spatial import SE3
from pinproof.work import Runner

BUDGET = pp.cell.SequenceBudget(bound=20)
"""The default budget, with more rounds of the lower bound."""

WORKERS = 2
"""Number of processes with which the first cell is solved again, for the elapsed time."""

AUDIT_STEP = 0.04
"""Rad: no joint moves farther between two samples of the audit."""

CANDIDATES = 6
"""Random poses that are screened for each pick of a bin."""


@dataclass(frozen=True)
class Region:
    """Where random picks are, in the root frame: a box, or a ring around the base if ``ring``; m."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    line: float
    ring: bool = False

    def draw(self, rng: np.random.Generator) -> SE3:
        """A random pose whose z axis points down."""
        x, y, z = rng.uniform(self.low, self.high)
        at = (x * np.cos(y), x * np.sin(y), z) if self.ring else (x, y, z)
        return pp.pose(at, (np.pi, 0.0, rng.uniform(-np.pi, np.pi)))


BOLTS = Region((0.33, -0.03, 0.035), (0.67, 0.23, 0.1), 0.1)
"""In the bin of the UR5, between its walls; from the heads of upright bolts on its floor to 20 mm below its rim."""

BIN = Region((0.45, -0.17, 0.045), (0.69, 0.17, 0.1), 0.12)
"""In the bin of the Panda, between its walls."""

POINTS = {
    "ur5": Region((0.3, -np.pi / 2, 0.15), (0.75, np.pi / 2, 0.45), 0.03, ring=True),
    "panda": Region((0.35, -np.pi / 2, 0.15), (0.65, np.pi / 2, 0.45), 0.03, ring=True),
}
"""Above the tables: distance from the base (m), angle (rad), and height (m)."""

CELLS: dict[str, tuple[str, Region | None, int, int]] = {
    "palletising, 200 boxes": ("ur10/pallet_picks.yaml", None, 0, 0),
    "ur5 bin, 200 bolts": ("ur5/picks.yaml", BOLTS, 200, 1),
    "ur5 bin, 200 other bolts": ("ur5/picks.yaml", BOLTS, 200, 2),
    "ur5, 200 points": ("ur5/picks.yaml", POINTS["ur5"], 200, 1),
    "panda bin, 200 parts": ("panda/bin_picks.yaml", BIN, 200, 1),
    "panda bin, 200 other parts": ("panda/bin_picks.yaml", BIN, 200, 2),
    "panda, 200 points": ("panda/picks.yaml", POINTS["panda"], 200, 2),
    "ur5, 8 points": ("ur5/picks.yaml", POINTS["ur5"], 8, 3),
    "ur5, 8 other points": ("ur5/picks.yaml", POINTS["ur5"], 8, 4),
    "panda, 8 points": ("panda/picks.yaml", POINTS["panda"], 8, 5),
    "palletising, 8 boxes": ("ur10/pallet_picks.yaml", None, 8, 0),
}
"""Each cell with its picks file, the region of random picks (None: those of the file), their number, and a seed."""


def setup_of(file: str, region: Region | None, count: int, seed: int) -> tuple[PickSetup, list[pp.Pick]]:
    """The cell of a picks file with the first of its picks, or with random picks whose grasps are free."""
    picks = pp.read_picks(robots_folder() / file)
    arm, scene = picks.load_arm(), pp.Scene.load(picks.scene or Path())
    setup = PickSetup.make(arm, scene, picks, home=None, rng=0)
    if region is None:
        return setup, list(picks.picks[: count or None])
    rng = np.random.default_rng(seed)
    drawn = [region.draw(rng) for _ in range(CANDIDATES * count)]
    tried = [pp.Pick(f"p{k}", pose, approach=region.line, retreat=region.line) for k, pose in enumerate(drawn)]
    away = [replace(pick, pose=pick.pose * pp.pose((0.0, 0.0, -region.line))) for pick in tried]  # end of the lines
    ends = [pp.screen_picks(arm, scene, replace(picks, picks=tuple(each)), home=setup.home) for each in (tried, away)]
    free = ends[0].free & ends[1].free
    return setup, [pick for pick, ok in zip(tried, free, strict=True) if ok][:count]


def sequence_row(cell: str) -> Row:
    """The sequence of one of :data:`CELLS`, the certified motions of other orders, and the audit; times in s."""
    setup, picks = setup_of(*CELLS[cell])
    warm, few = setup_of("ur5/picks.yaml", POINTS["ur5"], 2, 1)
    pp.sequence(warm, few)  # loads libraries
    start = process_time()
    result = pp.sequence(setup, picks, budget=BUDGET)
    seconds = process_time() - start
    elapsed = None
    if cell == next(iter(CELLS)):
        begin = perf_counter()
        shared = pp.sequence(setup, picks, budget=BUDGET, workers=WORKERS)
        elapsed = perf_counter() - begin
        if shared.order != result.order or shared.moving != result.moving:
            raise RuntimeError(f"{cell}: the sequence depends on the number of workers")
    unsafe = unsafe_motions(setup, result.motions, AUDIT_STEP)
    in_order = [pick for pick in picks if pick.name in result.order]
    return Row(
        cell=cell,
        picks=len(result.steps),
        left_out=len(result.left_out),
        cpu_s=seconds,
        motions_s=result.moving,
        bound_s=result.lower_bound,
        **other_orders(setup, in_order),
        motions=len(result.motions),
        proven_mm=1e3 * result.clearance,
        audited=len(result.motions),
        unsafe=unsafe,
        elapsed_s=elapsed,
    )


def other_orders(setup: PickSetup, picks: list[pp.Pick]) -> dict[str, float]:
    """Seconds of the certified motions in file order, in nearest-neighbour order, and of the greedy tour."""
    setup = replace(setup, budget=replace(setup.budget, motion=BUDGET.motion))
    stated = Precedence.stated((pick.name for pick in picks), ())
    ends = setup.home, setup.home
    run = SequenceRun(within_windings(setup, None), setup, tuple(picks), stated, ends, (0.0, 0.0), BUDGET, Runner())
    run.prepare()
    problem = run.problem()
    in_file = problem.best_options(problem.in_order(tuple(range(problem.count))))
    tours = {"file_order_s": in_file, "nearest_s": problem.nearest_neighbour(), "greedy_s": problem.greedy()}
    return {name: run.certified_seconds(tour) for name, tour in tours.items()}


def blocks(results: Results) -> Blocks:
    """The tables of the page."""
    quality = {
        "cell": "{.cell}",
        "picks": "{.picks}",
        "left out": lambda row: str(row.left_out or ""),
        "CPU (s)": "{.cpu_s:.1f}",
        "elapsed, 2 workers (s)": "{.elapsed_s:.1f}",
        "motions (s)": "{.motions_s:.1f}",
        "bound (s)": "{.bound_s:.1f}",
        "gap": lambda row: f"{100 * (row.motions_s / row.bound_s - 1):.2f} %",
        "proven (mm)": "{.proven_mm:.1f}",
        "unsafe in the audit": "{0.unsafe} of {0.audited}",
    }
    # The share by which a sequence is shorter than another, and the largest share that the bound permits.
    others = {"cell": "{.cell}"} | {
        title: lambda row, ours=ours, other=other: f"{100 * (1 - getattr(row, ours) / getattr(row, other)):.1f} %"
        for name, other in (("file order", "file_order_s"), ("nearest", "nearest_s"), ("greedy", "greedy_s"))
        for title, ours in ((f"below {name}", "motions_s"), (f"{name}: at most", "bound_s"))
    }
    return {name: row_table(columns, results["rows"]) for name, columns in (("quality", quality), ("others", others))}


def measure(options: argparse.Namespace) -> Results:
    """Measure the cells that the options select."""
    names = options.cells or list(CELLS)
    results = Results({"cells": names}, provenance(0), {"rows": []})
    for name in names:
        results["rows"].append(sequence_row(name))
        report(f"{name}: done")
    return results


BENCHMARK = Benchmark("sequence", measure, blocks, keys=("cell",))


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "sequence")
    parser.add_argument("cells", nargs="*", choices=[*CELLS, []], help="the cells to measure; default: all")
    BENCHMARK.run(parser)
