#!/usr/bin/env python3
"""Benchmark of sequences of picks.

python scripts/benchmark_sequence.py                      all cells; prints the table
python scripts/benchmark_sequence.py "ur5, 8 points"      one cell
python scripts/benchmark_sequence.py --docs               rewrites docs/benchmarks/sequence.*
python scripts/benchmark_sequence.py --render             rewrites the page from sequence.json
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sequence_measurements import AUDIT_STEP, CELLS, SequenceRow, SequenceTable, sequence_benchmark

from pinproof.benchmarks.tables import markdown_table, provenance_text, wrapped

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "benchmarks"
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


def main() -> int:
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


if __name__ == "__main__":
    sys.exit(main())
