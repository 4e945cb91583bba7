#!/usr/bin/env python3
"""Benchmark of picks: judging through all stages, screening of poses, campaigns.

python scripts/benchmark_picks.py                        all cells; prints the table; some minutes
python scripts/benchmark_picks.py ur5 --campaign 0       one cell, without campaigns
python scripts/benchmark_picks.py --docs                 rewrites docs/benchmarks/picks.*
python scripts/benchmark_picks.py --durations [--docs]   durations of the picks of the package only, which do not
                                                         depend on the machine
python scripts/benchmark_picks.py --render               rewrites the page from picks.json
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmark_page import FOLDER, page_parser, run
from picks_measurements import (
    CELLS,
    RUNS,
    SHIPPED,
    STEADY_FROM,
    STEADY_TO,
    CampaignRow,
    DurationRow,
    PicksTable,
    ScreenRow,
    VerdictRow,
    duration_row,
    picks_benchmark,
)

from pinproof.benchmarks.tables import provenance_text, row_table, wrapped


def write_picks_table(table: PicksTable, folder: str | Path) -> list[Path]:
    """Write ``picks.json`` and ``picks.md``; return both paths."""
    return table.write(folder, "picks", "# Picks benchmark\n\n" + picks_markdown(table))


def picks_markdown(table: PicksTable) -> str:
    """Return the table as Markdown, without a title."""
    lines = [*wrapped(provenance_text(table), "Figures are for one core unless stated otherwise."), ""]
    if table.verdicts:
        lines += ["## Judging through all stages", "", *_verdicts(table.verdicts), ""]
    if table.durations:
        lines += ["## Durations", "", *_durations(table.durations), ""]
    if table.screening:
        lines += ["## Screening", "", *_screening(table.screening), ""]
    if table.campaigns or table.overhead:
        lines += ["## Campaigns", "", *_campaigns(table.campaigns, table.overhead), ""]
    return "\n".join(lines).rstrip() + "\n"


def _verdicts(rows: Sequence[VerdictRow]) -> list[str]:
    text = (
        "Random picks in the cells of the package: the tool approaches from above, tilted by up to 30 degrees, at "
        "positions in front of the arm from near its base to slightly out of reach. In the cell with carried objects, "
        "bolts on the table are picked, carried and placed elsewhere, which takes six certified motions each. Times "
        "are in ms from the pick to its verdict, with all IK branches, linear motions, transits, time parametrisation, "
        "certificates and, for failed picks, suggestions."
    )
    columns = {
        "cell": "{.cell}",
        "verdict": "{.verdict}",
        "picks": "{.picks}",
        "median": "{.median_ms:.1f}",
        "p95": "{.p95_ms:.1f}",
        "maximum": "{.largest_ms:.1f}",
        "mean": "{.mean_ms:.1f}",
    }
    return [*wrapped(text), "", *row_table(columns, rows, text_columns=2)]


def _durations(rows: Sequence[DurationRow]) -> list[str]:
    text = (
        "Mean durations of whole picks of the files in `robots/`, from home to the end of the last retreat: along the "
        "planned paths with a stop after every stage (`optimise: 0`), and with the default settings. Of the pallet, "
        "every 20th pick. The motions are audited on exact meshes at steps of 0.002 rad."
    )
    columns = {
        "cell": "{.cell}",
        "good picks": "{.good}",
        "with stops, s": "{.stopping_s:.3f}",
        "default, s": "{.mean_s:.3f}",
        "shorter by": lambda row: f"{100 * (1 - row.mean_s / row.stopping_s):.0f} %",
        "motions in contact": "{0.unsafe} of {0.motions}",
    }
    return [*wrapped(text), "", *row_table(columns, rows)]


def _screening(rows: Sequence[ScreenRow]) -> list[str]:
    text = (
        "Poses per second. Screening decides for each pose whether it is reachable inside the limits and free of "
        "collisions at the grasp, and states the reason if not. The poses are those of picks as above, and those of "
        "random configurations in any orientation, which take the most time because all of them are reachable. The "
        f"fastest of {RUNS[0]} runs counts. Reach only: without collision checks; with clearance: also measures the "
        "clearance of free poses; as picks: with Pick objects instead of an array of poses."
    )
    columns = {
        "cell": "{.cell}",
        "poses": "{0.count:,}, {0.poses}",
        "free": lambda row: f"{100 * row.free:.0f} %",
        "poses/s": "{.rate:,.0f}",
        "reach only": "{.reach_only:,.0f}",
        "with clearance": "{.with_clearance:,.0f}",
        "as picks": lambda row: "-" if row.as_picks is None else f"{row.as_picks:,.0f}",
        "2 threads": "{.two_threads:,.0f}",
    }
    return [*wrapped(text), "", *row_table(columns, rows, text_columns=2)]


def _campaigns(rows: Sequence[CampaignRow], overhead: Sequence[CampaignRow]) -> list[str]:
    lines: list[str] = []
    if rows:
        text = (
            "Picks as above, judged in worker processes, with results written to disk. The total time is from the call "
            "to the sorted file, including the start of the processes; the steady rate is measured from "
            f"{100 * STEADY_FROM:.0f} to {100 * STEADY_TO:.0f} % of the picks. Speed-ups are relative to one process."
        )
        columns = {
            "cell": "{.cell}",
            "workers": "{.workers}",
            "picks": "{.picks:,}",
            "total, s": "{.wall_s:.1f}",
            "picks/s": "{.rate:.1f}",
            "speed-up": lambda row: f"{row.rate / rows[0].rate:.2f}",
            "steady picks/s": "{.steady_rate:.1f}",
            "steady speed-up": lambda row: f"{row.steady_rate / rows[0].steady_rate:.2f}",
        }
        lines += [*wrapped(text), "", *row_table(columns, rows, text_columns=2), ""]
    for row in overhead:
        text = (
            f"Without judging, {row.picks:,} picks take {row.wall_s:.1f} s in one process; the steady overhead of a "
            f"campaign is {1e6 / row.steady_rate:.0f} us per pick, for generating the picks and writing the results."
        )
        lines += [*wrapped(text), ""]
    return lines[:-1]


def measure(options: argparse.Namespace) -> PicksTable:
    """Return the parts of the table that the options select."""
    if options.durations:
        return replace(PicksTable.load(FOLDER / "picks.json"), durations=tuple(map(duration_row, options.files)))
    counts = {name: getattr(options, name) for name in ("picks", "poses", "campaign", "overhead")}
    return picks_benchmark(options.cells or CELLS, **counts, durations=options.files, seed=options.seed)


if __name__ == "__main__":
    parser = page_parser(__doc__, "picks")
    parser.add_argument("cells", nargs="*", metavar="CELL", help="ur5, panda, generic_6dof, 'ur5, carried'")
    parser.add_argument("--picks", type=int, default=200, metavar="N", help="picks to judge in each cell")
    parser.add_argument("--poses", type=int, default=20_000, metavar="N", help="poses to screen in each cell")
    parser.add_argument("--campaign", type=int, default=1_500, metavar="N", help="picks of the campaigns")
    parser.add_argument("--overhead", type=int, default=20_000, metavar="N", help="picks of a campaign without judging")
    parser.add_argument(
        "--files", nargs="*", default=list(SHIPPED), metavar="FILE", help="files of which durations are measured"
    )
    parser.add_argument("--durations", action="store_true", help="measure durations only, into the table of the docs")
    run(parser, "picks", PicksTable, measure, picks_markdown, write_picks_table)
