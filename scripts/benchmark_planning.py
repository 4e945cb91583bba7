#!/usr/bin/env python3
"""Benchmark of planning.

python scripts/benchmark_planning.py                         our scenes; prints the table, as `pinproof bench plan` does
python scripts/benchmark_planning.py --mbm FOLDER            also MotionBenchMaker problems
python scripts/benchmark_planning.py --mbm FOLDER --docs     runs both and rewrites docs/benchmarks/planning.*
python scripts/benchmark_planning.py --mbm FOLDER --motion --docs   durations of motions to the goal poses
python scripts/benchmark_planning.py --render                rewrites the page and the plot from planning.json

Exit code 1 if the independent check finds a fault in one of our motions.
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchmark_page import FOLDER, page_parser, report

from pinproof.benchmarks import (
    MotionTable,
    PlanTable,
    motion_benchmark,
    motion_markdown,
    plan_benchmark,
    plan_markdown,
    write_plan_table,
)


def main() -> None:
    """Run the command line."""
    parser = page_parser(__doc__, "planning")
    parser.add_argument("robots", nargs="*", metavar="ROBOT", help="arms in our scenes")
    parser.add_argument("--mbm", type=Path, metavar="FOLDER", help="MotionBenchMaker problems")
    parser.add_argument("--robot", help="the robot of these problems")
    parser.add_argument("--set", action="append", default=[], metavar="NAME", help="only these: shelf, ur5, mbm, ...")
    parser.add_argument("--problems", type=int, metavar="N", help="largest number of problems per set")
    parser.add_argument("--repeats", type=int, default=1, help="runs per problem; the fastest counts")
    parser.add_argument("--no-peers", action="store_true", help="leave out other planners")
    parser.add_argument("--motion", action="store_true", help="durations of motions to the goal poses of --mbm")
    options = parser.parse_args()
    common = {"sets": options.set, "problems": options.problems, "seed": options.seed, "on_progress": report}
    if options.motion:
        if options.mbm is None:
            parser.error("--motion needs --mbm")
        table = motion_benchmark(options.mbm, robot=options.robot, **common)
        if options.docs:
            table.save(FOLDER / "motion.json")
            write_plan_table(PlanTable.load(FOLDER / "planning.json"), FOLDER, sections=_motion_section())
        else:
            print(motion_markdown(table))
    else:
        robots = {"robots": options.robots} if options.robots else {}
        more = {"mbm": options.mbm, "robot": options.robot, "repeats": options.repeats, "peers": not options.no_peers}
        path = FOLDER / "planning.json"
        table = PlanTable.load(path) if options.render else plan_benchmark(**robots, **more, **common)
        if options.docs or options.render:
            write_plan_table(table, FOLDER, sections=_motion_section())
        else:
            print(plan_markdown(table))
    for row in table.unsafe:
        report(f"unsafe motion: {row.name}: {'; '.join(row.faults)}")
    sys.exit(1 if table.unsafe else 0)


def _motion_section() -> str:
    file = FOLDER / "motion.json"
    return motion_markdown(MotionTable.load(file)) if file.exists() else ""


if __name__ == "__main__":
    main()
