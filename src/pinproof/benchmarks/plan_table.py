"""The table of planning: every answer to every problem, and the figures of any share of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from pinproof.benchmarks.plan_measure import PlanRow
from pinproof.benchmarks.plan_methods import OURS, STEPS
from pinproof.benchmarks.stored import read_table, write_table
from pinproof.errors import FileError, InputError

__all__ = ["PlanFigures", "PlanTable", "ProblemRow", "Spread"]


@dataclass(frozen=True)
class ProblemRow:
    """A problem: which robot it asks, what its ends touch, what had to be changed, and how long its checker took.

    ``hull`` and ``exact`` are those of :class:`pinproof.benchmarks.plan_problem.Ends`; ``setup_ms`` is the time in
    which the checker was made, which no method's time holds.
    """

    collection: str
    set_name: str
    number: int
    robot: str
    hull: tuple[str, ...]
    exact: tuple[str, ...]
    notes: tuple[str, ...]
    setup_ms: float

    @property
    def name(self) -> str:
        """``"ur5/shelf/3"``."""
        return f"{self.collection}/{self.set_name}/{self.number}"


@dataclass(frozen=True)
class Spread:
    """Median, 95th percentile and largest of some numbers."""

    median: float
    p95: float
    largest: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread | None:
        """Of no numbers there is none."""
        return cls(*np.quantile(values, (0.5, 0.95, 1.0)).tolist()) if len(values) else None


@dataclass(frozen=True)
class PlanFigures:
    """A method's figures over some problems with free ends.

    Parameters
    ----------
    label
        The method.
    asked, solved, certified, unsafe
        Problems; motions; motions with a proof (None of a method that offers none); motions with faults.
    ms
        Step, or ``"total"``, to the spread of its milliseconds over the motions.
    length, duration, clearance
        Medians of length (rad, m) and duration (s), and the smallest clearance proven (m).
    ours_to_its
        Of a peer: the median of our lengths over the median of its own, on problems that both solved.
    cut
        Edges that failed the proof, all together.
    """

    label: str
    asked: int
    solved: int
    certified: int | None
    unsafe: int
    ms: dict[str, Spread]
    length: float | None
    duration: float | None
    clearance: float | None
    ours_to_its: float | None
    cut: int | None


@dataclass(frozen=True)
class PlanTable:
    """The figures of one run.

    Parameters
    ----------
    settings
        What was run: problems, repeats, peers and their versions, robots.
    problems
        Every problem that was read or drawn.
    rows
        An answer for each problem with free ends and each method.
    left_out
        Set or method to the reason why it is missing.
    provenance
        See :func:`pinproof.benchmarks.provenance.provenance`.
    """

    settings: dict[str, Any]
    problems: tuple[ProblemRow, ...]
    rows: tuple[PlanRow, ...]
    left_out: dict[str, str]
    provenance: dict[str, Any]

    @property
    def collections(self) -> tuple[str, ...]:
        """``"mbm"``, ``"ur5"``, ..., in the order of the run."""
        return tuple(dict.fromkeys(problem.collection for problem in self.problems))

    @property
    def methods(self) -> tuple[str, ...]:
        """The keys of the methods that answered anything, ours first."""
        return tuple(dict.fromkeys(row.method for row in self.rows))

    @property
    def unsafe(self) -> tuple[PlanRow, ...]:
        """Our answers with faults. There should be none."""
        return tuple(row for row in self.rows if row.method == OURS.key and row.faults)

    def sets(self, collection: str) -> tuple[str, ...]:
        """The sets of a collection, in the order of the run."""
        return tuple(dict.fromkeys(p.set_name for p in self.problems if p.collection == collection))

    def figures(self, method: str, collection: str | None = None, set_name: str | None = None) -> PlanFigures | None:
        """The figures of a method over all problems, a collection, or a set; None if it answered none of them."""
        asked = [row for row in self.rows if collection in (None, row.collection) and set_name in (None, row.set_name)]
        rows = [row for row in asked if row.method == method]
        if not rows:
            return None
        solved = [row for row in rows if row.solved]
        ms = {step: Spread.of([row.ms[step] for row in solved if step in row.ms]) for step in STEPS}
        ms["total"] = Spread.of([row.total for row in solved])
        proofs = [row.certified for row in rows if row.certified is not None]
        cuts = [row.cut for row in rows if row.cut is not None]
        clearances = [row.clearance for row in solved if row.clearance is not None]
        return PlanFigures(
            label=rows[0].label,
            asked=len(rows),
            solved=len(solved),
            certified=sum(proofs) if proofs else None,
            unsafe=sum(bool(row.faults) for row in rows),
            ms={step: spread for step, spread in ms.items() if spread is not None},
            length=_median([row.length for row in solved if row.length is not None]),
            duration=_median([row.duration for row in solved if row.duration is not None]),
            clearance=min(clearances) if clearances else None,
            ours_to_its=None if method == OURS.key else _ours_to_its(asked, method),
            cut=sum(cuts) if cuts else None,
        )

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON takes it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, words: dict[str, Any]) -> PlanTable:
        """The table that :meth:`to_dict` made.

        Raises
        ------
        InputError
            If it is none.
        """
        try:
            given = {field.name: words[field.name] for field in fields(cls)}
            given["problems"] = tuple(ProblemRow(**_frozen(row)) for row in given["problems"])
            given["rows"] = tuple(PlanRow(**_frozen(row)) for row in given["rows"])
            return cls(**given)
        except (AttributeError, KeyError, TypeError) as error:
            raise InputError(f"this is no table of planning: {error}") from error

    def save(self, path: str | Path) -> None:
        """Write the table as JSON."""
        write_table(path, self.to_dict())

    @classmethod
    def load(cls, path: str | Path) -> PlanTable:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FileError
            If the file cannot be read or holds no table.
        """
        try:
            return cls.from_dict(read_table(path, "planning"))
        except InputError as error:
            raise FileError(path, str(error)) from error


def _ours_to_its(rows: Sequence[PlanRow], method: str) -> float | None:
    lengths = {
        key: {row.name: row.length for row in rows if row.method == key and row.length is not None}
        for key in (OURS.key, method)
    }
    both = sorted(set(lengths[OURS.key]) & set(lengths[method]))
    ours, its = (_median([lengths[key][name] for name in both]) for key in (OURS.key, method))
    return ours / its if ours is not None and its else None


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def _frozen(words: dict[str, Any]) -> dict[str, Any]:
    """JSON's lists as the tuples they were."""
    return {key: tuple(value) if isinstance(value, list) else value for key, value in words.items()}
