"""The table of the planning benchmark: one row per problem and method, and figures over groups of problems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pinproof.benchmarks.plan_methods import OURS, STEPS
from pinproof.benchmarks.tables import BenchmarkTable

__all__ = ["PlanFigures", "PlanRow", "PlanTable", "ProblemRow", "Spread"]


@dataclass(frozen=True)
class ProblemRow:
    """A problem, its robot, what is wrong with its start and goals, and how it was adapted to the robot.

    ``hull_faults`` and ``mesh_faults`` are those of :class:`pinproof.benchmarks.plan_problems.EndFaults`; ``setup_ms``
    is the time to build the collision checker, which is not part of the times of the methods.
    """

    collection: str
    set_name: str
    number: int
    robot: str
    hull_faults: tuple[str, ...]
    mesh_faults: tuple[str, ...]
    notes: tuple[str, ...]
    setup_ms: float

    @property
    def name(self) -> str:
        """For example ``"ur5/shelf/3"``."""
        return f"{self.collection}/{self.set_name}/{self.number}"


@dataclass(frozen=True)
class PlanRow:
    """The result of a method on a problem.

    Parameters
    ----------
    collection, set_name, number, method, label
        The problem and the method.
    solved
        Whether it returned a motion.
    certified
        Whether the motion has a FREE certificate; None for a method without certificates.
    faults
        What the independent check found wrong with the motion.
    ms
        Milliseconds of each step in the fastest run.
    length
        Euclidean length in joint space (rad and m count alike); None if not solved.
    duration
        Seconds; None for a path without timing.
    clearance
        Proven clearance in m; None without a certificate.
    rejected_edges
        Edges that were free at their samples but failed the proof; None for a method without certificates.
    repeatable
        Whether every run with the same seed returned the same motion; None after a single run.
    message
        Why there is no motion, or no certificate.
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
    rejected_edges: int | None
    repeatable: bool | None
    message: str

    @property
    def name(self) -> str:
        """The problem, for example ``"ur5/shelf/3"``."""
        return f"{self.collection}/{self.set_name}/{self.number}"

    @property
    def total(self) -> float:
        """Milliseconds of all steps."""
        return sum(self.ms.values())

    @property
    def safe(self) -> bool:
        """Whether there is a motion without faults."""
        return self.solved and not self.faults


@dataclass(frozen=True)
class Spread:
    """Median, 95th percentile and largest of some numbers."""

    median: float
    p95: float
    largest: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread | None:
        """Return the spread of the values; None without any."""
        return cls(*np.quantile(values, (0.5, 0.95, 1.0)).tolist()) if len(values) else None


@dataclass(frozen=True)
class PlanFigures:
    """The figures of a method over a group of problems whose start and goal are free.

    Parameters
    ----------
    label
        The method.
    problems, solved, certified, unsafe
        Numbers of problems, motions, certified motions (None for a method without certificates), motions with faults.
    ms
        Step, or ``"total"``, to the spread of its milliseconds over the motions.
    length, duration, clearance
        Medians of length (rad, m) and duration (s), and the smallest proven clearance (m).
    length_ratio
        For another library: the median of our lengths over the median of its lengths, on problems that both solved.
    rejected_edges
        Number of edges that failed the proof.
    """

    label: str
    problems: int
    solved: int
    certified: int | None
    unsafe: int
    ms: dict[str, Spread]
    length: float | None
    duration: float | None
    clearance: float | None
    length_ratio: float | None
    rejected_edges: int | None


@dataclass(frozen=True)
class PlanTable(BenchmarkTable):
    """The results of one run.

    Parameters
    ----------
    problems
        Every problem that was read or generated.
    rows
        One for each method and problem with free start and goal.
    left_out
        Set or method to the reason why it is missing.
    """

    problems: tuple[ProblemRow, ...]
    rows: tuple[PlanRow, ...]
    left_out: dict[str, str]

    topic: ClassVar[str] = "planning"
    row_types: ClassVar[dict[str, type]] = {"problems": ProblemRow, "rows": PlanRow}

    @property
    def collections(self) -> tuple[str, ...]:
        """``"mbm"``, ``"ur5"``, ..., in the order of the run."""
        return tuple(dict.fromkeys(problem.collection for problem in self.problems))

    @property
    def methods(self) -> tuple[str, ...]:
        """The keys of the methods with rows, ours first."""
        return tuple(dict.fromkeys(row.method for row in self.rows))

    @property
    def unsafe(self) -> tuple[PlanRow, ...]:
        """Our motions with faults; expected to be empty."""
        return tuple(row for row in self.rows if row.method == OURS.key and row.faults)

    def sets(self, collection: str) -> tuple[str, ...]:
        """Return the sets of a collection in the order of the run."""
        return tuple(dict.fromkeys(p.set_name for p in self.problems if p.collection == collection))

    def figures(self, method: str, collection: str | None = None, set_name: str | None = None) -> PlanFigures | None:
        """Return the figures of a method over all problems, a collection, or a set; None without any row."""
        group = [row for row in self.rows if collection in (None, row.collection) and set_name in (None, row.set_name)]
        rows = [row for row in group if row.method == method]
        if not rows:
            return None
        solved = [row for row in rows if row.solved]
        ms = {step: Spread.of([row.ms[step] for row in solved if step in row.ms]) for step in STEPS}
        ms["total"] = Spread.of([row.total for row in solved])
        certified = [row.certified for row in rows if row.certified is not None]
        rejected = [row.rejected_edges for row in rows if row.rejected_edges is not None]
        return PlanFigures(
            label=rows[0].label,
            problems=len(rows),
            solved=len(solved),
            certified=sum(certified) if certified else None,
            unsafe=sum(bool(row.faults) for row in rows),
            ms={step: spread for step, spread in ms.items() if spread is not None},
            length=_median([row.length for row in solved]),
            duration=_median([row.duration for row in solved]),
            clearance=min((row.clearance for row in solved if row.clearance is not None), default=None),
            length_ratio=None if method == OURS.key else _length_ratio(group, method),
            rejected_edges=sum(rejected) if rejected else None,
        )


def _length_ratio(rows: Sequence[PlanRow], method: str) -> float | None:
    lengths = {
        key: {row.name: row.length for row in rows if row.method == key and row.length is not None}
        for key in (OURS.key, method)
    }
    both = set(lengths[OURS.key]) & set(lengths[method])
    ours, theirs = (_median([lengths[key][name] for name in both]) for key in (OURS.key, method))
    return ours / theirs if ours is not None and theirs else None


def _median(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
