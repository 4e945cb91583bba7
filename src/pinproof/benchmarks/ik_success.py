"""The big check: how many of 100,000 random configurations an arm are solved, and how fast, in batches on one core."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter_ns

import numpy as np
import numpy.typing as npt

from pinproof.benchmarks.ik_judge import judge_answers
from pinproof.benchmarks.ik_methods import Asked, Unsuitable, choose
from pinproof.benchmarks.ik_own import OWN
from pinproof.benchmarks.ik_problems import narrowed, random_targets
from pinproof.description import catalogue_names
from pinproof.errors import PinproofError
from pinproof.ik.windings import difference
from pinproof.model import Arm, load_robot

__all__ = ["METHODS", "SuccessRow", "success_rates"]

Array = npt.NDArray[np.float64]

METHODS = ("clik", "analytic")
"""Its methods, by default."""

REPEATS = 3
"""Batches of which the quickest counts: what other processes take from this one only ever makes it slower."""

SAME = 1e-4
"""Rad or m. An answer this near the configuration that made the target is that configuration. At a singular target, a
pose off by the closed form's 1e-9 comes from configurations off by the root of it, 3e-5."""


@dataclass(frozen=True)
class SuccessRow:
    """A method on one arm: whole poses, seed in the middle of the ranges, one thread.

    ``success`` is the share of targets whose answers are inside the limits and within 1e-6 m and 1e-6 rad by
    Pinocchio; ``batch_us`` microseconds a target; ``found_again`` the share of targets for which the configuration that
    made them is among the answers (but for whole turns), of a method that gives all of them.
    """

    robot: str
    method: str
    label: str
    samples: int
    success: float
    false_yes: int
    batch_us: float
    found_again: float | None


def success_rates(
    robots: Sequence[str] | None = None,
    *,
    samples: int = 100_000,
    methods: Sequence[str] = METHODS,
    limits_pi: bool = True,
    seed: int = 0,
    on_progress: Callable[[str], None] | None = None,
) -> tuple[SuccessRow, ...]:
    """Run the check, by default on every arm of the catalogue; a method that an arm does not suit gives no row."""
    rows = []
    for name in robots or catalogue_names():
        arm = load_robot(name).arm()
        arm = narrowed(arm) if limits_pi else arm
        targets = random_targets(arm, samples, seed)
        for method in choose(tuple(methods), OWN):
            if on_progress is not None:
                on_progress(f"{name}: {method.label}, {samples} targets")
            try:
                solvers = method.prepare(arm, Asked("random", "pose", True))
            except (Unsuitable, PinproofError):
                continue
            if solvers is None or solvers.many is None:
                continue
            solvers.many(targets.poses[:50], targets.start)
            spent = []
            for _ in range(REPEATS):
                begun = perf_counter_ns()
                answers = solvers.many(targets.poses, targets.start)
                spent.append((perf_counter_ns() - begun) / 1e3 / samples)
            judged = judge_answers(arm, targets.poses, answers, "pose", method.tolerance)
            again = _found_again(arm, answers, targets.q) if answers.shape[1] > 1 else None
            rows.append(
                SuccessRow(name, method.key, method.label, samples, judged.success, judged.false_yes, min(spent), again)
            )
    return tuple(rows)


def _found_again(arm: Arm, answers: Array, q: Array) -> float:
    away = np.abs(difference(arm, answers, q[:, None])).max(axis=2)
    return float((np.where(np.isnan(away), np.inf, away).min(axis=1) <= SAME).mean())
