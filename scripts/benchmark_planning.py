#!/usr/bin/env python3
"""The table of planning.

python scripts/benchmark_planning.py                         our own scenes; prints the table, as `pinproof bench plan`
python scripts/benchmark_planning.py --mbm FOLDER            the problems of MotionBenchMaker too
python scripts/benchmark_planning.py --mbm FOLDER --docs     runs both; rewrites docs/benchmarks/planning.*
python scripts/benchmark_planning.py --render                rewrites the page and the plot from planning.json alone

Exit code 1 if the audit finds a motion of ours that touches anything.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pinproof.benchmarks import PlanTable, plan_benchmark, plan_markdown, write_plan_table

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "benchmarks"


def tell(text: str) -> None:
    """What is being run, to stderr."""
    print(text, file=sys.stderr)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="for our own scenes")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="problems of MotionBenchMaker")
    parser.add_argument("--robot", help="the robot of those")
    parser.add_argument("--set", action="append", default=[], metavar="NAME", help="only these: shelf, ur5, mbm, ...")
    parser.add_argument("--problems", type=int, metavar="N", help="the first so many of each set")
    parser.add_argument("--repeats", type=int, default=1, help="how often each is asked; the quickest counts")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--render", action="store_true")
    told = parser.parse_args()
    if told.render:
        table = PlanTable.load(FOLDER / "planning.json")
    else:
        table = plan_benchmark(
            **({"robots": told.robots} if told.robots else {}),
            mbm=told.mbm,
            robot=told.robot,
            sets=told.set,
            problems=told.problems,
            repeats=told.repeats,
            seed=told.seed,
            peers=not told.no_peers,
            on_progress=tell,
        )
    if told.docs or told.render:
        FOLDER.mkdir(parents=True, exist_ok=True)
        write_plan_table(table, FOLDER)
    else:
        print(plan_markdown(table))
    for row in table.unsafe:
        tell(f"UNSAFE: {row.name}: {'; '.join(row.faults)}")
    sys.exit(1 if table.unsafe else 0)


if __name__ == "__main__":
    main()
