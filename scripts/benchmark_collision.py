#!/usr/bin/env python3
"""The table of collision checks and proofs.

python scripts/benchmark_collision.py                        checks and proofs in our own scenes; prints the table
python scripts/benchmark_collision.py --mbm FOLDER           those of MotionBenchMaker too
python scripts/benchmark_collision.py --edges 10000          and random edges, each verdict looked at by other means
python scripts/benchmark_collision.py --only-edges 10000     these alone
python scripts/benchmark_collision.py --mbm FOLDER --edges 10000 --docs    rewrites docs/benchmarks/collision.*
python scripts/benchmark_collision.py --render               rewrites the page and the plot from collision.json alone

Exit code 1 if a verdict on an edge is wrong.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pinproof.benchmarks import CollisionTable, collision_benchmark, collision_markdown, write_collision_table

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
    parser.add_argument("--problems", type=int, metavar="N", help="the first so many of each set")
    parser.add_argument("--edges", type=int, default=0, metavar="N", help="random edges to prove and to look at again")
    parser.add_argument("--only-edges", type=int, metavar="N", help="nothing but these")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--render", action="store_true")
    told = parser.parse_args()
    how = {"seed": told.seed, "on_progress": tell}
    if told.render:
        table = CollisionTable.load(FOLDER / "collision.json")
    elif told.only_edges:
        table = collision_benchmark((), boxes=(), edges=told.only_edges, **how)
    else:
        robots = {"robots": told.robots} if told.robots else {}
        table = collision_benchmark(**robots, mbm=told.mbm, problems=told.problems, edges=told.edges, **how)
    if told.docs or told.render:
        FOLDER.mkdir(parents=True, exist_ok=True)
        write_collision_table(table, FOLDER)
    else:
        print(collision_markdown(table))
    for said in table.wrong:
        tell(f"WRONG: {said}")
    sys.exit(1 if table.wrong else 0)


if __name__ == "__main__":
    main()
