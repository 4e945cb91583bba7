"""Success rates of our IK methods on many random poses of every arm, which the documentation shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from benchmark_page import report

from pinproof.benchmarks import IkTable
from pinproof.benchmarks.ik_methods import OWN_METHODS, Part, select_methods
from pinproof.benchmarks.ik_run import WARM_UP, check_answers, load_arm, random_targets, timed_batch
from pinproof.benchmarks.ik_table import percent
from pinproof.benchmarks.tables import NotApplicableError, row_table, wrapped
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

    ``success`` is as in :class:`pinproof.benchmarks.ik_table.IkRow`; ``batch_us`` is in microseconds per target;
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
