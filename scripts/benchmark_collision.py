#!/usr/bin/env python3
"""Benchmark of collision checks and certificates.

python scripts/benchmark_collision.py                        checks and certificates in our scenes; prints the table
python scripts/benchmark_collision.py --mbm FOLDER           also on MotionBenchMaker problems
python scripts/benchmark_collision.py --edges 10000          also certifies random edges and checks every verdict
python scripts/benchmark_collision.py --only-edges 10000     only random edges
python scripts/benchmark_collision.py --mbm FOLDER --edges 10000 --docs    rewrites docs/benchmarks/collision.*
python scripts/benchmark_collision.py --render               rewrites the page and the plot from collision.json

The checks take about two minutes, 10,000 edges some more. Exit code 1 if a verdict on an edge is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmark_page import page_parser, run
from collision_checks import BLOCK, PROOF_REPEATS, REPEATS, ROBOTS, CheckRow, CollisionTable, collision_benchmark
from collision_edges import AUDIT_STEP, SAMPLES, TOLERANCE, EdgeRow, edge_table, total_row

from pinproof.benchmarks.tables import (
    bullet_section,
    log_panel,
    new_figure,
    provenance_text,
    row_table,
    save_figure,
    wrapped,
)

CURVES = (
    ("is_free", "pinproof, is_free", "C0"),
    ("coal", "coal with Pinocchio, all pairs", "C3"),
    ("coal_tree", "coal with Pinocchio, broad phase", "C1"),
)
"""The fields, labels and colours of the curves in the plot."""


def write_collision_table(table: CollisionTable, folder: str | Path) -> list[Path]:
    """Write ``collision.json``, ``collision.md`` and, if checks among boxes were measured, ``collision.png``."""
    written = table.write(folder, "collision", "# Collision check benchmark\n\n" + collision_markdown(table))
    if table.growth:
        written.append(save_figure(_growth_plot(table), Path(folder) / "collision.png"))
    return written


def collision_markdown(table: CollisionTable) -> str:
    """Return the table as Markdown, without a title."""
    text = (
        f"Links are convex hulls. Calls are timed in blocks of {BLOCK}, each {REPEATS} times (a certificate "
        f"{PROOF_REPEATS} times), and the fastest run counts, which reduces the influence of other processes. Single "
        "calls are from Python including all overhead."
    )
    lines = [*wrapped(text), "", *wrapped(provenance_text(table)), ""]
    if table.checks:
        lines += ["## Checks", "", *_checks(table.checks), ""]
    if table.growth:
        lines += ["## Number of obstacles", "", *_growth(table.growth), ""]
    if table.proofs:
        lines += ["## Certificates of planned paths", "", *_proofs(table), ""]
    if table.edges:
        lines += ["## Certificates of random edges", "", *_edges(table.edges), ""]
    lines += bullet_section("Wrong verdicts", table.wrong)
    return "\n".join(lines).rstrip() + "\n"


def _checks(rows: Sequence[CheckRow]) -> list[str]:
    text = (
        "Mean times in us at random configurations within the limits: free ones / ones in collision. For comparison, "
        "Pinocchio's computeCollisions with coal, which stops at the first contact, was measured in the same run with "
        "the same bodies and pairs: with all pairs, and with a broad phase (a dynamic AABB tree). The speed-up is the "
        "time of the faster of these two divided by that of is_free."
    )
    columns = {
        "robot": "{.robot}",
        "scene": "{.scene}",
        "pairs": "{.pairs:,}",
        "free": _free,
        "is_free": "{.is_free}",
        "check": "{.check}",
        "clearance": "{.clearance}",
        "batch, 1 thread": "{.batch_us:.2f}",
        "2 threads": "{.batch_threads_us:.2f}",
        "coal, all pairs": "{.coal}",
        "coal, broad phase": "{.coal_tree}",
        "speed-up": _speed_up,
    }
    agreement = (
        f"is_free and coal disagree at {sum(r.disagreements for r in rows)} of {sum(r.configurations for r in rows):,} "
        f"configurations; at {sum(r.missed_contacts for r in rows)} of these only coal finds a contact."
    )
    return [*wrapped(text), "", *row_table(columns, rows, text_columns=2), "", *wrapped(agreement)]


def _growth(rows: Sequence[CheckRow]) -> list[str]:
    text = (
        f"The {rows[0].robot} among boxes whose total volume is constant: more boxes are smaller. The time of a check "
        "grows much more slowly than their number, since a bounding volume hierarchy excludes distant boxes. Times as "
        "above; set-up is the time to build the checker of another scene."
    )
    columns = {
        "boxes": lambda row: row.scene.partition(": ")[2],
        "pairs": "{.pairs:,}",
        "free": _free,
        "is_free": "{.is_free}",
        "batch, 1 thread": "{.batch_us:.2f}",
        "coal, all pairs": "{.coal}",
        "coal, broad phase": "{.coal_tree}",
        "speed-up": _speed_up,
        "set-up, ms": "{.setup_ms:.1f}",
    }
    picture = "![Mean time of a check against the number of boxes](collision.png)"
    return [*wrapped(text), "", picture, "", *row_table(columns, rows, text_columns=0)]


def _proofs(table: CollisionTable) -> list[str]:
    text = (
        "Paths planned by RrtConnect and shortened by shortcut, certified with a margin of 0. Times in ms on one "
        "thread, without building the checker. No peer measured here proves a path; [HPP and Drake](../comparison.md) "
        "do."
    )
    columns = {
        "problems": "{.problems}",
        "paths": "{.paths}",
        "FREE": "{.free}",
        "UNDECIDED": "{.undecided}",
        "COLLIDING": "{.colliding}",
        "median waypoints": "{.waypoints:.0f}",
        "median intervals": "{.intervals:.0f}",
        "median": "{.median_ms:.2f}",
        "p95": "{.p95_ms:.2f}",
        "maximum": "{.largest_ms:.2f}",
    }
    return [*wrapped(text), "", *row_table(columns, table.proofs)]


def _edges(rows: Sequence[EdgeRow]) -> list[str]:
    text = (
        "Straight edges of different lengths in random scenes of one to eight boxes, spheres, cylinders, capsules, "
        "cones, ellipsoids and convex hulls from 2 mm to 0.3 m, with margins of 0, 3 and 20 mm; the tolerance of the "
        f"certificates is {TOLERANCE:g} m. Every FREE verdict is checked again by Pinocchio and coal only: the "
        f"distances at {SAMPLES} samples must not be below the proven clearance, and the exact meshes must not collide "
        f"at samples at most {AUDIT_STEP:g} rad or m apart. Every COLLIDING verdict must name a configuration at which "
        "coal finds a distance not larger than the margin."
    )
    total = total_row(rows)
    undecided = f"UNDECIDED: {100 * total.undecided / max(total.edges, 1):.3f} %."
    return [*wrapped(text), "", *edge_table("robot", [*rows, total]), "", undecided]


def _free(row: CheckRow) -> str:
    return f"{100 * row.free_share:.0f} %"


def _speed_up(row: CheckRow) -> str:
    """For free and colliding configurations."""
    ratios = []
    for name in ("free", "colliding"):
        ours, plain, tree = (getattr(times, name) for times in (row.is_free, row.coal, row.coal_tree))
        ratios.append("-" if ours is None else f"{min(plain, tree) / ours:.1f}")
    return " / ".join(ratios)


def _growth_plot(table: CollisionTable) -> Any:
    """The time of a check against the number of boxes."""
    figure, ((panel,),) = new_figure(1, 1, width=7.2, height=4.6)
    counts = [int(row.scene.partition(": ")[2].replace(",", "")) for row in table.growth]
    for name, label, colour in CURVES:
        times = [getattr(row, name) for row in table.growth]
        panel.plot(counts, [each.free for each in times], "o-", color=colour, label=f"{label}: free")
        colliding = [each.colliding for each in times]
        panel.plot(counts, colliding, "s--", color=colour, fillstyle="none", label="... in collision")
    first = table.growth[0].is_free.free
    if first is not None:
        panel.plot(counts, [first * count / counts[0] for count in counts], ":", color="grey", label="proportional")
        panel.set_ylim(first / 3, None)
    title = f"{table.growth[0].robot}: time of a check against the number of boxes"
    log_panel(panel, title, "boxes around the arm", "mean time of a single check, us", percent=False)
    panel.set_yscale("log")
    panel.set_xticks(counts, [f"{count:,}" for count in counts])
    panel.legend(fontsize=8, loc="upper left")
    return figure


def measure(options: argparse.Namespace) -> CollisionTable:
    """Return the parts of the table that the options select."""
    if options.only_edges:
        return collision_benchmark((), box_counts=(), edges=options.only_edges, seed=options.seed)
    given = {"mbm": options.mbm, "problems": options.problems, "edges": options.edges, "seed": options.seed}
    return collision_benchmark(options.robots or ROBOTS, **given)


if __name__ == "__main__":
    parser = page_parser(__doc__, "collision")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="arms in our scenes")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems")
    parser.add_argument("--problems", type=int, metavar="N", help="largest number of problems per set")
    parser.add_argument("--edges", type=int, default=0, metavar="N", help="number of random edges to certify and check")
    parser.add_argument("--only-edges", type=int, metavar="N", help="certify and check random edges only")
    run(parser, "collision", CollisionTable, measure, collision_markdown, write_collision_table)
