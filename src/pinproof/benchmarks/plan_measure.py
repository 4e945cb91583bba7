"""One problem, one method: asked as often as told, timed, and its answer judged."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pinproof.benchmarks.plan_judge import judge
from pinproof.benchmarks.plan_methods import Answer, Ask, PlanMethod
from pinproof.benchmarks.plan_problem import PlanProblem
from pinproof.collision import CollisionChecker
from pinproof.motion import Curve

__all__ = ["PlanRow", "measure"]


@dataclass(frozen=True)
class PlanRow:
    """What a method made of a problem.

    Parameters
    ----------
    collection, set_name, number
        The problem.
    method, label
        The method.
    solved
        Whether it gave a motion.
    certified
        Whether with a proof; None of a method that offers none.
    faults
        What the judge found wrong with the motion.
    ms
        Milliseconds of each step, of the quickest of all times it was asked.
    length
        Euclidean, in joint space (rad and m count alike); None unless solved.
    duration
        Seconds; None of a path without timing.
    clearance
        Metres that are proven; None without a proof.
    cut
        Edges that failed the proof; None of a method without one.
    same_again
        Whether the same seed gave the same motion each time; None if it was asked once.
    message
        Why there is no motion, or no proof.
    """

    collection: str
    set_name: str
    number: int
    method: str
    label: str
    solved: bool
    certified: bool | None
    faults: tuple[str, ...]
    ms: dict[str, float]
    length: float | None
    duration: float | None
    clearance: float | None
    cut: int | None
    same_again: bool | None
    message: str

    @property
    def name(self) -> str:
        """The problem: ``"ur5/shelf/3"``."""
        return f"{self.collection}/{self.set_name}/{self.number}"

    @property
    def total(self) -> float:
        """Milliseconds of all steps together."""
        return sum(self.ms.values())

    @property
    def safe(self) -> bool:
        """Whether it gave a motion with which nothing is wrong."""
        return self.solved and not self.faults


def measure(
    problem: PlanProblem, method: PlanMethod, ask: Ask, exact: CollisionChecker, *, seed: int, repeats: int
) -> PlanRow:
    """Ask a method ``repeats`` times; ``exact`` has the links' own meshes."""
    answers = [ask(seed) for _ in range(repeats)]
    best: Answer = min(answers, key=lambda answer: sum(answer.ms.values()))
    judged = None if best.curve is None else judge(best.curve, problem, exact)
    return PlanRow(
        collection=problem.collection,
        set_name=problem.set_name,
        number=problem.number,
        method=method.key,
        label=method.label,
        solved=best.curve is not None,
        certified=best.certified,
        faults=() if judged is None else judged.faults,
        ms={step: round(ms, 4) for step, ms in best.ms.items()},
        length=None if judged is None else round(judged.length, 6),
        duration=None if best.duration is None else round(best.duration, 6),
        clearance=None if best.clearance is None else round(best.clearance, 7),
        cut=best.cut,
        same_again=all(_same(a.curve, b.curve) for a, b in pairwise(answers)) if repeats > 1 else None,
        message=best.message,
    )


def _same(one: Curve | None, other: Curve | None) -> bool:
    """Whether two motions are equal, bit by bit."""
    if one is None or other is None:
        return one is other
    return all(np.array_equal(a, b) for a, b in zip(one.bezier(), other.bezier(), strict=True))
