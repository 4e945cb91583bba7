"""The table of inverse kinematics: its parts, its rows, and where its figures come from."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from pinproof.benchmarks.ik_measure import IkRow
from pinproof.benchmarks.ik_methods import Asked
from pinproof.benchmarks.ik_success import SuccessRow
from pinproof.benchmarks.stored import read_table, write_table
from pinproof.errors import FileError, InputError

__all__ = ["PARTS", "TEXTBOOK", "IkTable"]

TEXTBOOK = (
    "The textbook columns are the textbook's own figures: mean time and success of 10,000 points, position only, one "
    "seed; its machine is not known."
)

PARTS: tuple[Asked, ...] = (
    Asked("random", "position", False),
    Asked("random", "position", True),
    Asked("random", "pose", False),
    Asked("random", "pose", True),
    Asked("trajectory", "pose", True),
)
"""What is asked of every method: random targets, position only and whole poses, from one seed and with restarts; and
whole poses along a trajectory."""


@dataclass(frozen=True)
class IkTable:
    """The figures of one run.

    Parameters
    ----------
    settings
        What was run: points, limits of each robot, tolerances.
    rows
        The figures, one for each robot, part and method.
    left_out
        Robot to method to reason, for the methods that could not be had.
    success
        The big check, where it was made too.
    provenance
        See :func:`pinproof.benchmarks.provenance.provenance`.
    """

    settings: dict[str, Any]
    rows: tuple[IkRow, ...]
    left_out: dict[str, dict[str, str]]
    provenance: dict[str, Any]
    success: tuple[SuccessRow, ...] = ()

    @property
    def robots(self) -> tuple[str, ...]:
        """Their names, in the order asked."""
        return tuple(self.settings["robots"])

    def part(self, robot: str, asked: Asked) -> tuple[IkRow, ...]:
        """The rows of a robot for what was asked."""
        wanted = (robot, asked.problem, asked.task, asked.restarts)
        return tuple(row for row in self.rows if (row.robot, row.problem, row.task, row.restarts) == wanted)

    def to_dict(self) -> dict[str, Any]:
        """The table as JSON takes it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, words: dict[str, Any]) -> IkTable:
        """The table that :meth:`to_dict` made.

        Raises
        ------
        InputError
            If it is none.
        """
        try:
            given = {field.name: words[field.name] for field in fields(cls)}
            given["rows"] = tuple(IkRow(**row) for row in given["rows"])
            given["success"] = tuple(SuccessRow(**row) for row in given["success"])
            return cls(**given)
        except (KeyError, TypeError) as error:
            raise InputError(f"this is no table of inverse kinematics: {error}") from error

    def save(self, path: str | Path) -> None:
        """Write the table as JSON."""
        write_table(path, self.to_dict())

    @classmethod
    def load(cls, path: str | Path) -> IkTable:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FileError
            If the file cannot be read or holds no table.
        """
        try:
            return cls.from_dict(read_table(path, "inverse kinematics"))
        except InputError as error:
            raise FileError(path, str(error)) from error
