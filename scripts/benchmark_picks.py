#!/usr/bin/env python3
"""The table of picks: a pick through all stages, screening, campaigns.

python scripts/benchmark_picks.py                        all cells; prints the table
python scripts/benchmark_picks.py ur5 --campaign 0       one cell, without a campaign
python scripts/benchmark_picks.py --docs                 rewrites docs/benchmarks/picks.*
python scripts/benchmark_picks.py --render               rewrites the page from picks.json alone
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pinproof.benchmarks import PicksTable, picks_benchmark, picks_markdown, write_picks_table

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "benchmarks"


def tell(text: str) -> None:
    """What is being run, to stderr."""
    print(text, file=sys.stderr)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cells", nargs="*", metavar="CELL", help="ur5, panda, generic_6dof, 'ur5, carried'")
    parser.add_argument("--picks", type=int, default=200, metavar="N", help="judged one by one in each cell")
    parser.add_argument("--poses", type=int, default=20_000, metavar="N", help="screened in each cell")
    parser.add_argument("--campaign", type=int, default=1_500, metavar="N", help="picks of the campaigns")
    parser.add_argument("--machinery", type=int, default=20_000, metavar="N", help="picks of the idle campaign")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--render", action="store_true")
    told = parser.parse_args()
    if told.render:
        table = PicksTable.load(FOLDER / "picks.json")
    else:
        table = picks_benchmark(
            **({"cells": told.cells} if told.cells else {}),
            picks=told.picks,
            poses=told.poses,
            campaign=told.campaign,
            machinery=told.machinery,
            seed=told.seed,
            on_progress=tell,
        )
    if told.docs or told.render:
        FOLDER.mkdir(parents=True, exist_ok=True)
        write_picks_table(table, FOLDER)
    else:
        print(picks_markdown(table))


if __name__ == "__main__":
    main()
