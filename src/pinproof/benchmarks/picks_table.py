"""The table of picks: its parts, and where its figures come from."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from pinproof.benchmarks.picks_campaign import CampaignRow
from pinproof.benchmarks.picks_measure import ScreenRow, VerdictRow
from pinproof.benchmarks.stored import read_table, write_table
from pinproof.errors import FileError, InputError

__all__ = ["PicksTable"]

WHAT = "picks"

ROWS: dict[str, type] = {
    "verdicts": VerdictRow,
    "screening": ScreenRow,
    "campaigns": CampaignRow,
    "machinery": CampaignRow,
}


@dataclass(frozen=True)
class PicksTable:
    """The figures of one run.

    Parameters
    ----------
    settings
        What was run.
    verdicts
        Picks judged through all stages.
    screening
        Poses screened.
    campaigns
        The same picks judged by other numbers of workers, one worker first.
    machinery
        Campaigns that judge nothing.
    provenance
        See :func:`pinproof.benchmarks.provenance.provenance`.
    """

    settings: dict[str, Any]
    verdicts: tuple[VerdictRow, ...]
    screening: tuple[ScreenRow, ...]
    campaigns: tuple[CampaignRow, ...]
    machinery: tuple[CampaignRow, ...]
    provenance: dict[str, Any]

    @classmethod
    def from_dict(cls, words: dict[str, Any]) -> PicksTable:
        """The table whose ``asdict`` this is.

        Raises
        ------
        InputError
            If it is none.
        """
        try:
            given = {each.name: words[each.name] for each in fields(cls)}
            given |= {name: tuple(row(**each) for each in given[name]) for name, row in ROWS.items()}
            return cls(**given)
        except (KeyError, TypeError) as error:
            raise InputError(f"this is no table of {WHAT}: {error}") from error

    def save(self, path: str | Path) -> None:
        """Write the table as JSON."""
        write_table(path, asdict(self))

    @classmethod
    def load(cls, path: str | Path) -> PicksTable:
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
