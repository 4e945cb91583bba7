"""Benchmark of sequences of picks.

./scripts/benchmark sequence                      all cells; prints the table
./scripts/benchmark sequence "ur5, 8 points"      one cell
./scripts/benchmark sequence --docs               rewrites docs/benchmarks/sequence.*
./scripts/benchmark sequence --render             rewrites the page from sequence.json
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, ClassVar

import numpy as np

import pinproof as pp
from benchmarks.picks import unsafe_motions
from benchmarks.tables import BenchmarkTable, markdown_table, provenance, provenance_text, wrapped
from pinproof.cell.sequencing.precedence import Precedence
from pinproof.cell.sequencing.sequence_run import SequenceRun
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


@dataclass(frozen=True)
class SequenceRow:
    """A sequence, the certified motions of other orders, and the audit; times in s."""

    cell: str
    picks: int
    left_out: int
    cpu_s: float
    motions_s: float
    bound_s: float
    file_order_s: float
    nearest_s: float
    greedy_s: float
    motions: int
    proven_mm: float
    audited: int
    unsafe: int
    elapsed_s: float | None = None


@dataclass(frozen=True)
class SequenceTable(BenchmarkTable):
    """The sequences of all cells."""

    topic: ClassVar[str] = "sequences"
    row_types: ClassVar[Mapping[str, Callable[..., Any]]] = {"rows": SequenceRow}
    rows: tuple[SequenceRow, ...] = ()


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


def measure(cell: str) -> SequenceRow:
    """The sequence of one of :data:`CELLS`."""
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
    return SequenceRow(
        cell,
        len(result.steps),
        len(result.left_out),
        seconds,
        result.moving,
        result.lower_bound,
        *other_orders(setup, [pick for pick in picks if pick.name in result.order]),
        len(result.motions),
        1e3 * result.clearance,
        len(result.motions),
        unsafe,
        elapsed,
    )


def other_orders(setup: PickSetup, picks: list[pp.Pick]) -> tuple[float, float, float]:
    """Seconds of the certified motions in file order, in nearest-neighbour order, and of the greedy tour."""
    setup = replace(setup, budget=replace(setup.budget, motion=BUDGET.motion))
    stated = Precedence.stated((pick.name for pick in picks), ())
    run = SequenceRun(setup, tuple(picks), stated, (setup.home, setup.home), (0.0, 0.0), BUDGET, Runner())
    run.prepare()
    problem = run.problem()
    in_file = problem.best_options(problem.in_order(tuple(range(problem.count))))
    tours = in_file, problem.nearest_neighbour(), problem.greedy()
    in_file_s, nearest_s, greedy_s = (run.certified_seconds(tour) for tour in tours)
    return in_file_s, nearest_s, greedy_s


def sequence_benchmark(cells: list[str], done: Callable[[SequenceTable], object]) -> SequenceTable:
    """Measure cells one after another; ``done`` is called after each."""
    table = SequenceTable({"cells": cells}, provenance(0))
    for cell in cells:
        table = replace(table, rows=(*table.rows, measure(cell)))
        done(table)
    return table


FOLDER = Path(__file__).resolve().parents[2] / "docs" / "benchmarks"
TEXT = (
    "Each sequence starts and ends at home. The gap is the share by which the certified motions exceed the lower "
    "bound, which ignores obstacles; for eight picks the bound is the exact optimum of the bounded times. The bolts "
    "and parts are random poses in the bins of the shipped cells, whose grasps and ends of lines are free, with an "
    "approach and a retreat of 100 and 120 mm; the points are random positions above the tables, with 30 mm. Both are "
    "in random order. CPU times, of one process, include all grasps, lines, orders, motions, certificates and the "
    "lower bound."
)
AUDIT = (
    f"All motions of each sequence are audited by samples at most {AUDIT_STEP} rad apart on the exact meshes of the "
    "robot, in the scene of the moment: with the parts that were placed, and without those that were picked."
)
OTHERS = (
    "The motions of other orders are planned, shortened and certified in the same manner, and the table has the share "
    "by which the sequence is shorter. The nearest neighbour is the pick with the shortest transit from the present "
    "configuration. In the greedy sequence, the grasp and the IK branches are those of this transit; the other two "
    "have the best grasps and IK branches for their order, by dynamic programming. No order, with the grasps and IK "
    "branches that are considered, can be shorter by more than the share in the columns *at most*, which follows from "
    "the lower bound."
)


def _share(row: SequenceRow, other: float) -> list[str]:
    """The share (%) by which a sequence is shorter than another, and the largest share that the bound permits."""
    return [f"{100 * (1 - seconds / other):.1f} %" for seconds in (row.motions_s, row.bound_s)]


def sequence_markdown(table: SequenceTable) -> str:
    """The tables as Markdown, without a title."""
    quality = [
        [
            row.cell,
            str(row.picks),
            str(row.left_out or ""),
            f"{row.cpu_s:.1f}",
            "" if row.elapsed_s is None else f"{row.elapsed_s:.1f}",
            f"{row.motions_s:.1f}",
            f"{row.bound_s:.1f}",
            f"{100 * (row.motions_s / row.bound_s - 1):.2f} %",
            f"{row.proven_mm:.1f}",
            f"{row.unsafe} of {row.audited}",
        ]
        for row in table.rows
    ]
    of_quality = (
        "cell", "picks", "left out", "CPU (s)", "elapsed, 2 workers (s)", "motions (s)", "bound (s)", "gap",
        "proven (mm)", "unsafe in the audit",
    )  # fmt: skip
    others = []
    for row in table.rows:
        shares = [_share(row, other) for other in (row.file_order_s, row.nearest_s, row.greedy_s)]
        others.append([row.cell, *(cell for pair in shares for cell in pair)])
    of_others = (
        "cell", "below file order", "at most", "below nearest neighbour", "at most", "below greedy sequence", "at most",
    )  # fmt: skip
    lines = [*wrapped(provenance_text(table)), ""]
    for text in (TEXT, AUDIT):
        lines += [*wrapped(text), ""]
    lines += [*markdown_table(of_quality, quality), "", "## Other orders", "", *wrapped(OTHERS), ""]
    return "\n".join([*lines, *markdown_table(of_others, others)]) + "\n"


def run_benchmark() -> int:
    """Measure or render."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cells", nargs="*", choices=[*CELLS, []], help="the cells to measure; default: all")
    parser.add_argument("--docs", action="store_true", help="write docs/benchmarks/sequence.*")
    parser.add_argument("--render", action="store_true", help="write the page from sequence.json")
    stated = parser.parse_args()

    def write(table: SequenceTable) -> None:
        if stated.docs or stated.render:
            table.write(FOLDER, "sequence", "# Sequence benchmark\n\n" + sequence_markdown(table))

    if stated.render:
        write(SequenceTable.load(FOLDER / "sequence.json"))
        return 0
    table = sequence_benchmark(list(stated.cells) or list(CELLS), write)
    print(sequence_markdown(table))
    return int(any(row.unsafe for row in table.rows))


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    sys.exit(run_benchmark())
