#!/usr/bin/env python3
"""The table of inverse kinematics, and the big check.

python scripts/benchmark_ik.py ur5 panda --points 10000    prints the table, as `pinproof bench ik` does
python scripts/benchmark_ik.py --success 100000            prints the big check: success and batch time on every arm
python scripts/benchmark_ik.py --docs                      runs both; rewrites docs/benchmarks/
python scripts/benchmark_ik.py --render                    rewrites the pages from docs/benchmarks/ik.json alone
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from pinproof.benchmarks import (
    IkTable,
    ik_benchmark,
    ik_markdown,
    success_markdown,
    success_rates,
    write_ik_table,
)

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "benchmarks"
DOCS_ROBOTS = ("ur5", "panda", "puma560")


def tell(text: str) -> None:
    """What is being run, to stderr."""
    print(text, file=sys.stderr)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument(
        "--success", type=int, metavar="SAMPLES", help="only the big check, with so many targets an arm"
    )
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--own-limits", action="store_true", help="do not narrow ranges of more than one turn")
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--render", action="store_true")
    told = parser.parse_args()
    how = {"limits_pi": not told.own_limits, "on_progress": tell}
    if told.success:
        print(success_markdown(success_rates(told.robots or None, samples=told.success, **how)))
        return
    if told.render:
        table = IkTable.load(FOLDER / "ik.json")
    else:
        robots = told.robots or (DOCS_ROBOTS if told.docs else ("ur5",))
        table = ik_benchmark(robots, points=told.points, peers=not told.no_peers, **how)
    if told.docs:
        table = replace(table, success=success_rates(**how))
    if told.docs or told.render:
        FOLDER.mkdir(parents=True, exist_ok=True)
        write_ik_table(table, FOLDER)
    else:
        print(ik_markdown(table))


if __name__ == "__main__":
    main()
