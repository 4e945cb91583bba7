#!/usr/bin/env python3
"""Benchmark of planning.

python scripts/benchmark_planning.py                         our scenes; prints the table, as `pinproof bench plan` does
python scripts/benchmark_planning.py --mbm FOLDER            also MotionBenchMaker problems
python scripts/benchmark_planning.py --mbm FOLDER --mplib PYTHON --docs   both, with MPlib in the environment of that
                                                             Python, and rewrites docs/benchmarks/planning.*
python scripts/benchmark_planning.py --mbm FOLDER --motion --docs   durations of motions to the goal poses
python scripts/benchmark_planning.py --render                rewrites the page and the plot from planning.json

Our scenes take a minute with the other planners that are installed, MotionBenchMaker's problems some minutes. Exit
code 1 if the independent check finds a fault in one of our motions.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmark_page import FOLDER, page_parser, report, run
from mplib_peer import mplib_method

from pinproof.benchmarks import (
    MotionTable,
    PlanTable,
    motion_benchmark,
    motion_markdown,
    plan_benchmark,
    plan_markdown,
    write_plan_table,
)
from pinproof.benchmarks.plan_peers import PEERS
from pinproof.benchmarks.plan_problems import OWN_ROBOTS

STORED, MOTIONS = FOLDER / "planning.json", FOLDER / "motion.json"


def measure(options: argparse.Namespace) -> PlanTable | MotionTable:
    """Return the table of the planners, or that of the durations of motions."""
    common = {"robot": options.robot, "sets": options.set, "problems": options.problems, "seed": options.seed}
    if not options.motion:
        peers = () if options.no_peers else (*PEERS, *map(mplib_method, options.mplib))
        more = {"repeats": options.repeats, "peers": peers}
        return plan_benchmark(options.robots or OWN_ROBOTS, mbm=options.mbm, **more, **common, on_progress=report)
    if options.mbm is None:
        raise SystemExit("--motion needs --mbm")
    return motion_benchmark(options.mbm, **common, on_progress=report)


def page(table: PlanTable | MotionTable) -> str:
    """Return the part of the page that was measured."""
    return motion_markdown(table) if isinstance(table, MotionTable) else plan_markdown(table)


def write(table: PlanTable | MotionTable, folder: Path) -> None:
    """Write the measured table, and the page of both."""
    if isinstance(table, MotionTable):
        table.save(MOTIONS)
        table = PlanTable.load(STORED)
    motions = motion_markdown(MotionTable.load(MOTIONS)) if MOTIONS.exists() else ""
    write_plan_table(table, folder, sections=motions)


if __name__ == "__main__":
    parser = page_parser(__doc__, "planning")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="arms in our scenes")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems")
    parser.add_argument("--robot", help="the robot of these problems")
    parser.add_argument("--set", action="append", default=[], metavar="NAME", help="only these: shelf, ur5, mbm, ...")
    parser.add_argument("--problems", type=int, metavar="N", help="largest number of problems per set")
    parser.add_argument("--repeats", type=int, default=1, help="runs per problem; the fastest counts")
    parser.add_argument("--no-peers", action="store_true", help="leave out other planners")
    parser.add_argument(
        "--mplib", action="append", default=[], metavar="PYTHON", help="a Python with MPlib, to include it"
    )
    parser.add_argument("--motion", action="store_true", help="durations of motions to the goal poses of --mbm")
    run(parser, "planning", PlanTable, measure, page, write)
