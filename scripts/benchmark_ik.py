#!/usr/bin/env python3
"""Benchmark of inverse kinematics.

python scripts/benchmark_ik.py ur5 panda --points 10000    prints the table, as `pinproof bench ik` does
python scripts/benchmark_ik.py --success 100000            prints success rates and batch times on every arm
python scripts/benchmark_ik.py --docs                      runs both and rewrites docs/benchmarks/ik.*
python scripts/benchmark_ik.py --render                    rewrites the page and the plots from docs/benchmarks/ik.json
"""

from __future__ import annotations

from dataclasses import fields

from benchmark_page import FOLDER, page_parser, report
from ik_steps import step_sizes, write_step_plot
from ik_success import DocsIkTable, success_markdown, success_rates

from pinproof import load_robot
from pinproof.benchmarks import ik_benchmark, ik_markdown, write_ik_table

DOCS_ROBOTS = ("ur5", "panda", "puma560", "xarm6", "crx10ia")


def main() -> None:
    """Run the command line."""
    parser = page_parser(__doc__, "ik")
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--success", type=int, metavar="SAMPLES", help="success rates only; targets per arm")
    parser.add_argument("--no-peers", action="store_true", help="leave out other libraries")
    parser.add_argument("--own-limits", action="store_true", help="keep ranges wider than one full rotation")
    options = parser.parse_args()
    common = {"limits_pi": not options.own_limits, "seed": options.seed, "on_progress": report}
    if options.success:
        print(success_markdown(success_rates(options.robots or None, samples=options.success, **common)))
        return
    if options.render:
        table = DocsIkTable.load(FOLDER / "ik.json")
    else:
        robots = options.robots or (DOCS_ROBOTS if options.docs else ("ur5",))
        measured = ik_benchmark(robots, points=options.points, peers=not options.no_peers, **common)
        values = {field.name: getattr(measured, field.name) for field in fields(measured)}
        table = DocsIkTable(**values, success=success_rates(**common) if options.docs else ())
    if options.docs or options.render:
        write_ik_table(table, FOLDER, appendix=success_markdown(table.success))
        steps = step_sizes(load_robot(DOCS_ROBOTS[0]).arm())
        if steps is not None:
            write_step_plot(steps, DOCS_ROBOTS[0], FOLDER / "ik_steps.png")
    else:
        print(ik_markdown(table))


if __name__ == "__main__":
    main()
