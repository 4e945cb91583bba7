#!/usr/bin/env python3
"""Benchmark of inverse kinematics.

python scripts/benchmark_ik.py ur5 panda --points 10000    prints the table, as `pinproof bench ik` does; 30 s per robot
python scripts/benchmark_ik.py --success 100000            prints success rates and batch times on every arm; a minute
python scripts/benchmark_ik.py --docs                      runs both and rewrites docs/benchmarks/ik.*
python scripts/benchmark_ik.py --render                    rewrites the page and the plots from docs/benchmarks/ik.json

Other libraries that are installed take most of the time.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmark_page import page_parser, report, run
from ik_steps import step_sizes, write_step_plot
from ik_success import DocsIkTable, success_markdown, success_rates

from pinproof import load_robot
from pinproof.benchmarks import ik_benchmark, ik_markdown, write_ik_table

DOCS_ROBOTS = ("ur5", "panda", "puma560", "xarm6", "crx10ia")

SAMPLES = 100_000
"""Targets per arm of the success rates in the manual."""


def measure(options: argparse.Namespace) -> DocsIkTable:
    """Return the table of the methods, the success rates, or both for the manual."""
    common = {"limits_pi": not options.own_limits, "seed": options.seed}
    robots = () if options.success else options.robots or (DOCS_ROBOTS if options.docs else ("ur5",))
    measured = ik_benchmark(robots, points=options.points, peers=not options.no_peers, **common, on_progress=report)
    samples = options.success or (SAMPLES if options.docs else 0)
    success = success_rates(options.robots or None, samples=samples, **common) if samples else ()
    return DocsIkTable(**vars(measured), success=success)


def page(table: DocsIkTable) -> str:
    """Return the parts of the page that were measured."""
    return (ik_markdown(table) if table.robots else "") + success_markdown(table.success)


def write(table: DocsIkTable, folder: Path) -> None:
    """Write the table, its page and the plots."""
    write_ik_table(table, folder, appendix=success_markdown(table.success))
    steps = step_sizes(load_robot(DOCS_ROBOTS[0]).arm())
    if steps is not None:
        write_step_plot(steps, DOCS_ROBOTS[0], folder / "ik_steps.png")


if __name__ == "__main__":
    parser = page_parser(__doc__, "ik")
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--success", type=int, metavar="SAMPLES", help="success rates only; targets per arm")
    parser.add_argument("--no-peers", action="store_true", help="leave out other libraries")
    parser.add_argument("--own-limits", action="store_true", help="keep ranges wider than one full rotation")
    run(parser, "ik", DocsIkTable, measure, page, write)
