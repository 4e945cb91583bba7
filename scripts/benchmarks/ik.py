"""Benchmark of inverse kinematics.

./scripts/benchmark ik ur5 panda --points 10000    prints the table; 30 s per robot
./scripts/benchmark ik --success 100000            prints success rates and batch times on every arm; a minute
./scripts/benchmark ik --docs                      runs both and rewrites docs/benchmarks/ik.*
./scripts/benchmark ik --render                    rewrites the page and the plots from docs/benchmarks/ik.json

Other libraries that are installed take most of the time.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from benchmarks.ik_methods import OWN_METHODS, Part, select_methods
from benchmarks.ik_run import (
    WARM_UP,
    IkTable,
    check_answers,
    ik_benchmark,
    ik_markdown,
    load_arm,
    percent,
    random_targets,
    timed_batch,
    write_ik_table,
)
from benchmarks.ik_steps import step_sizes, write_step_plot
from benchmarks.tables import NotApplicableError, page_parser, report, row_table, run, wrapped
from pinproof import load_robot
from pinproof.description import catalogue_names
from pinproof.errors import PinproofError
from pinproof.ik.windings import difference
from pinproof.model import Arm

Array = npt.NDArray[np.float64]

METHODS = ("clik", "analytic")

REPEATS = 3
"""Batches timed for the success rates; the fastest counts, since other processes can only make one slower."""

SAME_CONFIGURATION = 1e-4
"""Rad or m below which an answer equals the configuration that generated the target. At a singular target, a pose error
of 1e-9, the tolerance of the closed form, corresponds to joint errors of its square root, 3e-5."""


@dataclass(frozen=True)
class SuccessRow:
    """A method on many random poses of one arm, started from the middle of the joint ranges, on one thread.

    ``success`` is as in :class:`benchmarks.ik_run.IkRow`; ``batch_us`` is in microseconds per target;
    ``recovered`` is the share of targets for which the configuration that generated them is among the answers (up to
    full rotations), for a method that returns all branches.
    """

    robot: str
    method: str
    label: str
    samples: int
    success: float
    false_positives: int
    batch_us: float
    recovered: float | None


@dataclass(frozen=True)
class DocsIkTable(IkTable):
    """The IK table of the documentation, with success rates."""

    success: tuple[SuccessRow, ...] = ()

    row_types: ClassVar[dict[str, type]] = {**IkTable.row_types, "success": SuccessRow}


def success_rates(
    robots: Sequence[str] | None = None,
    *,
    samples: int = 100_000,
    methods: Sequence[str] = METHODS,
    limits_pi: bool = True,
    seed: int = 0,
) -> tuple[SuccessRow, ...]:
    """Measure success and batch times of many random poses, by default on every arm of the catalogue.

    Methods that do not apply to an arm have no row.
    """
    rows = []
    for name in robots or catalogue_names():
        arm = load_arm(name, limits_pi)
        targets = random_targets(arm, samples, seed)
        for method in select_methods(methods, OWN_METHODS):
            report(f"{name}: {method.label}, {samples} targets")
            try:
                prepared = method.prepare(arm, Part("random", "pose", True))
            except (NotApplicableError, PinproofError):
                continue
            if prepared.solve_batch is None:
                continue
            prepared.solve_batch(targets.poses[:WARM_UP], targets.start)
            runs = [timed_batch(prepared.solve_batch, targets.poses, targets.start) for _ in range(REPEATS)]
            answers, fastest = runs[-1][0], min(nanoseconds for _, nanoseconds in runs)
            checked = check_answers(arm, targets.poses, answers, "pose", method.tolerance)
            rows.append(
                SuccessRow(
                    robot=name,
                    method=method.key,
                    label=method.label,
                    samples=samples,
                    success=checked.success,
                    false_positives=checked.false_positives,
                    batch_us=fastest / 1e3 / samples,
                    recovered=_recovered(arm, answers, targets.q) if answers.shape[1] > 1 else None,
                )
            )
    return tuple(rows)


def _recovered(arm: Arm, answers: Array, q: Array) -> float:
    distance = np.abs(difference(arm, answers, q[:, None])).max(axis=2)
    nearest = np.where(np.isnan(distance), np.inf, distance).min(axis=1)
    return float((nearest <= SAME_CONFIGURATION).mean())


def success_markdown(rows: Sequence[SuccessRow]) -> str:
    """Return the section of the Markdown page; empty without rows."""
    if not rows:
        return ""
    text = wrapped(
        f"{rows[0].samples:,} random configurations per arm, full poses, one thread. Recovered is the share of targets "
        "for which the configuration that generated the target is among the answers."
    )
    columns = {
        "arm": "{.robot}",
        "method": "{.label}",
        "success": lambda row: percent(row.success),
        "false positives": "{.false_positives}",
        "batch mean, us": "{.batch_us:.2f}",
        "recovered": lambda row: percent(row.recovered),
    }
    return "\n".join(["", "## Success rates", "", *text, "", *row_table(columns, rows, text_columns=2)]) + "\n"


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


def main() -> None:
    """Run the benchmark with the arguments of the command line."""
    parser = page_parser(__doc__, "ik")
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--success", type=int, metavar="SAMPLES", help="success rates only; targets per arm")
    parser.add_argument("--no-peers", action="store_true", help="leave out other libraries")
    parser.add_argument("--own-limits", action="store_true", help="keep ranges wider than one full rotation")
    run(parser, "ik", DocsIkTable, measure, page, write)
