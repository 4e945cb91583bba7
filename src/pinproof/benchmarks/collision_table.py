"""The table of collision checks and proofs: its parts, and where its figures come from."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from pinproof.benchmarks.collision_edges import EdgeRow
from pinproof.benchmarks.collision_measure import CheckRow, ProofRow, Times
from pinproof.benchmarks.stored import read_table, write_table
from pinproof.errors import FileError, InputError

__all__ = ["CollisionTable"]

WHAT = "collision checks"


@dataclass(frozen=True)
class CollisionTable:
    """The figures of one run.

    Parameters
    ----------
    settings
        What was run.
    checks
        Checks of arms in scenes.
    growth
        Checks of one arm among growing numbers of boxes.
    proofs
        Proofs of paths.
    edges
        Random edges, proven and looked at again; empty where that was not asked for.
    provenance
        See :func:`pinproof.benchmarks.provenance.provenance`.
    """

    settings: dict[str, Any]
    checks: tuple[CheckRow, ...]
    growth: tuple[CheckRow, ...]
    proofs: tuple[ProofRow, ...]
    edges: tuple[EdgeRow, ...]
    provenance: dict[str, Any]

    @property
    def wrong(self) -> tuple[str, ...]:
        """The verdicts on edges that the second look contradicts."""
        return tuple(said for row in self.edges for said in row.wrong)

    @classmethod
    def from_dict(cls, words: dict[str, Any]) -> CollisionTable:
        """The table whose ``asdict`` this is.

        Raises
        ------
        InputError
            If it is none.
        """
        try:
            given = {field.name: words[field.name] for field in fields(cls)}
            for name in ("checks", "growth"):
                given[name] = tuple(_check_row(row) for row in given[name])
            given["proofs"] = tuple(ProofRow(**row) for row in given["proofs"])
            given["edges"] = tuple(EdgeRow(**{**row, "wrong": tuple(row["wrong"])}) for row in given["edges"])
            return cls(**given)
        except (KeyError, TypeError) as error:
            raise InputError(f"this is no table of {WHAT}: {error}") from error

    def save(self, path: str | Path) -> None:
        """Write the table as JSON."""
        write_table(path, asdict(self))

    @classmethod
    def load(cls, path: str | Path) -> CollisionTable:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FileError
            If the file cannot be read or holds no table.
        """
        try:
            return cls.from_dict(read_table(path, WHAT))
        except InputError as error:
            raise FileError(path, str(error)) from error


def _check_row(words: dict[str, Any]) -> CheckRow:
    values: dict[str, Any] = {name: Times(**v) if isinstance(v, dict) else v for name, v in words.items()}
    return CheckRow(**values)
